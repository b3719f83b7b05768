/* SPDX-License-Identifier: Apache-2.0 */
/* What checks in shaders cost: the same million rays in one process without a layer and at several levels of checks, in turns.
 * Ratios are medians of pairs; processor time is what other programs on the machine disturb least. Run it with the environment of the
 * layer's tests (VK_ADD_LAYER_PATH), and MESA_SHADER_CACHE_DISABLE=1 for the times of creation. */
#include "tests/layer/harness.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "cost_array_comp.spv.h"
#include "cost_comp.spv.h"

#define RAYS 1000000u
#define SIDE 128u
#define MAX_ROUNDS 64

enum { PLAIN, ON, UNPROVED, LEVELS };
static const char *const level_names[LEVELS] = {"no layer", "on", "unproved"};

struct bench {
    struct world world;
    struct structure blas, tlas;
    struct buffer out;
    VkDescriptorSetLayout layout;
    VkPipelineLayout pipeline_layout;
    VkDescriptorPool pool;
    VkDescriptorSet set;
    VkPipeline pipelines[2];
    double module_seconds[2], pipeline_seconds[2], first_seconds[2];
};

struct choices {
    uint32_t flags;
    float away;
    uint32_t which;
};

struct seconds {
    double wall, processor;
};

static double clock_seconds(clockid_t clock)
{
    struct timespec time;
    clock_gettime(clock, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static struct seconds dispatch(struct bench *bench, int kernel, struct choices choices)
{
    struct world *world = &bench->world;
    VkCommandBuffer commands = commands_begin(world, 0);
    vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_COMPUTE, bench->pipelines[kernel]);
    vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_COMPUTE, bench->pipeline_layout, 0, 1, &bench->set, 0, NULL);
    vkCmdPushConstants(commands, bench->pipeline_layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof choices, &choices);
    vkCmdDispatch(commands, RAYS / 64, 1, 1);
    commands_barrier(commands);
    commands_end(commands);
    struct seconds start = {clock_seconds(CLOCK_MONOTONIC), clock_seconds(CLOCK_PROCESS_CPUTIME_ID)};
    submit_and_wait(world, commands);
    struct seconds out = {clock_seconds(CLOCK_MONOTONIC) - start.wall, clock_seconds(CLOCK_PROCESS_CPUTIME_ID) - start.processor};
    vkFreeCommandBuffers(world->device, world->pool, 1, &commands);
    return out;
}

static void create_pipeline(struct bench *bench, int kernel)
{
    struct world *world = &bench->world;
    VkShaderModuleCreateInfo code = {.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO,
                                     .codeSize = kernel ? sizeof cost_array_comp_spv : sizeof cost_comp_spv,
                                     .pCode = kernel ? cost_array_comp_spv : cost_comp_spv};
    VkShaderModule module;
    double start = clock_seconds(CLOCK_PROCESS_CPUTIME_ID);
    assert_int_equal(vkCreateShaderModule(world->device, &code, NULL, &module), VK_SUCCESS);
    bench->module_seconds[kernel] = clock_seconds(CLOCK_PROCESS_CPUTIME_ID) - start;
    VkComputePipelineCreateInfo info = {.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
                                        .stage = {.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                  .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                                                  .module = module,
                                                  .pName = "main"},
                                        .layout = bench->pipeline_layout};
    start = clock_seconds(CLOCK_PROCESS_CPUTIME_ID);
    assert_int_equal(vkCreateComputePipelines(world->device, VK_NULL_HANDLE, 1, &info, NULL, &bench->pipelines[kernel]), VK_SUCCESS);
    bench->pipeline_seconds[kernel] = clock_seconds(CLOCK_PROCESS_CPUTIME_ID) - start;
    vkDestroyShaderModule(world->device, module, NULL);
    bench->first_seconds[kernel] = dispatch(bench, kernel, (struct choices){1, 1, 0}).processor;
}

static void bench_init(struct bench *bench, int level)
{
    const char *value = level_names[level];
    VkBool32 no = VK_FALSE;
    VkLayerSettingEXT settings[] = {
        {"VK_LAYER_GNOMON_ray_tracing", "shader_checks", VK_LAYER_SETTING_TYPE_STRING_EXT, 1, &value},
        {"VK_LAYER_GNOMON_ray_tracing", "report_stderr", VK_LAYER_SETTING_TYPE_BOOL32_EXT, 1, &no}};
    struct world *world = &bench->world;
    world_init(world, &(struct world_options){.without_layer = level == PLAIN, .settings = settings, .setting_count = level == PLAIN ? 0 : 2});
    bench->blas = blas_create(world, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, 0);
    bench->tlas = tlas_create(world, SIDE * SIDE);
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        tlas_refer(&bench->tlas, i, bench->blas.address);
        VkAccelerationStructureInstanceKHR *instance = tlas_instance(&bench->tlas, i);
        instance->transform.matrix[0][3] = (float)(i % SIDE);
        instance->transform.matrix[1][3] = (float)(i / SIDE);
        instance->transform.matrix[2][3] = (float)(i * 2654435761u >> 28);
    }
    VkCommandBuffer build = commands_begin(world, 0);
    commands_build_one(world, build, &bench->blas);
    commands_barrier(build);
    commands_build_one(world, build, &bench->tlas);
    commands_barrier(build);
    commands_end(build);
    submit_and_wait(world, build);

    const VkDescriptorSetLayoutBinding bindings[] = {
        {0, VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, 1, VK_SHADER_STAGE_COMPUTE_BIT, NULL},
        {1, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, VK_SHADER_STAGE_COMPUTE_BIT, NULL}};
    VkDescriptorSetLayoutCreateInfo layout = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO, .bindingCount = 2, .pBindings = bindings};
    assert_int_equal(vkCreateDescriptorSetLayout(world->device, &layout, NULL, &bench->layout), VK_SUCCESS);
    VkPushConstantRange push = {VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof(struct choices)};
    VkPipelineLayoutCreateInfo pipeline = {.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                           .setLayoutCount = 1,
                                           .pSetLayouts = &bench->layout,
                                           .pushConstantRangeCount = 1,
                                           .pPushConstantRanges = &push};
    assert_int_equal(vkCreatePipelineLayout(world->device, &pipeline, NULL, &bench->pipeline_layout), VK_SUCCESS);
    const VkDescriptorPoolSize sizes[] = {{VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, 1}, {VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1}};
    VkDescriptorPoolCreateInfo pool = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO, .maxSets = 1, .poolSizeCount = 2, .pPoolSizes = sizes};
    assert_int_equal(vkCreateDescriptorPool(world->device, &pool, NULL, &bench->pool), VK_SUCCESS);
    VkDescriptorSetAllocateInfo allocate = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                            .descriptorPool = bench->pool,
                                            .descriptorSetCount = 1,
                                            .pSetLayouts = &bench->layout};
    assert_int_equal(vkAllocateDescriptorSets(world->device, &allocate, &bench->set), VK_SUCCESS);
    bench->out = buffer_create(world, RAYS * sizeof(float), VK_BUFFER_USAGE_STORAGE_BUFFER_BIT);
    VkWriteDescriptorSetAccelerationStructureKHR scene = {
        .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET_ACCELERATION_STRUCTURE_KHR,
        .accelerationStructureCount = 1,
        .pAccelerationStructures = &bench->tlas.handle};
    VkDescriptorBufferInfo out = {bench->out.handle, 0, VK_WHOLE_SIZE};
    VkWriteDescriptorSet writes[] = {{.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                      .pNext = &scene,
                                      .dstSet = bench->set,
                                      .descriptorCount = 1,
                                      .descriptorType = VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR},
                                     {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                      .dstSet = bench->set,
                                      .dstBinding = 1,
                                      .descriptorCount = 1,
                                      .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                      .pBufferInfo = &out}};
    vkUpdateDescriptorSets(world->device, 2, writes, 0, NULL);
    for (int kernel = 0; kernel < 2; kernel++)
        create_pipeline(bench, kernel);
}

static void bench_finish(struct bench *bench)
{
    struct world *world = &bench->world;
    for (int kernel = 0; kernel < 2; kernel++)
        vkDestroyPipeline(world->device, bench->pipelines[kernel], NULL);
    vkDestroyDescriptorPool(world->device, bench->pool, NULL);
    vkDestroyPipelineLayout(world->device, bench->pipeline_layout, NULL);
    vkDestroyDescriptorSetLayout(world->device, bench->layout, NULL);
    buffer_destroy(world, &bench->out);
    structure_destroy(world, &bench->tlas);
    structure_destroy(world, &bench->blas);
    world_finish(world);
}

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *values, int count)
{
    qsort(values, (size_t)count, sizeof *values, by_value);
    return count % 2 ? values[count / 2] : (values[count / 2 - 1] + values[count / 2]) / 2;
}

int main(int argc, char **argv)
{
    static const struct {
        const char *name;
        int kernel;
        struct choices choices;
    } works[] = {{"rays that hit, opaque", 0, {1, 0, 0}},
                 {"rays that hit, by candidates", 0, {2, 0, 0}},
                 {"rays that hit nothing", 0, {1, 1, 0}},
                 {"array of queries, rays that hit, opaque", 1, {1, 0, 1}},
                 {"array of queries, rays that hit, by candidates", 1, {2, 0, 1}},
                 {"array of queries, rays that hit nothing", 1, {1, 1, 1}}};
    struct bench *benches = calloc(LEVELS, sizeof *benches);
    int rounds = argc > 1 ? atoi(argv[1]) : 15;
    if (!benches || rounds < 1 || rounds > MAX_ROUNDS)
        return 3;
    for (int level = 0; level < LEVELS; level++)
        bench_init(&benches[level], level);
    printf("%u rays, %d rounds; processor time (wall time)\n", RAYS, rounds);
    for (size_t w = 0; w < sizeof works / sizeof works[0]; w++) {
        double wall[LEVELS][MAX_ROUNDS], processor[LEVELS][MAX_ROUNDS];
        double plain = 0;
        for (int round = 0; round < rounds; round++) {
            struct seconds first = {0, 0};
            for (int i = 0; i < LEVELS; i++) {
                int level = round % 2 ? LEVELS - 1 - i : i; /* whoever comes first has no advantage */
                struct seconds seconds = dispatch(&benches[level], works[w].kernel, works[w].choices);
                wall[level][round] = seconds.wall;
                processor[level][round] = seconds.processor;
            }
            first.wall = wall[PLAIN][round];
            first.processor = processor[PLAIN][round];
            for (int level = 0; level < LEVELS; level++) {
                wall[level][round] /= first.wall;
                processor[level][round] /= first.processor;
            }
            plain += first.processor / rounds;
            for (int level = 1; level < LEVELS; level++)
                if (memcmp(benches[level].out.mapped, benches[PLAIN].out.mapped, RAYS * sizeof(float)) != 0)
                    printf("%s: another result\n", level_names[level]);
        }
        printf("%-48s %7.1f ms", works[w].name, plain * 1e3);
        for (int level = 1; level < LEVELS; level++)
            printf("   %s %.3fx (%.3fx)", level_names[level], median(processor[level], rounds), median(wall[level], rounds));
        printf("\n");
    }
    for (int kernel = 0; kernel < 2; kernel++)
        for (int level = 0; level < LEVELS; level++) {
            const struct bench *bench = &benches[level], *plain = &benches[PLAIN];
            double base = plain->module_seconds[kernel] + plain->pipeline_seconds[kernel] + plain->first_seconds[kernel];
            double total = bench->module_seconds[kernel] + bench->pipeline_seconds[kernel] + bench->first_seconds[kernel];
            printf("%s, %-9s module %6.2f ms, pipeline %7.2f ms, first dispatch %7.2f ms, all %.3fx; instrumenting is %.1f %% of it plain\n",
                   kernel ? "array" : "one query", level_names[level], bench->module_seconds[kernel] * 1e3,
                   bench->pipeline_seconds[kernel] * 1e3, bench->first_seconds[kernel] * 1e3, total / base,
                   100 * (bench->module_seconds[kernel] - plain->module_seconds[kernel]) / base);
        }
    for (int level = 0; level < LEVELS; level++)
        bench_finish(&benches[level]);
    free(benches);
    return 0;
}
