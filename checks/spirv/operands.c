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

static struct operand_verdict judge_initialize(const struct module *module, const struct inst *inst)
{
    struct operand_verdict verdict = {0, 0};
    uint32_t flags, mask;
    if (operands_flags(module, inst, &flags)) {
        settle(&verdict, RULE_BIT(INITIALIZE_SKIP_BOTH), (flags & 0x300) == 0x300, true);
        settle(&verdict, RULE_BIT(INITIALIZE_CULL_PAIR), several(flags & 0x130), true);
        settle(&verdict, RULE_BIT(INITIALIZE_OPACITY_PAIR), several(flags & 0xC3), true);
        settle(&verdict, RULE_BIT(INITIALIZE_UNKNOWN_FLAGS), flags & ~known_flags(module), true);
    }
    if (constant_u32(module, inst_word(module, inst, 4), &mask))
        settle(&verdict, RULE_BIT(INITIALIZE_MASK_BITS), (mask & ~0xFFu) && mask != UINT32_MAX, true);

    bool has_nan = false, has_infinity = false, all_known = true, direction_known = true, direction_zero = true,
         direction_nonzero = false;
    for (uint32_t i = 0; i < 6; i++) {
        float value;
        if (component(module, inst_word(module, inst, i < 3 ? 5 : 7), i % 3, &value)) {
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
    bool tmin_known = component(module, inst_word(module, inst, 6), 0, &tmin);
    bool tmax_known = component(module, inst_word(module, inst, 8), 0, &tmax);
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

struct operand_verdict operands_judge(const struct analysis *analysis, const struct inst *inst)
{
    const struct module *module = analysis->module;
    if (inst->opcode == SpvOpRayQueryInitializeKHR)
        return judge_initialize(module, inst);
    struct operand_verdict verdict = {0, 0};
    float t;
    if (inst->opcode == SpvOpRayQueryGenerateIntersectionKHR && component(module, inst_word(module, inst, 2), 0, &t))
        settle(&verdict, RULE_BIT(GENERATE_RANGE), isnan(t) || t < 0, false);
    return verdict;
}
