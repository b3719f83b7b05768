/* SPDX-License-Identifier: Apache-2.0 */
/* Copies of structures: compacted, cloned, serialized, one after another; they answer as the source did. */
#include "cts/compose.h"

#include <string.h>

#define SPEC_COMPACT                                                                                         \
    "a compacted copy holds the same geometry in less memory (Vulkan: "                                      \
    "VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR)"
#define SPEC_CLONE "a clone is a copy like its source (Vulkan: VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR)"
#define SPEC_SERIALIZE                                                                                       \
    "a structure that was serialized and deserialized is like its source (Vulkan: "                          \
    "vkCmdCopyAccelerationStructureToMemoryKHR, vkCmdCopyMemoryToAccelerationStructureKHR)"
#define SPEC_SOURCE                                                                                          \
    "a copy leaves its source as it was (Vulkan: Copying Acceleration Structures)"
#define SPEC_CHAIN "a copy can be copied or updated again (Vulkan: Copying Acceleration Structures)"
#define SPEC_OVER "a copy replaces what its destination held (Vulkan: Copying Acceleration Structures)"
#define SPEC_RELOCATE                                                                                        \
    "a top level structure refers to what the handles in its serialized data name when it is deserialized (Vulkan: " \
    "vkCmdCopyMemoryToAccelerationStructureKHR)"
#define SPEC_GENERIC                                                                                         \
    "a structure of the generic type takes any level (Vulkan: VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR)"

#define UPDATE VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR
#define COMPACTION VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR
#define REFIT GN_CTS_STEP_REFIT
#define REFIT_COPY GN_CTS_STEP_REFIT_COPY
#define COMPACT GN_CTS_STEP_COMPACT
#define CLONE GN_CTS_STEP_CLONE
#define SERIALIZE GN_CTS_STEP_SERIALIZE

struct params {
    VkBuildAccelerationStructureFlagsKHR flags;
    uint8_t steps[GN_CTS_MAX_STEPS];
    VkBuildAccelerationStructureFlagsKHR tlas_flags;
    uint8_t tlas_steps[GN_CTS_MAX_STEPS];
    bool generic, tlas_generic;
    bool boxes;
    bool source; /* is traced, rather than the copy */
    bool inactive; /* some triangles of one BLAS */
};

enum { BLASES = 5, RUNGS = 20 };

static void steps_take(uint8_t *to, const uint8_t *from)
{
    for (uint32_t s = 0; s < GN_CTS_MAX_STEPS; s++)
        to[s] = from[s];
}

/* From one triangle to thousands, so that first, middle and last primitives lie in one node or far apart. */
static struct gn_cts_geometry *meshes(struct gn_case_run *run, const struct params *params, uint32_t blas,
                                      uint32_t *out_count)
{
    struct gn_arena *arena = &run->arena;
    struct gn_random *random = &run->random;
    *out_count = blas == 3 ? 4 : 1;
    struct gn_cts_geometry *geometries = GN_NEW(arena, struct gn_cts_geometry, *out_count);
    for (uint32_t g = 0; g < *out_count; g++) {
        struct gn_mesh mesh = blas == 0   ? gn_mesh_triangle(arena)
                              : blas == 1 ? gn_mesh_quad(arena)
                              : blas == 2 ? gn_mesh_height_field(arena, random, 40, 0.2)
                                          : gn_mesh_blob(arena, random, 6 + g, 9, 0.2);
        if (blas == 4 && params->inactive) {
            mesh = gn_mesh_unshared(arena, &mesh);
            gn_mesh_deactivate(random, &mesh, 0.2);
        }
        geometries[g] = gn_geometry_of_mesh(&mesh);
        geometries[g].flags = VK_GEOMETRY_OPAQUE_BIT_KHR;
        geometries[g].index_none = g == 1;
        if (g == 2) {
            float *transform = GN_NEW(arena, float, 12);
            gn_transform_random(random, 0.5, 1, 1, true, transform);
            geometries[g].transform = transform;
        }
        if (gn_steps_take_both(params->steps))
            geometries[g].initial_positions = gn_mesh_moved(arena, random, &mesh, 0.4);
    }
    return geometries;
}

static void copy(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    struct gn_arena *arena = &run->arena;
    struct gn_random *random = &run->random;
    uint32_t blas_count = params->boxes ? 1 : BLASES, instance_count = params->boxes ? 1 : 2 * BLASES;
    struct gn_cts_blas *blases = GN_NEW(arena, struct gn_cts_blas, blas_count);
    struct gn_cts_instance *instances = GN_NEW(arena, struct gn_cts_instance, instance_count);
    struct gn_cts_instance *initial = GN_NEW(arena, struct gn_cts_instance, instance_count);
    const float(*ladder)[6] = gn_ladder_make(arena, random, RUNGS, 0.5);
    float(*other_boxes)[6] = gn_arena_alloc(arena, RUNGS, sizeof *other_boxes);
    for (uint32_t i = 0; i < RUNGS; i++)
        memcpy(other_boxes[i], ladder[RUNGS - 1 - i], sizeof other_boxes[i]);
    struct gn_cts_geometry box_geometry = {.type = GN_REF_AABBS,
                                           .aabbs = ladder,
                                           .aabb_count = RUNGS,
                                           .initial_aabbs = (const float(*)[6])other_boxes};
    for (uint32_t b = 0; b < blas_count; b++) {
        uint32_t count = 1;
        const struct gn_cts_geometry *geometries =
            params->boxes ? &box_geometry : meshes(run, params, b, &count);
        blases[b] = (struct gn_cts_blas){.geometries = geometries,
                                         .geometry_count = count,
                                         .build_flags = params->flags,
                                         .generic = params->generic};
        steps_take(blases[b].steps, params->steps);
    }
    for (uint32_t i = 0; i < instance_count; i++) {
        instances[i] = gn_instance_of(i % blas_count, NULL);
        if (!params->boxes)
            gn_transform_random(random, 0.6, 1.2, 2, i % 3 == 2, instances[i].transform);
        instances[i].custom_index = gn_random_below(random, 1u << 24);
        instances[i].sbt_offset = gn_random_below(random, 1u << 24);
        initial[i] = instances[i];
        gn_transform_random(random, 0.6, 1.2, 2, false, initial[i].transform);
    }
    struct gn_cts_scene scene = gn_scene_make(blases, blas_count, instances, instance_count);
    scene.tlas_build_flags = params->tlas_flags;
    scene.tlas_generic = params->tlas_generic;
    scene.keep_sources = params->source;
    scene.initial_instances = gn_steps_take_both(params->tlas_steps) ? initial : NULL;
    steps_take(scene.tlas_steps, params->tlas_steps);

    uint32_t count = gn_ray_count(run, 8192);
    struct gn_cts_ray *rays = GN_NEW(arena, struct gn_cts_ray, count);
    if (params->boxes)
        gn_ladder_rays(random, ladder, RUNGS, true, rays, count);
    else
        gn_rays_at_scene(run, &scene, 2.5, true, rays, count);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* The first thing in serialized data, so that whoever stores them knows whose they are. */
static void head(struct gn_case_run *run, const struct gn_case *self)
{
    (void)self;
    struct gn_mesh mesh = gn_mesh_octahedron(&run->arena, 1);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    struct gn_cts_blas blas = {.geometries = &geometry, .geometry_count = 1, .steps = {SERIALIZE}};
    struct gn_cts_instance instance = gn_instance_of(0, NULL);
    struct gn_cts_scene scene = gn_scene_make(&blas, 1, &instance, 1);
    scene.tlas_steps[0] = SERIALIZE;
    struct gn_built_scene *built = NULL;
    const enum gn_device_status status = gn_scene_build(run->device, &scene, &built);
    if (gn_case_check(run, status == GN_DEVICE_OK, "%s", gn_device_message(run->device))) {
        const uint32_t foreign = gn_built_scene_info(built).foreign_heads;
        gn_case_check(run, foreign == 0, "%u of 2 structures begin with another UUID than the driverUUID, serialized",
                      foreign);
    }
    gn_built_scene_destroy(built);
}

#define CASE(label, spec, ...)                                                                               \
    {                                                                                                        \
        "copy." label, spec, copy, &(const struct params){__VA_ARGS__}, 0                                    \
    }
#define SOURCE(label, bits, ...)                                                                             \
    CASE("source_kept." label, SPEC_SOURCE, .flags = bits, .steps = {__VA_ARGS__}, .tlas_flags = bits,       \
         .tlas_steps = {__VA_ARGS__}, .source = true)
static const struct gn_case cases[] = {
    CASE("none",
         "what the copies are compared with: the same scenes without one (Vulkan: Building Acceleration "
         "Structures)",
         0),
    CASE("compact.blas", SPEC_COMPACT, .flags = COMPACTION, .steps = {COMPACT}),
    CASE("compact.tlas", SPEC_COMPACT, .tlas_flags = COMPACTION, .tlas_steps = {COMPACT}),
    CASE("compact.both", SPEC_COMPACT, .flags = COMPACTION, .steps = {COMPACT}, .tlas_flags = COMPACTION,
         .tlas_steps = {COMPACT}),
    CASE("compact.boxes", SPEC_COMPACT, .flags = COMPACTION, .steps = {COMPACT}, .boxes = true),
    CASE("clone.blas", SPEC_CLONE, .steps = {CLONE}),
    CASE("clone.tlas", SPEC_CLONE, .tlas_steps = {CLONE}),
    CASE("clone.both", SPEC_CLONE, .steps = {CLONE}, .tlas_steps = {CLONE}),
    CASE("clone.boxes", SPEC_CLONE, .steps = {CLONE}, .boxes = true),
    CASE("serialize.blas", SPEC_SERIALIZE, .steps = {SERIALIZE}),
    CASE("serialize.tlas", SPEC_SERIALIZE, .tlas_steps = {SERIALIZE}),
    CASE("serialize.both", SPEC_SERIALIZE, .steps = {SERIALIZE}, .tlas_steps = {SERIALIZE}),
    CASE("serialize.boxes", SPEC_SERIALIZE, .steps = {SERIALIZE}, .boxes = true),
    {"copy.head", "serialized data begin with the driverUUID (Vulkan: vkCmdCopyAccelerationStructureToMemoryKHR)", head, NULL,
     0},
    SOURCE("clone", 0, CLONE),
    SOURCE("compact", COMPACTION, COMPACT),
    SOURCE("serialize", 0, SERIALIZE),
    SOURCE("refit_copy", UPDATE, REFIT_COPY, REFIT),
    CASE("source_kept.boxes", SPEC_SOURCE, .flags = COMPACTION, .steps = {CLONE, COMPACT, SERIALIZE}, .boxes = true,
         .source = true),
    CASE("over.clone", SPEC_OVER, .steps = {GN_CTS_STEP_CLONE_OVER}, .tlas_steps = {GN_CTS_STEP_CLONE_OVER}),
    CASE("over.clone_boxes", SPEC_OVER, .steps = {GN_CTS_STEP_CLONE_OVER}, .boxes = true),
    CASE("over.serialize", SPEC_OVER, .steps = {GN_CTS_STEP_SERIALIZE_OVER},
         .tlas_steps = {GN_CTS_STEP_SERIALIZE_OVER}),
    CASE("over.serialize_boxes", SPEC_OVER, .steps = {GN_CTS_STEP_SERIALIZE_OVER}, .boxes = true),
    CASE("over.refitted", SPEC_OVER, .flags = UPDATE, .steps = {REFIT, GN_CTS_STEP_SERIALIZE_OVER, GN_CTS_STEP_CLONE_OVER},
         .tlas_flags = UPDATE, .tlas_steps = {REFIT, GN_CTS_STEP_CLONE_OVER, GN_CTS_STEP_SERIALIZE_OVER}),
    CASE("over.compacted", SPEC_OVER, .flags = COMPACTION, .steps = {COMPACT, GN_CTS_STEP_SERIALIZE_OVER},
         .tlas_flags = COMPACTION, .tlas_steps = {COMPACT, GN_CTS_STEP_SERIALIZE_OVER}),
    CASE("relocated.plain", SPEC_RELOCATE, .tlas_steps = {GN_CTS_STEP_RELOCATE}),
    CASE("relocated.boxes", SPEC_RELOCATE, .tlas_steps = {GN_CTS_STEP_RELOCATE}, .boxes = true),
    CASE("relocated.twice", SPEC_RELOCATE, .tlas_steps = {GN_CTS_STEP_RELOCATE, CLONE, GN_CTS_STEP_RELOCATE}),
    CASE("relocated.compacted", SPEC_RELOCATE, .flags = COMPACTION, .steps = {COMPACT}, .tlas_flags = COMPACTION,
         .tlas_steps = {COMPACT, GN_CTS_STEP_RELOCATE}),
    CASE("relocated.updated", SPEC_RELOCATE, .tlas_flags = UPDATE, .tlas_steps = {REFIT, GN_CTS_STEP_RELOCATE}),
    CASE("chain.compact_clone", SPEC_CHAIN, .flags = COMPACTION, .steps = {COMPACT, CLONE},
         .tlas_flags = COMPACTION, .tlas_steps = {COMPACT, CLONE}),
    CASE("chain.clone_compact", SPEC_CHAIN, .flags = COMPACTION, .steps = {CLONE, COMPACT},
         .tlas_flags = COMPACTION, .tlas_steps = {CLONE, COMPACT}),
    CASE("chain.serialize_clone_serialize", SPEC_CHAIN, .steps = {SERIALIZE, CLONE, SERIALIZE},
         .tlas_steps = {SERIALIZE, CLONE, SERIALIZE}),
    CASE("chain.compact_serialize", SPEC_CHAIN, .flags = COMPACTION, .steps = {COMPACT, SERIALIZE},
         .tlas_flags = COMPACTION, .tlas_steps = {COMPACT, SERIALIZE}),
    CASE("chain.boxes", SPEC_CHAIN, .flags = COMPACTION, .steps = {CLONE, COMPACT, SERIALIZE}, .boxes = true),
    CASE("refit.compact", SPEC_CHAIN, .flags = COMPACTION | UPDATE, .steps = {REFIT, COMPACT},
         .tlas_flags = COMPACTION | UPDATE, .tlas_steps = {REFIT, COMPACT}),
    CASE("refit.compacted",
         "a compacted structure can be updated (Vulkan: vkCmdBuildAccelerationStructuresKHR, pInfos-10126)",
         .flags = COMPACTION | UPDATE, .steps = {COMPACT, REFIT}, .tlas_flags = COMPACTION | UPDATE,
         .tlas_steps = {COMPACT, REFIT}),
    CASE("refit.clone", SPEC_CHAIN, .flags = UPDATE, .steps = {CLONE, REFIT, CLONE}, .tlas_flags = UPDATE,
         .tlas_steps = {CLONE, REFIT, CLONE}),
    CASE("refit.serialize", SPEC_CHAIN, .flags = UPDATE, .steps = {SERIALIZE, REFIT_COPY, SERIALIZE},
         .tlas_flags = UPDATE, .tlas_steps = {SERIALIZE, REFIT, SERIALIZE}),
    CASE(
        "inactive",
        "inactive primitives are none the less counted in a copy (Vulkan: Inactive Primitives and Instances)",
        .flags = COMPACTION, .steps = {COMPACT, CLONE, SERIALIZE}, .inactive = true),
    CASE("generic.blas", SPEC_GENERIC, .generic = true),
    CASE("generic.tlas", SPEC_GENERIC, .tlas_generic = true),
    CASE("generic.copied", SPEC_GENERIC, .flags = COMPACTION, .steps = {COMPACT, CLONE, SERIALIZE},
         .tlas_flags = COMPACTION, .tlas_steps = {COMPACT, CLONE, SERIALIZE}, .generic = true,
         .tlas_generic = true),
};
const struct gn_case_family gn_family_copy = {"copy", cases, sizeof cases / sizeof cases[0]};
