/* SPDX-License-Identifier: Apache-2.0 */
/* What is known of a module's ray queries: the variables and parameters that hold them, the operations on them, and the
 * states in which these may be reached; and its traces, reports and calls, which have no state. Internal to checks/spirv. */
#ifndef GN_CHECKS_SPIRV_ANALYSIS_H
#define GN_CHECKS_SPIRV_ANALYSIS_H

#include "checks/spirv/module.h"

/*
 * The protocol's states, a bit each: uninitialized; initialized without a Proceed; at a candidate (triangle or AABB);
 * finished (Proceed returned false); terminated at a candidate. All but the first two are told apart by what is
 * committed: nothing, a triangle, a generated intersection.
 */
enum { COMMITTED_NOTHING, COMMITTED_TRIANGLE, COMMITTED_GENERATED, COMMITTED_COUNT };
enum { KIND_TRIANGLE, KIND_AABB };
#define STATE_UNINITIALIZED 1u
#define STATE_INITIALIZED 2u
#define STATE_CANDIDATE(kind, committed) (1u << (2 + (kind)*3 + (committed)))
#define STATE_FINISHED(committed) (1u << (8 + (committed)))
#define STATE_TERMINATED(kind, committed) (1u << (11 + (kind)*3 + (committed)))
#define STATES_CANDIDATE (0x3Fu << 2)
#define STATES_FINISHED (7u << 8)
#define STATES_TERMINATED (0x3Fu << 11)
#define STATES_ALL 0x1FFFFu
#define STATES_AT_TRIANGLE (7u << 2 | 7u << 11)
#define STATES_AT_AABB (7u << 5 | 7u << 14)
#define STATES_AT_CANDIDATE (STATES_CANDIDATE | STATES_TERMINATED)
#define STATES_NO_CANDIDATE (STATE_INITIALIZED | STATES_FINISHED)
/* Per kind of committed intersection, in all states that have it. */
#define STATES_COMMITTED(c) (1u << (2 + (c)) | 1u << (5 + (c)) | 1u << (8 + (c)) | 1u << (11 + (c)) | 1u << (14 + (c)))

enum operation_kind {
    OPERATION_INITIALIZE,
    OPERATION_TERMINATE,
    OPERATION_GENERATE,
    OPERATION_CONFIRM,
    OPERATION_PROCEED,
    OPERATION_GET_TYPE,
    OPERATION_GET_RAY,
    OPERATION_GET,
    OPERATION_GET_AABB_OPAQUE,
    OPERATION_TRACE,
    OPERATION_TRACE_MOTION,
    OPERATION_REPORT,
    OPERATION_CALL,
    OPERATION_POSITIONS, /* a load of HitTriangleVertexPositionsKHR */
};

enum operation_needs { NEEDS_NOTHING, NEEDS_TRIANGLE_CANDIDATE, NEEDS_TRIANGLE };

struct operation {
    uint32_t opcode;
    const char *name;
    uint32_t query_word; /* 0: it is about no query */
    uint32_t ray_word;   /* 0: it is about no ray */
    enum operation_kind kind;
    enum operation_needs needs;
};
/* NULL for any other instruction. */
const struct operation *operation_of(uint32_t opcode);
/* As above, and loads of what a hit shader is told. */
const struct operation *operation_at(const struct module *module, const struct inst *inst);

/* The words of an instruction that say which ray is traced; 0 for those that it does not have. */
struct ray_words {
    uint32_t flags, mask, sbt_offset, sbt_stride, miss, origin, tmin, direction, tmax, time, payload;
};
struct ray_words ray_words_of(const struct operation *operation);

/* What the device may keep of a query (shadow.c), in the order in which functions are given it: its state, the tmax it was initialized with,
 * and the id of the structure that it goes through. */
enum shadow { SHADOW_STATE, SHADOW_TMAX, SHADOW_STRUCTURE, SHADOW_COUNT };

/* A variable or parameter that holds queries: one, or an array of them. */
struct root {
    uint32_t id;
    uint32_t function;      /* that it belongs to, or NONE for Private */
    uint32_t parameter;     /* its index, or NONE for a variable */
    uint32_t storage;       /* class of the pointer: a parameter may lead to a Private variable */
    uint32_t pointee;       /* type */
    uint32_t elements;      /* 1 for a single query; 0 for an array not told apart by element */
    uint32_t indexed_by;    /* a pointer into an array whose uses all have the index of that one, which counts as a single query; or 0 */
    uint32_t first_object;
    uint32_t group;         /* the root that stands for all that may be the same object */
    bool aliased;           /* reachable under two names at once: nothing is known of its state */
    bool packed;            /* an array whose states share a word (shadow.c) */
    bool needs[SHADOW_COUNT]; /* of the group's first root: what runs on the device keeps */
};

/* What the flow analysis follows: one query, or all elements of an array taken together. */
struct object {
    uint32_t root;
    bool strong; /* one query */
};

struct site {
    uint32_t inst, block;
    const struct operation *operation;
    uint32_t root, object; /* NONE for an operation without a query */
    bool committed;       /* a getter of the committed intersection */
    bool reachable;
    uint32_t states;      /* in which it may be reached */
    uint64_t judged, checked, wrong; /* bits of rules */
    uint32_t first_check;
};

/* Which shaders of a ray-tracing pipeline run a function: those that a command starts, and those that a trace invokes. What no
 * entry point reaches may be run by both. */
#define STAGE_RAYGEN 1u
#define STAGE_NESTED 2u

struct analysis {
    struct module *module;
    const struct gn_spirv_options *options;
    struct root *roots;
    uint32_t root_count;
    uint32_t *root_of;   /* per id of a variable or parameter; NONE otherwise */
    struct object *objects;
    uint32_t object_count;
    struct site *sites;
    uint32_t site_count;
    uint32_t *site_of;   /* per instruction; NONE otherwise */
    bool *touches;       /* per function: has sites or parameters that are queries, itself or through calls */
    uint8_t *stages;     /* per function: STAGE_*, of the entry points that reach it */
    uint32_t *stored_by, index_steps; /* of indices.c */
    bool *names;         /* per function and root: it, or what it calls, names that Private variable itself */
    uint32_t check_count;
};

/* Finds roots, objects and sites. DECLINED with a message when a query is used in a way that cannot be followed. */
enum gn_spirv_status objects_find(struct analysis *analysis);
/* The root that a pointer to a query leads to, with the indices on the way (ids, at most 8). NONE if it is none. */
#define MAX_INDICES 8
uint32_t pointer_root(const struct analysis *analysis, uint32_t id, uint32_t *indices, uint32_t *out_count);
/* The object of a pointer, given by objects_find's numbering. */
uint32_t pointer_object(const struct analysis *analysis, uint32_t id);

/* Whether `count` indices into an array of that function (NONE: of the module) have the same values, which cannot change in its life. */
bool indices_same(struct analysis *analysis, uint32_t function, const uint32_t *a, const uint32_t *b, uint32_t count);

/* Fills the states of the sites. */
enum gn_spirv_status flow_run(struct analysis *analysis);

/* What the operands of an operation say: bits of rules that they break and that they cannot break. */
struct operand_verdict {
    uint64_t wrong, right;
};
/* The first word of the operation whose type is not the one that the checks read; 0 if all are. SPIRV-Tools does not ask this of every
 * operation. */
uint32_t operands_unfit(const struct module *module, const struct inst *inst, const struct operation *operation);
struct operand_verdict operands_judge(const struct analysis *analysis, const struct inst *inst);
/* The ray flags of an operation with a ray, if known. */
bool operands_flags(const struct module *module, const struct inst *inst, uint32_t *out);
/* The flags that have a meaning in this module. */
uint32_t known_flags(const struct module *module);

/* The descriptor that an operand (the word of the instruction) is loaded from. False when it comes by another way. */
struct structure_operand {
    uint32_t set, binding;
    uint32_t index; /* id of the element's index, 0 for none */
};
bool structure_operand_find(const struct module *module, const struct inst *operation, uint32_t word, struct structure_operand *out);

/* Decides per site and rule what is proved, wrong or to be checked. */
void verdicts_make(struct analysis *analysis);

/* The rules of a ray, as they are numbered for Initialize; for traces they are RULES_OF_RAY_TO_TRACE further. */
#define RULES_OF_RAY 10
#define RULES_OF_RAY_TO_TRACE (GN_SPIRV_RULE_TRACE_NAN - GN_SPIRV_RULE_INITIALIZE_NAN)
_Static_assert(GN_SPIRV_RULE_INITIALIZE_MASK_BITS - GN_SPIRV_RULE_INITIALIZE_NAN + 1 == RULES_OF_RAY &&
                   GN_SPIRV_RULE_TRACE_MASK_BITS - GN_SPIRV_RULE_TRACE_NAN + 1 == RULES_OF_RAY,
               "the rules of a ray are the same for Initialize and traces");

#define RULE_BIT(name) (UINT64_C(1) << GN_SPIRV_RULE_##name)

#define RULES_OF_STRUCTURE                                                                                             \
    (RULE_BIT(STRUCTURE_NONE) | RULE_BIT(STRUCTURE_NEVER_BUILT) | RULE_BIT(STRUCTURE_DESTROYED) | RULE_BIT(STRUCTURE_BOTTOM_LEVEL))

/* Whether all entry points are of hit shaders, so that a function may read what only these are told. */
bool hit_shaders_only(const struct module *module);

#endif
