/* SPDX-License-Identifier: Apache-2.0 */
/* What a judge keeps of a scene (judge_scene.c) for the verdicts (verdict.c). */
#ifndef GNOMON_REFERENCE_JUDGE_INTERNAL_H
#define GNOMON_REFERENCE_JUDGE_INTERNAL_H

#include <pthread.h>

#include "reference/verdict.h"

/* Half the distance between 1 and the next f32: the relative error of one correctly rounded f32 operation. */
#define GN_UNIT 0x1p-24

/*
 * Added to every size: an implementation may flush subnormal numbers, so what it computes with may be off by
 * 2^-126 even where the size is 0. As a multiple of the unit that is 2^-102.
 */
#define GN_SIZE_UNDERFLOW 0x1p-102

struct gn_judge_instance {
    bool active;
    double object_from_world[9]; /* the linear part, correct to a few 2^-53 */
    double absolute[9]; /* |M^-1|: entry by entry */
    double conditioning[9]; /* |M^-1||M||M^-1| */
    int orientation; /* the sign of det M */
};

/* Likewise a product of two sheared coordinates, whatever their sizes, in units. */
#define GN_PRODUCT_UNDERFLOW (0x1p-126 / GN_UNIT)

/* One triangle as a corner of the connectivity tables sees it. */
struct gn_judge_triangle {
    uint32_t geometry;
    uint32_t primitive;
    uint32_t vertex[3]; /* numbers that are equal exactly when the positions and geometry transforms are */
};

struct gn_judge_edge {
    uint32_t from, to; /* vertex numbers, in the triangle's winding */
    uint32_t triangle; /* into triangles */
    uint32_t corner; /* the edge is opposite to this corner */
};

/* Who shares which vertex and edge in a BLAS. Degenerate and inactive triangles are not in it. */
struct gn_judge_mesh {
    bool ready;
    bool failed; /* memory was short */
    struct gn_judge_triangle *triangles; /* sorted by geometry, primitive */
    size_t triangle_count;
    struct gn_judge_edge *edges; /* sorted by from, to */
    size_t edge_count;
};

struct gn_ref_judge {
    const struct gn_ref_scene *scene;
    uint32_t instance_count;
    struct gn_judge_instance *instances;
    bool has_aabbs;
    uint32_t blas_count;
    struct gn_judge_mesh *meshes; /* made when first needed, under the lock */
    pthread_mutex_t lock;
};

/* The connectivity of a BLAS; NULL when memory is short. */
const struct gn_judge_mesh *gn_judge_mesh_of(struct gn_ref_judge *judge, uint32_t blas);

/* The triangle's index in mesh->triangles, or SIZE_MAX. */
size_t gn_judge_mesh_find(const struct gn_judge_mesh *mesh, uint32_t geometry, uint32_t primitive);

/* The first edge from `from` to `to` in mesh->edges and how many there are. */
const struct gn_judge_edge *gn_judge_mesh_edges(const struct gn_judge_mesh *mesh, uint32_t from, uint32_t to,
                                                size_t *out_count);

/*
 * Vertices of a triangle after the geometry transform, correct to a few 2^-53 of their sizes, and the sizes.
 * False when the ids name no active triangle.
 */
bool gn_judge_triangle_vertices(const struct gn_ref_geometry *geometry, uint32_t primitive,
                                double out_vertices[3][3], double out_sizes[3][3]);

#endif
