/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Cases that count, run again: alone in a process of their own; and, where they pass there, behind the cases that their
 * worker had run before them, of which the one that matters is then looked for by halves.
 */
#include <poll.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "cts/gate.h"
#include "cts/progress.h"
#include "cts/worker.h"

#define MOST_CASES 40
/* All of this together; what is left then is reported as not rerun. */
#define MOST_SECONDS 240.0

struct rerun {
    const struct gn_gate *gate;
    const char *driver;
    double deadline;
    uint32_t times;
    const struct gn_results_case *cases[MOST_CASES];
    struct gn_gate_rerun *out; /* one per case */
    size_t count;
    _Atomic size_t next;
};

/* The status of the last of the cases, run one after another in a new process. */
static enum gn_case_status run_in_order(const struct rerun *rerun, const char *const *names, size_t count)
{
    const struct gn_results_run *run = &rerun->gate->now->run;
    struct gn_process process;
    enum gn_case_status status = GN_CASE_CRASH;
    char error[512];
    if (!gn_process_start(&process, rerun->driver, run->seed, run->scale, error, sizeof error))
        return GN_CASE_ERROR;
    size_t sent = 0;
    double since = gn_clock();
    for (;;) {
        size_t position = 0, length = 0;
        char *line = gn_process_line(&process, &position, &length);
        if (line) {
            bool last = sent == count;
            if (line[0] == 'C' && last) {
                struct gn_arena arena = {0};
                struct gn_results_case cs;
                status = gn_results_case_decode(line + 2, length - 2, &arena, &cs, error, sizeof error) ? cs.status
                                                                                                         : GN_CASE_ERROR;
                gn_arena_finish(&arena);
            }
            gn_process_consume(&process, position);
            if (last || (line[0] != 'C' && line[0] != 'R'))
                break;
            gn_process_noise_limit(&process);
            (void)gn_process_send(&process, names[sent++]);
            since = gn_clock();
            continue;
        }
        double left = run->timeout - (gn_clock() - since);
        struct pollfd fd = {process.from, POLLIN, 0};
        if (left <= 0) {
            status = GN_CASE_TIMEOUT;
            break;
        }
        if (poll(&fd, 1, (int)(left * 1000) + 1) > 0 && gn_process_read(&process) == 0)
            break;
    }
    gn_process_end(&process, true);
    return status;
}

static bool passes(const struct rerun *rerun, const char *const *before, size_t count, const char *name)
{
    const char **names = malloc((count + 1) * sizeof *names);
    if (!names)
        return false;
    if (count)
        memcpy(names, before, count * sizeof *names);
    names[count] = name;
    bool pass = !gn_case_status_is_failure(run_in_order(rerun, names, count + 1));
    free(names);
    return pass;
}

/* The cases that the same process had run before this one, in order; malloc'ed. */
static const char **context_of(const struct gn_results *results, const struct gn_results_case *cs, size_t *out_count)
{
    const char **names = malloc((cs->position + 1) * sizeof *names);
    *out_count = 0;
    for (uint32_t position = 0; names && position < cs->position; position++)
        for (size_t i = 0; i < results->count; i++)
            if (results->cases[i].worker == cs->worker && results->cases[i].position == position &&
                results->cases[i].worker)
                names[(*out_count)++] = results->cases[i].name;
    return names;
}

/* The one case behind which it fails, or "": halves of the context are tried, the later one first. */
static const char *bisect(const struct rerun *rerun, const char *const *context, size_t count, const char *name)
{
    while (count > 1 && gn_clock() < rerun->deadline) {
        size_t half = count / 2;
        if (!passes(rerun, context + half, count - half, name)) {
            context += half;
            count -= half;
        } else if (!passes(rerun, context, half, name)) {
            count = half;
        } else {
            return "";
        }
    }
    return count == 1 ? context[0] : "";
}

static void rerun_case(const struct rerun *rerun, const struct gn_results_case *cs, struct gn_gate_rerun *out)
{
    *out = (struct gn_gate_rerun){.name = cs->name, .after = ""};
    for (; out->alone < rerun->times && gn_clock() < rerun->deadline; out->alone++)
        out->alone_passed += passes(rerun, NULL, 0, cs->name);
    if (!out->alone_passed || !cs->worker)
        return;
    size_t count = 0;
    const char **context = context_of(rerun->gate->now, cs, &count);
    for (; context && count && out->context < rerun->times && gn_clock() < rerun->deadline; out->context++)
        out->context_passed += passes(rerun, context, count, cs->name);
    if (out->alone_passed == out->alone && out->context && !out->context_passed)
        out->after = bisect(rerun, context, count, cs->name);
    free(context);
}

/* Takes cases until none is left. */
static void *serve(void *user)
{
    struct rerun *rerun = user;
    for (size_t i; (i = rerun->next++) < rerun->count;)
        rerun_case(rerun, rerun->cases[i], &rerun->out[i]);
    return NULL;
}

void gn_gate_rerun(struct gn_gate *gate, const char *driver, uint32_t times)
{
    struct rerun rerun = {.gate = gate, .driver = driver, .deadline = gn_clock() + MOST_SECONDS, .times = times};
    pthread_t threads[MOST_CASES];
    size_t started = 0;
    gate->reruns = calloc(MOST_CASES, sizeof *gate->reruns);
    for (size_t i = 0; times && gate->reruns && i < gate->case_count && rerun.count < MOST_CASES; i++)
        if (gn_gate_case_counts(gate, i) && gn_case_status_is_failure(gate->cases[i].now->status))
            rerun.cases[rerun.count++] = gate->cases[i].now;
    rerun.out = gate->reruns;
    gate->rerun_count = rerun.count;
    /* As many processes at a time as the run had; this thread is one of those that wait for them. */
    while (started + 1 < rerun.count && started + 1 < gate->now->run.jobs &&
           pthread_create(&threads[started], NULL, serve, &rerun) == 0)
        started++;
    serve(&rerun);
    while (started)
        pthread_join(threads[--started], NULL);
}
