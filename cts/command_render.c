/* SPDX-License-Identifier: Apache-2.0 */
/* `gnomon effects` for the scenes of light transport: what is called for, what that saves, and a page with pictures. */
#include <argp.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cts/accuracy_model.h"
#include "cts/arguments.h"
#include "cts/driver.h"
#include "cts/render.h"
#include "cts/render_page.h"
#include "cts/statistics.h"

enum {
    OPTION_LIGHT = 256,
    OPTION_DRIVER,
    OPTION_BACKEND,
    OPTION_OUT,
    OPTION_WIDTH,
    OPTION_HEIGHT,
    OPTION_DEPTH,
    OPTION_SAMPLES,
    OPTION_RUNS,
    OPTION_NO_CURVES,
};

static const struct argp_option argp_options[] = {
    {"light", OPTION_LIGHT, NULL, 0, "With a model file: light transport rather than the effects of tracing", 0},
    {"driver", OPTION_DRIVER, "ICD.json|NAME", 0, "The driver whose picture is shown, or `none` (default: as for `run`)", 0},
    {"backend", OPTION_BACKEND, "NAME", 0, "How the driver traces: query (the default) or pipeline", 0},
    {"out", OPTION_OUT, "DIR", 0, "Where effects.html goes (default: gnomon-effects)", 0},
    {"width", OPTION_WIDTH, "N", 0, "Pixels (default: 240)", 0},
    {"height", OPTION_HEIGHT, "N", 0, "Pixels (default: 180)", 0},
    {"depth", OPTION_DEPTH, "N", 0, "Levels of recursion; deeper rays are pink (default: 6)", 0},
    {"samples", OPTION_SAMPLES, "N", 0, "To each light with extent, a power of two (default: 8)", 0},
    {"runs", OPTION_RUNS, "N", 0, "Timed runs; the median counts (default: 3)", 0},
    {"no-curves", OPTION_NO_CURVES, NULL, 0, "No pictures over samples and depth", 0},
    {0},
};

enum { MOST_RUNS = 99, CURVE_TRUTH_SAMPLES = 256, CURVE_TRUTH_DEPTH = 12 };

struct arguments {
    const char *scene, *driver, *out;
    struct gn_render_options options;
    uint32_t runs;
    bool pipeline, curves;
};

static error_t parse(int key, char *argument, struct argp_state *state)
{
    struct arguments *arguments = state->input;
    switch (key) {
    case OPTION_LIGHT:
        break;
    case OPTION_DRIVER:
        arguments->driver = argument;
        break;
    case OPTION_BACKEND:
        if (strcmp(argument, "query") != 0 && strcmp(argument, "pipeline") != 0)
            argp_error(state, "--backend: expected query or pipeline, found '%s'", argument);
        arguments->pipeline = strcmp(argument, "pipeline") == 0;
        break;
    case OPTION_OUT:
        arguments->out = argument;
        break;
    case OPTION_WIDTH:
        arguments->options.width = (uint32_t)gn_argument_number(state, "--width", argument, 1, 4096);
        break;
    case OPTION_HEIGHT:
        arguments->options.height = (uint32_t)gn_argument_number(state, "--height", argument, 1, 4096);
        break;
    case OPTION_DEPTH:
        arguments->options.depth = (uint32_t)gn_argument_number(state, "--depth", argument, 0, 31);
        break;
    case OPTION_SAMPLES:
        arguments->options.samples = (uint32_t)gn_argument_number(state, "--samples", argument, 1, 1024);
        if (arguments->options.samples & (arguments->options.samples - 1))
            argp_error(state, "--samples: expected a power of two, found '%s'", argument);
        break;
    case OPTION_RUNS:
        arguments->runs = (uint32_t)gn_argument_number(state, "--runs", argument, 1, MOST_RUNS);
        break;
    case OPTION_NO_CURVES:
        arguments->curves = false;
        break;
    case ARGP_KEY_ARG:
        if (arguments->scene)
            argp_error(state, "expected one SCENE, found '%s' besides '%s'", argument, arguments->scene);
        arguments->scene = argument;
        break;
    case ARGP_KEY_NO_ARGS:
        argp_error(state, "expected a SCENE");
        break;
    default:
        return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

bool gn_command_render_wanted(int argc, char **argv)
{
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--light") == 0)
            return true;
        for (size_t s = 0; s < gn_render_count; s++)
            if (strcmp(argv[i], gn_render_names[s]) == 0)
                return true;
    }
    return false;
}

/* Times the plan and each effect forced on, in turns. */
static bool effects_measure(struct gn_render_page *page, const struct arguments *arguments, struct gn_arena *arena)
{
    static double seconds[GN_RENDER_EFFECT_COUNT + 1][MOST_RUNS];
    const uint32_t pixels = page->options.width * page->options.height;
    for (uint32_t run = 0; run < arguments->runs; run++)
        for (int e = -1; e < GN_RENDER_EFFECT_COUNT; e++) {
            struct gn_render_options options = page->options;
            struct gn_render_result result;
            struct gn_arena own = {0};
            struct gn_arena *memory = e < 0 && run == 0 ? arena : &own;
            if (e >= 0 && page->plan.called >> e & 1)
                continue;
            options.forced = e < 0 ? 0 : 1u << e;
            if (!gn_render_reference(memory, page->scene, &options, &result)) {
                fprintf(stderr, "gnomon: the reference cannot take the scene\n");
                return false;
            }
            seconds[e + 1][run] = result.seconds;
            if (e < 0 && run == 0)
                page->reference = result;
            if (e >= 0) {
                page->forced[e].rays = result.rays[e];
                page->forced[e].same =
                    memcmp(result.pixels, page->reference.pixels, pixels * sizeof *result.pixels) == 0;
            }
            gn_arena_finish(&own);
        }
    page->reference.seconds = gn_median(seconds[0], arguments->runs);
    for (int e = 0; e < GN_RENDER_EFFECT_COUNT; e++)
        page->forced[e].seconds = page->plan.called >> e & 1 ? 0 : gn_median(seconds[e + 1], arguments->runs);
    return true;
}

/* Time and error of the picture as one parameter grows, against the picture at its end. */
static bool curve_measure(struct gn_render_page *page, struct gn_render_curve *curve, bool samples)
{
    struct gn_arena arena = {0};
    struct gn_render_options options = page->options;
    struct gn_render_result truth, result;
    /* A quarter of the pixels: it is the shape that matters. */
    options.width = options.width > 1 ? options.width / 2 : 1;
    options.height = options.height > 1 ? options.height / 2 : 1;
    struct gn_render_options best = options;
    if (samples)
        best.samples = CURVE_TRUTH_SAMPLES;
    else
        best.depth = CURVE_TRUTH_DEPTH;
    bool ok = gn_render_reference(&arena, page->scene, &best, &truth);
    for (uint32_t i = 0; i < GN_RENDER_CURVE_POINTS && ok; i++) {
        const uint32_t value = samples ? 1u << i : i;
        if (samples)
            options.samples = value;
        else
            options.depth = value;
        ok = gn_render_reference(&arena, page->scene, &options, &result);
        if (!ok)
            break;
        curve->points[curve->count].value = value;
        curve->points[curve->count].seconds = result.seconds;
        curve->points[curve->count].rays = result.traced;
        curve->points[curve->count].pink = result.pink;
        curve->points[curve->count++].error = gn_render_difference(&result, &truth, options.width * options.height);
    }
    gn_arena_finish(&arena);
    return ok;
}

/* The driver's picture, judged. 0, or an exit status. */
static int driver_measure(struct gn_render_page *page, const struct arguments *arguments, struct gn_case_run *run,
                          struct gn_device **out_device, struct gn_arena *arena)
{
    char error[2048];
    static const struct gn_case self = {.name = "effects", .spec = "a picture"};
    const char *icd = gn_driver_resolve(arguments->driver, arena, error, sizeof error);
    if (!icd) {
        fprintf(stderr, "gnomon: %s\n", error);
        return 2;
    }
    const struct gn_device_options options = {.icd = icd[0] ? icd : NULL, .index = -1};
    struct gn_device *device = gn_device_create(&options, error, sizeof error);
    *out_device = device;
    if (!device) {
        fprintf(stderr, "gnomon: no driver: %s\n", error);
        return 4;
    }
    gn_case_run_begin(&self, device, 1, 1, run);
    if (arguments->pipeline)
        run->route = (struct gn_cts_route){.entry = GN_CTS_PIPELINE, .record_stride = 1};
    const bool drawn = gn_render_driver(run, page->scene, &page->options, true, &page->driver);
    gn_case_run_end(run);
    if (!drawn) {
        fprintf(stderr, "gnomon: the driver gave no picture: %s\n", run->result.message);
        return 4;
    }
    page->driver_name = gn_device_info(device)->name;
    page->judged = &run->result;
    page->picture_error = gn_render_difference(&page->driver, &page->reference, page->options.width * page->options.height);
    return 0;
}

int gn_command_render(int argc, char **argv)
{
    static const struct argp argp = {
        argp_options,
        parse,
        "SCENE",
        "Says which effects of light transport a scene calls for and why, what the others would have cost, and writes a page "
        "with the driver's picture, the exact one and the difference.\vSCENE is cubes, landscape or forest, or a model file "
        "with --light. Every ray of the driver is judged. The exact picture is drawn with each effect forced that nothing calls "
        "for: it has to stay, bit for bit.\n\nExit status: 0 as it should be; 1 an effect ran that nothing calls for, forcing "
        "one changed the picture, or the driver answered wrongly; 2 wrong usage; 3 the harness itself failed; 4 nothing ran.",
        NULL,
        NULL,
        NULL};
    struct arguments arguments = {.out = "gnomon-effects", .options = {240, 180, 6, 8, 0}, .runs = 3, .curves = true};
    struct gn_arena arena = {0};
    struct gn_case_run run = {0};
    struct gn_device *device = NULL;
    struct gn_render_scene scene;
    struct gn_render_page page = {.scene = &scene};
    char error[1024];
    int exit_status = 2;
    if (argp_parse(&argp, argc, argv, 0, NULL, &arguments) != 0)
        goto done;
    page.options = arguments.options;
    if (!gn_render_make(&arena, arguments.scene, &scene) &&
        !gn_render_make_model(&arena, arguments.scene, &scene, error, sizeof error)) {
        fprintf(stderr, "gnomon: %s\n", error);
        goto done;
    }
    gn_render_plan(&scene, &page.plan);
    exit_status = 3;
    if (!effects_measure(&page, &arguments, &arena))
        goto done;
    /* The child that reads a model has to be over before the driver starts threads. */
    if (!arguments.driver || strcmp(arguments.driver, "none") != 0) {
        const int status = driver_measure(&page, &arguments, &run, &device, &arena);
        if (status != 0) {
            exit_status = status;
            goto done;
        }
    }
    if (arguments.curves && ((page.plan.called >> GN_RENDER_SOFT_SHADOWS & 1 && !curve_measure(&page, &page.samples, true)) ||
                             !curve_measure(&page, &page.depths, false)))
        goto done;
    gn_render_page_print(&page);
    if (!gn_render_page_write(&page, arguments.out, error, sizeof error)) {
        fprintf(stderr, "gnomon: %s\n", error);
        goto done;
    }
    printf("\npage: %s/effects.html\n", arguments.out);
    exit_status = gn_render_page_fault(&page, error, sizeof error);
    if (exit_status)
        fprintf(stderr, "gnomon: %s\n", error);
done:
    gn_case_run_finish(&run);
    gn_device_destroy(device);
    gn_arena_finish(&arena);
    return fflush(stdout) == 0 ? exit_status : 3;
}
