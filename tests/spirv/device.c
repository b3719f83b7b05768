/* SPDX-License-Identifier: Apache-2.0 */
/* A small Vulkan program that traces, see device.h. */
#include "tests/spirv/device.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <vulkan/vulkan.h>

#define REQUIRE(call) assert_int_equal(call, VK_SUCCESS)

struct buffer {
    VkBuffer handle;
    VkDeviceMemory memory;
    VkDeviceAddress address;
    void *mapped;
};

struct structure {
    VkAccelerationStructureKHR handle;
    VkDeviceAddress address;
    struct buffer input, storage, scratch;
};

#define COMMANDS(X)                                                                                                    \
    X(CreateAccelerationStructureKHR)                                                                                  \
    X(DestroyAccelerationStructureKHR)                                                                                 \
    X(GetAccelerationStructureBuildSizesKHR)                                                                           \
    X(GetAccelerationStructureDeviceAddressKHR)                                                                        \
    X(CmdBuildAccelerationStructuresKHR)

struct tracer {
    VkInstance instance;
    VkPhysicalDevice physical;
    VkDevice device;
    VkQueue queue;
    VkCommandPool pool;
    VkCommandBuffer commands;
    VkDescriptorSetLayout set_layouts[2];
    VkPipelineLayout layout;
    VkDescriptorPool descriptors;
    VkDescriptorSet sets[2];
    struct structure triangle, box, scene;
    struct buffer output;
#define X(name) PFN_vk##name name;
    COMMANDS(X)
#undef X
};

static struct buffer buffer_create(struct tracer *tracer, VkDeviceSize size)
{
    struct buffer buffer = {.address = 0};
    VkBufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                               .size = size,
                               .usage = VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT | VK_BUFFER_USAGE_STORAGE_BUFFER_BIT |
                                        VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR |
                                        VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR};
    REQUIRE(vkCreateBuffer(tracer->device, &info, NULL, &buffer.handle));
    VkMemoryRequirements needs;
    vkGetBufferMemoryRequirements(tracer->device, buffer.handle, &needs);
    VkPhysicalDeviceMemoryProperties memory;
    vkGetPhysicalDeviceMemoryProperties(tracer->physical, &memory);
    const VkMemoryPropertyFlags wanted = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    uint32_t type = 0;
    while (type < memory.memoryTypeCount &&
           !((needs.memoryTypeBits >> type & 1) && (memory.memoryTypes[type].propertyFlags & wanted) == wanted))
        type++;
    assert_true(type < memory.memoryTypeCount);
    VkMemoryAllocateFlagsInfo flags = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO,
                                       .flags = VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT};
    VkMemoryAllocateInfo allocation = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
                                       .pNext = &flags,
                                       .allocationSize = needs.size,
                                       .memoryTypeIndex = type};
    REQUIRE(vkAllocateMemory(tracer->device, &allocation, NULL, &buffer.memory));
    REQUIRE(vkBindBufferMemory(tracer->device, buffer.handle, buffer.memory, 0));
    REQUIRE(vkMapMemory(tracer->device, buffer.memory, 0, VK_WHOLE_SIZE, 0, &buffer.mapped));
    memset(buffer.mapped, 0, size);
    VkBufferDeviceAddressInfo address = {.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO, .buffer = buffer.handle};
    buffer.address = vkGetBufferDeviceAddress(tracer->device, &address);
    return buffer;
}

static void buffer_destroy(struct tracer *tracer, struct buffer *buffer)
{
    vkDestroyBuffer(tracer->device, buffer->handle, NULL);
    vkFreeMemory(tracer->device, buffer->memory, NULL);
}

static void create_device(struct tracer *tracer)
{
    VkApplicationInfo application = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO, .apiVersion = VK_API_VERSION_1_3};
    VkInstanceCreateInfo instance = {.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, .pApplicationInfo = &application};
    REQUIRE(vkCreateInstance(&instance, NULL, &tracer->instance));
    uint32_t count = 1;
    assert_true(vkEnumeratePhysicalDevices(tracer->instance, &count, &tracer->physical) >= 0 && count == 1);
    const char *extensions[] = {VK_KHR_ACCELERATION_STRUCTURE_EXTENSION_NAME, VK_KHR_RAY_QUERY_EXTENSION_NAME,
                                VK_KHR_DEFERRED_HOST_OPERATIONS_EXTENSION_NAME};
    VkPhysicalDeviceRayQueryFeaturesKHR query = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_QUERY_FEATURES_KHR,
                                                 .rayQuery = VK_TRUE};
    VkPhysicalDeviceAccelerationStructureFeaturesKHR structures = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_FEATURES_KHR,
        .pNext = &query,
        .accelerationStructure = VK_TRUE};
    VkPhysicalDeviceVulkan12Features v12 = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES,
                                            .pNext = &structures,
                                            .bufferDeviceAddress = VK_TRUE};
    float priority = 1;
    VkDeviceQueueCreateInfo queue = {.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
                                     .queueCount = 1,
                                     .pQueuePriorities = &priority};
    VkDeviceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                               .pNext = &v12,
                               .queueCreateInfoCount = 1,
                               .pQueueCreateInfos = &queue,
                               .enabledExtensionCount = 3,
                               .ppEnabledExtensionNames = extensions};
    REQUIRE(vkCreateDevice(tracer->physical, &info, NULL, &tracer->device));
    vkGetDeviceQueue(tracer->device, 0, 0, &tracer->queue);
    VkCommandPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                    .flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT};
    REQUIRE(vkCreateCommandPool(tracer->device, &pool, NULL, &tracer->pool));
    VkCommandBufferAllocateInfo commands = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                            .commandPool = tracer->pool,
                                            .commandBufferCount = 1};
    REQUIRE(vkAllocateCommandBuffers(tracer->device, &commands, &tracer->commands));
#define X(name)                                                                                                        \
    tracer->name = (PFN_vk##name)vkGetDeviceProcAddr(tracer->device, "vk" #name);                                      \
    assert_non_null(tracer->name);
    COMMANDS(X)
#undef X
}

static void submit(struct tracer *tracer)
{
    REQUIRE(vkEndCommandBuffer(tracer->commands));
    VkSubmitInfo info = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &tracer->commands};
    REQUIRE(vkQueueSubmit(tracer->queue, 1, &info, VK_NULL_HANDLE));
    REQUIRE(vkQueueWaitIdle(tracer->queue));
}

static void begin(struct tracer *tracer)
{
    VkCommandBufferBeginInfo info = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    REQUIRE(vkBeginCommandBuffer(tracer->commands, &info));
}

/* Builds from the geometry, whose data is in `data`. */
static void build(struct tracer *tracer, struct structure *structure, VkAccelerationStructureTypeKHR type,
                  VkAccelerationStructureGeometryKHR *geometry, VkDeviceOrHostAddressConstKHR *input, uint32_t count,
                  const void *data, size_t size)
{
    structure->input = buffer_create(tracer, size);
    memcpy(structure->input.mapped, data, size);
    input->deviceAddress = structure->input.address;
    VkAccelerationStructureBuildGeometryInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = type,
        .geometryCount = 1,
        .pGeometries = geometry};
    VkAccelerationStructureBuildSizesInfoKHR sizes = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR};
    tracer->GetAccelerationStructureBuildSizesKHR(tracer->device, VK_ACCELERATION_STRUCTURE_BUILD_TYPE_DEVICE_KHR, &info,
                                                  &count, &sizes);
    structure->storage = buffer_create(tracer, sizes.accelerationStructureSize);
    structure->scratch = buffer_create(tracer, sizes.buildScratchSize + 1);
    VkAccelerationStructureCreateInfoKHR create = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
                                                   .buffer = structure->storage.handle,
                                                   .size = sizes.accelerationStructureSize,
                                                   .type = type};
    REQUIRE(tracer->CreateAccelerationStructureKHR(tracer->device, &create, NULL, &structure->handle));
    VkAccelerationStructureDeviceAddressInfoKHR query = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_DEVICE_ADDRESS_INFO_KHR,
        .accelerationStructure = structure->handle};
    structure->address = tracer->GetAccelerationStructureDeviceAddressKHR(tracer->device, &query);
    info.dstAccelerationStructure = structure->handle;
    info.scratchData.deviceAddress = structure->scratch.address;
    VkAccelerationStructureBuildRangeInfoKHR range = {.primitiveCount = count};
    const VkAccelerationStructureBuildRangeInfoKHR *ranges = &range;
    begin(tracer);
    tracer->CmdBuildAccelerationStructuresKHR(tracer->commands, 1, &info, &ranges);
    submit(tracer);
}

static void build_scene(struct tracer *tracer)
{
    static const float corners[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    static const VkAabbPositionsKHR bounds = {-1, -1, 1, 1, 1, 2};
    VkAccelerationStructureGeometryKHR triangle = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR,
        .geometry.triangles = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
                               .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
                               .vertexStride = 12,
                               .maxVertex = 2,
                               .indexType = VK_INDEX_TYPE_NONE_KHR}};
    VkAccelerationStructureGeometryKHR box = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .geometryType = VK_GEOMETRY_TYPE_AABBS_KHR,
        .geometry.aabbs = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR, .stride = 24}};
    VkAccelerationStructureGeometryKHR instances = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR,
        .geometry.instances = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR}};
    build(tracer, &tracer->triangle, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, &triangle,
          &triangle.geometry.triangles.vertexData, 1, corners, sizeof corners);
    build(tracer, &tracer->box, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, &box, &box.geometry.aabbs.data, 1, &bounds,
          sizeof bounds);
    VkAccelerationStructureInstanceKHR placed[2];
    memset(placed, 0, sizeof placed);
    for (int i = 0; i < 2; i++) {
        for (int row = 0; row < 3; row++)
            placed[i].transform.matrix[row][row] = 1;
        placed[i].mask = 0xFF;
        placed[i].accelerationStructureReference = i ? tracer->box.address : tracer->triangle.address;
    }
    build(tracer, &tracer->scene, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR, &instances,
          &instances.geometry.instances.data, 2, placed, sizeof placed);
}

static void create_descriptors(struct tracer *tracer)
{
    const VkDescriptorSetLayoutBinding bindings[] = {
        {0, VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, 1, VK_SHADER_STAGE_COMPUTE_BIT, NULL},
        {1, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, VK_SHADER_STAGE_COMPUTE_BIT, NULL},
        {0, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, VK_SHADER_STAGE_COMPUTE_BIT, NULL}};
    for (uint32_t s = 0; s < 2; s++) {
        VkDescriptorSetLayoutCreateInfo info = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO,
                                                .bindingCount = 2 - s,
                                                .pBindings = bindings + 2 * s};
        REQUIRE(vkCreateDescriptorSetLayout(tracer->device, &info, NULL, &tracer->set_layouts[s]));
    }
    VkPushConstantRange push = {VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof(struct choices)};
    VkPipelineLayoutCreateInfo layout = {.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                         .setLayoutCount = 2,
                                         .pSetLayouts = tracer->set_layouts,
                                         .pushConstantRangeCount = 1,
                                         .pPushConstantRanges = &push};
    REQUIRE(vkCreatePipelineLayout(tracer->device, &layout, NULL, &tracer->layout));
    const VkDescriptorPoolSize sizes[] = {{VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, 1},
                                          {VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 2}};
    VkDescriptorPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO,
                                       .maxSets = 2,
                                       .poolSizeCount = 2,
                                       .pPoolSizes = sizes};
    REQUIRE(vkCreateDescriptorPool(tracer->device, &pool, NULL, &tracer->descriptors));
    VkDescriptorSetAllocateInfo allocate = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                            .descriptorPool = tracer->descriptors,
                                            .descriptorSetCount = 2,
                                            .pSetLayouts = tracer->set_layouts};
    REQUIRE(vkAllocateDescriptorSets(tracer->device, &allocate, tracer->sets));
    tracer->output = buffer_create(tracer, LANES * sizeof(float));
    VkWriteDescriptorSetAccelerationStructureKHR scene = {
        .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET_ACCELERATION_STRUCTURE_KHR,
        .accelerationStructureCount = 1,
        .pAccelerationStructures = &tracer->scene.handle};
    VkDescriptorBufferInfo output = {tracer->output.handle, 0, VK_WHOLE_SIZE};
    VkWriteDescriptorSet writes[] = {{.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                      .pNext = &scene,
                                      .dstSet = tracer->sets[0],
                                      .descriptorCount = 1,
                                      .descriptorType = VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR},
                                     {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                      .dstSet = tracer->sets[0],
                                      .dstBinding = 1,
                                      .descriptorCount = 1,
                                      .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                      .pBufferInfo = &output}};
    vkUpdateDescriptorSets(tracer->device, 2, writes, 0, NULL);
}

struct tracer *tracer_create(void)
{
    struct tracer *tracer = calloc(1, sizeof *tracer);
    assert_non_null(tracer);
    create_device(tracer);
    build_scene(tracer);
    create_descriptors(tracer);
    return tracer;
}

void tracer_run(struct tracer *tracer, const uint32_t *words, size_t word_count, const struct choices *choices,
                float out[LANES], uint32_t *records, size_t record_words)
{
    VkShaderModuleCreateInfo code = {
        .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, .codeSize = word_count * 4, .pCode = words};
    VkShaderModule module;
    REQUIRE(vkCreateShaderModule(tracer->device, &code, NULL, &module));
    VkComputePipelineCreateInfo info = {.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
                                        .stage = {.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                  .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                                                  .module = module,
                                                  .pName = "main"},
                                        .layout = tracer->layout};
    VkPipeline pipeline;
    REQUIRE(vkCreateComputePipelines(tracer->device, VK_NULL_HANDLE, 1, &info, NULL, &pipeline));

    struct buffer buffer = buffer_create(tracer, (record_words ? record_words : 4) * 4);
    if (records)
        memcpy(buffer.mapped, records, record_words * 4);
    VkDescriptorBufferInfo record_info = {buffer.handle, 0, VK_WHOLE_SIZE};
    VkWriteDescriptorSet write = {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                  .dstSet = tracer->sets[RECORD_SET],
                                  .descriptorCount = 1,
                                  .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                  .pBufferInfo = &record_info};
    vkUpdateDescriptorSets(tracer->device, 1, &write, 0, NULL);
    memset(tracer->output.mapped, 0, LANES * sizeof(float));

    begin(tracer);
    vkCmdBindPipeline(tracer->commands, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline);
    vkCmdBindDescriptorSets(tracer->commands, VK_PIPELINE_BIND_POINT_COMPUTE, tracer->layout, 0, 2, tracer->sets, 0, NULL);
    vkCmdPushConstants(tracer->commands, tracer->layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof *choices, choices);
    vkCmdDispatch(tracer->commands, 1, 1, 1);
    VkMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                               .srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT,
                               .dstAccessMask = VK_ACCESS_HOST_READ_BIT};
    vkCmdPipelineBarrier(tracer->commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &barrier, 0,
                         NULL, 0, NULL);
    submit(tracer);

    memcpy(out, tracer->output.mapped, LANES * sizeof(float));
    if (records)
        memcpy(records, buffer.mapped, record_words * 4);
    buffer_destroy(tracer, &buffer);
    vkDestroyPipeline(tracer->device, pipeline, NULL);
    vkDestroyShaderModule(tracer->device, module, NULL);
}

void tracer_destroy(struct tracer *tracer)
{
    struct structure *structures[] = {&tracer->scene, &tracer->box, &tracer->triangle};
    for (int i = 0; i < 3; i++) {
        tracer->DestroyAccelerationStructureKHR(tracer->device, structures[i]->handle, NULL);
        buffer_destroy(tracer, &structures[i]->input);
        buffer_destroy(tracer, &structures[i]->storage);
        buffer_destroy(tracer, &structures[i]->scratch);
    }
    buffer_destroy(tracer, &tracer->output);
    vkDestroyDescriptorPool(tracer->device, tracer->descriptors, NULL);
    vkDestroyPipelineLayout(tracer->device, tracer->layout, NULL);
    for (int s = 0; s < 2; s++)
        vkDestroyDescriptorSetLayout(tracer->device, tracer->set_layouts[s], NULL);
    vkDestroyCommandPool(tracer->device, tracer->pool, NULL);
    vkDestroyDevice(tracer->device, NULL);
    vkDestroyInstance(tracer->instance, NULL);
    free(tracer);
}
