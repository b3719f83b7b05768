/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reference_balls: FLINT's balls, the GMP oracle, and the tiers exact and certified answer every ray alike, every
 * primitive looked at. With few rays it is a test; with many a proof.
 */
#include <flint/flint.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "balls.h"
#include "families.h"
#include "reference/tracer.h"

enum { RAYS_PER_SCENE = 64, TRIANGLES = 60, MOST = 512 };

static const enum gn_ref_tier tiers[2] = {GN_REF_TIER_EXACT, GN_REF_TIER_CERTIFIED};

struct totals {
    uint64_t rays, hit, hits, differences, forgotten, noticed;
    struct balls_counters balls;
};

static bool near(double a, double b, double least)
{
    if (isinf(a) || isinf(b) || fabs(b) < 0x1p-1000)
        return true; /* beyond f64's range */
    return fabs(a - b) <= (0x1p-40 + 0x1p-48) * fmax(fabs(b), least);
}

static bool same(const struct gn_ref_hit *a, const struct gn_ref_hit *b)
{
    return a->type == b->type && a->instance == b->instance && a->geometry == b->geometry && a->primitive == b->primitive &&
           a->opaque == b->opaque && near(a->t, b->t, 0) &&
           (a->type == GN_REF_AABBS
                ? near(a->t_exit, b->t_exit, 0)
                : a->front == b->front && near(a->beta, b->beta, 1) && near(a->gamma, b->gamma, 1));
}

/* Who differs from the balls, or NULL. */
static const char *check_ray(struct balls *balls, struct oracle *oracle, struct gn_ref_tracer *const tracers[2],
                             const struct gn_ref_ray *ray, const struct gn_ref_hit **out_right, size_t *out_count)
{
    static struct gn_ref_record records[MOST];
    const struct gn_ref_hit *right, *other;
    size_t count = balls_trace(balls, ray, &right), others = oracle_trace(oracle, ray, &other);
    *out_right = right;
    *out_count = count;
    if (others != count)
        return "the GMP oracle";
    for (size_t i = 0; i < count; i++)
        if (!same(&other[i], &right[i]))
            return "the GMP oracle";
    for (int t = 0; t < 2; t++) {
        if (gn_ref_tracer_all(tracers[t], ray, records, MOST) != (int64_t)count)
            return gn_ref_tier_name(tiers[t]);
        for (size_t i = 0; i < count && i < MOST; i++)
            if (!same(&records[i].hit, &right[i]))
                return gn_ref_tier_name(tiers[t]);
        if (gn_ref_tracer_closest(tracers[t], ray, &records[0]) != (count ? GN_REF_HIT : GN_REF_MISS) ||
            (count && !same(&records[0].hit, &right[0])))
            return gn_ref_tier_name(tiers[t]);
    }
    return NULL;
}

static struct gn_ref_scene *scene_of(const struct oracle_scene *of)
{
    struct gn_ref_scene *scene = gn_ref_scene_create();
    uint32_t index;
    bool ok = scene != NULL;
    for (uint32_t b = 0; ok && b < of->blas_count; b++)
        ok = gn_ref_scene_add_blas(scene, &of->geometries[of->blas_first[b]], of->blas_first[b + 1] - of->blas_first[b],
                                   &index);
    for (uint32_t i = 0; ok && i < of->instance_count; i++)
        ok = gn_ref_scene_add_instance(scene, &of->instances[i]);
    if (!ok || !gn_ref_scene_commit(scene)) {
        fprintf(stderr, "%s\n", scene ? gn_ref_scene_error(scene) : "out of memory");
        abort();
    }
    return scene;
}

static void scene_run(const struct family *family, uint64_t seed, uint64_t rays, struct totals *totals)
{
    struct rng rng = {seed};
    struct made_scene made = {0};
    family->make(&made, &rng, TRIANGLES);
    struct gn_ref_scene *scene = scene_of(&made.scene);
    struct gn_ref_tracer *tracers[2] = {gn_ref_tracer_create(scene, tiers[0], NULL, 0),
                                        gn_ref_tracer_create(scene, tiers[1], NULL, 0)};
    struct oracle *oracle = oracle_create(&made.scene);
    struct balls *balls = balls_create(&made.scene);
    if (!tracers[0] || !tracers[1])
        abort();
    oracle_exclude_nothing(oracle);
    for (uint64_t i = 0; i < rays; i++) {
        struct gn_ref_ray ray = made_ray(&made, family, (enum aim)(i % AIM_COUNT), &rng, oracle);
        const struct gn_ref_hit *right;
        size_t count;
        const char *who = check_ray(balls, oracle, tracers, &ray, &right, &count);
        totals->rays++;
        totals->hit += count > 0;
        totals->hits += count;
        if (who && totals->differences++ == 0)
            printf("%s, scene seed 0x%llx: %s differs; origin %a %a %a direction %a %a %a tmin %a tmax %a flags 0x%x mask "
                   "0x%x\n",
                   family->name, (unsigned long long)seed, who, (double)ray.origin[0], (double)ray.origin[1],
                   (double)ray.origin[2], (double)ray.direction[0], (double)ray.direction[1], (double)ray.direction[2],
                   (double)ray.tmin, (double)ray.tmax, ray.flags, ray.cull_mask);
        /* A comparison that cannot fail proves nothing: one that forgets what this ray meets has to differ. */
        if (i % 16 == 0 && count) {
            struct balls *forgetful = balls_create(&made.scene);
            balls_forget(forgetful, right[0].instance, right[0].geometry, right[0].primitive);
            totals->forgotten++;
            totals->noticed += check_ray(forgetful, oracle, tracers, &ray, &right, &count) != NULL;
            balls_destroy(forgetful);
        }
    }
    struct balls_counters counters = balls_counters(balls);
    totals->balls.narrow += counters.narrow;
    totals->balls.wide += counters.wide;
    totals->balls.rational += counters.rational;
    totals->balls.orders += counters.orders;
    balls_destroy(balls);
    oracle_destroy(oracle);
    gn_ref_tracer_destroy(tracers[0]);
    gn_ref_tracer_destroy(tracers[1]);
    gn_ref_scene_destroy(scene);
    made_scene_free(&made);
}

static void report(const char *name, const struct totals *t)
{
    printf("%-20s %9llu rays %9llu hit %10llu hits; by balls of 64 bits %11llu, 256 bits %9llu, by rationals %9llu; orders by "
           "rationals %8llu; forgotten %llu, noticed %llu; %llu differences\n",
           name, (unsigned long long)t->rays, (unsigned long long)t->hit, (unsigned long long)t->hits,
           (unsigned long long)t->balls.narrow, (unsigned long long)t->balls.wide, (unsigned long long)t->balls.rational,
           (unsigned long long)t->balls.orders, (unsigned long long)t->forgotten, (unsigned long long)t->noticed,
           (unsigned long long)t->differences);
    fflush(stdout);
}

int main(int argc, char **argv)
{
    double rays = 200;
    uint64_t seed = 1;
    struct totals all = {0};
    for (int i = 1; i < argc; i += 2) {
        const char *value = i + 1 < argc ? argv[i + 1] : NULL;
        if (value && strcmp(argv[i], "--rays") == 0) {
            rays = atof(value);
        } else if (value && strcmp(argv[i], "--seed") == 0) {
            seed = strtoull(value, NULL, 0);
        } else {
            fprintf(stderr, "usage: reference_balls [--rays N] [--seed S]   (rays of each family)\n");
            return 2;
        }
    }
    for (uint32_t f = 0; f < family_count; f++) {
        struct totals totals = {0};
        for (uint64_t done = 0, piece = 0; done < (uint64_t)rays; done += RAYS_PER_SCENE, piece++) {
            uint64_t left = (uint64_t)rays - done;
            scene_run(&families[f], seed * 0x100000001B3u + piece * 0x9E3779B9u + f * 77,
                      left < RAYS_PER_SCENE ? left : RAYS_PER_SCENE, &totals);
        }
        report(families[f].name, &totals);
        all.rays += totals.rays;
        all.hit += totals.hit;
        all.hits += totals.hits;
        all.differences += totals.differences;
        all.forgotten += totals.forgotten;
        all.noticed += totals.noticed;
        all.balls.narrow += totals.balls.narrow;
        all.balls.wide += totals.balls.wide;
        all.balls.rational += totals.balls.rational;
        all.balls.orders += totals.balls.orders;
    }
    report("all", &all);
    flint_cleanup();
    return all.differences || all.noticed != all.forgotten || !all.forgotten ? 1 : 0;
}
