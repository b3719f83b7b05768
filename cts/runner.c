/* SPDX-License-Identifier: Apache-2.0 */
/* The parent of a run: hands cases to workers and turns what happens to them into statuses. */
#include "cts/runner.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>

#include "cts/output.h"
#include "cts/progress.h"
#include "cts/worker.h"

/* A worker that cannot be started this often in a row is given up. */
#define MOST_START_FAILURES 3
/* Opening a device compiles nothing; still, a busy machine may take its time. */
#define LEAST_START_TIMEOUT 30.0
#define END_TIMEOUT 10.0

enum slot_state { SLOT_EMPTY, SLOT_STARTING, SLOT_IDLE, SLOT_BUSY, SLOT_LEAVING, SLOT_RETIRED };

struct slot {
    struct gn_process process;
    enum slot_state state;
    size_t index; /* the case it is busy with */
    uint32_t number, position; /* as in gn_results_case */
    double since; /* of the state */
    unsigned start_failures;
};

struct runner {
    const struct gn_runner_options *options;
    const struct gn_selected *cases;
    size_t count, next;
    struct gn_results *results;
    struct gn_output output;
    struct gn_progress progress;
    double *weights; /* what each case is expected to take */
    struct slot *slots;
    size_t slot_count;
    uint32_t worker_count; /* started so far */
    bool *skipped; /* the cases that an expectation file says not to run */
    bool device_known;
    bool stop;   /* no case is started any more and workers are killed; results->stopped says why */
    int refused; /* an exit status for a run that cannot begin; -1 while it can */
    char failure[2048];
};

static volatile sig_atomic_t caught_signal;

static void catch_signal(int number)
{
    caught_signal = number;
}

static void stop_run(struct runner *runner, const char *format, ...) __attribute__((format(printf, 2, 3)));
static void stop_run(struct runner *runner, const char *format, ...)
{
    char text[2048];
    if (runner->stop)
        return;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    gn_text_clean(text);
    runner->stop = true;
    runner->results->stopped = gn_arena_printf(&runner->results->arena, "%s", text);
    gn_progress_message(&runner->progress, "%s", text);
}

/* Ends a run before it has begun. */
static void refuse(struct runner *runner, int exit_status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
static void refuse(struct runner *runner, int exit_status, const char *format, ...)
{
    va_list arguments;
    if (runner->refused >= 0)
        return;
    va_start(arguments, format);
    vsnprintf(runner->failure, sizeof runner->failure, format, arguments);
    va_end(arguments);
    gn_text_clean(runner->failure);
    runner->refused = exit_status;
    runner->stop = true;
}

/* Takes a case's result into the model and the output folder. */
static void record(struct runner *runner, struct gn_results_case *cs, double weight)
{
    char error[1024];
    gn_expectations_apply(runner->options->expectations, cs);
    if (!gn_output_case(&runner->output, &runner->results->run, cs, error, sizeof error)) {
        stop_run(runner, "%s", error);
        return;
    }
    cs->image = NULL;
    gn_results_add(runner->results, cs);
    gn_progress_case(&runner->progress, cs, weight);
    uint64_t limit = runner->options->max_fails;
    if (limit && gn_results_totals(runner->results).counting >= limit && !runner->stop &&
        runner->results->count < runner->results->run.selected) {
        runner->results->stopped_at_limit = true;
        stop_run(runner, "%llu failed, the limit set by --max-fails", (unsigned long long)limit);
    }
}

/* The last line that says something. */
static const char *last_line(char *text)
{
    char *line = strrchr(text, '\n');
    return line ? line + 1 : text;
}

/* A case whose worker is no more. */
static void record_death(struct runner *runner, struct slot *slot, enum gn_case_status status,
                         const char *what)
{
    struct gn_arena arena = {0};
    const struct gn_selected *selected = &runner->cases[slot->index];
    char *noise = gn_process_noise(&slot->process);
    const char *said = noise && *noise ? last_line(noise) : "";
    struct gn_results_case cs = {
        .name = selected->name,
        .family = gn_case_family_name(selected->self->name, &arena),
        .spec = selected->self->spec,
        .status = status,
        .seconds = gn_clock() - slot->since,
        .message = *said ? gn_arena_printf(&arena, "%s; the last it printed: %s", what, said) : what,
        .output = noise ? noise : "",
        .worker = slot->number,
        .position = slot->position++,
    };
    record(runner, &cs, runner->weights[slot->index]);
    free(noise);
    gn_arena_finish(&arena);
}

static void describe_end(int status, char *out, size_t size)
{
    if (WIFSIGNALED(status))
        snprintf(out, size, "the process was ended by signal %d (%s)%s", WTERMSIG(status),
                 strsignal(WTERMSIG(status)),
                 WTERMSIG(status) == SIGKILL ? ", perhaps because memory was short" : "");
    else
        snprintf(out, size, "the process ended itself with exit status %d", WEXITSTATUS(status));
}

static void start(struct runner *runner, struct slot *slot)
{
    char error[512];
    const struct gn_results_run *run = &runner->results->run;
    if (gn_process_start(&slot->process, run->driver, run->seed, run->scale, error, sizeof error)) {
        slot->state = SLOT_STARTING;
        slot->since = gn_clock();
        slot->number = ++runner->worker_count;
        slot->position = 0;
        return;
    }
    slot->state = SLOT_RETIRED;
    if (!runner->device_known)
        refuse(runner, 3, "%s", error);
    else
        gn_results_note(runner->results, "%s", error);
}

/* A worker that never got as far as a device. `why` is what it said or how it ended. */
static void start_failed(struct runner *runner, struct slot *slot, const char *why)
{
    char *noise = gn_process_noise(&slot->process);
    if (!runner->device_known)
        refuse(runner, 4, "nothing ran: %s%s%s", why, noise && *noise ? "; it printed: " : "",
               noise ? noise : "");
    else if (++slot->start_failures >= MOST_START_FAILURES)
        gn_results_note(runner->results, "a worker was given up: %s", why);
    gn_process_end(&slot->process, true);
    slot->state = slot->start_failures >= MOST_START_FAILURES ? SLOT_RETIRED : SLOT_EMPTY;
    free(noise);
}

static bool already_done(const struct runner *runner, const char *name)
{
    for (size_t i = 0; runner->options->resume && i < runner->results->count; i++)
        if (strcmp(runner->results->cases[i].name, name) == 0)
            return true;
    return false;
}

/* Records what the expectation files say not to run. */
static void skip_cases(struct runner *runner)
{
    for (size_t i = 0; i < runner->count && !runner->stop; i++) {
        struct gn_arena arena = {0};
        const struct gn_selected *selected = &runner->cases[i];
        const struct gn_expectation *entry =
            gn_expectations_find(runner->options->expectations, GN_EXPECT_SKIP, selected->name);
        if (!entry || already_done(runner, selected->name))
            continue;
        struct gn_results_case cs = {
            .name = selected->name,
            .family = gn_case_family_name(selected->self->name, &arena),
            .spec = selected->self->spec,
            .status = GN_CASE_SKIP,
            .message = gn_arena_printf(&arena, "not run: %s%s%s", entry->place, *entry->reason ? ": " : "", entry->reason),
        };
        runner->skipped[i] = true;
        record(runner, &cs, runner->weights[i]);
        gn_arena_finish(&arena);
    }
}

/* Whether the cases that an earlier run left are of this one, each of them once. */
static bool check_earlier(struct runner *runner)
{
    for (size_t i = 0; i < runner->results->count; i++) {
        const char *name = runner->results->cases[i].name;
        size_t times = 0, selected = 0;
        for (size_t j = 0; j <= i; j++)
            times += strcmp(runner->results->cases[j].name, name) == 0;
        while (selected < runner->count && strcmp(runner->cases[selected].name, name) != 0)
            selected++;
        if (times > 1 || selected == runner->count) {
            refuse(runner, 2, "--resume: %s/results.jsonl has %s %s", runner->options->out, name,
                   times > 1 ? "twice" : "which is no case of this run");
            return false;
        }
    }
    return true;
}

/* The first device decides what the run is about; --resume must meet the same again. */
static void device_opened(struct runner *runner, const char *text, size_t length)
{
    char error[1024];
    struct gn_results_run *run = &runner->results->run;
    int exit_status = 3;
    if (!gn_results_device_decode(text, length, &run->device, error, sizeof error)) {
        refuse(runner, 3, "a worker described its device badly: %s", error);
        return;
    }
    runner->device_known = true;
    if (!gn_expectations_fit(runner->options->expectations, &run->device, error, sizeof error)) {
        refuse(runner, 2, "%s", error);
        return;
    }
    if (!gn_output_begin(&runner->output, runner->results, runner->options->resume, &exit_status, error,
                         sizeof error)) {
        refuse(runner, exit_status, "%s", error);
        return;
    }
    if (!check_earlier(runner))
        return;
    /* What an earlier run left is held against the expectations of this one. */
    for (size_t i = 0; i < runner->results->count; i++)
        gn_expectations_apply(runner->options->expectations, &runner->results->cases[i]);
    skip_cases(runner);
    fprintf(stderr, "gnomon: %zu case%s on %s (%s %s), %u worker%s\n", runner->count,
            runner->count == 1 ? "" : "s", run->device.name, run->device.driver_name, run->device.driver_info,
            run->jobs, run->jobs == 1 ? "" : "s");
}

/* The next case that is still to be run; `count` when there is none. */
static size_t next_case(struct runner *runner)
{
    while (runner->next < runner->count &&
           (runner->skipped[runner->next] || already_done(runner, runner->cases[runner->next].name)))
        runner->next++;
    return runner->next;
}

static void hand_out(struct runner *runner, struct slot *slot)
{
    size_t index = next_case(runner);
    if (index == runner->count)
        return;
    gn_process_noise_reset(&slot->process);
    slot->since = gn_clock();
    slot->index = index;
    slot->state = SLOT_BUSY;
    runner->next++;
    /* If the worker is gone already, its end will be seen as the end of this case. */
    (void)gn_process_send(&slot->process, runner->cases[index].name);
}

static void handle_result(struct runner *runner, struct slot *slot, const char *text, size_t length)
{
    struct gn_arena arena = {0};
    struct gn_results_case cs;
    char error[512], *noise = NULL;
    bool good = slot->state == SLOT_BUSY &&
                gn_results_case_decode(text, length, &arena, &cs, error, sizeof error) &&
                strcmp(cs.name, runner->cases[slot->index].name) == 0;
    if (!good) {
        if (slot->state == SLOT_BUSY)
            record_death(runner, slot, GN_CASE_ERROR,
                         "the worker's answer was garbled; its memory is not to be trusted");
        gn_process_end(&slot->process, true);
        slot->state = SLOT_EMPTY;
    } else {
        if (gn_case_status_is_failure(cs.status)) {
            noise = gn_process_noise(&slot->process);
            cs.output = noise ? noise : "";
        }
        slot->state = cs.status == GN_CASE_ERROR ? SLOT_LEAVING : SLOT_IDLE;
        slot->since = gn_clock();
        slot->start_failures = 0;
        cs.worker = slot->number;
        cs.position = slot->position++;
        record(runner, &cs, runner->weights[slot->index]);
    }
    free(noise);
    gn_arena_finish(&arena);
}

/* The worker closed its end: it has ended, or is about to. */
static void handle_end(struct runner *runner, struct slot *slot)
{
    char what[256];
    int status = gn_process_reap(&slot->process);
    describe_end(status, what, sizeof what);
    if (slot->state == SLOT_STARTING) {
        char why[512];
        snprintf(why, sizeof why, "%s while it opened the driver", what);
        start_failed(runner, slot, why);
        return;
    }
    if (slot->state == SLOT_BUSY)
        record_death(runner, slot, WIFSIGNALED(status) ? GN_CASE_CRASH : GN_CASE_ERROR, what);
    else if (WIFSIGNALED(status) && slot->state == SLOT_IDLE)
        gn_results_note(runner->results, "%s after its cases were over, when the device was closed", what);
    gn_process_end(&slot->process, false);
    slot->state = SLOT_EMPTY;
}

static void handle_lines(struct runner *runner, struct slot *slot)
{
    size_t position = 0, length;
    char *line;
    while (slot->process.pid && (line = gn_process_line(&slot->process, &position, &length))) {
        char kind = length >= 2 && line[1] == ' ' ? line[0] : '?';
        if (kind == 'R' && slot->state == SLOT_STARTING) {
            slot->state = SLOT_IDLE;
            if (!runner->device_known)
                device_opened(runner, line + 2, length - 2);
        } else if (kind == 'U' && slot->state == SLOT_STARTING) {
            char why[2048];
            snprintf(why, sizeof why, "%s", line + 2);
            start_failed(runner, slot, why);
        } else {
            handle_result(runner, slot, line + 2, kind == 'C' ? length - 2 : 0);
        }
        if (runner->stop)
            return;
    }
    if (slot->process.pid)
        gn_process_consume(&slot->process, position);
}

static void check_deadline(struct runner *runner, struct slot *slot, double now)
{
    double timeout = runner->results->run.timeout, spent = now - slot->since;
    char what[256];
    if (slot->state == SLOT_BUSY && spent > timeout) {
        snprintf(what, sizeof what, "no answer within %g s; the process was killed", timeout);
        record_death(runner, slot, GN_CASE_TIMEOUT, what);
    } else if (slot->state == SLOT_STARTING &&
               spent > (timeout > LEAST_START_TIMEOUT ? timeout : LEAST_START_TIMEOUT)) {
        snprintf(what, sizeof what, "the driver was not open after %.0f s", spent);
        start_failed(runner, slot, what);
        return;
    } else if (slot->state == SLOT_LEAVING && spent > END_TIMEOUT) {
        /* It has given its answer and does not end: no loss. */
    } else {
        return;
    }
    gn_process_end(&slot->process, true);
    slot->state = SLOT_EMPTY;
}

/* Starts workers and hands out cases. False when nothing is under way and nothing can be any more. */
static bool keep_busy(struct runner *runner)
{
    bool alive = false;
    for (size_t i = 0; i < runner->slot_count && !runner->stop; i++) {
        struct slot *slot = &runner->slots[i];
        /* One worker first: it says what the device is, and whether there is any. */
        if (slot->state == SLOT_EMPTY && (i == 0 || runner->device_known) &&
            next_case(runner) < runner->count)
            start(runner, slot);
        if (slot->state == SLOT_IDLE)
            hand_out(runner, slot);
        alive |= slot->state == SLOT_STARTING || slot->state == SLOT_BUSY || slot->state == SLOT_LEAVING;
    }
    return alive;
}

static void wait_for_workers(struct runner *runner, const sigset_t *waiting_mask, struct pollfd *fds)
{
    struct timespec tick = {0, 100 * 1000 * 1000};
    for (size_t i = 0; i < runner->slot_count; i++)
        fds[i] = (struct pollfd){runner->slots[i].process.from, POLLIN, 0};
    int ready = ppoll(fds, (nfds_t)runner->slot_count, &tick, waiting_mask);
    for (size_t i = 0; ready > 0 && i < runner->slot_count && !runner->stop; i++) {
        struct slot *slot = &runner->slots[i];
        if (!fds[i].revents || !slot->process.pid)
            continue;
        int got = gn_process_read(&slot->process);
        if (got > 0)
            handle_lines(runner, slot);
        else if (got == 0)
            handle_end(runner, slot);
    }
    double now = gn_clock();
    for (size_t i = 0; i < runner->slot_count && !runner->stop; i++) {
        gn_process_noise_limit(&runner->slots[i].process);
        if (runner->slots[i].process.pid)
            check_deadline(runner, &runner->slots[i], now);
    }
    if (caught_signal && !runner->stop)
        stop_run(runner, "interrupted by %s",
                 caught_signal == SIGINT    ? "Ctrl-C"
                 : caught_signal == SIGTERM ? "SIGTERM"
                                            : "SIGHUP");
}

/* Ends idle workers the way they like it, so that a driver's trouble with closing shows; others are
 * killed. */
static void end_workers(struct runner *runner)
{
    for (size_t i = 0; i < runner->slot_count; i++) {
        struct slot *slot = &runner->slots[i];
        if (slot->process.pid && (runner->stop || slot->state != SLOT_IDLE)) {
            gn_process_end(&slot->process, true);
        } else if (slot->process.pid) {
            gn_process_end_input(&slot->process);
            slot->since = gn_clock();
        }
    }
    for (size_t i = 0; i < runner->slot_count; i++) {
        struct slot *slot = &runner->slots[i];
        while (slot->process.pid) {
            struct pollfd fd = {slot->process.from, POLLIN, 0};
            (void)poll(&fd, 1, 100);
            if (fd.revents && gn_process_read(&slot->process) == 0)
                handle_end(runner, slot);
            else if (caught_signal || gn_clock() - slot->since > END_TIMEOUT) {
                gn_results_note(runner->results,
                                "a worker did not end within %.0f s of its device being closed", END_TIMEOUT);
                gn_process_end(&slot->process, true);
            }
        }
    }
}

/* Cases that no worker is left for. */
static void record_unserved(struct runner *runner)
{
    for (size_t i; !runner->stop && (i = next_case(runner)) < runner->count; runner->next++) {
        struct gn_arena arena = {0};
        struct gn_results_case cs = {
            .name = runner->cases[i].name,
            .family = gn_case_family_name(runner->cases[i].self->name, &arena),
            .spec = runner->cases[i].self->spec,
            .status = GN_CASE_ERROR,
            .message = "no worker could open the device any more",
        };
        record(runner, &cs, runner->weights[i]);
        gn_arena_finish(&arena);
    }
}

static void handle_signals(bool on, sigset_t *waiting_mask)
{
    static const int numbers[] = {SIGINT, SIGTERM, SIGHUP};
    static struct sigaction before[3];
    static sigset_t mask_before;
    sigset_t mask;
    sigemptyset(&mask);
    for (size_t i = 0; i < 3; i++) {
        struct sigaction action = {.sa_handler = catch_signal};
        if (on)
            sigaction(numbers[i], NULL, &before[i]);
        /* What the caller had ignored (nohup, a background job) stays ignored. */
        if (before[i].sa_handler != SIG_IGN)
            sigaction(numbers[i], on ? &action : &before[i], NULL);
        sigaddset(&mask, numbers[i]);
    }
    if (on) {
        caught_signal = 0;
        /* A worker that is gone and a file that is full are errors of a call, not deaths. */
        signal(SIGPIPE, SIG_IGN);
        signal(SIGXFSZ, SIG_IGN);
        sigprocmask(SIG_BLOCK, &mask, &mask_before);
        *waiting_mask = mask_before;
        for (size_t i = 0; i < 3; i++)
            sigdelset(waiting_mask, numbers[i]);
    } else {
        sigprocmask(SIG_SETMASK, &mask_before, NULL);
    }
}

/* Cases take about what they took the last time, where that is known: the ETA is the better for it. */
static void weigh(struct runner *runner, const struct gn_results *earlier)
{
    double known = 0;
    size_t known_count = 0;
    for (size_t i = 0; i < runner->count; i++) {
        for (size_t j = 0; j < earlier->count; j++) {
            if (strcmp(earlier->cases[j].name, runner->cases[i].name) == 0 && earlier->cases[j].seconds > 0) {
                runner->weights[i] = earlier->cases[j].seconds;
                known += runner->weights[i];
                known_count++;
            }
        }
    }
    for (size_t i = 0; i < runner->count; i++)
        if (runner->weights[i] <= 0)
            runner->weights[i] = known_count ? known / (double)known_count : 1;
}

int gn_runner_run(const struct gn_runner_options *options, const struct gn_selected *cases, size_t count,
                  struct gn_results *results)
{
    struct runner runner = {
        .options = options, .cases = cases, .count = count, .results = results, .refused = -1};
    char error[1024];
    sigset_t waiting_mask;
    struct pollfd *fds = NULL;
    int exit_status = 3;
    double started = gn_clock(), weight_total = 0;

    runner.slot_count = results->run.jobs < count ? results->run.jobs : count;
    results->run.jobs = (uint32_t)runner.slot_count;
    results->run.selected = count;
    runner.slots = calloc(runner.slot_count, sizeof *runner.slots);
    fds = calloc(runner.slot_count, sizeof *fds);
    runner.weights = calloc(count, sizeof *runner.weights);
    runner.skipped = calloc(count, sizeof *runner.skipped);
    if (!runner.slots || !runner.skipped || !fds || !runner.weights) {
        fprintf(stderr, "gnomon: out of memory for %zu cases\n", count);
        goto done;
    }
    for (size_t i = 0; i < runner.slot_count; i++)
        runner.slots[i].process = (struct gn_process){0, -1, -1, -1, NULL, 0, 0};
    handle_signals(true, &waiting_mask);
    struct gn_results earlier;
    gn_results_init(&earlier);
    if (!gn_output_open(&runner.output, options->out, &earlier, &exit_status, error, sizeof error)) {
        refuse(&runner, exit_status, "%s", error);
    } else {
        weigh(&runner, &earlier);
        for (size_t i = 0; i < count; i++)
            weight_total += runner.weights[i];
    }
    /* Processes of the earlier run keep their numbers. */
    for (size_t i = 0; options->resume && i < earlier.count; i++)
        if (earlier.cases[i].worker > runner.worker_count)
            runner.worker_count = earlier.cases[i].worker;
    gn_results_finish(&earlier);
    gn_progress_init(&runner.progress, count, weight_total);

    while (!runner.stop && keep_busy(&runner)) {
        wait_for_workers(&runner, &waiting_mask, fds);
        if (runner.device_known && !runner.stop)
            gn_progress_tick(&runner.progress);
    }
    record_unserved(&runner);
    end_workers(&runner);
    gn_progress_finish(&runner.progress);
    results->seconds = gn_clock() - started;

    if (runner.refused >= 0) {
        fprintf(stderr, "gnomon: %s\n", runner.failure);
        exit_status = runner.refused;
    } else if (!runner.device_known) {
        exit_status = 3;
    } else {
        gn_results_sort(results);
        exit_status = gn_results_exit_status(results);
        bool written = gn_output_end(&runner.output, results, error, sizeof error);
        if (!options->quiet)
            gn_summary_print(results, options->out);
        if (!written) {
            fprintf(stderr, "gnomon: %s; results so far are kept in %s/results.jsonl\n", error, options->out);
            exit_status = 3;
        } else if (!options->quiet) {
            printf("\nreport: %s/report.html\n", options->out);
        }
        if (fflush(stdout) != 0 || ferror(stdout)) {
            fprintf(stderr, "gnomon: cannot write to standard output: %s\n", strerror(errno));
            exit_status = 3;
        }
    }
    handle_signals(false, &waiting_mask);
done:
    gn_output_close(&runner.output);
    free(runner.weights);
    free(runner.skipped);
    free(runner.slots);
    free(fds);
    return exit_status;
}
