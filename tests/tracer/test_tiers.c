/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What the specification says of small scenes, asked of every tier: masks, flags, facing, opacity, ranges, boxes, and
 * what is not a ray or not a scene.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "reference/tracer.h"

static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
static const float mirrored[12] = {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
static const float moved[12] = {0, -2, 0, 10, 2, 0, 0, 20, 0, 0, 2, 30};

/* The triangle (0,0,0) (4,0,0) (0,4,0) or the box [0,4]^3. */
struct setting {
    enum gn_ref_geometry_type type;
    uint32_t geometry_flags, instance_flags, mask;
    const float *geometry_transform, *instance_transform;
};

static struct gn_ref_scene *scene_of(const struct setting *setting)
{
    static const double positions[3][3] = {{0, 0, 0}, {4, 0, 0}, {0, 4, 0}};
    static const uint32_t triangles[1][3] = {{0, 1, 2}};
    static const float boxes[1][6] = {{0, 0, 0, 4, 4, 4}};
    struct gn_ref_geometry geometry = {.type = setting->type, .flags = setting->geometry_flags, .primitive_count = 1,
                                       .positions = positions, .position_count = 3, .divisor = 1,
                                       .triangles = triangles, .transform = setting->geometry_transform, .aabbs = boxes};
    struct gn_ref_instance instance = {.mask = setting->mask, .flags = setting->instance_flags, .custom_index = 0xABCDEF,
                                       .sbt_offset = 0x123456};
    memcpy(instance.transform, setting->instance_transform ? setting->instance_transform : identity, sizeof identity);
    struct gn_ref_scene *scene = gn_ref_scene_create();
    assert_true(gn_ref_scene_add_blas(scene, &geometry, 1, &instance.blas));
    assert_true(gn_ref_scene_add_instance(scene, &instance));
    assert_true(gn_ref_scene_commit(scene));
    return scene;
}

static struct gn_ref_tracer *tracer_of(const struct gn_ref_scene *scene, int tier)
{
    char error[320] = "untouched";
    struct gn_ref_tracer *tracer = gn_ref_tracer_create(scene, (enum gn_ref_tier)tier, error, sizeof error);
    if (!tracer)
        fail_msg("%s: %s", gn_ref_tier_name((enum gn_ref_tier)tier), error);
    assert_string_equal(error, "");
    assert_int_equal(gn_ref_tracer_tier(tracer), tier);
    return tracer;
}

static int failures;

static void expect(bool true_, const char *tier, const char *why, const char *what, double expected, double found)
{
    if (true_)
        return;
    print_error("%s, %s: %s: expected %g, found %g\n", tier, why, what, expected, found);
    failures++;
}

/* All of the questions, one ray and batches, answered alike; what closest() says is given. */
static struct gn_ref_record answer_of(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray, const char *why)
{
    const char *name = gn_ref_tier_name(gn_ref_tracer_tier(tracer));
    struct gn_ref_ray three[3] = {*ray, *ray, *ray};
    struct gn_ref_record record, batch[3], all[4];
    enum gn_ref_outcome outcome = gn_ref_tracer_closest(tracer, ray, &record), any[3];
    int64_t counts[3], count = gn_ref_tracer_all(tracer, ray, all, 4);
    three[1].direction[0] = NAN; /* a ray that is not valid disturbs no other */
    gn_ref_tracer_closest_batch(tracer, three, 3, batch);
    gn_ref_tracer_occluded_batch(tracer, three, 3, any);
    gn_ref_tracer_all_batch(tracer, three, 3, NULL, 0, counts);
    expect(record.outcome == outcome, name, why, "the record's outcome", outcome, record.outcome);
    expect(gn_ref_tracer_occluded(tracer, ray) == outcome, name, why, "occluded", outcome,
           gn_ref_tracer_occluded(tracer, ray));
    expect(count == (int64_t)outcome, name, why, "the number of all", outcome, (double)count);
    for (int i = 0; i < 3; i++) {
        int right = i == 1 ? GN_REF_INVALID_RAY : (int)outcome;
        expect((int)batch[i].outcome == right, name, why, "the batch", right, batch[i].outcome);
        expect((int)any[i] == right, name, why, "occluded in a batch", right, any[i]);
        expect(counts[i] == right, name, why, "all in a batch", right, (double)counts[i]);
    }
    static const struct gn_ref_hit none;
    if (outcome != GN_REF_HIT) {
        expect(memcmp(&record.hit, &none, sizeof none) == 0, name, why, "a hit of zeros", 0, record.hit.t);
    } else {
        expect(record.custom_index == 0xABCDEF && record.sbt_offset == 0x123456, name, why, "what the instance adds",
               0xABCDEF, record.custom_index);
        expect(all[0].hit.t == record.hit.t, name, why, "t of the first of all", record.hit.t, all[0].hit.t);
        expect(batch[2].hit.t == record.hit.t, name, why, "t in a batch", record.hit.t, batch[2].hit.t);
    }
    return record;
}

/*
 * The ray goes down (or up) through (1, 1); the triangle is counter-clockwise seen from above, so front from there
 * ("Ray Face Culling").
 */
static void flags_and_masks_mean_the_same_to_all(void **state)
{
    (void)state;
    const enum gn_ref_geometry_type T = GN_REF_TRIANGLES, B = GN_REF_AABBS;
    const struct {
        const char *why;
        struct setting setting;
        uint32_t flags, mask;
        bool up;
        int hit; /* expected; then, for a hit: */
        int front, opaque;
        double t;
    } rows[] = {
        {"a front face from above", {T, 1, 0, 0xFF, 0, 0}, 0, 0xFF, false, 1, 1, 1, 5},
        {"a back face from below", {T, 1, 0, 0xFF, 0, 0}, 0, 0xFF, true, 1, 0, 1, 5},
        {"an instance that mirrors changes no facing", {T, 1, 0, 0xFF, 0, mirrored}, 0, 0xFF, false, 1, 1, 1, 5},
        {"a geometry that mirrors does", {T, 1, 0, 0xFF, mirrored, 0}, 0, 0xFF, false, 1, 0, 1, 5},
        {"both", {T, 1, 0, 0xFF, mirrored, mirrored}, 0, 0xFF, false, 1, 0, 1, 5},
        {"flipped", {T, 1, 2, 0xFF, 0, 0}, 0, 0xFF, false, 1, 0, 1, 5},
        {"flipped and mirrored", {T, 1, 2, 0xFF, 0, mirrored}, 0, 0xFF, false, 1, 0, 1, 5},
        {"back faces culled, front seen", {T, 1, 0, 0xFF, 0, 0}, 0x10, 0xFF, false, 1, 1, 1, 5},
        {"back faces culled, back seen", {T, 1, 0, 0xFF, 0, 0}, 0x10, 0xFF, true, 0, 0, 0, 0},
        {"front faces culled, front seen", {T, 1, 0, 0xFF, 0, 0}, 0x20, 0xFF, false, 0, 0, 0, 0},
        {"front faces culled, back seen", {T, 1, 0, 0xFF, 0, 0}, 0x20, 0xFF, true, 1, 0, 1, 5},
        {"front faces culled of a mirrored instance", {T, 1, 0, 0xFF, 0, mirrored}, 0x20, 0xFF, false, 0, 0, 0, 0},
        {"front faces culled of a flipped instance", {T, 1, 2, 0xFF, 0, 0}, 0x20, 0xFF, false, 1, 0, 1, 5},
        {"culling disabled by the instance", {T, 1, 1, 0xFF, 0, 0}, 0x20, 0xFF, false, 1, 1, 1, 5},
        {"not opaque", {T, 0, 0, 0xFF, 0, 0}, 0, 0xFF, false, 1, 1, 0, 5},
        {"opaque culled, opaque", {T, 1, 0, 0xFF, 0, 0}, 0x40, 0xFF, false, 0, 0, 0, 0},
        {"opaque culled, not opaque", {T, 0, 0, 0xFF, 0, 0}, 0x40, 0xFF, false, 1, 1, 0, 5},
        {"not opaque culled, not opaque", {T, 0, 0, 0xFF, 0, 0}, 0x80, 0xFF, false, 0, 0, 0, 0},
        {"forced opaque by the instance", {T, 0, 4, 0xFF, 0, 0}, 0x80, 0xFF, false, 1, 1, 1, 5},
        {"forced not opaque by the instance", {T, 1, 8, 0xFF, 0, 0}, 0x80, 0xFF, false, 0, 0, 0, 0},
        {"the ray's opacity is the last word", {T, 1, 4, 0xFF, 0, 0}, 0x42, 0xFF, false, 1, 1, 0, 5},
        {"the ray's opacity, opaque", {T, 0, 8, 0xFF, 0, 0}, 0x81, 0xFF, false, 1, 1, 1, 5},
        {"triangles skipped", {T, 1, 0, 0xFF, 0, 0}, 0x100, 0xFF, false, 0, 0, 0, 0},
        {"boxes skipped, a triangle", {T, 1, 0, 0xFF, 0, 0}, 0x200, 0xFF, false, 1, 1, 1, 5},
        {"a bit of the mask", {T, 1, 0, 0x10, 0, 0}, 0, 0x90, false, 1, 1, 1, 5},
        {"no bit of the mask", {T, 1, 0, 0x10, 0, 0}, 0, 0xEF, false, 0, 0, 0, 0},
        {"no bit of the mask, instanced", {T, 1, 0, 0x10, 0, mirrored}, 0, 0xEF, false, 0, 0, 0, 0},
        {"a mask of the instance of 0", {T, 1, 0, 0, 0, 0}, 0, 0xFF, false, 0, 0, 0, 0},
        {"only 8 bits of the mask count", {T, 1, 0, 0xFF, 0, 0}, 0, 0x100, false, 0, 0, 0, 0},
        {"the first hit ends the ray: the same", {T, 1, 0, 0xFF, 0, 0}, 0x4, 0xFF, false, 1, 1, 1, 5},
        {"the closest hit shader skipped: the same", {T, 1, 0, 0xFF, 0, 0}, 0x8, 0xFF, false, 1, 1, 1, 5},
        {"a box from above", {B, 0, 0, 0xFF, 0, 0}, 0, 0xFF, false, 1, 0, 0, 1},
        {"a box from below", {B, 1, 0, 0xFF, 0, 0}, 0, 0xFF, true, 1, 0, 1, 5},
        {"a box, mirrored", {B, 1, 0, 0xFF, 0, mirrored}, 0, 0xFF, true, 1, 0, 1, 5},
        {"a box, faces culled", {B, 1, 0, 0xFF, 0, 0}, 0x30, 0xFF, true, 1, 0, 1, 5},
        {"a box, opaque culled", {B, 1, 0, 0xFF, 0, 0}, 0x40, 0xFF, true, 0, 0, 0, 0},
        {"a box, no bit of the mask", {B, 1, 0, 0xF, 0, 0}, 0, 0xF0, true, 0, 0, 0, 0},
        {"boxes skipped", {B, 1, 0, 0xFF, 0, 0}, 0x200, 0xFF, true, 0, 0, 0, 0},
        {"triangles skipped, a box", {B, 1, 0, 0xFF, 0, 0}, 0x100, 0xFF, true, 1, 0, 1, 5},
    };
    failures = 0;
    for (size_t r = 0; r < sizeof rows / sizeof rows[0]; r++) {
        struct gn_ref_scene *scene = scene_of(&rows[r].setting);
        bool x_mirrored = (rows[r].setting.geometry_transform != NULL) != (rows[r].setting.instance_transform != NULL);
        struct gn_ref_ray ray = {.origin = {x_mirrored ? -1 : 1, 1, rows[r].up ? -5 : 5},
                                 .direction = {0, 0, rows[r].up ? 1 : -1}, .tmax = INFINITY, .flags = rows[r].flags,
                                 .cull_mask = rows[r].mask};
        for (int tier = 0; tier < GN_REF_TIER_COUNT; tier++) {
            struct gn_ref_tracer *tracer = tracer_of(scene, tier);
            const char *name = gn_ref_tier_name((enum gn_ref_tier)tier);
            struct gn_ref_record record = answer_of(tracer, &ray, rows[r].why);
            expect((int)record.outcome == rows[r].hit, name, rows[r].why, "outcome", rows[r].hit, record.outcome);
            if (record.outcome == GN_REF_HIT && rows[r].hit) {
                expect(record.hit.front == rows[r].front, name, rows[r].why, "front", rows[r].front, record.hit.front);
                expect(record.hit.opaque == rows[r].opaque, name, rows[r].why, "opaque", rows[r].opaque, record.hit.opaque);
                expect(record.hit.t == rows[r].t, name, rows[r].why, "t", rows[r].t, record.hit.t);
                expect(record.hit.type == rows[r].setting.type, name, rows[r].why, "type", rows[r].setting.type,
                       record.hit.type);
                double b = rows[r].setting.type == GN_REF_TRIANGLES ? 0.25 : 0;
                expect(record.hit.beta == b && record.hit.gamma == b, name, rows[r].why, "barycentrics", b, record.hit.beta);
            }
            gn_ref_tracer_destroy(tracer);
        }
        gn_ref_scene_destroy(scene);
    }
    assert_int_equal(failures, 0);
}

/* The plane z = 0 is met at t = 5 of a ray of length 1 down from (1, 1, 5); the box [0,4]^3 between 1 and 5. */
static void ranges_are_open_for_triangles_and_closed_for_boxes(void **state)
{
    (void)state;
    const float before = nextafterf(5, 0), after = nextafterf(5, 9);
    const struct {
        const char *why;
        int type;
        float tmin, tmax;
        int hit;
        double t;
    } rows[] = {
        {"inside", 0, 4, 6, 1, 5},
        {"tmin one f32 below", 0, before, 6, 1, 5},
        {"tmin at t", 0, 5, 6, 0, 0},
        {"tmax one f32 above", 0, 0, after, 1, 5},
        {"tmax at t", 0, 0, 5, 0, 0},
        {"an empty range beside it", 0, 4, 4, 0, 0},
        {"an empty range at it", 0, 5, 5, 0, 0},
        {"tmin infinite", 0, INFINITY, INFINITY, 0, 0},
        {"the box, from outside", 1, 0, INFINITY, 1, 1},
        {"the box, from inside: the line's entry", 1, 2, INFINITY, 1, 1},
        {"the box, tmax at the entry", 1, 0, 1, 1, 1},
        {"the box, tmax before the entry", 1, 0, nextafterf(1, 0), 0, 0},
        {"the box, tmin at the exit", 1, 5, INFINITY, 1, 1},
        {"the box, tmin after the exit", 1, after, INFINITY, 0, 0},
        {"the box, a range of one point inside", 1, 3, 3, 1, 1},
        {"the box, tmin infinite", 1, INFINITY, INFINITY, 0, 0},
    };
    failures = 0;
    for (size_t r = 0; r < sizeof rows / sizeof rows[0]; r++) {
        struct setting setting = {.type = rows[r].type ? GN_REF_AABBS : GN_REF_TRIANGLES, .mask = 0xFF};
        struct gn_ref_scene *scene = scene_of(&setting);
        struct gn_ref_ray ray = {.origin = {1, 1, 5}, .direction = {0, 0, -1}, .tmin = rows[r].tmin,
                                 .tmax = rows[r].tmax, .cull_mask = 0xFF};
        for (int tier = 0; tier < GN_REF_TIER_COUNT; tier++) {
            struct gn_ref_tracer *tracer = tracer_of(scene, tier);
            struct gn_ref_record record = answer_of(tracer, &ray, rows[r].why);
            const char *name = gn_ref_tier_name((enum gn_ref_tier)tier);
            expect((int)record.outcome == rows[r].hit, name, rows[r].why, "outcome", rows[r].hit, record.outcome);
            expect(record.hit.t == rows[r].t, name, rows[r].why, "t", rows[r].t, record.hit.t);
            gn_ref_tracer_destroy(tracer);
        }
        gn_ref_scene_destroy(scene);
    }
    assert_int_equal(failures, 0);
}

/* A scene with nothing to hit is no error, and neither is what no ray can be: both have one answer. */
static void what_is_no_ray_and_no_scene(void **state)
{
    (void)state;
    const struct {
        const char *why;
        struct gn_ref_ray ray;
        int outcome; /* in a scene that the valid ones meet */
    } rows[] = {
        {"a ray", {{1, 1, 5}, 0, {0, 0, -1}, INFINITY, 0, 0xFF}, GN_REF_HIT},
        {"a direction of -0, -0, -1", {{1, 1, 5}, 0, {-0.0f, -0.0f, -1}, INFINITY, 0, 0xFF}, GN_REF_HIT},
        {"tmin -0", {{1, 1, 5}, -0.0f, {0, 0, -1}, INFINITY, 0, 0xFF}, GN_REF_HIT},
        {"tmax not infinite", {{1, 1, 5}, 0, {0, 0, -1}, 0x1.fffffep127f, 0, 0xFF}, GN_REF_HIT},
        {"origin NaN", {{1, NAN, 5}, 0, {0, 0, -1}, INFINITY, 0, 0xFF}, GN_REF_INVALID_RAY},
        {"origin infinite", {{1, 1, INFINITY}, 0, {0, 0, -1}, INFINITY, 0, 0xFF}, GN_REF_INVALID_RAY},
        {"direction NaN", {{1, 1, 5}, 0, {0, NAN, -1}, INFINITY, 0, 0xFF}, GN_REF_INVALID_RAY},
        {"direction infinite", {{1, 1, 5}, 0, {0, 0, -INFINITY}, INFINITY, 0, 0xFF}, GN_REF_INVALID_RAY},
        {"direction 0", {{1, 1, 5}, 0, {0, 0, 0}, INFINITY, 0, 0xFF}, GN_REF_INVALID_RAY},
        {"direction -0", {{1, 1, 5}, 0, {-0.0f, 0, -0.0f}, INFINITY, 0, 0xFF}, GN_REF_INVALID_RAY},
        {"tmin below 0", {{1, 1, 5}, -1, {0, 0, -1}, INFINITY, 0, 0xFF}, GN_REF_INVALID_RAY},
        {"tmin NaN", {{1, 1, 5}, NAN, {0, 0, -1}, INFINITY, 0, 0xFF}, GN_REF_INVALID_RAY},
        {"tmax NaN", {{1, 1, 5}, 0, {0, 0, -1}, NAN, 0, 0xFF}, GN_REF_INVALID_RAY},
        {"tmin above tmax", {{1, 1, 5}, 2, {0, 0, -1}, 1, 0, 0xFF}, GN_REF_INVALID_RAY},
    };
    static const double nan_positions[3][3] = {{NAN, 0, 0}, {4, 0, 0}, {0, 4, 0}};
    static const uint32_t triangles[1][3] = {{0, 1, 2}};
    static const float boxes[2][6] = {{NAN, 0, 0, 4, 4, 4}, {4, 0, 0, 0, 4, 4}};
    const struct gn_ref_geometry inactive[3] = {
        {.type = GN_REF_TRIANGLES, .primitive_count = 1, .positions = nan_positions, .position_count = 3, .divisor = 1,
         .triangles = triangles},
        {.type = GN_REF_AABBS, .primitive_count = 2, .aabbs = boxes},
        {.type = GN_REF_TRIANGLES, .divisor = 1},
    };
    struct gn_ref_scene *scenes[5];
    for (int s = 0; s < 5; s++) {
        struct gn_ref_instance instance = {.mask = 0xFF};
        memcpy(instance.transform, s == 4 ? moved : identity, sizeof identity);
        if (s == 0) {
            scenes[s] = scene_of(&(struct setting){.mask = 0xFF});
            continue;
        }
        scenes[s] = gn_ref_scene_create();
        instance.blas = GN_REF_NULL_BLAS;
        if (s >= 3) /* inactive primitives, with one instance and with two */
            assert_true(gn_ref_scene_add_blas(scenes[s], inactive, 3, &instance.blas));
        for (int i = 1; i < s; i++) /* 1: no instance; 2: a null reference */
            assert_true(gn_ref_scene_add_instance(scenes[s], &instance));
        assert_true(gn_ref_scene_commit(scenes[s]));
    }
    failures = 0;
    for (int s = 0; s < 5; s++)
        for (int tier = 0; tier < GN_REF_TIER_COUNT; tier++) {
            struct gn_ref_tracer *tracer = tracer_of(scenes[s], tier);
            for (size_t r = 0; r < sizeof rows / sizeof rows[0]; r++) {
                int right = s > 0 && rows[r].outcome == GN_REF_HIT ? GN_REF_MISS : rows[r].outcome;
                struct gn_ref_record record = answer_of(tracer, &rows[r].ray, rows[r].why);
                expect((int)record.outcome == right, gn_ref_tier_name((enum gn_ref_tier)tier), rows[r].why, "outcome",
                       right, record.outcome);
            }
            gn_ref_tracer_closest_batch(tracer, NULL, 0, NULL);
            gn_ref_tracer_occluded_batch(tracer, NULL, 0, NULL);
            gn_ref_tracer_all_batch(tracer, NULL, 0, NULL, 4, NULL);
            gn_ref_tracer_destroy(tracer);
        }
    for (int s = 0; s < 5; s++)
        gn_ref_scene_destroy(scenes[s]);
    assert_int_equal(failures, 0);
}

static void creation_and_names(void **state)
{
    (void)state;
    char error[320] = "";
    assert_null(gn_ref_tracer_create(NULL, GN_REF_TIER_FAST, error, sizeof error));
    assert_string_equal(error, "the scene is NULL, expected a committed one");
    struct gn_ref_scene *scene = gn_ref_scene_create();
    assert_null(gn_ref_tracer_create(scene, GN_REF_TIER_FAST, error, sizeof error));
    assert_string_equal(error, "the scene is not committed, expected a committed one");
    assert_null(gn_ref_tracer_create(scene, GN_REF_TIER_FAST, NULL, 0));
    assert_true(gn_ref_scene_commit(scene));
    assert_null(gn_ref_tracer_create(scene, GN_REF_TIER_COUNT, error, sizeof error));
    assert_string_equal(error, "tier 5, expected less than 5");
    gn_ref_tracer_destroy(NULL);
    gn_ref_scene_destroy(scene);

    static const char *const names[] = {"fast", "robust", "double", "certified", "exact"};
    for (int i = 0; i < GN_REF_TIER_COUNT; i++) {
        enum gn_ref_tier tier = GN_REF_TIER_COUNT;
        assert_string_equal(gn_ref_tier_name((enum gn_ref_tier)i), names[i]);
        assert_true(gn_ref_tier_find(names[i], &tier));
        assert_int_equal(tier, i);
    }
    enum gn_ref_tier kept = GN_REF_TIER_EXACT;
    assert_null(gn_ref_tier_name(GN_REF_TIER_COUNT));
    assert_false(gn_ref_tier_find("Fast", &kept));
    assert_false(gn_ref_tier_find("", &kept));
    assert_false(gn_ref_tier_find(NULL, &kept));
    assert_int_equal(kept, GN_REF_TIER_EXACT);
}

/* Building takes time and memory, and the memory grows with the scene. */
static void costs_are_counted(void **state)
{
    (void)state;
    enum { SIDE = 40 };
    static double positions[(SIDE + 1) * (SIDE + 1)][3];
    static uint32_t triangles[2 * SIDE * SIDE][3];
    for (uint32_t y = 0; y <= SIDE; y++)
        for (uint32_t x = 0; x <= SIDE; x++) {
            double *p = positions[y * (SIDE + 1) + x];
            p[0] = x;
            p[1] = y;
        }
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        uint32_t a = i / SIDE * (SIDE + 1) + i % SIDE;
        const uint32_t both[2][3] = {{a, a + 1, a + SIDE + 1}, {a + 1, a + SIDE + 2, a + SIDE + 1}};
        memcpy(triangles[2 * i], both, sizeof both);
    }
    uint64_t bytes[GN_REF_TIER_COUNT] = {0};
    for (uint32_t count = 2; count <= 2 * SIDE * SIDE; count += 2 * SIDE * SIDE - 2) {
        struct gn_ref_geometry geometry = {.primitive_count = count, .positions = (const double (*)[3])positions,
                                           .position_count = (SIDE + 1) * (SIDE + 1), .divisor = 1,
                                           .triangles = (const uint32_t (*)[3])triangles};
        struct gn_ref_instance instance = {.mask = 0xFF};
        memcpy(instance.transform, identity, sizeof identity);
        struct gn_ref_scene *scene = gn_ref_scene_create();
        assert_true(gn_ref_scene_add_blas(scene, &geometry, 1, &instance.blas));
        assert_true(gn_ref_scene_add_instance(scene, &instance));
        assert_true(gn_ref_scene_commit(scene));
        for (int tier = 0; tier < GN_REF_TIER_COUNT; tier++) {
            struct gn_ref_tracer *tracer = tracer_of(scene, tier);
            struct gn_ref_tracer_cost cost = gn_ref_tracer_cost(tracer);
            assert_true(cost.seconds > 0 && cost.seconds < 60);
            if (count == 2)
                bytes[tier] = cost.bytes;
            else
                assert_in_range(cost.bytes, bytes[tier] + 16 * count, bytes[tier] + 400 * count);
            gn_ref_tracer_destroy(tracer);
        }
        gn_ref_scene_destroy(scene);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(flags_and_masks_mean_the_same_to_all),
        cmocka_unit_test(ranges_are_open_for_triangles_and_closed_for_boxes),
        cmocka_unit_test(what_is_no_ray_and_no_scene),
        cmocka_unit_test(creation_and_names),
        cmocka_unit_test(costs_are_counted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
