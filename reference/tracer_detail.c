/* SPDX-License-Identifier: Apache-2.0 */
/* Exact numbers of a hit: its own, and what a shader can ask for beside it (transforms, the object-space ray, vertices). */
#include <math.h>
#include <string.h>

#include "reference/tracer_internal.h"

/* A 3 x 4 matrix of rationals, and room for sums. */
struct rationals {
    mpq_t matrix[12], inverse[12], point[3], image[3], product, determinant;
    mpz_t scratch[3];
};

static void each_init(mpq_t *items, int count)
{
    for (int i = 0; i < count; i++)
        mpq_init(items[i]);
}

static void each_clear(mpq_t *items, int count)
{
    for (int i = 0; i < count; i++)
        mpq_clear(items[i]);
}

static void set_matrix(mpq_t *out, const float transform[12])
{
    for (int i = 0; i < 12; i++)
        mpq_set_d(out[i], transform[i]);
}

/* image = matrix point, with the translation or without. */
static void transform(struct rationals *r, mpq_t *matrix, bool translated)
{
    for (int row = 0; row < 3; row++) {
        if (translated)
            mpq_set(r->image[row], matrix[4 * row + 3]);
        else
            mpq_set_ui(r->image[row], 0, 1);
        for (int column = 0; column < 3; column++) {
            mpq_mul(r->product, matrix[4 * row + column], r->point[column]);
            mpq_add(r->image[row], r->image[row], r->product);
        }
    }
}

/* By cofactors; the matrix is regular. */
static void invert(struct rationals *r)
{
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 3; column++) {
            int r1 = (column + 1) % 3, r2 = (column + 2) % 3, c1 = (row + 1) % 3, c2 = (row + 2) % 3;
            mpq_mul(r->inverse[4 * row + column], r->matrix[4 * r1 + c1], r->matrix[4 * r2 + c2]);
            mpq_mul(r->product, r->matrix[4 * r1 + c2], r->matrix[4 * r2 + c1]);
            mpq_sub(r->inverse[4 * row + column], r->inverse[4 * row + column], r->product);
        }
    mpq_set_ui(r->determinant, 0, 1);
    for (int column = 0; column < 3; column++) {
        mpq_mul(r->product, r->inverse[column], r->matrix[4 * column]);
        mpq_add(r->determinant, r->determinant, r->product);
    }
    for (int row = 0; row < 3; row++) {
        mpq_set_ui(r->inverse[4 * row + 3], 0, 1);
        for (int column = 0; column < 3; column++) {
            mpq_div(r->inverse[4 * row + column], r->inverse[4 * row + column], r->determinant);
            mpq_mul(r->product, r->inverse[4 * row + column], r->matrix[4 * column + 3]);
            mpq_sub(r->inverse[4 * row + 3], r->inverse[4 * row + 3], r->product);
        }
    }
}

static void get(double *out, struct rationals *r, mpq_t *values, int count)
{
    for (int i = 0; i < count; i++)
        out[i] = gn_ref_quotient_f64(r->scratch, mpq_numref(values[i]), mpq_denref(values[i]), 0);
}

static bool active(const struct gn_ref_scene *scene, const struct gn_ref_hit *hit)
{
    if (hit->instance >= scene->instance_count || scene->instances[hit->instance].blas == GN_REF_NULL_BLAS)
        return false;
    const struct gn_ref_blas *blas = &scene->blases[scene->instances[hit->instance].blas];
    if (hit->geometry >= blas->geometry_count || hit->primitive >= blas->geometries[hit->geometry].primitive_count)
        return false;
    const struct gn_ref_geometry *geometry = &blas->geometries[hit->geometry];
    if (geometry->type == GN_REF_AABBS)
        return !isnan(geometry->aabbs[hit->primitive][0]);
    for (int v = 0; v < 3; v++)
        if (isnan(geometry->positions[geometry->triangles[hit->primitive][v]][0]))
            return false;
    return true;
}

bool gn_ref_hit_detail_exact(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray,
                             const struct gn_ref_hit *hit, struct gn_ref_hit_detail *out)
{
    struct rationals r;
    struct gn_ref_environment environment;
    if (!scene->committed || !gn_ref_tracer_ray_valid(ray) || !active(scene, hit))
        return false;
    const struct gn_ref_instance *instance = &scene->instances[hit->instance];
    const struct gn_ref_geometry *geometry = &scene->blases[instance->blas].geometries[hit->geometry];
    gn_ref_environment_enter(&environment);
    memset(out, 0, sizeof *out);
    each_init(r.matrix, 12);
    each_init(r.inverse, 12);
    each_init(r.point, 3);
    each_init(r.image, 3);
    mpq_init(r.product);
    mpq_init(r.determinant);
    for (int i = 0; i < 3; i++)
        mpz_init(r.scratch[i]);

    memcpy(out->world_from_object, instance->transform, sizeof out->world_from_object);
    set_matrix(r.matrix, instance->transform);
    invert(&r);
    get(out->object_from_world, &r, r.inverse, 12);
    for (int i = 0; i < 3; i++)
        mpq_set_d(r.point[i], ray->origin[i]);
    transform(&r, r.inverse, true);
    get(out->object_origin, &r, r.image, 3);
    for (int i = 0; i < 3; i++)
        mpq_set_d(r.point[i], ray->direction[i]);
    transform(&r, r.inverse, false);
    get(out->object_direction, &r, r.image, 3);

    for (int v = 0; geometry->type == GN_REF_TRIANGLES && v < 3; v++) {
        const double *position = geometry->positions[geometry->triangles[hit->primitive][v]];
        mpq_set_d(r.determinant, geometry->divisor);
        for (int i = 0; i < 3; i++) {
            mpq_set_d(r.point[i], position[i]);
            mpq_div(r.point[i], r.point[i], r.determinant);
        }
        if (geometry->transform) {
            set_matrix(r.inverse, geometry->transform);
            transform(&r, r.inverse, true);
            for (int i = 0; i < 3; i++)
                mpq_swap(r.point[i], r.image[i]);
        }
        get(out->object_vertices[v], &r, r.point, 3);
        transform(&r, r.matrix, true);
        get(out->world_vertices[v], &r, r.image, 3);
    }

    each_clear(r.matrix, 12);
    each_clear(r.inverse, 12);
    each_clear(r.point, 3);
    each_clear(r.image, 3);
    mpq_clear(r.product);
    mpq_clear(r.determinant);
    for (int i = 0; i < 3; i++)
        mpz_clear(r.scratch[i]);
    gn_ref_environment_leave(&environment);
    return true;
}

bool gn_ref_hit_refine_exact(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray, struct gn_ref_hit *hit)
{
    struct gn_ref_exact exact;
    struct gn_ref_environment environment;
    if (!scene->committed || !gn_ref_tracer_ray_valid(ray) || !active(scene, hit))
        return false;
    const struct gn_ref_primitive primitive = {hit->instance, hit->geometry, hit->primitive};
    const struct gn_ref_blas *blas = &scene->blases[scene->instances[hit->instance].blas];
    bool triangle = blas->geometries[hit->geometry].type == GN_REF_TRIANGLES;
    gn_ref_environment_enter(&environment);
    gn_ref_exact_init(&exact);
    bool met = triangle ? gn_ref_triangle_exact(&exact, scene, &primitive, ray).sum != 0
                        : gn_ref_box_exact(&exact, scene, &primitive, ray);
    if (met) {
        hit->t = gn_ref_ratio_f64(&exact, &exact.t);
        hit->t_exit = triangle ? hit->t : gn_ref_ratio_f64(&exact, &exact.t_exit);
        hit->beta = triangle ? gn_ref_exact_barycentric(&exact, 1) : 0;
        hit->gamma = triangle ? gn_ref_exact_barycentric(&exact, 2) : 0;
        gn_ref_hit_set_rounding_errors(hit, triangle);
    }
    gn_ref_exact_finish(&exact);
    gn_ref_environment_leave(&environment);
    return met;
}
