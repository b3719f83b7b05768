/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Numerically hard, though still in the range where an implementation in f32 is expected to be right: far from
 * the origin, large and small, grazing, thin, directions with zeros. The sweeps to the end of f32 are another
 * family's subject.
 */
#include <math.h>
#include <string.h>

#include "cts/compose.h"
#include "cts/mesh_case.h"

#define OPAQUE VK_GEOMETRY_OPAQUE_BIT_KHR
#define FIELD {.kind = GN_MESH_HEIGHT_FIELD, .n = 16, .size = 0.1}

/* The vertices themselves are far away, in a direction that is no axis. */
#define FAR(by)                                                                                                \
    {.mesh = FIELD, .move = {(by), -0.75 * (by), 0.5 * (by)}, .geometry_flags = OPAQUE, .interior = 10000, .edge = 2000, \
     .both_sides = true}
static const struct gn_mesh_case far_10 = FAR(10.0), far_100 = FAR(100.0), far_1000 = FAR(1000.0), far_10000 = FAR(10000.0);

/* Everything is larger or smaller, the directions too. */
#define SCALE(by)                                                                                             \
    {.mesh = {.kind = GN_MESH_BLOB, .n = 12, .m = 16, .size = 0.2}, .stretch = {(by), (by), (by)}, .distance = 4 * (by), \
     .geometry_flags = OPAQUE, .interior = 10000, .edge = 2000}
static const struct gn_mesh_case scale_m20 = SCALE(0x1p-20), scale_m10 = SCALE(0x1p-10), scale_10 = SCALE(0x1p10),
                                 scale_20 = SCALE(0x1p20);

/* Only the directions are; t is the other way round. */
#define DIRECTION(by)                                                                                         \
    {.mesh = {.kind = GN_MESH_BLOB, .n = 12, .m = 16, .size = 0.2}, .direction_scale = (by), .geometry_flags = OPAQUE, \
     .interior = 10000, .edge = 2000}
static const struct gn_mesh_case direction_m20 = DIRECTION(0x1p-20), direction_m10 = DIRECTION(0x1p-10),
                                 direction_10 = DIRECTION(0x1p10), direction_20 = DIRECTION(0x1p20);

#define GRAZING(from, to)                                                                             \
    {.mesh = FIELD, .min_cosine = (from), .max_cosine = (to), .geometry_flags = OPAQUE, .interior = 10000, \
     .both_sides = true}
static const struct gn_mesh_case grazing_6 = GRAZING(0.05, 0.1), grazing_06 = GRAZING(0.005, 0.01),
                                 grazing_006 = GRAZING(0.0005, 0.001);
static const struct gn_mesh_case grazing_flat = {.mesh = {.kind = GN_MESH_QUAD}, .min_cosine = 0.0001, .max_cosine = 0.001,
    .geometry_flags = OPAQUE, .interior = 10000, .both_sides = true};

/* Thin cells: a field squeezed along one axis, so that all its triangles are slivers of that aspect. */
#define SLIVER(by)                                                                                    \
    {.mesh = {.kind = GN_MESH_HEIGHT_FIELD, .n = 8, .size = 0.05}, .stretch = {1, 1 / (by), 1}, .geometry_flags = OPAQUE, \
     .interior = 10000, .edge = 2000, .both_sides = true}
static const struct gn_mesh_case sliver_100 = SLIVER(100.0), sliver_1000 = SLIVER(1000.0), sliver_10000 = SLIVER(10000.0);
static const struct gn_mesh_case needle = {.mesh = {.kind = GN_MESH_FAN, .n = 6, .size = 0}, .stretch = {0.001, 0.001, 1},
    .geometry_flags = OPAQUE, .interior = 6000};
static const struct gn_mesh_case needle_tall = {.mesh = {.kind = GN_MESH_FAN, .n = 6, .size = 500}, .stretch = {1, 1, 1},
    .geometry_flags = OPAQUE, .interior = 6000};

static const struct gn_mesh_case origin_far = {
    .mesh = FIELD, .distance = 1e4, .geometry_flags = OPAQUE, .interior = 10000, .both_sides = true};
static const struct gn_mesh_case origin_near = {
    .mesh = FIELD, .distance = 1e-3, .geometry_flags = OPAQUE, .interior = 10000, .both_sides = true};

/* One structure with triangles from 2^-10 to 2^10 in size, in shells around the origin. `value` is the rays a shell. */
static void mixed_scales(struct gn_case_run *run, const struct gn_case *self)
{
    struct gn_mesh mesh = {0}, shells[11];
    for (int s = 0; s < 11; s++) {
        double scale = ldexp(1, 2 * s - 10);
        struct gn_mesh blob = gn_mesh_blob(&run->arena, &run->random, 6, 8, 0.2);
        /* Side by side as well as inside each other: rays meet the small ones without the large in between. */
        shells[s] = gn_mesh_scaled(&run->arena, &blob, scale, scale, scale, 2 * scale, 0, 0);
        mesh = s ? gn_mesh_joined(&run->arena, &mesh, &shells[s]) : shells[s];
    }
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = OPAQUE;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    uint32_t each = gn_ray_count(run, (uint32_t)self->value);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, 11 * each);
    for (int s = 0; s < 11; s++)
        gn_rays_aimed(&run->random, &shells[s], NULL, NULL, GN_AIM_INTERIOR, ldexp(1, 2 * s - 11), false,
                      rays + (size_t)s * each, each);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, 11 * each, each);
}

/*
 * Directions along an axis, or with one component that is zero, negative zero or far below the others, through
 * the inside of triangles.
 */
enum components { AXIS, AXIS_MINUS_ZERO, ONE_ZERO, ONE_MINUS_ZERO, TINY };

static void components(struct gn_case_run *run, const struct gn_case *self)
{
    struct gn_mesh mesh = gn_mesh_blob(&run->arena, &run->random, 12, 16, 0.2);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = OPAQUE;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    uint32_t count = gn_ray_count(run, 10000);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_rays_aimed(&run->random, &mesh, NULL, NULL, GN_AIM_INTERIOR, 3, true, rays, count);
    for (uint32_t i = 0; i < count; i++) {
        struct gn_ref_ray *ray = &rays[i].ray;
        int axis = (int)gn_random_below(&run->random, 3);
        for (int c = 0; c < 3; c++) {
            bool whole_axis = self->value == AXIS || self->value == AXIS_MINUS_ZERO;
            if (whole_axis ? c == axis : c != axis)
                continue;
            /* The target stays where it was: it is at t = 1. */
            ray->origin[c] += ray->direction[c];
            float zero = self->value == AXIS_MINUS_ZERO || self->value == ONE_MINUS_ZERO ? -0.0f : 0.0f;
            ray->direction[c] = self->value == TINY ? copysignf(ldexpf(1, -20 - (int)gn_random_below(&run->random, 80)),
                                                                ray->direction[c])
                                                    : zero;
        }
        /* The one that is left must not be next to nothing. */
        if ((self->value == AXIS || self->value == AXIS_MINUS_ZERO) && fabsf(ray->direction[axis]) < 0.25f) {
            ray->origin[axis] -= ray->direction[axis] < 0 ? -2.0f : 2.0f;
            ray->direction[axis] = ray->direction[axis] < 0 ? -2.0f : 2.0f;
        }
    }
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

#define FAR_AWAY "intersections are found where coordinates are large against the triangles (ray traversal)"
#define SCALES "the scene's scale does not change what is hit (ray traversal)"
#define DIRECTIONS "t is measured in lengths of the direction, which is not normalised (ray traversal)"
#define GRAZES "a ray at a small angle to a triangle's plane still hits it (ray traversal: ray-triangle intersection)"
#define SLIVERS "a thin triangle is hit like any other (ray traversal: ray-triangle intersection)"
#define ZEROS "components of the direction may be zero of either sign (ray traversal)"

static const struct gn_case cases[] = {
    {"numerics.far.10", FAR_AWAY, gn_mesh_case_run, &far_10, 0},
    {"numerics.far.100", FAR_AWAY, gn_mesh_case_run, &far_100, 0},
    {"numerics.far.1000", FAR_AWAY, gn_mesh_case_run, &far_1000, 0},
    {"numerics.far.10000", FAR_AWAY, gn_mesh_case_run, &far_10000, 0},
    {"numerics.scale.2_minus_20", SCALES, gn_mesh_case_run, &scale_m20, 0},
    {"numerics.scale.2_minus_10", SCALES, gn_mesh_case_run, &scale_m10, 0},
    {"numerics.scale.2_plus_10", SCALES, gn_mesh_case_run, &scale_10, 0},
    {"numerics.scale.2_plus_20", SCALES, gn_mesh_case_run, &scale_20, 0},
    {"numerics.direction.2_minus_20", DIRECTIONS, gn_mesh_case_run, &direction_m20, 0},
    {"numerics.direction.2_minus_10", DIRECTIONS, gn_mesh_case_run, &direction_m10, 0},
    {"numerics.direction.2_plus_10", DIRECTIONS, gn_mesh_case_run, &direction_10, 0},
    {"numerics.direction.2_plus_20", DIRECTIONS, gn_mesh_case_run, &direction_20, 0},
    {"numerics.mixed_scales", SCALES, mixed_scales, NULL, 1000},
    {"numerics.grazing.5_degrees", GRAZES, gn_mesh_case_run, &grazing_6, 0},
    {"numerics.grazing.half_a_degree", GRAZES, gn_mesh_case_run, &grazing_06, 0},
    {"numerics.grazing.3_minutes", GRAZES, gn_mesh_case_run, &grazing_006, 0},
    {"numerics.grazing.quad", GRAZES, gn_mesh_case_run, &grazing_flat, 0},
    {"numerics.sliver.100", SLIVERS, gn_mesh_case_run, &sliver_100, 0},
    {"numerics.sliver.1000", SLIVERS, gn_mesh_case_run, &sliver_1000, 0},
    {"numerics.sliver.10000", SLIVERS, gn_mesh_case_run, &sliver_10000, 0},
    {"numerics.needle.thin", SLIVERS, gn_mesh_case_run, &needle, 0},
    {"numerics.needle.tall", SLIVERS, gn_mesh_case_run, &needle_tall, 0},
    {"numerics.origin.far", FAR_AWAY, gn_mesh_case_run, &origin_far, 0},
    {"numerics.origin.near", FAR_AWAY, gn_mesh_case_run, &origin_near, 0},
    {"numerics.components.axis", ZEROS, components, NULL, AXIS},
    {"numerics.components.axis_minus_zero", ZEROS, components, NULL, AXIS_MINUS_ZERO},
    {"numerics.components.one_zero", ZEROS, components, NULL, ONE_ZERO},
    {"numerics.components.one_minus_zero", ZEROS, components, NULL, ONE_MINUS_ZERO},
    {"numerics.components.tiny", ZEROS, components, NULL, TINY},
};
const struct gn_case_family gn_family_numerics = {"numerics", cases, sizeof cases / sizeof cases[0]};
