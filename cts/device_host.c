/* SPDX-License-Identifier: Apache-2.0 */
/* Commands that run on the host, at once or deferred and joined by several threads. */
#include <pthread.h>

#include "cts/device_internal.h"

/* More threads than a deferred operation can use must do no harm. */
#define JOINING_THREADS 4
/* A thread is told to come back later this often before the operation is taken for stuck. */
#define IDLE_JOINS 10000000u

struct joining {
    struct gn_device *device;
    VkDeferredOperationKHR operation;
    VkResult result; /* of the thread's last join */
};

static void *join(void *user)
{
    struct joining *joining = user;
    uint32_t idle = 0;
    do {
        joining->result =
            joining->device->DeferredOperationJoinKHR(joining->device->handle, joining->operation);
    } while (joining->result == VK_THREAD_IDLE_KHR && ++idle < IDLE_JOINS);
    return NULL;
}

static enum gn_device_status join_all(struct gn_device *device, VkDeferredOperationKHR operation, const char *what)
{
    if (device->GetDeferredOperationResultKHR(device->handle, operation) != VK_NOT_READY) {
        return gn_device_fail(device, GN_DEVICE_FAILED, "%s was deferred, but is not pending before it is joined", what);
    }
    if (device->GetDeferredOperationMaxConcurrencyKHR(device->handle, operation) == 0) {
        return gn_device_fail(device, GN_DEVICE_FAILED, "%s is pending, but says that no thread could help", what);
    }
    struct joining joinings[JOINING_THREADS];
    pthread_t threads[JOINING_THREADS];
    bool running[JOINING_THREADS], complete = false;
    for (uint32_t i = 0; i < JOINING_THREADS; i++) {
        joinings[i] = (struct joining){.device = device, .operation = operation, .result = VK_THREAD_IDLE_KHR};
        running[i] = i > 0 && pthread_create(&threads[i], NULL, join, &joinings[i]) == 0;
    }
    join(&joinings[0]);
    for (uint32_t i = 1; i < JOINING_THREADS; i++) {
        if (running[i]) {
            pthread_join(threads[i], NULL);
        }
    }
    for (uint32_t i = 0; i < JOINING_THREADS; i++) {
        complete = complete || joinings[i].result == VK_SUCCESS;
        if (joinings[i].result < 0) {
            return gn_device_check(device, joinings[i].result, "vkDeferredOperationJoinKHR");
        }
    }
    if (!complete) {
        return gn_device_fail(device, GN_DEVICE_FAILED,
                              "%s was deferred, %d threads have joined it, and none has completed it", what,
                              JOINING_THREADS);
    }
    if (device->GetDeferredOperationMaxConcurrencyKHR(device->handle, operation) != 0) {
        return gn_device_fail(device, GN_DEVICE_FAILED, "%s is complete, but says that threads could still help", what);
    }
    return gn_device_check(device, device->GetDeferredOperationResultKHR(device->handle, operation), what);
}

/* A command that can be deferred, with the operation that it is given. */
typedef VkResult host_command(struct gn_device *device, VkDeferredOperationKHR operation, const void *arguments,
                              void *out);

static enum gn_device_status command_run(struct gn_device *device, bool deferred, host_command *command,
                                         const void *arguments, void *out, const char *what)
{
    if (!deferred) {
        return gn_device_check(device, command(device, VK_NULL_HANDLE, arguments, out), what);
    }
    VkDeferredOperationKHR operation = VK_NULL_HANDLE;
    VkResult result = device->CreateDeferredOperationKHR(device->handle, NULL, &operation);
    enum gn_device_status status = gn_device_check(device, result, "vkCreateDeferredOperationKHR");
    if (status != GN_DEVICE_OK) {
        return status;
    }
    result = command(device, operation, arguments, out);
    if (result == VK_OPERATION_DEFERRED_KHR) {
        status = join_all(device, operation, what);
    } else if (result == VK_SUCCESS) {
        device->info.unsaid_deferral = true; /* and done, it seems */
    } else if (result != VK_OPERATION_NOT_DEFERRED_KHR) {
        status = gn_device_check(device, result, what);
    }
    if (device->GetDeferredOperationResultKHR(device->handle, operation) != VK_NOT_READY) {
        device->DestroyDeferredOperationKHR(device->handle, operation, NULL);
    }
    return status;
}

static VkResult build_command(struct gn_device *device, VkDeferredOperationKHR operation, const void *arguments,
                              void *out)
{
    const struct gn_host_build *build = arguments;
    (void)out;
    return device->BuildAccelerationStructuresKHR(device->handle, operation, build->count, build->infos, build->ranges);
}

enum gn_device_status gn_host_build(struct gn_device *device, bool deferred, const struct gn_host_build *build)
{
    return command_run(device, deferred, build_command, build, NULL, "vkBuildAccelerationStructuresKHR");
}

#define COPY_COMMAND(name, vulkan)                                                                           \
    static VkResult name##_command(struct gn_device *device, VkDeferredOperationKHR operation,               \
                                   const void *arguments, void *out)                                         \
    {                                                                                                        \
        (void)out;                                                                                           \
        return device->vulkan(device->handle, operation, arguments);                                         \
    }
COPY_COMMAND(copy, CopyAccelerationStructureKHR)
COPY_COMMAND(serialize, CopyAccelerationStructureToMemoryKHR)
COPY_COMMAND(deserialize, CopyMemoryToAccelerationStructureKHR)

enum gn_device_status gn_host_copy(struct gn_device *device, bool deferred, const VkCopyAccelerationStructureInfoKHR *copy)
{
    return command_run(device, deferred, copy_command, copy, NULL, "vkCopyAccelerationStructureKHR");
}

enum gn_device_status gn_host_serialize(struct gn_device *device, bool deferred,
                                        const VkCopyAccelerationStructureToMemoryInfoKHR *copy)
{
    return command_run(device, deferred, serialize_command, copy, NULL, "vkCopyAccelerationStructureToMemoryKHR");
}

enum gn_device_status gn_host_deserialize(struct gn_device *device, bool deferred,
                                          const VkCopyMemoryToAccelerationStructureInfoKHR *copy)
{
    return command_run(device, deferred, deserialize_command, copy, NULL, "vkCopyMemoryToAccelerationStructureKHR");
}

static VkResult pipeline_command(struct gn_device *device, VkDeferredOperationKHR operation, const void *arguments,
                                 void *out)
{
    return device->CreateRayTracingPipelinesKHR(device->handle, operation, VK_NULL_HANDLE, 1, arguments, NULL, out);
}

enum gn_device_status gn_host_pipeline(struct gn_device *device, const VkRayTracingPipelineCreateInfoKHR *info,
                                       VkPipeline *out_pipeline)
{
    return command_run(device, true, pipeline_command, info, out_pipeline, "vkCreateRayTracingPipelinesKHR");
}
