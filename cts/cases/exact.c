/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Scenes in which no operation rounds: an answer other than the ideal one has no excuse there, however small the margin.
 *
 * Coordinates are small multiples of 1/32, transforms the identity, rays run along an axis and determinants are powers
 * of two. Everything a test may compute on its way (differences, products, reciprocals, quotients) is an f32 number.
 */
#include "cts/compose.h"

#include <math.h>

enum { LAYERS = 16 };

enum end { TMIN, TMAX };

struct params {
    enum end end;
    bool candidates;
    bool tilted; /* so that the boxes around the triangles do not end where these are met */
};

#define SPEC_OPEN                                                                                            \
    "triangles are met where tmin < t < tmax, the ends excluded (Vulkan: Ray Intersection Candidate "        \
    "Determination)"
#define SPEC_BOX                                                                                             \
    "a ray that meets a box within its range has it among its candidates, flat ones as well (Vulkan: Ray "   \
    "Intersection Candidate Determination)"

/* What the bound would forgive counts as wrong. */
static void demand_ideal(struct gn_case_run *run)
{
    const uint64_t *counts = run->result.class_counts;
    if (counts[GN_REF_ADMISSIBLE] + counts[GN_REF_GAP] > 0)
        gn_case_fail(run,
                     "%llu of %llu rays are answered as if something had been rounded, although every number on the way is "
                     "exact in f32",
                     (unsigned long long)(counts[GN_REF_ADMISSIBLE] + counts[GN_REF_GAP]),
                     (unsigned long long)run->result.rays);
}

/* A value some steps to either side, or itself. */
static float near_to(struct gn_random *random, float value)
{
    uint32_t steps = gn_random_below(random, 3) ? gn_random_below(random, 4) : 0;
    bool up = gn_random_below(random, 2);
    for (uint32_t i = 0; i < steps; i++)
        value = nextafterf(value, up ? INFINITY : 0);
    return value;
}

static struct gn_cts_ray axis_ray(struct gn_random *random, double x, double y, double z, double t)
{
    const int exponent = (int)gn_random_below(random, 7) - 3;
    const double way = gn_random_below(random, 2) ? 1 : -1;
    const double origin[3] = {x, y, z - way * t}, direction[3] = {0, 0, ldexp(way, exponent)};
    struct gn_cts_ray ray = gn_ray_make(origin, direction, 1000);
    ray.policy = (struct gn_ref_policy){.confirm_mask = UINT32_MAX};
    ray.ray.tmin = ray.ray.tmax = (float)ldexp(t, -exponent);
    return ray;
}

static void triangles(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    struct gn_random *random = &run->random;
    double(*corners)[3] = gn_arena_alloc(&run->arena, 6 * LAYERS, sizeof *corners);
    uint32_t(*indices)[3] = gn_arena_alloc(&run->arena, 2 * LAYERS, sizeof *indices);
    static const double square[6][2] = {{-4, -4}, {4, -4}, {4, 4}, {-4, -4}, {4, 4}, {-4, 4}};
    for (uint32_t i = 0; i < 6 * LAYERS; i++) {
        corners[i][0] = square[i % 6][0];
        corners[i][1] = square[i % 6][1];
        corners[i][2] = 4.0 * (i / 6) + (params->tilted ? corners[i][0] / 4 : 0);
        indices[i / 3][i % 3] = i;
    }
    struct gn_mesh mesh = {corners, 6 * LAYERS, indices, 2 * LAYERS};
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = params->candidates ? 0 : VK_GEOMETRY_OPAQUE_BIT_KHR;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    const uint32_t count = gn_ray_count(run, 16384);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    for (uint32_t i = 0; i < count; i++) {
        double x, y;
        do {
            x = (gn_random_below(random, 61) - 30.0) / 8;
            y = (gn_random_below(random, 61) - 30.0) / 8;
        } while (x == y); /* the diagonal is an edge */
        const double z = 4.0 * gn_random_below(random, LAYERS) + (params->tilted ? x / 4 : 0);
        rays[i] = axis_ray(random, x, y, z, (1 + gn_random_below(random, 31)) / 8.0);
        struct gn_ref_ray *ray = &rays[i].ray;
        if (params->end == TMIN) {
            ray->tmin = near_to(random, ray->tmin);
            ray->tmax = 1000;
        } else {
            ray->tmax = near_to(random, ray->tmax);
            ray->tmin = 0;
        }
    }
    gn_case_trace(run, &scene, params->candidates ? GN_CTS_CANDIDATES : GN_CTS_COMMITTED, rays, count, 0);
    demand_ideal(run);
}

/* Boxes without extent along the ray, across it or both; each ray passes through the inside of what extent there is. */
static void flat_boxes(struct gn_case_run *run, const struct gn_case *self)
{
    (void)self;
    struct gn_random *random = &run->random;
    float(*boxes)[6] = gn_arena_alloc(&run->arena, LAYERS, sizeof *boxes);
    for (uint32_t i = 0; i < LAYERS; i++) {
        const float box[6] = {-2, -2, 4.0f * (float)i, 2, 2, 4.0f * (float)i + (i % 2 ? 1 : 0)};
        for (int a = 0; a < 6; a++)
            boxes[i][a] = box[a];
    }
    struct gn_cts_geometry geometry = {
        .type = GN_REF_AABBS, .aabbs = (const float(*)[6])boxes, .aabb_count = LAYERS};
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    const uint32_t count = gn_ray_count(run, 8192);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    for (uint32_t i = 0; i < count; i++) {
        const double x = (gn_random_below(random, 31) - 15.0) / 8, y = (gn_random_below(random, 31) - 15.0) / 8;
        rays[i] = axis_ray(random, x, y, 4.0 * gn_random_below(random, LAYERS), (1 + gn_random_below(random, 15)) / 8.0);
        rays[i].ray.tmin = 0;
        rays[i].ray.tmax = 1000;
    }
    gn_case_trace(run, &scene, GN_CTS_CANDIDATES, rays, count, 0);
    demand_ideal(run);
}

static const struct gn_case cases[] = {
    {.name = "exact.tmin", .spec = SPEC_OPEN, .run = triangles, .params = &(const struct params){TMIN, false, false}},
    {.name = "exact.tmax", .spec = SPEC_OPEN, .run = triangles, .params = &(const struct params){TMAX, false, false}},
    {.name = "exact.tmin_candidates", .spec = SPEC_OPEN, .run = triangles, .params = &(const struct params){TMIN, true, false}},
    {.name = "exact.tmax_candidates", .spec = SPEC_OPEN, .run = triangles, .params = &(const struct params){TMAX, true, false}},
    {.name = "exact.tmin_tilted", .spec = SPEC_OPEN, .run = triangles, .params = &(const struct params){TMIN, false, true}},
    {.name = "exact.tmax_tilted", .spec = SPEC_OPEN, .run = triangles, .params = &(const struct params){TMAX, false, true}},
    {.name = "exact.tmax_tilted_candidates", .spec = SPEC_OPEN, .run = triangles, .params = &(const struct params){TMAX, true, true}},
    {.name = "exact.flat_boxes", .spec = SPEC_BOX, .run = flat_boxes},
};
const struct gn_case_family gn_family_exact = {"exact", cases, sizeof cases / sizeof cases[0]};
