/* SPDX-License-Identifier: Apache-2.0 */
/* Reduces a failing scene: fewer instances, geometries, primitives, vertices and rays, then shorter numbers. */
#include "cts/shrink.h"

#include <math.h>
#include <string.h>

struct shrink {
    struct gn_arena *arena;
    struct gn_fuzz_trial *trial;
    gn_fuzz_fails *fails;
    void *context;
    uint32_t attempts, most;
};

static bool attempt(struct shrink *shrink, const struct gn_fuzz_trial *less)
{
    if (shrink->attempts >= shrink->most)
        return false;
    shrink->attempts++;
    if (!shrink->fails(shrink->context, less))
        return false;
    *shrink->trial = *less;
    return true;
}

/* What is a list of `count` things in a trial; `without` gives a trial that lacks those from `first` on. */
struct list {
    uint32_t (*count)(const struct gn_fuzz_trial *trial, uint32_t blas, uint32_t geometry);
    void (*without)(struct gn_arena *arena, struct gn_shrink_copy *copy, uint32_t blas, uint32_t geometry, uint32_t first,
                    uint32_t count);
};

/* Removes runs of halves, quarters and so on down to single ones (Zeller's ddmin by complements). */
static bool list_shrink(struct shrink *shrink, const struct list *list, uint32_t blas, uint32_t geometry)
{
    bool changed = false;
    for (uint32_t run = list->count(shrink->trial, blas, geometry); run > 0; run /= 2) {
        for (uint32_t first = 0; first < list->count(shrink->trial, blas, geometry);) {
            const uint32_t count = list->count(shrink->trial, blas, geometry);
            const uint32_t gone = run < count - first ? run : count - first;
            struct gn_shrink_copy copy;
            gn_shrink_copy_make(shrink->arena, shrink->trial, &copy);
            list->without(shrink->arena, &copy, blas, geometry, first, gone);
            if (attempt(shrink, &copy.trial))
                changed = true;
            else
                first += gone;
        }
    }
    return changed;
}

static uint32_t rays_count(const struct gn_fuzz_trial *trial, uint32_t blas, uint32_t geometry)
{
    (void)blas, (void)geometry;
    return trial->ray_count;
}

static void close_gap(void *base, size_t size, uint32_t count, uint32_t first, uint32_t gone)
{
    uint8_t *bytes = base;
    memmove(bytes + first * size, bytes + (first + gone) * size, (count - first - gone) * size);
}

static void rays_without(struct gn_arena *arena, struct gn_shrink_copy *copy, uint32_t blas, uint32_t geometry,
                         uint32_t first, uint32_t gone)
{
    (void)arena, (void)blas, (void)geometry;
    close_gap(copy->trial.rays, sizeof *copy->trial.rays, copy->trial.ray_count, first, gone);
    copy->trial.ray_count -= gone;
}

static uint32_t instances_count(const struct gn_fuzz_trial *trial, uint32_t blas, uint32_t geometry)
{
    (void)blas, (void)geometry;
    return trial->scene.instance_count;
}

static void instances_without(struct gn_arena *arena, struct gn_shrink_copy *copy, uint32_t blas, uint32_t geometry,
                              uint32_t first, uint32_t gone)
{
    (void)arena, (void)blas, (void)geometry;
    const uint32_t count = copy->trial.scene.instance_count;
    close_gap(copy->instances, sizeof *copy->instances, count, first, gone);
    if (copy->initial_instances)
        close_gap(copy->initial_instances, sizeof *copy->instances, count, first, gone);
    copy->trial.scene.instance_count -= gone;
    uint32_t *focus = &copy->trial.focus;
    *focus = *focus < first ? *focus : *focus < first + gone ? 0 : *focus - gone;
}

static uint32_t blases_count(const struct gn_fuzz_trial *trial, uint32_t blas, uint32_t geometry)
{
    (void)blas, (void)geometry;
    return trial->scene.blas_count;
}

/* Instances of those that go lose their reference's target: they go, too. */
static void blases_without(struct gn_arena *arena, struct gn_shrink_copy *copy, uint32_t blas, uint32_t geometry,
                           uint32_t first, uint32_t gone)
{
    (void)arena, (void)blas, (void)geometry;
    struct gn_cts_scene *scene = &copy->trial.scene;
    uint32_t kept = 0;
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        bool stays = true;
        struct gn_cts_instance *both[] = {&copy->instances[i], copy->initial_instances ? &copy->initial_instances[i] : NULL};
        for (int k = 0; k < 2 && both[k]; k++) {
            if (both[k]->blas == GN_CTS_NO_BLAS)
                continue;
            stays = stays && (both[k]->blas < first || both[k]->blas >= first + gone);
            both[k]->blas -= both[k]->blas >= first + gone ? gone : 0;
        }
        if (!stays)
            continue;
        if (copy->trial.focus == i)
            copy->trial.focus = kept;
        copy->instances[kept] = copy->instances[i];
        if (copy->initial_instances)
            copy->initial_instances[kept] = copy->initial_instances[i];
        kept++;
    }
    scene->instance_count = kept;
    close_gap(copy->blases, sizeof *copy->blases, scene->blas_count, first, gone);
    scene->blas_count -= gone;
}

static uint32_t geometries_count(const struct gn_fuzz_trial *trial, uint32_t blas, uint32_t geometry)
{
    (void)geometry;
    return trial->scene.blases[blas].geometry_count;
}

static void geometries_without(struct gn_arena *arena, struct gn_shrink_copy *copy, uint32_t blas, uint32_t geometry,
                               uint32_t first, uint32_t gone)
{
    (void)arena, (void)geometry;
    close_gap(copy->geometries[blas], sizeof **copy->geometries, copy->blases[blas].geometry_count, first, gone);
    copy->blases[blas].geometry_count -= gone;
}

static uint32_t primitives_count(const struct gn_fuzz_trial *trial, uint32_t blas, uint32_t geometry)
{
    const struct gn_cts_geometry *of = &trial->scene.blases[blas].geometries[geometry];
    return of->type == GN_REF_TRIANGLES ? of->triangle_count : of->aabb_count;
}

static void *array_without(struct gn_arena *arena, const void *array, size_t size, uint32_t count, uint32_t first,
                                 uint32_t gone)
{
    if (!array)
        return NULL;
    uint8_t *copy = gn_arena_alloc(arena, count, size);
    memcpy(copy, array, count * size);
    close_gap(copy, size, count, first, gone);
    return copy;
}

static void primitives_without(struct gn_arena *arena, struct gn_shrink_copy *copy, uint32_t blas, uint32_t geometry,
                               uint32_t first, uint32_t gone)
{
    struct gn_cts_geometry *of = &copy->geometries[blas][geometry];
    if (of->type == GN_REF_TRIANGLES) {
        of->triangles = array_without(arena, of->triangles, sizeof *of->triangles, of->triangle_count, first, gone);
        of->triangle_count -= gone;
    } else {
        of->aabbs = array_without(arena, of->aabbs, sizeof *of->aabbs, of->aabb_count, first, gone);
        of->initial_aabbs = array_without(arena, of->initial_aabbs, sizeof *of->aabbs, of->aabb_count, first, gone);
        of->aabb_count -= gone;
    }
}

/* Vertices that no triangle names any more. */
static void vertices_shrink(struct shrink *shrink)
{
    struct gn_shrink_copy copy;
    gn_shrink_copy_make(shrink->arena, shrink->trial, &copy);
    for (uint32_t b = 0; b < copy.trial.scene.blas_count; b++)
        for (uint32_t g = 0; g < copy.blases[b].geometry_count; g++) {
            struct gn_cts_geometry *of = &copy.geometries[b][g];
            if (of->type != GN_REF_TRIANGLES)
                continue;
            const uint32_t count = of->position_count;
            uint32_t *to = GN_NEW(shrink->arena, uint32_t, count), kept = 0;
            double(*positions)[3] = gn_arena_alloc(shrink->arena, count, sizeof *positions);
            double(*initial)[3] = gn_arena_alloc(shrink->arena, count, sizeof *initial);
            uint32_t(*triangles)[3] = gn_arena_alloc(shrink->arena, of->triangle_count, sizeof *triangles);
            for (uint32_t i = 0; i < 3 * of->triangle_count; i++) {
                const uint32_t from = of->triangles[i / 3][i % 3];
                if (!to[from]) {
                    memcpy(positions[kept], of->positions[from], sizeof *positions);
                    if (of->initial_positions)
                        memcpy(initial[kept], of->initial_positions[from], sizeof *initial);
                    to[from] = ++kept;
                }
                triangles[i / 3][i % 3] = to[from] - 1;
            }
            of->positions = (const double(*)[3])positions;
            of->initial_positions = of->initial_positions ? (const double(*)[3])initial : NULL;
            of->triangles = (const uint32_t(*)[3])triangles;
            of->position_count = kept;
        }
    attempt(shrink, &copy.trial);
}

static double rounded(double value, int bits)
{
    int exponent;
    const double fraction = frexp(value, &exponent);
    return value == value && fabs(value) < 1e30 ? ldexp(nearbyint(ldexp(fraction, bits)), exponent - bits) : value;
}

static void floats_round(float *values, uint32_t count, int bits)
{
    for (uint32_t i = 0; i < count; i++)
        values[i] = (float)rounded((double)values[i], bits);
}

/* Numbers of fewer bits are easier to look at: rays, then instances, then vertices. */
static void numbers_shrink(struct shrink *shrink)
{
    static const int bits[] = {2, 4, 8, 12};
    for (int part = 0; part < 3; part++)
        for (size_t k = 0; k < sizeof bits / sizeof bits[0]; k++) {
            struct gn_shrink_copy copy;
            gn_shrink_copy_make(shrink->arena, shrink->trial, &copy);
            for (uint32_t i = 0; i < copy.trial.ray_count && part == 0; i++) {
                struct gn_ref_ray *ray = &copy.trial.rays[i].ray;
                floats_round(ray->origin, 3, bits[k]);
                floats_round(ray->direction, 3, bits[k]);
            }
            for (uint32_t i = 0; i < copy.trial.scene.instance_count && part == 1; i++)
                floats_round(copy.instances[i].transform, 12, bits[k]);
            for (uint32_t b = 0; b < copy.trial.scene.blas_count && part == 2; b++)
                for (uint32_t g = 0; g < copy.blases[b].geometry_count; g++) {
                    struct gn_cts_geometry *of = &copy.geometries[b][g];
                    double(*positions)[3] = gn_arena_alloc(shrink->arena, of->position_count, sizeof *positions);
                    for (uint32_t i = 0; i < 3 * of->position_count; i++)
                        positions[i / 3][i % 3] = rounded(of->positions[i / 3][i % 3], bits[k]);
                    of->positions = (const double(*)[3])positions;
                }
            const struct gn_ref_ray *ray = copy.trial.ray_count ? &copy.trial.rays[0].ray : NULL;
            if (ray && ray->direction[0] == 0 && ray->direction[1] == 0 && ray->direction[2] == 0)
                continue;
            if (attempt(shrink, &copy.trial))
                break;
        }
}

uint32_t gn_fuzz_shrink(struct gn_arena *arena, struct gn_fuzz_trial *inout_trial, uint32_t most_attempts,
                        gn_fuzz_fails *fails, void *context)
{
    static const struct list rays = {rays_count, rays_without}, instances = {instances_count, instances_without},
                             blases = {blases_count, blases_without},
                             geometries = {geometries_count, geometries_without},
                             primitives = {primitives_count, primitives_without};
    struct shrink shrink = {arena, inout_trial, fails, context, 0, most_attempts};
    bool changed = true;
    while (changed && shrink.attempts < most_attempts) {
        changed = list_shrink(&shrink, &rays, 0, 0);
        changed |= list_shrink(&shrink, &instances, 0, 0);
        changed |= list_shrink(&shrink, &blases, 0, 0);
        for (uint32_t b = 0; b < inout_trial->scene.blas_count; b++) {
            changed |= list_shrink(&shrink, &geometries, b, 0);
            for (uint32_t g = 0; g < inout_trial->scene.blases[b].geometry_count; g++)
                changed |= list_shrink(&shrink, &primitives, b, g);
        }
        for (uint32_t what = 0; what < GN_FUZZ_INGREDIENT_COUNT; what++) {
            struct gn_fuzz_trial less;
            if (gn_fuzz_without(arena, inout_trial, (enum gn_fuzz_ingredient)what, &less))
                changed |= attempt(&shrink, &less);
        }
    }
    vertices_shrink(&shrink);
    numbers_shrink(&shrink);
    return shrink.attempts;
}
