/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The faults, each a block: what it does, then its line in the table at the end.
 *
 * Bits that no application gives mean the same to every driver, so faults in what is built are made in the data and
 * show whichever way rays are traced; faults of the traversal are made in the shaders.
 */
#include <fnmatch.h>
#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <spirv/unified1/spirv.h>

#include "tests/faulty/faulty.h"

typedef VkAccelerationStructureInstanceKHR instance;

#define INSTANCE_FAULT(function)                                                                             \
    static void function(const struct gn_fault_build *build, instance *all, uint32_t i, uint32_t count)
#define UNUSED_INSTANCE (void)build, (void)count

/* Instances */

INSTANCE_FAULT(mask_bit)
{
    UNUSED_INSTANCE;
    all[i].mask &= 0xFFu & ~0x08u;
}

INSTANCE_FAULT(mask_low_bits)
{
    UNUSED_INSTANCE;
    all[i].mask &= 0x7F;
}

INSTANCE_FAULT(mask_ignored)
{
    UNUSED_INSTANCE;
    all[i].mask = 0xFF;
}

INSTANCE_FAULT(mask_zero_shows)
{
    UNUSED_INSTANCE;
    if (!all[i].mask)
        all[i].mask = 0xFF;
}

INSTANCE_FAULT(custom_index_16)
{
    UNUSED_INSTANCE;
    all[i].instanceCustomIndex &= 0xFFFF;
}

INSTANCE_FAULT(custom_index_8)
{
    UNUSED_INSTANCE;
    all[i].instanceCustomIndex &= 0xFF;
}

INSTANCE_FAULT(custom_index_top_bit)
{
    UNUSED_INSTANCE;
    all[i].instanceCustomIndex &= 0x7FFFFF;
}

/* The last one keeps its own. */
INSTANCE_FAULT(custom_index_of_next)
{
    (void)build;
    if (i + 1 < count)
        all[i].instanceCustomIndex = all[i + 1].instanceCustomIndex;
}

INSTANCE_FAULT(sbt_offset_16)
{
    UNUSED_INSTANCE;
    all[i].instanceShaderBindingTableRecordOffset &= 0xFFFF;
}

INSTANCE_FAULT(sbt_offset_8)
{
    UNUSED_INSTANCE;
    all[i].instanceShaderBindingTableRecordOffset &= 0xFF;
}

INSTANCE_FAULT(sbt_offset_top_bit)
{
    UNUSED_INSTANCE;
    all[i].instanceShaderBindingTableRecordOffset &= 0x7FFFFF;
}

INSTANCE_FAULT(flags_lost)
{
    UNUSED_INSTANCE;
    all[i].flags = 0;
}

INSTANCE_FAULT(cull_disable_lost)
{
    UNUSED_INSTANCE;
    all[i].flags &= 0xFFu & ~(unsigned)VK_GEOMETRY_INSTANCE_TRIANGLE_FACING_CULL_DISABLE_BIT_KHR;
}

INSTANCE_FAULT(flip_facing_lost)
{
    UNUSED_INSTANCE;
    all[i].flags &= 0xFFu & ~(unsigned)VK_GEOMETRY_INSTANCE_TRIANGLE_FLIP_FACING_BIT_KHR;
}

INSTANCE_FAULT(force_opaque_lost)
{
    UNUSED_INSTANCE;
    all[i].flags &= 0xFFu & ~(unsigned)VK_GEOMETRY_INSTANCE_FORCE_OPAQUE_BIT_KHR;
}

INSTANCE_FAULT(force_no_opaque_lost)
{
    UNUSED_INSTANCE;
    all[i].flags &= 0xFFu & ~(unsigned)VK_GEOMETRY_INSTANCE_FORCE_NO_OPAQUE_BIT_KHR;
}

INSTANCE_FAULT(force_flags_swapped)
{
    UNUSED_INSTANCE;
    const uint32_t flags = all[i].flags;
    all[i].flags = (flags & 3u) | (flags & 4u) << 1 | (flags & 8u) >> 1;
}

/* A flip hides what a cull-disable would let through; the two are told apart only where both are set. */
INSTANCE_FAULT(flip_disables_cull)
{
    UNUSED_INSTANCE;
    if (all[i].flags & VK_GEOMETRY_INSTANCE_TRIANGLE_FLIP_FACING_BIT_KHR)
        all[i].flags |= VK_GEOMETRY_INSTANCE_TRIANGLE_FACING_CULL_DISABLE_BIT_KHR;
}

static float determinant(float m[3][4])
{
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
           m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
}

INSTANCE_FAULT(mirror_flips_facing)
{
    UNUSED_INSTANCE;
    if (determinant(all[i].transform.matrix) < 0)
        all[i].flags ^= VK_GEOMETRY_INSTANCE_TRIANGLE_FLIP_FACING_BIT_KHR;
}

INSTANCE_FAULT(transform_transposed)
{
    UNUSED_INSTANCE;
    const VkTransformMatrixKHR from = all[i].transform;
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            all[i].transform.matrix[r][c] = from.matrix[c][r];
}

INSTANCE_FAULT(transform_row)
{
    UNUSED_INSTANCE;
    memcpy(all[i].transform.matrix[2], all[i].transform.matrix[1], 3 * sizeof(float));
}

INSTANCE_FAULT(transform_translation)
{
    UNUSED_INSTANCE;
    all[i].transform.matrix[2][3] = 0;
}

INSTANCE_FAULT(transform_scale)
{
    UNUSED_INSTANCE;
    for (int c = 0; c < 3; c++) {
        float length = 0;
        for (int r = 0; r < 3; r++)
            length += all[i].transform.matrix[r][c] * all[i].transform.matrix[r][c];
        for (int r = 0; r < 3 && length > 0; r++)
            all[i].transform.matrix[r][c] /= sqrtf(length);
    }
}

INSTANCE_FAULT(transform_half)
{
    UNUSED_INSTANCE;
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            uint32_t bits;
            memcpy(&bits, &all[i].transform.matrix[r][c], sizeof bits);
            bits = (bits + 0x1000u) & ~0x1FFFu;
            memcpy(&all[i].transform.matrix[r][c], &bits, sizeof bits);
        }
}

INSTANCE_FAULT(last_lost)
{
    (void)build;
    if (i > 0 && i + 1 == count)
        all[i].accelerationStructureReference = 0;
}

INSTANCE_FAULT(instance_65536_lost)
{
    UNUSED_INSTANCE;
    if (i >= 65536)
        all[i].accelerationStructureReference = 0;
}

INSTANCE_FAULT(inactive_shows_previous)
{
    UNUSED_INSTANCE;
    if (i > 0 && !all[i].accelerationStructureReference)
        all[i].accelerationStructureReference = all[i - 1].accelerationStructureReference;
}

INSTANCE_FAULT(inactive_ends_list)
{
    UNUSED_INSTANCE;
    if (i > 0 && !all[i - 1].accelerationStructureReference)
        all[i].accelerationStructureReference = 0;
}

INSTANCE_FAULT(reference_of_previous)
{
    (void)build;
    /* The last but one, so that it is its neighbour's that it takes over. */
    if (count > 2 && i == count - 2 && all[i].accelerationStructureReference && all[i - 1].accelerationStructureReference)
        all[i].accelerationStructureReference = all[i - 1].accelerationStructureReference;
}

INSTANCE_FAULT(update_keeps_ids)
{
    if (!gn_fault_is_update(build) || !build->from || build->from->instance_count != count)
        return;
    const instance *old = &build->from->instances[i];
    all[i].instanceCustomIndex = old->instanceCustomIndex;
    all[i].instanceShaderBindingTableRecordOffset = old->instanceShaderBindingTableRecordOffset;
}

INSTANCE_FAULT(update_keeps_masks)
{
    if (gn_fault_is_update(build) && build->from && build->from->instance_count == count) {
        all[i].mask = build->from->instances[i].mask;
        all[i].flags = build->from->instances[i].flags;
    }
}

INSTANCE_FAULT(update_keeps_references)
{
    if (gn_fault_is_update(build) && build->from && build->from->instance_count == count)
        all[i].accelerationStructureReference = build->from->instances[i].accelerationStructureReference;
}

INSTANCE_FAULT(update_keeps_transforms)
{
    if (gn_fault_is_update(build) && build->from && build->from->instance_count == count)
        all[i].transform = build->from->instances[i].transform;
}

static bool is_tlas(const struct gn_fault_build *build)
{
    return build->info.geometryCount && build->geometries[0].geometryType == VK_GEOMETRY_TYPE_INSTANCES_KHR;
}

static void instance_offset(struct gn_fault_build *build)
{
    if (is_tlas(build))
        build->ranges[0].primitiveOffset = 0;
}

static void pointers_reversed(struct gn_fault_build *build)
{
    if (!is_tlas(build) || !build->geometries[0].geometry.instances.arrayOfPointers)
        return;
    VkAccelerationStructureGeometryInstancesDataKHR *data = &build->geometries[0].geometry.instances;
    const uint32_t count = build->ranges[0].primitiveCount;
    const uint8_t *from = (const uint8_t *)(uintptr_t)data->data.deviceAddress + build->ranges[0].primitiveOffset;
    uint64_t *pointers = gn_fault_memory(count * sizeof *pointers);
    for (uint32_t i = 0; i < count; i++)
        memcpy(&pointers[i], from + (count - 1 - i) * sizeof *pointers, sizeof *pointers);
    data->data.deviceAddress = (VkDeviceAddress)(uintptr_t)pointers;
    build->ranges[0].primitiveOffset = 0;
}

/* Geometries */

#define GEOMETRY_FAULT(function) static void function(struct gn_fault_build *build, uint32_t g)

static bool is_triangles(const struct gn_fault_build *build, uint32_t g)
{
    return build->geometries[g].geometryType == VK_GEOMETRY_TYPE_TRIANGLES_KHR;
}

static VkAccelerationStructureGeometryTrianglesDataKHR *triangles_of(struct gn_fault_build *build, uint32_t g)
{
    return &build->geometries[g].geometry.triangles;
}

GEOMETRY_FAULT(opaque_lost)
{
    build->geometries[g].flags &= ~(VkGeometryFlagsKHR)VK_GEOMETRY_OPAQUE_BIT_KHR;
}

GEOMETRY_FAULT(opaque_of_first)
{
    build->geometries[g].flags = build->geometries[0].flags;
}

GEOMETRY_FAULT(opaque_lost_on_update)
{
    if (gn_fault_is_update(build))
        build->geometries[g].flags = 0;
}

GEOMETRY_FAULT(geometry_transform)
{
    if (is_triangles(build, g))
        triangles_of(build, g)->transformData.deviceAddress = 0;
}

GEOMETRY_FAULT(geometry_transform_of_others)
{
    if (is_triangles(build, g) && g > 0)
        triangles_of(build, g)->transformData.deviceAddress = 0;
}

GEOMETRY_FAULT(geometry_transform_translation)
{
    VkTransformMatrixKHR *transform = is_triangles(build, g) ? gn_fault_transform(build, g) : NULL;
    for (int r = 0; r < 3 && transform; r++)
        transform->matrix[r][3] = 0;
}

GEOMETRY_FAULT(geometry_transform_transposed)
{
    VkTransformMatrixKHR *transform = is_triangles(build, g) ? gn_fault_transform(build, g) : NULL;
    if (!transform)
        return;
    const VkTransformMatrixKHR from = *transform;
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            transform->matrix[r][c] = from.matrix[c][r];
}

GEOMETRY_FAULT(geometry_transform_offset)
{
    build->ranges[g].transformOffset = 0;
}

GEOMETRY_FAULT(geometry_transform_update)
{
    if (is_triangles(build, g) && gn_fault_is_update(build))
        triangles_of(build, g)->transformData.deviceAddress = 0;
}

GEOMETRY_FAULT(last_primitive)
{
    if (build->ranges[g].primitiveCount > 1)
        build->ranges[g].primitiveCount--;
}

GEOMETRY_FAULT(first_primitive)
{
    if (is_triangles(build, g) && build->ranges[g].primitiveCount > 1) {
        uint32_t(*indices)[3] = gn_fault_indices(build, g);
        indices[0][1] = indices[0][2] = indices[0][0];
    }
}

GEOMETRY_FAULT(primitive_65536)
{
    if (is_triangles(build, g) && build->ranges[g].primitiveCount > 65536) {
        uint32_t(*indices)[3] = gn_fault_indices(build, g);
        indices[65536][1] = indices[65536][2] = indices[65536][0];
    }
}

GEOMETRY_FAULT(indices_16)
{
    if (is_triangles(build, g) && triangles_of(build, g)->indexType == VK_INDEX_TYPE_UINT32) {
        uint32_t(*indices)[3] = gn_fault_indices(build, g);
        for (uint32_t i = 0; i < 3 * build->ranges[g].primitiveCount; i++)
            indices[i / 3][i % 3] &= 0xFFFF;
    }
}

GEOMETRY_FAULT(indices_8)
{
    if (is_triangles(build, g) && triangles_of(build, g)->indexType == VK_INDEX_TYPE_UINT16) {
        uint32_t(*indices)[3] = gn_fault_indices(build, g);
        for (uint32_t i = 0; i < 3 * build->ranges[g].primitiveCount; i++)
            indices[i / 3][i % 3] &= 0xFF;
    }
}

/* As drawing does, and as building structures must not. */
GEOMETRY_FAULT(index_restart)
{
    if (is_triangles(build, g) && triangles_of(build, g)->indexType == VK_INDEX_TYPE_UINT16) {
        uint32_t(*indices)[3] = gn_fault_indices(build, g);
        for (uint32_t i = 0; i < build->ranges[g].primitiveCount; i++)
            for (int c = 0; c < 3; c++)
                if (indices[i][c] == 0xFFFF)
                    indices[i][0] = indices[i][1] = indices[i][2] = 0;
    }
}

GEOMETRY_FAULT(index_signed)
{
    if (is_triangles(build, g) && triangles_of(build, g)->indexType == VK_INDEX_TYPE_UINT16) {
        uint32_t(*indices)[3] = gn_fault_indices(build, g);
        for (uint32_t i = 0; i < build->ranges[g].primitiveCount; i++)
            for (int c = 0; c < 3; c++)
                if (indices[i][c] > 0x7FFF)
                    indices[i][0] = indices[i][1] = indices[i][2] = 0;
    }
}

GEOMETRY_FAULT(corners_swapped)
{
    if (is_triangles(build, g)) {
        uint32_t(*indices)[3] = gn_fault_indices(build, g);
        for (uint32_t i = 0; i < build->ranges[g].primitiveCount; i++) {
            const uint32_t b = indices[i][1];
            indices[i][1] = indices[i][2];
            indices[i][2] = b;
        }
    }
}

GEOMETRY_FAULT(corners_rotated)
{
    if (is_triangles(build, g)) {
        uint32_t(*indices)[3] = gn_fault_indices(build, g);
        for (uint32_t i = 0; i < build->ranges[g].primitiveCount; i++) {
            const uint32_t a = indices[i][0];
            indices[i][0] = indices[i][1];
            indices[i][1] = indices[i][2];
            indices[i][2] = a;
        }
    }
}

GEOMETRY_FAULT(first_vertex)
{
    build->ranges[g].firstVertex = 0;
}

/* With an index buffer only. */
GEOMETRY_FAULT(first_vertex_indexed)
{
    if (is_triangles(build, g) && triangles_of(build, g)->indexType != VK_INDEX_TYPE_NONE_KHR)
        build->ranges[g].firstVertex = 0;
}

GEOMETRY_FAULT(first_vertex_twice)
{
    if (is_triangles(build, g))
        triangles_of(build, g)->vertexData.deviceAddress +=
            build->ranges[g].firstVertex * triangles_of(build, g)->vertexStride;
}

GEOMETRY_FAULT(vertex_stride)
{
    if (is_triangles(build, g) && triangles_of(build, g)->vertexFormat == VK_FORMAT_R32G32B32_SFLOAT)
        triangles_of(build, g)->vertexStride = 12;
}

GEOMETRY_FAULT(primitive_offset)
{
    if (is_triangles(build, g))
        build->ranges[g].primitiveOffset = 0;
}

/* An offset into the indices moves the ids as well. */
GEOMETRY_FAULT(primitive_offset_counted)
{
    const uint32_t count = build->ranges[g].primitiveCount;
    if (is_triangles(build, g) && build->ranges[g].primitiveOffset && count > 1) {
        uint32_t(*indices)[3] = gn_fault_indices(build, g), last[3];
        memcpy(last, indices[count - 1], sizeof last);
        memmove(indices[1], indices[0], (count - 1) * sizeof last);
        memcpy(indices[0], last, sizeof last);
    }
}

static void positions_round(struct gn_fault_build *build, uint32_t g, int drop)
{
    uint32_t count;
    float(*positions)[3] = gn_fault_positions(build, g, &count);
    for (uint32_t i = 0; positions && i < 3 * count; i++) {
        uint32_t bits;
        memcpy(&bits, &positions[i / 3][i % 3], sizeof bits);
        if ((bits & 0x7F800000u) != 0x7F800000u)
            bits = (bits + (1u << (drop - 1))) & ~((1u << drop) - 1);
        memcpy(&positions[i / 3][i % 3], &bits, sizeof bits);
    }
}

GEOMETRY_FAULT(positions_half)
{
    if (is_triangles(build, g))
        positions_round(build, g, 13);
}

/* Every other triangle is two steps smaller: what neighbours share is not the same any more. */
GEOMETRY_FAULT(positions_cracked)
{
    uint32_t count;
    float(*positions)[3] = is_triangles(build, g) ? gn_fault_positions(build, g, &count) : NULL;
    if (!positions)
        return;
    const uint32_t triangles = build->ranges[g].primitiveCount;
    uint32_t(*indices)[3] = gn_fault_indices(build, g);
    float(*own)[3] = gn_fault_memory((size_t)triangles * 3 * sizeof *own);
    for (uint32_t i = 0; i < 3 * triangles; i++)
        for (int a = 0; a < 3; a++) {
            float mean = 0, *at = &own[i][a];
            for (int c = 0; c < 3; c++)
                mean += positions[indices[i / 3][c]][a] / 3;
            *at = positions[indices[i / 3][i % 3]][a];
            for (int step = 0; step < 2 && i / 3 % 2 && isfinite(mean); step++)
                *at = nextafterf(*at, mean);
        }
    for (uint32_t i = 0; i < 3 * triangles; i++)
        indices[i / 3][i % 3] = i;
    triangles_of(build, g)->vertexData.deviceAddress = (VkDeviceAddress)(uintptr_t)own;
    triangles_of(build, g)->maxVertex = 3 * triangles;
}

GEOMETRY_FAULT(fast_build_rounds)
{
    if (is_triangles(build, g) && build->info.flags & VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_BUILD_BIT_KHR)
        positions_round(build, g, 8);
}

GEOMETRY_FAULT(low_memory_opaque)
{
    if (build->info.flags & VK_BUILD_ACCELERATION_STRUCTURE_LOW_MEMORY_BIT_KHR)
        build->geometries[g].flags |= VK_GEOMETRY_OPAQUE_BIT_KHR;
}

/* Where data access is asked for and compaction as well. */
GEOMETRY_FAULT(fast_trace_drops)
{
    const VkBuildAccelerationStructureFlagsKHR both = VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR |
                                                      VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR;
    if ((build->info.flags & both) == both)
        last_primitive(build, g);
}

GEOMETRY_FAULT(format_snorm)
{
    if (!is_triangles(build, g) || triangles_of(build, g)->vertexFormat != VK_FORMAT_R16G16B16A16_SNORM)
        return;
    /* Divided by 32768: as good as a transform by 32767/32768. */
    VkTransformMatrixKHR *transform = gn_fault_transform(build, g);
    if (!transform) {
        transform = gn_fault_memory(sizeof *transform);
        for (int r = 0; r < 3; r++)
            transform->matrix[r][r] = 1;
        triangles_of(build, g)->transformData.deviceAddress = (VkDeviceAddress)(uintptr_t)transform;
    }
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            transform->matrix[r][c] *= 32767.0f / 32768;
}

GEOMETRY_FAULT(format_snorm_unsigned)
{
    if (is_triangles(build, g) && triangles_of(build, g)->vertexFormat == VK_FORMAT_R16G16_SNORM)
        triangles_of(build, g)->vertexFormat = VK_FORMAT_R16G16_UNORM;
}

GEOMETRY_FAULT(format_half_subnormal)
{
    const VkFormat format = is_triangles(build, g) ? triangles_of(build, g)->vertexFormat : VK_FORMAT_UNDEFINED;
    if (format != VK_FORMAT_R16G16B16A16_SFLOAT && format != VK_FORMAT_R16G16_SFLOAT)
        return;
    uint32_t count;
    uint8_t *data = gn_fault_vertices(build, g, &count);
    for (uint32_t i = 0; i < count; i++)
        for (int c = 0; c < (format == VK_FORMAT_R16G16_SFLOAT ? 2 : 3); c++) {
            uint16_t bits;
            uint8_t *at = data + i * triangles_of(build, g)->vertexStride + 2 * c;
            memcpy(&bits, at, sizeof bits);
            if (!(bits & 0x7C00))
                bits = 0;
            memcpy(at, &bits, sizeof bits);
        }
}

static bool inactive(const float (*positions)[3], const uint32_t triangle[3])
{
    return isnan(positions[triangle[0]][0]) || isnan(positions[triangle[1]][0]) || isnan(positions[triangle[2]][0]);
}

/* Inactive triangles do not count in the ids. */
GEOMETRY_FAULT(inactive_not_counted)
{
    uint32_t count, kept = 0;
    float(*positions)[3] = is_triangles(build, g) ? gn_fault_positions(build, g, &count) : NULL;
    if (!positions)
        return;
    uint32_t(*indices)[3] = gn_fault_indices(build, g);
    for (uint32_t i = 0; i < build->ranges[g].primitiveCount; i++)
        if (!inactive((const float(*)[3])positions, indices[i]))
            memmove(indices[kept++], indices[i], sizeof indices[i]);
    build->ranges[g].primitiveCount = kept;
}

/* Only the first corner's NaN makes a triangle inactive; others become 0. */
GEOMETRY_FAULT(inactive_first_corner)
{
    uint32_t count;
    float(*positions)[3] = is_triangles(build, g) ? gn_fault_positions(build, g, &count) : NULL;
    if (!positions)
        return;
    uint32_t(*indices)[3] = gn_fault_indices(build, g);
    for (uint32_t i = 0; i < build->ranges[g].primitiveCount; i++)
        for (int c = 1; c < 3; c++)
            if (isnan(positions[indices[i][c]][0]) && !isnan(positions[indices[i][0]][0]))
                memset(positions[indices[i][c]], 0, sizeof positions[0]);
}

static bool is_aabbs(const struct gn_fault_build *build, uint32_t g)
{
    return build->geometries[g].geometryType == VK_GEOMETRY_TYPE_AABBS_KHR;
}

GEOMETRY_FAULT(aabb_shrunk)
{
    float(*boxes)[6] = is_aabbs(build, g) ? gn_fault_aabbs(build, g) : NULL;
    for (uint32_t i = 0; boxes && i < build->ranges[g].primitiveCount; i++)
        for (int a = 0; a < 3; a++) {
            const float margin = (boxes[i][a + 3] - boxes[i][a]) / 4096;
            boxes[i][a] += margin;
            boxes[i][a + 3] -= margin;
        }
}

GEOMETRY_FAULT(aabb_flat)
{
    float(*boxes)[6] = is_aabbs(build, g) ? gn_fault_aabbs(build, g) : NULL;
    for (uint32_t i = 0; boxes && i < build->ranges[g].primitiveCount; i++)
        for (int a = 0; a < 3; a++)
            if (boxes[i][a] == boxes[i][a + 3]) {
                boxes[i][0] = boxes[i][1] = boxes[i][2] = 1e30f;
                boxes[i][3] = boxes[i][4] = boxes[i][5] = 1e30f;
            }
}

GEOMETRY_FAULT(aabb_stride)
{
    if (is_aabbs(build, g))
        build->geometries[g].geometry.aabbs.stride = 24;
}

GEOMETRY_FAULT(aabb_offset)
{
    if (is_aabbs(build, g))
        build->ranges[g].primitiveOffset = 0;
}

GEOMETRY_FAULT(aabb_update)
{
    if (is_aabbs(build, g) && gn_fault_is_update(build))
        build->skip = true;
}

/* What updates alone have wrong. */
#define IN_UPDATES(function, fault)                                                                          \
    GEOMETRY_FAULT(function)                                                                                 \
    {                                                                                                        \
        if (gn_fault_is_update(build))                                                                       \
            fault(build, g);                                                                                 \
    }
IN_UPDATES(update_first_vertex, first_vertex)
IN_UPDATES(update_offset, primitive_offset)
IN_UPDATES(update_transform_offset, geometry_transform_offset)
IN_UPDATES(update_stride, vertex_stride)
IN_UPDATES(update_indices, indices_16)
IN_UPDATES(update_aabb_stride, aabb_stride)
IN_UPDATES(update_aabb_offset, aabb_offset)

GEOMETRY_FAULT(update_format)
{
    if (gn_fault_is_update(build) && is_triangles(build, g) &&
        triangles_of(build, g)->vertexFormat != VK_FORMAT_R32G32B32_SFLOAT)
        build->skip = true;
}

static void update_instance_offset(struct gn_fault_build *build)
{
    if (gn_fault_is_update(build))
        instance_offset(build);
}

static void update_pointers(struct gn_fault_build *build)
{
    if (gn_fault_is_update(build))
        pointers_reversed(build);
}

static const instance *instance_before(const struct gn_fault_build *build, uint32_t i)
{
    return gn_fault_is_update(build) && build->from && i < build->from->instance_count ? &build->from->instances[i]
                                                                                       : NULL;
}

INSTANCE_FAULT(update_mask_zero)
{
    (void)count;
    const instance *before = instance_before(build, i);
    if (before && !before->mask)
        all[i].mask = 0;
}

INSTANCE_FAULT(update_flags)
{
    (void)count;
    const instance *before = instance_before(build, i);
    if (before)
        all[i].flags = before->flags;
}

static void rebuild_with_source(struct gn_fault_build *build)
{
    if (!gn_fault_is_update(build) && build->info.srcAccelerationStructure)
        build->skip = true;
}

static const float far_away[3] = {1e30f, 1e30f, 1e30f};

/* What leaves the bounds of the build before an update is not found any more. */
GEOMETRY_FAULT(refit_bounds)
{
    if (!gn_fault_is_update(build) || !build->from)
        return;
    if (is_aabbs(build, g)) {
        float(*boxes)[6] = gn_fault_aabbs(build, g);
        for (uint32_t i = 0; i < build->ranges[g].primitiveCount; i++)
            if (gn_fault_outside(build->from, boxes[i]) && gn_fault_outside(build->from, boxes[i] + 3)) {
                memcpy(boxes[i], far_away, sizeof far_away);
                memcpy(boxes[i] + 3, far_away, sizeof far_away);
            }
    } else if (is_triangles(build, g)) {
        uint32_t count;
        float(*positions)[3] = gn_fault_positions(build, g, &count);
        uint32_t(*indices)[3] = positions ? gn_fault_indices(build, g) : NULL;
        for (uint32_t i = 0; indices && i < build->ranges[g].primitiveCount; i++) {
            bool out = true;
            for (int c = 0; c < 3; c++)
                out = out && gn_fault_outside(build->from, positions[indices[i][c]]);
            if (out)
                indices[i][1] = indices[i][2] = indices[i][0];
        }
    }
}

static void empty_geometries(struct gn_fault_build *build)
{
    uint32_t kept = 0;
    for (uint32_t g = 0; g < build->info.geometryCount && !is_tlas(build); g++)
        if (build->ranges[g].primitiveCount) {
            build->geometries[kept] = build->geometries[g];
            build->ranges[kept++] = build->ranges[g];
        }
    if (!is_tlas(build))
        build->info.geometryCount = kept;
}

static void geometry_last(struct gn_fault_build *build)
{
    if (!is_tlas(build) && build->info.geometryCount > 1)
        build->ranges[build->info.geometryCount - 1].primitiveCount = 0;
}

static void geometry_256(struct gn_fault_build *build)
{
    for (uint32_t g = 256; g < build->info.geometryCount; g++)
        build->ranges[g].primitiveCount = 0;
}

/* Builds */

static void update_skipped(struct gn_fault_build *build)
{
    build->skip = gn_fault_is_update(build) && build->from == build->to;
}

static void update_copied(struct gn_fault_build *build)
{
    build->clone = gn_fault_is_update(build) && build->from && build->from != build->to;
}

static void update_tlas_skipped(struct gn_fault_build *build)
{
    build->skip = is_tlas(build) && gn_fault_is_update(build) && build->from == build->to;
}

static void update_second_skipped(struct gn_fault_build *build)
{
    build->skip = gn_fault_is_update(build) && build->from == build->to && build->to && build->to->builds > 1;
}

/* A null pointer of the driver's own, past any handler of a sanitizer: it is the process's end. */
static void pointers_crash(struct gn_fault_build *build)
{
    if (!is_tlas(build) || !build->geometries[0].geometry.instances.arrayOfPointers)
        return;
    signal(SIGSEGV, SIG_DFL);
    raise(SIGSEGV);
}

static void pointers_exit(struct gn_fault_build *build)
{
    if (is_tlas(build) && build->geometries[0].geometry.instances.arrayOfPointers)
        _exit(7);
}

static void rebuild_skipped(struct gn_fault_build *build)
{
    build->skip = !gn_fault_is_update(build) && build->to && build->to->builds > 0;
}

/* Copies */

static void tail_lost(const struct gn_fault_structure *from, struct gn_fault_structure *to,
                      VkCopyAccelerationStructureModeKHR mode)
{
    (void)from;
    if (mode == VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR && to->size >= 64)
        memset(to->bytes + to->size - 64, 0, 64);
}

static void source_emptied(const struct gn_fault_structure *from, struct gn_fault_structure *to,
                           VkCopyAccelerationStructureModeKHR mode)
{
    (void)to, (void)mode;
    if (from->bytes)
        memset(from->bytes, 0, from->size);
}

static void clone_tail_lost(const struct gn_fault_structure *from, struct gn_fault_structure *to,
                            VkCopyAccelerationStructureModeKHR mode)
{
    (void)from;
    if (mode == VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR && to->size >= 64)
        memset(to->bytes + to->size - 64, 0, 64);
}

static void generation_copied(const struct gn_fault_structure *from, struct gn_fault_structure *to)
{
    if (from->first && from->size <= to->size)
        memcpy(to->bytes, from->first, from->size);
}

static void clone_first(const struct gn_fault_structure *from, struct gn_fault_structure *to,
                        VkCopyAccelerationStructureModeKHR mode)
{
    if (mode == VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR)
        generation_copied(from, to);
}

static void compact_first(const struct gn_fault_structure *from, struct gn_fault_structure *to,
                          VkCopyAccelerationStructureModeKHR mode)
{
    if (mode == VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR)
        generation_copied(from, to);
}

static void compacted_size_grown(VkQueryType type, uint64_t *value)
{
    if (type == VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR)
        *value = *value * 2 + 256;
}

static void compacted_size_zero(VkQueryType type, uint64_t *value)
{
    if (type == VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR)
        *value = 0;
}

static void serialized_size_short(VkQueryType type, uint64_t *value)
{
    if (type == VK_QUERY_TYPE_ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR)
        *value -= 8;
}

/* The head: two UUIDs, then the serialized size, the deserialized size, the number of handles, the handles. */
enum { HEAD_SERIALIZED = 32, HEAD_DESERIALIZED = 40, HEAD_COUNT = 48, HEAD_HANDLES = 56 };

static uint64_t head_get(const uint8_t *bytes, size_t at)
{
    uint64_t value;
    memcpy(&value, bytes + at, sizeof value);
    return value;
}

static void serialized_flags(uint8_t *bytes)
{
    /* What is last is of the last primitive. */
    const uint64_t size = head_get(bytes, HEAD_SERIALIZED);
    if (size > 128)
        memset(bytes + size - 32, 0, 32);
}

static void serialized_handles_lost(uint8_t *bytes)
{
    memset(bytes + HEAD_COUNT, 0, 8);
}

static void serialized_uuid(uint8_t *bytes)
{
    bytes[0] ^= 1;
}

static void deserialize_rotated(uint8_t *bytes)
{
    const uint64_t count = head_get(bytes, HEAD_COUNT);
    if (count < 2)
        return;
    const uint64_t first = head_get(bytes, HEAD_HANDLES);
    memmove(bytes + HEAD_HANDLES, bytes + HEAD_HANDLES + 8, 8 * (count - 1));
    memcpy(bytes + HEAD_HANDLES + 8 * (count - 1), &first, sizeof first);
}

static void size_zero_when_empty(const VkAccelerationStructureBuildGeometryInfoKHR *info,
                                 VkAccelerationStructureBuildSizesInfoKHR *sizes)
{
    if (!info->geometryCount || sizes->accelerationStructureSize < 256)
        sizes->accelerationStructureSize = 0;
}

static void limit_geometries(VkPhysicalDeviceAccelerationStructurePropertiesKHR *limits)
{
    limits->maxGeometryCount = 1u << 16;
}

static void limit_instances(VkPhysicalDeviceAccelerationStructurePropertiesKHR *limits)
{
    limits->maxInstanceCount = 1u << 20;
}

static void limit_primitives(VkPhysicalDeviceAccelerationStructurePropertiesKHR *limits)
{
    limits->maxPrimitiveCount = 1u << 24;
}

static void limit_alignment(VkPhysicalDeviceAccelerationStructurePropertiesKHR *limits)
{
    limits->minAccelerationStructureScratchOffsetAlignment = 512;
}

/* Traversal: operands of initialising a query and of tracing a ray, then what is read back. */

#define ON_RAYS(query_word, trace_word, change, value)                                                       \
    {{SpvOpRayQueryInitializeKHR, query_word, 0, change, value, 0}, {SpvOpTraceRayKHR, trace_word, 0, change, value, 0}}
/* Factors for the ends of the range; 0 and infinity stay what they are. 1 - 2^-24 moves any float by one step. */
#define JUST_BELOW 0x3F7FFFFF
#define JUST_ABOVE 0x3F800001
#define CLEARLY_BELOW 0x3F7FFF00
#define CLEARLY_ABOVE 0x3F800080
#define FLAGS(change, value) ON_RAYS(3, 2, change, value)
#define READ(opcode, builtin, change, value)                                                                 \
    {{opcode, 0, 0, change, value, 0}, {SpvOpLoad, 0, builtin, change, value, 0}}

#define IN_STAGE(model) {{SpvOpRayQueryInitializeKHR, 3, 0, GN_FAULT_AND, 0, 1 + (model)}}

#define INSTANCE(n, t, function) {.name = n, .text = t, .instance = function}
#define GEOMETRY(n, t, function) {.name = n, .text = t, .geometry = function}
#define BUILD(n, t, function) {.name = n, .text = t, .build = function}
#define SHADER(n, t, ...) {.name = n, .text = t, .edits = __VA_ARGS__}

static const struct gn_fault faults[] = {
    INSTANCE("mask.bit_3", "bit 3 of the instances' masks is lost", mask_bit),
    INSTANCE("mask.bit_7", "bit 7 of the instances' masks is lost", mask_low_bits),
    INSTANCE("mask.ignored", "the instances' masks are taken for 0xFF", mask_ignored),
    INSTANCE("mask.zero", "an instance with the mask 0 is visible", mask_zero_shows),
    SHADER("mask.ray", "the ray's mask has only 7 bits", ON_RAYS(4, 3, GN_FAULT_AND, 0x7F)),
    INSTANCE("custom_index.16_bits", "the custom index is cut to 16 bits", custom_index_16),
    INSTANCE("custom_index.8_bits", "the custom index is cut to 8 bits", custom_index_8),
    INSTANCE("custom_index.23_bits", "the custom index is cut to 23 bits", custom_index_top_bit),
    INSTANCE("custom_index.neighbour", "the custom index is that of the next instance", custom_index_of_next),
    INSTANCE("sbt_offset.16_bits", "the SBT offset is cut to 16 bits", sbt_offset_16),
    INSTANCE("sbt_offset.8_bits", "the SBT offset is cut to 8 bits", sbt_offset_8),
    INSTANCE("sbt_offset.23_bits", "the SBT offset is cut to 23 bits", sbt_offset_top_bit),
    INSTANCE("instance_flags.lost", "the instances' flags are lost", flags_lost),
    INSTANCE("instance_flags.cull_disable", "FACING_CULL_DISABLE is ignored", cull_disable_lost),
    INSTANCE("instance_flags.flip_facing", "FLIP_FACING is ignored", flip_facing_lost),
    INSTANCE("instance_flags.force_opaque", "FORCE_OPAQUE is ignored", force_opaque_lost),
    INSTANCE("instance_flags.force_no_opaque", "FORCE_NO_OPAQUE is ignored", force_no_opaque_lost),
    INSTANCE("instance_flags.forces_swapped", "FORCE_OPAQUE and FORCE_NO_OPAQUE are swapped", force_flags_swapped),
    INSTANCE("instance_flags.flip_disables", "FLIP_FACING disables culling as well", flip_disables_cull),
    INSTANCE("transform.mirror", "a mirrored instance turns its triangles' facing", mirror_flips_facing),
    INSTANCE("transform.transposed", "the instance transform is transposed", transform_transposed),
    INSTANCE("transform.row", "the third row of the instance transform is the second", transform_row),
    INSTANCE("transform.translation", "the z of the instances' translations is lost", transform_translation),
    INSTANCE("transform.scale", "the scale of the instance transform is lost", transform_scale),
    INSTANCE("transform.half", "the instance transform is rounded to 10 bits", transform_half),
    INSTANCE("instances.last", "the last of several instances is lost", last_lost),
    INSTANCE("instances.65536", "instances from 65,536 on are lost", instance_65536_lost),
    INSTANCE("instances.null", "a null reference shows the structure of the instance before", inactive_shows_previous),
    INSTANCE("instances.null_ends", "what follows a null reference is lost", inactive_ends_list),
    INSTANCE("instances.reference", "the last but one of the instances shows the structure of the one before",
             reference_of_previous),
    BUILD("instances.offset", "primitiveOffset is ignored for instances", instance_offset),
    BUILD("instances.pointers", "arrays of pointers are read from the end", pointers_reversed),
    SHADER("instances.id", "the instance's id is cut to 16 bits",
           READ(SpvOpRayQueryGetIntersectionInstanceIdKHR, SpvBuiltInInstanceId, GN_FAULT_AND, 0xFFFF)),

    GEOMETRY("geometry_flags.opaque", "OPAQUE is ignored", opaque_lost),
    GEOMETRY("geometry_flags.first", "the flags of the first geometry serve all", opaque_of_first),
    GEOMETRY("geometry_flags.update", "an update loses the geometries' flags", opaque_lost_on_update),
    GEOMETRY("geometry_transform.ignored", "geometry transforms are ignored", geometry_transform),
    GEOMETRY("geometry_transform.first", "only the first geometry's transform counts", geometry_transform_of_others),
    GEOMETRY("geometry_transform.translation", "geometry transforms do not translate", geometry_transform_translation),
    GEOMETRY("geometry_transform.transposed", "geometry transforms are transposed", geometry_transform_transposed),
    GEOMETRY("geometry_transform.offset", "transformOffset is ignored", geometry_transform_offset),
    GEOMETRY("geometry_transform.update", "an update ignores geometry transforms", geometry_transform_update),
    BUILD("geometries.empty", "geometries without primitives are not counted", empty_geometries),
    BUILD("geometries.last", "the last of several geometries is lost", geometry_last),
    BUILD("geometries.256", "geometries from 256 on are lost", geometry_256),
    SHADER("geometries.index", "the geometry's index is cut to 8 bits",
           READ(SpvOpRayQueryGetIntersectionGeometryIndexKHR, SpvBuiltInRayGeometryIndexKHR, GN_FAULT_AND, 0xFF)),
    GEOMETRY("primitives.last", "the last of several primitives is lost", last_primitive),
    GEOMETRY("primitives.first", "the first of several triangles is lost", first_primitive),
    GEOMETRY("primitives.65536", "triangle 65,536 is lost", primitive_65536),
    SHADER("primitives.id", "the primitive's id is cut to 16 bits",
           READ(SpvOpRayQueryGetIntersectionPrimitiveIndexKHR, SpvBuiltInPrimitiveId, GN_FAULT_AND, 0xFFFF)),
    GEOMETRY("primitives.offset_counts", "primitiveOffset moves the ids", primitive_offset_counted),
    GEOMETRY("primitives.inactive", "inactive triangles do not count in the ids", inactive_not_counted),
    GEOMETRY("primitives.inactive_corner", "only NaN in the first corner makes a triangle inactive",
             inactive_first_corner),
    GEOMETRY("indices.16_bits", "32-bit indices are cut to 16 bits", indices_16),
    GEOMETRY("indices.8_bits", "16-bit indices are cut to 8 bits", indices_8),
    GEOMETRY("indices.restart", "the 16-bit index 65,535 restarts", index_restart),
    GEOMETRY("indices.signed", "16-bit indices are signed", index_signed),
    GEOMETRY("vertices.corners_swapped", "the second and third corner are swapped", corners_swapped),
    GEOMETRY("vertices.corners_rotated", "a triangle begins with its second corner", corners_rotated),
    GEOMETRY("vertices.first", "firstVertex is ignored", first_vertex),
    GEOMETRY("vertices.first_indexed", "firstVertex is ignored where there are indices", first_vertex_indexed),
    GEOMETRY("vertices.first_twice", "firstVertex is applied twice", first_vertex_twice),
    GEOMETRY("vertices.stride", "vertexStride is ignored", vertex_stride),
    GEOMETRY("vertices.offset", "primitiveOffset is ignored for triangles", primitive_offset),
    GEOMETRY("vertices.half", "positions are rounded to 10 bits", positions_half),
    GEOMETRY("vertices.cracks", "every other triangle is two steps smaller than given", positions_cracked),
    GEOMETRY("formats.snorm", "SNORM is divided by 32,768", format_snorm),
    GEOMETRY("formats.snorm_sign", "two-component SNORM is read as UNORM", format_snorm_unsigned),
    GEOMETRY("formats.half_subnormal", "subnormal halves are flushed", format_half_subnormal),
    GEOMETRY("aabbs.shrunk", "AABBs are shrunk by 1/4096 of their size", aabb_shrunk),
    GEOMETRY("aabbs.flat", "flat AABBs are lost", aabb_flat),
    GEOMETRY("aabbs.stride", "the stride of AABBs is ignored", aabb_stride),
    GEOMETRY("aabbs.offset", "primitiveOffset is ignored for AABBs", aabb_offset),
    GEOMETRY("aabbs.update", "updates of AABBs are ignored", aabb_update),

    BUILD("update.ignored", "an update in place is ignored", update_skipped),
    BUILD("update.copied", "an update into another structure only copies", update_copied),
    BUILD("update.second", "the second update in place is ignored", update_second_skipped),
    BUILD("update.tlas", "a top level structure stays as it is when it is updated", update_tlas_skipped),
    GEOMETRY("update.bounds", "an update does not grow the bounds", refit_bounds),
    GEOMETRY("update.first_vertex", "an update ignores firstVertex", update_first_vertex),
    GEOMETRY("update.offset", "an update ignores primitiveOffset of triangles", update_offset),
    GEOMETRY("update.transform_offset", "an update ignores transformOffset", update_transform_offset),
    GEOMETRY("update.stride", "an update ignores vertexStride", update_stride),
    GEOMETRY("update.indices", "an update cuts 32-bit indices to 16 bits", update_indices),
    GEOMETRY("update.format", "an update of other formats than R32G32B32_SFLOAT is ignored", update_format),
    GEOMETRY("update.aabb_stride", "an update ignores the stride of AABBs", update_aabb_stride),
    GEOMETRY("update.aabb_offset", "an update ignores primitiveOffset of AABBs", update_aabb_offset),
    BUILD("update.instance_offset", "an update ignores primitiveOffset of instances", update_instance_offset),
    BUILD("update.pointers", "an update reads arrays of pointers from the end", update_pointers),
    INSTANCE("update.mask_zero", "an instance whose mask was 0 stays invisible", update_mask_zero),
    INSTANCE("update.instance_flags", "an update keeps the instances' flags", update_flags),
    BUILD("build.source", "a full build with a source is ignored", rebuild_with_source),
    INSTANCE("update.instance_ids", "an update keeps the instances' ids", update_keeps_ids),
    INSTANCE("update.instance_masks", "an update keeps the instances' masks and flags", update_keeps_masks),
    INSTANCE("update.instance_references", "an update keeps the instances' structures", update_keeps_references),
    INSTANCE("update.instance_transforms", "an update keeps the instances' transforms", update_keeps_transforms),
    BUILD("build.crash", "building from an array of pointers crashes", pointers_crash),
    BUILD("build.exit", "building from an array of pointers ends the process with exit status 7", pointers_exit),
    BUILD("build.rebuild", "a structure is not built a second time", rebuild_skipped),
    GEOMETRY("build.fast_build", "PREFER_FAST_BUILD rounds positions to 15 bits", fast_build_rounds),
    GEOMETRY("build.low_memory", "LOW_MEMORY makes everything opaque", low_memory_opaque),
    GEOMETRY("build.fast_trace", "PREFER_FAST_TRACE with ALLOW_UPDATE loses the last primitive", fast_trace_drops),
    {.name = "build.size_empty", .text = "the size of an empty structure is 0", .sizes = size_zero_when_empty},

    {.name = "compact.tail", .text = "compaction loses the last 64 bytes", .copied = tail_lost},
    {.name = "compact.first", .text = "compaction takes what the first build gave", .copied = compact_first},
    {.name = "compact.size", .text = "the compacted size is larger than the structure", .query = compacted_size_grown},
    {.name = "compact.size_zero", .text = "the compacted size is 0", .query = compacted_size_zero},
    {.name = "copy.source", .text = "a copy empties its source", .copied = source_emptied},
    {.name = "clone.tail", .text = "a clone lacks the last 64 bytes", .copied = clone_tail_lost},
    {.name = "clone.first", .text = "a clone is what the first build gave", .copied = clone_first},
    {.name = "serialize.size", .text = "the serialized size is 8 bytes short", .query = serialized_size_short},
    {.name = "serialize.tail", .text = "serialization loses the last 32 bytes", .serialized = serialized_flags},
    {.name = "serialize.handles", .text = "serialized data name no handles", .serialized = serialized_handles_lost},
    {.name = "serialize.uuid", .text = "serialized data name another driver", .serialized = serialized_uuid},
    {.name = "deserialize.handles", .text = "deserialization takes the next handle", .deserialize = deserialize_rotated},

    {.name = "limits.geometries", .text = "maxGeometryCount is below what is required", .limits = limit_geometries},
    {.name = "limits.instances", .text = "maxInstanceCount is below what is required", .limits = limit_instances},
    {.name = "limits.primitives", .text = "maxPrimitiveCount is below what is required", .limits = limit_primitives},
    {.name = "limits.alignment", .text = "the scratch alignment is above what is allowed", .limits = limit_alignment},

    SHADER("range.tmin_ignored", "tmin is 0", ON_RAYS(6, 8, GN_FAULT_SET_FLOAT, 0)),
    SHADER("range.tmin_below", "tmin is one step lower, as if it were included", ON_RAYS(6, 8, GN_FAULT_MULTIPLY, JUST_BELOW)),
    SHADER("range.tmin_above", "tmin is larger by 2^-16 of it", ON_RAYS(6, 8, GN_FAULT_MULTIPLY, CLEARLY_ABOVE)),
    SHADER("range.tmax_ignored", "tmax is 1e30", ON_RAYS(8, 10, GN_FAULT_SET_FLOAT, 0x7149F2CA)),
    SHADER("range.tmax_above", "tmax is one step higher, as if it were included", ON_RAYS(8, 10, GN_FAULT_MULTIPLY, JUST_ABOVE)),
    SHADER("range.tmax_below", "tmax is smaller by 2^-16 of it", ON_RAYS(8, 10, GN_FAULT_MULTIPLY, CLEARLY_BELOW)),
    SHADER("range.normalized", "directions are normalized", ON_RAYS(7, 9, GN_FAULT_NORMALIZE, 0)),
    SHADER("ray_flags.opaque", "the ray flag OPAQUE is ignored", FLAGS(GN_FAULT_AND, ~0x1u)),
    SHADER("ray_flags.no_opaque", "the ray flag NO_OPAQUE is ignored", FLAGS(GN_FAULT_AND, ~0x2u)),
    SHADER("ray_flags.terminate", "TERMINATE_ON_FIRST_HIT is ignored", FLAGS(GN_FAULT_AND, ~0x4u)),
    SHADER("ray_flags.terminate_always", "rays end at their first hit", FLAGS(GN_FAULT_OR, 0x4)),
    SHADER("ray_flags.cull_back", "CULL_BACK_FACING is ignored", FLAGS(GN_FAULT_AND, ~0x10u)),
    SHADER("ray_flags.cull_front", "CULL_FRONT_FACING is ignored", FLAGS(GN_FAULT_AND, ~0x20u)),
    SHADER("ray_flags.cull_swapped", "the flags that cull by facing are swapped", FLAGS(GN_FAULT_SWAP_BITS, 0x10)),
    SHADER("ray_flags.cull_opaque", "CULL_OPAQUE is ignored", FLAGS(GN_FAULT_AND, ~0x40u)),
    SHADER("ray_flags.cull_no_opaque", "CULL_NO_OPAQUE is ignored", FLAGS(GN_FAULT_AND, ~0x80u)),
    SHADER("ray_flags.skip_triangles", "SKIP_TRIANGLES is ignored", FLAGS(GN_FAULT_AND, ~0x100u)),
    SHADER("ray_flags.skip_aabbs", "SKIP_AABBS is ignored", FLAGS(GN_FAULT_AND, ~0x200u)),
    SHADER("ray_flags.skip_swapped", "the flags that skip types are swapped", FLAGS(GN_FAULT_SWAP_BITS, 0x100)),

    SHADER("stages.vertex", "ray queries in vertex shaders have no flags", IN_STAGE(SpvExecutionModelVertex)),
    SHADER("stages.fragment", "ray queries in fragment shaders have no flags", IN_STAGE(SpvExecutionModelFragment)),
    SHADER("stages.ray_generation", "ray queries in ray generation shaders have no flags",
           IN_STAGE(SpvExecutionModelRayGenerationKHR)),
    SHADER("stages.closest_hit", "ray queries in closest-hit shaders have no flags",
           IN_STAGE(SpvExecutionModelClosestHitKHR)),
    SHADER("shader.confirm", "confirming a candidate has no effect", {{SpvOpRayQueryConfirmIntersectionKHR, 1, 0, GN_FAULT_REMOVE, 0, 0}}),
    SHADER("shader.generate", "a generated hit lies 256 steps further",
           {{SpvOpRayQueryGenerateIntersectionKHR, 2, 0, GN_FAULT_ADD_ULPS, 256, 0},
            {SpvOpReportIntersectionKHR, 3, 0, GN_FAULT_ADD_ULPS, 256, 0}}),
    SHADER("hit.t", "t is 256 steps too large", READ(SpvOpRayQueryGetIntersectionTKHR, SpvBuiltInRayTmaxKHR, GN_FAULT_ADD_ULPS, 256)),
    SHADER("hit.t_of_candidate", "the committed t is the candidate's",
           {{SpvOpRayQueryGetIntersectionTKHR, 0, 0, GN_FAULT_SET_INTERSECTION, 0, 0}}),
    SHADER("hit.ids_of_candidate", "the committed ids are the candidate's",
           {{SpvOpRayQueryGetIntersectionPrimitiveIndexKHR, 0, 0, GN_FAULT_SET_INTERSECTION, 0, 0},
            {SpvOpRayQueryGetIntersectionInstanceCustomIndexKHR, 0, 0, GN_FAULT_SET_INTERSECTION, 0, 0}}),
    SHADER("hit.positions_of_candidate", "the committed positions are the candidate's",
           {{SpvOpRayQueryGetIntersectionTriangleVertexPositionsKHR, 0, 0, GN_FAULT_SET_INTERSECTION, 0, 0}}),
    SHADER("hit.barycentrics_swapped", "the barycentrics are swapped",
           {{SpvOpRayQueryGetIntersectionBarycentricsKHR, 0, 0, GN_FAULT_SWAP_XY, 0, 0}}),
    SHADER("hit.facing", "front and back are swapped",
           {{SpvOpRayQueryGetIntersectionFrontFaceKHR, 0, 0, GN_FAULT_NOT, 0, 0}}),
    SHADER("hit.positions", "the fetched positions begin with the second corner",
           READ(SpvOpRayQueryGetIntersectionTriangleVertexPositionsKHR, SpvBuiltInHitTriangleVertexPositionsKHR,
                GN_FAULT_ROTATE_ARRAY, 0)),
    SHADER("read_back.matrices", "object-to-world is world-to-object",
           {{SpvOpRayQueryGetIntersectionObjectToWorldKHR, 0, 0, GN_FAULT_SET_OPCODE,
             SpvOpRayQueryGetIntersectionWorldToObjectKHR, 0}}),
    SHADER("read_back.inverse", "world-to-object is object-to-world",
           {{SpvOpRayQueryGetIntersectionWorldToObjectKHR, 0, 0, GN_FAULT_SET_OPCODE,
             SpvOpRayQueryGetIntersectionObjectToWorldKHR, 0}}),
    SHADER("read_back.direction", "the object-space direction is normalized",
           READ(SpvOpRayQueryGetIntersectionObjectRayDirectionKHR, SpvBuiltInObjectRayDirectionKHR, GN_FAULT_NORMALIZE, 0)),
    SHADER("read_back.world_direction", "the ray's direction is read back normalized",
           READ(SpvOpRayQueryGetWorldRayDirectionKHR, SpvBuiltInWorldRayDirectionKHR, GN_FAULT_NORMALIZE, 0)),
    SHADER("read_back.flags", "ray flags are read back as 8 bits",
           READ(SpvOpRayQueryGetRayFlagsKHR, SpvBuiltInIncomingRayFlagsKHR, GN_FAULT_AND, 0xFF)),
    SHADER("read_back.tmin", "tmin is read back as 0",
           READ(SpvOpRayQueryGetRayTMinKHR, SpvBuiltInRayTminKHR, GN_FAULT_SET_FLOAT, 0)),
};

/*
 * Faults that few cases can notice, and the cases that can: they run with such a fault besides the sample, so that the
 * whole suite need not. Patterns, in which * stands for any characters.
 */
static const struct {
    const char *faults, *cases;
} witnesses[] = {
    {"instances.65536", "query.ids.instance.66000"},
    {"instances.id", "query.ids.instance.66000"},
    {"primitives.inactive", "query.hit.inactive_triangles.corner_0"},
    {"indices.16_bits", "query.ids.primitive.72200"},
    {"indices.restart", "query.indices.uint16_all_65536"},
    {"aabbs.offset", "*.aabbs.list_offset"},
    {"update.bounds", "*.update.boxes.from_afar"},
    {"build.rebuild", "*.update.late.rebuild"},
    {"update.first_vertex", "*.builds.device.*"},
    {"update.offset", "*.builds.device.*"},
    {"update.transform_offset", "*.builds.device.*"},
    {"update.stride", "*.builds.device.*"},
    {"update.indices", "*.update.indices.wide"},
    {"update.format", "*.update.formats.*"},
    {"update.aabb_*", "*.update.boxes.stride_offset"},
    {"update.instance_offset", "*.builds.device.*"},
    {"update.pointers", "*.builds.device.*"},
    {"update.mask_zero", "*.update.instances.from_mask_0"},
    {"update.instance_flags", "*.update.instances.flags"},
    {"build.source", "*.update.rebuild.*"},
    {"copy.source", "*.copy.source_kept.*"},
    {"hit.positions_of_candidate", "query.positions.refusals"},
    {"stages.*", "query.stages.*"},
    {"read_back.*", "query.transforms.detail.*"},
    {"vertices.cracks", "query.watertight.*.edge*"},
    {"records.offset*", "pipeline.tables.records.*_offset"},
    {"records.stride*", "pipeline.tables.records.stride_15"},
    {"records.callable", "pipeline.tables.callable.*"},
    {"table.hit_stride*", "pipeline.tables.stride.*"},
    {"table.callable_stride", "pipeline.tables.callable.*"},
    {"table.null", "pipeline.tables.null.*"},
    {"groups.any_hit_procedural", "pipeline.tables.any_hit.*"},
    {"any_hit.*", "pipeline.tables.any_hit.*"},
    {"recursion.*", "pipeline.tables.recursion.2_*"},
    {"built_ins.*", "pipeline.transforms.detail.*"},
    {"launch.indirect*", "pipeline.tables.launch.*"},
};

const char *gn_fault_witness(const struct gn_fault *fault)
{
    for (size_t i = 0; i < sizeof witnesses / sizeof witnesses[0]; i++)
        if (fnmatch(witnesses[i].faults, fault->name, 0) == 0)
            return witnesses[i].cases;
    return "";
}

const struct gn_fault *gn_fault_at(size_t index)
{
    const size_t count = sizeof faults / sizeof faults[0];
    return index < count                            ? &faults[index]
           : index - count < gn_pipeline_fault_count ? &gn_pipeline_faults[index - count]
                                                     : NULL;
}

const struct gn_fault *gn_fault_chosen(void)
{
    const char *name = getenv("GNOMON_FAULT");
    const struct gn_fault *fault = NULL;
    for (size_t i = 0; name && (fault = gn_fault_at(i)) && strcmp(fault->name, name) != 0; i++) {
    }
    return fault;
}
