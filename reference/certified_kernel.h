/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The traversal and the filter of certified.h, once per instruction set: the including file has defined f8 and d8
 * (eight f32, eight f64), operations on them, FUSED, whether a product and a sum are rounded once, and GN_REF_KERNEL and
 * GN_REF_KERNEL_START, the names of the entries. The bounds allow for both.
 */
#include <float.h>
#include <math.h>
#include <string.h>

#include "reference/certified.h"

/* Rays in flight: enough for the others' work to hide the wait for memory. */
#define FLIGHTS 16

/* The rest of a difference d of a and b, exactly (Knuth's TwoSum). */
static inline d8 d8_difference_rest(d8 a, d8 b, d8 d)
{
    d8 other = d8_sub(d, a);
    return d8_sub(d8_sub(a, d8_sub(d, other)), d8_add(b, other));
}

/* A leaf's first lines; a node's are all of it. */
static inline void prefetch_child(const struct gn_ref_bvh *bvh, uint32_t child, bool narrow)
{
    const char *leaves = narrow ? (const char *)bvh->blocks_f32 : (const char *)bvh->blocks_f64;
    bool is_leaf = child & GN_REF_LEAF_BIT;
    size_t size = is_leaf ? narrow ? sizeof *bvh->blocks_f32 : sizeof *bvh->blocks_f64 : sizeof *bvh->nodes;
    const char *memory = (is_leaf ? leaves : (const char *)bvh->nodes) +
                         (size_t)(child & ~(GN_REF_LEAF_BIT | GN_REF_FINE_BIT)) * size;
    for (size_t offset = 0; offset < 256; offset += 64)
        __builtin_prefetch(memory + offset);
    for (size_t offset = 256; offset < (narrow ? sizeof *bvh->blocks_f32 : sizeof *bvh->blocks_f64); offset += 64)
        __builtin_prefetch(memory + offset);
}

/* Goes on with the nearest of what waits; false when nothing does. */
static inline bool flight_pop(struct gn_ref_flight *flight)
{
    while (flight->depth > 0) {
        uint64_t top = flight->stack[--flight->depth];
        uint32_t bits = (uint32_t)(top >> 32);
        float near;
        memcpy(&near, &bits, sizeof near);
        if (near <= flight->s_limit_f32) {
            flight->current = (uint32_t)top;
            return true;
        }
    }
    return false;
}

/* Where the children's boxes are entered, and which are met at all. */
static inline unsigned node_test(uint32_t keys[GN_REF_NODE_WIDTH], const struct gn_ref_flight *flight,
                                 const struct gn_ref_bvh *bvh)
{
    const char *memory = (const char *)&bvh->nodes[flight->current];
    f8 near = f8_set1(flight->s_first_f32), far = f8_set1(flight->s_limit_f32);
#define SLAB(axis)                                                                                                     \
    do {                                                                                                               \
        f8 scale = f8_set1(flight->scale[axis]);                                                                       \
        f8 first = f8_load((const float *)(const void *)(memory + flight->near_offset[axis]));                         \
        f8 last = f8_load((const float *)(const void *)(memory + flight->far_offset[axis]));                           \
        near = f8_max(f8_mulsub(first, scale, f8_set1(flight->near_bias[axis])), near);                                \
        far = f8_min(f8_mulsub(last, scale, f8_set1(flight->far_bias[axis])), far);                                    \
    } while (0)
    /* near stays the second operand: a -0 would sort behind everything as an integer. */
    SLAB(0);
    SLAB(1);
    SLAB(2);
    f8_store((float *)(void *)keys, near);
    return f8_le(near, far);
}

/* Goes on with the nearest child. */
static inline bool node_leave(struct gn_ref_flight *flight, const struct gn_ref_bvh *bvh,
                              const uint32_t keys[GN_REF_NODE_WIDTH], unsigned met, bool prefetch,
                              bool narrow)
{
    const struct gn_ref_node *node = &bvh->nodes[flight->current];
    if (met == 0)
        return flight_pop(flight);
    unsigned i = (unsigned)__builtin_ctz(met);
    met &= met - 1;
    if (met == 0) {
        flight->current = node->child[i];
        return true;
    }
    /* The nearest in hand, the others on the stack with the farthest first. */
    uint64_t nearest = (uint64_t)keys[i] << 32 | node->child[i];
    uint64_t *base = flight->stack + flight->depth, *place = base;
    do {
        i = (unsigned)__builtin_ctz(met);
        met &= met - 1;
        uint64_t key = (uint64_t)keys[i] << 32 | node->child[i];
        if (prefetch)
            prefetch_child(bvh, node->child[i], narrow);
        uint64_t larger = key > nearest ? key : nearest;
        nearest = key > nearest ? nearest : key;
        uint64_t *to = place++;
        while (to > base && to[-1] < larger) {
            to[0] = to[-1];
            to--;
        }
        *to = larger;
    } while (met);
    flight->depth += (uint32_t)(place - base);
    flight->current = (uint32_t)nearest;
    return true;
}

/* s, the barycentrics and their error bounds (certified.h) of lanes whose edge functions are of one sign or 0. */
struct placed {
    d8 s, s_error, beta, gamma, barycentric_error, sum;
    unsigned known; /* lanes whose sum is far enough from 0 */
};

static inline void lanes_place(struct placed *out, const struct gn_ref_flight *flight, const d8 edge[3], const d8 z[3],
                               d8 error, d8 eps)
{
    const double unit = 0x1p-53;
    d8 sum = d8_add(d8_add(edge[0], edge[1]), edge[2]);
    out->known = d8_gt(d8_mul(d8_abs(sum), d8_set1(1.0 / 64 - 8 * unit)), d8_mul(error, d8_set1(3.5)));
    d8 inverse = d8_div(d8_set1(1), sum);
    d8 beta = d8_mul(edge[1], inverse), gamma = d8_mul(edge[2], inverse);
    d8 f = d8_muladd(d8_mul(error, d8_set1(1.0625 * 4.5)), d8_abs(inverse), d8_set1(17 * unit));
    d8 p = d8_sub(z[1], z[0]), q = d8_sub(z[2], z[0]);
    out->s = d8_mul(d8_set1(flight->sign), d8_add(z[0], d8_muladd(beta, p, d8_mul(gamma, q))));
    d8 extent = d8_add(d8_abs(p), d8_abs(q));
    out->s_error = d8_muladd(d8_add(f, d8_set1(8 * unit)), extent, d8_mul(eps, d8_set1(5)));
    out->beta = beta;
    out->gamma = gamma;
    out->barycentric_error = f;
    out->sum = sum;
}

struct lanes {
    double s[8], s_error[8], beta[8], gamma[8], barycentric_error[8], sum[8];
};

static inline void lanes_store(struct lanes *out, const struct placed *placed)
{
    d8_store(out->s, placed->s);
    d8_store(out->s_error, placed->s_error);
    d8_store(out->beta, placed->beta);
    d8_store(out->gamma, placed->gamma);
    d8_store(out->barycentric_error, placed->barycentric_error);
    d8_store(out->sum, placed->sum);
}

static inline void lane_get(struct gn_ref_candidate *out, const struct lanes *lanes, int lane, double sign)
{
    out->s = lanes->s[lane];
    out->s_error = lanes->s_error[lane];
    out->lower = lanes->s[lane] - lanes->s_error[lane];
    out->upper = lanes->s[lane] + lanes->s_error[lane];
    out->beta = lanes->beta[lane];
    out->gamma = lanes->gamma[lane];
    out->barycentric_error = lanes->barycentric_error[lane];
    out->sum_sign = (lanes->sum[lane] > 0) ^ (sign < 0) ? 1 : -1;
}

/* Lanes that are met. Those whose s cannot be placed are returned. zeros[i]: lanes whose edge function i is 0. */
static inline unsigned lanes_offer(struct gn_ref_certified *call, struct gn_ref_flight *flight, unsigned met,
                                   const unsigned zeros[3], const uint32_t *ids, uint32_t leaf, const d8 edge[3],
                                   const d8 z[3], d8 error, d8 eps)
{
    struct placed placed;
    lanes_place(&placed, flight, edge, z, error, eps);
    d8 lower = d8_sub(placed.s, placed.s_error), upper = d8_add(placed.s, placed.s_error);
    unsigned wanted = met & placed.known & d8_gt(d8_set1(flight->s_last), lower) &
                      d8_gt(upper, d8_set1(flight->s_first)) & ~d8_gt(lower, d8_set1(flight->best.upper));
    if (wanted) {
        struct lanes lanes;
        lanes_store(&lanes, &placed);
        do {
            int lane = __builtin_ctz(wanted);
            wanted &= wanted - 1;
            struct gn_ref_candidate candidate = {.id = ids[lane], .leaf = leaf, .lane = (uint16_t)lane};
            for (int i = 0; i < 3; i++)
                candidate.zeros |= (uint16_t)((zeros[i] >> lane & 1) << i);
            lane_get(&candidate, &lanes, lane, flight->sign);
            gn_ref_certified_offer(call, flight, &candidate);
        } while (wanted);
    }
    return met & ~placed.known;
}

/* One coordinate of a leaf's vertices, for all lanes. */
static inline d8 leaf_axis(const struct gn_ref_bvh *bvh, uint32_t leaf, int vertex, uint32_t offset, bool narrow)
{
    return narrow ? d8_load_f32(&bvh->blocks_f32[leaf].w[vertex][0][0] + offset)
                  : d8_load(&bvh->blocks_f64[leaf].w[vertex][0][0] + offset);
}

/* a b - c d, rounded once but for terms of the order of u^2 (|a b| + |c d|), and what its error is bounded by. */
static inline d8 cross_sharp(d8 a, d8 b, d8 c, d8 d, d8 *out_error, unsigned *exact)
{
    d8 p = d8_mul(a, b), q = d8_mul(c, d);
    d8 p_rest = d8_product_rest(a, b, p), q_rest = d8_product_rest(c, d, q);
    d8 high = d8_sub(p, q), high_rest = d8_difference_rest(p, q, high);
    d8 low = d8_add(high_rest, d8_sub(p_rest, q_rest));
    d8 value = d8_add(high, low);
    *out_error = d8_muladd(d8_abs(value), d8_set1(0x1p-53), d8_mul(d8_add(d8_abs(p), d8_abs(q)), d8_set1(0x1p-103)));
    *exact &= d8_equal(p_rest, d8_set1(0)) & d8_equal(q_rest, d8_set1(0)) & d8_equal(high_rest, d8_set1(0));
    return value;
}

/*
 * The edge functions of eight triangles with everything compensated once, u = 2^-53. As in wide.c the shear is
 * multiplied by d_z: x = d_z a_x - d_x a_z, y likewise, and the edge functions by d_z^2, which changes nothing that is asked.
 *
 * a = w - o comes with its rounding error, found exactly; with the vertex's own that bounds it by r. In cross_sharp()
 * products and their difference come with their rests, found exactly too; adding these up is wrong by less than
 * 2 u^2 (|p| + |q|) (1 + 4u) for the rests of the products and as much for the rest of the difference, 4 u^2 in all, and
 * the last sum by u |value|; 2^-103 = 8 u^2 covers that. So x is wrong by
 *     e_x = u |x| + 8 u^2 (|p| + |q|) + (|d_z| + |d_x|) r.
 * and an edge function x_j y_k - y_j x_k by e_xj |y_k| + |x_j| e_yk + e_xj e_yk, the same with x and y exchanged, and its own
 * rounding. Those sums are rounded themselves, which the factor 1.0625 covers. What underflows is less than 2^-900 of
 * a scene's range: R >= 2^-80 and |d_z| >= 2^-149, which the constant covers.
 *
 * Where all of r and the rests in x and y are 0, x and y are exact; the products of an edge function then are each a
 * rounded one and a rest, and their order is that of the rounded ones unless these are equal, for rounding is monotone.
 * That asks for rests that do not underflow: f32 vertices and origins differ by multiples of 2^-149, x and y are
 * multiples of 2^-298, and rests of 2^-596. Vertices in f64 may be finer; there nothing counts as exact unless x and y
 * are 0 or at least 2^-400, and so are the differences.
 */
struct sharp {
    d8 edge[3], z[3], error, eps;
    unsigned positive[3], negative[3], zero[3];
};

static inline void leaf_sharpen(struct sharp *out, const struct gn_ref_flight *flight, const struct gn_ref_bvh *bvh,
                                uint32_t leaf, bool narrow)
{
    d8 w[3][3], x[3], y[3], x_error[3], y_error[3];
    d8 rest = d8_set1(0), most_z = d8_set1(0);
    d8 dx = d8_set1(flight->direction[0]), dy = d8_set1(flight->direction[1]), dz = d8_set1(flight->direction[2]);
    d8 size = d8_set1(2 * flight->length);
    unsigned exact = 0xFF;
    for (int v = 0; v < 3; v++)
        for (int i = 0; i < 3; i++) {
            d8 vertex = leaf_axis(bvh, leaf, v, flight->offset[i], narrow);
            d8 o = d8_set1(flight->origin[i]), a = d8_sub(vertex, o);
            rest = d8_max(d8_abs(d8_difference_rest(vertex, o, a)), rest);
            w[v][i] = a;
            if (!narrow)
                exact &= d8_equal(a, d8_set1(0)) | d8_gt(d8_abs(a), d8_set1(0x1p-400));
        }
    if (!narrow)
        rest = d8_add(rest, d8_load(bvh->blocks_f64[leaf].error));
    exact &= d8_equal(rest, d8_set1(0));
    d8 spread = d8_muladd(size, rest, d8_set1(0x1p-900));
    for (int v = 0; v < 3; v++) {
        x[v] = cross_sharp(dz, w[v][0], dx, w[v][2], &x_error[v], &exact);
        y[v] = cross_sharp(dz, w[v][1], dy, w[v][2], &y_error[v], &exact);
        x_error[v] = d8_add(x_error[v], spread);
        y_error[v] = d8_add(y_error[v], spread);
        out->z[v] = w[v][2];
        most_z = d8_max(d8_abs(w[v][2]), most_z);
        if (!narrow)
            exact &= (d8_equal(x[v], d8_set1(0)) | d8_gt(d8_abs(x[v]), d8_set1(0x1p-400))) &
                     (d8_equal(y[v], d8_set1(0)) | d8_gt(d8_abs(y[v]), d8_set1(0x1p-400)));
    }
    out->error = d8_set1(0);
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        d8 p = d8_mul(x[j], y[k]), q = d8_mul(y[j], x[k]);
        d8 p_rest = d8_product_rest(x[j], y[k], p), q_rest = d8_product_rest(y[j], x[k], q);
        d8 high = d8_sub(p, q), low = d8_sub(p_rest, q_rest), value = d8_add(high, low);
        d8 error = d8_mul(d8_add(d8_abs(high), d8_abs(low)), d8_set1(0x1p-51));
        d8 from_x = d8_muladd(x_error[j], d8_add(d8_abs(y[k]), y_error[k]), d8_mul(d8_abs(x[j]), y_error[k]));
        d8 from_y = d8_muladd(y_error[j], d8_add(d8_abs(x[k]), x_error[k]), d8_mul(d8_abs(y[j]), x_error[k]));
        error = d8_muladd(d8_add(from_x, from_y), d8_set1(1.0625), error);
        out->edge[i] = value;
        out->error = d8_max(out->error, error);
        unsigned equal = d8_equal(p, q);
        out->zero[i] = exact & equal & d8_equal(p_rest, q_rest);
        out->positive[i] = (exact & (d8_gt(p, q) | (equal & d8_gt(p_rest, q_rest)))) | (~exact & d8_gt(value, error));
        out->negative[i] = (exact & (d8_gt(q, p) | (equal & d8_gt(q_rest, p_rest)))) |
                           (~exact & d8_gt(d8_neg(error), value));
    }
    /* For lanes_place(), which takes it for 8 u R at least. */
    out->eps = d8_muladd(most_z, d8_set1(8 * 0x1p-53), rest);
}

/* The lanes that the filter cannot decide; the last resort are the stages of certified.c. */
static __attribute__((noinline)) void lanes_sharpen(struct gn_ref_certified *call, struct gn_ref_flight *flight,
                                 const struct gn_ref_bvh *bvh, unsigned unsure, const uint32_t *ids, uint32_t leaf,
                                 bool narrow)
{
    struct sharp sharp;
    leaf_sharpen(&sharp, flight, bvh, leaf, narrow);
    unsigned positive = sharp.positive[0] | sharp.positive[1] | sharp.positive[2];
    unsigned negative = sharp.negative[0] | sharp.negative[1] | sharp.negative[2];
    unsigned known = 0xFF;
    for (int i = 0; i < 3; i++)
        known &= sharp.positive[i] | sharp.negative[i] | sharp.zero[i];
    unsigned asked = unsure;
    unsure &= ~(positive & negative) & ~(sharp.zero[0] & sharp.zero[1] & sharp.zero[2]);
    unsigned met = unsure & known, unknown = unsure & ~known;
    call->sharpened += (unsigned)__builtin_popcount(asked & ~unknown);
    if (met)
        unknown |= lanes_offer(call, flight, met, sharp.zero, ids, leaf, sharp.edge, sharp.z, sharp.error, sharp.eps);
    for (; unknown; unknown &= unknown - 1)
        gn_ref_certified_consider(call, flight, leaf, __builtin_ctz(unknown));
}

/* At the end: t and barycentrics as accurate as trace.h promises, if they are not yet. */
static __attribute__((noinline)) void best_refine(struct gn_ref_flight *flight, const struct gn_ref_bvh *bvh, bool narrow)
{
    struct gn_ref_candidate *best = &flight->best;
    struct sharp sharp;
    struct placed placed;
    struct lanes lanes;
    struct gn_ref_candidate refined = *best;
    leaf_sharpen(&sharp, flight, bvh, best->leaf, narrow);
    lanes_place(&placed, flight, sharp.edge, sharp.z, sharp.error, sharp.eps);
    if (!(placed.known >> best->lane & 1))
        return;
    lanes_store(&lanes, &placed);
    lane_get(&refined, &lanes, best->lane, flight->sign);
    if (gn_ref_candidate_accurate(&refined))
        *best = refined;
}

static inline void flight_refine(struct gn_ref_flight *flight, const struct gn_ref_bvh *bvh, bool narrow)
{
    if (flight->best.id != GN_REF_NONE && !gn_ref_candidate_accurate(&flight->best))
        best_refine(flight, bvh, narrow);
}

/* w - o for one vertex, sheared: three names in place of arrays, which compilers keep in memory. */
#define VERTEX(v)                                                                                                      \
    const d8 z##v = d8_sub(leaf_axis(bvh, leaf, v, flight->offset[2], narrow), oz);                                    \
    d8 x##v = d8_sub(leaf_axis(bvh, leaf, v, flight->offset[0], narrow), ox);                                          \
    d8 y##v = d8_sub(leaf_axis(bvh, leaf, v, flight->offset[1], narrow), oy);                                          \
    x##v = d8_nmuladd(sx, z##v, x##v);                                                                                 \
    y##v = d8_nmuladd(sy, z##v, y##v);                                                                                 \
    if (narrow) {                                                                                                      \
        x##v = d8_nmuladd(sx_rest, z##v, x##v);                                                                        \
        y##v = d8_nmuladd(sy_rest, z##v, y##v);                                                                        \
    }                                                                                                                  \
    const d8 n##v = d8_add(d8_abs(x##v), d8_abs(y##v))

/* What the filter makes of a leaf. */
struct filtered {
    d8 edge[3], z[3], error, eps;
    unsigned used, missed, certain; /* lanes */
};

static inline __attribute__((always_inline)) void leaf_test(struct filtered *out, const struct gn_ref_flight *flight,
                                                            const struct gn_ref_bvh *bvh, bool narrow)
{
    uint32_t leaf = flight->current & ~(GN_REF_LEAF_BIT | GN_REF_FINE_BIT);
    const uint32_t *ids = narrow ? bvh->blocks_f32[leaf].id : bvh->blocks_f64[leaf].id;
    const d8 ox = d8_set1(flight->origin[0]), oy = d8_set1(flight->origin[1]), oz = d8_set1(flight->origin[2]);
    const d8 sx = d8_set1(flight->shear[0]), sy = d8_set1(flight->shear[1]);
    const d8 sx_rest = d8_set1(flight->shear_rest[0]), sy_rest = d8_set1(flight->shear_rest[1]);
    VERTEX(0);
    VERTEX(1);
    VERTEX(2);
    const d8 n = d8_add(n0, d8_add(n1, n2));
    d8 eps = d8_set1(flight->eps), error;
    if (!narrow) {
        eps = d8_muladd(d8_load(bvh->blocks_f64[leaf].error), d8_set1(3), eps);
        error = d8_mul(eps, d8_muladd(n, d8_set1(1.5), d8_mul(eps, d8_set1(4))));
    } else if (FUSED && !(flight->current & GN_REF_FINE_BIT)) {
        error = d8_muladd(d8_muladd(d8_set1(flight->bound[0]), n, d8_set1(flight->bound[1])), n,
                          d8_set1(flight->bound[2]));
    } else {
        error = d8_muladd(d8_set1(1.5 * flight->eps), n, d8_set1(4 * flight->eps * flight->eps));
    }
    const d8 u = d8_nmuladd(y1, x2, d8_mul(x1, y2));
    const d8 v = d8_nmuladd(y2, x0, d8_mul(x2, y0));
    const d8 w = d8_nmuladd(y0, x1, d8_mul(x0, y1));
    const d8 most = d8_max(u, d8_max(v, w)), least = d8_min(u, d8_min(v, w));
    const d8 minus = d8_neg(error);
    /* Unknown errors are infinite: such lanes are neither missed nor certain, nor are NaNs that come of them. */
    out->used = ids_used(ids);
    out->missed = d8_gt(most, error) & d8_gt(minus, least);
    out->certain = d8_gt(least, error) | d8_gt(minus, most);
    out->edge[0] = u;
    out->edge[1] = v;
    out->edge[2] = w;
    out->z[0] = z0;
    out->z[1] = z1;
    out->z[2] = z2;
    out->error = error;
    out->eps = eps;
}

static inline __attribute__((always_inline)) void leaf_leave(struct gn_ref_certified *call,
                                                             struct gn_ref_flight *flight,
                                                             const struct gn_ref_bvh *bvh,
                                                             const struct filtered *filtered, bool narrow)
{
    unsigned open = filtered->used & ~filtered->missed;
    call->filtered += (unsigned)__builtin_popcount(filtered->used);
    if (!open)
        return;
    uint32_t leaf = flight->current & ~(GN_REF_LEAF_BIT | GN_REF_FINE_BIT);
    const uint32_t *ids = narrow ? bvh->blocks_f32[leaf].id : bvh->blocks_f64[leaf].id;
    unsigned certain = open & filtered->certain, unsure = open & ~certain;
    if (certain) {
        static const unsigned no_zeros[3];
        unsure |= lanes_offer(call, flight, certain, no_zeros, ids, leaf, filtered->edge, filtered->z, filtered->error,
                              filtered->eps);
    }
    if (unsure) {
        /* The triangle's own extent bounds s. */
        const d8 sign = d8_set1(flight->sign), eps = filtered->eps;
        const d8 a = d8_mul(sign, filtered->z[0]), b = d8_mul(sign, filtered->z[1]), c = d8_mul(sign, filtered->z[2]);
        const d8 first = d8_sub(d8_min(a, d8_min(b, c)), eps), last = d8_add(d8_max(a, d8_max(b, c)), eps);
        unsure &= ~d8_gt(first, d8_set1(flight->best.upper)) & ~d8_gt(d8_set1(flight->s_first), last) &
                  ~d8_gt(first, d8_set1(flight->s_last));
        if (unsure)
            lanes_sharpen(call, flight, bvh, unsure, ids, leaf, narrow);
    }
}

/* One node or leaf; false at the ray's end. */
static inline bool flight_step(struct gn_ref_certified *call, struct gn_ref_flight *flight,
                               const struct gn_ref_bvh *bvh, bool narrow, bool prefetch)
{
    if (!(flight->current & GN_REF_LEAF_BIT)) {
        uint32_t keys[GN_REF_NODE_WIDTH];
        unsigned met = node_test(keys, flight, bvh);
        return node_leave(flight, bvh, keys, met, prefetch, narrow);
    }
    struct filtered filtered;
    leaf_test(&filtered, flight, bvh, narrow);
    leaf_leave(call, flight, bvh, &filtered, narrow);
    return flight_pop(flight);
}

static inline void run_one(struct gn_ref_certified *call, struct gn_ref_flight *flight, bool narrow, bool prefetch)
{
    const struct gn_ref_bvh *bvh = &call->scene->bvh;
    while (flight_step(call, flight, bvh, narrow, prefetch))
        ;
    flight_refine(flight, bvh, narrow);
}

/* With counters of what is visited (effects.h). */
static __attribute__((noinline)) void run_counted(struct gn_ref_certified *call, struct gn_ref_flight *flight)
{
    const struct gn_ref_bvh *bvh = &call->scene->bvh;
    bool narrow = bvh->blocks_f32 != NULL;
    uint64_t leaves = 0, nodes = 0, triangles = 0;
    do {
        bool is_leaf = flight->current & GN_REF_LEAF_BIT;
        uint32_t leaf = flight->current & ~(GN_REF_LEAF_BIT | GN_REF_FINE_BIT);
        leaves += is_leaf;
        nodes += !is_leaf;
        if (is_leaf)
            triangles += (unsigned)__builtin_popcount(ids_used(narrow ? bvh->blocks_f32[leaf].id
                                                                      : bvh->blocks_f64[leaf].id));
    } while (flight_step(call, flight, bvh, narrow, false));
    flight_refine(flight, bvh, narrow);
    call->counts->leaves += leaves;
    call->counts->nodes += nodes;
    call->counts->triangles += triangles;
}

/* Which flights are to visit a node next, and which a leaf. */
struct turn {
    unsigned list[2][FLIGHTS];
    size_t count[2];
};

static inline void turn_add(struct turn *turn, const struct gn_ref_flight *flights, unsigned i,
                            const struct gn_ref_bvh *bvh, bool narrow)
{
    unsigned is_leaf = flights[i].current >> 31;
    turn->list[is_leaf][turn->count[is_leaf]++] = i;
    prefetch_child(bvh, flights[i].current, narrow);
}

/* A flight has ended: the next ray takes its place. */
static inline void flight_land(struct gn_ref_certified *call, struct turn *turn, struct gn_ref_flight *flights,
                               unsigned i, bool narrow)
{
    const struct gn_ref_bvh *bvh = &call->scene->bvh;
    flight_refine(&flights[i], bvh, narrow);
    gn_ref_certified_end(call, &flights[i]);
    if (gn_ref_certified_next(call, &flights[i]))
        turn_add(turn, flights, i, bvh, narrow);
}

/*
 * Rays in flight take their steps in turns: first the arithmetic for all, free of branches so that the processor
 * overlaps it, then what depends on its outcome.
 */
static inline void run_batch(struct gn_ref_certified *call, bool narrow)
{
    const struct gn_ref_bvh *bvh = &call->scene->bvh;
    struct gn_ref_flight flights[FLIGHTS];
    uint32_t keys[FLIGHTS][GN_REF_NODE_WIDTH];
    unsigned met[FLIGHTS];
    struct filtered filtered[FLIGHTS];
    struct turn turn = {0};
    for (unsigned i = 0; i < FLIGHTS && gn_ref_certified_next(call, &flights[i]); i++)
        turn_add(&turn, flights, i, bvh, narrow);
    while (turn.count[0] + turn.count[1] > 0) {
        /* Whoever stays in a list is written before the place that is read. */
        size_t count = turn.count[0];
        for (size_t n = 0; n < count; n++)
            met[n] = node_test(keys[n], &flights[turn.list[0][n]], bvh);
        turn.count[0] = 0;
        for (size_t n = 0; n < count; n++) {
            unsigned i = turn.list[0][n];
            if (node_leave(&flights[i], bvh, keys[n], met[n], false, narrow))
                turn_add(&turn, flights, i, bvh, narrow);
            else
                flight_land(call, &turn, flights, i, narrow);
        }
        count = turn.count[1];
        for (size_t n = 0; n < count; n++)
            leaf_test(&filtered[n], &flights[turn.list[1][n]], bvh, narrow);
        turn.count[1] = 0;
        for (size_t n = 0; n < count; n++) {
            unsigned i = turn.list[1][n];
            leaf_leave(call, &flights[i], bvh, &filtered[n], narrow);
            if (flight_pop(&flights[i]))
                turn_add(&turn, flights, i, bvh, narrow);
            else
                flight_land(call, &turn, flights, i, narrow);
        }
    }
}

/* Three axes at once, and one that is not used. */
typedef double v4 __attribute__((vector_size(32)));
typedef int64_t m4 __attribute__((vector_size(32)));
typedef float v4_f32 __attribute__((vector_size(16)));
typedef int32_t m4_32 __attribute__((vector_size(16)));

bool GN_REF_KERNEL_START(struct gn_ref_flight *flight, const struct gn_ref_scene *scene, const struct gn_ref_ray *ray)
{
    const struct gn_ref_bvh *bvh = &scene->bvh;
    const m4 sign_bits = (m4){INT64_MIN, INT64_MIN, INT64_MIN, INT64_MIN};
    const v4 o = {ray->origin[0], ray->origin[1], ray->origin[2], 0};
    const v4 d = {ray->direction[0], ray->direction[1], ray->direction[2], 1};
    const v4 p = o - (v4){bvh->centre[0], bvh->centre[1], bvh->centre[2], 0};
    const v4 far = (v4)((m4)p & ~sign_bits) + (v4){bvh->half[0], bvh->half[1], bvh->half[2], 0};
    double reach = far[0] > far[1] ? far[0] : far[1];
    reach = (reach > far[2] ? reach : far[2]) * (1 + 0x1p-40);
    if (!(reach >= GN_REF_LEAST_REACH && reach <= GN_REF_MOST_REACH))
        return false;
    const v4 size = (v4)((m4)d & ~sign_bits);
    int z = size[1] > size[0] ? 1 : 0;
    z = size[2] > size[z] ? 2 : z;
    int x = z == 2 ? 0 : z + 1, y = z == 0 ? 2 : z - 1;
    double depth = d[z], length = size[z], inverse_depth = 1 / depth;
    /* Components below 2^-30 of the largest count as that, so that nothing divides by 0. */
    const double least = length * 0x1p-30;
    const v4 floor_size = {least, least, least, 1}, lengths = {length, length, length, 1};
    const m4 large = size >= floor_size;
    const v4 g = (v4)(((m4)d & sign_bits) | (large & (m4)size) | (~large & (m4)floor_size));
    const v4 inverse = lengths / g, along = p * inverse;
    const v4 delta = (v4)((m4)inverse & ~sign_bits) * (4 * 0x1p-24 * reach);
    const v4_f32 scale = __builtin_convertvector(inverse, v4_f32);
    const v4_f32 near_bias = __builtin_convertvector(along + delta, v4_f32);
    const v4_f32 far_bias = __builtin_convertvector(along - delta, v4_f32);
    const m4_32 lower = {0, 32, 64, 0}, flip = (m4_32)(scale < 0) & 96;
    const m4_32 near_offset = lower + flip, far_offset = lower + 96 - flip;
    _Static_assert(offsetof(struct gn_ref_node, upper) - offsetof(struct gn_ref_node, lower) == 96 &&
                       offsetof(struct gn_ref_node, lower) == 0,
                   "the offsets above");
    memcpy(flight->scale, &scale, sizeof scale);
    memcpy(flight->near_bias, &near_bias, sizeof near_bias);
    memcpy(flight->far_bias, &far_bias, sizeof far_bias);
    memcpy(flight->near_offset, &near_offset, sizeof near_offset);
    memcpy(flight->far_offset, &far_offset, sizeof far_offset);

    bool sharp = bvh->quantum > 0 && reach < 0x1p52 * bvh->quantum;
    const int axes[3] = {x, y, z};
    for (int i = 0; i < 3; i++) {
        flight->offset[i] = (uint32_t)axes[i] * GN_REF_NODE_WIDTH;
        flight->origin[i] = ray->origin[axes[i]];
        flight->direction[i] = ray->direction[axes[i]];
    }
    if (sharp) {
        /* Products by a power of two are exact, and whole numbers when they come back from 64 bits as they were. */
        const v4 multiple = o * bvh->inverse_quantum;
        sharp = fabs(multiple[0]) < 0x1p62 && fabs(multiple[1]) < 0x1p62 && fabs(multiple[2]) < 0x1p62;
        if (sharp) {
            const m4 same = __builtin_convertvector(__builtin_convertvector(multiple, m4), v4) == multiple;
            sharp = (same[0] & same[1] & same[2]) != 0;
        }
    }
    for (int i = 0; i < 2; i++) {
        double shear = flight->direction[i] * inverse_depth, first = (float)shear;
        double rest = (flight->direction[i] - first * depth) * inverse_depth;
        flight->shear_rest[i] = sharp ? rest : 0;
        flight->shear[i] = sharp ? first : shear;
    }
    flight->sign = depth < 0 ? -1 : 1;
    flight->length = length;
    double eps = 8 * 0x1p-53 * reach, h = 0x1p-75 * reach;
    flight->eps = eps;
    flight->bound[0] = sharp ? 2 * 0x1p-53 : 0;
    flight->bound[1] = sharp ? 1.25 * h : 1.5 * eps;
    flight->bound[2] = sharp ? 4 * h * h : 4 * eps * eps;
    flight->s_first = ray->tmin * length + 0.0;
    flight->s_last = ray->tmax * length;
    flight->s_first_f32 = gn_ref_f32_down(flight->s_first < FLT_MAX ? flight->s_first : FLT_MAX);
    flight->s_limit_f32 = gn_ref_f32_up(flight->s_last < reach ? flight->s_last : reach);
    flight->current = 0;
    flight->depth = 0;
    flight->best.id = GN_REF_NONE;
    flight->best.upper = INFINITY;
    flight->ray = ray;
    return true;
}

void GN_REF_KERNEL(struct gn_ref_certified *call, struct gn_ref_flight *single)
{
    bool narrow = call->scene->bvh.blocks_f32 != NULL;
    if (single && call->counts)
        run_counted(call, single);
    else if (single && narrow && call->fits_cache)
        run_one(call, single, true, false);
    else if (single && narrow)
        run_one(call, single, true, true);
    else if (single)
        run_one(call, single, false, true);
    else if (narrow)
        run_batch(call, true);
    else
        run_batch(call, false);
}
