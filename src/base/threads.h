/* >>base-threads: a pool that runs one loop at a time */
#ifndef HYI_THREADS_H
#define HYI_THREADS_H

#include "context.h"

typedef void (*hyi_task)(void *argument, uint32_t index);

#if !defined(HYDRA_NO_THREADS)

#if defined(_WIN32)
typedef SRWLOCK hyi_mutex;
typedef CONDITION_VARIABLE hyi_condition;
typedef HANDLE hyi_thread;
#define hyi_mutex_init(m) InitializeSRWLock(m)
#define hyi_mutex_lock(m) AcquireSRWLockExclusive(m)
#define hyi_mutex_unlock(m) ReleaseSRWLockExclusive(m)
#define hyi_mutex_destroy(m) ((void)(m))
#define hyi_condition_init(c) InitializeConditionVariable(c)
#define hyi_condition_wait(c, m) SleepConditionVariableSRW((c), (m), INFINITE, 0)
#define hyi_condition_wake_all(c) WakeAllConditionVariable(c)
#define hyi_condition_destroy(c) ((void)(c))
#else
typedef pthread_mutex_t hyi_mutex;
typedef pthread_cond_t hyi_condition;
typedef pthread_t hyi_thread;
#define hyi_mutex_init(m) pthread_mutex_init((m), NULL)
#define hyi_mutex_lock(m) pthread_mutex_lock(m)
#define hyi_mutex_unlock(m) pthread_mutex_unlock(m)
#define hyi_mutex_destroy(m) pthread_mutex_destroy(m)
#define hyi_condition_init(c) pthread_cond_init((c), NULL)
#define hyi_condition_wait(c, m) pthread_cond_wait((c), (m))
#define hyi_condition_wake_all(c) pthread_cond_broadcast(c)
#define hyi_condition_destroy(c) pthread_cond_destroy(c)
#endif

struct hyi_pool {
    hyi_mutex mutex;
    hyi_condition work_is_there, work_is_done;
    hyi_task task;
    void *argument;
    uint32_t count;
    hyi_atomic next;      /* first index nobody has taken */
    uint64_t generation;  /* of the loop in work; under mutex, like the rest */
    uint32_t busy;        /* workers inside the loop */
    uint32_t workers;     /* started threads; the caller works too */
    bool quit;
    hyi_thread *threads;
};

HYI_FN void hyi_pool_work(hyi_pool *pool) {
    for (;;) {
        int64_t index = hyi_atomic_add(&pool->next, 1);
        if (index >= (int64_t)pool->count) return;
        pool->task(pool->argument, (uint32_t)index);
    }
}

#if defined(_WIN32)
static DWORD WINAPI hyi_pool_thread(void *argument)
#else
static void *hyi_pool_thread(void *argument)
#endif
{
    hyi_pool *pool = (hyi_pool *)argument;
    uint64_t done = 0;
    hyi_mutex_lock(&pool->mutex);
    for (;;) {
        while (!pool->quit && pool->generation == done) hyi_condition_wait(&pool->work_is_there, &pool->mutex);
        if (pool->quit) break;
        done = pool->generation;
        hyi_mutex_unlock(&pool->mutex);
        hyi_pool_work(pool);
        hyi_mutex_lock(&pool->mutex);
        if (--pool->busy == 0) hyi_condition_wake_all(&pool->work_is_done);
    }
    hyi_mutex_unlock(&pool->mutex);
    return 0;
}

HYI_FN void hyi_pool_run(hyi_pool *pool, uint32_t count, hyi_task task, void *argument) {
    hyi_mutex_lock(&pool->mutex);
    pool->task = task;
    pool->argument = argument;
    pool->count = count;
    hyi_atomic_store(&pool->next, 0);
    pool->busy = pool->workers;
    pool->generation++;
    hyi_condition_wake_all(&pool->work_is_there);
    hyi_mutex_unlock(&pool->mutex);
    hyi_pool_work(pool);
    hyi_mutex_lock(&pool->mutex);
    while (pool->busy) hyi_condition_wait(&pool->work_is_done, &pool->mutex);
    hyi_mutex_unlock(&pool->mutex);
}

HYI_FN bool hyi_thread_start(hyi_thread *thread, hyi_pool *pool) {
#if defined(_WIN32)
    *thread = CreateThread(NULL, 0, hyi_pool_thread, pool, 0, NULL);
    return *thread != NULL;
#else
    return pthread_create(thread, NULL, hyi_pool_thread, pool) == 0;
#endif
}

HYI_FN void hyi_thread_join(hyi_thread thread) {
#if defined(_WIN32)
    WaitForSingleObject(thread, INFINITE);
    CloseHandle(thread);
#else
    pthread_join(thread, NULL);
#endif
}

HYI_FN void hyi_pool_destroy(hydra_context *context) {
    hyi_pool *pool = context->pool;
    if (!pool) return;
    hyi_mutex_lock(&pool->mutex);
    pool->quit = true;
    hyi_condition_wake_all(&pool->work_is_there);
    hyi_mutex_unlock(&pool->mutex);
    for (uint32_t i = 0; i < pool->workers; i++) hyi_thread_join(pool->threads[i]);
    hyi_condition_destroy(&pool->work_is_there);
    hyi_condition_destroy(&pool->work_is_done);
    hyi_mutex_destroy(&pool->mutex);
    hyi_free_array(context, &pool->threads, context->threads - 1);
    hyi_free_array(context, &context->pool, 1);
}

/* Starts threads - 1 workers: the calling thread is the last one. */
HYI_FN hydra_result hyi_pool_create(hydra_context *context) {
    HYI_TRY(hyi_alloc_array(context, &context->pool, 1));
    hyi_pool *pool = context->pool;
    memset(pool, 0, sizeof *pool);
    if (hyi_alloc_array(context, &pool->threads, context->threads - 1) != HYDRA_OK) {
        hyi_free_array(context, &context->pool, 1);
        return HYDRA_ERROR_OUT_OF_MEMORY;
    }
    hyi_mutex_init(&pool->mutex);
    hyi_condition_init(&pool->work_is_there);
    hyi_condition_init(&pool->work_is_done);
    while (pool->workers < context->threads - 1 && hyi_thread_start(&pool->threads[pool->workers], pool)) pool->workers++;
    if (pool->workers == context->threads - 1) return HYDRA_OK;
    hyi_pool_destroy(context);
    return HYDRA_ERROR_THREADS;
}

#endif /* HYDRA_NO_THREADS */

/* Calls task(argument, i) for every i < count on the context's threads, and returns when all are done.
   Loops do not nest. */
HYI_FN void hyi_parallel(const hydra_context *context, uint32_t count, hyi_task task, void *argument) {
    if (count == 0) return;
    if (context->desc.parallel_for) {
        context->desc.parallel_for(context->desc.parallel_user, count, task, argument);
        return;
    }
#if !defined(HYDRA_NO_THREADS)
    if (context->pool && count > 1) {
        hyi_pool_run(context->pool, count, task, argument);
        return;
    }
#endif
    for (uint32_t i = 0; i < count; i++) task(argument, i);
}

#endif /* HYI_THREADS_H */
