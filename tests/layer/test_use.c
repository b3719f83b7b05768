/* SPDX-License-Identifier: Apache-2.0 */
/* TLASes in use: what a trace finds in them, end to end. The table runs a second time above Khronos' validation. */
#include "tests/layer/trace.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BLAS VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR

struct scene {
    struct structure blas, tlas;
    struct tracer tracer;
};

static void build(struct world *world, struct structure *structure)
{
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, structure);
    commands_barrier(commands);
    commands_end(commands);
    submit_and_wait(world, commands);
}

static void trace(struct world *world, struct scene *scene, uint32_t groups)
{
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_trace(world, commands, &scene->tracer, scene->tlas.handle, groups);
    commands_end(commands);
    submit_and_wait(world, commands);
}

static struct scene scene_create(struct world *world, enum trace_shader shader, enum trace_way way)
{
    struct scene scene = {.blas = blas_create(world, BLAS,
                                              VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR |
                                                  VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR),
                          .tlas = tlas_create(world, 1),
                          .tracer = tracer_create(world, shader, way)};
    structure_name(world, &scene.blas, "tree");
    tlas_refer(&scene.tlas, 0, scene.blas.address);
    build(world, &scene.blas);
    build(world, &scene.tlas);
    if (way == TRACE_BY_BUFFER)
        tracer_describe(world, &scene.tracer, scene.tlas.address);
    else if (way != TRACE_BY_PUSH && way != TRACE_BY_PUSH_TEMPLATE)
        tracer_refer(world, &scene.tracer, scene.tlas.handle);
    return scene;
}

static void scene_destroy(struct world *world, struct scene *scene)
{
    tracer_destroy(world, &scene->tracer);
    structure_destroy(world, &scene->tlas);
    if (scene->blas.handle)
        structure_destroy_handle(world, &scene->blas);
    buffer_destroy(world, &scene->blas.storage);
    buffer_destroy(world, &scene->blas.scratch);
    buffer_destroy(world, &scene->blas.input);
}

static void valid(struct world *world)
{
    for (int way = 0; way < TRACE_WAYS; way++) {
        struct scene scene = scene_create(world, TRACE_ALWAYS, (enum trace_way)way);
        trace(world, &scene, 1);
        assert_int_equal(*(uint32_t *)scene.tracer.hits.mapped, 1);
        scene_destroy(world, &scene);
    }
}

/* However the TLAS got into the descriptor. */
static void destroyed(struct world *world)
{
    for (int way = 0; way < TRACE_WAYS; way++) {
        struct scene scene = scene_create(world, TRACE_ALWAYS, (enum trace_way)way);
        structure_destroy_handle(world, &scene.blas);
        trace(world, &scene, 1);
        scene_destroy(world, &scene);
    }
    const struct message *message = messages_find(world, "use.blas_destroyed");
    assert_non_null(message);
    assert_non_null(strstr(message->text, "1 of the 1 BLASes"));
    assert_non_null(strstr(message->text, "BLAS \"tree\""));
    assert_non_null(strstr(message->text, "vkCmdDispatch of command buffer"));
}

/* The address belongs to a BLAS again, which the TLAS was built from anew. */
static void destroyed_and_built_anew(struct world *world)
{
    struct scene scene = scene_create(world, TRACE_ALWAYS, TRACE_BY_WRITE);
    structure_destroy_handle(world, &scene.blas);
    structure_create_handle(world, &scene.blas, BLAS);
    build(world, &scene.blas);
    build(world, &scene.tlas);
    trace(world, &scene, 1);
    scene_destroy(world, &scene);
}

static void dropped_before_destroyed(struct world *world)
{
    struct scene scene = scene_create(world, TRACE_ALWAYS, TRACE_BY_WRITE);
    tlas_refer(&scene.tlas, 0, 0);
    build(world, &scene.tlas);
    structure_destroy_handle(world, &scene.blas);
    trace(world, &scene, 1);
    assert_int_equal(*(uint32_t *)scene.tracer.hits.mapped, 0);
    scene_destroy(world, &scene);
}

static void destroyed_after_the_trace(struct world *world)
{
    struct scene scene = scene_create(world, TRACE_ALWAYS, TRACE_BY_WRITE);
    trace(world, &scene, 1);
    structure_destroy_handle(world, &scene.blas);
    scene_destroy(world, &scene);
}

static void buffer_gone(struct world *world)
{
    struct scene scene = scene_create(world, TRACE_MAYBE, TRACE_BY_WRITE);
    buffer_destroy(world, &scene.blas.storage);
    trace(world, &scene, 1);
    assert_non_null(strstr(messages_find(world, "use.blas_destroyed_bound")->text, "lost their buffer"));
    scene_destroy(world, &scene);
}

/* The memory stays, so that the driver survives. */
static void buffer_gone_and_traced(struct world *world)
{
    struct scene scene = scene_create(world, TRACE_ALWAYS, TRACE_BY_WRITE);
    vkDestroyBuffer(world->device, scene.blas.storage.handle, NULL);
    scene.blas.storage.handle = VK_NULL_HANDLE;
    trace(world, &scene, 1);
    assert_non_null(strstr(messages_find(world, "use.blas_destroyed")->text, "lost their buffer"));
    scene_destroy(world, &scene);
}

static void memory_gone(struct world *world)
{
    struct scene scene = scene_create(world, TRACE_MAYBE, TRACE_BY_WRITE);
    vkFreeMemory(world->device, scene.blas.storage.memory, NULL);
    scene.blas.storage.memory = VK_NULL_HANDLE;
    trace(world, &scene, 1);
    assert_non_null(strstr(messages_find(world, "use.blas_destroyed_bound")->text, "lost their buffer or memory"));
    scene_destroy(world, &scene);
}

static void compacted_away(struct world *world)
{
    struct scene scene = scene_create(world, TRACE_ALWAYS, TRACE_BY_WRITE);
    struct structure small = target_create(world, BLAS, scene.blas.size);
    structure_name(world, &small, "small");
    VkCommandBuffer commands = commands_begin(world, 0);
    VkCopyAccelerationStructureInfoKHR copy = {.sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                                               .src = scene.blas.handle,
                                               .dst = small.handle,
                                               .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR};
    world->CmdCopyAccelerationStructureKHR(commands, &copy);
    commands_barrier(commands);
    commands_end(commands);
    submit_and_wait(world, commands);
    structure_destroy_handle(world, &scene.blas);
    trace(world, &scene, 1);
    assert_non_null(strstr(messages_find(world, "use.blas_destroyed")->text, "copied before into BLAS \"small\""));
    /* And as it should be. */
    tlas_refer(&scene.tlas, 0, small.address);
    build(world, &scene.tlas);
    trace(world, &scene, 1);
    structure_destroy(world, &small);
    scene_destroy(world, &scene);
}

static void branch_not_taken(struct world *world)
{
    struct scene scene = scene_create(world, TRACE_MAYBE, TRACE_BY_WRITE);
    structure_destroy_handle(world, &scene.blas);
    trace(world, &scene, 1);
    assert_int_equal(messages_find(world, "use.blas_destroyed_bound")->severity, VK_DEBUG_UTILS_MESSAGE_SEVERITY_INFO_BIT_EXT);
    scene_destroy(world, &scene);
}

/* The descriptor holds no TLAS any more when the command runs. */
static void overwritten_by_a_buffer(struct world *world)
{
    struct scene scene = scene_create(world, TRACE_MAYBE, TRACE_BY_MUTABLE);
    structure_destroy_handle(world, &scene.blas);
    tracer_refer_other(world, &scene.tracer);
    trace(world, &scene, 1);
    scene_destroy(world, &scene);
}

static void array_of_descriptors(struct world *world)
{
    struct scene scene = scene_create(world, TRACE_ARRAY, TRACE_BY_WRITE);
    structure_destroy_handle(world, &scene.blas);
    trace(world, &scene, 1);
    scene_destroy(world, &scene);
}

static void rebuilt(struct world *world)
{
    struct scene scene = scene_create(world, TRACE_ALWAYS, TRACE_BY_WRITE);
    build(world, &scene.blas);
    trace(world, &scene, 1);
    scene_destroy(world, &scene);
}

static void rebuilt_with_the_tlas(struct world *world)
{
    struct scene scene = scene_create(world, TRACE_ALWAYS, TRACE_BY_WRITE);
    for (int frame = 0; frame < 3; frame++) {
        VkCommandBuffer commands = commands_begin(world, 0);
        commands_build_one(world, commands, &scene.blas);
        commands_barrier(commands);
        commands_update(world, commands, &scene.tlas);
        commands_barrier(commands);
        commands_trace(world, commands, &scene.tracer, scene.tlas.handle, 1);
        commands_barrier(commands);
        commands_end(commands);
        submit(world, commands, VK_NULL_HANDLE);
    }
    vkQueueWaitIdle(world->queue);
    scene_destroy(world, &scene);
}

/* All in one submission: what the TLAS holds is known only afterwards. */
static void updated_between_build_and_trace(struct world *world)
{
    struct scene scene = scene_create(world, TRACE_ALWAYS, TRACE_BY_WRITE);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &scene.tlas);
    commands_barrier(commands);
    commands_update(world, commands, &scene.blas);
    commands_barrier(commands);
    commands_trace(world, commands, &scene.tracer, scene.tlas.handle, 1);
    commands_barrier(commands);
    commands_build_one(world, commands, &scene.tlas);
    commands_end(commands);
    submit_and_wait(world, commands);
    scene_destroy(world, &scene);
}

static void never_built(struct world *world)
{
    struct scene scene = scene_create(world, TRACE_MAYBE, TRACE_BY_WRITE);
    struct structure tlas = tlas_create(world, 1);
    tracer_refer(world, &scene.tracer, tlas.handle);
    trace(world, &scene, 1);
    structure_destroy(world, &tlas);
    scene_destroy(world, &scene);
}

static void nothing_dispatched(struct world *world)
{
    struct scene scene = scene_create(world, TRACE_ALWAYS, TRACE_BY_WRITE);
    struct structure tlas = tlas_create(world, 1);
    tracer_refer(world, &scene.tracer, tlas.handle);
    trace(world, &scene, 0);
    assert_int_equal(messages_find(world, "use.tlas_never_built_bound")->severity, VK_DEBUG_UTILS_MESSAGE_SEVERITY_INFO_BIT_EXT);
    structure_destroy(world, &tlas);
    scene_destroy(world, &scene);
}

static const struct {
    const char *name;
    const char *rule;
    uint32_t findings;
    void (*run)(struct world *world);
} rows[] = {
    {"valid, every way into a descriptor", "use.blas_destroyed", 0, valid},
    {"BLAS destroyed, every way into a descriptor", "use.blas_destroyed", TRACE_WAYS, destroyed},
    {"destroyed, and both built anew", "use.blas_destroyed", 0, destroyed_and_built_anew},
    {"TLAS without it, then destroyed", "use.blas_destroyed", 0, dropped_before_destroyed},
    {"destroyed after the trace", "use.blas_destroyed", 0, destroyed_after_the_trace},
    {"buffer destroyed", "use.blas_destroyed_bound", 1, buffer_gone},
    {"buffer destroyed, and certainly traced", "use.blas_destroyed", 1, buffer_gone_and_traced},
    {"memory freed", "use.blas_destroyed_bound", 1, memory_gone},
    {"compacted away", "use.blas_destroyed", 1, compacted_away},
    {"a branch that is not taken", "use.blas_destroyed_bound", 1, branch_not_taken},
    {"a mutable descriptor that holds a buffer by now", "use.blas_destroyed", 0, overwritten_by_a_buffer},
    {"an array of descriptors", "use.blas_destroyed", 0, array_of_descriptors},
    {"BLAS rebuilt", "use.blas_rebuilt", 1, rebuilt},
    {"BLAS rebuilt with the TLAS", "use.blas_rebuilt", 0, rebuilt_with_the_tlas},
    {"BLAS updated between build and trace", "use.blas_rebuilt", 1, updated_between_build_and_trace},
    {"never built", "use.tlas_never_built_bound", 1, never_built},
    {"a dispatch of nothing", "use.tlas_never_built_bound", 1, nothing_dispatched},
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
        trace_world_init(world, false);
        world->rule = rows[i].rule;
        rows[i].run(world);
        expect_findings(world, rows[i].findings);
        world_finish(world);
        free(world);
    }
}

/* The commands and the instrumented shader agree: it is an error where the trace ran, and only there. In safe mode the driver never sees such a
 * trace. */
static void never_built_and_traced(void **state)
{
    static const struct {
        const char *name;
        enum trace_shader shader;
        uint32_t branch, groups;         /* whether TRACE_MAYBE takes it */
        uint32_t certain, bound, shaders; /* findings of the three rules */
    } table[] = {
        {"certainly traced", TRACE_ALWAYS, 0, 1, 1, 0, 1},
        {"a branch that is taken", TRACE_MAYBE, 1, 1, 0, 1, 1},
        {"a branch that is not taken", TRACE_MAYBE, 0, 1, 0, 1, 0},
        {"a dispatch of nothing", TRACE_ALWAYS, 0, 0, 0, 1, 0},
    };
    (void)state;
    setenv("VK_GNOMON_RAY_TRACING_SAFE_MODE", "true", 1);
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        struct world *world = calloc(1, sizeof *world);
        print_message("    %s\n", table[i].name);
        trace_world_init(world, false);
        struct scene scene = scene_create(world, table[i].shader, TRACE_BY_WRITE);
        struct structure tlas = tlas_create(world, 1);
        tracer_refer(world, &scene.tracer, tlas.handle);
        ((uint32_t *)scene.tracer.hits.mapped)[1] = table[i].branch;
        trace(world, &scene, table[i].groups);
        vkDeviceWaitIdle(world->device);
        assert_int_equal(messages_count(world, "use.tlas_never_built"), table[i].certain);
        assert_int_equal(messages_count(world, "use.tlas_never_built_bound"), table[i].bound);
        assert_int_equal(messages_count(world, "structure.never_built"), table[i].shaders);
        structure_destroy(world, &tlas);
        scene_destroy(world, &scene);
        world_finish(world);
        free(world);
    }
    unsetenv("VK_GNOMON_RAY_TRACING_SAFE_MODE");
}

/* What is not followed is said, whether something is wrong with it or not. */
static void descriptor_buffers_are_named(void **state)
{
    (void)state;
    for (int wrong = 0; wrong < 2; wrong++) {
        struct world *world = calloc(1, sizeof *world);
        trace_world_init(world, true);
        world->rule = "use.blas_destroyed";
        struct scene scene = scene_create(world, TRACE_ALWAYS, TRACE_BY_BUFFER);
        if (wrong)
            structure_destroy_handle(world, &scene.blas);
        trace(world, &scene, 1);
        expect_findings(world, 0);
        scene_destroy(world, &scene);
        world_finish(world);
        const struct message *statement = messages_find(world, "statement");
        assert_non_null(statement);
        assert_non_null(strstr(statement->text, "1 traces, dispatches and draws through descriptor buffers"));
        free(world);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_row), cmocka_unit_test(never_built_and_traced),
                                       cmocka_unit_test(descriptor_buffers_are_named)};
    return cmocka_run_group_tests_name("use", tests, NULL, NULL);
}
