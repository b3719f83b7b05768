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
                 char *out_error, size_t error_size)
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
        if (wanted)
            cases[kept++] = cases[i];
    }
    return kept;
}

/* A case to be put into a shard. */
struct load {
    const char *name;
    double seconds;
    uint32_t shard; /* from 0 */
};

/* The longest first; of equal ones by name. */
static int compare_loads(const void *a, const void *b)
{
    const struct load *x = a, *y = b;
    if (x->seconds < y->seconds || x->seconds > y->seconds)
        return x->seconds < y->seconds ? 1 : -1;
    return strcmp(x->name, y->name);
}

static int compare_load_names(const void *a, const void *b)
{
    return strcmp(((const struct load *)a)->name, ((const struct load *)b)->name);
}

static double duration_of(const struct gn_results *durations, const char *name)
{
    for (size_t i = 0; i < durations->count; i++)
        if (strcmp(durations->cases[i].name, name) == 0)
            return durations->cases[i].seconds;
    return -1;
}

/* Each case, the longest first, goes to the shard that has the least so far. What took how long is not known takes the mean. */
static void balance(struct load *loads, size_t count, uint32_t shard_count, const struct gn_results *durations)
{
    double known = 0, *sums = calloc(shard_count, sizeof *sums);
    size_t known_count = 0;
    for (size_t i = 0; i < count; i++) {
        loads[i].seconds = duration_of(durations, loads[i].name);
        known += loads[i].seconds >= 0 ? loads[i].seconds : 0;
        known_count += loads[i].seconds >= 0;
    }
    for (size_t i = 0; i < count; i++)
        if (loads[i].seconds < 0)
            loads[i].seconds = known_count ? known / (double)known_count : 1;
    qsort(loads, count, sizeof *loads, compare_loads);
    for (size_t i = 0; sums && i < count; i++) {
        for (uint32_t s = 0; s < shard_count; s++)
            if (sums[s] < sums[loads[i].shard])
                loads[i].shard = s;
        sums[loads[i].shard] += loads[i].seconds;
    }
    free(sums);
}

size_t gn_shard(struct gn_selected *cases, size_t count, uint32_t shard, uint32_t shard_count,
                const struct gn_results *durations)
{
    struct load *loads = calloc(count ? count : 1, sizeof *loads);
    size_t kept = 0;
    if (!loads) {
        fprintf(stderr, "gnomon: out of memory for %zu cases\n", count);
        exit(3);
    }
    for (size_t i = 0; i < count; i++) {
        loads[i].name = cases[i].name;
        if (!durations)
            loads[i].shard = (uint32_t)(XXH64(cases[i].name, strlen(cases[i].name), 0) % shard_count);
    }
    if (durations)
        balance(loads, count, shard_count, durations);
    qsort(loads, count, sizeof *loads, compare_load_names);
    for (size_t i = 0; i < count; i++) {
        const struct load key = {.name = cases[i].name};
        const struct load *load = bsearch(&key, loads, count, sizeof *loads, compare_load_names);
        if (load->shard == shard - 1)
            cases[kept++] = cases[i];
    }
    free(loads);
    return kept;
}

uint64_t gn_catalogue_digest(const struct gn_selected *catalogue, size_t count)
{
    uint64_t digest = 0;
    for (size_t i = 0; i < count; i++)
        digest = XXH64(catalogue[i].name, strlen(catalogue[i].name) + 1, digest);
    return digest;
}
