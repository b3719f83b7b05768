/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Decision by decision: an answer that decides otherwise than the ideal one, while one f32 of the problem moves away from where the
 * decision turns. It is admissible up to the last value whose margin is within the bound, and wrong from the next one on; margins are
 * computed here once more, from docs/numerics.md.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "reference/verdict.h"

#define UNIT 0x1p-24L
#define BOUND 24
#define LEAST 0x1p-102L /* flushed subnormal numbers, in units */

/* A hexagon of six triangles around the origin, front seen from +z; a second one where asked for. */
static const uint32_t hexagon[6][3] = {{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 5}, {0, 5, 6}, {0, 6, 1}};
static const double places[7][2] = {{0, 0}, {2, 0}, {1, 2}, {-1, 2}, {-2, 0}, {-1, -2}, {1, -2}};
static const float box[1][6] = {{-1, -1, 0, 1, 1, 1}};

/* A problem, an answer to it, and by how many units the decision differs that the answer takes. */
struct situation {
    double heights[2]; /* of the hexagons */
    int sheets;
    bool boxes; /* instead */
    struct gn_ref_ray ray;
    struct gn_ref_policy policy;
    struct gn_ref_answer answer;
    long double margin;
};

static void cross(const long double a[3], const long double b[3], long double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static long double change(const long double by[3], const long double sizes[3])
{
    return fabsl(by[0]) * sizes[0] + fabsl(by[1]) * sizes[1] + fabsl(by[2]) * sizes[2];
}

/* One triangle as the ray sees it. */
struct seen {
    long double edge[3]; /* margins: how far inside of the edge opposite to each corner */
    long double edge_on; /* the margin of facing */
    long double t, t_change;
};

static struct seen see(const struct situation *s, int sheet, int primitive)
{
    struct seen out;
    long double o[3], d[3], corner[3][3], size[3][3], s_o[3], s_d[3], side[3][3], products[3][3], ends[2][3], normal[3];
    int k = 0;
    for (int i = 0; i < 3; i++) {
        o[i] = s->ray.origin[i];
        d[i] = s->ray.direction[i];
        s_o[i] = fabsl(o[i]) + LEAST;
        s_d[i] = fabsl(d[i]) + LEAST;
        k = fabsl(d[i]) > fabsl(d[k]) ? i : k;
    }
    for (int c = 0; c < 3; c++) {
        const double *place = places[hexagon[primitive][c]];
        const long double vertex[3] = {place[0], place[1], s->heights[sheet]};
        long double depth = fabsl((vertex[k] - o[k]) / d[k]);
        for (int i = 0; i < 3; i++) {
            corner[c][i] = vertex[i] - o[i];
            size[c][i] = fabsl(vertex[i]) + LEAST + fabsl(corner[c][i]) + fabsl(d[i]) * depth;
        }
    }
    for (int c = 0; c < 3; c++) {
        cross(corner[(c + 1) % 3], corner[(c + 2) % 3], products[c]);
        cross(corner[c], d, side[c]);
        for (int e = 0; e < 2; e++)
            ends[e][c] = corner[e + 1][c] - corner[0][c];
    }
    cross(ends[0], ends[1], normal);
    long double det = d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2], weight[3];
    long double det_change = change(normal, s_d) + fabsl(d[k]) * LEAST;
    for (int c = 0; c < 3; c++) {
        int n = (c + 1) % 3, p = (c + 2) % 3;
        long double between[3], value = 0;
        for (int i = 0; i < 3; i++) {
            between[i] = side[p][i] - side[n][i];
            value += d[i] * products[c][i];
        }
        long double moved = change(products[c], s_d) + change(side[p], size[n]) + change(side[n], size[p]) +
                            change(between, s_o) + fabsl(d[k]) * LEAST;
        out.edge[c] = (det < 0 ? -value : value) / (UNIT * moved);
        weight[c] = value / det;
        det_change += change(between, size[c]);
    }
    out.edge_on = fabsl(det) / (UNIT * det_change);
    out.t = (normal[0] * corner[0][0] + normal[1] * corner[0][1] + normal[2] * corner[0][2]) / det;
    out.t_change = 0;
    for (int i = 0; i < 3; i++) {
        long double sum = s_o[i] + fabsl(out.t) * s_d[i];
        for (int c = 0; c < 3; c++)
            sum += fabsl(weight[c]) * size[c][i];
        out.t_change += UNIT * fabsl(normal[i]) * sum / fabsl(det);
    }
    return out;
}

static struct situation looking_down(float x, float y)
{
    return (struct situation){
        .sheets = 1,
        .ray = {.origin = {x, y, 4}, .direction = {0, 0, -1}, .tmax = 100, .cull_mask = 0xFF},
        .policy = {.confirm_mask = UINT32_MAX},
    };
}

static struct gn_ref_answer hit(uint32_t primitive, float t, float b, float c)
{
    return (struct gn_ref_answer){.kind = GN_REF_ANSWER_TRIANGLE, .primitive = primitive, .front = 1, .t = t, .barycentrics = {b, c}};
}

/* A ray at (x, 1) hits a triangle that it misses beside the edge opposite to a corner, whose weight is reported as hardly below 0. */
static void beside(float x, int primitive, int corner, struct situation *s)
{
    const double *b = places[hexagon[primitive][1]], *c = places[hexagon[primitive][2]];
    double det = b[0] * c[1] - b[1] * c[0], weights[3] = {1, ((double)x * c[1] - c[0]) / det, (b[0] - b[1] * (double)x) / det};
    weights[0] -= weights[1] + weights[2];
    double lacking = fmax(-0x1p-20 - weights[corner], 0);
    weights[corner] += lacking;
    weights[(corner + 1) % 3] -= lacking / 2;
    weights[(corner + 2) % 3] -= lacking / 2;
    *s = looking_down(x, 1);
    s->answer = hit((uint32_t)primitive, 4, (float)weights[1], (float)weights[2]);
    s->margin = -see(s, 0, primitive).edge[corner];
}

/* The edge between the triangles 0 and 1, where y = 2 x. */
static void right_of_the_edge(float x, struct situation *s)
{
    beside(x, 1, 2, s);
}

static void left_of_the_edge(float x, struct situation *s)
{
    beside(x, 0, 1, s);
}

/* The border of triangle 0, opposite to the middle. */
static void outside_of_the_border(float x, struct situation *s)
{
    beside(x, 0, 0, s);
}

static void inside_of_the_border(float x, struct situation *s)
{
    *s = looking_down(x, 1);
    s->margin = see(s, 0, 0).edge[0];
}

/* Through (1, 1/2) the ray meets triangle 0 at t = 4, with weights 3/8 and 1/4. */
static void range(float tmin, float tmax, struct situation *s)
{
    *s = looking_down(1, 0.5f);
    struct seen seen = see(s, 0, 0);
    s->ray.tmin = tmin;
    s->ray.tmax = tmax;
    s->margin = fminl(fabsl(seen.t - tmin), fabsl(seen.t - tmax)) / seen.t_change;
}

static void hit_beyond_the_end(float tmax, struct situation *s)
{
    range(0, tmax, s);
    s->answer = hit(0, tmax, 0.375f, 0.25f);
}

static void lost_before_the_end(float tmax, struct situation *s)
{
    range(0, tmax, s);
}

static void hit_before_the_start(float tmin, struct situation *s)
{
    range(tmin, 100, s);
    s->answer = hit(0, tmin, 0.375f, 0.25f);
}

static void lost_after_the_start(float tmin, struct situation *s)
{
    range(tmin, 100, s);
}

static void sheet_behind(float height, struct situation *s)
{
    *s = looking_down(1, 0.5f);
    s->sheets = 2;
    s->heights[1] = height;
    s->answer = hit(0, 4, 0.375f, 0.25f);
    s->margin = height / (see(s, 0, 0).t_change + see(s, 1, 0).t_change);
}

/* A hexagon at z = 1, and so flat a ray from just above it that the face is hard to tell. */
static void other_face(float height, struct situation *s)
{
    *s = looking_down(-3, 0.5f);
    s->heights[0] = 1;
    s->ray.origin[2] = height;
    s->ray.direction[0] = 1;
    s->ray.direction[2] = (1 - height) / 4;
    s->answer = hit(0, 4, 0.375f, 0.25f);
    s->answer.front = 0;
    s->margin = see(s, 0, 0).edge_on;
}

static void culled_face(float height, struct situation *s)
{
    other_face(height, s);
    s->answer.front = 1;
    s->ray.flags = GN_REF_RAY_CULL_FRONT_FACING;
}

/* The box from -1 to 1, and in z from 0 to 1, lost. */
static void box_beside(float x, struct situation *s)
{
    *s = looking_down(x, 0.5f);
    s->boxes = true;
    s->policy = (struct gn_ref_policy){.generate_mask = 1, .generate_t0 = 3};
    s->margin = (1 - (long double)x) / (UNIT * (fabsl(x) + LEAST + 1));
}

static void box_at_the_end(float tmax, struct situation *s)
{
    box_beside(0.5f, s);
    s->ray.tmax = tmax;
    s->margin = (tmax - 3.0L) / (UNIT * ((4 + LEAST) + 3 * (1 + LEAST) + 1));
}

static enum gn_ref_verdict_class judged(const struct situation *s)
{
    double positions[2][7][3];
    struct gn_ref_geometry geometries[2] = {{.type = GN_REF_AABBS, .primitive_count = 1, .aabbs = box}};
    for (int sheet = 0; sheet < s->sheets && !s->boxes; sheet++) {
        for (int v = 0; v < 7; v++) {
            memcpy(positions[sheet][v], places[v], sizeof places[v]);
            positions[sheet][v][2] = s->heights[sheet];
        }
        geometries[sheet] = (struct gn_ref_geometry){.flags = GN_REF_GEOMETRY_OPAQUE, .primitive_count = 6,
                                                     .positions = (const double(*)[3])positions[sheet], .position_count = 7,
                                                     .divisor = 1, .triangles = hexagon};
    }
    struct gn_ref_instance instance = {.transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, .mask = 0xFF};
    struct gn_ref_scene *scene = gn_ref_scene_create();
    struct gn_ref_verdict verdict;
    assert_true(gn_ref_scene_add_blas(scene, geometries, (uint32_t)s->sheets, &instance.blas));
    assert_true(gn_ref_scene_add_instance(scene, &instance));
    assert_true(gn_ref_scene_commit(scene));
    struct gn_ref_judge *judge = gn_ref_judge_create(scene);
    assert_non_null(judge);
    assert_true(gn_ref_judge_committed(judge, &s->ray, &s->policy, &s->answer, &verdict));
    gn_ref_judge_destroy(judge);
    gn_ref_scene_destroy(scene);
    return verdict.cls;
}

static const struct row {
    const char *what;
    void (*make)(float value, struct situation *out);
    float from, to; /* within the bound; beyond it. Positive */
    enum gn_ref_verdict_class within;
} rows[] = {
    {"a triangle hit beyond its edge, on the right", right_of_the_edge, 0x1.000002p-1f, 0.6f, GN_REF_ADMISSIBLE},
    {"a triangle hit beyond its edge, on the left", left_of_the_edge, 0x1.fffffep-2f, 0.4f, GN_REF_ADMISSIBLE},
    {"a triangle hit beyond its border", outside_of_the_border, 0x1.800002p0f, 1.6f, GN_REF_ADMISSIBLE},
    {"a triangle lost inside of its border", inside_of_the_border, 0x1.7ffffep0f, 1.4f, GN_REF_GAP},
    {"a hit beyond tmax, reported at tmax", hit_beyond_the_end, 4, 3.9f, GN_REF_ADMISSIBLE},
    {"a hit lost before tmax", lost_before_the_end, 0x1.000002p2f, 4.1f, GN_REF_GAP},
    {"a hit before tmin, reported at tmin", hit_before_the_start, 4, 4.1f, GN_REF_ADMISSIBLE},
    {"a hit lost after tmin", lost_after_the_start, 0x1.fffffep1f, 3.9f, GN_REF_GAP},
    {"the sheet behind", sheet_behind, 0x1p-30f, 0.1f, GN_REF_ADMISSIBLE},
    {"the other face", other_face, 0x1.000002p0f, 1.1f, GN_REF_ADMISSIBLE},
    {"a face that is culled", culled_face, 0x1.000002p0f, 1.1f, GN_REF_ADMISSIBLE},
    {"a box lost beside its face", box_beside, 0x1.fffffep-1f, 0.9f, GN_REF_GAP},
    {"a box lost before tmax", box_at_the_end, 0x1.800002p1f, 3.1f, GN_REF_GAP},
};

static void expect(const struct row *row, float value, enum gn_ref_verdict_class cls)
{
    struct situation s;
    row->make(value, &s);
    enum gn_ref_verdict_class found = judged(&s);
    if (found != cls)
        fail_msg("%s, at %a (%.9Lg units): expected %s, found %s", row->what, (double)value, s.margin,
                 gn_ref_verdict_class_name(cls), gn_ref_verdict_class_name(found));
}

static uint32_t bits_of(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

static float float_of(uint32_t bits)
{
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void decisions(void **state)
{
    (void)state;
    for (size_t r = 0; r < sizeof rows / sizeof rows[0]; r++) {
        const struct row *row = &rows[r];
        struct situation s;
        /* The values between which the margin passes the bound, by halving the floats in between. */
        uint32_t within = bits_of(row->from), beyond = bits_of(row->to);
        row->make(row->from, &s);
        assert_true(s.margin <= BOUND);
        row->make(row->to, &s);
        assert_true(s.margin > BOUND);
        while (within + 1 != beyond && beyond + 1 != within) {
            uint32_t middle = within < beyond ? within + (beyond - within) / 2 : beyond + (within - beyond) / 2;
            row->make(float_of(middle), &s);
            if (s.margin <= BOUND)
                within = middle;
            else
                beyond = middle;
        }
        expect(row, row->from, row->within);
        expect(row, float_of(within), row->within);
        expect(row, float_of(beyond), GN_REF_WRONG);
        expect(row, row->to, GN_REF_WRONG);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(decisions)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
