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

static void placed(const struct gn_sweep_request *request, const struct gn_mesh *mesh, const float *instance,
                   double distance, struct gn_sweep_scene *out)
{
    struct gn_aim_options options = {.instance_transform = instance, .distance = distance};
    gn_stability_mesh(request, mesh, &options, (struct gn_stability_aims){.interior = 4, .edge = 1}, out);
}

static void instance_far(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    const double by[3] = {request->value, -0.75 * request->value, 0.5 * request->value};
    struct gn_mesh mesh = blob(request);
    float instance[12];
    gn_transform_random(request->random, 1, 1, 0, false, instance);
    for (int r = 0; r < 3; r++)
        instance[4 * r + 3] = (float)by[r];
    placed(request, &mesh, instance, 4, out);
}
const struct gn_sweep gn_stability_instance_far = {
    "distance of the instance from the origin", "", GN_SWEEP_DECADES, 1e6,
    "beyond, the rounding of the ray's origin exceeds the triangles, and nothing is left to decide", 1000, instance_far,
    NULL};

static void rotation(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    double angle = request->value * PI / 180, c = cos(angle), s = sin(angle);
    const double about_z[9] = {c, -s, 0, s, c, 0, 0, 0, 1}, about_x[9] = {1, 0, 0, 0, c, -s, 0, s, c};
    struct gn_mesh mesh = blob(request);
    double both[9];
    float instance[12];
    multiply(about_x, about_z, both);
    store(request->random, both, 1, instance);
    placed(request, &mesh, instance, 4, out);
}
const struct gn_sweep gn_stability_rotation = {
    "angle of a rotation about two axes", "degrees",
    GN_SWEEP_VALUES(80, 45, 10, 1, 0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7), 1e-7,
    "a rotation is as well conditioned as can be, however small its sines", 1000, rotation, NULL};

static void shear(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    double by = request->value;
    const double middle[9] = {1, by, -by / 2, 0, 1, 0, 0, 0, 1};
    struct gn_mesh mesh = blob(request);
    float instance[12];
    store_turned(request->random, middle, 1, instance);
    placed(request, &mesh, instance, 4 + by, out);
}
const struct gn_sweep gn_stability_shear = {
    "shear of a turned instance", "", GN_SWEEP_VALUES(0.01, 0.1, 1, 3, 10, 30, 100, 1e3, 1e4, 1e5, 1e6), 100,
    "the condition is the shear's square: the inverse's second-order error stays below 1/64 of the first", 1000, shear,
    NULL};

/* Along the axes, of a mesh that is as thin as the instance is stretched: the world is an ordinary one. */
static void stretch(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    double by = request->value;
    const double middle[9] = {by, 0, 0, 0, 1, 0, 0, 0, 1 / by};
    struct gn_mesh mesh = blob(request);
    mesh = gn_mesh_scaled(request->arena, &mesh, 1 / by, 1, by, 0, 0, 0);
    float instance[12];
    store(request->random, middle, 1, instance);
    placed(request, &mesh, instance, 4, out);
}
const struct gn_sweep gn_stability_stretch = {
    "stretch along x, and the other way along z", "", GN_SWEEP_DECADES, 1e9,
    "each axis is only another scale, and products of three lengths stay normal", 1000, stretch, NULL};

static void stretch_turned(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    double root = sqrt(request->value);
    const double middle[9] = {root, 0, 0, 0, 1, 0, 0, 0, 1 / root};
    struct gn_mesh mesh = blob(request);
    float instance[12];
    store_turned(request->random, middle, 1, instance);
    placed(request, &mesh, instance, 4 + root, out);
}
const struct gn_sweep gn_stability_stretch_turned = {"condition of a stretch along no axis", "", GN_SWEEP_DECADES,
                                                     GN_SWEEP_CONDITION, CONDITION, 1000, stretch_turned, NULL};

/* Mirrored, and with back or front faces culled for two rays in three: facing is the object's. */
static void mirrored(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    double root = sqrt(request->value);
    const double middle[9] = {root, 0, 0, 0, -1, 0, 0, 0, 1 / root};
    static const uint32_t flags[3] = {0, GN_REF_RAY_CULL_BACK_FACING, GN_REF_RAY_CULL_FRONT_FACING};
    struct gn_mesh mesh = blob(request);
    float instance[12];
    store_turned(request->random, middle, 1, instance);
    placed(request, &mesh, instance, 4 + root, out);
    for (uint32_t i = 0; i < out->ray_count; i++)
        out->rays[i].ray.flags = flags[i % 3];
}
const struct gn_sweep gn_stability_mirrored = {"condition of a mirrored stretch along no axis", "", GN_SWEEP_DECADES,
                                               GN_SWEEP_CONDITION, CONDITION, 1000, mirrored, NULL};

/* The third column is nearly in the plane of the other two. */
static void singular(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    double off = 1 / request->value;
    const double middle[9] = {1, 0, 0.5, 0, 1, -0.5, 0, 0, off};
    struct gn_mesh mesh = blob(request);
    float instance[12];
    store_turned(request->random, middle, 1, instance);
    placed(request, &mesh, instance, 4, out);
}
const struct gn_sweep gn_stability_singular = {"condition of a nearly singular transform", "", GN_SWEEP_DECADES,
                                               GN_SWEEP_CONDITION, CONDITION, 1000, singular, NULL};

static void instance_scale(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    double by = request->value;
    const double middle[9] = {by, 0, 0, 0, by, 0, 0, 0, by};
    struct gn_mesh mesh = blob(request);
    float instance[12];
    store_turned(request->random, middle, by, instance);
    placed(request, &mesh, instance, 4 * by, out);
}
#define CUBES "the determinant is the cube: it has to be normal in f32, with 24 bits below it"
const struct gn_sweep gn_stability_instance_large = {
    "scale of the instance", "",
    GN_SWEEP_VALUES(1, 0x1p5, 0x1p10, 0x1p15, 0x1p20, 0x1p25, 0x1p30, 0x1p35, 0x1p40, 0x1p45, 0x1p50, 0x1p55, 0x1p60),
    GN_SWEEP_CUBE, CUBES, 1000, instance_scale, NULL};
const struct gn_sweep gn_stability_instance_small = {
    "scale of the instance", "",
    GN_SWEEP_VALUES(1, 0x1p-5, 0x1p-10, 0x1p-15, 0x1p-20, 0x1p-25, 0x1p-30, 0x1p-35, 0x1p-40, 0x1p-45, 0x1p-50,
                    0x1p-55, 0x1p-60),
    1 / GN_SWEEP_CUBE, CUBES, 1000, instance_scale, NULL};

/* What the geometry's transform stretches, the instance's shrinks again, but along other axes by its own turns. */
static void two_transforms(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    double root = sqrt(request->value);
    const double stretch_by[9] = {root, 0, 0, 0, 1, 0, 0, 0, 1 / root}, shrink[9] = {1 / root, 0, 0, 0, 1, 0, 0, 0, root};
    struct gn_mesh mesh = blob(request);
    double outer[9], inner[9], middle[9], half[9], first[9], second[9], back[9];
    float geometry[12], instance[12];
    turn(request->random, outer);
    turn(request->random, inner);
    turn(request->random, middle);
    for (int i = 0; i < 9; i++)
        back[i] = middle[3 * (i % 3) + i / 3];
    multiply(middle, stretch_by, half);
    multiply(half, inner, first);
    multiply(outer, shrink, half);
    multiply(half, back, second);
    store(request->random, first, 1, geometry);
    store(request->random, second, 1, instance);
    struct gn_aim_options options = {.geometry_transform = geometry, .instance_transform = instance};
    gn_stability_mesh(request, &mesh, &options, (struct gn_stability_aims){.interior = 4, .edge = 1}, out);
}
const struct gn_sweep gn_stability_two_transforms = {
    "condition of both transforms", "", GN_SWEEP_DECADES, GN_SWEEP_CONDITION, CONDITION, 1000, two_transforms, NULL};

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
