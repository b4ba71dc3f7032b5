/* guard.c: see guard.h. The handler only writes and leaves: nothing of the damaged process is used again. */
#define _XOPEN_SOURCE 700 /* sigaltstack */
#include "guard.h"

#include "app.h"

#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

/* Sanitizers reserve terabytes of address space and must not be limited. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || !defined(_SC_PHYS_PAGES)
#define GUARD_NO_MEMORY_LIMIT
#endif

enum { GUARD_SECONDS = 300, GUARD_STACK = 1 << 16 };

static const int guarded[] = {SIGSEGV, SIGBUS, SIGABRT, SIGFPE, SIGILL, SIGALRM};
enum { GUARDED = sizeof guarded / sizeof guarded[0] };

static struct sigaction previous[GUARDED];
static struct rlimit previous_memory;
static char guarded_path[1024];
static void *signal_stack;

static void say(const char *text) {
    ssize_t ignored = write(STDERR_FILENO, text, strlen(text));
    (void)ignored;
}

static void leave(int signal_number) {
    say("hydra-render: error: ");
    say(guarded_path);
    say(signal_number == SIGALRM ? ": the importer did not finish in 5 minutes" : ": the importer crashed on it");
    say("; the file is damaged, or of a kind that assimp reads badly: convert it to glTF 2.0\n");
    _exit(APP_INPUT);
}

#if defined(GUARD_NO_MEMORY_LIMIT)
static void limit_memory(const char *path) { (void)path; }
#else
/* Pages of address space in use, thread stacks included; 0 where the system does not tell. */
static rlim_t pages_in_use(void) {
    unsigned long pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    if (file == NULL) return 0;
    if (fscanf(file, "%lu", &pages) != 1) pages = 0;
    fclose(file);
    return (rlim_t)pages;
}

/* glTF alone has its data in other files. All others get 2 GiB and 256 bytes for each of their own. */
static rlim_t memory_needed(const char *path, rlim_t most) {
    const char *dot = strrchr(path, '.');
    struct stat file;
    bool is_gltf = dot != NULL && (strcasecmp(dot, ".gltf") == 0 || strcasecmp(dot, ".glb") == 0);
    if (is_gltf || stat(path, &file) != 0) return most;
    rlim_t own = ((rlim_t)2 << 30) + 256 * (rlim_t)file.st_size;
    return own < most ? own : most;
}

/* A damaged count then fails soon, and does not swap the machine to death. */
static void limit_memory(const char *path) {
    long pages = sysconf(_SC_PHYS_PAGES), page = sysconf(_SC_PAGESIZE);
    struct rlimit limit = previous_memory;
    if (pages <= 0 || page <= 0) return;
    rlim_t wanted = memory_needed(path, (rlim_t)pages / 4 * 3 * (rlim_t)page) + pages_in_use() * (rlim_t)page;
    if (limit.rlim_cur == RLIM_INFINITY || limit.rlim_cur > wanted) limit.rlim_cur = wanted;
    setrlimit(RLIMIT_AS, &limit);
}
#endif

void guard_begin(const char *path) {
    strncpy(guarded_path, path, sizeof guarded_path - 1);
    stack_t stack;
    memset(&stack, 0, sizeof stack);
    signal_stack = app_alloc(GUARD_STACK, 1);
    stack.ss_sp = signal_stack;
    stack.ss_size = GUARD_STACK;
    sigaltstack(&stack, NULL);
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = leave;
    action.sa_flags = SA_ONSTACK | (int)SA_RESETHAND;
    for (int i = 0; i < GUARDED; i++) sigaction(guarded[i], &action, &previous[i]);
    getrlimit(RLIMIT_AS, &previous_memory);
    limit_memory(path);
    alarm(GUARD_SECONDS);
}

void guard_end(void) {
    alarm(0);
    setrlimit(RLIMIT_AS, &previous_memory);
    for (int i = 0; i < GUARDED; i++) sigaction(guarded[i], &previous[i], NULL);
    stack_t none;
    memset(&none, 0, sizeof none);
    none.ss_flags = SS_DISABLE;
    none.ss_size = GUARD_STACK;
    sigaltstack(&none, NULL);
    free(signal_stack);
    signal_stack = NULL;
}
