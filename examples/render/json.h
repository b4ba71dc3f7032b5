/* json.h: a small JSON reader: the text becomes one flat array of values */
#ifndef JSON_H
#define JSON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef enum json_kind { JSON_NULL, JSON_BOOL, JSON_NUMBER, JSON_STRING, JSON_ARRAY, JSON_OBJECT } json_kind;

/* The children of an array or object follow it; next is the first value behind all of them. In an object every
   second child is a key. Strings keep their escapes. */
typedef struct json_value {
    json_kind kind;
    const char *text;
    size_t length;
    uint32_t next;
} json_value;

typedef struct json_document {
    json_value *values;
    uint32_t count, capacity;
} json_document;

/* NULL, or what is wrong with the text. The document points into the text. Free it in either case. */
const char *json_parse(json_document *document, const char *text, size_t length);
void json_free(json_document *document);

/* A position in the document; 0 is the whole, JSON_NONE is nothing, and everything about nothing is nothing. */
#define JSON_NONE UINT32_MAX
uint32_t json_get(const json_document *document, uint32_t object, const char *key);
uint32_t json_first(const json_document *document, uint32_t parent);
uint32_t json_next(const json_document *document, uint32_t parent, uint32_t child);
uint32_t json_at(const json_document *document, uint32_t array, size_t index);
size_t json_count(const json_document *document, uint32_t array);
double json_number(const json_document *document, uint32_t value, double fallback);
/* Reads up to count numbers of an array and returns how many it found. */
size_t json_numbers(const json_document *document, uint32_t array, float *numbers, size_t count);
bool json_is(const json_document *document, uint32_t value, const char *text);

#endif
