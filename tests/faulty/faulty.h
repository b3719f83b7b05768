/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A Vulkan layer that makes a driver wrong in one named way, so that it can be seen whether the suite notices.
 *
 * GNOMON_FAULT names the fault; without it the layer changes nothing but what `faults.c` says is mended. One fault is
 * one block in faults.c or pipelines.c. The layer works above drivers whose device addresses are addresses of this process
 * (lavapipe) and refuses others; it takes one device at a time, and waits for the queue after each submission.
 */
#ifndef GNOMON_TESTS_FAULTY_H
#define GNOMON_TESTS_FAULTY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <vulkan/vulkan_core.h>

/* An acceleration structure that the application has created. */
struct gn_fault_structure {
    VkAccelerationStructureKHR handle;
    uint8_t *bytes; /* where it lies: NULL until it was built or copied to */
    VkDeviceSize size;
    uint32_t builds; /* recorded so far, updates included */
    uint8_t *first; /* what it held after its first build, malloc'ed; NULL before it */
    float low[3], high[3]; /* bounds of the primitives of the last full build; low > high where unknown */
    VkAccelerationStructureInstanceKHR *instances; /* of the last full build of a TLAS, malloc'ed */
    uint32_t instance_count;
    struct gn_fault_structure *next;
};

/* One build of vkCmdBuildAccelerationStructuresKHR in private copies, which a fault may change. */
struct gn_fault_build {
    VkAccelerationStructureBuildGeometryInfoKHR info;
    VkAccelerationStructureGeometryKHR *geometries; /* info.pGeometries */
    VkAccelerationStructureBuildRangeInfoKHR *ranges;
    struct gn_fault_structure *to, *from; /* `from` is the source of an update, NULL otherwise */
    bool skip; /* the driver is not told of it */
    bool clone; /* the driver copies the source instead */
};

/* What a fault changes in shader modules: an operand before an instruction, or its result after it. */
enum gn_fault_change {
    GN_FAULT_END = 0,
    GN_FAULT_AND,
    GN_FAULT_OR,
    GN_FAULT_XOR,
    GN_FAULT_SWAP_BITS, /* `value` is the lower of two neighbouring bits */
    GN_FAULT_ADD_ULPS, /* to a positive float, as a signed number */
    GN_FAULT_MULTIPLY, /* a float by the one whose bits `value` has */
    GN_FAULT_SET_FLOAT, /* `value` is its bits */
    GN_FAULT_NOT, /* of a bool */
    GN_FAULT_SWAP_XY, /* of a vector of 2 */
    GN_FAULT_ROTATE_ARRAY, /* of an array of 3 */
    GN_FAULT_NORMALIZE,
    GN_FAULT_SET_OPCODE, /* the same operands for another instruction; results only */
    GN_FAULT_SET_INTERSECTION, /* the constant that says committed or candidate is `value`; results only */
    GN_FAULT_REMOVE, /* of an instruction without result */
    GN_FAULT_SET_BUILTIN, /* a variable that is decorated as one built-in becomes another; of OpDecorate */
    GN_FAULT_CLAMP_TO_RANGE, /* a float into the ray's range, as far as the module has that */
    GN_FAULT_TAKE_INCOMING_PAYLOAD, /* the payload that the shader was called with, where it was; of OpTraceRayKHR */
};
struct gn_fault_edit {
    uint32_t opcode; /* of the instruction */
    uint32_t word; /* of the operand; 0: the result */
    uint32_t builtin; /* with OpLoad and OpDecorate: of variables that are this built-in; otherwise 0 */
    enum gn_fault_change change;
    uint32_t value;
    uint32_t stage; /* 1 and the execution model of the only modules that are changed; 0: all are */
};
#define GN_FAULT_MAX_EDITS 4

/* A trace on its way, direct or indirect. */
struct gn_fault_trace {
    VkStridedDeviceAddressRegionKHR raygen, miss, hit, callable;
    uint32_t size[3];
    bool indirect;
};

struct gn_fault {
    const char *name; /* AREA.WHAT */
    const char *text; /* what is wrong with the driver then */
    void (*build)(struct gn_fault_build *build);
    void (*geometry)(struct gn_fault_build *build, uint32_t geometry); /* of BLASes */
    /* Of TLASes, before `builds` is counted up; all instances lie in order. */
    void (*instance)(const struct gn_fault_build *build, VkAccelerationStructureInstanceKHR *instances, uint32_t index,
                     uint32_t count);
    /* After what was submitted has run. */
    void (*copied)(const struct gn_fault_structure *from, struct gn_fault_structure *to,
                   VkCopyAccelerationStructureModeKHR mode);
    void (*serialized)(uint8_t *bytes);
    /* Before it is recorded. */
    void (*deserialize)(uint8_t *bytes);
    void (*query)(VkQueryType type, uint64_t *value);
    void (*sizes)(const VkAccelerationStructureBuildGeometryInfoKHR *info, VkAccelerationStructureBuildSizesInfoKHR *sizes);
    void (*limits)(VkPhysicalDeviceAccelerationStructurePropertiesKHR *limits);
    void (*pipeline_limits)(VkPhysicalDeviceRayTracingPipelinePropertiesKHR *limits);
    void (*trace)(struct gn_fault_trace *trace);
    void (*group)(VkRayTracingShaderGroupCreateInfoKHR *group);
    /* Handles of `size` bytes, of groups from 0 on. */
    void (*handles)(bool linked, uint32_t count, size_t size, uint8_t *handles);
    struct gn_fault_edit edits[GN_FAULT_MAX_EDITS];
};

/* NULL past the end. */
const struct gn_fault *gn_fault_at(size_t index);
/* The part of them that pipelines.c has. */
extern const struct gn_fault gn_pipeline_faults[];
extern const size_t gn_pipeline_fault_count;
/* A pattern of the cases that notice it where few do; "" where many do. */
const char *gn_fault_witness(const struct gn_fault *fault);
/* The one that GNOMON_FAULT names, or NULL. */
const struct gn_fault *gn_fault_chosen(void);

/*
 * For `gnomon run --selftest`, which loads the library for it: name, text and witness ("" for none) of the index-th fault; false past
 * the end.
 */
bool gn_faulty_describe(size_t index, const char **out_name, const char **out_text, const char **out_witness);

/* Memory that stays until what is being recorded has run; zeroed, aligned to 64. Ends the process when there is none. */
void *gn_fault_memory(size_t size);
struct gn_fault_structure *gn_fault_structure_find(VkAccelerationStructureKHR handle);

/*
 * Private copies of what a geometry is built from, put in its place. Indices come as 32-bit ones also where there were
 * none or others; AABBs come tight; vertices are those that the indices can reach, behind firstVertex, with the stride
 * they had.
 */
uint32_t (*gn_fault_indices(struct gn_fault_build *build, uint32_t geometry))[3];
float (*gn_fault_aabbs(struct gn_fault_build *build, uint32_t geometry))[6];
uint8_t *gn_fault_vertices(struct gn_fault_build *build, uint32_t geometry, uint32_t *out_count);
/* Likewise, as 3 floats each; NULL where the format is not one of 3 or 4 floats. */
float (*gn_fault_positions(struct gn_fault_build *build, uint32_t geometry, uint32_t *out_count))[3];
VkTransformMatrixKHR *gn_fault_transform(struct gn_fault_build *build, uint32_t geometry); /* NULL: it has none */
bool gn_fault_is_update(const struct gn_fault_build *build);
/* Whether the position lies outside of what was built last. */
bool gn_fault_outside(const struct gn_fault_structure *structure, const float position[3]);

/*
 * Makes the private copy of a build, applies the fault, and remembers what later faults need. The result is what the
 * driver is to be told.
 */
void gn_fault_build_make(const VkAccelerationStructureBuildGeometryInfoKHR *info,
                         const VkAccelerationStructureBuildRangeInfoKHR *ranges, struct gn_fault_build *out);

/* Whether a pipeline was linked from libraries, once it was told of. */
void gn_fault_pipeline_remember(VkPipeline handle, const VkRayTracingPipelineCreateInfoKHR *info);
bool gn_fault_pipeline_linked(VkPipeline handle);
/* The groups as the fault changes them, malloc'ed. */
VkRayTracingShaderGroupCreateInfoKHR *gn_fault_groups(const struct gn_fault *fault,
                                                      const VkRayTracingPipelineCreateInfoKHR *info);
/* What an indirect trace finds in memory; without tables in the first form, which leaves them as they are. */
void gn_fault_indirect_read(VkDeviceAddress address, struct gn_fault_trace *trace);
void gn_fault_indirect2_read(VkDeviceAddress address, struct gn_fault_trace *trace);
/* A private copy of a table's records, put in its place. */
uint8_t *gn_fault_table(VkStridedDeviceAddressRegionKHR *region);

/* The module with the edits made, malloc'ed, or NULL where nothing is to be edited. */
uint32_t *gn_fault_shader(const struct gn_fault_edit *edits, const uint32_t *words, size_t count, size_t *out_count);

#endif
