/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The tier DOUBLE: what a careful engineer does with f64 and no exact fallback. Vertices placed in the world in f64; the
 * ray sheared to its dominant axis, so that the edge function of an edge is the same number, negated, for both of its
 * triangles (Woop, Benthin and Wald 2013: watertight); bounds that contain the primitives. Signs are taken as they come
 * out, and so is the order of t.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "reference/tracer_internal.h"

/* As in filter.c: the same arithmetic in wider registers where the machine has them. */
#if defined(__x86_64__) && defined(__ELF__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define CLONES __attribute__((target_clones("avx2", "default")))
#else
#define CLONES
#endif

enum { N = GN_REF_TREE_WIDTH };

/* w[vertex][axis][lane] of a leaf; unused lanes repeat the first. */
struct corners {
    double w[3][3][N];
};

struct state {
    struct gn_ref_tree triangles, boxes;
    struct corners *corners; /* per leaf of `triangles` */
    double (*object_from_world)[12]; /* per instance; NULL where there are no boxes */
};

struct setup {
    const struct gn_ref_ray *ray;
    double origin[3], inverse[3];
    bool swap[3];
    int k[3];
    double shear[2], depth;
};

static void state_destroy(void *pointer)
{
    struct state *state = pointer;
    gn_ref_tree_finish(&state->triangles);
    gn_ref_tree_finish(&state->boxes);
    free(state->corners);
    free(state->object_from_world);
    free(state);
}

static void invert(const float m[12], double out[12])
{
    double determinant = 0;
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            int r1 = (c + 1) % 3, r2 = (c + 2) % 3, c1 = (r + 1) % 3, c2 = (r + 2) % 3;
            out[4 * r + c] = (double)m[4 * r1 + c1] * m[4 * r2 + c2] - (double)m[4 * r1 + c2] * m[4 * r2 + c1];
            if (r == 0)
                determinant += out[c] * m[4 * c];
        }
    for (int r = 0; r < 3; r++) {
        out[4 * r + 3] = 0;
        for (int c = 0; c < 3; c++) {
            out[4 * r + c] /= determinant;
            out[4 * r + 3] -= out[4 * r + c] * m[4 * c + 3];
        }
    }
}

static bool state_create(struct gn_ref_tracer *tracer)
{
    const struct gn_ref_scene *scene = tracer->scene;
    struct state *state = calloc(1, sizeof *state);
    if (!state || !gn_ref_tree_build(&state->triangles, scene, GN_REF_TRIANGLES) ||
        !gn_ref_tree_build(&state->boxes, scene, GN_REF_AABBS))
        goto fail;
    if (state->triangles.leaf_count > 0) {
        state->corners = malloc(state->triangles.leaf_count * sizeof *state->corners);
        if (!state->corners)
            goto fail;
    }
    for (size_t l = 0; l < state->triangles.leaf_count; l++)
        for (int lane = 0; lane < N; lane++)
            for (int v = 0; v < 3; v++) {
                double w[3], error[3];
                gn_ref_tree_vertex(scene, &state->triangles.leaves[l].items[lane], v, w, error);
                for (int i = 0; i < 3; i++)
                    state->corners[l].w[v][i][lane] = w[i];
            }
    tracer->cost.bytes = sizeof *state + gn_ref_tree_bytes(&state->triangles) + gn_ref_tree_bytes(&state->boxes) +
                         state->triangles.leaf_count * sizeof *state->corners;
    if (state->boxes.leaf_count > 0) {
        state->object_from_world = calloc(scene->instance_count, sizeof *state->object_from_world);
        if (!state->object_from_world)
            goto fail;
        for (uint32_t i = 0; i < scene->instance_count; i++)
            if (scene->instances[i].blas != GN_REF_NULL_BLAS)
                invert(scene->instances[i].transform, state->object_from_world[i]);
        tracer->cost.bytes += scene->instance_count * sizeof *state->object_from_world;
    }
    tracer->state = state;
    return true;
fail:
    if (state)
        state_destroy(state);
    return gn_ref_tracer_fail(tracer, "out of memory for the tree of %u instances", scene->instance_count);
}

static void setup_prepare(struct setup *out, const struct gn_ref_ray *ray)
{
    int z = 0;
    out->ray = ray;
    for (int i = 0; i < 3; i++) {
        out->origin[i] = ray->origin[i];
        /* A zero counts as less than any f32: bounds lie strictly around what is in them, so nothing is on them. */
        out->inverse[i] = ray->direction[i] == 0 ? 0x1p400 : 1 / (double)ray->direction[i];
        out->swap[i] = ray->direction[i] < 0;
        if (fabsf(ray->direction[i]) > fabsf(ray->direction[z]))
            z = i;
    }
    out->k[0] = (z + 1) % 3;
    out->k[1] = (z + 2) % 3;
    out->k[2] = z;
    out->depth = ray->direction[z];
    for (int i = 0; i < 2; i++)
        out->shear[i] = ray->direction[out->k[i]] / out->depth;
}

CLONES static unsigned node_test(double near[N], const struct gn_ref_tree_node *node, const struct setup *setup,
                                 double tmin, double limit)
{
    double far[N];
    for (int l = 0; l < N; l++) {
        near[l] = tmin;
        far[l] = limit;
    }
    for (int i = 0; i < 3; i++) {
        const float *first = setup->swap[i] ? node->upper[i] : node->lower[i];
        const float *last = setup->swap[i] ? node->lower[i] : node->upper[i];
        double origin = setup->origin[i], inverse = setup->inverse[i];
        for (int l = 0; l < N; l++) {
            double a = ((double)first[l] - origin) * inverse, b = ((double)last[l] - origin) * inverse;
            near[l] = a > near[l] ? a : near[l];
            far[l] = b < far[l] ? b : far[l];
        }
    }
    unsigned met = 0;
    for (int l = 0; l < N; l++)
        met |= (unsigned)(near[l] <= far[l] * (1 + 0x1p-40)) << l;
    return met;
}

struct lanes {
    double t[N], beta[N], gamma[N], sum[N];
};

/* Bit l: the line meets triangle l with tmin < t < tmax. */
CLONES static unsigned triangles_test(struct lanes *out, const struct corners *corners, const struct setup *setup)
{
    double x[3][N], y[3][N], z[3][N];
    int kx = setup->k[0], ky = setup->k[1], kz = setup->k[2];
    double ox = setup->origin[kx], oy = setup->origin[ky], oz = setup->origin[kz];
    double sx = setup->shear[0], sy = setup->shear[1], tmin = setup->ray->tmin, tmax = setup->ray->tmax;
    for (int v = 0; v < 3; v++)
        for (int l = 0; l < N; l++) {
            z[v][l] = corners->w[v][kz][l] - oz;
            x[v][l] = corners->w[v][kx][l] - ox - sx * z[v][l];
            y[v][l] = corners->w[v][ky][l] - oy - sy * z[v][l];
        }
    unsigned met = 0;
    for (int l = 0; l < N; l++) {
        double u = x[1][l] * y[2][l] - y[1][l] * x[2][l];
        double v = x[2][l] * y[0][l] - y[2][l] * x[0][l];
        double w = x[0][l] * y[1][l] - y[0][l] * x[1][l];
        double sum = u + v + w;
        out->beta[l] = v / sum;
        out->gamma[l] = w / sum;
        out->t[l] = (z[0][l] + out->beta[l] * (z[1][l] - z[0][l]) + out->gamma[l] * (z[2][l] - z[0][l])) / setup->depth;
        out->sum[l] = sum * setup->depth;
        unsigned inside = ((unsigned)(u >= 0) & (v >= 0) & (w >= 0)) | ((unsigned)(u <= 0) & (v <= 0) & (w <= 0));
        met |= (inside & (sum != 0) & (out->t[l] > tmin) & (out->t[l] < tmax)) << l;
    }
    return met;
}

static double determinant(const float m[12])
{
    return m[0] * ((double)m[5] * m[10] - (double)m[6] * m[9]) - m[1] * ((double)m[4] * m[10] - (double)m[6] * m[8]) +
           m[2] * ((double)m[4] * m[9] - (double)m[5] * m[8]);
}

struct search {
    const struct gn_ref_tracer *tracer;
    const struct gn_ref_ray *ray;
    struct setup setup;
    double limit; /* of t, as long as only the nearest is wanted */
    struct gn_ref_record *nearest; /* NULL when a list is made */
    bool any; /* the first will do */
    bool found;
    struct gn_ref_placed_list *list;
};

/* True when the search is over. */
static bool accept(struct search *search, double at, struct gn_ref_record *record)
{
    record->hit.t_error = record->hit.t_exit_error = INFINITY;
    record->hit.barycentric_error = record->hit.type == GN_REF_TRIANGLES ? INFINITY : 0;
    if (search->list) {
        gn_ref_record_finish(search->tracer->scene, record);
        gn_ref_placed_add(search->list, at, record);
        return search->list->failed;
    }
    if (at > search->limit ||
        (search->found && at == search->limit && gn_ref_hit_compare_ids(&record->hit, &search->nearest->hit) > 0))
        return false;
    search->found = true;
    search->limit = at;
    *search->nearest = *record;
    return search->any;
}

static bool triangles_visit(struct search *search, uint32_t index)
{
    const struct state *state = search->tracer->state;
    const struct gn_ref_scene *scene = search->tracer->scene;
    const struct gn_ref_tree_leaf *leaf = &state->triangles.leaves[index];
    struct lanes lanes;
    unsigned met = triangles_test(&lanes, &state->corners[index], &search->setup) & ((1u << leaf->count) - 1);
    for (; met; met &= met - 1) {
        int l = __builtin_ctz(met);
        const struct gn_ref_primitive *p = &leaf->items[l];
        struct gn_ref_record record = {
            .hit = {.type = GN_REF_TRIANGLES, .instance = p->instance, .geometry = p->geometry,
                    .primitive = p->primitive, .t = lanes.t[l], .t_exit = lanes.t[l], .beta = lanes.beta[l],
                    .gamma = lanes.gamma[l]},
        };
        if (lanes.t[l] > search->limit ||
            !gn_ref_admitted(scene, search->ray, p->instance, p->geometry, &record.hit.opaque))
            continue;
        record.hit.front = (lanes.sum[l] < 0) != (determinant(scene->instances[p->instance].transform) < 0);
        if (gn_ref_facing_admitted(scene, search->ray, p->instance, &record.hit.front) &&
            accept(search, lanes.t[l], &record))
            return true;
    }
    return false;
}

static bool boxes_visit(struct search *search, uint32_t index)
{
    const struct state *state = search->tracer->state;
    const struct gn_ref_scene *scene = search->tracer->scene;
    const struct gn_ref_tree_leaf *leaf = &state->boxes.leaves[index];
    const struct gn_ref_ray *ray = search->ray;
    for (uint32_t n = 0; n < leaf->count; n++) {
        const struct gn_ref_primitive *p = &leaf->items[n];
        struct gn_ref_record record = {.hit = {.type = GN_REF_AABBS, .instance = p->instance, .geometry = p->geometry,
                                               .primitive = p->primitive}};
        if (!gn_ref_admitted(scene, ray, p->instance, p->geometry, &record.hit.opaque))
            continue;
        const double *m = state->object_from_world[p->instance];
        const float *box = scene->blases[scene->instances[p->instance].blas].geometries[p->geometry].aabbs[p->primitive];
        double entry = -INFINITY, leave = INFINITY;
        bool outside = false;
        for (int i = 0; i < 3; i++) {
            double from = m[4 * i + 3], along = 0;
            for (int c = 0; c < 3; c++) {
                from += m[4 * i + c] * ray->origin[c];
                along += m[4 * i + c] * ray->direction[c];
            }
            if (along == 0) {
                outside |= from < box[i] || from > box[3 + i];
                continue;
            }
            double a = (box[i] - from) / along, b = (box[3 + i] - from) / along;
            entry = fmax(entry, fmin(a, b));
            leave = fmin(leave, fmax(a, b));
        }
        if (outside || !(entry <= leave) || leave < ray->tmin || entry > ray->tmax)
            continue;
        record.hit.t = entry;
        record.hit.t_exit = leave;
        if (accept(search, fmax(entry, ray->tmin), &record))
            return true;
    }
    return false;
}

/* Nearest child first. True when the search is over. */
static bool traverse(struct search *search, const struct gn_ref_tree *tree,
                     bool (*visit)(struct search *search, uint32_t leaf))
{
    struct {
        uint32_t child;
        double near;
    } stack[GN_REF_TREE_DEPTH * (N - 1) + N];
    size_t depth = 0;
    double tmin = search->ray->tmin;
    if (tree->node_count == 0)
        return false;
    stack[depth].child = 0;
    stack[depth++].near = tmin;
    while (depth > 0) {
        uint32_t child = stack[--depth].child;
        if (stack[depth].near > search->limit * (1 + 0x1p-40))
            continue;
        if (child & GN_REF_TREE_LEAF) {
            if (visit(search, child & ~GN_REF_TREE_LEAF))
                return true;
            continue;
        }
        const struct gn_ref_tree_node *node = &tree->nodes[child];
        double near[N];
        size_t base = depth;
        for (unsigned met = node_test(near, node, &search->setup, tmin, search->limit); met; met &= met - 1) {
            int i = __builtin_ctz(met);
            if (node->child[i] == GN_REF_NONE)
                continue;
            if (!(node->child[i] & GN_REF_TREE_LEAF))
                __builtin_prefetch(&tree->nodes[node->child[i]]);
            size_t at = depth++;
            for (; at > base && stack[at - 1].near < near[i]; at--)
                stack[at] = stack[at - 1];
            stack[at].child = node->child[i];
            stack[at].near = near[i];
        }
    }
    return false;
}

static void search_run(struct search *search)
{
    const struct state *state = search->tracer->state;
    struct gn_ref_environment environment;
    gn_ref_environment_enter(&environment);
    setup_prepare(&search->setup, search->ray);
    search->limit = search->ray->tmax;
    bool over = false;
    if (!(search->ray->flags & GN_REF_RAY_SKIP_TRIANGLES))
        over = traverse(search, &state->triangles, triangles_visit);
    if (!over && !(search->ray->flags & GN_REF_RAY_SKIP_AABBS))
        traverse(search, &state->boxes, boxes_visit);
    gn_ref_environment_leave(&environment);
}

static enum gn_ref_outcome double_closest(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray,
                                          struct gn_ref_record *out_record)
{
    struct search search = {.tracer = tracer, .ray = ray, .nearest = out_record};
    search_run(&search);
    if (!search.found)
        return GN_REF_MISS;
    gn_ref_record_finish(tracer->scene, out_record);
    return GN_REF_HIT;
}

static enum gn_ref_outcome double_occluded(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray)
{
    struct gn_ref_record record;
    struct search search = {.tracer = tracer, .ray = ray, .nearest = &record, .any = true};
    search_run(&search);
    return search.found ? GN_REF_HIT : GN_REF_MISS;
}

static int64_t double_all(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray,
                          struct gn_ref_record *out_records, size_t capacity)
{
    struct gn_ref_placed_list list = {0};
    struct search search = {.tracer = tracer, .ray = ray, .list = &list};
    search_run(&search);
    return gn_ref_placed_write(&list, out_records, capacity);
}

const struct gn_ref_tier_functions gn_ref_tier_double = {
    .name = "double",
    .create = state_create,
    .destroy = state_destroy,
    .closest = double_closest,
    .occluded = double_occluded,
    .all = double_all,
};
