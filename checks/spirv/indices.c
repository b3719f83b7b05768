/* SPDX-License-Identifier: Apache-2.0 */
/* Whether an array of queries is always indexed by the same value, although no constant: then it is one query for all that is to be known of
 * it. A value is settled when it cannot change while the array exists: a constant, an input of the invocation, what only the host
 * writes, what the first block of the array's function (of the entry point, for a global array) computes, and what is computed of
 * these. */
#include "checks/spirv/analysis.h"

#define MAX_DEPTH 8
#define MAX_STEPS (1u << 16)

struct comparison {
    const struct module *module;
    uint32_t function; /* that runs once in the array's life, or NONE */
    const uint32_t *stored_by; /* per id of a variable: the only instruction that stores to it, or NONE */
    uint32_t steps;
};

static bool decorated(const struct module *module, uint32_t id, uint32_t decoration, uint32_t *out)
{
    for (uint32_t i = 0; i < module->globals_end; i++) {
        const struct inst *inst = &module->insts[i];
        if (inst->opcode == SpvOpDecorate && inst_word(module, inst, 1) == id && inst_word(module, inst, 2) == decoration) {
            *out = inst_word(module, inst, 3);
            return true;
        }
    }
    return false;
}

/* A variable that the shader only reads, and that nobody changes while it runs. */
static bool variable_is_settled(const struct module *module, const struct inst *variable)
{
    uint32_t builtin, unused;
    const struct inst *pointer = definition_of(module, variable->type);
    switch (inst_word(module, variable, 3)) {
    case SpvStorageClassPushConstant: return true;
    case SpvStorageClassUniform: return pointer && decorated(module, inst_word(module, pointer, 3), SpvDecorationBlock, &unused);
    case SpvStorageClassInput:
        if (!decorated(module, variable->result, SpvDecorationBuiltIn, &builtin))
            return decorated(module, variable->result, SpvDecorationLocation, &unused);
        /* Others may change in the middle of a shader: after a trace, or when lanes leave. */
        return builtin == SpvBuiltInGlobalInvocationId || builtin == SpvBuiltInLocalInvocationId ||
               builtin == SpvBuiltInLocalInvocationIndex || builtin == SpvBuiltInWorkgroupId || builtin == SpvBuiltInLaunchIdKHR ||
               builtin == SpvBuiltInVertexIndex || builtin == SpvBuiltInInstanceIndex;
    default: return false;
    }
}

static bool is_constant(uint32_t opcode)
{
    return opcode >= SpvOpConstantTrue && opcode <= SpvOpSpecConstantOp;
}

/* Operations on integers whose result depends on nothing but their operands. */
static bool is_pure(uint32_t opcode)
{
    switch (opcode) {
    case SpvOpIAdd:
    case SpvOpISub:
    case SpvOpIMul:
    case SpvOpUDiv:
    case SpvOpSDiv:
    case SpvOpUMod:
    case SpvOpSMod:
    case SpvOpSRem:
    case SpvOpBitwiseAnd:
    case SpvOpBitwiseOr:
    case SpvOpBitwiseXor:
    case SpvOpShiftLeftLogical:
    case SpvOpShiftRightLogical:
    case SpvOpBitcast:
    case SpvOpUConvert:
    case SpvOpSConvert:
    case SpvOpCompositeExtract: return true;
    default: return false;
    }
}

/* In the first block of that function, or a parameter of it. */
static bool runs_once(const struct comparison *comparison, const struct inst *inst)
{
    if (comparison->function == NONE)
        return false;
    const struct function *function = &comparison->module->functions[comparison->function];
    uint32_t at = (uint32_t)(inst - comparison->module->insts);
    return function->block_count && at > function->first && at < comparison->module->blocks[function->first_block].last;
}

static bool same(struct comparison *comparison, uint32_t a, uint32_t b, int depth);

/* The ids of both have the same settled values, and their other words are the same; from word `first` on. */
static bool same_operands(struct comparison *comparison, const struct inst *a, const struct inst *b, uint32_t first, int depth)
{
    const struct module *module = comparison->module;
    for (uint32_t w = first; w < a->count; w++) {
        bool is_id = inst_word_is_id(module, a, w);
        if (is_id != inst_word_is_id(module, b, w) ||
            (is_id ? !same(comparison, inst_word(module, a, w), inst_word(module, b, w), depth + 1)
                   : inst_word(module, a, w) != inst_word(module, b, w)))
            return false;
    }
    return true;
}

/* The value of a load from a variable that is written once, in the entry block before it; else the id itself. */
static uint32_t value_of(const struct comparison *comparison, uint32_t id)
{
    const struct module *module = comparison->module;
    for (int depth = 0; depth < MAX_DEPTH; depth++) {
        const struct inst *inst = definition_of(module, id);
        if (inst && inst->opcode == SpvOpCopyObject) {
            id = inst_word(module, inst, 3);
            continue;
        }
        const struct inst *variable = inst && inst->opcode == SpvOpLoad ? definition_of(module, inst_word(module, inst, 3)) : NULL;
        if (!variable || variable->opcode != SpvOpVariable || comparison->stored_by[variable->result] == NONE)
            break;
        const struct inst *store = &module->insts[comparison->stored_by[variable->result]];
        if (!runs_once(comparison, store) || store > inst)
            break;
        id = inst_word(module, store, 2);
    }
    return id;
}

/* Two pointers to the same memory, which is settled. */
static bool same_memory(struct comparison *comparison, uint32_t a, uint32_t b, int depth)
{
    const struct module *module = comparison->module;
    const struct inst *first = definition_of(module, a), *second = definition_of(module, b);
    if (!first || !second || depth > MAX_DEPTH || first->opcode != second->opcode || first->count != second->count)
        return false;
    if (first->opcode == SpvOpVariable)
        return a == b && variable_is_settled(module, first);
    return (first->opcode == SpvOpAccessChain || first->opcode == SpvOpInBoundsAccessChain) &&
           same_memory(comparison, inst_word(module, first, 3), inst_word(module, second, 3), depth + 1) &&
           same_operands(comparison, first, second, 4, depth);
}

static bool same(struct comparison *comparison, uint32_t a, uint32_t b, int depth)
{
    const struct module *module = comparison->module;
    a = value_of(comparison, a);
    b = value_of(comparison, b);
    const struct inst *first = definition_of(module, a), *second = definition_of(module, b);
    if (!first || !second || depth > MAX_DEPTH || ++comparison->steps > MAX_STEPS)
        return false;
    if (a == b && (is_constant(first->opcode) || runs_once(comparison, first)))
        return true;
    if (first->opcode != second->opcode || first->type != second->type || first->count != second->count)
        return false;
    switch (first->opcode) {
    case SpvOpConstant: return same_operands(comparison, first, second, 3, depth);
    case SpvOpLoad:
        return first->count == 4 && same_memory(comparison, inst_word(module, first, 3), inst_word(module, second, 3), depth + 1);
    default: return is_pure(first->opcode) && same_operands(comparison, first, second, 3, depth);
    }
}

/* Per variable of a function the only instruction that stores to it, where nothing else may. */
static uint32_t *find_stores(const struct module *module)
{
    uint32_t *stored_by = arena_alloc(module->arena, module->bound, sizeof *stored_by);
    bool *several = arena_alloc(module->arena, module->bound, sizeof *several);
    if (!stored_by || !several)
        return NULL;
    for (uint32_t id = 0; id < module->bound; id++)
        stored_by[id] = NONE;
    for (uint32_t i = 0; i < module->inst_count; i++) {
        const struct inst *inst = &module->insts[i];
        uint32_t number;
        if (inst->opcode == SpvOpName || inst->opcode == SpvOpDecorate || inst->opcode == SpvOpLoad || is_debug(module, inst, &number))
            continue;
        if (inst->opcode == SpvOpVariable) {
            several[inst->result] |= inst_word(module, inst, 3) != SpvStorageClassFunction || inst->count > 4;
            continue;
        }
        for (uint32_t w = 1; w < inst->count; w++) {
            uint32_t id = inst_word(module, inst, w);
            if (!inst_word_is_id(module, inst, w) || opcode_of(module, id) != SpvOpVariable)
                continue;
            if (inst->opcode == SpvOpStore && w == 1 && inst->count == 3 && stored_by[id] == NONE)
                stored_by[id] = i;
            else
                several[id] = true;
        }
    }
    for (uint32_t id = 0; id < module->bound; id++)
        if (several[id])
            stored_by[id] = NONE;
    return stored_by;
}

/* Nobody may call an entry point, so that it runs once. NONE where there are several. */
static uint32_t entry_function(const struct module *module)
{
    uint32_t found = NONE;
    for (uint32_t i = 0; i < module->globals_end; i++)
        if (module->insts[i].opcode == SpvOpEntryPoint) {
            if (found != NONE)
                return NONE;
            found = module->function_of[inst_word(module, &module->insts[i], 2)];
        }
    return found;
}

bool indices_same(struct analysis *analysis, uint32_t function, const uint32_t *a, const uint32_t *b, uint32_t count)
{
    struct comparison comparison = {.module = analysis->module, .steps = analysis->index_steps};
    comparison.function = function == NONE ? entry_function(analysis->module) : function;
    bool all = true;
    if (!analysis->stored_by && !(analysis->stored_by = find_stores(analysis->module)))
        return false;
    comparison.stored_by = analysis->stored_by;
    for (uint32_t i = 0; i < count; i++)
        all &= same(&comparison, a[i], b[i], 0);
    analysis->index_steps = comparison.steps;
    return all;
}
