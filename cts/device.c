/* SPDX-License-Identifier: Apache-2.0 */
/* Opens a Vulkan device that traces rays, and runs command buffers on it. */
#include "cts/device.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include <yyjson.h>

#include "cts/device_internal.h"

/* Longer than any case may take: a submission that is still not done is taken for a hang. */
#define SUBMIT_TIMEOUT_NS (120ull * 1000 * 1000 * 1000)

/* Layers' messages shown on stderr; the rest are counted only. */
#define SHOWN_MESSAGES 20

enum gn_device_status gn_device_fail(struct gn_device *device, enum gn_device_status status, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(device->message, sizeof device->message, format, arguments);
    va_end(arguments);
    if (status == GN_DEVICE_LOST) {
        device->lost = true;
    }
    return status;
}

static const char *result_name(VkResult result)
{
    switch (result) {
    case VK_TIMEOUT: return "VK_TIMEOUT";
    case VK_NOT_READY: return "VK_NOT_READY";
    case VK_INCOMPLETE: return "VK_INCOMPLETE";
    case VK_ERROR_OUT_OF_HOST_MEMORY: return "VK_ERROR_OUT_OF_HOST_MEMORY";
    case VK_ERROR_OUT_OF_DEVICE_MEMORY: return "VK_ERROR_OUT_OF_DEVICE_MEMORY";
    case VK_ERROR_INITIALIZATION_FAILED: return "VK_ERROR_INITIALIZATION_FAILED";
    case VK_ERROR_DEVICE_LOST: return "VK_ERROR_DEVICE_LOST";
    case VK_ERROR_MEMORY_MAP_FAILED: return "VK_ERROR_MEMORY_MAP_FAILED";
    case VK_ERROR_LAYER_NOT_PRESENT: return "VK_ERROR_LAYER_NOT_PRESENT";
    case VK_ERROR_EXTENSION_NOT_PRESENT: return "VK_ERROR_EXTENSION_NOT_PRESENT";
    case VK_ERROR_FEATURE_NOT_PRESENT: return "VK_ERROR_FEATURE_NOT_PRESENT";
    case VK_ERROR_INCOMPATIBLE_DRIVER: return "VK_ERROR_INCOMPATIBLE_DRIVER";
    case VK_ERROR_TOO_MANY_OBJECTS: return "VK_ERROR_TOO_MANY_OBJECTS";
    case VK_ERROR_OUT_OF_POOL_MEMORY: return "VK_ERROR_OUT_OF_POOL_MEMORY";
    case VK_ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS: return "VK_ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS";
    case VK_ERROR_UNKNOWN: return "VK_ERROR_UNKNOWN";
    default: return "VkResult";
    }
}

enum gn_device_status gn_device_check(struct gn_device *device, VkResult result, const char *what)
{
    if (result == VK_SUCCESS) {
        return GN_DEVICE_OK;
    }
    const enum gn_device_status status = result == VK_ERROR_DEVICE_LOST            ? GN_DEVICE_LOST
                                         : result == VK_ERROR_OUT_OF_DEVICE_MEMORY ? GN_DEVICE_UNSUPPORTED
                                                                                   : GN_DEVICE_FAILED;
    return gn_device_fail(device, status, "%s gave %s (%d)", what, result_name(result), result);
}

const char *gn_device_message(const struct gn_device *device)
{
    return device->message;
}

const struct gn_device_info *gn_device_info(const struct gn_device *device)
{
    return &device->info;
}

uint64_t gn_device_validation_count(const struct gn_device *device)
{
    return device->validation_count;
}

const char *gn_device_validation_first(const struct gn_device *device)
{
    return device->validation_first;
}

enum gn_device_status gn_device_layers_check(struct gn_device *device)
{
    const uint64_t count = device->validation_count - device->validation_told;
    device->validation_told = device->validation_count;
    if (count == 0) {
        return GN_DEVICE_OK;
    }
    return gn_device_fail(device, GN_DEVICE_FAILED, "a layer reports (%llu message%s, this is the last): %s",
                          (unsigned long long)count, count == 1 ? "" : "s", device->validation_latest);
}

double gn_seconds_now(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + (double)now.tv_nsec * 1e-9;
}

/* Opening */

static VKAPI_ATTR VkBool32 VKAPI_CALL heard(VkDebugUtilsMessageSeverityFlagBitsEXT severity,
                                            VkDebugUtilsMessageTypeFlagsEXT types,
                                            const VkDebugUtilsMessengerCallbackDataEXT *data, void *user)
{
    (void)severity;
    (void)types;
    struct gn_device *device = user;
    const char *message = data->pMessage ? data->pMessage : "";
    snprintf(device->validation_latest, sizeof device->validation_latest, "%s", message);
    if (device->validation_count++ == 0) {
        snprintf(device->validation_first, sizeof device->validation_first, "%s", message);
    }
    if (device->validation_count <= SHOWN_MESSAGES) {
        fprintf(stderr, "gnomon: a layer reports: %s\n", message);
    }
    return VK_FALSE;
}

/*
 * The loader says little about an ICD file that it cannot use, so the file is looked at first. A library
 * named without a slash is searched for by the dynamic linker; that is left to it.
 */
static bool icd_check(const char *path, char *out_error, size_t error_size)
{
    bool good = false;
    char library_path[4096];
    yyjson_read_err error;
    yyjson_doc *document = NULL;
    if (access(path, R_OK) != 0) {
        snprintf(out_error, error_size, "no such ICD file: %s (%s)", path, strerror(errno));
        return false;
    }
    document = yyjson_read_file(path, YYJSON_READ_NOFLAG, NULL, &error);
    if (!document) {
        snprintf(out_error, error_size, "the ICD file %s is not readable JSON: %s at byte %zu", path, error.msg,
                 error.pos);
        return false;
    }
    yyjson_val *icd = yyjson_obj_get(yyjson_doc_get_root(document), "ICD");
    const char *library = yyjson_get_str(yyjson_obj_get(icd, "library_path"));
    if (!library) {
        snprintf(out_error, error_size,
                 "%s is not the ICD file of a driver: expected a string at ICD.library_path, found none", path);
        goto done;
    }
    if (strchr(library, '/')) {
        const char *slash = strrchr(path, '/');
        const int folder = library[0] == '/' || !slash ? 0 : (int)(slash - path) + 1;
        snprintf(library_path, sizeof library_path, "%.*s%s", folder, path, library);
        if (access(library_path, R_OK) != 0) {
            snprintf(out_error, error_size, "the ICD file %s names a driver library that is not there: %s (%s)",
                     path, library_path, strerror(errno));
            goto done;
        }
    }
    good = true;
done:
    yyjson_doc_free(document);
    return good;
}

static bool has_extension(const VkExtensionProperties *list, uint32_t count, const char *name)
{
    for (uint32_t i = 0; i < count; i++) {
        if (strcmp(list[i].extensionName, name) == 0) {
            return true;
        }
    }
    return false;
}

static VkResult instance_create(struct gn_device *device)
{
    VkExtensionProperties *extensions = NULL;
    uint32_t count = 0;
    bool debug_utils = false;
    if (vkEnumerateInstanceExtensionProperties(NULL, &count, NULL) == VK_SUCCESS &&
        (extensions = calloc(count + 1, sizeof *extensions)) != NULL &&
        vkEnumerateInstanceExtensionProperties(NULL, &count, extensions) >= 0) {
        debug_utils = has_extension(extensions, count, VK_EXT_DEBUG_UTILS_EXTENSION_NAME);
    }
    free(extensions);

    const VkDebugUtilsMessengerCreateInfoEXT messenger_info = {
        .sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT,
        .messageSeverity =
            VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT,
        .messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT,
        .pfnUserCallback = heard,
        .pUserData = device,
    };
    const VkApplicationInfo application = {
        .sType = VK_STRUCTURE_TYPE_APPLICATION_INFO,
        .pApplicationName = "gnomon",
        .apiVersion = VK_API_VERSION_1_2,
    };
    const char *const names[] = {VK_EXT_DEBUG_UTILS_EXTENSION_NAME};
    const VkInstanceCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO,
        .pNext = debug_utils ? &messenger_info : NULL,
        .pApplicationInfo = &application,
        .enabledExtensionCount = debug_utils ? 1 : 0,
        .ppEnabledExtensionNames = names,
    };
    VkResult result = vkCreateInstance(&info, NULL, &device->instance);
    if (result == VK_SUCCESS && debug_utils) {
        PFN_vkCreateDebugUtilsMessengerEXT create = (PFN_vkCreateDebugUtilsMessengerEXT)vkGetInstanceProcAddr(
            device->instance, "vkCreateDebugUtilsMessengerEXT");
        if (create) {
            result = create(device->instance, &messenger_info, NULL, &device->messenger);
        }
    }
    return result;
}

struct candidate {
    VkPhysicalDevice physical;
    VkPhysicalDeviceProperties properties;
    bool query, pipeline, pipeline_library, position_fetch, maintenance1, index_uint8_khr, index_uint8_ext;
    char lacks[256]; /* "" when it will do */
};

/* Looks whether a device has what the suite needs, and what it has beyond that. */
static void candidate_examine(struct candidate *candidate)
{
    VkExtensionProperties *list = NULL;
    uint32_t count = 0;
    vkGetPhysicalDeviceProperties(candidate->physical, &candidate->properties);
    if (candidate->properties.apiVersion < VK_API_VERSION_1_2) {
        snprintf(candidate->lacks, sizeof candidate->lacks, "has Vulkan %u.%u, 1.2 is needed",
                 VK_API_VERSION_MAJOR(candidate->properties.apiVersion),
                 VK_API_VERSION_MINOR(candidate->properties.apiVersion));
        return;
    }
    if (vkEnumerateDeviceExtensionProperties(candidate->physical, NULL, &count, NULL) < 0 ||
        (list = calloc(count + 1, sizeof *list)) == NULL ||
        vkEnumerateDeviceExtensionProperties(candidate->physical, NULL, &count, list) < 0) {
        snprintf(candidate->lacks, sizeof candidate->lacks, "does not list its extensions");
        goto done;
    }
    static const char *const needed[] = {
        VK_KHR_ACCELERATION_STRUCTURE_EXTENSION_NAME,
        VK_KHR_DEFERRED_HOST_OPERATIONS_EXTENSION_NAME,
    };
    for (size_t i = 0; i < sizeof needed / sizeof needed[0]; i++) {
        if (!has_extension(list, count, needed[i])) {
            snprintf(candidate->lacks, sizeof candidate->lacks, "lacks %s", needed[i]);
            goto done;
        }
    }
    candidate->position_fetch = has_extension(list, count, VK_KHR_RAY_TRACING_POSITION_FETCH_EXTENSION_NAME);
    candidate->index_uint8_khr = has_extension(list, count, VK_KHR_INDEX_TYPE_UINT8_EXTENSION_NAME);
    candidate->index_uint8_ext = has_extension(list, count, VK_EXT_INDEX_TYPE_UINT8_EXTENSION_NAME);
    candidate->query = has_extension(list, count, VK_KHR_RAY_QUERY_EXTENSION_NAME);
    candidate->pipeline = has_extension(list, count, VK_KHR_RAY_TRACING_PIPELINE_EXTENSION_NAME);
    candidate->pipeline_library = has_extension(list, count, VK_KHR_PIPELINE_LIBRARY_EXTENSION_NAME);
    candidate->maintenance1 = has_extension(list, count, VK_KHR_RAY_TRACING_MAINTENANCE_1_EXTENSION_NAME);
    if (!candidate->query && !candidate->pipeline) {
        snprintf(candidate->lacks, sizeof candidate->lacks, "lacks %s and %s", VK_KHR_RAY_QUERY_EXTENSION_NAME,
                 VK_KHR_RAY_TRACING_PIPELINE_EXTENSION_NAME);
    }
done:
    free(list);
}

/* Those of extensions that the device does not have stay false. */
struct features {
    VkPhysicalDeviceFeatures2 core;
    VkPhysicalDeviceBufferDeviceAddressFeatures address;
    VkPhysicalDeviceAccelerationStructureFeaturesKHR structure;
    VkPhysicalDeviceRayQueryFeaturesKHR query;
    VkPhysicalDeviceRayTracingPipelineFeaturesKHR pipeline;
    VkPhysicalDeviceRayTracingMaintenance1FeaturesKHR maintenance1;
    VkPhysicalDeviceRayTracingPositionFetchFeaturesKHR position_fetch;
    VkPhysicalDeviceIndexTypeUint8FeaturesKHR index_uint8;
};

/* A chain of the structures that the device knows, everything false. */
static void features_chain(const struct candidate *candidate, struct features *features)
{
    const struct {
        bool known;
        VkStructureType type;
        void *structure;
    } links[] = {
        {true, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_BUFFER_DEVICE_ADDRESS_FEATURES, &features->address},
        {true, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_FEATURES_KHR, &features->structure},
        {candidate->query, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_QUERY_FEATURES_KHR, &features->query},
        {candidate->pipeline, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_FEATURES_KHR, &features->pipeline},
        {candidate->maintenance1, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_MAINTENANCE_1_FEATURES_KHR,
         &features->maintenance1},
        {candidate->position_fetch, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_POSITION_FETCH_FEATURES_KHR,
         &features->position_fetch},
        {candidate->index_uint8_khr || candidate->index_uint8_ext,
         VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_INDEX_TYPE_UINT8_FEATURES_KHR, &features->index_uint8},
    };
    memset(features, 0, sizeof *features);
    features->core.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
    for (size_t i = 0; i < sizeof links / sizeof links[0]; i++) {
        if (links[i].known) {
            VkBaseOutStructure *link = links[i].structure;
            link->sType = links[i].type;
            link->pNext = features->core.pNext;
            features->core.pNext = link;
        }
    }
}

static void features_query(const struct candidate *candidate, struct features *features)
{
    features_chain(candidate, features);
    vkGetPhysicalDeviceFeatures2(candidate->physical, &features->core);
}

static void candidate_examine_features(struct candidate *candidate)
{
    struct features features;
    features_query(candidate, &features);
    const char *missing = !features.address.bufferDeviceAddress       ? "bufferDeviceAddress"
                          : !features.structure.accelerationStructure ? "accelerationStructure"
                          : !features.query.rayQuery && !features.pipeline.rayTracingPipeline
                              ? "rayQuery, and rayTracingPipeline"
                              : NULL;
    if (missing) {
        snprintf(candidate->lacks, sizeof candidate->lacks, "lacks the feature %s", missing);
    }
}

/* Appends to a text of limited size. */
static void append(char *text, size_t size, const char *format, ...) __attribute__((format(printf, 3, 4)));
static void append(char *text, size_t size, const char *format, ...)
{
    const size_t length = strlen(text);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text + length, size - length, format, arguments);
    va_end(arguments);
}

static bool physical_choose(struct gn_device *device, int index, struct candidate *out_chosen, char *out_error,
                            size_t error_size)
{
    bool found = false;
    uint32_t count = 0;
    int able = 0;
    VkPhysicalDevice *physicals = NULL;
    VkResult result = vkEnumeratePhysicalDevices(device->instance, &count, NULL);
    if (result >= 0 && count > 0) {
        physicals = calloc(count, sizeof *physicals);
        if (!physicals) {
            result = VK_ERROR_OUT_OF_HOST_MEMORY;
        } else {
            result = vkEnumeratePhysicalDevices(device->instance, &count, physicals);
        }
    }
    if (result < 0) {
        snprintf(out_error, error_size, "the Vulkan driver lists no devices: vkEnumeratePhysicalDevices gave %s (%d)",
                 result_name(result), result);
        goto done;
    }
    if (count == 0) {
        snprintf(out_error, error_size, "no Vulkan device: the loader found a driver, the driver no device");
        goto done;
    }
    snprintf(out_error, error_size, "no device with ray tracing (Vulkan 1.2 with acceleration structures and "
                                    "ray queries or ray tracing pipelines); seen:");
    for (uint32_t i = 0; i < count && !found; i++) {
        struct candidate candidate = {.physical = physicals[i]};
        candidate_examine(&candidate);
        if (!candidate.lacks[0]) {
            candidate_examine_features(&candidate);
        }
        append(out_error, error_size, "%s %s (%s)", i ? "," : "", candidate.properties.deviceName,
               candidate.lacks[0] ? candidate.lacks : "will do");
        if (!candidate.lacks[0]) {
            found = index < 0 || able == index;
            able++;
            *out_chosen = candidate;
        }
    }
    if (!found && able > 0) {
        char seen[512];
        const char *names = strstr(out_error, "seen:");
        snprintf(seen, sizeof seen, "%s", names ? names : "");
        snprintf(out_error, error_size, "no device number %d: %d device%s with ray tracing, counted from 0; %s",
                 index, able, able == 1 ? "" : "s", seen);
    }
done:
    free(physicals);
    return found;
}

static void info_fill(struct gn_device *device, const struct candidate *candidate, const struct features *features)
{
    struct gn_device_info *info = &device->info;
    VkPhysicalDeviceMaintenance3Properties maintenance3 = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_3_PROPERTIES,
    };
    VkPhysicalDeviceIDProperties ids = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ID_PROPERTIES,
        .pNext = &maintenance3,
    };
    VkPhysicalDeviceDriverProperties driver = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DRIVER_PROPERTIES,
        .pNext = &ids,
    };
    VkPhysicalDeviceAccelerationStructurePropertiesKHR limits = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_PROPERTIES_KHR,
        .pNext = &driver,
    };
    VkPhysicalDeviceRayTracingPipelinePropertiesKHR pipeline_limits = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_PROPERTIES_KHR,
        .pNext = &limits,
    };
    VkPhysicalDeviceProperties2 properties = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2,
        .pNext = candidate->pipeline ? (void *)&pipeline_limits : (void *)&limits,
    };
    vkGetPhysicalDeviceProperties2(device->physical, &properties);
    vkGetPhysicalDeviceMemoryProperties(device->physical, &device->memory);
    device->max_allocation = maintenance3.maxMemoryAllocationSize;

    snprintf(info->name, sizeof info->name, "%s", properties.properties.deviceName);
    snprintf(info->driver_name, sizeof info->driver_name, "%s", driver.driverName);
    snprintf(info->driver_info, sizeof info->driver_info, "%s", driver.driverInfo);
    info->vendor_id = properties.properties.vendorID;
    info->device_id = properties.properties.deviceID;
    info->driver_version = properties.properties.driverVersion;
    info->api_version = properties.properties.apiVersion;
    memcpy(info->device_uuid, ids.deviceUUID, VK_UUID_SIZE);
    memcpy(info->driver_uuid, ids.driverUUID, VK_UUID_SIZE);
    info->ray_query = features->query.rayQuery;
    info->ray_tracing_pipeline = features->pipeline.rayTracingPipeline;
    info->primitive_culling = features->pipeline.rayTraversalPrimitiveCulling;
    info->trace_indirect = features->pipeline.rayTracingPipelineTraceRaysIndirect;
    info->trace_indirect2 = features->maintenance1.rayTracingPipelineTraceRaysIndirect2;
    info->pipeline_library = info->ray_tracing_pipeline && candidate->pipeline_library;
    info->vertex_stores = features->core.features.vertexPipelineStoresAndAtomics;
    info->fragment_stores = features->core.features.fragmentStoresAndAtomics;
    info->maintenance1 = features->maintenance1.rayTracingMaintenance1;
    info->position_fetch = features->position_fetch.rayTracingPositionFetch;
    info->host_builds = features->structure.accelerationStructureHostCommands;
    info->indirect_builds = features->structure.accelerationStructureIndirectBuild;
    info->index_uint8 = features->index_uint8.indexTypeUint8;
    limits.pNext = NULL;
    info->limits = limits;
    pipeline_limits.pNext = NULL;
    info->pipeline_limits = pipeline_limits;
}

/* The first family that computes, better one that draws as well: acceleration structures are built there, too. */
static bool queue_family_find(struct gn_device *device)
{
    VkQueueFamilyProperties families[32];
    uint32_t count = sizeof families / sizeof families[0];
    vkGetPhysicalDeviceQueueFamilyProperties(device->physical, &count, families);
    static const VkQueueFlags wishes[] = {VK_QUEUE_COMPUTE_BIT | VK_QUEUE_GRAPHICS_BIT, VK_QUEUE_COMPUTE_BIT};
    for (size_t w = 0; w < sizeof wishes / sizeof wishes[0]; w++) {
        for (uint32_t i = 0; i < count; i++) {
            if ((families[i].queueFlags & wishes[w]) == wishes[w]) {
                device->queue_family = i;
                device->info.graphics = families[i].queueFlags & VK_QUEUE_GRAPHICS_BIT;
                return true;
            }
        }
    }
    return false;
}

static VkResult device_open(struct gn_device *device, const struct candidate *candidate)
{
    struct features has, wanted;
    features_query(candidate, &has);
    info_fill(device, candidate, &has);

    /* What is asked for is what is used, so that a case cannot rest on something that was left on by chance. */
    const struct gn_device_info *has_info = &device->info;
    features_chain(candidate, &wanted);
    wanted.core.features.vertexPipelineStoresAndAtomics = has_info->vertex_stores;
    wanted.core.features.fragmentStoresAndAtomics = has_info->fragment_stores;
    wanted.address.bufferDeviceAddress = VK_TRUE;
    wanted.structure.accelerationStructure = VK_TRUE;
    wanted.structure.accelerationStructureIndirectBuild = has_info->indirect_builds;
    wanted.structure.accelerationStructureHostCommands = has_info->host_builds;
    wanted.query.rayQuery = has_info->ray_query;
    wanted.pipeline.rayTracingPipeline = has_info->ray_tracing_pipeline;
    wanted.pipeline.rayTraversalPrimitiveCulling = has_info->primitive_culling;
    wanted.pipeline.rayTracingPipelineTraceRaysIndirect = has_info->trace_indirect;
    wanted.maintenance1.rayTracingMaintenance1 = has_info->maintenance1;
    wanted.maintenance1.rayTracingPipelineTraceRaysIndirect2 = has_info->trace_indirect2;
    wanted.position_fetch.rayTracingPositionFetch = has_info->position_fetch;

    const struct {
        bool known;
        const char *name;
    } extensions[] = {
        {true, VK_KHR_ACCELERATION_STRUCTURE_EXTENSION_NAME},
        {true, VK_KHR_DEFERRED_HOST_OPERATIONS_EXTENSION_NAME},
        {candidate->query, VK_KHR_RAY_QUERY_EXTENSION_NAME},
        {candidate->pipeline, VK_KHR_RAY_TRACING_PIPELINE_EXTENSION_NAME},
        {candidate->pipeline_library, VK_KHR_PIPELINE_LIBRARY_EXTENSION_NAME},
        {candidate->maintenance1, VK_KHR_RAY_TRACING_MAINTENANCE_1_EXTENSION_NAME},
        {candidate->position_fetch, VK_KHR_RAY_TRACING_POSITION_FETCH_EXTENSION_NAME},
        {candidate->index_uint8_khr, VK_KHR_INDEX_TYPE_UINT8_EXTENSION_NAME},
        {candidate->index_uint8_ext && !candidate->index_uint8_khr, VK_EXT_INDEX_TYPE_UINT8_EXTENSION_NAME},
    };
    const char *names[sizeof extensions / sizeof extensions[0]];
    uint32_t name_count = 0;
    for (size_t i = 0; i < sizeof extensions / sizeof extensions[0]; i++) {
        if (extensions[i].known) {
            names[name_count++] = extensions[i].name;
        }
    }
    const float priority = 1.0f;
    const VkDeviceQueueCreateInfo queue_info = {
        .sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
        .queueFamilyIndex = device->queue_family,
        .queueCount = 1,
        .pQueuePriorities = &priority,
    };
    const VkDeviceCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
        .pNext = &wanted.core,
        .queueCreateInfoCount = 1,
        .pQueueCreateInfos = &queue_info,
        .enabledExtensionCount = name_count,
        .ppEnabledExtensionNames = names,
    };
    VkResult result = vkCreateDevice(device->physical, &info, NULL, &device->handle);
    if (result != VK_SUCCESS) {
        return result;
    }
#define X(name) device->name = (PFN_vk##name)vkGetDeviceProcAddr(device->handle, "vk" #name);
    GN_DEVICE_COMMANDS(X)
    GN_PIPELINE_COMMANDS(X)
    GN_INDIRECT_COMMANDS(X)
    GN_HOST_COMMANDS(X)
#undef X
#define X(name) \
    if (!device->name) { \
        return VK_ERROR_INITIALIZATION_FAILED; \
    }
    GN_DEVICE_COMMANDS(X)
    if (device->info.ray_tracing_pipeline) {
        GN_PIPELINE_COMMANDS(X)
    }
    if (device->info.indirect_builds) {
        GN_INDIRECT_COMMANDS(X)
    }
    if (device->info.host_builds) {
        GN_HOST_COMMANDS(X)
    }
#undef X
    device->CmdTraceRaysIndirect2KHR =
        (PFN_vkCmdTraceRaysIndirect2KHR)vkGetDeviceProcAddr(device->handle, "vkCmdTraceRaysIndirect2KHR");
    vkGetDeviceQueue(device->handle, device->queue_family, 0, &device->queue);

    const VkCommandPoolCreateInfo pool_info = {
        .sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
        .flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT,
        .queueFamilyIndex = device->queue_family,
    };
    result = vkCreateCommandPool(device->handle, &pool_info, NULL, &device->command_pool);
    if (result != VK_SUCCESS) {
        return result;
    }
    const VkCommandBufferAllocateInfo buffer_info = {
        .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
        .commandPool = device->command_pool,
        .level = VK_COMMAND_BUFFER_LEVEL_PRIMARY,
        .commandBufferCount = 1,
    };
    result = vkAllocateCommandBuffers(device->handle, &buffer_info, &device->commands);
    if (result != VK_SUCCESS) {
        return result;
    }
    const VkFenceCreateInfo fence_info = {.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    return vkCreateFence(device->handle, &fence_info, NULL, &device->fence);
}

struct gn_device *gn_device_create(const struct gn_device_options *options, char *out_error, size_t error_size)
{
    const char *const variable = "VK_DRIVER_FILES";
    const char *icd = options ? options->icd : NULL;
    char *before = NULL;
    struct candidate chosen;
    struct gn_device *device = calloc(1, sizeof *device);
    if (!device) {
        snprintf(out_error, error_size, "no memory for a device");
        return NULL;
    }
    device->trace.pool.kind = GN_MEMORY_HOST;
    if (icd) {
        if (!icd_check(icd, out_error, error_size)) {
            goto fail;
        }
        /* The loader reads it when the instance is made. It comes back as it was: other devices may follow. */
        const char *value = getenv(variable);
        before = value ? strdup(value) : NULL;
        setenv(variable, icd, 1);
    }
    VkResult result = instance_create(device);
    /* The drivers are not listed before this call by every loader, so the variable stays until after it. */
    bool found = false;
    if (result == VK_SUCCESS) {
        found = physical_choose(device, options ? options->index : -1, &chosen, out_error, error_size);
    }
    if (icd) {
        if (before) {
            setenv(variable, before, 1);
        } else {
            unsetenv(variable);
        }
    }
    if (result != VK_SUCCESS) {
        snprintf(out_error, error_size, "%s%s: vkCreateInstance gave %s (%d)",
                 icd ? "the Vulkan loader cannot use the driver of " : "the Vulkan loader found no driver that it can use",
                 icd ? icd : "", result_name(result), result);
        goto fail;
    }
    if (!found) {
        goto fail;
    }
    device->physical = chosen.physical;
    if (!queue_family_find(device)) {
        snprintf(out_error, error_size, "%s has no queue that computes", chosen.properties.deviceName);
        goto fail;
    }
    result = device_open(device, &chosen);
    if (result != VK_SUCCESS) {
        snprintf(out_error, error_size, "%s could not be opened: %s (%d)", chosen.properties.deviceName,
                 result_name(result), result);
        goto fail;
    }
    if (error_size) {
        out_error[0] = '\0';
    }
    free(before);
    return device;

fail:
    free(before);
    gn_device_destroy(device);
    return NULL;
}

void gn_device_destroy(struct gn_device *device)
{
    if (!device) {
        return;
    }
    /* A lost or hanging device might never come back from these calls; the process is about to end. */
    if (!device->lost) {
        if (device->handle) {
            gn_trace_finish(device);
            vkDestroyFence(device->handle, device->fence, NULL);
            vkDestroyCommandPool(device->handle, device->command_pool, NULL);
            vkDestroyDevice(device->handle, NULL);
        }
        if (device->messenger) {
            PFN_vkDestroyDebugUtilsMessengerEXT destroy =
                (PFN_vkDestroyDebugUtilsMessengerEXT)vkGetInstanceProcAddr(device->instance,
                                                                           "vkDestroyDebugUtilsMessengerEXT");
            destroy(device->instance, device->messenger, NULL);
        }
        if (device->instance) {
            vkDestroyInstance(device->instance, NULL);
        }
        free(device);
    }
}

bool gn_device_has_vertex_format(struct gn_device *device, VkFormat format)
{
    VkFormatProperties properties;
    vkGetPhysicalDeviceFormatProperties(
        device->physical, format == VK_FORMAT_UNDEFINED ? VK_FORMAT_R32G32B32_SFLOAT : format, &properties);
    return properties.bufferFeatures & VK_FORMAT_FEATURE_ACCELERATION_STRUCTURE_VERTEX_BUFFER_BIT_KHR;
}

/* Commands */

enum gn_device_status gn_device_begin(struct gn_device *device)
{
    if (device->lost) {
        return gn_device_fail(device, GN_DEVICE_LOST, "the device was lost before");
    }
    const VkCommandBufferBeginInfo info = {
        .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO,
        .flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT,
    };
    /* A failure may have left it half recorded. */
    enum gn_device_status status =
        gn_device_check(device, vkResetCommandBuffer(device->commands, 0), "vkResetCommandBuffer");
    if (status == GN_DEVICE_OK) {
        status = gn_device_check(device, vkBeginCommandBuffer(device->commands, &info), "vkBeginCommandBuffer");
    }
    return status;
}

static void barrier(struct gn_device *device, VkPipelineStageFlags to_stages, VkAccessFlags to_access)
{
    const VkMemoryBarrier memory = {
        .sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
        .srcAccessMask = VK_ACCESS_MEMORY_WRITE_BIT,
        .dstAccessMask = to_access,
    };
    vkCmdPipelineBarrier(device->commands, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, to_stages, 0, 1, &memory, 0, NULL, 0,
                         NULL);
}

void gn_device_barrier(struct gn_device *device)
{
    barrier(device, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, VK_ACCESS_MEMORY_READ_BIT | VK_ACCESS_MEMORY_WRITE_BIT);
}

enum gn_device_status gn_device_submit(struct gn_device *device)
{
    barrier(device, VK_PIPELINE_STAGE_HOST_BIT, VK_ACCESS_HOST_READ_BIT | VK_ACCESS_HOST_WRITE_BIT);
    enum gn_device_status status =
        gn_device_check(device, vkEndCommandBuffer(device->commands), "vkEndCommandBuffer");
    if (status != GN_DEVICE_OK) {
        return status;
    }
    const VkSubmitInfo info = {
        .sType = VK_STRUCTURE_TYPE_SUBMIT_INFO,
        .commandBufferCount = 1,
        .pCommandBuffers = &device->commands,
    };
    status = gn_device_check(device, vkQueueSubmit(device->queue, 1, &info, device->fence), "vkQueueSubmit");
    if (status != GN_DEVICE_OK) {
        return status;
    }
    const VkResult result = vkWaitForFences(device->handle, 1, &device->fence, VK_TRUE, SUBMIT_TIMEOUT_NS);
    if (result == VK_TIMEOUT) {
        return gn_device_fail(device, GN_DEVICE_LOST, "a submission was not done after %llu seconds",
                              SUBMIT_TIMEOUT_NS / 1000000000ull);
    }
    if ((status = gn_device_check(device, result, "vkWaitForFences")) != GN_DEVICE_OK) {
        return status;
    }
    return gn_device_check(device, vkResetFences(device->handle, 1, &device->fence), "vkResetFences");
}
