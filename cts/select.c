/* SPDX-License-Identifier: Apache-2.0 */
/* The catalogue of cases, filters and shards. */
#include "cts/select.h"

#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

struct gn_selected *gn_catalogue(struct gn_arena *arena, size_t *out_count)
{
    size_t count = 0;
    for (size_t f = 0; f < gn_case_family_count; f++)
        count += gn_case_families[f]->case_count * (size_t)__builtin_popcount(gn_case_family_backends[f]);
    struct gn_selected *cases = calloc(count ? count : 1, sizeof *cases);
    if (!cases) {
        fprintf(stderr, "gnomon: out of memory for %zu cases\n", count);
        exit(3);
    }
    size_t n = 0;
    for (uint32_t b = 0; b < GN_CASE_BACKEND_COUNT; b++) {
        const char *prefix = gn_case_backend_name(b);
        for (size_t f = 0; f < gn_case_family_count; f++) {
            const struct gn_case_family *family = gn_case_families[f];
            for (size_t c = 0; c < family->case_count && gn_case_family_backends[f] >> b & 1; c++)
                cases[n++] = (struct gn_selected){gn_arena_printf(arena, "%s%s%s", prefix, *prefix ? "." : "",
                                                                  family->cases[c].name),
                                                  b, &family->cases[c], family};
        }
    }
    *out_count = n;
    return cases;
}

const struct gn_selected *gn_catalogue_find(const struct gn_selected *catalogue, size_t count,
                                            const char *name)
{
    for (size_t i = 0; i < count; i++)
        if (strcmp(catalogue[i].name, name) == 0)
            return &catalogue[i];
    return NULL;
}

bool gn_pattern_matches(const char *pattern, const char *name)
{
    const char *star = NULL, *resume = NULL;
    while (*name) {
        if (*pattern == '*') {
            star = ++pattern;
            resume = name;
        } else if (*pattern == *name) {
            pattern++;
            name++;
        } else if (star) {
            pattern = star;
            name = ++resume;
        } else {
            return false;
        }
    }
    while (*pattern == '*')
        pattern++;
    return !*pattern;
}

/* Levenshtein's distance, of the first 120 characters. */
static unsigned distance(const char *a, const char *b)
{
    enum { MOST = 120 };
    unsigned row[MOST + 1];
    size_t na = strnlen(a, MOST), nb = strnlen(b, MOST);
    for (size_t j = 0; j <= nb; j++)
        row[j] = (unsigned)j;
    for (size_t i = 1; i <= na; i++) {
        unsigned diagonal = row[0];
        row[0] = (unsigned)i;
        for (size_t j = 1; j <= nb; j++) {
            unsigned above = row[j], best = diagonal + (a[i - 1] != b[j - 1]);
            if (above + 1 < best)
                best = above + 1;
            if (row[j - 1] + 1 < best)
                best = row[j - 1] + 1;
            row[j] = best;
            diagonal = above;
        }
    }
    return row[nb];
}

/* What someone who typed this may have meant: a pattern that would have matched, or the nearest name. */
static void suggest(const struct gn_selected *cases, size_t count, const char *filter, char *out, size_t size)
{
    static const struct {
        const char *before, *after;
    } shapes[] = {{"query.", ""}, {"pipeline.", ""}, {"", ".*"}, {"query.", ".*"}, {"pipeline.", ".*"}, {"", "*"},
                  {"*", "*"}};
    out[0] = 0;
    for (size_t s = 0; s < sizeof shapes / sizeof shapes[0]; s++) {
        char pattern[512];
        size_t matches = 0;
        int written = snprintf(pattern, sizeof pattern, "%s%s%s", shapes[s].before, filter, shapes[s].after);
        if (written < 0 || (size_t)written >= sizeof pattern)
            return;
        for (size_t i = 0; i < count; i++)
            matches += gn_pattern_matches(pattern, cases[i].name);
        if (matches) {
            snprintf(out, size, "; did you mean '%s' (%zu %s)?", pattern, matches,
                     matches == 1 ? "case" : "cases");
            return;
        }
    }
    unsigned best = 0;
    const char *nearest = NULL;
    for (size_t i = 0; i < count; i++) {
        unsigned d = distance(filter, cases[i].name);
        if (!nearest || d < best) {
            best = d;
            nearest = cases[i].name;
        }
    }
    if (nearest && best <= strlen(nearest) / 2)
        snprintf(out, size, "; did you mean '%s'?", nearest);
    else
        snprintf(out, size, "; `gnomon run --list` shows the names");
}

size_t gn_select(struct gn_selected *cases, size_t count, const char *const *filters, size_t filter_count,
                 uint32_t shard, uint32_t shard_count, char *out_error, size_t error_size)
{
    for (size_t f = 0; f < filter_count; f++) {
        size_t matches = 0;
        for (size_t i = 0; i < count; i++)
            matches += gn_pattern_matches(filters[f], cases[i].name);
        if (!matches) {
            char near[600];
            suggest(cases, count, filters[f], near, sizeof near);
            snprintf(out_error, error_size, "no case matches '%s'%s", filters[f], near);
            return SIZE_MAX;
        }
    }
    size_t kept = 0;
    for (size_t i = 0; i < count; i++) {
        bool wanted = !filter_count;
        for (size_t f = 0; f < filter_count && !wanted; f++)
            wanted = gn_pattern_matches(filters[f], cases[i].name);
        /* By the name's hash, so that a case stays in its shard when others are added. */
        if (wanted && shard_count > 1)
            wanted = XXH64(cases[i].name, strlen(cases[i].name), 0) % shard_count == shard - 1;
        if (wanted)
            cases[kept++] = cases[i];
    }
    return kept;
}
