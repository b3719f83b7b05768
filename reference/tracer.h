/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Tracing at a chosen accuracy: five tiers behind one API, so that what an accuracy costs can be measured on the same
 * scene and rays.
 *
 *     struct gn_ref_tracer *tracer = gn_ref_tracer_create(scene, GN_REF_TIER_CERTIFIED, error, sizeof error);
 *     struct gn_ref_record record;
 *     if (gn_ref_tracer_closest(tracer, &ray, &record) == GN_REF_HIT)
 *         use(record.hit.primitive, record.hit.t);
 *     gn_ref_tracer_destroy(tracer);
 *
 * What a ray meets. Every primitive that the mask, culling, opacity and skip flags admit counts, opaque or not: there
 * are no shaders here, so nothing confirms, ignores or generates. Triangles are met for tmin < t < tmax, AABBs when
 * the closed box meets [tmin, tmax]; the place of an AABB in the order is its entry clipped to tmin. Ties are in the
 * order of instance, geometry, primitive. trace.h has the words; all tiers take them, and differ only in the
 * arithmetic by which they decide. TERMINATE_ON_FIRST_HIT and SKIP_CLOSEST_HIT_SHADER change no answer:
 * gn_ref_tracer_closest() gives the nearest hit all the same, and gn_ref_tracer_occluded() is the question that stops
 * at the first. A cull mask without a bit of an instance's mask hides that instance; a mask of 0 hides everything.
 *
 * What is not a ray. Origin and direction have to be finite, the direction not zero, 0 <= tmin <= tmax, neither NaN;
 * tmax may be infinite. Anything else is answered by GN_REF_INVALID_RAY, by every tier alike, and traces nothing. -0 is
 * 0; denormal numbers are what they stand for (the Embree tiers may flush them if the caller's thread does). A scene
 * without primitives, or with inactive ones only, is valid: every valid ray misses.
 *
 * Threads. A tracer is not changed by tracing: any number of threads may use one at once, and any number of tracers
 * may share a scene. No function here starts threads. Destroy a tracer when nothing traces with it, and before its scene.
 */
#ifndef GNOMON_REFERENCE_TRACER_H
#define GNOMON_REFERENCE_TRACER_H

#include "reference/trace.h"

#ifdef __cplusplus
extern "C" {
#endif
#ifdef __GNUC__
#pragma GCC visibility push(default) /* what the shared library exports */
#endif

/*
 * FAST: Embree as it comes, f32. ROBUST: Embree with RTC_SCENE_FLAG_ROBUST, f32. Vertices and transforms are what an
 * engineer would hand over: positions / divisor rounded to f32, the geometry transform applied to them in f32, one Embree
 * instance per instance (none where the scene is one untransformed instance), callbacks only where ray flags, or AABBs
 * in the scene, call for them. Embree ignores what lies beyond about 1.8e18. In ROBUST tmin = 0 stands for t >= 2^-120.
 *
 * DOUBLE: placed, traversed and decided in f64, watertight at shared vertices of one geometry, with bounds that lose no
 * candidate; signs are taken as they come out, those of triangles without area, too.
 *
 * CERTIFIED: the answers of trace.h: exact decisions, by f64 where its error bound allows.
 *
 * EXACT: integers of any size for everything, the boxes of the tree included. The oracle; thousands of rays per second.
 */
enum gn_ref_tier {
    GN_REF_TIER_FAST,
    GN_REF_TIER_ROBUST,
    GN_REF_TIER_DOUBLE,
    GN_REF_TIER_CERTIFIED,
    GN_REF_TIER_EXACT,
    GN_REF_TIER_COUNT
};

/* "fast", "robust", "double", "certified", "exact"; NULL for what is no tier. */
const char *gn_ref_tier_name(enum gn_ref_tier tier);
/* The tier of that name. False, and *out_tier as it was, when there is none (NULL is no name). */
bool gn_ref_tier_find(const char *name, enum gn_ref_tier *out_tier);

struct gn_ref_tracer;

/*
 * Builds what the tier needs, on the calling thread. The scene has to be committed and to outlive the tracer. NULL when
 * the scene is NULL or not committed, the tier unknown, or memory short; then `error` (of error_size bytes, may be NULL
 * with 0) has a message. On success it is "".
 */
struct gn_ref_tracer *gn_ref_tracer_create(const struct gn_ref_scene *scene, enum gn_ref_tier tier, char *error,
                                           size_t error_size);
void gn_ref_tracer_destroy(struct gn_ref_tracer *tracer);
enum gn_ref_tier gn_ref_tracer_tier(const struct gn_ref_tracer *tracer);

/*
 * seconds: the wall-clock time of the build. bytes: the memory that the tier keeps for tracing, as allocated, Embree's
 * included; what the scene keeps of its inputs is not in it. CERTIFIED traces with what gn_ref_scene_commit() made: its
 * time and bytes are those of the commit.
 */
struct gn_ref_tracer_cost {
    double seconds;
    uint64_t bytes;
};
struct gn_ref_tracer_cost gn_ref_tracer_cost(const struct gn_ref_tracer *tracer);

enum gn_ref_outcome {
    GN_REF_MISS = 0,
    GN_REF_HIT = 1,
    GN_REF_INVALID_RAY = -1, /* see above */
    GN_REF_FAILED = -2 /* memory is short */
};

/*
 * A hit. What its numbers may be wrong by is in it (hit.t_error, hit.t_exit_error, hit.barycentric_error), too:
 *
 * CERTIFIED: bounds derived for this very hit; struct gn_ref_hit (trace.h) says from what and how large. EXACT: 2^-53 of the
 * number (2^-1074 at least), a quotient of integers that is rounded once. FAST, ROBUST, DOUBLE: infinite, nothing is promised. 0 for numbers that are
 * 0 by definition (the barycentrics of a box), infinite for a t that f64 has no number for.
 *
 * `hit` is all zero when the outcome is not GN_REF_HIT.
 */
struct gn_ref_record {
    enum gn_ref_outcome outcome;
    uint32_t custom_index; /* of the instance */
    uint32_t sbt_offset; /* of the instance */
    struct gn_ref_hit hit;
};

/* The nearest hit. The outcome is returned too. */
enum gn_ref_outcome gn_ref_tracer_closest(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray,
                                          struct gn_ref_record *out_record);

/* Whether there is a hit at all. */
enum gn_ref_outcome gn_ref_tracer_occluded(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray);

/*
 * All hits in order; the first is that of gn_ref_tracer_closest(), whose numbers may differ within their bounds. At most `capacity` are written, the nearest ones; how many there are is returned, or an outcome
 * below 0. out_records may be NULL when capacity is 0.
 */
int64_t gn_ref_tracer_all(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray,
                          struct gn_ref_record *out_records, size_t capacity);

/*
 * The same for many rays: out[i] belongs to rays[i], and is what the call for that ray alone gives, to the last bit
 * (but for FAST and ROBUST, where Embree's packets may round differently). A tier may keep several rays in flight at
 * once, which is what makes it faster where the scene is larger than the caches; flags and masks may differ from ray to
 * ray. Rays that are not valid cost nothing and disturb no other. Arrays may be NULL when ray_count is 0.
 */
void gn_ref_tracer_closest_batch(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *rays, size_t ray_count,
                                 struct gn_ref_record *out_records);
void gn_ref_tracer_occluded_batch(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *rays, size_t ray_count,
                                  enum gn_ref_outcome *out_outcomes);
/* out_records has room for ray_count times capacity, those of ray i from i * capacity on; out_counts[i] is what
 * gn_ref_tracer_all() returns. */
void gn_ref_tracer_all_batch(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *rays, size_t ray_count,
                             struct gn_ref_record *out_records, size_t capacity, int64_t *out_counts);

/*
 * What a shader can ask for beside the record. Each number is the exact one, a quotient of integers, rounded once to the nearest f64: wrong by
 * half an ulp, 2^-53 of its magnitude or 2^-1075, at most, whatever the tier of the hit. Matrices are 3 rows of 4.
 */
struct gn_ref_hit_detail {
    float world_from_object[12]; /* the instance's transform, bit by bit: no error */
    double object_from_world[12]; /* its inverse */
    double object_origin[3];
    double object_direction[3];
    /* Triangles: positions / divisor after the geometry transform, and those placed in the world. Boxes: all 0. */
    double object_vertices[3][3];
    double world_vertices[3][3];
};

/*
 * Of a ray and the primitive that `hit` names by instance, geometry and primitive (nothing else is looked at). False
 * when the scene is not committed, the ray not valid, or the ids name no active primitive. Exact and not fast: some
 * microseconds.
 */
bool gn_ref_hit_detail_exact(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray,
                             const struct gn_ref_hit *hit, struct gn_ref_hit_detail *out_detail);

/*
 * Puts the exact t, t_exit, beta and gamma, rounded once to the nearest f64, in place of those of a hit, and half an ulp of theirs (2^-1074 at least) in
 * place of its bounds, whatever the tier of the hit; nothing else in it is looked at or changed but the ids. False, and the hit as it was, as above and
 * where the ray's line is parallel to the triangle or the ray misses the box. Some microseconds.
 */
bool gn_ref_hit_refine_exact(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray, struct gn_ref_hit *hit);

#ifdef __GNUC__
#pragma GCC visibility pop
#endif
#ifdef __cplusplus
}
#endif
#endif
