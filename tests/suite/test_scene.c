/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Scenes built on a device in every way that a case can ask for, and traced with every program. What comes back
 * is known beforehand: rays go straight down into the middle of things. The judgement of rays that are not so
 * simple is the reference's; here it is only seen that a scene arrives on the device as it was described.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "cts/device_internal.h"
#include "cts/vertex_format.h"

enum { CELLS = 8, VERTICES = (CELLS + 1) * (CELLS + 1), TRIANGLES = 2 * CELLS * CELLS, BOXES = CELLS };

static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
static const float moved_by_5[12] = {1, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0};
static const float moved_back[12] = {1, 0, 0, -5, 0, 1, 0, 0, 0, 0, 1, 0};

/* A grid of triangles over [0,1]^2 in the plane z = 1/2, the same 5 to the side, and a row of boxes. */
static double grid[VERTICES][3], grid_aside[VERTICES][3], grid_near[VERTICES][3];
static uint32_t triangles[TRIANGLES][3];
static float boxes[BOXES][6], boxes_aside[BOXES][6];

static struct gn_device *device;

static void data_fill(void)
{
    for (uint32_t i = 0; i < VERTICES; i++) {
        grid[i][0] = (double)(i % (CELLS + 1)) / CELLS;
        grid[i][1] = (double)(i / (CELLS + 1)) / CELLS;
        grid[i][2] = 0.5;
        memcpy(grid_aside[i], grid[i], sizeof grid[i]);
        memcpy(grid_near[i], grid[i], sizeof grid[i]);
        grid_aside[i][0] += 5.0;
        grid_near[i][2] = 0.0;
    }
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        const uint32_t corner = i / 2 / CELLS * (CELLS + 1) + i / 2 % CELLS;
        const uint32_t cell[2][3] = {{corner, corner + 1, corner + CELLS + 1},
                                     {corner + CELLS + 2, corner + CELLS + 1, corner + 1}};
        memcpy(triangles[i], cell[i % 2], sizeof triangles[i]);
    }
    for (uint32_t i = 0; i < BOXES; i++) {
        const float box[6] = {(float)i, 0, 0, (float)i + 0.5f, 1, 1};
        const float aside[6] = {(float)i, 20, 0, (float)i + 0.5f, 21, 1};
        memcpy(boxes[i], box, sizeof box);
        memcpy(boxes_aside[i], aside, sizeof aside);
    }
}

static void ray_set(struct gn_cts_ray *ray, double x, double y, double z)
{
    *ray = (struct gn_cts_ray){
        .ray = {.origin = {(float)x, (float)y, (float)z}, .direction = {0, 0, -1}, .tmax = 100, .cull_mask = 0xFF},
        .policy = {.confirm_mask = UINT32_MAX},
    };
}

/* One ray straight down into the centroid of every triangle, from z = 2. */
static void rays_into_triangles(struct gn_cts_ray rays[TRIANGLES])
{
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        double centre[2] = {0, 0};
        for (uint32_t k = 0; k < 3; k++) {
            centre[0] += grid[triangles[i][k]][0] / 3;
            centre[1] += grid[triangles[i][k]][1] / 3;
        }
        ray_set(&rays[i], centre[0], centre[1], 2.0);
    }
}

static struct gn_cts_geometry grid_geometry(void)
{
    return (struct gn_cts_geometry){
        .flags = VK_GEOMETRY_OPAQUE_BIT_KHR,
        .positions = (const double(*)[3])grid,
        .position_count = VERTICES,
        .triangles = (const uint32_t(*)[3])triangles,
        .triangle_count = TRIANGLES,
    };
}

static struct gn_cts_instance instance_of(uint32_t blas, const float transform[12])
{
    struct gn_cts_instance instance = {.custom_index = 0xFEDCBA, .mask = 0xFF, .sbt_offset = 0x123456, .blas = blas};
    memcpy(instance.transform, transform, sizeof instance.transform);
    return instance;
}

/* Builds, traces and gives the answers; prints the device's message when it cannot. */
static enum gn_device_status scene_trace(const char *name, const struct gn_cts_scene *scene,
                                         enum gn_cts_program program, const struct gn_cts_ray *rays, uint32_t count,
                                         struct gn_arena *arena, struct gn_cts_answers *out_answers)
{
    struct gn_built_scene *built = NULL;
    enum gn_device_status status = gn_scene_build(device, scene, &built);
    if (status == GN_DEVICE_OK) {
        status = gn_scene_trace(built, &(struct gn_cts_route){0}, program, rays, count, arena, out_answers);
    }
    if (status != GN_DEVICE_OK) {
        print_message("%s: %s\n", name, gn_device_message(device));
    }
    gn_built_scene_destroy(built);
    return status;
}

/* Every ray has to meet its own triangle of geometry 0 at z = expected_z. */
static uint32_t grid_count_wrong(const char *name, const struct gn_ref_answer *answers, double expected_z,
                                 double tolerance)
{
    uint32_t wrong = 0;
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        const struct gn_ref_answer *answer = &answers[i];
        const bool good = answer->kind == GN_REF_ANSWER_TRIANGLE && answer->primitive == i && answer->geometry == 0 &&
                          answer->custom_index == 0xFEDCBA && answer->sbt_offset == 0x123456 && answer->front == 1 &&
                          fabs(answer->t - (2.0 - expected_z)) <= tolerance &&
                          fabs(answer->barycentrics[0] - 1.0 / 3) < 0.2 &&
                          fabs(answer->barycentrics[1] - 1.0 / 3) < 0.2;
        if (!good && wrong++ == 0) {
            print_message("%s: ray %u: kind %d, geometry %u, primitive %u, instance %u, t %g, front %u\n", name, i,
                          (int)answer->kind, answer->geometry, answer->primitive, answer->instance,
                          (double)answer->t, answer->front);
        }
    }
    return wrong;
}

#define UPDATE VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR
#define COMPACTION VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR

struct way {
    const char *name;
    struct gn_cts_geometry changes; /* what is not zero replaces the plain grid's */
    VkBuildAccelerationStructureFlagsKHR flags, tlas_flags;
    uint8_t steps[GN_CTS_MAX_STEPS], tlas_steps[GN_CTS_MAX_STEPS];
    bool initial_data; /* the first builds see other data, with which every ray misses */
    bool generic, array_of_pointers, separate;
    uint32_t instance_offset;
    bool reads_first_vertex;
};

static const struct way ways[] = {
    {.name = "plain"},
    {.name = "odd stride", .changes = {.vertex_stride = 20}},
    {.name = "vertex offset", .changes = {.vertex_offset = 28}},
    {.name = "first vertex", .changes = {.first_vertex = 7}, .reads_first_vertex = true},
    {.name = "16 bit indices after an offset", .changes = {.primitive_offset = 6}},
    {.name = "32 bit indices", .changes = {.index_uint32 = true}},
    {.name = "32 bit indices by type", .changes = {.index_type = VK_INDEX_TYPE_UINT32, .primitive_offset = 8}},
    {.name = "no indices", .changes = {.index_none = true}},
    {.name = "no indices, offset", .changes = {.index_none = true, .primitive_offset = 20, .vertex_stride = 16}},
    {.name = "no indices, first vertex", .changes = {.index_none = true, .first_vertex = 3}, .reads_first_vertex = true},
    {.name = "geometry transform", .changes = {.transform = moved_by_5}},
    {.name = "geometry transform, offset", .changes = {.transform = moved_by_5, .transform_offset = 48}},
    {.name = "one build per call", .separate = true},
    {.name = "generic", .generic = true},
    {.name = "instance offset", .instance_offset = 192},
    {.name = "pointers to instances", .array_of_pointers = true},
    {.name = "pointers to instances, offset", .array_of_pointers = true, .instance_offset = 48},
    {.name = "refit", .flags = UPDATE, .tlas_flags = UPDATE, .steps = {GN_CTS_STEP_REFIT},
     .tlas_steps = {GN_CTS_STEP_REFIT}, .initial_data = true},
    {.name = "refit into another", .flags = UPDATE, .tlas_flags = UPDATE, .steps = {GN_CTS_STEP_REFIT_COPY},
     .tlas_steps = {GN_CTS_STEP_REFIT_COPY}, .initial_data = true},
    {.name = "rebuild", .steps = {GN_CTS_STEP_REBUILD}, .tlas_steps = {GN_CTS_STEP_REBUILD}, .initial_data = true},
    {.name = "compaction", .flags = COMPACTION, .tlas_flags = COMPACTION, .steps = {GN_CTS_STEP_COMPACT},
     .tlas_steps = {GN_CTS_STEP_COMPACT}},
    {.name = "clone", .steps = {GN_CTS_STEP_CLONE}, .tlas_steps = {GN_CTS_STEP_CLONE}},
    {.name = "serialization", .steps = {GN_CTS_STEP_SERIALIZE}, .tlas_steps = {GN_CTS_STEP_SERIALIZE}},
    {.name = "generic, all copies", .flags = COMPACTION, .tlas_flags = COMPACTION,
     .steps = {GN_CTS_STEP_SERIALIZE, GN_CTS_STEP_CLONE, GN_CTS_STEP_COMPACT},
     .tlas_steps = {GN_CTS_STEP_COMPACT, GN_CTS_STEP_SERIALIZE, GN_CTS_STEP_CLONE}, .generic = true},
    {.name = "every step", .flags = UPDATE | COMPACTION, .tlas_flags = UPDATE | COMPACTION,
     .steps = {GN_CTS_STEP_REBUILD, GN_CTS_STEP_REFIT, GN_CTS_STEP_REFIT_COPY, GN_CTS_STEP_CLONE, GN_CTS_STEP_SERIALIZE,
               GN_CTS_STEP_COMPACT, GN_CTS_STEP_REFIT_COPY, GN_CTS_STEP_REFIT},
     .tlas_steps = {GN_CTS_STEP_SERIALIZE, GN_CTS_STEP_COMPACT, GN_CTS_STEP_REFIT_COPY, GN_CTS_STEP_REFIT},
     .initial_data = true, .generic = true},
};

/*
 * The grid is geometry 0; a second one, behind it, follows in the same BLAS, so that a structure holds more than
 * one. Two further BLASes (one empty, one of boxes) and a null instance stand beside them.
 */
static enum gn_device_status way_trace(const struct way *way, VkFormat format, struct gn_arena *arena,
                                       struct gn_cts_answers *out_answers)
{
    struct gn_cts_geometry geometries[2] = {grid_geometry(), grid_geometry()};
    struct gn_cts_geometry *front = &geometries[0];
    const struct gn_cts_geometry *changes = &way->changes;
    front->vertex_format = format;
    front->vertex_stride = changes->vertex_stride;
    front->vertex_offset = changes->vertex_offset;
    front->first_vertex = changes->first_vertex;
    front->primitive_offset = changes->primitive_offset;
    front->index_none = changes->index_none;
    front->index_uint32 = changes->index_uint32;
    front->index_type = changes->index_type;
    front->transform = changes->transform;
    front->transform_offset = changes->transform_offset;
    geometries[1].positions = (const double(*)[3])grid_near;
    struct gn_cts_geometry row = {
        .type = GN_REF_AABBS, .aabbs = (const float(*)[6])boxes, .aabb_count = BOXES, .aabb_stride = 32};
    if (way->initial_data) {
        front->initial_positions = (const double(*)[3])grid_aside;
        geometries[1].initial_positions = (const double(*)[3])grid_aside;
        row.initial_aabbs = (const float(*)[6])boxes_aside;
    }
    const struct gn_cts_geometry empty = {.flags = VK_GEOMETRY_OPAQUE_BIT_KHR};
    struct gn_cts_blas blases[3] = {
        {.geometries = geometries, .geometry_count = 2},
        {.geometries = &empty, .geometry_count = 1},
        {.geometries = &row, .geometry_count = 1},
    };
    for (size_t i = 0; i < 3; i++) {
        blases[i].build_flags = way->flags;
        blases[i].generic = way->generic;
        memcpy(blases[i].steps, way->steps, sizeof way->steps);
    }
    /* lavapipe 25.0 says that a serialized empty structure takes 0 bytes: a matter for a case, not for this test. */
    if (memchr(way->steps, GN_CTS_STEP_SERIALIZE, sizeof way->steps)) {
        memset(blases[1].steps, 0, sizeof blases[1].steps);
    }
    const float *place = changes->transform ? moved_back : identity;
    const struct gn_cts_instance instances[] = {
        instance_of(GN_CTS_NO_BLAS, identity),
        instance_of(1, identity),
        instance_of(2, moved_by_5),
        instance_of(0, place),
    };
    struct gn_cts_instance initial[4];
    memcpy(initial, instances, sizeof instances);
    initial[3] = instance_of(0, moved_by_5);
    struct gn_cts_scene scene = {
        .blases = blases,
        .blas_count = 3,
        .instances = instances,
        .instance_count = 4,
        .initial_instances = way->initial_data ? initial : NULL,
        .tlas_build_flags = way->tlas_flags,
        .tlas_generic = way->generic,
        .array_of_pointers = way->array_of_pointers,
        .instance_offset = way->instance_offset,
        .separate_builds = way->separate,
    };
    memcpy(scene.tlas_steps, way->tlas_steps, sizeof way->tlas_steps);
    struct gn_cts_ray rays[TRIANGLES];
    rays_into_triangles(rays);
    return scene_trace(way->name, &scene, GN_CTS_COMMITTED, rays, TRIANGLES, arena, out_answers);
}

static void every_way_to_build_gives_the_same(void **state)
{
    (void)state;
    uint32_t wrong_ways = 0;
    for (size_t i = 0; i < sizeof ways / sizeof ways[0]; i++) {
        struct gn_arena arena = {0};
        struct gn_cts_answers answers;
        uint32_t wrong = TRIANGLES;
        if (way_trace(&ways[i], VK_FORMAT_UNDEFINED, &arena, &answers) == GN_DEVICE_OK) {
            wrong = grid_count_wrong(ways[i].name, answers.committed, 0.5, 1e-5);
        }
        if (wrong && ways[i].reads_first_vertex && strstr(gn_device_info(device)->name, "llvmpipe")) {
            /* lavapipe 25.0 adds firstVertex twice: what is looked at here is the harness, not the driver. */
            print_message("not judged: %s (this driver misreads firstVertex)\n", ways[i].name);
            wrong = 0;
        }
        for (uint32_t k = 0; k < TRIANGLES && !wrong; k++) {
            wrong += answers.committed && answers.committed[k].kind && answers.committed[k].instance != 3;
        }
        wrong_ways += wrong != 0;
        gn_arena_finish(&arena);
    }
    assert_int_equal(wrong_ways, 0);
}

static void every_format_of_the_device_arrives(void **state)
{
    (void)state;
    uint32_t wrong_formats = 0;
    uint32_t formats = 0;
    for (size_t f = 0; f < gn_vertex_format_count; f++) {
        const struct gn_vertex_format *format = &gn_vertex_formats[f];
        if (!gn_device_has_vertex_format(device, format->format)) {
            continue;
        }
        formats++;
        /* With and without room between the vertices; the components' size is the alignment. */
        for (uint32_t variant = 0; variant < 3; variant++) {
            const struct way way = {
                .name = format->name,
                .changes = {.vertex_stride = variant ? format->size + format->alignment * variant : 0,
                            .vertex_offset = format->alignment * variant,
                            .index_none = variant == 2},
            };
            struct gn_arena arena = {0};
            struct gn_cts_answers answers;
            uint32_t wrong = TRIANGLES;
            if (way_trace(&way, format->format, &arena, &answers) == GN_DEVICE_OK) {
                /* Without z the grid lies at 0, where the other geometry is, too: then either is right. */
                for (uint32_t i = 0; i < TRIANGLES && format->components == 2; i++) {
                    answers.committed[i].geometry = 0;
                }
                const double step = format->kind == GN_VERTEX_FLOAT ? 0.0 : 1.0 / format->divisor;
                wrong = grid_count_wrong(format->name, answers.committed, format->components == 2 ? 0.0 : 0.5,
                                         step + 1e-5);
            }
            wrong_formats += wrong != 0;
            gn_arena_finish(&arena);
        }
    }
    assert_true(formats >= 6);
    assert_int_equal(wrong_formats, 0);
}

/* Scenes that the API forbids or the device lacks: a status, a message, and nothing left behind. */
struct bad_scene {
    const char *name;
    void (*spoil)(struct gn_cts_geometry *geometry, struct gn_cts_blas *blas, struct gn_cts_scene *scene);
    enum gn_device_status expected;
    const char *message;
};

#define SPOIL(name, statement) \
    static void name(struct gn_cts_geometry *geometry, struct gn_cts_blas *blas, struct gn_cts_scene *scene) \
    { \
        (void)geometry; \
        (void)blas; \
        (void)scene; \
        statement; \
    }
SPOIL(spoil_stride, geometry->vertex_stride = 14)
SPOIL(spoil_short_stride, geometry->vertex_stride = 8)
SPOIL(spoil_vertex_offset, geometry->vertex_offset = 2)
SPOIL(spoil_primitive_offset, geometry->primitive_offset = 1)
SPOIL(spoil_format, geometry->vertex_format = VK_FORMAT_R8G8B8A8_SRGB)
SPOIL(spoil_index_type, geometry->index_type = VK_INDEX_TYPE_UINT8_KHR)
SPOIL(spoil_index, geometry->position_count = VERTICES - 1)
SPOIL(spoil_first_vertex, geometry->first_vertex = UINT32_MAX)
SPOIL(spoil_initial_transform, (geometry->initial_transform = moved_by_5, blas->steps[0] = GN_CTS_STEP_REBUILD))
SPOIL(spoil_refit, blas->steps[0] = GN_CTS_STEP_REFIT)
SPOIL(spoil_tlas_refit, scene->tlas_steps[0] = GN_CTS_STEP_REFIT_COPY)
SPOIL(spoil_compaction, blas->steps[0] = GN_CTS_STEP_COMPACT)
SPOIL(spoil_rebuild, (blas->build_flags = COMPACTION, blas->steps[0] = GN_CTS_STEP_COMPACT,
                      blas->steps[1] = GN_CTS_STEP_REBUILD))
SPOIL(spoil_step, blas->steps[0] = 77)
SPOIL(spoil_instance_offset, scene->instance_offset = 8)
SPOIL(spoil_blas_count, scene->blas_count = 0)
SPOIL(spoil_aabb_stride, (geometry->type = GN_REF_AABBS, geometry->aabb_stride = 20))

static const struct bad_scene bad_scenes[] = {
    {"stride", spoil_stride, GN_DEVICE_FAILED, "BLAS 0, geometry 0: the vertex stride"},
    {"stride below a vertex", spoil_short_stride, GN_DEVICE_FAILED, "not 8"},
    {"vertex offset", spoil_vertex_offset, GN_DEVICE_FAILED, "the vertex offset"},
    {"primitive offset", spoil_primitive_offset, GN_DEVICE_FAILED, "the primitive offset"},
    {"format", spoil_format, GN_DEVICE_UNSUPPORTED, "vertex format"},
    {"index type", spoil_index_type, GN_DEVICE_UNSUPPORTED, "indexType-03798"},
    {"index", spoil_index, GN_DEVICE_FAILED, "an index has to be below"},
    {"first vertex", spoil_first_vertex, GN_DEVICE_FAILED, "countable in 32 bits"},
    {"initial transform alone", spoil_initial_transform, GN_DEVICE_FAILED, "needs a final one"},
    {"refit", spoil_refit, GN_DEVICE_FAILED, "needs ALLOW_UPDATE"},
    {"refit of the TLAS", spoil_tlas_refit, GN_DEVICE_FAILED, "needs ALLOW_UPDATE"},
    {"compaction", spoil_compaction, GN_DEVICE_FAILED, "needs ALLOW_COMPACTION"},
    {"rebuild after compaction", spoil_rebuild, GN_DEVICE_FAILED, "does not fit into a compacted structure"},
    {"step", spoil_step, GN_DEVICE_FAILED, "no step 77"},
    {"instance offset", spoil_instance_offset, GN_DEVICE_FAILED, "a multiple of 16, not 8"},
    {"BLAS number", spoil_blas_count, GN_DEVICE_FAILED, "instance 0 refers to BLAS 0 of 0"},
    {"AABB stride", spoil_aabb_stride, GN_DEVICE_FAILED, "the AABB stride"},
};

static void bad_scenes_are_refused_in_words(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof bad_scenes / sizeof bad_scenes[0]; i++) {
        struct gn_cts_geometry geometry = grid_geometry();
        struct gn_cts_blas blas = {.geometries = &geometry, .geometry_count = 1};
        const struct gn_cts_instance instance = instance_of(0, identity);
        struct gn_cts_scene scene = {.blases = &blas, .blas_count = 1, .instances = &instance, .instance_count = 1};
        struct gn_built_scene *built = NULL;
        bad_scenes[i].spoil(&geometry, &blas, &scene);
        const enum gn_device_status status = gn_scene_build(device, &scene, &built);
        if (status != bad_scenes[i].expected || !strstr(gn_device_message(device), bad_scenes[i].message)) {
            print_error("%s: status %d, \"%s\"\n", bad_scenes[i].name, (int)status, gn_device_message(device));
        }
        assert_null(built);
        assert_int_equal(status, bad_scenes[i].expected);
        assert_non_null(strstr(gn_device_message(device), bad_scenes[i].message));
    }
}

/* The policy decides about candidates that are not opaque, and generates hits in boxes within the range. */
static void a_policy_decides_about_candidates(void **state)
{
    (void)state;
    struct gn_cts_geometry geometry = grid_geometry();
    geometry.flags = 0;
    struct gn_cts_geometry row = {.type = GN_REF_AABBS, .aabbs = (const float(*)[6])boxes, .aabb_count = BOXES};
    const struct gn_cts_blas blases[] = {{.geometries = &geometry, .geometry_count = 1},
                                         {.geometries = &row, .geometry_count = 1}};
    const struct gn_cts_instance instances[] = {instance_of(0, identity), instance_of(1, moved_by_5)};
    const struct gn_cts_scene scene = {
        .blases = blases, .blas_count = 2, .instances = instances, .instance_count = 2};
    struct gn_cts_ray rays[TRIANGLES + 6];
    rays_into_triangles(rays);
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        rays[i].policy.confirm_mask = 0x0F0F0F0F;
    }
    /* Into box 3, which spans t = 1 to 2 from z = 2; t = 1 + 3/8 there unless a row says otherwise. */
    struct gn_cts_ray *box = rays + TRIANGLES;
    for (uint32_t i = 0; i < 6; i++) {
        ray_set(&box[i], 8.25, 0.5, 2.0);
        box[i].policy = (struct gn_ref_policy){.generate_mask = 1u << 3, .generate_t0 = 1, .generate_step = 0.125f};
    }
    box[1].policy.generate_mask = ~(1u << 3); /* not this primitive */
    box[2].ray.tmin = 1.5f; /* before the range: not generated */
    box[3].ray.tmax = 1.25f; /* beyond it */
    box[4].ray.tmin = box[4].ray.tmax = 1.375f; /* both ends are inside */
    box[5].ray.cull_mask = 0; /* culled by its mask */
    static const bool hits[6] = {true, false, false, false, true, false};

    struct gn_arena arena = {0};
    struct gn_cts_answers answers;
    assert_int_equal(scene_trace("policy", &scene, GN_CTS_COMMITTED, rays, TRIANGLES + 6, &arena, &answers),
                     GN_DEVICE_OK);
    assert_null(answers.candidates);
    assert_null(answers.details);
    assert_null(answers.positions);
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        assert_int_equal(answers.committed[i].kind, 0x0F0F0F0Fu >> (i & 31) & 1u ? 1 : 0);
    }
    for (uint32_t i = 0; i < 6; i++) {
        const struct gn_ref_answer *answer = &answers.committed[TRIANGLES + i];
        assert_int_equal(answer->kind, hits[i] ? GN_REF_ANSWER_GENERATED : GN_REF_ANSWER_NONE);
        if (hits[i]) {
            assert_true(answer->t == 1.375f && answer->primitive == 3 && answer->instance == 1);
            assert_true(answer->barycentrics[0] == 0 && answer->barycentrics[1] == 0 && answer->front == 0);
        }
    }
    gn_arena_finish(&arena);
}

/* Candidates are listed, counted beyond the list, and never confirmed. */
static void candidates_are_listed(void **state)
{
    (void)state;
    enum { LAYERS = GN_CTS_MAX_CANDIDATES + 6 };
    struct gn_cts_geometry geometry = grid_geometry();
    geometry.flags = 0;
    struct gn_cts_geometry row = {.type = GN_REF_AABBS, .aabbs = (const float(*)[6])boxes, .aabb_count = BOXES};
    struct gn_cts_geometry floor = grid_geometry();
    const struct gn_cts_blas blases[] = {{.geometries = &geometry, .geometry_count = 1},
                                         {.geometries = &row, .geometry_count = 1},
                                         {.geometries = &floor, .geometry_count = 1}};
    struct gn_cts_instance instances[LAYERS + 2];
    for (uint32_t i = 0; i < LAYERS; i++) {
        instances[i] = instance_of(0, identity);
        instances[i].transform[11] = -(float)i;
        instances[i].transform[3] = i < 3 ? 0.0f : 10.0f;
    }
    instances[LAYERS] = instance_of(1, identity); /* box 0 over the first grid */
    instances[LAYERS + 1] = instance_of(2, identity);
    instances[LAYERS + 1].transform[11] = -90;
    const struct gn_cts_scene scene = {
        .blases = blases, .blas_count = 3, .instances = instances, .instance_count = LAYERS + 2};
    struct gn_cts_ray rays[2];
    ray_set(&rays[0], 1.0 / 24, 1.0 / 24, 2.0); /* three grids, the box, then the opaque floor */
    ray_set(&rays[1], 10 + 1.0 / 24, 1.0 / 24, 2.0); /* all the others, no floor */
    struct gn_arena arena = {0};
    struct gn_cts_answers answers;
    assert_int_equal(scene_trace("candidates", &scene, GN_CTS_CANDIDATES, rays, 2, &arena, &answers), GN_DEVICE_OK);
    const struct gn_cts_candidates *first = &answers.candidates[0];
    assert_int_equal(first->count, 4);
    uint32_t seen = 0;
    for (uint32_t i = 0; i < first->count; i++) {
        const struct gn_ref_answer *answer = &first->list[i];
        assert_true(answer->instance < 3 || answer->instance == LAYERS);
        assert_int_equal(answer->primitive, 0);
        assert_int_equal(answer->custom_index, 0xFEDCBA);
        if (answer->instance == LAYERS) {
            assert_int_equal(answer->kind, GN_REF_ANSWER_GENERATED);
            assert_true(answer->t == 0);
        } else {
            assert_int_equal(answer->kind, GN_REF_ANSWER_TRIANGLE);
            assert_int_equal(answer->front, 1);
            assert_true(fabs(answer->t - (1.5 + answer->instance)) < 1e-5);
        }
        seen |= 1u << (answer->instance == LAYERS ? 3 : answer->instance);
    }
    assert_int_equal(seen, 15);
    assert_int_equal(answers.committed[0].kind, GN_REF_ANSWER_TRIANGLE);
    assert_int_equal(answers.committed[0].instance, LAYERS + 1);
    assert_true(answers.candidates[1].count >= LAYERS - 3);
    assert_int_equal(answers.committed[1].kind, GN_REF_ANSWER_NONE);
    gn_arena_finish(&arena);
}

static void details_are_the_ray_in_both_spaces(void **state)
{
    (void)state;
    const struct gn_cts_geometry geometry = grid_geometry();
    const struct gn_cts_blas blas = {.geometries = &geometry, .geometry_count = 1};
    /* Powers of two, so that the inverse and the ray in object space are exact: x -> 2x + 4, y -> 4y, z -> z/2 - 8. */
    static const float forth[12] = {2, 0, 0, 4, 0, 4, 0, 0, 0, 0, 0.5f, -8};
    static const float back[12] = {0.5f, 0, 0, -2, 0, 0.25f, 0, 0, 0, 0, 2, 16};
    const struct gn_cts_instance instance = instance_of(0, forth);
    const struct gn_cts_scene scene = {
        .blases = &blas, .blas_count = 1, .instances = &instance, .instance_count = 1};
    struct gn_cts_ray rays[2];
    ray_set(&rays[0], 4.125, 0.125, 0.0); /* into the first triangle, at object (1/16, 1/32) */
    ray_set(&rays[1], -1.0, 0.25, 0.0);
    rays[0].ray.tmin = 0.5f;
    rays[0].ray.flags = GN_REF_RAY_SKIP_AABBS | GN_REF_RAY_OPAQUE;
    struct gn_arena arena = {0};
    struct gn_cts_answers answers;
    assert_int_equal(scene_trace("detail", &scene, GN_CTS_DETAIL, rays, 2, &arena, &answers), GN_DEVICE_OK);
    assert_int_equal(answers.committed[0].kind, GN_REF_ANSWER_TRIANGLE);
    assert_int_equal(answers.committed[0].primitive, 0);
    assert_int_equal(answers.committed[1].kind, GN_REF_ANSWER_NONE);
    const struct gn_cts_detail *hit = &answers.details[0];
    static const float object_origin[3] = {0.0625f, 0.03125f, 16}, object_direction[3] = {0, 0, -2};
    assert_memory_equal(hit->world_from_object, forth, sizeof forth);
    for (uint32_t i = 0; i < 12; i++) {
        assert_true(hit->object_from_world[i] == back[i]);
    }
    for (uint32_t i = 0; i < 3; i++) {
        assert_true(hit->object_origin[i] == object_origin[i]);
        assert_true(hit->object_direction[i] == object_direction[i]);
    }
    for (uint32_t i = 0; i < 2; i++) {
        assert_memory_equal(answers.details[i].world_origin, rays[i].ray.origin, sizeof rays[i].ray.origin);
        assert_memory_equal(answers.details[i].world_direction, rays[i].ray.direction, sizeof rays[i].ray.direction);
        assert_true(answers.details[i].tmin == rays[i].ray.tmin);
        assert_int_equal(answers.details[i].flags, rays[i].ray.flags);
    }
    const struct gn_cts_detail nothing = {0};
    assert_memory_equal(answers.details[1].world_from_object, nothing.world_from_object, 24 * sizeof(float));
    assert_memory_equal(answers.details[1].object_origin, nothing.object_origin, 6 * sizeof(float));
    gn_arena_finish(&arena);
}

static void positions_come_back(void **state)
{
    (void)state;
    const struct gn_cts_geometry geometry = grid_geometry();
    struct gn_cts_blas blas = {.geometries = &geometry, .geometry_count = 1};
    const struct gn_cts_instance instance = instance_of(0, identity);
    const struct gn_cts_scene scene = {
        .blases = &blas, .blas_count = 1, .instances = &instance, .instance_count = 1};
    struct gn_cts_ray rays[TRIANGLES];
    rays_into_triangles(rays);
    struct gn_arena arena = {0};
    struct gn_cts_answers answers;
    const bool able = gn_device_info(device)->position_fetch;
    /* Without the build flag it is the scene that is wrong. */
    assert_int_equal(scene_trace("no flag", &scene, GN_CTS_POSITIONS, rays, TRIANGLES, &arena, &answers),
                     able ? GN_DEVICE_FAILED : GN_DEVICE_UNSUPPORTED);
    blas.build_flags = VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_DATA_ACCESS_KHR;
    assert_int_equal(scene_trace("positions", &scene, GN_CTS_POSITIONS, rays, TRIANGLES, &arena, &answers),
                     able ? GN_DEVICE_OK : GN_DEVICE_UNSUPPORTED);
    for (uint32_t i = 0; i < TRIANGLES && able; i++) {
        assert_int_equal(answers.committed[i].primitive, i);
        for (uint32_t k = 0; k < 9; k++) {
            assert_true(answers.positions[i][k] == (float)grid[triangles[i][k / 3]][k % 3]);
        }
    }
    gn_arena_finish(&arena);
}

/* More rays than a dispatch takes, for every program: chunks have to meet without a gap or an overlap. */
static void many_rays_go_in_chunks(void **state)
{
    (void)state;
    static const uint32_t counts[GN_CTS_PROGRAM_COUNT] = {(1u << 18) + 77, (1u << 15) + 5, (1u << 16) + 63, (1u << 18) + 1};
    const struct gn_cts_geometry geometry = grid_geometry();
    const bool able = gn_device_info(device)->position_fetch;
    const struct gn_cts_blas blas = {
        .geometries = &geometry, .geometry_count = 1,
        .build_flags = able ? VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_DATA_ACCESS_KHR : 0};
    const struct gn_cts_instance instance = instance_of(0, identity);
    const struct gn_cts_scene scene = {
        .blases = &blas, .blas_count = 1, .instances = &instance, .instance_count = 1};
    struct gn_built_scene *built = NULL;
    assert_int_equal(gn_scene_build(device, &scene, &built), GN_DEVICE_OK);
    const struct gn_cts_route route = {0};
    for (int program = 0; program < GN_CTS_PROGRAM_COUNT; program++) {
        if (program == GN_CTS_POSITIONS && !able) {
            continue;
        }
        struct gn_arena arena = {0};
        struct gn_cts_ray model[TRIANGLES];
        rays_into_triangles(model);
        struct gn_cts_ray *rays = GN_NEW(&arena, struct gn_cts_ray, counts[program]);
        for (uint32_t i = 0; i < counts[program]; i++) {
            rays[i] = model[i % TRIANGLES];
            rays[i].ray.cull_mask = i % 5 == 4 ? 0 : 0xFF; /* a pattern that does not fit into the chunks */
        }
        struct gn_cts_answers answers;
        assert_int_equal(gn_scene_trace(built, &route, (enum gn_cts_program)program, rays, counts[program], &arena, &answers),
                         GN_DEVICE_OK);
        for (uint32_t i = 0; i < counts[program]; i++) {
            assert_int_equal(answers.committed[i].kind, i % 5 == 4 ? 0 : 1);
            assert_int_equal(answers.committed[i].primitive, i % 5 == 4 ? 0 : i % TRIANGLES);
            assert_true(!answers.details || answers.details[i].world_origin[0] == rays[i].ray.origin[0]);
            assert_true(!answers.candidates || answers.candidates[i].count == 0);
            assert_true(!answers.positions || i % 5 == 4 || answers.positions[i][2] == 0.5f);
        }
        gn_arena_finish(&arena);
    }
    struct gn_cts_answers none;
    struct gn_arena arena = {0};
    assert_int_equal(gn_scene_trace(built, &route, GN_CTS_COMMITTED, NULL, 0, &arena, &none), GN_DEVICE_OK);
    gn_arena_finish(&arena);
    gn_built_scene_destroy(built);
}

/* Many structures, many geometries, many instances: few allocations, and every one in its place. */
static void large_scenes_are_built(void **state)
{
    (void)state;
    enum { GEOMETRIES = 300, BLASES = 200, INSTANCES = 66000 };
    struct gn_arena arena = {0};
    struct gn_cts_geometry *geometries = GN_NEW(&arena, struct gn_cts_geometry, GEOMETRIES);
    float(*transforms)[12] = gn_arena_alloc(&arena, GEOMETRIES, sizeof *transforms);
    for (uint32_t i = 0; i < GEOMETRIES; i++) {
        geometries[i] = grid_geometry();
        memcpy(transforms[i], identity, sizeof identity);
        transforms[i][3] = 2.0f * (float)i;
        geometries[i].transform = transforms[i];
    }
    struct gn_cts_blas *blases = GN_NEW(&arena, struct gn_cts_blas, BLASES);
    for (uint32_t i = 0; i < BLASES; i++) {
        blases[i] = (struct gn_cts_blas){.geometries = geometries + i, .geometry_count = i ? 1 : GEOMETRIES,
                                         .build_flags = COMPACTION, .steps = {GN_CTS_STEP_COMPACT}};
    }
    /* The first instance is that of many geometries; the others stand in rows of 1000, 3 apart, from y = 10 on. */
    struct gn_cts_instance *instances = GN_NEW(&arena, struct gn_cts_instance, INSTANCES);
    for (uint32_t i = 0; i < INSTANCES; i++) {
        instances[i] = instance_of(i % BLASES, identity);
        instances[i].custom_index = i;
        if (i) {
            instances[i].blas = 1 + i % (BLASES - 1);
            instances[i].transform[3] = 3.0f * (float)(i % 1000) - 2.0f * (float)instances[i].blas;
            instances[i].transform[7] = 10.0f + 3.0f * (float)(i / 1000);
        }
    }
    const struct gn_cts_scene scene = {
        .blases = blases, .blas_count = BLASES, .instances = instances, .instance_count = INSTANCES};
    const uint32_t count = GEOMETRIES + INSTANCES - 1;
    struct gn_cts_ray *rays = GN_NEW(&arena, struct gn_cts_ray, count);
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t instance = i - GEOMETRIES + 1;
        if (i < GEOMETRIES) {
            ray_set(&rays[i], 2.0 * i + 0.53125, 0.53125, 2.0);
        } else {
            ray_set(&rays[i], 3.0 * (instance % 1000) + 0.53125, 10.53125 + 3.0 * (instance / 1000), 2.0);
        }
    }
    struct gn_cts_answers answers;
    assert_int_equal(scene_trace("large", &scene, GN_CTS_COMMITTED, rays, count, &arena, &answers), GN_DEVICE_OK);
    uint32_t wrong = 0;
    for (uint32_t i = 0; i < count; i++) {
        const struct gn_ref_answer *answer = &answers.committed[i];
        const uint32_t instance = i < GEOMETRIES ? 0 : i - GEOMETRIES + 1;
        wrong += answer->kind != GN_REF_ANSWER_TRIANGLE || answer->instance != instance ||
                 answer->custom_index != instance || answer->geometry != (i < GEOMETRIES ? i : 0);
    }
    assert_int_equal(wrong, 0);
    gn_arena_finish(&arena);
}

static void sizes_and_times_are_told(void **state)
{
    (void)state;
    const struct gn_cts_geometry geometry = grid_geometry();
    const struct gn_cts_blas blas = {.geometries = &geometry, .geometry_count = 1, .build_flags = COMPACTION,
                                     .steps = {GN_CTS_STEP_COMPACT}};
    const struct gn_cts_instance instance = instance_of(0, identity);
    const struct gn_cts_scene scene = {
        .blases = &blas, .blas_count = 1, .instances = &instance, .instance_count = 1};
    struct gn_built_scene *built = NULL;
    assert_int_equal(gn_scene_build(device, &scene, &built), GN_DEVICE_OK);
    const struct gn_built_info info = gn_built_scene_info(built);
    assert_true(info.blas_bytes > 0 && info.blas_bytes <= info.blas_bytes_before_compaction);
    assert_true(info.tlas_bytes > 0 && info.scratch_bytes > 0);
    assert_true(info.build_seconds > 0 && info.build_seconds < 60);
    gn_built_scene_destroy(built);
    gn_built_scene_destroy(NULL);
}

/*
 * Last: no layer has said anything. Where the validation layer is asked for, it is shown to listen, by two
 * writes to the same bytes without a barrier.
 */
static void layers_have_nothing_to_say(void **state)
{
    (void)state;
    assert_string_equal(gn_device_validation_first(device), "");
    assert_int_equal(gn_device_validation_count(device), 0);
    const char *validated = getenv("GNOMON_TEST_VALIDATED");
    if (!validated || !*validated) {
        return;
    }
    struct gn_pool pool = {.kind = GN_MEMORY_HOST};
    struct gn_memory memory;
    assert_int_equal(gn_pool_take(device, &pool, 256, 16, &memory), GN_DEVICE_OK);
    assert_int_equal(gn_device_begin(device), GN_DEVICE_OK);
    vkCmdFillBuffer(device->commands, memory.buffer, memory.offset, 256, 1);
    vkCmdFillBuffer(device->commands, memory.buffer, memory.offset, 256, 2);
    assert_int_equal(gn_device_submit(device), GN_DEVICE_OK);
    gn_pool_finish(device, &pool);
    assert_true(gn_device_validation_count(device) > 0);
    assert_non_null(strstr(gn_device_validation_first(device), "WRITE_AFTER_WRITE"));
    /* What a layer says makes the next scene fail, once. */
    struct gn_arena arena = {0};
    struct gn_cts_answers answers;
    const struct way plain = {.name = "plain"};
    assert_int_equal(way_trace(&plain, VK_FORMAT_UNDEFINED, &arena, &answers), GN_DEVICE_FAILED);
    assert_non_null(strstr(gn_device_message(device), "a layer reports (1 message"));
    assert_int_equal(way_trace(&plain, VK_FORMAT_UNDEFINED, &arena, &answers), GN_DEVICE_OK);
    gn_arena_finish(&arena);
}

static int device_open(void **state)
{
    (void)state;
    const char *icd = getenv("GNOMON_TEST_ICD");
    const struct gn_device_options options = {.icd = icd && *icd ? icd : NULL, .index = -1};
    char error[1024];
    data_fill();
    device = gn_device_create(&options, error, sizeof error);
    if (!device) {
        print_error("%s\n", error);
        return -1;
    }
    return 0;
}

static int device_close(void **state)
{
    (void)state;
    gn_device_destroy(device);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_way_to_build_gives_the_same),
        cmocka_unit_test(every_format_of_the_device_arrives),
        cmocka_unit_test(bad_scenes_are_refused_in_words),
        cmocka_unit_test(a_policy_decides_about_candidates),
        cmocka_unit_test(candidates_are_listed),
        cmocka_unit_test(details_are_the_ray_in_both_spaces),
        cmocka_unit_test(positions_come_back),
        cmocka_unit_test(many_rays_go_in_chunks),
        cmocka_unit_test(large_scenes_are_built),
        cmocka_unit_test(sizes_and_times_are_told),
        cmocka_unit_test(layers_have_nothing_to_say),
    };
    return cmocka_run_group_tests(tests, device_open, device_close);
}
