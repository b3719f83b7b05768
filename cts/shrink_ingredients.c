/* SPDX-License-Identifier: Apache-2.0 */
/* Taking one ingredient out of a scene, and finding out which ones a failure needs. */
#include <math.h>
#include <string.h>

#include "cts/generate.h"
#include "cts/shrink.h"

void gn_shrink_copy_make(struct gn_arena *arena, const struct gn_fuzz_trial *trial, struct gn_shrink_copy *out)
{
    const struct gn_cts_scene *scene = &trial->scene;
    *out = (struct gn_shrink_copy){.trial = *trial};
    out->blases = GN_NEW(arena, struct gn_cts_blas, scene->blas_count);
    out->geometries = GN_NEW(arena, struct gn_cts_geometry *, scene->blas_count);
    out->instances = GN_NEW(arena, struct gn_cts_instance, scene->instance_count);
    out->trial.rays = GN_NEW(arena, struct gn_cts_ray, trial->ray_count);
    memcpy(out->trial.rays, trial->rays, trial->ray_count * sizeof *trial->rays);
    memcpy(out->instances, scene->instances, scene->instance_count * sizeof *out->instances);
    if (scene->initial_instances) {
        out->initial_instances = GN_NEW(arena, struct gn_cts_instance, scene->instance_count);
        memcpy(out->initial_instances, scene->initial_instances, scene->instance_count * sizeof *out->instances);
    }
    for (uint32_t b = 0; b < scene->blas_count; b++) {
        out->blases[b] = scene->blases[b];
        out->geometries[b] = GN_NEW(arena, struct gn_cts_geometry, scene->blases[b].geometry_count);
        if (scene->blases[b].geometry_count)
            memcpy(out->geometries[b], scene->blases[b].geometries,
                   scene->blases[b].geometry_count * sizeof **out->geometries);
        out->blases[b].geometries = out->geometries[b];
    }
    out->trial.scene.blases = out->blases;
    out->trial.scene.instances = out->instances;
    out->trial.scene.initial_instances = out->initial_instances;
}

const char *gn_fuzz_ingredient_name(enum gn_fuzz_ingredient ingredient)
{
    static const char *const names[GN_FUZZ_INGREDIENT_COUNT] = {
        "inactive",      "first_vertex",   "offsets",   "formats",   "indices",
        "updates",       "copies",         "build_flags", "instance_array", "geometry_transforms",
        "instance_transforms", "masks",    "instance_flags", "instance_data", "opacity",
        "ray_flags",     "range",          "policy",    "read_back", "pipeline"};
    return names[ingredient];
}

/* Sets the value and tells whether it was another. */
#define SET(place, value) ((place) != (value) ? ((place) = (value), true) : false)

static bool active_positions(struct gn_arena *arena, const double (**inout)[3], uint32_t count)
{
    bool found = false;
    for (uint32_t i = 0; *inout && i < count && !found; i++)
        found = isnan((*inout)[i][0]);
    if (!found)
        return false;
    double(*positions)[3] = gn_arena_alloc(arena, count, sizeof *positions);
    for (uint32_t i = 0; i < count; i++)
        for (int a = 0; a < 3; a++)
            positions[i][a] = isnan((*inout)[i][a]) ? 0.25 * (a + 1) : (*inout)[i][a];
    *inout = (const double(*)[3])positions;
    return true;
}

static bool active_boxes(struct gn_arena *arena, const float (**inout)[6], uint32_t count)
{
    bool found = false;
    for (uint32_t i = 0; *inout && i < count && !found; i++)
        found = isnan((*inout)[i][0]);
    if (!found)
        return false;
    float(*boxes)[6] = gn_arena_alloc(arena, count, sizeof *boxes);
    for (uint32_t i = 0; i < count; i++)
        for (int a = 0; a < 6; a++)
            boxes[i][a] = isnan((*inout)[i][0]) && a < 3 ? (*inout)[i][a + 3] - 0.25f : (*inout)[i][a];
    *inout = (const float(*)[6])boxes;
    return true;
}

static void transform_into(struct gn_arena *arena, const double (**inout)[3], uint32_t count, const float *m)
{
    double(*positions)[3] = gn_arena_alloc(arena, count, sizeof *positions);
    for (uint32_t i = 0; i < count; i++)
        for (int r = 0; r < 3; r++) {
            const double *from = (*inout)[i];
            positions[i][r] = (float)((double)m[4 * r] * from[0] + (double)m[4 * r + 1] * from[1] +
                                      (double)m[4 * r + 2] * from[2] + (double)m[4 * r + 3]);
        }
    *inout = (const double(*)[3])positions;
}

static bool geometry_without(struct gn_arena *arena, struct gn_cts_geometry *geometry, enum gn_fuzz_ingredient what)
{
    bool changed = false;
    switch (what) {
    case GN_FUZZ_INACTIVE:
        changed |= active_positions(arena, &geometry->positions, geometry->position_count);
        changed |= active_positions(arena, &geometry->initial_positions, geometry->position_count);
        changed |= active_boxes(arena, &geometry->aabbs, geometry->aabb_count);
        changed |= active_boxes(arena, &geometry->initial_aabbs, geometry->aabb_count);
        break;
    case GN_FUZZ_FIRST_VERTEX:
        changed |= SET(geometry->first_vertex, 0);
        break;
    case GN_FUZZ_OFFSETS:
        changed |= SET(geometry->vertex_offset, 0) | SET(geometry->vertex_stride, 0) |
                   SET(geometry->primitive_offset, 0) | SET(geometry->transform_offset, 0) |
                   SET(geometry->aabb_stride, 0);
        break;
    case GN_FUZZ_FORMATS:
        /* What is laid out for another format goes as well. */
        if ((changed = SET(geometry->vertex_format, VK_FORMAT_UNDEFINED)))
            geometry->vertex_offset = geometry->vertex_stride = geometry->primitive_offset = 0;
        break;
    case GN_FUZZ_INDICES:
        changed |= SET(geometry->index_none, false);
        changed |= geometry->type == GN_REF_TRIANGLES && SET(geometry->index_uint32, true);
        if (changed)
            geometry->primitive_offset = 0;
        break;
    case GN_FUZZ_GEOMETRY_TRANSFORMS:
        if (!geometry->transform)
            break;
        changed = true;
        transform_into(arena, &geometry->positions, geometry->position_count, geometry->transform);
        if (geometry->initial_positions)
            transform_into(arena, &geometry->initial_positions, geometry->position_count,
                           geometry->initial_transform ? geometry->initial_transform : geometry->transform);
        geometry->transform = geometry->initial_transform = NULL;
        geometry->transform_offset = 0;
        break;
    case GN_FUZZ_OPACITY:
        changed |= SET(geometry->flags, (VkGeometryFlagsKHR)VK_GEOMETRY_OPAQUE_BIT_KHR);
        break;
    default:
        break;
    }
    return changed;
}

/* Removes the steps from `first` to `last`. */
static bool steps_without(uint8_t steps[GN_CTS_MAX_STEPS], uint8_t first, uint8_t last)
{
    uint32_t kept = 0, count = 0;
    for (; count < GN_CTS_MAX_STEPS && steps[count] != GN_CTS_STEP_END; count++)
        if (steps[count] < first || steps[count] > last)
            steps[kept++] = steps[count];
    for (uint32_t i = kept; i < GN_CTS_MAX_STEPS; i++)
        steps[i] = GN_CTS_STEP_END;
    return kept < count;
}

/* The flags that the steps need, and data access. */
static VkBuildAccelerationStructureFlagsKHR flags_needed(const uint8_t *steps, VkBuildAccelerationStructureFlagsKHR flags)
{
    VkBuildAccelerationStructureFlagsKHR needed = flags & VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_DATA_ACCESS_KHR;
    for (uint32_t i = 0; i < GN_CTS_MAX_STEPS && steps[i] != GN_CTS_STEP_END; i++) {
        if (steps[i] == GN_CTS_STEP_REFIT || steps[i] == GN_CTS_STEP_REFIT_COPY)
            needed |= VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR;
        if (steps[i] == GN_CTS_STEP_COMPACT)
            needed |= VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR;
    }
    return needed;
}

static bool blas_without(struct gn_cts_blas *blas, enum gn_fuzz_ingredient what)
{
    switch (what) {
    case GN_FUZZ_UPDATES:
        return steps_without(blas->steps, GN_CTS_STEP_REFIT, GN_CTS_STEP_REBUILD);
    case GN_FUZZ_COPIES:
        return steps_without(blas->steps, GN_CTS_STEP_COMPACT, GN_CTS_STEP_SERIALIZE);
    case GN_FUZZ_BUILD_FLAGS:
        return SET(blas->build_flags, flags_needed(blas->steps, blas->build_flags));
    case GN_FUZZ_INSTANCE_ARRAY:
        return SET(blas->generic, false);
    default:
        return false;
    }
}

static bool scene_without(struct gn_cts_scene *scene, enum gn_fuzz_ingredient what)
{
    switch (what) {
    case GN_FUZZ_UPDATES:
        return steps_without(scene->tlas_steps, GN_CTS_STEP_REFIT, GN_CTS_STEP_REBUILD);
    case GN_FUZZ_COPIES:
        return steps_without(scene->tlas_steps, GN_CTS_STEP_COMPACT, GN_CTS_STEP_SERIALIZE);
    case GN_FUZZ_BUILD_FLAGS:
        return SET(scene->tlas_build_flags, flags_needed(scene->tlas_steps, scene->tlas_build_flags));
    case GN_FUZZ_INSTANCE_ARRAY:
        return SET(scene->array_of_pointers, false) | SET(scene->instance_offset, 0) |
               SET(scene->separate_builds, true) | SET(scene->tlas_generic, false);
    default:
        return false;
    }
}

static bool instance_without(struct gn_cts_instance *instance, enum gn_fuzz_ingredient what)
{
    switch (what) {
    case GN_FUZZ_INACTIVE:
        return SET(instance->blas, instance->blas == GN_CTS_NO_BLAS ? 0 : instance->blas);
    case GN_FUZZ_MASKS:
        return SET(instance->mask, 0xFF);
    case GN_FUZZ_INSTANCE_FLAGS:
        return SET(instance->flags, 0);
    case GN_FUZZ_INSTANCE_DATA:
        return SET(instance->custom_index, 0) | SET(instance->sbt_offset, 0);
    default:
        return false;
    }
}

static bool ray_without(struct gn_cts_ray *ray, enum gn_fuzz_ingredient what)
{
    switch (what) {
    case GN_FUZZ_MASKS:
        return SET(ray->ray.cull_mask, 0xFF);
    case GN_FUZZ_RAY_FLAGS:
        return SET(ray->ray.flags, 0);
    case GN_FUZZ_RANGE:
        return SET(ray->ray.tmin, 0) | SET(ray->ray.tmax, 0x1p20f);
    case GN_FUZZ_POLICY:
        return SET(ray->policy.confirm_mask, UINT32_MAX);
    default:
        return false;
    }
}

/* The instance in focus alone, where its object space is. */
static bool instances_placed(struct gn_shrink_copy *copy)
{
    struct gn_cts_instance *instance = &copy->instances[copy->trial.focus];
    if (copy->trial.focus >= copy->trial.scene.instance_count ||
        memcmp(instance->transform, gn_identity, sizeof gn_identity) == 0)
        return false;
    for (uint32_t i = 0; i < copy->trial.ray_count; i++) {
        struct gn_ref_ray *ray = &copy->trial.rays[i].ray;
        double origin[3], direction[3];
        for (int a = 0; a < 3; a++) {
            origin[a] = (double)ray->origin[a] - (double)instance->transform[4 * a + 3];
            direction[a] = (double)ray->direction[a];
        }
        gn_transform_inverse_apply(instance->transform, origin, false, origin);
        gn_transform_inverse_apply(instance->transform, direction, false, direction);
        for (int a = 0; a < 3; a++) {
            ray->origin[a] = (float)origin[a];
            ray->direction[a] = (float)direction[a];
        }
    }
    memcpy(instance->transform, gn_identity, sizeof gn_identity);
    copy->instances[0] = *instance;
    if (copy->initial_instances) {
        copy->initial_instances[0] = copy->initial_instances[copy->trial.focus];
        memcpy(copy->initial_instances[0].transform, gn_identity, sizeof gn_identity);
    }
    copy->trial.scene.instance_count = 1;
    copy->trial.focus = 0;
    return true;
}

bool gn_fuzz_without(struct gn_arena *arena, const struct gn_fuzz_trial *trial, enum gn_fuzz_ingredient what,
                     struct gn_fuzz_trial *out)
{
    struct gn_shrink_copy copy;
    gn_shrink_copy_make(arena, trial, &copy);
    struct gn_cts_scene *scene = &copy.trial.scene;
    bool changed = scene_without(scene, what);
    if (what == GN_FUZZ_INSTANCE_TRANSFORMS)
        changed |= instances_placed(&copy);
    for (uint32_t b = 0; b < scene->blas_count; b++) {
        changed |= blas_without(&copy.blases[b], what);
        for (uint32_t g = 0; g < scene->blases[b].geometry_count; g++)
            changed |= geometry_without(arena, &copy.geometries[b][g], what);
    }
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        changed |= instance_without(&copy.instances[i], what);
        if (copy.initial_instances)
            instance_without(&copy.initial_instances[i], what);
    }
    for (uint32_t i = 0; i < trial->ray_count; i++)
        changed |= ray_without(&copy.trial.rays[i], what);
    if (what == GN_FUZZ_READ_BACK)
        changed |= SET(copy.trial.program, GN_CTS_COMMITTED);
    if (what == GN_FUZZ_PIPELINE)
        changed |= SET(copy.trial.backend, GN_CASE_QUERY);
    *out = copy.trial;
    return changed;
}

uint32_t gn_fuzz_classify(struct gn_arena *arena, struct gn_fuzz_trial *inout_trial, uint32_t ray, gn_fuzz_fails *fails,
                          void *context)
{
    uint32_t needed = 0;
    struct gn_fuzz_trial less = *inout_trial;
    if (ray < inout_trial->ray_count) {
        less.rays = inout_trial->rays + ray;
        less.ray_count = 1;
        if (fails(context, &less))
            *inout_trial = less;
    }
    for (uint32_t what = 0; what < GN_FUZZ_INGREDIENT_COUNT; what++) {
        if (!gn_fuzz_without(arena, inout_trial, (enum gn_fuzz_ingredient)what, &less))
            continue;
        if (fails(context, &less))
            *inout_trial = less;
        else
            needed |= 1u << what;
    }
    return needed;
}
