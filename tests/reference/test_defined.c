/* SPDX-License-Identifier: Apache-2.0 */
/* What no triangle is hit for having no area, and what is beyond the limits: alike in every tier. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "reference/tracer.h"

static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

static struct gn_ref_scene *scene_of(const struct gn_ref_geometry *geometry, const float transform[12])
{
    struct gn_ref_scene *scene = gn_ref_scene_create();
    struct gn_ref_instance instance = {.mask = 0xFF};
    memcpy(instance.transform, transform, sizeof instance.transform);
    assert_true(gn_ref_scene_add_blas(scene, geometry, 1, &instance.blas));
    assert_true(gn_ref_scene_add_instance(scene, &instance));
    assert_true(gn_ref_scene_commit(scene));
    return scene;
}

static void nothing_without_area_is_hit(void **state)
{
    (void)state;
    static const float flat[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0}; /* squeezes a tilted triangle to a segment */
    static const struct {
        const char *why;
        double positions[3][3];
        uint32_t triangle[3];
        const float *geometry_transform;
        double aim[3]; /* a point of it */
    } rows[] = {
        {"an index twice", {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {0, 1, 1}, NULL, {0.5, 0, 0}},
        {"an index three times", {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {2, 2, 2}, NULL, {0, 1, 0}},
        {"a position twice", {{0, 0, 0}, {1, 1, 1}, {0, 0, 0}}, {0, 1, 2}, NULL, {0.5, 0.5, 0.5}},
        {"a position three times", {{3, 4, 5}, {3, 4, 5}, {3, 4, 5}}, {0, 1, 2}, NULL, {3, 4, 5}},
        {"corners in a row along an axis", {{-1, 0, 0}, {0, 0, 0}, {2, 0, 0}}, {0, 1, 2}, NULL, {1, 0, 0}},
        {"corners in a row, tilted", {{1, 2, 3}, {2, 4, 6}, {4, 8, 12}}, {0, 1, 2}, NULL, {3, 6, 9}},
        {"a singular geometry transform", {{0, 0, 0}, {1, 0, 1}, {0.5, 0, 2}}, {0, 1, 2}, flat, {0.5, 0, 0}},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        const uint32_t triangles[1][3] = {{rows[i].triangle[0], rows[i].triangle[1], rows[i].triangle[2]}};
        const struct gn_ref_geometry geometry = {.type = GN_REF_TRIANGLES, .primitive_count = 1,
                                                 .positions = rows[i].positions, .position_count = 3, .divisor = 1,
                                                 .triangles = triangles, .transform = rows[i].geometry_transform};
        struct gn_ref_scene *scene = scene_of(&geometry, identity);
        for (int tier = 0; tier < GN_REF_TIER_COUNT; tier++) {
            struct gn_ref_tracer *tracer = gn_ref_tracer_create(scene, (enum gn_ref_tier)tier, NULL, 0);
            assert_non_null(tracer);
            for (int d = 0; d < 27; d++) {
                struct gn_ref_ray ray = {.tmax = 100, .cull_mask = 0xFF};
                for (int c = 0, rest = d; c < 3; c++, rest /= 3) {
                    ray.direction[c] = (float)(rest % 3 - 1);
                    ray.origin[c] = (float)(rows[i].aim[c] - 2 * (rest % 3 - 1));
                }
                struct gn_ref_record record;
                enum gn_ref_outcome right = d == 13 ? GN_REF_INVALID_RAY : GN_REF_MISS; /* the direction 0 */
                if (gn_ref_tracer_closest(tracer, &ray, &record) != right || gn_ref_tracer_occluded(tracer, &ray) != right)
                    fail_msg("%s, tier %s, direction %g %g %g: expected %d, found %d", rows[i].why,
                             gn_ref_tier_name((enum gn_ref_tier)tier), (double)ray.direction[0], (double)ray.direction[1],
                             (double)ray.direction[2], (int)right, (int)record.outcome);
            }
            gn_ref_tracer_destroy(tracer);
        }
        gn_ref_scene_destroy(scene);
    }
}

/* 2^18 triangles in 2^12 instances are 2^30: refused before anything is placed. */
static void more_primitives_than_can_be_are_refused(void **state)
{
    (void)state;
    enum { TRIANGLES = 1 << 18, INSTANCES = 1 << 12 };
    static const double positions[3][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    uint32_t(*triangles)[3] = calloc(TRIANGLES, sizeof *triangles);
    assert_non_null(triangles);
    for (uint32_t i = 0; i < TRIANGLES; i++)
        triangles[i][1] = 1, triangles[i][2] = 2;
    const struct gn_ref_geometry geometry = {.type = GN_REF_TRIANGLES, .primitive_count = TRIANGLES, .positions = positions,
                                             .position_count = 3, .divisor = 1,
                                             .triangles = (const uint32_t(*)[3])triangles};
    struct gn_ref_scene *scene = gn_ref_scene_create();
    struct gn_ref_instance instance = {.mask = 0xFF};
    memcpy(instance.transform, identity, sizeof identity);
    assert_true(gn_ref_scene_add_blas(scene, &geometry, 1, &instance.blas));
    for (uint32_t i = 0; i < INSTANCES; i++)
        assert_true(gn_ref_scene_add_instance(scene, &instance));
    assert_false(gn_ref_scene_commit(scene));
    if (!strstr(gn_ref_scene_error(scene), "1073741824"))
        fail_msg("expected the number of primitives in '%s'", gn_ref_scene_error(scene));
    gn_ref_scene_destroy(scene);
    free(triangles);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(nothing_without_area_is_hit),
                                       cmocka_unit_test(more_primitives_than_can_be_are_refused)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
