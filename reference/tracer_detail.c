/* SPDX-License-Identifier: Apache-2.0 */
/* What a shader can ask for beside the hit: transforms, the object-space ray, vertices, in rational numbers. */
#include <math.h>
#include <string.h>

#include "reference/tracer_internal.h"

/* A 3 x 4 matrix of rationals, and room for sums. */
struct rationals {
    mpq_t matrix[12], inverse[12], point[3], image[3], product, determinant;
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

static void get(double out[3], mpq_t *values)
{
    for (int i = 0; i < 3; i++)
        out[i] = mpq_get_d(values[i]);
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

    memcpy(out->world_from_object, instance->transform, sizeof out->world_from_object);
    set_matrix(r.matrix, instance->transform);
    invert(&r);
    for (int i = 0; i < 12; i++)
        out->object_from_world[i] = mpq_get_d(r.inverse[i]);
    for (int i = 0; i < 3; i++)
        mpq_set_d(r.point[i], ray->origin[i]);
    transform(&r, r.inverse, true);
    get(out->object_origin, r.image);
    for (int i = 0; i < 3; i++)
        mpq_set_d(r.point[i], ray->direction[i]);
    transform(&r, r.inverse, false);
    get(out->object_direction, r.image);

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
        get(out->object_vertices[v], r.point);
        transform(&r, r.matrix, true);
        get(out->world_vertices[v], r.image);
    }

    each_clear(r.matrix, 12);
    each_clear(r.inverse, 12);
    each_clear(r.point, 3);
    each_clear(r.image, 3);
    mpq_clear(r.product);
    mpq_clear(r.determinant);
    gn_ref_environment_leave(&environment);
    return true;
}
