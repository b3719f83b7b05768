/* SPDX-License-Identifier: Apache-2.0 */
/* What is found in each test shader, in every form of it; that what is written is valid, deterministic, and keeps every
 * original id, decoration and line. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <spirv/unified1/spirv.h>

#include "tests/spirv/modules.h"

struct row {
    const char *shader;
    const char *expected; /* see result_text(); without "query." */
    const char *why;
};

static const struct row rows[] = {
    {"array_good", "", "elements named by constants are followed one by one"},
    {"array_one_uninitialized", "use.uninitialized!11", "the other element is not the one that was initialized"},
    {"barycentrics_of_aabb", "candidate.not_triangle!12", "the branch says that the candidate is a box"},
    {"candidate_after_loop", "candidate.none!11", "the loop ends when there is no candidate"},
    {"candidate_no_proceed", "candidate.none!9", "NG-030: nothing was traversed yet"},
    {"closest_good", "", "the usual loop, guarded by the committed type"},
    {"committed_no_proceed", "committed.none!9", "NG-029: nothing can be committed yet"},
    {"confirm_aabb", "confirm.not_triangle!11", "NG-041, by exclusion of the triangle"},
    {"confirm_good", "", "the candidate's type is tested before"},
    {"confirm_no_proceed", "confirm.no_candidate!9", "NG-042"},
    {"early_return", "", "what returns early does not reach the getter"},
    {"facing_of_generated", "generate.range?11 committed.not_triangle!15", "NG-063: what was generated has no facing"},
    {"flags_good", "", "the flags leave no candidate, so one Proceed ends the traversal"},
    {"function_aliased", "use.uninitialized?9 proceed.after_false?9 use.uninitialized?12 proceed.after_false?12",
     "a query under two names is left to the device"},
    {"function_good", "", "states are followed through calls"},
    {"function_uninitialized", "use.uninitialized!5", "NG-037 through a parameter"},
    {"generate_good", "generate.range?13", "only the device knows the committed T"},
    {"generate_negative", "generate.range!11", "NG-039: tmin is never below zero"},
    {"generate_no_proceed", "generate.no_candidate!9", "NG-040"},
    {"generate_on_triangle", "generate.not_aabb!10", "NG-038: the flags skip boxes"},
    {"getter_uninitialized", "use.uninitialized!8", "NG-031"},
    {"global_good", "", "a global query through a function without parameters"},
    {"initialize_constants",
     "initialize.negative_t!9 initialize.zero_direction!9 initialize.skip_both!9 initialize.mask_bits!9 "
     "initialize.t_order!10 initialize.cull_pair!10 initialize.nan!11 initialize.opacity_pair!11 "
     "initialize.infinite!12 initialize.unknown_flags!12",
     "constants prove it; a mask of all ones is meant"},
    {"loop_break", "candidate.none?15", "a break leaves the candidate, the end of the loop does not"},
    {"no_query", "", "without queries nothing is touched"},
    {"opaque_of_triangle", "candidate.not_aabb!11", "the flags skip boxes"},
    {"proceed_after_loop", "proceed.after_false!11", "NG-018"},
    {"proceed_uninitialized", "use.uninitialized!8", "NG-037"},
    {"reinitialize_good", "", "NG-006: the history starts again"},
    {"run_array", "use.uninitialized?13 proceed.after_false?13 use.uninitialized?16", "a dynamic index leaves it to the device"},
    {"run_candidate",
     "initialize.skip_both?8 initialize.cull_pair?8 initialize.opacity_pair?8 initialize.unknown_flags?8 candidate.none?10",
     "the result of Proceed is not tested"},
    {"run_committed_none", "initialize.nan?8 initialize.infinite?8 committed.none?11", "the committed type is not tested"},
    {"run_do_while", "use.uninitialized?13", "a loop that tests at its end"},
    {"run_function", "proceed.after_false?16 use.uninitialized?7", "a local and a global query through functions"},
    {"run_generate", "generate.range?11", "t comes from the host"},
    {"run_initialize", "initialize.nan?9 initialize.infinite?9", "one component of the origin comes from the host"},
    {"run_operands",
     "initialize.nan?14 initialize.infinite?14 initialize.negative_t?14 initialize.t_order?14 "
     "initialize.zero_direction?14 initialize.skip_both?14 initialize.cull_pair?14 initialize.opacity_pair?14 "
     "initialize.unknown_flags?14 initialize.mask_bits?14",
     "every operand comes from the host"},
    {"run_proceed_again", "proceed.after_false?11 proceed.after_false?14",
     "the first Proceed may return true: boxes are candidates whatever the flags of opacity"},
    {"run_uninitialized", "use.uninitialized?11", "initialized on one of two paths"},
    {"stage_fragment",
     "initialize.nan?12 initialize.infinite?12 initialize.zero_direction?12 committed.none?15", "behind a discard"},
    {"stage_raygen", "committed.none?13", "one of two paths has committed nothing"},
    {"stage_vertex",
     "initialize.nan?9 initialize.infinite?9 initialize.zero_direction?9 committed.none?11", "the stage's own built-ins"},
    {"stale_result", "proceed.after_false?12 candidate.none?15", "what a variable held before the loop is not followed into it"},
    {"call_index", "call.range?9", "only the launch knows the table"},
    {"report_constants", "report.hit_kind!9 report.nan!10", "a t outside of the interval is rejected, which is no mistake"},
    {"trace_constants",
     "trace.negative_t!10 trace.zero_direction!10 trace.skip_both!10 trace.mask_bits!10 trace.sbt_offset_bits!10 "
     "trace.t_order!11 trace.cull_pair!11 trace.sbt_stride_bits!11 trace.nan!12 trace.opacity_pair!12 trace.miss_bits!12 "
     "trace.infinite!13 trace.unknown_flags!13",
     "constants prove it; the widest that is allowed is silent"},
    {"trace_motion", "trace.time!10", "VUID 06366"},
    {"trace_nested", "trace.nan?8 trace.infinite?8 trace.zero_direction?8", "the ray comes from the trace before"},
    {"switch_good", "", "a switch on the type is a guard as well"},
    {"terminate_after_loop", "terminate.after_false!11", "every Proceed before must have returned true"},
    {"terminate_good", "confirm.not_triangle?11", "the candidate could be a box"},
};
#define ROW_COUNT (sizeof rows / sizeof rows[0])

static const struct gn_spirv_options standard = {.profile = GN_PROFILE_VULKAN, .set = 7};

static void without_lines(const char *text, char *out)
{
    for (; *text; text++)
        if (*text < '0' || *text > '9')
            *out++ = *text;
    *out = '\0';
}

static void every_shader_has_a_row(void **state)
{
    char names[256][64];
    int failures = 0;
    (void)state;
    uint32_t count = modules_list(names, 256);
    for (uint32_t n = 0; n < count; n++) {
        bool found = false;
        for (size_t r = 0; r < ROW_COUNT; r++)
            found |= strcmp(rows[r].shader, names[n]) == 0;
        if (!found) {
            print_error("the shader %s has no row\n", names[n]);
            failures++;
        }
    }
    assert_int_equal(count, ROW_COUNT);
    assert_int_equal(failures, 0);
}

static void every_row(void **state)
{
    char text[2048], expected[2048];
    int failures = 0;
    (void)state;
    for (size_t r = 0; r < ROW_COUNT; r++)
        for (int form = 0; form < 3; form++) {
            struct gn_spirv_result result;
            size_t count;
            uint32_t *words = module_load(form_names[form], rows[r].shader, &count);
            bool lines = form < 2;
            gn_spirv_instrument(words, count, &standard, &result);
            result_text(&result, lines, text, sizeof text);
            if (lines)
                snprintf(expected, sizeof expected, "%s", rows[r].expected);
            else
                without_lines(rows[r].expected, expected);
            enum gn_spirv_status status = *expected ? GN_SPIRV_INSTRUMENTED : GN_SPIRV_UNTOUCHED;
            if (strcmp(text, expected) != 0 || result.status != status) {
                print_error("%s (%s; %s): expected %s \"%s\", found %s \"%s\" %s\n", rows[r].shader, form_names[form],
                            rows[r].why, gn_spirv_status_name(status), expected, gn_spirv_status_name(result.status), text,
                            result.message);
                failures++;
            }
            gn_spirv_result_finish(&result);
            free(words);
        }
    assert_int_equal(failures, 0);
}

static void every_rule_fires_and_stays_silent(void **state)
{
    int failures = 0;
    (void)state;
    for (uint32_t rule = 0; rule < GN_SPIRV_RULE_COUNT; rule++) {
        const struct gn_spirv_rule *block = gn_spirv_rule_at((enum gn_spirv_rule_index)rule);
        /* A pipeline that allows little, and one that allows much. */
        const struct gn_spirv_options wgpu[] = {{.profile = GN_PROFILE_WGPU,
                                                 .proceed_limit = 1,
                                                 .recursion_known = true,
                                                 .max_payload = 8,
                                                 .max_attribute = 8,
                                                 .forbidden_ray_flags = 0x200},
                                                {.profile = GN_PROFILE_WGPU,
                                                 .recursion_known = true,
                                                 .max_recursion = 9,
                                                 .max_payload = 16,
                                                 .max_attribute = 16,
                                                 .forbidden_ray_flags = 0x100}};
        int firing = 0, silent = 0;
        for (size_t r = 0; r < 2 * ROW_COUNT; r++) {
            struct gn_spirv_result result;
            size_t count;
            uint32_t *words = module_load("plain", rows[r / 2].shader, &count);
            bool asked_for = rule == GN_SPIRV_RULE_PROCEED_LIMIT || rule == GN_SPIRV_RULE_CALL_RANGE;
            gn_spirv_instrument(words, count, &wgpu[r % 2], &result);
            for (uint32_t s = 0; s < result.site_count; s++) {
                /* Two rules depend on what only the device knows: they fire on it, and are silent where they are not checked. */
                firing += (asked_for ? result.sites[s].checked : result.sites[s].wrong) >> rule & 1;
                silent += (result.sites[s].judged & ~result.sites[s].checked) >> rule & 1;
                silent += asked_for && !(result.sites[s].judged >> rule & 1);
            }
            gn_spirv_result_finish(&result);
            free(words);
        }
        if (!firing || !silent) {
            print_error("%s is wrong %d times and right %d times; it needs both\n", block->id, firing, silent);
            failures++;
        }
        assert_true(strchr(block->id, '.') && block->title && block->text && block->remedy && block->sources[0]);
        assert_ptr_equal(gn_spirv_rule_find(block->id), block);
    }
    assert_int_equal(failures, 0);
}

/* Each original instruction that names something is in the output, word for word. */
static bool keeps_what_was_there(const uint32_t *before, size_t before_count, const uint32_t *after, size_t after_count)
{
    size_t at = 5;
    for (size_t from = 5; from < before_count; from += before[from] >> 16) {
        uint32_t opcode = before[from] & 0xFFFF, length = before[from] >> 16;
        switch (opcode) {
        case SpvOpPhi:
        case SpvOpMemoryModel: /* becomes a physical one */
        case SpvOpEntryPoint:
        case SpvOpFunction:
        case SpvOpFunctionCall:
        case SpvOpLoopMerge:
        case SpvOpBranch:
        case SpvOpBranchConditional: continue; /* may name another block, or more arguments */
        default: break;
        }
        while (at < after_count && ((after[at] >> 16) != length || memcmp(after + at, before + from, length * 4) != 0))
            at += after[at] >> 16;
        if (at >= after_count)
            return false;
        at += length;
    }
    return true;
}

static void what_is_written_is_valid(void **state)
{
    char names[256][64], message[512];
    int failures = 0, written = 0;
    (void)state;
    uint32_t count = modules_list(names, 256);
    for (uint32_t n = 0; n < count; n++)
        for (int form = 0; form < FORM_COUNT; form++)
            for (int way = 0; way < 8; way++) { /* with proofs or without, records in a descriptor or at an address, safe or not */
                bool all = way & 1, address = way & 2;
                const struct gn_spirv_options options = {.profile = all ? GN_PROFILE_WGPU : GN_PROFILE_VULKAN,
                                                         .set = 7,
                                                         .binding = 3,
                                                         .root = address ? UINT64_C(0x4700001000) : 0,
                                                         .key = UINT64_C(0x123456789ABCDEF1),
                                                         .safe = way & 4,
                                                         .without_proofs = all};
                struct gn_spirv_result first, second;
                size_t size;
                uint32_t *words = module_load(form_names[form], names[n], &size);
                gn_spirv_instrument(words, size, &options, &first);
                gn_spirv_instrument(words, size, &options, &second);
                bool same = first.status == second.status && first.word_count == second.word_count &&
                            (!first.words || memcmp(first.words, second.words, first.word_count * 4) == 0);
                bool valid = first.status == GN_SPIRV_UNTOUCHED;
                snprintf(message, sizeof message, "%s", first.message);
                if (first.status == GN_SPIRV_INSTRUMENTED) {
                    written++;
                    /* What SPIRV-Tools already finds wrong with the original is no fault of the output. */
                    valid = gn_spirv_validate(first.words, first.word_count, 2 + (form == 1), message, sizeof message) &&
                            gn_spirv_validate(first.words, first.word_count, 3, message, sizeof message);
                }
                /* What may be skipped has another result. */
                bool kept = !first.words || options.safe || keeps_what_was_there(words, size, first.words, first.word_count);
                if (!same || !valid || !kept) {
                    print_error("%s (%s%s%s): %s%s%s%s\n", names[n], form_names[form], all ? ", without proofs" : "",
                                address ? ", at an address" : "", same ? "" : "differs in a second run; ", kept ? "" : "an instruction is lost; ",
                                valid ? "" : "not valid: ", valid ? "" : message);
                    failures++;
                }
                gn_spirv_result_finish(&first);
                gn_spirv_result_finish(&second);
                free(words);
            }
    print_message("%d modules written\n", written);
    assert_true(written > 200);
    assert_int_equal(failures, 0);
}

static void places_are_named(void **state)
{
    (void)state;
    for (int form = 0; form < 2; form++) {
        struct gn_spirv_result result;
        size_t count;
        uint32_t *words = module_load(form_names[form], "proceed_after_loop", &count);
        gn_spirv_instrument(words, count, &standard, &result);
        assert_int_equal(result.finding_count, 1);
        const struct gn_spirv_finding *finding = &result.findings[0];
        const struct gn_spirv_site *site = &result.sites[finding->site];
        assert_int_equal(finding->rule, GN_SPIRV_RULE_PROCEED_AFTER_FALSE);
        assert_int_equal(finding->severity, GN_SEVERITY_ERROR);
        assert_non_null(strstr(finding->message, "OpRayQueryProceedKHR on q"));
        assert_non_null(site->place.function);
        assert_int_equal(strncmp(site->place.function, "main", 4), 0);
        assert_non_null(site->place.file);
        assert_non_null(strstr(site->place.file, "proceed_after_loop.comp"));
        assert_string_equal(site->place.source, "SHOW(rayQueryProceedEXT(q) ? 1 : 0);");
        assert_int_equal(words[site->place.offset] & 0xFFFF, SpvOpRayQueryProceedKHR);
        uint32_t of;
        enum gn_spirv_rule_index rule;
        assert_true(gn_spirv_check_find(&result, site->first_check, &of, &rule));
        assert_int_equal(of, finding->site);
        assert_int_equal(rule, finding->rule);
        assert_false(gn_spirv_check_find(&result, result.check_count, &of, &rule));
        gn_spirv_result_finish(&result);
        free(words);
    }
}

static void profiles_decide(void **state)
{
    /* Reading what is committed in the loop is allowed by Vulkan and undefined in WGSL. */
    static const struct {
        enum gn_profile profile;
        uint32_t expected;
    } table[] = {{GN_PROFILE_VULKAN, 0}, {GN_PROFILE_WGPU, 1}, {GN_PROFILE_DILIGENT, 0}};
    (void)state;
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        const struct gn_spirv_options options = {.profile = table[i].profile};
        struct gn_spirv_result result;
        size_t count;
        uint32_t *words = module_load("line", "committed_no_proceed", &count), early = 0;
        gn_spirv_instrument(words, count, &options, &result);
        for (uint32_t f = 0; f < result.finding_count; f++)
            early += result.findings[f].rule == GN_SPIRV_RULE_COMMITTED_TOO_EARLY;
        assert_int_equal(early, table[i].expected);
        gn_spirv_result_finish(&result);
        free(words);
    }
}

static void only_what_is_asked_for(void **state)
{
    (void)state;
    struct gn_spirv_options options = {.static_only = true};
    struct gn_spirv_result result;
    size_t count;
    uint32_t *words = module_load("line", "proceed_after_loop", &count);
    gn_spirv_instrument(words, count, &options, &result);
    assert_int_equal(result.status, GN_SPIRV_UNTOUCHED);
    assert_int_equal(result.finding_count, 1);
    assert_null(result.words);
    gn_spirv_result_finish(&result);
    /* The module's own binding cannot be taken for records. */
    options = (struct gn_spirv_options){.set = 0, .binding = 1};
    gn_spirv_instrument(words, count, &options, &result);
    assert_int_equal(result.status, GN_SPIRV_DECLINED);
    assert_non_null(strstr(result.message, "set 0, binding 1"));
    gn_spirv_result_finish(&result);
    assert_true(gn_spirv_has_queries(words, count));
    free(words);
    words = module_load("line", "no_query", &count);
    gn_spirv_instrument(words, count, &standard, &result);
    assert_int_equal(result.status, GN_SPIRV_UNTOUCHED);
    gn_spirv_result_finish(&result);
    free(words);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_shader_has_a_row), cmocka_unit_test(every_row),
        cmocka_unit_test(every_rule_fires_and_stays_silent), cmocka_unit_test(what_is_written_is_valid),
        cmocka_unit_test(places_are_named), cmocka_unit_test(profiles_decide), cmocka_unit_test(only_what_is_asked_for),
    };
    return cmocka_run_group_tests_name("spirv.findings", tests, NULL, NULL);
}
