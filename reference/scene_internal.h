/* SPDX-License-Identifier: Apache-2.0 */
/* What the files of the reference share: the committed scene, its trees, and the exact stage. */
#ifndef GNOMON_REFERENCE_SCENE_INTERNAL_H
#define GNOMON_REFERENCE_SCENE_INTERNAL_H

#include <fenv.h>
#include <gmp.h>
#include <math.h>
#include <string.h>

#include "reference/effects.h"

#define GN_REF_NODE_WIDTH 8
#define GN_REF_BLOCK_WIDTH 4
#define GN_REF_NONE UINT32_MAX
#define GN_REF_NO_ID UINT64_MAX
#define GN_REF_BOX_BIT 0x80000000u
/* Levels of the tree, root included; the traversal's stack is sized by it. */
#define GN_REF_MAX_DEPTH 96

/*
 * One active primitive of one instance. Its id says where it is: the instance in the upper half; in the lower a box is its
 * place in gn_ref_scene::boxes with GN_REF_BOX_BIT, a triangle leaf * 8 + lane of the instance's tree.
 */
struct gn_ref_primitive {
    uint32_t instance;
    uint32_t geometry;
    uint32_t primitive;
};

/* An f64 vertex in the world and the largest distance, in any coordinate, to the exact one. 0: it is the exact
 * one. Infinite: nothing is known, the exact stage has to decide everything. */
struct gn_ref_vertex {
    double w[3];
    double error;
};

/* Four triangles; w[vertex][axis][lane]. Unused lanes repeat a used one, with id GN_REF_NO_ID. */
struct gn_ref_block {
    double w[3][3][GN_REF_BLOCK_WIDTH];
    double error[GN_REF_BLOCK_WIDTH];
    uint64_t id[GN_REF_BLOCK_WIDTH];
};

/*
 * The triangles of a leaf where every vertex of the tree is an f32: w[vertex][axis][lane], exactly. No vertex is farther
 * along an axis from origin, an f32 close to their middle, than size times extent (the upper half of an f32's bits);
 * size is 2^exponent, and extents are at most 1. Lanes beyond the count repeat lane 0.
 */
struct gn_ref_leaf_f32 {
    float w[3][3][GN_REF_NODE_WIDTH];
    float origin[3];
    uint16_t extent[3];
    int16_t exponent;
    uint8_t count;
    bool fine; /* some vertex is not a multiple of gn_ref_bvh::quantum */
    uint8_t unused[10];
    uint32_t geometry[GN_REF_NODE_WIDTH], primitive[GN_REF_NODE_WIDTH];
};

/*
 * Where they are not f32: on a grid of the leaf's own. Vertex v of lane l is, along each axis, within 0.5625 size step of
 *     tree's centre + centre + size step k[v][axis][l],
 * size and step being powers of two, step at most 1. What is not known so well has an infinite step. Lanes beyond
 * the count are all 0.
 */
struct gn_ref_leaf_i16 {
    int16_t k[3][3][GN_REF_NODE_WIDTH];
    float centre[3];
    float step[3];
    float inverse_size; /* 1 / size */
    uint32_t first; /* of gn_ref_bvh::triangles */
    uint8_t count;
    uint8_t unused[15];
};
_Static_assert(sizeof(struct gn_ref_leaf_f32) == 384 && sizeof(struct gn_ref_leaf_i16) == 192, "lines of a cache");

/* A triangle in f64, with a bound of its vertices' error. w[vertex][axis]. */
struct gn_ref_triangle_f64 {
    double w[3][3];
    double error;
    uint32_t geometry, primitive;
};

#define GN_REF_LEAF_BIT 0x80000000u
/*
 * Bounds relative to the tree's centre, which contain what is below (rounded outward). bound + centre is an f64
 * exactly. An unused child has lower > upper and is GN_REF_NONE; a leaf is its index with GN_REF_LEAF_BIT.
 */
struct gn_ref_node {
    float lower[3][GN_REF_NODE_WIDTH];
    float upper[3][GN_REF_NODE_WIDTH];
    uint32_t child[GN_REF_NODE_WIDTH];
    uint32_t unused[8]; /* four lines of a cache */
};

/*
 * A tree over triangles (leaves of one kind), over boxes (ids) or over instances. A leaf has at most GN_REF_NODE_WIDTH; that of
 * a tree over instances is one instance, and its index the instance's.
 */
struct gn_ref_bvh {
    struct gn_ref_node *nodes; /* the root is the first; what follows is in the same piece of memory */
    uint64_t bytes; /* of it */
    uint32_t node_count;
    uint32_t leaf_count;
    uint32_t triangle_count;
    struct gn_ref_leaf_f32 *leaves_f32; /* or */
    struct gn_ref_leaf_i16 *leaves_i16; /* with */
    struct gn_ref_triangle_f64 *triangles; /* in the leaves' order */
    uint32_t (*boxes)[GN_REF_NODE_WIDTH]; /* ids of primitives, then GN_REF_NONE */
    double centre[3];
    double half[3]; /* no bound is larger in magnitude; may be infinite */
    double quantum; /* a power of two, or 0; the vertices of leaves_f32 are multiples but for those of fine leaves */
    double inverse_quantum;
};

struct gn_ref_bounds {
    float lower[3];
    float upper[3];
};

/* An interval of f64 that contains an exact value. */
struct gn_ref_interval {
    double lower;
    double upper;
};

/* A transform in integers: m[12] is what 1 has become. Not valid when its numbers span too many powers of two. */
struct gn_ref_matrix {
    int64_t m[13];
    bool valid;
    bool identity; /* changes nothing: need not be applied */
};
void gn_ref_matrix_prepare(struct gn_ref_matrix *out, const float transform[12]);

struct gn_ref_instance_data {
    struct gn_ref_matrix matrix;
    /* Columns of object from world without the translation, each entry to 4 * 2^-53 of itself (see inverse_set()). */
    double inverse[3][4];
    uint32_t tree; /* of gn_ref_scene::trees; GN_REF_NONE: no triangle */
    bool shared; /* the tree is in object space */
    int determinant_sign; /* exact; 0 for an inactive instance */
};

/* Of the linear part of an instance's transform; for the boxes. */
struct gn_ref_box_transform {
    struct gn_ref_interval adjugate[3][3];
    struct gn_ref_interval determinant;
};

struct gn_ref_blas {
    struct gn_ref_geometry *geometries;
    struct gn_ref_matrix *matrices; /* of the geometries, of triangles */
    uint32_t geometry_count;
};

struct gn_ref_scene {
    struct gn_ref_blas *blases;
    uint32_t blas_count, blas_capacity;
    struct gn_ref_instance *instances;
    struct gn_ref_instance_data *instance_data; /* from commit on */
    uint32_t instance_count, instance_capacity;
    bool committed;
    double commit_seconds; /* by the wall clock */
    /*
     * Triangles. A tree in object space serves all instances of a BLAS; an instance whose inverse magnifies errors too much
     * has one of its own, in the world. Above them is the tree over the instances, unless there is one tree alone, in the
     * world: then that is the root.
     */
    struct gn_ref_bvh *trees;
    uint32_t tree_count, tree_capacity;
    struct gn_ref_bvh instance_bvh;
    bool layered; /* there is an instance_bvh */
    uint32_t lone_instance; /* whose tree is the root otherwise; GN_REF_NONE: no triangles at all */
    uint64_t triangle_count; /* of all instances */
    uint64_t bytes; /* of these trees and what is kept of instances */
    uint32_t box_count; /* too */
    struct gn_ref_primitive *boxes;
    struct gn_ref_box_transform *box_transforms; /* of the instances, where there are boxes */
    struct gn_ref_bvh box_bvh;
    uint32_t common_mask; /* the bits that the masks of all active instances have */
    bool culls; /* some instance lets faces be culled */
    uint32_t moved_instances, moved_geometries; /* whose transforms are not the identity; geometries once per instance */
    bool turned; /* some instance is mirrored or flips its facing */
    int opacity; /* of every geometry of every instance, their flags considered: 1, 0, or -1 when they differ */
    char error[320];
};

/* What rays with these flags and this mask call for. */
static inline uint32_t gn_ref_effects_called(const struct gn_ref_scene *scene, uint32_t flags, uint32_t cull_mask)
{
    bool opaque = (flags & GN_REF_RAY_OPAQUE) || (scene->opacity == 1 && !(flags & GN_REF_RAY_NO_OPAQUE));
    bool culls = scene->culls && (flags & (GN_REF_RAY_CULL_BACK_FACING | GN_REF_RAY_CULL_FRONT_FACING));
    bool boxes = scene->box_count > 0 && !(flags & GN_REF_RAY_SKIP_AABBS);
    return (uint32_t)((scene->common_mask & cull_mask & 0xFF) == 0) << GN_REF_EFFECT_MASK |
           (uint32_t)(!opaque || (flags & GN_REF_RAY_CULL_OPAQUE)) << GN_REF_EFFECT_ANY_HIT |
           (uint32_t)culls << GN_REF_EFFECT_FACE_CULLING | (uint32_t)scene->turned << GN_REF_EFFECT_MIRRORING |
           (uint32_t)(scene->moved_instances > 0) << GN_REF_EFFECT_INSTANCE_TRANSFORMS |
           (uint32_t)(scene->moved_geometries > 0) << GN_REF_EFFECT_GEOMETRY_TRANSFORMS |
           (uint32_t)boxes << GN_REF_EFFECT_AABBS;
}
/* Of this thread's watch: what is forced on, where to count (NULL: nowhere), and counting one effect. */
uint32_t gn_ref_effects_forced(void);
struct gn_ref_effect_counts *gn_ref_effects_counting(void);
void gn_ref_effect_ran(enum gn_ref_effect effect, uint64_t times);
/* Whether an effect's code is to run where `called` says whether it makes a difference; counts it if so. */
bool gn_ref_effect_applies(enum gn_ref_effect effect, bool called, uint64_t times);
extern const float gn_ref_identity[12];

/* The tree that the traversal begins with; only where there are triangles. */
static inline const struct gn_ref_bvh *gn_ref_scene_root(const struct gn_ref_scene *scene)
{
    return scene->layered ? &scene->instance_bvh : &scene->trees[scene->instance_data[scene->lone_instance].tree];
}

static inline const struct gn_ref_bvh *gn_ref_scene_tree(const struct gn_ref_scene *scene, uint32_t instance)
{
    return &scene->trees[scene->instance_data[instance].tree];
}

static inline uint64_t gn_ref_id(uint32_t instance, uint32_t place)
{
    return (uint64_t)instance << 32 | place;
}

static inline uint32_t gn_ref_id_instance(uint64_t id)
{
    return (uint32_t)(id >> 32);
}

static inline bool gn_ref_id_is_box(uint64_t id)
{
    return id & GN_REF_BOX_BIT;
}

static inline struct gn_ref_primitive gn_ref_scene_primitive(const struct gn_ref_scene *scene, uint64_t id)
{
    uint32_t instance = gn_ref_id_instance(id), leaf = (uint32_t)id / GN_REF_NODE_WIDTH, lane = id % GN_REF_NODE_WIDTH;
    if (gn_ref_id_is_box(id))
        return scene->boxes[(uint32_t)id & ~GN_REF_BOX_BIT];
    const struct gn_ref_bvh *tree = gn_ref_scene_tree(scene, instance);
    if (tree->leaves_f32)
        return (struct gn_ref_primitive){instance, tree->leaves_f32[leaf].geometry[lane],
                                         tree->leaves_f32[leaf].primitive[lane]};
    const struct gn_ref_triangle_f64 *triangle = &tree->triangles[tree->leaves_i16[leaf].first + lane];
    return (struct gn_ref_primitive){instance, triangle->geometry, triangle->primitive};
}

/* The order of instance, geometry, primitive: -1, 0, 1. */
static inline int gn_ref_primitive_compare(const struct gn_ref_primitive *p, const struct gn_ref_primitive *q)
{
    if (p->instance != q->instance)
        return p->instance < q->instance ? -1 : 1;
    if (p->geometry != q->geometry)
        return p->geometry < q->geometry ? -1 : 1;
    return (p->primitive > q->primitive) - (p->primitive < q->primitive);
}

static inline int gn_ref_id_compare(const struct gn_ref_scene *scene, uint64_t a, uint64_t b)
{
    if (gn_ref_id_instance(a) != gn_ref_id_instance(b))
        return gn_ref_id_instance(a) < gn_ref_id_instance(b) ? -1 : 1;
    const struct gn_ref_primitive p = gn_ref_scene_primitive(scene, a), q = gn_ref_scene_primitive(scene, b);
    return gn_ref_primitive_compare(&p, &q);
}

/* Whether rays are taken into an instance's space, or its triangles are where the world has them. */
static inline bool gn_ref_instance_is_entered(const struct gn_ref_scene *scene, uint32_t instance, uint32_t forced)
{
    const struct gn_ref_instance_data *data = &scene->instance_data[instance];
    return data->shared && (!data->matrix.identity || (forced >> GN_REF_EFFECT_INSTANCE_TRANSFORMS & 1));
}

/* What a tree is built over: triangles; or, where those are NULL, boxes that are named by their place; or instances. */
struct gn_ref_bvh_input {
    const struct gn_ref_bounds *bounds; /* contain them; of triangles one that contains all */
    const struct gn_ref_primitive *primitives; /* of triangles */
    const struct gn_ref_vertex *vertices;
    const uint32_t (*corners)[3]; /* of vertices */
    const uint32_t *instances; /* NULL: no tree over instances */
    uint32_t count;
};
/* Embree's, of one thread; NULL, with a message, when there is none. */
struct RTCDeviceTy *gn_ref_bvh_device_create(char *error, size_t error_size);
/* Why there is none, after rtcNewDevice() gave none on this thread. */
void gn_ref_bvh_device_refused(char *error, size_t error_size);
void gn_ref_bvh_device_release(struct RTCDeviceTy *device);
/* False, with a message, when memory is short. */
bool gn_ref_bvh_build(struct gn_ref_bvh *out, const struct gn_ref_bvh_input *input, struct RTCDeviceTy *device, char *error,
                      size_t error_size);
void gn_ref_bvh_finish(struct gn_ref_bvh *bvh);
/* A triangle in the world, rounded in f64: its corners and the largest distance of a coordinate from the exact one. */
void gn_ref_triangle_place(const struct gn_ref_scene *scene, const struct gn_ref_primitive *primitive, double out[3][3],
                           double *out_error);

/* An exact number: numerator / denominator * 2^exponent, denominator > 0. */
struct gn_ref_ratio {
    mpz_t numerator;
    mpz_t denominator;
    long exponent;
};

/* Scratch of the exact stage, for one thread at a time; it grows and is kept, to save allocations. */
struct gn_ref_exact {
    mpz_t vertex[3][3];
    mpz_t cross[3];
    mpz_t direction[3];
    mpz_t scratch[24];
    mpz_t edge[4]; /* U, V, W and their sum */
    mpz_t weight;
    struct gn_ref_ratio t, t_exit, t_other;
};
void gn_ref_exact_init(struct gn_ref_exact *exact);
void gn_ref_exact_finish(struct gn_ref_exact *exact);

/* The sign of the determinant of the linear part of 3 rows of 4 finite floats. */
int gn_ref_determinant_sign_exact(const float transform[12]);
/* Whether the three vertices of an active triangle, placed in the world, are on one line. */
bool gn_ref_triangle_degenerate_exact(struct gn_ref_exact *exact, const struct gn_ref_scene *scene,
                                      const struct gn_ref_primitive *primitive);

/* What exact arithmetic says of a line and a triangle: the signs of U, V, W and of their sum. */
struct gn_ref_signs {
    int edge[3];
    int sum;
};
/*
 * The signs, exact->edge, and, when the line is not parallel to the triangle (signs.sum), exact->t.
 */
struct gn_ref_signs gn_ref_triangle_exact(struct gn_ref_exact *exact, const struct gn_ref_scene *scene,
                                          const struct gn_ref_primitive *primitive, const struct gn_ref_ray *ray);
/* Edge functions without opposite signs, not all zero; their sum then is not zero either. */
bool gn_ref_signs_meet(const struct gn_ref_signs *signs);

/* Whether the ray's closed range meets the box; then exact->t and exact->t_exit are where its *line* enters and
 * leaves it. */
bool gn_ref_box_exact(struct gn_ref_exact *exact, const struct gn_ref_scene *scene,
                      const struct gn_ref_primitive *primitive, const struct gn_ref_ray *ray);

/* The sign of a - b. b is finite. */
int gn_ref_ratio_compare_f64(struct gn_ref_exact *exact, const struct gn_ref_ratio *a, double b);
int gn_ref_ratio_compare(struct gn_ref_exact *exact, const struct gn_ref_ratio *a, const struct gn_ref_ratio *b);
void gn_ref_ratio_set(struct gn_ref_ratio *out, const struct gn_ref_ratio *in);
void gn_ref_ratio_set_f64(struct gn_ref_ratio *out, double value);
/*
 * numerator / denominator * 2^exponent, denominator > 0, rounded to nearest, once. Neither may be one of the scratch numbers.
 */
double gn_ref_quotient_f64(mpz_t scratch[3], mpz_srcptr numerator, mpz_srcptr denominator, long exponent);
/*
 * What such a number is wrong by: half an ulp, of small ones the least f64 (which half an ulp there is below), of 0 as well, which is
 * what underflows; and nothing known of what is beyond f64's range.
 */
static inline double gn_ref_rounding_error(double value)
{
    return fmax(0x1p-53 * fabs(value), 0x1p-1074);
}
double gn_ref_ratio_f64(struct gn_ref_exact *exact, const struct gn_ref_ratio *a);
/* An interval that contains it. */
struct gn_ref_interval gn_ref_ratio_interval(struct gn_ref_exact *exact, const struct gn_ref_ratio *a);
/* edge[index] / sum of the last triangle that met the line. */
double gn_ref_exact_barycentric(struct gn_ref_exact *exact, int index);

/*
 * The error analyses assume rounding to nearest and no flushing of denormals, but a thread of a graphics driver may
 * have left something else behind: between enter and leave the thread has the default environment.
 */
struct gn_ref_environment {
    fenv_t saved;
    bool changed;
};
void gn_ref_environment_enter(struct gn_ref_environment *environment);
void gn_ref_environment_leave(const struct gn_ref_environment *environment);

/*
 * A ray in an instance's object space: every component of origin and direction is wrong by at most the error (scene.c,
 * inverse_set(), with a margin for what is rounded here).
 */
/* (Nothing passes or gives vectors by value: how that is done depends on the instruction set.) */
typedef double gn_ref_v4 __attribute__((vector_size(32)));
typedef int64_t gn_ref_m4 __attribute__((vector_size(32)));
#define GN_REF_V4_ALL(a) ((gn_ref_v4){a, a, a, a})
#define GN_REF_V4_ABS(a) ((gn_ref_v4)((gn_ref_m4)(a) & INT64_MAX))
struct gn_ref_local_ray {
    gn_ref_v4 origin, direction; /* the last components are 0 */
    double origin_error, direction_error;
};

static inline void gn_ref_local_ray_set(struct gn_ref_local_ray *out, const struct gn_ref_scene *scene, uint32_t instance,
                                         const struct gn_ref_ray *ray)
{
    const struct gn_ref_instance_data *data = &scene->instance_data[instance];
    const float *m = scene->instances[instance].transform;
    gn_ref_v4 origin_size = {0}, direction_size = {0};
    out->origin = out->direction = origin_size;
    for (int j = 0; j < 3; j++) {
        gn_ref_v4 column;
        memcpy(&column, data->inverse[j], sizeof column);
        double q = ray->origin[j] - (double)m[4 * j + 3], d = ray->direction[j];
        const gn_ref_v4 a = column * GN_REF_V4_ALL(q), b = column * GN_REF_V4_ALL(d);
        out->origin += a;
        out->direction += b;
        origin_size += GN_REF_V4_ABS(a);
        direction_size += GN_REF_V4_ABS(b);
    }
    double origin_most = origin_size[0] > origin_size[1] ? origin_size[0] : origin_size[1];
    double direction_most = direction_size[0] > direction_size[1] ? direction_size[0] : direction_size[1];
    out->origin_error = 9.5 * 0x1p-53 * (origin_most > origin_size[2] ? origin_most : origin_size[2]);
    out->direction_error = 9.5 * 0x1p-53 * (direction_most > direction_size[2] ? direction_most : direction_size[2]);
}

/* What is computed once per ray. */
struct gn_ref_ray_setup {
    const struct gn_ref_ray *ray;
    double origin[3];
    int k[3]; /* the axes x, y, z of the sheared space; k[2] is where |direction| is largest */
    double shear[2]; /* direction[k[0]] and direction[k[1]] over direction[k[2]]: at most 1 in magnitude */
    double depth; /* direction[k[2]] */
    /* For the slab test: t = (bound + centre - origin) * scale + bias; see gn_ref_ray_prepare(). */
    double scale[3];
    double bias[3];
    bool swap[3]; /* the ray enters a box at the upper bound */
};
void gn_ref_ray_prepare(struct gn_ref_ray_setup *out, const struct gn_ref_ray *ray);
/*
 * The ray in an instance's object space, its slabs widened by what it is wrong by. Gives by how much every coordinate is wrong,
 * as if the vertices were; infinite when nothing can be said, and then no box is missed.
 */
double gn_ref_ray_prepare_object(struct gn_ref_ray_setup *out, const struct gn_ref_scene *scene, uint32_t instance,
                                 const struct gn_ref_ray *ray);

/* Bit i of the result: child i is not certainly missed within [tmin, limit]; near[i] is where it is entered. */
unsigned gn_ref_filter_node_f64(double near[GN_REF_NODE_WIDTH], const struct gn_ref_node *node,
                                const double centre[3], const struct gn_ref_ray_setup *setup, double tmin,
                                double limit);

/* The f64 filter's view of the four triangles of a block. Bit l of a mask is lane l. */
struct gn_ref_filter {
    unsigned used; /* holds a triangle at all */
    unsigned open; /* not certainly missed by the ray's line */
    unsigned certain; /* of these: certainly met */
    double edge[3][GN_REF_BLOCK_WIDTH]; /* U, V, W over the direction's depth */
    double edge_error[3][GN_REF_BLOCK_WIDTH];
    double z[3][GN_REF_BLOCK_WIDTH]; /* of the vertices, along k[2] */
    double vertex_error[GN_REF_BLOCK_WIDTH]; /* of each sheared coordinate and of z */
};
void gn_ref_filter_block_f64(struct gn_ref_filter *out, const struct gn_ref_block *block,
                             const struct gn_ref_ray_setup *setup);

/*
 * One triangle as the filter or the integers see it: edge functions up to a common positive factor, z of vertex -
 * origin, and bounds on what they are wrong by.
 */
struct gn_ref_lane {
    double edge[3];
    double edge_error[3];
    double z[3];
    double vertex_error; /* of z */
};
void gn_ref_filter_lane(struct gn_ref_lane *out, const struct gn_ref_filter *filter, int lane);

/* The ray in integers; origin[3] is the weight. */
struct gn_ref_ray_integers {
    int64_t origin[4];
    int64_t direction[3];
    bool valid;
};
void gn_ref_ray_integers_prepare(struct gn_ref_ray_integers *out, const struct gn_ref_ray *ray);

/*
 * The triangle by integers of fixed width: the edge functions' signs are exact (0 is zero), their values and z
 * correctly bounded. False when the numbers span too much for that.
 */
bool gn_ref_triangle_wide(struct gn_ref_lane *out, const struct gn_ref_scene *scene,
                          const struct gn_ref_primitive *primitive, const struct gn_ref_ray_setup *setup,
                          const struct gn_ref_ray_integers *ray);

/*
 * t and the barycentrics of a triangle that the line meets. False when the errors are too large to say anything.
 * barycentric_error bounds both.
 */
struct gn_ref_estimate {
    struct gn_ref_interval t;
    double t_value;
    double t_error;
    double beta, gamma;
    double barycentric_error;
    int sum_sign; /* of U + V + W */
};
bool gn_ref_estimate_f64(struct gn_ref_estimate *out, const struct gn_ref_lane *lane,
                         const struct gn_ref_ray_setup *setup);

/*
 * The range of t in which the ray's line is inside the box, as intervals: 1 when it is certain that the ray's closed
 * range meets the box, -1 when it is certain that it does not, 0 when this arithmetic cannot tell.
 */
int gn_ref_box_f64(struct gn_ref_interval *out_entry, struct gn_ref_interval *out_exit,
                   const struct gn_ref_scene *scene, const struct gn_ref_primitive *primitive, const struct gn_ref_ray *ray);

#endif
