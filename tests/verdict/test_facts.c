/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Fact by fact: an answer in which nothing is wrong, and the same with one thing changed. What is copied has no tolerance: one
 * bit, or the next f32, is wrong. A number is right up to the last f32 within its bound, and wrong from the next one on, in
 * either direction; bound and sizes are computed here once more, from docs/numerics.md.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "cts/case.h"
#include "cts/generate.h"
#include "reference/tracer.h"

#define UNIT 0x1p-24L
#define BOUND 24

static const struct gn_case nobody = {.name = "facts"};
static const double far_apart[6][3] = {{-1, -1, 0}, {2, -1, 0.5}, {0, 2, 1}, {30, 0, 0}, {31, 0, 0}, {30, 1, 0}};
static const double plain[3][3] = {{9.1, -1, 0}, {12, -1.3, 0.5}, {10, 2, 1.7}};
static const uint32_t corners[2][3] = {{0, 1, 2}, {3, 4, 5}};
static const float moved[12] = {0.9f, 0.3f, 0, 0.7f, -0.3f, 0.9f, 0.1f, -0.2f, 0.1f, 0, 1.1f, 0.4f};
static const float placed[12] = {1.6f, -1.2f, 0.1f, 5.3f, 1.1f, 1.7f, -0.2f, -2.1f, 0, 0.3f, 2.2f, 1.4f};
static const float box[1][6] = {{-40, -40, -12, 40, 40, -11}};

/* One ray, and all that could be said of it. */
struct fixture {
    struct gn_case_run run;
    struct gn_cts_scene scene;
    struct gn_cts_ray ray;
    struct gn_ref_answer committed;
    struct gn_cts_candidates candidates;
    struct gn_cts_detail detail;
    float positions[9];
    struct gn_ref_hit_detail exact;
};

static void at(double out[3], const float m[12], const double point[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = (double)m[4 * i] * point[0] + (double)m[4 * i + 1] * point[1] + (double)m[4 * i + 2] * point[2] + (double)m[4 * i + 3];
}

static struct gn_ref_answer answer_of(const struct gn_ref_record *record)
{
    bool triangle = record->hit.type == GN_REF_TRIANGLES;
    return (struct gn_ref_answer){
        .kind = triangle ? GN_REF_ANSWER_TRIANGLE : GN_REF_ANSWER_GENERATED,
        .instance = record->hit.instance,
        .geometry = record->hit.geometry,
        .primitive = record->hit.primitive,
        .custom_index = record->custom_index,
        .sbt_offset = record->sbt_offset,
        .front = record->hit.front,
        .t = triangle ? (float)record->hit.t : 0,
        .barycentrics = {(float)record->hit.beta, (float)record->hit.gamma},
    };
}

/* A ray through the middle of the first triangle of a geometry: 1, which has a transform, or 2, which has none. */
static void fixture_make(struct fixture *f, uint32_t geometry, uint32_t flags)
{
    memset(f, 0, sizeof *f);
    gn_case_run_begin(&nobody, NULL, 1, 1, &f->run);
    struct gn_cts_geometry *geometries = GN_NEW(&f->run.arena, struct gn_cts_geometry, 3);
    geometries[0] = (struct gn_cts_geometry){.type = GN_REF_AABBS, .flags = flags, .aabbs = box, .aabb_count = 1};
    geometries[1] = (struct gn_cts_geometry){.flags = flags, .positions = far_apart, .position_count = 6, .triangles = corners,
                                             .triangle_count = 2, .transform = moved};
    geometries[2] = (struct gn_cts_geometry){.flags = flags, .positions = plain, .position_count = 3, .triangles = corners,
                                             .triangle_count = 1};
    struct gn_cts_instance instances[2] = {gn_instance_of(GN_CTS_NO_BLAS, NULL), gn_instance_of(0, placed)};
    instances[1].custom_index = 0xABCDEF;
    instances[1].sbt_offset = 0x123456;
    f->scene = gn_scene_of_geometries(&f->run.arena, geometries, 3, instances, 2);

    static const double weights[3] = {0.4, 0.35, 0.25};
    double target[3] = {0}, world[3], direction[3], origin[3];
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < 3; i++)
            target[i] += weights[c] * (geometry == 1 ? far_apart : plain)[c][i];
    if (geometry == 1) {
        at(world, moved, target);
        memcpy(target, world, sizeof target);
    }
    at(world, placed, target);
    for (int i = 0; i < 3; i++) {
        direction[i] = (const double[3]){0.3, -0.2, -1}[i];
        origin[i] = world[i] - 4 * direction[i];
    }
    f->ray = gn_ray_make(origin, direction, 100);
    f->ray.ray.tmin = 0.25f;

    char error[320];
    struct gn_ref_record records[4];
    struct gn_ref_scene *reference = gn_case_reference(&f->run, &f->scene);
    assert_non_null(reference);
    struct gn_ref_tracer *tracer = gn_ref_tracer_create(reference, GN_REF_TIER_EXACT, error, sizeof error);
    assert_non_null(tracer);
    int64_t count = gn_ref_tracer_all(tracer, &f->ray.ray, records, 4);
    assert_int_equal(count, 2); /* that triangle, and the box behind it */
    assert_int_equal(records[0].hit.geometry, geometry);
    f->committed = answer_of(&records[0]);
    f->candidates.count = (uint32_t)count;
    for (int64_t i = 0; i < count; i++)
        f->candidates.list[i] = answer_of(&records[i]);
    assert_true(gn_ref_hit_detail_exact(reference, &f->ray.ray, &records[0].hit, &f->exact));
    memcpy(f->detail.world_from_object, placed, sizeof placed);
    for (int i = 0; i < 12; i++)
        f->detail.object_from_world[i] = (float)f->exact.object_from_world[i];
    for (int i = 0; i < 3; i++) {
        f->detail.object_origin[i] = (float)f->exact.object_origin[i];
        f->detail.object_direction[i] = (float)f->exact.object_direction[i];
    }
    for (int i = 0; i < 9; i++)
        f->positions[i] = (float)f->exact.object_vertices[i / 3][i % 3];
    memcpy(f->detail.world_origin, f->ray.ray.origin, sizeof f->detail.world_origin);
    memcpy(f->detail.world_direction, f->ray.ray.direction, sizeof f->detail.world_direction);
    f->detail.tmin = f->ray.ray.tmin;
    f->detail.flags = f->ray.ray.flags;
    gn_ref_tracer_destroy(tracer);
    gn_ref_scene_destroy(reference);
}

static enum gn_ref_verdict_class judged(struct fixture *f, enum gn_cts_program program)
{
    struct gn_case_run run;
    struct gn_cts_answers answers = {.committed = &f->committed, .candidates = &f->candidates, .details = &f->detail,
                                     .positions = &f->positions};
    struct gn_ref_answer none = {.kind = GN_REF_ANSWER_NONE};
    int cls = 0;
    if (program == GN_CTS_CANDIDATES)
        answers.committed = &none;
    gn_case_run_begin(&nobody, NULL, 1, 1, &run);
    gn_case_judge(&run, &f->scene, program, &f->ray, 1, 0, &answers);
    while (cls < GN_REF_VERDICT_CLASS_COUNT && !run.result.class_counts[cls])
        cls++;
    gn_case_run_end(&run);
    gn_case_run_finish(&run);
    return (enum gn_ref_verdict_class)cls;
}

static void expect(struct fixture *f, enum gn_cts_program program, enum gn_ref_verdict_class cls, const char *what, int which)
{
    enum gn_ref_verdict_class found = judged(f, program);
    if (found != cls)
        fail_msg("%s, variation %d: expected %s, found %s", what, which, gn_ref_verdict_class_name(cls),
                 gn_ref_verdict_class_name(found));
}

/* Each of the bits, turned over, is wrong. */
static void bits_matter(struct fixture *f, enum gn_cts_program program, uint32_t *field, uint32_t bits, const char *what)
{
    for (int bit = 0; bit < 32; bit++) {
        if (!(bits >> bit & 1))
            continue;
        *field ^= UINT32_C(1) << bit;
        expect(f, program, GN_REF_WRONG, what, bit);
        *field ^= UINT32_C(1) << bit;
    }
}

/* Either neighbour of each of the numbers is wrong. */
static void neighbours_are_wrong(struct fixture *f, enum gn_cts_program program, float *values, int count, const char *what)
{
    for (int i = 0; i < 2 * count; i++) {
        float kept = values[i / 2];
        values[i / 2] = nextafterf(kept, i & 1 ? INFINITY : -INFINITY);
        expect(f, program, GN_REF_WRONG, what, i);
        values[i / 2] = kept;
    }
}

static void answer_matters(struct fixture *f, enum gn_cts_program program, struct gn_ref_answer *answer)
{
    enum gn_ref_answer_kind kind = answer->kind;
    bits_matter(f, program, &answer->instance, UINT32_MAX, "the instance");
    bits_matter(f, program, &answer->geometry, UINT32_MAX, "the geometry");
    bits_matter(f, program, &answer->primitive, UINT32_MAX, "the primitive");
    bits_matter(f, program, &answer->custom_index, UINT32_MAX, "the custom index");
    bits_matter(f, program, &answer->sbt_offset, UINT32_MAX, "the SBT offset");
    if (kind == GN_REF_ANSWER_TRIANGLE)
        bits_matter(f, program, &answer->front, 1, "the face");
    for (int other = 0; other < 4; other++) {
        answer->kind = (enum gn_ref_answer_kind)(other == 3 ? 77 : other);
        if (answer->kind != kind)
            expect(f, program, GN_REF_WRONG, "the type of what was hit", other);
    }
    answer->kind = kind;
}

static void test_committed(void **state)
{
    (void)state;
    struct fixture f;
    for (uint32_t geometry = 1; geometry <= 2; geometry++) {
        fixture_make(&f, geometry, GN_REF_GEOMETRY_OPAQUE);
        expect(&f, GN_CTS_COMMITTED, GN_REF_EXACT, "the right answer", (int)geometry);
        answer_matters(&f, GN_CTS_COMMITTED, &f.committed);
        /* Outside of the ray's range, by one f32, whatever the bound. */
        float kept = f.ray.ray.tmax;
        f.ray.ray.tmax = nextafterf(f.committed.t, 0);
        expect(&f, GN_CTS_COMMITTED, GN_REF_WRONG, "t beyond tmax", 0);
        f.ray.ray.tmax = kept;
        kept = f.ray.ray.tmin;
        f.ray.ray.tmin = nextafterf(f.committed.t, 100);
        expect(&f, GN_CTS_COMMITTED, GN_REF_WRONG, "t before tmin", 0);
        f.ray.ray.tmin = kept;
        gn_case_run_finish(&f.run);
    }
}

static void test_generated(void **state)
{
    (void)state;
    struct fixture f;
    fixture_make(&f, 1, GN_REF_GEOMETRY_NO_DUPLICATE);
    /* Only the box counts: the triangle is not confirmed. */
    f.ray.policy = (struct gn_ref_policy){.generate_mask = 1, .generate_t0 = 7.5f};
    f.committed = f.candidates.list[1];
    assert_int_equal(f.committed.kind, GN_REF_ANSWER_GENERATED);
    f.committed.t = 7.5f;
    expect(&f, GN_CTS_COMMITTED, GN_REF_EXACT, "the generated hit", 0);
    answer_matters(&f, GN_CTS_COMMITTED, &f.committed);
    neighbours_are_wrong(&f, GN_CTS_COMMITTED, &f.committed.t, 1, "the generated t");
    f.ray.policy.generate_mask = 0;
    expect(&f, GN_CTS_COMMITTED, GN_REF_WRONG, "a hit that was not generated", 0);
    gn_case_run_finish(&f.run);
}

static void test_candidates(void **state)
{
    (void)state;
    struct fixture f;
    fixture_make(&f, 1, GN_REF_GEOMETRY_NO_DUPLICATE);
    struct gn_ref_answer triangle = f.candidates.list[0], generated = f.candidates.list[1];
    expect(&f, GN_CTS_CANDIDATES, GN_REF_EXACT, "the right list", 0);
    answer_matters(&f, GN_CTS_CANDIDATES, &f.candidates.list[0]);
    answer_matters(&f, GN_CTS_CANDIDATES, &f.candidates.list[1]);
    f.candidates.list[0] = generated;
    f.candidates.list[1] = triangle;
    expect(&f, GN_CTS_CANDIDATES, GN_REF_EXACT, "in another order", 0);
    f.candidates.count = 1;
    expect(&f, GN_CTS_CANDIDATES, GN_REF_WRONG, "the triangle lost", 0);
    f.candidates.list[0] = triangle;
    expect(&f, GN_CTS_CANDIDATES, GN_REF_WRONG, "the box lost", 0);
    f.candidates.count = 3;
    f.candidates.list[1] = f.candidates.list[2] = generated;
    expect(&f, GN_CTS_CANDIDATES, GN_REF_EXACT, "the box twice", 0);
    f.candidates.list[2] = triangle;
    expect(&f, GN_CTS_CANDIDATES, GN_REF_WRONG, "the triangle twice where that is excluded", 0);
    gn_case_run_finish(&f.run);
    /* Opaque triangles are committed, not presented. */
    fixture_make(&f, 1, GN_REF_GEOMETRY_OPAQUE);
    f.candidates.count = 2;
    expect(&f, GN_CTS_CANDIDATES, GN_REF_WRONG, "an opaque triangle presented", 0);
    gn_case_run_finish(&f.run);
}

static void test_details_copied(void **state)
{
    (void)state;
    struct fixture f;
    fixture_make(&f, 1, GN_REF_GEOMETRY_OPAQUE);
    expect(&f, GN_CTS_DETAIL, GN_REF_EXACT, "the right details", 0);
    neighbours_are_wrong(&f, GN_CTS_DETAIL, f.detail.world_from_object, 12, "the instance's matrix");
    neighbours_are_wrong(&f, GN_CTS_DETAIL, f.detail.world_origin, 3, "the ray's origin");
    neighbours_are_wrong(&f, GN_CTS_DETAIL, f.detail.world_direction, 3, "the ray's direction");
    neighbours_are_wrong(&f, GN_CTS_DETAIL, &f.detail.tmin, 1, "tmin");
    bits_matter(&f, GN_CTS_DETAIL, &f.detail.flags, UINT32_MAX, "the ray's flags");
    gn_case_run_finish(&f.run);
    fixture_make(&f, 2, GN_REF_GEOMETRY_OPAQUE);
    expect(&f, GN_CTS_POSITIONS, GN_REF_EXACT, "the right positions", 0);
    neighbours_are_wrong(&f, GN_CTS_POSITIONS, f.positions, 9, "positions without a transform");
    gn_case_run_finish(&f.run);
}

/*
 * Moves one number of an answer away from where it is, in either direction, as far as `error` (of a value for it) allows: the last one
 * within the bound is right, the next one wrong.
 */
static void bound_matters(struct fixture *f, enum gn_cts_program program, float *value,
                          long double (*error)(const struct fixture *f, int which, float value), int which, double bound,
                          const char *what)
{
    float kept = *value;
    for (int up = 0; up < 2; up++) {
        float inside = kept, outside = kept;
        int steps = 0;
        while (error(f, which, outside) <= bound) {
            inside = outside;
            outside = nextafterf(inside, up ? INFINITY : -INFINITY);
            assert_true(++steps < 1000000);
        }
        assert_true(steps > 1); /* the number itself is within */
        *value = inside;
        expect(f, program, GN_REF_EXACT, what, 2 * which + up);
        *value = outside;
        expect(f, program, GN_REF_WRONG, what, 2 * which + up);
    }
    *value = kept;
}

/* K = |M^-1||M||M^-1| times a vector of magnitudes, row i. */
static long double conditioned(const struct fixture *f, int i, const long double vector[3])
{
    long double sum = 0;
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            for (int c = 0; c < 3; c++)
                sum += fabsl((long double)f->exact.object_from_world[4 * i + a]) * fabsl((long double)placed[4 * a + b]) *
                       fabsl((long double)f->exact.object_from_world[4 * b + c]) * vector[c];
    return sum + 0x1p-102L;
}

static long double origin_size(const struct fixture *f, int i)
{
    long double vector[3];
    for (int c = 0; c < 3; c++)
        vector[c] = fabsl((long double)f->ray.ray.origin[c]) + fabsl((long double)placed[4 * c + 3]);
    return conditioned(f, i, vector);
}

static long double direction_size(const struct fixture *f, int i)
{
    long double vector[3];
    for (int c = 0; c < 3; c++)
        vector[c] = fabsl((long double)f->ray.ray.direction[c]);
    return conditioned(f, i, vector);
}

static long double vertex_size(const struct fixture *f, int v, int i)
{
    if (f->committed.geometry == 2)
        return fabsl((long double)(float)plain[v][i]) + 0x1p-102L;
    long double size = fabsl((long double)moved[4 * i + 3]);
    for (int c = 0; c < 3; c++)
        size += fabsl((long double)moved[4 * i + c]) * fabsl((long double)(float)far_apart[v][c]);
    return size + 0x1p-102L;
}

static long double inverse_error(const struct fixture *f, int which, float value)
{
    long double vector[3];
    for (int c = 0; c < 3; c++)
        vector[c] = which % 4 == 3 ? fabsl((long double)placed[4 * c + 3]) : c == which % 4;
    return fabsl(value - (long double)f->exact.object_from_world[which]) / (UNIT * conditioned(f, which / 4, vector));
}

static long double origin_error(const struct fixture *f, int which, float value)
{
    return fabsl(value - (long double)f->exact.object_origin[which]) / (UNIT * origin_size(f, which));
}

static long double direction_error(const struct fixture *f, int which, float value)
{
    return fabsl(value - (long double)f->exact.object_direction[which]) / (UNIT * direction_size(f, which));
}

static long double position_error(const struct fixture *f, int which, float value)
{
    return fabsl(value - (long double)f->exact.object_vertices[which / 3][which % 3]) /
           (UNIT * vertex_size(f, which / 3, which % 3));
}

static void test_details_computed(void **state)
{
    (void)state;
    struct fixture f;
    fixture_make(&f, 1, GN_REF_GEOMETRY_OPAQUE);
    for (int i = 0; i < 12; i++)
        bound_matters(&f, GN_CTS_DETAIL, &f.detail.object_from_world[i], inverse_error, i, BOUND, "world to object");
    for (int i = 0; i < 3; i++) {
        bound_matters(&f, GN_CTS_DETAIL, &f.detail.object_origin[i], origin_error, i, BOUND, "the origin in object space");
        bound_matters(&f, GN_CTS_DETAIL, &f.detail.object_direction[i], direction_error, i, BOUND, "the direction in object space");
    }
    expect(&f, GN_CTS_POSITIONS, GN_REF_EXACT, "the right positions", 0);
    for (int i = 0; i < 9; i++)
        bound_matters(&f, GN_CTS_POSITIONS, &f.positions[i], position_error, i, 6, "positions after a transform");
    gn_case_run_finish(&f.run);
}

/* The hit error with the conditioning, when one of t, beta, gamma has this value. */
static long double hit_error(const struct fixture *f, int which, float value)
{
    const double *o = f->exact.object_origin, *d = f->exact.object_direction;
    long double t = which == 0 ? value : f->committed.t, b = which == 1 ? value : f->committed.barycentrics[0];
    long double c = which == 2 ? value : f->committed.barycentrics[1], a = 1 - b - c, det = 0, most = 0;
    const long double weights[3] = {a, b, c}, sizes[3] = {fabsl(a) + fabsl(b) + fabsl(c), fabsl(b), fabsl(c)};
    long double corner[3][3], seen[3][3], lateral[3][2], sideways[3] = {0, 0, 0};
    int k = 0;
    for (int i = 1; i < 3; i++)
        k = fabs(d[i]) > fabs(d[k]) ? i : k;
    const int axes[2] = {(k + 1) % 3, (k + 2) % 3};
    for (int v = 0; v < 3; v++) {
        for (int i = 0; i < 3; i++)
            corner[v][i] = (long double)f->exact.object_vertices[v][i] - o[i];
        long double depth = corner[v][k] / d[k];
        for (int i = 0; i < 3; i++)
            seen[v][i] = vertex_size(f, v, i) + fabsl(corner[v][i]) + fabsl(d[i] * depth);
        for (int i = 0; i < 2; i++)
            lateral[v][i] = corner[v][axes[i]] - d[axes[i]] * depth;
    }
    for (int v = 0; v < 3; v++) {
        const long double *p = lateral[(v + 1) % 3], *q = lateral[(v + 2) % 3];
        det += p[0] * q[1] - p[1] * q[0];
    }
    for (int v = 0; v < 3; v++) {
        const long double *p = lateral[(v + 1) % 3], *q = lateral[(v + 2) % 3];
        long double products = fabsl(p[0] * q[1]) + fabsl(p[1] * q[0]) + 0x1p-102L;
        long double moves = fminl(products / fabsl(det), 1 / (BOUND * UNIT));
        for (int i = 0; i < 2; i++)
            sideways[axes[i]] += moves * fabsl(lateral[v][i]);
    }
    for (int i = 0; i < 3; i++) {
        long double residual = t * d[i], size = origin_size(f, i) + fabsl(t) * direction_size(f, i) + sideways[i];
        for (int v = 0; v < 3; v++) {
            residual -= weights[v] * corner[v][i];
            size += sizes[v] * seen[v][i];
        }
        most = fmaxl(most, fabsl(residual) / (UNIT * size));
    }
    return most;
}

static void test_hit_numbers(void **state)
{
    (void)state;
    struct fixture f;
    for (uint32_t geometry = 1; geometry <= 2; geometry++) {
        fixture_make(&f, geometry, GN_REF_GEOMETRY_OPAQUE);
        bound_matters(&f, GN_CTS_COMMITTED, &f.committed.t, hit_error, 0, BOUND, "t");
        bound_matters(&f, GN_CTS_COMMITTED, &f.committed.barycentrics[0], hit_error, 1, BOUND, "the second corner's weight");
        bound_matters(&f, GN_CTS_COMMITTED, &f.committed.barycentrics[1], hit_error, 2, BOUND, "the third corner's weight");
        gn_case_run_finish(&f.run);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_committed),      cmocka_unit_test(test_generated),        cmocka_unit_test(test_candidates),
        cmocka_unit_test(test_details_copied), cmocka_unit_test(test_details_computed), cmocka_unit_test(test_hit_numbers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
