/* SPDX-License-Identifier: Apache-2.0 */
/* Types, constants and structured code, see writer.h. */
#include "checks/spirv/writer.h"

#include <stdlib.h>
#include <string.h>

void words_add(struct words *words, const uint32_t *data, size_t count)
{
    if (words->failed || count == 0)
        return;
    if (count > words->capacity - words->count) {
        size_t capacity = words->capacity ? words->capacity : 256;
        while (capacity - words->count < count)
            if (__builtin_mul_overflow(capacity, (size_t)2, &capacity)) {
                words->failed = true;
                return;
            }
        uint32_t *grown = capacity > SIZE_MAX / sizeof *grown ? NULL : realloc(words->data, capacity * sizeof *grown);
        if (!grown) {
            words->failed = true;
            return;
        }
        words->data = grown;
        words->capacity = capacity;
    }
    memcpy(words->data + words->count, data, count * sizeof *data);
    words->count += count;
}

void words_instruction(struct words *words, uint32_t opcode, const uint32_t *operands, size_t count)
{
    uint32_t head = (uint32_t)(count + 1) << 16 | opcode;
    if (count >= 0xFFFF) {
        words->failed = true;
        return;
    }
    words_add(words, &head, 1);
    words_add(words, operands, count);
}

uint32_t new_id(struct writer *writer)
{
    return writer->next_id++;
}

uint32_t type_make(struct writer *writer, uint32_t opcode, const uint32_t *operands, uint32_t count)
{
    /* An array of the module may have a stride, which variables outside of buffers must not have. */
    for (uint32_t i = 0; i < writer->module->globals_end && opcode != SpvOpTypeArray; i++) {
        const struct inst *inst = &writer->module->insts[i];
        if (inst->opcode == opcode && inst->count == count + 2 &&
            (count == 0 || memcmp(inst_words(writer->module, inst) + 2, operands, count * sizeof *operands) == 0))
            return inst->result;
    }
    for (size_t at = 0; at < writer->globals.count; at += writer->globals.data[at] >> 16)
        if (writer->globals.data[at] == ((count + 2) << 16 | opcode) &&
            (count == 0 || memcmp(writer->globals.data + at + 2, operands, count * sizeof *operands) == 0))
            return writer->globals.data[at + 1];
    uint32_t all[MAX_TYPE_OPERANDS + 1] = {new_id(writer)};
    if (count > MAX_TYPE_OPERANDS) {
        writer->globals.failed = true;
        return all[0];
    }
    if (count)
        memcpy(all + 1, operands, count * sizeof *operands);
    words_instruction(&writer->globals, opcode, all, count + 1u);
    return all[0];
}

uint32_t type_uint(struct writer *writer)
{
    return TYPE(writer, SpvOpTypeInt, 32, 0);
}

uint32_t type_float(struct writer *writer)
{
    return TYPE(writer, SpvOpTypeFloat, 32);
}

uint32_t type_bool(struct writer *writer)
{
    return type_make(writer, SpvOpTypeBool, NULL, 0);
}

uint32_t type_void(struct writer *writer)
{
    return type_make(writer, SpvOpTypeVoid, NULL, 0);
}

uint32_t type_uint3(struct writer *writer)
{
    return TYPE(writer, SpvOpTypeVector, type_uint(writer), 3);
}

uint32_t type_bool3(struct writer *writer)
{
    return TYPE(writer, SpvOpTypeVector, type_bool(writer), 3);
}

uint32_t type_pointer(struct writer *writer, uint32_t storage, uint32_t pointee)
{
    return TYPE(writer, SpvOpTypePointer, storage, pointee);
}

static uint32_t constant_make(struct writer *writer, uint32_t type, uint32_t value)
{
    for (uint32_t i = 0; i < writer->constant_count; i++)
        if (writer->constants[i].type == type && writer->constants[i].value == value)
            return writer->constants[i].id;
    if (writer->constant_count == writer->constant_capacity) {
        uint32_t capacity = writer->constant_capacity ? writer->constant_capacity * 2 : 64;
        struct constant *grown = realloc(writer->constants, capacity * sizeof *grown);
        if (!grown) {
            writer->globals.failed = true;
            return new_id(writer);
        }
        writer->constants = grown;
        writer->constant_capacity = capacity;
    }
    uint32_t id = new_id(writer);
    EMIT(&writer->globals, SpvOpConstant, type, id, value);
    writer->constants[writer->constant_count++] = (struct constant){type, value, id};
    return id;
}

uint32_t constant_plain(struct writer *writer, uint32_t opcode, uint32_t type)
{
    for (uint32_t i = 0; i < writer->module->globals_end; i++) {
        const struct inst *inst = &writer->module->insts[i];
        if (inst->opcode == opcode && inst->type == type)
            return inst->result;
    }
    for (size_t at = 0; at < writer->globals.count; at += writer->globals.data[at] >> 16)
        if (writer->globals.data[at] == (3u << 16 | opcode) && writer->globals.data[at + 1] == type)
            return writer->globals.data[at + 2];
    uint32_t id = new_id(writer);
    EMIT(&writer->globals, opcode, type, id);
    return id;
}

uint32_t constant_uint(struct writer *writer, uint32_t value)
{
    return constant_make(writer, type_uint(writer), value);
}

uint32_t constant_float(struct writer *writer, float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return constant_make(writer, type_float(writer), bits);
}

uint32_t constant_uint3(struct writer *writer, uint32_t value)
{
    uint32_t type = type_uint3(writer), scalar = constant_uint(writer, value);
    for (size_t at = 0; at < writer->globals.count; at += writer->globals.data[at] >> 16)
        if (writer->globals.data[at] == (6u << 16 | SpvOpConstantComposite) && writer->globals.data[at + 1] == type &&
            writer->globals.data[at + 3] == scalar)
            return writer->globals.data[at + 2];
    uint32_t id = new_id(writer);
    EMIT(&writer->globals, SpvOpConstantComposite, type, id, scalar, scalar, scalar);
    return id;
}

uint32_t compute(struct writer *writer, uint32_t opcode, uint32_t type, const uint32_t *operands, size_t count)
{
    uint32_t all[20] = {type, new_id(writer)};
    if (count > 18) {
        writer->out.failed = true;
        return all[1];
    }
    memcpy(all + 2, operands, count * sizeof *operands);
    words_instruction(&writer->out, opcode, all, count + 2);
    return all[1];
}

void label_begin(struct writer *writer, uint32_t label)
{
    EMIT(&writer->out, SpvOpLabel, label);
    writer->label = label;
}

void branch_begin(struct writer *writer, uint32_t condition, struct branch *branch)
{
    uint32_t then = new_id(writer);
    branch->merge = new_id(writer);
    branch->before = writer->label;
    EMIT(&writer->out, SpvOpSelectionMerge, branch->merge, 0);
    EMIT(&writer->out, SpvOpBranchConditional, condition, then, branch->merge);
    label_begin(writer, then);
}

void branch_end(struct writer *writer, struct branch *branch)
{
    branch->inside = writer->label;
    EMIT(&writer->out, SpvOpBranch, branch->merge);
    label_begin(writer, branch->merge);
}

uint32_t branch_phi(struct writer *writer, const struct branch *branch, uint32_t type, uint32_t inside, uint32_t otherwise)
{
    return COMPUTE(writer, SpvOpPhi, type, inside, branch->inside, otherwise, branch->before);
}

void lines_restate(struct writer *writer)
{
    const struct inst *again[] = {writer->scope, writer->debug_line};
    for (int i = 0; i < 2; i++) {
        if (!again[i])
            continue;
        /* The same words under a new result. */
        const uint32_t *old = inst_words(writer->module, again[i]);
        words_add(&writer->out, old, 2);
        uint32_t id = new_id(writer);
        words_add(&writer->out, &id, 1);
        words_add(&writer->out, old + 3, again[i]->count - 3u);
    }
    if (writer->line)
        words_add(&writer->out, inst_words(writer->module, writer->line), writer->line->count);
}
