/* SPDX-License-Identifier: Apache-2.0 */
/* Verdicts on answers that are made up: right ones, ones just inside and just outside of the bound, wrong ones. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "reference/verdict.h"

static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
static const struct gn_ref_policy confirm_all = {.confirm_mask = UINT32_MAX};

struct fixture {
    struct gn_ref_scene *scene;
    struct gn_ref_judge *judge;
};

static struct fixture fixture_make(const struct gn_ref_geometry *geometries, uint32_t count,
                                   const struct gn_ref_instance *instance)
{
    struct fixture fixture = {.scene = gn_ref_scene_create()};
    uint32_t blas;
    assert_non_null(fixture.scene);
    assert_true(gn_ref_scene_add_blas(fixture.scene, geometries, count, &blas));
    struct gn_ref_instance placed = {.mask = 0xFF, .custom_index = 0xABCDEF, .sbt_offset = 0x123456, .blas = blas};
    memcpy(placed.transform, identity, sizeof identity);
    if (instance) {
        placed = *instance;
        placed.blas = blas;
    }
    assert_true(gn_ref_scene_add_instance(fixture.scene, &placed));
    assert_true(gn_ref_scene_commit(fixture.scene));
    fixture.judge = gn_ref_judge_create(fixture.scene);
    assert_non_null(fixture.judge);
    return fixture;
}

static void fixture_finish(struct fixture *fixture)
{
    gn_ref_judge_destroy(fixture->judge);
    gn_ref_scene_destroy(fixture->scene);
}

/* A hexagon around the origin, six triangles that share the middle; counter-clockwise seen from +z. */
static double hexagon[7][3] = {{0, 0, 0},  {2, 0, 0},   {1, 2, 0}, {-1, 2, 0},
                               {-2, 0, 0}, {-1, -2, 0}, {1, -2, 0}};
static const uint32_t hexagon_triangles[6][3] = {{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 5}, {0, 5, 6}, {0, 6, 1}};

static struct gn_ref_geometry hexagon_geometry(double (*positions)[3], uint32_t triangle_count)
{
    return (struct gn_ref_geometry){.type = GN_REF_TRIANGLES,
                                    .flags = GN_REF_GEOMETRY_OPAQUE,
                                    .primitive_count = triangle_count,
                                    .positions = (const double(*)[3])positions,
                                    .position_count = 7,
                                    .divisor = 1,
                                    .triangles = hexagon_triangles};
}

static struct gn_ref_ray ray_down(float x, float y)
{
    return (struct gn_ref_ray){
        .origin = {x, y, 4}, .direction = {0, 0, -1}, .tmin = 0, .tmax = 100, .cull_mask = 0xFF};
}

static struct gn_ref_answer hit_answer(uint32_t primitive, float t, float b, float c)
{
    return (struct gn_ref_answer){.kind = GN_REF_ANSWER_TRIANGLE,
                                  .primitive = primitive,
                                  .custom_index = 0xABCDEF,
                                  .sbt_offset = 0x123456,
                                  .front = 1,
                                  .t = t,
                                  .barycentrics = {b, c}};
}

static const struct gn_ref_answer miss = {.kind = GN_REF_ANSWER_NONE};

static void expect(const char *what, const struct fixture *fixture, const struct gn_ref_ray *ray,
                   const struct gn_ref_policy *policy, const struct gn_ref_answer *answer,
                   enum gn_ref_verdict_class cls)
{
    struct gn_ref_verdict verdict;
    assert_true(gn_ref_judge_committed(fixture->judge, ray, policy, answer, &verdict));
    if (verdict.cls != cls)
        fail_msg("%s: expected %s, found %s (%s)", what, gn_ref_verdict_class_name(cls),
                 gn_ref_verdict_class_name(verdict.cls), verdict.reason);
    assert_true((verdict.reason[0] == 0) == (cls == GN_REF_EXACT));
}

/* The point (1, 1/2) lies inside of triangle 0 with weights 3/8, 3/8 (corner 1) and 1/4 (corner 2). */
static void test_numbers_and_facts(void **state)
{
    (void)state;
    struct gn_ref_geometry geometry = hexagon_geometry(hexagon, 6);
    struct fixture fixture = fixture_make(&geometry, 1, NULL);
    struct gn_ref_ray ray = ray_down(1.0f, 0.5f);
    const float u = 0x1p-24f, k = (float)gn_ref_verdict_bound();
    struct gn_ref_answer right = hit_answer(0, 4, 0.375f, 0.25f);
    struct {
        const char *what;
        struct gn_ref_answer answer;
        enum gn_ref_verdict_class cls;
    } rows[] = {
        {"the ideal answer", right, GN_REF_EXACT},
        {"t just inside of the bound", hit_answer(0, 4 + 4 * 0.9f * 2 * k * u, 0.375f, 0.25f), GN_REF_EXACT},
        {"t outside of the bound", hit_answer(0, 4 + 4 * 3 * 2 * k * u, 0.375f, 0.25f), GN_REF_WRONG},
        {"a barycentric outside of the bound", hit_answer(0, 4, 0.375f + 12 * k * u, 0.25f), GN_REF_WRONG},
        {"barycentrics swapped", hit_answer(0, 4, 0.25f, 0.375f), GN_REF_WRONG},
        {"t is NaN", hit_answer(0, NAN, 0.375f, 0.25f), GN_REF_WRONG},
        {"a barycentric is infinite", hit_answer(0, 4, INFINITY, 0.25f), GN_REF_WRONG},
        {"a triangle that is far away", hit_answer(3, 4, 0.375f, 0.25f), GN_REF_WRONG},
        {"the neighbour, far from the edge", hit_answer(1, 4, 0.375f, 0.25f), GN_REF_WRONG},
        {"a primitive that does not exist", hit_answer(6, 4, 0.375f, 0.25f), GN_REF_WRONG},
        {"a miss", miss, GN_REF_WRONG},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        expect(rows[i].what, &fixture, &ray, &confirm_all, &rows[i].answer, rows[i].cls);

    /* Every fact that is copied has no tolerance. */
    struct gn_ref_answer answer = right;
    answer.custom_index ^= 1;
    expect("custom index off by one bit", &fixture, &ray, &confirm_all, &answer, GN_REF_WRONG);
    answer = right;
    answer.sbt_offset ^= 0x800000;
    expect("SBT offset off by its top bit", &fixture, &ray, &confirm_all, &answer, GN_REF_WRONG);
    answer = right;
    answer.instance = 1;
    expect("an instance that does not exist", &fixture, &ray, &confirm_all, &answer, GN_REF_WRONG);
    answer = right;
    answer.geometry = 1;
    expect("a geometry that does not exist", &fixture, &ray, &confirm_all, &answer, GN_REF_WRONG);
    answer = right;
    answer.front = 0;
    expect("the wrong face", &fixture, &ray, &confirm_all, &answer, GN_REF_WRONG);
    answer = right;
    answer.kind = GN_REF_ANSWER_GENERATED;
    expect("a generated hit on a triangle", &fixture, &ray, &confirm_all, &answer, GN_REF_WRONG);

    /* Flags that make the hit inadmissible, and the miss right. */
    struct {
        const char *what;
        uint32_t flags, mask;
        float tmin, tmax;
    } flags[] = {
        {"mask", 0, 0, 0, 100},
        {"skip triangles", GN_REF_RAY_SKIP_TRIANGLES, 0xFF, 0, 100},
        {"cull opaque", GN_REF_RAY_CULL_OPAQUE, 0xFF, 0, 100},
        {"cull front facing", GN_REF_RAY_CULL_FRONT_FACING, 0xFF, 0, 100},
        {"tmax before it", 0, 0xFF, 0, 3.5f},
        {"tmin behind it", 0, 0xFF, 4.5f, 100},
    };
    for (size_t i = 0; i < sizeof flags / sizeof flags[0]; i++) {
        struct gn_ref_ray limited = ray;
        limited.flags = flags[i].flags;
        limited.cull_mask = flags[i].mask;
        limited.tmin = flags[i].tmin;
        limited.tmax = flags[i].tmax;
        expect(flags[i].what, &fixture, &limited, &confirm_all, &right, GN_REF_WRONG);
        expect(flags[i].what, &fixture, &limited, &confirm_all, &miss, GN_REF_EXACT);
    }
    /* Exactly at an end of the range the ideal answer is a miss; a hit there is within the bound. */
    struct gn_ref_ray open = ray;
    open.tmax = 4;
    expect("tmax exactly at the hit, missed", &fixture, &open, &confirm_all, &miss, GN_REF_EXACT);
    expect("tmax exactly at the hit, hit", &fixture, &open, &confirm_all, &right, GN_REF_ADMISSIBLE);
    fixture_finish(&fixture);
}

static void test_shared_edges_and_vertices(void **state)
{
    (void)state;
    struct gn_ref_geometry closed = hexagon_geometry(hexagon, 6), open = hexagon_geometry(hexagon, 5);
    struct fixture fan = fixture_make(&closed, 1, NULL), gap = fixture_make(&open, 1, NULL);
    struct gn_ref_ray vertex = ray_down(0, 0), edge = ray_down(0.5f, 1), border = ray_down(1.5f, 1);
    struct gn_ref_answer left = hit_answer(1, 4, 0.5f, 0), right = hit_answer(0, 4, 0, 0.5f);
    struct gn_ref_answer middle = hit_answer(3, 4, 0, 0);
    expect("vertex of a closed fan missed", &fan, &vertex, &confirm_all, &miss, GN_REF_LEAK);
    expect("vertex of a closed fan hit", &fan, &vertex, &confirm_all, &middle, GN_REF_EXACT);
    expect("vertex of an open fan missed", &gap, &vertex, &confirm_all, &miss, GN_REF_GAP);
    expect("shared edge missed", &fan, &edge, &confirm_all, &miss, GN_REF_LEAK);
    expect("shared edge, one side", &fan, &edge, &confirm_all, &left, GN_REF_EXACT);
    expect("shared edge, other side", &fan, &edge, &confirm_all, &right, GN_REF_EXACT);
    expect("border missed", &fan, &border, &confirm_all, &miss, GN_REF_GAP);

    /* The range ends inside of the neighbourhood: a moved ray may be out of range. */
    struct gn_ref_ray ends = edge;
    ends.tmax = nextafterf(4, 5);
    expect("shared edge missed at the end of the range", &fan, &ends, &confirm_all, &miss, GN_REF_GAP);

    /* Just off the edge: the neighbour is admissible, further off it is wrong. */
    struct gn_ref_ray near = ray_down(nextafterf(0.5f, 1), 1);
    struct gn_ref_answer neighbour = hit_answer(1, 4, 0.5f, 0);
    expect("the neighbour, one ulp off the edge", &fan, &near, &confirm_all, &neighbour, GN_REF_ADMISSIBLE);
    near.origin[0] = 0.501f;
    expect("the neighbour, 1e-3 off the edge", &fan, &near, &confirm_all, &neighbour, GN_REF_WRONG);
    fixture_finish(&fan);
    fixture_finish(&gap);

    /* One triangle of the fan wound the other way: no shared edges in the sense of the specification. */
    uint32_t mixed[6][3];
    memcpy(mixed, hexagon_triangles, sizeof mixed);
    mixed[0][1] = 2;
    mixed[0][2] = 1;
    struct gn_ref_geometry wound = closed;
    wound.triangles = (const uint32_t(*)[3])mixed;
    struct fixture mixed_fan = fixture_make(&wound, 1, NULL);
    expect("mixed winding missed", &mixed_fan, &edge, &confirm_all, &miss, GN_REF_GAP);
    fixture_finish(&mixed_fan);
}

static void test_silhouettes(void **state)
{
    (void)state;
    /* The middle raised to a spike: seen from the side, its tip is a silhouette; from above it is not. */
    double spike[7][3];
    memcpy(spike, hexagon, sizeof spike);
    spike[0][2] = 2;
    struct gn_ref_geometry geometry = hexagon_geometry(spike, 6);
    struct fixture fixture = fixture_make(&geometry, 1, NULL);
    struct gn_ref_ray side = {.origin = {-4, 0.25f, 2}, .direction = {1, -0.0625f, 0}, .tmax = 100, .cull_mask = 0xFF};
    struct gn_ref_ray above = ray_down(0, 0);
    struct gn_ref_verdict verdict;
    assert_true(gn_ref_judge_committed(fixture.judge, &side, &confirm_all, &miss, &verdict));
    assert_true(verdict.ideal_hit);
    assert_int_equal(verdict.cls, GN_REF_GAP);
    expect("tip of a spike from above, missed", &fixture, &above, &confirm_all, &miss, GN_REF_LEAK);
    fixture_finish(&fixture);
}

static void test_nearest(void **state)
{
    (void)state;
    /* Two sheets: losing the near one is wrong, a z-fight is not. */
    double far[7][3], close[7][3];
    memcpy(far, hexagon, sizeof far);
    memcpy(close, hexagon, sizeof close);
    for (int i = 0; i < 7; i++) {
        far[i][2] = -1;
        close[i][2] = 0x1p-22;
    }
    struct gn_ref_geometry geometries[2] = {hexagon_geometry(hexagon, 6), hexagon_geometry(far, 6)};
    struct fixture fixture = fixture_make(geometries, 2, NULL);
    struct gn_ref_ray ray = ray_down(1.0f, 0.5f);
    struct gn_ref_answer behind = hit_answer(0, 5, 0.375f, 0.25f);
    behind.geometry = 1;
    expect("the sheet behind", &fixture, &ray, &confirm_all, &behind, GN_REF_WRONG);
    ray.flags = GN_REF_RAY_TERMINATE_ON_FIRST_HIT;
    expect("any hit will do", &fixture, &ray, &confirm_all, &behind, GN_REF_EXACT);
    expect("but a miss will not", &fixture, &ray, &confirm_all, &miss, GN_REF_WRONG);
    fixture_finish(&fixture);

    geometries[1] = hexagon_geometry(close, 6);
    fixture = fixture_make(geometries, 2, NULL);
    ray.flags = 0;
    struct gn_ref_answer fighting = hit_answer(0, 4, 0.375f, 0.25f);
    expect("a z-fight", &fixture, &ray, &confirm_all, &fighting, GN_REF_ADMISSIBLE);
    fixture_finish(&fixture);
}

static void test_policy_and_boxes(void **state)
{
    (void)state;
    float boxes[3][6] = {{-1, -1, 0, 1, 1, 1}, {-1, -1, -3, 1, 1, -2}, {5, 5, 5, 6, 6, 6}};
    boxes[2][0] = NAN;
    struct gn_ref_geometry geometry = {
        .type = GN_REF_AABBS, .flags = GN_REF_GEOMETRY_NO_DUPLICATE, .primitive_count = 3, .divisor = 1,
        .aabbs = (const float(*)[6])boxes};
    struct fixture fixture = fixture_make(&geometry, 1, NULL);
    struct gn_ref_ray ray = ray_down(0.5f, 0.5f), outside = ray_down(1.5f, 0);
    struct gn_ref_policy both = {.generate_mask = 3, .generate_t0 = 4, .generate_step = 2};
    struct gn_ref_policy second = {.generate_mask = 2, .generate_t0 = 4, .generate_step = 2};
    struct gn_ref_answer answer = hit_answer(0, 4, 0, 0);
    answer.kind = GN_REF_ANSWER_GENERATED;
    expect("the nearer box", &fixture, &ray, &both, &answer, GN_REF_EXACT);
    expect("a box for which nothing was generated", &fixture, &ray, &second, &answer, GN_REF_WRONG);
    expect("a box that the ray misses", &fixture, &outside, &both, &answer, GN_REF_ADMISSIBLE);
    expect("a box lost", &fixture, &ray, &both, &miss, GN_REF_WRONG);
    answer.t = nextafterf(4, 5);
    expect("another t than generated", &fixture, &ray, &both, &answer, GN_REF_WRONG);
    answer.t = 6;
    answer.primitive = 1;
    expect("the farther box", &fixture, &ray, &both, &answer, GN_REF_WRONG);
    expect("the farther box, when only it generates", &fixture, &ray, &second, &answer, GN_REF_EXACT);
    struct gn_ref_ray ends = ray;
    struct gn_ref_policy inside = {.generate_mask = 2, .generate_t0 = 4.5f, .generate_step = 2};
    ends.tmax = 6.5f;
    expect("the hit at tmax dropped", &fixture, &ends, &inside, &miss, GN_REF_GAP);
    ends.tmax = nextafterf(6.5f, 7);
    expect("the hit before tmax dropped", &fixture, &ends, &inside, &miss, GN_REF_WRONG);
    struct gn_ref_answer boxes_twice[3] = {answer, answer, answer};
    struct gn_ref_verdict listed;
    boxes_twice[2].primitive = 0;
    assert_true(gn_ref_judge_candidates(fixture.judge, &ray, boxes_twice, 3, &miss, &listed));
    assert_int_equal(listed.cls, GN_REF_EXACT); /* an AABB may be presented repeatedly */
    boxes_twice[1].primitive = 2;
    assert_true(gn_ref_judge_candidates(fixture.judge, &ray, boxes_twice, 3, &miss, &listed));
    assert_int_equal(listed.cls, GN_REF_WRONG); /* but an inactive one never */
    boxes_twice[1] = boxes_twice[0];
    boxes_twice[1].kind = 77;
    assert_true(gn_ref_judge_candidates(fixture.judge, &ray, boxes_twice, 3, &miss, &listed));
    assert_int_equal(listed.cls, GN_REF_WRONG); /* nor something that is no type at all */
    expect("a committed hit of no type", &fixture, &ray, &both, &boxes_twice[1], GN_REF_WRONG);
    answer.primitive = 2;
    answer.t = 8;
    both.generate_mask = 7;
    expect("an inactive box", &fixture, &outside, &both, &answer, GN_REF_WRONG);
    fixture_finish(&fixture);

    /* Not opaque: what is confirmed counts. */
    struct gn_ref_geometry triangles = hexagon_geometry(hexagon, 6);
    triangles.flags = 0;
    fixture = fixture_make(&triangles, 1, NULL);
    ray = ray_down(1.0f, 0.5f);
    struct gn_ref_policy none = {0}, first = {.confirm_mask = 1};
    struct gn_ref_answer hit = hit_answer(0, 4, 0.375f, 0.25f);
    expect("confirmed", &fixture, &ray, &first, &hit, GN_REF_EXACT);
    expect("not confirmed, yet committed", &fixture, &ray, &none, &hit, GN_REF_WRONG);
    expect("not confirmed", &fixture, &ray, &none, &miss, GN_REF_EXACT);
    fixture_finish(&fixture);
}

static void test_candidates(void **state)
{
    (void)state;
    struct gn_ref_geometry geometry = hexagon_geometry(hexagon, 6);
    geometry.flags = GN_REF_GEOMETRY_NO_DUPLICATE;
    struct fixture fixture = fixture_make(&geometry, 1, NULL);
    struct gn_ref_ray inside = ray_down(1.0f, 0.5f), edge = ray_down(0.5f, 1);
    struct gn_ref_answer hit = hit_answer(0, 4, 0.375f, 0.25f);
    struct gn_ref_answer left = hit_answer(1, 4, 0.5f, 0), right = hit_answer(0, 4, 0, 0.5f);
    struct gn_ref_answer twice[2] = {hit, hit}, both[2] = {left, right}, stray[2] = {hit, hit_answer(3, 4, 0, 0)};
    struct {
        const char *what;
        const struct gn_ref_ray *ray;
        const struct gn_ref_answer *list;
        size_t count;
        enum gn_ref_verdict_class cls;
    } rows[] = {
        {"the candidate", &inside, &hit, 1, GN_REF_EXACT},
        {"no candidate", &inside, &hit, 0, GN_REF_WRONG},
        {"a stray one besides", &inside, stray, 2, GN_REF_WRONG},
        {"twice the same", &inside, twice, 2, GN_REF_WRONG},
        {"one side of a shared edge", &edge, &left, 1, GN_REF_ADMISSIBLE},
        {"both sides of a shared edge", &edge, both, 2, GN_REF_DOUBLE_HIT},
        {"neither side of a shared edge", &edge, &left, 0, GN_REF_LEAK},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_ref_verdict verdict;
        assert_true(
            gn_ref_judge_candidates(fixture.judge, rows[i].ray, rows[i].list, rows[i].count, &miss, &verdict));
        if (verdict.cls != rows[i].cls)
            fail_msg("%s: expected %s, found %s (%s)", rows[i].what, gn_ref_verdict_class_name(rows[i].cls),
                     gn_ref_verdict_class_name(verdict.cls), verdict.reason);
    }
    fixture_finish(&fixture);
}

/* What is never hit, although the ray passes through all of its corners' neighbourhood: no bound excuses it. */
static void test_what_is_never_hit(void **state)
{
    (void)state;
    static const double positions[4][3] = {{0, 0, 0}, {2, 0, 0}, {0, 2, 0}, {NAN, 0, 0}};
    static const uint32_t triangles[4][3] = {{0, 1, 1}, {3, 1, 2}, {0, 3, 2}, {2, 1, 2}};
    struct gn_ref_geometry geometry = {.flags = GN_REF_GEOMETRY_OPAQUE, .primitive_count = 4, .positions = positions,
                                       .position_count = 4, .divisor = 1, .triangles = triangles};
    struct fixture fixture = fixture_make(&geometry, 1, NULL);
    struct gn_ref_ray ray = ray_down(1, 0);
    for (uint32_t primitive = 0; primitive < 4; primitive++) {
        struct gn_ref_answer answer = hit_answer(primitive, 4, 0.5f, 0);
        expect(primitive % 3 ? "an inactive triangle" : "a degenerate triangle", &fixture, &ray, &confirm_all, &answer,
               GN_REF_WRONG);
    }
    expect("nothing", &fixture, &ray, &confirm_all, &miss, GN_REF_EXACT);
    fixture_finish(&fixture);
}

/* Sizes grow with the conditioning of the transform, and facing stays with the object. */
static void test_transforms(void **state)
{
    (void)state;
    struct gn_ref_geometry geometry = hexagon_geometry(hexagon, 6);
    struct gn_ref_instance mirrored = {.transform = {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                                       .mask = 0xFF, .custom_index = 0xABCDEF, .sbt_offset = 0x123456};
    struct fixture fixture = fixture_make(&geometry, 1, &mirrored);
    struct gn_ref_ray ray = ray_down(-1.0f, 0.5f);
    struct gn_ref_answer hit = hit_answer(0, 4, 0.375f, 0.25f);
    expect("a mirrored instance keeps the facing", &fixture, &ray, &confirm_all, &hit, GN_REF_EXACT);
    fixture_finish(&fixture);

    static const float mirror[12] = {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    geometry.transform = mirror;
    fixture = fixture_make(&geometry, 1, NULL);
    hit.front = 0;
    expect("a mirrored geometry transform flips it", &fixture, &ray, &confirm_all, &hit, GN_REF_EXACT);
    hit.front = 1;
    expect("and the other face is wrong", &fixture, &ray, &confirm_all, &hit, GN_REF_WRONG);
    fixture_finish(&fixture);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_numbers_and_facts), cmocka_unit_test(test_shared_edges_and_vertices),
        cmocka_unit_test(test_silhouettes),       cmocka_unit_test(test_nearest),
        cmocka_unit_test(test_policy_and_boxes),  cmocka_unit_test(test_candidates),
        cmocka_unit_test(test_transforms),        cmocka_unit_test(test_what_is_never_hit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
