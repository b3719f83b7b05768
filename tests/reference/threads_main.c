/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reference_threads: how the certified tier scales over threads that share one scene, built once. The same rays are traced by
 * one thread and, shared out, by several, in turns. The best of many runs counts, by the clock on the wall; where others use
 * the machine too, that says little, and the processor time per ray says whether threads get into each other's way. Not a test.
 */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "families.h"
#include "reference/tracer.h"

enum { MOST = 64 };

struct part {
    const struct gn_ref_tracer *tracer;
    const struct gn_ref_ray *rays;
    struct gn_ref_record *records;
    size_t count;
    bool batch;
    pthread_barrier_t *start, *end;
    double cpu;
};

static double clock_of(clockid_t id)
{
    struct timespec now;
    clock_gettime(id, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void *trace(void *user)
{
    struct part *part = user;
    pthread_barrier_wait(part->start);
    double before = clock_of(CLOCK_THREAD_CPUTIME_ID);
    if (part->batch)
        gn_ref_tracer_closest_batch(part->tracer, part->rays, part->count, part->records);
    else
        for (size_t i = 0; i < part->count; i++)
            gn_ref_tracer_closest(part->tracer, &part->rays[i], &part->records[i]);
    part->cpu = clock_of(CLOCK_THREAD_CPUTIME_ID) - before;
    pthread_barrier_wait(part->end);
    return NULL;
}

/* Seconds on the wall for all rays; *out_cpu is the processor time of all threads. */
static double run(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *rays, struct gn_ref_record *records,
                  size_t count, bool batch, int threads, double *out_cpu)
{
    struct part parts[MOST];
    pthread_t ids[MOST];
    pthread_barrier_t start, end;
    pthread_barrier_init(&start, NULL, (unsigned)threads + 1);
    pthread_barrier_init(&end, NULL, (unsigned)threads + 1);
    for (int i = 0; i < threads; i++) {
        size_t from = count * (size_t)i / (size_t)threads, to = count * ((size_t)i + 1) / (size_t)threads;
        parts[i] = (struct part){tracer, rays + from, records + from, to - from, batch, &start, &end, 0};
        if (pthread_create(&ids[i], NULL, trace, &parts[i]) != 0)
            abort();
    }
    pthread_barrier_wait(&start);
    double before = clock_of(CLOCK_MONOTONIC);
    pthread_barrier_wait(&end);
    double seconds = clock_of(CLOCK_MONOTONIC) - before;
    *out_cpu = 0;
    for (int i = 0; i < threads; i++) {
        pthread_join(ids[i], NULL);
        *out_cpu += parts[i].cpu;
    }
    pthread_barrier_destroy(&start);
    pthread_barrier_destroy(&end);
    return seconds;
}

static int compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* To the last bit; not by memcmp(), for what lies between the members. */
static bool same(const struct gn_ref_record *a, const struct gn_ref_record *b)
{
    const struct gn_ref_hit *p = &a->hit, *q = &b->hit;
    return a->outcome == b->outcome && p->instance == q->instance && p->geometry == q->geometry &&
           p->primitive == q->primitive && p->front == q->front && p->t == q->t && p->beta == q->beta &&
           p->gamma == q->gamma && a->hit.t_error == b->hit.t_error;
}

int main(int argc, char **argv)
{
    int threads = argc > 1 ? atoi(argv[1]) : 2, runs = argc > 2 ? atoi(argv[2]) : 31;
    size_t count = argc > 3 ? (size_t)atof(argv[3]) : 200000;
    uint32_t side = argc > 4 ? (uint32_t)atoi(argv[4]) : 256, blas;
    if (threads < 2 || threads > MOST || runs < 1 || runs > 999 || count < 1000 || side < 2) {
        fprintf(stderr, "usage: reference_threads [THREADS [RUNS [RAYS [SIDE of the height field]]]]\n");
        return 2;
    }
    struct rng rng = {5};
    struct made_scene made = {0};
    const struct family family = {"height field", NULL, 0, 0};
    make_height_field(&made, &rng, side, false);
    struct gn_ref_scene *scene = gn_ref_scene_create();
    if (!scene || !gn_ref_scene_add_blas(scene, made.scene.geometries, 1, &blas) ||
        !gn_ref_scene_add_instance(scene, made.scene.instances) || !gn_ref_scene_commit(scene))
        abort();
    struct gn_ref_tracer *tracer = gn_ref_tracer_create(scene, GN_REF_TIER_CERTIFIED, NULL, 0);
    struct gn_ref_ray *rays = malloc(count * sizeof *rays);
    struct gn_ref_record *records = calloc(count, sizeof *records), *right = calloc(count, sizeof *right);
    double *ratios = calloc((size_t)runs, sizeof *ratios), *efficiency = calloc((size_t)runs, sizeof *efficiency);
    if (!tracer || !rays || !records || !right || !ratios || !efficiency)
        abort();
    int exit_status = 0;
    for (size_t i = 0; i < count; i++)
        rays[i] = made_ray(&made, &family, (enum aim)(i % AIM_COUNT), &rng, NULL);
    for (int batch = 0; batch < 2; batch++) {
        double best[2] = {1e30, 1e30}, cpu;
        run(tracer, rays, right, count, batch, 1, &cpu);
        for (int r = 0; r < runs; r++) {
            double seconds[2] = {0, 0}, cpus[2] = {0, 0};
            for (int k = 0; k < 2; k++) {
                int several = (k + r) % 2;
                seconds[several] = run(tracer, rays, records, count, batch, several ? threads : 1, &cpus[several]);
                best[several] = seconds[several] < best[several] ? seconds[several] : best[several];
            }
            ratios[r] = seconds[0] / seconds[1];
            efficiency[r] = threads * cpus[0] / cpus[1];
            for (size_t i = 0; i < count; i++)
                if (!same(&records[i], &right[i])) {
                    printf("threads make another answer of ray %zu\n", i);
                    exit_status = 1;
                    break;
                }
        }
        qsort(ratios, (size_t)runs, sizeof *ratios, compare);
        qsort(efficiency, (size_t)runs, sizeof *efficiency, compare);
        printf("%-7s %d threads over 1: %.2fx by the best of %d runs each (%.2f and %.2f Mray/s), %.2fx the median run (%.2f to "
               "%.2f); by processor time %.2fx the median run (%.2f to %.2f)\n",
               batch ? "batches" : "single", threads, best[0] / best[1], runs, 1e-6 * (double)count / best[0],
               1e-6 * (double)count / best[1], ratios[runs / 2], ratios[0], ratios[runs - 1], efficiency[runs / 2],
               efficiency[0], efficiency[runs - 1]);
        fflush(stdout);
    }
    gn_ref_tracer_destroy(tracer);
    gn_ref_scene_destroy(scene);
    made_scene_free(&made);
    free(rays);
    free(records);
    free(right);
    free(ratios);
    free(efficiency);
    return exit_status;
}
