/* SPDX-License-Identifier: Apache-2.0 */
/* What a query presents to the shader, and what comes of its answers. */
#include "cts/compose.h"

#define SPEC_LIST                                                                                            \
    "every triangle that is not opaque and that the ray meets before the committed hit is a candidate "      \
    "(Vulkan: "                                                                                              \
    "Ray Intersection Candidate Determination; SPV_KHR_ray_query: OpRayQueryProceedKHR)"
#define SPEC_OPAQUE                                                                                          \
    "an opaque triangle is committed without being presented (Vulkan: Ray Opacity Culling; "                 \
    "SPV_KHR_ray_query: OpRayQueryProceedKHR)"
#define SPEC_DUPLICATE                                                                                       \
    "a triangle of a geometry with NO_DUPLICATE_ANY_HIT_INVOCATION is presented at most once (Vulkan: "      \
    "VkGeometryFlagBitsKHR)"
#define SPEC_CONFIRM                                                                                         \
    "the nearest of the confirmed candidates and the opaque hits is committed, whatever the order in which " \
    "they were presented (Vulkan: Ray Closest Hit Determination; SPV_KHR_ray_query: "                        \
    "OpRayQueryConfirmIntersectionKHR)"

#define SPEC_TERMINATE                                                                                       \
    "a shader may end a ray with the hit that it has (SPV_KHR_ray_query: OpRayQueryTerminateKHR; " \
    "SPV_KHR_ray_tracing: OpTerminateRayKHR)"
#define SPEC_PAYLOAD                                                                                         \
    "what an any-hit shader writes to the payload stays, also where it ignores the intersection (SPV_KHR_ray_tracing: " \
    "OpIgnoreIntersectionKHR)"

enum shape { LAYERS, SOUP, NEEDLES, CLOSED };
enum opacity { NOT_OPAQUE, ALTERNATING, BY_INSTANCE };
enum confirm { NONE, EVERY, RANDOM, ONE_IN_32, ONE_IN_FOUR };

struct params {
    enum shape shape;
    enum opacity opacity;
    enum confirm confirm;
    enum gn_cts_program program;
    bool no_duplicates;
    bool boxes;       /* a ladder among the layers */
    bool overlapping; /* two instances at the same place */
    bool short_range;
    bool terminate; /* by the shader, once it has a hit */
    bool counted;
};

enum { RUNGS = 10 };

/* Long thin triangles in all directions: they lie in many cells of any spatial structure. */
static struct gn_mesh needles(struct gn_case_run *run, uint32_t count)
{
    struct gn_mesh mesh = gn_mesh_soup(&run->arena, &run->random, count, 0.05);
    for (uint32_t t = 0; t < mesh.triangle_count; t++) {
        double *tip = mesh.positions[mesh.triangles[t][2]];
        for (int a = 0; a < 3; a++)
            tip[a] = (float)(tip[a] + gn_random_range(&run->random, -2, 2));
    }
    return mesh;
}

static uint32_t confirm_mask(struct gn_random *random, enum confirm confirm)
{
    uint32_t bits = (uint32_t)gn_random_u64(random);
    switch (confirm) {
    case NONE:
        return 0;
    case EVERY:
        return UINT32_MAX;
    case RANDOM:
        return bits;
    case ONE_IN_32:
        return 1u << (bits & 31);
    case ONE_IN_FOUR:
        return bits & (uint32_t)gn_random_u64(random);
    }
    return 0;
}

static void candidates(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    struct gn_arena *arena = &run->arena;
    struct gn_random *random = &run->random;
    uint32_t layers = params->shape == LAYERS ? RUNGS : 2;
    struct gn_cts_geometry *geometries = GN_NEW(arena, struct gn_cts_geometry, layers + 1);
    for (uint32_t g = 0; g < layers; g++) {
        struct gn_mesh mesh;
        if (params->shape == SOUP)
            mesh = gn_mesh_soup(arena, random, 150, 0.3);
        else if (params->shape == NEEDLES)
            mesh = needles(run, 100);
        else if (params->shape == CLOSED)
            mesh = gn_mesh_blob(arena, random, 16, 24, 0.1);
        else
            mesh = gn_mesh_height_field(arena, random, 8, 0.125);
        if (params->shape == LAYERS)
            mesh = gn_mesh_scaled(arena, &mesh, 1.75, 1.75, 1, 0, 0, g + 0.5);
        if (params->shape == CLOSED && g)
            mesh = gn_mesh_scaled(arena, &mesh, 0.6, 0.6, 0.6, 0, 0, 0);
        geometries[g] = gn_geometry_of_mesh(&mesh);
        geometries[g].flags = (params->opacity == ALTERNATING && g % 2 ? GN_REF_GEOMETRY_OPAQUE : 0) |
                              (params->no_duplicates ? GN_REF_GEOMETRY_NO_DUPLICATE : 0);
    }
    const float(*boxes)[6] = gn_ladder_make(arena, random, RUNGS, 0.25);
    geometries[layers] =
        (struct gn_cts_geometry){.type = GN_REF_AABBS,
                                 .flags = params->no_duplicates ? GN_REF_GEOMETRY_NO_DUPLICATE : 0,
                                 .aabbs = boxes,
                                 .aabb_count = RUNGS};
    struct gn_cts_blas blases[2] = {{.geometries = geometries, .geometry_count = layers},
                                    {.geometries = &geometries[layers], .geometry_count = 1}};
    struct gn_cts_instance instances[3];
    uint32_t instance_count = 0;
    for (uint32_t i = 0; i < (params->overlapping ? 2u : 1u); i++) {
        instances[instance_count] = gn_instance_of(0, NULL);
        instances[instance_count].custom_index = 100 + i;
        if (params->opacity == BY_INSTANCE)
            instances[instance_count].flags =
                i ? VK_GEOMETRY_INSTANCE_FORCE_OPAQUE_BIT_KHR : VK_GEOMETRY_INSTANCE_FORCE_NO_OPAQUE_BIT_KHR;
        if (i && params->opacity == BY_INSTANCE)
            gn_instance_place(&instances[instance_count], 0.01, 0.02, 0.25);
        instance_count++;
    }
    if (params->boxes)
        instances[instance_count++] = gn_instance_of(1, NULL);
    struct gn_cts_scene scene = gn_scene_make(blases, params->boxes ? 2 : 1, instances, instance_count);

    uint32_t count = gn_ray_count(run, 8192);
    struct gn_cts_ray *rays = GN_NEW(arena, struct gn_cts_ray, count);
    if (params->shape == LAYERS)
        gn_ladder_rays(random, boxes, RUNGS, true, rays, count);
    else
        gn_rays_at_scene(run, &scene, 2, true, rays, count);
    for (uint32_t i = 0; i < count; i++) {
        rays[i].policy.confirm_mask = confirm_mask(random, params->confirm);
        if (params->short_range) {
            rays[i].ray.tmin = (float)gn_random_range(random, 0, RUNGS);
            rays[i].ray.tmax = rays[i].ray.tmin + (float)gn_random_range(random, 0.5, RUNGS);
        }
    }
    run->route.counted = params->counted;
    if (!params->terminate) {
        gn_case_trace(run, &scene, params->program, rays, count, 0);
        return;
    }
    /* A shader that ends the ray by its first hit is as the flag that does. */
    struct gn_cts_ray *judged = GN_NEW(arena, struct gn_cts_ray, count);
    for (uint32_t i = 0; i < count; i++) {
        judged[i] = rays[i];
        judged[i].ray.flags |= GN_REF_RAY_TERMINATE_ON_FIRST_HIT;
    }
    run->route.terminate = true;
    gn_case_trace_as(run, &scene, params->program, rays, judged, count, 0);
}

#define CASE(label, spec, ...)                                                                               \
    {                                                                                                        \
        "candidates." label, spec, candidates, &(const struct params){__VA_ARGS__}, 0                        \
    }
#define LISTED .program = GN_CTS_CANDIDATES
static const struct gn_case cases[] = {
    CASE("layers", SPEC_LIST, LISTED, .shape = LAYERS),
    CASE("soup", SPEC_LIST, LISTED, .shape = SOUP),
    CASE("needles", SPEC_LIST, LISTED, .shape = NEEDLES),
    CASE("closed", SPEC_LIST, LISTED, .shape = CLOSED),
    CASE("short_range", SPEC_LIST, LISTED, .shape = LAYERS, .short_range = true),
    CASE("with_opaque", SPEC_OPAQUE, LISTED, .shape = LAYERS, .opacity = ALTERNATING),
    CASE("with_opaque_instance", SPEC_OPAQUE, LISTED, .shape = LAYERS, .opacity = BY_INSTANCE,
         .overlapping = true),
    CASE("with_opaque_soup", SPEC_OPAQUE, LISTED, .shape = SOUP, .opacity = ALTERNATING),
    CASE("with_boxes", SPEC_LIST, LISTED, .shape = LAYERS, .boxes = true),
    CASE("overlapping_instances", SPEC_LIST, LISTED, .shape = LAYERS, .overlapping = true),
    CASE("no_duplicates.layers", SPEC_DUPLICATE, LISTED, .shape = LAYERS, .boxes = true,
         .no_duplicates = true),
    CASE("no_duplicates.needles", SPEC_DUPLICATE, LISTED, .shape = NEEDLES, .no_duplicates = true),
    CASE("confirm.every", SPEC_CONFIRM, .shape = LAYERS, .confirm = EVERY),
    CASE("confirm.none", SPEC_CONFIRM, .shape = LAYERS, .opacity = ALTERNATING, .confirm = NONE),
    CASE("confirm.random", SPEC_CONFIRM, .shape = LAYERS, .confirm = RANDOM),
    CASE("confirm.one_in_32", SPEC_CONFIRM, .shape = LAYERS, .opacity = ALTERNATING, .confirm = ONE_IN_32),
    CASE("confirm.one_in_four_boxes", SPEC_CONFIRM, .shape = LAYERS, .confirm = ONE_IN_FOUR, .boxes = true),
    CASE("confirm.soup", SPEC_CONFIRM, .shape = SOUP, .confirm = RANDOM),
    CASE("confirm.needles", SPEC_CONFIRM, .shape = NEEDLES, .opacity = ALTERNATING, .confirm = RANDOM),
    CASE("confirm.closed", SPEC_CONFIRM, .shape = CLOSED, .confirm = RANDOM),
    CASE("terminate.layers", SPEC_TERMINATE, .shape = LAYERS, .confirm = RANDOM, .terminate = true),
    CASE("terminate.soup", SPEC_TERMINATE, .shape = SOUP, .confirm = ONE_IN_FOUR, .terminate = true),
    CASE("terminate.boxes", SPEC_TERMINATE, .shape = LAYERS, .confirm = ONE_IN_FOUR, .boxes = true, .terminate = true),
    CASE("counted.layers", SPEC_PAYLOAD, LISTED, .shape = LAYERS, .counted = true),
    CASE("counted.needles", SPEC_PAYLOAD, LISTED, .shape = NEEDLES, .counted = true),
    CASE("confirm.overlapping_instances", SPEC_CONFIRM, .shape = LAYERS, .opacity = BY_INSTANCE,
         .confirm = RANDOM, .overlapping = true),
};
const struct gn_case_family gn_family_candidates = {"candidates", cases, sizeof cases / sizeof cases[0]};
