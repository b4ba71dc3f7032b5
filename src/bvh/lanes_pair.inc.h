/* ---- eight lanes as two times four (expanded once for each instruction set whose vectors have four, in its words
   for four floats and two doubles) */

typedef struct HYI_I(hyi_f8) {
    HYI_F4 low, high;
} HYI_I(hyi_f8);

typedef struct HYI_I(hyi_m8) {
    HYI_M4 low, high;
} HYI_I(hyi_m8);

typedef struct HYI_I(hyi_d4) {
    HYI_D2 low, high;
} HYI_I(hyi_d4);

#define HYI_PAIR(name, result, type, word)                                                        \
    HYI_INLINE HYI_TARGET HYI_I(hyi_##result) HYI_I(hyi_##name)(HYI_I(hyi_##type) a, HYI_I(hyi_##type) b) { \
        HYI_I(hyi_##result) r;                                                                    \
        r.low = word(a.low, b.low);                                                               \
        r.high = word(a.high, b.high);                                                            \
        return r;                                                                                 \
    }
HYI_PAIR(add8, f8, f8, HYI_ADD4)
HYI_PAIR(sub8, f8, f8, HYI_SUB4)
HYI_PAIR(mul8, f8, f8, HYI_MUL4)
HYI_PAIR(div8, f8, f8, HYI_DIV4)
HYI_PAIR(min8, f8, f8, HYI_MIN4)
HYI_PAIR(max8, f8, f8, HYI_MAX4)
HYI_PAIR(max8_as_ints, f8, f8, HYI_MAX4_AS_INTS)
HYI_PAIR(min8_as_ints, f8, f8, HYI_MIN4_AS_INTS)
HYI_PAIR(lt8, m8, f8, HYI_LT4)
HYI_PAIR(le8, m8, f8, HYI_LE4)
HYI_PAIR(same8, m8, f8, HYI_SAME4)
HYI_PAIR(and8, m8, m8, HYI_AND4)
HYI_PAIR(or8, m8, m8, HYI_OR4)
HYI_PAIR(add_doubles, d4, d4, HYI_ADD2)
HYI_PAIR(sub_doubles, d4, d4, HYI_SUB2)
HYI_PAIR(mul_doubles, d4, d4, HYI_MUL2)
HYI_PAIR(div_doubles, d4, d4, HYI_DIV2)
HYI_PAIR(min_doubles, d4, d4, HYI_MIN2)
HYI_PAIR(max_doubles, d4, d4, HYI_MAX2)
#undef HYI_PAIR

/* ---- floats */

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_set8)(float value) {
    HYI_I(hyi_f8) r;
    r.low = r.high = HYI_SET4(value);
    return r;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_load8)(const float *p) {
    HYI_I(hyi_f8) r;
    r.low = HYI_LOAD4(p);
    r.high = HYI_LOAD4(p + 4);
    return r;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_load_plane)(const float *p) {
    HYI_I(hyi_f8) r;
    r.low = HYI_LOAD4_ALIGNED(p);
    r.high = HYI_LOAD4_ALIGNED(p + 4);
    return r;
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_store8)(float *p, HYI_I(hyi_f8) a) {
    HYI_STORE4(p, a.low);
    HYI_STORE4(p + 4, a.high);
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_mad8)(HYI_I(hyi_f8) a, HYI_I(hyi_f8) b, HYI_I(hyi_f8) c) {
    HYI_I(hyi_f8) r;
    r.low = HYI_MAD4(a.low, b.low, c.low);
    r.high = HYI_MAD4(a.high, b.high, c.high);
    return r;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_size8)(HYI_I(hyi_f8) a) {
    a.low = HYI_SIZE4(a.low);
    a.high = HYI_SIZE4(a.high);
    return a;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_pin8)(HYI_I(hyi_f8) a) {
    a.low = HYI_PIN4(a.low);
    a.high = HYI_PIN4(a.high);
    return a;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_choose8)(HYI_I(hyi_m8) m, HYI_I(hyi_f8) a, HYI_I(hyi_f8) b) {
    a.low = HYI_CHOOSE4(m.low, a.low, b.low);
    a.high = HYI_CHOOSE4(m.high, a.high, b.high);
    return a;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_f8) HYI_I(hyi_min8_where)(HYI_I(hyi_f8) a, HYI_I(hyi_m8) m, HYI_I(hyi_f8) b) {
    a.low = HYI_CHOOSE4(m.low, HYI_MIN4(a.low, b.low), a.low);
    a.high = HYI_CHOOSE4(m.high, HYI_MIN4(a.high, b.high), a.high);
    return a;
}

/* ---- doubles: four, in one half of a packet */

HYI_INLINE HYI_TARGET HYI_I(hyi_d4) HYI_I(hyi_set_doubles)(double value) {
    HYI_I(hyi_d4) r;
    r.low = r.high = HYI_SET2(value);
    return r;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_d4) HYI_I(hyi_load_half)(const float *p, int half) {
    HYI_F4 four = HYI_LOAD4(p + 4 * half);
    HYI_I(hyi_d4) r;
    r.low = HYI_LOW_AS_DOUBLES(four);
    r.high = HYI_HIGH_AS_DOUBLES(four);
    return r;
}

HYI_INLINE HYI_TARGET HYI_I(hyi_d4) HYI_I(hyi_load_doubles)(const double *p) {
    HYI_I(hyi_d4) r;
    r.low = HYI_LOAD2(p);
    r.high = HYI_LOAD2(p + 2);
    return r;
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_store_doubles)(double *p, HYI_I(hyi_d4) a) {
    HYI_STORE2(p, a.low);
    HYI_STORE2(p + 2, a.high);
}

HYI_INLINE HYI_TARGET void HYI_I(hyi_store_half)(float *p, int half, HYI_I(hyi_d4) a) {
    HYI_STORE4(p + 4 * half, HYI_AS_FLOATS(a.low, a.high));
}

HYI_INLINE HYI_TARGET uint32_t HYI_I(hyi_lt_doubles)(HYI_I(hyi_d4) a, HYI_I(hyi_d4) b) {
    return HYI_BITS2_2(HYI_LT2(a.low, b.low), HYI_LT2(a.high, b.high));
}

HYI_INLINE HYI_TARGET HYI_I(hyi_d4) HYI_I(hyi_pin_doubles)(HYI_I(hyi_d4) a) {
    a.low = HYI_PIN2(a.low);
    a.high = HYI_PIN2(a.high);
    return a;
}

/* ---- lists */

/* Four successive words of each of eight rays, as rows of one word of all. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_four_words)(const char *const at[8], size_t offset, HYI_I(hyi_f8) rows[4]) {
    HYI_F4 low[4], high[4];
    for (uint32_t k = 0; k < 4u; k++) {
        low[k] = HYI_LOAD4((const float *)(const void *)(at[k] + offset));
        high[k] = HYI_LOAD4((const float *)(const void *)(at[4u + k] + offset));
    }
    HYI_TURN4(low);
    HYI_TURN4(high);
    for (uint32_t k = 0; k < 4u; k++) {
        rows[k].low = low[k];
        rows[k].high = high[k];
    }
}

/* Appends eight items to the lists of the children that their masks name. By bits: permutations from a table were slower. */
HYI_INLINE HYI_TARGET void HYI_I(hyi_deal_out)(const uint32_t *items, const hyi_masks8 *masks, uint32_t *lists, uint32_t stride, uint32_t dealt[8]) {
    for (uint32_t i = 0; i < 8u; i++) {
        for (uint32_t takers = masks->bytes[i]; takers; takers &= takers - 1u) {
            uint32_t c = hyi_lowest_bit(takers);
            lists[(size_t)c * stride + dealt[c]++] = items[i];
        }
    }
}

#define HYI_F8 HYI_I(hyi_f8)
#define HYI_ALWAYS_EXACT 0
#define HYI_EXACT_ALONE 1 /* eight in two steps: for one ray that costs what it spares */
#define HYI_M8 HYI_I(hyi_m8)
#define HYI_LOAD8(p) HYI_I(hyi_load_plane)(p)
#define HYI_LOADU8(p) HYI_I(hyi_load8)(p)
#define HYI_STORE8(p, a) HYI_I(hyi_store8)(p, a)
#define HYI_SET8(value) HYI_I(hyi_set8)(value)
#define HYI_ZERO8() HYI_I(hyi_set8)(0.0f)
#define HYI_ADD8(a, b) HYI_I(hyi_add8)(a, b)
#define HYI_SUB8(a, b) HYI_I(hyi_sub8)(a, b)
#define HYI_MUL8(a, b) HYI_I(hyi_mul8)(a, b)
#define HYI_DIV8(a, b) HYI_I(hyi_div8)(a, b)
#define HYI_MAD8(a, b, c) HYI_I(hyi_mad8)(a, b, c)
#define HYI_MIN8(a, b) HYI_I(hyi_min8)(a, b)
#define HYI_MAX8(a, b) HYI_I(hyi_max8)(a, b)
#define HYI_SIZE8(a) HYI_I(hyi_size8)(a)
#define HYI_MAX8_AS_INTS(a, b) HYI_I(hyi_max8_as_ints)(a, b)
#define HYI_MIN8_AS_INTS(a, b) HYI_I(hyi_min8_as_ints)(a, b)
#define HYI_LT8(a, b) HYI_I(hyi_lt8)(a, b)
#define HYI_LE8(a, b) HYI_I(hyi_le8)(a, b)
#define HYI_AND8(a, b) HYI_I(hyi_and8)(a, b)
#define HYI_OR8(a, b) HYI_I(hyi_or8)(a, b)
#define HYI_BITS8(m) HYI_BITS4_4((m).low, (m).high)
#define HYI_MIN8_WHERE(a, m, b) HYI_I(hyi_min8_where)(a, m, b)
#define HYI_PIN8(a) HYI_I(hyi_pin8)(a)
#define HYI_RAY_WORDS(rays, words) hyi_ray_words(rays, words, 8u)
#define HYI_LINES(rows, lines) hyi_lines(rows, lines, 8u)
#define HYI_FOUR_WORDS(at, offset, rows) HYI_I(hyi_four_words)(at, offset, rows)
#define HYI_PAIRS false
#define HYI_LANES 8u
#define HYI_ALLW 0xffu
#define HYI_FW HYI_F8
#define HYI_MW HYI_M8
#define HYI_LOADW(p) HYI_LOADU8(p)
#define HYI_STOREW(p, a) HYI_STORE8(p, a)
#define HYI_SETW(value) HYI_SET8(value)
#define HYI_ZEROW() HYI_ZERO8()
#define HYI_ADDW(a, b) HYI_ADD8(a, b)
#define HYI_SUBW(a, b) HYI_SUB8(a, b)
#define HYI_MULW(a, b) HYI_MUL8(a, b)
#define HYI_DIVW(a, b) HYI_DIV8(a, b)
#define HYI_MADW(a, b, c) HYI_MAD8(a, b, c)
#define HYI_MINW(a, b) HYI_MIN8(a, b)
#define HYI_MAXW(a, b) HYI_MAX8(a, b)
#define HYI_MAXW_AS_INTS(a, b) HYI_MAX8_AS_INTS(a, b)
#define HYI_SIZEW(a) HYI_SIZE8(a)
#define HYI_LTW(a, b) HYI_LT8(a, b)
#define HYI_LEW(a, b) HYI_LE8(a, b)
#define HYI_CHOOSEW(m, a, b) HYI_I(hyi_choose8)(m, a, b)
#define HYI_ANDW(a, b) HYI_AND8(a, b)
#define HYI_ORW(a, b) HYI_OR8(a, b)
#define HYI_SAMEW(a, b) HYI_I(hyi_same8)(a, b)
#define HYI_BITSW(m) HYI_BITS8(m)
#define HYI_PINW(a) HYI_PIN8(a)
#define HYI_GREATESTW(a) HYI_GREATEST4(HYI_MAX4((a).low, (a).high))
#define HYI_LEASTW(a) HYI_LEAST4(HYI_MIN4((a).low, (a).high))
#define HYI_DEAL_BLOCKS(swarm, node, list, count, lists, stride, dealt, nearest) 0u
#define HYI_WAIT_AT_CHILDREN(waiters, node, ray, mask, enter) HYI_I(hyi_wait_at_each)(waiters, node, ray, mask, enter)
#define HYI_FD HYI_I(hyi_d4)
#define HYI_SETD(value) HYI_I(hyi_set_doubles)(value)
#define HYI_LOADH(p, half) HYI_I(hyi_load_half)(p, half)
#define HYI_LOADD(p) HYI_I(hyi_load_doubles)(p)
#define HYI_STORED(p, a) HYI_I(hyi_store_doubles)(p, a)
#define HYI_STOREH(p, half, a) HYI_I(hyi_store_half)(p, half, a)
#define HYI_ADDD(a, b) HYI_I(hyi_add_doubles)(a, b)
#define HYI_SUBD(a, b) HYI_I(hyi_sub_doubles)(a, b)
#define HYI_MULD(a, b) HYI_I(hyi_mul_doubles)(a, b)
#define HYI_DIVD(a, b) HYI_I(hyi_div_doubles)(a, b)
#define HYI_MIND(a, b) HYI_I(hyi_min_doubles)(a, b)
#define HYI_MAXD(a, b) HYI_I(hyi_max_doubles)(a, b)
#define HYI_LTD(a, b) HYI_I(hyi_lt_doubles)(a, b)
#define HYI_PIND(a) HYI_I(hyi_pin_doubles)(a)
