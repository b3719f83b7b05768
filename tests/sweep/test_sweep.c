/* SPDX-License-Identifier: Apache-2.0 */
/* Sweeps: what each of them makes, what an honest f32 implementation answers, how status and curve come about. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cts/report_html_curves.h"
#include "cts/results.h"
#include "tests/sweep/honest.h"

extern const struct gn_case_family gn_family_stability;

static const struct gn_sweep *sweep_of(const struct gn_case *self)
{
    return self->run == gn_sweep_run ? self->params : NULL;
}

static void test_values(void **state)
{
    (void)state;
    assert_true(gn_family_stability.case_count >= 25);
    for (size_t i = 0; i < gn_family_stability.case_count; i++) {
        const struct gn_case *self = &gn_family_stability.cases[i];
        const struct gn_sweep *sweep = sweep_of(self);
        assert_non_null(sweep);
        assert_true(sweep->parameter[0] && sweep->why[0] && sweep->value_count >= 5 && sweep->value_count <= 16);
        bool grows = sweep->values[1] > sweep->values[0], last = false;
        for (uint32_t v = 0; v < sweep->value_count; v++) {
            last = last || sweep->values[v] == sweep->judged_to;
            if (!(sweep->values[v] > 0) ||
                (v && (grows ? sweep->values[v] <= sweep->values[v - 1] : sweep->values[v] >= sweep->values[v - 1])))
                fail_msg("%s: value %u, %g, is not positive or out of order", self->name, v, sweep->values[v]);
        }
        if (!last)
            fail_msg("%s: it is judged to %g, which is none of its values", self->name, sweep->judged_to);
    }
}

/* The same request gives the same rays, a different seed others, and all of them are valid. */
static void test_rays(void **state)
{
    (void)state;
    for (size_t i = 0; i < gn_family_stability.case_count; i++) {
        const char *name = gn_family_stability.cases[i].name;
        const struct gn_sweep *sweep = sweep_of(&gn_family_stability.cases[i]);
        for (uint32_t v = 0; v < sweep->value_count; v++) {
            struct gn_arena arena = {0};
            struct gn_sweep_scene first, again, other;
            gn_sweep_make(sweep, v, 1, 50, &arena, &first);
            gn_sweep_make(sweep, v, 1, 50, &arena, &again);
            gn_sweep_make(sweep, v, 2, 50, &arena, &other);
            assert_int_equal(first.ray_count, again.ray_count);
            assert_memory_equal(first.rays, again.rays, first.ray_count * sizeof *first.rays);
            if (memcmp(first.rays, other.rays, first.ray_count * sizeof *first.rays) == 0)
                fail_msg("%s at %g: the seed makes no difference", name, sweep->values[v]);
            for (uint32_t r = 0; r < first.ray_count; r++) {
                const struct gn_ref_ray *ray = &first.rays[r].ray;
                bool moves = false, finite = true;
                for (int k = 0; k < 3; k++) {
                    moves = moves || ray->direction[k] != 0;
                    finite = finite && isfinite(ray->direction[k]) && isfinite(ray->origin[k]);
                }
                if (!moves || !finite || !(ray->tmin >= 0 && ray->tmin <= ray->tmax))
                    fail_msg("%s at %g: ray %u is not valid: origin %g %g %g, direction %g %g %g, from %g to %g", name,
                             sweep->values[v], r, (double)ray->origin[0], (double)ray->origin[1],
                             (double)ray->origin[2], (double)ray->direction[0], (double)ray->direction[1],
                             (double)ray->direction[2], (double)ray->tmin, (double)ray->tmax);
            }
            gn_arena_finish(&arena);
        }
    }
}

/* The judged ranges are what the derivation promises: a plain f32 implementation manages them. */
static void test_honest(void **state)
{
    size_t failed = 0;
    (void)state;
    for (size_t i = 0; i < gn_family_stability.case_count; i++) {
        const struct gn_case *self = &gn_family_stability.cases[i];
        struct gn_case_run run;
        for (uint64_t seed = 1; seed <= 2; seed++) {
            gn_case_run_begin(self, NULL, seed, 0.2, &run);
            gn_sweep_trace(&run, self->params, honest_tracer, NULL);
            gn_case_run_end(&run);
            const struct gn_case_point *left = gn_case_curve_left(&run.result.curve);
            if (left && !left->judged)
                print_message("%s: an honest f32 implementation leaves the bound at %g, beyond %g\n", self->name,
                              left->value, sweep_of(self)->judged_to);
            if (run.result.status != GN_CASE_PASS) {
                print_error("%s: %s\n", self->name, run.result.message);
                failed++;
            }
            gn_case_run_finish(&run);
        }
    }
    assert_int_equal(failed, 0);
}

/*
 * The tiers in the driver's place, on the same rays: certified and exact never leave the bound, not even where nothing
 * is judged; fast and robust do where they are known to.
 */
static void test_tiers(void **state)
{
    uint64_t rays[GN_REF_TIER_COUNT] = {0};
    uint32_t sweeps_left[GN_REF_TIER_COUNT] = {0};
    (void)state;
    for (size_t i = 0; i < gn_family_stability.case_count; i++) {
        const struct gn_case *self = &gn_family_stability.cases[i];
        struct gn_case_run run;
        gn_case_run_begin(self, NULL, 1, 0.1, &run);
        run.with_tiers = true;
        gn_sweep_trace(&run, self->params, honest_tracer, NULL);
        gn_case_run_end(&run);
        for (int tier = 0; tier < GN_REF_TIER_COUNT; tier++) {
            const struct gn_case_point *left = gn_case_curve_tier_left(&run.result.curve, (enum gn_ref_tier)tier);
            if (left && tier >= GN_REF_TIER_CERTIFIED)
                fail_msg("%s: tier %s leaves the bound at %g", self->name, gn_ref_tier_name((enum gn_ref_tier)tier),
                         left->value);
            sweeps_left[tier] += left != NULL;
            for (uint32_t p = 0; p < run.result.curve.count; p++) {
                const struct gn_case_point *point = &run.result.curve.points[p];
                rays[tier] += point->tiers[tier].rays;
                assert_true(point->tiers[tier].rays > 0 && point->tiers[tier].rays <= point->rays);
            }
        }
        gn_case_run_finish(&run);
    }
    for (int tier = 0; tier < GN_REF_TIER_COUNT; tier++)
        print_message("%s: %llu rays, leaves the bound in %u of %zu sweeps\n", gn_ref_tier_name((enum gn_ref_tier)tier),
                      (unsigned long long)rays[tier], sweeps_left[tier], gn_family_stability.case_count);
    assert_true(sweeps_left[GN_REF_TIER_FAST] > 5 && sweeps_left[GN_REF_TIER_ROBUST] > 2);
}

static const struct gn_case *case_named(const char *name)
{
    for (size_t i = 0; i < gn_family_stability.case_count; i++)
        if (strcmp(gn_family_stability.cases[i].name, name) == 0)
            return &gn_family_stability.cases[i];
    fail_msg("no case %s", name);
    return NULL;
}

/* Each of these faults has to be met by the sweep that is about it, in its judged range. */
static void test_faults(void **state)
{
    static const struct {
        const char *name;
        struct honest_faults faults;
        const char *why;
    } rows[] = {
        {"stability.scale.small", {.det_epsilon = 1e-8f}, "small triangles have small determinants"},
        {"stability.scale.mixed", {.det_epsilon = 1e-8f}, "so have the small ones among large ones"},
        {"stability.sliver.level", {.det_epsilon = 1e-8f}, "and thin ones"},
        {"stability.needle.level", {.det_epsilon = 1e-8f}, "and needles"},
        {"stability.grazing.level", {.det_epsilon = 1e-8f}, "and those that are grazed"},
        {"stability.direction.long", {.t_epsilon = 1e-4f}, "a long direction makes every t small"},
        {"stability.direction.huge_component", {.t_epsilon = 1e-4f}, "also where one component is long"},
        {"stability.range.near", {.t_epsilon = 1e-4f}, "a hit behind tmin by more than rounding is one"},
        {"stability.instance.mirrored", {.world_facing = true}, "facing is that of object space"},
        {"stability.box.face", {.no_zeros = true}, "1 / -0 is the other infinity"},
        {"stability.count.instances", {.most_instances = 128}, "there are more"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        const struct gn_case *self = case_named(rows[i].name);
        struct gn_case_run run;
        struct honest_faults faults = rows[i].faults;
        gn_case_run_begin(self, NULL, 1, 0.2, &run);
        gn_sweep_trace(&run, self->params, honest_tracer, &faults);
        gn_case_run_end(&run);
        if (run.result.status != GN_CASE_FAIL)
            fail_msg("%s passes an implementation that is wrong: %s", self->name, rows[i].why);
        gn_case_run_finish(&run);
    }
}

/* Answers rightly but for the values from `at` on, where every hit is lost. */
static void tracer_losing(struct gn_case_run *run, const struct gn_sweep_scene *scene, void *user)
{
    struct gn_sweep_scene changed = *scene;
    if (run->point->value < *(const double *)user) {
        honest_tracer(run, scene, NULL);
        return;
    }
    struct gn_arena arena = {0};
    struct gn_cts_answers answers = {.committed = GN_NEW(&arena, struct gn_ref_answer, scene->ray_count)};
    gn_case_judge(run, &changed.scene, changed.program, changed.rays, changed.ray_count, 0, &answers);
    gn_arena_finish(&arena);
}

static void run_losing(const struct gn_case *self, double at, struct gn_case_run *run)
{
    gn_case_run_begin(self, NULL, 1, 0.04, run);
    gn_sweep_trace(run, self->params, tracer_losing, &at);
    gn_case_run_end(run);
}

static void test_status(void **state)
{
    static const struct {
        double lost_from;
        enum gn_case_status status;
        const char *message, *why;
    } rows[] = {
        {INFINITY, GN_CASE_PASS, "", "all answers are right"},
        {0x1p70, GN_CASE_PASS, "", "the first value beyond the judged range only informs"},
        {0x1p60, GN_CASE_FAIL, "(length of the direction 1.15292e+18)", "the last value of it decides"},
        {1, GN_CASE_FAIL, "(length of the direction 1)", "and so does the first"},
    };
    const struct gn_case *self = case_named("stability.direction.long");
    const struct gn_sweep *sweep = sweep_of(self);
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_case_run run;
        run_losing(self, rows[i].lost_from, &run);
        const struct gn_case_curve *curve = &run.result.curve;
        const struct gn_case_point *left = gn_case_curve_left(curve);
        uint64_t judged = 0, wrong = 0;
        if (run.result.status != rows[i].status || !strstr(run.result.message, rows[i].message))
            fail_msg("%s: expected %s with '%s', found %s: %s", rows[i].why, gn_case_status_name(rows[i].status),
                     rows[i].message, gn_case_status_name(run.result.status), run.result.message);
        assert_int_equal(curve->count, sweep->value_count);
        assert_int_equal(left != NULL, rows[i].lost_from < INFINITY);
        if (left)
            assert_true(left->value == rows[i].lost_from);
        for (uint32_t p = 0; p < curve->count; p++) {
            assert_true(curve->points[p].judged == (curve->points[p].value <= sweep->judged_to));
            assert_int_equal(curve->points[p].rays, 50);
            judged += curve->points[p].judged ? curve->points[p].rays : 0;
            wrong += curve->points[p].judged ? curve->points[p].class_counts[GN_REF_WRONG] : 0;
        }
        /* The sums of the case are those of what is judged. */
        assert_int_equal(run.result.rays, judged);
        assert_int_equal(run.result.class_counts[GN_REF_WRONG], wrong);
        gn_case_run_finish(&run);
    }
}

static void test_json(void **state)
{
    struct gn_case_run run;
    struct gn_arena arena = {0};
    struct gn_results_case cs = {.name = "query.stability.direction.long"}, back;
    char error[256];
    size_t length;
    (void)state;
    run_losing(case_named("stability.direction.long"), 0x1p70, &run);
    cs.curve = run.result.curve;
    cs.curve.points[0].held_error_max = INFINITY;
    for (uint32_t p = 0; p < cs.curve.count; p++)
        for (int tier = 0; tier < GN_REF_TIER_COUNT; tier++)
            cs.curve.points[p].tiers[tier] = (struct gn_case_tier){
                .rays = 10 + p, .class_counts = {5, 4, 0, tier == 1 && p > 2}, .held_error_max = tier + 0.5, .margin_max = p};
    char *text = gn_results_case_encode(&cs, &length);
    assert_non_null(text);
    assert_non_null(strstr(text, "\"left_at\":1.1805916207174113e21"));
    assert_non_null(strstr(text, "\"tiers_left_at\":{\"fast\":null,\"robust\":1073741824.0,\"double\":null,"));
    if (!gn_results_case_decode(text, length, &arena, &back, error, sizeof error))
        fail_msg("%s", error);
    assert_string_equal(back.curve.parameter, cs.curve.parameter);
    assert_string_equal(back.curve.why, cs.curve.why);
    assert_int_equal(back.curve.count, cs.curve.count);
    for (uint32_t p = 0; p < back.curve.count; p++) {
        const struct gn_case_point *a = &cs.curve.points[p], *b = &back.curve.points[p];
        assert_true(a->value == b->value && a->judged == b->judged && a->rays == b->rays);
        assert_memory_equal(a->class_counts, b->class_counts, sizeof a->class_counts);
        assert_true(a->hit_error_median == b->hit_error_median && a->hit_error_p999 == b->hit_error_p999 &&
                    a->hit_error_max == b->hit_error_max && a->held_error_max == b->held_error_max &&
                    a->margin_max == b->margin_max && a->ideal_hits == b->ideal_hits);
        for (int tier = 0; tier < GN_REF_TIER_COUNT; tier++) {
            const struct gn_case_tier *given = &a->tiers[tier], *read = &b->tiers[tier];
            assert_int_equal(read->rays, given->rays);
            assert_memory_equal(read->class_counts, given->class_counts, sizeof given->class_counts);
            assert_true(read->held_error_max == given->held_error_max && read->margin_max == given->margin_max);
        }
    }
    free(text);
    /* What is no curve does no harm. */
    static const char *const odd[] = {"{\"name\":\"a\",\"status\":\"pass\",\"curve\":5}",
                                      "{\"name\":\"a\",\"status\":\"pass\",\"curve\":[]}",
                                      "{\"name\":\"a\",\"status\":\"pass\",\"curve\":[1,null,{}],\"sweep\":[]}",
                                      "{\"name\":\"a\",\"status\":\"pass\",\"curve\":[{\"value\":\"nan\",\"rays\":-3}]}"};
    for (size_t i = 0; i < sizeof odd / sizeof odd[0]; i++) {
        char *page = NULL;
        assert_true(gn_results_case_decode(odd[i], strlen(odd[i]), &arena, &back, error, sizeof error));
        FILE *file = open_memstream(&page, &length);
        gn_html_curve(file, &back.curve);
        fclose(file);
        assert_null(strstr(page, "=nan"));
        assert_null(strstr(page, "\"nan"));
        free(page);
    }
    gn_arena_finish(&arena);
    gn_case_run_finish(&run);
}

static void test_html(void **state)
{
    static const struct {
        double lost_from;
        const char *words;
    } rows[] = {{INFINITY, "no answer leaves the bound up to 2^120."},
                {0x1p70, "answers leave the bound first at 2^70</b>, "},
                {0x1p70, " of 50 rays wrong, beyond what is judged."},
                {0x1p60, "answers leave the bound first at 2^60</b>, "},
                {0x1p60, " of 50 rays wrong.<br>"}};
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_case_run run;
        char *page = NULL;
        size_t length;
        run_losing(case_named("stability.direction.long"), rows[i].lost_from, &run);
        run.result.curve.why = "<script>";
        FILE *file = open_memstream(&page, &length);
        gn_html_curve(file, &run.result.curve);
        fclose(file);
        assert_non_null(strstr(page, "<svg"));
        assert_non_null(strstr(page, "&lt;script&gt;"));
        assert_null(strstr(page, "<script>"));
        if (!strstr(page, rows[i].words))
            fail_msg("expected '%s' in %s", rows[i].words, strstr(page, "<figcaption"));
        free(page);
        gn_case_run_finish(&run);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_values), cmocka_unit_test(test_rays),
                                       cmocka_unit_test(test_status), cmocka_unit_test(test_json),
                                       cmocka_unit_test(test_html),   cmocka_unit_test(test_tiers),
                                       cmocka_unit_test(test_honest),
                                       cmocka_unit_test(test_faults)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
