/* SPDX-License-Identifier: Apache-2.0 */
/* Shaders that ask ray queries, in every stage and brought to the driver in every way, for the layer's tests. */
#ifndef GN_TESTS_LAYER_ASK_H
#define GN_TESTS_LAYER_ASK_H

#include "tests/layer/harness.h"

#define ASK_LANES 8u  /* invocations of a dispatch or trace */
#define ASK_SIZE 16u  /* the picture's side */

enum ask_stage { ASK_COMPUTE, ASK_VERTEX, ASK_FRAGMENT, ASK_RAYGEN, ASK_LONG, ASK_MANY, ASK_POSITIONS /* compute */ };

#define ASK_SCENES 4 /* in the array of ASK_MANY */

/* How the shader comes to the driver. */
enum ask_way { ASK_BY_MODULE, ASK_INLINE, ASK_BY_LIBRARY, ASK_BY_OBJECT };

struct asker {
    enum ask_stage stage;
    enum ask_way way;
    VkDescriptorSetLayout layout;
    VkPipelineLayout pipeline_layout;
    VkShaderModule module; /* of ASK_BY_MODULE */
    VkPipeline libraries[2];
    VkPipeline pipeline;
    VkShaderEXT object;
    VkDescriptorPool pool;
    VkDescriptorSet set;
    struct buffer out;    /* ASK_LANES floats, or the picture */
    struct buffer table;  /* the SBT */
    VkImage image;
    VkImageView view;
    VkDeviceMemory memory;
    VkStridedDeviceAddressRegionKHR raygen;
};

/* A world with all that the ways and stages need. */
void ask_world_init(struct world *world, const struct world_options *options);
/* `flags` specializes the constant with which the compute shader first initializes a query. */
/* With a `tlas` of VK_NULL_HANDLE the descriptor is not written. */
struct asker asker_create(struct world *world, enum ask_stage stage, enum ask_way way, VkAccelerationStructureKHR tlas,
                          uint32_t flags);
void asker_destroy(struct world *world, struct asker *asker);
/* Writes a descriptor of the array, or of the only one; its handle may be VK_NULL_HANDLE. */
void asker_refer(struct world *world, struct asker *asker, uint32_t element, VkAccelerationStructureKHR tlas);
void asker_name(struct world *world, const struct asker *asker, const char *module, const char *pipeline);
/* What runs it once. */
VkCommandBuffer asker_record(struct world *world, struct asker *asker, uint32_t wrong);
/* Runs it once, to the end. */
void asker_run(struct world *world, struct asker *asker, uint32_t wrong);

#endif
