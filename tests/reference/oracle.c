/* SPDX-License-Identifier: Apache-2.0 */
/* The oracle: see oracle.h. */
#include "oracle.h"

#include <gmp.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A point or vector x / w of integers; w may be negative, never 0. */
struct rational3 {
    mpz_t x[3], w;
};

struct item {
    uint32_t instance, geometry, primitive;
    bool forgotten;
};

struct entry {
    struct gn_ref_hit hit;
    mpz_t numerator, denominator; /* of the t that orders; denominator > 0 */
    mpz_t number[ORACLE_NUMBER_COUNT], over[ORACLE_NUMBER_COUNT]; /* exactly, over > 0 */
};

struct oracle {
    struct oracle_scene scene;
    struct item *triangles, *boxes;
    size_t triangle_count, box_count, padded;
    bool exclude_nothing;
    /* World vertices: c[3 * vertex + axis][triangle], and the largest error of the nine. */
    double *c[9], *radius;
    double (*spheres)[4];
    unsigned char *open;
    struct entry *entries;
    struct gn_ref_hit *hits;
    size_t *order;
    size_t count, capacity;
    struct oracle_counters counters;
    /* The ray in object space, per instance, made when first needed. */
    struct rational3 origin[ORACLE_INSTANCES], direction[ORACLE_INSTANCES];
    bool have_ray[ORACLE_INSTANCES];
    struct rational3 corner[3], box[2];
    mpz_t s[24];
    mpz_t matrix[16];
};

static void rational3_init(struct rational3 *r)
{
    for (int i = 0; i < 3; i++)
        mpz_init(r->x[i]);
    mpz_init_set_ui(r->w, 1);
}

static void rational3_clear(struct rational3 *r)
{
    for (int i = 0; i < 3; i++)
        mpz_clear(r->x[i]);
    mpz_clear(r->w);
}

/* values[i] = out[i] / 2^k for the least k >= 0 that will do for all; a value 1 added at the end gives 2^k. */
static void integers(mpz_t *const *out, const double *values, int count)
{
    int k = 0;
    for (int i = 0; i < count; i++) {
        double value = values[i];
        if (value == 0)
            continue;
        int e;
        uint64_t m = (uint64_t)(frexp(fabs(value), &e) * 0x1p53);
        int low = e - 53 + __builtin_ctzll(m);
        if (-low > k)
            k = -low;
    }
    for (int i = 0; i < count; i++) {
        int e;
        double m = frexp(values[i], &e) * 0x1p53;
        mpz_set_d(*out[i], m);
        long shift = (long)e - 53 + k;
        if (shift >= 0)
            mpz_mul_2exp(*out[i], *out[i], (mp_bitcnt_t)shift);
        else
            mpz_fdiv_q_2exp(*out[i], *out[i], (mp_bitcnt_t)-shift);
    }
}

static void load_point(struct rational3 *out, const double values[3], double weight)
{
    mpz_t *to[4] = {&out->x[0], &out->x[1], &out->x[2], &out->w};
    double four[4] = {values[0], values[1], values[2], weight};
    integers(to, four, 4);
}

static void load_matrix(struct oracle *o, const float m[12])
{
    mpz_t *to[13];
    double values[13];
    for (int i = 0; i < 12; i++) {
        to[i] = &o->matrix[i];
        values[i] = m[i];
    }
    to[12] = &o->matrix[12];
    values[12] = 1;
    integers(to, values, 13);
}

/* point = matrix * point */
static void apply(struct oracle *o, struct rational3 *p)
{
    for (int r = 0; r < 3; r++) {
        mpz_mul(o->s[r], o->matrix[4 * r + 3], p->w);
        for (int c = 0; c < 3; c++)
            mpz_addmul(o->s[r], o->matrix[4 * r + c], p->x[c]);
    }
    for (int r = 0; r < 3; r++)
        mpz_set(p->x[r], o->s[r]);
    mpz_mul(p->w, p->w, o->matrix[12]);
}

static const struct gn_ref_geometry *geometry_of(const struct oracle *o, const struct item *item)
{
    return &o->scene.geometries[o->scene.blas_first[o->scene.instances[item->instance].blas] + item->geometry];
}

/* The corners in object space, with the geometry transform. */
static void load_triangle(struct oracle *o, const struct item *item)
{
    const struct gn_ref_geometry *g = geometry_of(o, item);
    if (g->transform)
        load_matrix(o, g->transform);
    for (int v = 0; v < 3; v++) {
        load_point(&o->corner[v], g->positions[g->triangles[item->primitive][v]], g->divisor);
        if (g->transform)
            apply(o, &o->corner[v]);
    }
}

/* The nearest f64 or its neighbour, and a bound on what it is wrong by. */
static double to_double(mpz_t numerator, mpz_t denominator, double *out_error)
{
    mpq_t q, back;
    mpq_init(q);
    mpq_init(back);
    mpq_set_num(q, numerator);
    mpq_set_den(q, denominator);
    mpq_canonicalize(q);
    double value = mpq_get_d(q);
    mpq_set_d(back, isfinite(value) ? value : 0);
    *out_error = isfinite(value) && mpq_equal(q, back) ? 0 : fabs(value) * 0x1p-52 + 0x1p-1074;
    mpq_clear(q);
    mpq_clear(back);
    return value;
}

static void *zeroed(size_t count, size_t size)
{
    void *memory = aligned_alloc(64, (count * size + 64) / 64 * 64);
    if (!memory)
        abort();
    memset(memory, 0, (count * size + 64) / 64 * 64);
    return memory;
}

static void add_triangle(struct oracle *o, const struct item *item)
{
    size_t index = o->triangle_count++;
    o->triangles[index] = *item;
    load_triangle(o, item);
    load_matrix(o, o->scene.instances[item->instance].transform);
    for (int v = 0; v < 3; v++) {
        apply(o, &o->corner[v]);
        for (int axis = 0; axis < 3; axis++) {
            double error;
            o->c[3 * v + axis][index] = to_double(o->corner[v].x[axis], o->corner[v].w, &error);
            o->radius[index] = fmax(o->radius[index], error);
        }
    }
}

static void add_box(struct oracle *o, const struct item *item)
{
    size_t index = o->box_count++;
    o->boxes[index] = *item;
    const float *box = geometry_of(o, item)->aabbs[item->primitive];
    const float *m = o->scene.instances[item->instance].transform;
    double half[3], centre[3], size = 0, magnitude = 0;
    for (int i = 0; i < 3; i++) {
        centre[i] = ((double)box[i] + box[3 + i]) / 2;
        half[i] = ((double)box[3 + i] - box[i]) / 2;
    }
    for (int r = 0; r < 3; r++) {
        double sum = 0, extent = 0, most = fabs(m[4 * r + 3]);
        for (int c = 0; c < 3; c++) {
            sum += (double)m[4 * r + c] * centre[c];
            extent += fabs((double)m[4 * r + c] * half[c]);
            most += fabs((double)m[4 * r + c]) * (fabs(centre[c]) + fabs(half[c]));
        }
        o->spheres[index][r] = sum + m[4 * r + 3];
        size += extent * extent;
        magnitude = fmax(magnitude, most);
    }
    o->spheres[index][3] = sqrt(size) * 1.001 + magnitude * 0x1p-40;
}

struct oracle *oracle_create(const struct oracle_scene *scene)
{
    struct oracle *o = zeroed(1, sizeof *o);
    o->scene = *scene;
    for (int i = 0; i < 24; i++)
        mpz_init(o->s[i]);
    for (int i = 0; i < 16; i++)
        mpz_init(o->matrix[i]);
    for (int i = 0; i < ORACLE_INSTANCES; i++) {
        rational3_init(&o->origin[i]);
        rational3_init(&o->direction[i]);
    }
    for (int i = 0; i < 3; i++)
        rational3_init(&o->corner[i]);
    for (int i = 0; i < 2; i++)
        rational3_init(&o->box[i]);

    size_t total = 0;
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        uint32_t b = scene->instances[i].blas;
        for (uint32_t g = b == GN_REF_NULL_BLAS ? 0 : scene->blas_first[b];
             b != GN_REF_NULL_BLAS && g < scene->blas_first[b + 1]; g++)
            total += scene->geometries[g].primitive_count;
    }
    o->padded = (total + 16) / 8 * 8;
    o->triangles = zeroed(total + 1, sizeof *o->triangles);
    o->boxes = zeroed(total + 1, sizeof *o->boxes);
    o->spheres = zeroed(total + 1, sizeof *o->spheres);
    o->open = zeroed(o->padded, 1);
    o->radius = zeroed(o->padded, sizeof(double));
    for (int i = 0; i < 9; i++)
        o->c[i] = zeroed(o->padded, sizeof(double));
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        uint32_t b = scene->instances[i].blas;
        if (b == GN_REF_NULL_BLAS)
            continue;
        for (uint32_t g = 0; g < scene->blas_first[b + 1] - scene->blas_first[b]; g++) {
            const struct gn_ref_geometry *geometry = &scene->geometries[scene->blas_first[b] + g];
            for (uint32_t p = 0; p < geometry->primitive_count; p++) {
                struct item item = {i, g, p, false};
                bool inactive = false;
                if (geometry->type == GN_REF_AABBS) {
                    if (!isnan(geometry->aabbs[p][0]))
                        add_box(o, &item);
                    continue;
                }
                for (int v = 0; v < 3; v++)
                    inactive |= isnan(geometry->positions[geometry->triangles[p][v]][0]);
                if (!inactive)
                    add_triangle(o, &item);
            }
        }
    }
    return o;
}

void oracle_destroy(struct oracle *o)
{
    if (!o)
        return;
    for (int i = 0; i < 24; i++)
        mpz_clear(o->s[i]);
    for (int i = 0; i < 16; i++)
        mpz_clear(o->matrix[i]);
    for (int i = 0; i < ORACLE_INSTANCES; i++) {
        rational3_clear(&o->origin[i]);
        rational3_clear(&o->direction[i]);
    }
    for (int i = 0; i < 3; i++)
        rational3_clear(&o->corner[i]);
    for (int i = 0; i < 2; i++)
        rational3_clear(&o->box[i]);
    for (size_t i = 0; i < o->capacity; i++) {
        mpz_clear(o->entries[i].numerator);
        mpz_clear(o->entries[i].denominator);
        for (int n = 0; n < ORACLE_NUMBER_COUNT; n++) {
            mpz_clear(o->entries[i].number[n]);
            mpz_clear(o->entries[i].over[n]);
        }
    }
    for (int i = 0; i < 9; i++)
        free(o->c[i]);
    free(o->triangles);
    free(o->boxes);
    free(o->spheres);
    free(o->open);
    free(o->radius);
    free(o->entries);
    free(o->hits);
    free(o->order);
    free(o);
}

void oracle_forget(struct oracle *o, uint32_t instance, uint32_t geometry, uint32_t primitive)
{
    for (size_t i = 0; i < o->triangle_count; i++)
        if (o->triangles[i].instance == instance && o->triangles[i].geometry == geometry &&
            o->triangles[i].primitive == primitive)
            o->triangles[i].forgotten = true;
}

void oracle_exclude_nothing(struct oracle *o)
{
    o->exclude_nothing = true;
}

struct oracle_counters oracle_counters(const struct oracle *o)
{
    return o->counters;
}

/*
 * The crude bound. With rho the largest coordinate of vertex - origin and delta its error (that of the vertex, and one
 * rounding), a component of a cross product is wrong by 2 (2 rho delta + delta^2) and 3 roundings of 2 rho^2, their
 * sum over the direction by as much again: E = |d|_1 (4 rho delta + 3 delta^2 + 2^-48 rho^2) is well above. A line
 * certainly misses when two of the triple products d . (B x C), ... are certainly of opposite sign.
 */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
__attribute__((target_clones("avx2", "default")))
#endif
static void exclude(const double *const c[9], const double *radius, unsigned char *open, size_t count,
                    const struct gn_ref_ray *ray)
{
    double ox = ray->origin[0], oy = ray->origin[1], oz = ray->origin[2];
    double dx = ray->direction[0], dy = ray->direction[1], dz = ray->direction[2];
    double d1 = fabs(dx) + fabs(dy) + fabs(dz);
    const double *c0 = c[0], *c1 = c[1], *c2 = c[2], *c3 = c[3], *c4 = c[4], *c5 = c[5], *c6 = c[6], *c7 = c[7],
                 *c8 = c[8];
    for (size_t i = 0; i < count; i++) {
        double ax = c0[i] - ox, ay = c1[i] - oy, az = c2[i] - oz;
        double bx = c3[i] - ox, by = c4[i] - oy, bz = c5[i] - oz;
        double cx = c6[i] - ox, cy = c7[i] - oy, cz = c8[i] - oz;
        double rho = fabs(ax) + fabs(ay) + fabs(az) + fabs(bx) + fabs(by) + fabs(bz) + fabs(cx) + fabs(cy) + fabs(cz);
        double u = dx * (by * cz - bz * cy) + dy * (bz * cx - bx * cz) + dz * (bx * cy - by * cx);
        double v = dx * (cy * az - cz * ay) + dy * (cz * ax - cx * az) + dz * (cx * ay - cy * ax);
        double w = dx * (ay * bz - az * by) + dy * (az * bx - ax * bz) + dz * (ax * by - ay * bx);
        double delta = radius[i] + 0x1p-52 * rho;
        double error = d1 * (4 * rho * delta + 3 * delta * delta + 0x1p-48 * rho * rho);
        int positive = (u > error) | (v > error) | (w > error);
        int negative = (u < -error) | (v < -error) | (w < -error);
        int in_range = (rho > 0x1p-200) & (rho < 0x1p200) & (delta < 0x1p200);
        open[i] = (unsigned char)!(positive & negative & in_range);
    }
}

/* The line passes the sphere around the box at a distance: |A|^2 - (A.d)^2 / |d|^2, with its rounding error. */
static bool sphere_missed(const double sphere[4], const struct gn_ref_ray *ray)
{
    double a[3], aa = 0, ad = 0, dd = 0;
    for (int i = 0; i < 3; i++) {
        a[i] = sphere[i] - ray->origin[i];
        aa += a[i] * a[i];
        ad += a[i] * ray->direction[i];
        dd += (double)ray->direction[i] * ray->direction[i];
    }
    double distance = aa - ad / dd * ad;
    double slack = 0x1p-44 * (aa + sphere[3] * sphere[3]);
    return aa > 0x1p-200 && aa < 0x1p200 && sphere[3] < 0x1p100 && distance - slack > sphere[3] * sphere[3] * 1.01;
}

static void cross(mpz_t *out, mpz_t *a, mpz_t *b)
{
    for (int i = 0; i < 3; i++) {
        mpz_mul(out[i], a[(i + 1) % 3], b[(i + 2) % 3]);
        mpz_submul(out[i], a[(i + 2) % 3], b[(i + 1) % 3]);
    }
}

static void dot(mpz_t out, mpz_t *a, mpz_t *b)
{
    mpz_mul(out, a[0], b[0]);
    mpz_addmul(out, a[1], b[1]);
    mpz_addmul(out, a[2], b[2]);
}

/* o' = inverse of the transform applied to the ray, by Cramer's rule. */
static void load_ray(struct oracle *o, uint32_t instance, const struct gn_ref_ray *ray)
{
    if (o->have_ray[instance])
        return;
    o->have_ray[instance] = true;
    load_matrix(o, o->scene.instances[instance].transform);
    mpz_t *s = o->s, *m = o->matrix;
    struct rational3 *origin = &o->origin[instance], *direction = &o->direction[instance];
    double from[3] = {ray->origin[0], ray->origin[1], ray->origin[2]};
    double along[3] = {ray->direction[0], ray->direction[1], ray->direction[2]};
    load_point(origin, from, 1);
    load_point(direction, along, 1);
    /* origin = (x m33 - t w) / (w m33), still to be multiplied by the inverse linear part times m33. */
    for (int i = 0; i < 3; i++) {
        mpz_mul(s[0], m[4 * i + 3], origin->w);
        mpz_mul(origin->x[i], origin->x[i], m[12]);
        mpz_sub(origin->x[i], origin->x[i], s[0]);
        mpz_mul(direction->x[i], direction->x[i], m[12]);
    }
    /* Cofactors s[r * 3 + c] of m[r][c]; the inverse is their transpose over the determinant. */
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            int r1 = (r + 1) % 3, r2 = (r + 2) % 3, c1 = (c + 1) % 3, c2 = (c + 2) % 3;
            mpz_mul(s[3 * r + c], m[4 * r1 + c1], m[4 * r2 + c2]);
            mpz_submul(s[3 * r + c], m[4 * r1 + c2], m[4 * r2 + c1]);
        }
    mpz_mul(s[9], s[0], m[0]);
    mpz_addmul(s[9], s[1], m[1]);
    mpz_addmul(s[9], s[2], m[2]);
    struct rational3 *both[2] = {origin, direction};
    for (int k = 0; k < 2; k++) {
        for (int i = 0; i < 3; i++) {
            mpz_mul(s[10 + i], s[i], both[k]->x[0]);
            mpz_addmul(s[10 + i], s[3 + i], both[k]->x[1]);
            mpz_addmul(s[10 + i], s[6 + i], both[k]->x[2]);
        }
        for (int i = 0; i < 3; i++)
            mpz_set(both[k]->x[i], s[10 + i]);
        mpz_mul(both[k]->w, both[k]->w, s[9]);
    }
}

static struct entry *new_entry(struct oracle *o)
{
    if (o->count == o->capacity) {
        size_t capacity = o->capacity ? 2 * o->capacity : 16;
        o->entries = realloc(o->entries, capacity * sizeof *o->entries);
        o->hits = realloc(o->hits, capacity * sizeof *o->hits);
        o->order = realloc(o->order, capacity * sizeof *o->order);
        if (!o->entries || !o->hits || !o->order)
            abort();
        for (size_t i = o->capacity; i < capacity; i++) {
            mpz_init(o->entries[i].numerator);
            mpz_init(o->entries[i].denominator);
            for (int n = 0; n < ORACLE_NUMBER_COUNT; n++) {
                mpz_init(o->entries[i].number[n]);
                mpz_init(o->entries[i].over[n]);
            }
        }
        o->capacity = capacity;
    }
    struct entry *entry = &o->entries[o->count];
    memset(&entry->hit, 0, sizeof entry->hit);
    return entry;
}

/* The sign of numerator / denominator - value, denominator > 0; value may be infinite. */
static int compare_value(struct oracle *o, mpz_t numerator, mpz_t denominator, double value)
{
    if (isinf(value))
        return value > 0 ? -1 : 1;
    struct rational3 *scratch = &o->box[0];
    double three[3] = {value, 0, 0};
    load_point(scratch, three, 1);
    mpz_mul(o->s[22], numerator, scratch->w);
    mpz_mul(o->s[23], denominator, scratch->x[0]);
    int order = mpz_cmp(o->s[22], o->s[23]);
    return (order > 0) - (order < 0);
}

/* To within 2^-52 of its magnitude. */
static double rounded(struct oracle *o, mpz_t numerator, mpz_t denominator)
{
    if (mpz_sgn(numerator) == 0)
        return 0;
    long bits = 80 + (long)mpz_sizeinbase(denominator, 2) - (long)mpz_sizeinbase(numerator, 2);
    if (bits < 0)
        bits = 0;
    mpz_mul_2exp(o->s[22], numerator, (mp_bitcnt_t)bits);
    mpz_tdiv_q(o->s[22], o->s[22], denominator);
    signed long exponent;
    double mantissa = mpz_get_d_2exp(&exponent, o->s[22]);
    long total = exponent - bits;
    return ldexp(mantissa, total > 3000 ? 3000 : total < -3000 ? -3000 : (int)total);
}

static bool flags_admit(const struct oracle *o, const struct item *item, const struct gn_ref_ray *ray, bool *out_opaque)
{
    const struct gn_ref_instance *instance = &o->scene.instances[item->instance];
    const struct gn_ref_geometry *geometry = geometry_of(o, item);
    if (!(instance->mask & ray->cull_mask & 0xFF) || item->forgotten)
        return false;
    if (ray->flags & (geometry->type == GN_REF_AABBS ? GN_REF_RAY_SKIP_AABBS : GN_REF_RAY_SKIP_TRIANGLES))
        return false;
    bool opaque = (geometry->flags & GN_REF_GEOMETRY_OPAQUE) != 0;
    opaque = (opaque || (instance->flags & GN_REF_INSTANCE_FORCE_OPAQUE)) &&
             !(instance->flags & GN_REF_INSTANCE_FORCE_NO_OPAQUE);
    opaque = (opaque || (ray->flags & GN_REF_RAY_OPAQUE)) && !(ray->flags & GN_REF_RAY_NO_OPAQUE);
    *out_opaque = opaque;
    return !(opaque && (ray->flags & GN_REF_RAY_CULL_OPAQUE)) && !(!opaque && (ray->flags & GN_REF_RAY_CULL_NO_OPAQUE));
}

/*
 * Moeller-Trumbore with the corners v / w, origin o / p and direction d / q: e1 = v1 - v0, e2 = v2 - v0, T = o w - v0 p,
 * P = d x e2, D = e1 . P, Q = T x e1: beta = T.P / (D p), gamma = d.Q / (D p), t = (e2.Q) q / (D p w).
 */
static void test_triangle(struct oracle *o, const struct item *item, const struct gn_ref_ray *ray)
{
    bool opaque;
    if (!flags_admit(o, item, ray, &opaque))
        return;
    o->counters.exact++;
    load_ray(o, item->instance, ray);
    load_triangle(o, item);
    struct rational3 *v = o->corner;
    struct rational3 *origin = &o->origin[item->instance], *direction = &o->direction[item->instance];
    mpz_t *s = o->s, *e1 = s, *e2 = s + 3, *p = s + 6, *t = s + 9, *q = s + 12;
    /* The corners' weights differ when their lowest bits do. */
    for (int i = 0; i < 3; i++) {
        mpz_mul(e1[i], v[1].x[i], v[0].w);
        mpz_submul(e1[i], v[0].x[i], v[1].w);
        mpz_mul(e1[i], e1[i], v[2].w);
        mpz_mul(e2[i], v[2].x[i], v[0].w);
        mpz_submul(e2[i], v[0].x[i], v[2].w);
        mpz_mul(e2[i], e2[i], v[1].w);
        mpz_mul(t[i], v[1].w, v[2].w);
        mpz_mul(t[i], t[i], v[0].x[i]);
    }
    mpz_mul(s[15], v[0].w, v[1].w);
    mpz_mul(s[15], s[15], v[2].w); /* w, common */
    for (int i = 0; i < 3; i++) {
        mpz_mul(t[i], t[i], origin->w);
        mpz_neg(t[i], t[i]);
        mpz_addmul(t[i], origin->x[i], s[15]);
    }
    cross(p, direction->x, e2);
    dot(s[16], e1, p); /* D */
    if (mpz_sgn(s[16]) == 0)
        return;
    cross(q, t, e1);
    mpz_mul(s[17], s[16], origin->w); /* the denominator */
    dot(s[18], t, p);
    dot(s[19], direction->x, q);
    dot(s[20], e2, q);
    mpz_mul(s[20], s[20], direction->w);
    if (mpz_sgn(s[17]) < 0)
        for (int i = 17; i <= 20; i++)
            mpz_neg(s[i], s[i]);
    mpz_add(s[21], s[18], s[19]);
    if (mpz_sgn(s[18]) < 0 || mpz_sgn(s[19]) < 0 || mpz_cmp(s[21], s[17]) > 0)
        return;
    struct entry *entry = new_entry(o);
    mpz_set(entry->numerator, s[20]);
    mpz_mul(entry->denominator, s[17], s[15]);
    if (mpz_sgn(entry->denominator) < 0)
        abort();
    if (compare_value(o, entry->numerator, entry->denominator, ray->tmin) <= 0 ||
        compare_value(o, entry->numerator, entry->denominator, ray->tmax) >= 0)
        return;
    /* D = -(d . (e1 x e2)), of the direction times its weight; front when d' . N < 0. */
    const struct gn_ref_instance *instance = &o->scene.instances[item->instance];
    bool front = mpz_sgn(s[16]) * mpz_sgn(direction->w) > 0;
    if (instance->flags & GN_REF_INSTANCE_FLIP_FACING)
        front = !front;
    if (!(instance->flags & GN_REF_INSTANCE_FACING_CULL_DISABLE) &&
        (ray->flags & (front ? GN_REF_RAY_CULL_FRONT_FACING : GN_REF_RAY_CULL_BACK_FACING)))
        return;
    entry->hit.type = GN_REF_TRIANGLES;
    entry->hit.instance = item->instance;
    entry->hit.geometry = item->geometry;
    entry->hit.primitive = item->primitive;
    entry->hit.beta = rounded(o, s[18], s[17]);
    entry->hit.gamma = rounded(o, s[19], s[17]);
    entry->hit.t = rounded(o, entry->numerator, entry->denominator);
    for (int n = 0; n < ORACLE_NUMBER_COUNT; n++) {
        bool along = n == ORACLE_T || n == ORACLE_T_EXIT;
        mpz_set(entry->number[n], along ? entry->numerator : s[n == ORACLE_BETA ? 18 : 19]);
        mpz_set(entry->over[n], along ? entry->denominator : s[17]);
    }
    entry->hit.front = front;
    entry->hit.opaque = opaque;
    o->count++;
}

static void test_box(struct oracle *o, const struct item *item, const struct gn_ref_ray *ray)
{
    bool opaque;
    if (!flags_admit(o, item, ray, &opaque))
        return;
    o->counters.exact++;
    load_ray(o, item->instance, ray);
    const float *box = geometry_of(o, item)->aabbs[item->primitive];
    struct rational3 *origin = &o->origin[item->instance], *direction = &o->direction[item->instance];
    mpz_t *s = o->s;
    mpq_t entry_t, exit_t, x;
    mpq_inits(entry_t, exit_t, x, NULL);
    bool bounded = false, hit = true;
    for (int i = 0; i < 3 && hit; i++) {
        for (int side = 0; side < 2; side++) {
            double three[3] = {box[i + 3 * side], 0, 0};
            load_point(&o->box[side], three, 1);
            /* (f / g - o / p) = (f p - o g) / (g p); t = that over d / q */
            mpz_mul(s[2 * side], o->box[side].x[0], origin->w);
            mpz_submul(s[2 * side], origin->x[i], o->box[side].w);
            mpz_mul(s[2 * side + 1], o->box[side].w, origin->w);
            if (mpz_sgn(s[2 * side + 1]) < 0) {
                mpz_neg(s[2 * side], s[2 * side]);
                mpz_neg(s[2 * side + 1], s[2 * side + 1]);
            }
        }
        if (box[i] > box[3 + i])
            hit = false;
        int along = mpz_sgn(direction->x[i]) * mpz_sgn(direction->w);
        if (along == 0) {
            hit = hit && mpz_sgn(s[0]) <= 0 && mpz_sgn(s[2]) >= 0;
            continue;
        }
        for (int side = 0; side < 2; side++) {
            mpz_mul(s[4], s[2 * side], direction->w);
            mpz_mul(s[5], s[2 * side + 1], direction->x[i]);
            mpq_set_num(x, s[4]);
            mpq_set_den(x, s[5]);
            mpq_canonicalize(x);
            bool is_entry = (side == 0) == (along > 0);
            mpq_t *end = is_entry ? &entry_t : &exit_t;
            if (!bounded || (is_entry ? mpq_cmp(x, *end) > 0 : mpq_cmp(x, *end) < 0))
                mpq_set(*end, x);
        }
        bounded = true;
    }
    if (hit && mpq_cmp(entry_t, exit_t) <= 0 &&
        compare_value(o, mpq_numref(exit_t), mpq_denref(exit_t), ray->tmin) >= 0 &&
        compare_value(o, mpq_numref(entry_t), mpq_denref(entry_t), ray->tmax) <= 0) {
        struct entry *entry = new_entry(o);
        entry->hit = (struct gn_ref_hit){.type = GN_REF_AABBS, .instance = item->instance, .geometry = item->geometry,
                                         .primitive = item->primitive, .opaque = opaque};
        entry->hit.t = rounded(o, mpq_numref(entry_t), mpq_denref(entry_t));
        entry->hit.t_exit = rounded(o, mpq_numref(exit_t), mpq_denref(exit_t));
        for (int n = 0; n < ORACLE_NUMBER_COUNT; n++) {
            mpq_set_ui(x, 0, 1);
            if (n == ORACLE_T || n == ORACLE_T_EXIT)
                mpq_set(x, n == ORACLE_T ? entry_t : exit_t);
            mpz_set(entry->number[n], mpq_numref(x));
            mpz_set(entry->over[n], mpq_denref(x));
        }
        if (compare_value(o, mpq_numref(entry_t), mpq_denref(entry_t), ray->tmin) < 0)
            mpq_set_d(entry_t, ray->tmin);
        mpz_set(entry->numerator, mpq_numref(entry_t));
        mpz_set(entry->denominator, mpq_denref(entry_t));
        o->count++;
    }
    mpq_clears(entry_t, exit_t, x, NULL);
}

static int compare_entries(struct oracle *o, const struct entry *a, const struct entry *b)
{
    mpz_mul(o->s[22], a->numerator, b->denominator);
    mpz_mul(o->s[23], b->numerator, a->denominator);
    int order = mpz_cmp(o->s[22], o->s[23]);
    return (order > 0) - (order < 0);
}

size_t oracle_trace(struct oracle *o, const struct gn_ref_ray *ray, const struct gn_ref_hit **out_hits)
{
    o->count = 0;
    memset(o->have_ray, 0, sizeof o->have_ray);
    if (o->exclude_nothing)
        memset(o->open, 1, o->padded);
    else if (o->triangle_count > 0)
        exclude((const double *const *)o->c, o->radius, o->open, o->triangle_count, ray);
    for (size_t i = 0; i < o->triangle_count; i++) {
        if (o->open[i])
            test_triangle(o, &o->triangles[i], ray);
        else
            o->counters.excluded++;
    }
    for (size_t i = 0; i < o->box_count; i++) {
        if (!o->exclude_nothing && sphere_missed(o->spheres[i], ray))
            o->counters.excluded++;
        else
            test_box(o, &o->boxes[i], ray);
    }
    /* Insertion sort by exact t, then ids. */
    for (size_t i = 0; i < o->count; i++) {
        size_t place = i;
        while (place > 0) {
            const struct entry *a = &o->entries[i], *b = &o->entries[o->order[place - 1]];
            int order = compare_entries(o, a, b);
            const struct gn_ref_hit *p = &a->hit, *q = &b->hit;
            if (order == 0)
                order = p->instance != q->instance   ? (p->instance < q->instance ? -1 : 1)
                        : p->geometry != q->geometry ? (p->geometry < q->geometry ? -1 : 1)
                                                     : (p->primitive < q->primitive ? -1 : 1);
            if (order >= 0)
                break;
            o->order[place] = o->order[place - 1];
            place--;
        }
        o->order[place] = i;
    }
    for (size_t i = 0; i < o->count; i++)
        o->hits[i] = o->entries[o->order[i]].hit;
    *out_hits = o->hits;
    return o->count;
}

int oracle_compare_t(struct oracle *o, size_t a, size_t b)
{
    return compare_entries(o, &o->entries[o->order[a]], &o->entries[o->order[b]]);
}

double oracle_error(struct oracle *o, size_t hit, enum oracle_number number, double value)
{
    const struct entry *entry = &o->entries[o->order[hit]];
    struct rational3 *scratch = &o->box[0];
    double three[3] = {value, 0, 0};
    mpz_t *s = o->s;
    if (!isfinite(value))
        return INFINITY;
    /* value - number / over = (x over - number w) / (w over) */
    load_point(scratch, three, 1);
    mpz_mul(s[0], scratch->x[0], entry->over[number]);
    mpz_submul(s[0], entry->number[number], scratch->w);
    mpz_abs(s[0], s[0]);
    mpz_mul(s[1], entry->over[number], scratch->w);
    double error = rounded(o, s[0], s[1]);
    /* Cut off at 53 bits: the next one up, where the rest is not 0. */
    load_point(scratch, (double[3]){error, 0, 0}, 1);
    mpz_mul(s[0], s[0], scratch->w);
    mpz_mul(s[1], s[1], scratch->x[0]);
    return mpz_cmp(s[0], s[1]) > 0 ? nextafter(error, INFINITY) : error;
}
