/* SPDX-License-Identifier: Apache-2.0 */
/* A small Vulkan program that traces, see device.h. */
#include "tests/spirv/device.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "checks/spirv/records.h"
#include "tests/vulkan/buffer.h"

#define REQUIRE(call) assert_int_equal(call, VK_SUCCESS)

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

/* Only where the driver has the extension. */
#define OPTIONAL_COMMANDS(X)                                                                                           \
    X(CreateRayTracingPipelinesKHR)                                                                                    \
    X(GetRayTracingShaderGroupHandlesKHR)                                                                              \
    X(CmdTraceRaysKHR)                                                                                                 \
    X(CmdDrawMeshTasksEXT)

/* The table of record buffers, and behind it the depths of a launch. */
#define ROOT_CAPACITY 32
#define ROOT_WORDS (GN_ROOT_WORDS(ROOT_CAPACITY) + LANES)

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
    struct buffer output, root, mirror, structures_table;
    bool pipelines, meshes, positions; /* that the driver has the extension */
    uint32_t handle_size, handle_stride, base_stride;
#define X(name) PFN_vk##name name;
    COMMANDS(X)
    OPTIONAL_COMMANDS(X)
#undef X
};

static struct buffer buffer_create(const struct tracer *tracer, VkDeviceSize size)
{
    return gn_test_buffer_create(tracer->physical, tracer->device, size,
                                 VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR |
                                     VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR |
                                     (tracer->pipelines ? VK_BUFFER_USAGE_SHADER_BINDING_TABLE_BIT_KHR : 0));
}

static void buffer_destroy(const struct tracer *tracer, struct buffer *buffer)
{
    gn_test_buffer_destroy(tracer->device, buffer);
}

static bool has_extension(VkPhysicalDevice physical, const char *name)
{
    VkExtensionProperties properties[512];
    uint32_t count = 512;
    assert_true(vkEnumerateDeviceExtensionProperties(physical, NULL, &count, properties) >= 0);
    for (uint32_t i = 0; i < count; i++)
        if (strcmp(properties[i].extensionName, name) == 0)
            return true;
    return false;
}

static void create_device(struct tracer *tracer)
{
    VkApplicationInfo application = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO, .apiVersion = VK_API_VERSION_1_3};
    VkInstanceCreateInfo instance = {.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, .pApplicationInfo = &application};
    REQUIRE(vkCreateInstance(&instance, NULL, &tracer->instance));
    uint32_t count = 1;
    assert_true(vkEnumeratePhysicalDevices(tracer->instance, &count, &tracer->physical) >= 0 && count == 1);
    tracer->pipelines = has_extension(tracer->physical, VK_KHR_RAY_TRACING_PIPELINE_EXTENSION_NAME);
    tracer->meshes = has_extension(tracer->physical, VK_EXT_MESH_SHADER_EXTENSION_NAME);
    tracer->positions = has_extension(tracer->physical, VK_KHR_RAY_TRACING_POSITION_FETCH_EXTENSION_NAME);
    const char *extensions[8] = {VK_KHR_ACCELERATION_STRUCTURE_EXTENSION_NAME, VK_KHR_RAY_QUERY_EXTENSION_NAME,
                                 VK_KHR_DEFERRED_HOST_OPERATIONS_EXTENSION_NAME};
    uint32_t extension_count = 3;
    VkPhysicalDeviceRayTracingPipelinePropertiesKHR properties = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_PROPERTIES_KHR};
    VkPhysicalDeviceProperties2 all = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2,
                                       .pNext = tracer->pipelines ? &properties : NULL};
    vkGetPhysicalDeviceProperties2(tracer->physical, &all);
    tracer->handle_size = properties.shaderGroupHandleSize;
    tracer->base_stride = properties.shaderGroupBaseAlignment;
    tracer->handle_stride = properties.shaderGroupHandleAlignment > tracer->handle_size ? properties.shaderGroupHandleAlignment
                                                                                        : tracer->handle_size;
    VkPhysicalDeviceRayTracingPipelineFeaturesKHR pipelines = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_FEATURES_KHR, .rayTracingPipeline = VK_TRUE};
    VkPhysicalDeviceMeshShaderFeaturesEXT meshes = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MESH_SHADER_FEATURES_EXT, .taskShader = VK_TRUE, .meshShader = VK_TRUE};
    VkPhysicalDeviceRayTracingPositionFetchFeaturesKHR fetch = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_POSITION_FETCH_FEATURES_KHR, .rayTracingPositionFetch = VK_TRUE};
    VkPhysicalDeviceRayQueryFeaturesKHR query = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_QUERY_FEATURES_KHR,
                                                 .rayQuery = VK_TRUE};
    if (tracer->pipelines) {
        extensions[extension_count++] = VK_KHR_RAY_TRACING_PIPELINE_EXTENSION_NAME;
        pipelines.pNext = query.pNext;
        query.pNext = &pipelines;
    }
    if (tracer->meshes) {
        extensions[extension_count++] = VK_EXT_MESH_SHADER_EXTENSION_NAME;
        meshes.pNext = query.pNext;
        query.pNext = &meshes;
    }
    if (tracer->positions) {
        extensions[extension_count++] = VK_KHR_RAY_TRACING_POSITION_FETCH_EXTENSION_NAME;
        fetch.pNext = query.pNext;
        query.pNext = &fetch;
    }
    VkPhysicalDeviceAccelerationStructureFeaturesKHR structures = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_FEATURES_KHR,
        .pNext = &query,
        .accelerationStructure = VK_TRUE};
    VkPhysicalDeviceVulkan13Features v13 = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES, .pNext = &structures, .dynamicRendering = VK_TRUE};
    VkPhysicalDeviceVulkan12Features v12 = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES,
                                            .pNext = &v13,
                                            .bufferDeviceAddress = VK_TRUE,
                                            .runtimeDescriptorArray = VK_TRUE};
    VkPhysicalDeviceFeatures features = {.fragmentStoresAndAtomics = VK_TRUE, .vertexPipelineStoresAndAtomics = VK_TRUE};
    float priority = 1;
    VkDeviceQueueCreateInfo queue = {.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
                                     .queueCount = 1,
                                     .pQueuePriorities = &priority};
    VkDeviceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                               .pNext = &v12,
                               .queueCreateInfoCount = 1,
                               .pQueueCreateInfos = &queue,
                               .enabledExtensionCount = extension_count,
                               .ppEnabledExtensionNames = extensions,
                               .pEnabledFeatures = &features};
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
#define X(name) tracer->name = (PFN_vk##name)vkGetDeviceProcAddr(tracer->device, "vk" #name);
    OPTIONAL_COMMANDS(X)
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
        .flags = tracer->positions && type == VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR
                     ? VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_DATA_ACCESS_KHR
                     : 0,
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
        placed[i].instanceShaderBindingTableRecordOffset = (uint32_t)i & 0xFFFFFF;
        placed[i].accelerationStructureReference = i ? tracer->box.address : tracer->triangle.address;
    }
    build(tracer, &tracer->scene, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR, &instances,
          &instances.geometry.instances.data, 2, placed, sizeof placed);
}

static void create_descriptors(struct tracer *tracer)
{
    VkDescriptorSetLayoutBinding bindings[3 + MAX_STAGES] = {
        {0, VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, 1, VK_SHADER_STAGE_ALL, NULL},
        {1, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, VK_SHADER_STAGE_ALL, NULL},
        {GN_MIRROR_BINDING, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, VK_SHADER_STAGE_ALL, NULL}};
    for (uint32_t i = 0; i < MAX_STAGES; i++)
        bindings[3 + i] =
            (VkDescriptorSetLayoutBinding){i, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, VK_SHADER_STAGE_ALL, NULL};
    for (uint32_t s = 0; s < 2; s++) {
        VkDescriptorSetLayoutCreateInfo info = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO,
                                                .bindingCount = s ? MAX_STAGES : 3,
                                                .pBindings = bindings + 3 * s};
        REQUIRE(vkCreateDescriptorSetLayout(tracer->device, &info, NULL, &tracer->set_layouts[s]));
    }
    VkPushConstantRange push = {VK_SHADER_STAGE_ALL, 0, sizeof(struct choices)};
    VkPipelineLayoutCreateInfo layout = {.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                         .setLayoutCount = 2,
                                         .pSetLayouts = tracer->set_layouts,
                                         .pushConstantRangeCount = 1,
                                         .pPushConstantRanges = &push};
    REQUIRE(vkCreatePipelineLayout(tracer->device, &layout, NULL, &tracer->layout));
    const VkDescriptorPoolSize sizes[] = {{VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, 1},
                                          {VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 2 + MAX_STAGES}};
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
    /* The mirror of the set: one entry, of binding 0, for the structure whose id is the first. */
    static const uint32_t mirror[] = {2, 1, GN_STRUCTURE_ID_FIRST}, lists[] = {2, 1u << 0, 2, 1u << 1};
    tracer->mirror = buffer_create(tracer, 2 * GN_MIRROR_BINDINGS * sizeof(uint32_t));
    memcpy(tracer->mirror.mapped, mirror, sizeof mirror);
    tracer->structures_table = buffer_create(tracer, GN_STRUCTURES * sizeof(uint32_t) + sizeof lists);
    memcpy((uint32_t *)tracer->structures_table.mapped + GN_STRUCTURES, lists, sizeof lists);
    VkDescriptorBufferInfo output = {tracer->output.handle, 0, VK_WHOLE_SIZE}, mirrored = {tracer->mirror.handle, 0, VK_WHOLE_SIZE};
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
                                      .pBufferInfo = &output},
                                     {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                      .dstSet = tracer->sets[0],
                                      .dstBinding = GN_MIRROR_BINDING,
                                      .descriptorCount = 1,
                                      .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                      .pBufferInfo = &mirrored}};
    vkUpdateDescriptorSets(tracer->device, 3, writes, 0, NULL);
}

struct tracer *tracer_create(void)
{
    struct tracer *tracer = calloc(1, sizeof *tracer);
    assert_non_null(tracer);
    create_device(tracer);
    tracer->root = buffer_create(tracer, ROOT_WORDS * sizeof(uint32_t));
    build_scene(tracer);
    create_descriptors(tracer);
    return tracer;
}

uint64_t tracer_root(const struct tracer *tracer)
{
    return tracer->root.address;
}

uint64_t tracer_structures(const struct tracer *tracer)
{
    return tracer->structures_table.address;
}

#define STAGES_OF_PIPELINES                                                                                            \
    (VK_SHADER_STAGE_RAYGEN_BIT_KHR | VK_SHADER_STAGE_MISS_BIT_KHR | VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR |             \
     VK_SHADER_STAGE_ANY_HIT_BIT_KHR | VK_SHADER_STAGE_INTERSECTION_BIT_KHR | VK_SHADER_STAGE_CALLABLE_BIT_KHR)
#define STAGES_OF_MESHES (VK_SHADER_STAGE_TASK_BIT_EXT | VK_SHADER_STAGE_MESH_BIT_EXT)

bool tracer_supports(const struct tracer *tracer, VkShaderStageFlagBits stage)
{
    return stage & STAGES_OF_PIPELINES ? tracer->pipelines : stage & STAGES_OF_MESHES ? tracer->meshes : true;
}

static VkShaderStageFlags stages_of(const struct program *program)
{
    VkShaderStageFlags flags = 0;
    for (uint32_t i = 0; i < program->stage_count; i++)
        flags |= program->stages[i].stage;
    return flags;
}

/* The groups that a ray-tracing pipeline may have. */
enum { GROUP_RAYGEN, GROUP_MISS, GROUP_TRIANGLES, GROUP_BOXES, GROUP_CALLABLE, GROUP_COUNT };

#define GROUP_NONE UINT32_MAX

/* The index of a group among those that the program's shaders make. */
static uint32_t group_of(const struct program *program, int group)
{
    static const VkShaderStageFlags needed[GROUP_COUNT] = {
        VK_SHADER_STAGE_RAYGEN_BIT_KHR, VK_SHADER_STAGE_MISS_BIT_KHR,
        VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR | VK_SHADER_STAGE_ANY_HIT_BIT_KHR, VK_SHADER_STAGE_INTERSECTION_BIT_KHR,
        VK_SHADER_STAGE_CALLABLE_BIT_KHR};
    VkShaderStageFlags flags = stages_of(program);
    uint32_t index = 0;
    for (int g = 0; g < group; g++)
        index += (flags & needed[g]) != 0;
    return flags & needed[group] ? index : GROUP_NONE;
}

static void create_traced(struct tracer *tracer, struct program *program, const VkPipelineShaderStageCreateInfo *stages)
{
    VkRayTracingShaderGroupCreateInfoKHR groups[GROUP_COUNT];
    for (int g = 0; g < GROUP_COUNT; g++)
        groups[g] = (VkRayTracingShaderGroupCreateInfoKHR){
            .sType = VK_STRUCTURE_TYPE_RAY_TRACING_SHADER_GROUP_CREATE_INFO_KHR,
            .type = g == GROUP_TRIANGLES ? VK_RAY_TRACING_SHADER_GROUP_TYPE_TRIANGLES_HIT_GROUP_KHR
                                         : VK_RAY_TRACING_SHADER_GROUP_TYPE_GENERAL_KHR,
            .generalShader = VK_SHADER_UNUSED_KHR,
            .closestHitShader = VK_SHADER_UNUSED_KHR,
            .anyHitShader = VK_SHADER_UNUSED_KHR,
            .intersectionShader = VK_SHADER_UNUSED_KHR};
    for (uint32_t i = 0; i < program->stage_count; i++)
        switch (stages[i].stage) {
        case VK_SHADER_STAGE_RAYGEN_BIT_KHR: groups[GROUP_RAYGEN].generalShader = i; break;
        case VK_SHADER_STAGE_MISS_BIT_KHR: groups[GROUP_MISS].generalShader = i; break;
        case VK_SHADER_STAGE_CALLABLE_BIT_KHR: groups[GROUP_CALLABLE].generalShader = i; break;
        case VK_SHADER_STAGE_INTERSECTION_BIT_KHR:
            groups[GROUP_BOXES].type = VK_RAY_TRACING_SHADER_GROUP_TYPE_PROCEDURAL_HIT_GROUP_KHR;
            groups[GROUP_BOXES].intersectionShader = i;
            break;
        case VK_SHADER_STAGE_ANY_HIT_BIT_KHR: groups[GROUP_TRIANGLES].anyHitShader = i; break;
        default: groups[GROUP_TRIANGLES].closestHitShader = groups[GROUP_BOXES].closestHitShader = i; break;
        }
    uint32_t count = 0;
    for (int g = 0; g < GROUP_COUNT; g++)
        if (group_of(program, g) != GROUP_NONE)
            groups[count++] = groups[g];
    VkRayTracingPipelineCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_RAY_TRACING_PIPELINE_CREATE_INFO_KHR,
                                              .stageCount = program->stage_count,
                                              .pStages = stages,
                                              .groupCount = count,
                                              .pGroups = groups,
                                              .maxPipelineRayRecursionDepth = program->recursion ? program->recursion : 1,
                                              .layout = tracer->layout};
    REQUIRE(tracer->CreateRayTracingPipelinesKHR(tracer->device, VK_NULL_HANDLE, VK_NULL_HANDLE, 1, &info, NULL,
                                                 &program->pipeline));
}

static void create_drawn(struct tracer *tracer, struct program *program, const VkPipelineShaderStageCreateInfo *stages)
{
    VkShaderStageFlags flags = stages_of(program);
    bool vertices = (flags & VK_SHADER_STAGE_VERTEX_BIT) != 0, pixels = (flags & VK_SHADER_STAGE_FRAGMENT_BIT) != 0;
    VkPipelineVertexInputStateCreateInfo input = {.sType = VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO};
    VkPipelineInputAssemblyStateCreateInfo assembly = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_INPUT_ASSEMBLY_STATE_CREATE_INFO,
        .topology = pixels ? VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST : VK_PRIMITIVE_TOPOLOGY_POINT_LIST};
    VkViewport viewport = {0, 0, LANES, 1, 0, 1};
    VkRect2D scissor = {{0, 0}, {LANES, 1}};
    VkPipelineViewportStateCreateInfo view = {.sType = VK_STRUCTURE_TYPE_PIPELINE_VIEWPORT_STATE_CREATE_INFO,
                                              .viewportCount = 1,
                                              .pViewports = &viewport,
                                              .scissorCount = 1,
                                              .pScissors = &scissor};
    VkPipelineRasterizationStateCreateInfo raster = {.sType = VK_STRUCTURE_TYPE_PIPELINE_RASTERIZATION_STATE_CREATE_INFO,
                                                     .rasterizerDiscardEnable = !pixels,
                                                     .lineWidth = 1};
    VkPipelineMultisampleStateCreateInfo samples = {.sType = VK_STRUCTURE_TYPE_PIPELINE_MULTISAMPLE_STATE_CREATE_INFO,
                                                    .rasterizationSamples = VK_SAMPLE_COUNT_1_BIT};
    VkPipelineColorBlendStateCreateInfo blend = {.sType = VK_STRUCTURE_TYPE_PIPELINE_COLOR_BLEND_STATE_CREATE_INFO};
    VkPipelineRenderingCreateInfo rendering = {.sType = VK_STRUCTURE_TYPE_PIPELINE_RENDERING_CREATE_INFO};
    VkGraphicsPipelineCreateInfo info = {.sType = VK_STRUCTURE_TYPE_GRAPHICS_PIPELINE_CREATE_INFO,
                                         .pNext = &rendering,
                                         .stageCount = program->stage_count,
                                         .pStages = stages,
                                         .pVertexInputState = vertices ? &input : NULL,
                                         .pInputAssemblyState = vertices ? &assembly : NULL,
                                         .pViewportState = &view,
                                         .pRasterizationState = &raster,
                                         .pMultisampleState = &samples,
                                         .pColorBlendState = &blend,
                                         .layout = tracer->layout};
    REQUIRE(vkCreateGraphicsPipelines(tracer->device, VK_NULL_HANDLE, 1, &info, NULL, &program->pipeline));
}

static void create_pipeline(struct tracer *tracer, struct program *program)
{
    VkPipelineShaderStageCreateInfo stages[MAX_STAGES] = {{.sType = 0}};
    for (uint32_t i = 0; i < program->stage_count; i++) {
        VkShaderModuleCreateInfo code = {.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO,
                                         .codeSize = program->stages[i].word_count * 4,
                                         .pCode = program->stages[i].words};
        stages[i] = (VkPipelineShaderStageCreateInfo){.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                      .stage = program->stages[i].stage,
                                                      .pName = "main"};
        REQUIRE(vkCreateShaderModule(tracer->device, &code, NULL, &stages[i].module));
    }
    VkComputePipelineCreateInfo compute = {
        .sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO, .stage = stages[0], .layout = tracer->layout};
    if (stages_of(program) & STAGES_OF_PIPELINES)
        create_traced(tracer, program, stages);
    else if (stages_of(program) == VK_SHADER_STAGE_COMPUTE_BIT)
        REQUIRE(vkCreateComputePipelines(tracer->device, VK_NULL_HANDLE, 1, &compute, NULL, &program->pipeline));
    else
        create_drawn(tracer, program, stages);
    for (uint32_t i = 0; i < program->stage_count; i++)
        vkDestroyShaderModule(tracer->device, stages[i].module, NULL);
}

void tracer_forget(struct tracer *tracer, struct program *program)
{
    vkDestroyPipeline(tracer->device, program->pipeline, NULL);
    program->pipeline = VK_NULL_HANDLE;
}

static uint64_t round_up(uint64_t value, uint64_t to)
{
    return (value + to - 1) / to * to;
}

/* The table has a region per kind of shader; records without a shader are zeros, and then nothing is called. */
static void record_trace(struct tracer *tracer, const struct program *program, struct buffer *table)
{
    uint8_t handles[GROUP_COUNT * 64];
    uint32_t groups = 0;
    for (int g = 0; g < GROUP_COUNT; g++)
        groups += group_of(program, g) != GROUP_NONE;
    assert_true(tracer->handle_size <= 64);
    REQUIRE(tracer->GetRayTracingShaderGroupHandlesKHR(tracer->device, program->pipeline, 0, groups,
                                                       (size_t)groups * tracer->handle_size, handles));
    const struct {
        uint32_t records;
        int first_group;
    } regions[4] = {{1, GROUP_RAYGEN}, {1, GROUP_MISS}, {2, GROUP_TRIANGLES}, {2 * program->callables, GROUP_CALLABLE}};
    VkStridedDeviceAddressRegionKHR spans[4];
    const uint64_t region_size = round_up((uint64_t)16 * tracer->handle_stride, tracer->base_stride);
    *table = buffer_create(tracer, 5 * region_size);
    uint64_t start = round_up(table->address, tracer->base_stride);
    for (uint32_t r = 0; r < 4; r++) {
        uint64_t at = start + r * region_size;
        assert_true(regions[r].records <= 16);
        spans[r] = (VkStridedDeviceAddressRegionKHR){at, tracer->handle_stride, regions[r].records * tracer->handle_stride};
        for (uint32_t i = 0; i < regions[r].records; i++) {
            uint32_t group = group_of(program, regions[r].first_group + (r == 2 ? (int)i : 0));
            if (group != GROUP_NONE)
                memcpy((uint8_t *)table->mapped + (at - table->address) + i * tracer->handle_stride,
                       handles + group * tracer->handle_size, tracer->handle_size);
        }
    }
    vkCmdBindPipeline(tracer->commands, VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR, program->pipeline);
    tracer->CmdTraceRaysKHR(tracer->commands, &spans[0], &spans[1], &spans[2], &spans[3], LANES, 1, 1);
}

static void record_draw(struct tracer *tracer, const struct program *program)
{
    VkShaderStageFlags flags = stages_of(program);
    VkRenderingInfo rendering = {
        .sType = VK_STRUCTURE_TYPE_RENDERING_INFO, .renderArea = {{0, 0}, {LANES, 1}}, .layerCount = 1};
    vkCmdBindPipeline(tracer->commands, VK_PIPELINE_BIND_POINT_GRAPHICS, program->pipeline);
    vkCmdBeginRendering(tracer->commands, &rendering);
    if (flags & STAGES_OF_MESHES)
        tracer->CmdDrawMeshTasksEXT(tracer->commands, 1, 1, 1);
    else
        vkCmdDraw(tracer->commands, flags & VK_SHADER_STAGE_FRAGMENT_BIT ? 3 : LANES, 1, 0, 0);
    vkCmdEndRendering(tracer->commands);
}

/* Where the modules find their records and what the header says of the launch. */
static void write_records(struct tracer *tracer, const struct program *program, struct buffer *buffers)
{
    uint32_t *root = tracer->root.mapped;
    memset(root, 0, ROOT_WORDS * sizeof *root);
    gn_root_reset(root, ROOT_CAPACITY);
    root[GN_LAUNCH_CALLABLES] = program->callables + 1;
    root[GN_LAUNCH_DEPTHS] = GN_ROOT_WORDS(ROOT_CAPACITY);
    root[GN_LAUNCH_DEPTH_COUNT] = LANES;
    uint32_t *structures = tracer->structures_table.mapped;
    structures[GN_STRUCTURE_ID_FIRST] = program->structures;
    structures[GN_STRUCTURE_ID_UNKNOWN] = GN_STRUCTURE_FINE | (program->structures & GN_STRUCTURE_NO_POSITIONS);
    for (uint32_t i = 0; i < program->stage_count; i++) {
        const struct stage *stage = &program->stages[i];
        buffers[i] = buffer_create(tracer, (stage->record_words + GN_RECORDS_HEADER + LANES) * 4);
        if (!stage->records)
            continue;
        uint32_t *words = buffers[i].mapped;
        memcpy(words, stage->records, stage->record_words * 4);
        words[GN_LAUNCH_CALLABLES] = program->callables + 1;
        words[GN_LAUNCH_DEPTHS] = (uint32_t)stage->record_words;
        words[GN_LAUNCH_DEPTH_COUNT] = LANES;
        if (stage->key)
            assert_true(gn_root_enter(root, stage->key, buffers[i].address));
        VkDescriptorBufferInfo info = {buffers[i].handle, 0, VK_WHOLE_SIZE};
        VkWriteDescriptorSet write = {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                      .dstSet = tracer->sets[RECORD_SET],
                                      .dstBinding = i,
                                      .descriptorCount = 1,
                                      .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                      .pBufferInfo = &info};
        vkUpdateDescriptorSets(tracer->device, 1, &write, 0, NULL);
    }
}

void tracer_run(struct tracer *tracer, struct program *program, const struct choices *choices, float out[LANES])
{
    struct buffer buffers[MAX_STAGES], table = {.handle = VK_NULL_HANDLE};
    VkShaderStageFlags flags = stages_of(program);
    VkPipelineBindPoint point = flags & STAGES_OF_PIPELINES                ? VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR
                                : flags == VK_SHADER_STAGE_COMPUTE_BIT ? VK_PIPELINE_BIND_POINT_COMPUTE
                                                                           : VK_PIPELINE_BIND_POINT_GRAPHICS;
    if (!program->pipeline)
        create_pipeline(tracer, program);
    write_records(tracer, program, buffers);
    memset(tracer->output.mapped, 0, LANES * sizeof(float));

    begin(tracer);
    vkCmdBindDescriptorSets(tracer->commands, point, tracer->layout, 0, 2, tracer->sets, 0, NULL);
    vkCmdPushConstants(tracer->commands, tracer->layout, VK_SHADER_STAGE_ALL, 0, sizeof *choices, choices);
    if (point == VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR) {
        record_trace(tracer, program, &table);
    } else if (point == VK_PIPELINE_BIND_POINT_GRAPHICS) {
        record_draw(tracer, program);
    } else {
        vkCmdBindPipeline(tracer->commands, point, program->pipeline);
        vkCmdDispatch(tracer->commands, 1, 1, 1);
    }
    VkMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                               .srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT,
                               .dstAccessMask = VK_ACCESS_HOST_READ_BIT};
    vkCmdPipelineBarrier(tracer->commands, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &barrier, 0,
                         NULL, 0, NULL);
    submit(tracer);

    memcpy(out, tracer->output.mapped, LANES * sizeof(float));
    for (uint32_t i = 0; i < program->stage_count; i++) {
        if (program->stages[i].records)
            memcpy(program->stages[i].records, buffers[i].mapped, program->stages[i].record_words * 4);
        buffer_destroy(tracer, &buffers[i]);
    }
    if (table.handle)
        buffer_destroy(tracer, &table);
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
    buffer_destroy(tracer, &tracer->root);
    buffer_destroy(tracer, &tracer->mirror);
    buffer_destroy(tracer, &tracer->structures_table);
    vkDestroyDescriptorPool(tracer->device, tracer->descriptors, NULL);
    vkDestroyPipelineLayout(tracer->device, tracer->layout, NULL);
    for (int s = 0; s < 2; s++)
        vkDestroyDescriptorSetLayout(tracer->device, tracer->set_layouts[s], NULL);
    vkDestroyCommandPool(tracer->device, tracer->pool, NULL);
    vkDestroyDevice(tracer->device, NULL);
    vkDestroyInstance(tracer->instance, NULL);
    free(tracer);
}
