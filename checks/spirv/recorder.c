/* SPDX-License-Identifier: Apache-2.0 */
/* The device's side of the record buffer (records.h): its variable, the built-ins that tell invocations apart, and the function
 * that counts a check and keeps its first records. */
#include "checks/spirv/records.h"
#include "checks/spirv/writer.h"

static uint32_t version_of(const struct module *module)
{
    return module->words[1];
}

/* An input of the module with that built-in decoration, or 0. */
static uint32_t find_builtin(const struct module *module, uint32_t builtin)
{
    for (uint32_t i = 0; i < module->globals_end; i++) {
        const struct inst *inst = &module->insts[i];
        if (inst->opcode == SpvOpDecorate && inst->count == 4 && inst_word(module, inst, 2) == SpvDecorationBuiltIn &&
            inst_word(module, inst, 3) == builtin) {
            const struct inst *variable = definition_of(module, inst_word(module, inst, 1));
            if (variable && variable->opcode == SpvOpVariable && inst_word(module, variable, 3) == SpvStorageClassInput)
                return variable->result;
        }
    }
    return 0;
}

/* 0 when the module has that built-in with another type, as there can be only one. */
static uint32_t builtin_make(struct writer *writer, uint32_t builtin, uint32_t type)
{
    uint32_t found = find_builtin(writer->module, builtin);
    if (found) {
        const struct inst *pointer = definition_of(writer->module, definition_of(writer->module, found)->type);
        uint32_t pointee = pointer ? inst_word(writer->module, pointer, 3) : 0;
        const struct inst *of = definition_of(writer->module, pointee);
        bool integers = of && of->opcode == SpvOpTypeInt && inst_word(writer->module, of, 2) == 32 && type == type_uint(writer);
        return pointee == type || integers ? found : 0;
    }
    const struct words *made = &writer->decorations;
    for (size_t at = 0; at < made->count; at += made->data[at] >> 16)
        if (made->data[at] == (4u << 16 | SpvOpDecorate) && made->data[at + 2] == SpvDecorationBuiltIn &&
            made->data[at + 3] == builtin)
            return made->data[at + 1];
    uint32_t pointer = type_pointer(writer, SpvStorageClassInput, type), id = new_id(writer);
    EMIT(&writer->globals, SpvOpVariable, pointer, id, SpvStorageClassInput);
    EMIT(&writer->decorations, SpvOpDecorate, id, SpvDecorationBuiltIn, builtin);
    return id;
}

bool hit_shaders_only(const struct module *module)
{
    for (uint32_t i = 0; i < module->globals_end; i++) {
        const struct inst *inst = &module->insts[i];
        if (inst->opcode == SpvOpEntryPoint && inst_word(module, inst, 1) != SpvExecutionModelAnyHitKHR &&
            inst_word(module, inst, 1) != SpvExecutionModelClosestHitKHR)
            return false;
    }
    return true;
}

/* The built-ins that tell the invocations of a shader stage apart. */
enum invocation_kind { INVOCATION_NONE, INVOCATION_COMPUTE, INVOCATION_FRAGMENT, INVOCATION_VERTEX, INVOCATION_LAUNCH };

static enum invocation_kind invocation_of(uint32_t model)
{
    switch (model) {
    case SpvExecutionModelGLCompute:
    case SpvExecutionModelTaskEXT:
    case SpvExecutionModelMeshEXT:
    case SpvExecutionModelTaskNV:
    case SpvExecutionModelMeshNV: return INVOCATION_COMPUTE;
    case SpvExecutionModelFragment: return INVOCATION_FRAGMENT;
    case SpvExecutionModelVertex: return INVOCATION_VERTEX;
    case SpvExecutionModelRayGenerationKHR:
    case SpvExecutionModelIntersectionKHR:
    case SpvExecutionModelAnyHitKHR:
    case SpvExecutionModelClosestHitKHR:
    case SpvExecutionModelMissKHR:
    case SpvExecutionModelCallableKHR: return INVOCATION_LAUNCH;
    default: return INVOCATION_NONE;
    }
}

static void invocation_prepare(struct writer *writer)
{
    const struct module *module = writer->module;
    bool first = true;
    /* The record function is one for all entry points, so it can read a built-in only if all have it. */
    for (uint32_t i = 0; i < module->globals_end; i++) {
        const struct inst *inst = &module->insts[i];
        if (inst->opcode != SpvOpEntryPoint)
            continue;
        enum invocation_kind kind = invocation_of(inst_word(module, inst, 1));
        writer->invocation_kind = first || writer->invocation_kind == kind ? kind : INVOCATION_NONE;
        first = false;
    }
    switch (writer->invocation_kind) {
    case INVOCATION_COMPUTE:
        writer->invocation[0] = builtin_make(writer, SpvBuiltInGlobalInvocationId, type_uint3(writer));
        break;
    case INVOCATION_FRAGMENT:
        writer->invocation[0] =
            builtin_make(writer, SpvBuiltInFragCoord, TYPE(writer, SpvOpTypeVector, type_float(writer), 4));
        break;
    case INVOCATION_VERTEX:
        writer->invocation[0] = builtin_make(writer, SpvBuiltInVertexIndex, type_uint(writer));
        writer->invocation[1] = builtin_make(writer, SpvBuiltInInstanceIndex, type_uint(writer));
        break;
    case INVOCATION_LAUNCH: writer->invocation[0] = builtin_make(writer, SpvBuiltInLaunchIdKHR, type_uint3(writer)); break;
    default: break;
    }
    for (int i = 0; i < 2; i++)
        if (writer->invocation[i])
            words_add(&writer->interface, &writer->invocation[i], 1);
}

/* Whether the module leaves the records' descriptor to us. */
static bool descriptor_is_free(const struct writer *writer)
{
    const struct gn_spirv_options *options = writer->analysis->options;
    const struct module *module = writer->module;
    for (uint32_t i = 0; i < module->globals_end; i++) {
        const struct inst *inst = &module->insts[i];
        if (inst->opcode != SpvOpDecorate || inst_word(module, inst, 2) != SpvDecorationBinding ||
            inst_word(module, inst, 3) != options->binding)
            continue;
        for (uint32_t j = 0; j < module->globals_end; j++) {
            const struct inst *set = &module->insts[j];
            if (set->opcode == SpvOpDecorate && inst_word(module, set, 1) == inst_word(module, inst, 1) &&
                inst_word(module, set, 2) == SpvDecorationDescriptorSet && inst_word(module, set, 3) == options->set) {
                say(module, "the module itself uses set %u, binding %u, which is meant for records", options->set,
                    options->binding);
                return false;
            }
        }
    }
    return true;
}

bool records_prepare(struct writer *writer)
{
    const struct gn_spirv_options *options = writer->analysis->options;
    const struct module *module = writer->module;
    if (!options->root && !descriptor_is_free(writer))
        return false;
    /* First, in this order: C leaves open in which order the operands of a call are made, and ids must not depend on it. */
    type_void(writer);
    type_bool(writer);
    type_uint(writer);
    type_float(writer);
    type_uint3(writer);
    type_bool3(writer);
    /* Arrays and structures of its own: those of the module may carry other decorations. */
    uint32_t array = new_id(writer), structure = new_id(writer);
    uint32_t uint_ = type_uint(writer);
    EMIT(&writer->globals, SpvOpTypeRuntimeArray, array, uint_);
    EMIT(&writer->globals, SpvOpTypeStruct, structure, array);
    EMIT(&writer->decorations, SpvOpDecorate, array, SpvDecorationArrayStride, 4);
    EMIT(&writer->decorations, SpvOpDecorate, structure, SpvDecorationBlock);
    EMIT(&writer->decorations, SpvOpMemberDecorate, structure, 0, SpvDecorationOffset, 0);
    writer->buffer_class = options->root ? SpvStorageClassPhysicalStorageBuffer : SpvStorageClassStorageBuffer;
    writer->buffer_pointer = type_pointer(writer, writer->buffer_class, structure);
    if (!options->root) {
        writer->buffer = new_id(writer);
        EMIT(&writer->globals, SpvOpVariable, writer->buffer_pointer, writer->buffer, SpvStorageClassStorageBuffer);
        EMIT(&writer->decorations, SpvOpDecorate, writer->buffer, SpvDecorationDescriptorSet, options->set);
        EMIT(&writer->decorations, SpvOpDecorate, writer->buffer, SpvDecorationBinding, options->binding);
        if (version_of(module) >= 0x10400)
            words_add(&writer->interface, &writer->buffer, 1);
    }
    invocation_prepare(writer);

    uint32_t parameters[15] = {type_void(writer)};
    for (int i = 1; i < 14; i++)
        parameters[i] = uint_;
    writer->record_type = type_make(writer, SpvOpTypeFunction, parameters, 14);
    writer->record_function = new_id(writer);
    return true;
}

static uint32_t buffer_word(struct writer *writer, uint32_t index)
{
    uint32_t pointer = type_pointer(writer, writer->buffer_class, type_uint(writer));
    return COMPUTE(writer, SpvOpAccessChain, pointer, writer->buffer, constant_uint(writer, 0), index);
}

/* A physical pointer has to say how it is aligned. */
static uint32_t word_load(struct writer *writer, uint32_t index)
{
    uint32_t word = buffer_word(writer, index), uint_ = type_uint(writer);
    if (writer->buffer_class == SpvStorageClassPhysicalStorageBuffer)
        return COMPUTE(writer, SpvOpLoad, uint_, word, SpvMemoryAccessAlignedMask, 4);
    return COMPUTE(writer, SpvOpLoad, uint_, word);
}

static void word_store(struct writer *writer, uint32_t index, uint32_t value)
{
    uint32_t word = buffer_word(writer, index);
    if (writer->buffer_class == SpvStorageClassPhysicalStorageBuffer)
        EMIT(&writer->out, SpvOpStore, word, value, SpvMemoryAccessAlignedMask, 4);
    else
        EMIT(&writer->out, SpvOpStore, word, value);
}

static uint32_t atomic_add(struct writer *writer, uint32_t index, uint32_t value)
{
    /* Device scope needs a capability of its own under the Vulkan memory model; QueueFamily orders what one queue runs. */
    uint32_t scope = SpvScopeDevice;
    for (uint32_t i = 0; i < writer->module->globals_end; i++) {
        const struct inst *inst = &writer->module->insts[i];
        if (inst->opcode == SpvOpMemoryModel && inst_word(writer->module, inst, 2) == SpvMemoryModelVulkan)
            scope = SpvScopeQueueFamily;
    }
    uint32_t word = buffer_word(writer, index), scope_id = constant_uint(writer, scope), relaxed = constant_uint(writer, 0);
    return COMPUTE(writer, SpvOpAtomicIAdd, type_uint(writer), word, scope_id, relaxed, value);
}

static void invocation_load(struct writer *writer, uint32_t out[3])
{
    uint32_t uint_ = type_uint(writer), zero = constant_uint(writer, 0);
    out[0] = out[1] = out[2] = zero;
    if (!writer->invocation[0])
        return;
    for (int i = 0; i < 2 && writer->invocation[i]; i++) {
        const struct inst *variable = definition_of(writer->module, writer->invocation[i]);
        const struct inst *pointer = variable ? definition_of(writer->module, variable->type) : NULL;
        uint32_t type = pointer ? inst_word(writer->module, pointer, 3) : 0;
        if (writer->invocation_kind == INVOCATION_VERTEX) {
            uint32_t value = COMPUTE(writer, SpvOpLoad, type ? type : uint_, writer->invocation[i]);
            out[i] = type && type != uint_ ? COMPUTE(writer, SpvOpBitcast, uint_, value) : value;
            continue;
        }
        bool fragment = writer->invocation_kind == INVOCATION_FRAGMENT;
        uint32_t scalar = fragment ? type_float(writer) : uint_;
        if (!type)
            type = fragment ? TYPE(writer, SpvOpTypeVector, scalar, 4) : type_uint3(writer);
        uint32_t value = COMPUTE(writer, SpvOpLoad, type, writer->invocation[i]);
        for (uint32_t c = 0; c < 3; c++) {
            out[c] = COMPUTE(writer, SpvOpCompositeExtract, scalar, value, c);
            if (fragment)
                out[c] = COMPUTE(writer, SpvOpBitcast, uint_, out[c]);
        }
    }
}

/* Keeps the operands of one firing. */
static void record_write(struct writer *writer, uint32_t base, uint32_t state, const uint32_t *operands)
{
    uint32_t uint_ = type_uint(writer), values[GN_RECORD_WORDS] = {state};
    invocation_load(writer, values + GN_RECORD_INVOCATION);
    for (int i = 0; i < GN_RECORD_OPERANDS; i++)
        values[GN_RECORD_OPERAND + i] = operands[i];
    uint32_t sum = constant_uint(writer, 0x9E3779B9u), prime = constant_uint(writer, 0x01000193u);
    for (int i = 0; i < GN_RECORD_CHECKSUM; i++) {
        sum = COMPUTE(writer, SpvOpBitwiseXor, uint_, sum, values[i]);
        sum = COMPUTE(writer, SpvOpIMul, uint_, sum, prime);
    }
    values[GN_RECORD_CHECKSUM] = sum;
    values[GN_RECORD_WRITTEN] = constant_uint(writer, 1);
    for (uint32_t i = 0; i < GN_RECORD_WORDS; i++) {
        uint32_t index = COMPUTE(writer, SpvOpIAdd, uint_, base, constant_uint(writer, i));
        word_store(writer, index, values[i]);
    }
}

static uint32_t pointer_make(struct writer *writer, uint32_t low, uint32_t high)
{
    uint32_t address = COMPUTE(writer, SpvOpCompositeConstruct, TYPE(writer, SpvOpTypeVector, type_uint(writer), 2), low, high);
    return COMPUTE(writer, SpvOpBitcast, writer->buffer_pointer, address);
}

uint32_t structures_load(struct writer *writer, uint32_t id)
{
    uint32_t before = writer->buffer;
    uint64_t address = writer->analysis->options->structures;
    uint32_t low = constant_uint(writer, (uint32_t)address), high = constant_uint(writer, (uint32_t)(address >> 32));
    writer->buffer = pointer_make(writer, low, high);
    uint32_t state = word_load(writer, id);
    writer->buffer = before;
    return state;
}

/* The buffer whose header speaks of the launch, for code outside of the function that records. */
static void launch_begin(struct writer *writer)
{
    uint64_t root = writer->analysis->options->root;
    if (!root)
        return;
    uint32_t low = constant_uint(writer, (uint32_t)root), high = constant_uint(writer, (uint32_t)(root >> 32));
    writer->buffer = pointer_make(writer, low, high);
}

uint32_t launch_callables(struct writer *writer)
{
    launch_begin(writer);
    return word_load(writer, constant_uint(writer, GN_LAUNCH_CALLABLES));
}

uint32_t builtin_load(struct writer *writer, uint32_t builtin, uint32_t type)
{
    uint32_t variable = builtin_make(writer, builtin, type);
    bool listed = false;
    if (!variable)
        return 0;
    for (size_t i = 0; i < writer->interface.count; i++)
        listed |= writer->interface.data[i] == variable;
    if (!listed)
        words_add(&writer->interface, &variable, 1);
    const struct inst *definition = definition_of(writer->module, variable);
    const struct inst *pointer = definition ? definition_of(writer->module, definition->type) : NULL;
    uint32_t own = pointer ? inst_word(writer->module, pointer, 3) : type, value = COMPUTE(writer, SpvOpLoad, own, variable);
    return own == type ? value : COMPUTE(writer, SpvOpBitcast, type, value);
}

uint32_t launch_depth_enter(struct writer *writer)
{
    uint32_t uint_ = type_uint(writer), id = builtin_load(writer, SpvBuiltInLaunchIdKHR, type_uint3(writer));
    uint32_t size = builtin_load(writer, SpvBuiltInLaunchSizeKHR, type_uint3(writer)), scratch = constant_uint(writer, GN_LAUNCH_SCRATCH);
    writer->depth_word = scratch;
    if (!id || !size)
        return constant_uint(writer, 0);
    uint32_t index = COMPUTE(writer, SpvOpCompositeExtract, uint_, id, 2);
    for (uint32_t axis = 2; axis-- > 0;) {
        uint32_t extent = COMPUTE(writer, SpvOpCompositeExtract, uint_, size, axis);
        uint32_t at = COMPUTE(writer, SpvOpCompositeExtract, uint_, id, axis);
        index = COMPUTE(writer, SpvOpIMul, uint_, index, extent);
        index = COMPUTE(writer, SpvOpIAdd, uint_, index, at);
    }
    launch_begin(writer);
    uint32_t first = word_load(writer, constant_uint(writer, GN_LAUNCH_DEPTHS));
    uint32_t count = word_load(writer, constant_uint(writer, GN_LAUNCH_DEPTH_COUNT));
    uint32_t counted = COMPUTE(writer, SpvOpULessThan, type_bool(writer), index, count);
    uint32_t zero = constant_uint(writer, 0);
    index = COMPUTE(writer, SpvOpIAdd, uint_, index, first);
    writer->depth_word = COMPUTE(writer, SpvOpSelect, uint_, counted, index, scratch);
    uint32_t one = constant_uint(writer, 1), depth = atomic_add(writer, writer->depth_word, one);
    depth = COMPUTE(writer, SpvOpIAdd, uint_, depth, one);
    return COMPUTE(writer, SpvOpSelect, uint_, counted, depth, zero);
}

void launch_depth_leave(struct writer *writer)
{
    launch_begin(writer);
    atomic_add(writer, writer->depth_word, constant_uint(writer, UINT32_MAX));
}

/* Looks the module's buffer up in the table; the one without room when it is not there. Returns the table. */
static uint32_t buffer_find(struct writer *writer)
{
    const struct gn_spirv_options *options = writer->analysis->options;
    uint32_t uint_ = type_uint(writer), bool_ = type_bool(writer), start, header = new_id(writer), next = new_id(writer);
    uint32_t done = new_id(writer), at = new_id(writer), next_at = new_id(writer), tries = new_id(writer);
    uint32_t next_tries = new_id(writer), zero = constant_uint(writer, 0), one = constant_uint(writer, 1);
    uint32_t key[2], root[2], nowhere[2];
    for (int i = 0; i < 2; i++) {
        key[i] = constant_uint(writer, (uint32_t)(options->key >> 32 * i));
        root[i] = constant_uint(writer, (uint32_t)(options->root >> 32 * i));
        nowhere[i] = constant_uint(writer, (uint32_t)((options->root + 4 * GN_ROOT_EMPTY) >> 32 * i));
    }
    uint32_t table = writer->buffer = pointer_make(writer, root[0], root[1]);
    uint32_t capacity = word_load(writer, constant_uint(writer, GN_ROOT_CAPACITY));
    uint32_t mask = COMPUTE(writer, SpvOpISub, uint_, capacity, one);
    start = writer->label;
    EMIT(&writer->out, SpvOpBranch, header);
    label_begin(writer, header);
    EMIT(&writer->out, SpvOpPhi, uint_, at, key[0], start, next_at, next);
    EMIT(&writer->out, SpvOpPhi, uint_, tries, zero, start, next_tries, next);
    uint32_t slot = COMPUTE(writer, SpvOpBitwiseAnd, uint_, at, mask);
    slot = COMPUTE(writer, SpvOpIMul, uint_, slot, constant_uint(writer, GN_ROOT_ENTRY));
    uint32_t words[4], same[2];
    for (uint32_t i = 0; i < 4; i++) {
        words[i] = COMPUTE(writer, SpvOpIAdd, uint_, slot, constant_uint(writer, GN_ROOT_HEADER + i));
        words[i] = word_load(writer, words[i]);
    }
    for (int i = 0; i < 2; i++)
        same[i] = COMPUTE(writer, SpvOpIEqual, bool_, words[i], key[i]);
    uint32_t found = COMPUTE(writer, SpvOpLogicalAnd, bool_, same[0], same[1]);
    uint32_t any = COMPUTE(writer, SpvOpBitwiseOr, uint_, words[0], words[1]);
    uint32_t over = COMPUTE(writer, SpvOpIEqual, bool_, any, zero);
    uint32_t round = COMPUTE(writer, SpvOpUGreaterThanEqual, bool_, tries, capacity);
    over = COMPUTE(writer, SpvOpLogicalOr, bool_, over, found);
    over = COMPUTE(writer, SpvOpLogicalOr, bool_, over, round);
    EMIT(&writer->out, SpvOpLoopMerge, done, next, 0);
    EMIT(&writer->out, SpvOpBranchConditional, over, done, next);
    label_begin(writer, next);
    EMIT(&writer->out, SpvOpIAdd, uint_, next_at, at, one);
    EMIT(&writer->out, SpvOpIAdd, uint_, next_tries, tries, one);
    EMIT(&writer->out, SpvOpBranch, header);
    label_begin(writer, done);
    uint32_t low = COMPUTE(writer, SpvOpSelect, uint_, found, words[2], nowhere[0]);
    uint32_t high = COMPUTE(writer, SpvOpSelect, uint_, found, words[3], nowhere[1]);
    writer->buffer = pointer_make(writer, low, high);
    return table;
}

/*
 * record(first check, mask of those that fired, state, operands...): for every bit of the mask, counts and, if it is among the first,
 * keeps the operands. Only ever called where something is wrong, so it is written for size.
 */
void records_function(struct writer *writer)
{
    uint32_t uint_ = type_uint(writer), bool_ = type_bool(writer);
    uint32_t zero = constant_uint(writer, 0), one = constant_uint(writer, 1);
    uint32_t parameters[13];
    struct words *out = &writer->out;
    writer->line = writer->scope = writer->debug_line = NULL;
    EMIT(out, SpvOpFunction, type_void(writer), writer->record_function, SpvFunctionControlDontInlineMask,
         writer->record_type);
    for (int i = 0; i < 13; i++) {
        parameters[i] = new_id(writer);
        EMIT(out, SpvOpFunctionParameter, uint_, parameters[i]);
    }
    uint32_t start = new_id(writer), header = new_id(writer), body = new_id(writer), next = new_id(writer),
             done = new_id(writer), check = new_id(writer), mask = new_id(writer), next_check = new_id(writer),
             next_mask = new_id(writer);
    label_begin(writer, start);
    uint32_t table = writer->analysis->options->root ? buffer_find(writer) : 0;
    start = writer->label;
    uint32_t room = word_load(writer, zero);
    EMIT(out, SpvOpBranch, header);
    label_begin(writer, header);
    EMIT(out, SpvOpPhi, uint_, check, parameters[0], start, next_check, next);
    EMIT(out, SpvOpPhi, uint_, mask, parameters[1], start, next_mask, next);
    uint32_t more = COMPUTE(writer, SpvOpINotEqual, bool_, mask, zero);
    EMIT(out, SpvOpLoopMerge, done, next, 0);
    EMIT(out, SpvOpBranchConditional, more, body, done);
    label_begin(writer, body);

    struct branch fired, fits, lost, kept, carried;
    uint32_t bit = COMPUTE(writer, SpvOpBitwiseAnd, uint_, mask, one);
    branch_begin(writer, COMPUTE(writer, SpvOpINotEqual, bool_, bit, zero), &fired);
    uint32_t has_room = COMPUTE(writer, SpvOpULessThan, bool_, check, room);
    branch_begin(writer, has_room, &fits);
    uint32_t slot = COMPUTE(writer, SpvOpIMul, uint_, check, constant_uint(writer, GN_RECORDS_CHECK));
    slot = COMPUTE(writer, SpvOpIAdd, uint_, slot, constant_uint(writer, GN_RECORDS_HEADER));
    uint32_t before = atomic_add(writer, slot, one);
    branch_begin(writer, COMPUTE(writer, SpvOpULessThan, bool_, before, constant_uint(writer, GN_RECORDS_KEPT)), &kept);
    uint32_t base = COMPUTE(writer, SpvOpIMul, uint_, before, constant_uint(writer, GN_RECORD_WORDS));
    base = COMPUTE(writer, SpvOpIAdd, uint_, base, slot);
    base = COMPUTE(writer, SpvOpIAdd, uint_, base, constant_uint(writer, 2));
    record_write(writer, base, parameters[2], parameters + 3);
    branch_end(writer, &kept);
    branch_begin(writer, COMPUTE(writer, SpvOpIEqual, bool_, before, constant_uint(writer, UINT32_MAX)), &carried);
    atomic_add(writer, COMPUTE(writer, SpvOpIAdd, uint_, slot, one), one);
    branch_end(writer, &carried);
    branch_end(writer, &fits);
    branch_begin(writer, COMPUTE(writer, SpvOpLogicalNot, bool_, has_room), &lost);
    atomic_add(writer, one, one);
    branch_end(writer, &lost);
    branch_end(writer, &fired);

    EMIT(out, SpvOpBranch, next);
    label_begin(writer, next);
    EMIT(out, SpvOpIAdd, uint_, next_check, check, one);
    EMIT(out, SpvOpShiftRightLogical, uint_, next_mask, mask, one);
    EMIT(out, SpvOpBranch, header);
    label_begin(writer, done);
    if (table) { /* last, for who sees it is to find the rest */
        writer->buffer = table;
        atomic_add(writer, constant_uint(writer, GN_ROOT_FIRED), one);
    }
    EMIT_BARE(out, SpvOpReturn);
    EMIT_BARE(out, SpvOpFunctionEnd);
}
