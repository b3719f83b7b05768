/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A driver's library in front of another: the same driver with a fault planted, or slower. To the gate, whose processes
 * share one environment, it is a driver of its own, so that only the new one is changed.
 *   GNOMON_SHIM_DRIVER  the library of the driver behind it
 *   GNOMON_SHIM_FAULT   becomes GNOMON_FAULT, for the layer of tests/faulty, which looks after drivers have been loaded
 *   GNOMON_SHIM_CRASH   "compaction": the process aborts where a structure is compacted
 *   GNOMON_SHIM_SLOW    submissions and making pipelines take so many times as long as they do: 1.5
 */
#include <dlfcn.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <vulkan/vk_icd.h>
#include <vulkan/vulkan_core.h>

#define EXPORT __attribute__((visibility("default")))

static struct {
    PFN_vkNegotiateLoaderICDInterfaceVersion negotiate;
    PFN_vkGetInstanceProcAddr instance_address, physical_address;
    PFN_vkGetDeviceProcAddr device_address;
    PFN_vkCmdCopyAccelerationStructureKHR CmdCopyAccelerationStructureKHR;
    PFN_vkQueueSubmit QueueSubmit;
    PFN_vkQueueWaitIdle QueueWaitIdle;
    PFN_vkCreateComputePipelines CreateComputePipelines;
    PFN_vkCreateRayTracingPipelinesKHR CreateRayTracingPipelinesKHR;
} next;
static double factor = 1;
static bool crash;

__attribute__((constructor)) static void load(void)
{
    const char *driver = getenv("GNOMON_SHIM_DRIVER"), *fault = getenv("GNOMON_SHIM_FAULT"), *slow = getenv("GNOMON_SHIM_SLOW"),
               *crashing = getenv("GNOMON_SHIM_CRASH");
    void *library = driver ? dlopen(driver, RTLD_NOW | RTLD_LOCAL) : NULL;
    if (!library) {
        fprintf(stderr, "shim: GNOMON_SHIM_DRIVER: %s\n", driver ? dlerror() : "expected a driver's library");
        return;
    }
    *(void **)&next.negotiate = dlsym(library, "vk_icdNegotiateLoaderICDInterfaceVersion");
    *(void **)&next.instance_address = dlsym(library, "vk_icdGetInstanceProcAddr");
    *(void **)&next.physical_address = dlsym(library, "vk_icdGetPhysicalDeviceProcAddr");
    if (fault)
        setenv("GNOMON_FAULT", fault, 1);
    crash = crashing && strcmp(crashing, "compaction") == 0;
    if (slow)
        factor = strtod(slow, NULL);
}

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

/* Busy until what has taken since `begin` has taken `factor` times as long. */
static void linger(double begin)
{
    double end = begin + factor * (now() - begin);
    while (now() < end) {
    }
}

static VKAPI_ATTR VkResult VKAPI_CALL slow_QueueSubmit(VkQueue queue, uint32_t count, const VkSubmitInfo *submits, VkFence fence)
{
    double begin = now();
    VkResult result = next.QueueSubmit(queue, count, submits, fence);
    if (result == VK_SUCCESS)
        next.QueueWaitIdle(queue);
    linger(begin);
    return result;
}

static VKAPI_ATTR VkResult VKAPI_CALL slow_CreateComputePipelines(VkDevice device, VkPipelineCache cache, uint32_t count,
                                                                  const VkComputePipelineCreateInfo *infos,
                                                                  const VkAllocationCallbacks *allocator, VkPipeline *out)
{
    double begin = now();
    VkResult result = next.CreateComputePipelines(device, cache, count, infos, allocator, out);
    linger(begin);
    return result;
}

static VKAPI_ATTR VkResult VKAPI_CALL slow_CreateRayTracingPipelinesKHR(VkDevice device, VkDeferredOperationKHR operation,
                                                                        VkPipelineCache cache, uint32_t count,
                                                                        const VkRayTracingPipelineCreateInfoKHR *infos,
                                                                        const VkAllocationCallbacks *allocator, VkPipeline *out)
{
    double begin = now();
    VkResult result = next.CreateRayTracingPipelinesKHR(device, operation, cache, count, infos, allocator, out);
    linger(begin);
    return result;
}

static VKAPI_ATTR void VKAPI_CALL crash_CmdCopyAccelerationStructureKHR(VkCommandBuffer commands,
                                                                        const VkCopyAccelerationStructureInfoKHR *info)
{
    if (info->mode == VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR)
        abort();
    next.CmdCopyAccelerationStructureKHR(commands, info);
}

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL device_address(VkDevice device, const char *name)
{
    PFN_vkVoidFunction function = next.device_address(device, name);
    if (function && crash && strcmp(name, "vkCmdCopyAccelerationStructureKHR") == 0) {
        next.CmdCopyAccelerationStructureKHR = (PFN_vkCmdCopyAccelerationStructureKHR)function;
        return (PFN_vkVoidFunction)crash_CmdCopyAccelerationStructureKHR;
    }
    if (!function || factor == 1)
        return function;
#define SLOW(command)                                                                                        \
    if (strcmp(name, "vk" #command) == 0) {                                                                  \
        next.command = (PFN_vk##command)function;                                                            \
        return (PFN_vkVoidFunction)slow_##command;                                                           \
    }
    SLOW(QueueSubmit)
    SLOW(CreateComputePipelines)
    SLOW(CreateRayTracingPipelinesKHR)
    if (strcmp(name, "vkQueueWaitIdle") == 0)
        next.QueueWaitIdle = (PFN_vkQueueWaitIdle)function;
    return function;
}

EXPORT VKAPI_ATTR VkResult VKAPI_CALL vk_icdNegotiateLoaderICDInterfaceVersion(uint32_t *version)
{
    return next.negotiate ? next.negotiate(version) : VK_ERROR_INCOMPATIBLE_DRIVER;
}

EXPORT VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL vk_icdGetInstanceProcAddr(VkInstance instance, const char *name)
{
    PFN_vkVoidFunction function = next.instance_address ? next.instance_address(instance, name) : NULL;
    if (!function || strcmp(name, "vkGetDeviceProcAddr") != 0)
        return function;
    next.device_address = (PFN_vkGetDeviceProcAddr)function;
    return (PFN_vkVoidFunction)device_address;
}

EXPORT VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL vk_icdGetPhysicalDeviceProcAddr(VkInstance instance, const char *name)
{
    return next.physical_address ? next.physical_address(instance, name) : NULL;
}
