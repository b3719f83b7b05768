/* SPDX-License-Identifier: Apache-2.0 */
/* Finds what holds ray queries and what is done with them. A query may be a variable, an element of an array or a
 * parameter; anything else that is done with a pointer to one makes the module one that cannot be followed. */
#include <string.h>

#include "checks/spirv/analysis.h"

static const struct operation operations[] = {
#define GN_SPIRV_OPERATION(opcode_, name_, query_, ray_, kind_, needs_)                                                \
    {opcode_, #name_, query_, ray_, OPERATION_##kind_, NEEDS_##needs_},
#include "checks/spirv/operations.def"
#undef GN_SPIRV_OPERATION
};

const struct operation *operation_of(uint32_t opcode)
{
    /* Asked of every instruction: most are of none of the extensions. */
    if (opcode < SpvOpTraceRayKHR || opcode > SpvOpRayQueryGetIntersectionWorldToObjectKHR)
        return NULL;
    for (size_t i = 0; i < sizeof operations / sizeof operations[0]; i++)
        if (operations[i].opcode == opcode)
            return &operations[i];
    return NULL;
}

/* Whether a pointer leads into an input that has that built-in decoration. */
static bool leads_to_builtin(const struct module *module, uint32_t id, uint32_t builtin)
{
    const struct inst *inst = definition_of(module, id);
    for (int depth = 0; depth < 8 && inst && (inst->opcode == SpvOpAccessChain || inst->opcode == SpvOpInBoundsAccessChain); depth++)
        inst = definition_of(module, inst_word(module, inst, 3));
    if (!inst || inst->opcode != SpvOpVariable || inst_word(module, inst, 3) != SpvStorageClassInput)
        return false;
    for (uint32_t i = 0; i < module->globals_end; i++) {
        const struct inst *decoration = &module->insts[i];
        if (decoration->opcode == SpvOpDecorate && inst_word(module, decoration, 1) == inst->result &&
            inst_word(module, decoration, 2) == SpvDecorationBuiltIn && inst_word(module, decoration, 3) == builtin)
            return true;
    }
    return false;
}

const struct operation *operation_at(const struct module *module, const struct inst *inst)
{
    static const struct operation positions = {
        SpvOpLoad, "OpLoad of HitTriangleVertexPositionsKHR", 0, 0, OPERATION_POSITIONS, NEEDS_NOTHING};
    if (inst->opcode == SpvOpLoad && module->reads_positions &&
        leads_to_builtin(module, inst_word(module, inst, 3), SpvBuiltInHitTriangleVertexPositionsKHR))
        return &positions;
    return operation_of(inst->opcode);
}

/* Whether a type is a query, or an array of queries of up to three dimensions; then the number of queries, or 0 if it depends on a
 * specialization constant. */
static bool holds_queries(const struct module *module, uint32_t type, uint32_t *out_elements)
{
    uint32_t elements = 1;
    for (int depth = 0; depth < 4; depth++) {
        const struct inst *inst = definition_of(module, type);
        uint32_t length;
        if (inst && inst->opcode == SpvOpTypeRayQueryKHR) {
            *out_elements = elements;
            return true;
        }
        if (!inst || inst->opcode != SpvOpTypeArray)
            return false;
        if (!constant_u32(module, inst_word(module, inst, 3), &length) || length > 64)
            elements = 0;
        else
            elements *= length;
        type = inst_word(module, inst, 2);
    }
    return false;
}

static bool mentions_queries(const struct module *module, uint32_t type)
{
    uint32_t elements;
    for (int depth = 0; depth < 16; depth++) {
        const struct inst *inst = definition_of(module, type);
        if (!inst)
            return false;
        if (inst->opcode == SpvOpTypeStruct) {
            for (uint32_t w = 2; w < inst->count; w++)
                if (holds_queries(module, inst_word(module, inst, w), &elements))
                    return true;
            return false;
        }
        if (inst->opcode == SpvOpTypeRayQueryKHR)
            return true;
        if (inst->opcode != SpvOpTypeArray && inst->opcode != SpvOpTypeRuntimeArray)
            return false;
        type = inst_word(module, inst, 2);
    }
    return false;
}

uint32_t pointer_root(const struct analysis *analysis, uint32_t id, uint32_t *indices, uint32_t *out_count)
{
    const struct module *module = analysis->module;
    uint32_t found[MAX_INDICES], count = 0;
    for (int depth = 0; depth < 32; depth++) {
        const struct inst *inst = definition_of(module, id);
        if (!inst)
            return NONE;
        if (inst->opcode == SpvOpVariable || inst->opcode == SpvOpFunctionParameter) {
            if (analysis->root_of[id] == NONE)
                return NONE;
            for (uint32_t i = 0; indices && i < count; i++)
                indices[i] = found[count - 1 - i];
            if (out_count)
                *out_count = count;
            return analysis->root_of[id];
        }
        if (inst->opcode == SpvOpAccessChain || inst->opcode == SpvOpInBoundsAccessChain) {
            /* Collected from the last to the first. */
            for (uint32_t w = inst->count; w-- > 4;) {
                if (count == MAX_INDICES)
                    return NONE;
                found[count++] = inst_word(module, inst, w);
            }
        } else if (inst->opcode != SpvOpCopyObject) {
            return NONE;
        }
        id = inst_word(module, inst, 3);
    }
    return NONE;
}

/* The number of the element that constant indices name, or NONE. */
static uint32_t constant_element(const struct module *module, uint32_t type, const uint32_t *indices, uint32_t count)
{
    uint32_t element = 0;
    for (uint32_t i = 0; i < count; i++) {
        const struct inst *array = definition_of(module, type);
        uint32_t length, index;
        if (!array || array->opcode != SpvOpTypeArray || !constant_u32(module, inst_word(module, array, 3), &length) ||
            !constant_u32(module, indices[i], &index) || index >= length)
            return NONE;
        element = element * length + index;
        type = inst_word(module, array, 2);
    }
    return opcode_of(module, type) == SpvOpTypeRayQueryKHR ? element : NONE;
}

/* Whether that many indices into the type lead to one query, all of them integers. */
static bool leads_to_query(const struct module *module, uint32_t type, const uint32_t *indices, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        const struct inst *array = definition_of(module, type), *index = definition_of(module, indices[i]);
        if (!array || array->opcode != SpvOpTypeArray || !index || opcode_of(module, index->type) != SpvOpTypeInt)
            return false;
        type = inst_word(module, array, 2);
    }
    return opcode_of(module, type) == SpvOpTypeRayQueryKHR;
}

uint32_t pointer_object(const struct analysis *analysis, uint32_t id)
{
    uint32_t indices[MAX_INDICES], count = 0;
    uint32_t index = pointer_root(analysis, id, indices, &count);
    if (index == NONE)
        return NONE;
    const struct root *root = &analysis->roots[index];
    if (root->elements == 0 || root->indexed_by)
        return root->first_object;
    uint32_t element = constant_element(analysis->module, root->pointee, indices, count);
    return element < root->elements ? root->first_object + element : NONE;
}

static uint32_t group_of(const struct analysis *analysis, uint32_t root)
{
    while (analysis->roots[root].group != root)
        root = analysis->roots[root].group;
    return root;
}

static void group_join(struct analysis *analysis, uint32_t a, uint32_t b)
{
    a = group_of(analysis, a);
    b = group_of(analysis, b);
    analysis->roots[a < b ? b : a].group = a < b ? a : b;
}

static enum gn_spirv_status find_roots(struct analysis *analysis)
{
    const struct module *module = analysis->module;
    uint32_t count = 0;
    for (uint32_t i = 0; i < module->inst_count; i++) {
        uint32_t opcode = module->insts[i].opcode;
        count += opcode == SpvOpVariable || opcode == SpvOpFunctionParameter;
    }
    analysis->roots = arena_alloc(module->arena, count + 1u, sizeof *analysis->roots);
    analysis->root_of = arena_alloc(module->arena, module->bound, sizeof *analysis->root_of);
    if (!analysis->roots || !analysis->root_of)
        return GN_SPIRV_OUT_OF_MEMORY;
    memset(analysis->root_of, 0xFF, module->bound * sizeof *analysis->root_of);

    uint32_t function = NONE, parameter = 0;
    for (uint32_t i = 0; i < module->inst_count; i++) {
        const struct inst *inst = &module->insts[i];
        if (inst->opcode == SpvOpFunction) {
            function = module->function_of[inst->result];
            parameter = 0;
        }
        if (inst->opcode != SpvOpVariable && inst->opcode != SpvOpFunctionParameter)
            continue;
        uint32_t own_parameter = inst->opcode == SpvOpFunctionParameter ? parameter++ : NONE;
        const struct inst *pointer = definition_of(module, inst->type);
        if (pointer && inst->opcode == SpvOpFunctionParameter && mentions_queries(module, inst->type)) {
            say(module, "parameter %%%u passes a ray query by value", inst->result);
            return GN_SPIRV_DECLINED;
        }
        if (!pointer || pointer->opcode != SpvOpTypePointer)
            continue;
        uint32_t storage = inst_word(module, pointer, 2), pointee = inst_word(module, pointer, 3), elements;
        if (!holds_queries(module, pointee, &elements)) {
            if (!mentions_queries(module, pointee))
                continue;
            say(module, "%%%u holds a ray query inside of a structure, which this version does not follow", inst->result);
            return GN_SPIRV_DECLINED;
        }
        if (storage != SpvStorageClassFunction && storage != SpvStorageClassPrivate) {
            say(module, "%%%u holds a ray query in storage class %u, where only Function and Private can", inst->result,
                storage);
            return GN_SPIRV_DECLINED;
        }
        if ((storage == SpvStorageClassFunction) != (function != NONE) && inst->opcode == SpvOpVariable) {
            say(module, "variable %%%u is not where its storage class belongs", inst->result);
            return GN_SPIRV_DECLINED;
        }
        analysis->root_of[inst->result] = analysis->root_count;
        analysis->roots[analysis->root_count] = (struct root){.id = inst->result,
                                                              .function = function,
                                                              .parameter = own_parameter,
                                                              .storage = storage,
                                                              .pointee = pointee,
                                                              .elements = elements > 64 ? 0 : elements,
                                                              .group = analysis->root_count};
        analysis->root_count++;
    }
    return GN_SPIRV_UNTOUCHED;
}

/* Takes note of a use with indices that are not constant: `first` are those of the first use of the array, if it was one. */
static void note_index(struct analysis *analysis, struct root *root, uint32_t pointer, const uint32_t *indices, uint32_t count, bool first_use)
{
    uint32_t first[MAX_INDICES], first_count = 0;
    if (first_use && root->parameter == NONE) /* what a parameter stands for is indexed by others too */
        root->indexed_by = count ? pointer : 0;
    if (root->indexed_by)
        pointer_root(analysis, root->indexed_by, first, &first_count);
    if (!root->indexed_by || first_count != count || !indices_same(analysis, root->function, first, indices, count)) {
        root->elements = 0;
        root->indexed_by = 0;
    }
}

/* An array falls back to one object for all its elements when any use of it is not of one constant element, unless all uses have one index. */
static bool uses_are_known(struct analysis *analysis)
{
    struct module *module = analysis->module;
    bool *used = arena_alloc(module->arena, analysis->root_count + 1u, sizeof *used);
    if (!used) {
        say(module, "out of memory");
        return false;
    }
    for (uint32_t i = 0; i < module->inst_count; i++) {
        const struct inst *inst = &module->insts[i];
        const struct operation *operation = operation_of(inst->opcode);
        uint32_t number;
        if (inst->opcode == SpvOpName || inst->opcode == SpvOpEntryPoint || inst->opcode == SpvOpDecorate ||
            inst->opcode == SpvOpVariable || inst->opcode == SpvOpFunctionParameter || is_debug(module, inst, &number))
            continue;
        for (uint32_t w = 1; w < inst->count; w++) {
            if (!inst_word_is_id(module, inst, w) || inst_word(module, inst, w) == inst->result)
                continue;
            uint32_t indices[MAX_INDICES], count = 0;
            uint32_t r = pointer_root(analysis, inst_word(module, inst, w), indices, &count);
            if (r == NONE)
                continue;
            struct root *root = &analysis->roots[r];
            bool chain = inst->opcode == SpvOpAccessChain || inst->opcode == SpvOpInBoundsAccessChain ||
                         inst->opcode == SpvOpCopyObject;
            if (chain && w == 3)
                continue;
            bool call = inst->opcode == SpvOpFunctionCall && w >= 4;
            if (!call && !(operation && operation->query_word == w)) {
                say(module, "the ray query %%%u is used by opcode %u at word %u, which this version does not follow",
                    root->id, inst->opcode, inst->offset);
                return false;
            }
            if (!call && !leads_to_query(module, root->pointee, indices, count)) {
                say(module, "%s at word %u is not given one ray query", operation->name, inst->offset);
                return false;
            }
            if (call && count > 0) {
                say(module, "the call at word %u passes an element of the array of ray queries %%%u", inst->offset, root->id);
                return false;
            }
            bool first_use = !used[r], constant = constant_element(module, root->pointee, indices, count) != NONE;
            used[r] = true;
            if (!constant || root->indexed_by)
                note_index(analysis, root, inst_word(module, inst, w), indices, count, first_use);
        }
        if (operation && operation->query_word &&
            pointer_root(analysis, inst_word(module, inst, operation->query_word), NULL, NULL) == NONE) {
            say(module, "the ray query of %s at word %u is not a variable or parameter that can be followed", operation->name,
                inst->offset);
            return false;
        }
    }
    return true;
}

#define MAX_NAMES (16u << 20)

static void name(struct analysis *analysis, uint32_t function, uint32_t root)
{
    if (root != NONE && analysis->roots[root].function == NONE)
        analysis->names[(size_t)function * analysis->root_count + root] = true;
}

/* Functions that operate on queries, and no recursion (which Vulkan forbids). Joins arguments with parameters. */
static enum gn_spirv_status follow_calls(struct analysis *analysis)
{
    struct module *module = analysis->module;
    uint32_t functions = module->function_count;
    uint32_t *height = arena_alloc(module->arena, functions + 1u, sizeof *height);
    analysis->touches = arena_alloc(module->arena, functions + 1u, sizeof *analysis->touches);
    if ((uint64_t)functions * analysis->root_count > MAX_NAMES) {
        say(module, "%u functions and %u ray queries are more than this version follows", functions, analysis->root_count);
        return GN_SPIRV_DECLINED;
    }
    analysis->names = arena_alloc(module->arena, (size_t)functions * analysis->root_count + 1, sizeof *analysis->names);
    analysis->stages = arena_alloc(module->arena, functions + 1u, sizeof *analysis->stages);
    if (!analysis->stages || !height || !analysis->touches || !analysis->names)
        return GN_SPIRV_OUT_OF_MEMORY;
    for (uint32_t i = 0; i < analysis->site_count; i++)
        name(analysis, module->blocks[analysis->sites[i].block].function, analysis->sites[i].root);
    for (uint32_t i = 0; i < analysis->site_count; i++)
        analysis->touches[module->blocks[analysis->sites[i].block].function] = true;
    for (uint32_t i = 0; i < analysis->root_count; i++)
        if (analysis->roots[i].parameter != NONE)
            analysis->touches[analysis->roots[i].function] = true;
    for (uint32_t i = 0; i < module->globals_end; i++) {
        const struct inst *inst = &module->insts[i];
        uint32_t entry = inst->opcode == SpvOpEntryPoint ? module->function_of[inst_word(module, inst, 2)] : NONE;
        if (entry != NONE)
            analysis->stages[entry] |= inst_word(module, inst, 1) == SpvExecutionModelRayGenerationKHR ? STAGE_RAYGEN : STAGE_NESTED;
    }
    bool changed = true;
    while (changed) {
        changed = false;
        for (uint32_t b = 0; b < module->block_count; b++) {
            const struct block *block = &module->blocks[b];
            for (uint32_t i = block->first; i <= block->last; i++) {
                const struct inst *inst = &module->insts[i];
                if (inst->opcode != SpvOpFunctionCall)
                    continue;
                uint32_t callee = module->function_of[inst_word(module, inst, 3)];
                if (callee == NONE) {
                    say(module, "the call at word %u calls %%%u, which is not a function", inst->offset,
                        inst_word(module, inst, 3));
                    return GN_SPIRV_DECLINED;
                }
                if (inst->count - 4u != module->functions[callee].parameter_count) {
                    say(module, "the call at word %u has %u arguments for %u parameters", inst->offset, inst->count - 4u,
                        module->functions[callee].parameter_count);
                    return GN_SPIRV_DECLINED;
                }
                if (height[block->function] <= height[callee]) {
                    height[block->function] = height[callee] + 1;
                    changed = true;
                    if (height[block->function] > functions) {
                        say(module, "function %%%u is recursive", module->functions[callee].id);
                        return GN_SPIRV_DECLINED;
                    }
                }
                if (analysis->touches[callee] && !analysis->touches[block->function])
                    analysis->touches[block->function] = changed = true;
                if (analysis->stages[block->function] & ~analysis->stages[callee]) {
                    analysis->stages[callee] |= analysis->stages[block->function];
                    changed = true;
                }
                for (uint32_t a = 4; a < inst->count; a++)
                    name(analysis, block->function, pointer_root(analysis, inst_word(module, inst, a), NULL, NULL));
                for (uint32_t r = 0; r < analysis->root_count; r++)
                    if (analysis->names[(size_t)callee * analysis->root_count + r] &&
                        !analysis->names[(size_t)block->function * analysis->root_count + r])
                        changed = analysis->names[(size_t)block->function * analysis->root_count + r] = true;
            }
        }
    }

    for (uint32_t f = 0; f < functions; f++)
        if (analysis->stages[f] == 0)
            analysis->stages[f] = STAGE_RAYGEN | STAGE_NESTED;

    for (uint32_t b = 0; b < module->block_count; b++) {
        const struct block *block = &module->blocks[b];
        for (uint32_t i = block->first; i <= block->last; i++) {
            const struct inst *inst = &module->insts[i];
            if (inst->opcode != SpvOpFunctionCall)
                continue;
            size_t function_index = module->function_of[inst_word(module, inst, 3)];
            const struct function *callee = &module->functions[function_index];
            if (callee->block_count == 0 && analysis->touches[function_index]) {
                say(module, "function %%%u has a ray query for a parameter but no body", callee->id);
                return GN_SPIRV_DECLINED;
            }
            for (uint32_t a = 4; a < inst->count; a++) {
                uint32_t parameter = module->insts[callee->first_parameter + (a - 4)].result;
                uint32_t argument = pointer_root(analysis, inst_word(module, inst, a), NULL, NULL);
                uint32_t to = analysis->root_of[parameter];
                if ((argument == NONE) != (to == NONE)) {
                    say(module, "argument %u of the call at word %u does not fit its parameter", a - 4, inst->offset);
                    return GN_SPIRV_DECLINED;
                }
                if (to == NONE)
                    continue;
                group_join(analysis, argument, to);
                struct root *from = &analysis->roots[argument];
                if (from->pointee != analysis->roots[to].pointee) {
                    say(module, "argument %u of the call at word %u has another type than its parameter", a - 4, inst->offset);
                    return GN_SPIRV_DECLINED;
                }
                /* The callee knows it under two names: its parameter's and its own. */
                if (from->function == NONE && analysis->names[function_index * analysis->root_count + argument])
                    from->aliased = analysis->roots[to].aliased = true;
                for (uint32_t other = 4; other < a; other++)
                    if (pointer_root(analysis, inst_word(module, inst, other), NULL, NULL) == argument) {
                        from->aliased = analysis->roots[to].aliased = true;
                        analysis->roots[analysis->root_of[module->insts[callee->first_parameter + (other - 4)].result]].aliased =
                            true;
                    }
            }
        }
    }
    return GN_SPIRV_UNTOUCHED;
}

/* What holds for one member of a group has to hold for all: a parameter stands for each of its arguments. */
static void settle_groups(struct analysis *analysis)
{
    for (int pass = 0; pass < 2; pass++)
        for (uint32_t i = 0; i < analysis->root_count; i++) {
            struct root *root = &analysis->roots[i], *group = &analysis->roots[group_of(analysis, i)];
            bool array = opcode_of(analysis->module, root->pointee) == SpvOpTypeArray;
            group->aliased |= root->aliased;
            if (array && group_of(analysis, i) != i)
                group->elements = root->elements = 0;
            if (array && group->elements == 0)
                root->elements = 0;
            root->aliased = group->aliased;
            root->group = group_of(analysis, i);
        }
}

static enum gn_spirv_status find_sites(struct analysis *analysis)
{
    struct module *module = analysis->module;
    uint32_t count = 0;
    for (uint32_t i = 0; i < module->inst_count; i++)
        count += operation_at(module, &module->insts[i]) != NULL;
    analysis->sites = arena_alloc(module->arena, count + 1u, sizeof *analysis->sites);
    analysis->site_of = arena_alloc(module->arena, module->inst_count, sizeof *analysis->site_of);
    if (!analysis->sites || !analysis->site_of)
        return GN_SPIRV_OUT_OF_MEMORY;
    memset(analysis->site_of, 0xFF, module->inst_count * sizeof *analysis->site_of);
    for (uint32_t b = 0; b < module->block_count; b++) {
        const struct block *block = &module->blocks[b];
        for (uint32_t i = block->first; i <= block->last; i++) {
            const struct inst *inst = &module->insts[i];
            const struct operation *operation = operation_at(module, inst);
            if (!operation)
                continue;
            const uint32_t unfit = operands_unfit(module, inst, operation);
            if (unfit) {
                say(module, "word %u of %s at word %u is of a type that the operation does not take", unfit, operation->name,
                    inst->offset);
                return GN_SPIRV_DECLINED;
            }
            struct site *site = &analysis->sites[analysis->site_count];
            *site = (struct site){.inst = i, .block = b, .operation = operation, .root = NONE, .object = NONE};
            if (operation->query_word)
                site->root = pointer_root(analysis, inst_word(module, inst, operation->query_word), NULL, NULL);
            if (operation->kind == OPERATION_GET || operation->kind == OPERATION_GET_TYPE) {
                uint32_t which;
                if (!constant_u32(module, inst_word(module, inst, 4), &which) || which > 1) {
                    say(module, "the intersection of %s at word %u is not a constant 0 or 1", operation->name, inst->offset);
                    return GN_SPIRV_DECLINED;
                }
                site->committed = which == 1;
            }
            analysis->site_of[i] = analysis->site_count++;
        }
    }
    return GN_SPIRV_UNTOUCHED;
}

enum gn_spirv_status objects_find(struct analysis *analysis)
{
    struct module *module = analysis->module;
    enum gn_spirv_status status = find_roots(analysis);
    if (status != GN_SPIRV_UNTOUCHED)
        return status;
    if (!uses_are_known(analysis))
        return GN_SPIRV_DECLINED;
    status = find_sites(analysis);
    if (status == GN_SPIRV_UNTOUCHED)
        status = follow_calls(analysis);
    if (status != GN_SPIRV_UNTOUCHED)
        return status;
    settle_groups(analysis);
    for (uint32_t i = 0; i < analysis->root_count; i++)
        if (analysis->roots[i].indexed_by)
            analysis->roots[i].elements = 1;
    for (uint32_t i = 0; i < analysis->root_count; i++) {
        analysis->roots[i].first_object = analysis->object_count;
        analysis->object_count += analysis->roots[i].elements ? analysis->roots[i].elements : 1;
    }
    analysis->objects = arena_alloc(module->arena, analysis->object_count + 1u, sizeof *analysis->objects);
    if (!analysis->objects)
        return GN_SPIRV_OUT_OF_MEMORY;
    for (uint32_t i = 0; i < analysis->root_count; i++) {
        const struct root *root = &analysis->roots[i];
        for (uint32_t e = 0; e < (root->elements ? root->elements : 1); e++)
            analysis->objects[root->first_object + e] = (struct object){.root = i, .strong = root->elements != 0};
    }
    for (uint32_t i = 0; i < analysis->site_count; i++) {
        const struct inst *inst = &module->insts[analysis->sites[i].inst];
        if (analysis->sites[i].root == NONE)
            continue;
        analysis->sites[i].object = pointer_object(analysis, inst_word(module, inst, analysis->sites[i].operation->query_word));
        if (analysis->sites[i].object == NONE) {
            say(module, "the ray query of %s at word %u cannot be told", analysis->sites[i].operation->name, inst->offset);
            return GN_SPIRV_DECLINED;
        }
    }
    return GN_SPIRV_UNTOUCHED;
}
