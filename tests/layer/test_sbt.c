/* SPDX-License-Identifier: Apache-2.0 */
/* Shader binding tables on a driver: a trace of one ray with a table of three regions, right at first, then altered. */
#include "tests/layer/harness.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "table_rchit.spv.h"
#include "table_rgen.spv.h"
#include "table_rmiss.spv.h"

#define TABLE VK_BUFFER_USAGE_SHADER_BINDING_TABLE_BIT_KHR
/* Every region has a place of its own in the table. */
#define PLACE 4096
#define TABLE_SIZE 65536
#define MAX_HANDLE 64

#define RAY_COMMANDS(X)                                                                                                \
    X(CreateRayTracingPipelinesKHR)                                                                                    \
    X(GetRayTracingShaderGroupHandlesKHR)                                                                              \
    X(CmdTraceRaysKHR)                                                                                                 \
    X(CmdTraceRaysIndirectKHR)                                                                                         \
    X(CmdTraceRaysIndirect2KHR)

enum { RAYGEN, MISS, HIT, CALLABLE, PARTS };

struct subject {
    struct world *world;
#define X(name) PFN_vk##name name;
    RAY_COMMANDS(X)
#undef X
    VkPhysicalDeviceRayTracingPipelinePropertiesKHR limits;
    VkDescriptorSetLayout layout;
    VkPipelineLayout pipeline_layout;
    VkDescriptorPool pool;
    VkDescriptorSet set;
    VkPipeline pipeline;
    VkPipelineCreateFlags flags; /* of pipelines made from now on */
    uint32_t depth;
    struct structure blas, tlas;
    struct buffer table;
    unsigned char handles[3][MAX_HANDLE]; /* of raygen, miss and hit */
    VkStridedDeviceAddressRegionKHR regions[PARTS];
    uint32_t width;
    void (*late)(struct subject *subject); /* between recording and submission */
};

static VkShaderModule module_create(struct subject *subject, const uint32_t *code, size_t size)
{
    VkShaderModule module;
    VkShaderModuleCreateInfo info = {.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, .codeSize = size, .pCode = code};
    assert_int_equal(vkCreateShaderModule(subject->world->device, &info, NULL, &module), VK_SUCCESS);
    return module;
}

static VkPipeline pipeline_create(struct subject *subject)
{
    VkDevice device = subject->world->device;
    VkPipeline pipeline;
    VkShaderModule modules[] = {module_create(subject, table_rgen_spv, sizeof table_rgen_spv),
                                module_create(subject, table_rmiss_spv, sizeof table_rmiss_spv),
                                module_create(subject, table_rchit_spv, sizeof table_rchit_spv)};
    const VkShaderStageFlagBits kinds[] = {VK_SHADER_STAGE_RAYGEN_BIT_KHR, VK_SHADER_STAGE_MISS_BIT_KHR,
                                           VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR};
    VkPipelineShaderStageCreateInfo stages[3];
    VkRayTracingShaderGroupCreateInfoKHR groups[3];
    for (uint32_t i = 0; i < 3; i++) {
        stages[i] = (VkPipelineShaderStageCreateInfo){.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                      .stage = kinds[i],
                                                      .module = modules[i],
                                                      .pName = "main"};
        groups[i] = (VkRayTracingShaderGroupCreateInfoKHR){
            .sType = VK_STRUCTURE_TYPE_RAY_TRACING_SHADER_GROUP_CREATE_INFO_KHR,
            .type = i == 2 ? VK_RAY_TRACING_SHADER_GROUP_TYPE_TRIANGLES_HIT_GROUP_KHR : VK_RAY_TRACING_SHADER_GROUP_TYPE_GENERAL_KHR,
            .generalShader = i == 2 ? VK_SHADER_UNUSED_KHR : i,
            .closestHitShader = i == 2 ? 2 : VK_SHADER_UNUSED_KHR,
            .anyHitShader = VK_SHADER_UNUSED_KHR,
            .intersectionShader = VK_SHADER_UNUSED_KHR};
    }
    VkRayTracingPipelineCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_RAY_TRACING_PIPELINE_CREATE_INFO_KHR,
                                              .flags = subject->flags,
                                              .stageCount = 3,
                                              .pStages = stages,
                                              .groupCount = 3,
                                              .pGroups = groups,
                                              .maxPipelineRayRecursionDepth = subject->depth,
                                              .layout = subject->pipeline_layout};
    assert_int_equal(subject->CreateRayTracingPipelinesKHR(device, VK_NULL_HANDLE, VK_NULL_HANDLE, 1, &info, NULL, &pipeline), VK_SUCCESS);
    for (int i = 0; i < 3; i++)
        vkDestroyShaderModule(device, modules[i], NULL);
    return pipeline;
}

static void handles_read(struct subject *subject, VkPipeline pipeline)
{
    uint32_t size = subject->limits.shaderGroupHandleSize;
    unsigned char all[3 * MAX_HANDLE];
    assert_true(size <= MAX_HANDLE);
    assert_int_equal(subject->GetRayTracingShaderGroupHandlesKHR(subject->world->device, pipeline, 0, 3, sizeof all, all), VK_SUCCESS);
    for (uint32_t i = 0; i < 3; i++)
        memcpy(subject->handles[i], all + i * size, size);
}

static unsigned char *record_at(struct subject *subject, int part)
{
    return (unsigned char *)subject->table.mapped + PLACE * part;
}

static void table_write(struct subject *subject)
{
    for (int part = RAYGEN; part <= HIT; part++)
        memcpy(record_at(subject, part), subject->handles[part], subject->limits.shaderGroupHandleSize);
}

static void descriptors_create(struct subject *subject)
{
    VkDevice device = subject->world->device;
    VkDescriptorSetLayoutBinding binding = {0, VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, 1, VK_SHADER_STAGE_RAYGEN_BIT_KHR, NULL};
    VkDescriptorSetLayoutCreateInfo layout = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO, .bindingCount = 1, .pBindings = &binding};
    assert_int_equal(vkCreateDescriptorSetLayout(device, &layout, NULL, &subject->layout), VK_SUCCESS);
    VkPipelineLayoutCreateInfo pipeline_layout = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO, .setLayoutCount = 1, .pSetLayouts = &subject->layout};
    assert_int_equal(vkCreatePipelineLayout(device, &pipeline_layout, NULL, &subject->pipeline_layout), VK_SUCCESS);
    VkDescriptorPoolSize size = {VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, 1};
    VkDescriptorPoolCreateInfo pool = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO, .maxSets = 1, .poolSizeCount = 1, .pPoolSizes = &size};
    assert_int_equal(vkCreateDescriptorPool(device, &pool, NULL, &subject->pool), VK_SUCCESS);
    VkDescriptorSetAllocateInfo allocation = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                              .descriptorPool = subject->pool,
                                              .descriptorSetCount = 1,
                                              .pSetLayouts = &subject->layout};
    assert_int_equal(vkAllocateDescriptorSets(device, &allocation, &subject->set), VK_SUCCESS);
    VkWriteDescriptorSetAccelerationStructureKHR structure = {
        .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET_ACCELERATION_STRUCTURE_KHR,
        .accelerationStructureCount = 1,
        .pAccelerationStructures = &subject->tlas.handle};
    VkWriteDescriptorSet write = {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                  .pNext = &structure,
                                  .dstSet = subject->set,
                                  .descriptorCount = 1,
                                  .descriptorType = VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR};
    vkUpdateDescriptorSets(device, 1, &write, 0, NULL);
}

static struct world *world_with_rays(void)
{
    static VkPhysicalDeviceRayTracingMaintenance1FeaturesKHR maintenance = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_MAINTENANCE_1_FEATURES_KHR,
        .rayTracingMaintenance1 = VK_TRUE,
        .rayTracingPipelineTraceRaysIndirect2 = VK_TRUE};
    static VkPhysicalDeviceRayTracingPipelineFeaturesKHR rays = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_FEATURES_KHR,
        .pNext = &maintenance,
        .rayTracingPipeline = VK_TRUE,
        .rayTracingPipelineTraceRaysIndirect = VK_TRUE};
    static const char *const extensions[] = {VK_KHR_RAY_TRACING_PIPELINE_EXTENSION_NAME, VK_KHR_RAY_TRACING_MAINTENANCE_1_EXTENSION_NAME};
    struct world_options options = {
        .creation_messenger = true, .features = &rays, .extensions = extensions, .extension_count = 2};
    struct world *world = calloc(1, sizeof *world);
    assert_non_null(world);
    world_init(world, &options);
    return world;
}

static void subject_init(struct subject *subject, struct world *world)
{
    *subject = (struct subject){.world = world, .depth = 1, .width = 1};
#define X(name)                                                                                                        \
    subject->name = (PFN_vk##name)vkGetDeviceProcAddr(world->device, "vk" #name);                                     \
    assert_non_null(subject->name);
    RAY_COMMANDS(X)
#undef X
    subject->limits.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_PROPERTIES_KHR;
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &subject->limits};
    vkGetPhysicalDeviceProperties2(world->physical, &properties);
    subject->blas = blas_create(world, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, 0);
    subject->tlas = tlas_create(world, 2);
    for (uint32_t i = 0; i < 2; i++)
        tlas_refer(&subject->tlas, i, subject->blas.address);
    descriptors_create(subject);
    subject->pipeline = pipeline_create(subject);
    handles_read(subject, subject->pipeline);
    subject->table = buffer_create(world, TABLE_SIZE, TABLE);
    VkDeviceSize stride = subject->limits.shaderGroupBaseAlignment > subject->limits.shaderGroupHandleSize
                              ? subject->limits.shaderGroupBaseAlignment
                              : subject->limits.shaderGroupHandleSize;
    for (int part = RAYGEN; part <= HIT; part++)
        subject->regions[part] = (VkStridedDeviceAddressRegionKHR){subject->table.address + (VkDeviceSize)(PLACE * part), stride, stride};
    table_write(subject);
}

static void subject_finish(struct subject *subject)
{
    VkDevice device = subject->world->device;
    vkDestroyPipeline(device, subject->pipeline, NULL);
    vkDestroyPipelineLayout(device, subject->pipeline_layout, NULL);
    vkDestroyDescriptorPool(device, subject->pool, NULL);
    vkDestroyDescriptorSetLayout(device, subject->layout, NULL);
    buffer_destroy(subject->world, &subject->table);
    structure_destroy(subject->world, &subject->tlas);
    structure_destroy(subject->world, &subject->blas);
}

static void subject_trace(struct subject *subject)
{
    struct world *world = subject->world;
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &subject->blas);
    commands_barrier(commands);
    commands_build_one(world, commands, &subject->tlas);
    commands_barrier(commands);
    vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR, subject->pipeline);
    vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR, subject->pipeline_layout, 0, 1, &subject->set, 0, NULL);
    subject->CmdTraceRaysKHR(commands, &subject->regions[RAYGEN], &subject->regions[MISS], &subject->regions[HIT],
                             &subject->regions[CALLABLE], subject->width, 1, 1);
    commands_end(commands);
    if (subject->late)
        subject->late(subject);
    submit_and_wait(world, commands);
}

#define ALTER(name, ...)                                                                                               \
    static void name(struct subject *subject)                                                                          \
    {                                                                                                                  \
        VkStridedDeviceAddressRegionKHR *regions = subject->regions;                                                   \
        (void)regions;                                                                                                 \
        __VA_ARGS__;                                                                                                   \
    }

/* The ray misses, and so never reaches a hit record that a driver could stumble over. */
static void miss(struct subject *subject)
{
    for (uint32_t i = 0; i < 2; i++)
        tlas_instance(&subject->tlas, i)->transform.matrix[0][3] = 100;
}

ALTER(nothing, (void)subject)
ALTER(several_hits, regions[HIT].size = regions[HIT].stride * 3)
ALTER(no_hits, miss(subject); regions[HIT] = (VkStridedDeviceAddressRegionKHR){0})
ALTER(miss_is_null, memset(record_at(subject, MISS), 0, 32))
ALTER(raygen_size, regions[RAYGEN].size *= 2)
ALTER(miss_stride, regions[MISS].stride += 8; regions[MISS].size += 8)
ALTER(miss_address, regions[MISS].deviceAddress += 16; memmove(record_at(subject, MISS) + 16, record_at(subject, MISS), 64))
ALTER(stride_large, miss(subject); regions[HIT].stride = regions[HIT].size = subject->limits.maxShaderGroupStride + 32)
ALTER(hit_beyond, miss(subject); regions[HIT].deviceAddress = subject->table.address + TABLE_SIZE - regions[HIT].stride;
      memcpy((char *)subject->table.mapped + TABLE_SIZE - regions[HIT].stride, subject->handles[HIT], 32);
      regions[HIT].size = regions[HIT].stride * 2)
ALTER(hit_with_miss, miss(subject); memcpy(record_at(subject, HIT), subject->handles[MISS], 32))
ALTER(hit_with_garbage, miss(subject); memset(record_at(subject, HIT), 0x5A, 32))
ALTER(hit_with_garbage_beside, miss(subject); memset(record_at(subject, HIT) + regions[HIT].stride, 0x5A, 32);
      regions[HIT].size = regions[HIT].stride * 2)
ALTER(far_instance, tlas_instance(&subject->tlas, 1)->instanceShaderBindingTableRecordOffset = 1;
      tlas_instance(&subject->tlas, 1)->transform.matrix[0][3] = 100)
ALTER(far_instance_has_a_record, far_instance(subject); regions[HIT].size = regions[HIT].stride * 2)
ALTER(far_instance_hidden, far_instance(subject); tlas_instance(&subject->tlas, 1)->mask = 0)
/* Of the BLAS, geometry 1 takes the record after that of geometry 0. */
ALTER(two_geometries, structure_destroy(subject->world, &subject->blas); subject->blas = blas_create_twice(subject->world);
      tlas_refer(&subject->tlas, 0, subject->blas.address); tlas_refer(&subject->tlas, 1, 0); miss(subject))
ALTER(two_geometries_and_records, two_geometries(subject); regions[HIT].size = regions[HIT].stride * 2)
ALTER(two_geometries_and_an_offset, two_geometries_and_records(subject);
      tlas_instance(&subject->tlas, 0)->instanceShaderBindingTableRecordOffset = 1)
ALTER(other_usage, buffer_destroy(subject->world, &subject->table);
      subject->table = buffer_create(subject->world, TABLE_SIZE, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT);
      for (int part = RAYGEN; part <= HIT; part++)
          regions[part].deviceAddress = subject->table.address + (VkDeviceSize)(PLACE * part);
      table_write(subject))

static const struct row {
    const char *name, *why;
    const char *rule; /* NULL: nothing is found */
    uint32_t findings;
    void (*alter)(struct subject *subject);
} rows[] = {
    {"valid", "three regions of one record", NULL, 0, nothing},
    {"several hit records", "those that nothing needs are zero", NULL, 0, several_hits},
    {"no hit region", "allowed without the flags against it", NULL, 0, no_hits},
    {"null miss shader", "no shader runs", NULL, 0, miss_is_null},
    {"raygen region of two records", "its size is its stride", "sbt.raygen_size", 1, raygen_size},
    {"misaligned stride", "by half of the alignment", "sbt.misaligned", 1, miss_stride},
    {"misaligned region", "by half of the alignment", "sbt.misaligned", 1, miss_address},
    {"large stride", "beyond maxShaderGroupStride", "sbt.limit", 1, stride_large},
    {"hit region beyond the buffer", "by one record", "sbt.beyond_buffer", 1, hit_beyond},
    {"hit region with a miss shader", "nothing else is there", "sbt.region_unusable", 1, hit_with_miss},
    {"hit region with garbage", "nothing else is there", "sbt.region_unusable", 1, hit_with_garbage},
    {"garbage beside a hit record", "nothing says that it is reached", NULL, 0, hit_with_garbage_beside},
    {"instance behind the table", "offset 1 of 1", "sbt.hit_beyond_table", 1, far_instance},
    {"instance within the table", "offset 1 of 2", NULL, 0, far_instance_has_a_record},
    {"hidden instance behind the table", "mask 0", NULL, 0, far_instance_hidden},
    {"two geometries, one record", "the rays' stride is 1", "sbt.hit_beyond_table", 1, two_geometries},
    {"two geometries, two records", "the rays' stride is 1", NULL, 0, two_geometries_and_records},
    {"two geometries and an offset of 1, two records", "1 + 1", "sbt.hit_beyond_table", 1, two_geometries_and_an_offset},
    {"usage of the table", "a storage buffer", "sbt.buffer_usage", 3, other_usage},
};
#define ROW_COUNT (sizeof rows / sizeof rows[0])

static void run_row(void **state)
{
    const struct row *row = *state;
    struct world *world = world_with_rays();
    struct subject subject;
    world->rule = row->rule ? row->rule : NEVER_BUILT;
    subject_init(&subject, world);
    row->alter(&subject);
    subject_trace(&subject);
    expect_findings(world, row->findings);
    subject_finish(&subject);
    world_finish(world);
    free(world);
}

/* The table holds handles of a pipeline before: equal ones where the driver gives such, so that both outcomes are right. */
static void handles_of_another_pipeline(void **state)
{
    (void)state;
    struct world *world = world_with_rays();
    struct subject subject;
    subject_init(&subject, world);
    unsigned char before[MAX_HANDLE];
    VkPipeline former = subject.pipeline;
    memcpy(before, subject.handles[RAYGEN], sizeof before);
    subject.pipeline = pipeline_create(&subject);
    handles_read(&subject, subject.pipeline);
    bool same = memcmp(before, subject.handles[RAYGEN], subject.limits.shaderGroupHandleSize) == 0;
    /* The former one stays alive, so that the driver survives. */
    subject_trace(&subject);
    world->rule = "sbt.raygen_handle";
    bool warned = messages_count(world, "sbt.region_unusable") > 0;
    assert_int_equal(messages_count(world, "sbt.raygen_handle"), !same);
    assert_true(same || warned);
    if (!same)
        assert_non_null(strstr(messages_find(world, "sbt.raygen_handle")->text, "belongs to pipeline"));
    vkDestroyPipeline(world->device, former, NULL);
    subject_finish(&subject);
    world->above_khronos = false;
    world_finish(world);
    free(world);
}

/* Indirect traces: the regions are judged, but no error rests on a record that may not be used. Those of the second kind lie in memory,
 * and are what they were when the trace ran. */
static void nothing_indirect(VkTraceRaysIndirectCommand2KHR *command)
{
    (void)command;
}

static void no_invocations(VkTraceRaysIndirectCommand2KHR *command)
{
    command->missShaderBindingTableAddress += 16;
    command->height = 0;
}

static void misaligned_indirect(VkTraceRaysIndirectCommand2KHR *command)
{
    command->missShaderBindingTableAddress += 16;
}

static void hits_beyond(VkTraceRaysIndirectCommand2KHR *command)
{
    command->hitShaderBindingTableSize = TABLE_SIZE;
}

static const struct indirect_row {
    int kind;
    void (*alter)(VkTraceRaysIndirectCommand2KHR *command);
    const char *rule; /* NULL: nothing is found */
    const char *statement;
} indirect_rows[] = {
    {1, nothing_indirect, NULL, "1 traces whose shader binding table was judged"},
    {2, nothing_indirect, NULL, "1 traces of whose shader binding table something was not read"},
    {2, no_invocations, NULL, "0 traces whose shader binding table was judged"},
    {2, misaligned_indirect, "sbt.misaligned", "1 traces whose shader binding table was judged"},
    {2, hits_beyond, "sbt.beyond_buffer", "1 traces whose shader binding table was judged"},
};

static void indirect(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof indirect_rows / sizeof indirect_rows[0]; i++) {
        const struct indirect_row *row = &indirect_rows[i];
        struct world *world = world_with_rays();
        struct subject subject;
        subject_init(&subject, world);
        miss(&subject);
        if (row->alter == misaligned_indirect) /* what lies there is valid in itself */
            memmove(record_at(&subject, MISS) + 16, record_at(&subject, MISS), 64);
        world->rule = row->rule ? row->rule : NEVER_BUILT;
        struct buffer arguments = buffer_create(world, sizeof(VkTraceRaysIndirectCommand2KHR), VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT);
        VkTraceRaysIndirectCommand2KHR command = {.raygenShaderRecordAddress = subject.regions[RAYGEN].deviceAddress,
                                                  .raygenShaderRecordSize = subject.regions[RAYGEN].size,
                                                  .missShaderBindingTableAddress = subject.regions[MISS].deviceAddress,
                                                  .missShaderBindingTableSize = subject.regions[MISS].size,
                                                  .missShaderBindingTableStride = subject.regions[MISS].stride,
                                                  .hitShaderBindingTableAddress = subject.regions[HIT].deviceAddress,
                                                  .hitShaderBindingTableSize = subject.regions[HIT].size,
                                                  .hitShaderBindingTableStride = subject.regions[HIT].stride,
                                                  .width = 1,
                                                  .height = 1,
                                                  .depth = 1};
        row->alter(&command);
        if (row->kind == 1)
            memset(record_at(&subject, RAYGEN), 0, 32); /* of no invocation: the numbers are zero */
        VkCommandBuffer commands = commands_begin(world, 0);
        commands_build_one(world, commands, &subject.blas);
        commands_barrier(commands);
        commands_build_one(world, commands, &subject.tlas);
        commands_barrier(commands);
        vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR, subject.pipeline);
        vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR, subject.pipeline_layout, 0, 1, &subject.set, 0, NULL);
        if (row->kind == 2)
            subject.CmdTraceRaysIndirect2KHR(commands, arguments.address);
        else
            subject.CmdTraceRaysIndirectKHR(commands, &subject.regions[RAYGEN], &subject.regions[MISS], &subject.regions[HIT],
                                            &subject.regions[CALLABLE], arguments.address);
        commands_end(commands);
        if (row->kind == 2) /* only now are the regions what the trace finds */
            memcpy(arguments.mapped, &command, sizeof command);
        submit_and_wait(world, commands);
        expect_findings(world, row->rule != NULL);
        buffer_destroy(world, &arguments);
        subject_finish(&subject);
        world_finish(world);
        const struct message *statement = messages_find(world, "statement");
        assert_non_null(statement);
        assert_non_null(strstr(statement->text, row->statement));
        free(world);
    }
}

/* A copy into the table has to come before the trace, and be visible to it. */
static void table_written_by_a_copy(void **state)
{
    (void)state;
    for (int ordered = 0; ordered < 2; ordered++) {
        struct world *world = world_with_rays();
        struct subject subject;
        world->rule = "sync.binding_table";
        subject_init(&subject, world);
        buffer_destroy(world, &subject.table);
        subject.table = buffer_create(world, TABLE_SIZE, TABLE | VK_BUFFER_USAGE_TRANSFER_DST_BIT);
        struct buffer source = buffer_create(world, MAX_HANDLE, VK_BUFFER_USAGE_TRANSFER_SRC_BIT);
        for (int part = RAYGEN; part <= HIT; part++)
            subject.regions[part].deviceAddress = subject.table.address + (VkDeviceSize)(PLACE * part);
        table_write(&subject);
        memcpy(source.mapped, subject.handles[HIT], MAX_HANDLE);
        VkCommandBuffer commands = commands_begin(world, 0);
        commands_build_one(world, commands, &subject.blas);
        commands_barrier(commands);
        commands_build_one(world, commands, &subject.tlas);
        commands_barrier(commands);
        VkBufferCopy region = {0, PLACE * HIT, subject.limits.shaderGroupHandleSize};
        vkCmdCopyBuffer(commands, source.handle, subject.table.handle, 1, &region);
        if (ordered)
            commands_barrier(commands);
        vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR, subject.pipeline);
        vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR, subject.pipeline_layout, 0, 1, &subject.set, 0, NULL);
        subject.CmdTraceRaysKHR(commands, &subject.regions[RAYGEN], &subject.regions[MISS], &subject.regions[HIT],
                                &subject.regions[CALLABLE], 1, 1, 1);
        commands_end(commands);
        submit_and_wait(world, commands);
        expect_findings(world, !ordered);
        buffer_destroy(world, &source);
        subject_finish(&subject);
        world->above_khronos &= ordered;
        world_finish(world);
        free(world);
    }
}

static void recursion_beyond_the_device(void **state)
{
    (void)state;
    struct world *world = world_with_rays();
    struct subject subject;
    world->rule = "pipeline.recursion_depth";
    subject_init(&subject, world);
    expect_findings(world, 0);
    subject.depth = subject.limits.maxRayRecursionDepth + 1;
    VkPipeline deep = pipeline_create(&subject);
    expect_findings(world, 1);
    vkDestroyPipeline(world->device, deep, NULL);
    subject_finish(&subject);
    world_finish(world);
    free(world);
}

static void null_miss_shader_excluded(void **state)
{
    (void)state;
    struct world *world = world_with_rays();
    struct subject subject;
    world->rule = "sbt.null_group";
    subject_init(&subject, world);
    vkDestroyPipeline(world->device, subject.pipeline, NULL);
    subject.flags = VK_PIPELINE_CREATE_RAY_TRACING_NO_NULL_MISS_SHADERS_BIT_KHR;
    subject.pipeline = pipeline_create(&subject);
    handles_read(&subject, subject.pipeline);
    table_write(&subject);
    subject_trace(&subject);
    expect_findings(world, 0);
    memset(record_at(&subject, MISS), 0, 32);
    subject_trace(&subject);
    expect_findings(world, 1);
    subject_finish(&subject);
    world_finish(world);
    free(world);
}

int main(void)
{
    struct CMUnitTest tests[ROW_COUNT + 5];
    size_t count = 0;
    for (; count < ROW_COUNT; count++)
        tests[count] = (struct CMUnitTest){
            .name = rows[count].name, .test_func = run_row, .initial_state = (void *)(uintptr_t)&rows[count]};
    tests[count++] = (struct CMUnitTest)cmocka_unit_test(handles_of_another_pipeline);
    tests[count++] = (struct CMUnitTest)cmocka_unit_test(indirect);
    tests[count++] = (struct CMUnitTest)cmocka_unit_test(table_written_by_a_copy);
    tests[count++] = (struct CMUnitTest)cmocka_unit_test(recursion_beyond_the_device);
    tests[count++] = (struct CMUnitTest)cmocka_unit_test(null_miss_shader_excluded);
    return _cmocka_run_group_tests("sbt", tests, count, NULL, NULL);
}
