/* SPDX-License-Identifier: Apache-2.0 */
/* Builds whose ranges lie in device memory: the ranges are copied when the GPU reads them, and for a TLAS as many instances as the
 * application allows for; both are judged once the build has completed. */
#include "layer/sync.h"

#include <stdlib.h>
#include <string.h>

struct gn_indirect_build {
    VkAccelerationStructureBuildGeometryInfoKHR info; /* of the copies below */
    uint32_t stride, element_count;
    uint64_t buffers_gone; /* of the device, when it was recorded */
    const uint32_t *maxima;
    VkDeviceSize instances_at, instances_size; /* in the capture; the ranges are at its beginning */
    VkAccelerationStructureGeometryKHR geometries[];
};

static struct gn_indirect_build *build_copy(const VkAccelerationStructureBuildGeometryInfoKHR *info, uint32_t stride,
                                            const uint32_t *maxima)
{
    uint32_t count = info->geometryCount;
    struct gn_indirect_build *build = malloc(sizeof *build + count * (sizeof build->geometries[0] + sizeof *maxima));
    if (!build)
        return NULL;
    uint32_t *kept = (uint32_t *)(void *)&build->geometries[count];
    memcpy(kept, maxima, count * sizeof *maxima);
    for (uint32_t g = 0; g < count; g++)
        build->geometries[g] = info->pGeometries ? info->pGeometries[g] : *info->ppGeometries[g];
    *build = (struct gn_indirect_build){.info = *info, .stride = stride, .element_count = count, .maxima = kept};
    build->info.pNext = NULL;
    build->info.pGeometries = build->geometries;
    build->info.ppGeometries = NULL;
    return build;
}

static const struct gn_buffer *readable(struct gn_device *device, uint64_t address, VkDeviceSize size)
{
    const struct gn_buffer *buffer = gn_buffer_holding(device, address, size);
    if (!buffer)
        buffer = gn_buffer_other(device, address, size);
    return buffer && buffer->can_copy ? buffer : NULL;
}

enum gn_unjudged gn_indirect_capture(struct gn_device *device, const struct gn_command_buffer *commands,
                                     const VkAccelerationStructureBuildGeometryInfoKHR *info, uint32_t index, VkDeviceAddress address,
                                     uint32_t stride, const uint32_t *maxima, struct gn_capture **out, struct gn_copies *copies)
{
    const VkDeviceSize one = sizeof(VkAccelerationStructureBuildRangeInfoKHR);
    if (!info->geometryCount)
        return GN_UNJUDGED_COUNT;
    if (!device->copies)
        return device->no_copies_because;
    if (commands->pool->is_protected)
        return GN_UNJUDGED_protected_content;
    if (info->flags & VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV)
        return GN_UNJUDGED_motion;
    VkDeviceSize size = (VkDeviceSize)(info->geometryCount - 1) * stride + one, instances = 0;
    const struct gn_buffer *ranges = readable(device, address, size), *records = NULL;
    if (!ranges)
        return GN_UNJUDGED_indirect_builds;
    const VkAccelerationStructureGeometryKHR *first = info->pGeometries ? info->pGeometries : info->ppGeometries[0];
    uint64_t base = first->geometry.instances.data.deviceAddress;
    if (first->geometryType == VK_GEOMETRY_TYPE_INSTANCES_KHR && !first->geometry.instances.arrayOfPointers && maxima[0]) {
        uint64_t end = gn_ranges_end(&device->inputs, base), cap = device->instance->settings.instance_cap;
        instances = (maxima[0] < cap ? maxima[0] : cap) * sizeof(struct gn_instance_record);
        if (end <= base || end - base < instances)
            instances = end <= base ? 0 : end - base;
        records = instances ? readable(device, base, instances) : NULL;
    }
    struct gn_capture *capture = calloc(1, sizeof *capture);
    struct gn_indirect_build *build = build_copy(info, stride, maxima);
    uint32_t before = copies->count;
    VkDeviceSize at = (size + 15) & ~(VkDeviceSize)15;
    if (!capture || !build || !gn_staging_take(device, at + (records ? instances : 0), capture)) {
        free(capture);
        free(build);
        return capture && build ? GN_UNJUDGED_no_copy_memory : GN_UNJUDGED_out_of_host_memory;
    }
    capture->indirect = build;
    capture->info = index;
    VkBufferCopy region = {address - ranges->range.base, capture->offset, size};
    bool good = gn_copies_add(copies, ranges->handle, gn_staging_buffer(capture), &region);
    if (records) {
        build->instances_at = at;
        build->instances_size = instances;
        region = (VkBufferCopy){base - records->range.base, capture->offset + at, instances};
        good = good && gn_copies_add(copies, records->handle, gn_staging_buffer(capture), &region);
    }
    if (!good) {
        copies->count = before;
        gn_captures_free(device, capture);
        return GN_UNJUDGED_out_of_host_memory;
    }
    build->buffers_gone = device->buffers_gone;
    *out = capture;
    return GN_UNJUDGED_COUNT;
}

static void check_maximum(struct gn_as *target, uint32_t info, uint32_t geometry, uint32_t count, uint32_t most, const char *place,
                          struct gn_device *device, struct gn_findings *out)
{
    struct gn_demand demand = {.kind = GN_DEMAND_LIMIT,
                               .place = place,
                               .target = {target->kind, (uint64_t)target->handle, target->name},
                               .target_id = target->id,
                               .info = info,
                               .geometry = geometry,
                               .what = "primitiveCount",
                               .value = count,
                               .bound = most,
                               .needs = "ppMaxPrimitiveCounts"};
    if (count > most)
        gn_report_demand(device->instance, &demand, out);
}

/* A structure that is gone by now has nothing to be said of. */
const struct gn_instance_record *gn_indirect_judge(struct gn_device *device, const struct gn_judgement *judgement, const char *place,
                                                   uint32_t *out_count, bool *out_partial, struct gn_findings *out)
{
    const struct gn_capture *capture = judgement->capture;
    const struct gn_indirect_build *build = capture->indirect;
    VkAccelerationStructureBuildRangeInfoKHR few[16], *ranges = few;
    const struct gn_instance_record *records = NULL;
    struct gn_as *target = judgement->tlas;
    struct gn_fault *faults = NULL;
    if (build->element_count > sizeof few / sizeof few[0] && !(ranges = malloc(build->element_count * sizeof *ranges))) {
        gn_tally_lost(device);
        return NULL;
    }
    bool within = true;
    for (uint32_t g = 0; g < build->element_count; g++) {
        memcpy(&ranges[g], capture->bytes + (size_t)g * build->stride, sizeof ranges[g]);
        check_maximum(target, capture->info, g, ranges[g].primitiveCount, build->maxima[g], place, device, out);
        within &= ranges[g].primitiveCount <= build->maxima[g];
    }
    /* Once a buffer is gone, its addresses may belong to another one. */
    if (build->buffers_gone != device->buffers_gone)
        gn_tally_unjudged(device, GN_UNJUDGED_indirect_builds, 1);
    else if (within)
        gn_inputs_check(device, &build->info, capture->info, ranges, &faults);
    for (struct gn_fault *fault = faults; fault; fault = fault->next)
        gn_fault_report(device, fault, place, out);
    gn_faults_free(faults);
    if (build->info.type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR) {
        uint64_t count = ranges[0].primitiveCount, offset = ranges[0].primitiveOffset;
        uint64_t room = offset % 16 || offset > build->instances_size
                            ? 0
                            : (build->instances_size - offset) / sizeof(struct gn_instance_record);
        *out_count = (uint32_t)(count < room ? count : room);
        *out_partial = *out_count < count;
        if (*out_count || !count)
            records = (const struct gn_instance_record *)(const void *)(capture->bytes + build->instances_at + offset);
        else
            gn_tally_unjudged(device, GN_UNJUDGED_indirect_builds, 1);
    } else {
        gn_tally_unjudged(device, GN_UNJUDGED_unreadable_geometry, build->element_count);
    }
    if (ranges != few)
        free(ranges);
    return records;
}
