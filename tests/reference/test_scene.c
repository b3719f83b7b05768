/* SPDX-License-Identifier: Apache-2.0 */
/* What may be added to a scene and what may not, each refusal with a message that names the place. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "families.h"
#include "reference/scene.h"
#include "reference/trace.h"

static const double unit_positions[3][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
static const uint32_t unit_triangle[1][3] = {{0, 1, 2}};
static const float unit_box[1][6] = {{0, 0, 0, 1, 1, 1}};
static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

static const struct gn_ref_geometry triangle = {.type = GN_REF_TRIANGLES, .primitive_count = 1,
                                                .positions = unit_positions, .position_count = 3, .divisor = 1,
                                                .triangles = unit_triangle};
static const struct gn_ref_geometry box = {.type = GN_REF_AABBS, .primitive_count = 1, .aabbs = unit_box};

static struct gn_ref_instance instance_of(uint32_t blas)
{
    struct gn_ref_instance instance = {.mask = 0xFF, .blas = blas};
    memcpy(instance.transform, identity, sizeof identity);
    return instance;
}

static void expect_blas(const char *why, const struct gn_ref_geometry *geometry, const char *message)
{
    struct gn_ref_scene *scene = gn_ref_scene_create();
    uint32_t blas;
    bool added = gn_ref_scene_add_blas(scene, geometry, 1, &blas);
    if (added != (message == NULL) || (message && !strstr(gn_ref_scene_error(scene), message)))
        fail_msg("%s: expected %s, found \"%s\"", why, message ? message : "it to be added", gn_ref_scene_error(scene));
    gn_ref_scene_destroy(scene);
}

static void geometry_is_checked(void **state)
{
    (void)state;
    struct gn_ref_geometry g;
    expect_blas("the plain triangle", &triangle, NULL);
    expect_blas("the plain box", &box, NULL);

    g = triangle, g.primitive_count = 0, g.triangles = NULL, g.positions = NULL, g.position_count = 0;
    expect_blas("an empty geometry needs no arrays", &g, NULL);
    g = triangle, g.triangles = NULL;
    expect_blas("no indices", &g, "triangles is NULL");
    g = triangle, g.positions = NULL;
    expect_blas("no positions", &g, "no positions for 1 triangles");
    g = triangle, g.position_count = 2;
    expect_blas("an index just beyond", &g, "vertex 2 of triangle 0 is 2, expected less than 2");
    g = box, g.aabbs = NULL;
    expect_blas("no boxes", &g, "aabbs is NULL");
    g = triangle, g.type = (enum gn_ref_geometry_type)2;
    expect_blas("an unknown type", &g, "type is 2");
    g = triangle, g.flags = 4;
    expect_blas("an unknown flag", &g, "flags are 0x4");
    g = triangle, g.flags = 3;
    expect_blas("all flags", &g, NULL);
    g = triangle, g.primitive_count = UINT32_MAX;
    expect_blas("more primitives than can be", &g, "4294967295 primitives");

    const double divisors[] = {0, -1, INFINITY, NAN};
    for (size_t i = 0; i < sizeof divisors / sizeof divisors[0]; i++) {
        g = triangle, g.divisor = divisors[i];
        expect_blas("a divisor that is not positive and finite", &g, "divisor is");
    }

    float transform[12];
    memcpy(transform, identity, sizeof transform);
    g = triangle, g.transform = transform;
    expect_blas("a geometry transform", &g, NULL);
    memset(transform, 0, sizeof transform);
    expect_blas("a singular geometry transform makes degenerate triangles", &g, NULL);
    transform[7] = NAN;
    expect_blas("a transform that is not finite", &g, "transform element [1][3] is nan");

    double positions[4][3];
    memcpy(positions, unit_positions, sizeof unit_positions);
    memset(positions[3], 0, sizeof positions[3]);
    g = triangle, g.positions = (const double (*)[3])positions, g.position_count = 4;
    positions[1][2] = INFINITY;
    expect_blas("an infinite vertex", &g, "z of vertex 1 (of triangle 0) is inf");
    positions[1][2] = NAN;
    expect_blas("a NaN elsewhere than in x", &g, "z of vertex 1 (of triangle 0) is nan");
    positions[0][0] = NAN;
    expect_blas("the same in an inactive triangle", &g, NULL);
    memcpy(positions, unit_positions, sizeof unit_positions);
    positions[3][1] = INFINITY;
    expect_blas("an infinite vertex that no triangle uses", &g, NULL);

    float boxes[1][6] = {{0, 0, 0, 1, INFINITY, 1}};
    g = box, g.aabbs = (const float (*)[6])boxes;
    expect_blas("an infinite box", &g, "component 4 of box 0 is inf");
    boxes[0][0] = NAN;
    expect_blas("the same in an inactive box", &g, NULL);
}

static void instance_is_checked(void **state)
{
    (void)state;
    const struct {
        const char *why;
        size_t offset;
        uint32_t value;
        const char *message;
    } rows[] = {
        {"the first BLAS", offsetof(struct gn_ref_instance, blas), 0, NULL},
        {"a BLAS that is not there", offsetof(struct gn_ref_instance, blas), 1, "BLAS 1, expected less than 1"},
        {"no BLAS", offsetof(struct gn_ref_instance, blas), GN_REF_NULL_BLAS, NULL},
        {"24 bits of custom index", offsetof(struct gn_ref_instance, custom_index), 0xFFFFFF, NULL},
        {"25 bits of custom index", offsetof(struct gn_ref_instance, custom_index), 0x1000000, "custom index 0x1000000"},
        {"25 bits of SBT offset", offsetof(struct gn_ref_instance, sbt_offset), 0x1000000, "SBT offset 0x1000000"},
        {"9 bits of mask", offsetof(struct gn_ref_instance, mask), 0x100, "mask 0x100"},
        {"an unknown flag", offsetof(struct gn_ref_instance, flags), 0x10, "flags 0x10"},
        {"opaque and not", offsetof(struct gn_ref_instance, flags), 0xC, "opaque and not opaque"},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_ref_scene *scene = gn_ref_scene_create();
        uint32_t blas;
        assert_true(gn_ref_scene_add_blas(scene, &triangle, 1, &blas));
        struct gn_ref_instance instance = instance_of(blas);
        memcpy((char *)&instance + rows[i].offset, &rows[i].value, sizeof rows[i].value);
        bool added = gn_ref_scene_add_instance(scene, &instance);
        if (added != (rows[i].message == NULL) ||
            (rows[i].message && !strstr(gn_ref_scene_error(scene), rows[i].message)))
            fail_msg("%s: found \"%s\"", rows[i].why, gn_ref_scene_error(scene));
        gn_ref_scene_destroy(scene);
    }
}

/* The determinant's sign is decided exactly: in f32, and even in f64, some of these look like their neighbours. */
static void singular_instance_is_refused(void **state)
{
    (void)state;
    const float tiny = 0x1p-149f;
    const struct {
        const char *why;
        float linear[9];
        bool regular;
    } rows[] = {
        {"identity", {1, 0, 0, 0, 1, 0, 0, 0, 1}, true},
        {"zero", {0}, false},
        {"two equal rows", {1, 2, 3, 1, 2, 3, 0, 0, 1}, false},
        {"rows of 0.1: 3 * 0.1f is not a row of 0.3f", {0.1f, 0.2f, 0.3f, 0.3f, 0.6f, 0.9f, 1, 1, 0}, true},
        {"powers of two", {0.1f, 0.2f, 0.3f, 0.2f, 0.4f, 0.6f, 1, 1, 0}, false},
        {"the smallest scale", {tiny, 0, 0, 0, tiny, 0, 0, 0, tiny}, true},
        {"the widest spread", {0x1p127f, 0x1p127f, 0, 0x1p127f, 0x1p127f, tiny, 0, tiny, tiny}, true},
        {"its singular neighbour", {0x1p127f, 0x1p127f, 0, 0x1p127f, 0x1p127f, 0, tiny, tiny, tiny}, false},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_ref_scene *scene = gn_ref_scene_create();
        uint32_t blas;
        assert_true(gn_ref_scene_add_blas(scene, &triangle, 1, &blas));
        struct gn_ref_instance instance = instance_of(blas);
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                instance.transform[4 * r + c] = rows[i].linear[3 * r + c];
        assert_true(gn_ref_scene_add_instance(scene, &instance));
        if (gn_ref_scene_commit(scene) != rows[i].regular)
            fail_msg("%s: \"%s\"", rows[i].why, gn_ref_scene_error(scene));
        gn_ref_scene_destroy(scene);
    }
}

static void order_of_calls_is_checked(void **state)
{
    (void)state;
    struct gn_ref_scene *scene = gn_ref_scene_create();
    struct gn_ref_ray ray = {.origin = {0.25f, 0.25f, 1}, .direction = {0, 0, -1}, .tmax = 2, .cull_mask = 0xFF};
    struct gn_ref_hit hit;
    uint32_t blas;
    assert_true(gn_ref_scene_add_blas(scene, &triangle, 1, &blas));
    struct gn_ref_instance instance = instance_of(blas);
    assert_true(gn_ref_scene_add_instance(scene, &instance));
    assert_int_equal(gn_ref_trace_closest_triangle_exact(scene, &ray, &hit), -1);
    assert_true(gn_ref_scene_commit(scene));
    assert_string_equal(gn_ref_scene_error(scene), "");
    assert_int_equal(gn_ref_trace_closest_triangle_exact(scene, &ray, &hit), 1);
    assert_false(gn_ref_scene_commit(scene));
    assert_false(gn_ref_scene_add_blas(scene, &triangle, 1, &blas));
    assert_false(gn_ref_scene_add_instance(scene, &instance));
    assert_int_equal(gn_ref_trace_closest_triangle_exact(scene, &ray, &hit), 1);
    gn_ref_scene_destroy(scene);
    gn_ref_scene_destroy(NULL);
}

static void empty_scenes_are_scenes(void **state)
{
    (void)state;
    struct gn_ref_ray ray = {.direction = {0, 0, -1}, .tmax = INFINITY, .cull_mask = 0xFF};
    struct gn_ref_hit hit;
    for (int kind = 0; kind < 3; kind++) {
        struct gn_ref_scene *scene = gn_ref_scene_create();
        uint32_t blas;
        assert_true(gn_ref_scene_add_blas(scene, NULL, 0, &blas));
        struct gn_ref_instance instance = instance_of(kind == 1 ? blas : GN_REF_NULL_BLAS);
        instance.transform[0] = kind == 2 ? NAN : 1; /* of an inactive instance */
        if (kind > 0)
            assert_true(gn_ref_scene_add_instance(scene, &instance));
        assert_true(gn_ref_scene_commit(scene));
        assert_int_equal(gn_ref_trace_closest_triangle_exact(scene, &ray, &hit), 0);
        assert_int_equal(gn_ref_trace_all_exact(scene, &ray, &hit, 1), 0);
        gn_ref_scene_destroy(scene);
    }
}

static void what_was_added_is_read_back(void **state)
{
    (void)state;
    struct gn_ref_scene *scene = gn_ref_scene_create();
    const struct gn_ref_geometry both[2] = {triangle, box};
    uint32_t blas;
    assert_true(gn_ref_scene_add_blas(scene, both, 2, &blas));
    struct gn_ref_instance instance = instance_of(blas);
    instance.custom_index = 0xABCDEF;
    assert_true(gn_ref_scene_add_instance(scene, &instance));
    assert_int_equal(gn_ref_scene_instance_count(scene), 1);
    assert_int_equal(gn_ref_scene_instance(scene, 0)->custom_index, 0xABCDEF);
    assert_null(gn_ref_scene_instance(scene, 1));
    assert_int_equal(gn_ref_scene_geometry_count(scene, blas), 2);
    assert_int_equal(gn_ref_scene_geometry_count(scene, blas + 1), 0);
    assert_memory_equal(gn_ref_scene_geometry(scene, blas, 0)->positions, unit_positions, sizeof unit_positions);
    assert_ptr_not_equal(gn_ref_scene_geometry(scene, blas, 0)->positions, unit_positions);
    assert_memory_equal(gn_ref_scene_geometry(scene, blas, 1)->aabbs, unit_box, sizeof unit_box);
    assert_null(gn_ref_scene_geometry(scene, blas, 2));
    gn_ref_scene_destroy(scene);
}

/* Any bit pattern as a float. */
static float any_float(struct rng *rng)
{
    uint32_t bits = (uint32_t)rng_bits(rng);
    if (rng_below(rng, 4))
        bits = (bits & 0x80FFFFFFu) | (0x3F000000u - (rng_below(rng, 8) << 23));
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* Garbage is refused or traced; nothing else. The sanitizers watch. */
static void garbage_does_no_harm(void **state)
{
    (void)state;
    struct rng rng = {99};
    unsigned accepted = 0, traced = 0;
    for (int round = 0; round < 3000; round++) {
        double positions[12][3];
        uint32_t triangles[16][3];
        float boxes[8][6], transform[12];
        for (int i = 0; i < 12; i++)
            for (int j = 0; j < 3; j++) {
                positions[i][j] = rng_below(&rng, 40) ? any_float(&rng) : ldexp(rng_unit(&rng), (int)rng_below(&rng, 2200) - 1100);
                transform[i] = any_float(&rng);
            }
        for (int i = 0; i < 16; i++)
            for (int j = 0; j < 3; j++)
                triangles[i][j] = rng_below(&rng, rng_below(&rng, 1000) ? 12 : 13);
        for (int i = 0; i < 8; i++)
            for (int j = 0; j < 6; j++)
                boxes[i][j] = any_float(&rng);
        struct gn_ref_geometry geometries[2] = {
            {.type = GN_REF_TRIANGLES, .primitive_count = rng_below(&rng, 17), .positions = (const double (*)[3])positions,
             .position_count = 12, .divisor = rng_below(&rng, 2) ? 1 : fabs((double)any_float(&rng)),
             .triangles = (const uint32_t (*)[3])triangles, .transform = rng_below(&rng, 2) ? transform : NULL},
            {.type = GN_REF_AABBS, .primitive_count = rng_below(&rng, 9), .aabbs = (const float (*)[6])boxes},
        };
        struct gn_ref_scene *scene = gn_ref_scene_create();
        uint32_t blas = 0;
        if (gn_ref_scene_add_blas(scene, geometries, 2, &blas))
            for (int i = 0; i < 3; i++) {
                struct gn_ref_instance instance = instance_of(blas);
                for (int j = 0; j < 12; j++)
                    instance.transform[j] = any_float(&rng);
                instance.flags = rng_below(&rng, 4);
                gn_ref_scene_add_instance(scene, &instance);
            }
        bool committed = gn_ref_scene_commit(scene);
        accepted += committed && gn_ref_scene_instance_count(scene) > 0;
        for (int i = 0; i < 20; i++) {
            struct gn_ref_ray ray = {.tmin = any_float(&rng), .tmax = any_float(&rng), .flags = (uint32_t)rng_bits(&rng),
                                     .cull_mask = (uint32_t)rng_bits(&rng)};
            for (int j = 0; j < 3; j++) {
                ray.origin[j] = any_float(&rng);
                ray.direction[j] = any_float(&rng);
            }
            if (rng_below(&rng, 2))
                ray.tmin = 0, ray.tmax = INFINITY;
            struct gn_ref_hit hits[4], closest;
            int64_t count = gn_ref_trace_all_exact(scene, &ray, hits, 4);
            int found = gn_ref_trace_closest_triangle_exact(scene, &ray, &closest);
            assert_true((count < 0) == (found < 0));
            traced += count >= 0;
            if (found > 0 && hits[0].type == GN_REF_TRIANGLES)
                assert_int_equal(hits[0].primitive, closest.primitive);
        }
        gn_ref_scene_destroy(scene);
    }
    assert_true(accepted > 300);
    assert_true(traced > 3000);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(geometry_is_checked),
        cmocka_unit_test(instance_is_checked),
        cmocka_unit_test(singular_instance_is_refused),
        cmocka_unit_test(order_of_calls_is_checked),
        cmocka_unit_test(empty_scenes_are_scenes),
        cmocka_unit_test(what_was_added_is_read_back),
        cmocka_unit_test(garbage_does_no_harm),
    };
    return cmocka_run_group_tests_name("reference.scene", tests, NULL, NULL);
}
