#version 460
#extension GL_GOOGLE_include_directive : require
/* Rays, their trees fetched as texels: on lavapipe by gathers instead of a loop over lanes, which makes rays a third
   faster there. */
#include "passes.glsl"
#include "tree.h"

#define HYK_RUNS_OF_GROUPS /* lavapipe's threads share a dispatch evenly before it begins */
layout(set = 0, binding = HYK_BINDING_NODE_TEXELS) uniform utextureBuffer hyk_nodes;
layout(set = 0, binding = HYK_BINDING_SLOT_TEXELS) uniform textureBuffer hyk_slots;
uvec4 hyk_node_words(uint i) { return texelFetch(hyk_nodes, int(i)); }
hyk_slot hyk_slot_at(uint i) {
    vec4 a = texelFetch(hyk_slots, int(3u * i)), b = texelFetch(hyk_slots, int(3u * i + 1u)), c = texelFetch(hyk_slots, int(3u * i + 2u));
    return hyk_slot(a.xyz, floatBitsToUint(a.w), b.xyz, 0u, c.xyz, 0u);
}
#include "trace.glsl"
