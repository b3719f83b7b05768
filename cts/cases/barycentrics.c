/* SPDX-License-Identifier: Apache-2.0 */
/* The barycentric coordinates of hits, and with them t: at corners, on edges, inside; triangles of all shapes. */
#include <math.h>
#include <string.h>

#include "cts/compose.h"
#include "cts/mesh_case.h"

#define OPAQUE VK_GEOMETRY_OPAQUE_BIT_KHR
#define ALL_OF_THEM .interior = 4000, .edge = 4000, .vertex = 1000, .both_sides = true

static const struct gn_mesh_case triangle_interior = {
    .mesh = {.kind = GN_MESH_TRIANGLE}, .geometry_flags = OPAQUE, .interior = 20000, .both_sides = true};
static const struct gn_mesh_case triangle_exact_interior = {.mesh = {.kind = GN_MESH_TRIANGLE}, .geometry_flags = OPAQUE,
    .exact = true, .interior = 10000, .both_sides = true};
static const struct gn_mesh_case triangle_exact_edges = {
    .mesh = {.kind = GN_MESH_TRIANGLE}, .geometry_flags = OPAQUE, .exact = true, .edge = 8000, .both_sides = true};
static const struct gn_mesh_case triangle_exact_corners = {
    .mesh = {.kind = GN_MESH_TRIANGLE}, .geometry_flags = OPAQUE, .exact = true, .vertex = 4000, .both_sides = true};
static const struct gn_mesh_case lattice_exact = {.mesh = {.kind = GN_MESH_LATTICE, .n = 16, .size = 0.25},
    .geometry_flags = OPAQUE, .exact = true, .interior = 16000, .edge = 4000, .both_sides = true};
static const struct gn_mesh_case octahedron_exact = {.mesh = {.kind = GN_MESH_OCTAHEDRON, .n = 4},
    .geometry_flags = OPAQUE, .exact = true, .interior = 10000, .edge = 4000};
static const struct gn_mesh_case soup = {.mesh = {.kind = GN_MESH_SOUP, .n = 300, .size = 0.5}, .geometry_flags = OPAQUE,
    .interior = 16000, .edge = 4000, .both_sides = true};
static const struct gn_mesh_case soup_confirmed = {
    .mesh = {.kind = GN_MESH_SOUP, .n = 300, .size = 0.5}, .interior = 12000, .both_sides = true};
static const struct gn_mesh_case height_field = {.mesh = {.kind = GN_MESH_HEIGHT_FIELD, .n = 24, .size = 0.2},
    .geometry_flags = OPAQUE, .interior = 16000, .edge = 4000, .both_sides = true};
static const struct gn_mesh_case big = {.mesh = {.kind = GN_MESH_SOUP, .n = 100, .size = 0.5},
    .stretch = {4096, 4096, 4096}, .distance = 9000, .geometry_flags = OPAQUE, ALL_OF_THEM};
static const struct gn_mesh_case small = {.mesh = {.kind = GN_MESH_SOUP, .n = 100, .size = 0.5},
    .stretch = {1 / 4096.0, 1 / 4096.0, 1 / 4096.0}, .distance = 0.002, .geometry_flags = OPAQUE, ALL_OF_THEM};
static const struct gn_mesh_case seen_from_afar = {.mesh = {.kind = GN_MESH_TRIANGLE}, .distance = 500,
    .geometry_flags = OPAQUE, .interior = 8000, .both_sides = true};
static const struct gn_mesh_case seen_close_up = {.mesh = {.kind = GN_MESH_TRIANGLE}, .distance = 0.01,
    .geometry_flags = OPAQUE, .interior = 8000, .both_sides = true};
static const struct gn_mesh_case sliver_10 = {.mesh = {.kind = GN_MESH_TRIANGLE}, .stretch = {1, 0.1, 1},
    .geometry_flags = OPAQUE, ALL_OF_THEM};
static const struct gn_mesh_case sliver_100 = {.mesh = {.kind = GN_MESH_TRIANGLE}, .stretch = {0.01, 1, 1},
    .geometry_flags = OPAQUE, ALL_OF_THEM};
static const struct gn_mesh_case sliver_1000 = {.mesh = {.kind = GN_MESH_TRIANGLE}, .stretch = {1, 0.001, 1},
    .geometry_flags = OPAQUE, ALL_OF_THEM};
static const struct gn_mesh_case under_instance = {.mesh = {.kind = GN_MESH_SOUP, .n = 200, .size = 0.5},
    .instance = {.kind = GN_TRANSFORM_GENERAL, .min_scale = 0.5, .max_scale = 2, .shear = 0.5, .translation = 3},
    .geometry_flags = OPAQUE, .interior = 12000, .both_sides = true};
static const struct gn_mesh_case under_geometry = {.mesh = {.kind = GN_MESH_SOUP, .n = 200, .size = 0.5},
    .geometry = {.kind = GN_TRANSFORM_GENERAL, .min_scale = 0.5, .max_scale = 2, .shear = 0.5, .translation = 3},
    .geometry_flags = OPAQUE, .interior = 12000, .both_sides = true};
static const struct gn_mesh_case mirrored = {.mesh = {.kind = GN_MESH_SOUP, .n = 200, .size = 0.5},
    .geometry = {.kind = GN_TRANSFORM_RANDOM, .min_scale = 0.5, .max_scale = 2, .mirrored = true},
    .instance = {.kind = GN_TRANSFORM_RANDOM, .min_scale = 0.5, .max_scale = 2, .translation = 3, .mirrored = true},
    .geometry_flags = OPAQUE, .interior = 12000, .both_sides = true};

/*
 * The same triangle with its corners in each of the six orders, as six geometries side by side: the first
 * coordinate is the weight of the second corner and the second that of the third, whatever the order.
 */
static void corner_order(struct gn_case_run *run, const struct gn_case *self)
{
    (void)self;
    static const uint32_t orders[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
    struct gn_cts_geometry geometries[6];
    uint32_t each = gn_ray_count(run, 2500);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, 6 * each);
    for (int i = 0; i < 6; i++) {
        struct gn_mesh triangle = gn_mesh_triangle(&run->arena);
        /* Unequal sides, so that no two orders look alike. */
        struct gn_mesh mesh = gn_mesh_scaled(&run->arena, &triangle, 1, 0.75, 1, 2.5 * i, 0.25 * i, 0);
        mesh.positions[2][0] += 0.375;
        memcpy(mesh.triangles[0], orders[i], sizeof orders[i]);
        geometries[i] = gn_geometry_of_mesh(&mesh);
        geometries[i].flags = OPAQUE;
        gn_rays_aimed(&run->random, &mesh, NULL, NULL, GN_AIM_INTERIOR, 4, true, rays + (size_t)i * each, each);
    }
    struct gn_cts_instance instance = gn_instance_of(0, NULL);
    struct gn_cts_scene scene = gn_scene_of_geometries(&run->arena, geometries, 6, &instance, 1);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, 6 * each, each);
}

/* A regular picture of one triangle, rays side by side: what a G-buffer would show. */
static void picture(struct gn_case_run *run, const struct gn_case *self)
{
    (void)self;
    struct gn_mesh mesh = gn_mesh_triangle(&run->arena);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = OPAQUE;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    uint32_t side = (uint32_t)sqrt(gn_ray_count(run, 160 * 160));
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, (size_t)side * side);
    for (uint32_t y = 0; y < side; y++) {
        for (uint32_t x = 0; x < side; x++) {
            /* A band of the triangle that is nearly all of it. */
            double v = -0.98 + 1.9 * (y + 0.5) / side, half = 1.05 * (1 - v) / 2;
            double origin[3] = {half * (2 * (x + 0.5) / side - 1), v, 5}, direction[3] = {0, 0, -2};
            rays[y * side + x] = gn_ray_make(origin, direction, 100);
        }
    }
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, side * side, side);
}

#define WEIGHTS "barycentrics are the weights of the second and third vertex at the hit (ray traversal: ray-triangle intersection)"

static const struct gn_case cases[] = {
    {"barycentrics.triangle.interior", WEIGHTS, gn_mesh_case_run, &triangle_interior, 0},
    {"barycentrics.triangle.picture", WEIGHTS, picture, NULL, 0},
    {"barycentrics.triangle.corner_order", WEIGHTS, corner_order, NULL, 0},
    {"barycentrics.exact.interior", WEIGHTS, gn_mesh_case_run, &triangle_exact_interior, 0},
    {"barycentrics.exact.edges", "on an edge one weight is 0 (ray traversal: ray-triangle intersection)", gn_mesh_case_run,
     &triangle_exact_edges, 0},
    {"barycentrics.exact.corners", "at a corner one weight is 1 (ray traversal: ray-triangle intersection)",
     gn_mesh_case_run, &triangle_exact_corners, 0},
    {"barycentrics.exact.lattice", WEIGHTS, gn_mesh_case_run, &lattice_exact, 0},
    {"barycentrics.exact.octahedron", WEIGHTS, gn_mesh_case_run, &octahedron_exact, 0},
    {"barycentrics.soup", WEIGHTS, gn_mesh_case_run, &soup, 0},
    {"barycentrics.soup_confirmed", "a confirmed candidate keeps its barycentrics (ray query: committed intersection)",
     gn_mesh_case_run, &soup_confirmed, 0},
    {"barycentrics.height_field", WEIGHTS, gn_mesh_case_run, &height_field, 0},
    {"barycentrics.size.big", WEIGHTS, gn_mesh_case_run, &big, 0},
    {"barycentrics.size.small", WEIGHTS, gn_mesh_case_run, &small, 0},
    {"barycentrics.distance.far", WEIGHTS, gn_mesh_case_run, &seen_from_afar, 0},
    {"barycentrics.distance.near", WEIGHTS, gn_mesh_case_run, &seen_close_up, 0},
    {"barycentrics.sliver.10", WEIGHTS, gn_mesh_case_run, &sliver_10, 0},
    {"barycentrics.sliver.100", WEIGHTS, gn_mesh_case_run, &sliver_100, 0},
    {"barycentrics.sliver.1000", WEIGHTS, gn_mesh_case_run, &sliver_1000, 0},
    {"barycentrics.transform.instance", "an instance's transform leaves barycentrics as they are (ray traversal)",
     gn_mesh_case_run, &under_instance, 0},
    {"barycentrics.transform.geometry", "a geometry's transform leaves barycentrics as they are (ray traversal)",
     gn_mesh_case_run, &under_geometry, 0},
    {"barycentrics.transform.mirrored", "a mirroring transform leaves barycentrics as they are (ray traversal)",
     gn_mesh_case_run, &mirrored, 0},
};
const struct gn_case_family gn_family_barycentrics = {"barycentrics", cases, sizeof cases / sizeof cases[0]};
