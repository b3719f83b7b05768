/* SPDX-License-Identifier: Apache-2.0 */
/* `gnomon run`: its options, what they select, and the run. */
#include <argp.h>
#include <math.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "cts/arguments.h"
#include "cts/commands.h"
#include "cts/driver.h"
#include "cts/progress.h"
#include "cts/runner.h"

const char *gn_command_name = "gnomon";

enum {
    OPTION_DRIVER = 256,
    OPTION_BACKEND,
    OPTION_OUT,
    OPTION_JOBS,
    OPTION_SHARD,
    OPTION_SEED,
    OPTION_RESUME,
    OPTION_LIST,
    OPTION_EXPECT,
    OPTION_SELFTEST,
    OPTION_SCALE,
    OPTION_TIMEOUT,
    OPTION_MAX_FAILS,
};

static const struct argp_option options[] = {
    {"driver", OPTION_DRIVER, "ICD.json|NAME", 0,
     "The driver: the path of its ICD file, or lavapipe (the default, unless VK_DRIVER_FILES chooses)", 0},
    {"backend", OPTION_BACKEND, "NAME", 0,
     "How rays are traced: query or all (pipeline is not in this version)", 0},
    {"out", OPTION_OUT, "DIR", 0, "Where the reports go (default: gnomon-out)", 0},
    {"jobs", OPTION_JOBS, "N", 0, "How many worker processes (default: one per CPU)", 0},
    {"seed", OPTION_SEED, "S", 0, "Seed of the random scenes and rays, up to 2^64-1 (default: 1)", 0},
    {"scale", OPTION_SCALE, "X", 0, "Trace X times as many rays in the cases that allow it (default: 1)", 0},
    {"timeout", OPTION_TIMEOUT, "SECONDS", 0,
     "For one case (default: 60); a worker that exceeds it is killed", 0},
    {"max-fails", OPTION_MAX_FAILS, "N", 0, "Stop after N failures", 0},
    {"shard", OPTION_SHARD, "I/N", 0, "Only the I-th of N parts of the cases, by the hash of their names", 0},
    {"resume", OPTION_RESUME, NULL, 0, "Go on with an interrupted run in the same folder", 0},
    {"list", OPTION_LIST, NULL, 0, "Print the names of the cases and run none", 0},
    {"expect", OPTION_EXPECT, "FILE", 0,
     "Expected failures, as deqp-runner writes them: `name,Status`, # and the reason. May be repeated", 0},
    {"selftest", OPTION_SELFTEST, NULL, OPTION_HIDDEN, NULL, 0},
    {0},
};

struct arguments {
    const char *driver, *out;
    uint32_t jobs, shard, shard_count;
    uint64_t seed, max_fails;
    double scale, timeout;
    bool resume, list;
    const char **filters;
    size_t filter_count;
    const char **expects;
    size_t expect_count;
};

static double parse_real(struct argp_state *state, const char *option, const char *text, double least,
                         double most)
{
    char *end;
    double value = strtod(text, &end);
    if (end == text || *end || !(value >= least && value <= most))
        argp_error(state, "%s: expected a number from %g to %g, found '%s'", option, least, most, text);
    return value;
}

static void parse_shard(struct argp_state *state, const char *text, struct arguments *arguments)
{
    unsigned index, count;
    int used = 0;
    if (sscanf(text, "%9u/%9u%n", &index, &count, &used) != 2 || text[used] || text[0] == '-' || index < 1 ||
        index > count)
        argp_error(state, "--shard: expected I/N with 1 <= I <= N, such as 2/4, found '%s'", text);
    arguments->shard = index;
    arguments->shard_count = count;
}

static error_t parse(int key, char *argument, struct argp_state *state)
{
    struct arguments *arguments = state->input;
    switch (key) {
    case OPTION_DRIVER:
        arguments->driver = argument;
        break;
    case OPTION_BACKEND:
        if (strcmp(argument, "pipeline") == 0)
            argp_error(state, "--backend pipeline is not in this version; query is");
        if (strcmp(argument, "query") != 0 && strcmp(argument, "all") != 0)
            argp_error(state, "--backend: expected query or all, found '%s'", argument);
        break;
    case OPTION_OUT:
        if (!*argument)
            argp_error(state, "--out: expected a folder, found nothing");
        arguments->out = argument;
        break;
    case OPTION_JOBS:
        arguments->jobs = (uint32_t)gn_argument_number(state, "--jobs", argument, 1, 1024);
        break;
    case OPTION_SHARD:
        parse_shard(state, argument, arguments);
        break;
    case OPTION_SEED:
        arguments->seed = gn_argument_number(state, "--seed", argument, 0, UINT64_MAX);
        break;
    case OPTION_RESUME:
        arguments->resume = true;
        break;
    case OPTION_LIST:
        arguments->list = true;
        break;
    case OPTION_EXPECT:
        arguments->expects[arguments->expect_count++] = argument;
        break;
    case OPTION_SELFTEST:
        argp_error(state, "--selftest is not in this version");
        break;
    case OPTION_SCALE:
        arguments->scale = parse_real(state, "--scale", argument, 1e-3, 1e3);
        break;
    case OPTION_TIMEOUT:
        arguments->timeout = parse_real(state, "--timeout", argument, 0.1, 86400);
        break;
    case OPTION_MAX_FAILS:
        arguments->max_fails = gn_argument_number(state, "--max-fails", argument, 1, UINT32_MAX);
        break;
    case ARGP_KEY_ARG:
        arguments->filters[arguments->filter_count++] = argument;
        break;
    default:
        return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

static uint32_t default_jobs(void)
{
    cpu_set_t set;
    long online = sysconf(_SC_NPROCESSORS_ONLN);
    if (sched_getaffinity(0, sizeof set, &set) == 0)
        return (uint32_t)CPU_COUNT(&set);
    return online > 0 && online < 1024 ? (uint32_t)online : 1;
}

/* The variables that steer the loader and Mesa: what was tested is the driver with these. */
static const char *describe_environment(struct gn_arena *arena)
{
    static const char *const prefixes[] = {"VK_", "LP_", "GALLIVM_", "MESA_", "ANV_", "RADV_", "TU_", "NVK_"};
    extern char **environ;
    const char *text = "";
    for (char **variable = environ; *variable; variable++)
        for (size_t i = 0; i < sizeof prefixes / sizeof prefixes[0]; i++)
            if (strncmp(*variable, prefixes[i], strlen(prefixes[i])) == 0)
                text = gn_arena_printf(arena, "%s%s%s", text, *text ? " " : "", *variable);
    return text;
}

static const char *describe_options(struct gn_arena *arena, int argc, char **argv)
{
    const char *text = "";
    for (int i = 1; i < argc; i++) {
        char *quoted = gn_shell_quote(argv[i]);
        text = gn_arena_printf(arena, "%s%s%s", text, *text ? " " : "", quoted ? quoted : argv[i]);
        free(quoted);
    }
    return text;
}

static const char *utc_now(struct gn_arena *arena)
{
    char text[32];
    struct tm parts;
    time_t now = time(NULL);
    gmtime_r(&now, &parts);
    strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &parts);
    return gn_arena_printf(arena, "%s", text);
}

static int run_selected(const struct arguments *arguments, const struct gn_expectations *expectations,
                        const struct gn_selected *cases, size_t count, const char *typed,
                        struct gn_results *results)
{
    char error[1024];
    const char *driver = gn_driver_resolve(arguments->driver, &results->arena, error, sizeof error);
    if (!driver) {
        fprintf(stderr, "gnomon: %s\n", error);
        return 2;
    }
    struct gn_results_run *run = &results->run;
    run->started = utc_now(&results->arena);
    run->driver = driver;
    run->backend = "query";
    run->command = gn_command_name;
    run->options = typed;
    run->environment = describe_environment(&results->arena);
    run->seed = arguments->seed;
    run->scale = arguments->scale;
    run->timeout = arguments->timeout;
    run->jobs = arguments->jobs;
    run->shard = arguments->shard;
    run->shard_count = arguments->shard_count;
    struct gn_runner_options runner = {arguments->out, expectations, arguments->max_fails, arguments->resume};
    return gn_runner_run(&runner, cases, count, results);
}

int gn_command_run(int argc, char **argv)
{
    static const struct argp argp = {
        options,
        parse,
        "[FILTER...]",
        "Traces rays on a Vulkan driver and judges every answer against exact arithmetic.\v"
        "A FILTER is the name of a case, in which * stands for any characters: 'query.flags.*'. Without one "
        "every "
        "case runs. Written to DIR: report.html, results.jsonl, results.csv, junit.xml.\n\n"
        "Exit status: 0 as expected, 1 failures, 2 wrong usage or bad input, 3 the harness itself failed or "
        "was "
        "interrupted, 4 nothing ran.",
        NULL,
        NULL,
        NULL};
    struct arguments arguments = {
        .out = "gnomon-out", .seed = 1, .shard = 1, .shard_count = 1, .scale = 1, .timeout = 60};
    struct gn_expectations expectations = {0};
    struct gn_results results;
    char error[1024];
    size_t catalogue_count = 0;
    int exit_status = 2;
    gn_results_init(&results);
    struct gn_selected *catalogue = gn_catalogue(&results.arena, &catalogue_count);
    struct gn_selected *cases = gn_catalogue(&results.arena, &catalogue_count);
    const char *typed = describe_options(&results.arena, argc, argv);
    arguments.filters = GN_NEW(&results.arena, const char *, (size_t)argc);
    arguments.expects = GN_NEW(&results.arena, const char *, (size_t)argc);
    arguments.jobs = default_jobs();
    if (argp_parse(&argp, argc, argv, 0, NULL, &arguments) != 0)
        goto done;

    size_t count = gn_select(cases, catalogue_count, arguments.filters, arguments.filter_count,
                             arguments.shard, arguments.shard_count, error, sizeof error);
    if (count == SIZE_MAX) {
        fprintf(stderr, "gnomon: nothing ran: %s\n", error);
        exit_status = 4;
        goto done;
    }
    if (arguments.list) {
        for (size_t i = 0; i < count; i++)
            printf("%s\n", cases[i].name);
        exit_status = fflush(stdout) == 0 ? 0 : 3;
        goto done;
    }
    if (!count) {
        fprintf(stderr, "gnomon: nothing ran: no case is in shard %u/%u\n", arguments.shard,
                arguments.shard_count);
        exit_status = 4;
        goto done;
    }
    for (size_t i = 0; i < arguments.expect_count; i++) {
        if (!gn_expectations_read(&expectations, arguments.expects[i], &results.arena, error, sizeof error)) {
            fprintf(stderr, "gnomon: --expect: %s\n", error);
            goto done;
        }
    }
    gn_expectations_check(&expectations, catalogue, catalogue_count, &results);
    exit_status = run_selected(&arguments, &expectations, cases, count, typed, &results);
done:
    gn_expectations_finish(&expectations);
    gn_results_finish(&results);
    free(catalogue);
    free(cases);
    return exit_status;
}
