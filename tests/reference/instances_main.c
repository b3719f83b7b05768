/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reference_instances: as many instances as asked for, each of one triangle, in a grid; what they cost, and whether
 * rays at a sample of them meet the right one. The API's largest instance id that a custom index can hold is 2^24 - 1.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>

#include "families.h"
#include "reference/tracer.h"

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static double resident(void)
{
    unsigned long long size = 0, pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    if (file && fscanf(file, "%llu %llu", &size, &pages) != 2)
        pages = 0;
    if (file)
        fclose(file);
    return (double)pages * 4096;
}

/* Side by side, four apart: every coordinate is exact. */
static void place(uint32_t i, uint32_t side, float out[3])
{
    out[0] = 4.0f * (float)(i % side);
    out[1] = 4.0f * (float)(i / side);
    out[2] = (float)(i % 5);
}

int main(int argc, char **argv)
{
    static const double positions[3][3] = {{-1, -1, 0}, {1, -1, 0}, {0, 1, 1}};
    static const uint32_t triangles[1][3] = {{0, 1, 2}};
    const struct gn_ref_geometry geometry = {.type = GN_REF_TRIANGLES, .primitive_count = 1, .positions = positions,
                                             .position_count = 3, .divisor = 1, .triangles = triangles};
    uint32_t count = 4096, blas = 0, wrong = 0, side = 1;
    if (argc == 3 && strcmp(argv[1], "--count") == 0)
        count = (uint32_t)strtoul(argv[2], NULL, 0);
    if ((argc != 1 && argc != 3) || !count) {
        fprintf(stderr, "usage: reference_instances [--count N]\n");
        return 2;
    }
    while ((uint64_t)side * side < count)
        side *= 2;
    struct gn_ref_scene *scene = gn_ref_scene_create();
    struct gn_ref_tracer *tracer = NULL;
    int exit_status = 1;
    if (!scene || !gn_ref_scene_add_blas(scene, &geometry, 1, &blas))
        goto done;
    double start = seconds();
    for (uint32_t i = 0; i < count; i++) {
        struct gn_ref_instance instance = {
            .transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, .custom_index = i & 0xFFFFFF, .mask = 0xFF, .blas = blas};
        float at[3];
        place(i, side, at);
        for (int c = 0; c < 3; c++)
            instance.transform[4 * c + 3] = at[c];
        if (!gn_ref_scene_add_instance(scene, &instance))
            goto done;
    }
    double added = seconds(), bytes = resident();
    if (!gn_ref_scene_commit(scene))
        goto done;
    double committed = seconds();
    tracer = gn_ref_tracer_create(scene, GN_REF_TIER_CERTIFIED, NULL, 0);
    if (!tracer)
        goto done;
    struct gn_ref_tracer_cost cost = gn_ref_tracer_cost(tracer);
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    printf("%u instances: added in %.2f s (%.2f GB), committed in %.2f s, %.2f GB to trace (%.0f bytes each), %.2f GB at most\n",
           count, added - start, bytes * 1e-9, committed - added, (double)cost.bytes * 1e-9,
           (double)cost.bytes / (double)count, (double)usage.ru_maxrss * 1024e-9);
    struct rng rng = {1};
    enum { RAYS = 200000 };
    start = seconds();
    for (uint32_t r = 0; r < RAYS; r++) {
        uint32_t i = r == 0 ? count - 1 : rng_below(&rng, count);
        float at[3];
        place(i, side, at);
        bool beside = r % 4 == 3; /* between two of them */
        struct gn_ref_ray ray = {{at[0] + (beside ? 2.0f : 0.0f), at[1], 16}, 0, {0, 0, -1}, 1000, 0, 0xFF};
        struct gn_ref_record record;
        enum gn_ref_outcome outcome = gn_ref_tracer_closest(tracer, &ray, &record);
        if (beside ? outcome != GN_REF_MISS
                   : outcome != GN_REF_HIT || record.hit.instance != i || record.custom_index != (i & 0xFFFFFF) ||
                         record.hit.t != 16 - (double)at[2] - 0.5)
            wrong++;
    }
    printf("%d rays in %.2f s, %u wrong\n", RAYS, seconds() - start, wrong);
    exit_status = wrong ? 1 : 0;
done:
    if (exit_status && !wrong)
        fprintf(stderr, "%s\n", scene ? gn_ref_scene_error(scene) : "out of memory");
    gn_ref_tracer_destroy(tracer);
    gn_ref_scene_destroy(scene);
    return exit_status;
}
