/* SPDX-License-Identifier: Apache-2.0 */
/* Makes SPIR-V: growing words, types and constants that the module may already have, and code with structured branches.
 * Internal to checks/spirv. */
#ifndef GN_CHECKS_SPIRV_WRITER_H
#define GN_CHECKS_SPIRV_WRITER_H

#include "checks/spirv/analysis.h"

/* Once memory has run out, `failed` stays set and nothing more is added. */
struct words {
    uint32_t *data;
    size_t count, capacity;
    bool failed;
};

void words_add(struct words *words, const uint32_t *data, size_t count);
void words_instruction(struct words *words, uint32_t opcode, const uint32_t *operands, size_t count);
/* EMIT(words, opcode, operand, ...) */
#define EMIT(words, opcode, ...)                                                                                       \
    words_instruction(words, opcode, (const uint32_t[]){__VA_ARGS__},                                                   \
                      sizeof((const uint32_t[]){__VA_ARGS__}) / sizeof(uint32_t))
#define EMIT_BARE(words, opcode) words_instruction(words, opcode, NULL, 0)

struct constant {
    uint32_t type, value, id;
};

/* The types that checks compute with; 0 until asked for. */
struct writer {
    struct analysis *analysis;
    struct module *module;
    uint32_t next_id;
    struct words out;         /* the new module */
    struct words globals;     /* new types, constants and variables */
    struct words decorations; /* of these */
    struct words interface;   /* ids of variables that entry points have to list (SPIR-V 1.4) */
    struct constant *constants;
    uint32_t constant_count, constant_capacity;

    uint32_t label;           /* of the block being written */
    const struct inst *line, *scope, *debug_line; /* what has to be said again when a block is split */

    uint32_t record_function, record_type;
    uint32_t buffer, buffer_pointer, buffer_class; /* where records go: a variable or an address, its type and storage class */
    uint32_t invocation_kind; /* which built-ins say which invocation it is, see recorder.c */
    uint32_t invocation[2];   /* built-in variables */
    uint32_t depth_word;      /* of the trace being written: where its depth is counted */
    struct {
        uint32_t set, id;
    } mirrors[32];             /* variables of the mirrors of descriptor sets */
    uint32_t mirror_count, mirror_pointer;
    uint32_t no_structure;    /* of the site being written: whether it has to do without its structure; 0 if nobody asks */
    uint32_t *shadow_of[SHADOW_COUNT]; /* per root: the shadow variable or parameter, or 0 */
};

uint32_t new_id(struct writer *writer);

#define MAX_TYPE_OPERANDS 300
/* The id of a type: the module's own where it has one, as SPIR-V forbids a second. */
uint32_t type_make(struct writer *writer, uint32_t opcode, const uint32_t *operands, uint32_t count);
#define TYPE(writer, opcode, ...)                                                                                      \
    type_make(writer, opcode, (const uint32_t[]){__VA_ARGS__}, sizeof((const uint32_t[]){__VA_ARGS__}) / sizeof(uint32_t))
uint32_t type_uint(struct writer *writer);
uint32_t type_float(struct writer *writer);
uint32_t type_bool(struct writer *writer);
uint32_t type_void(struct writer *writer);
uint32_t type_uint3(struct writer *writer);
uint32_t type_bool3(struct writer *writer);
uint32_t type_pointer(struct writer *writer, uint32_t storage, uint32_t pointee);
/* A constant without a value of its own: OpConstantNull, OpConstantFalse. */
uint32_t constant_plain(struct writer *writer, uint32_t opcode, uint32_t type);
uint32_t constant_uint(struct writer *writer, uint32_t value);
uint32_t constant_float(struct writer *writer, float value);
uint32_t constant_uint3(struct writer *writer, uint32_t value);

/* result = opcode operands..., returning the result's id. */
uint32_t compute(struct writer *writer, uint32_t opcode, uint32_t type, const uint32_t *operands, size_t count);
#define COMPUTE(writer, opcode, type, ...)                                                                             \
    compute(writer, opcode, type, (const uint32_t[]){__VA_ARGS__}, sizeof((const uint32_t[]){__VA_ARGS__}) / sizeof(uint32_t))

/* A structured "if": what is written between begin and end runs where the condition holds. */
struct branch {
    uint32_t before, merge, inside;
};
void branch_begin(struct writer *writer, uint32_t condition, struct branch *branch);
void branch_end(struct writer *writer, struct branch *branch);
/* Right after branch_end: `inside` where the condition held, else `otherwise`. */
uint32_t branch_phi(struct writer *writer, const struct branch *branch, uint32_t type, uint32_t inside, uint32_t otherwise);
/* Says again which source line follows. */
void lines_restate(struct writer *writer);
void label_begin(struct writer *writer, uint32_t label);

/* The buffer's variable and the built-ins; before any check is written. False when the module cannot have them. */
bool records_prepare(struct writer *writer);
/* Writes the function that checks call to leave a record, after the module's last function. */
void records_function(struct writer *writer);

/* What the host says of the launch that runs, see enum gn_launch_word: the number of callables and 1, or 0. */
uint32_t launch_callables(struct writer *writer);
/* Counts a trace within a shader that was itself invoked by one: the depth of that shader, or 0 where there is no count. Nothing but
 * the trace may come between entering and leaving. */
uint32_t launch_depth_enter(struct writer *writer);
void launch_depth_leave(struct writer *writer);

/* The id of the structure that the operand is loaded from, and what a record says of it; 0 where it cannot be told. */
uint32_t structure_id(struct writer *writer, const struct inst *operation, uint32_t word, uint32_t out_operands[4]);
/* The word of the table of structures. */
uint32_t structures_load(struct writer *writer, uint32_t id);

/* The checks of a site, before its instruction. Returns a bool, whether the instruction has to be skipped; 0 if it never has. */
uint32_t checks_write(struct writer *writer, const struct site *site);
/* Whether the site's checks read what the shadow state says; and what they need of its group. */
bool checks_need_state(const struct site *site);
/* What follows the site's instruction to keep the shadow state. */
void shadow_update(struct writer *writer, const struct site *site);
/* Decides how the states of an array are kept. */
void shadow_pack(struct analysis *analysis, struct root *root);
/* What the shadow says of the query that `query` leads to; above the bits of a state may stand those of others. */
uint32_t shadow_state(struct writer *writer, uint32_t query);
/* Another shadow of it. */
uint32_t shadow_load(struct writer *writer, uint32_t query, enum shadow shadow);
/* Of floats, where it is not of unsigned integers. */
bool shadow_is_float(enum shadow shadow);
/* The value of an input that a built-in decoration names, or 0 where the module has it in another form. */
uint32_t builtin_load(struct writer *writer, uint32_t builtin, uint32_t type);

#endif
