/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tracer_speed: CERTIFIED against Embree's robust mode on the scenes of `gnomon accuracy` and on some that are not
 * among them, with every kernel that this machine has, one ray at a time and in batches. Ratios of CPU time in one run, medians
 * over the runs. Not a test: it judges nothing but that both find the same to within one ray in ten.
 *
 *     tracer_speed [--rays N] [--runs N] [--kernels avx512,avx2,portable] [SCENE...]
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "cts/accuracy.h"
#include "cts/arena.h"
#include "cts/generate.h"
#include "reference/certified.h"

static double cpu_seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static int compare(const void *left, const void *right)
{
    double a = *(const double *)left, b = *(const double *)right;
    return (a > b) - (a < b);
}

static double median(double *values, int count)
{
    qsort(values, (size_t)count, sizeof *values, compare);
    return values[count / 2];
}

/* Scenes of this program's own. */

static struct gn_mesh make_few(struct gn_arena *arena, struct gn_random *random)
{
    return gn_mesh_height_field(arena, random, 10, 0.2);
}

static struct gn_mesh make_small(struct gn_arena *arena, struct gn_random *random)
{
    return gn_mesh_height_field(arena, random, 64, 2.0 / 64);
}

static struct gn_mesh make_lattice(struct gn_arena *arena, struct gn_random *random)
{
    return gn_mesh_lattice(arena, random, 256, 1);
}

static struct gn_mesh make_needles(struct gn_arena *arena, struct gn_random *random)
{
    struct gn_mesh square = gn_mesh_height_field(arena, random, 256, 2.0 / 256);
    return gn_mesh_scaled(arena, &square, 1, 1e-6, 1e-4, 0, 0, 0);
}

static struct gn_mesh make_mixed(struct gn_arena *arena, struct gn_random *random)
{
    struct gn_mesh all = gn_mesh_height_field(arena, random, 128, 2.0 / 128);
    for (int i = 0; i < 6; i++) {
        struct gn_mesh blob = gn_mesh_blob(arena, random, 40, 80, 0.02);
        double scale = ldexp(1, -3 * i);
        struct gn_mesh placed = gn_mesh_scaled(arena, &blob, scale, scale, scale, 0.3 * i - 1, 0.2 * i - 0.5, scale);
        all = gn_mesh_joined(arena, &all, &placed);
    }
    return all;
}

static struct gn_mesh make_soup(struct gn_arena *arena, struct gn_random *random)
{
    return gn_mesh_soup(arena, random, 20000, 0.3);
}

static const struct {
    const char *name;
    struct gn_mesh (*make)(struct gn_arena *arena, struct gn_random *random);
    bool inside; /* rays start within the scene and go anywhere */
} own[] = {
    {"few", make_few, false},         {"small", make_small, false}, {"lattice", make_lattice, false},
    {"needles", make_needles, false}, {"mixed", make_mixed, false}, {"crowded", make_soup, false},
    {"inside", make_mixed, true},
};
enum { OWN = sizeof own / sizeof own[0] };

static bool scene_make(struct gn_accuracy_scene *scene, const char *name, struct gn_arena *arena, bool *out_inside)
{
    char error[320];
    int status;
    *out_inside = false;
    for (size_t i = 0; i < OWN; i++) {
        if (strcmp(own[i].name, name) != 0)
            continue;
        struct gn_random random = {11 + i};
        *scene = (struct gn_accuracy_scene){.name = own[i].name, .distance = 3};
        scene->model.meshes = GN_NEW(arena, struct gn_mesh, 1);
        scene->model.meshes[0] = own[i].make(arena, &random);
        scene->model.mesh_count = scene->model.instance_count = 1;
        scene->model.instances = GN_NEW(arena, struct gn_model_instance, 1);
        memcpy(scene->model.instances[0].transform, gn_identity, sizeof gn_identity);
        scene->triangles = scene->model.meshes[0].triangle_count;
        scene->triangles_up_to = &scene->triangles;
        *out_inside = own[i].inside;
        if (gn_accuracy_scene_commit(scene, error, sizeof error))
            return true;
        fprintf(stderr, "%s\n", error);
        return false;
    }
    if (gn_accuracy_scene_load(scene, name, false, 1, arena, &status, error, sizeof error) &&
        gn_accuracy_scene_commit(scene, error, sizeof error))
        return true;
    fprintf(stderr, "%s\n", error);
    return false;
}

enum { MOST_RUNS = 31, MOST_KERNELS = 4 };

struct totals {
    double log_sum[2], worst[2];
    int count;
};

struct bench {
    int runs, kernel_count;
    size_t count;
    const char *kernels[MOST_KERNELS];
    struct gn_ref_ray *rays;
    struct gn_ref_record *records;
    struct totals totals[MOST_KERNELS];
};

/* Seconds for all rays, at least ten thousand of them and a fiftieth of a second. */
static double take(const struct bench *bench, const struct gn_ref_tracer *tracer, bool batch, size_t *out_hits)
{
    /* What the one before has left in the caches is nobody's merit. */
    gn_ref_tracer_closest_batch(tracer, bench->rays, bench->count / 4, bench->records);
    double start = cpu_seconds(), seconds;
    int times = 0;
    do {
        if (batch)
            gn_ref_tracer_closest_batch(tracer, bench->rays, bench->count, bench->records);
        else
            for (size_t i = 0; i < bench->count; i++)
                gn_ref_tracer_closest(tracer, &bench->rays[i], &bench->records[i]);
        times++;
        seconds = cpu_seconds() - start;
    } while (seconds < 0.02);
    *out_hits = 0;
    for (size_t i = 0; i < bench->count; i++)
        *out_hits += bench->records[i].outcome == GN_REF_HIT;
    return seconds / times;
}

static bool measure(struct bench *bench, const struct gn_accuracy_scene *scene, bool inside, enum gn_aim aim,
                    struct gn_ref_tracer *const tracers[2])
{
    static double times[MOST_KERNELS + 1][2][MOST_RUNS];
    size_t hits[2];
    gn_accuracy_rays(scene, aim, 7, bench->rays, (uint32_t)bench->count);
    struct gn_random random = {99};
    for (size_t i = 0; inside && i < bench->count; i++)
        for (int j = 0; j < 3; j++) {
            bench->rays[i].origin[j] = (float)gn_random_range(&random, -1, 1);
            bench->rays[i].direction[j] = (float)gn_random_range(&random, -1, 1);
        }
    for (int run = 0; run < bench->runs; run++)
        for (int batch = 0; batch < 2; batch++) {
            times[0][batch][run] = take(bench, tracers[0], batch, &hits[0]);
            for (int k = 0; k < bench->kernel_count; k++) {
                gn_ref_certified_force(bench->kernels[k]);
                times[k + 1][batch][run] = take(bench, tracers[1], batch, &hits[1]);
            }
        }
    printf("%-11s %-9s", scene->name, gn_accuracy_aim_name(aim));
    for (int k = 0; k < bench->kernel_count; k++)
        for (int batch = 0; batch < 2; batch++) {
            double ratios[MOST_RUNS];
            for (int run = 0; run < bench->runs; run++)
                ratios[run] = times[0][batch][run] / times[k + 1][batch][run];
            double ratio = median(ratios, bench->runs);
            struct totals *totals = &bench->totals[k];
            totals->log_sum[batch] += log(ratio);
            totals->worst[batch] = totals->count && totals->worst[batch] < ratio ? totals->worst[batch] : ratio;
            totals->count += batch;
            printf("%s %5.2f", batch ? "" : "  ", ratio);
        }
    printf("  | robust %5.2f %5.2f Mray/s", 1e-6 * (double)bench->count / median(times[0][0], bench->runs),
           1e-6 * (double)bench->count / median(times[0][1], bench->runs));
    gn_ref_certified_force(NULL);
    struct gn_ref_effect_watch watch = {.counting = true};
    struct gn_ref_effect_watch *before = gn_ref_effects_watch(&watch);
    gn_ref_tracer_closest_batch(tracers[1], bench->rays, bench->count, bench->records);
    gn_ref_effects_watch(before);
    double n = (double)bench->count;
    const struct gn_ref_effect_counts *c = &watch.counts;
    printf("  | nodes %.1f leaves %.2f triangles %.1f f32 %.1f f64 %.2f sharp %.3f wide %.4f exact %.4f\n", (double)c->nodes / n,
           (double)c->leaves / n, (double)c->triangles / n, (double)c->rejected_f32 / n, (double)c->decided_f64 / n,
           (double)c->decided_sharp / n, (double)c->decided_wide / n, (double)c->decided_exact / n);
    fflush(stdout);
    return fabs((double)hits[0] - (double)hits[1]) <= 0.1 * (double)bench->count;
}

static bool scene_measure(struct bench *bench, const char *name)
{
    struct gn_arena arena = {0};
    struct gn_accuracy_scene scene = {0};
    struct gn_ref_tracer *tracers[2] = {NULL, NULL};
    char error[320];
    bool inside, done = false;
    if (!scene_make(&scene, name, &arena, &inside))
        goto out;
    static const enum gn_ref_tier tiers[2] = {GN_REF_TIER_ROBUST, GN_REF_TIER_CERTIFIED};
    for (int t = 0; t < 2; t++) {
        tracers[t] = gn_ref_tracer_create(scene.reference, tiers[t], error, sizeof error);
        if (!tracers[t]) {
            fprintf(stderr, "%s\n", error);
            goto out;
        }
    }
    struct gn_ref_tracer_cost robust = gn_ref_tracer_cost(tracers[0]), certified = gn_ref_tracer_cost(tracers[1]);
    printf("%s: %llu triangles, robust %.2f s %.1f bytes each, certified %.2f s %.1f bytes (%.2f times)\n", name,
           (unsigned long long)scene.triangles, robust.seconds, (double)robust.bytes / (double)scene.triangles,
           certified.seconds, (double)certified.bytes / (double)scene.triangles,
           (double)certified.bytes / (double)robust.bytes);
    done = true;
    for (int aim = 0; aim < (inside ? 1 : GN_AIM_COUNT); aim++)
        if (!measure(bench, &scene, inside, inside ? GN_AIM_RANDOM : (enum gn_aim)aim, tracers)) {
            fprintf(stderr, "%s: the tiers do not see the same scene\n", name);
            done = false;
        }
out:
    gn_ref_tracer_destroy(tracers[0]);
    gn_ref_tracer_destroy(tracers[1]);
    gn_accuracy_scene_finish(&scene);
    gn_arena_finish(&arena);
    return done;
}

int main(int argc, char **argv)
{
    static const char *const defaults[] = {"terrain", "terrain-2m", "blob", "slivers", "instances", "far", "soup"};
    struct bench bench = {.runs = 5, .count = 100000, .kernel_count = 1, .kernels = {"avx512"}};
    const char *names[64];
    int name_count = 0, status = 0;
    bool all_own = false;
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--rays") == 0 && i + 1 < argc) {
            bench.count = (size_t)strtoul(argv[++i], NULL, 10);
        } else if (strcmp(argv[i], "--runs") == 0 && i + 1 < argc) {
            bench.runs = atoi(argv[++i]);
        } else if (strcmp(argv[i], "--own") == 0) {
            all_own = true;
        } else if (strcmp(argv[i], "--kernels") == 0 && i + 1 < argc) {
            bench.kernel_count = 0;
            for (char *k = strtok(argv[++i], ","); k && bench.kernel_count < MOST_KERNELS; k = strtok(NULL, ","))
                bench.kernels[bench.kernel_count++] = k;
        } else if (argv[i][0] != '-' && name_count < 64) {
            names[name_count++] = argv[i];
        } else {
            bench.runs = 0;
        }
    }
    if (bench.runs < 1 || bench.runs > MOST_RUNS || bench.count < 1000 || bench.count > 10000000) {
        fprintf(stderr, "usage: tracer_speed [--rays 1000..1e7] [--runs 1..%d] [--kernels NAME,NAME] [--own] [SCENE...]\n",
                MOST_RUNS);
        return 2;
    }
    for (int k = 0; k < bench.kernel_count; k++)
        if (!gn_ref_certified_force(bench.kernels[k])) {
            fprintf(stderr, "this machine has no kernel '%s'\n", bench.kernels[k]);
            return 2;
        }
    for (size_t i = 0; all_own && i < OWN; i++)
        names[name_count++] = own[i].name;
    for (size_t i = 0; name_count == 0 && i < sizeof defaults / sizeof defaults[0]; i++)
        names[i] = defaults[i];
    if (name_count == 0)
        name_count = sizeof defaults / sizeof defaults[0];
    bench.rays = malloc(bench.count * sizeof *bench.rays);
    bench.records = malloc(bench.count * sizeof *bench.records);
    if (!bench.rays || !bench.records)
        abort();
    for (int i = 0; i < name_count; i++)
        status |= !scene_measure(&bench, names[i]);
    for (int k = 0; k < bench.kernel_count && bench.totals[k].count; k++) {
        const struct totals *t = &bench.totals[k];
        printf("%-9s single %.2f worst %.2f; batch %.2f worst %.2f\n", bench.kernels[k],
               exp(t->log_sum[0] / t->count), t->worst[0], exp(t->log_sum[1] / t->count), t->worst[1]);
    }
    free(bench.rays);
    free(bench.records);
    return status;
}
