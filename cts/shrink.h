/* SPDX-License-Identifier: Apache-2.0 */
/* Copies of trials to be edited; shared by the parts of the shrinker. */
#ifndef GNOMON_CTS_SHRINK_H
#define GNOMON_CTS_SHRINK_H

#include "cts/fuzz.h"

/* A trial whose structures and rays may be written to; positions, indices, boxes and transforms are to be replaced whole. */
struct gn_shrink_copy {
    struct gn_fuzz_trial trial;
    struct gn_cts_blas *blases;
    struct gn_cts_geometry **geometries; /* by BLAS */
    struct gn_cts_instance *instances, *initial_instances; /* the latter NULL where there are none */
};
void gn_shrink_copy_make(struct gn_arena *arena, const struct gn_fuzz_trial *trial, struct gn_shrink_copy *out);

#endif
