/* SPDX-License-Identifier: Apache-2.0 */
/* The worker: opens the driver, runs the cases whose names it is given, answers with results. */
#include "cts/bench.h"
#include "cts/worker.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cts/select.h"

enum { COMMANDS = 3, ANSWERS = 4 };

static bool answer(char kind, const char *text, size_t length)
{
    char head[2] = {kind, ' '};
    const char *parts[] = {head, text, "\n"};
    size_t lengths[] = {2, length, 1};
    for (int p = 0; p < 3; p++) {
        for (size_t done = 0; done < lengths[p];) {
            ssize_t n = write(ANSWERS, parts[p] + done, lengths[p] - done);
            if (n < 0 && errno == EINTR)
                continue;
            if (n <= 0)
                return false;
            done += (size_t)n;
        }
    }
    return true;
}

const char *gn_case_family_name(const char *case_name, struct gn_arena *arena)
{
    return gn_arena_printf(arena, "%.*s", (int)strcspn(case_name, "."), case_name);
}

/* What a case has come to in this process, as the reports have it. Strings point into `run` and `self`. */
static void result_of(const char *name, const struct gn_case *self, const struct gn_case_run *run,
                      struct gn_results_case *out)
{
    const struct gn_case_result *r = &run->result;
    *out = (struct gn_results_case){
        .name = name,
        .spec = self->spec,
        .status = r->status,
        .seconds = r->seconds,
        .rays = r->rays,
        .ideal_hits = r->ideal_hits,
        .hit_error_median = r->hit_error_median,
        .hit_error_p999 = r->hit_error_p999,
        .hit_error_max = r->hit_error_max,
        .margin_max = r->margin_max,
        .answers = r->answers,
        .curve = r->curve,
        .message = r->message,
        .has_offender = r->has_offender,
        .offender = r->offender,
    };
    memcpy(out->rendered, r->rendered, sizeof out->rendered);
    memcpy(out->class_counts, r->class_counts, sizeof out->class_counts);
    memcpy(out->hit_error_bins, r->hit_error_bins, sizeof out->hit_error_bins);
    if (gn_case_status_is_failure(r->status) && r->image && r->image_width && r->image_height) {
        out->image = r->image;
        out->picture_width = r->image_width;
        out->picture_height = r->image_height;
    }
}

bool gn_worker_test_fault(const char *name)
{
    const char *faults = getenv("GNOMON_TEST_FAULT");
    char kind[16], at[256];
    static bool other_seen;
    for (; faults && *faults; faults += strcspn(faults, ","), faults += *faults == ',') {
        if (sscanf(faults, "%15[^:,]:%255[^,]", kind, at) != 2)
            continue;
        char *other = strchr(at, '<');
        if (other) {
            *other++ = 0;
            other_seen = other_seen || strcmp(name, other) == 0;
        }
        if (strcmp(at, name) != 0 || (other && !other_seen))
            continue;
        fprintf(stderr, "GNOMON_TEST_FAULT: %s at %s\n", kind, name);
        fflush(stderr);
        if (strcmp(kind, "crash") == 0) {
            signal(SIGSEGV, SIG_DFL);
            raise(SIGSEGV);
        } else if (strcmp(kind, "hang") == 0) {
            for (;;)
                pause();
        } else if (strcmp(kind, "flood") == 0) {
            for (;;)
                fprintf(stderr, "GNOMON_TEST_FAULT: %s at %s\n", kind, name);
        } else if (strcmp(kind, "exit") == 0) {
            exit(7);
        } else if (strcmp(kind, "lost") == 0) {
            return true;
        }
    }
    return false;
}

static bool run_case(const struct gn_selected *selected, struct gn_device *device, uint64_t seed,
                     double scale, bool *out_go_on)
{
    struct gn_case_run run;
    struct gn_results_case result;
    size_t length = 0;
    if (gn_worker_test_fault(selected->name)) {
        memset(&run, 0, sizeof run);
        run.result.status = GN_CASE_ERROR;
        snprintf(run.result.message, sizeof run.result.message, "the device was lost (GNOMON_TEST_FAULT)");
    } else {
        gn_case_execute(selected->self, selected->name, selected->backend, device, seed, scale, -1, -1, &run);
    }
    result_of(selected->name, selected->self, &run, &result);
    result.family = gn_case_family_name(selected->self->name, &run.arena);
    char *text = gn_results_case_encode(&result, &length);
    *out_go_on = run.result.status != GN_CASE_ERROR;
    if (text)
        gn_case_kept_write(&run, selected->name);
    bool ok = text && answer('C', text, length);
    gn_case_run_finish(&run);
    free(text);
    return ok;
}

/* One measurement, on request: its value, or in its place why there is none. */
static bool run_bench(struct gn_bench *bench, struct gn_device *device, const char *name)
{
    char text[1200];
    double value = 0;
    size_t item = gn_bench_find(name);
    if (item == gn_bench_count()) {
        fprintf(stderr, "gnomon: worker: nothing is measured under the name '%s'\n", name);
        return false;
    }
    enum gn_device_status status = gn_bench_measure(bench, item, &value);
    if (status == GN_DEVICE_OK)
        snprintf(text, sizeof text, "%a", value);
    else
        snprintf(text, sizeof text, "%c %s", status == GN_DEVICE_UNSUPPORTED ? '-' : '!', gn_device_message(device));
    for (char *c = text; *c; c++)
        if (*c == '\n')
            *c = ' ';
    return answer('B', text, strlen(text));
}

int gn_worker_main(int argc, char **argv)
{
    char message[2048], line[600];
    size_t length = 0, count = 0;
    struct gn_device *device = NULL;
    struct gn_arena arena = {0};
    struct gn_selected *catalogue = NULL;
    struct gn_bench *bench = NULL;
    FILE *commands = NULL;
    int exit_status = 3;
    if (argc != 5 || fcntl(COMMANDS, F_GETFD) < 0 || fcntl(ANSWERS, F_GETFD) < 0) {
        fprintf(stderr, "gnomon: `worker` is what `gnomon run` starts; it is not for use by hand\n");
        return 2;
    }
    /* The driver and what it starts must not hold the pipes open. */
    fcntl(COMMANDS, F_SETFD, FD_CLOEXEC);
    fcntl(ANSWERS, F_SETFD, FD_CLOEXEC);
    uint64_t seed = strtoull(argv[3], NULL, 10);
    double scale = strtod(argv[4], NULL);
    struct gn_device_options options = {argv[2][0] ? argv[2] : NULL, -1};

    gn_worker_test_fault("open");
    device = gn_device_create(&options, message, sizeof message);
    if (!device) {
        gn_text_clean(message);
        for (char *c = message; *c; c++)
            if (*c == '\n')
                *c = ' ';
        answer('U', message, strlen(message));
        goto done;
    }
    char *info = gn_results_device_encode(gn_device_info(device), &length);
    bool ok = info && answer('R', info, length);
    free(info);
    if (!ok)
        goto done;
    catalogue = gn_catalogue(&arena, &count);
    commands = fdopen(COMMANDS, "r");
    bool go_on = commands != NULL;
    while (go_on && fgets(line, sizeof line, commands)) {
        line[strcspn(line, "\n")] = 0;
        if (strncmp(line, GN_WORKER_BENCH, sizeof GN_WORKER_BENCH - 1) == 0) {
            if (!bench && !(bench = gn_bench_create(device)))
                goto done;
            if (!run_bench(bench, device, line + sizeof GN_WORKER_BENCH - 1))
                goto done;
            continue;
        }
        const struct gn_selected *selected = gn_catalogue_find(catalogue, count, line);
        if (!selected) {
            fprintf(stderr, "gnomon: worker: no case is named '%s'\n", line);
            goto done;
        }
        if (!run_case(selected, device, seed, scale, &go_on))
            goto done;
        fflush(stdout);
    }
    exit_status = 0;
done:
    if (commands)
        fclose(commands);
    free(catalogue);
    gn_arena_finish(&arena);
    gn_bench_destroy(bench);
    gn_device_destroy(device);
    return exit_status;
}
