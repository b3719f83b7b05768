/* SPDX-License-Identifier: Apache-2.0 */
/* The scenes that are rendered. */
#include <math.h>
#include <string.h>

#include "cts/accuracy_model.h"
#include "cts/compose.h"
#include "cts/render.h"

#define OPAQUE VK_GEOMETRY_OPAQUE_BIT_KHR

const char *const gn_render_names[] = {"cubes", "landscape", "forest"};
const size_t gn_render_count = sizeof gn_render_names / sizeof gn_render_names[0];

/* A part of a scene under construction: structures and instances are added one by one. */
struct builder {
    struct gn_arena *arena;
    struct gn_cts_blas *blases;
    struct gn_cts_instance *instances;
    uint32_t blas_count, instance_count;
};

static struct builder builder_make(struct gn_arena *arena, uint32_t blases, uint32_t instances)
{
    return (struct builder){arena, GN_NEW(arena, struct gn_cts_blas, blases),
                            GN_NEW(arena, struct gn_cts_instance, instances), 0, 0};
}

static uint32_t mesh_add(struct builder *builder, const struct gn_mesh *mesh, VkGeometryFlagsKHR flags)
{
    struct gn_cts_geometry *geometry = GN_NEW(builder->arena, struct gn_cts_geometry, 1);
    *geometry = gn_geometry_of_mesh(mesh);
    geometry->flags = flags;
    geometry->index_uint32 = true;
    builder->blases[builder->blas_count] =
        (struct gn_cts_blas){.geometries = geometry,
                             .geometry_count = 1,
                             .build_flags = VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR};
    return builder->blas_count++;
}

/* One box, which holds the unit sphere. */
static uint32_t sphere_add(struct builder *builder)
{
    static const float box[1][6] = {{-1, -1, -1, 1, 1, 1}};
    struct gn_cts_geometry *geometry = GN_NEW(builder->arena, struct gn_cts_geometry, 1);
    *geometry = (struct gn_cts_geometry){.type = GN_REF_AABBS, .aabbs = box, .aabb_count = 1};
    builder->blases[builder->blas_count] = (struct gn_cts_blas){.geometries = geometry, .geometry_count = 1};
    return builder->blas_count++;
}

/* Turned by `angle` about the z axis, scaled, and moved. */
static void instance_add(struct builder *builder, uint32_t blas, uint32_t material, double angle, double sx, double sy,
                         double sz, double x, double y, double z)
{
    struct gn_cts_instance *instance = &builder->instances[builder->instance_count++];
    *instance = gn_instance_of(blas, NULL);
    const float transform[12] = {(float)(cos(angle) * sx), (float)(-sin(angle) * sy), 0,         (float)x,
                                 (float)(sin(angle) * sx), (float)(cos(angle) * sy),  0,         (float)y,
                                 0,                        0,                         (float)sz, (float)z};
    memcpy(instance->transform, transform, sizeof transform);
    instance->custom_index = material;
}

static void finish(const struct builder *builder, struct gn_render_scene *out)
{
    out->scene = gn_scene_make(builder->blases, builder->blas_count, builder->instances, builder->instance_count);
    out->scene.tlas_build_flags = VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR;
}

/* 24 vertices and 36 indices: a cube whose faces share no vertices. */
static struct gn_mesh cube(struct gn_arena *arena)
{
    struct gn_mesh mesh = {gn_arena_alloc(arena, 24, sizeof(double[3])), 24, gn_arena_alloc(arena, 12, sizeof(uint32_t[3])),
                           12};
    for (uint32_t face = 0; face < 6; face++) {
        const uint32_t axis = face / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
        const double side = face % 2 ? 1 : -1;
        static const double square[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
        for (uint32_t c = 0; c < 4; c++) {
            double *corner = mesh.positions[4 * face + c];
            corner[axis] = side;
            corner[u] = square[c][0];
            corner[v] = square[c][1] * side;
        }
        const uint32_t indices[2][3] = {{0, 1, 2}, {0, 2, 3}};
        for (uint32_t t = 0; t < 6; t++)
            mesh.triangles[2 * face + t / 3][t % 3] = 4 * face + indices[t / 3][t % 3];
    }
    return mesh;
}

/* Four cubes, a mirrored ground, a cube of glass that parts colours, a sphere; two lights with extent. */
static void make_cubes(struct gn_arena *arena, struct gn_render_scene *out)
{
    static const struct gn_render_material materials[] = {
        {.colour = {0.85f, 0.25f, 0.2f}},
        {.colour = {0.2f, 0.6f, 0.3f}, .checkered = true},
        {.colour = {0.25f, 0.35f, 0.85f}},
        {.colour = {0.9f, 0.75f, 0.25f}, .checkered = true},
        {.colour = {0.55f, 0.55f, 0.6f}, .mirror = 0.35f, .checkered = true},
        {.colour = {0.95f, 0.98f, 1}, .glass = true, .index = 1.5f, .spread = 0.08f},
        {.colour = {0.9f, 0.9f, 0.9f}, .mirror = 0.4f},
    };
    static const struct gn_render_light lights[] = {{{6, -5, 9}, 1.2, {1.9f, 1.8f, 1.6f}},
                                                    {{-7, -3, 7}, 0.6, {0.9f, 1.0f, 1.3f}}};
    struct builder builder = builder_make(arena, 3, 7);
    const struct gn_mesh mesh = cube(arena), quad = gn_mesh_quad(arena);
    const uint32_t box = mesh_add(&builder, &mesh, OPAQUE), ground = mesh_add(&builder, &quad, OPAQUE),
                   sphere = sphere_add(&builder);
    instance_add(&builder, box, 0, 0.4, 0.8, 0.8, 0.8, -2.6, 1.2, 0.8);
    instance_add(&builder, box, 1, -0.3, 0.6, 0.6, 1.2, 0.2, 2.6, 1.2);
    instance_add(&builder, box, 2, 1.1, 0.7, 0.7, 0.7, 2.7, 1.4, 0.7);
    instance_add(&builder, box, 3, 0.8, 0.5, 0.5, 0.5, -1.4, -1.6, 0.5);
    instance_add(&builder, ground, 4, 0, 12, 12, 1, 0, 0, 0);
    instance_add(&builder, sphere, 6, 0, 0.8, 0.8, 0.8, -0.7, 0.4, 0.8);
    instance_add(&builder, box, 5, 0.5, 0.7, 0.7, 0.9, 1.3, -0.9, 0.91);
    *out = (struct gn_render_scene){.name = "cubes",
                                    .text = "cubes, one of glass, and a sphere on a mirrored ground",
                                    .materials = materials,
                                    .material_count = sizeof materials / sizeof materials[0],
                                    .lights = lights,
                                    .light_count = 2,
                                    .ambient = {0.12f, 0.12f, 0.14f},
                                    .sky_low = {0.75f, 0.8f, 0.9f},
                                    .sky_high = {0.25f, 0.45f, 0.8f},
                                    .eye = {1.2, -7.5, 3.4},
                                    .at = {0, 0, 0.7},
                                    .field = 45};
    finish(&builder, out);
}

/* A height field under a point light: nothing but hard shadows is called for. */
static void make_landscape(struct gn_arena *arena, struct gn_render_scene *out)
{
    enum { CELLS = 96 };
    static const struct gn_render_material materials[] = {{.colour = {0.45f, 0.55f, 0.3f}}};
    static const struct gn_render_light lights[] = {{{-14, -6, 6}, 0, {1.5f, 1.4f, 1.2f}}};
    struct gn_random random = {7};
    struct gn_mesh mesh = gn_mesh_height_field(arena, &random, CELLS, 0.02);
    for (uint32_t i = 0; i < mesh.position_count; i++) {
        double *p = mesh.positions[i];
        double height = 0, scale = 0.24;
        for (int octave = 0; octave < 5; octave++, scale /= 2.1)
            height += scale * sin((3 + 2.3 * octave) * p[0] + 1.7 * octave) * cos((2.6 + 2.7 * octave) * p[1] - octave);
        p[2] = (float)(p[2] + height);
    }
    struct builder builder = builder_make(arena, 1, 1);
    instance_add(&builder, mesh_add(&builder, &mesh, OPAQUE), 0, 0, 6, 6, 4, 0, 0, 0);
    *out = (struct gn_render_scene){.name = "landscape",
                                    .text = "a height field of 18,432 triangles under a low point light",
                                    .materials = materials,
                                    .material_count = 1,
                                    .lights = lights,
                                    .light_count = 1,
                                    .ambient = {0.15f, 0.17f, 0.22f},
                                    .sky_low = {0.95f, 0.85f, 0.75f},
                                    .sky_high = {0.35f, 0.5f, 0.8f},
                                    .eye = {0, -8.5, 4},
                                    .at = {0, 0, -0.4},
                                    .field = 48};
    finish(&builder, out);
}

/* Crowns of spheres on trunks of triangles, bushes with holes, under a point light. */
static void make_forest(struct gn_arena *arena, struct gn_render_scene *out)
{
    enum { TREES = 48, BUSHES = 24 };
    static const struct gn_render_material materials[] = {{.colour = {0.35f, 0.3f, 0.2f}},
                                                          {.colour = {0.4f, 0.28f, 0.18f}},
                                                          {.colour = {0.2f, 0.5f, 0.2f}},
                                                          {.colour = {0.45f, 0.6f, 0.25f}, .holes = true}};
    static const struct gn_render_light lights[] = {{{9, -8, 14}, 0, {1.6f, 1.5f, 1.3f}}};
    struct gn_random random = {11};
    struct builder builder = builder_make(arena, 4, 1 + 2 * TREES + BUSHES);
    const struct gn_mesh quad = gn_mesh_quad(arena), trunk = gn_mesh_box(arena, 1), bush = gn_mesh_octahedron(arena, 2);
    const uint32_t ground = mesh_add(&builder, &quad, OPAQUE), wood = mesh_add(&builder, &trunk, OPAQUE),
                   leaves = mesh_add(&builder, &bush, 0), crown = sphere_add(&builder);
    instance_add(&builder, ground, 0, 0, 14, 14, 1, 0, 0, 0);
    for (uint32_t i = 0; i < TREES; i++) {
        const double x = (i % 8 - 3.5) * 2.1 + gn_random_range(&random, -0.6, 0.6);
        const double y = (i / 8) * 2.2 - 3 + gn_random_range(&random, -0.6, 0.6), high = gn_random_range(&random, 0.7, 1.5);
        const double wide = gn_random_range(&random, 0.5, 0.9);
        instance_add(&builder, wood, 1, gn_random_range(&random, 0, 3), 0.12, 0.12, high / 2, x, y, high / 2);
        instance_add(&builder, crown, 2, gn_random_range(&random, 0, 3), wide, wide * 0.9, wide * 1.2, x, y, high + wide);
    }
    for (uint32_t i = 0; i < BUSHES; i++)
        instance_add(&builder, leaves, 3, gn_random_range(&random, 0, 3), 0.45, 0.45, 0.4,
                     gn_random_range(&random, -8, 8), gn_random_range(&random, -5, 4), 0.35);
    *out = (struct gn_render_scene){.name = "forest",
                                    .text = "instanced trees of boxed spheres and triangles, and bushes with holes",
                                    .materials = materials,
                                    .material_count = 4,
                                    .lights = lights,
                                    .light_count = 1,
                                    .ambient = {0.16f, 0.18f, 0.2f},
                                    .sky_low = {0.8f, 0.85f, 0.9f},
                                    .sky_high = {0.4f, 0.6f, 0.9f},
                                    .eye = {0, -11, 5.5},
                                    .at = {0, 0, 0.6},
                                    .field = 48};
    finish(&builder, out);
}

bool gn_render_make(struct gn_arena *arena, const char *name, struct gn_render_scene *out)
{
    static void (*const makers[])(struct gn_arena *, struct gn_render_scene *) = {make_cubes, make_landscape, make_forest};
    for (size_t i = 0; i < gn_render_count; i++)
        if (strcmp(gn_render_names[i], name) == 0) {
            makers[i](arena, out);
            return true;
        }
    return false;
}

bool gn_render_make_model(struct gn_arena *arena, const char *path, struct gn_render_scene *out, char *out_error,
                          size_t error_size)
{
    static const struct gn_render_material materials[] = {{.colour = {0.7f, 0.65f, 0.6f}},
                                                          {.colour = {0.5f, 0.5f, 0.55f}, .mirror = 0.25f}};
    struct gn_model model;
    if (!gn_model_read(path, 0, arena, &model, out_error, error_size))
        return false;
    struct builder builder = builder_make(arena, model.mesh_count + 1, model.instance_count + 1);
    double low[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, high[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL}, size = 0;
    for (uint32_t m = 0; m < model.mesh_count; m++)
        mesh_add(&builder, &model.meshes[m], OPAQUE);
    for (uint32_t i = 0; i < model.instance_count; i++) {
        const struct gn_model_instance *from = &model.instances[i];
        struct gn_cts_instance *instance = &builder.instances[builder.instance_count++];
        *instance = gn_instance_of(from->mesh, from->transform);
        instance->custom_index = 0;
        for (uint32_t v = 0; v < model.meshes[from->mesh].position_count; v++) {
            double point[3];
            gn_transform_point(from->transform, model.meshes[from->mesh].positions[v], point);
            for (int a = 0; a < 3; a++) {
                low[a] = fmin(low[a], point[a]);
                high[a] = fmax(high[a], point[a]);
            }
        }
    }
    if (!gn_model_size_check(path, low, high, out_error, error_size))
        return false;
    for (int a = 0; a < 3; a++)
        size = fmax(size, high[a] - low[a]);
    struct gn_render_light *light = GN_NEW(arena, struct gn_render_light, 1);
    *light = (struct gn_render_light){.radius = size / 8, .colour = {1.7f, 1.6f, 1.5f}};
    *out = (struct gn_render_scene){.name = path,
                                    .text = "a model on a mirrored ground under a light with extent",
                                    .materials = materials,
                                    .material_count = 2,
                                    .lights = light,
                                    .light_count = 1,
                                    .ambient = {0.15f, 0.15f, 0.17f},
                                    .sky_low = {0.8f, 0.85f, 0.9f},
                                    .sky_high = {0.35f, 0.5f, 0.8f},
                                    .field = 42};
    static const double from[3] = {0.9, -1.6, 0.8}, above[3] = {1.2, -1.4, 2.2};
    for (int a = 0; a < 3; a++) {
        out->at[a] = (low[a] + high[a]) / 2;
        out->eye[a] = out->at[a] + size * from[a];
        light->position[a] = out->at[a] + size * above[a];
    }
    const struct gn_mesh quad = gn_mesh_quad(arena);
    instance_add(&builder, mesh_add(&builder, &quad, OPAQUE), 1, 0, 6 * size, 6 * size, 1, out->at[0], out->at[1], low[2]);
    finish(&builder, out);
    return true;
}
