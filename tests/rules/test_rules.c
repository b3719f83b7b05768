/* SPDX-License-Identifier: Apache-2.0 */
/* Every rule over plain values: a row that fires beside a row that stays silent. A rule of the catalogue that lacks either
 * fails here. */
#include "checks/rules/rules.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#define MAX_INSTANCES 4
#define MAX_STRUCTURES 3
#define NULL_REF GN_REFERENCE_NULL
#define UNKNOWN GN_REFERENCE_UNKNOWN

struct row {
    const char *rule;
    const char *name;
    const char *why;
    uint32_t expected; /* findings */
    uint32_t instance_count;
    uint32_t refers_to[MAX_INSTANCES];
    uint32_t structure_count;
    enum gn_built built[MAX_STRUCTURES];
    const char *says; /* part of the first message */
};

static const struct row rows[] = {
    {"build.order.blas_never_built", "never built", "nothing ever built it", 1, 1, {0}, 1, {GN_BUILT_NEVER},
     "instance 0 of 1 of TLAS \"scene\" (0x7) refers to BLAS \"tree 0\" (0x100)"},
    {"build.order.blas_never_built", "built before", "the usual order", 0, 1, {0}, 1, {GN_BUILT_BEFORE}, NULL},
    {"build.order.blas_never_built", "built later", "submission order decides, so a later build is too late", 1, 1, {0}, 1,
     {GN_BUILT_LATER}, "its first build was submitted only after this one"},
    {"build.order.blas_never_built", "same call", "unordered within one call, which is another rule's matter", 0, 1, {0}, 1,
     {GN_BUILT_SAME_CALL}, NULL},
    {"build.order.blas_never_built", "other queue", "a build that nothing observed orders may have come first", 0, 1, {0}, 1,
     {GN_BUILT_UNORDERED}, NULL},
    {"build.order.blas_never_built", "null reference", "an inactive instance refers to nothing", 0, 2, {NULL_REF, 0}, 1,
     {GN_BUILT_BEFORE}, NULL},
    {"build.order.blas_never_built", "unknown reference", "what is not a known structure belongs to another rule", 0, 1,
     {UNKNOWN}, 0, {0}, NULL},
    {"build.order.blas_never_built", "second instance", "the index named is that of the offending instance", 1, 3, {1, 0, 1}, 2,
     {GN_BUILT_NEVER, GN_BUILT_BEFORE}, "instance 1 of 3"},
    {"build.order.blas_never_built", "two of a kind", "instances of one BLAS are one finding with a count", 1, 3, {0, 0, 0}, 1,
     {GN_BUILT_NEVER}, "instance 0 of 3"},
    {"build.order.blas_never_built", "two BLASes", "two BLASes are two findings", 2, 2, {0, 1}, 2,
     {GN_BUILT_NEVER, GN_BUILT_LATER}, NULL},
    {"build.order.blas_never_built", "no instances", "an empty TLAS refers to nothing", 0, 0, {0}, 0, {0}, NULL},
};

#define ROW_COUNT (sizeof rows / sizeof rows[0])

struct collected {
    uint64_t sites[16];
    uint32_t site_count, findings, repeats;
    char first[2048], rule[128];
};

static bool repeated(void *context, const struct gn_rule *rule, uint64_t site)
{
    struct collected *out = context;
    (void)rule;
    for (uint32_t i = 0; i < out->site_count; i++)
        if (out->sites[i] == site) {
            out->repeats++;
            return true;
        }
    out->sites[out->site_count++] = site;
    return false;
}

static void finding(void *context, uint64_t site, const struct gn_finding *found)
{
    struct collected *out = context;
    (void)site;
    if (!out->findings++) {
        snprintf(out->first, sizeof out->first, "%s", found->message);
        snprintf(out->rule, sizeof out->rule, "%s", found->rule->id);
    }
}

static struct gn_report report_into(struct collected *out)
{
    return (struct gn_report){.profile = GN_PROFILE_VULKAN,
                              .enabled = gn_rule_set_all(),
                              .context = out,
                              .repeated = repeated,
                              .finding = finding};
}

static void run_row(const struct row *row, struct gn_report *report)
{
    struct gn_structure structures[MAX_STRUCTURES];
    struct gn_instance_record records[MAX_INSTANCES] = {{{0}, 0, 0, 0}};
    char names[MAX_STRUCTURES][16];
    for (uint32_t i = 0; i < row->structure_count; i++) {
        snprintf(names[i], sizeof names[i], "tree %u", i);
        structures[i] = (struct gn_structure){
            .object = {GN_OBJECT_BLAS, 0x100 + i, names[i]}, .id = 10 + i, .address = 0x1000 * (i + 1), .built = row->built[i]};
    }
    struct gn_tlas_build build = {.tlas = {GN_OBJECT_TLAS, 7, "scene"},
                                  .tlas_id = 1,
                                  .place = "a test",
                                  .instance_count = row->instance_count,
                                  .instances = records,
                                  .refers_to = row->refers_to,
                                  .structure_count = row->structure_count,
                                  .structures = structures};
    gn_rules_judge_tlas_build(&build, report);
}

static void every_row(void **state)
{
    (void)state;
    int failures = 0;
    for (size_t i = 0; i < ROW_COUNT; i++) {
        struct collected out = {.findings = 0};
        struct gn_report report = report_into(&out);
        run_row(&rows[i], &report);
        bool counted = out.findings == rows[i].expected;
        bool said = !rows[i].says || strstr(out.first, rows[i].says);
        bool named = !out.findings || strcmp(out.rule, rows[i].rule) == 0;
        if (!counted || !said || !named) {
            print_error("%s, row \"%s\" (%s): expected %u findings saying \"%s\", found %u of %s: \"%s\"\n", rows[i].rule,
                        rows[i].name, rows[i].why, rows[i].expected, rows[i].says ? rows[i].says : "", out.findings, out.rule,
                        out.first);
            failures++;
        }
    }
    assert_int_equal(failures, 0);
}

static void every_rule_fires_and_stays_silent(void **state)
{
    (void)state;
    int failures = 0;
    assert_true(gn_rules_count() > 0);
    for (size_t r = 0; r < gn_rules_count(); r++) {
        int firing = 0, silent = 0;
        for (size_t i = 0; i < ROW_COUNT; i++)
            if (strcmp(rows[i].rule, gn_rules_at(r)->id) == 0)
                rows[i].expected ? firing++ : silent++;
        if (!firing || !silent) {
            print_error("%s has %d firing and %d silent rows; it needs both\n", gn_rules_at(r)->id, firing, silent);
            failures++;
        }
    }
    for (size_t i = 0; i < ROW_COUNT; i++)
        if (!gn_rules_find(rows[i].rule)) {
            print_error("row \"%s\" names the unknown rule %s\n", rows[i].name, rows[i].rule);
            failures++;
        }
    assert_int_equal(failures, 0);
}

static bool is_id(const char *id)
{
    bool dotted = false;
    for (const char *c = id; *c; c++) {
        dotted |= *c == '.';
        if (!((*c >= 'a' && *c <= 'z') || (*c >= '0' && *c <= '9') || *c == '_' || *c == '.'))
            return false;
    }
    return dotted;
}

static void every_block_is_complete(void **state)
{
    (void)state;
    for (size_t r = 0; r < gn_rules_count(); r++) {
        const struct gn_rule *rule = gn_rules_at(r);
        bool anywhere = false;
        assert_true(is_id(rule->id));
        assert_ptr_equal(gn_rules_find(rule->id), rule);
        assert_true(rule->title[0] && rule->text[0] && rule->remedy[0]);
        assert_non_null(rule->sources[0]);
        for (int s = 0; rule->sources[s]; s++)
            assert_true(strncmp(rule->sources[s], "VUID-", 5) == 0 ||
                        (strlen(rule->sources[s]) == 6 && rule->sources[s][2] == '-'));
        for (int p = 0; p < GN_PROFILE_COUNT; p++) {
            assert_in_range(rule->severity[p], GN_SEVERITY_SILENT, GN_SEVERITY_ERROR);
            anywhere |= rule->severity[p] != GN_SEVERITY_SILENT;
        }
        assert_true(anywhere);
        assert_non_null(rule->test.tlas_build);
        for (size_t other = 0; other < r; other++)
            assert_string_not_equal(gn_rules_at(other)->id, rule->id);
    }
}

static void disabled_rules_do_not_run(void **state)
{
    (void)state;
    struct collected out = {.findings = 0};
    struct gn_report report = report_into(&out);
    report.enabled = (struct gn_rule_set){{0}};
    run_row(&rows[0], &report);
    assert_int_equal(out.findings, 0);
    assert_false(gn_rule_set_has(&report.evaluated, 0));

    report.enabled = gn_rule_set_all();
    run_row(&rows[0], &report);
    assert_int_equal(out.findings, 1);
    assert_true(gn_rule_set_has(&report.evaluated, 0));
}

static void repeats_are_counted_not_told(void **state)
{
    (void)state;
    struct collected out = {.findings = 0};
    struct gn_report report = report_into(&out);
    for (int i = 0; i < 5; i++)
        run_row(&rows[0], &report);
    assert_int_equal(out.findings, 1);
    assert_int_equal(out.repeats, 4);
}

static void patterns_select_by_id(void **state)
{
    static const struct {
        const char *pattern;
        bool matches;
    } table[] = {{"build.order.blas_never_built", true},
                 {"*", true},
                 {"build.*", true},
                 {"*never_built", true},
                 {"*.order.*", true},
                 {"*b*b*b*", true},
                 {"build", false},
                 {"", false},
                 {"build.order.blas_never_built.", false},
                 {"*.instances.*", false}};
    (void)state;
    const struct gn_rule *rule = gn_rules_find("build.order.blas_never_built");
    assert_non_null(rule);
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++)
        if (gn_rule_matches(rule, table[i].pattern) != table[i].matches)
            fail_msg("\"%s\" should %smatch %s", table[i].pattern, table[i].matches ? "" : "not ", rule->id);
}

static void names_go_both_ways(void **state)
{
    (void)state;
    for (int p = 0; p < GN_PROFILE_COUNT; p++) {
        enum gn_profile back = GN_PROFILE_COUNT;
        assert_true(gn_profile_parse(gn_profile_name((enum gn_profile)p), &back));
        assert_int_equal(back, p);
    }
    for (int s = GN_SEVERITY_NOTE; s < GN_SEVERITY_COUNT; s++) {
        enum gn_severity back = GN_SEVERITY_COUNT;
        assert_true(gn_severity_parse(gn_severity_name((enum gn_severity)s), &back));
        assert_int_equal(back, s);
    }
    enum gn_profile profile = GN_PROFILE_HGI;
    assert_false(gn_profile_parse("Vulkan", &profile));
    assert_int_equal(profile, GN_PROFILE_HGI);
    enum gn_severity severity = GN_SEVERITY_NOTE;
    assert_false(gn_severity_parse("silent", &severity));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_row),
        cmocka_unit_test(every_rule_fires_and_stays_silent),
        cmocka_unit_test(every_block_is_complete),
        cmocka_unit_test(disabled_rules_do_not_run),
        cmocka_unit_test(repeats_are_counted_not_told),
        cmocka_unit_test(patterns_select_by_id),
        cmocka_unit_test(names_go_both_ways),
    };
    return cmocka_run_group_tests_name("rules", tests, NULL, NULL);
}
