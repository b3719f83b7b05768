/* SPDX-License-Identifier: Apache-2.0 */
/* Rays aimed at meshes, transforms, and the plainest scenes around a mesh. */
#include "cts/generate.h"

#include <math.h>
#include <string.h>

#define PI 3.14159265358979323846

const float gn_identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Uniform on the unit sphere. */
static void random_direction(struct gn_random *random, double out[3])
{
    double length2;
    do {
        for (int c = 0; c < 3; c++)
            out[c] = gn_random_range(random, -1, 1);
        length2 = dot(out, out);
    } while (length2 > 1 || length2 < 0.01);
    for (int c = 0; c < 3; c++)
        out[c] /= sqrt(length2);
}

static double determinant(const float m[12])
{
    return m[0] * ((double)m[5] * m[10] - (double)m[6] * m[9]) - m[1] * ((double)m[4] * m[10] - (double)m[6] * m[8]) +
           m[2] * ((double)m[4] * m[9] - (double)m[5] * m[8]);
}

void gn_transform_inverse_apply(const float transform[12], const double v[3], bool transposed, double out[3])
{
    const double in[3] = {v[0], v[1], v[2]};
    double a[3][3], cofactor[3][3], determinant = 0;
    for (int i = 0; i < 9; i++)
        a[i / 3][i % 3] = (double)transform[i / 3 * 4 + i % 3];
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            cofactor[r][c] = a[(r + 1) % 3][(c + 1) % 3] * a[(r + 2) % 3][(c + 2) % 3] -
                             a[(r + 1) % 3][(c + 2) % 3] * a[(r + 2) % 3][(c + 1) % 3];
    for (int c = 0; c < 3; c++)
        determinant += a[0][c] * cofactor[0][c];
    for (int i = 0; i < 3; i++) {
        out[i] = 0;
        for (int k = 0; k < 3; k++)
            out[i] += (transposed ? cofactor[i][k] : cofactor[k][i]) * in[k] / determinant;
    }
}

void gn_transform_point(const float *transform, const double point[3], double out[3])
{
    double in[3] = {point[0], point[1], point[2]};
    for (int r = 0; r < 3; r++) {
        const float *row = transform + 4 * r;
        out[r] = row[0] * in[0] + row[1] * in[1] + row[2] * in[2] + row[3];
    }
}

static bool triangle_active(const struct gn_mesh *mesh, uint32_t triangle)
{
    for (int k = 0; k < 3; k++)
        if (isnan(mesh->positions[mesh->triangles[triangle][k]][0]))
            return false;
    return true;
}

static uint32_t random_triangle(struct gn_random *random, const struct gn_mesh *mesh, uint32_t first, uint32_t count)
{
    for (;;) {
        uint32_t triangle = first + gn_random_below(random, count);
        if (triangle_active(mesh, triangle))
            return triangle;
    }
}

/* Weights of the corners. A vertex or an edge is any of the triangle's three. */
static void random_weights(struct gn_random *random, enum gn_aim aim, double out[3])
{
    uint32_t k = gn_random_below(random, 3);
    out[0] = out[1] = out[2] = 0;
    if (aim == GN_AIM_VERTEX) {
        out[k] = 1;
    } else if (aim == GN_AIM_EDGE) {
        out[k] = gn_random_unit(random);
        out[(k + 1) % 3] = 1 - out[k];
    } else {
        /* Uniform, but not at the rim: an interior ray is to stay one after rounding. */
        double a = gn_random_unit(random), b = gn_random_unit(random);
        if (a + b > 1) {
            a = 1 - a;
            b = 1 - b;
        }
        out[0] = 0.01 + 0.97 * a;
        out[1] = 0.01 + 0.97 * b;
        out[2] = 1 - out[0] - out[1];
    }
}

struct gn_cts_ray gn_ray_make(const double origin[3], const double direction[3], double tmax)
{
    struct gn_cts_ray ray = {0};
    for (int c = 0; c < 3; c++) {
        ray.ray.origin[c] = (float)origin[c];
        ray.ray.direction[c] = (float)direction[c];
    }
    ray.ray.tmax = (float)tmax;
    ray.ray.cull_mask = 0xFF;
    ray.policy.confirm_mask = UINT32_MAX;
    ray.policy.generate_mask = UINT32_MAX;
    return ray;
}

struct placement {
    const float *geometry, *instance;
    bool mirrored;
};

static void place(const struct placement *placement, const double point[3], double out[3])
{
    memcpy(out, point, 3 * sizeof *out);
    if (placement->geometry)
        gn_transform_point(placement->geometry, out, out);
    if (placement->instance)
        gn_transform_point(placement->instance, out, out);
}

static void bounds_of(const struct gn_mesh *mesh, const struct placement *placement, double low[3], double high[3])
{
    for (int c = 0; c < 3; c++) {
        low[c] = INFINITY;
        high[c] = -INFINITY;
    }
    for (uint32_t v = 0; v < mesh->position_count; v++) {
        if (isnan(mesh->positions[v][0]))
            continue;
        double p[3];
        place(placement, mesh->positions[v], p);
        for (int c = 0; c < 3; c++) {
            low[c] = fmin(low[c], p[c]);
            high[c] = fmax(high[c], p[c]);
        }
    }
}

/* A unit vector whose cosine with `normal` (any length) is in the range; normal's zero length gives any. */
static void way_back(struct gn_random *random, const double normal[3], double min_cosine, double max_cosine,
                     double out[3])
{
    double length = sqrt(dot(normal, normal));
    if (!(length > 0)) {
        random_direction(random, out);
        return;
    }
    double unit[3], side[3], other[3], any[3];
    for (int c = 0; c < 3; c++)
        unit[c] = normal[c] / length;
    do {
        random_direction(random, any);
        cross(unit, any, side);
    } while (dot(side, side) < 0.01);
    cross(unit, side, other);
    double cosine = gn_random_range(random, min_cosine, max_cosine);
    double sine = sqrt(fmax(0, 1 - cosine * cosine)), scale = sine / sqrt(dot(side, side));
    double angle = gn_random_range(random, 0, 2 * PI);
    for (int c = 0; c < 3; c++)
        out[c] = cosine * unit[c] + scale * (cos(angle) * side[c] + sin(angle) * other[c]);
}

void gn_rays_aimed_with(struct gn_random *random, const struct gn_mesh *mesh, const struct gn_aim_options *options,
                        struct gn_cts_ray *rays, uint32_t count)
{
    struct placement placement = {options->geometry_transform, options->instance_transform, false};
    placement.mirrored = placement.instance && determinant(placement.instance) < 0;
    double distance = options->distance ? options->distance : 4;
    double scale = options->direction_scale ? options->direction_scale : 1;
    double min_cosine = options->min_cosine ? options->min_cosine : 0.15;
    double max_cosine = options->max_cosine ? options->max_cosine : 1;
    uint32_t first = options->triangle_count ? options->first_triangle : 0;
    uint32_t triangles = options->triangle_count ? options->triangle_count : mesh->triangle_count;
    double low[3] = {0}, high[3] = {0};
    if (options->aim == GN_AIM_RANDOM)
        bounds_of(mesh, &placement, low, high);
    for (uint32_t i = 0; i < count; i++) {
        double target[3], normal[3] = {0}, back[3], origin[3], direction[3];
        if (options->aim == GN_AIM_RANDOM) {
            for (int c = 0; c < 3; c++) {
                double grown = (high[c] - low[c]) / 8;
                target[c] = gn_random_range(random, low[c] - grown, high[c] + grown);
            }
        } else {
            const uint32_t *corner = mesh->triangles[random_triangle(random, mesh, first, triangles)];
            double p[3][3], e[2][3], weight[3];
            for (int k = 0; k < 3; k++)
                place(&placement, mesh->positions[corner[k]], p[k]);
            random_weights(random, options->aim, weight);
            for (int c = 0; c < 3; c++) {
                target[c] = weight[0] * p[0][c] + weight[1] * p[1][c] + weight[2] * p[2][c];
                e[0][c] = p[1][c] - p[0][c];
                e[1][c] = p[2][c] - p[0][c];
            }
            cross(e[0], e[1], normal);
            bool turn = placement.mirrored != (options->both_sides && gn_random_below(random, 2));
            for (int c = 0; turn && c < 3; c++)
                normal[c] = -normal[c];
        }
        way_back(random, normal, min_cosine, max_cosine, back);
        double away = distance * gn_random_range(random, 0.75, 1.25);
        for (int c = 0; c < 3; c++) {
            origin[c] = (double)(float)(target[c] + away * back[c]);
            direction[c] = scale * (target[c] - origin[c]);
        }
        rays[i] = gn_ray_make(origin, direction, fmax(10, 10 * distance) / scale);
    }
}

void gn_rays_aimed(struct gn_random *random, const struct gn_mesh *mesh, const float *geometry_transform,
                   const float *instance_transform, enum gn_aim aim, double distance, bool both_sides,
                   struct gn_cts_ray *rays, uint32_t count)
{
    struct gn_aim_options options = {0};
    options.geometry_transform = geometry_transform;
    options.instance_transform = instance_transform;
    options.aim = aim;
    options.distance = distance;
    options.both_sides = both_sides;
    gn_rays_aimed_with(random, mesh, &options, rays, count);
}

/* Sixteenths that sum to 1, all above zero for interior targets. */
static void lattice_weights(struct gn_random *random, enum gn_aim aim, double out[3])
{
    uint32_t k = gn_random_below(random, 3);
    out[0] = out[1] = out[2] = 0;
    if (aim == GN_AIM_VERTEX) {
        out[k] = 1;
    } else if (aim == GN_AIM_EDGE) {
        out[k] = (1 + gn_random_below(random, 15)) / 16.0;
        out[(k + 1) % 3] = 1 - out[k];
    } else {
        uint32_t a = 1 + gn_random_below(random, 14), b = 1 + gn_random_below(random, 15 - a);
        out[k] = a / 16.0;
        out[(k + 1) % 3] = b / 16.0;
        out[(k + 2) % 3] = (16 - a - b) / 16.0;
    }
}

static bool exact_f32(const double v[3])
{
    for (int c = 0; c < 3; c++)
        if ((double)(float)v[c] != v[c])
            return false;
    return true;
}

static void rays_lattice(struct gn_random *random, const struct gn_mesh *mesh, enum gn_aim aim, bool both_sides,
                         struct gn_cts_ray *rays, uint32_t count)
{
    for (uint32_t i = 0; i < count;) {
        const uint32_t *corner = mesh->triangles[random_triangle(random, mesh, 0, mesh->triangle_count)];
        const double *a = mesh->positions[corner[0]], *b = mesh->positions[corner[1]], *c = mesh->positions[corner[2]];
        enum gn_aim kind = aim == GN_AIM_RANDOM ? (enum gn_aim)gn_random_below(random, 3) : aim;
        double weight[3], target[3], direction[3], origin[3], e[2][3], normal[3];
        lattice_weights(random, kind, weight);
        /* Whole numbers in +-16 over 2^k: of length 1/4 to 14. */
        double unit = ldexp(1, -(int)(1 + gn_random_below(random, 4)));
        double steps = 1 + gn_random_below(random, 8);
        for (int k = 0; k < 3; k++) {
            target[k] = weight[0] * a[k] + weight[1] * b[k] + weight[2] * c[k];
            direction[k] = unit * ((double)gn_random_below(random, 33) - 16);
            origin[k] = target[k] - steps * direction[k];
            e[0][k] = b[k] - a[k];
            e[1][k] = c[k] - a[k];
        }
        cross(e[0], e[1], normal);
        double facing = dot(direction, normal);
        if (facing > 0 && !both_sides) {
            for (int k = 0; k < 3; k++) {
                direction[k] = -direction[k];
                origin[k] = target[k] - steps * direction[k];
            }
        }
        double sizes = sqrt(dot(direction, direction) * dot(normal, normal));
        if (!(fabs(facing) > 0.05 * sizes) || !exact_f32(target) || !exact_f32(origin))
            continue;
        rays[i++] = gn_ray_make(origin, direction, 100);
    }
}

/* Whether the ray of a lattice is aimed at this point. */
static bool aimed_at(const struct gn_ref_ray *ray, const double point[3])
{
    for (int steps = 1; steps <= 8; steps++) {
        bool meets = true;
        for (int c = 0; c < 3; c++)
            meets = meets && ray->origin[c] + steps * (double)ray->direction[c] == point[c];
        if (meets)
            return true;
    }
    return false;
}

void gn_rays_lattice(struct gn_random *random, const struct gn_mesh *mesh, enum gn_aim aim,
                     struct gn_cts_ray *rays, uint32_t count)
{
    rays_lattice(random, mesh, aim, false, rays, count);
}

void gn_ray_lattice_at(struct gn_random *random, const struct gn_mesh *mesh, uint32_t vertex, struct gn_cts_ray *ray)
{
    do
        gn_rays_lattice(random, mesh, GN_AIM_VERTEX, ray, 1);
    while (!aimed_at(&ray->ray, mesh->positions[vertex]));
}

void gn_rays_lattice_both_sides(struct gn_random *random, const struct gn_mesh *mesh, enum gn_aim aim,
                                struct gn_cts_ray *rays, uint32_t count)
{
    rays_lattice(random, mesh, aim, true, rays, count);
}

/* Sums of a product of two f32 with a few more are exact in double only while the exponents are near, which
 * they are for the transforms this is meant for: the round trip through the error-free parts decides. */
static bool move_vector(const float *transform, const float in[3], double w, float out[3])
{
    for (int r = 0; r < 3; r++) {
        const float *row = transform + 4 * r;
        double term[4] = {(double)row[0] * in[0], (double)row[1] * in[1], (double)row[2] * in[2], row[3] * w};
        double sum = 0;
        for (int k = 0; k < 4; k++) {
            double next = sum + term[k], part = next - sum;
            if ((sum - (next - part)) + (term[k] - part) != 0)
                return false;
            sum = next;
        }
        out[r] = (float)sum;
        if ((double)out[r] != sum)
            return false;
    }
    return true;
}

bool gn_rays_move_exactly(struct gn_cts_ray *rays, uint32_t count, const float transform[12])
{
    for (int pass = 0; pass < 2; pass++) {
        for (uint32_t i = 0; i < count; i++) {
            float origin[3], direction[3];
            if (!move_vector(transform, rays[i].ray.origin, 1, origin) ||
                !move_vector(transform, rays[i].ray.direction, 0, direction))
                return false;
            if (pass) {
                memcpy(rays[i].ray.origin, origin, sizeof origin);
                memcpy(rays[i].ray.direction, direction, sizeof direction);
            }
        }
    }
    return true;
}

void gn_rays_shuffle(struct gn_random *random, struct gn_cts_ray *rays, uint32_t count)
{
    for (uint32_t i = count; i > 1; i--) {
        uint32_t j = gn_random_below(random, i);
        struct gn_cts_ray swap = rays[i - 1];
        rays[i - 1] = rays[j];
        rays[j] = swap;
    }
}

struct gn_cts_geometry gn_geometry_of_mesh(const struct gn_mesh *mesh)
{
    struct gn_cts_geometry geometry = {0};
    geometry.type = GN_REF_TRIANGLES;
    geometry.positions = (const double (*)[3])mesh->positions;
    geometry.position_count = mesh->position_count;
    geometry.triangles = (const uint32_t (*)[3])mesh->triangles;
    geometry.triangle_count = mesh->triangle_count;
    return geometry;
}

struct gn_cts_instance gn_instance_of(uint32_t blas, const float *transform)
{
    struct gn_cts_instance instance = {0};
    memcpy(instance.transform, transform ? transform : gn_identity, sizeof instance.transform);
    instance.mask = 0xFF;
    instance.blas = blas;
    return instance;
}

struct gn_cts_scene gn_scene_of_geometries(struct gn_arena *arena, const struct gn_cts_geometry *geometries,
                                           uint32_t geometry_count, const struct gn_cts_instance *instances,
                                           uint32_t instance_count)
{
    struct gn_cts_scene scene = {0};
    struct gn_cts_geometry *geometry_copy = GN_NEW(arena, struct gn_cts_geometry, geometry_count);
    struct gn_cts_blas *blas = GN_NEW(arena, struct gn_cts_blas, 1);
    struct gn_cts_instance *instance_copy = GN_NEW(arena, struct gn_cts_instance, instance_count);
    memcpy(geometry_copy, geometries, geometry_count * sizeof *geometry_copy);
    memcpy(instance_copy, instances, instance_count * sizeof *instance_copy);
    blas->geometries = geometry_copy;
    blas->geometry_count = geometry_count;
    scene.blases = blas;
    scene.blas_count = 1;
    scene.instances = instance_copy;
    scene.instance_count = instance_count;
    return scene;
}

struct gn_cts_scene gn_scene_of_geometry(struct gn_arena *arena, const struct gn_cts_geometry *geometry)
{
    struct gn_cts_instance instance = gn_instance_of(0, NULL);
    return gn_scene_of_geometries(arena, geometry, 1, &instance, 1);
}

static void rotation(struct gn_random *random, double out[9])
{
    double axis[3], angle = gn_random_range(random, 0, 2 * PI), c = cos(angle), s = sin(angle);
    random_direction(random, axis);
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        out[3 * i + i] = c + (1 - c) * axis[i] * axis[i];
        out[3 * i + j] = (1 - c) * axis[i] * axis[j] - s * axis[k];
        out[3 * i + k] = (1 - c) * axis[i] * axis[k] + s * axis[j];
    }
}

static double random_scale(struct gn_random *random, double min_scale, double max_scale)
{
    return min_scale * pow(max_scale / min_scale, gn_random_unit(random));
}

void gn_transform_random(struct gn_random *random, double min_scale, double max_scale, double translation,
                         bool mirrored, float out[12])
{
    double turn[9], scale[3];
    rotation(random, turn);
    for (int k = 0; k < 3; k++)
        scale[k] = random_scale(random, min_scale, max_scale);
    if (mirrored)
        scale[gn_random_below(random, 3)] *= -1;
    for (int r = 0; r < 3; r++) {
        for (int k = 0; k < 3; k++)
            out[4 * r + k] = (float)(turn[3 * r + k] * scale[k]);
        out[4 * r + 3] = (float)gn_random_range(random, -translation, translation);
    }
}

void gn_transform_general(struct gn_random *random, double min_scale, double max_scale, double shear,
                          double translation, bool mirrored, float out[12])
{
    float outer[12];
    double inner[9];
    gn_transform_random(random, min_scale, max_scale, translation, mirrored, outer);
    rotation(random, inner);
    double y = gn_random_range(random, -shear, shear), z = gn_random_range(random, -shear, shear);
    for (int k = 0; k < 3; k++)
        inner[k] += y * inner[3 + k] + z * inner[6 + k];
    for (int r = 0; r < 3; r++) {
        for (int k = 0; k < 3; k++) {
            const float *row = outer + 4 * r;
            out[4 * r + k] = (float)(row[0] * inner[k] + row[1] * inner[3 + k] + row[2] * inner[6 + k]);
        }
        out[4 * r + 3] = outer[4 * r + 3];
    }
}

void gn_transform_dyadic(struct gn_random *random, bool mirrored, float out[12])
{
    memset(out, 0, 12 * sizeof *out);
    uint32_t start = gn_random_below(random, 3), turn = gn_random_below(random, 2), signs = gn_random_below(random, 8);
    int exponent = (int)gn_random_below(random, 7) - 3;
    for (uint32_t r = 0; r < 3; r++) {
        uint32_t column = turn ? (start + r) % 3 : (start + 3 - r) % 3;
        out[4 * r + column] = (float)ldexp(signs >> r & 1 ? -1 : 1, exponent);
        out[4 * r + 3] = (float)((double)gn_random_below(random, 65) - 32) / 8;
    }
    if ((determinant(out) < 0) != mirrored)
        for (int k = 0; k < 3; k++)
            out[k] = -out[k];
}

const float *gn_transform_of(struct gn_random *random, const struct gn_transform_spec *spec, float out[12])
{
    double min_scale = spec->min_scale ? spec->min_scale : 1, max_scale = spec->max_scale ? spec->max_scale : 1;
    switch (spec->kind) {
    case GN_TRANSFORM_NONE:
        return NULL;
    case GN_TRANSFORM_RANDOM:
        gn_transform_random(random, min_scale, max_scale, spec->translation, spec->mirrored, out);
        break;
    case GN_TRANSFORM_GENERAL:
        gn_transform_general(random, min_scale, max_scale, spec->shear, spec->translation, spec->mirrored, out);
        break;
    case GN_TRANSFORM_DYADIC:
        gn_transform_dyadic(random, spec->mirrored, out);
        break;
    }
    return out;
}
