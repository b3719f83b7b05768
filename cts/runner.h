/* SPDX-License-Identifier: Apache-2.0 */
/* The parent of a run: hands cases to workers, survives what happens to them, writes results as they come. */
#ifndef GNOMON_CTS_RUNNER_H
#define GNOMON_CTS_RUNNER_H

#include "cts/expect.h"

struct gn_runner_options {
    const char *out; /* the output folder, as typed */
    const struct gn_expectations *expectations;
    uint64_t max_fails; /* 0: no limit */
    bool quiet;         /* nothing on stdout */
    bool resume;        /* keep what OUT/results.jsonl has of the same run */
};

/*
 * Runs the cases. `results` comes initialised, with results->run filled but for the device; it is filled here
 * and all reports are written. Gives the exit status; everything worth saying has been said on stderr (what
 * went wrong with the run) and stdout (what came of it).
 */
int gn_runner_run(const struct gn_runner_options *options, const struct gn_selected *cases, size_t count,
                  struct gn_results *results);

#endif
