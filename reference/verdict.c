/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The verdict: an answer is held against the exact one, and where they differ, against how far the problem would
 * have to be moved. docs/numerics.md derives the sizes, the first-order changes and the bound used here.
 */
#include "reference/judge_internal.h"

#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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
static const double bound = 24;

/* Fans with more triangles than this are not followed; the loss then counts as a gap, never as a leak. */
enum { FLOOD_LIMIT = 4096 };

double gn_ref_verdict_bound(void)
{
    return bound;
}

const char *gn_ref_verdict_class_name(enum gn_ref_verdict_class cls)
{
    static const char *const names[] = {"exact", "admissible", "gap", "leak", "double hit", "wrong"};
    return cls < GN_REF_VERDICT_CLASS_COUNT ? names[cls] : "unknown";
}

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

static double dot_absolute(const double a[3], const double size[3])
{
    return fabs(a[0]) * size[0] + fabs(a[1]) * size[1] + fabs(a[2]) * size[2];
}

bool gn_ref_judge_object_ray(const struct gn_ref_judge *judge, const struct gn_ref_ray *ray, uint32_t instance,
                             struct gn_ref_object_ray *out)
{
    if (instance >= judge->instance_count || !judge->instances[instance].active)
        return false;
    const struct gn_judge_instance *prepared = &judge->instances[instance];
    const float *m = gn_ref_scene_instance(judge->scene, instance)->transform;
    double moved[3], moved_size[3];
    for (int i = 0; i < 3; i++) {
        moved[i] = (double)ray->origin[i] - (double)m[4 * i + 3];
        moved_size[i] = fabs((double)ray->origin[i]) + fabs((double)m[4 * i + 3]);
    }
    for (int i = 0; i < 3; i++) {
        double origin = 0, direction = 0, size_o = 0, size_d = 0, translation = 0, size_t_ = 0;
        for (int j = 0; j < 3; j++) {
            double entry = prepared->object_from_world[3 * i + j], size = prepared->conditioning[3 * i + j];
            origin += entry * moved[j];
            direction += entry * (double)ray->direction[j];
            size_o += size * moved_size[j];
            size_d += size * fabs((double)ray->direction[j]);
            translation -= entry * (double)m[4 * j + 3];
            size_t_ += size * fabs((double)m[4 * j + 3]);
            out->object_from_world[4 * i + j] = entry;
            out->size_object_from_world[4 * i + j] = size + GN_SIZE_UNDERFLOW;
        }
        out->origin[i] = origin;
        out->size_origin[i] = size_o + GN_SIZE_UNDERFLOW;
        out->direction[i] = direction;
        out->size_direction[i] = size_d + GN_SIZE_UNDERFLOW;
        out->object_from_world[4 * i + 3] = translation;
        out->size_object_from_world[4 * i + 3] = size_t_ + GN_SIZE_UNDERFLOW;
    }
    return true;
}

bool gn_ref_judge_vertices(const struct gn_ref_judge *judge, uint32_t instance, uint32_t geometry,
                           uint32_t primitive, double out_vertices[3][3], double out_sizes[3][3], bool *out_exact)
{
    if (instance >= judge->instance_count || !judge->instances[instance].active)
        return false;
    uint32_t blas = gn_ref_scene_instance(judge->scene, instance)->blas;
    const struct gn_ref_geometry *source = gn_ref_scene_geometry(judge->scene, blas, geometry);
    if (!gn_judge_triangle_vertices(source, primitive, out_vertices, out_sizes))
        return false;
    *out_exact = !source->transform && source->divisor == 1;
    return true;
}

/* One triangle as one ray sees it, in the object space of the instance, relative to the ray's origin. */
struct view {
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

static int dominant_axis(const double direction[3])
{
    int k = 0;
    for (int i = 1; i < 3; i++)
        if (fabs(direction[i]) > fabs(direction[k]))
            k = i;
    return k;
}

static void view_make(const struct gn_ref_object_ray *ray, double vertices[3][3], double sizes[3][3],
                      struct view *view)
{
    double side[3][3], products[3][3];
    int k = dominant_axis(ray->direction);
    for (int c = 0; c < 3; c++) {
        double depth = fabs((vertices[c][k] - ray->origin[k]) / ray->direction[k]);
        for (int i = 0; i < 3; i++) {
            view->corner[c][i] = vertices[c][i] - ray->origin[i];
            view->vertex_size[c][i] = sizes[c][i];
            view->size[c][i] = sizes[c][i] + fabs(view->corner[c][i]) + fabs(ray->direction[i]) * depth;
        }
    }
    for (int c = 0; c < 3; c++) {
        cross(view->corner[(c + 1) % 3], view->corner[(c + 2) % 3], products[c]);
        cross(view->corner[c], ray->direction, side[c]);
    }
    double edge_a[3], edge_b[3];
    for (int i = 0; i < 3; i++) {
        edge_a[i] = vertices[1][i] - vertices[0][i];
        edge_b[i] = vertices[2][i] - vertices[0][i];
    }
    cross(edge_a, edge_b, view->normal);
    view->det_change = dot_absolute(view->normal, ray->size_direction);
    for (int c = 0; c < 3; c++) {
        int n = (c + 1) % 3, p = (c + 2) % 3;
        double between[3]; /* (p - n) x d: how U changes when both ends of its edge move alike */
        for (int i = 0; i < 3; i++)
            between[i] = side[p][i] - side[n][i];
        view->edge[c] = dot(ray->direction, products[c]);
        view->edge_change[c] =
            GN_UNIT * (dot_absolute(products[c], ray->size_direction) + dot_absolute(side[p], view->size[n]) +
                       dot_absolute(side[n], view->size[p]) + dot_absolute(between, ray->size_origin) +
                       fabs(ray->direction[k]) * GN_PRODUCT_UNDERFLOW);
        view->det_change += dot_absolute(between, view->size[c]);
    }
    view->det_change = GN_UNIT * (view->det_change + fabs(ray->direction[k]) * GN_PRODUCT_UNDERFLOW);
    view->det = dot(ray->direction, view->normal);
    view->t = NAN;
    view->t_change = INFINITY;
    view->weight[0] = view->weight[1] = view->weight[2] = NAN;
    if (view->det != 0) {
        double moved = 0;
        view->t = dot(view->normal, view->corner[0]) / view->det;
        for (int c = 0; c < 3; c++)
            view->weight[c] = view->edge[c] / view->det;
        for (int i = 0; i < 3; i++) {
            double size = ray->size_origin[i] + fabs(view->t) * ray->size_direction[i];
            for (int c = 0; c < 3; c++)
                size += fabs(view->weight[c]) * view->size[c][i];
            moved += fabs(view->normal[i]) * size;
        }
        view->t_change = GN_UNIT * moved / fabs(view->det);
    }
}

/* How far inside (positive) or outside (negative) the ray is of the edge opposite to a corner, in units. */
static double view_edge_margin(const struct view *view, int corner)
{
    double value = view->det < 0 ? -view->edge[corner] : view->edge[corner];
    return value / view->edge_change[corner];
}

static double view_det_margin(const struct view *view)
{
    return fabs(view->det) / view->det_change;
}

static bool view_of(struct gn_ref_judge *judge, const struct gn_ref_ray *ray, uint32_t instance,
                    uint32_t geometry, uint32_t primitive, struct view *out)
{
    struct gn_ref_object_ray object;
    double vertices[3][3], sizes[3][3];
    bool exact;
    if (!gn_ref_judge_object_ray(judge, ray, instance, &object) ||
        !gn_ref_judge_vertices(judge, instance, geometry, primitive, vertices, sizes, &exact))
        return false;
    view_make(&object, vertices, sizes, out);
    return true;
}

/*
 * The hit error: the residual of o + t d = aA + bB + cC per size. a is not reported, so the rounding of b and c
 * moves it, hence its size is |a|+|b|+|c|.
 *
 * The conditioning: a watertight test takes the weights from the products of its sheared coordinates x, y, whose
 * rounding is divided by det. That moves the hit sideways, by at most the corners' own distance from the ray; it exceeds
 * the sizes for grazing rays and slivers only. out_conditioned is what is to be held against the bound.
 */
static void hit_error_of(const struct gn_ref_object_ray *ray, const struct view *view, double t, double b,
                         double c, double *out_error, double *out_conditioned)
{
    double a = 1 - b - c, weights[3] = {fabs(a) + fabs(b) + fabs(c), fabs(b), fabs(c)};
    int k = dominant_axis(ray->direction), kx = (k + 1) % 3, ky = (k + 2) % 3;
    double x[3], y[3], sideways[3] = {0}, det = fabs(view->det / ray->direction[k]);
    for (int corner = 0; corner < 3; corner++) {
        double depth = view->corner[corner][k] / ray->direction[k];
        x[corner] = view->corner[corner][kx] - ray->direction[kx] * depth;
        y[corner] = view->corner[corner][ky] - ray->direction[ky] * depth;
    }
    for (int corner = 0; corner < 3; corner++) {
        int n = (corner + 1) % 3, p = (corner + 2) % 3;
        double products = fabs(x[n] * y[p]) + fabs(y[n] * x[p]) + GN_PRODUCT_UNDERFLOW, most = 1 / (bound * GN_UNIT);
        double moved = products < most * det ? products / det : most;
        sideways[kx] += moved * fabs(x[corner]);
        sideways[ky] += moved * fabs(y[corner]);
    }
    double error = 0, conditioned = 0;
    for (int i = 0; i < 3; i++) {
        double residual =
            t * ray->direction[i] - a * view->corner[0][i] - b * view->corner[1][i] - c * view->corner[2][i];
        double size = ray->size_origin[i] + fabs(t) * ray->size_direction[i], all = size + sideways[i];
        for (int corner = 0; corner < 3; corner++) {
            size += weights[corner] * view->vertex_size[corner][i];
            all += weights[corner] * view->size[corner][i];
        }
        error = fmax(error, fabs(residual) / (GN_UNIT * size));
        conditioned = fmax(conditioned, fabs(residual) / (GN_UNIT * all));
    }
    *out_error = error;
    *out_conditioned = conditioned;
}

static void reason_set(struct gn_ref_verdict *verdict, const char *format, ...)
    __attribute__((format(printf, 2, 3)));
static void reason_set(struct gn_ref_verdict *verdict, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(verdict->reason, sizeof verdict->reason, format, arguments);
    va_end(arguments);
}

/* A verdict gets worse, never better; the reason is that of the worst. */
static bool worsens(struct gn_ref_verdict *verdict, enum gn_ref_verdict_class cls, double margin)
{
    if (margin > verdict->margin)
        verdict->margin = margin;
    if (cls <= verdict->cls)
        return false;
    verdict->cls = cls;
    return true;
}

/* What the facts without tolerance say of a primitive: NULL when ray and flags admit it, else why not. */
struct facts {
    const struct gn_ref_instance *instance;
    const struct gn_ref_geometry *geometry;
    bool opaque;
    bool cull_possible; /* facing decides */
    bool front_culled; /* which facing is culled */
};

static const char *facts_of(const struct gn_ref_judge *judge, const struct gn_ref_ray *ray, uint32_t instance,
                            uint32_t geometry, uint32_t primitive, struct facts *out)
{
    if (instance >= judge->instance_count)
        return "names an instance that does not exist";
    out->instance = gn_ref_scene_instance(judge->scene, instance);
    if (!judge->instances[instance].active)
        return "names an inactive instance";
    out->geometry = gn_ref_scene_geometry(judge->scene, out->instance->blas, geometry);
    if (!out->geometry)
        return "names a geometry that the structure does not have";
    if (primitive >= out->geometry->primitive_count)
        return "names a primitive that the geometry does not have";
    if (!(out->instance->mask & ray->cull_mask & 0xFF))
        return "names an instance that the cull mask excludes";
    bool triangles = out->geometry->type == GN_REF_TRIANGLES;
    if (ray->flags & (triangles ? GN_REF_RAY_SKIP_TRIANGLES : GN_REF_RAY_SKIP_AABBS))
        return "names a primitive of a type that the ray skips";
    out->opaque = out->geometry->flags & GN_REF_GEOMETRY_OPAQUE;
    if (out->instance->flags & GN_REF_INSTANCE_FORCE_OPAQUE)
        out->opaque = true;
    else if (out->instance->flags & GN_REF_INSTANCE_FORCE_NO_OPAQUE)
        out->opaque = false;
    if (ray->flags & GN_REF_RAY_OPAQUE)
        out->opaque = true;
    else if (ray->flags & GN_REF_RAY_NO_OPAQUE)
        out->opaque = false;
    if (ray->flags & (out->opaque ? GN_REF_RAY_CULL_OPAQUE : GN_REF_RAY_CULL_NO_OPAQUE))
        return "names a primitive that is culled by its opacity";
    out->cull_possible = triangles &&
                         (ray->flags & (GN_REF_RAY_CULL_BACK_FACING | GN_REF_RAY_CULL_FRONT_FACING)) &&
                         !(out->instance->flags & GN_REF_INSTANCE_FACING_CULL_DISABLE);
    out->front_culled = ray->flags & GN_REF_RAY_CULL_FRONT_FACING;
    return NULL;
}

static bool view_front(const struct view *view, const struct gn_ref_instance *instance)
{
    return (view->det < 0) != !!(instance->flags & GN_REF_INSTANCE_FLIP_FACING);
}

static bool policy_takes(const struct gn_ref_policy *policy, const struct gn_ref_hit *hit)
{
    if (hit->type == GN_REF_AABBS)
        return policy->generate_mask >> (hit->primitive & 31) & 1;
    return hit->opaque || (policy->confirm_mask >> (hit->primitive & 31) & 1);
}

static float generated_t(const struct gn_ref_policy *policy, uint32_t primitive)
{
    return policy->generate_t0 + policy->generate_step * (float)primitive;
}

/* The ideal hits that can be committed, nearest first: an allocation of the caller's to free, or `local`. */
struct hits {
    struct gn_ref_hit local[32];
    struct gn_ref_hit *list;
    size_t count;
};

static void hits_finish(struct hits *hits)
{
    if (hits->list != hits->local)
        free(hits->list);
}

static bool hits_collect(struct gn_ref_judge *judge, const struct gn_ref_ray *ray, struct hits *hits)
{
    hits->list = hits->local;
    int64_t found = gn_ref_trace_all_exact(judge->scene, ray, hits->local, 32);
    if (found > 32) {
        hits->list = calloc((size_t)found, sizeof *hits->list);
        if (!hits->list) {
            hits->list = hits->local;
            return false;
        }
        found = gn_ref_trace_all_exact(judge->scene, ray, hits->list, (size_t)found);
    }
    hits->count = found > 0 ? (size_t)found : 0;
    return found >= 0;
}

/* Keeps what a policy commits; AABBs get the generated t. Restores the order. */
static void hits_commit(struct hits *hits, const struct gn_ref_ray *ray, const struct gn_ref_policy *policy)
{
    size_t kept = 0;
    for (size_t i = 0; i < hits->count; i++) {
        struct gn_ref_hit hit = hits->list[i];
        if (!policy_takes(policy, &hit))
            continue;
        if (hit.type == GN_REF_AABBS) {
            hit.t = (double)generated_t(policy, hit.primitive);
            if (!(hit.t >= (double)ray->tmin && hit.t <= (double)ray->tmax))
                continue;
        }
        size_t at = kept++;
        /* Triangles are in exact order already, and stay so: only generated hits move. */
        while (at && (hit.type == GN_REF_AABBS || hits->list[at - 1].type == GN_REF_AABBS) &&
               hits->list[at - 1].t > hit.t) {
            hits->list[at] = hits->list[at - 1];
            at--;
        }
        hits->list[at] = hit;
    }
    hits->count = kept;
}

/*
 * The smallest margin of the decisions by which a ray meets an AABB: it enters every slab, and the t range, before it
 * leaves any other. Ends of the t range are given, so they do not move.
 */
static double box_margin(struct gn_ref_judge *judge, const struct gn_ref_ray *ray, uint32_t instance,
                         const float box[6])
{
    struct gn_ref_object_ray object;
    if (!gn_ref_judge_object_ray(judge, ray, instance, &object))
        return INFINITY;
    double enter[4] = {(double)ray->tmin}, leave[4] = {(double)ray->tmax};
    double enter_change[4] = {0}, leave_change[4] = {0}, margin = INFINITY;
    int count = 1;
    for (int i = 0; i < 3; i++) {
        double o = object.origin[i], d = object.direction[i];
        double near_plane = (double)box[d > 0 ? i : 3 + i], far_plane = (double)box[d > 0 ? 3 + i : i];
        if (fabs(d) <= bound * GN_UNIT * object.size_direction[i]) {
            /* As good as parallel: inside or outside of the slab is a decision of its own. */
            double size = GN_UNIT * (object.size_origin[i] + fmax(fabs(near_plane), fabs(far_plane)));
            margin = fmin(margin, fmin(fabs(o - near_plane), fabs(far_plane - o)) / size);
            continue;
        }
        enter[count] = (near_plane - o) / d;
        leave[count] = (far_plane - o) / d;
        enter_change[count] = GN_UNIT / fabs(d) *
                              (object.size_origin[i] + fabs(enter[count]) * object.size_direction[i] + fabs(near_plane));
        leave_change[count] = GN_UNIT / fabs(d) *
                              (object.size_origin[i] + fabs(leave[count]) * object.size_direction[i] + fabs(far_plane));
        count++;
    }
    for (int e = 0; e < count; e++)
        for (int l = 0; l < count; l++)
            if (enter_change[e] + leave_change[l] > 0)
                margin = fmin(margin, fabs(leave[l] - enter[e]) / (enter_change[e] + leave_change[l]));
    return margin;
}

/*
 * Whether the triangles around the ray cover its whole neighbourhood: from one triangle on, every edge that a
 * small move may cross leads to exactly one neighbour, wound the same way and facing the same way, none of them
 * edge-on, culled, or near an end of the t range. Then a moved ray always meets one of them.
 */
struct flood {
    size_t *triangles; /* indices into the mesh, in the order they were reached */
    size_t count, capacity;
    uint32_t *slots; /* the same as a set: open addressing, index + 1 into triangles, 2 * capacity of them */
    bool covered;
};

static void flood_finish(struct flood *flood)
{
    free(flood->triangles);
    free(flood->slots);
    *flood = (struct flood){0};
}

static uint32_t *flood_slot(const struct flood *flood, size_t triangle)
{
    size_t mask = 2 * flood->capacity - 1, at = (triangle * 0x9E3779B97F4A7C15u >> 20) & mask;
    while (flood->slots[at] && flood->triangles[flood->slots[at] - 1] != triangle)
        at = (at + 1) & mask;
    return &flood->slots[at];
}

static bool flood_has(const struct flood *flood, size_t triangle)
{
    return flood->capacity && *flood_slot(flood, triangle);
}

static bool flood_add(struct flood *flood, size_t triangle)
{
    if (flood->count == flood->capacity) {
        size_t capacity = flood->capacity ? 4 * flood->capacity : 32;
        size_t *triangles = realloc(flood->triangles, capacity * sizeof *triangles);
        uint32_t *slots = calloc(2 * capacity, sizeof *slots);
        if (triangles)
            flood->triangles = triangles;
        if (!triangles || !slots) {
            free(slots);
            return false;
        }
        free(flood->slots);
        flood->slots = slots;
        flood->capacity = capacity;
        for (size_t i = 0; i < flood->count; i++)
            *flood_slot(flood, triangles[i]) = (uint32_t)i + 1;
    }
    flood->triangles[flood->count++] = triangle;
    *flood_slot(flood, triangle) = (uint32_t)flood->count;
    return true;
}

/* Whether a triangle of the fan lets no small move through: eligible, surely not edge-on, surely in range. */
static bool flood_is_solid(struct gn_ref_judge *judge, const struct gn_ref_ray *ray,
                           const struct gn_ref_policy *policy, uint32_t instance,
                           const struct gn_judge_triangle *triangle, struct view *view, int *facing)
{
    struct facts facts;
    if (facts_of(judge, ray, instance, triangle->geometry, triangle->primitive, &facts) != NULL)
        return false;
    if (policy ? !facts.opaque && !(policy->confirm_mask >> (triangle->primitive & 31) & 1) : facts.opaque)
        return false;
    if (!(view_det_margin(view) > bound))
        return false;
    int sign = view->det > 0 ? 1 : -1;
    if (*facing && sign != *facing)
        return false;
    *facing = sign;
    if (facts.cull_possible && view_front(view, facts.instance) == facts.front_culled)
        return false;
    return (view->t - (double)ray->tmin) / view->t_change > bound &&
           ((double)ray->tmax - view->t) / view->t_change > bound;
}

/*
 * Fills a zeroed flood from a triangle on. A policy of NULL asks about candidates: then only what is not opaque
 * counts. False when memory is short.
 */
static bool flood_fill(struct gn_ref_judge *judge, const struct gn_ref_ray *ray,
                       const struct gn_ref_policy *policy, uint32_t instance, const struct gn_judge_mesh *mesh,
                       size_t start, struct flood *flood)
{
    int facing = 0;
    flood->covered = true;
    if (!flood_add(flood, start))
        return false;
    for (size_t next = 0; next < flood->count; next++) {
        const struct gn_judge_triangle *triangle = &mesh->triangles[flood->triangles[next]];
        struct view view;
        if (!view_of(judge, ray, instance, triangle->geometry, triangle->primitive, &view))
            return false;
        if (!flood_is_solid(judge, ray, policy, instance, triangle, &view, &facing))
            flood->covered = false;
        for (int corner = 0; corner < 3; corner++) {
            if (view_edge_margin(&view, corner) > bound)
                continue;
            uint32_t from = triangle->vertex[(corner + 1) % 3], to = triangle->vertex[(corner + 2) % 3];
            size_t same, opposite;
            gn_judge_mesh_edges(mesh, from, to, &same);
            const struct gn_judge_edge *across = gn_judge_mesh_edges(mesh, to, from, &opposite);
            if (same != 1 || opposite != 1) {
                flood->covered = false;
                continue;
            }
            if (flood_has(flood, across->triangle))
                continue;
            if (flood->count >= FLOOD_LIMIT) {
                flood->covered = false;
                return true;
            }
            if (!flood_add(flood, across->triangle))
                return false;
        }
    }
    return true;
}

/*
 * What the lost hits of one ray have in common: the ones around one vertex share one flood, which is made once.
 * `found` are the primitives that the implementation did report for this ray: a crossing reported through another
 * triangle of the same fan is not lost.
 */
struct losses {
    struct gn_ref_judge *judge;
    const struct gn_ref_ray *ray;
    const struct gn_ref_policy *policy; /* NULL: candidates are judged */
    const struct gn_ref_answer *found;
    size_t found_count;
    struct flood flood;
    uint32_t flood_instance;
    bool flood_replaced; /* a triangle of it was reported */
};

static bool losses_flood(struct losses *losses, uint32_t instance, const struct gn_judge_mesh *mesh, size_t start)
{
    if (losses->flood_instance == instance && flood_has(&losses->flood, start))
        return true;
    flood_finish(&losses->flood);
    losses->flood_instance = instance;
    losses->flood_replaced = false;
    if (!flood_fill(losses->judge, losses->ray, losses->policy, instance, mesh, start, &losses->flood))
        return false;
    for (size_t i = 0; i < losses->found_count; i++) {
        const struct gn_ref_answer *found = &losses->found[i];
        if (found->kind != GN_REF_ANSWER_TRIANGLE || found->instance != instance)
            continue;
        size_t triangle = gn_judge_mesh_find(mesh, found->geometry, found->primitive);
        if (triangle != SIZE_MAX && flood_has(&losses->flood, triangle))
            losses->flood_replaced = true;
    }
    return true;
}

/* What is found of a lost hit. */
struct loss {
    bool excused; /* one of its decisions is within the bound */
    bool covered; /* but the neighbourhood is covered, so that it is no excuse */
    bool replaced; /* a triangle that shares the edge or vertex was reported, so that nothing is lost */
    double margin; /* the smallest of its decisions */
};

static bool loss_of(struct losses *losses, const struct gn_ref_hit *lost, struct loss *out)
{
    struct gn_ref_judge *judge = losses->judge;
    const struct gn_ref_ray *ray = losses->ray;
    uint32_t blas = gn_ref_scene_instance(judge->scene, lost->instance)->blas;
    *out = (struct loss){.margin = INFINITY};
    if (lost->type == GN_REF_AABBS) {
        const struct gn_ref_geometry *geometry = gn_ref_scene_geometry(judge->scene, blas, lost->geometry);
        out->margin = box_margin(judge, ray, lost->instance, geometry->aabbs[lost->primitive]);
        /* A generated hit exactly at tmax may be set or dropped (ray closest hit determination). */
        if (losses->policy && lost->t == (double)ray->tmax)
            out->margin = 0;
        out->excused = out->margin <= bound;
        return true;
    }
    struct view view;
    if (!view_of(judge, ray, lost->instance, lost->geometry, lost->primitive, &view))
        return false;
    double range = fmin(fabs(view.t - (double)ray->tmin), fabs((double)ray->tmax - view.t)) / view.t_change;
    double det = view_det_margin(&view), edges = INFINITY;
    for (int corner = 0; corner < 3; corner++)
        edges = fmin(edges, fabs(view_edge_margin(&view, corner)));
    out->margin = fmin(edges, fmin(det, range));
    out->excused = !(out->margin > bound);
    if (!out->excused || !(det > bound) || !(range > bound))
        return true;
    const struct gn_judge_mesh *mesh = gn_judge_mesh_of(judge, blas);
    if (!mesh)
        return false;
    size_t start = gn_judge_mesh_find(mesh, lost->geometry, lost->primitive);
    if (start == SIZE_MAX || !losses_flood(losses, lost->instance, mesh, start))
        return false;
    out->covered = losses->flood.covered;
    out->replaced = losses->flood_replaced;
    return true;
}

static bool same_primitive(const struct gn_ref_hit *hit, const struct gn_ref_answer *answer)
{
    return hit->instance == answer->instance && hit->geometry == answer->geometry &&
           hit->primitive == answer->primitive;
}

/* Adds what follows from an ideal hit that was not reported. */
static bool judge_loss(struct losses *losses, const struct gn_ref_hit *lost, struct gn_ref_verdict *out)
{
    struct loss loss;
    if (!loss_of(losses, lost, &loss))
        return false;
    enum gn_ref_verdict_class cls = !loss.excused  ? GN_REF_WRONG
                                    : loss.replaced ? GN_REF_ADMISSIBLE
                                    : loss.covered  ? GN_REF_LEAK
                                                    : GN_REF_GAP;
    if (worsens(out, cls, loss.margin))
        reason_set(out,
                   cls == GN_REF_WRONG
                       ? "lost %s %u of geometry %u, instance %u, at t = %.9g, which the ray meets by %.3g units "
                         "(the bound is %g)"
                   : cls == GN_REF_ADMISSIBLE
                       ? "%s %u of geometry %u, instance %u, at t = %.9g, which the ray meets by %.3g units (the "
                         "bound is %g), gave way to a neighbour"
                   : cls == GN_REF_LEAK
                       ? "lost %s %u of geometry %u, instance %u, at t = %.9g: the ray meets it by %.3g units only "
                         "(the bound is %g), but the triangles around the shared edge or vertex cover every "
                         "neighbouring ray"
                       : "lost %s %u of geometry %u, instance %u, at t = %.9g, which the ray meets by %.3g units "
                         "(the bound is %g), where nothing covers the neighbourhood",
                   lost->type == GN_REF_AABBS ? "AABB" : "triangle", lost->primitive, lost->geometry,
                   lost->instance, lost->t, loss.margin, bound);
    return true;
}

static bool same_position(const struct gn_ref_geometry *geometry, uint32_t a, uint32_t b)
{
    const double *p = geometry->positions[a], *q = geometry->positions[b];
    return p[0] == q[0] && p[1] == q[1] && p[2] == q[2];
}

/*
 * Judges the facts and numbers of one reported triangle, and whether the ray may meet it at all. `ideal` is the
 * same triangle in the exact answer, or NULL.
 */
static bool judge_triangle(struct gn_ref_judge *judge, const struct gn_ref_ray *ray,
                           const struct gn_ref_answer *answer, const struct gn_ref_hit *ideal,
                           const struct facts *facts, struct gn_ref_verdict *out)
{
    struct gn_ref_object_ray object;
    double vertices[3][3], sizes[3][3];
    bool exact;
    struct view view;
    if (facts->geometry->type != GN_REF_TRIANGLES) {
        if (worsens(out, GN_REF_WRONG, 0))
            reason_set(out, "reports a triangle where the geometry %u of instance %u holds AABBs",
                       answer->geometry, answer->instance);
        return true;
    }
    if (!gn_ref_judge_object_ray(judge, ray, answer->instance, &object))
        return false;
    if (!gn_ref_judge_vertices(judge, answer->instance, answer->geometry, answer->primitive, vertices, sizes,
                               &exact)) {
        if (worsens(out, GN_REF_WRONG, 0))
            reason_set(out, "reports triangle %u of geometry %u, instance %u, which is inactive",
                       answer->primitive, answer->geometry, answer->instance);
        return true;
    }
    view_make(&object, vertices, sizes, &view);
    const uint32_t *corners = facts->geometry->triangles[answer->primitive];
    if (same_position(facts->geometry, corners[0], corners[1]) ||
        same_position(facts->geometry, corners[1], corners[2]) ||
        same_position(facts->geometry, corners[2], corners[0])) {
        if (worsens(out, GN_REF_WRONG, 0))
            reason_set(out, "reports triangle %u of geometry %u, instance %u, which is degenerate",
                       answer->primitive, answer->geometry, answer->instance);
        return true;
    }
    double t = (double)answer->t, b = (double)answer->barycentrics[0], c = (double)answer->barycentrics[1];
    if (!isfinite(t) || !isfinite(b) || !isfinite(c)) {
        if (worsens(out, GN_REF_WRONG, 0))
            reason_set(out, "reports t = %g, barycentrics %g, %g", t, b, c);
        return true;
    }

    /* Decisions that differ: the triangle itself, the range, the culling, the facing. */
    if (!ideal) {
        double margin = 0, turned = 0;
        const char *what = "misses";
        for (int corner = 0; corner < 3; corner++) {
            margin = fmax(margin, -view_edge_margin(&view, corner));
            turned = fmax(turned, view_edge_margin(&view, corner));
        }
        /* Nearly edge-on, the triangle may as well be seen from its other side. */
        if (view_det_margin(&view) <= bound)
            margin = fmin(margin, turned);
        double before = ((double)ray->tmin - view.t) / view.t_change;
        double beyond = (view.t - (double)ray->tmax) / view.t_change;
        if (fmax(before, beyond) > margin) {
            margin = fmax(before, beyond);
            what = "meets outside of its t range";
        }
        if (facts->cull_possible && view_front(&view, facts->instance) == facts->front_culled &&
            view_det_margin(&view) > margin) {
            margin = view_det_margin(&view);
            what = "culls by its facing";
        }
        if (worsens(out, margin <= bound ? GN_REF_ADMISSIBLE : GN_REF_WRONG, margin))
            reason_set(out,
                       "reports triangle %u of geometry %u, instance %u, which the ray %s by %.3g units (the "
                       "bound is %g)",
                       answer->primitive, answer->geometry, answer->instance, what, margin, bound);
    }
    bool front = ideal ? ideal->front : view_front(&view, facts->instance);
    if (front != !!answer->front) {
        double margin = view_det_margin(&view);
        if (worsens(out, margin <= bound ? GN_REF_ADMISSIBLE : GN_REF_WRONG, margin))
            reason_set(out, "reports a %s face of triangle %u, which is a %s face by %.3g units (the bound is %g)",
                       answer->front ? "front" : "back", answer->primitive, front ? "front" : "back", margin,
                       bound);
    }

    /* The ends of the t range hold for the reported number without tolerance. */
    if (!(answer->t >= ray->tmin && answer->t <= ray->tmax))
        if (worsens(out, GN_REF_WRONG, 0))
            reason_set(out, "reports t = %.9g outside of the range [%.9g, %.9g]", t, (double)ray->tmin,
                       (double)ray->tmax);

    double conditioned;
    hit_error_of(&object, &view, t, b, c, &out->hit_error, &conditioned);
    out->hit_bound = conditioned > 0 ? bound * (out->hit_error / conditioned) : bound;
    if (!(conditioned <= bound) && worsens(out, GN_REF_WRONG, 0))
        reason_set(out,
                   "reports t = %.9g, barycentrics %.9g, %.9g on triangle %u, whose ideal values are %.9g, %.9g, "
                   "%.9g: a hit error of %.3g units (the bound is %.3g)",
                   t, b, c, answer->primitive, ideal ? ideal->t : view.t, ideal ? ideal->beta : view.weight[1],
                   ideal ? ideal->gamma : view.weight[2], out->hit_error, out->hit_bound);

    /* A barycentric outside of [0,1] is a point outside of the triangle, whatever the conditioning. */
    double weights[3] = {1 - b - c, b, c};
    for (int corner = 0; corner < 3; corner++) {
        double excess = fmax(-weights[corner], weights[corner] - 1) / GN_UNIT;
        if (excess > bound && worsens(out, GN_REF_WRONG, 0))
            reason_set(out, "reports a barycentric of %.9g on triangle %u, outside of [0, 1] by %.3g units (the bound is %g)",
                       weights[corner], answer->primitive, excess, bound);
    }
    return true;
}

static void judge_copied(const struct gn_ref_answer *answer, const struct facts *facts,
                         struct gn_ref_verdict *out)
{
    if (answer->custom_index != facts->instance->custom_index && worsens(out, GN_REF_WRONG, 0))
        reason_set(out, "reports custom index 0x%X of instance %u, which has 0x%X", answer->custom_index,
                   answer->instance, facts->instance->custom_index);
    if (answer->sbt_offset != facts->instance->sbt_offset && worsens(out, GN_REF_WRONG, 0))
        reason_set(out, "reports SBT offset 0x%X of instance %u, which has 0x%X", answer->sbt_offset,
                   answer->instance, facts->instance->sbt_offset);
}

/* By how many units is `a` nearer than `b`? Positive when it is. False when `b` names no active triangle. */
static bool nearer_margin(struct gn_ref_judge *judge, const struct gn_ref_ray *ray, const struct gn_ref_hit *a,
                          const struct gn_ref_answer *b, double b_t, double *out)
{
    double change = 0;
    struct view view;
    if (a->type == GN_REF_TRIANGLES) {
        if (!view_of(judge, ray, a->instance, a->geometry, a->primitive, &view))
            return false;
        change += view.t_change;
    }
    if (b->kind == GN_REF_ANSWER_TRIANGLE) {
        if (!view_of(judge, ray, b->instance, b->geometry, b->primitive, &view))
            return false;
        change += view.t_change;
    }
    double difference = b_t - a->t;
    *out = change > 0 ? difference / change : difference > 0 ? INFINITY : 0;
    return true;
}

bool gn_ref_judge_committed(struct gn_ref_judge *judge, const struct gn_ref_ray *ray,
                            const struct gn_ref_policy *policy, const struct gn_ref_answer *answer,
                            struct gn_ref_verdict *out)
{
    struct hits hits;
    struct losses losses = {.judge = judge, .ray = ray, .policy = policy, .found = answer,
                            .found_count = answer->kind != GN_REF_ANSWER_NONE};
    struct facts facts = {0};
    const struct gn_ref_hit *ideal = NULL; /* the exact answer's entry for the reported primitive */
    bool any_hit = ray->flags & GN_REF_RAY_TERMINATE_ON_FIRST_HIT;
    bool ok = false;
    memset(out, 0, sizeof *out);
    hits.list = hits.local;
    hits.count = 0;

    /* Most answers are the nearest triangle: no list is needed then. */
    if (policy->confirm_mask == UINT32_MAX && (!judge->has_aabbs || (ray->flags & GN_REF_RAY_SKIP_AABBS))) {
        int found = gn_ref_trace_closest_triangle_exact(judge->scene, ray, &hits.local[0]);
        if (found < 0)
            goto end;
        hits.count = (size_t)found;
        bool agrees = answer->kind == GN_REF_ANSWER_TRIANGLE ? found && same_primitive(&hits.local[0], answer)
                                                             : !found && answer->kind == GN_REF_ANSWER_NONE;
        if (!agrees && !hits_collect(judge, ray, &hits))
            goto end;
    } else {
        if (!hits_collect(judge, ray, &hits))
            goto end;
        hits_commit(&hits, ray, policy);
    }
    out->ideal_hit = hits.count > 0;
    if (hits.count)
        out->ideal = hits.list[0];

    double answer_t = 0;
    if (answer->kind != GN_REF_ANSWER_NONE) {
        const char *why_not =
            facts_of(judge, ray, answer->instance, answer->geometry, answer->primitive, &facts);
        if (why_not) {
            worsens(out, GN_REF_WRONG, 0);
            reason_set(out, "the answer %s (instance %u, geometry %u, primitive %u)", why_not, answer->instance,
                       answer->geometry, answer->primitive);
            ok = true;
            goto end;
        }
        for (size_t i = 0; i < hits.count && !ideal; i++)
            if (same_primitive(&hits.list[i], answer))
                ideal = &hits.list[i];
        judge_copied(answer, &facts, out);
    }
    if (answer->kind == GN_REF_ANSWER_TRIANGLE) {
        if (!facts.opaque && !(policy->confirm_mask >> (answer->primitive & 31) & 1) &&
            worsens(out, GN_REF_WRONG, 0))
            reason_set(out, "commits triangle %u, which is not opaque and was not confirmed", answer->primitive);
        if (!judge_triangle(judge, ray, answer, ideal, &facts, out))
            goto end;
        answer_t = ideal ? ideal->t : (double)answer->t;
    } else if (answer->kind == GN_REF_ANSWER_GENERATED) {
        answer_t = (double)answer->t;
        float expected = generated_t(policy, answer->primitive);
        if (facts.geometry->type != GN_REF_AABBS) {
            if (worsens(out, GN_REF_WRONG, 0))
                reason_set(out, "reports a generated hit where geometry %u of instance %u holds triangles",
                           answer->geometry, answer->instance);
        } else if (!(policy->generate_mask >> (answer->primitive & 31) & 1)) {
            if (worsens(out, GN_REF_WRONG, 0))
                reason_set(out, "reports a hit on AABB %u, for which none was generated", answer->primitive);
        } else if (answer->t != expected) {
            if (worsens(out, GN_REF_WRONG, 0))
                reason_set(out, "reports t = %.9g on AABB %u, for which %.9g was generated", answer_t,
                           answer->primitive, (double)expected);
        } else if (!ideal) {
            /* The specification lets an implementation enlarge boxes, and names no limit. */
            const float *box = facts.geometry->aabbs[answer->primitive];
            if (isnan(box[0])) {
                if (worsens(out, GN_REF_WRONG, 0))
                    reason_set(out, "reports a hit on AABB %u, which is inactive", answer->primitive);
            } else if (worsens(out, GN_REF_ADMISSIBLE, 0)) {
                reason_set(out, "AABB %u was presented although the ray misses it", answer->primitive);
            }
        }
    }

    if (answer->kind != GN_REF_ANSWER_NONE && answer->kind != GN_REF_ANSWER_TRIANGLE &&
        answer->kind != GN_REF_ANSWER_GENERATED && worsens(out, GN_REF_WRONG, 0))
        reason_set(out, "commits a hit of the unknown type %d", (int)answer->kind);

    /* What was lost besides makes a wrong answer no worse, and one that names nothing has no place on the ray. */
    if (out->cls == GN_REF_WRONG) {
        ok = true;
        goto end;
    }

    /* Ideal hits nearer than the answer were lost, unless which is nearer is itself within the bound. */
    for (size_t i = 0; i < hits.count; i++) {
        const struct gn_ref_hit *hit = &hits.list[i];
        if (answer->kind != GN_REF_ANSWER_NONE) {
            if (any_hit || same_primitive(hit, answer))
                break; /* the rest is farther, or any will do */
            double margin;
            if (ideal && hit->type == GN_REF_TRIANGLES && ideal->type == GN_REF_TRIANGLES &&
                gn_ref_compare_t_exact(judge->scene, ray, hit, ideal) == 0)
                continue; /* equally near: either is right */
            if (!nearer_margin(judge, ray, hit, answer, answer_t, &margin))
                goto end;
            if (margin <= bound) {
                if (margin > 0 && worsens(out, GN_REF_ADMISSIBLE, margin))
                    reason_set(out,
                               "reports primitive %u where primitive %u of instance %u is nearer by %.3g units "
                               "(the bound is %g)",
                               answer->primitive, hit->primitive, hit->instance, margin, bound);
                continue;
            }
        }
        if (!judge_loss(&losses, hit, out))
            goto end;
    }
    ok = true;
end:
    flood_finish(&losses.flood);
    hits_finish(&hits);
    return ok;
}

static bool double_hit(struct gn_ref_judge *judge, const struct gn_ref_ray *ray,
                       const struct gn_ref_answer *candidates, size_t count, size_t first,
                       struct gn_ref_verdict *out)
{
    struct view view;
    const struct gn_ref_answer *answer = &candidates[first];
    if (!view_of(judge, ray, answer->instance, answer->geometry, answer->primitive, &view))
        return true;
    bool near = false;
    for (int corner = 0; corner < 3; corner++)
        near |= view_edge_margin(&view, corner) <= bound;
    if (!near)
        return true;
    const struct gn_judge_mesh *mesh =
        gn_judge_mesh_of(judge, gn_ref_scene_instance(judge->scene, answer->instance)->blas);
    if (!mesh)
        return false;
    size_t start = gn_judge_mesh_find(mesh, answer->geometry, answer->primitive);
    struct flood flood = {0};
    if (start == SIZE_MAX)
        return true;
    bool ok = flood_fill(judge, ray, NULL, answer->instance, mesh, start, &flood);
    for (size_t i = first + 1; ok && flood.covered && i < count; i++) {
        if (candidates[i].kind != GN_REF_ANSWER_TRIANGLE || candidates[i].instance != answer->instance ||
            (candidates[i].geometry == answer->geometry && candidates[i].primitive == answer->primitive))
            continue;
        size_t other = gn_judge_mesh_find(mesh, candidates[i].geometry, candidates[i].primitive);
        if (other != SIZE_MAX && flood_has(&flood, other) && worsens(out, GN_REF_DOUBLE_HIT, 0))
            reason_set(out,
                       "presents triangles %u and %u of instance %u for one crossing of the edge or vertex they "
                       "share",
                       answer->primitive, candidates[i].primitive, answer->instance);
    }
    flood_finish(&flood);
    return ok;
}

bool gn_ref_judge_candidates(struct gn_ref_judge *judge, const struct gn_ref_ray *ray,
                             const struct gn_ref_answer *candidates, size_t candidate_count,
                             const struct gn_ref_answer *committed, struct gn_ref_verdict *out)
{
    struct hits hits;
    struct losses losses = {.judge = judge, .ray = ray, .found = candidates, .found_count = candidate_count};
    bool ok = false;
    memset(out, 0, sizeof *out);
    hits.list = hits.local;
    hits.count = 0;
    if (!hits_collect(judge, ray, &hits))
        goto end;

    for (size_t i = 0; i < candidate_count; i++) {
        const struct gn_ref_answer *answer = &candidates[i];
        struct facts facts = {0};
        const char *why_not =
            facts_of(judge, ray, answer->instance, answer->geometry, answer->primitive, &facts);
        if (why_not) {
            if (worsens(out, GN_REF_WRONG, 0))
                reason_set(out, "a candidate %s (instance %u, geometry %u, primitive %u)", why_not,
                           answer->instance, answer->geometry, answer->primitive);
            continue;
        }
        judge_copied(answer, &facts, out);
        const struct gn_ref_hit *ideal = NULL;
        for (size_t j = 0; j < hits.count && !ideal; j++)
            if (same_primitive(&hits.list[j], answer))
                ideal = &hits.list[j];
        if (answer->kind == GN_REF_ANSWER_TRIANGLE) {
            if (facts.opaque && worsens(out, GN_REF_WRONG, 0))
                reason_set(out, "presents triangle %u as a candidate, which is opaque", answer->primitive);
            if (!judge_triangle(judge, ray, answer, ideal, &facts, out) ||
                !double_hit(judge, ray, candidates, candidate_count, i, out))
                goto end;
        } else if (answer->kind != GN_REF_ANSWER_GENERATED) {
            if (worsens(out, GN_REF_WRONG, 0))
                reason_set(out, "presents a candidate of the unknown type %d", (int)answer->kind);
        } else if (facts.geometry->type != GN_REF_AABBS) {
            if (worsens(out, GN_REF_WRONG, 0))
                reason_set(out, "presents an AABB where geometry %u of instance %u holds triangles",
                           answer->geometry, answer->instance);
        } else if (isnan(facts.geometry->aabbs[answer->primitive][0]) && worsens(out, GN_REF_WRONG, 0)) {
            reason_set(out, "presents AABB %u, which is inactive", answer->primitive);
        }
        /* The flag is about any-hit shaders: AABBs may be presented repeatedly all the same. */
        if (answer->kind == GN_REF_ANSWER_TRIANGLE && facts.geometry->flags & GN_REF_GEOMETRY_NO_DUPLICATE)
            for (size_t j = 0; j < i; j++)
                if (candidates[j].instance == answer->instance && candidates[j].geometry == answer->geometry &&
                    candidates[j].primitive == answer->primitive && worsens(out, GN_REF_WRONG, 0))
                    reason_set(out, "presents triangle %u of a NO_DUPLICATE_ANY_HIT geometry more than once",
                               answer->primitive);
    }

    for (size_t i = 0; i < hits.count; i++) {
        const struct gn_ref_hit *hit = &hits.list[i];
        if (hit->type == GN_REF_TRIANGLES && hit->opaque)
            continue;
        out->ideal_hit = true;
        if (committed->kind != GN_REF_ANSWER_NONE) {
            /* Beyond the committed hit nothing has to be presented; near it, either is right. */
            double entry = hit->type == GN_REF_AABBS ? fmax(hit->t, (double)ray->tmin) : hit->t, margin;
            struct gn_ref_hit placed = *hit;
            placed.t = entry;
            if (!nearer_margin(judge, ray, &placed, committed, (double)committed->t, &margin) || margin <= bound)
                continue;
        }
        if (ray->flags & GN_REF_RAY_TERMINATE_ON_FIRST_HIT && committed->kind != GN_REF_ANSWER_NONE)
            continue;
        bool presented = false;
        for (size_t j = 0; j < candidate_count && !presented; j++)
            presented = same_primitive(hit, &candidates[j]);
        if (!presented && !judge_loss(&losses, hit, out))
            goto end;
    }
    if (hits.count)
        out->ideal = hits.list[0];
    ok = true;
end:
    flood_finish(&losses.flood);
    hits_finish(&hits);
    return ok;
}
