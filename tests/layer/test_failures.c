/* SPDX-License-Identifier: Apache-2.0 */
/* The next layer fails at the n-th call, for every n, and the application destroys what it has in every order: nothing may break, and nothing
 * may be said that is not so. Run it under AddressSanitizer, which sees what is left over. */
#include "tests/layer/fake.h"

#include <stdlib.h>
#include <string.h>

enum { BLAS_AT, CLONE_AT, TLAS_AT, BUFFER_AT, QUERIES_AT, COMMANDS_AT, LAYOUT_AT, PIPELINE_LAYOUT_AT, SETS_AT, FENCE_AT, OBJECTS };

/* What the application has; 0: it was not to be had. */
struct application {
    struct fixture *fixture;
    uint64_t objects[OBJECTS];
    VkCommandBuffer commands;
    VkDescriptorSet set;
    bool built; /* or about to be */
    bool lost; /* a call has failed that nothing can go on after */
};

static bool good(struct application *application, VkResult result)
{
    application->lost |= result == VK_ERROR_DEVICE_LOST;
    return result >= 0;
}

static uint64_t structure(struct application *application, VkAccelerationStructureTypeKHR type)
{
    VkAccelerationStructureCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
                                                 .buffer = (VkBuffer)application->objects[BUFFER_AT],
                                                 .size = 4096,
                                                 .type = type};
    VkAccelerationStructureKHR handle;
    if (!good(application, gn_entry_CreateAccelerationStructureKHR(application->fixture->handle, &info, NULL, &handle)))
        return 0;
    VkAccelerationStructureDeviceAddressInfoKHR query = {.accelerationStructure = handle};
    gn_entry_GetAccelerationStructureDeviceAddressKHR(application->fixture->handle, &query);
    return (uint64_t)handle;
}

static void create_all(struct application *application)
{
    VkDevice device = application->fixture->handle;
    uint64_t *objects = application->objects;
    VkBufferCreateInfo buffer = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                                 .size = 4096,
                                 .usage = VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR};
    if (good(application, gn_entry_CreateBuffer(device, &buffer, NULL, (VkBuffer *)&objects[BUFFER_AT])))
        good(application, gn_entry_BindBufferMemory(device, (VkBuffer)objects[BUFFER_AT], (VkDeviceMemory)(uintptr_t)0x77, 0));
    objects[BLAS_AT] = structure(application, BOTTOM);
    objects[CLONE_AT] = structure(application, BOTTOM);
    objects[TLAS_AT] = structure(application, TOP);
    VkQueryPoolCreateInfo queries = {.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO,
                                     .queryType = VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR,
                                     .queryCount = 1};
    good(application, gn_entry_CreateQueryPool(device, &queries, NULL, (VkQueryPool *)&objects[QUERIES_AT]));
    VkCommandPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO};
    good(application, gn_entry_CreateCommandPool(device, &pool, NULL, (VkCommandPool *)&objects[COMMANDS_AT]));
    VkCommandBufferAllocateInfo commands = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                            .commandPool = (VkCommandPool)objects[COMMANDS_AT],
                                            .commandBufferCount = 1};
    if (!objects[COMMANDS_AT] || !good(application, gn_entry_AllocateCommandBuffers(device, &commands, &application->commands)))
        application->commands = NULL;
    const VkDescriptorSetLayoutBinding binding = {
        .descriptorType = VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, .descriptorCount = 1, .stageFlags = VK_SHADER_STAGE_ALL};
    VkDescriptorSetLayoutCreateInfo layout = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO, .bindingCount = 1, .pBindings = &binding};
    good(application, gn_entry_CreateDescriptorSetLayout(device, &layout, NULL, (VkDescriptorSetLayout *)&objects[LAYOUT_AT]));
    VkPipelineLayoutCreateInfo pipeline_layout = {.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                                  .setLayoutCount = 1,
                                                  .pSetLayouts = (VkDescriptorSetLayout *)&objects[LAYOUT_AT]};
    if (objects[LAYOUT_AT])
        good(application, gn_entry_CreatePipelineLayout(device, &pipeline_layout, NULL, (VkPipelineLayout *)&objects[PIPELINE_LAYOUT_AT]));
    VkDescriptorPoolSize size = {VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, 1};
    VkDescriptorPoolCreateInfo sets = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO, .maxSets = 1, .poolSizeCount = 1, .pPoolSizes = &size};
    good(application, gn_entry_CreateDescriptorPool(device, &sets, NULL, (VkDescriptorPool *)&objects[SETS_AT]));
    VkDescriptorSetAllocateInfo set = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                       .descriptorPool = (VkDescriptorPool)objects[SETS_AT],
                                       .descriptorSetCount = 1,
                                       .pSetLayouts = (VkDescriptorSetLayout *)&objects[LAYOUT_AT]};
    if (!objects[SETS_AT] || !objects[LAYOUT_AT] || !good(application, gn_entry_AllocateDescriptorSets(device, &set, &application->set)))
        application->set = VK_NULL_HANDLE;
    VkFenceCreateInfo fence = {.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    good(application, application->fixture->device->next.CreateFence(device, &fence, NULL, (VkFence *)&objects[FENCE_AT]));
}

static void use_all(struct application *application, bool wait)
{
    struct fixture *fixture = application->fixture;
    const uint64_t *objects = application->objects;
    VkAccelerationStructureKHR blas = (VkAccelerationStructureKHR)objects[BLAS_AT], tlas = (VkAccelerationStructureKHR)objects[TLAS_AT];
    VkAccelerationStructureKHR clone = (VkAccelerationStructureKHR)objects[CLONE_AT];
    if (!blas || !tlas || !clone)
        return;
    if (application->set) {
        VkWriteDescriptorSetAccelerationStructureKHR structures = {
            .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET_ACCELERATION_STRUCTURE_KHR,
            .accelerationStructureCount = 1,
            .pAccelerationStructures = &tlas};
        VkWriteDescriptorSet write = {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                      .pNext = &structures,
                                      .dstSet = application->set,
                                      .descriptorCount = 1,
                                      .descriptorType = VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR};
        gn_entry_UpdateDescriptorSets(fixture->handle, 1, &write, 0, NULL);
    }
    struct job jobs[2];
    job_fill(&jobs[0], fixture, blas, BOTTOM);
    job_fill(&jobs[1], fixture, tlas, TOP);
    jobs[0].info.flags = VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR;
    VkCopyAccelerationStructureInfoKHR copy = {.src = blas, .dst = clone};
    if (application->commands) {
        fixture->record.accelerationStructureReference = (uint64_t)blas << 8;
        gn_entry_CmdBuildAccelerationStructuresKHR(application->commands, 1, &jobs[0].info, &jobs[0].ranges);
        gn_entry_CmdBuildAccelerationStructuresKHR(application->commands, 1, &jobs[1].info, &jobs[1].ranges);
        gn_entry_CmdCopyAccelerationStructureKHR(application->commands, &copy);
        if (objects[QUERIES_AT])
            gn_entry_CmdWriteAccelerationStructuresPropertiesKHR(application->commands, 1, &blas,
                                                                 VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR,
                                                                 (VkQueryPool)objects[QUERIES_AT], 0);
        if (application->set && objects[PIPELINE_LAYOUT_AT])
            gn_entry_CmdBindDescriptorSets(application->commands, VK_PIPELINE_BIND_POINT_COMPUTE,
                                           (VkPipelineLayout)objects[PIPELINE_LAYOUT_AT], 0, 1, &application->set, 0, NULL);
        VkSubmitInfo info = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &application->commands};
        VkFence fence = (VkFence)objects[FENCE_AT];
        for (int times = 0; times < 2 && !application->lost; times++) {
            bool sent = good(application, gn_entry_QueueSubmit((VkQueue)(void *)&fake_queues[0], 1, &info, times ? VK_NULL_HANDLE : fence));
            application->built |= sent;
            if (sent && !times && fence && good(application, gn_entry_WaitForFences(fixture->handle, 1, &fence, VK_TRUE, UINT64_MAX)))
                good(application, gn_entry_ResetFences(fixture->handle, 1, &fence));
        }
        uint64_t size;
        if (objects[QUERIES_AT] && !application->lost)
            good(application, gn_entry_GetQueryPoolResults(fixture->handle, (VkQueryPool)objects[QUERIES_AT], 0, 1, sizeof size, &size,
                                                           sizeof size, VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT));
    }
    if (application->built && !application->lost)
        good(application, gn_entry_CopyAccelerationStructureKHR(fixture->handle, (VkDeferredOperationKHR)(uintptr_t)0xDEF, &copy));
    if (wait && !application->lost)
        good(application, gn_entry_DeviceWaitIdle(fixture->handle));
}

static void destroy(struct application *application, int which)
{
    VkDevice device = application->fixture->handle;
    uint64_t object = application->objects[which];
    if (!object)
        return;
    switch (which) {
    case BUFFER_AT: gn_entry_DestroyBuffer(device, (VkBuffer)object, NULL); break;
    case QUERIES_AT: gn_entry_DestroyQueryPool(device, (VkQueryPool)object, NULL); break;
    case COMMANDS_AT: gn_entry_DestroyCommandPool(device, (VkCommandPool)object, NULL); break;
    case LAYOUT_AT: gn_entry_DestroyDescriptorSetLayout(device, (VkDescriptorSetLayout)object, NULL); break;
    case PIPELINE_LAYOUT_AT: gn_entry_DestroyPipelineLayout(device, (VkPipelineLayout)object, NULL); break;
    case SETS_AT: gn_entry_DestroyDescriptorPool(device, (VkDescriptorPool)object, NULL); break;
    case FENCE_AT: gn_entry_DestroyFence(device, (VkFence)object, NULL); break;
    default: gn_entry_DestroyAccelerationStructureKHR(device, (VkAccelerationStructureKHR)object, NULL); break;
    }
}

/* Returns how many calls the next layer got. */
static uint32_t run(void **state, uint32_t at, VkResult with, const int order[OBJECTS], bool wait)
{
    assert_int_equal(set_up(state), 0);
    struct application application = {.fixture = *state};
    calls_made = 0;
    fail_at = at;
    fail_with = with;
    create_all(&application);
    use_all(&application, wait);
    for (int i = 0; i < OBJECTS; i++)
        destroy(&application, order[i]);
    fail_at = 0;
    gn_device_collect(application.fixture->device);
    assert_int_equal(application.fixture->instance.findings, 0);
    uint32_t made = calls_made;
    tear_down(state);
    return made;
}

static const int usual_order[OBJECTS] = {SETS_AT,   PIPELINE_LAYOUT_AT, LAYOUT_AT, COMMANDS_AT, QUERIES_AT,
                                         FENCE_AT, TLAS_AT,             CLONE_AT,  BLAS_AT,     BUFFER_AT};

static void every_call_fails_once(void **state)
{
    static const VkResult errors[] = {VK_ERROR_OUT_OF_HOST_MEMORY, VK_ERROR_OUT_OF_DEVICE_MEMORY, VK_ERROR_DEVICE_LOST};
    for (size_t e = 0; e < sizeof errors / sizeof errors[0]; e++) {
        uint32_t calls = run(state, 0, errors[e], usual_order, true);
        assert_true(calls > 20);
        for (uint32_t at = 1; at <= calls; at++)
            run(state, at, errors[e], usual_order, true);
    }
}

/* Every object is destroyed before every other one, waited for or not. */
static void destroyed_in_any_order(void **state)
{
    uint32_t seed = 1;
    for (int times = 0; times < 400; times++) {
        int order[OBJECTS];
        memcpy(order, usual_order, sizeof order);
        for (int i = OBJECTS - 1; i > 0; i--) {
            seed = seed * 1664525u + 1013904223u;
            int other = (int)((seed >> 16) % (uint32_t)(i + 1)), kept = order[i];
            order[i] = order[other];
            order[other] = kept;
        }
        run(state, 0, VK_SUCCESS, order, times % 2 == 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_call_fails_once), cmocka_unit_test(destroyed_in_any_order)};
    return cmocka_run_group_tests_name("failures", tests, NULL, NULL);
}
