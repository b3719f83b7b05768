/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Ray tracing pipelines and their shader binding tables.
 *
 * There are few pipelines (a driver may compile each for long), and what differs between traces is data: records,
 * strides, offsets, the miss shader's number, the depth of recursion, how the trace is told its size.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cts/device_internal.h"
#include "cts/table.h"

#include "positions_rahit.spv.h"
#include "positions_rchit.spv.h"
#include "query_rchit.spv.h"
#include "query_rgen.spv.h"
#include "query_rmiss.spv.h"
#include "queryhit_rgen.spv.h"
#include "trace_rahit.spv.h"
#include "trace_rcall.spv.h"
#include "trace_rchit.spv.h"
#include "trace_rgen.spv.h"
#include "trace_rint.spv.h"
#include "trace_rmiss.spv.h"

/* What the ray generation shader expects in its record. */
#define RAYGEN_MAGIC 0x52474E31u
#define RECORD_DATA_BYTES sizeof(uint32_t)

#define MISS_RECORDS 16
#define CALLABLE_RECORDS 3

/* Payload and attributes in bytes, as the shaders declare them: libraries have to be told. */
#define PAYLOAD_BYTES 60
#define ATTRIBUTE_BYTES 8

/* A hit table up to this size is emptied before its first use; a larger one is mostly never touched. */
#define EMPTIED_BYTES ((VkDeviceSize)64 << 20)

enum kind { PLAIN, POSITIONS, RECURSIVE, CALLABLE, LINKED_HITS, LINKED_ALL, DEFERRED, QUERY_IN_RAYGEN, QUERY_IN_HIT, KIND_COUNT };

enum group { RAYGEN, MISS, TRIANGLES, BOXES, CALLED, GROUP_COUNT };

struct code {
    const uint32_t *words;
    size_t bytes;
};
#define CODE(name) {name##_spv, sizeof name##_spv}

/* No closest-hit shader: no group but ray generation. No callable shader: no such group. */
struct kind_traits {
    struct code raygen, miss, closest_hit, any_hit, intersection, callable;
    bool recursive;
};
static const struct kind_traits kinds[KIND_COUNT] = {
    [PLAIN] = {CODE(trace_rgen), CODE(trace_rmiss), CODE(trace_rchit), CODE(trace_rahit), CODE(trace_rint), {0}, false},
    [POSITIONS] = {CODE(trace_rgen), CODE(trace_rmiss), CODE(positions_rchit), CODE(positions_rahit), CODE(trace_rint),
                   {0}, false},
    [RECURSIVE] = {CODE(trace_rgen), CODE(trace_rmiss), CODE(trace_rchit), CODE(trace_rahit), CODE(trace_rint), {0},
                   true},
    [CALLABLE] = {CODE(trace_rgen), CODE(trace_rmiss), CODE(trace_rchit), CODE(trace_rahit), CODE(trace_rint),
                  CODE(trace_rcall), false},
    [LINKED_HITS] = {CODE(trace_rgen), CODE(trace_rmiss), CODE(trace_rchit), CODE(trace_rahit), CODE(trace_rint),
                     {0}, false},
    [LINKED_ALL] = {CODE(trace_rgen), CODE(trace_rmiss), CODE(trace_rchit), CODE(trace_rahit), CODE(trace_rint),
                    {0}, false},
    [DEFERRED] = {CODE(trace_rgen), CODE(trace_rmiss), CODE(trace_rchit), CODE(trace_rahit), CODE(trace_rint), {0},
                  false},
    [QUERY_IN_RAYGEN] = {CODE(query_rgen), {0}, {0}, {0}, {0}, {0}, false},
    [QUERY_IN_HIT] = {CODE(queryhit_rgen), CODE(query_rmiss), CODE(query_rchit), {0}, CODE(trace_rint), {0}, false},
};

struct pipeline {
    VkPipeline handle;
    VkPipeline libraries[2]; /* which have to stay, for layers that look them up */
    uint8_t *group_handles; /* GROUP_COUNT of them */
};

/* Memory of one purpose that grows. */
struct table {
    struct gn_pool pool;
    struct gn_memory memory;
};

struct gn_pipelines {
    struct pipeline list[KIND_COUNT];
    struct table fixed, hits, command;
    /* Of the trace that is prepared: */
    enum kind kind;
    VkStridedDeviceAddressRegionKHR raygen, miss, hit, callable;
    VkDeviceSize *written; /* offsets of the records of the hit table; malloc'ed */
    size_t written_count;
    VkDeviceSize record_bytes;
};

static VkDeviceSize align(VkDeviceSize value, VkDeviceSize alignment)
{
    return (value + alignment - 1) / alignment * alignment;
}

static enum kind kind_of(const struct gn_cts_route *route, enum gn_cts_program program)
{
    return route->entry == GN_CTS_QUERY_IN_RAYGEN ? QUERY_IN_RAYGEN
           : route->entry == GN_CTS_QUERY_IN_HIT  ? QUERY_IN_HIT
           : program == GN_CTS_POSITIONS          ? POSITIONS
           : route->depth > 1                     ? RECURSIVE
           : route->callable                      ? CALLABLE
           : route->linking == GN_CTS_LINK_HITS   ? LINKED_HITS
           : route->linking == GN_CTS_LINK_ALL    ? LINKED_ALL
           : route->deferred                      ? DEFERRED
                                                  : PLAIN;
}

/* Pipelines */

/* Shader stages and groups of one pipeline or library, in the making. */
struct parts {
    VkPipelineShaderStageCreateInfo stages[6];
    uint32_t stage_count;
    VkRayTracingShaderGroupCreateInfoKHR groups[GROUP_COUNT];
    uint32_t group_count;
};

static enum gn_device_status stage_add(struct gn_device *device, struct parts *parts, const struct code *code,
                                       VkShaderStageFlagBits stage, const VkSpecializationInfo *constants,
                                       uint32_t *out_index)
{
    *out_index = VK_SHADER_UNUSED_KHR;
    if (!code->words) {
        return GN_DEVICE_OK;
    }
    const VkShaderModuleCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO,
        .codeSize = code->bytes,
        .pCode = code->words,
    };
    VkShaderModule module = VK_NULL_HANDLE;
    const enum gn_device_status status = gn_device_check(
        device, vkCreateShaderModule(device->handle, &info, NULL, &module), "vkCreateShaderModule");
    if (status != GN_DEVICE_OK) {
        return status;
    }
    parts->stages[parts->stage_count] = (VkPipelineShaderStageCreateInfo){
        .sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
        .stage = stage,
        .module = module,
        .pName = "main",
        .pSpecializationInfo = constants,
    };
    *out_index = parts->stage_count++;
    return GN_DEVICE_OK;
}

static void group_add(struct parts *parts, VkRayTracingShaderGroupTypeKHR type, uint32_t general, uint32_t closest_hit,
                      uint32_t any_hit, uint32_t intersection)
{
    parts->groups[parts->group_count++] = (VkRayTracingShaderGroupCreateInfoKHR){
        .sType = VK_STRUCTURE_TYPE_RAY_TRACING_SHADER_GROUP_CREATE_INFO_KHR,
        .type = type,
        .generalShader = general,
        .closestHitShader = closest_hit,
        .anyHitShader = any_hit,
        .intersectionShader = intersection,
    };
}

static void parts_finish(struct gn_device *device, struct parts *parts)
{
    for (uint32_t i = 0; i < parts->stage_count; i++) {
        vkDestroyShaderModule(device->handle, parts->stages[i].module, NULL);
    }
}

/* The groups from `first` on, `count` of them, in the order of enum group. */
static enum gn_device_status parts_make(struct gn_device *device, const struct kind_traits *traits,
                                        const VkSpecializationInfo *constants, enum group first, uint32_t count,
                                        struct parts *parts)
{
    const uint32_t none = VK_SHADER_UNUSED_KHR;
    uint32_t index = none, closest_hit = none, any_hit = none;
    enum gn_device_status status = GN_DEVICE_OK;
    for (uint32_t group = first; group < first + count && status == GN_DEVICE_OK; group++) {
        switch (group) {
        case RAYGEN:
            status = stage_add(device, parts, &traits->raygen, VK_SHADER_STAGE_RAYGEN_BIT_KHR, constants, &index);
            group_add(parts, VK_RAY_TRACING_SHADER_GROUP_TYPE_GENERAL_KHR, index, none, none, none);
            break;
        case MISS:
            status = stage_add(device, parts, &traits->miss, VK_SHADER_STAGE_MISS_BIT_KHR, constants, &index);
            group_add(parts, VK_RAY_TRACING_SHADER_GROUP_TYPE_GENERAL_KHR, index, none, none, none);
            break;
        case TRIANGLES:
            status = stage_add(device, parts, &traits->closest_hit, VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR, constants,
                               &closest_hit);
            if (status == GN_DEVICE_OK) {
                status = stage_add(device, parts, &traits->any_hit, VK_SHADER_STAGE_ANY_HIT_BIT_KHR, constants, &any_hit);
            }
            group_add(parts, VK_RAY_TRACING_SHADER_GROUP_TYPE_TRIANGLES_HIT_GROUP_KHR, none, closest_hit, any_hit, none);
            break;
        case BOXES: /* shares the triangles' shaders */
            status = stage_add(device, parts, &traits->intersection, VK_SHADER_STAGE_INTERSECTION_BIT_KHR, constants,
                               &index);
            group_add(parts, VK_RAY_TRACING_SHADER_GROUP_TYPE_PROCEDURAL_HIT_GROUP_KHR, none, closest_hit, any_hit,
                      index);
            break;
        case CALLED:
            status = stage_add(device, parts, &traits->callable, VK_SHADER_STAGE_CALLABLE_BIT_KHR, constants, &index);
            group_add(parts, VK_RAY_TRACING_SHADER_GROUP_TYPE_GENERAL_KHR, index, none, none, none);
            break;
        default:
            break;
        }
    }
    return status;
}

static uint32_t group_count_of(const struct kind_traits *traits)
{
    return traits->callable.words ? GROUP_COUNT : traits->closest_hit.words ? CALLED : MISS;
}

static enum gn_device_status pipeline_make(struct gn_device *device, const struct parts *parts,
                                           VkPipelineCreateFlags flags, uint32_t depth,
                                           const VkPipelineLibraryCreateInfoKHR *libraries, bool linked,
                                           bool deferred, VkPipeline *out)
{
    const VkRayTracingPipelineInterfaceCreateInfoKHR interface = {
        .sType = VK_STRUCTURE_TYPE_RAY_TRACING_PIPELINE_INTERFACE_CREATE_INFO_KHR,
        .maxPipelineRayPayloadSize = PAYLOAD_BYTES,
        .maxPipelineRayHitAttributeSize = ATTRIBUTE_BYTES,
    };
    const VkRayTracingPipelineCreateInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_RAY_TRACING_PIPELINE_CREATE_INFO_KHR,
        .flags = flags,
        .stageCount = parts ? parts->stage_count : 0,
        .pStages = parts ? parts->stages : NULL,
        .groupCount = parts ? parts->group_count : 0,
        .pGroups = parts ? parts->groups : NULL,
        .maxPipelineRayRecursionDepth = depth,
        .pLibraryInfo = libraries,
        .pLibraryInterface = linked ? &interface : NULL,
        .layout = device->pipeline_layout,
    };
    if (deferred) {
        return gn_host_pipeline(device, &info, out);
    }
    return gn_device_check(device,
                           device->CreateRayTracingPipelinesKHR(device->handle, VK_NULL_HANDLE, VK_NULL_HANDLE, 1,
                                                                &info, NULL, out),
                           "vkCreateRayTracingPipelinesKHR");
}

/* A pipeline of two halves: the ray generation and miss shaders in a library or in itself, and a library of hit
 * groups. */
static enum gn_device_status linked_make(struct gn_device *device, const struct kind_traits *traits,
                                         const VkSpecializationInfo *constants, bool all, struct pipeline *out)
{
    const VkPipelineCreateFlags library = VK_PIPELINE_CREATE_LIBRARY_BIT_KHR;
    struct parts front = {0}, hits = {0};
    enum gn_device_status status = parts_make(device, traits, constants, RAYGEN, 2, &front);
    if (status == GN_DEVICE_OK) {
        status = parts_make(device, traits, constants, TRIANGLES, 2, &hits);
    }
    if (status == GN_DEVICE_OK && all) {
        status = pipeline_make(device, &front, library, 1, NULL, true, false, &out->libraries[0]);
    }
    if (status == GN_DEVICE_OK) {
        status = pipeline_make(device, &hits, library, 1, NULL, true, false, &out->libraries[1]);
    }
    if (status == GN_DEVICE_OK) {
        const VkPipelineLibraryCreateInfoKHR info = {
            .sType = VK_STRUCTURE_TYPE_PIPELINE_LIBRARY_CREATE_INFO_KHR,
            .libraryCount = all ? 2 : 1,
            .pLibraries = all ? out->libraries : out->libraries + 1,
        };
        status = pipeline_make(device, all ? NULL : &front, 0, 1, &info, true, false, &out->handle);
    }
    parts_finish(device, &front);
    parts_finish(device, &hits);
    return status;
}

static enum gn_device_status pipeline_create(struct gn_device *device, enum kind kind)
{
    struct pipeline *pipeline = &device->pipelines->list[kind];
    const struct kind_traits *traits = &kinds[kind];
    const VkPhysicalDeviceRayTracingPipelinePropertiesKHR *limits = &device->info.pipeline_limits;
    if (pipeline->group_handles) {
        return GN_DEVICE_OK;
    }
    const VkBool32 values[2] = {traits->recursive, traits->callable.words != NULL};
    const VkSpecializationMapEntry entries[2] = {
        {0, 0, sizeof values[0]},
        {1, sizeof values[0], sizeof values[1]},
    };
    const VkSpecializationInfo constants = {2, entries, sizeof values, values};
    const uint32_t group_count = group_count_of(traits);
    enum gn_device_status status = GN_DEVICE_OK;
    if (kind == LINKED_HITS || kind == LINKED_ALL) {
        status = linked_make(device, traits, &constants, kind == LINKED_ALL, pipeline);
    } else {
        struct parts parts = {0};
        status = parts_make(device, traits, &constants, RAYGEN, group_count, &parts);
        if (status == GN_DEVICE_OK) {
            const uint32_t depth = traits->recursive ? limits->maxRayRecursionDepth : 1;
            status = pipeline_make(device, &parts, 0, depth, NULL, false, kind == DEFERRED, &pipeline->handle);
        }
        parts_finish(device, &parts);
    }
    if (status != GN_DEVICE_OK) {
        return status;
    }
    uint8_t *handles = calloc(GROUP_COUNT + 1, limits->shaderGroupHandleSize);
    if (!handles) {
        return gn_device_fail(device, GN_DEVICE_FAILED, "no host memory for shader group handles");
    }
    pipeline->group_handles = handles;
    const size_t size = limits->shaderGroupHandleSize;
    status = gn_device_check(device,
                             device->GetRayTracingShaderGroupHandlesKHR(device->handle, pipeline->handle, 0, group_count,
                                                                        group_count * size, handles),
                             "vkGetRayTracingShaderGroupHandlesKHR");
    /* One by one they have to be the same. */
    for (uint32_t g = 0; g < group_count && status == GN_DEVICE_OK; g++) {
        uint8_t *one = handles + GROUP_COUNT * size;
        status = gn_device_check(
            device, device->GetRayTracingShaderGroupHandlesKHR(device->handle, pipeline->handle, g, 1, size, one),
            "vkGetRayTracingShaderGroupHandlesKHR");
        if (status == GN_DEVICE_OK && memcmp(one, handles + g * size, size) != 0) {
            status = gn_device_fail(device, GN_DEVICE_FAILED,
                                    "the handle of shader group %u alone is another than among all %u", g, group_count);
        }
    }
    return status;
}

/* Tables */

static enum gn_device_status table_reserve(struct gn_device *device, struct table *table, VkDeviceSize size)
{
    if (size <= table->memory.size) {
        return GN_DEVICE_OK;
    }
    gn_pool_finish(device, &table->pool);
    memset(&table->memory, 0, sizeof table->memory);
    const enum gn_device_status status = gn_pool_take(
        device, &table->pool, size, device->info.pipeline_limits.shaderGroupBaseAlignment, &table->memory);
    if (status == GN_DEVICE_OK && table->memory.size <= EMPTIED_BYTES) {
        memset(table->memory.mapped, 0, table->memory.size);
    }
    return status;
}

static void record_write(const struct gn_device *device, uint8_t *out, enum group group, uint32_t data)
{
    const size_t handle_size = device->info.pipeline_limits.shaderGroupHandleSize;
    const struct pipeline *pipeline = &device->pipelines->list[device->pipelines->kind];
    memcpy(out, pipeline->group_handles + group * handle_size, handle_size);
    memcpy(out + handle_size, &data, sizeof data);
}

/* A record for every geometry of every instance; all others stay zeros, so that a wrong one shows. */
static enum gn_device_status hits_write(struct gn_built_scene *built, const struct gn_cts_route *route,
                                        VkDeviceSize stride)
{
    struct gn_device *device = built->device;
    struct gn_pipelines *pipelines = device->pipelines;
    const struct gn_cts_scene *scene = built->scene;
    const uint64_t record_count = gn_table_record_count(scene, route);
    const enum gn_device_status status = table_reserve(device, &pipelines->hits, record_count * stride);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    size_t entries = 0;
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const uint32_t blas = scene->instances[i].blas;
        entries += blas == GN_CTS_NO_BLAS ? 0 : scene->blases[blas].geometry_count;
    }
    pipelines->written = calloc(entries + 1, sizeof *pipelines->written);
    if (!pipelines->written) {
        return gn_device_fail(device, GN_DEVICE_FAILED, "no host memory for %zu records", entries);
    }
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct gn_cts_instance *instance = &scene->instances[i];
        if (instance->blas == GN_CTS_NO_BLAS) {
            continue;
        }
        const struct gn_cts_blas *blas = &scene->blases[instance->blas];
        for (uint32_t g = 0; g < blas->geometry_count; g++) {
            const uint64_t index = gn_table_record(route, instance, g);
            if (route->null_every && index % route->null_every == 0) {
                continue;
            }
            const VkDeviceSize offset = index * stride;
            const bool triangles = blas->geometries[g].type == GN_REF_TRIANGLES;
            record_write(device, pipelines->hits.memory.mapped + offset, triangles ? TRIANGLES : BOXES,
                         (uint32_t)index);
            pipelines->written[pipelines->written_count++] = offset;
        }
    }
    pipelines->hit = (VkStridedDeviceAddressRegionKHR){pipelines->hits.memory.address, stride, record_count * stride};
    return GN_DEVICE_OK;
}

/* The stride of another table than the hit table: `more` alignments apart from it, so that none goes for another. */
static VkDeviceSize stride_of(const VkPhysicalDeviceRayTracingPipelinePropertiesKHR *limits, VkDeviceSize hit_stride,
                              uint32_t more)
{
    const VkDeviceSize apart = more * (VkDeviceSize)limits->shaderGroupHandleAlignment;
    return hit_stride + apart <= limits->maxShaderGroupStride ? hit_stride + apart : hit_stride - apart;
}

static enum gn_device_status tables_write(struct gn_built_scene *built, const struct gn_cts_route *route)
{
    struct gn_device *device = built->device;
    struct gn_pipelines *pipelines = device->pipelines;
    const VkPhysicalDeviceRayTracingPipelinePropertiesKHR *limits = &device->info.pipeline_limits;
    const VkDeviceSize alignment = limits->shaderGroupHandleAlignment, base = limits->shaderGroupBaseAlignment;
    const VkDeviceSize stride = align(limits->shaderGroupHandleSize + RECORD_DATA_BYTES, alignment) +
                                route->record_padding * alignment;
    const uint32_t groups = group_count_of(&kinds[pipelines->kind]);
    if (stride > limits->maxShaderGroupStride) {
        return gn_device_fail(device, GN_DEVICE_UNSUPPORTED, "records of %llu bytes are larger than the device takes (%u)",
                              (unsigned long long)stride, limits->maxShaderGroupStride);
    }
    pipelines->record_bytes = limits->shaderGroupHandleSize + RECORD_DATA_BYTES;
    const VkDeviceSize miss_stride = stride_of(limits, stride, 1), callable_stride = stride_of(limits, stride, 2);
    const VkDeviceSize miss_offset = align(stride, base);
    const VkDeviceSize callable_offset = miss_offset + align(MISS_RECORDS * miss_stride, base);
    enum gn_device_status status =
        table_reserve(device, &pipelines->fixed, callable_offset + CALLABLE_RECORDS * callable_stride);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    uint8_t *fixed = pipelines->fixed.memory.mapped;
    const VkDeviceAddress address = pipelines->fixed.memory.address;
    memset(fixed, 0, pipelines->fixed.memory.size);
    record_write(device, fixed, RAYGEN, RAYGEN_MAGIC);
    pipelines->raygen = (VkStridedDeviceAddressRegionKHR){address, stride, stride};
    pipelines->miss = pipelines->callable = pipelines->hit = (VkStridedDeviceAddressRegionKHR){0};
    if (groups > MISS) {
        for (uint32_t i = 0; i < MISS_RECORDS; i++) {
            record_write(device, fixed + miss_offset + i * miss_stride, MISS, i);
        }
        pipelines->miss = (VkStridedDeviceAddressRegionKHR){address + miss_offset, miss_stride, MISS_RECORDS * miss_stride};
        status = hits_write(built, route, stride);
    }
    if (groups > CALLED) {
        for (uint32_t i = 0; i < CALLABLE_RECORDS; i++) {
            record_write(device, fixed + callable_offset + i * callable_stride, CALLED, i);
        }
        pipelines->callable =
            (VkStridedDeviceAddressRegionKHR){address + callable_offset, callable_stride,
                                                                CALLABLE_RECORDS * callable_stride};
    }
    return status;
}

enum gn_device_status gn_pipeline_prepare(struct gn_built_scene *built, const struct gn_cts_route *route,
                                          enum gn_cts_program program)
{
    struct gn_device *device = built->device;
    const struct gn_device_info *info = &device->info;
    if (!info->ray_tracing_pipeline) {
        return gn_device_fail(device, GN_DEVICE_UNSUPPORTED,
                              "the device has no ray tracing pipelines (VK_KHR_ray_tracing_pipeline)");
    }
    if (!info->primitive_culling) {
        return gn_device_fail(device, GN_DEVICE_UNSUPPORTED, "the device lacks rayTraversalPrimitiveCulling");
    }
    const bool can_launch = route->launch == GN_CTS_LAUNCH_DIRECT ||
                            (route->launch == GN_CTS_LAUNCH_INDIRECT && info->trace_indirect) ||
                            (route->launch == GN_CTS_LAUNCH_INDIRECT2 && info->trace_indirect2 &&
                             device->CmdTraceRaysIndirect2KHR);
    if (!can_launch) {
        return gn_device_fail(device, GN_DEVICE_UNSUPPORTED, "the device lacks rayTracingPipelineTraceRaysIndirect%s",
                              route->launch == GN_CTS_LAUNCH_INDIRECT2 ? "2" : "");
    }
    if (route->linking != GN_CTS_LINK_NOTHING && !info->pipeline_library) {
        return gn_device_fail(device, GN_DEVICE_UNSUPPORTED, "the device has no VK_KHR_pipeline_library");
    }
    if (route->depth > info->pipeline_limits.maxRayRecursionDepth) {
        return gn_device_fail(device, GN_DEVICE_UNSUPPORTED, "recursion to depth %u: the device has %u", route->depth,
                              info->pipeline_limits.maxRayRecursionDepth);
    }
    if (route->miss_index >= MISS_RECORDS) {
        return gn_device_fail(device, GN_DEVICE_FAILED, "the case is not valid: there are %u miss records",
                              MISS_RECORDS);
    }
    if (!device->pipelines) {
        device->pipelines = calloc(1, sizeof *device->pipelines);
        if (!device->pipelines) {
            return gn_device_fail(device, GN_DEVICE_FAILED, "no host memory for pipelines");
        }
        device->pipelines->fixed.pool.kind = GN_MEMORY_TABLE;
        device->pipelines->hits.pool.kind = GN_MEMORY_TABLE;
        device->pipelines->command.pool.kind = GN_MEMORY_TABLE;
    }
    device->pipelines->kind = kind_of(route, program);
    const enum gn_device_status status = pipeline_create(device, device->pipelines->kind);
    return status == GN_DEVICE_OK ? tables_write(built, route) : status;
}

void gn_pipeline_unprepare(struct gn_device *device)
{
    struct gn_pipelines *pipelines = device->pipelines;
    if (!pipelines || !pipelines->written) {
        return;
    }
    for (size_t i = 0; i < pipelines->written_count; i++) {
        memset(pipelines->hits.memory.mapped + pipelines->written[i], 0, pipelines->record_bytes);
    }
    free(pipelines->written);
    pipelines->written = NULL;
    pipelines->written_count = 0;
}

/* Traces */

/* What an indirect trace reads from memory. */
static enum gn_device_status command_write(struct gn_device *device, const struct gn_trace_constants *constants,
                                           uint32_t layers)
{
    struct gn_pipelines *pipelines = device->pipelines;
    const VkTraceRaysIndirectCommand2KHR command = {
        .raygenShaderRecordAddress = pipelines->raygen.deviceAddress,
        .raygenShaderRecordSize = pipelines->raygen.size,
        .missShaderBindingTableAddress = pipelines->miss.deviceAddress,
        .missShaderBindingTableSize = pipelines->miss.size,
        .missShaderBindingTableStride = pipelines->miss.stride,
        .hitShaderBindingTableAddress = pipelines->hit.deviceAddress,
        .hitShaderBindingTableSize = pipelines->hit.size,
        .hitShaderBindingTableStride = pipelines->hit.stride,
        .callableShaderBindingTableAddress = pipelines->callable.deviceAddress,
        .callableShaderBindingTableSize = pipelines->callable.size,
        .callableShaderBindingTableStride = pipelines->callable.stride,
        .width = constants->width,
        .height = constants->height,
        .depth = layers,
    };
    const enum gn_device_status status = table_reserve(device, &pipelines->command, sizeof command);
    if (status == GN_DEVICE_OK) {
        memcpy(pipelines->command.memory.mapped, &command, sizeof command);
    }
    return status;
}

enum gn_device_status gn_pipeline_chunk(struct gn_device *device, const struct gn_cts_route *route,
                                        const struct gn_trace_constants *constants)
{
    struct gn_pipelines *pipelines = device->pipelines;
    struct gn_trace_constants own = *constants;
    /* All three numbers of an invocation count. */
    const uint32_t layers = own.ray_count >= 64 ? 2 : 1;
    own.width = (uint32_t)ceil(sqrt((double)own.ray_count / layers));
    own.height = (own.ray_count + own.width * layers - 1) / (own.width * layers);
    enum gn_device_status status = command_write(device, &own, layers);
    if (status != GN_DEVICE_OK || (status = gn_device_begin(device)) != GN_DEVICE_OK) {
        return status;
    }
    gn_trace_bind(device, VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR, pipelines->list[pipelines->kind].handle, &own);
    const VkDeviceAddress command = pipelines->command.memory.address;
    switch (route->launch) {
    case GN_CTS_LAUNCH_DIRECT:
        device->CmdTraceRaysKHR(device->commands, &pipelines->raygen, &pipelines->miss, &pipelines->hit,
                                &pipelines->callable, own.width, own.height, layers);
        break;
    case GN_CTS_LAUNCH_INDIRECT:
        device->CmdTraceRaysIndirectKHR(device->commands, &pipelines->raygen, &pipelines->miss, &pipelines->hit,
                                        &pipelines->callable,
                                        command + offsetof(VkTraceRaysIndirectCommand2KHR, width));
        break;
    case GN_CTS_LAUNCH_INDIRECT2:
        device->CmdTraceRaysIndirect2KHR(device->commands, command);
        break;
    }
    return gn_device_submit(device);
}

void gn_pipelines_finish(struct gn_device *device)
{
    struct gn_pipelines *pipelines = device->pipelines;
    if (!pipelines) {
        return;
    }
    gn_pipeline_unprepare(device);
    for (size_t i = 0; i < KIND_COUNT; i++) {
        vkDestroyPipeline(device->handle, pipelines->list[i].handle, NULL);
        vkDestroyPipeline(device->handle, pipelines->list[i].libraries[0], NULL);
        vkDestroyPipeline(device->handle, pipelines->list[i].libraries[1], NULL);
        free(pipelines->list[i].group_handles);
    }
    gn_pool_finish(device, &pipelines->fixed.pool);
    gn_pool_finish(device, &pipelines->hits.pool);
    gn_pool_finish(device, &pipelines->command.pool);
    free(pipelines);
    device->pipelines = NULL;
}
