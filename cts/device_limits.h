/* SPDX-License-Identifier: Apache-2.0 */
/* What a device says of itself about ray tracing, as it says it, and the sizes that it asks for. */
#ifndef GNOMON_CTS_DEVICE_LIMITS_H
#define GNOMON_CTS_DEVICE_LIMITS_H

#include "cts/device.h"

/* Features and properties of extensions that the device does not have are zero. */
struct gn_device_facts {
    bool acceleration_structure, deferred_host_operations, ray_query, ray_tracing_pipeline, pipeline_library,
        maintenance1, position_fetch;
    bool spirv_1_4; /* Vulkan 1.2, or both extensions that bring it */
    VkBool32 descriptor_indexing; /* the feature of Vulkan 1.2 */
    VkPhysicalDeviceBufferDeviceAddressFeatures address;
    VkPhysicalDeviceAccelerationStructureFeaturesKHR structure;
    VkPhysicalDeviceRayQueryFeaturesKHR query;
    VkPhysicalDeviceRayTracingPipelineFeaturesKHR pipeline;
    VkPhysicalDeviceRayTracingMaintenance1FeaturesKHR maintenance1_features;
    VkPhysicalDeviceRayTracingPositionFetchFeaturesKHR position_fetch_features;
    VkPhysicalDeviceAccelerationStructurePropertiesKHR structure_limits;
    VkPhysicalDeviceRayTracingPipelinePropertiesKHR pipeline_limits;
};
enum gn_device_status gn_device_facts_query(struct gn_device *device, struct gn_device_facts *out_facts);

/* The sizes for one geometry of that type with `count` primitives. Garbage stands where the specification says that
 * it is ignored, if asked for. */
struct gn_size_request {
    VkGeometryTypeKHR type; /* INSTANCES: a top level structure */
    VkBuildAccelerationStructureFlagsKHR flags;
    VkIndexType index_type;
    uint32_t geometry_count; /* 1, or for triangles and AABBs any number; all alike */
    uint32_t count;
    bool garbage;
};
VkAccelerationStructureBuildSizesInfoKHR gn_device_sizes(struct gn_device *device,
                                                         const struct gn_size_request *request);

#endif
