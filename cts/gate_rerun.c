/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Cases that count, run again: alone in a process of their own; and, where they pass there, behind the cases that their
 * worker had run before them, of which the one that matters is then looked for by halves. And cases with other answers, to tell
 * apart what a driver answers otherwise from one run to the next.
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
#define MOST_VARY_SECONDS 60.0

struct rerun {
    const struct gn_gate *gate;
    const char *driver, *before_driver;
    double deadline;
    uint32_t times;
    const struct gn_results_case *cases[MOST_CASES];
    struct gn_gate_case *changed[MOST_CASES]; /* in their place: cases with other answers */
    struct gn_gate_rerun *out; /* one per case */
    size_t count;
    _Atomic size_t next;
};

/* The status, and the digest of the answers, of the last of the cases, run one after another in a new process. */
static enum gn_case_status run_in_order(const struct rerun *rerun, const char *driver, const char *const *names,
                                        size_t count, uint64_t *out_answers)
{
    const struct gn_results_run *run = &rerun->gate->now->run;
    struct gn_process process;
    enum gn_case_status status = GN_CASE_CRASH;
    char error[512];
    *out_answers = 0;
    if (!gn_process_start(&process, driver, run->seed, run->scale, error, sizeof error))
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
                struct gn_results_case cs = {.status = GN_CASE_ERROR};
                if (!gn_results_case_decode(line + 2, length - 2, &arena, &cs, error, sizeof error))
                    cs = (struct gn_results_case){.status = GN_CASE_ERROR};
                status = cs.status;
                *out_answers = cs.answers;
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
    uint64_t answers;
    bool pass = !gn_case_status_is_failure(run_in_order(rerun, rerun->driver, names, count + 1, &answers));
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

/* Whether one of the drivers answers otherwise than it did itself when the case is run again. */
static bool varies(const struct rerun *rerun, const struct gn_gate_case *pair)
{
    for (uint32_t i = 0; i < rerun->times; i++) {
        for (int which = 0; which < 2 && gn_clock() < rerun->deadline; which++) {
            const struct gn_results_case *cs = which ? pair->before : pair->now;
            uint64_t answers = 0;
            (void)run_in_order(rerun, which ? rerun->before_driver : rerun->driver, &cs->name, 1, &answers);
            if (answers != cs->answers)
                return true;
        }
    }
    return false;
}

/* Takes cases until none is left. */
static void *serve(void *user)
{
    struct rerun *rerun = user;
    for (size_t i; (i = rerun->next++) < rerun->count;) {
        if (rerun->changed[i])
            rerun->changed[i]->change = varies(rerun, rerun->changed[i]) ? GN_GATE_VARIES : GN_GATE_ANSWERS;
        else
            rerun_case(rerun, rerun->cases[i], &rerun->out[i]);
    }
    return NULL;
}

/* As many processes at a time as the run had; this thread is one of those that wait for them. */
static void serve_all(struct rerun *rerun)
{
    pthread_t threads[MOST_CASES];
    size_t started = 0;
    while (started + 1 < rerun->count && started + 1 < rerun->gate->now->run.jobs &&
           pthread_create(&threads[started], NULL, serve, rerun) == 0)
        started++;
    serve(rerun);
    while (started)
        pthread_join(threads[--started], NULL);
}

void gn_gate_rerun(struct gn_gate *gate, const char *driver, uint32_t times)
{
    struct rerun rerun = {.gate = gate, .driver = driver, .deadline = gn_clock() + MOST_SECONDS, .times = times};
    gate->reruns = calloc(MOST_CASES, sizeof *gate->reruns);
    for (size_t i = 0; times && gate->reruns && i < gate->case_count && rerun.count < MOST_CASES; i++)
        if (gn_gate_case_counts(gate, i) && gn_case_status_is_failure(gate->cases[i].now->status))
            rerun.cases[rerun.count++] = gate->cases[i].now;
    rerun.out = gate->reruns;
    gate->rerun_count = rerun.count;
    serve_all(&rerun);
}

void gn_gate_vary(struct gn_gate *gate, const char *driver, const char *before_driver, uint32_t times)
{
    struct rerun rerun = {.gate = gate,
                          .driver = driver,
                          .before_driver = before_driver,
                          .deadline = gn_clock() + MOST_VARY_SECONDS,
                          .times = times};
    for (size_t i = 0; times && i < gate->case_count && rerun.count < MOST_CASES; i++)
        if (gate->cases[i].change == GN_GATE_ANSWERS)
            rerun.changed[rerun.count++] = &gate->cases[i];
    serve_all(&rerun);
}
