/* SPDX-License-Identifier: Apache-2.0 */
/* What a shader can ask for beside the record: by hand, and by what has to hold between the numbers. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "reference/tracer.h"
#include "families.h"

static void expect(const char *what, int index, double expected, double found)
{
    if (expected != found)
        fail_msg("%s[%d]: expected %.17g, found %.17g", what, index, expected, found);
}

/* A quarter turn about z, twice as large, moved; the geometry's own transform exchanges x and z. */
static void numbers_by_hand(void **state)
{
    (void)state;
    static const float exchange[12] = {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 8};
    static const double positions[4][3] = {{0, 0, 0}, {127, 0, 0}, {0, 254, 0}, {NAN, 0, 0}};
    static const uint32_t triangles[2][3] = {{0, 1, 2}, {0, 1, 3}};
    static const float boxes[2][6] = {{0, 0, 0, 1, 1, 1}, {NAN, 0, 0, 1, 1, 1}};
    const struct gn_ref_geometry geometries[2] = {
        {.primitive_count = 2, .positions = positions, .position_count = 4, .divisor = 127, .triangles = triangles,
         .transform = exchange},
        {.type = GN_REF_AABBS, .primitive_count = 2, .aabbs = boxes},
    };
    struct gn_ref_instance instance = {.transform = {0, -2, 0, 10, 2, 0, 0, 20, 0, 0, 2, 30}, .mask = 0xFF};
    struct gn_ref_instance inactive = {.blas = GN_REF_NULL_BLAS};
    struct gn_ref_scene *scene = gn_ref_scene_create();
    struct gn_ref_ray ray = {.origin = {10, 24, 31}, .direction = {1, 2, 3}, .tmax = 1, .cull_mask = 0xFF};
    struct gn_ref_hit hit = {.instance = 1};
    struct gn_ref_hit_detail detail;
    assert_true(gn_ref_scene_add_blas(scene, geometries, 2, &instance.blas));
    assert_true(gn_ref_scene_add_instance(scene, &inactive));
    assert_true(gn_ref_scene_add_instance(scene, &instance));
    assert_false(gn_ref_hit_detail_exact(scene, &ray, &hit, &detail)); /* not committed */
    assert_true(gn_ref_scene_commit(scene));
    assert_true(gn_ref_hit_detail_exact(scene, &ray, &hit, &detail));

    static const double inverse[12] = {0, 0.5, 0, -10, -0.5, 0, 0, 5, 0, 0, 0.5, -15};
    static const double origin[3] = {2, 0, 0.5}, direction[3] = {1, -0.5, 1.5};
    static const double object[9] = {0, 0, 8, 0, 0, 9, 0, 2, 8}, world[9] = {10, 20, 46, 10, 20, 48, 6, 20, 46};
    assert_memory_equal(detail.world_from_object, instance.transform, sizeof detail.world_from_object);
    for (int i = 0; i < 12; i++)
        expect("object_from_world", i, inverse[i], detail.object_from_world[i]);
    for (int i = 0; i < 3; i++) {
        expect("object_origin", i, origin[i], detail.object_origin[i]);
        expect("object_direction", i, direction[i], detail.object_direction[i]);
    }
    for (int i = 0; i < 9; i++) {
        expect("object_vertices", i, object[i], detail.object_vertices[i / 3][i % 3]);
        expect("world_vertices", i, world[i], detail.world_vertices[i / 3][i % 3]);
    }
    hit.geometry = 1;
    assert_true(gn_ref_hit_detail_exact(scene, &ray, &hit, &detail));
    for (int i = 0; i < 9; i++)
        expect("vertices of a box", i, 0, detail.object_vertices[i / 3][i % 3] + detail.world_vertices[i / 3][i % 3]);

    const struct {
        const char *why;
        uint32_t instance, geometry, primitive;
        float direction;
    } rows[] = {
        {"an instance beyond the last", 2, 0, 0, 1}, {"an inactive instance", 0, 0, 0, 1},
        {"a geometry beyond the last", 1, 2, 0, 1},  {"a primitive beyond the last", 1, 0, 2, 1},
        {"an inactive triangle", 1, 0, 1, 1},        {"an inactive box", 1, 1, 1, 1},
        {"a ray that is not valid", 1, 0, 0, NAN},
    };
    for (size_t r = 0; r < sizeof rows / sizeof rows[0]; r++) {
        struct gn_ref_hit other = {.instance = rows[r].instance, .geometry = rows[r].geometry,
                                   .primitive = rows[r].primitive};
        ray.direction[0] = rows[r].direction;
        if (gn_ref_hit_detail_exact(scene, &ray, &other, &detail))
            fail_msg("%s: expected no detail", rows[r].why);
    }
    gn_ref_scene_destroy(scene);
}

/* The hit lies where the ray and the weights of the vertices say, in both spaces; and the inverse is one. */
static void numbers_fit_one_another(void **state)
{
    (void)state;
    static const char *const chosen[] = {"instances", "geometry transforms", "nearly singular"};
    int checked = 0;
    for (uint32_t f = 0; f < family_count; f++)
        for (size_t c = 0; c < 3; c++) {
            if (strcmp(families[f].name, chosen[c]) != 0)
                continue;
            for (uint64_t seed = 0; seed < 10; seed++) {
                struct rng rng = {seed};
                struct made_scene made = {0};
                struct family family = families[f];
                char error[320];
                family.options = 0;
                family.make(&made, &rng, 60);
                struct gn_ref_scene *scene = gn_ref_scene_create();
                uint32_t blas;
                for (uint32_t b = 0; b < made.scene.blas_count; b++)
                    assert_true(gn_ref_scene_add_blas(scene, &made.scene.geometries[made.scene.blas_first[b]],
                                                      made.scene.blas_first[b + 1] - made.scene.blas_first[b], &blas));
                for (uint32_t i = 0; i < made.scene.instance_count; i++)
                    assert_true(gn_ref_scene_add_instance(scene, &made.scene.instances[i]));
                assert_true(gn_ref_scene_commit(scene));
                struct gn_ref_tracer *tracer = gn_ref_tracer_create(scene, GN_REF_TIER_CERTIFIED, error, sizeof error);
                for (int i = 0; i < 100; i++) {
                    struct gn_ref_ray ray = made_ray(&made, &family, AIM_INTERIOR, &rng, NULL);
                    struct gn_ref_record record;
                    struct gn_ref_hit_detail d;
                    if (gn_ref_tracer_closest(tracer, &ray, &record) != GN_REF_HIT)
                        continue;
                    assert_true(gn_ref_hit_detail_exact(scene, &ray, &record.hit, &d));
                    checked++;
                    long double w[3] = {1 - (long double)record.hit.beta - record.hit.gamma, record.hit.beta,
                                        record.hit.gamma};
                    for (int k = 0; k < 3; k++) {
                        long double ends[2][2] = {
                            {d.object_origin[k] + (long double)record.hit.t * d.object_direction[k], 0},
                            {ray.origin[k] + (long double)record.hit.t * ray.direction[k], 0},
                        };
                        long double size[2] = {fabsl(ends[0][0]) + fabs(d.object_origin[k]),
                                               fabsl(ends[1][0]) + fabs(ray.origin[k])};
                        for (int v = 0; v < 3; v++) {
                            ends[0][1] += w[v] * d.object_vertices[v][k];
                            ends[1][1] += w[v] * d.world_vertices[v][k];
                            size[0] += fabs(d.object_vertices[v][k]);
                            size[1] += fabs(d.world_vertices[v][k]);
                        }
                        for (int space = 0; space < 2; space++)
                            if (!(fabsl(ends[space][0] - ends[space][1]) <= 0x1p-38L * size[space]))
                                fail_msg("%s, seed %d, space %d, axis %d: the ray is at %.17Lg, the weights at %.17Lg",
                                         chosen[c], (int)seed, space, k, ends[space][0], ends[space][1]);
                        for (int column = 0; column < 3; column++) {
                            long double sum = 0, magnitude = 0;
                            for (int j = 0; j < 3; j++) {
                                long double product =
                                    (long double)d.object_from_world[4 * k + j] * d.world_from_object[4 * j + column];
                                sum += product;
                                magnitude += fabsl(product);
                            }
                            assert_true(fabsl(sum - (k == column)) <= 0x1p-51L * magnitude);
                        }
                    }
                }
                gn_ref_tracer_destroy(tracer);
                gn_ref_scene_destroy(scene);
                made_scene_free(&made);
            }
        }
    assert_true(checked > 1000);
}

/* One triangle, and a transform of its geometry (NULL: none) and of its instance. */
static struct gn_ref_scene *triangle_scene(const double positions[3][3], const float *geometry_transform, float scale)
{
    static const uint32_t triangle[1][3] = {{0, 1, 2}};
    const struct gn_ref_geometry geometry = {.primitive_count = 1, .positions = positions, .position_count = 3,
                                             .divisor = 1, .triangles = triangle, .transform = geometry_transform};
    struct gn_ref_instance instance = {.transform = {scale, 0, 0, 0, 0, scale, 0, 0, 0, 0, scale, 0}, .mask = 0xFF};
    struct gn_ref_scene *scene = gn_ref_scene_create();
    assert_true(gn_ref_scene_add_blas(scene, &geometry, 1, &instance.blas));
    assert_true(gn_ref_scene_add_instance(scene, &instance));
    assert_true(gn_ref_scene_commit(scene));
    return scene;
}

/* Where f64 has few bits or none left, the bounds still hold what the number is wrong by. */
static void bounds_hold_below_normal_numbers(void **state)
{
    (void)state;
    /* x and z are 2^127 a, and a part of 2^-447 in one of them after the instance's 2^-149; y is 0 in the first two vertices. */
    static const float apart[12] = {0x1p127f, 0x1p-149f, 0, 0, 0, 1, 1, -0x1p-149f, 0x1p127f, 0, 0x1p-149f, 0};
    static const struct {
        const char *what;
        double positions[3][3];
        const float *geometry_transform;
        float scale, direction;
        double t, beta; /* the nearest f64s of the exact values, neither of which is one */
        bool t_tiny, weights_tiny;
    } rows[] = {
        {"t", {{-1, -1, 1e-310}, {1, -1, 1e-310}, {0, 1, 1e-310}}, NULL, 1, 3, 1e-310 / 3, 0.25, true, false},
        {"t, f32 inputs", {{0x1p127, 0x1p-149, 0}, {-0x1p127, 0, 0x1p-149}, {0, 0x1p100, 0}}, apart, 0x1p-149f, 0x1p127f, 0, 0.5,
         true, false},
        {"t, just above", {{-1, -1, 0x1.8p-1022}, {1, -1, 0x1.8p-1022}, {0, 1, 0x1.8p-1022}}, NULL, 1, 5,
         0x1.8p-1022 / 5, 0.25, true, false},
        {"a weight", {{-1e-310, 0, 1}, {3, 0, 1}, {0, 1, 1}}, NULL, 1, 1, 1, 1e-310 / 3, false, true},
    };
    for (size_t r = 0; r < sizeof rows / sizeof rows[0]; r++) {
        struct gn_ref_scene *scene = triangle_scene(rows[r].positions, rows[r].geometry_transform, rows[r].scale);
        const struct gn_ref_ray ray = {.direction = {0, 0, rows[r].direction}, .tmax = INFINITY, .cull_mask = 0xFF};
        struct gn_ref_record found[4] = {0};
        struct gn_ref_hit *hits[5];
        const char *const names[5] = {"certified", "certified, batch", "all", "exact", "refined"};
        struct gn_ref_hit refined = {0};
        char error[320];
        int8_t met;
        assert_true(gn_ref_hit_refine_exact(scene, &ray, &refined));
        hits[4] = &refined;
        for (int i = 0; i < 4; i++)
            hits[i] = &found[i].hit;
        assert_int_equal(gn_ref_trace_closest_triangle_exact(scene, &ray, hits[0]), 1);
        gn_ref_trace_closest_triangles_exact(scene, &ray, 1, hits[1], &met);
        assert_int_equal(met, 1);
        assert_int_equal(gn_ref_trace_all_exact(scene, &ray, hits[2], 1), 1);
        struct gn_ref_tracer *tracer = gn_ref_tracer_create(scene, GN_REF_TIER_EXACT, error, sizeof error);
        assert_non_null(tracer);
        assert_int_equal(gn_ref_tracer_closest(tracer, &ray, &found[3]), GN_REF_HIT);
        for (int i = 0; i < 5; i++) {
            const struct gn_ref_hit *hit = hits[i];
            if (fabs(hit->t - rows[r].t) > 0 && rows[r].t_tiny)
                fail_msg("%s, %s: expected t %a, found %a", rows[r].what, names[i], rows[r].t, hit->t);
            if (fabs(hit->beta - rows[r].beta) > 0 && rows[r].weights_tiny)
                fail_msg("%s, %s: expected beta %a, found %a", rows[r].what, names[i], rows[r].beta, hit->beta);
            if (rows[r].t_tiny && !(hit->t_error >= 0x1p-1074 && hit->t_error <= 0x1p-1070 && hit->t_exit_error == hit->t_error))
                fail_msg("%s, %s: t is wrong by less than 2^-1074, found a bound of %a", rows[r].what, names[i], hit->t_error);
            if (rows[r].weights_tiny && !(hit->barycentric_error >= 0x1p-1074))
                fail_msg("%s, %s: a weight is wrong, found a bound of %a", rows[r].what, names[i], hit->barycentric_error);
        }
        gn_ref_tracer_destroy(tracer);
        gn_ref_scene_destroy(scene);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bounds_hold_below_normal_numbers),
        cmocka_unit_test(numbers_by_hand),
        cmocka_unit_test(numbers_fit_one_another),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
