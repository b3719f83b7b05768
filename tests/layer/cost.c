/* SPDX-License-Identifier: Apache-2.0 */
/* What the layer costs: the same work in one process without a layer, under Gnomon, and under Khronos' core validation,
 * taken in turns: the fastest round, which other programs on the machine disturb least, and the median. Run it with
 * the environment of the layer tests (VK_ADD_LAYER_PATH). */
#include "tests/layer/harness.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define ROUNDS 15
#define REPEATS 100
#define MANY 1000000u

enum { PLAIN, GNOMON, KHRONOS, WORLDS };

static const char *const world_names[] = {"no layer", "gnomon", "khronos core"};

struct bench {
    struct world world;
    struct buffer buffer;
    struct structure blas, tlas, many;
    VkCommandBuffer fill, alone;
    VkFence fence;
};

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static void run(struct bench *bench, VkCommandBuffer commands)
{
    submit(&bench->world, commands, bench->fence);
    vkWaitForFences(bench->world.device, 1, &bench->fence, VK_TRUE, UINT64_MAX);
    vkResetFences(bench->world.device, 1, &bench->fence);
}

static double submit_seconds(struct bench *bench)
{
    double start = now();
    for (int i = 0; i < REPEATS; i++)
        run(bench, bench->fill);
    return (now() - start) / REPEATS;
}

static double resubmit_tlas_seconds(struct bench *bench)
{
    double start = now();
    for (int i = 0; i < REPEATS; i++)
        run(bench, bench->alone);
    return (now() - start) / REPEATS;
}

static double record_and_build(struct bench *bench, struct structure *tlas, int repeats)
{
    double start = now();
    for (int i = 0; i < repeats; i++) {
        VkCommandBuffer commands = commands_begin(&bench->world, VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT);
        commands_build_one(&bench->world, commands, tlas);
        commands_end(commands);
        run(bench, commands);
        vkFreeCommandBuffers(bench->world.device, bench->world.pool, 1, &commands);
    }
    return (now() - start) / repeats;
}

static double build_tlas_seconds(struct bench *bench)
{
    return record_and_build(bench, &bench->tlas, REPEATS);
}

static double build_many_seconds(struct bench *bench)
{
    return record_and_build(bench, &bench->many, 1);
}

static void bench_init(struct bench *bench, int which)
{
    struct world_options options = {.without_layer = which != GNOMON};
    if (which == KHRONOS)
        setenv("GNOMON_TEST_BENEATH", "VK_LAYER_KHRONOS_validation", 1);
    else
        unsetenv("GNOMON_TEST_BENEATH");
    struct world *world = &bench->world;
    world_init(world, &options);
    bench->buffer = buffer_create(world, 64, VK_BUFFER_USAGE_TRANSFER_DST_BIT);
    bench->blas = blas_create(world, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, 0);
    bench->tlas = tlas_create(world, 1);
    bench->many = tlas_create(world, MANY);
    tlas_refer(&bench->tlas, 0, bench->blas.address);
    for (uint32_t i = 0; i < MANY; i++)
        tlas_refer(&bench->many, i, bench->blas.address);
    bench->fence = fence_create(world);
    VkCommandBuffer build = commands_begin(world, 0);
    commands_build_one(world, build, &bench->blas);
    commands_end(build);
    submit_and_wait(world, build);
    bench->fill = commands_begin(world, 0);
    vkCmdFillBuffer(bench->fill, bench->buffer.handle, 0, 64, 1);
    commands_end(bench->fill);
    bench->alone = commands_begin(world, 0);
    commands_build_one(world, bench->alone, &bench->tlas);
    commands_end(bench->alone);
}

static void bench_finish(struct bench *bench)
{
    struct world *world = &bench->world;
    vkDestroyFence(world->device, bench->fence, NULL);
    structure_destroy(world, &bench->many);
    structure_destroy(world, &bench->tlas);
    structure_destroy(world, &bench->blas);
    buffer_destroy(world, &bench->buffer);
    world->above_khronos = false;
    world_finish(world);
}

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

int main(void)
{
    static const struct {
        const char *name;
        double (*seconds)(struct bench *bench);
    } works[] = {{"submit a fill", submit_seconds},
                 {"submit a recorded build of a TLAS of 1", resubmit_tlas_seconds},
                 {"record, submit and free a build of a TLAS of 1", build_tlas_seconds},
                 {"the same with 1,000,000 instances", build_many_seconds}};
    struct bench *benches = calloc(WORLDS, sizeof *benches);
    if (!benches)
        return 3;
    for (int w = 0; w < WORLDS; w++)
        bench_init(&benches[w], w);
    for (size_t k = 0; k < sizeof works / sizeof works[0]; k++) {
        double times[WORLDS][ROUNDS];
        int rounds = works[k].seconds == build_many_seconds ? 7 : ROUNDS;
        for (int round = 0; round < rounds; round++)
            for (int w = 0; w < WORLDS; w++)
                times[w][round] = works[k].seconds(&benches[w]);
        for (int w = 0; w < WORLDS; w++)
            qsort(times[w], (size_t)rounds, sizeof(double), by_value);
        printf("%s:\n", works[k].name);
        for (int w = 0; w < WORLDS; w++)
            printf("  %-13s fastest %12.1f us %6.3fx   median %12.1f us %6.3fx\n", world_names[w], times[w][0] * 1e6,
                   times[w][0] / times[PLAIN][0], times[w][rounds / 2] * 1e6,
                   times[w][rounds / 2] / times[PLAIN][rounds / 2]);
    }
    for (int w = 0; w < WORLDS; w++)
        bench_finish(&benches[w]);
    free(benches);
    return 0;
}
