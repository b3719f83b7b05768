/* SPDX-License-Identifier: Apache-2.0 */
/* Lost hits: whether the triangles around them cover every ray near the lost one, so that nothing excuses the loss. */
#include <math.h>
#include <stdlib.h>

#include "reference/judge_internal.h"

/* Fans with more triangles than this are not followed; the loss then counts as a gap, never as a leak. */
enum { FLOOD_LIMIT = 4096 };

void gn_judge_flood_finish(struct gn_judge_flood *flood)
{
    free(flood->triangles);
    free(flood->slots);
    *flood = (struct gn_judge_flood){0};
}

static uint32_t *flood_slot(const struct gn_judge_flood *flood, size_t triangle)
{
    size_t mask = 2 * flood->capacity - 1, at = (triangle * 0x9E3779B97F4A7C15u >> 20) & mask;
    while (flood->slots[at] && flood->triangles[flood->slots[at] - 1] != triangle)
        at = (at + 1) & mask;
    return &flood->slots[at];
}

bool gn_judge_flood_has(const struct gn_judge_flood *flood, size_t triangle)
{
    return flood->capacity && *flood_slot(flood, triangle);
}

static bool flood_add(struct gn_judge_flood *flood, size_t triangle)
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
                           const struct gn_judge_triangle *triangle, struct gn_judge_view *view, int *facing)
{
    struct gn_judge_facts facts;
    if (gn_judge_facts_of(judge, ray, instance, triangle->geometry, triangle->primitive, &facts) != NULL)
        return false;
    if (policy ? !facts.opaque && !(policy->confirm_mask >> (triangle->primitive & 31) & 1) : facts.opaque)
        return false;
    if (!(gn_judge_view_det_margin(view) > GN_BOUND))
        return false;
    int sign = view->det > 0 ? 1 : -1;
    if (*facing && sign != *facing)
        return false;
    *facing = sign;
    if (facts.cull_possible && gn_judge_front(view, facts.instance) == facts.front_culled)
        return false;
    return (view->t - (double)ray->tmin) / view->t_change > GN_BOUND &&
           ((double)ray->tmax - view->t) / view->t_change > GN_BOUND;
}

bool gn_judge_flood_fill(struct gn_ref_judge *judge, const struct gn_ref_ray *ray,
                         const struct gn_ref_policy *policy, uint32_t instance, const struct gn_judge_mesh *mesh,
                         size_t start, struct gn_judge_flood *flood)
{
    int facing = 0;
    flood->covered = true;
    if (!flood_add(flood, start))
        return false;
    for (size_t next = 0; next < flood->count; next++) {
        const struct gn_judge_triangle *triangle = &mesh->triangles[flood->triangles[next]];
        struct gn_judge_view view;
        if (!gn_judge_view_of(judge, ray, instance, triangle->geometry, triangle->primitive, &view))
            return false;
        if (!flood_is_solid(judge, ray, policy, instance, triangle, &view, &facing))
            flood->covered = false;
        for (int corner = 0; corner < 3; corner++) {
            if (gn_judge_view_edge_margin(&view, corner) > GN_BOUND)
                continue;
            uint32_t from = triangle->vertex[(corner + 1) % 3], to = triangle->vertex[(corner + 2) % 3];
            size_t same, opposite;
            gn_judge_mesh_edges(mesh, from, to, &same);
            const struct gn_judge_edge *across = gn_judge_mesh_edges(mesh, to, from, &opposite);
            if (same != 1 || opposite != 1) {
                flood->covered = false;
                continue;
            }
            if (gn_judge_flood_has(flood, across->triangle))
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

static bool losses_flood(struct gn_judge_losses *losses, uint32_t instance, const struct gn_judge_mesh *mesh, size_t start)
{
    if (losses->flood_instance == instance && gn_judge_flood_has(&losses->flood, start))
        return true;
    gn_judge_flood_finish(&losses->flood);
    losses->flood_instance = instance;
    losses->flood_replaced = false;
    if (!gn_judge_flood_fill(losses->judge, losses->ray, losses->policy, instance, mesh, start, &losses->flood))
        return false;
    for (size_t i = 0; i < losses->found_count; i++) {
        const struct gn_ref_answer *found = &losses->found[i];
        if (found->kind != GN_REF_ANSWER_TRIANGLE || found->instance != instance)
            continue;
        size_t triangle = gn_judge_mesh_find(mesh, found->geometry, found->primitive);
        if (triangle != SIZE_MAX && gn_judge_flood_has(&losses->flood, triangle))
            losses->flood_replaced = true;
    }
    return true;
}

bool gn_judge_loss_of(struct gn_judge_losses *losses, const struct gn_ref_hit *lost, struct gn_judge_loss *out)
{
    struct gn_ref_judge *judge = losses->judge;
    const struct gn_ref_ray *ray = losses->ray;
    uint32_t blas = gn_ref_scene_instance(judge->scene, lost->instance)->blas;
    *out = (struct gn_judge_loss){.margin = INFINITY};
    if (lost->type == GN_REF_AABBS) {
        const struct gn_ref_geometry *geometry = gn_ref_scene_geometry(judge->scene, blas, lost->geometry);
        out->margin = gn_judge_box_margin(judge, ray, lost->instance, geometry->aabbs[lost->primitive]);
        /* A generated hit exactly at tmax may be set or dropped (ray closest hit determination). */
        if (losses->policy && lost->t == (double)ray->tmax)
            out->margin = 0;
        out->excused = out->margin <= GN_BOUND;
        return true;
    }
    struct gn_judge_view view;
    if (!gn_judge_view_of(judge, ray, lost->instance, lost->geometry, lost->primitive, &view))
        return false;
    double range = fmin(fabs(view.t - (double)ray->tmin), fabs((double)ray->tmax - view.t)) / view.t_change;
    double det = gn_judge_view_det_margin(&view), edges = INFINITY;
    for (int corner = 0; corner < 3; corner++)
        edges = fmin(edges, fabs(gn_judge_view_edge_margin(&view, corner)));
    out->margin = fmin(edges, fmin(det, range));
    out->excused = !(out->margin > GN_BOUND);
    if (!out->excused || !(det > GN_BOUND) || !(range > GN_BOUND))
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
