/* SPDX-License-Identifier: Apache-2.0 */
/* The fake next layer: it hands out handles, copies at once, and returns what it is told to. */
#include "tests/layer/fake.h"

#include <stdlib.h>
#include <string.h>

struct fake fake_queues[2];
static struct fake fake_instance, fake_device, fake_commands[8];
VkResult submit_result, build_result, fence_status, query_result;
uint64_t one_address, compacted_size;
const void *copy_source;
VkBufferUsageFlags2 usage_seen;
uint32_t fail_at, calls_made;
VkResult fail_with;

/* Of the next call, which may be the one that fails. */
static VkResult outcome(VkResult usual)
{
    return ++calls_made == fail_at ? fail_with : usual;
}

static int table_of_instance, table_of_device;
static uint64_t next_handle = 0x1000;

static VKAPI_ATTR VkResult VKAPI_CALL create_structure(VkDevice device, const VkAccelerationStructureCreateInfoKHR *info,
                                                       const VkAllocationCallbacks *allocator,
                                                       VkAccelerationStructureKHR *out)
{
    (void)device, (void)info, (void)allocator;
    VkResult result = outcome(VK_SUCCESS);
    if (result != VK_SUCCESS)
        return result;
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
    return outcome(build_result);
}

static VKAPI_ATTR VkResult VKAPI_CALL copy_on_host(VkDevice device, VkDeferredOperationKHR deferred,
                                                   const VkCopyAccelerationStructureInfoKHR *info)
{
    (void)device, (void)deferred, (void)info;
    return outcome(build_result);
}

static VKAPI_ATTR VkResult VKAPI_CALL copy_to_memory(VkDevice device, VkDeferredOperationKHR deferred,
                                                     const VkCopyAccelerationStructureToMemoryInfoKHR *info)
{
    (void)device, (void)deferred, (void)info;
    return outcome(build_result);
}

static VKAPI_ATTR VkResult VKAPI_CALL copy_from_memory(VkDevice device, VkDeferredOperationKHR deferred,
                                                       const VkCopyMemoryToAccelerationStructureInfoKHR *info)
{
    (void)device, (void)deferred, (void)info;
    return outcome(build_result);
}

static VKAPI_ATTR VkResult VKAPI_CALL write_on_host(VkDevice device, uint32_t count, const VkAccelerationStructureKHR *structures,
                                                    VkQueryType type, size_t size, void *data, size_t stride)
{
    (void)device, (void)structures, (void)type, (void)size;
    for (uint32_t i = 0; i < count; i++)
        memcpy((char *)data + i * stride, &compacted_size, sizeof compacted_size);
    return outcome(query_result);
}

static VKAPI_ATTR VkResult VKAPI_CALL deferred_result(VkDevice device, VkDeferredOperationKHR operation)
{
    (void)device, (void)operation;
    return build_result == VK_OPERATION_DEFERRED_KHR ? VK_NOT_READY : build_result;
}

static VKAPI_ATTR VkResult VKAPI_CALL deferred_join(VkDevice device, VkDeferredOperationKHR operation)
{
    (void)device, (void)operation;
    return build_result == VK_OPERATION_DEFERRED_KHR ? VK_THREAD_IDLE_KHR : VK_SUCCESS;
}

static VKAPI_ATTR void VKAPI_CALL deferred_destroy(VkDevice device, VkDeferredOperationKHR operation,
                                                   const VkAllocationCallbacks *allocator)
{
    (void)device, (void)operation, (void)allocator;
}

static VKAPI_ATTR VkResult VKAPI_CALL queue_submit(VkQueue queue, uint32_t count, const VkSubmitInfo *submits,
                                                   VkFence fence)
{
    (void)queue, (void)count, (void)submits, (void)fence;
    return outcome(submit_result);
}

static VKAPI_ATTR VkResult VKAPI_CALL get_fence_status(VkDevice device, VkFence fence)
{
    (void)device, (void)fence;
    return outcome(fence_status);
}

static VKAPI_ATTR VkResult VKAPI_CALL wait_for_fences(VkDevice device, uint32_t count, const VkFence *fences, VkBool32 all,
                                                      uint64_t timeout)
{
    (void)device, (void)count, (void)fences, (void)all, (void)timeout;
    return outcome(fence_status);
}

static VKAPI_ATTR VkResult VKAPI_CALL create_pool(VkDevice device, const VkCommandPoolCreateInfo *info,
                                                  const VkAllocationCallbacks *allocator, VkCommandPool *out)
{
    (void)device, (void)info, (void)allocator;
    VkResult result = outcome(VK_SUCCESS);
    if (result != VK_SUCCESS)
        return result;
    *out = (VkCommandPool)next_handle++;
    return VK_SUCCESS;
}

static VKAPI_ATTR VkResult VKAPI_CALL allocate_commands(VkDevice device, const VkCommandBufferAllocateInfo *info,
                                                        VkCommandBuffer *out)
{
    (void)device;
    VkResult result = outcome(VK_SUCCESS);
    if (result != VK_SUCCESS)
        return result;
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
    return outcome(VK_SUCCESS);
}

static VKAPI_ATTR VkResult VKAPI_CALL create_query_pool(VkDevice device, const VkQueryPoolCreateInfo *info,
                                                        const VkAllocationCallbacks *allocator, VkQueryPool *out)
{
    (void)device, (void)info, (void)allocator;
    VkResult result = outcome(VK_SUCCESS);
    if (result != VK_SUCCESS)
        return result;
    *out = (VkQueryPool)next_handle++;
    return VK_SUCCESS;
}

static VKAPI_ATTR void VKAPI_CALL destroy_query_pool(VkDevice device, VkQueryPool pool,
                                                     const VkAllocationCallbacks *allocator)
{
    (void)device, (void)pool, (void)allocator;
}

static VKAPI_ATTR VkResult VKAPI_CALL get_query_results(VkDevice device, VkQueryPool pool, uint32_t first, uint32_t count,
                                                        size_t size, void *data, VkDeviceSize stride,
                                                        VkQueryResultFlags flags)
{
    (void)device, (void)pool, (void)first, (void)size;
    for (uint32_t i = 0; i < count; i++) {
        uint64_t wide = compacted_size;
        uint32_t narrow = (uint32_t)compacted_size;
        bool is_wide = (flags & VK_QUERY_RESULT_64_BIT) != 0;
        memcpy((char *)data + i * stride, is_wide ? (const void *)&wide : &narrow, is_wide ? 8 : 4);
    }
    return outcome(query_result);
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
    VkResult result = outcome(VK_SUCCESS);
    if (result != VK_SUCCESS)
        return result;
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
    VkResult result = outcome(VK_SUCCESS);
    if (result != VK_SUCCESS)
        return result;
    *out = (VkDeviceMemory)next_handle++;
    return VK_SUCCESS;
}

static VKAPI_ATTR VkResult VKAPI_CALL bind_memory(VkDevice device, VkBuffer buffer, VkDeviceMemory memory,
                                                  VkDeviceSize offset)
{
    (void)device, (void)buffer, (void)memory, (void)offset;
    return outcome(VK_SUCCESS);
}

static VKAPI_ATTR VkResult VKAPI_CALL map_memory(VkDevice device, VkDeviceMemory memory, VkDeviceSize offset,
                                                 VkDeviceSize size, VkMemoryMapFlags flags, void **out)
{
    (void)device, (void)memory, (void)offset, (void)size, (void)flags;
    VkResult result = outcome(VK_SUCCESS);
    if (result != VK_SUCCESS)
        return result;
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

#define FAKE_CREATE(name, Info, Handle)                                                                                \
    static VKAPI_ATTR VkResult VKAPI_CALL name(VkDevice device, const Info *info, const VkAllocationCallbacks *allocator,  \
                                               Handle *out)                                                                \
    {                                                                                                                      \
        (void)device, (void)info, (void)allocator;                                                                         \
        VkResult result = outcome(VK_SUCCESS);                                                                             \
        if (result == VK_SUCCESS)                                                                                          \
            *out = (Handle)next_handle++;                                                                                  \
        return result;                                                                                                     \
    }
#define FAKE_DESTROY(name, Handle)                                                                                     \
    static VKAPI_ATTR void VKAPI_CALL name(VkDevice device, Handle handle, const VkAllocationCallbacks *allocator)         \
    {                                                                                                                      \
        (void)device, (void)handle, (void)allocator;                                                                       \
    }
FAKE_CREATE(create_set_layout, VkDescriptorSetLayoutCreateInfo, VkDescriptorSetLayout)
FAKE_CREATE(create_pipeline_layout, VkPipelineLayoutCreateInfo, VkPipelineLayout)
FAKE_CREATE(create_set_pool, VkDescriptorPoolCreateInfo, VkDescriptorPool)
FAKE_DESTROY(destroy_set_layout, VkDescriptorSetLayout)
FAKE_DESTROY(destroy_pipeline_layout, VkPipelineLayout)
FAKE_DESTROY(destroy_set_pool, VkDescriptorPool)
FAKE_DESTROY(destroy_pool, VkCommandPool)

static VKAPI_ATTR VkResult VKAPI_CALL allocate_sets(VkDevice device, const VkDescriptorSetAllocateInfo *info, VkDescriptorSet *out)
{
    (void)device;
    VkResult result = outcome(VK_SUCCESS);
    for (uint32_t i = 0; result == VK_SUCCESS && i < info->descriptorSetCount; i++)
        out[i] = (VkDescriptorSet)next_handle++;
    return result;
}

static VKAPI_ATTR void VKAPI_CALL update_sets(VkDevice device, uint32_t write_count, const VkWriteDescriptorSet *writes,
                                              uint32_t copy_count, const VkCopyDescriptorSet *copies)
{
    (void)device, (void)write_count, (void)writes, (void)copy_count, (void)copies;
}

static VKAPI_ATTR void VKAPI_CALL bind_sets(VkCommandBuffer commands, VkPipelineBindPoint point, VkPipelineLayout layout, uint32_t first,
                                            uint32_t count, const VkDescriptorSet *sets, uint32_t dynamic_count, const uint32_t *dynamics)
{
    (void)commands, (void)point, (void)layout, (void)first, (void)count, (void)sets, (void)dynamic_count, (void)dynamics;
}

static VKAPI_ATTR VkResult VKAPI_CALL wait_idle(VkDevice device)
{
    (void)device;
    return outcome(VK_SUCCESS);
}

static VKAPI_ATTR void VKAPI_CALL destroy_device(VkDevice device, const VkAllocationCallbacks *allocator)
{
    (void)device, (void)allocator;
}

static VKAPI_ATTR VkResult VKAPI_CALL create_fence(VkDevice device, const VkFenceCreateInfo *info,
                                                   const VkAllocationCallbacks *allocator, VkFence *out)
{
    (void)device, (void)info, (void)allocator;
    VkResult result = outcome(VK_SUCCESS);
    if (result != VK_SUCCESS)
        return result;
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
    return outcome(VK_SUCCESS);
}

int set_up(void **state)
{
    struct fixture *fixture = calloc(1, sizeof *fixture);
    struct gn_device *device = calloc(1, sizeof *device);
    staging = calloc(1, 1 << 20);
    submit_result = build_result = fence_status = query_result = VK_SUCCESS;
    one_address = 0;
    fail_at = calls_made = 0;
    compacted_size = 600;
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
                                           .CopyAccelerationStructureToMemoryKHR = copy_to_memory,
                                           .CopyMemoryToAccelerationStructureKHR = copy_from_memory,
                                           .WriteAccelerationStructuresPropertiesKHR = write_on_host,
                                           .DeferredOperationJoinKHR = deferred_join,
                                           .GetDeferredOperationResultKHR = deferred_result,
                                           .DestroyDeferredOperationKHR = deferred_destroy,
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
                                           .CreateDescriptorSetLayout = create_set_layout,
                                           .DestroyDescriptorSetLayout = destroy_set_layout,
                                           .CreatePipelineLayout = create_pipeline_layout,
                                           .DestroyPipelineLayout = destroy_pipeline_layout,
                                           .CreateDescriptorPool = create_set_pool,
                                           .DestroyDescriptorPool = destroy_set_pool,
                                           .AllocateDescriptorSets = allocate_sets,
                                           .UpdateDescriptorSets = update_sets,
                                           .CmdBindDescriptorSets = bind_sets,
                                           .DestroyCommandPool = destroy_pool,
                                           .DeviceWaitIdle = wait_idle,
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

int tear_down(void **state)
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

VkAccelerationStructureKHR make(struct fixture *fixture, VkAccelerationStructureTypeKHR type)
{
    VkAccelerationStructureCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
                                                 .type = type};
    VkAccelerationStructureKHR handle;
    assert_int_equal(gn_entry_CreateAccelerationStructureKHR(fixture->handle, &info, NULL, &handle), VK_SUCCESS);
    VkAccelerationStructureDeviceAddressInfoKHR query = {.accelerationStructure = handle};
    gn_entry_GetAccelerationStructureDeviceAddressKHR(fixture->handle, &query);
    return handle;
}

void job_fill(struct job *job, struct fixture *fixture, VkAccelerationStructureKHR target,
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

VkResult on_host(struct fixture *fixture, VkAccelerationStructureKHR target, VkAccelerationStructureTypeKHR type)
{
    struct job job;
    job_fill(&job, fixture, target, type);
    return gn_entry_BuildAccelerationStructuresKHR(fixture->handle, VK_NULL_HANDLE, 1, &job.info, &job.ranges);
}

void on_queue(struct fixture *fixture, int queue, int commands, VkAccelerationStructureKHR target,
                     VkAccelerationStructureTypeKHR type, VkFence fence)
{
    struct job job;
    VkCommandBuffer buffer = fixture->commands[commands];
    job_fill(&job, fixture, target, type);
    gn_entry_CmdBuildAccelerationStructuresKHR(buffer, 1, &job.info, &job.ranges);
    VkSubmitInfo info = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &buffer};
    gn_entry_QueueSubmit((VkQueue)(void *)&fake_queues[queue], 1, &info, fence);
}

unsigned long long unjudged(const struct fixture *fixture, enum gn_unjudged what)
{
    return atomic_load(&fixture->instance.tally.unjudged[what]);
}

void submit_one(struct fixture *fixture, int queue, int commands)
{
    VkSubmitInfo info = {
        .sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &fixture->commands[commands]};
    gn_entry_QueueSubmit((VkQueue)(void *)&fake_queues[queue], 1, &info, VK_NULL_HANDLE);
}

void update_on_queue(struct fixture *fixture, int queue, int commands, VkAccelerationStructureKHR blas)
{
    struct job job;
    job_fill(&job, fixture, blas, BOTTOM);
    job.info.mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
    job.info.srcAccelerationStructure = blas;
    gn_entry_CmdBuildAccelerationStructuresKHR(fixture->commands[commands], 1, &job.info, &job.ranges);
    submit_one(fixture, queue, commands);
}

unsigned long long checked(const struct fixture *fixture, enum gn_checked what)
{
    return atomic_load(&fixture->instance.tally.checked[what]);
}
