/* SPDX-License-Identifier: Apache-2.0 */
/* Random scenes of everything that can be built, and rays at what is hard about them. */
#include <math.h>
#include <string.h>

#include "cts/compose.h"
#include "cts/fuzz.h"
#include "cts/mesh_case.h"

enum { MAX_BLASES = 4, MAX_GEOMETRIES = 4, MAX_INSTANCES = 12, RAYS = 192 };

/* What this trial mixes in. Rare enough that one failing ingredient does not hide the others. */
struct mixture {
    bool inactive, first_vertex, offsets, formats, updates, copies, transforms, geometry_transforms, shared;
};

struct maker {
    struct gn_random *random;
    struct gn_arena *arena;
    const struct gn_device_info *info;
    struct mixture mixture;
    struct gn_mesh meshes[MAX_BLASES][MAX_GEOMETRIES]; /* of triangles; no positions: boxes */
};

static bool chance(struct gn_random *random, double share)
{
    return gn_random_unit(random) < share;
}

static void transform_random(struct gn_random *random, double translation, float out[12])
{
    struct gn_transform_spec spec = {.kind = (enum gn_transform_kind)(GN_TRANSFORM_RANDOM + gn_random_below(random, 3)),
                                     .min_scale = gn_random_range(random, 0.2, 1),
                                     .shear = gn_random_unit(random),
                                     .translation = translation,
                                     .mirrored = gn_random_below(random, 2)};
    spec.max_scale = spec.min_scale * gn_random_range(random, 1, 4);
    gn_transform_of(random, &spec, out);
}

static struct gn_mesh mesh_random(struct maker *maker)
{
    struct gn_random *random = maker->random;
    const uint32_t n = 1 + gn_random_below(random, 6);
    const struct gn_mesh_spec specs[] = {
        {GN_MESH_HEIGHT_FIELD, 2 * n, 0, gn_random_range(random, 0, 0.4)},
        {GN_MESH_LATTICE, 2u << n % 3, 0, 0.125},
        {GN_MESH_BLOB, 2 + n, 3 + n, gn_random_range(random, 0, 0.6)},
        {GN_MESH_TORUS, 5 + n, 4 + n, gn_random_range(random, 0.2, 0.8)},
        {GN_MESH_BOX, 1u << n % 3, 0, 0},
        {GN_MESH_FAN, 3 + n, 0, gn_random_range(random, 0, 1)},
        {GN_MESH_SOUP, 3 * n * n, 0, gn_random_range(random, 0.2, 1.5)},
        {GN_MESH_QUAD, 0, 0, 0},
        {GN_MESH_TRIANGLE, 0, 0, 0},
    };
    struct gn_mesh mesh =
        gn_mesh_of(maker->arena, random, &specs[gn_random_below(random, sizeof specs / sizeof specs[0])]);
    if (maker->mixture.inactive && chance(random, 0.5)) {
        mesh = gn_mesh_unshared(maker->arena, &mesh);
        gn_mesh_deactivate(random, &mesh, gn_random_unit(random));
    }
    return mesh;
}

static void triangles_random(struct maker *maker, struct gn_mesh *out_mesh, struct gn_cts_geometry *out,
                             bool updated)
{
    static const VkFormat formats[] = {VK_FORMAT_R16G16B16A16_SFLOAT, VK_FORMAT_R16G16B16A16_SNORM,
                                       VK_FORMAT_R32G32_SFLOAT, VK_FORMAT_R16G16_SFLOAT, VK_FORMAT_R16G16_SNORM};
    struct gn_random *random = maker->random;
    const struct mixture *mixture = &maker->mixture;
    *out_mesh = mesh_random(maker);
    *out = gn_geometry_of_mesh(out_mesh);
    out->flags = chance(random, 0.6) ? VK_GEOMETRY_OPAQUE_BIT_KHR
                                     : (chance(random, 0.3) ? VK_GEOMETRY_NO_DUPLICATE_ANY_HIT_INVOCATION_BIT_KHR : 0);
    if (mixture->geometry_transforms && chance(random, 0.5)) {
        float *transform = GN_NEW(maker->arena, float, 12);
        transform_random(random, 1, transform);
        out->transform = transform;
    }
    if (updated && chance(random, 0.7))
        out->initial_positions = gn_mesh_moved(maker->arena, random, out_mesh, 0.4);
    if (mixture->formats && !mixture->inactive && chance(random, 0.6))
        out->vertex_format = formats[gn_random_below(random, 5)];
    out->index_uint32 = chance(random, 0.3);
    out->index_none = chance(random, 0.2);
    if (mixture->first_vertex)
        out->first_vertex = gn_random_below(random, 4);
    if (mixture->offsets) {
        const uint32_t component = out->vertex_format == VK_FORMAT_UNDEFINED || out->vertex_format == VK_FORMAT_R32G32_SFLOAT ? 4 : 2;
        out->vertex_offset = component * gn_random_below(random, 8);
        out->vertex_stride = 16 + component * gn_random_below(random, 5);
        out->primitive_offset = out->index_none ? out->vertex_stride * gn_random_below(random, 3) : 12 * gn_random_below(random, 4);
        out->transform_offset = 16 * gn_random_below(random, 4);
    }
}

static void boxes_random(struct maker *maker, struct gn_cts_geometry *out, bool updated)
{
    struct gn_random *random = maker->random;
    const uint32_t count = 1 + gn_random_below(random, 24);
    float(*boxes)[6] = gn_arena_alloc(maker->arena, count, sizeof *boxes);
    float(*initial)[6] = gn_arena_alloc(maker->arena, count, sizeof *initial);
    for (uint32_t i = 0; i < count; i++)
        for (int a = 0; a < 3; a++) {
            const double middle = gn_random_range(random, -1, 1), half = gn_random_range(random, 0.02, 0.4);
            boxes[i][a] = (float)(middle - half);
            boxes[i][a + 3] = (float)(middle + half);
            initial[i][a] = boxes[i][a] + 0.5f;
            initial[i][a + 3] = boxes[i][a + 3] + 0.75f;
        }
    for (uint32_t i = 0; i < count && maker->mixture.inactive; i++)
        if (chance(random, 0.2))
            boxes[i][0] = initial[i][0] = NAN;
    *out = (struct gn_cts_geometry){.type = GN_REF_AABBS,
                                    .aabbs = (const float(*)[6])boxes,
                                    .aabb_count = count,
                                    .flags = chance(random, 0.5) ? VK_GEOMETRY_OPAQUE_BIT_KHR : 0};
    if (updated && chance(random, 0.7))
        out->initial_aabbs = (const float(*)[6])initial;
    if (maker->mixture.offsets) {
        out->aabb_stride = 24 + 8 * gn_random_below(random, 3);
        out->primitive_offset = 8 * gn_random_below(random, 4);
    }
}

/* Steps that are allowed with the flags they add to *inout_flags. */
static void steps_random(struct maker *maker, uint8_t steps[GN_CTS_MAX_STEPS], VkBuildAccelerationStructureFlagsKHR *inout_flags)
{
    static const uint8_t updates[] = {GN_CTS_STEP_REFIT, GN_CTS_STEP_REFIT_COPY, GN_CTS_STEP_REBUILD};
    static const uint8_t copies[] = {GN_CTS_STEP_COMPACT, GN_CTS_STEP_CLONE, GN_CTS_STEP_SERIALIZE};
    struct gn_random *random = maker->random;
    uint32_t count = 0;
    bool compacted = false;
    for (uint32_t i = 0; i < 3; i++) {
        uint8_t step = GN_CTS_STEP_END;
        if (maker->mixture.updates && chance(random, 0.5))
            step = updates[gn_random_below(random, 3)];
        else if (maker->mixture.copies && chance(random, 0.5))
            step = copies[gn_random_below(random, 3)];
        if (step == GN_CTS_STEP_END || (step == GN_CTS_STEP_REBUILD && compacted))
            continue;
        if (step == GN_CTS_STEP_REFIT || step == GN_CTS_STEP_REFIT_COPY)
            *inout_flags |= VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR;
        if (step == GN_CTS_STEP_COMPACT)
            *inout_flags |= VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR;
        compacted = (compacted || step == GN_CTS_STEP_COMPACT) && step != GN_CTS_STEP_REFIT_COPY;
        steps[count++] = step;
    }
}

static VkBuildAccelerationStructureFlagsKHR flags_random(struct gn_random *random)
{
    static const VkBuildAccelerationStructureFlagsKHR speed[] = {
        0, VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR,
        VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_BUILD_BIT_KHR};
    return speed[gn_random_below(random, 3)] |
           (chance(random, 0.3) ? VK_BUILD_ACCELERATION_STRUCTURE_LOW_MEMORY_BIT_KHR : 0) |
           (chance(random, 0.3) ? VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR : 0) |
           (chance(random, 0.3) ? VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR : 0);
}

static bool steps_take_final(const uint8_t *steps)
{
    for (uint32_t i = 0; i < GN_CTS_MAX_STEPS && steps[i] != GN_CTS_STEP_END; i++)
        if (steps[i] <= GN_CTS_STEP_REBUILD)
            return true;
    return false;
}

static void blases_random(struct maker *maker, struct gn_fuzz_trial *out)
{
    struct gn_random *random = maker->random;
    const uint32_t count = 1 + gn_random_below(random, MAX_BLASES);
    struct gn_cts_blas *blases = GN_NEW(maker->arena, struct gn_cts_blas, count);
    for (uint32_t b = 0; b < count; b++) {
        struct gn_cts_blas *blas = &blases[b];
        const bool boxes = b > 0 && chance(random, 0.25);
        blas->build_flags = flags_random(random);
        blas->generic = chance(random, 0.1);
        steps_random(maker, blas->steps, &blas->build_flags);
        if (out->program == GN_CTS_POSITIONS)
            blas->build_flags |= VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_DATA_ACCESS_KHR;
        blas->geometry_count = 1 + gn_random_below(random, MAX_GEOMETRIES);
        struct gn_cts_geometry *geometries = GN_NEW(maker->arena, struct gn_cts_geometry, blas->geometry_count);
        for (uint32_t g = 0; g < blas->geometry_count; g++) {
            if (boxes)
                boxes_random(maker, &geometries[g], steps_take_final(blas->steps));
            else
                triangles_random(maker, &maker->meshes[b][g], &geometries[g], steps_take_final(blas->steps));
        }
        blas->geometries = geometries;
    }
    out->scene.blases = blases;
    out->scene.blas_count = count;
}

static void instances_random(struct maker *maker, struct gn_fuzz_trial *out)
{
    struct gn_random *random = maker->random;
    struct gn_cts_scene *scene = &out->scene;
    scene->tlas_build_flags = flags_random(random);
    steps_random(maker, scene->tlas_steps, &scene->tlas_build_flags);
    scene->instance_count = 1 + gn_random_below(random, MAX_INSTANCES);
    struct gn_cts_instance *instances = GN_NEW(maker->arena, struct gn_cts_instance, scene->instance_count);
    struct gn_cts_instance *initial = GN_NEW(maker->arena, struct gn_cts_instance, scene->instance_count);
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        float transform[12];
        transform_random(random, 3, transform);
        instances[i] = gn_instance_of(i ? gn_random_below(random, scene->blas_count) : 0,
                                      maker->mixture.transforms ? transform : NULL);
        if (i && maker->mixture.inactive && chance(random, 0.2))
            instances[i].blas = GN_CTS_NO_BLAS;
        instances[i].mask = chance(random, 0.7) ? 0xFF : gn_random_below(random, 256);
        instances[i].custom_index = (uint32_t)gn_random_u64(random) & 0xFFFFFF;
        /* Pipelines need a record for each; a few are enough. */
        instances[i].sbt_offset = out->backend == GN_CASE_PIPELINE ? gn_random_below(random, 8)
                                                                   : (uint32_t)gn_random_u64(random) & 0xFFFFFF;
        if (chance(random, 0.2))
            instances[i].flags |= VK_GEOMETRY_INSTANCE_TRIANGLE_FACING_CULL_DISABLE_BIT_KHR;
        if (chance(random, 0.2))
            instances[i].flags |= VK_GEOMETRY_INSTANCE_TRIANGLE_FLIP_FACING_BIT_KHR;
        if (chance(random, 0.3))
            instances[i].flags |= chance(random, 0.5) ? VK_GEOMETRY_INSTANCE_FORCE_OPAQUE_BIT_KHR
                                                      : VK_GEOMETRY_INSTANCE_FORCE_NO_OPAQUE_BIT_KHR;
        initial[i] = instances[i];
        transform_random(random, 20, transform);
        if (maker->mixture.transforms)
            memcpy(initial[i].transform, transform, sizeof transform);
        initial[i].mask = gn_random_below(random, 256);
        initial[i].custom_index = gn_random_below(random, 1000);
    }
    scene->instances = instances;
    if (steps_take_final(scene->tlas_steps) && chance(random, 0.8))
        scene->initial_instances = initial;
    scene->array_of_pointers = chance(random, 0.2);
    scene->instance_offset = chance(random, 0.2) ? 16 * gn_random_below(random, 5) : 0;
    scene->separate_builds = chance(random, 0.3);
    scene->tlas_generic = chance(random, 0.1);
}

/* What the API allows together: one flag about opacity, one about facing or types, anything about when to end. */
static void ray_vary(struct gn_random *random, struct gn_cts_ray *ray)
{
    static const uint32_t opacity[] = {GN_REF_RAY_OPAQUE, GN_REF_RAY_NO_OPAQUE, GN_REF_RAY_CULL_OPAQUE,
                                       GN_REF_RAY_CULL_NO_OPAQUE};
    static const uint32_t facing[] = {GN_REF_RAY_CULL_BACK_FACING, GN_REF_RAY_CULL_FRONT_FACING,
                                      GN_REF_RAY_SKIP_AABBS, GN_REF_RAY_SKIP_TRIANGLES};
    if (chance(random, 0.2))
        ray->ray.flags |= opacity[gn_random_below(random, 4)];
    if (chance(random, 0.2))
        ray->ray.flags |= facing[gn_random_below(random, 4)];
    if (chance(random, 0.1))
        ray->ray.flags |= GN_REF_RAY_TERMINATE_ON_FIRST_HIT;
    if (chance(random, 0.1))
        ray->ray.flags |= GN_REF_RAY_SKIP_CLOSEST_HIT_SHADER;
    if (chance(random, 0.2))
        ray->ray.cull_mask = gn_random_below(random, 256);
    if (chance(random, 0.2))
        ray->policy.confirm_mask = (uint32_t)gn_random_u64(random);
    if (chance(random, 0.1)) {
        const float t = ray->ray.tmax / 10;
        ray->ray.tmin = t * (float)gn_random_range(random, 0, 0.7);
        ray->ray.tmax = ray->ray.tmin + t * (float)gn_random_range(random, 0, 2);
    } else if (chance(random, 0.1)) {
        ray->ray.tmax = INFINITY;
    }
}

static void rays_random(struct maker *maker, struct gn_fuzz_trial *out)
{
    struct gn_random *random = maker->random;
    out->ray_count = RAYS;
    out->rays = GN_NEW(maker->arena, struct gn_cts_ray, RAYS);
    struct gn_case_run run = {.arena = *maker->arena, .random = *random, .scale = 1};
    gn_rays_at_scene(&run, &out->scene, 2.5, true, out->rays, RAYS);
    *maker->arena = run.arena;
    *random = run.random;
    for (uint32_t i = 0; i < RAYS; i++) {
        const struct gn_cts_instance *at = &out->scene.instances[gn_random_below(random, out->scene.instance_count)];
        const struct gn_cts_blas *blas = at->blas == GN_CTS_NO_BLAS ? NULL : &out->scene.blases[at->blas];
        if (blas && blas->geometries[0].type == GN_REF_TRIANGLES && (maker->mixture.shared || chance(random, 0.2))) {
            const uint32_t g = gn_random_below(random, blas->geometry_count);
            const double kind = gn_random_unit(random);
            const struct gn_aim_options options = {
                .geometry_transform = blas->geometries[g].transform,
                .instance_transform = at->transform,
                .aim = !maker->mixture.shared || kind > 0.6 ? GN_AIM_RANDOM : kind < 0.3 ? GN_AIM_EDGE : GN_AIM_VERTEX,
                .distance = ldexp(1, (int)gn_random_below(random, 6) - 1),
                .both_sides = true,
                .direction_scale = ldexp(1, (int)gn_random_below(random, 9) - 4)};
            gn_rays_aimed_with(random, &maker->meshes[at->blas][g], &options, &out->rays[i], 1);
        }
        out->rays[i].policy.generate_mask = 0;
        ray_vary(random, &out->rays[i]);
    }
}

void gn_fuzz_make(struct gn_arena *arena, uint64_t seed, uint64_t number, const struct gn_device_info *info,
                  struct gn_fuzz_trial *out)
{
    struct gn_random random = {seed};
    random.state = gn_random_u64(&random) ^ (number * UINT64_C(0xD1342543DE82EF95));
    (void)gn_random_u64(&random);
    struct maker *maker = GN_NEW(arena, struct maker, 1);
    maker->random = &random;
    maker->arena = arena;
    maker->info = info;
    maker->mixture = (struct mixture){.inactive = chance(&random, 0.15),
                                      .first_vertex = chance(&random, 0.15),
                                      .offsets = chance(&random, 0.4),
                                      .formats = chance(&random, 0.4),
                                      .updates = chance(&random, 0.4),
                                      .copies = chance(&random, 0.4),
                                      .transforms = chance(&random, 0.8),
                                      .geometry_transforms = chance(&random, 0.4),
                                      .shared = chance(&random, 0.2)};
    *out = (struct gn_fuzz_trial){0};
    const double program = gn_random_unit(&random);
    const bool pipeline = chance(&random, 0.4);
    out->program = program < 0.6   ? GN_CTS_COMMITTED
                   : program < 0.8 ? GN_CTS_CANDIDATES
                   : program < 0.9 ? GN_CTS_DETAIL
                                   : GN_CTS_POSITIONS;
    if (out->program == GN_CTS_POSITIONS && !info->position_fetch)
        out->program = GN_CTS_COMMITTED;
    out->backend = info->ray_tracing_pipeline && (pipeline || !info->ray_query) ? GN_CASE_PIPELINE : GN_CASE_QUERY;
    blases_random(maker, out);
    instances_random(maker, out);
    rays_random(maker, out);
}

static void run_trial(struct gn_case_run *run, const struct gn_case *self)
{
    const struct gn_fuzz_trial *trial = self->params;
    gn_case_trace(run, &trial->scene, trial->program, trial->rays, trial->ray_count, 0);
}

void gn_fuzz_execute(const struct gn_fuzz_trial *trial, struct gn_device *device, struct gn_case_run *out_run)
{
    /* The table of a run outlives the call: messages point into nothing of it. */
    static const char spec[] = "any scene (ray traversal)";
    const struct gn_case self = {.name = "fuzz", .spec = spec, .run = run_trial, .params = trial};
    gn_case_execute(&self, self.name, trial->backend, device, 0, 1, -1, -1, out_run);
}
