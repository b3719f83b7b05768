/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tracer_speed: every tier on a height field of 131,072 triangles. Rays per second, one at a time and in batches, decisions
 * that differ from CERTIFIED's, and what is kept per triangle. Not a test.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "reference/tracer.h"
#include "families.h"

static double cpu_seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static double median(double *values, int count)
{
    for (int i = 1; i < count; i++)
        for (int j = i; j > 0 && values[j] < values[j - 1]; j--) {
            double swap = values[j];
            values[j] = values[j - 1];
            values[j - 1] = swap;
        }
    return values[count / 2];
}

int main(int argc, char **argv)
{
    int count = argc > 1 ? atoi(argv[1]) : 200000, runs = argc > 2 ? atoi(argv[2]) : 3;
    uint32_t side = argc > 3 ? (uint32_t)atoi(argv[3]) : 256;
    if (count < 1 || runs < 1 || runs > 9 || side < 1) {
        fprintf(stderr, "usage: tracer_speed [RAYS per kind [RUNS up to 9 [SIDE of the height field]]]\n");
        return 2;
    }
    struct rng rng = {5};
    struct made_scene made = {0};
    struct family family = {"height field", NULL, 0, 0};
    make_height_field(&made, &rng, side, false);
    uint32_t blas;
    char error[320];
    struct gn_ref_scene *scene = gn_ref_scene_create();
    if (!scene || !gn_ref_scene_add_blas(scene, made.scene.geometries, 1, &blas) ||
        !gn_ref_scene_add_instance(scene, made.scene.instances) || !gn_ref_scene_commit(scene))
        abort();
    struct gn_ref_tracer *tracers[GN_REF_TIER_COUNT];
    for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
        tracers[t] = gn_ref_tracer_create(scene, (enum gn_ref_tier)t, error, sizeof error);
        if (!tracers[t]) {
            fprintf(stderr, "%s\n", error);
            return 1;
        }
        struct gn_ref_tracer_cost cost = gn_ref_tracer_cost(tracers[t]);
        printf("%-9s built in %.3f s, %.1f bytes per triangle\n", gn_ref_tier_name((enum gn_ref_tier)t), cost.seconds,
               (double)cost.bytes / (2.0 * side * side));
    }
    struct gn_ref_ray *rays = malloc((size_t)count * sizeof *rays);
    struct gn_ref_record *right = malloc((size_t)count * sizeof *right), *records = malloc((size_t)count * sizeof *records);
    enum gn_ref_outcome *outcomes = malloc((size_t)count * sizeof *outcomes);
    if (!rays || !right || !records || !outcomes)
        abort();
    for (int aim = 0; aim < AIM_COUNT; aim++) {
        for (int i = 0; i < count; i++)
            rays[i] = made_ray(&made, &family, (enum aim)aim, &rng, NULL);
        gn_ref_tracer_closest_batch(tracers[GN_REF_TIER_CERTIFIED], rays, (size_t)count, right);
        double robust[2] = {1, 1};
        static const enum gn_ref_tier order[] = {GN_REF_TIER_ROBUST, GN_REF_TIER_FAST, GN_REF_TIER_DOUBLE,
                                                 GN_REF_TIER_CERTIFIED, GN_REF_TIER_EXACT};
        for (int k = 0; k < GN_REF_TIER_COUNT; k++) {
            const struct gn_ref_tracer *tracer = tracers[order[k]];
            int n = order[k] == GN_REF_TIER_EXACT ? (count + 99) / 100 : count;
            double times[3][9];
            for (int run = 0; run < runs; run++) {
                double start = cpu_seconds();
                for (int i = 0; i < n; i++)
                    gn_ref_tracer_closest(tracer, &rays[i], &records[i]);
                times[0][run] = (cpu_seconds() - start) / n;
                start = cpu_seconds();
                gn_ref_tracer_closest_batch(tracer, rays, (size_t)n, records);
                times[1][run] = (cpu_seconds() - start) / n;
                start = cpu_seconds();
                gn_ref_tracer_occluded_batch(tracer, rays, (size_t)n, outcomes);
                times[2][run] = (cpu_seconds() - start) / n;
            }
            double single = median(times[0], runs), batch = median(times[1], runs), any = median(times[2], runs);
            if (order[k] == GN_REF_TIER_ROBUST) {
                robust[0] = single;
                robust[1] = batch;
            }
            int lost = 0, gained = 0, other = 0;
            for (int i = 0; i < n; i++) {
                bool hit = records[i].outcome == GN_REF_HIT, ideal = right[i].outcome == GN_REF_HIT;
                lost += ideal && !hit;
                gained += hit && !ideal;
                other += hit && ideal && records[i].hit.primitive != right[i].hit.primitive;
            }
            printf("%-8s %-9s single %7.3f Mray/s (%.2f of robust), batch %7.3f (%.2f), any hit %7.3f; per million: "
                   "lost %.0f, made up %.0f, another triangle %.0f\n", aim_names[aim], gn_ref_tier_name(order[k]),
                   1e-6 / single, robust[0] / single, 1e-6 / batch, robust[1] / batch, 1e-6 / any, 1e6 * lost / n,
                   1e6 * gained / n, 1e6 * other / n);
        }
    }
    for (int t = 0; t < GN_REF_TIER_COUNT; t++)
        gn_ref_tracer_destroy(tracers[t]);
    free(rays);
    free(right);
    free(records);
    free(outcomes);
    gn_ref_scene_destroy(scene);
    made_scene_free(&made);
    return 0;
}
