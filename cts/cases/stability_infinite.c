/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Sweeps towards infinity: a corner of triangles that rays pass by, one of triangles that they meet, and the faces of
 * boxes. The specification gives infinite vertices and faces no meaning, and does not exclude them; what they ought to do here is
 * plain all the same, and how far a driver gets is worth knowing.
 */
#include <math.h>

#include "cts/cases/stability.h"

/* f32 ends before 2^128. */
static double endless(double value)
{
    return value < 0x1p128 ? value : (double)INFINITY;
}

/*
 * Triangles that stretch outwards from a mesh in their middle: two corners at a distance of 6 to 8, the third at the value along
 * the same axis. Rays end before they are as far from the middle as that.
 */
static void beside(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_random *random = request->random;
    struct gn_mesh solid = gn_mesh_height_field(request->arena, random, 8, 0.1), far = gn_stability_triangles(request->arena, 16);
    for (uint32_t i = 0; i < far.triangle_count; i++) {
        uint32_t axis = gn_random_below(random, 2), side = gn_random_below(random, 2);
        for (uint32_t c = 0; c < 3; c++) {
            double *corner = far.positions[3 * i + c];
            for (int k = 0; k < 3; k++)
                corner[k] = (float)gn_random_range(random, -1, 1);
            corner[axis] = c == 2 ? endless(request->value) : (float)gn_random_range(random, 6, 8);
            if (side)
                corner[axis] = -corner[axis];
        }
    }
    struct gn_mesh mesh = gn_mesh_joined(request->arena, &solid, &far);
    struct gn_aim_options options = {.both_sides = true, .min_cosine = 0.7, .triangle_count = solid.triangle_count};
    gn_stability_mesh(request, &mesh, &options, (struct gn_stability_aims){.interior = 4, .edge = 1}, out);
    for (uint32_t i = 0; i < out->ray_count; i++)
        out->rays[i].ray.tmax = 1.5f; /* the target is at 1 */
}
const struct gn_sweep gn_stability_infinite_beside = {
    "far corner of triangles beside the rays (2^128: infinite)", "",
    GN_SWEEP_VALUES(16, 0x1p10, 0x1p20, 0x1p30, 0x1p40, 0x1p50, 0x1p60, 0x1p70, 0x1p80, 0x1p100, 0x1p120, 0x1p127, 0x1p128),
    GN_SWEEP_CUBE, "products of three lengths have to be normal in f32, with 24 bits below them", 1000, beside, NULL};

/* Tilted triangles whose third corner is at that distance, met near the side between the other two. */
static void met(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_random *random = request->random;
    struct gn_mesh mesh = gn_stability_triangles(request->arena, 16);
    for (uint32_t i = 0; i < mesh.triangle_count; i++) {
        double(*p)[3] = &mesh.positions[3 * i], turn = gn_random_range(random, 0, 6.28), slope = gn_random_range(random, -0.5, 0.5);
        const double along[3] = {cos(turn), sin(turn), slope}, across[3] = {-sin(turn), cos(turn), 0};
        for (int k = 0; k < 3; k++) {
            double middle = gn_random_range(random, -1, 1);
            p[0][k] = (float)(middle - across[k] / 2);
            p[1][k] = (float)(middle + across[k] / 2);
            p[2][k] = (float)(middle + request->value * along[k]);
        }
    }
    gn_stability_scene(request, &mesh, NULL, NULL, out);
    for (uint32_t i = 0; i < out->ray_count; i++) {
        const double *a = mesh.positions[3 * gn_random_below(random, mesh.triangle_count)], *b = a + 3, *c = a + 6;
        double share = gn_random_range(random, 0.2, 0.8), weight = gn_random_range(random, 0.25, 1) / (2 * request->value);
        double origin[3], direction[3];
        for (int k = 0; k < 3; k++) {
            double side = k < 2 ? gn_random_range(random, -1, 1) : gn_random_below(random, 2) ? 3 : -3;
            double target = (1 - weight) * (a[k] + share * (b[k] - a[k])) + weight * c[k];
            origin[k] = (float)(target + side);
            direction[k] = target - origin[k];
        }
        out->rays[i] = gn_ray_make(origin, direction, 40);
    }
}
const struct gn_sweep gn_stability_infinite_met = {
    "far corner of triangles that are met near the other two", "",
    GN_SWEEP_VALUES(1, 0x1p5, 0x1p10, 0x1p15, 0x1p20, 0x1p25, 0x1p30, 0x1p35, 0x1p40, 0x1p50, 0x1p60, 0x1p80, 0x1p100, 0x1p120),
    GN_SWEEP_CUBE, "products of three lengths have to be normal in f32, with 24 bits below them", 1000, met, NULL};

/* Slabs and columns: boxes without an end along one or two axes. */
static void boxes(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    enum { BOXES = 8 };
    struct gn_random *random = request->random;
    float(*all)[6] = gn_arena_alloc(request->arena, BOXES, sizeof *all);
    for (uint32_t i = 0; i < BOXES; i++)
        for (uint32_t k = 0; k < 3; k++) {
            bool open = k == i % 3 || (i >= 4 && k == (i + 1) % 3);
            double middle = open ? 0 : gn_random_range(random, -8, 8);
            double half = open ? endless(request->value) : gn_random_range(random, 0.25, 1);
            all[i][k] = (float)(middle - half);
            all[i][k + 3] = (float)(middle + half);
        }
    struct gn_cts_geometry geometry = {.type = GN_REF_AABBS, .aabbs = (const float(*)[6])all, .aabb_count = BOXES};
    out->scene = gn_scene_of_geometry(request->arena, &geometry);
    out->program = GN_CTS_CANDIDATES;
    out->ray_count = request->ray_count;
    out->rays = GN_NEW(request->arena, struct gn_cts_ray, request->ray_count);
    for (uint32_t i = 0; i < out->ray_count; i++) {
        double origin[3], direction[3];
        for (int k = 0; k < 3; k++) {
            direction[k] = gn_random_range(random, 0.3, 1) * (gn_random_below(random, 2) ? 1 : -1);
            origin[k] = gn_random_range(random, -8, 8);
        }
        out->rays[i] = gn_ray_make(origin, direction, 20);
    }
}
const struct gn_sweep gn_stability_infinite_box = {
    "half width of slabs and columns (2^128: infinite)", "",
    GN_SWEEP_VALUES(16, 0x1p10, 0x1p20, 0x1p30, 0x1p40, 0x1p50, 0x1p60, 0x1p64, 0x1p70, 0x1p80, 0x1p100, 0x1p120, 0x1p127, 0x1p128),
    GN_SWEEP_SQUARE, "the area of a face, by which a tree is chosen, has to be finite in f32", 1000, boxes, NULL};
