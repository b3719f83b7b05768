/* SPDX-License-Identifier: Apache-2.0 */
/* Which record of the hit table a geometry of an instance takes, and scenes that leave no two to share one wrongly. */
#ifndef GNOMON_CTS_TABLE_H
#define GNOMON_CTS_TABLE_H

#include "cts/arena.h"
#include "cts/scene.h"

/* The specification's sum: instance offset + geometry index * stride + offset of the trace. */
uint64_t gn_table_record(const struct gn_cts_route *route, const struct gn_cts_instance *instance, uint32_t geometry);

/* One more than the largest record of the scene; at least 1. */
uint64_t gn_table_record_count(const struct gn_cts_scene *scene, const struct gn_cts_route *route);

/*
 * The scene, or where a record would have to serve triangles and boxes at once, a copy in which every BLAS has
 * records of its own: the instances' record offsets differ then. NULL when 24 bits do not hold them.
 */
const struct gn_cts_scene *gn_table_scene(struct gn_arena *arena, const struct gn_cts_scene *scene,
                                          const struct gn_cts_route *route);

#endif
