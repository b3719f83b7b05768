/* SPDX-License-Identifier: Apache-2.0 */
/* The JSON of results: one object per case, the run, the summary, replay files. docs/results.md describes
 * it. */
#include "cts/results.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <yyjson.h>

/* JSON has no infinities and no NaN: they are strings. */
static yyjson_mut_val *real(yyjson_mut_doc *doc, double value)
{
    if (isnan(value))
        return yyjson_mut_str(doc, signbit(value) ? "-nan" : "nan");
    if (isinf(value))
        return yyjson_mut_str(doc, value < 0 ? "-inf" : "inf");
    return yyjson_mut_real(doc, value);
}

static void put_real(yyjson_mut_doc *doc, yyjson_mut_val *object, const char *key, double value)
{
    yyjson_mut_obj_add_val(doc, object, key, real(doc, value));
}

static void put_reals(yyjson_mut_doc *doc, yyjson_mut_val *object, const char *key, const float *values,
                      size_t n)
{
    yyjson_mut_val *array = yyjson_mut_arr(doc);
    for (size_t i = 0; i < n; i++)
        yyjson_mut_arr_append(array, real(doc, (double)values[i]));
    yyjson_mut_obj_add_val(doc, object, key, array);
}

static void put_hex(yyjson_mut_doc *doc, yyjson_mut_val *object, const char *key, const float *values,
                    size_t n)
{
    yyjson_mut_val *array = yyjson_mut_arr(doc);
    for (size_t i = 0; i < n; i++) {
        char text[40];
        snprintf(text, sizeof text, "%a", (double)values[i]);
        yyjson_mut_arr_add_strcpy(doc, array, text);
    }
    yyjson_mut_obj_add_val(doc, object, key, array);
}

/* Strings that came from anywhere are made fit for JSON first. */
static void put_text(yyjson_mut_doc *doc, yyjson_mut_val *object, const char *key, const char *text)
{
    char *copy = strdup(text ? text : "");
    if (!copy)
        return;
    gn_text_clean(copy);
    yyjson_mut_obj_add_strcpy(doc, object, key, copy);
    free(copy);
}

static void put_uint(yyjson_mut_doc *doc, yyjson_mut_val *object, const char *key, uint64_t value)
{
    yyjson_mut_obj_add_uint(doc, object, key, value);
}

static char *encode(yyjson_mut_doc *doc, yyjson_mut_val *root, size_t *out_length)
{
    yyjson_mut_doc_set_root(doc, root);
    char *text = yyjson_mut_write(doc, YYJSON_WRITE_NOFLAG, out_length);
    yyjson_mut_doc_free(doc);
    return text;
}

/* The picture's bytes are a few classes in long runs: "VALUE:LENGTH," in base 16 keeps the line between a
 * worker and its parent short. */
static char *image_encode(const uint8_t *image, size_t count)
{
    char *text = NULL;
    size_t length = 0;
    FILE *file = open_memstream(&text, &length);
    if (!file)
        return NULL;
    for (size_t i = 0; i < count;) {
        size_t end = i + 1;
        while (end < count && image[end] == image[i])
            end++;
        fprintf(file, "%x:%zx,", image[i], end - i);
        i = end;
    }
    if (fclose(file) != 0) {
        free(text);
        return NULL;
    }
    return text;
}

static uint8_t *image_decode(const char *text, size_t count, struct gn_arena *arena)
{
    uint8_t *image = GN_NEW(arena, uint8_t, count);
    size_t used = 0;
    while (*text) {
        char *end;
        unsigned long value = strtoul(text, &end, 16);
        if (end == text || *end != ':' || value > 0xFF)
            return NULL;
        text = end + 1;
        unsigned long long run = strtoull(text, &end, 16);
        if (end == text || *end != ',' || run > count - used)
            return NULL;
        text = end + 1;
        memset(image + used, (int)value, (size_t)run);
        used += (size_t)run;
    }
    return used == count ? image : NULL;
}

static const char *const answer_kinds[] = {"none", "triangle", "generated"};

static yyjson_mut_val *offender_encode(yyjson_mut_doc *doc, const struct gn_case_offender *offender)
{
    const struct gn_ref_ray *r = &offender->ray.ray;
    const struct gn_ref_policy *policy = &offender->ray.policy;
    const struct gn_ref_answer *a = &offender->answer;
    const struct gn_ref_verdict *v = &offender->verdict;
    yyjson_mut_val *root = yyjson_mut_obj(doc);
    put_uint(doc, root, "trace", offender->trace);
    put_uint(doc, root, "ray_index", offender->ray_index);

    yyjson_mut_val *ray = yyjson_mut_obj_add_obj(doc, root, "ray");
    put_reals(doc, ray, "origin", r->origin, 3);
    put_real(doc, ray, "tmin", (double)r->tmin);
    put_reals(doc, ray, "direction", r->direction, 3);
    put_real(doc, ray, "tmax", (double)r->tmax);
    put_hex(doc, ray, "origin_hex", r->origin, 3);
    put_hex(doc, ray, "direction_hex", r->direction, 3);
    put_hex(doc, ray, "range_hex", (const float[]){r->tmin, r->tmax}, 2);
    put_uint(doc, ray, "flags", r->flags);
    put_uint(doc, ray, "cull_mask", r->cull_mask);
    put_uint(doc, ray, "confirm_mask", policy->confirm_mask);
    put_uint(doc, ray, "generate_mask", policy->generate_mask);
    put_real(doc, ray, "generate_t0", (double)policy->generate_t0);
    put_real(doc, ray, "generate_step", (double)policy->generate_step);

    yyjson_mut_val *answer = yyjson_mut_obj_add_obj(doc, root, "answer");
    yyjson_mut_obj_add_str(doc, answer, "kind",
                           a->kind <= GN_REF_ANSWER_GENERATED ? answer_kinds[a->kind] : "none");
    put_uint(doc, answer, "instance", a->instance);
    put_uint(doc, answer, "geometry", a->geometry);
    put_uint(doc, answer, "primitive", a->primitive);
    put_uint(doc, answer, "custom_index", a->custom_index);
    put_uint(doc, answer, "sbt_offset", a->sbt_offset);
    put_uint(doc, answer, "front", a->front);
    put_real(doc, answer, "t", (double)a->t);
    put_reals(doc, answer, "barycentrics", a->barycentrics, 2);
    put_hex(doc, answer, "t_barycentrics_hex", (const float[]){a->t, a->barycentrics[0], a->barycentrics[1]},
            3);

    if (v->ideal_hit) {
        yyjson_mut_val *ideal = yyjson_mut_obj_add_obj(doc, root, "ideal");
        yyjson_mut_obj_add_str(doc, ideal, "kind", v->ideal.type == GN_REF_AABBS ? "aabb" : "triangle");
        put_uint(doc, ideal, "instance", v->ideal.instance);
        put_uint(doc, ideal, "geometry", v->ideal.geometry);
        put_uint(doc, ideal, "primitive", v->ideal.primitive);
        yyjson_mut_obj_add_bool(doc, ideal, "front", v->ideal.front);
        yyjson_mut_obj_add_bool(doc, ideal, "opaque", v->ideal.opaque);
        put_real(doc, ideal, "t", v->ideal.t);
        put_real(doc, ideal, "t_exit", v->ideal.t_exit);
        put_real(doc, ideal, "beta", v->ideal.beta);
        put_real(doc, ideal, "gamma", v->ideal.gamma);
    } else {
        yyjson_mut_obj_add_null(doc, root, "ideal");
    }
    yyjson_mut_obj_add_str(doc, root, "class",
                           (unsigned)v->cls < GN_REF_VERDICT_CLASS_COUNT ? gn_results_class_key(v->cls)
                                                                         : "wrong");
    put_real(doc, root, "hit_error", v->hit_error);
    put_real(doc, root, "hit_bound", v->hit_bound);
    put_real(doc, root, "margin", v->margin);
    put_real(doc, root, "bound", gn_ref_verdict_bound());
    put_text(doc, root, "reason", v->reason);
    return root;
}

static void put_classes(yyjson_mut_doc *doc, yyjson_mut_val *object, const uint64_t *counts)
{
    yyjson_mut_val *classes = yyjson_mut_obj_add_obj(doc, object, "classes");
    for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++)
        put_uint(doc, classes, gn_results_class_key((enum gn_ref_verdict_class)c), counts[c]);
}

static void put_hit_error(yyjson_mut_doc *doc, yyjson_mut_val *object, double median, double p999, double max)
{
    yyjson_mut_val *error = yyjson_mut_obj_add_obj(doc, object, "hit_error");
    put_real(doc, error, "median", median);
    put_real(doc, error, "p999", p999);
    put_real(doc, error, "max", max);
}

/* The tiers that were asked, by name. */
static void tiers_encode(yyjson_mut_doc *doc, yyjson_mut_val *point, const struct gn_case_tier *tiers)
{
    yyjson_mut_val *all = yyjson_mut_obj_add_obj(doc, point, "tiers");
    for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
        if (!tiers[t].rays)
            continue;
        yyjson_mut_val *tier = yyjson_mut_obj_add_obj(doc, all, gn_ref_tier_name((enum gn_ref_tier)t));
        put_uint(doc, tier, "rays", tiers[t].rays);
        put_classes(doc, tier, tiers[t].class_counts);
        put_real(doc, tier, "held_error_max", tiers[t].held_error_max);
        put_real(doc, tier, "margin_max", tiers[t].margin_max);
    }
}

static void put_left(yyjson_mut_doc *doc, yyjson_mut_val *object, const char *key, const struct gn_case_point *left)
{
    if (left)
        put_real(doc, object, key, left->value);
    else
        yyjson_mut_obj_add_null(doc, object, key);
}

static void curve_encode(yyjson_mut_doc *doc, yyjson_mut_val *root, const struct gn_case_curve *curve)
{
    yyjson_mut_val *sweep = yyjson_mut_obj_add_obj(doc, root, "sweep");
    put_text(doc, sweep, "parameter", curve->parameter);
    put_text(doc, sweep, "unit", curve->unit);
    put_text(doc, sweep, "why", curve->why);
    put_left(doc, sweep, "left_at", gn_case_curve_left(curve));
    yyjson_mut_val *tiers_left = yyjson_mut_obj_add_obj(doc, sweep, "tiers_left_at");
    for (int t = 0; t < GN_REF_TIER_COUNT; t++)
        if (curve->points[0].tiers[t].rays)
            put_left(doc, tiers_left, gn_ref_tier_name((enum gn_ref_tier)t),
                     gn_case_curve_tier_left(curve, (enum gn_ref_tier)t));
    yyjson_mut_val *array = yyjson_mut_obj_add_arr(doc, root, "curve");
    for (uint32_t i = 0; i < curve->count; i++) {
        const struct gn_case_point *p = &curve->points[i];
        yyjson_mut_val *point = yyjson_mut_arr_add_obj(doc, array);
        put_real(doc, point, "value", p->value);
        yyjson_mut_obj_add_bool(doc, point, "judged", p->judged);
        put_uint(doc, point, "rays", p->rays);
        put_uint(doc, point, "ideal_hits", p->ideal_hits);
        put_classes(doc, point, p->class_counts);
        put_hit_error(doc, point, p->hit_error_median, p->hit_error_p999, p->hit_error_max);
        put_real(doc, point, "held_error_max", p->held_error_max);
        put_real(doc, point, "margin_max", p->margin_max);
        tiers_encode(doc, point, p->tiers);
    }
}

/* A number of 64 bits, which readers of JSON may not hold. */
static void put_digest(yyjson_mut_doc *doc, yyjson_mut_val *object, const char *key, uint64_t value)
{
    char digits[24];
    snprintf(digits, sizeof digits, "%016" PRIx64, value);
    put_text(doc, object, key, digits);
}

/* Without the empty bins at the end. */
static void put_bins(yyjson_mut_doc *doc, yyjson_mut_val *object, const uint64_t bins[GN_CASE_ERROR_BINS])
{
    size_t count = GN_CASE_ERROR_BINS;
    while (count && !bins[count - 1])
        count--;
    if (!count)
        return;
    yyjson_mut_val *list = yyjson_mut_obj_add_arr(doc, object, "hit_error_bins");
    for (size_t i = 0; i < count; i++)
        yyjson_mut_arr_add_uint(doc, list, bins[i]);
}

char *gn_results_case_encode(const struct gn_results_case *cs, size_t *out_length)
{
    yyjson_mut_doc *doc = yyjson_mut_doc_new(NULL);
    if (!doc)
        return NULL;
    yyjson_mut_val *root = yyjson_mut_obj(doc);
    put_text(doc, root, "name", cs->name);
    yyjson_mut_obj_add_str(doc, root, "status", gn_case_status_name(cs->status));
    put_real(doc, root, "seconds", cs->seconds);
    put_uint(doc, root, "rays", cs->rays);
    put_text(doc, root, "message", cs->message);
    put_text(doc, root, "family", cs->family);
    put_text(doc, root, "spec", cs->spec);
    put_uint(doc, root, "ideal_hits", cs->ideal_hits);
    put_classes(doc, root, cs->class_counts);
    put_hit_error(doc, root, cs->hit_error_median, cs->hit_error_p999, cs->hit_error_max);
    put_bins(doc, root, cs->hit_error_bins);
    put_real(doc, root, "margin_max", cs->margin_max);
    if (cs->answers)
        put_digest(doc, root, "answers", cs->answers);
    if (cs->curve.count)
        curve_encode(doc, root, &cs->curve);
    if (cs->outcome != GN_OUTCOME_AS_EXPECTED)
        yyjson_mut_obj_add_bool(doc, root, "counts", cs->outcome != GN_OUTCOME_EXPECTED_FAILURE);
    if (cs->expected && cs->expected[0]) {
        put_text(doc, root, "expected", cs->expected);
        put_text(doc, root, "expected_reason", cs->expected_reason);
        put_text(doc, root, "expected_place", cs->expected_place);
    }
    if (cs->worker) {
        put_uint(doc, root, "worker", cs->worker);
        put_uint(doc, root, "position", cs->position);
    }
    if (cs->output && cs->output[0])
        put_text(doc, root, "output", cs->output);
    if (cs->picture_width) {
        put_text(doc, root, "picture", cs->picture);
        put_uint(doc, root, "picture_width", cs->picture_width);
        put_uint(doc, root, "picture_height", cs->picture_height);
    }
    if (cs->rendered[0] && cs->rendered[0][0]) {
        yyjson_mut_val *rendered = yyjson_mut_obj_add_arr(doc, root, "rendered");
        for (int i = 0; i < GN_CASE_RENDERED; i++)
            yyjson_mut_arr_add_strcpy(doc, rendered, cs->rendered[i] ? cs->rendered[i] : "");
    }
    if (cs->replay && cs->replay[0])
        put_text(doc, root, "replay", cs->replay);
    if (cs->has_offender)
        yyjson_mut_obj_add_val(doc, root, "offender", offender_encode(doc, &cs->offender));
    if (cs->image) {
        char *image = image_encode(cs->image, (size_t)cs->picture_width * cs->picture_height);
        if (image)
            yyjson_mut_obj_add_strcpy(doc, root, "image", image);
        free(image);
    }
    return encode(doc, root, out_length);
}

/* What is missing or of another type reads as zero or ""; the names of what must be there are checked
 * apart. */
static double get_real(yyjson_val *object, const char *key)
{
    yyjson_val *value = yyjson_obj_get(object, key);
    if (yyjson_is_str(value)) {
        const char *text = yyjson_get_str(value);
        if (strcmp(text, "inf") == 0)
            return (double)INFINITY;
        if (strcmp(text, "-inf") == 0)
            return -(double)INFINITY;
        return strcmp(text, "nan") == 0 || strcmp(text, "-nan") == 0 ? (double)NAN : 0;
    }
    return yyjson_get_num(value);
}

static uint64_t get_uint(yyjson_val *object, const char *key)
{
    return yyjson_get_uint(yyjson_obj_get(object, key));
}

static const char *get_text(yyjson_val *object, const char *key, struct gn_arena *arena)
{
    const char *text = yyjson_get_str(yyjson_obj_get(object, key));
    return text && *text ? gn_arena_printf(arena, "%s", text) : "";
}

static void get_reals(yyjson_val *object, const char *key, float *out, size_t n)
{
    yyjson_val *array = yyjson_obj_get(object, key);
    for (size_t i = 0; i < n; i++) {
        yyjson_val *value = yyjson_arr_get(array, i);
        const char *text = yyjson_get_str(value);
        out[i] = (float)yyjson_get_num(value);
        if (text)
            out[i] = strstr(text, "inf") ? (text[0] == '-' ? -INFINITY : INFINITY) : NAN;
    }
}

static void offender_decode(yyjson_val *root, struct gn_case_offender *offender)
{
    struct gn_ref_ray *r = &offender->ray.ray;
    struct gn_ref_answer *a = &offender->answer;
    struct gn_ref_verdict *v = &offender->verdict;
    offender->trace = (uint32_t)get_uint(root, "trace");
    offender->ray_index = (uint32_t)get_uint(root, "ray_index");

    yyjson_val *ray = yyjson_obj_get(root, "ray");
    get_reals(ray, "origin", r->origin, 3);
    r->tmin = (float)get_real(ray, "tmin");
    get_reals(ray, "direction", r->direction, 3);
    r->tmax = (float)get_real(ray, "tmax");
    r->flags = (uint32_t)get_uint(ray, "flags");
    r->cull_mask = (uint32_t)get_uint(ray, "cull_mask");
    offender->ray.policy.confirm_mask = (uint32_t)get_uint(ray, "confirm_mask");
    offender->ray.policy.generate_mask = (uint32_t)get_uint(ray, "generate_mask");
    offender->ray.policy.generate_t0 = (float)get_real(ray, "generate_t0");
    offender->ray.policy.generate_step = (float)get_real(ray, "generate_step");

    yyjson_val *answer = yyjson_obj_get(root, "answer");
    const char *kind = yyjson_get_str(yyjson_obj_get(answer, "kind"));
    for (int k = 0; kind && k <= GN_REF_ANSWER_GENERATED; k++)
        if (strcmp(kind, answer_kinds[k]) == 0)
            a->kind = (enum gn_ref_answer_kind)k;
    a->instance = (uint32_t)get_uint(answer, "instance");
    a->geometry = (uint32_t)get_uint(answer, "geometry");
    a->primitive = (uint32_t)get_uint(answer, "primitive");
    a->custom_index = (uint32_t)get_uint(answer, "custom_index");
    a->sbt_offset = (uint32_t)get_uint(answer, "sbt_offset");
    a->front = (uint32_t)get_uint(answer, "front");
    a->t = (float)get_real(answer, "t");
    get_reals(answer, "barycentrics", a->barycentrics, 2);

    yyjson_val *ideal = yyjson_obj_get(root, "ideal");
    v->ideal_hit = yyjson_is_obj(ideal);
    const char *type = yyjson_get_str(yyjson_obj_get(ideal, "kind"));
    v->ideal.type = type && strcmp(type, "aabb") == 0 ? GN_REF_AABBS : GN_REF_TRIANGLES;
    v->ideal.instance = (uint32_t)get_uint(ideal, "instance");
    v->ideal.geometry = (uint32_t)get_uint(ideal, "geometry");
    v->ideal.primitive = (uint32_t)get_uint(ideal, "primitive");
    v->ideal.front = yyjson_get_bool(yyjson_obj_get(ideal, "front"));
    v->ideal.opaque = yyjson_get_bool(yyjson_obj_get(ideal, "opaque"));
    v->ideal.t = get_real(ideal, "t");
    v->ideal.t_exit = get_real(ideal, "t_exit");
    v->ideal.beta = get_real(ideal, "beta");
    v->ideal.gamma = get_real(ideal, "gamma");

    const char *cls = yyjson_get_str(yyjson_obj_get(root, "class"));
    v->cls = GN_REF_WRONG;
    for (int c = 0; cls && c < GN_REF_VERDICT_CLASS_COUNT; c++)
        if (strcmp(cls, gn_results_class_key((enum gn_ref_verdict_class)c)) == 0)
            v->cls = (enum gn_ref_verdict_class)c;
    v->hit_error = get_real(root, "hit_error");
    v->hit_bound = get_real(root, "hit_bound");
    v->margin = get_real(root, "margin");
    const char *reason = yyjson_get_str(yyjson_obj_get(root, "reason"));
    snprintf(v->reason, sizeof v->reason, "%s", reason ? reason : "");
}

static void get_classes(yyjson_val *object, uint64_t *counts)
{
    yyjson_val *classes = yyjson_obj_get(object, "classes");
    for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++)
        counts[c] = get_uint(classes, gn_results_class_key((enum gn_ref_verdict_class)c));
}

static void get_hit_error(yyjson_val *object, double *median, double *p999, double *max)
{
    yyjson_val *error = yyjson_obj_get(object, "hit_error");
    *median = get_real(error, "median");
    *p999 = get_real(error, "p999");
    *max = get_real(error, "max");
}

static void curve_decode(yyjson_val *root, struct gn_arena *arena, struct gn_case_curve *curve)
{
    yyjson_val *array = yyjson_obj_get(root, "curve"), *sweep = yyjson_obj_get(root, "sweep");
    size_t count = yyjson_arr_size(array);
    curve->parameter = get_text(sweep, "parameter", arena);
    curve->unit = get_text(sweep, "unit", arena);
    curve->why = get_text(sweep, "why", arena);
    if (!count || count > UINT32_MAX)
        return;
    curve->points = GN_NEW(arena, struct gn_case_point, count);
    yyjson_arr_iter iterator = yyjson_arr_iter_with(array);
    for (yyjson_val *point; (point = yyjson_arr_iter_next(&iterator));) {
        struct gn_case_point *p = &curve->points[curve->count++];
        p->value = get_real(point, "value");
        p->judged = yyjson_get_bool(yyjson_obj_get(point, "judged"));
        p->rays = get_uint(point, "rays");
        p->ideal_hits = get_uint(point, "ideal_hits");
        get_classes(point, p->class_counts);
        get_hit_error(point, &p->hit_error_median, &p->hit_error_p999, &p->hit_error_max);
        p->held_error_max = get_real(point, "held_error_max");
        p->margin_max = get_real(point, "margin_max");
        yyjson_val *tiers = yyjson_obj_get(point, "tiers");
        for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
            yyjson_val *tier = yyjson_obj_get(tiers, gn_ref_tier_name((enum gn_ref_tier)t));
            p->tiers[t].rays = get_uint(tier, "rays");
            get_classes(tier, p->tiers[t].class_counts);
            p->tiers[t].held_error_max = get_real(tier, "held_error_max");
            p->tiers[t].margin_max = get_real(tier, "margin_max");
        }
    }
}

static yyjson_doc *read_object(const char *text, size_t length, char *out_error, size_t error_size)
{
    yyjson_read_err error;
    yyjson_doc *doc = yyjson_read_opts((char *)(uintptr_t)text, length, YYJSON_READ_NOFLAG, NULL, &error);
    if (!doc) {
        snprintf(out_error, error_size, "not JSON: %s at byte %zu", error.msg, error.pos);
        return NULL;
    }
    if (!yyjson_is_obj(yyjson_doc_get_root(doc))) {
        snprintf(out_error, error_size, "expected a JSON object, found %s",
                 yyjson_get_type_desc(yyjson_doc_get_root(doc)));
        yyjson_doc_free(doc);
        return NULL;
    }
    return doc;
}

bool gn_results_case_decode(const char *text, size_t length, struct gn_arena *arena,
                            struct gn_results_case *out, char *out_error, size_t error_size)
{
    memset(out, 0, sizeof *out);
    yyjson_doc *doc = read_object(text, length, out_error, error_size);
    if (!doc)
        return false;
    yyjson_val *root = yyjson_doc_get_root(doc);
    bool ok = false;
    const char *status = yyjson_get_str(yyjson_obj_get(root, "status"));
    out->name = get_text(root, "name", arena);
    out->status = status ? gn_case_status_of_name(status) : GN_CASE_STATUS_COUNT;
    if (!out->name[0] || out->status == GN_CASE_STATUS_COUNT) {
        snprintf(out_error, error_size, "expected a case with \"name\" and \"status\", found %s%s",
                 out->name[0] ? "status " : "no name", out->name[0] ? (status ? status : "missing") : "");
        goto done;
    }
    out->seconds = get_real(root, "seconds");
    out->rays = get_uint(root, "rays");
    out->message = get_text(root, "message", arena);
    out->family = get_text(root, "family", arena);
    out->spec = get_text(root, "spec", arena);
    out->ideal_hits = get_uint(root, "ideal_hits");
    get_classes(root, out->class_counts);
    get_hit_error(root, &out->hit_error_median, &out->hit_error_p999, &out->hit_error_max);
    yyjson_val *bins = yyjson_obj_get(root, "hit_error_bins");
    for (size_t i = 0; i < GN_CASE_ERROR_BINS; i++)
        out->hit_error_bins[i] = yyjson_get_uint(yyjson_arr_get(bins, i));
    out->answers = strtoull(get_text(root, "answers", arena), NULL, 16);
    curve_decode(root, arena, &out->curve);
    out->margin_max = get_real(root, "margin_max");
    out->expected = get_text(root, "expected", arena);
    out->expected_reason = get_text(root, "expected_reason", arena);
    out->expected_place = get_text(root, "expected_place", arena);
    out->worker = (uint32_t)get_uint(root, "worker");
    out->position = (uint32_t)get_uint(root, "position");
    out->output = get_text(root, "output", arena);
    out->picture = get_text(root, "picture", arena);
    out->replay = get_text(root, "replay", arena);
    yyjson_val *rendered = yyjson_obj_get(root, "rendered");
    for (size_t i = 0; i < GN_CASE_RENDERED; i++) {
        const char *png = yyjson_get_str(yyjson_arr_get(rendered, i));
        out->rendered[i] = gn_arena_printf(arena, "%s", png ? png : "");
    }
    out->outcome = gn_case_status_is_failure(out->status) ? GN_OUTCOME_UNEXPECTED : GN_OUTCOME_AS_EXPECTED;
    yyjson_val *offender = yyjson_obj_get(root, "offender");
    if (yyjson_is_obj(offender)) {
        out->has_offender = true;
        offender_decode(offender, &out->offender);
    }
    uint64_t width = get_uint(root, "picture_width"), height = get_uint(root, "picture_height");
    if (width && height && width < 65536 && height < 65536) {
        out->picture_width = (uint32_t)width;
        out->picture_height = (uint32_t)height;
        const char *image = yyjson_get_str(yyjson_obj_get(root, "image"));
        if (image && !(out->image = image_decode(image, (size_t)(width * height), arena))) {
            snprintf(out_error, error_size, "the picture of %s has not %" PRIu64 " x %" PRIu64 " rays",
                     out->name, width, height);
            goto done;
        }
    }
    ok = true;
done:
    yyjson_doc_free(doc);
    return ok;
}

/* What identifies a device and what the reports show of it; of the limits, those that bear on the cases. */
#define GN_DEVICE_NUMBERS(X)                                                                                 \
    X(vendor_id)                                                                                             \
    X(device_id)                                                                                             \
    X(driver_version)                                                                                        \
    X(api_version)
#define GN_DEVICE_FEATURES(X)                                                                                \
    X(ray_query)                                                                                             \
    X(ray_tracing_pipeline)                                                                                  \
    X(position_fetch)                                                                                        \
    X(host_builds)                                                                                           \
    X(indirect_builds)                                                                                       \
    X(index_uint8)

static void put_bytes(yyjson_mut_doc *doc, yyjson_mut_val *object, const char *key, const uint8_t *bytes,
                      size_t n)
{
    char text[2 * VK_UUID_SIZE + 1] = "";
    for (size_t i = 0; i < n && i < VK_UUID_SIZE; i++)
        snprintf(text + 2 * i, 3, "%02x", bytes[i]);
    yyjson_mut_obj_add_strcpy(doc, object, key, text);
}

static yyjson_mut_val *device_encode(yyjson_mut_doc *doc, const struct gn_device_info *info)
{
    yyjson_mut_val *root = yyjson_mut_obj(doc);
    put_text(doc, root, "name", info->name);
    put_text(doc, root, "driver_name", info->driver_name);
    put_text(doc, root, "driver_info", info->driver_info);
#define X(field) put_uint(doc, root, #field, info->field);
    GN_DEVICE_NUMBERS(X)
#undef X
    put_bytes(doc, root, "device_uuid", info->device_uuid, VK_UUID_SIZE);
    put_bytes(doc, root, "driver_uuid", info->driver_uuid, VK_UUID_SIZE);
#define X(field) yyjson_mut_obj_add_bool(doc, root, #field, info->field);
    GN_DEVICE_FEATURES(X)
#undef X
    put_uint(doc, root, "max_geometry_count", info->limits.maxGeometryCount);
    put_uint(doc, root, "max_instance_count", info->limits.maxInstanceCount);
    put_uint(doc, root, "max_primitive_count", info->limits.maxPrimitiveCount);
    return root;
}

static void get_bytes(yyjson_val *object, const char *key, uint8_t *out, size_t n)
{
    const char *text = yyjson_get_str(yyjson_obj_get(object, key));
    if (!text || strlen(text) != 2 * n)
        return;
    for (size_t i = 0; i < n; i++) {
        char digits[3] = {text[2 * i], text[2 * i + 1], 0};
        out[i] = (uint8_t)strtoul(digits, NULL, 16);
    }
}

static void device_decode(yyjson_val *root, struct gn_device_info *out)
{
    const char *text;
    memset(out, 0, sizeof *out);
    text = yyjson_get_str(yyjson_obj_get(root, "name"));
    snprintf(out->name, sizeof out->name, "%s", text ? text : "");
    text = yyjson_get_str(yyjson_obj_get(root, "driver_name"));
    snprintf(out->driver_name, sizeof out->driver_name, "%s", text ? text : "");
    text = yyjson_get_str(yyjson_obj_get(root, "driver_info"));
    snprintf(out->driver_info, sizeof out->driver_info, "%s", text ? text : "");
#define X(field) out->field = (uint32_t)get_uint(root, #field);
    GN_DEVICE_NUMBERS(X)
#undef X
    get_bytes(root, "device_uuid", out->device_uuid, VK_UUID_SIZE);
    get_bytes(root, "driver_uuid", out->driver_uuid, VK_UUID_SIZE);
#define X(field) out->field = yyjson_get_bool(yyjson_obj_get(root, #field));
    GN_DEVICE_FEATURES(X)
#undef X
    out->limits.maxGeometryCount = get_uint(root, "max_geometry_count");
    out->limits.maxInstanceCount = get_uint(root, "max_instance_count");
    out->limits.maxPrimitiveCount = get_uint(root, "max_primitive_count");
}

char *gn_results_device_encode(const struct gn_device_info *info, size_t *out_length)
{
    yyjson_mut_doc *doc = yyjson_mut_doc_new(NULL);
    return doc ? encode(doc, device_encode(doc, info), out_length) : NULL;
}

bool gn_results_device_decode(const char *text, size_t length, struct gn_device_info *out, char *out_error,
                              size_t error_size)
{
    yyjson_doc *doc = read_object(text, length, out_error, error_size);
    if (!doc)
        return false;
    device_decode(yyjson_doc_get_root(doc), out);
    yyjson_doc_free(doc);
    return true;
}

static void run_put(yyjson_mut_doc *doc, yyjson_mut_val *root, const struct gn_results_run *run)
{
    put_text(doc, root, "gnomon", run->version);
    put_text(doc, root, "started", run->started);
    put_text(doc, root, "driver", run->driver);
    put_text(doc, root, "backend", run->backend);
    put_text(doc, root, "command", run->command);
    put_text(doc, root, "options", run->options);
    put_text(doc, root, "environment", run->environment);
    put_uint(doc, root, "seed", run->seed);
    put_real(doc, root, "scale", run->scale);
    put_real(doc, root, "timeout", run->timeout);
    put_uint(doc, root, "jobs", run->jobs);
    put_uint(doc, root, "shard", run->shard);
    put_uint(doc, root, "shard_count", run->shard_count);
    put_uint(doc, root, "selected", run->selected);
    put_digest(doc, root, "suite", run->suite);
    put_digest(doc, root, "selection", run->selection);
    if (run->durations)
        put_digest(doc, root, "durations", run->durations);
    put_real(doc, root, "bound", gn_ref_verdict_bound());
    yyjson_mut_obj_add_val(doc, root, "device", device_encode(doc, &run->device));
}

char *gn_results_run_encode(const struct gn_results_run *run, size_t *out_length)
{
    yyjson_mut_doc *doc = yyjson_mut_doc_new(NULL);
    if (!doc)
        return NULL;
    yyjson_mut_val *root = yyjson_mut_obj(doc);
    run_put(doc, root, run);
    return encode(doc, root, out_length);
}

bool gn_results_run_decode(const char *text, size_t length, struct gn_arena *arena,
                           struct gn_results_run *out, char *out_error, size_t error_size)
{
    memset(out, 0, sizeof *out);
    yyjson_doc *doc = read_object(text, length, out_error, error_size);
    if (!doc)
        return false;
    yyjson_val *root = yyjson_doc_get_root(doc);
    bool ok = yyjson_is_str(yyjson_obj_get(root, "gnomon")) && yyjson_is_obj(yyjson_obj_get(root, "device"));
    if (!ok)
        snprintf(out_error, error_size, "expected the description of a run with \"gnomon\" and \"device\"");
    out->version = get_text(root, "gnomon", arena);
    out->started = get_text(root, "started", arena);
    out->driver = get_text(root, "driver", arena);
    out->backend = get_text(root, "backend", arena);
    out->command = get_text(root, "command", arena);
    out->options = get_text(root, "options", arena);
    out->environment = get_text(root, "environment", arena);
    out->seed = get_uint(root, "seed");
    out->scale = get_real(root, "scale");
    out->timeout = get_real(root, "timeout");
    out->jobs = (uint32_t)get_uint(root, "jobs");
    out->shard = (uint32_t)get_uint(root, "shard");
    out->shard_count = (uint32_t)get_uint(root, "shard_count");
    out->selected = get_uint(root, "selected");
    out->suite = strtoull(get_text(root, "suite", arena), NULL, 16);
    out->selection = strtoull(get_text(root, "selection", arena), NULL, 16);
    out->durations = strtoull(get_text(root, "durations", arena), NULL, 16);
    device_decode(yyjson_obj_get(root, "device"), &out->device);
    yyjson_doc_free(doc);
    return ok;
}

char *gn_results_summary_encode(const struct gn_results *results, size_t *out_length)
{
    yyjson_mut_doc *doc = yyjson_mut_doc_new(NULL);
    if (!doc)
        return NULL;
    struct gn_results_totals totals = gn_results_totals(results);
    int exit_status = gn_results_exit_status(results);
    char verdict[1024];
    gn_results_verdict(results, verdict, sizeof verdict);

    yyjson_mut_val *root = yyjson_mut_obj(doc);
    yyjson_mut_obj_add_str(doc, root, "name", "summary");
    yyjson_mut_obj_add_str(doc, root, "status",
                           exit_status == 0   ? "pass"
                           : exit_status == 1 ? "fail"
                           : exit_status == 4 ? "skip"
                                              : "error");
    put_real(doc, root, "seconds", results->seconds);
    put_uint(doc, root, "rays", totals.rays);
    put_text(doc, root, "message", verdict);
    put_uint(doc, root, "exit_status", (uint64_t)exit_status);
    put_uint(doc, root, "cases", results->count);
    yyjson_mut_val *counts = yyjson_mut_obj_add_obj(doc, root, "counts");
    for (int s = 0; s < GN_CASE_STATUS_COUNT; s++)
        put_uint(doc, counts, gn_case_status_name((enum gn_case_status)s), totals.by_status[s]);
    put_uint(doc, root, "counting", totals.counting + results->stale_count);
    put_uint(doc, root, "expected_failures", totals.expected_failures);
    put_uint(doc, root, "unexpected_passes", totals.unexpected_passes);
    put_uint(doc, root, "ideal_hits", totals.ideal_hits);
    yyjson_mut_val *classes = yyjson_mut_obj_add_obj(doc, root, "classes");
    for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++)
        put_uint(doc, classes, gn_results_class_key((enum gn_ref_verdict_class)c), totals.class_counts[c]);
    put_real(doc, root, "hit_error_max", totals.hit_error_max);
    put_text(doc, root, "stopped", results->stopped);
    yyjson_mut_val *stale = yyjson_mut_obj_add_arr(doc, root, "stale_expectations");
    for (size_t i = 0; i < results->stale_count; i++)
        yyjson_mut_arr_add_strcpy(doc, stale, results->stale[i]);
    yyjson_mut_val *notes = yyjson_mut_obj_add_arr(doc, root, "notes");
    for (size_t i = 0; i < results->note_count; i++)
        yyjson_mut_arr_add_strcpy(doc, notes, results->notes[i]);
    yyjson_mut_val *run = yyjson_mut_obj_add_obj(doc, root, "run");
    run_put(doc, run, &results->run);
    return encode(doc, root, out_length);
}

char *gn_replay_encode(const struct gn_replay *replay, size_t *out_length)
{
    yyjson_mut_doc *doc = yyjson_mut_doc_new(NULL);
    if (!doc)
        return NULL;
    yyjson_mut_val *root = yyjson_mut_obj(doc);
    put_text(doc, root, "replay", replay->name);
    put_text(doc, root, "gnomon", GNOMON_VERSION);
    put_text(doc, root, "driver", replay->driver);
    put_text(doc, root, "device", replay->device);
    put_uint(doc, root, "seed", replay->seed);
    put_real(doc, root, "scale", replay->scale);
    if (replay->trace >= 0 && replay->ray >= 0) {
        put_uint(doc, root, "trace", (uint64_t)replay->trace);
        put_uint(doc, root, "ray", (uint64_t)replay->ray);
    }
    put_text(doc, root, "status", replay->status);
    put_text(doc, root, "message", replay->message);
    return encode(doc, root, out_length);
}

bool gn_replay_decode(const char *text, size_t length, struct gn_arena *arena, struct gn_replay *out,
                      char *out_error, size_t error_size)
{
    memset(out, 0, sizeof *out);
    yyjson_doc *doc = read_object(text, length, out_error, error_size);
    if (!doc)
        return false;
    yyjson_val *root = yyjson_doc_get_root(doc);
    out->name = get_text(root, "replay", arena);
    out->driver = get_text(root, "driver", arena);
    out->device = get_text(root, "device", arena);
    out->seed = get_uint(root, "seed");
    out->scale = get_real(root, "scale");
    yyjson_val *trace = yyjson_obj_get(root, "trace"), *ray = yyjson_obj_get(root, "ray");
    out->trace = trace ? (int64_t)(uint32_t)yyjson_get_uint(trace) : -1;
    out->ray = ray ? (int64_t)(uint32_t)yyjson_get_uint(ray) : -1;
    out->status = get_text(root, "status", arena);
    out->message = get_text(root, "message", arena);
    bool ok = out->name[0] && yyjson_is_uint(yyjson_obj_get(root, "seed")) && isfinite(out->scale) &&
              out->scale > 0;
    if (!ok)
        snprintf(out_error, error_size,
                 "expected a replay file with \"replay\" (a case's name), \"seed\" and \"scale\"");
    yyjson_doc_free(doc);
    return ok;
}
