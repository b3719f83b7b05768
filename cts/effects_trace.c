/* SPDX-License-Identifier: Apache-2.0 */
/* The effects of tracing: counted, forced on one by one and all together, and timed. */
#include "cts/effects.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cts/progress.h"
#include "cts/statistics.h"
#include "reference/tracer.h"

#define MOST_RUNS 15
#define STAGE "trace"

/* One way to trace the subject: with some effects forced on. */
struct way {
    uint32_t forced;
    struct gn_ref_scene *scene;
    struct gn_ref_tracer *tracer;
};

static void way_finish(struct way *way)
{
    gn_ref_tracer_destroy(way->tracer);
    gn_ref_scene_destroy(way->scene);
    way->tracer = NULL;
    way->scene = NULL;
}

/* Makes and commits; gives the seconds of the commit, and counts where `watch` does. */
static bool way_make(struct way *way, const struct gn_effects_subject *subject, struct gn_ref_effect_watch *watch,
                     double *out_seconds)
{
    way_finish(way);
    struct gn_ref_effect_watch *before = gn_ref_effects_watch(watch);
    double start = gn_clock();
    way->scene = subject->make(subject->user);
    *out_seconds = gn_clock() - start;
    gn_ref_effects_watch(before);
    if (way->scene)
        way->tracer = gn_ref_tracer_create(way->scene, GN_REF_TIER_CERTIFIED, NULL, 0);
    return way->tracer != NULL;
}

/* Every ray once, one by one, counted. */
static void count(const struct way *way, const struct gn_effects_subject *subject, struct gn_ref_effect_watch *watch,
                  struct gn_ref_record *records)
{
    struct gn_ref_effect_watch *before = gn_ref_effects_watch(watch);
    for (uint32_t i = 0; i < subject->ray_count; i++)
        gn_ref_tracer_closest(way->tracer, &subject->rays[i], &records[i]);
    gn_ref_effects_watch(before);
}

/* Seconds of all rays in batches. */
static double time_rays(const struct way *way, const struct gn_effects_subject *subject, bool quick,
                        struct gn_ref_record *records)
{
    const double least = quick ? 0.001 : 0.01;
    struct gn_ref_effect_watch watch = {.forced = way->forced};
    struct gn_ref_effect_watch *before = gn_ref_effects_watch(&watch);
    double start = gn_clock(), seconds;
    uint32_t times = 0;
    do
        gn_ref_tracer_closest_batch(way->tracer, subject->rays, subject->ray_count, records);
    while (times++ < 10000 && (seconds = gn_clock() - start) < least);
    seconds = gn_clock() - start;
    gn_ref_effects_watch(before);
    return fmax(seconds, 1e-9) / times;
}

/* The ratio of the forced way to the usual one, in turns; the one first that was second before. */
static bool time_both(const struct gn_effects_report *report, const struct gn_effects_subject *subject,
                      const struct way *usual, const struct way *forced, struct gn_ref_record *records,
                      double *out_trace, double *out_commit)
{
    double traces[MOST_RUNS], commits[MOST_RUNS], slowest = 0;
    struct way spare = {0};
    uint32_t runs = report->options.runs, commit_runs = 0;
    for (uint32_t run = 0; run < runs; run++) {
        double seconds[2], placing[2];
        bool slow = run > 0 && slowest > 0.5;
        for (uint32_t k = 0; k < 2; k++) {
            uint32_t which = (k + run) % 2;
            seconds[which] = time_rays(which ? forced : usual, subject, report->options.quick, records);
        }
        traces[run] = seconds[1] / seconds[0];
        /* A large scene is not placed over and over again. */
        if (slow)
            continue;
        for (uint32_t k = 0; k < 2; k++) {
            uint32_t which = (k + run) % 2;
            struct gn_ref_effect_watch watch = {.forced = which ? forced->forced : usual->forced};
            if (!way_make(&spare, subject, &watch, &placing[which]))
                return false;
        }
        commits[commit_runs++] = placing[1] / placing[0];
        slowest = fmax(slowest, placing[0]);
    }
    way_finish(&spare);
    *out_trace = gn_median(traces, runs);
    *out_commit = gn_median(commits, commit_runs);
    return true;
}

/* Decisions alike, and numbers within what both promise. */
static bool alike(const struct gn_ref_record *a, const struct gn_ref_record *b)
{
    const struct gn_ref_hit *p = &a->hit, *q = &b->hit;
    return a->outcome == b->outcome && p->type == q->type && p->instance == q->instance && p->geometry == q->geometry &&
           p->primitive == q->primitive && p->front == q->front && p->opaque == q->opaque &&
           (p->t == q->t || fabs(p->t - q->t) <= a->hit.t_error + b->hit.t_error) &&
           fabs(p->beta - q->beta) <= a->hit.barycentric_error + b->hit.barycentric_error &&
           fabs(p->gamma - q->gamma) <= a->hit.barycentric_error + b->hit.barycentric_error;
}

static uint64_t differing(const struct gn_ref_record *a, const struct gn_ref_record *b, uint32_t n)
{
    uint64_t sum = 0;
    for (uint32_t i = 0; i < n; i++)
        sum += !alike(&a[i], &b[i]);
    return sum;
}

/* The mean of ratios over subjects, by their rays. */
static void ratio_add(double *mean, double ratio, uint64_t rays_before, uint32_t rays)
{
    *mean = isnan(*mean) ? ratio : (*mean * (double)rays_before + ratio * rays) / ((double)rays_before + rays);
}

static void rows_begin(struct gn_effects_report *report)
{
    for (int e = 0; e < GN_REF_EFFECT_COUNT; e++)
        report->rows[report->row_count++] =
            (struct gn_effects_row){.stage = STAGE,
                                    .name = gn_ref_effect_name((enum gn_ref_effect)e),
                                    .counted = gn_ref_effect_counted((enum gn_ref_effect)e),
                                    .trace_ratio = (double)NAN,
                                    .commit_ratio = (double)NAN};
    report->all_trace_ratio = report->all_commit_ratio = (double)NAN;
}

/* Who calls for what. Gives the effects that every ray calls for. */
static uint32_t callers_add(struct gn_effects_row *rows, const struct gn_ref_scene *scene,
                            const struct gn_effects_subject *subject)
{
    uint32_t calling[GN_REF_EFFECT_COUNT] = {0}, all = 0;
    struct gn_ref_effects effects = {0};
    for (uint32_t i = 0; i < subject->ray_count; i++) {
        const struct gn_ref_ray *ray = &subject->rays[i];
        if (i == 0 || ray->flags != ray[-1].flags || ray->cull_mask != ray[-1].cull_mask)
            gn_ref_effects_of(scene, ray->flags, ray->cull_mask, &effects);
        for (int e = 0; e < GN_REF_EFFECT_COUNT; e++) {
            bool called = effects.called >> e & 1;
            if (!rows[e].why[0] || (called && !rows[e].rays_calling && !calling[e]))
                memcpy(rows[e].why, effects.why[e], sizeof rows[e].why);
            calling[e] += called;
        }
    }
    for (int e = 0; e < GN_REF_EFFECT_COUNT; e++) {
        rows[e].rays += subject->ray_count;
        rows[e].rays_calling += calling[e];
        if (calling[e] == subject->ray_count)
            all |= 1u << e;
    }
    return all;
}

static void work_add(struct gn_ref_effect_counts *sum, const struct gn_ref_effect_counts *more)
{
    uint64_t *to = (uint64_t *)sum;
    const uint64_t *from = (const uint64_t *)more;
    for (size_t i = 0; i < sizeof *sum / sizeof *to; i++)
        to[i] += from[i];
}

bool gn_effects_trace_add(struct gn_effects_report *report, const struct gn_effects_subject *subject)
{
    struct way usual = {0}, forced = {0};
    struct gn_ref_effect_watch watch = {.counting = true};
    double seconds;
    bool ok = false;
    struct gn_ref_record *records = calloc(2 * (size_t)subject->ray_count + 1, sizeof *records), *others;
    if (!records || !way_make(&usual, subject, &watch, &seconds))
        goto done;
    others = records + subject->ray_count;
    if (!report->row_count)
        rows_begin(report);
    struct gn_effects_row *rows = report->rows;
    uint32_t called = callers_add(rows, usual.scene, subject), every = (1u << GN_REF_EFFECT_COUNT) - 1;
    count(&usual, subject, &watch, records);
    work_add(&report->work, &watch.counts);
    for (int e = 0; e < GN_REF_EFFECT_COUNT; e++)
        rows[e].ran += watch.counts.ran[e];
    for (int e = 0; e <= GN_REF_EFFECT_COUNT; e++) {
        bool all = e == GN_REF_EFFECT_COUNT;
        double trace_ratio, commit_ratio;
        if (!all && (called >> e & 1))
            continue;
        forced.forced = all ? every & ~called : 1u << e;
        watch = (struct gn_ref_effect_watch){.counting = true, .forced = forced.forced};
        if (!way_make(&forced, subject, &watch, &seconds))
            goto done;
        count(&forced, subject, &watch, others);
        uint64_t changed = differing(records, others, subject->ray_count);
        if (!time_both(report, subject, &usual, &forced, others, &trace_ratio, &commit_ratio))
            goto done;
        if (all) {
            report->all_differing += changed;
            ratio_add(&report->all_trace_ratio, trace_ratio, report->rays, subject->ray_count);
            ratio_add(&report->all_commit_ratio, commit_ratio, report->rays, subject->ray_count);
        } else {
            rows[e].forced_ran += watch.counts.ran[e];
            rows[e].differing += changed;
            ratio_add(&rows[e].trace_ratio, trace_ratio, rows[e].rays_forced, subject->ray_count);
            ratio_add(&rows[e].commit_ratio, commit_ratio, rows[e].rays_forced, subject->ray_count);
            rows[e].rays_forced += subject->ray_count;
        }
    }
    report->rays += subject->ray_count;
    ok = true;
done:
    way_finish(&usual);
    way_finish(&forced);
    free(records);
    return ok;
}

bool gn_effects_fault(const struct gn_effects_report *report, char *out, size_t size)
{
    for (uint32_t i = 0; i < report->row_count; i++) {
        const struct gn_effects_row *row = &report->rows[i];
        if (!row->rays_calling && row->ran) {
            snprintf(out, size, "%s is not called for, and ran %llu times", row->name, (unsigned long long)row->ran);
            return true;
        }
        if (row->differing) {
            snprintf(out, size, "%s, forced on, changed the answers of %llu rays", row->name,
                     (unsigned long long)row->differing);
            return true;
        }
    }
    if (report->all_differing)
        snprintf(out, size, "everything forced on changed the answers of %llu rays",
                 (unsigned long long)report->all_differing);
    return report->all_differing > 0;
}
