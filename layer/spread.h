/* SPDX-License-Identifier: Apache-2.0 */
/* How well an old order of primitives still fits where they are now: what an update keeps of the build before it. */
#ifndef GN_LAYER_SPREAD_H
#define GN_LAYER_SPREAD_H

#include "checks/rules/geometry.h"

/* Only geometries of so many primitives are measured: below there is nothing to order, above it would take long. */
#define GN_SPREAD_LEAST 64u
#define GN_SPREAD_MOST 65536u

/* The primitives of a geometry along a Morton curve, as they lie now; the caller frees the list. NULL: too few or too many, coordinates that
 * are not 32-bit floats or not finite, or no memory. */
uint32_t *gn_spread_order(const struct gn_geometry_contents *contents, uint32_t *out_count);
/* The surface of the boxes around each 16 primitives that follow each other in `order`, divided by the same in the order that
 * gn_spread_order gives now: about 1 while the old order fits. 0: it cannot be told. */
double gn_spread_growth(const struct gn_geometry_contents *contents, const uint32_t *order, uint32_t count);

#endif
