/* SPDX-License-Identifier: Apache-2.0 */
/* `gnomon effects SCENE`: what a scene calls for, why, what is left out, and what that would have cost. */
#include <argp.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <yyjson.h>

#include "cts/arguments.h"
#include "cts/case.h"
#include "cts/commands.h"
#include "cts/describe.h"
#include "cts/effects.h"
#include "cts/render.h"
#include "cts/select.h"

enum { OPTION_RAYS = 256, OPTION_RUNS, OPTION_SEED, OPTION_QUICK, OPTION_JSON, OPTION_FLAGS, OPTION_MASK };

static const struct argp_option options[] = {
    {"json", OPTION_JSON, NULL, 0, "Print JSON instead of the table", 0},
    {"flags", OPTION_FLAGS, "FLAG[,FLAG…]", 0,
     "Ray flags: opaque, no-opaque, cull-back, cull-front, cull-opaque, cull-no-opaque, skip-triangles, skip-aabbs", 0},
    {"mask", OPTION_MASK, "N", 0, "The rays' cull mask (default: 0xFF)", 0},
    {"rays", OPTION_RAYS, "N", 0, "Rays of each kind (default: 10000)", 0},
    {"runs", OPTION_RUNS, "N", 0, "Timed runs, an odd number; the median counts (default: 5)", 0},
    {"seed", OPTION_SEED, "S", 0, "Seed of the scene and rays, up to 2^48 (default: 1)", 0},
    {"quick", OPTION_QUICK, NULL, 0, "Small scenes and few rays: shows how it works, measures little", 0},
    {0},
};

static const struct {
    const char *name;
    uint32_t flag;
} flags[] = {{"opaque", GN_REF_RAY_OPAQUE},
             {"no-opaque", GN_REF_RAY_NO_OPAQUE},
             {"cull-back", GN_REF_RAY_CULL_BACK_FACING},
             {"cull-front", GN_REF_RAY_CULL_FRONT_FACING},
             {"cull-opaque", GN_REF_RAY_CULL_OPAQUE},
             {"cull-no-opaque", GN_REF_RAY_CULL_NO_OPAQUE},
             {"skip-triangles", GN_REF_RAY_SKIP_TRIANGLES},
             {"skip-aabbs", GN_REF_RAY_SKIP_AABBS}};

struct arguments {
    const char *scene;
    struct gn_effects_options options;
    uint64_t seed;
    uint32_t rays, flags, mask;
    bool json, rays_given, runs_given, ray_given;
};

static void parse_flags(struct argp_state *state, const char *text, uint32_t *out)
{
    while (*text) {
        size_t length = strcspn(text, ","), i = 0;
        while (i < sizeof flags / sizeof flags[0] &&
               !(strlen(flags[i].name) == length && strncmp(flags[i].name, text, length) == 0))
            i++;
        if (i == sizeof flags / sizeof flags[0])
            argp_error(state, "--flags: there is no ray flag '%.*s'; --help lists them", (int)length, text);
        *out |= flags[i].flag;
        text += length + (text[length] == ',');
    }
}

static error_t parse(int key, char *argument, struct argp_state *state)
{
    struct arguments *arguments = state->input;
    switch (key) {
    case OPTION_JSON:
        arguments->json = true;
        break;
    case OPTION_FLAGS:
        parse_flags(state, argument, &arguments->flags);
        arguments->ray_given = true;
        break;
    case OPTION_MASK:
        arguments->mask = (uint32_t)gn_argument_number(state, "--mask", argument, 0, 0xFF);
        arguments->ray_given = true;
        break;
    case OPTION_RAYS:
        arguments->rays = (uint32_t)gn_argument_number(state, "--rays", argument, 16, 10000000);
        arguments->rays_given = true;
        break;
    case OPTION_RUNS:
        arguments->options.runs = (uint32_t)gn_argument_number(state, "--runs", argument, 1, 15);
        if (arguments->options.runs % 2 == 0)
            argp_error(state, "--runs: expected an odd number, which has a median, found '%s'", argument);
        arguments->runs_given = true;
        break;
    case OPTION_SEED:
        arguments->seed = gn_argument_number(state, "--seed", argument, 0, UINT64_C(1) << 48);
        break;
    case OPTION_QUICK:
        arguments->options.quick = true;
        break;
    case ARGP_KEY_ARG:
        if (arguments->scene)
            argp_error(state, "expected one SCENE, found a second one: '%s'", argument);
        arguments->scene = argument;
        break;
    case ARGP_KEY_NO_ARGS:
        argp_error(state, "expected a SCENE: a scene of `accuracy --list`, a model file, or a case of `run --list`");
        break;
    default:
        return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

/* A scene of `gnomon accuracy`. */
static struct gn_ref_scene *make_scene(void *user)
{
    struct gn_accuracy_scene *scene = user;
    char error[512];
    if (!gn_accuracy_scene_commit(scene, error, sizeof error)) {
        fprintf(stderr, "gnomon: %s\n", error);
        return NULL;
    }
    struct gn_ref_scene *made = scene->reference;
    scene->reference = NULL;
    return made;
}

static int look_at_scene(const struct arguments *arguments, struct gn_effects_report *report, struct gn_arena *arena)
{
    struct gn_accuracy_scene scene;
    char error[1024];
    int exit_status;
    if (!gn_accuracy_scene_load(&scene, arguments->scene, arguments->options.quick, arguments->seed, arena, &exit_status,
                                error, sizeof error)) {
        fprintf(stderr, "gnomon: %s; of cases, `gnomon run --list` has the names\n", error);
        return exit_status;
    }
    struct gn_ref_ray *rays = gn_arena_alloc(arena, (size_t)arguments->rays * GN_AIM_COUNT, sizeof *rays);
    for (int aim = 0; aim < GN_AIM_COUNT; aim++)
        gn_accuracy_rays(&scene, (enum gn_aim)aim, arguments->seed, rays + (size_t)aim * arguments->rays,
                         arguments->rays);
    for (uint32_t i = 0; i < GN_AIM_COUNT * arguments->rays; i++) {
        rays[i].flags = arguments->flags;
        rays[i].cull_mask = arguments->mask;
    }
    const struct gn_effects_subject subject = {make_scene, &scene, rays, GN_AIM_COUNT * arguments->rays};
    return gn_effects_trace_add(report, &subject) ? 0 : 3;
}

/* A case of the suite: every trace of it is a subject. */
struct case_watch {
    struct gn_effects_report *report;
    struct gn_case_run *run;
    const struct gn_cts_scene *scene;
    bool failed;
};

static struct gn_ref_scene *make_case_scene(void *user)
{
    struct case_watch *watch = user;
    return gn_case_reference(watch->run, watch->scene);
}

static void witness(struct gn_case_run *run, const struct gn_cts_scene *scene, const struct gn_cts_ray *rays,
                    uint32_t ray_count, void *user)
{
    struct case_watch *watch = user;
    struct gn_ref_ray *bare = calloc((size_t)ray_count + 1, sizeof *bare);
    watch->run = run;
    watch->scene = scene;
    for (uint32_t i = 0; bare && i < ray_count; i++)
        bare[i] = rays[i].ray;
    const struct gn_effects_subject subject = {make_case_scene, watch, bare, ray_count};
    if (!bare || (ray_count && !gn_effects_trace_add(watch->report, &subject)))
        watch->failed = true;
    free(bare);
}

static int look_at_case(const struct gn_case *self, const struct arguments *arguments, struct gn_effects_report *report)
{
    struct case_watch watch = {.report = report};
    struct gn_case_run run;
    int exit_status = 0;
    gn_case_run_begin(self, NULL, arguments->seed, arguments->options.quick ? 0.1 : 1, &run);
    run.witness = witness;
    run.witness_user = &watch;
    self->run(&run, self);
    if (watch.failed || !report->rays) {
        fprintf(stderr, "gnomon: %s: %s\n", self->name,
                run.result.message[0] ? run.result.message : "the case traces nothing without a driver");
        exit_status = watch.failed ? 3 : 4;
    }
    gn_case_run_finish(&run);
    return exit_status;
}

/* By its own name or with a backend's before it. */
static const struct gn_case *find_case(const char *name)
{
    for (size_t f = 0; f < gn_case_family_count; f++)
        for (size_t i = 0; i < gn_case_families[f]->case_count; i++) {
            const char *own = gn_case_families[f]->cases[i].name, *dot = strchr(name, '.');
            if (strcmp(own, name) == 0 || (dot && strcmp(own, dot + 1) == 0))
                return &gn_case_families[f]->cases[i];
        }
    return NULL;
}

/* "+12 %", "0 %", or a dash. */
static const char *cost(double ratio, char out[32])
{
    if (isnan(ratio))
        snprintf(out, 32, "-");
    else
        snprintf(out, 32, "%+.0f %%", 100 * (ratio - 1) + 0.0);
    return out;
}

static void print_table(const struct arguments *arguments, const struct gn_effects_report *report)
{
    char number[4][32];
    const double rays = (double)report->rays;
    printf("%s: what tracing calls for, over %s rays\n\n", arguments->scene, gn_format_grouped(report->rays, number[0]));
    printf("%-20s %-10s %14s %16s %9s %9s\n", "effect", "called for", "ran, per ray", "forced, per ray", "trace", "build");
    for (uint32_t i = 0; i < report->row_count; i++) {
        const struct gn_effects_row *row = &report->rows[i];
        char share[32];
        if (row->rays_calling == 0 || row->rays_calling == row->rays)
            snprintf(share, sizeof share, "%s", row->rays_calling ? "yes" : "no");
        else
            snprintf(share, sizeof share, "%.0f %%", 100 * (double)row->rays_calling / (double)row->rays);
        snprintf(number[0], 32, "%.4g", (double)row->ran / rays);
        snprintf(number[1], 32, row->rays_forced ? "%.4g" : "-", (double)row->forced_ran / (double)row->rays_forced);
        printf("%-20s %-10s %14s %16s %9s %9s\n", row->name, share, number[0], number[1], cost(row->trace_ratio, number[2]),
               cost(row->commit_ratio, number[3]));
        printf("    %s\n", row->why);
    }
    printf("%-20s %-10s %14s %16s %9s %9s\n\n", "all that is not", "", "", "", cost(report->all_trace_ratio, number[0]),
           cost(report->all_commit_ratio, number[1]));
    const struct gn_ref_effect_counts *work = &report->work;
    printf("Per ray: %.3g nodes, %.3g leaves, %.3g triangles tested; of these %.3g %% were rejected in f32, %.3g %% decided in "
           "f64,\n%.3g %% with errors compensated, %.3g %% by wide integers, %.3g %% by integers of any size.\n",
           (double)work->nodes / rays, (double)work->leaves / rays, (double)work->triangles / rays,
           100 * (double)work->rejected_f32 / fmax(1, (double)work->triangles),
           100 * (double)work->decided_f64 / fmax(1, (double)work->triangles),
           100 * (double)work->decided_sharp / fmax(1, (double)work->triangles),
           100 * (double)work->decided_wide / fmax(1, (double)work->triangles),
           100 * (double)work->decided_exact / fmax(1, (double)work->triangles));
    printf("trace, build: how much longer tracing in batches and placing the scene took with the effect forced on. What is not\n"
           "called for ran 0 times, and forcing it changed no answer. Less than 0 %% is how far timings of the same vary.\n");
}

static void put_number(yyjson_mut_doc *doc, yyjson_mut_val *object, const char *key, double value)
{
    if (isfinite(value))
        yyjson_mut_obj_add_real(doc, object, key, value);
    else
        yyjson_mut_obj_add_null(doc, object, key);
}

static bool print_json(const struct arguments *arguments, const struct gn_effects_report *report)
{
    yyjson_mut_doc *doc = yyjson_mut_doc_new(NULL);
    char *text = NULL;
    if (!doc)
        return false;
    yyjson_mut_val *root = yyjson_mut_obj(doc);
    yyjson_mut_doc_set_root(doc, root);
    yyjson_mut_obj_add_str(doc, root, "scene", arguments->scene);
    yyjson_mut_obj_add_uint(doc, root, "rays", report->rays);
    yyjson_mut_val *list = yyjson_mut_obj_add_arr(doc, root, "effects");
    for (uint32_t i = 0; i < report->row_count; i++) {
        const struct gn_effects_row *row = &report->rows[i];
        yyjson_mut_val *object = yyjson_mut_arr_add_obj(doc, list);
        yyjson_mut_obj_add_str(doc, object, "stage", row->stage);
        yyjson_mut_obj_add_str(doc, object, "effect", row->name);
        yyjson_mut_obj_add_bool(doc, object, "called", row->rays_calling > 0);
        yyjson_mut_obj_add_uint(doc, object, "rays_calling", row->rays_calling);
        yyjson_mut_obj_add_str(doc, object, "why", row->why);
        yyjson_mut_obj_add_str(doc, object, "counted", row->counted);
        yyjson_mut_obj_add_uint(doc, object, "ran", row->ran);
        yyjson_mut_obj_add_uint(doc, object, "rays_forced", row->rays_forced);
        yyjson_mut_obj_add_uint(doc, object, "forced_ran", row->forced_ran);
        yyjson_mut_obj_add_uint(doc, object, "answers_changed", row->differing);
        put_number(doc, object, "trace_ratio", row->trace_ratio);
        put_number(doc, object, "build_ratio", row->commit_ratio);
    }
    yyjson_mut_val *all = yyjson_mut_obj_add_obj(doc, root, "all_forced");
    put_number(doc, all, "trace_ratio", report->all_trace_ratio);
    put_number(doc, all, "build_ratio", report->all_commit_ratio);
    yyjson_mut_obj_add_uint(doc, all, "answers_changed", report->all_differing);
    yyjson_mut_val *work = yyjson_mut_obj_add_obj(doc, root, "work");
    yyjson_mut_obj_add_uint(doc, work, "nodes", report->work.nodes);
    yyjson_mut_obj_add_uint(doc, work, "leaves", report->work.leaves);
    yyjson_mut_obj_add_uint(doc, work, "triangles", report->work.triangles);
    yyjson_mut_obj_add_uint(doc, work, "rejected_f32", report->work.rejected_f32);
    yyjson_mut_obj_add_uint(doc, work, "decided_f64", report->work.decided_f64);
    yyjson_mut_obj_add_uint(doc, work, "decided_sharp", report->work.decided_sharp);
    yyjson_mut_obj_add_uint(doc, work, "decided_wide", report->work.decided_wide);
    yyjson_mut_obj_add_uint(doc, work, "decided_exact", report->work.decided_exact);
    text = yyjson_mut_write(doc, YYJSON_WRITE_PRETTY_TWO_SPACES | YYJSON_WRITE_NEWLINE_AT_END, NULL);
    if (text)
        fputs(text, stdout);
    free(text);
    yyjson_mut_doc_free(doc);
    return text != NULL;
}

int gn_command_effects(int argc, char **argv)
{
    static const struct argp argp = {
        options,
        parse,
        "SCENE",
        "Says what a scene calls for and why, what is left out, and what that would have cost.\v"
        "SCENE is a scene of `gnomon accuracy --list`, a model file, or a case of `gnomon run --list`, whose own rays and flags "
        "are taken; for light transport it is cubes, landscape or forest, or a model file with --light. Each effect that not every ray calls for is forced on and timed; the answers have to stay.\n\n"
        "Exit status: 0 as it should be; 1 an effect ran that nothing calls for, or forcing one changed an answer; 2 wrong "
        "usage, an unknown scene; 3 the harness itself failed; 4 nothing was traced.",
        NULL,
        NULL,
        NULL};
    if (gn_command_render_wanted(argc, argv))
        return gn_command_render(argc, argv);
    struct arguments arguments = {.options = {.runs = 5}, .seed = 1, .rays = 10000, .mask = 0xFF};
    struct gn_effects_report report = {0};
    struct gn_arena arena = {0};
    char fault[256];
    int exit_status = 2;
    if (argp_parse(&argp, argc, argv, 0, NULL, &arguments) != 0)
        goto done;
    if (arguments.options.quick && !arguments.rays_given)
        arguments.rays = 500;
    if (arguments.options.quick && !arguments.runs_given)
        arguments.options.runs = 1;
    report.options = arguments.options;
    const struct gn_case *self = find_case(arguments.scene);
    if (self && arguments.ray_given) {
        fprintf(stderr, "gnomon: --flags and --mask are for scenes: a case has rays of its own\n");
        goto done;
    }
    exit_status = self ? look_at_case(self, &arguments, &report) : look_at_scene(&arguments, &report, &arena);
    if (exit_status != 0)
        goto done;
    if (gn_effects_fault(&report, fault, sizeof fault)) {
        fprintf(stderr, "gnomon: %s\n", fault);
        exit_status = 1;
    }
    if (arguments.json) {
        if (!print_json(&arguments, &report))
            exit_status = 3;
    } else {
        print_table(&arguments, &report);
    }
    if (fflush(stdout) != 0)
        exit_status = 3;
done:
    gn_arena_finish(&arena);
    return exit_status;
}
