/* SPDX-License-Identifier: Apache-2.0 */
/* Two runs of the same rays, compared: statuses, answers ray by ray, the distribution of backward errors. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cts/gate.h"

/* Below this an unlikely distance is called a drift, if it is not tiny as well: with many rays everything is unlikely. */
#define DRIFT_P 1e-6
#define DRIFT_DISTANCE 0.01

static void *allocate(size_t count, size_t size)
{
    void *memory = calloc(count ? count : 1, size);
    if (!memory) {
        fprintf(stderr, "gnomon: out of memory\n");
        exit(3);
    }
    return memory;
}

static const struct gn_results_case *find(const struct gn_results *results, const char *name)
{
    for (size_t i = 0; i < results->count; i++)
        if (strcmp(results->cases[i].name, name) == 0)
            return &results->cases[i];
    return NULL;
}

/* How bad a status is. What a driver does not do any more is worse than what it does right. */
static int rank(enum gn_case_status status)
{
    static const int ranks[GN_CASE_STATUS_COUNT] = {
        [GN_CASE_PASS] = 0,  [GN_CASE_SKIP] = 1,    [GN_CASE_LEAK] = 2, [GN_CASE_FAIL] = 3,
        [GN_CASE_ERROR] = 4, [GN_CASE_TIMEOUT] = 5, [GN_CASE_CRASH] = 6,
    };
    return ranks[status];
}

static enum gn_gate_change change_of(const struct gn_results_case *now, const struct gn_results_case *before)
{
    if (!before)
        return GN_GATE_ADDED;
    if (rank(now->status) != rank(before->status))
        return rank(now->status) > rank(before->status) ? GN_GATE_WRONG : GN_GATE_RIGHT;
    return now->answers == before->answers ? GN_GATE_SAME : GN_GATE_ANSWERS;
}

/* The probability that two samples of one distribution are at least so far apart (Kolmogorov's series). */
static double distance_probability(double distance, double now_count, double before_count)
{
    double n = sqrt(now_count * before_count / (now_count + before_count));
    double x = (n + 0.12 + 0.11 / n) * distance, sum = 0;
    if (x < 0.2)
        return 1;
    for (int k = 1; k <= 100; k++) {
        double term = (k % 2 ? 2 : -2) * exp(-2.0 * k * k * x * x);
        sum += term;
        if (fabs(term) < 1e-12 * fabs(sum))
            break;
    }
    return fmin(fmax(sum, 0), 1);
}

/* The middle of a bin, as far as the bins know. */
static double bin_value(size_t bin)
{
    return bin ? exp2(((double)bin - 1.5) / 4 - 8) : 0;
}

static double quantile(const uint64_t bins[GN_CASE_ERROR_BINS], uint64_t total, double fraction)
{
    uint64_t sum = 0;
    for (size_t i = 0; i < GN_CASE_ERROR_BINS; i++) {
        sum += bins[i];
        if (sum && (double)sum >= fraction * (double)total)
            return bin_value(i);
    }
    return 0;
}

static void compare_family(const struct gn_gate *gate, struct gn_gate_drift *drift)
{
    uint64_t now[GN_CASE_ERROR_BINS] = {0}, before[GN_CASE_ERROR_BINS] = {0};
    for (size_t i = 0; i < gate->case_count; i++) {
        const struct gn_gate_case *pair = &gate->cases[i];
        if (!pair->before || strcmp(pair->now->family, drift->family) != 0)
            continue;
        for (size_t b = 0; b < GN_CASE_ERROR_BINS; b++) {
            now[b] += pair->now->hit_error_bins[b];
            before[b] += pair->before->hit_error_bins[b];
        }
        drift->now_max = fmax(drift->now_max, pair->now->hit_error_max);
        drift->before_max = fmax(drift->before_max, pair->before->hit_error_max);
    }
    for (size_t b = 0; b < GN_CASE_ERROR_BINS; b++) {
        drift->now_count += now[b];
        drift->before_count += before[b];
    }
    drift->p = 1;
    if (!drift->now_count || !drift->before_count)
        return;
    double now_sum = 0, before_sum = 0;
    for (size_t b = 0; b < GN_CASE_ERROR_BINS; b++) {
        now_sum += (double)now[b] / (double)drift->now_count;
        before_sum += (double)before[b] / (double)drift->before_count;
        drift->distance = fmax(drift->distance, fabs(now_sum - before_sum));
    }
    drift->p = distance_probability(drift->distance, (double)drift->now_count, (double)drift->before_count);
    drift->drifted = drift->p < DRIFT_P && drift->distance > DRIFT_DISTANCE;
    drift->now_median = quantile(now, drift->now_count, 0.5);
    drift->before_median = quantile(before, drift->before_count, 0.5);
    drift->now_p999 = quantile(now, drift->now_count, 0.999);
    drift->before_p999 = quantile(before, drift->before_count, 0.999);
}

static void compare_families(struct gn_gate *gate)
{
    gate->drifts = allocate(gate->case_count, sizeof *gate->drifts);
    for (size_t i = 0; i < gate->case_count; i++) {
        const char *family = gate->cases[i].now->family;
        bool known = false;
        for (size_t d = 0; d < gate->drift_count && !known; d++)
            known = strcmp(gate->drifts[d].family, family) == 0;
        if (known)
            continue;
        struct gn_gate_drift drift = {.family = family};
        compare_family(gate, &drift);
        if (drift.now_count && drift.before_count)
            gate->drifts[gate->drift_count++] = drift;
    }
}

void gn_gate_compare(struct gn_gate *gate, const char *answers)
{
    gate->case_count = gate->now->count;
    gate->cases = allocate(gate->case_count, sizeof *gate->cases);
    for (size_t i = 0; i < gate->case_count; i++) {
        struct gn_gate_case *pair = &gate->cases[i];
        pair->now = &gate->now->cases[i];
        pair->before = gate->before ? find(gate->before, pair->now->name) : NULL;
        pair->change = gate->before ? change_of(pair->now, pair->before) : GN_GATE_SAME;
        if (answers && pair->before && pair->now->answers != pair->before->answers)
            pair->ray_by_ray =
                gn_case_changed_read(answers, pair->now->name, &pair->decisions_changed, &pair->numbers_changed);
    }
    if (!gate->before)
        return;
    gate->lost = allocate(gate->before->count, sizeof *gate->lost);
    for (size_t i = 0; i < gate->before->count; i++)
        if (!find(gate->now, gate->before->cases[i].name))
            gate->lost[gate->lost_count++] = gate->before->cases[i].name;
    compare_families(gate);
}
