/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The traversal and the filters of certified.h, once per instruction set: the including file has defined f8 (eight f32),
 * operations on it, FUSED, whether a product and a sum are rounded once, and GN_REF_KERNEL and GN_REF_KERNEL_START, the
 * names of the entries. The bounds allow for both. What is left of a leaf after eight triangles at a time is one or none mostly, and
 * taken one by one, in f64.
 */
#include <float.h>
#include <math.h>
#include <string.h>

#include "reference/certified.h"

typedef gn_ref_v4 v4;
typedef gn_ref_m4 m4;

/* Rays in flight: enough for the others' work to hide the wait for memory. */
#define FLIGHTS 16

/* a b + c and c - a b, rounded once where FUSED. */
static inline double muladd(double a, double b, double c)
{
    return FUSED ? __builtin_fma(a, b, c) : a * b + c;
}

static inline double nmuladd(double a, double b, double c)
{
    return FUSED ? __builtin_fma(-a, b, c) : c - a * b;
}

/* The rest of a difference d of a and b, exactly (Knuth's TwoSum). */
static inline double difference_rest(double a, double b, double d)
{
    double other = d - a;
    return (a - (d - other)) - (b + other);
}

/* a b - p for the rounded product p: without fma Dekker's, exact as factors stay below 2^970 and rests do not underflow. */
static inline double product_rest(double a, double b, double p)
{
    if (FUSED)
        return __builtin_fma(a, b, -p);
    double c = a * 0x1.0000002p27, d = b * 0x1.0000002p27;
    double a1 = c - (c - a), b1 = d - (d - b), a0 = a - a1, b0 = b - b1;
    return a0 * b0 - (((p - a1 * b1) - a0 * b1) - a1 * b0);
}

static inline double least_of(double a, double b)
{
    return a < b ? a : b;
}

static inline double most_of(double a, double b)
{
    return a > b ? a : b;
}

static inline void prefetch(const void *memory, size_t bytes)
{
    for (size_t offset = 0; offset < bytes; offset += 64)
        __builtin_prefetch((const char *)memory + offset);
}

/* A node, or a leaf of triangles; instances are not asked for. */
static inline void prefetch_child(const struct gn_ref_bvh *bvh, uint32_t child)
{
    uint32_t leaf = child & ~GN_REF_LEAF_BIT;
    if (!(child & GN_REF_LEAF_BIT))
        prefetch(&bvh->nodes[child], sizeof *bvh->nodes);
    else if (bvh->leaves_f32)
        prefetch(&bvh->leaves_f32[leaf], offsetof(struct gn_ref_leaf_f32, geometry));
    else if (bvh->leaves_i16)
        prefetch(&bvh->leaves_i16[leaf], sizeof bvh->leaves_i16[leaf]);
}

static inline void prefetch_triangle(const struct gn_ref_bvh *bvh, uint32_t child, uint32_t lane)
{
    const char *memory = (const char *)&bvh->triangles[bvh->leaves_i16[child & ~GN_REF_LEAF_BIT].first + lane];
    __builtin_prefetch(memory);
    __builtin_prefetch(memory + sizeof *bvh->triangles - 1);
}

/* Goes on with the nearest of what waits, outside of the instance when nothing does inside; false when nothing does. */
static inline bool flight_pop(struct gn_ref_flight *flight, bool layered)
{
    for (;;) {
        while (flight->depth > (layered ? flight->floor : 0)) {
            uint64_t top = flight->stack[--flight->depth];
            uint32_t bits = (uint32_t)(top >> 32);
            float near;
            memcpy(&near, &bits, sizeof near);
            if (near <= flight->s_limit_f32) {
                flight->current = (uint32_t)top;
                return true;
            }
        }
        if (!layered || !flight->inside)
            return false;
        flight->inside = 0;
        flight->floor = 0;
    }
}

static inline const struct gn_ref_frame *frame_of(const struct gn_ref_flight *flight, bool layered)
{
    return &flight->frames[layered ? flight->inside : 0];
}

/* Where the children's boxes are entered, and which are met at all. */
static inline unsigned node_test(uint32_t keys[GN_REF_NODE_WIDTH], const struct gn_ref_flight *flight,
                                 const struct gn_ref_frame *frame)
{
    const char *memory = (const char *)&frame->bvh->nodes[flight->current];
    f8 near = f8_set1(flight->s_first_f32), far = f8_set1(flight->s_limit_f32);
#define SLAB(axis)                                                                                                     \
    do {                                                                                                               \
        f8 scale = f8_set1(frame->scale[axis]);                                                                       \
        f8 first = f8_load((const float *)(const void *)(memory + frame->near_offset[axis]));                         \
        f8 last = f8_load((const float *)(const void *)(memory + frame->far_offset[axis]));                           \
        near = f8_max(f8_mulsub(first, scale, f8_set1(frame->near_bias[axis])), near);                                \
        far = f8_min(f8_mulsub(last, scale, f8_set1(frame->far_bias[axis])), far);                                    \
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
                              const uint32_t keys[GN_REF_NODE_WIDTH], unsigned met, bool ahead, bool layered)
{
    const struct gn_ref_node *node = &bvh->nodes[flight->current];
    if (met == 0)
        return flight_pop(flight, layered);
    unsigned i = (unsigned)__builtin_ctz(met);
    met &= met - 1;
    if (met == 0) {
        flight->current = node->child[i];
        return true;
    }
    /* The nearest in hand, the others on the stack with the farthest first. */
    uint64_t nearest = (uint64_t)keys[i] << 32 | node->child[i];
    uint64_t *base = flight->stack + flight->depth, *place = base;
    if (ahead)
        prefetch_child(bvh, node->child[i]);
    do {
        i = (unsigned)__builtin_ctz(met);
        met &= met - 1;
        uint64_t key = (uint64_t)keys[i] << 32 | node->child[i];
        if (ahead)
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

/* One triangle, its vertices relative to the ray's origin in the order of axes x, y, z = k. */
struct lane {
    double edge[3], z[3], error, eps;
};

static inline void lane_corners(double w[3][3], double *error, const struct gn_ref_bvh *bvh, uint32_t place,
                                const uint32_t axis[3], bool narrow)
{
    uint32_t leaf = place / GN_REF_NODE_WIDTH, lane = place % GN_REF_NODE_WIDTH;
    const struct gn_ref_leaf_f32 *of = narrow ? &bvh->leaves_f32[leaf] : NULL;
    const struct gn_ref_triangle_f64 *triangle = narrow ? NULL : &bvh->triangles[bvh->leaves_i16[leaf].first + lane];
    for (int v = 0; v < 3; v++)
        for (int i = 0; i < 3; i++)
            w[v][i] = narrow ? (double)of->w[v][axis[i]][lane] : triangle->w[v][axis[i]];
    *error = narrow ? 0 : triangle->error;
}

/* s, the barycentrics and their error bounds (certified.h); false when the sum is too near 0. */
static inline bool lane_place(struct gn_ref_candidate *out, const struct gn_ref_frame *frame, const struct lane *lane)
{
    const double unit = 0x1p-53;
    double sum = lane->edge[0] + lane->edge[1] + lane->edge[2];
    double inverse = 1 / sum;
    double beta = lane->edge[1] * inverse, gamma = lane->edge[2] * inverse;
    double f = muladd(lane->error * (1.0625 * 4.5), fabs(inverse), 17 * unit);
    double p = lane->z[1] - lane->z[0], q = lane->z[2] - lane->z[0];
    double s = frame->sign * (lane->z[0] + muladd(beta, p, gamma * q)) * frame->unit;
    double s_error = muladd(f + 8 * unit, fabs(p) + fabs(q), 5 * lane->eps) * frame->unit;
    out->s = s;
    out->s_error = s_error;
    out->lower = s - s_error;
    out->upper = s + s_error;
    out->beta = beta;
    out->gamma = gamma;
    out->barycentric_error = f;
    out->sum_sign = (sum > 0) ^ (frame->sign < 0) ? frame->turn : -frame->turn;
    return fabs(sum) * (1.0 / 64 - 8 * unit) > 3.5 * lane->error;
}

/* A triangle that is met, if its s can be placed. */
static inline bool lane_offer(struct gn_ref_certified *call, struct gn_ref_flight *flight,
                              const struct gn_ref_frame *frame, const struct lane *lane, uint64_t id, unsigned zeros)
{
    struct gn_ref_candidate candidate = {.id = id, .zeros = (uint16_t)zeros};
    if (!lane_place(&candidate, frame, lane))
        return false;
    if (candidate.lower > flight->s_first && candidate.upper < flight->s_last && candidate.upper < flight->best.lower &&
        !flight->tests)
        gn_ref_certified_take(call, flight, &candidate);
    else if (candidate.lower < flight->s_last && candidate.upper > flight->s_first &&
             !(candidate.lower > flight->best.upper))
        gn_ref_certified_offer(call, flight, &candidate);
    return true;
}

/* a b - c d + more, rounded once but for terms of the order of u^2 (|a b| + |c d|), and what its error is bounded by. */
static inline double cross_sharp(double a, double b, double c, double d, double more, double *out_error, bool *exact)
{
    double p = a * b, q = c * d;
    double p_rest = product_rest(a, b, p), q_rest = product_rest(c, d, q);
    double high = p - q, high_rest = difference_rest(p, q, high);
    double low = (high_rest + (p_rest - q_rest)) + more;
    double value = high + low;
    *out_error = fabs(value) * 0x1p-53 + (fabs(p) + fabs(q)) * 0x1p-103;
    *exact &= p_rest == 0 && q_rest == 0 && high_rest == 0;
    return value;
}

/*
 * The edge functions with everything compensated once, u = 2^-53. As in wide.c the shear is
 * multiplied by d_z: x = d_z a_x - d_x a_z, y likewise, and the edge functions by d_z^2, which changes nothing that is asked.
 *
 * a = w - o comes as a sum of two, a number and its rest, which are wrong by r (struct corners). In cross_sharp()
 * products and their difference come with their rests, found exactly; adding these up is wrong by less than
 * 2 u^2 (|p| + |q|) (1 + 4u) for the rests of the products and as much for the rest of the difference, 4 u^2 in all, adding
 * those of a by 3 u^2 (|p| + |q|) and, with L the largest of these and D = |d_z|, by 8 u D L, and
 * the last sum by u |value|; 2^-103 = 8 u^2 covers what has u^2. So x is wrong by
 *     e_x = u |x| + 8 u^2 (|p| + |q|) + 2 D (r + 8 u L).
 * and an edge function x_j y_k - y_j x_k by e_xj |y_k| + |x_j| e_yk + e_xj e_yk, the same with x and y exchanged, and its own
 * rounding. Those sums are rounded themselves, which the factor 1.0625 covers. What underflows is less than 2^-900 of
 * a scene's range: R >= 2^-80 and |d_z| >= 2^-149, which the constant covers.
 *
 * Where a is exact and the rests in x and y are 0, x and y are exact; the products of an edge function then are each a
 * rounded one and a rest, and their order is that of the rounded ones unless these are equal, for rounding is monotone.
 * That asks for rests that do not underflow: f32 vertices and origins differ by multiples of 2^-149, x and y are
 * multiples of 2^-298, and rests of 2^-596. Vertices in f64 may be finer; there nothing counts as exact unless x and y
 * are 0 or at least 2^-400, and so are the differences.
 */
enum { SIGN_UNKNOWN = 2 };
struct sharp {
    struct lane lane;
    int sign[3];
};

static inline bool is_coarse(double a)
{
    return a == 0 || fabs(a) > 0x1p-400;
}

/* Of a triangle, less the origin, in the world and the order of its axes. */
struct corners {
    double a[3][3], rest[3][3]; /* their sum is what is meant */
    double error; /* of the sum; infinite where nothing is known */
    double most_rest;
    bool exact; /* rest and error are 0 */
    bool coarse; /* multiples of 2^-149 */
};

/*
 * Of an instance whose object-space corners v are f32: a = (T - o) + m_1 v_1 + m_2 v_2 + m_3 v_3 has exact products and sums whose
 * rests are found exactly. With A bounding the sums of the terms' magnitudes these are at most u A, four of them, and
 * adding them up is wrong by 3 u 4 u A = 12 u^2 A < r = 2^-102 A.
 */
static inline void corners_place(struct corners *out, const float m[12], const struct gn_ref_leaf_f32 *leaf, uint32_t lane,
                                 const struct gn_ref_ray *ray, const uint32_t axis[3])
{
    const v4 start = {m[3], m[7], m[11], 0}, o = {ray->origin[0], ray->origin[1], ray->origin[2], 0}, first = start - o;
    const v4 back = first - start, first_rest = (start - (first - back)) - (o + back);
    v4 sizes = {0}, rests = GN_REF_V4_ABS(first_rest);
    for (int v = 0; v < 3; v++) {
        v4 sum = first, rest = first_rest, size = GN_REF_V4_ABS(first);
        for (int j = 0; j < 3; j++) {
            const double w = leaf->w[v][j][lane];
            const v4 product = (v4){m[j], m[4 + j], m[8 + j], 0} * GN_REF_V4_ALL(w);
            const v4 next = sum + product, other = next - sum, lost = (sum - (next - other)) + (product - other);
            rest += lost;
            rests += GN_REF_V4_ABS(lost);
            size += GN_REF_V4_ABS(product);
            sum = next;
        }
        const v4 whole = sum + rest, other = whole - sum, last = (sum - (whole - other)) + (rest - other);
        sizes += size;
        for (int i = 0; i < 3; i++) {
            out->a[v][i] = whole[axis[i]];
            out->rest[v][i] = last[axis[i]];
        }
    }
    double size = sizes[0] + sizes[1] + sizes[2];
    out->exact = rests[0] + rests[1] + rests[2] == 0;
    out->error = out->exact ? 0 : 0x1p-102 * size;
    out->coarse = false;
}

static inline void corners_set(struct corners *out, const struct gn_ref_flight *flight, const struct gn_ref_certified *call,
                               uint64_t id)
{
    const struct gn_ref_scene *scene = call->scene;
    const struct gn_ref_frame *world = &flight->frames[0];
    const uint32_t instance = gn_ref_id_instance(id), place = (uint32_t)id;
    const struct gn_ref_bvh *bvh = gn_ref_scene_tree(scene, instance);
    bool entered = scene->layered && gn_ref_instance_is_entered(scene, instance, call->forced);
    if (entered && bvh->leaves_f32) {
        corners_place(out, scene->instances[instance].transform, &bvh->leaves_f32[place / GN_REF_NODE_WIDTH],
                      place % GN_REF_NODE_WIDTH, flight->ray, world->axis);
    } else {
        double w[3][3];
        if (entered) {
            double corners[3][3];
            const struct gn_ref_primitive primitive = gn_ref_scene_primitive(scene, id);
            gn_ref_triangle_place(scene, &primitive, corners, &out->error);
            for (int v = 0; v < 3; v++)
                for (int i = 0; i < 3; i++)
                    w[v][i] = corners[v][world->axis[i]];
        } else {
            lane_corners(w, &out->error, bvh, place, world->axis, bvh->leaves_f32);
        }
        out->coarse = !entered && bvh->leaves_f32;
        out->exact = out->error == 0;
        for (int v = 0; v < 3; v++)
            for (int i = 0; i < 3; i++) {
                out->a[v][i] = w[v][i] - world->origin[i];
                out->rest[v][i] = difference_rest(w[v][i], world->origin[i], out->a[v][i]);
                out->exact &= out->rest[v][i] == 0;
            }
    }
    out->most_rest = 0;
    for (int v = 0; v < 3; v++)
        for (int i = 0; i < 3; i++) {
            out->most_rest = most_of(fabs(out->rest[v][i]), out->most_rest);
            out->exact &= out->coarse || is_coarse(out->a[v][i]);
        }
}

/* In the world. */
static inline void lane_sharpen(struct sharp *out, const struct gn_ref_flight *flight, const struct gn_ref_certified *call,
                                uint64_t id)
{
    struct corners of;
    double x[3], y[3], x_error[3], y_error[3], most_z = 0;
    double dx = flight->direction[0], dy = flight->direction[1], dz = flight->direction[2];
    corners_set(&of, flight, call, id);
    if (!(of.error < INFINITY)) {
        *out = (struct sharp){.lane = {.error = INFINITY, .eps = INFINITY},
                              .sign = {SIGN_UNKNOWN, SIGN_UNKNOWN, SIGN_UNKNOWN}};
        return;
    }
    bool exact = of.exact;
    double spread = 2 * flight->length * (of.error + 0x1p-50 * of.most_rest) + 0x1p-900;
    for (int v = 0; v < 3; v++) {
        const double *a = of.a[v], *rest = of.rest[v];
        x[v] = cross_sharp(dz, a[0], dx, a[2], dz * rest[0] - dx * rest[2], &x_error[v], &exact);
        y[v] = cross_sharp(dz, a[1], dy, a[2], dz * rest[1] - dy * rest[2], &y_error[v], &exact);
        x_error[v] += spread;
        y_error[v] += spread;
        out->lane.z[v] = a[2];
        most_z = most_of(fabs(a[2]), most_z);
        exact &= of.coarse || (is_coarse(x[v]) && is_coarse(y[v]));
    }
    out->lane.error = 0;
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        double p = x[j] * y[k], q = y[j] * x[k];
        double p_rest = product_rest(x[j], y[k], p), q_rest = product_rest(y[j], x[k], q);
        double high = p - q, low = p_rest - q_rest, value = high + low;
        double error = (fabs(high) + fabs(low)) * 0x1p-51;
        double from_x = x_error[j] * (fabs(y[k]) + y_error[k]) + fabs(x[j]) * y_error[k];
        double from_y = y_error[j] * (fabs(x[k]) + x_error[k]) + fabs(y[j]) * x_error[k];
        error += (from_x + from_y) * 1.0625;
        out->lane.edge[i] = value;
        out->lane.error = most_of(error, out->lane.error);
        if (exact)
            out->sign[i] = p != q ? (p > q ? 1 : -1) : (p_rest > q_rest) - (p_rest < q_rest);
        else
            out->sign[i] = value > error ? 1 : value < -error ? -1 : SIGN_UNKNOWN;
    }
    /* For lane_place(), which takes it for 8 u R at least. */
    out->lane.eps = most_z * (8 * 0x1p-53) + of.most_rest + of.error;
}

/* What the filter cannot decide; the last resort are the stages of certified.c. */
static __attribute__((noinline)) void lane_settle(struct gn_ref_certified *call, struct gn_ref_flight *flight, uint64_t id)
{
    struct sharp sharp;
    lane_sharpen(&sharp, flight, call, id);
    bool positive = false, negative = false, known = true;
    unsigned zeros = 0;
    for (int i = 0; i < 3; i++) {
        positive |= sharp.sign[i] == 1;
        negative |= sharp.sign[i] == -1;
        known &= sharp.sign[i] != SIGN_UNKNOWN;
        zeros |= (unsigned)(sharp.sign[i] == 0) << i;
    }
    if ((positive && negative) || zeros == 7) {
        call->sharpened++;
        return;
    }
    if (known && lane_offer(call, flight, &flight->frames[0], &sharp.lane, id, zeros)) {
        call->sharpened++;
        return;
    }
    gn_ref_certified_consider(call, flight, id);
}

/* At the end: t and barycentrics as accurate as trace.h promises, if they are not yet. */
static __attribute__((noinline)) void best_refine(struct gn_ref_flight *flight, const struct gn_ref_certified *call)
{
    struct sharp sharp;
    struct gn_ref_candidate refined = flight->best;
    lane_sharpen(&sharp, flight, call, flight->best.id);
    if (lane_place(&refined, &flight->frames[0], &sharp.lane) && gn_ref_candidate_accurate(&refined))
        flight->best = refined;
}

static inline void flight_refine(struct gn_ref_flight *flight, const struct gn_ref_certified *call)
{
    if (!call->any && flight->best.id != GN_REF_NO_ID && !flight->lost && !gn_ref_candidate_accurate(&flight->best))
        best_refine(flight, call);
}

static inline float f32_of_bits(uint32_t bits)
{
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static inline float f32_upper(uint16_t bits)
{
    return f32_of_bits((uint32_t)bits << 16);
}

static inline float f32_power(int exponent)
{
    return f32_of_bits((uint32_t)(exponent + 127) << 23);
}

/* The lanes of a leaf that f32 cannot exclude. */
static inline unsigned leaf_test_of(const struct gn_ref_flight *flight, const struct gn_ref_frame *frame, bool narrow)
{
    const uint32_t index = flight->current & ~GN_REF_LEAF_BIT;
    const struct gn_ref_leaf_f32 *leaf = &frame->bvh->leaves_f32[narrow ? index : 0];
    const struct gn_ref_leaf_i16 *grid = &frame->bvh->leaves_i16[narrow ? 0 : index];
    const uint32_t kx = frame->axis[0], ky = frame->axis[1], kz = frame->axis[2];
    const float scale = narrow ? f32_power(-leaf->exponent) : grid->inverse_size;
    const float *middle = narrow ? leaf->origin : grid->centre;
    const double *origin = narrow ? frame->origin : frame->local;
    const float cx = middle[kx], cy = middle[ky], cz = middle[kz];
    const double along = cz - origin[2];
    const float beta_x = (float)((cx - origin[0] - frame->shear_whole[0] * along) * scale);
    const float beta_y = (float)((cy - origin[1] - frame->shear_whole[1] * along) * scale);
    const float eta = (float)(frame->local_error * scale);
    const float ex = narrow ? f32_upper(leaf->extent[kx]) : grid->step[kx];
    const float ey = narrow ? f32_upper(leaf->extent[ky]) : grid->step[ky];
    const float ez = narrow ? f32_upper(leaf->extent[kz]) : grid->step[kz];
    const float sx = frame->shear_f32[0], sy = frame->shear_f32[1];
    const float least_shear = narrow ? 0 : 0x1p-6f, share = narrow ? 5 * 0x1p-24f : 0.625f;
    const float eps_x = share * (ex + (fabsf(sx) + least_shear) * ez) + (0x1p-22f * fabsf(beta_x) + eta);
    const float eps_y = share * (ey + (fabsf(sy) + least_shear) * ez) + (0x1p-22f * fabsf(beta_y) + eta);
    const f8 step_x = f8_set1(narrow ? scale : ex), step_y = f8_set1(narrow ? scale : ey);
    const f8 shear_x = f8_set1(sx * (narrow ? scale : ez)), shear_y = f8_set1(sy * (narrow ? scale : ez));
    const f8 bx = f8_set1(beta_x), by = f8_set1(beta_y), mx = f8_set1(cx), my = f8_set1(cy), mz = f8_set1(cz);
#define AXIS(v, axis, m) (narrow ? f8_sub(f8_load(leaf->w[v][axis]), m) : f8_load_i16(grid->k[v][axis]))
#define VERTEX(v)                                                                                                      \
    const f8 z##v = AXIS(v, kz, mz);                                                                                   \
    const f8 x##v = f8_nmuladd(shear_x, z##v, f8_muladd(AXIS(v, kx, mx), step_x, bx));                                 \
    const f8 y##v = f8_nmuladd(shear_y, z##v, f8_muladd(AXIS(v, ky, my), step_y, by))
    VERTEX(0);
    VERTEX(1);
    VERTEX(2);
    const f8 nx = f8_add(f8_add(f8_abs(x0), f8_abs(x1)), f8_abs(x2));
    const f8 ny = f8_add(f8_add(f8_abs(y0), f8_abs(y1)), f8_abs(y2));
    const f8 u = f8_nmuladd(y1, x2, f8_mul(x1, y2));
    const f8 v = f8_nmuladd(y2, x0, f8_mul(x2, y0));
    const f8 w = f8_nmuladd(y0, x1, f8_mul(x0, y1));
    /* n_y (eps_x + 4 u n_x) + eps_y (n_x + 2.5 eps_x) */
    const f8 error = f8_muladd(ny, f8_muladd(f8_set1(0x1p-22f), nx, f8_set1(eps_x)),
                               f8_muladd(f8_set1(eps_y), nx, f8_set1(2.5f * eps_x * eps_y)));
    const f8 most = f8_max(u, f8_max(v, w)), least = f8_min(u, f8_min(v, w));
    unsigned missed = f8_gt(most, error) & f8_gt(f8_neg(error), least);
    return ~missed & ((1u << (narrow ? leaf->count : grid->count)) - 1);
}

static inline unsigned leaf_test(const struct gn_ref_flight *flight, const struct gn_ref_frame *frame)
{
    return frame->bvh->leaves_f32 ? leaf_test_of(flight, frame, true) : leaf_test_of(flight, frame, false);
}

/* (S_1 + S_2) z - fl(S_1 z), S_1 being an f32, but for the rounding of S_2 z and of the sum. */
static inline double shear_rest(double first, double second, double z)
{
    double c = z * 0x1.0000002p27, high = c - (c - z), low = z - high;
    return ((first * high - first * z) + first * low) + second * z;
}

static inline void lane_visit(struct gn_ref_certified *call, struct gn_ref_flight *flight,
                              const struct gn_ref_frame *frame, uint32_t place, bool sharp, bool narrow)
{
    struct lane lane;
    const uint64_t id = gn_ref_id(flight->instance, place);
    double w[3][3], x[3], y[3], n = 0, vertex_error;
    lane_corners(w, &vertex_error, frame->bvh, place, frame->axis, narrow);
    lane.eps = narrow ? frame->eps : muladd(vertex_error, 3, frame->eps);
    for (int v = 0; v < 3; v++)
        lane.z[v] = w[v][2] - frame->origin[2];
    /* The triangle's own extent bounds s. */
    double a = frame->sign * lane.z[0], b = frame->sign * lane.z[1], c = frame->sign * lane.z[2];
    double first = (least_of(a, least_of(b, c)) - lane.eps) * frame->unit;
    double last = (most_of(a, most_of(b, c)) + lane.eps) * frame->unit;
    if (first > flight->best.upper || last < flight->s_first || first > flight->s_last)
        return;
    for (int v = 0; v < 3; v++) {
        double z = lane.z[v];
        x[v] = w[v][0] - frame->origin[0];
        y[v] = w[v][1] - frame->origin[1];
        if (narrow && !FUSED && frame->split) {
            x[v] = (x[v] - frame->shear[0] * z) - shear_rest(frame->shear[0], frame->shear_rest[0], z);
            y[v] = (y[v] - frame->shear[1] * z) - shear_rest(frame->shear[1], frame->shear_rest[1], z);
        } else {
            x[v] = nmuladd(frame->shear[0], z, x[v]);
            y[v] = nmuladd(frame->shear[1], z, y[v]);
        }
        if (narrow && FUSED) {
            x[v] = nmuladd(frame->shear_rest[0], z, x[v]);
            y[v] = nmuladd(frame->shear_rest[1], z, y[v]);
        }
        n += fabs(x[v]) + fabs(y[v]);
    }
    if (!narrow) {
        lane.error = lane.eps * muladd(n, 1.5, lane.eps * 4);
    } else if (sharp) {
        double product = 0;
        for (int i = 0; i < 3; i++) {
            int j = (i + 1) % 3, k = (i + 2) % 3;
            product = most_of(fabs(x[j] * y[k]) + fabs(y[j] * x[k]), product);
        }
        lane.error = muladd(frame->bound[0], product, muladd(frame->bound[1], n, frame->bound[2]));
    } else {
        lane.error = muladd(1.5 * frame->eps, n, 4 * frame->eps * frame->eps);
    }
    lane.edge[0] = nmuladd(y[1], x[2], x[1] * y[2]);
    lane.edge[1] = nmuladd(y[2], x[0], x[2] * y[0]);
    lane.edge[2] = nmuladd(y[0], x[1], x[0] * y[1]);
    double most = most_of(lane.edge[0], most_of(lane.edge[1], lane.edge[2]));
    double least = least_of(lane.edge[0], least_of(lane.edge[1], lane.edge[2]));
    /* Unknown errors are infinite: then it is neither missed nor certainly met, nor are NaNs that come of them. */
    if (most > lane.error && least < -lane.error)
        return;
    if ((least > lane.error || most < -lane.error) && lane_offer(call, flight, frame, &lane, id, 0))
        return;
    if (narrow && flight->best.zeros &&
        gn_ref_certified_tie(call, flight, id, lane.edge, lane.error, frame->sign < 0 ? -frame->turn : frame->turn))
        return;
    lane_settle(call, flight, id);
}

static inline void leaf_leave_of(struct gn_ref_certified *call, struct gn_ref_flight *flight,
                                 const struct gn_ref_frame *frame, unsigned open, bool narrow)
{
    const struct gn_ref_bvh *bvh = frame->bvh;
    uint32_t leaf = flight->current & ~GN_REF_LEAF_BIT;
    uint32_t count = narrow ? bvh->leaves_f32[leaf].count : bvh->leaves_i16[leaf].count;
    bool sharp = narrow && !bvh->leaves_f32[leaf].fine;
    call->filtered += count;
    call->rejected_f32 += count - (unsigned)__builtin_popcount(open);
    for (; open; open &= open - 1)
        lane_visit(call, flight, frame, leaf * GN_REF_NODE_WIDTH + (unsigned)__builtin_ctz(open), sharp, narrow);
}

static inline void leaf_leave(struct gn_ref_certified *call, struct gn_ref_flight *flight,
                              const struct gn_ref_frame *frame, unsigned open)
{
    if (frame->bvh->leaves_f32)
        leaf_leave_of(call, flight, frame, open, true);
    else
        leaf_leave_of(call, flight, frame, open, false);
}

typedef float v4_f32 __attribute__((vector_size(16)));
typedef int32_t m4_32 __attribute__((vector_size(16)));

/*
 * A ray as a tree sees it; s is t times `length`, 0 standing for the largest
 * component of d. False when it is outside the range of certified.h. `turn` is left to the caller.
 */
static inline bool frame_set(struct gn_ref_frame *frame, const struct gn_ref_bvh *bvh,
                             const struct gn_ref_local_ray *ray, double length)
{
    const m4 sign_bits = (m4){INT64_MIN, INT64_MIN, INT64_MIN, INT64_MIN};
    const double origin_error = ray->origin_error, direction_error = ray->direction_error;
    const v4 o = ray->origin, d = ray->direction;
    const v4 p = o - (v4){bvh->centre[0], bvh->centre[1], bvh->centre[2], 0};
    const v4 size = GN_REF_V4_ABS(d), far = GN_REF_V4_ABS(p) + (v4){bvh->half[0], bvh->half[1], bvh->half[2], 0};
    int z = size[1] > size[0] ? 1 : 0;
    z = size[2] > size[z] ? 2 : z;
    int x = z == 2 ? 0 : z + 1, y = z == 0 ? 2 : z - 1;
    double depth = d[z], own_length = size[z], inverse_depth = 1 / depth;
    double unit = length == 0 ? 1 : length * fabs(inverse_depth);
    double reach = most_of(far[0], most_of(far[1], far[2])) * (1 + 0x1p-40);
    reach = most_of(reach, GN_REF_LEAST_REACH);
    double spread = (origin_error + reach * (direction_error * fabs(inverse_depth))) * (1 + 0x1p-20);
    if (!(reach <= GN_REF_MOST_REACH && reach * unit <= GN_REF_MOST_REACH && reach * unit >= GN_REF_LEAST_REACH &&
          spread <= reach))
        return false;
    /* Components below 2^-30 of the largest count as that, so that nothing divides by 0. */
    const double least = own_length * 0x1p-30, world_length = length == 0 ? own_length : length;
    const v4 floor_size = {least, least, least, own_length};
    const m4 large = size >= floor_size;
    const v4 g = (v4)(((m4)d & sign_bits) | (large & (m4)size) | (~large & (m4)floor_size));
    const v4 inverse = GN_REF_V4_ALL(world_length) / g, along = p * inverse;
    const v4 delta = GN_REF_V4_ABS(inverse) * (4 * 0x1p-24 * reach + 2 * spread);
    const v4_f32 scale = __builtin_convertvector(inverse, v4_f32);
    const v4_f32 near_bias = __builtin_convertvector(along + delta, v4_f32);
    const v4_f32 far_bias = __builtin_convertvector(along - delta, v4_f32);
    const m4_32 lower = {0, 32, 64, 0}, flip = (m4_32)(scale < 0) & 96;
    const m4_32 near_offset = lower + flip, far_offset = lower + 96 - flip;
    _Static_assert(offsetof(struct gn_ref_node, upper) - offsetof(struct gn_ref_node, lower) == 96 &&
                       offsetof(struct gn_ref_node, lower) == 0,
                   "the offsets above");
    memcpy(frame->scale, &scale, sizeof scale);
    memcpy(frame->near_bias, &near_bias, sizeof near_bias);
    memcpy(frame->far_bias, &far_bias, sizeof far_bias);
    memcpy(frame->near_offset, &near_offset, sizeof near_offset);
    memcpy(frame->far_offset, &far_offset, sizeof far_offset);

    bool exact = origin_error == 0 && direction_error == 0;
    bool sharp = exact && bvh->quantum > 0 && reach < 0x1p52 * bvh->quantum;
    if (sharp) {
        /* Products by a power of two are exact, and whole numbers when they come back from 64 bits as they were. */
        const v4 multiple = o * bvh->inverse_quantum;
        sharp = fabs(multiple[0]) < 0x1p62 && fabs(multiple[1]) < 0x1p62 && fabs(multiple[2]) < 0x1p62;
        if (sharp) {
            const m4 same = __builtin_convertvector(__builtin_convertvector(multiple, m4), v4) == multiple;
            sharp = (same[0] & same[1] & same[2]) != 0;
        }
    }
    const int axes[3] = {x, y, z};
    for (int i = 0; i < 3; i++) {
        frame->axis[i] = (uint32_t)axes[i];
        frame->local[i] = p[axes[i]];
        frame->origin[i] = o[axes[i]];
    }
    for (int i = 0; i < 2; i++) {
        double component = d[axes[i]], shear = component * inverse_depth, first = (float)shear;
        double rest = (component - first * depth) * inverse_depth;
        frame->shear_whole[i] = shear;
        frame->shear_f32[i] = (float)shear;
        frame->shear_rest[i] = sharp ? rest : 0;
        frame->shear[i] = sharp ? first : shear;
    }
    frame->bvh = bvh;
    frame->split = sharp;
    frame->sign = depth < 0 ? -1 : 1;
    frame->unit = unit;
    double eps = 8 * 0x1p-53 * reach + 4 * spread, h = 0x1p-75 * reach;
    frame->eps = eps;
    frame->local_error = 0x1p-49 * reach + 2.5 * spread;
    frame->bound[0] = sharp ? 6.5 * 0x1p-53 : 0;
    frame->bound[1] = sharp ? 1.25 * h : 1.5 * eps;
    frame->bound[2] = sharp ? 4 * h * h : 4 * eps * eps;
    return true;
}

/* In the world nothing is wrong with it. */
static inline void world_ray_set(struct gn_ref_local_ray *out, const struct gn_ref_ray *ray)
{
    out->origin = (v4){ray->origin[0], ray->origin[1], ray->origin[2], 0};
    out->direction = (v4){ray->direction[0], ray->direction[1], ray->direction[2], 0};
    out->origin_error = out->direction_error = 0;
}

bool GN_REF_KERNEL_START(struct gn_ref_flight *flight, const struct gn_ref_scene *scene, const struct gn_ref_ray *ray)
{
    struct gn_ref_frame *world = &flight->frames[0];
    const struct gn_ref_bvh *bvh = gn_ref_scene_root(scene);
    struct gn_ref_local_ray here;
    world_ray_set(&here, ray);
    if (!frame_set(world, bvh, &here, 0))
        return false;
    world->turn = 1;
    for (int i = 0; i < 3; i++)
        flight->direction[i] = ray->direction[world->axis[i]];
    flight->length = fabs(flight->direction[2]);
    flight->inside = 0;
    flight->floor = 0;
    flight->lost = false;
    flight->instance = scene->lone_instance;
    flight->s_first = ray->tmin * flight->length + 0.0;
    flight->s_last = ray->tmax * flight->length;
    flight->s_first_f32 = gn_ref_f32_down(flight->s_first < FLT_MAX ? flight->s_first : FLT_MAX);
    flight->s_limit_f32 = gn_ref_f32_up(flight->s_last < GN_REF_MOST_REACH ? flight->s_last : GN_REF_MOST_REACH);
    flight->current = 0;
    flight->depth = 0;
    flight->best.id = GN_REF_NO_ID;
    flight->best.lower = flight->best.upper = INFINITY;
    flight->best.zeros = 0;
    flight->ray = ray;
    return true;
}

/* Into the instance that has been met, if it can be seen at all. */
static inline bool flight_enter(struct gn_ref_certified *call, struct gn_ref_flight *flight)
{
    const struct gn_ref_scene *scene = call->scene;
    struct gn_ref_frame *frame = &flight->frames[1];
    uint32_t instance = flight->current & ~GN_REF_LEAF_BIT;
    struct gn_ref_local_ray ray;
    bool placed = gn_ref_instance_is_entered(scene, instance, call->forced);
    if (flight->tests >> GN_REF_EFFECT_MASK & 1) {
        gn_ref_effect_ran(GN_REF_EFFECT_MASK, 1);
        if ((scene->instances[instance].mask & flight->ray->cull_mask & 0xFF) == 0)
            return flight_pop(flight, true);
    }
    if (placed) {
        gn_ref_local_ray_set(&ray, scene, instance, flight->ray);
        if (call->counts)
            gn_ref_effect_ran(GN_REF_EFFECT_INSTANCE_TRANSFORMS, 1);
    } else {
        world_ray_set(&ray, flight->ray);
    }
    frame->turn = placed ? scene->instance_data[instance].determinant_sign : 1;
    if (!frame_set(frame, gn_ref_scene_tree(scene, instance), &ray, placed ? flight->length : 0)) {
        flight->lost = true;
        flight->depth = 0;
        return false;
    }
    flight->inside = 1;
    flight->instance = instance;
    flight->floor = flight->depth;
    flight->current = 0;
    return true;
}

/* What is next: a node, a leaf of triangles, or an instance. */
enum step { STEP_NODE, STEP_LEAF, STEP_INSTANCE, STEP_COUNT };
static inline enum step flight_next(const struct gn_ref_flight *flight, bool layered)
{
    unsigned is_leaf = flight->current >> 31;
    return (enum step)(layered && !flight->inside ? 2 * is_leaf : is_leaf);
}

/* One node, leaf or instance; false at the ray's end. */
static inline bool flight_step(struct gn_ref_certified *call, struct gn_ref_flight *flight, bool layered, bool ahead)
{
    const struct gn_ref_frame *frame = frame_of(flight, layered);
    enum step step = flight_next(flight, layered);
    if (step == STEP_NODE) {
        uint32_t keys[GN_REF_NODE_WIDTH];
        unsigned met = node_test(keys, flight, frame);
        return node_leave(flight, frame->bvh, keys, met, ahead, layered);
    }
    if (step == STEP_INSTANCE)
        return flight_enter(call, flight);
    leaf_leave(call, flight, frame, leaf_test(flight, frame));
    return flight_pop(flight, layered);
}

static inline void run_one(struct gn_ref_certified *call, struct gn_ref_flight *flight, bool layered, bool ahead)
{
    while (flight_step(call, flight, layered, ahead))
        ;
    flight_refine(flight, call);
}

/* With counters of what is visited (effects.h). */
static __attribute__((noinline)) void run_counted(struct gn_ref_certified *call, struct gn_ref_flight *flight)
{
    uint64_t leaves = 0, nodes = 0, triangles = 0;
    do {
        const struct gn_ref_bvh *bvh = frame_of(flight, true)->bvh;
        enum step step = flight_next(flight, call->scene->layered);
        leaves += step == STEP_LEAF;
        nodes += step == STEP_NODE;
        if (step == STEP_LEAF)
            triangles += bvh->leaves_f32 ? bvh->leaves_f32[flight->current & ~GN_REF_LEAF_BIT].count
                                         : bvh->leaves_i16[flight->current & ~GN_REF_LEAF_BIT].count;
    } while (flight_step(call, flight, call->scene->layered, false));
    flight_refine(flight, call);
    call->counts->leaves += leaves;
    call->counts->nodes += nodes;
    call->counts->triangles += triangles;
}

/* Which flights are to visit what next. */
struct turn {
    unsigned list[STEP_COUNT][FLIGHTS];
    size_t count[STEP_COUNT];
};

static inline void turn_add(struct turn *turn, const struct gn_ref_certified *call, const struct gn_ref_flight *flights,
                            unsigned i, bool layered)
{
    enum step step = flight_next(&flights[i], layered);
    turn->list[step][turn->count[step]++] = i;
    if (step == STEP_INSTANCE) {
        uint32_t instance = flights[i].current & ~GN_REF_LEAF_BIT;
        prefetch(&call->scene->instance_data[instance], sizeof *call->scene->instance_data);
        prefetch(&call->scene->instances[instance], sizeof *call->scene->instances);
    } else {
        prefetch_child(frame_of(&flights[i], layered)->bvh, flights[i].current);
    }
}

/* A flight goes on, or has ended and the next ray takes its place. */
static inline void turn_end(struct turn *turn, struct gn_ref_certified *call, struct gn_ref_flight *flights, unsigned i,
                            bool goes_on, bool layered)
{
    if (!goes_on) {
        flight_refine(&flights[i], call);
        gn_ref_certified_end(call, &flights[i]);
        goes_on = gn_ref_certified_next(call, &flights[i]);
    }
    if (goes_on)
        turn_add(turn, call, flights, i, layered);
}

/*
 * Rays in flight take their steps in turns: first the arithmetic for all, free of branches so that the processor
 * overlaps it, then what depends on its outcome.
 */
static inline void run_batch(struct gn_ref_certified *call, bool layered)
{
    struct gn_ref_flight flights[FLIGHTS];
    uint32_t keys[FLIGHTS][GN_REF_NODE_WIDTH];
    unsigned met[FLIGHTS];
    struct turn turn = {0};
    for (unsigned i = 0; i < FLIGHTS && gn_ref_certified_next(call, &flights[i]); i++)
        turn_add(&turn, call, flights, i, layered);
    while (turn.count[STEP_NODE] + turn.count[STEP_LEAF] + turn.count[STEP_INSTANCE] > 0) {
        /* Whoever stays in a list is written before the place that is read. */
        size_t count = turn.count[STEP_INSTANCE];
        turn.count[STEP_INSTANCE] = 0;
        for (size_t n = 0; layered && n < count; n++) {
            unsigned i = turn.list[STEP_INSTANCE][n];
            turn_end(&turn, call, flights, i, flight_enter(call, &flights[i]), layered);
        }
        count = turn.count[STEP_NODE];
        for (size_t n = 0; n < count; n++) {
            const struct gn_ref_flight *flight = &flights[turn.list[STEP_NODE][n]];
            met[n] = node_test(keys[n], flight, frame_of(flight, layered));
        }
        turn.count[STEP_NODE] = 0;
        for (size_t n = 0; n < count; n++) {
            unsigned i = turn.list[STEP_NODE][n];
            const struct gn_ref_bvh *bvh = frame_of(&flights[i], layered)->bvh;
            turn_end(&turn, call, flights, i, node_leave(&flights[i], bvh, keys[n], met[n], false, layered), layered);
        }
        count = turn.count[STEP_LEAF];
        for (size_t n = 0; n < count; n++) {
            const struct gn_ref_flight *flight = &flights[turn.list[STEP_LEAF][n]];
            met[n] = leaf_test(flight, frame_of(flight, layered));
        }
        for (size_t n = 0; n < count; n++) {
            const struct gn_ref_flight *flight = &flights[turn.list[STEP_LEAF][n]];
            const struct gn_ref_bvh *bvh = frame_of(flight, layered)->bvh;
            for (unsigned open = bvh->leaves_i16 ? met[n] : 0; open; open &= open - 1)
                prefetch_triangle(bvh, flight->current, (unsigned)__builtin_ctz(open));
        }
        turn.count[STEP_LEAF] = 0;
        for (size_t n = 0; n < count; n++) {
            unsigned i = turn.list[STEP_LEAF][n];
            leaf_leave(call, &flights[i], frame_of(&flights[i], layered), met[n]);
            turn_end(&turn, call, flights, i, flight_pop(&flights[i], layered), layered);
        }
    }
}

void GN_REF_KERNEL(struct gn_ref_certified *call, struct gn_ref_flight *single)
{
    bool layered = call->scene->layered;
    if (single && call->counts)
        run_counted(call, single);
    else if (single && !layered && call->fits_cache)
        run_one(call, single, false, false);
    else if (single && !layered)
        run_one(call, single, false, true);
    else if (single)
        run_one(call, single, true, !call->fits_cache);
    else if (layered)
        run_batch(call, true);
    else
        run_batch(call, false);
}
