/* SPDX-License-Identifier: Apache-2.0 */
/* What the gate makes of measurements and of changes. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cts/gate.h"
#include "cts/random.h"

/* Rounds of two drivers on a noisy machine: now and then something takes twice as long. */
static void noisy_rounds(struct gn_gate_time *time, double factor, uint32_t rounds, uint64_t seed)
{
    struct gn_random random = {seed};
    for (uint32_t i = 0; i < rounds; i++) {
        double noise[2];
        for (int k = 0; k < 2; k++) {
            noise[k] = 1 + 0.1 * gn_random_unit(&random);
            if (gn_random_unit(&random) < 0.15)
                noise[k] *= 2;
        }
        time->now[i] = 0.01 * factor * noise[0];
        time->before[i] = 0.01 * noise[1];
    }
    time->rounds = rounds;
}

static void times(void **state)
{
    static const struct gn_bench_item seconds = {"a", "", false};
    static const struct {
        double factor;
        uint32_t rounds;
        double most_exceed, least_exceed; /* of 1,000 repetitions */
    } rows[] = {
        {1.0, 9, 0, 0}, {1.0, 31, 0, 0}, {1.1, 9, 0, 0}, {1.1, 31, 0, 0}, {1.5, 31, 1000, 950}, {3.0, 9, 1000, 950},
    };
    (void)state;
    for (size_t row = 0; row < sizeof rows / sizeof rows[0]; row++) {
        int exceeds = 0;
        for (uint64_t seed = 1; seed <= 1000; seed++) {
            struct gn_gate_time time = {.item = &seconds, .missing = ""};
            noisy_rounds(&time, rows[row].factor, rows[row].rounds, seed);
            gn_gate_time_decide(&time, 1.3);
            exceeds += time.exceeds;
            assert_true(time.low <= time.ratio && time.ratio <= time.high);
            assert_false(time.exceeds && time.undecided);
        }
        if (exceeds > rows[row].most_exceed || exceeds < rows[row].least_exceed)
            fail_msg("factor %g, %u rounds: %d of 1000 exceed 1.3", rows[row].factor, rows[row].rounds, exceeds);
    }
}

/* The interval holds the median as often as it says: here the true median of the ratios is 1. */
static void coverage(void **state)
{
    static const struct gn_bench_item seconds = {"a", "", false};
    static const uint32_t rounds[] = {9, 15, 31};
    (void)state;
    for (size_t r = 0; r < 3; r++) {
        int outside = 0;
        for (uint64_t seed = 1; seed <= 4000; seed++) {
            struct gn_gate_time time = {.item = &seconds, .missing = ""};
            noisy_rounds(&time, 1, rounds[r], seed + 100000 * r);
            gn_gate_time_decide(&time, 1.3);
            outside += time.low > 1 || time.high < 1;
        }
        if (outside > 60) /* 1 % of 4,000 and three deviations */
            fail_msg("%u rounds: %d of 4000 intervals miss the median", rounds[r], outside);
    }
    struct gn_gate_time few = {.item = &seconds, .missing = ""};
    noisy_rounds(&few, 100, 5, 1);
    gn_gate_time_decide(&few, 1.3);
    assert_true(few.undecided && !few.exceeds); /* five rounds prove nothing at 99 % */
}

static void bytes(void **state)
{
    static const struct gn_bench_item size = {"a", "", true};
    static const struct {
        double now, before;
        bool exceeds;
    } rows[] = {{100, 100, false}, {130, 100, false}, {131, 100, true}, {50, 100, false}};
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_gate_time time = {.item = &size, .missing = "", .rounds = 1};
        time.now[0] = rows[i].now;
        time.before[0] = rows[i].before;
        gn_gate_time_decide(&time, 1.3);
        assert_int_equal(time.exceeds, rows[i].exceeds);
        assert_false(time.undecided);
    }
}

static void changes(void **state)
{
    static const struct {
        enum gn_case_status before; /* GN_CASE_STATUS_COUNT: not run */
        enum gn_case_status now;
        uint64_t before_answers, now_answers;
        const char *expected; /* what an expectation file says, or NULL */
        enum gn_gate_change change;
        bool counts;
    } rows[] = {
        {GN_CASE_PASS, GN_CASE_PASS, 1, 1, NULL, GN_GATE_SAME, false},
        {GN_CASE_PASS, GN_CASE_PASS, 1, 2, NULL, GN_GATE_ANSWERS, false},
        {GN_CASE_FAIL, GN_CASE_FAIL, 1, 2, NULL, GN_GATE_ANSWERS, false},
        {GN_CASE_FAIL, GN_CASE_PASS, 1, 2, NULL, GN_GATE_RIGHT, false},
        {GN_CASE_PASS, GN_CASE_FAIL, 1, 2, NULL, GN_GATE_WRONG, true},
        {GN_CASE_PASS, GN_CASE_LEAK, 1, 2, NULL, GN_GATE_WRONG, true},
        {GN_CASE_LEAK, GN_CASE_FAIL, 1, 2, NULL, GN_GATE_WRONG, true},
        {GN_CASE_FAIL, GN_CASE_CRASH, 1, 0, NULL, GN_GATE_WRONG, true},
        {GN_CASE_PASS, GN_CASE_SKIP, 1, 0, NULL, GN_GATE_WRONG, true}, /* what it does not do any more */
        {GN_CASE_SKIP, GN_CASE_PASS, 0, 1, NULL, GN_GATE_RIGHT, false},
        {GN_CASE_STATUS_COUNT, GN_CASE_PASS, 0, 1, NULL, GN_GATE_ADDED, false},
        {GN_CASE_STATUS_COUNT, GN_CASE_FAIL, 0, 1, NULL, GN_GATE_ADDED, true},
        {GN_CASE_PASS, GN_CASE_FAIL, 1, 2, "Fail", GN_GATE_WRONG, false}, /* known, whatever the old driver did */
        {GN_CASE_FAIL, GN_CASE_PASS, 1, 2, "Fail", GN_GATE_RIGHT, true},  /* the line has to go */
    };
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_results now, before;
        struct gn_gate gate = {.now = &now, .before = &before, .budget = 1.3, .expects = rows[i].expected != NULL};
        struct gn_expectation entry = {.name = "query.a.b", .status = rows[i].expected, .reason = "", .place = "f:1"};
        struct gn_expectations expectations = {.list = &entry, .count = rows[i].expected ? 1 : 0};
        struct gn_results_case cs = {
            .name = "query.a.b", .family = "a", .status = rows[i].now, .answers = rows[i].now_answers};
        char verdict[600];
        gn_results_init(&now);
        gn_results_init(&before);
        gn_expectations_apply(&expectations, &cs);
        gn_results_add(&now, &cs);
        cs.status = rows[i].before;
        cs.answers = rows[i].before_answers;
        if (cs.status != GN_CASE_STATUS_COUNT)
            gn_results_add(&before, &cs);
        gn_gate_compare(&gate, "/nowhere");
        if (gate.cases[0].change != rows[i].change || gn_gate_case_counts(&gate, 0) != rows[i].counts)
            fail_msg("row %zu: '%s', counts %d", i, gn_gate_change_name(gate.cases[0].change),
                     gn_gate_case_counts(&gate, 0));
        gn_gate_verdict(&gate, verdict, sizeof verdict);
        assert_int_equal(strncmp(verdict, "This may not land", 17) == 0, rows[i].counts);
        if (gn_gate_exit_status(&gate) != (rows[i].counts ? 1 : rows[i].now == GN_CASE_SKIP ? 4 : 0))
            fail_msg("row %zu: exit status %d", i, gn_gate_exit_status(&gate));
        gn_gate_finish(&gate);
        gn_results_finish(&now);
        gn_results_finish(&before);
    }
}

/* A case that only the old driver ran, a stale expectation and a run that was stopped are not nothing. */
static void not_nothing(void **state)
{
    (void)state;
    for (int what = 0; what < 3; what++) {
        struct gn_results now, before;
        struct gn_gate gate = {.now = &now, .before = &before, .budget = 1.3};
        struct gn_results_case cs = {.name = "query.a.b", .family = "a", .status = GN_CASE_PASS};
        gn_results_init(&now);
        gn_results_init(&before);
        gn_results_add(&now, &cs);
        gn_results_add(&before, &cs);
        cs.name = "query.a.c";
        if (what == 0)
            gn_results_add(&before, &cs);
        else if (what == 1)
            gn_results_add_stale(&now, "f:1: gone");
        else
            before.stopped = "interrupted";
        gn_gate_compare(&gate, "/nowhere");
        assert_int_equal(gn_gate_exit_status(&gate), what == 2 ? 3 : 1);
        gn_gate_finish(&gate);
        gn_results_finish(&now);
        gn_results_finish(&before);
    }
}

/* Measurements that there are not: that is said, and counts where the new driver fails at what the old one does. */
static void unmeasured(void **state)
{
    static const struct gn_bench_item item = {"a", "", false};
    (void)state;
    for (int broken = 0; broken < 2; broken++) {
        struct gn_results now, before;
        struct gn_gate gate = {.now = &now, .before = &before, .budget = 1.3};
        struct gn_results_case cs = {.name = "query.a.b", .family = "a", .status = GN_CASE_PASS};
        char verdict[600];
        gn_results_init(&now);
        gn_results_init(&before);
        gn_results_add(&now, &cs);
        gn_results_add(&before, &cs);
        gn_gate_compare(&gate, NULL);
        gate.times = calloc(1, sizeof *gate.times);
        assert_non_null(gate.times);
        gate.times[0] = (struct gn_gate_time){.item = &item, .missing = "why", .broken = broken};
        gate.time_count = 1;
        gn_gate_verdict(&gate, verdict, sizeof verdict);
        assert_string_equal(verdict, broken ? "This may not land: 1 measured operation fails newly."
                                            : "No change: all 1 cases answer bit for bit as before (1 operation not measured).");
        assert_int_equal(gn_gate_exit_status(&gate), broken);
        gn_gate_finish(&gate);
        gn_results_finish(&now);
        gn_results_finish(&before);
    }
}

/* What a driver calls itself stays one line, and is no markup. */
static void hostile_name(void **state)
{
    char folder[] = "/tmp/gnomon-gate-XXXXXX", path[64], error[512], *text = NULL;
    static const char *const files[] = {"gate.json", "gate.sarif", "gate.md", "gate.html"};
    struct gn_results now;
    struct gn_gate gate = {.now = &now, .budget = 1.3};
    struct gn_results_case cs = {.name = "query.a.b", .family = "a", .status = GN_CASE_PASS};
    size_t length = 0;
    (void)state;
    gn_results_init(&now);
    gn_results_add(&now, &cs);
    snprintf(now.run.device.name, sizeof now.run.device.name, "A`<b>\n| B |\r\x1b");
    gn_gate_compare(&gate, NULL);
    assert_non_null(mkdtemp(folder));
    assert_true(gn_gate_write(&gate, folder, error, sizeof error));
    snprintf(path, sizeof path, "%s/gate.md", folder);
    assert_true(gn_file_read(path, 100000, &text, &length, error, sizeof error));
    assert_non_null(strstr(text, "\n- New: `A'<b> | B |??, "));
    free(text);
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
        snprintf(path, sizeof path, "%s/%s", folder, files[i]);
        remove(path);
    }
    remove(folder);
    gn_gate_finish(&gate);
    gn_results_finish(&now);
}

/* The same distribution is no drift however many rays, another one is. */
static void drift(void **state)
{
    static const struct {
        uint64_t scale, shifted; /* of the hits, how many per 1,000 lie one bin higher on the new driver */
        bool drifted;
    } rows[] = {{1, 0, false}, {1000, 0, false}, {1000, 3, false}, {1, 300, true}, {1000, 300, true}};
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_results now, before;
        struct gn_gate gate = {.now = &now, .before = &before, .budget = 1.3};
        struct gn_results_case cs = {.name = "query.a.b", .family = "a", .status = GN_CASE_PASS, .answers = 1};
        gn_results_init(&now);
        gn_results_init(&before);
        cs.hit_error_bins[20] = 1000 * rows[i].scale;
        gn_results_add(&before, &cs);
        cs.hit_error_bins[20] -= rows[i].shifted * rows[i].scale;
        cs.hit_error_bins[21] = rows[i].shifted * rows[i].scale;
        gn_results_add(&now, &cs);
        gn_gate_compare(&gate, "/nowhere");
        assert_int_equal(gate.drift_count, 1);
        if (gate.drifts[0].drifted != rows[i].drifted ||
            fabs(gate.drifts[0].distance - (double)rows[i].shifted / 1000) > 1e-9)
            fail_msg("row %zu: distance %g, p %g", i, gate.drifts[0].distance, gate.drifts[0].p);
        gn_gate_finish(&gate);
        gn_results_finish(&now);
        gn_results_finish(&before);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(times),   cmocka_unit_test(coverage),    cmocka_unit_test(bytes),
        cmocka_unit_test(changes), cmocka_unit_test(not_nothing), cmocka_unit_test(drift),
        cmocka_unit_test(unmeasured), cmocka_unit_test(hostile_name),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
