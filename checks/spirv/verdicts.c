/* SPDX-License-Identifier: Apache-2.0 */
/* Turns the states in which an operation may be reached into a verdict per rule: proved right, wrong whenever reached, or
 * to be checked on the device. */
#include "checks/spirv/analysis.h"

static uint32_t stages_of(const struct analysis *analysis, const struct site *site)
{
    return analysis->stages[analysis->module->blocks[site->block].function];
}

/* A rule of the protocol and the states that break it. */
struct breach {
    uint64_t rule; /* its index, then its bit */
    uint32_t states;
};

static uint32_t breaches_of(const struct site *site, struct breach out[4])
{
    uint32_t count = 0;
    enum operation_kind kind = site->operation->kind;
    enum operation_needs needs = site->operation->needs;
    if (kind == OPERATION_INITIALIZE || !site->operation->query_word)
        return 0;
    out[count++] = (struct breach){GN_SPIRV_RULE_UNINITIALIZED, STATE_UNINITIALIZED};
    switch (kind) {
    case OPERATION_PROCEED: out[count++] = (struct breach){GN_SPIRV_RULE_PROCEED_AFTER_FALSE, STATES_FINISHED}; break;
    case OPERATION_TERMINATE: out[count++] = (struct breach){GN_SPIRV_RULE_TERMINATE_AFTER_FALSE, STATES_FINISHED}; break;
    case OPERATION_CONFIRM:
        out[count++] = (struct breach){GN_SPIRV_RULE_CONFIRM_NO_CANDIDATE, STATES_NO_CANDIDATE};
        out[count++] = (struct breach){GN_SPIRV_RULE_CONFIRM_NOT_TRIANGLE, STATES_AT_AABB};
        break;
    case OPERATION_GENERATE:
        out[count++] = (struct breach){GN_SPIRV_RULE_GENERATE_NO_CANDIDATE, STATES_NO_CANDIDATE};
        out[count++] = (struct breach){GN_SPIRV_RULE_GENERATE_NOT_AABB, STATES_AT_TRIANGLE};
        break;
    case OPERATION_GET_AABB_OPAQUE:
        out[count++] = (struct breach){GN_SPIRV_RULE_CANDIDATE_NONE, STATES_NO_CANDIDATE};
        out[count++] = (struct breach){GN_SPIRV_RULE_CANDIDATE_NOT_AABB, STATES_AT_TRIANGLE};
        break;
    case OPERATION_GET_TYPE:
    case OPERATION_GET:
        if (!site->committed) {
            out[count++] = (struct breach){GN_SPIRV_RULE_CANDIDATE_NONE, STATES_NO_CANDIDATE};
            if (needs != NEEDS_NOTHING)
                out[count++] = (struct breach){GN_SPIRV_RULE_CANDIDATE_NOT_TRIANGLE, STATES_AT_AABB};
            break;
        }
        if (kind == OPERATION_GET)
            out[count++] = (struct breach){GN_SPIRV_RULE_COMMITTED_NONE,
                                           STATE_INITIALIZED | STATES_COMMITTED(COMMITTED_NOTHING)};
        if (needs == NEEDS_TRIANGLE)
            out[count++] =
                (struct breach){GN_SPIRV_RULE_COMMITTED_NOT_TRIANGLE, STATES_COMMITTED(COMMITTED_GENERATED)};
        break;
    default: break;
    }
    return count;
}

static uint64_t rules_of_structure(const struct analysis *analysis, const struct site *site)
{
    struct structure_operand operand;
    enum operation_kind kind = site->operation->kind;
    uint32_t word = kind == OPERATION_INITIALIZE ? 2 : kind == OPERATION_TRACE || kind == OPERATION_TRACE_MOTION ? 1 : 0;
    if (!word || !analysis->options->structures || !analysis->options->root ||
        !structure_operand_find(analysis->module, &analysis->module->insts[site->inst], word, &operand))
        return 0;
    return RULES_OF_STRUCTURE;
}

/* The rules that the operation's operands, or the pipeline it is in, may break. */
static uint64_t rules_of_operands(const struct analysis *analysis, const struct site *site)
{
    const struct gn_spirv_options *options = analysis->options;
    const uint64_t ray = ((UINT64_C(1) << RULES_OF_RAY) - 1) << GN_SPIRV_RULE_INITIALIZE_NAN;
    const uint64_t positions = options->structures && options->root ? RULE_BIT(STRUCTURE_NO_POSITIONS) : 0;
    uint64_t rules, of_structure = rules_of_structure(analysis, site);
    switch (site->operation->kind) {
    case OPERATION_INITIALIZE: return ray | of_structure;
    case OPERATION_PROCEED: return options->proceed_limit ? RULE_BIT(PROCEED_LIMIT) : 0;
    case OPERATION_GENERATE: return RULE_BIT(GENERATE_RANGE);
    case OPERATION_TRACE:
    case OPERATION_TRACE_MOTION:
        rules = ray << RULES_OF_RAY_TO_TRACE | RULE_BIT(TRACE_SBT_OFFSET_BITS) | RULE_BIT(TRACE_SBT_STRIDE_BITS) |
                RULE_BIT(TRACE_MISS_BITS) | of_structure;
        if (site->operation->kind == OPERATION_TRACE_MOTION)
            rules |= RULE_BIT(TRACE_TIME);
        if (options->forbidden_ray_flags)
            rules |= RULE_BIT(TRACE_SKIPPED_BY_PIPELINE);
        if (options->recursion_known && stages_of(analysis, site) != (STAGE_RAYGEN | STAGE_NESTED))
            rules |= RULE_BIT(TRACE_RECURSION);
        if (options->max_payload)
            rules |= RULE_BIT(TRACE_PAYLOAD_SIZE);
        return rules;
    case OPERATION_REPORT:
        rules = RULE_BIT(REPORT_HIT_KIND) | RULE_BIT(REPORT_NAN);
        return options->max_attribute ? rules | RULE_BIT(REPORT_ATTRIBUTE_SIZE) : rules;
    case OPERATION_CALL: return RULE_BIT(CALL_RANGE);
    case OPERATION_POSITIONS: return (hit_shaders_only(analysis->module) ? RULE_BIT(HIT_POSITIONS_OF_AABB) : 0) | positions;
    case OPERATION_GET:
        return analysis->module->insts[site->inst].opcode == SpvOpRayQueryGetIntersectionTriangleVertexPositionsKHR ? positions : 0;
    default: return 0;
    }
}

/* A ray generation shader runs at depth 0, any other that may trace at 1 or deeper; a trace invokes shaders one deeper. */
static void judge_recursion(const struct analysis *analysis, struct site *site)
{
    if (!(site->judged & RULE_BIT(TRACE_RECURSION)))
        return;
    uint32_t shallowest = stages_of(analysis, site) == STAGE_RAYGEN ? 1 : 2;
    if (shallowest > analysis->options->max_recursion)
        site->wrong |= RULE_BIT(TRACE_RECURSION);
    else if (shallowest == 1)
        site->checked &= ~RULE_BIT(TRACE_RECURSION);
}

/* What only the module decides: there is nothing to look at on the device. */
static uint64_t proved_only(const struct analysis *analysis, const struct site *site)
{
    uint64_t rules = RULE_BIT(TRACE_PAYLOAD_SIZE) | RULE_BIT(REPORT_ATTRIBUTE_SIZE);
    return stages_of(analysis, site) == STAGE_RAYGEN ? rules | RULE_BIT(TRACE_RECURSION) : rules;
}

static void verdict_make(struct analysis *analysis, struct site *site, uint64_t applicable)
{
    struct breach breaches[4];
    uint32_t count = breaches_of(site, breaches);
    for (uint32_t i = 0; i < count; i++) {
        breaches[i].rule = UINT64_C(1) << breaches[i].rule;
        site->judged |= breaches[i].rule;
    }
    uint32_t early = STATE_INITIALIZED | STATES_AT_CANDIDATE;
    bool reads_committed =
        site->committed && (site->operation->kind == OPERATION_GET || site->operation->kind == OPERATION_GET_TYPE);
    site->judged |= rules_of_operands(analysis, site);
    if (reads_committed)
        site->judged |= RULE_BIT(COMMITTED_TOO_EARLY);
    site->judged &= applicable;

    const struct operand_verdict operands = operands_judge(analysis, &analysis->module->insts[site->inst]);
    for (uint32_t i = 0; i < count; i++) {
        if (site->states & breaches[i].states)
            site->checked |= breaches[i].rule;
        if (site->states && !(site->states & ~breaches[i].states))
            site->wrong |= breaches[i].rule;
    }
    if (site->operation->kind == OPERATION_INITIALIZE ? site->states != 0 : !site->operation->query_word && site->reachable) {
        site->wrong |= operands.wrong;
        site->checked |= site->judged & ~operands.right;
        judge_recursion(analysis, site);
    }
    if (site->operation->kind == OPERATION_PROCEED && site->states)
        site->checked |= RULE_BIT(PROCEED_LIMIT);
    if (site->operation->kind == OPERATION_GET && site->states)
        site->checked |= RULE_BIT(STRUCTURE_NO_POSITIONS);
    if (site->operation->kind == OPERATION_GENERATE && (site->states & STATES_AT_AABB)) {
        site->wrong |= operands.wrong;
        site->checked |= RULE_BIT(GENERATE_RANGE);
    }
    if (reads_committed && (site->states & early)) {
        site->checked |= RULE_BIT(COMMITTED_TOO_EARLY);
        if (!(site->states & ~early))
            site->wrong |= RULE_BIT(COMMITTED_TOO_EARLY);
    }
    /* What is proved after an operation does not hold where that is skipped. */
    if (analysis->options->without_proofs || analysis->options->safe)
        site->checked = site->judged & ~proved_only(analysis, site);
    site->wrong &= site->judged;
    site->checked = (site->checked | site->wrong) & site->judged;
}

void verdicts_make(struct analysis *analysis)
{
    uint64_t applicable = 0;
    for (uint32_t rule = 0; rule < GN_SPIRV_RULE_COUNT; rule++)
        if (gn_spirv_rule_at(rule)->severity[analysis->options->profile] != GN_SEVERITY_SILENT &&
            !(analysis->options->disabled >> rule & 1))
            applicable |= UINT64_C(1) << rule;
    for (uint32_t s = 0; s < analysis->site_count; s++) {
        struct site *site = &analysis->sites[s];
        verdict_make(analysis, site, applicable);
        if (!site->reachable)
            site->checked = 0;
        site->first_check = analysis->check_count;
        analysis->check_count += (uint32_t)__builtin_popcountll(site->checked);
    }
}
