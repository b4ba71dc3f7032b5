#version 460
#extension GL_GOOGLE_include_directive : require
/* Rays, their trees in storage buffers. */
#include "passes.glsl"
#include "tree.h"

layout(std430, set = 0, binding = HYK_BINDING_NODES) readonly buffer hyk_nodes_buffer { uvec4 hyk_nodes[]; };
layout(std430, set = 0, binding = HYK_BINDING_SLOTS) readonly buffer hyk_slots_buffer { hyk_slot hyk_slots[]; };
uvec4 hyk_node_words(uint i) { return hyk_nodes[i]; }
hyk_slot hyk_slot_at(uint i) {
    hyk_slot slot = hyk_slots[i];
    return slot;
}
#include "trace.glsl"
