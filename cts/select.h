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
 * Keeps in place the cases that match any of the filters (all without filters) and belong to the shard, and
 * gives their number. A filter that matches nothing gives SIZE_MAX with a message that names what is near it.
 */
size_t gn_select(struct gn_selected *cases, size_t count, const char *const *filters, size_t filter_count,
                 uint32_t shard, uint32_t shard_count, char *out_error, size_t error_size);

#endif
