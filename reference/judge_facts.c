/* SPDX-License-Identifier: Apache-2.0 */
/* What has no tolerance: whom ray and flags admit, which face is which, and what a policy commits of the ideal hits. */
#include <stdlib.h>

#include "reference/judge_internal.h"

const char *gn_judge_facts_of(const struct gn_ref_judge *judge, const struct gn_ref_ray *ray, uint32_t instance,
                              uint32_t geometry, uint32_t primitive, struct gn_judge_facts *out)
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

bool gn_judge_front(const struct gn_judge_view *view, const struct gn_ref_instance *instance)
{
    return (view->det < 0) != !!(instance->flags & GN_REF_INSTANCE_FLIP_FACING);
}

static bool policy_takes(const struct gn_ref_policy *policy, const struct gn_ref_hit *hit)
{
    if (hit->type == GN_REF_AABBS)
        return policy->generate_mask >> (hit->primitive & 31) & 1;
    return hit->opaque || (policy->confirm_mask >> (hit->primitive & 31) & 1);
}

float gn_judge_generated_t(const struct gn_ref_policy *policy, uint32_t primitive)
{
    return policy->generate_t0 + policy->generate_step * (float)primitive;
}

void gn_judge_hits_finish(struct gn_judge_hits *hits)
{
    if (hits->list != hits->local)
        free(hits->list);
}

bool gn_judge_hits_collect(struct gn_ref_judge *judge, const struct gn_ref_ray *ray, struct gn_judge_hits *hits)
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

void gn_judge_hits_commit(struct gn_judge_hits *hits, const struct gn_ref_ray *ray, const struct gn_ref_policy *policy)
{
    size_t kept = 0;
    for (size_t i = 0; i < hits->count; i++) {
        struct gn_ref_hit hit = hits->list[i];
        if (!policy_takes(policy, &hit))
            continue;
        if (hit.type == GN_REF_AABBS) {
            hit.t = (double)gn_judge_generated_t(policy, hit.primitive);
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
