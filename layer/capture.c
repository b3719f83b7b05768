/* SPDX-License-Identifier: Apache-2.0 */
/* Geometries of BLAS builds, read when the GPU reads them: indices, the vertices that they can stand for, transforms and boxes of one
 * geometry lie one after the other in a piece of staging memory. */
#include "layer/sbt.h"

#include <stdlib.h>
#include <string.h>

void gn_copies_init(struct gn_copies *copies)
{
    copies->list = copies->few;
    copies->count = 0;
    copies->capacity = sizeof copies->few / sizeof copies->few[0];
}

void gn_copies_finish(struct gn_copies *copies)
{
    if (copies->list != copies->few)
        free(copies->list);
}

bool gn_copies_add(struct gn_copies *copies, VkBuffer from, VkBuffer to, const VkBufferCopy *region)
{
    if (copies->count == copies->capacity) {
        uint32_t capacity = copies->capacity * 2;
        struct gn_copy *grown = realloc(copies->list == copies->few ? NULL : copies->list, capacity * sizeof *grown);
        if (!grown)
            return false;
        if (copies->list == copies->few)
            memcpy(grown, copies->few, sizeof copies->few);
        copies->list = grown;
        copies->capacity = capacity;
    }
    copies->list[copies->count++] = (struct gn_copy){from, to, *region};
    return true;
}

void gn_captures_free(struct gn_device *device, struct gn_capture *capture)
{
    for (struct gn_capture *next; capture; capture = next) {
        next = capture->next;
        gn_staging_give(device, capture);
        free(capture->contents);
        gn_sbt_capture_free(capture->sbt);
        free(capture->indirect);
        free(capture);
    }
}

struct gn_vertex_layout gn_vertex_layout_of(VkFormat format)
{
    switch (format) {
    case VK_FORMAT_R32G32_SFLOAT: return (struct gn_vertex_layout){4, 2, 8, true};
    case VK_FORMAT_R32G32B32_SFLOAT: return (struct gn_vertex_layout){4, 3, 12, true};
    case VK_FORMAT_R32G32B32A32_SFLOAT: return (struct gn_vertex_layout){4, 3, 16, true};
    case VK_FORMAT_R16G16_SFLOAT: return (struct gn_vertex_layout){2, 2, 4, true};
    case VK_FORMAT_R16G16B16_SFLOAT: return (struct gn_vertex_layout){2, 3, 6, true};
    case VK_FORMAT_R16G16B16A16_SFLOAT: return (struct gn_vertex_layout){2, 3, 8, true};
    case VK_FORMAT_R64G64_SFLOAT: return (struct gn_vertex_layout){8, 2, 16, true};
    case VK_FORMAT_R64G64B64_SFLOAT: return (struct gn_vertex_layout){8, 3, 24, true};
    case VK_FORMAT_R64G64B64A64_SFLOAT: return (struct gn_vertex_layout){8, 3, 32, true};
    case VK_FORMAT_R16G16_SNORM:
    case VK_FORMAT_R16G16_UNORM: return (struct gn_vertex_layout){2, 2, 4, false};
    case VK_FORMAT_R16G16B16_SNORM:
    case VK_FORMAT_R16G16B16_UNORM: return (struct gn_vertex_layout){2, 3, 6, false};
    case VK_FORMAT_R16G16B16A16_SNORM:
    case VK_FORMAT_R16G16B16A16_UNORM: return (struct gn_vertex_layout){2, 3, 8, false};
    case VK_FORMAT_R8G8_SNORM:
    case VK_FORMAT_R8G8_UNORM: return (struct gn_vertex_layout){1, 2, 2, false};
    case VK_FORMAT_R8G8B8_SNORM:
    case VK_FORMAT_R8G8B8_UNORM: return (struct gn_vertex_layout){1, 3, 3, false};
    case VK_FORMAT_R8G8B8A8_SNORM:
    case VK_FORMAT_R8G8B8A8_UNORM: return (struct gn_vertex_layout){1, 3, 4, false};
    default: return (struct gn_vertex_layout){0};
    }
}

#define PART_ALIGNMENT ((VkDeviceSize)16)
/* Where maxVertex allows for so many times the vertices that the indices can name, the array is likely that of a whole scene. */
#define SPARSE 16

/* An array of elements in the application's memory, and how much of it is read. */
struct part {
    const struct gn_buffer *buffer; /* NULL: nothing is read */
    uint64_t address, count, stride, element;
    uint64_t in_buffer; /* elements that lie in the buffer as a whole; UINT64_MAX: not known */
    VkDeviceSize size, offset;
};

/* The bytes of `count` elements; UINT64_MAX when that does not fit. */
static uint64_t span_of(uint64_t count, uint64_t stride, uint64_t element)
{
    uint64_t span;
    if (!count)
        return 0;
    return __builtin_mul_overflow(count - 1, stride, &span) || __builtin_add_overflow(span, element, &span) ? UINT64_MAX : span;
}

/* How many elements the buffer has room for. */
static void measure(const struct gn_device *device, struct part *part)
{
    uint64_t end = gn_ranges_end(&device->inputs, part->address);
    part->in_buffer = UINT64_MAX;
    if (end <= part->address || !part->element)
        return;
    uint64_t room = end - part->address;
    part->in_buffer = room < part->element ? 0 : part->stride ? (room - part->element) / part->stride + 1 : UINT64_MAX;
}

static void leave_unread(struct gn_device *device, struct part *part, enum gn_unjudged why, uint64_t how_many)
{
    gn_tally_unjudged(device, why, how_many);
    part->buffer = NULL;
    part->count = part->size = 0;
}

/* Decides how much of an array is read within the `budget` and the buffer, in whole groups of elements. False if that is not all. */
static bool plan(struct gn_device *device, struct part *part, uint64_t group, VkDeviceSize *budget, VkDeviceSize *size)
{
    uint64_t wanted = part->count, count;
    measure(device, part);
    count = wanted < part->in_buffer ? wanted : part->in_buffer;
    if (span_of(count, part->stride, part->element) > *budget) {
        uint64_t fit = *budget < part->element ? 0 : (*budget - part->element) / part->stride + 1;
        gn_tally_unjudged(device, GN_UNJUDGED_above_input_cap, count - fit);
        count = fit;
    }
    count -= count % group;
    if (!count) {
        part->count = 0;
        return !wanted;
    }
    part->count = count;
    part->size = span_of(count, part->stride, part->element);
    part->buffer = gn_buffer_holding(device, part->address, part->size);
    if (!part->buffer || !part->buffer->can_copy) {
        leave_unread(device, part, GN_UNJUDGED_unreadable_geometry, 1);
        return false;
    }
    *budget -= part->size;
    part->offset = (*size + PART_ALIGNMENT - 1) & ~(PART_ALIGNMENT - 1);
    *size = part->offset + part->size;
    return count == wanted;
}

static bool copy_part(const struct part *part, const struct gn_capture *capture, struct gn_copies *copies)
{
    VkBufferCopy region = {part->address - (part->buffer ? part->buffer->range.base : 0), capture->offset + part->offset, part->size};
    return !part->buffer || gn_copies_add(copies, part->buffer->handle, gn_staging_buffer(capture), &region);
}

uint32_t gn_index_size(VkIndexType type)
{
    return type == VK_INDEX_TYPE_UINT16 ? 2 : type == VK_INDEX_TYPE_UINT32 ? 4 : type == VK_INDEX_TYPE_UINT8_EXT ? 1 : 0;
}

struct parts {
    struct part indices, vertices, transform, boxes;
};

static void plan_triangles(struct gn_device *device, const VkAccelerationStructureGeometryTrianglesDataKHR *triangles,
                           const VkAccelerationStructureBuildRangeInfoKHR *range, struct parts *parts,
                           struct gn_geometry_contents *contents, VkDeviceSize *budget, VkDeviceSize *size)
{
    struct gn_vertex_layout layout = gn_vertex_layout_of(triangles->vertexFormat);
    bool indexed = triangles->indexType != VK_INDEX_TYPE_NONE_KHR;
    uint64_t corners = (uint64_t)range->primitiveCount * 3, skipped = (uint64_t)range->firstVertex * triangles->vertexStride;
    if (indexed) {
        contents->index_size = gn_index_size(triangles->indexType);
        parts->indices = (struct part){.address = triangles->indexData.deviceAddress + range->primitiveOffset,
                                       .count = corners,
                                       .stride = contents->index_size,
                                       .element = contents->index_size};
        contents->partial |= !plan(device, &parts->indices, 3, budget, size);
    }
    parts->vertices = (struct part){.address = triangles->vertexData.deviceAddress + skipped + (indexed ? 0 : range->primitiveOffset),
                                    .count = indexed ? (uint64_t)triangles->maxVertex + 1 : corners,
                                    .stride = triangles->vertexStride,
                                    .element = layout.size};
    measure(device, &parts->vertices);
    if (!layout.floating || (indexed && !parts->indices.count)) /* integers are finite; and of vertices alone nothing can be said */
        parts->vertices.count = 0;
    else if (indexed && parts->vertices.count / SPARSE > corners)
        leave_unread(device, &parts->vertices, GN_UNJUDGED_above_input_cap, parts->vertices.count);
    else if (!plan(device, &parts->vertices, 1, budget, size) && !indexed)
        contents->partial = true;
    contents->component_size = layout.component_size;
    contents->component_count = layout.floating ? layout.coordinates : 0;
    contents->max_vertex = triangles->maxVertex;
    contents->index_count = indexed ? parts->indices.count : parts->vertices.count - parts->vertices.count % 3;
    contents->vertex_stride = triangles->vertexStride;
    contents->vertex_count = parts->vertices.count;
    contents->vertices_in_buffer = parts->vertices.in_buffer;
    if (triangles->transformData.deviceAddress && range->primitiveCount) {
        parts->transform = (struct part){.address = triangles->transformData.deviceAddress + range->transformOffset,
                                         .count = 1,
                                         .stride = sizeof(VkTransformMatrixKHR),
                                         .element = sizeof(VkTransformMatrixKHR)};
        plan(device, &parts->transform, 1, budget, size);
    }
}

/* One geometry; NULL when there is nothing to read, or no memory for it. */
static struct gn_capture *capture_one(struct gn_device *device, const VkAccelerationStructureGeometryKHR *geometry,
                                      const VkAccelerationStructureBuildRangeInfoKHR *range, VkDeviceSize *budget,
                                      struct gn_copies *copies)
{
    struct parts parts = {.indices = {0}};
    struct gn_geometry_contents found = {.partial = false};
    VkDeviceSize size = 0;
    if (geometry->geometryType == VK_GEOMETRY_TYPE_TRIANGLES_KHR) {
        plan_triangles(device, &geometry->geometry.triangles, range, &parts, &found, budget, &size);
    } else if (geometry->geometryType == VK_GEOMETRY_TYPE_AABBS_KHR) {
        parts.boxes = (struct part){.address = geometry->geometry.aabbs.data.deviceAddress + range->primitiveOffset,
                                    .count = range->primitiveCount,
                                    .stride = geometry->geometry.aabbs.stride,
                                    .element = sizeof(VkAabbPositionsKHR)};
        found.partial = !plan(device, &parts.boxes, 1, budget, &size);
        found.box_stride = geometry->geometry.aabbs.stride;
        found.box_count = parts.boxes.count;
    }
    if (!size)
        return NULL;
    struct gn_capture *capture = calloc(1, sizeof *capture);
    struct gn_geometry_contents *contents = malloc(sizeof *contents);
    if (!capture || !contents)
        goto fail;
    if (!gn_staging_take(device, size, capture)) {
        gn_tally_unjudged(device, GN_UNJUDGED_unreadable_geometry, 1);
        goto undone;
    }
    uint32_t before = copies->count;
    if (!copy_part(&parts.indices, capture, copies) || !copy_part(&parts.vertices, capture, copies) ||
        !copy_part(&parts.transform, capture, copies) || !copy_part(&parts.boxes, capture, copies)) {
        copies->count = before;
        gn_staging_give(device, capture);
        goto fail;
    }
    found.indices = parts.indices.buffer ? capture->bytes + parts.indices.offset : NULL;
    found.vertices = parts.vertices.buffer ? capture->bytes + parts.vertices.offset : NULL;
    found.transform = parts.transform.buffer ? capture->bytes + parts.transform.offset : NULL;
    found.boxes = parts.boxes.buffer ? capture->bytes + parts.boxes.offset : NULL;
    *contents = found;
    capture->contents = contents;
    capture->partial = found.partial;
    return capture;
fail:
    gn_tally_unjudged(device, GN_UNJUDGED_out_of_host_memory, 1);
undone:
    free(capture);
    free(contents);
    return NULL;
}

void gn_geometry_capture(struct gn_device *device, const struct gn_command_buffer *commands,
                         const VkAccelerationStructureBuildGeometryInfoKHR *info, uint32_t index,
                         const VkAccelerationStructureBuildRangeInfoKHR *ranges, struct gn_capture **out, struct gn_copies *copies)
{
    VkDeviceSize budget = device->instance->settings.input_cap;
    if (!budget || !info->geometryCount)
        return;
    if (!device->copies || commands->pool->is_protected || (info->flags & VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV)) {
        gn_tally_unjudged(device, GN_UNJUDGED_unreadable_geometry, info->geometryCount);
        return;
    }
    for (uint32_t g = 0; g < info->geometryCount; g++) {
        const VkAccelerationStructureGeometryKHR *geometry = info->pGeometries ? &info->pGeometries[g] : info->ppGeometries[g];
        if (!ranges[g].primitiveCount)
            continue;
        struct gn_capture *capture = capture_one(device, geometry, &ranges[g], &budget, copies);
        if (!capture)
            continue;
        capture->info = index;
        capture->geometry = g;
        *out = capture;
        out = &capture->next;
    }
}
