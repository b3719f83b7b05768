/* SPDX-License-Identifier: Apache-2.0 */
/* Parts of the layer that no driver here reaches: several queues, failures of the next layer; and maps and ranges, compared with plain
 * loops. */
#include "tests/layer/fake.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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
    const VkDeviceAddress addresses[2] = {1, 1};
    const uint32_t strides[2] = {16, 16}, maximum = 1, *maxima[2] = {&maximum, &maximum};
    gn_entry_CmdBuildAccelerationStructuresIndirectKHR(fixture->commands[0], 2, infos, addresses, strides, maxima);
    VkSubmitInfo info = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = fixture->commands};
    gn_entry_QueueSubmit((VkQueue)(void *)&fake_queues[0], 1, &info, VK_NULL_HANDLE);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_indirect_builds), 2);
    fixture->record.accelerationStructureReference = (uint64_t)blas << 8;
    on_queue(fixture, 0, 1, tlas, TOP, VK_NULL_HANDLE);
    gn_device_collect(fixture->device);
    assert_int_equal(fixture->instance.findings, 0);
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
        cmocka_unit_test_setup_teardown(two_queues_are_not_judged_by_submission_order, set_up, tear_down),
        cmocka_unit_test_setup_teardown(an_indirect_build_counts_as_built, set_up, tear_down),
        cmocka_unit_test_setup_teardown(an_update_that_may_follow_a_build_is_not_accused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(an_update_beside_the_build_of_its_source, set_up, tear_down),
        cmocka_unit_test_setup_teardown(nothing_is_accused_beside_commands_that_are_not_followed, set_up, tear_down),
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
