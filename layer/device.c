/* SPDX-License-Identifier: Apache-2.0 */
/* Devices: which of them the layer watches, and their end. */
#include "layer/sbt.h"
#include "layer/shader.h"
#include "layer/sync.h"

#include <stdlib.h>
#include <string.h>

/* Recognised and named in the closing statement, not judged. `builds_unseen`: its commands create or build BLASes that the layer does
 * not see, so that nothing can be said about what was never built. */
static const struct {
    const char *name;
    bool builds_unseen;
} unjudged_extensions[] = {
    {"VK_NV_ray_tracing", false},
    {"VK_NV_ray_tracing_motion_blur", false},
    {"VK_EXT_opacity_micromap", false},
    {"VK_KHR_opacity_micromap", false},
    {"VK_NV_displacement_micromap", false},
    {"VK_NV_cluster_acceleration_structure", true},
    {"VK_NV_partitioned_acceleration_structure", true},
    {"VK_KHR_device_address_commands", true},
    {"VK_NV_ray_tracing_invocation_reorder", false},
    {"VK_EXT_ray_tracing_invocation_reorder", false},
    {"VK_AMDX_dense_geometry_format", false},
};

static VkLayerDeviceCreateInfo *link_of(const VkDeviceCreateInfo *info)
{
    for (const VkBaseInStructure *in = info->pNext; in; in = in->pNext) {
        VkLayerDeviceCreateInfo *link = (VkLayerDeviceCreateInfo *)(uintptr_t)in;
        if (in->sType == VK_STRUCTURE_TYPE_LOADER_DEVICE_CREATE_INFO && link->function == VK_LAYER_LINK_INFO)
            return link;
    }
    return NULL;
}

static bool has_extension(const VkDeviceCreateInfo *info, const char *name)
{
    for (uint32_t i = 0; i < info->enabledExtensionCount; i++)
        if (strcmp(info->ppEnabledExtensionNames[i], name) == 0)
            return true;
    return false;
}

static bool wants_structures(const VkDeviceCreateInfo *info)
{
    const VkPhysicalDeviceAccelerationStructureFeaturesKHR *features =
        gn_chain_find(info->pNext, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_FEATURES_KHR);
    return features && features->accelerationStructure && has_extension(info, VK_KHR_ACCELERATION_STRUCTURE_EXTENSION_NAME);
}

static void note_extensions(struct gn_device *device, const VkDeviceCreateInfo *info)
{
    struct gn_instance *instance = device->instance;
    for (size_t i = 0; i < sizeof unjudged_extensions / sizeof unjudged_extensions[0]; i++) {
        const char *name = unjudged_extensions[i].name;
        if (!has_extension(info, name))
            continue;
        if (unjudged_extensions[i].builds_unseen) {
            device->copies = false;
            device->builds_unseen = true;
            device->no_copies_because = GN_UNJUDGED_cluster_builds;
        }
        pthread_mutex_lock(&instance->lock);
        uint32_t known = 0;
        while (known < instance->unjudged_extension_count && instance->unjudged_extensions[known] != name)
            known++;
        if (known == instance->unjudged_extension_count &&
            known < sizeof instance->unjudged_extensions / sizeof instance->unjudged_extensions[0])
            instance->unjudged_extensions[instance->unjudged_extension_count++] = name;
        pthread_mutex_unlock(&instance->lock);
    }
}

/* A copy may run on any queue, so its target belongs to all families. */
static void note_families(struct gn_device *device, const VkDeviceCreateInfo *info)
{
    const uint32_t room = sizeof device->families / sizeof device->families[0];
    for (uint32_t i = 0; i < info->queueCreateInfoCount; i++) {
        uint32_t known = 0;
        while (known < device->family_count && device->families[known] != info->pQueueCreateInfos[i].queueFamilyIndex)
            known++;
        if (known < device->family_count)
            continue;
        if (known == room) {
            device->copies = false;
            device->no_copies_because = GN_UNJUDGED_device_groups;
            return;
        }
        device->families[device->family_count++] = info->pQueueCreateInfos[i].queueFamilyIndex;
    }
}

static void load_next(struct gn_device *device, PFN_vkGetDeviceProcAddr lookup)
{
    struct gn_device_next *next = &device->next;
    next->GetDeviceProcAddr = lookup;
#define GN_DEVICE_COMMAND(name) next->name = (PFN_vk##name)lookup(device->handle, "vk" #name);
#define GN_DEVICE_OWN(name)                                                                                            \
    next->name =                                                                                                       \
        (PFN_vk##name)device->instance->next.GetInstanceProcAddr(device->instance->handle, "vk" #name);
#define GN_DEVICE_USED(name) next->name = (PFN_vk##name)lookup(device->handle, "vk" #name);
#include "layer/commands.def"
#define GN_DEVICE_ALIAS(alias, name)                                                                                   \
    if (!next->name)                                                                                                   \
        next->name = (PFN_vk##name)lookup(device->handle, "vk" #alias);
#include "layer/commands.def"
    if (!next->GetBufferDeviceAddress)
        next->GetBufferDeviceAddress = next->GetBufferDeviceAddressKHR;
}

/* Limits stay 0 where they cannot be asked, and nothing is held against them. */
static void read_limits(struct gn_device *device, bool has_rays)
{
    device->ray_limits.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_PROPERTIES_KHR;
    device->limits.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_PROPERTIES_KHR;
    device->limits.pNext = has_rays ? &device->ray_limits : NULL;
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &device->limits};
    if (device->instance->next.GetPhysicalDeviceProperties2)
        device->instance->next.GetPhysicalDeviceProperties2(device->physical, &properties);
    device->limits.pNext = NULL;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateDevice(VkPhysicalDevice physical, const VkDeviceCreateInfo *info,
                                                     const VkAllocationCallbacks *allocator, VkDevice *out)
{
    struct gn_instance *instance = gn_instance_of(physical);
    VkLayerDeviceCreateInfo *link = link_of(info);
    if (!instance || !link || !link->u.pLayerInfo)
        return VK_ERROR_INITIALIZATION_FAILED;
    PFN_vkGetInstanceProcAddr instance_lookup = link->u.pLayerInfo->pfnNextGetInstanceProcAddr;
    PFN_vkGetDeviceProcAddr device_lookup = link->u.pLayerInfo->pfnNextGetDeviceProcAddr;
    PFN_vkCreateDevice create = (PFN_vkCreateDevice)instance_lookup(instance->handle, "vkCreateDevice");
    if (!create)
        return VK_ERROR_INITIALIZATION_FAILED;
    struct gn_device *device = calloc(1, sizeof *device);
    if (!device)
        return VK_ERROR_OUT_OF_HOST_MEMORY;

    link->u.pLayerInfo = link->u.pLayerInfo->pNext;
    struct gn_device_wish wish;
    bool wishes = instance->settings.shader_checks != GN_SHADERS_OFF && wants_structures(info);
    if (wishes)
        gn_device_wish_init(&wish, instance, physical, info);
    VkResult result = create(physical, wishes ? &wish.info : info, allocator, out);
    if (wishes)
        gn_device_wish_finish(&wish);
    if (result != VK_SUCCESS)
        goto fail;
    device->handle = *out;
    device->instance = instance;
    device->physical = physical;
    device->tracked = wants_structures(info);
    device->copies = true;
    device->valid_instance_flags =
        VK_GEOMETRY_INSTANCE_TRIANGLE_FACING_CULL_DISABLE_BIT_KHR | VK_GEOMETRY_INSTANCE_TRIANGLE_FLIP_FACING_BIT_KHR |
        VK_GEOMETRY_INSTANCE_FORCE_OPAQUE_BIT_KHR | VK_GEOMETRY_INSTANCE_FORCE_NO_OPAQUE_BIT_KHR |
        (has_extension(info, VK_EXT_OPACITY_MICROMAP_EXTENSION_NAME) || has_extension(info, "VK_KHR_opacity_micromap")
             ? VK_GEOMETRY_INSTANCE_FORCE_OPACITY_MICROMAP_2_STATE_EXT | VK_GEOMETRY_INSTANCE_DISABLE_OPACITY_MICROMAPS_EXT
             : 0);
    pthread_mutex_init(&device->lock, NULL);
    load_next(device, device_lookup);
    if (!gn_device_register(device)) {
        device->next.DestroyDevice(*out, allocator);
        pthread_mutex_destroy(&device->lock);
        result = VK_ERROR_OUT_OF_HOST_MEMORY;
        goto fail;
    }
    note_extensions(device, info);
    if (device->tracked) {
        const VkDeviceGroupDeviceCreateInfo *group =
            gn_chain_find(info->pNext, VK_STRUCTURE_TYPE_DEVICE_GROUP_DEVICE_CREATE_INFO);
        if (group && group->physicalDeviceCount > 1) {
            device->copies = false;
            device->no_copies_because = GN_UNJUDGED_device_groups;
        }
        note_families(device, info);
        instance->next.GetPhysicalDeviceMemoryProperties(physical, &device->memory);
        read_limits(device, has_extension(info, VK_KHR_RAY_TRACING_PIPELINE_EXTENSION_NAME));
        if (wishes && !gn_shaders_init(device, &wish))
            gn_tally_unjudged(device, GN_UNJUDGED_out_of_host_memory, 1);
    }
    atomic_fetch_add(device->tracked ? &instance->tracked_devices : &instance->passed_devices, 1);
    return VK_SUCCESS;

fail:
    free(device);
    return result;
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyDevice(VkDevice handle, const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = handle ? gn_device_of(handle) : NULL;
    if (!device)
        return;
    if (device->tracked) {
        gn_queues_finish(device);
        gn_shaders_finish(device);
        gn_lock(device);
        gn_host_commands_finish(device);
        gn_command_buffers_finish(device);
        gn_staging_finish(device);
        gn_query_pools_finish(device);
        gn_descriptors_finish(device);
        gn_modules_finish(device);
        gn_changes_finish(device);
        gn_sync_finish(device);
        gn_semaphores_finish(device);
        gn_render_passes_finish(device);
        gn_as_finish(device);
        gn_rays_finish(device);
        gn_buffers_finish(device);
        gn_unlock(device);
    }
    gn_device_forget(device);
    device->next.DestroyDevice(handle, allocator);
    pthread_mutex_destroy(&device->lock);
    free(device);
}

static char **name_of(struct gn_device *device, VkObjectType type, uint64_t handle)
{
    switch (type) {
    case VK_OBJECT_TYPE_ACCELERATION_STRUCTURE_KHR: {
        struct gn_as *as = gn_map_get(&device->structures, handle);
        return as ? &as->name : NULL;
    }
    case VK_OBJECT_TYPE_BUFFER: {
        struct gn_buffer *buffer = gn_map_get(&device->buffers, handle);
        return buffer ? &buffer->name : NULL;
    }
    case VK_OBJECT_TYPE_COMMAND_BUFFER: {
        struct gn_command_buffer *commands = gn_map_get(&device->command_buffers, handle);
        return commands ? &commands->name : NULL;
    }
    case VK_OBJECT_TYPE_QUEUE: {
        struct gn_queue *queue = gn_queue_get(device, (VkQueue)(uintptr_t)handle);
        return queue ? &queue->name : NULL;
    }
    case VK_OBJECT_TYPE_SHADER_MODULE:
    case VK_OBJECT_TYPE_PIPELINE:
    case VK_OBJECT_TYPE_SHADER_EXT:
        return gn_pipeline_name(device, type, handle);
    default:
        return NULL;
    }
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_SetDebugUtilsObjectNameEXT(VkDevice handle,
                                                                   const VkDebugUtilsObjectNameInfoEXT *info)
{
    struct gn_device *device = gn_device_of(handle);
    char *name = info->pObjectName && *info->pObjectName ? strdup(info->pObjectName) : NULL;
    gn_lock(device);
    char **slot = !device->tracked ? NULL : name_of(device, info->objectType, info->objectHandle);
    if (slot) {
        char *old = *slot;
        *slot = name;
        name = old;
    }
    gn_unlock(device);
    free(name);
    return device->next.SetDebugUtilsObjectNameEXT ? device->next.SetDebugUtilsObjectNameEXT(handle, info) : VK_SUCCESS;
}
