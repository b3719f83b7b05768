/* SPDX-License-Identifier: Apache-2.0 */
/* The options that every command which runs cases has, and what they come to. */
#include "cts/run_options.h"

#include <math.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include <xxhash.h>

#include "cts/arguments.h"
#include "cts/commands.h"
#include "cts/output.h"
#include "cts/progress.h"

enum {
    OPTION_DRIVER = 256,
    OPTION_BACKEND,
    OPTION_OUT,
    OPTION_JOBS,
    OPTION_SHARD,
    OPTION_SEED,
    OPTION_RESUME,
    OPTION_DURATIONS,
    OPTION_LIST,
    OPTION_EXPECT,
    OPTION_SCALE,
    OPTION_TIMEOUT,
    OPTION_MAX_FAILS,
};

static const struct argp_option argp_options[] = {
    {"driver", OPTION_DRIVER, "ICD.json|NAME", 0,
     "The driver: the path of its ICD file, or lavapipe (the default, unless VK_DRIVER_FILES chooses)", 0},
    {"backend", OPTION_BACKEND, "NAME", 0,
     "How rays are traced: query (ray queries), pipeline (ray tracing pipelines) or all (the default): what the device "
     "lacks is skipped",
     0},
    {"out", OPTION_OUT, "DIR", 0, "Where the reports go (default: gnomon-out)", 0},
    {"jobs", OPTION_JOBS, "N", 0, "How many worker processes (default: one per CPU)", 0},
    {"seed", OPTION_SEED, "S", 0, "Seed of the random scenes and rays, up to 2^64-1 (default: 1)", 0},
    {"scale", OPTION_SCALE, "X", 0, "Trace X times as many rays in the cases that allow it (default: 1)", 0},
    {"timeout", OPTION_TIMEOUT, "SECONDS", 0,
     "For one case (default: 60); a worker that exceeds it is killed", 0},
    {"max-fails", OPTION_MAX_FAILS, "N", 0, "Stop after N failures", 0},
    {"shard", OPTION_SHARD, "I/N", 0, "Only the I-th of N parts of the cases, by the hash of their names", 0},
    {"durations", OPTION_DURATIONS, "FILE", 0,
     "Shards that take equally long, by the results.jsonl of an earlier run; the same file for all of them", 0},
    {"resume", OPTION_RESUME, NULL, 0, "Go on with an interrupted run in the same folder", 0},
    {"list", OPTION_LIST, NULL, 0, "Print the names of the cases and run none", 0},
    {"expect", OPTION_EXPECT, "FILE", 0,
     "Expected failures, as deqp-runner writes them: `name,Status`, # and the reason. May be repeated", 0},
    {0},
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

static void parse_shard(struct argp_state *state, const char *text, struct gn_run_options *options)
{
    unsigned index, count;
    int used = 0;
    if (sscanf(text, "%9u/%9u%n", &index, &count, &used) != 2 || text[used] || text[0] == '-' || index < 1 ||
        index > count)
        argp_error(state, "--shard: expected I/N with 1 <= I <= N, such as 2/4, found '%s'", text);
    options->shard = index;
    options->shard_count = count;
}

static error_t parse(int key, char *argument, struct argp_state *state)
{
    struct gn_run_options *options = state->input;
    switch (key) {
    case OPTION_DRIVER:
        options->driver = argument;
        break;
    case OPTION_BACKEND:
        if (strcmp(argument, "query") != 0 && strcmp(argument, "pipeline") != 0 && strcmp(argument, "all") != 0)
            argp_error(state, "--backend: expected query, pipeline or all, found '%s'", argument);
        options->backend = argument;
        break;
    case OPTION_OUT:
        if (!*argument)
            argp_error(state, "--out: expected a folder, found nothing");
        options->out = argument;
        break;
    case OPTION_JOBS:
        options->jobs = (uint32_t)gn_argument_number(state, "--jobs", argument, 1, 1024);
        break;
    case OPTION_SHARD:
        parse_shard(state, argument, options);
        break;
    case OPTION_SEED:
        options->seed = gn_argument_number(state, "--seed", argument, 0, UINT64_MAX);
        break;
    case OPTION_DURATIONS:
        options->durations = argument;
        break;
    case OPTION_RESUME:
        options->resume = true;
        break;
    case OPTION_LIST:
        options->list = true;
        break;
    case OPTION_EXPECT:
        options->expects[options->expect_count++] = argument;
        break;
    case OPTION_SCALE:
        options->scale = parse_real(state, "--scale", argument, 1e-3, 1e3);
        break;
    case OPTION_TIMEOUT:
        options->timeout = parse_real(state, "--timeout", argument, 0.1, 86400);
        break;
    case OPTION_MAX_FAILS:
        options->max_fails = gn_argument_number(state, "--max-fails", argument, 1, UINT32_MAX);
        break;
    case ARGP_KEY_ARG:
        options->filters[options->filter_count++] = argument;
        break;
    default:
        return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

const struct argp gn_run_options_argp = {argp_options, parse, "[FILTER...]", NULL, NULL, NULL, NULL};

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

const char *gn_run_typed(struct gn_arena *arena, int argc, char **argv)
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

void gn_run_options_init(struct gn_run_options *options, int argc, struct gn_arena *arena)
{
    *options = (struct gn_run_options){.backend = "all",
                                       .out = "gnomon-out",
                                       .jobs = default_jobs(),
                                       .seed = 1,
                                       .shard = 1,
                                       .shard_count = 1,
                                       .scale = 1,
                                       .timeout = 60,
                                       .filters = GN_NEW(arena, const char *, (size_t)argc),
                                       .expects = GN_NEW(arena, const char *, (size_t)argc)};
}

/* Keeps the cases of the backend, and those that have none; gives their number. */
static size_t select_backend(struct gn_selected *cases, size_t count, const char *backend)
{
    size_t kept = 0;
    for (size_t i = 0; i < count; i++)
        if (strcmp(backend, "all") == 0 || cases[i].backend == GN_CASE_NEITHER ||
            strcmp(backend, gn_case_backend_name(cases[i].backend)) == 0)
            cases[kept++] = cases[i];
    return kept;
}

/* Parts the cases as --shard and --durations say. */
static bool take_shard(struct gn_selected *cases, size_t *inout_count, const struct gn_run_options *options,
                       struct gn_results_run *run, char *out_error, size_t error_size)
{
    struct gn_results durations;
    char *data = NULL;
    size_t length = 0;
    if (options->shard_count <= 1)
        return true;
    gn_results_init(&durations);
    if (options->durations) {
        bool ok = gn_file_read(options->durations, (size_t)1 << 30, &data, &length, out_error, error_size) &&
                  gn_results_jsonl_read(&durations, options->durations, out_error, error_size);
        run->durations = ok ? XXH64(data, length, 0) : 0;
        free(data);
        if (!ok) {
            gn_results_finish(&durations);
            return false;
        }
    }
    *inout_count = gn_shard(cases, *inout_count, options->shard, options->shard_count,
                            options->durations ? &durations : NULL);
    gn_results_finish(&durations);
    return true;
}

int gn_run_plan_make(struct gn_run_plan *plan, const struct gn_run_options *options, struct gn_results *results)
{
    char error[1024];
    *plan = (struct gn_run_plan){0};
    plan->catalogue = gn_catalogue(&results->arena, &plan->catalogue_count);
    plan->cases = gn_catalogue(&results->arena, &plan->catalogue_count);
    size_t count = select_backend(plan->cases, plan->catalogue_count, options->backend);
    count = gn_select(plan->cases, count, options->filters, options->filter_count, error, sizeof error);
    if (count == SIZE_MAX) {
        fprintf(stderr, "gnomon: nothing ran: %s\n", error);
        return 4;
    }
    results->run.selection = gn_catalogue_digest(plan->cases, count);
    if (!take_shard(plan->cases, &count, options, &results->run, error, sizeof error)) {
        fprintf(stderr, "gnomon: --durations: %s\n", error);
        return 2;
    }
    results->run.suite = gn_catalogue_digest(plan->catalogue, plan->catalogue_count);
    if (options->list) {
        for (size_t i = 0; i < count; i++)
            printf("%s\n", plan->cases[i].name);
        return fflush(stdout) == 0 ? 0 : 3;
    }
    plan->empty_shard = !count;
    if (!count) {
        fprintf(stderr, "gnomon: nothing ran: no case is in shard %u/%u\n", options->shard, options->shard_count);
        return 4;
    }
    for (size_t i = 0; i < options->expect_count; i++) {
        if (!gn_expectations_read(&plan->expectations, options->expects[i], &results->arena, error, sizeof error)) {
            fprintf(stderr, "gnomon: --expect: %s\n", error);
            return 2;
        }
    }
    gn_expectations_check(&plan->expectations, plan->catalogue, plan->catalogue_count, results);
    plan->count = count;
    return 0;
}

void gn_run_plan_finish(struct gn_run_plan *plan)
{
    gn_expectations_finish(&plan->expectations);
    free(plan->catalogue);
    free(plan->cases);
    *plan = (struct gn_run_plan){0};
}

/* Gives the exit status. */
static int write_empty_shard(const char *out, struct gn_results *results)
{
    struct gn_output output = {0};
    struct gn_results earlier;
    char error[1024];
    int status = 2;
    gn_results_init(&earlier);
    results->run.jobs = 0;
    bool ok = gn_output_open(&output, out, &earlier, &status, error, sizeof error) &&
              gn_output_begin(&output, results, false, &status, error, sizeof error);
    if (ok)
        status = gn_output_end(&output, results, error, sizeof error) ? 4 : 3;
    if (status != 4)
        fprintf(stderr, "gnomon: %s\n", error);
    gn_output_close(&output);
    gn_results_finish(&earlier);
    return status;
}

int gn_run_plan_run(const struct gn_run_plan *plan, const struct gn_run_options *options, const char *driver,
                    const char *out, const char *typed, struct gn_results *results)
{
    struct gn_results_run *run = &results->run;
    run->started = utc_now(&results->arena);
    run->driver = driver;
    run->backend = options->backend;
    run->command = gn_command_name;
    run->options = typed;
    run->environment = describe_environment(&results->arena);
    run->seed = options->seed;
    run->scale = options->scale;
    run->timeout = options->timeout;
    run->jobs = options->jobs;
    run->shard = options->shard;
    run->shard_count = options->shard_count;
    if (plan->empty_shard)
        return write_empty_shard(out, results);
    struct gn_runner_options runner = {.out = out,
                                       .expectations = &plan->expectations,
                                       .max_fails = options->max_fails,
                                       .quiet = options->quiet,
                                       .resume = options->resume};
    return gn_runner_run(&runner, plan->cases, plan->count, results);
}
