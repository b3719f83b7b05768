/* SPDX-License-Identifier: Apache-2.0 */
/* Several geometries in one BLAS: their ids, and that each keeps its own format, transform and flags. */
#include "cts/compose.h"

#define SPEC_INDEX                                                                                           \
    "the geometry index is the geometry's place in the build's list (SPV_KHR_ray_query: "                    \
    "OpRayQueryGetIntersectionGeometryIndexKHR)"
#define SPEC_OWN                                                                                             \
    "each geometry has its own format, indices, transform and flags (Vulkan: "                               \
    "VkAccelerationStructureGeometryKHR)"
#define SPEC_EMPTY                                                                                           \
    "a geometry without primitives is allowed and counts (Vulkan: "                                          \
    "VkAccelerationStructureBuildRangeInfoKHR::primitiveCount)"
#define SPEC_INACTIVE                                                                                        \
    "inactive primitives give no hits and still count in the ids (Vulkan: Inactive Primitives and "          \
    "Instances)"

enum {
    EMPTY = 1,
    FORMATS = 2,
    TRANSFORMS = 4,
    FLAGS = 8,
    INDICES = 16,
    INACTIVE = 32,
    SIZES = 64,
    DUPLICATES = 128
};

struct params {
    uint32_t geometries;
    uint32_t mix;
    uint32_t blases; /* 0: one */
    bool array_of_pointers, geometry_pointers, separate_builds;
    uint32_t instance_offset;
    enum gn_cts_program program;
};

/* A small mesh somewhere in [-2, 2]^3. */
static struct gn_cts_geometry make(struct gn_case_run *run, const struct params *params, uint32_t index)
{
    struct gn_random *random = &run->random;
    static const VkFormat formats[4] = {VK_FORMAT_R32G32B32_SFLOAT, VK_FORMAT_R16G16B16A16_SFLOAT,
                                        VK_FORMAT_R16G16B16A16_SNORM, VK_FORMAT_R32G32_SFLOAT};
    VkFormat format = params->mix & FORMATS ? formats[index % 4] : VK_FORMAT_UNDEFINED;
    uint32_t n = 2 + (params->mix & SIZES ? gn_random_below(random, 12) : 1);
    bool placed = params->mix & TRANSFORMS;

    struct gn_mesh mesh = format == VK_FORMAT_R32G32_SFLOAT
                              ? gn_mesh_flat(&run->arena, random, n)
                              : gn_mesh_height_field(&run->arena, random, n, 0.25);
    if (!placed && format == VK_FORMAT_UNDEFINED)
        mesh = gn_mesh_scaled(&run->arena, &mesh, 0.5, 0.5, 0.5, gn_random_range(random, -1.5, 1.5),
                              gn_random_range(random, -1.5, 1.5), gn_random_range(random, -1.5, 1.5));
    if (params->mix & INACTIVE && index % 2) {
        mesh = gn_mesh_unshared(&run->arena, &mesh);
        gn_mesh_deactivate(random, &mesh, 0.3);
    }
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.vertex_format = format;
    geometry.flags = VK_GEOMETRY_OPAQUE_BIT_KHR;
    if (params->mix & FLAGS)
        geometry.flags = (index & 1 ? VK_GEOMETRY_OPAQUE_BIT_KHR : 0) |
                         (index & 2 ? VK_GEOMETRY_NO_DUPLICATE_ANY_HIT_INVOCATION_BIT_KHR : 0);
    if (params->program == GN_CTS_CANDIDATES)
        geometry.flags &= ~(VkGeometryFlagsKHR)VK_GEOMETRY_OPAQUE_BIT_KHR;
    if (placed) {
        float *transform = GN_NEW(&run->arena, float, 12);
        gn_transform_random(random, 0.25, 0.75, 1.5, index % 3 == 0, transform);
        geometry.transform = transform;
    }
    if (params->mix & INDICES) {
        geometry.index_none = index % 3 == 0;
        geometry.index_uint32 = index % 3 == 1;
    }
    if (params->mix & EMPTY && index % 4 != 2)
        geometry.triangle_count = 0;
    return geometry;
}

static void geometries(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    uint32_t blas_count = params->blases ? params->blases : 1;
    struct gn_cts_blas *blases = GN_NEW(&run->arena, struct gn_cts_blas, blas_count);
    struct gn_cts_instance *instances = GN_NEW(&run->arena, struct gn_cts_instance, blas_count);
    for (uint32_t b = 0; b < blas_count; b++) {
        struct gn_cts_geometry *list = GN_NEW(&run->arena, struct gn_cts_geometry, params->geometries);
        for (uint32_t g = 0; g < params->geometries; g++)
            list[g] = make(run, params, g);
        if (params->mix & DUPLICATES)
            for (uint32_t g = 1; g < params->geometries; g += 2)
                list[g] = list[g - 1];
        blases[b] = (struct gn_cts_blas){.geometries = list, .geometry_count = params->geometries};
        instances[b] = gn_instance_of(b, NULL);
        gn_transform_random(&run->random, 0.75, 1.5, 2, false, instances[b].transform);
        instances[b].custom_index = b;
    }
    struct gn_cts_scene scene = gn_scene_make(blases, blas_count, instances, blas_count);
    scene.array_of_pointers = params->array_of_pointers;
    scene.geometry_pointers = params->geometry_pointers;
    scene.separate_builds = params->separate_builds;
    scene.instance_offset = params->instance_offset;
    uint32_t count = gn_ray_count(run, 16384);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_rays_at_scene(run, &scene, 2, true, rays, count);
    if (params->mix & FLAGS)
        for (uint32_t i = 0; i < count; i++)
            rays[i].policy.confirm_mask = (uint32_t)gn_random_u64(&run->random);
    gn_case_trace(run, &scene, params->program, rays, count, 0);
}

#define CASE(label, spec, ...)                                                                               \
    {                                                                                                        \
        "geometries." label, spec, geometries, &(const struct params){__VA_ARGS__}, 0                        \
    }
static const struct gn_case cases[] = {
    CASE("pair", SPEC_INDEX, .geometries = 2),
    CASE("ten", SPEC_INDEX, .geometries = 10, .mix = SIZES),
    CASE("three_hundred", SPEC_INDEX, .geometries = 300),
    CASE("three_hundred_mixed", SPEC_OWN, .geometries = 300,
         .mix = FORMATS | TRANSFORMS | INDICES | FLAGS | SIZES),
    CASE("empty_between", SPEC_EMPTY, .geometries = 12, .mix = EMPTY),
    CASE("mostly_empty", SPEC_EMPTY, .geometries = 3, .mix = EMPTY | SIZES),
    CASE("empty_mixed", SPEC_EMPTY, .geometries = 40, .mix = EMPTY | FORMATS | INDICES | TRANSFORMS),
    CASE("formats", SPEC_OWN, .geometries = 8, .mix = FORMATS),
    CASE("transforms", SPEC_OWN, .geometries = 9, .mix = TRANSFORMS),
    CASE("flags", SPEC_OWN, .geometries = 8, .mix = FLAGS),
    CASE("indices", SPEC_OWN, .geometries = 9, .mix = INDICES),
    CASE("inactive", SPEC_INACTIVE, .geometries = 8, .mix = INACTIVE),
    CASE("coincident", "of coincident triangles one is committed (Vulkan: Ray Closest Hit Determination)",
         .geometries = 8, .mix = DUPLICATES),
    CASE("several_structures", SPEC_INDEX, .geometries = 5, .mix = FORMATS | TRANSFORMS | INDICES,
         .blases = 7),
    CASE("one_build_each",
         "structures may be built by one command or by several (Vulkan: vkCmdBuildAccelerationStructuresKHR)",
         .geometries = 3, .mix = TRANSFORMS, .blases = 5, .separate_builds = true),
    CASE("pointers",
         "geometries may come as an array of pointers (Vulkan: "
         "VkAccelerationStructureBuildGeometryInfoKHR::ppGeometries)",
         .geometries = 6, .mix = TRANSFORMS | FORMATS | FLAGS, .blases = 3, .geometry_pointers = true),
    CASE("array_of_pointers",
         "instances may come as an array of pointers (Vulkan: "
         "VkAccelerationStructureGeometryInstancesDataKHR::arrayOfPointers)",
         .geometries = 6, .mix = TRANSFORMS | FORMATS, .blases = 3, .array_of_pointers = true),
    CASE("instance_offset",
         "the offset counts bytes before the first instance (Vulkan: VkAccelerationStructureBuildRangeInfoKHR)",
         .geometries = 3, .mix = TRANSFORMS, .blases = 5, .instance_offset = 208),
    CASE("candidates", SPEC_INDEX, .geometries = 8, .mix = SIZES, .blases = 1, .program = GN_CTS_CANDIDATES),
};
const struct gn_case_family gn_family_geometries = {"geometries", cases, sizeof cases / sizeof cases[0]};
