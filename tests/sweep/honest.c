/* SPDX-License-Identifier: Apache-2.0 */
/*
 * An f32 implementation without tricks: the inverse by cofactors, the ray to object space, the watertight triangle
 * test of Woop, Benthin and Wald (2013), the slab test widened by a few units. Every operation rounds once.
 */
#include "tests/sweep/honest.h"

#include <math.h>
#include <string.h>

static void inverse(const float m[12], float out[9])
{
    float cofactor[9];
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            int r0 = (r + 1) % 3, r1 = (r + 2) % 3, c0 = (c + 1) % 3, c1 = (c + 2) % 3;
            cofactor[3 * r + c] = m[4 * r0 + c0] * m[4 * r1 + c1] - m[4 * r0 + c1] * m[4 * r1 + c0];
        }
    float det = m[0] * cofactor[0] + m[1] * cofactor[1] + m[2] * cofactor[2];
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            out[3 * r + c] = cofactor[3 * c + r] / det;
}

static void multiply(const float m[9], const float v[3], float out[3])
{
    for (int r = 0; r < 3; r++)
        out[r] = m[3 * r] * v[0] + m[3 * r + 1] * v[1] + m[3 * r + 2] * v[2];
}

static void vertex(const struct gn_cts_geometry *geometry, uint32_t index, float out[3])
{
    const double *p = geometry->positions[index];
    float v[3] = {(float)p[0], (float)p[1], (float)p[2]};
    const float *g = geometry->transform;
    for (int r = 0; r < 3; r++)
        out[r] = g ? g[4 * r] * v[0] + g[4 * r + 1] * v[1] + g[4 * r + 2] * v[2] + g[4 * r + 3] : v[r];
}

struct object_ray {
    struct honest_faults faults;
    bool mirrored;
    float origin[3], direction[3], shear[3];
    int kx, ky, kz;
    float tmin, tmax;
    uint32_t flags;
};

static void object_ray(const struct gn_ref_ray *ray, const struct gn_cts_instance *instance, const float back[9],
                       struct object_ray *out)
{
    float moved[3];
    for (int i = 0; i < 3; i++)
        moved[i] = ray->origin[i] - instance->transform[4 * i + 3];
    multiply(back, moved, out->origin);
    multiply(back, ray->direction, out->direction);
    const float *d = out->direction;
    out->kz = 0;
    for (int i = 1; i < 3; i++)
        if (fabsf(d[i]) > fabsf(d[out->kz]))
            out->kz = i;
    out->kx = (out->kz + 1) % 3;
    out->ky = (out->kz + 2) % 3;
    if (d[out->kz] < 0) {
        int swap = out->kx;
        out->kx = out->ky;
        out->ky = swap;
    }
    out->shear[0] = d[out->kx] / d[out->kz];
    out->shear[1] = d[out->ky] / d[out->kz];
    out->shear[2] = 1 / d[out->kz];
    out->tmin = ray->tmin;
    out->tmax = ray->tmax;
    out->flags = ray->flags;
}

static bool triangle(const struct object_ray *ray, float corner[3][3], struct gn_ref_answer *out)
{
    float x[3], y[3], z[3], edge[3];
    for (int c = 0; c < 3; c++) {
        float relative[3];
        for (int i = 0; i < 3; i++)
            relative[i] = corner[c][i] - ray->origin[i];
        x[c] = relative[ray->kx] - ray->shear[0] * relative[ray->kz];
        y[c] = relative[ray->ky] - ray->shear[1] * relative[ray->kz];
        z[c] = ray->shear[2] * relative[ray->kz];
    }
    for (int c = 0; c < 3; c++) {
        int n = (c + 1) % 3, p = (c + 2) % 3;
        edge[c] = x[p] * y[n] - y[p] * x[n];
    }
    if (edge[0] == 0 || edge[1] == 0 || edge[2] == 0)
        for (int c = 0; c < 3; c++) {
            int n = (c + 1) % 3, p = (c + 2) % 3;
            edge[c] = (float)((double)x[p] * (double)y[n] - (double)y[p] * (double)x[n]);
        }
    if ((edge[0] < 0 || edge[1] < 0 || edge[2] < 0) && (edge[0] > 0 || edge[1] > 0 || edge[2] > 0))
        return false;
    float det = edge[0] + edge[1] + edge[2];
    if (det == 0 || fabsf(det) < ray->faults.det_epsilon)
        return false;
    float t = (edge[0] * z[0] + edge[1] * z[1] + edge[2] * z[2]) / det;
    bool front = (det > 0) != (ray->faults.world_facing && ray->mirrored);
    if (!(t > ray->tmin + ray->faults.t_epsilon && t < ray->tmax) || (front && ray->flags & GN_REF_RAY_CULL_FRONT_FACING) ||
        (!front && ray->flags & GN_REF_RAY_CULL_BACK_FACING))
        return false;
    out->kind = GN_REF_ANSWER_TRIANGLE;
    out->t = t;
    out->barycentrics[0] = edge[1] / det;
    out->barycentrics[1] = edge[2] / det;
    out->front = front;
    return true;
}

static bool box_met(const struct object_ray *ray, const float box[6])
{
    float enter = ray->tmin, leave = ray->tmax;
    for (int i = 0; i < 3; i++) {
        if (ray->direction[i] == 0 && !ray->faults.no_zeros) {
            if (ray->origin[i] < box[i] || ray->origin[i] > box[i + 3])
                return false;
            continue;
        }
        float a = (box[i] - ray->origin[i]) / ray->direction[i], b = (box[i + 3] - ray->origin[i]) / ray->direction[i];
        bool turned = ray->faults.no_zeros ? ray->direction[i] < 0 : a > b;
        float low = turned ? b : a, high = turned ? a : b;
        enter = fmaxf(enter, low * (low > 0 ? 0.9999995f : 1.0000005f));
        leave = fminf(leave, high * (high > 0 ? 1.0000005f : 0.9999995f));
    }
    return enter <= leave;
}

static void answer_ray(const struct gn_sweep_scene *sweep, const float (*inverses)[9], float (*const *vertices)[3],
                       const struct honest_faults *faults, uint32_t ray_index, struct gn_cts_answers *answers)
{
    const struct gn_cts_scene *scene = &sweep->scene;
    struct gn_ref_answer *best = &answers->committed[ray_index];
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct gn_cts_instance *instance = &scene->instances[i];
        const struct gn_cts_geometry *geometry = &scene->blases[instance->blas].geometries[0];
        struct object_ray ray;
        if (!(instance->mask & sweep->rays[ray_index].ray.cull_mask) ||
            (faults->most_instances && i >= faults->most_instances))
            continue;
        object_ray(&sweep->rays[ray_index].ray, instance, inverses[i], &ray);
        const float *m = instance->transform;
        ray.faults = *faults;
        ray.mirrored = m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
                           m[2] * (m[4] * m[9] - m[5] * m[8]) < 0;
        if (best->kind != GN_REF_ANSWER_NONE)
            ray.tmax = best->t;
        struct gn_ref_answer hit = {
            .instance = i, .custom_index = instance->custom_index, .sbt_offset = instance->sbt_offset};
        for (uint32_t p = 0; geometry->type == GN_REF_TRIANGLES && p < geometry->triangle_count; p++) {
            float corner[3][3];
            for (int c = 0; c < 3; c++)
                memcpy(corner[c], vertices[instance->blas][geometry->triangles[p][c]], sizeof corner[c]);
            hit.primitive = p;
            if (triangle(&ray, corner, &hit)) {
                *best = hit;
                ray.tmax = hit.t;
            }
        }
        for (uint32_t p = 0; geometry->type == GN_REF_AABBS && p < geometry->aabb_count; p++) {
            struct gn_cts_candidates *candidates = &answers->candidates[ray_index];
            if (!box_met(&ray, geometry->aabbs[p]))
                continue;
            hit.primitive = p;
            hit.kind = GN_REF_ANSWER_GENERATED;
            if (candidates->count < GN_CTS_MAX_CANDIDATES)
                candidates->list[candidates->count] = hit;
            candidates->count++;
        }
    }
}

/* What a query says of the committed hit. */
static void detail(const struct gn_sweep_scene *sweep, const float (*inverses)[9], uint32_t ray_index,
                   const struct gn_ref_answer *answer, struct gn_cts_detail *out)
{
    const struct gn_ref_ray *ray = &sweep->rays[ray_index].ray;
    memcpy(out->world_origin, ray->origin, sizeof out->world_origin);
    memcpy(out->world_direction, ray->direction, sizeof out->world_direction);
    out->tmin = ray->tmin;
    out->flags = ray->flags;
    if (answer->kind == GN_REF_ANSWER_NONE)
        return;
    const struct gn_cts_instance *instance = &sweep->scene.instances[answer->instance];
    const float *back = inverses[answer->instance];
    struct object_ray object;
    object_ray(ray, instance, back, &object);
    memcpy(out->world_from_object, instance->transform, sizeof out->world_from_object);
    memcpy(out->object_origin, object.origin, sizeof out->object_origin);
    memcpy(out->object_direction, object.direction, sizeof out->object_direction);
    for (int r = 0; r < 3; r++) {
        float translation = 0;
        for (int c = 0; c < 3; c++) {
            out->object_from_world[4 * r + c] = back[3 * r + c];
            translation += back[3 * r + c] * instance->transform[4 * c + 3];
        }
        out->object_from_world[4 * r + 3] = -translation;
    }
}

void honest_tracer(struct gn_case_run *run, const struct gn_sweep_scene *sweep, void *user)
{
    const struct gn_cts_scene *scene = &sweep->scene;
    struct gn_arena arena = {0};
    struct gn_cts_answers answers = {0};
    static const struct honest_faults none;
    const struct honest_faults *faults = user ? user : &none;
    answers.committed = GN_NEW(&arena, struct gn_ref_answer, sweep->ray_count);
    if (sweep->program == GN_CTS_CANDIDATES)
        answers.candidates = GN_NEW(&arena, struct gn_cts_candidates, sweep->ray_count);
    float(*inverses)[9] = gn_arena_alloc(&arena, scene->instance_count, sizeof *inverses);
    float(**vertices)[3] = gn_arena_alloc(&arena, scene->blas_count, sizeof *vertices);
    for (uint32_t i = 0; i < scene->instance_count; i++)
        inverse(scene->instances[i].transform, inverses[i]);
    for (uint32_t b = 0; b < scene->blas_count; b++) {
        const struct gn_cts_geometry *geometry = &scene->blases[b].geometries[0];
        vertices[b] = gn_arena_alloc(&arena, geometry->position_count + 1, sizeof *vertices[b]);
        for (uint32_t v = 0; v < geometry->position_count; v++)
            vertex(geometry, v, vertices[b][v]);
    }
    if (sweep->program == GN_CTS_DETAIL)
        answers.details = GN_NEW(&arena, struct gn_cts_detail, sweep->ray_count);
    if (sweep->program == GN_CTS_POSITIONS)
        answers.positions = gn_arena_alloc(&arena, sweep->ray_count, sizeof *answers.positions);
    for (uint32_t r = 0; r < sweep->ray_count; r++) {
        const struct gn_ref_answer *answer = &answers.committed[r];
        answer_ray(sweep, (const float(*)[9])inverses, vertices, faults, r, &answers);
        if (answers.details)
            detail(sweep, (const float(*)[9])inverses, r, answer, &answers.details[r]);
        if (answers.positions && answer->kind == GN_REF_ANSWER_TRIANGLE) {
            const uint32_t blas = scene->instances[answer->instance].blas;
            for (int c = 0; c < 3; c++)
                memcpy(answers.positions[r] + 3 * c,
                       vertices[blas][scene->blases[blas].geometries[0].triangles[answer->primitive][c]],
                       3 * sizeof(float));
        }
    }
    gn_case_judge(run, scene, sweep->program, sweep->rays, sweep->ray_count, 0, &answers);
    gn_arena_finish(&arena);
}
