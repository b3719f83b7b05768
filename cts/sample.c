/* SPDX-License-Identifier: Apache-2.0 */
/* Scenes for cases that are about something else than the scene. */
#include "cts/sample.h"

#include <string.h>

enum { BLASES = 4, MESH_INSTANCES = 9, RUNGS = 18 };

static void mesh_blas(struct gn_case_run *run, const struct gn_sample_options *options, uint32_t number,
                      struct gn_cts_blas *out)
{
    struct gn_arena *arena = &run->arena;
    struct gn_random *random = &run->random;
    const uint32_t count = number == 2 ? 3 : 1;
    struct gn_cts_geometry *geometries = GN_NEW(arena, struct gn_cts_geometry, count);
    for (uint32_t g = 0; g < count; g++) {
        struct gn_mesh mesh = number == 0   ? gn_mesh_triangle(arena)
                              : number == 1 ? gn_mesh_height_field(arena, random, 24, 0.3)
                              : number == 2 ? gn_mesh_blob(arena, random, 5 + 2 * g, 9, 0.2)
                                            : gn_mesh_soup(arena, random, 60, 0.6);
        geometries[g] = gn_geometry_of_mesh(&mesh);
        if (options->content == GN_SAMPLE_MESHES || (options->content == GN_SAMPLE_MIXED && gn_random_below(random, 2)))
            geometries[g].flags = VK_GEOMETRY_OPAQUE_BIT_KHR;
        geometries[g].index_none = g == 1;
        if (gn_steps_take_both(options->steps))
            geometries[g].initial_positions = gn_mesh_moved(arena, random, &mesh, 0.5);
        if (g == 2) {
            float *transform = GN_NEW(arena, float, 12), *initial = GN_NEW(arena, float, 12);
            gn_transform_random(random, 0.5, 1, 1, true, transform);
            gn_transform_random(random, 0.5, 1, 1, false, initial);
            geometries[g].transform = transform;
            geometries[g].initial_transform = gn_steps_take_both(options->steps) ? initial : NULL;
        }
    }
    *out = (struct gn_cts_blas){.geometries = geometries, .geometry_count = count};
}

static void box_blas(struct gn_case_run *run, const struct gn_sample_options *options, const float (*ladder)[6],
                     struct gn_cts_blas *out)
{
    struct gn_cts_geometry *geometry = GN_NEW(&run->arena, struct gn_cts_geometry, 1);
    float(*initial)[6] = gn_arena_alloc(&run->arena, RUNGS, sizeof *initial);
    for (uint32_t i = 0; i < RUNGS; i++)
        memcpy(initial[i], ladder[RUNGS - 1 - i], sizeof initial[i]);
    *geometry = (struct gn_cts_geometry){.type = GN_REF_AABBS,
                                         .aabbs = ladder,
                                         .aabb_count = RUNGS,
                                         .initial_aabbs = gn_steps_take_both(options->steps) ? (const float(*)[6])initial
                                                                                       : NULL};
    *out = (struct gn_cts_blas){.geometries = geometry, .geometry_count = 1};
}

static uint32_t instance_flags(struct gn_random *random)
{
    static const VkGeometryInstanceFlagsKHR flags[] = {
        0, VK_GEOMETRY_INSTANCE_TRIANGLE_FLIP_FACING_BIT_KHR, VK_GEOMETRY_INSTANCE_TRIANGLE_FACING_CULL_DISABLE_BIT_KHR,
        VK_GEOMETRY_INSTANCE_FORCE_OPAQUE_BIT_KHR, VK_GEOMETRY_INSTANCE_FORCE_NO_OPAQUE_BIT_KHR};
    return flags[gn_random_below(random, 5)];
}

void gn_sample_make(struct gn_case_run *run, const struct gn_sample_options *options, struct gn_sample *out)
{
    struct gn_arena *arena = &run->arena;
    struct gn_random *random = &run->random;
    const bool boxes = options->content == GN_SAMPLE_BOXES || options->content == GN_SAMPLE_MIXED;
    const bool meshes = options->content != GN_SAMPLE_BOXES;
    struct gn_cts_blas *blases = GN_NEW(arena, struct gn_cts_blas, BLASES + 1);
    struct gn_cts_instance *instances = GN_NEW(arena, struct gn_cts_instance, MESH_INSTANCES + 1);
    struct gn_cts_instance *initial = GN_NEW(arena, struct gn_cts_instance, MESH_INSTANCES + 1);
    uint32_t blas_count = 0, instance_count = 0;
    for (uint32_t b = 0; meshes && b < BLASES; b++)
        mesh_blas(run, options, b, &blases[blas_count++]);
    for (uint32_t i = 0; meshes && i < MESH_INSTANCES; i++) {
        struct gn_cts_instance *instance = &instances[instance_count];
        *instance = gn_instance_of(i % BLASES, NULL);
        gn_transform_random(random, 0.6, 1.3, 2.5, i % 3 == 2, instance->transform);
        instance->custom_index = gn_random_below(random, 1u << 24);
        instance->sbt_offset = 64 * i + gn_random_below(random, 8); /* apart by more than a structure's records */
        instance->flags = options->content == GN_SAMPLE_MIXED ? instance_flags(random) : 0;
        initial[instance_count] = *instance;
        gn_transform_random(random, 0.6, 1.3, 2.5, false, initial[instance_count].transform);
        instance_count++;
    }
    const float(*ladder)[6] = gn_ladder_make(arena, random, RUNGS, 0.5);
    if (boxes) {
        box_blas(run, options, ladder, &blases[blas_count]);
        instances[instance_count] = initial[instance_count] = gn_instance_of(blas_count, NULL);
        instances[instance_count].sbt_offset = initial[instance_count].sbt_offset = 64 * MESH_INSTANCES;
        blas_count++;
        instance_count++;
    }
    for (uint32_t b = 0; b < blas_count; b++) {
        blases[b].build_flags = options->flags;
        memcpy(blases[b].steps, options->steps, sizeof blases[b].steps);
    }
    out->scene = gn_scene_make(blases, blas_count, instances, instance_count);
    if (!options->blases_only) {
        /* What makes data accessible is of no use above. */
        out->scene.tlas_build_flags = options->flags & ~(VkFlags)VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_DATA_ACCESS_KHR;
        memcpy(out->scene.tlas_steps, options->steps, sizeof out->scene.tlas_steps);
        out->scene.initial_instances = gn_steps_take_both(options->steps) ? initial : NULL;
    }
    out->ray_count = gn_ray_count(run, options->rays ? options->rays : 4096);
    out->rays = GN_NEW(arena, struct gn_cts_ray, out->ray_count);
    const uint32_t through = !boxes ? 0 : meshes ? out->ray_count / 3 : out->ray_count;
    gn_ladder_rays(random, ladder, RUNGS, true, out->rays, through);
    if (meshes)
        gn_rays_at_scene(run, &out->scene, 2.5, true, out->rays + through, out->ray_count - through);
    for (uint32_t i = 0; i < out->ray_count; i++) {
        static const uint32_t flags[] = {0,
                                         0,
                                         GN_REF_RAY_CULL_BACK_FACING,
                                         GN_REF_RAY_CULL_FRONT_FACING,
                                         GN_REF_RAY_OPAQUE,
                                         GN_REF_RAY_CULL_OPAQUE,
                                         GN_REF_RAY_CULL_NO_OPAQUE,
                                         GN_REF_RAY_SKIP_TRIANGLES,
                                         GN_REF_RAY_SKIP_AABBS};
        if (options->content == GN_SAMPLE_MIXED)
            out->rays[i].ray.flags = flags[gn_random_below(random, sizeof flags / sizeof flags[0])];
        if (options->content != GN_SAMPLE_MESHES)
            out->rays[i].policy.confirm_mask = (uint32_t)gn_random_u64(random);
    }
}

void gn_sample_trace(struct gn_case_run *run, const struct gn_sample_options *options)
{
    struct gn_sample sample;
    gn_sample_make(run, options, &sample);
    gn_case_trace(run, &sample.scene, GN_CTS_COMMITTED, sample.rays, sample.ray_count, 0);
}
