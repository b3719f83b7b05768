/* SPDX-License-Identifier: Apache-2.0 */
/* Runs a case: the same scene on the driver and in the reference, every answer judged, everything counted. */
#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <xxhash.h>

#include "cts/case.h"
#include "cts/sweep_tiers.h"
#include "cts/table.h"

/* Hit errors of a case, for the distribution. */
struct gn_case_samples {
    float *values;
    size_t count, capacity;
};

const char *gn_case_status_name(enum gn_case_status status)
{
    static const char *const names[] = {"pass", "fail", "leak", "skip", "crash", "timeout", "error"};
    return status < GN_CASE_STATUS_COUNT ? names[status] : "unknown";
}

const char *gn_case_backend_name(enum gn_case_backend backend)
{
    static const char *const names[] = {"query", "pipeline", ""};
    return backend < GN_CASE_BACKEND_COUNT ? names[backend] : "unknown";
}

/* The first message of the worst status is kept. */
static void status_raise(struct gn_case_run *run, enum gn_case_status status, const char *format, va_list arguments)
{
    static const int rank[GN_CASE_STATUS_COUNT] = {
        [GN_CASE_PASS] = 0, [GN_CASE_SKIP] = 1,    [GN_CASE_LEAK] = 2, [GN_CASE_FAIL] = 3,
        [GN_CASE_ERROR] = 4, [GN_CASE_TIMEOUT] = 5, [GN_CASE_CRASH] = 6};
    if (rank[status] <= rank[run->result.status])
        return;
    run->result.status = status;
    vsnprintf(run->result.message, sizeof run->result.message, format, arguments);
}

void gn_case_skip(struct gn_case_run *run, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    status_raise(run, GN_CASE_SKIP, format, arguments);
    va_end(arguments);
}

void gn_case_fail(struct gn_case_run *run, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    status_raise(run, GN_CASE_FAIL, format, arguments);
    va_end(arguments);
}

bool gn_case_check(struct gn_case_run *run, bool holds, const char *format, ...)
{
    run->result.checks++;
    if (!holds) {
        va_list arguments;
        va_start(arguments, format);
        status_raise(run, GN_CASE_FAIL, format, arguments);
        va_end(arguments);
    }
    return holds;
}

static void case_error(struct gn_case_run *run, const char *format, ...) __attribute__((format(printf, 2, 3)));
static void case_error(struct gn_case_run *run, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    status_raise(run, GN_CASE_ERROR, format, arguments);
    va_end(arguments);
}

static void case_leak(struct gn_case_run *run, const char *format, ...) __attribute__((format(printf, 2, 3)));
static void case_leak(struct gn_case_run *run, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    status_raise(run, GN_CASE_LEAK, format, arguments);
    va_end(arguments);
}

static bool device_answered(struct gn_case_run *run, enum gn_device_status status)
{
    switch (status) {
    case GN_DEVICE_OK:
        return true;
    case GN_DEVICE_UNSUPPORTED:
        gn_case_skip(run, "%s", gn_device_message(run->device));
        break;
    case GN_DEVICE_FAILED:
    case GN_DEVICE_LOST:
        case_error(run, "%s", gn_device_message(run->device));
        break;
    }
    return false;
}

/* Faces at infinity are brought to the end of f32, which changes nothing for a ray that does not get there. */
static const float (*boxes_ended(struct gn_arena *arena, const struct gn_cts_geometry *source))[6]
{
    float(*boxes)[6] = gn_arena_alloc(arena, source->aabb_count, sizeof *boxes);
    for (uint32_t i = 0; i < source->aabb_count; i++)
        for (int k = 0; k < 6; k++) {
            float face = source->aabbs[i][k];
            boxes[i][k] = isinf(face) ? copysignf(FLT_MAX, face) : face;
        }
    return (const float(*)[6])boxes;
}

struct gn_ref_scene *gn_case_reference(struct gn_case_run *run, const struct gn_cts_scene *scene)
{
    struct gn_ref_scene *reference = gn_ref_scene_create();
    if (!reference)
        goto fail;
    for (uint32_t b = 0; b < scene->blas_count; b++) {
        const struct gn_cts_blas *blas = &scene->blases[b];
        struct gn_ref_geometry *geometries = GN_NEW(&run->arena, struct gn_ref_geometry, blas->geometry_count);
        for (uint32_t g = 0; g < blas->geometry_count; g++) {
            const struct gn_cts_geometry *source = &blas->geometries[g];
            struct gn_ref_geometry *geometry = &geometries[g];
            geometry->type = source->type;
            geometry->flags = source->flags;
            geometry->divisor = 1;
            if (source->type == GN_REF_AABBS) {
                geometry->primitive_count = source->aabb_count;
                geometry->aabbs = boxes_ended(&run->arena, source);
                continue;
            }
            geometry->primitive_count = source->triangle_count;
            geometry->position_count = source->position_count;
            geometry->triangles = source->triangles;
            geometry->transform = source->transform;
            if (!gn_geometry_decoded_positions(source, &run->arena, &geometry->positions, &geometry->divisor)) {
                case_error(run, "BLAS %u, geometry %u: no exact values for vertex format %d", b, g,
                           (int)source->vertex_format);
                goto fail;
            }
        }
        uint32_t index;
        if (!gn_ref_scene_add_blas(reference, geometries, blas->geometry_count, &index))
            goto fail;
    }
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct gn_cts_instance *source = &scene->instances[i];
        struct gn_ref_instance instance = {
            .custom_index = source->custom_index,
            .mask = source->mask,
            .sbt_offset = source->sbt_offset,
            .flags = source->flags,
            .blas = source->blas == GN_CTS_NO_BLAS ? GN_REF_NULL_BLAS : source->blas,
        };
        memcpy(instance.transform, source->transform, sizeof instance.transform);
        if (!gn_ref_scene_add_instance(reference, &instance))
            goto fail;
    }
    if (!gn_ref_scene_commit(reference))
        goto fail;
    return reference;
fail:
    case_error(run, "the reference cannot take the scene: %s",
               reference ? gn_ref_scene_error(reference) : "out of memory");
    gn_ref_scene_destroy(reference);
    return NULL;
}

/* Makes a passing verdict a wrong one, with a reason. */
static void verdict_wrong(struct gn_ref_verdict *verdict, const char *format, ...)
    __attribute__((format(printf, 2, 3)));
static void verdict_wrong(struct gn_ref_verdict *verdict, const char *format, ...)
{
    if (verdict->cls == GN_REF_WRONG)
        return;
    va_list arguments;
    va_start(arguments, format);
    verdict->cls = GN_REF_WRONG;
    vsnprintf(verdict->reason, sizeof verdict->reason, format, arguments);
    va_end(arguments);
}

/* The worst ratio of difference to unit times size, and where. */
static double worst_error(const float *found, const double *expected, const double *sizes, int count, int *out_at)
{
    double worst = 0;
    *out_at = 0;
    for (int i = 0; i < count; i++) {
        double error = fabs((double)found[i] - expected[i]) / (0x1p-24 * sizes[i]);
        if (!(error <= worst)) {
            worst = error;
            *out_at = i;
        }
    }
    return worst;
}

static void judge_detail(struct gn_ref_judge *judge, const struct gn_ref_scene *reference,
                         const struct gn_cts_ray *ray, const struct gn_ref_answer *answer,
                         const struct gn_cts_detail *detail, struct gn_ref_verdict *verdict)
{
    /* What is copied has no tolerance. Comparing values lets -0 stand for 0. */
    for (int i = 0; i < 3; i++) {
        if (detail->world_origin[i] != ray->ray.origin[i])
            verdict_wrong(verdict, "world ray origin[%d] reads back as %.9g, given was %.9g", i,
                          (double)detail->world_origin[i], (double)ray->ray.origin[i]);
        if (detail->world_direction[i] != ray->ray.direction[i])
            verdict_wrong(verdict, "world ray direction[%d] reads back as %.9g, given was %.9g", i,
                          (double)detail->world_direction[i], (double)ray->ray.direction[i]);
    }
    if (detail->tmin != ray->ray.tmin)
        verdict_wrong(verdict, "tmin reads back as %.9g, given was %.9g", (double)detail->tmin,
                      (double)ray->ray.tmin);
    if (detail->flags != ray->ray.flags)
        verdict_wrong(verdict, "ray flags read back as 0x%X, given were 0x%X", detail->flags, ray->ray.flags);
    if (answer->kind == GN_REF_ANSWER_NONE)
        return;
    struct gn_ref_object_ray object;
    const struct gn_ref_instance *instance = gn_ref_scene_instance(reference, answer->instance);
    if (!instance || !gn_ref_judge_object_ray(judge, &ray->ray, answer->instance, &object))
        return; /* the committed verdict has said so */
    for (int i = 0; i < 12; i++)
        if (detail->world_from_object[i] != instance->transform[i])
            verdict_wrong(verdict, "object-to-world row %d column %d reads back as %.9g, the instance has %.9g",
                          i / 4, i % 4, (double)detail->world_from_object[i], (double)instance->transform[i]);
    int at;
    double bound = gn_ref_verdict_bound(), error;
    error = worst_error(detail->object_from_world, object.object_from_world, object.size_object_from_world, 12, &at);
    if (!(error <= bound))
        verdict_wrong(verdict,
                      "world-to-object row %d column %d reads back as %.9g, ideal is %.9g: %.3g units (the bound "
                      "is %g)",
                      at / 4, at % 4, (double)detail->object_from_world[at], object.object_from_world[at], error,
                      bound);
    error = worst_error(detail->object_origin, object.origin, object.size_origin, 3, &at);
    if (!(error <= bound))
        verdict_wrong(verdict, "object ray origin[%d] reads back as %.9g, ideal is %.9g: %.3g units (the bound is %g)",
                      at, (double)detail->object_origin[at], object.origin[at], error, bound);
    error = worst_error(detail->object_direction, object.direction, object.size_direction, 3, &at);
    if (!(error <= bound))
        verdict_wrong(verdict,
                      "object ray direction[%d] reads back as %.9g, ideal is %.9g: %.3g units (the bound is %g)", at,
                      (double)detail->object_direction[at], object.direction[at], error, bound);
}

static void judge_positions(struct gn_ref_judge *judge, const struct gn_ref_answer *answer, const float found[9],
                            struct gn_ref_verdict *verdict)
{
    /* A matrix times a vector in f32, in any order of operations: three products, three sums. */
    const double position_bound = 6;
    double vertices[3][3], sizes[3][3];
    bool exact;
    int at;
    if (answer->kind != GN_REF_ANSWER_TRIANGLE ||
        !gn_ref_judge_vertices(judge, answer->instance, answer->geometry, answer->primitive, vertices, sizes, &exact))
        return;
    double error = worst_error(found, &vertices[0][0], &sizes[0][0], 9, &at);
    if (exact ? error != 0 : !(error <= position_bound))
        verdict_wrong(verdict,
                      "vertex %d component %d of triangle %u reads back as %.9g, %s is %.9g: %.3g units (the bound "
                      "is %g)",
                      at / 3, at % 3, answer->primitive, (double)found[at], exact ? "given" : "ideal",
                      (&vertices[0][0])[at], error, exact ? 0.0 : position_bound);
}

static void sample_add(struct gn_case_samples *samples, double value)
{
    if (samples->count == samples->capacity) {
        size_t capacity = samples->capacity ? 2 * samples->capacity : 4096;
        float *grown = realloc(samples->values, capacity * sizeof *grown);
        if (!grown)
            return; /* the distribution then covers what came before */
        samples->values = grown;
        samples->capacity = capacity;
    }
    samples->values[samples->count++] = (float)value;
}

static void image_begin(struct gn_case_run *run, uint32_t ray_count, uint32_t width)
{
    struct gn_case_result *result = &run->result;
    free(result->image);
    result->image = NULL;
    if (!width)
        width = (uint32_t)ceil(sqrt((double)ray_count));
    uint32_t height = (ray_count + width - 1) / width;
    result->image = malloc((size_t)width * height);
    if (!result->image)
        return;
    memset(result->image, 0xFF, (size_t)width * height); /* 0xFF: no ray */
    result->image_width = width;
    result->image_height = height;
}

static void point_add(struct gn_case_run *run, const struct gn_ref_verdict *verdict, bool measured, double hit_error)
{
    struct gn_case_point *point = run->point;
    point->rays++;
    point->ideal_hits += verdict->ideal_hit;
    point->class_counts[verdict->cls]++;
    point->margin_max = fmax(point->margin_max, verdict->margin);
    if (!measured)
        return;
    sample_add(run->point_samples, hit_error);
    if (verdict->hit_bound > 0)
        point->held_error_max =
            fmax(point->held_error_max, verdict->hit_error / verdict->hit_bound * gn_ref_verdict_bound());
}

/* What one answer comes to. */
struct judged {
    struct gn_ref_answer answer; /* none where there is a fault */
    struct gn_ref_verdict verdict;
    double hit_error;
    bool measured; /* the hit error says something */
};

/* False, and the run in error, when there is no verdict. */
static bool answer_judge(struct gn_case_run *run, struct gn_ref_judge *judge, const struct gn_ref_scene *reference,
                         enum gn_cts_program program, const struct gn_cts_ray *ray, uint32_t i,
                         const struct gn_cts_answers *answers, struct judged *out)
{
    struct gn_ref_verdict *verdict = &out->verdict;
    struct gn_ref_answer *answer = &out->answer;
    const char *fault = gn_answer_fault((uint32_t)answers->committed[i].kind);
    *answer = fault ? (struct gn_ref_answer){.kind = GN_REF_ANSWER_NONE} : answers->committed[i];
    struct gn_ref_policy policy = ray->policy;
    if (program == GN_CTS_CANDIDATES)
        policy.confirm_mask = policy.generate_mask = 0;
    if (!gn_ref_judge_committed(judge, &ray->ray, &policy, answer, verdict)) {
        case_error(run, "the reference cannot judge ray %u: invalid ray or out of memory", i);
        return false;
    }
    out->hit_error = verdict->hit_error;
    if (program == GN_CTS_CANDIDATES && !fault) {
        const struct gn_cts_candidates *candidates = &answers->candidates[i];
        struct gn_ref_verdict listed;
        if (candidates->count > GN_CTS_MAX_CANDIDATES) {
            case_error(run, "ray %u met %u candidates, more than the %d that are recorded", i, candidates->count,
                       GN_CTS_MAX_CANDIDATES);
            return false;
        }
        if (!gn_ref_judge_candidates(judge, &ray->ray, candidates->list, candidates->count, answer, &listed)) {
            case_error(run, "the reference cannot judge ray %u: invalid ray or out of memory", i);
            return false;
        }
        if (!verdict->ideal_hit)
            verdict->ideal = listed.ideal;
        verdict->ideal_hit |= listed.ideal_hit;
        if (listed.cls > verdict->cls) {
            verdict->cls = listed.cls;
            memcpy(verdict->reason, listed.reason, sizeof verdict->reason);
        }
        verdict->margin = fmax(verdict->margin, listed.margin);
        for (uint32_t c = 0; c < candidates->count; c++)
            out->hit_error = fmax(out->hit_error, listed.hit_error);
    }
    if (fault) {
        verdict->cls = GN_REF_EXACT; /* whatever a miss would have been */
        verdict_wrong(verdict, "has no answer: %s", fault);
    }
    if (program == GN_CTS_DETAIL)
        judge_detail(judge, reference, ray, answer, &answers->details[i], verdict);
    if (program == GN_CTS_POSITIONS)
        judge_positions(judge, answer, answers->positions[i], verdict);

    /* The error of a hit on a primitive that is not there says nothing about rounding. */
    bool elsewhere = verdict->cls == GN_REF_WRONG &&
                     !(verdict->ideal_hit && verdict->ideal.instance == answer->instance &&
                       verdict->ideal.geometry == answer->geometry && verdict->ideal.primitive == answer->primitive);
    out->measured = answer->kind == GN_REF_ANSWER_TRIANGLE && !elsewhere;
    return true;
}

/* What an earlier run found of the same answer to the same ray, as far as it is kept. False where it has to be judged. */
static bool answer_recall(const struct gn_case_run *run, const struct gn_ref_answer *answer, size_t kept, struct judged *out)
{
    float known = run->point ? GN_CASE_KEPT_OTHER : gn_case_known_verdict(run, kept);
    if (known == GN_CASE_KEPT_OTHER)
        return false;
    out->answer = *answer;
    out->verdict.cls = GN_REF_EXACT;
    out->verdict.ideal_hit = known != GN_CASE_KEPT_MISS;
    out->verdict.margin = 0;
    out->measured = known >= 0;
    out->hit_error = (double)known;
    return true;
}

static float verdict_keep(const struct judged *judged)
{
    const struct gn_ref_verdict *verdict = &judged->verdict;
    if (verdict->cls != GN_REF_EXACT || verdict->margin != 0 || (judged->measured && !verdict->ideal_hit))
        return GN_CASE_KEPT_OTHER;
    return judged->measured ? (float)judged->hit_error : verdict->ideal_hit ? GN_CASE_KEPT_HIT : GN_CASE_KEPT_MISS;
}

/* `kept` is the ray's place among all of the case. */
static void judge_ray(struct gn_case_run *run, struct gn_ref_judge *judge, const struct gn_ref_scene *reference,
                      enum gn_cts_program program, const struct gn_cts_ray *ray, uint32_t i,
                      const struct gn_cts_answers *answers, size_t kept, bool keep_image)
{
    struct gn_case_result *result = &run->result;
    struct judged judged;
    const struct gn_ref_verdict *verdict = &judged.verdict;
    if (!answer_recall(run, &answers->committed[i], kept, &judged)) {
        if (!answer_judge(run, judge, reference, program, ray, i, answers, &judged))
            return;
        result->kept.verdicts[kept] = verdict_keep(&judged);
    }
    if (run->point)
        point_add(run, verdict, judged.measured, judged.hit_error);
    if (keep_image && result->image)
        result->image[i] = (uint8_t)(verdict->cls | (verdict->ideal_hit ? 0 : 0x80));
    bool selected = run->only_ray >= 0;
    if (run->point && !run->point->judged && !selected)
        return;

    result->rays++;
    result->ideal_hits += verdict->ideal_hit;
    result->class_counts[verdict->cls]++;
    if (judged.measured)
        sample_add(run->samples, judged.hit_error);
    if (verdict->cls < GN_REF_GAP && verdict->margin > result->margin_max)
        result->margin_max = verdict->margin;

    bool bad = verdict->cls >= GN_REF_LEAK;
    if (selected || (bad && (!result->has_offender || verdict->cls > result->offender.verdict.cls))) {
        result->has_offender = true;
        result->offender = (struct gn_case_offender){.trace = run->trace_count,
                                                     .ray_index = i,
                                                     .ray = *ray,
                                                     .answer = judged.answer,
                                                     .verdict = *verdict};
    }
}

/* Whether rays of this trace are wanted, and which. */
static bool trace_selected(struct gn_case_run *run, uint32_t ray_count, uint32_t *out_first, uint32_t *out_end)
{
    *out_first = 0;
    *out_end = ray_count;
    if (run->result.status == GN_CASE_ERROR || (run->only_trace >= 0 && run->only_trace != run->trace_count))
        return false;
    if (run->only_ray < 0)
        return true;
    if (run->only_ray >= ray_count) {
        case_error(run, "trace %u has %u rays: there is no ray %lld", run->trace_count, ray_count,
                   (long long)run->only_ray);
        return false;
    }
    *out_first = (uint32_t)run->only_ray;
    *out_end = *out_first + 1;
    return true;
}

/* The answers start at the first ray. */
static void judge_rays(struct gn_case_run *run, const struct gn_cts_scene *scene, enum gn_cts_program program,
                       const struct gn_cts_ray *rays, uint32_t ray_count, uint32_t first, uint32_t end, uint32_t width,
                       const struct gn_cts_answers *answers)
{
    struct gn_case_result *result = &run->result;
    struct gn_ref_judge *judge = NULL;
    struct gn_ref_scene *reference = gn_case_reference(run, scene);
    if (!reference)
        goto done;
    judge = gn_ref_judge_create(reference);
    if (!judge) {
        case_error(run, "out of memory for the judge");
        goto done;
    }
    /* The picture is of the first trace until one has a worse answer. */
    enum gn_ref_verdict_class before = result->has_offender ? result->offender.verdict.cls : GN_REF_EXACT;
    uint8_t *old_image = result->image;
    uint32_t old_width = result->image_width, old_height = result->image_height;
    result->image = NULL;
    if (run->only_ray < 0)
        image_begin(run, ray_count, width);
    size_t kept = result->kept.count;
    gn_case_digest(run, reference, program, rays + first, answers, end - first);
    for (uint32_t i = 0; i < end - first; i++)
        judge_ray(run, judge, reference, program, &rays[first + i], i, answers, kept + i, run->only_ray < 0);
    char error[320];
    /* What the tiers say of the same rays, an earlier run has shown. */
    if (run->point && run->with_tiers && run->only_ray < 0 && !run->known.count &&
        !gn_sweep_tiers_trace(run->point, reference, judge, program, rays, ray_count, error, sizeof error))
        case_error(run, "%s", error);
    if (run->only_ray >= 0 && result->has_offender) {
        result->offender.ray_index = first;
        result->nearest_count = gn_ref_trace_all_exact(reference, &rays[first].ray, result->nearest,
                                                       sizeof result->nearest / sizeof result->nearest[0]);
    }
    if (old_image && !(result->has_offender && result->offender.verdict.cls > before)) {
        free(result->image);
        result->image = old_image;
        result->image_width = old_width;
        result->image_height = old_height;
    } else {
        free(old_image);
    }
done:
    gn_ref_judge_destroy(judge);
    gn_ref_scene_destroy(reference);
}

/* The scene as the route needs it; NULL when it cannot be. */
static const struct gn_cts_scene *scene_for(struct gn_case_run *run, const struct gn_cts_scene *scene,
                                            struct gn_arena *arena)
{
    if (run->route.entry != GN_CTS_PIPELINE && run->route.entry != GN_CTS_QUERY_IN_HIT)
        return scene;
    scene = gn_table_scene(arena, scene, &run->route);
    if (!scene)
        gn_case_skip(run, "the scene has more geometries than there are records for");
    return scene;
}

static bool trace(struct gn_case_run *run, const struct gn_cts_scene *scene, enum gn_cts_program program,
                  const struct gn_cts_ray *rays, uint32_t ray_count, struct gn_arena *arena,
                  struct gn_cts_answers *out_answers)
{
    struct gn_built_scene *built = NULL;
    bool traced = device_answered(run, gn_scene_build(run->device, scene, &built)) &&
                  device_answered(run, gn_scene_trace(built, &run->route, program, rays, ray_count, arena,
                                                      out_answers));
    gn_built_scene_destroy(built);
    return traced;
}

void gn_case_trace(struct gn_case_run *run, const struct gn_cts_scene *scene, enum gn_cts_program program,
                   const struct gn_cts_ray *rays, uint32_t ray_count, uint32_t width)
{
    gn_case_trace_as(run, scene, program, rays, rays, ray_count, width);
}

void gn_case_trace_as(struct gn_case_run *run, const struct gn_cts_scene *scene, enum gn_cts_program program,
                      const struct gn_cts_ray *rays, const struct gn_cts_ray *judged, uint32_t ray_count,
                      uint32_t width)
{
    struct gn_cts_answers answers = {0};
    struct gn_arena arena = {0};
    uint32_t first, end;
    if (run->witness) {
        run->witness(run, scene, rays, ray_count, run->witness_user);
        return;
    }
    if (trace_selected(run, ray_count, &first, &end) && (scene = scene_for(run, scene, &arena)) != NULL &&
        trace(run, scene, program, rays + first, end - first, &arena, &answers))
        judge_rays(run, scene, program, judged, ray_count, first, end, width, &answers);
    run->trace_count++;
    gn_arena_finish(&arena);
}

bool gn_case_answers(struct gn_case_run *run, const struct gn_cts_scene *scene, enum gn_cts_program program,
                     const struct gn_cts_ray *rays, uint32_t ray_count, struct gn_arena *arena,
                     struct gn_cts_answers *out_answers)
{
    if (run->witness) {
        run->witness(run, scene, rays, ray_count, run->witness_user);
        return false;
    }
    return run->result.status != GN_CASE_ERROR && (scene = scene_for(run, scene, arena)) != NULL &&
           trace(run, scene, program, rays, ray_count, arena, out_answers);
}

void gn_case_judge(struct gn_case_run *run, const struct gn_cts_scene *scene, enum gn_cts_program program,
                   const struct gn_cts_ray *rays, uint32_t ray_count, uint32_t width,
                   const struct gn_cts_answers *answers)
{
    if (run->result.status != GN_CASE_ERROR)
        judge_rays(run, scene, program, rays, ray_count, 0, ray_count, width, answers);
    run->trace_count++;
}

static int float_compare(const void *left, const void *right)
{
    float a = *(const float *)left, b = *(const float *)right;
    return a < b ? -1 : a > b;
}

static void samples_distribution(struct gn_case_samples *samples, double *out_median, double *out_p999,
                                 double *out_max)
{
    if (!samples->count)
        return;
    qsort(samples->values, samples->count, sizeof *samples->values, float_compare);
    size_t last = samples->count - 1;
    *out_median = (double)samples->values[last / 2];
    *out_p999 = (double)samples->values[(size_t)((double)last * 0.999)];
    *out_max = (double)samples->values[last];
}

static void samples_bins(const struct gn_case_samples *samples, uint64_t bins[GN_CASE_ERROR_BINS])
{
    for (size_t i = 0; i < samples->count; i++) {
        double value = (double)samples->values[i], at = value > 0 ? floor(4 * (log2(value) + 8)) + 2 : 0;
        bins[value > 0 ? (size_t)fmin(fmax(at, 1), GN_CASE_ERROR_BINS - 1) : 0]++;
    }
}

static bool classes_left(const uint64_t class_counts[GN_REF_VERDICT_CLASS_COUNT])
{
    return class_counts[GN_REF_LEAK] || class_counts[GN_REF_DOUBLE_HIT] || class_counts[GN_REF_WRONG];
}

const struct gn_case_point *gn_case_curve_left(const struct gn_case_curve *curve)
{
    for (uint32_t i = 0; i < curve->count; i++)
        if (classes_left(curve->points[i].class_counts))
            return &curve->points[i];
    return NULL;
}

const struct gn_case_point *gn_case_curve_tier_left(const struct gn_case_curve *curve, enum gn_ref_tier tier)
{
    for (uint32_t i = 0; i < curve->count; i++)
        if (classes_left(curve->points[i].tiers[tier].class_counts))
            return &curve->points[i];
    return NULL;
}

void gn_case_curve_begin(struct gn_case_run *run, const char *parameter, const char *unit, const char *why,
                         uint32_t count)
{
    run->result.curve = (struct gn_case_curve){.parameter = parameter, .unit = unit, .why = why};
    run->result.curve.points = GN_NEW(&run->arena, struct gn_case_point, count);
}

void gn_case_point_begin(struct gn_case_run *run, double value, bool judged)
{
    struct gn_case_curve *curve = &run->result.curve;
    run->point = &curve->points[curve->count++];
    run->point->value = value;
    run->point->judged = judged;
    run->point_samples->count = 0;
}

void gn_case_point_end(struct gn_case_run *run)
{
    struct gn_case_point *point = run->point;
    samples_distribution(run->point_samples, &point->hit_error_median, &point->hit_error_p999,
                         &point->hit_error_max);
    run->point = NULL;
}

/* " (aspect ratio 1000)" for a trace of a sweep: each of its traces is a point. */
static const char *offender_value(const struct gn_case_run *run, char *buffer, size_t size)
{
    const struct gn_case_curve *curve = &run->result.curve;
    buffer[0] = 0;
    if (run->result.offender.trace < curve->count)
        snprintf(buffer, size, " (%s %.6g%s%s)", curve->parameter, curve->points[run->result.offender.trace].value,
                 curve->unit[0] ? " " : "", curve->unit);
    return buffer;
}

void gn_case_run_end(struct gn_case_run *run)
{
    struct gn_case_result *result = &run->result;
    const struct gn_case_offender *offender = &result->offender;
    uint64_t wrong = result->class_counts[GN_REF_WRONG];
    uint64_t leaks = result->class_counts[GN_REF_LEAK] + result->class_counts[GN_REF_DOUBLE_HIT];
    char value[256];
    samples_distribution(run->samples, &result->hit_error_median, &result->hit_error_p999, &result->hit_error_max);
    samples_bins(run->samples, result->hit_error_bins);
    if (wrong)
        gn_case_fail(run, "%llu of %llu rays wrong; ray %u of trace %u%s %s", (unsigned long long)wrong,
                     (unsigned long long)result->rays, offender->ray_index, offender->trace,
                     offender_value(run, value, sizeof value), offender->verdict.reason);
    else if (leaks)
        case_leak(run, "%llu of %llu rays leak; ray %u of trace %u%s %s", (unsigned long long)leaks,
                  (unsigned long long)result->rays, offender->ray_index, offender->trace,
                  offender_value(run, value, sizeof value), offender->verdict.reason);
    else if (result->status == GN_CASE_PASS && !result->rays && !result->checks)
        case_error(run, "the case has neither traced a ray nor checked anything");
}

void gn_case_run_begin(const struct gn_case *self, struct gn_device *device, uint64_t seed, double scale,
                       struct gn_case_run *out_run)
{
    memset(out_run, 0, sizeof *out_run);
    out_run->device = device;
    out_run->scale = scale;
    out_run->only_trace = out_run->only_ray = -1;
    out_run->random.state = XXH64(self->name, strlen(self->name), seed);
    out_run->samples = GN_NEW(&out_run->arena, struct gn_case_samples, 1);
    out_run->point_samples = GN_NEW(&out_run->arena, struct gn_case_samples, 1);
}

/* What records are at, and how far apart, differs from case to case: by the name, so that it stays. */
static struct gn_cts_route route_of(enum gn_case_backend backend, const char *case_name)
{
    const uint64_t hash = XXH64(case_name, strlen(case_name), 0);
    if (backend != GN_CASE_PIPELINE)
        return (struct gn_cts_route){.entry = GN_CTS_QUERY};
    return (struct gn_cts_route){
        .entry = GN_CTS_PIPELINE,
        .record_offset = hash % 4,
        .record_stride = 1 + hash / 4 % 3,
        .record_padding = hash / 16 % 3,
        .miss_index = hash / 64 % 5,
    };
}

void gn_case_execute(const struct gn_case *self, const char *name, enum gn_case_backend backend, struct gn_device *device,
                     uint64_t seed, double scale, int64_t only_trace, int64_t only_ray, struct gn_case_run *out_run)
{
    struct timespec begin, end;
    clock_gettime(CLOCK_MONOTONIC, &begin);
    gn_case_run_begin(self, device, seed, scale, out_run);
    out_run->route = route_of(backend, self->name);
    out_run->only_trace = only_trace;
    out_run->only_ray = only_ray;
    if (only_trace < 0)
        gn_case_known_read(out_run, name);
    self->run(out_run, self);
    gn_case_run_end(out_run);
    clock_gettime(CLOCK_MONOTONIC, &end);
    out_run->result.seconds = (double)(end.tv_sec - begin.tv_sec) + 1e-9 * (double)(end.tv_nsec - begin.tv_nsec);
}

void gn_case_run_finish(struct gn_case_run *run)
{
    free(run->result.image);
    gn_case_kept_finish(&run->result.kept);
    gn_case_kept_finish(&run->known);
    run->result.image = NULL;
    if (run->samples)
        free(run->samples->values);
    if (run->point_samples)
        free(run->point_samples->values);
    run->samples = run->point_samples = NULL;
    gn_arena_finish(&run->arena);
}
