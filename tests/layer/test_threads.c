/* SPDX-License-Identifier: Apache-2.0 */
/* Eight threads create, name, record, submit and destroy at once, as Vulkan's rules of external synchronization allow; every
 * second one makes a mistake in every round, and the others trace, and make another one in the last. Run it under ThreadSanitizer too. */
#include "tests/layer/trace.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define THREADS 8
#define ROUNDS 12

static pthread_mutex_t queue_lock = PTHREAD_MUTEX_INITIALIZER;

struct worker {
    struct world *world; /* its own copy: device and queue are shared, the pool is not */
    bool wrong;
};

/* Traces through the TLAS, once its BLAS is gone if that is asked for; in a branch that is not taken, so that the driver survives. */
static void trace(struct worker *worker, struct tracer *tracer, struct structure *tlas, struct structure *blas, VkFence fence, bool gone)
{
    struct world *world = worker->world;
    if (gone) {
        structure_destroy_handle(world, blas);
        blas->handle = VK_NULL_HANDLE;
    }
    tracer_refer(world, tracer, tlas->handle);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_barrier(commands);
    commands_trace(world, commands, tracer, tlas->handle, 1);
    commands_end(commands);
    pthread_mutex_lock(&queue_lock);
    submit(world, commands, fence);
    pthread_mutex_unlock(&queue_lock);
    vkWaitForFences(world->device, 1, &fence, VK_TRUE, UINT64_MAX);
    vkResetFences(world->device, 1, &fence);
    vkFreeCommandBuffers(world->device, world->pool, 1, &commands);
}

static void *work(void *argument)
{
    struct worker *worker = argument;
    struct world *world = worker->world;
    VkFence fence = fence_create(world);
    struct tracer tracer = tracer_create(world, TRACE_MAYBE, TRACE_BY_WRITE);
    for (int round = 0; round < ROUNDS; round++) {
        struct structure blas = blas_create(world, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, 0);
        struct structure tlas = tlas_create(world, 16);
        structure_name(world, &blas, worker->wrong ? "wrong" : "right");
        for (uint32_t i = 0; i < 16; i++)
            tlas_refer(&tlas, i, blas.address);
        VkCommandBuffer commands = commands_begin(world, 0);
        if (!worker->wrong) {
            commands_build_one(world, commands, &blas);
            commands_barrier(commands);
        }
        commands_build_one(world, commands, &tlas);
        commands_end(commands);
        pthread_mutex_lock(&queue_lock);
        submit(world, commands, fence);
        pthread_mutex_unlock(&queue_lock);
        vkWaitForFences(world->device, 1, &fence, VK_TRUE, UINT64_MAX);
        vkResetFences(world->device, 1, &fence);
        vkFreeCommandBuffers(world->device, world->pool, 1, &commands);
        if (!worker->wrong)
            trace(worker, &tracer, &tlas, &blas, fence, round == ROUNDS - 1);
        structure_destroy(world, &tlas);
        structure_destroy(world, &blas);
    }
    tracer_destroy(world, &tracer);
    vkDestroyFence(world->device, fence, NULL);
    return NULL;
}

static void eight_threads(void **state)
{
    (void)state;
    struct world *world = calloc(1, sizeof *world), *copies = calloc(THREADS, sizeof *copies);
    pthread_t threads[THREADS];
    struct worker workers[THREADS];
    setenv("VK_GNOMON_RAY_TRACING_REPORT_STDERR", "false", 1);
    world_init(world, NULL);
    for (int i = 0; i < THREADS; i++) {
        copies[i] = *world;
        VkCommandPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO};
        assert_int_equal(vkCreateCommandPool(world->device, &pool, NULL, &copies[i].pool), VK_SUCCESS);
        workers[i] = (struct worker){&copies[i], i % 2 == 1};
    }
    for (int i = 0; i < THREADS; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, work, &workers[i]), 0);
    for (int i = 0; i < THREADS; i++) {
        pthread_join(threads[i], NULL);
        vkDestroyCommandPool(world->device, copies[i].pool, NULL);
    }
    for (uint32_t i = 0; i < world->messages.count && i < 64; i++)
        if (strcmp(world->messages.list[i].id, NEVER_BUILT) == 0)
            assert_non_null(strstr(world->messages.list[i].text, "BLAS \"wrong\""));
    assert_int_equal(messages_count(world, NEVER_BUILT), THREADS / 2 * ROUNDS);
    assert_int_equal(messages_count(world, "use.blas_destroyed_bound"), THREADS / 2);
    world_finish(world);
    free(copies);
    free(world);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(eight_threads)};
    return cmocka_run_group_tests_name("threads", tests, NULL, NULL);
}
