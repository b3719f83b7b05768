/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The sweeps of the family `stability`, by subject; cts/cases/stability.c names them as cases.
 *
 * How far each is judged follows from docs/numerics.md. The errors are measured by the sizes of the numbers, so
 * most parameters may grow without end; what ends a judged range is one of these, stated as each sweep's `why`:
 *
 * - f32's range. The model has no overflow, and an implementation may flush what is subnormal. Products of three
 *   coordinates (an edge function, a determinant) have to be normal with the 24 bits below them, and so has the
 *   square of a direction. GN_SWEEP_CUBE and GN_SWEEP_SQUARE are powers of two for which they are.
 * - The first-order analysis of an inverse matrix. With a condition number c its second-order part is k u c of the
 *   first: at most 1/64 is let pass, so c is judged to 2^24 / (24 * 64), about 1e4 (GN_SWEEP_CONDITION).
 * - A determinant that drowns. A test that rounds the coordinates it has moved to the ray's origin knows det to
 *   about k u R per side, R the distance to the corners; where a triangle is seen thinner than that, no weights
 *   can be had in f32, and the sweep ends before.
 * - Nothing left to decide: beyond some value every decision is within the bound.
 */
#ifndef GNOMON_CTS_CASES_STABILITY_H
#define GNOMON_CTS_CASES_STABILITY_H

#include "cts/generate.h"
#include "cts/sweep.h"

#define GN_SWEEP_VALUES(...)                                                                                  \
    .values = (const double[]){__VA_ARGS__}, .value_count = sizeof((const double[]){__VA_ARGS__}) / sizeof(double)

#define GN_SWEEP_CUBE 0x1p30
#define GN_SWEEP_SQUARE 0x1p60
#define GN_SWEEP_CONDITION 1e4

/* 1e0 to 1e9, a decade each. */
#define GN_SWEEP_DECADES GN_SWEEP_VALUES(1, 10, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9)

/* How the rays of a mesh are shared out. */
struct gn_stability_aims {
    uint32_t interior, edge, vertex, random;
};

/* One opaque geometry of this mesh, one instance, the transforms from the options (copied), and aimed rays. */
void gn_stability_mesh(const struct gn_sweep_request *request, const struct gn_mesh *mesh,
                       const struct gn_aim_options *options, struct gn_stability_aims aims,
                       struct gn_sweep_scene *out);
/* One aimed ray; from so far away that origin and target round to the same, it gets some direction. */
void gn_stability_aim(const struct gn_sweep_request *request, const struct gn_mesh *mesh,
                      const struct gn_aim_options *options, struct gn_cts_ray *ray);
/* The scene alone, with room for the request's rays. */
void gn_stability_scene(const struct gn_sweep_request *request, const struct gn_mesh *mesh,
                        const float *geometry_transform, const float *instance_transform,
                        struct gn_sweep_scene *out);
/* A mesh of `count` triangles that have their own vertices, still to be filled in. */
struct gn_mesh gn_stability_triangles(struct gn_arena *arena, uint32_t count);

/* stability_meshes.c */
extern const struct gn_sweep gn_stability_far_vertices, gn_stability_far_viewer, gn_stability_far_edge_rays,
    gn_stability_far_vertex_rays;
extern const struct gn_sweep gn_stability_scale_large, gn_stability_scale_small, gn_stability_mixed_scales;
extern const struct gn_sweep gn_stability_fan_spokes, gn_stability_fan_spike, gn_stability_cells,
    gn_stability_t_junctions;
extern const struct gn_sweep gn_stability_coincident, gn_stability_coplanar, gn_stability_layers,
    gn_stability_degenerate;

/* stability_shapes.c */
extern const struct gn_sweep gn_stability_sliver, gn_stability_sliver_level, gn_stability_needle,
    gn_stability_needle_level;
extern const struct gn_sweep gn_stability_grazing_level, gn_stability_grazing_tilted, gn_stability_in_plane,
    gn_stability_silhouette;

/* stability_transforms.c */
extern const struct gn_sweep gn_stability_instance_far, gn_stability_rotation, gn_stability_shear,
    gn_stability_stretch, gn_stability_stretch_turned, gn_stability_mirrored, gn_stability_singular,
    gn_stability_instance_large, gn_stability_instance_small, gn_stability_two_transforms, gn_stability_instances,
    gn_stability_read_back, gn_stability_positions;

/* stability_rays.c */
extern const struct gn_sweep gn_stability_direction_long, gn_stability_direction_short, gn_stability_component_tiny,
    gn_stability_component_huge, gn_stability_component_zero;
extern const struct gn_sweep gn_stability_end_near, gn_stability_end_tilted, gn_stability_end_empty,
    gn_stability_end_infinite;
extern const struct gn_sweep gn_stability_origin_face, gn_stability_origin_edge, gn_stability_origin_vertex;

/* stability_boxes.c */
extern const struct gn_sweep gn_stability_box_flat, gn_stability_box_face, gn_stability_box_corner,
    gn_stability_box_inside, gn_stability_box_far, gn_stability_box_many;

/* stability_infinite.c */
extern const struct gn_sweep gn_stability_infinite_beside, gn_stability_infinite_met, gn_stability_infinite_box;

#endif
