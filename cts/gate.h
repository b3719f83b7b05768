/* SPDX-License-Identifier: Apache-2.0 */
/* `gnomon gate`: what its parts find out about two drivers, or about one and what is expected of it. */
#ifndef GNOMON_CTS_GATE_H
#define GNOMON_CTS_GATE_H

#include "cts/bench.h"
#include "cts/expect.h"
#include "cts/results.h"

/* How a case stands with the new driver against the old one. */
enum gn_gate_change {
    GN_GATE_SAME,    /* the same status, the same answers bit by bit */
    GN_GATE_ANSWERS, /* the same status, other answers */
    GN_GATE_VARIES,  /* the same status, other answers, as they are from one run to the next on the same driver */
    GN_GATE_RIGHT,   /* better than it was */
    GN_GATE_WRONG,   /* worse than it was: counts */
    GN_GATE_ADDED,   /* not run on the old driver */
    GN_GATE_CHANGE_COUNT
};

struct gn_gate_case {
    const struct gn_results_case *now, *before; /* `before` is NULL where there is none */
    enum gn_gate_change change;
    bool ray_by_ray;                            /* the next two are known */
    uint64_t decisions_changed, numbers_changed; /* rays; the second: with equal decisions */
};

/* How the backward error of a family is distributed on both drivers. */
struct gn_gate_drift {
    const char *family;
    uint64_t now_count, before_count;
    double now_median, before_median, now_p999, before_p999, now_max, before_max;
    double distance; /* Kolmogorov and Smirnov's: the largest difference of the two distribution functions */
    double p;        /* of a distance at least this large if both were alike */
    bool drifted;    /* p below 1e-6 */
};

/* One item measured on both drivers in turns. */
#define GN_GATE_MOST_ROUNDS 31
struct gn_gate_time {
    const struct gn_bench_item *item;
    double now[GN_GATE_MOST_ROUNDS], before[GN_GATE_MOST_ROUNDS];
    uint32_t rounds;
    double now_median, before_median;
    double ratio, low, high; /* new to old: the median of the rounds' ratios, and the interval it lies in at 99 % */
    bool exceeds;            /* `low` is above the budget */
    bool undecided;          /* the budget lies within the interval still */
    bool unconfirmed;        /* it exceeded the budget once, and not when measured again by new processes */
    const char *missing;     /* why there is no measurement, or "" */
    bool broken;             /* there is none because the new driver does not come through what the old one does: counts */
};

/* A case that counts, run again. */
struct gn_gate_rerun {
    const char *name;
    uint32_t alone, alone_passed;     /* runs in a process of its own */
    uint32_t context, context_passed; /* runs behind the cases that its worker had run before */
    const char *after;                /* the one case that it fails behind, though it passes alone; or "" */
};

#define GN_GATE_DEVICE_SIZE 1200

struct gn_gate {
    struct gn_results *now, *before; /* `before` is NULL without --against */
    bool expects; /* expectation files were given: what they say counts, beside the old driver */
    double budget;
    struct gn_gate_case *cases; /* malloc'ed, one per case of `now` */
    size_t case_count;
    const char **lost; /* cases that only the old driver ran; malloc'ed */
    size_t lost_count;
    struct gn_gate_drift *drifts; /* malloc'ed */
    size_t drift_count;
    struct gn_gate_time *times; /* malloc'ed, one per item */
    size_t time_count;
    struct gn_gate_rerun *reruns; /* malloc'ed */
    size_t rerun_count;
    double seconds, rerun_seconds; /* in all, and running cases again */
    const char *now_driver, *before_driver; /* as the user named them */
};

/*
 * Compares the results, and ray by ray where the folder (or NULL) has what the second run found (gn_case_kept_write()). Strings go
 * to the arena of gate->now.
 */
void gn_gate_compare(struct gn_gate *gate, const char *answers);

/*
 * Measures both drivers in turns until every item is decided, or has had its rounds. False with a message when a driver
 * cannot be measured at all.
 */
bool gn_gate_measure(struct gn_gate *gate, const char *now_driver, const char *before_driver, char *out_error,
                     size_t error_size);
/* Sets medians, ratio, interval and verdict from the rounds. For gn_gate_measure() and its tests. */
void gn_gate_time_decide(struct gn_gate_time *time, double budget);

/* Runs every case that counts `times` times alone and in context. */
void gn_gate_rerun(struct gn_gate *gate, const char *driver, uint32_t times);

/* Runs cases with other answers again on both drivers, up to `times` times, and finds which of them vary by themselves. */
void gn_gate_vary(struct gn_gate *gate, const char *driver, const char *before_driver, uint32_t times);

/* Whether a case of the new driver counts: unexpectedly failed, or worse than on the old driver. */
bool gn_gate_case_counts(const struct gn_gate *gate, size_t index);
/* The answer in one sentence, and the exit status. */
void gn_gate_verdict(const struct gn_gate *gate, char *out, size_t size);
int gn_gate_exit_status(const struct gn_gate *gate);
/* A device and its driver in one line. */
const char *gn_gate_device(const struct gn_results *results, char out[GN_GATE_DEVICE_SIZE]);
/* A measurement with its unit: "4.7 ms", "64 B". */
const char *gn_gate_amount(const struct gn_bench_item *item, double value, char out[32]);
const char *gn_gate_change_name(enum gn_gate_change change);

/* gate.json, gate.md, gate.sarif and gate.html in the folder; the console's part on stdout. */
bool gn_gate_write(const struct gn_gate *gate, const char *out, char *out_error, size_t error_size);
void gn_gate_print(const struct gn_gate *gate, const char *out);
void gn_gate_finish(struct gn_gate *gate);

struct gn_process;
/* Starts a worker that opens the driver. False with a message. The process has to be ended in any case. */
bool gn_gate_open(struct gn_process *process, const char *driver, char *out_error, size_t error_size);
/* Measures one item in it, once. False when the process is of no use any more; *out_missing is why there is no value, or "". */
bool gn_gate_item_measure(struct gn_process *process, const struct gn_bench_item *item, double *out_value,
                          struct gn_arena *arena, const char **out_missing);

#endif
