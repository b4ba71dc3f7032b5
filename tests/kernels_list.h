/* Every kernel of shaders/shared, called on words: what test_vk_kernels.c runs on a device, in float on the host and in
   double on the host. This one source is all three: tests/kernels.comp includes it for the device, test_vk_kernels.c and
   kernels_double.c for the host; each says before how words are read and results told:

       KT_KERNEL(name)           a kernel: begins a function kt_<name> that reads its inputs and tells its results
       KT_GET(what)              the next input: a uint, a real, a unit (a real of [0, 1)), an exact (a real whose last bit
                                 is meant), a vec2, units, a vec3 or a record
       KT_UINT(x) KT_REAL(x) KT_VEC3(x)   the next result; whole numbers must agree to the bit
       KT_SCALE(x)               errors of the next results are in ulps of at least this; 0: of their own size

   A kernel tells always the same number of results. The order of reading is that of statements: no two in one. */
#ifndef KERNELS_LIST_H
#define KERNELS_LIST_H

/* A device gets a group of kernels at a time, -DKT_GROUP=n; the host has them all. */
#ifdef KT_GROUP
#define KT_IN_GROUP(group) (KT_GROUP == group)
#else
#define KT_IN_GROUP(group) 1
#endif
#define KT_GROUPS 8

#define KT_ALL 0xffffffffu /* features */

/* ---- records among the inputs, word by word as they lie in buffers */

KT_READER(hyk_ray, ray) {
    hyk_ray r;
    r.origin = KT_GET(vec3);
    r.t_min = KT_GET(exact);
    r.direction = KT_GET(vec3);
    r.t_max = KT_GET(exact);
    return r;
}

KT_READER(hyk_light, light) {
    hyk_light l;
    l.position = KT_GET(vec3);
    l.area = KT_GET(real);
    l.axis_u = KT_GET(vec3);
    l.radius = KT_GET(real);
    l.axis_v = KT_GET(vec3);
    l.cos_outer = KT_GET(real);
    l.normal = KT_GET(vec3);
    l.cos_inner = KT_GET(real);
    l.radiance = KT_GET(vec3);
    l.kind = KT_GET(uint);
    l.flags = KT_GET(uint);
    l.instance = KT_GET(uint);
    l.primitive = KT_GET(uint);
    l.tree_path = KT_GET(uint);
    return l;
}

KT_READER(hyk_camera, camera) {
    hyk_camera c;
    c.position = KT_GET(vec3);
    c.kind = KT_GET(uint);
    c.right = KT_GET(vec3);
    c.half_width = KT_GET(real);
    c.up = KT_GET(vec3);
    c.half_height = KT_GET(real);
    c.forward = KT_GET(vec3);
    c.lens_radius = KT_GET(real);
    c.focus_distance = KT_GET(real);
    c.shift_x = KT_GET(real);
    c.shift_y = KT_GET(real);
    c.filter_kind = KT_GET(uint);
    c.width = KT_GET(uint);
    c.height = KT_GET(uint);
    c.spread = KT_GET(real);
    c.start_width = KT_GET(real);
    return c;
}

KT_READER(hyk_sampler, sampler) {
    hyk_sampler s;
    s.pixel = KT_GET(uint);
    s.index = KT_GET(uint);
    s.seed = KT_GET(uint);
    return s;
}

KT_READER(hyk_path, path) {
    hyk_path p;
    p.ray.origin = KT_GET(vec3);
    p.ray.t_min = 0.0f;
    p.ray.direction = KT_GET(vec3);
    p.ray.t_max = HYK_REAL_MAX;
    p.throughput = KT_GET(vec3);
    p.pdf = KT_GET(real);
    p.normal = KT_GET(vec3);
    p.flags = KT_GET(uint);
    p.irradiance = KT_GET(vec3);
    p.depth_left = KT_GET(uint);
    p.random = KT_GET(sampler);
    p.bounce = KT_GET(uint);
    p.cone_width = KT_GET(real);
    p.cone_spread = KT_GET(real);
    p.unused3 = 0u;
    p.unused4 = 0u;
    p.vertex = KT_GET(vec3);
    p.eta_scale = KT_GET(real);
    p.lane = 0u;
    p.unused0 = 0u;
    p.unused1 = 0u;
    p.unused2 = 0u;
    return p;
}

KT_READER(hyk_hit, hit) {
    hyk_hit h;
    h.t = KT_GET(real);
    h.u = KT_GET(real);
    h.v = KT_GET(real);
    h.instance = KT_GET(uint);
    h.primitive = KT_GET(uint);
    return h;
}

KT_READER(hyk_bool, flag) { return KT_GET(uint) != 0u; }

#define KT_FLAG(x) KT_UINT((x) ? 1u : 0u)
#define KT_BITS(x) KT_UINT(hyk_float_bits(HYK_TO_FLOAT(x))) /* a real that must agree to the bit */
#define KT_SIZE3(x) hyk_max3(hyk_abs3(x))

#include "kernels_plain.h"
#include "kernels_seeing.h"

/* A vertex of a path, which a device computes with its own kernel for it, shade.comp. */
#define KT_SHADE(X) X(shade)
#ifndef HYK_GLSL
KT_KERNEL(shade) {
    hyk_path path = KT_GET(path);
    hyk_hit hit = KT_GET(hit);
    hyk_path_settings settings;
    settings.strategy = HYK_STRATEGY_MIS;
    settings.wants = HYK_WANTS_COMPONENTS | HYK_WANTS_IRRADIANCE | HYK_WANTS_SURFACE;
    hyk_scatter r = hyk_shade(KT_VIEW, settings, path, hit, KT_ALL);
    bool shadow = (r.flags & HYK_SCATTER_SHADOW) != 0u, goes_on = (r.flags & HYK_SCATTER_CONTINUES) != 0u;
    bool surface = (r.flags & HYK_SCATTER_SURFACE) != 0u;
    hyk_vec3 none = hyk_zero3();
    KT_UINT(hyk_is_black(r.emitted) ? 0u : r.emitted_component);
    KT_FLAG((r.flags & HYK_SCATTER_INSIDE) != 0u);
    KT_FLAG(shadow);
    KT_UINT(shadow ? r.diffuse_component : 0u);
    KT_UINT(shadow ? r.specular_component : 0u);
    KT_FLAG(goes_on);
    KT_UINT(goes_on ? r.next.flags : 0u);
    KT_UINT(goes_on ? r.next.depth_left : 0u);
    KT_UINT(goes_on ? r.next.bounce : 0u);
    KT_FLAG(surface);
    KT_UINT(surface ? r.first.material : 0u);
    KT_SCALE(0.0009765625f);
    KT_VEC3(r.emitted);
    KT_VEC3(r.emitted_irradiance);
    KT_VEC3(shadow ? r.diffuse : none);
    KT_VEC3(shadow ? r.specular : none);
    KT_VEC3(shadow ? r.light_irradiance : none);
    KT_SCALE(1.0f);
    KT_VEC3(shadow ? r.shadow.origin : none);
    KT_VEC3(shadow ? r.shadow.direction : none);
    KT_REAL(shadow ? r.shadow.t_max : 0.0f);
    KT_VEC3(goes_on ? r.next.ray.origin : none);
    KT_VEC3(goes_on ? r.next.ray.direction : none);
    KT_VEC3(goes_on ? r.next.throughput : none);
    KT_REAL(goes_on ? r.next.pdf : 0.0f);
    KT_VEC3(goes_on ? r.next.irradiance : none);
    KT_VEC3(goes_on ? r.next.normal : none);
    KT_REAL(goes_on ? r.next.eta_scale : 0.0f);
    KT_REAL(goes_on ? r.next.cone_width : 0.0f);
    KT_REAL(goes_on ? r.next.cone_spread : 0.0f);
    KT_VEC3(surface ? r.first.albedo : none);
    KT_VEC3(surface ? r.first.normal : none);
    KT_VEC3(surface ? r.first.position : none);
}
#endif

#define KT_LIST(X) KT_SHADE(X) KT_VECTOR(X) KT_WHOLE(X) KT_WARPS(X) KT_OPTICS(X) KT_IMAGES(X) KT_BSDF(X) KT_LIGHTS(X) KT_PATHS(X)

#endif /* KERNELS_LIST_H */
