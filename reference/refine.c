/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The numbers of a triangle that is known to be met, when the scene's f64 vertices are not accurate enough for them (thin
 * triangles far from the origin, stretched by an instance): its vertices are placed once more, and all is computed in
 * pairs of f64, u = 2^-53.
 *
 * A pair stands for its exact sum. Sums of pairs (accurate ones, with both rests) are wrong by at most 4 u^2 of the larger magnitudes
 * that go into them, products by 8 u^2 of theirs. Vertices and transform being f32, a vertex is a sum of four exact
 * products: with A bounding the sums of their magnitudes and the origin's, its difference to the origin is wrong by
 * 3 * 4 u^2 A + 8 u^2 A = 20 u^2 A. With D = max |d| the sheared coordinate x = d_z a_x - d_x a_z is wrong by
 * (2 * 20 + 2 * 8 + 8) u^2 D A = 64 u^2 D A, and is at most 2 D A. An edge function x_j y_k - y_j x_k then is wrong by
 * (4 * 2 * 64 + 2 * 8 * 4 + 32) u^2 (D A)^2 and terms of u^4, less than
 *     E = 2^10 u^2 (D A)^2.
 * Nothing underflows: all numbers are multiples of 2^-894, and E is at least 2^-692 where A is not 0. Factors are below 2^230.
 * S = U + V + W, all of one sign, is wrong by E_S = 3.5 E + 9 u^2 |S|, which has to be below |S| / 64; a quotient of pairs
 * by 20 u^2 of itself. So a barycentric is wrong by
 *     (4.5 E + 9 u^2 |S|) / (|S| - E_S) + 21 u^2 <= f = 4.8 E / |S| + 32 u^2,
 * and u of itself from being rounded. s = A_z + b P + c Q, P = B_z - A_z and Q = C_z - A_z: A_z is wrong by 20 u^2 A, P and Q by
 * 2 * 20 u^2 A + 4 u^2 2 A = 48 u^2 A. They are at most 2 A, the weights at most 1 together, so that the products add 8 u^2 2 A
 * and the sums 4 u^2 2 A and 4 u^2 3 A. That is less than
 *     f (|P| + |Q|) + 112 u^2 A,
 * and u |s| from being rounded.
 */
#include <math.h>

#include "reference/certified.h"

/* high + low, low at most half an ulp of high. */
struct pair {
    double high, low;
};

static struct pair pair_of_sum(double a, double b)
{
    double sum = a + b, other = sum - a;
    return (struct pair){sum, (a - (sum - other)) + (b - other)};
}

/* Dekker's product: factors below 2^970. */
static struct pair pair_of_product(double a, double b)
{
    double p = a * b, c = a * 0x1.0000002p27, d = b * 0x1.0000002p27;
    double a1 = c - (c - a), b1 = d - (d - b), a0 = a - a1, b0 = b - b1;
    return (struct pair){p, a0 * b0 - (((p - a1 * b1) - a0 * b1) - a1 * b0)};
}

static struct pair pair_add(struct pair a, struct pair b)
{
    struct pair high = pair_of_sum(a.high, b.high), low = pair_of_sum(a.low, b.low);
    high = pair_of_sum(high.high, high.low + low.high);
    return pair_of_sum(high.high, high.low + low.low);
}

static struct pair pair_negate(struct pair a)
{
    return (struct pair){-a.high, -a.low};
}

static struct pair pair_multiply(struct pair a, struct pair b)
{
    struct pair p = pair_of_product(a.high, b.high);
    return pair_of_sum(p.high, p.low + (a.high * b.low + a.low * b.high));
}

/* b is not 0 */
static struct pair pair_divide(struct pair a, struct pair b)
{
    double q = a.high / b.high;
    struct pair rest = pair_add(a, pair_negate(pair_multiply((struct pair){q, 0}, b)));
    return pair_of_sum(q, rest.high / b.high);
}

/* a b - c d */
static struct pair cross(struct pair a, struct pair b, struct pair c, struct pair d)
{
    return pair_add(pair_multiply(a, b), pair_negate(pair_multiply(c, d)));
}

bool gn_ref_candidate_refine(struct gn_ref_candidate *candidate, const struct gn_ref_flight *flight,
                             const struct gn_ref_scene *scene)
{
    const struct gn_ref_primitive primitive = gn_ref_scene_primitive(scene, candidate->id);
    const struct gn_ref_frame *world = &flight->frames[0];
    const struct gn_ref_instance *instance = &scene->instances[primitive.instance];
    const struct gn_ref_blas *blas = &scene->blases[instance->blas];
    const struct gn_ref_geometry *geometry = &blas->geometries[primitive.geometry];
    const double unit = 0x1p-53;
    if (geometry->divisor != 1 || !blas->matrices[primitive.geometry].identity)
        return false;
    bool placed = gn_ref_effect_applies(GN_REF_EFFECT_INSTANCE_TRANSFORMS,
                                        !scene->instance_data[primitive.instance].matrix.identity, 3);
    const float *transform = placed ? instance->transform : gn_ref_identity;
    struct pair x[3], y[3], z[3], edge[3];
    double most = 0;
    for (int v = 0; v < 3; v++) {
        const double *position = geometry->positions[geometry->triangles[primitive.primitive][v]];
        struct pair a[3];
        for (int i = 0; i < 3; i++) {
            uint32_t axis = world->axis[i];
            const float *m = transform + 4 * axis;
            struct pair sum = {placed ? m[3] : position[axis], 0};
            double size = fabs(sum.high) + fabs(world->origin[i]);
            if ((double)(float)position[axis] != position[axis])
                return false;
            for (int j = 0; placed && j < 3; j++) {
                double product = m[j] * position[j];
                sum = pair_add(sum, (struct pair){product, 0});
                size += fabs(product);
            }
            a[i] = pair_add(sum, (struct pair){-world->origin[i], 0});
            most = size > most ? size : most;
        }
        const struct pair dx = {flight->direction[0], 0}, dy = {flight->direction[1], 0}, dz = {flight->direction[2], 0};
        x[v] = cross(dz, a[0], dx, a[2]);
        y[v] = cross(dz, a[1], dy, a[2]);
        z[v] = a[2];
    }
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        edge[i] = cross(x[j], y[k], y[j], x[k]);
    }
    double scale = flight->length * most * (1 + 0x1p-40), error = 0x1p-96 * scale * scale;
    struct pair sum = pair_add(edge[0], pair_add(edge[1], edge[2]));
    double size = fabs(sum.high), square = unit * unit;
    if (!(3.5 * error + 9 * square * size < size * (1.0 / 65)))
        return false;
    double f = 4.8125 * error / size + 32 * square;
    struct pair b = pair_divide(edge[1], sum), c = pair_divide(edge[2], sum);
    struct pair p = pair_add(z[1], pair_negate(z[0])), q = pair_add(z[2], pair_negate(z[0]));
    struct pair s = pair_add(z[0], pair_add(pair_multiply(b, p), pair_multiply(c, q)));
    candidate->beta = b.high;
    candidate->gamma = c.high;
    candidate->barycentric_error = f + unit * fmax(b.high, c.high);
    candidate->s = world->sign * s.high;
    candidate->s_error = (f * (fabs(p.high) + fabs(q.high)) + 128 * square * most + unit * fabs(s.high)) * (1 + 0x1p-50);
    return gn_ref_candidate_accurate(candidate);
}
