/* SPDX-License-Identifier: Apache-2.0 */
/* `gnomon replay FILE`: one ray of one case again, with everything that bears on its verdict. */
#include <argp.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "cts/commands.h"
#include "cts/driver.h"
#include "cts/describe.h"
#include "cts/fuzz.h"
#include "cts/progress.h"
#include "cts/select.h"

enum { OPTION_DRIVER = 256, OPTION_CASE, OPTION_TIMEOUT };

static const struct argp_option options[] = {
    {"driver", OPTION_DRIVER, "ICD.json|NAME", 0, "Another driver than the one the file names", 0},
    {"case", OPTION_CASE, NULL, 0, "Trace all rays of the case, not only the one in question", 0},
    {"timeout", OPTION_TIMEOUT, "SECONDS", 0, "How long the driver may take (default: 60)", 0},
    {0},
};

struct arguments {
    const char *file, *driver;
    bool whole_case;
    unsigned timeout;
};

static error_t parse(int key, char *argument, struct argp_state *state)
{
    struct arguments *arguments = state->input;
    char *end;
    switch (key) {
    case OPTION_DRIVER:
        arguments->driver = argument;
        break;
    case OPTION_CASE:
        arguments->whole_case = true;
        break;
    case OPTION_TIMEOUT: {
        unsigned long value = strtoul(argument, &end, 10);
        if (end == argument || *end || argument[0] == '-' || value < 1 || value > 86400)
            argp_error(state, "--timeout: expected whole seconds from 1 to 86400, found '%s'", argument);
        arguments->timeout = (unsigned)value;
        break;
    }
    case ARGP_KEY_ARG:
        if (arguments->file)
            argp_error(state, "expected one replay file, found '%s' besides '%s'", argument, arguments->file);
        arguments->file = argument;
        break;
    case ARGP_KEY_END:
        if (!arguments->file)
            argp_error(state, "expected a replay file, such as gnomon-out/replay/NAME.json");
        break;
    default:
        return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

static void print_vector(const char *name, const float *v)
{
    char row[3][40];
    for (int i = 0; i < 3; i++)
        snprintf(row[i], sizeof row[i], "%.9g", (double)v[i]);
    printf("   %-10s %-16s %-16s %-16s  (%a, %a, %a)\n", name, row[0], row[1], row[2], (double)v[0],
           (double)v[1], (double)v[2]);
}

static void explain_ray(const struct gn_case_offender *offender)
{
    char text[256];
    const struct gn_ref_ray *ray = &offender->ray.ray;
    printf("\n1. The ray: number %u of trace %u, counted from 0\n", offender->ray_index, offender->trace);
    print_vector("origin", ray->origin);
    print_vector("direction", ray->direction);
    printf("   %-10s from %.9g to %.9g, both excluded for triangles  (%a, %a)\n", "t range",
           (double)ray->tmin, (double)ray->tmax, (double)ray->tmin, (double)ray->tmax);
    printf("   %-10s 0x%X: %s\n", "flags", ray->flags, gn_describe_ray_flags(ray->flags, text, sizeof text));
    printf("   %-10s 0x%02X\n", "mask", ray->cull_mask & 0xFF);
}

static void explain_nearest(const struct gn_case_result *result)
{
    size_t shown = sizeof result->nearest / sizeof result->nearest[0];
    printf("\n4. What the ray ideally meets, nearest first");
    if (result->nearest_count <= 0) {
        printf(": nothing\n");
        return;
    }
    if ((int64_t)shown > result->nearest_count)
        shown = (size_t)result->nearest_count;
    if ((int64_t)shown < result->nearest_count)
        printf(" (%zu of %lld)", shown, (long long)result->nearest_count);
    printf("\n   %-20s %-9s %8s %8s %9s  %-6s %-10s %s\n", "t", "kind", "instance", "geometry", "primitive",
           "facing", "opacity", "barycentrics");
    for (size_t i = 0; i < shown; i++) {
        const struct gn_ref_hit *hit = &result->nearest[i];
        bool triangle = hit->type == GN_REF_TRIANGLES;
        printf("   %-20.12g %-9s %8u %8u %9u  %-6s %-10s", hit->t, triangle ? "triangle" : "AABB",
               hit->instance, hit->geometry, hit->primitive, triangle ? (hit->front ? "front" : "back") : "-",
               hit->opaque ? "opaque" : "not opaque");
        if (triangle)
            printf(" %.9g, %.9g\n", hit->beta, hit->gamma);
        else
            printf(" leaves at t = %.9g\n", hit->t_exit);
    }
    printf("   (before the shader: of those that are not opaque it may confirm some and pass over others)\n");
}

static void explain_verdict(const struct gn_ref_verdict *verdict)
{
    printf("\n5. The verdict: %s\n", gn_ref_verdict_class_name(verdict->cls));
    printf("   %s\n", verdict->reason[0] ? verdict->reason : "every decision is the ideal one");
    if (verdict->hit_error > 0)
        printf("   hit error: %.4g units of 2^-24, %.4g allowed\n", verdict->hit_error,
               verdict->hit_bound > 0 ? verdict->hit_bound : gn_ref_verdict_bound());
    if (verdict->margin > 0)
        printf("   margin of the decision that differs: %.4g units of 2^-24; up to %.4g it is open to "
               "rounding\n",
               verdict->margin, gn_ref_verdict_bound());
}

/* Runs and explains in this process; the exit status. */
static int explain(const struct gn_replay *replay, const struct gn_selected *selected, const char *icd,
                   bool whole_case, const char *file)
{
    char message[2048], text[512];
    struct gn_device_options device_options = {icd[0] ? icd : NULL, -1};
    struct gn_device *device = gn_device_create(&device_options, message, sizeof message);
    if (!device) {
        fprintf(stderr, "gnomon: nothing ran: %s\n", message);
        return 4;
    }
    const struct gn_device_info *info = gn_device_info(device);
    bool one_ray = replay->trace >= 0 && replay->ray >= 0 && !whole_case;
    printf("%s: %s\n", selected->name, selected->self->spec);
    printf("recorded on %s: %s\n", replay->device, replay->message);
    printf("now on %s, %s %s, seed %llu, scale %g\n", info->name, info->driver_name, info->driver_info,
           (unsigned long long)replay->seed, replay->scale);
    fflush(stdout);

    struct gn_case_run run;
    gn_case_execute(selected->self, selected->name, selected->backend, device, replay->seed, replay->scale, one_ray ? replay->trace : -1,
                    one_ray ? replay->ray : -1, &run);
    const struct gn_case_result *result = &run.result;
    bool failed = gn_case_status_is_failure(result->status);
    if (result->has_offender) {
        const struct gn_case_offender *offender = &result->offender;
        explain_ray(offender);
        printf("\n2. The driver's answer\n   %s\n", gn_describe_answer(&offender->answer, text, sizeof text));
        printf("\n3. The right answer\n   %s\n", gn_describe_ideal(&offender->verdict, text, sizeof text));
        if (one_ray)
            explain_nearest(result);
        explain_verdict(&offender->verdict);
    }
    printf("\n%s: %s", gn_case_status_name(result->status), failed ? "it still fails" : "it does not fail");
    if (failed || result->status == GN_CASE_SKIP || result->status == GN_CASE_ERROR)
        printf(": %s", result->message);
    printf("\n");
    if (!failed && one_ray) {
        char *quoted = gn_shell_quote(file);
        printf("The ray alone may be answered otherwise than among others; the whole case: %s replay --case "
               "%s\n",
               gn_command_name, quoted ? quoted : file);
        free(quoted);
    }
    if (result->status == GN_CASE_SKIP)
        printf("nothing was judged\n");
    int exit_status = result->status == GN_CASE_ERROR ? 3 : result->status == GN_CASE_SKIP ? 4 : failed;
    gn_case_run_finish(&run);
    gn_device_destroy(device);
    return fflush(stdout) == 0 ? exit_status : 3;
}

/* A scene of its own rather than a case. */
static int explain_scene(const struct gn_fuzz_file *scene, const char *icd)
{
    char message[2048];
    const struct gn_device_options device_options = {icd[0] ? icd : NULL, -1};
    struct gn_device *device = gn_device_create(&device_options, message, sizeof message);
    if (!device) {
        fprintf(stderr, "gnomon: nothing ran: %s\n", message);
        return 4;
    }
    const int exit_status = gn_fuzz_explain(scene, device);
    gn_device_destroy(device);
    return exit_status;
}

/* In a child, because the case may be one that crashes or hangs. Of case and scene one is NULL. */
static int explain_apart(const struct gn_replay *replay, const struct gn_selected *selected,
                         const struct gn_fuzz_file *scene, const char *icd, const struct arguments *arguments)
{
    int status = 0, answered[2];
    char byte = 0;
    fflush(stdout);
    pid_t pid = pipe(answered) == 0 ? fork() : -1;
    if (pid < 0) {
        fprintf(stderr, "gnomon: cannot start a process: %s\n", strerror(errno));
        return 3;
    }
    if (pid == 0) {
        alarm(arguments->timeout);
        const int exit_status =
            scene ? explain_scene(scene, icd) : explain(replay, selected, icd, arguments->whole_case, arguments->file);
        return write(answered[1], &byte, 1) == 1 ? exit_status : 3;
    }
    close(answered[1]);
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR) {
    }
    /* A driver may call exit(). */
    const bool whole = read(answered[0], &byte, 1) == 1;
    close(answered[0]);
    if (WIFEXITED(status) && whole)
        return WEXITSTATUS(status);
    if (WIFEXITED(status))
        printf("\nerror: it still fails: the process ended itself with exit status %d\n", WEXITSTATUS(status));
    else if (WTERMSIG(status) == SIGALRM)
        printf("\ntimeout: it still fails: no answer within %u s\n", arguments->timeout);
    else
        printf("\ncrash: it still fails: the process was ended by signal %d (%s)\n", WTERMSIG(status),
               strsignal(WTERMSIG(status)));
    return 1;
}

int gn_command_replay(int argc, char **argv)
{
    static const struct argp argp = {options,
                                     parse,
                                     "FILE",
                                     "Runs one failing ray, or case, again and explains step by step what "
                                     "was asked, what the driver answered and "
                                     "why that is wrong.\vA run writes a FILE for each case that fails: "
                                     "DIR/replay/NAME.json; `gnomon run fuzz` writes one for each kind of failure.\n\nExit status: 0 when "
                                     "it does not fail any more, 1 when it does, 2 wrong usage or bad input, "
                                     "3 the harness itself failed, 4 nothing "
                                     "ran.",
                                     NULL,
                                     NULL,
                                     NULL};
    struct arguments arguments = {.timeout = 60};
    struct gn_arena arena = {0};
    struct gn_selected *catalogue = NULL;
    struct gn_replay replay = {0};
    struct gn_fuzz_file scene = {0};
    char error[1024], *text = NULL;
    size_t length = 0, count = 0;
    int exit_status = 2;
    if (argp_parse(&argp, argc, argv, 0, NULL, &arguments) != 0)
        goto done;
    if (!gn_file_read(arguments.file, 1 << 26, &text, &length, error, sizeof error)) {
        fprintf(stderr, "gnomon: %s\n", error);
        goto done;
    }
    const bool is_scene = memmem(text, length, "\"scene_file\"", 12) != NULL;
    if (is_scene ? !gn_fuzz_decode(text, length, &arena, &scene, error, sizeof error)
                 : !gn_replay_decode(text, length, &arena, &replay, error, sizeof error)) {
        fprintf(stderr, "gnomon: %s: %s\n", arguments.file, error);
        goto done;
    }
    catalogue = gn_catalogue(&arena, &count);
    const struct gn_selected *selected = is_scene ? NULL : gn_catalogue_find(catalogue, count, replay.name);
    if (!is_scene && !selected) {
        fprintf(stderr, "gnomon: %s: this version (%s) has no case named '%s'\n", arguments.file,
                gn_version(), replay.name);
        goto done;
    }
    const char *icd = is_scene ? scene.driver : replay.driver;
    if (arguments.driver || icd[0])
        icd = gn_driver_resolve(arguments.driver ? arguments.driver : icd, &arena, error, sizeof error);
    if (!icd) {
        fprintf(stderr, "gnomon: %s\n", error);
        goto done;
    }
    exit_status = explain_apart(&replay, selected, is_scene ? &scene : NULL, icd, &arguments);
done:
    free(text);
    free(catalogue);
    gn_arena_finish(&arena);
    return exit_status;
}
