/* SPDX-License-Identifier: Apache-2.0 */
/* What can be said about a model file from its text alone: the place at which it is wrong. */
#include "cts/accuracy_model.h"

#include <ctype.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <yyjson.h>

struct text {
    const char *at, *end;
    uint64_t line; /* of the line last taken, from 1 */
    char *out_error;
    size_t error_size;
};

__attribute__((format(printf, 2, 3))) static bool wrong(struct text *text, const char *format, ...)
{
    va_list arguments;
    int used = snprintf(text->out_error, text->error_size, "line %llu: ", (unsigned long long)text->line);
    va_start(arguments, format);
    if (used > 0 && (size_t)used < text->error_size)
        vsnprintf(text->out_error + used, text->error_size - (size_t)used, format, arguments);
    va_end(arguments);
    return false;
}

/* The next line without its end, cut to the buffer. False at the end of the text. */
static bool next_line(struct text *text, char *out, size_t size)
{
    if (text->at >= text->end)
        return false;
    const char *stop = memchr(text->at, '\n', (size_t)(text->end - text->at));
    if (!stop)
        stop = text->end;
    size_t length = (size_t)(stop - text->at);
    if (length >= size)
        length = size - 1;
    memcpy(out, text->at, length);
    out[length] = 0;
    length = strlen(out);
    while (length && isspace((unsigned char)out[length - 1]))
        out[--length] = 0;
    text->at = stop + 1;
    text->line++;
    return true;
}

static bool check_numbers(struct text *text, const char *line, int count, const char *what)
{
    for (int i = 0; i < count; i++) {
        char *end;
        float value = strtof(line, &end);
        if (end == line)
            return wrong(text, "expected %d numbers for a %s, found %d", count, what, i);
        if (!isfinite(value))
            return wrong(text, "expected finite numbers for a %s, found '%.*s'", what, (int)(end - line),
                         line + strspn(line, " \t"));
        line = end;
    }
    return true;
}

/* Faces may name vertices that come later, so those are counted first. */
static bool check_obj(struct text text)
{
    char line[4096];
    struct text start = text;
    uint64_t total = 0, before = 0, normals = 0, coordinates = 0;
    while (next_line(&text, line, sizeof line)) {
        if (strncmp(line, "v ", 2) == 0 || strncmp(line, "v\t", 2) == 0) {
            total++;
            if (!check_numbers(&text, line + 1, 3, "vertex"))
                return false;
        } else if (strncmp(line, "vn ", 3) == 0) {
            normals++;
            if (!check_numbers(&text, line + 2, 3, "normal"))
                return false;
        } else if (strncmp(line, "vt ", 3) == 0) {
            coordinates++;
            if (!check_numbers(&text, line + 2, 1, "texture coordinate"))
                return false;
        }
    }
    text = start;
    while (next_line(&text, line, sizeof line)) {
        if (line[0] == 'v' && (line[1] == ' ' || line[1] == '\t'))
            before++;
        if (line[0] != 'f' || (line[1] != ' ' && line[1] != '\t'))
            continue;
        unsigned corners = 0;
        for (char *at = line + 1 + strspn(line + 1, " \t"); *at && *at != '#'; at += strspn(at, " \t")) {
            char *end;
            long long index = strtoll(at, &end, 10);
            /* A line with a continuation, or longer than the buffer, is left to the reader. */
            if (end == at && *at == '\\')
                break;
            if (end == at)
                return wrong(&text, "expected the number of a vertex, found '%.20s'", at);
            if (index == 0 || (index > 0 && (uint64_t)index > total) ||
                (index < 0 && (uint64_t)-index > before))
                return wrong(&text, "the face names vertex %lld, but the file has %llu", index,
                             (unsigned long long)total);
            for (int part = 0; part < 2 && *end == '/'; part++) {
                const uint64_t most = part ? normals : coordinates;
                char *from = end + 1;
                long long other = strtoll(from, &end, 10);
                if (end != from && (other == 0 || (uint64_t)llabs(other) > most))
                    return wrong(&text, "the face names %s %lld, but the file has %llu",
                                 part ? "normal" : "texture coordinate", other, (unsigned long long)most);
            }
            corners++;
            at = end + strcspn(end, " \t");
        }
        if (!corners)
            return wrong(&text, "a face without vertices");
    }
    return true;
}

static unsigned type_bytes(const char *name)
{
    static const struct {
        const char *name;
        unsigned bytes;
    } types[] = {{"char", 1},  {"uchar", 1},   {"int8", 1},   {"uint8", 1},  {"short", 2}, {"ushort", 2},
                 {"int16", 2}, {"uint16", 2},  {"int", 4},    {"uint", 4},   {"int32", 4}, {"uint32", 4},
                 {"float", 4}, {"float32", 4}, {"double", 8}, {"float64", 8}};
    for (size_t i = 0; i < sizeof types / sizeof types[0]; i++)
        if (strcmp(types[i].name, name) == 0)
            return types[i].bytes;
    return 0;
}

/* The elements that a PLY header declares, as far as text has to be looked at for them. */
struct ply_element {
    uint64_t count;
    uint32_t plain, lists; /* properties; a list among others, wherever it stands, has its own length */
};

/* The next word of the text; counts lines. NULL at the end. */
static const char *next_word(struct text *text, size_t *out_length)
{
    while (text->at < text->end && isspace((unsigned char)*text->at))
        text->line += *text->at++ == '\n';
    const char *from = text->at;
    while (text->at < text->end && !isspace((unsigned char)*text->at))
        text->at++;
    *out_length = (size_t)(text->at - from);
    return *out_length ? from : NULL;
}

static bool next_number(struct text *text, double *out)
{
    char word[64], *end;
    size_t length;
    const char *from = next_word(text, &length);
    if (!from)
        return wrong(text, "expected a number, found the end of the file");
    snprintf(word, sizeof word, "%.*s", (int)(length < sizeof word ? length : sizeof word - 1), from);
    *out = strtod(word, &end);
    if (end == word || *end || length >= sizeof word)
        return wrong(text, "expected a number, found '%.40s'", word);
    return true;
}

/* The body of a text: a number for each property, and for each entry of a list. */
static bool check_ply_body(struct text *text, const struct ply_element *elements, uint32_t count)
{
    double value;
    text->line++;
    for (uint32_t e = 0; e < count; e++)
        for (uint64_t i = 0; i < elements[e].count; i++) {
            for (uint32_t k = 0; k < elements[e].plain; k++)
                if (!next_number(text, &value))
                    return false;
            for (uint32_t k = 0; k < elements[e].lists; k++) {
                if (!next_number(text, &value))
                    return false;
                if (!(value >= 0 && value <= 1e9))
                    return wrong(text, "expected the length of a list, found %g", value);
                for (uint64_t n = (uint64_t)value; n > 0; n--) {
                    double entry;
                    if (!next_number(text, &entry))
                        return false;
                }
            }
        }
    return true;
}

/* Whether what the header promises can be in what follows it. */
static bool check_ply(struct text text)
{
    enum { MOST_ELEMENTS = 16 };
    struct ply_element elements[MOST_ELEMENTS] = {0};
    uint32_t element_count = 0;
    bool faces = false, simple = true; /* simple: what check_ply_body() can follow */
    char line[512], word[3][64];
    uint64_t needed = 0, count = 0, row = 0, count_line = 0;
    bool ascii = false, format = false, any = false;
    if (!next_line(&text, line, sizeof line) || strcmp(line, "ply") != 0)
        return text.line = 1, wrong(&text, "expected 'ply'");
    for (;;) {
        if (!next_line(&text, line, sizeof line))
            return text.line++, wrong(&text, "expected 'end_header', found the end of the file");
        int words = sscanf(line, "%63s %63s %63s", word[0], word[1], word[2]);
        bool element = words > 0 && strcmp(word[0], "element") == 0,
             end = words > 0 && !strcmp(word[0], "end_header");
        if ((element || end) && any) {
            uint64_t bytes = 0;
            if (__builtin_mul_overflow(count, row ? row : 1, &bytes) ||
                __builtin_add_overflow(needed, bytes, &needed) ||
                needed > (uint64_t)(text.end - text.at) + 1) {
                text.line = count_line;
                return wrong(&text, "%llu elements of at least %llu bytes, but only %llu bytes follow",
                             (unsigned long long)count, (unsigned long long)(row ? row : 1),
                             (unsigned long long)(text.end - text.at));
            }
        }
        if (end)
            break;
        if (words > 0 && strcmp(word[0], "format") == 0) {
            if (words < 2 || (strcmp(word[1], "ascii") != 0 && strncmp(word[1], "binary_", 7) != 0))
                return wrong(
                    &text,
                    "expected a format of ascii, binary_little_endian or binary_big_endian, found '%.60s'",
                    line);
            ascii = strcmp(word[1], "ascii") == 0;
            format = true;
        } else if (element) {
            char *stop = word[2];
            count = words == 3 && isdigit((unsigned char)word[2][0]) ? strtoull(word[2], &stop, 10) : 0;
            if (words != 3 || stop == word[2] || *stop)
                return wrong(&text, "expected 'element NAME COUNT', found '%.60s'", line);
            if (strcmp(word[1], "face") == 0)
                faces = true;
            if (strcmp(word[1], "vertex") == 0 && faces)
                return wrong(&text, "expected the vertices to be declared before the faces");
            any = true;
            row = 0;
            count_line = text.line;
            if (element_count < MOST_ELEMENTS)
                elements[element_count].count = count;
            element_count++;
        } else if (words > 0 && strcmp(word[0], "property") == 0) {
            bool list = words > 1 && strcmp(word[1], "list") == 0;
            unsigned bytes = words == 3 ? type_bytes(list ? word[2] : word[1]) : 0;
            if (!any || !bytes)
                return wrong(&text, "expected a property of a known type after an element, found '%.60s'",
                             line);
            /* As text: a digit and what parts it from the next. */
            row += ascii ? 2 : bytes;
            if (element_count <= MOST_ELEMENTS) {
                struct ply_element *last = &elements[element_count - 1];
                simple = simple && (list || !last->lists);
                last->lists += list;
                last->plain += !list;
            }
        } else if (words > 0 && strcmp(word[0], "comment") != 0 && strcmp(word[0], "obj_info") != 0) {
            return wrong(&text, "expected a line of a PLY header, found '%.60s'", line);
        }
    }
    if (!format)
        return wrong(&text, "the header names no format");
    return !ascii || !simple || element_count > MOST_ELEMENTS || check_ply_body(&text, elements, element_count);
}

static bool check_json(struct text text, const char *data, size_t length, size_t offset)
{
    yyjson_read_err error;
    yyjson_doc *doc = yyjson_read_opts((char *)(uintptr_t)data, length, 0, NULL, &error);
    if (doc) {
        bool object = yyjson_is_obj(yyjson_doc_get_root(doc));
        yyjson_doc_free(doc);
        if (!object)
            snprintf(text.out_error, text.error_size, "byte %zu: expected a JSON object", offset);
        return object;
    }
    size_t position = error.pos < length ? error.pos : length;
    unsigned long long line = 1;
    for (size_t i = 0; i < position; i++)
        line += data[i] == '\n';
    snprintf(text.out_error, text.error_size, "line %llu (byte %zu): its JSON is not well-formed: %s", line,
             offset + position, error.msg);
    return false;
}

static uint32_t word_at(const char *data)
{
    const unsigned char *b = (const unsigned char *)data;
    return (uint32_t)b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24;
}

static bool check_glb(struct text text, const char *data, size_t length)
{
    const char *what = NULL;
    size_t offset = 0;
    unsigned long long expected = 0, found = 0;
    if (length < 20 || memcmp(data, "glTF", 4) != 0) {
        snprintf(text.out_error, text.error_size, "byte 0: expected the header of a binary glTF file");
        return false;
    }
    if (word_at(data + 4) != 2)
        what = "version", offset = 4, expected = 2, found = word_at(data + 4);
    else if (word_at(data + 8) != length)
        what = "length of the file", offset = 8, expected = length, found = word_at(data + 8);
    else if (word_at(data + 16) != 0x4E4F534A)
        what = "type of the first chunk", offset = 16, expected = 0x4E4F534A, found = word_at(data + 16);
    else if (word_at(data + 12) > length - 20)
        what = "length of the first chunk, at most", offset = 12, expected = length - 20,
        found = word_at(data + 12);
    if (what) {
        snprintf(text.out_error, text.error_size, "byte %zu: %s: expected %llu, found %llu", offset, what,
                 expected, found);
        return false;
    }
    return check_json(text, data + 20, word_at(data + 12), 20);
}

/* Facets of three vertices each, in lines. */
static bool check_stl_text(struct text *text)
{
    char line[512];
    unsigned vertices = 0;
    while (next_line(text, line, sizeof line)) {
        const char *at = line + strspn(line, " \t");
        if (strncasecmp(at, "vertex", 6) == 0) {
            vertices++;
            if (!check_numbers(text, at + 6, 3, "vertex"))
                return false;
        } else if (strncasecmp(at, "facet normal", 12) == 0) {
            if (!check_numbers(text, at + 12, 3, "normal"))
                return false;
        } else if (strncasecmp(at, "endfacet", 8) == 0) {
            if (vertices != 3)
                return wrong(text, "expected 3 vertices in the facet, found %u", vertices);
            vertices = 0;
        }
    }
    if (vertices)
        return wrong(text, "expected 'endfacet', found the end of the file");
    return true;
}

/* Text begins with "solid"; binary files may, too, but then their size is right. */
static bool check_stl(struct text text, const char *data, size_t length)
{
    if (length >= 84 && length == 84 + 50 * (uint64_t)word_at(data + 80))
        return true;
    if (length >= 5 && strncasecmp(data, "solid", 5) == 0)
        return check_stl_text(&text);
    if (length < 84)
        snprintf(text.out_error, text.error_size,
                 "byte 0: expected 'solid' or a header of 84 bytes, found %zu bytes", length);
    else
        snprintf(text.out_error, text.error_size, "byte 80: %lu triangles of 50 bytes, but %zu bytes follow",
                 (unsigned long)word_at(data + 80), length - 84);
    return false;
}

void gn_model_locate(const char *message, const char *data, size_t length, char *out, size_t size)
{
    const char *quote = strchr(message, '"');
    size_t quoted = quote ? strcspn(quote + 1, "\"\r\n") : 0;
    const char *found = quoted >= 3 ? memmem(data, length, quote + 1, quoted) : NULL;
    unsigned long long line = 1;
    for (const char *at = data; found && at < found; at++)
        line += *at == '\n';
    if (found)
        snprintf(out, size, "line %llu (byte %zu): %.800s", line, (size_t)(found - data), message);
    else
        snprintf(out, size, "in its %zu bytes: %.800s", length, message);
}

bool gn_model_check(const char *path, const char *data, size_t length, char *out_error, size_t error_size)
{
    struct text text = {data, data + length, 0, out_error, error_size};
    const char *ending = strrchr(path, '.');
    if (!ending)
        return true;
    if (strcasecmp(ending, ".obj") == 0)
        return check_obj(text);
    if (strcasecmp(ending, ".ply") == 0)
        return check_ply(text);
    if (strcasecmp(ending, ".gltf") == 0)
        return check_json(text, data, length, 0);
    if (strcasecmp(ending, ".glb") == 0)
        return check_glb(text, data, length);
    if (strcasecmp(ending, ".stl") == 0)
        return check_stl(text, data, length);
    return true;
}
