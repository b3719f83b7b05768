/* SPDX-License-Identifier: Apache-2.0 */
/* The scenes and rays of the proof. */
#include "families.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

uint64_t rng_bits(struct rng *rng)
{
    uint64_t z = rng->state += 0x9E3779B97F4A7C15u;
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9u;
    z = (z ^ z >> 27) * 0x94D049BB133111EBu;
    return z ^ z >> 31;
}

double rng_unit(struct rng *rng)
{
    return (double)(rng_bits(rng) >> 11) * 0x1p-53;
}

uint32_t rng_below(struct rng *rng, uint32_t n)
{
    return (uint32_t)((rng_bits(rng) >> 32) * n >> 32);
}

/* [-1, 1) */
static double symmetric(struct rng *rng)
{
    return 2 * rng_unit(rng) - 1;
}

const char *const aim_names[AIM_COUNT] = {"interior", "edge", "vertex", "random"};

static void *owned(struct made_scene *made, size_t bytes)
{
    void *memory = calloc(1, bytes ? bytes : 1);
    if (!memory || made->owned_count == 64)
        abort();
    made->owned[made->owned_count++] = memory;
    return memory;
}

void made_scene_free(struct made_scene *made)
{
    for (int i = 0; i < made->owned_count; i++)
        free(made->owned[i]);
    made->owned_count = 0;
}

static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

static struct gn_ref_instance plain_instance(uint32_t blas)
{
    struct gn_ref_instance instance = {.mask = 0xFF, .blas = blas};
    memcpy(instance.transform, identity, sizeof identity);
    return instance;
}

struct mesh {
    double (*positions)[3];
    uint32_t (*triangles)[3];
    uint32_t position_count, triangle_count;
};

static struct mesh new_mesh(struct made_scene *made, uint32_t positions, uint32_t triangles)
{
    return (struct mesh){owned(made, positions * sizeof(double[3])), owned(made, triangles * sizeof(uint32_t[3])),
                         positions, triangles};
}

static struct gn_ref_geometry geometry_of_mesh(const struct mesh *mesh)
{
    return (struct gn_ref_geometry){.type = GN_REF_TRIANGLES, .primitive_count = mesh->triangle_count, .divisor = 1,
                                    .positions = (const double (*)[3])mesh->positions,
                                    .position_count = mesh->position_count,
                                    .triangles = (const uint32_t (*)[3])mesh->triangles};
}

static void round_mesh(struct mesh *mesh)
{
    for (uint32_t i = 0; i < mesh->position_count; i++)
        for (int j = 0; j < 3; j++)
            mesh->positions[i][j] = (float)mesh->positions[i][j];
}

static void one_mesh(struct made_scene *made, const struct mesh *mesh)
{
    made->scene.geometries[0] = geometry_of_mesh(mesh);
    made->scene.blas_first[1] = 1;
    made->scene.blas_count = 1;
    made->scene.instances[0] = plain_instance(0);
    made->scene.instance_count = 1;
    made->extent = 1;
}

static struct mesh height_field(struct made_scene *made, struct rng *rng, uint32_t n, bool lattice)
{
    struct mesh mesh = new_mesh(made, (n + 1) * (n + 1), 2 * n * n);
    for (uint32_t y = 0; y <= n; y++)
        for (uint32_t x = 0; x <= n; x++) {
            double *p = mesh.positions[y * (n + 1) + x];
            double cell = lattice ? 0x1p-5 : 2.0 / n;
            p[0] = (x - n / 2.0) * cell;
            p[1] = (y - n / 2.0) * cell;
            p[2] = lattice ? rng_below(rng, 9) * 0x1p-6 : rng_unit(rng) * 0.1;
            if (!lattice) {
                p[0] += cell * 0.3 * symmetric(rng);
                p[1] += cell * 0.3 * symmetric(rng);
            }
        }
    uint32_t k = 0;
    for (uint32_t y = 0; y < n; y++)
        for (uint32_t x = 0; x < n; x++) {
            uint32_t a = y * (n + 1) + x, b = a + 1, c = a + n + 1, d = c + 1;
            uint32_t both[2][2][3] = {{{a, b, d}, {a, d, c}}, {{a, b, c}, {b, d, c}}};
            memcpy(mesh.triangles[k], both[(x ^ y) & 1], sizeof both[0]);
            k += 2;
        }
    round_mesh(&mesh);
    return mesh;
}

static uint32_t side_of(uint32_t triangles)
{
    uint32_t n = (uint32_t)sqrt(triangles / 2.0);
    return n < 2 ? 2 : n;
}

void make_height_field(struct made_scene *made, struct rng *rng, uint32_t n, bool lattice)
{
    struct mesh mesh = height_field(made, rng, n, lattice);
    one_mesh(made, &mesh);
    made->grid = lattice ? 0x1p-6 : 0;
}

static void make_field(struct made_scene *made, struct rng *rng, uint32_t triangles)
{
    make_height_field(made, rng, side_of(triangles), false);
}

static void make_lattice(struct made_scene *made, struct rng *rng, uint32_t triangles)
{
    make_height_field(made, rng, side_of(triangles), true);
}

/* Triangles that share a few hub vertices, long and thin: aspects from 10 to 1e8. */
static void make_slivers(struct made_scene *made, struct rng *rng, uint32_t triangles)
{
    struct mesh mesh = new_mesh(made, 3 * triangles, triangles);
    for (uint32_t i = 0; i < triangles; i++) {
        double *p = mesh.positions[3 * i], thin = pow(10, -1 - 7 * rng_unit(rng));
        if (i > 0 && rng_below(rng, 3) > 0) {
            /* Shares an edge with one before. */
            uint32_t other = rng_below(rng, i), corner = rng_below(rng, 3);
            mesh.triangles[i][0] = mesh.triangles[other][(corner + 1) % 3];
            mesh.triangles[i][1] = mesh.triangles[other][corner];
            const double *a = mesh.positions[mesh.triangles[i][0]], *b = mesh.positions[mesh.triangles[i][1]];
            for (int j = 0; j < 3; j++)
                p[j] = a[j] + rng_unit(rng) * (b[j] - a[j]) + thin * symmetric(rng);
            mesh.triangles[i][2] = 3 * i;
            continue;
        }
        for (int j = 0; j < 3; j++) {
            p[j] = symmetric(rng);
            p[3 + j] = symmetric(rng);
            p[6 + j] = p[j] + 0.5 * (p[3 + j] - p[j]) + thin * symmetric(rng);
            mesh.triangles[i][j] = 3 * i + (uint32_t)j;
        }
    }
    round_mesh(&mesh);
    one_mesh(made, &mesh);
}

static struct mesh soup(struct made_scene *made, struct rng *rng, uint32_t triangles, double size, bool degenerate)
{
    struct mesh mesh = new_mesh(made, 3 * triangles, triangles);
    for (uint32_t i = 0; i < triangles; i++) {
        double centre[3] = {symmetric(rng), symmetric(rng), symmetric(rng)};
        for (int v = 0; v < 3; v++)
            for (int j = 0; j < 3; j++)
                mesh.positions[3 * i + (uint32_t)v][j] = centre[j] + size * symmetric(rng);
        for (uint32_t v = 0; v < 3; v++)
            mesh.triangles[i][v] = 3 * i + v;
        if (!degenerate)
            continue;
        double (*p)[3] = &mesh.positions[3 * i];
        switch (rng_below(rng, 12)) {
        case 0: /* a point */
            memcpy(p[1], p[0], sizeof p[0]);
            memcpy(p[2], p[0], sizeof p[0]);
            break;
        case 1: /* a line: the middle, exactly when the sum of two f32 is even */
            for (int j = 0; j < 3; j++) {
                p[0][j] = rint(p[0][j] * 256) / 256;
                p[1][j] = rint(p[1][j] * 256) / 256;
                p[2][j] = (p[0][j] + p[1][j]) / 2;
            }
            break;
        case 2: /* one index twice */
            mesh.triangles[i][2] = mesh.triangles[i][rng_below(rng, 2)];
            break;
        case 3: /* inactive */
            p[rng_below(rng, 3)][0] = NAN;
            break;
        case 4: /* the one before again: coincident, perhaps turned over */
            if (i > 0) {
                uint32_t turn = rng_below(rng, 2);
                for (uint32_t v = 0; v < 3; v++)
                    mesh.triangles[i][v] = mesh.triangles[i - 1][turn ? 2 - v : (v + 1) % 3];
            }
            break;
        case 5: /* parallel to an axis */
            p[1][2] = p[2][2] = p[0][2];
            break;
        default:
            break;
        }
    }
    round_mesh(&mesh);
    return mesh;
}

static void make_soup(struct made_scene *made, struct rng *rng, uint32_t triangles)
{
    struct mesh mesh = soup(made, rng, triangles, 0.15, true);
    one_mesh(made, &mesh);
}

static void make_far(struct made_scene *made, struct rng *rng, uint32_t triangles)
{
    struct mesh mesh = height_field(made, rng, side_of(triangles), false);
    double offset[3], size = pow(10, 1 + 5 * rng_unit(rng));
    for (int j = 0; j < 3; j++)
        offset[j] = size * symmetric(rng);
    for (uint32_t i = 0; i < mesh.position_count; i++)
        for (int j = 0; j < 3; j++)
            mesh.positions[i][j] += offset[j];
    round_mesh(&mesh);
    one_mesh(made, &mesh);
}

static void make_mixed_scales(struct made_scene *made, struct rng *rng, uint32_t triangles)
{
    struct mesh mesh = new_mesh(made, 3 * triangles, triangles);
    for (uint32_t i = 0; i < triangles; i++) {
        double size = ldexp(1, (int)rng_below(rng, 40) - 24);
        double centre[3] = {symmetric(rng), symmetric(rng), symmetric(rng)};
        uint32_t other = i ? rng_below(rng, i) : 0;
        for (uint32_t v = 0; v < 3; v++) {
            for (int j = 0; j < 3; j++)
                mesh.positions[3 * i + v][j] = centre[j] * fmax(size, 0.5) + size * symmetric(rng);
            mesh.triangles[i][v] = 3 * i + v;
        }
        if (i && rng_below(rng, 2))
            mesh.triangles[i][0] = mesh.triangles[other][rng_below(rng, 3)];
    }
    round_mesh(&mesh);
    one_mesh(made, &mesh);
}

/* From 2^-100 to 2^100, where squares leave f32 and triple products need f64's range. */
static void make_any_scale(struct made_scene *made, struct rng *rng, uint32_t triangles)
{
    bool lattice = rng_below(rng, 2);
    int exponent = rng_below(rng, 4) == 0 ? -(int)rng_below(rng, 20) - 110 : (int)rng_below(rng, 201) - 100;
    make_height_field(made, rng, side_of(triangles), lattice);
    double (*p)[3] = (double (*)[3])made->scene.geometries[0].positions;
    for (uint32_t i = 0; i < made->scene.geometries[0].position_count; i++)
        for (int j = 0; j < 3; j++)
            p[i][j] = (float)ldexp(p[i][j], exponent);
    made->extent = ldexp(1, exponent);
    made->grid = lattice ? ldexp(0x1p-6, exponent) : 0;
}

/* A closed mesh around the origin; its poles are closed fans. */
static void make_blob(struct made_scene *made, struct rng *rng, uint32_t triangles)
{
    uint32_t rings = (uint32_t)sqrt(triangles / 4.0) + 1, sectors = 2 * rings;
    struct mesh mesh = new_mesh(made, 2 + rings * sectors, 2 * sectors * rings);
    double bump = rng_unit(rng) < 0.5 ? 0 : 0.3;
    mesh.positions[0][2] = 1;
    mesh.positions[1][2] = -1;
    for (uint32_t r = 0; r < rings; r++)
        for (uint32_t s = 0; s < sectors; s++) {
            double theta = M_PI * (r + 1) / (rings + 1), phi = 2 * M_PI * s / sectors;
            double radius = 1 + bump * symmetric(rng), *p = mesh.positions[2 + r * sectors + s];
            p[0] = radius * sin(theta) * cos(phi);
            p[1] = radius * sin(theta) * sin(phi);
            p[2] = radius * cos(theta);
        }
    uint32_t k = 0;
    for (uint32_t s = 0; s < sectors; s++) {
        uint32_t next = (s + 1) % sectors, last = 2 + (rings - 1) * sectors;
        uint32_t top[3] = {0, 2 + s, 2 + next}, bottom[3] = {1, last + next, last + s};
        memcpy(mesh.triangles[k++], top, sizeof top);
        memcpy(mesh.triangles[k++], bottom, sizeof bottom);
        for (uint32_t r = 0; r + 1 < rings; r++) {
            uint32_t a = 2 + r * sectors + s, b = 2 + r * sectors + next, c = a + sectors, d = b + sectors;
            uint32_t first[3] = {a, c, b}, second[3] = {b, c, d};
            memcpy(mesh.triangles[k++], first, sizeof first);
            memcpy(mesh.triangles[k++], second, sizeof second);
        }
    }
    mesh.triangle_count = k;
    round_mesh(&mesh);
    one_mesh(made, &mesh);
}

static void random_transform(struct rng *rng, double spread, float out[12])
{
    for (int i = 0; i < 12; i++)
        out[i] = (float)(i % 4 == 3 ? 2 * symmetric(rng) : symmetric(rng));
    switch (rng_below(rng, 6)) {
    case 0: { /* a rotation, perhaps mirrored */
        double angle = 6.283 * rng_unit(rng), mirror = rng_below(rng, 2) ? 1 : -1;
        float m[12] = {(float)cos(angle), (float)-sin(angle), 0, out[3], (float)sin(angle), (float)cos(angle), 0, out[7],
                       0, 0, (float)mirror, out[11]};
        memcpy(out, m, sizeof m);
        break;
    }
    case 1: { /* a scale along each axis */
        float m[12] = {0};
        for (int i = 0; i < 3; i++) {
            m[5 * i] = (float)((rng_below(rng, 2) ? 1 : -1) * pow(10, spread * symmetric(rng)));
            m[4 * i + 3] = out[4 * i + 3];
        }
        memcpy(out, m, sizeof m);
        break;
    }
    case 2: /* a shear of dyadic numbers: world vertices stay exact */
        memcpy(out, identity, sizeof identity);
        out[1] = (float)((int)rng_below(rng, 9) - 4) / 4;
        out[6] = (float)((int)rng_below(rng, 9) - 4) / 4;
        out[3] = (float)((int)rng_below(rng, 9) - 4) / 2;
        if (rng_below(rng, 2))
            out[10] = -1;
        break;
    case 3: /* axes exchanged */
        memset(out, 0, 12 * sizeof *out);
        out[1] = 1;
        out[6] = rng_below(rng, 2) ? 1 : -2;
        out[8] = 0.5f;
        out[3] = 1;
        break;
    default: /* anything, singular with probability 0 */
        break;
    }
}

static void instances(struct made_scene *made, struct rng *rng, uint32_t count, double spread)
{
    made->scene.instance_count = count;
    for (uint32_t i = 0; i < count; i++) {
        made->scene.instances[i] = plain_instance(rng_below(rng, made->scene.blas_count));
        random_transform(rng, spread, made->scene.instances[i].transform);
        made->scene.instances[i].custom_index = rng_below(rng, 1 << 24);
    }
    made->extent = 2;
}

static void make_instanced(struct made_scene *made, struct rng *rng, uint32_t triangles)
{
    uint32_t count = 1 + rng_below(rng, 4), each = triangles / count;
    if (rng_below(rng, 2)) {
        make_height_field(made, rng, side_of(each), rng_below(rng, 2));
        made->grid = 0;
    } else {
        make_blob(made, rng, each);
    }
    instances(made, rng, count, rng_below(rng, 3));
    if (rng_below(rng, 4) == 0 && count > 1)
        made->scene.instances[0].blas = GN_REF_NULL_BLAS;
}

/* A transform of one of the kinds that a search in object space finds hard; `before` are the instances there are. */
static void bad_transform(struct rng *rng, const struct gn_ref_instance *before, uint32_t count, float out[12])
{
    random_transform(rng, 1, out);
    switch (rng_below(rng, 7)) {
    case 0: { /* from 1e-6 to 1e6 */
        double scale = pow(10, 6 * symmetric(rng));
        for (int i = 0; i < 12; i++)
            out[i] = (float)(out[i] * (i % 4 == 3 ? 1 : scale));
        break;
    }
    case 1: /* each axis another scale, mirrored or not */
        for (int c = 0; c < 3; c++) {
            double scale = pow(10, 3 * symmetric(rng)) * (rng_below(rng, 2) ? 1 : -1);
            for (int r = 0; r < 3; r++)
                out[4 * r + c] = (float)(out[4 * r + c] * scale);
        }
        break;
    case 2: { /* a shear of up to 1e4 */
        uint32_t row = rng_below(rng, 3);
        out[4 * row + (row + 1) % 3] += (float)(pow(10, 4 * rng_unit(rng)) * symmetric(rng));
        break;
    }
    case 3: /* far away */
        for (int r = 0; r < 3; r++)
            out[4 * r + 3] = (float)(pow(10, 7 * rng_unit(rng)) * symmetric(rng));
        break;
    case 4: { /* nearly singular, by powers of two down to the last bit of an f32 */
        double a = symmetric(rng), b = symmetric(rng), rest = ldexp(1, -(int)rng_below(rng, 24));
        for (int c = 0; c < 3; c++)
            out[8 + c] = (float)(a * out[c] + b * out[4 + c] + rest * symmetric(rng));
        break;
    }
    case 5: /* where another one is, so that every hit ties */
        if (count > 0)
            memcpy(out, before[rng_below(rng, count)].transform, 12 * sizeof *out);
        break;
    default:
        break;
    }
    double d = (double)out[0] * ((double)out[5] * out[10] - (double)out[6] * out[9]) -
               (double)out[1] * ((double)out[4] * out[10] - (double)out[6] * out[8]) +
               (double)out[2] * ((double)out[4] * out[9] - (double)out[5] * out[8]);
    if (!(fabs(d) > 1e-20))
        memcpy(out, identity, sizeof identity);
}

static void make_many_instances(struct made_scene *made, struct rng *rng, uint32_t triangles)
{
    uint32_t count = 2 + rng_below(rng, ORACLE_INSTANCES - 1), blases = 1 + rng_below(rng, 3), each = triangles / count + 2;
    for (uint32_t b = 0; b < blases; b++) {
        struct mesh mesh = rng_below(rng, 3) ? height_field(made, rng, side_of(each), rng_below(rng, 2))
                                             : soup(made, rng, each, 0.3, true);
        made->scene.geometries[b] = geometry_of_mesh(&mesh);
        made->scene.blas_first[b + 1] = b + 1;
    }
    made->scene.blas_count = blases;
    made->scene.instance_count = count;
    made->extent = 2;
    for (uint32_t i = 0; i < count; i++) {
        struct gn_ref_instance *instance = &made->scene.instances[i];
        *instance = plain_instance(rng_below(rng, 20) ? rng_below(rng, blases) : GN_REF_NULL_BLAS);
        bad_transform(rng, made->scene.instances, i, instance->transform);
        instance->flags = rng_below(rng, 4);
        instance->mask = rng_below(rng, 4) ? 0xFF : rng_below(rng, 256);
    }
}

/* Linear parts whose rows depend on one another but for their last bits. */
static void make_nearly_singular(struct made_scene *made, struct rng *rng, uint32_t triangles)
{
    make_height_field(made, rng, side_of(triangles), false);
    made->scene.instance_count = 1;
    float *m = made->scene.instances[0].transform;
    for (;;) {
        for (int i = 0; i < 12; i++)
            m[i] = (float)symmetric(rng);
        double a = symmetric(rng), b = symmetric(rng);
        for (int c = 0; c < 3; c++)
            m[8 + c] = (float)(a * m[c] + b * m[4 + c] + (rng_below(rng, 2) ? 0 : 1e-4 * symmetric(rng)));
        double d = (double)m[0] * ((double)m[5] * m[10] - (double)m[6] * m[9]) -
                   (double)m[1] * ((double)m[4] * m[10] - (double)m[6] * m[8]) +
                   (double)m[2] * ((double)m[4] * m[9] - (double)m[5] * m[8]);
        if (fabs(d) > 1e-12)
            break;
    }
}

/* Several geometries with transforms of their own and normalised vertices, under instance transforms. */
static void make_geometry_transforms(struct made_scene *made, struct rng *rng, uint32_t triangles)
{
    uint32_t count = 1 + rng_below(rng, 3);
    for (uint32_t g = 0; g < count; g++) {
        struct mesh mesh = height_field(made, rng, side_of(triangles / (2 * count)), rng_below(rng, 2));
        struct gn_ref_geometry *geometry = &made->scene.geometries[g];
        uint32_t format = rng_below(rng, 3);
        for (uint32_t i = 0; format > 0 && i < mesh.position_count; i++)
            for (int j = 0; j < 3; j++)
                mesh.positions[i][j] = fmax(-1, fmin(1, rint(mesh.positions[i][j] * 127) / 127)) * (format == 1 ? 127 : 32767);
        for (uint32_t i = 0; format > 0 && i < mesh.position_count; i++)
            for (int j = 0; j < 3; j++)
                mesh.positions[i][j] = rint(mesh.positions[i][j]);
        *geometry = geometry_of_mesh(&mesh);
        geometry->divisor = format == 0 ? 1 : format == 1 ? 127 : 32767;
        geometry->flags = rng_below(rng, 4);
        if (rng_below(rng, 4) > 0) {
            float *transform = owned(made, 12 * sizeof *transform);
            random_transform(rng, 1, transform);
            geometry->transform = transform;
        }
    }
    made->scene.blas_count = 1;
    made->scene.blas_first[1] = count;
    instances(made, rng, 1 + rng_below(rng, 2), 1);
}

static void make_boxes(struct made_scene *made, struct rng *rng, uint32_t triangles)
{
    uint32_t count = 8 + triangles / 16;
    float (*boxes)[6] = owned(made, count * sizeof *boxes);
    bool lattice = rng_below(rng, 2);
    for (uint32_t i = 0; i < count; i++) {
        for (int j = 0; j < 3; j++) {
            double lower = symmetric(rng), size = 0.3 * rng_unit(rng);
            if (lattice) {
                lower = rint(lower * 16) / 16;
                size = rng_below(rng, 5) / 16.0;
            }
            if (rng_below(rng, 12) == 0)
                size = 0;
            if (rng_below(rng, 100) == 0)
                size = -0.1;
            boxes[i][j] = (float)lower;
            boxes[i][3 + j] = size == 0 ? (float)lower : (float)(lower + size);
        }
        if (rng_below(rng, 20) == 0)
            boxes[i][0] = NAN;
    }
    struct mesh mesh = soup(made, rng, triangles / 2 + 1, 0.2, false);
    one_mesh(made, &mesh);
    made->scene.geometries[1] = made->scene.geometries[0];
    made->scene.geometries[0] =
        (struct gn_ref_geometry){.type = GN_REF_AABBS, .primitive_count = count, .aabbs = (const float (*)[6])boxes,
                                 .flags = rng_below(rng, 2)};
    made->scene.blas_first[1] = 1;
    made->scene.blas_first[2] = 2;
    made->scene.blas_count = 2;
    made->scene.instances[1] = plain_instance(1);
    made->scene.instance_count = 2;
    if (rng_below(rng, 3) > 0) {
        instances(made, rng, 2 + rng_below(rng, 2), 1);
        made->scene.instances[0].blas = 0;
    } else if (lattice) {
        made->grid = 0x1p-4;
    }
}

static void make_flags(struct made_scene *made, struct rng *rng, uint32_t triangles)
{
    make_boxes(made, rng, triangles);
    for (uint32_t g = 0; g < 2; g++)
        made->scene.geometries[g].flags = rng_below(rng, 4);
    for (uint32_t i = 0; i < made->scene.instance_count; i++) {
        struct gn_ref_instance *instance = &made->scene.instances[i];
        instance->mask = rng_below(rng, 256);
        instance->flags = rng_below(rng, 16);
        if ((instance->flags & 0xC) == 0xC)
            instance->flags &= 3;
    }
}

/*
 * Placed where f64 has no room for the last bits of a vertex, which are as large as what rays nudged off the lattice
 * miss its edges by: whoever takes the rounded vertex for the exact one is wrong here.
 */
static void make_placed_inexactly(struct made_scene *made, struct rng *rng, uint32_t triangles)
{
    make_lattice(made, rng, triangles);
    float *m = made->scene.instances[0].transform;
    for (int i = 0; i < 3; i++) {
        m[4 * i + 3] = (float)((rng_below(rng, 2) ? 1 : -1) * 0x1p16);
        m[4 * i + (i + 1) % 3] = (float)ldexp(rng_below(rng, 2) ? 1 : -1, -36 - (int)rng_below(rng, 4));
    }
}

/* World coordinates beyond f32: only the exact stage and infinite bounds are left. */
static void make_beyond(struct made_scene *made, struct rng *rng, uint32_t triangles)
{
    make_height_field(made, rng, side_of(triangles), false);
    double scale = ldexp(1, 100 + (int)rng_below(rng, 28));
    float *transform = owned(made, 12 * sizeof *transform), *m = made->scene.instances[0].transform;
    memset(m, 0, 12 * sizeof *m);
    memset(transform, 0, 12 * sizeof *transform);
    for (int i = 0; i < 3; i++) {
        m[5 * i] = (float)(scale * (0.5 + rng_unit(rng)));
        transform[5 * i] = (float)ldexp(0.5 + rng_unit(rng), rng_below(rng, 2) ? (int)rng_below(rng, 100) : 0);
    }
    if (rng_below(rng, 2))
        made->scene.geometries[0].transform = transform;
    made->extent = scale;
}

const struct family families[] = {
    {"height field", make_field, 2000, 0},
    {"lattice", make_lattice, 2000, RAYS_EXACT},
    {"lattice, ranges", make_lattice, 800, RAYS_EXACT | RAYS_RANGE},
    {"slivers", make_slivers, 600, RAYS_SCALED},
    {"soup, degenerate", make_soup, 800, RAYS_AXIS},
    {"far from the origin", make_far, 1500, 0},
    {"mixed scales", make_mixed_scales, 500, RAYS_SCALED | RAYS_FAR},
    {"any scale", make_any_scale, 500, RAYS_EXACT | RAYS_SCALED},
    {"closed", make_blob, 2000, RAYS_ON_SURFACE},
    {"instances", make_instanced, 1500, RAYS_RANGE},
    {"many instances", make_many_instances, 1500, RAYS_FLAGS},
    {"nearly singular", make_nearly_singular, 800, RAYS_ON_SURFACE},
    {"geometry transforms", make_geometry_transforms, 1000, RAYS_SCALED},
    {"placed inexactly", make_placed_inexactly, 500, RAYS_EXACT | RAYS_NUDGED},
    {"boxes", make_boxes, 300, RAYS_EXACT | RAYS_AXIS | RAYS_RANGE},
    {"flags and masks", make_flags, 300, RAYS_EXACT | RAYS_FLAGS},
    {"on surfaces", make_lattice, 800, RAYS_EXACT | RAYS_ON_SURFACE | RAYS_AXIS | RAYS_FLAGS},
    {"beyond f32", make_beyond, 200, RAYS_FAR | RAYS_SCALED},
};
const uint32_t family_count = sizeof families / sizeof families[0];

static void place(const float m[12], double p[3])
{
    double out[3];
    for (int r = 0; r < 3; r++)
        out[r] = m[4 * r] * p[0] + m[4 * r + 1] * p[1] + m[4 * r + 2] * p[2] + m[4 * r + 3];
    memcpy(p, out, sizeof out);
}

/* A point to aim at; with `exact` a multiple of a sixteenth along edges. */
static void target_point(const struct made_scene *made, enum aim aim, bool exact, struct rng *rng, double out[3])
{
    const struct oracle_scene *scene = &made->scene;
    const struct gn_ref_instance *instance = &scene->instances[rng_below(rng, scene->instance_count)];
    for (int j = 0; j < 3; j++)
        out[j] = made->extent * symmetric(rng);
    if (aim == AIM_RANDOM || instance->blas == GN_REF_NULL_BLAS)
        return;
    uint32_t first = scene->blas_first[instance->blas], last = scene->blas_first[instance->blas + 1];
    const struct gn_ref_geometry *geometry = &scene->geometries[first + rng_below(rng, last - first)];
    uint32_t primitive = rng_below(rng, geometry->primitive_count), turn = rng_below(rng, 3);
    if (geometry->type == GN_REF_AABBS) {
        const float *box = geometry->aabbs[primitive];
        unsigned corner = rng_below(rng, 8);
        for (int j = 0; j < 3; j++) {
            double s = corner >> j & 1;
            if (aim == AIM_INTERIOR || (aim == AIM_EDGE && j == (int)turn))
                s = exact ? rng_below(rng, 5) / 4.0 : rng_unit(rng);
            out[j] = isnan(box[j]) ? 0 : box[j] + s * ((double)box[3 + j] - box[j]);
        }
    } else {
        double a = exact ? rng_below(rng, 9) / 8.0 : rng_unit(rng), b = 0;
        if (aim == AIM_VERTEX)
            a = 0;
        if (aim == AIM_INTERIOR)
            b = rng_unit(rng) * (1 - a);
        double weights[3] = {1 - a - b, a, b};
        for (int j = 0; j < 3; j++) {
            out[j] = 0;
            for (uint32_t v = 0; v < 3; v++)
                out[j] += weights[v] * geometry->positions[geometry->triangles[primitive][(v + turn) % 3]][j] /
                          geometry->divisor;
            if (isnan(out[j]))
                out[j] = 0;
        }
        if (geometry->transform)
            place(geometry->transform, out);
    }
    place(instance->transform, out);
}

static float finite_f32(double value)
{
    return (float)fmax(-0x1.fp127, fmin(0x1.fp127, value));
}

struct gn_ref_ray made_ray(const struct made_scene *made, const struct family *family, enum aim aim, struct rng *rng,
                           struct oracle *oracle)
{
    struct gn_ref_ray ray = {.tmin = 0, .tmax = INFINITY, .cull_mask = 0xFF};
    bool exact = (family->options & RAYS_EXACT) && made->grid > 0 && rng_below(rng, 2);
    double target[3], from[3], direction[3];
    target_point(made, aim, exact, rng, target);
    double distance = made->extent * (1 + 2 * rng_unit(rng));
    if ((family->options & RAYS_FAR) && rng_below(rng, 2))
        distance *= pow(10, 4 * rng_unit(rng));
    for (int j = 0; j < 3; j++)
        direction[j] = symmetric(rng);
    if ((family->options & RAYS_AXIS) && rng_below(rng, 3) == 0) {
        uint32_t axis = rng_below(rng, 3), plane = rng_below(rng, 2);
        for (uint32_t j = 0; j < 3; j++)
            if (plane ? j == axis : j != axis)
                direction[j] = 0;
    }
    if (exact) {
        uint32_t steps = 1 << rng_below(rng, 6);
        for (int j = 0; j < 3; j++) {
            direction[j] = rint(direction[j] * 16) * made->grid;
            from[j] = target[j] - steps * direction[j];
        }
    } else {
        for (int j = 0; j < 3; j++)
            from[j] = target[j] - distance * direction[j];
    }
    if ((family->options & RAYS_ON_SURFACE) && rng_below(rng, 2)) {
        target_point(made, (enum aim)rng_below(rng, 3), exact, rng, from);
        exact = false;
    }
    for (int j = 0; j < 3; j++) {
        ray.origin[j] = finite_f32(from[j]);
        double along = exact ? direction[j] : target[j] - ray.origin[j];
        /* Components that were meant to be zero stay so. */
        ray.direction[j] = direction[j] == 0 ? 0 : finite_f32(along);
        if (direction[j] == 0)
            ray.origin[j] = finite_f32(target[j]);
    }
    if (exact && (family->options & RAYS_NUDGED)) {
        uint32_t j = rng_below(rng, 3);
        ray.origin[j] = finite_f32(target[j]);
        ray.direction[j] = (float)(made->grid * ldexp((int)rng_below(rng, 17) - 8, -36 - (int)rng_below(rng, 6)));
    }
    if ((family->options & RAYS_SCALED) && rng_below(rng, 2)) {
        int exponent = (int)rng_below(rng, 280) - 150;
        for (int j = 0; j < 3; j++)
            ray.direction[j] = finite_f32(ldexp(ray.direction[j], exponent));
        if (rng_below(rng, 4) == 0)
            ray.direction[rng_below(rng, 3)] = rng_below(rng, 2) ? 0x1p-149f : -0.0f;
    }
    if (ray.direction[0] == 0 && ray.direction[1] == 0 && ray.direction[2] == 0)
        ray.direction[rng_below(rng, 3)] = rng_below(rng, 2) ? 1 : -1;
    if (family->options & RAYS_FLAGS) {
        static const uint32_t opacity[8] = {0, 0, 0, 0, 1, 2, 0x40, 0x80};
        static const uint32_t culling[8] = {0, 0, 0, 0, 0x10, 0x20, 0x100, 0x200};
        ray.flags = opacity[rng_below(rng, 8)] | culling[rng_below(rng, 8)] | (rng_below(rng, 2) ? 4 : 0);
        ray.cull_mask = rng_below(rng, 4) ? 0xFFFFFFFF : rng_below(rng, 512);
    }
    if ((family->options & RAYS_RANGE) && rng_below(rng, 2)) {
        const struct gn_ref_hit *hits;
        size_t count = oracle_trace(oracle, &ray, &hits);
        if (count > 0) {
            float t = (float)hits[rng_below(rng, (uint32_t)count)].t;
            if (!(t >= 0) || isinf(t))
                t = 1;
            uint32_t step = rng_below(rng, 3);
            t = step == 0 ? t : nextafterf(t, step == 1 ? 0 : INFINITY);
            if (rng_below(rng, 2))
                ray.tmin = t;
            else
                ray.tmax = t;
            if (rng_below(rng, 8) == 0)
                ray.tmin = ray.tmax = t;
        }
    }
    return ray;
}
