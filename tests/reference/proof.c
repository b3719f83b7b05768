/* SPDX-License-Identifier: Apache-2.0 */
/* The comparison of the reference with the oracle. */
#include "proof.h"

#include <float.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "reference/certified.h"
#include "reference/tracer.h"

#define RAYS_PER_SCENE 512
#define MOST_HITS 4096

uint64_t proof_scaled(uint64_t rays)
{
    double factor = 1;
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || defined(GNOMON_PROOF_SLOW)
    factor = 0.03;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
    factor = 0.03;
#endif
#endif
    const char *text = getenv("GNOMON_PROOF_SCALE");
    if (text && atof(text) > 0)
        factor = atof(text);
    double scaled = (double)rays * factor;
    return scaled < 1 ? 1 : (uint64_t)scaled;
}

static struct gn_ref_scene *reference_scene(const struct oracle_scene *scene)
{
    struct gn_ref_scene *out = gn_ref_scene_create();
    if (!out)
        abort();
    for (uint32_t b = 0; b < scene->blas_count; b++) {
        uint32_t index;
        if (!gn_ref_scene_add_blas(out, &scene->geometries[scene->blas_first[b]],
                                   scene->blas_first[b + 1] - scene->blas_first[b], &index)) {
            fprintf(stderr, "%s\n", gn_ref_scene_error(out));
            abort();
        }
    }
    for (uint32_t i = 0; i < scene->instance_count; i++)
        if (!gn_ref_scene_add_instance(out, &scene->instances[i])) {
            fprintf(stderr, "%s\n", gn_ref_scene_error(out));
            abort();
        }
    if (!gn_ref_scene_commit(out)) {
        fprintf(stderr, "%s\n", gn_ref_scene_error(out));
        abort();
    }
    return out;
}

/* The accuracy that trace.h promises; the oracle's own rounding is 2^-52. */
static bool close_to(double value, double right, double least)
{
    if (isinf(right) || (least == 0 && fabs(right) < 0x1p-1000))
        return value == right || fabs(value) < 0x1p-999 || isinf(value);
    return fabs(value - right) <= (0x1p-40 + 0x1p-50) * fmax(fabs(right), least);
}

static const char *difference(const struct gn_ref_hit *a, const struct gn_ref_hit *b)
{
    if (a->type != b->type || a->instance != b->instance || a->geometry != b->geometry || a->primitive != b->primitive)
        return "another primitive";
    if (a->opaque != b->opaque)
        return "opacity";
    if (!close_to(a->t, b->t, 0))
        return "t";
    if (a->type == GN_REF_AABBS)
        return close_to(a->t_exit, b->t_exit, 0) ? NULL : "exit";
    if (a->front != b->front)
        return "facing";
    return close_to(a->beta, b->beta, 1) && close_to(a->gamma, b->gamma, 1) ? NULL : "barycentrics";
}

/*
 * t as f32 is the ideal value rounded once: up or down, whatever way. The oracle's own t is within 2^-52, so that what is
 * counted as misrounded may be a tie between two f32 that the oracle has not told apart either.
 */
static const char *rounding(double t, double ideal, struct proof_counts *counts)
{
    if (!(fabs(ideal) > 0x1p-1000) || isinf(ideal))
        return NULL;
    counts->t_error = fmax(counts->t_error, fabs(t - ideal) / fabs(ideal) * 0x1p53);
    float near = (float)t;
    if (isinf(near) || fabsf(near) < FLT_MIN)
        return NULL;
    if (near != (float)ideal)
        counts->misrounded++;
    return nextafterf(near, -INFINITY) < ideal && ideal < nextafterf(near, INFINITY)
               ? NULL
               : "t is not the ideal one rounded once";
}

double proof_slack(const struct proof_counts *counts, enum proof_numbers numbers)
{
    uint64_t total = 0, below = 0;
    for (int i = 0; i < 64; i++)
        total += counts->slack[numbers][i];
    for (int i = 0; i < 64; i++) {
        below += counts->slack[numbers][i];
        if (2 * below >= total)
            return ldexp(1, i + 1);
    }
    return INFINITY;
}

/* Half the distance to the next f64 away from 0: what the nearest f64 to a number is wrong by at most. */
static double half_ulp(double value)
{
    return ldexp(1, ilogb(value) - 53);
}

/* No number is wrong by more than the bound it came with; by how much less is counted. */
static const char *bounded(struct oracle *oracle, size_t at, const struct gn_ref_hit *hit, bool rounded_once,
                           struct proof_counts *counts)
{
    const double values[ORACLE_NUMBER_COUNT] = {hit->t, hit->t_exit, hit->beta, hit->gamma};
    const double bounds[ORACLE_NUMBER_COUNT] = {hit->t_error, hit->t_exit_error, hit->barycentric_error,
                                                hit->barycentric_error};
    static const char *const words[ORACLE_NUMBER_COUNT] = {"the bound of t", "the bound of the exit",
                                                           "the bound of a barycentric", "the bound of a barycentric"};
    if (hit->type == GN_REF_TRIANGLES && (hit->t_exit != hit->t || hit->t_exit_error != hit->t_error))
        return "the exit of a triangle";
    for (int n = 0; n < ORACLE_NUMBER_COUNT; n++) {
        if (n == ORACLE_T_EXIT && hit->type == GN_REF_TRIANGLES)
            continue;
        double error = oracle_error(oracle, at, (enum oracle_number)n, values[n]);
        enum proof_numbers numbers = n == ORACLE_T || n == ORACLE_T_EXIT ? PROOF_LENGTHS : PROOF_BARYCENTRICS;
        double most = numbers == PROOF_LENGTHS ? fmax(0x1p-40 * fabs(values[n]), 0x1p-1074) : 0x1p-40;
        if (isinf(values[n]))
            continue;
        if (rounded_once && values[n] != 0 && !(error <= half_ulp(values[n])))
            return "a number rounded once";
        if (!(error <= bounds[n]) || !(bounds[n] <= most))
            return words[n];
        if (error == 0)
            counts->unerring[numbers]++;
        else
            counts->slack[numbers][ilogb(bounds[n] / error) & 63]++;
    }
    return NULL;
}

/* The exact numbers instead, and half an ulp for a bound. */
static const char *refined(const struct gn_ref_scene *scene, struct oracle *oracle, size_t at, const struct gn_ref_ray *ray,
                           struct gn_ref_hit hit)
{
    struct proof_counts unwanted = {0};
    if (!gn_ref_hit_refine_exact(scene, ray, &hit))
        return "that a hit has exact numbers";
    return bounded(oracle, at, &hit, true, &unwanted);
}

/* What is wrong with the reference's answers for one ray, or NULL. */
static const char *check_ray(const struct gn_ref_scene *scene, struct oracle *oracle, const struct gn_ref_ray *ray,
                             struct gn_ref_hit *hits, struct proof_counts *counts, size_t *out_at)
{
    const struct gn_ref_hit *right;
    size_t right_count = oracle_trace(oracle, ray, &right);
    int64_t count = gn_ref_trace_all_exact(scene, ray, hits, MOST_HITS);
    counts->rays++;
    counts->rays_hit += right_count > 0;
    counts->hits += right_count;
    *out_at = 0;
    size_t common = right_count < MOST_HITS ? right_count : MOST_HITS;
    if (count >= 0 && (size_t)count < common)
        common = (size_t)count;
    for (size_t i = 0; i < common; i++) {
        *out_at = i;
        const char *what = difference(&hits[i], &right[i]);
        if (!what)
            what = bounded(oracle, i, &hits[i], false, counts);
        if (!what && counts->rays % 8 == 0)
            what = refined(scene, oracle, i, ray, hits[i]);
        if (what)
            return what;
    }
    if (count < 0 || (size_t)count != right_count)
        return "the number of hits";
    struct gn_ref_hit closest;
    int found = gn_ref_trace_closest_triangle_exact(scene, ray, &closest);
    size_t first = 0;
    while (first < right_count && right[first].type != GN_REF_TRIANGLES)
        first++;
    *out_at = first;
    if (found != (first < right_count))
        return "whether there is a closest triangle";
    if (found) {
        const char *what = difference(&closest, &right[first]);
        if (!what)
            what = bounded(oracle, first, &closest, false, counts);
        if (!what)
            what = rounding(closest.t, right[first].t, counts);
        if (what)
            return what;
    }
    for (size_t i = 0; i + 1 < right_count; i++) {
        *out_at = i;
        if (right[i].type != GN_REF_TRIANGLES || right[i + 1].type != GN_REF_TRIANGLES)
            continue;
        int order = oracle_compare_t(oracle, i, i + 1);
        if (gn_ref_compare_t_exact(scene, ray, &right[i], &right[i + 1]) != order ||
            gn_ref_compare_t_exact(scene, ray, &right[i + 1], &right[i]) != -order)
            return "the order of two hits";
    }
    return NULL;
}

static void describe(struct proof_counts *counts, const char *name, uint64_t seed, const struct gn_ref_ray *ray,
                     const char *what, size_t at)
{
    if (counts->differences++ > 0)
        return;
    snprintf(counts->first, sizeof counts->first,
             "%s, scene seed 0x%llx: %s (hit %zu); origin %a %a %a direction %a %a %a tmin %a tmax %a flags 0x%x mask 0x%x",
             name, (unsigned long long)seed, what, at, ray->origin[0], ray->origin[1], ray->origin[2], ray->direction[0],
             ray->direction[1], ray->direction[2], ray->tmin, ray->tmax, ray->flags, ray->cull_mask);
}

void proof_counts_add(struct proof_counts *total, const struct proof_counts *more)
{
    total->rays += more->rays;
    total->aimed += more->aimed;
    total->rays_hit += more->rays_hit;
    total->hits += more->hits;
    total->pairs_excluded += more->pairs_excluded;
    total->pairs_exact += more->pairs_exact;
    total->t_error = fmax(total->t_error, more->t_error);
    total->misrounded += more->misrounded;
    for (int n = 0; n < 2; n++) {
        total->unerring[n] += more->unerring[n];
        for (int i = 0; i < 64; i++)
            total->slack[n][i] += more->slack[n][i];
    }
    if (total->differences == 0)
        memcpy(total->first, more->first, sizeof total->first);
    total->differences += more->differences;
}

struct job {
    const struct family *family;
    const struct proof_options *options;
    uint32_t large;
    atomic_uint_fast64_t next;
    uint64_t pieces;
    pthread_mutex_t lock;
    struct proof_counts total;
    struct made_scene *shared;
    const struct gn_ref_scene *shared_scene;
};

/* The batch gives what single rays give, with all the rays of a scene in flight. */
static void check_batch(const struct gn_ref_scene *scene, const char *name, uint64_t seed, const struct gn_ref_ray *rays,
                        size_t count, struct proof_counts *counts)
{
    struct gn_ref_hit hits[RAYS_PER_SCENE], hit;
    int8_t found[RAYS_PER_SCENE];
    gn_ref_trace_closest_triangles_exact(scene, rays, count, hits, found);
    for (size_t i = 0; i < count; i++) {
        const char *what = NULL;
        if (found[i] != gn_ref_trace_closest_triangle_exact(scene, &rays[i], &hit))
            what = "whether a batch has a closest triangle";
        else if (found[i] == 1)
            what = difference(&hits[i], &hit);
        if (!what && found[i] == 1 &&
            (hits[i].t != hit.t || hits[i].t_error != hit.t_error || hits[i].beta != hit.beta || hits[i].gamma != hit.gamma ||
             hits[i].barycentric_error != hit.barycentric_error))
            what = "a number of a batch, to the last bit";
        if (what)
            describe(counts, name, seed, &rays[i], what, i);
    }
}

static void piece_run(struct job *job, uint64_t piece, struct proof_counts *counts, struct gn_ref_hit *hits,
                      struct oracle *shared_oracle)
{
    uint64_t seed = job->options->seed * 0x100000001B3u + piece * 0x9E3779B9u + (uint64_t)(job->family - families) * 77;
    struct rng rng = {seed};
    struct made_scene made = {0};
    const struct made_scene *scene_made = job->shared;
    const struct gn_ref_scene *scene = job->shared_scene;
    struct gn_ref_scene *own = NULL;
    struct oracle *oracle = shared_oracle;
    if (!job->shared) {
        uint32_t most = job->family->most_triangles, limit = job->options->most_triangles;
        uint32_t triangles = limit ? (limit < most ? limit : most) : 8 + rng_below(&rng, most - 7);
        if (!limit && rng_below(&rng, 16) == 0)
            triangles = 1 + rng_below(&rng, 8);
        job->family->make(&made, &rng, triangles);
        scene_made = &made;
        own = reference_scene(&made.scene);
        scene = own;
        oracle = oracle_create(&made.scene);
        if (job->options->every_pair)
            oracle_exclude_nothing(oracle);
    }
    uint64_t first = piece * RAYS_PER_SCENE, last = first + RAYS_PER_SCENE;
    if (last > job->options->rays)
        last = job->options->rays;
    struct oracle_counters before = oracle_counters(oracle);
    struct gn_ref_ray rays[RAYS_PER_SCENE];
    for (uint64_t i = first; i < last; i++) {
        static const enum aim aims[10] = {AIM_EDGE, AIM_VERTEX, AIM_EDGE, AIM_VERTEX, AIM_INTERIOR,
                                          AIM_EDGE, AIM_VERTEX, AIM_EDGE, AIM_VERTEX, AIM_RANDOM};
        enum aim aim = aims[i % 10];
        struct gn_ref_ray ray = made_ray(scene_made, job->family, aim, &rng, oracle);
        size_t at;
        const char *what = check_ray(scene, oracle, &ray, hits, counts, &at);
        counts->aimed += aim == AIM_EDGE || aim == AIM_VERTEX;
        if (what)
            describe(counts, job->family->name, seed, &ray, what, at);
        rays[i - first] = ray;
    }
    check_batch(scene, job->family->name, seed, rays, (size_t)(last - first), counts);
    struct oracle_counters after = oracle_counters(oracle);
    counts->pairs_excluded += after.excluded - before.excluded;
    counts->pairs_exact += after.exact - before.exact;
    if (own) {
        oracle_destroy(oracle);
        gn_ref_scene_destroy(own);
        made_scene_free(&made);
    }
}

static void *job_thread(void *argument)
{
    struct job *job = argument;
    struct proof_counts counts = {0};
    struct gn_ref_hit *hits = malloc(MOST_HITS * sizeof *hits);
    struct oracle *oracle = job->shared ? oracle_create(&job->shared->scene) : NULL;
    if (!hits)
        abort();
    for (;;) {
        uint64_t piece = atomic_fetch_add(&job->next, 1);
        if (piece >= job->pieces)
            break;
        piece_run(job, piece, &counts, hits, oracle);
    }
    pthread_mutex_lock(&job->lock);
    proof_counts_add(&job->total, &counts);
    pthread_mutex_unlock(&job->lock);
    oracle_destroy(oracle);
    free(hits);
    return NULL;
}

static void job_run(struct job *job, struct proof_counts *out)
{
    pthread_t threads[64];
    int count = job->options->threads < 1 ? 1 : job->options->threads > 64 ? 64 : job->options->threads;
    gn_ref_certified_fly_always(true);
    job->pieces = (job->options->rays + RAYS_PER_SCENE - 1) / RAYS_PER_SCENE;
    pthread_mutex_init(&job->lock, NULL);
    for (int i = 0; i < count; i++)
        if (pthread_create(&threads[i], NULL, job_thread, job) != 0)
            abort();
    for (int i = 0; i < count; i++)
        pthread_join(threads[i], NULL);
    pthread_mutex_destroy(&job->lock);
    *out = job->total;
}

void proof_family(const struct family *family, const struct proof_options *options, struct proof_counts *out)
{
    struct job job = {.family = family, .options = options};
    job_run(&job, out);
}

void proof_large(uint32_t n, const struct proof_options *options, struct proof_counts *out)
{
    struct rng rng = {options->seed};
    struct made_scene made = {0};
    make_height_field(&made, &rng, n, false);
    struct gn_ref_scene *scene = reference_scene(&made.scene);
    struct job job = {.family = &families[0], .options = options, .shared = &made, .shared_scene = scene};
    job_run(&job, out);
    gn_ref_scene_destroy(scene);
    made_scene_free(&made);
}

uint64_t proof_self_check(const struct family *family, uint64_t seed, uint64_t *out_noticed)
{
    struct gn_ref_hit *hits = malloc(MOST_HITS * sizeof *hits);
    uint64_t aimed = 0;
    *out_noticed = 0;
    if (!hits)
        abort();
    for (uint64_t s = 0; s < 20; s++) {
        struct rng rng = {seed + s};
        struct made_scene made = {0};
        family->make(&made, &rng, 128);
        struct gn_ref_scene *scene = reference_scene(&made.scene);
        struct oracle *oracle = oracle_create(&made.scene);
        for (int i = 0; i < 200; i++) {
            struct gn_ref_ray ray = made_ray(&made, family, AIM_INTERIOR, &rng, oracle);
            struct gn_ref_hit closest;
            if (gn_ref_trace_closest_triangle_exact(scene, &ray, &closest) != 1)
                continue;
            struct oracle *forgetful = oracle_create(&made.scene);
            oracle_forget(forgetful, closest.instance, closest.geometry, closest.primitive);
            struct proof_counts counts = {0};
            size_t at;
            aimed++;
            *out_noticed += check_ray(scene, forgetful, &ray, hits, &counts, &at) != NULL;
            oracle_destroy(forgetful);
        }
        oracle_destroy(oracle);
        gn_ref_scene_destroy(scene);
        made_scene_free(&made);
    }
    free(hits);
    return aimed;
}
