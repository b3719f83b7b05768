/* SPDX-License-Identifier: Apache-2.0 */
/* The Vulkan program that the layer's tests run. */
#include "tests/layer/harness.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LAYER "VK_LAYER_GNOMON_ray_tracing"

#define REQUIRE(call)                                                                                                  \
    do {                                                                                                               \
        VkResult require_result = (call);                                                                              \
        if (require_result != VK_SUCCESS)                                                                              \
            fail_msg("%s gave %d", #call, require_result);                                                             \
    } while (0)

static pthread_mutex_t messages_lock = PTHREAD_MUTEX_INITIALIZER;

static VKAPI_ATTR VkBool32 VKAPI_CALL on_message(VkDebugUtilsMessageSeverityFlagBitsEXT severity,
                                                 VkDebugUtilsMessageTypeFlagsEXT types,
                                                 const VkDebugUtilsMessengerCallbackDataEXT *data, void *user)
{
    struct messages *messages = user;
    (void)types;
    /* The loader tells much about its search for drivers. */
    if (data->pMessageIdName && strcmp(data->pMessageIdName, "Loader Message") == 0)
        return VK_FALSE;
    pthread_mutex_lock(&messages_lock);
    if (messages->count < sizeof messages->list / sizeof messages->list[0]) {
        struct message *message = &messages->list[messages->count];
        snprintf(message->id, sizeof message->id, "%s", data->pMessageIdName ? data->pMessageIdName : "");
        snprintf(message->text, sizeof message->text, "%s", data->pMessage);
        message->severity = severity;
        message->object_count = data->objectCount < 4 ? data->objectCount : 4;
        for (uint32_t i = 0; i < message->object_count; i++) {
            message->objects[i] = data->pObjects[i].objectHandle;
            snprintf(message->names[i], sizeof message->names[i], "%s",
                     data->pObjects[i].pObjectName ? data->pObjects[i].pObjectName : "");
        }
    }
    messages->count++;
    pthread_mutex_unlock(&messages_lock);
    return VK_FALSE;
}

static void create_instance(struct world *world, const struct world_options *options)
{
    const char *layers[2];
    uint32_t layer_count = 0;
    const char *beneath = getenv("GNOMON_TEST_BENEATH");
    if (!options->without_layer)
        layers[layer_count++] = LAYER;
    if (beneath && *beneath) {
        layers[layer_count++] = beneath;
        world->above_khronos = true;
    }
    const char *extensions[2] = {VK_EXT_DEBUG_UTILS_EXTENSION_NAME, VK_EXT_LAYER_SETTINGS_EXTENSION_NAME};
    VkBool32 yes = VK_TRUE;
    VkLayerSettingEXT settings[16];
    uint32_t setting_count = 0;
    for (; setting_count < options->setting_count; setting_count++)
        settings[setting_count] = options->settings[setting_count];
    if (world->above_khronos && !options->without_layer)
        settings[setting_count++] =
            (VkLayerSettingEXT){beneath, "validate_sync", VK_LAYER_SETTING_TYPE_BOOL32_EXT, 1, &yes};
    VkLayerSettingsCreateInfoEXT chain_settings = {.sType = VK_STRUCTURE_TYPE_LAYER_SETTINGS_CREATE_INFO_EXT,
                                                   .settingCount = setting_count,
                                                   .pSettings = settings};
    VkDebugUtilsMessengerCreateInfoEXT messenger = {
        .sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT,
        .messageSeverity = VK_DEBUG_UTILS_MESSAGE_SEVERITY_INFO_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT |
                           VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT,
        .messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_GENERAL_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT,
        .pfnUserCallback = on_message,
        .pUserData = &world->messages};
    chain_settings.pNext = options->creation_messenger ? &messenger : NULL;
    VkApplicationInfo application = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO, .apiVersion = VK_API_VERSION_1_3};
    VkInstanceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO,
                                 .pNext = setting_count ? &chain_settings : chain_settings.pNext,
                                 .pApplicationInfo = &application,
                                 .enabledLayerCount = layer_count,
                                 .ppEnabledLayerNames = layers,
                                 .enabledExtensionCount = setting_count ? 2 : 1,
                                 .ppEnabledExtensionNames = extensions};
    REQUIRE(vkCreateInstance(&info, NULL, &world->instance));
    if (options->without_messenger)
        return;
    PFN_vkCreateDebugUtilsMessengerEXT create = (PFN_vkCreateDebugUtilsMessengerEXT)vkGetInstanceProcAddr(
        world->instance, "vkCreateDebugUtilsMessengerEXT");
    assert_non_null(create);
    REQUIRE(create(world->instance, &messenger, NULL, &world->messenger));
}

static void create_device(struct world *world, const struct world_options *options)
{
    uint32_t count = 1;
    VkResult result = vkEnumeratePhysicalDevices(world->instance, &count, &world->physical);
    assert_true(result == VK_SUCCESS || result == VK_INCOMPLETE);
    assert_int_equal(count, 1);
    const char *extensions[5 + 8] = {VK_KHR_ACCELERATION_STRUCTURE_EXTENSION_NAME, VK_KHR_RAY_QUERY_EXTENSION_NAME,
                                VK_KHR_DEFERRED_HOST_OPERATIONS_EXTENSION_NAME, VK_KHR_MAINTENANCE_5_EXTENSION_NAME,
                                VK_KHR_PUSH_DESCRIPTOR_EXTENSION_NAME};
    VkPhysicalDeviceMaintenance5FeaturesKHR maintenance = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_5_FEATURES_KHR,
        .pNext = options->features,
        .maintenance5 = VK_TRUE};
    assert_true(options->extension_count <= 8);
    for (uint32_t i = 0; i < options->extension_count; i++)
        extensions[5 + i] = options->extensions[i];
    VkPhysicalDeviceRayQueryFeaturesKHR queries = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_QUERY_FEATURES_KHR, .pNext = &maintenance, .rayQuery = VK_TRUE};
    VkPhysicalDeviceAccelerationStructureFeaturesKHR structures = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_FEATURES_KHR,
        .pNext = &queries,
        .accelerationStructure = VK_TRUE};
    VkPhysicalDeviceVulkan13Features v13 = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES,
                                            .pNext = options->without_structures ? NULL : &structures,
                                            .synchronization2 = VK_TRUE,
                                            .dynamicRendering = VK_TRUE,
                                            .maintenance4 = VK_TRUE};
    VkPhysicalDeviceVulkan12Features v12 = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES,
                                            .pNext = &v13,
                                            .bufferDeviceAddress = VK_TRUE,
                                            .descriptorIndexing = VK_TRUE,
                                            .runtimeDescriptorArray = VK_TRUE,
                                            .descriptorBindingPartiallyBound = VK_TRUE,
                                            .timelineSemaphore = VK_TRUE};
    float priority = 1;
    VkDeviceQueueCreateInfo queue = {.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
                                     .queueCount = 1,
                                     .pQueuePriorities = &priority};
    VkDeviceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                               .pNext = &v12,
                               .queueCreateInfoCount = 1,
                               .pQueueCreateInfos = &queue,
                               .enabledExtensionCount = options->without_structures ? 0 : 5 + options->extension_count,
                               .ppEnabledExtensionNames = extensions};
    REQUIRE(vkCreateDevice(world->physical, &info, NULL, &world->device));
    vkGetDeviceQueue(world->device, 0, 0, &world->queue);
    VkCommandPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                    .flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT};
    REQUIRE(vkCreateCommandPool(world->device, &pool, NULL, &world->pool));
#define X(name) world->name = (PFN_vk##name)vkGetDeviceProcAddr(world->device, "vk" #name);
    WORLD_COMMANDS(X)
#undef X
}

void world_init(struct world *world, const struct world_options *options)
{
    static const struct world_options none;
    memset(world, 0, sizeof *world);
    world->rule = NEVER_BUILT;
    create_instance(world, options ? options : &none);
    create_device(world, options ? options : &none);
}

/* Rules have dotted ids in lower case; the ids of Khronos' layers are in capitals. */
static bool is_rule(const char *id)
{
    return *id >= 'a' && *id <= 'z' && strchr(id, '.');
}

/* Whether a finding of ours names the id among its sources. */
static bool found_as(const struct world *world, const char *id)
{
    for (uint32_t i = 0; i < world->messages.count && i < 64; i++) {
        const char *sources = strstr(world->messages.list[i].text, "\nSource:");
        if (is_rule(world->messages.list[i].id) && sources && *id && strstr(sources, id))
            return true;
    }
    return false;
}

void world_finish(struct world *world)
{
    vkDestroyCommandPool(world->device, world->pool, NULL);
    vkDestroyDevice(world->device, NULL);
    if (world->messenger) {
        PFN_vkDestroyDebugUtilsMessengerEXT destroy = (PFN_vkDestroyDebugUtilsMessengerEXT)vkGetInstanceProcAddr(
            world->instance, "vkDestroyDebugUtilsMessengerEXT");
        destroy(world->instance, world->messenger, NULL);
    }
    vkDestroyInstance(world->instance, NULL);
    /* What is beneath us has the last word on what we inserted; it may also object to what we found. */
    for (uint32_t i = 0; world->above_khronos && i < world->messages.count && i < 64; i++) {
        const struct message *message = &world->messages.list[i];
        if (found_as(world, message->id))
            continue;
        if (strncmp(message->id, "VUID", 4) == 0 || strncmp(message->id, "SYNC", 4) == 0 ||
            strncmp(message->id, "UNASSIGNED", 10) == 0)
            fail_msg("the layer beneath objects: %s: %s", message->id, message->text);
    }
}

struct buffer buffer_create(struct world *world, VkDeviceSize size, VkBufferUsageFlags usage)
{
    return gn_test_buffer_create(world->physical, world->device, size, usage);
}

void buffer_destroy(struct world *world, struct buffer *buffer)
{
    gn_test_buffer_destroy(world->device, buffer);
}

/* Of both geometries, if there are two. */
struct geometries {
    VkAccelerationStructureGeometryKHR list[2];
    VkAccelerationStructureBuildRangeInfoKHR ranges[2];
};

/* One geometry of a structure; a second is like it. */
static VkAccelerationStructureGeometryKHR geometry_of(const struct structure *structure)
{
    VkAccelerationStructureGeometryKHR geometry = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
                                                   .flags = structure->geometry_flags};
    if (structure->type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR) {
        geometry.geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR;
        geometry.geometry.instances = (VkAccelerationStructureGeometryInstancesDataKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
            .data.deviceAddress = structure->input.address};
    } else {
        geometry.geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR;
        geometry.geometry.triangles = (VkAccelerationStructureGeometryTrianglesDataKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
            .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
            .vertexData.deviceAddress = structure->input.address,
            .vertexStride = 12,
            .maxVertex = structure->max_vertex,
            .indexType = VK_INDEX_TYPE_NONE_KHR};
    }
    return geometry;
}

static VkAccelerationStructureBuildGeometryInfoKHR build_of(const struct structure *structure, struct geometries *geometries)
{
    for (int g = 0; g < 2; g++) {
        geometries->list[g] = geometry_of(structure);
        geometries->ranges[g] =
            (VkAccelerationStructureBuildRangeInfoKHR){.primitiveCount = structure->count, .primitiveOffset = structure->offset};
    }
    return (VkAccelerationStructureBuildGeometryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = structure->type,
        .flags = structure->flags,
        .mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
        .dstAccelerationStructure = structure->handle,
        .geometryCount = structure->twice ? 2 : 1,
        .pGeometries = geometries->list,
        .scratchData.deviceAddress = structure->scratch.address};
}

void structure_create_handle(struct world *world, struct structure *structure, VkAccelerationStructureTypeKHR type)
{
    VkAccelerationStructureCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
                                                 .buffer = structure->storage.handle,
                                                 .size = structure->size,
                                                 .type = type};
    REQUIRE(world->CreateAccelerationStructureKHR(world->device, &info, NULL, &structure->handle));
    VkAccelerationStructureDeviceAddressInfoKHR query = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_DEVICE_ADDRESS_INFO_KHR,
        .accelerationStructure = structure->handle};
    structure->address = world->GetAccelerationStructureDeviceAddressKHR(world->device, &query);
}

static void structure_fill(struct world *world, struct structure *structure, VkAccelerationStructureTypeKHR created_as)
{
    struct geometries geometries;
    VkAccelerationStructureBuildGeometryInfoKHR build = build_of(structure, &geometries);
    const uint32_t counts[2] = {structure->count, structure->count};
    VkAccelerationStructureBuildSizesInfoKHR sizes = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR};
    world->GetAccelerationStructureBuildSizesKHR(world->device, VK_ACCELERATION_STRUCTURE_BUILD_TYPE_DEVICE_KHR, &build,
                                                 counts, &sizes);
    VkDeviceSize scratch = sizes.buildScratchSize > sizes.updateScratchSize ? sizes.buildScratchSize : sizes.updateScratchSize;
    structure->size = sizes.accelerationStructureSize;
    structure->storage =
        buffer_create(world, structure->size, VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR);
    structure->scratch = buffer_create(world, scratch + 1, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT);
    structure_create_handle(world, structure, created_as);
}

static struct structure triangle_create(struct world *world, VkAccelerationStructureTypeKHR type,
                                        VkBuildAccelerationStructureFlagsKHR flags, bool twice)
{
    static const float triangle[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    struct structure blas = {.type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, .count = 1, .max_vertex = 2, .flags = flags,
                             .twice = twice};
    blas.input = buffer_create(world, sizeof triangle, VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR);
    memcpy(blas.input.mapped, triangle, sizeof triangle);
    structure_fill(world, &blas, type);
    return blas;
}

struct structure blas_create(struct world *world, VkAccelerationStructureTypeKHR type,
                             VkBuildAccelerationStructureFlagsKHR flags)
{
    return triangle_create(world, type, flags, false);
}

struct structure blas_create_twice(struct world *world)
{
    return triangle_create(world, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, 0, true);
}

struct structure target_create(struct world *world, VkAccelerationStructureTypeKHR type, VkDeviceSize size)
{
    struct structure target = {.type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, .size = size};
    target.storage = buffer_create(world, size, VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR);
    structure_create_handle(world, &target, type);
    return target;
}

struct structure tlas_create(struct world *world, uint32_t count)
{
    struct structure tlas = {.type = VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR, .count = count,
                             .flags = VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR};
    tlas.input = buffer_create(world, (count ? count : 1) * sizeof(VkAccelerationStructureInstanceKHR),
                               VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR);
    for (uint32_t i = 0; i < count; i++)
        tlas_refer(&tlas, i, 0);
    structure_fill(world, &tlas, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR);
    return tlas;
}

void structure_destroy_handle(struct world *world, struct structure *structure)
{
    world->DestroyAccelerationStructureKHR(world->device, structure->handle, NULL);
    structure->handle = VK_NULL_HANDLE;
}

void structure_destroy(struct world *world, struct structure *structure)
{
    structure_destroy_handle(world, structure);
    buffer_destroy(world, &structure->storage);
    buffer_destroy(world, &structure->scratch);
    buffer_destroy(world, &structure->input);
}

void structure_name(struct world *world, const struct structure *structure, const char *name)
{
    VkDebugUtilsObjectNameInfoEXT info = {.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_OBJECT_NAME_INFO_EXT,
                                          .objectType = VK_OBJECT_TYPE_ACCELERATION_STRUCTURE_KHR,
                                          .objectHandle = (uint64_t)structure->handle,
                                          .pObjectName = name};
    assert_non_null(world->SetDebugUtilsObjectNameEXT);
    REQUIRE(world->SetDebugUtilsObjectNameEXT(world->device, &info));
}

VkAccelerationStructureInstanceKHR *tlas_instance(struct structure *tlas, uint32_t index)
{
    return (VkAccelerationStructureInstanceKHR *)tlas->input.mapped + index;
}

void tlas_refer(struct structure *tlas, uint32_t index, VkDeviceAddress reference)
{
    *tlas_instance(tlas, index) = (VkAccelerationStructureInstanceKHR){.transform = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}},
                                                     .mask = 0xFF,
                                                     .accelerationStructureReference = reference};
}

static VkCommandBuffer begin(struct world *world, VkCommandBufferLevel level, VkCommandBufferUsageFlags flags)
{
    VkCommandBuffer commands;
    VkCommandBufferAllocateInfo allocation = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                              .commandPool = world->pool,
                                              .level = level,
                                              .commandBufferCount = 1};
    REQUIRE(vkAllocateCommandBuffers(world->device, &allocation, &commands));
    VkCommandBufferInheritanceInfo inheritance = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_INHERITANCE_INFO};
    VkCommandBufferBeginInfo info = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO,
                                     .flags = flags,
                                     .pInheritanceInfo = &inheritance};
    REQUIRE(vkBeginCommandBuffer(commands, &info));
    return commands;
}

VkCommandBuffer commands_begin(struct world *world, VkCommandBufferUsageFlags flags)
{
    return begin(world, VK_COMMAND_BUFFER_LEVEL_PRIMARY, flags);
}

VkCommandBuffer secondary_begin(struct world *world, VkCommandBufferUsageFlags flags)
{
    return begin(world, VK_COMMAND_BUFFER_LEVEL_SECONDARY, flags);
}

void commands_end(VkCommandBuffer commands)
{
    REQUIRE(vkEndCommandBuffer(commands));
}

void commands_build(struct world *world, VkCommandBuffer commands, struct structure *const *structures, uint32_t count)
{
    struct geometries geometries[8];
    VkAccelerationStructureBuildGeometryInfoKHR builds[8];
    const VkAccelerationStructureBuildRangeInfoKHR *range_pointers[8];
    assert_true(count <= 8);
    for (uint32_t i = 0; i < count; i++) {
        builds[i] = build_of(structures[i], &geometries[i]);
        range_pointers[i] = geometries[i].ranges;
    }
    world->CmdBuildAccelerationStructuresKHR(commands, count, builds, range_pointers);
}

void commands_build_one(struct world *world, VkCommandBuffer commands, struct structure *structure)
{
    commands_build(world, commands, &structure, 1);
}

void commands_update(struct world *world, VkCommandBuffer commands, struct structure *structure)
{
    struct geometries geometries;
    VkAccelerationStructureBuildGeometryInfoKHR build = build_of(structure, &geometries);
    const VkAccelerationStructureBuildRangeInfoKHR *ranges = geometries.ranges;
    build.mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
    build.srcAccelerationStructure = structure->handle;
    world->CmdBuildAccelerationStructuresKHR(commands, 1, &build, &ranges);
}

void commands_barrier(VkCommandBuffer commands)
{
    VkMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                               .srcAccessMask = VK_ACCESS_MEMORY_WRITE_BIT,
                               .dstAccessMask = VK_ACCESS_MEMORY_READ_BIT | VK_ACCESS_MEMORY_WRITE_BIT};
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT,
                         VK_PIPELINE_STAGE_ALL_COMMANDS_BIT | VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &barrier, 0, NULL, 0, NULL);
}

void submit(struct world *world, VkCommandBuffer commands, VkFence fence)
{
    VkSubmitInfo info = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &commands};
    REQUIRE(vkQueueSubmit(world->queue, 1, &info, fence));
}

void submit_and_wait(struct world *world, VkCommandBuffer commands)
{
    submit(world, commands, VK_NULL_HANDLE);
    REQUIRE(vkQueueWaitIdle(world->queue));
}

VkFence fence_create(struct world *world)
{
    VkFence fence;
    VkFenceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    REQUIRE(vkCreateFence(world->device, &info, NULL, &fence));
    return fence;
}

uint32_t messages_count(const struct world *world, const char *id)
{
    uint32_t count = 0;
    for (uint32_t i = 0; i < world->messages.count && i < 64; i++)
        count += strcmp(world->messages.list[i].id, id) == 0;
    return count;
}

const struct message *messages_find(const struct world *world, const char *id)
{
    for (uint32_t i = 0; i < world->messages.count && i < 64; i++)
        if (strcmp(world->messages.list[i].id, id) == 0)
            return &world->messages.list[i];
    return NULL;
}

void expect_findings(struct world *world, uint32_t expected)
{
    uint32_t actual = 0, others = 0;
    for (uint32_t i = 0; i < world->messages.count && i < 64; i++) {
        bool counts = strcmp(world->messages.list[i].id, world->rule) == 0;
        actual += counts;
        others += !counts && is_rule(world->messages.list[i].id);
    }
    if (actual == expected && !others)
        return;
    for (uint32_t i = 0; i < world->messages.count && i < 64; i++)
        print_error("received %s: %s\n", world->messages.list[i].id, world->messages.list[i].text);
    fail_msg("expected %u findings of %s and no others, found %u and %u others", expected, world->rule, actual, others);
}

char *file_read(const char *path)
{
    FILE *file = fopen(path, "rb");
    char *text = NULL;
    size_t size = 0, capacity = 0;
    if (!file)
        return NULL;
    for (;;) {
        if (size + 4096 + 1 > capacity) {
            capacity = capacity * 2 + 8192;
            char *grown = realloc(text, capacity);
            if (!grown)
                abort();
            text = grown;
        }
        size_t got = fread(text + size, 1, 4096, file);
        size += got;
        if (!got)
            break;
    }
    fclose(file);
    text[size] = '\0';
    return text;
}
