/* SPDX-License-Identifier: Apache-2.0 */
/* The values that rules are evaluated over. They are neutral of the API they come from: the Vulkan layer
 * fills them from a submission, a trace reader fills them from a file. Nothing here is a Vulkan type. */
#ifndef GN_CHECKS_RULES_VALUES_H
#define GN_CHECKS_RULES_VALUES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What a finding can point at. The name of a kind is what messages and logs call it. */
enum gn_object_kind {
    GN_OBJECT_NONE,
    GN_OBJECT_BLAS,
    GN_OBJECT_TLAS,
    GN_OBJECT_STRUCTURE, /* an acceleration structure of generic type, before a build says which it is */
    GN_OBJECT_BUFFER,
    GN_OBJECT_COMMAND_BUFFER,
    GN_OBJECT_QUEUE,
    GN_OBJECT_DEVICE,
    GN_OBJECT_PIPELINE,
    GN_OBJECT_SHADER_MODULE,
    GN_OBJECT_SHADER, /* a shader object */
    GN_OBJECT_KIND_COUNT
};

/* One object of the application. `handle` is what the API calls it, never dereferenced. `name` is its debug
 * name, NULL when it has none; the string belongs to whoever made the value. */
struct gn_object {
    enum gn_object_kind kind;
    uint64_t handle;
    const char *name;
};

/* Where the first build of a structure lies, seen from one event that reads the structure. Made by a build, an
 * update, a clone, a compaction, a deserialization, an indirect or a host build: all count alike. */
enum gn_built {
    GN_BUILT_NEVER,     /* nothing that was submitted up to the judgement builds it */
    GN_BUILT_LATER,     /* the first build comes after the event, in the same order of execution */
    GN_BUILT_SAME_CALL, /* the build is in the same command as the event */
    GN_BUILT_BEFORE,    /* the build comes before the event, in the same order of execution */
    GN_BUILT_UNORDERED  /* a build exists, but what was observed does not order it against the event */
};

/* An acceleration structure as one event sees it. `id` is unique in the process and never reused, unlike
 * handles and addresses. */
struct gn_structure {
    struct gn_object object;
    uint64_t id;
    uint64_t address;
    enum gn_built built;
    bool same_call; /* the command of the event writes it too, whatever was built before */
    bool is_top;    /* a TLAS: created as one, or of generic type and never built as anything else */
    bool destroyed; /* it was destroyed before the event was submitted; `built` says nothing then */
};

/* One geometry of a build. The numbers are the API's own; rules only compare them. What does not apply is 0. */
struct gn_geometry {
    uint32_t type, flags;
    uint32_t vertex_format, index_type, max_vertex;
    bool has_transform;
    uint32_t primitive_count;
};

#define GN_BUILD_ALLOW_UPDATE 0x1u
#define GN_BUILD_ALLOW_COMPACTION 0x2u

/* What a build was told, other than where its data lies. */
struct gn_shape {
    bool is_top;
    bool counts_known; /* false: the numbers of primitives were in device memory */
    uint32_t flags;
    uint32_t geometry_count;
    const struct gn_geometry *geometries;
};

/* How the contents of a structure came about. */
enum gn_made {
    GN_MADE_UNKNOWN, /* nothing yet, or in a way that was not observed in full */
    GN_MADE_BUILT,
    GN_MADE_UPDATED,
    GN_MADE_CLONED,
    GN_MADE_COMPACTED,
    GN_MADE_DESERIALIZED,
    GN_MADE_COUNT
};

/* A structure and its contents, as a command finds them. */
struct gn_contents {
    struct gn_structure structure; /* object.kind is GN_OBJECT_NONE where the command has none, or it is not known */
    enum gn_made made;
    bool compacted;               /* by compaction, and maybe cloned or updated since */
    const struct gn_shape *shape; /* of the build that the contents come from; NULL: not known */
    uint64_t generation;          /* counts builds and copies into the structure; updates in place belong to the same one */
    uint64_t size;                /* as it was created */
    uint64_t compacted_size;      /* the last one that the application has read; 0: none */
    uint64_t compacted_size_of;   /* the generation that it belongs to */
    uint64_t size_asked_of;       /* the last generation whose compacted size was asked, read or not; 0: none */
};

enum gn_command_kind {
    GN_COMMAND_BUILD,
    GN_COMMAND_UPDATE,
    GN_COMMAND_CLONE,
    GN_COMMAND_COMPACT,
    GN_COMMAND_SERIALIZE,
    GN_COMMAND_ASK_COMPACTED_SIZE,
    GN_COMMAND_ASK_OTHER, /* another property of the structure */
    GN_COMMAND_KIND_COUNT
};

/* A command on one or two structures, in the order of execution: `source` is read, `target` is written. */
struct gn_command {
    enum gn_command_kind kind;
    const char *place;            /* which command buffer and submission, for messages */
    const struct gn_shape *shape; /* of a build or update */
    struct gn_contents source, target;
};

/* One array that a build reads: element i lies at address + offset + i * stride. */
struct gn_input {
    const char *place;
    struct gn_object target;
    uint64_t target_id;
    uint32_t info, geometry;
    const char *what; /* what the API calls it */
    uint64_t address, offset;
    uint64_t count, stride, element_size;
    uint64_t bound; /* the most elements that were announced; 0: there is no such number */
    uint64_t buffer_address, buffer_size; /* the buffer in which the array begins; size 0: not known */
};

/* A number that the API bounds, found to be wrong when a command was recorded. */
enum gn_demand_kind {
    GN_DEMAND_ALIGNMENT, /* `value` is to be a multiple of `bound` */
    GN_DEMAND_LIMIT,     /* at most `bound` */
    GN_DEMAND_USAGE,     /* the buffer at the address `value` is to have the usage `needs` */
    GN_DEMAND_STORAGE,   /* the structure that is built has `value` bytes and needs `bound` */
    GN_DEMAND_SCRATCH,   /* from the scratch address, the buffer has `value` bytes and the build needs `bound` */
    GN_DEMAND_SBT_ALIGNMENT, /* of a shader binding table; as above */
    GN_DEMAND_SBT_LIMIT,
    GN_DEMAND_SBT_USAGE,
    GN_DEMAND_SBT_RANGE,     /* a region needs `bound` bytes and its buffer has `value` */
    GN_DEMAND_SBT_RAYGEN,    /* the stride of the region of the ray-generation shader is `bound`, its size `value` */
    GN_DEMAND_RECURSION,     /* a pipeline's maxPipelineRayRecursionDepth is `value`, the limit `bound` */
    GN_DEMAND_KIND_COUNT
};

#define GN_NO_INDEX 0xFFFFFFFFu

struct gn_demand {
    enum gn_demand_kind kind;
    const char *place;
    struct gn_object target;
    uint64_t target_id;
    uint32_t info, geometry; /* GN_NO_INDEX: none in particular */
    const char *what;        /* what the API calls it */
    uint64_t value, bound;
    const char *needs;       /* a usage, or the name of the limit; NULL: there is none */
    struct gn_object buffer; /* kind is GN_OBJECT_NONE where it does not matter */
};

/* Two elements of one build command that use the same memory, which nothing orders. */
enum gn_clash_kind {
    GN_CLASH_TARGETS, /* both write one structure */
    GN_CLASH_SOURCE,  /* the second updates from the structure that the first writes */
    GN_CLASH_SCRATCH  /* both have their scratch at one address, and both need some */
};
struct gn_clash {
    enum gn_clash_kind kind;
    const char *place;
    uint32_t first, second; /* indices of pInfos */
    struct gn_object first_target, second_target;
    uint64_t first_id, second_id;
    uint64_t address; /* of the scratch */
};

/* Something that is wrong with a TLAS as a trace, dispatch or draw finds it. */
enum gn_trouble_kind {
    GN_TROUBLE_NEVER_BUILT,
    GN_TROUBLE_DESTROYED,    /* a BLAS that it was last built from was destroyed since */
    GN_TROUBLE_STORAGE_GONE, /* the buffer or the memory of a BLAS was */
    GN_TROUBLE_REBUILT,      /* a BLAS was written since */
    GN_TROUBLE_KINDS
};
struct gn_trouble {
    enum gn_trouble_kind kind;
    bool certain; /* some invocation of the command traces through the TLAS, whatever the data */
    const char *place;
    struct gn_object tlas, blas; /* the BLAS to which it happened first */
    uint64_t tlas_id, blas_id;
    const char *moved_to; /* what the BLAS was copied into last, as text; NULL: nothing */
    uint64_t count, total; /* how often it happened; how many BLASes the TLAS has */
};

/* What an update reads, held against what the build or update that it starts from has read. */
struct gn_refit {
    const char *place;
    struct gn_object target;
    uint64_t target_id;
    uint32_t geometry;
    bool indices_changed;
    bool activity_changed; /* some primitive has become active, or inactive */
    uint64_t inactive_before, inactive, total;
    uint32_t updates; /* in place, one after the other, since the last build */
    double growth;    /* of the surface of what the build had grouped, against grouping it anew; 0: not measured */
};

/* Two accesses of the same memory, one of them a write, that nothing orders as they should be. */
enum gn_hazard_kind {
    GN_HAZARD_INSTANCE,      /* a TLAS build reads a BLAS */
    GN_HAZARD_TRACE,         /* a trace reads a TLAS */
    GN_HAZARD_SCRATCH,       /* scratch memory of a build */
    GN_HAZARD_INPUT,         /* input of a build */
    GN_HAZARD_STRUCTURE,     /* other reads and writes of structures */
    GN_HAZARD_OVERLAP,       /* both belong to one command */
    GN_HAZARD_BINDING_TABLE, /* a trace reads its shader binding table */
    GN_HAZARD_KINDS
};
enum gn_hazard_why {
    GN_HAZARD_NOT_ORDERED,   /* the second may start before the first is over */
    GN_HAZARD_NOT_AVAILABLE, /* ordered; but the writes of the first were not made available */
    GN_HAZARD_NOT_VISIBLE,   /* available; but not visible to the second */
    GN_HAZARD_OTHER_QUEUE    /* they run on two queues that nothing orders */
};
struct gn_hazard_access {
    struct gn_object object; /* GN_OBJECT_NONE: plain memory */
    uint64_t id;
    const char *what;             /* what the command does, as a verb: "builds" */
    const char *stages, *accesses; /* as a barrier names them */
};
struct gn_hazard {
    enum gn_hazard_kind kind;
    enum gn_hazard_why why;
    bool certain; /* the second access surely takes place */
    const char *place, *first_place;
    struct gn_hazard_access first, second;
    uint64_t begin, end; /* addresses in common */
};

enum gn_sbt_part { GN_SBT_RAYGEN, GN_SBT_MISS, GN_SBT_HIT, GN_SBT_CALLABLE, GN_SBT_PARTS };

/* What the handle of a record is, seen from the pipeline that is bound. */
enum gn_sbt_handle {
    GN_HANDLE_FITS,    /* of a group of the pipeline that belongs into this region */
    GN_HANDLE_NULL,    /* all zero: there is no shader */
    GN_HANDLE_UNFIT,   /* of a group of the pipeline that belongs into another region */
    GN_HANDLE_FOREIGN, /* of another pipeline */
    GN_HANDLE_UNKNOWN, /* of no pipeline that the layer has seen */
    GN_HANDLE_KINDS
};

/* The records of one region, as they lay in memory when the trace ran. */
struct gn_sbt_region {
    uint64_t address, stride;
    uint64_t records; /* in the region */
    uint64_t read;    /* so many from the first on were looked at */
    uint64_t count[GN_HANDLE_KINDS], first[GN_HANDLE_KINDS];
    const char *unfit;        /* what the first group that does not fit is */
    struct gn_object foreign; /* the pipeline of the first foreign handle; it may be gone */
    bool foreign_gone;
};

/* The shader binding table of one trace. */
struct gn_sbt {
    const char *place;
    struct gn_object pipeline;
    uint64_t pipeline_id;
    bool runs;          /* some invocation certainly does */
    bool handles_known; /* all handles of the pipeline */
    bool no_null_miss, no_null_hit; /* the pipeline's flags forbid null shaders there; hit: closest hit or intersection */
    struct gn_sbt_region regions[GN_SBT_PARTS];
    struct gn_object tlas; /* one that the pipeline traces through; kind is GN_OBJECT_NONE if none is known */
    uint64_t tlas_id;
    /* The highest hit record that its instances need for certain, and how it comes about: the instance's offset, a geometry of what it
     * refers to, and the least that any ray of the pipeline adds (stride per geometry, and offset). */
    uint64_t record;
    uint32_t instance, instance_offset, geometry, ray_stride, ray_offset;
};

/* One instance of a TLAS as it lies in memory: 64 bytes, the layout that all APIs share. */
struct gn_instance_record {
    float object_to_world[12];         /* three rows of four */
    uint32_t custom_index_and_mask;    /* 24 bits, then 8 */
    uint32_t sbt_offset_and_flags;     /* 24 bits, then 8 */
    uint64_t reference;                /* address of the BLAS; 0 makes the instance inactive */
};

#define GN_REFERENCE_NULL 0xFFFFFFFFu    /* the reference is 0 */
#define GN_REFERENCE_UNKNOWN 0xFFFFFFFEu /* the reference is not the address of any structure alive */

/* A build or update of a TLAS, with the instances that the build has read. */
struct gn_tlas_build {
    struct gn_object tlas;
    uint64_t tlas_id;
    const char *place; /* which command, command buffer and submission, for messages */
    uint32_t instance_count;
    bool partial; /* the build reads more instances than these */
    const struct gn_instance_record *instances;
    const uint32_t *refers_to; /* per instance: index into `structures`, or GN_REFERENCE_* */
    uint32_t structure_count;
    const struct gn_structure *structures;
    bool references_sure;         /* GN_REFERENCE_UNKNOWN is certain: the address of every structure alive is known */
    uint32_t valid_flags;         /* the instance flags that exist on the device, as in the upper 8 bits */
    const uint64_t *declared_masks; /* 256 bits, one per mask that the application means to use; NULL: not declared */
    uint32_t custom_index_bound;  /* every custom index is declared to be below; 0: not declared */
    uint32_t sbt_offset_bound;    /* the same of shader-binding-table offsets */
    const struct gn_survey *survey; /* of all instances (survey.h); NULL: the library makes it */
};

#ifdef __cplusplus
}
#endif
#endif
