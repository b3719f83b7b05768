/* SPDX-License-Identifier: Apache-2.0 */
/* What constant operands prove. A value is known when it is a constant of the module; specialization constants may still
 * change and are not. */
#include <math.h>
#include <string.h>

#include "checks/spirv/analysis.h"

#define MAX_DEPTH 8

/* A scalar of a float vector, if it is constant. */
static bool component(const struct module *module, uint32_t id, uint32_t index, float *out)
{
    for (int depth = 0; depth < MAX_DEPTH; depth++) {
        const struct inst *inst = definition_of(module, id);
        const struct inst *type = inst ? definition_of(module, inst->type) : NULL;
        if (!type)
            return false;
        switch (inst->opcode) {
        case SpvOpBitcast: {
            uint32_t bits;
            if (type->opcode != SpvOpTypeFloat || !constant_u32(module, inst_word(module, inst, 3), &bits))
                return false;
            memcpy(out, &bits, sizeof *out);
            return true;
        }
        case SpvOpCopyObject: id = inst_word(module, inst, 3); continue;
        case SpvOpLoad:
            if (!module->alias || !(id = module->alias[id]))
                return false;
            continue;
        case SpvOpConstantNull: *out = 0; return true;
        case SpvOpConstant: {
            uint32_t bits;
            if (type->opcode != SpvOpTypeFloat || !constant_u32(module, id, &bits))
                return false;
            memcpy(out, &bits, sizeof *out);
            return true;
        }
        case SpvOpConstantComposite:
        case SpvOpCompositeConstruct:
            /* Only of scalars: a vector made of vectors does not say which word is which component. */
            if (type->opcode != SpvOpTypeVector || inst->count != 3 + inst_word(module, type, 3) || index + 3 >= inst->count)
                return false;
            id = inst_word(module, inst, 3 + index);
            continue;
        default: return false;
        }
    }
    return false;
}

#define MAX_VALUES 8

/* The values that an integer may have, where all are constants: a selected one, one of a phi, a combination of flags. */
static bool possible_values(const struct module *module, uint32_t id, int depth, uint32_t out[MAX_VALUES], uint32_t *count)
{
    const struct inst *inst = definition_of(module, id);
    uint32_t value, sides[2][MAX_VALUES], counts[2] = {0, 0};
    if (constant_u32(module, id, &value)) {
        for (uint32_t i = 0; i < *count; i++)
            if (out[i] == value)
                return true;
        if (*count == MAX_VALUES)
            return false;
        out[(*count)++] = value;
        return true;
    }
    if (!inst || depth > 4)
        return false;
    switch (inst->opcode) {
    case SpvOpCopyObject:
    case SpvOpBitcast: return possible_values(module, inst_word(module, inst, 3), depth + 1, out, count);
    case SpvOpLoad: return module->alias && module->alias[id] && possible_values(module, module->alias[id], depth + 1, out, count);
    case SpvOpSelect:
        return possible_values(module, inst_word(module, inst, 4), depth + 1, out, count) &&
               possible_values(module, inst_word(module, inst, 5), depth + 1, out, count);
    case SpvOpPhi:
        if (inst->count > 3 + 2 * MAX_VALUES)
            return false;
        for (uint32_t w = 3; w < inst->count; w += 2)
            if (!possible_values(module, inst_word(module, inst, w), depth + 1, out, count))
                return false;
        return true;
    case SpvOpBitwiseOr:
        for (uint32_t side = 0; side < 2; side++)
            if (!possible_values(module, inst_word(module, inst, 3 + side), depth + 1, sides[side], &counts[side]))
                return false;
        for (uint32_t i = 0; i < counts[0] * counts[1]; i++) {
            if (*count == MAX_VALUES)
                return false;
            out[(*count)++] = sides[0][i / counts[1]] | sides[1][i % counts[1]];
        }
        return true;
    default: return false;
    }
}

bool operands_flags(const struct module *module, const struct inst *inst, uint32_t *out)
{
    return constant_u32(module, inst_word(module, inst, 3), out);
}

uint32_t known_flags(const struct module *module)
{
    uint32_t flags = 0x3FF;
    for (uint32_t i = 0; i < module->inst_count && module->insts[i].opcode == SpvOpCapability; i++)
        if (inst_word(module, &module->insts[i], 1) == SpvCapabilityRayTracingOpacityMicromapEXT)
            flags |= SpvRayFlagsForceOpacityMicromap2StateEXTMask;
    return flags;
}

static bool several(uint32_t bits)
{
    return (bits & (bits - 1)) != 0;
}

static void settle(struct operand_verdict *verdict, uint64_t rule, bool broken, bool known)
{
    if (broken)
        verdict->wrong |= rule;
    else if (known)
        verdict->right |= rule;
}

/* Proved only if it is the same for every value. */
static void settle_all(struct operand_verdict *verdict, uint64_t rule, const uint32_t *values, uint32_t count,
                       bool (*broken)(uint32_t value))
{
    uint32_t wrong = 0;
    for (uint32_t i = 0; i < count; i++)
        wrong += broken(values[i]);
    settle(verdict, rule, wrong == count, wrong == 0);
}

static bool skips_both(uint32_t flags)
{
    return (flags & 0x300) == 0x300;
}

static bool culls_twice(uint32_t flags)
{
    return several(flags & 0x130);
}

static bool forces_twice(uint32_t flags)
{
    return several(flags & 0xC3);
}

static bool any_bit(uint32_t bits)
{
    return bits != 0;
}

/* Some of the bits above `low` are set, but not all: a complement, as ~1, is meant. */
static bool some_beyond(uint32_t value, uint32_t low)
{
    return value > low && value < ~low;
}

static bool beyond_a_byte(uint32_t mask)
{
    return some_beyond(mask, 0xFF);
}

struct ray_words ray_words_of(const struct operation *operation)
{
    uint32_t w = operation->ray_word;
    if (operation->kind == OPERATION_INITIALIZE)
        return (struct ray_words){.flags = w, .mask = w + 1, .origin = w + 2, .tmin = w + 3, .direction = w + 4, .tmax = w + 5};
    bool motion = operation->kind == OPERATION_TRACE_MOTION;
    return (struct ray_words){.flags = w,
                              .mask = w + 1,
                              .sbt_offset = w + 2,
                              .sbt_stride = w + 3,
                              .miss = w + 4,
                              .origin = w + 5,
                              .tmin = w + 6,
                              .direction = w + 7,
                              .tmax = w + 8,
                              .time = motion ? w + 9 : 0,
                              .payload = w + (motion ? 10 : 9)};
}

enum form { FORM_INTEGER, FORM_FLOAT, FORM_VECTOR };

/* Of 32 bits, all. */
static bool has_form(const struct module *module, uint32_t id, enum form form)
{
    const struct inst *value = definition_of(module, id), *type = value ? definition_of(module, value->type) : NULL;
    if (form == FORM_VECTOR) {
        if (!type || type->opcode != SpvOpTypeVector || inst_word(module, type, 3) != 3)
            return false;
        type = definition_of(module, inst_word(module, type, 2));
    }
    if (!type || inst_word(module, type, 2) != 32)
        return false;
    return form == FORM_INTEGER ? type->opcode == SpvOpTypeInt : type->opcode == SpvOpTypeFloat && type->count == 3;
}

uint32_t operands_unfit(const struct module *module, const struct inst *inst, const struct operation *operation)
{
    const enum operation_kind kind = operation->kind;
    const struct ray_words ray = operation->ray_word ? ray_words_of(operation) : (struct ray_words){0};
    /* 0 for the words that the operation does not have. */
    const struct {
        uint32_t word;
        enum form form;
    } read[] = {{ray.flags, FORM_INTEGER},
                {ray.mask, FORM_INTEGER},
                {ray.sbt_offset, FORM_INTEGER},
                {ray.sbt_stride, FORM_INTEGER},
                {ray.miss, FORM_INTEGER},
                {ray.origin, FORM_VECTOR},
                {ray.tmin, FORM_FLOAT},
                {ray.direction, FORM_VECTOR},
                {ray.tmax, FORM_FLOAT},
                {ray.time, FORM_FLOAT},
                {kind == OPERATION_GENERATE ? 2 : 0, FORM_FLOAT},
                {kind == OPERATION_REPORT ? 3 : 0, FORM_FLOAT},
                {kind == OPERATION_REPORT ? 4 : 0, FORM_INTEGER},
                {kind == OPERATION_CALL ? 1 : 0, FORM_INTEGER}};
    for (size_t i = 0; i < sizeof read / sizeof read[0]; i++)
        if (read[i].word && !has_form(module, inst_word(module, inst, read[i].word), read[i].form))
            return read[i].word;
    return kind == OPERATION_PROCEED && opcode_of(module, inst->type) != SpvOpTypeBool ? 1 : 0;
}

/* The rules of a ray, in the numbers of Initialize. */
static struct operand_verdict judge_ray(const struct module *module, const struct inst *inst, const struct ray_words *ray)
{
    struct operand_verdict verdict = {0, 0};
    uint32_t flags[MAX_VALUES], masks[MAX_VALUES], count = 0;
    if (possible_values(module, inst_word(module, inst, ray->flags), 0, flags, &count)) {
        settle_all(&verdict, RULE_BIT(INITIALIZE_SKIP_BOTH), flags, count, skips_both);
        settle_all(&verdict, RULE_BIT(INITIALIZE_CULL_PAIR), flags, count, culls_twice);
        settle_all(&verdict, RULE_BIT(INITIALIZE_OPACITY_PAIR), flags, count, forces_twice);
        for (uint32_t i = 0; i < count; i++)
            flags[i] &= ~known_flags(module);
        settle_all(&verdict, RULE_BIT(INITIALIZE_UNKNOWN_FLAGS), flags, count, any_bit);
    }
    count = 0;
    if (possible_values(module, inst_word(module, inst, ray->mask), 0, masks, &count))
        settle_all(&verdict, RULE_BIT(INITIALIZE_MASK_BITS), masks, count, beyond_a_byte);

    bool has_nan = false, has_infinity = false, all_known = true, direction_known = true, direction_zero = true,
         direction_nonzero = false;
    for (uint32_t i = 0; i < 6; i++) {
        float value;
        if (component(module, inst_word(module, inst, i < 3 ? ray->origin : ray->direction), i % 3, &value)) {
            has_nan |= isnan(value);
            has_infinity |= isinf(value);
            direction_zero &= i < 3 || value == 0;
            direction_nonzero |= i >= 3 && value != 0;
        } else {
            all_known = false;
            direction_known &= i < 3;
        }
    }
    float tmin = 0, tmax = 0;
    bool tmin_known = component(module, inst_word(module, inst, ray->tmin), 0, &tmin);
    bool tmax_known = component(module, inst_word(module, inst, ray->tmax), 0, &tmax);
    has_nan |= (tmin_known && isnan(tmin)) || (tmax_known && isnan(tmax));
    settle(&verdict, RULE_BIT(INITIALIZE_NAN), has_nan, all_known && tmin_known && tmax_known);
    settle(&verdict, RULE_BIT(INITIALIZE_INFINITE), has_infinity, all_known);
    settle(&verdict, RULE_BIT(INITIALIZE_NEGATIVE_T), (tmin_known && tmin < 0) || (tmax_known && tmax < 0),
           tmin_known && tmax_known);
    settle(&verdict, RULE_BIT(INITIALIZE_T_ORDER), tmin_known && tmax_known && tmin > tmax, tmin_known && tmax_known);
    settle(&verdict, RULE_BIT(INITIALIZE_ZERO_DIRECTION), direction_known && direction_zero,
           direction_known || direction_nonzero);
    return verdict;
}

/* Bytes of a type as they count for payloads and attributes: each part at the alignment of its scalars. False where that is
 * not told (booleans, or arrays of unknown length). */
static bool bytes_of(const struct module *module, uint32_t type, uint32_t depth, uint64_t *out_size, uint64_t *out_alignment)
{
    const struct inst *inst = definition_of(module, type);
    uint64_t size = 0, alignment = 1;
    uint32_t length;
    if (!inst || depth > MAX_DEPTH)
        return false;
    switch (inst->opcode) {
    case SpvOpTypeInt:
    case SpvOpTypeFloat: *out_size = *out_alignment = inst_word(module, inst, 2) / 8; return *out_size != 0;
    case SpvOpTypePointer:
        *out_size = *out_alignment = 8;
        return inst_word(module, inst, 2) == SpvStorageClassPhysicalStorageBuffer;
    case SpvOpTypeVector:
    case SpvOpTypeMatrix:
    case SpvOpTypeArray:
        length = inst_word(module, inst, 3);
        if (inst->opcode == SpvOpTypeArray && !constant_u32(module, length, &length))
            return false;
        if (!bytes_of(module, inst_word(module, inst, 2), depth + 1, out_size, out_alignment))
            return false;
        *out_size *= length;
        return *out_size <= UINT32_MAX;
    case SpvOpTypeStruct:
        *out_size = 0;
        *out_alignment = 1;
        for (uint32_t w = 2; w < inst->count; w++) {
            if (!bytes_of(module, inst_word(module, inst, w), depth + 1, &size, &alignment))
                return false;
            *out_size = (*out_size + alignment - 1) / alignment * alignment + size;
            *out_alignment = alignment > *out_alignment ? alignment : *out_alignment;
            if (*out_size > UINT32_MAX)
                return false;
        }
        *out_size = (*out_size + *out_alignment - 1) / *out_alignment * *out_alignment;
        return true;
    default: return false;
    }
}

static bool bytes_of_variable(const struct module *module, uint32_t id, uint64_t *out)
{
    const struct inst *variable = definition_of(module, id);
    const struct inst *pointer = variable ? definition_of(module, variable->type) : NULL;
    uint64_t alignment;
    return pointer && variable->opcode == SpvOpVariable && pointer->opcode == SpvOpTypePointer &&
           bytes_of(module, inst_word(module, pointer, 3), 0, out, &alignment);
}

static void judge_narrow(const struct module *module, uint32_t id, uint32_t low, uint64_t rule, struct operand_verdict *verdict)
{
    uint32_t value;
    if (constant_u32(module, id, &value))
        settle(verdict, rule, some_beyond(value, low), true);
}

static struct operand_verdict judge_trace(const struct analysis *analysis, const struct inst *inst,
                                          const struct operation *operation)
{
    const struct module *module = analysis->module;
    const struct gn_spirv_options *options = analysis->options;
    const struct ray_words words = ray_words_of(operation);
    struct operand_verdict verdict = judge_ray(module, inst, &words);
    uint32_t flags;
    uint64_t bytes;
    float time;
    verdict.wrong <<= RULES_OF_RAY_TO_TRACE;
    verdict.right <<= RULES_OF_RAY_TO_TRACE;
    judge_narrow(module, inst_word(module, inst, words.sbt_offset), 0xF, RULE_BIT(TRACE_SBT_OFFSET_BITS), &verdict);
    judge_narrow(module, inst_word(module, inst, words.sbt_stride), 0xF, RULE_BIT(TRACE_SBT_STRIDE_BITS), &verdict);
    judge_narrow(module, inst_word(module, inst, words.miss), 0xFFFF, RULE_BIT(TRACE_MISS_BITS), &verdict);
    bool time_known = words.time && component(module, inst_word(module, inst, words.time), 0, &time);
    settle(&verdict, RULE_BIT(TRACE_TIME), time_known && !(time >= 0 && time <= 1), time_known || !words.time);
    bool flags_known = constant_u32(module, inst_word(module, inst, words.flags), &flags);
    settle(&verdict, RULE_BIT(TRACE_SKIPPED_BY_PIPELINE), flags_known && (flags & options->forbidden_ray_flags),
           flags_known || !options->forbidden_ray_flags);
    bool bytes_known = options->max_payload && bytes_of_variable(module, inst_word(module, inst, words.payload), &bytes);
    settle(&verdict, RULE_BIT(TRACE_PAYLOAD_SIZE), bytes_known && bytes > options->max_payload, true);
    return verdict;
}

static struct operand_verdict judge_report(const struct analysis *analysis, const struct inst *inst)
{
    const struct module *module = analysis->module;
    struct operand_verdict verdict = {0, 0};
    uint32_t kind;
    float t;
    if (constant_u32(module, inst_word(module, inst, 4), &kind))
        settle(&verdict, RULE_BIT(REPORT_HIT_KIND), kind > 127, true);
    if (component(module, inst_word(module, inst, 3), 0, &t))
        settle(&verdict, RULE_BIT(REPORT_NAN), isnan(t), true);
    bool too_large = false;
    for (uint32_t i = 0; analysis->options->max_attribute && i < module->globals_end; i++) {
        const struct inst *variable = &module->insts[i];
        uint64_t bytes;
        too_large |= variable->opcode == SpvOpVariable && inst_word(module, variable, 3) == SpvStorageClassHitAttributeKHR &&
                     bytes_of_variable(module, variable->result, &bytes) && bytes > analysis->options->max_attribute;
    }
    settle(&verdict, RULE_BIT(REPORT_ATTRIBUTE_SIZE), too_large, true);
    return verdict;
}

struct operand_verdict operands_judge(const struct analysis *analysis, const struct inst *inst)
{
    const struct module *module = analysis->module;
    const struct operation *operation = operation_at(analysis->module, inst);
    struct operand_verdict verdict = {0, 0};
    float t;
    switch (operation->kind) {
    case OPERATION_INITIALIZE: {
        const struct ray_words words = ray_words_of(operation);
        return judge_ray(module, inst, &words);
    }
    case OPERATION_TRACE:
    case OPERATION_TRACE_MOTION: return judge_trace(analysis, inst, operation);
    case OPERATION_REPORT: return judge_report(analysis, inst);
    case OPERATION_GENERATE:
        if (component(module, inst_word(module, inst, 2), 0, &t))
            settle(&verdict, RULE_BIT(GENERATE_RANGE), isnan(t) || t < 0, false);
        return verdict;
    default: return verdict;
    }
}
