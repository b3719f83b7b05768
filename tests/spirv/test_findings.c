/* SPDX-License-Identifier: Apache-2.0 */
/* What is found in each test shader, in every form of it; that what is written is valid, deterministic, and keeps every
 * original id, decoration and line. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <spirv/unified1/spirv.h>

#include "tests/spirv/modules.h"

static const struct gn_spirv_options standard = {.profile = GN_PROFILE_VULKAN, .set = 7};

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
    static char names[512][64], message[512];
    int failures = 0, written = 0;
    (void)state;
    uint32_t count = modules_list(names, 512);
    for (uint32_t n = 0; n < count; n++)
        for (int form = 0; form < FORM_COUNT; form++)
            for (int w = 0; w < 3; w++) {
                /* With proofs or without, records in a descriptor or at an address, safe or not: each alone, and together. */
                static const int ways[] = {0, 3, 6};
                int way = ways[w];
                bool all = way & 1, address = way & 2;
                const struct gn_spirv_options options = {.profile = all ? GN_PROFILE_WGPU : GN_PROFILE_VULKAN,
                                                         .set = 7,
                                                         .binding = 3,
                                                         .root = address ? UINT64_C(0x4700001000) : 0,
                                                         .structures = address ? UINT64_C(0x4700100000) : 0,
                                                         .key = UINT64_C(0x123456789ABCDEF1),
                                                         .safe = way & 4,
                                                         .proceed_limit = all ? 3 : 0,
                                                         .recursion_known = all,
                                                         .max_recursion = 4,
                                                         .max_payload = 8,
                                                         .max_attribute = 8,
                                                         .forbidden_ray_flags = all ? 0x100 : 0,
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
        uint32_t *words = module_load(form_names[form], "proceed_after_loop.comp", &count);
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
        assert_int_equal(strncmp(site->place.source, "SHOW(rayQueryProceedEXT(q) ? 1 : 0);", 36), 0);
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
        uint32_t *words = module_load("line", "committed_no_proceed.comp", &count), early = 0;
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
    uint32_t *words = module_load("line", "proceed_after_loop.comp", &count);
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
    words = module_load("line", "no_query.comp", &count);
    gn_spirv_instrument(words, count, &standard, &result);
    assert_int_equal(result.status, GN_SPIRV_UNTOUCHED);
    gn_spirv_result_finish(&result);
    free(words);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_written_is_valid), cmocka_unit_test(places_are_named),
        cmocka_unit_test(profiles_decide), cmocka_unit_test(only_what_is_asked_for),
    };
    return cmocka_run_group_tests_name("spirv.findings", tests, NULL, NULL);
}
