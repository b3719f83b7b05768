/* SPDX-License-Identifier: Apache-2.0 */
/* Barriers: what nothing orders is found, and whatever orders two commands keeps the layer silent. */
#include "tests/layer/trace.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BLAS VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR
#define BUILD VK_PIPELINE_STAGE_ACCELERATION_STRUCTURE_BUILD_BIT_KHR
#define COPY VK_PIPELINE_STAGE_TRANSFER_BIT
#define COMPUTE VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT
#define ALL VK_PIPELINE_STAGE_ALL_COMMANDS_BIT
#define READ VK_ACCESS_ACCELERATION_STRUCTURE_READ_BIT_KHR
#define WRITE VK_ACCESS_ACCELERATION_STRUCTURE_WRITE_BIT_KHR

/* How the two commands of a row are ordered. */
struct order {
    uint32_t count;
    struct {
        VkPipelineStageFlags from;
        VkAccessFlags available;
        VkPipelineStageFlags to;
        VkAccessFlags visible;
    } barriers[3];
    enum { PLAIN, SECOND_FORM, EVENT, SECONDARY, OTHER_COMMANDS, HOST_WAIT, BUFFER_RANGE, OTHER_RANGE } way;
};

struct step {
    struct world *world;
    VkCommandBuffer commands;
    struct buffer range; /* for barriers about a range */
};

static void barrier(struct step *step, const struct order *order, uint32_t i)
{
    VkMemoryBarrier memory = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                              .srcAccessMask = order->barriers[i].available,
                              .dstAccessMask = order->barriers[i].visible};
    VkMemoryBarrier2 wide = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER_2,
                             .srcStageMask = order->barriers[i].from,
                             .srcAccessMask = order->barriers[i].available,
                             .dstStageMask = order->barriers[i].to,
                             .dstAccessMask = order->barriers[i].visible};
    VkDependencyInfo info = {.sType = VK_STRUCTURE_TYPE_DEPENDENCY_INFO, .memoryBarrierCount = 1, .pMemoryBarriers = &wide};
    VkBufferMemoryBarrier range = {.sType = VK_STRUCTURE_TYPE_BUFFER_MEMORY_BARRIER,
                                   .srcAccessMask = order->barriers[i].available,
                                   .dstAccessMask = order->barriers[i].visible,
                                   .buffer = step->range.handle,
                                   .size = VK_WHOLE_SIZE};
    if (order->way == SECOND_FORM)
        vkCmdPipelineBarrier2(step->commands, &info);
    else if (order->way == BUFFER_RANGE || order->way == OTHER_RANGE)
        vkCmdPipelineBarrier(step->commands, order->barriers[i].from, order->barriers[i].to, 0, 0, NULL, 1, &range, 0, NULL);
    else
        vkCmdPipelineBarrier(step->commands, order->barriers[i].from, order->barriers[i].to, 0, 1, &memory, 0, NULL, 0, NULL);
}

/* Everything between the two commands. */
static void between(struct step *step, const struct order *order)
{
    struct world *world = step->world;
    if (order->way == OTHER_COMMANDS || order->way == HOST_WAIT) {
        commands_end(step->commands);
        submit(world, step->commands, VK_NULL_HANDLE);
        if (order->way == HOST_WAIT)
            vkQueueWaitIdle(world->queue);
        step->commands = commands_begin(world, 0);
    }
    if (order->way == SECONDARY) {
        struct step inner = {world, secondary_begin(world, 0), step->range};
        for (uint32_t i = 0; i < order->count; i++)
            barrier(&inner, order, i);
        commands_end(inner.commands);
        vkCmdExecuteCommands(step->commands, 1, &inner.commands);
        return;
    }
    if (order->way == EVENT) {
        VkEvent event;
        VkEventCreateInfo info = {.sType = VK_STRUCTURE_TYPE_EVENT_CREATE_INFO};
        VkMemoryBarrier memory = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                  .srcAccessMask = order->barriers[0].available,
                                  .dstAccessMask = order->barriers[0].visible};
        assert_int_equal(vkCreateEvent(world->device, &info, NULL, &event), VK_SUCCESS);
        vkCmdSetEvent(step->commands, event, order->barriers[0].from);
        vkCmdWaitEvents(step->commands, 1, &event, order->barriers[0].from, order->barriers[0].to, 1, &memory, 0, NULL, 0, NULL);
        commands_end(step->commands);
        submit_and_wait(world, step->commands);
        vkDestroyEvent(world->device, event, NULL);
        step->commands = commands_begin(world, 0);
        return;
    }
    for (uint32_t i = 0; i < order->count; i++)
        barrier(step, order, i);
}

static struct step begin(struct world *world)
{
    return (struct step){.world = world, .commands = commands_begin(world, 0)};
}

static void finish(struct step *step)
{
    commands_end(step->commands);
    submit_and_wait(step->world, step->commands);
}

static void build(struct world *world, struct structure *structure)
{
    struct step step = begin(world);
    commands_build_one(world, step.commands, structure);
    finish(&step);
}

static void blas_to_tlas(struct world *world, const struct order *order)
{
    struct structure blas = blas_create(world, BLAS, 0), tlas = tlas_create(world, 1);
    tlas_refer(&tlas, 0, blas.address);
    struct step step = begin(world);
    step.range = order->way == OTHER_RANGE ? blas.input : blas.storage;
    commands_build_one(world, step.commands, &blas);
    between(&step, order);
    commands_build_one(world, step.commands, &tlas);
    finish(&step);
    structure_destroy(world, &tlas);
    structure_destroy(world, &blas);
}

static void tlas_to(struct world *world, const struct order *order, enum trace_shader shader)
{
    struct structure tlas = tlas_create(world, 1);
    struct tracer tracer = tracer_create(world, shader, TRACE_BY_WRITE);
    tracer_refer(world, &tracer, tlas.handle);
    struct step step = begin(world);
    step.range = tlas.storage;
    commands_build_one(world, step.commands, &tlas);
    between(&step, order);
    commands_trace(world, step.commands, &tracer, tlas.handle, 1);
    finish(&step);
    tracer_destroy(world, &tracer);
    structure_destroy(world, &tlas);
}

static void tlas_to_trace(struct world *world, const struct order *order)
{
    tlas_to(world, order, TRACE_ALWAYS);
}

static void tlas_to_branch(struct world *world, const struct order *order)
{
    tlas_to(world, order, TRACE_MAYBE);
}

static void scratch(struct world *world, const struct order *order)
{
    struct structure first = tlas_create(world, 1), second = tlas_create(world, 1);
    VkDeviceAddress own = second.scratch.address;
    second.scratch.address = first.scratch.address;
    struct step step = begin(world);
    step.range = first.scratch;
    commands_build_one(world, step.commands, &first);
    between(&step, order);
    commands_build_one(world, step.commands, &second);
    finish(&step);
    second.scratch.address = own;
    structure_destroy(world, &first);
    structure_destroy(world, &second);
}

/* A BLAS whose input lies in a buffer that transfers may write. */
struct uploaded {
    struct structure blas;
    struct buffer own;
    struct step step;
};

static struct uploaded upload_begin(struct world *world)
{
    struct uploaded uploaded = {.blas = blas_create(world, BLAS, 0)};
    uploaded.own = uploaded.blas.input;
    uploaded.blas.input = buffer_create(world, 64, VK_BUFFER_USAGE_TRANSFER_DST_BIT |
                                                       VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR);
    uploaded.step = begin(world);
    uploaded.step.range = uploaded.blas.input;
    return uploaded;
}

static void upload_finish(struct world *world, struct uploaded *uploaded)
{
    finish(&uploaded->step);
    buffer_destroy(world, &uploaded->own);
    structure_destroy(world, &uploaded->blas);
}

static void upload(struct world *world, const struct order *order)
{
    struct uploaded uploaded = upload_begin(world);
    vkCmdUpdateBuffer(uploaded.step.commands, uploaded.blas.input.handle, 0, 36, uploaded.own.mapped);
    between(&uploaded.step, order);
    commands_build_one(world, uploaded.step.commands, &uploaded.blas);
    upload_finish(world, &uploaded);
}

/* Two writes that nothing orders, and a build that is ordered after both. */
static void two_uploads(struct world *world, const struct order *order)
{
    struct uploaded uploaded = upload_begin(world);
    vkCmdFillBuffer(uploaded.step.commands, uploaded.blas.input.handle, 0, 64, 0);
    vkCmdUpdateBuffer(uploaded.step.commands, uploaded.blas.input.handle, 0, 36, uploaded.own.mapped);
    between(&uploaded.step, order);
    commands_build_one(world, uploaded.step.commands, &uploaded.blas);
    upload_finish(world, &uploaded);
}

static void overwrite(struct world *world, const struct order *order)
{
    struct uploaded uploaded = upload_begin(world);
    commands_build_one(world, uploaded.step.commands, &uploaded.blas);
    between(&uploaded.step, order);
    vkCmdFillBuffer(uploaded.step.commands, uploaded.blas.input.handle, 0, 36, 0);
    upload_finish(world, &uploaded);
}

static void copy(struct world *world, const struct order *order)
{
    struct structure blas = blas_create(world, BLAS, 0), target = target_create(world, BLAS, blas.size);
    struct step step = begin(world);
    step.range = blas.storage;
    commands_build_one(world, step.commands, &blas);
    between(&step, order);
    VkCopyAccelerationStructureInfoKHR info = {.sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                                               .src = blas.handle,
                                               .dst = target.handle,
                                               .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR};
    world->CmdCopyAccelerationStructureKHR(step.commands, &info);
    finish(&step);
    structure_destroy(world, &target);
    structure_destroy(world, &blas);
}

static void question(struct world *world, const struct order *order)
{
    struct structure blas = blas_create(world, BLAS, VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR);
    VkQueryPoolCreateInfo info = {.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO,
                                  .queryType = VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR,
                                  .queryCount = 1};
    VkQueryPool pool;
    assert_int_equal(vkCreateQueryPool(world->device, &info, NULL, &pool), VK_SUCCESS);
    struct step step = begin(world);
    step.range = blas.storage;
    vkCmdResetQueryPool(step.commands, pool, 0, 1);
    commands_build_one(world, step.commands, &blas);
    between(&step, order);
    world->CmdWriteAccelerationStructuresPropertiesKHR(step.commands, 1, &blas.handle, info.queryType, pool, 0);
    finish(&step);
    vkDestroyQueryPool(world->device, pool, NULL);
    structure_destroy(world, &blas);
}

/* The scratch of the update is its own, so that only the structure is shared. */
static void update(struct world *world, const struct order *order)
{
    struct structure tlas = tlas_create(world, 1), other = tlas_create(world, 1);
    VkDeviceAddress own = tlas.scratch.address;
    struct step step = begin(world);
    step.range = tlas.storage;
    commands_build_one(world, step.commands, &tlas);
    between(&step, order);
    tlas.scratch.address = other.scratch.address;
    commands_update(world, step.commands, &tlas);
    finish(&step);
    tlas.scratch.address = own;
    structure_destroy(world, &other);
    structure_destroy(world, &tlas);
}

/* A trace, then a build of what it reads. */
static void trace_to_build(struct world *world, const struct order *order)
{
    struct structure tlas = tlas_create(world, 1);
    struct tracer tracer = tracer_create(world, TRACE_ALWAYS, TRACE_BY_WRITE);
    tracer_refer(world, &tracer, tlas.handle);
    build(world, &tlas);
    struct step step = begin(world);
    step.range = tlas.storage;
    commands_trace(world, step.commands, &tracer, tlas.handle, 1);
    between(&step, order);
    commands_build_one(world, step.commands, &tlas);
    finish(&step);
    tracer_destroy(world, &tracer);
    structure_destroy(world, &tlas);
}

/* Two structures with one memory, of which the second is built after the first. */
static void alias(struct world *world, const struct order *order)
{
    struct structure first = tlas_create(world, 1), second = tlas_create(world, 1);
    VkAccelerationStructureKHR own = second.handle;
    struct buffer storage = second.storage;
    second.storage = first.storage;
    structure_create_handle(world, &second, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR);
    struct step step = begin(world);
    step.range = first.storage;
    commands_build_one(world, step.commands, &first);
    between(&step, order);
    commands_build_one(world, step.commands, &second);
    finish(&step);
    structure_destroy_handle(world, &second);
    second.handle = own;
    second.storage = storage;
    structure_destroy(world, &second);
    structure_destroy(world, &first);
}

/* A structure in memory that may be scratch memory as well. */
static struct structure roomy_create(struct world *world, struct buffer *out_before)
{
    struct structure tlas = tlas_create(world, 1);
    *out_before = tlas.storage;
    structure_destroy_handle(world, &tlas);
    tlas.storage = buffer_create(world, 65536,
                                 VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR | VK_BUFFER_USAGE_STORAGE_BUFFER_BIT);
    structure_create_handle(world, &tlas, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR);
    return tlas;
}

static void scratch_at(struct world *world, const struct order *order, bool two)
{
    struct buffer before;
    struct structure first = roomy_create(world, &before), second = tlas_create(world, 1);
    struct structure *both[] = {&first, &second}, *scratches = two ? &second : &first;
    VkDeviceAddress own = scratches->scratch.address;
    scratches->scratch.address = first.storage.address + (order->count ? 32768 : 0);
    struct step step = begin(world);
    commands_build(world, step.commands, both, two ? 2 : 1);
    finish(&step);
    scratches->scratch.address = own;
    structure_destroy(world, &first);
    structure_destroy(world, &second);
    buffer_destroy(world, &before);
}

static void scratch_in_another(struct world *world, const struct order *order)
{
    scratch_at(world, order, true);
}

static void scratch_in_target(struct world *world, const struct order *order)
{
    scratch_at(world, order, false);
}

/* A chain through a stage that has nothing to do with either. */
#define CHAIN {2, {{BUILD, WRITE, COPY, 0}, {COPY, 0, BUILD, READ}}, PLAIN}
#define BROKEN_CHAIN {2, {{BUILD, WRITE, COPY, 0}, {COMPUTE, 0, BUILD, READ}}, PLAIN}

static const struct {
    const char *name, *rule;
    uint32_t findings;
    void (*run)(struct world *world, const struct order *order);
    struct order order;
    const char *says;
} rows[] = {
    {"BLAS to TLAS, nothing", "sync.blas_to_tlas", 1, blas_to_tlas, {0}, "nothing orders the two"},
    {"BLAS to TLAS", "sync.blas_to_tlas", 0, blas_to_tlas, {1, {{BUILD, WRITE, BUILD, READ}}, PLAIN}, NULL},
    {"BLAS to TLAS, no access at all", "sync.blas_to_tlas", 1, blas_to_tlas, {1, {{BUILD, 0, BUILD, 0}}, PLAIN},
     "do not make what the first writes available"},
    {"BLAS to TLAS, not made available", "sync.blas_to_tlas", 1, blas_to_tlas, {1, {{BUILD, READ, BUILD, READ}}, PLAIN},
     "srcAccessMask ACCELERATION_STRUCTURE_WRITE"},
    {"BLAS to TLAS, not made visible", "sync.blas_to_tlas", 1, blas_to_tlas, {1, {{BUILD, WRITE, BUILD, WRITE}}, PLAIN},
     "visible to the second"},
    {"BLAS to TLAS, wrong source stage", "sync.blas_to_tlas", 1, blas_to_tlas,
     {1, {{COPY, VK_ACCESS_TRANSFER_WRITE_BIT, BUILD, READ}}, PLAIN}, NULL},
    {"BLAS to TLAS, wrong destination stage", "sync.blas_to_tlas", 1, blas_to_tlas, {1, {{BUILD, WRITE, COMPUTE, READ}}, PLAIN}, NULL},
    {"BLAS to TLAS, all commands", "sync.blas_to_tlas", 0, blas_to_tlas,
     {1, {{ALL, VK_ACCESS_MEMORY_WRITE_BIT, ALL, VK_ACCESS_MEMORY_READ_BIT}}, PLAIN}, NULL},
    {"BLAS to TLAS, bottom to top", "sync.blas_to_tlas", 1, blas_to_tlas,
     {1, {{VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, 0, VK_PIPELINE_STAGE_TOP_OF_PIPE_BIT, 0}}, PLAIN}, "available"},
    {"BLAS to TLAS, a chain", "sync.blas_to_tlas", 0, blas_to_tlas, CHAIN, NULL},
    {"BLAS to TLAS, a chain that does not hold", "sync.blas_to_tlas", 1, blas_to_tlas, BROKEN_CHAIN, NULL},
    {"BLAS to TLAS, synchronization2", "sync.blas_to_tlas", 0, blas_to_tlas, {1, {{BUILD, WRITE, BUILD, READ}}, SECOND_FORM}, NULL},
    {"BLAS to TLAS, an event", "sync.blas_to_tlas", 0, blas_to_tlas, {1, {{BUILD, WRITE, BUILD, READ}}, EVENT}, NULL},
    {"BLAS to TLAS, in a secondary", "sync.blas_to_tlas", 0, blas_to_tlas, {1, {{BUILD, WRITE, BUILD, READ}}, SECONDARY}, NULL},
    {"BLAS to TLAS, a range", "sync.blas_to_tlas", 0, blas_to_tlas, {1, {{BUILD, WRITE, BUILD, READ}}, BUFFER_RANGE}, NULL},
    {"BLAS to TLAS, another range", "sync.blas_to_tlas", 1, blas_to_tlas, {1, {{BUILD, WRITE, BUILD, READ}}, OTHER_RANGE},
     "do not make what the first writes available"},
    {"BLAS to TLAS, two submissions", "sync.blas_to_tlas", 1, blas_to_tlas, {.way = OTHER_COMMANDS}, NULL},
    {"BLAS to TLAS, a barrier in the second submission", "sync.blas_to_tlas", 0, blas_to_tlas,
     {1, {{BUILD, WRITE, BUILD, READ}}, OTHER_COMMANDS}, NULL},
    {"BLAS to TLAS, a wait on the host", "sync.blas_to_tlas", 0, blas_to_tlas, {.way = HOST_WAIT}, NULL},

    {"TLAS to trace, nothing", "sync.tlas_to_trace", 1, tlas_to_trace, {0}, "traces rays through TLAS"},
    {"TLAS to trace", "sync.tlas_to_trace", 0, tlas_to_trace, {1, {{BUILD, WRITE, COMPUTE, READ}}, PLAIN}, NULL},
    {"TLAS to trace, the other stage", "sync.tlas_to_trace", 1, tlas_to_trace,
     {1, {{BUILD, WRITE, VK_PIPELINE_STAGE_FRAGMENT_SHADER_BIT, READ}}, PLAIN}, "dstStageMask COMPUTE_SHADER"},
    {"TLAS to a branch, nothing", "sync.tlas_to_trace_bound", 1, tlas_to_branch, {0}, "possibly traces"},
    {"TLAS to a branch", "sync.tlas_to_trace_bound", 0, tlas_to_branch, {1, {{BUILD, WRITE, COMPUTE, READ}}, PLAIN}, NULL},

    {"scratch, nothing", "sync.scratch", 1, scratch, {0}, "uses as scratch"},
    {"scratch", "sync.scratch", 0, scratch, {1, {{BUILD, WRITE, BUILD, READ | WRITE}}, PLAIN}, NULL},
    {"scratch, a range", "sync.scratch", 0, scratch, {1, {{BUILD, WRITE, BUILD, READ | WRITE}}, BUFFER_RANGE}, NULL},
    {"input, nothing", "sync.input", 1, upload, {0}, "dstAccessMask SHADER_READ"},
    {"input", "sync.input", 0, upload, {1, {{COPY, VK_ACCESS_TRANSFER_WRITE_BIT, BUILD, VK_ACCESS_SHADER_READ_BIT}}, PLAIN}, NULL},
    {"input, two writes", "sync.input", 0, two_uploads,
     {1, {{COPY, VK_ACCESS_TRANSFER_WRITE_BIT, BUILD, VK_ACCESS_SHADER_READ_BIT}}, PLAIN}, NULL},
    {"input, as a structure", "sync.input", 1, upload, {1, {{COPY, VK_ACCESS_TRANSFER_WRITE_BIT, BUILD, READ}}, PLAIN}, "visible"},
    {"input overwritten, nothing", "sync.input", 1, overwrite, {0}, "vkCmdFillBuffer"},
    {"input overwritten, execution only", "sync.input", 0, overwrite, {1, {{BUILD, 0, COPY, 0}}, PLAIN}, NULL},
    {"copy, nothing", "sync.structure", 1, copy, {0}, "copies BLAS"},
    {"copy", "sync.structure", 0, copy, {1, {{BUILD, WRITE, BUILD, READ}}, PLAIN}, NULL},
    {"question, nothing", "sync.structure", 1, question, {0}, "asks the size of"},
    {"question", "sync.structure", 0, question, {1, {{BUILD, WRITE, BUILD, READ}}, PLAIN}, NULL},
    {"update, nothing", "sync.structure", 1, update, {0}, "builds TLAS"},
    {"update", "sync.structure", 0, update, {1, {{BUILD, WRITE, BUILD, READ | WRITE}}, PLAIN}, NULL},
    {"trace, then build, nothing", "sync.structure", 1, trace_to_build, {0}, "srcStageMask COMPUTE_SHADER, srcAccessMask 0"},
    {"trace, then build, execution only", "sync.structure", 0, trace_to_build, {1, {{COMPUTE, 0, BUILD, 0}}, PLAIN}, NULL},
    {"scratch in another target", "build.overlap", 1, scratch_in_another, {0}, "are used twice in one command"},
    {"scratch behind another target", "build.overlap", 0, scratch_in_another, {.count = 1}, NULL},
    {"scratch in the target", "build.overlap", 1, scratch_in_target, {0}, "uses as scratch"},
    {"scratch behind the target", "build.overlap", 0, scratch_in_target, {.count = 1}, NULL},
    {"two in one memory, nothing", "sync.structure", 1, alias, {0}, NULL},
    {"two in one memory", "sync.structure", 0, alias, {1, {{BUILD, WRITE, BUILD, READ | WRITE}}, PLAIN}, NULL},
};

static void every_row(void **state)
{
    (void)state;
    const char *only = getenv("ROW");
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        if (only && strcmp(only, rows[i].name) != 0)
            continue;
        struct world *world = calloc(1, sizeof *world);
        print_message("    %s\n", rows[i].name);
        world_init(world, NULL);
        world->rule = rows[i].rule;
        rows[i].run(world, &rows[i].order);
        expect_findings(world, rows[i].findings);
        const struct message *message = messages_find(world, rows[i].rule);
        if (rows[i].says && (!message || !strstr(message->text, rows[i].says)))
            fail_msg("\"%s\" is not in: %s", rows[i].says, message ? message->text : "nothing");
        world_finish(world);
        free(world);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_row)};
    return cmocka_run_group_tests_name("sync", tests, NULL, NULL);
}
