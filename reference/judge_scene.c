/* SPDX-License-Identifier: Apache-2.0 */
/* What a judge needs of a scene besides its exact answers: inverse transforms with their sizes, and connectivity. */
#include "reference/judge_internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/*
 * The inverse in 113-bit arithmetic, rounded: its error against the exact inverse is about 2^-53 relative unless
 * the conditioning exceeds 2^55, which f32 entries reach only when the matrix is singular to f32 ten times over.
 */
typedef __float128 wide;

static bool instance_prepare(const struct gn_ref_instance *source, struct gn_judge_instance *out)
{
    wide m[9], inverse[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            m[3 * i + j] = source->transform[4 * i + j];
    wide det = m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
               m[2] * (m[3] * m[7] - m[4] * m[6]);
    if (det == 0)
        return false;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            int r0 = (j + 1) % 3, r1 = (j + 2) % 3, c0 = (i + 1) % 3, c1 = (i + 2) % 3;
            inverse[3 * i + j] = (m[3 * r0 + c0] * m[3 * r1 + c1] - m[3 * r0 + c1] * m[3 * r1 + c0]) / det;
        }
    }
    double middle[9];
    for (int i = 0; i < 9; i++) {
        out->object_from_world[i] = (double)inverse[i];
        out->absolute[i] = fabs((double)inverse[i]);
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            middle[3 * i + j] = 0;
            for (int k = 0; k < 3; k++)
                middle[3 * i + j] += out->absolute[3 * i + k] * fabs((double)m[3 * k + j]);
        }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            out->conditioning[3 * i + j] = 0;
            for (int k = 0; k < 3; k++)
                out->conditioning[3 * i + j] += middle[3 * i + k] * out->absolute[3 * k + j];
        }
    out->orientation = det > 0 ? 1 : -1;
    out->active = true;
    return true;
}

struct gn_ref_judge *gn_ref_judge_create(const struct gn_ref_scene *scene)
{
    struct gn_ref_judge *judge = calloc(1, sizeof *judge);
    if (!judge)
        return NULL;
    pthread_mutex_init(&judge->lock, NULL);
    judge->scene = scene;
    judge->instance_count = gn_ref_scene_instance_count(scene);
    judge->instances = calloc(judge->instance_count ? judge->instance_count : 1, sizeof *judge->instances);
    if (!judge->instances)
        goto fail;
    for (uint32_t i = 0; i < judge->instance_count; i++) {
        const struct gn_ref_instance *instance = gn_ref_scene_instance(scene, i);
        if (instance->blas == GN_REF_NULL_BLAS)
            continue;
        instance_prepare(instance, &judge->instances[i]);
        if (instance->blas >= judge->blas_count)
            judge->blas_count = instance->blas + 1;
    }
    judge->meshes = calloc(judge->blas_count ? judge->blas_count : 1, sizeof *judge->meshes);
    if (!judge->meshes)
        goto fail;
    for (uint32_t b = 0; b < judge->blas_count; b++)
        for (uint32_t g = 0; g < gn_ref_scene_geometry_count(scene, b); g++)
            if (gn_ref_scene_geometry(scene, b, g)->type == GN_REF_AABBS)
                judge->has_aabbs = true;
    return judge;
fail:
    gn_ref_judge_destroy(judge);
    return NULL;
}

void gn_ref_judge_destroy(struct gn_ref_judge *judge)
{
    if (!judge)
        return;
    for (uint32_t b = 0; judge->meshes && b < judge->blas_count; b++) {
        free(judge->meshes[b].triangles);
        free(judge->meshes[b].edges);
    }
    free(judge->meshes);
    free(judge->instances);
    pthread_mutex_destroy(&judge->lock);
    free(judge);
}

bool gn_judge_triangle_vertices(const struct gn_ref_geometry *geometry, uint32_t primitive,
                                double out_vertices[3][3], double out_sizes[3][3])
{
    if (!geometry || geometry->type != GN_REF_TRIANGLES || primitive >= geometry->primitive_count)
        return false;
    const float *g = geometry->transform;
    for (int c = 0; c < 3; c++) {
        const double *p = geometry->positions[geometry->triangles[primitive][c]];
        if (isnan(p[0]))
            return false;
        for (int i = 0; i < 3; i++) {
            if (g) {
                const float *row = g + 4 * i;
                double x = row[0] * p[0], y = row[1] * p[1], z = row[2] * p[2], w = row[3] * geometry->divisor;
                out_vertices[c][i] = (x + y + z + w) / geometry->divisor;
                out_sizes[c][i] = (fabs(x) + fabs(y) + fabs(z) + fabs(w)) / geometry->divisor;
            } else {
                out_vertices[c][i] = p[i] / geometry->divisor;
                out_sizes[c][i] = fabs(out_vertices[c][i]);
            }
            out_sizes[c][i] += GN_SIZE_UNDERFLOW;
        }
    }
    return true;
}

/* A corner on its way to a vertex number. */
struct corner {
    double position[3];
    uint32_t transform; /* the first geometry that has the same transform and divisor */
    uint32_t triangle;
    uint32_t corner;
};

static int corner_compare(const void *left, const void *right)
{
    const struct corner *a = left, *b = right;
    for (int i = 0; i < 3; i++)
        if (a->position[i] != b->position[i])
            return a->position[i] < b->position[i] ? -1 : 1;
    return a->transform < b->transform ? -1 : a->transform > b->transform;
}

static int edge_compare(const void *left, const void *right)
{
    const struct gn_judge_edge *a = left, *b = right;
    if (a->from != b->from)
        return a->from < b->from ? -1 : 1;
    if (a->to != b->to)
        return a->to < b->to ? -1 : 1;
    return a->triangle < b->triangle ? -1 : a->triangle > b->triangle;
}

static bool same_transform(const struct gn_ref_geometry *a, const struct gn_ref_geometry *b)
{
    if (a->divisor != b->divisor || !a->transform != !b->transform)
        return false;
    return !a->transform || memcmp(a->transform, b->transform, 12 * sizeof(float)) == 0;
}

static bool mesh_make(const struct gn_ref_scene *scene, uint32_t blas, struct gn_judge_mesh *mesh)
{
    uint32_t geometry_count = gn_ref_scene_geometry_count(scene, blas);
    struct corner *corners = NULL;
    uint32_t *classes = calloc(geometry_count ? geometry_count : 1, sizeof *classes);
    size_t capacity = 0, count = 0, vertex = 0;
    if (!classes)
        goto fail;
    for (uint32_t g = 0; g < geometry_count; g++) {
        const struct gn_ref_geometry *geometry = gn_ref_scene_geometry(scene, blas, g);
        if (geometry->type != GN_REF_TRIANGLES)
            continue;
        capacity += geometry->primitive_count;
        /* Hundreds of geometries in one BLAS are real; tens of thousands are not worth a hash table here. */
        classes[g] = g;
        for (uint32_t h = 0; h < g; h++) {
            const struct gn_ref_geometry *other = gn_ref_scene_geometry(scene, blas, h);
            if (classes[h] == h && other->type == GN_REF_TRIANGLES && same_transform(geometry, other)) {
                classes[g] = h;
                break;
            }
        }
    }
    mesh->triangles = calloc(capacity ? capacity : 1, sizeof *mesh->triangles);
    mesh->edges = calloc(capacity ? capacity : 1, 3 * sizeof *mesh->edges);
    corners = calloc(capacity ? capacity : 1, 3 * sizeof *corners);
    if (!mesh->triangles || !mesh->edges || !corners)
        goto fail;
    for (uint32_t g = 0; g < geometry_count; g++) {
        const struct gn_ref_geometry *geometry = gn_ref_scene_geometry(scene, blas, g);
        if (geometry->type != GN_REF_TRIANGLES)
            continue;
        for (uint32_t p = 0; p < geometry->primitive_count; p++) {
            double vertices[3][3], sizes[3][3];
            if (!gn_judge_triangle_vertices(geometry, p, vertices, sizes))
                continue;
            for (uint32_t c = 0; c < 3; c++) {
                struct corner *corner = &corners[3 * count + c];
                const double *position = geometry->positions[geometry->triangles[p][c]];
                for (int i = 0; i < 3; i++)
                    corner->position[i] = position[i] + 0.0; /* -0 becomes 0: the same position */
                corner->transform = classes[g];
                corner->triangle = (uint32_t)count;
                corner->corner = c;
            }
            mesh->triangles[count++] = (struct gn_judge_triangle){.geometry = g, .primitive = p};
        }
    }
    qsort(corners, 3 * count, sizeof *corners, corner_compare);
    for (size_t i = 0; i < 3 * count; i++) {
        if (i && corner_compare(&corners[i - 1], &corners[i]) != 0)
            vertex++;
        mesh->triangles[corners[i].triangle].vertex[corners[i].corner] = (uint32_t)vertex;
    }
    mesh->triangle_count = count;
    for (size_t i = 0; i < count; i++) {
        const uint32_t *v = mesh->triangles[i].vertex;
        if (v[0] == v[1] || v[1] == v[2] || v[2] == v[0])
            continue;
        for (uint32_t c = 0; c < 3; c++)
            mesh->edges[mesh->edge_count++] = (struct gn_judge_edge){
                .from = v[(c + 1) % 3], .to = v[(c + 2) % 3], .triangle = (uint32_t)i, .corner = c};
    }
    qsort(mesh->edges, mesh->edge_count, sizeof *mesh->edges, edge_compare);
    free(corners);
    free(classes);
    return true;
fail:
    free(corners);
    free(classes);
    free(mesh->triangles);
    free(mesh->edges);
    *mesh = (struct gn_judge_mesh){.failed = true};
    return false;
}

const struct gn_judge_mesh *gn_judge_mesh_of(struct gn_ref_judge *judge, uint32_t blas)
{
    struct gn_judge_mesh *mesh = &judge->meshes[blas];
    pthread_mutex_lock(&judge->lock);
    if (!mesh->ready) {
        mesh->failed = !mesh_make(judge->scene, blas, mesh);
        mesh->ready = true;
    }
    pthread_mutex_unlock(&judge->lock);
    return mesh->failed ? NULL : mesh;
}

size_t gn_judge_mesh_find(const struct gn_judge_mesh *mesh, uint32_t geometry, uint32_t primitive)
{
    size_t low = 0, high = mesh->triangle_count;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        const struct gn_judge_triangle *t = &mesh->triangles[middle];
        if (t->geometry < geometry || (t->geometry == geometry && t->primitive < primitive))
            low = middle + 1;
        else
            high = middle;
    }
    if (low < mesh->triangle_count && mesh->triangles[low].geometry == geometry &&
        mesh->triangles[low].primitive == primitive)
        return low;
    return SIZE_MAX;
}

const struct gn_judge_edge *gn_judge_mesh_edges(const struct gn_judge_mesh *mesh, uint32_t from, uint32_t to,
                                                size_t *out_count)
{
    size_t low = 0, high = mesh->edge_count;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        const struct gn_judge_edge *e = &mesh->edges[middle];
        if (e->from < from || (e->from == from && e->to < to))
            low = middle + 1;
        else
            high = middle;
    }
    size_t end = low;
    while (end < mesh->edge_count && mesh->edges[end].from == from && mesh->edges[end].to == to)
        end++;
    *out_count = end - low;
    return mesh->edges + low;
}
