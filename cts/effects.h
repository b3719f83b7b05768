/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `gnomon effects`: what a scene calls for, why, what is left out, and what that would have cost. A stage of the
 * work (tracing; others may follow) adds its rows to a report; the command prints them all alike.
 */
#ifndef GNOMON_CTS_EFFECTS_H
#define GNOMON_CTS_EFFECTS_H

#include <stdio.h>

#include "cts/accuracy.h"
#include "reference/effects.h"

struct gn_effects_row {
    const char *stage; /* "trace" */
    const char *name; /* "any-hit" */
    const char *counted; /* what `ran` counts */
    uint64_t rays, rays_calling; /* those asked about, and those that call for it */
    char why[128]; /* of the first ray that calls for it, or of the first that does not */
    uint64_t ran; /* as it is */
    uint64_t rays_forced; /* those traced with it forced on: of subjects not all of whose rays call for it */
    uint64_t forced_ran;
    uint64_t differing; /* rays whose answer is another when it is forced on: none, or something is wrong */
    /* Time with it forced on over time without, of tracing and of placing the scene; NaN where all rays call for it. */
    double trace_ratio, commit_ratio;
};

struct gn_effects_options {
    uint32_t runs; /* timed, odd, at most 15 */
    bool quick; /* each time is taken of few rays */
};

/* Rows in the order that stages add them. */
struct gn_effects_report {
    struct gn_effects_options options;
    struct gn_effects_row rows[32];
    uint32_t row_count;
    uint64_t rays;
    struct gn_ref_effect_counts work; /* of tracing as it is */
    double all_trace_ratio, all_commit_ratio; /* with everything forced on that is not called for */
    uint64_t all_differing;
};

/* What is traced: the scene, made afresh and committed each time, and the rays. Released by the caller. */
struct gn_effects_subject {
    struct gn_ref_scene *(*make)(void *user); /* NULL on failure */
    void *user;
    const struct gn_ref_ray *rays;
    uint32_t ray_count;
};

/*
 * The stage "trace": adds a subject to its rows, which are begun with the first one. Times are those of the certified tier, in
 * batches; counts those of its rays one by one. False when the scene cannot be made or memory is short.
 */
bool gn_effects_trace_add(struct gn_effects_report *report, const struct gn_effects_subject *subject);

/* Whether something is wrong: what no ray calls for ran, or forcing changed an answer. `out` says what. */
bool gn_effects_fault(const struct gn_effects_report *report, char *out, size_t size);

#endif
