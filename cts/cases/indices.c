/* SPDX-License-Identifier: Apache-2.0 */
/* Where the corners of a triangle come from: index types, offsets into vertex, index and transform data. */
#include "cts/compose.h"

#define SPEC_INDEX                                                                                           \
    "indices are 16 or 32 bits wide or absent (Vulkan: "                                                     \
    "VkAccelerationStructureGeometryTrianglesDataKHR::indexType)"
#define SPEC_NONE                                                                                            \
    "without indices every three vertices make a triangle (Vulkan: "                                         \
    "VkAccelerationStructureBuildRangeInfoKHR)"
#define SPEC_PRIMITIVE_OFFSET                                                                                \
    "primitiveOffset is in bytes, into the index data or, without indices, into the vertex data (Vulkan: "   \
    "VkAccelerationStructureBuildRangeInfoKHR::primitiveOffset)"
#define SPEC_FIRST_VERTEX                                                                                    \
    "firstVertex is added to each index, or where there are none to the vertex number (Vulkan: "             \
    "VkAccelerationStructureBuildRangeInfoKHR::firstVertex)"
#define SPEC_TRANSFORM_OFFSET                                                                                \
    "transformOffset is in bytes, into the transform data (Vulkan: "                                         \
    "VkAccelerationStructureBuildRangeInfoKHR::transformOffset)"
#define SPEC_DEGENERATE                                                                                      \
    "degenerate triangles give no hits and still count in the primitive ids (Vulkan: Degenerate Primitives " \
    "and Instances)"

enum shape {
    FIELD,
    REVERSED, /* the triangles in another order, each rotated */
    REPEATED, /* every third triangle has two equal indices */
    TWICE,    /* every triangle is there twice */
    SPARSE,   /* most vertices are used by no triangle */
    FULL_16,  /* 65,536 vertices, and triangles at both ends of them */
    OVER_16,  /* 70,000 vertices */
};

struct params {
    enum shape shape;
    bool none, uint32;
    uint32_t vertex_offset, first_vertex, primitive_offset, transform_offset;
    uint32_t stride;
    VkFormat format;
};

/* Vertices of a mesh moved to the numbers from `first` on, among `total`; the others lie far away. */
static struct gn_mesh spread(struct gn_case_run *run, const struct gn_mesh *mesh, uint32_t total)
{
    struct gn_mesh out = *mesh;
    out.position_count = total;
    out.positions = gn_arena_alloc(&run->arena, total, sizeof *out.positions);
    out.triangles = gn_arena_alloc(&run->arena, mesh->triangle_count, sizeof *out.triangles);
    uint32_t *place = GN_NEW(&run->arena, uint32_t, mesh->position_count);
    for (uint32_t i = 0; i < total; i++)
        for (int a = 0; a < 3; a++)
            out.positions[i][a] = 1000 + (double)i;
    /* Evenly, from the first number to the last, so that both are used. */
    for (uint32_t i = 0; i < mesh->position_count; i++) {
        place[i] = (uint32_t)((uint64_t)i * (total - 1) / (mesh->position_count - 1));
        for (int a = 0; a < 3; a++)
            out.positions[place[i]][a] = mesh->positions[i][a];
    }
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        for (int c = 0; c < 3; c++)
            out.triangles[t][c] = place[mesh->triangles[t][c]];
    return out;
}

static void shape_apply(struct gn_case_run *run, enum shape shape, struct gn_mesh *mesh)
{
    uint32_t count = mesh->triangle_count;
    uint32_t(*triangles)[3] = gn_arena_alloc(&run->arena, 2 * count, sizeof *triangles);
    for (uint32_t t = 0; t < 2 * count; t++)
        for (uint32_t c = 0; c < 3; c++) {
            if (shape == REVERSED)
                triangles[t][c] = mesh->triangles[(2 * count - 1 - t) % count][(c + t) % 3];
            else if (shape == TWICE)
                triangles[t][c] = mesh->triangles[t / 2][c];
            else
                triangles[t][c] =
                    mesh->triangles[t % count][shape == REPEATED && t % 3 == 1 && c == 2 ? t & 1 : c];
        }
    mesh->triangles = triangles;
    if (shape == TWICE)
        mesh->triangle_count = 2 * count;
    if (shape == SPARSE)
        *mesh = spread(run, mesh, 5000);
    if (shape == FULL_16)
        *mesh = spread(run, mesh, 65536);
    if (shape == OVER_16)
        *mesh = spread(run, mesh, 70000);
}

static void indices(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    struct gn_mesh mesh = gn_mesh_height_field(&run->arena, &run->random, 12, 0.25);
    shape_apply(run, params->shape, &mesh);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = VK_GEOMETRY_OPAQUE_BIT_KHR;
    geometry.index_none = params->none;
    geometry.index_uint32 = params->uint32;
    geometry.vertex_offset = params->vertex_offset;
    geometry.first_vertex = params->first_vertex;
    geometry.primitive_offset = params->primitive_offset;
    geometry.vertex_stride = params->stride;
    geometry.vertex_format = params->format;
    float transform[12];
    if (params->transform_offset) {
        gn_transform_random(&run->random, 0.75, 1.5, 0.5, false, transform);
        geometry.transform = transform;
        geometry.transform_offset = params->transform_offset;
    }
    struct gn_cts_scene scene = gn_scene_placed(run, &geometry, 1);
    uint32_t count = gn_ray_count(run, 8192);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_rays_at_scene(run, &scene, 2, true, rays, count);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

#define CASE(label, spec, ...)                                                                               \
    {                                                                                                        \
        "indices." label, spec, indices, &(const struct params){__VA_ARGS__}, 0                              \
    }
#define F16 VK_FORMAT_R16G16B16A16_SFLOAT
static const struct gn_case cases[] = {
    CASE("none", SPEC_NONE, .shape = FIELD, .none = true),
    CASE("uint16", SPEC_INDEX, .shape = FIELD),
    CASE("uint32", SPEC_INDEX, .shape = FIELD, .uint32 = true),
    CASE("uint16_all_65536", SPEC_INDEX, .shape = FULL_16),
    CASE("uint32_beyond_65536", SPEC_INDEX, .shape = OVER_16, .uint32 = true),
    CASE("reordered", SPEC_INDEX, .shape = REVERSED),
    CASE("sparse", SPEC_INDEX, .shape = SPARSE),
    CASE("repeated", SPEC_DEGENERATE, .shape = REPEATED),
    CASE("repeated_without_indices", SPEC_DEGENERATE, .shape = REPEATED, .none = true),
    CASE("every_triangle_twice",
         "of coincident triangles one is committed (Vulkan: Ray Closest Hit Determination)", .shape = TWICE),
    CASE("vertex_offset", SPEC_INDEX, .shape = FIELD, .vertex_offset = 52),
    CASE("vertex_offset_halves", SPEC_INDEX, .shape = FIELD, .uint32 = true, .vertex_offset = 6, .stride = 10,
         .format = F16),
    CASE("first_vertex", SPEC_FIRST_VERTEX, .shape = FIELD, .first_vertex = 17),
    CASE("first_vertex_stride", SPEC_FIRST_VERTEX, .shape = FIELD, .uint32 = true, .first_vertex = 5,
         .stride = 36),
    CASE("first_vertex_without_indices", SPEC_FIRST_VERTEX, .shape = FIELD, .none = true, .first_vertex = 7,
         .stride = 20),
    CASE("primitive_offset_uint16", SPEC_PRIMITIVE_OFFSET, .shape = FIELD, .primitive_offset = 34),
    CASE("primitive_offset_uint32", SPEC_PRIMITIVE_OFFSET, .shape = FIELD, .uint32 = true,
         .primitive_offset = 52),
    CASE("primitive_offset_without_indices", SPEC_PRIMITIVE_OFFSET, .shape = FIELD, .none = true,
         .primitive_offset = 100),
    CASE("transform_offset", SPEC_TRANSFORM_OFFSET, .shape = FIELD, .transform_offset = 16),
    CASE("transform_offset_large", SPEC_TRANSFORM_OFFSET, .shape = FIELD, .transform_offset = 4096),
    CASE("all_offsets", SPEC_PRIMITIVE_OFFSET, .shape = REVERSED, .uint32 = true, .vertex_offset = 28,
         .first_vertex = 11, .primitive_offset = 44, .transform_offset = 48, .stride = 24),
    CASE("all_offsets_uint16", SPEC_PRIMITIVE_OFFSET, .shape = SPARSE, .vertex_offset = 14,
         .first_vertex = 300, .primitive_offset = 22, .transform_offset = 80, .stride = 12, .format = F16),
    CASE("all_offsets_without_indices", SPEC_PRIMITIVE_OFFSET, .shape = FIELD, .none = true,
         .vertex_offset = 40, .first_vertex = 4, .primitive_offset = 60, .transform_offset = 32,
         .stride = 28),
};
const struct gn_case_family gn_family_indices = {"indices", cases, sizeof cases / sizeof cases[0]};
