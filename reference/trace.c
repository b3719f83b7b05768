/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Tracing: a conservative traversal of the tree, then for every primitive it cannot exclude a decision by the f64
 * filter or, where that is not certain, by exact arithmetic.
 */
#include "reference/trace.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "reference/trace_internal.h"

static _Atomic uint64_t counted_filtered, counted_wide, counted_exact;

struct gn_ref_trace_counters gn_ref_trace_counters(void)
{
    return (struct gn_ref_trace_counters){atomic_load_explicit(&counted_filtered, memory_order_relaxed),
                                          atomic_load_explicit(&counted_wide, memory_order_relaxed),
                                          atomic_load_explicit(&counted_exact, memory_order_relaxed)};
}

void gn_ref_trace_count(uint64_t filtered, uint64_t wide, uint64_t exact)
{
    if (filtered)
        atomic_fetch_add_explicit(&counted_filtered, filtered, memory_order_relaxed);
    if (wide)
        atomic_fetch_add_explicit(&counted_wide, wide, memory_order_relaxed);
    if (exact)
        atomic_fetch_add_explicit(&counted_exact, exact, memory_order_relaxed);
}

static struct gn_ref_exact *exact_stage(struct gn_ref_trace *trace)
{
    if (!trace->exact_ready) {
        gn_ref_exact_init(&trace->exact);
        trace->exact_ready = true;
    }
    return &trace->exact;
}

bool gn_ref_trace_ray_valid(const struct gn_ref_ray *ray)
{
    bool moves = false;
    for (int i = 0; i < 3; i++) {
        if (!isfinite(ray->origin[i]) || !isfinite(ray->direction[i]))
            return false;
        moves |= ray->direction[i] != 0;
    }
    return moves && ray->tmin >= 0 && ray->tmin <= ray->tmax;
}

/* False when the scene is not committed or the ray not valid; otherwise trace_end() has to follow. */
static bool trace_begin(struct gn_ref_trace *trace, const struct gn_ref_scene *scene, const struct gn_ref_ray *ray)
{
    gn_ref_environment_enter(&trace->environment);
    if (!scene->committed || !gn_ref_trace_ray_valid(ray)) {
        gn_ref_environment_leave(&trace->environment);
        return false;
    }
    trace->scene = scene;
    trace->effects = gn_ref_effects_called(scene, ray->flags, ray->cull_mask) | gn_ref_effects_forced();
    trace->counts = gn_ref_effects_counting();
    trace->closest = false;
    trace->found = trace->local;
    trace->count = 0;
    trace->capacity = sizeof trace->local / sizeof trace->local[0];
    trace->failed = false;
    trace->limit = ray->tmax;
    trace->filtered = trace->wide = trace->exact_count = 0;
    trace->integers_ready = false;
    trace->exact_ready = false;
    gn_ref_ray_prepare(&trace->setup, ray);
    return true;
}

static void trace_end(struct gn_ref_trace *trace)
{
    if (trace->exact_ready)
        gn_ref_exact_finish(&trace->exact);
    if (trace->found != trace->local)
        free(trace->found);
    gn_ref_trace_count(trace->filtered, trace->wide, trace->exact_count);
    if (trace->counts) {
        trace->counts->rays++;
        trace->counts->decided_f64 += trace->filtered;
        trace->counts->decided_wide += trace->wide;
        trace->counts->decided_exact += trace->exact_count;
    }
    gn_ref_environment_leave(&trace->environment);
}

/*
 * The exact t at which the line meets a triangle's plane or (clipped to tmin) enters a box that the ray is known to
 * meet. False when it is parallel to the triangle.
 */
static bool exact_t(struct gn_ref_trace *trace, uint64_t id, struct gn_ref_ratio *out)
{
    struct gn_ref_exact *exact = exact_stage(trace);
    const struct gn_ref_primitive primitive = gn_ref_scene_primitive(trace->scene, id);
    const struct gn_ref_ray *ray = trace->setup.ray;
    trace->exact_count++;
    if (!gn_ref_id_is_box(id)) {
        if (gn_ref_triangle_exact(exact, trace->scene, &primitive, ray).sum == 0)
            return false;
    } else {
        gn_ref_box_exact(exact, trace->scene, &primitive, ray);
        if (gn_ref_ratio_compare_f64(exact, &exact->t, ray->tmin) < 0)
            gn_ref_ratio_set_f64(&exact->t, ray->tmin);
    }
    gn_ref_ratio_set(out, &exact->t);
    return true;
}

static int compare_exact_t(struct gn_ref_trace *trace, uint64_t a, uint64_t b)
{
    struct gn_ref_exact *exact = exact_stage(trace);
    struct gn_ref_ratio first;
    mpz_init(first.numerator);
    mpz_init(first.denominator);
    int order = 0;
    if (exact_t(trace, a, &first) && exact_t(trace, b, &exact->t))
        order = gn_ref_ratio_compare(exact, &first, &exact->t);
    mpz_clear(first.numerator);
    mpz_clear(first.denominator);
    return order;
}

/* The triangle in integers of fixed width, where they suffice. */
bool gn_ref_trace_wide(struct gn_ref_trace *trace, uint64_t id, struct gn_ref_lane *out)
{
    if (!trace->integers_ready) {
        gn_ref_ray_integers_prepare(&trace->integers, trace->setup.ray);
        trace->integers_ready = true;
    }
    const struct gn_ref_primitive primitive = gn_ref_scene_primitive(trace->scene, id);
    if (!gn_ref_triangle_wide(out, trace->scene, &primitive, &trace->setup, &trace->integers))
        return false;
    trace->wide++;
    return true;
}

static void found_set(struct gn_ref_found *found, const struct gn_ref_estimate *estimate)
{
    found->t = estimate->t;
    found->t_value = estimate->t_value;
    found->t_error = estimate->t_error;
    found->beta = estimate->beta;
    found->gamma = estimate->gamma;
    found->barycentric_error = estimate->barycentric_error;
}

/* From what the exact stage has just computed. */
static void found_set_exact(struct gn_ref_found *found, struct gn_ref_exact *exact, bool triangle)
{
    found->t_value = gn_ref_ratio_f64(exact, &exact->t);
    found->t_error = gn_ref_rounding_error(found->t_value);
    if (triangle) {
        found->beta = gn_ref_exact_barycentric(exact, 1);
        found->gamma = gn_ref_exact_barycentric(exact, 2);
        found->barycentric_error = gn_ref_rounding_error(fmax(found->beta, found->gamma));
    } else {
        found->t_exit = gn_ref_ratio_f64(exact, &exact->t_exit);
        found->t_exit_error = gn_ref_rounding_error(found->t_exit);
    }
}

static void sharpen(struct gn_ref_trace *trace, struct gn_ref_found *found)
{
    struct gn_ref_lane lane;
    struct gn_ref_estimate estimate;
    if (found->sharp || gn_ref_id_is_box(found->id))
        return;
    found->sharp = true;
    if (!gn_ref_trace_wide(trace, found->id, &lane) || !gn_ref_estimate_f64(&estimate, &lane, &trace->setup))
        return;
    found_set(found, &estimate);
    for (int i = 0; i < 3; i++)
        found->zeros |= (unsigned)(lane.edge[i] == 0) << i;
}

static bool same_position(const struct gn_ref_geometry *geometry, uint32_t a, uint32_t b)
{
    const double *p = geometry->positions[a], *q = geometry->positions[b];
    return a == b || (p[0] == q[0] && p[1] == q[1] && p[2] == q[2]);
}

/*
 * Two triangles of one geometry of one instance that the line meets in an edge they share, or in a vertex they share,
 * are met at the same t. That is the usual tie, and settled without computing t. (On the edge's line beyond its ends
 * that holds as well: the ray's line meets it once, being parallel to neither triangle.)
 */
static bool meets_shared_feature(const struct gn_ref_trace *trace, const struct gn_ref_found *a, const struct gn_ref_found *b)
{
    if (!a->zeros || !b->zeros)
        return false;
    const struct gn_ref_primitive p = gn_ref_scene_primitive(trace->scene, a->id);
    const struct gn_ref_primitive q = gn_ref_scene_primitive(trace->scene, b->id);
    if (p.instance != q.instance || p.geometry != q.geometry)
        return false;
    const struct gn_ref_geometry *geometry =
        &trace->scene->blases[trace->scene->instances[p.instance].blas].geometries[p.geometry];
    const uint32_t *v = geometry->triangles[p.primitive], *w = geometry->triangles[q.primitive];
    /* The vertices that the point is a combination of: those whose edge function is not 0. */
    unsigned left = ~a->zeros & 7, right = ~b->zeros & 7;
    if (__builtin_popcount(left) != __builtin_popcount(right))
        return false;
    for (int i = 0; i < 3; i++) {
        bool matched = !(left >> i & 1);
        for (int j = 0; j < 3 && !matched; j++)
            matched = (right >> j & 1) && same_position(geometry, v[i], w[j]);
        if (!matched)
            return false;
    }
    return true;
}

int gn_ref_trace_compare(struct gn_ref_trace *trace, struct gn_ref_found *a, struct gn_ref_found *b)
{
    if (a->id == b->id)
        return 0;
    for (int attempt = 0; attempt < 2; attempt++) {
        if (a->t.upper < b->t.lower)
            return -1;
        if (a->t.lower > b->t.upper)
            return 1;
        if (attempt == 0) {
            sharpen(trace, a);
            sharpen(trace, b);
        }
    }
    if ((a->t.lower == a->t.upper && b->t.lower == b->t.upper) || meets_shared_feature(trace, a, b))
        return 0;
    return compare_exact_t(trace, a->id, b->id);
}

static int compare_found(struct gn_ref_trace *trace, struct gn_ref_found *a, struct gn_ref_found *b)
{
    int order = gn_ref_trace_compare(trace, a, b);
    if (order != 0 || a->id == b->id)
        return order;
    return gn_ref_id_compare(trace->scene, a->id, b->id);
}

static void accept(struct gn_ref_trace *trace, struct gn_ref_found *found)
{
    if (trace->closest) {
        if (trace->count == 0 || compare_found(trace, found, &trace->found[0]) < 0) {
            trace->found[0] = *found;
            trace->count = 1;
            trace->limit = fmin(trace->limit, found->t.upper);
        }
        return;
    }
    if (trace->count == trace->capacity) {
        if (trace->capacity > SIZE_MAX / 4 / sizeof *found) {
            trace->failed = true;
            return;
        }
        size_t capacity = trace->capacity * 4;
        struct gn_ref_found *memory = malloc(capacity * sizeof *memory);
        if (!memory) {
            trace->failed = true;
            return;
        }
        memcpy(memory, trace->found, trace->count * sizeof *memory);
        if (trace->found != trace->local)
            free(trace->found);
        trace->found = memory;
        trace->capacity = capacity;
    }
    trace->found[trace->count++] = *found;
}

bool gn_ref_trace_admits(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray, uint32_t effects, uint64_t id,
                         bool *out_opaque)
{
    *out_opaque = true;
    if (!(effects & (1u << GN_REF_EFFECT_MASK | 1u << GN_REF_EFFECT_ANY_HIT)))
        return true;
    const struct gn_ref_primitive primitive = gn_ref_scene_primitive(scene, id);
    const struct gn_ref_instance *instance = &scene->instances[primitive.instance];
    if (effects >> GN_REF_EFFECT_MASK & 1) {
        gn_ref_effect_ran(GN_REF_EFFECT_MASK, 1);
        if ((instance->mask & ray->cull_mask & 0xFF) == 0)
            return false;
    }
    if (!(effects >> GN_REF_EFFECT_ANY_HIT & 1))
        return true;
    gn_ref_effect_ran(GN_REF_EFFECT_ANY_HIT, 1);
    bool opaque = scene->blases[instance->blas].geometries[primitive.geometry].flags & GN_REF_GEOMETRY_OPAQUE;
    if (instance->flags & GN_REF_INSTANCE_FORCE_OPAQUE)
        opaque = true;
    else if (instance->flags & GN_REF_INSTANCE_FORCE_NO_OPAQUE)
        opaque = false;
    if (ray->flags & GN_REF_RAY_OPAQUE)
        opaque = true;
    else if (ray->flags & GN_REF_RAY_NO_OPAQUE)
        opaque = false;
    *out_opaque = opaque;
    return !(ray->flags & (opaque ? GN_REF_RAY_CULL_OPAQUE : GN_REF_RAY_CULL_NO_OPAQUE));
}

static bool admitted(const struct gn_ref_trace *trace, uint64_t id, struct gn_ref_found *found)
{
    *found = (struct gn_ref_found){.id = id};
    return gn_ref_trace_admits(trace->scene, trace->setup.ray, trace->effects, id, &found->opaque);
}

/*
 * Facing is decided in object space, where the triangle's area as seen along the ray, in the specification's ray space,
 * is negative for a front face. That is d' . N' < 0 with N' = (v1 - v0) x (v2 - v0): for d' = (0, 0, -1) the ray space
 * is object space itself, a = -(area counted counter-clockwise), and N' = (0, 0, 2 area). In the world
 * d . N = (M d') . (cof(M) N') = det(M) (d' . N'), and d . N = U + V + W.
 */
bool gn_ref_trace_front(const struct gn_ref_scene *scene, uint32_t effects, uint64_t id, int sum_sign)
{
    if (!(effects >> GN_REF_EFFECT_MIRRORING & 1))
        return sum_sign < 0;
    gn_ref_effect_ran(GN_REF_EFFECT_MIRRORING, 1);
    uint32_t instance = gn_ref_id_instance(id);
    bool front = sum_sign * scene->instance_data[instance].determinant_sign < 0;
    return front != ((scene->instances[instance].flags & GN_REF_INSTANCE_FLIP_FACING) != 0);
}

bool gn_ref_trace_admits_facing(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray, uint32_t effects,
                                uint64_t id, bool front)
{
    if (!(effects >> GN_REF_EFFECT_FACE_CULLING & 1))
        return true;
    gn_ref_effect_ran(GN_REF_EFFECT_FACE_CULLING, 1);
    if (scene->instances[gn_ref_id_instance(id)].flags & GN_REF_INSTANCE_FACING_CULL_DISABLE)
        return true;
    return !(ray->flags & (front ? GN_REF_RAY_CULL_FRONT_FACING : GN_REF_RAY_CULL_BACK_FACING));
}

static bool facing_admitted(const struct gn_ref_trace *trace, int sum_sign, struct gn_ref_found *found)
{
    found->front = gn_ref_trace_front(trace->scene, trace->effects, found->id, sum_sign);
    return gn_ref_trace_admits_facing(trace->scene, trace->setup.ray, trace->effects, found->id, found->front);
}

/* Everything about one triangle in exact arithmetic; false when the ray does not meet it. */
bool gn_ref_trace_triangle_exact(struct gn_ref_trace *trace, struct gn_ref_found *found)
{
    struct gn_ref_exact *exact = exact_stage(trace);
    const struct gn_ref_ray *ray = trace->setup.ray;
    const struct gn_ref_primitive primitive = gn_ref_scene_primitive(trace->scene, found->id);
    trace->exact_count++;
    struct gn_ref_signs signs = gn_ref_triangle_exact(exact, trace->scene, &primitive, ray);
    if (!gn_ref_signs_meet(&signs) || !facing_admitted(trace, signs.sum, found))
        return false;
    if (isinf(ray->tmin) || gn_ref_ratio_compare_f64(exact, &exact->t, ray->tmin) <= 0)
        return false;
    if (!isinf(ray->tmax) && gn_ref_ratio_compare_f64(exact, &exact->t, ray->tmax) >= 0)
        return false;
    found->t = gn_ref_ratio_interval(exact, &exact->t);
    found_set_exact(found, exact, true);
    found->sharp = true;
    for (int i = 0; i < 3; i++)
        found->zeros |= (unsigned)(signs.edge[i] == 0) << i;
    return true;
}

/*
 * What an estimate says of a triangle that the line meets: whether t is certainly outside the range that is of
 * interest, or certainly inside the ray's.
 */
enum placement { PLACEMENT_OUTSIDE, PLACEMENT_INSIDE, PLACEMENT_UNSURE };
static enum placement estimate_place(const struct gn_ref_trace *trace, const struct gn_ref_estimate *estimate)
{
    const struct gn_ref_ray *ray = trace->setup.ray;
    if (estimate->t.lower >= ray->tmax || estimate->t.upper <= ray->tmin || estimate->t.lower > trace->limit)
        return PLACEMENT_OUTSIDE;
    return estimate->t.lower > ray->tmin && estimate->t.upper < ray->tmax ? PLACEMENT_INSIDE : PLACEMENT_UNSURE;
}

static void triangle_consider(struct gn_ref_trace *trace, const struct gn_ref_filter *filter, int lane_index, uint64_t id)
{
    struct gn_ref_found found;
    struct gn_ref_lane lane;
    struct gn_ref_estimate estimate;
    if (!admitted(trace, id, &found))
        return;
    if (filter->certain >> lane_index & 1) {
        gn_ref_filter_lane(&lane, filter, lane_index);
        enum placement placement = PLACEMENT_UNSURE;
        if (gn_ref_estimate_f64(&estimate, &lane, &trace->setup))
            placement = estimate_place(trace, &estimate);
        if (placement != PLACEMENT_UNSURE) {
            trace->filtered++;
            if (placement == PLACEMENT_INSIDE && facing_admitted(trace, estimate.sum_sign, &found)) {
                found_set(&found, &estimate);
                accept(trace, &found);
            }
            return;
        }
    }
    if (gn_ref_trace_wide(trace, id, &lane)) {
        struct gn_ref_signs signs = {0};
        for (int i = 0; i < 3; i++) {
            signs.edge[i] = (lane.edge[i] > 0) - (lane.edge[i] < 0);
            found.zeros |= (unsigned)(signs.edge[i] == 0) << i;
        }
        if (!gn_ref_signs_meet(&signs))
            return;
        enum placement placement = PLACEMENT_UNSURE;
        if (gn_ref_estimate_f64(&estimate, &lane, &trace->setup))
            placement = estimate_place(trace, &estimate);
        if (placement != PLACEMENT_UNSURE) {
            if (placement == PLACEMENT_INSIDE && facing_admitted(trace, estimate.sum_sign, &found)) {
                found_set(&found, &estimate);
                found.sharp = true;
                accept(trace, &found);
            }
            return;
        }
        found.zeros = 0;
    }
    if (gn_ref_trace_triangle_exact(trace, &found))
        accept(trace, &found);
}

/* A number of an interval, and how far the others are from it at most. */
static double middle(struct gn_ref_interval interval, double *out_error)
{
    double value = interval.lower + (interval.upper - interval.lower) / 2;
    *out_error = nextafter(fmax(interval.upper - value, value - interval.lower), INFINITY);
    return value;
}

static void box_consider(struct gn_ref_trace *trace, uint64_t id)
{
    struct gn_ref_found found;
    if (trace->counts)
        trace->counts->ran[GN_REF_EFFECT_AABBS]++;
    if (!admitted(trace, id, &found) || (trace->setup.ray->flags & GN_REF_RAY_SKIP_AABBS))
        return;
    const struct gn_ref_ray *ray = trace->setup.ray;
    const struct gn_ref_primitive primitive = gn_ref_scene_primitive(trace->scene, id);
    struct gn_ref_interval entry, leave;
    int decision = gn_ref_box_f64(&entry, &leave, trace->scene, &primitive, ray);
    if (decision < 0) {
        trace->filtered++;
        return;
    }
    /* The order of entries clipped to tmin has to be known as well. */
    bool clip_open = entry.lower <= ray->tmin && entry.upper > ray->tmin;
    if (decision > 0 && !clip_open) {
        trace->filtered++;
    } else {
        struct gn_ref_exact *exact = exact_stage(trace);
        trace->exact_count++;
        if (!gn_ref_box_exact(exact, trace->scene, &primitive, ray))
            return;
        entry = gn_ref_ratio_interval(exact, &exact->t);
        leave = gn_ref_ratio_interval(exact, &exact->t_exit);
        if (gn_ref_ratio_compare_f64(exact, &exact->t, ray->tmin) <= 0)
            found.t = (struct gn_ref_interval){ray->tmin, ray->tmin};
        else
            found.t = entry;
        found_set_exact(&found, exact, false);
        accept(trace, &found);
        return;
    }
    found.t = entry.upper <= ray->tmin ? (struct gn_ref_interval){ray->tmin, ray->tmin} : entry;
    found.t_value = middle(entry, &found.t_error);
    found.t_exit = middle(leave, &found.t_exit_error);
    accept(trace, &found);
}

/* A tree as a ray sees it that has been taken into the tree's space. */
struct view {
    const struct gn_ref_bvh *bvh;
    const struct gn_ref_ray_setup *setup;
    uint32_t instance; /* not of trees over boxes and instances */
    bool object; /* that space is an instance's */
    double error; /* then: of every coordinate */
};

/* Up to four triangles of a leaf from lane `first` on, as the filter takes them. False when there are none. */
static bool block_load(struct gn_ref_block *out, const struct view *view, uint32_t leaf, uint32_t first)
{
    const struct gn_ref_bvh *bvh = view->bvh;
    const struct gn_ref_leaf_f32 *narrow = bvh->leaves_f32 ? &bvh->leaves_f32[leaf] : NULL;
    uint32_t count = narrow ? narrow->count : bvh->leaves_i16[leaf].count;
    for (uint32_t l = 0; first < count && l < GN_REF_BLOCK_WIDTH; l++) {
        uint32_t lane = first + l < count ? first + l : count - 1;
        const struct gn_ref_triangle_f64 *wide = narrow ? NULL : &bvh->triangles[bvh->leaves_i16[leaf].first + lane];
        for (int v = 0; v < 3; v++)
            for (int axis = 0; axis < 3; axis++)
                out->w[v][axis][l] = narrow ? (double)narrow->w[v][axis][lane] : wide->w[v][axis];
        out->error[l] = (narrow ? 0 : wide->error) + view->error;
        out->id[l] = first + l < count ? gn_ref_id(view->instance, leaf * GN_REF_NODE_WIDTH + lane) : GN_REF_NO_ID;
    }
    return first < count;
}

/* The open triangles of a block in object space, placed in the world. */
static void block_place(struct gn_ref_block *out, const struct gn_ref_scene *scene, const struct gn_ref_block *block,
                        unsigned open)
{
    for (unsigned l = 0, lane = 0; l < GN_REF_BLOCK_WIDTH; l++) {
        bool used = open;
        if (used) {
            lane = (unsigned)__builtin_ctz(open);
            open &= open - 1;
        }
        const struct gn_ref_primitive primitive = gn_ref_scene_primitive(scene, block->id[lane]);
        double w[3][3];
        gn_ref_triangle_place(scene, &primitive, w, &out->error[l]);
        for (int v = 0; v < 3; v++)
            for (int axis = 0; axis < 3; axis++)
                out->w[v][axis][l] = w[v][axis];
        out->id[l] = used ? block->id[lane] : GN_REF_NO_ID;
    }
}

static void leaf_visit(struct gn_ref_trace *trace, const struct view *view, uint32_t leaf)
{
    const struct gn_ref_bvh *bvh = view->bvh;
    if (bvh->boxes) {
        for (int i = 0; i < GN_REF_NODE_WIDTH && bvh->boxes[leaf][i] != GN_REF_NONE; i++) {
            uint32_t box = bvh->boxes[leaf][i];
            box_consider(trace, gn_ref_id(trace->scene->boxes[box].instance, box | GN_REF_BOX_BIT));
        }
        return;
    }
    struct gn_ref_block block;
    for (uint32_t first = 0; first < GN_REF_NODE_WIDTH && block_load(&block, view, leaf, first);
         first += GN_REF_BLOCK_WIDTH) {
        struct gn_ref_filter filter;
        gn_ref_filter_block_f64(&filter, &block, view->setup);
        if (trace->counts) {
            trace->counts->leaves += first == 0;
            trace->counts->triangles += (unsigned)__builtin_popcount(filter.used);
        }
        trace->filtered += (unsigned)__builtin_popcount(filter.used & ~filter.open);
        if (view->object && filter.open) {
            struct gn_ref_block placed;
            block_place(&placed, trace->scene, &block, filter.open);
            block = placed;
            gn_ref_filter_block_f64(&filter, &block, &trace->setup);
            trace->filtered += (unsigned)__builtin_popcount(filter.used & ~filter.open);
        }
        for (unsigned open = filter.open; open; open &= open - 1) {
            int lane = __builtin_ctz(open);
            triangle_consider(trace, &filter, lane, block.id[lane]);
        }
    }
}

struct pending {
    uint32_t child;
    double t;
};

static void instance_visit(struct gn_ref_trace *trace, uint32_t instance);

/* Only what is certainly missed, or certainly beyond the upper end of the best t so far, is skipped. */
static void traverse(struct gn_ref_trace *trace, const struct view *view)
{
    const struct gn_ref_bvh *bvh = view->bvh;
    struct pending stack[GN_REF_MAX_DEPTH * GN_REF_NODE_WIDTH];
    size_t depth = 0;
    double tmin = trace->setup.ray->tmin;
    if (bvh->node_count == 0)
        return;
    stack[depth++] = (struct pending){0, tmin};
    while (depth > 0) {
        struct pending top = stack[--depth];
        if (top.t > trace->limit * (1 + 0x1p-48))
            continue;
        if (top.child & GN_REF_LEAF_BIT) {
            if (bvh == &trace->scene->instance_bvh)
                instance_visit(trace, top.child & ~GN_REF_LEAF_BIT);
            else
                leaf_visit(trace, view, top.child & ~GN_REF_LEAF_BIT);
            continue;
        }
        const struct gn_ref_node *node = &bvh->nodes[top.child];
        if (trace->counts && bvh->boxes)
            trace->counts->ran[GN_REF_EFFECT_AABBS]++;
        else if (trace->counts)
            trace->counts->nodes++;
        double near[GN_REF_NODE_WIDTH];
        size_t base = depth;
        unsigned met = gn_ref_filter_node_f64(near, node, bvh->centre, view->setup, tmin, trace->limit);
        for (; met; met &= met - 1) {
            int i = __builtin_ctz(met);
            /* Kept with the farthest first, so that the nearest is taken first. */
            size_t place = depth++;
            while (place > base && stack[place - 1].t < near[i]) {
                stack[place] = stack[place - 1];
                place--;
            }
            stack[place] = (struct pending){node->child[i], near[i]};
        }
    }
}

static void instance_visit(struct gn_ref_trace *trace, uint32_t instance)
{
    struct gn_ref_ray_setup setup;
    struct view view = {.bvh = gn_ref_scene_tree(trace->scene, instance), .setup = &trace->setup, .instance = instance};
    if (gn_ref_instance_is_entered(trace->scene, instance, gn_ref_effects_forced())) {
        gn_ref_effect_ran(GN_REF_EFFECT_INSTANCE_TRANSFORMS, 1);
        view.object = true;
        view.error = gn_ref_ray_prepare_object(&setup, trace->scene, instance, trace->setup.ray);
        view.setup = &setup;
    }
    traverse(trace, &view);
}

static void traverse_triangles(struct gn_ref_trace *trace)
{
    if (trace->scene->triangle_count > 0) {
        const struct view view = {.bvh = gn_ref_scene_root(trace->scene), .setup = &trace->setup,
                                  .instance = trace->scene->lone_instance};
        traverse(trace, &view);
    }
}

static bool accurate(const struct gn_ref_found *found)
{
    return found->t_error <= 0x1p-41 * fabs(found->t_value) && found->barycentric_error <= 0x1p-41 &&
           found->t_exit_error <= 0x1p-41 * fabs(found->t_exit);
}

/* The numbers to the accuracy that trace.h promises at least. */
static void refine(struct gn_ref_trace *trace, struct gn_ref_found *found)
{
    if (accurate(found))
        return;
    sharpen(trace, found);
    if (accurate(found))
        return;
    struct gn_ref_exact *exact = exact_stage(trace);
    const struct gn_ref_primitive primitive = gn_ref_scene_primitive(trace->scene, found->id);
    trace->exact_count++;
    bool triangle = !gn_ref_id_is_box(found->id);
    if (triangle)
        gn_ref_triangle_exact(exact, trace->scene, &primitive, trace->setup.ray);
    else
        gn_ref_box_exact(exact, trace->scene, &primitive, trace->setup.ray);
    found_set_exact(found, exact, triangle);
}

void gn_ref_trace_hit_write(struct gn_ref_trace *trace, struct gn_ref_found *found, struct gn_ref_hit *out)
{
    refine(trace, found);
    const struct gn_ref_primitive primitive = gn_ref_scene_primitive(trace->scene, found->id);
    bool triangle = !gn_ref_id_is_box(found->id);
    *out = (struct gn_ref_hit){
        .type = triangle ? GN_REF_TRIANGLES : GN_REF_AABBS,
        .instance = primitive.instance,
        .geometry = primitive.geometry,
        .primitive = primitive.primitive,
        .t = found->t_value,
        .t_exit = triangle ? found->t_value : found->t_exit,
        .beta = found->beta,
        .gamma = found->gamma,
        .front = triangle && found->front,
        .opaque = found->opaque,
        .t_error = found->t_error,
        .t_exit_error = triangle ? found->t_error : found->t_exit_error,
        .barycentric_error = found->barycentric_error,
    };
}

/* Merge sort: the comparison needs the trace, and a list of a million overlapping hits must not take for ever. */
static void sort_found(struct gn_ref_trace *trace, struct gn_ref_found *items, struct gn_ref_found *scratch, size_t count)
{
    if (count < 2)
        return;
    if (count <= 8) {
        for (size_t i = 1; i < count; i++) {
            struct gn_ref_found item = items[i];
            size_t place = i;
            while (place > 0 && compare_found(trace, &item, &items[place - 1]) < 0) {
                items[place] = items[place - 1];
                place--;
            }
            items[place] = item;
        }
        return;
    }
    size_t half = count / 2;
    sort_found(trace, items, scratch, half);
    sort_found(trace, items + half, scratch, count - half);
    memcpy(scratch, items, half * sizeof *items);
    size_t a = 0, b = half, n = 0;
    while (a < half && b < count)
        items[n++] = compare_found(trace, &items[b], &scratch[a]) < 0 ? items[b++] : scratch[a++];
    while (a < half)
        items[n++] = scratch[a++];
}

int64_t gn_ref_trace_all_exact(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray,
                               struct gn_ref_hit *out_hits, size_t capacity)
{
    struct gn_ref_trace trace;
    struct gn_ref_found *scratch = NULL;
    int64_t result = -1;
    if (!trace_begin(&trace, scene, ray))
        return -1;
    if (!(ray->flags & GN_REF_RAY_SKIP_TRIANGLES))
        traverse_triangles(&trace);
    if (trace.effects >> GN_REF_EFFECT_AABBS & 1)
        traverse(&trace, &(struct view){.bvh = &scene->box_bvh, .setup = &trace.setup});
    if (trace.failed)
        goto out;
    if (trace.count > 8) {
        scratch = malloc(trace.count / 2 * sizeof *scratch);
        if (!scratch)
            goto out;
    }
    sort_found(&trace, trace.found, scratch, trace.count);
    for (size_t i = 0; i < trace.count && i < capacity; i++)
        gn_ref_trace_hit_write(&trace, &trace.found[i], &out_hits[i]);
    result = (int64_t)trace.count;
out:
    free(scratch);
    trace_end(&trace);
    return result;
}

int gn_ref_trace_closest_any(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray,
                             struct gn_ref_hit *out_hit)
{
    struct gn_ref_trace trace;
    if (!trace_begin(&trace, scene, ray))
        return -1;
    trace.closest = true;
    if (!(ray->flags & GN_REF_RAY_SKIP_TRIANGLES))
        traverse_triangles(&trace);
    int result = trace.count > 0;
    if (result)
        gn_ref_trace_hit_write(&trace, &trace.found[0], out_hit);
    trace_end(&trace);
    return result;
}

/* Whether a hit names a triangle that the scene has and that is active; it may be degenerate. */
static bool triangle_named(const struct gn_ref_scene *scene, const struct gn_ref_hit *hit, struct gn_ref_primitive *out)
{
    *out = (struct gn_ref_primitive){hit->instance, hit->geometry, hit->primitive};
    if (hit->instance >= scene->instance_count || scene->instances[hit->instance].blas == GN_REF_NULL_BLAS)
        return false;
    const struct gn_ref_blas *blas = &scene->blases[scene->instances[hit->instance].blas];
    if (hit->geometry >= blas->geometry_count || blas->geometries[hit->geometry].type != GN_REF_TRIANGLES ||
        hit->primitive >= blas->geometries[hit->geometry].primitive_count)
        return false;
    const struct gn_ref_geometry *geometry = &blas->geometries[hit->geometry];
    for (int v = 0; v < 3; v++)
        if (isnan(geometry->positions[geometry->triangles[hit->primitive][v]][0]))
            return false;
    return true;
}

int gn_ref_compare_t_exact(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray,
                           const struct gn_ref_hit *a, const struct gn_ref_hit *b)
{
    struct gn_ref_trace trace;
    struct gn_ref_primitive triangles[2];
    int order = 0;
    if (!trace_begin(&trace, scene, ray))
        return 0;
    if (triangle_named(scene, a, &triangles[0]) && triangle_named(scene, b, &triangles[1]) &&
        gn_ref_primitive_compare(&triangles[0], &triangles[1]) != 0) {
        struct gn_ref_exact *exact = exact_stage(&trace);
        struct gn_ref_ratio first;
        mpz_init(first.numerator);
        mpz_init(first.denominator);
        if (gn_ref_triangle_exact(exact, scene, &triangles[0], ray).sum != 0) {
            gn_ref_ratio_set(&first, &exact->t);
            if (gn_ref_triangle_exact(exact, scene, &triangles[1], ray).sum != 0)
                order = gn_ref_ratio_compare(exact, &first, &exact->t);
        }
        mpz_clear(first.numerator);
        mpz_clear(first.denominator);
    }
    trace_end(&trace);
    return order;
}
