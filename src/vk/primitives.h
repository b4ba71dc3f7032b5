/* >>vk-primitives: prefix sums, compaction and sorting of arrays on the device

   Each is made once for its buffers and recorded as often as wanted. The count of elements is a word in a buffer of the
   device, which the host need not know; a count above the capacity is cut to it. Arrays have room for a capacity rounded
   up to a multiple of four; words from the count on are read, not written, and mean nothing.
       Bytes moved, an element: 12 for prefix sums, 8 to 12 for compaction, 20 for each digit of a sort.
   What is recorded stands between other passes: all before it is behind a barrier, and it ends with one. It leaves set 1
   and the push constants changed; set 0 stays bound. A recording uses memory of its object, so two command buffers with
   one object must not run at the same time. */
#ifndef HYI_VK_PRIMITIVES_H
#define HYI_VK_PRIMITIVES_H

#include "../../shaders/shared/scan.h"
#include "submit.h"

/* A word of a buffer. */
typedef struct hyi_vk_word {
    const hyi_vk_buffer *buffer;
    uint32_t at; /* in words */
} hyi_vk_word;

typedef struct hyi_vk_scan {
    hyi_vk_set set;
    hyi_vk_buffer plan, sums;
    VkPipeline divide, reduce, parts, apply;
    hyk_scan_call call;
} hyi_vk_scan;

/* Digits lie between the caller's buffers and others in turn; after an even number of them they are in the caller's. */
typedef struct hyi_vk_sort {
    hyi_vk_set sets[2]; /* from the caller's buffers to the others, and back */
    hyi_vk_buffer plan, sums, keys, values;
    VkPipeline divide, count, parts, scatter;
    hyk_scan_call call;
    uint32_t first_bit, bits;
} hyi_vk_sort;

HYI_STATIC_ASSERT(HYK_SCAN_BINDINGS <= HYK_PASS_BINDINGS);
HYI_STATIC_ASSERT(sizeof(hyk_scan_call) == sizeof(hyk_dispatch));

/* ---- creation */

HYI_FN hydra_result hyi_vk_scan_pipeline(hyi_vk *vk, hyi_vk_kernel kernel, uint32_t mode, VkPipeline *pipeline) {
    hyi_vk_shape shape;
    memset(&shape, 0, sizeof shape);
    shape.mode = mode;
    return hyi_vk_get_pipeline(vk, kernel, &shape, pipeline);
}

/* words: of sums. */
HYI_FN hydra_result hyi_vk_make_scan_memory(hyi_vk *vk, hyi_vk_buffer *plan, hyi_vk_buffer *sums, uint32_t words) {
    HYI_TRY(hyi_vk_make_buffer(vk, plan, HYI_VK_DEVICE, sizeof(hyk_scan_plan), "the plan of a scan"));
    return hyi_vk_make_buffer(vk, sums, HYI_VK_DEVICE, words * sizeof(uint32_t), "the sums of a scan");
}

/* Two arrays, which kernels read by fours, and a count. */
HYI_FN hydra_result hyi_vk_check_scan(hyi_vk *vk, const hyi_vk_buffer *in, const hyi_vk_buffer *out, hyi_vk_word count, uint32_t capacity) {
    VkDeviceSize room = in->size < out->size ? in->size : out->size;
    if (capacity > HYK_SCAN_MOST)
        return hyi_fail(vk->context, HYDRA_ERROR_DEVICE_LIMIT, "%u elements to scan, %u are the most", capacity, HYK_SCAN_MOST);
    if (((VkDeviceSize)capacity + 3) / 4 * 16 > room)
        return hyi_fail(vk->context, HYDRA_ERROR_BUFFER, "%u elements to scan, by fours, in %llu bytes", capacity,
                        (unsigned long long)room);
    if (4 * ((VkDeviceSize)count.at + 1) > count.buffer->size) return hyi_vk_fail(vk, HYDRA_ERROR_BUFFER, "the count of a scan");
    return HYDRA_OK;
}

HYI_FN void hyi_vk_free_scan(hyi_vk *vk, hyi_vk_scan *s) {
    hyi_vk_free_set(vk, &s->set);
    hyi_vk_free_buffer(vk, &s->plan);
    hyi_vk_free_buffer(vk, &s->sums);
    memset(s, 0, sizeof *s);
}

HYI_FN hydra_result hyi_vk_make_scan_pipelines(hyi_vk *vk, hyi_vk_scan *s, uint32_t mode) {
    HYI_TRY(hyi_vk_scan_pipeline(vk, HYI_VK_KERNEL_scan_plan, HYK_SCAN_SUMS, &s->divide));
    HYI_TRY(hyi_vk_scan_pipeline(vk, HYI_VK_KERNEL_scan_reduce, mode, &s->reduce));
    HYI_TRY(hyi_vk_scan_pipeline(vk, HYI_VK_KERNEL_scan_parts, HYK_SCAN_SUMS, &s->parts));
    return hyi_vk_scan_pipeline(vk, HYI_VK_KERNEL_scan_apply, mode, &s->apply);
}

/* s is all zero; what was made before a failure is freed by hyi_vk_free_scan. mode: HYK_SCAN_SUMS, where in and out may
   be one buffer, or HYK_SCAN_INDICES. total gets the sum of all, or the count of indices; its buffer may be count's, or
   NULL. */
HYI_FN hydra_result hyi_vk_make_scan(hyi_vk *vk, hyi_vk_scan *s, uint32_t mode, const hyi_vk_buffer *in, const hyi_vk_buffer *out,
                                     hyi_vk_word count, hyi_vk_word total, uint32_t capacity) {
    hyi_vk_buffer bound[HYK_SCAN_BINDINGS];
    HYI_TRY(hyi_vk_check_scan(vk, in, out, count, capacity));
    HYI_TRY(hyi_vk_make_scan_memory(vk, &s->plan, &s->sums, HYK_SCAN_PARTS + 1));
    HYI_TRY(hyi_vk_make_scan_pipelines(vk, s, mode));
    HYI_TRY(hyi_vk_make_set(vk, vk->pass_layout, HYK_PASS_BINDINGS, 0, &s->set));
    bound[HYK_BINDING_SCAN_IN] = bound[HYK_BINDING_SCAN_VALUES_IN] = *in; /* the values are bound, not used */
    bound[HYK_BINDING_SCAN_OUT] = bound[HYK_BINDING_SCAN_VALUES_OUT] = *out;
    bound[HYK_BINDING_SCAN_COUNT] = *count.buffer;
    bound[HYK_BINDING_SCAN_TOTAL] = total.buffer ? *total.buffer : s->sums;
    bound[HYK_BINDING_SCAN_PLAN] = s->plan;
    bound[HYK_BINDING_SCAN_SUMS] = s->sums;
    hyi_vk_write_set(vk, &s->set, bound, HYK_SCAN_BINDINGS);
    s->call.capacity = capacity;
    s->call.count_at = count.at;
    s->call.total_at = total.buffer ? total.at : HYK_SCAN_PARTS;
    return HYDRA_OK;
}

HYI_FN void hyi_vk_free_sort(hyi_vk *vk, hyi_vk_sort *s) {
    hyi_vk_free_set(vk, &s->sets[0]);
    hyi_vk_free_set(vk, &s->sets[1]);
    hyi_vk_free_buffer(vk, &s->plan);
    hyi_vk_free_buffer(vk, &s->sums);
    hyi_vk_free_buffer(vk, &s->keys);
    hyi_vk_free_buffer(vk, &s->values);
    memset(s, 0, sizeof *s);
}

/* way 0: from the caller's buffers; 1: back to them. */
HYI_FN hydra_result hyi_vk_make_sort_set(hyi_vk *vk, hyi_vk_sort *s, const hyi_vk_buffer *keys, const hyi_vk_buffer *values,
                                         const hyi_vk_buffer *count, uint32_t way) {
    hyi_vk_buffer bound[HYK_SCAN_BINDINGS];
    HYI_TRY(hyi_vk_make_set(vk, vk->pass_layout, HYK_PASS_BINDINGS, 0, &s->sets[way]));
    bound[HYK_BINDING_SCAN_IN] = way ? s->keys : *keys;
    bound[HYK_BINDING_SCAN_OUT] = way ? *keys : s->keys;
    bound[HYK_BINDING_SCAN_VALUES_IN] = way ? s->values : *values;
    bound[HYK_BINDING_SCAN_VALUES_OUT] = way ? *values : s->values;
    bound[HYK_BINDING_SCAN_COUNT] = *count;
    bound[HYK_BINDING_SCAN_TOTAL] = s->sums; /* bound, not used */
    bound[HYK_BINDING_SCAN_PLAN] = s->plan;
    bound[HYK_BINDING_SCAN_SUMS] = s->sums;
    hyi_vk_write_set(vk, &s->sets[way], bound, HYK_SCAN_BINDINGS);
    return HYDRA_OK;
}

HYI_FN hydra_result hyi_vk_make_sort_pipelines(hyi_vk *vk, hyi_vk_sort *s) {
    HYI_TRY(hyi_vk_scan_pipeline(vk, HYI_VK_KERNEL_scan_plan, HYK_SCAN_SUMS, &s->divide));
    HYI_TRY(hyi_vk_scan_pipeline(vk, HYI_VK_KERNEL_sort_count, HYK_SCAN_SORT, &s->count));
    HYI_TRY(hyi_vk_scan_pipeline(vk, HYI_VK_KERNEL_scan_parts, HYK_SCAN_SORT, &s->parts));
    return hyi_vk_scan_pipeline(vk, HYI_VK_KERNEL_sort_scatter, HYK_SCAN_SORT, &s->scatter);
}

/* Sorts keys, and values with them, by bits first_bit to first_bit + bits - 1 of the keys, smallest first; pairs whose
   bits are equal stay in order. s is all zero; what was made before a failure is freed by hyi_vk_free_sort. */
HYI_FN hydra_result hyi_vk_make_sort(hyi_vk *vk, hyi_vk_sort *s, const hyi_vk_buffer *keys, const hyi_vk_buffer *values,
                                     hyi_vk_word count, uint32_t first_bit, uint32_t bits, uint32_t capacity) {
    VkDeviceSize bytes = ((VkDeviceSize)capacity + 3) / 4 * 16;
    if (first_bit > 32 || bits > 32 - first_bit)
        return hyi_fail(vk->context, HYDRA_ERROR_COUNT, "%u bits from bit %u of a key", bits, first_bit);
    HYI_TRY(hyi_vk_check_scan(vk, keys, values, count, capacity));
    HYI_TRY(hyi_vk_make_scan_memory(vk, &s->plan, &s->sums, HYK_SORT_TOTALS + HYK_SORT_DIGITS));
    HYI_TRY(hyi_vk_make_buffer(vk, &s->keys, HYI_VK_DEVICE, bytes, "keys of a sort"));
    HYI_TRY(hyi_vk_make_buffer(vk, &s->values, HYI_VK_DEVICE, bytes, "values of a sort"));
    HYI_TRY(hyi_vk_make_sort_pipelines(vk, s));
    for (uint32_t way = 0; way < 2; way++) HYI_TRY(hyi_vk_make_sort_set(vk, s, keys, values, count.buffer, way));
    s->call.capacity = capacity;
    s->call.count_at = count.at;
    s->first_bit = first_bit;
    s->bits = bits;
    return HYDRA_OK;
}

/* ---- recording */

HYI_FN void hyi_vk_bind_scan(hyi_vk *vk, hyi_vk_commands *c, const hyi_vk_set *set, const hyk_scan_call *call) {
    vk->f.CmdBindDescriptorSets(c->buffer, VK_PIPELINE_BIND_POINT_COMPUTE, vk->layout, 1, 1, &set->set, 0, NULL);
    vk->f.CmdPushConstants(c->buffer, vk->layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof *call, call);
}

/* groups 0: a workgroup for each part of the plan. */
HYI_FN void hyi_vk_scan_pass(hyi_vk *vk, hyi_vk_commands *c, VkPipeline pipeline, uint32_t groups, const hyi_vk_buffer *plan) {
    vk->f.CmdBindPipeline(c->buffer, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline);
    if (groups) vk->f.CmdDispatch(c->buffer, groups, 1, 1);
    else vk->f.CmdDispatchIndirect(c->buffer, plan->buffer, offsetof(hyk_scan_plan, parts));
    hyi_vk_barrier(vk, c);
}

HYI_FN void hyi_vk_record_scan(hyi_vk *vk, hyi_vk_commands *c, const hyi_vk_scan *s) {
    hyi_vk_bind_scan(vk, c, &s->set, &s->call);
    hyi_vk_scan_pass(vk, c, s->divide, 1, &s->plan);
    hyi_vk_scan_pass(vk, c, s->reduce, 0, &s->plan);
    hyi_vk_scan_pass(vk, c, s->parts, 1, &s->plan);
    hyi_vk_scan_pass(vk, c, s->apply, 0, &s->plan);
}

/* Digits of equally many bits, an even number of them: the last leaves the pairs where they came from. */
HYI_FN uint32_t hyi_vk_sort_digits(uint32_t bits) { return 2 * ((bits + 2 * HYK_SORT_BITS - 1) / (2 * HYK_SORT_BITS)); }

HYI_FN void hyi_vk_record_sort(hyi_vk *vk, hyi_vk_commands *c, const hyi_vk_sort *s) {
    uint32_t digits = hyi_vk_sort_digits(s->bits), done = 0;
    hyk_scan_call call = s->call;
    hyi_vk_bind_scan(vk, c, &s->sets[0], &call);
    hyi_vk_scan_pass(vk, c, s->divide, 1, &s->plan);
    for (uint32_t i = 0; i < digits; i++) {
        uint32_t end = (uint32_t)((uint64_t)s->bits * (i + 1) / digits);
        call.digit = (s->first_bit + done) | (end - done) << 8;
        hyi_vk_bind_scan(vk, c, &s->sets[i & 1], &call);
        hyi_vk_scan_pass(vk, c, s->count, 0, &s->plan);
        hyi_vk_scan_pass(vk, c, s->parts, HYK_SORT_DIGITS, &s->plan);
        hyi_vk_scan_pass(vk, c, s->scatter, 0, &s->plan);
        done = end;
    }
}

#endif /* HYI_VK_PRIMITIVES_H */
