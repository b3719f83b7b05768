/* SPDX-License-Identifier: Apache-2.0 */
/* Sweeps over where a mesh lies, how large it is, how many triangles share a place. */
#include <math.h>
#include <string.h>

#include "cts/cases/stability.h"

static struct gn_mesh field(const struct gn_sweep_request *request)
{
    return gn_mesh_height_field(request->arena, request->random, 8, 0.1);
}

static struct gn_mesh blob(const struct gn_sweep_request *request)
{
    return gn_mesh_blob(request->arena, request->random, 6, 8, 0.2);
}

static void far_vertices(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    double by = request->value;
    struct gn_mesh mesh = field(request);
    mesh = gn_mesh_scaled(request->arena, &mesh, 1, 1, 1, by, -0.75 * by, 0.5 * by);
    struct gn_aim_options options = {.both_sides = true};
    gn_stability_mesh(request, &mesh, &options, (struct gn_stability_aims){.interior = 4, .edge = 1}, out);
}
const struct gn_sweep gn_stability_far_vertices = {
    "distance of the triangles from the origin", "", GN_SWEEP_DECADES, 1e6,
    "the triangles are 1/4 wide: beyond, the vertices' own rounding is as large, and nothing is left to decide", 1000,
    far_vertices, NULL};

static void far_viewer(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    const struct gn_stability_aims *aims = request->params;
    struct gn_mesh mesh = blob(request);
    struct gn_aim_options options = {.distance = request->value};
    gn_stability_mesh(request, &mesh, &options, *aims, out);
}
#define NOTHING_LEFT "beyond, the rounding of the ray's origin exceeds the triangles, and nothing is left to decide"
const struct gn_sweep gn_stability_far_viewer = {
    "distance of the rays' origins", "", GN_SWEEP_VALUES(2, 10, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9), 1e6,
    NOTHING_LEFT, 1000, far_viewer, &(const struct gn_stability_aims){.interior = 1}};
const struct gn_sweep gn_stability_far_edge_rays = {
    "distance of the rays' origins", "", GN_SWEEP_VALUES(2, 5, 10, 1e2, 1e3, 1e4, 1e5, 1e6), 1e6, NOTHING_LEFT, 1000,
    far_viewer, &(const struct gn_stability_aims){.edge = 1}};
const struct gn_sweep gn_stability_far_vertex_rays = {
    "distance of the rays' origins", "", GN_SWEEP_VALUES(2, 5, 10, 1e2, 1e3, 1e4, 1e5, 1e6), 1e6, NOTHING_LEFT, 1000,
    far_viewer, &(const struct gn_stability_aims){.vertex = 1}};

static void scale(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    double by = request->value;
    struct gn_mesh mesh = blob(request);
    mesh = gn_mesh_scaled(request->arena, &mesh, by, by, by, 0, 0, 0);
    struct gn_aim_options options = {.distance = 4 * by};
    gn_stability_mesh(request, &mesh, &options, (struct gn_stability_aims){.interior = 4, .edge = 1}, out);
}
#define CUBES "products of three lengths have to be normal in f32, with 24 bits below them"
const struct gn_sweep gn_stability_scale_large = {
    "size of the scene", "",
    GN_SWEEP_VALUES(1, 0x1p5, 0x1p10, 0x1p15, 0x1p20, 0x1p25, 0x1p30, 0x1p35, 0x1p40, 0x1p45, 0x1p50, 0x1p60,
                    0x1p80, 0x1p100),
    GN_SWEEP_CUBE, CUBES, 1000, scale, NULL};
const struct gn_sweep gn_stability_scale_small = {
    "size of the scene", "",
    GN_SWEEP_VALUES(1, 0x1p-5, 0x1p-10, 0x1p-15, 0x1p-20, 0x1p-25, 0x1p-30, 0x1p-35, 0x1p-40, 0x1p-45, 0x1p-50,
                    0x1p-60, 0x1p-80, 0x1p-100),
    1 / GN_SWEEP_CUBE, CUBES, 1000, scale, NULL};

/* Meshes side by side, from the smallest to the largest, which is `value` times as large. */
static void mixed_scales(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    enum { SHELLS = 5 };
    struct gn_mesh mesh = {0}, shells[SHELLS];
    double step = log2(request->value) / (SHELLS - 1);
    for (int s = 0; s < SHELLS; s++) {
        double by = exp2(round(step * (s - (SHELLS - 1) / 2)));
        struct gn_mesh one = blob(request);
        /* Off the origin by their size: rays meet the small ones without the large in between. */
        shells[s] = gn_mesh_scaled(request->arena, &one, by, by, by, 2 * by, 0, 0);
        mesh = s ? gn_mesh_joined(request->arena, &mesh, &shells[s]) : shells[s];
    }
    gn_stability_scene(request, &mesh, NULL, NULL, out);
    for (uint32_t i = 0; i < out->ray_count; i++) {
        int s = (int)(i % SHELLS);
        double by = exp2(round(step * (s - (SHELLS - 1) / 2)));
        gn_rays_aimed(request->random, &shells[s], NULL, NULL, GN_AIM_INTERIOR, by / 2, false, &out->rays[i], 1);
    }
}
const struct gn_sweep gn_stability_mixed_scales = {
    "largest mesh over smallest", "",
    GN_SWEEP_VALUES(1, 0x1p4, 0x1p8, 0x1p16, 0x1p24, 0x1p32, 0x1p40, 0x1p48, 0x1p56, 0x1p60, 0x1p72, 0x1p88, 0x1p100),
    GN_SWEEP_CUBE *GN_SWEEP_CUBE, CUBES, 1000, mixed_scales, NULL};

static void fan_spokes(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_mesh mesh = gn_mesh_fan(request->arena, request->random, (uint32_t)request->value, 0.125);
    gn_stability_scene(request, &mesh, NULL, NULL, out);
    for (uint32_t i = 0; i < out->ray_count; i++)
        gn_ray_lattice_at(request->random, &mesh, 0, &out->rays[i]);
}
const struct gn_sweep gn_stability_fan_spokes = {
    "triangles around the vertex", "", GN_SWEEP_VALUES(3, 4, 6, 8, 12, 16, 24, 32, 64, 128, 256), 256,
    "the number of triangles has no part in the derivation", 600, fan_spokes, NULL};

static void fan_spike(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_mesh mesh = gn_mesh_fan(request->arena, request->random, 8, request->value);
    struct gn_aim_options options = {.distance = 4};
    gn_stability_mesh(request, &mesh, &options, (struct gn_stability_aims){.interior = 1, .vertex = 1}, out);
}
const struct gn_sweep gn_stability_fan_spike = {
    "height of the spike over its radius", "",
    GN_SWEEP_VALUES(0.0625, 0.25, 1, 4, 16, 64, 256, 1024, 0x1p12, 0x1p14, 0x1p16, 0x1p18, 0x1p20), 256,
    "a rim of width 1/2 at a height h is known to about 24 * 2^-24 h per side; 2^-4 of the width is let pass", 1000,
    fan_spike, NULL};

static void cells(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    uint32_t n = (uint32_t)lround(sqrt(request->value / 2));
    struct gn_mesh mesh = request->value < 2
                              ? gn_mesh_triangle(request->arena)
                              : gn_mesh_height_field(request->arena, request->random, n, 0.2 / n);
    struct gn_aim_options options = {0};
    gn_stability_mesh(request, &mesh, &options, (struct gn_stability_aims){.interior = 1, .edge = 1}, out);
}
const struct gn_sweep gn_stability_cells = {
    "triangles", "", GN_SWEEP_VALUES(1, 2, 8, 32, 128, 512, 2048, 8192, 32768, 131072), 131072,
    "the number of triangles has no part in the derivation", 1000, cells, NULL};

/* A coarse and a fine mesh that meet along y = 0: every second ray at the seam, where it may pass. */
static void t_junctions(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_mesh mesh = gn_mesh_t_junctions(request->arena, request->random, (uint32_t)request->value, 0.05, true);
    struct gn_aim_options options = {0};
    gn_stability_mesh(request, &mesh, &options, (struct gn_stability_aims){.interior = 1, .edge = 1}, out);
    for (uint32_t i = 0; i < out->ray_count; i += 2) {
        double target[3], other[3];
        uint32_t corner[2];
        do {
            const uint32_t *t = mesh.triangles[gn_random_below(request->random, mesh.triangle_count)];
            uint32_t k = gn_random_below(request->random, 3);
            corner[0] = t[k];
            corner[1] = t[(k + 1) % 3];
        } while (mesh.positions[corner[0]][1] != 0 || mesh.positions[corner[1]][1] != 0);
        double weight = gn_random_unit(request->random);
        for (int k = 0; k < 3; k++)
            target[k] = mesh.positions[corner[0]][k] +
                        weight * (mesh.positions[corner[1]][k] - mesh.positions[corner[0]][k]);
        const double x = gn_random_range(request->random, -2, 2), y = gn_random_range(request->random, -2, 2);
        const double direction[3] = {x, y, -4};
        for (int k = 0; k < 3; k++)
            other[k] = target[k] - direction[k];
        out->rays[i] = gn_ray_make(other, direction, 40);
    }
}
const struct gn_sweep gn_stability_t_junctions = {
    "cells along the seam", "", GN_SWEEP_VALUES(2, 4, 8, 16, 32, 64, 128), 128,
    "the number of triangles has no part in the derivation", 1000, t_junctions, NULL};

static void coincident(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_mesh one = gn_mesh_blob(request->arena, request->random, 3, 6, 0.1), all = one;
    for (uint32_t copy = 1; copy < (uint32_t)request->value; copy++)
        all = gn_mesh_joined(request->arena, &all, &one);
    struct gn_aim_options options = {0};
    gn_stability_mesh(request, &all, &options, (struct gn_stability_aims){.interior = 1}, out);
}
const struct gn_sweep gn_stability_coincident = {
    "copies of every triangle", "", GN_SWEEP_VALUES(1, 2, 3, 4, 8, 16, 32, 64, 128), 128,
    "equal triangles are equally near: any of them is right, however many there are", 500, coincident, NULL};

/* Triangles of a tilted plane, on a lattice on which they are coplanar exactly. */
static void coplanar(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_mesh mesh = gn_stability_triangles(request->arena, (uint32_t)request->value);
    for (uint32_t i = 0; i < mesh.triangle_count; i++) {
        double area, (*p)[3] = &mesh.positions[3 * i];
        do {
            for (int c = 0; c < 3; c++) {
                for (int k = 0; k < 2; k++)
                    p[c][k] = ((double)gn_random_below(request->random, 129) - 64) / 64;
                p[c][2] = p[c][0] / 2 + p[c][1] / 4;
            }
            area = (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]);
        } while (fabs(area) < 0.25);
    }
    struct gn_aim_options options = {.both_sides = true};
    gn_stability_mesh(request, &mesh, &options, (struct gn_stability_aims){.interior = 1}, out);
}
const struct gn_sweep gn_stability_coplanar = {
    "overlapping triangles of one plane", "", GN_SWEEP_VALUES(1, 2, 4, 8, 16, 32, 64, 128, 256), 256,
    "triangles of one plane are equally near: any that is met is right, however many there are", 200, coplanar, NULL};

static void layers(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_mesh one = field(request), mesh = gn_mesh_scaled(request->arena, &one, 1, 1, 1, 0, 0, 0.75);
    for (int layer = 1; layer < 4; layer++) {
        struct gn_mesh below = gn_mesh_scaled(request->arena, &one, 1, 1, 1, 0, 0, 0.75 - layer * request->value);
        mesh = gn_mesh_joined(request->arena, &mesh, &below);
    }
    struct gn_aim_options options = {.both_sides = true};
    gn_stability_mesh(request, &mesh, &options, (struct gn_stability_aims){.interior = 1}, out);
}
const struct gn_sweep gn_stability_layers = {
    "gap between surfaces", "",
    GN_SWEEP_VALUES(0.25, 0x1p-4, 0x1p-6, 0x1p-8, 0x1p-10, 0x1p-12, 0x1p-14, 0x1p-16, 0x1p-18, 0x1p-20, 0x1p-22,
                    0x1p-24, 0x1p-28),
    0x1p-28, "which of two is nearer is decided by its margin, whatever the gap", 1000, layers, NULL};

/*
 * Among the triangles of a mesh there are ones without area: an index repeated, a position repeated, or corners on
 * a line along an axis, for which every f32 evaluation is monotonic and so cannot take them for anything else.
 */
static void degenerate(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_random *random = request->random;
    uint32_t count = (uint32_t)request->value;
    struct gn_mesh solid = field(request), bad = gn_stability_triangles(request->arena, count);
    for (uint32_t i = 0; i < count; i++) {
        double(*p)[3] = &bad.positions[3 * i];
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++)
                p[c][k] = (float)gn_random_range(random, -1, 1);
        switch (gn_random_below(random, 4)) {
        case 0:
            bad.triangles[i][2] = bad.triangles[i][1];
            break;
        case 1:
            memcpy(p[2], p[0], sizeof p[2]);
            break;
        case 2:
            memcpy(p[1], p[0], sizeof p[1]);
            memcpy(p[2], p[0], sizeof p[2]);
            break;
        default: {
            uint32_t axis = gn_random_below(random, 3);
            for (uint32_t k = 0; k < 3; k++)
                if (k != axis)
                    p[1][k] = p[2][k] = p[0][k];
        }
        }
    }
    struct gn_mesh mesh = gn_mesh_joined(request->arena, &solid, &bad);
    struct gn_aim_options options = {.both_sides = true, .triangle_count = solid.triangle_count};
    gn_stability_mesh(request, &mesh, &options, (struct gn_stability_aims){.interior = 1}, out);
    /* Every second one is aimed at a point of a degenerate triangle. */
    options = (struct gn_aim_options){.first_triangle = solid.triangle_count, .triangle_count = count};
    for (uint32_t i = 0; i < out->ray_count; i += 2) {
        options.aim = i % 4 ? GN_AIM_VERTEX : GN_AIM_EDGE;
        gn_rays_aimed_with(random, &mesh, &options, &out->rays[i], 1);
    }
}
const struct gn_sweep gn_stability_degenerate = {
    "triangles without area, among 128 others", "", GN_SWEEP_VALUES(1, 4, 16, 64, 256, 1024, 4096), 4096,
    "a triangle without area is never hit: a fact without tolerance", 1000, degenerate, NULL};
