/* SPDX-License-Identifier: Apache-2.0 */
/* Changes operands and results of instructions in a SPIR-V module. */
#include <stdlib.h>
#include <string.h>

#define SPV_ENABLE_UTILITY_CODE
#include <spirv/unified1/spirv.h>

#include "tests/faulty/faulty.h"

/* An inline function of the header: its definition goes here. */
extern void SpvHasResultAndType(SpvOp opcode, bool *has_result, bool *has_type);

enum { HEAD_WORDS = 5, BOUND_WORD = 3, GLSL_FCLAMP = 43, GLSL_NORMALIZE = 69, MOST_NEW_WORDS = 40 };

struct words {
    uint32_t *list;
    size_t count, capacity;
};

struct rewrite {
    const struct gn_fault_edit *edits;
    uint32_t bound, ids; /* now, and in the module as it came */
    uint32_t stage; /* the execution model of its entry point */
    uint32_t incoming_payload; /* the variable, 0 for none */
    uint32_t uint_type, float_type, bool_type, glsl;
    uint32_t uint_constants[64][2], uint_constant_count; /* value, id */
    uint32_t *types; /* by id: of what the id names, 0 where unknown */
    uint32_t *built_ins; /* by id of a variable: its built-in plus 1 */
    uint32_t *elements; /* by id of an array or vector type: the type of its elements */
    struct words out, constants;
};

static void put(struct words *words, uint32_t word)
{
    if (words->count == words->capacity) {
        words->capacity = words->capacity ? 2 * words->capacity : 1024;
        words->list = realloc(words->list, words->capacity * sizeof *words->list);
        if (!words->list)
            abort();
    }
    words->list[words->count++] = word;
}

static void emit(struct words *words, SpvOp opcode, size_t count, const uint32_t *operands)
{
    put(words, (uint32_t)(count + 1) << 16 | (uint32_t)opcode);
    for (size_t i = 0; i < count; i++)
        put(words, operands[i]);
}

#define EMIT(words, opcode, ...)                                                                             \
    emit(words, opcode, sizeof((uint32_t[]){__VA_ARGS__}) / 4, (uint32_t[]){__VA_ARGS__})

static uint32_t constant(struct rewrite *rewrite, uint32_t type, uint32_t value)
{
    const uint32_t id = rewrite->bound++;
    EMIT(&rewrite->constants, SpvOpConstant, type, id, value);
    return id;
}

/* The variable that is a built-in; 0 where there is none. */
static uint32_t variable_of(const struct rewrite *rewrite, uint32_t builtin)
{
    for (uint32_t id = 0; id < rewrite->ids; id++)
        if (rewrite->built_ins[id] == builtin + 1)
            return id;
    return 0;
}

/* The changed value of `from` as a new id, or as `wanted` where that is not 0; written before or after the site. */
static uint32_t change(struct rewrite *rewrite, const struct gn_fault_edit *edit, uint32_t type, uint32_t from,
                       uint32_t wanted)
{
    const uint32_t to = wanted ? wanted : rewrite->bound++;
    const uint32_t u = rewrite->uint_type;
    struct words *out = &rewrite->out;
    switch (edit->change) {
    case GN_FAULT_AND:
        EMIT(out, SpvOpBitwiseAnd, type, to, from, constant(rewrite, u, edit->value));
        break;
    case GN_FAULT_OR:
        EMIT(out, SpvOpBitwiseOr, type, to, from, constant(rewrite, u, edit->value));
        break;
    case GN_FAULT_XOR:
        EMIT(out, SpvOpBitwiseXor, type, to, from, constant(rewrite, u, edit->value));
        break;
    case GN_FAULT_CLAMP_TO_RANGE: {
        const uint32_t least = variable_of(rewrite, SpvBuiltInRayTminKHR), most = variable_of(rewrite, SpvBuiltInRayTmaxKHR);
        if (!least || !most)
            return from;
        const uint32_t low = rewrite->bound++, high = rewrite->bound++;
        EMIT(out, SpvOpLoad, type, low, least);
        EMIT(out, SpvOpLoad, type, high, most);
        EMIT(out, SpvOpExtInst, type, to, rewrite->glsl, GLSL_FCLAMP, from, low, high);
        break;
    }
    case GN_FAULT_TAKE_INCOMING_PAYLOAD:
        return rewrite->incoming_payload ? rewrite->incoming_payload : from;
    case GN_FAULT_SWAP_BITS: {
        const uint32_t one = constant(rewrite, u, 1), low = constant(rewrite, u, edit->value);
        const uint32_t rest = constant(rewrite, u, ~(3 * edit->value)), up = rewrite->bound++, ups = rewrite->bound++,
                       down = rewrite->bound++, downs = rewrite->bound++, kept = rewrite->bound++,
                       both = rewrite->bound++;
        EMIT(out, SpvOpBitwiseAnd, u, up, from, low);
        EMIT(out, SpvOpShiftLeftLogical, u, ups, up, one);
        EMIT(out, SpvOpShiftRightLogical, u, down, from, one);
        EMIT(out, SpvOpBitwiseAnd, u, downs, down, low);
        EMIT(out, SpvOpBitwiseAnd, u, kept, from, rest);
        EMIT(out, SpvOpBitwiseOr, u, both, ups, downs);
        EMIT(out, SpvOpBitwiseOr, type, to, both, kept);
        break;
    }
    case GN_FAULT_ADD_ULPS: {
        const uint32_t bits = rewrite->bound++, sum = rewrite->bound++;
        EMIT(out, SpvOpBitcast, u, bits, from);
        EMIT(out, SpvOpIAdd, u, sum, bits, constant(rewrite, u, edit->value));
        EMIT(out, SpvOpBitcast, type, to, sum);
        break;
    }
    case GN_FAULT_MULTIPLY: {
        const uint32_t factor = rewrite->bound++;
        EMIT(out, SpvOpBitcast, type, factor, constant(rewrite, u, edit->value));
        EMIT(out, SpvOpFMul, type, to, from, factor);
        break;
    }
    case GN_FAULT_SET_FLOAT:
        EMIT(out, SpvOpBitcast, type, to, constant(rewrite, u, edit->value));
        break;
    case GN_FAULT_NOT:
        EMIT(out, SpvOpLogicalNot, type, to, from);
        break;
    case GN_FAULT_SWAP_XY:
        EMIT(out, SpvOpVectorShuffle, type, to, from, from, 1, 0);
        break;
    case GN_FAULT_ROTATE_ARRAY: {
        uint32_t parts[3];
        for (uint32_t i = 0; i < 3; i++) {
            parts[i] = rewrite->bound++;
            EMIT(out, SpvOpCompositeExtract, rewrite->elements[type], parts[i], from, i);
        }
        EMIT(out, SpvOpCompositeConstruct, type, to, parts[1], parts[2], parts[0]);
        break;
    }
    case GN_FAULT_NORMALIZE:
        EMIT(out, SpvOpExtInst, type, to, rewrite->glsl, GLSL_NORMALIZE, from);
        break;
    default:
        return from;
    }
    return to;
}

/* What has to be known of types, constants and decorations before anything is changed. */
static void survey(struct rewrite *rewrite, const uint32_t *words, size_t count)
{
    for (size_t at = HEAD_WORDS; at < count && words[at] >> 16; at += words[at] >> 16) {
        const uint32_t *w = &words[at];
        bool has_result, has_type;
        SpvHasResultAndType((SpvOp)(w[0] & 0xFFFF), &has_result, &has_type);
        if (has_result && has_type)
            rewrite->types[w[2]] = w[1];
        switch (w[0] & 0xFFFF) {
        case SpvOpEntryPoint:
            rewrite->stage = w[1];
            break;
        case SpvOpVariable:
            if (w[3] == SpvStorageClassIncomingRayPayloadKHR)
                rewrite->incoming_payload = w[2];
            break;
        case SpvOpExtInstImport:
            if (strcmp((const char *)&w[2], "GLSL.std.450") == 0)
                rewrite->glsl = w[1];
            break;
        case SpvOpTypeInt:
            if (w[2] == 32 && w[3] == 0)
                rewrite->uint_type = w[1];
            break;
        case SpvOpTypeArray:
        case SpvOpTypeVector:
            rewrite->elements[w[1]] = w[2];
            break;
        case SpvOpDecorate:
            if (w[2] == SpvDecorationBuiltIn)
                rewrite->built_ins[w[1]] = w[3] + 1;
            break;
        case SpvOpConstant:
            if (rewrite->uint_constant_count < 64 && w[0] >> 16 == 4) {
                rewrite->uint_constants[rewrite->uint_constant_count][0] = w[3];
                rewrite->uint_constants[rewrite->uint_constant_count++][1] = w[2];
            }
            break;
        default:
            break;
        }
    }
}

static bool applies(const struct rewrite *rewrite, const struct gn_fault_edit *edit, const uint32_t *w)
{
    if (edit->opcode != (w[0] & 0xFFFF) || (edit->stage && edit->stage != rewrite->stage + 1))
        return false;
    if (edit->opcode == SpvOpDecorate)
        return w[2] == SpvDecorationBuiltIn && w[3] == edit->builtin;
    return edit->opcode != SpvOpLoad || rewrite->built_ins[w[3]] == edit->builtin + 1;
}

/* The constant itself where it is a literal of a small set: glslang's 0 and 1. */
static uint32_t constant_known(const struct rewrite *rewrite, uint32_t value)
{
    for (uint32_t i = 0; i < rewrite->uint_constant_count; i++)
        if (rewrite->uint_constants[i][0] == value)
            return rewrite->uint_constants[i][1];
    return 0;
}

static bool instruction(struct rewrite *rewrite, const uint32_t *words)
{
    uint32_t w[MOST_NEW_WORDS];
    const uint32_t length = words[0] >> 16;
    bool changed = false;
    if (length > MOST_NEW_WORDS) {
        for (uint32_t i = 0; i < length; i++)
            put(&rewrite->out, words[i]);
        return false;
    }
    memcpy(w, words, length * sizeof *w);
    const struct gn_fault_edit *result = NULL;
    for (const struct gn_fault_edit *edit = rewrite->edits; edit < rewrite->edits + GN_FAULT_MAX_EDITS && edit->change;
         edit++) {
        if (!applies(rewrite, edit, w))
            continue;
        changed = true;
        if (edit->change == GN_FAULT_REMOVE)
            return true;
        if (edit->change == GN_FAULT_SET_OPCODE)
            w[0] = length << 16 | edit->value;
        else if (edit->change == GN_FAULT_SET_BUILTIN)
            w[3] = edit->value;
        else if (edit->change == GN_FAULT_SET_INTERSECTION)
            w[4] = constant_known(rewrite, edit->value);
        else if (edit->word)
            w[edit->word] = change(rewrite, edit, rewrite->types[w[edit->word]], w[edit->word], 0);
        else
            result = edit;
    }
    const uint32_t wanted = w[2];
    if (result)
        w[2] = rewrite->bound++;
    for (uint32_t i = 0; i < length; i++)
        put(&rewrite->out, w[i]);
    if (result)
        change(rewrite, result, w[1], w[2], wanted);
    return changed;
}

uint32_t *gn_fault_shader(const struct gn_fault_edit *edits, const uint32_t *words, size_t count, size_t *out_count)
{
    struct rewrite rewrite = {.edits = edits, .bound = words[BOUND_WORD], .ids = words[BOUND_WORD]};
    const size_t ids = rewrite.bound;
    size_t at = HEAD_WORDS, functions = 0;
    bool changed = false;
    rewrite.types = calloc(ids, sizeof *rewrite.types);
    rewrite.built_ins = calloc(ids, sizeof *rewrite.built_ins);
    rewrite.elements = calloc(ids, sizeof *rewrite.elements);
    if (!rewrite.types || !rewrite.built_ins || !rewrite.elements)
        abort();
    survey(&rewrite, words, count);
    for (size_t i = 0; i < HEAD_WORDS; i++)
        put(&rewrite.out, words[i]);
    for (; at < count && words[at] >> 16; at += words[at] >> 16) {
        if ((words[at] & 0xFFFF) == SpvOpFunction && !functions)
            functions = rewrite.out.count;
        changed = instruction(&rewrite, &words[at]) || changed;
    }
    uint32_t *module = NULL;
    if (changed && functions) {
        /* New constants come before the first function. */
        *out_count = rewrite.out.count + rewrite.constants.count;
        module = malloc(*out_count * sizeof *module);
        if (!module)
            abort();
        memcpy(module, rewrite.out.list, functions * sizeof *module);
        if (rewrite.constants.count)
            memcpy(module + functions, rewrite.constants.list, rewrite.constants.count * sizeof *module);
        memcpy(module + functions + rewrite.constants.count, rewrite.out.list + functions,
               (rewrite.out.count - functions) * sizeof *module);
        module[BOUND_WORD] = rewrite.bound;
    }
    free(rewrite.types);
    free(rewrite.built_ins);
    free(rewrite.elements);
    free(rewrite.out.list);
    free(rewrite.constants.list);
    return module;
}
