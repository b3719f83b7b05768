/* SPDX-License-Identifier: Apache-2.0 */
/* The tracing part of the Vulkan program that the layer's tests run. */
#include "tests/layer/trace.h"

#include <string.h>

#include "always.spv.h"
#include "array.spv.h"
#include "maybe.spv.h"

#define REQUIRE(call) assert_int_equal(call, VK_SUCCESS)

/* What a template reads. */
struct data {
    VkAccelerationStructureKHR tlas[2];
    VkDescriptorBufferInfo hits;
};

static bool pushes(enum trace_way way)
{
    return way == TRACE_BY_PUSH || way == TRACE_BY_PUSH_TEMPLATE;
}

static void create_template(struct world *world, struct tracer *tracer)
{
    bool push = tracer->way == TRACE_BY_PUSH_TEMPLATE;
    VkDescriptorUpdateTemplateEntry entries[2] = {
        {.dstBinding = 0,
         .descriptorCount = tracer->elements,
         .descriptorType = VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR,
         .offset = offsetof(struct data, tlas),
         .stride = sizeof(VkAccelerationStructureKHR)},
        {.dstBinding = 1,
         .descriptorCount = 1,
         .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
         .offset = offsetof(struct data, hits)},
    };
    VkDescriptorUpdateTemplateCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_UPDATE_TEMPLATE_CREATE_INFO,
        .descriptorUpdateEntryCount = 2,
        .pDescriptorUpdateEntries = entries,
        .templateType = push ? VK_DESCRIPTOR_UPDATE_TEMPLATE_TYPE_PUSH_DESCRIPTORS : VK_DESCRIPTOR_UPDATE_TEMPLATE_TYPE_DESCRIPTOR_SET,
        .descriptorSetLayout = push ? VK_NULL_HANDLE : tracer->layout,
        .pipelineBindPoint = VK_PIPELINE_BIND_POINT_COMPUTE,
        .pipelineLayout = tracer->pipeline_layout};
    REQUIRE(vkCreateDescriptorUpdateTemplate(world->device, &info, NULL, &tracer->update));
}

void trace_world_init(struct world *world, bool creation_messenger)
{
    const char *const extensions[] = {VK_EXT_MUTABLE_DESCRIPTOR_TYPE_EXTENSION_NAME, VK_EXT_DESCRIPTOR_BUFFER_EXTENSION_NAME};
    VkPhysicalDeviceDescriptorBufferFeaturesEXT buffers = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DESCRIPTOR_BUFFER_FEATURES_EXT, .descriptorBuffer = VK_TRUE};
    VkPhysicalDeviceMutableDescriptorTypeFeaturesEXT features = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MUTABLE_DESCRIPTOR_TYPE_FEATURES_EXT,
        .pNext = &buffers,
        .mutableDescriptorType = VK_TRUE};
    struct world_options options = {
        .extensions = extensions, .extension_count = 2, .features = &features, .creation_messenger = creation_messenger};
    world_init(world, &options);
}

struct tracer tracer_create(struct world *world, enum trace_shader shader, enum trace_way way)
{
    static const struct {
        const uint32_t *code;
        size_t size;
    } shaders[TRACE_SHADERS] = {
        {always_spv, sizeof always_spv}, {maybe_spv, sizeof maybe_spv}, {array_spv, sizeof array_spv}};
    static const VkDescriptorType types[] = {VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER};
    static const VkMutableDescriptorTypeListEXT lists[] = {{2, types}, {0, NULL}};
    const VkMutableDescriptorTypeCreateInfoEXT mutables = {.sType = VK_STRUCTURE_TYPE_MUTABLE_DESCRIPTOR_TYPE_CREATE_INFO_EXT,
                                                           .mutableDescriptorTypeListCount = 2,
                                                           .pMutableDescriptorTypeLists = lists};
    struct tracer tracer = {.way = way, .elements = shader == TRACE_ARRAY ? 2 : 1};
    bool other = way == TRACE_BY_MUTABLE;
    VkDescriptorType type = other ? VK_DESCRIPTOR_TYPE_MUTABLE_EXT : VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR;
    VkDescriptorSetLayoutBinding bindings[2] = {
        {0, type, tracer.elements, VK_SHADER_STAGE_COMPUTE_BIT, NULL},
        {1, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, VK_SHADER_STAGE_COMPUTE_BIT, NULL}};
    VkDescriptorSetLayoutCreateInfo layout = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO,
        .pNext = other ? &mutables : NULL,
        .flags = pushes(way)              ? VK_DESCRIPTOR_SET_LAYOUT_CREATE_PUSH_DESCRIPTOR_BIT_KHR
                 : way == TRACE_BY_BUFFER ? VK_DESCRIPTOR_SET_LAYOUT_CREATE_DESCRIPTOR_BUFFER_BIT_EXT
                                          : 0,
        .bindingCount = 2,
        .pBindings = bindings};
    REQUIRE(vkCreateDescriptorSetLayout(world->device, &layout, NULL, &tracer.layout));
    VkPipelineLayoutCreateInfo pipeline_layout = {.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                                  .setLayoutCount = 1,
                                                  .pSetLayouts = &tracer.layout};
    REQUIRE(vkCreatePipelineLayout(world->device, &pipeline_layout, NULL, &tracer.pipeline_layout));
    VkShaderModuleCreateInfo code = {.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO,
                                     .codeSize = shaders[shader].size,
                                     .pCode = shaders[shader].code};
    VkShaderModule module;
    REQUIRE(vkCreateShaderModule(world->device, &code, NULL, &module));
    VkComputePipelineCreateInfo info = {.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
                                        .flags = way == TRACE_BY_BUFFER ? VK_PIPELINE_CREATE_DESCRIPTOR_BUFFER_BIT_EXT : 0,
                                        .stage = {.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                  .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                                                  .module = module,
                                                  .pName = "main"},
                                        .layout = tracer.pipeline_layout};
    REQUIRE(vkCreateComputePipelines(world->device, VK_NULL_HANDLE, 1, &info, NULL, &tracer.pipeline));
    vkDestroyShaderModule(world->device, module, NULL);
    VkDescriptorPoolSize sizes[2] = {{type, 4}, {VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 4}};
    VkDescriptorPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO,
                                       .pNext = other ? &mutables : NULL,
                                       .maxSets = 2,
                                       .poolSizeCount = 2,
                                       .pPoolSizes = sizes};
    REQUIRE(vkCreateDescriptorPool(world->device, &pool, NULL, &tracer.pool));
    VkDescriptorSetAllocateInfo allocation = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                              .descriptorPool = tracer.pool,
                                              .descriptorSetCount = 1,
                                              .pSetLayouts = &tracer.layout};
    if (!pushes(way) && way != TRACE_BY_BUFFER) {
        REQUIRE(vkAllocateDescriptorSets(world->device, &allocation, &tracer.set));
        REQUIRE(vkAllocateDescriptorSets(world->device, &allocation, &tracer.other));
    }
    if (way == TRACE_BY_TEMPLATE || way == TRACE_BY_PUSH_TEMPLATE)
        create_template(world, &tracer);
    if (way == TRACE_BY_BUFFER)
        tracer.descriptors = buffer_create(world, 4096, VK_BUFFER_USAGE_RESOURCE_DESCRIPTOR_BUFFER_BIT_EXT);
    tracer.hits = buffer_create(world, 8, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT);
    return tracer;
}

void tracer_destroy(struct world *world, struct tracer *tracer)
{
    vkDestroyDescriptorUpdateTemplate(world->device, tracer->update, NULL);
    vkDestroyDescriptorPool(world->device, tracer->pool, NULL);
    vkDestroyPipeline(world->device, tracer->pipeline, NULL);
    vkDestroyPipelineLayout(world->device, tracer->pipeline_layout, NULL);
    vkDestroyDescriptorSetLayout(world->device, tracer->layout, NULL);
    buffer_destroy(world, &tracer->hits);
    if (tracer->descriptors.handle)
        buffer_destroy(world, &tracer->descriptors);
}

struct writes {
    VkAccelerationStructureKHR tlas[2];
    VkDescriptorBufferInfo hits;
    VkWriteDescriptorSetAccelerationStructureKHR structures;
    VkWriteDescriptorSet list[2];
};

static void writes_fill(struct writes *writes, const struct tracer *tracer, VkDescriptorSet set, VkAccelerationStructureKHR tlas)
{
    *writes = (struct writes){.tlas = {tlas, tlas}, .hits = {tracer->hits.handle, 0, VK_WHOLE_SIZE}};
    writes->structures = (VkWriteDescriptorSetAccelerationStructureKHR){
        .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET_ACCELERATION_STRUCTURE_KHR,
        .accelerationStructureCount = tracer->elements,
        .pAccelerationStructures = writes->tlas};
    writes->list[0] = (VkWriteDescriptorSet){.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                             .pNext = &writes->structures,
                                             .dstSet = set,
                                             .dstBinding = 0,
                                             .descriptorCount = tracer->elements,
                                             .descriptorType = VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR};
    writes->list[1] = (VkWriteDescriptorSet){.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                             .dstSet = set,
                                             .dstBinding = 1,
                                             .descriptorCount = 1,
                                             .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                             .pBufferInfo = &writes->hits};
}

#define DEVICE_COMMAND(name) PFN_vk##name name = (PFN_vk##name)vkGetDeviceProcAddr(world->device, "vk" #name)

void tracer_describe(struct world *world, struct tracer *tracer, VkDeviceAddress tlas)
{
    DEVICE_COMMAND(GetDescriptorSetLayoutBindingOffsetEXT);
    DEVICE_COMMAND(GetDescriptorEXT);
    VkPhysicalDeviceDescriptorBufferPropertiesEXT sizes = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DESCRIPTOR_BUFFER_PROPERTIES_EXT};
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &sizes};
    vkGetPhysicalDeviceProperties2(world->physical, &properties);
    VkDescriptorAddressInfoEXT hits = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_ADDRESS_INFO_EXT, .address = tracer->hits.address, .range = tracer->hits.size};
    const struct {
        VkDescriptorType type;
        VkDescriptorDataEXT data;
        size_t size;
    } bindings[] = {
        {VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, {.accelerationStructure = tlas}, sizes.accelerationStructureDescriptorSize},
        {VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, {.pStorageBuffer = &hits}, sizes.storageBufferDescriptorSize}};
    for (uint32_t i = 0; i < 2; i++) {
        VkDeviceSize offset;
        VkDescriptorGetInfoEXT info = {
            .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_GET_INFO_EXT, .type = bindings[i].type, .data = bindings[i].data};
        GetDescriptorSetLayoutBindingOffsetEXT(world->device, tracer->layout, i, &offset);
        GetDescriptorEXT(world->device, &info, bindings[i].size, (char *)tracer->descriptors.mapped + offset);
    }
}

void tracer_refer(struct world *world, struct tracer *tracer, VkAccelerationStructureKHR tlas)
{
    struct writes writes;
    struct data data = {{tlas, tlas}, {tracer->hits.handle, 0, VK_WHOLE_SIZE}};
    if (tracer->way == TRACE_BY_TEMPLATE) {
        vkUpdateDescriptorSetWithTemplate(world->device, tracer->set, tracer->update, &data);
        return;
    }
    bool copies = tracer->way == TRACE_BY_COPY;
    writes_fill(&writes, tracer, copies ? tracer->other : tracer->set, tlas);
    vkUpdateDescriptorSets(world->device, 2, writes.list, 0, NULL);
    VkCopyDescriptorSet copy[2];
    for (uint32_t i = 0; i < 2; i++)
        copy[i] = (VkCopyDescriptorSet){.sType = VK_STRUCTURE_TYPE_COPY_DESCRIPTOR_SET,
                                        .srcSet = tracer->other,
                                        .srcBinding = i,
                                        .dstSet = tracer->set,
                                        .dstBinding = i,
                                        .descriptorCount = i ? 1 : tracer->elements};
    if (copies)
        vkUpdateDescriptorSets(world->device, 0, NULL, 2, copy);
}

void tracer_refer_other(struct world *world, struct tracer *tracer)
{
    struct writes writes;
    writes_fill(&writes, tracer, tracer->set, VK_NULL_HANDLE);
    writes.list[1].dstBinding = 0;
    vkUpdateDescriptorSets(world->device, 1, &writes.list[1], 0, NULL);
}

void commands_trace(struct world *world, VkCommandBuffer commands, struct tracer *tracer, VkAccelerationStructureKHR tlas,
                    uint32_t groups)
{
    struct writes writes;
    struct data data = {{tlas, tlas}, {tracer->hits.handle, 0, VK_WHOLE_SIZE}};
    vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_COMPUTE, tracer->pipeline);
    if (tracer->way == TRACE_BY_PUSH) {
        DEVICE_COMMAND(CmdPushDescriptorSetKHR);
        writes_fill(&writes, tracer, VK_NULL_HANDLE, tlas);
        CmdPushDescriptorSetKHR(commands, VK_PIPELINE_BIND_POINT_COMPUTE, tracer->pipeline_layout, 0, 2, writes.list);
    } else if (tracer->way == TRACE_BY_PUSH_TEMPLATE) {
        DEVICE_COMMAND(CmdPushDescriptorSetWithTemplateKHR);
        CmdPushDescriptorSetWithTemplateKHR(commands, tracer->update, tracer->pipeline_layout, 0, &data);
    } else if (tracer->way == TRACE_BY_BUFFER) {
        DEVICE_COMMAND(CmdBindDescriptorBuffersEXT);
        DEVICE_COMMAND(CmdSetDescriptorBufferOffsetsEXT);
        VkDescriptorBufferBindingInfoEXT binding = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_BUFFER_BINDING_INFO_EXT,
                                                    .address = tracer->descriptors.address,
                                                    .usage = VK_BUFFER_USAGE_RESOURCE_DESCRIPTOR_BUFFER_BIT_EXT |
                                                             VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT};
        const uint32_t index = 0;
        const VkDeviceSize offset = 0;
        CmdBindDescriptorBuffersEXT(commands, 1, &binding);
        CmdSetDescriptorBufferOffsetsEXT(commands, VK_PIPELINE_BIND_POINT_COMPUTE, tracer->pipeline_layout, 0, 1, &index, &offset);
    } else {
        vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_COMPUTE, tracer->pipeline_layout, 0, 1, &tracer->set, 0, NULL);
    }
    vkCmdDispatch(commands, groups, 1, 1);
}
