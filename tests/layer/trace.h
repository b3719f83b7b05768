/* SPDX-License-Identifier: Apache-2.0 */
/* Compute shaders that trace a ray through TLASes in descriptors, for the layer's tests. */
#ifndef GN_TESTS_LAYER_TRACE_H
#define GN_TESTS_LAYER_TRACE_H

#include "tests/layer/harness.h"

enum trace_shader { TRACE_ALWAYS, TRACE_MAYBE, TRACE_ARRAY, TRACE_SHADERS };

/* How the TLAS gets into the descriptor; what lies in descriptor buffers is not followed. */
enum trace_way { TRACE_BY_WRITE, TRACE_BY_TEMPLATE, TRACE_BY_PUSH, TRACE_BY_PUSH_TEMPLATE, TRACE_BY_COPY, TRACE_BY_MUTABLE, TRACE_WAYS, TRACE_BY_BUFFER };

/* A pipeline and its descriptors. The ray hits the triangle of blas_create if the TLAS holds it. */
struct tracer {
    enum trace_way way;
    uint32_t elements;
    VkDescriptorSetLayout layout;
    VkPipelineLayout pipeline_layout;
    VkPipeline pipeline;
    VkDescriptorPool pool;
    VkDescriptorSet set, other;
    VkDescriptorUpdateTemplate update;
    struct buffer descriptors; /* of TRACE_BY_BUFFER */
    struct buffer hits; /* [0] counts, [1] tells TRACE_MAYBE to trace */
};

/* A world with what every way needs. */
void trace_world_init(struct world *world, bool creation_messenger);
struct tracer tracer_create(struct world *world, enum trace_shader shader, enum trace_way way);
void tracer_destroy(struct world *world, struct tracer *tracer);
/* Not for the ways that push. */
void tracer_refer(struct world *world, struct tracer *tracer, VkAccelerationStructureKHR tlas);
/* Of TRACE_BY_BUFFER: the same with an address. */
void tracer_describe(struct world *world, struct tracer *tracer, VkDeviceAddress tlas);
/* Of TRACE_BY_MUTABLE: writes something else than a TLAS. */
void tracer_refer_other(struct world *world, struct tracer *tracer);
/* Binds all and dispatches; the TLAS is for the ways that push. */
void commands_trace(struct world *world, VkCommandBuffer commands, struct tracer *tracer, VkAccelerationStructureKHR tlas,
                    uint32_t groups);

#endif
