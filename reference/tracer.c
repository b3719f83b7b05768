/* SPDX-License-Identifier: Apache-2.0 */
/* Tracing at a chosen accuracy: dispatch to the tiers, what they share, and CERTIFIED, which trace.c has. */
#include "reference/tracer.h"

#include <malloc.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "reference/trace_internal.h"
#include "reference/tracer_internal.h"

static const struct gn_ref_tier_functions *const tiers[GN_REF_TIER_COUNT] = {
    [GN_REF_TIER_FAST] = &gn_ref_tier_fast,           [GN_REF_TIER_ROBUST] = &gn_ref_tier_robust,
    [GN_REF_TIER_DOUBLE] = &gn_ref_tier_double,       [GN_REF_TIER_CERTIFIED] = &gn_ref_tier_certified,
    [GN_REF_TIER_EXACT] = &gn_ref_tier_exact,
};

const char *gn_ref_tier_name(enum gn_ref_tier tier)
{
    return (unsigned)tier < GN_REF_TIER_COUNT ? tiers[tier]->name : NULL;
}

bool gn_ref_tier_find(const char *name, enum gn_ref_tier *out_tier)
{
    for (int i = 0; name && i < GN_REF_TIER_COUNT; i++)
        if (strcmp(name, tiers[i]->name) == 0) {
            *out_tier = (enum gn_ref_tier)i;
            return true;
        }
    return false;
}

bool gn_ref_tracer_fail(struct gn_ref_tracer *tracer, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(tracer->error, sizeof tracer->error, format, arguments);
    va_end(arguments);
    return false;
}

static double seconds_now(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

struct gn_ref_tracer *gn_ref_tracer_create(const struct gn_ref_scene *scene, enum gn_ref_tier tier, char *error,
                                           size_t error_size)
{
    struct gn_ref_tracer failed = {0}, *tracer = NULL;
    if (!scene || !scene->committed) {
        gn_ref_tracer_fail(&failed, "the scene is %s, expected a committed one", scene ? "not committed" : "NULL");
        goto fail;
    }
    if ((unsigned)tier >= GN_REF_TIER_COUNT) {
        gn_ref_tracer_fail(&failed, "tier %d, expected less than %d", (int)tier, GN_REF_TIER_COUNT);
        goto fail;
    }
    tracer = calloc(1, sizeof *tracer);
    if (!tracer) {
        gn_ref_tracer_fail(&failed, "out of memory for a tracer");
        goto fail;
    }
    *tracer = (struct gn_ref_tracer){.scene = scene, .tier = tier, .functions = tiers[tier]};
    double start = seconds_now();
    if (!tracer->functions->create(tracer)) {
        memcpy(failed.error, tracer->error, sizeof failed.error);
        goto fail;
    }
    if (tier != GN_REF_TIER_CERTIFIED)
        tracer->cost.seconds = seconds_now() - start;
    if (error_size > 0)
        error[0] = '\0';
    return tracer;
fail:
    free(tracer);
    if (error_size > 0)
        snprintf(error, error_size, "%s", failed.error);
    return NULL;
}

void gn_ref_tracer_destroy(struct gn_ref_tracer *tracer)
{
    if (!tracer)
        return;
    if (tracer->functions->destroy)
        tracer->functions->destroy(tracer->state);
    free(tracer);
}

enum gn_ref_tier gn_ref_tracer_tier(const struct gn_ref_tracer *tracer)
{
    return tracer->tier;
}

struct gn_ref_tracer_cost gn_ref_tracer_cost(const struct gn_ref_tracer *tracer)
{
    return tracer->cost;
}

/* By the bits: a thread may take denormal numbers for zero, and this is done for every ray of the fastest tier too. */
bool gn_ref_tracer_ray_valid(const struct gn_ref_ray *ray)
{
    uint32_t bits[6], moves = 0;
    bool finite = true;
    memcpy(bits, ray->origin, sizeof ray->origin);
    memcpy(bits + 3, ray->direction, sizeof ray->direction);
    for (int i = 0; i < 6; i++)
        finite &= (bits[i] & 0x7F800000u) != 0x7F800000u;
    for (int i = 3; i < 6; i++)
        moves |= bits[i] << 1;
    return finite && moves && ray->tmin >= 0 && ray->tmin <= ray->tmax;
}

bool gn_ref_admitted(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray, uint32_t instance_index,
                     uint32_t geometry, bool *out_opaque)
{
    const struct gn_ref_instance *instance = &scene->instances[instance_index];
    const struct gn_ref_geometry *of = &scene->blases[instance->blas].geometries[geometry];
    if ((instance->mask & ray->cull_mask & 0xFF) == 0)
        return false;
    if (ray->flags & (of->type == GN_REF_TRIANGLES ? GN_REF_RAY_SKIP_TRIANGLES : GN_REF_RAY_SKIP_AABBS))
        return false;
    bool opaque = of->flags & GN_REF_GEOMETRY_OPAQUE;
    if (instance->flags & (GN_REF_INSTANCE_FORCE_OPAQUE | GN_REF_INSTANCE_FORCE_NO_OPAQUE))
        opaque = instance->flags & GN_REF_INSTANCE_FORCE_OPAQUE;
    if (ray->flags & (GN_REF_RAY_OPAQUE | GN_REF_RAY_NO_OPAQUE))
        opaque = ray->flags & GN_REF_RAY_OPAQUE;
    *out_opaque = opaque;
    return !(ray->flags & (opaque ? GN_REF_RAY_CULL_OPAQUE : GN_REF_RAY_CULL_NO_OPAQUE));
}

bool gn_ref_facing_admitted(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray, uint32_t instance,
                            bool *front)
{
    uint32_t flags = scene->instances[instance].flags;
    if (flags & GN_REF_INSTANCE_FLIP_FACING)
        *front = !*front;
    if (flags & GN_REF_INSTANCE_FACING_CULL_DISABLE)
        return true;
    return !(ray->flags & (*front ? GN_REF_RAY_CULL_FRONT_FACING : GN_REF_RAY_CULL_BACK_FACING));
}

void gn_ref_record_finish(const struct gn_ref_scene *scene, struct gn_ref_record *record)
{
    const struct gn_ref_instance *instance = &scene->instances[record->hit.instance];
    record->outcome = GN_REF_HIT;
    record->custom_index = instance->custom_index;
    record->sbt_offset = instance->sbt_offset;
}

void gn_ref_hit_set_rounding_errors(struct gn_ref_hit *hit, bool triangle)
{
    hit->t_error = gn_ref_rounding_error(hit->t);
    hit->t_exit_error = gn_ref_rounding_error(hit->t_exit);
    hit->barycentric_error = triangle ? gn_ref_rounding_error(fmax(fabs(hit->beta), fabs(hit->gamma))) : 0;
}

int gn_ref_hit_compare_ids(const struct gn_ref_hit *a, const struct gn_ref_hit *b)
{
    if (a->instance != b->instance)
        return a->instance < b->instance ? -1 : 1;
    if (a->geometry != b->geometry)
        return a->geometry < b->geometry ? -1 : 1;
    return (a->primitive > b->primitive) - (a->primitive < b->primitive);
}

void gn_ref_placed_add(struct gn_ref_placed_list *list, double place, const struct gn_ref_record *record)
{
    if (list->count == list->capacity) {
        size_t capacity = list->capacity ? list->capacity * 2 : 32;
        struct gn_ref_placed *items =
            capacity > SIZE_MAX / sizeof *items ? NULL : realloc(list->items, capacity * sizeof *items);
        if (!items) {
            list->failed = true;
            return;
        }
        list->items = items;
        list->capacity = capacity;
    }
    list->items[list->count++] = (struct gn_ref_placed){place, *record};
}

static int compare_placed(const void *left, const void *right)
{
    const struct gn_ref_placed *a = left, *b = right;
    if (a->place != b->place)
        return a->place < b->place ? -1 : 1;
    return gn_ref_hit_compare_ids(&a->record.hit, &b->record.hit);
}

int64_t gn_ref_placed_write(struct gn_ref_placed_list *list, struct gn_ref_record *out_records, size_t capacity)
{
    int64_t count = GN_REF_FAILED;
    if (!list->failed) {
        count = 0;
        if (list->count > 1)
            qsort(list->items, list->count, sizeof *list->items, compare_placed);
        for (size_t i = 0; i < list->count; i++) {
            if (i > 0 && compare_placed(&list->items[i - 1], &list->items[i]) == 0)
                continue;
            if ((size_t)count < capacity)
                out_records[count] = list->items[i].record;
            count++;
        }
    }
    free(list->items);
    *list = (struct gn_ref_placed_list){0};
    return count;
}

enum gn_ref_outcome gn_ref_tracer_closest(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray,
                                          struct gn_ref_record *out_record)
{
    *out_record = (struct gn_ref_record){0};
    if (!gn_ref_tracer_ray_valid(ray))
        return out_record->outcome = GN_REF_INVALID_RAY;
    return out_record->outcome = tracer->functions->closest(tracer, ray, out_record);
}

enum gn_ref_outcome gn_ref_tracer_occluded(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray)
{
    return gn_ref_tracer_ray_valid(ray) ? tracer->functions->occluded(tracer, ray) : GN_REF_INVALID_RAY;
}

int64_t gn_ref_tracer_all(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray,
                          struct gn_ref_record *out_records, size_t capacity)
{
    return gn_ref_tracer_ray_valid(ray) ? tracer->functions->all(tracer, ray, out_records, capacity) : GN_REF_INVALID_RAY;
}

void gn_ref_tracer_closest_batch(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *rays, size_t ray_count,
                                 struct gn_ref_record *out_records)
{
    if (tracer->functions->closest_batch) {
        tracer->functions->closest_batch(tracer, rays, ray_count, out_records);
        return;
    }
    for (size_t i = 0; i < ray_count; i++)
        gn_ref_tracer_closest(tracer, &rays[i], &out_records[i]);
}

void gn_ref_tracer_occluded_batch(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *rays, size_t ray_count,
                                  enum gn_ref_outcome *out_outcomes)
{
    if (tracer->functions->occluded_batch) {
        tracer->functions->occluded_batch(tracer, rays, ray_count, out_outcomes);
        return;
    }
    for (size_t i = 0; i < ray_count; i++)
        out_outcomes[i] = gn_ref_tracer_occluded(tracer, &rays[i]);
}

void gn_ref_tracer_all_batch(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *rays, size_t ray_count,
                             struct gn_ref_record *out_records, size_t capacity, int64_t *out_counts)
{
    for (size_t i = 0; i < ray_count; i++)
        out_counts[i] = gn_ref_tracer_all(tracer, &rays[i], capacity ? out_records + i * capacity : NULL, capacity);
}

/* CERTIFIED: the scene's own tree and decisions. */

static bool certified_create(struct gn_ref_tracer *tracer)
{
    const struct gn_ref_scene *scene = tracer->scene;
    tracer->cost.bytes = scene->bytes + malloc_usable_size(scene->boxes) +
                         malloc_usable_size(scene->box_transforms) + scene->box_bvh.bytes;
    tracer->cost.seconds = scene->commit_seconds;
    return true;
}

/* Whether boxes may count, which the traces of triangles alone do not look at. */
static bool boxes_count(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray)
{
    uint32_t effects = gn_ref_effects_called(scene, ray->flags, ray->cull_mask) | gn_ref_effects_forced();
    return effects >> GN_REF_EFFECT_AABBS & 1;
}

static enum gn_ref_outcome outcome_of(int64_t found)
{
    return found < 0 ? GN_REF_FAILED : found > 0 ? GN_REF_HIT : GN_REF_MISS;
}

static enum gn_ref_outcome certified_closest(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray,
                                             struct gn_ref_record *out_record)
{
    const struct gn_ref_scene *scene = tracer->scene;
    enum gn_ref_outcome outcome =
        outcome_of(boxes_count(scene, ray) ? gn_ref_trace_all_exact(scene, ray, &out_record->hit, 1)
                                           : gn_ref_trace_closest_triangle_exact(scene, ray, &out_record->hit));
    if (outcome == GN_REF_HIT)
        gn_ref_record_finish(tracer->scene, out_record);
    return outcome;
}

static enum gn_ref_outcome certified_occluded(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray)
{
    const struct gn_ref_scene *scene = tracer->scene;
    return outcome_of(boxes_count(scene, ray) ? gn_ref_trace_all_exact(scene, ray, NULL, 0)
                                              : gn_ref_trace_any_triangle(scene, ray));
}

static int64_t certified_all(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray,
                             struct gn_ref_record *out_records, size_t capacity)
{
    struct gn_ref_hit local[64], *hits = local;
    int64_t count = gn_ref_trace_all_exact(tracer->scene, ray, hits, capacity < 64 ? capacity : 64);
    size_t wanted = count < 0 ? 0 : (size_t)count < capacity ? (size_t)count : capacity;
    if (wanted > 64) {
        hits = wanted > SIZE_MAX / sizeof *hits ? NULL : malloc(wanted * sizeof *hits);
        if (!hits)
            return GN_REF_FAILED;
        count = gn_ref_trace_all_exact(tracer->scene, ray, hits, wanted);
    }
    for (size_t i = 0; count >= 0 && i < wanted; i++) {
        out_records[i] = (struct gn_ref_record){.hit = hits[i]};
        gn_ref_record_finish(tracer->scene, &out_records[i]);
    }
    if (hits != local)
        free(hits);
    return count < 0 ? GN_REF_FAILED : count;
}

/* How many rays are handed on at once: many to those in flight, and their records still in the cache afterwards. */
enum { PART = 1024 };

/* False where boxes may count for one of the rays. */
static bool part_is_of_triangles(const struct gn_ref_scene *scene, const struct gn_ref_ray *rays, size_t count)
{
    if (scene->box_count == 0 && !gn_ref_effects_forced())
        return true;
    for (size_t i = 0; i < count; i++)
        if (boxes_count(scene, &rays[i]))
            return false;
    return true;
}

static enum gn_ref_outcome batch_outcome(const struct gn_ref_ray *ray, int8_t found)
{
    return found < 0 && !gn_ref_tracer_ray_valid(ray) ? GN_REF_INVALID_RAY : outcome_of(found);
}

static void certified_closest_batch(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *rays, size_t ray_count,
                                    struct gn_ref_record *out_records)
{
    int8_t found[PART];
    for (size_t first = 0; first < ray_count; first += PART) {
        size_t count = ray_count - first < PART ? ray_count - first : PART;
        struct gn_ref_record *records = out_records + first;
        bool of_triangles = part_is_of_triangles(tracer->scene, rays + first, count);
        if (of_triangles)
            gn_ref_trace_closest_triangles_apart(tracer->scene, rays + first, count, &records->hit, sizeof *records, found);
        for (size_t i = 0; i < count; i++) {
            if (!of_triangles)
                gn_ref_tracer_closest(tracer, &rays[first + i], &records[i]);
            else if (found[i] > 0)
                gn_ref_record_finish(tracer->scene, &records[i]);
            else
                records[i] = (struct gn_ref_record){.outcome = batch_outcome(&rays[first + i], found[i])};
        }
    }
}

static void certified_occluded_batch(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *rays,
                                     size_t ray_count, enum gn_ref_outcome *out_outcomes)
{
    int8_t found[PART];
    for (size_t first = 0; first < ray_count; first += PART) {
        size_t count = ray_count - first < PART ? ray_count - first : PART;
        bool of_triangles = part_is_of_triangles(tracer->scene, rays + first, count);
        if (of_triangles)
            gn_ref_trace_any_triangles(tracer->scene, rays + first, count, found);
        for (size_t i = 0; i < count; i++)
            out_outcomes[first + i] = of_triangles ? batch_outcome(&rays[first + i], found[i])
                                                   : gn_ref_tracer_occluded(tracer, &rays[first + i]);
    }
}

const struct gn_ref_tier_functions gn_ref_tier_certified = {
    .name = "certified",
    .create = certified_create,
    .closest = certified_closest,
    .occluded = certified_occluded,
    .all = certified_all,
    .closest_batch = certified_closest_batch,
    .occluded_batch = certified_occluded_batch,
};
