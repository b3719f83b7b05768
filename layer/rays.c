/* SPDX-License-Identifier: Apache-2.0 */
/* Ray-tracing pipelines: the types of their groups, libraries included, and the dictionary of their handles, which the layer asks for when
 * a pipeline is created. */
#include "layer/sbt.h"

#include <stdlib.h>
#include <string.h>

uint64_t gn_handle_hash(const unsigned char *handle, uint32_t size)
{
    uint64_t hash = UINT64_C(0xCBF29CE484222325);
    for (uint32_t i = 0; i < size; i++)
        hash = (hash ^ handle[i]) * UINT64_C(0x100000001B3);
    return hash;
}

void gn_rays_release(struct gn_rays *rays)
{
    if (!rays || --rays->references)
        return;
    gn_map_finish(&rays->groups);
    free(rays->handles);
    free(rays);
}

static enum gn_group_kind kind_of(const VkRayTracingPipelineCreateInfoKHR *info, const VkRayTracingShaderGroupCreateInfoKHR *group)
{
    if (group->type == VK_RAY_TRACING_SHADER_GROUP_TYPE_TRIANGLES_HIT_GROUP_KHR)
        return GN_GROUP_TRIANGLES;
    if (group->type == VK_RAY_TRACING_SHADER_GROUP_TYPE_PROCEDURAL_HIT_GROUP_KHR)
        return GN_GROUP_PROCEDURAL;
    if (group->generalShader >= info->stageCount)
        return GN_GROUP_UNKNOWN;
    switch (info->pStages[group->generalShader].stage) {
    case VK_SHADER_STAGE_RAYGEN_BIT_KHR: return GN_GROUP_RAYGEN;
    case VK_SHADER_STAGE_MISS_BIT_KHR: return GN_GROUP_MISS;
    case VK_SHADER_STAGE_CALLABLE_BIT_KHR: return GN_GROUP_CALLABLE;
    default: return GN_GROUP_UNKNOWN;
    }
}

VkPipelineCreateFlags2 gn_rays_flags(const VkRayTracingPipelineCreateInfoKHR *info)
{
    const VkPipelineCreateFlags2CreateInfo *wide = gn_chain_find(info->pNext, VK_STRUCTURE_TYPE_PIPELINE_CREATE_FLAGS_2_CREATE_INFO);
    return wide ? wide->flags : info->flags;
}

/* False where they cannot be asked for: a library has none of its own unless an extension says so. */
static bool read_handles(struct gn_device *device, struct gn_rays *rays)
{
    if (!rays->group_count)
        return true;
    if ((rays->flags & VK_PIPELINE_CREATE_2_LIBRARY_BIT_KHR) || !rays->handle_size || !device->next.GetRayTracingShaderGroupHandlesKHR)
        return false;
    size_t size = (size_t)rays->group_count * rays->handle_size;
    rays->handles = malloc(size);
    return rays->handles && device->next.GetRayTracingShaderGroupHandlesKHR(device->handle, rays->handle, 0, rays->group_count, size,
                                                                            rays->handles) == VK_SUCCESS;
}

static bool enter_handles(struct gn_rays *rays)
{
    for (uint32_t g = rays->group_count; g-- > 0;)
        if (!gn_map_put(&rays->groups, gn_handle_hash(rays->handles + (size_t)g * rays->handle_size, rays->handle_size),
                        (void *)(uintptr_t)(g + 1)))
            return false;
    return true;
}

/* With the device locked. */
static struct gn_rays *rays_get(const struct gn_device *device, VkPipeline pipeline)
{
    return pipeline ? gn_map_get(&device->rays, (uint64_t)pipeline) : NULL;
}

static void check_recursion(struct gn_device *device, const struct gn_rays *rays, uint32_t depth)
{
    struct gn_findings findings;
    uint32_t most = device->ray_limits.maxRayRecursionDepth;
    if (!most || depth <= most)
        return;
    struct gn_demand demand = {.kind = GN_DEMAND_RECURSION,
                               .place = "vkCreateRayTracingPipelinesKHR",
                               .target = {GN_OBJECT_PIPELINE, (uint64_t)rays->handle, NULL},
                               .target_id = rays->id,
                               .info = GN_NO_INDEX,
                               .geometry = GN_NO_INDEX,
                               .what = "maxPipelineRayRecursionDepth",
                               .value = depth,
                               .bound = most};
    gn_findings_init(&findings);
    gn_report_demand(device->instance, &demand, &findings);
    gn_report_flush(device->instance, &findings);
}

void gn_rays_created(struct gn_device *device, uint32_t count, const VkRayTracingPipelineCreateInfoKHR *infos,
                     const VkPipeline *pipelines)
{
    for (uint32_t i = 0; i < count; i++) {
        const VkRayTracingPipelineCreateInfoKHR *info = &infos[i];
        if (!pipelines[i])
            continue;
        gn_lock(device);
        uint32_t groups = info->groupCount;
        bool known = true;
        for (uint32_t l = 0; info->pLibraryInfo && l < info->pLibraryInfo->libraryCount; l++) {
            const struct gn_rays *library = rays_get(device, info->pLibraryInfo->pLibraries[l]);
            known &= library != NULL;
            groups += library ? library->group_count : 0;
        }
        struct gn_rays *rays = known ? calloc(1, sizeof *rays + groups) : NULL;
        if (rays) {
            *rays = (struct gn_rays){.id = ++device->ray_ids,
                                     .handle = pipelines[i],
                                     .references = 1,
                                     .flags = gn_rays_flags(info),
                                     .handle_size = device->ray_limits.shaderGroupHandleSize,
                                     .group_count = groups};
            uint32_t g = 0;
            for (; g < info->groupCount; g++)
                rays->kinds[g] = (unsigned char)kind_of(info, &info->pGroups[g]);
            for (uint32_t l = 0; info->pLibraryInfo && l < info->pLibraryInfo->libraryCount; l++) {
                const struct gn_rays *library = rays_get(device, info->pLibraryInfo->pLibraries[l]);
                memcpy(rays->kinds + g, library->kinds, library->group_count);
                g += library->group_count;
            }
        }
        gn_unlock(device);
        if (!rays)
            continue;
        if (read_handles(device, rays))
            rays->handles_known = enter_handles(rays);
        check_recursion(device, rays, info->maxPipelineRayRecursionDepth);
        gn_lock(device);
        if (gn_map_put(&device->rays, (uint64_t)pipelines[i], rays)) {
            rays->next = device->first_rays;
            device->first_rays = rays;
            atomic_store_explicit(&device->ray_pipelines, true, memory_order_release);
        } else {
            gn_rays_release(rays);
        }
        gn_unlock(device);
    }
}

void gn_rays_destroyed(struct gn_device *device, VkPipeline pipeline)
{
    if (!atomic_load_explicit(&device->ray_pipelines, memory_order_acquire))
        return;
    gn_lock(device);
    struct gn_rays *rays = gn_map_take(&device->rays, (uint64_t)pipeline);
    if (rays) {
        struct gn_rays **link = &device->first_rays;
        while (*link != rays)
            link = &(*link)->next;
        *link = rays->next;
        rays->destroyed = true;
        struct gn_rays **former =
            &device->former_rays[device->former_ray_count++ % (sizeof device->former_rays / sizeof device->former_rays[0])];
        gn_rays_release(*former);
        *former = rays;
    }
    gn_unlock(device);
}

void gn_rays_bound(struct gn_device *device, VkCommandBuffer handle, VkPipelineBindPoint point, VkPipeline pipeline)
{
    if (point != VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR || !atomic_load_explicit(&device->ray_pipelines, memory_order_acquire))
        return;
    gn_lock(device);
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    struct gn_rays *rays = rays_get(device, pipeline);
    if (commands && commands->rays != rays) {
        gn_rays_release(commands->rays);
        commands->rays = rays;
        if (rays)
            rays->references++;
    }
    gn_unlock(device);
}

void gn_rays_finish(struct gn_device *device)
{
    for (struct gn_rays *rays = device->first_rays, *next; rays; rays = next) {
        next = rays->next;
        gn_rays_release(rays);
    }
    device->first_rays = NULL;
    for (size_t i = 0; i < sizeof device->former_rays / sizeof device->former_rays[0]; i++)
        gn_rays_release(device->former_rays[i]);
    gn_map_finish(&device->rays);
}
