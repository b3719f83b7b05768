/* SPDX-License-Identifier: Apache-2.0 */
/* A forward data-flow analysis of the ray-query protocol: at every operation the set of states in which it may be reached,
 * through branches, loops and calls. Sets only grow until nothing changes, so what is not in a set cannot happen (unless
 * an earlier operation was already wrong and is reported itself). A callee is analysed once for all its calls together.
 *
 * An id stands for the latest run of its instruction, and so must what a variable is said to hold. It does: SPIR-V's control flow is
 * structured, so between two runs of an instruction lies the header of a loop around it, where what the variable holds on
 * entering the loop is joined in; that cannot be the id, so it is forgotten.
 *
 * Whether a branch is taken is often decided long before it: by a variable, a phi or a function's result. Of each such boolean (a flag)
 * the analysis knows in which states an object may be when it is true, and in which when it is false. */
#include <string.h>

#include "checks/spirv/analysis.h"

/* More than this many cells per function are not worth their memory: then every state is taken for possible. */
#define MAX_CELLS (4u << 20)

/* What is known of one object at one point. The ids name results that still describe the object: of its last Proceed and
 * of the getters of its types; 0 when there is none. */
struct cell {
    uint32_t states;
    uint32_t proceed, candidate_type, committed_type;
    uint32_t flags;
    bool flags_known;
};

/* The states that an object may be in while a flag is true, and while it is false. */
struct told {
    uint32_t yes, no;
};
#define MAX_FLAGS 64

/* Per function: the objects it can reach, and the scalar variables whose value is followed. */
struct frame {
    uint32_t *objects;
    uint32_t object_count, parameter_objects;
    uint32_t *variables; /* ids */
    uint32_t variable_count;
    struct cell *entry, *exit; /* per object */
    struct cell *in;           /* per block and object */
    uint32_t *flags;           /* ids of boolean variables, phis and calls */
    uint32_t flag_count;
    struct told *in_told;      /* per block, flag and object */
    struct told *exit_told;    /* per object: of the boolean that the function returns */
    uint32_t *values;          /* per block and variable: the id last stored, or 0 */
    bool *visited, *dirty;     /* per block */
    bool reached, waiting, returns;
};

struct flow {
    struct analysis *analysis;
    struct module *module;
    struct frame *frames;
    uint32_t *slot_of_object;   /* within the frame being processed, plus 1 */
    uint32_t *slot_of_variable; /* per id, plus 1; a variable belongs to one function */
    uint32_t *alias;            /* per id of a load: the id that was stored, or 0 */
    struct cell *cells;         /* the state while walking a block */
    struct cell *edge_cells;
    uint32_t *values;
    struct cell *scratch;       /* while asking what a boolean would tell */
    uint32_t *flag_of;          /* per id, plus 1; an id belongs to one function */
    uint64_t *loaded, *stored;  /* per id of a load, and of a variable: when, by the clock */
    uint64_t clock, walk_began;
    uint64_t walks, most_walks; /* a module that is not valid may never settle */
    struct told *told, *edge_told, *join_told; /* per flag and object of the frame being processed */
    uint32_t objects;           /* of that frame */
    uint32_t known;             /* the condition of the edge being followed, 0 for none, and what it is */
    bool known_truth;
    bool recording;
};

static bool cell_join(struct cell *into, const struct cell *from, bool first)
{
    if (first) {
        *into = *from;
        return true;
    }
    struct cell old = *into;
    into->states |= from->states;
    if (into->proceed != from->proceed)
        into->proceed = 0;
    if (into->candidate_type != from->candidate_type)
        into->candidate_type = 0;
    if (into->committed_type != from->committed_type)
        into->committed_type = 0;
    if (!from->flags_known || into->flags != from->flags)
        into->flags_known = false;
    return old.states != into->states || old.proceed != into->proceed || old.candidate_type != into->candidate_type ||
           old.committed_type != into->committed_type || old.flags_known != into->flags_known;
}

static const struct cell unknown_cell = {.states = STATES_ALL};

/* Where one state may go at a Proceed. */
static uint32_t proceed_from(uint32_t committed, const struct cell *cell)
{
    bool triangles = true, aabbs = true, commits = true;
    if (cell->flags_known) {
        uint32_t flags = cell->flags;
        triangles = !(flags & (SpvRayFlagsSkipTrianglesKHRMask | SpvRayFlagsOpaqueKHRMask | SpvRayFlagsCullNoOpaqueKHRMask));
        aabbs = !(flags & SpvRayFlagsSkipAABBsKHRMask);
        commits = !(flags & (SpvRayFlagsSkipTrianglesKHRMask | SpvRayFlagsNoOpaqueKHRMask | SpvRayFlagsCullOpaqueKHRMask));
    }
    uint32_t out = 0;
    for (uint32_t c = 0; c < COMMITTED_COUNT; c++) {
        if (c != committed && !(c == COMMITTED_TRIANGLE && commits))
            continue;
        out |= STATE_FINISHED(c);
        if (triangles)
            out |= STATE_CANDIDATE(KIND_TRIANGLE, c);
        if (aabbs)
            out |= STATE_CANDIDATE(KIND_AABB, c);
    }
    return out;
}

/* A wrong operation leaves the state as it was: the next one is judged by itself. */
static uint32_t states_after(enum operation_kind kind, const struct cell *cell)
{
    uint32_t out = 0;
    for (uint32_t bit = 1; bit <= STATES_ALL; bit <<= 1) {
        if (!(cell->states & bit))
            continue;
        uint32_t committed = bit & STATES_COMMITTED(COMMITTED_TRIANGLE)    ? COMMITTED_TRIANGLE
                             : bit & STATES_COMMITTED(COMMITTED_GENERATED) ? COMMITTED_GENERATED
                                                                           : COMMITTED_NOTHING;
        uint32_t aabb = (bit & STATES_AT_AABB) != 0;
        switch (kind) {
        case OPERATION_INITIALIZE: out |= STATE_INITIALIZED; break;
        case OPERATION_PROCEED:
            if (bit & STATES_TERMINATED)
                out |= STATE_FINISHED(committed);
            else if (bit & (STATE_INITIALIZED | STATES_CANDIDATE))
                out |= proceed_from(committed, cell);
            else
                out |= bit;
            break;
        case OPERATION_CONFIRM:
            out |= !(bit & STATES_AT_TRIANGLE) ? bit
                   : bit & STATES_CANDIDATE    ? STATE_CANDIDATE(KIND_TRIANGLE, COMMITTED_TRIANGLE)
                                               : STATE_TERMINATED(KIND_TRIANGLE, COMMITTED_TRIANGLE);
            break;
        case OPERATION_GENERATE:
            out |= !(bit & STATES_AT_AABB)  ? bit
                   : bit & STATES_CANDIDATE ? STATE_CANDIDATE(KIND_AABB, COMMITTED_GENERATED)
                                            : STATE_TERMINATED(KIND_AABB, COMMITTED_GENERATED);
            break;
        case OPERATION_TERMINATE: out |= bit & STATES_CANDIDATE ? STATE_TERMINATED(aabb, committed) : bit; break;
        default: out |= bit; break;
        }
    }
    return out;
}

static uint32_t told_after(enum operation_kind kind, const struct cell *cell, uint32_t states, bool strong)
{
    struct cell assumed = *cell;
    assumed.states = states;
    return states_after(kind, &assumed) | (strong ? 0 : states);
}

static void operate(struct flow *flow, const struct frame *frame, struct site *site)
{
    const struct inst *inst = &flow->module->insts[site->inst];
    if (flow->recording)
        site->reachable = true;
    if (site->object == NONE)
        return;
    uint32_t slot = flow->slot_of_object[site->object];
    if (!slot || slot > frame->object_count)
        return;
    struct cell *cell = &flow->cells[slot - 1];
    bool strong = flow->analysis->objects[site->object].strong;
    if (flow->recording)
        site->states |= cell->states;
    if (flow->analysis->roots[flow->analysis->objects[site->object].root].aliased)
        return;
    uint32_t after = states_after(site->operation->kind, cell);
    for (uint32_t f = 0; f < frame->flag_count; f++) {
        struct told *told = &flow->told[f * frame->object_count + slot - 1];
        told->yes = told_after(site->operation->kind, cell, told->yes, strong);
        told->no = told_after(site->operation->kind, cell, told->no, strong);
    }
    if (!strong) {
        cell->states |= after;
        cell->proceed = cell->candidate_type = cell->committed_type = 0;
        cell->flags_known = false;
        return;
    }
    cell->states = after;
    switch (site->operation->kind) {
    case OPERATION_INITIALIZE:
        cell->proceed = cell->candidate_type = cell->committed_type = 0;
        cell->flags_known = operands_flags(flow->module, inst, &cell->flags);
        if (!cell->flags_known)
            cell->flags = 0;
        break;
    case OPERATION_PROCEED:
        cell->proceed = inst->result;
        cell->candidate_type = cell->committed_type = 0;
        break;
    case OPERATION_CONFIRM:
    case OPERATION_GENERATE: cell->committed_type = 0; break;
    case OPERATION_GET_TYPE:
        if (site->committed)
            cell->committed_type = inst->result;
        else
            cell->candidate_type = inst->result;
        break;
    default: break;
    }
}

/* Refinement by branches */

static uint32_t value_behind(const struct flow *flow, uint32_t id)
{
    for (int depth = 0; depth < 8; depth++) {
        const struct inst *inst = definition_of(flow->module, id);
        if (inst && inst->opcode == SpvOpLoad && flow->alias[id])
            id = flow->alias[id];
        else if (inst && (inst->opcode == SpvOpCopyObject || inst->opcode == SpvOpBitcast))
            id = inst_word(flow->module, inst, 3);
        else
            break;
    }
    return id;
}

static void refine_type(struct cell *cells, uint32_t count, uint32_t id, uint32_t value, bool equal)
{
    for (uint32_t o = 0; o < count; o++) {
        uint32_t these = STATES_ALL;
        if (cells[o].candidate_type == id)
            these = value == KIND_TRIANGLE ? STATES_AT_TRIANGLE : value == KIND_AABB ? STATES_AT_AABB : 0;
        else if (cells[o].committed_type == id && value == COMMITTED_NOTHING)
            these = STATES_ALL & ~STATES_COMMITTED(COMMITTED_TRIANGLE) & ~STATES_COMMITTED(COMMITTED_GENERATED);
        else if (cells[o].committed_type == id)
            these = value < COMMITTED_COUNT ? STATES_COMMITTED(value) : 0;
        else
            continue;
        /* A getter that had no candidate to tell of says nothing. */
        uint32_t says_nothing = cells[o].candidate_type == id ? STATE_UNINITIALIZED | STATES_NO_CANDIDATE : STATE_UNINITIALIZED;
        cells[o].states &= (equal ? these : ~these) | says_nothing;
    }
}

/* What a flag tells: of a variable, only where it still holds what was loaded. */
static void refine_flag(const struct flow *flow, struct cell *cells, const struct told *told, uint32_t id, bool truth)
{
    const struct inst *inst = definition_of(flow->module, id);
    uint32_t variable = inst && inst->opcode == SpvOpLoad ? inst_word(flow->module, inst, 3) : 0;
    if (variable && (flow->loaded[id] <= flow->walk_began || flow->loaded[id] <= flow->stored[variable]))
        return;
    uint32_t flag = inst ? flow->flag_of[variable ? variable : id] : 0;
    for (uint32_t o = 0; flag && o < flow->objects; o++) {
        const struct told *of = &told[(flag - 1) * flow->objects + o];
        cells[o].states &= truth ? of->yes : of->no;
    }
}

static void refine(const struct flow *flow, struct cell *cells, const struct told *told, uint32_t condition, bool truth, int depth)
{
    const uint32_t count = flow->objects;
    if (condition == flow->known && condition && truth != flow->known_truth) {
        for (uint32_t o = 0; o < count; o++)
            cells[o].states = 0;
        return;
    }
    refine_flag(flow, cells, told, condition, truth);
    uint32_t id = value_behind(flow, condition);
    if (id != condition)
        refine_flag(flow, cells, told, id, truth);
    const struct inst *inst = definition_of(flow->module, id);
    if (!inst || depth > 16)
        return;
    switch (inst->opcode) {
    case SpvOpConstantTrue:
    case SpvOpConstantFalse:
        for (uint32_t o = 0; truth != (inst->opcode == SpvOpConstantTrue) && o < count; o++)
            cells[o].states = 0;
        break;
    case SpvOpRayQueryProceedKHR:
        /* An operation that was wrong returned anything. */
        for (uint32_t o = 0; o < count; o++)
            if (cells[o].proceed == id)
                cells[o].states &= (truth ? STATES_AT_CANDIDATE : STATES_FINISHED) | STATE_UNINITIALIZED;
        break;
    case SpvOpLogicalNot: refine(flow, cells, told, inst_word(flow->module, inst, 3), !truth, depth + 1); break;
    case SpvOpLogicalAnd:
    case SpvOpLogicalOr:
        if (truth == (inst->opcode == SpvOpLogicalAnd)) {
            refine(flow, cells, told, inst_word(flow->module, inst, 3), truth, depth + 1);
            refine(flow, cells, told, inst_word(flow->module, inst, 4), truth, depth + 1);
        }
        break;
    case SpvOpLogicalEqual:
    case SpvOpLogicalNotEqual:
        for (uint32_t w = 3; w <= 4; w++) {
            uint32_t other = opcode_of(flow->module, inst_word(flow->module, inst, 7 - w));
            if (other == SpvOpConstantTrue || other == SpvOpConstantFalse)
                refine(flow, cells, told, inst_word(flow->module, inst, w),
                       truth == ((inst->opcode == SpvOpLogicalEqual) == (other == SpvOpConstantTrue)), depth + 1);
        }
        break;
    case SpvOpIEqual:
    case SpvOpINotEqual:
        for (uint32_t w = 3; w <= 4; w++) {
            uint32_t value;
            if (constant_u32(flow->module, inst_word(flow->module, inst, 7 - w), &value))
                refine_type(cells, count, value_behind(flow, inst_word(flow->module, inst, w)), value,
                            truth == (inst->opcode == SpvOpIEqual));
        }
        break;
    default: {
        /* More than none is not none: an unsigned comparison with 0, or with 1 from below. */
        static const struct {
            uint32_t opcode, bound;
            bool bound_first, equal;
        } forms[] = {{SpvOpUGreaterThan, 0, false, false}, {SpvOpULessThan, 0, true, false},
                     {SpvOpUGreaterThanEqual, 1, false, false}, {SpvOpULessThanEqual, 1, true, false},
                     {SpvOpULessThan, 1, false, true}, {SpvOpUGreaterThan, 1, true, true}};
        for (size_t i = 0; i < sizeof forms / sizeof forms[0]; i++) {
            uint32_t bound, at = forms[i].bound_first ? 3 : 4;
            if (inst->opcode == forms[i].opcode && constant_u32(flow->module, inst_word(flow->module, inst, at), &bound) &&
                bound == forms[i].bound)
                refine_type(cells, count, value_behind(flow, inst_word(flow->module, inst, 7 - at)), 0, truth == forms[i].equal);
        }
        break;
    }
    }
}

/* The states that each object may be in while `id` is true, and while it is false, as told of a point. */
static void tell(const struct flow *flow, const struct cell *cells, const struct told *told, uint32_t id, struct told *out)
{
    for (int truth = 0; truth < 2; truth++) {
        memcpy(flow->scratch, cells, flow->objects * sizeof *cells);
        refine(flow, flow->scratch, told, id, truth, 0);
        for (uint32_t o = 0; o < flow->objects; o++)
            *(truth ? &out[o].yes : &out[o].no) = flow->scratch[o].states;
    }
}

/* Frames */

/* Function variables of a scalar or vector that are only loaded and stored as a whole. */
static bool find_variables(struct flow *flow, uint32_t f)
{
    struct module *module = flow->module;
    const struct function *function = &module->functions[f];
    struct frame *frame = &flow->frames[f];
    uint32_t count = 0;
    for (uint32_t i = function->first; i <= function->last; i++)
        count += module->insts[i].opcode == SpvOpVariable;
    frame->variables = arena_alloc(module->arena, count + 1u, sizeof *frame->variables);
    if (!frame->variables)
        return false;
    for (uint32_t i = function->first; i <= function->last; i++) {
        const struct inst *inst = &module->insts[i];
        if (inst->opcode != SpvOpVariable)
            continue;
        const struct inst *pointer = definition_of(module, inst->type);
        uint32_t pointee = pointer ? opcode_of(module, inst_word(module, pointer, 3)) : 0;
        if (pointee == SpvOpTypeBool || pointee == SpvOpTypeInt || pointee == SpvOpTypeFloat || pointee == SpvOpTypeVector) {
            frame->variables[frame->variable_count++] = inst->result;
            flow->slot_of_variable[inst->result] = frame->variable_count;
        }
    }
    for (uint32_t i = function->first; i <= function->last; i++) {
        const struct inst *inst = &module->insts[i];
        uint32_t number;
        if (inst->opcode == SpvOpVariable || is_debug(module, inst, &number))
            continue;
        for (uint32_t w = 1; w < inst->count; w++) {
            bool plain = (inst->opcode == SpvOpLoad && w == 3 && inst->count == 4) ||
                         (inst->opcode == SpvOpStore && w == 1 && inst->count == 3);
            if (inst_word_is_id(module, inst, w) && !plain)
                flow->slot_of_variable[inst_word(module, inst, w)] = 0;
        }
    }
    return true;
}

static bool in_frame(const struct flow *flow, uint32_t object, uint32_t function)
{
    const struct root *root = &flow->analysis->roots[flow->analysis->objects[object].root];
    return root->function == function || root->function == NONE;
}

static bool find_flags(struct flow *flow, uint32_t f)
{
    struct module *module = flow->module;
    const struct function *function = &module->functions[f];
    struct frame *frame = &flow->frames[f];
    frame->flags = arena_alloc(module->arena, MAX_FLAGS, sizeof *frame->flags);
    if (!frame->flags)
        return false;
    for (uint32_t i = function->first; i <= function->last && frame->flag_count < MAX_FLAGS; i++) {
        const struct inst *inst = &module->insts[i];
        const struct inst *pointer = inst->opcode == SpvOpVariable ? definition_of(module, inst->type) : NULL;
        uint32_t type = pointer ? inst_word(module, pointer, 3) : inst->type;
        bool may_tell = inst->opcode == SpvOpPhi || inst->opcode == SpvOpFunctionCall ||
                        (inst->opcode == SpvOpVariable && flow->slot_of_variable[inst->result]);
        if (may_tell && opcode_of(module, type) == SpvOpTypeBool)
            frame->flags[frame->flag_count++] = inst->result;
    }
    if ((uint64_t)function->block_count * frame->flag_count * frame->object_count > MAX_CELLS)
        frame->flag_count = 0;
    for (uint32_t i = 0; i < frame->flag_count; i++)
        flow->flag_of[frame->flags[i]] = i + 1;
    size_t told = (size_t)function->block_count * frame->flag_count * frame->object_count;
    frame->in_told = arena_alloc(module->arena, told + 1, sizeof *frame->in_told);
    frame->exit_told = arena_alloc(module->arena, frame->object_count + 1u, sizeof *frame->exit_told);
    return frame->in_told && frame->exit_told;
}

static bool frame_make(struct flow *flow, uint32_t f)
{
    struct module *module = flow->module;
    struct frame *frame = &flow->frames[f];
    const struct function *function = &module->functions[f];
    struct analysis *analysis = flow->analysis;
    for (uint32_t o = 0; o < analysis->object_count; o++)
        frame->object_count += in_frame(flow, o, f);
    frame->objects = arena_alloc(module->arena, frame->object_count + 1u, sizeof *frame->objects);
    if (!frame->objects || !find_variables(flow, f))
        return false;
    frame->object_count = 0;
    for (uint32_t o = 0; o < analysis->object_count; o++)
        if (in_frame(flow, o, f))
            frame->objects[frame->object_count++] = o;
    size_t cells = (size_t)function->block_count * frame->object_count;
    frame->entry = arena_alloc(module->arena, frame->object_count + 1u, sizeof *frame->entry);
    frame->exit = arena_alloc(module->arena, frame->object_count + 1u, sizeof *frame->exit);
    frame->in = arena_alloc(module->arena, cells + 1, sizeof *frame->in);
    frame->values = arena_alloc(module->arena, (size_t)function->block_count * frame->variable_count + 1, sizeof *frame->values);
    frame->visited = arena_alloc(module->arena, function->block_count + 1u, sizeof *frame->visited);
    frame->dirty = arena_alloc(module->arena, function->block_count + 1u, sizeof *frame->dirty);
    return frame->entry && frame->exit && frame->in && frame->values && frame->visited && frame->dirty && find_flags(flow, f);
}

static bool affordable(const struct analysis *analysis)
{
    const struct module *module = analysis->module;
    uint64_t cells = 0;
    for (uint32_t f = 0; f < module->function_count; f++) {
        uint64_t variables = 0;
        for (uint32_t i = module->functions[f].first; i <= module->functions[f].last; i++)
            variables += module->insts[i].opcode == SpvOpVariable;
        if (analysis->touches[f])
            cells += module->functions[f].block_count * (analysis->object_count + variables);
    }
    return cells <= MAX_CELLS;
}

/* Processing */

static uint32_t slot_in(const struct frame *frame, uint32_t object)
{
    for (uint32_t o = 0; o < frame->object_count; o++)
        if (frame->objects[o] == object)
            return o;
    return NONE;
}

static void call(struct flow *flow, uint32_t f, const struct inst *inst)
{
    struct module *module = flow->module;
    struct analysis *analysis = flow->analysis;
    uint32_t callee = module->function_of[inst_word(module, inst, 3)];
    if (callee == NONE || !analysis->touches[callee])
        return;
    struct frame *frame = &flow->frames[f], *to = &flow->frames[callee];
    bool changed = !to->reached;
    const uint32_t flag = flow->flag_of[inst->result];
    struct told *result = flag ? &flow->told[(flag - 1) * frame->object_count] : NULL;
    for (uint32_t o = 0; result && o < frame->object_count; o++)
        result[o] = (struct told){flow->cells[o].states, flow->cells[o].states};
    for (uint32_t o = 0; o < to->object_count; o++) {
        const struct root *root = &analysis->roots[analysis->objects[to->objects[o]].root];
        struct cell cell = unknown_cell;
        uint32_t mine = NONE;
        if (root->function == NONE) {
            if (!analysis->names[(size_t)callee * analysis->root_count + analysis->objects[to->objects[o]].root])
                continue;
            mine = slot_in(frame, to->objects[o]);
        } else if (root->parameter != NONE) {
            uint32_t argument = pointer_object(analysis, inst_word(module, inst, 4 + root->parameter));
            mine = argument == NONE ? NONE : slot_in(frame, argument);
        } else {
            continue;
        }
        if (mine != NONE && !root->aliased)
            cell = flow->cells[mine];
        /* Results of this function mean nothing in that one. */
        cell.proceed = cell.candidate_type = cell.committed_type = 0;
        changed |= cell_join(&to->entry[o], &cell, !to->reached);
        if (mine == NONE)
            continue;
        struct cell *back = &flow->cells[mine];
        bool strong = analysis->objects[frame->objects[mine]].strong;
        back->proceed = back->candidate_type = back->committed_type = 0;
        back->flags_known = back->flags_known && to->returns && to->exit[o].flags_known && to->exit[o].flags == back->flags;
        uint32_t after = to->returns ? to->exit[o].states : 0;
        const uint32_t kept = root->aliased ? STATES_ALL : strong ? 0 : back->states;
        back->states = kept | after;
        for (uint32_t g = 0; g < frame->flag_count; g++) {
            struct told *told = &flow->told[g * frame->object_count + mine];
            told->yes = told->yes ? told->yes * !strong | kept | after : 0;
            told->no = told->no ? told->no * !strong | kept | after : 0;
        }
        if (result)
            result[mine] = (struct told){kept | (to->returns ? to->exit_told[o].yes : 0),
                                         kept | (to->returns ? to->exit_told[o].no : 0)};
    }
    if (changed) {
        to->reached = true;
        to->waiting = true;
    }
}

static void leave(struct flow *flow, uint32_t f, const struct inst *last)
{
    struct frame *frame = &flow->frames[f];
    bool changed = !frame->returns;
    const struct inst *value = last->opcode == SpvOpReturnValue ? definition_of(flow->module, inst_word(flow->module, last, 1)) : NULL;
    if (value && opcode_of(flow->module, value->type) == SpvOpTypeBool) {
        tell(flow, flow->cells, flow->told, value->result, flow->join_told);
        for (uint32_t o = 0; o < frame->object_count; o++) {
            struct told *exit = &frame->exit_told[o];
            changed |= (flow->join_told[o].yes & ~exit->yes) || (flow->join_told[o].no & ~exit->no);
            exit->yes |= flow->join_told[o].yes;
            exit->no |= flow->join_told[o].no;
        }
    }
    for (uint32_t o = 0; o < frame->object_count; o++) {
        struct cell cell = flow->cells[o];
        cell.proceed = cell.candidate_type = cell.committed_type = 0;
        changed |= cell_join(&frame->exit[o], &cell, !frame->returns);
    }
    frame->returns = true;
    if (!changed)
        return;
    for (uint32_t g = 0; g < flow->module->function_count; g++)
        if (flow->frames[g].reached) {
            flow->frames[g].waiting = true;
            /* Its calls of this function have to be walked again. */
            const struct function *caller = &flow->module->functions[g];
            for (uint32_t b = 0; b < caller->block_count; b++) {
                const struct block *block = &flow->module->blocks[caller->first_block + b];
                for (uint32_t i = block->first; i <= block->last && !flow->frames[g].dirty[b]; i++)
                    flow->frames[g].dirty[b] = flow->module->insts[i].opcode == SpvOpFunctionCall &&
                                               flow->module->function_of[inst_word(flow->module, &flow->module->insts[i], 3)] == f;
            }
        }
}

/* What the phis of a block tell when it is entered from `from`, an id of a label. */
static void tell_phis(struct flow *flow, const struct block *block, uint32_t from, const struct cell *cells)
{
    const struct module *module = flow->module;
    for (uint32_t i = block->first + 1; i <= block->last; i++) {
        const struct inst *inst = &module->insts[i];
        uint32_t flag = inst->opcode == SpvOpPhi ? flow->flag_of[inst->result] : 0;
        for (uint32_t w = 3; flag && w + 1 < inst->count; w += 2)
            if (inst_word(module, inst, w + 1) == from)
                tell(flow, cells, flow->edge_told, inst_word(module, inst, w), &flow->join_told[(flag - 1) * flow->objects]);
    }
}

/* Enters a block, from the label `from` or, at the start of a function, from none. */
static void go(struct flow *flow, uint32_t f, uint32_t from, uint32_t to, const struct cell *cells)
{
    struct frame *frame = &flow->frames[f];
    const size_t told_count = (size_t)frame->flag_count * frame->object_count;
    uint32_t b = to - flow->module->functions[f].first_block;
    struct cell *in = frame->in + (size_t)b * frame->object_count;
    uint32_t *values = frame->values + (size_t)b * frame->variable_count;
    bool first = !frame->visited[b], changed = first;
    for (uint32_t o = 0; o < frame->object_count; o++)
        changed |= cell_join(&in[o], &cells[o], first);
    if (told_count) {
        struct told *in_told = frame->in_told + (size_t)b * told_count;
        memcpy(flow->join_told, flow->edge_told, told_count * sizeof *flow->join_told);
        tell_phis(flow, &flow->module->blocks[to], from, cells);
        for (size_t i = 0; i < told_count; i++) {
            changed |= (flow->join_told[i].yes & ~in_told[i].yes) || (flow->join_told[i].no & ~in_told[i].no);
            in_told[i].yes |= flow->join_told[i].yes;
            in_told[i].no |= flow->join_told[i].no;
        }
    }
    for (uint32_t v = 0; v < frame->variable_count; v++) {
        uint32_t value = first || values[v] == flow->values[v] ? flow->values[v] : 0;
        changed |= value != values[v];
        values[v] = value;
    }
    frame->visited[b] = true;
    frame->dirty[b] |= changed;
}

/* The successors of a block, each with what its branch says. */
static void branch(struct flow *flow, uint32_t f, const struct block *block)
{
    struct module *module = flow->module;
    const struct inst *last = &module->insts[block->last];
    uint32_t count = flow->frames[f].object_count, cursor = 0, to;
    while (next_successor(module, block, &cursor, &to)) {
        const size_t told_count = (size_t)flow->frames[f].flag_count * count;
        memcpy(flow->edge_cells, flow->cells, count * sizeof *flow->cells);
        if (told_count)
            memcpy(flow->edge_told, flow->told, told_count * sizeof *flow->told);
        if (last->opcode == SpvOpBranchConditional) {
            uint32_t condition = opcode_of(module, inst_word(module, last, 1));
            if ((condition == SpvOpConstantTrue && cursor == 3) || (condition == SpvOpConstantFalse && cursor == 2))
                continue;
            if (inst_word(module, last, 2) != inst_word(module, last, 3))
                refine(flow, flow->edge_cells, flow->told, inst_word(module, last, 1), cursor == 2, 0);
        } else if (last->opcode == SpvOpSwitch) {
            /* Literals of one word only: a wider selector is no type of an intersection. */
            uint32_t selector = value_behind(flow, inst_word(module, last, 1)), uses = 0;
            const struct inst *made = definition_of(module, selector);
            for (uint32_t w = 2; w < last->count; w++)
                uses += inst_word_is_id(module, last, w) && inst_word(module, last, w) == inst_word(module, last, cursor);
            if (made && made->opcode == SpvOpRayQueryGetIntersectionTypeKHR && cursor == 2 && uses == 1) {
                for (uint32_t w = 3; w + 1 < last->count; w += 2)
                    refine_type(flow->edge_cells, count, selector, inst_word(module, last, w), false);
            } else if (made && made->opcode == SpvOpRayQueryGetIntersectionTypeKHR && uses == 1) {
                refine_type(flow->edge_cells, count, selector, inst_word(module, last, cursor - 1), true);
            }
        }
        for (size_t i = 0; i < told_count; i++) {
            flow->edge_told[i].yes &= flow->edge_cells[i % count].states;
            flow->edge_told[i].no &= flow->edge_cells[i % count].states;
        }
        if (last->opcode == SpvOpBranchConditional && inst_word(module, last, 2) != inst_word(module, last, 3)) {
            /* A phi often takes the very condition that led to it. */
            const struct inst *made = definition_of(module, flow->known = inst_word(module, last, 1));
            flow->known_truth = cursor == 2;
            for (int depth = 0; depth < 16 && made && made->opcode == SpvOpLogicalNot; depth++) {
                made = definition_of(module, flow->known = inst_word(module, made, 3));
                flow->known_truth = !flow->known_truth;
            }
        }
        go(flow, f, block->id, to, flow->edge_cells);
        flow->known = 0;
    }
}

static void walk(struct flow *flow, uint32_t f, uint32_t b)
{
    struct module *module = flow->module;
    struct frame *frame = &flow->frames[f];
    const struct block *block = &module->blocks[module->functions[f].first_block + b];
    memcpy(flow->cells, frame->in + (size_t)b * frame->object_count, frame->object_count * sizeof *flow->cells);
    memcpy(flow->values, frame->values + (size_t)b * frame->variable_count, frame->variable_count * sizeof *flow->values);
    const size_t told_count = (size_t)frame->flag_count * frame->object_count;
    if (told_count)
        memcpy(flow->told, frame->in_told + b * told_count, told_count * sizeof *flow->told);
    flow->walk_began = ++flow->clock;
    for (uint32_t i = block->first; i <= block->last; i++) {
        const struct inst *inst = &module->insts[i];
        uint32_t site = flow->analysis->site_of[i];
        if (site != NONE) {
            operate(flow, frame, &flow->analysis->sites[site]);
        } else if (inst->opcode == SpvOpFunctionCall) {
            call(flow, f, inst);
        } else if (inst->opcode == SpvOpLoad) {
            uint32_t slot = flow->slot_of_variable[inst_word(module, inst, 3)];
            flow->alias[inst->result] = slot ? flow->values[slot - 1] : 0;
            flow->loaded[inst->result] = ++flow->clock;
        } else if (inst->opcode == SpvOpStore) {
            uint32_t slot = flow->slot_of_variable[inst_word(module, inst, 1)];
            uint32_t flag = slot ? flow->flag_of[inst_word(module, inst, 1)] : 0;
            if (flag && frame->object_count) {
                /* What is stored may be told of by the variable itself. */
                tell(flow, flow->cells, flow->told, inst_word(module, inst, 2), flow->join_told);
                memcpy(&flow->told[(flag - 1) * frame->object_count], flow->join_told, frame->object_count * sizeof *flow->told);
            }
            if (slot) {
                flow->values[slot - 1] = value_behind(flow, inst_word(module, inst, 2));
                flow->stored[inst_word(module, inst, 1)] = ++flow->clock;
            }
        }
    }
    if (flow->recording)
        return;
    uint32_t last = module->insts[block->last].opcode;
    if (last == SpvOpReturn || last == SpvOpReturnValue)
        leave(flow, f, &module->insts[block->last]);
    branch(flow, f, block);
}

static void slots_of(struct flow *flow, uint32_t f)
{
    flow->objects = flow->frames[f].object_count;
    for (uint32_t o = 0; o < flow->frames[f].object_count; o++)
        flow->slot_of_object[flow->frames[f].objects[o]] = o + 1;
}

static void process(struct flow *flow, uint32_t f)
{
    struct frame *frame = &flow->frames[f];
    struct module *module = flow->module;
    const struct function *function = &module->functions[f];
    if (function->block_count == 0)
        return;
    slots_of(flow, f);
    memset(flow->values, 0, frame->variable_count * sizeof *flow->values);
    for (uint32_t o = 0; o < frame->object_count; o++) {
        const struct root *root = &flow->analysis->roots[flow->analysis->objects[frame->objects[o]].root];
        if (root->function == f && root->parameter == NONE)
            frame->entry[o] = (struct cell){.states = STATE_UNINITIALIZED};
        if (root->aliased)
            frame->entry[o] = unknown_cell;
    }
    for (size_t i = 0; i < (size_t)frame->flag_count * frame->object_count; i++) {
        uint32_t states = frame->entry[i % frame->object_count].states;
        flow->edge_told[i] = (struct told){states, states};
    }
    go(flow, f, 0, function->first_block, frame->entry);
    for (bool again = true; again;) {
        again = false;
        for (uint32_t b = 0; b < function->block_count; b++) {
            if (!frame->dirty[b])
                continue;
            frame->dirty[b] = false;
            if (frame->visited[b] && flow->walks++ < flow->most_walks) {
                again = true;
                walk(flow, f, b);
            }
        }
    }
}

/* Entry points start with every query uninitialized; what nothing in the module calls may be called in any state. */
static void start(struct flow *flow)
{
    struct module *module = flow->module;
    for (uint32_t f = 0; f < module->function_count; f++) {
        struct frame *frame = &flow->frames[f];
        bool called = false, entry = false;
        for (uint32_t i = 0; i < module->inst_count; i++) {
            const struct inst *inst = &module->insts[i];
            called |= inst->opcode == SpvOpFunctionCall && inst_word(module, inst, 3) == module->functions[f].id;
            entry |= inst->opcode == SpvOpEntryPoint && inst_word(module, inst, 2) == module->functions[f].id;
        }
        if (!flow->analysis->touches[f] || (called && !entry))
            continue;
        for (uint32_t o = 0; o < frame->object_count; o++) {
            bool private = flow->analysis->roots[flow->analysis->objects[frame->objects[o]].root].function == NONE;
            frame->entry[o] = entry && private ? (struct cell){.states = STATE_UNINITIALIZED} : unknown_cell;
        }
        frame->reached = frame->waiting = true;
    }
}

static enum gn_spirv_status anything_goes(struct analysis *analysis)
{
    analysis->module->alias = NULL;
    for (uint32_t s = 0; s < analysis->site_count; s++) {
        analysis->sites[s].states = STATES_ALL;
        analysis->sites[s].reachable = true;
    }
    return GN_SPIRV_UNTOUCHED;
}

enum gn_spirv_status flow_run(struct analysis *analysis)
{
    struct module *module = analysis->module;
    struct flow flow = {.analysis = analysis, .module = module};
    uint32_t cells = 1, variables = 1, flags = 1;
    if (!affordable(analysis))
        return anything_goes(analysis);
    flow.frames = arena_alloc(module->arena, module->function_count + 1u, sizeof *flow.frames);
    flow.slot_of_object = arena_alloc(module->arena, analysis->object_count + 1u, sizeof *flow.slot_of_object);
    flow.slot_of_variable = arena_alloc(module->arena, module->bound, sizeof *flow.slot_of_variable);
    flow.alias = arena_alloc(module->arena, module->bound, sizeof *flow.alias);
    flow.flag_of = arena_alloc(module->arena, module->bound, sizeof *flow.flag_of);
    flow.loaded = arena_alloc(module->arena, module->bound, sizeof *flow.loaded);
    flow.stored = arena_alloc(module->arena, module->bound, sizeof *flow.stored);
    if (!flow.frames || !flow.slot_of_object || !flow.slot_of_variable || !flow.alias || !flow.flag_of || !flow.loaded || !flow.stored)
        return GN_SPIRV_OUT_OF_MEMORY;
    module->alias = flow.alias;
    for (uint32_t f = 0; f < module->function_count; f++) {
        if (!analysis->touches[f])
            continue;
        if (!frame_make(&flow, f))
            return GN_SPIRV_OUT_OF_MEMORY;
        if (flow.frames[f].object_count > cells)
            cells = flow.frames[f].object_count;
        if (flow.frames[f].variable_count > variables)
            variables = flow.frames[f].variable_count;
        if (flow.frames[f].flag_count > flags)
            flags = flow.frames[f].flag_count;
    }
    flow.cells = arena_alloc(module->arena, cells, sizeof *flow.cells);
    flow.edge_cells = arena_alloc(module->arena, cells, sizeof *flow.edge_cells);
    flow.values = arena_alloc(module->arena, variables, sizeof *flow.values);
    flow.scratch = arena_alloc(module->arena, cells, sizeof *flow.scratch);
    struct told **tolds[] = {&flow.told, &flow.edge_told, &flow.join_told};
    for (int i = 0; i < 3; i++)
        *tolds[i] = arena_alloc(module->arena, (size_t)flags * cells, sizeof **tolds[i]);
    if (!flow.cells || !flow.edge_cells || !flow.values || !flow.scratch || !flow.told || !flow.edge_told || !flow.join_told)
        return GN_SPIRV_OUT_OF_MEMORY;
    flow.most_walks = 1000 + UINT64_C(200) * module->block_count;
    start(&flow);
    for (bool again = true; again;) {
        again = false;
        for (uint32_t f = 0; f < module->function_count; f++) {
            if (!flow.frames[f].waiting || flow.walks > flow.most_walks)
                continue;
            flow.frames[f].waiting = false;
            again = true;
            process(&flow, f);
        }
    }
    if (flow.walks > flow.most_walks)
        return anything_goes(analysis);
    flow.recording = true;
    for (uint32_t f = 0; f < module->function_count; f++) {
        if (!flow.frames[f].reached)
            continue;
        slots_of(&flow, f);
        for (uint32_t b = 0; b < module->functions[f].block_count; b++)
            if (flow.frames[f].visited[b])
                walk(&flow, f, b);
    }
    return GN_SPIRV_UNTOUCHED;
}
