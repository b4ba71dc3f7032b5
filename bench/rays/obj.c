/* Triangles of a Wavefront OBJ file: v and f lines, polygons as fans. Nothing else in the file matters to rays. */
#include "rays.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void read_vertex(char *line, maker *m) {
    float p[3];
    for (int i = 0; i < 3; i++) p[i] = strtof(line, &line);
    maker_vertex(m, p[0], p[1], p[2]);
}

/* Corners are v, v/vt, v//vn or v/vt/vn; negative numbers count from the last vertex back. */
static void read_face(const char *at, maker *m) {
    uint32_t corner[3] = {0, 0, 0};
    for (int corners = 0; *at; corners++) {
        char *end;
        long index = strtol(at, &end, 10);
        if (end == at) return;
        index = index < 0 ? (long)m->vertices + index : index - 1;
        if (index < 0 || index >= (long)m->vertices) bench_stop("obj", "a face names a vertex that is not there");
        corner[corners < 2 ? corners : 2] = (uint32_t)index;
        if (corners >= 2) {
            maker_triangle(m, corner[0], corner[1], corner[2]);
            corner[1] = corner[2];
        }
        at = end + strcspn(end, " \t\r\n");
        at += strspn(at, " \t\r\n");
    }
}

static void read_line(char *line, maker *m) {
    if (line[1] != ' ' && line[1] != '\t') return;
    if (line[0] == 'v') read_vertex(line + 2, m);
    if (line[0] == 'f') read_face(line + 2 + strspn(line + 2, " \t"), m);
}

/* After the file, or its folder where the file is called scene.obj. */
static void name_after(geometry *g, const char *path) {
    const char *slash = strrchr(path, '/'), *base = slash ? slash + 1 : path;
    if (!strcmp(base, "scene.obj") && slash > path)
        for (base = slash; base > path && base[-1] != '/';) base--;
    snprintf(g->name, sizeof g->name, "%.*s", (int)strcspn(base, "./"), base);
}

/* Inside, a quarter of the way along the longer horizontal side, looking along it: most files are interiors. */
static void place_camera(geometry *g) {
    const float *low = g->bounds[0], *high = g->bounds[1];
    int along = high[0] - low[0] >= high[2] - low[2] ? 0 : 2;
    for (int i = 0; i < 3; i++) g->eye[i] = g->look[i] = g->light[i] = 0.5f * (low[i] + high[i]);
    g->eye[1] = g->look[1] = low[1] + 0.3f * (high[1] - low[1]);
    g->light[1] = low[1] + 0.8f * (high[1] - low[1]);
    g->eye[along] = low[along] + 0.25f * (high[along] - low[along]);
    if (!strcmp(g->name, "sponza")) { /* the view that shared/scenes/sponza/scene.json suggests */
        const float eye[3] = {-1200, 180, -40}, look[3] = {0, 180, -40}, light[3] = {-100, 1300, -40};
        memcpy(g->eye, eye, sizeof eye);
        memcpy(g->look, look, sizeof look);
        memcpy(g->light, light, sizeof light);
    }
}

bool geometry_read_obj(geometry *g, const char *path) {
    memset(g, 0, sizeof *g);
    FILE *file = fopen(path, "rb");
    if (!file) return false;
    maker m = {.vertices = 0};
    char line[4096];
    while (fgets(line, sizeof line, file)) read_line(line, &m);
    fclose(file);
    maker_finish(&m, g);
    name_after(g, path);
    place_camera(g);
    return g->triangles > 0;
}
