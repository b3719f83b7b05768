/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The verdict: an answer is held against the exact one, and where they differ, against how far the problem would
 * have to be moved. docs/numerics.md derives the sizes, the first-order changes and the bound used here.
 */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "reference/judge_internal.h"

double gn_ref_verdict_bound(void)
{
    return GN_BOUND;
}

const char *gn_ref_verdict_class_name(enum gn_ref_verdict_class cls)
{
    static const char *const names[] = {"exact", "admissible", "gap", "leak", "double hit", "wrong"};
    return cls < GN_REF_VERDICT_CLASS_COUNT ? names[cls] : "unknown";
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

static bool same_primitive(const struct gn_ref_hit *hit, const struct gn_ref_answer *answer)
{
    return hit->instance == answer->instance && hit->geometry == answer->geometry &&
           hit->primitive == answer->primitive;
}

/* Adds what follows from an ideal hit that was not reported. */
static bool judge_loss(struct gn_judge_losses *losses, const struct gn_ref_hit *lost, struct gn_ref_verdict *out)
{
    struct gn_judge_loss loss;
    if (!gn_judge_loss_of(losses, lost, &loss))
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
                   lost->instance, lost->t, loss.margin, GN_BOUND);
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
                           const struct gn_judge_facts *facts, struct gn_ref_verdict *out)
{
    struct gn_ref_object_ray object;
    double vertices[3][3], sizes[3][3];
    bool exact;
    struct gn_judge_view view;
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
    gn_judge_view_make(&object, vertices, sizes, &view);
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
            margin = fmax(margin, -gn_judge_view_edge_margin(&view, corner));
            turned = fmax(turned, gn_judge_view_edge_margin(&view, corner));
        }
        /* Nearly edge-on, the triangle may as well be seen from its other side. */
        if (gn_judge_view_det_margin(&view) <= GN_BOUND)
            margin = fmin(margin, turned);
        double before = ((double)ray->tmin - view.t) / view.t_change;
        double beyond = (view.t - (double)ray->tmax) / view.t_change;
        if (fmax(before, beyond) > margin) {
            margin = fmax(before, beyond);
            what = "meets outside of its t range";
        }
        if (facts->cull_possible && gn_judge_front(&view, facts->instance) == facts->front_culled &&
            gn_judge_view_det_margin(&view) > margin) {
            margin = gn_judge_view_det_margin(&view);
            what = "culls by its facing";
        }
        if (worsens(out, margin <= GN_BOUND ? GN_REF_ADMISSIBLE : GN_REF_WRONG, margin))
            reason_set(out,
                       "reports triangle %u of geometry %u, instance %u, which the ray %s by %.3g units (the "
                       "bound is %g)",
                       answer->primitive, answer->geometry, answer->instance, what, margin, GN_BOUND);
    }
    bool front = ideal ? ideal->front : gn_judge_front(&view, facts->instance);
    if (front != !!answer->front) {
        double margin = gn_judge_view_det_margin(&view);
        if (worsens(out, margin <= GN_BOUND ? GN_REF_ADMISSIBLE : GN_REF_WRONG, margin))
            reason_set(out, "reports a %s face of triangle %u, which is a %s face by %.3g units (the bound is %g)",
                       answer->front ? "front" : "back", answer->primitive, front ? "front" : "back", margin,
                       GN_BOUND);
    }

    /* The ends of the t range hold for the reported number without tolerance. */
    if (!(answer->t >= ray->tmin && answer->t <= ray->tmax))
        if (worsens(out, GN_REF_WRONG, 0))
            reason_set(out, "reports t = %.9g outside of the range [%.9g, %.9g]", t, (double)ray->tmin,
                       (double)ray->tmax);

    double conditioned;
    gn_judge_hit_error(&object, &view, t, b, c, &out->hit_error, &conditioned);
    out->hit_bound = conditioned > 0 ? GN_BOUND * (out->hit_error / conditioned) : GN_BOUND;
    if (!(conditioned <= GN_BOUND) && worsens(out, GN_REF_WRONG, 0))
        reason_set(out,
                   "reports t = %.9g, barycentrics %.9g, %.9g on triangle %u, whose ideal values are %.9g, %.9g, "
                   "%.9g: a hit error of %.3g units (the bound is %.3g)",
                   t, b, c, answer->primitive, ideal ? ideal->t : view.t, ideal ? ideal->beta : view.weight[1],
                   ideal ? ideal->gamma : view.weight[2], out->hit_error, out->hit_bound);

    /* A barycentric outside of [0,1] is a point outside of the triangle, whatever the conditioning. */
    double weights[3] = {1 - b - c, b, c};
    for (int corner = 0; corner < 3; corner++) {
        double excess = fmax(-weights[corner], weights[corner] - 1) / GN_UNIT;
        if (excess > GN_BOUND && worsens(out, GN_REF_WRONG, 0))
            reason_set(out, "reports a barycentric of %.9g on triangle %u, outside of [0, 1] by %.3g units (the bound is %g)",
                       weights[corner], answer->primitive, excess, GN_BOUND);
    }
    return true;
}

static void judge_copied(const struct gn_ref_answer *answer, const struct gn_judge_facts *facts,
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
    struct gn_judge_view view;
    if (a->type == GN_REF_TRIANGLES) {
        if (!gn_judge_view_of(judge, ray, a->instance, a->geometry, a->primitive, &view))
            return false;
        change += view.t_change;
    }
    if (b->kind == GN_REF_ANSWER_TRIANGLE) {
        if (!gn_judge_view_of(judge, ray, b->instance, b->geometry, b->primitive, &view))
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
    struct gn_judge_hits hits;
    struct gn_judge_losses losses = {.judge = judge, .ray = ray, .policy = policy, .found = answer,
                            .found_count = answer->kind != GN_REF_ANSWER_NONE};
    struct gn_judge_facts facts = {0};
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
        if (!agrees && !gn_judge_hits_collect(judge, ray, &hits))
            goto end;
    } else {
        if (!gn_judge_hits_collect(judge, ray, &hits))
            goto end;
        gn_judge_hits_commit(&hits, ray, policy);
    }
    out->ideal_hit = hits.count > 0;
    if (hits.count)
        out->ideal = hits.list[0];

    double answer_t = 0;
    if (answer->kind != GN_REF_ANSWER_NONE) {
        const char *why_not =
            gn_judge_facts_of(judge, ray, answer->instance, answer->geometry, answer->primitive, &facts);
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
        float expected = gn_judge_generated_t(policy, answer->primitive);
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
            if (margin <= GN_BOUND) {
                if (margin > 0 && worsens(out, GN_REF_ADMISSIBLE, margin))
                    reason_set(out,
                               "reports primitive %u where primitive %u of instance %u is nearer by %.3g units "
                               "(the bound is %g)",
                               answer->primitive, hit->primitive, hit->instance, margin, GN_BOUND);
                continue;
            }
        }
        if (!judge_loss(&losses, hit, out))
            goto end;
    }
    ok = true;
end:
    gn_judge_flood_finish(&losses.flood);
    gn_judge_hits_finish(&hits);
    return ok;
}

static bool double_hit(struct gn_ref_judge *judge, const struct gn_ref_ray *ray,
                       const struct gn_ref_answer *candidates, size_t count, size_t first,
                       struct gn_ref_verdict *out)
{
    struct gn_judge_view view;
    const struct gn_ref_answer *answer = &candidates[first];
    if (!gn_judge_view_of(judge, ray, answer->instance, answer->geometry, answer->primitive, &view))
        return true;
    bool near = false;
    for (int corner = 0; corner < 3; corner++)
        near |= gn_judge_view_edge_margin(&view, corner) <= GN_BOUND;
    if (!near)
        return true;
    const struct gn_judge_mesh *mesh =
        gn_judge_mesh_of(judge, gn_ref_scene_instance(judge->scene, answer->instance)->blas);
    if (!mesh)
        return false;
    size_t start = gn_judge_mesh_find(mesh, answer->geometry, answer->primitive);
    struct gn_judge_flood flood = {0};
    if (start == SIZE_MAX)
        return true;
    bool ok = gn_judge_flood_fill(judge, ray, NULL, answer->instance, mesh, start, &flood);
    for (size_t i = first + 1; ok && flood.covered && i < count; i++) {
        if (candidates[i].kind != GN_REF_ANSWER_TRIANGLE || candidates[i].instance != answer->instance ||
            (candidates[i].geometry == answer->geometry && candidates[i].primitive == answer->primitive))
            continue;
        size_t other = gn_judge_mesh_find(mesh, candidates[i].geometry, candidates[i].primitive);
        if (other != SIZE_MAX && gn_judge_flood_has(&flood, other) && worsens(out, GN_REF_DOUBLE_HIT, 0))
            reason_set(out,
                       "presents triangles %u and %u of instance %u for one crossing of the edge or vertex they "
                       "share",
                       answer->primitive, candidates[i].primitive, answer->instance);
    }
    gn_judge_flood_finish(&flood);
    return ok;
}

bool gn_ref_judge_candidates(struct gn_ref_judge *judge, const struct gn_ref_ray *ray,
                             const struct gn_ref_answer *candidates, size_t candidate_count,
                             const struct gn_ref_answer *committed, struct gn_ref_verdict *out)
{
    struct gn_judge_hits hits;
    struct gn_judge_losses losses = {.judge = judge, .ray = ray, .found = candidates, .found_count = candidate_count};
    bool ok = false;
    memset(out, 0, sizeof *out);
    hits.list = hits.local;
    hits.count = 0;
    if (!gn_judge_hits_collect(judge, ray, &hits))
        goto end;

    for (size_t i = 0; i < candidate_count; i++) {
        const struct gn_ref_answer *answer = &candidates[i];
        struct gn_judge_facts facts = {0};
        const char *why_not =
            gn_judge_facts_of(judge, ray, answer->instance, answer->geometry, answer->primitive, &facts);
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
            if (!nearer_margin(judge, ray, &placed, committed, (double)committed->t, &margin) || margin <= GN_BOUND)
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
    gn_judge_flood_finish(&losses.flood);
    gn_judge_hits_finish(&hits);
    return ok;
}
