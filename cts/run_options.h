/* SPDX-License-Identifier: Apache-2.0 */
/* The options that every command which runs cases has: what to run on which driver, and how to judge the outcome. */
#ifndef GNOMON_CTS_RUN_OPTIONS_H
#define GNOMON_CTS_RUN_OPTIONS_H

#include <argp.h>

#include "cts/expect.h"
#include "cts/runner.h"

struct gn_run_options {
    const char *driver; /* as typed; NULL: the default */
    const char *backend; /* of gn_case_backend_name(), or "all" */
    const char *out;
    uint32_t jobs, shard, shard_count;
    const char *durations; /* a file; NULL: shards by name */
    uint64_t seed, max_fails;
    double scale, timeout;
    bool resume, list;
    bool quiet; /* nothing on stdout but what --list prints; not an option */
    const char **filters;
    size_t filter_count;
    const char **expects;
    size_t expect_count;
};

/* The defaults, and room for what `argc` arguments can hold. */
void gn_run_options_init(struct gn_run_options *options, int argc, struct gn_arena *arena);
/* Parses the options and the filters; its input is a struct gn_run_options. For use as argp or as its child. */
extern const struct argp gn_run_options_argp;

/* What is to be run: the cases chosen, and what is expected of them. */
struct gn_run_plan {
    struct gn_selected *catalogue, *cases; /* malloc'ed */
    size_t catalogue_count, count;
    bool empty_shard; /* there are cases, but none in the shard */
    struct gn_expectations expectations;
};
/*
 * Chooses cases and reads expectations; what is stale in these is added to `results`. 0, or an exit status, with what is
 * wrong said on stderr. With --list the names are printed and the plan is empty. To be finished in any case.
 */
int gn_run_plan_make(struct gn_run_plan *plan, const struct gn_run_options *options, struct gn_results *results);
void gn_run_plan_finish(struct gn_run_plan *plan);

/*
 * Runs the plan on a driver (an ICD file, or "" where the loader chooses) and writes its reports into `out`. `typed` is
 * what the user typed behind the command. Gives the exit status; `results` has what came of it. Of an empty shard only the
 * folder is made, for `gnomon merge`, which has to see that nothing is missing.
 */
int gn_run_plan_run(const struct gn_run_plan *plan, const struct gn_run_options *options, const char *driver,
                    const char *out, const char *typed, struct gn_results *results);

/* The arguments behind argv[0] as one would type them, in the arena. */
const char *gn_run_typed(struct gn_arena *arena, int argc, char **argv);

#endif
