/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A second oracle, by FLINT's balls: numbers with a bound of their error, at growing precision. It shares nothing with
 * reference/, nor with oracle.h: rays and edges are lines in Pluecker coordinates, in the world; t is that of the plane.
 * A sign that no ball decides, which is a zero most often, is decided by rationals.
 */
#ifndef GNOMON_TESTS_REFERENCE_BALLS_H
#define GNOMON_TESTS_REFERENCE_BALLS_H

#include "oracle.h"

struct balls;

/* For one thread. */
struct balls *balls_create(const struct oracle_scene *scene);
void balls_destroy(struct balls *balls);

/* All that the ray meets, in order; every primitive is looked at. The number of hits. */
size_t balls_trace(struct balls *balls, const struct gn_ref_ray *ray, const struct gn_ref_hit **out_hits);

/* Primitives decided by balls of 64 bits, of 256 bits, and by rationals; orders of two t by rationals. */
struct balls_counters {
    uint64_t narrow, wide, rational, orders;
};
struct balls_counters balls_counters(const struct balls *balls);

/* The self-check's lever: this primitive is not looked at any more. */
void balls_forget(struct balls *balls, uint32_t instance, uint32_t geometry, uint32_t primitive);

#endif
