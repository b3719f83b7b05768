/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Random scenes, one per number: several structures of several geometries, instances with masks, flags and
 * transforms, rays with masks, flags and ranges. What no table of cases thought of is met here. Some ingredients
 * come in cases of their own, so that an implementation that cannot take one still shows what it makes of the others.
 */
#include <math.h>

#include "cts/compose.h"
#include "cts/mesh_case.h"

enum { MAX_BLASES = 4, MAX_GEOMETRIES = 4, MAX_INSTANCES = 24 };

/* What a case adds to the plain mixture. */
enum extra { PLAIN, SHARED, INACTIVE, OFFSETS, DETAIL };

struct part {
    struct gn_mesh mesh;
    float transform[12];
};

struct world {
    struct part parts[MAX_BLASES][MAX_GEOMETRIES];
    struct gn_cts_geometry geometries[MAX_BLASES][MAX_GEOMETRIES];
    struct gn_cts_blas blases[MAX_BLASES + 1];
    struct gn_cts_instance instances[MAX_INSTANCES + 1];
    struct gn_cts_scene scene;
    uint32_t mesh_blases; /* the one after them, if any, is the ladder of boxes */
    const float (*boxes)[6];
    uint32_t box_count;
};

static bool chance(struct gn_random *random, double share)
{
    return gn_random_unit(random) < share;
}

static struct gn_mesh random_mesh(struct gn_case_run *run, enum extra extra)
{
    struct gn_random *random = &run->random;
    uint32_t n = 1 + gn_random_below(random, 8);
    const struct gn_mesh_spec specs[] = {
        {GN_MESH_HEIGHT_FIELD, 4 * n, 0, gn_random_range(random, 0, 0.3)},
        {GN_MESH_LATTICE, 4u << n % 3, 0, 0.125},
        {GN_MESH_BLOB, 2 + n, 3 + n, gn_random_range(random, 0, 0.6)},
        {GN_MESH_TORUS, 6 + n, 4 + n, gn_random_range(random, 0.2, 0.8)},
        {GN_MESH_BOX, 1u << n % 3, 0, 0},
        {GN_MESH_OCTAHEDRON, 1u << n % 4, 0, 0},
        {GN_MESH_FAN, 3 + n, 0, gn_random_range(random, 0, 1)},
        {GN_MESH_SOUP, 5 * n * n, 0, gn_random_range(random, 0.2, 1.5)},
        {GN_MESH_QUAD, 0, 0, 0},
        {GN_MESH_TRIANGLE, 0, 0, 0},
    };
    struct gn_mesh mesh =
        gn_mesh_of(&run->arena, random, &specs[gn_random_below(random, sizeof specs / sizeof specs[0])]);
    if (extra == INACTIVE && chance(random, 0.5)) {
        mesh = gn_mesh_unshared(&run->arena, &mesh);
        gn_mesh_deactivate(random, &mesh, gn_random_unit(random));
    }
    return mesh;
}

static void random_transform(struct gn_random *random, double translation, float out[12])
{
    struct gn_transform_spec spec = {0};
    spec.kind = (enum gn_transform_kind)(GN_TRANSFORM_RANDOM + gn_random_below(random, 3));
    spec.min_scale = gn_random_range(random, 0.2, 1);
    spec.max_scale = spec.min_scale * gn_random_range(random, 1, 6);
    spec.shear = gn_random_unit(random);
    spec.translation = translation;
    spec.mirrored = gn_random_below(random, 2);
    gn_transform_of(random, &spec, out);
}

static void random_blas(struct gn_case_run *run, struct world *world, uint32_t b, enum extra extra)
{
    static const VkBuildAccelerationStructureFlagsKHR build_flags[] = {
        0, VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR,
        VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_BUILD_BIT_KHR, VK_BUILD_ACCELERATION_STRUCTURE_LOW_MEMORY_BIT_KHR};
    struct gn_random *random = &run->random;
    uint32_t count = 1 + gn_random_below(random, MAX_GEOMETRIES);
    for (uint32_t g = 0; g < count; g++) {
        struct part *part = &world->parts[b][g];
        struct gn_cts_geometry *geometry = &world->geometries[b][g];
        part->mesh = random_mesh(run, extra);
        *geometry = gn_geometry_of_mesh(&part->mesh);
        if (chance(random, 0.4)) {
            random_transform(random, 1, part->transform);
            geometry->transform = part->transform;
        }
        geometry->flags = chance(random, 0.6) ? VK_GEOMETRY_OPAQUE_BIT_KHR : 0;
        geometry->index_uint32 = chance(random, 0.3);
        geometry->index_none = chance(random, 0.2);
        if (extra == OFFSETS) {
            geometry->first_vertex = gn_random_below(random, 4);
            geometry->vertex_offset = 4 * gn_random_below(random, 8);
            geometry->primitive_offset = 12 * gn_random_below(random, 4);
            geometry->transform_offset = 16 * gn_random_below(random, 4);
            geometry->vertex_stride = 12 + 4 * gn_random_below(random, 4);
        }
    }
    world->blases[b].geometries = world->geometries[b];
    world->blases[b].geometry_count = count;
    world->blases[b].build_flags = build_flags[gn_random_below(random, 4)];
}

static void random_instance(struct gn_random *random, struct world *world, uint32_t i)
{
    static const VkGeometryInstanceFlagsKHR flags[] = {
        VK_GEOMETRY_INSTANCE_TRIANGLE_FACING_CULL_DISABLE_BIT_KHR, VK_GEOMETRY_INSTANCE_TRIANGLE_FLIP_FACING_BIT_KHR,
        VK_GEOMETRY_INSTANCE_FORCE_OPAQUE_BIT_KHR, VK_GEOMETRY_INSTANCE_FORCE_NO_OPAQUE_BIT_KHR};
    float transform[12];
    random_transform(random, 4, transform);
    struct gn_cts_instance *instance = &world->instances[i];
    *instance = gn_instance_of(gn_random_below(random, world->mesh_blases), transform);
    /* The first is there in any case, so that there is something to aim at. */
    if (i && chance(random, 0.1))
        instance->blas = GN_CTS_NO_BLAS;
    instance->mask = chance(random, 0.7) ? 0xFF : gn_random_below(random, 256);
    instance->custom_index = (uint32_t)gn_random_u64(random) & 0xFFFFFF;
    instance->sbt_offset = (uint32_t)gn_random_u64(random) & 0xFFFFFF;
    for (int k = 0; k < 2; k++)
        if (chance(random, 0.2))
            instance->flags |= flags[k];
    if (chance(random, 0.3))
        instance->flags |= flags[2 + gn_random_below(random, 2)];
}

static struct world *random_world(struct gn_case_run *run, enum extra extra)
{
    struct gn_random *random = &run->random;
    struct world *world = GN_NEW(&run->arena, struct world, 1);
    world->mesh_blases = 1 + gn_random_below(random, MAX_BLASES);
    for (uint32_t b = 0; b < world->mesh_blases; b++)
        random_blas(run, world, b, extra);
    uint32_t count = 1 + gn_random_below(random, MAX_INSTANCES);
    for (uint32_t i = 0; i < count; i++)
        random_instance(random, world, i);
    uint32_t blas_count = world->mesh_blases;
    if (chance(random, 0.5)) {
        /* One instance of it, with the identity: its rays and policies are made for that. */
        struct gn_cts_geometry *ladder = GN_NEW(&run->arena, struct gn_cts_geometry, 1);
        world->box_count = 4 + gn_random_below(random, 9);
        world->boxes = gn_ladder_make(&run->arena, random, world->box_count, 0.25);
        ladder->type = GN_REF_AABBS;
        ladder->aabbs = world->boxes;
        ladder->aabb_count = world->box_count;
        ladder->flags = chance(random, 0.5) ? VK_GEOMETRY_OPAQUE_BIT_KHR : 0;
        world->blases[blas_count].geometries = ladder;
        world->blases[blas_count].geometry_count = 1;
        world->instances[count] = gn_instance_of(blas_count, NULL);
        world->instances[count].custom_index = (uint32_t)gn_random_u64(random) & 0xFFFFFF;
        blas_count++;
        count++;
    }
    world->scene = gn_scene_make(world->blases, blas_count, world->instances, count);
    world->scene.separate_builds = chance(random, 0.5);
    world->scene.array_of_pointers = chance(random, 0.3);
    return world;
}

/* Aims one ray at the inside or, if asked for, an edge or a vertex of a random geometry of a random instance. */
static void aim_somewhere(struct gn_random *random, const struct world *world, enum extra extra,
                          struct gn_cts_ray *ray)
{
    const struct gn_cts_instance *at;
    do
        at = &world->instances[gn_random_below(random, world->scene.instance_count)];
    while (at->blas >= world->mesh_blases);
    uint32_t g = gn_random_below(random, world->blases[at->blas].geometry_count);
    struct gn_aim_options options = {0};
    options.geometry_transform = world->geometries[at->blas][g].transform;
    options.instance_transform = at->transform;
    double kind = gn_random_unit(random);
    options.aim = kind < 0.9 ? GN_AIM_INTERIOR : GN_AIM_RANDOM;
    if (extra == SHARED && kind < 0.5)
        options.aim = kind < 0.25 ? GN_AIM_EDGE : GN_AIM_VERTEX;
    options.distance = ldexp(1, (int)gn_random_below(random, 6) - 1);
    options.both_sides = true;
    options.direction_scale = ldexp(1, (int)gn_random_below(random, 9) - 4);
    gn_rays_aimed_with(random, &world->parts[at->blas][g].mesh, &options, ray, 1);
    ray->policy.generate_mask = 0;
}

/* What the API allows together: one flag about opacity, one about facing, anything about when to end. */
static void vary(struct gn_random *random, struct gn_cts_ray *ray)
{
    static const uint32_t opacity[] = {GN_REF_RAY_OPAQUE, GN_REF_RAY_NO_OPAQUE, GN_REF_RAY_CULL_OPAQUE,
                                       GN_REF_RAY_CULL_NO_OPAQUE};
    static const uint32_t facing[] = {GN_REF_RAY_CULL_BACK_FACING, GN_REF_RAY_CULL_FRONT_FACING};
    if (chance(random, 0.2))
        ray->ray.flags |= opacity[gn_random_below(random, 4)];
    if (chance(random, 0.2))
        ray->ray.flags |= facing[gn_random_below(random, 2)];
    if (chance(random, 0.1))
        ray->ray.flags |= GN_REF_RAY_TERMINATE_ON_FIRST_HIT;
    if (chance(random, 0.1))
        ray->ray.flags |= GN_REF_RAY_SKIP_CLOSEST_HIT_SHADER;
    if (chance(random, 0.2))
        ray->ray.cull_mask = gn_random_below(random, 256);
    if (chance(random, 0.2))
        ray->policy.confirm_mask = (uint32_t)gn_random_u64(random);
    if (chance(random, 0.1)) {
        float t = ray->ray.tmax / 10;
        ray->ray.tmin = t * (float)gn_random_range(random, 0, 0.7);
        ray->ray.tmax = ray->ray.tmin + t * (float)gn_random_range(random, 0, 2);
    } else if (chance(random, 0.1)) {
        ray->ray.tmax = INFINITY;
    }
}

/* `value` is what to add. The name alone makes one scene different from another: it goes into the seed. */
static void random_scene(struct gn_case_run *run, const struct gn_case *self)
{
    struct gn_random *random = &run->random;
    struct world *world = random_world(run, (enum extra)self->value);
    uint32_t count = gn_ray_count(run, 16384), ladder = world->boxes ? count / 4 : 0;
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    if (ladder)
        gn_ladder_rays(random, world->boxes, world->box_count, true, rays, ladder);
    for (uint32_t i = ladder; i < count; i++) {
        aim_somewhere(random, world, (enum extra)self->value, &rays[i]);
        vary(random, &rays[i]);
    }
    gn_rays_shuffle(random, rays, count);
    gn_case_trace(run, &world->scene, self->value == DETAIL ? GN_CTS_DETAIL : GN_CTS_COMMITTED, rays, count, 0);
}

#define SPEC "any scene of meshes, instances, masks and flags (ray traversal)"
#define SCENE(name, extra) {"random." name, SPEC, random_scene, NULL, extra}

static const struct gn_case cases[] = {
    SCENE("scene_1", PLAIN),     SCENE("scene_2", PLAIN),     SCENE("scene_3", PLAIN),     SCENE("scene_4", PLAIN),
    SCENE("scene_5", PLAIN),     SCENE("scene_6", PLAIN),     SCENE("scene_7", PLAIN),     SCENE("scene_8", PLAIN),
    SCENE("scene_9", PLAIN),     SCENE("scene_10", PLAIN),    SCENE("scene_11", PLAIN),    SCENE("scene_12", PLAIN),
    SCENE("scene_13", PLAIN),    SCENE("scene_14", PLAIN),    SCENE("scene_15", PLAIN),    SCENE("scene_16", PLAIN),
    SCENE("scene_17", PLAIN),    SCENE("scene_18", PLAIN),    SCENE("scene_19", PLAIN),    SCENE("scene_20", PLAIN),
    SCENE("scene_21", PLAIN),    SCENE("scene_22", PLAIN),    SCENE("scene_23", PLAIN),    SCENE("scene_24", PLAIN),
    SCENE("shared_1", SHARED),   SCENE("shared_2", SHARED),   SCENE("shared_3", SHARED),
    SCENE("detail_1", DETAIL),   SCENE("detail_2", DETAIL),   SCENE("detail_3", DETAIL),   SCENE("inactive_1", INACTIVE),
    SCENE("inactive_2", INACTIVE), SCENE("inactive_3", INACTIVE), SCENE("offsets_1", OFFSETS), SCENE("offsets_2", OFFSETS),
    SCENE("offsets_3", OFFSETS),
};
const struct gn_case_family gn_family_random = {"random", cases, sizeof cases / sizeof cases[0]};
