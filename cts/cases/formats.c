/* SPDX-License-Identifier: Apache-2.0 */
/* Vertex formats and strides: the same kind of mesh, encoded in every format that the device takes. */
#include "cts/compose.h"

#define SPEC_REQUIRED                                                                                        \
    "six vertex formats have to be taken (Vulkan: Required Format Support, "                                 \
    "VK_FORMAT_FEATURE_ACCELERATION_STRUCTURE_VERTEX_BUFFER_BIT_KHR; "                                       \
    "VkAccelerationStructureGeometryTrianglesDataKHR::vertexFormat)"
#define SPEC_OPTIONAL                                                                                        \
    "a vertex format is taken if its format features say so (Vulkan: "                                       \
    "VkAccelerationStructureGeometryTrianglesDataKHR::vertexFormat)"

struct params {
    VkFormat format;
    uint32_t component; /* bytes; of a packed format all of it */
    uint32_t size;      /* bytes */
    bool flat;          /* two components: z is 0 */
    bool not_negative;
    uint32_t extra[3]; /* components beyond `size` in the stride, one trace each */
    uint32_t traces;
};

static void formats(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    if (run->device && !gn_device_has_vertex_format(run->device, params->format)) {
        gn_case_skip(run, "the device does not take VkFormat %d as a vertex format", (int)params->format);
        return;
    }
    for (uint32_t trace = 0; trace < params->traces; trace++) {
        struct gn_mesh mesh = params->flat ? gn_mesh_flat(&run->arena, &run->random, 8)
                                           : gn_mesh_height_field(&run->arena, &run->random, 8, 0.5);
        if (params->not_negative)
            mesh = gn_mesh_scaled(&run->arena, &mesh, 0.5, 0.5, params->flat ? 1 : 0.5, 0.5, 0.5,
                                  params->flat ? 0 : 0.5);
        struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
        geometry.flags = VK_GEOMETRY_OPAQUE_BIT_KHR;
        geometry.vertex_format = params->format;
        geometry.vertex_stride = params->size + params->extra[trace] * params->component;
        geometry.index_none = trace == 2;
        geometry.index_uint32 = trace == 1;
        struct gn_cts_scene scene = gn_scene_placed(run, &geometry, 1);
        uint32_t count = gn_ray_count(run, 12288) / params->traces + 1;
        struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
        gn_rays_at_scene(run, &scene, 2, true, rays, count);
        gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
    }
}

#define REQUIRED(label, name, ...)                                                                           \
    {"formats." label ".tight", SPEC_REQUIRED, formats, &(const struct params){name, __VA_ARGS__, {0}, 1},   \
     0},                                                                                                     \
        {"formats." label ".padded", SPEC_REQUIRED, formats,                                                 \
         &(const struct params){name, __VA_ARGS__, {1}, 1}, 0},                                              \
    {                                                                                                        \
        "formats." label ".wide", SPEC_REQUIRED, formats,                                                    \
            &(const struct params){name, __VA_ARGS__, {13, 64, 251}, 3}, 0                                   \
    }
#define OPTIONAL(label, name, ...)                                                                           \
    {                                                                                                        \
        "formats." label, SPEC_OPTIONAL, formats, &(const struct params){name, __VA_ARGS__, {0, 1, 29}, 3},  \
            0                                                                                                \
    }

static const struct gn_case cases[] = {
    REQUIRED("r32g32b32_sfloat", VK_FORMAT_R32G32B32_SFLOAT, 4, 12, false, false),
    REQUIRED("r32g32_sfloat", VK_FORMAT_R32G32_SFLOAT, 4, 8, true, false),
    REQUIRED("r16g16b16a16_sfloat", VK_FORMAT_R16G16B16A16_SFLOAT, 2, 8, false, false),
    REQUIRED("r16g16_sfloat", VK_FORMAT_R16G16_SFLOAT, 2, 4, true, false),
    REQUIRED("r16g16b16a16_snorm", VK_FORMAT_R16G16B16A16_SNORM, 2, 8, false, false),
    REQUIRED("r16g16_snorm", VK_FORMAT_R16G16_SNORM, 2, 4, true, false),
    OPTIONAL("r32g32b32a32_sfloat", VK_FORMAT_R32G32B32A32_SFLOAT, 4, 16, false, false),
    OPTIONAL("r16g16b16_sfloat", VK_FORMAT_R16G16B16_SFLOAT, 2, 6, false, false),
    OPTIONAL("r16g16b16_snorm", VK_FORMAT_R16G16B16_SNORM, 2, 6, false, false),
    OPTIONAL("r16g16b16a16_unorm", VK_FORMAT_R16G16B16A16_UNORM, 2, 8, false, true),
    OPTIONAL("r16g16_unorm", VK_FORMAT_R16G16_UNORM, 2, 4, true, true),
    OPTIONAL("r8g8b8a8_snorm", VK_FORMAT_R8G8B8A8_SNORM, 1, 4, false, false),
    OPTIONAL("r8g8b8_snorm", VK_FORMAT_R8G8B8_SNORM, 1, 3, false, false),
    OPTIONAL("r8g8_snorm", VK_FORMAT_R8G8_SNORM, 1, 2, true, false),
    OPTIONAL("r8g8b8a8_unorm", VK_FORMAT_R8G8B8A8_UNORM, 1, 4, false, true),
    OPTIONAL("r8g8_unorm", VK_FORMAT_R8G8_UNORM, 1, 2, true, true),
    OPTIONAL("a2b10g10r10_unorm", VK_FORMAT_A2B10G10R10_UNORM_PACK32, 4, 4, false, true),
    OPTIONAL("r64g64b64_sfloat", VK_FORMAT_R64G64B64_SFLOAT, 8, 24, false, false),
    OPTIONAL("r64g64_sfloat", VK_FORMAT_R64G64_SFLOAT, 8, 16, true, false),
};
const struct gn_case_family gn_family_formats = {"formats", cases, sizeof cases / sizeof cases[0]};
