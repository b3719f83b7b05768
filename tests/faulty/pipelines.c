/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Ray tracing pipelines on their way to the driver, and the faults that only they can have: shader groups, their handles,
 * tables of records, indirect traces, what shaders of the stages do.
 */
#include <stdlib.h>
#include <string.h>

#include <spirv/unified1/spirv.h>

#include "tests/faulty/faulty.h"

/* Pipelines that were linked from libraries. Handles come back after destruction: the newest counts. */
enum { MOST_PIPELINES = 256 };
static struct {
    VkPipeline handle;
    bool linked;
} pipelines[MOST_PIPELINES];
static uint32_t pipeline_count;

void gn_fault_pipeline_remember(VkPipeline handle, const VkRayTracingPipelineCreateInfoKHR *info)
{
    pipelines[pipeline_count % MOST_PIPELINES].handle = handle;
    pipelines[pipeline_count++ % MOST_PIPELINES].linked = info->pLibraryInfo && info->pLibraryInfo->libraryCount;
}

bool gn_fault_pipeline_linked(VkPipeline handle)
{
    for (uint32_t i = pipeline_count; i > 0 && i + MOST_PIPELINES > pipeline_count; i--)
        if (pipelines[(i - 1) % MOST_PIPELINES].handle == handle)
            return pipelines[(i - 1) % MOST_PIPELINES].linked;
    return false;
}

VkRayTracingShaderGroupCreateInfoKHR *gn_fault_groups(const struct gn_fault *fault,
                                                      const VkRayTracingPipelineCreateInfoKHR *info)
{
    VkRayTracingShaderGroupCreateInfoKHR *groups = malloc((info->groupCount + 1) * sizeof *groups);
    if (!groups)
        abort();
    for (uint32_t g = 0; g < info->groupCount; g++) {
        groups[g] = info->pGroups[g];
        fault->group(&groups[g]);
    }
    return groups;
}

/* The size and tables of an indirect trace are read when it is recorded: who uses this layer has written them by then. */
void gn_fault_indirect_read(VkDeviceAddress address, struct gn_fault_trace *trace)
{
    const VkTraceRaysIndirectCommandKHR *size = (const VkTraceRaysIndirectCommandKHR *)(uintptr_t)address;
    trace->size[0] = size->width;
    trace->size[1] = size->height;
    trace->size[2] = size->depth;
    trace->indirect = true;
}

void gn_fault_indirect2_read(VkDeviceAddress address, struct gn_fault_trace *trace)
{
    const VkTraceRaysIndirectCommand2KHR *command = (const VkTraceRaysIndirectCommand2KHR *)(uintptr_t)address;
    trace->raygen = (VkStridedDeviceAddressRegionKHR){command->raygenShaderRecordAddress, command->raygenShaderRecordSize,
                                                      command->raygenShaderRecordSize};
    trace->miss = (VkStridedDeviceAddressRegionKHR){command->missShaderBindingTableAddress,
                                                    command->missShaderBindingTableStride,
                                                    command->missShaderBindingTableSize};
    trace->hit = (VkStridedDeviceAddressRegionKHR){command->hitShaderBindingTableAddress,
                                                   command->hitShaderBindingTableStride,
                                                   command->hitShaderBindingTableSize};
    trace->callable = (VkStridedDeviceAddressRegionKHR){command->callableShaderBindingTableAddress,
                                                        command->callableShaderBindingTableStride,
                                                        command->callableShaderBindingTableSize};
    trace->size[0] = command->width;
    trace->size[1] = command->height;
    trace->size[2] = command->depth;
    trace->indirect = true;
}

uint8_t *gn_fault_table(VkStridedDeviceAddressRegionKHR *region)
{
    uint8_t *copy = gn_fault_memory(region->size);
    memcpy(copy, (const void *)(uintptr_t)region->deviceAddress, region->size);
    region->deviceAddress = (VkDeviceAddress)(uintptr_t)copy;
    return copy;
}

/* Tables up to this size are copied; lavapipe's handles, and records of the suite as it aligns them. */
enum { MOST_TABLE_BYTES = 1 << 20, HANDLE_BYTES = 32, LEAST_STRIDE = 48 };

static void closest_hit_of_boxes_lost(VkRayTracingShaderGroupCreateInfoKHR *group)
{
    if (group->type == VK_RAY_TRACING_SHADER_GROUP_TYPE_PROCEDURAL_HIT_GROUP_KHR)
        group->closestHitShader = VK_SHADER_UNUSED_KHR;
}

static void any_hit_of_boxes_lost(VkRayTracingShaderGroupCreateInfoKHR *group)
{
    if (group->type == VK_RAY_TRACING_SHADER_GROUP_TYPE_PROCEDURAL_HIT_GROUP_KHR)
        group->anyHitShader = VK_SHADER_UNUSED_KHR;
}

static void any_hit_of_triangles_lost(VkRayTracingShaderGroupCreateInfoKHR *group)
{
    if (group->type == VK_RAY_TRACING_SHADER_GROUP_TYPE_TRIANGLES_HIT_GROUP_KHR)
        group->anyHitShader = VK_SHADER_UNUSED_KHR;
}

/* Groups 2 and 3 are the suite's hit groups: for triangles, and for boxes. */
static void handles_swapped(uint32_t count, size_t size, uint8_t *handles)
{
    uint8_t first[64];
    if (count < 4 || size > sizeof first)
        return;
    memcpy(first, handles + 2 * size, size);
    memcpy(handles + 2 * size, handles + 3 * size, size);
    memcpy(handles + 3 * size, first, size);
}

static void handles_of_linked_swapped(bool linked, uint32_t count, size_t size, uint8_t *handles)
{
    if (linked)
        handles_swapped(count, size, handles);
}

static void handle_of_last(bool linked, uint32_t count, size_t size, uint8_t *handles)
{
    (void)linked;
    if (count >= 4)
        memcpy(handles + 3 * size, handles + 2 * size, size);
}

static void hit_stride(struct gn_fault_trace *trace)
{
    if (trace->hit.stride > LEAST_STRIDE)
        trace->hit.stride = LEAST_STRIDE;
}

static void miss_stride(struct gn_fault_trace *trace)
{
    if (trace->miss.stride > LEAST_STRIDE)
        trace->miss.stride = LEAST_STRIDE;
}

static void callable_stride(struct gn_fault_trace *trace)
{
    if (trace->callable.stride > LEAST_STRIDE)
        trace->callable.stride = LEAST_STRIDE;
}

static void hit_stride_10_bits(struct gn_fault_trace *trace)
{
    trace->hit.stride %= 1024;
}

/* A record whose handle is zeros runs what the record before it runs. */
static void null_records_run(struct gn_fault_trace *trace)
{
    static const uint8_t nothing[HANDLE_BYTES];
    VkStridedDeviceAddressRegionKHR *hit = &trace->hit;
    if (!hit->stride || hit->size > MOST_TABLE_BYTES)
        return;
    uint8_t *records = gn_fault_table(hit);
    for (VkDeviceSize at = hit->stride; at + hit->stride <= hit->size; at += hit->stride)
        if (memcmp(records + at, nothing, sizeof nothing) == 0)
            memcpy(records + at, records + at - hit->stride, sizeof nothing);
}

static void launch_layers_lost(struct gn_fault_trace *trace)
{
    trace->size[2] = 1;
}

static void indirect_swapped(struct gn_fault_trace *trace)
{
    if (trace->indirect) {
        const uint32_t width = trace->size[0];
        trace->size[0] = trace->size[1];
        trace->size[1] = width;
    }
}

static void indirect_layers_lost(struct gn_fault_trace *trace)
{
    if (trace->indirect)
        trace->size[2] = 1;
}

static void indirect_callable_lost(struct gn_fault_trace *trace)
{
    if (trace->indirect && trace->callable.size)
        trace->callable.deviceAddress += trace->callable.stride;
}

static void limit_attribute(VkPhysicalDeviceRayTracingPipelinePropertiesKHR *limits)
{
    limits->maxRayHitAttributeSize = 16;
}

static void limit_stride(VkPhysicalDeviceRayTracingPipelinePropertiesKHR *limits)
{
    limits->maxShaderGroupStride = 2048;
}

#define SHADER(n, t, ...) {.name = n, .text = t, .edits = __VA_ARGS__}
#define TRACE(n, t, function) {.name = n, .text = t, .trace = function}
#define GROUP(n, t, function) {.name = n, .text = t, .group = function}
#define HANDLES(n, t, function) {.name = n, .text = t, .handles = function}
/* Of OpTraceRayKHR alone: which record a hit or a miss selects. */
#define ON_TRACES(word, change, value) {{SpvOpTraceRayKHR, word, 0, change, value, 0}}

const struct gn_fault gn_pipeline_faults[] = {
    SHADER("records.offset", "the trace's SBT offset is ignored", ON_TRACES(4, GN_FAULT_AND, 0)),
    SHADER("records.offset_3_bits", "the trace's SBT offset is cut to 3 bits", ON_TRACES(4, GN_FAULT_AND, 7)),
    SHADER("records.stride", "the geometry's index does not count for the record", ON_TRACES(5, GN_FAULT_AND, 0)),
    SHADER("records.stride_1", "the trace's SBT stride is taken for 1",
           {{SpvOpTraceRayKHR, 5, 0, GN_FAULT_AND, 0, 0}, {SpvOpTraceRayKHR, 5, 0, GN_FAULT_OR, 1, 0}}),
    SHADER("records.stride_3_bits", "the trace's SBT stride is cut to 3 bits", ON_TRACES(5, GN_FAULT_AND, 7)),
    SHADER("records.miss", "every miss runs the first record", ON_TRACES(6, GN_FAULT_AND, 0)),
    SHADER("records.miss_3_bits", "the index of the miss record is cut to 3 bits", ON_TRACES(6, GN_FAULT_AND, 7)),
    SHADER("records.callable", "the index of the callable record is cut to 1 bit",
           {{SpvOpExecuteCallableKHR, 1, 0, GN_FAULT_AND, 1, 0}}),
    TRACE("table.hit_stride", "hit records lie as close as they can, whatever the stride says", hit_stride),
    TRACE("table.hit_stride_10_bits", "the stride of hit records is cut to 10 bits", hit_stride_10_bits),
    TRACE("table.miss_stride", "miss records lie as close as they can, whatever the stride says", miss_stride),
    TRACE("table.callable_stride", "callable records lie as close as they can, whatever the stride says",
          callable_stride),
    TRACE("table.null", "a hit record of zeros runs the shaders of the record before", null_records_run),
    HANDLES("groups.procedural", "the handle of the procedural hit group is that of the triangles'", handle_of_last),
    GROUP("groups.closest_hit", "procedural hit groups lose their closest-hit shader", closest_hit_of_boxes_lost),
    GROUP("groups.any_hit_procedural", "procedural hit groups lose their any-hit shader", any_hit_of_boxes_lost),
    GROUP("groups.any_hit", "hit groups of triangles lose their any-hit shader", any_hit_of_triangles_lost),
    HANDLES("libraries.handles", "pipelines linked from libraries swap the handles of their hit groups",
            handles_of_linked_swapped),
    SHADER("any_hit.ignore", "ignoring an intersection accepts it",
           {{SpvOpIgnoreIntersectionKHR, 0, 0, GN_FAULT_SET_OPCODE, SpvOpReturn, 0}}),
    SHADER("any_hit.ignore_ends", "ignoring an intersection accepts it and ends the ray",
           {{SpvOpIgnoreIntersectionKHR, 0, 0, GN_FAULT_SET_OPCODE, SpvOpTerminateRayKHR, 0}}),
    SHADER("any_hit.terminate", "terminating a ray only accepts the intersection",
           {{SpvOpTerminateRayKHR, 0, 0, GN_FAULT_SET_OPCODE, SpvOpReturn, 0}}),
    SHADER("intersection.kind", "the hit kind that is reported is cut to 3 bits",
           {{SpvOpReportIntersectionKHR, 4, 0, GN_FAULT_AND, 7, 0}}),
    SHADER("intersection.range", "a hit that is reported outside of the ray's range is moved into it",
           {{SpvOpReportIntersectionKHR, 3, 0, GN_FAULT_CLAMP_TO_RANGE, 0, 0}}),
    SHADER("recursion.closest_hit", "closest-hit shaders cannot trace",
           {{SpvOpTraceRayKHR, 0, 0, GN_FAULT_REMOVE, 0, 1 + SpvExecutionModelClosestHitKHR}}),
    SHADER("recursion.miss", "miss shaders cannot trace",
           {{SpvOpTraceRayKHR, 0, 0, GN_FAULT_REMOVE, 0, 1 + SpvExecutionModelMissKHR}}),
    SHADER("recursion.flags", "a ray that a closest-hit shader traces has no flags",
           {{SpvOpTraceRayKHR, 2, 0, GN_FAULT_AND, 0, 1 + SpvExecutionModelClosestHitKHR}}),
    SHADER("recursion.payload", "a ray that a hit or miss shader traces gets the payload of the one before",
           {{SpvOpTraceRayKHR, 11, 0, GN_FAULT_TAKE_INCOMING_PAYLOAD, 0, 0}}),
    SHADER("ray_flags.skip_closest_hit", "SKIP_CLOSEST_HIT_SHADER is ignored", ON_TRACES(2, GN_FAULT_AND, ~0x8u)),
    SHADER("built_ins.hit_kind", "the hit kinds of front and back facing triangles are swapped",
           {{SpvOpLoad, 0, SpvBuiltInHitKindKHR, GN_FAULT_XOR, 1, 0}}),
    SHADER("built_ins.custom_index", "InstanceCustomIndex is InstanceId",
           {{SpvOpDecorate, 0, SpvBuiltInInstanceCustomIndexKHR, GN_FAULT_SET_BUILTIN, SpvBuiltInInstanceId, 0}}),
    SHADER("built_ins.matrices", "ObjectToWorld is WorldToObject",
           {{SpvOpDecorate, 0, SpvBuiltInObjectToWorldKHR, GN_FAULT_SET_BUILTIN, SpvBuiltInWorldToObjectKHR, 0}}),
    SHADER("built_ins.object_origin", "ObjectRayOrigin is WorldRayOrigin",
           {{SpvOpDecorate, 0, SpvBuiltInObjectRayOriginKHR, GN_FAULT_SET_BUILTIN, SpvBuiltInWorldRayOriginKHR, 0}}),
    TRACE("launch.layers", "launches are one layer deep", launch_layers_lost),
    TRACE("launch.indirect_swapped", "width and height of indirect traces are swapped", indirect_swapped),
    TRACE("launch.indirect_layers", "indirect traces are one layer deep", indirect_layers_lost),
    TRACE("launch.indirect_callable", "indirect traces call the record after the one asked for", indirect_callable_lost),

    {.name = "limits.hit_attribute", .text = "maxRayHitAttributeSize is below what is required", .pipeline_limits = limit_attribute},
    {.name = "limits.group_stride", .text = "maxShaderGroupStride is below what is required", .pipeline_limits = limit_stride},
};
const size_t gn_pipeline_fault_count = sizeof gn_pipeline_faults / sizeof gn_pipeline_faults[0];
