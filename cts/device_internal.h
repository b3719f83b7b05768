/* SPDX-License-Identifier: Apache-2.0 */
/* What the files of the Vulkan harness share. Nothing outside cts/device*.c includes it, but for its tests. */
#ifndef GNOMON_CTS_DEVICE_INTERNAL_H
#define GNOMON_CTS_DEVICE_INTERNAL_H

#include "cts/device.h"

/* Commands of extensions: fetched from the device, because the loader exports the core's only. */
#define GN_DEVICE_COMMANDS(X) \
    X(CreateAccelerationStructureKHR) \
    X(DestroyAccelerationStructureKHR) \
    X(GetAccelerationStructureBuildSizesKHR) \
    X(GetAccelerationStructureDeviceAddressKHR) \
    X(GetDeviceAccelerationStructureCompatibilityKHR) \
    X(CmdBuildAccelerationStructuresKHR) \
    X(CmdCopyAccelerationStructureKHR) \
    X(CmdCopyAccelerationStructureToMemoryKHR) \
    X(CmdCopyMemoryToAccelerationStructureKHR) \
    X(CmdWriteAccelerationStructuresPropertiesKHR) \
    X(CreateDeferredOperationKHR) \
    X(DestroyDeferredOperationKHR) \
    X(GetDeferredOperationMaxConcurrencyKHR) \
    X(GetDeferredOperationResultKHR) \
    X(DeferredOperationJoinKHR)

/* Of devices that build indirectly or on the host. */
#define GN_INDIRECT_COMMANDS(X) X(CmdBuildAccelerationStructuresIndirectKHR)
#define GN_HOST_COMMANDS(X) \
    X(BuildAccelerationStructuresKHR) \
    X(CopyAccelerationStructureKHR) \
    X(CopyAccelerationStructureToMemoryKHR) \
    X(CopyMemoryToAccelerationStructureKHR) \
    X(WriteAccelerationStructuresPropertiesKHR)

/* Of devices with ray tracing pipelines. */
#define GN_PIPELINE_COMMANDS(X) \
    X(CreateRayTracingPipelinesKHR) \
    X(GetRayTracingShaderGroupHandlesKHR) \
    X(GetRayTracingShaderGroupStackSizeKHR) \
    X(CmdTraceRaysKHR) \
    X(CmdTraceRaysIndirectKHR) \
    X(CmdSetRayTracingPipelineStackSizeKHR)

/* Memory */

enum gn_memory_kind {
    GN_MEMORY_INPUT, /* build inputs; the host writes them */
    GN_MEMORY_STRUCTURE, /* acceleration structures; on the device */
    GN_MEMORY_HOST_STRUCTURE, /* acceleration structures that host commands work on */
    GN_MEMORY_SCRATCH, /* on the device */
    GN_MEMORY_HOST, /* serialized structures, rays, answers; the host reads and writes them */
    GN_MEMORY_TABLE, /* shader binding tables and what traces are told indirectly; the host writes them */
    GN_MEMORY_KIND_COUNT
};

/* A piece of a pool. */
struct gn_memory {
    VkBuffer buffer;
    VkDeviceSize offset; /* in the buffer */
    VkDeviceSize size;
    VkDeviceAddress address;
    uint8_t *mapped; /* NULL where the host cannot see it */
};

struct gn_memory_chunk;

/* Pieces are taken one after another out of few large buffers; they come back all at once. */
struct gn_pool {
    enum gn_memory_kind kind;
    struct gn_memory_chunk *last;
    VkDeviceSize bytes; /* handed out */
};

/* `alignment` is a power of two; it holds for the device address (of structures: for the offset). */
enum gn_device_status gn_pool_take(struct gn_device *device, struct gn_pool *pool, VkDeviceSize size,
                                   VkDeviceSize alignment, struct gn_memory *out_memory);
/* Overwrites everything handed out of a pool that the host sees. */
void gn_pool_poison(struct gn_pool *pool);
void gn_pool_finish(struct gn_device *device, struct gn_pool *pool);

/* The device */

struct gn_program {
    VkShaderModule module;
    VkPipeline pipeline;
};

/* Compute shaders: those of the programs, and others that answer for the committed hit. */
enum { GN_KERNEL_PAIR = GN_CTS_PROGRAM_COUNT, GN_KERNEL_BY_ADDRESS, GN_KERNEL_COUNT };

struct gn_pipelines; /* of ray tracing; cts/device_pipeline.c */
struct gn_drawing; /* ray queries where something is drawn; cts/device_draw.c */

/* Buffers of rays and answers for one chunk; kept from trace to trace. */
struct gn_trace_buffers {
    struct gn_pool pool;
    struct gn_memory rays, committed, extra;
};

struct gn_device {
    VkInstance instance;
    VkPhysicalDevice physical;
    VkDevice handle;
    VkQueue queue;
    uint32_t queue_family;
    VkCommandPool command_pool;
    VkCommandBuffer commands;
    VkFence fence;
    VkPhysicalDeviceMemoryProperties memory;
    VkDeviceSize max_allocation;
    struct gn_device_info info;
    char message[1024];
    bool lost; /* or stuck: nothing is waited for or destroyed any more */

#define X(name) PFN_vk##name name;
    GN_DEVICE_COMMANDS(X)
    GN_PIPELINE_COMMANDS(X)
    GN_INDIRECT_COMMANDS(X)
    GN_HOST_COMMANDS(X)
#undef X
    PFN_vkCmdTraceRaysIndirect2KHR CmdTraceRaysIndirect2KHR; /* NULL without maintenance1 */

    VkDebugUtilsMessengerEXT messenger;
    uint64_t validation_count, validation_told; /* heard of; those that a status has told of */
    char validation_first[1024], validation_latest[1024];

    VkDescriptorSetLayout set_layout;
    VkDescriptorPool descriptor_pool;
    VkDescriptorSet descriptors;
    VkPipelineLayout pipeline_layout;
    struct gn_program programs[GN_KERNEL_COUNT];
    struct gn_trace_buffers trace;
    struct gn_pipelines *pipelines; /* NULL until they are needed */
    struct gn_drawing *drawing; /* likewise */
};

/* Keeps the message and gives the status back, for `return gn_device_fail(...)`. */
enum gn_device_status gn_device_fail(struct gn_device *device, enum gn_device_status status, const char *format,
                                     ...) __attribute__((format(printf, 3, 4)));

/*
 * What a VkResult means: a lost device is LOST; a lack of device memory is UNSUPPORTED, because the scene is
 * too large for this device; other errors are FAILED. `what` is the call.
 */
enum gn_device_status gn_device_check(struct gn_device *device, VkResult result, const char *what);

/* Begins the device's only command buffer. */
enum gn_device_status gn_device_begin(struct gn_device *device);
/* Everything before it is finished and visible to everything after it. */
void gn_device_barrier(struct gn_device *device);
/* Ends, submits and waits; what the device wrote is then visible to the host. */
enum gn_device_status gn_device_submit(struct gn_device *device);

double gn_seconds_now(void);

/*
 * FAILED with what a layer has said since the last call, or OK: so that a suite that runs above a layer shows
 * its messages as errors of the case that caused them.
 */
enum gn_device_status gn_device_layers_check(struct gn_device *device);

/*
 * Warnings and errors that layers (Khronos' validation, Gnomon's own) have reported on this device since it
 * was made, and the text of the first; "" when there was none.
 */
uint64_t gn_device_validation_count(const struct gn_device *device);
const char *gn_device_validation_first(const struct gn_device *device);

/* Acceleration structures (cts/device_structure.c) */

/* The memory pattern that structures and scratch are filled with. */
#define GN_POISON_WORD 0xDEADFACEu

/* One set of build inputs: what vkCmdBuild takes. */
struct gn_build_input {
    VkAccelerationStructureGeometryKHR *geometries;
    const VkAccelerationStructureGeometryKHR **pointers; /* to the same; NULL: they are given as an array */
    VkAccelerationStructureBuildRangeInfoKHR *ranges;
};

/* A BLAS or a TLAS on its way through its builds and steps. */
struct gn_structure {
    VkAccelerationStructureTypeKHR type;
    bool generic;
    VkBuildAccelerationStructureFlagsKHR flags;
    uint32_t geometry_count;
    const uint32_t *primitive_counts; /* per geometry */
    struct gn_build_input initial, final; /* the first build's, and every later one's */
    const uint8_t *steps;

    VkAccelerationStructureKHR handle;
    struct gn_memory memory;
    VkDeviceSize size;
    VkDeviceAddress address;
    VkDeviceSize size_before_compaction;
    VkAccelerationStructureBuildSizesInfoKHR sizes;
    struct gn_memory scratch;

    /* While a step copies: */
    VkAccelerationStructureKHR source;
    struct gn_memory source_memory;
    struct gn_memory serialized;
    VkDeviceSize queried_size;
    uint64_t queried_handles; /* of serialized data; with maintenance1 */
    bool compacted;
    bool foreign_head; /* serialized data did not begin with the driver's UUID */
};

/* Whether these commands run on the host. */
static inline bool gn_commands_host(enum gn_cts_commands commands)
{
    return commands == GN_CTS_ON_HOST || commands == GN_CTS_DEFERRED;
}

struct gn_structures_plan {
    struct gn_pool *structures, *scratch, *serialized;
    struct gn_pool *initial; /* what only the first builds read; overwritten once they are over */
    struct gn_pool *ranges; /* what indirect builds read; likewise, after all */
    enum gn_cts_commands builds, copies;
    bool separate_builds;
    bool keep_sources;
    bool only_first, only_steps; /* the first builds alone, or what comes after them */
    /* Of a TLAS: what it refers to. They move when it is relocated. */
    struct gn_structure *blases;
    uint32_t blas_count;
};

/*
 * Builds all of them and takes all their steps. On failure the structures hold what has to be destroyed with
 * gn_structures_finish(), as they do on success.
 */
enum gn_device_status gn_structures_build(struct gn_device *device, const struct gn_structures_plan *plan,
                                          struct gn_structure *structures, uint32_t count);
void gn_structures_finish(struct gn_device *device, struct gn_structure *structures, uint32_t count);

/* Host commands (cts/device_host.c): what was asked for is done when they come back. */
struct gn_host_build {
    uint32_t count;
    const VkAccelerationStructureBuildGeometryInfoKHR *infos;
    const VkAccelerationStructureBuildRangeInfoKHR *const *ranges;
};
enum gn_device_status gn_host_build(struct gn_device *device, bool deferred, const struct gn_host_build *build);
enum gn_device_status gn_host_copy(struct gn_device *device, bool deferred, const VkCopyAccelerationStructureInfoKHR *copy);
enum gn_device_status gn_host_serialize(struct gn_device *device, bool deferred,
                                        const VkCopyAccelerationStructureToMemoryInfoKHR *copy);
enum gn_device_status gn_host_deserialize(struct gn_device *device, bool deferred,
                                          const VkCopyMemoryToAccelerationStructureInfoKHR *copy);
enum gn_device_status gn_host_pipeline(struct gn_device *device, const VkRayTracingPipelineCreateInfoKHR *info,
                                       VkPipeline *out_pipeline);

/* Scenes (cts/device_scene.c) */

struct gn_built_scene {
    struct gn_device *device;
    const struct gn_cts_scene *scene;
    struct gn_arena arena; /* descriptions of builds */
    struct gn_pool initial, inputs, storage, scratch, serialized, ranges;
    struct gn_structure *blases;
    uint32_t blas_count;
    struct gn_structure tlas;
    struct gn_built_info info;
};

/* Traces (cts/device_trace.c) */

/* `Constants` in cts/shaders/answer.glsl. */
struct gn_trace_constants {
    uint32_t ray_count;
    uint32_t program; /* enum gn_cts_program */
    uint32_t record_offset, record_stride, miss_index;
    uint32_t depth;
    uint32_t width, height; /* of the launch; whoever launches sets them */
    uint32_t ways; /* a sum of enum gn_trace_way */
    uint64_t scene_address;
};

/* The bits of `ways` in cts/shaders/answer.glsl. */
enum gn_trace_way {
    GN_WAY_TRAPS = 1,
    GN_WAY_OPAQUE_BOXES = 2,
    GN_WAY_FROM_CANDIDATE = 4,
    GN_WAY_TERMINATE = 8,
    GN_WAY_WIDE = 16,
    GN_WAY_REPORTS = 32,
    GN_WAY_COUNTED = 64,
    GN_WAY_ANY_HIT_REFUSES = 128,
    GN_WAY_ANY_HIT_ENDS = 256,
};

/* Records the pipeline, the descriptors and the constants. */
void gn_trace_bind(struct gn_device *device, VkPipelineBindPoint point, VkPipeline pipeline,
                   const struct gn_trace_constants *constants);
/* Frees the programs and buffers that traces have made. */
void gn_trace_finish(struct gn_device *device);

/* Ray tracing pipelines (cts/device_pipeline.c): the pipeline and the shader binding tables of a scene are made
 * ready, a chunk of rays is traced, and the tables are emptied again. */
enum gn_device_status gn_pipeline_prepare(struct gn_built_scene *built, const struct gn_cts_route *route,
                                          enum gn_cts_program program);
enum gn_device_status gn_pipeline_chunk(struct gn_device *device, const struct gn_cts_route *route,
                                        const struct gn_trace_constants *constants);
void gn_pipeline_unprepare(struct gn_device *device);
void gn_pipelines_finish(struct gn_device *device);

/* Ray queries in vertex and fragment shaders (cts/device_draw.c). */
enum gn_device_status gn_drawing_prepare(struct gn_device *device, enum gn_cts_entry entry);
enum gn_device_status gn_drawing_chunk(struct gn_device *device, enum gn_cts_entry entry,
                                       const struct gn_trace_constants *constants);
void gn_drawing_finish(struct gn_device *device);

#endif
