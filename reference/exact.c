/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The exact stage: every decision in integer arithmetic (GMP), straight from the inputs. Slow and simple; what it
 * says is what the reference means.
 *
 * Vectors and matrices are homogeneous integers: (x, y, z, weight) stands for (x, y, z) / weight. Finite binary
 * numbers times a common power of two are integers, and in homogeneous form that power cancels, so no exponents
 * have to be carried except the direction's, whose length t is measured in.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "reference/scene_internal.h"

void gn_ref_exact_init(struct gn_ref_exact *exact)
{
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            mpz_init(exact->vertex[i][j]);
        mpz_init(exact->cross[i]);
        mpz_init(exact->direction[i]);
    }
    for (size_t i = 0; i < sizeof exact->scratch / sizeof exact->scratch[0]; i++)
        mpz_init(exact->scratch[i]);
    for (int i = 0; i < 4; i++)
        mpz_init(exact->edge[i]);
    mpz_init(exact->weight);
    struct gn_ref_ratio *ratios[3] = {&exact->t, &exact->t_exit, &exact->t_other};
    for (int i = 0; i < 3; i++) {
        mpz_init(ratios[i]->numerator);
        mpz_init_set_ui(ratios[i]->denominator, 1);
        ratios[i]->exponent = 0;
    }
}

void gn_ref_exact_finish(struct gn_ref_exact *exact)
{
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            mpz_clear(exact->vertex[i][j]);
        mpz_clear(exact->cross[i]);
        mpz_clear(exact->direction[i]);
    }
    for (size_t i = 0; i < sizeof exact->scratch / sizeof exact->scratch[0]; i++)
        mpz_clear(exact->scratch[i]);
    for (int i = 0; i < 4; i++)
        mpz_clear(exact->edge[i]);
    mpz_clear(exact->weight);
    struct gn_ref_ratio *ratios[3] = {&exact->t, &exact->t_exit, &exact->t_other};
    for (int i = 0; i < 3; i++) {
        mpz_clear(ratios[i]->numerator);
        mpz_clear(ratios[i]->denominator);
    }
}

/* Finite value = mantissa * 2^exponent with an odd mantissa, or 0 and a huge exponent. */
static int64_t split(double value, long *out_exponent)
{
    if (value == 0) {
        *out_exponent = 100000;
        return 0;
    }
    int exponent;
    int64_t mantissa = (int64_t)ldexp(frexp(value, &exponent), 53);
    int zeros = __builtin_ctzll((uint64_t)mantissa);
    *out_exponent = (long)exponent - 53 + zeros;
    return mantissa / (INT64_C(1) << zeros);
}

/* out[i] = values[i] * 2^-e for the largest e that makes all of them integers; gives e (0 if all are zero). */
static long set_integers(mpz_t *const *out, const double *values, int count)
{
    int64_t mantissa[16];
    long exponent[16], least = 100000;
    for (int i = 0; i < count; i++) {
        mantissa[i] = split(values[i], &exponent[i]);
        if (exponent[i] < least)
            least = exponent[i];
    }
    for (int i = 0; i < count; i++) {
        mpz_set_si(*out[i], mantissa[i]);
        if (mantissa[i] != 0)
            mpz_mul_2exp(*out[i], *out[i], (mp_bitcnt_t)(exponent[i] - least));
    }
    return least == 100000 ? 0 : least;
}

/*
 * Replaces the homogeneous points (shared weight) by their images under a transform. scratch[0..13] is used.
 */
static void transform_points(struct gn_ref_exact *exact, const float transform[12], int point_count)
{
    mpz_t *m[13];
    double values[13];
    for (int i = 0; i < 12; i++)
        values[i] = transform[i];
    values[12] = 1;
    for (int i = 0; i < 13; i++)
        m[i] = &exact->scratch[i];
    set_integers(m, values, 13);
    for (int p = 0; p < point_count; p++) {
        mpz_t *v = exact->vertex[p];
        for (int row = 0; row < 3; row++) {
            mpz_t *sum = &exact->cross[row];
            mpz_mul(*sum, *m[row * 4 + 3], exact->weight);
            for (int column = 0; column < 3; column++)
                if (mpz_sgn(*m[row * 4 + column]) != 0)
                    mpz_addmul(*sum, *m[row * 4 + column], v[column]);
        }
        for (int row = 0; row < 3; row++)
            mpz_swap(v[row], exact->cross[row]);
    }
    mpz_mul(exact->weight, exact->weight, *m[12]);
}

/* exact->vertex and exact->weight become the exact world vertices. */
static void world_triangle(struct gn_ref_exact *exact, const struct gn_ref_scene *scene,
                           const struct gn_ref_primitive *primitive)
{
    const struct gn_ref_instance *instance = &scene->instances[primitive->instance];
    const struct gn_ref_blas *blas = &scene->blases[instance->blas];
    const struct gn_ref_geometry *geometry = &blas->geometries[primitive->geometry];
    mpz_t *out[10];
    double values[10];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            out[3 * i + j] = &exact->vertex[i][j];
            values[3 * i + j] = geometry->positions[geometry->triangles[primitive->primitive][i]][j];
        }
    out[9] = &exact->weight;
    values[9] = geometry->divisor;
    set_integers(out, values, 10);
    if (gn_ref_effect_applies(GN_REF_EFFECT_GEOMETRY_TRANSFORMS, !blas->matrices[primitive->geometry].identity, 3))
        transform_points(exact, geometry->transform ? geometry->transform : gn_ref_identity, 3);
    if (gn_ref_effect_applies(GN_REF_EFFECT_INSTANCE_TRANSFORMS,
                              !scene->instance_data[primitive->instance].matrix.identity, 3))
        transform_points(exact, instance->transform, 3);
}

/* cross = a x b */
static void cross_product(mpz_t *cross, mpz_t *a, mpz_t *b)
{
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        mpz_mul(cross[i], a[j], b[k]);
        mpz_submul(cross[i], a[k], b[j]);
    }
}

static void dot_product(mpz_t out, mpz_t *a, mpz_t *b)
{
    mpz_mul(out, a[0], b[0]);
    mpz_addmul(out, a[1], b[1]);
    mpz_addmul(out, a[2], b[2]);
}

int gn_ref_determinant_sign_exact(const float transform[12])
{
    struct gn_ref_exact exact;
    gn_ref_exact_init(&exact);
    mpz_t *out[9];
    double values[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            out[3 * i + j] = &exact.vertex[i][j];
            values[3 * i + j] = transform[4 * i + j];
        }
    set_integers(out, values, 9);
    cross_product(exact.cross, exact.vertex[0], exact.vertex[1]);
    dot_product(exact.scratch[0], exact.cross, exact.vertex[2]);
    int sign = mpz_sgn(exact.scratch[0]);
    gn_ref_exact_finish(&exact);
    return sign;
}

bool gn_ref_triangle_degenerate_exact(struct gn_ref_exact *exact, const struct gn_ref_scene *scene,
                                      const struct gn_ref_primitive *primitive)
{
    world_triangle(exact, scene, primitive);
    for (int i = 1; i < 3; i++)
        for (int j = 0; j < 3; j++)
            mpz_sub(exact->vertex[i][j], exact->vertex[i][j], exact->vertex[0][j]);
    cross_product(exact->cross, exact->vertex[1], exact->vertex[2]);
    return mpz_sgn(exact->cross[0]) == 0 && mpz_sgn(exact->cross[1]) == 0 && mpz_sgn(exact->cross[2]) == 0;
}

bool gn_ref_signs_meet(const struct gn_ref_signs *signs)
{
    bool positive = false, negative = false;
    for (int i = 0; i < 3; i++) {
        positive |= signs->edge[i] > 0;
        negative |= signs->edge[i] < 0;
    }
    return positive != negative;
}

/* The origin as integers in scratch[0..2] and its weight in scratch[3]. */
static void set_origin(struct gn_ref_exact *exact, const struct gn_ref_ray *ray)
{
    double values[4] = {ray->origin[0], ray->origin[1], ray->origin[2], 1};
    mpz_t *out[4] = {&exact->scratch[0], &exact->scratch[1], &exact->scratch[2], &exact->scratch[3]};
    set_integers(out, values, 4);
}

static long set_direction(struct gn_ref_exact *exact, const struct gn_ref_ray *ray)
{
    double values[3] = {ray->direction[0], ray->direction[1], ray->direction[2]};
    mpz_t *out[3] = {&exact->direction[0], &exact->direction[1], &exact->direction[2]};
    return set_integers(out, values, 3);
}

struct gn_ref_signs gn_ref_triangle_exact(struct gn_ref_exact *exact, const struct gn_ref_scene *scene,
                                          const struct gn_ref_primitive *primitive, const struct gn_ref_ray *ray)
{
    world_triangle(exact, scene, primitive);
    set_origin(exact, ray);
    /* vertex - origin = (vertex * origin_weight - origin * weight) / (weight * origin_weight) */
    for (int j = 0; j < 3; j++) {
        mpz_mul(exact->scratch[4], exact->scratch[j], exact->weight);
        for (int i = 0; i < 3; i++) {
            mpz_mul(exact->vertex[i][j], exact->vertex[i][j], exact->scratch[3]);
            mpz_sub(exact->vertex[i][j], exact->vertex[i][j], exact->scratch[4]);
        }
    }
    mpz_mul(exact->weight, exact->weight, exact->scratch[3]);

    long exponent = set_direction(exact, ray);
    struct gn_ref_signs signs;
    for (int i = 0; i < 3; i++) {
        cross_product(exact->cross, exact->vertex[(i + 1) % 3], exact->vertex[(i + 2) % 3]);
        dot_product(exact->edge[i], exact->cross, exact->direction);
        signs.edge[i] = mpz_sgn(exact->edge[i]);
    }
    mpz_add(exact->edge[3], exact->edge[0], exact->edge[1]);
    mpz_add(exact->edge[3], exact->edge[3], exact->edge[2]);
    signs.sum = mpz_sgn(exact->edge[3]);
    if (signs.sum == 0)
        return signs;

    /* cross is A x B here. With the weight w of A, B, C: t = (T / w^3) / (sum / w^2 * 2^exponent). */
    dot_product(exact->t.numerator, exact->cross, exact->vertex[2]);
    mpz_mul(exact->t.denominator, exact->edge[3], exact->weight);
    exact->t.exponent = -exponent;
    if (mpz_sgn(exact->t.denominator) < 0) {
        mpz_neg(exact->t.numerator, exact->t.numerator);
        mpz_neg(exact->t.denominator, exact->t.denominator);
    }
    return signs;
}

/*
 * A transform M for boxes: the columns of its linear part in vertex[], its weight n in s[7], det M in s[8], and
 * s[0..2], the origin o with weight w = s[3], become o n - c w.
 */
static void box_matrix(struct gn_ref_exact *exact, const float transform[12])
{
    mpz_t *s = exact->scratch, *m[13];
    double values[13];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            m[3 * i + j] = &exact->vertex[i][j];
            values[3 * i + j] = transform[4 * i + j];
        }
        m[9 + i] = &s[4 + i];
        values[9 + i] = transform[4 * i + 3];
    }
    m[12] = &s[7];
    values[12] = 1;
    set_integers(m, values, 13);
    for (int i = 0; i < 3; i++) {
        mpz_mul(s[0 + i], s[0 + i], s[7]);
        mpz_submul(s[0 + i], s[4 + i], s[3]);
    }
    /* Row i of the adjugate is the cross product of the columns i+1 and i+2 of the matrix. */
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < i; j++)
            mpz_swap(exact->vertex[i][j], exact->vertex[j][i]);
    cross_product(exact->cross, exact->vertex[1], exact->vertex[2]);
    dot_product(s[8], exact->cross, exact->vertex[0]);
}

/*
 * In object space, with the integer matrix m (weight n; of the identity everything is 1 and nothing computed) and the origin o (weight w), adj and det those of m's
 * linear part p, translation c:
 *     o' = adj (o n - c w) / (det w),   d' = adj d n 2^e / det
 * and a box face at f = g * 2^h is met at t = (f - o') / d' = (g det w - 2^-h adj(o n - c w)) / (w adj d n) * 2^(h-e).
 */
bool gn_ref_box_exact(struct gn_ref_exact *exact, const struct gn_ref_scene *scene,
                      const struct gn_ref_primitive *primitive, const struct gn_ref_ray *ray)
{
    const struct gn_ref_instance *instance = &scene->instances[primitive->instance];
    const struct gn_ref_geometry *geometry = &scene->blases[instance->blas].geometries[primitive->geometry];
    const float *box = geometry->aabbs[primitive->primitive];
    mpz_t *s = exact->scratch;

    set_origin(exact, ray); /* s[0..2], weight s[3] */
    long exponent = set_direction(exact, ray);

    bool placed = gn_ref_effect_applies(GN_REF_EFFECT_INSTANCE_TRANSFORMS,
                                        !scene->instance_data[primitive->instance].matrix.identity, 1);
    if (placed)
        box_matrix(exact, instance->transform);
    else
        mpz_set_ui(s[8], 1);
    mpz_mul(s[9], s[8], s[3]); /* det w */

    mpz_t *faces[6];
    double face_values[6];
    for (int i = 0; i < 6; i++) {
        faces[i] = &s[10 + i];
        face_values[i] = box[i];
    }
    long face_exponent = set_integers(faces, face_values, 6);
    unsigned long left = 0; /* what to shift the origin's term by, when h < 0, else the face's */
    if (face_exponent < 0) {
        left = (unsigned long)-face_exponent;
    } else if (face_exponent > 0) {
        for (int i = 0; i < 6; i++)
            mpz_mul_2exp(s[10 + i], s[10 + i], (mp_bitcnt_t)face_exponent);
        face_exponent = 0;
    }

    bool bounded = false;
    for (int i = 0; i < 3; i++) {
        if (box[i] > box[3 + i])
            return false;
        if (placed) {
            cross_product(exact->cross, exact->vertex[(i + 1) % 3], exact->vertex[(i + 2) % 3]);
            dot_product(s[16], exact->cross, s); /* adj (o n - c w) */
            dot_product(s[17], exact->cross, exact->direction);
            mpz_mul(s[17], s[17], s[7]);
        } else {
            mpz_set(s[16], s[i]);
            mpz_set(s[17], exact->direction[i]);
        }
        mpz_mul_2exp(s[16], s[16], left);
        mpz_mul(s[17], s[17], s[3]); /* w adj d n */
        for (int side = 0; side < 2; side++) {
            mpz_mul(s[18 + side], s[10 + i + 3 * side], s[9]);
            mpz_sub(s[18 + side], s[18 + side], s[16]);
        }
        int slope = mpz_sgn(s[17]);
        if (slope == 0) {
            /* (f - o') has the sign of the numerator times that of det: s[3] is positive. */
            int sign = mpz_sgn(s[8]);
            if (mpz_sgn(s[18]) * sign > 0 || mpz_sgn(s[19]) * sign < 0)
                return false;
            continue;
        }
        /* t increases with the face when d' > 0, that is when slope and det have one sign. */
        if (slope * mpz_sgn(s[8]) < 0)
            mpz_swap(s[18], s[19]);
        if (slope < 0) {
            mpz_neg(s[17], s[17]);
            mpz_neg(s[18], s[18]);
            mpz_neg(s[19], s[19]);
        }
        for (int side = 0; side < 2; side++) {
            struct gn_ref_ratio *end = side ? &exact->t_exit : &exact->t;
            mpz_set(exact->t_other.numerator, s[18 + side]);
            mpz_set(exact->t_other.denominator, s[17]);
            exact->t_other.exponent = face_exponent - exponent;
            if (bounded) {
                int order = gn_ref_ratio_compare(exact, &exact->t_other, end);
                if (side ? order >= 0 : order <= 0)
                    continue;
            }
            gn_ref_ratio_set(end, &exact->t_other);
        }
        bounded = true;
    }
    /* The direction is not zero and the matrix regular, so at least one axis bounded t. */
    if (gn_ref_ratio_compare(exact, &exact->t, &exact->t_exit) > 0)
        return false;
    if (isinf(ray->tmin) || gn_ref_ratio_compare_f64(exact, &exact->t_exit, ray->tmin) < 0)
        return false;
    return isinf(ray->tmax) || gn_ref_ratio_compare_f64(exact, &exact->t, ray->tmax) <= 0;
}

/* The sign of a * 2^exponent_a - b * 2^exponent_b; scratch is overwritten. */
static int compare_scaled(mpz_t scratch, mpz_t a, long exponent_a, mpz_t b, long exponent_b)
{
    if (exponent_a > exponent_b) {
        mpz_mul_2exp(scratch, a, (mp_bitcnt_t)(exponent_a - exponent_b));
        return mpz_cmp(scratch, b);
    }
    mpz_mul_2exp(scratch, b, (mp_bitcnt_t)(exponent_b - exponent_a));
    return mpz_cmp(a, scratch);
}

int gn_ref_ratio_compare_f64(struct gn_ref_exact *exact, const struct gn_ref_ratio *a, double b)
{
    mpz_t *s = exact->scratch + 20;
    long exponent;
    int64_t mantissa = split(b, &exponent);
    if (mantissa == 0)
        return mpz_sgn(a->numerator);
    mpz_mul_si(s[0], a->denominator, mantissa);
    mpz_set(s[1], a->numerator);
    int order = compare_scaled(s[2], s[1], a->exponent, s[0], exponent);
    return (order > 0) - (order < 0);
}

int gn_ref_ratio_compare(struct gn_ref_exact *exact, const struct gn_ref_ratio *a, const struct gn_ref_ratio *b)
{
    mpz_t *s = exact->scratch + 20;
    mpz_mul(s[0], a->numerator, b->denominator);
    mpz_mul(s[1], b->numerator, a->denominator);
    int order = compare_scaled(s[2], s[0], a->exponent, s[1], b->exponent);
    return (order > 0) - (order < 0);
}

void gn_ref_ratio_set(struct gn_ref_ratio *out, const struct gn_ref_ratio *in)
{
    mpz_set(out->numerator, in->numerator);
    mpz_set(out->denominator, in->denominator);
    out->exponent = in->exponent;
}

void gn_ref_ratio_set_f64(struct gn_ref_ratio *out, double value)
{
    long exponent;
    mpz_set_si(out->numerator, split(value, &exponent));
    mpz_set_ui(out->denominator, 1);
    out->exponent = value == 0 ? 0 : exponent;
}

/*
 * 55 or 56 bits of the quotient, then a bit that says whether anything is left, are what the conversion rounds. Where the least f64 is above
 * them, only two bits below it are kept and the same is said of the rest, so that ldexp() does not round what is rounded.
 */
double gn_ref_quotient_f64(mpz_t scratch[3], mpz_srcptr numerator, mpz_srcptr denominator, long exponent)
{
    if (mpz_sgn(numerator) == 0)
        return 0;
    long shift = 55 - ((long)mpz_sizeinbase(numerator, 2) - (long)mpz_sizeinbase(denominator, 2));
    mpz_mul_2exp(scratch[0], shift >= 0 ? numerator : denominator, (mp_bitcnt_t)labs(shift));
    mpz_tdiv_qr(scratch[1], scratch[2], shift >= 0 ? scratch[0] : numerator, shift >= 0 ? denominator : scratch[0]);
    uint64_t bits = (uint64_t)mpz_get_ui(scratch[1]) << 1 | (mpz_sgn(scratch[2]) != 0);
    long total = exponent - shift - 1;
    if (total > 2000)
        total = 2000;
    if (total < -1136)
        total = -1136;
    if (total < -1076) {
        const int below = (int)(-1076 - total);
        bits = bits >> below | ((bits & ((UINT64_C(1) << below) - 1)) != 0);
        total = -1076;
    }
    double mantissa = mpz_sgn(numerator) < 0 ? -(double)bits : (double)bits;
    return ldexp(mantissa, (int)total);
}

double gn_ref_ratio_f64(struct gn_ref_exact *exact, const struct gn_ref_ratio *a)
{
    return gn_ref_quotient_f64(exact->scratch + 20, a->numerator, a->denominator, a->exponent);
}

struct gn_ref_interval gn_ref_ratio_interval(struct gn_ref_exact *exact, const struct gn_ref_ratio *a)
{
    if (mpz_sgn(a->numerator) == 0)
        return (struct gn_ref_interval){0, 0};
    double value = gn_ref_ratio_f64(exact, a), magnitude = fabs(value);
    if (isinf(value))
        return value > 0 ? (struct gn_ref_interval){0x1.fp1023, INFINITY} : (struct gn_ref_interval){-INFINITY, -0x1.fp1023};
    if (magnitude < 0x1p-1000)
        return (struct gn_ref_interval){-0x1.1p-1000, 0x1.1p-1000};
    return (struct gn_ref_interval){value - 0x1p-50 * magnitude, value + 0x1p-50 * magnitude};
}

double gn_ref_exact_barycentric(struct gn_ref_exact *exact, int index)
{
    mpz_t *s = exact->scratch + 23;
    int sign = mpz_sgn(exact->edge[3]);
    mpz_abs(s[0], exact->edge[3]);
    double value = gn_ref_quotient_f64(exact->scratch + 20, exact->edge[index], s[0], 0);
    return sign < 0 ? -value : value;
}
