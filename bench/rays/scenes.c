/* Scenes made of code. Each is of one nature at any number of triangles: more of them means more and finer detail in the
   same space. */
#include "rays.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

const char *const scene_kinds[4] = {"smooth", "thin", "clustered", "foliage"};

static const float two_pi = 6.28318531f;

static float between(float low, float high, uint32_t seed, uint32_t i) { return low + (high - low) * hash_float(seed, i); }

/* Uniform on the unit sphere. */
static void set_direction(float out[3], uint32_t seed, uint32_t i) {
    float z = between(-1.0f, 1.0f, seed, 2 * i), phi = between(0.0f, two_pi, seed, 2 * i + 1), s = sqrtf(fmaxf(0.0f, 1.0f - z * z));
    out[0] = s * cosf(phi), out[1] = z, out[2] = s * sinf(phi);
}

static void set_cross(float out[3], const float a[3], const float b[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* Two unit vectors across a unit vector. */
static void set_across(float u[3], float v[3], const float n[3]) {
    const float x[3] = {1, 0, 0}, y[3] = {0, 1, 0};
    set_cross(u, n, fabsf(n[0]) < 0.7f ? x : y);
    float length = sqrtf(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
    for (int k = 0; k < 3; k++) u[k] /= length;
    set_cross(v, n, u);
}

static void add_quad(maker *m, const float corner[3], const float u[3], const float v[3]) {
    uint32_t a = maker_vertex(m, corner[0], corner[1], corner[2]);
    maker_vertex(m, corner[0] + u[0], corner[1] + u[1], corner[2] + u[2]);
    maker_vertex(m, corner[0] + u[0] + v[0], corner[1] + u[1] + v[1], corner[2] + u[2] + v[2]);
    maker_vertex(m, corner[0] + v[0], corner[1] + v[1], corner[2] + v[2]);
    maker_triangle(m, a, a + 1, a + 2);
    maker_triangle(m, a, a + 2, a + 3);
}

/* A box from its middle and three half axes: 12 triangles. */
static void add_box(maker *m, const float middle[3], const float u[3], const float v[3], const float w[3]) {
    static const uint8_t sides[6][4] = {{0, 1, 3, 2}, {4, 6, 7, 5}, {0, 4, 5, 1}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 5, 7, 3}};
    uint32_t first = (uint32_t)m->vertices;
    for (int i = 0; i < 8; i++) {
        float p[3], a = i & 1 ? 1.0f : -1.0f, b = i & 2 ? 1.0f : -1.0f, c = i & 4 ? 1.0f : -1.0f;
        for (int k = 0; k < 3; k++) p[k] = middle[k] + a * u[k] + b * v[k] + c * w[k];
        maker_vertex(m, p[0], p[1], p[2]);
    }
    for (int i = 0; i < 6; i++) {
        maker_triangle(m, first + sides[i][0], first + sides[i][1], first + sides[i][2]);
        maker_triangle(m, first + sides[i][0], first + sides[i][2], first + sides[i][3]);
    }
}

static void add_room(maker *m, float x, float y, float z) { /* half sizes; stands on y = 0 */
    const float middle[3] = {0, y, 0}, u[3] = {x, 0, 0}, v[3] = {0, y, 0}, w[3] = {0, 0, z};
    add_box(m, middle, u, v, w);
}

/* A closed ball with bumps: 4 rings^2 triangles (less the two in rings that have no area at the poles). */
static void add_ball(maker *m, const float middle[3], float radius, uint32_t rings, float bump, float phase) {
    uint32_t steps = 2 * rings, first = (uint32_t)m->vertices;
    for (uint32_t r = 0; r <= rings; r++)
        for (uint32_t s = 0; s < steps; s++) {
            float theta = 0.5f * two_pi * (float)r / (float)rings, phi = two_pi * (float)s / (float)steps;
            float n[3] = {sinf(theta) * cosf(phi), cosf(theta), sinf(theta) * sinf(phi)};
            if (r == 0 || r == rings) n[0] = n[2] = 0.0f;
            float waves = sinf(7.0f * n[0] + phase) * sinf(6.0f * n[1] + 2.0f * phase) * sinf(8.0f * n[2]) +
                          0.3f * sinf(31.0f * n[0]) * sinf(29.0f * n[1] + phase) * sinf(33.0f * n[2]);
            float length = radius * (1.0f + bump * waves);
            maker_vertex(m, middle[0] + length * n[0], middle[1] + length * n[1], middle[2] + length * n[2]);
        }
    for (uint32_t r = 0; r < rings; r++)
        for (uint32_t s = 0; s < steps; s++) {
            uint32_t a = first + r * steps + s, b = first + r * steps + (s + 1) % steps;
            if (r > 0) maker_triangle(m, a, b, a + steps);
            if (r + 1 < rings) maker_triangle(m, b, b + steps, a + steps);
        }
}

static uint32_t rings_for(size_t triangles) {
    uint32_t rings = (uint32_t)sqrt((double)triangles / 4.0);
    return rings < 3 ? 3 : rings;
}

static void place(geometry *g, const float eye[3], const float look[3], const float light[3]) {
    memcpy(g->eye, eye, sizeof g->eye);
    memcpy(g->look, look, sizeof g->look);
    memcpy(g->light, light, sizeof g->light);
}

/* A large bumpy ball seen from inside: triangles of like size, no empty space to tell apart. */
static void make_smooth(geometry *g, maker *m, size_t triangles) {
    const float middle[3] = {0, 0, 0}, eye[3] = {-4, 1, 2}, look[3] = {5, -1, -3}, light[3] = {2, 5, -3};
    add_ball(m, middle, 10.0f, rings_for(triangles), 0.15f, 0.7f);
    place(g, eye, look, light);
}

/* A stack of slats like those of a blind, turned any way. */
static void add_slats(maker *m, uint32_t stack, uint32_t slats, float scale) {
    float along[3], across[3], up[3], u[3], v[3], w[3];
    set_direction(along, 50, stack);
    set_across(across, up, along);
    float half = scale * between(0.6f, 1.4f, 51, stack);
    float base[3] = {between(-5.5f, 5.5f, 52, stack), between(0.3f, 3.7f, 53, stack), between(-3.5f, 3.5f, 54, stack)};
    for (int k = 0; k < 3; k++) u[k] = half * along[k], v[k] = 0.02f * scale * across[k], w[k] = 0.001f * scale * up[k];
    for (uint32_t i = 0; i < slats; i++) {
        float middle[3];
        for (int k = 0; k < 3; k++) middle[k] = base[k] + 0.03f * scale * (float)i * (up[k] + 0.5f * across[k]);
        add_box(m, middle, u, v, w);
    }
}

/* A hair: a narrow strip that winds upwards (or hangs), 16 triangles. */
static void add_hair(maker *m, uint32_t hair, float length, float width) {
    enum { segments = 8 };
    float at[3] = {between(-5.8f, 5.8f, 60, hair), hair & 1 ? 0.0f : 4.0f, between(-3.8f, 3.8f, 61, hair)};
    float rise = (hair & 1 ? 1.0f : -1.0f) * length / segments, turn = between(0.0f, two_pi, 62, hair),
          lean = between(0.1f, 0.7f, 63, hair);
    uint32_t first = (uint32_t)m->vertices;
    for (uint32_t s = 0; s <= segments; s++) {
        float half = 0.5f * width * (1.0f - 0.8f * (float)s / segments);
        maker_vertex(m, at[0] - half * sinf(turn), at[1], at[2] + half * cosf(turn));
        maker_vertex(m, at[0] + half * sinf(turn), at[1], at[2] - half * cosf(turn));
        at[0] += lean * fabsf(rise) * cosf(turn), at[1] += rise, at[2] += lean * fabsf(rise) * sinf(turn);
        turn += 0.4f;
    }
    for (uint32_t s = 0; s < segments; s++) {
        uint32_t a = first + 2 * s;
        maker_triangle(m, a, a + 1, a + 3);
        maker_triangle(m, a, a + 3, a + 2);
    }
}

/* A room of six walls, two triangles each, full of blinds, hairs and a few finely made balls. */
static void make_thin(geometry *g, maker *m, size_t triangles) {
    const float eye[3] = {-5.2f, 2.1f, -3.1f}, look[3] = {3, 1.6f, 2}, light[3] = {0, 3.6f, 0};
    float scale = cbrtf(10000.0f / (float)triangles);
    uint32_t slats = 24, stacks = (uint32_t)(triangles * 2 / 5 / (12 * slats)), hairs = (uint32_t)(triangles * 2 / 5 / 16), balls = 12;
    add_room(m, 6, 2, 4);
    for (uint32_t i = 0; i < stacks; i++) add_slats(m, i, slats, scale);
    for (uint32_t i = 0; i < hairs; i++) add_hair(m, i, 1.2f * sqrtf(scale), 0.01f * scale);
    for (uint32_t i = 0; i < balls; i++) {
        float radius = between(0.1f, 0.35f, 70, i), middle[3] = {between(-5, 5, 71, i), between(0.4f, 2.5f, 72, i), between(-3, 3, 73, i)};
        add_ball(m, middle, radius, rings_for(triangles / 5 / balls), 0.2f, (float)i);
    }
    place(g, eye, look, light);
}

/* Tiers around an arena, four long quads each step. */
static void add_tiers(maker *m, uint32_t steps) {
    for (uint32_t i = 0; i < steps; i++)
        for (int side = 0; side < 4; side++) {
            float d = 60.0f + 1.5f * (float)i, y = 0.8f * (float)i, sx = side == 1 ? -1.0f : 1.0f, sz = side == 3 ? -1.0f : 1.0f;
            bool x = side < 2;
            float corner[3] = {x ? sx * d : -d, y, x ? -d : sz * d}, along[3] = {x ? 0 : 2 * d, 0, x ? 2 * d : 0};
            float up[3] = {0, 0.8f, 0}, deep[3] = {x ? sx * 1.5f : 0, 0, x ? 0 : sz * 1.5f};
            add_quad(m, corner, along, up);
            corner[1] += 0.8f;
            add_quad(m, corner, along, deep);
        }
}

/* A stadium with groups of small, finely made things standing about in it. */
static void make_clustered(geometry *g, maker *m, size_t triangles) {
    const float eye[3] = {-2, 3.5f, -9}, look[3] = {0.5f, 1.5f, 0}, light[3] = {15, 45, -10};
    uint32_t objects = (uint32_t)(triangles / 3000), group = 16;
    if (objects < 12) objects = 12;
    add_room(m, 110, 30, 110);
    add_tiers(m, 30);
    for (uint32_t i = 0; i < objects; i++) {
        uint32_t c = i / group;
        float reach = c ? 45.0f : 2.0f, spread = 3.5f, radius = between(0.2f, 1.1f, 80, i);
        float middle[3] = {reach * between(-1, 1, 81, c) + spread * between(-1, 1, 83, i),
                           radius + between(0, 4, 85, i) * hash_float(86, i),
                           reach * between(-1, 1, 82, c) + spread * between(-1, 1, 84, i)};
        add_ball(m, middle, radius, rings_for(triangles / objects), 0.35f, (float)i);
    }
    place(g, eye, look, light);
}

/* A tree: a trunk, and leaves turned any way, more of them outside than inside the crown. */
static void add_tree(maker *m, uint32_t tree, uint32_t leaves, float crown) {
    float foot[3] = {between(-16, 16, 90, tree), 0, between(-16, 16, 91, tree)}, height = between(4, 6, 92, tree);
    const float u[3] = {0.2f, 0, 0}, w[3] = {0, 0, 0.2f};
    float middle[3] = {foot[0], 0.5f * height, foot[2]}, v[3] = {0, 0.5f * height, 0};
    add_box(m, middle, u, v, w);
    float leaf = sqrtf(25.0f * crown * crown / (float)leaves);
    for (uint32_t i = 0; i < leaves; i++) {
        uint32_t id = tree * 1000003u + i;
        float out[3], normal[3], a[3], b[3], corner[3], r = crown * sqrtf(hash_float(93, id)), size = leaf * between(0.6f, 1.4f, 94, id);
        set_direction(out, 95, id);
        set_direction(normal, 96, id);
        set_across(a, b, normal);
        for (int k = 0; k < 3; k++) {
            corner[k] = foot[k] + (k == 1 ? height : 0.0f) + r * out[k];
            a[k] *= size, b[k] *= 0.5f * size;
        }
        add_quad(m, corner, a, b);
    }
}

static void make_foliage(geometry *g, maker *m, size_t triangles) {
    const float eye[3] = {-15, 2.2f, -13}, look[3] = {2, 4, 2}, light[3] = {20, 40, -15};
    const float corner[3] = {-40, 0, -40}, u[3] = {0, 0, 80}, v[3] = {80, 0, 0};
    uint32_t trees = 16, leaves = (uint32_t)(triangles / 2 / trees);
    add_quad(m, corner, u, v);
    for (uint32_t i = 0; i < trees; i++) add_tree(m, i, leaves, between(2.2f, 3.6f, 97, i));
    place(g, eye, look, light);
}

void geometry_generate(geometry *g, int scene_kind, size_t triangles) {
    static void (*const make[4])(geometry *, maker *, size_t) = {make_smooth, make_thin, make_clustered, make_foliage};
    maker m = {.vertices = 0};
    memset(g, 0, sizeof *g);
    make[scene_kind](g, &m, triangles);
    maker_finish(&m, g);
    if (triangles >= 1000000)
        snprintf(g->name, sizeof g->name, "%s-%zum", scene_kinds[scene_kind], triangles / 1000000);
    else
        snprintf(g->name, sizeof g->name, "%s-%zuk", scene_kinds[scene_kind], triangles / 1000);
}
