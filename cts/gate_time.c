/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Time and memory of two drivers: one process for each, which measure in turns, so that whatever else the machine does meets both. An
 * item's ratio is the median of its rounds' ratios, and the interval it lies in comes from the order of these ratios
 * alone, whatever their distribution.
 */
#include <math.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cts/gate.h"
#include "cts/progress.h"
#include "cts/statistics.h"
#include "cts/worker.h"

#define FIRST_ROUNDS 9
/* After this no item gets more than its first rounds: on a machine that is busy otherwise an answer has to come as well. */
#define MOST_SECONDS 60.0
#define OPEN_TIMEOUT 60.0
#define MEASURE_TIMEOUT 120.0

/* Drivers keep compiled shaders on disk; what is to be measured is the compiler. */
static const char *const cache_switches[][2] = {{"MESA_SHADER_CACHE_DISABLE", "true"}, {"__GL_SHADER_DISK_CACHE", "0"}};
enum { SWITCH_COUNT = sizeof cache_switches / sizeof cache_switches[0] };

static double median(const double *values, uint32_t count)
{
    double sorted[GN_GATE_MOST_ROUNDS];
    memcpy(sorted, values, count * sizeof *values);
    qsort(sorted, count, sizeof *sorted, gn_doubles_compare);
    return count % 2 ? sorted[count / 2] : (sorted[count / 2 - 1] + sorted[count / 2]) / 2;
}

/*
 * How many of the sorted values may be cut off at each end so that the median lies between the rest with a probability of 99 %:
 * each value is below the median with probability 1/2, so their number is binomial.
 */
static uint32_t order_cut(uint32_t count)
{
    double tail = 0, term = exp2(-(double)count);
    uint32_t cut = 0;
    for (; cut < count / 2; cut++) {
        tail += term;
        if (2 * tail > 0.01)
            break;
        term *= (double)(count - cut) / (double)(cut + 1);
    }
    return cut;
}

void gn_gate_time_decide(struct gn_gate_time *time, double budget)
{
    double ratios[GN_GATE_MOST_ROUNDS];
    if (!time->rounds)
        return;
    for (uint32_t i = 0; i < time->rounds; i++)
        ratios[i] = time->now[i] / time->before[i];
    time->now_median = median(time->now, time->rounds);
    time->before_median = median(time->before, time->rounds);
    time->ratio = median(ratios, time->rounds);
    qsort(ratios, time->rounds, sizeof *ratios, gn_doubles_compare);
    uint32_t cut = order_cut(time->rounds);
    if (time->item->bytes) {
        time->low = time->high = time->ratio;
    } else if (cut) {
        time->low = ratios[cut - 1];
        time->high = ratios[time->rounds - cut];
    } else {
        time->low = 0;
        time->high = INFINITY;
    }
    time->exceeds = time->low > budget;
    time->undecided = !time->exceeds && time->high > budget;
}

/* The next line of a worker, zero-terminated, until the next call; NULL when none comes. */
static char *next_line(struct gn_process *process, double timeout)
{
    double end = gn_clock() + timeout;
    for (;;) {
        size_t position = 0, length = 0;
        static char *copy;
        char *line = gn_process_line(process, &position, &length);
        if (line) {
            free(copy);
            copy = strdup(line);
            gn_process_consume(process, position);
            return copy;
        }
        struct pollfd fd = {process->from, POLLIN, 0};
        double left = end - gn_clock();
        if (left <= 0 || (poll(&fd, 1, (int)(left * 1000) + 1) > 0 && gn_process_read(process) == 0))
            return NULL;
    }
}

bool gn_gate_open(struct gn_process *process, const char *driver, char *out_error, size_t error_size)
{
    if (!gn_process_start(process, driver, 1, 1, out_error, error_size))
        return false;
    const char *line = next_line(process, OPEN_TIMEOUT);
    if (line && line[0] == 'R')
        return true;
    snprintf(out_error, error_size, "cannot measure the driver %s: %s", *driver ? driver : "of the environment",
             line && line[0] == 'U' ? line + 2 : "it does not open");
    return false;
}

bool gn_gate_item_measure(struct gn_process *process, const struct gn_bench_item *item, double *out_value,
                          struct gn_arena *arena, const char **out_missing)
{
    char text[128];
    snprintf(text, sizeof text, "%s%s", GN_WORKER_BENCH, item->name);
    gn_process_noise_limit(process);
    const char *line = gn_process_send(process, text) ? next_line(process, MEASURE_TIMEOUT) : NULL;
    if (!line || line[0] != 'B') {
        *out_missing = "the driver did not come through it";
        return false;
    }
    if (line[2] == '-' || line[2] == '!') {
        *out_missing = gn_arena_printf(arena, "%s", line + 4);
        return line[2] == '-';
    }
    *out_value = strtod(line + 2, NULL);
    if (!(*out_value > 0))
        *out_missing = "the driver reports nothing";
    return true;
}

/* The two drivers' processes, the new one's first. */
struct pair {
    const char *drivers[2];
    struct gn_process processes[2];
    const char *closed[2]; /* why a driver is not gone on with, or NULL */
};

/* A process that is of no use any more makes room for a new one, so that the other items are measured. */
static void reopen(struct pair *pair, uint32_t which, double deadline, struct gn_arena *arena)
{
    char error[512];
    gn_process_end(&pair->processes[which], true);
    if (gn_clock() > deadline)
        pair->closed[which] = "it did not come through an earlier measurement, and there is no time for more";
    else if (!gn_gate_open(&pair->processes[which], pair->drivers[which], error, sizeof error))
        pair->closed[which] = gn_arena_printf(arena, "%s", error);
}

/*
 * One round of one item on both drivers, each of them first in turn. Where the new driver does not come through it, the old one
 * is asked all the same: what neither can do has not been broken.
 */
static void round_of(struct gn_gate *gate, struct gn_gate_time *time, struct pair *pair, double deadline)
{
    struct gn_arena *arena = &gate->now->arena;
    double values[2] = {0, 0};
    const char *missing[2] = {pair->closed[0] ? pair->closed[0] : "", pair->closed[1] ? pair->closed[1] : ""};
    bool failed[2] = {false, false}, open = !pair->closed[0] && !pair->closed[1];
    uint32_t round = time->rounds;
    for (uint32_t k = 0; k < 2 && open; k++) {
        uint32_t which = (round + k) % 2;
        failed[which] = !gn_gate_item_measure(&pair->processes[which], time->item, &values[which], arena, &missing[which]);
        if (failed[which])
            reopen(pair, which, deadline, arena);
    }
    const char *text = "";
    for (uint32_t which = 0; which < 2; which++)
        if (*missing[which])
            text = gn_arena_printf(arena, "%s%s%s driver: %s", text, *text ? "; " : "", which ? "old" : "new", missing[which]);
    if (*text) {
        *time = (struct gn_gate_time){.item = time->item, .missing = text, .broken = failed[0] && !*missing[1]};
        return;
    }
    time->now[round] = values[0];
    time->before[round] = values[1];
    time->rounds++;
}

static void show(const struct gn_gate_time *time, size_t done, size_t count)
{
    if (isatty(STDERR_FILENO))
        fprintf(stderr, "\r\033[Kgnomon: timing %zu/%zu: %s, round %u", done + 1, count, time->item->name, time->rounds + 1);
}

/* Measures an item until it is decided. */
static void measure_item(struct gn_gate *gate, struct gn_gate_time *time, struct pair *pair, size_t number, double deadline)
{
    uint32_t least = time->item->bytes ? 1 : FIRST_ROUNDS;
    while (!*time->missing && time->rounds < GN_GATE_MOST_ROUNDS &&
           (time->rounds < least || (time->undecided && !time->item->bytes && gn_clock() < deadline))) {
        show(time, number, gate->time_count);
        round_of(gate, time, pair, deadline);
        if (time->rounds >= least)
            gn_gate_time_decide(time, gate->budget);
    }
    gn_gate_time_decide(time, gate->budget);
}

/* All items; or, to confirm, those that exceed the budget, afresh. */
static bool measure_items(struct gn_gate *gate, const char *now_driver, const char *before_driver, bool confirm,
                          char *out_error, size_t error_size)
{
    static const struct gn_process none = {0, -1, -1, -1, NULL, 0, 0};
    struct pair pair = {{now_driver, before_driver}, {none, none}, {NULL, NULL}};
    bool ok = true;
    double deadline = gn_clock() + MOST_SECONDS;
    for (int which = 0; which < 2 && ok; which++)
        ok = gn_gate_open(&pair.processes[which], pair.drivers[which], out_error, error_size);
    for (size_t i = 0; i < gate->time_count && ok; i++) {
        struct gn_gate_time *time = &gate->times[i];
        if (confirm && (!time->exceeds || time->item->bytes))
            continue;
        *time = (struct gn_gate_time){.item = time->item, .missing = ""};
        measure_item(gate, time, &pair, i, deadline);
        time->unconfirmed = confirm && !time->exceeds && time->rounds;
    }
    if (isatty(STDERR_FILENO))
        fprintf(stderr, "\r\033[K");
    for (int which = 0; which < 2; which++)
        gn_process_end(&pair.processes[which], true);
    return ok;
}

bool gn_gate_measure(struct gn_gate *gate, const char *now_driver, const char *before_driver, char *out_error,
                     size_t error_size)
{
    gate->time_count = gn_bench_count();
    gate->times = calloc(gate->time_count, sizeof *gate->times);
    if (!gate->times) {
        snprintf(out_error, error_size, "out of memory");
        gate->time_count = 0;
        return false;
    }
    for (size_t i = 0; i < gate->time_count; i++)
        gate->times[i] = (struct gn_gate_time){.item = gn_bench_item(i), .missing = ""};
    char *kept[SWITCH_COUNT];
    for (size_t i = 0; i < SWITCH_COUNT; i++) {
        const char *value = getenv(cache_switches[i][0]);
        kept[i] = value ? strdup(value) : NULL;
        setenv(cache_switches[i][0], cache_switches[i][1], 1);
    }
    /* What a process got in memory, and what else the machine did for a while, can make one driver seem slower all along. */
    bool ok = measure_items(gate, now_driver, before_driver, false, out_error, error_size) &&
              measure_items(gate, now_driver, before_driver, true, out_error, error_size);
    for (size_t i = 0; i < SWITCH_COUNT; i++) {
        if (kept[i])
            setenv(cache_switches[i][0], kept[i], 1);
        else
            unsetenv(cache_switches[i][0]);
        free(kept[i]);
    }
    return ok;
}
