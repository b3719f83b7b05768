/* SPDX-License-Identifier: Apache-2.0 */
/* A plain implementation in f32, as the derivation of the bound has it: what a driver must at least manage. */
#ifndef GNOMON_TESTS_SWEEP_HONEST_H
#define GNOMON_TESTS_SWEEP_HONEST_H

#include "cts/sweep.h"

/* What real implementations have been seen to do; zero is none of it. */
struct honest_faults {
    float det_epsilon; /* a determinant below it counts as edge-on */
    float t_epsilon; /* hits less than it behind tmin are dropped */
    bool world_facing; /* mirrored instances turn their faces over */
    bool no_zeros; /* the slab test divides by a direction of 0, and takes -0 for positive */
    uint32_t most_instances; /* the others are not looked at */
};

/* Answers all rays of a scene by trying every primitive, and has the answers judged. `user` is a struct honest_faults
 * or NULL. */
void honest_tracer(struct gn_case_run *run, const struct gn_sweep_scene *scene, void *user);

#endif
