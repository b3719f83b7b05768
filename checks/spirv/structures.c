/* SPDX-License-Identifier: Apache-2.0 */
/* Which acceleration structure an operation reads, as far as a shader can know: SPIR-V has no way to look at one, so that what descriptors hold
 * is kept beside them, in a buffer of the same set (records.h). */
#include "checks/spirv/records.h"
#include "checks/spirv/writer.h"

static bool decoration_of(const struct module *module, uint32_t id, uint32_t decoration, uint32_t *out)
{
    for (uint32_t i = 0; i < module->globals_end; i++) {
        const struct inst *inst = &module->insts[i];
        if (inst->opcode == SpvOpDecorate && inst->count == 4 && inst_word(module, inst, 1) == id &&
            inst_word(module, inst, 2) == decoration) {
            *out = inst_word(module, inst, 3);
            return true;
        }
    }
    return false;
}

bool structure_operand_find(const struct module *module, const struct inst *operation, uint32_t word, struct structure_operand *out)
{
    const struct inst *load = definition_of(module, inst_word(module, operation, word));
    const struct inst *pointer = load && load->opcode == SpvOpLoad ? definition_of(module, inst_word(module, load, 3)) : NULL;
    out->index = 0;
    if (pointer && (pointer->opcode == SpvOpAccessChain || pointer->opcode == SpvOpInBoundsAccessChain)) {
        if (pointer->count != 5)
            return false;
        out->index = inst_word(module, pointer, 4);
        const struct inst *index = definition_of(module, out->index), *type = index ? definition_of(module, index->type) : NULL;
        if (!type || type->opcode != SpvOpTypeInt || inst_word(module, type, 2) != 32)
            return false;
        pointer = definition_of(module, inst_word(module, pointer, 3));
    }
    return pointer && pointer->opcode == SpvOpVariable && inst_word(module, pointer, 3) == SpvStorageClassUniformConstant &&
           decoration_of(module, pointer->result, SpvDecorationDescriptorSet, &out->set) &&
           decoration_of(module, pointer->result, SpvDecorationBinding, &out->binding) && out->binding < GN_MIRROR_BINDINGS;
}

/* The variable of the buffer in `set`; 0 where there are too many sets. */
static uint32_t mirror_of_set(struct writer *writer, uint32_t set)
{
    const uint32_t room = sizeof writer->mirrors / sizeof writer->mirrors[0];
    for (uint32_t i = 0; i < writer->mirror_count; i++)
        if (writer->mirrors[i].set == set)
            return writer->mirrors[i].id;
    if (writer->mirror_count == room)
        return 0;
    if (!writer->mirror_pointer) {
        uint32_t array = new_id(writer), structure = new_id(writer), uint_ = type_uint(writer);
        EMIT(&writer->globals, SpvOpTypeRuntimeArray, array, uint_);
        EMIT(&writer->globals, SpvOpTypeStruct, structure, array);
        EMIT(&writer->decorations, SpvOpDecorate, array, SpvDecorationArrayStride, 4);
        EMIT(&writer->decorations, SpvOpDecorate, structure, SpvDecorationBlock);
        EMIT(&writer->decorations, SpvOpMemberDecorate, structure, 0, SpvDecorationOffset, 0);
        EMIT(&writer->decorations, SpvOpMemberDecorate, structure, 0, SpvDecorationNonWritable);
        writer->mirror_pointer = type_pointer(writer, SpvStorageClassStorageBuffer, structure);
    }
    uint32_t id = new_id(writer);
    EMIT(&writer->globals, SpvOpVariable, writer->mirror_pointer, id, SpvStorageClassStorageBuffer);
    EMIT(&writer->decorations, SpvOpDecorate, id, SpvDecorationDescriptorSet, set);
    EMIT(&writer->decorations, SpvOpDecorate, id, SpvDecorationBinding, GN_MIRROR_BINDING);
    if (writer->module->words[1] >= 0x10400)
        words_add(&writer->interface, &id, 1);
    writer->mirrors[writer->mirror_count].set = set;
    writer->mirrors[writer->mirror_count++].id = id;
    return id;
}

static uint32_t mirror_word(struct writer *writer, uint32_t mirror, uint32_t at)
{
    uint32_t uint_ = type_uint(writer), type = type_pointer(writer, SpvStorageClassStorageBuffer, uint_);
    uint32_t zero = constant_uint(writer, 0), pointer = COMPUTE(writer, SpvOpAccessChain, type, mirror, zero, at);
    return COMPUTE(writer, SpvOpLoad, uint_, pointer);
}

uint32_t structure_id(struct writer *writer, const struct inst *operation, uint32_t word, uint32_t out_operands[4])
{
    struct structure_operand operand;
    uint32_t uint_ = type_uint(writer), bool_ = type_bool(writer);
    if (!structure_operand_find(writer->module, operation, word, &operand))
        return 0;
    uint32_t mirror = mirror_of_set(writer, operand.set), index = constant_uint(writer, 0);
    if (!mirror)
        return 0;
    uint32_t at = mirror_word(writer, mirror, constant_uint(writer, 2 * operand.binding)), inside = 0;
    if (operand.index) {
        const struct inst *definition = definition_of(writer->module, operand.index);
        index = definition->type == uint_ ? operand.index : COMPUTE(writer, SpvOpBitcast, uint_, operand.index);
        uint32_t count = mirror_word(writer, mirror, constant_uint(writer, 2 * operand.binding + 1));
        inside = COMPUTE(writer, SpvOpULessThan, bool_, index, count);
        uint32_t element = COMPUTE(writer, SpvOpIAdd, uint_, at, index);
        at = COMPUTE(writer, SpvOpSelect, uint_, inside, element, at);
    }
    uint32_t id = mirror_word(writer, mirror, at);
    if (inside)
        id = COMPUTE(writer, SpvOpSelect, uint_, inside, id, constant_uint(writer, GN_STRUCTURE_ID_UNWRITTEN));
    id = COMPUTE(writer, SpvOpBitwiseAnd, uint_, id, constant_uint(writer, GN_STRUCTURES - 1));
    out_operands[0] = constant_uint(writer, operand.set);
    out_operands[1] = constant_uint(writer, operand.binding);
    out_operands[2] = index;
    out_operands[3] = id;
    return id;
}
