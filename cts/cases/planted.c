/* SPDX-License-Identifier: Apache-2.0 */
/* What no other case met when faults were planted into a driver (tests/faulty): the places where one line goes wrong. */
#include "cts/compose.h"

#include <math.h>
#include <string.h>

#include "cts/mesh_case.h"

#define UPDATE VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR
#define OPAQUE VK_GEOMETRY_OPAQUE_BIT_KHR

static void trace(struct gn_case_run *run, const struct gn_cts_scene *scene, uint32_t confirm_mask, uint32_t base)
{
    const uint32_t count = gn_ray_count(run, base);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_rays_at_scene(run, scene, 3, true, rays, count);
    for (uint32_t i = 0; i < count; i++)
        rays[i].policy.confirm_mask = confirm_mask;
    gn_case_trace(run, scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* Each primitive about a power of 256 has rays of its own. */
static void primitive_ids(struct gn_case_run *run, const struct gn_case *self)
{
    static const uint32_t places[] = {0, 254, 255, 256, 257, 32767, 32768, 65534, 65535, 65536, 65537, 65791, 65792};
    struct gn_mesh mesh = gn_mesh_height_field(&run->arena, &run->random, 184, 0.1);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = OPAQUE;
    geometry.index_none = self->value;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    const uint32_t each = gn_ray_count(run, 256), count = each * (sizeof places / sizeof places[0]);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    for (uint32_t p = 0; p < sizeof places / sizeof places[0]; p++) {
        const struct gn_aim_options options = {.first_triangle = places[p], .triangle_count = 1};
        gn_rays_aimed_with(&run->random, &mesh, &options, rays + p * each, each);
    }
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, each);
}

/* Coordinates that are subnormal as halves, made visible by the instance. */
static void subnormal_halves(struct gn_case_run *run, const struct gn_case *self)
{
    const VkFormat format = (VkFormat)self->value;
    const bool flat = format == VK_FORMAT_R16G16_SFLOAT;
    if (!gn_device_has_vertex_format(run->device, format)) {
        gn_case_skip(run, "the driver does not take this vertex format");
        return;
    }
    struct gn_mesh mesh = flat ? gn_mesh_flat(&run->arena, &run->random, 8)
                               : gn_mesh_height_field(&run->arena, &run->random, 8, 0.5);
    const double small = 0x1p-15;
    mesh = gn_mesh_scaled(&run->arena, &mesh, small, small, small, 0, 0, 0);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.vertex_format = format;
    geometry.flags = OPAQUE;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    struct gn_cts_instance *instance = GN_NEW(&run->arena, struct gn_cts_instance, 1);
    *instance = scene.instances[0];
    gn_transform_scale(0x1p15, 0x1p15, 0x1p15, 0, 0, 0, instance->transform);
    scene.instances = instance;
    trace(run, &scene, UINT32_MAX, 4096);
}

/* The lowest integer means -1, as the one above it does. */
static void lowest_snorm(struct gn_case_run *run, const struct gn_case *self)
{
    const VkFormat format = (VkFormat)self->value;
    if (!gn_device_has_vertex_format(run->device, format)) {
        gn_case_skip(run, "the driver does not take this vertex format");
        return;
    }
    /* The border of the mesh lies beyond -1 and 1: the encoder takes the integers at the ends. */
    struct gn_mesh mesh = gn_mesh_flat(&run->arena, &run->random, 4);
    mesh = gn_mesh_scaled(&run->arena, &mesh, 1.25, 1.25, 1, 0, 0, 0);
    const bool tilted = format != VK_FORMAT_R16G16_SNORM && format != VK_FORMAT_R8G8_SNORM;
    for (uint32_t i = 0; i < mesh.position_count && tilted; i++)
        mesh.positions[i][2] = mesh.positions[i][0];
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.vertex_format = format;
    geometry.flags = OPAQUE;
    struct gn_cts_scene scene = gn_scene_placed(run, &geometry, 1);
    trace(run, &scene, UINT32_MAX, 4096);
}

/* An update says the same flags again; a driver has to keep them. */
static void update_flags(struct gn_case_run *run, const struct gn_case *self)
{
    struct gn_cts_geometry geometries[3];
    for (uint32_t g = 0; g < 3; g++) {
        struct gn_mesh mesh = gn_mesh_blob(&run->arena, &run->random, 4 + g, 7, 0.3);
        mesh = gn_mesh_scaled(&run->arena, &mesh, 0.4, 0.4, 0.4, g - 1.0, 0, 0);
        geometries[g] = gn_geometry_of_mesh(&mesh);
        geometries[g].initial_positions = gn_mesh_moved(&run->arena, &run->random, &mesh, 0.1);
        geometries[g].flags = g == 1 ? 0 : OPAQUE;
    }
    struct gn_cts_blas blas = {.geometries = geometries, .geometry_count = 3, .build_flags = UPDATE, .steps = {(uint8_t)self->value}};
    struct gn_cts_instance instance = gn_instance_of(0, NULL);
    struct gn_cts_scene scene = gn_scene_make(&blas, 1, &instance, 1);
    /* Those that are opaque are committed without being asked about. */
    trace(run, &scene, 0, 4096);
}

/* What an update made is what later steps go on with. */
struct steps {
    VkBuildAccelerationStructureFlagsKHR flags;
    uint8_t list[GN_CTS_MAX_STEPS];
};

static void after_update(struct gn_case_run *run, const struct gn_case *self)
{
    const struct steps *steps = self->params;
    struct gn_mesh mesh = gn_mesh_height_field(&run->arena, &run->random, 12, 0.4);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.initial_positions = gn_mesh_moved(&run->arena, &run->random, &mesh, 0.5);
    geometry.flags = OPAQUE;
    struct gn_cts_blas blas = {.geometries = &geometry, .geometry_count = 1, .build_flags = UPDATE | steps->flags};
    struct gn_cts_instance instances[4], initial[4];
    struct gn_cts_scene scene = gn_scene_make(&blas, 1, instances, 4);
    for (uint32_t i = 0; i < 4; i++) {
        instances[i] = gn_instance_of(0, NULL);
        initial[i] = gn_instance_of(0, NULL);
        gn_instance_place(&instances[i], 3.0 * i, 0, 0);
        gn_instance_place(&initial[i], 0, 40 + 3.0 * i, 0);
        instances[i].custom_index = 7 * i;
    }
    scene.initial_instances = initial;
    scene.tlas_build_flags = UPDATE | steps->flags;
    memcpy(blas.steps, steps->list, sizeof blas.steps);
    memcpy(scene.tlas_steps, steps->list, sizeof scene.tlas_steps);
    trace(run, &scene, UINT32_MAX, 4096);
}

/* One triangle without neighbours, inactive by one corner: `value` is the corner. Nothing is to be met. */
static void inactive_alone(struct gn_case_run *run, const struct gn_case *self)
{
    for (uint32_t trial = 0; trial < 8; trial++) {
        struct gn_mesh mesh = gn_mesh_triangle(&run->arena);
        double(*whole)[3] = gn_arena_alloc(&run->arena, 3, sizeof *whole);
        memcpy(whole, mesh.positions, 3 * sizeof *whole);
        const uint32_t corner = mesh.triangles[0][self->value];
        for (int a = 0; a < 3; a++)
            mesh.positions[corner][a] = NAN;
        struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
        geometry.flags = trial % 2 ? OPAQUE : 0;
        geometry.index_none = trial % 4 == 3;
        struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
        const uint32_t count = gn_ray_count(run, 512);
        struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
        for (uint32_t i = 0; i < count; i++) {
            /* Wherever the lost corner is taken to be: where it was, at 0, or anywhere. */
            double weight[3], sum = 0, origin[3], direction[3];
            const uint32_t guess = gn_random_below(&run->random, 3);
            for (int c = 0; c < 3; c++)
                sum += weight[c] = gn_random_range(&run->random, 0.1, 1);
            for (int a = 0; a < 3; a++) {
                double target = 0;
                for (uint32_t c = 0; c < 3; c++) {
                    const double at = c != corner || guess == 0 ? whole[c][a]
                                      : guess == 1              ? 0
                                                                : gn_random_range(&run->random, -2, 2);
                    target += weight[c] / sum * at;
                }
                direction[a] = gn_random_range(&run->random, -0.5, 0.5) - (a == 2);
                origin[a] = target - 3 * direction[a];
            }
            rays[i] = gn_ray_make(origin, direction, 100);
            rays[i].policy = (struct gn_ref_policy){.confirm_mask = UINT32_MAX};
        }
        gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
    }
}

/* Several geometries of boxes: their primitives count from 0 in each. */
static void box_geometries(struct gn_case_run *run, const struct gn_case *self)
{
    enum { PARTS = 4, EACH = 8 };
    (void)self;
    const float(*boxes)[6] = gn_ladder_make(&run->arena, &run->random, PARTS * EACH, 0.5);
    struct gn_cts_geometry geometries[PARTS];
    for (uint32_t g = 0; g < PARTS; g++)
        geometries[g] = (struct gn_cts_geometry){.type = GN_REF_AABBS,
                                                 .aabbs = boxes + EACH * g,
                                                 .aabb_count = EACH,
                                                 .aabb_stride = 24 + 8 * g,
                                                 .flags = g % 2 ? OPAQUE : 0};
    struct gn_cts_blas blas = {.geometries = geometries, .geometry_count = PARTS};
    struct gn_cts_instance instance = gn_instance_of(0, NULL);
    struct gn_cts_scene scene = gn_scene_make(&blas, 1, &instance, 1);
    const uint32_t count = gn_ray_count(run, 4096);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_rays_through(&run->random, 0, PARTS * EACH - 1, 1.5, rays, count);
    for (uint32_t i = 0; i < count; i++)
        rays[i].policy.generate_mask = 0;
    gn_case_trace(run, &scene, GN_CTS_CANDIDATES, rays, count, 0);
}

/* Pointers to instances that begin some way into their array. */
static void pointer_offset(struct gn_case_run *run, const struct gn_case *self)
{
    struct gn_mesh mesh = gn_mesh_octahedron(&run->arena, 2);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = OPAQUE;
    struct gn_cts_blas blas = {.geometries = &geometry, .geometry_count = 1};
    struct gn_cts_instance instances[9];
    struct gn_cts_scene scene = gn_scene_make(&blas, 1, instances, 9);
    for (uint32_t i = 0; i < 9; i++) {
        instances[i] = gn_instance_of(0, NULL);
        gn_instance_place(&instances[i], 3.0 * (i % 3), 3.0 * (i / 3), 0);
        instances[i].custom_index = 100 + i;
    }
    scene.array_of_pointers = true;
    scene.instance_offset = (uint32_t)self->value;
    trace(run, &scene, UINT32_MAX, 4096);
}

/* Addresses of indices and boxes that are aligned to no more than they have to be; strides beyond 16 bits. */
struct placed {
    bool boxes, wide_indices;
    uint32_t data_offset, stride;
};

static void placed(struct gn_case_run *run, const struct gn_case *self)
{
    enum { RUNGS = 12 };
    const struct placed *params = self->params;
    const float(*boxes)[6] = gn_ladder_make(&run->arena, &run->random, RUNGS, 0.5);
    struct gn_mesh mesh = gn_mesh_blob(&run->arena, &run->random, 4, 6, 0.3);
    struct gn_cts_geometry geometry = params->boxes
                                          ? (struct gn_cts_geometry){.type = GN_REF_AABBS, .aabbs = boxes, .aabb_count = RUNGS}
                                          : gn_geometry_of_mesh(&mesh);
    geometry.data_offset = params->data_offset;
    geometry.index_uint32 = params->wide_indices;
    geometry.aabb_stride = params->boxes ? params->stride : 0;
    geometry.vertex_stride = params->boxes ? 0 : params->stride;
    if (!params->boxes) {
        geometry.flags = OPAQUE;
        struct gn_cts_scene scene = gn_scene_placed(run, &geometry, 1);
        trace(run, &scene, UINT32_MAX, 2048);
        return;
    }
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    const uint32_t count = gn_ray_count(run, 2048);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_ladder_rays(&run->random, boxes, RUNGS, true, rays, count);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* What the device says of itself, against what is required of every implementation. */
static void limits_required(struct gn_case_run *run, const struct gn_case *self)
{
    const VkPhysicalDeviceAccelerationStructurePropertiesKHR *limits = &gn_device_info(run->device)->limits;
    const uint32_t alignment = limits->minAccelerationStructureScratchOffsetAlignment;
    const uint64_t list[][2] = {{limits->maxGeometryCount, (1u << 24) - 1},
                                {limits->maxInstanceCount, (1u << 24) - 1},
                                {limits->maxPrimitiveCount, (1u << 29) - 1}};
    if (self->value < sizeof list / sizeof list[0])
        gn_case_check(run, list[self->value][0] >= list[self->value][1], "the limit is %llu, at least %llu is required",
                      (unsigned long long)list[self->value][0], (unsigned long long)list[self->value][1]);
    else
        gn_case_check(run, alignment && alignment <= 256 && !(alignment & (alignment - 1)),
                      "the scratch alignment is %u, a power of two up to 256 is required", alignment);
}

#define SPEC_LIMITS                                                                                          \
    "limits are at least (the scratch alignment at most) what is required (Vulkan: Limits, Required Limits)"
#define SPEC_PLACED                                                                                          \
    "indices lie at any multiple of their size, boxes at any of 8 bytes, strides have 32 bits (Vulkan: " \
    "vkCmdBuildAccelerationStructuresKHR, pInfos-03712, pInfos-03714; VkAccelerationStructureGeometryTrianglesDataKHR)"
#define SPEC_IDS "a primitive's id is its place in its geometry (Vulkan: PrimitiveId; Geometry)"
#define SPEC_HALF                                                                                            \
    "vertices are the numbers that the format encodes, subnormal ones too (Vulkan: "                         \
    "VkAccelerationStructureGeometryTrianglesDataKHR, 16-bit floating point numbers)"
#define SPEC_SNORM                                                                                           \
    "the lowest signed integer is -1 (Vulkan: Conversion From Normalized Fixed-Point to Floating-Point)"
#define SPEC_UPDATE_FLAGS                                                                                    \
    "an update leaves the geometries' flags what they were (Vulkan: vkCmdBuildAccelerationStructuresKHR)"
#define SPEC_AFTER "what is made from an updated structure is what the update made (Vulkan: Copying Acceleration Structures)"
#define SPEC_INACTIVE                                                                                        \
    "a triangle is inactive when the first component of any of its vertices is NaN (Vulkan: Inactive "       \
    "Primitives and Instances)"
#define SPEC_POINTERS                                                                                        \
    "primitiveOffset is where the pointers to instances begin (Vulkan: "                                     \
    "VkAccelerationStructureBuildRangeInfoKHR)"

#define AFTER(label, extra, ...)                                                                             \
    {.name = "planted.after_update." label, .spec = SPEC_AFTER, .run = after_update,                         \
     .params = &(const struct steps){extra, {__VA_ARGS__}}}
#define PLACED(label, ...)                                                                                   \
    {.name = "planted.placed." label, .spec = SPEC_PLACED, .run = placed, .params = &(const struct placed){__VA_ARGS__}}
#define HALF(label, format)                                                                                  \
    {.name = "planted.subnormal." label, .spec = SPEC_HALF, .run = subnormal_halves, .value = format}
#define SNORM(label, format)                                                                                 \
    {.name = "planted.lowest." label, .spec = SPEC_SNORM, .run = lowest_snorm, .value = format}

static const struct gn_case cases[] = {
    {.name = "planted.ids.indexed", .spec = SPEC_IDS, .run = primitive_ids},
    {.name = "planted.ids.without_indices", .spec = SPEC_IDS, .run = primitive_ids, .value = 1},
    HALF("r16g16b16a16_sfloat", VK_FORMAT_R16G16B16A16_SFLOAT),
    HALF("r16g16_sfloat", VK_FORMAT_R16G16_SFLOAT),
    HALF("r16g16b16_sfloat", VK_FORMAT_R16G16B16_SFLOAT),
    SNORM("r16g16b16a16_snorm", VK_FORMAT_R16G16B16A16_SNORM),
    SNORM("r16g16_snorm", VK_FORMAT_R16G16_SNORM),
    SNORM("r8g8b8a8_snorm", VK_FORMAT_R8G8B8A8_SNORM),
    SNORM("r8g8_snorm", VK_FORMAT_R8G8_SNORM),
    {.name = "planted.update_flags.in_place", .spec = SPEC_UPDATE_FLAGS, .run = update_flags, .value = GN_CTS_STEP_REFIT},
    {.name = "planted.update_flags.copy", .spec = SPEC_UPDATE_FLAGS, .run = update_flags, .value = GN_CTS_STEP_REFIT_COPY},
    AFTER("update", 0, GN_CTS_STEP_REFIT_BACK, GN_CTS_STEP_REFIT),
    AFTER("clone", 0, GN_CTS_STEP_REFIT, GN_CTS_STEP_CLONE),
    AFTER("serialize", 0, GN_CTS_STEP_REFIT, GN_CTS_STEP_SERIALIZE),
    AFTER("compact", VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR, GN_CTS_STEP_REFIT, GN_CTS_STEP_COMPACT),
    AFTER("compact_and_update", VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR, GN_CTS_STEP_COMPACT,
          GN_CTS_STEP_REFIT),
    AFTER("clone_and_update", 0, GN_CTS_STEP_CLONE, GN_CTS_STEP_REFIT),
    AFTER("deserialize_and_update", 0, GN_CTS_STEP_SERIALIZE, GN_CTS_STEP_REFIT_COPY),
    {.name = "planted.inactive_alone.corner_0", .spec = SPEC_INACTIVE, .run = inactive_alone, .value = 0},
    {.name = "planted.inactive_alone.corner_1", .spec = SPEC_INACTIVE, .run = inactive_alone, .value = 1},
    {.name = "planted.inactive_alone.corner_2", .spec = SPEC_INACTIVE, .run = inactive_alone, .value = 2},
    {.name = "planted.limits.geometries", .spec = SPEC_LIMITS, .run = limits_required, .value = 0},
    {.name = "planted.limits.instances", .spec = SPEC_LIMITS, .run = limits_required, .value = 1},
    {.name = "planted.limits.primitives", .spec = SPEC_LIMITS, .run = limits_required, .value = 2},
    {.name = "planted.limits.scratch_alignment", .spec = SPEC_LIMITS, .run = limits_required, .value = 3},
    {.name = "planted.box_geometries", .spec = SPEC_IDS, .run = box_geometries},
    PLACED("indices_2", .data_offset = 2),
    PLACED("indices_6", .data_offset = 6),
    PLACED("wide_indices_4", .data_offset = 4, .wide_indices = true),
    PLACED("boxes_8", .data_offset = 8, .boxes = true),
    PLACED("vertices_65540", .stride = 65540),
    PLACED("boxes_65560", .stride = 65560, .boxes = true),
    {.name = "planted.pointers.16", .spec = SPEC_POINTERS, .run = pointer_offset, .value = 16},
    {.name = "planted.pointers.80", .spec = SPEC_POINTERS, .run = pointer_offset, .value = 80},
};
const struct gn_case_family gn_family_planted = {"planted", cases, sizeof cases / sizeof cases[0]};
