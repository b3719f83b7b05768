/* SPDX-License-Identifier: Apache-2.0 */
/* Updates (refits) and rebuilds: afterwards the rays meet the new data and nothing of the old. */
#include "cts/compose.h"

#define SPEC_UPDATE                                                                                          \
    "an update brings a structure to the data of its inputs, in place or into another structure (Vulkan: "   \
    "VkBuildAccelerationStructureModeKHR, VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR)"
#define SPEC_BUILD                                                                                           \
    "a full build replaces what a structure held (Vulkan: VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR)"
#define SPEC_LATE                                                                                            \
    "a top level structure that is updated takes over what its bottom level structures have become (Vulkan: " \
    "Acceleration Structure Update Rules)"
#define SPEC_FLAGS                                                                                           \
    "build flags trade build time, trace time and memory; they change no result (Vulkan: "                   \
    "VkBuildAccelerationStructureFlagBitsKHR)"

enum { VERTICES = 1, TRANSFORMS = 4, INSTANCES = 8, INACTIVE = 16, FAR = 32, DEGENERATE = 64, HIDDEN = 128, FLAGS = 256 };

#define UPDATE VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR
#define COMPACTION VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR
#define TRACE VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR
#define BUILD VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_BUILD_BIT_KHR
#define MEMORY VK_BUILD_ACCELERATION_STRUCTURE_LOW_MEMORY_BIT_KHR

struct params {
    uint32_t what; /* changes */
    VkBuildAccelerationStructureFlagsKHR flags;
    uint8_t steps[GN_CTS_MAX_STEPS];
    VkBuildAccelerationStructureFlagsKHR tlas_flags;
    uint8_t tlas_steps[GN_CTS_MAX_STEPS];
    bool late; /* the BLASes change when the TLAS has been built */
    VkFormat format;
    uint32_t aabb_stride, aabb_offset;
    bool large; /* a mesh whose indices need 32 bits */
};

enum { MESHES = 3, LARGE = 260, RUNGS = 16, INSTANCES_COUNT = 12 };

/* Makes a third of the triangles of an unshared mesh degenerate. */
static void collapse(double (*positions)[3], uint32_t triangle_count, uint32_t remainder)
{
    for (uint32_t t = 0; t < triangle_count; t++)
        for (int a = 0; a < 3 && t % 3 == remainder; a++)
            positions[3 * t + 2][a] = positions[3 * t][a];
}

static struct gn_cts_geometry mesh_geometry(struct gn_case_run *run, const struct params *params, uint32_t index)
{
    const uint32_t what = params->what;
    struct gn_arena *arena = &run->arena;
    struct gn_random *random = &run->random;
    const bool flat = params->format == VK_FORMAT_R32G32_SFLOAT || params->format == VK_FORMAT_R16G16_SFLOAT ||
                      params->format == VK_FORMAT_R16G16_SNORM;
    struct gn_mesh mesh =
        params->large ? gn_mesh_height_field(arena, random, LARGE, 0.3)
        : flat        ? gn_mesh_flat(arena, random, 10)
        : index % 2   ? gn_mesh_blob(arena, random, 8, 12, 0.2) : gn_mesh_height_field(arena, random, 10, 0.3);
    if (what & INACTIVE) {
        mesh = gn_mesh_unshared(arena, &mesh);
        gn_mesh_deactivate(random, &mesh, 0.25);
    }
    if (what & DEGENERATE)
        mesh = gn_mesh_unshared(arena, &mesh);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.vertex_format = params->format;
    geometry.flags = VK_GEOMETRY_OPAQUE_BIT_KHR;
    if (what & DEGENERATE) {
        struct gn_mesh before = gn_mesh_unshared(arena, &mesh);
        collapse(before.positions, mesh.triangle_count, 0);
        collapse(mesh.positions, mesh.triangle_count, 1);
        geometry.initial_positions = (const double(*)[3])before.positions;
    }
    if (what & VERTICES) /* a NaN moved stays a NaN, so what is inactive stays so */
        geometry.initial_positions = gn_mesh_moved(arena, random, &mesh, what & FAR ? 50 : 0.5);
    if (what & TRANSFORMS) {
        float *transform = GN_NEW(arena, float, 12), *initial = GN_NEW(arena, float, 12);
        gn_transform_random(random, 0.5, 1.5, 1, index % 3 == 1, transform);
        gn_transform_random(random, 0.5, 1.5, what & FAR ? 100 : 1, index % 3 == 2, initial);
        geometry.transform = transform;
        geometry.initial_transform = initial;
    }
    return geometry;
}

static void update(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    struct gn_arena *arena = &run->arena;
    struct gn_random *random = &run->random;
    uint32_t instance_count = params->what & (INSTANCES | HIDDEN | FLAGS) ? INSTANCES_COUNT : 2;
    struct gn_cts_blas *blases = GN_NEW(arena, struct gn_cts_blas, 2);
    struct gn_cts_instance *instances = GN_NEW(arena, struct gn_cts_instance, instance_count);
    struct gn_cts_instance *initial = GN_NEW(arena, struct gn_cts_instance, instance_count);
    for (uint32_t b = 0; b < 2; b++) {
        uint32_t count = b || params->large ? 1 : MESHES;
        struct gn_cts_geometry *geometries = GN_NEW(arena, struct gn_cts_geometry, count);
        for (uint32_t g = 0; g < count; g++)
            geometries[g] = mesh_geometry(run, params, b + g);
        blases[b] = (struct gn_cts_blas){
            .geometries = geometries, .geometry_count = count, .build_flags = params->flags};
        for (uint32_t s = 0; s < GN_CTS_MAX_STEPS; s++)
            blases[b].steps[s] = params->steps[s];
    }
    for (uint32_t i = 0; i < instance_count; i++) {
        instances[i] = gn_instance_of(i % 2, NULL);
        gn_transform_random(random, 0.6, 1.2, 2, i % 3 == 2, instances[i].transform);
        initial[i] = instances[i];
        if (params->what & HIDDEN)
            initial[i].mask = i % 2 ? 0 : initial[i].mask;
        if (params->what & FLAGS) {
            instances[i].flags = i % 2 ? VK_GEOMETRY_INSTANCE_TRIANGLE_FLIP_FACING_BIT_KHR : 0;
            initial[i].flags = i % 2 ? 0 : VK_GEOMETRY_INSTANCE_TRIANGLE_FLIP_FACING_BIT_KHR;
            *(i % 3 ? &instances[i].flags : &initial[i].flags) |= VK_GEOMETRY_INSTANCE_FORCE_NO_OPAQUE_BIT_KHR;
        }
        if (!(params->what & INSTANCES))
            continue;
        gn_transform_random(random, 0.6, 1.2, params->what & FAR ? 100 : 2, i % 4 == 2, initial[i].transform);
        instances[i].custom_index = gn_random_below(random, 1u << 24);
        instances[i].sbt_offset = gn_random_below(random, 1u << 24);
        instances[i].mask = 1 + gn_random_below(random, 255);
        initial[i].mask = gn_random_below(random, 256);
        /* Another BLAS behind the same instance, and one that was and stays inactive. */
        initial[i].blas = i % 3 ? instances[i].blas : 1 - instances[i].blas;
        if (i == 5)
            initial[i].blas = instances[i].blas = GN_CTS_NO_BLAS;
    }
    struct gn_cts_scene scene = gn_scene_make(blases, 2, instances, instance_count);
    scene.initial_instances = params->what & (INSTANCES | HIDDEN | FLAGS) ? initial : NULL;
    scene.tlas_build_flags = params->tlas_flags;
    for (uint32_t s = 0; s < GN_CTS_MAX_STEPS; s++)
        scene.tlas_steps[s] = params->tlas_steps[s];
    scene.late_steps = params->late;

    uint32_t count = gn_ray_count(run, 8192);
    struct gn_cts_ray *rays = GN_NEW(arena, struct gn_cts_ray, count);
    gn_rays_at_scene(run, &scene, 2.5, true, rays, count);
    for (uint32_t i = 0; i < count && params->what & FLAGS; i++)
        rays[i].policy.confirm_mask = (uint32_t)gn_random_u64(random);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* Boxes that move along and across; the hits are generated where the boxes are at last. */
static void ladder(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    struct gn_arena *arena = &run->arena;
    const float(*boxes)[6] = gn_ladder_make(arena, &run->random, RUNGS, 0.5);
    float(*initial)[6] = gn_arena_alloc(arena, RUNGS, sizeof *initial);
    for (uint32_t i = 0; i < RUNGS; i++)
        for (int a = 0; a < 6; a++)
            initial[i][a] = boxes[RUNGS - 1 - i][a] + (params->what & FAR ? 100 : 0);
    struct gn_cts_geometry geometry = {.type = GN_REF_AABBS,
                                       .aabbs = boxes,
                                       .aabb_count = RUNGS,
                                       .aabb_stride = params->aabb_stride,
                                       .primitive_offset = params->aabb_offset,
                                       .initial_aabbs = (const float(*)[6])initial};
    struct gn_cts_blas blas = {.geometries = &geometry, .geometry_count = 1, .build_flags = params->flags};
    for (uint32_t s = 0; s < GN_CTS_MAX_STEPS; s++)
        blas.steps[s] = params->steps[s];
    struct gn_cts_instance instance = gn_instance_of(0, NULL);
    struct gn_cts_scene scene = gn_scene_make(&blas, 1, &instance, 1);
    uint32_t count = gn_ray_count(run, 8192);
    struct gn_cts_ray *rays = GN_NEW(arena, struct gn_cts_ray, count);
    gn_ladder_rays(&run->random, boxes, RUNGS, true, rays, count);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

#define CASE(label, spec, ...)                                                                               \
    {                                                                                                        \
        "update." label, spec, update, &(const struct params){__VA_ARGS__}, 0                                \
    }
#define BOX(label, spec, ...)                                                                                \
    {                                                                                                        \
        "update.boxes." label, spec, ladder, &(const struct params){__VA_ARGS__}, 0                          \
    }
#define FORMAT(label, value)                                                                                 \
    CASE("formats." label, SPEC_UPDATE, .what = VERTICES | TRANSFORMS, .flags = UPDATE, .steps = {GN_CTS_STEP_REFIT}, \
         .format = value)
#define BUILD_FLAGS(label, bits)                                                                                   \
    CASE("flags." label, SPEC_FLAGS, .what = VERTICES | TRANSFORMS | INSTANCES, .flags = (bits) | UPDATE,    \
         .steps = {GN_CTS_STEP_REFIT}, .tlas_flags = (bits) | UPDATE,                                        \
         .tlas_steps = {GN_CTS_STEP_REFIT_COPY}),                                                            \
        CASE("flags." label "_only", SPEC_FLAGS, .flags = (bits), .tlas_flags = (bits))

static const struct gn_case cases[] = {
    CASE("vertices.in_place", SPEC_UPDATE, .what = VERTICES, .flags = UPDATE, .steps = {GN_CTS_STEP_REFIT}),
    CASE("vertices.copy", SPEC_UPDATE, .what = VERTICES, .flags = UPDATE, .steps = {GN_CTS_STEP_REFIT_COPY}),
    CASE("vertices.from_afar", SPEC_UPDATE, .what = VERTICES | FAR, .flags = UPDATE,
         .steps = {GN_CTS_STEP_REFIT}),
    CASE("vertices.chain", SPEC_UPDATE, .what = VERTICES, .flags = UPDATE,
         .steps = {GN_CTS_STEP_REFIT, GN_CTS_STEP_REFIT_COPY, GN_CTS_STEP_REFIT, GN_CTS_STEP_REFIT_COPY}),
    CASE("vertices.inactive",
         "what was inactive stays so (Vulkan: vkCmdBuildAccelerationStructuresKHR, pInfos-03663)",
         .what = VERTICES | INACTIVE, .flags = UPDATE, .steps = {GN_CTS_STEP_REFIT}),
    CASE("vertices.degenerate",
         "a triangle may become degenerate or cease to be (Vulkan: Degenerate Primitives and Instances)",
         .what = DEGENERATE, .flags = UPDATE, .steps = {GN_CTS_STEP_REFIT}),
    CASE("transforms.in_place", SPEC_UPDATE, .what = TRANSFORMS, .flags = UPDATE,
         .steps = {GN_CTS_STEP_REFIT}),
    CASE("transforms.copy", SPEC_UPDATE, .what = TRANSFORMS | FAR, .flags = UPDATE,
         .steps = {GN_CTS_STEP_REFIT_COPY}),
    CASE("transforms.and_vertices", SPEC_UPDATE, .what = VERTICES | TRANSFORMS, .flags = UPDATE,
         .steps = {GN_CTS_STEP_REFIT, GN_CTS_STEP_REFIT}),
    CASE("instances.in_place", SPEC_UPDATE, .what = INSTANCES, .tlas_flags = UPDATE,
         .tlas_steps = {GN_CTS_STEP_REFIT}),
    CASE("instances.copy", SPEC_UPDATE, .what = INSTANCES, .tlas_flags = UPDATE,
         .tlas_steps = {GN_CTS_STEP_REFIT_COPY}),
    CASE("instances.from_afar", SPEC_UPDATE, .what = INSTANCES | FAR, .tlas_flags = UPDATE,
         .tlas_steps = {GN_CTS_STEP_REFIT}),
    CASE("instances.chain", SPEC_UPDATE, .what = INSTANCES, .tlas_flags = UPDATE,
         .tlas_steps = {GN_CTS_STEP_REFIT_COPY, GN_CTS_STEP_REFIT, GN_CTS_STEP_REFIT_COPY}),
    CASE("instances.from_mask_0", SPEC_UPDATE, .what = HIDDEN, .tlas_flags = UPDATE,
         .tlas_steps = {GN_CTS_STEP_REFIT}),
    CASE("instances.from_mask_0_copy", SPEC_UPDATE, .what = HIDDEN, .tlas_flags = UPDATE,
         .tlas_steps = {GN_CTS_STEP_REFIT_COPY}),
    CASE("instances.flags", SPEC_UPDATE, .what = FLAGS, .tlas_flags = UPDATE, .tlas_steps = {GN_CTS_STEP_REFIT}),
    CASE("instances.flags_copy", SPEC_UPDATE, .what = FLAGS, .tlas_flags = UPDATE,
         .tlas_steps = {GN_CTS_STEP_REFIT_COPY}),
    FORMAT("r32g32_sfloat", VK_FORMAT_R32G32_SFLOAT),
    FORMAT("r16g16_sfloat", VK_FORMAT_R16G16_SFLOAT),
    FORMAT("r16g16b16a16_sfloat", VK_FORMAT_R16G16B16A16_SFLOAT),
    FORMAT("r16g16_snorm", VK_FORMAT_R16G16_SNORM),
    FORMAT("r16g16b16a16_snorm", VK_FORMAT_R16G16B16A16_SNORM),
    CASE("indices.wide", SPEC_UPDATE, .what = VERTICES, .flags = UPDATE, .steps = {GN_CTS_STEP_REFIT}, .large = true),
    CASE("everything", SPEC_UPDATE, .what = VERTICES | TRANSFORMS | INSTANCES, .flags = UPDATE,
         .steps = {GN_CTS_STEP_REFIT}, .tlas_flags = UPDATE, .tlas_steps = {GN_CTS_STEP_REFIT}),
    CASE("late.refit", SPEC_LATE, .what = VERTICES | FAR, .flags = UPDATE, .steps = {GN_CTS_STEP_REFIT},
         .tlas_flags = UPDATE, .tlas_steps = {GN_CTS_STEP_REFIT}, .late = true),
    CASE("late.refit_copy", SPEC_LATE, .what = VERTICES | TRANSFORMS, .flags = UPDATE, .steps = {GN_CTS_STEP_REFIT},
         .tlas_flags = UPDATE, .tlas_steps = {GN_CTS_STEP_REFIT_COPY}, .late = true),
    CASE("late.rebuild", SPEC_LATE, .what = VERTICES | FAR, .steps = {GN_CTS_STEP_REBUILD}, .tlas_flags = UPDATE,
         .tlas_steps = {GN_CTS_STEP_REFIT}, .late = true),
    CASE("late.tlas_rebuild", SPEC_LATE, .what = VERTICES | INSTANCES, .flags = UPDATE, .steps = {GN_CTS_STEP_REFIT},
         .tlas_steps = {GN_CTS_STEP_REBUILD}, .late = true),
    CASE("late.both_twice", SPEC_LATE, .what = VERTICES | TRANSFORMS | INSTANCES, .flags = UPDATE,
         .steps = {GN_CTS_STEP_REFIT, GN_CTS_STEP_REFIT_BACK, GN_CTS_STEP_REFIT}, .tlas_flags = UPDATE,
         .tlas_steps = {GN_CTS_STEP_REFIT, GN_CTS_STEP_REFIT_BACK, GN_CTS_STEP_REFIT}, .late = true),
    CASE("rebuild.blas", SPEC_BUILD, .what = VERTICES | TRANSFORMS, .steps = {GN_CTS_STEP_REBUILD}),
    CASE("rebuild.tlas", SPEC_BUILD, .what = INSTANCES, .tlas_steps = {GN_CTS_STEP_REBUILD}),
    CASE("rebuild.after_refit", SPEC_BUILD, .what = VERTICES | INSTANCES, .flags = UPDATE,
         .steps = {GN_CTS_STEP_REFIT, GN_CTS_STEP_REBUILD}, .tlas_flags = UPDATE,
         .tlas_steps = {GN_CTS_STEP_REFIT, GN_CTS_STEP_REBUILD}),
    CASE("rebuild.before_refit", SPEC_UPDATE, .what = VERTICES | INSTANCES, .flags = UPDATE,
         .steps = {GN_CTS_STEP_REBUILD, GN_CTS_STEP_REFIT}, .tlas_flags = UPDATE,
         .tlas_steps = {GN_CTS_STEP_REBUILD, GN_CTS_STEP_REFIT_COPY}),
    BOX("in_place", SPEC_UPDATE, .flags = UPDATE, .steps = {GN_CTS_STEP_REFIT}),
    BOX("copy", SPEC_UPDATE, .flags = UPDATE, .steps = {GN_CTS_STEP_REFIT_COPY}),
    BOX("from_afar", SPEC_UPDATE, .what = FAR, .flags = UPDATE,
        .steps = {GN_CTS_STEP_REFIT, GN_CTS_STEP_REFIT}),
    BOX("stride_offset", SPEC_UPDATE, .what = FAR, .flags = UPDATE, .steps = {GN_CTS_STEP_REFIT}, .aabb_stride = 40,
        .aabb_offset = 48),
    BOX("stride_offset_copy", SPEC_UPDATE, .flags = UPDATE, .steps = {GN_CTS_STEP_REFIT_COPY}, .aabb_stride = 32,
        .aabb_offset = 8),
    BOX("rebuild", SPEC_BUILD, .what = FAR, .steps = {GN_CTS_STEP_REBUILD}),
    BUILD_FLAGS("fast_trace", TRACE),
    BUILD_FLAGS("fast_build", BUILD),
    BUILD_FLAGS("low_memory", MEMORY),
    BUILD_FLAGS("fast_trace_low_memory", TRACE | MEMORY),
    BUILD_FLAGS("fast_build_low_memory_compaction", BUILD | MEMORY | COMPACTION),
};
const struct gn_case_family gn_family_update = {"update", cases, sizeof cases / sizeof cases[0]};
