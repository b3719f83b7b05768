/* SPDX-License-Identifier: Apache-2.0 */
/* The scene model: what is added is checked and copied; commit builds the trees. */
#include "reference/scene.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "reference/scene_internal.h"

/* Of all instances together. Keeps every index of a tree below its leaf bit. */
#define MAX_PRIMITIVES (UINT32_C(1) << 30)

static bool __attribute__((format(printf, 2, 3))) fail(struct gn_ref_scene *scene, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(scene->error, sizeof scene->error, format, arguments);
    va_end(arguments);
    return false;
}

struct gn_ref_scene *gn_ref_scene_create(void)
{
    return calloc(1, sizeof(struct gn_ref_scene));
}

static void blas_finish(struct gn_ref_blas *blas)
{
    for (uint32_t g = 0; blas->geometries && g < blas->geometry_count; g++) {
        struct gn_ref_geometry *geometry = &blas->geometries[g];
        free((void *)geometry->positions);
        free((void *)geometry->triangles);
        free((void *)geometry->transform);
        free((void *)geometry->aabbs);
    }
    free(blas->geometries);
    free(blas->matrices);
}

void gn_ref_scene_destroy(struct gn_ref_scene *scene)
{
    if (!scene)
        return;
    for (uint32_t b = 0; b < scene->blas_count; b++)
        blas_finish(&scene->blases[b]);
    free(scene->blases);
    free(scene->instances);
    free(scene->instance_data);
    free(scene->boxes);
    free(scene->box_transforms);
    for (uint32_t t = 0; t < scene->tree_count; t++)
        gn_ref_bvh_finish(&scene->trees[t]);
    free(scene->trees);
    gn_ref_bvh_finish(&scene->instance_bvh);
    gn_ref_bvh_finish(&scene->box_bvh);
    free(scene);
}

const char *gn_ref_scene_error(const struct gn_ref_scene *scene)
{
    return scene->error;
}

/* Room for one more item. Doubling cannot overflow: counts are 32 bits, and GN_REF_NULL_BLAS is no index. */
static bool reserve(void **items, uint32_t count, uint32_t *capacity, size_t item_size)
{
    if (count < *capacity)
        return true;
    if (count >= UINT32_MAX / 2)
        return false;
    uint32_t new_capacity = count ? count * 2 : 4;
    if (new_capacity > SIZE_MAX / item_size)
        return false;
    void *memory = realloc(*items, new_capacity * item_size);
    if (!memory)
        return false;
    *items = memory;
    *capacity = new_capacity;
    return true;
}

/* A copy, or NULL when memory is short. Never of zero bytes. */
static void *copy(const void *source, uint32_t count, size_t item_size)
{
    if (count == 0 || count > SIZE_MAX / item_size)
        return NULL;
    void *memory = malloc(count * item_size);
    if (memory)
        memcpy(memory, source, count * item_size);
    return memory;
}

static bool transform_check(struct gn_ref_scene *scene, const float *transform, const char *what, uint32_t index)
{
    for (int i = 0; i < 12; i++)
        if (!isfinite(transform[i]))
            return fail(scene, "%s %u: transform element [%d][%d] is %g, expected a finite number", what, index, i / 4,
                        i % 4, transform[i]);
    return true;
}

static bool triangle_inactive(const struct gn_ref_geometry *geometry, uint32_t triangle)
{
    const uint32_t *corners = geometry->triangles[triangle];
    return isnan(geometry->positions[corners[0]][0]) || isnan(geometry->positions[corners[1]][0]) ||
           isnan(geometry->positions[corners[2]][0]);
}

static bool geometry_check(struct gn_ref_scene *scene, const struct gn_ref_geometry *geometry, uint32_t index)
{
    if (geometry->flags & ~(uint32_t)(GN_REF_GEOMETRY_OPAQUE | GN_REF_GEOMETRY_NO_DUPLICATE))
        return fail(scene, "geometry %u: flags are 0x%x, expected only bits of 0x3", index, geometry->flags);
    if (geometry->primitive_count >= MAX_PRIMITIVES)
        return fail(scene, "geometry %u: %u primitives, expected fewer than %u", index, geometry->primitive_count,
                    MAX_PRIMITIVES);
    if (geometry->type == GN_REF_AABBS) {
        if (geometry->primitive_count > 0 && !geometry->aabbs)
            return fail(scene, "geometry %u: aabbs is NULL, expected %u boxes", index, geometry->primitive_count);
        for (uint32_t i = 0; i < geometry->primitive_count; i++) {
            const float *box = geometry->aabbs[i];
            for (int j = 0; j < 6 && !isnan(box[0]); j++)
                if (!isfinite(box[j]))
                    return fail(scene, "geometry %u: component %d of box %u is %g, expected a finite number "
                                "(or NaN in min x, for an inactive box)", index, j, i, box[j]);
        }
        return true;
    }
    if (geometry->type != GN_REF_TRIANGLES)
        return fail(scene, "geometry %u: type is %d, expected triangles (0) or AABBs (1)", index, (int)geometry->type);
    if (!(geometry->divisor > 0) || isinf(geometry->divisor))
        return fail(scene, "geometry %u: divisor is %g, expected a positive finite number", index, geometry->divisor);
    if (geometry->transform && !transform_check(scene, geometry->transform, "geometry", index))
        return false;
    if (geometry->primitive_count == 0)
        return true;
    if (!geometry->triangles)
        return fail(scene, "geometry %u: triangles is NULL, expected %u", index, geometry->primitive_count);
    if (!geometry->positions || geometry->position_count == 0)
        return fail(scene, "geometry %u: no positions for %u triangles", index, geometry->primitive_count);
    for (uint32_t i = 0; i < geometry->primitive_count; i++) {
        for (int j = 0; j < 3; j++)
            if (geometry->triangles[i][j] >= geometry->position_count)
                return fail(scene, "geometry %u: vertex %d of triangle %u is %u, expected less than %u", index, j, i,
                            geometry->triangles[i][j], geometry->position_count);
        if (triangle_inactive(geometry, i))
            continue;
        for (int j = 0; j < 3; j++)
            for (int axis = 0; axis < 3; axis++) {
                double value = geometry->positions[geometry->triangles[i][j]][axis];
                if (!isfinite(value))
                    return fail(scene, "geometry %u: %c of vertex %u (of triangle %u) is %g, expected a finite number "
                                "(or NaN in x, for an inactive triangle)", index, "xyz"[axis],
                                geometry->triangles[i][j], i, value);
            }
    }
    return true;
}

static bool geometry_copy(struct gn_ref_geometry *out, const struct gn_ref_geometry *in)
{
    bool boxes = in->type == GN_REF_AABBS;
    *out = (struct gn_ref_geometry){.type = in->type, .flags = in->flags, .primitive_count = in->primitive_count,
                                    .divisor = boxes ? 1 : in->divisor};
    if (!boxes && in->transform && !(out->transform = copy(in->transform, 12, sizeof(float))))
        return false;
    if (in->primitive_count == 0)
        return true;
    if (boxes)
        return (out->aabbs = copy(in->aabbs, in->primitive_count, sizeof in->aabbs[0])) != NULL;
    out->position_count = in->position_count;
    return (out->positions = copy(in->positions, in->position_count, sizeof in->positions[0])) &&
           (out->triangles = copy(in->triangles, in->primitive_count, sizeof in->triangles[0]));
}

bool gn_ref_scene_add_blas(struct gn_ref_scene *scene, const struct gn_ref_geometry *geometries,
                           uint32_t geometry_count, uint32_t *out_blas)
{
    if (scene->committed)
        return fail(scene, "a BLAS is added after the commit");
    if (geometry_count > 0 && !geometries)
        return fail(scene, "geometries is NULL, expected %u", geometry_count);
    for (uint32_t g = 0; g < geometry_count; g++)
        if (!geometry_check(scene, &geometries[g], g))
            return false;
    if (!reserve((void **)&scene->blases, scene->blas_count, &scene->blas_capacity, sizeof *scene->blases))
        return fail(scene, "out of memory for BLAS %u", scene->blas_count);
    struct gn_ref_blas blas = {.geometries = calloc(geometry_count ? geometry_count : 1, sizeof *blas.geometries),
                               .matrices = calloc(geometry_count ? geometry_count : 1, sizeof *blas.matrices),
                               .geometry_count = geometry_count};
    if (!blas.geometries || !blas.matrices) {
        blas_finish(&blas);
        return fail(scene, "out of memory for %u geometries", geometry_count);
    }
    for (uint32_t g = 0; g < geometry_count; g++)
        if (!geometry_copy(&blas.geometries[g], &geometries[g])) {
            blas_finish(&blas);
            return fail(scene, "out of memory for geometry %u of %u primitives", g, geometries[g].primitive_count);
        } else {
            const float *transform = blas.geometries[g].transform;
            gn_ref_matrix_prepare(&blas.matrices[g], transform ? transform : gn_ref_identity);
        }
    *out_blas = scene->blas_count;
    scene->blases[scene->blas_count++] = blas;
    return true;
}

bool gn_ref_scene_add_instance(struct gn_ref_scene *scene, const struct gn_ref_instance *instance)
{
    uint32_t index = scene->instance_count;
    if (scene->committed)
        return fail(scene, "an instance is added after the commit");
    if (instance->blas != GN_REF_NULL_BLAS) {
        if (instance->blas >= scene->blas_count)
            return fail(scene, "instance %u: BLAS %u, expected less than %u", index, instance->blas, scene->blas_count);
        if (!transform_check(scene, instance->transform, "instance", index))
            return false;
    }
    if (instance->custom_index > 0xFFFFFF)
        return fail(scene, "instance %u: custom index 0x%x, expected 24 bits", index, instance->custom_index);
    if (instance->sbt_offset > 0xFFFFFF)
        return fail(scene, "instance %u: SBT offset 0x%x, expected 24 bits", index, instance->sbt_offset);
    if (instance->mask > 0xFF)
        return fail(scene, "instance %u: mask 0x%x, expected 8 bits", index, instance->mask);
    if (instance->flags & ~(uint32_t)0xF)
        return fail(scene, "instance %u: flags 0x%x, expected only bits of 0xF", index, instance->flags);
    uint32_t both = GN_REF_INSTANCE_FORCE_OPAQUE | GN_REF_INSTANCE_FORCE_NO_OPAQUE;
    if ((instance->flags & both) == both)
        return fail(scene, "instance %u: flags 0x%x force opaque and not opaque at once", index, instance->flags);
    if (!reserve((void **)&scene->instances, index, &scene->instance_capacity, sizeof *scene->instances))
        return fail(scene, "out of memory for instance %u", index);
    scene->instances[scene->instance_count++] = *instance;
    return true;
}

/* An f64 and the largest distance to the exact number it stands for; infinite when that is not known. */
struct number {
    double value;
    double error;
};

/* Bounds of the errors are sums of a few rounded terms: this covers their own rounding. */
#define SLACK (1 + 0x1p-48)
/*
 * A product or quotient at least this large has a rounding error that is an f64 itself and is found exactly by fma;
 * and no error that is not zero becomes zero when it is carried on: the smallest, a rest of about 2^-664 divided by at
 * most 2^60, is multiplied by two f32 of at least 2^-149 each. Products of three f32 are at least 2^-447.
 */
#define TAIL_EXACT 0x1p-500

static struct number number_multiply(struct number a, double b)
{
    double value = a.value * b;
    if (b == 0)
        return (struct number){0, isfinite(a.error) ? 0 : INFINITY};
    if (a.value == 0)
        return (struct number){0, a.error * fabs(b) * SLACK};
    if (!(fabs(value) >= TAIL_EXACT && fabs(value) <= 0x1p1000))
        return (struct number){0, INFINITY};
    return (struct number){value, (fabs(fma(a.value, b, -value)) + a.error * fabs(b)) * SLACK};
}

static struct number number_add(struct number a, struct number b)
{
    double sum = a.value + b.value;
    if (!(fabs(sum) <= 0x1p1000))
        return (struct number){0, INFINITY};
    /* Knuth's TwoSum: the rounding error, exactly, short of overflow. */
    double other = sum - a.value;
    double tail = (a.value - (sum - other)) + (b.value - other);
    return (struct number){sum, (fabs(tail) + a.error + b.error) * SLACK};
}

static struct number number_divide(double a, double b)
{
    double value = a / b;
    if (a == 0)
        return (struct number){0, 0};
    if (!(fabs(value) >= TAIL_EXACT && fabs(value) <= 0x1p1000 && fabs(a) >= TAIL_EXACT && b >= 0x1p-60 && b <= 0x1p60))
        return (struct number){0, INFINITY};
    double rest = fma(-value, b, a);
    return (struct number){value, fabs(rest / b) * SLACK};
}

static void point_transform(struct number point[3], const float transform[12])
{
    struct number out[3];
    for (int row = 0; row < 3; row++) {
        const float *m = transform + 4 * row;
        out[row] = (struct number){m[3], 0};
        for (int column = 0; column < 3; column++)
            out[row] = number_add(out[row], number_multiply(point[column], m[column]));
    }
    memcpy(point, out, sizeof out);
}

/* What places the vertices of a geometry of an instance; NULL where nothing has to be done. */
struct placing {
    const float *geometry, *instance;
};

static struct gn_ref_vertex vertex_place(const struct gn_ref_geometry *geometry, uint32_t index,
                                         const struct placing *placing)
{
    struct number point[3];
    for (int axis = 0; axis < 3; axis++)
        point[axis] = number_divide(geometry->positions[index][axis], geometry->divisor);
    if (placing->geometry)
        point_transform(point, placing->geometry);
    if (placing->instance)
        point_transform(point, placing->instance);
    struct gn_ref_vertex vertex;
    vertex.error = fmax(point[0].error, fmax(point[1].error, point[2].error));
    for (int axis = 0; axis < 3; axis++)
        vertex.w[axis] = isfinite(vertex.error) ? point[axis].value : 0;
    return vertex;
}

static struct placing placing_of(const struct gn_ref_scene *scene, uint32_t instance, uint32_t geometry_index, uint64_t times)
{
    const struct gn_ref_blas *blas = &scene->blases[scene->instances[instance].blas];
    const struct gn_ref_geometry *geometry = &blas->geometries[geometry_index];
    struct placing placing = {0};
    if (gn_ref_effect_applies(GN_REF_EFFECT_GEOMETRY_TRANSFORMS, !blas->matrices[geometry_index].identity, times))
        placing.geometry = geometry->transform ? geometry->transform : gn_ref_identity;
    return placing;
}

static void placing_add_instance(struct placing *placing, const struct gn_ref_scene *scene, uint32_t instance, uint64_t times)
{
    if (gn_ref_effect_applies(GN_REF_EFFECT_INSTANCE_TRANSFORMS, !scene->instance_data[instance].matrix.identity, times))
        placing->instance = scene->instances[instance].transform;
}

void gn_ref_triangle_place(const struct gn_ref_scene *scene, const struct gn_ref_primitive *primitive, double out[3][3],
                           double *out_error)
{
    const struct gn_ref_geometry *geometry =
        &scene->blases[scene->instances[primitive->instance].blas].geometries[primitive->geometry];
    struct placing placing = placing_of(scene, primitive->instance, primitive->geometry, 3);
    placing_add_instance(&placing, scene, primitive->instance, 3);
    *out_error = 0;
    for (int v = 0; v < 3; v++) {
        struct gn_ref_vertex vertex = vertex_place(geometry, geometry->triangles[primitive->primitive][v], &placing);
        memcpy(out[v], vertex.w, sizeof vertex.w);
        *out_error = fmax(*out_error, vertex.error);
    }
}

static float round_down(double value)
{
    float rounded = (float)value;
    return (double)rounded > value ? nextafterf(rounded, -INFINITY) : rounded;
}

static float round_up(double value)
{
    return -round_down(-value);
}

/* Extends the bounds by value +- error. */
static void bounds_add(struct gn_ref_bounds *bounds, int axis, double value, double error)
{
    double lower = -INFINITY, upper = INFINITY;
    if (error == 0) {
        lower = upper = value;
    } else if (isfinite(error)) {
        lower = nextafter(value - error, -INFINITY);
        upper = nextafter(value + error, INFINITY);
    }
    bounds->lower[axis] = fminf(bounds->lower[axis], round_down(lower));
    bounds->upper[axis] = fmaxf(bounds->upper[axis], round_up(upper));
}

static const struct gn_ref_bounds nothing = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static struct gn_ref_bounds box_bounds(const float box[6], const float transform[12])
{
    struct gn_ref_bounds bounds = nothing;
    if (!transform) {
        memcpy(bounds.lower, box, sizeof bounds.lower);
        memcpy(bounds.upper, box + 3, sizeof bounds.upper);
        return bounds;
    }
    for (int corner = 0; corner < 8; corner++) {
        struct number point[3];
        for (int axis = 0; axis < 3; axis++)
            point[axis] = (struct number){box[axis + 3 * (corner >> axis & 1)], 0};
        point_transform(point, transform);
        for (int axis = 0; axis < 3; axis++)
            bounds_add(&bounds, axis, point[axis].value, point[axis].error);
    }
    return bounds;
}

/* Interval arithmetic by widening each rounded result; the operands are products of at most four f32. */
static struct gn_ref_interval interval_of(double value, double error)
{
    return (struct gn_ref_interval){nextafter(value - error, -INFINITY), nextafter(value + error, INFINITY)};
}

/* The most by which inverting may magnify errors: |M^-1| |M|, the largest sum of a row. */
#define MOST_SKEW 0x1p14

/*
 * The inverse X of the linear part M, every entry with a relative error below 4.1 u, u = 2^-53: a cofactor is the
 * difference of two exact products and rounded by u; the determinant is summed in pairs of f64, wrong by 2^-100 of the
 * sum of its terms' magnitudes, which is below 2^-55 of itself as it is asked to be at least 2^-45 of them, and
 * rounded by u twice; the quotient once. Nothing leaves f64's range: cofactors are 0 or 2^-298 .. 2^257,
 * determinants 2^-447 .. 2^386.
 *
 * A point at q = o - T then has the image X q with an error of at most 9 u |X| |q| component by component (4.1 u from X, u
 * from q where that is rounded, 3 u from products and sums), and |X| |q| <= |X| |M| |M^-1 q|. False where |X| |M|
 * is too large for that to be of use.
 */
static bool inverse_set(struct gn_ref_instance_data *data, const float m[12])
{
    double cofactor[3][3], rest[3][3], high = 0, low = 0, size = 0; /* cofactor[row][column] of m[row][column] */
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 3; column++) {
            int r1 = (row + 1) % 3, r2 = (row + 2) % 3, c1 = (column + 1) % 3, c2 = (column + 2) % 3;
            double a = (double)m[4 * r1 + c1] * m[4 * r2 + c2], b = (double)m[4 * r1 + c2] * m[4 * r2 + c1], d = a - b;
            double other = d - a;
            cofactor[row][column] = d;
            rest[row][column] = (a - (d - other)) - (b + other);
        }
    for (int column = 0; column < 3; column++) {
        double factor = m[column], product = cofactor[0][column] * factor, sum = high + product, other = sum - high;
        low += fma(cofactor[0][column], factor, -product) + rest[0][column] * factor;
        low += (high - (sum - other)) + (product - other);
        high = sum;
        size += fabs(product);
    }
    double determinant = high + low, skew = 0;
    if (!(fabs(determinant) >= 0x1p-45 * size) || determinant == 0)
        return false;
    for (int row = 0; row < 3; row++) {
        double sum = 0;
        for (int column = 0; column < 3; column++) {
            data->inverse[column][row] = cofactor[column][row] / determinant;
            for (int k = 0; k < 3; k++)
                sum += fabs(data->inverse[column][row] * m[4 * column + k]);
        }
        data->inverse[row][3] = 0;
        skew = fmax(skew, sum);
    }
    return skew <= MOST_SKEW;
}

static void box_transform_set(struct gn_ref_box_transform *out, const float m[12])
{
    double determinant = 0, determinant_error = 0;
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 3; column++) {
            /* adjugate[row][column] is the cofactor of m[column][row] */
            int r1 = (column + 1) % 3, r2 = (column + 2) % 3, c1 = (row + 1) % 3, c2 = (row + 2) % 3;
            double a = (double)m[4 * r1 + c1] * m[4 * r2 + c2]; /* exact: 48 bits, far from the ends of f64 */
            double b = (double)m[4 * r1 + c2] * m[4 * r2 + c1];
            double cofactor = a - b, error = 0x1p-52 * fabs(cofactor);
            out->adjugate[row][column] = a == b ? (struct gn_ref_interval){0, 0} : interval_of(cofactor, error);
            if (column == 0) {
                determinant += cofactor * m[row];
                determinant_error += 0x1p-49 * fabs(cofactor * m[row]);
            }
        }
    out->determinant = interval_of(determinant, determinant_error);
}

/* Zero area: decided in f64 where that is certain, which spares every trace an exact test. */
static bool triangle_degenerate(struct gn_ref_exact *exact, const struct gn_ref_scene *scene,
                                const struct gn_ref_primitive *primitive, const struct gn_ref_vertex v[3])
{
    const struct gn_ref_geometry *geometry =
        &scene->blases[scene->instances[primitive->instance].blas].geometries[primitive->geometry];
    const uint32_t *corners = geometry->triangles[primitive->primitive];
    if (corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0])
        return true;
    double e[2][3], size = 0, error = fmax(v[0].error, fmax(v[1].error, v[2].error));
    for (int i = 0; i < 2; i++)
        for (int axis = 0; axis < 3; axis++) {
            e[i][axis] = v[i + 1].w[axis] - v[0].w[axis];
            size = fmax(size, fabs(e[i][axis]));
        }
    /* Each edge component is wrong by at most d, each cross product's component by 4 d size + 2 d^2 + rounding. */
    double d = 0x1p-53 * size + 2 * error;
    double bound = 5 * size * d + 3 * d * d + 0x1p-50 * size * size;
    for (int i = 0; i < 3 && size > 0x1p-200 && size < 0x1p200 && d < 0x1p200; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        if (fabs(e[0][j] * e[1][k] - e[0][k] * e[1][j]) > bound)
            return false;
    }
    return gn_ref_triangle_degenerate_exact(exact, scene, primitive);
}

/* What commit shares: the builder's device and scratch memory. */
struct commit {
    struct gn_ref_scene *scene;
    struct RTCDeviceTy *device;
    struct gn_ref_exact exact;
};

static bool out_of_memory(struct gn_ref_scene *scene, uint64_t count, const char *what)
{
    return fail(scene, "out of memory for %llu %s", (unsigned long long)count, what);
}

/* The triangles of one tree, and the vertices of all its geometries. */
struct gathering {
    struct gn_ref_primitive *primitives;
    uint32_t (*corners)[3];
    struct gn_ref_vertex *vertices;
    struct gn_ref_bounds bounds; /* of all */
    uint32_t count, vertex_count;
};

static void gathering_finish(struct gathering *gathering)
{
    free(gathering->primitives);
    free(gathering->corners);
    free(gathering->vertices);
}

static void gather_triangles(struct gathering *out, struct commit *commit, uint32_t instance, uint32_t geometry_index,
                             bool in_world)
{
    struct gn_ref_scene *scene = commit->scene;
    const struct gn_ref_geometry *geometry =
        &scene->blases[scene->instances[instance].blas].geometries[geometry_index];
    struct placing placing = placing_of(scene, instance, geometry_index, geometry->position_count);
    if (in_world)
        placing_add_instance(&placing, scene, instance, geometry->position_count);
    const uint32_t first = out->vertex_count;
    for (uint32_t i = 0; i < geometry->position_count; i++)
        out->vertices[out->vertex_count++] = vertex_place(geometry, i, &placing);
    for (uint32_t i = 0; i < geometry->primitive_count; i++) {
        if (triangle_inactive(geometry, i))
            continue;
        struct gn_ref_primitive primitive = {instance, geometry_index, i};
        struct gn_ref_vertex corners[3];
        for (int j = 0; j < 3; j++) {
            out->corners[out->count][j] = first + geometry->triangles[i][j];
            corners[j] = out->vertices[out->corners[out->count][j]];
        }
        /* The same in object space and in the world, the transform being regular. */
        if (triangle_degenerate(&commit->exact, scene, &primitive, corners))
            continue;
        for (int j = 0; j < 3; j++)
            for (int axis = 0; axis < 3; axis++)
                bounds_add(&out->bounds, axis, corners[j].w[axis], corners[j].error);
        out->primitives[out->count++] = primitive;
    }
}

/* The tree of an instance's triangles, in the world or in object space. Without triangles there is none: GN_REF_NONE. */
static bool tree_add(struct commit *commit, uint32_t instance, bool in_world, uint32_t *out_tree)
{
    struct gn_ref_scene *scene = commit->scene;
    const struct gn_ref_blas *blas = &scene->blases[scene->instances[instance].blas];
    struct gathering gathering = {.bounds = nothing};
    bool done = false;
    size_t total = 0, positions = 0;
    *out_tree = GN_REF_NONE;
    for (uint32_t g = 0; g < blas->geometry_count; g++) {
        if (blas->geometries[g].type != GN_REF_TRIANGLES)
            continue;
        total += blas->geometries[g].primitive_count;
        positions += blas->geometries[g].position_count;
    }
    if (total == 0)
        return true;
    /* One beyond the last: a triangle is placed before it is known to be degenerate. */
    gathering.primitives = malloc((total + 1) * sizeof *gathering.primitives);
    gathering.corners = malloc((total + 1) * sizeof *gathering.corners);
    gathering.vertices = malloc((positions + 1) * sizeof *gathering.vertices);
    if (!gathering.primitives || !gathering.corners || !gathering.vertices || positions > UINT32_MAX ||
        !reserve((void **)&scene->trees, scene->tree_count, &scene->tree_capacity, sizeof *scene->trees)) {
        out_of_memory(scene, total, "triangles");
        goto out;
    }
    for (uint32_t g = 0; g < blas->geometry_count; g++)
        if (blas->geometries[g].type == GN_REF_TRIANGLES)
            gather_triangles(&gathering, commit, instance, g, in_world);
    const struct gn_ref_bvh_input input = {.primitives = gathering.primitives, .bounds = &gathering.bounds,
                                           .vertices = gathering.vertices,
                                           .corners = (const uint32_t (*)[3])gathering.corners,
                                           .count = gathering.count};
    done = gathering.count == 0 || gn_ref_bvh_build(&scene->trees[scene->tree_count], &input, commit->device,
                                                    scene->error, sizeof scene->error);
    if (done && gathering.count > 0)
        *out_tree = scene->tree_count++;
out:
    gathering_finish(&gathering);
    return done;
}

/* Extends bounds by a node's children, or what is below them as well, placed by a transform. */
static void node_place(struct gn_ref_bounds *bounds, const struct gn_ref_bvh *tree, uint32_t index, const float m[12],
                       int levels)
{
    const struct gn_ref_node *node = &tree->nodes[index];
    for (int c = 0; c < GN_REF_NODE_WIDTH && node->child[c] != GN_REF_NONE; c++) {
        if (levels > 0 && !(node->child[c] & GN_REF_LEAF_BIT)) {
            node_place(bounds, tree, node->child[c], m, levels - 1);
            continue;
        }
        for (int row = 0; row < 3; row++) {
            double middle = m[4 * row + 3], extent = 0, size = fabs(middle);
            for (int j = 0; j < 3; j++) {
                double factor = m[4 * row + j];
                double lower = node->lower[j][c] + tree->centre[j], upper = node->upper[j][c] + tree->centre[j];
                middle += factor * (lower + (upper - lower) / 2);
                extent += fabs(factor) * ((upper - lower) / 2);
                size += fabs(factor) * fmax(fabs(lower), fabs(upper));
            }
            /* A dozen roundings of numbers that are at most 2 size; without a bound the box is everything. */
            bounds_add(bounds, row, middle, size <= 0x1p1000 ? extent * (1 + 0x1p-48) + size * 0x1p-48 : INFINITY);
        }
    }
}

static bool instances_build(struct commit *commit, uint32_t live)
{
    struct gn_ref_scene *scene = commit->scene;
    struct gn_ref_bounds *bounds = malloc(live * sizeof *bounds);
    uint32_t *instances = malloc(live * sizeof *instances), count = 0;
    bool done = false;
    if (!bounds || !instances) {
        out_of_memory(scene, live, "instances");
        goto out;
    }
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct gn_ref_instance_data *data = &scene->instance_data[i];
        if (data->tree == GN_REF_NONE)
            continue;
        bounds[count] = nothing;
        node_place(&bounds[count], gn_ref_scene_tree(scene, i), 0,
                   data->shared ? scene->instances[i].transform : gn_ref_identity, 1);
        instances[count++] = i;
    }
    const struct gn_ref_bvh_input input = {.bounds = bounds, .instances = instances, .count = count};
    done = gn_ref_bvh_build(&scene->instance_bvh, &input, commit->device, scene->error, sizeof scene->error);
    scene->layered = done;
out:
    free(bounds);
    free(instances);
    return done;
}

static bool triangles_build(struct commit *commit)
{
    struct gn_ref_scene *scene = commit->scene;
    const uint32_t unknown = GN_REF_NONE - 1;
    uint32_t *of_blas = malloc((scene->blas_count + 1) * sizeof *of_blas), live = 0;
    bool done = false;
    if (!of_blas)
        return out_of_memory(scene, scene->blas_count, "BLASes");
    for (uint32_t b = 0; b < scene->blas_count; b++)
        of_blas[b] = unknown;
    scene->lone_instance = GN_REF_NONE;
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        struct gn_ref_instance_data *data = &scene->instance_data[i];
        uint32_t blas = scene->instances[i].blas;
        if (blas == GN_REF_NULL_BLAS)
            continue;
        uint32_t tree = data->shared ? of_blas[blas] : unknown;
        if (tree == unknown && !tree_add(commit, i, !data->shared, &tree))
            goto out;
        if (data->shared)
            of_blas[blas] = tree;
        data->tree = tree;
        if (tree == GN_REF_NONE)
            continue;
        live++;
        scene->lone_instance = i;
        scene->triangle_count += scene->trees[tree].triangle_count;
    }
    const struct gn_ref_instance_data *lone = live == 1 ? &scene->instance_data[scene->lone_instance] : NULL;
    bool in_world = lone && (!lone->shared || !gn_ref_effect_applies(GN_REF_EFFECT_INSTANCE_TRANSFORMS,
                                                                     !lone->matrix.identity, 0));
    done = live == 0 || in_world || instances_build(commit, live);
    scene->bytes = scene->instance_bvh.bytes + scene->instance_count * sizeof *scene->instance_data;
    for (uint32_t t = 0; t < scene->tree_count; t++)
        scene->bytes += scene->trees[t].bytes;
out:
    free(of_blas);
    return done;
}

static bool boxes_build(struct commit *commit, uint32_t most)
{
    struct gn_ref_scene *scene = commit->scene;
    bool done = false;
    if (most == 0)
        return true;
    struct gn_ref_bounds *bounds = malloc(most * sizeof *bounds);
    scene->boxes = malloc(most * sizeof *scene->boxes);
    scene->box_transforms = calloc(scene->instance_count, sizeof *scene->box_transforms);
    if (!bounds || !scene->boxes || !scene->box_transforms) {
        out_of_memory(scene, most, "boxes");
        goto out;
    }
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct gn_ref_blas *blas =
            scene->instances[i].blas == GN_REF_NULL_BLAS ? NULL : &scene->blases[scene->instances[i].blas];
        if (blas)
            box_transform_set(&scene->box_transforms[i], scene->instances[i].transform);
        for (uint32_t g = 0; blas && g < blas->geometry_count; g++) {
            const struct gn_ref_geometry *geometry = &blas->geometries[g];
            if (geometry->type != GN_REF_AABBS)
                continue;
            const float *transform = NULL;
            if (gn_ref_effect_applies(GN_REF_EFFECT_INSTANCE_TRANSFORMS, !scene->instance_data[i].matrix.identity,
                                      geometry->primitive_count))
                transform = scene->instances[i].transform;
            for (uint32_t p = 0; p < geometry->primitive_count; p++) {
                const float *box = geometry->aabbs[p];
                /* Inverted boxes contain nothing. */
                if (isnan(box[0]) || box[0] > box[3] || box[1] > box[4] || box[2] > box[5])
                    continue;
                bounds[scene->box_count] = box_bounds(box, transform);
                scene->boxes[scene->box_count++] = (struct gn_ref_primitive){i, g, p};
            }
        }
    }
    const struct gn_ref_bvh_input input = {.bounds = bounds, .count = scene->box_count};
    done = gn_ref_bvh_build(&scene->box_bvh, &input, commit->device, scene->error, sizeof scene->error);
out:
    free(bounds);
    return done;
}

/* What the instances and their geometries have in common, and what is prepared of each. */
static bool instances_prepare(struct gn_ref_scene *scene, uint64_t out_totals[2])
{
    bool any = false; /* geometry of an instance */
    scene->common_mask = 0xFF;
    scene->opacity = 1;
    scene->instance_data = calloc(scene->instance_count ? scene->instance_count : 1, sizeof *scene->instance_data);
    if (!scene->instance_data || scene->instance_count >= GN_REF_LEAF_BIT)
        return out_of_memory(scene, scene->instance_count, "instances");
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct gn_ref_instance *instance = &scene->instances[i];
        struct gn_ref_instance_data *data = &scene->instance_data[i];
        data->tree = GN_REF_NONE;
        if (instance->blas == GN_REF_NULL_BLAS)
            continue;
        data->determinant_sign = gn_ref_determinant_sign_exact(instance->transform);
        if (data->determinant_sign == 0)
            return fail(scene, "instance %u: the transform is singular, expected an invertible one", i);
        gn_ref_matrix_prepare(&data->matrix, instance->transform);
        data->shared = inverse_set(data, instance->transform);
        const struct gn_ref_blas *blas = &scene->blases[instance->blas];
        scene->common_mask &= instance->mask;
        scene->culls |= !(instance->flags & GN_REF_INSTANCE_FACING_CULL_DISABLE);
        scene->moved_instances += !data->matrix.identity;
        scene->turned |= data->determinant_sign < 0 || (instance->flags & GN_REF_INSTANCE_FLIP_FACING);
        for (uint32_t g = 0; g < blas->geometry_count; g++) {
            out_totals[blas->geometries[g].type] += blas->geometries[g].primitive_count;
            scene->moved_geometries += !blas->matrices[g].identity;
            int opaque = (blas->geometries[g].flags & GN_REF_GEOMETRY_OPAQUE) != 0;
            if (instance->flags & (GN_REF_INSTANCE_FORCE_OPAQUE | GN_REF_INSTANCE_FORCE_NO_OPAQUE))
                opaque = (instance->flags & GN_REF_INSTANCE_FORCE_OPAQUE) != 0;
            scene->opacity = !any ? opaque : scene->opacity == opaque ? opaque : -1;
            any = true;
        }
    }
    if (out_totals[0] >= MAX_PRIMITIVES || out_totals[1] >= MAX_PRIMITIVES - out_totals[0])
        return fail(scene, "%llu triangles and %llu boxes in all instances together, expected fewer than %u",
                    (unsigned long long)out_totals[0], (unsigned long long)out_totals[1], MAX_PRIMITIVES);
    return true;
}

bool gn_ref_scene_commit(struct gn_ref_scene *scene)
{
    struct commit commit = {.scene = scene};
    if (scene->committed)
        return fail(scene, "the scene is committed twice");
    struct gn_ref_environment environment;
    gn_ref_environment_enter(&environment);
    gn_ref_exact_init(&commit.exact);
    struct timespec start, end;
    clock_gettime(CLOCK_MONOTONIC, &start);

    uint64_t totals[2] = {0};
    bool done = instances_prepare(scene, totals);
    if (done && totals[0] + totals[1] > 0) {
        commit.device = gn_ref_bvh_device_create(scene->error, sizeof scene->error);
        done = commit.device && triangles_build(&commit) && boxes_build(&commit, (uint32_t)totals[1]);
        gn_ref_bvh_device_release(commit.device);
    }
    if (done) {
        clock_gettime(CLOCK_MONOTONIC, &end);
        scene->commit_seconds = (double)(end.tv_sec - start.tv_sec) + 1e-9 * (double)(end.tv_nsec - start.tv_nsec);
        scene->committed = true;
        scene->error[0] = '\0';
    } else {
        free(scene->instance_data);
        scene->instance_data = NULL;
    }
    gn_ref_exact_finish(&commit.exact);
    gn_ref_environment_leave(&environment);
    return done;
}

uint32_t gn_ref_scene_instance_count(const struct gn_ref_scene *scene)
{
    return scene->instance_count;
}

const struct gn_ref_instance *gn_ref_scene_instance(const struct gn_ref_scene *scene, uint32_t instance)
{
    return instance < scene->instance_count ? &scene->instances[instance] : NULL;
}

uint32_t gn_ref_scene_geometry_count(const struct gn_ref_scene *scene, uint32_t blas)
{
    return blas < scene->blas_count ? scene->blases[blas].geometry_count : 0;
}

const struct gn_ref_geometry *gn_ref_scene_geometry(const struct gn_ref_scene *scene, uint32_t blas,
                                                    uint32_t geometry)
{
    return geometry < gn_ref_scene_geometry_count(scene, blas) ? &scene->blases[blas].geometries[geometry] : NULL;
}
