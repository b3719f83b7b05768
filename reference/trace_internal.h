/* SPDX-License-Identifier: Apache-2.0 */
/* What a trace keeps, and the decisions about one primitive: shared by trace.c and certified.c. */
#ifndef GNOMON_REFERENCE_TRACE_INTERNAL_H
#define GNOMON_REFERENCE_TRACE_INTERNAL_H

#include "reference/scene_internal.h"

/* A primitive that the ray meets: t is the triangle's, or the box's entry clipped to tmin. */
struct gn_ref_found {
    uint64_t id;
    struct gn_ref_interval t;
    double t_value, t_error;
    double t_exit, t_exit_error;
    double beta, gamma, barycentric_error;
    bool front;
    bool opaque;
    bool sharp; /* the interval is as narrow as f64 makes it */
    unsigned zeros; /* bit i: edge function i is exactly 0 */
};

struct gn_ref_trace {
    const struct gn_ref_scene *scene;
    uint32_t effects; /* called for by the ray, or forced on */
    struct gn_ref_effect_counts *counts; /* NULL: not wanted */
    struct gn_ref_ray_setup setup;
    bool closest; /* only the nearest triangle is wanted */
    /* What is found; with `closest` at most one. */
    struct gn_ref_found *found;
    size_t count, capacity;
    struct gn_ref_found local[32];
    bool failed;
    double limit; /* no larger t is of interest */
    uint64_t filtered, wide, exact_count;
    bool integers_ready;
    struct gn_ref_ray_integers integers;
    bool exact_ready;
    struct gn_ref_exact exact;
    struct gn_ref_environment environment;
};

bool gn_ref_trace_ray_valid(const struct gn_ref_ray *ray);
/* gn_ref_trace_closest_triangles_exact() with hits that are `stride` bytes apart. */
void gn_ref_trace_closest_triangles_apart(const struct gn_ref_scene *scene, const struct gn_ref_ray *rays, size_t count,
                                          struct gn_ref_hit *out_hits, size_t stride, int8_t *out_found);
/* Whether a triangle is met at all: 1, 0 or -1 as for the closest, without looking for the closest. */
int gn_ref_trace_any_triangle(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray);
void gn_ref_trace_any_triangles(const struct gn_ref_scene *scene, const struct gn_ref_ray *rays, size_t count,
                                int8_t *out_found);
/* Only the nearest triangle, by the f64 traversal, which takes every scene and ray. */
int gn_ref_trace_closest_any(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray,
                             struct gn_ref_hit *out_hit);

/* What follows runs the code of those effects only whose bits are set in `effects`. */
/* Mask and opacity: what needs no geometry. */
bool gn_ref_trace_admits(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray, uint32_t effects, uint64_t id,
                         bool *out_opaque);
/* From the sign of U + V + W in the world. */
bool gn_ref_trace_front(const struct gn_ref_scene *scene, uint32_t effects, uint64_t id, int sum_sign);
/* Whether face culling lets it pass. */
bool gn_ref_trace_admits_facing(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray, uint32_t effects,
                                uint64_t id, bool front);
/* The triangle in integers of fixed width, where they suffice. */
bool gn_ref_trace_wide(struct gn_ref_trace *trace, uint64_t id, struct gn_ref_lane *out);
/* Everything about one triangle in exact arithmetic; false when the ray does not meet it. */
bool gn_ref_trace_triangle_exact(struct gn_ref_trace *trace, struct gn_ref_found *found);
/* The sign of the difference of two t, exactly. Intervals of everything are taken for not known. */
int gn_ref_trace_compare(struct gn_ref_trace *trace, struct gn_ref_found *a, struct gn_ref_found *b);
/* t and barycentrics to the accuracy that trace.h promises. */
void gn_ref_trace_hit_write(struct gn_ref_trace *trace, struct gn_ref_found *found, struct gn_ref_hit *out);
void gn_ref_trace_count(uint64_t filtered, uint64_t wide, uint64_t exact);

#endif
