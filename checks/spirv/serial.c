/* SPDX-License-Identifier: Apache-2.0 */
/* A result as bytes, for caches. What is read back may have been written by anybody: every size is checked, and what does not add up is
 * refused. */
#include <stdlib.h>
#include <string.h>

#include "checks/spirv/module.h"

#define MAGIC 0x53534E47u
#define NO_TEXT UINT32_MAX

struct out {
    unsigned char *data;
    size_t size, capacity;
    bool failed;
};

static void put(struct out *out, const void *data, size_t size)
{
    if (out->failed || size == 0)
        return;
    if (size > out->capacity - out->size) {
        size_t capacity = out->capacity ? out->capacity : 4096;
        while (capacity - out->size < size && capacity < SIZE_MAX / 2)
            capacity *= 2;
        unsigned char *grown = capacity - out->size < size ? NULL : realloc(out->data, capacity);
        if (!grown) {
            out->failed = true;
            return;
        }
        out->data = grown;
        out->capacity = capacity;
    }
    memcpy(out->data + out->size, data, size);
    out->size += size;
}

static void put_u32(struct out *out, uint32_t value)
{
    put(out, &value, sizeof value);
}

static void put_u64(struct out *out, uint64_t value)
{
    put(out, &value, sizeof value);
}

static void put_text(struct out *out, const char *text)
{
    size_t length = text ? strlen(text) : 0;
    if (length >= NO_TEXT) {
        out->failed = true;
        return;
    }
    put_u32(out, text ? (uint32_t)length : NO_TEXT);
    put(out, text, length);
}

unsigned char *gn_spirv_result_write(const struct gn_spirv_result *result, size_t *out_size)
{
    struct out out = {NULL, 0, 0, false};
    put_u32(&out, MAGIC);
    put_u32(&out, GN_SPIRV_VERSION);
    put_u32(&out, GN_SPIRV_RULE_COUNT);
    put_u32(&out, (uint32_t)result->status);
    put_u32(&out, result->check_count);
    put_u32(&out, result->site_count);
    put_u32(&out, result->finding_count);
    put_text(&out, result->message);
    for (uint32_t s = 0; s < result->site_count; s++) {
        const struct gn_spirv_site *site = &result->sites[s];
        put_text(&out, site->operation);
        put_text(&out, site->query);
        put_text(&out, site->place.function);
        put_text(&out, site->place.file);
        put_text(&out, site->place.source);
        const uint32_t numbers[] = {site->place.function_id, site->place.block_id, site->place.offset, site->place.line,
                                    site->place.column,      site->query_id,       site->first_check};
        put(&out, numbers, sizeof numbers);
        put_u64(&out, site->judged);
        put_u64(&out, site->checked);
        put_u64(&out, site->wrong);
    }
    for (uint32_t f = 0; f < result->finding_count; f++) {
        const struct gn_spirv_finding *finding = &result->findings[f];
        put_u32(&out, finding->rule);
        put_u32(&out, finding->severity);
        put_u32(&out, finding->site);
        put_text(&out, finding->message);
    }
    put_u64(&out, result->words ? result->word_count : 0);
    put(&out, result->words, result->words ? result->word_count * sizeof *result->words : 0);
    if (out.failed) {
        free(out.data);
        return NULL;
    }
    *out_size = out.size;
    return out.data;
}

struct in {
    const unsigned char *data;
    size_t left;
    bool failed;
    struct arena *arena;
};

static void get(struct in *in, void *out, size_t size)
{
    if (in->failed || size > in->left) {
        in->failed = true;
        memset(out, 0, size);
        return;
    }
    memcpy(out, in->data, size);
    in->data += size;
    in->left -= size;
}

static uint32_t get_u32(struct in *in)
{
    uint32_t value;
    get(in, &value, sizeof value);
    return value;
}

static uint64_t get_u64(struct in *in)
{
    uint64_t value;
    get(in, &value, sizeof value);
    return value;
}

static const char *get_text(struct in *in)
{
    uint32_t length = get_u32(in);
    if (length == NO_TEXT || in->failed)
        return NULL;
    const char *text = length <= in->left ? arena_text(in->arena, (const char *)in->data, length) : NULL;
    if (!text) {
        in->failed = true;
        return NULL;
    }
    in->data += length;
    in->left -= length;
    return text;
}

static void get_site(struct in *in, struct gn_spirv_site *site)
{
    uint32_t numbers[7];
    site->operation = get_text(in);
    site->query = get_text(in);
    site->place.function = get_text(in);
    site->place.file = get_text(in);
    site->place.source = get_text(in);
    get(in, numbers, sizeof numbers);
    site->place.function_id = numbers[0];
    site->place.block_id = numbers[1];
    site->place.offset = numbers[2];
    site->place.line = numbers[3];
    site->place.column = numbers[4];
    site->query_id = numbers[5];
    site->first_check = numbers[6];
    site->judged = get_u64(in);
    site->checked = get_u64(in);
    site->wrong = get_u64(in);
    in->failed |= !site->operation;
}

bool gn_spirv_result_read(const unsigned char *data, size_t size, struct gn_spirv_result *out)
{
    struct arena arena = {NULL};
    struct in in = {data, size, false, &arena};
    memset(out, 0, sizeof *out);
    bool known = get_u32(&in) == MAGIC;
    known &= get_u32(&in) == GN_SPIRV_VERSION;
    known &= get_u32(&in) == GN_SPIRV_RULE_COUNT;
    out->status = (enum gn_spirv_status)get_u32(&in);
    out->check_count = get_u32(&in);
    out->site_count = get_u32(&in);
    out->finding_count = get_u32(&in);
    /* An element of either list takes more bytes than one. */
    if (!known || in.failed || out->status > GN_SPIRV_DECLINED || out->site_count > in.left || out->finding_count > in.left)
        goto fail;
    const char *message = get_text(&in);
    if (!message || strlen(message) >= sizeof out->message)
        goto fail;
    strcpy(out->message, message);
    out->sites = arena_alloc(&arena, out->site_count + (size_t)1, sizeof *out->sites);
    out->findings = arena_alloc(&arena, out->finding_count + (size_t)1, sizeof *out->findings);
    if (!out->sites || !out->findings)
        goto fail;
    uint64_t checks = 0;
    for (uint32_t s = 0; s < out->site_count && !in.failed; s++) {
        get_site(&in, &out->sites[s]);
        checks += (uint64_t)__builtin_popcountll(out->sites[s].checked);
        in.failed |= (out->sites[s].judged | out->sites[s].checked | out->sites[s].wrong) >> GN_SPIRV_RULE_COUNT != 0;
    }
    for (uint32_t f = 0; f < out->finding_count && !in.failed; f++) {
        struct gn_spirv_finding *finding = &out->findings[f];
        finding->rule = (enum gn_spirv_rule_index)get_u32(&in);
        finding->severity = (enum gn_severity)get_u32(&in);
        finding->site = get_u32(&in);
        finding->message = get_text(&in);
        in.failed |= finding->rule >= GN_SPIRV_RULE_COUNT || finding->severity >= GN_SEVERITY_COUNT ||
                     finding->site >= out->site_count || !finding->message;
    }
    uint64_t words = get_u64(&in);
    if (in.failed || words > in.left / 4 || words * 4 != in.left || (words != 0) != (out->status == GN_SPIRV_INSTRUMENTED) ||
        (out->check_count != 0 && out->check_count != checks))
        goto fail;
    if (words) {
        out->words = malloc(in.left);
        if (!out->words)
            goto fail;
        memcpy(out->words, in.data, in.left);
        out->word_count = (size_t)words;
    }
    out->storage = arena.blocks;
    return true;
fail:
    arena_finish(&arena);
    memset(out, 0, sizeof *out);
    return false;
}
