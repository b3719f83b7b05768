/* SPDX-License-Identifier: Apache-2.0 */
/* Any words are input: mutated modules never crash the library, what it writes of those that are still valid is valid too, and its
 * model loses nothing of a valid one. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <spirv/unified1/NonSemanticShaderDebugInfo100.h>
#include <spirv/unified1/spirv.h>

#include "checks/spirv/records.h"
#include "tests/spirv/modules.h"
#include "tests/spirv/trial.h"

#define MUTATIONS 3000

static void mutations_never_crash(void **state)
{
    struct trials *trials = trials_create();
    (void)state;
    for (uint32_t m = 0; m < MUTATIONS; m++)
        trials_run(trials, 7, m);
    trials_print(trials);
    uint32_t instrumented = trials_instrumented(trials), invalid = trials_invalid(trials);
    assert_int_equal(trials_destroy(trials), 0);
    assert_true(instrumented > MUTATIONS / 20 && invalid > MUTATIONS / 20);
}

static void the_model_loses_nothing(void **state)
{
    static char names[512][64];
    char message[512];
    (void)state;
    uint32_t name_count = modules_list(names, 512);
    for (uint32_t n = 0; n < name_count; n++)
        for (int form = 0; form < FORM_COUNT; form++) {
            size_t count, back = 0;
            uint32_t *words = module_load(form_names[form], names[n], &count);
            uint32_t *copy = gn_spirv_round_trip(words, count, &back, message, sizeof message);
            if (!copy || back != count || memcmp(words, copy, count * 4) != 0)
                fail_msg("%s (%s) changes: %s", names[n], form_names[form], copy ? "words differ" : message);
            free(copy);
            free(words);
        }
}

static void hostile_headers_are_refused(void **state)
{
    static const struct {
        const char *name;
        size_t count;
        uint32_t words[8];
        const char *says;
    } table[] = {
        {"empty", 0, {0}, "5 to"},
        {"four words", 4, {0x07230203, 0x10500, 0, 10}, "5 to"},
        {"magic", 5, {1, 2, 3, 4, 5}, "magic"},
        {"swapped", 5, {0x03022307, 0, 0, 0, 0}, "byte order"},
        {"no bound", 5, {0x07230203, 0x10500, 0, 0, 0}, "bound"},
        {"huge bound", 5, {0x07230203, 0x10500, 0, UINT32_MAX, 0}, "bound"},
        {"no instruction", 5, {0x07230203, 0x10500, 0, 10, 0}, "add up"},
        {"length 0", 6, {0x07230203, 0x10500, 0, 10, 0, 17}, "add up"},
        {"too long", 6, {0x07230203, 0x10500, 0, 10, 0, 0x20011}, "add up"},
        {"id beyond the bound", 7, {0x07230203, 0x10500, 0, 10, 0, 0x20013, 99}, "bound"},
        {"label outside", 7, {0x07230203, 0x10500, 0, 10, 0, 0x200F8, 5}, "label inside"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        struct gn_spirv_result result;
        gn_spirv_instrument(table[i].count ? table[i].words : NULL, table[i].count, NULL, &result);
        if (result.status != GN_SPIRV_INVALID && result.status != GN_SPIRV_DECLINED)
            fail_msg("%s: status %s", table[i].name, gn_spirv_status_name(result.status));
        if (!strstr(result.message, table[i].says))
            fail_msg("%s: expected a message with \"%s\", found \"%s\"", table[i].name, table[i].says, result.message);
        gn_spirv_result_finish(&result);
    }
}

/* SPIRV-Tools does not ask every operation for the types of its operands, and may not be asked: what checks read they ask themselves. */
static void operands_of_other_types_are_declined(void **state)
{
    static const struct {
        const char *file;
        uint32_t opcode, word, instead; /* the operand at `word` becomes that at `instead` */
    } table[] = {
        {"trace_motion_good.rgen", SpvOpTraceRayMotionNV, 2, 7},  /* flags: the origin */
        {"trace_motion_good.rgen", SpvOpTraceRayMotionNV, 6, 8},  /* miss index: tmin */
        {"trace_motion_good.rgen", SpvOpTraceRayMotionNV, 7, 8},  /* origin: tmin */
        {"trace_motion_good.rgen", SpvOpTraceRayMotionNV, 11, 2}, /* time: flags */
        {"trace_constants.rgen", SpvOpTraceRayKHR, 10, 1},        /* tmax: the structure */
        {"initialize_flags.comp", SpvOpRayQueryInitializeKHR, 4, 5},
        {"initialize_flags.comp", SpvOpRayQueryInitializeKHR, 8, 7},
        {"report_good.rint", SpvOpReportIntersectionKHR, 3, 4},
        {"report_good.rint", SpvOpReportIntersectionKHR, 4, 3},
    };
    (void)state;
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        const struct gn_spirv_options options = {.without_validation = true};
        struct gn_spirv_result result;
        size_t count, at = 5;
        uint32_t *words = module_load("plain", table[i].file, &count);
        while (at < count && (words[at] & 0xFFFF) != table[i].opcode)
            at += words[at] >> 16;
        if (at >= count)
            fail_msg("%s has no instruction %u", table[i].file, table[i].opcode);
        words[at + table[i].word] = words[at + table[i].instead];
        gn_spirv_instrument(words, count, &options, &result);
        if (result.status != GN_SPIRV_DECLINED || !strstr(result.message, "of a type"))
            fail_msg("%s, word %u: %s: %s", table[i].file, table[i].word, gn_spirv_status_name(result.status), result.message);
        gn_spirv_result_finish(&result);
        free(words);
    }
}

/* SPIRV-Tools' validator crashes on what says where a function's debug info is when no block is around it. */
static void debug_info_outside_of_blocks_is_refused(void **state)
{
    static const struct {
        const char *name;
        uint32_t before; /* the first of these after the instruction's function has begun */
        enum gn_spirv_status expected;
    } table[] = {
        {"in the first block", SpvOpReturn, GN_SPIRV_INSTRUMENTED},
        {"before the first block", SpvOpLabel, GN_SPIRV_INVALID},
        {"after the last block", SpvOpFunctionEnd, GN_SPIRV_INVALID},
    };
    (void)state;
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        const struct gn_spirv_options options = {.set = 7};
        struct gn_spirv_result result;
        char message[512];
        uint32_t moved[8];
        size_t count, function = 0, at = 5, to;
        uint32_t *words = module_load("debug", "getter_uninitialized.comp", &count);
        for (; at < count && !((words[at] & 0xFFFF) == SpvOpExtInst && words[at] >> 16 == 7 &&
                               words[at + 4] == NonSemanticShaderDebugInfo100DebugFunctionDefinition);
             at += words[at] >> 16)
            if ((words[at] & 0xFFFF) == SpvOpFunction)
                function = at;
        assert_true(function && at < count);
        memcpy(moved, words + at, 7 * sizeof *words);
        memmove(words + at, words + at + 7, (count - at - 7) * sizeof *words);
        for (to = function; (words[to] & 0xFFFF) != table[i].before; to += words[to] >> 16)
            assert_true(to < count - 7);
        memmove(words + to + 7, words + to, (count - to - 7) * sizeof *words);
        memcpy(words + to, moved, 7 * sizeof *words);
        gn_spirv_instrument(words, count, &options, &result);
        if (result.status != table[i].expected)
            fail_msg("%s: %s: %s", table[i].name, gn_spirv_status_name(result.status), result.message);
        assert_int_equal(gn_spirv_validate(words, count, 0, message, sizeof message), result.status == GN_SPIRV_INSTRUMENTED);
        gn_spirv_result_finish(&result);
        free(words);
    }
}

static void records_are_not_trusted(void **state)
{
    uint32_t words[GN_RECORDS_HEADER + GN_RECORDS_CHECK];
    struct gn_records_check check;
    (void)state;
    assert_int_equal(gn_records_word_count(1), sizeof words / 4);
    assert_int_equal(gn_records_word_count(UINT32_MAX), 0);
    memset(words, 0xFF, sizeof words);
    gn_records_reset(words, 1);
    assert_true(gn_records_read(words, sizeof words / 4, 0, &check));
    assert_true(check.count == 0 && check.record_count == 0);
    assert_false(gn_records_read(words, sizeof words / 4, 1, &check));
    assert_false(gn_records_read(words, 3, 0, &check));
    uint32_t *record = words + GN_RECORDS_HEADER + 2;
    words[GN_RECORDS_HEADER] = 5;
    words[GN_RECORDS_HEADER + 1] = 1;
    for (uint32_t i = 0; i < GN_RECORD_CHECKSUM; i++)
        record[i] = i * 3;
    record[GN_RECORD_CHECKSUM] = gn_record_checksum(record);
    record[GN_RECORD_WRITTEN] = 1;
    assert_true(gn_records_read(words, sizeof words / 4, 0, &check));
    assert_true(check.count == 0x100000005ull && check.record_count == GN_RECORDS_KEPT);
    assert_true(check.records[0].intact && !check.records[1].intact);
    assert_int_equal(check.records[0].operands[0], GN_RECORD_OPERAND * 3);
    record[GN_RECORD_OPERAND] ^= 1;
    assert_true(gn_records_read(words, sizeof words / 4, 0, &check));
    assert_false(check.records[0].intact);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_model_loses_nothing),
        cmocka_unit_test(hostile_headers_are_refused),
        cmocka_unit_test(operands_of_other_types_are_declined),
        cmocka_unit_test(debug_info_outside_of_blocks_is_refused),
        cmocka_unit_test(records_are_not_trusted),
        cmocka_unit_test(mutations_never_crash),
    };
    return cmocka_run_group_tests_name("spirv.robustness", tests, NULL, NULL);
}
