/* SPDX-License-Identifier: Apache-2.0 */
/* Geometry and instance transforms of every kind, and what a query tells of them. */
#include <math.h>
#include <string.h>

#include "cts/compose.h"
#include "cts/mesh_case.h"

#define OPAQUE VK_GEOMETRY_OPAQUE_BIT_KHR

struct transforms {
    struct gn_transform_spec geometry, instance;
    uint32_t count; /* instances, each with a transform of its own */
    double distance; /* 0: 4 */
    enum gn_cts_program program;
    uint32_t interior, random; /* rays */
    bool not_opaque;
    bool varied; /* rays with flags and a tmin of their own */
    bool from_candidate;
};

/* Any flag, alone or with others that go with it; a tmin. What a query says of them has to be what it was given. */
static void vary(struct gn_random *random, struct gn_cts_ray *ray)
{
    static const uint32_t flags[] = {0, GN_REF_RAY_OPAQUE, GN_REF_RAY_CULL_NO_OPAQUE, GN_REF_RAY_SKIP_AABBS,
                                     GN_REF_RAY_SKIP_CLOSEST_HIT_SHADER, GN_REF_RAY_CULL_BACK_FACING,
                                     GN_REF_RAY_CULL_FRONT_FACING,
                                     GN_REF_RAY_OPAQUE | GN_REF_RAY_TERMINATE_ON_FIRST_HIT | GN_REF_RAY_SKIP_AABBS};
    ray->ray.flags = flags[gn_random_below(random, sizeof flags / sizeof flags[0])];
    ray->ray.tmin = (float)gn_random_range(random, 0, 0.5);
}

static void transforms(struct gn_case_run *run, const struct gn_case *self)
{
    const struct transforms *what = self->params;
    /* A closed mesh and loose triangles, so that facing and order both matter. */
    struct gn_mesh meshes[2] = {gn_mesh_blob(&run->arena, &run->random, 8, 10, 0.2),
                                gn_mesh_soup(&run->arena, &run->random, 60, 0.8)};
    struct gn_cts_geometry geometries[2];
    float matrices[2][12];
    for (int g = 0; g < 2; g++) {
        geometries[g] = gn_geometry_of_mesh(&meshes[g]);
        geometries[g].flags = what->not_opaque ? 0 : OPAQUE;
        geometries[g].transform = gn_transform_of(&run->random, &what->geometry, matrices[g]);
    }
    struct gn_cts_instance *list = GN_NEW(&run->arena, struct gn_cts_instance, what->count);
    for (uint32_t i = 0; i < what->count; i++) {
        float matrix[12];
        list[i] = gn_instance_of(0, gn_transform_of(&run->random, &what->instance, matrix));
        list[i].custom_index = i;
    }
    struct gn_cts_scene scene = gn_scene_of_geometries(&run->arena, geometries, 2, list, what->count);
    uint32_t interior = gn_ray_count(run, what->interior), random = what->random ? gn_ray_count(run, what->random) : 0;
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, interior + random);
    for (uint32_t r = 0; r < interior + random; r++) {
        uint32_t g = r & 1, i = gn_random_below(&run->random, what->count);
        gn_rays_aimed(&run->random, &meshes[g], geometries[g].transform, list[i].transform,
                      r < interior ? GN_AIM_INTERIOR : GN_AIM_RANDOM, what->distance ? what->distance : 4, g, &rays[r], 1);
        if (what->varied)
            vary(&run->random, &rays[r]);
        if (what->from_candidate) /* an opaque one is no candidate */
            rays[r].ray.flags = (rays[r].ray.flags & ~(uint32_t)GN_REF_RAY_OPAQUE) | GN_REF_RAY_TERMINATE_ON_FIRST_HIT;
    }
    run->route.from_candidate = what->from_candidate;
    gn_case_trace(run, &scene, what->program, rays, interior + random, 0);
}

/* Boxes, of which the first that a hit is generated on is asked; an intersection shader is asked before it reports. */
static void boxes(struct gn_case_run *run, const struct gn_case *self)
{
    enum { RUNGS = 16, INSTANCES = 3 };
    const float(*ladder)[6] = gn_ladder_make(&run->arena, &run->random, RUNGS, 0.5);
    struct gn_cts_geometry geometry = {.type = GN_REF_AABBS, .aabbs = ladder, .aabb_count = RUNGS};
    struct gn_cts_blas blas = {.geometries = &geometry, .geometry_count = 1};
    struct gn_cts_instance instances[INSTANCES];
    /* Only the last is on the rays' way; moved by a power of two, it is asked about itself and not about the first. */
    for (uint32_t i = 0; i < INSTANCES; i++) {
        instances[i] = gn_instance_of(0, NULL);
        gn_instance_place(&instances[i], 64.0 * (INSTANCES - 1 - i), 0, 0);
    }
    struct gn_cts_scene scene = gn_scene_make(&blas, 1, instances, INSTANCES);
    const uint32_t count = gn_ray_count(run, 4096);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_ladder_rays(&run->random, ladder, RUNGS, true, rays, count);
    for (uint32_t i = 0; i < count; i++)
        rays[i].ray.flags = GN_REF_RAY_TERMINATE_ON_FIRST_HIT;
    run->route.from_candidate = true;
    gn_case_trace(run, &scene, (enum gn_cts_program)self->value, rays, count, 0);
}

/* Likewise where instances are placed in any way, each so far off that no ray reaches another's boxes. */
static void boxes_placed(struct gn_case_run *run, const struct gn_case *self)
{
    enum { RUNGS = 16, INSTANCES = 6 };
    const struct transforms *what = self->params;
    const float(*ladder)[6] = gn_ladder_make(&run->arena, &run->random, RUNGS, 0.5);
    struct gn_cts_geometry geometry = {.type = GN_REF_AABBS, .aabbs = ladder, .aabb_count = RUNGS};
    struct gn_cts_blas blas = {.geometries = &geometry, .geometry_count = 1};
    struct gn_cts_instance instances[INSTANCES];
    for (uint32_t i = 0; i < INSTANCES; i++) {
        float matrix[12];
        instances[i] = gn_instance_of(0, gn_transform_of(&run->random, &what->instance, matrix));
        gn_instance_place(&instances[i], 256.0 * i, 3, -5);
    }
    struct gn_cts_scene scene = gn_scene_make(&blas, 1, instances, INSTANCES);
    const uint32_t count = gn_ray_count(run, what->interior);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_ladder_rays(&run->random, ladder, RUNGS, true, rays, count);
    for (uint32_t r = 0; r < count; r++) {
        struct gn_ref_ray *ray = &rays[r].ray;
        const float *placed = instances[gn_random_below(&run->random, INSTANCES)].transform;
        const double step = rays[r].policy.generate_step, first = rays[r].policy.generate_t0;
        double from[3], to[3], origin[3], end[3];
        for (int a = 0; a < 3; a++) {
            from[a] = ray->origin[a];
            to[a] = from[a] + ray->direction[a];
        }
        gn_transform_point(placed, from, origin);
        gn_transform_point(placed, to, end);
        for (int a = 0; a < 3; a++) {
            ray->origin[a] = (float)origin[a];
            ray->direction[a] = (float)(end[a] - origin[a]);
        }
        ray->tmin = (float)gn_random_range(&run->random, 0, 0.125);
        ray->tmax = (float)(fmax(first, first + step * (RUNGS - 1)) + fabs(step));
        ray->flags = what->from_candidate ? GN_REF_RAY_TERMINATE_ON_FIRST_HIT : 0;
    }
    run->route.from_candidate = what->from_candidate;
    gn_case_trace(run, &scene, what->program, rays, count, 0);
}

#define RANDOM(...) {.kind = GN_TRANSFORM_RANDOM, __VA_ARGS__}
#define GENERAL(...) {.kind = GN_TRANSFORM_GENERAL, __VA_ARGS__}

static const struct transforms identity = {.count = 1, .interior = 6000, .random = 1000, .program = GN_CTS_DETAIL};
static const struct transforms translated = {.instance = RANDOM(.translation = 5), .count = 4, .interior = 10000,
    .random = 2000, .program = GN_CTS_DETAIL};
static const struct transforms rotated = {
    .instance = RANDOM(.translation = 2), .count = 8, .interior = 20000, .random = 4000};
static const struct transforms mirrored = {
    .instance = RANDOM(.translation = 2, .mirrored = true), .count = 8, .interior = 20000, .random = 4000};
static const struct transforms sheared = {
    .instance = GENERAL(.shear = 2, .translation = 2), .count = 8, .interior = 20000, .random = 4000};
static const struct transforms general = {
    .instance = GENERAL(.min_scale = 0.25, .max_scale = 4, .shear = 1, .translation = 4), .count = 12, .interior = 24000,
    .random = 6000};
static const struct transforms general_confirmed = {
    .instance = GENERAL(.min_scale = 0.25, .max_scale = 4, .shear = 1, .translation = 4), .count = 12, .interior = 12000,
    .random = 2000, .not_opaque = true};
static const struct transforms dyadic = {
    .instance = {.kind = GN_TRANSFORM_DYADIC}, .count = 8, .interior = 16000, .random = 2000};
static const struct transforms dyadic_mirrored = {.instance = {.kind = GN_TRANSFORM_DYADIC, .mirrored = true}, .count = 8,
    .interior = 16000, .random = 2000};
static const struct transforms small = {.instance = RANDOM(.min_scale = 0.001, .max_scale = 0.001, .translation = 0.01),
    .count = 4, .distance = 0.004, .interior = 14000, .random = 2000};
static const struct transforms large = {.instance = RANDOM(.min_scale = 1000, .max_scale = 1000, .translation = 3000),
    .count = 4, .distance = 4000, .interior = 14000, .random = 2000};
static const struct transforms stretched_10 = {.instance = RANDOM(.min_scale = 0.3, .max_scale = 3, .translation = 3),
    .count = 8, .interior = 16000, .random = 2000};
static const struct transforms stretched_1000 = {.instance = RANDOM(.min_scale = 0.03, .max_scale = 30, .translation = 10),
    .count = 8, .distance = 30, .interior = 16000, .random = 2000};
static const struct transforms stretched_1e6 = {
    .instance = RANDOM(.min_scale = 0.001, .max_scale = 1000, .translation = 100), .count = 8, .distance = 1000,
    .interior = 16000, .random = 2000};
static const struct transforms far_1000 = {
    .instance = RANDOM(.translation = 1000), .count = 4, .interior = 16000, .random = 1000};
static const struct transforms far_100000 = {
    .instance = RANDOM(.translation = 100000), .count = 4, .interior = 16000, .random = 1000};
static const struct transforms geometry_rotated = {.geometry = RANDOM(.min_scale = 0.5, .max_scale = 2, .translation = 3),
    .count = 1, .interior = 12000, .random = 2000};
static const struct transforms geometry_mirrored = {
    .geometry = RANDOM(.min_scale = 0.5, .max_scale = 2, .translation = 3, .mirrored = true), .count = 1,
    .interior = 12000, .random = 2000};
static const struct transforms geometry_general = {
    .geometry = GENERAL(.min_scale = 0.25, .max_scale = 4, .shear = 1, .translation = 3), .count = 1, .interior = 12000,
    .random = 2000};
static const struct transforms both = {.geometry = GENERAL(.min_scale = 0.5, .max_scale = 2, .shear = 1, .translation = 1),
    .instance = GENERAL(.min_scale = 0.5, .max_scale = 2, .shear = 1, .translation = 5), .count = 8, .interior = 20000,
    .random = 4000};
static const struct transforms both_mirrored = {
    .geometry = RANDOM(.min_scale = 0.5, .max_scale = 2, .translation = 1, .mirrored = true),
    .instance = RANDOM(.min_scale = 0.5, .max_scale = 2, .translation = 5, .mirrored = true), .count = 8,
    .interior = 20000, .random = 4000};
static const struct transforms geometry_mirrored_instance_not = {
    .geometry = RANDOM(.translation = 1, .mirrored = true), .instance = RANDOM(.translation = 5), .count = 8,
    .interior = 12000, .random = 2000};
static const struct transforms instance_mirrored_geometry_not = {
    .geometry = RANDOM(.translation = 1), .instance = RANDOM(.translation = 5, .mirrored = true), .count = 8,
    .interior = 12000, .random = 2000};
static const struct transforms undone = {.geometry = RANDOM(.min_scale = 1000, .max_scale = 1000),
    .instance = RANDOM(.min_scale = 0.001, .max_scale = 0.001, .translation = 5), .count = 4, .interior = 12000,
    .random = 2000};
static const struct transforms many = {.instance = GENERAL(.min_scale = 0.3, .max_scale = 1, .shear = 0.5, .translation = 15),
    .count = 500, .interior = 20000, .random = 2000};
static const struct transforms detail_dyadic = {
    .instance = {.kind = GN_TRANSFORM_DYADIC}, .count = 30, .interior = 8000, .program = GN_CTS_DETAIL};
static const struct transforms detail_rotated = {
    .instance = RANDOM(.min_scale = 0.5, .max_scale = 2), .count = 8, .interior = 8000, .program = GN_CTS_DETAIL};
static const struct transforms detail_general = {
    .instance = GENERAL(.min_scale = 0.25, .max_scale = 4, .shear = 1, .translation = 4), .count = 30, .interior = 16000,
    .random = 4000, .program = GN_CTS_DETAIL};
static const struct transforms detail_mirrored = {
    .instance = GENERAL(.min_scale = 0.25, .max_scale = 4, .shear = 1, .translation = 4, .mirrored = true), .count = 30,
    .interior = 12000, .random = 2000, .program = GN_CTS_DETAIL};
static const struct transforms detail_stretched = {
    .instance = RANDOM(.min_scale = 0.03, .max_scale = 30, .translation = 10), .count = 30, .distance = 30,
    .interior = 12000, .random = 2000, .program = GN_CTS_DETAIL};
static const struct transforms detail_both = {
    .geometry = GENERAL(.min_scale = 0.5, .max_scale = 2, .shear = 1, .translation = 1),
    .instance = GENERAL(.min_scale = 0.5, .max_scale = 2, .shear = 1, .translation = 5), .count = 10, .interior = 12000,
    .random = 2000, .program = GN_CTS_DETAIL};
static const struct transforms candidate_general = {
    .instance = GENERAL(.min_scale = 0.25, .max_scale = 4, .shear = 1, .translation = 4), .count = 30, .interior = 8000,
    .random = 1000, .program = GN_CTS_DETAIL, .not_opaque = true, .from_candidate = true};
static const struct transforms candidate_mirrored = {
    .instance = RANDOM(.min_scale = 0.5, .max_scale = 2, .translation = 2, .mirrored = true), .count = 8,
    .interior = 8000, .random = 1000, .program = GN_CTS_DETAIL, .not_opaque = true, .from_candidate = true};

static const struct transforms candidate_varied = {
    .instance = RANDOM(.min_scale = 0.5, .max_scale = 2), .count = 8, .interior = 2000, .program = GN_CTS_DETAIL,
    .not_opaque = true, .varied = true, .from_candidate = true};
static const struct transforms boxes_general = {
    .instance = GENERAL(.min_scale = 0.5, .max_scale = 2, .shear = 1), .interior = 1000, .program = GN_CTS_DETAIL};
static const struct transforms boxes_mirrored = {
    .instance = RANDOM(.min_scale = 0.5, .max_scale = 2, .mirrored = true), .interior = 1000, .program = GN_CTS_DETAIL};
static const struct transforms candidate_boxes_general = {
    .instance = GENERAL(.min_scale = 0.5, .max_scale = 2, .shear = 1), .interior = 1000, .program = GN_CTS_DETAIL,
    .from_candidate = true};
static const struct transforms candidate_boxes_mirrored = {
    .instance = RANDOM(.min_scale = 0.5, .max_scale = 2, .mirrored = true), .interior = 1000, .program = GN_CTS_DETAIL,
    .from_candidate = true};

static const struct transforms detail_varied = {
    .instance = RANDOM(.min_scale = 0.5, .max_scale = 2), .count = 8, .interior = 8000, .program = GN_CTS_DETAIL,
    .varied = true};

#define CANDIDATE                                                                                            \
    "a candidate tells its matrices and its ray, to queries as to any-hit shaders (SPV_KHR_ray_query: getters of the " \
    "candidate intersection; Vulkan: ObjectToWorldKHR and others)"
#define INSTANCE "an instance is met where its transform places it (VkAccelerationStructureInstanceKHR; ray traversal)"
#define GEOMETRY "a geometry's transform is applied when it is built (VkAccelerationStructureGeometryTrianglesDataKHR)"
#define BOTH "the geometry's transform comes first, then the instance's (acceleration structures; ray traversal)"
#define FACING "an instance's transform leaves facing as it is, a geometry's does not (VkGeometryInstanceFlagBitsKHR)"
#define DETAIL "a query tells both matrices and the ray in both spaces (ray query: getters of the committed intersection)"

static const struct gn_case cases[] = {
    {"transforms.identity", DETAIL, transforms, &identity, 0},
    {"transforms.translated", DETAIL, transforms, &translated, 0},
    {"transforms.rotated", INSTANCE, transforms, &rotated, 0},
    {"transforms.mirrored", FACING, transforms, &mirrored, 0},
    {"transforms.sheared", INSTANCE, transforms, &sheared, 0},
    {"transforms.general", INSTANCE, transforms, &general, 0},
    {"transforms.general_confirmed", INSTANCE, transforms, &general_confirmed, 0},
    {"transforms.dyadic", INSTANCE, transforms, &dyadic, 0},
    {"transforms.dyadic_mirrored", FACING, transforms, &dyadic_mirrored, 0},
    {"transforms.scaled.0_001", INSTANCE, transforms, &small, 0},
    {"transforms.scaled.1000", INSTANCE, transforms, &large, 0},
    {"transforms.stretched.10", INSTANCE, transforms, &stretched_10, 0},
    {"transforms.stretched.1000", INSTANCE, transforms, &stretched_1000, 0},
    {"transforms.stretched.1000000", INSTANCE, transforms, &stretched_1e6, 0},
    {"transforms.far.1000", INSTANCE, transforms, &far_1000, 0},
    {"transforms.far.100000", INSTANCE, transforms, &far_100000, 0},
    {"transforms.many", INSTANCE, transforms, &many, 0},
    {"transforms.geometry.rotated", GEOMETRY, transforms, &geometry_rotated, 0},
    {"transforms.geometry.mirrored", FACING, transforms, &geometry_mirrored, 0},
    {"transforms.geometry.general", GEOMETRY, transforms, &geometry_general, 0},
    {"transforms.both.general", BOTH, transforms, &both, 0},
    {"transforms.both.mirrored", FACING, transforms, &both_mirrored, 0},
    {"transforms.both.geometry_mirrored", FACING, transforms, &geometry_mirrored_instance_not, 0},
    {"transforms.both.instance_mirrored", FACING, transforms, &instance_mirrored_geometry_not, 0},
    {"transforms.both.scale_undone", BOTH, transforms, &undone, 0},
    {"transforms.detail.rotated", DETAIL, transforms, &detail_rotated, 0},
    {"transforms.detail.varied", DETAIL, transforms, &detail_varied, 0},
    {"transforms.detail.dyadic", DETAIL, transforms, &detail_dyadic, 0},
    {"transforms.detail.general", DETAIL, transforms, &detail_general, 0},
    {"transforms.detail.mirrored", DETAIL, transforms, &detail_mirrored, 0},
    {"transforms.detail.stretched", DETAIL, transforms, &detail_stretched, 0},
    {"transforms.detail.both", DETAIL, transforms, &detail_both, 0},
    {"transforms.candidate.general", CANDIDATE, transforms, &candidate_general, 0},
    {"transforms.candidate.mirrored", CANDIDATE, transforms, &candidate_mirrored, 0},
    {"transforms.candidate.varied", CANDIDATE, transforms, &candidate_varied, 0},
    {"transforms.candidate.boxes_general", CANDIDATE, boxes_placed, &candidate_boxes_general, 0},
    {"transforms.candidate.boxes_mirrored", CANDIDATE, boxes_placed, &candidate_boxes_mirrored, 0},
    {"transforms.detail.boxes_general", DETAIL, boxes_placed, &boxes_general, 0},
    {"transforms.detail.boxes_mirrored", DETAIL, boxes_placed, &boxes_mirrored, 0},
    {"transforms.candidate.boxes", CANDIDATE, boxes, NULL, GN_CTS_DETAIL},
};
const struct gn_case_family gn_family_transforms = {"transforms", cases, sizeof cases / sizeof cases[0]};
