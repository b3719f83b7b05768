/* SPDX-License-Identifier: Apache-2.0 */
/* The scenes of `gnomon accuracy`, and rays that are aimed at their triangles. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cts/accuracy.h"
#include "cts/results.h"

const char *gn_accuracy_aim_name(enum gn_aim aim)
{
    static const char *const names[GN_AIM_COUNT] = {"interior", "edge", "vertex", "random"};
    return names[aim];
}

static void set_single(struct gn_accuracy_scene *scene, struct gn_arena *arena, struct gn_mesh mesh)
{
    scene->model.meshes = GN_NEW(arena, struct gn_mesh, 1);
    scene->model.meshes[0] = mesh;
    scene->model.mesh_count = 1;
    scene->model.instances = GN_NEW(arena, struct gn_model_instance, 1);
    memcpy(scene->model.instances[0].transform, gn_identity, sizeof gn_identity);
    scene->model.instance_count = 1;
}

static void make_terrain(struct gn_accuracy_scene *scene, struct gn_arena *arena, struct gn_random *random,
                         bool quick)
{
    uint32_t n = quick ? 48 : 256;
    set_single(scene, arena, gn_mesh_height_field(arena, random, n, 2.0 / n));
}

static void make_terrain_large(struct gn_accuracy_scene *scene, struct gn_arena *arena,
                               struct gn_random *random, bool quick)
{
    uint32_t n = quick ? 96 : 1024;
    set_single(scene, arena, gn_mesh_height_field(arena, random, n, 2.0 / n));
}

static void make_blob(struct gn_accuracy_scene *scene, struct gn_arena *arena, struct gn_random *random,
                      bool quick)
{
    set_single(scene, arena, gn_mesh_blob(arena, random, quick ? 24 : 181, quick ? 64 : 362, 0.01));
}

static void make_slivers(struct gn_accuracy_scene *scene, struct gn_arena *arena, struct gn_random *random,
                         bool quick)
{
    uint32_t n = quick ? 32 : 256;
    struct gn_mesh square = gn_mesh_height_field(arena, random, n, 2.0 / n);
    set_single(scene, arena, gn_mesh_scaled(arena, &square, 1, 1e-3, 1e-2, 0, 0, 0));
}

static void make_instances(struct gn_accuracy_scene *scene, struct gn_arena *arena, struct gn_random *random,
                           bool quick)
{
    uint32_t side = quick ? 3 : 6, count = side * side * side;
    set_single(scene, arena, gn_mesh_blob(arena, random, quick ? 10 : 24, quick ? 16 : 64, 0.1));
    scene->model.instances = GN_NEW(arena, struct gn_model_instance, count);
    scene->model.instance_count = count;
    for (uint32_t i = 0; i < count; i++) {
        float *m = scene->model.instances[i].transform;
        /* Every third is stretched a hundredfold more one way than another, every second is mirrored. */
        double least = i % 3 == 0 ? 0.01 : 0.2;
        gn_transform_general(random, least, 1, i % 3 == 1 ? 2 : 0.5, 0, i % 2 == 1, m);
        uint32_t cell[3] = {i % side, i / side % side, i / side / side};
        for (int c = 0; c < 3; c++)
            m[4 * c + 3] = (float)(2.0 * cell[c] - side + gn_random_range(random, 0.8, 1.2));
    }
}

static void make_far(struct gn_accuracy_scene *scene, struct gn_arena *arena, struct gn_random *random,
                     bool quick)
{
    uint32_t n = quick ? 32 : 256;
    struct gn_mesh near = gn_mesh_height_field(arena, random, n, 2.0 / n);
    set_single(scene, arena, gn_mesh_scaled(arena, &near, 100, 100, 100, 1e5, -2e5, 1e5));
}

static void make_soup(struct gn_accuracy_scene *scene, struct gn_arena *arena, struct gn_random *random,
                      bool quick)
{
    uint32_t count = quick ? 4000 : 131072;
    set_single(scene, arena, gn_mesh_soup(arena, random, count, quick ? 0.1 : 0.04));
}

static const struct {
    const char *name, *about;
    void (*make)(struct gn_accuracy_scene *scene, struct gn_arena *arena, struct gn_random *random,
                 bool quick);
} scenes[] = {
    {"terrain", "a height field with shared vertices", make_terrain},
    {"terrain-2m", "the same, larger than the caches hold", make_terrain_large},
    {"blob", "a closed mesh with shared vertices, seen from outside", make_blob},
    {"slivers", "a height field squeezed a thousandfold along one axis", make_slivers},
    {"instances", "a grid of instances: sheared, stretched up to 100:1, mirrored", make_instances},
    {"far", "a height field 200 wide, 200,000 away from the origin", make_far},
    {"soup", "triangles that share nothing, in any orientation", make_soup},
};

bool gn_accuracy_scene_describe(size_t number, const char **out_name, const char **out_about)
{
    if (number >= sizeof scenes / sizeof scenes[0])
        return false;
    *out_name = scenes[number].name;
    *out_about = scenes[number].about;
    return true;
}

/* The world's box around all instances. */
static void bounds_of(const struct gn_accuracy_scene *scene, double low[3], double high[3])
{
    for (int c = 0; c < 3; c++) {
        low[c] = INFINITY;
        high[c] = -INFINITY;
    }
    for (uint32_t i = 0; i < scene->model.instance_count; i++) {
        const struct gn_model_instance *instance = &scene->model.instances[i];
        const struct gn_mesh *mesh = &scene->model.meshes[instance->mesh];
        for (uint32_t v = 0; v < mesh->position_count; v++) {
            double p[3];
            gn_transform_point(instance->transform, mesh->positions[v], p);
            for (int c = 0; c < 3; c++) {
                low[c] = fmin(low[c], p[c]);
                high[c] = fmax(high[c], p[c]);
            }
        }
    }
}

bool gn_accuracy_scene_load(struct gn_accuracy_scene *scene, const char *name, bool quick, uint64_t seed,
                            struct gn_arena *arena, int *out_exit_status, char *out_error, size_t error_size)
{
    *scene = (struct gn_accuracy_scene){.name = name};
    *out_exit_status = 2;
    for (size_t i = 0; i < sizeof scenes / sizeof scenes[0]; i++) {
        if (strcmp(scenes[i].name, name) != 0)
            continue;
        struct gn_random random = {seed * 1000 + i};
        scene->name = scenes[i].name;
        scene->about = scenes[i].about;
        scenes[i].make(scene, arena, &random, quick);
    }
    if (!scene->about) {
        if (!gn_model_is_file_name(name)) {
            int used = snprintf(out_error, error_size, "there is no scene '%s'; there are", name);
            for (size_t i = 0; i < sizeof scenes / sizeof scenes[0] && used > 0 && (size_t)used < error_size;
                 i++)
                used += snprintf(out_error + used, error_size - (size_t)used, "%s %s", i ? "," : "",
                                 scenes[i].name);
            if (used > 0 && (size_t)used < error_size)
                snprintf(out_error + used, error_size - (size_t)used,
                         ", and model files ending in .obj, .ply, .gltf, .glb or .stl");
            return false;
        }
        if (!gn_model_read(name, 0, arena, &scene->model, out_error, error_size))
            return false;
        const char *slash = strrchr(name, '/');
        char *shown = gn_arena_printf(arena, "%s", slash ? slash + 1 : name);
        gn_text_clean(shown);
        scene->name = shown;
        scene->about =
            gn_arena_printf(arena, "a model file of %u mesh%s and %u instance%s", scene->model.mesh_count,
                            scene->model.mesh_count == 1 ? "" : "es", scene->model.instance_count,
                            scene->model.instance_count == 1 ? "" : "s");
    }
    scene->triangles_up_to = GN_NEW(arena, uint64_t, scene->model.instance_count);
    for (uint32_t i = 0; i < scene->model.instance_count; i++) {
        scene->triangles += scene->model.meshes[scene->model.instances[i].mesh].triangle_count;
        scene->triangles_up_to[i] = scene->triangles;
    }
    if (scene->triangles > (uint64_t)100 * 1000 * 1000) {
        snprintf(out_error, error_size,
                 "%s: %llu triangles over all instances, but at most 100,000,000 are traced", name,
                 (unsigned long long)scene->triangles);
        return false;
    }
    double low[3], high[3], size = 0;
    bounds_of(scene, low, high);
    for (int c = 0; c < 3; c++)
        size = fmax(size, high[c] - low[c]);
    if (!gn_model_size_check(name, low, high, out_error, error_size))
        return false;
    scene->distance = 1.5 * size;
    return true;
}

bool gn_accuracy_scene_commit(struct gn_accuracy_scene *scene, char *out_error, size_t error_size)
{
    const struct gn_model *model = &scene->model;
    uint32_t *blases = calloc(model->mesh_count, sizeof *blases);
    struct gn_ref_scene *reference = gn_ref_scene_create();
    const char *why = "out of memory";
    if (!blases || !reference)
        goto fail;
    for (uint32_t i = 0; i < model->mesh_count; i++) {
        const struct gn_mesh *mesh = &model->meshes[i];
        struct gn_ref_geometry geometry = {.type = GN_REF_TRIANGLES,
                                           .flags = GN_REF_GEOMETRY_OPAQUE,
                                           .primitive_count = mesh->triangle_count,
                                           .positions = (const double(*)[3])mesh->positions,
                                           .position_count = mesh->position_count,
                                           .divisor = 1,
                                           .triangles = (const uint32_t(*)[3])mesh->triangles};
        if (!gn_ref_scene_add_blas(reference, &geometry, 1, &blases[i]))
            goto fail_scene;
    }
    for (uint32_t i = 0; i < model->instance_count; i++) {
        struct gn_ref_instance instance = {
            .custom_index = i & 0xFFFFFF, .mask = 0xFF, .blas = blases[model->instances[i].mesh]};
        memcpy(instance.transform, model->instances[i].transform, sizeof instance.transform);
        if (!gn_ref_scene_add_instance(reference, &instance))
            goto fail_scene;
    }
    if (!gn_ref_scene_commit(reference))
        goto fail_scene;
    free(blases);
    scene->reference = reference;
    return true;
fail_scene:
    why = gn_ref_scene_error(reference);
fail:
    snprintf(out_error, error_size, "scene %s: %s", scene->name, why);
    gn_ref_scene_destroy(reference);
    free(blases);
    return false;
}

void gn_accuracy_scene_finish(struct gn_accuracy_scene *scene)
{
    gn_ref_scene_destroy(scene->reference);
    scene->reference = NULL;
}

/* The instance that has the triangle of that number. */
static uint32_t instance_with(const struct gn_accuracy_scene *scene, uint64_t triangle)
{
    uint32_t low = 0, high = scene->model.instance_count - 1;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (triangle < scene->triangles_up_to[middle])
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

void gn_accuracy_rays(const struct gn_accuracy_scene *scene, enum gn_aim aim, uint64_t seed,
                      struct gn_ref_ray *rays, uint32_t count)
{
    enum { BLOCK = 256 };
    struct gn_random random = {seed * 8 + (uint64_t)aim};
    struct gn_cts_ray block[BLOCK];
    double corners[2][3];
    struct gn_mesh box = {.positions = corners, .position_count = 2};
    struct gn_aim_options options = {.aim = aim, .distance = scene->distance};
    bounds_of(scene, corners[0], corners[1]);
    /* An instance has a share of the rays by its triangles, in small blocks so that many have their turn. */
    uint32_t step = scene->model.instance_count > 1 ? 16 : BLOCK;
    for (uint32_t done = 0; done < count; done += step) {
        uint32_t now = count - done < step ? count - done : step;
        const struct gn_mesh *mesh = &box;
        if (aim != GN_AIM_RANDOM) {
            uint32_t i = instance_with(scene, (uint64_t)(gn_random_unit(&random) * (double)scene->triangles));
            mesh = &scene->model.meshes[scene->model.instances[i].mesh];
            options.instance_transform = scene->model.instances[i].transform;
        }
        gn_rays_aimed_with(&random, mesh, &options, block, now);
        for (uint32_t i = 0; i < now; i++)
            rays[done + i] = block[i].ray;
    }
    /* Neighbours in the order would be neighbours in space, where instances come block by block. */
    for (uint32_t i = count; i > 1; i--) {
        uint32_t other = gn_random_below(&random, i);
        struct gn_ref_ray swapped = rays[i - 1];
        rays[i - 1] = rays[other];
        rays[other] = swapped;
    }
}
