/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The f64 filter: decides nearly everything, and knows when it cannot. u = 2^-53 is half an ulp of 1; round to
 * nearest, no contraction, no flush to zero (gn_ref_trace_* see to it).
 *
 * Triangles. Let x, y, z be the axes in a cyclic order with |d_z| the largest, and S = (d_x, d_y) / d_z. The shear
 * (x, y, z) -> (x - S_x z, y - S_y z, z) has determinant 1 and turns the direction into (0, 0, d_z), so with sheared
 * coordinates
 *     U = d . (B x C) = d_z (B_x C_y - B_y C_x), V and W likewise,
 *     t = (U A_z + V B_z + W C_z) / ((U + V + W) d_z).
 *
 * Error of a sheared coordinate. The stored vertex is wrong by at most e, R is the largest |fl(w - o)| over the
 * triangle. a = fl(w - o): error u R + e. S: error u (its exponent is above 2^-277, no underflow), |S| <= 1 because
 * rounding is monotone. fl(S a_z): (u R + e) + u (R + u R + e) from the factors, u R from rounding. The difference is
 * at most 2 R (1 + u): rounding 2 u R (1 + u). Together 6 u R + 2 e + terms below u (u R + e).
 *     eps = 8 u R + 3 e
 * covers that with its own rounding, and the error of z as well.
 *
 * Error of an edge function B_x C_y - B_y C_x of computed coordinates: from the coordinates
 * eps (|B_x| + |B_y| + |C_x| + |C_y|) + 2 eps^2; from rounding 2 u (|B_x C_y| + |B_y C_x|) (1 + u), which, as no
 * coordinate exceeds 2 R (1 + u), is at most 2 u R (1 + 2u) times the same sum n, that is eps n / 4. So
 *     E = eps (1.5 n + 4 eps)
 * has a margin of eps n / 4 + 2 eps^2.
 *
 * Range. For 2^-200 <= R and eps <= 2^200 nothing overflows, and an underflow (at most 2^-1074 each) vanishes in the
 * margin of 2 eps^2 >= 2^-499. Outside that range the filter decides nothing.
 */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "reference/scene_internal.h"

/* The two inner loops once more for wider registers, chosen when the program is loaded. The arithmetic is the same
 * to the last bit: nothing is contracted, whatever the target. */
#if defined(__x86_64__) && defined(__ELF__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define CLONES __attribute__((target_clones("avx2", "default")))
#else
#define CLONES
#endif

#define UNIT 0x1p-53
#define LEAST_SIZE 0x1p-200
#define MOST_ERROR 0x1p200

void gn_ref_environment_enter(struct gn_ref_environment *environment)
{
#if defined(__SSE2__) && defined(__x86_64__)
    /* The rounding, flush to zero, denormals are zero. Nothing here uses the x87's own. */
    bool plain = (__builtin_ia32_stmxcsr() & 0xE040u) == 0;
#else
    bool plain = fegetround() == FE_TONEAREST;
#endif
    environment->changed = !plain;
    if (!plain) {
        fegetenv(&environment->saved);
        fesetenv(FE_DFL_ENV);
    }
}

void gn_ref_environment_leave(const struct gn_ref_environment *environment)
{
    if (environment->changed)
        fesetenv(&environment->saved);
}

/*
 * The slab test. For a direction component that is not zero, (bound - origin) * scale is t at the bound with a
 * relative error of at most 3 u (1 + 2u): bounds (a stored one plus the centre, a sum that is not rounded) are f64
 * and, like the origin, multiples of 2^-149, so that a difference is 0 or at least 2^-149 and at most 2^130 in
 * magnitude (or infinite, with the bound), and the reciprocal is in [2^-128, 2^149].
 *
 * For a component that is zero the line is inside the slab or not: the scale 2^800 makes a difference that is not zero
 * larger in magnitude than 2^650, and the bias 2^600, outward, lets a bound pass that equals the origin. Entry then is
 * below -2^599 or above 2^649, exit below -2^649 or above 2^599, where t ranges in [0, 2^278] if finite.
 */
static void prepare(struct gn_ref_ray_setup *out, const struct gn_ref_ray *ray, const double origin[3],
                    const double direction[3])
{
    out->ray = ray;
    int z = 0;
    for (int axis = 0; axis < 3; axis++) {
        out->origin[axis] = origin[axis];
        out->scale[axis] = direction[axis] == 0 ? 0x1p800 : 1 / direction[axis];
        out->bias[axis] = direction[axis] == 0 ? 0x1p600 : 0;
        out->swap[axis] = direction[axis] < 0;
        if (fabs(direction[axis]) > fabs(direction[z]))
            z = axis;
    }
    out->k[0] = (z + 1) % 3;
    out->k[1] = (z + 2) % 3;
    out->k[2] = z;
    out->depth = direction[z];
    for (int i = 0; i < 2; i++)
        out->shear[i] = direction[out->k[i]] / out->depth;
}

void gn_ref_ray_prepare(struct gn_ref_ray_setup *out, const struct gn_ref_ray *ray)
{
    const double origin[3] = {ray->origin[0], ray->origin[1], ray->origin[2]};
    const double direction[3] = {ray->direction[0], ray->direction[1], ray->direction[2]};
    prepare(out, ray, origin, direction);
}

/*
 * R bounds |w - o| in object space. A hit at t is at most R from the origin along every axis, so t <= R / |d_z|, and up
 * to it the computed ray is within
 *     e = origin_error + R direction_error / |d_z|
 * of the real one, in each coordinate. Its slabs meet the real hit's t when the box is wider by e on every side; 2^-48 R covers
 * what is rounded here and in the slab test, and components below 2^-100 of d_z, which count as 0. In the filter a
 * vertex's coordinate relative to the ray is wrong by e for the origin and its part of the slope's: as a vertex wrong
 * by e would be, and as z is, 2 e cover both (certified.h has the terms).
 */
double gn_ref_ray_prepare_object(struct gn_ref_ray_setup *out, const struct gn_ref_scene *scene, uint32_t instance,
                                 const struct gn_ref_ray *ray)
{
    struct gn_ref_local_ray object;
    const struct gn_ref_bvh *tree = gn_ref_scene_tree(scene, instance);
    gn_ref_local_ray_set(&object, scene, instance, ray);
    double origin[3], direction[3], reach = 0, length = 0;
    for (int axis = 0; axis < 3; axis++) {
        length = fmax(length, fabs(object.direction[axis]));
        reach = fmax(reach, fabs(object.origin[axis] - tree->centre[axis]) + tree->half[axis]);
    }
    double spread = object.origin_error + reach * (object.direction_error / length);
    bool usable = length >= 0x1p-300 && length <= 0x1p300 && reach <= 0x1p300 && spread <= reach;
    for (int axis = 0; axis < 3; axis++) {
        bool counts = fabs(object.direction[axis]) >= 0x1p-100 * length;
        origin[axis] = usable ? object.origin[axis] : 0;
        direction[axis] = !usable ? 1 : counts ? object.direction[axis] : 0;
    }
    prepare(out, ray, origin, direction);
    for (int axis = 0; axis < 3; axis++) {
        if (usable)
            out->bias[axis] += fabs(out->scale[axis]) * (1.01 * spread + 0x1p-48 * reach);
        else
            out->scale[axis] = 0, out->bias[axis] = INFINITY;
    }
    return usable ? 2 * spread : INFINITY;
}

/*
 * The stay in each child's box, clipped to [tmin, limit]. The nearer end is at least tmin >= 0, so that widening the
 * farther end by the relative errors of both (2 * 3 u; 32 u here) is enough. The comparison is negated so that a NaN,
 * which cannot be, would count as met.
 */
CLONES unsigned gn_ref_filter_node_f64(double near[GN_REF_NODE_WIDTH], const struct gn_ref_node *node,
                                       const double centre[3], const struct gn_ref_ray_setup *setup, double tmin,
                                       double limit)
{
    enum { N = GN_REF_NODE_WIDTH };
    double far[N];
    for (int i = 0; i < N; i++) {
        near[i] = tmin;
        far[i] = limit;
    }
    for (int axis = 0; axis < 3; axis++) {
        const float *first = setup->swap[axis] ? node->upper[axis] : node->lower[axis];
        const float *last = setup->swap[axis] ? node->lower[axis] : node->upper[axis];
        double origin = setup->origin[axis], scale = setup->scale[axis], bias = setup->bias[axis];
        for (int i = 0; i < N; i++) {
            double a = (((double)first[i] + centre[axis]) - origin) * scale - bias;
            double b = (((double)last[i] + centre[axis]) - origin) * scale + bias;
            near[i] = a > near[i] ? a : near[i];
            far[i] = b < far[i] ? b : far[i];
        }
    }
    unsigned met = 0;
    for (int i = 0; i < N; i++)
        met |= (unsigned)(!(near[i] > far[i] * (1 + 0x1p-48)) && node->child[i] != GN_REF_NONE) << i;
    return met;
}

CLONES void gn_ref_filter_block_f64(struct gn_ref_filter *out, const struct gn_ref_block *block,
                             const struct gn_ref_ray_setup *setup)
{
    enum { N = GN_REF_BLOCK_WIDTH };
    double x[3][N], y[3][N], n[3][N], size[N];
    int kx = setup->k[0], ky = setup->k[1], kz = setup->k[2];
    double ox = setup->origin[kx], oy = setup->origin[ky], oz = setup->origin[kz];
    double sx = setup->shear[0], sy = setup->shear[1];
    for (int l = 0; l < N; l++)
        size[l] = 0;
    for (int v = 0; v < 3; v++)
        for (int l = 0; l < N; l++) {
            double ax = block->w[v][kx][l] - ox, ay = block->w[v][ky][l] - oy, az = block->w[v][kz][l] - oz;
            double m = fabs(ax) > fabs(ay) ? fabs(ax) : fabs(ay);
            m = m > fabs(az) ? m : fabs(az);
            size[l] = size[l] > m ? size[l] : m;
            x[v][l] = ax - sx * az;
            y[v][l] = ay - sy * az;
            out->z[v][l] = az;
            n[v][l] = fabs(x[v][l]) + fabs(y[v][l]);
        }
    for (int l = 0; l < N; l++)
        out->vertex_error[l] = 8 * UNIT * size[l] + 3 * block->error[l];
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        for (int l = 0; l < N; l++) {
            double eps = out->vertex_error[l];
            out->edge[i][l] = x[j][l] * y[k][l] - y[j][l] * x[k][l];
            out->edge_error[i][l] = eps * (1.5 * (n[j][l] + n[k][l]) + 4 * eps);
        }
    }
    unsigned open = 0, certain = 0, used = 0;
    for (int l = 0; l < N; l++) {
        unsigned positive = 0, negative = 0;
        for (int i = 0; i < 3; i++) {
            positive += out->edge[i][l] > out->edge_error[i][l];
            negative += out->edge[i][l] < -out->edge_error[i][l];
        }
        /* Written so that a NaN is out of range. */
        bool in_range = size[l] >= LEAST_SIZE && out->vertex_error[l] <= MOST_ERROR;
        bool missed = in_range && positive > 0 && negative > 0;
        used |= (unsigned)(block->id[l] != GN_REF_NO_ID) << l;
        open |= (unsigned)!missed << l;
        certain |= (unsigned)(in_range && (positive == 3 || negative == 3)) << l;
    }
    out->used = used;
    out->open = open & used;
    out->certain = certain & open & used;
}

void gn_ref_filter_lane(struct gn_ref_lane *out, const struct gn_ref_filter *filter, int lane)
{
    for (int i = 0; i < 3; i++) {
        out->edge[i] = filter->edge[i][lane];
        out->edge_error[i] = filter->edge_error[i][lane];
        out->z[i] = filter->z[i][lane];
    }
    out->vertex_error = filter->vertex_error[lane];
}

/*
 * With b = V / S and c = W / S (S = U + V + W, all of one sign): z = A_z + b (B_z - A_z) + c (C_z - A_z), so the errors
 * of the edge functions are weighed by the triangle's extent rather than its distance. S has the error
 * E_S = E_U + E_V + E_W + 2 u S, b the error (E_V + b E_S) / (S - E_S) + u b, and each difference of z 2 eps + u |.|.
 * Every bound below is rounded up generously: the factor 1.0625 stands for the rounding of its own few terms, and for
 * second-order terms, which are smaller still as E_S < S / 64 is asked for.
 */
bool gn_ref_estimate_f64(struct gn_ref_estimate *out, const struct gn_ref_lane *lane,
                         const struct gn_ref_ray_setup *setup)
{
    double u = lane->edge[0], v = lane->edge[1], w = lane->edge[2];
    double sum = u + v + w, size = fabs(sum), eps = lane->vertex_error;
    double sum_error = 1.0625 * (lane->edge_error[0] + lane->edge_error[1] +
                                 lane->edge_error[2] + 2 * UNIT * (fabs(u) + fabs(v) + fabs(w)));
    if (!(sum_error < size / 64) || !(eps <= MOST_ERROR))
        return false;
    double b = v / sum, c = w / sum, rest = size - sum_error;
    double b_error = 1.0625 * ((lane->edge_error[1] + fabs(b) * sum_error) / rest + 2 * UNIT * fabs(b));
    double c_error = 1.0625 * ((lane->edge_error[2] + fabs(c) * sum_error) / rest + 2 * UNIT * fabs(c));
    double a_z = lane->z[0], p = lane->z[1] - a_z, q = lane->z[2] - a_z;
    double z = a_z + (b * p + c * q);
    double p_error = 2 * eps + UNIT * fabs(p), q_error = 2 * eps + UNIT * fabs(q);
    double z_error = 1.0625 * (eps + b_error * (fabs(p) + p_error) + c_error * (fabs(q) + q_error) +
                               fabs(b) * p_error + fabs(c) * q_error + 3 * UNIT * (fabs(b * p) + fabs(c * q)) +
                               UNIT * fabs(z));
    out->t_value = z / setup->depth;
    out->t_error = 1.0625 * (z_error / fabs(setup->depth) + UNIT * fabs(out->t_value));
    out->t = (struct gn_ref_interval){out->t_value - out->t_error, out->t_value + out->t_error};
    out->beta = b;
    out->gamma = c;
    out->barycentric_error = b_error > c_error ? b_error : c_error;
    out->sum_sign = ((sum > 0) ^ (setup->depth < 0)) ? 1 : -1;
    return true;
}

/* nextafter(value, INFINITY), whose call would be a third of what deciding a box takes. */
static double above(double value)
{
    uint64_t bits;
    if (!(value < INFINITY))
        return value;
    if (value == 0)
        return 0x1p-1074;
    memcpy(&bits, &value, sizeof bits);
    bits += value > 0 ? 1 : -(uint64_t)1;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* Interval arithmetic, each end widened by one f64: rounding to nearest is wrong by less. */
static struct gn_ref_interval widen(double lower, double upper)
{
    return (struct gn_ref_interval){-above(-lower), above(upper)};
}

static struct gn_ref_interval point(double value)
{
    return (struct gn_ref_interval){value, value};
}

static struct gn_ref_interval subtract(struct gn_ref_interval a, struct gn_ref_interval b)
{
    return widen(a.lower - b.upper, a.upper - b.lower);
}

static struct gn_ref_interval add(struct gn_ref_interval a, struct gn_ref_interval b)
{
    return widen(a.lower + b.lower, a.upper + b.upper);
}

static struct gn_ref_interval multiply(struct gn_ref_interval a, struct gn_ref_interval b)
{
    if ((a.lower == 0 && a.upper == 0) || (b.lower == 0 && b.upper == 0))
        return point(0);
    double p = a.lower * b.lower, q = a.lower * b.upper, r = a.upper * b.lower, s = a.upper * b.upper;
    return widen(fmin(fmin(p, q), fmin(r, s)), fmax(fmax(p, q), fmax(r, s)));
}

/* b does not contain 0 */
static struct gn_ref_interval divide(struct gn_ref_interval a, struct gn_ref_interval b)
{
    double p = a.lower / b.lower, q = a.lower / b.upper, r = a.upper / b.lower, s = a.upper / b.upper;
    return widen(fmin(fmin(p, q), fmin(r, s)), fmax(fmax(p, q), fmax(r, s)));
}

static struct gn_ref_interval dot(const struct gn_ref_interval a[3], const struct gn_ref_interval b[3])
{
    return add(add(multiply(a[0], b[0]), multiply(a[1], b[1])), multiply(a[2], b[2]));
}

/*
 * Boxes, in object space with everything multiplied by the determinant D of the linear part, adj its adjugate and c
 * the translation: face f is met at t = (f D - adj (o - c)) / (adj d). Products of up to four f32 stay within f64's
 * range (2^-596 .. 2^516), so widening by one f64 bounds every step.
 */
int gn_ref_box_f64(struct gn_ref_interval *out_entry, struct gn_ref_interval *out_exit,
                   const struct gn_ref_scene *scene, const struct gn_ref_primitive *primitive, const struct gn_ref_ray *ray)
{
    const struct gn_ref_instance *instance = &scene->instances[primitive->instance];
    const struct gn_ref_box_transform *data = &scene->box_transforms[primitive->instance];
    const float *transform = instance->transform;
    const float *box = scene->blases[instance->blas].geometries[primitive->geometry].aabbs[primitive->primitive];
    struct gn_ref_interval from[3], direction[3];
    bool placed = gn_ref_effect_applies(GN_REF_EFFECT_INSTANCE_TRANSFORMS,
                                        !scene->instance_data[primitive->instance].matrix.identity, 1);
    for (int i = 0; i < 3; i++) {
        double translation = transform[4 * i + 3];
        from[i] = translation == 0 ? point(ray->origin[i]) : subtract(point(ray->origin[i]), point(translation));
        direction[i] = point(ray->direction[i]);
    }
    struct gn_ref_interval entry = {-INFINITY, -INFINITY}, leave = {INFINITY, INFINITY};
    bool unsure = false;
    for (int i = 0; i < 3; i++) {
        struct gn_ref_interval p = from[i], q = direction[i], near = point(box[i]), far = point(box[3 + i]);
        if (placed) {
            p = dot(data->adjugate[i], from);
            q = dot(data->adjugate[i], direction);
            near = multiply(near, data->determinant);
            far = multiply(far, data->determinant);
        }
        near = subtract(near, p);
        far = subtract(far, p);
        if (placed && data->determinant.lower <= 0 && data->determinant.upper >= 0) {
            unsure = true;
            continue;
        }
        bool mirrored = placed && data->determinant.lower < 0;
        if (q.lower == 0 && q.upper == 0) {
            /* Parallel to this slab: inside it or not. */
            if (mirrored) {
                near = (struct gn_ref_interval){-near.upper, -near.lower};
                far = (struct gn_ref_interval){-far.upper, -far.lower};
            }
            if (near.lower > 0 || far.upper < 0)
                return -1;
            unsure |= near.upper > 0 || far.lower < 0;
            continue;
        }
        if (q.lower <= 0 && q.upper >= 0) {
            unsure = true;
            continue;
        }
        near = divide(near, q);
        far = divide(far, q);
        bool backward = (q.lower < 0) != mirrored;
        struct gn_ref_interval first = backward ? far : near, last = backward ? near : far;
        entry.lower = fmax(entry.lower, first.lower);
        entry.upper = fmax(entry.upper, first.upper);
        leave.lower = fmin(leave.lower, last.lower);
        leave.upper = fmin(leave.upper, last.upper);
    }
    *out_entry = entry;
    *out_exit = leave;
    if (entry.lower > leave.upper || leave.upper < ray->tmin || entry.lower > ray->tmax)
        return -1;
    if (!unsure && entry.upper <= leave.lower && leave.lower >= ray->tmin && entry.upper <= ray->tmax)
        return 1;
    return 0;
}
