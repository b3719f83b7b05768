/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Shared edges and vertices. What the specification says of them is "should", so a ray lost where the
 * triangles cover its neighbourhood makes a leak, not a failure; interior rays of the same meshes are the
 * control, and borders, silhouettes and T-junctions the counter-examples, where a ray may be lost.
 */
#include <math.h>
#include <string.h>

#include "cts/compose.h"
#include "cts/mesh_case.h"

#define OPAQUE VK_GEOMETRY_OPAQUE_BIT_KHR
#define FIELD {.kind = GN_MESH_HEIGHT_FIELD, .n = 64, .size = 0.02}
#define LATTICE {.kind = GN_MESH_LATTICE, .n = 32, .size = 0.0625}
#define BLOB {.kind = GN_MESH_BLOB, .n = 24, .m = 32, .size = 0.02}

static const struct gn_mesh_case field_interior = {.mesh = FIELD, .geometry_flags = OPAQUE, .interior = 50000};
static const struct gn_mesh_case field_edge = {.mesh = FIELD, .geometry_flags = OPAQUE, .edge = 50000};
static const struct gn_mesh_case field_vertex = {.mesh = FIELD, .geometry_flags = OPAQUE, .vertex = 50000};
static const struct gn_mesh_case steep_edge = {
    .mesh = {.kind = GN_MESH_HEIGHT_FIELD, .n = 32, .size = 0.5}, .geometry_flags = OPAQUE, .edge = 20000};
static const struct gn_mesh_case steep_vertex = {
    .mesh = {.kind = GN_MESH_HEIGHT_FIELD, .n = 32, .size = 0.5}, .geometry_flags = OPAQUE, .vertex = 20000};
static const struct gn_mesh_case flat_vertex = {
    .mesh = {.kind = GN_MESH_HEIGHT_FIELD, .n = 32, .size = 0}, .geometry_flags = OPAQUE, .edge = 10000, .vertex = 10000};
static const struct gn_mesh_case large_interior = {
    .mesh = {.kind = GN_MESH_HEIGHT_FIELD, .n = 256, .size = 0.01}, .geometry_flags = OPAQUE, .interior = 30000};
static const struct gn_mesh_case large_edge_vertex = {.mesh = {.kind = GN_MESH_HEIGHT_FIELD, .n = 256, .size = 0.01},
    .geometry_flags = OPAQUE, .edge = 30000, .vertex = 30000};
static const struct gn_mesh_case lattice_interior = {
    .mesh = LATTICE, .geometry_flags = OPAQUE, .exact = true, .interior = 20000};
static const struct gn_mesh_case lattice_edge = {.mesh = LATTICE, .geometry_flags = OPAQUE, .exact = true, .edge = 30000};
static const struct gn_mesh_case lattice_vertex = {
    .mesh = LATTICE, .geometry_flags = OPAQUE, .exact = true, .vertex = 30000};
static const struct gn_mesh_case blob_interior = {.mesh = BLOB, .geometry_flags = OPAQUE, .interior = 20000};
static const struct gn_mesh_case blob_edge = {.mesh = BLOB, .geometry_flags = OPAQUE, .edge = 30000};
static const struct gn_mesh_case blob_vertex = {.mesh = BLOB, .geometry_flags = OPAQUE, .vertex = 30000};
static const struct gn_mesh_case blob_inside = {.mesh = BLOB, .geometry_flags = OPAQUE, .distance = 0.25, .edge = 10000,
    .vertex = 10000, .both_sides = true};
static const struct gn_mesh_case blob_bumpy = {.mesh = {.kind = GN_MESH_BLOB, .n = 24, .m = 32, .size = 0.3},
    .geometry_flags = OPAQUE, .edge = 10000, .vertex = 10000};
static const struct gn_mesh_case blob_grazed = {.mesh = BLOB, .geometry_flags = OPAQUE, .min_cosine = 0.001,
    .max_cosine = 0.1, .edge = 10000, .vertex = 10000};
static const struct gn_mesh_case octahedron_edge = {
    .mesh = {.kind = GN_MESH_OCTAHEDRON, .n = 16}, .geometry_flags = OPAQUE, .exact = true, .edge = 16000};
static const struct gn_mesh_case octahedron_vertex = {
    .mesh = {.kind = GN_MESH_OCTAHEDRON, .n = 16}, .geometry_flags = OPAQUE, .exact = true, .vertex = 16000};
static const struct gn_mesh_case box_exact = {.mesh = {.kind = GN_MESH_BOX, .n = 8}, .geometry_flags = OPAQUE,
    .exact = true, .edge = 10000, .vertex = 10000};
static const struct gn_mesh_case torus = {.mesh = {.kind = GN_MESH_TORUS, .n = 48, .m = 24, .size = 0.5},
    .geometry_flags = OPAQUE, .edge = 12000, .vertex = 12000};
static const struct gn_mesh_case unshared = {.mesh = LATTICE, .unshared = true, .geometry_flags = OPAQUE, .exact = true,
    .edge = 12000, .vertex = 12000};
static const struct gn_mesh_case not_opaque = {.mesh = LATTICE, .exact = true, .edge = 12000, .vertex = 12000};
static const struct gn_mesh_case rotated_interior = {.mesh = FIELD, .geometry_flags = OPAQUE,
    .instance = {.kind = GN_TRANSFORM_GENERAL, .min_scale = 0.5, .max_scale = 2, .translation = 3}, .interior = 16000};
static const struct gn_mesh_case rotated_edge = {.mesh = FIELD, .geometry_flags = OPAQUE,
    .instance = {.kind = GN_TRANSFORM_GENERAL, .min_scale = 0.5, .max_scale = 2, .translation = 3}, .edge = 20000};
static const struct gn_mesh_case rotated_vertex = {.mesh = FIELD, .geometry_flags = OPAQUE,
    .instance = {.kind = GN_TRANSFORM_GENERAL, .min_scale = 0.5, .max_scale = 2, .translation = 3}, .vertex = 20000};
static const struct gn_mesh_case moved_exactly = {.mesh = LATTICE, .geometry_flags = OPAQUE, .exact = true,
    .instance = {.kind = GN_TRANSFORM_DYADIC}, .edge = 12000, .vertex = 12000};
static const struct gn_mesh_case mirrored_exactly = {.mesh = LATTICE, .geometry_flags = OPAQUE, .exact = true,
    .instance = {.kind = GN_TRANSFORM_DYADIC, .mirrored = true}, .edge = 12000, .vertex = 12000};
static const struct gn_mesh_case geometry_exactly = {.mesh = LATTICE, .geometry_flags = OPAQUE, .exact = true,
    .geometry = {.kind = GN_TRANSFORM_DYADIC}, .edge = 12000, .vertex = 12000};
static const struct gn_mesh_case geometry_rotated = {.mesh = FIELD, .geometry_flags = OPAQUE,
    .geometry = {.kind = GN_TRANSFORM_RANDOM, .min_scale = 0.5, .max_scale = 2, .translation = 3}, .edge = 12000,
    .vertex = 12000};
/* A ray crosses it twice: its candidates are few, even where it runs along edges. */
#define CLOSED {.kind = GN_MESH_OCTAHEDRON, .n = 8}
static const struct gn_mesh_case candidates_interior = {
    .mesh = BLOB, .program = GN_CTS_CANDIDATES, .interior = 8000};
static const struct gn_mesh_case candidates_edge = {
    .mesh = CLOSED, .exact = true, .program = GN_CTS_CANDIDATES, .edge = 10000};
static const struct gn_mesh_case candidates_vertex = {
    .mesh = CLOSED, .exact = true, .program = GN_CTS_CANDIDATES, .vertex = 10000};
static const struct gn_mesh_case candidates_once = {.mesh = CLOSED, .exact = true, .program = GN_CTS_CANDIDATES,
    .geometry_flags = VK_GEOMETRY_NO_DUPLICATE_ANY_HIT_INVOCATION_BIT_KHR, .edge = 10000, .vertex = 5000};

/* Closed fans: half of the rays at the hub, the others anywhere. A high fan is a spike, whose tip is a
 * silhouette from nearly everywhere. */
struct fan {
    uint32_t spokes, rays;
    double height;
};

static void fan(struct gn_case_run *run, const struct gn_case *self)
{
    const struct fan *what = self->params;
    struct gn_mesh mesh = gn_mesh_fan(&run->arena, &run->random, what->spokes, what->height);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = OPAQUE;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    uint32_t count = gn_ray_count(run, what->rays / 2);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, 2 * count);
    for (uint32_t i = 0; i < count; i++)
        gn_ray_lattice_at(&run->random, &mesh, 0, &rays[i]);
    gn_rays_lattice(&run->random, &mesh, GN_AIM_RANDOM, rays + count, count);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, 2 * count, 0);
}

/* At the hub of a large fan every triangle is met: fewer rays do. */
static const struct fan fan_3 = {3, 10000, 0.125}, fan_8 = {8, 10000, 0.125}, fan_level = {8, 10000, 0},
                        fan_64 = {64, 3000, 0.125}, fan_1024 = {1024, 300, 0.125}, spike = {8, 10000, 16};

/* Rays straight down an axis, through every vertex and the middle of every edge of a lattice: directions with
 * two zero components, the commonest exact hit there is (an orthographic camera over a terrain). */
static void straight_down(struct gn_case_run *run, const struct gn_case *self)
{
    struct gn_mesh mesh = gn_mesh_lattice(&run->arena, &run->random, 64, 0.0625);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = OPAQUE;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    /* Border vertices are left out. */
    uint32_t side = self->value == 0 ? 63 : 126;
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, (size_t)side * side);
    for (uint32_t y = 0; y < side; y++) {
        for (uint32_t x = 0; x < side; x++) {
            double step = self->value == 0 ? 2.0 / 64 : 1.0 / 64;
            double origin[3] = {(x + 1) * step - 1, (y + 1) * step - 1, 2}, direction[3] = {0, 0, -1};
            rays[y * side + x] = gn_ray_make(origin, direction, 100);
        }
    }
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, side * side, side);
}

/* Both halves of a field as geometries of one structure: an edge between two geometries of one instance is a
 * shared edge, as their transforms are the same. */
static void two_geometries(struct gn_case_run *run, const struct gn_case *self)
{
    (void)self;
    struct gn_mesh mesh = gn_mesh_lattice(&run->arena, &run->random, 16, 0.0625);
    struct gn_cts_geometry geometries[2];
    uint32_t half = mesh.triangle_count / 2;
    /* Triangles dealt out in turn, so that nearly every edge is between the two. */
    uint32_t (*dealt)[3] = gn_arena_alloc(&run->arena, mesh.triangle_count, sizeof *dealt);
    for (uint32_t t = 0; t < mesh.triangle_count; t++)
        memcpy(dealt[t % 2 * half + t / 2], mesh.triangles[t], sizeof *dealt);
    for (int i = 0; i < 2; i++) {
        geometries[i] = gn_geometry_of_mesh(&mesh);
        geometries[i].flags = OPAQUE;
        geometries[i].triangles = (const uint32_t (*)[3])dealt + (i ? half : 0);
        geometries[i].triangle_count = half;
    }
    struct gn_cts_instance instance = gn_instance_of(0, NULL);
    struct gn_cts_scene scene = gn_scene_of_geometries(&run->arena, geometries, 2, &instance, 1);
    uint32_t count = gn_ray_count(run, 20000);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_rays_lattice(&run->random, &mesh, GN_AIM_EDGE, rays, count / 2);
    gn_rays_lattice(&run->random, &mesh, GN_AIM_VERTEX, rays + count / 2, count - count / 2);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* Where the specification promises nothing, every second triangle being wound the other way: a ray lost at an
 * edge is a gap. */
static void mixed_winding(struct gn_case_run *run, const struct gn_case *self)
{
    (void)self;
    struct gn_mesh mesh = gn_mesh_lattice(&run->arena, &run->random, 16, 0.0625);
    uint32_t count = gn_ray_count(run, 12000);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_rays_lattice(&run->random, &mesh, GN_AIM_EDGE, rays, count / 2);
    gn_rays_lattice(&run->random, &mesh, GN_AIM_VERTEX, rays + count / 2, count - count / 2);
    for (uint32_t t = 0; t < mesh.triangle_count; t += 2) {
        uint32_t swap = mesh.triangles[t][1];
        mesh.triangles[t][1] = mesh.triangles[t][2];
        mesh.triangles[t][2] = swap;
    }
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = OPAQUE;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* A seam along y = 0 between two halves that share positions there but not edges: halves of different fineness
 * (T-junctions, exactly on the coarser edge or off it by the rounding), or in two instances. */
enum seam { T_JUNCTIONS, BENT_T_JUNCTIONS, TWO_INSTANCES };

/* Aims at an edge or vertex that touches y = 0, exactly where the mesh is a lattice. */
static void seam_ray(struct gn_random *random, const struct gn_mesh *mesh, enum gn_aim aim, bool exact,
                     struct gn_cts_ray *ray)
{
    for (;;) {
        if (exact)
            gn_rays_lattice(random, mesh, aim, ray, 1);
        else
            gn_rays_aimed(random, mesh, NULL, NULL, aim, 4, false, ray, 1);
        double origin = ray->ray.origin[1], direction = ray->ray.direction[1];
        if (!exact && fabs(origin + direction) < 1e-6)
            return;
        for (int steps = 1; exact && steps <= 8; steps++)
            if (origin + steps * direction == 0)
                return;
    }
}

static void seam(struct gn_case_run *run, const struct gn_case *self)
{
    bool two = self->value == TWO_INSTANCES, bent = self->value == BENT_T_JUNCTIONS;
    struct gn_mesh mesh = two ? gn_mesh_lattice(&run->arena, &run->random, 16, 0.0625)
                              : gn_mesh_t_junctions(&run->arena, &run->random, 16, 0.0625, bent);
    /* Only the triangles at the seam are aimed at. */
    struct gn_mesh at_seam = mesh;
    at_seam.triangles = gn_arena_alloc(&run->arena, mesh.triangle_count, sizeof *mesh.triangles);
    at_seam.triangle_count = 0;
    for (uint32_t t = 0; t < mesh.triangle_count; t++) {
        int touching = 0;
        for (int k = 0; k < 3; k++)
            touching += mesh.positions[mesh.triangles[t][k]][1] == 0;
        if (touching == 2)
            memcpy(at_seam.triangles[at_seam.triangle_count++], mesh.triangles[t], sizeof *mesh.triangles);
    }
    uint32_t count = gn_ray_count(run, 12000);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    for (uint32_t i = 0; i < count; i++)
        seam_ray(&run->random, &at_seam, i % 2 ? GN_AIM_VERTEX : GN_AIM_EDGE, !bent, &rays[i]);

    struct gn_cts_geometry geometries[2] = {gn_geometry_of_mesh(&mesh), gn_geometry_of_mesh(&mesh)};
    struct gn_cts_blas blases[2] = {0};
    struct gn_cts_instance instances[2] = {gn_instance_of(0, NULL), gn_instance_of(1, NULL)};
    struct gn_cts_scene scene = gn_scene_make(blases, two ? 2 : 1, instances, two ? 2 : 1);
    for (uint32_t i = 0; i < scene.blas_count; i++) {
        geometries[i].flags = OPAQUE;
        if (two) {
            /* Rows are in the order of y. */
            geometries[i].triangle_count = mesh.triangle_count / 2;
            geometries[i].triangles += i * geometries[i].triangle_count;
        }
        blases[i].geometries = &geometries[i];
        blases[i].geometry_count = 1;
    }
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* Closed meshes under transforms of every kind: the ray is rounded on its way to object space, and so are its
 * edges, but all triangles of an instance see the same ray. `value` is the aim. */
static void transformed(struct gn_case_run *run, const struct gn_case *self)
{
    enum { INSTANCES = 24 };
    struct gn_mesh meshes[3] = {gn_mesh_box(&run->arena, 1), gn_mesh_octahedron(&run->arena, 2),
                                gn_mesh_blob(&run->arena, &run->random, 5, 6, 0.2)};
    struct gn_cts_geometry geometries[3];
    struct gn_cts_blas blases[3] = {0};
    struct gn_cts_instance instances[INSTANCES];
    for (int i = 0; i < 3; i++) {
        geometries[i] = gn_geometry_of_mesh(&meshes[i]);
        geometries[i].flags = OPAQUE;
        blases[i].geometries = &geometries[i];
        blases[i].geometry_count = 1;
    }
    for (uint32_t i = 0; i < INSTANCES; i++) {
        float transform[12];
        gn_transform_general(&run->random, 0.5, 2, 0.5, 6, i & 1, transform);
        instances[i] = gn_instance_of(i % 3, transform);
    }
    uint32_t count = gn_ray_count(run, 40000);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    for (uint32_t r = 0; r < count; r++) {
        uint32_t i = r % INSTANCES;
        gn_rays_aimed(&run->random, &meshes[i % 3], NULL, instances[i].transform, (enum gn_aim)self->value, 4, false,
                      &rays[r], 1);
    }
    struct gn_cts_scene scene = gn_scene_make(blases, 3, instances, INSTANCES);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

#define INTERIOR "a ray through a triangle's inside hits (ray traversal: watertightness); the control of its neighbours"
#define EDGE "a ray should not miss at an edge shared by two triangles (ray traversal: watertightness)"
#define VERTEX "a ray should not miss at the shared vertex of a closed fan (ray traversal: watertightness)"
#define BOTH "a ray should not miss at a shared edge or the vertex of a closed fan (ray traversal: watertightness)"
#define ONCE "a ray should not hit twice at a shared edge or vertex (ray traversal: watertightness)"
#define NONE "nothing is promised where triangles do not share the edge (ray traversal: watertightness)"

static const struct gn_case cases[] = {
    {"watertight.field.interior", INTERIOR, gn_mesh_case_run, &field_interior, 0},
    {"watertight.field.edge", EDGE, gn_mesh_case_run, &field_edge, 0},
    {"watertight.field.vertex", VERTEX, gn_mesh_case_run, &field_vertex, 0},
    {"watertight.steep.edge", EDGE, gn_mesh_case_run, &steep_edge, 0},
    {"watertight.steep.vertex", VERTEX, gn_mesh_case_run, &steep_vertex, 0},
    {"watertight.flat", BOTH, gn_mesh_case_run, &flat_vertex, 0},
    {"watertight.large.interior", INTERIOR, gn_mesh_case_run, &large_interior, 0},
    {"watertight.large.edge_and_vertex", BOTH, gn_mesh_case_run, &large_edge_vertex, 0},
    {"watertight.lattice.interior", INTERIOR, gn_mesh_case_run, &lattice_interior, 0},
    {"watertight.lattice.edge", EDGE, gn_mesh_case_run, &lattice_edge, 0},
    {"watertight.lattice.vertex", VERTEX, gn_mesh_case_run, &lattice_vertex, 0},
    {"watertight.lattice.down_vertices", VERTEX, straight_down, NULL, 0},
    {"watertight.lattice.down_edges", BOTH, straight_down, NULL, 1},
    {"watertight.lattice.unshared", "vertices are shared by their position, not by their index (ray traversal: watertightness)",
     gn_mesh_case_run, &unshared, 0},
    {"watertight.lattice.not_opaque", "watertightness is the same for candidates that the shader confirms (ray traversal)",
     gn_mesh_case_run, &not_opaque, 0},
    {"watertight.lattice.two_geometries", "edges are shared within an instance where transforms are identical (ray traversal)",
     two_geometries, NULL, 0},
    {"watertight.blob.interior", INTERIOR, gn_mesh_case_run, &blob_interior, 0},
    {"watertight.blob.edge", EDGE, gn_mesh_case_run, &blob_edge, 0},
    {"watertight.blob.vertex", VERTEX, gn_mesh_case_run, &blob_vertex, 0},
    {"watertight.blob.both_sides", BOTH, gn_mesh_case_run, &blob_inside, 0},
    {"watertight.blob.bumpy", BOTH, gn_mesh_case_run, &blob_bumpy, 0},
    {"watertight.blob.grazed", BOTH, gn_mesh_case_run, &blob_grazed, 0},
    {"watertight.octahedron.edge", EDGE, gn_mesh_case_run, &octahedron_edge, 0},
    {"watertight.octahedron.vertex", VERTEX, gn_mesh_case_run, &octahedron_vertex, 0},
    {"watertight.box", BOTH, gn_mesh_case_run, &box_exact, 0},
    {"watertight.torus", BOTH, gn_mesh_case_run, &torus, 0},
    {"watertight.fan.3", VERTEX, fan, &fan_3, 0},
    {"watertight.fan.8", VERTEX, fan, &fan_8, 0},
    {"watertight.fan.8_level", VERTEX, fan, &fan_level, 0},
    {"watertight.fan.64", VERTEX, fan, &fan_64, 0},
    {"watertight.fan.1024", VERTEX, fan, &fan_1024, 0},
    {"watertight.fan.spike", "a ray may pass the tip of a spike (ray traversal: watertightness)", fan, &spike, 0},
    {"watertight.instance.interior", INTERIOR, gn_mesh_case_run, &rotated_interior, 0},
    {"watertight.instance.edge", EDGE, gn_mesh_case_run, &rotated_edge, 0},
    {"watertight.instance.vertex", VERTEX, gn_mesh_case_run, &rotated_vertex, 0},
    {"watertight.instance.exact", BOTH, gn_mesh_case_run, &moved_exactly, 0},
    {"watertight.instance.mirrored_exact", BOTH, gn_mesh_case_run, &mirrored_exactly, 0},
    {"watertight.geometry_transform.exact", BOTH, gn_mesh_case_run, &geometry_exactly, 0},
    {"watertight.geometry_transform.rotated", BOTH, gn_mesh_case_run, &geometry_rotated, 0},
    {"watertight.transformed.interior", INTERIOR, transformed, NULL, GN_AIM_INTERIOR},
    {"watertight.transformed.edge", EDGE, transformed, NULL, GN_AIM_EDGE},
    {"watertight.transformed.vertex", VERTEX, transformed, NULL, GN_AIM_VERTEX},
    {"watertight.no_promise.t_junctions", NONE, seam, NULL, T_JUNCTIONS},
    {"watertight.no_promise.bent_t_junctions", NONE, seam, NULL, BENT_T_JUNCTIONS},
    {"watertight.no_promise.two_instances", NONE, seam, NULL, TWO_INSTANCES},
    {"watertight.no_promise.mixed_winding", NONE, mixed_winding, NULL, 0},
    {"watertight.candidates.interior", INTERIOR, gn_mesh_case_run, &candidates_interior, 0},
    {"watertight.candidates.edge", ONCE, gn_mesh_case_run, &candidates_edge, 0},
    {"watertight.candidates.vertex", ONCE, gn_mesh_case_run, &candidates_vertex, 0},
    {"watertight.candidates.no_duplicates",
     "with NO_DUPLICATE_ANY_HIT_INVOCATION a primitive is presented at most once (acceleration structures)",
     gn_mesh_case_run, &candidates_once, 0},
};
const struct gn_case_family gn_family_watertight = {"watertight", cases, sizeof cases / sizeof cases[0]};
