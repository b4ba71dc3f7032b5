/* >>base-platform: compiler, instruction sets, atomics, threads, time */
#ifndef HYI_PLATFORM_H
#define HYI_PLATFORM_H

#ifndef HYDRA_H
#include "../api.h"
#endif

#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#ifndef WIN32_LEAN_AND_MEAN
#define WIN32_LEAN_AND_MEAN
#endif
#ifndef NOMINMAX
#define NOMINMAX
#endif
#include <windows.h>
#else
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>
#if !defined(HYDRA_NO_THREADS)
#include <pthread.h>
#endif
#endif

#if defined(__GNUC__) || defined(__clang__)
#define HYI_GNU 1
#define HYI_INLINE static inline __attribute__((always_inline, unused))
#define HYI_NOINLINE static __attribute__((noinline, unused))
#define HYI_FN static __attribute__((unused))
#define HYI_PRINTF(text, first) __attribute__((format(printf, text, first)))
#define HYI_PREFETCH(p) __builtin_prefetch(p)
#define HYI_LIKELY(x) __builtin_expect(!!(x), 1)
#define HYI_UNLIKELY(x) __builtin_expect(!!(x), 0)
#else
#define HYI_GNU 0
#define HYI_INLINE static inline
#define HYI_NOINLINE static
#define HYI_FN static
#define HYI_PRINTF(text, first)
#define HYI_PREFETCH(p) ((void)(p))
#define HYI_LIKELY(x) (x)
#define HYI_UNLIKELY(x) (x)
#endif

#if !defined(HYDRA_NO_SIMD) && (defined(__x86_64__) || defined(_M_X64))
#define HYI_X86 1
#include <immintrin.h>
#if !HYI_GNU
#include <intrin.h>
#endif
#else
#define HYI_X86 0
#endif
#if !defined(HYDRA_NO_SIMD) && defined(__aarch64__)
#define HYI_NEON 1
#include <arm_neon.h>
#else
#define HYI_NEON 0
#endif
/* Functions that use one instruction set, chosen at run time. FMA may merge products and sums in them: where
   the watertight triangle test stands on separate rounding, that is pinned by hyi_rounded and its kin. */
#if HYI_X86 && HYI_GNU
#define HYI_SSE42 __attribute__((target("sse4.2,popcnt")))
#define HYI_AVX2 __attribute__((target("avx2,fma,bmi,lzcnt,popcnt")))
#define HYI_AVX512 __attribute__((target("avx512f,avx512bw,avx512vl,avx512dq,avx2,fma,bmi,lzcnt,popcnt")))
#else
#define HYI_SSE42
#define HYI_AVX2
#define HYI_AVX512
#endif

/* Returns from the enclosing function on anything but HYDRA_OK. */
#define HYI_TRY(expression)                            \
    do {                                               \
        hydra_result hyi_try_result = (expression);    \
        if (hyi_try_result != HYDRA_OK) return hyi_try_result; \
    } while (0)

#define HYI_PI 3.14159265358979323846
#define HYI_COUNT(array) (sizeof(array) / sizeof((array)[0]))
/* A declaration that may be repeated, of a function that is never defined. */
#define HYI_STATIC_ASSERT(condition) extern void hyi_assert_holds(char (*)[(condition) ? 1 : -1])

/* A product kept as its own rounded value: with FMA or fast-math the compiler would otherwise merge it
   into a following sum. Costs no instruction. */
HYI_INLINE float hyi_rounded(float product) {
#if HYI_GNU && defined(__x86_64__)
    __asm__("" : "+v"(product));
#elif HYI_GNU && defined(__aarch64__)
    __asm__("" : "+w"(product));
#endif
    return product;
}

/* Asks for the cache line at address ahead of its use. */
HYI_INLINE void hyi_prefetch(const void *address) {
#if HYI_GNU
    __builtin_prefetch(address);
#elif HYI_X86
    _mm_prefetch((const char *)address, _MM_HINT_T0);
#else
    (void)address;
#endif
}

/* The same from farther ahead, into the second cache: many more lines can be on their way to there than to the first. */
HYI_INLINE void hyi_prefetch_early(const void *address) {
#if HYI_GNU
    __builtin_prefetch(address, 0, 2);
#elif HYI_X86
    _mm_prefetch((const char *)address, _MM_HINT_T1);
#else
    (void)address;
#endif
}

/* Which thread this is; never 0. */
HYI_INLINE int64_t hyi_this_thread(void) {
#if defined(HYDRA_NO_THREADS)
    return 1;
#elif defined(_WIN32)
    return (int64_t)GetCurrentThreadId();
#else
    return (int64_t)(uintptr_t)pthread_self();
#endif
}

/* ---- atomics, all sequentially consistent: they are used per tile, never per ray */

typedef struct hyi_atomic { int64_t value; } hyi_atomic;

HYI_INLINE int64_t hyi_atomic_add(hyi_atomic *a, int64_t amount) {
#if HYI_GNU
    return __atomic_fetch_add(&a->value, amount, __ATOMIC_SEQ_CST);
#else
    return _InterlockedExchangeAdd64((volatile __int64 *)&a->value, amount);
#endif
}

HYI_INLINE int64_t hyi_atomic_load(const hyi_atomic *a) {
#if HYI_GNU
    return __atomic_load_n(&a->value, __ATOMIC_SEQ_CST);
#else
    return _InterlockedCompareExchange64((volatile __int64 *)&a->value, 0, 0);
#endif
}

HYI_INLINE void hyi_atomic_store(hyi_atomic *a, int64_t value) {
#if HYI_GNU
    __atomic_store_n(&a->value, value, __ATOMIC_SEQ_CST);
#else
    _InterlockedExchange64((volatile __int64 *)&a->value, value);
#endif
}

/* Returns whether value was expected and is now desired. */
HYI_INLINE bool hyi_atomic_swap_if(hyi_atomic *a, int64_t expected, int64_t desired) {
#if HYI_GNU
    return __atomic_compare_exchange_n(&a->value, &expected, desired, false, __ATOMIC_SEQ_CST, __ATOMIC_SEQ_CST);
#else
    return _InterlockedCompareExchange64((volatile __int64 *)&a->value, desired, expected) == expected;
#endif
}

/* Raises the atomic to at least value. */
HYI_INLINE void hyi_atomic_raise(hyi_atomic *a, int64_t value) {
    int64_t seen = hyi_atomic_load(a);
    while (seen < value && !hyi_atomic_swap_if(a, seen, value)) seen = hyi_atomic_load(a);
}

/* ---- time and machine */

/* Seconds on a clock that never goes back. */
HYI_FN double hyi_seconds(void) {
#if defined(_WIN32)
    LARGE_INTEGER now, frequency;
    QueryPerformanceCounter(&now);
    QueryPerformanceFrequency(&frequency);
    return (double)now.QuadPart / (double)frequency.QuadPart;
#else
#if defined(CLOCK_MONOTONIC)
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
#else /* strict C99, and a system header came before this one: POSIX clocks are hidden */
    struct timeval now;
    gettimeofday(&now, NULL);
    return (double)now.tv_sec + 1e-6 * (double)now.tv_usec;
#endif
#endif
}

HYI_FN uint32_t hyi_processor_count(void) {
#if defined(_WIN32)
    SYSTEM_INFO info;
    GetSystemInfo(&info);
    return info.dwNumberOfProcessors ? (uint32_t)info.dwNumberOfProcessors : 1u;
#else
    long n = sysconf(_SC_NPROCESSORS_ONLN);
    return n > 0 ? (uint32_t)n : 1u;
#endif
}

HYI_FN bool hyi_has_sse42(void) {
#if HYI_X86 && HYI_GNU
    return __builtin_cpu_supports("sse4.2") && __builtin_cpu_supports("popcnt");
#elif HYI_X86
    int leaf1[4];
    __cpuid(leaf1, 1);
    return (leaf1[2] & (1 << 20)) && (leaf1[2] & (1 << 23));
#else
    return false;
#endif
}

HYI_FN bool hyi_has_avx2(void) {
#if HYI_X86 && HYI_GNU
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi");
#elif HYI_X86
    int leaf1[4], leaf7[4];
    __cpuid(leaf1, 1);
    __cpuidex(leaf7, 7, 0);
    return (leaf1[2] & (1 << 27)) && (leaf1[2] & (1 << 12)) && (_xgetbv(0) & 6) == 6 && (leaf7[1] & (1 << 5)) && (leaf7[1] & (1 << 3));
#else
    return false;
#endif
}

HYI_FN bool hyi_has_avx512(void) {
#if HYI_X86 && HYI_GNU
    return hyi_has_avx2() && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") &&
           __builtin_cpu_supports("avx512vl");
#elif HYI_X86
    int leaf7[4];
    __cpuidex(leaf7, 7, 0);
    const int needed = 1 << 16 | 1 << 17 | 1 << 30 | (int)(1u << 31);
    return hyi_has_avx2() && (_xgetbv(0) & 0xe6) == 0xe6 && (leaf7[1] & needed) == needed;
#else
    return false;
#endif
}

#endif /* HYI_PLATFORM_H */
