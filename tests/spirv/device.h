/* SPDX-License-Identifier: Apache-2.0 */
/* Runs test shaders on a real driver, as what their stages make: a compute, graphics, mesh or ray-tracing pipeline. The scene is
 * one triangle (t = 1 on the test's ray) in instance 0 and one box (t from 2 to 3) in instance 1. Instrumented modules find
 * their records in set 1, at the binding of their place among the stages, or through a table. Every function that cannot
 * do its work fails the test. */
#ifndef GN_TESTS_SPIRV_DEVICE_H
#define GN_TESTS_SPIRV_DEVICE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <vulkan/vulkan.h>

#define LANES 8 /* invocations of one run */
#define RECORD_SET 1
#define MAX_STAGES 8

struct tracer;

/* What the shader is told, see shaders/query.glsl. */
struct choices {
    uint32_t choice;
    float value;
    uint32_t lane;
};

struct stage {
    VkShaderStageFlagBits stage;
    const uint32_t *words;
    size_t word_count;
    uint32_t *records; /* given to the shader and read back; NULL for a module that writes none */
    size_t record_words;
    uint64_t key;      /* its key in the table of buffers, or 0 when it finds the records in set 1 */
};

/* A pipeline, and what its shaders look for. */
struct program {
    struct stage stages[MAX_STAGES];
    uint32_t stage_count;
    uint32_t callables; /* what the shaders are told of the callable shader binding table; it has twice the records, so that those
                           beyond can be called without harm */
    uint32_t recursion; /* maxPipelineRayRecursionDepth */
    uint32_t structures; /* what the table of structures says of the scene, and of what is not known; see tracer_structures() */
    VkPipeline pipeline; /* of the tracer; made by the first run, gone with tracer_forget() */
};

struct tracer *tracer_create(void);
void tracer_destroy(struct tracer *tracer);
/* The address of the table of record buffers. */
uint64_t tracer_root(const struct tracer *tracer);
/* The address of the table of structures. It has two lists: at its word GN_STRUCTURES (a structure's word then has 0x100000) one in which the
 * triangle's BLAS does not let its vertices be read, and two words further (0x100020) one in which the box's does not. */
uint64_t tracer_structures(const struct tracer *tracer);
/* Whether the driver has what such a stage needs. */
bool tracer_supports(const struct tracer *tracer, VkShaderStageFlagBits stage);
/* One workgroup, LANES pixels, vertices or rays. */
void tracer_run(struct tracer *tracer, struct program *program, const struct choices *choices, float out[LANES]);
void tracer_forget(struct tracer *tracer, struct program *program);

#endif
