/* SPDX-License-Identifier: Apache-2.0 */
/* The changes that fuzzing makes, see mutate.h. Words are taken as they come: what was changed before may be no module. */
#include "tests/spirv/mutate.h"

#include <stdbool.h>
#include <string.h>

#define SPV_ENABLE_UTILITY_CODE
#include <spirv/unified1/spirv.h>

/* The header only has an inline definition. */
extern void SpvHasResultAndType(SpvOp opcode, bool *has_result, bool *has_type);

#define MAX_INSTRUCTIONS 8192

uint32_t chance_below(struct chance *chance, uint32_t limit)
{
    chance->state ^= chance->state << 13;
    chance->state ^= chance->state >> 7;
    chance->state ^= chance->state << 17;
    return (uint32_t)((chance->state >> 16) % limit);
}

static size_t list(const uint32_t *words, size_t count, size_t starts[MAX_INSTRUCTIONS])
{
    size_t found = 0;
    for (size_t at = 5; at < count && found < MAX_INSTRUCTIONS && words[at] >> 16 && words[at] >> 16 <= count - at;
         at += words[at] >> 16)
        starts[found++] = at;
    return found;
}

static bool is_operation(uint32_t opcode)
{
    return (opcode >= SpvOpTraceRayKHR && opcode <= SpvOpRayQueryGetIntersectionTypeKHR) ||
           (opcode >= SpvOpRayQueryGetRayTMinKHR && opcode <= SpvOpRayQueryGetIntersectionWorldToObjectKHR);
}

static bool has_result(uint32_t opcode)
{
    bool result, type;
    SpvHasResultAndType((SpvOp)opcode, &result, &type);
    return result && type;
}

static size_t insert(uint32_t *words, size_t count, size_t at, const uint32_t *more, size_t length)
{
    memmove(words + at + length, words + at, (count - at) * sizeof *words);
    memcpy(words + at, more, length * sizeof *words);
    return count + length;
}

/* An operation comes a second time, at a place of its own and with a result of its own. */
static size_t repeat_operation(uint32_t *words, size_t count, const size_t *starts, size_t found, struct chance *chance)
{
    uint32_t copy[32];
    size_t first = chance_below(chance, (uint32_t)found), to = starts[chance_below(chance, (uint32_t)found)];
    for (size_t i = 0; i < found; i++) {
        size_t at = starts[(first + i) % found], length = words[at] >> 16;
        if (!is_operation(words[at] & 0xFFFF) || length > 32 || length < 2)
            continue;
        memcpy(copy, words + at, length * sizeof *copy);
        if (has_result(copy[0] & 0xFFFF) && length > 2)
            copy[2] = words[3]++;
        /* Mostly near to where it was, where its operands are likely to be known. */
        if (chance_below(chance, 4))
            to = starts[(first + i + chance_below(chance, 12)) % found];
        return insert(words, count, to, copy, length);
    }
    return count;
}

/* The rest of a block becomes a block of its own. */
static size_t split_block(uint32_t *words, size_t count, const size_t *starts, size_t found, struct chance *chance)
{
    size_t at = starts[chance_below(chance, (uint32_t)found)];
    uint32_t label = words[3]++;
    const uint32_t more[] = {2u << 16 | SpvOpBranch, label, 2u << 16 | SpvOpLabel, label};
    return insert(words, count, at, more, 4);
}

/* An operand becomes another id whose definition says the same type. */
static void swap_operand(uint32_t *words, const size_t *starts, size_t found, struct chance *chance)
{
    size_t at = starts[chance_below(chance, (uint32_t)found)], length = words[at] >> 16;
    if (length < 4)
        return;
    uint32_t *operand = &words[at + 3 + chance_below(chance, (uint32_t)length - 3)], type = 0;
    for (size_t i = 0; i < found && !type; i++)
        if (words[starts[i]] >> 16 > 2 && words[starts[i] + 2] == *operand && has_result(words[starts[i]] & 0xFFFF))
            type = words[starts[i] + 1];
    size_t from = chance_below(chance, (uint32_t)found);
    for (size_t i = 0; i < found && type; i++) {
        const uint32_t *other = &words[starts[(from + i) % found]];
        if (other[0] >> 16 > 2 && other[1] == type && has_result(other[0] & 0xFFFF)) {
            *operand = other[2];
            return;
        }
    }
}

static void change_constant(uint32_t *words, const size_t *starts, size_t found, struct chance *chance)
{
    static const uint32_t values[] = {0, 1, 2, 3, 0xFF, 0x100, 0x200, 0x300, 0x3F800000, 0x7F800000, 0x7FC00000, 0x80000000, UINT32_MAX};
    size_t first = chance_below(chance, (uint32_t)found);
    for (size_t i = 0; i < found; i++) {
        uint32_t *inst = &words[starts[(first + i) % found]];
        if (inst[0] == (4u << 16 | SpvOpConstant)) {
            inst[3] = values[chance_below(chance, sizeof values / sizeof values[0])];
            return;
        }
    }
}

size_t mutate(uint32_t *words, size_t count, bool gentle, struct chance *chance)
{
    size_t starts[MAX_INSTRUCTIONS];
    if (count < 8)
        return count;
    size_t found = list(words, count, starts);
    if (!found)
        return count;
    size_t at = starts[chance_below(chance, (uint32_t)found)], length = words[at] >> 16;
    switch (gentle ? 9 + chance_below(chance, 5) : chance_below(chance, 14)) {
    case 0: words[chance_below(chance, (uint32_t)count)] ^= 1u << chance_below(chance, 32); return count;
    case 1:
        words[chance_below(chance, (uint32_t)count)] =
            chance_below(chance, 2) ? chance_below(chance, 200) : UINT32_MAX - chance_below(chance, 3);
        return count;
    case 2: return chance_below(chance, (uint32_t)count) + 1;
    case 3: /* an operand becomes any id */
        if (length > 1)
            words[at + 1 + chance_below(chance, (uint32_t)length - 1)] = chance_below(chance, words[3] ? words[3] : 1);
        return count;
    case 4: /* an instruction goes */
        memmove(words + at, words + at + length, (count - at - length) * sizeof *words);
        return count - length;
    case 5: { /* an instruction comes twice */
        uint32_t copy[MUTATE_ROOM];
        if (length > MUTATE_ROOM)
            return count;
        memcpy(copy, words + at, length * sizeof *copy);
        return insert(words, count, at, copy, length);
    }
    case 6: /* an instruction changes its opcode, to one of the operations */
        words[at] = (words[at] & 0xFFFF0000u) | (chance_below(chance, 2) ? 4445 + chance_below(chance, 35) : 6016 + chance_below(chance, 17));
        return count;
    case 7: { /* an instruction moves, often one of those that say where debug info belongs */
        uint32_t moved[MUTATE_ROOM];
        for (size_t i = chance_below(chance, 2) ? found : chance_below(chance, (uint32_t)found); i < found; i++)
            if ((words[starts[i]] & 0xFFFF) == SpvOpExtInst) {
                at = starts[i];
                length = words[at] >> 16;
                break;
            }
        if (length > MUTATE_ROOM)
            return count;
        memcpy(moved, words + at, length * sizeof *moved);
        memmove(words + at, words + at + length, (count - at - length) * sizeof *words);
        found = list(words, count - length, starts);
        return insert(words, count - length, found ? starts[chance_below(chance, (uint32_t)found)] : 5, moved, length);
    }
    case 8: /* a byte changes */
        words[chance_below(chance, (uint32_t)count)] ^= (1 + chance_below(chance, 255)) << 8 * chance_below(chance, 4);
        return count;
    /* The gentle ones. */
    case 9:
    case 10: return repeat_operation(words, count, starts, found, chance);
    case 11: return split_block(words, count, starts, found, chance);
    case 12: swap_operand(words, starts, found, chance); return count;
    default: change_constant(words, starts, found, chance); return count;
    }
}
