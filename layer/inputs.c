/* SPDX-License-Identifier: Apache-2.0 */
/* What can be said of a build when it is recorded: whether its input lies within a buffer, and whether the builds of one command get
 * in each other's way. Only what looks wrong is kept, for the rules to judge once it is executed. */
#include "layer/layer.h"

#include <stdlib.h>

void gn_faults_free(struct gn_fault *fault)
{
    for (struct gn_fault *next; fault; fault = next) {
        next = fault->next;
        gn_as_release(fault->structures[0]);
        gn_as_release(fault->structures[1]);
        free(fault);
    }
}

static void keep_fault(struct gn_device *device, const struct gn_fault *fault, struct gn_fault **out)
{
    struct gn_fault *kept = malloc(sizeof *kept);
    if (!kept) {
        gn_tally_lost(device);
        return;
    }
    *kept = *fault;
    gn_as_keep(kept->structures[0]);
    gn_as_keep(kept->structures[1]);
    kept->next = *out;
    *out = kept;
}

static struct gn_object object_of(const struct gn_as *as)
{
    return (struct gn_object){as->kind, (uint64_t)as->handle, NULL};
}

/* The bytes between the first and the end of an array; UINT64_MAX when that does not fit. */
static uint64_t span_of(const struct gn_input *input)
{
    uint64_t span;
    if (__builtin_mul_overflow(input->count - 1, input->stride, &span) ||
        __builtin_add_overflow(span, input->element_size, &span))
        return UINT64_MAX;
    return span;
}

/* Nothing is said of an array that begins in no buffer that the layer knows. */
static void check_range(struct gn_device *device, struct gn_as *target, struct gn_input *input, struct gn_fault **out)
{
    uint64_t begin;
    bool many = input->bound && input->count > input->bound;
    if (!input->count || __builtin_add_overflow(input->address, input->offset, &begin))
        return;
    uint64_t span = span_of(input);
    struct gn_buffer *first = span <= UINT64_MAX - begin ? gn_buffer_holding(device, begin, span) : NULL;
    bool fits = first != NULL;
    if (!first)
        first = gn_buffer_holding(device, begin, 1);
    if (!many && (fits || !first))
        return;
    input->target = object_of(target);
    input->target_id = target->id;
    input->buffer_address = first ? first->range.base : 0;
    input->buffer_size = first ? first->range.size : 0;
    keep_fault(device, &(struct gn_fault){.kind = GN_FAULT_INPUT, .of.input = *input, .structures = {target}}, out);
}

/* What is being checked, for the faults that are found in it. */
struct subject {
    struct gn_device *device;
    struct gn_as *target;
    uint32_t info, geometry;
    struct gn_fault **out;
};

static void demand(const struct subject *subject, enum gn_demand_kind kind, const char *what, uint64_t value, uint64_t bound,
                   const char *needs, const struct gn_buffer *buffer)
{
    struct gn_demand found = {.kind = kind,
                              .target = object_of(subject->target),
                              .target_id = subject->target->id,
                              .info = subject->info,
                              .geometry = subject->geometry,
                              .what = what,
                              .value = value,
                              .bound = bound,
                              .needs = needs};
    if (buffer)
        found.buffer = (struct gn_object){GN_OBJECT_BUFFER, (uint64_t)buffer->handle, NULL};
    keep_fault(subject->device,
               &(struct gn_fault){.kind = GN_FAULT_DEMAND, .of.demand = found, .structures = {subject->target}}, subject->out);
}

static void check_alignment(const struct subject *subject, const char *what, uint64_t value, uint64_t alignment)
{
    if (alignment > 1 && value % alignment)
        demand(subject, GN_DEMAND_ALIGNMENT, what, value, alignment, NULL, NULL);
}

static void check_limit(const struct subject *subject, const char *what, uint64_t value, uint64_t limit, const char *name)
{
    if (limit && value > limit)
        demand(subject, GN_DEMAND_LIMIT, what, value, limit, name, NULL);
}

/* An address in no buffer that is known says nothing. */
static void check_usage(const struct subject *subject, const char *what, uint64_t address, VkBufferUsageFlags2 usage, const char *name)
{
    struct gn_buffer *around;
    if (!gn_buffer_has_usage(subject->device, address, usage, &around) && around)
        demand(subject, GN_DEMAND_USAGE, what, address, 0, name, around);
}

#define BUILD_INPUT VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR

static void check_address(const struct subject *subject, const char *what, uint64_t address, uint64_t alignment)
{
    check_alignment(subject, what, address, alignment);
    check_usage(subject, what, address, BUILD_INPUT, "VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR");
}

static void check_geometry(const struct subject *subject, const VkAccelerationStructureGeometryKHR *geometry,
                           const VkAccelerationStructureBuildRangeInfoKHR *range)
{
    if (!range->primitiveCount)
        return;
    if (geometry->geometryType == VK_GEOMETRY_TYPE_INSTANCES_KHR) {
        const VkAccelerationStructureGeometryInstancesDataKHR *instances = &geometry->geometry.instances;
        check_address(subject, "instances.data.deviceAddress", instances->data.deviceAddress, instances->arrayOfPointers ? 8 : 16);
        if (!instances->arrayOfPointers)
            check_alignment(subject, "primitiveOffset", range->primitiveOffset, 16);
    } else if (geometry->geometryType == VK_GEOMETRY_TYPE_AABBS_KHR) {
        check_address(subject, "aabbs.data.deviceAddress", geometry->geometry.aabbs.data.deviceAddress, 8);
        check_alignment(subject, "aabbs.stride", geometry->geometry.aabbs.stride, 8);
        check_limit(subject, "aabbs.stride", geometry->geometry.aabbs.stride, UINT32_MAX, "2^32 - 1");
        check_alignment(subject, "primitiveOffset", range->primitiveOffset, 8);
    } else if (geometry->geometryType == VK_GEOMETRY_TYPE_TRIANGLES_KHR) {
        const VkAccelerationStructureGeometryTrianglesDataKHR *triangles = &geometry->geometry.triangles;
        uint32_t component = gn_vertex_layout_of(triangles->vertexFormat).component_size;
        check_address(subject, "triangles.vertexData.deviceAddress", triangles->vertexData.deviceAddress, component);
        check_alignment(subject, "triangles.vertexStride", triangles->vertexStride, component);
        check_limit(subject, "triangles.vertexStride", triangles->vertexStride, UINT32_MAX, "2^32 - 1");
        if (triangles->indexType == VK_INDEX_TYPE_NONE_KHR) {
            check_alignment(subject, "primitiveOffset", range->primitiveOffset, component);
        } else {
            check_address(subject, "triangles.indexData.deviceAddress", triangles->indexData.deviceAddress,
                          gn_index_size(triangles->indexType));
            check_alignment(subject, "primitiveOffset", range->primitiveOffset, gn_index_size(triangles->indexType));
        }
        if (triangles->transformData.deviceAddress) {
            check_address(subject, "triangles.transformData.deviceAddress", triangles->transformData.deviceAddress, 16);
            check_alignment(subject, "transformOffset", range->transformOffset, 16);
        }
    }
}

/* The sizes that the driver gives for the build; all 0 without an answer. */
static VkAccelerationStructureBuildSizesInfoKHR sizes_of(struct gn_device *device,
                                                         const VkAccelerationStructureBuildGeometryInfoKHR *info,
                                                         const VkAccelerationStructureBuildRangeInfoKHR *ranges)
{
    uint32_t few[16], *counts = few;
    VkAccelerationStructureBuildSizesInfoKHR sizes = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR};
    if (info->geometryCount > sizeof few / sizeof few[0] && !(counts = malloc(info->geometryCount * sizeof *counts)))
        return sizes;
    for (uint32_t g = 0; g < info->geometryCount; g++)
        counts[g] = ranges[g].primitiveCount;
    if (device->next.GetAccelerationStructureBuildSizesKHR)
        device->next.GetAccelerationStructureBuildSizesKHR(device->handle, VK_ACCELERATION_STRUCTURE_BUILD_TYPE_DEVICE_KHR, info,
                                                           counts, &sizes);
    if (counts != few)
        free(counts);
    return sizes;
}

static void check_whole(const struct subject *subject, const VkAccelerationStructureBuildGeometryInfoKHR *info,
                        const VkAccelerationStructureBuildRangeInfoKHR *ranges)
{
    const VkPhysicalDeviceAccelerationStructurePropertiesKHR *limits = &subject->device->limits;
    bool is_top = info->type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR;
    bool update = info->mode == VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
    uint64_t primitives = 0;
    for (uint32_t g = 0; g < info->geometryCount; g++)
        primitives += ranges[g].primitiveCount;
    if (is_top) {
        check_limit(subject, "primitiveCount", primitives, limits->maxInstanceCount, "maxInstanceCount");
    } else {
        check_limit(subject, "geometryCount", info->geometryCount, limits->maxGeometryCount, "maxGeometryCount");
        check_limit(subject, "the sum of primitiveCount", primitives, limits->maxPrimitiveCount, "maxPrimitiveCount");
    }
    VkAccelerationStructureBuildSizesInfoKHR sizes = sizes_of(subject->device, info, ranges);
    if (!update && subject->target->size < sizes.accelerationStructureSize)
        demand(subject, GN_DEMAND_STORAGE, "size", subject->target->size, sizes.accelerationStructureSize, NULL, NULL);
    VkDeviceSize scratch = update ? sizes.updateScratchSize : sizes.buildScratchSize;
    uint64_t address = info->scratchData.deviceAddress, end = gn_buffers_end(subject->device, address);
    if (!scratch)
        return;
    check_alignment(subject, "scratchData.deviceAddress", address, limits->minAccelerationStructureScratchOffsetAlignment);
    check_usage(subject, "scratchData.deviceAddress", address, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, "VK_BUFFER_USAGE_STORAGE_BUFFER_BIT");
    if (end > address && end - address < scratch)
        demand(subject, GN_DEMAND_SCRATCH, "scratchData.deviceAddress", end - address, scratch,
               update ? "updateScratchSize" : "buildScratchSize", NULL);
}

void gn_inputs_check(struct gn_device *device, const VkAccelerationStructureBuildGeometryInfoKHR *info, uint32_t index,
                     const VkAccelerationStructureBuildRangeInfoKHR *ranges, struct gn_fault **out)
{
    struct gn_as *target = gn_as_get(device, info->dstAccelerationStructure);
    if (!target || (info->flags & VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV))
        return;
    struct subject subject = {device, target, index, GN_NO_INDEX, out};
    check_whole(&subject, info, ranges);
    for (uint32_t g = 0; g < info->geometryCount; g++) {
        const VkAccelerationStructureGeometryKHR *geometry =
            info->pGeometries ? &info->pGeometries[g] : info->ppGeometries[g];
        const VkAccelerationStructureBuildRangeInfoKHR *range = &ranges[g];
        subject.geometry = g;
        check_geometry(&subject, geometry, range);
        const VkAccelerationStructureGeometryTrianglesDataKHR *triangles = &geometry->geometry.triangles;
        struct gn_input input = {
            .info = index, .geometry = g, .offset = range->primitiveOffset, .count = range->primitiveCount};
        if (geometry->geometryType == VK_GEOMETRY_TYPE_INSTANCES_KHR) {
            bool pointers = geometry->geometry.instances.arrayOfPointers;
            input.what = "instances.data";
            input.address = geometry->geometry.instances.data.deviceAddress;
            input.stride = input.element_size = pointers ? 8 : sizeof(VkAccelerationStructureInstanceKHR);
            check_range(device, target, &input, out);
        } else if (geometry->geometryType == VK_GEOMETRY_TYPE_AABBS_KHR) {
            input.what = "aabbs.data";
            input.address = geometry->geometry.aabbs.data.deviceAddress;
            input.stride = geometry->geometry.aabbs.stride;
            input.element_size = sizeof(VkAabbPositionsKHR);
            check_range(device, target, &input, out);
        } else if (geometry->geometryType == VK_GEOMETRY_TYPE_TRIANGLES_KHR && range->primitiveCount) {
            input.count = (uint64_t)range->primitiveCount * 3;
            if (triangles->indexType == VK_INDEX_TYPE_NONE_KHR) {
                input.what = "triangles.vertexData";
                input.address = triangles->vertexData.deviceAddress;
                input.stride = triangles->vertexStride;
                input.element_size = gn_vertex_layout_of(triangles->vertexFormat).size;
                input.element_size += !input.element_size;
                input.bound = (uint64_t)triangles->maxVertex + 1;
                uint64_t skipped;
                if (!__builtin_mul_overflow(range->firstVertex, input.stride, &skipped) &&
                    !__builtin_add_overflow(input.offset, skipped, &input.offset))
                    check_range(device, target, &input, out);
            } else {
                input.what = "triangles.indexData";
                input.address = triangles->indexData.deviceAddress;
                input.stride = input.element_size = gn_index_size(triangles->indexType);
                if (input.element_size)
                    check_range(device, target, &input, out);
            }
            if (triangles->transformData.deviceAddress) {
                struct gn_input transform = {.info = index,
                                             .geometry = g,
                                             .what = "triangles.transformData",
                                             .address = triangles->transformData.deviceAddress,
                                             .offset = range->transformOffset,
                                             .count = 1,
                                             .element_size = sizeof(VkTransformMatrixKHR)};
                check_range(device, target, &transform, out);
            }
        }
    }
}

uint64_t gn_inputs_scratch_size(struct gn_device *device, const VkAccelerationStructureBuildGeometryInfoKHR *info,
                                const VkAccelerationStructureBuildRangeInfoKHR *ranges)
{
    VkAccelerationStructureBuildSizesInfoKHR sizes = sizes_of(device, info, ranges);
    return info->mode == VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR ? sizes.updateScratchSize : sizes.buildScratchSize;
}

/* The index is stored one higher, for 0 is nothing. */
static uint32_t index_in(const struct gn_map *map, uint64_t key)
{
    uintptr_t found = key ? (uintptr_t)gn_map_get(map, key) : 0;
    return found ? (uint32_t)(found - 1) : UINT32_MAX;
}

/* Remembers which element used `key` first. Without memory less is found. */
static uint32_t claim(struct gn_map *map, uint64_t key, uint32_t index)
{
    uint32_t first = index_in(map, key);
    if (key && first == UINT32_MAX)
        gn_map_put(map, key, (void *)(uintptr_t)(index + 1));
    return first;
}

static void keep_clash(struct gn_device *device, enum gn_clash_kind kind, uint32_t first, struct gn_as *first_as, uint32_t second,
                       struct gn_as *second_as, uint64_t address, struct gn_fault **out)
{
    if (!first_as || !second_as)
        return;
    keep_fault(device,
               &(struct gn_fault){.kind = GN_FAULT_CLASH,
                                  .of.clash = {.kind = kind,
                                               .first = first,
                                               .second = second,
                                               .first_target = object_of(first_as),
                                               .second_target = object_of(second_as),
                                               .first_id = first_as->id,
                                               .second_id = second_as->id,
                                               .address = address},
                                  .structures = {first_as, second_as}},
               out);
}

void gn_inputs_check_together(struct gn_device *device, const VkAccelerationStructureBuildGeometryInfoKHR *infos,
                              const VkAccelerationStructureBuildRangeInfoKHR *const *ranges, uint32_t count,
                              struct gn_fault **out)
{
    struct gn_map targets = {0}, scratches = {0};
    for (uint32_t i = 0; i < count; i++) {
        struct gn_as *target = gn_as_get(device, infos[i].dstAccelerationStructure);
        uint64_t scratch = infos[i].scratchData.deviceAddress;
        uint32_t first = claim(&targets, (uint64_t)infos[i].dstAccelerationStructure, i);
        if (first != UINT32_MAX)
            keep_clash(device, GN_CLASH_TARGETS, first, target, i, target, 0, &out[i]);
        first = claim(&scratches, scratch, i);
        if (first != UINT32_MAX && gn_inputs_scratch_size(device, &infos[i], ranges[i]) &&
            gn_inputs_scratch_size(device, &infos[first], ranges[first]))
            keep_clash(device, GN_CLASH_SCRATCH, first, gn_as_get(device, infos[first].dstAccelerationStructure), i, target,
                       scratch, &out[i]);
    }
    for (uint32_t i = 0; i < count; i++) {
        if (infos[i].mode != VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR)
            continue;
        uint32_t writer = index_in(&targets, (uint64_t)infos[i].srcAccelerationStructure);
        if (writer != UINT32_MAX && writer != i)
            keep_clash(device, GN_CLASH_SOURCE, writer, gn_as_get(device, infos[i].srcAccelerationStructure), i,
                       gn_as_get(device, infos[i].dstAccelerationStructure), 0, &out[i]);
    }
    gn_map_finish(&targets);
    gn_map_finish(&scratches);
}
