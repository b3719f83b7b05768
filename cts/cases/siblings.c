/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Inactive, degenerate and null siblings: of a few primitives, or instances, one is left out or one alone is there, in
 * every position, and the others answer as if it were not.
 */
#include <math.h>

#include "cts/compose.h"

#define SPEC_INACTIVE                                                                                        \
    "an inactive primitive or instance is met by no ray, and counts in the ids of the others (Vulkan: Inactive " \
    "Primitives and Instances)"
#define SPEC_DEGENERATE "a degenerate triangle is met by no ray, and counts in the ids of the others (Vulkan: Degenerate " \
                        "Primitives and Instances)"
#define SPEC_EMPTY "a geometry without primitives counts in the geometry index of the others (Vulkan: " \
                   "vkCmdBuildAccelerationStructuresKHR)"

enum kind {
    ALL_CORNERS, /* NaN */
    ONE_CORNER,
    DEGENERATE_POINT,
    DEGENERATE_LINE,
    BOX,
    INSTANCE, /* null reference */
    GEOMETRY, /* without primitives */
};

struct params {
    enum kind kind;
    bool one_there; /* the others are not; else one is not there */
    uint32_t count;
};

static double wobble(struct gn_random *random)
{
    return (float)gn_random_range(random, -0.4, 0.4);
}

/* Triangle i stands at x = 3 i, a little tilted. */
static void triangle_set(struct gn_random *random, double (*corners)[3], double x)
{
    static const double shape[3][2] = {{-1, -1}, {1, -1}, {0, 1}};
    for (uint32_t c = 0; c < 3; c++) {
        corners[c][0] = (float)(x + shape[c][0]);
        corners[c][1] = shape[c][1];
        corners[c][2] = wobble(random);
    }
}

static void triangle_spoil(struct gn_random *random, double (*corners)[3], enum kind kind)
{
    const uint32_t chosen = gn_random_below(random, 3);
    for (uint32_t c = 0; c < 3; c++) {
        for (uint32_t a = 0; a < 3; a++) {
            if (kind == ALL_CORNERS || (kind == ONE_CORNER && c == chosen))
                corners[c][a] = NAN;
            else if (kind == DEGENERATE_POINT || (kind == DEGENERATE_LINE && c == 2))
                corners[c][a] = corners[0][a];
        }
    }
}

static void siblings_at(struct gn_case_run *run, const struct params *params, uint32_t position, uint32_t ray_count)
{
    struct gn_arena *arena = &run->arena;
    struct gn_random *random = &run->random;
    const uint32_t count = params->count;
    double(*positions)[3] = gn_arena_alloc(arena, 3 * (size_t)count, sizeof *positions);
    uint32_t(*triangles)[3] = gn_arena_alloc(arena, count, sizeof *triangles);
    float(*boxes)[6] = gn_arena_alloc(arena, count, sizeof *boxes);
    const bool apart = params->kind == INSTANCE || params->kind == GEOMETRY;
    struct gn_cts_geometry *geometries = GN_NEW(arena, struct gn_cts_geometry, count);
    struct gn_cts_instance *instances = GN_NEW(arena, struct gn_cts_instance, count);
    for (uint32_t i = 0; i < count; i++) {
        const bool there = (i == position) == params->one_there;
        triangle_set(random, &positions[3 * i], params->kind == INSTANCE ? 0 : 3.0 * i);
        if (!there && params->kind <= DEGENERATE_LINE)
            triangle_spoil(random, &positions[3 * i], params->kind);
        for (uint32_t c = 0; c < 3; c++) {
            triangles[i][c] = apart ? c : 3 * i + c;
            boxes[i][c] = there ? (float)((c == 0 ? 3.0 * i : 0) - 1 + wobble(random)) : NAN;
            boxes[i][c + 3] = there ? (float)((c == 0 ? 3.0 * i : 0) + 1 + wobble(random)) : NAN;
        }
        geometries[i] = (struct gn_cts_geometry){
            .flags = VK_GEOMETRY_OPAQUE_BIT_KHR,
            .positions = (const double(*)[3])&positions[apart ? 3 * i : 0],
            .position_count = apart ? 3 : 3 * count,
            .triangles = (const uint32_t(*)[3])(apart ? &triangles[i] : triangles),
            .triangle_count = params->kind == GEOMETRY ? there : apart ? 1 : count,
        };
        instances[i] = gn_instance_of(params->kind == INSTANCE && !there ? GN_CTS_NO_BLAS : 0, NULL);
        gn_instance_place(&instances[i], params->kind == INSTANCE ? 3.0 * i : 0, 0, 0);
        instances[i].custom_index = i;
    }
    if (params->kind == BOX)
        geometries[0] = (struct gn_cts_geometry){
            .type = GN_REF_AABBS, .aabbs = (const float(*)[6])boxes, .aabb_count = count};
    struct gn_cts_blas blas = {.geometries = geometries, .geometry_count = params->kind == GEOMETRY ? count : 1};
    struct gn_cts_scene scene = gn_scene_make(&blas, 1, instances, params->kind == INSTANCE ? count : 1);
    struct gn_cts_ray *rays = GN_NEW(arena, struct gn_cts_ray, ray_count);
    gn_rays_at_scene(run, &scene, 2, true, rays, ray_count);
    gn_case_trace(run, &scene, params->kind == BOX ? GN_CTS_CANDIDATES : GN_CTS_COMMITTED, rays, ray_count, 0);
}

static void siblings(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    const uint32_t rays = gn_ray_count(run, 4096) / params->count;
    for (uint32_t position = 0; position < params->count; position++)
        siblings_at(run, params, position, rays < 32 ? 32 : rays);
}

#define ROW(name, spec, kind, n)                                                                             \
    {"siblings." name ".one_missing." #n, spec, siblings, &(const struct params){kind, false, n}, 0},        \
    {                                                                                                        \
        "siblings." name ".one_there." #n, spec, siblings, &(const struct params){kind, true, n}, 0          \
    }
#define ROWS(name, spec, kind)                                                                               \
    ROW(name, spec, kind, 2), ROW(name, spec, kind, 3), ROW(name, spec, kind, 4), ROW(name, spec, kind, 5),  \
        ROW(name, spec, kind, 8), ROW(name, spec, kind, 9), ROW(name, spec, kind, 16), ROW(name, spec, kind, 33)

static const struct gn_case cases[] = {
    ROWS("triangles", SPEC_INACTIVE, ALL_CORNERS),
    ROWS("triangles_corner", SPEC_INACTIVE, ONE_CORNER),
    ROWS("triangles_point", SPEC_DEGENERATE, DEGENERATE_POINT),
    ROWS("triangles_line", SPEC_DEGENERATE, DEGENERATE_LINE),
    ROWS("boxes", SPEC_INACTIVE, BOX),
    ROWS("instances", SPEC_INACTIVE, INSTANCE),
    ROWS("geometries", SPEC_EMPTY, GEOMETRY),
};
const struct gn_case_family gn_family_siblings = {"siblings", cases, sizeof cases / sizeof cases[0]};
