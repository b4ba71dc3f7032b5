/* report.c: see report.h */
#include "report.h"

#include "hydra_vk.h"

#include <stdio.h>
#include <sys/resource.h>

static double mebibytes(double bytes) { return bytes / (1024.0 * 1024.0); }

static double per(double amount, double divisor) { return divisor > 0.0 ? amount / divisor : 0.0; }

static void print_scene(const hydra_scene_info *info, const imported *scene_file) {
    double bvh = per((double)info->bytes_bvh, (double)info->triangles);
    double all = per((double)(info->bytes_bvh + info->bytes_geometry), (double)info->triangles);
    printf("triangles      %12llu   placed %llu, degenerate %llu, instances %zu\n", (unsigned long long)info->triangles,
           (unsigned long long)info->placed_triangles, (unsigned long long)info->degenerate, scene_file->instances);
    printf("bytes/triangle %12.1f   of the ray tracing tree; %.1f with vertices and attributes\n", bvh, all);
    printf("emitters       %12llu   textures %.1f MiB, environment %.1f MiB\n", (unsigned long long)info->emitters,
           mebibytes((double)info->bytes_textures), mebibytes((double)info->bytes_environment));
}

static void print_rays(const hydra_status *status) {
    double seconds = status->seconds;
    double all = (double)(status->rays_camera + status->rays_bounce + status->rays_shadow);
    printf("rays/s         %12.2f M  camera %.2f M, bounce %.2f M, shadow %.2f M; paths %.2f M\n", per(all, seconds) * 1e-6,
           per((double)status->rays_camera, seconds) * 1e-6, per((double)status->rays_bounce, seconds) * 1e-6,
           per((double)status->rays_shadow, seconds) * 1e-6, per((double)status->paths, seconds) * 1e-6);
    printf("CPU s by pass  %12.2f   generate %.2f, intersect %.2f, shade %.2f, shadow %.2f, accumulate %.2f\n",
           status->seconds_generate + status->seconds_intersect + status->seconds_shade + status->seconds_shadow +
               status->seconds_accumulate,
           status->seconds_generate, status->seconds_intersect, status->seconds_shade, status->seconds_shadow, status->seconds_accumulate);
}

static void print_device(hydra_context *context) {
    hydra_vk_info info;
    if (hydra_vk_get_info(context, &info) != HYDRA_OK) return;
    printf("device         %12.1f   MiB at most on %s\n", mebibytes((double)info.bytes_peak), info.name);
    printf("pipelines      %12u   made in %.2f s; start %.2f s; %llu slices of %.1f ms, longest %.1f\n", info.pipelines, info.seconds_pipelines,
           info.seconds_start, (unsigned long long)info.slices, 1e3 * info.slice_mean, 1e3 * info.slice_longest);
}

static void print_memory(hydra_context *context, const hydra_status *status) {
    hydra_memory_status memory = hydra_memory(context);
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    printf("memory peak    %12.1f   MiB in hydra (film %.1f, lanes %.1f); %.1f in the process\n", mebibytes((double)memory.bytes_peak),
           mebibytes((double)status->bytes_film), mebibytes((double)status->bytes_lanes), (double)usage.ru_maxrss / 1024.0);
}

void report_print(const report *times, const imported *scene_file, hydra_context *context, const hydra_scene *scene,
                  const hydra_status *status) {
    static const char *const isa_names[] = {"auto", "scalar", "SSE4.2", "AVX2", "AVX-512", "NEON"};
    hydra_scene_info info;
    hydra_scene_get_info(scene, &info);
    hydra_isa isa = hydra_context_isa(context);
    printf("seconds        %12.2f   load %.2f, build %.2f (trees %.2f), render %.2f, write %.2f\n",
           times->load_seconds + times->commit_seconds + status->seconds + times->write_seconds, times->load_seconds, times->commit_seconds,
           info.build_seconds, status->seconds, times->write_seconds);
    print_scene(&info, scene_file);
    print_rays(status);
    printf("samples/pixel  %12.1f   %u threads, %s\n", status->samples, (unsigned)hydra_context_threads(context),
           (unsigned)isa < sizeof isa_names / sizeof *isa_names ? isa_names[isa] : "unknown");
    printf("relative error %12.4f   95 %% interval %.4f to %.4f; %llu heavy-tailed pixels, %llu samples dropped\n", status->error,
           status->error_low, status->error_high, (unsigned long long)status->heavy_pixels, (unsigned long long)status->dropped_samples);
    print_memory(context, status);
    print_device(context);
}
