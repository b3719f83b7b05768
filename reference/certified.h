/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The fast half of the closest hit: a traversal in f32 that loses no candidate, a filter in f32 over the eight triangles
 * of a leaf, one in f64 for each that is left, and for what they cannot decide the stages of certified.c. Kernels of the
 * same text are compiled for several instruction sets (certified_kernel.h).
 *
 * Lengths along the ray are measured as s = t |d_k|, k being the axis along which the direction d is largest, so that
 * s is the distance along k and every component of the direction is at most 1 in magnitude. Neither the direction's
 * length nor its exponents then matter: only R does, which bounds |w - o| in every coordinate and for every vertex w
 * of the scene. All below holds for 2^-80 <= R <= 2^90 (GN_REF_LEAST_REACH, GN_REF_MOST_REACH), rounding to nearest
 * without flushing, and rays that gn_ref_trace_ray_valid() passes; everything else takes the f64 traversal of trace.c.
 *
 * The slab test. u = 2^-24. Bounds b are relative to the tree's centre c; p = o - c is rounded by 2^-53 of itself.
 * g = d / |d_k| per axis. A hit at s has s <= R, for it lies within the scene. Where |g| < 2^-30 the traversal uses
 * g' = +-2^-30 instead: on the way to the hit the ray then is off by at most R 2^-30, so the bounds have to be that much
 * wider. For the exact inverse i of g (or g'), 1 <= |i| <= 2^30, a slab's end is at (b - p) i. Computed is
 *     b fl(i) - fl(p i +- delta),
 * from rounding i: u |b i|; from rounding the bias: u (|p i| + delta); from the product and the difference, when
 * they are rounded separately, u |b i| + u (|b i| + |p i| + delta) (1 + u). With |b| + |p| <= R together less than
 * 3.01 u R |i| + 2.01 u delta, and R 2^-30 |i| = R |i| u / 64 for the wider bounds. Hence
 *     delta = 4 u R |i|,
 * towards smaller s where the ray enters and towards larger s where it leaves, is enough; what is below f32's range
 * (2^-149 at a time) vanishes in its 2^-23 R >= 2^-103. The largest number is below 2^122. No infinity or NaN arises
 * but from the bounds of children that are not there, which are +inf on entry and -inf on exit whatever the sign of i.
 *
 * In an instance the tree is in object space, where the triangles are those of the BLAS: over the real numbers a line
 * meets a triangle in the world when its image under the inverse meets it in object space, at the same t, and U, V, W
 * are multiplied by the determinant. The image is known to origin_error and direction_error in each component (scene.c,
 * inverse_set()). With R now bounding |w - o| in object space, k the largest component of the direction there, and d_k that of
 * the world, a hit has t |d'_k| <= R: up to it the computed ray is within
 *     e = origin_error + R direction_error / |d'_k|
 * of the real one along every axis, and e is made larger by 2^-20 of itself to be safe from its own rounding. s stays that of the world:
 * all numbers of the slab test are as above with i = |d_k| / d', the smallest of which is `unit` = |d_k| / |d'_k|, g' being
 * +-2^-30 |d'_k| / |d_k| where g is smaller. Boxes have to be wider by e on every side:
 *     delta = (4 u R + 2 e) |i|.
 * R is only a bound and may be enlarged, so it is at least 2^-80; where R or R unit leaves the range above (or anything is not a
 * number) the f64 traversal takes the ray. unit comes of three roundings.
 *
 * In both filters a sheared coordinate of the computed ray differs from the real one's by at most the origin's error,
 * 2 origin_error, and |v_z| times the slope's, 2 direction_error / |d'_k|: 2 e. It joins the 2^-49 R of the f32 filter as
 * 2.5 e, and in f64 eps is 8 u R + 4 e. That also covers A_z, which is wrong by u R + e, and that t |d'_k| is s over unit
 * but for t direction_error <= e and a few roundings: the error of s grows by e + 5.1 u R to below 4.9 eps, of which 5 are
 * used. Where this is not enough for a decision, corners are placed in the world, each with the bound of its
 * own error, and all goes on there.
 *
 * The filter in f32 says only what is certainly missed. It works about a point c' close to the leaf's triangles and in
 * units of about the leaf's size, a power of two, so that its errors are those of numbers as small as the leaf is, wherever
 * the leaf, the scene and the ray's origin are. S = (d_x, d_y) / d_z as in filter.c, |S| <= 1. With
 *     beta = c'_x - o_x - S_x (c'_z - o_z)   (y alike),
 * which f64 gives within 2^-49 R (both differences, S, the product and the last difference are wrong by 2^-53 R or a few
 * times that), a vertex w = c' + v has the sheared coordinate x = v_x + beta - S_x v_z. Let m be the largest |v| along an
 * axis. v is computed as
 *     a) w - c' of two f32 (gn_ref_leaf_f32), wrong by u m; or
 *     b) q k (gn_ref_leaf_i16), exact, with m <= 2^15 q: wrong by 0.5625 q, the vertex's own error included.
 * The product by the unit or step is exact. Rounded are beta: u |beta|; v_x + beta: u (m_x + |beta|); S: u |S|; its product
 * with v_z, where that is rounded on its own: u |S| m_z; the last difference: u (m_x + |beta| + |S| m_z). With the errors
 * of v that is, but for terms in u^2, less than
 *     a) u (3 m_x + 3 |beta| + 4 |S| m_z);
 *     b) u (2 m_x + 3 |beta| + 3 m_z) + 0.5625 (q_x + |S| q_z) <= 0.57 q_x + (0.5625 |S| + 0.006) q_z + 3 u |beta|.
 * Used are, rounded themselves a few times,
 *     a) eps_x = 5 u (m_x + |S| m_z) + 4 u |beta| + 2^-49 R,   b) eps_x = 0.625 (q_x + (|S| + 2^-6) q_z) + the same.
 * An edge function B_x C_y - B_y C_x of coordinates that are wrong by eps_x and eps_y is wrong by at most
 * eps_x (|B_y| + |C_y|) + eps_y (|B_x| + |C_x|) + 2 eps_x eps_y, and by 2 u (1 + u) (|B_x C_y| + |B_y C_x|) from rounding.
 * With n_x the sum of all three |x|, and n_y, that is covered by
 *     E = n_y (eps_x + 4 u n_x) + eps_y (n_x + 2.5 eps_x).
 * Units and steps are powers of two, and steps at least 2^-40: nothing that counts underflows. What overflows, or is not known
 * (infinite steps), makes E infinite or a NaN, and excludes nothing.
 *
 * The filter in f64 is that of filter.c, whose words apply, with two differences. R is the ray's and not the
 * triangle's, which only makes the bound larger. S is d_x times the rounded reciprocal of d_k: an error of 2 u |S|
 * (u = 2^-53 from here on) instead of u |S| and |S| <= 1 + u, which adds u R to the 6 u R that a coordinate was found
 * to be wrong by: eps = 8 u R + 3 e still covers it. The error E = eps (1.5 n + 4 eps) is computed with n over all
 * three vertices, for all three edge functions.
 *
 * Where w - o is exact, that can be had much sharper: when the tree's vertices are f32 and multiples of its quantum q
 * (leaves that are not fine), the ray's origin is too, and R < 2^52 q, for then the difference is a multiple of q
 * below 2^53 q. S comes in two parts, S_1 an f32 and S_2 = (d_x - S_1 d_z) / d_z, whose numerator is exact
 * (a product of 48 bits, and a difference that is below the 24th bit of d_x): S_1 + S_2 is wrong by 2^-53 2^-24 at most, as
 * |S| <= 1. With fused products x = a_x - S_1 a_z is within 2^-24 R of the final one and wrong by u |x| + u 2^-24 R from
 * rounding; then - S_2 a_z adds u |x| and R 2^-77 for S. With others, p = fl(S_1 a_z) comes with its rest r, exactly (Dekker's
 * halves; S_1 is short), |r| <= u R; r + S_2 a_z, below 2^-24 (1 + 2^-20) R, is wrong by 2 u 2^-24 R, and x = (a_x - p) - that
 * by that, u (|x| + 2^-24 R), u |x| and R 2^-77 for S. Together 2 u |x| + h, h = 2^-75 R, either way. An edge function
 * B_x C_y - B_y C_x then is wrong by 4 u (|B_x C_y| + |B_y C_x|) + h n + terms of second order from the coordinates, and by
 * 2 u (|B_x C_y| + |B_y C_x|) from rounding. With P the largest of the three sums in parentheses
 *     E = 6.5 u P + 1.25 h n + 4 h^2
 * covers it. (In fine leaves the two parts of S cost one more rounding of x than the one S of other rays: from a, from the
 * product, from two differences of at most 2 R, 7 u R in all. eps covers it.) Both forms are E = c_1 P + c_2 n + c_3.
 *
 * s of a triangle that is certainly met: edge functions U, V, W are all of one sign, beyond E. S = U + V + W is wrong by
 * at most E_S = 3.5 E + 8 u |S| (a margin for its own rounding), which has to be below |S| / 64. b = V / S, computed as V times
 * the rounded reciprocal: 0 < b < 1 + 4u, wrong by less than
 *     (E + E_S) / (|S| - E_S) + 4 u <= f = 1.0625 (4.5 E + 8 u |S|) / |S| + 8 u,
 * c alike. s = A_z + b (B_z - A_z) + c (C_z - A_z), with P = |B_z - A_z| + |C_z - A_z|: an error of eps in A_z, of
 * at most 2 eps + u |.| in each difference, whose weights b and c sum up to less than 1 + 8u, of f (P + 4 eps) from the weights and of
 * 3 u P + 2 u |s| from rounding, where |s| <= 1.01 R. As 8 u R <= eps and f < 1/8:
 *     |error of s| <= eps + 2.1 eps + f P + eps / 2 + 4 u P + eps / 3 <= 4 eps + (f + 4 u) P.
 * Used is 5 eps + (f + 8 u) P.
 */
#ifndef GNOMON_REFERENCE_CERTIFIED_H
#define GNOMON_REFERENCE_CERTIFIED_H

#include <string.h>

#include "reference/trace_internal.h"

#define GN_REF_LEAST_REACH 0x1p-80
#define GN_REF_MOST_REACH 0x1p90

/* A triangle that the ray meets. The interval contains s. */
struct gn_ref_candidate {
    double lower, upper;
    double s, s_error;
    double beta, gamma, barycentric_error;
    uint64_t id; /* GN_REF_NO_ID: nothing */
    uint16_t zeros; /* bit i: edge function i is exactly 0 */
    int sum_sign; /* of U + V + W, in the world */
};

/* Whether the caller may have its numbers. */
static inline bool gn_ref_candidate_accurate(const struct gn_ref_candidate *candidate)
{
    return candidate->s_error <= 0x1.8p-41 * candidate->s && candidate->barycentric_error <= 0x1.8p-41;
}

struct gn_ref_flight;
/* s and barycentrics of a triangle that is met, in pairs of f64 (refine.c). False when they are still not accurate. */
bool gn_ref_candidate_refine(struct gn_ref_candidate *candidate, const struct gn_ref_flight *flight,
                             const struct gn_ref_scene *scene);

/* Of the tree over instances, and of the one below that a ray is in. */
#define GN_REF_STACK_SIZE (2 * (GN_REF_MAX_DEPTH + 1) * GN_REF_NODE_WIDTH)

/* A ray as a tree sees it, in the world or in an instance's object space. */
struct gn_ref_frame {
    const struct gn_ref_bvh *bvh;
    /* The slab test: s = bound * scale - bias; offsets into a node in bytes of what is met first and last. */
    float scale[4];
    float near_bias[4], far_bias[4];
    uint32_t near_offset[4], far_offset[4];
    /* The filter, in the order of axes x, y, z = k. */
    uint32_t axis[3];
    float shear_f32[2];
    double local[3], shear_whole[2], local_error; /* origin relative to the tree's centre */
    double origin[3];
    double shear[2], shear_rest[2];
    bool split; /* shear is an f32, and the rest not 0 for that */
    double sign; /* of d_k */
    double eps; /* of certified.h */
    double bound[3]; /* c_1, c_2, c_3 of certified.h, for leaves that are not fine */
    double unit; /* a length along this axis k as s, which is one along the world's */
    int turn; /* -1: the world sees the other side of triangles */
};

/* One ray on its way. */
struct gn_ref_flight {
    struct gn_ref_frame frames[2]; /* of the world; of the instance that it is inside of */
    uint32_t inside; /* 1: of an instance */
    uint32_t instance; /* then, or where the world's tree is one of triangles: whose triangles it meets */
    uint32_t floor; /* the stack's depth with nothing of that instance on it */
    bool lost; /* a frame would be out of range: the f64 traversal has to answer */
    float s_first_f32; /* rounded down */
    float s_limit_f32; /* rounded up: no larger s is of interest */
    double direction[3]; /* in the order of the world's axes */
    double s_first, s_last; /* tmin and tmax times |d_k|, which is exact */
    uint32_t effects; /* called for by the ray, or forced on */
    uint32_t tests; /* of these: what may keep a triangle from being met; set by certified.c like the former */
    uint32_t current; /* the child to be visited next */
    uint32_t depth;
    struct gn_ref_candidate best;
    const struct gn_ref_ray *ray;
    size_t index; /* of the ray in the batch */
    double length; /* |d_k| */
    uint64_t stack[GN_REF_STACK_SIZE]; /* where the box is entered, as the bits of an f32, above the child */
};

/* Prepares a flight. False when the ray is outside the range above. */
typedef bool gn_ref_certified_start(struct gn_ref_flight *flight, const struct gn_ref_scene *scene,
                                    const struct gn_ref_ray *ray);
gn_ref_certified_start gn_ref_certified_start_portable;
gn_ref_certified_start gn_ref_certified_start_avx2;
gn_ref_certified_start gn_ref_certified_start_avx512;

/* The next f32 that is not above or not below a number that is at least 0. */
static inline float gn_ref_f32_down(double value)
{
    float rounded = (float)value;
    uint32_t bits;
    memcpy(&bits, &rounded, sizeof bits);
    bits -= (double)rounded > value;
    memcpy(&rounded, &bits, sizeof bits);
    return rounded;
}

static inline float gn_ref_f32_up(double value)
{
    float rounded = (float)value;
    uint32_t bits;
    memcpy(&bits, &rounded, sizeof bits);
    bits += (double)rounded < value;
    memcpy(&rounded, &bits, sizeof bits);
    return rounded;
}

/* One call: what its rays share. */
struct gn_ref_certified {
    const struct gn_ref_scene *scene;
    gn_ref_certified_start *start; /* NULL: no kernel is to be used */
    bool any; /* the first hit will do */
    bool fits_cache; /* the tree is so small that nothing has to be asked for ahead */
    struct gn_ref_environment environment;
    uint32_t forced; /* effects */
    struct gn_ref_effect_counts *counts; /* NULL: not wanted */
    uint64_t filtered; /* triangles decided here, by whichever of the three: */
    uint64_t rejected_f32, sharpened;
    /* For what the filter cannot decide; of the ray that last needed it. */
    const struct gn_ref_ray *slow_ray;
    bool slow_exact_ready;
    struct gn_ref_ray_setup slow_setup; /* of that ray with d_k = +-1: gives s in place of t */
    struct gn_ref_trace slow;
    /* The batch. */
    const struct gn_ref_ray *rays;
    size_t count, next;
    struct gn_ref_hit *hits; /* NULL: not wanted */
    size_t stride; /* from one to the next, in bytes */
    struct gn_ref_hit unwanted;
    int8_t *found;
};

/* A triangle that is met and before the best becomes the best. */
static inline void gn_ref_certified_take(const struct gn_ref_certified *call, struct gn_ref_flight *flight,
                                         const struct gn_ref_candidate *candidate)
{
    const struct gn_ref_bvh *tree = gn_ref_scene_tree(call->scene, gn_ref_id_instance(candidate->id));
    if (tree->leaves_f32)
        __builtin_prefetch(tree->leaves_f32[(uint32_t)candidate->id / GN_REF_NODE_WIDTH].geometry);
    flight->best = *candidate;
    if (call->any) {
        flight->depth = 0;
        flight->s_limit_f32 = -1;
        return;
    }
    float limit = gn_ref_f32_up(candidate->upper);
    if (limit < flight->s_limit_f32)
        flight->s_limit_f32 = limit;
}

/* The next ray of the batch that needs a flight; false when there is none. */
bool gn_ref_certified_next(struct gn_ref_certified *call, struct gn_ref_flight *flight);
/* Writes the answer of a flight that has ended. */
void gn_ref_certified_end(struct gn_ref_certified *call, struct gn_ref_flight *flight);

/* Decides about a triangle by the exact stages and takes it if it is nearer than the best. */
void gn_ref_certified_consider(struct gn_ref_certified *call, struct gn_ref_flight *flight, uint64_t id);
/*
 * A triangle about which the filter cannot decide, with what it says of the edge functions: whether the ray meets it exactly
 * where it meets the best one, in an edge or vertex that they share. Then it is taken if it comes before it. `sense` turns the
 * edge functions' sign into that of U, V, W in the world.
 */
bool gn_ref_certified_tie(struct gn_ref_certified *call, struct gn_ref_flight *flight, uint64_t id, const double edge[3],
                          double error, int sense);
/* Takes a triangle that is certainly met unless a mask or flag forbids it or s cannot be placed. */
void gn_ref_certified_offer(struct gn_ref_certified *call, struct gn_ref_flight *flight,
                            const struct gn_ref_candidate *candidate);

/* A kernel: traces the batch, or, where single is given, that flight to its end. */
typedef void gn_ref_certified_run(struct gn_ref_certified *call, struct gn_ref_flight *single);
gn_ref_certified_run gn_ref_certified_run_portable;
gn_ref_certified_run gn_ref_certified_run_avx2;
gn_ref_certified_run gn_ref_certified_run_avx512;

/*
 * Chooses the kernel by name: "avx512", "avx2", "portable", or "none" for the f64 traversal alone; NULL for the best one.
 * False when this machine has none of that name. The variable GNOMON_REFERENCE_KERNEL does the same from outside. For
 * tests: all give the same answers.
 */
bool gn_ref_certified_force(const char *name);

/* Batches take their rays in flight however small the scene is. For tests. */
void gn_ref_certified_fly_always(bool always);

#endif
