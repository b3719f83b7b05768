/* SPDX-License-Identifier: Apache-2.0 */
/* Parses SPIR-V into the model of module.h. SPIRV-Tools knows the grammar (which words are ids, which instructions exist);
 * what the model relies on beyond it, the nesting of functions and blocks and ids within bounds, is checked here. */
#include "checks/spirv/analysis.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <spirv/unified1/NonSemanticShaderDebugInfo100.h>

/* It defines a variable, so only this file may include it. */
#include <spirv-tools/libspirv.h>

/* SPIR-V's universal limit on ids. */
#define MAX_BOUND 0x3FFFFFu
#define MAX_WORDS (64u << 20)

struct arena_block {
    struct arena_block *next;
    max_align_t data[];
};

void *arena_alloc(struct arena *arena, size_t count, size_t size)
{
    size_t bytes;
    if (__builtin_mul_overflow(count, size, &bytes) || bytes > SIZE_MAX - sizeof(struct arena_block) - 1)
        return NULL;
    struct arena_block *block = calloc(1, sizeof *block + bytes + 1);
    if (!block)
        return NULL;
    block->next = arena->blocks;
    arena->blocks = block;
    return block->data;
}

char *arena_text(struct arena *arena, const char *text, size_t length)
{
    char *copy = arena_alloc(arena, length + 1, 1);
    if (copy)
        memcpy(copy, text, length);
    return copy;
}

void arena_finish(struct arena *arena)
{
    while (arena->blocks) {
        struct arena_block *next = arena->blocks->next;
        free(arena->blocks);
        arena->blocks = next;
    }
}

void say(const struct module *module, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(module->message, module->message_size, format, arguments);
    va_end(arguments);
}

const uint32_t *inst_words(const struct module *module, const struct inst *inst)
{
    return module->words + inst->offset;
}

uint32_t inst_word(const struct module *module, const struct inst *inst, uint32_t index)
{
    return index < inst->count ? module->words[inst->offset + index] : 0;
}

bool inst_word_is_id(const struct module *module, const struct inst *inst, uint32_t index)
{
    uint32_t word = inst->offset + index;
    return index < inst->count && (module->id_words[word / 8] >> (word % 8) & 1);
}

const struct inst *definition_of(const struct module *module, uint32_t id)
{
    return id < module->bound && module->definition[id] != NONE ? &module->insts[module->definition[id]] : NULL;
}

uint32_t opcode_of(const struct module *module, uint32_t id)
{
    const struct inst *inst = definition_of(module, id);
    return inst ? inst->opcode : SpvOpNop;
}

bool is_terminator(uint32_t opcode)
{
    switch (opcode) {
    case SpvOpBranch:
    case SpvOpBranchConditional:
    case SpvOpSwitch:
    case SpvOpKill:
    case SpvOpReturn:
    case SpvOpReturnValue:
    case SpvOpUnreachable:
    case SpvOpTerminateInvocation:
    case SpvOpIgnoreIntersectionKHR:
    case SpvOpTerminateRayKHR:
    case SpvOpEmitMeshTasksEXT: return true;
    default: return false;
    }
}

bool next_successor(const struct module *module, const struct block *block, uint32_t *cursor, uint32_t *out_block)
{
    const struct inst *inst = &module->insts[block->last];
    if (inst->opcode != SpvOpBranch && inst->opcode != SpvOpBranchConditional && inst->opcode != SpvOpSwitch)
        return false;
    uint32_t word = *cursor ? *cursor + 1 : inst->opcode == SpvOpBranch ? 1 : 2;
    while (word < inst->count && !inst_word_is_id(module, inst, word))
        word++;
    if (word >= inst->count)
        return false;
    *cursor = word;
    *out_block = module->block_of[inst_word(module, inst, word)];
    return true;
}

const char *inst_text(const struct module *module, const struct inst *inst, uint32_t word)
{
    if (word >= inst->count)
        return "";
    const char *text = (const char *)(inst_words(module, inst) + word);
    return memchr(text, 0, (size_t)(inst->count - word) * 4) ? text : "";
}

const char *name_of(const struct module *module, uint32_t id)
{
    for (uint32_t i = 0; i < module->globals_end; i++) {
        const struct inst *inst = &module->insts[i];
        if (inst->opcode == SpvOpName && inst_word(module, inst, 1) == id) {
            const char *name = inst_text(module, inst, 2);
            return *name ? name : NULL;
        }
    }
    return NULL;
}

bool is_debug(const struct module *module, const struct inst *inst, uint32_t *out_number)
{
    if (inst->opcode != SpvOpExtInst)
        return false;
    const struct inst *set = definition_of(module, inst_word(module, inst, 3));
    if (!set || set->opcode != SpvOpExtInstImport)
        return false;
    const char *name = inst_text(module, set, 2);
    if (strncmp(name, "NonSemantic.", 12) != 0 && strncmp(name, "OpenCL.DebugInfo", 16) != 0 && strcmp(name, "DebugInfo") != 0)
        return false;
    *out_number = strncmp(name, "NonSemantic.Shader.DebugInfo.", 29) == 0 ||
                          strncmp(name, "OpenCL.DebugInfo", 16) == 0 || strcmp(name, "DebugInfo") == 0
                      ? inst_word(module, inst, 4)
                      : NONE;
    return true;
}

bool constant_u32(const struct module *module, uint32_t id, uint32_t *out)
{
    const struct inst *inst = definition_of(module, id);
    if (!inst)
        return false;
    const struct inst *type = definition_of(module, inst->type);
    if (!type || (type->opcode != SpvOpTypeInt && type->opcode != SpvOpTypeFloat) || inst_word(module, type, 2) != 32)
        return false;
    if (inst->opcode == SpvOpConstant && inst->count == 4)
        *out = inst_word(module, inst, 3);
    else if (inst->opcode == SpvOpConstantNull)
        *out = 0;
    else
        return false;
    return true;
}

/* Parsing */

struct gathering {
    struct module *module;
    uint32_t offset, capacity;
    bool out_of_memory;
};

static spv_result_t on_header(void *user, spv_endianness_t endian, uint32_t magic, uint32_t version, uint32_t generator,
                              uint32_t bound, uint32_t reserved)
{
    (void)endian, (void)magic, (void)version, (void)generator, (void)reserved;
    struct gathering *gathering = user;
    gathering->module->bound = bound;
    gathering->offset = 5;
    return SPV_SUCCESS;
}

static bool is_id(spv_operand_type_t type)
{
    return type == SPV_OPERAND_TYPE_ID || type == SPV_OPERAND_TYPE_TYPE_ID || type == SPV_OPERAND_TYPE_RESULT_ID ||
           type == SPV_OPERAND_TYPE_MEMORY_SEMANTICS_ID || type == SPV_OPERAND_TYPE_SCOPE_ID;
}

static spv_result_t on_instruction(void *user, const spv_parsed_instruction_t *parsed)
{
    struct gathering *gathering = user;
    struct module *module = gathering->module;
    if (module->inst_count == gathering->capacity)
        return SPV_ERROR_INTERNAL;
    module->insts[module->inst_count++] = (struct inst){.offset = gathering->offset,
                                                        .count = parsed->num_words,
                                                        .opcode = parsed->opcode,
                                                        .type = parsed->type_id,
                                                        .result = parsed->result_id};
    for (uint16_t i = 0; i < parsed->num_operands; i++)
        if (is_id(parsed->operands[i].type)) {
            uint32_t word = gathering->offset + parsed->operands[i].offset;
            module->id_words[word / 8] |= (uint8_t)(1u << (word % 8));
        }
    gathering->offset += parsed->num_words;
    return SPV_SUCCESS;
}

/* Instructions by their lengths; 0 when these do not add up. */
static uint32_t count_instructions(const uint32_t *words, uint32_t word_count)
{
    uint32_t count = 0;
    for (uint32_t at = 5; at < word_count; count++) {
        uint32_t length = words[at] >> 16;
        if (length == 0 || length > word_count - at)
            return 0;
        at += length;
    }
    return count;
}

static bool index_ids(struct module *module)
{
    for (uint32_t i = 0; i < module->bound; i++)
        module->definition[i] = module->block_of[i] = module->function_of[i] = NONE;
    for (uint32_t i = 0; i < module->inst_count; i++) {
        const struct inst *inst = &module->insts[i];
        for (uint32_t w = 1; w < inst->count; w++)
            if (inst_word_is_id(module, inst, w) && inst_word(module, inst, w) >= module->bound) {
                say(module, "id %u at word %u, where the module's bound allows ids below %u",
                    inst_word(module, inst, w), inst->offset + w, module->bound);
                return false;
            }
        if (inst->result)
            module->definition[inst->result] = i;
        module->reads_positions |=
            inst->opcode == SpvOpCapability && inst_word(module, inst, 1) == SpvCapabilityRayTracingPositionFetchKHR;
    }
    return true;
}

/* SPIRV-Tools' validator reads the block around DebugFunctionDefinition without asking whether there is one. */
static bool needs_block(const struct module *module, const struct inst *inst)
{
    uint32_t number;
    return inst->opcode != SpvOpLine && inst->opcode != SpvOpNoLine &&
           (inst->opcode != SpvOpExtInst ||
            (is_debug(module, inst, &number) && number == NonSemanticShaderDebugInfo100DebugFunctionDefinition));
}

/* Functions and blocks in the order of the module; counts only while the arrays are NULL. */
static bool nest(struct module *module)
{
    struct function *function = NULL, unused_function;
    struct block *block = NULL, unused_block;
    module->function_count = module->block_count = 0;
    module->globals_end = module->inst_count;
    for (uint32_t i = 0; i < module->inst_count; i++) {
        const struct inst *inst = &module->insts[i];
        const char *expected = NULL;
        if (inst->opcode == SpvOpFunction) {
            if (function)
                expected = "OpFunctionEnd before the next function";
            else {
                if (module->function_count == 0)
                    module->globals_end = i;
                function = module->functions ? &module->functions[module->function_count] : &unused_function;
                *function = (struct function){.id = inst->result, .first = i, .first_block = module->block_count,
                                              .first_parameter = NONE};
                if (module->functions)
                    module->function_of[inst->result] = module->function_count;
                module->function_count++;
            }
        } else if (inst->opcode == SpvOpFunctionEnd) {
            if (!function || block)
                expected = "a function whose last block has ended";
            else {
                function->last = i;
                function = NULL;
            }
        } else if (inst->opcode == SpvOpFunctionParameter) {
            if (!function || function->block_count || block)
                expected = "parameters between OpFunction and the first block";
            else {
                if (function->parameter_count++ == 0)
                    function->first_parameter = i;
            }
        } else if (inst->opcode == SpvOpLabel) {
            if (!function || block)
                expected = "a label inside of a function, after the end of the block before";
            else {
                block = module->blocks ? &module->blocks[module->block_count] : &unused_block;
                *block = (struct block){.id = inst->result, .first = i, .merge = NONE,
                                        .function = module->function_count - 1};
                if (module->blocks)
                    module->block_of[inst->result] = module->block_count;
                module->block_count++;
                function->block_count++;
            }
        } else if (is_terminator(inst->opcode)) {
            if (!block)
                expected = "a terminator inside of a block";
            else {
                block->last = i;
                block = NULL;
            }
        } else if (inst->opcode == SpvOpLoopMerge || inst->opcode == SpvOpSelectionMerge) {
            if (!block || block->merge != NONE)
                expected = "one merge instruction inside of a block";
            else
                block->merge = i;
        } else if (module->function_count && !block && needs_block(module, inst)) {
            expected = "instructions inside of blocks";
        }
        if (expected) {
            say(module, "expected %s, found opcode %u at word %u", expected, inst->opcode, inst->offset);
            return false;
        }
    }
    if (function) {
        say(module, "the last function has no OpFunctionEnd");
        return false;
    }
    /* Lines before the first function belong to it. */
    while (module->globals_end > 0 && module->globals_end < module->inst_count &&
           (module->insts[module->globals_end - 1].opcode == SpvOpLine ||
            module->insts[module->globals_end - 1].opcode == SpvOpNoLine))
        module->globals_end--;
    return true;
}

/* Merge and branch targets are labels of the same function, and a merge instruction comes right before the terminator. */
static bool check_targets(struct module *module)
{
    for (uint32_t b = 0; b < module->block_count; b++) {
        const struct block *block = &module->blocks[b];
        const struct inst *last = &module->insts[block->last];
        uint32_t cursor = 0, to;
        while (next_successor(module, block, &cursor, &to))
            if (to == NONE || module->blocks[to].function != block->function) {
                say(module, "the branch at word %u goes to %%%u, which is not a block of its function", last->offset,
                    inst_word(module, last, cursor));
                return false;
            }
        if (block->merge == NONE)
            continue;
        const struct inst *merge = &module->insts[block->merge];
        uint32_t targets = merge->opcode == SpvOpLoopMerge ? 2 : 1;
        for (uint32_t w = 1; w <= targets; w++) {
            uint32_t target = module->block_of[inst_word(module, merge, w)];
            if (target == NONE || module->blocks[target].function != block->function) {
                say(module, "the merge instruction at word %u names %%%u, which is not a block of its function",
                    merge->offset, inst_word(module, merge, w));
                return false;
            }
        }
        if (block->merge + 1 != block->last ||
            (last->opcode != SpvOpBranch && last->opcode != SpvOpBranchConditional && last->opcode != SpvOpSwitch)) {
            say(module, "the merge instruction at word %u is not followed by a branch", merge->offset);
            return false;
        }
    }
    return true;
}

enum gn_spirv_status module_parse(struct module *module, struct arena *arena, const uint32_t *words, size_t word_count,
                                  char *message, size_t message_size)
{
    enum gn_spirv_status status = GN_SPIRV_INVALID;
    spv_diagnostic diagnostic = NULL;
    spv_context context = NULL;
    *module = (struct module){.arena = arena, .words = words, .message = message, .message_size = message_size};
    if (!words || word_count < 5 || word_count > MAX_WORDS) {
        say(module, "a module has 5 to %u words, this has %zu", MAX_WORDS, word_count);
        goto done;
    }
    module->word_count = (uint32_t)word_count;
    if (words[0] == __builtin_bswap32(SpvMagicNumber)) {
        say(module, "the module is in the other byte order");
        status = GN_SPIRV_DECLINED;
        goto done;
    }
    if (words[0] != SpvMagicNumber) {
        say(module, "expected the magic number 0x%08x, found 0x%08x", SpvMagicNumber, words[0]);
        goto done;
    }
    if (words[3] == 0 || words[3] > MAX_BOUND) {
        say(module, "expected a bound of ids from 1 to %u, found %u", MAX_BOUND, words[3]);
        goto done;
    }
    struct gathering gathering = {.module = module, .capacity = count_instructions(words, module->word_count)};
    if (gathering.capacity == 0) {
        say(module, "the lengths of the instructions do not add up to the module's %u words", module->word_count);
        goto done;
    }
    status = GN_SPIRV_OUT_OF_MEMORY;
    module->insts = arena_alloc(arena, gathering.capacity, sizeof *module->insts);
    module->id_words = arena_alloc(arena, word_count / 8 + 1, 1);
    module->definition = arena_alloc(arena, words[3], sizeof *module->definition);
    module->block_of = arena_alloc(arena, words[3], sizeof *module->block_of);
    module->function_of = arena_alloc(arena, words[3], sizeof *module->function_of);
    context = spvContextCreate(SPV_ENV_UNIVERSAL_1_6);
    if (!module->insts || !module->id_words || !module->definition || !module->block_of || !module->function_of || !context)
        goto done;
    spv_result_t result = spvBinaryParse(context, &gathering, words, word_count, on_header, on_instruction, &diagnostic);
    if (result != SPV_SUCCESS) {
        /* An extension newer than SPIRV-Tools is no mistake of the module. */
        uint32_t opcode = gathering.offset < module->word_count ? words[gathering.offset] & 0xFFFF : SpvOpNop;
        status = result == SPV_ERROR_OUT_OF_MEMORY                      ? GN_SPIRV_OUT_OF_MEMORY
                 : strcmp(spvOpcodeString(opcode), "unknown") == 0 || opcode == SpvOpCapability ? GN_SPIRV_DECLINED
                                                                        : GN_SPIRV_INVALID;
        say(module, "%s (at word %zu)", diagnostic && diagnostic->error ? diagnostic->error : "not SPIR-V",
            diagnostic ? diagnostic->position.index : 0);
        goto done;
    }
    status = GN_SPIRV_INVALID;
    if (!index_ids(module) || !nest(module))
        goto done;
    status = GN_SPIRV_OUT_OF_MEMORY;
    module->functions = arena_alloc(arena, module->function_count + 1u, sizeof *module->functions);
    module->blocks = arena_alloc(arena, module->block_count + 1u, sizeof *module->blocks);
    if (!module->functions || !module->blocks)
        goto done;
    status = nest(module) && check_targets(module) ? GN_SPIRV_UNTOUCHED : GN_SPIRV_INVALID;
done:
    if (status == GN_SPIRV_OUT_OF_MEMORY)
        say(module, "out of memory");
    spvDiagnosticDestroy(diagnostic);
    spvContextDestroy(context);
    return status;
}

static spv_result_t tools_validate(const uint32_t *words, size_t word_count, spv_target_env environment, bool relaxed,
                                   char *out_message, size_t message_size)
{
    spv_result_t result = SPV_ERROR_OUT_OF_MEMORY;
    spv_diagnostic diagnostic = NULL;
    spv_context context = spvContextCreate(environment);
    spv_validator_options options = spvValidatorOptionsCreate();
    if (!context || !options) {
        snprintf(out_message, message_size, "out of memory");
        goto done;
    }
    spvValidatorOptionsSetSkipBlockLayout(options, relaxed);
    spvValidatorOptionsSetRelaxLogicalPointer(options, relaxed);
    spv_const_binary_t binary = {words, word_count};
    result = spvValidateWithOptions(context, options, &binary, &diagnostic);
    if (result != SPV_SUCCESS)
        snprintf(out_message, message_size, "SPIRV-Tools: %s", diagnostic && diagnostic->error ? diagnostic->error : "not valid");
done:
    spvDiagnosticDestroy(diagnostic);
    spvValidatorOptionsDestroy(options);
    spvContextDestroy(context);
    return result;
}

/* SPIRV-Tools decides what is valid SPIR-V; the layout of buffers is no concern here and left out. */
enum gn_spirv_status module_validate(const struct module *module)
{
    switch (tools_validate(module->words, module->word_count, SPV_ENV_UNIVERSAL_1_6, true, module->message,
                           module->message_size)) {
    case SPV_SUCCESS: return GN_SPIRV_UNTOUCHED;
    case SPV_ERROR_OUT_OF_MEMORY: return GN_SPIRV_OUT_OF_MEMORY;
    default: return GN_SPIRV_INVALID;
    }
}

bool gn_spirv_validate(const uint32_t *words, size_t word_count, uint32_t vulkan_minor, char *out_message,
                       size_t message_size)
{
    spv_target_env environment = vulkan_minor == 0   ? SPV_ENV_UNIVERSAL_1_6
                                 : vulkan_minor <= 2 ? SPV_ENV_VULKAN_1_2
                                                     : SPV_ENV_VULKAN_1_3;
    struct module module;
    struct arena arena = {NULL};
    bool valid = module_parse(&module, &arena, words, word_count, out_message, message_size) == GN_SPIRV_UNTOUCHED &&
                 tools_validate(words, word_count, environment, vulkan_minor == 0, out_message, message_size) == SPV_SUCCESS;
    arena_finish(&arena);
    return valid;
}

uint32_t *gn_spirv_round_trip(const uint32_t *words, size_t word_count, size_t *out_count, char *out_message,
                              size_t message_size)
{
    struct arena arena = {NULL};
    struct module module;
    uint32_t *copy = NULL;
    size_t at = 5;
    if (module_parse(&module, &arena, words, word_count, out_message, message_size) != GN_SPIRV_UNTOUCHED)
        goto done;
    copy = malloc(word_count * sizeof *copy);
    if (!copy)
        goto done;
    memcpy(copy, words, 5 * sizeof *copy);
    for (uint32_t i = 0; i < module.inst_count && at + module.insts[i].count <= word_count; i++) {
        memcpy(copy + at, inst_words(&module, &module.insts[i]), module.insts[i].count * sizeof *copy);
        at += module.insts[i].count;
    }
    *out_count = at;
done:
    arena_finish(&arena);
    return copy;
}

bool gn_spirv_has_queries(const uint32_t *words, size_t word_count)
{
    bool pipeline = false;
    if (!words || word_count < 5 || words[0] != SpvMagicNumber)
        return false;
    for (size_t at = 5; at < word_count;) {
        uint32_t length = words[at] >> 16, opcode = words[at] & 0xFFFF;
        if (length == 0 || length > word_count - at)
            return false;
        bool positions = opcode == SpvOpCapability && length > 1 && words[at + 1] == SpvCapabilityRayTracingPositionFetchKHR;
        if (opcode == SpvOpTypeRayQueryKHR || positions || (pipeline && operation_of(opcode)))
            return true;
        pipeline |= opcode == SpvOpCapability && length > 1 &&
                    (words[at + 1] == SpvCapabilityRayTracingKHR || words[at + 1] == SpvCapabilityRayTracingNV);
        if (opcode == SpvOpFunction && !pipeline)
            return false;
        at += length;
    }
    return false;
}
