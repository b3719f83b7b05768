/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The stage between the f64 filter and GMP: the same exact decision in integers of fixed width, 128 bits for
 * coordinates and 256 for edge functions. It applies when the numbers of one triangle and one ray span few enough
 * powers of two, which it checks as it goes, and costs a twentieth of GMP.
 *
 * As in exact.c a point is homogeneous, (x, y, z) / weight, and a common power of two cancels.
 */
#include <math.h>
#include <string.h>

#include "reference/scene_internal.h"

__extension__ typedef __int128 int128;
__extension__ typedef unsigned __int128 uint128;

/* Most bits of a magnitude: sums of two stay within the type, whose sign takes one more. */
#define MOST_BITS_64 62
#define MOST_BITS_128 126

/* values[i] = out[i] * 2^k for one k, below 2^62 in magnitude; false when there is no such k. */
static bool integers_of(int64_t *out, const double *values, int count)
{
    int least = 100000;
    for (int pass = 0; pass < 2; pass++) {
        for (int i = 0; i < count; i++) {
            uint64_t bits;
            memcpy(&bits, &values[i], sizeof bits);
            int exponent = (int)(bits >> 52 & 0x7FF);
            uint64_t mantissa = bits & 0xFFFFFFFFFFFFFu;
            if (exponent == 0 && mantissa == 0) {
                out[i] = 0;
                continue;
            }
            if (exponent == 0)
                return false;
            mantissa |= UINT64_C(1) << 52;
            int zeros = __builtin_ctzll(mantissa);
            exponent += zeros;
            if (pass == 0) {
                least = exponent < least ? exponent : least;
                continue;
            }
            int shift = exponent - least;
            if (shift + 53 - zeros > MOST_BITS_64)
                return false;
            int64_t magnitude = (int64_t)(mantissa >> zeros << shift);
            out[i] = bits >> 63 ? -magnitude : magnitude;
        }
    }
    return true;
}

const float gn_ref_identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

void gn_ref_matrix_prepare(struct gn_ref_matrix *out, const float transform[12])
{
    double values[13];
    for (int i = 0; i < 12; i++)
        values[i] = transform[i];
    values[12] = 1;
    out->valid = integers_of(out->m, values, 13);
    out->identity = true;
    for (int i = 0; i < 12; i++)
        out->identity &= transform[i] == gn_ref_identity[i];
}

void gn_ref_ray_integers_prepare(struct gn_ref_ray_integers *out, const struct gn_ref_ray *ray)
{
    double origin[4] = {ray->origin[0], ray->origin[1], ray->origin[2], 1};
    double direction[3] = {ray->direction[0], ray->direction[1], ray->direction[2]};
    out->valid = integers_of(out->origin, origin, 4) && integers_of(out->direction, direction, 3);
}

static uint128 magnitude_128(int128 value)
{
    return value < 0 ? -(uint128)value : (uint128)value;
}

static int bits_128(uint128 magnitudes)
{
    uint64_t high = (uint64_t)(magnitudes >> 64), low = (uint64_t)magnitudes;
    return high ? 128 - __builtin_clzll(high) : low ? 64 - __builtin_clzll(low) : 0;
}

static int bits_64(const int64_t *values, int count)
{
    uint64_t magnitudes = 0;
    for (int i = 0; i < count; i++)
        magnitudes |= (uint64_t)(values[i] < 0 ? -values[i] : values[i]);
    return magnitudes ? 64 - __builtin_clzll(magnitudes) : 0;
}

static int bits_points(int128 points[3][3])
{
    uint128 magnitudes = 0;
    for (int v = 0; v < 3; v++)
        for (int i = 0; i < 3; i++)
            magnitudes |= magnitude_128(points[v][i]);
    return bits_128(magnitudes);
}

/* Each coordinate becomes a sum of four products: two bits more than one product. */
static bool transform_points(int128 points[3][3], int128 *weight, const struct gn_ref_matrix *matrix)
{
    int points_bits = bits_points(points), weight_bits = bits_128(magnitude_128(*weight));
    int most = points_bits > weight_bits ? points_bits : weight_bits;
    if (!matrix->valid || most + bits_64(matrix->m, 13) + 2 > MOST_BITS_128)
        return false;
    for (int v = 0; v < 3; v++) {
        int128 out[3];
        for (int row = 0; row < 3; row++) {
            const int64_t *m = matrix->m + 4 * row;
            out[row] = points[v][0] * m[0] + points[v][1] * m[1] + points[v][2] * m[2] + *weight * m[3];
        }
        memcpy(points[v], out, sizeof out);
    }
    *weight *= matrix->m[12];
    return true;
}

/* A product of two 128-bit magnitudes. */
struct uint256 {
    uint128 high, low;
};

static struct uint256 multiply(uint128 a, uint128 b)
{
    uint64_t a1 = (uint64_t)(a >> 64), a0 = (uint64_t)a, b1 = (uint64_t)(b >> 64), b0 = (uint64_t)b;
    uint128 low = (uint128)a0 * b0, middle = (uint128)a1 * b0, other = (uint128)a0 * b1, high = (uint128)a1 * b1;
    uint128 carry = (low >> 64) + (uint64_t)middle + (uint64_t)other;
    return (struct uint256){high + (middle >> 64) + (other >> 64) + (carry >> 64), carry << 64 | (uint64_t)low};
}

/* Of the magnitude, with a relative error of at most 2^-52 (two conversions and a sum, each rounded by 2^-53). */
static double value_256(struct uint256 a)
{
    return (double)a.high * 0x1p128 + (double)a.low;
}

/* a b - c d, to f64 with its exact sign and a relative error of at most 2^-52. */
static double cross_2d(int128 a, int128 b, int128 c, int128 d)
{
    struct uint256 p = multiply(magnitude_128(a), magnitude_128(b)), q = multiply(magnitude_128(c), magnitude_128(d));
    bool p_negative = (a < 0) != (b < 0), q_positive = (c < 0) != (d < 0);
    struct uint256 sum;
    bool negative = p_negative;
    if (p_negative != q_positive) {
        sum.low = p.low + q.low;
        sum.high = p.high + q.high + (sum.low < p.low);
    } else {
        if (p.high < q.high || (p.high == q.high && p.low < q.low)) {
            struct uint256 swap = p;
            p = q;
            q = swap;
            negative = !negative;
        }
        sum.low = p.low - q.low;
        sum.high = p.high - q.high - (p.low < q.low);
    }
    double value = value_256(sum);
    return negative ? -value : value;
}

/*
 * The edge functions as in filter.c, but of vertices sheared with d_z times the matrix, which keeps them integers:
 * x = d_z A_x - d_x A_z, y = d_z A_y - d_y A_z. They come out multiplied by d_z^2 (and powers of the weight), which
 * changes no sign. A positive factor does not matter to what is computed from them.
 */
bool gn_ref_triangle_wide(struct gn_ref_lane *out, const struct gn_ref_scene *scene,
                          const struct gn_ref_primitive *primitive, const struct gn_ref_ray_setup *setup,
                          const struct gn_ref_ray_integers *ray)
{
    const struct gn_ref_instance *instance = &scene->instances[primitive->instance];
    const struct gn_ref_blas *blas = &scene->blases[instance->blas];
    const struct gn_ref_geometry *geometry = &blas->geometries[primitive->geometry];
    double values[10];
    int64_t integers[10];
    for (int v = 0; v < 3; v++)
        memcpy(values + 3 * v, geometry->positions[geometry->triangles[primitive->primitive][v]], 3 * sizeof(double));
    values[9] = geometry->divisor;
    if (!ray->valid || !integers_of(integers, values, 10))
        return false;
    int128 a[3][3], weight = integers[9];
    for (int v = 0; v < 3; v++)
        for (int i = 0; i < 3; i++)
            a[v][i] = integers[3 * v + i];
    const struct gn_ref_matrix *matrix = &blas->matrices[primitive->geometry];
    if (gn_ref_effect_applies(GN_REF_EFFECT_GEOMETRY_TRANSFORMS, !matrix->identity, 3) &&
        !transform_points(a, &weight, matrix))
        return false;
    matrix = &scene->instance_data[primitive->instance].matrix;
    if (gn_ref_effect_applies(GN_REF_EFFECT_INSTANCE_TRANSFORMS, !matrix->identity, 3) &&
        !transform_points(a, &weight, matrix))
        return false;

    /* vertex - origin, as in exact.c */
    int points_bits = bits_points(a), weight_bits = bits_128(magnitude_128(weight));
    int most = points_bits > weight_bits ? points_bits : weight_bits;
    if (most + bits_64(ray->origin, 4) + 1 > MOST_BITS_128)
        return false;
    for (int i = 0; i < 3; i++) {
        int128 from = weight * ray->origin[i];
        for (int v = 0; v < 3; v++)
            a[v][i] = a[v][i] * ray->origin[3] - from;
    }
    weight *= ray->origin[3];

    if (bits_points(a) + bits_64(ray->direction, 3) + 1 > MOST_BITS_128)
        return false;
    int kx = setup->k[0], ky = setup->k[1], kz = setup->k[2];
    int64_t dx = ray->direction[kx], dy = ray->direction[ky], dz = ray->direction[kz];
    int128 x[3], y[3];
    double divisor = (double)weight, size = 0;
    for (int v = 0; v < 3; v++) {
        x[v] = a[v][kx] * dz - a[v][kz] * dx;
        y[v] = a[v][ky] * dz - a[v][kz] * dy;
        out->z[v] = (double)a[v][kz] / divisor; /* relative error 3 * 2^-53 */
        size = fmax(size, fabs(out->z[v]));
    }
    out->vertex_error = 0x1p-51 * size;
    uint128 magnitudes = 0;
    for (int v = 0; v < 3; v++)
        magnitudes |= magnitude_128(x[v]) | magnitude_128(y[v]);
    bool narrow = bits_128(magnitudes) <= MOST_BITS_64;
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        if (narrow)
            out->edge[i] = (double)(x[j] * (int64_t)y[k] - y[j] * (int64_t)x[k]);
        else
            out->edge[i] = cross_2d(x[j], y[k], y[j], x[k]);
        out->edge_error[i] = 0x1p-51 * fabs(out->edge[i]);
    }
    return true;
}
