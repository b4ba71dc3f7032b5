/* What hydra_test.c counted, for main.c. */
#ifndef HYDRA_TEST_RUN_H
#define HYDRA_TEST_RUN_H

#include <stdint.h>

typedef struct ht_totals {
    uint64_t groups, passed, failed, skipped;
} ht_totals;

extern ht_totals ht_total;

#endif /* HYDRA_TEST_RUN_H */
