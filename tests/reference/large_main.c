/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reference_large: one height field of as many triangles as asked for; what the tiers keep of it, against Embree's robust mode, and whether
 * every ray down through it hits. Fails when one does not, or when `certified` keeps more than 2.5 times what `robust` does.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>

#include "families.h"
#include "reference/tracer.h"

enum { RAYS = 200000, BATCH = 1000 };
#define MOST_RATIO 2.5

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* From above the field, which lies between z = 0 and 0.1, to below it, away from the border: the surface has no hole there. */
static struct gn_ref_ray ray_down(struct rng *rng)
{
    struct gn_ref_ray ray = {.tmax = 10, .cull_mask = 0xFF};
    for (int i = 0; i < 3; i++) {
        double from = i < 2 ? 1.6 * rng_unit(rng) - 0.8 : 0.5, to = i < 2 ? 1.6 * rng_unit(rng) - 0.8 : -0.5;
        ray.origin[i] = (float)from;
        ray.direction[i] = (float)(to - from);
    }
    return ray;
}

/* How many of the rays a tier loses; bytes and times are printed. */
static bool tier_run(const struct gn_ref_scene *scene, enum gn_ref_tier tier, uint32_t triangles, double *out_bytes,
                     uint32_t *out_lost)
{
    char error[320];
    struct gn_ref_tracer *tracer = gn_ref_tracer_create(scene, tier, error, sizeof error);
    struct gn_ref_ray *rays = malloc(BATCH * sizeof *rays);
    struct gn_ref_record *records = malloc(BATCH * sizeof *records);
    struct rng rng = {7};
    bool done = tracer && rays && records;
    *out_lost = 0;
    if (!done) {
        fprintf(stderr, "%s: %s\n", gn_ref_tier_name(tier), tracer ? "out of memory" : error);
        goto out;
    }
    double traced = 0;
    for (int first = 0; first < RAYS; first += BATCH) {
        for (int i = 0; i < BATCH; i++)
            rays[i] = ray_down(&rng);
        double start = seconds();
        gn_ref_tracer_closest_batch(tracer, rays, BATCH, records);
        traced += seconds() - start;
        for (int i = 0; i < BATCH; i++)
            *out_lost += records[i].outcome != GN_REF_HIT;
    }
    struct gn_ref_tracer_cost cost = gn_ref_tracer_cost(tracer);
    *out_bytes = (double)cost.bytes / triangles;
    printf("%-10s %6.1f bytes per triangle, built in %6.2f s, %.2f Mray/s, %u of %d rays lost\n", gn_ref_tier_name(tier), *out_bytes,
           cost.seconds, RAYS / traced * 1e-6, *out_lost, RAYS);
out:
    gn_ref_tracer_destroy(tracer);
    free(rays);
    free(records);
    return done;
}

int main(int argc, char **argv)
{
    double wanted = argc == 3 && strcmp(argv[1], "--triangles") == 0 ? atof(argv[2]) : argc == 1 ? 200000 : 0;
    if (!(wanted >= 1000 && wanted <= 1e9)) {
        fprintf(stderr, "usage: reference_large [--triangles N]\n  N: 1000 to 1e9; 200000 by default\n");
        return 2;
    }
    uint32_t n = (uint32_t)lround(sqrt(wanted / 2)), triangles = 2 * n * n, blas, lost[2];
    struct rng rng = {1};
    struct made_scene made = {0};
    double bytes[2], ratio;
    int exit_status = 1;
    make_height_field(&made, &rng, n, false);
    struct gn_ref_scene *scene = gn_ref_scene_create();
    if (!scene || !gn_ref_scene_add_blas(scene, made.scene.geometries, 1, &blas) ||
        !gn_ref_scene_add_instance(scene, &made.scene.instances[0]) || !gn_ref_scene_commit(scene)) {
        fprintf(stderr, "%s\n", scene ? gn_ref_scene_error(scene) : "out of memory");
        goto out;
    }
    made_scene_free(&made);
    printf("%u triangles\n", triangles);
    if (!tier_run(scene, GN_REF_TIER_CERTIFIED, triangles, &bytes[0], &lost[0]) ||
        !tier_run(scene, GN_REF_TIER_ROBUST, triangles, &bytes[1], &lost[1]))
        goto out;
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    ratio = bytes[0] / bytes[1];
    printf("certified keeps %.2f times what robust does (%.1f allowed); %.2f GB at most in this process, inputs included\n", ratio,
           MOST_RATIO, (double)usage.ru_maxrss * 1024e-9);
    exit_status = lost[0] > 0 || ratio > MOST_RATIO;
out:
    gn_ref_scene_destroy(scene);
    made_scene_free(&made);
    return exit_status;
}
