/* json.c: see json.h. One pass, no recursion deeper than the nesting limit, no allocation but the array. */
#include "json.h"

#include "app.h"

#include <stdlib.h>
#include <string.h>

enum { NESTING_LIMIT = 128, NUMBER_LIMIT = 64 };

typedef struct reader {
    json_document *document;
    const char *at, *end;
    const char *error;
} reader;

static const char *parse_failed(reader *in, const char *error) {
    if (in->error == NULL) in->error = error;
    return in->error;
}

static void skip_space(reader *in) {
    while (in->at < in->end && (*in->at == ' ' || *in->at == '\t' || *in->at == '\n' || *in->at == '\r')) in->at++;
}

static uint32_t push(reader *in, json_kind kind, const char *text) {
    json_document *document = in->document;
    if (document->count == document->capacity) {
        document->capacity = document->capacity ? 2 * document->capacity : 1024;
        document->values = app_realloc(document->values, document->capacity, sizeof(json_value));
    }
    json_value *value = &document->values[document->count];
    value->kind = kind;
    value->text = text;
    value->length = 0;
    value->next = document->count + 1;
    return document->count++;
}

static const char *parse_string(reader *in) {
    uint32_t value = push(in, JSON_STRING, ++in->at);
    while (in->at < in->end && *in->at != '"') {
        if (*in->at == '\\') in->at++;
        in->at++;
    }
    if (in->at >= in->end) return parse_failed(in, "a string does not end");
    in->document->values[value].length = (size_t)(in->at - in->document->values[value].text);
    in->at++;
    return NULL;
}

static const char *parse_word(reader *in) {
    const char *start = in->at;
    while (in->at < in->end && strchr("+-.0123456789abcdefghijklmnopqrstuvwxyzE", *in->at) != NULL && *in->at) in->at++;
    size_t length = (size_t)(in->at - start);
    if (length == 0) return parse_failed(in, "an unexpected character");
    json_kind kind = JSON_NUMBER;
    if (*start == 'n') kind = JSON_NULL;
    if (*start == 't' || *start == 'f') kind = JSON_BOOL;
    uint32_t value = push(in, kind, start);
    in->document->values[value].length = length;
    return NULL;
}

static const char *parse_value(reader *in, int depth);

static const char *parse_member(reader *in, bool keyed, int depth) {
    if (keyed) {
        skip_space(in);
        if (in->at >= in->end || *in->at != '"') return parse_failed(in, "a key is missing");
        if (parse_string(in) != NULL) return in->error;
        skip_space(in);
        if (in->at >= in->end || *in->at != ':') return parse_failed(in, "a colon is missing");
        in->at++;
    }
    return parse_value(in, depth + 1);
}

static const char *parse_group(reader *in, int depth) {
    bool keyed = *in->at == '{';
    char close = keyed ? '}' : ']';
    uint32_t value = push(in, keyed ? JSON_OBJECT : JSON_ARRAY, in->at++);
    if (depth >= NESTING_LIMIT) return parse_failed(in, "nested too deeply");
    skip_space(in);
    bool more = in->at < in->end && *in->at != close;
    while (more) {
        if (parse_member(in, keyed, depth) != NULL) return in->error;
        skip_space(in);
        more = in->at < in->end && *in->at == ',';
        if (more) in->at++;
    }
    if (in->at >= in->end || *in->at != close) return parse_failed(in, "a bracket is not closed");
    in->at++;
    in->document->values[value].next = in->document->count;
    return NULL;
}

static const char *parse_value(reader *in, int depth) {
    skip_space(in);
    if (in->at >= in->end) return parse_failed(in, "the text ends early");
    if (in->document->count > UINT32_MAX / 4) return parse_failed(in, "too many values");
    if (*in->at == '{' || *in->at == '[') return parse_group(in, depth);
    if (*in->at == '"') return parse_string(in);
    return parse_word(in);
}

const char *json_parse(json_document *document, const char *text, size_t length) {
    reader in = {document, text, text + length, NULL};
    memset(document, 0, sizeof *document);
    return parse_value(&in, 0);
}

void json_free(json_document *document) {
    free(document->values);
    memset(document, 0, sizeof *document);
}

static bool is_kind(const json_document *document, uint32_t value, json_kind kind) {
    return value < document->count && document->values[value].kind == kind;
}

bool json_is(const json_document *document, uint32_t value, const char *text) {
    if (!is_kind(document, value, JSON_STRING)) return false;
    const json_value *string = &document->values[value];
    return string->length == strlen(text) && memcmp(string->text, text, string->length) == 0;
}

uint32_t json_first(const json_document *document, uint32_t parent) {
    if (!is_kind(document, parent, JSON_ARRAY) && !is_kind(document, parent, JSON_OBJECT)) return JSON_NONE;
    return document->values[parent].next > parent + 1 ? parent + 1 : JSON_NONE;
}

uint32_t json_next(const json_document *document, uint32_t parent, uint32_t child) {
    if (child == JSON_NONE) return JSON_NONE;
    uint32_t next = document->values[child].next;
    return next < document->values[parent].next ? next : JSON_NONE;
}

uint32_t json_get(const json_document *document, uint32_t object, const char *key) {
    if (!is_kind(document, object, JSON_OBJECT)) return JSON_NONE;
    uint32_t name = json_first(document, object);
    while (name != JSON_NONE) {
        uint32_t value = json_next(document, object, name);
        if (json_is(document, name, key)) return value;
        name = json_next(document, object, value);
    }
    return JSON_NONE;
}

uint32_t json_at(const json_document *document, uint32_t array, size_t index) {
    if (!is_kind(document, array, JSON_ARRAY)) return JSON_NONE;
    uint32_t child = json_first(document, array);
    while (index-- > 0 && child != JSON_NONE) child = json_next(document, array, child);
    return child;
}

size_t json_count(const json_document *document, uint32_t array) {
    if (!is_kind(document, array, JSON_ARRAY)) return 0;
    size_t count = 0;
    for (uint32_t i = json_first(document, array); i != JSON_NONE; i = json_next(document, array, i)) count++;
    return count;
}

double json_number(const json_document *document, uint32_t value, double fallback) {
    if (!is_kind(document, value, JSON_NUMBER) || document->values[value].length >= NUMBER_LIMIT) return fallback;
    char digits[NUMBER_LIMIT];
    memcpy(digits, document->values[value].text, document->values[value].length);
    digits[document->values[value].length] = '\0';
    char *end;
    double number = strtod(digits, &end);
    return end != digits && *end == '\0' ? number : fallback;
}

size_t json_numbers(const json_document *document, uint32_t array, float *numbers, size_t count) {
    if (!is_kind(document, array, JSON_ARRAY)) return 0;
    uint32_t child = json_first(document, array);
    size_t found = 0;
    while (found < count && is_kind(document, child, JSON_NUMBER)) {
        numbers[found++] = (float)json_number(document, child, 0.0);
        child = json_next(document, array, child);
    }
    return found;
}
