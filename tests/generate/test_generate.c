/* SPDX-License-Identifier: Apache-2.0 */
/* What the cases assume of the generated meshes and rays, checked in exact arithmetic where that matters. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "cts/generate.h"

typedef __float128 quad;

/* Products of three differences of f32 values within 2^12 of each other fit 113 bits when the values are
 * dyadic with few bits, as those of the lattice meshes are: there, this is exact. */
static quad volume(const quad a[3], const quad b[3], const quad c[3])
{
    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
}

enum shape { FACES_UP, CLOSED, NEITHER };

struct mesh_row {
    const char *name;
    struct gn_mesh (*make)(struct gn_arena *arena, struct gn_random *random);
    uint32_t triangles, positions;
    enum shape shape;
    int euler; /* V - E + F where CLOSED */
    bool lattice;
};

static struct gn_mesh make_height_field(struct gn_arena *arena, struct gn_random *random)
{
    return gn_mesh_height_field(arena, random, 13, 0.3);
}
static struct gn_mesh make_lattice(struct gn_arena *arena, struct gn_random *random)
{
    return gn_mesh_lattice(arena, random, 16, 0.25);
}
static struct gn_mesh make_blob(struct gn_arena *arena, struct gn_random *random)
{
    return gn_mesh_blob(arena, random, 7, 9, 0.4);
}
static struct gn_mesh make_smallest_blob(struct gn_arena *arena, struct gn_random *random)
{
    return gn_mesh_blob(arena, random, 2, 3, 0.1);
}
static struct gn_mesh make_torus(struct gn_arena *arena, struct gn_random *random)
{
    (void)random;
    return gn_mesh_torus(arena, 12, 8, 0.4);
}
static struct gn_mesh make_box(struct gn_arena *arena, struct gn_random *random)
{
    (void)random;
    return gn_mesh_box(arena, 4);
}
static struct gn_mesh make_octahedron(struct gn_arena *arena, struct gn_random *random)
{
    (void)random;
    return gn_mesh_octahedron(arena, 8);
}
static struct gn_mesh make_fan(struct gn_arena *arena, struct gn_random *random)
{
    return gn_mesh_fan(arena, random, 11, 0.5);
}
static struct gn_mesh make_large_fan(struct gn_arena *arena, struct gn_random *random)
{
    return gn_mesh_fan(arena, random, 1024, 0.125);
}
static struct gn_mesh make_t_junctions(struct gn_arena *arena, struct gn_random *random)
{
    return gn_mesh_t_junctions(arena, random, 8, 0.25, false);
}
static struct gn_mesh make_soup(struct gn_arena *arena, struct gn_random *random)
{
    return gn_mesh_soup(arena, random, 50, 0.2);
}
static struct gn_mesh make_quad(struct gn_arena *arena, struct gn_random *random)
{
    (void)random;
    return gn_mesh_quad(arena);
}
static struct gn_mesh make_triangle(struct gn_arena *arena, struct gn_random *random)
{
    (void)random;
    return gn_mesh_triangle(arena);
}

static const struct mesh_row meshes[] = {
    {"height field", make_height_field, 2 * 13 * 13, 14 * 14, FACES_UP, 0, false},
    {"lattice", make_lattice, 512, 17 * 17, FACES_UP, 0, true},
    {"blob", make_blob, 126, 65, CLOSED, 2, false},
    {"smallest blob", make_smallest_blob, 12, 8, CLOSED, 2, false},
    {"torus", make_torus, 192, 96, CLOSED, 0, false},
    {"box", make_box, 192, 98, CLOSED, 2, true},
    {"octahedron", make_octahedron, 512, 258, CLOSED, 2, true},
    {"fan", make_fan, 11, 12, FACES_UP, 0, true},
    {"large fan", make_large_fan, 1024, 1025, FACES_UP, 0, true},
    {"T-junctions", make_t_junctions, 64 + 256, 9 * 5 + 17 * 9, FACES_UP, 0, true},
    {"soup", make_soup, 50, 150, NEITHER, 0, false},
    {"quad", make_quad, 2, 4, FACES_UP, 0, true},
    {"triangle", make_triangle, 1, 3, FACES_UP, 0, true},
};

static int failures;

/* A failed expectation says which and goes on. */
#define EXPECT(condition, ...)                                                                                         \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            failures++;                                                                                                \
            fprintf(stderr, "%s:%d: %s: ", __FILE__, __LINE__, #condition);                                            \
            fprintf(stderr, __VA_ARGS__);                                                                              \
            fprintf(stderr, "\n");                                                                                     \
        }                                                                                                              \
    } while (0)

static uint32_t edge_uses(const struct gn_mesh *mesh, uint32_t from, uint32_t to)
{
    uint32_t uses = 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        for (int k = 0; k < 3; k++)
            uses += mesh->triangles[t][k] == from && mesh->triangles[t][(k + 1) % 3] == to;
    return uses;
}

static void check_mesh(const struct mesh_row *row, const struct gn_mesh *mesh)
{
    EXPECT(mesh->triangle_count == row->triangles, "%s: %u, expected %u", row->name, mesh->triangle_count,
           row->triangles);
    EXPECT(mesh->position_count == row->positions, "%s: %u, expected %u", row->name, mesh->position_count,
           row->positions);
    bool *used = calloc(mesh->position_count, sizeof *used);
    for (uint32_t v = 0; v < mesh->position_count; v++)
        for (int c = 0; c < 3; c++)
            EXPECT((double)(float)mesh->positions[v][c] == mesh->positions[v][c], "%s: vertex %u: %a is not an f32",
                   row->name, v, mesh->positions[v][c]);
    quad total = 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        quad p[3][3];
        for (int k = 0; k < 3; k++) {
            uint32_t v = mesh->triangles[t][k];
            EXPECT(v < mesh->position_count, "%s: triangle %u has vertex %u", row->name, t, v);
            used[v] = true;
            for (int c = 0; c < 3; c++)
                p[k][c] = mesh->positions[v][c];
            if (row->shape == CLOSED) {
                uint32_t next = mesh->triangles[t][(k + 1) % 3];
                EXPECT(edge_uses(mesh, v, next) == 1 && edge_uses(mesh, next, v) == 1,
                       "%s: edge %u-%u is not shared by two triangles that go opposite ways", row->name, v, next);
            }
        }
        total += volume(p[0], p[1], p[2]);
        quad up = (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]);
        if (row->shape == FACES_UP)
            EXPECT(up > 0, "%s: triangle %u does not face +z", row->name, t);
        if (row->shape == CLOSED && row->euler == 2)
            EXPECT(volume(p[0], p[1], p[2]) > 0, "%s: triangle %u does not face away from the origin", row->name, t);
    }
    if (row->shape == CLOSED) {
        EXPECT(total > 0, "%s: the volume is not positive", row->name);
        int found = (int)mesh->position_count - (int)(3 * mesh->triangle_count / 2) + (int)mesh->triangle_count;
        EXPECT(found == row->euler, "%s: Euler characteristic %d, expected %d", row->name, found, row->euler);
    }
    for (uint32_t v = 0; v < mesh->position_count; v++)
        EXPECT(used[v], "%s: vertex %u is in no triangle", row->name, v);
    free(used);
}

static void meshes_are_what_they_say(void **state)
{
    (void)state;
    failures = 0;
    for (size_t i = 0; i < sizeof meshes / sizeof meshes[0]; i++) {
        struct gn_arena arena = {0};
        struct gn_random random = {i + 1};
        struct gn_mesh mesh = meshes[i].make(&arena, &random);
        check_mesh(&meshes[i], &mesh);
        gn_arena_finish(&arena);
    }
    assert_int_equal(failures, 0);
}

static void equal_seeds_give_equal_bits(void **state)
{
    (void)state;
    failures = 0;
    for (size_t i = 0; i < sizeof meshes / sizeof meshes[0]; i++) {
        struct gn_arena arena = {0};
        struct gn_random random[2] = {{i}, {i}};
        struct gn_mesh mesh[2];
        struct gn_cts_ray rays[2][64];
        memset(rays, 0, sizeof rays);
        for (int k = 0; k < 2; k++) {
            mesh[k] = meshes[i].make(&arena, &random[k]);
            gn_rays_aimed(&random[k], &mesh[k], NULL, NULL, GN_AIM_EDGE, 3, true, rays[k], 32);
            gn_rays_aimed(&random[k], &mesh[k], NULL, NULL, GN_AIM_RANDOM, 3, false, rays[k] + 32, 32);
        }
        EXPECT(!memcmp(mesh[0].positions, mesh[1].positions, mesh[0].position_count * sizeof *mesh[0].positions),
               "%s", meshes[i].name);
        EXPECT(!memcmp(mesh[0].triangles, mesh[1].triangles, mesh[0].triangle_count * sizeof *mesh[0].triangles),
               "%s", meshes[i].name);
        EXPECT(!memcmp(rays[0], rays[1], sizeof rays[0]), "%s", meshes[i].name);
        gn_arena_finish(&arena);
    }
    assert_int_equal(failures, 0);
}

/* How many triangles the ray's line meets at exactly t = the whole number it was made for, by kind: inside, on
 * an edge, at a vertex. Exact: see volume(). */
static void exact_meetings(const struct gn_mesh *mesh, const struct gn_ref_ray *ray, uint32_t out_kinds[3])
{
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        quad p[3][3], d[3], e[3];
        for (int c = 0; c < 3; c++) {
            d[c] = ray->direction[c];
            for (int k = 0; k < 3; k++)
                p[k][c] = (quad)mesh->positions[mesh->triangles[t][k]][c] - ray->origin[c];
        }
        int positive = 0, negative = 0, zero = 0;
        quad sum = 0, T = volume(p[0], p[1], p[2]);
        for (int k = 0; k < 3; k++) {
            e[k] = volume(d, p[(k + 1) % 3], p[(k + 2) % 3]);
            sum += e[k];
            positive += e[k] > 0;
            negative += e[k] < 0;
            zero += e[k] == 0;
        }
        if ((positive && negative) || zero == 3)
            continue;
        for (int m = 1; m <= 8; m++)
            if (T == m * sum)
                out_kinds[zero]++;
    }
}

static void lattice_rays_meet_their_targets_exactly(void **state)
{
    (void)state;
    failures = 0;
    for (size_t i = 0; i < sizeof meshes / sizeof meshes[0]; i++) {
        if (!meshes[i].lattice)
            continue;
        struct gn_arena arena = {0};
        struct gn_random random = {i + 100};
        struct gn_mesh mesh = meshes[i].make(&arena, &random);
        for (int aim = GN_AIM_INTERIOR; aim <= GN_AIM_VERTEX; aim++) {
            struct gn_cts_ray rays[300];
            gn_rays_lattice(&random, &mesh, (enum gn_aim)aim, rays, 300);
            for (int r = 0; r < 300; r++) {
                uint32_t kinds[3] = {0};
                exact_meetings(&mesh, &rays[r].ray, kinds);
                EXPECT(kinds[aim] >= 1, "%s, ray %d aimed at kind %d: inside %u, edges %u, vertices %u",
                       meshes[i].name, r, aim, kinds[0], kinds[1], kinds[2]);
            }
        }
        gn_arena_finish(&arena);
    }
    assert_int_equal(failures, 0);
}

/* A ray off its target by one unit in the last place must be seen as such, or the test above proves nothing. */
static void exact_check_can_fail(void **state)
{
    (void)state;
    struct gn_arena arena = {0};
    struct gn_random random = {5};
    struct gn_mesh mesh = gn_mesh_lattice(&arena, &random, 16, 0.25);
    struct gn_cts_ray ray;
    uint32_t kinds[3] = {0};
    gn_rays_lattice(&random, &mesh, GN_AIM_VERTEX, &ray, 1);
    ray.ray.origin[0] = nextafterf(ray.ray.origin[0], 100);
    exact_meetings(&mesh, &ray.ray, kinds);
    assert_int_equal(kinds[2], 0);
    gn_arena_finish(&arena);
}

static void aimed_rays_come_from_the_front(void **state)
{
    (void)state;
    failures = 0;
    struct gn_arena arena = {0};
    struct gn_random random = {9};
    struct gn_mesh mesh = gn_mesh_triangle(&arena);
    for (int i = 0; i < 64; i++) {
        bool geometry_mirrored = i & 1, instance_mirrored = i & 2;
        float g[12], m[12];
        gn_transform_random(&random, 0.5, 2, 1, geometry_mirrored, g);
        gn_transform_general(&random, 0.5, 2, 0.5, 1, instance_mirrored, m);
        struct gn_cts_ray ray;
        gn_rays_aimed(&random, &mesh, g, m, GN_AIM_INTERIOR, 2, false, &ray, 1);
        /* The world's U + V + W is the direction times the normal. */
        double p[3][3], e[2][3], n = 0;
        for (int k = 0; k < 3; k++) {
            gn_transform_point(g, mesh.positions[k], p[k]);
            gn_transform_point(m, p[k], p[k]);
        }
        for (int c = 0; c < 3; c++) {
            e[0][c] = p[1][c] - p[0][c];
            e[1][c] = p[2][c] - p[0][c];
        }
        for (int c = 0; c < 3; c++) {
            int d = (c + 1) % 3, f = (c + 2) % 3;
            n += ray.ray.direction[c] * (e[0][d] * e[1][f] - e[0][f] * e[1][d]);
        }
        EXPECT((n * (instance_mirrored ? -1 : 1)) < 0, "transform %d: %g", i, n);
        EXPECT(ray.ray.tmin == 0 && ray.ray.tmax >= 10 && ray.ray.cull_mask == 0xFF, "transform %d", i);
    }
    gn_arena_finish(&arena);
    assert_int_equal(failures, 0);
}

static void dyadic_transforms_move_lattice_rays_exactly(void **state)
{
    (void)state;
    struct gn_arena arena = {0};
    struct gn_random random = {11};
    struct gn_mesh mesh = gn_mesh_octahedron(&arena, 4);
    int mirrored = 0, failed = 0;
    for (int i = 0; i < 64; i++) {
        float m[12];
        gn_transform_dyadic(&random, i & 1, m);
        double det = m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
                     m[2] * (m[4] * m[9] - m[5] * m[8]);
        mirrored += det < 0;
        struct gn_cts_ray rays[16];
        gn_rays_lattice(&random, &mesh, GN_AIM_RANDOM, rays, 16);
        failed += !gn_rays_move_exactly(rays, 16, m);
    }
    assert_int_equal(mirrored, 32);
    assert_int_equal(failed, 0);
    float third[12] = {1 / 3.0f, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    double origin[3] = {0.1, 0, 0}, direction[3] = {0, 0, 1};
    struct gn_cts_ray ray = gn_ray_make(origin, direction, 1), before = ray;
    assert_false(gn_rays_move_exactly(&ray, 1, third));
    assert_memory_equal(&ray, &before, sizeof ray);
    gn_arena_finish(&arena);
}

static void deactivation_leaves_some(void **state)
{
    (void)state;
    struct gn_arena arena = {0};
    struct gn_random random = {3};
    struct gn_mesh mesh = gn_mesh_soup(&arena, &random, 100, 0.1);
    gn_mesh_deactivate(&random, &mesh, 1.0);
    int active = 0;
    for (uint32_t t = 0; t < 100; t++) {
        int nans = 0;
        for (int k = 0; k < 3; k++) {
            const double *p = mesh.positions[mesh.triangles[t][k]];
            /* A NaN in y or z alone has no meaning in the API. */
            assert_int_equal(!!isnan(p[0]), !!isnan(p[1]));
            assert_int_equal(!!isnan(p[0]), !!isnan(p[2]));
            nans += !!isnan(p[0]);
        }
        active += nans == 0;
    }
    assert_int_equal(active, 1);
    gn_arena_finish(&arena);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(meshes_are_what_they_say),
        cmocka_unit_test(equal_seeds_give_equal_bits),
        cmocka_unit_test(lattice_rays_meet_their_targets_exactly),
        cmocka_unit_test(exact_check_can_fail),
        cmocka_unit_test(aimed_rays_come_from_the_front),
        cmocka_unit_test(dyadic_transforms_move_lattice_rays_exactly),
        cmocka_unit_test(deactivation_leaves_some),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
