/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reference_speed: the closest hit, one ray at a time and in batches, against rtcIntersect1 in Embree's robust mode on
 * the same rays in the same run, turn about; medians of CPU time of one thread. Not a test.
 */
#include <embree4/rtcore.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "families.h"
#include "reference/scene_internal.h"

#define REPEATS 5

static double cpu_seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static int compare_numbers(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *values)
{
    qsort(values, REPEATS, sizeof *values, compare_numbers);
    return values[REPEATS / 2];
}

enum shape { SHAPE_FIELD, SHAPE_LATTICE, SHAPE_FAMILY, SHAPE_OFFSET, SHAPE_GRID };

struct subject {
    const char *name;
    enum shape shape;
    const char *family;
    uint32_t size; /* the side of a field, or triangles */
    unsigned options; /* of the rays */
};

static const struct subject subjects[] = {
    {"height field 8k", SHAPE_FIELD, NULL, 64, 0},
    {"height field 131k", SHAPE_FIELD, NULL, 256, 0},
    {"height field 2M", SHAPE_FIELD, NULL, 1024, 0},
    {"soup 131k", SHAPE_FAMILY, "soup, degenerate", 131072, 0},
    {"closed 20k", SHAPE_FAMILY, "closed", 20000, 0},
    {"closed 500k", SHAPE_FAMILY, "closed", 500000, 0},
    {"slivers 2k", SHAPE_FAMILY, "slivers", 2000, 0},
    {"mixed scales 2k", SHAPE_FAMILY, "mixed scales", 2000, 0},
    {"offset 1e5", SHAPE_OFFSET, NULL, 64, 0},
    {"integer lattice 2k", SHAPE_LATTICE, NULL, 32, RAYS_EXACT},
    {"integer lattice 131k", SHAPE_LATTICE, NULL, 256, RAYS_EXACT},
    {"instanced grid", SHAPE_GRID, NULL, 32, 0},
};

static void subject_make(const struct subject *subject, struct made_scene *made, struct rng *rng)
{
    switch (subject->shape) {
    case SHAPE_FAMILY:
        for (uint32_t f = 0; f < family_count; f++)
            if (strcmp(families[f].name, subject->family) == 0)
                families[f].make(made, rng, subject->size);
        break;
    case SHAPE_OFFSET: {
        make_height_field(made, rng, subject->size, false);
        double (*p)[3] = (double (*)[3])made->scene.geometries[0].positions;
        for (uint32_t i = 0; i < made->scene.geometries[0].position_count; i++)
            for (int j = 0; j < 3; j++)
                p[i][j] = (float)(p[i][j] * 100 + 1e5);
        made->extent = 100;
        break;
    }
    case SHAPE_GRID:
        make_height_field(made, rng, subject->size, false);
        made->scene.instance_count = 16;
        for (uint32_t i = 0; i < 16; i++) {
            double angle = 6.28 * rng_unit(rng), c = cos(angle), s = sin(angle);
            float m[12] = {(float)c, (float)-s, 0, (float)(2.5 * (i % 4)), (float)s, (float)c, 0.1f,
                           (float)(2.5 * (double)(i / 4)), 0, 0.2f, 1, (float)rng_unit(rng)};
            made->scene.instances[i] = made->scene.instances[0];
            memcpy(made->scene.instances[i].transform, m, sizeof m);
        }
        made->extent = 5;
        break;
    default:
        make_height_field(made, rng, subject->size, subject->shape == SHAPE_LATTICE);
    }
}

static RTCScene embree_mesh(RTCDevice device, const struct gn_ref_geometry *geometry)
{
    RTCScene scene = rtcNewScene(device);
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_MEDIUM);
    RTCGeometry mesh = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    float *v = rtcSetNewGeometryBuffer(mesh, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, geometry->position_count);
    uint32_t *t = rtcSetNewGeometryBuffer(mesh, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, geometry->primitive_count);
    if (!v || !t)
        abort();
    for (uint32_t i = 0; i < geometry->position_count; i++)
        for (int j = 0; j < 3; j++)
            v[3 * i + (uint32_t)j] = (float)geometry->positions[i][j];
    memcpy(t, geometry->triangles, geometry->primitive_count * sizeof(uint32_t[3]));
    rtcCommitGeometry(mesh);
    rtcAttachGeometry(scene, mesh);
    rtcReleaseGeometry(mesh);
    rtcCommitScene(scene);
    return scene;
}

static int64_t embree_bytes;

static bool embree_memory(void *user, ssize_t bytes, bool post)
{
    (void)user, (void)post;
    embree_bytes += bytes;
    return true;
}

static RTCScene embree_scene(RTCDevice device, const struct made_scene *made, RTCScene *out_mesh)
{
    *out_mesh = embree_mesh(device, &made->scene.geometries[0]);
    if (made->scene.instance_count == 1)
        return *out_mesh;
    RTCScene scene = rtcNewScene(device);
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    for (uint32_t i = 0; i < made->scene.instance_count; i++) {
        RTCGeometry instance = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_INSTANCE);
        rtcSetGeometryInstancedScene(instance, *out_mesh);
        rtcSetGeometryTransform(instance, 0, RTC_FORMAT_FLOAT3X4_ROW_MAJOR, made->scene.instances[i].transform);
        rtcCommitGeometry(instance);
        rtcAttachGeometry(scene, instance);
        rtcReleaseGeometry(instance);
    }
    rtcCommitScene(scene);
    return scene;
}

struct totals {
    double log_single, log_batch, worst;
    int rows;
};

static void measure(const struct subject *subject, int count, struct totals *totals, FILE *json)
{
    struct rng rng = {5};
    struct made_scene made = {0};
    struct family family = {subject->name, NULL, 0, subject->options};
    subject_make(subject, &made, &rng);
    struct gn_ref_scene *scene = gn_ref_scene_create();
    struct gn_ref_ray *rays = malloc((size_t)count * sizeof *rays);
    struct gn_ref_hit *hits = malloc((size_t)count * sizeof *hits);
    int8_t *found = malloc((size_t)count);
    uint32_t blas;
    double start = cpu_seconds();
    if (!rays || !hits || !found || !scene || !gn_ref_scene_add_blas(scene, made.scene.geometries, 1, &blas))
        abort();
    for (uint32_t i = 0; i < made.scene.instance_count; i++)
        if (!gn_ref_scene_add_instance(scene, &made.scene.instances[i]))
            abort();
    if (!gn_ref_scene_commit(scene))
        abort();
    double built = cpu_seconds() - start;
    embree_bytes = 0;
    RTCDevice device = rtcNewDevice("threads=1");
    rtcSetDeviceMemoryMonitorFunction(device, embree_memory, NULL);
    RTCScene mesh, embree = embree_scene(device, &made, &mesh);
    uint64_t bytes = scene->bytes;
    double triangles = (double)scene->triangle_count;
    printf("%s, %.0f triangles in %.2f s; bytes per triangle %.1f, Embree %.1f\n", subject->name, triangles, built,
           (double)bytes / triangles, (double)embree_bytes / triangles);
    for (int aim = 0; aim < AIM_COUNT; aim++) {
        for (int i = 0; i < count; i++)
            rays[i] = made_ray(&made, &family, (enum aim)aim, &rng, NULL);
        double times[3][REPEATS];
        int64_t hit[3] = {0};
        struct gn_ref_trace_counters before = gn_ref_trace_counters();
        for (int r = 0; r < REPEATS; r++) {
            hit[0] = hit[1] = hit[2] = 0;
            start = cpu_seconds();
            for (int i = 0; i < count; i++) {
                struct RTCRayHit query = {
                    .ray = {.org_x = rays[i].origin[0], .org_y = rays[i].origin[1], .org_z = rays[i].origin[2],
                            .dir_x = rays[i].direction[0], .dir_y = rays[i].direction[1], .dir_z = rays[i].direction[2],
                            .tnear = rays[i].tmin, .tfar = rays[i].tmax, .mask = 0xFFFFFFFF},
                    .hit = {.geomID = RTC_INVALID_GEOMETRY_ID, .instID = {RTC_INVALID_GEOMETRY_ID}},
                };
                rtcIntersect1(embree, &query, NULL);
                hit[0] += query.hit.geomID != RTC_INVALID_GEOMETRY_ID;
            }
            times[0][r] = cpu_seconds() - start;
            start = cpu_seconds();
            for (int i = 0; i < count; i++)
                hit[1] += gn_ref_trace_closest_triangle_exact(scene, &rays[i], &hits[0]);
            times[1][r] = cpu_seconds() - start;
            start = cpu_seconds();
            gn_ref_trace_closest_triangles_exact(scene, rays, (size_t)count, hits, found);
            for (int i = 0; i < count; i++)
                hit[2] += found[i];
            times[2][r] = cpu_seconds() - start;
        }
        struct gn_ref_trace_counters after = gn_ref_trace_counters();
        double filtered = (double)(after.filtered - before.filtered), wide = (double)(after.wide - before.wide);
        double exact = (double)(after.exact - before.exact), sum = filtered + wide + exact;
        double base = median(times[0]), single = base / median(times[1]), batch = base / median(times[2]);
        printf("  %-8s Embree %6.3f Mray/s; single %5.2f, batch %5.2f of that; hit %6.2f %% (Embree misses %lld of %lld); "
               "wide %.4f %%, GMP %.5f %%%s\n",
               aim_names[aim], count / base * 1e-6, single, batch, 100.0 * (double)hit[1] / count,
               (long long)(hit[1] - hit[0]), (long long)hit[1], 100 * wide / sum, 100 * exact / sum,
               hit[1] == hit[2] ? "" : "; SINGLE AND BATCH DIFFER");
        fflush(stdout);
        if (json)
            fprintf(json,
                    "%s  {\"scene\": \"%s\", \"rays\": \"%s\", \"embree_mrays\": %.4f, \"single\": %.4f, \"batch\": %.4f, "
                    "\"wide\": %.3g, \"gmp\": %.3g, \"bytes\": %.1f, \"embree_bytes\": %.1f}",
                    totals->rows ? ",\n" : "", subject->name, aim_names[aim], count / base * 1e-6, single, batch,
                    wide / sum, exact / sum, (double)bytes / triangles, (double)embree_bytes / triangles);
        totals->log_single += log(single);
        totals->log_batch += log(batch);
        totals->worst = fmin(totals->worst, fmin(single, batch));
        totals->rows++;
    }
    if (embree != mesh)
        rtcReleaseScene(embree);
    rtcReleaseScene(mesh);
    rtcReleaseDevice(device);
    free(rays);
    free(hits);
    free(found);
    gn_ref_scene_destroy(scene);
    made_scene_free(&made);
}

int main(int argc, char **argv)
{
    int count = 100000;
    const char *only = NULL, *path = NULL;
    for (int i = 1; i < argc; i += 2) {
        const char *value = i + 1 < argc ? argv[i + 1] : NULL;
        if (value && strcmp(argv[i], "--rays") == 0)
            count = atoi(value);
        else if (value && strcmp(argv[i], "--scene") == 0)
            only = value;
        else if (value && strcmp(argv[i], "--json") == 0)
            path = value;
        else
            count = 0;
    }
    if (count < 1) {
        fprintf(stderr, "usage: reference_speed [--rays N per row] [--scene PART OF A NAME] [--json FILE]\n"
                        "GNOMON_REFERENCE_KERNEL=avx512, avx2 or portable chooses the kernel.\n");
        return 2;
    }
    FILE *json = path ? fopen(path, "w") : NULL;
    if (path && !json) {
        fprintf(stderr, "%s cannot be written\n", path);
        return 2;
    }
    struct totals totals = {.worst = INFINITY};
    if (json)
        fprintf(json, "[\n");
    for (size_t i = 0; i < sizeof subjects / sizeof subjects[0]; i++)
        if (!only || strstr(subjects[i].name, only))
            measure(&subjects[i], count, &totals, json);
    if (json) {
        fprintf(json, "\n]\n");
        fclose(json);
    }
    if (totals.rows == 0) {
        fprintf(stderr, "no scene's name has \"%s\" in it\n", only);
        return 2;
    }
    printf("geometric means over %d rows: single %.3f, batch %.3f; worst %.3f\n", totals.rows,
           exp(totals.log_single / totals.rows), exp(totals.log_batch / totals.rows), totals.worst);
    return 0;
}
