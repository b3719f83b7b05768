/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A primitive as one ray sees it: the sizes, the first-order changes and the margins of decisions that docs/numerics.md
 * derives.
 */
#include <math.h>

#include "reference/judge_internal.h"

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

static int dominant_axis(const double direction[3])
{
    int k = 0;
    for (int i = 1; i < 3; i++)
        if (fabs(direction[i]) > fabs(direction[k]))
            k = i;
    return k;
}

void gn_judge_view_make(const struct gn_ref_object_ray *ray, double vertices[3][3], double sizes[3][3],
                        struct gn_judge_view *view)
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

double gn_judge_view_edge_margin(const struct gn_judge_view *view, int corner)
{
    double value = view->det < 0 ? -view->edge[corner] : view->edge[corner];
    return value / view->edge_change[corner];
}

double gn_judge_view_det_margin(const struct gn_judge_view *view)
{
    return fabs(view->det) / view->det_change;
}

bool gn_judge_view_of(struct gn_ref_judge *judge, const struct gn_ref_ray *ray, uint32_t instance,
                      uint32_t geometry, uint32_t primitive, struct gn_judge_view *out)
{
    struct gn_ref_object_ray object;
    double vertices[3][3], sizes[3][3];
    bool exact;
    if (!gn_ref_judge_object_ray(judge, ray, instance, &object) ||
        !gn_ref_judge_vertices(judge, instance, geometry, primitive, vertices, sizes, &exact))
        return false;
    gn_judge_view_make(&object, vertices, sizes, out);
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
void gn_judge_hit_error(const struct gn_ref_object_ray *ray, const struct gn_judge_view *view, double t, double b,
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
        double products = fabs(x[n] * y[p]) + fabs(y[n] * x[p]) + GN_PRODUCT_UNDERFLOW, most = 1 / (GN_BOUND * GN_UNIT);
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

/*
 * The smallest margin of the decisions by which a ray meets an AABB: it enters every slab, and the t range, before it
 * leaves any other. Ends of the t range are given, so they do not move.
 */
double gn_judge_box_margin(struct gn_ref_judge *judge, const struct gn_ref_ray *ray, uint32_t instance,
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
        if (fabs(d) <= GN_BOUND * GN_UNIT * object.size_direction[i]) {
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
