/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a case traces, as data: meshes with their encodings, instances, how the structures are built, rays.
 * The device harness (cts/device.h) builds it on the driver, cts/judge.c builds the same in the reference.
 *
 * Everything is plain memory owned by an arena (cts/arena.h) or by the caller; nothing here is freed piecewise.
 */
#ifndef GNOMON_CTS_SCENE_H
#define GNOMON_CTS_SCENE_H

#include <stdbool.h>
#include <stdint.h>
#include <vulkan/vulkan_core.h>

#include "reference/trace.h"
#include "reference/verdict.h"

/* What is done to a structure after its first build, in this order. */
enum gn_cts_step {
    GN_CTS_STEP_END = 0,
    GN_CTS_STEP_REFIT, /* update in place from the initial to the final data; needs ALLOW_UPDATE */
    GN_CTS_STEP_REFIT_COPY, /* update with a destination of its own */
    GN_CTS_STEP_REBUILD, /* a second full build into the same structure */
    GN_CTS_STEP_COMPACT, /* needs ALLOW_COMPACTION; the source is destroyed and its memory poisoned */
    GN_CTS_STEP_CLONE, /* likewise */
    GN_CTS_STEP_SERIALIZE, /* serialize, destroy and poison, deserialize */
    GN_CTS_STEP_REFIT_BACK, /* update in place to the initial data; needs ALLOW_UPDATE, and a refit after it */
    /* The same copies into a structure that holds another build, of the initial data, rather than garbage. */
    GN_CTS_STEP_CLONE_OVER,
    GN_CTS_STEP_SERIALIZE_OVER,
    GN_CTS_STEP_RELOCATE, /* of a TLAS: serialize, clone and destroy its BLASes, deserialize with the
                              clones' handles; nothing is built from its inputs after it */
    GN_CTS_STEP_COUNT
};
#define GN_CTS_MAX_STEPS 8
/* Whether the initial data are read as well as the final ones. */
bool gn_steps_take_both(const uint8_t *steps);

/*
 * One geometry. A zero-initialised one is a valid empty one, and zero always means the plain choice.
 *
 * positions[] are what one wants; the device gets them rounded to vertex_format, and the reference gets what
 * was encoded. With VK_FORMAT_UNDEFINED the format is VK_FORMAT_R32G32B32_SFLOAT.
 */
struct gn_cts_geometry {
    enum gn_ref_geometry_type type;
    VkGeometryFlagsKHR flags;

    const double (*positions)[3];
    uint32_t position_count;
    const uint32_t (*triangles)[3];
    uint32_t triangle_count;
    VkFormat vertex_format;
    uint32_t vertex_stride; /* bytes; 0: the format's size rounded up to its alignment */
    uint32_t vertex_offset; /* bytes of garbage (NaN patterns) before the first vertex; a multiple of the
                               component's size */
    uint32_t first_vertex; /* VkAccelerationStructureBuildRangeInfoKHR::firstVertex: garbage vertices come first */
    uint32_t primitive_offset; /* bytes, into the index data or, without indices, the vertex data */
    bool index_none; /* no index buffer: the triangles' corners are written out one after another */
    VkIndexType index_type; /* VK_INDEX_TYPE_UINT16 (the zero value) is taken only if it fits, else UINT32 */
    bool index_uint32; /* asks for UINT32 where UINT16 would fit */
    uint32_t data_offset; /* bytes of garbage before the indices (a multiple of the index) or boxes (of 8) */
    const float *transform; /* 12 floats or NULL: the geometry transform */
    uint32_t transform_offset; /* bytes of garbage before it; a multiple of 16 */

    const float (*aabbs)[6];
    uint32_t aabb_count;
    uint32_t aabb_stride; /* bytes; 0: 24. A multiple of 8 */

    /* Refit and rebuild: the data of the first build. NULL: the same as the final data. */
    const double (*initial_positions)[3]; /* position_count */
    const float (*initial_aabbs)[6]; /* aabb_count */
    const float *initial_transform;
};

struct gn_cts_blas {
    const struct gn_cts_geometry *geometries;
    uint32_t geometry_count;
    VkBuildAccelerationStructureFlagsKHR build_flags;
    bool generic; /* created with VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR */
    uint8_t steps[GN_CTS_MAX_STEPS]; /* enum gn_cts_step, ended by GN_CTS_STEP_END */
};

#define GN_CTS_NO_BLAS UINT32_MAX

/* Which commands work on structures. */
enum gn_cts_commands {
    GN_CTS_ON_DEVICE,
    GN_CTS_INDIRECT, /* on the device, what varies read from memory, counts given too large; builds only */
    GN_CTS_ON_HOST,
    GN_CTS_DEFERRED, /* on the host, deferred and joined by several threads */
};

struct gn_cts_instance {
    float transform[12];
    uint32_t custom_index;
    uint32_t mask;
    uint32_t sbt_offset;
    VkGeometryInstanceFlagsKHR flags;
    uint32_t blas; /* index, or GN_CTS_NO_BLAS for a null reference */
};

struct gn_cts_scene {
    const struct gn_cts_blas *blases;
    uint32_t blas_count;
    const struct gn_cts_instance *instances;
    uint32_t instance_count;
    const struct gn_cts_instance *initial_instances; /* as for geometries; NULL: the same */
    VkBuildAccelerationStructureFlagsKHR tlas_build_flags;
    uint8_t tlas_steps[GN_CTS_MAX_STEPS];
    bool tlas_generic;
    bool array_of_pointers; /* the instances of the TLAS build */
    bool geometry_pointers; /* ppGeometries rather than pGeometries in the BLAS builds */
    uint32_t instance_offset; /* primitiveOffset of the TLAS build in bytes, a multiple of 16 */
    /* The BLASes take their steps once the TLAS is built, and the TLAS takes its own after: theirs must leave them where
     * they are, and one of its own must read them again. */
    bool late_steps;
    bool keep_sources; /* copies are destroyed in place of what they are of; nothing is relocated or written over */
    bool separate_builds; /* one vkCmdBuild call per BLAS rather than one for all */
    enum gn_cts_commands blas_builds, tlas_builds, copies; /* updates are builds, size queries copies */
};

/* Which shader runs. */
enum gn_cts_program {
    GN_CTS_COMMITTED, /* the committed hit */
    GN_CTS_CANDIDATES, /* every candidate presented, none confirmed, and the committed hit */
    GN_CTS_DETAIL, /* the committed hit and everything else that a query can be asked about it */
    GN_CTS_POSITIONS, /* the committed hit and its vertex positions (VK_KHR_ray_tracing_position_fetch) */
    GN_CTS_PROGRAM_COUNT
};

/* How shaders are reached that ask for the hit. */
enum gn_cts_entry {
    GN_CTS_QUERY, /* a ray query in a compute shader */
    GN_CTS_PIPELINE, /* a ray tracing pipeline: miss, closest-hit, any-hit and intersection shaders answer */
    /* Ray queries elsewhere or otherwise, for the committed hit only. */
    GN_CTS_QUERY_IN_PAIRS, /* two queries at a time, in turns */
    GN_CTS_QUERY_BY_ADDRESS, /* of the structure at an address, rather than of a descriptor's */
    GN_CTS_QUERY_IN_VERTEX,
    GN_CTS_QUERY_IN_FRAGMENT,
    GN_CTS_QUERY_IN_RAYGEN,
    GN_CTS_QUERY_IN_HIT, /* in the closest-hit shader of the same ray, or its miss shader */
    GN_CTS_ENTRY_COUNT
};

/* What the pipeline is made of. */
enum gn_cts_linking {
    GN_CTS_LINK_NOTHING,
    GN_CTS_LINK_HITS, /* hit groups in a library, the rest in the pipeline itself */
    GN_CTS_LINK_ALL, /* two libraries, one of the ray generation and miss shaders, one of the hit groups */
};
enum gn_cts_launch { GN_CTS_LAUNCH_DIRECT, GN_CTS_LAUNCH_INDIRECT, GN_CTS_LAUNCH_INDIRECT2 };

/* Which way a ray takes; everything but the entry is of pipelines. Zero is the plain one. */
struct gn_cts_route {
    enum gn_cts_entry entry;
    uint32_t record_offset, record_stride; /* OpTraceRay's SBT offset and stride, 0 to 15 */
    uint32_t record_padding; /* the stride of the tables is this many alignments larger than needed */
    uint32_t miss_index;
    uint32_t depth; /* levels of recursion: the hit or miss shader traces the same ray again; 0 means 1 */
    bool traps; /* intersection shaders write hit attributes for reports that cannot be accepted, too */
    /* Only opaque boxes have generated hits: queries ask what the candidate is, the any-hit shader ignores all that it
     * is run for. Of any entry. */
    bool opaque_boxes;
    bool any_hit_refuses; /* boxes that the policy does not want are reported, and ignored by the any-hit shader */
    bool any_hit_ends; /* TerminateOnFirstHit is left to the any-hit shader, which ends the ray: of rays with NoOpaque */
    bool terminate; /* the first candidate that is confirmed or generated ends the ray */
    /* What DETAIL and POSITIONS ask is asked of the candidate that is confirmed: by any-hit and intersection shaders.
     * Rays have to end at their first hit. */
    bool from_candidate;
    bool wide; /* bits of OpTraceRay's operands that do not count are set */
    bool reports; /* intersection shaders report a hit farther away, too */
    bool counted; /* CANDIDATES without boxes: any-hit shaders count in the payload */
    bool deferred; /* the pipeline is created by a deferred operation */
    bool callable; /* a callable shader writes the answer */
    enum gn_cts_linking linking;
    enum gn_cts_launch launch;
    /* Every so manieth record of the hit table is zeros: no shader runs for what it is for; 0: none. */
    uint32_t null_every;
};

struct gn_cts_ray {
    struct gn_ref_ray ray;
    struct gn_ref_policy policy;
};

#define GN_CTS_MAX_CANDIDATES 64

struct gn_cts_candidates {
    uint32_t count; /* presented; may exceed what is listed */
    struct gn_ref_answer list[GN_CTS_MAX_CANDIDATES]; /* kind GENERATED marks an AABB; its t is 0 */
};

/* GN_CTS_DETAIL, of the committed hit. Matrices as 3 rows of 4. Zero on a miss but for the ray's own values. */
struct gn_cts_detail {
    float world_from_object[12];
    float object_from_world[12];
    float object_origin[3];
    float object_direction[3];
    float world_origin[3];
    float world_direction[3];
    float tmin;
    uint32_t flags;
};

/* What one trace gave; arrays of ray_count, NULL for what the program does not give. Owned by the arena. */
struct gn_cts_answers {
    struct gn_ref_answer *committed;
    struct gn_cts_candidates *candidates;
    struct gn_cts_detail *details;
    float (*positions)[9]; /* three vertices in object space */
};

#endif
