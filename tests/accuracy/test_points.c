/* SPDX-License-Identifier: Apache-2.0 */
/* What is made of measured rows: sums, the choice for a budget, the front. The rows are made up. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <yyjson.h>

#include "cts/accuracy.h"

static struct gn_accuracy_point point(enum gn_ref_tier tier, double time, double wrong, double t_error)
{
    return (struct gn_accuracy_point){.tier = tier,
                                      .time = time,
                                      .wrong_per_million = wrong,
                                      .t_error_max = t_error,
                                      .rays = 1000000,
                                      .wrong = (uint64_t)wrong};
}

static void the_choice_is_the_most_accurate_within_the_budget(void **state)
{
    (void)state;
    const double up = nextafter(1.2, 2);
    const struct {
        const char *what;
        struct gn_accuracy_point points[4];
        size_t count;
        double budget;
        int expected;
    } rows[] = {
        {"exactly the budget is within it",
         {point(GN_REF_TIER_ROBUST, 1, 30, 5), point(GN_REF_TIER_CERTIFIED, 1.2, 0, 0)},
         2,
         1.2,
         1},
        {"just above is not",
         {point(GN_REF_TIER_ROBUST, 1, 30, 5), point(GN_REF_TIER_CERTIFIED, up, 0, 0)},
         2,
         1.2,
         0},
        {"fewer wrong decisions win over a smaller error of t",
         {point(GN_REF_TIER_ROBUST, 1, 30, 0.5), point(GN_REF_TIER_DOUBLE, 1.1, 29, 7)},
         2,
         1.2,
         1},
        {"and not being fast",
         {point(GN_REF_TIER_FAST, 0.5, 31, 1), point(GN_REF_TIER_ROBUST, 1, 30, 1)},
         2,
         1.2,
         1},
        {"of equally many wrong ones the smaller error of t",
         {point(GN_REF_TIER_FAST, 1, 7, 4), point(GN_REF_TIER_ROBUST, 1, 7, 5)},
         2,
         1.2,
         0},
        {"of equal ones the tier that promises more",
         {point(GN_REF_TIER_DOUBLE, 0.9, 0, 0), point(GN_REF_TIER_CERTIFIED, 1.1, 0, 0)},
         2,
         1.2,
         1},
        {"what the judge cannot tell apart is equal",
         {point(GN_REF_TIER_DOUBLE, 0.9, 0, 1e-9), point(GN_REF_TIER_CERTIFIED, 1.1, 0, 1e-5)},
         2,
         1.2,
         1},
        {"what it can is not",
         {point(GN_REF_TIER_DOUBLE, 0.9, 0, 1e-9), point(GN_REF_TIER_CERTIFIED, 1.1, 0, 1e-3)},
         2,
         1.2,
         0},
        {"a budget below every tier has none", {point(GN_REF_TIER_ROBUST, 1, 30, 5)}, 1, 0.99, -1},
        {"without points there is none", {{0}}, 0, 1.2, -1},
        {"a tier that hit nothing is as good as its decisions",
         {point(GN_REF_TIER_ROBUST, 1, 5, 1), point(GN_REF_TIER_DOUBLE, 1, 0, (double)NAN)},
         2,
         1.2,
         1},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        int choice = gn_accuracy_choose(rows[i].points, rows[i].count, rows[i].budget);
        if (choice != rows[i].expected)
            fail_msg("%s: expected %d, found %d", rows[i].what, rows[i].expected, choice);
    }
}

static void a_choice_with_more_gross_decisions_is_told(void **state)
{
    (void)state;
    struct gn_accuracy_point points[] = {point(GN_REF_TIER_FAST, 0.9, 10, 1),
                                         point(GN_REF_TIER_ROBUST, 1, 20, 1),
                                         point(GN_REF_TIER_CERTIFIED, 3, 0, 0)};
    points[0].gross = 8;
    points[1].gross = 7;
    assert_int_equal(gn_accuracy_choose_gross(points, 3, 1.2, 0), 1);
    points[1].gross = 8;
    assert_int_equal(gn_accuracy_choose_gross(points, 3, 1.2, 0), -1);
    assert_int_equal(gn_accuracy_choose_gross(points, 3, 3, 0), 2);
    assert_int_equal(gn_accuracy_choose_gross(points, 3, 0.1, -1), -1);
}

static void the_front_is_what_no_other_beats(void **state)
{
    (void)state;
    /* fast, robust (slower and no better), double, one as accurate as double but slower, exact, one without a
     * value */
    const double times[] = {0.9, 1, 1.5, 1.6, 300, 1}, values[] = {50, 50, 3, 3, 0, (double)NAN};
    const bool expected[] = {true, false, true, false, true, false};
    bool found[6];
    gn_accuracy_front(times, values, 6, found);
    for (int i = 0; i < 6; i++)
        if (found[i] != expected[i])
            fail_msg("point %d: expected %d, found %d", i, expected[i], found[i]);
    /* Two of the same stay both: neither beats the other. */
    gn_accuracy_front((double[]){1, 1}, (double[]){2, 2}, 2, found);
    assert_true(found[0] && found[1]);
}

static void budgets_are_read(void **state)
{
    (void)state;
    const struct {
        const char *text;
        double expected; /* 0: refused */
    } rows[] = {{"1.2x", 1.2}, {"1.2", 1.2}, {"2X", 2}, {".5x", 0.5}, {"1e3", 1000}, {"", 0},
                {"x", 0},      {"1.2xx", 0}, {"-1", 0}, {"0", 0},     {"nan", 0},    {"inf", 0},
                {"1e7", 0},    {" 1", 0},    {"+1", 0}, {"1.2 x", 0}, {"1e999", 0}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        double found = 0;
        bool ok = gn_accuracy_budget_parse(rows[i].text, &found);
        if (ok != (rows[i].expected > 0) || (ok && found != rows[i].expected))
            fail_msg("'%s': expected %g, found %g", rows[i].text, rows[i].expected, ok ? found : 0);
    }
}

/* Two scenes, one kind of rays, every tier; `double` is measured twice as slow and half as slow as robust. */
static struct gn_accuracy made_up(struct gn_accuracy_row rows[10], struct gn_accuracy_scene scenes[2])
{
    scenes[0] = (struct gn_accuracy_scene){.name = "one"};
    scenes[1] = (struct gn_accuracy_scene){.name = "two \"quoted\""};
    for (uint32_t i = 0; i < 10; i++) {
        rows[i] = (struct gn_accuracy_row){.scene = i / 5,
                                           .aim = GN_AIM_VERTEX,
                                           .mode = GN_ACCURACY_BATCH,
                                           .tier = (enum gn_ref_tier)(i % 5),
                                           .mrays_per_s = 1,
                                           .ratio_to_robust = 1,
                                           .rays = 1000,
                                           .hits = 10,
                                           .t_error_median = 0.25,
                                           .t_error_max = i + 1};
    }
    rows[2].ratio_to_robust = 0.5;
    rows[7].ratio_to_robust = 2;
    rows[0].lost = 3;
    rows[0].invented = 2;
    rows[5].other = 2;
    rows[5].neighbour = 3;
    rows[9].hits = 0;
    rows[9].t_error_median = rows[9].t_error_max = (double)NAN;
    struct gn_accuracy accuracy = {.scenes = scenes, .scene_count = 2, .rows = rows, .row_count = 10};
    accuracy.options.budget = 1.2;
    accuracy.machine = accuracy.started = "<none>";
    return accuracy;
}

static void points_sum_up_rows(void **state)
{
    (void)state;
    struct gn_accuracy_row rows[10];
    struct gn_accuracy_scene scenes[2];
    struct gn_accuracy accuracy = made_up(rows, scenes);
    struct gn_accuracy_point points[GN_REF_TIER_COUNT];
    gn_accuracy_points(&accuracy, GN_ACCURACY_ALL_SCENES, GN_ACCURACY_BATCH, points);
    assert_int_equal(points[0].rays, 2000);
    assert_int_equal(points[0].wrong, 10);
    assert_int_equal(points[0].gross, 7);
    assert_double_equal(points[0].wrong_per_million, 5000, 1e-9);
    assert_double_equal(points[2].time, 1, 1e-12);
    assert_double_equal(points[0].t_error_max, 6, 0);
    assert_double_equal(points[4].t_error_max, 5, 0);
    gn_accuracy_points(&accuracy, 0, GN_ACCURACY_BATCH, points);
    assert_int_equal(points[0].wrong, 5);
    assert_double_equal(points[2].time, 2, 1e-12);
    gn_accuracy_points(&accuracy, 1, GN_ACCURACY_BATCH, points);
    assert_true(isnan(points[4].t_error_max));
    gn_accuracy_points(&accuracy, 0, GN_ACCURACY_SINGLE, points);
    assert_int_equal(points[0].rays, 0);
}

static void none_of_n_is_about_three_in_n(void **state)
{
    (void)state;
    assert_double_equal(gn_accuracy_unseen_per_million(1000000), 2.9957, 1e-3);
    assert_double_equal(gn_accuracy_unseen_per_million(0), 1e6, 0);
}

static void json_has_what_was_measured(void **state)
{
    (void)state;
    struct gn_accuracy_row rows[10];
    struct gn_accuracy_scene scenes[2];
    struct gn_accuracy accuracy = made_up(rows, scenes);
    size_t length = 0;
    char *text = gn_accuracy_json(&accuracy, &length);
    assert_non_null(text);
    yyjson_doc *doc = yyjson_read(text, length, 0);
    assert_non_null(doc);
    yyjson_val *list = yyjson_doc_get_root(doc), *last = yyjson_arr_get(list, 9);
    assert_int_equal(yyjson_arr_size(list), 10);
    assert_string_equal(yyjson_get_str(yyjson_obj_get(last, "scene")), "two \"quoted\"");
    assert_string_equal(yyjson_get_str(yyjson_obj_get(last, "rays")), "vertex");
    assert_string_equal(yyjson_get_str(yyjson_obj_get(last, "mode")), "batch");
    assert_string_equal(yyjson_get_str(yyjson_obj_get(last, "tier")), "exact");
    assert_true(yyjson_is_null(yyjson_obj_get(last, "t_error_ulp_max")));
    assert_double_equal(yyjson_get_num(yyjson_obj_get(yyjson_arr_get(list, 0), "wrong_per_million")), 5000,
                        1e-9);
    yyjson_doc_free(doc);
    free(text);
}

/* What was not measured, hit nothing or is 0 throughout is to be drawn all the same. */
static void plots_are_numbers_throughout(void **state)
{
    (void)state;
    struct gn_accuracy_row rows[10];
    struct gn_accuracy_scene scenes[2];
    struct gn_accuracy accuracy = made_up(rows, scenes);
    for (int variant = 0; variant < 3; variant++) {
        for (int i = 0; variant == 1 && i < 10; i++) {
            rows[i].lost = rows[i].invented = rows[i].neighbour = rows[i].other = rows[i].hits = 0;
            rows[i].t_error_median = rows[i].t_error_max = (double)NAN;
        }
        accuracy.row_count = variant == 2 ? 0 : 10;
        char *text = NULL;
        size_t length = 0;
        FILE *file = open_memstream(&text, &length);
        assert_non_null(file);
        gn_accuracy_plot(file, &accuracy, GN_ACCURACY_ALL_SCENES, true);
        fclose(file);
        if (strstr(text, "nan") || strstr(text, "inf\"") || strstr(text, "<none>"))
            fail_msg("variant %d: nan, inf or an unescaped string in %s", variant, text);
        free(text);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_choice_is_the_most_accurate_within_the_budget),
        cmocka_unit_test(a_choice_with_more_gross_decisions_is_told),
        cmocka_unit_test(the_front_is_what_no_other_beats),
        cmocka_unit_test(budgets_are_read),
        cmocka_unit_test(points_sum_up_rows),
        cmocka_unit_test(none_of_n_is_about_three_in_n),
        cmocka_unit_test(json_has_what_was_measured),
        cmocka_unit_test(plots_are_numbers_throughout),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
