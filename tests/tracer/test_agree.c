/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The tiers against one another over the proof's families of scenes: all of them on rays that decide nothing closely,
 * CERTIFIED, EXACT and the proof's oracle on rays that do, batches against single rays, threads against one.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "reference/tracer.h"
#include "proof.h"

enum { MOST = 512, RAYS = 256 };

/* A scene of a family with its tiers and some rays. */
struct world {
    struct made_scene made;
    struct gn_ref_scene *scene;
    struct oracle *oracle;
    struct gn_ref_tracer *tracers[GN_REF_TIER_COUNT];
    struct gn_ref_ray rays[RAYS];
};

/* Boxes that are a face or an edge are met by luck in f32: these get a body. */
static void boxes_fatten(struct made_scene *made)
{
    for (uint32_t g = 0; g < made->scene.blas_first[made->scene.blas_count]; g++) {
        const struct gn_ref_geometry *geometry = &made->scene.geometries[g];
        for (uint32_t i = 0; geometry->type == GN_REF_AABBS && i < geometry->primitive_count; i++)
            for (int j = 0; j < 3; j++) {
                float *box = (float *)geometry->aabbs[i];
                if (box[j] == box[3 + j])
                    box[3 + j] += 0x1p-5f;
            }
    }
}

static void world_make(struct world *world, const struct family *family, uint64_t seed, uint32_t triangles, bool easy)
{
    struct rng rng = {seed};
    char error[320];
    memset(world, 0, sizeof *world);
    family->make(&world->made, &rng, triangles < family->most_triangles ? triangles : family->most_triangles);
    if (easy)
        boxes_fatten(&world->made);
    const struct oracle_scene *of = &world->made.scene;
    world->scene = gn_ref_scene_create();
    for (uint32_t b = 0; b < of->blas_count; b++) {
        uint32_t blas;
        assert_true(gn_ref_scene_add_blas(world->scene, &of->geometries[of->blas_first[b]],
                                          of->blas_first[b + 1] - of->blas_first[b], &blas));
    }
    for (uint32_t i = 0; i < of->instance_count; i++)
        assert_true(gn_ref_scene_add_instance(world->scene, &of->instances[i]));
    assert_true(gn_ref_scene_commit(world->scene));
    for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
        world->tracers[t] = gn_ref_tracer_create(world->scene, (enum gn_ref_tier)t, error, sizeof error);
        if (!world->tracers[t])
            fail_msg("%s: %s", family->name, error);
    }
    world->oracle = oracle_create(of);
    for (int i = 0; i < RAYS; i++)
        world->rays[i] = made_ray(&world->made, family, (enum aim)(i % AIM_COUNT), &rng, world->oracle);
}

static void world_free(struct world *world)
{
    for (int t = 0; t < GN_REF_TIER_COUNT; t++)
        gn_ref_tracer_destroy(world->tracers[t]);
    oracle_destroy(world->oracle);
    gn_ref_scene_destroy(world->scene);
    made_scene_free(&world->made);
}

static int failures;

static void complain(const char *family, const char *tier, const struct gn_ref_ray *ray, const char *what)
{
    if (failures++ < 10)
        print_error("%s, %s: %s; origin %a %a %a direction %a %a %a tmin %a tmax %a flags 0x%x mask 0x%x\n", family, tier,
                    what, ray->origin[0], ray->origin[1], ray->origin[2], ray->direction[0], ray->direction[1],
                    ray->direction[2], ray->tmin, ray->tmax, ray->flags, ray->cull_mask);
}

static bool same_ids(const struct gn_ref_hit *a, const struct gn_ref_hit *b)
{
    return a->type == b->type && a->instance == b->instance && a->geometry == b->geometry && a->primitive == b->primitive &&
           a->front == b->front && a->opaque == b->opaque;
}

/* Two records of one hit, as precise as they say they are. */
static bool same_within_errors(const struct gn_ref_record *a, const struct gn_ref_record *b)
{
    return same_ids(&a->hit, &b->hit) && a->custom_index == b->custom_index && a->sbt_offset == b->sbt_offset &&
           (isinf(a->hit.t) || isinf(b->hit.t) || fabs(a->hit.t - b->hit.t) <= a->hit.t_error + b->hit.t_error) &&
           (isinf(a->hit.t_exit) || isinf(b->hit.t_exit) ||
            fabs(a->hit.t_exit - b->hit.t_exit) <= a->hit.t_exit_error + b->hit.t_exit_error) &&
           fabs(a->hit.beta - b->hit.beta) <= a->hit.barycentric_error + b->hit.barycentric_error &&
           fabs(a->hit.gamma - b->hit.gamma) <= a->hit.barycentric_error + b->hit.barycentric_error;
}

/*
 * A ray is easy when rays a thousandth of the scene beside it, with ranges a little shorter and longer, have the same hits,
 * none of them as near as the next or at an edge. A range that is a point is not.
 */
static bool is_easy(const struct world *world, const struct gn_ref_ray *ray, struct gn_ref_record *right, int64_t *out_count)
{
    static struct gn_ref_record other[MOST];
    const struct gn_ref_tracer *certified = world->tracers[GN_REF_TIER_CERTIFIED];
    *out_count = gn_ref_tracer_all(certified, ray, right, MOST);
    if (*out_count > MOST || ray->tmin * 1.001f > ray->tmax * 0.999f)
        return false;
    for (int64_t h = 0; h < *out_count; h++) {
        double b = right[h].hit.beta, c = right[h].hit.gamma;
        if (right[h].hit.type == GN_REF_TRIANGLES && fmin(fmin(b, c), 1 - b - c) < 1e-3)
            return false;
        if (right[h].hit.type == GN_REF_AABBS && right[h].hit.t_exit - right[h].hit.t < 1e-4 * fabs(right[h].hit.t))
            return false;
    }
    for (int64_t h = 0; h + 1 < *out_count; h++)
        if (right[h + 1].hit.t - right[h].hit.t < 1e-4 * fabs(right[h].hit.t))
            return false;
    for (int i = 0; i < 16; i++) {
        struct gn_ref_ray beside = *ray;
        float length = 0, step = i < 8 ? 1e-3f : 1e-5f; /* the small step is for spikes */
        for (int j = 0; j < 3; j++)
            length = fmaxf(length, fabsf(ray->direction[j]));
        for (int j = 0; j < 3; j++) {
            beside.origin[j] += (i >> j & 1 ? step : -step) * (float)world->made.extent;
            beside.direction[j] += (i >> ((j + 1) % 3) & 1 ? step : -step) * length;
        }
        beside.tmin *= i & 1 ? 1.001f : 0.999f;
        beside.tmax *= i & 1 ? 0.999f : 1.001f;
        int64_t count = gn_ref_tracer_all(certified, &beside, other, MOST);
        if (count != *out_count)
            return false;
        for (int64_t h = 0; h < count; h++)
            if (!same_ids(&right[h].hit, &other[h].hit))
                return false;
    }
    return true;
}

static void all_tiers_agree_on_easy_rays(void **state)
{
    (void)state;
    static struct gn_ref_record right[MOST], found[MOST];
    static const char *const chosen[] = {"height field", "lattice", "closed", "instances", "geometry transforms",
                                         "boxes", "flags and masks", "on surfaces"};
    static struct world world;
    int easy = 0, easy_hits = 0;
    failures = 0;
    for (uint32_t f = 0; f < family_count; f++)
        for (size_t c = 0; c < sizeof chosen / sizeof chosen[0]; c++) {
            if (strcmp(families[f].name, chosen[c]) != 0)
                continue;
            struct family family = families[f];
            family.options &= ~(unsigned)RAYS_SCALED; /* t beyond f32 is not easy */
            for (uint64_t seed = 0; seed < 8; seed++) {
                world_make(&world, &family, 1000 + seed, 60, true);
                for (int i = 0; i < RAYS; i++) {
                    const struct gn_ref_ray *ray = &world.rays[i];
                    int64_t count;
                    if (i % AIM_COUNT == AIM_EDGE || i % AIM_COUNT == AIM_VERTEX)
                        continue;
                    if (!is_easy(&world, ray, right, &count))
                        continue;
                    easy++;
                    easy_hits += count > 0;
                    for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
                        const char *name = gn_ref_tier_name((enum gn_ref_tier)t);
                        struct gn_ref_record closest;
                        enum gn_ref_outcome outcome = gn_ref_tracer_closest(world.tracers[t], ray, &closest);
                        if (gn_ref_tracer_all(world.tracers[t], ray, found, MOST) != count)
                            complain(chosen[c], name, ray, "another number of hits");
                        else if (outcome != (count > 0 ? GN_REF_HIT : GN_REF_MISS) ||
                                 gn_ref_tracer_occluded(world.tracers[t], ray) != outcome)
                            complain(chosen[c], name, ray, "hit or miss");
                        else if (count > 0 && !same_ids(&closest.hit, &right[0].hit))
                            complain(chosen[c], name, ray, "another closest hit");
                        else
                            for (int64_t h = 0; h < count; h++)
                                if (!same_ids(&found[h].hit, &right[h].hit) ||
                                    found[h].custom_index != right[h].custom_index ||
                                    !(fabs(found[h].hit.t - right[h].hit.t) <= 1e-3 * fabs(right[h].hit.t) + 1e-6))
                                    complain(chosen[c], name, ray, "another list");
                    }
                }
                world_free(&world);
            }
        }
    print_message("%d easy rays, %d of them meet something\n", easy, easy_hits);
    assert_int_equal(failures, 0);
    assert_true(easy > 4000 && easy_hits > 1500);
}

static void certified_equals_exact_and_the_oracle_on_hard_rays(void **state)
{
    (void)state;
    static struct gn_ref_record right[MOST], found[MOST];
    static struct world world;
    uint64_t seeds = proof_scaled(6), traced = 0, hits = 0;
    if (seeds < 1)
        seeds = 1;
    failures = 0;
    for (uint32_t f = 0; f < family_count; f++)
        for (uint64_t seed = 0; seed < seeds; seed++) {
            world_make(&world, &families[f], 7000 + seed, seed & 1 ? 400 : 60, false);
            const struct gn_ref_tracer *certified = world.tracers[GN_REF_TIER_CERTIFIED];
            const struct gn_ref_tracer *exact = world.tracers[GN_REF_TIER_EXACT];
            for (int i = 0; i < RAYS; i++) {
                const struct gn_ref_ray *ray = &world.rays[i];
                const struct gn_ref_hit *ideal;
                int64_t count = gn_ref_tracer_all(exact, ray, right, MOST);
                int64_t other = gn_ref_tracer_all(certified, ray, found, MOST);
                size_t ideal_count = oracle_trace(world.oracle, ray, &ideal);
                struct gn_ref_record nearest[2];
                enum gn_ref_outcome outcome = gn_ref_tracer_closest(exact, ray, &nearest[0]);
                traced++;
                hits += count > 0;
                if (count != other || count != (int64_t)ideal_count) {
                    complain(families[f].name, "certified", ray, "another number of hits than exact or the oracle");
                    continue;
                }
                for (int64_t h = 0; h < count && h < MOST; h++) {
                    if (!same_within_errors(&right[h], &found[h]))
                        complain(families[f].name, "certified", ray, "another list, or outside of its error bounds");
                    if (!same_ids(&right[h].hit, &ideal[h]))
                        complain(families[f].name, "exact", ray, "another list than the oracle");
                }
                if (gn_ref_tracer_closest(certified, ray, &nearest[1]) != outcome ||
                    outcome != (count > 0 ? GN_REF_HIT : GN_REF_MISS) ||
                    gn_ref_tracer_occluded(certified, ray) != outcome || gn_ref_tracer_occluded(exact, ray) != outcome)
                    complain(families[f].name, "certified", ray, "hit or miss");
                else if (count > 0 && (!same_within_errors(&nearest[0], &nearest[1]) ||
                                       !same_within_errors(&nearest[0], &right[0])))
                    complain(families[f].name, "certified", ray, "another closest hit");
            }
            world_free(&world);
        }
    print_message("%llu rays, %llu of them meet something\n", (unsigned long long)traced, (unsigned long long)hits);
    assert_int_equal(failures, 0);
    assert_true(hits * 3 > traced);
}

/* To the last bit, Embree's packets excepted: they may round differently, and then decide differently. */
static void batches_equal_single_rays(void **state)
{
    (void)state;
    static struct gn_ref_record batch[RAYS], lists[RAYS * 4], list[4];
    static enum gn_ref_outcome any[RAYS];
    static int64_t counts[RAYS];
    static struct world world;
    uint64_t differ = 0, traced = 0;
    failures = 0;
    for (uint32_t f = 0; f < family_count; f++) {
        world_make(&world, &families[f], 99, 200, false);
        world.rays[3].origin[1] = NAN;
        world.rays[RAYS - 1].direction[2] = INFINITY;
        for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
            const char *name = gn_ref_tier_name((enum gn_ref_tier)t);
            bool packets = t == GN_REF_TIER_FAST || t == GN_REF_TIER_ROBUST;
            /* An odd number, and from an odd place on. */
            size_t first = 1, count = RAYS - 1;
            gn_ref_tracer_closest_batch(world.tracers[t], world.rays + first, count, batch);
            gn_ref_tracer_occluded_batch(world.tracers[t], world.rays + first, count, any);
            gn_ref_tracer_all_batch(world.tracers[t], world.rays + first, count, lists, 4, counts);
            for (size_t i = 0; i < count; i++) {
                const struct gn_ref_ray *ray = &world.rays[first + i];
                struct gn_ref_record single;
                gn_ref_tracer_closest(world.tracers[t], ray, &single);
                enum gn_ref_outcome occluded = gn_ref_tracer_occluded(world.tracers[t], ray);
                int64_t listed = gn_ref_tracer_all(world.tracers[t], ray, list, 4);
                bool same = single.outcome == batch[i].outcome && occluded == any[i] &&
                            memcmp(&single.hit.t, &batch[i].hit.t, 4 * sizeof(double)) == 0 &&
                            same_ids(&single.hit, &batch[i].hit) && single.custom_index == batch[i].custom_index;
                if (packets) {
                    differ += !same;
                    traced++;
                } else if (!same) {
                    complain(families[f].name, name, ray, "the batch differs");
                }
                if (listed != counts[i])
                    complain(families[f].name, name, ray, "the batch of lists differs");
                for (int64_t h = 0; h < listed && h < 4; h++)
                    if (memcmp(&list[h].hit.t, &lists[i * 4 + (size_t)h].hit.t, 4 * sizeof(double)) != 0 ||
                        !same_ids(&list[h].hit, &lists[i * 4 + (size_t)h].hit))
                        complain(families[f].name, name, ray, "the batch of lists differs");
            }
        }
        world_free(&world);
    }
    print_message("Embree's packets differ from its single rays for %llu of %llu\n", (unsigned long long)differ,
                  (unsigned long long)traced);
    assert_int_equal(failures, 0);
    assert_true(differ * 50 < traced);
}

struct job {
    const struct world *world;
    struct gn_ref_record records[GN_REF_TIER_COUNT][RAYS];
};

static void *job_run(void *pointer)
{
    struct job *job = pointer;
    for (int t = 0; t < GN_REF_TIER_COUNT; t++)
        for (int i = 0; i < RAYS; i += 64) {
            gn_ref_tracer_closest_batch(job->world->tracers[t], job->world->rays + i, 32, job->records[t] + i);
            for (int k = i + 32; k < i + 64; k++)
                gn_ref_tracer_closest(job->world->tracers[t], &job->world->rays[k], &job->records[t][k]);
        }
    return NULL;
}

static void threads_trace_at_once(void **state)
{
    (void)state;
    enum { THREADS = 8 };
    static struct job jobs[THREADS + 1];
    static struct world world;
    for (uint32_t f = 0; f < family_count; f++) {
        pthread_t threads[THREADS];
        world_make(&world, &families[f], 5, 100, false);
        for (int i = 0; i <= THREADS; i++)
            jobs[i].world = &world;
        job_run(&jobs[THREADS]);
        for (int i = 0; i < THREADS; i++)
            assert_int_equal(pthread_create(&threads[i], NULL, job_run, &jobs[i]), 0);
        for (int i = 0; i < THREADS; i++)
            assert_int_equal(pthread_join(threads[i], NULL), 0);
        for (int i = 0; i < THREADS; i++)
            for (int t = 0; t < GN_REF_TIER_COUNT; t++)
                for (int k = 0; k < RAYS; k++) {
                    const struct gn_ref_record *a = &jobs[i].records[t][k], *b = &jobs[THREADS].records[t][k];
                    assert_int_equal(a->outcome, b->outcome);
                    assert_true(same_ids(&a->hit, &b->hit));
                    assert_memory_equal(&a->hit.t, &b->hit.t, 4 * sizeof(double));
                }
        world_free(&world);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_tiers_agree_on_easy_rays),
        cmocka_unit_test(certified_equals_exact_and_the_oracle_on_hard_rays),
        cmocka_unit_test(batches_equal_single_rays),
        cmocka_unit_test(threads_trace_at_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
