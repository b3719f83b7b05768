/* SPDX-License-Identifier: Apache-2.0 */
/* The asking part of the Vulkan program that the layer's tests run. */
#include "tests/layer/ask.h"

#include <string.h>

#include "asks_comp.spv.h"
#include "asks_frag.spv.h"
#include "asks_long_comp.spv.h"
#include "asks_many_comp.spv.h"
#include "asks_positions_comp.spv.h"
#include "asks_rgen.spv.h"
#include "asks_vert.spv.h"
#include "plain_frag.spv.h"
#include "plane_vert.spv.h"

#define REQUIRE(call) assert_int_equal(call, VK_SUCCESS)
#define CODE(array) {VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, NULL, 0, sizeof array, array}
#define COMMAND(world, name) ((PFN_vk##name)vkGetDeviceProcAddr((world)->device, "vk" #name))

static const VkShaderModuleCreateInfo codes[] = {[ASK_COMPUTE] = CODE(asks_comp_spv), [ASK_VERTEX] = CODE(asks_vert_spv),
                                                 [ASK_FRAGMENT] = CODE(asks_frag_spv), [ASK_RAYGEN] = CODE(asks_rgen_spv),
                                                 [ASK_LONG] = CODE(asks_long_comp_spv),
                                                 [ASK_MANY] = CODE(asks_many_comp_spv),
                                                 [ASK_POSITIONS] = CODE(asks_positions_comp_spv)};
static const VkShaderModuleCreateInfo plane = CODE(plane_vert_spv), plain = CODE(plain_frag_spv);
static const VkShaderStageFlagBits stages[] = {VK_SHADER_STAGE_COMPUTE_BIT, VK_SHADER_STAGE_VERTEX_BIT, VK_SHADER_STAGE_FRAGMENT_BIT,
                                               VK_SHADER_STAGE_RAYGEN_BIT_KHR, VK_SHADER_STAGE_COMPUTE_BIT, VK_SHADER_STAGE_COMPUTE_BIT,
                                               VK_SHADER_STAGE_COMPUTE_BIT};

void ask_world_init(struct world *world, const struct world_options *options)
{
    static const char *const extensions[] = {VK_KHR_RAY_TRACING_PIPELINE_EXTENSION_NAME, VK_KHR_PIPELINE_LIBRARY_EXTENSION_NAME,
                                             VK_EXT_GRAPHICS_PIPELINE_LIBRARY_EXTENSION_NAME, VK_EXT_SHADER_OBJECT_EXTENSION_NAME,
                                             VK_KHR_RAY_TRACING_POSITION_FETCH_EXTENSION_NAME};
    VkPhysicalDeviceRayTracingPositionFetchFeaturesKHR positions = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_POSITION_FETCH_FEATURES_KHR, .rayTracingPositionFetch = VK_TRUE};
    VkPhysicalDeviceShaderObjectFeaturesEXT objects = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SHADER_OBJECT_FEATURES_EXT,
                                                       .pNext = &positions,
                                                       .shaderObject = VK_TRUE};
    VkPhysicalDeviceGraphicsPipelineLibraryFeaturesEXT libraries = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_GRAPHICS_PIPELINE_LIBRARY_FEATURES_EXT,
        .pNext = &objects,
        .graphicsPipelineLibrary = VK_TRUE};
    VkPhysicalDeviceRayTracingPipelineFeaturesKHR rays = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_FEATURES_KHR, .pNext = &libraries, .rayTracingPipeline = VK_TRUE};
    struct world_options all = options ? *options : (struct world_options){0};
    all.extensions = extensions;
    all.extension_count = sizeof extensions / sizeof extensions[0];
    all.features = &rays;
    world_init(world, &all);
}

static void create_layout(struct world *world, struct asker *asker)
{
    const VkShaderStageFlags all = VK_SHADER_STAGE_COMPUTE_BIT | VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT |
                                   VK_SHADER_STAGE_RAYGEN_BIT_KHR;
    const VkDescriptorSetLayoutBinding bindings[] = {{0, VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, asker->stage == ASK_MANY ? ASK_SCENES : 1, all, NULL},
                                                     {1, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, all, NULL}};
    const VkDescriptorBindingFlags partial[] = {VK_DESCRIPTOR_BINDING_PARTIALLY_BOUND_BIT, 0};
    VkDescriptorSetLayoutBindingFlagsCreateInfo flags = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_BINDING_FLAGS_CREATE_INFO, .bindingCount = 2, .pBindingFlags = partial};
    VkDescriptorSetLayoutCreateInfo layout = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO,
                                              .pNext = asker->stage == ASK_MANY ? &flags : NULL,
                                              .bindingCount = 2,
                                              .pBindings = bindings};
    REQUIRE(vkCreateDescriptorSetLayout(world->device, &layout, NULL, &asker->layout));
    VkPushConstantRange push = {all, 0, 4};
    VkPipelineLayoutCreateInfo pipeline = {.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                           .setLayoutCount = 1,
                                           .pSetLayouts = &asker->layout,
                                           .pushConstantRangeCount = 1,
                                           .pPushConstantRanges = &push};
    REQUIRE(vkCreatePipelineLayout(world->device, &pipeline, NULL, &asker->pipeline_layout));
}

static void create_set(struct world *world, struct asker *asker, VkAccelerationStructureKHR tlas)
{
    const VkDescriptorPoolSize sizes[] = {{VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, ASK_SCENES},
                                          {VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1}};
    VkDescriptorPoolCreateInfo pool = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO, .maxSets = 1, .poolSizeCount = 2, .pPoolSizes = sizes};
    REQUIRE(vkCreateDescriptorPool(world->device, &pool, NULL, &asker->pool));
    VkDescriptorSetAllocateInfo allocate = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                            .descriptorPool = asker->pool,
                                            .descriptorSetCount = 1,
                                            .pSetLayouts = &asker->layout};
    REQUIRE(vkAllocateDescriptorSets(world->device, &allocate, &asker->set));
    VkDescriptorBufferInfo out = {asker->out.handle, 0, VK_WHOLE_SIZE};
    VkWriteDescriptorSet write = {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                  .dstSet = asker->set,
                                  .dstBinding = 1,
                                  .descriptorCount = 1,
                                  .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                  .pBufferInfo = &out};
    vkUpdateDescriptorSets(world->device, 1, &write, 0, NULL);
    if (tlas)
        asker_refer(world, asker, 0, tlas);
}

void asker_refer(struct world *world, struct asker *asker, uint32_t element, VkAccelerationStructureKHR tlas)
{
    VkWriteDescriptorSetAccelerationStructureKHR scene = {
        .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET_ACCELERATION_STRUCTURE_KHR,
        .accelerationStructureCount = 1,
        .pAccelerationStructures = &tlas};
    VkWriteDescriptorSet write = {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                  .pNext = &scene,
                                  .dstSet = asker->set,
                                  .dstArrayElement = element,
                                  .descriptorCount = 1,
                                  .descriptorType = VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR};
    vkUpdateDescriptorSets(world->device, 1, &write, 0, NULL);
}

static void create_picture(struct world *world, struct asker *asker)
{
    VkImageCreateInfo image = {.sType = VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO,
                               .imageType = VK_IMAGE_TYPE_2D,
                               .format = VK_FORMAT_R32_SFLOAT,
                               .extent = {ASK_SIZE, ASK_SIZE, 1},
                               .mipLevels = 1,
                               .arrayLayers = 1,
                               .samples = VK_SAMPLE_COUNT_1_BIT,
                               .usage = VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT | VK_IMAGE_USAGE_TRANSFER_SRC_BIT};
    REQUIRE(vkCreateImage(world->device, &image, NULL, &asker->image));
    VkMemoryRequirements needs;
    vkGetImageMemoryRequirements(world->device, asker->image, &needs);
    VkMemoryAllocateInfo memory = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
                                   .allocationSize = needs.size,
                                   .memoryTypeIndex = (uint32_t)__builtin_ctz(needs.memoryTypeBits)};
    REQUIRE(vkAllocateMemory(world->device, &memory, NULL, &asker->memory));
    REQUIRE(vkBindImageMemory(world->device, asker->image, asker->memory, 0));
    VkImageViewCreateInfo view = {.sType = VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO,
                                  .image = asker->image,
                                  .viewType = VK_IMAGE_VIEW_TYPE_2D,
                                  .format = image.format,
                                  .subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1}};
    REQUIRE(vkCreateImageView(world->device, &view, NULL, &asker->view));
}

/* The stage, with the module in it or beside it. */
static VkPipelineShaderStageCreateInfo stage_of(struct world *world, const VkShaderModuleCreateInfo *code, VkShaderStageFlagBits stage,
                                                bool inside, VkShaderModule *out_module)
{
    VkPipelineShaderStageCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO, .stage = stage, .pName = "main"};
    if (inside) {
        info.pNext = code;
    } else {
        REQUIRE(vkCreateShaderModule(world->device, code, NULL, out_module));
        info.module = *out_module;
    }
    return info;
}

static void create_compute(struct world *world, struct asker *asker, const VkSpecializationInfo *constants)
{
    VkComputePipelineCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
        .stage = stage_of(world, &codes[asker->stage], VK_SHADER_STAGE_COMPUTE_BIT, asker->way == ASK_INLINE, &asker->module),
        .layout = asker->pipeline_layout};
    info.stage.pSpecializationInfo = constants;
    REQUIRE(vkCreateComputePipelines(world->device, VK_NULL_HANDLE, 1, &info, NULL, &asker->pipeline));
}

static void create_object(struct world *world, struct asker *asker, const VkSpecializationInfo *constants)
{
    VkPushConstantRange push = {VK_SHADER_STAGE_COMPUTE_BIT | VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT |
                                    VK_SHADER_STAGE_RAYGEN_BIT_KHR,
                                0, 4};
    VkShaderCreateInfoEXT info = {.sType = VK_STRUCTURE_TYPE_SHADER_CREATE_INFO_EXT,
                                  .stage = stages[asker->stage],
                                  .codeType = VK_SHADER_CODE_TYPE_SPIRV_EXT,
                                  .codeSize = codes[asker->stage].codeSize,
                                  .pCode = codes[asker->stage].pCode,
                                  .pName = "main",
                                  .setLayoutCount = 1,
                                  .pSetLayouts = &asker->layout,
                                  .pushConstantRangeCount = 1,
                                  .pPushConstantRanges = &push,
                                  .pSpecializationInfo = constants};
    REQUIRE(COMMAND(world, CreateShadersEXT)(world->device, 1, &info, NULL, &asker->object));
}

static void create_graphics(struct world *world, struct asker *asker)
{
    bool vertex = asker->stage == ASK_VERTEX, linked = asker->way == ASK_BY_LIBRARY, inside = asker->way == ASK_INLINE || linked;
    VkShaderModule other = VK_NULL_HANDLE;
    VkPipelineShaderStageCreateInfo shaders[2] = {
        stage_of(world, vertex ? &codes[ASK_VERTEX] : &plane, VK_SHADER_STAGE_VERTEX_BIT, inside, vertex ? &asker->module : &other),
        stage_of(world, vertex ? &plain : &codes[ASK_FRAGMENT], VK_SHADER_STAGE_FRAGMENT_BIT, inside,
                 vertex ? &other : &asker->module)};
    const VkFormat format = VK_FORMAT_R32_SFLOAT;
    VkPipelineRenderingCreateInfo rendering = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_RENDERING_CREATE_INFO, .colorAttachmentCount = 1, .pColorAttachmentFormats = &format};
    VkPipelineVertexInputStateCreateInfo input = {.sType = VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO};
    VkPipelineInputAssemblyStateCreateInfo assembly = {.sType = VK_STRUCTURE_TYPE_PIPELINE_INPUT_ASSEMBLY_STATE_CREATE_INFO,
                                                       .topology = VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST};
    VkViewport viewport = {0, 0, ASK_SIZE, ASK_SIZE, 0, 1};
    VkRect2D scissor = {{0, 0}, {ASK_SIZE, ASK_SIZE}};
    VkPipelineViewportStateCreateInfo view = {.sType = VK_STRUCTURE_TYPE_PIPELINE_VIEWPORT_STATE_CREATE_INFO,
                                              .viewportCount = 1,
                                              .pViewports = &viewport,
                                              .scissorCount = 1,
                                              .pScissors = &scissor};
    VkPipelineRasterizationStateCreateInfo raster = {.sType = VK_STRUCTURE_TYPE_PIPELINE_RASTERIZATION_STATE_CREATE_INFO, .lineWidth = 1};
    VkPipelineMultisampleStateCreateInfo samples = {.sType = VK_STRUCTURE_TYPE_PIPELINE_MULTISAMPLE_STATE_CREATE_INFO,
                                                    .rasterizationSamples = VK_SAMPLE_COUNT_1_BIT};
    VkPipelineColorBlendAttachmentState attachment = {.colorWriteMask = 0xF};
    VkPipelineColorBlendStateCreateInfo blend = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_COLOR_BLEND_STATE_CREATE_INFO, .attachmentCount = 1, .pAttachments = &attachment};
    VkPipelineDepthStencilStateCreateInfo depth = {.sType = VK_STRUCTURE_TYPE_PIPELINE_DEPTH_STENCIL_STATE_CREATE_INFO};
    VkGraphicsPipelineCreateInfo info = {.sType = VK_STRUCTURE_TYPE_GRAPHICS_PIPELINE_CREATE_INFO,
                                         .pNext = &rendering,
                                         .stageCount = 2,
                                         .pStages = shaders,
                                         .pVertexInputState = &input,
                                         .pInputAssemblyState = &assembly,
                                         .pViewportState = &view,
                                         .pRasterizationState = &raster,
                                         .pMultisampleState = &samples,
                                         .pDepthStencilState = &depth,
                                         .pColorBlendState = &blend,
                                         .layout = asker->pipeline_layout};
    for (uint32_t part = 0; linked && part < 2; part++) {
        VkGraphicsPipelineLibraryCreateInfoEXT parts = {
            .sType = VK_STRUCTURE_TYPE_GRAPHICS_PIPELINE_LIBRARY_CREATE_INFO_EXT,
            .pNext = &rendering,
            .flags = part ? VK_GRAPHICS_PIPELINE_LIBRARY_FRAGMENT_SHADER_BIT_EXT | VK_GRAPHICS_PIPELINE_LIBRARY_FRAGMENT_OUTPUT_INTERFACE_BIT_EXT
                          : VK_GRAPHICS_PIPELINE_LIBRARY_VERTEX_INPUT_INTERFACE_BIT_EXT |
                                VK_GRAPHICS_PIPELINE_LIBRARY_PRE_RASTERIZATION_SHADERS_BIT_EXT};
        VkGraphicsPipelineCreateInfo library = info;
        library.pNext = &parts;
        library.flags = VK_PIPELINE_CREATE_LIBRARY_BIT_KHR;
        library.stageCount = 1;
        library.pStages = &shaders[part];
        REQUIRE(vkCreateGraphicsPipelines(world->device, VK_NULL_HANDLE, 1, &library, NULL, &asker->libraries[part]));
    }
    VkPipelineLibraryCreateInfoKHR libraries = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_LIBRARY_CREATE_INFO_KHR, .libraryCount = 2, .pLibraries = asker->libraries};
    VkGraphicsPipelineCreateInfo link = {
        .sType = VK_STRUCTURE_TYPE_GRAPHICS_PIPELINE_CREATE_INFO, .pNext = &libraries, .layout = asker->pipeline_layout};
    REQUIRE(vkCreateGraphicsPipelines(world->device, VK_NULL_HANDLE, 1, linked ? &link : &info, NULL, &asker->pipeline));
    vkDestroyShaderModule(world->device, other, NULL);
}

static void create_rays(struct world *world, struct asker *asker)
{
    VkPipelineShaderStageCreateInfo stage =
        stage_of(world, &codes[ASK_RAYGEN], VK_SHADER_STAGE_RAYGEN_BIT_KHR, asker->way == ASK_INLINE, &asker->module);
    VkRayTracingShaderGroupCreateInfoKHR group = {.sType = VK_STRUCTURE_TYPE_RAY_TRACING_SHADER_GROUP_CREATE_INFO_KHR,
                                                  .type = VK_RAY_TRACING_SHADER_GROUP_TYPE_GENERAL_KHR,
                                                  .closestHitShader = VK_SHADER_UNUSED_KHR,
                                                  .anyHitShader = VK_SHADER_UNUSED_KHR,
                                                  .intersectionShader = VK_SHADER_UNUSED_KHR};
    VkRayTracingPipelineCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_RAY_TRACING_PIPELINE_CREATE_INFO_KHR,
                                              .stageCount = 1,
                                              .pStages = &stage,
                                              .groupCount = 1,
                                              .pGroups = &group,
                                              .maxPipelineRayRecursionDepth = 1,
                                              .layout = asker->pipeline_layout};
    REQUIRE(COMMAND(world, CreateRayTracingPipelinesKHR)(world->device, VK_NULL_HANDLE, VK_NULL_HANDLE, 1, &info, NULL, &asker->pipeline));
    VkPhysicalDeviceRayTracingPipelinePropertiesKHR properties = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_PROPERTIES_KHR};
    VkPhysicalDeviceProperties2 all = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &properties};
    vkGetPhysicalDeviceProperties2(world->physical, &all);
    VkDeviceSize size = properties.shaderGroupHandleSize, align = properties.shaderGroupBaseAlignment;
    asker->table = buffer_create(world, size + align, VK_BUFFER_USAGE_SHADER_BINDING_TABLE_BIT_KHR);
    VkDeviceAddress at = (asker->table.address + align - 1) / align * align;
    REQUIRE(COMMAND(world, GetRayTracingShaderGroupHandlesKHR)(world->device, asker->pipeline, 0, 1, size,
                                                               (char *)asker->table.mapped + (at - asker->table.address)));
    asker->raygen = (VkStridedDeviceAddressRegionKHR){at, size, size};
}

struct asker asker_create(struct world *world, enum ask_stage stage, enum ask_way way, VkAccelerationStructureKHR tlas,
                          uint32_t flags)
{
    struct asker asker = {.stage = stage, .way = way};
    bool picture = stage == ASK_VERTEX || stage == ASK_FRAGMENT;
    VkSpecializationMapEntry entry = {0, 0, 4};
    VkSpecializationInfo constants = {1, &entry, 4, &flags};
    asker.out = buffer_create(world, (picture ? ASK_SIZE * ASK_SIZE : ASK_LANES) * sizeof(float),
                              VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT);
    create_layout(world, &asker);
    create_set(world, &asker, tlas);
    if (picture)
        create_picture(world, &asker);
    if (way == ASK_BY_OBJECT)
        create_object(world, &asker, &constants);
    else if (stage == ASK_COMPUTE || stage >= ASK_LONG)
        create_compute(world, &asker, &constants);
    else if (stage == ASK_RAYGEN)
        create_rays(world, &asker);
    else
        create_graphics(world, &asker);
    return asker;
}

void asker_destroy(struct world *world, struct asker *asker)
{
    vkDestroyPipeline(world->device, asker->pipeline, NULL);
    for (int part = 0; part < 2; part++)
        vkDestroyPipeline(world->device, asker->libraries[part], NULL);
    vkDestroyShaderModule(world->device, asker->module, NULL);
    if (asker->object)
        COMMAND(world, DestroyShaderEXT)(world->device, asker->object, NULL);
    vkDestroyDescriptorPool(world->device, asker->pool, NULL);
    vkDestroyPipelineLayout(world->device, asker->pipeline_layout, NULL);
    vkDestroyDescriptorSetLayout(world->device, asker->layout, NULL);
    vkDestroyImageView(world->device, asker->view, NULL);
    vkDestroyImage(world->device, asker->image, NULL);
    vkFreeMemory(world->device, asker->memory, NULL);
    buffer_destroy(world, &asker->out);
    if (asker->table.handle)
        buffer_destroy(world, &asker->table);
}

static void set_name(struct world *world, VkObjectType type, uint64_t handle, const char *name)
{
    VkDebugUtilsObjectNameInfoEXT info = {.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_OBJECT_NAME_INFO_EXT,
                                          .objectType = type,
                                          .objectHandle = handle,
                                          .pObjectName = name};
    if (handle)
        REQUIRE(world->SetDebugUtilsObjectNameEXT(world->device, &info));
}

void asker_name(struct world *world, const struct asker *asker, const char *module, const char *pipeline)
{
    set_name(world, VK_OBJECT_TYPE_SHADER_MODULE, (uint64_t)asker->module, module);
    set_name(world, VK_OBJECT_TYPE_PIPELINE, (uint64_t)asker->pipeline, pipeline);
    set_name(world, VK_OBJECT_TYPE_SHADER_EXT, (uint64_t)asker->object, pipeline);
}

static void transition(VkCommandBuffer commands, VkImage image, VkImageLayout from, VkImageLayout to)
{
    VkImageMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER,
                                    .srcAccessMask = VK_ACCESS_MEMORY_WRITE_BIT,
                                    .dstAccessMask = VK_ACCESS_MEMORY_READ_BIT | VK_ACCESS_MEMORY_WRITE_BIT,
                                    .oldLayout = from,
                                    .newLayout = to,
                                    .srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED,
                                    .dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED,
                                    .image = image,
                                    .subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1}};
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, 0, 0, NULL, 0, NULL, 1,
                         &barrier);
}

static void draw(VkCommandBuffer commands, struct asker *asker)
{
    transition(commands, asker->image, VK_IMAGE_LAYOUT_UNDEFINED, VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL);
    VkRenderingAttachmentInfo attachment = {.sType = VK_STRUCTURE_TYPE_RENDERING_ATTACHMENT_INFO,
                                            .imageView = asker->view,
                                            .imageLayout = VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
                                            .loadOp = VK_ATTACHMENT_LOAD_OP_CLEAR,
                                            .storeOp = VK_ATTACHMENT_STORE_OP_STORE};
    VkRenderingInfo rendering = {.sType = VK_STRUCTURE_TYPE_RENDERING_INFO,
                                 .renderArea = {{0, 0}, {ASK_SIZE, ASK_SIZE}},
                                 .layerCount = 1,
                                 .colorAttachmentCount = 1,
                                 .pColorAttachments = &attachment};
    vkCmdBeginRendering(commands, &rendering);
    vkCmdDraw(commands, 3, 1, 0, 0);
    vkCmdEndRendering(commands);
    transition(commands, asker->image, VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL);
    VkBufferImageCopy copy = {.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1}, .imageExtent = {ASK_SIZE, ASK_SIZE, 1}};
    vkCmdCopyImageToBuffer(commands, asker->image, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL, asker->out.handle, 1, &copy);
}

VkCommandBuffer asker_record(struct world *world, struct asker *asker, uint32_t wrong)
{
    static const VkPipelineBindPoint points[] = {VK_PIPELINE_BIND_POINT_COMPUTE, VK_PIPELINE_BIND_POINT_GRAPHICS,
                                                 VK_PIPELINE_BIND_POINT_GRAPHICS, VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR,
                                                 VK_PIPELINE_BIND_POINT_COMPUTE, VK_PIPELINE_BIND_POINT_COMPUTE,
                                                 VK_PIPELINE_BIND_POINT_COMPUTE};
    VkPipelineBindPoint point = points[asker->stage];
    const VkShaderStageFlags all = VK_SHADER_STAGE_COMPUTE_BIT | VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT |
                                   VK_SHADER_STAGE_RAYGEN_BIT_KHR;
    memset(asker->out.mapped, 0, asker->out.size);
    VkCommandBuffer commands = commands_begin(world, 0);
    if (asker->object)
        COMMAND(world, CmdBindShadersEXT)(commands, 1, &stages[asker->stage], &asker->object);
    else
        vkCmdBindPipeline(commands, point, asker->pipeline);
    vkCmdBindDescriptorSets(commands, point, asker->pipeline_layout, 0, 1, &asker->set, 0, NULL);
    vkCmdPushConstants(commands, asker->pipeline_layout, all, 0, 4, &wrong);
    if (point == VK_PIPELINE_BIND_POINT_COMPUTE) {
        vkCmdDispatch(commands, 1, 1, 1);
    } else if (asker->stage == ASK_RAYGEN) {
        VkStridedDeviceAddressRegionKHR none = {0};
        COMMAND(world, CmdTraceRaysKHR)(commands, &asker->raygen, &none, &none, &none, ASK_LANES, 1, 1);
    } else {
        draw(commands, asker);
    }
    commands_barrier(commands);
    commands_end(commands);
    return commands;
}

void asker_run(struct world *world, struct asker *asker, uint32_t wrong)
{
    VkCommandBuffer commands = asker_record(world, asker, wrong);
    submit_and_wait(world, commands);
    vkFreeCommandBuffers(world->device, world->pool, 1, &commands);
}
