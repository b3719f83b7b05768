/* SPDX-License-Identifier: Apache-2.0 */
/* The gate's decision, and what it prints: the answer first. */
#include "cts/gate.h"

#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cts/describe.h"
#include "cts/progress.h"

#define MOST_SHOWN 20
#define MOST_RIGHT_SHOWN 10

const char *gn_gate_change_name(enum gn_gate_change change)
{
    static const char *const names[GN_GATE_CHANGE_COUNT] = {
        [GN_GATE_SAME] = "same",           [GN_GATE_ANSWERS] = "other answers",
        [GN_GATE_VARIES] = "varying answers", [GN_GATE_RIGHT] = "newly right",
        [GN_GATE_WRONG] = "newly wrong", [GN_GATE_ADDED] = "added",
    };
    return names[change];
}

bool gn_gate_case_counts(const struct gn_gate *gate, size_t index)
{
    const struct gn_gate_case *pair = &gate->cases[index];
    enum gn_results_outcome outcome = pair->now->outcome;
    if (outcome == GN_OUTCOME_EXPECTED_FAILURE)
        return false;
    if (gate->before && (pair->change == GN_GATE_WRONG ||
                         (pair->change == GN_GATE_ADDED && gn_case_status_is_failure(pair->now->status))))
        return true;
    return (gate->expects || !gate->before) &&
           (outcome == GN_OUTCOME_UNEXPECTED || outcome == GN_OUTCOME_UNEXPECTED_PASS);
}

struct totals {
    size_t changes[GN_GATE_CHANGE_COUNT];
    size_t wrong, passes, failures; /* that count: worse than before; unexpected passes; other failures */
    size_t slower, larger, broken, measured, unmeasured;
    size_t unanswered; /* on both drivers, with the same status, but for cases that pass and trace nothing */
};

static struct totals totals_of(const struct gn_gate *gate)
{
    struct totals totals = {0};
    for (size_t i = 0; i < gate->case_count; i++) {
        const struct gn_gate_case *pair = &gate->cases[i];
        totals.changes[pair->change]++;
        totals.unanswered += pair->change == GN_GATE_SAME && !pair->now->answers && pair->now->status != GN_CASE_PASS;
        if (!gn_gate_case_counts(gate, i))
            continue;
        if (pair->change == GN_GATE_WRONG)
            totals.wrong++;
        else if (pair->now->outcome == GN_OUTCOME_UNEXPECTED_PASS)
            totals.passes++;
        else
            totals.failures++;
    }
    for (size_t i = 0; i < gate->time_count; i++) {
        const struct gn_gate_time *time = &gate->times[i];
        totals.slower += time->exceeds && !time->item->bytes;
        totals.larger += time->exceeds && time->item->bytes;
        totals.broken += time->broken;
        totals.measured += !*time->missing;
        totals.unmeasured += *time->missing != 0;
    }
    return totals;
}

/* Appends "N WHAT", with a comma before it where something stands already. */
static void append(char *out, size_t size, size_t count, const char *one, const char *many)
{
    size_t used = strlen(out);
    if (count && used < size)
        snprintf(out + used, size - used, "%s%zu %s", used ? ", " : "", count, count == 1 ? one : many);
}

/* What is true of cases none of which has changed. */
static const char *same_of(const struct gn_gate *gate, const struct totals *totals, char *out, size_t size)
{
    size_t varying = totals->changes[GN_GATE_VARIES], answered = gate->case_count - totals->unanswered - varying;
    if (!totals->unanswered && !varying) {
        snprintf(out, size, "all %zu cases answer bit for bit as before", answered);
        return out;
    }
    *out = 0;
    append(out, size, answered, "case answers bit for bit as before", "cases answer bit for bit as before");
    append(out, size, totals->unanswered, "case is skipped or fails without an answer, as before",
           "cases are skipped or fail without an answer, as before");
    append(out, size, varying, "case answers otherwise from one run to the next", "cases answer otherwise from one run to the next");
    return out;
}

/* What is true of measurements none of which counts; "" where there are none. */
static const char *time_of(const struct totals *totals, char *out, size_t size)
{
    *out = 0;
    if (totals->measured)
        snprintf(out, size, ", and nothing is slower than the budget");
    if (totals->unmeasured)
        snprintf(out + strlen(out), size - strlen(out), " (%zu %s not measured)", totals->unmeasured,
                 totals->unmeasured == 1 ? "operation" : "operations");
    return out;
}

void gn_gate_verdict(const struct gn_gate *gate, char *out, size_t size)
{
    struct totals totals = totals_of(gate);
    char reasons[600] = "", same[300], times[120];
    append(reasons, sizeof reasons, totals.wrong, "case is newly wrong", "cases are newly wrong");
    append(reasons, sizeof reasons, totals.failures, "case fails unexpectedly", "cases fail unexpectedly");
    append(reasons, sizeof reasons, totals.passes, "case passes that was expected to fail",
           "cases pass that were expected to fail");
    append(reasons, sizeof reasons, gate->now->stale_count, "expectation is stale", "expectations are stale");
    append(reasons, sizeof reasons, gate->lost_count, "case did not run", "cases did not run");
    append(reasons, sizeof reasons, totals.slower, "operation is slower than the budget",
           "operations are slower than the budget");
    append(reasons, sizeof reasons, totals.larger, "structure is larger than the budget",
           "structures are larger than the budget");
    append(reasons, sizeof reasons, totals.broken, "measured operation fails newly", "measured operations fail newly");
    if (gate->now->stopped[0] || (gate->before && gate->before->stopped[0]))
        snprintf(out, size, "No answer: the run was stopped (%s)%s%s.",
                 gate->now->stopped[0] ? gate->now->stopped : gate->before->stopped, *reasons ? "; " : "", reasons);
    else if (*reasons)
        snprintf(out, size, "This may not land: %s.", reasons);
    else if (gn_gate_exit_status(gate) == 4)
        snprintf(out, size, "No answer: every case was skipped.");
    else if (!gate->before)
        snprintf(out, size, "This may land: %zu %s came out as expected.", gate->case_count,
                 gate->case_count == 1 ? "case" : "cases");
    else if (totals.changes[GN_GATE_SAME] + totals.changes[GN_GATE_VARIES] == gate->case_count)
        snprintf(out, size, "No change: %s%s.", same_of(gate, &totals, same, sizeof same), time_of(&totals, times, sizeof times));
    else
        snprintf(out, size, "This may land: no case is worse (%zu newly right, %zu with other answers)%s.",
                 totals.changes[GN_GATE_RIGHT], totals.changes[GN_GATE_ANSWERS], time_of(&totals, times, sizeof times));
}

int gn_gate_exit_status(const struct gn_gate *gate)
{
    struct totals totals = totals_of(gate);
    if ((gate->now->stopped[0] && !gate->now->stopped_at_limit) || (gate->before && gate->before->stopped[0]))
        return 3;
    if (totals.wrong || totals.failures || totals.passes || gate->now->stale_count || gate->lost_count ||
        totals.slower || totals.larger || totals.broken)
        return 1;
    return gn_results_exit_status(gate->now) == 4 ? 4 : 0;
}

static void print_case(const struct gn_gate *gate, const struct gn_gate_case *pair, const char *out)
{
    const struct gn_results_case *cs = pair->now;
    printf("\n  %s", cs->name);
    if (pair->before)
        printf(": %s, was %s\n", gn_case_status_name(cs->status), gn_case_status_name(pair->before->status));
    else
        printf(": %s\n", gn_case_status_name(cs->status));
    if (cs->outcome == GN_OUTCOME_UNEXPECTED_PASS)
        printf("    %s expects %s\n", cs->expected_place, cs->expected);
    else if (*cs->message)
        printf("    %.*s\n", (int)strcspn(cs->message, "\n"), cs->message);
    for (size_t i = 0; i < gate->rerun_count; i++) {
        const struct gn_gate_rerun *rerun = &gate->reruns[i];
        if (strcmp(rerun->name, cs->name) != 0 || !rerun->alone)
            continue;
        printf("    run again: passed %u of %u alone", rerun->alone_passed, rerun->alone);
        if (rerun->context)
            printf(", %u of %u behind the cases before it", rerun->context_passed, rerun->context);
        if (*rerun->after)
            printf("; it fails behind %s", rerun->after);
        printf("\n");
    }
    if (cs->replay[0]) {
        char path[4096];
        snprintf(path, sizeof path, "%s/new/%s", out, cs->replay);
        char *quoted = gn_shell_quote(path);
        printf("    replay: %s replay %s\n", gate->now->run.command, quoted ? quoted : path);
        free(quoted);
    }
}

const char *gn_gate_device(const struct gn_results *results, char out[GN_GATE_DEVICE_SIZE])
{
    const struct gn_device_info *device = &results->run.device;
    snprintf(out, GN_GATE_DEVICE_SIZE, "%s, %s %s", device->name, device->driver_name, device->driver_info);
    gn_text_clean(out);
    for (char *at = out; *at; at++)
        if (*at == '\n' || *at == '\t')
            *at = ' ';
    return out;
}

const char *gn_gate_amount(const struct gn_bench_item *item, double value, char out[32])
{
    if (item->bytes && value < 1e3)
        snprintf(out, 32, "%.0f B", value);
    else if (item->bytes && value < 1e6)
        snprintf(out, 32, "%.3g kB", value / 1e3);
    else if (item->bytes)
        snprintf(out, 32, "%.3g MB", value / 1e6);
    else if (value < 1e-3)
        snprintf(out, 32, "%.3g us", value * 1e6);
    else
        snprintf(out, 32, "%.3g ms", value * 1e3);
    return out;
}

static const char *verdict_of(const struct gn_gate_time *time)
{
    return time->exceeds       ? "  over the budget"
           : time->undecided   ? "  too noisy to tell"
           : time->unconfirmed ? "  over the budget at first, not when measured again"
                               : "";
}

static void print_times(const struct gn_gate *gate, const char *red, const char *plain)
{
    if (!gate->time_count)
        return;
    printf("\n  %-32s %10s %10s   %s\n", "time and memory", "old", "new", "ratio (99 %)");
    for (size_t i = 0; i < gate->time_count; i++) {
        const struct gn_gate_time *time = &gate->times[i];
        char before[32], now[32];
        if (!time->rounds) {
            printf("  %s%-32s not measured: %s%s\n", time->broken ? red : "", time->item->name, time->missing,
                   time->broken ? plain : "");
            continue;
        }
        printf("  %s%-32s %10s %10s   %.2f", time->exceeds ? red : "", time->item->name,
               gn_gate_amount(time->item, time->before_median, before), gn_gate_amount(time->item, time->now_median, now), time->ratio);
        if (!time->item->bytes)
            printf(" (%.2f to %.2f)", time->low, time->high);
        printf("%s%s\n", verdict_of(time),
               time->exceeds ? plain : "");
    }
}

static void print_drifts(const struct gn_gate *gate)
{
    bool any = false;
    for (size_t i = 0; i < gate->drift_count; i++) {
        const struct gn_gate_drift *drift = &gate->drifts[i];
        if (!drift->drifted)
            continue;
        if (!any)
            printf("\nbackward error has moved (units of 2^-24, median and 99.9 %%):\n");
        any = true;
        printf("  %-16s %.2g, %.2g before; %.2g, %.2g now (largest distance of the distributions %.1f %%)\n",
               drift->family, drift->before_median, drift->before_p999, drift->now_median, drift->now_p999,
               100 * drift->distance);
    }
}

void gn_gate_print(const struct gn_gate *gate, const char *out)
{
    bool colour = gn_terminal_colour(STDOUT_FILENO);
    const char *red = colour ? "\033[31m" : "", *green = colour ? "\033[32m" : "", *plain = colour ? "\033[0m" : "";
    struct totals totals = totals_of(gate);
    char verdict[1024], duration[32], device[GN_GATE_DEVICE_SIZE];
    gn_gate_verdict(gate, verdict, sizeof verdict);
    printf("%s%s%s\n", gn_gate_exit_status(gate) == 0 ? green : red, verdict, plain);
    printf("new: %s\n", gn_gate_device(gate->now, device));
    if (gate->before) {
        printf("old: %s\n", gn_gate_device(gate->before, device));
        printf("%zu cases: %zu the same bit for bit, %zu with other answers, %zu with varying ones, %zu newly right, %zu newly wrong\n",
               gate->case_count, totals.changes[GN_GATE_SAME], totals.changes[GN_GATE_ANSWERS],
               totals.changes[GN_GATE_VARIES], totals.changes[GN_GATE_RIGHT], totals.changes[GN_GATE_WRONG]);
    }
    size_t shown = 0, counting = 0;
    for (size_t i = 0; i < gate->case_count; i++) {
        if (!gn_gate_case_counts(gate, i) || counting++ >= MOST_SHOWN)
            continue;
        print_case(gate, &gate->cases[i], out);
        shown++;
    }
    if (counting > shown)
        printf("\n  and %zu more, in the report\n", counting - shown);
    for (size_t i = 0; i < gate->now->stale_count; i++)
        printf("\n  stale expectation: %s\n", gate->now->stale[i]);
    if (totals.changes[GN_GATE_RIGHT])
        printf("\nnewly right:\n");
    shown = 0;
    for (size_t i = 0; i < gate->case_count; i++) {
        const struct gn_gate_case *pair = &gate->cases[i];
        if (pair->change == GN_GATE_RIGHT && shown++ < MOST_RIGHT_SHOWN)
            printf("  %s: %s, was %s\n", pair->now->name, gn_case_status_name(pair->now->status),
                   gn_case_status_name(pair->before->status));
    }
    if (shown > MOST_RIGHT_SHOWN)
        printf("  and %zu more\n", shown - MOST_RIGHT_SHOWN);
    print_times(gate, red, plain);
    print_drifts(gate);
    printf("\n%s in all; report: %s/gate.html\n", gn_format_duration(gate->seconds, duration), out);
}

void gn_gate_finish(struct gn_gate *gate)
{
    free(gate->cases);
    free(gate->lost);
    free(gate->drifts);
    free(gate->times);
    free(gate->reruns);
    *gate = (struct gn_gate){0};
}
