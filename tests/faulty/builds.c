/* SPDX-License-Identifier: Apache-2.0 */
/* Private copies of builds and of what they are built from. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "tests/faulty/faulty.h"

static VkAccelerationStructureGeometryTrianglesDataKHR *triangles_of(struct gn_fault_build *build, uint32_t g)
{
    return &build->geometries[g].geometry.triangles;
}

static const uint8_t *at(VkDeviceOrHostAddressConstKHR address)
{
    return (const uint8_t *)(uintptr_t)address.deviceAddress;
}

static VkDeviceAddress address_of(const void *memory)
{
    return (VkDeviceAddress)(uintptr_t)memory;
}

bool gn_fault_is_update(const struct gn_fault_build *build)
{
    return build->info.mode == VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
}

uint32_t (*gn_fault_indices(struct gn_fault_build *build, uint32_t g))[3]
{
    VkAccelerationStructureGeometryTrianglesDataKHR *triangles = triangles_of(build, g);
    VkAccelerationStructureBuildRangeInfoKHR *range = &build->ranges[g];
    const uint32_t count = range->primitiveCount;
    uint32_t(*indices)[3] = gn_fault_memory((size_t)count * sizeof *indices);
    const uint8_t *data = triangles->indexType == VK_INDEX_TYPE_NONE_KHR
                              ? NULL
                              : at(triangles->indexData) + range->primitiveOffset;
    for (uint32_t i = 0; i < 3 * count; i++) {
        uint32_t index = i;
        if (triangles->indexType == VK_INDEX_TYPE_UINT32)
            memcpy(&index, data + 4 * (size_t)i, 4);
        else if (triangles->indexType == VK_INDEX_TYPE_UINT16)
            index = data[2 * (size_t)i] | (uint32_t)data[2 * (size_t)i + 1] << 8;
        else if (data)
            index = data[i];
        indices[i / 3][i % 3] = index;
    }
    if (!data)
        triangles->vertexData.deviceAddress += range->primitiveOffset;
    triangles->indexType = VK_INDEX_TYPE_UINT32;
    triangles->indexData.deviceAddress = address_of(indices);
    range->primitiveOffset = 0;
    return indices;
}

float (*gn_fault_aabbs(struct gn_fault_build *build, uint32_t g))[6]
{
    VkAccelerationStructureGeometryAabbsDataKHR *aabbs = &build->geometries[g].geometry.aabbs;
    VkAccelerationStructureBuildRangeInfoKHR *range = &build->ranges[g];
    float(*boxes)[6] = gn_fault_memory((size_t)range->primitiveCount * sizeof *boxes);
    for (uint32_t i = 0; i < range->primitiveCount; i++)
        memcpy(boxes[i], at(aabbs->data) + range->primitiveOffset + i * aabbs->stride, sizeof *boxes);
    aabbs->data.deviceAddress = address_of(boxes);
    aabbs->stride = sizeof *boxes;
    range->primitiveOffset = 0;
    return boxes;
}

/* How many vertices the triangles reach, with indices made private. */
static uint32_t vertex_count(struct gn_fault_build *build, uint32_t g)
{
    uint32_t(*indices)[3] = gn_fault_indices(build, g), most = 0;
    for (uint32_t i = 0; i < 3 * build->ranges[g].primitiveCount; i++)
        if (indices[i / 3][i % 3] > most)
            most = indices[i / 3][i % 3];
    return build->ranges[g].primitiveCount ? most + 1 : 0;
}

static uint32_t format_bytes(VkFormat format)
{
    switch (format) {
    case VK_FORMAT_R32G32B32A32_SFLOAT:
        return 16;
    case VK_FORMAT_R32G32B32_SFLOAT:
        return 12;
    case VK_FORMAT_R32G32_SFLOAT:
    case VK_FORMAT_R16G16B16A16_SFLOAT:
    case VK_FORMAT_R16G16B16A16_SNORM:
    case VK_FORMAT_R16G16B16A16_UNORM:
        return 8;
    case VK_FORMAT_R16G16B16_SFLOAT:
    case VK_FORMAT_R16G16B16_SNORM:
        return 6;
    case VK_FORMAT_R8G8_SNORM:
    case VK_FORMAT_R8G8_UNORM:
        return 2;
    case VK_FORMAT_R8G8B8_SNORM:
        return 3;
    default:
        return 4;
    }
}

uint8_t *gn_fault_vertices(struct gn_fault_build *build, uint32_t g, uint32_t *out_count)
{
    VkAccelerationStructureGeometryTrianglesDataKHR *triangles = triangles_of(build, g);
    VkAccelerationStructureBuildRangeInfoKHR *range = &build->ranges[g];
    const uint32_t count = vertex_count(build, g);
    const size_t stride = triangles->vertexStride, last = format_bytes(triangles->vertexFormat);
    const uint8_t *data = at(triangles->vertexData) + range->firstVertex * stride;
    uint8_t *copy = gn_fault_memory(count * stride + last);
    if (count)
        memcpy(copy, data, (count - 1) * stride + last);
    triangles->vertexData.deviceAddress = address_of(copy);
    range->firstVertex = 0;
    *out_count = count;
    return copy;
}

float (*gn_fault_positions(struct gn_fault_build *build, uint32_t g, uint32_t *out_count))[3]
{
    VkAccelerationStructureGeometryTrianglesDataKHR *triangles = triangles_of(build, g);
    if (triangles->vertexFormat != VK_FORMAT_R32G32B32_SFLOAT &&
        triangles->vertexFormat != VK_FORMAT_R32G32B32A32_SFLOAT)
        return NULL;
    const uint8_t *data = gn_fault_vertices(build, g, out_count);
    const size_t stride = triangles->vertexStride;
    float(*positions)[3] = gn_fault_memory(*out_count * sizeof *positions);
    for (uint32_t i = 0; i < *out_count; i++)
        memcpy(positions[i], data + i * stride, sizeof *positions);
    triangles->vertexFormat = VK_FORMAT_R32G32B32_SFLOAT;
    triangles->vertexStride = sizeof *positions;
    triangles->vertexData.deviceAddress = address_of(positions);
    return positions;
}

VkTransformMatrixKHR *gn_fault_transform(struct gn_fault_build *build, uint32_t g)
{
    VkAccelerationStructureGeometryTrianglesDataKHR *triangles = triangles_of(build, g);
    if (!triangles->transformData.deviceAddress)
        return NULL;
    VkTransformMatrixKHR *transform = gn_fault_memory(sizeof *transform);
    memcpy(transform, at(triangles->transformData) + build->ranges[g].transformOffset, sizeof *transform);
    triangles->transformData.deviceAddress = address_of(transform);
    build->ranges[g].transformOffset = 0;
    return transform;
}

static VkAccelerationStructureInstanceKHR *instances_private(struct gn_fault_build *build)
{
    VkAccelerationStructureGeometryInstancesDataKHR *data = &build->geometries[0].geometry.instances;
    VkAccelerationStructureBuildRangeInfoKHR *range = &build->ranges[0];
    const uint8_t *from = at(data->data) + range->primitiveOffset;
    VkAccelerationStructureInstanceKHR *instances =
        gn_fault_memory((size_t)range->primitiveCount * sizeof *instances);
    for (uint32_t i = 0; i < range->primitiveCount; i++) {
        const void *one = from + i * sizeof *instances;
        if (data->arrayOfPointers)
            memcpy(&one, from + i * sizeof one, sizeof one);
        memcpy(&instances[i], one, sizeof *instances);
    }
    data->arrayOfPointers = VK_FALSE;
    data->data.deviceAddress = address_of(instances);
    range->primitiveOffset = 0;
    return instances;
}

bool gn_fault_outside(const struct gn_fault_structure *structure, const float position[3])
{
    for (int a = 0; a < 3 && structure->low[0] <= structure->high[0]; a++)
        if (position[a] < structure->low[a] || position[a] > structure->high[a])
            return true;
    return false;
}

static void bounds_grow(struct gn_fault_structure *structure, const float position[3])
{
    for (int a = 0; a < 3; a++) {
        structure->low[a] = fminf(structure->low[a], position[a]);
        structure->high[a] = fmaxf(structure->high[a], position[a]);
    }
}

/* The bounds of what is about to be built, for geometries without transform whose vertices are floats. */
static void bounds_remember(struct gn_fault_build *build)
{
    struct gn_fault_structure *structure = build->to;
    for (int a = 0; a < 3; a++) {
        structure->low[a] = FLT_MAX;
        structure->high[a] = -FLT_MAX;
    }
    for (uint32_t g = 0; g < build->info.geometryCount; g++) {
        const uint32_t count = build->ranges[g].primitiveCount;
        if (build->geometries[g].geometryType == VK_GEOMETRY_TYPE_AABBS_KHR) {
            float(*boxes)[6] = gn_fault_aabbs(build, g);
            for (uint32_t i = 0; i < 2 * count; i++)
                bounds_grow(structure, &boxes[i / 2][i % 2 * 3]);
        } else if (build->geometries[g].geometryType == VK_GEOMETRY_TYPE_TRIANGLES_KHR) {
            uint32_t vertices;
            float(*positions)[3] = gn_fault_positions(build, g, &vertices);
            for (uint32_t i = 0; positions && i < vertices; i++)
                bounds_grow(structure, positions[i]);
        }
    }
}

static void instances_remember(struct gn_fault_structure *structure,
                               const VkAccelerationStructureInstanceKHR *instances, uint32_t count)
{
    free(structure->instances);
    structure->instances = malloc(count * sizeof *instances + 1);
    structure->instance_count = structure->instances ? count : 0;
    if (structure->instances && count)
        memcpy(structure->instances, instances, count * sizeof *instances);
}

/* lavapipe 25.0 applies firstVertex twice; with it in the address, faults of firstVertex can be seen. */
static void first_vertex_mend(struct gn_fault_build *build, uint32_t g)
{
    VkAccelerationStructureGeometryTrianglesDataKHR *triangles = triangles_of(build, g);
    triangles->vertexData.deviceAddress += build->ranges[g].firstVertex * triangles->vertexStride;
    build->ranges[g].firstVertex = 0;
}

void gn_fault_build_make(const VkAccelerationStructureBuildGeometryInfoKHR *info,
                         const VkAccelerationStructureBuildRangeInfoKHR *ranges, struct gn_fault_build *out)
{
    const struct gn_fault *fault = gn_fault_chosen();
    const uint32_t count = info->geometryCount;
    *out = (struct gn_fault_build){.info = *info};
    out->geometries = gn_fault_memory(count * sizeof *out->geometries);
    out->ranges = gn_fault_memory(count * sizeof *out->ranges);
    for (uint32_t g = 0; g < count; g++) {
        out->geometries[g] = info->pGeometries ? info->pGeometries[g] : *info->ppGeometries[g];
        out->ranges[g] = ranges[g];
    }
    out->info.pGeometries = out->geometries;
    out->info.ppGeometries = NULL;
    out->to = gn_fault_structure_find(info->dstAccelerationStructure);
    out->from = gn_fault_is_update(out) ? gn_fault_structure_find(info->srcAccelerationStructure) : NULL;
    const bool tlas = count && out->geometries[0].geometryType == VK_GEOMETRY_TYPE_INSTANCES_KHR;
    if (fault && fault->build)
        fault->build(out);
    for (uint32_t g = 0; g < out->info.geometryCount && !tlas; g++) {
        if (fault && fault->geometry)
            fault->geometry(out, g);
        if (out->geometries[g].geometryType == VK_GEOMETRY_TYPE_TRIANGLES_KHR)
            first_vertex_mend(out, g);
    }
    if (tlas && fault && fault->instance) {
        VkAccelerationStructureInstanceKHR *instances = instances_private(out);
        /* What a fault of updates takes from the build before has to be what the application gave then. */
        VkAccelerationStructureInstanceKHR *given = NULL;
        if (!gn_fault_is_update(out) && out->to) {
            given = gn_fault_memory(out->ranges[0].primitiveCount * sizeof *given);
            memcpy(given, instances, out->ranges[0].primitiveCount * sizeof *given);
        }
        for (uint32_t i = 0; i < out->ranges[0].primitiveCount; i++)
            fault->instance(out, instances, i, out->ranges[0].primitiveCount);
        if (given)
            instances_remember(out->to, given, out->ranges[0].primitiveCount);
    }
    if (!tlas && out->to && !gn_fault_is_update(out) && fault && fault->geometry)
        bounds_remember(out);
    else if (out->to && out->from && out->from != out->to) {
        memcpy(out->to->low, out->from->low, sizeof out->to->low);
        memcpy(out->to->high, out->from->high, sizeof out->to->high);
        instances_remember(out->to, out->from->instances, out->from->instance_count);
    }
    if (out->to)
        out->to->builds++;
}
