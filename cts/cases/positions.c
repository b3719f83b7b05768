/* SPDX-License-Identifier: Apache-2.0 */
/* The vertex positions of the triangle that was hit. */
#include "cts/compose.h"

#define SPEC                                                                                                 \
    "the positions are those of the triangle's vertices in object space, in the application's order, after " \
    "the "                                                                                                   \
    "geometry transform and before the instance's (VK_KHR_ray_tracing_position_fetch; Vulkan: "              \
    "HitTriangleVertexPositionsKHR)"
#define SPEC_TRANSFORM                                                                                       \
    "the geometry transform is applied to them at standard floating-point precision, in no given order of "  \
    "operations (Vulkan: HitTriangleVertexPositionsKHR)"
#define SPEC_FLAG                                                                                            \
    "what ALLOW_DATA_ACCESS gives survives copies and updates (Vulkan: "                                     \
    "VkBuildAccelerationStructureFlagBitsKHR; Copying Acceleration Structures)"

#define DATA VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_DATA_ACCESS_KHR
#define UPDATE VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR
#define COMPACTION VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR

struct params {
    VkFormat format;
    bool flat;
    bool none; /* no indices */
    bool transforms;
    bool mirrored;
    bool not_opaque;
    bool refusals; /* some candidates are not confirmed */
    bool from_candidate;
    uint32_t geometries; /* 0: one */
    uint32_t first_vertex, vertex_offset, primitive_offset, stride;
    VkBuildAccelerationStructureFlagsKHR flags;
    uint8_t steps[GN_CTS_MAX_STEPS];
};

static void positions(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    struct gn_arena *arena = &run->arena;
    if (run->device && !gn_device_info(run->device)->position_fetch) {
        gn_case_skip(run, "the device has no VK_KHR_ray_tracing_position_fetch");
        return;
    }
    if (run->device && params->format != VK_FORMAT_UNDEFINED && !gn_device_has_vertex_format(run->device, params->format)) {
        gn_case_skip(run, "the device does not take VkFormat %d as a vertex format", (int)params->format);
        return;
    }
    uint32_t geometry_count = params->geometries ? params->geometries : 1;
    struct gn_cts_geometry *geometries = GN_NEW(arena, struct gn_cts_geometry, geometry_count);
    for (uint32_t g = 0; g < geometry_count; g++) {
        struct gn_mesh mesh = params->flat ? gn_mesh_flat(arena, &run->random, 12)
                              : g % 2      ? gn_mesh_blob(arena, &run->random, 8, 10 + g, 0.25)
                                           : gn_mesh_height_field(arena, &run->random, 12, 0.5);
        struct gn_cts_geometry *geometry = &geometries[g];
        *geometry = gn_geometry_of_mesh(&mesh);
        geometry->flags = params->not_opaque ? 0 : VK_GEOMETRY_OPAQUE_BIT_KHR;
        geometry->vertex_format = params->format;
        geometry->vertex_stride = params->stride;
        geometry->vertex_offset = params->vertex_offset;
        geometry->first_vertex = params->first_vertex;
        geometry->primitive_offset = params->primitive_offset;
        geometry->index_none = params->none;
        geometry->index_uint32 = g % 2;
        if (params->transforms && g % 3 != 1) {
            float *transform = GN_NEW(arena, float, 12);
            gn_transform_random(&run->random, 0.5, 1.5, 1, params->mirrored, transform);
            geometry->transform = transform;
        }
        if (params->flags & UPDATE)
            geometry->initial_positions = gn_mesh_moved(arena, &run->random, &mesh, 0.5);
    }
    struct gn_cts_blas blas = {
        .geometries = geometries, .geometry_count = geometry_count, .build_flags = params->flags | DATA};
    for (uint32_t s = 0; s < GN_CTS_MAX_STEPS; s++)
        blas.steps[s] = params->steps[s];
    struct gn_cts_instance instances[3];
    for (uint32_t i = 0; i < 3; i++) {
        instances[i] = gn_instance_of(0, NULL);
        gn_transform_random(&run->random, 0.75, 1.5, 3, i == 2, instances[i].transform);
    }
    struct gn_cts_scene scene = gn_scene_make(&blas, 1, instances, 3);
    uint32_t count = gn_ray_count(run, 12288);
    struct gn_cts_ray *rays = GN_NEW(arena, struct gn_cts_ray, count);
    gn_rays_at_scene(run, &scene, 2, true, rays, count);
    for (uint32_t i = 0; i < count && params->refusals; i++)
        rays[i].policy.confirm_mask = (uint32_t)gn_random_u64(&run->random);
    run->route.from_candidate = params->from_candidate;
    for (uint32_t i = 0; i < count && params->from_candidate; i++)
        rays[i].ray.flags |= GN_REF_RAY_TERMINATE_ON_FIRST_HIT;
    gn_case_trace(run, &scene, GN_CTS_POSITIONS, rays, count, 0);
}

#define CASE(label, spec, ...)                                                                               \
    {                                                                                                        \
        "positions." label, spec, positions, &(const struct params){__VA_ARGS__}, 0                          \
    }
static const struct gn_case cases[] = {
    CASE("plain", SPEC, .flags = 0),
    CASE("without_indices", SPEC, .none = true),
    CASE("not_opaque", SPEC, .not_opaque = true),
    CASE("refusals", SPEC, .not_opaque = true, .refusals = true),
    CASE("candidate", SPEC, .not_opaque = true, .from_candidate = true),
    CASE("candidate_mirrored", SPEC_TRANSFORM, .not_opaque = true, .from_candidate = true, .transforms = true,
         .mirrored = true),
    CASE("several_geometries", SPEC, .geometries = 7),
    CASE("offsets", SPEC, .vertex_offset = 20, .primitive_offset = 24, .stride = 28),
    CASE("transforms", SPEC_TRANSFORM, .transforms = true),
    CASE("mirrored_transforms", SPEC_TRANSFORM, .transforms = true, .mirrored = true),
    CASE("several_transforms", SPEC_TRANSFORM, .transforms = true, .geometries = 6),
    CASE("format.r32g32_sfloat", SPEC, .format = VK_FORMAT_R32G32_SFLOAT, .flat = true),
    CASE("format.r16g16b16a16_sfloat", SPEC, .format = VK_FORMAT_R16G16B16A16_SFLOAT),
    CASE("format.r16g16_sfloat", SPEC, .format = VK_FORMAT_R16G16_SFLOAT, .flat = true),
    CASE("format.r16g16b16a16_snorm", SPEC, .format = VK_FORMAT_R16G16B16A16_SNORM),
    CASE("format.r16g16_snorm", SPEC, .format = VK_FORMAT_R16G16_SNORM, .flat = true),
    CASE("format.transformed_snorm", SPEC_TRANSFORM, .format = VK_FORMAT_R16G16B16A16_SNORM,
         .transforms = true),
    CASE("compacted", SPEC_FLAG, .flags = COMPACTION, .steps = {GN_CTS_STEP_COMPACT}),
    CASE("cloned", SPEC_FLAG, .steps = {GN_CTS_STEP_CLONE}),
    CASE("serialized", SPEC_FLAG, .steps = {GN_CTS_STEP_SERIALIZE}),
    CASE("updated", SPEC_FLAG, .transforms = true, .flags = UPDATE, .steps = {GN_CTS_STEP_REFIT}),
    CASE("updated_and_compacted", SPEC_FLAG, .flags = UPDATE | COMPACTION,
         .steps = {GN_CTS_STEP_REFIT_COPY, GN_CTS_STEP_COMPACT, GN_CTS_STEP_REFIT}),
};
const struct gn_case_family gn_family_positions = {"positions", cases, sizeof cases / sizeof cases[0]};
