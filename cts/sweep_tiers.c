/* SPDX-License-Identifier: Apache-2.0 */
/* Tiers in the driver's place: see sweep_tiers.h. */
#include "cts/sweep_tiers.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "reference/tracer.h"

/* Answers are f32, as a driver's are: what is rounded here is counted in the bound, too. */
static struct gn_ref_answer answer_of(const struct gn_ref_record *record)
{
    const struct gn_ref_hit *hit = &record->hit;
    struct gn_ref_answer answer = {.kind = GN_REF_ANSWER_NONE};
    if (record->outcome != GN_REF_HIT)
        return answer;
    answer = (struct gn_ref_answer){.kind = GN_REF_ANSWER_TRIANGLE,
                                    .instance = hit->instance,
                                    .geometry = hit->geometry,
                                    .primitive = hit->primitive,
                                    .custom_index = record->custom_index,
                                    .sbt_offset = record->sbt_offset};
    if (hit->type == GN_REF_AABBS) {
        answer.kind = GN_REF_ANSWER_GENERATED; /* a candidate, which has no t */
        return answer;
    }
    answer.front = hit->front;
    answer.t = (float)hit->t;
    answer.barycentrics[0] = (float)hit->beta;
    answer.barycentrics[1] = (float)hit->gamma;
    return answer;
}

static uint64_t primitive_count(const struct gn_ref_scene *reference)
{
    uint64_t count = 0;
    for (uint32_t i = 0; i < gn_ref_scene_instance_count(reference); i++) {
        const struct gn_ref_instance *instance = gn_ref_scene_instance(reference, i);
        uint32_t geometries =
            instance->blas == GN_REF_NULL_BLAS ? 0 : gn_ref_scene_geometry_count(reference, instance->blas);
        for (uint32_t g = 0; g < geometries; g++)
            count += gn_ref_scene_geometry(reference, instance->blas, g)->primitive_count;
    }
    return count;
}

static uint32_t exact_ray_count(const struct gn_ref_scene *reference, uint32_t ray_count)
{
    /* A ray may meet everything there is, at some microseconds each. */
    enum { MOST = 48, LEAST = 4, PAIRS = 32768 };
    uint64_t fit = PAIRS / (primitive_count(reference) + 1);
    uint32_t count = fit > MOST ? MOST : fit < LEAST ? LEAST : (uint32_t)fit;
    return count < ray_count ? count : ray_count;
}

struct candidates {
    struct gn_ref_record *records;
    struct gn_ref_answer *answers;
    size_t capacity;
};

/* All that the ray meets. -1 when memory is short. */
static int64_t list_candidates(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray, struct candidates *list)
{
    int64_t count;
    while ((count = gn_ref_tracer_all(tracer, ray, list->records, list->capacity)) > (int64_t)list->capacity) {
        free(list->records);
        free(list->answers);
        list->records = calloc((size_t)count, sizeof *list->records);
        list->answers = calloc((size_t)count, sizeof *list->answers);
        list->capacity = list->records && list->answers ? (size_t)count : 0;
        if (!list->capacity)
            return -1;
    }
    for (int64_t i = 0; i < count; i++)
        list->answers[i] = answer_of(&list->records[i]);
    return count;
}

static bool tier_judge(struct gn_case_tier *tier, const struct gn_ref_tracer *tracer, struct gn_ref_judge *judge,
                       enum gn_cts_program program, const struct gn_cts_ray *ray, const struct gn_ref_record *record,
                       struct candidates *list)
{
    static const struct gn_ref_answer nothing;
    struct gn_ref_verdict verdict;
    if (program == GN_CTS_CANDIDATES) {
        int64_t count = list_candidates(tracer, &ray->ray, list);
        if (count < 0 || !gn_ref_judge_candidates(judge, &ray->ray, list->answers, (size_t)count, &nothing, &verdict))
            return false;
    } else {
        const struct gn_ref_answer answer = answer_of(record);
        if (record->outcome < 0 || !gn_ref_judge_committed(judge, &ray->ray, &ray->policy, &answer, &verdict))
            return false;
        if (verdict.hit_bound > 0 && answer.kind == GN_REF_ANSWER_TRIANGLE)
            tier->held_error_max =
                fmax(tier->held_error_max, verdict.hit_error / verdict.hit_bound * gn_ref_verdict_bound());
    }
    tier->rays++;
    tier->class_counts[verdict.cls]++;
    tier->margin_max = fmax(tier->margin_max, verdict.margin);
    return true;
}

bool gn_sweep_tiers_trace(struct gn_case_point *point, const struct gn_ref_scene *reference, struct gn_ref_judge *judge,
                          enum gn_cts_program program, const struct gn_cts_ray *rays, uint32_t ray_count,
                          char *out_error, size_t error_size)
{
    struct candidates list = {0};
    struct gn_ref_tracer *tracer = NULL;
    struct gn_ref_ray *bare = calloc(ray_count + 1, sizeof *bare);
    struct gn_ref_record *records = calloc(ray_count + 1, sizeof *records);
    bool ok = false;
    if (!bare || !records) {
        snprintf(out_error, error_size, "out of memory for %u rays of the tiers", ray_count);
        goto done;
    }
    for (uint32_t i = 0; i < ray_count; i++)
        bare[i] = rays[i].ray;
    ray_count = (ray_count + GN_SWEEP_TIER_SHARE - 1) / GN_SWEEP_TIER_SHARE;
    for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
        const char *name = gn_ref_tier_name((enum gn_ref_tier)t);
        uint32_t count = t == GN_REF_TIER_EXACT ? exact_ray_count(reference, ray_count) : ray_count;
        char why[256];
        gn_ref_tracer_destroy(tracer);
        tracer = gn_ref_tracer_create(reference, (enum gn_ref_tier)t, why, sizeof why);
        if (!tracer) {
            snprintf(out_error, error_size, "tier %s: %s", name, why);
            goto done;
        }
        if (program != GN_CTS_CANDIDATES)
            gn_ref_tracer_closest_batch(tracer, bare, count, records);
        for (uint32_t i = 0; i < count; i++)
            if (!tier_judge(&point->tiers[t], tracer, judge, program, &rays[i], &records[i], &list)) {
                snprintf(out_error, error_size, "tier %s, ray %u: invalid ray or out of memory", name, i);
                goto done;
            }
    }
    ok = true;
done:
    gn_ref_tracer_destroy(tracer);
    free(list.records);
    free(list.answers);
    free(bare);
    free(records);
    return ok;
}
