/* SPDX-License-Identifier: Apache-2.0 */
/* What a judge keeps of a scene (judge_scene.c), and what judge_*.c find about a ray for the verdicts (verdict.c). */
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

/*
 * The bound k, counted for an f32 implementation that inverts the instance transform, moves the ray to object
 * space, and runs a watertight test there; every operation rounds once, every count is in units of the sizes:
 *   6  entries of the inverse (cofactor: product, difference; determinant: 3 more; division)
 *   4  matrix times vector (3 products summed, and the translation)
 *   1  vertex after the geometry transform beyond its own size, or the format's conversion
 *   4  vertex minus origin, slope of the direction, shear product, shear difference
 *   3  edge function: two products and their difference, counted in first-order changes
 *   6  t: sum of three products, scaling, division; f32 rounding of the reported numbers
 * 24 in all. It is not to be raised for a driver: what exceeds it is a finding.
 */
#define GN_BOUND 24.0

/* One triangle as one ray sees it, in the object space of the instance, relative to the ray's origin. */
struct gn_judge_view {
    double corner[3][3]; /* relative to the origin */
    double vertex_size[3][3]; /* of the vertex alone */
    double size[3][3]; /* of the corner: the vertex, less the origin, sheared along the ray */
    double edge[3]; /* U, V, W: edge[i] is the weight of corner i, and belongs to the opposite edge */
    double edge_change[3]; /* first-order change per unit */
    double det, det_change;
    double normal[3];
    double t; /* NaN when det is 0 */
    double weight[3];
    double t_change; /* first-order change of t per unit */
};
void gn_judge_view_make(const struct gn_ref_object_ray *ray, double vertices[3][3], double sizes[3][3],
                        struct gn_judge_view *view);
/* Of a triangle of the scene; false when the ids name none that is active. */
bool gn_judge_view_of(struct gn_ref_judge *judge, const struct gn_ref_ray *ray, uint32_t instance, uint32_t geometry,
                      uint32_t primitive, struct gn_judge_view *out);
/* How far inside (positive) or outside (negative) the ray is of the edge opposite to a corner, in units. */
double gn_judge_view_edge_margin(const struct gn_judge_view *view, int corner);
/* How far from edge-on, in units. */
double gn_judge_view_det_margin(const struct gn_judge_view *view);
/* The hit error of a reported hit, and the part of it that is to be held against the bound. */
void gn_judge_hit_error(const struct gn_ref_object_ray *ray, const struct gn_judge_view *view, double t, double b, double c,
                        double *out_error, double *out_conditioned);
/* The smallest margin of the decisions by which a ray meets an AABB; infinite for an inactive instance. */
double gn_judge_box_margin(struct gn_ref_judge *judge, const struct gn_ref_ray *ray, uint32_t instance, const float box[6]);

/* What the facts without tolerance say of a primitive: NULL when ray and flags admit it, else why not. */
struct gn_judge_facts {
    const struct gn_ref_instance *instance;
    const struct gn_ref_geometry *geometry;
    bool opaque;
    bool cull_possible; /* facing decides */
    bool front_culled; /* which facing is culled */
};
const char *gn_judge_facts_of(const struct gn_ref_judge *judge, const struct gn_ref_ray *ray, uint32_t instance,
                              uint32_t geometry, uint32_t primitive, struct gn_judge_facts *out);
/* The facing of a triangle, however small its margin. */
bool gn_judge_front(const struct gn_judge_view *view, const struct gn_ref_instance *instance);
/* The t at which the policy generates a hit on an AABB. */
float gn_judge_generated_t(const struct gn_ref_policy *policy, uint32_t primitive);

/* The ideal hits that can be committed, nearest first: an allocation of the caller's to free, or `local`. */
struct gn_judge_hits {
    struct gn_ref_hit local[32];
    struct gn_ref_hit *list;
    size_t count;
};
/* All that the ray meets; false when memory is short or the ray not valid. gn_judge_hits_finish() has to follow either way. */
bool gn_judge_hits_collect(struct gn_ref_judge *judge, const struct gn_ref_ray *ray, struct gn_judge_hits *hits);
/* Keeps what a policy commits; AABBs get the generated t. Restores the order. */
void gn_judge_hits_commit(struct gn_judge_hits *hits, const struct gn_ref_ray *ray, const struct gn_ref_policy *policy);
void gn_judge_hits_finish(struct gn_judge_hits *hits);

/*
 * Whether the triangles around the ray cover its whole neighbourhood: from one triangle on, every edge that a
 * small move may cross leads to exactly one neighbour, wound the same way and facing the same way, none of them
 * edge-on, culled, or near an end of the t range. Then a moved ray always meets one of them.
 */
struct gn_judge_flood {
    size_t *triangles; /* indices into the mesh, in the order they were reached */
    size_t count, capacity;
    uint32_t *slots; /* the same as a set: open addressing, index + 1 into triangles, 2 * capacity of them */
    bool covered;
};
/*
 * Fills a zeroed flood from a triangle on. A policy of NULL asks about candidates: then only what is not opaque
 * counts. False when memory is short.
 */
bool gn_judge_flood_fill(struct gn_ref_judge *judge, const struct gn_ref_ray *ray, const struct gn_ref_policy *policy,
                         uint32_t instance, const struct gn_judge_mesh *mesh, size_t start, struct gn_judge_flood *flood);
bool gn_judge_flood_has(const struct gn_judge_flood *flood, size_t triangle);
void gn_judge_flood_finish(struct gn_judge_flood *flood);

/*
 * What the lost hits of one ray have in common: the ones around one vertex share one flood, which is made once.
 * `found` are the primitives that the implementation did report for this ray: a crossing reported through another
 * triangle of the same fan is not lost.
 */
struct gn_judge_losses {
    struct gn_ref_judge *judge;
    const struct gn_ref_ray *ray;
    const struct gn_ref_policy *policy; /* NULL: candidates are judged */
    const struct gn_ref_answer *found;
    size_t found_count;
    struct gn_judge_flood flood;
    uint32_t flood_instance;
    bool flood_replaced; /* a triangle of it was reported */
};

/* What is found of a lost hit. */
struct gn_judge_loss {
    bool excused; /* one of its decisions is within the bound */
    bool covered; /* but the neighbourhood is covered, so that it is no excuse */
    bool replaced; /* a triangle that shares the edge or vertex was reported, so that nothing is lost */
    double margin; /* the smallest of its decisions */
};
/* Of an ideal hit that was not reported. False when memory is short. */
bool gn_judge_loss_of(struct gn_judge_losses *losses, const struct gn_ref_hit *lost, struct gn_judge_loss *out);

#endif
