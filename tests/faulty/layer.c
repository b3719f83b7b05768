/* SPDX-License-Identifier: Apache-2.0 */
/* The layer's entry points: each asks the chosen fault, then the driver. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <vulkan/vk_layer.h>

#include "tests/faulty/faulty.h"

#define EXPORT __attribute__((visibility("default")))

static VkInstance the_instance;
static PFN_vkGetInstanceProcAddr next_instance_address;
static PFN_vkGetDeviceProcAddr next_device_address;
static VkDevice the_device;

/* Every command of the device that is called or intercepted. */
#define COMMANDS(X)                                                                                          \
    X(CreateShaderModule)                                                                                    \
    X(CreateAccelerationStructureKHR)                                                                        \
    X(DestroyAccelerationStructureKHR)                                                                       \
    X(GetAccelerationStructureBuildSizesKHR)                                                                 \
    X(CmdBuildAccelerationStructuresKHR)                                                                     \
    X(CmdCopyAccelerationStructureKHR)                                                                       \
    X(CmdCopyAccelerationStructureToMemoryKHR)                                                               \
    X(CmdCopyMemoryToAccelerationStructureKHR)                                                               \
    X(CreateRayTracingPipelinesKHR)                                                                          \
    X(GetRayTracingShaderGroupHandlesKHR)                                                                    \
    X(CmdTraceRaysKHR)                                                                                       \
    X(CmdTraceRaysIndirectKHR)                                                                               \
    X(CmdTraceRaysIndirect2KHR)                                                                              \
    X(CreateQueryPool)                                                                                       \
    X(GetQueryPoolResults)                                                                                   \
    X(QueueSubmit)                                                                                           \
    X(DestroyDevice)
#define CALLED_ONLY(X)                                                                                       \
    X(QueueWaitIdle)                                                                                         \
    X(GetAccelerationStructureDeviceAddressKHR)
#define MEMBER(name) PFN_vk##name name;
static struct {
    COMMANDS(MEMBER)
    CALLED_ONLY(MEMBER)
} next;

static struct gn_fault_structure *structures;

/* What has to wait for the submission: private data to be freed, and changes to what was copied. */
struct pending {
    struct pending *next;
    void *memory;
    struct gn_fault_structure *from, *to;
    VkCopyAccelerationStructureModeKHR mode;
    uint8_t *serialized;
    bool first; /* `to` was built for the first time */
};
static struct pending *pendings;

static struct pending *pending_new(void)
{
    struct pending *pending = calloc(1, sizeof *pending);
    if (!pending)
        abort();
    pending->next = pendings;
    pendings = pending;
    return pending;
}

void *gn_fault_memory(size_t size)
{
    struct pending *pending = pending_new();
    size = (size + 64) & ~(size_t)63;
    pending->memory = aligned_alloc(64, size);
    if (!pending->memory)
        abort();
    memset(pending->memory, 0, size);
    return pending->memory;
}

struct gn_fault_structure *gn_fault_structure_find(VkAccelerationStructureKHR handle)
{
    for (struct gn_fault_structure *structure = structures; structure; structure = structure->next)
        if (structure->handle == handle)
            return structure;
    return NULL;
}

static uint8_t *bytes_of(struct gn_fault_structure *structure)
{
    const VkAccelerationStructureDeviceAddressInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_DEVICE_ADDRESS_INFO_KHR,
        .accelerationStructure = structure->handle,
    };
    if (!structure->bytes)
        structure->bytes =
            (uint8_t *)(uintptr_t)next.GetAccelerationStructureDeviceAddressKHR(the_device, &info);
    return structure->bytes;
}

/* In the order in which it was recorded, once it has run. */
static void pendings_settle(void)
{
    const struct gn_fault *fault = gn_fault_chosen();
    struct pending *ordered = NULL;
    while (pendings) {
        struct pending *pending = pendings;
        pendings = pending->next;
        pending->next = ordered;
        ordered = pending;
    }
    while (ordered) {
        struct pending *pending = ordered;
        ordered = pending->next;
        if (pending->first && !pending->to->first && (pending->to->first = malloc(pending->to->size)))
            memcpy(pending->to->first, bytes_of(pending->to), pending->to->size);
        else if (pending->from && fault && fault->copied) {
            bytes_of(pending->to);
            fault->copied(pending->from, pending->to, pending->mode);
        }
        if (pending->serialized && fault && fault->serialized)
            fault->serialized(pending->serialized);
        free(pending->memory);
        free(pending);
    }
}

static VKAPI_ATTR VkResult VKAPI_CALL entry_QueueSubmit(VkQueue queue, uint32_t count, const VkSubmitInfo *submits,
                                                        VkFence fence)
{
    VkResult result = next.QueueSubmit(queue, count, submits, fence);
    if (result == VK_SUCCESS && pendings) {
        result = next.QueueWaitIdle(queue);
        pendings_settle();
    }
    return result;
}

static VKAPI_ATTR VkResult VKAPI_CALL entry_CreateShaderModule(VkDevice device, const VkShaderModuleCreateInfo *info,
                                                               const VkAllocationCallbacks *allocator,
                                                               VkShaderModule *module)
{
    const struct gn_fault *fault = gn_fault_chosen();
    VkShaderModuleCreateInfo changed = *info;
    size_t count = 0;
    uint32_t *words = fault && fault->edits[0].change
                          ? gn_fault_shader(fault->edits, info->pCode, info->codeSize / 4, &count)
                          : NULL;
    if (words) {
        changed.pCode = words;
        changed.codeSize = 4 * count;
    }
    VkResult result = next.CreateShaderModule(device, &changed, allocator, module);
    free(words);
    return result;
}

static VKAPI_ATTR VkResult VKAPI_CALL entry_CreateAccelerationStructureKHR(
    VkDevice device, const VkAccelerationStructureCreateInfoKHR *info, const VkAllocationCallbacks *allocator,
    VkAccelerationStructureKHR *handle)
{
    VkResult result = next.CreateAccelerationStructureKHR(device, info, allocator, handle);
    struct gn_fault_structure *structure = result == VK_SUCCESS ? calloc(1, sizeof *structure) : NULL;
    if (structure) {
        structure->handle = *handle;
        structure->size = info->size;
        structure->low[0] = 1;
        structure->next = structures;
        structures = structure;
    }
    return result;
}

static VKAPI_ATTR void VKAPI_CALL entry_DestroyAccelerationStructureKHR(VkDevice device, VkAccelerationStructureKHR handle,
                                                                        const VkAllocationCallbacks *allocator)
{
    for (struct gn_fault_structure **at = &structures; handle && *at; at = &(*at)->next)
        if ((*at)->handle == handle) {
            struct gn_fault_structure *structure = *at;
            *at = structure->next;
            free(structure->first);
            free(structure->instances);
            free(structure);
            break;
        }
    next.DestroyAccelerationStructureKHR(device, handle, allocator);
}

static VKAPI_ATTR void VKAPI_CALL entry_GetAccelerationStructureBuildSizesKHR(
    VkDevice device, VkAccelerationStructureBuildTypeKHR type, const VkAccelerationStructureBuildGeometryInfoKHR *info,
    const uint32_t *counts, VkAccelerationStructureBuildSizesInfoKHR *sizes)
{
    const struct gn_fault *fault = gn_fault_chosen();
    next.GetAccelerationStructureBuildSizesKHR(device, type, info, counts, sizes);
    if (fault && fault->sizes)
        fault->sizes(info, sizes);
}

static VKAPI_ATTR void VKAPI_CALL entry_CmdBuildAccelerationStructuresKHR(
    VkCommandBuffer commands, uint32_t count, const VkAccelerationStructureBuildGeometryInfoKHR *infos,
    const VkAccelerationStructureBuildRangeInfoKHR *const *ranges)
{
    VkAccelerationStructureBuildGeometryInfoKHR *told = gn_fault_memory(count * sizeof *told);
    const VkAccelerationStructureBuildRangeInfoKHR **told_ranges = gn_fault_memory(count * sizeof *told_ranges);
    uint32_t told_count = 0;
    for (uint32_t i = 0; i < count; i++) {
        struct gn_fault_build build;
        gn_fault_build_make(&infos[i], ranges[i], &build);
        if (build.clone) {
            const VkCopyAccelerationStructureInfoKHR copy = {
                .sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                .src = build.info.srcAccelerationStructure,
                .dst = build.info.dstAccelerationStructure,
                .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR,
            };
            next.CmdCopyAccelerationStructureKHR(commands, &copy);
        } else if (!build.skip) {
            told[told_count] = build.info;
            told_ranges[told_count++] = build.ranges;
        }
        if (build.to && build.to->builds == 1 && !gn_fault_is_update(&build)) {
            struct pending *pending = pending_new();
            pending->to = build.to;
            pending->first = true;
        }
    }
    if (told_count)
        next.CmdBuildAccelerationStructuresKHR(commands, told_count, told, told_ranges);
}

static VKAPI_ATTR void VKAPI_CALL entry_CmdCopyAccelerationStructureKHR(VkCommandBuffer commands,
                                                                        const VkCopyAccelerationStructureInfoKHR *info)
{
    struct gn_fault_structure *from = gn_fault_structure_find(info->src), *to = gn_fault_structure_find(info->dst);
    next.CmdCopyAccelerationStructureKHR(commands, info);
    if (from && to) {
        struct pending *pending = pending_new();
        pending->from = from;
        pending->to = to;
        pending->mode = info->mode;
    }
}

static VKAPI_ATTR void VKAPI_CALL entry_CmdCopyAccelerationStructureToMemoryKHR(
    VkCommandBuffer commands, const VkCopyAccelerationStructureToMemoryInfoKHR *info)
{
    next.CmdCopyAccelerationStructureToMemoryKHR(commands, info);
    pending_new()->serialized = (uint8_t *)(uintptr_t)info->dst.deviceAddress;
}

static VKAPI_ATTR void VKAPI_CALL entry_CmdCopyMemoryToAccelerationStructureKHR(
    VkCommandBuffer commands, const VkCopyMemoryToAccelerationStructureInfoKHR *info)
{
    const struct gn_fault *fault = gn_fault_chosen();
    if (fault && fault->deserialize)
        fault->deserialize((uint8_t *)(uintptr_t)info->src.deviceAddress);
    next.CmdCopyMemoryToAccelerationStructureKHR(commands, info);
}

static VKAPI_ATTR VkResult VKAPI_CALL entry_CreateRayTracingPipelinesKHR(
    VkDevice device, VkDeferredOperationKHR operation, VkPipelineCache cache, uint32_t count,
    const VkRayTracingPipelineCreateInfoKHR *infos, const VkAllocationCallbacks *allocator, VkPipeline *handles)
{
    const struct gn_fault *fault = gn_fault_chosen();
    /* What a deferred operation reads has to stay, and what it gives comes later. */
    if (operation)
        return next.CreateRayTracingPipelinesKHR(device, operation, cache, count, infos, allocator, handles);
    VkRayTracingPipelineCreateInfoKHR *told = malloc((count + 1) * sizeof *told);
    VkRayTracingShaderGroupCreateInfoKHR **groups = calloc(count + 1, sizeof *groups);
    if (!told || !groups)
        abort();
    for (uint32_t i = 0; i < count; i++) {
        told[i] = infos[i];
        if (fault && fault->group && infos[i].groupCount)
            told[i].pGroups = groups[i] = gn_fault_groups(fault, &infos[i]);
    }
    VkResult result = next.CreateRayTracingPipelinesKHR(device, operation, cache, count, told, allocator, handles);
    for (uint32_t i = 0; i < count; i++) {
        if (handles[i])
            gn_fault_pipeline_remember(handles[i], &infos[i]);
        free(groups[i]);
    }
    free(groups);
    free(told);
    return result;
}

static VKAPI_ATTR VkResult VKAPI_CALL entry_GetRayTracingShaderGroupHandlesKHR(VkDevice device, VkPipeline pipeline,
                                                                               uint32_t first, uint32_t count,
                                                                               size_t size, void *handles)
{
    const struct gn_fault *fault = gn_fault_chosen();
    VkResult result = next.GetRayTracingShaderGroupHandlesKHR(device, pipeline, first, count, size, handles);
    if (result == VK_SUCCESS && fault && fault->handles && first == 0 && count)
        fault->handles(gn_fault_pipeline_linked(pipeline), count, size / count, handles);
    return result;
}

static void trace_directly(VkCommandBuffer commands, const struct gn_fault_trace *trace)
{
    next.CmdTraceRaysKHR(commands, &trace->raygen, &trace->miss, &trace->hit, &trace->callable, trace->size[0],
                         trace->size[1], trace->size[2]);
}

static VKAPI_ATTR void VKAPI_CALL entry_CmdTraceRaysKHR(VkCommandBuffer commands,
                                                        const VkStridedDeviceAddressRegionKHR *raygen,
                                                        const VkStridedDeviceAddressRegionKHR *miss,
                                                        const VkStridedDeviceAddressRegionKHR *hit,
                                                        const VkStridedDeviceAddressRegionKHR *callable, uint32_t width,
                                                        uint32_t height, uint32_t depth)
{
    const struct gn_fault *fault = gn_fault_chosen();
    struct gn_fault_trace trace = {*raygen, *miss, *hit, *callable, {width, height, depth}, false};
    if (fault && fault->trace)
        fault->trace(&trace);
    trace_directly(commands, &trace);
}

static VKAPI_ATTR void VKAPI_CALL entry_CmdTraceRaysIndirectKHR(VkCommandBuffer commands,
                                                                const VkStridedDeviceAddressRegionKHR *raygen,
                                                                const VkStridedDeviceAddressRegionKHR *miss,
                                                                const VkStridedDeviceAddressRegionKHR *hit,
                                                                const VkStridedDeviceAddressRegionKHR *callable,
                                                                VkDeviceAddress address)
{
    const struct gn_fault *fault = gn_fault_chosen();
    struct gn_fault_trace trace = {*raygen, *miss, *hit, *callable, {0}, true};
    if (!fault || !fault->trace) {
        next.CmdTraceRaysIndirectKHR(commands, raygen, miss, hit, callable, address);
        return;
    }
    gn_fault_indirect_read(address, &trace);
    fault->trace(&trace);
    trace_directly(commands, &trace);
}

static VKAPI_ATTR void VKAPI_CALL entry_CmdTraceRaysIndirect2KHR(VkCommandBuffer commands, VkDeviceAddress address)
{
    const struct gn_fault *fault = gn_fault_chosen();
    struct gn_fault_trace trace;
    if (!fault || !fault->trace) {
        next.CmdTraceRaysIndirect2KHR(commands, address);
        return;
    }
    gn_fault_indirect2_read(address, &trace);
    fault->trace(&trace);
    trace_directly(commands, &trace);
}

/* Results do not say of which type they are. */
enum { MOST_POOLS = 256 };
static struct {
    VkQueryPool pool;
    VkQueryType type;
} pools[MOST_POOLS];
static uint32_t pool_count;

static VKAPI_ATTR VkResult VKAPI_CALL entry_CreateQueryPool(VkDevice device, const VkQueryPoolCreateInfo *info,
                                                            const VkAllocationCallbacks *allocator, VkQueryPool *pool)
{
    VkResult result = next.CreateQueryPool(device, info, allocator, pool);
    if (result == VK_SUCCESS) {
        pools[pool_count % MOST_POOLS].pool = *pool;
        pools[pool_count++ % MOST_POOLS].type = info->queryType;
    }
    return result;
}

static VKAPI_ATTR VkResult VKAPI_CALL entry_GetQueryPoolResults(VkDevice device, VkQueryPool pool, uint32_t first,
                                                                uint32_t count, size_t size, void *data,
                                                                VkDeviceSize stride, VkQueryResultFlags flags)
{
    const struct gn_fault *fault = gn_fault_chosen();
    VkResult result = next.GetQueryPoolResults(device, pool, first, count, size, data, stride, flags);
    if (result != VK_SUCCESS || !fault || !fault->query || !(flags & VK_QUERY_RESULT_64_BIT))
        return result;
    /* The newest pool of this handle. */
    for (uint32_t i = pool_count; i > 0 && i + MOST_POOLS > pool_count; i--)
        if (pools[(i - 1) % MOST_POOLS].pool == pool) {
            for (uint32_t q = 0; q < count; q++) {
                uint64_t value;
                memcpy(&value, (uint8_t *)data + q * stride, sizeof value);
                fault->query(pools[(i - 1) % MOST_POOLS].type, &value);
                memcpy((uint8_t *)data + q * stride, &value, sizeof value);
            }
            break;
        }
    return result;
}

static VKAPI_ATTR void VKAPI_CALL entry_DestroyDevice(VkDevice device, const VkAllocationCallbacks *allocator)
{
    pendings_settle();
    the_device = VK_NULL_HANDLE;
    if (device)
        next.DestroyDevice(device, allocator);
}

static VKAPI_ATTR void VKAPI_CALL entry_GetPhysicalDeviceProperties2(VkPhysicalDevice device,
                                                                     VkPhysicalDeviceProperties2 *properties)
{
    const struct gn_fault *fault = gn_fault_chosen();
    PFN_vkGetPhysicalDeviceProperties2 get = (PFN_vkGetPhysicalDeviceProperties2)next_instance_address(
        the_instance, "vkGetPhysicalDeviceProperties2");
    get(device, properties);
    for (VkBaseOutStructure *out = properties->pNext; out; out = out->pNext) {
        if (out->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_PROPERTIES_KHR && fault &&
            fault->pipeline_limits)
            fault->pipeline_limits((VkPhysicalDeviceRayTracingPipelinePropertiesKHR *)out);
        if (out->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_PROPERTIES_KHR) {
            VkPhysicalDeviceAccelerationStructurePropertiesKHR *limits =
                (VkPhysicalDeviceAccelerationStructurePropertiesKHR *)out;
            /* lavapipe 25.0 reports less than is required, which would hide a fault of it. */
            limits->maxPrimitiveCount = (1u << 29) - 1;
            if (fault && fault->limits)
                fault->limits(limits);
        }
    }
}

static VKAPI_ATTR VkResult VKAPI_CALL entry_CreateInstance(const VkInstanceCreateInfo *info,
                                                           const VkAllocationCallbacks *allocator, VkInstance *instance)
{
    VkLayerInstanceCreateInfo *link = (VkLayerInstanceCreateInfo *)info->pNext;
    while (link && !(link->sType == VK_STRUCTURE_TYPE_LOADER_INSTANCE_CREATE_INFO && link->function == VK_LAYER_LINK_INFO))
        link = (VkLayerInstanceCreateInfo *)link->pNext;
    const char *name = getenv("GNOMON_FAULT");
    if (name && *name && !gn_fault_chosen()) {
        fprintf(stderr, "faulty driver: there is no fault named '%s'\n", name);
        return VK_ERROR_INITIALIZATION_FAILED;
    }
    if (!link)
        return VK_ERROR_INITIALIZATION_FAILED;
    next_instance_address = link->u.pLayerInfo->pfnNextGetInstanceProcAddr;
    link->u.pLayerInfo = link->u.pLayerInfo->pNext;
    PFN_vkCreateInstance create = (PFN_vkCreateInstance)next_instance_address(VK_NULL_HANDLE, "vkCreateInstance");
    VkResult result = create(info, allocator, instance);
    if (result == VK_SUCCESS)
        the_instance = *instance;
    return result;
}

static VKAPI_ATTR VkResult VKAPI_CALL entry_CreateDevice(VkPhysicalDevice physical, const VkDeviceCreateInfo *info,
                                                         const VkAllocationCallbacks *allocator, VkDevice *device)
{
    VkLayerDeviceCreateInfo *link = (VkLayerDeviceCreateInfo *)info->pNext;
    while (link && !(link->sType == VK_STRUCTURE_TYPE_LOADER_DEVICE_CREATE_INFO && link->function == VK_LAYER_LINK_INFO))
        link = (VkLayerDeviceCreateInfo *)link->pNext;
    if (!link)
        return VK_ERROR_INITIALIZATION_FAILED;
    VkPhysicalDeviceDriverProperties driver = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DRIVER_PROPERTIES};
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &driver};
    PFN_vkGetInstanceProcAddr instance_address = link->u.pLayerInfo->pfnNextGetInstanceProcAddr;
    PFN_vkGetPhysicalDeviceProperties2 get =
        (PFN_vkGetPhysicalDeviceProperties2)instance_address(the_instance, "vkGetPhysicalDeviceProperties2");
    get(physical, &properties);
    if (driver.driverID != VK_DRIVER_ID_MESA_LLVMPIPE) {
        fprintf(stderr, "faulty driver: %s is not lavapipe, whose addresses can be read\n", driver.driverName);
        return VK_ERROR_FEATURE_NOT_PRESENT;
    }
    next_device_address = link->u.pLayerInfo->pfnNextGetDeviceProcAddr;
    link->u.pLayerInfo = link->u.pLayerInfo->pNext;
    PFN_vkCreateDevice create = (PFN_vkCreateDevice)instance_address(the_instance, "vkCreateDevice");
    VkResult result = create(physical, info, allocator, device);
    if (result != VK_SUCCESS)
        return result;
    the_device = *device;
#define GET(name) next.name = (PFN_vk##name)next_device_address(*device, "vk" #name);
    COMMANDS(GET)
    CALLED_ONLY(GET)
    return VK_SUCCESS;
}

static PFN_vkVoidFunction find(const char *name)
{
#define ENTRY(command)                                                                                       \
    if (strcmp(name, "vk" #command) == 0)                                                                    \
        return (PFN_vkVoidFunction)entry_##command;
    COMMANDS(ENTRY)
    ENTRY(CreateInstance)
    ENTRY(CreateDevice)
    ENTRY(GetPhysicalDeviceProperties2)
    return strcmp(name, "vkGetPhysicalDeviceProperties2KHR") == 0
               ? (PFN_vkVoidFunction)entry_GetPhysicalDeviceProperties2
               : NULL;
}

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL entry_GetDeviceProcAddr(VkDevice device, const char *name)
{
    if (strcmp(name, "vkGetDeviceProcAddr") == 0)
        return (PFN_vkVoidFunction)entry_GetDeviceProcAddr;
    PFN_vkVoidFunction driver = next_device_address(device, name);
    /* What the device lacks stays away. */
    return driver && find(name) ? find(name) : driver;
}

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL entry_GetInstanceProcAddr(VkInstance instance, const char *name)
{
    if (strcmp(name, "vkGetInstanceProcAddr") == 0)
        return (PFN_vkVoidFunction)entry_GetInstanceProcAddr;
    if (strcmp(name, "vkGetDeviceProcAddr") == 0)
        return (PFN_vkVoidFunction)entry_GetDeviceProcAddr;
    return find(name) ? find(name) : next_instance_address ? next_instance_address(instance, name) : NULL;
}

EXPORT VKAPI_ATTR VkResult VKAPI_CALL vkNegotiateLoaderLayerInterfaceVersion(VkNegotiateLayerInterface *interface)
{
    if (interface->loaderLayerInterfaceVersion > 2)
        interface->loaderLayerInterfaceVersion = 2;
    interface->pfnGetInstanceProcAddr = entry_GetInstanceProcAddr;
    interface->pfnGetDeviceProcAddr = entry_GetDeviceProcAddr;
    interface->pfnGetPhysicalDeviceProcAddr = NULL;
    return VK_SUCCESS;
}

EXPORT bool gn_faulty_describe(size_t index, const char **out_name, const char **out_text, const char **out_witness)
{
    const struct gn_fault *fault = gn_fault_at(index);
    if (!fault)
        return false;
    *out_name = fault->name;
    *out_text = fault->text;
    *out_witness = gn_fault_witness(fault);
    return true;
}
