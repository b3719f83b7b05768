/* SPDX-License-Identifier: Apache-2.0 */
/* Parts of the layer that no driver here reaches: several queues, builds on the host, failures of the next layer. A fake next layer
 * stands below the real functions; maps and ranges are compared with plain loops. */
#include "layer/layer.h"

#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* Dispatchable handles: all the loader promises is that the first word is a dispatch table. */
static struct fake {
    void *table;
} fake_instance, fake_device, fake_queues[2], fake_commands[8];

static int table_of_instance, table_of_device;
static VkResult submit_result, build_result, fence_status;
static uint64_t next_handle = 0x1000;
static uint64_t one_address; /* of every structure, if it is not 0 */

static VKAPI_ATTR VkResult VKAPI_CALL create_structure(VkDevice device, const VkAccelerationStructureCreateInfoKHR *info,
                                                       const VkAllocationCallbacks *allocator,
                                                       VkAccelerationStructureKHR *out)
{
    (void)device, (void)info, (void)allocator;
    *out = (VkAccelerationStructureKHR)next_handle++;
    return VK_SUCCESS;
}

static VKAPI_ATTR void VKAPI_CALL destroy_structure(VkDevice device, VkAccelerationStructureKHR structure,
                                                    const VkAllocationCallbacks *allocator)
{
    (void)device, (void)structure, (void)allocator;
}

static VKAPI_ATTR VkDeviceAddress VKAPI_CALL address_of(VkDevice device,
                                                        const VkAccelerationStructureDeviceAddressInfoKHR *info)
{
    (void)device;
    return one_address ? one_address : (uint64_t)info->accelerationStructure << 8;
}

static VKAPI_ATTR VkResult VKAPI_CALL build_on_host(VkDevice device, VkDeferredOperationKHR deferred, uint32_t count,
                                                    const VkAccelerationStructureBuildGeometryInfoKHR *infos,
                                                    const VkAccelerationStructureBuildRangeInfoKHR *const *ranges)
{
    (void)device, (void)deferred, (void)count, (void)infos, (void)ranges;
    return build_result;
}

static VKAPI_ATTR VkResult VKAPI_CALL copy_on_host(VkDevice device, VkDeferredOperationKHR deferred,
                                                   const VkCopyAccelerationStructureInfoKHR *info)
{
    (void)device, (void)deferred, (void)info;
    return build_result;
}

static VKAPI_ATTR VkResult VKAPI_CALL queue_submit(VkQueue queue, uint32_t count, const VkSubmitInfo *submits,
                                                   VkFence fence)
{
    (void)queue, (void)count, (void)submits, (void)fence;
    return submit_result;
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
    return fence_status;
}

static VKAPI_ATTR VkResult VKAPI_CALL create_pool(VkDevice device, const VkCommandPoolCreateInfo *info,
                                                  const VkAllocationCallbacks *allocator, VkCommandPool *out)
{
    (void)device, (void)info, (void)allocator;
    *out = (VkCommandPool)next_handle++;
    return VK_SUCCESS;
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

static VKAPI_ATTR void VKAPI_CALL build_indirect(VkCommandBuffer commands, uint32_t count,
                                                 const VkAccelerationStructureBuildGeometryInfoKHR *infos,
                                                 const VkDeviceAddress *addresses, const uint32_t *strides,
                                                 const uint32_t *const *maxima)
{
    (void)commands, (void)count, (void)infos, (void)addresses, (void)strides, (void)maxima;
}

static VKAPI_ATTR void VKAPI_CALL copy_structure(VkCommandBuffer commands, const VkCopyAccelerationStructureInfoKHR *info)
{
    (void)commands, (void)info;
}

static VKAPI_ATTR void VKAPI_CALL write_properties(VkCommandBuffer commands, uint32_t count,
                                                   const VkAccelerationStructureKHR *structures, VkQueryType type,
                                                   VkQueryPool pool, uint32_t first)
{
    (void)commands, (void)count, (void)structures, (void)type, (void)pool, (void)first;
}

static VKAPI_ATTR VkResult VKAPI_CALL reset_commands(VkCommandBuffer commands, VkCommandBufferResetFlags flags)
{
    (void)commands, (void)flags;
    return VK_SUCCESS;
}

static VKAPI_ATTR VkResult VKAPI_CALL create_query_pool(VkDevice device, const VkQueryPoolCreateInfo *info,
                                                        const VkAllocationCallbacks *allocator, VkQueryPool *out)
{
    (void)device, (void)info, (void)allocator;
    *out = (VkQueryPool)next_handle++;
    return VK_SUCCESS;
}

static VKAPI_ATTR void VKAPI_CALL destroy_query_pool(VkDevice device, VkQueryPool pool,
                                                     const VkAllocationCallbacks *allocator)
{
    (void)device, (void)pool, (void)allocator;
}

static VkResult query_result;

/* Every compacted size is 600. */
static VKAPI_ATTR VkResult VKAPI_CALL get_query_results(VkDevice device, VkQueryPool pool, uint32_t first, uint32_t count,
                                                        size_t size, void *data, VkDeviceSize stride,
                                                        VkQueryResultFlags flags)
{
    (void)device, (void)pool, (void)first, (void)size;
    for (uint32_t i = 0; i < count; i++) {
        uint64_t wide = 600;
        uint32_t narrow = 600;
        bool is_wide = (flags & VK_QUERY_RESULT_64_BIT) != 0;
        memcpy((char *)data + i * stride, is_wide ? (const void *)&wide : &narrow, is_wide ? 8 : 4);
    }
    return query_result;
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

/* The copy takes place when it is recorded: the source is host memory whose address is its device address. */
static const void *copy_source;

/* What the next layer last saw of a buffer, by either way of asking. */
static VkBufferUsageFlags2 usage_seen;

static VkBufferUsageFlags2 usage_of(const VkBufferCreateInfo *info)
{
    const VkBufferUsageFlags2CreateInfo *wide =
        gn_chain_find(info->pNext, VK_STRUCTURE_TYPE_BUFFER_USAGE_FLAGS_2_CREATE_INFO);
    return wide ? wide->usage : info->usage;
}

static VKAPI_ATTR void VKAPI_CALL device_buffer_needs(VkDevice device, const VkDeviceBufferMemoryRequirements *info,
                                                      VkMemoryRequirements2 *out)
{
    (void)device, (void)out;
    usage_seen = usage_of(info->pCreateInfo);
}

static VKAPI_ATTR VkResult VKAPI_CALL create_buffer(VkDevice device, const VkBufferCreateInfo *info,
                                                    const VkAllocationCallbacks *allocator, VkBuffer *out)
{
    (void)device, (void)allocator;
    usage_seen = usage_of(info);
    *out = (VkBuffer)next_handle++;
    return VK_SUCCESS;
}

static VKAPI_ATTR void VKAPI_CALL buffer_needs(VkDevice device, VkBuffer buffer, VkMemoryRequirements *out)
{
    (void)device, (void)buffer;
    *out = (VkMemoryRequirements){.size = 1 << 20, .alignment = 1, .memoryTypeBits = 1};
}

static void *staging;

static VKAPI_ATTR VkResult VKAPI_CALL allocate_memory(VkDevice device, const VkMemoryAllocateInfo *info,
                                                      const VkAllocationCallbacks *allocator, VkDeviceMemory *out)
{
    (void)device, (void)info, (void)allocator;
    *out = (VkDeviceMemory)next_handle++;
    return VK_SUCCESS;
}

static VKAPI_ATTR VkResult VKAPI_CALL bind_memory(VkDevice device, VkBuffer buffer, VkDeviceMemory memory,
                                                  VkDeviceSize offset)
{
    (void)device, (void)buffer, (void)memory, (void)offset;
    return VK_SUCCESS;
}

static VKAPI_ATTR VkResult VKAPI_CALL map_memory(VkDevice device, VkDeviceMemory memory, VkDeviceSize offset,
                                                 VkDeviceSize size, VkMemoryMapFlags flags, void **out)
{
    (void)device, (void)memory, (void)offset, (void)size, (void)flags;
    *out = staging;
    return VK_SUCCESS;
}

static VKAPI_ATTR void VKAPI_CALL free_memory(VkDevice device, VkDeviceMemory memory, const VkAllocationCallbacks *allocator)
{
    (void)device, (void)memory, (void)allocator;
}

static VKAPI_ATTR void VKAPI_CALL destroy_buffer(VkDevice device, VkBuffer buffer, const VkAllocationCallbacks *allocator)
{
    (void)device, (void)buffer, (void)allocator;
}

static VKAPI_ATTR VkDeviceAddress VKAPI_CALL buffer_address(VkDevice device, const VkBufferDeviceAddressInfo *info)
{
    (void)device, (void)info;
    return (uint64_t)(uintptr_t)copy_source;
}

static VKAPI_ATTR void VKAPI_CALL copy_buffer(VkCommandBuffer commands, VkBuffer from, VkBuffer to, uint32_t count,
                                              const VkBufferCopy *regions)
{
    (void)commands, (void)from, (void)to, (void)count;
    memcpy((char *)staging + regions->dstOffset, (const char *)copy_source + regions->srcOffset, regions->size);
}

static VKAPI_ATTR void VKAPI_CALL destroy_device(VkDevice device, const VkAllocationCallbacks *allocator)
{
    (void)device, (void)allocator;
}

struct fixture {
    struct gn_instance instance;
    struct gn_device *device;
    VkDevice handle;
    VkCommandBuffer commands[8];
    _Alignas(16) VkAccelerationStructureInstanceKHR record;
    VkBuffer input;
};

static VKAPI_ATTR VkResult VKAPI_CALL create_fence(VkDevice device, const VkFenceCreateInfo *info,
                                                   const VkAllocationCallbacks *allocator, VkFence *out)
{
    (void)device, (void)info, (void)allocator;
    *out = (VkFence)next_handle++;
    return VK_SUCCESS;
}

static VKAPI_ATTR void VKAPI_CALL destroy_fence(VkDevice device, VkFence fence, const VkAllocationCallbacks *allocator)
{
    (void)device, (void)fence, (void)allocator;
}

static VKAPI_ATTR VkResult VKAPI_CALL reset_fences(VkDevice device, uint32_t count, const VkFence *fences)
{
    (void)device, (void)count, (void)fences;
    return VK_SUCCESS;
}

static int set_up(void **state)
{
    struct fixture *fixture = calloc(1, sizeof *fixture);
    struct gn_device *device = calloc(1, sizeof *device);
    staging = calloc(1, 1 << 20);
    submit_result = build_result = fence_status = query_result = VK_SUCCESS;
    one_address = 0;
    fake_instance.table = &table_of_instance;
    fake_device.table = fake_queues[0].table = fake_queues[1].table = &table_of_device;
    fixture->instance.handle = (VkInstance)(void *)&fake_instance;
    fixture->instance.settings = (struct gn_settings){.severity_floor = GN_SEVERITY_NOTE,
                                                      .profile = GN_PROFILE_VULKAN,
                                                      .rules = gn_rule_set_all(),
                                                      .instance_cap = 1000};
    for (size_t i = 0; i < gn_rules_count(); i++) /* barriers are the matter of test_queues.c */
        if (gn_rule_matches(gn_rules_at(i), "sync.*"))
            gn_rule_set_put(&fixture->instance.settings.rules, i, false);
    fixture->instance.judged_commands = (UINT32_C(1) << GN_COMMAND_KIND_COUNT) - 1;
    pthread_mutex_init(&fixture->instance.lock, NULL);
    fixture->record = (VkAccelerationStructureInstanceKHR){.transform = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}},
                                                           .mask = 0xFF};
    fixture->device = device;
    fixture->handle = device->handle = (VkDevice)(void *)&fake_device;
    device->instance = &fixture->instance;
    device->tracked = device->copies = true;
    device->family_count = 1;
    device->memory = (VkPhysicalDeviceMemoryProperties){
        .memoryTypeCount = 1,
        .memoryTypes[0].propertyFlags = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT};
    device->next = (struct gn_device_next){.CreateAccelerationStructureKHR = create_structure,
                                           .DestroyAccelerationStructureKHR = destroy_structure,
                                           .GetAccelerationStructureDeviceAddressKHR = address_of,
                                           .BuildAccelerationStructuresKHR = build_on_host,
                                           .CopyAccelerationStructureKHR = copy_on_host,
                                           .QueueSubmit = queue_submit,
                                           .GetFenceStatus = get_fence_status,
                                           .WaitForFences = wait_for_fences,
                                           .CreateFence = create_fence,
                                           .DestroyFence = destroy_fence,
                                           .ResetFences = reset_fences,
                                           .CreateCommandPool = create_pool,
                                           .AllocateCommandBuffers = allocate_commands,
                                           .CmdBuildAccelerationStructuresKHR = build,
                                           .CmdBuildAccelerationStructuresIndirectKHR = build_indirect,
                                           .CmdCopyAccelerationStructureKHR = copy_structure,
                                           .CmdWriteAccelerationStructuresPropertiesKHR = write_properties,
                                           .ResetCommandBuffer = reset_commands,
                                           .CreateQueryPool = create_query_pool,
                                           .DestroyQueryPool = destroy_query_pool,
                                           .GetQueryPoolResults = get_query_results,
                                           .CmdPipelineBarrier = pipeline_barrier,
                                           .CmdCopyBuffer = copy_buffer,
                                           .CreateBuffer = create_buffer,
                                           .DestroyBuffer = destroy_buffer,
                                           .GetBufferMemoryRequirements = buffer_needs,
                                           .GetDeviceBufferMemoryRequirements = device_buffer_needs,
                                           .GetBufferDeviceAddress = buffer_address,
                                           .AllocateMemory = allocate_memory,
                                           .FreeMemory = free_memory,
                                           .BindBufferMemory = bind_memory,
                                           .MapMemory = map_memory,
                                           .DestroyDevice = destroy_device};
    pthread_mutex_init(&device->lock, NULL);
    if (!gn_device_register(device))
        return 1;
    VkCommandPoolCreateInfo pool_info = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO};
    VkCommandBufferAllocateInfo allocation = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                              .commandBufferCount = 8};
    gn_entry_CreateCommandPool(fixture->handle, &pool_info, NULL, &allocation.commandPool);
    for (int i = 0; i < 8; i++)
        fake_commands[i].table = &table_of_device;
    gn_entry_AllocateCommandBuffers(fixture->handle, &allocation, fixture->commands);
    copy_source = &fixture->record;
    VkBufferCreateInfo buffer = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                                 .size = sizeof fixture->record,
                                 .usage = VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR |
                                          VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT};
    gn_entry_CreateBuffer(fixture->handle, &buffer, NULL, &fixture->input);
    gn_entry_BindBufferMemory(fixture->handle, fixture->input, VK_NULL_HANDLE, 0);
    *state = fixture;
    return 0;
}

static int tear_down(void **state)
{
    struct fixture *fixture = *state;
    gn_entry_DestroyDevice(fixture->handle, NULL);
    size_t cursor = 0;
    void *site;
    while ((site = gn_map_next(&fixture->instance.sites, &cursor)))
        free(site);
    gn_map_finish(&fixture->instance.sites);
    pthread_mutex_destroy(&fixture->instance.lock);
    free(fixture);
    free(staging);
    return 0;
}

static VkAccelerationStructureKHR make(struct fixture *fixture, VkAccelerationStructureTypeKHR type)
{
    VkAccelerationStructureCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
                                                 .type = type};
    VkAccelerationStructureKHR handle;
    assert_int_equal(gn_entry_CreateAccelerationStructureKHR(fixture->handle, &info, NULL, &handle), VK_SUCCESS);
    VkAccelerationStructureDeviceAddressInfoKHR query = {.accelerationStructure = handle};
    gn_entry_GetAccelerationStructureDeviceAddressKHR(fixture->handle, &query);
    return handle;
}

#define BOTTOM VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR
#define TOP VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR

/* The build of a TLAS with the fixture's one record, or of a BLAS. */
struct job {
    VkAccelerationStructureGeometryKHR geometry;
    VkAccelerationStructureBuildGeometryInfoKHR info;
    VkAccelerationStructureBuildRangeInfoKHR range;
    const VkAccelerationStructureBuildRangeInfoKHR *ranges;
};

static void job_fill(struct job *job, struct fixture *fixture, VkAccelerationStructureKHR target,
                     VkAccelerationStructureTypeKHR type)
{
    *job = (struct job){.geometry.geometryType = type == TOP ? VK_GEOMETRY_TYPE_INSTANCES_KHR : VK_GEOMETRY_TYPE_AABBS_KHR};
    if (type == TOP)
        job->geometry.geometry.instances.data.hostAddress = &fixture->record;
    job->info = (VkAccelerationStructureBuildGeometryInfoKHR){
        .type = type, .dstAccelerationStructure = target, .geometryCount = 1, .pGeometries = &job->geometry};
    job->range.primitiveCount = 1;
    job->ranges = &job->range;
}

static VkResult on_host(struct fixture *fixture, VkAccelerationStructureKHR target, VkAccelerationStructureTypeKHR type)
{
    struct job job;
    job_fill(&job, fixture, target, type);
    return gn_entry_BuildAccelerationStructuresKHR(fixture->handle, VK_NULL_HANDLE, 1, &job.info, &job.ranges);
}

static void on_queue(struct fixture *fixture, int queue, int commands, VkAccelerationStructureKHR target,
                     VkAccelerationStructureTypeKHR type, VkFence fence)
{
    struct job job;
    VkCommandBuffer buffer = fixture->commands[commands];
    job_fill(&job, fixture, target, type);
    gn_entry_CmdBuildAccelerationStructuresKHR(buffer, 1, &job.info, &job.ranges);
    VkSubmitInfo info = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &buffer};
    gn_entry_QueueSubmit((VkQueue)(void *)&fake_queues[queue], 1, &info, fence);
}

static unsigned long long unjudged(const struct fixture *fixture, enum gn_unjudged what)
{
    return atomic_load(&fixture->instance.tally.unjudged[what]);
}

static void host_build_of_an_unbuilt_blas(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    fixture->record.accelerationStructureReference = (uint64_t)blas;
    on_host(fixture, tlas, TOP);
    assert_int_equal(fixture->instance.findings, 1);
    on_host(fixture, blas, BOTTOM);
    on_host(fixture, tlas, TOP);
    assert_int_equal(fixture->instance.findings, 1);
}

static void host_build_that_failed_built_nothing(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    fixture->record.accelerationStructureReference = (uint64_t)blas;
    build_result = VK_ERROR_OUT_OF_HOST_MEMORY;
    on_host(fixture, blas, BOTTOM);
    build_result = VK_SUCCESS;
    on_host(fixture, tlas, TOP);
    assert_int_equal(fixture->instance.findings, 1);
}

static void host_copy_and_deferred_build_count_as_built(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR source = make(fixture, BOTTOM), copy = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    build_result = VK_OPERATION_DEFERRED_KHR;
    on_host(fixture, source, BOTTOM);
    on_host(fixture, tlas, TOP);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_deferred), 1);
    build_result = VK_SUCCESS;
    VkCopyAccelerationStructureInfoKHR info = {.src = source, .dst = copy};
    gn_entry_CopyAccelerationStructureKHR(fixture->handle, VK_NULL_HANDLE, &info);
    fixture->record.accelerationStructureReference = (uint64_t)copy;
    on_host(fixture, tlas, TOP);
    fixture->record.accelerationStructureReference = (uint64_t)source;
    on_host(fixture, tlas, TOP);
    assert_int_equal(fixture->instance.findings, 0);
}

static void host_build_before_a_device_build(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    fixture->record.accelerationStructureReference = (uint64_t)blas << 8;
    on_host(fixture, blas, BOTTOM);
    on_queue(fixture, 0, 0, tlas, TOP, VK_NULL_HANDLE);
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 0);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_other_order), 0);
}

/* A TLAS build may wait for a build that is submitted to another queue after it. */
static void two_queues_are_not_judged_by_submission_order(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    fixture->record.accelerationStructureReference = (uint64_t)blas << 8;
    fence_status = VK_NOT_READY;
    on_queue(fixture, 0, 0, tlas, TOP, VK_NULL_HANDLE);
    on_queue(fixture, 1, 1, blas, BOTTOM, VK_NULL_HANDLE);
    fence_status = VK_SUCCESS;
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 0);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_other_order), 1);
    /* And the twin on one queue. */
    VkAccelerationStructureKHR late = make(fixture, BOTTOM);
    fixture->record.accelerationStructureReference = (uint64_t)late << 8;
    fence_status = VK_NOT_READY;
    on_queue(fixture, 0, 2, tlas, TOP, VK_NULL_HANDLE);
    on_queue(fixture, 0, 3, late, BOTTOM, VK_NULL_HANDLE);
    fence_status = VK_SUCCESS;
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 1);
}

static void an_indirect_build_counts_as_built(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    struct job jobs[2];
    job_fill(&jobs[0], fixture, blas, BOTTOM);
    job_fill(&jobs[1], fixture, tlas, TOP);
    VkAccelerationStructureBuildGeometryInfoKHR infos[2] = {jobs[0].info, jobs[1].info};
    gn_entry_CmdBuildAccelerationStructuresIndirectKHR(fixture->commands[0], 2, infos, NULL, NULL, NULL);
    VkSubmitInfo info = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = fixture->commands};
    gn_entry_QueueSubmit((VkQueue)(void *)&fake_queues[0], 1, &info, VK_NULL_HANDLE);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_indirect_builds), 1);
    fixture->record.accelerationStructureReference = (uint64_t)blas << 8;
    on_queue(fixture, 0, 1, tlas, TOP, VK_NULL_HANDLE);
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 0);
}

static void submit_one(struct fixture *fixture, int queue, int commands)
{
    VkSubmitInfo info = {
        .sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &fixture->commands[commands]};
    gn_entry_QueueSubmit((VkQueue)(void *)&fake_queues[queue], 1, &info, VK_NULL_HANDLE);
}

static void update_on_queue(struct fixture *fixture, int queue, int commands, VkAccelerationStructureKHR blas)
{
    struct job job;
    job_fill(&job, fixture, blas, BOTTOM);
    job.info.mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
    job.info.srcAccelerationStructure = blas;
    gn_entry_CmdBuildAccelerationStructuresKHR(fixture->commands[commands], 1, &job.info, &job.ranges);
    submit_one(fixture, queue, commands);
}

/* The update may have waited for the build, although that was submitted after it. */
static void an_update_that_may_follow_a_build_is_not_accused(void **state)
{
    struct fixture *fixture = *state;
    enum { OTHER_QUEUE, HOST, NOBODY, WAYS };
    for (int way = 0; way < WAYS; way++) {
        VkAccelerationStructureKHR blas = make(fixture, BOTTOM);
        fence_status = VK_NOT_READY;
        update_on_queue(fixture, 0, 2 * way, blas);
        if (way == OTHER_QUEUE)
            on_queue(fixture, 1, 2 * way + 1, blas, BOTTOM, VK_NULL_HANDLE);
        else if (way == HOST)
            on_host(fixture, blas, BOTTOM);
        assert_int_equal(fixture->instance.findings, 0);
        fence_status = VK_SUCCESS;
        gn_device_collect(fixture->device);
        assert_int_equal(fixture->instance.findings, way == NOBODY);
        assert_int_equal(unjudged(fixture, GN_UNJUDGED_unproven), way == NOBODY ? 2 : way + 1);
    }
}

/* The second element updates from what the first builds; in two commands the same is fine. */
static void an_update_beside_the_build_of_its_source(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR source = make(fixture, BOTTOM), target = make(fixture, BOTTOM);
    const VkBuildAccelerationStructureFlagsKHR flags = VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR;
    for (uint32_t calls = 1; calls <= 2; calls++) {
        struct job jobs[2];
        job_fill(&jobs[0], fixture, source, BOTTOM);
        job_fill(&jobs[1], fixture, target, BOTTOM);
        jobs[0].info.flags = jobs[1].info.flags = flags;
        jobs[1].info.mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
        jobs[1].info.srcAccelerationStructure = source;
        VkAccelerationStructureBuildGeometryInfoKHR infos[2] = {jobs[0].info, jobs[1].info};
        const VkAccelerationStructureBuildRangeInfoKHR *ranges[2] = {jobs[0].ranges, jobs[1].ranges};
        for (uint32_t first = 0; first < 2; first += 3 - calls)
            gn_entry_CmdBuildAccelerationStructuresKHR(fixture->commands[calls], 3 - calls, infos + first, ranges + first);
        submit_one(fixture, 0, (int)calls);
        gn_device_collect(fixture->device);
        assert_int_equal(fixture->instance.findings, 1);
    }
}

/* A cluster command may have built it. */
static void nothing_is_accused_beside_commands_that_are_not_followed(void **state)
{
    struct fixture *fixture = *state;
    fixture->device->builds_unseen = true;
    update_on_queue(fixture, 0, 0, make(fixture, BOTTOM));
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 0);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_cluster_commands), 1);
    fixture->device->builds_unseen = false;
    update_on_queue(fixture, 0, 1, make(fixture, BOTTOM));
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 1);
}

/* What the host has built, and with which flags, is not looked at. */
static void an_update_of_a_host_build_is_not_accused(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM);
    on_host(fixture, blas, BOTTOM);
    update_on_queue(fixture, 0, 0, blas);
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 0);
    on_queue(fixture, 0, 1, blas, BOTTOM, VK_NULL_HANDLE);
    update_on_queue(fixture, 0, 2, blas);
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 1);
}

static void an_update_that_did_not_run_is_not_accused(void **state)
{
    struct fixture *fixture = *state;
    submit_result = VK_ERROR_OUT_OF_DEVICE_MEMORY;
    update_on_queue(fixture, 0, 0, make(fixture, BOTTOM));
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_unproven), 1);
    submit_result = VK_SUCCESS;
    fence_status = VK_ERROR_DEVICE_LOST;
    update_on_queue(fixture, 0, 1, make(fixture, BOTTOM));
    gn_device_collect(fixture->device);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_unproven), 2);
    fence_status = VK_SUCCESS;
    gn_tally_lost(fixture->device);
    update_on_queue(fixture, 0, 2, make(fixture, BOTTOM));
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 0);
}

/* The source of the copy is one that another queue builds: what the copy holds is not known. */
static void a_copy_of_something_uncertain_is_uncertain(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR source = make(fixture, BOTTOM), copy = make(fixture, BOTTOM);
    VkCopyAccelerationStructureInfoKHR info = {.src = source, .dst = copy};
    on_queue(fixture, 1, 0, source, BOTTOM, VK_NULL_HANDLE);
    gn_entry_CmdCopyAccelerationStructureKHR(fixture->commands[1], &info);
    submit_one(fixture, 0, 1);
    update_on_queue(fixture, 0, 2, copy);
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 0);
}

/* A compacted size counts for the build that it was asked of, and only if there is no doubt which answer was read. */
static void a_size_belongs_to_one_build(void **state)
{
    static const struct {
        const char *name;
        bool wide, asked_twice, unavailable, partial, other_slot;
        unsigned findings;
    } rows[] = {
        {"64 bits", true, false, false, false, false, 1},       {"32 bits", false, false, false, false, false, 1},
        {"asked again unread", true, true, false, false, false, 0}, {"not available", true, false, true, false, false, 0},
        {"partial", true, false, false, true, false, 0},        {"another slot", true, false, false, false, true, 0},
    };
    struct fixture *fixture = *state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        VkAccelerationStructureCreateInfoKHR create = {.type = BOTTOM, .size = 599};
        VkQueryPoolCreateInfo pool_info = {.queryType = VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR, .queryCount = 2};
        VkAccelerationStructureKHR source = make(fixture, BOTTOM), target;
        VkCommandBuffer commands = fixture->commands[i];
        VkQueryPool pool;
        struct job job;
        gn_entry_CreateAccelerationStructureKHR(fixture->handle, &create, NULL, &target);
        gn_entry_CreateQueryPool(fixture->handle, &pool_info, NULL, &pool);
        job_fill(&job, fixture, source, BOTTOM);
        job.info.flags = VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR;
        gn_entry_CmdBuildAccelerationStructuresKHR(commands, 1, &job.info, &job.ranges);
        for (int ask = 0; ask <= rows[i].asked_twice; ask++)
            gn_entry_CmdWriteAccelerationStructuresPropertiesKHR(commands, 1, &source, pool_info.queryType, pool,
                                                                 rows[i].other_slot ? 0 : 1);
        gn_entry_CmdWriteAccelerationStructuresPropertiesKHR(commands, 1, &source, pool_info.queryType, pool, 7);
        submit_one(fixture, 0, (int)i);
        uint64_t data[2] = {0};
        query_result = rows[i].unavailable ? VK_NOT_READY : VK_SUCCESS;
        gn_entry_GetQueryPoolResults(fixture->handle, pool, 1, 1, sizeof data, data, 8,
                                     (rows[i].wide ? VK_QUERY_RESULT_64_BIT : 0) |
                                         (rows[i].partial ? VK_QUERY_RESULT_PARTIAL_BIT : 0));
        VkCopyAccelerationStructureInfoKHR copy = {
            .src = source, .dst = target, .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR};
        unsigned long long before = fixture->instance.findings;
        gn_entry_CmdCopyAccelerationStructureKHR(fixture->commands[6], &copy);
        submit_one(fixture, 0, 6);
        gn_device_collect(fixture->device);
        gn_entry_ResetCommandBuffer(fixture->commands[6], 0);
        if (fixture->instance.findings - before != rows[i].findings)
            fail_msg("%s: expected %u findings, found %llu", rows[i].name, rows[i].findings, fixture->instance.findings - before);
        gn_entry_DestroyQueryPool(fixture->handle, pool, NULL);
    }
}

static void a_refused_submission_is_not_judged(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    fixture->record.accelerationStructureReference = (uint64_t)blas << 8;
    submit_result = VK_ERROR_OUT_OF_DEVICE_MEMORY;
    on_queue(fixture, 0, 0, tlas, TOP, VK_NULL_HANDLE);
    assert_int_equal(atomic_load(&fixture->device->pending), 0);
    assert_int_equal(fixture->instance.findings, 0);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_not_completed), 1);
}

static void a_lost_device_is_not_judged(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    fixture->record.accelerationStructureReference = (uint64_t)blas << 8;
    fence_status = VK_NOT_READY;
    on_queue(fixture, 0, 0, tlas, TOP, VK_NULL_HANDLE);
    on_queue(fixture, 0, 1, tlas, TOP, (VkFence)7);
    fence_status = VK_ERROR_DEVICE_LOST;
    gn_device_collect(fixture->device);
    assert_int_equal(atomic_load(&fixture->device->pending), 0);
    assert_int_equal(fixture->instance.findings, 0);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_not_completed), 2);
}

/* The application resets its fence: then the submission is over, although nobody saw the fence signalled. */
static void a_fence_that_is_reset_has_completed(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    VkFence fence = (VkFence)7;
    fixture->record.accelerationStructureReference = (uint64_t)blas << 8;
    fence_status = VK_NOT_READY;
    on_queue(fixture, 0, 0, tlas, TOP, fence);
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 0);
    gn_entry_ResetFences(fixture->handle, 1, &fence);
    assert_int_equal(fixture->instance.findings, 1);
    assert_int_equal(atomic_load(&fixture->device->pending), 0);
}

static void a_device_destroyed_before_completion(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    fixture->record.accelerationStructureReference = (uint64_t)blas << 8;
    fence_status = VK_NOT_READY;
    on_queue(fixture, 0, 0, tlas, TOP, VK_NULL_HANDLE);
    gn_entry_DestroyAccelerationStructureKHR(fixture->handle, blas, NULL);
    gn_queues_finish(fixture->device);
    assert_int_equal(fixture->instance.findings, 0);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_not_completed), 1);
}

static void destroyed_while_the_build_is_pending(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), built = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    on_queue(fixture, 0, 2, built, BOTTOM, VK_NULL_HANDLE);
    fence_status = VK_NOT_READY;
    fixture->record.accelerationStructureReference = (uint64_t)blas << 8;
    on_queue(fixture, 0, 0, tlas, TOP, VK_NULL_HANDLE);
    fixture->record.accelerationStructureReference = (uint64_t)built << 8;
    on_queue(fixture, 0, 1, tlas, TOP, VK_NULL_HANDLE);
    gn_entry_DestroyAccelerationStructureKHR(fixture->handle, blas, NULL);
    gn_entry_DestroyAccelerationStructureKHR(fixture->handle, built, NULL);
    assert_int_equal(fixture->instance.findings, 0);
    fence_status = VK_SUCCESS;
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 1);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_unknown_reference), 0);
    assert_null(fixture->device->destroyed);
    /* Now they are gone. */
    on_queue(fixture, 0, 3, tlas, TOP, VK_NULL_HANDLE);
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 2);
}

/* A structure whose address nobody asked may be the one that is referred to. */
static void references_are_unknown_only_when_that_is_certain(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureCreateInfoKHR info = {.type = BOTTOM};
    VkAccelerationStructureKHR hidden, tlas = make(fixture, TOP);
    gn_entry_CreateAccelerationStructureKHR(fixture->handle, &info, NULL, &hidden);
    fixture->record.accelerationStructureReference = 0x7777700;
    on_queue(fixture, 0, 0, tlas, TOP, VK_NULL_HANDLE);
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 0);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_unknown_reference), 1);
    gn_entry_DestroyAccelerationStructureKHR(fixture->handle, hidden, NULL);
    on_queue(fixture, 0, 1, tlas, TOP, VK_NULL_HANDLE);
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 1);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_unknown_reference), 1);
}

/* Two structures in one place at one time: building either fills the memory. One after the other is another matter. */
static void aliases_are_not_accused(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR tlas = make(fixture, TOP);
    one_address = 0xAB00;
    VkAccelerationStructureKHR first = make(fixture, BOTTOM);
    on_queue(fixture, 0, 0, first, BOTTOM, VK_NULL_HANDLE);
    VkAccelerationStructureKHR second = make(fixture, BOTTOM);
    gn_entry_DestroyAccelerationStructureKHR(fixture->handle, first, NULL);
    fixture->record.accelerationStructureReference = one_address;
    on_queue(fixture, 0, 1, tlas, TOP, VK_NULL_HANDLE);
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 0);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_other_order), 1);
    gn_entry_DestroyAccelerationStructureKHR(fixture->handle, second, NULL);
    make(fixture, BOTTOM);
    on_queue(fixture, 0, 2, tlas, TOP, VK_NULL_HANDLE);
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 1);
}

static void structures_in_external_memory_are_not_accused(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR tlas = make(fixture, TOP), blas;
    for (int shared = 1; shared >= 0; shared--) {
        VkExternalMemoryBufferCreateInfo external = {.sType = VK_STRUCTURE_TYPE_EXTERNAL_MEMORY_BUFFER_CREATE_INFO,
                                                     .handleTypes = VK_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD_BIT};
        VkBufferCreateInfo buffer = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                                     .pNext = shared ? &external : NULL,
                                     .size = 256,
                                     .usage = VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR |
                                              VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT};
        VkAccelerationStructureCreateInfoKHR info = {.type = BOTTOM};
        gn_entry_CreateBuffer(fixture->handle, &buffer, NULL, &info.buffer);
        gn_entry_BindBufferMemory(fixture->handle, info.buffer, VK_NULL_HANDLE, 0);
        gn_entry_CreateAccelerationStructureKHR(fixture->handle, &info, NULL, &blas); /* its address is never asked */
        fixture->record.accelerationStructureReference = (uint64_t)blas << 8;
        on_queue(fixture, 0, shared, tlas, TOP, VK_NULL_HANDLE);
        gn_device_collect(fixture->device);
        assert_int_equal(fixture->instance.findings, !shared);
    }
}

/* Creation and the question about memory see the same usage; what the application passed stays as it was. */
static void usage_is_added_alike(void **state)
{
    struct fixture *fixture = *state;
    const VkBufferUsageFlags input = VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR;
    const VkBufferUsageFlags from = VK_BUFFER_USAGE_TRANSFER_SRC_BIT;
    VkBufferUsageFlags2CreateInfo wide = {.sType = VK_STRUCTURE_TYPE_BUFFER_USAGE_FLAGS_2_CREATE_INFO, .usage = input};
    VkBufferOpaqueCaptureAddressCreateInfo before = {
        .sType = VK_STRUCTURE_TYPE_BUFFER_OPAQUE_CAPTURE_ADDRESS_CREATE_INFO, .pNext = &wide};
    VkBaseInStructure unknown = {.sType = (VkStructureType)0x7FFFFF00, .pNext = (const VkBaseInStructure *)&wide};
    VkExternalMemoryBufferCreateInfo external = {.sType = VK_STRUCTURE_TYPE_EXTERNAL_MEMORY_BUFFER_CREATE_INFO,
                                                 .handleTypes = VK_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD_BIT};
    const struct {
        const char *name;
        const void *chain;
        VkBufferUsageFlags usage;
        VkBufferCreateFlags flags;
        VkBufferUsageFlags2 expected;
    } rows[] = {
        {"build input", NULL, input, 0, input | from},
        {"something else", NULL, VK_BUFFER_USAGE_VERTEX_BUFFER_BIT, 0, VK_BUFFER_USAGE_VERTEX_BUFFER_BIT},
        {"has it already", NULL, input | from, 0, input | from},
        {"wide flags", &wide, 0, 0, input | from},
        {"wide flags behind another structure", &before, 0, 0, input | from},
        {"wide flags behind a structure of unknown size", &unknown, 0, 0, input},
        {"shared memory", &external, input, 0, input},
        {"protected", NULL, input, VK_BUFFER_CREATE_PROTECTED_BIT, input},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        VkBufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                                   .pNext = rows[i].chain,
                                   .flags = rows[i].flags,
                                   .size = 64,
                                   .usage = rows[i].usage};
        VkDeviceBufferMemoryRequirements query = {.sType = VK_STRUCTURE_TYPE_DEVICE_BUFFER_MEMORY_REQUIREMENTS,
                                                  .pCreateInfo = &info};
        VkBuffer buffer;
        gn_entry_CreateBuffer(fixture->handle, &info, NULL, &buffer);
        VkBufferUsageFlags2 created = usage_seen;
        gn_entry_DestroyBuffer(fixture->handle, buffer, NULL);
        gn_entry_GetDeviceBufferMemoryRequirements(fixture->handle, &query, NULL);
        if (created != rows[i].expected || usage_seen != rows[i].expected || info.usage != rows[i].usage || wide.usage != input)
            fail_msg("%s: expected usage 0x%llx, created with 0x%llx, asked with 0x%llx", rows[i].name,
                     (unsigned long long)rows[i].expected, (unsigned long long)created, (unsigned long long)usage_seen);
    }
}

static void after_running_out_of_memory_nobody_is_accused(void **state)
{
    struct fixture *fixture = *state;
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    fixture->record.accelerationStructureReference = (uint64_t)blas << 8;
    gn_tally_lost(fixture->device);
    on_queue(fixture, 0, 0, tlas, TOP, VK_NULL_HANDLE);
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 0);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_out_of_host_memory), 2);
}

static uint64_t random_next(uint64_t *seed)
{
    *seed ^= *seed << 13;
    *seed ^= *seed >> 7;
    *seed ^= *seed << 17;
    return *seed;
}

static void map_agrees_with_an_array(void **state)
{
    (void)state;
    enum { KEYS = 512, STEPS = 200000 };
    static int values[KEYS];
    void *expected[KEYS] = {NULL};
    struct gn_map map = {0};
    size_t count = 0;
    uint64_t seed = 88172645463325252u;
    for (int step = 0; step < STEPS; step++) {
        size_t at = random_next(&seed) % KEYS;
        uint64_t key = at << (at % 3 * 16); /* keys that collide in their low bits */
        if (random_next(&seed) % 2) {
            count += !expected[at];
            assert_true(gn_map_put(&map, key, &values[step % KEYS]));
            expected[at] = &values[step % KEYS];
        } else {
            count -= expected[at] != NULL;
            assert_ptr_equal(gn_map_take(&map, key), expected[at]);
            expected[at] = NULL;
        }
        assert_ptr_equal(gn_map_get(&map, key), expected[at]);
        assert_int_equal(map.count, count);
    }
    gn_map_finish(&map);
}

static void ranges_agree_with_a_loop(void **state)
{
    (void)state;
    enum { NODES = 200, STEPS = 20000 };
    struct gn_range nodes[NODES];
    bool in[NODES] = {false};
    struct gn_ranges ranges = {0};
    uint64_t seed = 88172645463325252u;
    int found_some = 0, found_none = 0;
    memset(nodes, 0, sizeof nodes);
    for (int step = 0; step < STEPS; step++) {
        size_t at = random_next(&seed) % NODES;
        if (in[at]) {
            gn_ranges_remove(&ranges, &nodes[at]);
        } else {
            nodes[at].base = random_next(&seed) % 64 * 16;
            nodes[at].size = 1 + random_next(&seed) % 96;
            gn_ranges_insert(&ranges, &nodes[at]);
        }
        in[at] = !in[at];
        uint64_t base = random_next(&seed) % 1100, size = 1 + random_next(&seed) % 64;
        struct gn_range *found = gn_ranges_holding(&ranges, base, size);
        bool exists = false;
        for (int i = 0; i < NODES; i++)
            exists |= in[i] && nodes[i].base <= base && base + size <= nodes[i].base + nodes[i].size;
        assert_int_equal(found != NULL, exists);
        if (found)
            assert_true(found->base <= base && base + size <= found->base + found->size);
        exists ? found_some++ : found_none++;
    }
    assert_true(found_some > 1000 && found_none > 1000);
    assert_null(gn_ranges_holding(&ranges, UINT64_MAX - 1, 16));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(host_build_of_an_unbuilt_blas, set_up, tear_down),
        cmocka_unit_test_setup_teardown(host_build_that_failed_built_nothing, set_up, tear_down),
        cmocka_unit_test_setup_teardown(host_copy_and_deferred_build_count_as_built, set_up, tear_down),
        cmocka_unit_test_setup_teardown(host_build_before_a_device_build, set_up, tear_down),
        cmocka_unit_test_setup_teardown(two_queues_are_not_judged_by_submission_order, set_up, tear_down),
        cmocka_unit_test_setup_teardown(an_indirect_build_counts_as_built, set_up, tear_down),
        cmocka_unit_test_setup_teardown(an_update_that_may_follow_a_build_is_not_accused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(an_update_beside_the_build_of_its_source, set_up, tear_down),
        cmocka_unit_test_setup_teardown(nothing_is_accused_beside_commands_that_are_not_followed, set_up, tear_down),
        cmocka_unit_test_setup_teardown(an_update_of_a_host_build_is_not_accused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(an_update_that_did_not_run_is_not_accused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_copy_of_something_uncertain_is_uncertain, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_size_belongs_to_one_build, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_refused_submission_is_not_judged, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_lost_device_is_not_judged, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_fence_that_is_reset_has_completed, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_device_destroyed_before_completion, set_up, tear_down),
        cmocka_unit_test_setup_teardown(destroyed_while_the_build_is_pending, set_up, tear_down),
        cmocka_unit_test_setup_teardown(references_are_unknown_only_when_that_is_certain, set_up, tear_down),
        cmocka_unit_test_setup_teardown(aliases_are_not_accused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(structures_in_external_memory_are_not_accused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(usage_is_added_alike, set_up, tear_down),
        cmocka_unit_test_setup_teardown(after_running_out_of_memory_nobody_is_accused, set_up, tear_down),
        cmocka_unit_test(map_agrees_with_an_array),
        cmocka_unit_test(ranges_agree_with_a_loop),
    };
    return cmocka_run_group_tests_name("parts", tests, NULL, NULL);
}
