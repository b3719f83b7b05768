/* SPDX-License-Identifier: Apache-2.0 */
/* The closest triangle, fast: what surrounds the kernels of certified.h, and the stages below their filter. */
#include "reference/certified.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

/* Scenes up to this stay in the second-level cache of today's processors. */
#define FITS_CACHE_BYTES (UINT64_C(3) << 19)
/* Below this, one ray after the other is as fast as many in flight, or faster. */
#define FLY_BYTES (UINT64_C(1) << 19)

static atomic_bool fly_always;

void gn_ref_certified_fly_always(bool always)
{
    atomic_store(&fly_always, always);
}

/* The kernels. */

struct kernel {
    const char *name;
    gn_ref_certified_run *run;
    gn_ref_certified_start *start;
};

/* NULL when this machine has none of that name. */
static const struct kernel *kernel_find(const char *name)
{
    static const struct kernel kernels[] = {
#ifdef GN_REF_X86_KERNELS
        {"avx512", gn_ref_certified_run_avx512, gn_ref_certified_start_avx512},
        {"avx2", gn_ref_certified_run_avx2, gn_ref_certified_start_avx2},
#endif
        {"portable", gn_ref_certified_run_portable, gn_ref_certified_start_portable},
        {"none", NULL, NULL},
    };
    for (size_t i = 0; i < sizeof kernels / sizeof kernels[0]; i++) {
        bool runs = true;
#ifdef GN_REF_X86_KERNELS
        __builtin_cpu_init();
        bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi");
        if (i == 0)
            runs = avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                   __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw");
        else if (i == 1)
            runs = avx2;
#endif
        if (runs && (!name || strcmp(name, kernels[i].name) == 0))
            return &kernels[i];
    }
    return NULL;
}

static _Atomic(const struct kernel *) chosen;

bool gn_ref_certified_force(const char *name)
{
    const struct kernel *kernel = kernel_find(name);
    if (kernel)
        atomic_store(&chosen, kernel);
    return kernel != NULL;
}

static const struct kernel *kernel_choose(void)
{
    const struct kernel *kernel = atomic_load_explicit(&chosen, memory_order_acquire);
    if (kernel)
        return kernel;
    const char *name = getenv("GNOMON_REFERENCE_KERNEL");
    if (!name || !gn_ref_certified_force(name))
        gn_ref_certified_force(NULL);
    return atomic_load(&chosen);
}

/* A ray, and what is found about it. */

/* The trace of the slow stages, for this flight's ray. */
static struct gn_ref_trace *slow_stage(struct gn_ref_certified *call, struct gn_ref_flight *flight)
{
    struct gn_ref_trace *slow = &call->slow;
    if (call->slow_ray == flight->ray)
        return slow;
    if (!call->slow_ray) {
        slow->scene = call->scene;
        slow->closest = true;
        slow->found = slow->local;
        slow->count = 0;
        slow->filtered = slow->wide = slow->exact_count = 0;
        slow->exact_ready = false;
    }
    call->slow_ray = flight->ray;
    slow->effects = flight->effects;
    slow->integers_ready = false;
    gn_ref_ray_prepare(&slow->setup, flight->ray);
    call->slow_setup = slow->setup;
    call->slow_setup.depth = flight->frames[0].sign;
    return slow;
}

/* In the tree's space. False when they are not known exactly. */
static bool corners_of(const struct gn_ref_scene *scene, uint64_t id, double out[3][3])
{
    const struct gn_ref_bvh *bvh = gn_ref_scene_tree(scene, gn_ref_id_instance(id));
    uint32_t leaf = (uint32_t)id / GN_REF_NODE_WIDTH, lane = id % GN_REF_NODE_WIDTH;
    if (!bvh->leaves_f32) {
        const struct gn_ref_triangle_f64 *triangle = &bvh->triangles[bvh->leaves_i16[leaf].first + lane];
        memcpy(out, triangle->w, sizeof triangle->w);
        return triangle->error == 0;
    }
    for (int v = 0; v < 3; v++)
        for (int axis = 0; axis < 3; axis++)
            out[v][axis] = bvh->leaves_f32[leaf].w[v][axis][lane];
    return true;
}

/* The corners of two triangles, where they are known exactly and in one space. */
static bool corners_of_both(const struct gn_ref_scene *scene, uint64_t a, uint64_t b, double p[3][3], double q[3][3])
{
    return gn_ref_id_instance(a) == gn_ref_id_instance(b) && corners_of(scene, a, p) && corners_of(scene, b, q);
}

/*
 * Two triangles that the ray meets in the same vertex, or in edges with the same ends, are met at the same place:
 * the usual tie. So are coincident triangles: with no edge function known to be 0 all three vertices have to agree.
 */
static bool same_feature(const struct gn_ref_scene *scene, const struct gn_ref_candidate *a,
                         const struct gn_ref_candidate *b)
{
    /* The vertices that the point is a combination of: those whose edge function is not 0. */
    unsigned left = ~a->zeros & 7u, right = ~b->zeros & 7u;
    double p[3][3], q[3][3];
    if (__builtin_popcount(left) != __builtin_popcount(right) || !corners_of_both(scene, a->id, b->id, p, q))
        return false;
    for (int i = 0; i < 3; i++) {
        bool matched = !(left >> i & 1);
        for (int j = 0; j < 3 && !matched; j++)
            matched = (right >> j & 1) && p[i][0] == q[j][0] && p[i][1] == q[j][1] && p[i][2] == q[j][2];
        if (!matched)
            return false;
    }
    return true;
}

/* Whether a triangle that is met is before the best, by s and then by id. */
static bool before_best(struct gn_ref_certified *call, struct gn_ref_flight *flight,
                        const struct gn_ref_candidate *candidate)
{
    const struct gn_ref_candidate *best = &flight->best;
    if (best->id == GN_REF_NO_ID || candidate->upper < best->lower)
        return true;
    if (candidate->lower > best->upper)
        return false;
    bool first = gn_ref_id_compare(call->scene, candidate->id, best->id) < 0;
    if (same_feature(call->scene, candidate, best))
        return first;
    struct gn_ref_found a = {.id = candidate->id, .t = {-INFINITY, INFINITY}, .zeros = candidate->zeros};
    struct gn_ref_found b = {.id = best->id, .t = {-INFINITY, INFINITY}, .zeros = best->zeros};
    int order = gn_ref_trace_compare(slow_stage(call, flight), &a, &b);
    return order < 0 || (order == 0 && first);
}

static bool facing_admitted(const struct gn_ref_scene *scene, const struct gn_ref_flight *flight,
                            const struct gn_ref_candidate *candidate)
{
    if (!(flight->tests >> GN_REF_EFFECT_FACE_CULLING & 1))
        return true;
    bool front = gn_ref_trace_front(scene, flight->effects, candidate->id, candidate->sum_sign);
    return gn_ref_trace_admits_facing(scene, flight->ray, flight->tests, candidate->id, front);
}

bool gn_ref_certified_tie(struct gn_ref_certified *call, struct gn_ref_flight *flight, uint64_t id, const double edge[3],
                          double error, int sense)
{
    const struct gn_ref_candidate *best = &flight->best;
    struct gn_ref_candidate candidate = *best;
    double p[3][3], q[3][3];
    unsigned shared = 0, zero = 7;
    if (best->id == GN_REF_NO_ID || flight->tests || !corners_of_both(call->scene, best->id, id, p, q))
        return false;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            if (!(best->zeros >> i & 1) && p[i][0] == q[j][0] && p[i][1] == q[j][1] && p[i][2] == q[j][2]) {
                shared |= 1u << i;
                zero &= ~(1u << j);
            }
    /* All corners that the point is a combination of; their edge functions are of one sign, or all are 0. */
    if (shared != (~best->zeros & 7u) || __builtin_popcount(zero) != __builtin_popcount(best->zeros))
        return false;
    int sign = 0;
    for (int j = 0; j < 3; j++)
        if (!(zero >> j & 1) && fabs(edge[j]) > error)
            sign = edge[j] > 0 ? 1 : -1;
    if (sign == 0)
        return false;
    if (gn_ref_id_compare(call->scene, id, best->id) > 0)
        return true;
    candidate.id = id;
    candidate.zeros = (uint16_t)zero;
    candidate.sum_sign = sense * sign;
    candidate.barycentric_error = INFINITY; /* the caller wants others */
    flight->best = candidate;
    return true;
}

void gn_ref_certified_offer(struct gn_ref_certified *call, struct gn_ref_flight *flight,
                            const struct gn_ref_candidate *candidate)
{
    if (!(candidate->lower > flight->s_first && candidate->upper < flight->s_last)) {
        gn_ref_certified_consider(call, flight, candidate->id);
        return;
    }
    bool opaque;
    if (flight->tests && (!gn_ref_trace_admits(call->scene, flight->ray, flight->tests, candidate->id, &opaque) ||
                          !facing_admitted(call->scene, flight, candidate)))
        return;
    if (before_best(call, flight, candidate))
        gn_ref_certified_take(call, flight, candidate);
}

/* What the integers of wide.c say of a triangle. */
enum decision { DECISION_MISS, DECISION_HIT, DECISION_UNKNOWN };
static enum decision lane_decide(struct gn_ref_candidate *candidate, const struct gn_ref_lane *lane,
                                 const struct gn_ref_flight *flight, const struct gn_ref_ray_setup *setup)
{
    struct gn_ref_signs signs = {0};
    struct gn_ref_estimate estimate;
    for (int i = 0; i < 3; i++)
        signs.edge[i] = (lane->edge[i] > 0) - (lane->edge[i] < 0);
    if (!gn_ref_signs_meet(&signs))
        return DECISION_MISS;
    if (!gn_ref_estimate_f64(&estimate, lane, setup))
        return DECISION_UNKNOWN;
    if (estimate.t.lower >= flight->s_last || estimate.t.upper <= flight->s_first ||
        estimate.t.lower > flight->best.upper)
        return DECISION_MISS;
    if (!(estimate.t.lower > flight->s_first && estimate.t.upper < flight->s_last))
        return DECISION_UNKNOWN;
    candidate->lower = estimate.t.lower;
    candidate->upper = estimate.t.upper;
    candidate->s = estimate.t_value;
    candidate->s_error = estimate.t_error;
    candidate->beta = estimate.beta;
    candidate->gamma = estimate.gamma;
    candidate->barycentric_error = estimate.barycentric_error;
    candidate->sum_sign = estimate.sum_sign;
    for (int i = 0; i < 3; i++)
        candidate->zeros |= (uint16_t)((signs.edge[i] == 0) << i);
    return DECISION_HIT;
}

static enum decision triangle_decide(struct gn_ref_certified *call, struct gn_ref_flight *flight,
                                     struct gn_ref_candidate *candidate)
{
    struct gn_ref_trace *slow = slow_stage(call, flight);
    struct gn_ref_lane lane;
    enum decision decision = DECISION_UNKNOWN;
    call->filtered--;
    if (gn_ref_trace_wide(slow, candidate->id, &lane))
        decision = lane_decide(candidate, &lane, flight, &call->slow_setup);
    if (decision != DECISION_UNKNOWN)
        return decision;
    struct gn_ref_found found = {.id = candidate->id};
    if (!gn_ref_trace_triangle_exact(slow, &found))
        return DECISION_MISS;
    uint32_t instance = gn_ref_id_instance(candidate->id);
    bool flipped = call->scene->instances[instance].flags & GN_REF_INSTANCE_FLIP_FACING;
    int determinant_sign = call->scene->instance_data[instance].determinant_sign;
    candidate->sum_sign = found.front != flipped ? -determinant_sign : determinant_sign;
    double lower = found.t.lower * flight->length, upper = found.t.upper * flight->length;
    candidate->lower = lower - (fabs(lower) * 0x1p-51 + 0x1p-1000);
    candidate->upper = upper + (fabs(upper) * 0x1p-51 + 0x1p-1000);
    candidate->s = found.t_value * flight->length;
    candidate->s_error = INFINITY; /* the caller wants t */
    candidate->zeros = (uint16_t)found.zeros;
    return DECISION_HIT;
}

void gn_ref_certified_consider(struct gn_ref_certified *call, struct gn_ref_flight *flight, uint64_t id)
{
    struct gn_ref_candidate candidate = {.id = id};
    bool opaque;
    if (flight->tests && !gn_ref_trace_admits(call->scene, flight->ray, flight->tests, candidate.id, &opaque))
        return;
    if (triangle_decide(call, flight, &candidate) != DECISION_HIT || !facing_admitted(call->scene, flight, &candidate))
        return;
    if (before_best(call, flight, &candidate))
        gn_ref_certified_take(call, flight, &candidate);
}

static int flight_answer(struct gn_ref_certified *call, struct gn_ref_flight *flight, struct gn_ref_hit *out)
{
    struct gn_ref_candidate *best = &flight->best;
    const struct gn_ref_scene *scene = call->scene;
    if (flight->lost)
        return gn_ref_trace_closest_any(scene, flight->ray, out);
    if (best->id == GN_REF_NO_ID)
        return 0;
    if (call->any)
        return 1;
    bool opaque, front = gn_ref_trace_front(scene, flight->effects, best->id, best->sum_sign);
    gn_ref_trace_admits(scene, flight->ray, flight->effects & 1u << GN_REF_EFFECT_ANY_HIT, best->id, &opaque);
    if (!gn_ref_candidate_accurate(best) && !gn_ref_candidate_refine(best, flight, scene)) {
        struct gn_ref_found found = {.id = best->id, .t_error = INFINITY, .front = front, .opaque = opaque};
        gn_ref_trace_hit_write(slow_stage(call, flight), &found, out);
        return 1;
    }
    const struct gn_ref_primitive primitive = gn_ref_scene_primitive(scene, best->id);
    double t = best->s / flight->length;
    double t_error = (best->s_error / flight->length + gn_ref_rounding_error(t)) * (1 + 0x1p-50);
    *out = (struct gn_ref_hit){
        .type = GN_REF_TRIANGLES,
        .instance = primitive.instance,
        .geometry = primitive.geometry,
        .primitive = primitive.primitive,
        .t = t,
        .t_exit = t,
        .beta = best->beta,
        .gamma = best->gamma,
        .front = front,
        .opaque = opaque,
        .t_error = t_error,
        .t_exit_error = t_error,
        .barycentric_error = best->barycentric_error,
    };
    return 1;
}

/* Calls. */

static void call_begin(struct gn_ref_certified *call, const struct gn_ref_scene *scene, const struct kernel *kernel)
{
    call->scene = scene;
    call->start = kernel->start;
    call->fits_cache = scene->bytes <= FITS_CACHE_BYTES;
    call->forced = gn_ref_effects_forced();
    call->counts = gn_ref_effects_counting();
    call->any = false;
    call->filtered = call->rejected_f32 = call->sharpened = 0;
    call->slow_ray = NULL;
    gn_ref_environment_enter(&call->environment);
}

static void call_end(struct gn_ref_certified *call)
{
    if (call->counts) {
        struct gn_ref_effect_counts *counts = call->counts;
        counts->rejected_f32 += call->rejected_f32;
        counts->decided_sharp += call->sharpened;
        counts->decided_f64 += call->filtered - call->rejected_f32 - call->sharpened;
        counts->decided_wide += call->slow_ray ? call->slow.wide : 0;
        counts->decided_exact += call->slow_ray ? call->slow.exact_count : 0;
    }
    if (call->slow_ray) {
        gn_ref_trace_count(0, call->slow.wide, call->slow.exact_count);
        if (call->slow.exact_ready)
            gn_ref_exact_finish(&call->slow.exact);
    }
    gn_ref_trace_count(call->filtered, 0, 0);
    gn_ref_environment_leave(&call->environment);
}

/* What needs no traversal: 1 when the flight has been started, 0 and the answer otherwise. */
static bool ray_begin(struct gn_ref_certified *call, struct gn_ref_flight *flight, const struct gn_ref_ray *ray,
                      struct gn_ref_hit *out_hit, int *out_found)
{
    const struct gn_ref_scene *scene = call->scene;
    if (!scene->committed || !gn_ref_trace_ray_valid(ray)) {
        *out_found = -1;
        return false;
    }
    if (scene->triangle_count == 0 || (ray->flags & GN_REF_RAY_SKIP_TRIANGLES)) {
        *out_found = 0;
        return false;
    }
    if (!call->start || !call->start(flight, scene, ray)) {
        *out_found = gn_ref_trace_closest_any(scene, ray, out_hit);
        return false;
    }
    if (call->counts)
        call->counts->rays++;
    const uint32_t test = 1u << GN_REF_EFFECT_MASK | 1u << GN_REF_EFFECT_FACE_CULLING;
    const uint32_t any_hit = 1u << GN_REF_EFFECT_ANY_HIT;
    bool culls_opacity = ray->flags & (GN_REF_RAY_CULL_OPAQUE | GN_REF_RAY_CULL_NO_OPAQUE);
    flight->effects = gn_ref_effects_called(scene, ray->flags, ray->cull_mask) | call->forced;
    flight->tests = flight->effects & (test | ((culls_opacity ? any_hit : 0) | (call->forced & any_hit)));
    return true;
}

static struct gn_ref_hit *hit_of(struct gn_ref_certified *call, size_t index)
{
    return call->hits ? (struct gn_ref_hit *)(void *)((char *)call->hits + index * call->stride) : &call->unwanted;
}

bool gn_ref_certified_next(struct gn_ref_certified *call, struct gn_ref_flight *flight)
{
    while (call->next < call->count) {
        size_t i = call->next++;
        int found;
        flight->index = i;
        if (ray_begin(call, flight, &call->rays[i], hit_of(call, i), &found))
            return true;
        call->found[i] = (int8_t)found;
    }
    return false;
}

void gn_ref_certified_end(struct gn_ref_certified *call, struct gn_ref_flight *flight)
{
    call->found[flight->index] = (int8_t)flight_answer(call, flight, hit_of(call, flight->index));
}

static int trace_one(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray, bool any, struct gn_ref_hit *out_hit)
{
    struct gn_ref_certified call;
    struct gn_ref_flight flight;
    const struct kernel *kernel = kernel_choose();
    int found;
    call_begin(&call, scene, kernel);
    call.any = any;
    if (ray_begin(&call, &flight, ray, out_hit, &found)) {
        kernel->run(&call, &flight);
        found = flight_answer(&call, &flight, out_hit);
    }
    call_end(&call);
    return found;
}

static void trace_many(const struct gn_ref_scene *scene, const struct gn_ref_ray *rays, size_t count, bool any,
                       struct gn_ref_hit *out_hits, size_t stride, int8_t *out_found)
{
    struct gn_ref_certified call;
    const struct kernel *kernel = kernel_choose();
    call_begin(&call, scene, kernel);
    call.any = any;
    call.rays = rays;
    call.count = count;
    call.next = 0;
    call.hits = out_hits;
    call.stride = stride;
    call.found = out_found;
    if (kernel->run && !call.counts && (scene->bytes > FLY_BYTES || atomic_load(&fly_always))) {
        kernel->run(&call, NULL);
    } else {
        struct gn_ref_flight flight;
        while (gn_ref_certified_next(&call, &flight)) {
            kernel->run(&call, &flight);
            gn_ref_certified_end(&call, &flight);
        }
    }
    call_end(&call);
}

int gn_ref_trace_closest_triangle_exact(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray,
                                        struct gn_ref_hit *out_hit)
{
    return trace_one(scene, ray, false, out_hit);
}

void gn_ref_trace_closest_triangles_exact(const struct gn_ref_scene *scene, const struct gn_ref_ray *rays,
                                          size_t count, struct gn_ref_hit *out_hits, int8_t *out_found)
{
    trace_many(scene, rays, count, false, out_hits, sizeof *out_hits, out_found);
}

void gn_ref_trace_closest_triangles_apart(const struct gn_ref_scene *scene, const struct gn_ref_ray *rays, size_t count,
                                          struct gn_ref_hit *out_hits, size_t stride, int8_t *out_found)
{
    trace_many(scene, rays, count, false, out_hits, stride, out_found);
}

int gn_ref_trace_any_triangle(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray)
{
    struct gn_ref_hit unwanted;
    return trace_one(scene, ray, true, &unwanted);
}

void gn_ref_trace_any_triangles(const struct gn_ref_scene *scene, const struct gn_ref_ray *rays, size_t count,
                                int8_t *out_found)
{
    trace_many(scene, rays, count, true, NULL, 0, out_found);
}
