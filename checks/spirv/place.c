/* SPDX-License-Identifier: Apache-2.0 */
/* Where an instruction is in the source: OpLine and OpSource, or NonSemantic.Shader.DebugInfo. */
#include <string.h>

#include "checks/spirv/module.h"

struct pieces {
    const struct inst *insts[256];
    uint32_t words[256];
    uint32_t count;
};

static void piece_add(struct pieces *pieces, const struct inst *inst, uint32_t word)
{
    if (pieces->count < 256) {
        pieces->insts[pieces->count] = inst;
        pieces->words[pieces->count++] = word;
    }
}

static void pieces_from_source(const struct module *module, uint32_t file, struct pieces *pieces)
{
    bool taking = false;
    for (uint32_t i = 0; i < module->globals_end; i++) {
        const struct inst *inst = &module->insts[i];
        if (inst->opcode == SpvOpSource)
            taking = inst->count > 4 && inst_word(module, inst, 3) == file && pieces->count == 0;
        if (taking && inst->opcode == SpvOpSource)
            piece_add(pieces, inst, 4);
        else if (taking && inst->opcode == SpvOpSourceContinued)
            piece_add(pieces, inst, 1);
        else if (inst->opcode != SpvOpSource)
            taking = false;
    }
}

static void pieces_from_debug(const struct module *module, uint32_t source, struct pieces *pieces)
{
    const struct inst *inst = definition_of(module, source);
    uint32_t number, at = inst ? module->definition[source] : NONE;
    while (at < module->inst_count && is_debug(module, &module->insts[at], &number) &&
           number == (pieces->count ? DEBUG_SOURCE_CONTINUED : DEBUG_SOURCE)) {
        const struct inst *text =
            definition_of(module, inst_word(module, &module->insts[at], pieces->count ? 5 : 6));
        if (!text || text->opcode != SpvOpString)
            return;
        piece_add(pieces, text, 2);
        at++;
    }
}

/* The text of line `line` of the pieces. glslang puts lines of its own before the source and says so with "#line 1". */
static const char *line_text(const struct module *module, const struct pieces *pieces, uint32_t line)
{
    size_t length = 0;
    for (uint32_t i = 0; i < pieces->count; i++)
        length += strlen(inst_text(module, pieces->insts[i], pieces->words[i]));
    char *text = length ? arena_alloc(module->arena, length + 1, 1) : NULL;
    if (!text)
        return NULL;
    for (uint32_t i = 0; i < pieces->count; i++)
        strcat(text + strlen(text), inst_text(module, pieces->insts[i], pieces->words[i]));
    char *at = strstr(text, "#line 1\n");
    at = at && (at == text || at[-1] == '\n') ? at + 8 : text;
    for (uint32_t n = 1; at && n < line; n++) {
        at = strchr(at, '\n');
        at = at ? at + 1 : NULL;
    }
    if (!at || line == 0)
        return NULL;
    while (*at == ' ' || *at == '\t')
        at++;
    size_t end = strcspn(at, "\r\n");
    return end ? arena_text(module->arena, at, end < 400 ? end : 400) : NULL;
}

bool place_find(const struct module *module, uint32_t index, const struct block *block, struct gn_spirv_place *out)
{
    const struct function *function = &module->functions[block->function];
    const char *name = name_of(module, function->id);
    struct pieces pieces = {.count = 0};
    uint32_t number;
    *out = (struct gn_spirv_place){
        .function_id = function->id, .block_id = block->id, .offset = module->insts[index].offset};
    if (name && !(out->function = arena_text(module->arena, name, strlen(name))))
        return false;
    /* A line holds until the next one or the end of its block. */
    for (uint32_t i = index + 1; i-- > block->first;) {
        const struct inst *inst = &module->insts[i];
        if (inst->opcode == SpvOpNoLine)
            break;
        if (inst->opcode == SpvOpLine) {
            const struct inst *file = definition_of(module, inst_word(module, inst, 1));
            out->line = inst_word(module, inst, 2);
            out->column = inst_word(module, inst, 3);
            if (file && file->opcode == SpvOpString) {
                const char *text = inst_text(module, file, 2);
                out->file = arena_text(module->arena, text, strlen(text));
                pieces_from_source(module, file->result, &pieces);
            }
            break;
        }
        if (is_debug(module, inst, &number) && number == DEBUG_NO_LINE)
            break;
        if (is_debug(module, inst, &number) && number == DEBUG_LINE) {
            const struct inst *source = definition_of(module, inst_word(module, inst, 5));
            const struct inst *file = source ? definition_of(module, inst_word(module, source, 5)) : NULL;
            if (!constant_u32(module, inst_word(module, inst, 6), &out->line) ||
                !constant_u32(module, inst_word(module, inst, 8), &out->column))
                break;
            if (file && file->opcode == SpvOpString) {
                const char *text = inst_text(module, file, 2);
                out->file = arena_text(module->arena, text, strlen(text));
                pieces_from_debug(module, source->result, &pieces);
            }
            break;
        }
    }
    out->source = line_text(module, &pieces, out->line);
    return true;
}
