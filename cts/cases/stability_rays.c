/* SPDX-License-Identifier: Apache-2.0 */
/* Sweeps over the rays themselves: directions, the ends of the t range, origins on the surface. */
#include <math.h>
#include <string.h>

#include "cts/cases/stability.h"

static struct gn_mesh blob(const struct gn_sweep_request *request)
{
    return gn_mesh_blob(request->arena, request->random, 6, 8, 0.2);
}

static void direction_scale(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_mesh mesh = blob(request);
    struct gn_aim_options options = {.direction_scale = request->value};
    gn_stability_mesh(request, &mesh, &options, (struct gn_stability_aims){.interior = 4, .edge = 1}, out);
}
#define SQUARES "the direction's square has to be normal in f32, for those who normalise it"
const struct gn_sweep gn_stability_direction_long = {
    "length of the direction", "",
    GN_SWEEP_VALUES(1, 0x1p10, 0x1p20, 0x1p30, 0x1p40, 0x1p50, 0x1p60, 0x1p70, 0x1p80, 0x1p90, 0x1p100, 0x1p110, 0x1p120),
    GN_SWEEP_SQUARE, SQUARES, 1000, direction_scale, NULL};
const struct gn_sweep gn_stability_direction_short = {
    "length of the direction", "",
    GN_SWEEP_VALUES(1, 0x1p-10, 0x1p-20, 0x1p-30, 0x1p-40, 0x1p-50, 0x1p-60, 0x1p-70, 0x1p-80, 0x1p-90, 0x1p-100,
                    0x1p-110, 0x1p-120),
    1 / GN_SWEEP_SQUARE, SQUARES, 1000, direction_scale, NULL};

enum component { TINY, HUGE_ONE, ZERO };

/* One or two components of the direction are replaced; the target stays where it was, at t = 1 or 1/value. */
static void component(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    const enum component *kind = request->params;
    struct gn_random *random = request->random;
    struct gn_mesh mesh = blob(request);
    if (*kind == ZERO)
        mesh = gn_mesh_scaled(request->arena, &mesh, 1, 1, 1, request->value, -request->value, request->value);
    struct gn_aim_options options = {.both_sides = true, .distance = 3};
    gn_stability_mesh(request, &mesh, &options, (struct gn_stability_aims){.interior = 1}, out);
    for (uint32_t i = 0; i < out->ray_count; i++) {
        struct gn_ref_ray *ray = &out->rays[i].ray;
        uint32_t axis = gn_random_below(random, 3), more = gn_random_below(random, 2);
        for (uint32_t c = 0; c < 3; c++) {
            bool replaced = c == axis || (more && c == (axis + 1) % 3);
            if (*kind == HUGE_ONE) {
                /* The others become next to nothing beside it. */
                if (c == axis)
                    ray->direction[c] *= (float)request->value;
                continue;
            }
            if (!replaced)
                continue;
            ray->origin[c] += ray->direction[c];
            ray->direction[c] = copysignf(*kind == ZERO ? 0 : (float)request->value,
                                          gn_random_below(random, 2) ? 1.0f : -1.0f);
        }
        if (*kind == HUGE_ONE) {
            /* Through the target as before, but at t = 1/value, where the others have moved by little. */
            for (uint32_t c = 0; c < 3; c++)
                if (c != axis)
                    ray->origin[c] += (float)(ray->direction[c] * (1 - 1 / request->value));
            ray->tmax /= (float)request->value;
        }
        /* What is left must not be next to nothing, nor the ray along the surface. */
        float longest = fmaxf(fabsf(ray->direction[0]), fmaxf(fabsf(ray->direction[1]), fabsf(ray->direction[2])));
        if (longest < 0.25f) {
            uint32_t left = (axis + 2) % 3;
            ray->origin[left] -= 2;
            ray->direction[left] += 2;
        }
    }
}
const struct gn_sweep gn_stability_component_tiny = {
    "size of a direction's smallest components", "",
    GN_SWEEP_VALUES(0x1p-4, 0x1p-10, 0x1p-20, 0x1p-30, 0x1p-40, 0x1p-60, 0x1p-80, 0x1p-100, 0x1p-110, 0x1p-120,
                    0x1p-126, 0x1p-135, 0x1p-149),
    0x1p-100, "the components have to be normal in f32, with 24 bits below them", 1000, component,
    &(const enum component){TINY}};
const struct gn_sweep gn_stability_component_huge = {
    "a direction's largest component over the others", "",
    GN_SWEEP_VALUES(1, 0x1p10, 0x1p20, 0x1p30, 0x1p40, 0x1p50, 0x1p60, 0x1p70, 0x1p80, 0x1p90, 0x1p100, 0x1p110, 0x1p120),
    GN_SWEEP_SQUARE, SQUARES, 1000, component, &(const enum component){HUGE_ONE}};
const struct gn_sweep gn_stability_component_zero = {
    "distance from the origin, of rays with zeros in the direction", "", GN_SWEEP_DECADES, 1e6,
    "beyond, the vertices' own rounding is as large as the triangles, and nothing is left to decide", 1000, component,
    &(const enum component){ZERO}};

/* Tilted triangles for rays that are exact: origin = target - direction * t without rounding. */
static void tilted_triangles(const struct gn_sweep_request *request, double slope, struct gn_mesh *out)
{
    struct gn_random *random = request->random;
    *out = gn_stability_triangles(request->arena, 16);
    for (uint32_t i = 0; i < out->triangle_count; i++) {
        double(*p)[3] = &out->positions[3 * i];
        static const double corner[3][2] = {{-1, -1}, {1, -1}, {0, 1}};
        double x = ((double)gn_random_below(random, 33) - 16) / 8, y = ((double)gn_random_below(random, 33) - 16) / 8;
        for (int c = 0; c < 3; c++) {
            p[c][0] = x + corner[c][0];
            p[c][1] = y + corner[c][1];
            /* Each in its own layer: none hides another over this range. */
            p[c][2] = slope * (corner[c][0] + corner[c][1] / 2) + i * 8 * fmax(1, slope);
        }
    }
}

static struct gn_cts_ray exact_ray(struct gn_random *random, const struct gn_mesh *mesh, bool on_axis, double *out_t)
{
    double target[3], direction[3], origin[3], t;
    bool exact;
    do {
        const double(*p)[3] = (const double(*)[3])mesh->positions + 3 * gn_random_below(random, mesh->triangle_count);
        double a = 2 + gn_random_below(random, 5), b = 2 + gn_random_below(random, 6);
        double sign = gn_random_below(random, 2) ? 1 : -1;
        t = ldexp(1 + gn_random_below(random, 15), -3);
        direction[0] = on_axis ? 0 : ((double)gn_random_below(random, 9) - 4) / 8;
        direction[1] = on_axis ? 0 : ((double)gn_random_below(random, 9) - 4) / 8;
        direction[2] = sign * (on_axis ? 1 : (8 + gn_random_below(random, 8)) / 8.0);
        exact = true;
        for (int k = 0; k < 3; k++) {
            target[k] = (a * p[0][k] + b * p[1][k] + (16 - a - b) * p[2][k]) / 16;
            origin[k] = target[k] - direction[k] * t;
            exact = exact && (double)(float)origin[k] == origin[k] && (double)(float)target[k] == target[k];
        }
    } while (!exact);
    *out_t = t;
    return gn_ray_make(origin, direction, 1e6);
}

static float moved_by_ulps(float value, int ulps)
{
    for (; ulps > 0; ulps--)
        value = nextafterf(value, INFINITY);
    for (; ulps < 0; ulps++)
        value = nextafterf(value, 0);
    return value;
}

/* tmin or tmax at `value` ulps to either side of the t of the hit. */
static void end_near(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_random *random = request->random;
    struct gn_mesh mesh;
    tilted_triangles(request, 0.5, &mesh);
    gn_stability_scene(request, &mesh, NULL, NULL, out);
    for (uint32_t i = 0; i < out->ray_count; i++) {
        double t;
        out->rays[i] = exact_ray(random, &mesh, false, &t);
        /* An ulp of t is a whole power of two: so many of them to either side stay in f32's steps. */
        double ulp = ldexp(1, ilogb(t) - 23), by = request->value * ulp * (gn_random_below(random, 2) ? 1 : -1);
        if (gn_random_below(random, 2))
            out->rays[i].ray.tmin = (float)(t + by);
        else
            out->rays[i].ray.tmax = (float)(t + by);
    }
}
const struct gn_sweep gn_stability_end_near = {
    "distance of tmin or tmax from the hit", "ulp",
    GN_SWEEP_VALUES(0x1p20, 0x1p18, 0x1p16, 0x1p14, 0x1p12, 0x1p10, 256, 64, 16, 8, 4, 2, 1), 1,
    "the end of the range is decided by its margin, however near", 1000, end_near, NULL};

/* tmin or tmax exactly at the hit, or one ulp to either side, on triangles of every slope. */
static void end_tilted(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_random *random = request->random;
    struct gn_mesh mesh;
    tilted_triangles(request, request->value, &mesh);
    gn_stability_scene(request, &mesh, NULL, NULL, out);
    for (uint32_t i = 0; i < out->ray_count; i++) {
        double t;
        out->rays[i] = exact_ray(random, &mesh, true, &t);
        float end = moved_by_ulps((float)t, (int)gn_random_below(random, 3) - 1);
        if (gn_random_below(random, 2))
            out->rays[i].ray.tmin = end;
        else
            out->rays[i].ray.tmax = end;
    }
}
const struct gn_sweep gn_stability_end_tilted = {
    "slope of the triangles, tmin or tmax at the hit", "",
    GN_SWEEP_VALUES(0x1p-12, 0x1p-8, 0x1p-4, 0x1p-2, 1, 4, 16, 64, 256, 1024), 1024,
    "what the slope makes of the rounding is in the margin", 1000, end_tilted, NULL};

/* A range of no length, at the hit or near it: nothing is ever met. */
static void end_empty(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_random *random = request->random;
    struct gn_mesh mesh;
    tilted_triangles(request, 0.5, &mesh);
    gn_stability_scene(request, &mesh, NULL, NULL, out);
    for (uint32_t i = 0; i < out->ray_count; i++) {
        double t;
        out->rays[i] = exact_ray(random, &mesh, false, &t);
        struct gn_ref_ray *ray = &out->rays[i].ray;
        for (int c = 0; c < 3; c++)
            ray->direction[c] = (float)(ray->direction[c] / request->value);
        ray->tmin = ray->tmax = moved_by_ulps((float)(t * request->value), (int)gn_random_below(random, 5) - 2);
    }
}
const struct gn_sweep gn_stability_end_empty = {
    "t of a hit at tmin = tmax", "",
    GN_SWEEP_VALUES(1, 0x1p10, 0x1p20, 0x1p30, 0x1p40, 0x1p50, 0x1p60, 0x1p80, 0x1p100, 0x1p120), GN_SWEEP_SQUARE,
    SQUARES, 1000, end_empty, NULL};

static void end_infinite(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_mesh mesh = blob(request);
    struct gn_aim_options options = {.direction_scale = 1 / request->value};
    gn_stability_mesh(request, &mesh, &options, (struct gn_stability_aims){.interior = 3, .random = 1}, out);
    for (uint32_t i = 0; i < out->ray_count; i++)
        out->rays[i].ray.tmax = INFINITY;
}
const struct gn_sweep gn_stability_end_infinite = {
    "t of a hit before tmax = infinity", "",
    GN_SWEEP_VALUES(1, 0x1p10, 0x1p20, 0x1p30, 0x1p40, 0x1p50, 0x1p60, 0x1p70, 0x1p80, 0x1p90, 0x1p100, 0x1p110, 0x1p120),
    GN_SWEEP_SQUARE, SQUARES, 1000, end_infinite, NULL};

/* Rays that start on a closed surface, outwards or inwards, moved away from the origin of the coordinates. */
static void origin_on_surface(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    const enum gn_aim *aim = request->params;
    struct gn_random *random = request->random;
    struct gn_mesh mesh = gn_mesh_octahedron(request->arena, 4);
    /* No coordinate becomes 0, whose size would be next to nothing. */
    const double by = request->value;
    mesh = gn_mesh_scaled(request->arena, &mesh, 1, 1, 1, 1.25 * by, -1.5 * by, 1.75 * by);
    struct gn_aim_options options = {.aim = *aim, .distance = 2, .both_sides = true};
    gn_stability_scene(request, &mesh, NULL, NULL, out);
    gn_rays_aimed_with(random, &mesh, &options, out->rays, out->ray_count);
    for (uint32_t i = 0; i < out->ray_count; i++) {
        struct gn_ref_ray *ray = &out->rays[i].ray;
        for (int c = 0; c < 3; c++)
            ray->origin[c] += ray->direction[c];
        ray->tmin = gn_random_below(random, 2) ? 0 : 0x1p-100f;
    }
}
#define ON_SURFACE                                                                                           \
    GN_SWEEP_VALUES(0x1p-2, 1, 4, 16, 64, 256, 1024, 0x1p12, 0x1p14, 0x1p16, 0x1p18, 0x1p20), 0x1p20,        \
        "whether the surface lies before or behind the origin is decided by its margin", 1000, origin_on_surface
const struct gn_sweep gn_stability_origin_face = {"distance of the surface from the origin of the coordinates", "",
                                                  ON_SURFACE, &(const enum gn_aim){GN_AIM_INTERIOR}};
const struct gn_sweep gn_stability_origin_edge = {"distance of the surface from the origin of the coordinates", "",
                                                  ON_SURFACE, &(const enum gn_aim){GN_AIM_EDGE}};
const struct gn_sweep gn_stability_origin_vertex = {"distance of the surface from the origin of the coordinates", "",
                                                    ON_SURFACE, &(const enum gn_aim){GN_AIM_VERTEX}};
