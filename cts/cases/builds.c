/* SPDX-License-Identifier: Apache-2.0 */
/* Builds and copies by other commands than those of a command buffer: indirect, on the host, deferred; mixtures; batches. */
#include <string.h>

#include "cts/sample.h"

#define SPEC_INDIRECT                                                                                        \
    "an indirect build takes counts and offsets from memory, counts up to those that it was told (Vulkan: "   \
    "vkCmdBuildAccelerationStructuresIndirectKHR)"
#define SPEC_HOST                                                                                            \
    "host commands are functionally equivalent to their device counterparts (Vulkan: Host Acceleration Structure " \
    "Operations)"
#define SPEC_DEFERRED                                                                                        \
    "a deferred operation completes once threads have joined it, with the result of the command (Vulkan: Deferred " \
    "Host Operations)"
#define SPEC_MIXED                                                                                           \
    "host and device operations are interchangeable (Vulkan: Host Acceleration Structure Operations)"

#define SPEC_UPDATE                                                                                          \
    "an update takes offsets, strides and pointers as a build does (Vulkan: "                                \
    "VkAccelerationStructureBuildRangeInfoKHR)"
#define SPEC_BATCH                                                                                           \
    "one call builds any number of structures, one call asks for any number of sizes (Vulkan: " \
    "vkCmdBuildAccelerationStructuresKHR, vkCmdWriteAccelerationStructuresPropertiesKHR)"

#define UPDATE VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR
#define COMPACTION VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR

struct params {
    struct gn_sample_options sample;
    enum gn_cts_commands blas_builds, tlas_builds, copies;
    bool pointers, separate;
    uint32_t instance_offset;
};

static void commands_take(const struct params *params, struct gn_cts_scene *scene)
{
    scene->blas_builds = params->blas_builds;
    scene->tlas_builds = params->tlas_builds;
    scene->copies = params->copies;
    scene->array_of_pointers = params->pointers;
    scene->separate_builds = params->separate;
    scene->instance_offset = params->instance_offset;
}

static void builds(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    struct gn_sample sample;
    gn_sample_make(run, &params->sample, &sample);
    commands_take(params, &sample.scene);
    gn_case_trace(run, &sample.scene, GN_CTS_COMMITTED, sample.rays, sample.ray_count, 0);
}

/* Every offset and stride that a build range and a geometry have; `value` is firstVertex. */
static void offsets(struct gn_case_run *run, const struct gn_case *self)
{
    enum { GEOMETRIES = 4 };
    const struct params *params = self->params;
    struct gn_arena *arena = &run->arena;
    struct gn_cts_geometry geometries[GEOMETRIES];
    for (uint32_t g = 0; g < GEOMETRIES; g++) {
        struct gn_mesh mesh = gn_mesh_blob(arena, &run->random, 5 + g, 8, 0.2);
        mesh = gn_mesh_scaled(arena, &mesh, 0.4, 0.4, 0.4, g - 1.5, 0, 0);
        geometries[g] = gn_geometry_of_mesh(&mesh);
        geometries[g].flags = VK_GEOMETRY_OPAQUE_BIT_KHR;
        geometries[g].vertex_stride = 12 + 8 * g;
        geometries[g].vertex_offset = 4 * g;
        geometries[g].first_vertex = (uint32_t)self->value * g;
        geometries[g].index_none = g == 2;
        geometries[g].index_uint32 = g == 1;
        geometries[g].primitive_offset = 12 * g;
        if (params->sample.flags & UPDATE)
            geometries[g].initial_positions = gn_mesh_moved(arena, &run->random, &mesh, 0.5);
        if (g % 2) {
            float *transform = GN_NEW(arena, float, 12);
            gn_transform_random(&run->random, 0.7, 1.2, 1, g == 3, transform);
            geometries[g].transform = transform;
            geometries[g].transform_offset = 16 * g;
        }
    }
    struct gn_cts_scene scene = gn_scene_placed(run, geometries, GEOMETRIES);
    struct gn_cts_blas blas = scene.blases[0];
    blas.build_flags = params->sample.flags;
    memcpy(blas.steps, params->sample.steps, sizeof blas.steps);
    scene.blases = &blas;
    commands_take(params, &scene);
    const uint32_t count = gn_ray_count(run, 4096);
    struct gn_cts_ray *rays = GN_NEW(arena, struct gn_cts_ray, count);
    gn_rays_at_scene(run, &scene, 2.5, true, rays, count);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* Many small structures in one call, each unlike the others, each with an instance of its own in a grid. */
enum { BATCH = 300, ROW = 20 };

static void batch(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    struct gn_arena *arena = &run->arena;
    struct gn_cts_blas *blases = GN_NEW(arena, struct gn_cts_blas, BATCH);
    struct gn_cts_instance *instances = GN_NEW(arena, struct gn_cts_instance, BATCH);
    for (uint32_t b = 0; b < BATCH; b++) {
        struct gn_cts_geometry *geometry = GN_NEW(arena, struct gn_cts_geometry, 1);
        struct gn_mesh mesh = gn_mesh_fan(arena, &run->random, 3 + b % 29, 0.5);
        *geometry = gn_geometry_of_mesh(&mesh);
        geometry->flags = b % 3 ? VK_GEOMETRY_OPAQUE_BIT_KHR : 0;
        geometry->index_none = b % 2;
        geometry->initial_positions = gn_mesh_moved(arena, &run->random, &mesh, 0.3);
        blases[b] = (struct gn_cts_blas){.geometries = geometry, .geometry_count = 1, .build_flags = params->sample.flags};
        for (uint32_t s = 0; s < GN_CTS_MAX_STEPS; s++)
            blases[b].steps[s] = params->sample.steps[s];
        instances[b] = gn_instance_of(b, NULL);
        gn_instance_place(&instances[b], 2.5 * (b % ROW), 2.5 * (b / ROW), 0);
        instances[b].custom_index = 1000 + b;
    }
    struct gn_cts_scene scene = gn_scene_make(blases, BATCH, instances, BATCH);
    commands_take(params, &scene);
    const uint32_t count = gn_ray_count(run, 6000);
    struct gn_cts_ray *rays = GN_NEW(arena, struct gn_cts_ray, count);
    gn_rays_at_scene(run, &scene, 2, true, rays, count);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

#define BATCHED(label, way, copied, bits, ...)                                                               \
    {                                                                                                        \
        "builds.batch." label, SPEC_BATCH, batch,                                                            \
            &(const struct params){.sample = {.flags = bits, .steps = {__VA_ARGS__}}, .blas_builds = way, .copies = copied}, \
            0                                                                                                \
    }
#define CASE(label, spec, blas, tlas, copied, kind, bits, list, ...)                                         \
    {                                                                                                        \
        "builds." label, spec, builds,                                                                       \
            &(const struct params){.sample = {.content = kind, .flags = bits, .steps = list},                \
                                   .blas_builds = blas, .tlas_builds = tlas, .copies = copied, __VA_ARGS__}, 0 \
    }
#define STEPS(...) {__VA_ARGS__}
#define OFFSETS(label, spec, way, first)                                                                     \
    {                                                                                                        \
        "builds." label, spec, offsets, &(const struct params){.blas_builds = way, .tlas_builds = way}, first \
    }
#define UPDATED(label, step, first)                                                                          \
    {                                                                                                        \
        "builds.device." label, SPEC_UPDATE, offsets,                                                        \
            &(const struct params){.sample = {.flags = UPDATE, .steps = {step}}}, first                      \
    }
/* What every way of building has to be able to do. */
#define WAY(name, spec, way, copied)                                                                         \
    CASE(name ".meshes", spec, way, way, copied, GN_SAMPLE_MESHES, 0, STEPS(0), .separate = false),           \
        CASE(name ".separate", spec, way, way, copied, GN_SAMPLE_NOT_OPAQUE, 0, STEPS(0), .separate = true),  \
        CASE(name ".boxes", spec, way, way, copied, GN_SAMPLE_BOXES, 0, STEPS(0), .separate = false),         \
        CASE(name ".mixed", spec, way, way, copied, GN_SAMPLE_MIXED, 0, STEPS(0), .separate = false),         \
        CASE(name ".instance_offset", spec, way, way, copied, GN_SAMPLE_MIXED, 0, STEPS(0), .instance_offset = 64), \
        CASE(name ".pointers", spec, way, way, copied, GN_SAMPLE_MIXED, 0, STEPS(0), .pointers = true),       \
        CASE(name ".refit", spec, way, way, copied, GN_SAMPLE_MIXED, UPDATE, STEPS(GN_CTS_STEP_REFIT),        \
             .separate = false),                                                                             \
        CASE(name ".refit_copy", spec, way, way, copied, GN_SAMPLE_MIXED, UPDATE, STEPS(GN_CTS_STEP_REFIT_COPY), \
             .separate = false),                                                                             \
        CASE(name ".refit_chain", spec, way, way, copied, GN_SAMPLE_MESHES, UPDATE,                          \
             STEPS(GN_CTS_STEP_REFIT, GN_CTS_STEP_REFIT_BACK, GN_CTS_STEP_REFIT_COPY), .pointers = true),     \
        CASE(name ".rebuild", spec, way, way, copied, GN_SAMPLE_MIXED, 0, STEPS(GN_CTS_STEP_REBUILD),         \
             .separate = false),                                                                             \
        CASE(name ".compact", spec, way, way, copied, GN_SAMPLE_MIXED, COMPACTION, STEPS(GN_CTS_STEP_COMPACT), \
             .separate = false),                                                                             \
        CASE(name ".clone", spec, way, way, copied, GN_SAMPLE_MIXED, 0, STEPS(GN_CTS_STEP_CLONE),             \
             .separate = false),                                                                             \
        CASE(name ".serialize", spec, way, way, copied, GN_SAMPLE_MIXED, 0, STEPS(GN_CTS_STEP_SERIALIZE),     \
             .separate = false),                                                                             \
        CASE(name ".over", spec, way, way, copied, GN_SAMPLE_MESHES, 0,                                      \
             STEPS(GN_CTS_STEP_CLONE_OVER, GN_CTS_STEP_SERIALIZE_OVER), .separate = false),                   \
        OFFSETS(name ".offsets", spec, way, 0), OFFSETS(name ".first_vertex", spec, way, 7)

#define EVERYTHING STEPS(GN_CTS_STEP_REFIT, GN_CTS_STEP_COMPACT, GN_CTS_STEP_CLONE, GN_CTS_STEP_SERIALIZE)
#define MIXTURE(label, blas, tlas, copied)                                                                   \
    CASE("mixed." label, SPEC_MIXED, blas, tlas, copied, GN_SAMPLE_MIXED, UPDATE | COMPACTION, EVERYTHING,    \
         .separate = false)

static const struct gn_case cases[] = {
    WAY("indirect", SPEC_INDIRECT, GN_CTS_INDIRECT, GN_CTS_ON_DEVICE),
    WAY("host", SPEC_HOST, GN_CTS_ON_HOST, GN_CTS_ON_HOST),
    WAY("deferred", SPEC_DEFERRED, GN_CTS_DEFERRED, GN_CTS_DEFERRED),
    UPDATED("refit_offsets", GN_CTS_STEP_REFIT, 0),
    UPDATED("refit_copy_offsets", GN_CTS_STEP_REFIT_COPY, 0),
    UPDATED("refit_first_vertex", GN_CTS_STEP_REFIT, 7),
    CASE("device.refit_pointers", SPEC_UPDATE, GN_CTS_ON_DEVICE, GN_CTS_ON_DEVICE, GN_CTS_ON_DEVICE, GN_SAMPLE_MESHES,
         UPDATE, STEPS(GN_CTS_STEP_REFIT, GN_CTS_STEP_REFIT_COPY), .pointers = true),
    CASE("device.refit_instance_offset", SPEC_UPDATE, GN_CTS_ON_DEVICE, GN_CTS_ON_DEVICE, GN_CTS_ON_DEVICE,
         GN_SAMPLE_MESHES, UPDATE, STEPS(GN_CTS_STEP_REFIT), .instance_offset = 64),
    BATCHED("built", GN_CTS_ON_DEVICE, GN_CTS_ON_DEVICE, 0, 0),
    BATCHED("compact", GN_CTS_ON_DEVICE, GN_CTS_ON_DEVICE, COMPACTION, GN_CTS_STEP_COMPACT),
    BATCHED("serialize", GN_CTS_ON_DEVICE, GN_CTS_ON_DEVICE, 0, GN_CTS_STEP_SERIALIZE),
    BATCHED("refit", GN_CTS_ON_DEVICE, GN_CTS_ON_DEVICE, UPDATE, GN_CTS_STEP_REFIT, GN_CTS_STEP_CLONE),
    BATCHED("indirect", GN_CTS_INDIRECT, GN_CTS_ON_DEVICE, 0, 0),
    BATCHED("host", GN_CTS_ON_HOST, GN_CTS_ON_HOST, COMPACTION, GN_CTS_STEP_COMPACT),
    MIXTURE("bottom_on_host", GN_CTS_ON_HOST, GN_CTS_ON_DEVICE, GN_CTS_ON_DEVICE),
    MIXTURE("top_on_host", GN_CTS_ON_DEVICE, GN_CTS_ON_HOST, GN_CTS_ON_DEVICE),
    MIXTURE("copies_on_host", GN_CTS_ON_DEVICE, GN_CTS_ON_DEVICE, GN_CTS_ON_HOST),
    MIXTURE("copies_deferred", GN_CTS_INDIRECT, GN_CTS_ON_HOST, GN_CTS_DEFERRED),
    MIXTURE("copies_on_device", GN_CTS_DEFERRED, GN_CTS_ON_HOST, GN_CTS_ON_DEVICE),
};
const struct gn_case_family gn_family_builds = {"builds", cases, sizeof cases / sizeof cases[0]};
