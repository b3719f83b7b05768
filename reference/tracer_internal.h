/* SPDX-License-Identifier: Apache-2.0 */
/* What the tiers of tracer.h share: the table of a tier's functions, admission, and the tree of DOUBLE and EXACT. */
#ifndef GNOMON_REFERENCE_TRACER_INTERNAL_H
#define GNOMON_REFERENCE_TRACER_INTERNAL_H

#include "reference/scene_internal.h"
#include "reference/tracer.h"

/* Every ray that reaches these is valid, and out_record is all zero (GN_REF_MISS). */
struct gn_ref_tier_functions {
    const char *name;
    /* Sets tracer->state and tracer->cost.bytes; false, with a message in tracer->error, on failure. */
    bool (*create)(struct gn_ref_tracer *tracer);
    void (*destroy)(void *state); /* NULL when there is no state */
    enum gn_ref_outcome (*closest)(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray,
                                   struct gn_ref_record *out_record);
    enum gn_ref_outcome (*occluded)(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray);
    int64_t (*all)(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray, struct gn_ref_record *out_records,
                   size_t capacity);
    /* NULL where one ray after the other is as good. Rays that are not valid are still among these. */
    void (*closest_batch)(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *rays, size_t ray_count,
                          struct gn_ref_record *out_records);
    void (*occluded_batch)(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *rays, size_t ray_count,
                           enum gn_ref_outcome *out_outcomes);
};
extern const struct gn_ref_tier_functions gn_ref_tier_fast, gn_ref_tier_robust, gn_ref_tier_double,
    gn_ref_tier_certified, gn_ref_tier_exact;

struct gn_ref_tracer {
    const struct gn_ref_scene *scene;
    enum gn_ref_tier tier;
    const struct gn_ref_tier_functions *functions;
    struct gn_ref_tracer_cost cost;
    void *state;
    char error[320];
};

bool gn_ref_tracer_fail(struct gn_ref_tracer *tracer, const char *format, ...) __attribute__((format(printf, 2, 3)));

bool gn_ref_tracer_ray_valid(const struct gn_ref_ray *ray);

/* Mask, skip flags and opacity: what needs no geometry. */
bool gn_ref_admitted(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray, uint32_t instance,
                     uint32_t geometry, bool *out_opaque);
/* Whether culling admits a triangle whose front it is that the ray sees, before (and in *front after) FLIP_FACING. */
bool gn_ref_facing_admitted(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray, uint32_t instance,
                            bool *front);

/* The record's outcome becomes a hit, and what the instance adds is filled in; `hit` is the caller's. */
void gn_ref_record_finish(const struct gn_ref_scene *scene, struct gn_ref_record *record);

/* The order of instance, geometry, primitive. */
/* The bounds of numbers that are exact ones rounded once. */
void gn_ref_hit_set_rounding_errors(struct gn_ref_hit *hit, bool triangle);
int gn_ref_hit_compare_ids(const struct gn_ref_hit *a, const struct gn_ref_hit *b);
/* By `place` (t, or a box's entry clipped to tmin), then by ids; keeps the nearest `capacity`. */
struct gn_ref_placed {
    double place;
    struct gn_ref_record record;
};
struct gn_ref_placed_list {
    struct gn_ref_placed *items;
    size_t count, capacity;
    bool failed;
};
void gn_ref_placed_add(struct gn_ref_placed_list *list, double place, const struct gn_ref_record *record);
/* Sorts, drops what is there twice, writes, frees. What gn_ref_tracer_all() returns. */
int64_t gn_ref_placed_write(struct gn_ref_placed_list *list, struct gn_ref_record *out_records, size_t capacity);

/*
 * The tree of the tiers DOUBLE and EXACT: of their own making, so that EXACT shares no search with CERTIFIED. Four
 * children per node, four primitives per leaf.
 */
#define GN_REF_TREE_WIDTH 4
#define GN_REF_TREE_DEPTH 80
#define GN_REF_TREE_LEAF 0x80000000u
struct gn_ref_tree_node {
    float lower[3][GN_REF_TREE_WIDTH];
    float upper[3][GN_REF_TREE_WIDTH];
    uint32_t child[GN_REF_TREE_WIDTH]; /* a node, or a leaf with GN_REF_TREE_LEAF, or GN_REF_NONE */
};
struct gn_ref_tree_leaf {
    struct gn_ref_primitive items[GN_REF_TREE_WIDTH];
    uint32_t count;
};
struct gn_ref_tree {
    struct gn_ref_tree_node *nodes; /* the root is the first; none where there are no primitives */
    size_t node_count;
    struct gn_ref_tree_leaf *leaves;
    size_t leaf_count;
};

/*
 * Over the active primitives of a type of all instances. Every bound contains its primitives over the real numbers,
 * strictly: it is at least one f32 larger on every side. False when memory is short.
 */
bool gn_ref_tree_build(struct gn_ref_tree *out, const struct gn_ref_scene *scene, enum gn_ref_geometry_type type);
void gn_ref_tree_finish(struct gn_ref_tree *tree);
uint64_t gn_ref_tree_bytes(const struct gn_ref_tree *tree);

/* A vertex in the world, rounded in f64, and a bound of each coordinate's error (possibly infinite or NaN). */
void gn_ref_tree_vertex(const struct gn_ref_scene *scene, const struct gn_ref_primitive *primitive, int corner,
                        double out[3], double out_error[3]);

#endif
