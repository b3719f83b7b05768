/* SPDX-License-Identifier: Apache-2.0 */
/* reference_speed: rays per second and core, and which stage decided, for the kinds of aim. Not a test. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "families.h"

static double cpu_seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void measure(const char *name, uint32_t n, bool lattice, int count)
{
    struct rng rng = {5};
    struct made_scene made = {0};
    struct family family = {name, NULL, 0, lattice ? RAYS_EXACT : 0};
    make_height_field(&made, &rng, n, lattice);
    struct gn_ref_scene *scene = gn_ref_scene_create();
    struct gn_ref_ray *rays = malloc((size_t)count * sizeof *rays);
    struct gn_ref_hit hits[64];
    uint32_t blas;
    double start = cpu_seconds();
    if (!rays || !scene || !gn_ref_scene_add_blas(scene, made.scene.geometries, 1, &blas) ||
        !gn_ref_scene_add_instance(scene, made.scene.instances) || !gn_ref_scene_commit(scene))
        abort();
    printf("%s, %u triangles: placed and built in %.3f s\n", name, 2 * n * n, cpu_seconds() - start);
    for (int aim = 0; aim < AIM_COUNT; aim++) {
        for (int i = 0; i < count; i++)
            rays[i] = made_ray(&made, &family, (enum aim)aim, &rng, NULL);
        for (int all = 0; all < 2; all++) {
            struct gn_ref_trace_counters before = gn_ref_trace_counters();
            int64_t hit = 0;
            start = cpu_seconds();
            for (int i = 0; i < count; i++)
                hit += all ? gn_ref_trace_all_exact(scene, &rays[i], hits, 64) > 0
                           : gn_ref_trace_closest_triangle_exact(scene, &rays[i], hits);
            double time = cpu_seconds() - start;
            struct gn_ref_trace_counters after = gn_ref_trace_counters();
            double filtered = (double)(after.filtered - before.filtered), wide = (double)(after.wide - before.wide);
            double exact = (double)(after.exact - before.exact), sum = filtered + wide + exact;
            printf("  %-8s %-7s %6.3f Mray/s, %5.1f %% hit, decisions per ray %5.1f: filter %8.4f %%, wide %8.4f %%, "
                   "GMP %8.5f %%\n", aim_names[aim], all ? "all" : "closest", count / time * 1e-6,
                   100.0 * (double)hit / count, sum / count, 100 * filtered / sum, 100 * wide / sum, 100 * exact / sum);
        }
    }
    free(rays);
    gn_ref_scene_destroy(scene);
    made_scene_free(&made);
}

int main(int argc, char **argv)
{
    int count = argc > 1 ? atoi(argv[1]) : 200000;
    if (count < 1) {
        fprintf(stderr, "usage: reference_speed [RAYS per row]\n");
        return 2;
    }
    measure("height field", 256, false, count);
    measure("height field", 32, false, count);
    measure("lattice", 32, true, count);
    return 0;
}
