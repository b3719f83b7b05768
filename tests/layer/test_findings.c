/* SPDX-License-Identifier: Apache-2.0 */
/* The rule end to end: one scenario per row, each a valid or an invalid use of acceleration structures on the real driver.
 * The table runs a second time above Khronos' validation with synchronization validation, which must not object to
 * anything. */
#include "checks/rules/instance.h"
#include "tests/layer/harness.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BLAS VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR
#define GENERIC VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR

/* What most scenarios need. */
struct scene {
    struct world *world;
    struct structure blas, tlas;
};

static struct scene scene_create(struct world *world)
{
    struct scene scene = {.world = world};
    scene.blas = blas_create(world, BLAS, VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR);
    scene.tlas = tlas_create(world, 1);
    tlas_refer(&scene.tlas, 0, scene.blas.address);
    return scene;
}

static void scene_destroy(struct scene *scene)
{
    structure_destroy(scene->world, &scene->tlas);
    structure_destroy(scene->world, &scene->blas);
}

static void run_build(struct world *world, struct structure *structure)
{
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, structure);
    commands_barrier(commands);
    commands_end(commands);
    submit_and_wait(world, commands);
}

static void never_built(struct world *world)
{
    struct scene scene = scene_create(world);
    structure_name(world, &scene.blas, "tree");
    structure_name(world, &scene.tlas, "scene");
    run_build(world, &scene.tlas);
    const struct message *message = messages_find(world, NEVER_BUILT);
    assert_non_null(message);
    assert_non_null(strstr(message->text, "instance 0 of 1 of TLAS \"scene\""));
    assert_non_null(strstr(message->text, "BLAS \"tree\""));
    assert_non_null(strstr(message->text, "Remedy: Build the BLAS"));
    assert_non_null(strstr(message->text, "WG-015"));
    assert_int_equal(message->severity, VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT);
    assert_int_equal(message->object_count, 2);
    assert_true(message->objects[0] == (uint64_t)scene.tlas.handle);
    assert_true(message->objects[1] == (uint64_t)scene.blas.handle);
    assert_string_equal(message->names[1], "tree");
    scene_destroy(&scene);
}

static void later_instance_named(struct world *world)
{
    struct scene scene = scene_create(world);
    struct structure tlas = tlas_create(world, 3), other = blas_create(world, BLAS, 0);
    run_build(world, &other);
    tlas_refer(&tlas, 0, other.address);
    tlas_refer(&tlas, 2, scene.blas.address);
    run_build(world, &tlas);
    const struct message *message = messages_find(world, NEVER_BUILT);
    assert_non_null(message);
    assert_non_null(strstr(message->text, "instance 2 of 3"));
    structure_destroy(world, &tlas);
    structure_destroy(world, &other);
    scene_destroy(&scene);
}

static void built_in_earlier_submission(struct world *world)
{
    struct scene scene = scene_create(world);
    run_build(world, &scene.blas);
    run_build(world, &scene.tlas);
    scene_destroy(&scene);
}

static void built_in_same_commands(struct world *world)
{
    struct scene scene = scene_create(world);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &scene.blas);
    commands_barrier(commands);
    commands_build_one(world, commands, &scene.tlas);
    commands_end(commands);
    submit_and_wait(world, commands);
    scene_destroy(&scene);
}

static void built_after_in_same_commands(struct world *world)
{
    struct scene scene = scene_create(world);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &scene.tlas);
    commands_barrier(commands);
    commands_build_one(world, commands, &scene.blas);
    commands_end(commands);
    submit_and_wait(world, commands);
    scene_destroy(&scene);
}

static void built_in_same_call(struct world *world)
{
    struct scene scene = scene_create(world);
    struct structure *both[] = {&scene.blas, &scene.tlas};
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build(world, commands, both, 2);
    commands_end(commands);
    submit_and_wait(world, commands);
    scene_destroy(&scene);
}

static void recorded_in_reverse(struct world *world)
{
    struct scene scene = scene_create(world);
    VkCommandBuffer top = commands_begin(world, 0);
    commands_build_one(world, top, &scene.tlas);
    commands_end(top);
    VkCommandBuffer bottom = commands_begin(world, 0);
    commands_build_one(world, bottom, &scene.blas);
    commands_barrier(bottom);
    commands_end(bottom);
    VkCommandBuffer both[] = {bottom, top};
    VkSubmitInfo info = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 2, .pCommandBuffers = both};
    assert_int_equal(vkQueueSubmit(world->queue, 1, &info, VK_NULL_HANDLE), VK_SUCCESS);
    assert_int_equal(vkQueueWaitIdle(world->queue), VK_SUCCESS);
    scene_destroy(&scene);
}

static void recorded_forward_submitted_in_reverse(struct world *world)
{
    struct scene scene = scene_create(world);
    VkCommandBuffer bottom = commands_begin(world, 0);
    commands_build_one(world, bottom, &scene.blas);
    commands_barrier(bottom);
    commands_end(bottom);
    VkCommandBuffer top = commands_begin(world, 0);
    commands_build_one(world, top, &scene.tlas);
    commands_barrier(top);
    commands_end(top);
    submit(world, top, VK_NULL_HANDLE);
    submit(world, bottom, VK_NULL_HANDLE);
    assert_int_equal(vkQueueWaitIdle(world->queue), VK_SUCCESS);
    scene_destroy(&scene);
}

static void submit2_and_wait(struct world *world, VkCommandBuffer commands)
{
    VkCommandBufferSubmitInfo buffer = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_SUBMIT_INFO, .commandBuffer = commands};
    VkSubmitInfo2 info = {
        .sType = VK_STRUCTURE_TYPE_SUBMIT_INFO_2, .commandBufferInfoCount = 1, .pCommandBufferInfos = &buffer};
    assert_int_equal(vkQueueSubmit2(world->queue, 1, &info, VK_NULL_HANDLE), VK_SUCCESS);
    assert_int_equal(vkDeviceWaitIdle(world->device), VK_SUCCESS);
}

static void never_built_submit2(struct world *world)
{
    struct scene scene = scene_create(world);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &scene.tlas);
    commands_end(commands);
    submit2_and_wait(world, commands);
    scene_destroy(&scene);
}

static void built_submit2(struct world *world)
{
    struct scene scene = scene_create(world);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &scene.blas);
    commands_barrier(commands);
    commands_build_one(world, commands, &scene.tlas);
    commands_end(commands);
    submit2_and_wait(world, commands);
    scene_destroy(&scene);
}

static void copy_into(struct world *world, const struct structure *from, const struct structure *to,
                      VkCopyAccelerationStructureModeKHR mode)
{
    VkCopyAccelerationStructureInfoKHR info = {.sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                                               .src = from->handle,
                                               .dst = to->handle,
                                               .mode = mode};
    VkCommandBuffer commands = commands_begin(world, 0);
    world->CmdCopyAccelerationStructureKHR(commands, &info);
    commands_barrier(commands);
    commands_end(commands);
    submit_and_wait(world, commands);
}

static void cloned(struct world *world)
{
    struct scene scene = scene_create(world);
    struct structure copy = target_create(world, BLAS, scene.blas.size);
    run_build(world, &scene.blas);
    copy_into(world, &scene.blas, &copy, VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR);
    tlas_refer(&scene.tlas, 0, copy.address);
    run_build(world, &scene.tlas);
    structure_destroy(world, &copy);
    scene_destroy(&scene);
}

static VkDeviceSize size_of(struct world *world, const struct structure *structure, VkQueryType type)
{
    VkQueryPool pool;
    VkQueryPoolCreateInfo info = {.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO, .queryType = type, .queryCount = 1};
    assert_int_equal(vkCreateQueryPool(world->device, &info, NULL, &pool), VK_SUCCESS);
    VkCommandBuffer commands = commands_begin(world, 0);
    vkCmdResetQueryPool(commands, pool, 0, 1);
    world->CmdWriteAccelerationStructuresPropertiesKHR(commands, 1, &structure->handle, type, pool, 0);
    commands_end(commands);
    submit_and_wait(world, commands);
    uint64_t size = 0;
    assert_int_equal(vkGetQueryPoolResults(world->device, pool, 0, 1, sizeof size, &size, sizeof size,
                                           VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT),
                     VK_SUCCESS);
    vkDestroyQueryPool(world->device, pool, NULL);
    assert_true(size > 0);
    return size;
}

static void compacted(struct world *world)
{
    struct scene scene = scene_create(world);
    run_build(world, &scene.blas);
    VkDeviceSize size = size_of(world, &scene.blas, VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR);
    struct structure copy = target_create(world, BLAS, size);
    copy_into(world, &scene.blas, &copy, VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR);
    tlas_refer(&scene.tlas, 0, copy.address);
    run_build(world, &scene.tlas);
    structure_destroy(world, &copy);
    scene_destroy(&scene);
}

static void compacted_but_refers_to_unfilled_copy(struct world *world)
{
    struct scene scene = scene_create(world);
    struct structure copy = target_create(world, BLAS, scene.blas.size);
    run_build(world, &scene.blas);
    tlas_refer(&scene.tlas, 0, copy.address);
    run_build(world, &scene.tlas);
    structure_destroy(world, &copy);
    scene_destroy(&scene);
}

static void deserialized(struct world *world)
{
    struct scene scene = scene_create(world);
    run_build(world, &scene.blas);
    VkDeviceSize size = size_of(world, &scene.blas, VK_QUERY_TYPE_ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR);
    struct buffer data = buffer_create(world, size + 256, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT |
                                                              VK_BUFFER_USAGE_TRANSFER_SRC_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT);
    VkDeviceAddress aligned = (data.address + 255) & ~(VkDeviceAddress)255;
    struct structure copy = target_create(world, BLAS, scene.blas.size);
    VkCommandBuffer commands = commands_begin(world, 0);
    VkCopyAccelerationStructureToMemoryInfoKHR out = {.sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_TO_MEMORY_INFO_KHR,
                                                      .src = scene.blas.handle,
                                                      .dst.deviceAddress = aligned,
                                                      .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_SERIALIZE_KHR};
    world->CmdCopyAccelerationStructureToMemoryKHR(commands, &out);
    commands_barrier(commands);
    VkCopyMemoryToAccelerationStructureInfoKHR in = {.sType = VK_STRUCTURE_TYPE_COPY_MEMORY_TO_ACCELERATION_STRUCTURE_INFO_KHR,
                                                     .src.deviceAddress = aligned,
                                                     .dst = copy.handle,
                                                     .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_DESERIALIZE_KHR};
    world->CmdCopyMemoryToAccelerationStructureKHR(commands, &in);
    commands_barrier(commands);
    tlas_refer(&scene.tlas, 0, copy.address);
    commands_build_one(world, commands, &scene.tlas);
    commands_end(commands);
    submit_and_wait(world, commands);
    structure_destroy(world, &copy);
    buffer_destroy(world, &data);
    scene_destroy(&scene);
}

static void rebuilt_and_updated(struct world *world)
{
    struct scene scene = scene_create(world);
    run_build(world, &scene.blas);
    run_build(world, &scene.tlas);
    run_build(world, &scene.blas);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_update(world, commands, &scene.tlas);
    commands_end(commands);
    submit_and_wait(world, commands);
    scene_destroy(&scene);
}

static void update_finds_it_too(struct world *world)
{
    struct scene scene = scene_create(world);
    tlas_refer(&scene.tlas, 0, 0);
    struct structure built = blas_create(world, BLAS, 0);
    run_build(world, &built);
    tlas_refer(&scene.tlas, 0, built.address);
    run_build(world, &scene.tlas);
    expect_findings(world, 0);
    tlas_refer(&scene.tlas, 0, scene.blas.address);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_update(world, commands, &scene.tlas);
    commands_end(commands);
    submit_and_wait(world, commands);
    structure_destroy(world, &built);
    scene_destroy(&scene);
}

static void null_reference(struct world *world)
{
    struct scene scene = scene_create(world);
    tlas_refer(&scene.tlas, 0, 0);
    run_build(world, &scene.tlas);
    scene_destroy(&scene);
}

static void no_instances(struct world *world)
{
    struct structure tlas = tlas_create(world, 0);
    run_build(world, &tlas);
    structure_destroy(world, &tlas);
}

static void recycled_and_built(struct world *world)
{
    struct scene scene = scene_create(world);
    VkDeviceAddress before = scene.blas.address;
    structure_destroy_handle(world, &scene.blas);
    structure_create_handle(world, &scene.blas, BLAS);
    assert_true(scene.blas.address == before);
    run_build(world, &scene.blas);
    run_build(world, &scene.tlas);
    scene_destroy(&scene);
}

/* A BLAS and a TLAS that share memory in turns, both alive; the TLAS is the newer of the two. */
static void aliased_by_tlas(struct world *world)
{
    struct scene scene = scene_create(world);
    struct structure over = tlas_create(world, 1);
    structure_destroy_handle(world, &over);
    structure_destroy_handle(world, &scene.blas);
    struct buffer own = scene.blas.storage;
    assert_true(scene.blas.size <= over.size);
    scene.blas.storage = over.storage;
    structure_create_handle(world, &scene.blas, BLAS);
    structure_create_handle(world, &over, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR);
    assert_true(scene.blas.address == over.address);
    tlas_refer(&scene.tlas, 0, scene.blas.address);
    run_build(world, &over);
    run_build(world, &scene.blas);
    run_build(world, &scene.tlas);
    scene.blas.storage = own;
    structure_destroy(world, &over);
    scene_destroy(&scene);
}

static void recycled_not_built(struct world *world)
{
    struct scene scene = scene_create(world);
    VkDeviceAddress before = scene.blas.address;
    run_build(world, &scene.blas);
    run_build(world, &scene.tlas);
    expect_findings(world, 0);
    structure_destroy_handle(world, &scene.blas);
    structure_create_handle(world, &scene.blas, BLAS);
    assert_true(scene.blas.address == before);
    run_build(world, &scene.tlas);
    scene_destroy(&scene);
}

static void destroyed_before_it_is_judged(struct world *world)
{
    struct scene scene = scene_create(world);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &scene.blas);
    commands_barrier(commands);
    commands_build_one(world, commands, &scene.tlas);
    commands_end(commands);
    VkSemaphoreTypeCreateInfo timeline = {.sType = VK_STRUCTURE_TYPE_SEMAPHORE_TYPE_CREATE_INFO,
                                          .semaphoreType = VK_SEMAPHORE_TYPE_TIMELINE};
    VkSemaphoreCreateInfo create = {.sType = VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO, .pNext = &timeline};
    VkSemaphore semaphore;
    assert_int_equal(vkCreateSemaphore(world->device, &create, NULL, &semaphore), VK_SUCCESS);
    uint64_t one = 1;
    VkTimelineSemaphoreSubmitInfo values = {.sType = VK_STRUCTURE_TYPE_TIMELINE_SEMAPHORE_SUBMIT_INFO,
                                            .signalSemaphoreValueCount = 1,
                                            .pSignalSemaphoreValues = &one};
    VkSubmitInfo info = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO,
                         .pNext = &values,
                         .commandBufferCount = 1,
                         .pCommandBuffers = &commands,
                         .signalSemaphoreCount = 1,
                         .pSignalSemaphores = &semaphore};
    assert_int_equal(vkQueueSubmit(world->queue, 1, &info, VK_NULL_HANDLE), VK_SUCCESS);
    VkSemaphoreWaitInfo wait = {.sType = VK_STRUCTURE_TYPE_SEMAPHORE_WAIT_INFO,
                                .semaphoreCount = 1,
                                .pSemaphores = &semaphore,
                                .pValues = &one};
    assert_int_equal(vkWaitSemaphores(world->device, &wait, UINT64_MAX), VK_SUCCESS);
    vkFreeCommandBuffers(world->device, world->pool, 1, &commands);
    structure_destroy_handle(world, &scene.blas);
    structure_create_handle(world, &scene.blas, BLAS);
    vkDestroySemaphore(world->device, semaphore, NULL);
    assert_int_equal(vkQueueWaitIdle(world->queue), VK_SUCCESS);
    scene_destroy(&scene);
}

static void generic_type(struct world *world)
{
    struct scene scene = scene_create(world);
    struct structure generic = blas_create(world, GENERIC, 0);
    run_build(world, &generic);
    tlas_refer(&scene.tlas, 0, generic.address);
    run_build(world, &scene.tlas);
    structure_destroy(world, &generic);
    scene_destroy(&scene);
}

static void generic_never_built(struct world *world)
{
    struct scene scene = scene_create(world);
    struct structure generic = blas_create(world, GENERIC, 0);
    tlas_refer(&scene.tlas, 0, generic.address);
    run_build(world, &scene.tlas);
    structure_destroy(world, &generic);
    scene_destroy(&scene);
}

/* The second execution is the same finding, counted, not told again; a third after the build stays silent. */
static void resubmitted(struct world *world)
{
    struct scene scene = scene_create(world);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &scene.tlas);
    commands_barrier(commands);
    commands_end(commands);
    submit_and_wait(world, commands);
    submit_and_wait(world, commands);
    run_build(world, &scene.blas);
    submit_and_wait(world, commands);
    scene_destroy(&scene);
}

/* Valid at first; then the records change from the host and the same commands run again. */
static void resubmitted_with_other_records(struct world *world)
{
    struct scene scene = scene_create(world);
    VkFence fence = fence_create(world);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &scene.tlas);
    commands_barrier(commands);
    commands_end(commands);
    tlas_refer(&scene.tlas, 0, 0);
    submit(world, commands, fence);
    assert_int_equal(vkWaitForFences(world->device, 1, &fence, VK_TRUE, UINT64_MAX), VK_SUCCESS);
    assert_int_equal(vkResetFences(world->device, 1, &fence), VK_SUCCESS);
    expect_findings(world, 0);
    tlas_refer(&scene.tlas, 0, scene.blas.address);
    submit(world, commands, fence);
    while (vkGetFenceStatus(world->device, fence) == VK_NOT_READY)
        ;
    expect_findings(world, 1);
    vkDestroyFence(world->device, fence, NULL);
    scene_destroy(&scene);
}

static void simultaneous_use(struct world *world)
{
    struct scene scene = scene_create(world);
    VkCommandBuffer commands = commands_begin(world, VK_COMMAND_BUFFER_USAGE_SIMULTANEOUS_USE_BIT);
    commands_build_one(world, commands, &scene.tlas);
    commands_barrier(commands);
    commands_end(commands);
    for (int i = 0; i < 8; i++)
        submit(world, commands, VK_NULL_HANDLE);
    assert_int_equal(vkDeviceWaitIdle(world->device), VK_SUCCESS);
    scene_destroy(&scene);
}

static void in_secondary(struct world *world)
{
    struct scene scene = scene_create(world);
    VkCommandBuffer secondary = secondary_begin(world, 0);
    commands_build_one(world, secondary, &scene.tlas);
    commands_end(secondary);
    VkCommandBuffer commands = commands_begin(world, 0);
    vkCmdExecuteCommands(commands, 1, &secondary);
    commands_end(commands);
    submit_and_wait(world, commands);
    scene_destroy(&scene);
}

static void built_in_secondary(struct world *world)
{
    struct scene scene = scene_create(world);
    VkCommandBuffer secondary = secondary_begin(world, 0);
    commands_build_one(world, secondary, &scene.blas);
    commands_barrier(secondary);
    commands_end(secondary);
    VkCommandBuffer commands = commands_begin(world, 0);
    vkCmdExecuteCommands(commands, 1, &secondary);
    commands_build_one(world, commands, &scene.tlas);
    commands_end(commands);
    submit_and_wait(world, commands);
    scene_destroy(&scene);
}

/* Recorded, and never executed: neither the build of the BLAS nor that of the TLAS happened. */
static void reset_before_submission(struct world *world)
{
    struct scene scene = scene_create(world);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &scene.tlas);
    commands_end(commands);
    assert_int_equal(vkResetCommandBuffer(commands, 0), VK_SUCCESS);
    VkCommandBufferBeginInfo info = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    assert_int_equal(vkBeginCommandBuffer(commands, &info), VK_SUCCESS);
    commands_end(commands);
    submit_and_wait(world, commands);
    scene_destroy(&scene);
}

/* The build of the BLAS is recorded, then thrown away in each of three ways, and what is submitted is empty. */
static void reset_bottom(struct world *world)
{
    struct scene scene = scene_create(world);
    VkCommandBufferBeginInfo info = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    for (int way = 0; way < 3; way++) {
        VkCommandBuffer commands = commands_begin(world, 0);
        commands_build_one(world, commands, &scene.blas);
        commands_end(commands);
        if (way == 0)
            assert_int_equal(vkResetCommandBuffer(commands, 0), VK_SUCCESS);
        else if (way == 1)
            assert_int_equal(vkResetCommandPool(world->device, world->pool, 0), VK_SUCCESS);
        assert_int_equal(vkBeginCommandBuffer(commands, &info), VK_SUCCESS);
        commands_end(commands);
        submit_and_wait(world, commands);
    }
    run_build(world, &scene.tlas);
    scene_destroy(&scene);
}

static void bottom_recorded_but_not_submitted(struct world *world)
{
    struct scene scene = scene_create(world);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &scene.blas);
    commands_end(commands);
    run_build(world, &scene.tlas);
    scene_destroy(&scene);
}

/* The instances are written on the device, by the command before the build. */
static void records_written_on_the_device(struct world *world)
{
    struct scene scene = scene_create(world);
    struct structure written = tlas_create(world, 1), *tlas = &written;
    buffer_destroy(world, &written.input);
    written.input = buffer_create(world, sizeof(VkAccelerationStructureInstanceKHR),
                                  VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR |
                                      VK_BUFFER_USAGE_TRANSFER_DST_BIT);
    VkAccelerationStructureInstanceKHR instance = *(VkAccelerationStructureInstanceKHR *)scene.tlas.input.mapped;
    VkCommandBuffer commands = commands_begin(world, 0);
    vkCmdUpdateBuffer(commands, written.input.handle, 0, sizeof instance, &instance);
    VkMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                               .srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT,
                               .dstAccessMask = VK_ACCESS_SHADER_READ_BIT};
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_ACCELERATION_STRUCTURE_BUILD_BIT_KHR, 0, 1,
                         &barrier, 0, NULL, 0, NULL);
    commands_build_one(world, commands, tlas);
    /* The records are cleared again, ordered after the build alone. */
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_ACCELERATION_STRUCTURE_BUILD_BIT_KHR, VK_PIPELINE_STAGE_TRANSFER_BIT, 0, 0,
                         NULL, 0, NULL, 0, NULL);
    vkCmdFillBuffer(commands, written.input.handle, 0, VK_WHOLE_SIZE, 0);
    commands_end(commands);
    submit_and_wait(world, commands);
    structure_destroy(world, &written);
    scene_destroy(&scene);
}

static void destroyed_reference(struct world *world)
{
    struct scene scene = scene_create(world);
    run_build(world, &scene.blas);
    structure_name(world, &scene.blas, "felled");
    structure_destroy_handle(world, &scene.blas);
    run_build(world, &scene.tlas);
    const struct message *message = messages_find(world, "instances.reference_unknown");
    assert_non_null(message);
    assert_non_null(strstr(message->text, "BLAS \"felled\""));
    assert_non_null(strstr(message->text, "which was destroyed"));
    scene_destroy(&scene);
}

static void misaligned_reference(struct world *world)
{
    struct scene scene = scene_create(world);
    struct structure tlas = tlas_create(world, 3);
    run_build(world, &scene.blas);
    tlas_refer(&tlas, 0, scene.blas.address);
    /* The driver reads it as a BLAS: a copy of the whole one, eight bytes on, where nobody else looks. */
    struct buffer copy = buffer_create(world, scene.blas.size + 512, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT);
    memcpy((char *)copy.mapped + 8, scene.blas.storage.mapped, scene.blas.size);
    tlas_refer(&tlas, 2, copy.address + 8);
    run_build(world, &tlas);
    const struct message *message = messages_find(world, "instances.reference_unknown");
    assert_non_null(message);
    assert_non_null(strstr(message->text, "instance 2 of 3"));
    assert_non_null(strstr(message->text, "a multiple of 256"));
    buffer_destroy(world, &copy);
    structure_destroy(world, &tlas);
    scene_destroy(&scene);
}

/* One active instance, changed before the build. */
static struct scene instance_begin(struct world *world)
{
    struct scene scene = scene_create(world);
    run_build(world, &scene.blas);
    return scene;
}

static void instance_end(struct scene *scene)
{
    run_build(scene->world, &scene->tlas);
    scene_destroy(scene);
}

static void reference_to_tlas(struct world *world)
{
    struct scene scene = instance_begin(world);
    struct structure inner = tlas_create(world, 1);
    tlas_refer(&inner, 0, scene.blas.address);
    run_build(world, &inner);
    tlas_refer(&scene.tlas, 0, inner.address);
    instance_end(&scene);
    structure_destroy(world, &inner);
}

static void reference_to_generic_tlas(struct world *world)
{
    struct scene scene = instance_begin(world);
    struct structure inner = tlas_create(world, 1);
    structure_destroy_handle(world, &inner);
    structure_create_handle(world, &inner, GENERIC);
    tlas_refer(&inner, 0, scene.blas.address);
    run_build(world, &inner);
    tlas_refer(&scene.tlas, 0, inner.address);
    instance_end(&scene);
    structure_destroy(world, &inner);
}

static void reserved_flags(struct world *world)
{
    struct scene scene = instance_begin(world);
    tlas_instance(&scene.tlas, 0)->flags = 0x81;
    instance_end(&scene);
    const struct message *message = messages_find(world, "instances.flags_reserved");
    assert_non_null(message);
    assert_non_null(strstr(message->text, "flags 0x81, of which 0x80 are not defined"));
}

static void defined_flags(struct world *world)
{
    struct scene scene = instance_begin(world);
    tlas_instance(&scene.tlas, 0)->flags = 0x07;
    tlas_instance(&scene.tlas, 0)->instanceShaderBindingTableRecordOffset = 0xFFFFFF;
    instance_end(&scene);
}

static void singular_matrix(struct world *world)
{
    static const VkTransformMatrixKHR flat = {{{0.1f, 0.3f, 0.7f, 1}, {0.2f, 0.6f, 1.4f, 2}, {5, 1, 3, 3}}};
    struct scene scene = instance_begin(world);
    tlas_instance(&scene.tlas, 0)->transform = flat;
    instance_end(&scene);
}

static void infinite_matrix(struct world *world)
{
    struct scene scene = instance_begin(world);
    tlas_instance(&scene.tlas, 0)->transform.matrix[1][1] = INFINITY;
    instance_end(&scene);
}

static void tiny_matrix(struct world *world)
{
    struct scene scene = instance_begin(world);
    for (int i = 0; i < 3; i++)
        tlas_instance(&scene.tlas, 0)->transform.matrix[i][i] = 1e-12f;
    instance_end(&scene);
}

static void inactive_garbage(struct world *world)
{
    struct scene scene = instance_begin(world);
    memset(tlas_instance(&scene.tlas, 0), 0xFF, sizeof(VkAccelerationStructureInstanceKHR));
    tlas_instance(&scene.tlas, 0)->accelerationStructureReference = 0;
    instance_end(&scene);
}

static void infinite_translation(struct world *world)
{
    struct scene scene = instance_begin(world);
    tlas_instance(&scene.tlas, 0)->transform.matrix[2][3] = -INFINITY;
    instance_end(&scene);
}

static void all_masks_zero(struct world *world)
{
    struct scene scene = instance_begin(world);
    tlas_instance(&scene.tlas, 0)->mask = 0;
    instance_end(&scene);
    const struct message *message = messages_find(world, "instances.mask_zero");
    assert_non_null(message);
    assert_int_equal(message->severity, VK_DEBUG_UTILS_MESSAGE_SEVERITY_INFO_BIT_EXT);
}

static void one_mask_zero(struct world *world)
{
    struct scene scene = instance_begin(world);
    struct structure tlas = tlas_create(world, 2);
    tlas_refer(&tlas, 0, scene.blas.address);
    tlas_refer(&tlas, 1, scene.blas.address);
    tlas_instance(&tlas, 0)->mask = 0;
    run_build(world, &tlas);
    structure_destroy(world, &tlas);
    instance_end(&scene);
}

/* Four instances whose word of index and mask is `first`, first + step, ... */
static void count_words(struct world *world, uint32_t first, uint32_t step)
{
    struct scene scene = instance_begin(world);
    struct structure tlas = tlas_create(world, 4);
    for (uint32_t i = 0; i < 4; i++) {
        tlas_refer(&tlas, i, scene.blas.address);
        uint32_t word = first + i * step;
        memcpy((char *)tlas_instance(&tlas, i) + 48, &word, sizeof word);
    }
    run_build(world, &tlas);
    structure_destroy(world, &tlas);
    scene_destroy(&scene);
}

static void index_runs_over(struct world *world)
{
    count_words(world, 0x01FFFFFD, 2);
}

static void full_indices_and_masks(struct world *world)
{
    count_words(world, 0x01FFFFFF, 0x01000000);
}

/* The TLAS has one instance with mask 1, custom index 7 and offset 9. */
static void declare(struct world *world, const struct gn_instance_tag *tag, size_t size)
{
    struct scene scene = scene_create(world);
    VkAccelerationStructureInstanceKHR *instance = tlas_instance(&scene.tlas, 0);
    instance->mask = 1;
    instance->instanceCustomIndex = 7;
    instance->instanceShaderBindingTableRecordOffset = 9;
    VkDebugUtilsObjectTagInfoEXT info = {.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_OBJECT_TAG_INFO_EXT,
                                         .objectType = VK_OBJECT_TYPE_ACCELERATION_STRUCTURE_KHR,
                                         .objectHandle = (uint64_t)scene.tlas.handle,
                                         .tagName = GN_INSTANCE_TAG,
                                         .tagSize = size,
                                         .pTag = tag};
    assert_int_equal(world->SetDebugUtilsObjectTagEXT(world->device, &info), VK_SUCCESS);
    run_build(world, &scene.blas);
    run_build(world, &scene.tlas);
    scene_destroy(&scene);
}

static void declared_mask(struct world *world)
{
    declare(world, &(struct gn_instance_tag){.masks = {1 << 2}}, sizeof(struct gn_instance_tag));
}

static void declared_index(struct world *world)
{
    declare(world, &(struct gn_instance_tag){.custom_index_bound = 7}, sizeof(struct gn_instance_tag));
}

static void declared_offset(struct world *world)
{
    declare(world, &(struct gn_instance_tag){.sbt_offset_bound = 9}, sizeof(struct gn_instance_tag));
}

static void declared_and_kept(struct world *world)
{
    declare(world, &(struct gn_instance_tag){.masks = {1 << 1}, .custom_index_bound = 8, .sbt_offset_bound = 10},
            sizeof(struct gn_instance_tag));
    declare(world, &(struct gn_instance_tag){.custom_index_bound = 7}, 4);
    assert_int_equal(messages_count(world, "tag"), 1);
}

static void rebuilt_in_same_call(struct world *world)
{
    struct scene scene = instance_begin(world);
    struct structure *both[] = {&scene.tlas, &scene.blas};
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build(world, commands, both, 2);
    commands_end(commands);
    submit_and_wait(world, commands);
    scene_destroy(&scene);
}

static void built_in_same_call_unrelated(struct world *world)
{
    struct scene scene = instance_begin(world);
    struct structure other = blas_create(world, BLAS, 0);
    struct structure *both[] = {&other, &scene.tlas};
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build(world, commands, both, 2);
    commands_end(commands);
    submit_and_wait(world, commands);
    structure_destroy(world, &other);
    scene_destroy(&scene);
}

static void same_call_twice(struct world *world)
{
    struct scene scene = scene_create(world);
    struct structure second = tlas_create(world, 1), other = blas_create(world, BLAS, 0);
    struct structure *bottom[] = {&scene.blas, &other}, *top[] = {&scene.tlas, &second};
    tlas_refer(&second, 0, other.address);
    VkCommandBuffer commands = commands_begin(world, 0);
    for (int i = 0; i < 2; i++) {
        commands_build(world, commands, bottom, 2);
        commands_barrier(commands);
        commands_build(world, commands, top, 2);
        commands_barrier(commands);
    }
    commands_end(commands);
    submit_and_wait(world, commands);
    submit_and_wait(world, commands);
    structure_destroy(world, &second);
    structure_destroy(world, &other);
    scene_destroy(&scene);
}

static void primitive_offset(struct world *world)
{
    struct scene scene = scene_create(world);
    struct structure tlas = tlas_create(world, 2);
    tlas_refer(&tlas, 1, scene.blas.address);
    VkAccelerationStructureGeometryKHR geometry = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR,
        .geometry.instances = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
                               .data.deviceAddress = tlas.input.address}};
    const VkAccelerationStructureGeometryKHR *pointer = &geometry;
    VkAccelerationStructureBuildGeometryInfoKHR build = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR,
        .flags = tlas.flags,
        .dstAccelerationStructure = tlas.handle,
        .geometryCount = 1,
        .ppGeometries = &pointer,
        .scratchData.deviceAddress = tlas.scratch.address};
    VkAccelerationStructureBuildRangeInfoKHR first = {.primitiveCount = 1}, second = first;
    second.primitiveOffset = sizeof(VkAccelerationStructureInstanceKHR);
    const VkAccelerationStructureBuildRangeInfoKHR *ranges = &first;
    VkCommandBuffer commands = commands_begin(world, 0);
    world->CmdBuildAccelerationStructuresKHR(commands, 1, &build, &ranges);
    commands_end(commands);
    submit_and_wait(world, commands);
    expect_findings(world, 0);
    ranges = &second;
    commands = commands_begin(world, 0);
    world->CmdBuildAccelerationStructuresKHR(commands, 1, &build, &ranges);
    commands_end(commands);
    submit_and_wait(world, commands);
    structure_destroy(world, &tlas);
    scene_destroy(&scene);
}

/* Transfer usage is added to the buffer of the records; every way to ask for its memory must agree. */
static void memory_requirements_agree(struct world *world)
{
    VkBufferUsageFlags2CreateInfoKHR wide = {
        .sType = VK_STRUCTURE_TYPE_BUFFER_USAGE_FLAGS_2_CREATE_INFO_KHR,
        .usage = VK_BUFFER_USAGE_2_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR |
                 VK_BUFFER_USAGE_2_SHADER_DEVICE_ADDRESS_BIT_KHR};
    VkBufferCreateInfo infos[2] = {
        {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
         .size = 4096,
         .usage = VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR |
                  VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT},
        {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, .pNext = &wide, .size = 4096},
    };
    for (int i = 0; i < 2; i++) {
        VkBuffer buffer;
        VkMemoryRequirements one;
        VkMemoryRequirements2 two = {.sType = VK_STRUCTURE_TYPE_MEMORY_REQUIREMENTS_2};
        VkDeviceBufferMemoryRequirements query = {.sType = VK_STRUCTURE_TYPE_DEVICE_BUFFER_MEMORY_REQUIREMENTS,
                                                  .pCreateInfo = &infos[i]};
        assert_int_equal(vkCreateBuffer(world->device, &infos[i], NULL, &buffer), VK_SUCCESS);
        vkGetBufferMemoryRequirements(world->device, buffer, &one);
        vkGetDeviceBufferMemoryRequirements(world->device, &query, &two);
        assert_true(one.size == two.memoryRequirements.size);
        assert_true(one.alignment == two.memoryRequirements.alignment);
        assert_int_equal(one.memoryTypeBits, two.memoryRequirements.memoryTypeBits);
        vkDestroyBuffer(world->device, buffer, NULL);
    }
    assert_int_equal(wide.usage & VK_BUFFER_USAGE_2_TRANSFER_SRC_BIT_KHR, 0);
}

/* The records lie in a buffer whose usage comes from the 64-bit flags. */
static void wide_usage_flags(struct world *world)
{
    struct scene scene = scene_create(world);
    VkBufferUsageFlags2CreateInfoKHR wide = {
        .sType = VK_STRUCTURE_TYPE_BUFFER_USAGE_FLAGS_2_CREATE_INFO_KHR,
        .usage = VK_BUFFER_USAGE_2_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR |
                 VK_BUFFER_USAGE_2_SHADER_DEVICE_ADDRESS_BIT_KHR};
    VkBufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, .pNext = &wide, .size = 64};
    vkDestroyBuffer(world->device, scene.tlas.input.handle, NULL);
    assert_int_equal(vkCreateBuffer(world->device, &info, NULL, &scene.tlas.input.handle), VK_SUCCESS);
    VkBindBufferMemoryInfo bind = {.sType = VK_STRUCTURE_TYPE_BIND_BUFFER_MEMORY_INFO,
                                   .buffer = scene.tlas.input.handle,
                                   .memory = scene.tlas.input.memory};
    assert_int_equal(vkBindBufferMemory2(world->device, 1, &bind), VK_SUCCESS);
    VkBufferDeviceAddressInfo query = {.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO,
                                       .buffer = scene.tlas.input.handle};
    scene.tlas.input.address = vkGetBufferDeviceAddress(world->device, &query);
    run_build(world, &scene.tlas);
    scene_destroy(&scene);
}

static void nothing_waited_for(struct world *world)
{
    struct scene scene = scene_create(world);
    VkFence fence = fence_create(world);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &scene.tlas);
    commands_end(commands);
    submit(world, commands, fence);
    assert_int_equal(vkWaitForFences(world->device, 1, &fence, VK_TRUE, UINT64_MAX), VK_SUCCESS);
    vkDestroyFence(world->device, fence, NULL);
    scene_destroy(&scene);
}

/* The memory goes on behind the buffer, so that the driver survives it. */
static void shorten_input(struct world *world, struct structure *structure, VkDeviceSize size)
{
    buffer_destroy(world, &structure->input);
    structure->input = buffer_create(world, 4096, VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR);
    vkDestroyBuffer(world->device, structure->input.handle, NULL);
    VkBufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                               .size = size,
                               .usage = VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR |
                                        VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT};
    assert_int_equal(vkCreateBuffer(world->device, &info, NULL, &structure->input.handle), VK_SUCCESS);
    assert_int_equal(vkBindBufferMemory(world->device, structure->input.handle, structure->input.memory, 0), VK_SUCCESS);
    VkBufferDeviceAddressInfo query = {.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO,
                                       .buffer = structure->input.handle};
    structure->input.address = vkGetBufferDeviceAddress(world->device, &query);
}

static void build_at_offset(struct world *world, struct structure *structure, VkDeviceSize size, uint32_t offset)
{
    shorten_input(world, structure, size);
    structure->offset = offset;
    structure_name(world, structure, "subject");
    run_build(world, structure);
}

static void vertices_beyond_buffer(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, 0);
    build_at_offset(world, &blas, 64, 32);
    const struct message *message = messages_find(world, "inputs.beyond_buffer");
    assert_non_null(message);
    assert_non_null(strstr(message->text, "triangles.vertexData of pInfos[0].pGeometries[0], for BLAS \"subject\""));
    structure_destroy(world, &blas);
}

static void instances_beyond_buffer(struct world *world)
{
    struct structure tlas = tlas_create(world, 2);
    build_at_offset(world, &tlas, 191, 64);
    structure_destroy(world, &tlas);
}

static void input_up_to_the_end(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, 0), tlas = tlas_create(world, 2);
    build_at_offset(world, &blas, 68, 32);
    build_at_offset(world, &tlas, 192, 64);
    structure_destroy(world, &tlas);
    structure_destroy(world, &blas);
}

static void vertices_beyond_announced(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, 0);
    blas.max_vertex = 1;
    run_build(world, &blas);
    structure_destroy(world, &blas);
}

static void build_two(struct world *world, struct structure *first, struct structure *second, bool at_once)
{
    struct structure *both[] = {first, second};
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build(world, commands, both, at_once ? 2 : 1);
    commands_barrier(commands);
    if (!at_once)
        commands_build_one(world, commands, second);
    commands_end(commands);
    submit_and_wait(world, commands);
}

static void one_target_twice(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, 0), other = blas_create(world, BLAS, 0), again = blas;
    again.scratch = other.scratch;
    build_two(world, &blas, &again, true);
    structure_destroy(world, &other);
    structure_destroy(world, &blas);
}

static void one_scratch(struct world *world, bool at_once)
{
    struct structure first = blas_create(world, BLAS, 0), second = blas_create(world, BLAS, 0);
    struct buffer own = second.scratch;
    second.scratch = first.scratch;
    build_two(world, &first, &second, at_once);
    second.scratch = own;
    structure_destroy(world, &second);
    structure_destroy(world, &first);
}

static void one_scratch_twice(struct world *world)
{
    one_scratch(world, true);
}

static void one_scratch_in_turns(struct world *world)
{
    one_scratch(world, false);
}

static void faults_that_were_not_submitted(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, 0), *both[] = {&blas, &blas};
    VkCommandBuffer commands = commands_begin(world, 0);
    world->above_khronos = false;
    commands_build(world, commands, both, 2);
    commands_end(commands);
    structure_destroy(world, &blas);
}

static void run_update(struct world *world, struct structure *structure)
{
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_update(world, commands, structure);
    commands_barrier(commands);
    commands_end(commands);
    submit_and_wait(world, commands);
}

#define UPDATABLE VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR
#define COMPACTABLE VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR
#define COMPACTED_SIZE VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR

static void updated(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, UPDATABLE);
    run_build(world, &blas);
    run_update(world, &blas);
    run_update(world, &blas);
    structure_destroy(world, &blas);
}

static void updated_after_a_build_with_other_flags(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, UPDATABLE);
    blas.flags = 0;
    run_build(world, &blas);
    blas.flags = UPDATABLE;
    run_build(world, &blas);
    run_update(world, &blas);
    structure_destroy(world, &blas);
}

static void update_and_build(struct world *world, bool build_first)
{
    struct structure blas = blas_create(world, BLAS, UPDATABLE);
    VkCommandBuffer update = commands_begin(world, 0), build = commands_begin(world, 0);
    commands_update(world, update, &blas);
    commands_barrier(update);
    commands_end(update);
    commands_build_one(world, build, &blas);
    commands_barrier(build);
    commands_end(build);
    submit_and_wait(world, build_first ? build : update);
    submit_and_wait(world, build_first ? update : build);
    structure_destroy(world, &blas);
}

/* Khronos' layer compares with the build that was recorded last, and objects. */
static void update_recorded_before_the_build(struct world *world)
{
    world->above_khronos = false;
    update_and_build(world, true);
}

static void update_submitted_before_the_build(struct world *world)
{
    update_and_build(world, false);
}

static void update_of_unbuilt(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, UPDATABLE);
    structure_name(world, &blas, "tree");
    run_update(world, &blas);
    const struct message *message = messages_find(world, "update.source_never_built");
    assert_non_null(message);
    assert_non_null(strstr(message->text, "BLAS \"tree\""));
    assert_non_null(strstr(message->text, "in queue submission 1"));
    structure_destroy(world, &blas);
}

/* The second time it is counted, not told again. */
static void update_not_allowed(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, 0);
    run_build(world, &blas);
    run_update(world, &blas);
    run_update(world, &blas);
    structure_destroy(world, &blas);
}

static void update_of_clone_not_allowed(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, 0), copy = blas_create(world, BLAS, 0);
    run_build(world, &blas);
    copy_into(world, &blas, &copy, VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR);
    run_update(world, &copy);
    structure_destroy(world, &copy);
    structure_destroy(world, &blas);
}

static void update_with_other_flags(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, UPDATABLE);
    run_build(world, &blas);
    blas.flags |= VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR;
    run_update(world, &blas);
    structure_destroy(world, &blas);
}

static void update_with_other_opacity(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, UPDATABLE);
    run_build(world, &blas);
    blas.geometry_flags = VK_GEOMETRY_OPAQUE_BIT_KHR;
    run_update(world, &blas);
    structure_destroy(world, &blas);
}

static void update_with_fewer(struct world *world)
{
    struct structure tlas = tlas_create(world, 2);
    run_build(world, &tlas);
    tlas.count = 1;
    run_update(world, &tlas);
    structure_destroy(world, &tlas);
}

static void clone_of_unbuilt(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, 0), copy = target_create(world, BLAS, blas.size);
    copy_into(world, &blas, &copy, VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR);
    structure_destroy(world, &copy);
    structure_destroy(world, &blas);
}

static void ask_size(struct world *world, const struct structure *structure, VkQueryType type)
{
    VkQueryPool pool;
    VkQueryPoolCreateInfo info = {.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO, .queryType = type, .queryCount = 1};
    assert_int_equal(vkCreateQueryPool(world->device, &info, NULL, &pool), VK_SUCCESS);
    VkCommandBuffer commands = commands_begin(world, 0);
    vkCmdResetQueryPool(commands, pool, 0, 1);
    world->CmdWriteAccelerationStructuresPropertiesKHR(commands, 1, &structure->handle, type, pool, 0);
    commands_end(commands);
    submit_and_wait(world, commands);
    vkDestroyQueryPool(world->device, pool, NULL);
}

static void size_of_unbuilt(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, 0);
    ask_size(world, &blas, VK_QUERY_TYPE_ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR);
    structure_destroy(world, &blas);
}

static void compacted_size_not_allowed(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, 0);
    run_build(world, &blas);
    ask_size(world, &blas, COMPACTED_SIZE);
    structure_destroy(world, &blas);
}

static void compaction_not_allowed(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, 0), copy = target_create(world, BLAS, blas.size);
    run_build(world, &blas);
    copy_into(world, &blas, &copy, VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR);
    structure_destroy(world, &copy);
    structure_destroy(world, &blas);
}

/* A target whose memory is as large as that of `like`, but which was created with `size` bytes of it. */
static struct structure narrow_target(struct world *world, const struct structure *like, VkDeviceSize size)
{
    struct structure target = target_create(world, BLAS, like->size);
    structure_destroy_handle(world, &target);
    target.size = size;
    structure_create_handle(world, &target, BLAS);
    return target;
}

static void compact_into(struct world *world, const struct structure *from, VkDeviceSize size)
{
    struct structure target = narrow_target(world, from, size);
    copy_into(world, from, &target, VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR);
    structure_destroy(world, &target);
}

static void compacted_into_too_little(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, COMPACTABLE);
    run_build(world, &blas);
    compact_into(world, &blas, size_of(world, &blas, COMPACTED_SIZE) - 1);
    structure_destroy(world, &blas);
}

/* One byte less than the whole: a size that must have come from somewhere. */
static void compacted_after_rebuild(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, COMPACTABLE);
    run_build(world, &blas);
    size_of(world, &blas, COMPACTED_SIZE);
    run_build(world, &blas);
    compact_into(world, &blas, blas.size - 1);
    structure_destroy(world, &blas);
}

static void compacted_after_update(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, COMPACTABLE | UPDATABLE);
    run_build(world, &blas);
    VkDeviceSize size = size_of(world, &blas, COMPACTED_SIZE);
    run_update(world, &blas);
    compact_into(world, &blas, size);
    structure_destroy(world, &blas);
}

static void compacted_after_rebuild_asked_again(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, COMPACTABLE);
    run_build(world, &blas);
    size_of(world, &blas, COMPACTED_SIZE);
    run_build(world, &blas);
    compact_into(world, &blas, size_of(world, &blas, COMPACTED_SIZE));
    structure_destroy(world, &blas);
}

static void compacted_after_rebuild_into_plenty(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, COMPACTABLE);
    run_build(world, &blas);
    size_of(world, &blas, COMPACTED_SIZE);
    run_build(world, &blas);
    compact_into(world, &blas, blas.size);
    structure_destroy(world, &blas);
}

static void compacted_twice(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, COMPACTABLE);
    run_build(world, &blas);
    struct structure copy = narrow_target(world, &blas, size_of(world, &blas, COMPACTED_SIZE));
    copy_into(world, &blas, &copy, VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR);
    compact_into(world, &copy, copy.size);
    structure_destroy(world, &copy);
    structure_destroy(world, &blas);
}

static void compacted_and_updated(struct world *world)
{
    struct structure blas = blas_create(world, BLAS, COMPACTABLE | UPDATABLE), copy = blas_create(world, BLAS, blas.flags);
    run_build(world, &blas);
    copy_into(world, &blas, &copy, VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR);
    run_update(world, &copy);
    structure_destroy(world, &copy);
    structure_destroy(world, &blas);
}

static const struct scenario {
    const char *name, *why;
    void (*run)(struct world *world);
    uint32_t findings;
    const char *rule, *profile;
} scenarios[] = {
#define FIRES(scenario, count, why) {#scenario, why, scenario, count, NEVER_BUILT, "vulkan"},
#define SILENT(scenario, why) {#scenario, why, scenario, 0, NEVER_BUILT, "vulkan"},
#define FIRES_RULE(scenario, rule, why) {#scenario, why, scenario, 1, rule, "vulkan"},
#define FIRES_IN(profile, scenario, rule, why) {#scenario " in " profile, why, scenario, 1, rule, profile},
#define SILENT_IN(profile, scenario, why) {#scenario " in " profile, why, scenario, 0, NEVER_BUILT, profile},
    FIRES(never_built, 1, "created, referred to, never built")
    SILENT(built_in_earlier_submission, "the usual way")
    FIRES(later_instance_named, 1, "the offending one among several instances")
    SILENT(built_in_same_commands, "earlier in the same command buffer")
    FIRES(built_after_in_same_commands, 1, "later in the same command buffer is too late")
    FIRES_RULE(built_in_same_call, "build.order.same_call", "nothing orders two builds of one command")
    FIRES_RULE(rebuilt_in_same_call, "build.order.same_call", "the BLAS was built before, and is being built again")
    SILENT(built_in_same_call_unrelated, "a BLAS that no instance refers to may be built beside the TLAS")
    SILENT(same_call_twice, "the commands of one recording are told apart")
    SILENT(recorded_in_reverse, "recording order means nothing")
    FIRES(recorded_forward_submitted_in_reverse, 1, "submission order is what counts")
    FIRES(never_built_submit2, 1, "vkQueueSubmit2 is replayed as well")
    SILENT(built_submit2, "vkQueueSubmit2 is replayed as well")
    SILENT(cloned, "a clone of a built structure is built")
    SILENT(compacted, "a compacted copy is built")
    FIRES(compacted_but_refers_to_unfilled_copy, 1, "the copy was never made")
    SILENT(deserialized, "a deserialized structure is built")
    SILENT(rebuilt_and_updated, "built more than once")
    FIRES(update_finds_it_too, 1, "an update reads instances too")
    SILENT(null_reference, "0 is an inactive instance")
    SILENT(no_instances, "an empty TLAS")
    SILENT(recycled_and_built, "the address now belongs to a built structure")
    SILENT(aliased_by_tlas, "a newer TLAS at the address held something before the BLAS was built over it")
    FIRES(recycled_not_built, 1, "the former owner of the address was built, this one is not")
    SILENT(destroyed_before_it_is_judged, "it was built and alive when the device read it")
    SILENT(generic_type, "GENERIC is legal")
    FIRES(generic_never_built, 1, "GENERIC has to be built as well")
    FIRES(resubmitted, 1, "one site, however often it runs")
    FIRES(resubmitted_with_other_records, 1, "contents are those of the execution")
    FIRES(simultaneous_use, 1, "the last execution is judged")
    FIRES(in_secondary, 1, "a secondary is executed where it is called")
    SILENT(built_in_secondary, "a secondary is executed where it is called")
    SILENT(reset_before_submission, "what was never submitted did not happen")
    FIRES(reset_bottom, 1, "what was reset did not happen")
    FIRES(bottom_recorded_but_not_submitted, 1, "what was never submitted did not happen")
    FIRES(records_written_on_the_device, 1, "records are read when the device reads them")
    FIRES_RULE(destroyed_reference, "instances.reference_unknown", "the BLAS was destroyed before the submission")
    FIRES_RULE(misaligned_reference, "instances.reference_unknown", "an address inside of a BLAS")
    FIRES_RULE(reference_to_tlas, "instances.reference_tlas", "a TLAS in a TLAS")
    FIRES_RULE(reference_to_generic_tlas, "instances.reference_tlas", "GENERIC, built as a TLAS")
    FIRES_RULE(reserved_flags, "instances.flags_reserved", "bits that nothing defines")
    SILENT(defined_flags, "every flag of Vulkan")
    FIRES_RULE(singular_matrix, "instances.matrix_singular", "a row is a multiple of another")
    FIRES_RULE(infinite_matrix, "instances.matrix_singular", "a scale of infinity")
    SILENT(tiny_matrix, "invertible, however small")
    SILENT(inactive_garbage, "an inactive instance is not judged")
    FIRES_RULE(infinite_translation, "instances.translation_not_finite", "moved to infinity")
    FIRES_RULE(all_masks_zero, "instances.mask_zero", "nothing can be hit")
    SILENT(one_mask_zero, "one of two is hidden")
    FIRES_RULE(index_runs_over, "instances.custom_index_overflow", "an index that counts through 2^24")
    FIRES_RULE(declared_mask, "instances.mask_undeclared", "the tag says mask 2")
    FIRES_RULE(declared_index, "instances.custom_index_bound", "the tag says below 7")
    FIRES_RULE(declared_offset, "instances.sbt_offset_bound", "the tag says below 9")
    SILENT(declared_and_kept, "as the tag says; and a tag of another size says nothing")
    SILENT(full_indices_and_masks, "the highest index and other masks beside each other")
    FIRES(primitive_offset, 1, "the range's offset selects the records")
    SILENT(memory_requirements_agree, "added usage shows in every query alike")
    FIRES(wide_usage_flags, 1, "usage flags of 64 bits")
    FIRES(nothing_waited_for, 1, "the fence is destroyed at once after the wait")
    SILENT_IN("wgpu", built_in_same_call, "wgpu puts them in order")

    FIRES_RULE(vertices_beyond_buffer, "inputs.beyond_buffer", "the offset moves them out of the buffer")
    FIRES_RULE(instances_beyond_buffer, "inputs.beyond_buffer", "the offset moves the last one out of the buffer")
    SILENT(input_up_to_the_end, "the last element ends with the buffer")
    FIRES_RULE(vertices_beyond_announced, "inputs.beyond_max_vertex", "two of three are announced")
    FIRES_RULE(one_target_twice, "build.same_target", "two builds of one BLAS in one command")
    FIRES_RULE(one_scratch_twice, "build.same_scratch", "two builds in the same scratch memory")
    SILENT(one_scratch_in_turns, "one after the other, with a barrier")
    SILENT(faults_that_were_not_submitted, "what was never submitted did not happen")

    SILENT(updated, "built with ALLOW_UPDATE, and nothing changed")
    SILENT(updated_after_a_build_with_other_flags, "the last build counts")
    SILENT(update_recorded_before_the_build, "submission order is what counts")
    FIRES_RULE(update_submitted_before_the_build, "update.source_never_built", "submission order is what counts")
    FIRES_RULE(update_of_unbuilt, "update.source_never_built", "there is nothing to start from")
    FIRES_RULE(update_not_allowed, "update.not_allowed", "the flag is missing in the build")
    FIRES_RULE(update_of_clone_not_allowed, "update.not_allowed", "a clone is as its source was built")
    FIRES_RULE(update_with_other_flags, "update.flags_changed", "another hint")
    FIRES_RULE(update_with_other_opacity, "update.geometry_changed", "opaque now")
    FIRES_RULE(update_with_fewer, "update.count_changed", "two instances, then one")
    FIRES_RULE(clone_of_unbuilt, "copy.source_never_built", "there is nothing to copy")
    FIRES_IN("webgpu-rt", cloned, "copy.target_never_built", "Vulkan does not ask for that")
    FIRES_RULE(size_of_unbuilt, "query.never_built", "it has no size yet")
    FIRES_RULE(compacted_size_not_allowed, "compaction.query_not_allowed", "the flag is missing in the build")
    FIRES_RULE(compaction_not_allowed, "compaction.not_allowed", "the flag is missing in the build")
    FIRES_RULE(compacted_into_too_little, "compaction.target_too_small", "one byte less than reported")
    FIRES_RULE(compacted_after_rebuild, "compaction.size_outdated", "the size belongs to the build before")
    SILENT(compacted_after_update, "an update in place does not change the size")
    SILENT(compacted_after_rebuild_asked_again, "the size belongs to the last build")
    SILENT(compacted_after_rebuild_into_plenty, "the size of the source always suffices")
    SILENT(compacted_twice, "no use, but valid")
    FIRES_IN("wgpu", compacted_twice, "compaction.repeated", "wgpu forbids it")
    SILENT(compacted_and_updated, "valid where the size suffices")
    FIRES_IN("wgpu", compacted_and_updated, "compaction.rebuilt", "wgpu forbids it")
};

#define SCENARIO_COUNT (sizeof scenarios / sizeof scenarios[0])

static void run_scenario(void **state)
{
    const struct scenario *scenario = *state;
    struct world *world = calloc(1, sizeof *world);
    assert_non_null(world);
    setenv("VK_GNOMON_RAY_TRACING_PROFILE", scenario->profile, 1);
    world_init(world, NULL);
    world->rule = scenario->rule;
    scenario->run(world);
    expect_findings(world, scenario->findings);
    world_finish(world);
    free(world);
}

/* Without this, the run above Khronos' layer could pass because that layer is asleep. */
static void khronos_listens(void **state)
{
    (void)state;
    struct world *world = calloc(1, sizeof *world);
    assert_non_null(world);
    world_init(world, NULL);
    struct buffer buffer = buffer_create(world, 64, VK_BUFFER_USAGE_TRANSFER_DST_BIT);
    VkCommandBuffer commands = commands_begin(world, 0);
    vkCmdFillBuffer(commands, buffer.handle, 0, 64, 1);
    vkCmdFillBuffer(commands, buffer.handle, 0, 64, 2);
    commands_end(commands);
    submit_and_wait(world, commands);
    buffer_destroy(world, &buffer);
    assert_int_equal(messages_count(world, "SYNC-HAZARD-WRITE-AFTER-WRITE"), 1);
    world->above_khronos = false;
    world_finish(world);
    free(world);
}

int main(void)
{
    struct CMUnitTest tests[SCENARIO_COUNT + 1];
    size_t count = 0;
    for (; count < SCENARIO_COUNT; count++)
        tests[count] = (struct CMUnitTest){.name = scenarios[count].name,
                                           .test_func = run_scenario,
                                           .initial_state = (void *)(uintptr_t)&scenarios[count]};
    if (getenv("GNOMON_TEST_BENEATH"))
        tests[count++] = (struct CMUnitTest)cmocka_unit_test(khronos_listens);
    return _cmocka_run_group_tests("findings", tests, count, NULL, NULL);
}
