/* SPDX-License-Identifier: Apache-2.0 */
/* Scenes put together from several parts, and rays aimed at any part of them. */
#include "cts/compose.h"

#include <math.h>
#include <string.h>

/* What the rays of a scene can be aimed at. */
struct target {
    const struct gn_cts_instance *instance;
    const struct gn_cts_geometry *geometry;
    const double (*positions)[3];
    double divisor;
    uint32_t primitive_count;
};

/* The tables of cases give their rays in proportion to each other; a run of scale 1 takes two minutes with so many. */
#define BASE_FACTOR 3

uint32_t gn_ray_count(const struct gn_case_run *run, uint32_t base)
{
    double count = (double)base * BASE_FACTOR * run->scale;
    return count < 1 ? 1 : count > 1e8 ? 100000000u : (uint32_t)count;
}

static struct gn_cts_ray ray_make(const double origin[3], const double direction[3])
{
    struct gn_cts_ray ray = gn_ray_make(origin, direction, 1000);
    ray.policy = (struct gn_ref_policy){.confirm_mask = UINT32_MAX};
    return ray;
}

void gn_instance_place(struct gn_cts_instance *instance, double x, double y, double z)
{
    instance->transform[3] = (float)x;
    instance->transform[7] = (float)y;
    instance->transform[11] = (float)z;
}

void gn_transform_scale(double sx, double sy, double sz, double x, double y, double z, float out[12])
{
    const float transform[12] = {(float)sx, 0,        0, (float)x, 0,         (float)sy,
                                 0,         (float)y, 0, 0,        (float)sz, (float)z};
    memcpy(out, transform, sizeof transform);
}

struct gn_cts_scene gn_scene_make(const struct gn_cts_blas *blases, uint32_t blas_count,
                                  const struct gn_cts_instance *instances, uint32_t instance_count)
{
    struct gn_cts_scene scene = {
        .blases = blases, .blas_count = blas_count, .instances = instances, .instance_count = instance_count};
    return scene;
}

struct gn_cts_scene gn_scene_placed(struct gn_case_run *run, const struct gn_cts_geometry *geometries,
                                    uint32_t geometry_count)
{
    struct gn_cts_blas *blas = GN_NEW(&run->arena, struct gn_cts_blas, 1);
    blas->geometries = geometries;
    blas->geometry_count = geometry_count;
    struct gn_cts_instance *instance = GN_NEW(&run->arena, struct gn_cts_instance, 1);
    *instance = gn_instance_of(0, NULL);
    gn_transform_random(&run->random, 0.75, 1.5, 1, false, instance->transform);
    instance->custom_index = gn_random_below(&run->random, 1u << 24);
    return gn_scene_make(blas, 1, instance, 1);
}

static void random_direction(struct gn_random *random, double out[3])
{
    double length;
    do {
        length = 0;
        for (int i = 0; i < 3; i++) {
            out[i] = gn_random_range(random, -1, 1);
            length += out[i] * out[i];
        }
    } while (length > 1 || length < 0.01);
    for (int i = 0; i < 3; i++)
        out[i] /= sqrt(length);
}

static uint32_t geometry_primitive_count(const struct gn_cts_geometry *geometry)
{
    return geometry->type == GN_REF_TRIANGLES ? geometry->triangle_count : geometry->aabb_count;
}

static struct target *targets_make(struct gn_case_run *run, const struct gn_cts_scene *scene,
                                   uint32_t *out_count)
{
    uint32_t capacity = 0, count = 0;
    for (uint32_t i = 0; i < scene->instance_count; i++)
        if (scene->instances[i].blas != GN_CTS_NO_BLAS)
            capacity += scene->blases[scene->instances[i].blas].geometry_count;
    struct target *targets = GN_NEW(&run->arena, struct target, capacity + 1);
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct gn_cts_instance *instance = &scene->instances[i];
        if (instance->blas == GN_CTS_NO_BLAS)
            continue;
        const struct gn_cts_blas *blas = &scene->blases[instance->blas];
        for (uint32_t g = 0; g < blas->geometry_count; g++) {
            const struct gn_cts_geometry *geometry = &blas->geometries[g];
            struct target target = {instance, geometry, NULL, 1, geometry_primitive_count(geometry)};
            if (target.primitive_count == 0)
                continue;
            for (uint32_t j = 0; j < count && !target.positions; j++)
                if (targets[j].geometry == geometry) {
                    target.positions = targets[j].positions;
                    target.divisor = targets[j].divisor;
                }
            if (geometry->type == GN_REF_TRIANGLES && !target.positions &&
                !gn_geometry_decoded_positions(geometry, &run->arena, &target.positions, &target.divisor))
                continue;
            targets[count++] = target;
        }
    }
    *out_count = count;
    return targets;
}

/* A point inside the primitive and the direction its front looks at, in world space; false if inactive or
 * without area. */
static bool target_point(struct gn_random *random, const struct target *target, uint32_t primitive,
                         double out[3], double out_normal[3])
{
    if (target->geometry->type == GN_REF_AABBS) {
        const float *box = target->geometry->aabbs[primitive];
        if (isnan(box[0]))
            return false;
        double inside[3];
        for (int i = 0; i < 3; i++)
            inside[i] = box[i] + ((double)box[i + 3] - box[i]) * gn_random_range(random, 0.1, 0.9);
        gn_transform_point(target->instance->transform, inside, out);
        random_direction(random, out_normal);
        return true;
    }
    double corner[3][3], weight[3], sum = 0;
    for (int c = 0; c < 3; c++) {
        const double *position = target->positions[target->geometry->triangles[primitive][c]];
        if (isnan(position[0]))
            return false;
        double local[3], object[3];
        for (int i = 0; i < 3; i++)
            object[i] = local[i] = position[i] / target->divisor;
        if (target->geometry->transform)
            gn_transform_point(target->geometry->transform, local, object);
        gn_transform_point(target->instance->transform, object, corner[c]);
        sum += weight[c] = gn_random_range(random, 0.05, 1);
    }
    double e[3], f[3], length = 0, size = 0;
    for (int i = 0; i < 3; i++) {
        out[i] = (weight[0] * corner[0][i] + weight[1] * corner[1][i] + weight[2] * corner[2][i]) / sum;
        e[i] = corner[1][i] - corner[0][i];
        f[i] = corner[2][i] - corner[0][i];
        size += e[i] * e[i] + f[i] * f[i];
    }
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        out_normal[i] = e[j] * f[k] - e[k] * f[j];
        length += out_normal[i] * out_normal[i];
    }
    length = sqrt(length);
    if (!(length > 1e-9 * size))
        return false;
    for (int i = 0; i < 3; i++)
        out_normal[i] /= length;
    return true;
}

void gn_rays_at_scene(struct gn_case_run *run, const struct gn_cts_scene *scene, double distance,
                      bool both_sides, struct gn_cts_ray *rays, uint32_t count)
{
    struct gn_random *random = &run->random;
    uint32_t target_count;
    struct target *targets = targets_make(run, scene, &target_count);
    for (uint32_t i = 0; i < count; i++) {
        double point[3] = {0, 0, 0}, normal[3] = {0, 0, 1}, toward[3], origin[3], direction[3];
        bool aimed = false;
        for (int attempt = 0; attempt < 256 && target_count > 0 && !aimed; attempt++) {
            const struct target *target = &targets[gn_random_below(random, target_count)];
            uint32_t primitive = 0, choice = gn_random_below(random, 8);
            if (choice == 1)
                primitive = target->primitive_count - 1;
            else if (choice > 1)
                primitive = gn_random_below(random, target->primitive_count);
            aimed = target_point(random, target, primitive, point, normal);
        }
        /* Nothing that could be aimed at: what was tried last may have left no direction. */
        for (int a = 0; a < 3 && !aimed; a++) {
            point[a] = 0;
            normal[a] = a == 2;
        }
        double cosine;
        do {
            random_direction(random, toward);
            cosine = toward[0] * normal[0] + toward[1] * normal[1] + toward[2] * normal[2];
        } while (fabs(cosine) < 0.18);
        bool front = !both_sides || gn_random_below(random, 2) == 0;
        double sign = (cosine > 0) == front ? 1 : -1;
        double away = distance * gn_random_range(random, 0.5, 1.5);
        double scale = gn_random_below(random, 2) ? 1 : ldexp(1, (int)gn_random_below(random, 7) - 3);
        for (int a = 0; a < 3; a++) {
            origin[a] = point[a] + sign * away * toward[a];
            direction[a] = -sign * toward[a] * scale;
        }
        rays[i] = ray_make(origin, direction);
    }
}

void gn_rays_through(struct gn_random *random, double bottom, double top, double half_width,
                     struct gn_cts_ray *rays, uint32_t count)
{
    double height = top - bottom + 2;
    for (uint32_t i = 0; i < count; i++) {
        double enter[2], leave[2], most = height / 4;
        for (int a = 0; a < 2; a++) {
            enter[a] = gn_random_range(random, -half_width, half_width);
            do {
                leave[a] = enter[a] + gn_random_range(random, -most, most);
            } while (fabs(leave[a]) > half_width);
        }
        bool up = gn_random_below(random, 2);
        double origin[3] = {enter[0], enter[1], up ? bottom - 1 : top + 1};
        double direction[3] = {(leave[0] - enter[0]) / height, (leave[1] - enter[1]) / height, up ? 1 : -1};
        rays[i] = ray_make(origin, direction);
    }
}

const float (*gn_ladder_make(struct gn_arena *arena, struct gn_random *random, uint32_t rungs,
                             double thickness))[6]
{
    float(*boxes)[6] = gn_arena_alloc(arena, rungs, sizeof *boxes);
    for (uint32_t i = 0; i < rungs; i++) {
        for (int a = 0; a < 2; a++) {
            double centre = gn_random_range(random, -1, 1), half = gn_random_range(random, 0.3, 1);
            boxes[i][a] = (float)(centre - half);
            boxes[i][a + 3] = (float)(centre + half);
        }
        boxes[i][2] = (float)(i - thickness / 2);
        boxes[i][5] = (float)(i + thickness / 2);
    }
    return (const float(*)[6])boxes;
}

void gn_ladder_rays(struct gn_random *random, const float (*boxes)[6], uint32_t rungs, bool random_wanted,
                    struct gn_cts_ray *rays, uint32_t count)
{
    gn_rays_through(random, 0, rungs - 1, 1.5, rays, count);
    for (uint32_t i = 0; i < count; i++) {
        struct gn_ref_ray *ray = &rays[i].ray;
        struct gn_ref_policy *policy = &rays[i].policy;
        uint32_t wanted = random_wanted ? (uint32_t)gn_random_u64(random) : UINT32_MAX;
        policy->generate_step = 1 / ray->direction[2];
        policy->generate_t0 = -ray->origin[2] / ray->direction[2];
        for (uint32_t p = 0; p < rungs; p++) {
            double t = policy->generate_t0 + policy->generate_step * (double)p;
            bool clear = boxes[p][0] == boxes[p][0];
            for (int a = 0; a < 2 && clear; a++) {
                double at = ray->origin[a] + t * ray->direction[a];
                clear = at > boxes[p][a] + 1e-3 && at < boxes[p][a + 3] - 1e-3;
            }
            if (clear && (wanted >> p & 1))
                policy->generate_mask |= 1u << p;
        }
    }
}

struct gn_mesh gn_mesh_flat(struct gn_arena *arena, struct gn_random *random, uint32_t n)
{
    struct gn_mesh mesh = gn_mesh_height_field(arena, random, n, 0);
    for (uint32_t i = 0; i < mesh.position_count; i++) {
        double *p = mesh.positions[i];
        bool border = fabs(p[0]) > 0.999 || fabs(p[1]) > 0.999;
        for (int a = 0; a < 2 && !border; a++)
            p[a] = (float)(p[a] + gn_random_range(random, -0.3, 0.3) * 2 / n);
        p[2] = 0;
    }
    return mesh;
}

const double (*gn_mesh_moved(struct gn_arena *arena, struct gn_random *random, const struct gn_mesh *mesh,
                             double amount))[3]
{
    double(*positions)[3] = gn_arena_alloc(arena, mesh->position_count, sizeof *positions);
    for (uint32_t i = 0; i < mesh->position_count; i++)
        for (int a = 0; a < 3; a++)
            positions[i][a] = (float)(mesh->positions[i][a] + gn_random_range(random, -amount, amount));
    return (const double(*)[3])positions;
}
