/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One scene of triangles and boxes, opaque and not, traced by every route there is: each has to give what ray queries
 * in a compute shader give. And which records of a hit table scenes take.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "cts/device_internal.h"
#include "cts/generate.h"
#include "cts/table.h"

enum { RAYS = 3000 };

static struct gn_device *device;

static struct gn_cts_scene scene_make(struct gn_arena *arena, struct gn_random *random, struct gn_cts_ray *rays)
{
    struct gn_mesh soup = gn_mesh_soup(arena, random, 64, 0.8);
    struct gn_cts_geometry *geometries = GN_NEW(arena, struct gn_cts_geometry, 3);
    geometries[0] = gn_geometry_of_mesh(&soup);
    geometries[1] = gn_geometry_of_mesh(&soup);
    geometries[1].flags = VK_GEOMETRY_OPAQUE_BIT_KHR;
    float(*boxes)[6] = gn_arena_alloc(arena, 16, sizeof *boxes);
    for (uint32_t i = 0; i < 16; i++) {
        for (uint32_t a = 0; a < 3; a++) {
            boxes[i][a] = (float)gn_random_range(random, -1, 0.5);
            boxes[i][a + 3] = boxes[i][a] + 0.5f;
        }
    }
    geometries[2] = (struct gn_cts_geometry){
        .type = GN_REF_AABBS, .aabbs = (const float(*)[6])boxes, .aabb_count = 16};
    struct gn_cts_blas *blases = GN_NEW(arena, struct gn_cts_blas, 2);
    blases[0] = (struct gn_cts_blas){.geometries = geometries, .geometry_count = 2};
    blases[1] = (struct gn_cts_blas){.geometries = geometries + 2, .geometry_count = 1};
    struct gn_cts_instance *instances = GN_NEW(arena, struct gn_cts_instance, 3);
    static const float aside[12] = {1, 0, 0, 0.25f, 0, 0, -1, 0, 0, 1, 0, 0.5f};
    instances[0] = gn_instance_of(0, NULL);
    instances[1] = gn_instance_of(1, NULL);
    instances[2] = gn_instance_of(0, aside);
    instances[1].sbt_offset = 40; /* two geometries with a stride of up to 15 come before */
    instances[2].sbt_offset = 300;
    instances[2].custom_index = 0xABCDEF;
    for (uint32_t i = 0; i < RAYS; i++) {
        double origin[3], direction[3];
        for (uint32_t a = 0; a < 3; a++) {
            origin[a] = gn_random_range(random, -2, 2);
            direction[a] = gn_random_range(random, -1, 1) - origin[a];
        }
        rays[i] = gn_ray_make(origin, direction, 8);
        rays[i].policy.confirm_mask = (uint32_t)gn_random_u64(random);
        rays[i].policy.generate_mask = (uint32_t)gn_random_u64(random);
        rays[i].policy.generate_t0 = 0.5f;
        rays[i].policy.generate_step = 0.0625f;
        rays[i].ray.flags = i % 3 ? 0 : GN_REF_RAY_CULL_BACK_FACING;
    }
    return (struct gn_cts_scene){.blases = blases, .blas_count = 2, .instances = instances, .instance_count = 3};
}

struct way {
    const char *name;
    struct gn_cts_route route;
    enum gn_cts_program program;
};

static const struct way ways[] = {
    {"pipeline", {.entry = GN_CTS_PIPELINE, .record_stride = 1}, GN_CTS_COMMITTED},
    {"records apart", {.entry = GN_CTS_PIPELINE, .record_stride = 15, .record_offset = 15}, GN_CTS_COMMITTED},
    {"all of an instance alike", {.entry = GN_CTS_PIPELINE}, GN_CTS_COMMITTED},
    {"wide records", {.entry = GN_CTS_PIPELINE, .record_stride = 2, .record_padding = 5}, GN_CTS_COMMITTED},
    {"the last miss record", {.entry = GN_CTS_PIPELINE, .record_stride = 1, .miss_index = 15}, GN_CTS_COMMITTED},
    {"a library of hits",
     {.entry = GN_CTS_PIPELINE, .record_stride = 1, .linking = GN_CTS_LINK_HITS},
     GN_CTS_COMMITTED},
    {"callable", {.entry = GN_CTS_PIPELINE, .record_stride = 1, .callable = true}, GN_CTS_COMMITTED},
    {"recursion", {.entry = GN_CTS_PIPELINE, .record_stride = 1, .depth = 3}, GN_CTS_COMMITTED},
    {"indirect", {.entry = GN_CTS_PIPELINE, .record_stride = 1, .launch = GN_CTS_LAUNCH_INDIRECT}, GN_CTS_COMMITTED},
    {"indirect with tables",
     {.entry = GN_CTS_PIPELINE, .record_stride = 1, .launch = GN_CTS_LAUNCH_INDIRECT2},
     GN_CTS_COMMITTED},
    {"detail", {.entry = GN_CTS_PIPELINE, .record_stride = 1}, GN_CTS_DETAIL},
    {"in a vertex shader", {.entry = GN_CTS_QUERY_IN_VERTEX}, GN_CTS_COMMITTED},
    {"in a fragment shader", {.entry = GN_CTS_QUERY_IN_FRAGMENT}, GN_CTS_COMMITTED},
    {"in ray generation", {.entry = GN_CTS_QUERY_IN_RAYGEN, .record_stride = 1}, GN_CTS_COMMITTED},
    {"in hit and miss shaders", {.entry = GN_CTS_QUERY_IN_HIT, .record_stride = 1}, GN_CTS_COMMITTED},
};

static bool same(const struct gn_ref_answer *a, const struct gn_ref_answer *b)
{
    return a->kind == b->kind && a->instance == b->instance && a->geometry == b->geometry &&
           a->primitive == b->primitive && a->custom_index == b->custom_index && a->sbt_offset == b->sbt_offset &&
           a->front == b->front && memcmp(&a->t, &b->t, sizeof a->t) == 0;
}

static void every_route_gives_the_same(void **state)
{
    (void)state;
    struct gn_arena arena = {0};
    struct gn_random random = {.state = 7};
    struct gn_cts_ray *rays = GN_NEW(&arena, struct gn_cts_ray, RAYS);
    const struct gn_cts_scene scene = scene_make(&arena, &random, rays);
    struct gn_built_scene *built = NULL;
    struct gn_cts_answers expected, found;
    assert_int_equal(gn_scene_build(device, &scene, &built), GN_DEVICE_OK);
    assert_int_equal(gn_scene_trace(built, &(struct gn_cts_route){0}, GN_CTS_COMMITTED, rays, RAYS, &arena, &expected),
                     GN_DEVICE_OK);
    uint32_t hits[3] = {0};
    for (uint32_t i = 0; i < RAYS; i++) {
        hits[expected.committed[i].kind]++;
    }
    assert_true(hits[0] > 100 && hits[1] > 100 && hits[2] > 100);
    uint32_t failures = 0;
    for (size_t w = 0; w < sizeof ways / sizeof ways[0]; w++) {
        const enum gn_device_status status =
            gn_scene_trace(built, &ways[w].route, ways[w].program, rays, RAYS, &arena, &found);
        uint32_t wrong = 0;
        for (uint32_t i = 0; i < RAYS && status == GN_DEVICE_OK; i++) {
            wrong += !same(&found.committed[i], &expected.committed[i]);
        }
        if (status != GN_DEVICE_OK || wrong) {
            print_error("%s: %u of %d rays differ %s\n", ways[w].name, wrong, RAYS,
                        status == GN_DEVICE_OK ? "" : gn_device_message(device));
            failures++;
        }
    }
    assert_int_equal(failures, 0);
    gn_built_scene_destroy(built);
    gn_arena_finish(&arena);
}

/* A record of zeros runs no shader: such a hit leaves the payload as it was, and all others are as they were. */
static void records_of_zeros_run_nothing(void **state)
{
    (void)state;
    struct gn_arena arena = {0};
    struct gn_random random = {.state = 8};
    struct gn_cts_ray *rays = GN_NEW(&arena, struct gn_cts_ray, RAYS);
    const struct gn_cts_scene scene = scene_make(&arena, &random, rays);
    struct gn_cts_route route = {.entry = GN_CTS_PIPELINE, .record_stride = 1};
    struct gn_built_scene *built = NULL;
    struct gn_cts_answers all, some;
    for (uint32_t i = 0; i < RAYS; i++) {
        rays[i].ray.flags = GN_REF_RAY_OPAQUE | GN_REF_RAY_SKIP_AABBS; /* or any-hit and intersection shaders were missed */
    }
    assert_int_equal(gn_scene_build(device, &scene, &built), GN_DEVICE_OK);
    assert_int_equal(gn_scene_trace(built, &route, GN_CTS_COMMITTED, rays, RAYS, &arena, &all), GN_DEVICE_OK);
    route.null_every = 2; /* records 0 and 300: the first geometry of the two instances */
    assert_int_equal(gn_scene_trace(built, &route, GN_CTS_COMMITTED, rays, RAYS, &arena, &some), GN_DEVICE_OK);
    uint32_t untouched = 0;
    for (uint32_t i = 0; i < RAYS; i++) {
        const bool empty = all.committed[i].kind == GN_REF_ANSWER_TRIANGLE && all.committed[i].geometry == 0;
        untouched += empty;
        if (empty) {
            assert_non_null(gn_answer_fault((uint32_t)some.committed[i].kind));
        } else {
            assert_true(same(&some.committed[i], &all.committed[i]));
        }
    }
    assert_true(untouched > 100);
    gn_built_scene_destroy(built);
    gn_arena_finish(&arena);
}

struct records {
    const char *name;
    uint32_t offsets[3]; /* of two instances of BLAS 0, one of BLAS 1 */
    struct gn_cts_route route;
    uint64_t count;
    bool clash;
};

static const struct records records[] = {
    {"apart", {0, 40, 2}, {.record_stride = 1}, 42, false},
    {"triangles share", {0, 0, 2}, {.record_stride = 1}, 3, false},
    {"triangles and boxes would share", {0, 0, 1}, {.record_stride = 1}, 2, true},
    {"the offset comes on top", {5, 5, 9}, {.record_stride = 1, .record_offset = 3}, 13, false},
    {"a stride of 0", {5, 5, 6}, {.record_stride = 0}, 7, false},
    {"the largest", {0xFFFFFF, 0, 7}, {.record_stride = 15, .record_offset = 15}, 0xFFFFFFull + 31, false},
};

static void records_do_not_clash(void **state)
{
    (void)state;
    struct gn_arena arena = {0};
    struct gn_random random = {.state = 9};
    struct gn_cts_ray *rays = GN_NEW(&arena, struct gn_cts_ray, RAYS);
    struct gn_cts_scene scene = scene_make(&arena, &random, rays);
    for (size_t r = 0; r < sizeof records / sizeof records[0]; r++) {
        struct gn_cts_instance instances[3] = {gn_instance_of(0, NULL), gn_instance_of(0, NULL), gn_instance_of(1, NULL)};
        for (uint32_t i = 0; i < 3; i++) {
            instances[i].sbt_offset = records[r].offsets[i];
        }
        scene.instances = instances;
        const struct gn_cts_scene *found = gn_table_scene(&arena, &scene, &records[r].route);
        assert_non_null(found);
        if (gn_table_record_count(&scene, &records[r].route) != records[r].count || (found != &scene) != records[r].clash) {
            fail_msg("%s: %llu records, clash %d", records[r].name,
                     (unsigned long long)gn_table_record_count(&scene, &records[r].route), found != &scene);
        }
        if (found != &scene) {
            assert_ptr_equal(gn_table_scene(&arena, found, &records[r].route), found);
        }
    }
    gn_arena_finish(&arena);
}

static void other_numbers_are_kinds_of_hits(void **state)
{
    (void)state;
    for (uint32_t kind = 0; kind <= GN_REF_ANSWER_GENERATED; kind++) {
        assert_null(gn_answer_fault(kind));
    }
    for (uint32_t kind = GN_REF_ANSWER_GENERATED + 1; kind < 20; kind++) {
        assert_non_null(gn_answer_fault(kind));
    }
    assert_non_null(gn_answer_fault(UINT32_MAX));
}

static int open_device(void **state)
{
    (void)state;
    const char *icd = getenv("GNOMON_TEST_ICD");
    const struct gn_device_options options = {.icd = icd && *icd ? icd : NULL, .index = -1};
    char error[1024];
    device = gn_device_create(&options, error, sizeof error);
    if (!device) {
        print_error("%s\n", error);
    }
    return device ? 0 : -1;
}

static int close_device(void **state)
{
    (void)state;
    const uint64_t messages = gn_device_validation_count(device);
    if (messages) {
        print_error("layers reported %llu times: %s\n", (unsigned long long)messages,
                    gn_device_validation_first(device));
    }
    gn_device_destroy(device);
    return messages ? -1 : 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_route_gives_the_same),
        cmocka_unit_test(records_of_zeros_run_nothing),
        cmocka_unit_test(records_do_not_clash),
        cmocka_unit_test(other_numbers_are_kinds_of_hits),
    };
    return cmocka_run_group_tests(tests, open_device, close_device);
}
