/* Prefix sums, compaction and sorting on the device, against what they are said to be. The host never tells a count but
   in a buffer; every word after it must stay as it was. And what a device's films add up with, against the host's. */
#define HYDRA_STATIC
#define HYDRA_IMPLEMENTATION
#include "hydra.h"
#define HYDRA_VK_IMPLEMENTATION
#include "hydra_vk.h"
#include "hydra_test.h"

enum { CAPACITY = 2100004, COUNTS = 8 }; /* parts of three tiles */
static const uint32_t untouched = 0xa5c3a5c3u;

/* A device, arrays there, and their copies here. */
typedef struct bench {
    hydra_context *context;
    hyi_vk *vk;
    hyi_vk_commands commands;
    hyi_vk_buffer a, b, counts, told;
    uint32_t *in, *out, *more;
    uint32_t words[COUNTS]; /* of counts */
    ht_rng rng;
} bench;

/* Word 5 says how many, word 2 gets the total. */
enum { COUNT_AT = 5, TOTAL_AT = 2 };

static hyi_vk_word word_of(const hyi_vk_buffer *buffer, uint32_t at) {
    hyi_vk_word word;
    word.buffer = buffer;
    word.at = at;
    return word;
}

static void make_array(bench *t, hyi_vk_buffer *buffer, VkDeviceSize words) {
    assert_int_equal(hyi_vk_make_buffer(t->vk, buffer, HYI_VK_DEVICE, 4 * words, "an array"), HYDRA_OK);
}

static int open_bench(void **state) {
    bench *t = (bench *)calloc(1, sizeof *t);
    *state = t;
    t->in = (uint32_t *)malloc(3 * 4 * (size_t)CAPACITY);
    t->out = t->in + CAPACITY;
    t->more = t->out + CAPACITY;
    t->rng = ht_rng_make(20);
    t->context = hydra_create(NULL);
    assert_non_null(t->context);
    t->vk = (hyi_vk *)t->context->device;
    assert_non_null(t->vk);
    make_array(t, &t->a, CAPACITY);
    make_array(t, &t->b, CAPACITY);
    make_array(t, &t->counts, COUNTS);
    assert_int_equal(hyi_vk_make_buffer(t->vk, &t->told, HYI_VK_READBACK, 4 * (VkDeviceSize)CAPACITY, "what it told"), HYDRA_OK);
    return hyi_vk_make_commands(t->vk, &t->commands) == HYDRA_OK ? 0 : 1;
}

static int close_bench(void **state) {
    bench *t = (bench *)*state;
    hyi_vk_free_buffer(t->vk, &t->a);
    hyi_vk_free_buffer(t->vk, &t->b);
    hyi_vk_free_buffer(t->vk, &t->counts);
    hyi_vk_free_buffer(t->vk, &t->told);
    hyi_vk_free_commands(t->vk, &t->commands);
    hydra_result result = hydra_destroy(t->context);
    free(t->in);
    free(t);
    return result == HYDRA_OK ? 0 : 1;
}

static void begin(bench *t) { assert_int_equal(hyi_vk_begin(t->vk, &t->commands), HYDRA_OK); }

static void finish(bench *t) {
    double seconds;
    assert_int_equal(hyi_vk_submit(t->vk, &t->commands), HYDRA_OK);
    assert_int_equal(hyi_vk_wait(t->vk, &t->commands, &seconds), HYDRA_OK);
}

static void send(bench *t, hyi_vk_buffer *to, const uint32_t *from, uint32_t words) {
    assert_int_equal(hyi_vk_send(t->vk, to, from, 4 * (size_t)words), HYDRA_OK);
}

static void fetch(bench *t, uint32_t *to, const hyi_vk_buffer *from, uint32_t words) {
    begin(t);
    hyi_vk_copy(t->vk, &t->commands, from, &t->told, 4 * (VkDeviceSize)words);
    hyi_vk_barrier_to_host(t->vk, &t->commands);
    finish(t);
    memcpy(to, t->told.mapped, 4 * (size_t)words);
}

static void send_count(bench *t, uint32_t count) {
    for (uint32_t i = 0; i < COUNTS; i++) t->words[i] = i == COUNT_AT ? count : untouched;
    send(t, &t->counts, t->words, COUNTS);
}

/* Fetches counts: none but the total has changed. */
static uint32_t fetch_total(bench *t) {
    uint32_t words[COUNTS];
    fetch(t, words, &t->counts, COUNTS);
    for (uint32_t i = 0; i < COUNTS; i++)
        if (i != TOTAL_AT) assert_int_equal(words[i], t->words[i]);
    return words[TOTAL_AT];
}

static void clear(uint32_t *words, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) words[i] = untouched;
}

static void assert_untouched(const uint32_t *words, uint32_t first, uint32_t end) {
    for (uint32_t i = first; i < end; i++)
        if (words[i] != untouched) fail_msg("word %u was written, %u were to be", i, first);
}

/* Words that are written before and looked at after: more than there are elements, so that what goes too far is seen. */
static uint32_t looked_at(uint32_t count) { return count < 200000 ? count + 5000 : CAPACITY; }

static const uint32_t sizes[] = { 0,    1,    2,    3,    4,    5,    63,     64,       65,             127,     128, 129,
                                  1000, 1023, 1024, 1025, 4096, 4097, 100003, 1u << 20, (1u << 20) + 1, CAPACITY };

/* ---- scans */

static void run_scan(bench *t, uint32_t mode, const hyi_vk_buffer *in, const hyi_vk_buffer *out, bool with_total) {
    hyi_vk_scan scan;
    memset(&scan, 0, sizeof scan);
    hyi_vk_word total = word_of(with_total ? &t->counts : NULL, TOTAL_AT);
    assert_int_equal(hyi_vk_make_scan(t->vk, &scan, mode, in, out, word_of(&t->counts, COUNT_AT), total, CAPACITY), HYDRA_OK);
    begin(t);
    hyi_vk_record_scan(t->vk, &t->commands, &scan);
    finish(t);
    hyi_vk_free_scan(t->vk, &scan);
}

static void assert_sums(const uint32_t *in, const uint32_t *out, uint32_t count, uint32_t total) {
    uint32_t sum = 0;
    for (uint32_t i = 0; i < count; i++) {
        if (out[i] != sum) fail_msg("sum before word %u of %u: %u, it is %u", i, count, out[i], sum);
        sum += in[i];
    }
    assert_int_equal(total, sum);
}

static void check_sums(bench *t, uint32_t count, bool in_place) {
    uint32_t seen = looked_at(count);
    const hyi_vk_buffer *to = in_place ? &t->a : &t->b;
    send(t, &t->a, t->in, seen);
    clear(t->out, seen);
    send(t, &t->b, t->out, seen);
    send_count(t, count);
    run_scan(t, HYK_SCAN_SUMS, &t->a, to, true);
    fetch(t, t->out, to, seen);
    assert_sums(t->in, t->out, count, fetch_total(t));
    assert_untouched(t->out, count, seen);
}

static void test_sums_of_random_words_wrap(void **state) {
    bench *t = (bench *)*state;
    for (size_t s = 0; s < HYI_COUNT(sizes); s++) {
        clear(t->in, CAPACITY);
        for (uint32_t i = 0; i < sizes[s]; i++) t->in[i] = ht_u32(&t->rng);
        check_sums(t, sizes[s], s % 2 != 0);
        if (sizes[s] < 200000) check_sums(t, sizes[s], s % 2 == 0);
    }
}

static void test_sums_of_extreme_words(void **state) {
    bench *t = (bench *)*state;
    const uint32_t words[] = { 0, 1, 0x80000000u, 0xffffffffu };
    for (size_t w = 0; w < HYI_COUNT(words); w++) {
        clear(t->in, CAPACITY);
        for (uint32_t i = 0; i < 5003; i++) t->in[i] = words[w];
        check_sums(t, 5003, w % 2 != 0);
    }
}

static void test_a_total_is_not_needed(void **state) {
    bench *t = (bench *)*state;
    for (uint32_t i = 0; i < 3000; i++) t->in[i] = i;
    send(t, &t->a, t->in, 3000);
    send_count(t, 3000);
    run_scan(t, HYK_SCAN_SUMS, &t->a, &t->b, false);
    fetch(t, t->out, &t->b, 3000);
    assert_sums(t->in, t->out, 3000, 2999u * 3000u / 2u);
    assert_int_equal(fetch_total(t), untouched);
}

static void test_a_count_above_the_capacity_is_cut(void **state) {
    bench *t = (bench *)*state;
    hyi_vk_scan scan;
    memset(&scan, 0, sizeof scan);
    clear(t->in, 6000);
    for (uint32_t i = 0; i < 6000; i++) t->in[i] = 3 * i;
    send(t, &t->a, t->in, 6000);
    clear(t->out, 6000);
    send(t, &t->b, t->out, 6000);
    send_count(t, 0xffffffffu);
    hyi_vk_word count = word_of(&t->counts, COUNT_AT), total = word_of(&t->counts, TOTAL_AT);
    assert_int_equal(hyi_vk_make_scan(t->vk, &scan, HYK_SCAN_SUMS, &t->a, &t->b, count, total, 2500), HYDRA_OK);
    begin(t);
    hyi_vk_record_scan(t->vk, &t->commands, &scan);
    finish(t);
    hyi_vk_free_scan(t->vk, &scan);
    fetch(t, t->out, &t->b, 6000);
    assert_sums(t->in, t->out, 2500, fetch_total(t));
    assert_untouched(t->out, 2500, 6000);
}

/* ---- compaction */

/* one_in 0: no flag is set. Flags that are set have any bits, the lowest or the highest among them. */
static void check_indices(bench *t, uint32_t count, uint32_t one_in) {
    uint32_t seen = looked_at(count), expected = 0;
    clear(t->in, CAPACITY);
    for (uint32_t i = 0; i < count; i++) t->in[i] = one_in && ht_below(&t->rng, one_in) == 0 ? 1u << ht_below(&t->rng, 32) : 0;
    send(t, &t->a, t->in, seen);
    clear(t->out, seen);
    send(t, &t->b, t->out, seen);
    send_count(t, count);
    run_scan(t, HYK_SCAN_INDICES, &t->a, &t->b, true);
    fetch(t, t->out, &t->b, seen);
    for (uint32_t i = 0; i < count; i++)
        if (t->in[i] && t->out[expected++] != i) fail_msg("flag %u of %u: index %u is %u", i, count, expected - 1, t->out[expected - 1]);
    assert_int_equal(fetch_total(t), expected);
    assert_untouched(t->out, expected, seen);
}

static void test_indices_of_flags(void **state) {
    bench *t = (bench *)*state;
    for (size_t s = 0; s < HYI_COUNT(sizes); s++) check_indices(t, sizes[s], s % 2 ? 2 : 3);
}

static void test_indices_of_all_none_and_few(void **state) {
    bench *t = (bench *)*state;
    const uint32_t one_in[] = { 0, 1, 1000, 50000 };
    for (size_t i = 0; i < HYI_COUNT(one_in); i++) check_indices(t, 100003, one_in[i]);
}

/* ---- sorting */

static void run_sort(bench *t, uint32_t first_bit, uint32_t bits) {
    hyi_vk_sort sort;
    memset(&sort, 0, sizeof sort);
    assert_int_equal(hyi_vk_make_sort(t->vk, &sort, &t->a, &t->b, word_of(&t->counts, COUNT_AT), first_bit, bits, CAPACITY), HYDRA_OK);
    begin(t);
    hyi_vk_record_sort(t->vk, &t->commands, &sort);
    finish(t);
    hyi_vk_free_sort(t->vk, &sort);
}

/* Values are the places that pairs came from, turned over. Pairs in strict order of (bits, place) whose keys are those
   of their places are every pair, once, sorted, with equals in order. */
static void assert_sorted(const uint32_t *before, const uint32_t *keys, const uint32_t *values, uint32_t count, uint32_t first_bit,
                          uint32_t bits) {
    uint64_t last = 0, mask = ((uint64_t)1 << bits) - 1;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t place = ~values[i];
        if (place >= count || keys[i] != before[place]) fail_msg("pair %u of %u (%08x, %u) was not there", i, count, keys[i], place);
        uint64_t order = ((((uint64_t)keys[i] >> first_bit) & mask) << 32) + place + 1;
        if (order <= last) fail_msg("pairs %u and %u of %u are not in order, by %u bits from %u", i - 1, i, count, bits, first_bit);
        last = order;
    }
}

/* Sorts t->in. */
static void check_sort(bench *t, uint32_t count, uint32_t first_bit, uint32_t bits) {
    uint32_t seen = looked_at(count);
    clear(t->in + count, seen - count);
    clear(t->more, seen);
    for (uint32_t i = 0; i < count; i++) t->more[i] = ~i;
    send(t, &t->a, t->in, seen);
    send(t, &t->b, t->more, seen);
    send_count(t, count);
    run_sort(t, first_bit, bits);
    fetch(t, t->out, &t->a, seen);
    fetch(t, t->more, &t->b, seen);
    assert_sorted(t->in, t->out, t->more, count, first_bit, bits);
    assert_untouched(t->out, count, seen);
    assert_untouched(t->more, count, seen);
    assert_int_equal(fetch_total(t), untouched);
}

static void fill(bench *t, uint32_t count, uint32_t mask) {
    for (uint32_t i = 0; i < count; i++) t->in[i] = ht_u32(&t->rng) & mask;
}

static void test_random_keys(void **state) {
    bench *t = (bench *)*state;
    for (size_t s = 0; s < HYI_COUNT(sizes); s++) {
        fill(t, sizes[s], 0xffffffffu);
        if (sizes[s] <= 100003) check_sort(t, sizes[s], 0, 32);
        else check_sort(t, sizes[s], 3, 13); /* the bits of fewer passes, for time */
    }
}

static void test_keys_in_order_and_against_it(void **state) {
    bench *t = (bench *)*state;
    const uint32_t count = 30001;
    for (uint32_t i = 0; i < count; i++) t->in[i] = i * 140000u;
    check_sort(t, count, 0, 32);
    for (uint32_t i = 0; i < count; i++) t->in[i] = (count - i) * 140000u;
    check_sort(t, count, 0, 32);
    for (uint32_t i = 0; i < count; i++) t->in[i] = i % 2 ? 0xffffffffu : 0;
    check_sort(t, count, 0, 32);
}

/* Runs of one digit fill tiles and parts. */
static void test_equal_keys_stay_in_order(void **state) {
    bench *t = (bench *)*state;
    const uint32_t keys[] = { 0, 0xffffffffu, 0x7531fdb9u };
    for (size_t k = 0; k < HYI_COUNT(keys); k++) {
        for (uint32_t i = 0; i < 20011; i++) t->in[i] = keys[k];
        check_sort(t, 20011, 0, 32);
    }
    fill(t, 20011, 0x80000001u);
    check_sort(t, 20011, 0, 32);
    for (uint32_t i = 0; i < (1u << 20) + 1025; i++) t->in[i] = 0x00000600u;
    check_sort(t, (1u << 20) + 1025, 8, 4);
}

static void test_ranges_of_bits(void **state) {
    bench *t = (bench *)*state;
    const uint32_t ranges[][2] = { { 0, 0 },  { 0, 1 }, { 31, 1 }, { 7, 3 },  { 28, 4 }, { 0, 5 },
                                   { 12, 8 }, { 3, 9 }, { 5, 17 }, { 0, 30 }, { 1, 31 }, { 32, 0 } };
    for (size_t r = 0; r < HYI_COUNT(ranges); r++) {
        fill(t, 5003, 0xffffffffu);
        check_sort(t, 5003, ranges[r][0], ranges[r][1]);
    }
}

/* ---- together */

/* Flagged places, by their lowest ten bits, and how many fields of 1024 lie before each: three times one count that
   only the device knows. */
static void test_what_one_finds_the_next_one_takes(void **state) {
    bench *t = (bench *)*state;
    const uint32_t count = 50021;
    hyi_vk_buffer indices, sums;
    hyi_vk_scan compact, add;
    hyi_vk_sort sort;
    memset(&indices, 0, sizeof indices);
    memset(&sums, 0, sizeof sums);
    memset(&compact, 0, sizeof compact);
    memset(&add, 0, sizeof add);
    memset(&sort, 0, sizeof sort);
    make_array(t, &indices, count + 3);
    make_array(t, &sums, count + 3);
    for (uint32_t i = 0; i < count; i++) {
        t->in[i] = ht_below(&t->rng, 3) == 0;
        t->more[i] = ~i;
    }
    send(t, &t->a, t->in, count);
    send(t, &t->b, t->more, count);
    send_count(t, count);
    hyi_vk_word places = word_of(&t->counts, COUNT_AT), flagged = word_of(&t->counts, TOTAL_AT), none = word_of(NULL, 0);
    assert_int_equal(hyi_vk_make_scan(t->vk, &compact, HYK_SCAN_INDICES, &t->a, &indices, places, flagged, count), HYDRA_OK);
    assert_int_equal(hyi_vk_make_sort(t->vk, &sort, &indices, &t->b, flagged, 0, 10, count), HYDRA_OK);
    assert_int_equal(hyi_vk_make_scan(t->vk, &add, HYK_SCAN_SUMS, &indices, &sums, flagged, none, count), HYDRA_OK);
    begin(t);
    hyi_vk_record_scan(t->vk, &t->commands, &compact);
    hyi_vk_record_sort(t->vk, &t->commands, &sort);
    hyi_vk_record_scan(t->vk, &t->commands, &add);
    finish(t);
    uint32_t found = 0, total = fetch_total(t), sum = 0;
    for (uint32_t i = 0; i < count; i++)
        if (t->in[i]) t->in[found++] = i;
    assert_int_equal(total, found);
    fetch(t, t->out, &indices, count);
    fetch(t, t->more, &t->b, count);
    assert_sorted(t->in, t->out, t->more, found, 0, 10);
    fetch(t, t->more, &sums, count);
    for (uint32_t i = 0; i < found; i++) sum += t->out[i];
    assert_sums(t->out, t->more, found, sum);
    hyi_vk_free_scan(t->vk, &compact);
    hyi_vk_free_scan(t->vk, &add);
    hyi_vk_free_sort(t->vk, &sort);
    hyi_vk_free_buffer(t->vk, &indices);
    hyi_vk_free_buffer(t->vk, &sums);
}

/* One object, several times in a command buffer: sums of sums of sums of ones are binomials. */
static void test_one_object_many_times(void **state) {
    bench *t = (bench *)*state;
    hyi_vk_scan scan;
    memset(&scan, 0, sizeof scan);
    for (uint32_t i = 0; i < 3000; i++) t->in[i] = 1;
    send(t, &t->a, t->in, 3000);
    send_count(t, 3000);
    hyi_vk_word count = word_of(&t->counts, COUNT_AT);
    assert_int_equal(hyi_vk_make_scan(t->vk, &scan, HYK_SCAN_SUMS, &t->a, &t->a, count, word_of(NULL, 0), CAPACITY), HYDRA_OK);
    begin(t);
    for (uint32_t i = 0; i < 3; i++) hyi_vk_record_scan(t->vk, &t->commands, &scan);
    finish(t);
    hyi_vk_free_scan(t->vk, &scan);
    fetch(t, t->out, &t->a, 3000);
    for (uint64_t i = 0; i < 3000; i++) assert_int_equal(t->out[i], (uint32_t)(i < 2 ? 0 : i * (i - 1) * (i - 2) / 6));
}

/* ---- without a device */

static void assert_plan(uint32_t count) {
    hyk_scan_plan plan = hyk_plan_scan(count, HYK_SCAN_MOST);
    uint64_t tiles = ((uint64_t)plan.count + HYK_SCAN_TILE - 1) / HYK_SCAN_TILE;
    assert_int_equal(plan.count, count < HYK_SCAN_MOST ? count : HYK_SCAN_MOST);
    assert_true(plan.parts <= HYK_SCAN_PARTS && plan.groups_y == 1 && plan.groups_z == 1);
    assert_true((uint64_t)plan.parts * plan.part_tiles >= tiles);
    assert_true(plan.parts == 0 ? tiles == 0 : (uint64_t)(plan.parts - 1) * plan.part_tiles < tiles);
}

static void test_every_element_is_in_one_part(void **state) {
    bench *t = (bench *)*state;
    const uint32_t edges[] = { 0, HYK_SCAN_TILE, HYK_SCAN_TILE * HYK_SCAN_PARTS, 7 * HYK_SCAN_TILE * HYK_SCAN_PARTS, HYK_SCAN_MOST };
    for (size_t e = 0; e < HYI_COUNT(edges); e++)
        for (uint32_t i = 0; i < 4; i++) assert_plan(edges[e] + i - (edges[e] ? 2 : 0));
    for (uint32_t i = 0; i < 2000; i++) assert_plan(ht_u32(&t->rng) >> ht_below(&t->rng, 32));
}

static void test_what_does_not_fit_is_refused(void **state) {
    bench *t = (bench *)*state;
    hyi_vk_scan scan;
    hyi_vk_sort sort;
    hyi_vk_word count = word_of(&t->counts, COUNT_AT), none = word_of(NULL, 0), outside = word_of(&t->counts, COUNTS);
    memset(&scan, 0, sizeof scan);
    memset(&sort, 0, sizeof sort);
    assert_int_equal(hyi_vk_make_scan(t->vk, &scan, HYK_SCAN_SUMS, &t->a, &t->b, count, none, CAPACITY + 1), HYDRA_ERROR_BUFFER);
    assert_int_equal(hyi_vk_make_scan(t->vk, &scan, HYK_SCAN_SUMS, &t->a, &t->counts, count, none, COUNTS + 1), HYDRA_ERROR_BUFFER);
    assert_int_equal(hyi_vk_make_scan(t->vk, &scan, HYK_SCAN_SUMS, &t->a, &t->b, outside, none, CAPACITY), HYDRA_ERROR_BUFFER);
    assert_int_equal(hyi_vk_make_scan(t->vk, &scan, HYK_SCAN_SUMS, &t->a, &t->b, count, none, HYK_SCAN_MOST + 1), HYDRA_ERROR_DEVICE_LIMIT);
    assert_int_equal(hyi_vk_make_sort(t->vk, &sort, &t->a, &t->b, count, 1, 32, CAPACITY), HYDRA_ERROR_COUNT);
    assert_int_equal(hyi_vk_make_sort(t->vk, &sort, &t->a, &t->b, count, 33, 0, CAPACITY), HYDRA_ERROR_COUNT);
    assert_int_equal(hyi_vk_make_sort(t->vk, &sort, &t->a, &t->b, count, 0, 32, CAPACITY + 1), HYDRA_ERROR_BUFFER);
    hyi_vk_free_scan(t->vk, &scan);
    hyi_vk_free_sort(t->vk, &sort);
}

/* ---- sums in words of 32 bits, as devices make films: the same bytes as those of the host */

static uint32_t bits_of(float x) {
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

/* Any bits at all; numbers of one size; or what is at the edges: zeros, denormals, the largest, infinities, no numbers. */
static float any_float(ht_rng *rng, uint32_t trial) {
    const uint32_t edges[12] = {0, 0x80000000u, 1, 0x80000001u, 0x7fffffu, 0x800000u, 0x7f7fffffu, 0xff7fffffu, 0x7f800000u, 0xff800000u, 0x3f800000u, 0x7fc12345u};
    uint32_t bits = ht_u32(rng);
    float x;
    if (trial % 3 == 1) bits = (bits & 0x807fffffu) | (100u + trial % 100u + ht_below(rng, 8)) << 23;
    if (trial % 3 == 2) bits = edges[ht_below(rng, trial % 2 ? 8 : 12)];
    memcpy(&x, &bits, sizeof x);
    return x;
}

static void test_sums_of_three(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(1);
    assert_int_equal(sizeof(hyk_sum3), sizeof(hyi_sum3));
    for (uint32_t trial = 0; trial < 3000; trial++) {
        hyk_sum3 ours;
        hyi_sum3 theirs;
        memset(&ours, 0, sizeof ours);
        memset(&theirs, 0, sizeof theirs);
        for (int i = 0; i < 60; i++) {
            const float terms[3] = {any_float(&rng, trial), any_float(&rng, trial), any_float(&rng, trial)};
            ours = hyk_add_floats3(ours, bits_of(terms[0]), bits_of(terms[1]), bits_of(terms[2]));
            hyi_sum3_add(&theirs, terms);
            assert_memory_equal(&ours, &theirs, sizeof ours);
        }
    }
}

static void test_sums_of_squares(void **state) {
    (void)state;
    ht_rng rng = ht_rng_make(2);
    for (uint32_t trial = 0; trial < 3000; trial++) {
        hyk_lanes ours;
        hyi_sum theirs;
        uint32_t top = 0;
        memset(&ours, 0, sizeof ours);
        memset(&theirs, 0, sizeof theirs);
        for (int i = 0; i < 60; i++) {
            float x = any_float(&rng, trial);
            hyk_digits digits = hyk_digits_of_square(bits_of(x));
            uint32_t higher = hyk_higher(top, digits.top);
            if ((bits_of(x) & 0x7fffffffu) > 0x7f800000u) continue; /* the sign of no number is the machine's */
            ours = hyk_add_digits(hyk_raise_lanes(ours, top, higher), higher, digits);
            top = higher;
            hyi_sum_add(&theirs, (double)x * (double)x);
            assert_memory_equal(&ours, &theirs.lanes, sizeof ours);
            assert_int_equal((int)top, theirs.top);
        }
    }
}

int hydra_test_vk_primitives(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sums_of_random_words_wrap),
        cmocka_unit_test(test_sums_of_extreme_words),
        cmocka_unit_test(test_a_total_is_not_needed),
        cmocka_unit_test(test_a_count_above_the_capacity_is_cut),
        cmocka_unit_test(test_indices_of_flags),
        cmocka_unit_test(test_indices_of_all_none_and_few),
        cmocka_unit_test(test_random_keys),
        cmocka_unit_test(test_keys_in_order_and_against_it),
        cmocka_unit_test(test_equal_keys_stay_in_order),
        cmocka_unit_test(test_ranges_of_bits),
        cmocka_unit_test(test_what_one_finds_the_next_one_takes),
        cmocka_unit_test(test_one_object_many_times),
        cmocka_unit_test(test_every_element_is_in_one_part),
        cmocka_unit_test(test_what_does_not_fit_is_refused),
        cmocka_unit_test(test_sums_of_three),
        cmocka_unit_test(test_sums_of_squares),
    };
    return cmocka_run_group_tests_name("vk_primitives", tests, open_bench, close_bench);
}
