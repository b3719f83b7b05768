/* SPDX-License-Identifier: Apache-2.0 */
/* A parsed SPIR-V module: instructions, ids, functions, blocks, and where the source is. Internal to checks/spirv. */
#ifndef GN_CHECKS_SPIRV_MODULE_H
#define GN_CHECKS_SPIRV_MODULE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <spirv/unified1/spirv.h>

#include "checks/spirv/spirv.h"

#define NONE UINT32_MAX

/* Memory that is freed all at once. An allocation is zeroed; NULL when there is no memory or the size overflows. */
struct arena {
    struct arena_block *blocks;
};
void *arena_alloc(struct arena *arena, size_t count, size_t size);
char *arena_text(struct arena *arena, const char *text, size_t length);
void arena_finish(struct arena *arena);

struct inst {
    uint32_t offset; /* in words from the start of the module */
    uint16_t count;  /* words */
    uint16_t opcode;
    uint32_t type, result; /* ids, or 0 */
};

struct block {
    uint32_t id;
    uint32_t first, last; /* instructions: the label and the terminator */
    uint32_t merge;       /* instruction, or NONE */
    uint32_t function;
};

struct function {
    uint32_t id;
    uint32_t first, last;       /* instructions: OpFunction and OpFunctionEnd */
    uint32_t first_block, block_count;
    uint32_t first_parameter, parameter_count; /* instructions */
};

struct module {
    struct arena *arena;
    const uint32_t *words;
    uint32_t word_count, bound;
    struct inst *insts;
    uint32_t inst_count;
    uint8_t *id_words; /* a bit per word of the module: this word is an id */
    uint32_t *definition; /* per id: the instruction that makes it, or NONE */
    uint32_t *block_of;   /* per id: the block that it labels, or NONE */
    uint32_t *function_of; /* per id: the function of that id, or NONE */
    const uint32_t *alias; /* per id of a load: what was stored before, or 0; NULL until the flow analysis has found it */
    struct function *functions;
    uint32_t function_count;
    struct block *blocks;
    uint32_t block_count;
    bool reads_positions; /* it has the capability to read vertex positions in hit shaders */
    uint32_t globals_end; /* the first instruction of the function section, lines before the first function included */
    char *message;
    size_t message_size;
};

/* Parses. The words must outlive the module. On failure the message says what was expected and found. */
enum gn_spirv_status module_parse(struct module *module, struct arena *arena, const uint32_t *words, size_t word_count,
                                  char *message, size_t message_size);

/* UNTOUCHED if SPIRV-Tools finds the module valid; its message otherwise. */
enum gn_spirv_status module_validate(const struct module *module);

const uint32_t *inst_words(const struct module *module, const struct inst *inst);
/* Word `index` of the instruction, 0 when it has fewer. */
uint32_t inst_word(const struct module *module, const struct inst *inst, uint32_t index);
bool inst_word_is_id(const struct module *module, const struct inst *inst, uint32_t index);
/* NULL when nothing defines the id. */
const struct inst *definition_of(const struct module *module, uint32_t id);
uint32_t opcode_of(const struct module *module, uint32_t id);

/* Goes through the blocks that the terminator leads to: `cursor` starts at 0 and holds the word of the last one given. */
bool next_successor(const struct module *module, const struct block *block, uint32_t *cursor, uint32_t *out_block);
bool is_terminator(uint32_t opcode);

/* The text of an OpString or a literal string in the words of an instruction, "" if it has none. */
const char *inst_text(const struct module *module, const struct inst *inst, uint32_t word);
/* The OpName of an id, or NULL. */
const char *name_of(const struct module *module, uint32_t id);

/* Whether an OpExtInst belongs to a set without meaning for execution (debug information), and which number it is. */
bool is_debug(const struct module *module, const struct inst *inst, uint32_t *out_number);
#define DEBUG_SCOPE 23
#define DEBUG_NO_SCOPE 24
#define DEBUG_SOURCE 35
#define DEBUG_SOURCE_CONTINUED 102
#define DEBUG_FUNCTION_DEFINITION 101
#define DEBUG_LINE 103
#define DEBUG_NO_LINE 104

/* Whether an integer constant is known from the module alone, and its low 32 bits. */
bool constant_u32(const struct module *module, uint32_t id, uint32_t *out);

/* Fills the place of an instruction within a block. False without memory. */
bool place_find(const struct module *module, uint32_t inst, const struct block *block, struct gn_spirv_place *out);

void say(const struct module *module, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif
