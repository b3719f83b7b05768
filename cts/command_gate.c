/* SPDX-License-Identifier: Apache-2.0 */
/* `gnomon gate`: run, compare with what is expected and with another driver, decide. */
#include <dirent.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cts/arguments.h"
#include "cts/commands.h"
#include "cts/driver.h"
#include "cts/gate.h"
#include "cts/output.h"
#include "cts/progress.h"
#include "cts/run_options.h"

enum { OPTION_AGAINST = 512, OPTION_UPDATE, OPTION_TIME_BUDGET, OPTION_RERUNS, OPTION_NO_TIMES };

struct gate_options {
    struct gn_run_options run;
    const char *against;
    double budget;
    uint32_t reruns;
    bool update, no_times;
};

static const struct argp_option argp_options[] = {
    {"against", OPTION_AGAINST, "ICD.json|NAME", 0, "The old driver: what is worse than on it counts", 0},
    {"update", OPTION_UPDATE, NULL, 0, "Rewrite the --expect files (not flakes and skips) to what came out", 0},
    {"time-budget", OPTION_TIME_BUDGET, "X", 0,
     "How much slower or larger than with the old driver is too much (default: 1.3x)", 0},
    {"reruns", OPTION_RERUNS, "N", 0, "How often a case that counts, or answers otherwise, is run again (default: 3)", 0},
    {"no-times", OPTION_NO_TIMES, NULL, 0, "Measure neither time nor memory", 0},
    {0},
};

static error_t parse(int key, char *argument, struct argp_state *state)
{
    struct gate_options *options = state->input;
    char *end;
    switch (key) {
    case ARGP_KEY_INIT:
        state->child_inputs[0] = &options->run;
        return 0;
    case OPTION_AGAINST:
        options->against = argument;
        return 0;
    case OPTION_UPDATE:
        options->update = true;
        return 0;
    case OPTION_TIME_BUDGET:
        options->budget = strtod(argument, &end);
        if (end == argument || (*end && strcmp(end, "x") != 0) || !(options->budget >= 1 && options->budget <= 1000))
            argp_error(state, "--time-budget: expected a factor such as 1.3x, from 1 to 1000, found '%s'", argument);
        return 0;
    case OPTION_RERUNS:
        options->reruns = (uint32_t)gn_argument_number(state, "--reruns", argument, 0, 100);
        return 0;
    case OPTION_NO_TIMES:
        options->no_times = true;
        return 0;
    case ARGP_KEY_END:
        if (options->update && !options->run.expect_count)
            argp_error(state, "--update: expected --expect and the file to write");
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

static bool ends_with(const char *text, const char *end)
{
    size_t length = strlen(text), end_length = strlen(end);
    return length >= end_length && strcmp(text + length - end_length, end) == 0;
}

static bool is_statuses(const char *path)
{
    return !ends_with(path, "-flakes.txt") && !ends_with(path, "-skips.txt");
}

/* With --update a file that does not exist is one that is to be made. */
static void leave_out_missing(struct gn_run_options *run)
{
    size_t kept = 0;
    for (size_t i = 0; i < run->expect_count; i++)
        if (access(run->expects[i], F_OK) == 0)
            run->expects[kept++] = run->expects[i];
    run->expect_count = kept;
}

/* Rewrites the files. New failures go into the last. False when one cannot be written. */
static bool update_files(const struct gn_run_plan *plan, const char *const *paths, size_t count, struct gn_results *results)
{
    char error[1024];
    for (size_t i = count; i-- > 0;) {
        struct gn_expectations_changes changes;
        if (!is_statuses(paths[i]))
            continue;
        if (!gn_expectations_update(paths[i], &plan->expectations, results, plan->catalogue, plan->catalogue_count,
                                    &changes, error, sizeof error)) {
            fprintf(stderr, "gnomon: --update: %s\n", error);
            return false;
        }
        printf("%s: %zu added, %zu changed, %zu removed\n", paths[i], changes.added, changes.changed, changes.removed);
        /* What has been added is expected from here on. */
        for (size_t c = 0; c < results->count; c++)
            if (results->cases[c].outcome != GN_OUTCOME_AS_EXPECTED)
                results->cases[c].outcome = GN_OUTCOME_EXPECTED_FAILURE;
    }
    return true;
}

#define ANSWERS "answers-by-gnomon-"

/* The folders of answers in OUT, one of a gate that was killed included, with the files that workers write and no other. */
static void remove_answers(const char *out)
{
    char folder[4096], path[4096 + 256];
    DIR *list = opendir(out), *answers;
    struct dirent *entry;
    while (list && (entry = readdir(list))) {
        if (strncmp(entry->d_name, ANSWERS, sizeof ANSWERS - 1) != 0)
            continue;
        snprintf(folder, sizeof folder, "%s/%s", out, entry->d_name);
        answers = opendir(folder);
        while (answers && (entry = readdir(answers))) {
            snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
            if (ends_with(path, ".kept") || ends_with(path, ".changed") || ends_with(path, ".part"))
                unlink(path);
        }
        if (answers)
            closedir(answers);
        rmdir(folder);
    }
    if (list)
        closedir(list);
}

/*
 * One run of the plan, its reports in OUT/NAME. `answers`, or NULL, is the folder in which the first run leaves what the
 * second one need not find out again.
 */
static int run_driver(const struct gate_options *options, const struct gn_run_plan *plan, const char *driver,
                      const char *typed, const char *answers, bool first, struct gn_results *results)
{
    struct gn_run_options run = options->run;
    const char *variable = first ? "GNOMON_ANSWERS_KEPT" : "GNOMON_ANSWERS_KNOWN";
    const char *out = gn_arena_printf(&results->arena, "%s/%s", run.out, first ? "new" : "old");
    const char *begun = gn_arena_printf(&results->arena, "%s/run.json", out);
    run.quiet = true;
    if (!first) {
        /* What the old driver fails at is no reason to stop; and a gate killed in its first half has nothing here to go on with. */
        run.max_fails = 0;
        run.resume = run.resume && access(begun, F_OK) == 0;
    }
    if (answers)
        setenv(variable, answers, 1);
    int status = gn_run_plan_run(plan, &run, driver, out, typed, results);
    unsetenv(variable);
    return status;
}

/* Whether a run came to its end; that every case was skipped is an end as well. */
static bool judged(int status, const struct gn_results *results)
{
    return status <= 1 || (status == 4 && results->count);
}

static int run_gate(struct gate_options *options, struct gn_run_plan *plan, const char *typed, struct gn_results *now)
{
    char error[1024], answers[4096];
    const char *kept = NULL; /* `answers`, where there is such a folder */
    int lock = 0;
    double started = gn_clock();
    struct gn_results before;
    struct gn_gate gate = {.now = now, .expects = plan->expectations.count > 0, .budget = options->budget};
    struct gn_run_plan before_plan = *plan;
    int status = 2;
    gn_results_init(&before);
    gate.now_driver = options->run.driver ? options->run.driver : "lavapipe";
    gate.before_driver = options->against;
    const char *driver = gn_driver_resolve(options->run.driver, &now->arena, error, sizeof error), *against = NULL;
    if (driver && options->against)
        against = gn_driver_resolve(options->against, &now->arena, error, sizeof error);
    if (!driver || (options->against && !against)) {
        fprintf(stderr, "gnomon: %s\n", error);
        goto done;
    }
    if (!gn_folder_create(options->run.out, error, sizeof error) ||
        !gn_folder_lock(options->run.out, &lock, error, sizeof error)) {
        fprintf(stderr, "gnomon: %s\n", error);
        goto done;
    }
    remove_answers(options->run.out);
    if (against) {
        snprintf(answers, sizeof answers, "%s/" ANSWERS "XXXXXX", options->run.out);
        kept = mkdtemp(answers);
    }
    if (against && !options->run.resume) {
        /* An earlier gate's, which --resume must not take for what the one to come has begun. */
        char begun[4096];
        snprintf(begun, sizeof begun, "%s/old/run.json", options->run.out);
        unlink(begun);
    }
    status = run_driver(options, plan, driver, typed, kept, true, now);
    if (!judged(status, now))
        goto done;
    if (against) {
        /* Nothing is expected of the old driver: it is what the new one is held against. Skips hold for both. */
        before_plan.expectations = plan->expectations;
        before_plan.expectations.device = NULL;
        status = run_driver(options, &before_plan, against, typed, kept, false, &before);
        if (!judged(status, &before))
            goto done;
        gate.before = &before;
    }
    gn_gate_compare(&gate, kept);
    double compared = gn_clock();
    gn_gate_rerun(&gate, driver, options->reruns);
    if (against)
        gn_gate_vary(&gate, driver, against, options->reruns);
    gate.rerun_seconds = gn_clock() - compared;
    if (against && !options->no_times && !gn_gate_measure(&gate, driver, against, error, sizeof error)) {
        fprintf(stderr, "gnomon: %s\n", error);
        status = 3;
        goto done;
    }
    gate.seconds = gn_clock() - started;
    status = gn_gate_exit_status(&gate);
    if (!gn_gate_write(&gate, options->run.out, error, sizeof error)) {
        fprintf(stderr, "gnomon: %s\n", error);
        status = 3;
    }
    gn_gate_print(&gate, options->run.out);
done:
    if (lock) {
        remove_answers(options->run.out);
        close(lock);
    }
    gn_gate_finish(&gate);
    gn_results_finish(&before);
    return status;
}

int gn_command_gate(int argc, char **argv)
{
    static const struct argp_child children[] = {{&gn_run_options_argp, 0, "As for `gnomon run`:", 1}, {0}};
    static const struct argp argp = {
        argp_options,
        parse,
        NULL,
        "May this driver change land? Runs the suite, holds it against expectation files (--expect) or another driver "
        "(--against) or both, measures time and memory of both drivers in turns, and decides.\v"
        "Written to DIR: gate.html, gate.md, gate.json, gate.sarif, and the reports of the runs in new/ and old/.\n\n"
        "Exit status: 0 it may land, 1 it may not, 2 wrong usage or bad input, 3 the harness itself failed or was "
        "interrupted, 4 nothing ran.",
        children,
        NULL,
        NULL};
    struct gate_options options = {.budget = 1.3, .reruns = 3};
    struct gn_run_plan plan = {0};
    struct gn_results results;
    gn_results_init(&results);
    gn_run_options_init(&options.run, argc, &results.arena);
    options.run.out = "gnomon-gate";
    int exit_status = 2;
    if (argp_parse(&argp, argc, argv, 0, NULL, &options) != 0)
        goto done;
    const char **paths = GN_NEW(&results.arena, const char *, (size_t)argc);
    size_t path_count = options.run.expect_count;
    memcpy(paths, options.run.expects, path_count * sizeof *paths);
    if (options.update)
        leave_out_missing(&options.run);
    exit_status = gn_run_plan_make(&plan, &options.run, &results);
    if (exit_status != 0 || !plan.count)
        goto done;
    exit_status = run_gate(&options, &plan, gn_run_typed(&results.arena, argc, argv), &results);
    if (exit_status <= 1 && options.update && !update_files(&plan, paths, path_count, &results))
        exit_status = 3;
done:
    gn_run_plan_finish(&plan);
    gn_results_finish(&results);
    return exit_status;
}
