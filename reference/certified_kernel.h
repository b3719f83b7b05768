/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The traversal and the filter of certified.h, once per instruction set: the including file has defined f8 and d8
 * (eight f32, eight f64), operations on them, and GN_REF_KERNEL, the name of the entry. A product and a sum may be rounded
 * once or twice, the bounds allow for both.
 */
#include <string.h>

#include "reference/certified.h"

/* Rays in flight: enough for the others' work to hide the wait for memory. */
#define FLIGHTS 8

/* The rest of a difference d of a and b, exactly (Knuth's TwoSum). */
static inline d8 d8_difference_rest(d8 a, d8 b, d8 d)
{
    d8 other = d8_sub(d, a);
    return d8_sub(d8_sub(a, d8_sub(d, other)), d8_add(b, other));
}

static inline void prefetch_child(const struct gn_ref_bvh *bvh, uint32_t child)
{
    const char *memory;
    if (!(child & GN_REF_LEAF_BIT)) {
        memory = (const char *)&bvh->nodes[child];
        for (size_t offset = 0; offset < sizeof *bvh->nodes; offset += 64)
            __builtin_prefetch(memory + offset);
    } else if (bvh->blocks_f32) {
        memory = (const char *)&bvh->blocks_f32[child & ~GN_REF_LEAF_BIT];
        for (size_t offset = 0; offset < sizeof *bvh->blocks_f32; offset += 64)
            __builtin_prefetch(memory + offset);
    } else {
        memory = (const char *)&bvh->blocks_f64[child & ~GN_REF_LEAF_BIT];
        for (size_t offset = 0; offset < sizeof *bvh->blocks_f64; offset += 64)
            __builtin_prefetch(memory + offset);
    }
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

static inline bool node_visit(struct gn_ref_flight *flight, const struct gn_ref_bvh *bvh, bool prefetch)
{
    const struct gn_ref_node *node = &bvh->nodes[flight->current];
    const char *memory = (const char *)node;
    f8 near = f8_set1(flight->s_first_f32), far = f8_set1(flight->s_limit_f32);
    for (int axis = 0; axis < 3; axis++) {
        f8 scale = f8_set1(flight->scale[axis]);
        f8 first = f8_load((const float *)(const void *)(memory + flight->near_offset[axis]));
        f8 last = f8_load((const float *)(const void *)(memory + flight->far_offset[axis]));
        /* near stays the second operand: a -0 would sort behind everything as an integer. */
        near = f8_max(f8_mulsub(first, scale, f8_set1(flight->near_bias[axis])), near);
        far = f8_min(f8_mulsub(last, scale, f8_set1(flight->far_bias[axis])), far);
    }
    unsigned met = f8_le(near, far);
    if (met == 0)
        return flight_pop(flight);
    uint32_t keys[GN_REF_NODE_WIDTH];
    f8_store((float *)(void *)keys, near);
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
            prefetch_child(bvh, node->child[i]);
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

/* w - o for the three vertices, in the order of axes x, y, z. */
static inline void leaf_load(d8 out[3][3], const struct gn_ref_flight *flight, const struct gn_ref_bvh *bvh,
                             uint32_t leaf, bool narrow)
{
    for (int v = 0; v < 3; v++)
        for (int i = 0; i < 3; i++)
            out[v][i] = narrow ? d8_load_f32(&bvh->blocks_f32[leaf].w[v][0][0] + flight->offset[i])
                               : d8_load(&bvh->blocks_f64[leaf].w[v][0][0] + flight->offset[i]);
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
    leaf_load(w, flight, bvh, leaf, narrow);
    d8 rest = d8_set1(0), most_z = d8_set1(0);
    d8 dx = d8_set1(flight->direction[0]), dy = d8_set1(flight->direction[1]), dz = d8_set1(flight->direction[2]);
    d8 size = d8_set1(2 * flight->length);
    unsigned exact = 0xFF;
    for (int v = 0; v < 3; v++)
        for (int i = 0; i < 3; i++) {
            d8 o = d8_set1(flight->origin[i]), a = d8_sub(w[v][i], o);
            rest = d8_max(d8_abs(d8_difference_rest(w[v][i], o, a)), rest);
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
static inline void lanes_sharpen(struct gn_ref_certified *call, struct gn_ref_flight *flight,
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
    unsure &= ~(positive & negative) & ~(sharp.zero[0] & sharp.zero[1] & sharp.zero[2]);
    unsigned met = unsure & known, unknown = unsure & ~known;
    if (met)
        unknown |= lanes_offer(call, flight, met, sharp.zero, ids, leaf, sharp.edge, sharp.z, sharp.error, sharp.eps);
    for (; unknown; unknown &= unknown - 1)
        gn_ref_certified_consider(call, flight, leaf, __builtin_ctz(unknown));
}

/* At the end: t and barycentrics as accurate as trace.h promises, if they are not yet. */
static inline void flight_refine(struct gn_ref_flight *flight, const struct gn_ref_bvh *bvh, bool narrow)
{
    struct gn_ref_candidate *best = &flight->best;
    if (best->id == GN_REF_NONE || gn_ref_candidate_accurate(best))
        return;
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

static inline void leaf_visit(struct gn_ref_certified *call, struct gn_ref_flight *flight, const struct gn_ref_bvh *bvh,
                              bool narrow)
{
    uint32_t leaf = flight->current & ~GN_REF_LEAF_BIT;
    const uint32_t *ids = narrow ? bvh->blocks_f32[leaf].id : bvh->blocks_f64[leaf].id;
    d8 w[3][3], x[3], y[3], z[3], n, eps = d8_set1(flight->eps);
    leaf_load(w, flight, bvh, leaf, narrow);
    d8 ox = d8_set1(flight->origin[0]), oy = d8_set1(flight->origin[1]), oz = d8_set1(flight->origin[2]);
    d8 sx = d8_set1(flight->shear[0]), sy = d8_set1(flight->shear[1]);
    for (int v = 0; v < 3; v++) {
        z[v] = d8_sub(w[v][2], oz);
        x[v] = d8_nmuladd(sx, z[v], d8_sub(w[v][0], ox));
        y[v] = d8_nmuladd(sy, z[v], d8_sub(w[v][1], oy));
        d8 m = d8_add(d8_abs(x[v]), d8_abs(y[v]));
        n = v == 0 ? m : d8_add(n, m);
    }
    if (!narrow)
        eps = d8_muladd(d8_load(bvh->blocks_f64[leaf].error), d8_set1(3), eps);
    d8 error = d8_mul(eps, d8_muladd(n, d8_set1(1.5), d8_mul(eps, d8_set1(4))));
    d8 edge[3];
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        edge[i] = d8_nmuladd(y[j], x[k], d8_mul(x[j], y[k]));
    }
    d8 most = d8_max(edge[0], d8_max(edge[1], edge[2])), least = d8_min(edge[0], d8_min(edge[1], edge[2]));
    d8 minus = d8_neg(error);
    unsigned used = ids_used(ids);
    /* Unknown errors are infinite: such lanes are neither missed nor certain, nor are NaNs that come of them. */
    unsigned open = used & ~(d8_gt(most, error) & d8_gt(minus, least));
    call->filtered += (unsigned)__builtin_popcount(used);
    if (!open)
        return;
    unsigned certain = open & (d8_gt(least, error) | d8_gt(minus, most));
    unsigned unsure = open & ~certain;
    static const unsigned no_zeros[3];
    if (certain)
        unsure |= lanes_offer(call, flight, certain, no_zeros, ids, leaf, edge, z, error, eps);
    if (unsure) {
        /* The triangle's own extent bounds s. */
        d8 sign = d8_set1(flight->sign);
        d8 a = d8_mul(sign, z[0]), b = d8_mul(sign, z[1]), c = d8_mul(sign, z[2]);
        d8 first = d8_sub(d8_min(a, d8_min(b, c)), eps), last = d8_add(d8_max(a, d8_max(b, c)), eps);
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
    if (!(flight->current & GN_REF_LEAF_BIT))
        return node_visit(flight, bvh, prefetch);
    leaf_visit(call, flight, bvh, narrow);
    return flight_pop(flight);
}

static inline void run_one(struct gn_ref_certified *call, struct gn_ref_flight *flight, bool narrow)
{
    const struct gn_ref_bvh *bvh = &call->scene->bvh;
    while (flight_step(call, flight, bvh, narrow, true))
        ;
    flight_refine(flight, bvh, narrow);
}

static inline void run_batch(struct gn_ref_certified *call, bool narrow)
{
    const struct gn_ref_bvh *bvh = &call->scene->bvh;
    struct gn_ref_flight flights[FLIGHTS];
    struct gn_ref_flight *active[FLIGHTS];
    size_t count = 0;
    while (count < FLIGHTS && gn_ref_certified_next(call, &flights[count])) {
        active[count] = &flights[count];
        count++;
    }
    while (count > 0)
        for (size_t i = 0; i < count; i++) {
            struct gn_ref_flight *flight = active[i];
            if (flight_step(call, flight, bvh, narrow, false)) {
                prefetch_child(bvh, flight->current);
                continue;
            }
            flight_refine(flight, bvh, narrow);
            gn_ref_certified_end(call, flight);
            if (!gn_ref_certified_next(call, flight))
                active[i--] = active[--count];
        }
}

void GN_REF_KERNEL(struct gn_ref_certified *call, struct gn_ref_flight *single)
{
    bool narrow = call->scene->bvh.blocks_f32 != NULL;
    if (single && narrow)
        run_one(call, single, true);
    else if (single)
        run_one(call, single, false);
    else if (narrow)
        run_batch(call, true);
    else
        run_batch(call, false);
}
