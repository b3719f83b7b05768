/* SPDX-License-Identifier: Apache-2.0 */
/* Which TLASes a trace, dispatch or draw may read: what descriptor sets hold (descriptor.c), what the shaders of a pipeline name
 * (module.c), and both together where a command is recorded and executed (use.c). */
#ifndef GN_LAYER_USE_H
#define GN_LAYER_USE_H

#include "layer/layer.h"

/* A descriptor that a shader traces rays through. */
struct gn_static_use {
    uint32_t set, binding;
    VkShaderStageFlags stages;
    bool always; /* every invocation of that stage traces through it */
    bool rays;   /* by OpTraceRay, with at least these operands */
    uint32_t ray_offset, ray_stride;
};

struct gn_static_uses {
    uint32_t references;
    uint32_t count;
    bool one_raygen; /* of a ray-tracing pipeline: which ray-generation shader runs is not a question */
    struct gn_static_use uses[];
};

void gn_static_uses_release(struct gn_static_uses *uses);

/* What was created, as the application described it; called by pipeline.c without any lock. */
void gn_uses_module_created(struct gn_device *device, VkShaderModule module, const VkShaderModuleCreateInfo *info);
void gn_uses_module_destroyed(struct gn_device *device, VkShaderModule module);
void gn_uses_compute_created(struct gn_device *device, uint32_t count, const VkComputePipelineCreateInfo *infos,
                             const VkPipeline *pipelines);
void gn_uses_graphics_created(struct gn_device *device, uint32_t count, const VkGraphicsPipelineCreateInfo *infos,
                              const VkPipeline *pipelines);
/* Not under a deferred operation: the pipelines are not there yet then, and nothing is known of them. */
void gn_uses_rays_created(struct gn_device *device, uint32_t count, const VkRayTracingPipelineCreateInfoKHR *infos,
                          const VkPipeline *pipelines);
void gn_uses_pipeline_destroyed(struct gn_device *device, VkPipeline pipeline);

/* The bindings of a layout that hold acceleration structures; a layout without any is not remembered. */
struct gn_as_binding {
    uint32_t binding, elements;
    bool partial; /* it may hold nothing */
    bool other;   /* it may hold something else: a mutable descriptor */
};
struct gn_set_layout {
    uint32_t references;
    bool mirrored; /* it has the binding of a mirror (mirror.c) */
    uint32_t count;
    struct gn_as_binding bindings[];
};

/* A set of such a layout, or what was pushed. Bindings of one element are followed, arrays are not. */
struct gn_set {
    VkDescriptorSet handle;
    VkDescriptorPool pool;
    uint32_t references;
    struct gn_set_layout *layout;
    struct gn_set *next; /* of the pool */
    struct gn_mirror *mirror;
    struct gn_as *slots[];
};
void gn_set_release(struct gn_set *set);
/* Whether every set of the layout that holds structures has a mirror, and there is one. Without any lock. */
bool gn_layout_mirrored(struct gn_device *device, VkPipelineLayout layout);
bool gn_set_layouts_mirrored(struct gn_device *device, uint32_t count, const VkDescriptorSetLayout *layouts);

/* Whether binding `index` of a layout can hold acceleration structures, as one of them or as a mutable descriptor. */
bool gn_binding_holds(const VkDescriptorSetLayoutCreateInfo *info, uint32_t index);

/* mirror.c. A layout with the binding of a mirror added; false if it has to stay as it is. To be finished in either case. */
struct gn_mirror_plan {
    VkDescriptorSetLayoutCreateInfo info;
    VkDescriptorSetLayoutBinding *bindings;
    VkDescriptorBindingFlags *flags;
    struct gn_chain_copy *chain;
};
bool gn_mirror_plan_make(struct gn_device *device, const VkDescriptorSetLayoutCreateInfo *info, struct gn_mirror_plan *plan);
void gn_mirror_plan_finish(struct gn_mirror_plan *plan);
/* Gives a new set its mirror, if it is to have one, and takes it from one that is freed. */
void gn_mirror_attach(struct gn_device *device, struct gn_set *set);
void gn_mirror_detach(struct gn_device *device, struct gn_set *set);
void gn_mirror_write(struct gn_set *set, uint32_t binding, uint32_t element, VkAccelerationStructureKHR handle, const struct gn_as *as);
/* Something else than a structure was written. */
void gn_mirror_clear(struct gn_set *set, uint32_t binding, uint32_t element);
void gn_mirror_copy(const struct gn_set *from, struct gn_set *to, const VkCopyDescriptorSet *copy);

enum { GN_BIND_GRAPHICS, GN_BIND_COMPUTE, GN_BIND_RAYS, GN_BIND_COUNT };
#define GN_MAX_SETS 32

/* What is bound while a command buffer is recorded. */
struct gn_bound {
    struct gn_static_uses *uses[GN_BIND_COUNT];
    struct gn_set *sets[GN_BIND_COUNT][GN_MAX_SETS];
    uint32_t in_buffers[GN_BIND_COUNT]; /* one bit per set that is in a descriptor buffer */
    bool changed[GN_BIND_COUNT]; /* since the last use that was recorded */
};
/* NULL without memory. */
struct gn_bound *gn_bound_of(struct gn_device *device, struct gn_command_buffer *commands);
void gn_bound_free(struct gn_bound *bound);
/* The index of GN_BIND_*, GN_BIND_COUNT for any other. */
unsigned gn_bind_point(VkPipelineBindPoint point);

/* One recorded command that reads TLASes through descriptors. */
struct gn_use_entry {
    struct gn_set *set;
    uint32_t slot;
    VkShaderStageFlags stages;
    bool certain; /* if the command runs, some invocation traces through it */
    bool rays;
    uint32_t ray_offset, ray_stride;
};
struct gn_use {
    const char *command;
    uint32_t count, left_out; /* left out: arrays */
    bool in_buffers;          /* some are in descriptor buffers */
    struct gn_use_entry entries[];
};
void gn_use_free(struct gn_use *use);
/* Of a command that is about to be recorded, with the device locked. `runs`: at least one invocation does, for all that the command itself
 * says. NULL if the shaders trace through nothing that is followed. */
struct gn_use *gn_use_make(struct gn_device *device, const struct gn_command_buffer *commands, unsigned point, const char *command,
                           bool runs);

#endif
