/* SPDX-License-Identifier: Apache-2.0 */
/* Which cases a run has: the catalogue, filters, shards. */
#ifndef GNOMON_CTS_SELECT_H
#define GNOMON_CTS_SELECT_H

#include "cts/case.h"
#include "cts/results.h"

/* A case and its full name: the backend, a dot, and the case's own. */
struct gn_selected {
    const char *name;
    enum gn_case_backend backend;
    const struct gn_case *self;
    const struct gn_case_family *family;
};

/* Every case there is, in the catalogue's order; malloc'ed array, names in the arena. */
struct gn_selected *gn_catalogue(struct gn_arena *arena, size_t *out_count);
/* NULL when no case is named so. */
const struct gn_selected *gn_catalogue_find(const struct gn_selected *catalogue, size_t count,
                                            const char *name);

/* Whether the name matches the pattern, in which `*` stands for any characters. */
bool gn_pattern_matches(const char *pattern, const char *name);

/*
 * Keeps in place the cases that match any of the filters (all without filters), and gives their number. A filter
 * that matches nothing gives SIZE_MAX with a message that names what is near it.
 */
size_t gn_select(struct gn_selected *cases, size_t count, const char *const *filters, size_t filter_count,
                 char *out_error, size_t error_size);

/*
 * Keeps in place the cases of a shard, from 1 on, and gives their number: by the hash of their names, so that a case stays in its shard
 * when others are added; or, with `durations`, the results of an earlier run, so that all shards take about
 * equally long. The same arguments give the same shards anywhere.
 */
size_t gn_shard(struct gn_selected *cases, size_t count, uint32_t shard, uint32_t shard_count,
                const struct gn_results *durations);

/* A digest of the names of all cases: what two runs must share to be parts of one. */
uint64_t gn_catalogue_digest(const struct gn_selected *catalogue, size_t count);

#endif
