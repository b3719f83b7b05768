/* SPDX-License-Identifier: Apache-2.0 */
/* What a module keeps beside its queries (enum shadow): a word of GN_RECORD_STATE_* for each, the tmax it was initialized with where
 * an intersection is generated, and which structure it goes through where vertex positions are read. A short array of queries has one state word for all, four bits for each, as an index that is not
 * constant costs little in a word and much in an array. */
#include "checks/spirv/records.h"
#include "checks/spirv/writer.h"

#define INITIALIZED GN_RECORD_STATE_INITIALIZED
#define PACKED_BITS 4u
#define PACKED_MAX 8u

void shadow_pack(struct analysis *analysis, struct root *root)
{
    const struct inst *type = definition_of(analysis->module, root->pointee);
    uint32_t length = 0;
    root->packed = type && type->opcode == SpvOpTypeArray && !root->indexed_by && !analysis->options->proceed_limit &&
                   opcode_of(analysis->module, inst_word(analysis->module, type, 2)) == SpvOpTypeRayQueryKHR &&
                   constant_u32(analysis->module, inst_word(analysis->module, type, 3), &length) && length <= PACKED_MAX;
}

bool shadow_is_float(enum shadow shadow)
{
    return shadow == SHADOW_TMAX;
}

/* A pointer to the shadow of the query that `query` leads to; of a packed one, to the word. out_shift: where in the word, 0 if it is all. */
static uint32_t shadow_pointer(struct writer *writer, uint32_t query, enum shadow shadow, uint32_t *out_shift)
{
    uint32_t chain[1 + MAX_INDICES], count = 0, uint_ = type_uint(writer);
    uint32_t root = pointer_root(writer->analysis, query, chain + 1, &count);
    chain[0] = root == NONE ? 0 : writer->shadow_of[shadow][root];
    *out_shift = 0;
    const struct root *of = root == NONE ? NULL : &writer->analysis->roots[root];
    if (count == 0 || of->indexed_by)
        return chain[0];
    if (of->packed && shadow == SHADOW_STATE) {
        const struct inst *index = definition_of(writer->module, chain[1]);
        const struct inst *type = index ? definition_of(writer->module, index->type) : NULL;
        uint32_t at = chain[1];
        if (!type || inst_word(writer->module, type, 2) != 32)
            at = COMPUTE(writer, SpvOpUConvert, uint_, at);
        else if (index->type != uint_)
            at = COMPUTE(writer, SpvOpBitcast, uint_, at);
        at = COMPUTE(writer, SpvOpBitwiseAnd, uint_, at, constant_uint(writer, PACKED_MAX - 1));
        *out_shift = COMPUTE(writer, SpvOpIMul, uint_, at, constant_uint(writer, PACKED_BITS));
        return chain[0];
    }
    uint32_t type = type_pointer(writer, of->storage, shadow_is_float(shadow) ? type_float(writer) : uint_);
    return compute(writer, SpvOpAccessChain, type, chain, count + 1u);
}

uint32_t shadow_state(struct writer *writer, uint32_t query)
{
    uint32_t shift, uint_ = type_uint(writer), pointer = shadow_pointer(writer, query, SHADOW_STATE, &shift);
    uint32_t word = COMPUTE(writer, SpvOpLoad, uint_, pointer);
    return shift ? COMPUTE(writer, SpvOpShiftRightLogical, uint_, word, shift) : word;
}

uint32_t shadow_load(struct writer *writer, uint32_t query, enum shadow shadow)
{
    uint32_t shift, pointer = shadow_pointer(writer, query, shadow, &shift);
    return COMPUTE(writer, SpvOpLoad, shadow_is_float(shadow) ? type_float(writer) : type_uint(writer), pointer);
}

static void shadow_store(struct writer *writer, uint32_t query, enum shadow shadow, uint32_t value)
{
    uint32_t shift, pointer = shadow_pointer(writer, query, shadow, &shift);
    EMIT(&writer->out, SpvOpStore, pointer, value);
}

static void state_store(struct writer *writer, uint32_t query, uint32_t state)
{
    uint32_t shift, uint_ = type_uint(writer), pointer = shadow_pointer(writer, query, SHADOW_STATE, &shift);
    if (shift) {
        uint32_t word = COMPUTE(writer, SpvOpLoad, uint_, pointer);
        uint32_t all = constant_uint(writer, (1u << PACKED_BITS) - 1);
        uint32_t mask = COMPUTE(writer, SpvOpShiftLeftLogical, uint_, all, shift);
        mask = COMPUTE(writer, SpvOpNot, uint_, mask);
        word = COMPUTE(writer, SpvOpBitwiseAnd, uint_, word, mask);
        state = COMPUTE(writer, SpvOpShiftLeftLogical, uint_, state, shift);
        state = COMPUTE(writer, SpvOpBitwiseOr, uint_, word, state);
    }
    EMIT(&writer->out, SpvOpStore, pointer, state);
}

void shadow_update(struct writer *writer, const struct site *site)
{
    const struct inst *inst = &writer->module->insts[site->inst];
    uint32_t query = inst_word(writer->module, inst, site->operation->query_word), uint_ = type_uint(writer);
    if (site->root == NONE) {
        if (site->checked & ~site->wrong & RULE_BIT(TRACE_RECURSION))
            launch_depth_leave(writer);
        return;
    }
    const struct root *group = &writer->analysis->roots[writer->analysis->roots[site->root].group];
    if (site->operation->kind == OPERATION_INITIALIZE) {
        if (group->needs[SHADOW_STATE]) {
            uint32_t state = constant_uint(writer, INITIALIZED);
            if (writer->no_structure) {
                uint32_t none = constant_uint(writer, 0);
                state = COMPUTE(writer, SpvOpSelect, uint_, writer->no_structure, none, state);
            }
            state_store(writer, query, state);
        }
        if (group->needs[SHADOW_TMAX])
            shadow_store(writer, query, SHADOW_TMAX, inst_word(writer->module, inst, 8));
        if (group->needs[SHADOW_STRUCTURE]) {
            uint32_t unused[4], id = structure_id(writer, inst, 2, unused);
            shadow_store(writer, query, SHADOW_STRUCTURE, id ? id : constant_uint(writer, GN_STRUCTURE_ID_UNKNOWN));
        }
    } else if (site->operation->kind == OPERATION_PROCEED && group->needs[SHADOW_STATE]) {
        /* A query that was never initialized stays so: each later operation on it is one more report. */
        bool doubtful = (site->states & STATE_UNINITIALIZED) != 0;
        bool counted = writer->analysis->options->proceed_limit != 0;
        uint32_t started = doubtful ? 0 : INITIALIZED;
        uint32_t yes = constant_uint(writer, started | GN_RECORD_STATE_CANDIDATE);
        uint32_t no = constant_uint(writer, started | GN_RECORD_STATE_FINISHED);
        uint32_t state = COMPUTE(writer, SpvOpSelect, uint_, inst->result, yes, no);
        if (doubtful || counted) {
            const uint32_t proceeds = ~(GN_RECORD_STATE_PROCEEDS - 1);
            uint32_t before = shadow_state(writer, query);
            if (counted)
                before = COMPUTE(writer, SpvOpIAdd, uint_, before, constant_uint(writer, GN_RECORD_STATE_PROCEEDS));
            uint32_t kept = constant_uint(writer, (doubtful ? INITIALIZED : 0) | (counted ? proceeds : 0));
            kept = COMPUTE(writer, SpvOpBitwiseAnd, uint_, before, kept);
            state = COMPUTE(writer, SpvOpBitwiseOr, uint_, state, kept);
        }
        state_store(writer, query, state);
    }
}
