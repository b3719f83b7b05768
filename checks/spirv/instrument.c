/* SPDX-License-Identifier: Apache-2.0 */
/* Rewrites a module: every word of the original stays, in its order, except where a block is split, a phi has to name the
 * new end of its predecessor, a function takes shadow parameters, or an entry point lists one more variable. */
#include <stdlib.h>
#include <string.h>

#include "checks/spirv/instrument.h"
#include "checks/spirv/writer.h"

struct rewrite {
    struct writer *writer;
    struct module *module;
    struct analysis *analysis;
    uint32_t *tail;         /* per id of a label: the label of its block's new end */
    uint32_t *continue_to;  /* per id of a label: the continue target made for a block that was its own, or 0 */
    struct words phis;      /* of the function being written: where in the output each original phi is, and its block */
    bool *instrumented;     /* per function: has checks, or queries that may have shadows, itself or in what it calls */
};

/* Shadows */

static bool group_has(const struct analysis *analysis, uint32_t root, enum shadow shadow)
{
    return analysis->roots[analysis->roots[root].group].needs[shadow];
}

/* The type that mirrors `type` with a scalar for each query. */
static uint32_t mirror_type(struct writer *writer, uint32_t type, uint32_t scalar)
{
    const struct inst *inst = definition_of(writer->module, type);
    if (!inst || inst->opcode != SpvOpTypeArray)
        return scalar;
    uint32_t element = mirror_type(writer, inst_word(writer->module, inst, 2), scalar);
    return TYPE(writer, SpvOpTypeArray, element, inst_word(writer->module, inst, 3));
}

static uint32_t mirror_of(struct writer *writer, uint32_t root, enum shadow shadow)
{
    uint32_t scalar = shadow_is_float(shadow) ? type_float(writer) : type_uint(writer);
    if (writer->analysis->roots[root].indexed_by || (writer->analysis->roots[root].packed && shadow == SHADOW_STATE))
        return scalar;
    return mirror_type(writer, writer->analysis->roots[root].pointee, scalar);
}

static uint32_t mirror_pointer(struct writer *writer, uint32_t root, enum shadow shadow)
{
    const struct root *of = &writer->analysis->roots[root];
    return type_pointer(writer, of->storage, mirror_of(writer, root, shadow));
}

static void shadows_plan(struct writer *writer)
{
    struct analysis *analysis = writer->analysis;
    for (uint32_t s = 0; s < analysis->site_count; s++) {
        const struct site *site = &analysis->sites[s];
        if (site->root == NONE)
            continue;
        struct root *group = &analysis->roots[analysis->roots[site->root].group];
        group->needs[SHADOW_STATE] |= site->checked && checks_need_state(site);
        group->needs[SHADOW_TMAX] |= (site->checked & RULE_BIT(GENERATE_RANGE)) != 0;
        group->needs[SHADOW_STRUCTURE] |= (site->checked & RULE_BIT(STRUCTURE_NO_POSITIONS)) != 0;
    }
    for (uint32_t r = 0; r < analysis->root_count; r++)
        shadow_pack(analysis, &analysis->roots[r]);
    for (uint32_t r = 0; r < analysis->root_count; r++)
        for (enum shadow shadow = 0; shadow < SHADOW_COUNT; shadow++) {
            if (!group_has(analysis, r, shadow))
                continue;
            uint32_t id = new_id(writer);
            writer->shadow_of[shadow][r] = id;
            if (analysis->roots[r].function != NONE)
                continue;
            uint32_t pointer = mirror_pointer(writer, r, shadow);
            uint32_t null = constant_plain(writer, SpvOpConstantNull, mirror_of(writer, r, shadow));
            EMIT(&writer->globals, SpvOpVariable, pointer, id, SpvStorageClassPrivate, null);
            if (writer->module->words[1] >= 0x10400)
                words_add(&writer->interface, &id, 1);
        }
}

/* The shadows of one query, in the order in which they are passed. */
static uint32_t shadows_of(const struct writer *writer, uint32_t root, uint32_t out[SHADOW_COUNT])
{
    uint32_t count = 0;
    for (enum shadow shadow = 0; shadow < SHADOW_COUNT; shadow++)
        if (writer->shadow_of[shadow][root])
            out[count++] = writer->shadow_of[shadow][root];
    return count;
}

static void shadow_variables(struct writer *writer, uint32_t function)
{
    for (uint32_t r = 0; r < writer->analysis->root_count; r++) {
        const struct root *root = &writer->analysis->roots[r];
        for (enum shadow shadow = 0; shadow < SHADOW_COUNT; shadow++) {
            uint32_t id = writer->shadow_of[shadow][r];
            if (!id || root->function != function || root->parameter != NONE)
                continue;
            uint32_t null = constant_plain(writer, SpvOpConstantNull, mirror_of(writer, r, shadow));
            uint32_t pointer = mirror_pointer(writer, r, shadow);
            EMIT(&writer->out, SpvOpVariable, pointer, id, SpvStorageClassFunction, null);
        }
    }
}

static void shadow_parameters(struct writer *writer, const struct function *function)
{
    for (uint32_t p = 0; p < function->parameter_count; p++) {
        uint32_t r = writer->analysis->root_of[writer->module->insts[function->first_parameter + p].result];
        for (enum shadow shadow = 0; r != NONE && shadow < SHADOW_COUNT; shadow++) {
            uint32_t id = writer->shadow_of[shadow][r];
            if (id)
                EMIT(&writer->out, SpvOpFunctionParameter, mirror_pointer(writer, r, shadow), id);
        }
    }
}

/* The function's type with its shadow parameters; the original's id where it has none. */
static uint32_t shadow_function_type(struct writer *writer, const struct function *function)
{
    struct module *module = writer->module;
    uint32_t original = inst_word(module, &module->insts[function->first], 4);
    const struct inst *type = definition_of(module, original);
    uint32_t operands[MAX_TYPE_OPERANDS], count = 0, added = 0;
    for (uint32_t w = 2; type && w < type->count && count < MAX_TYPE_OPERANDS; w++)
        operands[count++] = inst_word(module, type, w);
    for (uint32_t p = 0; p < function->parameter_count; p++) {
        uint32_t r = writer->analysis->root_of[module->insts[function->first_parameter + p].result];
        for (enum shadow shadow = 0; r != NONE && shadow < SHADOW_COUNT; shadow++) {
            if (!writer->shadow_of[shadow][r])
                continue;
            uint32_t pointer = mirror_pointer(writer, r, shadow);
            if (count == MAX_TYPE_OPERANDS) {
                writer->out.failed = true;
                return original;
            }
            operands[count++] = pointer;
            added++;
        }
    }
    return added ? type_make(writer, SpvOpTypeFunction, operands, count) : original;
}

/* Copying */

static void copy(struct writer *writer, const struct inst *inst)
{
    words_add(&writer->out, inst_words(writer->module, inst), inst->count);
}

/* A copy with more words at its end. */
static void copy_longer(struct writer *writer, const struct inst *inst, const uint32_t *more, uint32_t count)
{
    uint32_t head = ((uint32_t)inst->count + count) << 16 | inst->opcode;
    if (inst->count + count > 0xFFFF) {
        writer->out.failed = true;
        return;
    }
    words_add(&writer->out, &head, 1);
    words_add(&writer->out, inst_words(writer->module, inst) + 1, inst->count - 1u);
    words_add(&writer->out, more, count);
}

static void write_call(struct writer *writer, const struct inst *inst)
{
    uint32_t more[SHADOW_COUNT * 256], count = 0;
    for (uint32_t a = 4; a < inst->count; a++) {
        uint32_t root = pointer_root(writer->analysis, inst_word(writer->module, inst, a), NULL, NULL);
        if (root == NONE)
            continue;
        if (count + SHADOW_COUNT > sizeof more / sizeof more[0]) {
            writer->out.failed = true;
            return;
        }
        count += shadows_of(writer, root, more + count);
    }
    copy_longer(writer, inst, more, count);
}

static void follow_lines(struct writer *writer, const struct inst *inst)
{
    uint32_t number;
    if (inst->opcode == SpvOpLine)
        writer->line = inst;
    else if (inst->opcode == SpvOpNoLine)
        writer->line = NULL;
    else if (is_debug(writer->module, inst, &number)) {
        if (number == DEBUG_SCOPE)
            writer->scope = inst;
        else if (number == DEBUG_NO_SCOPE)
            writer->scope = NULL;
        else if (number == DEBUG_LINE)
            writer->debug_line = inst;
        else if (number == DEBUG_NO_LINE)
            writer->debug_line = NULL;
    }
}

/* A ray that hits nothing, and is right in every way. */
static void write_harmless_ray(struct writer *writer, const struct inst *inst)
{
    uint32_t zero = constant_float(writer, 0), one = constant_float(writer, 1), no_bits = constant_uint(writer, 0);
    uint32_t vector = TYPE(writer, SpvOpTypeVector, type_float(writer), 3);
    uint32_t origin = COMPUTE(writer, SpvOpCompositeConstruct, vector, zero, zero, zero);
    uint32_t direction = COMPUTE(writer, SpvOpCompositeConstruct, vector, zero, zero, one);
    EMIT(&writer->out, inst->opcode, inst_word(writer->module, inst, 1), inst_word(writer->module, inst, 2), no_bits, no_bits, origin,
         zero, direction, zero);
}

/* The operation where `skip` does not hold. Where it does, its result is 0, and a query is given a ray that hits nothing, so
 * that what follows finds it initialized; unless there is nothing to trace through. */
static void write_unless(struct writer *writer, const struct site *site, uint32_t skip)
{
    const struct inst *inst = &writer->module->insts[site->inst];
    struct branch branch;
    if (site->operation->kind == OPERATION_INITIALIZE) {
        uint32_t harmless = skip, bool_ = type_bool(writer);
        if (writer->no_structure) {
            harmless = COMPUTE(writer, SpvOpLogicalNot, bool_, writer->no_structure);
            harmless = COMPUTE(writer, SpvOpLogicalAnd, bool_, harmless, skip);
        }
        branch_begin(writer, harmless, &branch);
        write_harmless_ray(writer, inst);
        branch_end(writer, &branch);
        lines_restate(writer);
    }
    branch_begin(writer, COMPUTE(writer, SpvOpLogicalNot, type_bool(writer), skip), &branch);
    lines_restate(writer);
    size_t at = writer->out.count;
    copy(writer, inst);
    uint32_t result = inst->result ? new_id(writer) : 0;
    if (result && !writer->out.failed)
        writer->out.data[at + 2] = result;
    branch_end(writer, &branch);
    if (result) {
        uint32_t null = constant_plain(writer, SpvOpConstantNull, inst->type);
        EMIT(&writer->out, SpvOpPhi, inst->type, inst->result, result, branch.inside, null, branch.before);
    }
    lines_restate(writer);
}

static bool has_checks(const struct rewrite *rewrite, const struct block *block)
{
    for (uint32_t i = block->first; i <= block->last; i++)
        if (rewrite->analysis->site_of[i] != NONE && rewrite->analysis->sites[rewrite->analysis->site_of[i]].checked)
            return true;
    return false;
}

/*
 * A loop header may hold no selection before its merge instruction, so its phis stay with the merge instruction and the rest
 * moves to a block of its own. There, a conditional branch is a structured one only if it leaves the loop or
 * continues it.
 */
static bool header_can_split(const struct module *module, const struct block *block)
{
    const struct inst *merge = &module->insts[block->merge], *last = &module->insts[block->last];
    if (last->opcode == SpvOpBranch)
        return true;
    if (last->opcode != SpvOpBranchConditional)
        return false;
    for (uint32_t w = 2; w <= 3; w++) {
        uint32_t to = inst_word(module, last, w);
        if (to == inst_word(module, merge, 1) || to == inst_word(module, merge, 2))
            return true;
    }
    return inst_word(module, last, 2) == inst_word(module, last, 3);
}

/* Debug information of a function that stands behind a check of the entry block, but has to stay in that block; NONE if none
 * does. */
static uint32_t late_definition(const struct rewrite *rewrite, const struct block *block)
{
    bool checked = false;
    uint32_t number;
    for (uint32_t i = block->first; i <= block->last; i++) {
        uint32_t site = rewrite->analysis->site_of[i];
        checked |= site != NONE && rewrite->analysis->sites[site].checked;
        if (checked && is_debug(rewrite->module, &rewrite->module->insts[i], &number) && number == DEBUG_FUNCTION_DEFINITION)
            return i;
    }
    return NONE;
}

static void write_block(struct rewrite *rewrite, const struct block *block)
{
    struct writer *writer = rewrite->writer;
    struct module *module = rewrite->module;
    const struct inst *merge = block->merge == NONE ? NULL : &module->insts[block->merge];
    bool split_header = merge && merge->opcode == SpvOpLoopMerge && has_checks(rewrite, block);
    bool own_continue = split_header && inst_word(module, merge, 2) == block->id;
    uint32_t continue_label = own_continue ? new_id(writer) : 0, split_at = block->first + 1;
    for (uint32_t i = block->first; i <= block->last; i++)
        if (module->insts[i].opcode == SpvOpPhi)
            split_at = i + 1;
    uint32_t late = late_definition(rewrite, block);
    bool late_written = false;

    writer->line = writer->scope = writer->debug_line = NULL;
    label_begin(writer, block->id);
    if (block == &module->blocks[module->functions[block->function].first_block])
        shadow_variables(writer, block->function);
    for (uint32_t i = block->first + 1; i <= block->last; i++) {
        const struct inst *inst = &module->insts[i];
        uint32_t index = rewrite->analysis->site_of[i];
        if (split_header && i == split_at) {
            uint32_t rest = new_id(writer);
            size_t at = writer->out.count;
            copy(writer, merge);
            if (own_continue && !writer->out.failed)
                writer->out.data[at + 2] = continue_label;
            EMIT(&writer->out, SpvOpBranch, rest);
            label_begin(writer, rest);
            lines_restate(writer);
        }
        if ((split_header && i == block->merge) || i == late)
            continue;
        follow_lines(writer, inst);
        if (index != NONE) {
            const struct site *site = &rewrite->analysis->sites[index];
            if (site->checked && late != NONE && !late_written) {
                copy(writer, &module->insts[late]);
                late_written = true;
            }
            uint32_t skip = 0;
            writer->no_structure = 0;
            if (site->checked) {
                skip = checks_write(writer, site);
                lines_restate(writer);
            }
            if (skip)
                write_unless(writer, site, skip);
            else
                copy(writer, inst);
            shadow_update(writer, site);
        } else if (inst->opcode == SpvOpFunctionCall) {
            write_call(writer, inst);
        } else {
            size_t at = writer->out.count;
            if (inst->opcode == SpvOpPhi)
                words_add(&rewrite->phis, (const uint32_t[]){(uint32_t)at, block->id}, 2);
            copy(writer, inst);
            for (uint32_t w = 1; own_continue && i == block->last && !writer->out.failed && w < inst->count; w++)
                if (inst_word_is_id(module, inst, w) && inst_word(module, inst, w) == block->id)
                    writer->out.data[at + w] = continue_label;
        }
    }
    rewrite->tail[block->id] = writer->label;
    if (own_continue) {
        rewrite->continue_to[block->id] = continue_label;
        EMIT(&writer->out, SpvOpLabel, continue_label);
        EMIT(&writer->out, SpvOpBranch, block->id);
    }
}

/* A phi names the last part of each block that it is reached from. */
static void fix_phis(struct rewrite *rewrite)
{
    struct words *out = &rewrite->writer->out;
    for (size_t i = 0; !out->failed && !rewrite->phis.failed && i < rewrite->phis.count; i += 2) {
        uint32_t *phi = out->data + rewrite->phis.data[i], block = rewrite->phis.data[i + 1];
        for (uint32_t w = 4; w < phi[0] >> 16; w += 2) {
            uint32_t to = phi[w] == block && rewrite->continue_to[block] ? rewrite->continue_to[block] : rewrite->tail[phi[w]];
            if (to)
                phi[w] = to;
        }
    }
    rewrite->phis.count = 0;
}

static void write_function(struct rewrite *rewrite, const struct function *function)
{
    struct writer *writer = rewrite->writer;
    struct module *module = rewrite->module;
    uint32_t parameters = 0;
    for (uint32_t i = function->first; i <= function->last; i++) {
        const struct inst *inst = &module->insts[i];
        if (inst->opcode == SpvOpLabel) {
            const struct block *block = &module->blocks[module->block_of[inst->result]];
            write_block(rewrite, block);
            i = block->last;
        } else if (inst->opcode == SpvOpFunction) {
            size_t at = writer->out.count;
            uint32_t type = shadow_function_type(writer, function);
            copy(writer, inst);
            if (!writer->out.failed)
                writer->out.data[at + 4] = type;
        } else {
            copy(writer, inst);
            if (inst->opcode == SpvOpFunctionParameter && ++parameters == function->parameter_count)
                shadow_parameters(writer, function);
        }
    }
    fix_phis(rewrite);
}

/* Everything before the functions */

static bool find_instrumented(struct rewrite *rewrite)
{
    struct module *module = rewrite->module;
    rewrite->instrumented = arena_alloc(module->arena, module->function_count + 1u, sizeof *rewrite->instrumented);
    if (!rewrite->instrumented)
        return false;
    for (uint32_t s = 0; s < rewrite->analysis->site_count; s++)
        if (rewrite->analysis->sites[s].checked || rewrite->analysis->sites[s].root != NONE)
            rewrite->instrumented[module->blocks[rewrite->analysis->sites[s].block].function] = true;
    for (bool again = true; again;) {
        again = false;
        for (uint32_t b = 0; b < module->block_count; b++) {
            const struct block *block = &module->blocks[b];
            for (uint32_t i = block->first; i <= block->last && !rewrite->instrumented[block->function]; i++) {
                const struct inst *inst = &module->insts[i];
                if (inst->opcode == SpvOpFunctionCall && rewrite->instrumented[module->function_of[inst_word(module, inst, 3)]])
                    again = rewrite->instrumented[block->function] = true;
            }
        }
    }
    return true;
}

/* Where the list of interface variables starts: after the name. */
static void write_entry_point(struct rewrite *rewrite, const struct inst *inst)
{
    struct writer *writer = rewrite->writer;
    uint32_t function = rewrite->module->function_of[inst_word(rewrite->module, inst, 2)];
    uint32_t more[256], count = 0;
    if (function == NONE || !rewrite->instrumented[function]) {
        copy(writer, inst);
        return;
    }
    for (size_t v = 0; v < writer->interface.count; v++) {
        bool listed = false;
        for (uint32_t w = 3; w < inst->count; w++)
            listed |= inst_word_is_id(rewrite->module, inst, w) && inst_word(rewrite->module, inst, w) == writer->interface.data[v];
        if (listed)
            continue;
        if (count == sizeof more / sizeof more[0]) {
            writer->out.failed = true;
            return;
        }
        more[count++] = writer->interface.data[v];
    }
    copy_longer(writer, inst, more, count);
}

static bool is_before_types(uint32_t opcode)
{
    switch (opcode) {
    case SpvOpCapability:
    case SpvOpExtension:
    case SpvOpExtInstImport:
    case SpvOpMemoryModel:
    case SpvOpEntryPoint:
    case SpvOpExecutionMode:
    case SpvOpExecutionModeId:
    case SpvOpString:
    case SpvOpSource:
    case SpvOpSourceContinued:
    case SpvOpSourceExtension:
    case SpvOpName:
    case SpvOpMemberName:
    case SpvOpModuleProcessed:
    case SpvOpDecorate:
    case SpvOpMemberDecorate:
    case SpvOpDecorationGroup:
    case SpvOpGroupDecorate:
    case SpvOpGroupMemberDecorate:
    case SpvOpDecorateId:
    case SpvOpDecorateString:
    case SpvOpMemberDecorateString: return true;
    default: return false;
    }
}

static bool has_capability(const struct module *module, uint32_t capability)
{
    for (uint32_t i = 0; i < module->globals_end; i++)
        if (module->insts[i].opcode == SpvOpCapability && inst_word(module, &module->insts[i], 1) == capability)
            return true;
    return false;
}

static void write_extension(struct writer *writer, const char *name, uint32_t core_since)
{
    uint32_t words[16] = {0};
    if (writer->module->words[1] >= core_since)
        return;
    for (uint32_t i = 0; i < writer->module->globals_end; i++)
        if (writer->module->insts[i].opcode == SpvOpExtension &&
            strcmp(inst_text(writer->module, &writer->module->insts[i], 1), name) == 0)
            return;
    memcpy(words, name, strlen(name));
    words_instruction(&writer->out, SpvOpExtension, words, strlen(name) / 4 + 1);
}

/* Functions are written first, into a buffer of their own, as they ask for types that have to come before them. */
static void assemble(struct rewrite *rewrite, struct words *functions)
{
    struct writer *writer = rewrite->writer;
    struct module *module = rewrite->module;
    bool extended = false, decorated = false, physical = writer->analysis->options->root != 0;
    words_add(&writer->out, module->words, 5);
    if (physical && !has_capability(module, SpvCapabilityPhysicalStorageBufferAddresses))
        EMIT(&writer->out, SpvOpCapability, SpvCapabilityPhysicalStorageBufferAddresses);
    for (uint32_t i = 0; i < module->globals_end; i++) {
        const struct inst *inst = &module->insts[i];
        if (!extended && inst->opcode != SpvOpCapability && inst->opcode != SpvOpExtension) {
            extended = true;
            write_extension(writer, "SPV_KHR_storage_buffer_storage_class", 0x10300);
            if (physical)
                write_extension(writer, "SPV_KHR_physical_storage_buffer", 0x10500);
        }
        if (!decorated && !is_before_types(inst->opcode)) {
            decorated = true;
            words_add(&writer->out, writer->decorations.data, writer->decorations.count);
        }
        if (inst->opcode == SpvOpEntryPoint)
            write_entry_point(rewrite, inst);
        else if (inst->opcode == SpvOpMemoryModel && physical)
            EMIT(&writer->out, SpvOpMemoryModel, SpvAddressingModelPhysicalStorageBuffer64, inst_word(module, inst, 2));
        else
            copy(writer, inst);
    }
    words_add(&writer->out, writer->globals.data, writer->globals.count);
    words_add(&writer->out, functions->data, functions->count);
    if (!writer->out.failed)
        writer->out.data[3] = writer->next_id;
}

enum gn_spirv_status rewrite_module(struct analysis *analysis, struct gn_spirv_result *out)
{
    struct module *module = analysis->module;
    struct writer writer = {.analysis = analysis, .module = module, .next_id = module->bound};
    struct rewrite rewrite = {.writer = &writer, .module = module, .analysis = analysis};
    struct words functions = {NULL, 0, 0, false};
    enum gn_spirv_status status = GN_SPIRV_OUT_OF_MEMORY;
    for (uint32_t b = 0; b < module->block_count; b++) {
        const struct block *block = &module->blocks[b];
        if (block->merge != NONE && module->insts[block->merge].opcode == SpvOpLoopMerge && has_checks(&rewrite, block) &&
            !header_can_split(module, block)) {
            say(module, "the loop header %%%u branches in a way that cannot be split", block->id);
            return GN_SPIRV_DECLINED;
        }
    }
    rewrite.tail = arena_alloc(module->arena, module->bound, sizeof *rewrite.tail);
    rewrite.continue_to = arena_alloc(module->arena, module->bound, sizeof *rewrite.continue_to);
    if (!rewrite.tail || !rewrite.continue_to || !find_instrumented(&rewrite))
        goto done;
    for (enum shadow shadow = 0; shadow < SHADOW_COUNT; shadow++) {
        writer.shadow_of[shadow] = arena_alloc(module->arena, analysis->root_count + 1u, sizeof *writer.shadow_of[shadow]);
        if (!writer.shadow_of[shadow])
            goto done;
    }
    if (!records_prepare(&writer)) {
        status = GN_SPIRV_DECLINED;
        goto done;
    }
    shadows_plan(&writer);
    for (uint32_t i = module->globals_end; i < module->inst_count; i++) {
        uint32_t f = module->insts[i].opcode == SpvOpFunction ? module->function_of[module->insts[i].result] : NONE;
        if (f == NONE) {
            copy(&writer, &module->insts[i]); /* lines between functions */
            continue;
        }
        write_function(&rewrite, &module->functions[f]);
        i = module->functions[f].last;
    }
    records_function(&writer);
    functions = writer.out;
    writer.out = (struct words){NULL, 0, 0, functions.failed || rewrite.phis.failed};
    assemble(&rewrite, &functions);
    if (writer.next_id > 0x3FFFFF) {
        say(module, "the instrumented module would need more ids than SPIR-V allows");
        status = GN_SPIRV_DECLINED;
        goto done;
    }
    if (writer.out.failed || writer.globals.failed || writer.decorations.failed || writer.interface.failed)
        goto done;
    out->words = writer.out.data;
    out->word_count = writer.out.count;
    writer.out.data = NULL;
    status = GN_SPIRV_INSTRUMENTED;
done:
    free(writer.out.data);
    free(writer.globals.data);
    free(writer.decorations.data);
    free(writer.interface.data);
    free(writer.constants);
    free(rewrite.phis.data);
    free(functions.data);
    return status;
}
