/* SPDX-License-Identifier: Apache-2.0 */
/* Sweeps over instance transforms: far, turned, sheared, stretched, mirrored, nearly singular, and many of them. */
#include <math.h>
#include <string.h>

#include "cts/cases/stability.h"

#define PI 3.14159265358979323846
#define CONDITION "the condition is the parameter: the inverse's second-order error stays below 1/64 of the first"

static struct gn_mesh blob(const struct gn_sweep_request *request)
{
    return gn_mesh_blob(request->arena, request->random, 6, 8, 0.2);
}

static void multiply(const double a[9], const double b[9], double out[9])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}

/* A rotation about a random axis. */
static void turn(struct gn_random *random, double out[9])
{
    float transform[12];
    gn_transform_random(random, 1, 1, 0, false, transform);
    for (int i = 0; i < 9; i++)
        out[i] = transform[4 * (i / 3) + i % 3];
}

/* Rounded, with a translation of up to `move` along each axis. */
static void store(struct gn_random *random, const double linear[9], double move, float out[12])
{
    for (int r = 0; r < 3; r++) {
        for (int c = 0; c < 3; c++)
            out[4 * r + c] = (float)linear[3 * r + c];
        out[4 * r + 3] = (float)gn_random_range(random, -move, move);
    }
}

/* A rotation, the middle matrix, and another rotation: its stretches are along no axis. */
static void store_turned(struct gn_random *random, const double middle[9], double move, float out[12])
{
    double outer[9], inner[9], half[9], all[9];
    turn(random, outer);
    turn(random, inner);
    multiply(outer, middle, half);
    multiply(half, inner, all);
    store(random, all, move, out);
}

/*
 * One transform of a value, and for some the geometry's too; gives the distance that rays should come from. A value is
 * tried on several of them.
 */
typedef double transform_maker(struct gn_random *random, double value, float instance[12], float geometry[12]);

struct placement {
    transform_maker *make;
    uint32_t places; /* how many transforms; 0: 8 */
    bool geometry; /* the geometry has a transform as well */
    bool shrunk; /* the mesh is as thin as the instance is stretched */
    bool culled; /* back or front faces are culled for two rays in three */
    enum gn_cts_program program;
};

/* Instances of a mesh, each for the rays of its own bit of the mask, so that up to 8 do not hide each other. */
static void placed(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    static const uint32_t flags[3] = {0, GN_REF_RAY_CULL_BACK_FACING, GN_REF_RAY_CULL_FRONT_FACING};
    const struct placement *placement = request->params;
    const uint32_t places = placement->places ? placement->places : 8;
    struct gn_mesh mesh = blob(request);
    if (placement->shrunk)
        mesh = gn_mesh_scaled(request->arena, &mesh, 1 / request->value, 1, request->value, 0, 0, 0);
    struct gn_cts_blas *blases = GN_NEW(request->arena, struct gn_cts_blas, places);
    struct gn_cts_geometry *geometries = GN_NEW(request->arena, struct gn_cts_geometry, places);
    struct gn_cts_instance *all = GN_NEW(request->arena, struct gn_cts_instance, places);
    float(*transforms)[12] = gn_arena_alloc(request->arena, places, sizeof *transforms);
    double *distance = GN_NEW(request->arena, double, places);
    for (uint32_t i = 0; i < places; i++) {
        geometries[i] = gn_geometry_of_mesh(&mesh);
        geometries[i].flags = GN_REF_GEOMETRY_OPAQUE;
        if (placement->geometry)
            geometries[i].transform = transforms[i];
        blases[i].geometries = &geometries[i];
        blases[i].geometry_count = 1;
        all[i] = gn_instance_of(i, NULL);
        all[i].mask = 1u << i % 8;
        all[i].custom_index = i;
        distance[i] = placement->make(request->random, request->value, all[i].transform, transforms[i]);
    }
    out->scene = (struct gn_cts_scene){
        .blases = blases, .blas_count = places, .instances = all, .instance_count = places};
    out->program = placement->program;
    out->ray_count = request->ray_count;
    out->rays = GN_NEW(request->arena, struct gn_cts_ray, request->ray_count);
    for (uint32_t i = 0; i < out->ray_count; i++) {
        uint32_t at = i % places;
        struct gn_aim_options options = {.geometry_transform = geometries[at].transform,
                                         .instance_transform = all[at].transform,
                                         .aim = i / places % 5 ? GN_AIM_INTERIOR : GN_AIM_EDGE,
                                         .distance = distance[at]};
        gn_stability_aim(request, &mesh, &options, &out->rays[i]);
        out->rays[i].ray.cull_mask = 1u << at % 8;
        if (placement->culled)
            out->rays[i].ray.flags = flags[i / places % 3];
    }
}

static double far_away(struct gn_random *random, double value, float instance[12], float geometry[12])
{
    const double by[3] = {value, -0.75 * value, 0.5 * value};
    (void)geometry;
    gn_transform_random(random, 1, 1, 0, false, instance);
    for (int r = 0; r < 3; r++)
        instance[4 * r + 3] = (float)by[r];
    return 4;
}
const struct gn_sweep gn_stability_instance_far = {
    "distance of the instance from the origin", "", GN_SWEEP_DECADES, 1e6,
    "beyond, the rounding of the ray's origin exceeds the triangles, and nothing is left to decide", 1000, placed,
    &(const struct placement){.make = far_away}};

static double rotated(struct gn_random *random, double value, float instance[12], float geometry[12])
{
    double angle = value * PI / 180, c = cos(angle), s = sin(angle), both[9];
    const double about_z[9] = {c, -s, 0, s, c, 0, 0, 0, 1}, about_x[9] = {1, 0, 0, 0, c, -s, 0, s, c};
    (void)geometry;
    multiply(about_x, about_z, both);
    store(random, both, 1, instance);
    return 4;
}
const struct gn_sweep gn_stability_rotation = {
    "angle of a rotation about two axes", "degrees",
    GN_SWEEP_VALUES(80, 45, 10, 1, 0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7), 1e-7,
    "a rotation is as well conditioned as can be, however small its sines", 1000, placed,
    &(const struct placement){.make = rotated}};

static double sheared(struct gn_random *random, double value, float instance[12], float geometry[12])
{
    const double middle[9] = {1, value, -value / 2, 0, 1, 0, 0, 0, 1};
    (void)geometry;
    store_turned(random, middle, 1, instance);
    return 4 + value;
}
const struct gn_sweep gn_stability_shear = {
    "shear of a turned instance", "", GN_SWEEP_VALUES(0.01, 0.1, 1, 3, 10, 30, 100, 1e3, 1e4, 1e5, 1e6), 100,
    "the condition is the shear's square: the inverse's second-order error stays below 1/64 of the first", 1000, placed,
    &(const struct placement){.make = sheared}};

static double stretched(struct gn_random *random, double value, float instance[12], float geometry[12])
{
    const double middle[9] = {value, 0, 0, 0, 1, 0, 0, 0, 1 / value};
    (void)geometry;
    store(random, middle, 1, instance);
    return 4;
}
const struct gn_sweep gn_stability_stretch = {
    "stretch along x, and the other way along z", "", GN_SWEEP_DECADES, 1e9,
    "each axis is only another scale, and products of three lengths stay normal", 1000, placed,
    &(const struct placement){.make = stretched, .shrunk = true}};

static double stretched_turned(struct gn_random *random, double value, float instance[12], float geometry[12])
{
    const double root = sqrt(value), middle[9] = {root, 0, 0, 0, 1, 0, 0, 0, 1 / root};
    (void)geometry;
    store_turned(random, middle, 1, instance);
    return 4 + root;
}
const struct gn_sweep gn_stability_stretch_turned = {
    "condition of a stretch along no axis", "", GN_SWEEP_DECADES, GN_SWEEP_CONDITION, CONDITION, 1000, placed,
    &(const struct placement){.make = stretched_turned}};

static double mirrored(struct gn_random *random, double value, float instance[12], float geometry[12])
{
    const double root = sqrt(value), middle[9] = {root, 0, 0, 0, -1, 0, 0, 0, 1 / root};
    (void)geometry;
    store_turned(random, middle, 1, instance);
    return 4 + root;
}
const struct gn_sweep gn_stability_mirrored = {
    "condition of a mirrored stretch along no axis", "", GN_SWEEP_DECADES, GN_SWEEP_CONDITION, CONDITION, 1000, placed,
    &(const struct placement){.make = mirrored, .culled = true}};

/* The third column is nearly in the plane of the other two. */
static double singular(struct gn_random *random, double value, float instance[12], float geometry[12])
{
    const double middle[9] = {1, 0, 0.5, 0, 1, -0.5, 0, 0, 1 / value};
    (void)geometry;
    store_turned(random, middle, 1, instance);
    return 4;
}
const struct gn_sweep gn_stability_singular = {
    "condition of a nearly singular transform", "", GN_SWEEP_DECADES, GN_SWEEP_CONDITION, CONDITION, 1000, placed,
    &(const struct placement){.make = singular}};

static double scaled(struct gn_random *random, double value, float instance[12], float geometry[12])
{
    const double middle[9] = {value, 0, 0, 0, value, 0, 0, 0, value};
    (void)geometry;
    store_turned(random, middle, value, instance);
    return 4 * value;
}
#define CUBES "the determinant is the cube: it has to be normal in f32, with 24 bits below it"
const struct gn_sweep gn_stability_instance_large = {
    "scale of the instance", "",
    GN_SWEEP_VALUES(1, 0x1p5, 0x1p10, 0x1p15, 0x1p20, 0x1p25, 0x1p30, 0x1p35, 0x1p40, 0x1p45, 0x1p50, 0x1p60,
                    0x1p80, 0x1p100),
    GN_SWEEP_CUBE, CUBES, 1000, placed, &(const struct placement){.make = scaled}};
const struct gn_sweep gn_stability_instance_small = {
    "scale of the instance", "",
    GN_SWEEP_VALUES(1, 0x1p-5, 0x1p-10, 0x1p-15, 0x1p-20, 0x1p-25, 0x1p-30, 0x1p-35, 0x1p-40, 0x1p-45, 0x1p-50,
                    0x1p-60, 0x1p-80, 0x1p-100),
    1 / GN_SWEEP_CUBE, CUBES, 1000, placed, &(const struct placement){.make = scaled}};

/* What the geometry's transform stretches, the instance's shrinks again. */
static double undone(struct gn_random *random, double value, float instance[12], float geometry[12])
{
    const double root = sqrt(value), stretch_by[9] = {root, 0, 0, 0, 1, 0, 0, 0, 1 / root},
                 shrink[9] = {1 / root, 0, 0, 0, 1, 0, 0, 0, root};
    double outer[9], inner[9], middle[9], half[9], first[9], second[9], back[9];
    turn(random, outer);
    turn(random, inner);
    turn(random, middle);
    for (int i = 0; i < 9; i++)
        back[i] = middle[3 * (i % 3) + i / 3];
    multiply(middle, stretch_by, half);
    multiply(half, inner, first);
    multiply(outer, shrink, half);
    multiply(half, back, second);
    store(random, first, 1, geometry);
    store(random, second, 1, instance);
    return 4;
}
const struct gn_sweep gn_stability_two_transforms = {
    "condition of both transforms", "", GN_SWEEP_DECADES, GN_SWEEP_CONDITION, CONDITION, 1000, placed,
    &(const struct placement){.make = undone, .geometry = true}};

/* Everything that a query says of the hit: both matrices, the ray in object space. */
static double moved(struct gn_random *random, double value, float instance[12], float geometry[12])
{
    (void)geometry;
    gn_transform_general(random, 0.5, 2, 0.5, value, false, instance);
    return 4;
}
const struct gn_sweep gn_stability_read_back = {
    "translation of the instance whose matrices are read back", "", GN_SWEEP_DECADES, 1e6,
    "the translation has no part in the inverse's linear part; beyond, the rays meet nothing that can be told", 500,
    placed, &(const struct placement){.make = moved, .places = 64, .program = GN_CTS_DETAIL}};

/* Vertex positions of the hit, after a geometry transform along no axis: three products and three sums each. */
static void positions(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    double root = sqrt(request->value);
    const double middle[9] = {root, 0, 0, 0, 1, 0, 0, 0, 1 / root};
    struct gn_mesh mesh = blob(request);
    float geometry[12];
    store_turned(request->random, middle, 1, geometry);
    struct gn_aim_options options = {.geometry_transform = geometry, .distance = 4 + root};
    gn_stability_mesh(request, &mesh, &options, (struct gn_stability_aims){.interior = 1}, out);
    struct gn_cts_blas *blas = GN_NEW(request->arena, struct gn_cts_blas, 1);
    *blas = out->scene.blases[0];
    blas->build_flags |= VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_DATA_ACCESS_KHR;
    out->scene.blases = blas;
    out->program = GN_CTS_POSITIONS;
}
const struct gn_sweep gn_stability_positions = {
    "condition of the geometry transform whose vertices are read back", "", GN_SWEEP_DECADES, 1e9,
    "a matrix times a vector is as exact as its products, whatever its condition", 500, positions, NULL};

/* Instances of a quad in the same place: every second one exactly, the others moved and turned a little. */
static void instances(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_random *random = request->random;
    uint32_t count = (uint32_t)request->value;
    struct gn_mesh mesh = gn_mesh_quad(request->arena);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = GN_REF_GEOMETRY_OPAQUE;
    struct gn_cts_instance *all = GN_NEW(request->arena, struct gn_cts_instance, count);
    for (uint32_t i = 0; i < count; i++) {
        all[i] = gn_instance_of(0, NULL);
        all[i].custom_index = i;
        if (i % 2)
            for (int k = 0; k < 12; k++)
                all[i].transform[k] += (float)gn_random_range(random, -0.01, 0.01);
    }
    out->scene = gn_scene_of_geometries(request->arena, &geometry, 1, all, count);
    /* Every ray meets every instance. */
    uint32_t most = 1 + 400000 / count;
    out->ray_count = request->ray_count < most ? request->ray_count : most;
    out->rays = GN_NEW(request->arena, struct gn_cts_ray, out->ray_count);
    gn_rays_aimed(random, &mesh, NULL, NULL, GN_AIM_INTERIOR, 4, true, out->rays, out->ray_count);
}
const struct gn_sweep gn_stability_instances = {
    "instances in one place", "", GN_SWEEP_VALUES(1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096), 4096,
    "the number of instances has no part in the derivation", 1000, instances, NULL};
