/* Runs the groups of all test files, or of those that the arguments name, and ends with

       N passed, N failed

   where skipped tests are counted neither way (a line before tells how many). Built with HT_VULKAN, it runs them on
   a Vulkan device: then any message of the validation layer is a failure, and where there is no loader or device it
   says so and succeeds. subjects.h is made by
   the Makefile from the names of the test files: HT_SUBJECT(name) for each tests/test_<name>.c. */
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "hydra_test_run.h"

#define HT_SUBJECT(name) int hydra_test_##name(void);
#include "subjects.h"
#undef HT_SUBJECT

typedef struct subject {
    const char *name;
    int (*run)(void);
    double seconds;
    ht_totals totals;
    bool chosen;
} subject;

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void run(subject *s) {
    ht_totals before = ht_total;
    double start = now();
    int result = s->run();
    s->seconds = now() - start;
    if (ht_total.groups == before.groups || (result != 0 && ht_total.failed == before.failed)) {
        printf("%s: its group did not run, or not through hydra_test.h\n", s->name);
        ht_total.failed++;
    }
    s->totals.passed = ht_total.passed - before.passed;
    s->totals.failed = ht_total.failed - before.failed;
    s->totals.skipped = ht_total.skipped - before.skipped;
    fflush(stdout);
}

static bool choose(subject *subjects, size_t count, const char *name) {
    for (size_t i = 0; i < count; i++) {
        if (strcmp(subjects[i].name, name) == 0) return subjects[i].chosen = true;
    }
    printf("no subject \"%s\"; there are:", name);
    for (size_t i = 0; i < count; i++) printf(" %s", subjects[i].name);
    printf("\n");
    return false;
}

static bool on_device;

static bool find_device(void) {
    char text[512];
    ht_device device = ht_find_device(text, sizeof text);
    on_device = device == HT_DEVICE_READY && *text;
    if (device == HT_DEVICE_NONE) printf("no Vulkan loader or device: %s\n", text);
    if (device == HT_DEVICE_NOT_WATCHED) printf("FAILED to run on Vulkan with validation: %s\n", text);
    if (on_device) printf("on Vulkan: %s\n", text);
    ht_idle = device == HT_DEVICE_NONE;
    return device != HT_DEVICE_NOT_WATCHED;
}

static void count_messages(void) {
    uint64_t messages = ht_validation_messages();
    ht_device_totals made = ht_device_total();
    if (on_device)
        printf("%llu validation messages%s from %llu contexts; %llu pipelines made in %.1f s\n", (unsigned long long)messages,
               messages ? ": FAILED," : "", (unsigned long long)made.contexts, (unsigned long long)made.pipelines, made.seconds_pipelines);
    if (messages) ht_total.failed++;
}

int main(int argc, char **argv) {
    subject subjects[] = {
#define HT_SUBJECT(name) {#name, hydra_test_##name, 0, {0, 0, 0, 0}, false},
#include "subjects.h"
#undef HT_SUBJECT
    };
    const size_t count = sizeof subjects / sizeof subjects[0];
    for (int i = 1; i < argc; i++) {
        if (!choose(subjects, count, argv[i])) return 2;
    }
    if (!find_device()) return 1;
    for (size_t i = 0; i < count; i++) {
        if (argc == 1) subjects[i].chosen = true;
        if (subjects[i].chosen) run(&subjects[i]);
    }
    if (ht_idle) {
        printf("no Vulkan loader or device: %llu tests not run on Vulkan\n0 passed, 0 failed\n", (unsigned long long)ht_total.skipped);
        return 0;
    }
    printf("\n%-24s %8s %8s %8s %9s\n", "subject", "passed", "failed", "skipped", "seconds");
    for (size_t i = 0; i < count; i++) {
        const subject *s = &subjects[i];
        if (!s->chosen) continue;
        printf("%-24s %8llu %8llu %8llu %9.2f\n", s->name, (unsigned long long)s->totals.passed, (unsigned long long)s->totals.failed,
               (unsigned long long)s->totals.skipped, s->seconds);
    }
    count_messages();
    if (ht_total.skipped) printf("%llu skipped\n", (unsigned long long)ht_total.skipped);
    printf("%llu passed, %llu failed\n", (unsigned long long)ht_total.passed, (unsigned long long)ht_total.failed);
    return ht_total.failed != 0 || ht_total.passed == 0;
}
