/* SPDX-License-Identifier: Apache-2.0 */
/* Traces rays through a built scene, one chunk after another, by the route that is asked for. */
#include <stddef.h>
#include <string.h>

#include "cts/device_internal.h"

#include "address_comp.spv.h"
#include "candidates_comp.spv.h"
#include "committed_comp.spv.h"
#include "detail_comp.spv.h"
#include "pair_comp.spv.h"
#include "positions_comp.spv.h"

#define GROUP_SIZE 64

/* struct Ray in cts/shaders/answer.glsl. */
struct gpu_ray {
    float origin[3];
    float tmin;
    float direction[3];
    float tmax;
    uint32_t flags, cull_mask, confirm_mask, generate_mask;
    float generate_t0, generate_step;
    uint32_t unused[2];
};
_Static_assert(sizeof(struct gpu_ray) == 64, "the shaders' stride");

/* The answers are copied out of the device's buffers as they are. */
_Static_assert(sizeof(struct gn_ref_answer) == 40, "the shaders' stride");
_Static_assert(offsetof(struct gn_ref_answer, sbt_offset) == 20, "the shaders' order");
_Static_assert(offsetof(struct gn_ref_answer, barycentrics) == 32, "the shaders' order");
_Static_assert(sizeof(struct gn_cts_candidates) == 4 + 40 * GN_CTS_MAX_CANDIDATES, "the shaders' stride");
_Static_assert(GN_CTS_MAX_CANDIDATES == 64, "cts/shaders/answer.glsl has the number, too");
_Static_assert(sizeof(struct gn_cts_detail) == 152, "the shaders' stride");
_Static_assert(GN_CTS_COMMITTED == 0 && GN_CTS_CANDIDATES == 1 && GN_CTS_DETAIL == 2 && GN_CTS_POSITIONS == 3,
               "cts/shaders/pipeline.glsl has the numbers, too");

struct program_traits {
    const uint32_t *code; /* of the compute shader */
    size_t code_bytes;
    uint32_t chunk; /* rays per dispatch */
    size_t extra_bytes; /* per ray, beside the committed hit */
};

static const struct program_traits programs[GN_KERNEL_COUNT] = {
    [GN_CTS_COMMITTED] = {committed_comp_spv, sizeof committed_comp_spv, 1u << 18, 0},
    [GN_CTS_CANDIDATES] = {candidates_comp_spv, sizeof candidates_comp_spv, 1u << 14, sizeof(struct gn_cts_candidates)},
    [GN_CTS_DETAIL] = {detail_comp_spv, sizeof detail_comp_spv, 1u << 16, sizeof(struct gn_cts_detail)},
    [GN_CTS_POSITIONS] = {positions_comp_spv, sizeof positions_comp_spv, 1u << 18, sizeof(float[9])},
    [GN_KERNEL_PAIR] = {pair_comp_spv, sizeof pair_comp_spv, 1u << 18, 0},
    [GN_KERNEL_BY_ADDRESS] = {address_comp_spv, sizeof address_comp_spv, 1u << 18, 0},
};

const char *gn_answer_fault(uint32_t kind)
{
    static const char *const texts[] = {
        [3] = "the ray query was not done after 1048576 candidates",
        [4] = "no closest-hit or miss shader has answered",
        [5] = "with SkipClosestHitShader the ray hits where it misses without, or a closest-hit shader was run",
        [6] = "the closest-hit shader got other hit attributes than the intersection shader left with this hit",
        [7] = "the closest-hit shader got another hit kind than the intersection shader reported",
        [8] = "another miss record was run than the one asked for",
        [9] = "the ray generation shader found other data in its record than what is there",
        [10] = "a payload changed that no shader wrote to, or a level of recursion did not return",
        [11] = "the size of the launch reads back differently",
        [12] = "a candidate was presented after the ray had been ended: by TerminateOnFirstHit and a committed hit, or by an "
               "any-hit shader",
        [13] = "a ray query went on after it had been terminated",
        [14] = "tmax reads back differently in the miss shader",
        [15] = "the payload does not hold what the any-hit shaders have counted",
    };
    if (kind <= GN_REF_ANSWER_GENERATED) {
        return NULL;
    }
    return kind < sizeof texts / sizeof texts[0] ? texts[kind]
           : kind == UINT32_MAX                  ? "no shader has written one"
                                                 : "what is written is none";
}

/* Every stage that asks for hits on this device. */
static VkShaderStageFlags stages(const struct gn_device *device)
{
    const struct gn_device_info *info = &device->info;
    VkShaderStageFlags flags = VK_SHADER_STAGE_COMPUTE_BIT;
    if (info->ray_tracing_pipeline) {
        flags |= VK_SHADER_STAGE_RAYGEN_BIT_KHR | VK_SHADER_STAGE_MISS_BIT_KHR | VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR |
                 VK_SHADER_STAGE_ANY_HIT_BIT_KHR | VK_SHADER_STAGE_INTERSECTION_BIT_KHR |
                 VK_SHADER_STAGE_CALLABLE_BIT_KHR;
    }
    if (info->ray_query && info->graphics) {
        flags |= VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT;
    }
    return flags;
}

/* The layouts that all shaders of traces share. */
static enum gn_device_status layouts_create(struct gn_device *device)
{
    if (device->pipeline_layout) {
        return GN_DEVICE_OK;
    }
    VkDescriptorSetLayoutBinding bindings[4];
    for (uint32_t i = 0; i < 4; i++) {
        bindings[i] = (VkDescriptorSetLayoutBinding){
            .binding = i,
            .descriptorType =
                i == 0 ? VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR : VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
            .descriptorCount = 1,
            .stageFlags = stages(device),
        };
    }
    const VkDescriptorSetLayoutCreateInfo set_info = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO,
        .bindingCount = 4,
        .pBindings = bindings,
    };
    enum gn_device_status status =
        gn_device_check(device, vkCreateDescriptorSetLayout(device->handle, &set_info, NULL, &device->set_layout),
                        "vkCreateDescriptorSetLayout");
    if (status != GN_DEVICE_OK) {
        return status;
    }
    const VkDescriptorPoolSize sizes[] = {
        {VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, 1},
        {VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 3},
    };
    const VkDescriptorPoolCreateInfo pool_info = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO,
        .maxSets = 1,
        .poolSizeCount = 2,
        .pPoolSizes = sizes,
    };
    status = gn_device_check(device, vkCreateDescriptorPool(device->handle, &pool_info, NULL, &device->descriptor_pool),
                             "vkCreateDescriptorPool");
    if (status != GN_DEVICE_OK) {
        return status;
    }
    const VkDescriptorSetAllocateInfo allocate_info = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
        .descriptorPool = device->descriptor_pool,
        .descriptorSetCount = 1,
        .pSetLayouts = &device->set_layout,
    };
    status = gn_device_check(device, vkAllocateDescriptorSets(device->handle, &allocate_info, &device->descriptors),
                             "vkAllocateDescriptorSets");
    if (status != GN_DEVICE_OK) {
        return status;
    }
    const VkPushConstantRange range = {stages(device), 0, sizeof(struct gn_trace_constants)};
    const VkPipelineLayoutCreateInfo layout_info = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
        .setLayoutCount = 1,
        .pSetLayouts = &device->set_layout,
        .pushConstantRangeCount = 1,
        .pPushConstantRanges = &range,
    };
    return gn_device_check(device, vkCreatePipelineLayout(device->handle, &layout_info, NULL, &device->pipeline_layout),
                           "vkCreatePipelineLayout");
}

/* Which compute shader this is; GN_KERNEL_COUNT: none. */
static uint32_t kernel_of(const struct gn_cts_route *route, enum gn_cts_program program)
{
    switch (route->entry) {
    case GN_CTS_QUERY: return program;
    case GN_CTS_QUERY_IN_PAIRS: return GN_KERNEL_PAIR;
    case GN_CTS_QUERY_BY_ADDRESS: return GN_KERNEL_BY_ADDRESS;
    default: return GN_KERNEL_COUNT;
    }
}

static enum gn_device_status program_create(struct gn_device *device, uint32_t number)
{
    struct gn_program *program = &device->programs[number];
    if (program->pipeline) {
        return GN_DEVICE_OK;
    }
    enum gn_device_status status = layouts_create(device);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    const VkShaderModuleCreateInfo module_info = {
        .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO,
        .codeSize = programs[number].code_bytes,
        .pCode = programs[number].code,
    };
    status = gn_device_check(device, vkCreateShaderModule(device->handle, &module_info, NULL, &program->module),
                             "vkCreateShaderModule");
    if (status != GN_DEVICE_OK) {
        return status;
    }
    const VkComputePipelineCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
        .stage = {
            .sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
            .stage = VK_SHADER_STAGE_COMPUTE_BIT,
            .module = program->module,
            .pName = "main",
        },
        .layout = device->pipeline_layout,
    };
    return gn_device_check(
        device, vkCreateComputePipelines(device->handle, VK_NULL_HANDLE, 1, &info, NULL, &program->pipeline),
        "vkCreateComputePipelines");
}

/* The buffers have at least these sizes afterwards; where one is too small, all are made anew. */
static enum gn_device_status buffers_reserve(struct gn_device *device, VkDeviceSize rays, VkDeviceSize committed,
                                             VkDeviceSize extra)
{
    struct gn_trace_buffers *buffers = &device->trace;
    if (rays <= buffers->rays.size && committed <= buffers->committed.size && extra <= buffers->extra.size) {
        return GN_DEVICE_OK;
    }
    struct gn_memory *const pieces[] = {&buffers->rays, &buffers->committed, &buffers->extra};
    const VkDeviceSize wanted[] = {rays, committed, extra};
    VkDeviceSize sizes[3];
    for (size_t i = 0; i < 3; i++) {
        sizes[i] = wanted[i] > pieces[i]->size ? wanted[i] : pieces[i]->size;
        *pieces[i] = (struct gn_memory){0};
    }
    gn_pool_finish(device, &buffers->pool);
    for (size_t i = 0; i < 3; i++) {
        /* 256 is the most that minStorageBufferOffsetAlignment may be. */
        const enum gn_device_status status = gn_pool_take(device, &buffers->pool, sizes[i], 256, pieces[i]);
        if (status != GN_DEVICE_OK) {
            return status;
        }
    }
    return GN_DEVICE_OK;
}

static void descriptors_write(const struct gn_built_scene *built)
{
    struct gn_device *device = built->device;
    const struct gn_memory *const pieces[] = {&device->trace.rays, &device->trace.committed, &device->trace.extra};
    const VkWriteDescriptorSetAccelerationStructureKHR structures = {
        .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET_ACCELERATION_STRUCTURE_KHR,
        .accelerationStructureCount = 1,
        .pAccelerationStructures = &built->tlas.handle,
    };
    VkWriteDescriptorSet writes[4] = {{
        .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
        .pNext = &structures,
        .dstSet = device->descriptors,
        .descriptorCount = 1,
        .descriptorType = VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR,
    }};
    VkDescriptorBufferInfo infos[3];
    for (uint32_t i = 0; i < 3; i++) {
        infos[i] = (VkDescriptorBufferInfo){pieces[i]->buffer, pieces[i]->offset, pieces[i]->size};
        writes[i + 1] = (VkWriteDescriptorSet){
            .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
            .dstSet = device->descriptors,
            .dstBinding = i + 1,
            .descriptorCount = 1,
            .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
            .pBufferInfo = &infos[i],
        };
    }
    vkUpdateDescriptorSets(device->handle, 4, writes, 0, NULL);
}

static void rays_write(uint8_t *out, const struct gn_cts_ray *rays, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        const struct gn_ref_ray *ray = &rays[i].ray;
        const struct gn_ref_policy *policy = &rays[i].policy;
        const struct gpu_ray gpu = {
            .origin = {ray->origin[0], ray->origin[1], ray->origin[2]},
            .tmin = ray->tmin,
            .direction = {ray->direction[0], ray->direction[1], ray->direction[2]},
            .tmax = ray->tmax,
            .flags = ray->flags,
            .cull_mask = ray->cull_mask,
            .confirm_mask = policy->confirm_mask,
            .generate_mask = policy->generate_mask,
            .generate_t0 = policy->generate_t0,
            .generate_step = policy->generate_step,
        };
        memcpy(out + (size_t)i * sizeof gpu, &gpu, sizeof gpu);
    }
}

void gn_trace_bind(struct gn_device *device, VkPipelineBindPoint point, VkPipeline pipeline,
                   const struct gn_trace_constants *constants)
{
    vkCmdBindPipeline(device->commands, point, pipeline);
    vkCmdBindDescriptorSets(device->commands, point, device->pipeline_layout, 0, 1, &device->descriptors, 0, NULL);
    vkCmdPushConstants(device->commands, device->pipeline_layout, stages(device), 0, sizeof *constants, constants);
}

static enum gn_device_status compute_chunk(struct gn_device *device, uint32_t kernel,
                                           const struct gn_trace_constants *constants)
{
    enum gn_device_status status = gn_device_begin(device);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    gn_trace_bind(device, VK_PIPELINE_BIND_POINT_COMPUTE, device->programs[kernel].pipeline, constants);
    vkCmdDispatch(device->commands, (constants->ray_count + GROUP_SIZE - 1) / GROUP_SIZE, 1, 1);
    return gn_device_submit(device);
}

/* Whether the device can go this way, and what is needed for it made ready. */
static enum gn_device_status route_prepare(struct gn_built_scene *built, const struct gn_cts_route *route,
                                           enum gn_cts_program program)
{
    struct gn_device *device = built->device;
    const struct gn_device_info *info = &device->info;
    const bool query = route->entry != GN_CTS_PIPELINE;
    if (query && !info->ray_query) {
        return gn_device_fail(device, GN_DEVICE_UNSUPPORTED, "the device has no ray queries (VK_KHR_ray_query)");
    }
    if (query && route->entry != GN_CTS_QUERY && program != GN_CTS_COMMITTED) {
        return gn_device_fail(device, GN_DEVICE_FAILED, "the case is not valid: that stage has one program only");
    }
    const enum gn_device_status status = layouts_create(device);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    switch (route->entry) {
    case GN_CTS_QUERY:
    case GN_CTS_QUERY_IN_PAIRS:
    case GN_CTS_QUERY_BY_ADDRESS:
        return program_create(device, kernel_of(route, program));
    case GN_CTS_QUERY_IN_VERTEX:
    case GN_CTS_QUERY_IN_FRAGMENT:
        return gn_drawing_prepare(device, route->entry);
    default:
        return gn_pipeline_prepare(built, route, program);
    }
}

static enum gn_device_status chunk_trace(struct gn_device *device, const struct gn_cts_route *route,
                                         const struct gn_trace_constants *constants)
{
    switch (route->entry) {
    case GN_CTS_QUERY:
    case GN_CTS_QUERY_IN_PAIRS:
    case GN_CTS_QUERY_BY_ADDRESS:
        return compute_chunk(device, kernel_of(route, (enum gn_cts_program)constants->program), constants);
    case GN_CTS_QUERY_IN_VERTEX:
    case GN_CTS_QUERY_IN_FRAGMENT:
        return gn_drawing_chunk(device, route->entry, constants);
    default:
        return gn_pipeline_chunk(device, route, constants);
    }
}

enum gn_device_status gn_scene_trace(struct gn_built_scene *built, const struct gn_cts_route *route,
                                     enum gn_cts_program program, const struct gn_cts_ray *rays,
                                     uint32_t ray_count, struct gn_arena *arena, struct gn_cts_answers *out_answers)
{
    struct gn_device *device = built->device;
    const struct program_traits *traits = &programs[program];
    memset(out_answers, 0, sizeof *out_answers);
    if (program == GN_CTS_POSITIONS) {
        if (!device->info.position_fetch) {
            return gn_device_fail(device, GN_DEVICE_UNSUPPORTED, "the device has no VK_KHR_ray_tracing_position_fetch");
        }
        for (uint32_t i = 0; i < built->blas_count; i++) {
            if (!(built->blases[i].flags & VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_DATA_ACCESS_KHR)) {
                return gn_device_fail(device, GN_DEVICE_FAILED,
                                      "the scene is not valid: BLAS %u lacks ALLOW_DATA_ACCESS", i);
            }
        }
    }
    out_answers->committed = GN_NEW(arena, struct gn_ref_answer, ray_count);
    uint8_t *extra = NULL;
    if (traits->extra_bytes) {
        extra = gn_arena_alloc(arena, ray_count, traits->extra_bytes);
        out_answers->candidates = program == GN_CTS_CANDIDATES ? (struct gn_cts_candidates *)extra : NULL;
        out_answers->details = program == GN_CTS_DETAIL ? (struct gn_cts_detail *)extra : NULL;
        out_answers->positions = program == GN_CTS_POSITIONS ? (float(*)[9])extra : NULL;
    }
    enum gn_device_status status = route_prepare(built, route, program);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    const uint32_t chunk = ray_count < traits->chunk ? ray_count : traits->chunk;
    status = buffers_reserve(device, (VkDeviceSize)chunk * sizeof(struct gpu_ray),
                             (VkDeviceSize)chunk * sizeof(struct gn_ref_answer),
                             (VkDeviceSize)chunk * traits->extra_bytes);
    if (status != GN_DEVICE_OK) {
        goto done;
    }
    descriptors_write(built);
    for (uint64_t next = 0; next < ray_count; next += chunk) {
        const uint32_t first = (uint32_t)next;
        const uint32_t count = ray_count - first < chunk ? ray_count - first : chunk;
        struct gn_ref_answer *committed = out_answers->committed + first;
        const struct gn_trace_constants constants = {
            .ray_count = count,
            .program = program,
            .record_offset = route->record_offset,
            .record_stride = route->record_stride,
            .miss_index = route->miss_index,
            .depth = route->depth,
            .ways = (route->traps ? GN_WAY_TRAPS : 0u) | (route->opaque_boxes ? GN_WAY_OPAQUE_BOXES : 0u) |
                    (route->from_candidate ? GN_WAY_FROM_CANDIDATE : 0u) |
                    (route->terminate ? GN_WAY_TERMINATE : 0u) | (route->wide ? GN_WAY_WIDE : 0u) |
                    (route->reports ? GN_WAY_REPORTS : 0u) | (route->counted ? GN_WAY_COUNTED : 0u) |
                    (route->any_hit_refuses ? GN_WAY_ANY_HIT_REFUSES : 0u) |
                    (route->any_hit_ends ? GN_WAY_ANY_HIT_ENDS : 0u),
            .scene_address = built->tlas.address,
        };
        rays_write(device->trace.rays.mapped, rays + first, count);
        memset(device->trace.committed.mapped, 0xFF, count * sizeof *committed);
        if ((status = chunk_trace(device, route, &constants)) != GN_DEVICE_OK) {
            goto done;
        }
        memcpy(committed, device->trace.committed.mapped, count * sizeof *committed);
        if (extra) {
            memcpy(extra + (size_t)first * traits->extra_bytes, device->trace.extra.mapped, count * traits->extra_bytes);
        }
    }
    status = gn_device_layers_check(device);
done:
    gn_pipeline_unprepare(device);
    return status;
}

void gn_trace_finish(struct gn_device *device)
{
    gn_pool_finish(device, &device->trace.pool);
    gn_drawing_finish(device);
    gn_pipelines_finish(device);
    for (size_t i = 0; i < GN_KERNEL_COUNT; i++) {
        vkDestroyPipeline(device->handle, device->programs[i].pipeline, NULL);
        vkDestroyShaderModule(device->handle, device->programs[i].module, NULL);
    }
    vkDestroyPipelineLayout(device->handle, device->pipeline_layout, NULL);
    vkDestroyDescriptorPool(device->handle, device->descriptor_pool, NULL);
    vkDestroyDescriptorSetLayout(device->handle, device->set_layout, NULL);
}
