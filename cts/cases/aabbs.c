/* SPDX-License-Identifier: Apache-2.0 */
/* Boxes: every one that a ray meets has to be presented, and the nearest generated hit is committed. */
#include "cts/compose.h"

#include <math.h>

#define SPEC_OPAQUE                                                                                          \
    "whether a box is opaque can be asked, and decides whether any-hit shaders run for it (SPV_KHR_ray_query: " \
    "OpRayQueryGetIntersectionCandidateAABBOpaqueKHR; Vulkan: Any-Hit Shaders, Opacity)"
#define SPEC_CANDIDATE                                                                                       \
    "every box that a ray meets within its range is a candidate; others may be, because boxes may be "       \
    "enlarged "                                                                                              \
    "(Vulkan: Ray Intersection Candidate Determination; VkAabbPositionsKHR)"
#define SPEC_NEAREST                                                                                         \
    "the nearest of the hits that were generated is committed (Vulkan: Ray Closest Hit Determination; "      \
    "SPV_KHR_ray_query: OpRayQueryGenerateIntersectionKHR)"
#define SPEC_INSIDE                                                                                          \
    "a ray that starts inside a box meets it (Vulkan: Ray Intersection Candidate Determination)"
#define SPEC_STRIDE                                                                                          \
    "stride is in bytes from box to box (Vulkan: VkAccelerationStructureGeometryAabbsDataKHR::stride)"
#define SPEC_INACTIVE "a box whose least x is NaN is inactive (Vulkan: Inactive Primitives and Instances)"
#define SPEC_DUPLICATE "NO_DUPLICATE_ANY_HIT_INVOCATION loses no box (Vulkan: VkGeometryFlagBitsKHR)"

/* Ladders: hits are generated in the middle of the rungs that the policy wants. */

struct ladder_params {
    uint32_t rungs;
    double thickness;
    bool all_wanted;
    bool inactive; /* every third box */
    uint32_t stride;
    uint32_t flags;
    double scale;     /* of the whole scene; 0: 1 */
    bool short_range; /* the range ends between two rungs */
    bool overlapping; /* every box reaches over its neighbours' middles */
};

static void ladder(struct gn_case_run *run, const struct gn_case *self)
{
    const struct ladder_params *params = self->params;
    struct gn_random *random = &run->random;
    const float(*made)[6] = gn_ladder_make(&run->arena, random, params->rungs, params->thickness);
    float(*boxes)[6] = gn_arena_alloc(&run->arena, params->rungs, sizeof *boxes);
    float scale = params->scale > 0 ? (float)params->scale : 1;
    for (uint32_t i = 0; i < params->rungs; i++)
        for (int a = 0; a < 6; a++) {
            boxes[i][a] = params->inactive && i % 3 == 1 ? __builtin_nanf("") : made[i][a];
            if (params->overlapping && a % 3 == 2)
                boxes[i][a] += (a == 2 ? -1 : 1) * (float)gn_random_range(random, 0.5, 4);
        }
    uint32_t count = gn_ray_count(run, 16384);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_ladder_rays(random, (const float(*)[6])boxes, params->rungs, !params->all_wanted, rays, count);
    for (uint32_t i = 0; i < count; i++) {
        struct gn_ref_ray *ray = &rays[i].ray;
        if (params->short_range) {
            float from = (float)gn_random_below(random, params->rungs) + 0.5f;
            ray->tmin = from;
            ray->tmax = from + (float)(1 + gn_random_below(random, params->rungs));
        }
        /* The scale is a power of two, and t is not changed by it. */
        for (int a = 0; a < 3; a++) {
            ray->origin[a] *= scale;
            ray->direction[a] *= scale;
        }
    }
    for (uint32_t i = 0; i < params->rungs; i++)
        for (int a = 0; a < 6; a++)
            boxes[i][a] *= scale;
    struct gn_cts_geometry geometry = {.type = GN_REF_AABBS,
                                       .flags = params->flags,
                                       .aabbs = (const float(*)[6])boxes,
                                       .aabb_count = params->rungs,
                                       .aabb_stride = params->stride};
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* A field of columns of boxes; rays go up or down one column. A box that is presented although the ray is in
 * another column would generate its hit beyond tmax or before tmin. */
enum { COLUMNS = 40, LEVELS = 8 };

static void columns(struct gn_case_run *run, const struct gn_case *self)
{
    (void)self;
    struct gn_random *random = &run->random;
    uint32_t box_count = COLUMNS * COLUMNS * LEVELS;
    float(*boxes)[6] = gn_arena_alloc(&run->arena, box_count, sizeof *boxes);
    for (uint32_t i = 0; i < box_count; i++) {
        uint32_t level = i % LEVELS, x = i / LEVELS % COLUMNS, y = i / LEVELS / COLUMNS;
        const float box[6] = {(float)x,         (float)y,         (float)level,
                              (float)x + 0.75f, (float)y + 0.75f, (float)level + 0.5f};
        for (int a = 0; a < 6; a++)
            boxes[i][a] = box[a];
    }
    struct gn_cts_geometry geometry = {
        .type = GN_REF_AABBS, .aabbs = (const float(*)[6])boxes, .aabb_count = box_count};
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    uint32_t count = gn_ray_count(run, 32768);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    for (uint32_t i = 0; i < count; i++) {
        uint32_t x = gn_random_below(random, COLUMNS), y = gn_random_below(random, COLUMNS);
        bool up = gn_random_below(random, 2);
        double lean = 0.5 / (LEVELS + 2), sign = up ? 1 : -1;
        double origin[3] = {x + gn_random_range(random, 0.1, 0.6), y + gn_random_range(random, 0.1, 0.6),
                            up ? -1 : LEVELS};
        double direction[3] = {0, 0, sign};
        for (int a = 0; a < 2; a++) {
            double end = (a ? y : x) + gn_random_range(random, 0.1, 0.6);
            direction[a] = fmax(-lean, fmin(lean, (end - origin[a]) / (LEVELS + 1)));
        }
        rays[i] = gn_ray_make(origin, direction, LEVELS + 0.5);
        rays[i].ray.tmin = 0.5f;
        /* z = level + 1/4 is met at t = (level + 1/4 - origin.z) / sign. */
        uint32_t first = (y * COLUMNS + x) * LEVELS;
        rays[i].policy = (struct gn_ref_policy){.generate_step = (float)sign};
        rays[i].policy.generate_t0 = (float)((0.25 - (double)first - origin[2]) * sign);
        uint32_t wanted = (uint32_t)gn_random_u64(random);
        for (uint32_t level = 0; level < LEVELS; level++)
            rays[i].policy.generate_mask |= (wanted >> level & 1) << ((first + level) & 31);
    }
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* Boxes within each other: every one holds the places where the hits of all are generated. */
static void nested(struct gn_case_run *run, const struct gn_case *self)
{
    (void)self;
    enum { BOXES = 32 };
    struct gn_random *random = &run->random;
    float boxes[BOXES][6];
    for (uint32_t i = 0; i < BOXES; i++)
        for (int a = 0; a < 6; a++)
            boxes[i][a] = (a < 3 ? -1 : 1) * (1 + 0.125f * (float)((i * 13) % BOXES));
    struct gn_cts_geometry geometry = {
        .type = GN_REF_AABBS, .aabbs = (const float(*)[6])boxes, .aabb_count = BOXES};
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    uint32_t count = gn_ray_count(run, 16384);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    for (uint32_t i = 0; i < count; i++) {
        double origin[3], direction[3];
        for (int a = 0; a < 3; a++) {
            double target = gn_random_range(random, -0.25, 0.25);
            origin[a] = gn_random_range(random, -8, 8);
            direction[a] = (target - origin[a]) / 8;
        }
        rays[i] = gn_ray_make(origin, direction, 100);
        /* At t = 8 the ray is within 1/4 of the middle, and 8 +- 1/4 is within 3/4 of it. */
        float sign = gn_random_below(random, 2) ? 1 : -1;
        rays[i].policy = (struct gn_ref_policy){.generate_mask = (uint32_t)gn_random_u64(random),
                                                .generate_t0 = 8 - sign * 0.25f,
                                                .generate_step = sign / 64};
    }
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* A ladder of boxes and a stack of opaque layers: either kind hides the other. */
static void mixed(struct gn_case_run *run, const struct gn_case *self)
{
    enum { RUNGS = 12 };
    struct gn_random *random = &run->random;
    const float(*boxes)[6] = gn_ladder_make(&run->arena, random, RUNGS, 0.25);
    struct gn_cts_geometry geometries[2] = {{.type = GN_REF_AABBS, .aabbs = boxes, .aabb_count = RUNGS}};
    struct gn_mesh mesh = gn_mesh_height_field(&run->arena, random, 6, 0.125);
    mesh = gn_mesh_scaled(&run->arena, &mesh, 0.75, 1.75, 1, 0, 0, 0);
    geometries[1] = gn_geometry_of_mesh(&mesh);
    geometries[1].flags = (uint32_t)self->value;
    struct gn_cts_blas blases[2] = {{.geometries = &geometries[0], .geometry_count = 1},
                                    {.geometries = &geometries[1], .geometry_count = 1}};
    struct gn_cts_instance instances[RUNGS];
    instances[0] = gn_instance_of(0, NULL);
    for (uint32_t i = 1; i < RUNGS; i++) {
        instances[i] = gn_instance_of(1, NULL);
        gn_instance_place(&instances[i], gn_random_range(random, -1, 1), 0, i - 0.5);
    }
    struct gn_cts_scene scene = gn_scene_make(blases, 2, instances, RUNGS);
    uint32_t count = gn_ray_count(run, 16384);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_ladder_rays(random, boxes, RUNGS, true, rays, count);
    for (uint32_t i = 0; i < count; i++)
        rays[i].policy.confirm_mask = (uint32_t)gn_random_u64(random);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* Lists of candidates for rays through many boxes. */

enum aim { INTO, FROM_INSIDE, ALONG_FACES, THROUGH_EDGES, THROUGH_CORNERS };

struct list_params {
    uint32_t boxes;
    double min_half, max_half;
    int flat_axes; /* bits: no extent along these */
    enum aim aim;
    uint32_t flags;
    uint32_t instances; /* 0: one with the identity */
    uint32_t stride, offset;
    bool inactive;
    bool grid; /* boxes on a lattice */
};

/* A box, and a ray from outside that meets its boundary at an exactly known point. */
static struct gn_cts_ray boundary_ray(struct gn_random *random, const float box[6], enum aim aim)
{
    double target[3], direction[3], origin[3];
    uint32_t axis = gn_random_below(random, 3);
    for (uint32_t a = 0; a < 3; a++) {
        bool high = gn_random_below(random, 2);
        /* Boxes of the grid are 1/2 wide: the sixteenths are exact. */
        double inner = box[a] + (1 + gn_random_below(random, 7)) / 16.0, outer = high ? box[a + 3] : box[a];
        bool on_boundary = aim == THROUGH_CORNERS || (aim == THROUGH_EDGES && a != axis) ||
                           (aim == ALONG_FACES && a == axis);
        target[a] = on_boundary ? outer : inner;
        direction[a] = ((high ? -1.0 : 1.0) * (1 + gn_random_below(random, 8))) / 8;
        if (aim == ALONG_FACES && a == axis)
            direction[a] = 0;
    }
    uint32_t t = 1 + gn_random_below(random, 4);
    for (int a = 0; a < 3; a++)
        origin[a] = target[a] - direction[a] * t;
    return gn_ray_make(origin, direction, 10);
}

static void list(struct gn_case_run *run, const struct gn_case *self)
{
    const struct list_params *params = self->params;
    struct gn_arena *arena = &run->arena;
    struct gn_random *random = &run->random;
    float(*boxes)[6] = gn_arena_alloc(arena, params->boxes, sizeof *boxes);
    for (uint32_t i = 0; i < params->boxes; i++)
        for (int a = 0; a < 3; a++) {
            uint32_t cell = a == 0 ? i & 3 : a == 1 ? i >> 2 & 3 : i >> 4 & 3;
            double middle = params->grid ? (double)cell - 1.75 : gn_random_range(random, -1, 1);
            double half = gn_random_range(random, params->min_half, params->max_half);
            if (params->flat_axes >> a & 1)
                half = 0;
            boxes[i][a] = (float)(middle - half);
            boxes[i][a + 3] = (float)(middle + half);
        }
    for (uint32_t i = 0; i < params->boxes; i++)
        for (int a = 0; params->inactive && i % 4 == 2 && a < 6; a++)
            boxes[i][a] = __builtin_nanf("");
    struct gn_cts_geometry geometry = {.type = GN_REF_AABBS,
                                       .flags = params->flags,
                                       .aabbs = (const float(*)[6])boxes,
                                       .aabb_count = params->boxes,
                                       .aabb_stride = params->stride,
                                       .primitive_offset = params->offset};
    struct gn_cts_blas blas = {.geometries = &geometry, .geometry_count = 1};
    uint32_t instance_count = params->instances ? params->instances : 1;
    struct gn_cts_instance *instances = GN_NEW(arena, struct gn_cts_instance, instance_count);
    for (uint32_t i = 0; i < instance_count; i++) {
        instances[i] = gn_instance_of(0, NULL);
        if (params->instances)
            gn_transform_general(random, 0.5, 1.5, 0.5, 3, i & 1, instances[i].transform);
    }
    struct gn_cts_scene scene = gn_scene_make(&blas, 1, instances, instance_count);
    uint32_t count = gn_ray_count(run, 8192);
    struct gn_cts_ray *rays = GN_NEW(arena, struct gn_cts_ray, count);
    gn_rays_at_scene(run, &scene, 2, true, rays, count);
    for (uint32_t i = 0; i < count; i++) {
        const float *box = boxes[gn_random_below(random, params->boxes)];
        if (params->aim >= ALONG_FACES)
            rays[i] = boundary_ray(random, box, params->aim);
        if (params->aim == FROM_INSIDE) {
            for (int a = 0; a < 3; a++)
                rays[i].ray.origin[a] =
                    box[a] + (box[a + 3] - box[a]) * (float)gn_random_range(random, 0.1, 0.9);
            /* Often the range ends before the ray leaves the box. */
            rays[i].ray.tmax = i & 1 ? 1e-4f : 2;
        }
        rays[i].policy = (struct gn_ref_policy){0};
    }
    gn_case_trace(run, &scene, GN_CTS_CANDIDATES, rays, count, 0);
}

/* What a box is: hits are generated only on those that are opaque, as shaders find out. */
struct opaque_params {
    uint32_t geometry_flags; /* of the first; there is a second one of the same boxes, which is otherwise */
    uint32_t instance_flags;
    uint32_t ray_flags;
};

static void opaque(struct gn_case_run *run, const struct gn_case *self)
{
    enum { RUNGS = 24 };
    const struct opaque_params *params = self->params;
    struct gn_arena *arena = &run->arena;
    const float(*boxes)[6] = gn_ladder_make(arena, &run->random, RUNGS, 0.5);
    struct gn_cts_geometry geometries[2];
    for (uint32_t g = 0; g < 2; g++)
        geometries[g] = (struct gn_cts_geometry){.type = GN_REF_AABBS,
                                                 .flags = params->geometry_flags ^ (g ? VK_GEOMETRY_OPAQUE_BIT_KHR : 0),
                                                 .aabbs = boxes,
                                                 .aabb_count = RUNGS};
    /* Where both would answer alike, which one does is not defined: then there is but one. */
    const bool both = !params->instance_flags && !params->ray_flags;
    struct gn_cts_blas blas = {.geometries = geometries, .geometry_count = both ? 2 : 1};
    struct gn_cts_instance instance = gn_instance_of(0, NULL);
    instance.flags = params->instance_flags;
    struct gn_cts_scene scene = gn_scene_make(&blas, 1, &instance, 1);
    const uint32_t count = gn_ray_count(run, 4096);
    struct gn_cts_ray *rays = GN_NEW(arena, struct gn_cts_ray, count), *judged = GN_NEW(arena, struct gn_cts_ray, count);
    gn_ladder_rays(&run->random, boxes, RUNGS, true, rays, count);
    for (uint32_t i = 0; i < count; i++) {
        rays[i].ray.flags = params->ray_flags;
        judged[i] = rays[i];
        /* What is not opaque might as well not be there. */
        judged[i].ray.flags = params->ray_flags & GN_REF_RAY_OPAQUE      ? GN_REF_RAY_OPAQUE
                              : params->ray_flags & GN_REF_RAY_NO_OPAQUE ? GN_REF_RAY_SKIP_AABBS
                                                                         : GN_REF_RAY_CULL_NO_OPAQUE;
    }
    run->route.opaque_boxes = true;
    gn_case_trace_as(run, &scene, GN_CTS_COMMITTED, rays, judged, count, 0);
}

#define OPACITY(label, geometry, instance, ray)                                                              \
    {"aabbs.opaque_asked." label, SPEC_OPAQUE, opaque, &(const struct opaque_params){geometry, instance, ray}, 0}
#define LADDER(label, spec, ...)                                                                             \
    {                                                                                                        \
        "aabbs." label, spec, ladder, &(const struct ladder_params){__VA_ARGS__}, 0                          \
    }
#define LIST(label, spec, ...)                                                                               \
    {                                                                                                        \
        "aabbs." label, spec, list, &(const struct list_params){__VA_ARGS__}, 0                              \
    }
static const struct gn_case cases[] = {
    LADDER("nearest", SPEC_NEAREST, .rungs = 24, .thickness = 0.5),
    LADDER("nearest_of_all", SPEC_NEAREST, .rungs = 24, .thickness = 0.5, .all_wanted = true),
    LADDER("nearest_of_overlapping", SPEC_NEAREST, .rungs = 24, .thickness = 0.5, .overlapping = true),
    LADDER("one", SPEC_NEAREST, .rungs = 1, .thickness = 0.5, .all_wanted = true),
    LADDER("flat", SPEC_NEAREST, .rungs = 16, .thickness = 0),
    LADDER("opaque", "a box is presented even if it is opaque (SPV_KHR_ray_query: OpRayQueryProceedKHR)",
           .rungs = 16, .thickness = 0.5, .flags = GN_REF_GEOMETRY_OPAQUE),
    OPACITY("first", VK_GEOMETRY_OPAQUE_BIT_KHR, 0, 0),
    OPACITY("second", 0, 0, 0),
    OPACITY("force_opaque", 0, VK_GEOMETRY_INSTANCE_FORCE_OPAQUE_BIT_KHR, 0),
    OPACITY("force_no_opaque", VK_GEOMETRY_OPAQUE_BIT_KHR, VK_GEOMETRY_INSTANCE_FORCE_NO_OPAQUE_BIT_KHR, 0),
    OPACITY("ray_opaque", 0, VK_GEOMETRY_INSTANCE_FORCE_NO_OPAQUE_BIT_KHR, GN_REF_RAY_OPAQUE),
    OPACITY("ray_no_opaque", VK_GEOMETRY_OPAQUE_BIT_KHR, VK_GEOMETRY_INSTANCE_FORCE_OPAQUE_BIT_KHR, GN_REF_RAY_NO_OPAQUE),
    LADDER("inactive", SPEC_INACTIVE, .rungs = 24, .thickness = 0.5, .inactive = true),
    LADDER("short_range", SPEC_CANDIDATE, .rungs = 24, .thickness = 0.5, .short_range = true),
    LADDER("stride_32", SPEC_STRIDE, .rungs = 16, .thickness = 0.5, .stride = 32),
    LADDER("stride_40", SPEC_STRIDE, .rungs = 16, .thickness = 0.5, .stride = 40),
    LADDER("stride_1024", SPEC_STRIDE, .rungs = 16, .thickness = 0.5, .stride = 1024),
    LADDER("tiny", SPEC_NEAREST, .rungs = 16, .thickness = 0.5, .scale = 0x1p-40),
    LADDER("huge", SPEC_NEAREST, .rungs = 16, .thickness = 0.5, .scale = 0x1p40),
    {"aabbs.columns", SPEC_NEAREST, columns, NULL, 0},
    {"aabbs.nested", SPEC_NEAREST, nested, NULL, 0},
    {"aabbs.with_triangles", SPEC_NEAREST, mixed, NULL, GN_REF_GEOMETRY_OPAQUE},
    {"aabbs.with_triangles_not_opaque", SPEC_NEAREST, mixed, NULL, 0},
    LIST("list", SPEC_CANDIDATE, .boxes = 200, .min_half = 0.02, .max_half = 0.2),
    LIST("list_many", SPEC_CANDIDATE, .boxes = 4000, .min_half = 0.002, .max_half = 0.05),
    LIST("list_flat", SPEC_CANDIDATE, .boxes = 200, .min_half = 0.02, .max_half = 0.2, .flat_axes = 1),
    LIST("list_lines", SPEC_CANDIDATE, .boxes = 200, .min_half = 0.02, .max_half = 0.2, .flat_axes = 6),
    LIST("list_inactive", SPEC_INACTIVE, .boxes = 200, .min_half = 0.02, .max_half = 0.2, .inactive = true),
    LIST("list_transformed", SPEC_CANDIDATE, .boxes = 60, .min_half = 0.02, .max_half = 0.2, .instances = 8),
    LIST("list_offset", "the offset counts bytes before the first box (Vulkan: VkAccelerationStructureBuildRangeInfoKHR)",
         .boxes = 200, .min_half = 0.02, .max_half = 0.2, .offset = 72),
    LIST("list_offset_stride", "the offset counts bytes before the first box (Vulkan: VkAccelerationStructureBuildRangeInfoKHR)",
         .boxes = 200, .min_half = 0.02, .max_half = 0.2, .stride = 40, .offset = 1000),
    LIST("no_duplicate_flag", SPEC_DUPLICATE, .boxes = 100, .min_half = 0.01, .max_half = 0.3,
         .flags = GN_REF_GEOMETRY_NO_DUPLICATE),
    LIST("inside", SPEC_INSIDE, .boxes = 64, .min_half = 0.05, .max_half = 0.3, .aim = FROM_INSIDE),
    LIST("along_faces", SPEC_CANDIDATE, .boxes = 64, .min_half = 0.25, .max_half = 0.25, .grid = true,
         .aim = ALONG_FACES),
    LIST("through_edges", SPEC_CANDIDATE, .boxes = 64, .min_half = 0.25, .max_half = 0.25, .grid = true,
         .aim = THROUGH_EDGES),
    LIST("through_corners", SPEC_CANDIDATE, .boxes = 64, .min_half = 0.25, .max_half = 0.25, .grid = true,
         .aim = THROUGH_CORNERS),
};
const struct gn_case_family gn_family_aabbs = {"aabbs", cases, sizeof cases / sizeof cases[0]};
