/* SPDX-License-Identifier: Apache-2.0 */
/* Instrumented shaders on a real driver: a misuse leaves its records with the right site, count and invocation, and a
 * correct shader leaves none and computes what it did without checks. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "checks/spirv/records.h"
#include "tests/spirv/device.h"
#include "tests/spirv/modules.h"

#define ALL UINT32_MAX

struct row {
    const char *shader;
    struct choices choices;
    const char *expected; /* "rule@line*count", separated by spaces; without "query." */
    const char *why;
};

static const struct row rows[] = {
    {"run_initialize", {1, NAN, ALL}, "initialize.nan@9*8", "a NaN in the origin, every lane"},
    {"run_initialize", {1, NAN, 5}, "initialize.nan@9*1", "NG-045: one lane of eight"},
    {"run_initialize", {1, INFINITY, 2}, "initialize.infinite@9*1", "infinite, but no NaN"},
    {"run_initialize", {0, NAN, ALL}, "", "not chosen"},
    {"run_initialize", {1, 0.5f, ALL}, "", "a number"},
    {"run_operands", {1, 1, ALL}, "initialize.skip_both@14*8", "VUID 06889"},
    {"run_operands", {2, 1, 0}, "initialize.cull_pair@14*1", "VUID 06890"},
    {"run_operands", {3, 1, 7}, "initialize.opacity_pair@14*1", "VUID 06891"},
    {"run_operands", {4, 1, 3}, "initialize.unknown_flags@14*1", "NG-080"},
    {"run_operands", {5, 1, 3}, "initialize.mask_bits@14*1", "NG-048"},
    {"run_operands", {6, 1, 3}, "initialize.negative_t@14*1", "tmin = -1"},
    {"run_operands", {6, 0, 3}, "", "tmin = -0 is no negative number"},
    {"run_operands", {6, NAN, 3}, "initialize.nan@14*1", "tmin is NaN"},
    {"run_operands", {7, 1, 3}, "initialize.t_order@14*1", "tmin = 200, tmax = 100"},
    {"run_operands", {8, 1, ALL}, "initialize.zero_direction@14*8", "no direction"},
    {"run_operands", {0, 1, ALL}, "", "all operands are right"},
    {"run_uninitialized", {1, 0, 4}, "use.uninitialized@11*1", "one lane takes the other path"},
    {"run_uninitialized", {0, 0, ALL}, "", "every lane initializes"},
    {"run_committed_none", {1, 0, 6}, "committed.none@11*1", "one ray misses"},
    {"run_committed_none", {0, 0, ALL}, "", "every ray hits"},
    {"run_candidate", {1, 0, 1}, "candidate.none@10*1", "opaque triangles alone leave no candidate"},
    {"run_candidate", {0, 0, ALL}, "", "the triangle is a candidate"},
    {"run_generate", {1, 0.25f, 2}, "generate.range@11*1", "below tmin"},
    {"run_generate", {1, 0.5f, ALL}, "", "NG-044: tmin itself is allowed"},
    {"run_generate", {1, 100, ALL}, "", "and so is tmax"},
    {"run_generate", {1, 101, ALL}, "generate.range@11*8", "beyond tmax"},
    {"run_generate", {1, NAN, 0}, "generate.range@11*1", "NaN"},
    {"run_function", {1, 0, 3}, "proceed.after_false@16*1 use.uninitialized@7*1",
     "one query is over, the other was never begun"},
    {"run_function", {0, 0, ALL}, "", "initialized"},
    {"loop_break", {9, 0, ALL}, "candidate.none@15*8", "the loop ends by itself"},
    {"loop_break", {0, 0, ALL}, "", "the loop is left at the first candidate"},
    {"early_return", {1, 0, 3}, "", "one lane returns"},
    {"getter_uninitialized", {0, 0, ALL}, "use.uninitialized@8*8", "what is proved wrong is counted when it runs"},
    {"committed_no_proceed", {0, 0, ALL}, "committed.none@9*8", "NG-029"},
    {"candidate_no_proceed", {0, 0, ALL}, "candidate.none@9*8", "NG-030"},
    {"candidate_after_loop", {0, 0, ALL}, "candidate.none@11*8", "NG-033"},
    {"barycentrics_of_aabb", {0, 0, ALL}, "candidate.not_triangle@12*8", "one box"},
    {"confirm_aabb", {0, 0, ALL}, "confirm.not_triangle@11*8", "NG-041"},
    {"generate_on_triangle", {0, 0, ALL}, "generate.not_aabb@10*8", "NG-038"},
    {"opaque_of_triangle", {0, 0, ALL}, "candidate.not_aabb@11*8", "one triangle"},
    {"facing_of_generated", {0, 0, ALL}, "committed.not_triangle@15*8", "NG-063"},
    {"generate_negative", {0, 0, ALL}, "generate.range@11*8", "NG-039"},
    {"terminate_after_loop", {0, 0, ALL}, "terminate.after_false@11*8", "after the loop"},
    {"proceed_after_loop", {0, 0, ALL}, "proceed.after_false@11*8", "NG-018"},
};
#define ROW_COUNT (sizeof rows / sizeof rows[0])

static const struct gn_spirv_options standard = {.profile = GN_PROFILE_VULKAN, .set = RECORD_SET};

/* What the buffer says, in the words of the rows; checks each record's invocation and checksum on the way. */
static bool fired_text(const struct gn_spirv_result *result, const uint32_t *records, size_t words,
                       const struct choices *choices, char *out, size_t size)
{
    size_t used = 0;
    bool good = true;
    out[0] = '\0';
    for (uint32_t check = 0; check < result->check_count; check++) {
        struct gn_records_check found;
        uint32_t site;
        enum gn_spirv_rule_index rule;
        good &= gn_records_read(records, words, check, &found) && gn_spirv_check_find(result, check, &site, &rule);
        if (!good || !found.count || used >= size)
            continue;
        used += (size_t)snprintf(out + used, size - used, "%s%s@%u*%u", used ? " " : "", rule_name(rule),
                                 result->sites[site].place.line, (unsigned)found.count);
        for (uint32_t r = 0; r < found.record_count; r++)
            good &= found.records[r].intact && found.records[r].invocation[0] < LANES &&
                    (choices->lane == ALL || found.records[r].invocation[0] == choices->lane);
    }
    return good;
}

static bool run(struct tracer *tracer, const char *form, const char *shader, const struct gn_spirv_options *options,
                const struct choices *choices, float plain[LANES], float checked[LANES], char *text, size_t size)
{
    size_t count;
    uint32_t *words = module_load(form, shader, &count);
    struct gn_spirv_result result;
    bool good = true;
    gn_spirv_instrument(words, count, options, &result);
    if (plain)
        tracer_run(tracer, words, count, choices, plain, NULL, 0);
    text[0] = '\0';
    if (result.status == GN_SPIRV_INSTRUMENTED) {
        size_t record_words = gn_records_word_count(result.check_count);
        uint32_t *records = malloc(record_words * 4);
        assert_non_null(records);
        gn_records_reset(records, result.check_count);
        tracer_run(tracer, result.words, result.word_count, choices, checked, records, record_words);
        good = fired_text(&result, records, record_words, choices, text, size);
        free(records);
    } else if (plain) {
        memcpy(checked, plain, LANES * sizeof(float));
    }
    gn_spirv_result_finish(&result);
    free(words);
    return good;
}

static void misuse_is_recorded(void **state)
{
    struct tracer *tracer = *state;
    int failures = 0;
    for (size_t r = 0; r < ROW_COUNT; r++)
        for (int form = 0; form < 2; form++) {
            char text[1024];
            float out[LANES];
            bool good = run(tracer, form_names[form], rows[r].shader, &standard, &rows[r].choices, NULL, out, text, sizeof text);
            if (!good || strcmp(text, rows[r].expected) != 0) {
                print_error("%s (%s), choice %u, value %g (%s): expected \"%s\", found \"%s\"%s\n", rows[r].shader,
                            form_names[form], rows[r].choices.choice, (double)rows[r].choices.value, rows[r].why,
                            rows[r].expected, text, good ? "" : ", with a record that is not as it should be");
                failures++;
            }
        }
    assert_int_equal(failures, 0);
}

/* With every check written, also those that are proved not to be needed. */
static void correct_shaders_stay_silent(void **state)
{
    static const char *const shaders[] = {
        "array_good",      "closest_good", "confirm_good",   "flags_good",    "function_good",      "generate_good",
        "global_good",     "switch_good",  "terminate_good", "run_array",     "reinitialize_good",  "run_do_while",
        "run_initialize",  "run_operands", "run_function",   "run_candidate", "run_committed_none", "run_uninitialized",
        "run_proceed_again"};
    struct tracer *tracer = *state;
    int failures = 0;
    for (size_t s = 0; s < sizeof shaders / sizeof shaders[0]; s++)
        for (int form = 0; form < FORM_COUNT; form += FORM_COUNT - 1) { /* as compiled, and optimized */
            const struct gn_spirv_options options = {
                .profile = GN_PROFILE_VULKAN, .set = RECORD_SET, .without_proofs = true};
            const struct choices choices = {0, 0, ALL};
            float plain[LANES], checked[LANES];
            char text[1024];
            bool good = run(tracer, form_names[form], shaders[s], &options, &choices, plain, checked, text, sizeof text);
            if (!good || *text || memcmp(plain, checked, sizeof plain) != 0) {
                print_error("%s (%s): expected silence and the same results, found \"%s\"%s\n", shaders[s],
                            form_names[form], text, memcmp(plain, checked, sizeof plain) ? ", and other results" : "");
                failures++;
            }
        }
    assert_int_equal(failures, 0);
}

static void operands_are_kept(void **state)
{
    struct tracer *tracer = *state;
    size_t count;
    uint32_t *words = module_load("line", "run_operands", &count);
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
    tracer_run(tracer, result.words, result.word_count, &choices, out, records, record_words);
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
    tracer_run(tracer, result.words, result.word_count, &choices, out, records, record_words);
    assert_int_equal(records[1], 1);
    for (size_t i = GN_RECORDS_HEADER; i < record_words; i++)
        assert_int_equal(records[i], 0);
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
        cmocka_unit_test(misuse_is_recorded),
        cmocka_unit_test(operands_are_kept),
        cmocka_unit_test(correct_shaders_stay_silent),
    };
    return cmocka_run_group_tests_name("spirv.device", tests, setup, teardown);
}
