/* What hydra_test.c counted and found, for main.c. */
#ifndef HYDRA_TEST_RUN_H
#define HYDRA_TEST_RUN_H

#include <stdbool.h>
#include <stdint.h>

typedef struct ht_totals {
    uint64_t groups, passed, failed, skipped;
} ht_totals;

extern ht_totals ht_total;
extern bool ht_idle; /* tests are counted as skipped, not run */

/* What the tests run on, found before the first of them. */
typedef enum ht_device {
    HT_DEVICE_NONE,        /* no Vulkan loader or device */
    HT_DEVICE_NOT_WATCHED, /* a device, but no validation layer */
    HT_DEVICE_READY        /* a device; without HT_VULKAN, the processor */
} ht_device;

/* text: the device's name, or what is missing; empty on the processor. */
ht_device ht_find_device(char *text, size_t size);
/* What the validation layer said and no test provoked; a provoked message that did not come counts as well. To be called
   when all contexts are gone: their device goes, too. */
uint64_t ht_validation_messages(void);

/* Contexts on the device that were destroyed, and what they had made. */
typedef struct ht_device_totals {
    uint64_t contexts, pipelines;
    double seconds_pipelines;
} ht_device_totals;

ht_device_totals ht_device_total(void);

#endif /* HYDRA_TEST_RUN_H */
