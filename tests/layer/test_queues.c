/* SPDX-License-Identifier: Apache-2.0 */
/* Several queues, which no driver here has: a fake next layer stands below the real functions. One queue builds a structure, another
 * copies it; the rows differ in what orders the two. */
#include "layer/layer.h"

#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define QUEUES 3

static struct fake {
    void *table;
} fake_device, fake_queues[QUEUES], fake_commands[8];

static int table_of_device;
static uint64_t next_handle = 0x1000;
static VkResult submit_result, fence_status;
static uint64_t counter;

static VkResult new_handle(uint64_t *out)
{
    *out = next_handle++;
    return VK_SUCCESS;
}

#define FAKE_CREATE(name, Info, Handle)                                                                                \
    static VKAPI_ATTR VkResult VKAPI_CALL name(VkDevice device, const Info *info, const VkAllocationCallbacks *allocator,  \
                                               Handle *out)                                                                \
    {                                                                                                                      \
        (void)device, (void)info, (void)allocator;                                                                         \
        return new_handle((uint64_t *)out);                                                                                \
    }
#define FAKE_DESTROY(name, Handle)                                                                                     \
    static VKAPI_ATTR void VKAPI_CALL name(VkDevice device, Handle handle, const VkAllocationCallbacks *allocator)         \
    {                                                                                                                      \
        (void)device, (void)handle, (void)allocator;                                                                       \
    }

FAKE_CREATE(create_structure, VkAccelerationStructureCreateInfoKHR, VkAccelerationStructureKHR)
FAKE_CREATE(create_pool, VkCommandPoolCreateInfo, VkCommandPool)
FAKE_CREATE(create_fence, VkFenceCreateInfo, VkFence)
FAKE_CREATE(create_semaphore, VkSemaphoreCreateInfo, VkSemaphore)
FAKE_DESTROY(destroy_structure, VkAccelerationStructureKHR)
FAKE_DESTROY(destroy_fence, VkFence)
FAKE_DESTROY(destroy_semaphore, VkSemaphore)

static VKAPI_ATTR void VKAPI_CALL destroy_device(VkDevice device, const VkAllocationCallbacks *allocator)
{
    (void)device, (void)allocator;
}

static VKAPI_ATTR VkDeviceAddress VKAPI_CALL address_of(VkDevice device, const VkAccelerationStructureDeviceAddressInfoKHR *info)
{
    (void)device;
    return (uint64_t)info->accelerationStructure << 8;
}

static VKAPI_ATTR VkResult VKAPI_CALL allocate_commands(VkDevice device, const VkCommandBufferAllocateInfo *info,
                                                        VkCommandBuffer *out)
{
    (void)device;
    for (uint32_t i = 0; i < info->commandBufferCount; i++)
        out[i] = (VkCommandBuffer)(void *)&fake_commands[i];
    return VK_SUCCESS;
}

static VKAPI_ATTR void VKAPI_CALL build(VkCommandBuffer commands, uint32_t count,
                                        const VkAccelerationStructureBuildGeometryInfoKHR *infos,
                                        const VkAccelerationStructureBuildRangeInfoKHR *const *ranges)
{
    (void)commands, (void)count, (void)infos, (void)ranges;
}

static VKAPI_ATTR void VKAPI_CALL copy(VkCommandBuffer commands, const VkCopyAccelerationStructureInfoKHR *info)
{
    (void)commands, (void)info;
}

static VKAPI_ATTR void VKAPI_CALL pipeline_barrier(VkCommandBuffer commands, VkPipelineStageFlags from,
                                                   VkPipelineStageFlags to, VkDependencyFlags flags, uint32_t memory_count,
                                                   const VkMemoryBarrier *memory, uint32_t buffer_count,
                                                   const VkBufferMemoryBarrier *buffers, uint32_t image_count,
                                                   const VkImageMemoryBarrier *images)
{
    (void)commands, (void)from, (void)to, (void)flags, (void)memory_count, (void)memory;
    (void)buffer_count, (void)buffers, (void)image_count, (void)images;
}

static VKAPI_ATTR VkResult VKAPI_CALL queue_submit(VkQueue queue, uint32_t count, const VkSubmitInfo *submits, VkFence fence)
{
    (void)queue, (void)count, (void)submits, (void)fence;
    return submit_result;
}

static VKAPI_ATTR VkResult VKAPI_CALL queue_submit_2(VkQueue queue, uint32_t count, const VkSubmitInfo2 *submits, VkFence fence)
{
    (void)queue, (void)count, (void)submits, (void)fence;
    return submit_result;
}

static VKAPI_ATTR VkResult VKAPI_CALL bind_sparse(VkQueue queue, uint32_t count, const VkBindSparseInfo *infos, VkFence fence)
{
    (void)queue, (void)count, (void)infos, (void)fence;
    return submit_result;
}

static VKAPI_ATTR VkResult VKAPI_CALL present(VkQueue queue, const VkPresentInfoKHR *info)
{
    (void)queue, (void)info;
    return VK_SUCCESS;
}

static VKAPI_ATTR VkResult VKAPI_CALL get_fence_status(VkDevice device, VkFence fence)
{
    (void)device, (void)fence;
    return fence_status;
}

static VKAPI_ATTR VkResult VKAPI_CALL wait_for_fences(VkDevice device, uint32_t count, const VkFence *fences, VkBool32 all,
                                                      uint64_t timeout)
{
    (void)device, (void)count, (void)fences, (void)all, (void)timeout;
    return VK_SUCCESS;
}

static VKAPI_ATTR VkResult VKAPI_CALL reset_fences(VkDevice device, uint32_t count, const VkFence *fences)
{
    (void)device, (void)count, (void)fences;
    return VK_SUCCESS;
}

static VKAPI_ATTR VkResult VKAPI_CALL queue_idle(VkQueue queue)
{
    (void)queue;
    return VK_SUCCESS;
}

static VKAPI_ATTR VkResult VKAPI_CALL device_idle(VkDevice device)
{
    (void)device;
    return VK_SUCCESS;
}

static VKAPI_ATTR VkResult VKAPI_CALL wait_semaphores(VkDevice device, const VkSemaphoreWaitInfo *info, uint64_t timeout)
{
    (void)device, (void)info, (void)timeout;
    return VK_SUCCESS;
}

static VKAPI_ATTR VkResult VKAPI_CALL counter_value(VkDevice device, VkSemaphore semaphore, uint64_t *out)
{
    (void)device, (void)semaphore;
    *out = counter;
    return VK_SUCCESS;
}

static VKAPI_ATTR VkResult VKAPI_CALL signal_semaphore(VkDevice device, const VkSemaphoreSignalInfo *info)
{
    (void)device, (void)info;
    return VK_SUCCESS;
}

struct fixture {
    struct gn_instance instance;
    struct gn_device *device;
    VkDevice handle;
    VkCommandBuffer commands[8];
    VkSemaphore binary[2], timeline[2], external;
    VkFence fence;
    VkAccelerationStructureKHR structure, target;
};

static VkSemaphore semaphore(struct fixture *fixture, bool timeline, bool external)
{
    VkExportSemaphoreCreateInfo shared = {.sType = VK_STRUCTURE_TYPE_EXPORT_SEMAPHORE_CREATE_INFO,
                                          .handleTypes = VK_EXTERNAL_SEMAPHORE_HANDLE_TYPE_OPAQUE_FD_BIT};
    VkSemaphoreTypeCreateInfo type = {.sType = VK_STRUCTURE_TYPE_SEMAPHORE_TYPE_CREATE_INFO,
                                      .pNext = external ? &shared : NULL,
                                      .semaphoreType = timeline ? VK_SEMAPHORE_TYPE_TIMELINE : VK_SEMAPHORE_TYPE_BINARY};
    VkSemaphoreCreateInfo info = {.sType = VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO, .pNext = &type};
    VkSemaphore out;
    gn_entry_CreateSemaphore(fixture->handle, &info, NULL, &out);
    return out;
}

static VkAccelerationStructureKHR make(struct fixture *fixture)
{
    VkAccelerationStructureCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
                                                 .size = 256,
                                                 .type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR};
    VkAccelerationStructureKHR handle;
    assert_int_equal(gn_entry_CreateAccelerationStructureKHR(fixture->handle, &info, NULL, &handle), VK_SUCCESS);
    return handle;
}

static void fixture_init(struct fixture *fixture)
{
    struct gn_device *device = calloc(1, sizeof *device);
    memset(fixture, 0, sizeof *fixture);
    submit_result = VK_SUCCESS;
    fence_status = VK_NOT_READY;
    counter = 0;
    fake_device.table = &table_of_device;
    for (int i = 0; i < QUEUES; i++)
        fake_queues[i].table = &table_of_device;
    for (int i = 0; i < 8; i++)
        fake_commands[i].table = &table_of_device;
    fixture->instance.settings = (struct gn_settings){.severity_floor = GN_SEVERITY_NOTE,
                                                      .profile = GN_PROFILE_VULKAN,
                                                      .rules = gn_rule_set_all(),
                                                      .instance_cap = 1000};
    fixture->instance.judged_commands = (UINT32_C(1) << GN_COMMAND_KIND_COUNT) - 1;
    pthread_mutex_init(&fixture->instance.lock, NULL);
    fixture->device = device;
    fixture->handle = device->handle = (VkDevice)(void *)&fake_device;
    device->instance = &fixture->instance;
    device->tracked = true;
    device->next = (struct gn_device_next){.CreateAccelerationStructureKHR = create_structure,
                                           .DestroyAccelerationStructureKHR = destroy_structure,
                                           .GetAccelerationStructureDeviceAddressKHR = address_of,
                                           .CmdBuildAccelerationStructuresKHR = build,
                                           .CmdCopyAccelerationStructureKHR = copy,
                                           .CmdPipelineBarrier = pipeline_barrier,
                                           .QueueSubmit = queue_submit,
                                           .QueueSubmit2 = queue_submit_2,
                                           .QueueBindSparse = bind_sparse,
                                           .QueuePresentKHR = present,
                                           .QueueWaitIdle = queue_idle,
                                           .DeviceWaitIdle = device_idle,
                                           .GetFenceStatus = get_fence_status,
                                           .WaitForFences = wait_for_fences,
                                           .CreateFence = create_fence,
                                           .DestroyFence = destroy_fence,
                                           .ResetFences = reset_fences,
                                           .CreateSemaphore = create_semaphore,
                                           .DestroySemaphore = destroy_semaphore,
                                           .SignalSemaphore = signal_semaphore,
                                           .WaitSemaphores = wait_semaphores,
                                           .GetSemaphoreCounterValue = counter_value,
                                           .CreateCommandPool = create_pool,
                                           .AllocateCommandBuffers = allocate_commands,
                                           .DestroyDevice = destroy_device};
    pthread_mutex_init(&device->lock, NULL);
    assert_true(gn_device_register(device));
    VkCommandPoolCreateInfo pool_info = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO};
    VkCommandBufferAllocateInfo allocation = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO, .commandBufferCount = 8};
    gn_entry_CreateCommandPool(fixture->handle, &pool_info, NULL, &allocation.commandPool);
    gn_entry_AllocateCommandBuffers(fixture->handle, &allocation, fixture->commands);
    for (int i = 0; i < 2; i++) {
        fixture->binary[i] = semaphore(fixture, false, false);
        fixture->timeline[i] = semaphore(fixture, true, false);
    }
    fixture->external = semaphore(fixture, true, true);
    VkFenceCreateInfo fence = {.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    create_fence(fixture->handle, &fence, NULL, &fixture->fence);
    fixture->structure = make(fixture);
    fixture->target = make(fixture);

    /* Command buffer 0 builds, 1 copies, 2 copies after a barrier from the vertex stage, 3 compacts. */
    VkAccelerationStructureGeometryKHR geometry = {.geometryType = VK_GEOMETRY_TYPE_AABBS_KHR};
    VkAccelerationStructureBuildGeometryInfoKHR info = {.type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
                                                        .dstAccelerationStructure = fixture->structure,
                                                        .geometryCount = 1,
                                                        .pGeometries = &geometry};
    VkAccelerationStructureBuildRangeInfoKHR range = {.primitiveCount = 1};
    const VkAccelerationStructureBuildRangeInfoKHR *ranges = &range;
    VkCopyAccelerationStructureInfoKHR copied = {.src = fixture->structure, .dst = fixture->target};
    VkMemoryBarrier memory = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                              .dstAccessMask = VK_ACCESS_ACCELERATION_STRUCTURE_READ_BIT_KHR};
    gn_entry_CmdBuildAccelerationStructuresKHR(fixture->commands[0], 1, &info, &ranges);
    gn_entry_CmdCopyAccelerationStructureKHR(fixture->commands[1], &copied);
    gn_entry_CmdPipelineBarrier(fixture->commands[2], VK_PIPELINE_STAGE_VERTEX_SHADER_BIT,
                                VK_PIPELINE_STAGE_ACCELERATION_STRUCTURE_BUILD_BIT_KHR, 0, 1, &memory, 0, NULL, 0, NULL);
    gn_entry_CmdCopyAccelerationStructureKHR(fixture->commands[2], &copied);
    copied.mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR;
    gn_entry_CmdCopyAccelerationStructureKHR(fixture->commands[3], &copied);
}

static void fixture_finish(struct fixture *fixture)
{
    gn_entry_DestroyDevice(fixture->handle, NULL);
    size_t cursor = 0;
    void *site;
    while ((site = gn_map_next(&fixture->instance.sites, &cursor)))
        free(site);
    gn_map_finish(&fixture->instance.sites);
    pthread_mutex_destroy(&fixture->instance.lock);
}

/* What a submission waits for and signals. */
struct link {
    VkSemaphore semaphore;
    uint64_t value;
    VkPipelineStageFlags stages;
};

#define NONE ((struct link){0})
#define EVERY VK_PIPELINE_STAGE_ALL_COMMANDS_BIT
#define BUILD 0
#define COPY 1
#define COPY_AFTER_VERTEX 2
#define COMPACT 3
#define NOTHING (-1)

static void submit(struct fixture *fixture, int queue, int commands, struct link wait, struct link signal, VkFence fence)
{
    VkTimelineSemaphoreSubmitInfo values = {.sType = VK_STRUCTURE_TYPE_TIMELINE_SEMAPHORE_SUBMIT_INFO,
                                            .waitSemaphoreValueCount = wait.semaphore != VK_NULL_HANDLE,
                                            .pWaitSemaphoreValues = &wait.value,
                                            .signalSemaphoreValueCount = signal.semaphore != VK_NULL_HANDLE,
                                            .pSignalSemaphoreValues = &signal.value};
    VkSubmitInfo info = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO,
                         .pNext = &values,
                         .waitSemaphoreCount = wait.semaphore != VK_NULL_HANDLE,
                         .pWaitSemaphores = &wait.semaphore,
                         .pWaitDstStageMask = &wait.stages,
                         .signalSemaphoreCount = signal.semaphore != VK_NULL_HANDLE,
                         .pSignalSemaphores = &signal.semaphore,
                         .commandBufferCount = commands != NOTHING,
                         .pCommandBuffers = commands == NOTHING ? NULL : &fixture->commands[commands]};
    gn_entry_QueueSubmit((VkQueue)(void *)&fake_queues[queue], 1, &info, fence);
}

static void submit_2(struct fixture *fixture, int queue, int commands, struct link wait, struct link signal)
{
    VkSemaphoreSubmitInfo waits = {.semaphore = wait.semaphore, .value = wait.value, .stageMask = wait.stages};
    VkSemaphoreSubmitInfo signals = {.semaphore = signal.semaphore, .value = signal.value, .stageMask = EVERY};
    VkCommandBufferSubmitInfo buffers = {.commandBuffer = fixture->commands[commands]};
    VkSubmitInfo2 info = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO_2,
                          .waitSemaphoreInfoCount = wait.semaphore != VK_NULL_HANDLE,
                          .pWaitSemaphoreInfos = &waits,
                          .commandBufferInfoCount = 1,
                          .pCommandBufferInfos = &buffers,
                          .signalSemaphoreInfoCount = signal.semaphore != VK_NULL_HANDLE,
                          .pSignalSemaphoreInfos = &signals};
    gn_entry_QueueSubmit2((VkQueue)(void *)&fake_queues[queue], 1, &info, VK_NULL_HANDLE);
}

static struct link link_of(VkSemaphore semaphore, uint64_t value)
{
    return (struct link){semaphore, value, EVERY};
}

static void nothing(struct fixture *fixture)
{
    submit(fixture, 0, BUILD, NONE, NONE, VK_NULL_HANDLE);
    submit(fixture, 1, COPY, NONE, NONE, VK_NULL_HANDLE);
}

static void binary(struct fixture *fixture)
{
    submit(fixture, 0, BUILD, NONE, link_of(fixture->binary[0], 0), VK_NULL_HANDLE);
    submit(fixture, 1, COPY, link_of(fixture->binary[0], 0), NONE, VK_NULL_HANDLE);
}

static void other_binary(struct fixture *fixture)
{
    submit(fixture, 0, NOTHING, NONE, link_of(fixture->binary[1], 0), VK_NULL_HANDLE);
    submit(fixture, 0, BUILD, NONE, link_of(fixture->binary[0], 0), VK_NULL_HANDLE);
    submit(fixture, 1, COPY, link_of(fixture->binary[1], 0), NONE, VK_NULL_HANDLE);
}

static void second_form(struct fixture *fixture)
{
    submit_2(fixture, 0, BUILD, NONE, link_of(fixture->timeline[0], 1));
    submit_2(fixture, 1, COPY, link_of(fixture->timeline[0], 1), NONE);
}

static void wait_before_signal(struct fixture *fixture)
{
    submit(fixture, 1, COPY, link_of(fixture->timeline[0], 2), NONE, VK_NULL_HANDLE);
    submit(fixture, 0, BUILD, NONE, link_of(fixture->timeline[0], 2), VK_NULL_HANDLE);
}

/* The wait is for a value that is reached before the build. */
static void lower_value(struct fixture *fixture)
{
    submit(fixture, 1, COPY, link_of(fixture->timeline[0], 1), NONE, VK_NULL_HANDLE);
    submit(fixture, 0, NOTHING, NONE, link_of(fixture->timeline[0], 1), VK_NULL_HANDLE);
    submit(fixture, 0, BUILD, NONE, link_of(fixture->timeline[0], 2), VK_NULL_HANDLE);
}

static void another_stage(struct fixture *fixture)
{
    submit(fixture, 0, BUILD, NONE, link_of(fixture->binary[0], 0), VK_NULL_HANDLE);
    submit(fixture, 1, COPY, (struct link){fixture->binary[0], 0, VK_PIPELINE_STAGE_VERTEX_SHADER_BIT}, NONE, VK_NULL_HANDLE);
}

static void chained_stage(struct fixture *fixture)
{
    submit(fixture, 0, BUILD, NONE, link_of(fixture->binary[0], 0), VK_NULL_HANDLE);
    submit(fixture, 1, COPY_AFTER_VERTEX, (struct link){fixture->binary[0], 0, VK_PIPELINE_STAGE_VERTEX_SHADER_BIT}, NONE,
           VK_NULL_HANDLE);
}

static void by_a_third_queue(struct fixture *fixture)
{
    submit(fixture, 1, COPY, link_of(fixture->timeline[1], 1), NONE, VK_NULL_HANDLE);
    submit(fixture, 2, NOTHING, link_of(fixture->timeline[0], 1), link_of(fixture->timeline[1], 1), VK_NULL_HANDLE);
    submit(fixture, 0, BUILD, NONE, link_of(fixture->timeline[0], 1), VK_NULL_HANDLE);
}

static void by_sparse_binding(struct fixture *fixture)
{
    VkBindSparseInfo info = {.sType = VK_STRUCTURE_TYPE_BIND_SPARSE_INFO,
                             .waitSemaphoreCount = 1,
                             .pWaitSemaphores = &fixture->binary[0],
                             .signalSemaphoreCount = 1,
                             .pSignalSemaphores = &fixture->binary[1]};
    submit(fixture, 0, BUILD, NONE, link_of(fixture->binary[0], 0), VK_NULL_HANDLE);
    gn_entry_QueueBindSparse((VkQueue)(void *)&fake_queues[2], 1, &info, VK_NULL_HANDLE);
    submit(fixture, 1, COPY, link_of(fixture->binary[1], 0), NONE, VK_NULL_HANDLE);
}

static void by_fence(struct fixture *fixture)
{
    submit(fixture, 0, BUILD, NONE, NONE, fixture->fence);
    gn_entry_WaitForFences(fixture->handle, 1, &fixture->fence, VK_TRUE, UINT64_MAX);
    submit(fixture, 1, COPY, NONE, NONE, VK_NULL_HANDLE);
}

/* An empty submission has the fence, behind one that is held back. */
static void by_empty_submission(struct fixture *fixture)
{
    VkQueue queue = (VkQueue)(void *)&fake_queues[0];
    submit(fixture, 0, BUILD, link_of(fixture->timeline[0], 1), NONE, VK_NULL_HANDLE);
    gn_entry_QueueSubmit(queue, 0, NULL, fixture->fence);
    submit(fixture, 2, NOTHING, NONE, link_of(fixture->timeline[0], 1), VK_NULL_HANDLE);
    gn_entry_WaitForFences(fixture->handle, 1, &fixture->fence, VK_TRUE, UINT64_MAX);
    submit(fixture, 1, COPY, NONE, NONE, VK_NULL_HANDLE);
}

/* The semaphore was waited for by a presentation, and signalled again by something that is not seen. */
static void by_presentation(struct fixture *fixture)
{
    VkPresentInfoKHR info = {.waitSemaphoreCount = 1, .pWaitSemaphores = &fixture->binary[0]};
    submit(fixture, 0, NOTHING, NONE, link_of(fixture->binary[0], 0), VK_NULL_HANDLE);
    gn_entry_QueuePresentKHR((VkQueue)(void *)&fake_queues[0], &info);
    submit(fixture, 0, BUILD, NONE, NONE, VK_NULL_HANDLE);
    submit(fixture, 1, COPY, link_of(fixture->binary[0], 0), NONE, VK_NULL_HANDLE);
}

/* The fence is of what came before the build. */
static void by_earlier_fence(struct fixture *fixture)
{
    submit(fixture, 0, NOTHING, NONE, NONE, fixture->fence);
    submit(fixture, 0, BUILD, NONE, NONE, VK_NULL_HANDLE);
    gn_entry_WaitForFences(fixture->handle, 1, &fixture->fence, VK_TRUE, UINT64_MAX);
    submit(fixture, 1, COPY, NONE, NONE, VK_NULL_HANDLE);
}

static void by_queue_idle(struct fixture *fixture)
{
    submit(fixture, 0, BUILD, NONE, NONE, VK_NULL_HANDLE);
    gn_entry_QueueWaitIdle((VkQueue)(void *)&fake_queues[0]);
    submit(fixture, 1, COPY, NONE, NONE, VK_NULL_HANDLE);
}

static void by_other_queue_idle(struct fixture *fixture)
{
    submit(fixture, 0, BUILD, NONE, NONE, VK_NULL_HANDLE);
    gn_entry_QueueWaitIdle((VkQueue)(void *)&fake_queues[1]);
    submit(fixture, 1, COPY, NONE, NONE, VK_NULL_HANDLE);
}

static void by_device_idle(struct fixture *fixture)
{
    submit(fixture, 0, BUILD, NONE, NONE, VK_NULL_HANDLE);
    gn_entry_DeviceWaitIdle(fixture->handle);
    submit(fixture, 1, COPY, NONE, NONE, VK_NULL_HANDLE);
}

static void by_counter(struct fixture *fixture)
{
    uint64_t value;
    submit(fixture, 0, BUILD, NONE, link_of(fixture->timeline[0], 3), VK_NULL_HANDLE);
    counter = 3;
    gn_entry_GetSemaphoreCounterValue(fixture->handle, fixture->timeline[0], &value);
    submit(fixture, 1, COPY, NONE, NONE, VK_NULL_HANDLE);
}

static void by_host_wait(struct fixture *fixture)
{
    uint64_t value = 3;
    VkSemaphoreWaitInfo info = {.semaphoreCount = 1, .pSemaphores = &fixture->timeline[0], .pValues = &value};
    submit(fixture, 0, BUILD, NONE, link_of(fixture->timeline[0], 3), VK_NULL_HANDLE);
    gn_entry_WaitSemaphores(fixture->handle, &info, UINT64_MAX);
    submit(fixture, 1, COPY, NONE, NONE, VK_NULL_HANDLE);
}

static void host_signals(struct fixture *fixture)
{
    VkSemaphoreSignalInfo info = {.semaphore = fixture->timeline[0], .value = 1};
    gn_entry_SignalSemaphore(fixture->handle, &info);
}

/* The host passes on what it has waited for. */
static void by_host_signal(struct fixture *fixture)
{
    submit(fixture, 1, COPY, link_of(fixture->timeline[0], 1), NONE, VK_NULL_HANDLE);
    submit(fixture, 0, BUILD, NONE, NONE, fixture->fence);
    gn_entry_WaitForFences(fixture->handle, 1, &fixture->fence, VK_TRUE, UINT64_MAX);
    host_signals(fixture);
}

static void by_hasty_host_signal(struct fixture *fixture)
{
    submit(fixture, 1, COPY, link_of(fixture->timeline[0], 1), NONE, VK_NULL_HANDLE);
    submit(fixture, 0, BUILD, NONE, NONE, fixture->fence);
    host_signals(fixture);
}

static void by_external(struct fixture *fixture)
{
    submit(fixture, 0, BUILD, NONE, link_of(fixture->external, 1), VK_NULL_HANDLE);
    submit(fixture, 1, COPY, link_of(fixture->external, 1), NONE, VK_NULL_HANDLE);
}

/* It completes, although nothing that was seen signals what it waits for. */
static void by_something_unseen(struct fixture *fixture)
{
    submit(fixture, 1, COPY, link_of(fixture->timeline[0], 1), NONE, VK_NULL_HANDLE);
    submit(fixture, 0, BUILD, NONE, NONE, VK_NULL_HANDLE);
    fence_status = VK_SUCCESS;
    gn_device_collect(fixture->device);
    assert_null(fixture->device->first_queue->held);
}

static void held_for_ever(struct fixture *fixture)
{
    submit(fixture, 1, COPY, link_of(fixture->timeline[0], 1), NONE, VK_NULL_HANDLE);
    submit(fixture, 1, COPY, NONE, NONE, VK_NULL_HANDLE);
}

static void refused(struct fixture *fixture)
{
    submit_result = VK_ERROR_OUT_OF_DEVICE_MEMORY;
    submit(fixture, 1, COPY, link_of(fixture->timeline[0], 1), NONE, VK_NULL_HANDLE);
    submit_result = VK_SUCCESS;
    submit(fixture, 0, BUILD, NONE, link_of(fixture->timeline[0], 1), VK_NULL_HANDLE);
}

/* Many values: the oldest are forgotten together. */
static void many_values(struct fixture *fixture)
{
    submit(fixture, 0, BUILD, NONE, link_of(fixture->timeline[0], 1), VK_NULL_HANDLE);
    for (uint64_t value = 2; value < 300; value++)
        submit(fixture, 0, NOTHING, NONE, link_of(fixture->timeline[0], value), VK_NULL_HANDLE);
    submit(fixture, 1, COPY, link_of(fixture->timeline[0], 1), NONE, VK_NULL_HANDLE);
}

static const struct {
    const char *name;
    void (*run)(struct fixture *fixture);
    unsigned findings, unknown;
    bool unfinished; /* when the device is destroyed */
} rows[] = {
    {"nothing", nothing, 1, 0, false},
    {"binary semaphore", binary, 0, 0, false},
    {"another binary semaphore", other_binary, 1, 0, false},
    {"timeline, vkQueueSubmit2", second_form, 0, 0, false},
    {"wait before signal", wait_before_signal, 0, 0, false},
    {"wait for a value before the build", lower_value, 1, 0, false},
    {"wait in another stage", another_stage, 1, 0, false},
    {"wait in another stage, and a barrier", chained_stage, 0, 0, false},
    {"by way of a third queue, in reverse order", by_a_third_queue, 0, 0, false},
    {"by way of sparse binding", by_sparse_binding, 0, 0, false},
    {"fence", by_fence, 0, 0, false},
    {"fence of an empty submission", by_empty_submission, 0, 0, false},
    {"presentation", by_presentation, 0, 0, false},
    {"fence of something earlier", by_earlier_fence, 1, 0, false},
    {"vkQueueWaitIdle", by_queue_idle, 0, 0, false},
    {"vkQueueWaitIdle of the other queue", by_other_queue_idle, 1, 0, false},
    {"vkDeviceWaitIdle", by_device_idle, 0, 0, false},
    {"counter seen", by_counter, 0, 0, false},
    {"counter waited for", by_host_wait, 0, 0, false},
    {"signalled by the host after a wait", by_host_signal, 0, 0, false},
    {"signalled by the host without one", by_hasty_host_signal, 1, 0, false},
    {"external semaphore", by_external, 0, 1, false},
    {"signalled by something unseen", by_something_unseen, 0, 2, false},
    {"never signalled", held_for_ever, 0, 0, true},
    {"refused", refused, 0, 0, false},
    {"many values", many_values, 0, 0, false},
};

static void every_row(void **state)
{
    (void)state;
    int failures = 0;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct fixture *fixture = calloc(1, sizeof *fixture);
        fixture_init(fixture);
        for (size_t r = 0; r < gn_rules_count(); r++)
            if (!gn_rule_matches(gn_rules_at(r), "sync.*"))
                gn_rule_set_put(&fixture->instance.settings.rules, r, false);
        rows[i].run(fixture);
        fence_status = rows[i].unfinished ? VK_NOT_READY : VK_SUCCESS;
        gn_device_collect(fixture->device);
        unsigned long long unknown = atomic_load(&fixture->instance.tally.unjudged[GN_UNJUDGED_unknown_semaphores]);
        if (fixture->instance.findings != rows[i].findings || unknown != rows[i].unknown) {
            print_error("%s: expected %u findings and %u unknown, found %llu and %llu\n", rows[i].name, rows[i].findings,
                        rows[i].unknown, fixture->instance.findings, unknown);
            failures++;
        }
        fixture_finish(fixture);
        free(fixture);
    }
    assert_int_equal(failures, 0);
}

/* What was built without ALLOW_COMPACTION on another queue is known to be, if that comes before. */
static void state_passes_between_queues(void **state)
{
    (void)state;
    for (unsigned ordered = 0; ordered < 2; ordered++) {
        struct fixture *fixture = calloc(1, sizeof *fixture);
        fixture_init(fixture);
        for (size_t r = 0; r < gn_rules_count(); r++)
            if (!gn_rule_matches(gn_rules_at(r), "compaction.not_allowed"))
                gn_rule_set_put(&fixture->instance.settings.rules, r, false);
        submit(fixture, 1, COMPACT, ordered ? link_of(fixture->timeline[0], 1) : NONE, NONE, VK_NULL_HANDLE);
        submit(fixture, 0, BUILD, NONE, link_of(fixture->timeline[0], 1), VK_NULL_HANDLE);
        fence_status = VK_SUCCESS;
        gn_device_collect(fixture->device);
        assert_int_equal(fixture->instance.findings, ordered);
        fixture_finish(fixture);
        free(fixture);
    }
}

/* What needs no proof from the device is there before the device is lost. */
static void told_before_the_device_is_lost(void **state)
{
    (void)state;
    struct fixture *fixture = calloc(1, sizeof *fixture);
    fixture_init(fixture);
    submit(fixture, 0, BUILD, NONE, NONE, VK_NULL_HANDLE);
    assert_int_equal(fixture->instance.findings, 0);
    submit(fixture, 0, COPY, NONE, NONE, VK_NULL_HANDLE);
    assert_int_equal(fixture->instance.findings, 1);
    fence_status = VK_ERROR_DEVICE_LOST;
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 1);
    fixture_finish(fixture);
    free(fixture);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_row), cmocka_unit_test(state_passes_between_queues),
                                       cmocka_unit_test(told_before_the_device_is_lost)};
    return cmocka_run_group_tests_name("queues", tests, NULL, NULL);
}
