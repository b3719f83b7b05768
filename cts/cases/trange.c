/* SPDX-License-Identifier: Apache-2.0 */
/* The ends of the t range, on surfaces that the rays meet at exactly known t. */
#include "cts/compose.h"

#include <float.h>
#include <math.h>

#define SPEC_OPEN                                                                                            \
    "triangles are met where tmin < t < tmax, the ends excluded (Vulkan: Ray Intersection Candidate "        \
    "Determination)"
#define SPEC_CLOSED                                                                                          \
    "boxes are candidates where the ray's closed range from tmin to tmax meets them (Vulkan: Ray "           \
    "Intersection Candidate Determination)"
#define SPEC_RANGE                                                                                           \
    "no hit is reported outside tmin and tmax (Vulkan: Ray Intersection Candidate Determination)"

/* How an end of the range lies to the t of the surface that a ray is aimed at. */
enum end {
    START, /* 0 */
    FAR,   /* 1000 times t */
    INFINITE,
    LARGEST,  /* the largest finite number */
    SMALLEST, /* the smallest denormal */
    AT,       /* exactly there */
    NEAR,     /* there, or one to three ulp to either side */
    CLEAR,    /* 2^-9 to 2^-15 of t to either side: no rounding excuses an error */
    OTHER,    /* the other end */
};

struct params {
    bool tilted;
    bool on_surface; /* the origin is the target: t is 0 */
    enum end tmin, tmax;
    int min_exponent, max_exponent; /* the direction is scaled by a power of two between these */
    enum gn_cts_program program;
    uint32_t geometry_flags;
};

enum { SURFACES = 16 };

static float end_value(struct gn_random *random, enum end end, float t)
{
    uint32_t pick = gn_random_below(random, 8);
    float value = t;
    switch (end) {
    case START:
        return 0;
    case FAR:
        return t > 0 ? t * 1000 : 1000;
    case INFINITE:
        return INFINITY;
    case LARGEST:
        return FLT_MAX;
    case SMALLEST:
        return 0x1p-149f;
    case AT:
    case OTHER:
        return t;
    case NEAR:
        for (uint32_t i = 0; i < (pick >> 1); i++)
            value = nextafterf(value, pick & 1 ? INFINITY : 0);
        return value;
    case CLEAR:
        return t * (1 + ldexpf(pick & 1 ? 1 : -1, -9 - (int)gn_random_below(random, 7)));
    }
    return t;
}

/* A surface in its slab of the z axis: a quad of two triangles, or two tilted triangles, on a lattice of 1/8.
 */
static void add_surface(struct gn_random *random, double (*corners)[3], uint32_t index, bool tilted)
{
    for (int c = 0; c < 6; c++)
        corners[c][2] = 4.0 * index;
    static const double square[6][2] = {{-4, -4}, {4, -4}, {4, 4}, {-4, -4}, {4, 4}, {-4, 4}};
    for (int c = 0; c < 6; c++) {
        corners[c][0] = square[c][0];
        corners[c][1] = square[c][1];
        if (tilted)
            for (int a = 0; a < 3; a++)
                corners[c][a] += (gn_random_below(random, 17) - 8.0) / (a == 2 ? 4 : 8);
    }
}

/* direction = integers / 8 and origin = target - direction * t: no operation rounds. */
static struct gn_cts_ray exact_ray(struct gn_random *random, const double (*corners)[3],
                                   const struct params *params, float *out_t)
{
    uint32_t triangle = gn_random_below(random, 2 * SURFACES);
    const double(*v)[3] = &corners[3 * triangle];
    uint32_t weight[3] = {2 + gn_random_below(random, 8), 2 + gn_random_below(random, 4), 0};
    weight[2] = 16 - weight[0] - weight[1];
    double e[3], f[3], n[3], target[3], direction[3], origin[3], length, across;
    for (int a = 0; a < 3; a++) {
        target[a] = (weight[0] * v[0][a] + weight[1] * v[1][a] + weight[2] * v[2][a]) / 16;
        e[a] = v[1][a] - v[0][a];
        f[a] = v[2][a] - v[0][a];
    }
    for (int a = 0; a < 3; a++)
        n[a] = e[(a + 1) % 3] * f[(a + 2) % 3] - e[(a + 2) % 3] * f[(a + 1) % 3];
    do {
        for (int a = 0; a < 3; a++)
            direction[a] = params->tilted || a == 2 ? (gn_random_below(random, 17) - 8.0) / 8 : 0;
        length =
            sqrt(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]);
        across = n[0] * direction[0] + n[1] * direction[1] + n[2] * direction[2];
    } while (fabs(across) < 0.3 * length * sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) || length == 0);
    double t = params->on_surface ? 0 : (1 + gn_random_below(random, 31)) / 8.0;
    int exponent = params->min_exponent +
                   (int)gn_random_below(random, (uint32_t)(params->max_exponent - params->min_exponent) + 1);
    for (int a = 0; a < 3; a++) {
        origin[a] = target[a] - direction[a] * t;
        direction[a] = ldexp(direction[a], exponent);
    }
    *out_t = (float)ldexp(t, -exponent);
    struct gn_cts_ray ray = gn_ray_make(origin, direction, 0);
    ray.policy = (struct gn_ref_policy){.confirm_mask = UINT32_MAX};
    return ray;
}

static void triangles(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    double(*corners)[3] = gn_arena_alloc(&run->arena, 6 * SURFACES, sizeof *corners);
    uint32_t(*indices)[3] = gn_arena_alloc(&run->arena, 2 * SURFACES, sizeof *indices);
    for (uint32_t i = 0; i < SURFACES; i++)
        add_surface(&run->random, &corners[6 * i], i, params->tilted);
    for (uint32_t i = 0; i < 6 * SURFACES; i++)
        indices[i / 3][i % 3] = i;
    struct gn_mesh mesh = {corners, 6 * SURFACES, indices, 2 * SURFACES};
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = params->geometry_flags;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);

    uint32_t count = gn_ray_count(run, 16384);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    for (uint32_t i = 0; i < count; i++) {
        float t;
        rays[i] = exact_ray(&run->random, (const double(*)[3])corners, params, &t);
        struct gn_ref_ray *ray = &rays[i].ray;
        ray->tmin = end_value(&run->random, params->tmin, t);
        ray->tmax = end_value(&run->random, params->tmax, t);
        if (params->tmin == OTHER)
            ray->tmin = ray->tmax;
        if (params->tmax == OTHER)
            ray->tmax = ray->tmin;
        if (ray->tmax < ray->tmin)
            ray->tmax = ray->tmin;
    }
    gn_case_trace(run, &scene, params->program, rays, count, 0);
}

/* Ranges with both ends between the layers of a stack, so that the nearest admitted one varies. */
static void windows(struct gn_case_run *run, const struct gn_case *self)
{
    struct gn_cts_geometry *geometries = GN_NEW(&run->arena, struct gn_cts_geometry, SURFACES);
    for (uint32_t i = 0; i < SURFACES; i++) {
        struct gn_mesh mesh = gn_mesh_height_field(&run->arena, &run->random, 8, 0.25);
        mesh = gn_mesh_scaled(&run->arena, &mesh, 2, 2, 1, 0, 0, i);
        geometries[i] = gn_geometry_of_mesh(&mesh);
        geometries[i].flags = (uint32_t)self->value;
    }
    struct gn_cts_blas blas = {.geometries = geometries, .geometry_count = SURFACES};
    struct gn_cts_instance instance = gn_instance_of(0, NULL);
    struct gn_cts_scene scene = gn_scene_make(&blas, 1, &instance, 1);
    uint32_t count = gn_ray_count(run, 16384);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_rays_through(&run->random, 0, SURFACES - 1, 1.9, rays, count);
    for (uint32_t i = 0; i < count; i++) {
        float a = (float)gn_random_range(&run->random, 0, SURFACES + 1);
        float b = (float)gn_random_range(&run->random, 0, SURFACES + 1);
        rays[i].ray.tmin = a < b ? a : b;
        rays[i].ray.tmax = a < b ? b : a;
    }
    gn_case_trace(run, &scene, self->value ? GN_CTS_COMMITTED : GN_CTS_CANDIDATES, rays, count, 0);
}

struct box_params {
    enum { ENTRY, MIDDLE, EXIT } where; /* the plane of the box where hits are generated */
    enum end tmin, tmax;
    int min_exponent, max_exponent;
    enum gn_cts_program program;
};

/* Boxes one above the other, wide enough for every ray to go through all of them, with faces on the lattice.
 */
static void boxes(struct gn_case_run *run, const struct gn_case *self)
{
    const struct box_params *params = self->params;
    float(*ladder)[6] = gn_arena_alloc(&run->arena, SURFACES, sizeof *ladder);
    for (uint32_t i = 0; i < SURFACES; i++) {
        const float box[6] = {-2, -2, (float)i - 0.25f, 2, 2, (float)i + 0.25f};
        for (int a = 0; a < 6; a++)
            ladder[i][a] = box[a];
    }
    struct gn_cts_geometry geometry = {
        .type = GN_REF_AABBS, .aabbs = (const float(*)[6])ladder, .aabb_count = SURFACES};
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    uint32_t count = gn_ray_count(run, 16384);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_ladder_rays(&run->random, (const float(*)[6])ladder, SURFACES, false, rays, count);
    for (uint32_t i = 0; i < count; i++) {
        struct gn_ref_ray *ray = &rays[i].ray;
        struct gn_ref_policy *policy = &rays[i].policy;
        policy->generate_t0 += params->where == ENTRY ? -0.25f : params->where == EXIT ? 0.25f : 0;
        int exponent =
            params->min_exponent +
            (int)gn_random_below(&run->random, (uint32_t)(params->max_exponent - params->min_exponent) + 1);
        for (int a = 0; a < 3; a++)
            ray->direction[a] = ldexpf(ray->direction[a], exponent);
        policy->generate_t0 = ldexpf(policy->generate_t0, -exponent);
        policy->generate_step = ldexpf(policy->generate_step, -exponent);
        float t =
            policy->generate_t0 + policy->generate_step * (float)gn_random_below(&run->random, SURFACES);
        ray->tmin = end_value(&run->random, params->tmin, t);
        ray->tmax = end_value(&run->random, params->tmax, t);
        if (params->tmin == OTHER)
            ray->tmin = ray->tmax;
        if (params->tmax == OTHER)
            ray->tmax = ray->tmin;
    }
    gn_case_trace(run, &scene, params->program, rays, count, 0);
}

#define CASE(label, spec, ...)                                                                               \
    {                                                                                                        \
        "trange." label, spec, triangles, &(const struct params){__VA_ARGS__}, 0                             \
    }
#define BOX(label, ...)                                                                                      \
    {                                                                                                        \
        "trange.boxes." label, SPEC_CLOSED, boxes, &(const struct box_params){__VA_ARGS__}, 0                \
    }
#define BOTH(label, spec, ...)                                                                               \
    CASE("axis." label, spec, false, __VA_ARGS__), CASE("tilted." label, spec, true, __VA_ARGS__)

static const struct gn_case cases[] = {
    BOTH("tmin_at", SPEC_OPEN, false, AT, FAR, -2, 2, GN_CTS_COMMITTED, 1),
    BOTH("tmax_at", SPEC_OPEN, false, START, AT, -2, 2, GN_CTS_COMMITTED, 1),
    BOTH("tmin_near", SPEC_OPEN, false, NEAR, FAR, -2, 2, GN_CTS_COMMITTED, 1),
    BOTH("tmax_near", SPEC_OPEN, false, START, NEAR, -2, 2, GN_CTS_COMMITTED, 1),
    BOTH("tmin_clear", SPEC_RANGE, false, CLEAR, FAR, -2, 2, GN_CTS_COMMITTED, 1),
    BOTH("tmax_clear", SPEC_RANGE, false, START, CLEAR, -2, 2, GN_CTS_COMMITTED, 1),
    BOTH("tmax_clear_candidates", SPEC_RANGE, false, START, CLEAR, -2, 2, GN_CTS_CANDIDATES, 0),
    BOTH("empty", SPEC_OPEN, false, NEAR, OTHER, -2, 2, GN_CTS_COMMITTED, 1),
    CASE("empty_at_zero", SPEC_OPEN, true, true, START, START, -2, 2, GN_CTS_COMMITTED, 1),
    BOTH("on_surface", SPEC_OPEN, true, START, INFINITE, -2, 2, GN_CTS_COMMITTED, 1),
    CASE("infinite", SPEC_RANGE, true, false, START, INFINITE, -2, 2, GN_CTS_COMMITTED, 1),
    CASE("largest", SPEC_RANGE, true, false, SMALLEST, LARGEST, -2, 2, GN_CTS_COMMITTED, 1),
    CASE("small_directions", SPEC_RANGE, true, false, CLEAR, INFINITE, -40, -20, GN_CTS_COMMITTED, 1),
    CASE("large_directions", SPEC_RANGE, true, false, START, CLEAR, 20, 40, GN_CTS_COMMITTED, 1),
    {"trange.windows", SPEC_RANGE, windows, NULL, 1},
    {"trange.windows_candidates", SPEC_RANGE, windows, NULL, 0},
    BOX("tmin_at_exit", EXIT, AT, FAR, -2, 2, GN_CTS_COMMITTED),
    BOX("tmin_at_exit_candidates", EXIT, AT, FAR, -2, 2, GN_CTS_CANDIDATES),
    BOX("tmax_at_entry", ENTRY, START, AT, -2, 2, GN_CTS_CANDIDATES),
    BOX("tmin_clear", EXIT, CLEAR, FAR, 0, 0, GN_CTS_CANDIDATES),
    BOX("tmax_clear", ENTRY, START, CLEAR, 0, 0, GN_CTS_CANDIDATES),
    BOX("inside", MIDDLE, AT, INFINITE, -2, 2, GN_CTS_COMMITTED),
    BOX("point_inside", MIDDLE, AT, OTHER, -2, 2, GN_CTS_CANDIDATES),
    BOX("point_on_face", ENTRY, AT, OTHER, -2, 2, GN_CTS_CANDIDATES),
};
const struct gn_case_family gn_family_trange = {"trange", cases, sizeof cases / sizeof cases[0]};
