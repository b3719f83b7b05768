/* SPDX-License-Identifier: Apache-2.0 */
/* What records keep of a misuse on a real driver, and that a buffer without room is not overrun. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "checks/spirv/records.h"
#include "tests/spirv/device.h"
#include "tests/spirv/modules.h"

static const struct gn_spirv_options standard = {.profile = GN_PROFILE_VULKAN, .set = RECORD_SET};

static void operands_are_kept(void **state)
{
    struct tracer *tracer = *state;
    size_t count;
    uint32_t *words = module_load("line", "run_operands.comp", &count);
    struct gn_spirv_result result;
    const struct choices choices = {7, 1, 3};
    float out[LANES], t[2];
    bool seen = false;
    gn_spirv_instrument(words, count, &standard, &result);
    assert_int_equal(result.status, GN_SPIRV_INSTRUMENTED);
    size_t record_words = gn_records_word_count(result.check_count);
    uint32_t *records = malloc(record_words * 4);
    assert_non_null(records);
    gn_records_reset(records, result.check_count);
    struct program program = {.stages = {{.stage = VK_SHADER_STAGE_COMPUTE_BIT,
                                          .words = result.words,
                                          .word_count = result.word_count,
                                          .records = records,
                                          .record_words = record_words}},
                              .stage_count = 1};
    tracer_run(tracer, &program, &choices, out);
    for (uint32_t check = 0; check < result.check_count; check++) {
        struct gn_records_check found;
        assert_true(gn_records_read(records, record_words, check, &found));
        if (!found.count)
            continue;
        seen = true;
        memcpy(&t[0], &found.records[0].operands[5], 4);
        memcpy(&t[1], &found.records[0].operands[9], 4);
        assert_true(found.records[0].operands[0] == 1 && found.records[0].operands[1] == 0xFF);
        assert_true(t[0] == 200 && t[1] == 100);
    }
    assert_true(seen);

    /* A buffer without room loses records, is not overrun, and says so. */
    memset(records, 0, record_words * 4);
    tracer_run(tracer, &program, &choices, out);
    assert_int_equal(records[1], 1);
    for (size_t i = GN_RECORDS_HEADER; i < record_words; i++)
        assert_int_equal(records[i], 0);
    tracer_forget(tracer, &program);
    free(records);
    gn_spirv_result_finish(&result);
    free(words);
}

static int setup(void **state)
{
    *state = tracer_create();
    return 0;
}

static int teardown(void **state)
{
    tracer_destroy(*state);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(operands_are_kept),
    };
    return cmocka_run_group_tests_name("spirv.device", tests, setup, teardown);
}
