/* >>shared-film: a film on a device: the records of render/film.h, and what the passes over it are told

   Pixels, sums and ids have the bytes that they have on the host, so a film goes up and down as it is. */
#ifndef HYK_FILM_H
#define HYK_FILM_H

#include "passes.h"
#include "sums.h"

/* hyi_pixel: of rgb the first three are those of even samples. */
HYK_STRUCT(hyk_pixel) {
    hyk_lanes rgb[6];
    hyk_lanes square;
    hyk_uint rgb_tops;    /* 16 bits each */
    hyk_uint square_top;  /* and in the upper half the samples that were dropped */
    hyk_uint largest;     /* bits of a float, which is not negative */
    hyk_uint hits;
} HYK_END(hyk_pixel)
HYK_SIZE_IS(hyk_pixel, 128)

/* hyi_ids. */
HYK_STRUCT(hyk_ids) {
    hyk_uint primitive, instance, mesh, material;
} HYK_END(hyk_ids)
HYK_SIZE_IS(hyk_ids, 16)

/* Of a placed instance: what ids are made of. */
HYK_STRUCT(hyk_placed_ids) {
    hyk_uint instance, mesh;
} HYK_END(hyk_placed_ids)
HYK_SIZE_IS(hyk_placed_ids, 8)

/* Of a unit, what its film must know. The units of one tile in a batch are a list, which the invocations of its first
   one go through: so each pixel has one invocation that writes it. */
HYK_STRUCT(hyk_film_unit) {
    hyk_uint tile;
    hyk_uint open;  /* groups of pixels that still count samples: a bit each */
    hyk_uint next;  /* HYK_NONE: the last of its tile */
    hyk_uint flags; /* HYK_FILM_... */
} HYK_END(hyk_film_unit)
HYK_SIZE_IS(hyk_film_unit, 16)

#define HYK_FILM_FIRST 1u /* of its tile in the batch */
#define HYK_FILM_IDS 2u   /* its first samples tell the ids */

#define HYK_FILM_GROUPS 16u

/* Of a tile, what its pixels' values are made with. */
HYK_STRUCT(hyk_film_tile) {
    hyk_uint taken;
    hyk_uint reported[HYK_FILM_GROUPS];
} HYK_END(hyk_film_tile)
HYK_SIZE_IS(hyk_film_tile, 68)

/* hyi_plane; the first four are pairs: half after half. */
#define HYK_PLANE_DIRECT 0
#define HYK_PLANE_INDIRECT 1
#define HYK_PLANE_CAUSTIC 2
#define HYK_PLANE_IRRADIANCE 3
#define HYK_PLANE_ALBEDO 4
#define HYK_PLANE_NORMAL 5
#define HYK_PLANE_POSITION 6
#define HYK_PLANE_DEPTH 7
#define HYK_PLANES 8
#define HYK_FILM_HAS_IDS 256u /* beside bits 1 << HYK_PLANE_... */

/* Buffers of both kernels, set 0. */
#define HYK_BINDING_FILM_PICTURE 0
#define HYK_BINDING_FILM_UNITS 1 /* hyk_unit */
#define HYK_BINDING_FILM_CHAINS 2 /* hyk_film_unit */
#define HYK_BINDING_FILM_RADIANCE 3
#define HYK_BINDING_FILM_EXTRAS 4
#define HYK_BINDING_FILM_PIXELS 5
#define HYK_BINDING_FILM_PLANES 6 /* and the following */
#define HYK_BINDING_FILM_IDS 14
#define HYK_BINDING_FILM_PLACED 15
#define HYK_BINDING_FILM_TILES 16
#define HYK_BINDING_FILM_OUT 17 /* accumulate: a double for each pixel of each unit; resolve: what is asked for */
#define HYK_FILM_BINDINGS 18

/* What resolve.comp is asked for; values of hydra_output, and one of its own. */
#define HYK_RESOLVE_RADIANCE 0u
#define HYK_RESOLVE_DIRECT 2u
#define HYK_RESOLVE_INDIRECT 3u
#define HYK_RESOLVE_CAUSTIC 4u
#define HYK_RESOLVE_IRRADIANCE 5u
#define HYK_RESOLVE_ALBEDO 6u
#define HYK_RESOLVE_NORMAL 7u
#define HYK_RESOLVE_POSITION 8u
#define HYK_RESOLVE_DEPTH 9u
#define HYK_RESOLVE_COVERAGE 10u
#define HYK_RESOLVE_PRIMITIVE_ID 11u
#define HYK_RESOLVE_INSTANCE_ID 12u
#define HYK_RESOLVE_MESH_ID 13u
#define HYK_RESOLVE_MATERIAL_ID 14u
#define HYK_RESOLVE_SAMPLES 15u
#define HYK_RESOLVE_LUMINANCE 32u /* a double for each pixel of the film, in the film's order */

/* Push constants of both. */
HYK_STRUCT(hyk_film_call) {
    hyk_uint count;         /* accumulate: units; resolve: values */
    hyk_uint lanes_of_unit;
    hyk_uint asked;         /* HYK_RESOLVE_... */
    hyk_uint points;        /* 1: the sensor is a list of points */
    hyk_real factor0, factor1, factor2; /* by channel, to what a lightmap means */
    hyk_uint unused;
} HYK_END(hyk_film_call)
HYK_SIZE_IS(hyk_film_call, 32)

/* ---- where a pixel stands */

HYK_FN hyk_uint hyk_film_tile_height(hyk_picture picture) { return picture.tile_pixels / picture.tile_width; }

/* Of pixel (x, y) of the frame, which is in the picture. */
HYK_FN hyk_uint hyk_film_tile_of(hyk_picture picture, hyk_uint x, hyk_uint y) {
    hyk_uint height = hyk_film_tile_height(picture), first = picture.left / picture.tile_width;
    hyk_uint tiles_x = (picture.right - 1u) / picture.tile_width - first + 1u;
    return (y / height - picture.top / height) * tiles_x + (x / picture.tile_width - first);
}
HYK_FN hyk_uint hyk_film_index_of(hyk_picture picture, hyk_uint x, hyk_uint y) {
    hyk_uint column = x % picture.tile_width, row = y % hyk_film_tile_height(picture);
    hyk_uint place = picture.tile_is_square != 0u ? hyk_morton(column, row) : row * picture.tile_width + column;
    return hyk_film_tile_of(picture, x, y) * picture.tile_pixels + place;
}

#endif /* HYK_FILM_H */
