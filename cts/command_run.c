/* SPDX-License-Identifier: Apache-2.0 */
/* `gnomon run`. */
#include <stdio.h>
#include <string.h>

#include "cts/commands.h"
#include "cts/driver.h"
#include "cts/fuzz.h"
#include "cts/run_options.h"
#include "cts/selftest.h"

const char *gn_command_name = "gnomon";

enum { OPTION_SELFTEST = 512, OPTION_FAULTS };

struct arguments {
    struct gn_run_options options;
    bool selftest;
    const char *faults;
};

static const struct argp_option argp_options[] = {
    {"selftest", OPTION_SELFTEST, NULL, 0,
     "Make lavapipe wrong in one named way at a time, and see whether each is noticed", 1},
    {"faults", OPTION_FAULTS, "PATTERN", 0, "With --selftest: only the faults of this name; * stands for any characters", 1},
    {0},
};

static error_t parse(int key, char *argument, struct argp_state *state)
{
    struct arguments *arguments = state->input;
    switch (key) {
    case ARGP_KEY_INIT:
        state->child_inputs[0] = &arguments->options;
        return 0;
    case OPTION_SELFTEST:
        arguments->selftest = true;
        return 0;
    case OPTION_FAULTS:
        arguments->faults = argument;
        return 0;
    case ARGP_KEY_END:
        if (arguments->faults && !arguments->selftest)
            argp_error(state, "--faults goes with --selftest");
        if (arguments->selftest && arguments->options.resume)
            argp_error(state, "--selftest runs too often to be resumed");
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

int gn_command_run(int argc, char **argv)
{
    static const struct argp_child children[] = {{&gn_run_options_argp, 0, NULL, 0}, {0}};
    static const struct argp argp = {
        argp_options,
        parse,
        NULL,
        "Traces rays on a Vulkan driver and judges every answer against exact arithmetic.\v"
        "A FILTER is the name of a case, in which * stands for any characters: 'query.flags.*'. Without one every case "
        "runs. Written to DIR: report.html, results.jsonl, results.csv, junit.xml.\n\n"
        "Exit status: 0 as expected, 1 failures, 2 wrong usage or bad input, 3 the harness itself failed or was "
        "interrupted, 4 nothing ran.",
        children,
        NULL,
        NULL};
    if (argc > 1 && strcmp(argv[1], "fuzz") == 0) {
        static char title[] = "gnomon run fuzz";
        argv[1] = title;
        return gn_command_fuzz(argc - 1, argv + 1);
    }
    struct arguments arguments = {0};
    struct gn_run_options *options = &arguments.options;
    struct gn_run_plan plan = {0};
    struct gn_results results;
    char error[1024];
    gn_results_init(&results);
    gn_run_options_init(options, argc, &results.arena);
    int exit_status = 2;
    if (argp_parse(&argp, argc, argv, 0, NULL, &arguments) != 0)
        goto done;
    exit_status = gn_run_plan_make(&plan, options, &results);
    if (!plan.empty_shard && (exit_status != 0 || !plan.count))
        goto done;
    const char *driver = gn_driver_resolve(options->driver, &results.arena, error, sizeof error);
    if (!driver) {
        fprintf(stderr, "gnomon: %s\n", error);
        exit_status = 2;
        goto done;
    }
    exit_status = arguments.selftest && !plan.empty_shard
                      ? gn_selftest_run(options, &plan, driver, arguments.faults ? arguments.faults : "*")
                      : gn_run_plan_run(&plan, options, driver, options->out, gn_run_typed(&results.arena, argc, argv),
                                        &results);
done:
    gn_run_plan_finish(&plan);
    gn_results_finish(&results);
    return exit_status;
}
