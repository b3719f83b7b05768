/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Measures a scene: builds every tier, lets all trace the same rays in turns, and judges every answer.
 *
 * What is right is what the exact tier says of a ray; but it traces thousands of rays per second, not
 * millions. So it is asked for the first rays of each kind, and then for those on which the certified tier
 * and another one disagree, as many as its share allows. For the others the certified answer is taken, which
 * then either every tier gave or which its proof supports.
 */
#include <float.h>
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "cts/accuracy.h"
#include "cts/progress.h"
#include "cts/statistics.h"

#define MOST_RUNS 15
/* A time shorter than this says little: the rays are traced again until it is reached. */
static double least_seconds(const struct gn_accuracy_options *options)
{
    return options->quick ? 0.002 : 0.02;
}

/* What a run of the exact tier may take, about. */
static double exact_seconds(const struct gn_accuracy_options *options)
{
    return options->quick ? 0.004 : 0.25;
}

const char *gn_accuracy_mode_name(enum gn_accuracy_mode mode)
{
    return mode == GN_ACCURACY_BATCH ? "batch" : "single";
}

/* What is kept of a record. */
struct answer {
    double t;
    uint32_t instance, geometry, primitive;
    int32_t outcome;
};

struct measurement {
    const struct gn_accuracy *accuracy;
    const struct gn_accuracy_scene *scene;
    struct gn_ref_tracer *tracers[GN_REF_TIER_COUNT];
    struct gn_ref_ray *rays;
    uint32_t ray_count, exact_count;
    struct gn_ref_record *records;
    struct answer *answers[GN_REF_TIER_COUNT][GN_ACCURACY_MODE_COUNT];
    double seconds[MOST_RUNS][GN_REF_TIER_COUNT][GN_ACCURACY_MODE_COUNT]; /* per ray */
};

static uint32_t rays_of(const struct measurement *m, enum gn_ref_tier tier)
{
    return tier == GN_REF_TIER_EXACT ? m->exact_count : m->ray_count;
}

struct part {
    const struct gn_ref_tracer *tracer;
    enum gn_accuracy_mode mode;
    const struct gn_ref_ray *rays;
    struct gn_ref_record *records;
    uint32_t count;
};

static void *trace_part(void *user)
{
    const struct part *part = user;
    if (part->mode == GN_ACCURACY_BATCH)
        gn_ref_tracer_closest_batch(part->tracer, part->rays, part->count, part->records);
    else
        for (uint32_t i = 0; i < part->count; i++)
            gn_ref_tracer_closest(part->tracer, &part->rays[i], &part->records[i]);
    return NULL;
}

/* Traces the first `count` rays once, shared out among the threads; gives the seconds. */
static double trace(struct measurement *m, enum gn_ref_tier tier, enum gn_accuracy_mode mode, uint32_t count)
{
    enum { MOST = 256 };
    uint32_t threads = m->accuracy->options.threads;
    struct part parts[MOST];
    pthread_t ids[MOST];
    bool started[MOST] = {false};
    if (threads > MOST)
        threads = MOST;
    double start = gn_clock();
    for (uint32_t i = 0; i < threads; i++) {
        uint32_t from = (uint32_t)((uint64_t)count * i / threads),
                 to = (uint32_t)((uint64_t)count * (i + 1) / threads);
        parts[i] = (struct part){m->tracers[tier], mode, m->rays + from, m->records + from, to - from};
        if (i + 1 < threads)
            started[i] = pthread_create(&ids[i], NULL, trace_part, &parts[i]) == 0;
        if (!started[i])
            trace_part(&parts[i]);
    }
    for (uint32_t i = 0; i < threads; i++)
        if (started[i])
            pthread_join(ids[i], NULL);
    return gn_clock() - start;
}

/* As many rays as the exact tier traces in its time. */
static uint32_t count_exact(struct measurement *m)
{
    uint32_t most =
        m->accuracy->options.exact_rays < m->ray_count ? m->accuracy->options.exact_rays : m->ray_count;
    uint32_t count = most < 16 ? most : 16;
    double seconds = trace(m, GN_REF_TIER_EXACT, GN_ACCURACY_SINGLE, count);
    double fits = seconds > 0 ? count * exact_seconds(&m->accuracy->options) / seconds : most;
    return fits >= most ? most : fits > 16 ? (uint32_t)fits : count;
}

/* The answers; this is the warming up, too. */
static void collect(struct measurement *m, enum gn_ref_tier tier, enum gn_accuracy_mode mode)
{
    uint32_t count = rays_of(m, tier);
    trace(m, tier, mode, count);
    for (uint32_t i = 0; i < count; i++) {
        const struct gn_ref_record *record = &m->records[i];
        m->answers[tier][mode][i] = (struct answer){record->hit.t, record->hit.instance, record->hit.geometry,
                                                    record->hit.primitive, (int32_t)record->outcome};
    }
}

static void take_time(struct measurement *m, enum gn_ref_tier tier, enum gn_accuracy_mode mode, uint32_t run)
{
    uint32_t count = rays_of(m, tier);
    double seconds = 0;
    uint32_t times = 0;
    do {
        seconds += trace(m, tier, mode, count);
        times++;
    } while (seconds < least_seconds(&m->accuracy->options) && times < 1000);
    m->seconds[run][tier][mode] = fmax(seconds, 1e-9) / ((double)times * count);
}

static bool same(const struct answer *a, const struct answer *b)
{
    return a->outcome == b->outcome &&
           (a->outcome != GN_REF_HIT ||
            (a->instance == b->instance && a->geometry == b->geometry && a->primitive == b->primitive));
}

enum decision {
    DECISION_RIGHT,
    DECISION_LOST,
    DECISION_INVENTED,
    DECISION_NEIGHBOUR,
    DECISION_OTHER,
    DECISION_COUNT
};

/* The part of the judgement that one thread does. */
struct judge {
    struct measurement *m;
    uint32_t from, to;
    uint32_t exact_budget; /* of rays for which the exact tier may be asked */
    uint64_t exact_asked;
    uint64_t counts[GN_REF_TIER_COUNT][GN_ACCURACY_MODE_COUNT][DECISION_COUNT];
    float *errors[GN_REF_TIER_COUNT][GN_ACCURACY_MODE_COUNT]; /* those of the right hits */
    uint64_t error_counts[GN_REF_TIER_COUNT][GN_ACCURACY_MODE_COUNT];
    struct gn_ref_record *list;
    size_t list_capacity;
    bool failed;
};

/* Whether the primitive is among the nearest ones, which are exactly as far as each other. */
static bool is_tied(struct judge *judge, const struct gn_ref_ray *ray, const struct gn_ref_tracer *oracle,
                    const struct answer *nearest, const struct answer *given)
{
    int64_t count;
    while ((count = gn_ref_tracer_all(oracle, ray, judge->list, judge->list_capacity)) >
           (int64_t)judge->list_capacity) {
        struct gn_ref_record *grown = realloc(judge->list, (size_t)count * sizeof *grown);
        if (!grown) {
            judge->failed = true;
            return false;
        }
        judge->list = grown;
        judge->list_capacity = (size_t)count;
    }
    if (count < 0) {
        judge->failed = true;
        return false;
    }
    struct gn_ref_hit first = {
        .instance = nearest->instance, .geometry = nearest->geometry, .primitive = nearest->primitive};
    for (int64_t i = 0; i < count; i++) {
        const struct gn_ref_hit *hit = &judge->list[i].hit;
        if (hit->instance == given->instance && hit->geometry == given->geometry &&
            hit->primitive == given->primitive)
            return gn_ref_compare_t_exact(judge->m->scene->reference, ray, &first, hit) == 0;
    }
    return false;
}

bool gn_accuracy_neighbours(const struct gn_model *model, uint32_t instance_a, uint32_t primitive_a,
                            uint32_t instance_b, uint32_t primitive_b)
{
    if (instance_a != instance_b || instance_a >= model->instance_count)
        return false;
    const struct gn_mesh *mesh = &model->meshes[model->instances[instance_a].mesh];
    if (primitive_a >= mesh->triangle_count || primitive_b >= mesh->triangle_count)
        return false;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            if (memcmp(mesh->positions[mesh->triangles[primitive_a][i]],
                       mesh->positions[mesh->triangles[primitive_b][k]], sizeof *mesh->positions) == 0)
                return true;
    return false;
}

static float error_in_ulp(double t, double exact)
{
    int exponent;
    frexp(exact, &exponent);
    return (float)fabs(ldexp(t - exact, FLT_MANT_DIG - (exponent < FLT_MIN_EXP ? FLT_MIN_EXP : exponent)));
}

static void judge_ray(struct judge *judge, uint32_t i)
{
    struct measurement *m = judge->m;
    const struct gn_ref_tracer *oracle = m->tracers[GN_REF_TIER_CERTIFIED];
    struct answer right = m->answers[GN_REF_TIER_CERTIFIED][GN_ACCURACY_SINGLE][i];
    bool agreed = true;
    for (int t = 0; t < GN_REF_TIER_EXACT; t++)
        for (int mode = 0; mode < GN_ACCURACY_MODE_COUNT; mode++)
            agreed = agreed && same(&m->answers[t][mode][i], &right);
    if (i < m->exact_count) {
        right = m->answers[GN_REF_TIER_EXACT][GN_ACCURACY_SINGLE][i];
        oracle = m->tracers[GN_REF_TIER_EXACT];
        judge->exact_asked++;
    } else if (!agreed && judge->exact_budget) {
        struct gn_ref_record record;
        gn_ref_tracer_closest(m->tracers[GN_REF_TIER_EXACT], &m->rays[i], &record);
        right = (struct answer){record.hit.t, record.hit.instance, record.hit.geometry, record.hit.primitive,
                                (int32_t)record.outcome};
        oracle = m->tracers[GN_REF_TIER_EXACT];
        judge->exact_budget--;
        judge->exact_asked++;
    }
    if (right.outcome < 0) {
        judge->failed = true;
        return;
    }
    for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
        if (i >= rays_of(m, (enum gn_ref_tier)t))
            continue;
        for (int mode = 0; mode < GN_ACCURACY_MODE_COUNT; mode++) {
            const struct answer *given = &m->answers[t][mode][i];
            enum decision decision;
            if (given->outcome < 0)
                judge->failed = true;
            if (same(given, &right))
                decision = DECISION_RIGHT;
            else if (given->outcome != GN_REF_HIT)
                decision = DECISION_LOST;
            else if (right.outcome != GN_REF_HIT)
                decision = DECISION_INVENTED;
            else if (is_tied(judge, &m->rays[i], oracle, &right, given))
                decision = DECISION_RIGHT;
            else
                decision = gn_accuracy_neighbours(&m->scene->model, right.instance, right.primitive,
                                                  given->instance, given->primitive)
                               ? DECISION_NEIGHBOUR
                               : DECISION_OTHER;
            judge->counts[t][mode][decision]++;
            if (decision == DECISION_RIGHT && right.outcome == GN_REF_HIT)
                judge->errors[t][mode][judge->error_counts[t][mode]++] = error_in_ulp(given->t, right.t);
        }
    }
}

static void *judge_part(void *user)
{
    struct judge *judge = user;
    for (uint32_t i = judge->from; i < judge->to && !judge->failed; i++)
        judge_ray(judge, i);
    return NULL;
}

static int compare_floats(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* The judges write the errors of their rays to the front of their parts: closes the holes between. */
static uint64_t gather_errors(struct judge *judges, uint32_t count, int tier, int mode)
{
    float *all = judges[0].errors[tier][mode];
    uint64_t filled = 0;
    for (uint32_t j = 0; j < count; j++) {
        memmove(all + filled, judges[j].errors[tier][mode], judges[j].error_counts[tier][mode] * sizeof *all);
        filled += judges[j].error_counts[tier][mode];
    }
    qsort(all, filled, sizeof *all, compare_floats);
    return filled;
}

static void put_row(struct measurement *m, struct gn_accuracy_row *row, struct judge *judges,
                    uint32_t judge_count)
{
    uint32_t runs = m->accuracy->options.runs;
    double speeds[MOST_RUNS], ratios[MOST_RUNS];
    for (uint32_t r = 0; r < runs; r++) {
        speeds[r] = 1e-6 / m->seconds[r][row->tier][row->mode];
        ratios[r] = m->seconds[r][GN_REF_TIER_ROBUST][row->mode] / m->seconds[r][row->tier][row->mode];
    }
    row->mrays_per_s = gn_median(speeds, runs);
    row->ratio_to_robust = gn_median(ratios, runs);
    for (uint32_t j = 0; j < judge_count; j++) {
        const uint64_t *counts = judges[j].counts[row->tier][row->mode];
        for (int d = 0; d < DECISION_COUNT; d++)
            row->rays += counts[d];
        row->lost += counts[DECISION_LOST];
        row->invented += counts[DECISION_INVENTED];
        row->neighbour += counts[DECISION_NEIGHBOUR];
        row->other += counts[DECISION_OTHER];
    }
    row->hits = gather_errors(judges, judge_count, (int)row->tier, (int)row->mode);
    const float *errors = judges[0].errors[row->tier][row->mode];
    row->t_error_median = row->hits ? (double)errors[row->hits / 2] : (double)NAN;
    row->t_error_max = row->hits ? (double)errors[row->hits - 1] : (double)NAN;
    struct gn_ref_tracer_cost cost = gn_ref_tracer_cost(m->tracers[row->tier]);
    row->build_seconds = cost.seconds;
    row->bytes = cost.bytes;
}

static bool judge_all(struct measurement *m, struct gn_accuracy *accuracy, struct gn_accuracy_row *rows)
{
    uint32_t jobs = accuracy->options.jobs;
    struct judge *judges = calloc(jobs, sizeof *judges);
    pthread_t *ids = calloc(jobs, sizeof *ids);
    float *errors = calloc((size_t)m->ray_count * GN_REF_TIER_COUNT * GN_ACCURACY_MODE_COUNT, sizeof *errors);
    bool *started = calloc(jobs, sizeof *started), ok = judges && ids && errors && started;
    for (uint32_t j = 0; ok && j < jobs; j++) {
        judges[j] = (struct judge){.m = m,
                                   .from = (uint32_t)((uint64_t)m->ray_count * j / jobs),
                                   .to = (uint32_t)((uint64_t)m->ray_count * (j + 1) / jobs),
                                   .exact_budget = m->exact_count / jobs};
        for (int t = 0; t < GN_REF_TIER_COUNT; t++)
            for (int mode = 0; mode < GN_ACCURACY_MODE_COUNT; mode++)
                judges[j].errors[t][mode] =
                    errors + (size_t)m->ray_count * (size_t)(t * GN_ACCURACY_MODE_COUNT + mode) +
                    judges[j].from;
        started[j] = j + 1 < jobs && pthread_create(&ids[j], NULL, judge_part, &judges[j]) == 0;
        if (!started[j])
            judge_part(&judges[j]);
    }
    for (uint32_t j = 0; ok && j < jobs; j++)
        if (started[j])
            pthread_join(ids[j], NULL);
    for (uint32_t j = 0; ok && j < jobs; j++)
        ok = !judges[j].failed;
    for (int mode = 0; ok && mode < GN_ACCURACY_MODE_COUNT; mode++)
        for (int t = 0; t < GN_REF_TIER_COUNT; t++)
            put_row(m, &rows[mode * GN_REF_TIER_COUNT + t], judges, jobs);
    for (uint32_t j = 0; ok && j < jobs; j++)
        accuracy->judged_exactly += judges[j].exact_asked;
    accuracy->judged += ok ? m->ray_count : 0;
    for (uint32_t j = 0; judges && j < jobs; j++)
        free(judges[j].list);
    free(judges);
    free(ids);
    free(errors);
    free(started);
    return ok;
}

static bool allocate(struct measurement *m)
{
    m->rays = calloc(m->ray_count, sizeof *m->rays);
    m->records = calloc(m->ray_count, sizeof *m->records);
    bool ok = m->rays && m->records;
    for (int t = 0; t < GN_REF_TIER_COUNT; t++)
        for (int mode = 0; mode < GN_ACCURACY_MODE_COUNT; mode++)
            ok = (m->answers[t][mode] = calloc(m->ray_count, sizeof *m->answers[t][mode])) && ok;
    return ok;
}

bool gn_accuracy_measure(struct gn_accuracy *accuracy, uint32_t scene_number, gn_accuracy_tick *tick,
                         void *user, char *out_error, size_t error_size)
{
    const struct gn_accuracy_scene *scene = &accuracy->scenes[scene_number];
    const struct gn_accuracy_options *options = &accuracy->options;
    struct gn_accuracy_row *rows =
        realloc(accuracy->rows, (accuracy->row_count + GN_ACCURACY_ROWS_PER_SCENE) * sizeof *rows);
    struct measurement *m = calloc(1, sizeof *m);
    bool ok = false;
    char why[256] = "", doing[64];
    if (rows)
        accuracy->rows = rows;
    if (!rows || !m)
        goto done;
    m->accuracy = accuracy;
    m->scene = scene;
    m->ray_count = options->rays;
    if (!allocate(m))
        goto done;
    for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
        snprintf(doing, sizeof doing, "building %s", gn_ref_tier_name((enum gn_ref_tier)t));
        tick(user, doing, 0.02 * t);
        m->tracers[t] = gn_ref_tracer_create(scene->reference, (enum gn_ref_tier)t, why, sizeof why);
        if (!m->tracers[t])
            goto done;
    }
    for (int aim = 0; aim < GN_AIM_COUNT; aim++) {
        double from = 0.1 + 0.9 * aim / GN_AIM_COUNT, part = 0.9 / GN_AIM_COUNT;
        gn_accuracy_rays(scene, (enum gn_aim)aim, options->seed, m->rays, m->ray_count);
        snprintf(doing, sizeof doing, "%s rays", gn_accuracy_aim_name((enum gn_aim)aim));
        tick(user, doing, from);
        m->exact_count = count_exact(m);
        for (int t = 0; t < GN_REF_TIER_COUNT; t++)
            for (int mode = 0; mode < GN_ACCURACY_MODE_COUNT; mode++)
                collect(m, (enum gn_ref_tier)t, (enum gn_accuracy_mode)mode);
        for (uint32_t run = 0; run < options->runs; run++) {
            tick(user, doing, from + part * 0.8 * (1 + run) / (1 + options->runs));
            /* Each run begins with another tier, so that none has always the same one before it. */
            for (uint32_t t = 0; t < GN_REF_TIER_COUNT; t++)
                for (int mode = 0; mode < GN_ACCURACY_MODE_COUNT; mode++)
                    take_time(m, (enum gn_ref_tier)((t + run) % GN_REF_TIER_COUNT),
                              (enum gn_accuracy_mode)mode, run);
        }
        snprintf(doing, sizeof doing, "judging %s rays", gn_accuracy_aim_name((enum gn_aim)aim));
        tick(user, doing, from + part * 0.8);
        struct gn_accuracy_row *first = rows + accuracy->row_count;
        for (int i = 0; i < GN_ACCURACY_MODE_COUNT * GN_REF_TIER_COUNT; i++)
            first[i] = (struct gn_accuracy_row){.scene = scene_number,
                                                .aim = (enum gn_aim)aim,
                                                .mode = (enum gn_accuracy_mode)(i / GN_REF_TIER_COUNT),
                                                .tier = (enum gn_ref_tier)(i % GN_REF_TIER_COUNT)};
        if (!judge_all(m, accuracy, first))
            goto done;
        accuracy->row_count += GN_ACCURACY_MODE_COUNT * GN_REF_TIER_COUNT;
    }
    ok = true;
done:
    if (!ok)
        snprintf(out_error, error_size, "scene %s: %s", scene->name, why[0] ? why : "out of memory");
    if (m) {
        for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
            gn_ref_tracer_destroy(m->tracers[t]);
            for (int mode = 0; mode < GN_ACCURACY_MODE_COUNT; mode++)
                free(m->answers[t][mode]);
        }
        free(m->rays);
        free(m->records);
    }
    free(m);
    return ok;
}
