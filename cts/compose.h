/* SPDX-License-Identifier: Apache-2.0 */
/* Scenes put together from several parts, and rays aimed at any part of them. All memory is the arena's. */
#ifndef GNOMON_CTS_COMPOSE_H
#define GNOMON_CTS_COMPOSE_H

#include "cts/case.h"
#include "cts/generate.h"

/* `base`, in units that are the same for all cases, times the run's scale, and at least 1. */
uint32_t gn_ray_count(const struct gn_case_run *run, uint32_t base);

/* Replaces the translation of the transform. */
void gn_instance_place(struct gn_cts_instance *instance, double x, double y, double z);
/* A diagonal transform with a translation. */
void gn_transform_scale(double sx, double sy, double sz, double x, double y, double z, float out[12]);

/* A scene of these parts; the arrays are not copied. */
struct gn_cts_scene gn_scene_make(const struct gn_cts_blas *blases, uint32_t blas_count,
                                  const struct gn_cts_instance *instances, uint32_t instance_count);
/* One BLAS of these geometries and one instance with a random rotation, scale and translation. */
struct gn_cts_scene gn_scene_placed(struct gn_case_run *run, const struct gn_cts_geometry *geometries,
                                    uint32_t geometry_count);

/*
 * Rays aimed at the inside of triangles (or boxes) of the scene: every pair of an active instance and a
 * geometry that has primitives is as likely as any other, and the first and the last primitive of a geometry
 * more likely than the ones between. The origin is at half to one and a half times `distance` from the
 * target, off the triangle's plane by more than 10 degrees, on the side from which it is wound
 * counter-clockwise or, with `both_sides`, on either. Directions are of unit length or scaled by a power of
 * two. Inactive primitives are not aimed at. tmin 0, tmax 1000, mask 0xFF, no flags; every triangle is
 * confirmed, no hit generated.
 */
void gn_rays_at_scene(struct gn_case_run *run, const struct gn_cts_scene *scene, double distance,
                      bool both_sides, struct gn_cts_ray *rays, uint32_t count);

/*
 * Rays along the z axis, either way, that pass through all of the slab bottom <= z <= top within
 * |x|, |y| <= half_width: tilted by at most what that allows, and by less than 1/4 per unit of z.
 */
void gn_rays_through(struct gn_random *random, double bottom, double top, double half_width,
                     struct gn_cts_ray *rays, uint32_t count);

/*
 * A ladder of boxes: rung i (primitive i, at most 32) is centred at z = i, reaches z +- thickness / 2 and a
 * random part of |x|, |y| <= 2 around a random centre.
 */
#define GN_LADDER_MAX 32
const float (*gn_ladder_make(struct gn_arena *arena, struct gn_random *random, uint32_t rungs,
                             double thickness))[6];

/*
 * Rays up or down a ladder, tilted, and the policy by which each generates a hit at the middle of every rung
 * of `wanted` (bits) that it clearly goes through: for those t0 + step * primitive is exactly where it meets
 * z = primitive. So the answer does not depend on the order in which boxes are presented, nor on how much an
 * implementation enlarges them.
 */
void gn_ladder_rays(struct gn_random *random, const float (*boxes)[6], uint32_t rungs, bool random_wanted,
                    struct gn_cts_ray *rays, uint32_t count);

/* Moves every vertex but those of the border in x and y by a random part of a cell: a flat mesh for the
 * formats that have no z. */
struct gn_mesh gn_mesh_flat(struct gn_arena *arena, struct gn_random *random, uint32_t n);

/* Another shape of the same mesh: every coordinate moved by up to `amount`. */
const double (*gn_mesh_moved(struct gn_arena *arena, struct gn_random *random, const struct gn_mesh *mesh,
                             double amount))[3];

#endif
