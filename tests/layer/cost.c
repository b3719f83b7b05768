/* SPDX-License-Identifier: Apache-2.0 */
/* What the layer costs: the same work in one process without a layer, under Gnomon, and under Khronos' core validation, taken in turns so
 * that other programs on the machine disturb all alike. Per work, the median time; what a layer adds is the median of the differences within
 * a round. Times of the clock on the wall, and of the processor in all threads, which other programs disturb least. */
#include "tests/layer/trace.h"

#include <malloc.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define MOST_ROUNDS 25
#define MANY 1000000u
#define ALIVE 100000u
#define FEW 100u

/* EVERYTHING is Gnomon with an instance_cap that nothing reaches. */
enum { PLAIN, GNOMON, KHRONOS, EVERYTHING, WORLDS };
enum { WALL, CPU, CLOCKS };

static const char *const clock_names[CLOCKS] = {"wall", "cpu"};

struct bench {
    struct world world;
    struct structure blas, tlas, many;
    struct tracer tracer;
    VkCommandBuffer trace;
    VkFence fence;
    struct buffer storage;
    VkAccelerationStructureKHR *alive;
    uint32_t alive_count;
};

struct times {
    double seconds[CLOCKS];
};

static struct times now(void)
{
    const clockid_t clocks[CLOCKS] = {CLOCK_MONOTONIC, CLOCK_PROCESS_CPUTIME_ID};
    struct times out;
    for (int c = 0; c < CLOCKS; c++) {
        struct timespec time;
        clock_gettime(clocks[c], &time);
        out.seconds[c] = (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
    }
    return out;
}

static void run(struct bench *bench, VkCommandBuffer commands)
{
    submit(&bench->world, commands, bench->fence);
    vkWaitForFences(bench->world.device, 1, &bench->fence, VK_TRUE, UINT64_MAX);
    vkResetFences(bench->world.device, 1, &bench->fence);
}

static void record_and_build(struct bench *bench, struct structure *structure)
{
    VkCommandBuffer commands = commands_begin(&bench->world, VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT);
    commands_build_one(&bench->world, commands, structure);
    commands_end(commands);
    run(bench, commands);
    vkFreeCommandBuffers(bench->world.device, bench->world.pool, 1, &commands);
}

static void submit_trace(struct bench *bench)
{
    run(bench, bench->trace);
}

static void build_tlas(struct bench *bench)
{
    record_and_build(bench, &bench->tlas);
}

static void build_many(struct bench *bench)
{
    record_and_build(bench, &bench->many);
}

static void build_blas(struct bench *bench)
{
    record_and_build(bench, &bench->blas);
}

static VkAccelerationStructureKHR structure_at(struct bench *bench, VkDeviceSize offset)
{
    VkAccelerationStructureKHR handle = VK_NULL_HANDLE;
    VkAccelerationStructureCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
                                                 .buffer = bench->storage.handle,
                                                 .offset = offset,
                                                 .size = 256,
                                                 .type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR};
    if (bench->world.CreateAccelerationStructureKHR(bench->world.device, &info, NULL, &handle) != VK_SUCCESS)
        abort();
    VkAccelerationStructureDeviceAddressInfoKHR query = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_DEVICE_ADDRESS_INFO_KHR,
                                                         .accelerationStructure = handle};
    bench->world.GetAccelerationStructureDeviceAddressKHR(bench->world.device, &query);
    return handle;
}

static void create_and_destroy(struct bench *bench)
{
    VkAccelerationStructureKHR handle = structure_at(bench, (VkDeviceSize)ALIVE * 256);
    bench->world.DestroyAccelerationStructureKHR(bench->world.device, handle, NULL);
}

static void create_and_destroy_buffer(struct bench *bench)
{
    struct buffer buffer = buffer_create(&bench->world, 256, VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR);
    buffer_destroy(&bench->world, &buffer);
}

static void bench_init(struct bench *bench, int which)
{
    int32_t cap = INT32_MAX;
    VkLayerSettingEXT setting = {"VK_LAYER_GNOMON_ray_tracing", "instance_cap", VK_LAYER_SETTING_TYPE_INT32_EXT, 1, &cap};
    struct world_options options = {.without_layer = which == PLAIN || which == KHRONOS,
                                    .settings = &setting,
                                    .setting_count = which == EVERYTHING ? 1 : 0};
    if (which == KHRONOS)
        setenv("GNOMON_TEST_BENEATH", "VK_LAYER_KHRONOS_validation", 1);
    else
        unsetenv("GNOMON_TEST_BENEATH");
    struct world *world = &bench->world;
    world_init(world, &options);
    bench->blas = blas_create(world, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, 0);
    bench->tlas = tlas_create(world, 1);
    bench->many = tlas_create(world, MANY);
    tlas_refer(&bench->tlas, 0, bench->blas.address);
    /* A grid, in an order that is not that of the cells. */
    for (uint32_t i = 0; i < MANY; i++) {
        uint32_t cell = (uint32_t)((uint64_t)i * 567629137u % MANY);
        tlas_refer(&bench->many, i, bench->blas.address);
        VkTransformMatrixKHR *transform = &tlas_instance(&bench->many, i)->transform;
        transform->matrix[0][3] = (float)(cell % 100) * 2;
        transform->matrix[1][3] = (float)(cell / 100 % 100) * 2;
        transform->matrix[2][3] = (float)(cell / 10000) * 2;
    }
    bench->fence = fence_create(world);
    bench->storage = buffer_create(world, (VkDeviceSize)(ALIVE + 1) * 256, VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR);
    record_and_build(bench, &bench->blas);
    record_and_build(bench, &bench->tlas);
    bench->tracer = tracer_create(world, TRACE_ALWAYS, TRACE_BY_WRITE);
    tracer_refer(world, &bench->tracer, bench->tlas.handle);
    bench->trace = commands_begin(world, 0);
    commands_trace(world, bench->trace, &bench->tracer, bench->tlas.handle, 1);
    commands_barrier(bench->trace);
    commands_end(bench->trace);
    bench->alive = calloc(ALIVE, sizeof *bench->alive);
    if (!bench->alive)
        abort();
}

/* So many structures are alive then. */
static void populate(struct bench *bench, uint32_t count)
{
    for (; bench->alive_count < count; bench->alive_count++)
        bench->alive[bench->alive_count] = structure_at(bench, (VkDeviceSize)bench->alive_count * 256);
}

static void bench_finish(struct bench *bench)
{
    struct world *world = &bench->world;
    for (uint32_t i = 0; i < bench->alive_count; i++)
        world->DestroyAccelerationStructureKHR(world->device, bench->alive[i], NULL);
    free(bench->alive);
    vkDestroyFence(world->device, bench->fence, NULL);
    tracer_destroy(world, &bench->tracer);
    buffer_destroy(world, &bench->storage);
    structure_destroy(world, &bench->many);
    structure_destroy(world, &bench->tlas);
    structure_destroy(world, &bench->blas);
    world->above_khronos = false;
    world_finish(world);
}

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(const double *values, int count)
{
    double sorted[MOST_ROUNDS];
    memcpy(sorted, values, (size_t)count * sizeof *values);
    qsort(sorted, (size_t)count, sizeof *sorted, by_value);
    return sorted[count / 2];
}

struct work {
    const char *name;
    void (*once)(struct bench *bench);
    int repeats, rounds;
};

struct measured {
    double seconds[CLOCKS][WORLDS], added[CLOCKS][WORLDS];
};

static struct measured measure(const struct work *work, struct bench *benches, int worlds)
{
    static double times[CLOCKS][WORLDS][MOST_ROUNDS];
    struct measured out = {{{0}}, {{0}}};
    for (int i = 0; i < work->repeats; i++)
        for (int w = 0; w < worlds; w++)
            work->once(&benches[w]);
    for (int round = 0; round < work->rounds; round++)
        for (int w = 0; w < worlds; w++) {
            struct times start = now();
            for (int i = 0; i < work->repeats; i++)
                work->once(&benches[w]);
            struct times end = now();
            for (int c = 0; c < CLOCKS; c++)
                times[c][w][round] = (end.seconds[c] - start.seconds[c]) / work->repeats;
        }
    for (int c = 0; c < CLOCKS; c++)
        for (int w = 0; w < worlds; w++) {
            double differences[MOST_ROUNDS];
            for (int round = 0; round < work->rounds; round++)
                differences[round] = times[c][w][round] - times[c][PLAIN][round];
            out.seconds[c][w] = median(times[c][w], work->rounds);
            out.added[c][w] = median(differences, work->rounds);
        }
    return out;
}

static void compare_layers(struct bench *benches)
{
    static const struct work works[] = {{"submit a dispatch of one ray", submit_trace, 50, 25},
                                        {"build a TLAS of 1 instance", build_tlas, 50, 25},
                                        {"build a BLAS of 1 triangle", build_blas, 50, 25},
                                        {"build a TLAS of 1,000,000 instances", build_many, 1, 11}};
    printf("%-38s %-5s %12s %12s %8s %12s %8s\n", "", "clock", "no layer us", "Gnomon adds", "ratio", "Khronos adds", "G/K");
    for (size_t k = 0; k < sizeof works / sizeof works[0]; k++) {
        struct measured found = measure(&works[k], benches, WORLDS);
        for (int c = 0; c < CLOCKS; c++)
            printf("%-38s %-5s %12.1f %12.1f %8.3f %12.1f %8.2f\n", c ? "" : works[k].name, clock_names[c],
                   found.seconds[c][PLAIN] * 1e6, found.added[c][GNOMON] * 1e6, 1 + found.added[c][GNOMON] / found.seconds[c][PLAIN],
                   found.added[c][KHRONOS] * 1e6, found.added[c][GNOMON] / found.added[c][KHRONOS]);
        if (works[k].once != build_many)
            continue;
        for (int c = 0; c < CLOCKS; c++)
            printf("%-38s %-5s %12.1f %12.1f %8.3f\n", c ? "" : "  all of them read (instance_cap)", clock_names[c],
                   found.seconds[c][PLAIN] * 1e6, found.added[c][EVERYTHING] * 1e6,
                   1 + found.added[c][EVERYTHING] / found.seconds[c][PLAIN]);
    }
}

static size_t allocated(void)
{
    struct mallinfo2 info = mallinfo2();
    return info.uordblks + info.hblkhd;
}

/* With few structures alive, then with many: by how much everything takes longer. The driver may do so as well. */
static void compare_counts(struct bench *benches)
{
    static const struct work works[] = {{"create and destroy a BLAS", create_and_destroy, 200, 15},
                                        {"create and destroy a buffer", create_and_destroy_buffer, 200, 15},
                                        {"build a BLAS of 1 triangle", build_blas, 50, 15},
                                        {"build a TLAS of 1 instance", build_tlas, 50, 15},
                                        {"submit a dispatch of one ray", submit_trace, 50, 15}};
    struct measured few[sizeof works / sizeof works[0]], many;
    double bytes[WORLDS];
    for (int w = 0; w < KHRONOS; w++)
        populate(&benches[w], FEW);
    for (size_t k = 0; k < sizeof works / sizeof works[0]; k++)
        few[k] = measure(&works[k], benches, KHRONOS);
    for (int w = 0; w < KHRONOS; w++) {
        size_t before = allocated();
        populate(&benches[w], ALIVE);
        bytes[w] = (double)(allocated() - before) / (ALIVE - FEW);
    }
    printf("\n%-38s %-5s %12s %12s %8s   (of the processor, in us)\n", "", "", "with 100", "with 100,000", "ratio");
    for (size_t k = 0; k < sizeof works / sizeof works[0]; k++) {
        many = measure(&works[k], benches, KHRONOS);
        for (int w = 0; w < KHRONOS; w++)
            printf("%-38s %-5s %12.2f %12.2f %8.3f\n", w ? "" : works[k].name, w ? "with" : "none", few[k].seconds[CPU][w] * 1e6,
                   many.seconds[CPU][w] * 1e6, many.seconds[CPU][w] / few[k].seconds[CPU][w]);
    }
    printf("\n%-38s %12.0f bytes without a layer, %.0f more under Gnomon\n", "a BLAS that was not built", bytes[PLAIN], bytes[GNOMON] - bytes[PLAIN]);
}

static void measure_memory(struct bench *benches)
{
    enum { COUNT = 2000 };
    static struct buffer buffers[COUNT];
    double bytes[2][2];
    for (int w = 0; w < KHRONOS; w++) {
        struct world *world = &benches[w].world;
        size_t before = allocated();
        for (int i = 0; i < COUNT; i++)
            buffers[i] = buffer_create(world, 256, VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR);
        bytes[0][w] = (double)(allocated() - before) / COUNT;
        for (int i = 0; i < COUNT; i++)
            buffer_destroy(world, &buffers[i]);
        VkCommandBuffer commands = commands_begin(world, 0);
        before = allocated();
        for (int i = 0; i < COUNT; i++) {
            commands_build_one(world, commands, &benches[w].blas);
            commands_barrier(commands);
        }
        bytes[1][w] = (double)(allocated() - before) / COUNT;
        commands_end(commands);
        vkFreeCommandBuffers(world->device, world->pool, 1, &commands);
    }
    printf("%-38s %12.0f bytes without a layer, %.0f more under Gnomon\n", "a buffer with its memory", bytes[0][PLAIN], bytes[0][GNOMON] - bytes[0][PLAIN]);
    printf("%-38s %12.0f bytes without a layer, %.0f more under Gnomon\n", "a recorded build of a BLAS", bytes[1][PLAIN], bytes[1][GNOMON] - bytes[1][PLAIN]);
}

int main(void)
{
    struct bench *benches = calloc(WORLDS, sizeof *benches);
    if (!benches)
        return 3;
    setenv("VK_ADD_LAYER_PATH", LAYER_FOLDER, 0);
    setenv("VK_GNOMON_RAY_TRACING_REPORT_STDERR", "false", 0);
    for (int w = 0; w < WORLDS; w++)
        bench_init(&benches[w], w);
    compare_layers(benches);
    compare_counts(benches);
    measure_memory(benches);
    for (int w = 0; w < WORLDS; w++)
        bench_finish(&benches[w]);
    free(benches);
    return 0;
}
