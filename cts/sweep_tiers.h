/* SPDX-License-Identifier: Apache-2.0 */
/* The tiers of the reference in the driver's place: a sweep's rays traced by each, judged by the same verdict. */
#ifndef GNOMON_CTS_SWEEP_TIERS_H
#define GNOMON_CTS_SWEEP_TIERS_H

#include "cts/case.h"

/* The tiers trace the first of so many parts of a point's rays: their kinds come by turns, so those will do. */
#define GN_SWEEP_TIER_SHARE 5

/*
 * Traces the first rays with every tier and fills point->tiers; with the exact tier only as many as
 * take little time. `judge` and the committed `reference` are of the same scene. Only hits are judged: what else a query
 * says of them, the matrices and positions, is not a matter of tiers. False with a message when memory is short.
 */
bool gn_sweep_tiers_trace(struct gn_case_point *point, const struct gn_ref_scene *reference, struct gn_ref_judge *judge,
                          enum gn_cts_program program, const struct gn_cts_ray *rays, uint32_t ray_count,
                          char *out_error, size_t error_size);

#endif
