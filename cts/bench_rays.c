/* SPDX-License-Identifier: Apache-2.0 */
/* A small ray tracing pipeline: one ray generation, one miss, one closest-hit and one any-hit shader. */
#include "cts/bench_rays.h"

#include <stdlib.h>
#include <string.h>

#include "bench_rahit.spv.h"
#include "bench_rchit.spv.h"
#include "bench_rgen.spv.h"
#include "bench_rmiss.spv.h"

/* Of the shaders, for libraries: one float; the triangle's barycentrics. */
#define PAYLOAD_BYTES 4
#define ATTRIBUTE_BYTES 8
#define ROW 256u

enum { STAGE_COUNT = 4, GROUP_COUNT = 3 };

static const struct {
    VkShaderStageFlagBits stage;
    const uint32_t *words;
    size_t bytes;
} stages[STAGE_COUNT] = {
    {VK_SHADER_STAGE_RAYGEN_BIT_KHR, bench_rgen_spv, sizeof bench_rgen_spv},
    {VK_SHADER_STAGE_MISS_BIT_KHR, bench_rmiss_spv, sizeof bench_rmiss_spv},
    {VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR, bench_rchit_spv, sizeof bench_rchit_spv},
    {VK_SHADER_STAGE_ANY_HIT_BIT_KHR, bench_rahit_spv, sizeof bench_rahit_spv},
};

static VkRayTracingShaderGroupCreateInfoKHR group_of(VkRayTracingShaderGroupTypeKHR type, uint32_t general,
                                                     uint32_t closest_hit, uint32_t any_hit)
{
    return (VkRayTracingShaderGroupCreateInfoKHR){.sType = VK_STRUCTURE_TYPE_RAY_TRACING_SHADER_GROUP_CREATE_INFO_KHR,
                                                  .type = type,
                                                  .generalShader = general,
                                                  .closestHitShader = closest_hit,
                                                  .anyHitShader = any_hit,
                                                  .intersectionShader = VK_SHADER_UNUSED_KHR};
}

/* What a pipeline or library is made of: some of the stages. */
enum part { PART_ALL, PART_FRONT, PART_HITS, PART_LIBRARIES };

static enum gn_device_status make(struct gn_device *device, VkPipelineLayout layout, enum part part, bool linked,
                                  const VkPipeline libraries[2], VkPipeline *out)
{
    const uint32_t none = VK_SHADER_UNUSED_KHR;
    const uint32_t first = part == PART_HITS ? 2 : 0, end = part == PART_LIBRARIES ? 0 : part == PART_FRONT ? 2 : STAGE_COUNT;
    VkPipelineShaderStageCreateInfo made[STAGE_COUNT];
    VkRayTracingShaderGroupCreateInfoKHR groups[GROUP_COUNT];
    uint32_t count = 0, group_count = 0;
    VkResult result = VK_SUCCESS;
    for (uint32_t i = first; i < end && result == VK_SUCCESS; i++) {
        const VkShaderModuleCreateInfo info = {.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO,
                                               .codeSize = stages[i].bytes,
                                               .pCode = stages[i].words};
        made[count] = (VkPipelineShaderStageCreateInfo){.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                        .stage = stages[i].stage,
                                                        .pName = "main"};
        result = vkCreateShaderModule(device->handle, &info, NULL, &made[count].module);
        count += result == VK_SUCCESS;
    }
    if (part == PART_ALL || part == PART_FRONT) {
        groups[group_count++] = group_of(VK_RAY_TRACING_SHADER_GROUP_TYPE_GENERAL_KHR, 0, none, none);
        groups[group_count++] = group_of(VK_RAY_TRACING_SHADER_GROUP_TYPE_GENERAL_KHR, 1, none, none);
    }
    if (part == PART_ALL || part == PART_HITS)
        groups[group_count++] =
            group_of(VK_RAY_TRACING_SHADER_GROUP_TYPE_TRIANGLES_HIT_GROUP_KHR, none, 2 - first, 3 - first);
    const VkPipelineLibraryCreateInfoKHR library_info = {.sType = VK_STRUCTURE_TYPE_PIPELINE_LIBRARY_CREATE_INFO_KHR,
                                                         .libraryCount = 2,
                                                         .pLibraries = libraries};
    const VkRayTracingPipelineInterfaceCreateInfoKHR interface = {
        .sType = VK_STRUCTURE_TYPE_RAY_TRACING_PIPELINE_INTERFACE_CREATE_INFO_KHR,
        .maxPipelineRayPayloadSize = PAYLOAD_BYTES,
        .maxPipelineRayHitAttributeSize = ATTRIBUTE_BYTES};
    const VkRayTracingPipelineCreateInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_RAY_TRACING_PIPELINE_CREATE_INFO_KHR,
        .flags = part == PART_FRONT || part == PART_HITS ? VK_PIPELINE_CREATE_LIBRARY_BIT_KHR : 0,
        .stageCount = count,
        .pStages = made,
        .groupCount = group_count,
        .pGroups = groups,
        .maxPipelineRayRecursionDepth = 1,
        .pLibraryInfo = part == PART_LIBRARIES ? &library_info : NULL,
        .pLibraryInterface = linked ? &interface : NULL,
        .layout = layout};
    if (result == VK_SUCCESS)
        result = device->CreateRayTracingPipelinesKHR(device->handle, VK_NULL_HANDLE, VK_NULL_HANDLE, 1, &info, NULL, out);
    for (uint32_t i = 0; i < count; i++)
        vkDestroyShaderModule(device->handle, made[i].module, NULL);
    return gn_device_check(device, result, "vkCreateRayTracingPipelinesKHR");
}

enum gn_device_status gn_bench_rays_create(struct gn_device *device, VkPipelineLayout layout, bool linked,
                                           struct gn_bench_rays *out)
{
    out->pool.kind = GN_MEMORY_TABLE;
    if (!device->info.ray_tracing_pipeline)
        return gn_device_fail(device, GN_DEVICE_UNSUPPORTED, "the device has no ray tracing pipelines");
    if (!linked)
        return make(device, layout, PART_ALL, false, NULL, &out->handle);
    if (!device->info.pipeline_library)
        return gn_device_fail(device, GN_DEVICE_UNSUPPORTED, "the device has no pipeline libraries");
    enum gn_device_status status = make(device, layout, PART_FRONT, true, NULL, &out->libraries[0]);
    if (status == GN_DEVICE_OK)
        status = make(device, layout, PART_HITS, true, NULL, &out->libraries[1]);
    return status == GN_DEVICE_OK ? make(device, layout, PART_LIBRARIES, true, out->libraries, &out->handle) : status;
}

enum gn_device_status gn_bench_rays_prepare(struct gn_device *device, struct gn_bench_rays *rays)
{
    const VkPhysicalDeviceRayTracingPipelinePropertiesKHR *limits = &device->info.pipeline_limits;
    const VkDeviceSize handle = limits->shaderGroupHandleSize, base = limits->shaderGroupBaseAlignment;
    const VkDeviceSize stride = (handle + base - 1) / base * base;
    struct gn_memory memory;
    if (rays->raygen.size)
        return GN_DEVICE_OK;
    uint8_t *handles = calloc(GROUP_COUNT, handle);
    if (!handles)
        return gn_device_fail(device, GN_DEVICE_FAILED, "no host memory for shader group handles");
    enum gn_device_status status =
        gn_device_check(device,
                        device->GetRayTracingShaderGroupHandlesKHR(device->handle, rays->handle, 0, GROUP_COUNT,
                                                                   (size_t)(GROUP_COUNT * handle), handles),
                        "vkGetRayTracingShaderGroupHandlesKHR");
    if (status == GN_DEVICE_OK)
        status = gn_pool_take(device, &rays->pool, GROUP_COUNT * stride, base, &memory);
    if (status == GN_DEVICE_OK) {
        VkStridedDeviceAddressRegionKHR *regions[GROUP_COUNT] = {&rays->raygen, &rays->miss, &rays->hit};
        for (VkDeviceSize i = 0; i < GROUP_COUNT; i++) {
            memcpy(memory.mapped + i * stride, handles + i * handle, handle);
            *regions[i] = (VkStridedDeviceAddressRegionKHR){memory.address + i * stride, stride, stride};
        }
    }
    free(handles);
    return status;
}

void gn_bench_rays_record(struct gn_device *device, const struct gn_bench_rays *rays, uint32_t count)
{
    const VkStridedDeviceAddressRegionKHR callable = {0};
    vkCmdBindPipeline(device->commands, VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR, rays->handle);
    device->CmdTraceRaysKHR(device->commands, &rays->raygen, &rays->miss, &rays->hit, &callable, count < ROW ? count : ROW,
                            (count + ROW - 1) / ROW, 1);
}

void gn_bench_rays_destroy(struct gn_device *device, struct gn_bench_rays *rays)
{
    if (!device->lost) {
        vkDestroyPipeline(device->handle, rays->handle, NULL);
        vkDestroyPipeline(device->handle, rays->libraries[0], NULL);
        vkDestroyPipeline(device->handle, rays->libraries[1], NULL);
    }
    gn_pool_finish(device, &rays->pool);
    *rays = (struct gn_bench_rays){0};
}
