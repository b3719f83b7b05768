/* SPDX-License-Identifier: Apache-2.0 */
/* Sweeps over the shape of triangles and the angle at which they are seen: slivers, needles, grazing, edge-on. */
#include <math.h>
#include <string.h>

#include "cts/cases/stability.h"

#define PI 3.14159265358979323846

struct thin {
    bool needle; /* one side is short; otherwise one angle is nearly flat */
    bool level; /* the rays do not move across the thin direction */
};

/* Triangles of length 1/2 along x and tilted in z, thinner in y by the aspect, near y = 0, where f32 is fine. */
static void thin(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    const struct thin *what = request->params;
    struct gn_random *random = request->random;
    struct gn_mesh mesh = gn_stability_triangles(request->arena, 64);
    double width = 0.5 / request->value;
    for (uint32_t i = 0; i < mesh.triangle_count; i++) {
        double(*p)[3] = &mesh.positions[3 * i], slope = gn_random_range(random, -1, 1);
        double x = gn_random_range(random, -1, 0.5), y = gn_random_range(random, -8, 8) * width;
        const double cap[3][2] = {{0, 0}, {0.5, 0}, {0.1 + 0.3 * gn_random_unit(random), width}};
        const double needle[3][2] = {{0, 0}, {0.5, 0}, {0.5, width}};
        for (int c = 0; c < 3; c++) {
            const double *at = what->needle ? needle[c] : cap[c];
            p[c][0] = (float)(x + at[0]);
            p[c][1] = (float)(y + at[1]);
            p[c][2] = (float)(slope * at[0]);
        }
    }
    struct gn_aim_options options = {.both_sides = true, .min_cosine = 0.3};
    gn_stability_mesh(request, &mesh, &options, (struct gn_stability_aims){.interior = 1}, out);
    if (!what->level)
        return;
    for (uint32_t i = 0; i < out->ray_count; i++) {
        struct gn_ref_ray *ray = &out->rays[i].ray;
        const double *a = mesh.positions[3 * gn_random_below(random, mesh.triangle_count)];
        const double weight[2] = {gn_random_range(random, 0.1, 0.4), gn_random_range(random, 0.1, 0.4)};
        const double *b = a + 3, *c = a + 6, turn = gn_random_range(random, 0.4, PI - 0.4), away = 4;
        double target[3], side = gn_random_below(random, 2) ? 1 : -1;
        for (int k = 0; k < 3; k++)
            target[k] = a[k] + weight[0] * (b[k] - a[k]) + weight[1] * (c[k] - a[k]);
        /* Perpendicular to y, and off the triangle's plane, whose slope is at most 1. */
        const double direction[3] = {away * cos(turn) * 0.5, 0, -side * away * sin(turn)};
        const double origin[3] = {target[0] - direction[0], target[1], target[2] - direction[2]};
        out->rays[i] = gn_ray_make(origin, direction, ray->tmax);
    }
}
#define ASPECTS GN_SWEEP_VALUES(1, 10, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12)
#define DROWNS "corners 4 away are known to 24 * 2^-24 * 4 across: a width of ten times that can still be told"
#define LEVEL "nothing rounds across the thin direction, so that it is only another scale"
const struct gn_sweep gn_stability_sliver = {"aspect ratio of flat triangles", "", ASPECTS, 1e4, DROWNS, 1000, thin,
                                             &(const struct thin){false, false}};
const struct gn_sweep gn_stability_sliver_level = {
    "aspect ratio of flat triangles", "", ASPECTS, 1e12, LEVEL, 1000, thin, &(const struct thin){false, true}};
const struct gn_sweep gn_stability_needle = {"aspect ratio of needles", "", ASPECTS, 1e4, DROWNS, 1000, thin,
                                             &(const struct thin){true, false}};
const struct gn_sweep gn_stability_needle_level = {
    "aspect ratio of needles", "", ASPECTS, 1e12, LEVEL, 1000, thin, &(const struct thin){true, true}};

#define ANGLES                                                                                              \
    GN_SWEEP_VALUES(45, 10, 1, 0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)

static void grazing(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    const bool *tilted = request->params;
    struct gn_mesh mesh = gn_mesh_quad(request->arena);
    if (*tilted) {
        float turn[12];
        double affine[12];
        gn_transform_random(request->random, 1, 1, 0.5, false, turn);
        for (int i = 0; i < 12; i++)
            affine[i] = turn[i];
        mesh = gn_mesh_map(request->arena, &mesh, affine);
    }
    double sine = sin(request->value * PI / 180);
    struct gn_aim_options options = {.both_sides = true, .min_cosine = sine, .max_cosine = sine * 1.0001};
    gn_stability_mesh(request, &mesh, &options, (struct gn_stability_aims){.interior = 1}, out);
}
const struct gn_sweep gn_stability_grazing_level = {
    "angle between ray and triangle", "degrees", ANGLES, 1e-7,
    "the plane is z = 0, where f32 is as fine as the angle: it is only another scale", 1000, grazing,
    &(const bool){false}};
const struct gn_sweep gn_stability_grazing_tilted = {
    "angle between ray and triangle", "degrees", ANGLES, 1e-3,
    "heights over the plane are known to 24 * 2^-24 * 4, an angle of 3e-4 degrees over the width of 1", 1000, grazing,
    &(const bool){true}};

/*
 * Rays that lie in the planes of tilted triangles exactly: never a hit. Coordinates are whole numbers, and the
 * direction's largest component is a power of two, so that shear and edge functions are exact in f32 while their
 * digits fit: then the determinant is 0 and nothing excuses a hit.
 */
static void in_plane(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_random *random = request->random;
    uint32_t extent = (uint32_t)request->value;
    struct gn_mesh mesh = gn_stability_triangles(request->arena, 16);
    /* Planes z = x + y and y = x - z and the like: one normal of whole numbers per triangle. */
    for (uint32_t i = 0; i < mesh.triangle_count; i++) {
        double(*p)[3] = &mesh.positions[3 * i], area;
        do {
            for (int c = 0; c < 3; c++) {
                p[c][0] = (double)gn_random_below(random, 2 * extent + 1) - extent;
                p[c][1] = (double)gn_random_below(random, 2 * extent + 1) - extent;
                p[c][2] = (i & 1 ? p[c][0] : -p[c][0]) + (i & 2 ? p[c][1] : 0);
            }
            area = (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]);
        } while (fabs(area) < 0.5 * extent * extent);
    }
    gn_stability_scene(request, &mesh, NULL, NULL, out);
    for (uint32_t i = 0; i < out->ray_count; i++) {
        /* Only that triangle and its kind is met edge-on; the others are ordinary. */
        uint32_t triangle = gn_random_below(random, mesh.triangle_count);
        const double *a = mesh.positions[3 * triangle];
        double direction[3], origin[3], largest;
        do {
            direction[0] = (double)gn_random_below(random, 9) - 4;
            direction[1] = (double)gn_random_below(random, 9) - 4;
            direction[2] = (triangle & 1 ? direction[0] : -direction[0]) + (triangle & 2 ? direction[1] : 0);
            largest = fmax(fabs(direction[0]), fmax(fabs(direction[1]), fabs(direction[2])));
        } while (largest != 1 && largest != 2 && largest != 4);
        double back = ceil(extent / 2.0);
        for (int k = 0; k < 3; k++)
            origin[k] = a[k] - back * direction[k];
        out->rays[i] = gn_ray_make(origin, direction, 1000.0 * extent);
    }
}
const struct gn_sweep gn_stability_in_plane = {
    "extent of the triangles in whole numbers", "",
    GN_SWEEP_VALUES(2, 4, 8, 16, 32, 64, 256, 1024, 4096, 0x1p14, 0x1p16, 0x1p18), 16,
    "products of two coordinates, sheared by a direction of three bits, have to be exact in 24 bits", 1000, in_plane,
    NULL};

/*
 * A roof seen from the side: its ridge is a silhouette, whose two sides face opposite ways as the ray sees them. Every
 * second ray passes above the ridge, the others below it. The roof is turned, so that nothing is exact.
 */
static void silhouette(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    static const double corners[6][3] = {{0, -1, 0}, {0, 1, 0}, {-1, -1, -1}, {-1, 1, -1}, {1, -1, -1}, {1, 1, -1}};
    static const uint32_t sides[4][3] = {{0, 1, 3}, {0, 3, 2}, {1, 0, 4}, {1, 4, 5}};
    struct gn_random *random = request->random;
    struct gn_mesh mesh = {gn_arena_alloc(request->arena, 6, sizeof *mesh.positions), 6,
                           gn_arena_alloc(request->arena, 4, sizeof *mesh.triangles), 4};
    float turn[12];
    gn_transform_random(random, 1, 1, 0.5, false, turn);
    for (int i = 0; i < 6; i++) {
        gn_transform_point(turn, corners[i], mesh.positions[i]);
        for (int k = 0; k < 3; k++)
            mesh.positions[i][k] = (float)mesh.positions[i][k];
    }
    memcpy(mesh.triangles, sides, sizeof sides);
    gn_stability_scene(request, &mesh, NULL, NULL, out);
    for (uint32_t i = 0; i < out->ray_count; i++) {
        const double back = gn_random_below(random, 2) ? 4 : -4, slope = gn_random_range(random, -0.5, 0.5);
        const double beside[3] = {0, gn_random_range(random, -0.5, 0.5), i % 2 ? request->value : -request->value};
        const double from[3] = {back, beside[1] + gn_random_range(random, -0.4, 0.4), beside[2] + slope};
        double target[3], origin[3], direction[3];
        gn_transform_point(turn, beside, target);
        gn_transform_point(turn, from, origin);
        for (int k = 0; k < 3; k++)
            direction[k] = target[k] - (double)(float)origin[k];
        out->rays[i] = gn_ray_make(origin, direction, 40);
    }
}
const struct gn_sweep gn_stability_silhouette = {
    "distance of the ray from the silhouette it passes", "",
    GN_SWEEP_VALUES(0.25, 0x1p-4, 0x1p-8, 0x1p-12, 0x1p-16, 0x1p-18, 0x1p-20, 0x1p-22, 0x1p-24, 0x1p-28), 0x1p-28,
    "whether the ray passes is decided by its margin, however near the edge", 1000, silhouette, NULL};
