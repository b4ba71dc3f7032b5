/* Makes hydra.h and hydra_vk.h from their parts.

       amalgamate OUTPUT        hydra.h; run in the root of the repository
       amalgamate --vk OUTPUT   hydra_vk.h
       amalgamate --list        prints the parts of both, one a line, in their order

   The concatenation is verbatim but for local #include lines, which are dropped, and it depends on
   nothing but the parts: no date, no path of this machine. Only files named *.inc.h stand in place of
   every line that includes them: code that is expanded once for each instruction set, in its words. It stops with a message when a part is
   missing, has no mark in its first line, stands twice in the list, or includes a file that is not
   in the list before it: so the order below is also the proof that arrows only point down. A part of
   hydra_vk.h may include whatever is in hydra.h, which stands before it; no part of hydra.h sees any of hydra_vk.h. */
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The implementation of hydra.h, every file after those it includes. The one place where this order stands. */
static const char *const hydra_parts[] = {
    /* base: what the machine and the compiler offer */
    "src/base/platform.h",
    "src/base/context.h",
    "src/base/threads.h",
    "src/base/backend.h",
    "src/base/create.h",
    /* shared: what C and GLSL compute alike */
    "shaders/shared/language.h",
    "shaders/shared/vector.h",
    "shaders/shared/layouts.h",
    "shaders/shared/light_layouts.h",
    "shaders/shared/views.h",
    "shaders/shared/texture.h",
    "shaders/shared/sampler.h",
    "shaders/shared/sampling.h",
    "shaders/shared/alpha.h",
    "shaders/shared/shape.h",
    "shaders/shared/surface.h",
    "shaders/shared/fresnel.h",
    "shaders/shared/microfacet.h",
    "shaders/shared/energy.h",
    "shaders/shared/bsdf_layers.h",
    "shaders/shared/bsdf_lobes.h",
    "shaders/shared/bsdf.h",
    "shaders/shared/surface_light.h",
    "shaders/shared/emission.h",
    "shaders/shared/environment.h",
    "shaders/shared/light_tree.h",
    "shaders/shared/light.h",
    "shaders/shared/camera.h",
    "shaders/shared/path.h",
    "shaders/shared/passes.h",
    /* bvh: building, and traversal by instruction set */
    "src/bvh/layout.h",
    "src/bvh/build_vector.h",
    "src/bvh/build_refs.h",
    "src/bvh/build_sort.h",
    "src/bvh/build_units.h",
    "src/bvh/build_split.h",
    "src/bvh/build_spatial.h",
    "src/bvh/build_part.h",
    "src/bvh/build_cost.h",
    "src/bvh/build_cluster.h",
    "src/bvh/build_tree.h",
    "src/bvh/build_reinsert.h",
    "src/bvh/build_collapse.h",
    "src/bvh/build.h",
    "src/bvh/refit.h",
    "src/bvh/save.h",
    "src/bvh/triangle.h",
    "src/bvh/walk.h",
    "src/bvh/answer.h",
    "src/bvh/stream.h",
    "src/bvh/lanes_scalar.h",
    "src/bvh/lanes_avx2.h",
    "src/bvh/lanes_avx512.h",
    "src/bvh/lanes_sse42.h",
    "src/bvh/lanes_neon.h",
    "src/bvh/trace.h",
    /* scene: what the caller described, checked and committed */
    "src/scene/scene.h",
    "src/scene/validate.h",
    "src/scene/materials.h",
    "src/scene/meshes.h",
    "src/scene/trees.h",
    "src/scene/textures.h",
    "src/scene/energy_tables.h",
    "src/scene/environment.h",
    "src/scene/light_tree.h",
    "src/scene/lights.h",
    "src/scene/commit.h",
    "src/scene/queries.h",
    /* backend: what passes run on */
    "src/backend/chunk.h",
    "src/backend/cpu.h",
    /* render: sensors, film, passes */
    "src/render/exact_sum.h",
    "src/render/film.h",
    "src/render/adaptive.h",
    "src/render/sensor.h",
    "src/render/render.h",
    "src/render/statistics.h",
    "src/render/read.h",
    "src/render/share.h",
    "src/render/estimate.h",
    "src/render/selftest.h",
};

/* That of hydra_vk.h. */
static const char *const vk_parts[] = {
    "shaders/shared/tree.h",
    "shaders/shared/scan.h",
    "shaders/shared/sums.h",
    "shaders/shared/film.h",
    "src/vk/functions.h",
    "src/vk/device.h",
    "src/vk/memory.h",
    "src/vk/spirv.h",
    "src/vk/pipelines.h",
    "src/vk/submit.h",
    "src/vk/primitives.h",
    "src/vk/tree.h",
    "src/vk/scene.h",
    "src/vk/film.h",
    "src/vk/passes.h",
    "src/vk/queries.h",
    "src/vk/create.h",
};

/* A header to make. */
typedef struct product {
    const char *name, *made_from;
    const char *api;                  /* the document and the declarations */
    const char *const *parts;
    int count;
    const char *macro, *once;         /* asks for the implementation; says that it is there */
    const char *needs, *complaint;    /* a macro that must be defined before the implementation, or NULL */
    const struct product *below;      /* what stands before it in a program, or NULL */
} product;

#define COUNT(array) ((int)(sizeof(array) / sizeof((array)[0])))
static const product hydra = {
    "hydra.h", "src/ and shaders/shared/", "src/api.h", hydra_parts, COUNT(hydra_parts),
    "HYDRA_IMPLEMENTATION", "HYI_IMPLEMENTED", NULL, NULL, NULL,
};
static const product hydra_vk = {
    "hydra_vk.h", "src/vk/ and shaders/", "src/vk/api.h", vk_parts, COUNT(vk_parts),
    "HYDRA_VK_IMPLEMENTATION", "HYI_VK_IMPLEMENTED",
    "HYI_IMPLEMENTED", "hydra_vk.h: in this file, define HYDRA_IMPLEMENTATION and include hydra.h first", &hydra,
};

static const char *const license_file = "LICENSE";
enum { path_size = 512 };

#if defined(__GNUC__) || defined(__clang__)
__attribute__((noreturn, format(printf, 1, 2)))
#endif
static void stop(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    fputs("amalgamate: ", stderr);
    vfprintf(stderr, format, arguments);
    fputc('\n', stderr);
    va_end(arguments);
    exit(1);
}

/* The whole file, ending in a newline and a zero. The caller frees it. */
static char *read_file(const char *path) {
    FILE *file = fopen(path, "rb");
    if (!file) stop("cannot open %s (run this in the root of the repository)", path);
    size_t size = 0, capacity = 1 << 16;
    char *text = NULL;
    for (;;) {
        text = (char *)realloc(text, capacity + 2);
        if (!text) stop("no memory for %s", path);
        size += fread(text + size, 1, capacity - size, file);
        if (size < capacity) break;
        capacity *= 2;
    }
    if (ferror(file)) stop("cannot read %s", path);
    fclose(file);
    if (memchr(text, 0, size)) stop("%s holds a zero byte", path);
    if (memchr(text, '\r', size)) stop("%s holds a carriage return", path);
    if (size == 0) stop("%s is empty", path);
    if (text[size - 1] != '\n') text[size++] = '\n';
    text[size] = 0;
    return text;
}

static size_t line_length(const char *line) {
    return (size_t)(strchr(line, '\n') - line) + 1;
}

/* ---- directives */

/* What follows "# name" in a line that is this directive, else NULL. */
static const char *after_directive(const char *line, const char *name) {
    line += strspn(line, " \t");
    if (*line++ != '#') return NULL;
    line += strspn(line, " \t");
    size_t length = strlen(name);
    if (strncmp(line, name, length) != 0) return NULL;
    line += length;
    return *line == ' ' || *line == '\t' || *line == '"' || *line == '\n' ? line + strspn(line, " \t") : NULL;
}

/* For #include "name": copies the name and says true. */
static bool local_include(const char *line, char name[path_size]) {
    const char *at = after_directive(line, "include");
    if (!at || *at != '"') return false;
    size_t length = strcspn(at + 1, "\"\n");
    if (at[1 + length] != '"' || length >= path_size) stop("cannot read this line: %.*s", (int)line_length(line) - 1, line);
    memcpy(name, at + 1, length);
    name[length] = 0;
    return true;
}

/* name as seen from the folder of the part from, without any "." or "..". */
static void resolve(const char *from, const char *name, char path[path_size]) {
    const char *slash = strrchr(from, '/');
    size_t used = slash ? (size_t)(slash - from) : 0;
    if (used + strlen(name) + 2 > path_size) stop("path too long: %s in %s", name, from);
    memcpy(path, from, used);
    while (*name) {
        size_t step = strcspn(name, "/");
        if (step == 2 && !strncmp(name, "..", 2)) {
            if (used == 0) stop("%s leaves the repository", from);
            while (used && path[used - 1] != '/') used--;
            if (used) used--;
        } else if (!(step == 1 && *name == '.')) {
            if (used) path[used++] = '/';
            memcpy(path + used, name, step);
            used += step;
        }
        name += step;
        if (*name == '/') name++;
    }
    path[used] = 0;
}

/* The place of a path in the list of parts, or -1. */
static int place(const product *p, const char *path) {
    for (int i = 0; i < p->count; i++) {
        if (!strcmp(path, p->parts[i])) return i;
    }
    return -1;
}

static bool is_below(const product *p, const char *path) {
    const product *other = p->below;
    return other && (!strcmp(path, other->api) || place(other, path) >= 0);
}

/* A part may include the header, the parts before it, and all that stands before its product. */
static void check_include(const product *p, int index, const char *name) {
    char path[path_size];
    const char *part = p->parts[index];
    resolve(part, name, path);
    if (!strcmp(path, p->api) || is_below(p, path)) return;
    int at = place(p, path);
    if (at < 0) stop("%s includes %s, which is not in the list of parts of %s", part, path, p->name);
    if (at >= index) stop("%s includes %s, which stands %s", part, path, at == index ? "for itself" : "behind it in the list of parts");
}

/* The declarations include nothing but the headers themselves, which their document also tells how to use. */
static void check_api(const product *p, const char *text) {
    char name[path_size];
    for (const char *line = text; *line; line += line_length(line)) {
        if (!local_include(line, name) || !strcmp(name, p->name) || !strcmp(name, hydra.name)) continue;
        stop("%s must not include %s", p->api, name);
    }
}

/* ---- marks: the first line of a part is its mark: slash, star, blank, two > signs, name: what it is */

typedef struct mark {
    char name[64];
    char what[160];
} mark;

static mark read_mark(const char *path, const char *text) {
    static const char opening[] = "/* >>";
    mark m;
    const char *colon = strchr(text, ':');
    if (strncmp(text, opening, sizeof opening - 1) != 0 || !colon || colon > strchr(text, '\n'))
        stop("%s does not begin with %sname: what it is", path, opening);
    const char *name = text + sizeof opening - 1;
    snprintf(m.name, sizeof m.name, "%.*s", (int)(colon - name), name);
    const char *what = colon + 1 + strspn(colon + 1, " ");
    size_t length = strcspn(what, "\n");
    if (length >= 3 && !strncmp(what + length - 2, "*/", 2)) length -= 2;
    while (length && what[length - 1] == ' ') length--;
    if (length == 0 || length >= sizeof m.what) stop("the mark of %s says nothing, or too much", path);
    snprintf(m.what, sizeof m.what, "%.*s", (int)length, what);
    return m;
}

/* ---- output */

/* A block that guards nothing but a local include is dropped with it: its first line. */
static bool guards_only_include(const char *line) {
    char name[path_size];
    if (!after_directive(line, "ifndef") && !after_directive(line, "ifdef") && !after_directive(line, "if")) return false;
    const char *second = line + line_length(line);
    if (!*second || !local_include(second, name)) return false;
    const char *third = second + line_length(second);
    return *third && after_directive(third, "endif") != NULL;
}

static bool is_template(const char *name) {
    size_t length = strlen(name);
    return length > 6 && !strcmp(name + length - 6, ".inc.h");
}

static void write_template(FILE *out, const char *part, const char *name) {
    char path[path_size];
    resolve(part, name, path);
    char *text = read_file(path);
    for (const char *line = text; *line; line += line_length(line))
        if (after_directive(line, "include")) stop("%s must not include anything", path);
    fputs(text, out);
    free(text);
}

static void write_part(FILE *out, const product *p, int index, const char *text) {
    char name[path_size];
    bool blank = true, dropped = false;
    fputc('\n', out);
    for (const char *line = text; *line; line += line_length(line)) {
        bool block = guards_only_include(line);
        if (block) line += line_length(line);
        if (local_include(line, name) && is_template(name)) {
            write_template(out, p->parts[index], name);
            continue;
        }
        if (local_include(line, name)) {
            check_include(p, index, name);
            if (block) line += line_length(line);
            dropped = true;
            continue;
        }
        bool empty = *line == '\n';
        if (empty && blank && dropped) continue; /* dropped lines leave one blank line, not two */
        if (!empty) dropped = false;
        blank = empty;
        fwrite(line, 1, line_length(line), out);
    }
}

static void write_contents(FILE *out, const product *p, char *const texts[]) {
    fputs("/* The implementation, part by part; search for a mark to get there.\n\n", out);
    for (int i = 0; i < p->count; i++) {
        mark m = read_mark(p->parts[i], texts[i]);
        for (int j = 0; j < i; j++) {
            if (!strcmp(m.name, read_mark(p->parts[j], texts[j]).name)) stop("%s and %s have one mark", p->parts[j], p->parts[i]);
        }
        fprintf(out, "     >>%-24s %s\n", m.name, m.what);
    }
    fputs("*/\n", out);
}

static void write_header(FILE *out, const product *p, const char *api, char *const texts[], const char *license) {
    fprintf(out, "/* %s is generated from %s by `make %s`. Edit those, not this. */\n\n", p->name, p->made_from, p->name);
    fputs(api, out);
    fputs("\n/* ================================================================ end of the API */\n\n", out);
    fprintf(out, "#if defined(%s) && !defined(%s)\n#define %s\n\n", p->macro, p->once, p->once);
    if (p->needs) fprintf(out, "#ifndef %s\n#error \"%s\"\n#endif\n\n", p->needs, p->complaint);
    write_contents(out, p, texts);
    for (int i = 0; i < p->count; i++) write_part(out, p, i, texts[i]);
    fprintf(out, "\n#endif /* %s */\n\n/*\n", p->macro);
    fputs(license, out);
    fputs("*/\n", out);
}

static void list(const product *p) {
    puts(p->api);
    for (int i = 0; i < p->count; i++) puts(p->parts[i]);
}

static void make(const product *p, const char *path) {
    char **texts = (char **)malloc((size_t)p->count * sizeof *texts);
    if (!texts) stop("no memory");
    char *api = read_file(p->api), *license = read_file(license_file);
    check_api(p, api);
    if (strstr(license, "*/")) stop("%s ends the comment it stands in", license_file);
    for (int i = 0; i < p->count; i++) texts[i] = read_file(p->parts[i]);
    FILE *out = fopen(path, "wb");
    if (!out) stop("cannot write %s", path);
    write_header(out, p, api, texts, license);
    bool failed = ferror(out) != 0;
    if (fclose(out) != 0 || failed) stop("cannot write %s", path);
    for (int i = 0; i < p->count; i++) free(texts[i]);
    free(texts);
    free(license);
    free(api);
}

int main(int argc, char **argv) {
    bool vk = argc == 3 && !strcmp(argv[1], "--vk");
    if (argc != 2 && !vk) stop("usage: amalgamate [--vk] OUTPUT, or amalgamate --list");
    if (!strcmp(argv[1], "--list")) {
        list(&hydra);
        list(&hydra_vk);
        return 0;
    }
    if (argv[argc - 1][0] == '-') stop("no option %s", argv[argc - 1]);
    make(vk ? &hydra_vk : &hydra, argv[argc - 1]);
    return 0;
}
