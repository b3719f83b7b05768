/* SPDX-License-Identifier: Apache-2.0 */
/* Ray-tracing pipelines with the handles of their groups, and the shader binding tables that traces are given. */
#ifndef GN_LAYER_SBT_H
#define GN_LAYER_SBT_H

#include "layer/layer.h"
#include "layer/use.h"

/* What a group is: in which part of a table its handle belongs. */
enum gn_group_kind { GN_GROUP_RAYGEN, GN_GROUP_MISS, GN_GROUP_TRIANGLES, GN_GROUP_PROCEDURAL, GN_GROUP_CALLABLE, GN_GROUP_UNKNOWN };

/* A ray-tracing pipeline. Lives on after its destruction while recordings refer to it, and for a while longer. */
struct gn_rays {
    uint64_t id;
    VkPipeline handle;
    uint32_t references;
    bool destroyed;
    bool handles_known;
    VkPipelineCreateFlags2 flags;
    struct gn_map groups;     /* hash of a handle -> index of the first such group + 1 */
    struct gn_rays *next;     /* of those alive */
    uint32_t handle_size, group_count;
    unsigned char *handles;   /* one after the other */
    unsigned char kinds[];    /* enum gn_group_kind */
};

#define GN_SBT_MAX_TLAS 4

/* The table of one recorded trace, and where its copy lies in the capture. */
struct gn_sbt_capture {
    const char *command;
    struct gn_rays *rays;
    bool runs;
    bool indirect; /* the regions are what is copied, not the records */
    uint64_t buffers_gone; /* of the device, when it was executed */
    struct gn_sbt_region regions[GN_SBT_PARTS];
    VkDeviceSize offsets[GN_SBT_PARTS];
    struct gn_use *use; /* what its shaders trace through; NULL: not known */
    /* The TLASes in those descriptors when it was executed last, and what each held. */
    struct gn_as *tlas[GN_SBT_MAX_TLAS];
    uint64_t versions[GN_SBT_MAX_TLAS];
    uint32_t ray_offsets[GN_SBT_MAX_TLAS], ray_strides[GN_SBT_MAX_TLAS]; /* the least that rays through it add */
    uint32_t tlas_count;
};

/* Called by pipeline.c, without any lock; not for deferred operations that have not ended. */
void gn_rays_created(struct gn_device *device, uint32_t count, const VkRayTracingPipelineCreateInfoKHR *infos,
                     const VkPipeline *pipelines);
VkPipelineCreateFlags2 gn_rays_flags(const VkRayTracingPipelineCreateInfoKHR *info);
void gn_rays_destroyed(struct gn_device *device, VkPipeline pipeline);
void gn_rays_bound(struct gn_device *device, VkCommandBuffer commands, VkPipelineBindPoint point, VkPipeline pipeline);
/* With the device locked. */
void gn_rays_release(struct gn_rays *rays);
void gn_rays_finish(struct gn_device *device);

/* Records what is needed to judge the table of a trace; called before the trace is. `invocations` is UINT64_MAX where the device decides. */
void gn_sbt_trace(struct gn_device *device, VkCommandBuffer handle, const VkStridedDeviceAddressRegionKHR *const parts[GN_SBT_PARTS],
                  const char *command, uint64_t invocations);
/* The same of vkCmdTraceRaysIndirect2KHR, whose regions lie in memory. */
void gn_sbt_trace_indirect(struct gn_device *device, VkCommandBuffer handle, VkDeviceAddress address);
/* The records of a region that hold a whole handle. */
struct gn_sbt_region gn_sbt_region_of(enum gn_sbt_part part, const VkStridedDeviceAddressRegionKHR *region, uint32_t handle_size);
/* With the device locked: what the trace reads when it is executed; and the judgement once it has completed. */
void gn_sbt_executed(struct gn_device *device, struct gn_sbt_capture *sbt);
void gn_sbt_judge(struct gn_device *device, const struct gn_capture *capture, const char *place, struct gn_findings *out);
void gn_sbt_capture_free(struct gn_sbt_capture *sbt);

#endif
