/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A layer that gives lavapipe what no driver at hand has: indirect builds, host commands, and operations that are really
 * deferred. They are carried out by the driver's device commands; what an address points to can be read, because
 * lavapipe's device addresses are pointers. GNOMON_HOSTED_FAULT makes one of them wrong, to see that it is noticed:
 * "lost" (a host build loses the last primitive of each geometry), "unjoined" (an operation is complete at its first
 * join, but was never done), "range" (an indirect build does not mind the offsets of its ranges).
 */
#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <vulkan/vk_layer.h>

static VkInstance the_instance;
static PFN_vkGetInstanceProcAddr instance_below;
static PFN_vkGetDeviceProcAddr device_below;
static VkQueue queue;
static VkCommandPool pool;
static VkCommandBuffer commands;

#define BELOW(X)                                                                                             \
    X(GetDeviceQueue)                                                                                        \
    X(CreateCommandPool)                                                                                     \
    X(DestroyCommandPool)                                                                                    \
    X(AllocateCommandBuffers)                                                                                \
    X(BeginCommandBuffer)                                                                                    \
    X(EndCommandBuffer)                                                                                      \
    X(QueueSubmit)                                                                                           \
    X(QueueWaitIdle)                                                                                         \
    X(CreateQueryPool)                                                                                       \
    X(DestroyQueryPool)                                                                                      \
    X(GetQueryPoolResults)                                                                                   \
    X(CmdResetQueryPool)                                                                                     \
    X(CmdBuildAccelerationStructuresKHR)                                                                     \
    X(CmdCopyAccelerationStructureKHR)                                                                       \
    X(CmdCopyAccelerationStructureToMemoryKHR)                                                               \
    X(CmdCopyMemoryToAccelerationStructureKHR)                                                               \
    X(CmdWriteAccelerationStructuresPropertiesKHR)                                                           \
    X(GetAccelerationStructureDeviceAddressKHR)                                                              \
    X(CreateRayTracingPipelinesKHR)                                                                          \
    X(DestroyDevice)
#define MEMBER(name) PFN_vk##name name;
static struct {
    BELOW(MEMBER)
} below;

static bool faulty(const char *name)
{
    const char *chosen = getenv("GNOMON_HOSTED_FAULT");
    return chosen && strcmp(chosen, name) == 0;
}

static void *memory(size_t count, size_t size)
{
    void *bytes = calloc(count ? count : 1, size);
    if (!bytes)
        abort();
    return bytes;
}

/* Deferred operations */

enum kind { BUILD, COPY, TO_MEMORY, FROM_MEMORY, PIPELINES };
/* Arguments as they were given; whoever defers has to leave what they point to alone. */
struct work {
    enum kind kind;
    VkDevice device;
    uint32_t count;
    const void *infos;
    const VkAccelerationStructureBuildRangeInfoKHR *const *ranges;
    VkPipelineCache cache;
    const VkAllocationCallbacks *allocator;
    VkPipeline *pipelines;
};
struct operation {
    pthread_mutex_t lock;
    bool pending, running;
    uint32_t turned_away;
    VkResult result;
    struct work work;
};

static VkResult perform(const struct work *work);

static struct operation *operation_of(VkDeferredOperationKHR handle)
{
    return (struct operation *)(uintptr_t)handle;
}

static VKAPI_ATTR VkResult VKAPI_CALL hosted_CreateDeferredOperationKHR(VkDevice device,
                                                                        const VkAllocationCallbacks *allocator,
                                                                        VkDeferredOperationKHR *out)
{
    struct operation *operation = memory(1, sizeof *operation);
    (void)device, (void)allocator;
    pthread_mutex_init(&operation->lock, NULL);
    *out = (VkDeferredOperationKHR)(uintptr_t)operation;
    return VK_SUCCESS;
}

static VKAPI_ATTR void VKAPI_CALL hosted_DestroyDeferredOperationKHR(VkDevice device, VkDeferredOperationKHR handle,
                                                                     const VkAllocationCallbacks *allocator)
{
    (void)device, (void)allocator;
    if (handle)
        pthread_mutex_destroy(&operation_of(handle)->lock);
    free(operation_of(handle));
}

static VKAPI_ATTR uint32_t VKAPI_CALL hosted_GetDeferredOperationMaxConcurrencyKHR(VkDevice device,
                                                                                   VkDeferredOperationKHR handle)
{
    struct operation *operation = operation_of(handle);
    (void)device;
    pthread_mutex_lock(&operation->lock);
    const uint32_t count = operation->pending && !operation->running;
    pthread_mutex_unlock(&operation->lock);
    return count;
}

static VKAPI_ATTR VkResult VKAPI_CALL hosted_GetDeferredOperationResultKHR(VkDevice device,
                                                                           VkDeferredOperationKHR handle)
{
    struct operation *operation = operation_of(handle);
    (void)device;
    pthread_mutex_lock(&operation->lock);
    const VkResult result = operation->pending ? VK_NOT_READY : operation->result;
    pthread_mutex_unlock(&operation->lock);
    return result;
}

/* The first thread does the work; others are told in turn to come again and that there is none. */
static VKAPI_ATTR VkResult VKAPI_CALL hosted_DeferredOperationJoinKHR(VkDevice device, VkDeferredOperationKHR handle)
{
    struct operation *operation = operation_of(handle);
    (void)device;
    pthread_mutex_lock(&operation->lock);
    const bool pending = operation->pending, mine = pending && !operation->running;
    const bool later = operation->turned_away++ % 2;
    operation->running = operation->running || mine;
    pthread_mutex_unlock(&operation->lock);
    if (!mine)
        return !pending ? VK_SUCCESS : later ? VK_THREAD_IDLE_KHR : VK_THREAD_DONE_KHR;
    const VkResult result = faulty("unjoined") ? VK_SUCCESS : perform(&operation->work);
    pthread_mutex_lock(&operation->lock);
    operation->result = result;
    operation->pending = operation->running = false;
    pthread_mutex_unlock(&operation->lock);
    return VK_SUCCESS;
}

/* At once, or later in `handle`. */
static VkResult request(VkDeferredOperationKHR handle, const struct work *work)
{
    if (!handle)
        return perform(work);
    struct operation *operation = operation_of(handle);
    operation->work = *work;
    operation->pending = true;
    return VK_OPERATION_DEFERRED_KHR;
}

/* Host commands */

static VkResult begin(void)
{
    const VkCommandBufferBeginInfo info = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    return below.BeginCommandBuffer(commands, &info);
}

static VkResult finish(void)
{
    VkResult result = below.EndCommandBuffer(commands);
    const VkSubmitInfo info = {
        .sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &commands};
    if (result == VK_SUCCESS)
        result = below.QueueSubmit(queue, 1, &info, VK_NULL_HANDLE);
    return result == VK_SUCCESS ? below.QueueWaitIdle(queue) : result;
}

/* Host builds refer to structures by handle; the copies that the device reads have addresses. */
static VkAccelerationStructureInstanceKHR *instances_translate(VkDevice device,
                                                               const VkAccelerationStructureGeometryInstancesDataKHR *from,
                                                               const VkAccelerationStructureBuildRangeInfoKHR *range)
{
    const uint8_t *data = (const uint8_t *)from->data.hostAddress + range->primitiveOffset;
    VkAccelerationStructureInstanceKHR *out = NULL;
    if (posix_memalign((void **)&out, 64, (range->primitiveCount + 1) * sizeof *out))
        abort();
    for (uint32_t i = 0; i < range->primitiveCount; i++) {
        const void *at = data + i * sizeof *out;
        if (from->arrayOfPointers)
            memcpy(&at, data + i * sizeof at, sizeof at);
        memcpy(&out[i], at, sizeof *out);
        const VkAccelerationStructureDeviceAddressInfoKHR info = {
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_DEVICE_ADDRESS_INFO_KHR,
            .accelerationStructure = (VkAccelerationStructureKHR)(uintptr_t)out[i].accelerationStructureReference,
        };
        if (info.accelerationStructure)
            out[i].accelerationStructureReference = below.GetAccelerationStructureDeviceAddressKHR(device, &info);
    }
    return out;
}

static VkResult build(const struct work *work)
{
    const VkAccelerationStructureBuildGeometryInfoKHR *infos = work->infos;
    VkResult result = begin();
    void **kept = NULL;
    size_t kept_count = 0;
    for (uint32_t b = 0; b < work->count && result == VK_SUCCESS; b++) {
        VkAccelerationStructureBuildGeometryInfoKHR info = infos[b];
        VkAccelerationStructureGeometryKHR *geometries = memory(info.geometryCount, sizeof *geometries);
        VkAccelerationStructureBuildRangeInfoKHR *ranges = memory(info.geometryCount, sizeof *ranges);
        kept = realloc(kept, (kept_count + info.geometryCount + 2) * sizeof *kept);
        if (!kept)
            abort();
        kept[kept_count++] = geometries;
        kept[kept_count++] = ranges;
        for (uint32_t g = 0; g < info.geometryCount; g++) {
            /* Pointers are device addresses as they are. */
            geometries[g] = info.pGeometries[g];
            ranges[g] = work->ranges[b][g];
            if (faulty("lost") && ranges[g].primitiveCount > 1)
                ranges[g].primitiveCount--;
            if (geometries[g].geometryType != VK_GEOMETRY_TYPE_INSTANCES_KHR)
                continue;
            VkAccelerationStructureGeometryInstancesDataKHR *data = &geometries[g].geometry.instances;
            void *translated = instances_translate(work->device, data, &ranges[g]);
            data->data.deviceAddress = (VkDeviceAddress)(uintptr_t)translated;
            data->arrayOfPointers = VK_FALSE;
            ranges[g].primitiveOffset = 0;
            kept[kept_count++] = translated;
        }
        info.pGeometries = geometries;
        const VkAccelerationStructureBuildRangeInfoKHR *const range = ranges;
        below.CmdBuildAccelerationStructuresKHR(commands, 1, &info, &range);
    }
    if (result == VK_SUCCESS)
        result = finish();
    for (size_t i = 0; i < kept_count; i++)
        free(kept[i]);
    free(kept);
    return result;
}

static VkResult perform(const struct work *work)
{
    if (work->kind == PIPELINES)
        return below.CreateRayTracingPipelinesKHR(work->device, VK_NULL_HANDLE, work->cache, work->count, work->infos,
                                                  work->allocator, work->pipelines);
    if (work->kind == BUILD)
        return build(work);
    VkResult result = begin();
    if (result != VK_SUCCESS)
        return result;
    if (work->kind == COPY)
        below.CmdCopyAccelerationStructureKHR(commands, work->infos);
    else if (work->kind == TO_MEMORY)
        below.CmdCopyAccelerationStructureToMemoryKHR(commands, work->infos);
    else
        below.CmdCopyMemoryToAccelerationStructureKHR(commands, work->infos);
    return finish();
}

static VKAPI_ATTR VkResult VKAPI_CALL hosted_BuildAccelerationStructuresKHR(
    VkDevice device, VkDeferredOperationKHR deferred, uint32_t count,
    const VkAccelerationStructureBuildGeometryInfoKHR *infos, const VkAccelerationStructureBuildRangeInfoKHR *const *ranges)
{
    return request(deferred, &(struct work){
                                 .kind = BUILD, .device = device, .count = count, .infos = infos, .ranges = ranges});
}

static VKAPI_ATTR VkResult VKAPI_CALL hosted_CopyAccelerationStructureKHR(VkDevice device, VkDeferredOperationKHR deferred,
                                                                          const VkCopyAccelerationStructureInfoKHR *info)
{
    return request(deferred, &(struct work){.kind = COPY, .device = device, .infos = info});
}

static VKAPI_ATTR VkResult VKAPI_CALL hosted_CopyAccelerationStructureToMemoryKHR(
    VkDevice device, VkDeferredOperationKHR deferred, const VkCopyAccelerationStructureToMemoryInfoKHR *info)
{
    return request(deferred, &(struct work){.kind = TO_MEMORY, .device = device, .infos = info});
}

static VKAPI_ATTR VkResult VKAPI_CALL hosted_CopyMemoryToAccelerationStructureKHR(
    VkDevice device, VkDeferredOperationKHR deferred, const VkCopyMemoryToAccelerationStructureInfoKHR *info)
{
    return request(deferred, &(struct work){.kind = FROM_MEMORY, .device = device, .infos = info});
}

static VKAPI_ATTR VkResult VKAPI_CALL hosted_CreateRayTracingPipelinesKHR(
    VkDevice device, VkDeferredOperationKHR deferred, VkPipelineCache cache, uint32_t count,
    const VkRayTracingPipelineCreateInfoKHR *infos, const VkAllocationCallbacks *allocator, VkPipeline *pipelines)
{
    return request(deferred, &(struct work){.kind = PIPELINES, .device = device, .cache = cache, .count = count,
                                                 .infos = infos, .allocator = allocator, .pipelines = pipelines});
}

static VKAPI_ATTR VkResult VKAPI_CALL hosted_WriteAccelerationStructuresPropertiesKHR(
    VkDevice device, uint32_t count, const VkAccelerationStructureKHR *handles, VkQueryType type, size_t size, void *data,
    size_t stride)
{
    const VkQueryPoolCreateInfo pool_info = {
        .sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO, .queryType = type, .queryCount = count};
    VkQueryPool queries;
    VkResult result = below.CreateQueryPool(device, &pool_info, NULL, &queries);
    if (result != VK_SUCCESS)
        return result;
    if ((result = begin()) == VK_SUCCESS) {
        below.CmdResetQueryPool(commands, queries, 0, count);
        below.CmdWriteAccelerationStructuresPropertiesKHR(commands, count, handles, type, queries, 0);
        result = finish();
    }
    if (result == VK_SUCCESS)
        result = below.GetQueryPoolResults(device, queries, 0, count, size, data, stride,
                                           VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT);
    below.DestroyQueryPool(device, queries, NULL);
    return result;
}

static VKAPI_ATTR void VKAPI_CALL hosted_CmdBuildAccelerationStructuresIndirectKHR(
    VkCommandBuffer recorded, uint32_t count, const VkAccelerationStructureBuildGeometryInfoKHR *infos,
    const VkDeviceAddress *addresses, const uint32_t *strides, const uint32_t *const *most)
{
    for (uint32_t b = 0; b < count; b++) {
        VkAccelerationStructureBuildRangeInfoKHR *ranges = memory(infos[b].geometryCount, sizeof *ranges);
        for (uint32_t g = 0; g < infos[b].geometryCount; g++) {
            memcpy(&ranges[g], (const uint8_t *)(uintptr_t)addresses[b] + g * strides[b], sizeof *ranges);
            if (faulty("range"))
                ranges[g].primitiveOffset = ranges[g].transformOffset = 0;
            if (ranges[g].primitiveCount > most[b][g])
                ranges[g].primitiveCount = most[b][g];
        }
        const VkAccelerationStructureBuildRangeInfoKHR *const range = ranges;
        below.CmdBuildAccelerationStructuresKHR(recorded, 1, &infos[b], &range);
        free(ranges);
    }
}

/* The device */

static VkPhysicalDeviceAccelerationStructureFeaturesKHR *features_in(const void *chain)
{
    for (VkBaseOutStructure *at = (VkBaseOutStructure *)chain; at; at = at->pNext)
        if (at->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_FEATURES_KHR)
            return (VkPhysicalDeviceAccelerationStructureFeaturesKHR *)at;
    return NULL;
}

static VKAPI_ATTR void VKAPI_CALL hosted_GetPhysicalDeviceFeatures2(VkPhysicalDevice device,
                                                                    VkPhysicalDeviceFeatures2 *features)
{
    ((PFN_vkGetPhysicalDeviceFeatures2)instance_below(the_instance, "vkGetPhysicalDeviceFeatures2"))(device, features);
    VkPhysicalDeviceAccelerationStructureFeaturesKHR *structure = features_in(features->pNext);
    if (structure)
        structure->accelerationStructureHostCommands = structure->accelerationStructureIndirectBuild = VK_TRUE;
}

/* The next link of the loader's chain of layers; it is moved on to the one after. */
static VkLayerInstanceCreateInfo *link_of(const void *chain, VkStructureType type)
{
    VkLayerInstanceCreateInfo *link = (VkLayerInstanceCreateInfo *)chain;
    while (link && !(link->sType == type && link->function == VK_LAYER_LINK_INFO))
        link = (VkLayerInstanceCreateInfo *)link->pNext;
    return link;
}

static VKAPI_ATTR VkResult VKAPI_CALL hosted_CreateInstance(const VkInstanceCreateInfo *info,
                                                            const VkAllocationCallbacks *allocator, VkInstance *instance)
{
    VkLayerInstanceCreateInfo *link = link_of(info->pNext, VK_STRUCTURE_TYPE_LOADER_INSTANCE_CREATE_INFO);
    if (!link)
        return VK_ERROR_INITIALIZATION_FAILED;
    instance_below = link->u.pLayerInfo->pfnNextGetInstanceProcAddr;
    link->u.pLayerInfo = link->u.pLayerInfo->pNext;
    const VkResult result =
        ((PFN_vkCreateInstance)instance_below(VK_NULL_HANDLE, "vkCreateInstance"))(info, allocator, instance);
    the_instance = result == VK_SUCCESS ? *instance : VK_NULL_HANDLE;
    return result;
}

static VKAPI_ATTR VkResult VKAPI_CALL hosted_CreateDevice(VkPhysicalDevice physical, const VkDeviceCreateInfo *info,
                                                          const VkAllocationCallbacks *allocator, VkDevice *device)
{
    VkLayerDeviceCreateInfo *link =
        (VkLayerDeviceCreateInfo *)link_of(info->pNext, VK_STRUCTURE_TYPE_LOADER_DEVICE_CREATE_INFO);
    VkPhysicalDeviceDriverProperties driver = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DRIVER_PROPERTIES};
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &driver};
    if (!link)
        return VK_ERROR_INITIALIZATION_FAILED;
    ((PFN_vkGetPhysicalDeviceProperties2)instance_below(the_instance, "vkGetPhysicalDeviceProperties2"))(physical,
                                                                                                        &properties);
    if (driver.driverID != VK_DRIVER_ID_MESA_LLVMPIPE) {
        fprintf(stderr, "hosted layer: %s is not lavapipe, whose addresses can be read\n", driver.driverName);
        return VK_ERROR_FEATURE_NOT_PRESENT;
    }
    device_below = link->u.pLayerInfo->pfnNextGetDeviceProcAddr;
    link->u.pLayerInfo = link->u.pLayerInfo->pNext;
    /* The driver must not be asked for what it does not have. */
    VkPhysicalDeviceAccelerationStructureFeaturesKHR *structure = features_in(info->pNext), asked = {0};
    if (structure) {
        asked = *structure;
        structure->accelerationStructureHostCommands = structure->accelerationStructureIndirectBuild = VK_FALSE;
    }
    VkResult result = ((PFN_vkCreateDevice)instance_below(the_instance, "vkCreateDevice"))(physical, info, allocator, device);
    if (structure)
        *structure = asked;
    if (result != VK_SUCCESS)
        return result;
#define GET(name) below.name = (PFN_vk##name)device_below(*device, "vk" #name);
    BELOW(GET)
    const uint32_t family = info->pQueueCreateInfos[0].queueFamilyIndex;
    const VkCommandPoolCreateInfo pool_info = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                               .flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT,
                                               .queueFamilyIndex = family};
    below.GetDeviceQueue(*device, family, 0, &queue);
    result = below.CreateCommandPool(*device, &pool_info, NULL, &pool);
    const VkCommandBufferAllocateInfo buffer_info = {
        .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO, .commandPool = pool, .commandBufferCount = 1};
    return result == VK_SUCCESS ? below.AllocateCommandBuffers(*device, &buffer_info, &commands) : result;
}

static VKAPI_ATTR void VKAPI_CALL hosted_DestroyDevice(VkDevice device, const VkAllocationCallbacks *allocator)
{
    if (!device)
        return;
    below.DestroyCommandPool(device, pool, NULL);
    below.DestroyDevice(device, allocator);
}

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL device_address(VkDevice device, const char *name);
static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL instance_address(VkInstance instance, const char *name);

static PFN_vkVoidFunction find(const char *name)
{
#define ENTRY(command) {"vk" #command, (PFN_vkVoidFunction)hosted_##command},
    static const struct {
        const char *name;
        PFN_vkVoidFunction function;
    } entries[] = {
        {"vkGetDeviceProcAddr", (PFN_vkVoidFunction)device_address},
        {"vkGetInstanceProcAddr", (PFN_vkVoidFunction)instance_address},
        {"vkGetPhysicalDeviceFeatures2KHR", (PFN_vkVoidFunction)hosted_GetPhysicalDeviceFeatures2},
        ENTRY(GetPhysicalDeviceFeatures2) ENTRY(CreateInstance) ENTRY(CreateDevice) ENTRY(DestroyDevice)
        ENTRY(CreateDeferredOperationKHR) ENTRY(DestroyDeferredOperationKHR) ENTRY(DeferredOperationJoinKHR)
        ENTRY(GetDeferredOperationMaxConcurrencyKHR) ENTRY(GetDeferredOperationResultKHR)
        ENTRY(BuildAccelerationStructuresKHR) ENTRY(CopyAccelerationStructureKHR)
        ENTRY(CopyAccelerationStructureToMemoryKHR) ENTRY(CopyMemoryToAccelerationStructureKHR)
        ENTRY(WriteAccelerationStructuresPropertiesKHR) ENTRY(CreateRayTracingPipelinesKHR)
        ENTRY(CmdBuildAccelerationStructuresIndirectKHR)
    };
    for (size_t i = 0; i < sizeof entries / sizeof entries[0]; i++)
        if (strcmp(entries[i].name, name) == 0)
            return entries[i].function;
    return NULL;
}

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL device_address(VkDevice device, const char *name)
{
    const PFN_vkVoidFunction own = find(name);
    return own ? own : device_below(device, name);
}

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL instance_address(VkInstance instance, const char *name)
{
    const PFN_vkVoidFunction own = find(name);
    return own || !instance_below ? own : instance_below(instance, name);
}

__attribute__((visibility("default"))) VKAPI_ATTR VkResult VKAPI_CALL
vkNegotiateLoaderLayerInterfaceVersion(VkNegotiateLayerInterface *interface)
{
    interface->loaderLayerInterfaceVersion = 2;
    interface->pfnGetInstanceProcAddr = instance_address;
    interface->pfnGetDeviceProcAddr = device_address;
    interface->pfnGetPhysicalDeviceProcAddr = NULL;
    return VK_SUCCESS;
}
