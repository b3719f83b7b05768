/* SPDX-License-Identifier: Apache-2.0 */
/* The second oracle: see balls.h. */
#include "balls.h"

#include <flint/arb.h>
#include <flint/fmpq.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* One text for both arithmetics: what is not in use stays as it was. */
struct number {
    arb_t ball;
    fmpq_t exact;
};

enum { POOL = 512 };

struct entry {
    struct gn_ref_hit hit;
    struct number t; /* that orders */
    bool is_exact;
};

struct balls {
    struct oracle_scene scene;
    slong precision; /* 0: rationals */
    bool undecided; /* a sign could not be told: what was found since says nothing */
    struct number pool[POOL];
    size_t used;
    struct entry *entries;
    size_t count, capacity;
    struct gn_ref_hit *hits;
    struct balls_counters counters;
    uint32_t forgotten[3];
    bool forgets;
};

static void number_init(struct number *n)
{
    arb_init(n->ball);
    fmpq_init(n->exact);
}

static void number_clear(struct number *n)
{
    arb_clear(n->ball);
    fmpq_clear(n->exact);
}

static struct number *fresh(struct balls *b)
{
    if (b->used == POOL)
        abort();
    return &b->pool[b->used++];
}

/* Every f64 is a dyadic rational, and a ball without radius. */
static struct number *from_double(struct balls *b, double value)
{
    struct number *out = fresh(b);
    if (b->precision) {
        arb_set_d(out->ball, value);
        return out;
    }
    int exponent;
    double mantissa = frexp(value, &exponent);
    fmpq_set_si(out->exact, (slong)ldexp(mantissa, 53), 1);
    if (exponent >= 53)
        fmpq_mul_2exp(out->exact, out->exact, (flint_bitcnt_t)(exponent - 53));
    else
        fmpq_div_2exp(out->exact, out->exact, (flint_bitcnt_t)(53 - exponent));
    return out;
}

static struct number *sum(struct balls *b, const struct number *x, const struct number *y)
{
    struct number *out = fresh(b);
    if (b->precision)
        arb_add(out->ball, x->ball, y->ball, b->precision);
    else
        fmpq_add(out->exact, x->exact, y->exact);
    return out;
}

static struct number *difference(struct balls *b, const struct number *x, const struct number *y)
{
    struct number *out = fresh(b);
    if (b->precision)
        arb_sub(out->ball, x->ball, y->ball, b->precision);
    else
        fmpq_sub(out->exact, x->exact, y->exact);
    return out;
}

static struct number *product(struct balls *b, const struct number *x, const struct number *y)
{
    struct number *out = fresh(b);
    if (b->precision)
        arb_mul(out->ball, x->ball, y->ball, b->precision);
    else
        fmpq_mul(out->exact, x->exact, y->exact);
    return out;
}

/* The divisor is known not to be 0. */
static struct number *quotient(struct balls *b, const struct number *x, const struct number *y)
{
    struct number *out = fresh(b);
    if (b->precision)
        arb_div(out->ball, x->ball, y->ball, b->precision);
    else
        fmpq_div(out->exact, x->exact, y->exact);
    return out;
}

static int sign_of(struct balls *b, const struct number *x)
{
    if (!b->precision)
        return fmpq_sgn(x->exact);
    if (arb_is_positive(x->ball))
        return 1;
    if (arb_is_negative(x->ball))
        return -1;
    if (!arb_is_zero(x->ball))
        b->undecided = true;
    return 0;
}

static int compare(struct balls *b, const struct number *x, double y)
{
    return isinf(y) ? (y > 0 ? -1 : 1) : sign_of(b, difference(b, x, from_double(b, y)));
}

/* The nearest f64, or nearly: to within 2^-50 of it or of `least`, whichever is more; else it is left undecided. */
static double rounded(struct balls *b, const struct number *x, double least)
{
    if (!b->precision) {
        arb_t ball;
        arb_init(ball);
        arb_set_fmpq(ball, x->exact, 80);
        double value = arf_get_d(arb_midref(ball), ARF_RND_NEAR);
        arb_clear(ball);
        return value;
    }
    double value = arf_get_d(arb_midref(x->ball), ARF_RND_NEAR);
    if (mag_get_d(arb_radref(x->ball)) > 0x1p-50 * fmax(fabs(value), least))
        b->undecided = true;
    return value;
}

typedef struct number *vector[3];

static void cross(struct balls *b, const vector p, const vector q, vector out)
{
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        out[i] = difference(b, product(b, p[j], q[k]), product(b, p[k], q[j]));
    }
}

static struct number *dot(struct balls *b, const vector p, const vector q)
{
    return sum(b, sum(b, product(b, p[0], q[0]), product(b, p[1], q[1])), product(b, p[2], q[2]));
}

static void less(struct balls *b, const vector p, const vector q, vector out)
{
    for (int i = 0; i < 3; i++)
        out[i] = difference(b, p[i], q[i]);
}

static void load(struct balls *b, const float from[3], vector out)
{
    for (int i = 0; i < 3; i++)
        out[i] = from_double(b, (double)from[i]);
}

static void transform(struct balls *b, const float m[12], vector p)
{
    vector out;
    for (int r = 0; r < 3; r++) {
        out[r] = from_double(b, (double)m[4 * r + 3]);
        for (int c = 0; c < 3; c++)
            out[r] = sum(b, out[r], product(b, from_double(b, (double)m[4 * r + c]), p[c]));
    }
    memcpy(p, out, sizeof out);
}

/* The matrix of cofactors, and the determinant. */
static struct number *cofactors(struct balls *b, const float m[12], vector out[3])
{
    vector rows[3];
    for (int r = 0; r < 3; r++)
        load(b, m + 4 * r, rows[r]);
    for (int r = 0; r < 3; r++)
        cross(b, rows[(r + 1) % 3], rows[(r + 2) % 3], out[r]);
    return dot(b, rows[0], out[0]);
}

static bool opacity_admits(const struct gn_ref_geometry *g, const struct gn_ref_instance *i, const struct gn_ref_ray *ray,
                           bool *out_opaque)
{
    bool opaque = g->flags & GN_REF_GEOMETRY_OPAQUE;
    if (i->flags & GN_REF_INSTANCE_FORCE_OPAQUE)
        opaque = true;
    if (i->flags & GN_REF_INSTANCE_FORCE_NO_OPAQUE)
        opaque = false;
    if (ray->flags & GN_REF_RAY_OPAQUE)
        opaque = true;
    if (ray->flags & GN_REF_RAY_NO_OPAQUE)
        opaque = false;
    *out_opaque = opaque;
    return (i->mask & ray->cull_mask & 0xFF) &&
           !(ray->flags & (opaque ? GN_REF_RAY_CULL_OPAQUE : GN_REF_RAY_CULL_NO_OPAQUE)) &&
           !(ray->flags & (g->type == GN_REF_AABBS ? GN_REF_RAY_SKIP_AABBS : GN_REF_RAY_SKIP_TRIANGLES));
}

/* By Pluecker's coordinates: on which side of each edge the ray passes. Fills hit and the t that orders. */
static bool meets_triangle(struct balls *b, const struct gn_ref_geometry *g, const struct gn_ref_instance *instance,
                           uint32_t primitive, const struct gn_ref_ray *ray, struct gn_ref_hit *hit, struct number **out_t)
{
    vector v[3], o, d, moment, edges[2], normal, at, minors[3];
    struct number *sides[3];
    int signs[3];
    for (int c = 0; c < 3; c++) {
        for (int i = 0; i < 3; i++)
            v[c][i] = quotient(b, from_double(b, g->positions[g->triangles[primitive][c]][i]), from_double(b, g->divisor));
        if (g->transform)
            transform(b, g->transform, v[c]);
        transform(b, instance->transform, v[c]);
    }
    load(b, ray->origin, o);
    load(b, ray->direction, d);
    cross(b, o, d, moment);
    for (int e = 0; e < 3; e++) {
        vector along, line;
        less(b, v[(e + 2) % 3], v[(e + 1) % 3], along);
        cross(b, v[(e + 1) % 3], v[(e + 2) % 3], line);
        sides[e] = sum(b, dot(b, d, line), dot(b, moment, along));
        signs[e] = sign_of(b, sides[e]);
    }
    if (b->undecided)
        return false;
    bool positive = signs[0] > 0 || signs[1] > 0 || signs[2] > 0, negative = signs[0] < 0 || signs[1] < 0 || signs[2] < 0;
    if (positive == negative) /* both sides, or in the plane */
        return false;
    less(b, v[1], v[0], edges[0]);
    less(b, v[2], v[0], edges[1]);
    cross(b, edges[0], edges[1], normal);
    less(b, v[0], o, at);
    struct number *facing = dot(b, normal, d);
    if (sign_of(b, facing) == 0 || b->undecided)
        return false;
    struct number *t = quotient(b, dot(b, normal, at), facing);
    if (compare(b, t, (double)ray->tmin) <= 0 || compare(b, t, (double)ray->tmax) >= 0 || b->undecided)
        return false;
    int mirrored = sign_of(b, cofactors(b, instance->transform, minors));
    if (b->undecided)
        return false;
    hit->front = (sign_of(b, facing) * mirrored < 0) != ((instance->flags & GN_REF_INSTANCE_FLIP_FACING) != 0);
    if (!(instance->flags & GN_REF_INSTANCE_FACING_CULL_DISABLE) &&
        (ray->flags & (hit->front ? GN_REF_RAY_CULL_FRONT_FACING : GN_REF_RAY_CULL_BACK_FACING)))
        return false;
    hit->t = rounded(b, t, 0);
    hit->beta = rounded(b, quotient(b, sides[1], facing), 1);
    hit->gamma = rounded(b, quotient(b, sides[2], facing), 1);
    *out_t = t;
    return true;
}

/* In object space times the determinant, plane by plane. */
static bool meets_box(struct balls *b, const struct gn_ref_geometry *g, const struct gn_ref_instance *instance,
                      uint32_t primitive, const struct gn_ref_ray *ray, struct gn_ref_hit *hit, struct number **out_t)
{
    const float *box = g->aabbs[primitive], *m = instance->transform;
    const float moved[3] = {m[3], m[7], m[11]};
    vector o, d, translation, relative, minors[3];
    struct number *entry = NULL, *leave = NULL;
    load(b, ray->origin, o);
    load(b, ray->direction, d);
    struct number *det = cofactors(b, m, minors);
    int mirrored = sign_of(b, det);
    load(b, moved, translation);
    less(b, o, translation, relative);
    for (int i = 0; i < 3; i++) {
        if (box[i] > box[i + 3])
            return false;
        /* Row i of the adjugate is column i of the cofactors. */
        const vector column = {minors[0][i], minors[1][i], minors[2][i]};
        struct number *from = dot(b, column, relative), *along = dot(b, column, d);
        struct number *low = difference(b, product(b, from_double(b, (double)box[i]), det), from);
        struct number *high = difference(b, product(b, from_double(b, (double)box[i + 3]), det), from);
        int way = sign_of(b, along);
        if (b->undecided)
            return false;
        if (way == 0) {
            if (sign_of(b, low) * mirrored > 0 || sign_of(b, high) * mirrored < 0)
                return false;
            continue;
        }
        struct number *near = quotient(b, way * mirrored > 0 ? low : high, along);
        struct number *far = quotient(b, way * mirrored > 0 ? high : low, along);
        if (!entry || sign_of(b, difference(b, near, entry)) > 0)
            entry = near;
        if (!leave || sign_of(b, difference(b, far, leave)) < 0)
            leave = far;
    }
    if (b->undecided || sign_of(b, difference(b, leave, entry)) < 0 || compare(b, leave, (double)ray->tmin) < 0 ||
        compare(b, entry, (double)ray->tmax) > 0 || b->undecided)
        return false;
    hit->t = rounded(b, entry, 0);
    hit->t_exit = rounded(b, leave, 0);
    *out_t = compare(b, entry, (double)ray->tmin) < 0 ? from_double(b, (double)ray->tmin) : entry;
    return true;
}

static bool meets(struct balls *b, const struct gn_ref_hit *what, slong precision, const struct gn_ref_ray *ray,
                  struct gn_ref_hit *hit, struct number **out_t)
{
    const struct gn_ref_instance *instance = &b->scene.instances[what->instance];
    const struct gn_ref_geometry *g = &b->scene.geometries[b->scene.blas_first[instance->blas] + what->geometry];
    b->precision = precision;
    b->undecided = false;
    b->used = 0;
    *hit = *what;
    return (g->type == GN_REF_AABBS ? meets_box : meets_triangle)(b, g, instance, what->primitive, ray, hit, out_t);
}

static void add(struct balls *b, const struct gn_ref_hit *hit, const struct number *t)
{
    if (b->count == b->capacity) {
        size_t capacity = b->capacity ? 2 * b->capacity : 64;
        b->entries = realloc(b->entries, capacity * sizeof *b->entries);
        b->hits = realloc(b->hits, capacity * sizeof *b->hits);
        if (!b->entries || !b->hits)
            abort();
        for (size_t i = b->capacity; i < capacity; i++)
            number_init(&b->entries[i].t);
        b->capacity = capacity;
    }
    struct entry *entry = &b->entries[b->count++];
    entry->hit = *hit;
    entry->is_exact = b->precision == 0;
    if (entry->is_exact)
        fmpq_set(entry->t.exact, t->exact);
    else
        arb_set(entry->t.ball, t->ball);
}

static void look_at(struct balls *b, const struct gn_ref_hit *what, const struct gn_ref_ray *ray)
{
    static const slong precisions[3] = {64, 256, 0};
    uint64_t *const counters[3] = {&b->counters.narrow, &b->counters.wide, &b->counters.rational};
    for (int level = 0; level < 3; level++) {
        struct gn_ref_hit hit;
        struct number *t;
        bool met = meets(b, what, precisions[level], ray, &hit, &t);
        if (b->undecided)
            continue;
        ++*counters[level];
        if (met)
            add(b, &hit, t);
        return;
    }
    abort();
}

static void make_exact(struct balls *b, struct entry *entry, const struct gn_ref_ray *ray)
{
    struct gn_ref_hit hit;
    struct number *t;
    if (entry->is_exact)
        return;
    if (!meets(b, &entry->hit, 0, ray, &hit, &t))
        abort(); /* a ball has said so */
    fmpq_set(entry->t.exact, t->exact);
    entry->is_exact = true;
}

static int order(struct balls *b, struct entry *x, struct entry *y, const struct gn_ref_ray *ray)
{
    int by_t = 0;
    if (!x->is_exact && !y->is_exact && !arb_overlaps(x->t.ball, y->t.ball)) {
        by_t = arb_lt(x->t.ball, y->t.ball) ? -1 : 1;
    } else {
        b->counters.orders++;
        make_exact(b, x, ray);
        make_exact(b, y, ray);
        by_t = fmpq_cmp(x->t.exact, y->t.exact);
    }
    if (by_t)
        return by_t;
    const struct gn_ref_hit *p = &x->hit, *q = &y->hit;
    return p->instance != q->instance   ? (p->instance < q->instance ? -1 : 1)
           : p->geometry != q->geometry ? (p->geometry < q->geometry ? -1 : 1)
                                        : (p->primitive < q->primitive ? -1 : 1);
}

size_t balls_trace(struct balls *b, const struct gn_ref_ray *ray, const struct gn_ref_hit **out_hits)
{
    b->count = 0;
    for (uint32_t i = 0; i < b->scene.instance_count; i++) {
        const struct gn_ref_instance *instance = &b->scene.instances[i];
        if (instance->blas == GN_REF_NULL_BLAS)
            continue;
        uint32_t first = b->scene.blas_first[instance->blas], end = b->scene.blas_first[instance->blas + 1];
        for (uint32_t g = first; g < end; g++) {
            const struct gn_ref_geometry *geometry = &b->scene.geometries[g];
            struct gn_ref_hit what = {.type = geometry->type, .instance = i, .geometry = g - first};
            if (!opacity_admits(geometry, instance, ray, &what.opaque))
                continue;
            for (what.primitive = 0; what.primitive < geometry->primitive_count; what.primitive++) {
                bool inactive = false;
                if (geometry->type == GN_REF_AABBS)
                    inactive = isnan(geometry->aabbs[what.primitive][0]);
                for (int c = 0; c < 3 && geometry->type == GN_REF_TRIANGLES; c++)
                    inactive = inactive || isnan(geometry->positions[geometry->triangles[what.primitive][c]][0]);
                bool forgotten = b->forgets && b->forgotten[0] == i && b->forgotten[1] == what.geometry &&
                                 b->forgotten[2] == what.primitive;
                if (!inactive && !forgotten)
                    look_at(b, &what, ray);
            }
        }
    }
    /* By insertion: there are few. */
    for (size_t i = 1; i < b->count; i++)
        for (size_t k = i; k > 0 && order(b, &b->entries[k - 1], &b->entries[k], ray) > 0; k--) {
            struct entry swapped = b->entries[k];
            b->entries[k] = b->entries[k - 1];
            b->entries[k - 1] = swapped;
        }
    for (size_t i = 0; i < b->count; i++)
        b->hits[i] = b->entries[i].hit;
    *out_hits = b->hits;
    return b->count;
}

struct balls *balls_create(const struct oracle_scene *scene)
{
    struct balls *b = calloc(1, sizeof *b);
    if (!b)
        abort();
    b->scene = *scene;
    for (int i = 0; i < POOL; i++)
        number_init(&b->pool[i]);
    return b;
}

void balls_destroy(struct balls *b)
{
    if (!b)
        return;
    for (int i = 0; i < POOL; i++)
        number_clear(&b->pool[i]);
    for (size_t i = 0; i < b->capacity; i++)
        number_clear(&b->entries[i].t);
    free(b->entries);
    free(b->hits);
    free(b);
}

struct balls_counters balls_counters(const struct balls *b)
{
    return b->counters;
}

void balls_forget(struct balls *b, uint32_t instance, uint32_t geometry, uint32_t primitive)
{
    b->forgets = true;
    b->forgotten[0] = instance;
    b->forgotten[1] = geometry;
    b->forgotten[2] = primitive;
}
