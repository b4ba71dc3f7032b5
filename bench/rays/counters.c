/* What the processor counts while a tracer runs: instructions, cycles, cache misses. Linux only, and only where the
   machine, virtual or not, lets programs count. */
#include "rays.h"

#include <stdio.h>
#include <string.h>

#ifdef __linux__
#include <errno.h>
#include <linux/perf_event.h>
#include <sys/ioctl.h>
#include <sys/syscall.h>
#include <unistd.h>

static const uint64_t events[COUNTERS] = {PERF_COUNT_HW_INSTRUCTIONS, PERF_COUNT_HW_CPU_CYCLES, PERF_COUNT_HW_CACHE_MISSES};

static int open_event(uint64_t event, int group) {
    struct perf_event_attr attr;
    memset(&attr, 0, sizeof attr);
    attr.type = PERF_TYPE_HARDWARE;
    attr.size = sizeof attr;
    attr.config = event;
    attr.disabled = group < 0;
    attr.exclude_kernel = attr.exclude_hv = 1;
    return (int)syscall(SYS_perf_event_open, &attr, 0, -1, group, 0);
}

static bool open_all(int files[COUNTERS]) {
    for (int i = 0; i < COUNTERS; i++) {
        files[i] = open_event(events[i], i ? files[0] : -1);
        if (files[i] >= 0) continue;
        while (i-- > 0) close(files[i]);
        return false;
    }
    return true;
}

bool counters_work(void) {
    int files[COUNTERS];
    if (!open_all(files)) {
        printf("instructions, cycles and cache misses per ray: not counted, perf_event_open: %s\n", strerror(errno));
        return false;
    }
    for (int i = 0; i < COUNTERS; i++) close(files[i]);
    return true;
}

void trace_counted(const tracer *t, size_t count, double counted[COUNTERS]) {
    int files[COUNTERS];
    if (!open_all(files)) return;
    ioctl(files[0], PERF_EVENT_IOC_RESET, PERF_IOC_FLAG_GROUP);
    ioctl(files[0], PERF_EVENT_IOC_ENABLE, PERF_IOC_FLAG_GROUP);
    t->trace(t, 0, count);
    ioctl(files[0], PERF_EVENT_IOC_DISABLE, PERF_IOC_FLAG_GROUP);
    for (int i = 0; i < COUNTERS; i++) {
        uint64_t value = 0;
        if (read(files[i], &value, sizeof value) == (ssize_t)sizeof value) counted[i] = (double)value / (double)count;
        close(files[i]);
    }
}

#else

bool counters_work(void) {
    printf("instructions, cycles and cache misses per ray: not counted, this is not Linux\n");
    return false;
}

void trace_counted(const tracer *t, size_t count, double counted[COUNTERS]) { (void)t, (void)count, (void)counted; }

#endif
