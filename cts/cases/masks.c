/* SPDX-License-Identifier: Apache-2.0 */
/* Which instances a ray may meet: the instance's mask against the low 8 bits of the ray's cull mask. */
#include "cts/compose.h"

#define SPEC_AND                                                                                             \
    "an instance is met only if its mask and the ray's cull mask have a bit in common (Vulkan: Ray Mask "    \
    "Culling; VkAccelerationStructureInstanceKHR::mask)"
#define SPEC_LOW                                                                                             \
    "only the 8 least significant bits of the cull mask count (SPV_KHR_ray_query: OpRayQueryInitializeKHR, " \
    "Cull Mask)"

enum rule {
    ALL,        /* 0xFF */
    SINGLE,     /* one bit: of the instance its index, of the ray a random one */
    RANDOM,     /* any 8 bits */
    NEVER_ZERO, /* any 8 bits but none set */
    SOME_ZERO,  /* a quarter zero, the others 0xFF */
    COMPLEMENT, /* all bits but one */
    UPPER,      /* one bit, and all bits above the 8 */
    UPPER_ONLY, /* a quarter has all bits above the 8 and none below, the others random 8 bits */
    INDEX,      /* the instance's index itself: with 256 instances, every mask */
};

struct params {
    uint32_t instances;
    enum rule instance_rule, ray_rule;
    enum gn_cts_program program;
    uint32_t geometry_flags;
    uint32_t ray_flags;
    bool boxes;
    bool refit; /* the masks are changed by an update of the TLAS */
};

static uint32_t pick(struct gn_random *random, enum rule rule, uint32_t index)
{
    uint32_t bits = (uint32_t)gn_random_u64(random);
    switch (rule) {
    case ALL:
        return 0xFF;
    case SINGLE:
        return 1u << (index & 7);
    case RANDOM:
        return bits & 0xFF;
    case NEVER_ZERO:
        return (bits & 0xFF) | 1u << (bits >> 8 & 7);
    case SOME_ZERO:
        return bits & 3 ? 0xFF : 0;
    case COMPLEMENT:
        return 0xFF ^ 1u << (index & 7);
    case UPPER:
        return 0xFFFFFF00u | 1u << (index & 7);
    case UPPER_ONLY:
        return bits & 0x300 ? bits & 0xFF : 0xFFFFFF00u;
    case INDEX:
        return index & 0xFF;
    }
    return 0;
}

/* Layers of one mesh above each other, 0.5 apart, each an instance; the rays go through many of them. */
static void masks(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    struct gn_arena *arena = &run->arena;
    struct gn_random *random = &run->random;

    struct gn_mesh mesh = gn_mesh_height_field(arena, random, 4, 0.125);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    if (params->boxes) {
        static const float plates[2][6] = {{-1, -1, -0.125f, 0, 1, 0.125f}, {0, -1, -0.125f, 1, 1, 0.125f}};
        geometry = (struct gn_cts_geometry){.type = GN_REF_AABBS, .aabbs = plates, .aabb_count = 2};
    }
    geometry.flags = params->geometry_flags;
    struct gn_cts_blas blas = {.geometries = &geometry, .geometry_count = 1};

    struct gn_cts_instance *instances = GN_NEW(arena, struct gn_cts_instance, params->instances);
    struct gn_cts_instance *initial = GN_NEW(arena, struct gn_cts_instance, params->instances);
    for (uint32_t i = 0; i < params->instances; i++) {
        instances[i] = gn_instance_of(0, NULL);
        gn_instance_place(&instances[i], 0, 0, 0.5 * i);
        instances[i].custom_index = 1000 + i;
        initial[i] = instances[i];
        initial[i].mask = (uint32_t)gn_random_u64(random) & 0xFF;
        instances[i].mask = pick(random, params->instance_rule, i);
    }
    struct gn_cts_scene scene = gn_scene_make(&blas, 1, instances, params->instances);
    if (params->refit) {
        scene.initial_instances = initial;
        scene.tlas_build_flags = VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR;
        scene.tlas_steps[0] = GN_CTS_STEP_REFIT;
    }

    uint32_t count = gn_ray_count(run, 16384);
    struct gn_cts_ray *rays = GN_NEW(arena, struct gn_cts_ray, count);
    /* Of a tall stack each ray goes through 16 layers somewhere in it. */
    for (uint32_t i = 0; i < count; i++) {
        uint32_t span = params->instances < 16 ? params->instances : 16;
        double bottom = 0.5 * gn_random_below(random, params->instances - span + 1);
        gn_rays_through(random, bottom, bottom + 0.5 * (span - 1), 0.96, &rays[i], 1);
        rays[i].ray.tmax = (float)(0.5 * span + 2);
        rays[i].ray.cull_mask = pick(random, params->ray_rule, (uint32_t)gn_random_u64(random));
        rays[i].ray.flags = params->ray_flags;
    }
    gn_case_trace(run, &scene, params->program, rays, count, 0);
}

#define CASE(label, spec, ...)                                                                               \
    {                                                                                                        \
        "masks." label, spec, masks, &(const struct params){__VA_ARGS__}, 0                                  \
    }
static const struct gn_case cases[] = {
    CASE("single_bits", SPEC_AND, 8, SINGLE, SINGLE, GN_CTS_COMMITTED, 1, 0, false, false),
    CASE("single_bits_repeated", SPEC_AND, 64, SINGLE, SINGLE, GN_CTS_COMMITTED, 1, 0, false, false),
    CASE("all_but_one", SPEC_AND, 16, COMPLEMENT, SINGLE, GN_CTS_COMMITTED, 1, 0, false, false),
    CASE("random_pairs", SPEC_AND, 32, NEVER_ZERO, NEVER_ZERO, GN_CTS_COMMITTED, 1, 0, false, false),
    CASE("every_mask", SPEC_AND, 256, INDEX, RANDOM, GN_CTS_COMMITTED, 1, 0, false, false),
    CASE("zero_instance", "an instance of mask 0 is never met (Vulkan: Ray Mask Culling)", 16, SOME_ZERO, ALL,
         GN_CTS_COMMITTED, 1, 0, false, false),
    CASE("zero_ray", "a ray of cull mask 0 meets nothing (Vulkan: Ray Mask Culling)", 16, ALL, SOME_ZERO,
         GN_CTS_COMMITTED, 1, 0, false, false),
    CASE("upper_bits", SPEC_LOW, 8, SINGLE, UPPER, GN_CTS_COMMITTED, 1, 0, false, false),
    CASE("upper_bits_alone", SPEC_LOW, 16, RANDOM, UPPER_ONLY, GN_CTS_COMMITTED, 1, 0, false, false),
    CASE("not_opaque", SPEC_AND, 16, RANDOM, RANDOM, GN_CTS_COMMITTED, 0, 0, false, false),
    CASE("candidates", SPEC_AND, 16, RANDOM, RANDOM, GN_CTS_CANDIDATES, 0, 0, false, false),
    CASE("boxes", SPEC_AND, 16, RANDOM, SINGLE, GN_CTS_CANDIDATES, 0, 0, true, false),
    CASE("first_hit", SPEC_AND, 16, SINGLE, SINGLE, GN_CTS_COMMITTED, 1, GN_REF_RAY_TERMINATE_ON_FIRST_HIT,
         false, false),
    CASE(
        "updated",
        "an update takes the masks that the instances have then (Vulkan: VkAccelerationStructureInstanceKHR)",
        16, NEVER_ZERO, NEVER_ZERO, GN_CTS_COMMITTED, 1, 0, false, true),
};
const struct gn_case_family gn_family_masks = {"masks", cases, sizeof cases / sizeof cases[0]};
