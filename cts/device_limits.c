/* SPDX-License-Identifier: Apache-2.0 */
/* What a device says of itself about ray tracing. */
#include "cts/device_limits.h"

#include <stdlib.h>
#include <string.h>

#include "cts/device_internal.h"

/* Puts the structure at the head of the chain. */
static void chain(void **head, void *structure, VkStructureType type)
{
    VkBaseOutStructure *link = structure;
    link->sType = type;
    link->pNext = *head;
    *head = link;
}

enum gn_device_status gn_device_facts_query(struct gn_device *device, struct gn_device_facts *out_facts)
{
    struct gn_device_facts *facts = out_facts;
    memset(facts, 0, sizeof *facts);
    const struct {
        const char *name;
        bool *flag;
    } extensions[] = {
        {VK_KHR_ACCELERATION_STRUCTURE_EXTENSION_NAME, &facts->acceleration_structure},
        {VK_KHR_DEFERRED_HOST_OPERATIONS_EXTENSION_NAME, &facts->deferred_host_operations},
        {VK_KHR_RAY_QUERY_EXTENSION_NAME, &facts->ray_query},
        {VK_KHR_RAY_TRACING_PIPELINE_EXTENSION_NAME, &facts->ray_tracing_pipeline},
        {VK_KHR_PIPELINE_LIBRARY_EXTENSION_NAME, &facts->pipeline_library},
        {VK_KHR_RAY_TRACING_MAINTENANCE_1_EXTENSION_NAME, &facts->maintenance1},
        {VK_KHR_RAY_TRACING_POSITION_FETCH_EXTENSION_NAME, &facts->position_fetch},
    };
    uint32_t count = 0;
    VkExtensionProperties *list = NULL;
    VkResult result = vkEnumerateDeviceExtensionProperties(device->physical, NULL, &count, NULL);
    if (result == VK_SUCCESS) {
        list = calloc(count + 1, sizeof *list);
        result = list ? vkEnumerateDeviceExtensionProperties(device->physical, NULL, &count, list)
                      : VK_ERROR_OUT_OF_HOST_MEMORY;
    }
    for (uint32_t i = 0; i < count && result == VK_SUCCESS; i++) {
        for (size_t e = 0; e < sizeof extensions / sizeof extensions[0]; e++) {
            *extensions[e].flag |= strcmp(list[i].extensionName, extensions[e].name) == 0;
        }
    }
    free(list);
    if (result != VK_SUCCESS) {
        return gn_device_check(device, result, "vkEnumerateDeviceExtensionProperties");
    }
    facts->spirv_1_4 = device->info.api_version >= VK_API_VERSION_1_2;

    VkPhysicalDeviceVulkan12Features core12 = {0};
    VkPhysicalDeviceFeatures2 features = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2};
    /* The structure of Vulkan 1.2 has buffer device addresses too, so they are copied from there. */
    chain(&features.pNext, &core12, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES);
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2};
    if (facts->acceleration_structure) {
        chain(&features.pNext, &facts->structure, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_FEATURES_KHR);
        chain(&properties.pNext, &facts->structure_limits,
              VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_PROPERTIES_KHR);
    }
    if (facts->ray_query) {
        chain(&features.pNext, &facts->query, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_QUERY_FEATURES_KHR);
    }
    if (facts->ray_tracing_pipeline) {
        chain(&features.pNext, &facts->pipeline, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_FEATURES_KHR);
        chain(&properties.pNext, &facts->pipeline_limits,
              VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_PROPERTIES_KHR);
    }
    if (facts->maintenance1) {
        chain(&features.pNext, &facts->maintenance1_features,
              VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_MAINTENANCE_1_FEATURES_KHR);
    }
    if (facts->position_fetch) {
        chain(&features.pNext, &facts->position_fetch_features,
              VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_POSITION_FETCH_FEATURES_KHR);
    }
    vkGetPhysicalDeviceFeatures2(device->physical, &features);
    vkGetPhysicalDeviceProperties2(device->physical, &properties);
    facts->address.bufferDeviceAddress = core12.bufferDeviceAddress;
    facts->descriptor_indexing = core12.descriptorIndexing;
    return GN_DEVICE_OK;
}

VkAccelerationStructureBuildSizesInfoKHR gn_device_sizes(struct gn_device *device,
                                                         const struct gn_size_request *request)
{
    enum { MOST_GEOMETRIES = 64 };
    VkAccelerationStructureGeometryKHR geometries[MOST_GEOMETRIES];
    uint32_t counts[MOST_GEOMETRIES];
    const uint32_t geometry_count = request->geometry_count < MOST_GEOMETRIES ? request->geometry_count : MOST_GEOMETRIES;
    const VkDeviceAddress address = request->garbage ? 0xBADADD5E55000000ull : 0;
    for (uint32_t g = 0; g < geometry_count; g++) {
        counts[g] = request->count;
        geometries[g] = (VkAccelerationStructureGeometryKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
            .geometryType = request->type,
        };
        switch (request->type) {
        case VK_GEOMETRY_TYPE_TRIANGLES_KHR:
            geometries[g].geometry.triangles = (VkAccelerationStructureGeometryTrianglesDataKHR){
                .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
                .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
                .vertexData.deviceAddress = address,
                .vertexStride = 12,
                .maxVertex = request->count ? 3 * request->count - 1 : 0,
                .indexType = request->index_type,
                .indexData.deviceAddress = request->index_type == VK_INDEX_TYPE_NONE_KHR ? 0 : address,
            };
            break;
        case VK_GEOMETRY_TYPE_AABBS_KHR:
            geometries[g].geometry.aabbs = (VkAccelerationStructureGeometryAabbsDataKHR){
                .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR,
                .data.deviceAddress = address,
                .stride = 24,
            };
            break;
        default:
            geometries[g].geometry.instances = (VkAccelerationStructureGeometryInstancesDataKHR){
                .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
                .data.deviceAddress = address,
            };
        }
    }
    const VkAccelerationStructureBuildGeometryInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = request->type == VK_GEOMETRY_TYPE_INSTANCES_KHR ? VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR
                                                                : VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
        .flags = request->flags,
        .mode = request->garbage && request->flags & VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR
                    ? VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR
                    : VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
        .geometryCount = geometry_count,
        .pGeometries = geometries,
        .scratchData.deviceAddress = address,
    };
    VkAccelerationStructureBuildSizesInfoKHR sizes = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR,
    };
    device->GetAccelerationStructureBuildSizesKHR(device->handle, VK_ACCELERATION_STRUCTURE_BUILD_TYPE_DEVICE_KHR,
                                                  &info, counts, &sizes);
    return sizes;
}
