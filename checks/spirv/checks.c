/* SPDX-License-Identifier: Apache-2.0 */
/* The code that runs at an operation: a condition that is cheap where all is well, and behind it, the call that leaves
 * records. A check never does itself what the specification leaves undefined: it asks a query for its candidate only where
 * the shadow state says that there is one.
 *
 * The shadow state is a word per query (GN_RECORD_STATE_*, and above it the number of Proceeds where these are limited), and the tmax it
 * was initialized with where an intersection is generated. */
#include "checks/spirv/records.h"
#include "checks/spirv/writer.h"

#define INITIALIZED GN_RECORD_STATE_INITIALIZED
#define CANDIDATE GN_RECORD_STATE_CANDIDATE
#define FINISHED GN_RECORD_STATE_FINISHED

#define RULES_OF_STATE                                                                                                 \
    (RULE_BIT(UNINITIALIZED) | RULE_BIT(PROCEED_AFTER_FALSE) | RULE_BIT(TERMINATE_AFTER_FALSE) |                       \
     RULE_BIT(CANDIDATE_NONE) | RULE_BIT(CONFIRM_NO_CANDIDATE) | RULE_BIT(GENERATE_NO_CANDIDATE) |                     \
     RULE_BIT(COMMITTED_TOO_EARLY) | RULE_BIT(PROCEED_LIMIT))
/* Rules that ask the query for its candidate or for what is committed. */
#define RULES_OF_CANDIDATE                                                                                             \
    (RULE_BIT(CANDIDATE_NOT_TRIANGLE) | RULE_BIT(CANDIDATE_NOT_AABB) | RULE_BIT(CONFIRM_NOT_TRIANGLE) |                \
     RULE_BIT(GENERATE_NOT_AABB) | RULE_BIT(GENERATE_RANGE))
#define RULES_OF_COMMITTED (RULE_BIT(COMMITTED_NONE) | RULE_BIT(COMMITTED_NOT_TRIANGLE))
/* Rules that ask the query for anything. */
#define RULES_OF_LIVE (RULES_OF_CANDIDATE | RULES_OF_COMMITTED | RULE_BIT(STRUCTURE_NO_POSITIONS))
#define RULES_OF_INITIALIZE (((UINT64_C(1) << RULES_OF_RAY) - 1) << GN_SPIRV_RULE_INITIALIZE_NAN)
#define RULES_OF_TRACED_RAY (RULES_OF_INITIALIZE << RULES_OF_RAY_TO_TRACE)

/* Conditions gathered at one site. */
struct gathered {
    uint32_t conditions[GN_SPIRV_RULE_COUNT]; /* per rule; 0 where not gathered */
    uint32_t any;                             /* their disjunction, 0 while there is none */
    uint32_t operands[GN_RECORD_OPERANDS];    /* 0 for none */
    const struct ray *ray;                    /* for the rules of a ray, and */
    uint32_t state;                           /* for those of the protocol, whose conditions are computed only where `any` holds */
};

static void either(struct writer *writer, uint32_t *any, uint32_t condition)
{
    *any = *any ? COMPUTE(writer, SpvOpLogicalOr, type_bool(writer), *any, condition) : condition;
}

static void gather(struct writer *writer, struct gathered *gathered, uint32_t rule, uint32_t condition)
{
    gathered->conditions[rule] = condition;
    either(writer, &gathered->any, condition);
}

/* Whether the states in which the site may be reached leave no doubt that its live getters are legal. */
static bool live_getters_legal(const struct site *site)
{
    return !(site->states & (site->committed ? STATE_UNINITIALIZED : STATE_UNINITIALIZED | STATES_NO_CANDIDATE));
}

bool checks_need_state(const struct site *site)
{
    return (site->checked & RULES_OF_STATE) ||
           ((site->checked & RULES_OF_LIVE) && site->root != NONE && !live_getters_legal(site));
}

/* (state & mask) == value */
static uint32_t state_is(struct writer *writer, uint32_t state, uint32_t mask, uint32_t value)
{
    uint32_t bits = COMPUTE(writer, SpvOpBitwiseAnd, type_uint(writer), state, constant_uint(writer, mask));
    return COMPUTE(writer, SpvOpIEqual, type_bool(writer), bits, constant_uint(writer, value));
}

/* What a rule of the protocol is broken by: (state & mask) == broken. At one operation there is one besides UNINITIALIZED. */
static const struct state_rule {
    uint32_t rule, mask, broken;
} state_rules[] = {
    {GN_SPIRV_RULE_UNINITIALIZED, INITIALIZED, 0},
    {GN_SPIRV_RULE_PROCEED_AFTER_FALSE, INITIALIZED | FINISHED, INITIALIZED | FINISHED},
    {GN_SPIRV_RULE_TERMINATE_AFTER_FALSE, INITIALIZED | FINISHED, INITIALIZED | FINISHED},
    {GN_SPIRV_RULE_CANDIDATE_NONE, INITIALIZED | CANDIDATE, INITIALIZED},
    {GN_SPIRV_RULE_CONFIRM_NO_CANDIDATE, INITIALIZED | CANDIDATE, INITIALIZED},
    {GN_SPIRV_RULE_GENERATE_NO_CANDIDATE, INITIALIZED | CANDIDATE, INITIALIZED},
    {GN_SPIRV_RULE_COMMITTED_TOO_EARLY, INITIALIZED | FINISHED, INITIALIZED},
};
#define STATE_RULE_COUNT (sizeof state_rules / sizeof state_rules[0])

static const struct state_rule *state_rule_of(uint32_t rule)
{
    for (size_t i = 0; i < STATE_RULE_COUNT; i++)
        if (state_rules[i].rule == rule)
            return &state_rules[i];
    return NULL;
}

/* One comparison, whether one or two rules are checked: what breaks neither is INITIALIZED without what breaks the other. Written with an
 * exclusive or, as the compiler of Mesa 25.0.7 never comes to an end over (state & mask) != fine. */
static void gather_states(struct writer *writer, const struct site *site, uint32_t state, struct gathered *gathered)
{
    const struct state_rule *other = NULL;
    bool uninitialized = site->checked & RULE_BIT(UNINITIALIZED);
    gathered->state = state;
    for (size_t i = 0; i < STATE_RULE_COUNT; i++)
        if (state_rules[i].rule != GN_SPIRV_RULE_UNINITIALIZED && site->checked >> state_rules[i].rule & 1)
            other = &state_rules[i];
    if (uninitialized && other) {
        uint32_t fine = constant_uint(writer, other->broken ^ other->mask ^ INITIALIZED);
        uint32_t bits = COMPUTE(writer, SpvOpBitwiseXor, type_uint(writer), state, fine);
        bits = COMPUTE(writer, SpvOpBitwiseAnd, type_uint(writer), bits, constant_uint(writer, other->mask));
        either(writer, &gathered->any, COMPUTE(writer, SpvOpINotEqual, type_bool(writer), bits, constant_uint(writer, 0)));
    } else if (uninitialized) {
        either(writer, &gathered->any, state_is(writer, state, INITIALIZED, 0));
    } else if (other) {
        either(writer, &gathered->any, state_is(writer, state, other->mask, other->broken));
    }
    if (site->checked & RULE_BIT(PROCEED_LIMIT)) {
        uint32_t limit = writer->analysis->options->proceed_limit;
        uint32_t full = limit < UINT32_MAX / GN_RECORD_STATE_PROCEEDS ? limit * GN_RECORD_STATE_PROCEEDS : UINT32_MAX;
        uint32_t reached =
            COMPUTE(writer, SpvOpUGreaterThanEqual, type_bool(writer), state, constant_uint(writer, full));
        gather(writer, gathered, GN_SPIRV_RULE_PROCEED_LIMIT, reached);
    }
}

static uint32_t type_getter(struct writer *writer, uint32_t query, bool committed)
{
    return COMPUTE(writer, SpvOpRayQueryGetIntersectionTypeKHR, type_uint(writer), query, constant_uint(writer, committed));
}

static uint32_t both(struct writer *writer, uint32_t opcode, uint32_t a, uint32_t b)
{
    return COMPUTE(writer, opcode, type_bool(writer), a, b);
}

static uint32_t masked(struct writer *writer, uint32_t value, uint32_t mask)
{
    return COMPUTE(writer, SpvOpBitwiseAnd, type_uint(writer), value, constant_uint(writer, mask));
}

#define EXPONENT 0x7F800000u
/* HitKindFrontFacingTriangleKHR; the other kind of triangle is one above, and nothing else is. */
#define HIT_KIND_FRONT_FACING 0xFEu

/* Integers decide, not floating-point comparisons: these may be compiled under the assumption that there are no NaNs. */
static uint32_t is_nan(struct writer *writer, uint32_t bits)
{
    uint32_t magnitude = masked(writer, bits, 0x7FFFFFFFu);
    return both(writer, SpvOpUGreaterThan, magnitude, constant_uint(writer, EXPONENT));
}

/* t in [tmin, T committed so far]; NaN is not. Leaves t, tmin and that T as operands. */
static uint32_t out_of_range(struct writer *writer, uint32_t query, uint32_t t, uint32_t operands[3])
{
    uint32_t float_ = type_float(writer), bool_ = type_bool(writer), uint_ = type_uint(writer);
    uint32_t tmin = COMPUTE(writer, SpvOpRayQueryGetRayTMinKHR, float_, query);
    uint32_t tmax = shadow_load(writer, query, SHADOW_TMAX);
    uint32_t type = type_getter(writer, query, true);
    struct branch hit;
    branch_begin(writer, COMPUTE(writer, SpvOpINotEqual, bool_, type, constant_uint(writer, 0)), &hit);
    uint32_t committed = COMPUTE(writer, SpvOpRayQueryGetIntersectionTKHR, float_, query, constant_uint(writer, 1));
    branch_end(writer, &hit);
    uint32_t current = branch_phi(writer, &hit, float_, committed, tmax);
    uint32_t above = COMPUTE(writer, SpvOpFOrdGreaterThanEqual, bool_, t, tmin);
    uint32_t below = COMPUTE(writer, SpvOpFOrdLessThanEqual, bool_, t, current);
    uint32_t inside = COMPUTE(writer, SpvOpLogicalAnd, bool_, above, below);
    operands[0] = COMPUTE(writer, SpvOpBitcast, uint_, t);
    inside = COMPUTE(writer, SpvOpLogicalAnd, bool_, inside,
                     COMPUTE(writer, SpvOpLogicalNot, bool_, is_nan(writer, operands[0])));
    operands[1] = COMPUTE(writer, SpvOpBitcast, uint_, tmin);
    operands[2] = COMPUTE(writer, SpvOpBitcast, uint_, current);
    return COMPUTE(writer, SpvOpLogicalNot, bool_, inside);
}

/* Whether nobody may read vertex positions of what is there, whose type is `type`. Leaves the instance and the structure's id as operands. */
static uint32_t positions_missing(struct writer *writer, uint32_t query, bool committed, uint32_t type, uint32_t operands[2])
{
    uint32_t bool_ = type_bool(writer), uint_ = type_uint(writer), one = constant_uint(writer, 1), zero = constant_uint(writer, 0);
    uint32_t none = constant_plain(writer, SpvOpConstantFalse, bool_), all_bits = constant_uint(writer, UINT32_MAX);
    uint32_t id = shadow_load(writer, query, SHADOW_STRUCTURE), word = structures_load(writer, id);
    uint32_t all = state_is(writer, word, GN_STRUCTURE_NO_POSITIONS, GN_STRUCTURE_NO_POSITIONS);
    uint32_t list = COMPUTE(writer, SpvOpShiftRightLogical, uint_, word, constant_uint(writer, GN_STRUCTURE_LIST_SHIFT));
    uint32_t triangle = both(writer, SpvOpIEqual, type, committed ? one : zero);
    struct branch listed;
    branch_begin(writer, both(writer, SpvOpLogicalAnd, triangle, both(writer, SpvOpINotEqual, list, zero)), &listed);
    uint32_t which = constant_uint(writer, committed), instance = 0;
    instance = COMPUTE(writer, SpvOpRayQueryGetIntersectionInstanceIdKHR, uint_, query, which);
    uint32_t inside = both(writer, SpvOpULessThan, instance, structures_load(writer, list));
    uint32_t at = COMPUTE(writer, SpvOpShiftRightLogical, uint_, instance, constant_uint(writer, 5));
    at = COMPUTE(writer, SpvOpIAdd, uint_, at, COMPUTE(writer, SpvOpIAdd, uint_, list, one));
    at = COMPUTE(writer, SpvOpSelect, uint_, inside, at, list);
    uint32_t bit = COMPUTE(writer, SpvOpShiftLeftLogical, uint_, one, masked(writer, instance, 31));
    bit = COMPUTE(writer, SpvOpBitwiseAnd, uint_, bit, structures_load(writer, at));
    uint32_t found = both(writer, SpvOpLogicalAnd, inside, both(writer, SpvOpINotEqual, bit, zero));
    branch_end(writer, &listed);
    found = branch_phi(writer, &listed, bool_, found, none);
    operands[0] = branch_phi(writer, &listed, uint_, instance, all_bits);
    operands[1] = id;
    return both(writer, SpvOpLogicalAnd, triangle, both(writer, SpvOpLogicalOr, all, found));
}

/* What the query itself has to be asked for. */
static void gather_live(struct writer *writer, const struct site *site, uint32_t state, struct gathered *gathered)
{
    const struct inst *inst = &writer->module->insts[site->inst];
    uint32_t query = inst_word(writer->module, inst, site->operation->query_word);
    uint64_t rules = site->checked & RULES_OF_LIVE;
    uint32_t bool_ = type_bool(writer);
    uint32_t false_ = constant_plain(writer, SpvOpConstantFalse, bool_);
    uint32_t found[GN_SPIRV_RULE_COUNT] = {0}, operands[GN_RECORD_OPERANDS] = {0};
    struct branch guard;
    if (!rules)
        return;
    bool guarded = !live_getters_legal(site);
    if (guarded) {
        uint32_t needs = site->committed ? INITIALIZED : INITIALIZED | CANDIDATE;
        branch_begin(writer, state_is(writer, state, needs, needs), &guard);
    }
    uint32_t type = type_getter(writer, query, site->committed);
    uint32_t uint_zero = constant_uint(writer, 0);
    for (uint32_t rule = 0; rule < GN_SPIRV_RULE_COUNT; rule++) {
        if (!(rules >> rule & 1))
            continue;
        switch (rule) {
        case GN_SPIRV_RULE_CANDIDATE_NOT_TRIANGLE:
        case GN_SPIRV_RULE_CONFIRM_NOT_TRIANGLE:
            found[rule] = COMPUTE(writer, SpvOpINotEqual, bool_, type, uint_zero);
            break;
        case GN_SPIRV_RULE_CANDIDATE_NOT_AABB:
        case GN_SPIRV_RULE_GENERATE_NOT_AABB:
        case GN_SPIRV_RULE_COMMITTED_NONE: found[rule] = COMPUTE(writer, SpvOpIEqual, bool_, type, uint_zero); break;
        case GN_SPIRV_RULE_COMMITTED_NOT_TRIANGLE:
            found[rule] = COMPUTE(writer, SpvOpIEqual, bool_, type, constant_uint(writer, COMMITTED_GENERATED));
            break;
        case GN_SPIRV_RULE_GENERATE_RANGE:
            found[rule] = out_of_range(writer, query, inst_word(writer->module, inst, 2), operands);
            break;
        case GN_SPIRV_RULE_STRUCTURE_NO_POSITIONS: {
            uint32_t about[2];
            found[rule] = positions_missing(writer, query, site->committed, type, about);
            operands[6] = about[0];
            operands[9] = about[1];
            break;
        }
        default: break;
        }
    }
    if (guarded)
        branch_end(writer, &guard);
    for (uint32_t rule = 0; rule < GN_SPIRV_RULE_COUNT && guarded; rule++)
        if (found[rule])
            found[rule] = branch_phi(writer, &guard, bool_, found[rule], false_);
    for (int i = 0; i < GN_RECORD_OPERANDS; i++)
        if (operands[i])
            gathered->operands[i] =
                guarded ? branch_phi(writer, &guard, type_uint(writer), operands[i], uint_zero) : operands[i];
    for (uint32_t rule = 0; rule < GN_SPIRV_RULE_COUNT; rule++)
        if (found[rule])
            gather(writer, gathered, rule, found[rule]);
}

/* Initialize */

struct ray {
    uint32_t flags, mask, vectors[2], t[2]; /* ids: origin and direction, tmin and tmax */
    uint32_t vector_bits[2], t_bits[2];     /* as integers without their sign (vectors), or as they are (t) */
};

static uint32_t any_component(struct writer *writer, uint32_t opcode, uint32_t bits, uint32_t value)
{
    uint32_t each = COMPUTE(writer, opcode, type_bool3(writer), bits, constant_uint3(writer, value));
    return COMPUTE(writer, SpvOpAny, type_bool(writer), each);
}

/* More than one bit is set. */
static uint32_t several(struct writer *writer, uint32_t bits)
{
    uint32_t less = COMPUTE(writer, SpvOpISub, type_uint(writer), bits, constant_uint(writer, 1));
    uint32_t left = COMPUTE(writer, SpvOpBitwiseAnd, type_uint(writer), bits, less);
    return COMPUTE(writer, SpvOpINotEqual, type_bool(writer), left, constant_uint(writer, 0));
}

static uint32_t zero_vector(struct writer *writer, uint32_t bits)
{
    uint32_t each = COMPUTE(writer, SpvOpIEqual, type_bool3(writer), bits, constant_uint3(writer, 0));
    return COMPUTE(writer, SpvOpAll, type_bool(writer), each);
}

/* Some of the bits above `low` are set, but not all: from low + 1 to ~low - 1. */
static uint32_t some_beyond(struct writer *writer, uint32_t value, uint32_t low)
{
    uint32_t shifted = COMPUTE(writer, SpvOpISub, type_uint(writer), value, constant_uint(writer, low + 1));
    return both(writer, SpvOpULessThan, shifted, constant_uint(writer, ~low - (low + 1)));
}

/* `rule` as it is numbered for Initialize. */
static uint32_t ray_condition(struct writer *writer, const struct ray *ray, uint32_t rule)
{
    uint32_t bool_ = type_bool(writer), uint_ = type_uint(writer), out = 0;
    switch (rule) {
    case GN_SPIRV_RULE_INITIALIZE_NAN:
        for (int i = 0; i < 2; i++) {
            either(writer, &out, any_component(writer, SpvOpUGreaterThan, ray->vector_bits[i], EXPONENT));
            either(writer, &out, is_nan(writer, ray->t_bits[i]));
        }
        return out;
    case GN_SPIRV_RULE_INITIALIZE_INFINITE:
        for (int i = 0; i < 2; i++)
            either(writer, &out, any_component(writer, SpvOpIEqual, ray->vector_bits[i], EXPONENT));
        return out;
    case GN_SPIRV_RULE_INITIALIZE_NEGATIVE_T:
        /* Negative, but neither -0 nor NaN: 0x80000001 up to minus infinity. */
        for (int i = 0; i < 2; i++) {
            uint32_t shifted =
                COMPUTE(writer, SpvOpISub, uint_, ray->t_bits[i], constant_uint(writer, 0x80000001u));
            either(writer, &out, both(writer, SpvOpULessThan, shifted, constant_uint(writer, EXPONENT)));
        }
        return out;
    case GN_SPIRV_RULE_INITIALIZE_T_ORDER: return COMPUTE(writer, SpvOpFOrdGreaterThan, bool_, ray->t[0], ray->t[1]);
    case GN_SPIRV_RULE_INITIALIZE_ZERO_DIRECTION: return zero_vector(writer, ray->vector_bits[1]);
    case GN_SPIRV_RULE_INITIALIZE_SKIP_BOTH: return state_is(writer, ray->flags, 0x300, 0x300);
    case GN_SPIRV_RULE_INITIALIZE_CULL_PAIR: return several(writer, masked(writer, ray->flags, 0x130));
    case GN_SPIRV_RULE_INITIALIZE_OPACITY_PAIR: return several(writer, masked(writer, ray->flags, 0xC3));
    case GN_SPIRV_RULE_INITIALIZE_UNKNOWN_FLAGS:
        out = masked(writer, ray->flags, ~known_flags(writer->module));
        return both(writer, SpvOpINotEqual, out, constant_uint(writer, 0));
    default: return some_beyond(writer, ray->mask, 0xFF);
    }
}

static uint32_t as_uint(struct writer *writer, uint32_t id)
{
    const struct inst *inst = definition_of(writer->module, id);
    uint32_t uint_ = type_uint(writer);
    return inst && inst->type == uint_ ? id : COMPUTE(writer, SpvOpBitcast, uint_, id);
}

static void ray_read(struct writer *writer, const struct inst *inst, const struct ray_words *words, struct ray *ray)
{
    const struct module *module = writer->module;
    ray->flags = as_uint(writer, inst_word(module, inst, words->flags));
    ray->mask = as_uint(writer, inst_word(module, inst, words->mask));
    for (uint32_t i = 0; i < 2; i++) {
        ray->vectors[i] = inst_word(module, inst, i ? words->direction : words->origin);
        ray->t[i] = inst_word(module, inst, i ? words->tmax : words->tmin);
        uint32_t bits = COMPUTE(writer, SpvOpBitcast, type_uint3(writer), ray->vectors[i]);
        ray->vector_bits[i] =
            COMPUTE(writer, SpvOpBitwiseAnd, type_uint3(writer), bits, constant_uint3(writer, 0x7FFFFFFFu));
        ray->t_bits[i] = COMPUTE(writer, SpvOpBitcast, type_uint(writer), ray->t[i]);
    }
}

/*
 * The quick test: true whenever a rule among `rules` is broken, and perhaps otherwise. Integers order non-negative floats: a tmin that is no
 * greater than a tmax no greater than infinity leaves out every wrong pair (and -0, which the exact test clears).
 */
static uint32_t ray_suspicious(struct writer *writer, const struct ray *ray, uint64_t rules)
{
    uint32_t any = 0;
    const uint64_t of_t = RULE_BIT(INITIALIZE_NAN) | RULE_BIT(INITIALIZE_NEGATIVE_T) | RULE_BIT(INITIALIZE_T_ORDER);
    const uint64_t of_vectors = RULE_BIT(INITIALIZE_NAN) | RULE_BIT(INITIALIZE_INFINITE);
    if (rules & of_vectors)
        for (int i = 0; i < 2; i++)
            either(writer, &any, any_component(writer, SpvOpUGreaterThanEqual, ray->vector_bits[i], EXPONENT));
    if (rules & of_t) {
        either(writer, &any, both(writer, SpvOpUGreaterThan, ray->t_bits[0], ray->t_bits[1]));
        either(writer, &any, both(writer, SpvOpUGreaterThan, ray->t_bits[1], constant_uint(writer, EXPONENT)));
    }
    for (uint32_t rule = GN_SPIRV_RULE_INITIALIZE_ZERO_DIRECTION; rule <= GN_SPIRV_RULE_INITIALIZE_MASK_BITS; rule++)
        if (rules >> rule & 1)
            either(writer, &any, ray_condition(writer, ray, rule));
    return any;
}

static void ray_operands(struct writer *writer, const struct ray *ray, uint32_t out[GN_RECORD_OPERANDS])
{
    uint32_t float_ = type_float(writer), uint_ = type_uint(writer), count = 0;
    out[count++] = ray->flags;
    out[count++] = ray->mask;
    for (int i = 0; i < 2; i++) {
        for (uint32_t c = 0; c < 3; c++) {
            uint32_t value = COMPUTE(writer, SpvOpCompositeExtract, float_, ray->vectors[i], c);
            out[count++] = COMPUTE(writer, SpvOpBitcast, uint_, value);
        }
        out[count++] = ray->t_bits[i];
    }
}

static uint32_t condition_of(struct writer *writer, const struct site *site, uint32_t rule, const struct gathered *gathered)
{
    const struct state_rule *of_state = state_rule_of(rule);
    if (gathered->ray)
        return ray_condition(writer, gathered->ray, site->operation->kind == OPERATION_INITIALIZE ? rule : rule - RULES_OF_RAY_TO_TRACE);
    return of_state ? state_is(writer, gathered->state, of_state->mask, of_state->broken) : gathered->conditions[rule];
}

/* Where `gathered->any` holds, leaves records of those of the site's checks that are among `rules`. Returns whether the operation would
 * be undefined, 0 if nobody asks. */
static uint32_t leave(struct writer *writer, const struct site *site, uint64_t rules, struct gathered *gathered)
{
    uint32_t uint_ = type_uint(writer), zero = constant_uint(writer, 0), mask = 0, bit = 0;
    uint32_t undefined = 0, skip = 0;
    const struct gn_spirv_options *options = writer->analysis->options;
    struct branch wrong;
    branch_begin(writer, gathered->any, &wrong);
    for (uint32_t rule = 0; rule < GN_SPIRV_RULE_COUNT; rule++) {
        if (!(site->checked >> rule & 1))
            continue;
        uint32_t own_bit = 1u << bit++;
        if (!(rules >> rule & 1))
            continue;
        if (options->safe && (rule == GN_SPIRV_RULE_PROCEED_LIMIT ||
                              gn_spirv_rule_at(rule)->severity[options->profile] == GN_SEVERITY_ERROR))
            undefined |= own_bit;
        uint32_t condition = condition_of(writer, site, rule, gathered);
        uint32_t value = COMPUTE(writer, SpvOpSelect, uint_, condition, constant_uint(writer, own_bit), zero);
        mask = mask ? COMPUTE(writer, SpvOpBitwiseOr, uint_, mask, value) : value;
    }
    if (gathered->ray)
        ray_operands(writer, gathered->ray, gathered->operands);
    uint32_t call[4 + GN_RECORD_OPERANDS] = {writer->record_function, constant_uint(writer, site->first_check), mask,
                                             gathered->state ? gathered->state : zero};
    for (int i = 0; i < GN_RECORD_OPERANDS; i++)
        call[4 + i] = gathered->operands[i] ? gathered->operands[i] : zero;
    compute(writer, SpvOpFunctionCall, type_void(writer), call, 4 + GN_RECORD_OPERANDS);
    if (undefined) {
        skip = masked(writer, mask, undefined);
        skip = both(writer, SpvOpINotEqual, skip, zero);
    }
    branch_end(writer, &wrong);
    if (!undefined)
        return 0;
    uint32_t no = constant_plain(writer, SpvOpConstantFalse, type_bool(writer));
    return branch_phi(writer, &wrong, type_bool(writer), skip, no);
}

static void gather_ray(struct writer *writer, const struct site *site, uint64_t rules, struct ray *ray, struct gathered *gathered)
{
    const struct ray_words words = ray_words_of(site->operation);
    uint64_t as_initialize = site->operation->kind == OPERATION_INITIALIZE ? rules : rules >> RULES_OF_RAY_TO_TRACE;
    ray_read(writer, &writer->module->insts[site->inst], &words, ray);
    gathered->any = ray_suspicious(writer, ray, as_initialize);
    gathered->ray = ray;
}

/* What a trace says beyond its ray, and the other operations of pipelines. */

static void gather_trace(struct writer *writer, const struct site *site, struct gathered *gathered)
{
    static const struct {
        uint32_t rule, low;
    } narrow[] = {{GN_SPIRV_RULE_TRACE_SBT_OFFSET_BITS, 0xF},
                  {GN_SPIRV_RULE_TRACE_SBT_STRIDE_BITS, 0xF},
                  {GN_SPIRV_RULE_TRACE_MISS_BITS, 0xFFFF}};
    const struct module *module = writer->module;
    const struct inst *inst = &module->insts[site->inst];
    const struct ray_words words = ray_words_of(site->operation);
    const uint32_t at[] = {words.sbt_offset, words.sbt_stride, words.miss};
    for (int i = 0; i < 3; i++) {
        gathered->operands[i] = as_uint(writer, inst_word(module, inst, at[i]));
        if (site->checked >> narrow[i].rule & 1)
            gather(writer, gathered, narrow[i].rule,
                   some_beyond(writer, gathered->operands[i], narrow[i].low));
    }
    if (site->checked & RULE_BIT(TRACE_TIME)) {
        /* From 0 (or -0) to 1, as integers. */
        uint32_t bits = COMPUTE(writer, SpvOpBitcast, type_uint(writer), inst_word(module, inst, words.time));
        uint32_t wrong = both(writer, SpvOpUGreaterThan, bits, constant_uint(writer, 0x3F800000u));
        wrong = both(writer, SpvOpLogicalAnd, wrong, both(writer, SpvOpINotEqual, bits, constant_uint(writer, 0x80000000u)));
        gathered->operands[3] = bits;
        gather(writer, gathered, GN_SPIRV_RULE_TRACE_TIME, wrong);
    }
    if (site->checked & RULE_BIT(TRACE_SKIPPED_BY_PIPELINE)) {
        uint32_t flags = as_uint(writer, inst_word(module, inst, words.flags));
        uint32_t bits = masked(writer, flags, writer->analysis->options->forbidden_ray_flags);
        gather(writer, gathered, GN_SPIRV_RULE_TRACE_SKIPPED_BY_PIPELINE,
               both(writer, SpvOpINotEqual, bits, constant_uint(writer, 0)));
    }
    if (site->checked & ~site->wrong & RULE_BIT(TRACE_RECURSION)) {
        uint32_t depth = launch_depth_enter(writer), max = constant_uint(writer, writer->analysis->options->max_recursion);
        gathered->operands[4] = depth;
        gathered->operands[5] = max;
        gather(writer, gathered, GN_SPIRV_RULE_TRACE_RECURSION, both(writer, SpvOpUGreaterThanEqual, depth, max));
    }
}

static void gather_report(struct writer *writer, const struct site *site, struct gathered *gathered)
{
    const struct inst *inst = &writer->module->insts[site->inst];
    gathered->operands[0] = COMPUTE(writer, SpvOpBitcast, type_uint(writer), inst_word(writer->module, inst, 3));
    gathered->operands[1] = as_uint(writer, inst_word(writer->module, inst, 4));
    if (site->checked & RULE_BIT(REPORT_HIT_KIND))
        gather(writer, gathered, GN_SPIRV_RULE_REPORT_HIT_KIND,
               both(writer, SpvOpUGreaterThan, gathered->operands[1], constant_uint(writer, 127)));
    if (site->checked & RULE_BIT(REPORT_NAN))
        gather(writer, gathered, GN_SPIRV_RULE_REPORT_NAN, is_nan(writer, gathered->operands[0]));
}

static void gather_call(struct writer *writer, const struct site *site, struct gathered *gathered)
{
    const struct inst *inst = &writer->module->insts[site->inst];
    uint32_t told = launch_callables(writer), known = both(writer, SpvOpINotEqual, told, constant_uint(writer, 0));
    uint32_t one = constant_uint(writer, 1), count = COMPUTE(writer, SpvOpISub, type_uint(writer), told, one);
    gathered->operands[0] = as_uint(writer, inst_word(writer->module, inst, 1));
    gathered->operands[1] = count;
    uint32_t beyond = both(writer, SpvOpUGreaterThanEqual, gathered->operands[0], count);
    gather(writer, gathered, GN_SPIRV_RULE_CALL_RANGE, both(writer, SpvOpLogicalAnd, known, beyond));
}

/* One comparison where all is well. */
static void gather_structure(struct writer *writer, const struct site *site, uint32_t word, uint32_t *operands, struct gathered *gathered)
{
    static const struct {
        uint32_t rule, state;
    } table[] = {{GN_SPIRV_RULE_STRUCTURE_NONE, GN_STRUCTURE_NONE},
                 {GN_SPIRV_RULE_STRUCTURE_NEVER_BUILT, GN_STRUCTURE_NEVER_BUILT},
                 {GN_SPIRV_RULE_STRUCTURE_DESTROYED, GN_STRUCTURE_DESTROYED},
                 {GN_SPIRV_RULE_STRUCTURE_BOTTOM_LEVEL, GN_STRUCTURE_BOTTOM_LEVEL}};
    uint32_t bool_ = type_bool(writer);
    uint32_t id = structure_id(writer, &writer->module->insts[site->inst], word, operands);
    if (!id) {
        writer->out.failed = true; /* verdicts.c has asked the same */
        return;
    }
    uint32_t state = masked(writer, structures_load(writer, id), GN_STRUCTURE_STATE_BITS);
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++)
        if (site->checked >> table[i].rule & 1)
            gathered->conditions[table[i].rule] = COMPUTE(writer, SpvOpIEqual, bool_, state, constant_uint(writer, table[i].state));
    either(writer, &gathered->any, COMPUTE(writer, SpvOpINotEqual, bool_, state, constant_uint(writer, GN_STRUCTURE_FINE)));
}

/* Where a hit shader reads vertex positions: nothing says through which structure the ray went. */
static void gather_positions(struct writer *writer, const struct site *site, struct gathered *gathered)
{
    uint32_t kind = site->checked & RULE_BIT(HIT_POSITIONS_OF_AABB) ? builtin_load(writer, SpvBuiltInHitKindKHR, type_uint(writer)) : 0;
    if (site->checked & RULE_BIT(HIT_POSITIONS_OF_AABB)) {
        uint32_t no = constant_plain(writer, SpvOpConstantFalse, type_bool(writer));
        gather(writer, gathered, GN_SPIRV_RULE_HIT_POSITIONS_OF_AABB,
               kind ? both(writer, SpvOpULessThan, kind, constant_uint(writer, HIT_KIND_FRONT_FACING)) : no);
    }
    if (site->checked & RULE_BIT(STRUCTURE_NO_POSITIONS)) {
        uint32_t unknown = constant_uint(writer, GN_STRUCTURE_ID_UNKNOWN), word = structures_load(writer, unknown);
        gathered->operands[6] = constant_uint(writer, UINT32_MAX);
        gathered->operands[9] = unknown;
        gather(writer, gathered, GN_SPIRV_RULE_STRUCTURE_NO_POSITIONS,
               state_is(writer, word, GN_STRUCTURE_NO_POSITIONS, GN_STRUCTURE_NO_POSITIONS));
    }
}

/* What is not about a ray. */
static void gather_others(struct writer *writer, const struct site *site, struct gathered *gathered)
{
    const struct inst *inst = &writer->module->insts[site->inst];
    uint32_t state = 0;
    switch (site->operation->kind) {
    case OPERATION_INITIALIZE: gather_structure(writer, site, 2, gathered->operands, gathered); break;
    case OPERATION_TRACE:
    case OPERATION_TRACE_MOTION:
        gather_trace(writer, site, gathered);
        if (site->checked & RULES_OF_STRUCTURE)
            gather_structure(writer, site, 1, gathered->operands + 6, gathered);
        break;
    case OPERATION_REPORT: gather_report(writer, site, gathered); break;
    case OPERATION_CALL: gather_call(writer, site, gathered); break;
    case OPERATION_POSITIONS: gather_positions(writer, site, gathered); break;
    default:
        if (checks_need_state(site)) {
            state = shadow_state(writer, inst_word(writer->module, inst, site->operation->query_word));
            gather_states(writer, site, state, gathered);
        }
        gather_live(writer, site, state, gathered);
    }
}

uint32_t checks_write(struct writer *writer, const struct site *site)
{
    const uint64_t of_ray = site->checked & (RULES_OF_INITIALIZE | RULES_OF_TRACED_RAY), of_others = site->checked & ~of_ray;
    struct gathered rays = {.any = 0}, others = {.any = 0};
    struct ray ray;
    struct branch either_wrong;
    uint32_t skip = 0, more = 0, no = constant_plain(writer, SpvOpConstantFalse, type_bool(writer));
    writer->no_structure = 0;
    if (of_ray)
        gather_ray(writer, site, of_ray, &ray, &rays);
    if (of_others)
        gather_others(writer, site, &others);
    /* What the module alone proves wrong is wrong whenever it is reached. */
    for (uint32_t rule = GN_SPIRV_RULE_TRACE_NAN; rule < GN_SPIRV_RULE_COUNT; rule++)
        if ((of_others & site->wrong) >> rule & 1 && !others.conditions[rule])
            gather(writer, &others, rule, constant_plain(writer, SpvOpConstantTrue, type_bool(writer)));
    /* One branch where all is well. */
    if (of_ray && of_others)
        branch_begin(writer, both(writer, SpvOpLogicalOr, rays.any, others.any), &either_wrong);
    if (of_ray)
        skip = leave(writer, site, of_ray, &rays);
    if (of_others)
        more = leave(writer, site, of_others, &others);
    if (of_ray && of_others) {
        branch_end(writer, &either_wrong);
        skip = skip ? branch_phi(writer, &either_wrong, type_bool(writer), skip, no) : 0;
        more = more ? branch_phi(writer, &either_wrong, type_bool(writer), more, no) : 0;
    }
    if (site->operation->kind == OPERATION_INITIALIZE)
        writer->no_structure = more;
    return skip && more ? both(writer, SpvOpLogicalOr, skip, more) : skip ? skip : more;
}
