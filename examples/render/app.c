/* app.c: messages, clock, files and memory */
#include "app.h"

#include <errno.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { WARNING_KINDS = 64, WARNINGS_SHOWN = 5 };

static bool app_quiet;
static const char *warning_formats[WARNING_KINDS];
static unsigned warning_counts[WARNING_KINDS];

void app_set_quiet(bool quiet) { app_quiet = quiet; }

bool app_is_quiet(void) { return app_quiet; }

void app_error(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    fputs("hydra-render: error: ", stderr);
    vfprintf(stderr, format, arguments);
    fputc('\n', stderr);
    va_end(arguments);
}

/* How often this kind of warning came, this time included. */
static unsigned count_warning(const char *format) {
    for (size_t i = 0; i < WARNING_KINDS; i++) {
        if (warning_formats[i] == NULL) warning_formats[i] = format;
        if (warning_formats[i] == format) return ++warning_counts[i];
    }
    return 1;
}

void app_warning(const char *format, ...) {
    if (app_quiet || count_warning(format) > WARNINGS_SHOWN) return;
    va_list arguments;
    va_start(arguments, format);
    fputs("hydra-render: warning: ", stderr);
    vfprintf(stderr, format, arguments);
    fputc('\n', stderr);
    va_end(arguments);
}

void app_flush_warnings(void) {
    unsigned hidden = 0;
    for (size_t i = 0; i < WARNING_KINDS; i++) {
        if (warning_counts[i] > WARNINGS_SHOWN) hidden += warning_counts[i] - WARNINGS_SHOWN;
        warning_formats[i] = NULL;
        warning_counts[i] = 0;
    }
    if (hidden > 0 && !app_quiet) fprintf(stderr, "hydra-render: warning: %u more like these\n", hidden);
}

double app_seconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static char *read_stream(FILE *file, const char *path, size_t limit, size_t *size) {
    char *text = NULL;
    size_t used = 0, capacity = 0, got;
    do {
        if (used == capacity) {
            capacity = capacity ? 2 * capacity : (size_t)1 << 16;
            text = app_realloc(text, capacity + 1, 1);
        }
        got = fread(text + used, 1, capacity - used, file);
        used += got;
    } while (got > 0 && used <= limit);
    text[used] = '\0';
    *size = used;
    if (used <= limit && !ferror(file)) return text;
    if (ferror(file))
        app_error("%s: cannot be read: %s", path, strerror(errno));
    else
        app_error("%s: is larger than %zu MiB", path, limit >> 20);
    free(text);
    return NULL;
}

char *app_read_file(const char *path, size_t limit, size_t *size) {
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        app_error("%s: cannot be opened: %s", path, strerror(errno));
        return NULL;
    }
    char *text = read_stream(file, path, limit, size);
    fclose(file);
    return text;
}

void *app_realloc(void *memory, size_t count, size_t size) {
    void *grown = count <= SIZE_MAX / size ? realloc(memory, count > 0 ? count * size : 1) : NULL;
    if (grown == NULL) {
        app_error("out of memory (%zu elements of %zu bytes)", count, size);
        exit(APP_DEVICE);
    }
    return grown;
}

void *app_alloc(size_t count, size_t size) { return app_realloc(NULL, count, size); }

char *app_copy(const char *text) {
    size_t length = strlen(text) + 1;
    return memcpy(app_alloc(length, 1), text, length);
}
