/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Single rays whose answers follow from the specification by hand: facing, ranges, flags, boxes, ties. What follows
 * from arithmetic alone is the proof's business (test_proof.c).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <fenv.h>
#include <math.h>
#include <string.h>

#include "reference/trace.h"

static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
static const float mirrored[12] = {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

/* The triangle (0,0,0) (4,0,0) (0,4,0) or the box [0,4]^3, placed by the two transforms. */
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
    struct gn_ref_instance instance = {.mask = setting->mask, .flags = setting->instance_flags};
    memcpy(instance.transform, setting->instance_transform ? setting->instance_transform : identity, sizeof identity);
    struct gn_ref_scene *scene = gn_ref_scene_create();
    assert_true(gn_ref_scene_add_blas(scene, &geometry, 1, &instance.blas));
    assert_true(gn_ref_scene_add_instance(scene, &instance));
    assert_true(gn_ref_scene_commit(scene));
    return scene;
}

static struct gn_ref_ray ray_of(float ox, float oy, float oz, float dx, float dy, float dz)
{
    return (struct gn_ref_ray){.origin = {ox, oy, oz}, .direction = {dx, dy, dz}, .tmax = INFINITY, .cull_mask = 0xFF};
}

/*
 * "Ray Face Culling": a = -1/2 sum(x_i y_i+1 - x_i+1 y_i) in ray space, front when a < 0. For the direction (0,0,-1)
 * ray space is object space moved to the origin, so the triangle, counter-clockwise there, has a = -8: front.
 * "Because the facing is determined in object space, an instance transform does not change the winding, but a geometry
 * transform does."
 */
static void facing_follows_the_specification(void **state)
{
    (void)state;
    const struct {
        const char *why;
        const float *geometry_transform, *instance_transform;
        uint32_t instance_flags;
        float x, dz;
        bool front;
    } rows[] = {
        {"counter-clockwise along -z", NULL, NULL, 0, 1, -1, true},
        {"from the other side", NULL, NULL, 0, 1, 1, false},
        {"flipped", NULL, NULL, GN_REF_INSTANCE_FLIP_FACING, 1, -1, false},
        {"flipped, from the other side", NULL, NULL, GN_REF_INSTANCE_FLIP_FACING, 1, 1, true},
        {"a mirrored instance does not change it", NULL, mirrored, 0, -1, -1, true},
        {"a mirrored geometry does", mirrored, NULL, 0, -1, -1, false},
        {"both", mirrored, mirrored, 0, 1, -1, false},
        {"both, flipped", mirrored, mirrored, GN_REF_INSTANCE_FLIP_FACING, 1, -1, true},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct setting setting = {GN_REF_TRIANGLES, 0, rows[i].instance_flags, 0xFF, rows[i].geometry_transform,
                                  rows[i].instance_transform};
        for (uint32_t cull = 0; cull < 6; cull++) {
            static const uint32_t flags[3] = {0, GN_REF_RAY_CULL_BACK_FACING, GN_REF_RAY_CULL_FRONT_FACING};
            setting.instance_flags = rows[i].instance_flags | (cull >= 3 ? GN_REF_INSTANCE_FACING_CULL_DISABLE : 0);
            struct gn_ref_scene *scene = scene_of(&setting);
            struct gn_ref_ray ray = ray_of(rows[i].x, 1, -rows[i].dz, 0, 0, rows[i].dz);
            ray.flags = flags[cull % 3];
            bool culled = cull < 3 && (rows[i].front ? cull == 2 : cull == 1);
            struct gn_ref_hit hit;
            int found = gn_ref_trace_closest_triangle_exact(scene, &ray, &hit);
            if (found != !culled || (found == 1 && hit.front != rows[i].front))
                fail_msg("%s, flags 0x%x: expected %s %s, found %d %s", rows[i].why, ray.flags,
                         culled ? "no hit" : "a hit", rows[i].front ? "front" : "back", found,
                         hit.front ? "front" : "back");
            gn_ref_scene_destroy(scene);
        }
    }
}

/* "Ray Opacity Culling": geometry, overridden by the instance, overridden by the ray; culling looks at the result. */
static void opacity_follows_the_specification(void **state)
{
    (void)state;
    const struct {
        uint32_t geometry, instance, ray;
        bool opaque, hit;
    } rows[] = {
        {0, 0, 0, false, true},
        {GN_REF_GEOMETRY_OPAQUE, 0, 0, true, true},
        {0, GN_REF_INSTANCE_FORCE_OPAQUE, 0, true, true},
        {GN_REF_GEOMETRY_OPAQUE, GN_REF_INSTANCE_FORCE_NO_OPAQUE, 0, false, true},
        {0, 0, GN_REF_RAY_OPAQUE, true, true},
        {GN_REF_GEOMETRY_OPAQUE, 0, GN_REF_RAY_NO_OPAQUE, false, true},
        {0, GN_REF_INSTANCE_FORCE_OPAQUE, GN_REF_RAY_NO_OPAQUE, false, true},
        {GN_REF_GEOMETRY_OPAQUE, GN_REF_INSTANCE_FORCE_NO_OPAQUE, GN_REF_RAY_OPAQUE, true, true},
        {GN_REF_GEOMETRY_OPAQUE, 0, GN_REF_RAY_CULL_OPAQUE, true, false},
        {0, 0, GN_REF_RAY_CULL_OPAQUE, false, true},
        {0, GN_REF_INSTANCE_FORCE_OPAQUE, GN_REF_RAY_CULL_OPAQUE, true, false},
        {GN_REF_GEOMETRY_OPAQUE, GN_REF_INSTANCE_FORCE_NO_OPAQUE, GN_REF_RAY_CULL_OPAQUE, false, true},
        {0, 0, GN_REF_RAY_CULL_NO_OPAQUE, false, false},
        {GN_REF_GEOMETRY_OPAQUE, 0, GN_REF_RAY_CULL_NO_OPAQUE, true, true},
        {GN_REF_GEOMETRY_OPAQUE, GN_REF_INSTANCE_FORCE_NO_OPAQUE, GN_REF_RAY_CULL_NO_OPAQUE, false, false},
        {0, 0, GN_REF_RAY_SKIP_AABBS, false, true}, /* of triangles; the boxes' row is the other way round */
        {0, 0, GN_REF_RAY_SKIP_TRIANGLES, false, false},
        {GN_REF_GEOMETRY_NO_DUPLICATE, 0, GN_REF_RAY_TERMINATE_ON_FIRST_HIT | GN_REF_RAY_SKIP_CLOSEST_HIT_SHADER, false,
         true},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        for (int type = GN_REF_TRIANGLES; type <= GN_REF_AABBS; type++) {
            struct setting setting = {(enum gn_ref_geometry_type)type, rows[i].geometry, rows[i].instance, 0xFF, NULL, NULL};
            struct gn_ref_scene *scene = scene_of(&setting);
            struct gn_ref_ray ray = ray_of(1, 1, 5, 0, 0, -1);
            ray.flags = rows[i].ray;
            bool expected = rows[i].hit;
            if (ray.flags & (GN_REF_RAY_SKIP_AABBS | GN_REF_RAY_SKIP_TRIANGLES) && type == GN_REF_AABBS)
                expected = !expected;
            struct gn_ref_hit hit;
            int64_t count = gn_ref_trace_all_exact(scene, &ray, &hit, 1);
            if (count != expected || (count == 1 && (hit.opaque != rows[i].opaque || (int)hit.type != type)))
                fail_msg("row %zu, type %d: expected %d opaque %d, found %d opaque %d", i, type, expected,
                         rows[i].opaque, (int)count, hit.opaque);
            gn_ref_scene_destroy(scene);
        }
}

static void mask_takes_eight_bits(void **state)
{
    (void)state;
    const struct {
        uint32_t instance, ray;
        int hit;
    } rows[] = {{0xFF, 0xFF, 1}, {0x01, 0x01, 1}, {0x01, 0x02, 0}, {0x80, 0xFFFFFF80, 1}, {0x80, 0x100, 0}, {0, 0xFF, 0}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct setting setting = {GN_REF_TRIANGLES, 0, 0, rows[i].instance, NULL, NULL};
        struct gn_ref_scene *scene = scene_of(&setting);
        struct gn_ref_ray ray = ray_of(1, 1, 5, 0, 0, -1);
        ray.cull_mask = rows[i].ray;
        struct gn_ref_hit hit;
        assert_int_equal(gn_ref_trace_closest_triangle_exact(scene, &ray, &hit), rows[i].hit);
        gn_ref_scene_destroy(scene);
    }
}

/* Triangles take tmin < t < tmax, boxes the closed range; the triangle is met at t = 5, the box from 1 to 5. */
static void ranges_are_open_and_closed(void **state)
{
    (void)state;
    const float below = nextafterf(5, 0), above = nextafterf(5, 6);
    const struct {
        float tmin, tmax;
        int triangle, box;
    } rows[] = {
        {0, INFINITY, 1, 1}, {0, 5, 0, 1}, {0, above, 1, 1}, {5, INFINITY, 0, 1}, {below, INFINITY, 1, 1},
        {5, 5, 0, 1}, {above, INFINITY, 0, 0}, {above, above, 0, 0}, {0, 1, 0, 1}, {0, nextafterf(1, 0), 0, 0},
        {3, 3, 0, 1}, {INFINITY, INFINITY, 0, 0}, {0, 0, 0, 0},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        for (int type = GN_REF_TRIANGLES; type <= GN_REF_AABBS; type++) {
            struct setting setting = {(enum gn_ref_geometry_type)type, 0, 0, 0xFF, NULL, NULL};
            struct gn_ref_scene *scene = scene_of(&setting);
            struct gn_ref_ray ray = ray_of(1, 1, 5, 0, 0, -1);
            ray.tmin = rows[i].tmin;
            ray.tmax = rows[i].tmax;
            struct gn_ref_hit hit;
            int64_t expected = type == GN_REF_TRIANGLES ? rows[i].triangle : rows[i].box;
            int64_t count = gn_ref_trace_all_exact(scene, &ray, &hit, 1);
            if (count != expected)
                fail_msg("[%a, %a], type %d: expected %d, found %d", rows[i].tmin, rows[i].tmax, type, (int)expected,
                         (int)count);
            if (count == 1 && type == GN_REF_AABBS) {
                assert_true(hit.t == 1 && hit.t_exit == 5);
            } else if (count == 1) {
                assert_true(hit.t == 5 && hit.beta == 0.25 && hit.gamma == 0.25);
            }
            gn_ref_scene_destroy(scene);
        }
}

static void invalid_rays_are_refused(void **state)
{
    (void)state;
    struct setting setting = {GN_REF_TRIANGLES, 0, 0, 0xFF, NULL, NULL};
    struct gn_ref_scene *scene = scene_of(&setting);
    struct gn_ref_hit hit;
    const struct gn_ref_ray good = ray_of(1, 1, 5, 0, 0, -1);
    struct gn_ref_ray bad[8];
    for (int i = 0; i < 8; i++)
        bad[i] = good;
    bad[0].origin[1] = NAN;
    bad[1].origin[2] = INFINITY;
    bad[2].direction[0] = NAN;
    bad[3].direction[2] = -0.0f;
    bad[4].tmin = NAN;
    bad[5].tmax = NAN;
    bad[6].tmin = -1;
    bad[7].tmin = 2, bad[7].tmax = 1;
    for (int i = 0; i < 8; i++) {
        assert_int_equal(gn_ref_trace_closest_triangle_exact(scene, &bad[i], &hit), -1);
        assert_int_equal(gn_ref_trace_all_exact(scene, &bad[i], &hit, 1), -1);
    }
    gn_ref_scene_destroy(scene);
}

static void boxes_are_closed(void **state)
{
    (void)state;
    struct setting setting = {GN_REF_AABBS, 0, 0, 0xFF, NULL, NULL};
    struct gn_ref_scene *scene = scene_of(&setting);
    const struct {
        const char *why;
        struct gn_ref_ray ray;
        int64_t count;
        double entry, leave;
    } rows[] = {
        {"from inside", ray_of(1, 1, 1, 1, 0, 0), 1, -1, 3},
        {"along a face", ray_of(-1, 0, 2, 1, 0, 0), 1, 1, 5},
        {"along a face, just outside", ray_of(-1, nextafterf(0, -1), 2, 1, 0, 0), 0, 0, 0},
        {"along an edge", ray_of(-1, 4, 4, 2, 0, 0), 1, 0.5, 2.5},
        {"through a corner alone", ray_of(-1, 1, 0, 1, -1, 0), 1, 1, 1},
        {"past the corner", ray_of(-1, 1, -0x1p-149f, 1, -1, 0), 0, 0, 0},
        {"behind", ray_of(5, 1, 1, 1, 0, 0), 0, 0, 0},
        {"starting on a face, leaving", ray_of(4, 1, 1, 1, 0, 0), 1, -4, 0},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_ref_hit hit = {0};
        int64_t count = gn_ref_trace_all_exact(scene, &rows[i].ray, &hit, 1);
        if (count != rows[i].count || hit.t != rows[i].entry || hit.t_exit != rows[i].leave)
            fail_msg("%s: expected %d [%g, %g], found %d [%g, %g]", rows[i].why, (int)rows[i].count, rows[i].entry,
                     rows[i].leave, (int)count, hit.t, hit.t_exit);
    }
    gn_ref_scene_destroy(scene);
}

/* Eight triangles in one place and a fan around one vertex: ties go by instance, geometry, primitive. */
static void ties_go_by_ids(void **state)
{
    (void)state;
    static const double positions[5][3] = {{0, 0, 0}, {4, 0, 0}, {0, 4, 0}, {-4, 0, 0}, {0, -4, 0}};
    static const uint32_t triangles[4][3] = {{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 1}};
    struct gn_ref_geometry geometry = {.primitive_count = 4, .positions = positions, .position_count = 5, .divisor = 1,
                                       .triangles = triangles};
    const struct gn_ref_geometry both[2] = {geometry, geometry};
    struct gn_ref_instance instance = {.mask = 0xFF};
    memcpy(instance.transform, identity, sizeof identity);
    struct gn_ref_scene *scene = gn_ref_scene_create();
    assert_true(gn_ref_scene_add_blas(scene, both, 2, &instance.blas));
    assert_true(gn_ref_scene_add_instance(scene, &instance));
    assert_true(gn_ref_scene_add_instance(scene, &instance));
    assert_true(gn_ref_scene_commit(scene));
    struct gn_ref_ray ray = ray_of(1, 2, 3, -1, -2, -3);
    struct gn_ref_hit hits[16], closest;
    assert_int_equal(gn_ref_trace_all_exact(scene, &ray, hits, 16), 16);
    for (uint32_t i = 0; i < 16; i++) {
        assert_int_equal(hits[i].instance, i / 8);
        assert_int_equal(hits[i].geometry, i / 4 % 2);
        assert_int_equal(hits[i].primitive, i % 4);
        assert_true(hits[i].t == 1);
        assert_int_equal(gn_ref_compare_t_exact(scene, &ray, &hits[i], &hits[15 - i]), 0);
    }
    assert_int_equal(gn_ref_trace_closest_triangle_exact(scene, &ray, &closest), 1);
    assert_int_equal(closest.instance + closest.geometry + closest.primitive, 0);
    /* Fewer than there are: the nearest, and the number of all. */
    memset(hits, 0xFF, sizeof hits);
    assert_int_equal(gn_ref_trace_all_exact(scene, &ray, hits, 3), 16);
    assert_int_equal(hits[2].primitive, 2);
    assert_int_equal(hits[3].primitive, UINT32_MAX);
    assert_int_equal(gn_ref_trace_all_exact(scene, &ray, NULL, 0), 16);
    gn_ref_scene_destroy(scene);
}

/* A caller's rounding mode changes no answer, and is its own again afterwards. */
static void rounding_mode_of_the_caller_is_kept(void **state)
{
    (void)state;
    const int modes[4] = {FE_TONEAREST, FE_UPWARD, FE_DOWNWARD, FE_TOWARDZERO};
    struct setting setting = {GN_REF_TRIANGLES, 0, 0, 0xFF, NULL, NULL};
    double t = 0;
    for (int i = 0; i < 4; i++) {
        fesetround(modes[i]);
        struct gn_ref_scene *scene = scene_of(&setting);
        struct gn_ref_ray ray = ray_of(0.1f, 0.3f, 0.7f, 0.1f, 0.1f, -0.3f);
        struct gn_ref_hit hit;
        int found = gn_ref_trace_closest_triangle_exact(scene, &ray, &hit);
        int mode = fegetround();
        gn_ref_scene_destroy(scene);
        fesetround(FE_TONEAREST);
        assert_int_equal(found, 1);
        assert_int_equal(mode, modes[i]);
        if (i == 0)
            t = hit.t;
        assert_true(hit.t == t);
    }
#if defined(__SSE2__)
    unsigned before = __builtin_ia32_stmxcsr();
    __builtin_ia32_ldmxcsr(before | 0x8040);
    struct gn_ref_scene *scene = scene_of(&setting);
    struct gn_ref_ray ray = ray_of(1, 1, 0x1p-140f, 0, 0, -0x1p-149f);
    struct gn_ref_hit hit = {0};
    int found = gn_ref_trace_closest_triangle_exact(scene, &ray, &hit);
    bool kept = (__builtin_ia32_stmxcsr() & 0x8040) == 0x8040;
    gn_ref_scene_destroy(scene);
    __builtin_ia32_ldmxcsr(before);
    assert_int_equal(found, 1);
    assert_true(kept);
    assert_true(hit.t == 512);
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(facing_follows_the_specification),
        cmocka_unit_test(opacity_follows_the_specification),
        cmocka_unit_test(mask_takes_eight_bits),
        cmocka_unit_test(ranges_are_open_and_closed),
        cmocka_unit_test(invalid_rays_are_refused),
        cmocka_unit_test(boxes_are_closed),
        cmocka_unit_test(ties_go_by_ids),
        cmocka_unit_test(rounding_mode_of_the_caller_is_kept),
    };
    return cmocka_run_group_tests_name("reference.trace", tests, NULL, NULL);
}
