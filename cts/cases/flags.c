/* SPDX-License-Identifier: Apache-2.0 */
/* Ray, instance and geometry flags: facing, opacity, skipping, ending at the first hit. */
#include "cts/compose.h"

#define SPEC_FACING                                                                                          \
    "a triangle's facing is that of its winding in object space, seen from the ray's origin; an instance "   \
    "transform does not change it, a geometry transform that mirrors does (Vulkan: "                         \
    "VkGeometryInstanceFlagBitsKHR; Ray Face Culling)"
#define SPEC_DISABLE                                                                                         \
    "TRIANGLE_FACING_CULL_DISABLE takes an instance out of face culling (Vulkan: "                           \
    "VkGeometryInstanceFlagBitsKHR)"
#define SPEC_FLIP                                                                                            \
    "TRIANGLE_FLIP_FACING turns the facing of an instance's triangles over (Vulkan: "                        \
    "VkGeometryInstanceFlagBitsKHR)"
#define SPEC_OPACITY                                                                                         \
    "the geometry's OPAQUE flag is overridden by the instance's FORCE flags, and those by the ray's Opaque " \
    "and "                                                                                                   \
    "NoOpaque (Vulkan: Ray Opacity Culling)"
#define SPEC_CULL_OPACITY                                                                                    \
    "CullOpaque and CullNoOpaque drop primitives by their final opacity (Vulkan: Ray Opacity Culling)"
#define SPEC_SKIP                                                                                            \
    "SkipTriangles and SkipAABBs drop all primitives of that kind (Vulkan: Ray Primitive Culling)"
#define SPEC_FIRST "TerminateOnFirstHit ends the query at any one committed hit (SPIR-V: Ray Flags)"

enum mirror { PLAIN, GEOMETRY, INSTANCE, BOTH, MIXED };
/* What an instance's flags are drawn from, at random where there are several. */
enum instance_flags {
    NO_FLAGS,
    FLIP,
    DISABLE,
    FLIP_DISABLE,
    ANY_FACING,
    ANY_FORCE,
    FORCE_OPAQUE,
    FORCE_NO_OPAQUE,
    ANY
};
enum content { OPAQUE = 1, NOT_OPAQUE = 2, TRIANGLES = 4, BOXES = 8 };

struct params {
    uint32_t content;
    enum mirror mirror;
    enum instance_flags instance_flags;
    uint32_t ray_flags;
    bool random_ray_flags;
    bool random_confirm;
    enum gn_cts_program program;
};

static const uint32_t face_flags[4] = {0, VK_GEOMETRY_INSTANCE_TRIANGLE_FLIP_FACING_BIT_KHR,
                                       VK_GEOMETRY_INSTANCE_TRIANGLE_FACING_CULL_DISABLE_BIT_KHR,
                                       VK_GEOMETRY_INSTANCE_TRIANGLE_FLIP_FACING_BIT_KHR |
                                           VK_GEOMETRY_INSTANCE_TRIANGLE_FACING_CULL_DISABLE_BIT_KHR};
static const uint32_t force_flags[3] = {0, VK_GEOMETRY_INSTANCE_FORCE_OPAQUE_BIT_KHR,
                                        VK_GEOMETRY_INSTANCE_FORCE_NO_OPAQUE_BIT_KHR};

static uint32_t pick_instance_flags(struct gn_random *random, enum instance_flags rule)
{
    uint32_t face = face_flags[gn_random_below(random, 4)], force = force_flags[gn_random_below(random, 3)];
    switch (rule) {
    case NO_FLAGS:
        return 0;
    case FLIP:
        return face_flags[1];
    case DISABLE:
        return face_flags[2];
    case FLIP_DISABLE:
        return face_flags[3];
    case ANY_FACING:
        return face;
    case ANY_FORCE:
        return force;
    case FORCE_OPAQUE:
        return force_flags[1];
    case FORCE_NO_OPAQUE:
        return force_flags[2];
    case ANY:
        return face | force;
    }
    return 0;
}

/* Any combination that the API allows: one opacity flag, and one of the culling and skipping flags. A query
 * that ends early may leave out any candidate, so lists of candidates do without. */
static uint32_t pick_ray_flags(struct gn_random *random, bool may_end_early)
{
    static const uint32_t opacity[5] = {0, GN_REF_RAY_OPAQUE, GN_REF_RAY_NO_OPAQUE, GN_REF_RAY_CULL_OPAQUE,
                                        GN_REF_RAY_CULL_NO_OPAQUE};
    static const uint32_t cull[6] = {0,
                                     GN_REF_RAY_CULL_BACK_FACING,
                                     GN_REF_RAY_CULL_FRONT_FACING,
                                     GN_REF_RAY_SKIP_TRIANGLES,
                                     GN_REF_RAY_SKIP_AABBS,
                                     GN_REF_RAY_SKIP_AABBS | GN_REF_RAY_CULL_BACK_FACING};
    static const uint32_t rest[4] = {0, 0, GN_REF_RAY_TERMINATE_ON_FIRST_HIT,
                                     GN_REF_RAY_SKIP_CLOSEST_HIT_SHADER};
    uint32_t flags = opacity[gn_random_below(random, 5)] | cull[gn_random_below(random, 6)];
    return may_end_early ? flags | rest[gn_random_below(random, 4)] : flags;
}

enum { LAYERS = 12 };

static bool mirrored(struct gn_random *random, enum mirror mirror, enum mirror which)
{
    if (mirror == MIXED)
        return gn_random_below(random, 2);
    return mirror == which || mirror == BOTH;
}

/*
 * Layers above each other at z = 0, 1, ... that face up and down in turn. A layer is an instance of a height
 * field of its own, at z - 1/4, and with BOXES there is a ladder whose rungs are at z: so whatever a flag
 * takes away, something else is behind it.
 */
static void layers(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    struct gn_arena *arena = &run->arena;
    struct gn_random *random = &run->random;
    bool triangles = params->content & TRIANGLES, boxes = params->content & BOXES;
    uint32_t opacity = params->content & (OPAQUE | NOT_OPAQUE);

    struct gn_cts_geometry *geometries = GN_NEW(arena, struct gn_cts_geometry, LAYERS + 2);
    struct gn_cts_blas *blases = GN_NEW(arena, struct gn_cts_blas, LAYERS + 2);
    struct gn_cts_instance *instances = GN_NEW(arena, struct gn_cts_instance, LAYERS + 2);
    uint32_t count = 0;
    for (uint32_t i = 0; triangles && i < LAYERS; i++, count++) {
        struct gn_mesh mesh = gn_mesh_height_field(arena, random, 6, 0.125);
        geometries[count] = gn_geometry_of_mesh(&mesh);
        float *transform = GN_NEW(arena, float, 12);
        bool mirror = mirrored(random, params->mirror, GEOMETRY);
        gn_transform_scale(mirror ? -1.5 : 1.5, 1.5, 1, 0, 0, 0, transform);
        geometries[count].transform = transform;
        geometries[count].flags = opacity == OPAQUE || (opacity != NOT_OPAQUE && gn_random_below(random, 2))
                                      ? VK_GEOMETRY_OPAQUE_BIT_KHR
                                      : 0;
        instances[count] = gn_instance_of(count, NULL);
        /* Turned about the x axis by half a turn: faces the other way, without mirroring. */
        double turn = i & 1 ? -1 : 1;
        gn_transform_scale(mirrored(random, params->mirror, INSTANCE) ? -1.25 : 1.25, turn, turn, 0, 0,
                           i - 0.25, instances[count].transform);
    }
    const float(*ladder)[6] = gn_ladder_make(arena, random, LAYERS, 0.25);
    for (uint32_t i = 0; boxes && i < 2; i++) {
        /* Two ladders share the rungs; what the other one has is aside, where no ray goes. */
        if (i == 1 && opacity != (OPAQUE | NOT_OPAQUE))
            break;
        float(*own)[6] = gn_arena_alloc(arena, LAYERS, sizeof *own);
        for (uint32_t p = 0; p < LAYERS; p++)
            for (int a = 0; a < 6; a++)
                own[p][a] = ladder[p][a] +
                            (opacity == (OPAQUE | NOT_OPAQUE) && (p / 2 & 1) != i && a % 3 == 0 ? 64 : 0);
        geometries[count] = (struct gn_cts_geometry){
            .type = GN_REF_AABBS,
            .flags = opacity == OPAQUE || (opacity != NOT_OPAQUE && i) ? VK_GEOMETRY_OPAQUE_BIT_KHR : 0,
            .aabbs = (const float(*)[6])own,
            .aabb_count = LAYERS};
        instances[count] = gn_instance_of(count, NULL);
        count++;
    }
    for (uint32_t i = 0; i < count; i++) {
        blases[i] = (struct gn_cts_blas){.geometries = &geometries[i], .geometry_count = 1};
        instances[i].custom_index = i * 7;
        instances[i].flags = pick_instance_flags(random, params->instance_flags);
    }
    struct gn_cts_scene scene = gn_scene_make(blases, count, instances, count);

    uint32_t ray_count = gn_ray_count(run, 8192);
    struct gn_cts_ray *rays = GN_NEW(arena, struct gn_cts_ray, ray_count);
    gn_ladder_rays(random, ladder, LAYERS, true, rays, ray_count);
    for (uint32_t i = 0; i < ray_count; i++) {
        struct gn_ref_ray *ray = &rays[i].ray;
        ray->flags = params->random_ray_flags ? pick_ray_flags(random, params->program == GN_CTS_COMMITTED)
                                              : params->ray_flags;
        if (params->random_confirm)
            rays[i].policy.confirm_mask = (uint32_t)gn_random_u64(random);
        /* Half of the rays start between two layers, so that every layer is the nearest to some. */
        if (gn_random_below(random, 2))
            ray->tmin = (float)(gn_random_below(random, LAYERS - 2) + 0.5);
    }
    gn_case_trace(run, &scene, params->program, rays, ray_count, 0);
}

#define CASE(label, spec, ...)                                                                               \
    {                                                                                                        \
        "flags." label, spec, layers, &(const struct params){__VA_ARGS__}, 0                                 \
    }
#define FACING(label, spec, mirror, instance_flags)                                                          \
    CASE("cull_back." label, spec, OPAQUE | TRIANGLES, mirror, instance_flags, GN_REF_RAY_CULL_BACK_FACING,  \
         false, false, GN_CTS_COMMITTED),                                                                    \
        CASE("cull_front." label, spec, OPAQUE | TRIANGLES, mirror, instance_flags,                          \
             GN_REF_RAY_CULL_FRONT_FACING, false, false, GN_CTS_COMMITTED)
#define OPACITY(label, spec, flags)                                                                          \
    CASE("opacity." label, spec, OPAQUE | NOT_OPAQUE | TRIANGLES, PLAIN, ANY_FORCE, flags, false, true,      \
         GN_CTS_COMMITTED),                                                                                  \
        CASE("opacity." label "_candidates", spec, OPAQUE | NOT_OPAQUE | TRIANGLES, PLAIN, ANY_FORCE, flags, \
             false, true, GN_CTS_CANDIDATES)
#define BOX_OPACITY(label, flags)                                                                            \
    CASE("opacity.boxes_" label, SPEC_CULL_OPACITY, OPAQUE | NOT_OPAQUE | BOXES, PLAIN, ANY_FORCE, flags,    \
         false, false, GN_CTS_COMMITTED)
#define SKIP(label, flags, program)                                                                          \
    CASE("skip." label, SPEC_SKIP, OPAQUE | NOT_OPAQUE | TRIANGLES | BOXES, PLAIN, NO_FLAGS, flags, false,   \
         true, program)
#define FIRST(label, content, program)                                                                       \
    CASE("first_hit." label, SPEC_FIRST, content, PLAIN, NO_FLAGS, GN_REF_RAY_TERMINATE_ON_FIRST_HIT, false, \
         true, program)

static const struct gn_case cases[] = {
    FACING("plain", SPEC_FACING, PLAIN, NO_FLAGS),
    FACING("mirrored_geometry", SPEC_FACING, GEOMETRY, NO_FLAGS),
    FACING("mirrored_instance", SPEC_FACING, INSTANCE, NO_FLAGS),
    FACING("mirrored_both", SPEC_FACING, BOTH, NO_FLAGS),
    FACING("flipped", SPEC_FLIP, PLAIN, FLIP),
    FACING("flipped_and_mirrored", SPEC_FLIP, MIXED, FLIP),
    FACING("disabled", SPEC_DISABLE, PLAIN, DISABLE),
    FACING("disabled_and_flipped", SPEC_DISABLE, MIXED, FLIP_DISABLE),
    FACING("mixed", SPEC_FACING, MIXED, ANY_FACING),
    CASE("facing.mixed", SPEC_FACING, OPAQUE | TRIANGLES, MIXED, ANY_FACING, 0, false, false,
         GN_CTS_COMMITTED),
    CASE("facing.candidates", SPEC_FACING, NOT_OPAQUE | TRIANGLES, MIXED, ANY_FACING, 0, false, false,
         GN_CTS_CANDIDATES),
    CASE("facing.cull_back_candidates", SPEC_FACING, NOT_OPAQUE | TRIANGLES, MIXED, ANY_FACING,
         GN_REF_RAY_CULL_BACK_FACING, false, false, GN_CTS_CANDIDATES),
    CASE("facing.boxes", "face culling is of triangles only (Vulkan: Ray Face Culling)",
         OPAQUE | TRIANGLES | BOXES, MIXED, ANY_FACING, GN_REF_RAY_CULL_FRONT_FACING, false, false,
         GN_CTS_COMMITTED),
    OPACITY("none", SPEC_OPACITY, 0),
    OPACITY("ray_opaque", SPEC_OPACITY, GN_REF_RAY_OPAQUE),
    OPACITY("ray_no_opaque", SPEC_OPACITY, GN_REF_RAY_NO_OPAQUE),
    OPACITY("cull_opaque", SPEC_CULL_OPACITY, GN_REF_RAY_CULL_OPAQUE),
    OPACITY("cull_no_opaque", SPEC_CULL_OPACITY, GN_REF_RAY_CULL_NO_OPAQUE),
    CASE("opacity.force_opaque", SPEC_OPACITY, NOT_OPAQUE | TRIANGLES, PLAIN, FORCE_OPAQUE, 0, false, true,
         GN_CTS_COMMITTED),
    CASE("opacity.force_no_opaque", SPEC_OPACITY, OPAQUE | TRIANGLES, PLAIN, FORCE_NO_OPAQUE, 0, false, true,
         GN_CTS_COMMITTED),
    BOX_OPACITY("none", 0),
    BOX_OPACITY("cull_opaque", GN_REF_RAY_CULL_OPAQUE),
    BOX_OPACITY("cull_no_opaque", GN_REF_RAY_CULL_NO_OPAQUE),
    BOX_OPACITY("ray_opaque", GN_REF_RAY_OPAQUE),
    SKIP("none", 0, GN_CTS_COMMITTED),
    SKIP("triangles", GN_REF_RAY_SKIP_TRIANGLES, GN_CTS_COMMITTED),
    SKIP("boxes", GN_REF_RAY_SKIP_AABBS, GN_CTS_COMMITTED),
    SKIP("triangles_candidates", GN_REF_RAY_SKIP_TRIANGLES | GN_REF_RAY_NO_OPAQUE, GN_CTS_CANDIDATES),
    SKIP("boxes_candidates", GN_REF_RAY_SKIP_AABBS | GN_REF_RAY_NO_OPAQUE, GN_CTS_CANDIDATES),
    SKIP("boxes_and_faces", GN_REF_RAY_SKIP_AABBS | GN_REF_RAY_CULL_BACK_FACING, GN_CTS_COMMITTED),
    FIRST("opaque", OPAQUE | TRIANGLES, GN_CTS_COMMITTED),
    FIRST("not_opaque", NOT_OPAQUE | TRIANGLES, GN_CTS_COMMITTED),
    FIRST("mixed", OPAQUE | NOT_OPAQUE | TRIANGLES, GN_CTS_COMMITTED),
    FIRST("boxes", NOT_OPAQUE | BOXES, GN_CTS_COMMITTED),
    CASE("skip_closest_hit_shader",
         "SkipClosestHitShader makes no difference to a ray query (SPIR-V: Ray Flags)",
         OPAQUE | NOT_OPAQUE | TRIANGLES, PLAIN, ANY_FORCE, GN_REF_RAY_SKIP_CLOSEST_HIT_SHADER, false, true,
         GN_CTS_COMMITTED),
    CASE("random",
         "any allowed combination of ray, instance and geometry flags (Vulkan: Ray Intersection Culling)",
         OPAQUE | NOT_OPAQUE | TRIANGLES | BOXES, MIXED, ANY, 0, true, true, GN_CTS_COMMITTED),
    CASE("random_candidates",
         "any allowed combination of ray, instance and geometry flags (Vulkan: Ray Intersection Culling)",
         OPAQUE | NOT_OPAQUE | TRIANGLES | BOXES, MIXED, ANY, 0, true, true, GN_CTS_CANDIDATES),
};
const struct gn_case_family gn_family_flags = {"flags", cases, sizeof cases / sizeof cases[0]};
