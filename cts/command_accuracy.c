/* SPDX-License-Identifier: Apache-2.0 */
/* `gnomon accuracy`: its options, the measurement, and the files that show it. */
#include <argp.h>
#include <errno.h>
#include <limits.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "cts/accuracy_driver.h"
#include "cts/accuracy_layer.h"
#include "cts/arguments.h"
#include "cts/commands.h"
#include "cts/driver.h"
#include "cts/progress.h"
#include "cts/results.h"

enum {
    OPTION_SCENE = 256,
    OPTION_BUDGET,
    OPTION_OUT,
    OPTION_RAYS,
    OPTION_EXACT_RAYS,
    OPTION_RUNS,
    OPTION_THREADS,
    OPTION_JOBS,
    OPTION_SEED,
    OPTION_QUICK,
    OPTION_LIST,
    OPTION_DRIVER,
    OPTION_LAYER,
};

static const struct argp_option options[] = {
    {"scene", OPTION_SCENE, "NAME|FILE", 0,
     "A built-in scene or a model file (.obj, .ply, .gltf, .glb, .stl); may be repeated (default: every "
     "built-in one)",
     0},
    {"list", OPTION_LIST, NULL, 0, "Print the built-in scenes and measure nothing", 0},
    {"budget", OPTION_BUDGET, "1.2x", 0,
     "Name the most accurate tier within so many times the time of robust (default: 1.2x)", 0},
    {"out", OPTION_OUT, "DIR", 0, "Where the files go (default: gnomon-accuracy)", 0},
    {"rays", OPTION_RAYS, "N", 0, "Rays of each kind (default: 100000)", 0},
    {"exact-rays", OPTION_EXACT_RAYS, "N", 0,
     "At most so many rays of each kind for the exact tier (default: 2000)", 0},
    {"runs", OPTION_RUNS, "N", 0, "Timed runs, an odd number; the median counts (default: 5)", 0},
    {"threads", OPTION_THREADS, "N", 0, "Threads that trace while time is taken (default: 1)", 0},
    {"jobs", OPTION_JOBS, "N", 0, "Threads that judge the answers (default: one per CPU)", 0},
    {"seed", OPTION_SEED, "S", 0, "Seed of the scenes and rays, up to 2^48 (default: 1)", 0},
    {"quick", OPTION_QUICK, NULL, 0, "Small scenes and few rays: shows how it works, measures little", 0},
    {"driver", OPTION_DRIVER, "ICD|NAME", 0,
     "Measure this driver too: its time against its error over build flags, vertex formats and updates", 0},
    {"layer", OPTION_LAYER, NULL, 0,
     "Measure what the layer's levels cost an application, on that driver (default: as for `run`)", 0},
    {0},
};

struct arguments {
    struct gn_accuracy_options options;
    const char *out, *driver;
    const char **scenes;
    uint32_t scene_count;
    bool list, layer, rays_given, runs_given;
};

static error_t parse(int key, char *argument, struct argp_state *state)
{
    struct arguments *arguments = state->input;
    struct gn_accuracy_options *chosen = &arguments->options;
    switch (key) {
    case OPTION_SCENE:
        arguments->scenes[arguments->scene_count++] = argument;
        break;
    case OPTION_LIST:
        arguments->list = true;
        break;
    case OPTION_BUDGET:
        if (!gn_accuracy_budget_parse(argument, &chosen->budget))
            argp_error(state, "--budget: expected a factor such as 1.2x, found '%s'", argument);
        break;
    case OPTION_OUT:
        if (!*argument)
            argp_error(state, "--out: expected a folder, found nothing");
        arguments->out = argument;
        break;
    case OPTION_RAYS:
        chosen->rays = (uint32_t)gn_argument_number(state, "--rays", argument, 100, 20000000);
        arguments->rays_given = true;
        break;
    case OPTION_EXACT_RAYS:
        chosen->exact_rays = (uint32_t)gn_argument_number(state, "--exact-rays", argument, 1, 20000000);
        break;
    case OPTION_RUNS:
        chosen->runs = (uint32_t)gn_argument_number(state, "--runs", argument, 1, 15);
        if (chosen->runs % 2 == 0)
            argp_error(state, "--runs: expected an odd number, which has a median, found '%s'", argument);
        arguments->runs_given = true;
        break;
    case OPTION_THREADS:
        chosen->threads = (uint32_t)gn_argument_number(state, "--threads", argument, 1, 256);
        break;
    case OPTION_JOBS:
        chosen->jobs = (uint32_t)gn_argument_number(state, "--jobs", argument, 1, 256);
        break;
    case OPTION_SEED:
        chosen->seed = gn_argument_number(state, "--seed", argument, 0, UINT64_C(1) << 48);
        break;
    case OPTION_QUICK:
        chosen->quick = true;
        break;
    case OPTION_DRIVER:
        arguments->driver = argument;
        break;
    case OPTION_LAYER:
        arguments->layer = true;
        break;
    case ARGP_KEY_ARG:
        argp_error(state, "expected options only, found '%s'; a scene is named by --scene", argument);
        break;
    default:
        return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

static uint32_t default_jobs(void)
{
    cpu_set_t set;
    int count = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
    return count < 1 ? 1 : count > 256 ? 256 : (uint32_t)count;
}

static const char *processor(struct gn_arena *arena)
{
    char line[512];
    const char *name = "an unknown processor";
    FILE *file = fopen("/proc/cpuinfo", "re");
    while (file && fgets(line, sizeof line, file)) {
        char *colon = strchr(line, ':');
        if (strncmp(line, "model name", 10) != 0 || !colon)
            continue;
        colon[strcspn(colon, "\n")] = 0;
        name = gn_arena_printf(arena, "%s", colon + 1 + strspn(colon + 1, " "));
        break;
    }
    if (file)
        fclose(file);
    return name;
}

/*
 * A driver from another distribution needs that distribution's loader and C library, for the whole process. Does not
 * return where it does, but for a loader that cannot be started: then the driver cannot either, which is told later.
 */
static void restart_for_driver(const char *icd, int argc, char **argv, struct gn_arena *arena)
{
    static const char marker[] = "GNOMON_RESTARTED";
    struct gn_driver_loader loader = gn_driver_loader(icd, arena);
    char *own = GN_NEW(arena, char, PATH_MAX);
    if (!loader.loader || getenv(marker) || readlink("/proc/self/exe", own, PATH_MAX - 1) <= 0)
        return;
    const char **arguments = GN_NEW(arena, const char *, (size_t)argc + 6);
    int count = 0;
    arguments[count++] = "gnomon";
    arguments[count++] = "--library-path";
    arguments[count++] = loader.libraries;
    arguments[count++] = own;
    arguments[count++] = "accuracy";
    for (int i = 1; i < argc; i++)
        arguments[count++] = argv[i];
    setenv(marker, "1", 1);
    execv(loader.loader, (char *const *)(uintptr_t)arguments);
}

/* The progress: on a terminal one line that is updated, elsewhere a line per scene. */
struct progress {
    const struct gn_accuracy *accuracy;
    double *weights, done, total, started, shown;
    uint32_t scene;
    bool terminal;
};

static void tick(void *user, const char *doing, double share)
{
    struct progress *progress = user;
    double now = gn_clock(),
           part = (progress->done + progress->weights[progress->scene] * share) / progress->total;
    char left[32] = "", duration[32], text[256];
    if (!progress->terminal)
        return;
    if (part > 0.02)
        snprintf(left, sizeof left, "ETA %.20s",
                 gn_format_duration((now - progress->started) * (1 - part) / part, duration));
    snprintf(text, sizeof text, "[%u/%u] %3.0f %%  %s: %s  %s", progress->scene + 1,
             progress->accuracy->scene_count, 100 * part, progress->accuracy->scenes[progress->scene].name,
             doing, left);
    fprintf(stderr, "\r%.*s\033[K", gn_terminal_width(STDERR_FILENO) - 1, text);
    fflush(stderr);
}

/* Runs rsvg-convert, which draws the SVG file as a PNG. */
static bool convert(const char *svg, const char *png)
{
    fflush(NULL);
    pid_t pid = fork();
    if (pid == 0) {
        execlp("rsvg-convert", "rsvg-convert", "--zoom=2", "--background-color=white", "-o", png, svg,
               (char *)NULL);
        _exit(127);
    }
    int status = 0;
    while (pid > 0 && waitpid(pid, &status, 0) < 0 && errno == EINTR) {
    }
    return pid > 0 && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

static bool write_svg(const struct gn_accuracy *accuracy, const char *path, char *out_error,
                      size_t error_size)
{
    char *text = NULL;
    size_t length = 0;
    FILE *file = open_memstream(&text, &length);
    if (!file) {
        snprintf(out_error, error_size, "out of memory for %s", path);
        return false;
    }
    gn_accuracy_plot(file, accuracy, GN_ACCURACY_ALL_SCENES, true);
    return gn_file_write_stream(path, file, &text, &length, out_error, error_size);
}

static bool write_files(const struct gn_accuracy *accuracy, const char *out, struct gn_arena *arena,
                        char *out_error, size_t error_size)
{
    size_t length = 0;
    const char *svg = gn_arena_printf(arena, "%s/accuracy.svg", out);
    const char *png = gn_arena_printf(arena, "%s/accuracy.png", out);
    char *json = gn_accuracy_json(accuracy, &length);
    bool ok = json != NULL;
    if (!json)
        snprintf(out_error, error_size, "out of memory for accuracy.json");
    ok = ok &&
         gn_file_write(gn_arena_printf(arena, "%s/accuracy.json", out), json, length, out_error, error_size);
    free(json);
    ok = ok && write_svg(accuracy, svg, out_error, error_size);
    ok = ok && gn_accuracy_html_write(accuracy, gn_arena_printf(arena, "%s/accuracy.html", out), out_error,
                                      error_size);
    if (ok && !convert(svg, png)) {
        snprintf(out_error, error_size, "cannot draw %s: rsvg-convert is missing or failed", png);
        ok = false;
    }
    return ok;
}

/* Building and tracing a large scene takes longer, by the caches it misses. */
static double weight_of(const struct gn_accuracy_scene *scene, const struct gn_accuracy_options *chosen)
{
    return 1 + (double)scene->triangles * 4e-6 * (chosen->quick ? 0.1 : 1);
}

static int measure(struct gn_accuracy *accuracy, const char *out, struct gn_arena *arena)
{
    char error[1024], number[32];
    struct progress progress = {.accuracy = accuracy,
                                .weights = GN_NEW(arena, double, accuracy->scene_count),
                                .started = gn_clock(),
                                .terminal = isatty(STDERR_FILENO) && gn_terminal_width(STDERR_FILENO) > 20};
    for (uint32_t i = 0; i < accuracy->scene_count; i++)
        progress.total += progress.weights[i] = weight_of(&accuracy->scenes[i], &accuracy->options);
    for (uint32_t i = 0; i < accuracy->scene_count; i++) {
        struct gn_accuracy_scene *scene = &accuracy->scenes[i];
        progress.scene = i;
        if (!progress.terminal)
            fprintf(stderr, "[%u/%u] %s, after %s\n", i + 1, accuracy->scene_count, scene->name,
                    gn_format_duration(gn_clock() - progress.started, number));
        tick(&progress, "placing its triangles", 0);
        bool ok = gn_accuracy_scene_commit(scene, error, sizeof error) &&
                  gn_accuracy_measure(accuracy, i, tick, &progress, error, sizeof error);
        gn_accuracy_scene_finish(scene);
        if (progress.terminal)
            fputs("\r\033[K", stderr);
        if (!ok) {
            fprintf(stderr, "gnomon: %s\n", error);
            return 3;
        }
        progress.done += progress.weights[i];
        gn_accuracy_print_scene(stdout, accuracy, i);
        fflush(stdout);
    }
    accuracy->seconds = gn_clock() - progress.started;
    gn_accuracy_print_choice(stdout, accuracy);
    if (accuracy->driver)
        gn_accuracy_driver_print(stdout, accuracy);
    if (accuracy->layer)
        gn_accuracy_layer_print(stdout, accuracy);
    if (!write_files(accuracy, out, arena, error, sizeof error)) {
        fprintf(stderr, "gnomon: %s\n", error);
        return 3;
    }
    printf("\nWritten in %s: %s/accuracy.html, accuracy.json, accuracy.svg, accuracy.png\n",
           gn_format_duration(accuracy->seconds, number), out);
    return fflush(stdout) == 0 ? 0 : 3;
}

static int list_scenes(void)
{
    const char *name, *about;
    for (size_t i = 0; gn_accuracy_scene_describe(i, &name, &about); i++)
        printf("%-12s %s\n", name, about);
    return fflush(stdout) == 0 ? 0 : 3;
}

int gn_command_accuracy(int argc, char **argv)
{
    static const struct argp argp = {
        options,
        parse,
        NULL,
        "Measures what accuracy costs in time: every tier of the reference traces the same rays.\v"
        "The tiers are fast and robust (Embree's two modes), double (64-bit floats), certified (64-bit "
        "floats with an "
        "exact answer where they cannot decide) and exact (integers of any size). A wrong decision is a hit "
        "missed, a "
        "hit where there is none, or another primitive than the nearest.\n\n"
        "Exit status: 0 measured, 2 wrong usage or a model that cannot be read, 3 the harness itself failed.",
        NULL,
        NULL,
        NULL};
    struct arguments arguments = {.out = "gnomon-accuracy"};
    struct gn_arena arena = {0};
    struct gn_accuracy accuracy = {0};
    struct gn_accuracy_driver driver = {0};
    struct gn_accuracy_layer layer = {0};
    const char *icd = NULL;
    char error[1024];
    int exit_status = 2;
    arguments.options = (struct gn_accuracy_options){.rays = 100000,
                                                     .exact_rays = 2000,
                                                     .runs = 5,
                                                     .threads = 1,
                                                     .jobs = default_jobs(),
                                                     .seed = 1,
                                                     .budget = 1.2};
    arguments.scenes = GN_NEW(&arena, const char *, (size_t)argc + 32);
    if (argp_parse(&argp, argc, argv, 0, NULL, &arguments) != 0)
        goto done;
    if (arguments.list) {
        exit_status = list_scenes();
        goto done;
    }
    if (arguments.driver || arguments.layer) {
        icd = gn_driver_resolve(arguments.driver, &arena, error, sizeof error);
        if (!icd) {
            fprintf(stderr, "gnomon: --driver: %s\n", error);
            goto done;
        }
        restart_for_driver(icd, argc, argv, &arena);
    }
    if (arguments.options.quick) {
        if (!arguments.rays_given)
            arguments.options.rays = 2000;
        if (!arguments.runs_given)
            arguments.options.runs = 3;
        if (arguments.options.exact_rays > 100)
            arguments.options.exact_rays = 100;
    }
    if (!arguments.scene_count) {
        const char *about;
        while (gn_accuracy_scene_describe(arguments.scene_count, &arguments.scenes[arguments.scene_count],
                                          &about))
            arguments.scene_count++;
    }
    accuracy.options = arguments.options;
    accuracy.scene_count = arguments.scene_count;
    accuracy.scenes = GN_NEW(&arena, struct gn_accuracy_scene, arguments.scene_count);
    accuracy.machine = processor(&arena);
    time_t now = time(NULL);
    struct tm parts;
    char started[32];
    gmtime_r(&now, &parts);
    strftime(started, sizeof started, "%Y-%m-%dT%H:%M:%SZ", &parts);
    accuracy.started = started;
    /* All scenes first: a misspelt one is to be told before minutes of measuring. */
    for (uint32_t i = 0; i < accuracy.scene_count; i++) {
        if (!gn_accuracy_scene_load(&accuracy.scenes[i], arguments.scenes[i], accuracy.options.quick,
                                    accuracy.options.seed, &arena, &exit_status, error, sizeof error)) {
            fprintf(stderr, "gnomon: --scene: %s\n", error);
            goto done;
        }
    }
    if (!gn_folder_create(arguments.out, error, sizeof error)) {
        fprintf(stderr, "gnomon: --out: %s\n", error);
        exit_status = 2;
        goto done;
    }
    /* First, because it forks, which is for a process without threads. */
    if (arguments.driver) {
        if (!gn_accuracy_driver_measure(&accuracy, icd, &arena, &driver, &exit_status, error, sizeof error)) {
            fprintf(stderr, "gnomon: --driver: %s\n", error);
            goto done;
        }
        accuracy.driver = &driver;
    }
    if (arguments.layer) {
        if (!gn_accuracy_layer_measure(&accuracy, icd, &arena, &layer, error, sizeof error)) {
            fprintf(stderr, "gnomon: --layer: %s\n", error);
            exit_status = 3;
            goto done;
        }
        accuracy.layer = &layer;
    }
    exit_status = measure(&accuracy, arguments.out, &arena);
done:
    free(accuracy.rows);
    gn_arena_finish(&arena);
    return exit_status;
}
