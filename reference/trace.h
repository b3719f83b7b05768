/* SPDX-License-Identifier: Apache-2.0 */
/* Exact answers: which primitives a ray meets, in which order. */
#ifndef GNOMON_REFERENCE_TRACE_H
#define GNOMON_REFERENCE_TRACE_H

#include "reference/scene.h"

#ifdef __cplusplus
extern "C" {
#endif
#ifdef __GNUC__
#pragma GCC visibility push(default) /* what the shared library exports */
#endif

/* The values are those of SPIR-V's Ray Flags. */
enum {
    GN_REF_RAY_OPAQUE = 0x1,
    GN_REF_RAY_NO_OPAQUE = 0x2,
    GN_REF_RAY_TERMINATE_ON_FIRST_HIT = 0x4,
    GN_REF_RAY_SKIP_CLOSEST_HIT_SHADER = 0x8,
    GN_REF_RAY_CULL_BACK_FACING = 0x10,
    GN_REF_RAY_CULL_FRONT_FACING = 0x20,
    GN_REF_RAY_CULL_OPAQUE = 0x40,
    GN_REF_RAY_CULL_NO_OPAQUE = 0x80,
    GN_REF_RAY_SKIP_TRIANGLES = 0x100,
    GN_REF_RAY_SKIP_AABBS = 0x200,
};

/*
 * Finite origin and direction, direction not zero, 0 <= tmin <= tmax, neither NaN; tmax may be +inf.
 * Only the low 8 bits of cull_mask count. Combinations of flags that the API excludes are taken by their parts.
 */
struct gn_ref_ray {
    float origin[3];
    float tmin;
    float direction[3];
    float tmax;
    uint32_t flags;
    uint32_t cull_mask;
};

/*
 * One primitive met by a ray.
 *
 * Triangles: t; beta and gamma, the barycentrics of the second and third vertex. `front` is the facing as the API
 * defines it, after instance flags. t_exit is t.
 *
 * AABBs: t and t_exit are the ends of the stay of the ray's line inside the box, not clipped by tmin and tmax (t
 * may be negative); beta and gamma are 0, front is false.
 *
 * What these numbers may be wrong by comes with them: |t - exact| <= t_error and so on, exact being the value over the real
 * numbers for the primitive that is named; barycentric_error bounds beta and gamma each (and so 1 - beta - gamma by
 * twice that and its rounding). The bounds are the ones by which the decisions were made, derived from the sizes of the numbers at hand:
 *
 *   computed in                                      derived in                 bound of t, of barycentrics
 *   f64                                              certified.h and filter.c   as it comes out; 2^-47 |t| and 2^-47 in the
 *                                                                               median over what is hard to decide
 *   pairs of f64, where that is beyond 2^-40.4       refine.c                   a little more than 2^-52 |t|, than 2^-53
 *   integers of any size, where no pairs will do     exact.c                    2^-53 |t|, 2^-53 of the larger one: half an ulp
 *
 * and never more than 2^-40 |t| and 2^-40, but for the 2^-1074 below. tests/reference/test_proof.c holds them against exact
 * values over a million hard rays: none is exceeded; those of f64, made for the worst case, are in the median of every family less than 512 times (t) and 1,024
 * times (barycentrics) what the number is wrong by. gn_ref_hit_refine_exact() of tracer.h gives half an ulp for any hit.
 *
 * A bound of integers is 2^-1074, the least f64, where half an ulp is below that: so a number that is too small for f64 comes out as 0
 * with that bound, as an exact 0 does. f64 vertices have such a t, and f32 ones placed by a transform of the geometry and one
 * of the instance. A t too large for f64 comes out as infinite, and its bound with it.
 *
 * The same hit found by another function may have been computed in another of these ways: its t and barycentrics then differ, within
 * both bounds. Equal bits are promised for a batch against its rays alone, and by gn_ref_hit_refine_exact().
 */
struct gn_ref_hit {
    enum gn_ref_geometry_type type;
    uint32_t instance;
    uint32_t geometry;
    uint32_t primitive;
    double t;
    double t_exit;
    double beta;
    double gamma;
    bool front;
    bool opaque; /* after geometry, instance and ray flags */
    double t_error; /* this and the following: see above */
    double t_exit_error;
    double barycentric_error;
};

/*
 * Everything a ray meets that its mask, culling and skip flags admit, decided exactly:
 *
 * - a triangle when the ray's line meets the closed triangle (its boundary included) and tmin < t < tmax;
 *   an edge-on or degenerate triangle never;
 * - an AABB when the closed box meets the ray's closed range [tmin, tmax].
 *
 * In the order of exact t (of AABBs: the entry clipped to tmin), ties in the order of instance, geometry,
 * primitive. TERMINATE_ON_FIRST_HIT has no influence. At most `capacity` are written, the nearest ones; the
 * number found is returned. out_hits may be NULL when capacity is 0. -1 when memory is short, the ray is not valid
 * or the scene not committed. (GMP ends the process when the few kilobytes of its numbers cannot be had.)
 *
 * Thread-safe on a committed scene. The caller's rounding mode and denormal flushing have no influence and are kept.
 */
int64_t gn_ref_trace_all_exact(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray,
                               struct gn_ref_hit *out_hits, size_t capacity);

/*
 * The first triangle of that list and 1, or 0 when the list has no triangle; -1 as above. Opaque or not makes
 * no difference here. Faster than the list.
 */
int gn_ref_trace_closest_triangle_exact(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray,
                                        struct gn_ref_hit *out_hit);

/*
 * The same for many rays: out_found[i] is what the call above returns for rays[i], out_hits[i] is written where that
 * is 1. Faster than one after the other where the scene is larger than the processor's caches.
 */
void gn_ref_trace_closest_triangles_exact(const struct gn_ref_scene *scene, const struct gn_ref_ray *rays,
                                          size_t count, struct gn_ref_hit *out_hits, int8_t *out_found);

/*
 * Compares the exact t at which the ray's line meets the planes of two triangles (named by instance, geometry and
 * primitive): -1, 0 or 1. 0 too when one is unknown, inactive, degenerate or parallel to the line. Flags, mask, tmin
 * and tmax make no difference, but have to be valid.
 */
int gn_ref_compare_t_exact(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray,
                           const struct gn_ref_hit *a, const struct gn_ref_hit *b);

/*
 * How often the f64 filter decided about a primitive, how often integers of fixed width had to, and how often
 * integers of any size: for tests and reports. Process-wide counters, added to once per ray; exact once the
 * tracing threads are done.
 */
struct gn_ref_trace_counters {
    uint64_t filtered;
    uint64_t wide;
    uint64_t exact;
};
struct gn_ref_trace_counters gn_ref_trace_counters(void);

#ifdef __GNUC__
#pragma GCC visibility pop
#endif
#ifdef __cplusplus
}
#endif
#endif
