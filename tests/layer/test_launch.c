/* SPDX-License-Identifier: Apache-2.0 */
/* What a ray-tracing pipeline allows and what a trace is given, as its shaders are held against it on a driver: a row that breaks a rule stands
 * beside one that just does not. */
#include <stdio.h>
#include <string.h>

#include "layer/shader.h"
#include "tests/layer/harness.h"

#include "launch_positions_rchit.spv.h"
#include "launch_rcall.spv.h"
#include "launch_rchit.spv.h"
#include "launch_rgen.spv.h"
#include "launch_rint.spv.h"

#define REQUIRE(call) assert_int_equal(call, VK_SUCCESS)
#define COMMAND(name) ((PFN_vk##name)vkGetDeviceProcAddr(world->device, "vk" #name))
#define RAYS VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR
#define LANES 8u
/* Records of the callable region that are there, whatever the trace is told: a call beyond does no harm. */
#define CALLABLES 4u
#define SKIP_TRIANGLES 0x100u

enum { RGEN, RCHIT, RCALL, STAGES };
enum way { DIRECT, INDIRECT, INDIRECT_2 };

static const struct row {
    const char *name, *why;
    bool linked; /* all but the ray generation shader come from a library */
    enum way way;
    uint32_t callables, recursion, payload; /* of the trace, of the pipeline; payload 0: no interface */
    VkPipelineCreateFlags flags;
    struct {
        uint32_t call, depth, flags;
    } push;
    float result; /* in safe mode, if something is wrong */
    const char *expected, *text; /* NULL: nothing is found */
    const char *positions;       /* the hit shader reads vertices, of a BLAS with or without ALLOW_DATA_ACCESS; NULL: another */
} rows[] = {
    {"in bounds", "the last callable, the deepest trace", false, DIRECT, 2, 2, 0, 0, {1, 2, 0}, 12, NULL, NULL, NULL},
    {"callable", "one beyond", false, DIRECT, 2, 2, 0, 0, {2, 2, 0}, 2, "call.range", "index 2 where the table has 2 records", NULL},
    {"callable", "there is no table", false, DIRECT, 0, 2, 0, 0, {0, 2, 0}, 2, "call.range", "index 0 where the table has 0 records", NULL},
    {"callable", "one beyond, from a library", true, DIRECT, 2, 2, 0, 0, {2, 2, 0}, 2, "call.range", "index 2 ", NULL},
    {"callable", "an indirect trace has its table on the host", false, INDIRECT, 1, 2, 0, 0, {1, 2, 0}, 2, "call.range", "index 1 where the table has 1 record.", NULL},
    {"indirect", "all in bounds", false, INDIRECT, 2, 2, 0, 0, {1, 2, 0}, 12, NULL, NULL, NULL},
    {"indirect 2", "its table is in device memory, and not judged", false, INDIRECT_2, 1, 2, 0, 0, {1, 2, 0}, 12, NULL, NULL, NULL},
    {"recursion", "one too deep", false, DIRECT, 2, 2, 0, 0, {0, 3, 0}, 12, "trace.recursion", "from depth 2 where 2 is the most", NULL},
    {"recursion", "a pipeline that allows more", false, DIRECT, 2, 3, 0, 0, {0, 3, 0}, 13, NULL, NULL, NULL},
    {"recursion", "one too deep, from a library", true, DIRECT, 2, 2, 0, 0, {0, 3, 0}, 12, "trace.recursion", "from depth 2 ", NULL},
    {"recursion", "deep enough, from a library", true, DIRECT, 2, 3, 0, 0, {0, 3, 0}, 13, NULL, NULL, NULL},
    {"recursion", "in a pipeline without any: what a hit must not do is not reached", false, DIRECT, 2, 1, 0, 0, {0, 1, 0}, 11, NULL, NULL, NULL},
    {"recursion", "in a pipeline without any", false, DIRECT, 2, 1, 0, 0, {0, 2, 0}, 11, "trace.recursion", "OpTraceRayKHR", NULL},
    {"recursion", "an indirect trace", false, INDIRECT, 2, 2, 0, 0, {0, 3, 0}, 12, "trace.recursion", "from depth 2 ", NULL},
    {"recursion", "an indirect trace with its table in device memory", false, INDIRECT_2, 2, 2, 0, 0, {0, 3, 0}, 12, "trace.recursion", "from depth 2 ", NULL},
    {"payload", "32 bytes where 16 are declared", true, DIRECT, 2, 2, 16, 0, {0, 2, 0}, 10, "trace.payload_size", "OpTraceRayKHR", NULL},
    {"payload", "32 bytes where 32 are declared", true, DIRECT, 2, 2, 32, 0, {0, 2, 0}, 12, NULL, NULL, NULL},
    {"flags", "nothing is left where AABBs are skipped", false, DIRECT, 2, 2, 0, VK_PIPELINE_CREATE_RAY_TRACING_SKIP_AABBS_BIT_KHR, {0, 2, SKIP_TRIANGLES}, 10,
     "trace.skipped_by_pipeline", "OpTraceRayKHR", NULL},
    {"flags", "the pipeline skips nothing", false, DIRECT, 2, 2, 0, 0, {0, 2, SKIP_TRIANGLES}, 10, NULL, NULL, NULL},
    {"flags", "the ray skips nothing", false, DIRECT, 2, 2, 0, VK_PIPELINE_CREATE_RAY_TRACING_SKIP_AABBS_BIT_KHR, {0, 2, 0}, 12, NULL, NULL, NULL},
    {"positions", "no BLAS of the device lets them be read", false, DIRECT, 2, 1, 0, 0, {0, 1, 0}, 10, "structure.no_positions", "HitTriangleVertexPositions", "without"},
    {"positions", "a BLAS lets them be read", false, DIRECT, 2, 1, 0, 0, {0, 1, 0}, 11, NULL, NULL, "with"},
};

/* A pipeline with all that its trace needs. */
struct subject {
    struct structure blas, tlas;
    VkDescriptorSetLayout layout;
    VkPipelineLayout pipeline_layout;
    VkDescriptorPool pool;
    VkDescriptorSet set;
    VkPipeline pipelines[2]; /* and its library */
    struct buffer result, table, indirect;
    VkStridedDeviceAddressRegionKHR regions[4];
};

static void world_create(struct world *world, const struct world_options *more)
{
    static const char *const extensions[] = {VK_KHR_RAY_TRACING_PIPELINE_EXTENSION_NAME, VK_KHR_PIPELINE_LIBRARY_EXTENSION_NAME,
                                             VK_KHR_RAY_TRACING_MAINTENANCE_1_EXTENSION_NAME,
                                             VK_KHR_RAY_TRACING_POSITION_FETCH_EXTENSION_NAME};
    VkPhysicalDeviceRayTracingPositionFetchFeaturesKHR positions = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_POSITION_FETCH_FEATURES_KHR, .rayTracingPositionFetch = VK_TRUE};
    VkPhysicalDeviceRayTracingMaintenance1FeaturesKHR maintenance = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_MAINTENANCE_1_FEATURES_KHR,
        .pNext = &positions,
        .rayTracingMaintenance1 = VK_TRUE,
        .rayTracingPipelineTraceRaysIndirect2 = VK_TRUE};
    VkPhysicalDeviceRayTracingPipelineFeaturesKHR rays = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_FEATURES_KHR,
                                                          .pNext = &maintenance,
                                                          .rayTracingPipeline = VK_TRUE,
                                                          .rayTracingPipelineTraceRaysIndirect = VK_TRUE,
                                                          .rayTraversalPrimitiveCulling = VK_TRUE};
    struct world_options options = *more;
    options.features = &rays;
    options.extensions = extensions;
    options.extension_count = sizeof extensions / sizeof extensions[0];
    world_init(world, &options);
}

static void bindings_create(struct world *world, struct subject *subject)
{
    const VkShaderStageFlags all = VK_SHADER_STAGE_ALL;
    const VkDescriptorSetLayoutBinding bindings[] = {{0, VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, 1, all, NULL},
                                                     {1, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, all, NULL}};
    const VkDescriptorPoolSize sizes[] = {{bindings[0].descriptorType, 1}, {bindings[1].descriptorType, 1}};
    const VkPushConstantRange push = {all, 0, sizeof rows[0].push};
    VkDescriptorSetLayoutCreateInfo layout = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO, .bindingCount = 2, .pBindings = bindings};
    REQUIRE(vkCreateDescriptorSetLayout(world->device, &layout, NULL, &subject->layout));
    VkPipelineLayoutCreateInfo pipeline = {.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                           .setLayoutCount = 1,
                                           .pSetLayouts = &subject->layout,
                                           .pushConstantRangeCount = 1,
                                           .pPushConstantRanges = &push};
    REQUIRE(vkCreatePipelineLayout(world->device, &pipeline, NULL, &subject->pipeline_layout));
    VkDescriptorPoolCreateInfo pool = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO, .maxSets = 1, .poolSizeCount = 2, .pPoolSizes = sizes};
    REQUIRE(vkCreateDescriptorPool(world->device, &pool, NULL, &subject->pool));
    VkDescriptorSetAllocateInfo allocate = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                            .descriptorPool = subject->pool,
                                            .descriptorSetCount = 1,
                                            .pSetLayouts = &subject->layout};
    REQUIRE(vkAllocateDescriptorSets(world->device, &allocate, &subject->set));
    subject->result = buffer_create(world, LANES * sizeof(float), VK_BUFFER_USAGE_STORAGE_BUFFER_BIT);
    const VkDescriptorBufferInfo result = {subject->result.handle, 0, VK_WHOLE_SIZE};
    const VkWriteDescriptorSetAccelerationStructureKHR scene = {
        .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET_ACCELERATION_STRUCTURE_KHR,
        .accelerationStructureCount = 1,
        .pAccelerationStructures = &subject->tlas.handle};
    VkWriteDescriptorSet writes[2];
    for (uint32_t i = 0; i < 2; i++)
        writes[i] = (VkWriteDescriptorSet){.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                           .pNext = i ? NULL : &scene,
                                           .dstSet = subject->set,
                                           .dstBinding = i,
                                           .descriptorCount = 1,
                                           .descriptorType = bindings[i].descriptorType,
                                           .pBufferInfo = i ? &result : NULL};
    vkUpdateDescriptorSets(world->device, 2, writes, 0, NULL);
}

static const VkShaderModuleCreateInfo codes[] = {
#define CODE(array) {VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, NULL, 0, sizeof array, array}
    CODE(launch_rgen_spv), CODE(launch_rchit_spv), CODE(launch_rcall_spv), CODE(launch_rint_spv), CODE(launch_positions_rchit_spv)};

static VkPipelineShaderStageCreateInfo stage_of(int code, VkShaderStageFlagBits stage)
{
    return (VkPipelineShaderStageCreateInfo){
        .sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO, .pNext = &codes[code], .stage = stage, .pName = "main"};
}

static VkRayTracingShaderGroupCreateInfoKHR group_of(bool hits, uint32_t shader)
{
    return (VkRayTracingShaderGroupCreateInfoKHR){
        .sType = VK_STRUCTURE_TYPE_RAY_TRACING_SHADER_GROUP_CREATE_INFO_KHR,
        .type = hits ? VK_RAY_TRACING_SHADER_GROUP_TYPE_TRIANGLES_HIT_GROUP_KHR : VK_RAY_TRACING_SHADER_GROUP_TYPE_GENERAL_KHR,
        .generalShader = hits ? VK_SHADER_UNUSED_KHR : shader,
        .closestHitShader = hits ? shader : VK_SHADER_UNUSED_KHR,
        .anyHitShader = VK_SHADER_UNUSED_KHR,
        .intersectionShader = VK_SHADER_UNUSED_KHR};
}

static void pipeline_create(struct world *world, struct subject *subject, const struct row *row)
{
    static const VkShaderStageFlagBits kinds[] = {VK_SHADER_STAGE_RAYGEN_BIT_KHR, VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR,
                                                  VK_SHADER_STAGE_CALLABLE_BIT_KHR};
    VkPipelineShaderStageCreateInfo stages[STAGES];
    VkRayTracingShaderGroupCreateInfoKHR groups[STAGES], linked[STAGES];
    for (uint32_t i = 0; i < STAGES; i++) {
        stages[i] = stage_of(i == RCHIT && row->positions ? STAGES + 1 : (int)i, kinds[i]);
        groups[i] = group_of(i == RCHIT, i);
        linked[i] = group_of(i == RCHIT, i ? i - 1 : 0);
    }
    VkRayTracingPipelineInterfaceCreateInfoKHR interface = {.sType = VK_STRUCTURE_TYPE_RAY_TRACING_PIPELINE_INTERFACE_CREATE_INFO_KHR,
                                                            .maxPipelineRayPayloadSize = row->payload ? row->payload : 32,
                                                            .maxPipelineRayHitAttributeSize = 8};
    VkPipelineLibraryCreateInfoKHR libraries = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_LIBRARY_CREATE_INFO_KHR, .libraryCount = 1, .pLibraries = &subject->pipelines[1]};
    VkRayTracingPipelineCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_RAY_TRACING_PIPELINE_CREATE_INFO_KHR,
                                              .flags = row->flags,
                                              .stageCount = STAGES,
                                              .pStages = stages,
                                              .groupCount = STAGES,
                                              .pGroups = groups,
                                              .maxPipelineRayRecursionDepth = row->recursion,
                                              .layout = subject->pipeline_layout};
    if (row->linked) {
        VkRayTracingPipelineCreateInfoKHR library = info;
        library.flags |= VK_PIPELINE_CREATE_LIBRARY_BIT_KHR;
        library.stageCount = library.groupCount = STAGES - 1;
        library.pStages = stages + 1;
        library.pGroups = linked + 1;
        library.pLibraryInterface = info.pLibraryInterface = &interface;
        REQUIRE(COMMAND(CreateRayTracingPipelinesKHR)(world->device, VK_NULL_HANDLE, VK_NULL_HANDLE, 1, &library, NULL,
                                                      &subject->pipelines[1]));
        info.stageCount = info.groupCount = 1;
        info.pLibraryInfo = &libraries;
    }
    REQUIRE(COMMAND(CreateRayTracingPipelinesKHR)(world->device, VK_NULL_HANDLE, VK_NULL_HANDLE, 1, &info, NULL, &subject->pipelines[0]));
}

static void table_create(struct world *world, struct subject *subject, const struct row *row)
{
    VkPhysicalDeviceRayTracingPipelinePropertiesKHR limits = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_PROPERTIES_KHR};
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &limits};
    vkGetPhysicalDeviceProperties2(world->physical, &properties);
    const VkDeviceSize stride = limits.shaderGroupBaseAlignment > limits.shaderGroupHandleSize ? limits.shaderGroupBaseAlignment
                                                                                               : limits.shaderGroupHandleSize;
    unsigned char handles[STAGES * 64];
    assert_true(limits.shaderGroupHandleSize <= 64);
    REQUIRE(COMMAND(GetRayTracingShaderGroupHandlesKHR)(world->device, subject->pipelines[0], 0, STAGES, sizeof handles, handles));
    /* Ray generation, hit, and callables. */
    subject->table = buffer_create(world, (3 + CALLABLES) * stride, VK_BUFFER_USAGE_SHADER_BINDING_TABLE_BIT_KHR);
    VkDeviceAddress start = (subject->table.address + stride - 1) / stride * stride;
    unsigned char *at = (unsigned char *)subject->table.mapped + (start - subject->table.address);
    for (uint32_t i = 0; i < 2 + CALLABLES; i++)
        memcpy(at + i * stride, handles + (i < RCALL ? i : RCALL) * limits.shaderGroupHandleSize, limits.shaderGroupHandleSize);
    subject->regions[0] = (VkStridedDeviceAddressRegionKHR){start, stride, stride};
    subject->regions[2] = (VkStridedDeviceAddressRegionKHR){start + stride, stride, stride};
    subject->regions[3] = (VkStridedDeviceAddressRegionKHR){start + 2 * stride, stride, row->callables * stride};
}

static void indirect_create(struct world *world, struct subject *subject)
{
    const VkStridedDeviceAddressRegionKHR *r = subject->regions;
    const VkTraceRaysIndirectCommand2KHR command = {
        .raygenShaderRecordAddress = r[0].deviceAddress,
        .raygenShaderRecordSize = r[0].size,
        .hitShaderBindingTableAddress = r[2].deviceAddress,
        .hitShaderBindingTableSize = r[2].size,
        .hitShaderBindingTableStride = r[2].stride,
        .callableShaderBindingTableAddress = r[3].deviceAddress,
        .callableShaderBindingTableSize = r[3].size,
        .callableShaderBindingTableStride = r[3].stride,
        .width = LANES,
        .height = 1,
        .depth = 1};
    subject->indirect = buffer_create(world, sizeof command, VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT);
    memcpy(subject->indirect.mapped, &command, sizeof command);
}

static void subject_trace(struct world *world, struct subject *subject, const struct row *row)
{
    const VkStridedDeviceAddressRegionKHR *r = subject->regions;
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &subject->blas);
    commands_barrier(commands);
    commands_build_one(world, commands, &subject->tlas);
    commands_barrier(commands);
    vkCmdBindPipeline(commands, RAYS, subject->pipelines[0]);
    vkCmdBindDescriptorSets(commands, RAYS, subject->pipeline_layout, 0, 1, &subject->set, 0, NULL);
    vkCmdPushConstants(commands, subject->pipeline_layout, VK_SHADER_STAGE_ALL, 0, sizeof row->push, &row->push);
    if (row->way == DIRECT)
        COMMAND(CmdTraceRaysKHR)(commands, &r[0], &r[1], &r[2], &r[3], LANES, 1, 1);
    else if (row->way == INDIRECT)
        COMMAND(CmdTraceRaysIndirectKHR)
        (commands, &r[0], &r[1], &r[2], &r[3], subject->indirect.address + offsetof(VkTraceRaysIndirectCommand2KHR, width));
    else
        COMMAND(CmdTraceRaysIndirect2KHR)(commands, subject->indirect.address);
    commands_barrier(commands);
    commands_end(commands);
    submit_and_wait(world, commands);
}

static void subject_create(struct world *world, struct subject *subject, const struct row *row)
{
    const bool access = row->positions && strcmp(row->positions, "with") == 0;
    *subject = (struct subject){.blas = blas_create(world, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
                                                    access ? VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_DATA_ACCESS_KHR : 0),
                                .tlas = tlas_create(world, 1)};
    tlas_refer(&subject->tlas, 0, subject->blas.address);
    bindings_create(world, subject);
    pipeline_create(world, subject, row);
    table_create(world, subject, row);
    indirect_create(world, subject);
}

static void subject_destroy(struct world *world, struct subject *subject)
{
    for (int i = 0; i < 2; i++)
        vkDestroyPipeline(world->device, subject->pipelines[i], NULL);
    vkDestroyPipelineLayout(world->device, subject->pipeline_layout, NULL);
    vkDestroyDescriptorPool(world->device, subject->pool, NULL);
    vkDestroyDescriptorSetLayout(world->device, subject->layout, NULL);
    buffer_destroy(world, &subject->result);
    buffer_destroy(world, &subject->table);
    buffer_destroy(world, &subject->indirect);
    structure_destroy(world, &subject->tlas);
    structure_destroy(world, &subject->blas);
}

/* Whether the messages are those of the row: errors of one rule, and nothing else. */
static bool told_as_expected(const struct world *world, const struct row *row)
{
    bool found = false, others = false;
    for (uint32_t i = 0; i < world->messages.count && i < 64; i++) {
        const struct message *message = &world->messages.list[i];
        bool is_rule = strchr(message->id, '.') != NULL, wanted = row->expected && strcmp(message->id, row->expected) == 0;
        others |= is_rule && !wanted;
        found |= wanted && message->severity == VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT && strstr(message->text, row->text);
    }
    return !others && found == (row->expected != NULL);
}

static void every_row(void **state)
{
    int failures = 0;
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        const struct row *row = &rows[i];
        static struct world world;
        struct subject subject;
        /* A driver need not survive what is wrong. */
        const VkBool32 safe = row->expected != NULL;
        const VkLayerSettingEXT setting = {"VK_LAYER_GNOMON_ray_tracing", "safe_mode", VK_LAYER_SETTING_TYPE_BOOL32_EXT, 1, &safe};
        world_create(&world, &(struct world_options){.settings = &setting, .setting_count = 1});
        world.above_khronos &= !row->expected; /* it may object to what is broken on purpose */
        subject_create(&world, &subject, row);
        for (int times = 0; times < 2; times++)
            subject_trace(&world, &subject, row);
        const float *result = subject.result.mapped;
        bool same = true;
        for (uint32_t lane = 0; lane < LANES; lane++)
            same &= result[lane] == row->result;
        if (!same || !told_as_expected(&world, row)) {
            print_error("%s (%s): expected %s \"%s\" and %g in every lane, found %g in the first and\n", row->name, row->why,
                        row->expected ? row->expected : "nothing", row->text ? row->text : "", (double)row->result, (double)result[0]);
            for (uint32_t m = 0; m < world.messages.count && m < 64; m++)
                print_error("  %s: %s\n", world.messages.list[m].id, world.messages.list[m].text);
            failures++;
        }
        subject_destroy(&world, &subject);
        world_finish(&world);
    }
    assert_int_equal(failures, 0);
}

/* An attribute larger than the interface declares is told when the pipeline is made; it is not traced, as there is no box. */
static void attribute(void **state)
{
    static const struct {
        uint32_t size, told;
    } table[] = {{16, 1}, {32, 0}};
    (void)state;
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        static struct world world_storage;
        struct world *world = &world_storage;
        struct subject subject = {0};
        world_create(world, &(struct world_options){0});
        world->above_khronos &= !table[i].told;
        subject.tlas = tlas_create(world, 1);
        bindings_create(world, &subject);
        const VkPipelineShaderStageCreateInfo stage = stage_of(STAGES, VK_SHADER_STAGE_INTERSECTION_BIT_KHR);
        VkRayTracingShaderGroupCreateInfoKHR group = group_of(false, VK_SHADER_UNUSED_KHR);
        group.type = VK_RAY_TRACING_SHADER_GROUP_TYPE_PROCEDURAL_HIT_GROUP_KHR;
        group.intersectionShader = 0;
        const VkRayTracingPipelineInterfaceCreateInfoKHR interface = {
            .sType = VK_STRUCTURE_TYPE_RAY_TRACING_PIPELINE_INTERFACE_CREATE_INFO_KHR,
            .maxPipelineRayPayloadSize = 4,
            .maxPipelineRayHitAttributeSize = table[i].size};
        const VkRayTracingPipelineCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_RAY_TRACING_PIPELINE_CREATE_INFO_KHR,
                                                        .flags = VK_PIPELINE_CREATE_LIBRARY_BIT_KHR,
                                                        .stageCount = 1,
                                                        .pStages = &stage,
                                                        .groupCount = 1,
                                                        .pGroups = &group,
                                                        .maxPipelineRayRecursionDepth = 1,
                                                        .pLibraryInterface = &interface,
                                                        .layout = subject.pipeline_layout};
        REQUIRE(COMMAND(CreateRayTracingPipelinesKHR)(world->device, VK_NULL_HANDLE, VK_NULL_HANDLE, 1, &info, NULL, &subject.pipelines[0]));
        assert_int_equal(messages_count(world, "report.attribute_size"), table[i].told);
        vkDestroyPipeline(world->device, subject.pipelines[0], NULL);
        subject.pipelines[0] = VK_NULL_HANDLE;
        vkDestroyPipelineLayout(world->device, subject.pipeline_layout, NULL);
        vkDestroyDescriptorPool(world->device, subject.pool, NULL);
        vkDestroyDescriptorSetLayout(world->device, subject.layout, NULL);
        buffer_destroy(world, &subject.result);
        structure_destroy(world, &subject.tlas);
        world_finish(world);
    }
}

/* Two queues share what they are told, so that nothing is concluded from it any more; what the module alone proves still holds. */
static void several_queues(void **state)
{
    (void)state;
    struct gn_shaders shaders = {.options = {.static_only = false}};
    struct gn_device device = {.shaders = &shaders};
    const struct gn_spirv_site proved = {.wrong = UINT64_C(1) << GN_SPIRV_RULE_TRACE_RECURSION}, open = {.wrong = 0};
    gn_launch_executed(&device, 1);
    gn_launch_executed(&device, 1);
    assert_false(shaders.launch_unsure);
    gn_launch_executed(&device, 2);
    assert_true(shaders.launch_unsure);
    assert_true(gn_launch_matters(&open, GN_SPIRV_RULE_CALL_RANGE));
    assert_true(gn_launch_matters(&open, GN_SPIRV_RULE_TRACE_RECURSION));
    assert_false(gn_launch_matters(&proved, GN_SPIRV_RULE_TRACE_RECURSION));
    assert_false(gn_launch_matters(&open, GN_SPIRV_RULE_TRACE_NAN));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_row),
        cmocka_unit_test(attribute),
        cmocka_unit_test(several_queues),
    };
    return cmocka_run_group_tests_name("layer.launch", tests, NULL, NULL);
}
