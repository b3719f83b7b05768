/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The tree of the tiers DOUBLE and EXACT: a binned surface area split of boxes that contain the primitives over the real
 * numbers, each range of primitives halved until it fits a leaf. Every primitive is in one leaf because ranges are only
 * ever cut in two.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "reference/tracer_internal.h"

#define BINS 16
/* Below this depth ranges are cut in the middle: at most 30 levels more. */
#define MOST_CHOSEN_LEVELS 46

struct item {
    struct gn_ref_bounds bounds;
    struct gn_ref_primitive primitive;
};

struct build {
    struct gn_ref_tree *tree;
    struct item *items;
};

/*
 * v' = G v and w = M v' with running bounds: a sum of three products and a translation, each operation of relative error
 * 2^-53, is wrong by less than 2^-50 times the sum of the magnitudes. Underflow is smaller than 2^-900 and vanishes in
 * the f32 that bounds are enlarged by.
 */
static void place(const float m[12], double p[3], double error[3])
{
    double out[3], out_error[3];
    for (int r = 0; r < 3; r++) {
        double magnitude = fabs((double)m[4 * r + 3]);
        out[r] = m[4 * r + 3];
        out_error[r] = 0;
        for (int c = 0; c < 3; c++) {
            out[r] += m[4 * r + c] * p[c];
            magnitude += fabs(m[4 * r + c] * p[c]);
            out_error[r] += fabs((double)m[4 * r + c]) * error[c];
        }
        out_error[r] = (out_error[r] + 0x1p-50 * magnitude) * (1 + 0x1p-48);
    }
    memcpy(p, out, sizeof out);
    memcpy(error, out_error, sizeof out_error);
}

void gn_ref_tree_vertex(const struct gn_ref_scene *scene, const struct gn_ref_primitive *primitive, int corner,
                        double out[3], double out_error[3])
{
    const struct gn_ref_instance *instance = &scene->instances[primitive->instance];
    const struct gn_ref_geometry *geometry = &scene->blases[instance->blas].geometries[primitive->geometry];
    const double *position = geometry->positions[geometry->triangles[primitive->primitive][corner]];
    for (int i = 0; i < 3; i++) {
        out[i] = position[i] / geometry->divisor;
        out_error[i] = geometry->divisor == 1 ? 0 : 0x1p-52 * fabs(out[i]);
    }
    if (geometry->transform)
        place(geometry->transform, out, out_error);
    place(instance->transform, out, out_error);
}

/* Extends by value +- error and at least one f32; by everything where that is no number. */
static void extend(struct gn_ref_bounds *bounds, int axis, double value, double error)
{
    float lower = nextafterf(nextafterf((float)(value - 2 * error), -INFINITY), -INFINITY);
    float upper = nextafterf(nextafterf((float)(value + 2 * error), INFINITY), INFINITY);
    if (!isfinite(value) || !isfinite(error)) {
        lower = -INFINITY;
        upper = INFINITY;
    }
    bounds->lower[axis] = fminf(bounds->lower[axis], lower);
    bounds->upper[axis] = fmaxf(bounds->upper[axis], upper);
}

static const struct gn_ref_bounds nothing = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

/* False for an inactive primitive. */
static bool primitive_bounds(const struct gn_ref_scene *scene, const struct gn_ref_primitive *primitive,
                             struct gn_ref_bounds *out)
{
    const struct gn_ref_instance *instance = &scene->instances[primitive->instance];
    const struct gn_ref_geometry *geometry = &scene->blases[instance->blas].geometries[primitive->geometry];
    *out = nothing;
    if (geometry->type == GN_REF_AABBS) {
        const float *box = geometry->aabbs[primitive->primitive];
        if (isnan(box[0]) || box[0] > box[3] || box[1] > box[4] || box[2] > box[5])
            return false;
        for (int corner = 0; corner < 8; corner++) {
            double p[3], error[3] = {0};
            for (int i = 0; i < 3; i++)
                p[i] = box[i + 3 * (corner >> i & 1)];
            place(instance->transform, p, error);
            for (int i = 0; i < 3; i++)
                extend(out, i, p[i], error[i]);
        }
        return true;
    }
    for (int corner = 0; corner < 3; corner++)
        if (isnan(geometry->positions[geometry->triangles[primitive->primitive][corner]][0]))
            return false;
    for (int corner = 0; corner < 3; corner++) {
        double p[3], error[3];
        gn_ref_tree_vertex(scene, primitive, corner, p, error);
        for (int i = 0; i < 3; i++)
            extend(out, i, p[i], error[i]);
    }
    return true;
}

static void bounds_extend(struct gn_ref_bounds *bounds, const struct gn_ref_bounds *other)
{
    for (int i = 0; i < 3; i++) {
        bounds->lower[i] = bounds->lower[i] < other->lower[i] ? bounds->lower[i] : other->lower[i];
        bounds->upper[i] = bounds->upper[i] > other->upper[i] ? bounds->upper[i] : other->upper[i];
    }
}

/* For the heuristic alone: an infinite box is large, and its middle is somewhere. */
static double clamped(float value)
{
    return value > 0x1p100f ? 0x1p100 : value < -0x1p100f ? -0x1p100 : (double)value;
}

static double middle(const struct gn_ref_bounds *bounds, int axis)
{
    return clamped(bounds->lower[axis]) + clamped(bounds->upper[axis]);
}

static double area(const struct gn_ref_bounds *bounds)
{
    double size[3];
    for (int i = 0; i < 3; i++)
        size[i] = fmax(0, clamped(bounds->upper[i]) - clamped(bounds->lower[i]));
    return size[0] * size[1] + size[1] * size[2] + size[2] * size[0];
}

static int bin_of(double value, double lower, double scale)
{
    double bin = (value - lower) * scale;
    return bin >= BINS - 1 ? BINS - 1 : bin > 0 ? (int)bin : 0;
}

/* Where [first, last) is cut, after reordering it; strictly inside, for ranges of at least two. */
static size_t split(struct build *build, size_t first, size_t last, int level)
{
    struct item *items = build->items;
    double lower[3], upper[3], best_cost = INFINITY;
    int best_axis = -1, best_bin = 0;
    size_t half = first + (last - first) / 2;
    if (level >= MOST_CHOSEN_LEVELS)
        return half;
    for (int axis = 0; axis < 3; axis++) {
        lower[axis] = INFINITY;
        upper[axis] = -INFINITY;
        for (size_t i = first; i < last; i++) {
            double value = middle(&items[i].bounds, axis);
            lower[axis] = value < lower[axis] ? value : lower[axis];
            upper[axis] = value > upper[axis] ? value : upper[axis];
        }
        if (!(upper[axis] > lower[axis]))
            continue;
        struct gn_ref_bounds bins[BINS];
        size_t counts[BINS] = {0};
        double scale = BINS / (upper[axis] - lower[axis]), right_cost[BINS];
        for (int b = 0; b < BINS; b++)
            bins[b] = nothing;
        for (size_t i = first; i < last; i++) {
            int b = bin_of(middle(&items[i].bounds, axis), lower[axis], scale);
            bounds_extend(&bins[b], &items[i].bounds);
            counts[b]++;
        }
        struct gn_ref_bounds sum = nothing;
        size_t count = 0;
        for (int b = BINS - 1; b > 0; b--) {
            bounds_extend(&sum, &bins[b]);
            count += counts[b];
            right_cost[b] = count ? area(&sum) * (double)((count + 3) / 4) : 0;
        }
        sum = nothing;
        count = 0;
        for (int b = 0; b + 1 < BINS; b++) {
            bounds_extend(&sum, &bins[b]);
            count += counts[b];
            double cost = (count ? area(&sum) * (double)((count + 3) / 4) : 0) + right_cost[b + 1];
            if (count > 0 && count < last - first && cost < best_cost) {
                best_cost = cost;
                best_axis = axis;
                best_bin = b;
            }
        }
    }
    if (best_axis < 0)
        return half;
    double scale = BINS / (upper[best_axis] - lower[best_axis]);
    size_t left = first, right = last;
    while (left < right) {
        if (bin_of(middle(&items[left].bounds, best_axis), lower[best_axis], scale) <= best_bin) {
            left++;
        } else {
            struct item swap = items[left];
            items[left] = items[--right];
            items[right] = swap;
        }
    }
    return left > first && left < last ? left : half;
}

static struct gn_ref_bounds range_bounds(const struct build *build, size_t first, size_t last)
{
    struct gn_ref_bounds bounds = nothing;
    for (size_t i = first; i < last; i++)
        bounds_extend(&bounds, &build->items[i].bounds);
    return bounds;
}

static uint32_t leaf_make(struct build *build, size_t first, size_t last)
{
    struct gn_ref_tree_leaf *leaf = &build->tree->leaves[build->tree->leaf_count];
    leaf->count = (uint32_t)(last - first);
    for (uint32_t i = 0; i < GN_REF_TREE_WIDTH; i++)
        leaf->items[i] = build->items[i < leaf->count ? first + i : first].primitive;
    return (uint32_t)build->tree->leaf_count++ | GN_REF_TREE_LEAF;
}

/* level counts binary cuts, of which a node makes at most three and no child more than three. */
static uint32_t node_make(struct build *build, size_t first, size_t last, int level)
{
    struct {
        size_t first, last;
        struct gn_ref_bounds bounds;
        int level;
    } children[GN_REF_TREE_WIDTH];
    int count = 1;
    children[0].first = first;
    children[0].last = last;
    children[0].level = level;
    children[0].bounds = range_bounds(build, first, last);
    while (count < GN_REF_TREE_WIDTH) {
        int widest = -1;
        for (int c = 0; c < count; c++)
            if (children[c].last - children[c].first > GN_REF_TREE_WIDTH &&
                (widest < 0 || area(&children[c].bounds) > area(&children[widest].bounds)))
                widest = c;
        if (widest < 0)
            break;
        size_t begin = children[widest].first, end = children[widest].last;
        size_t cut = split(build, begin, end, children[widest].level);
        children[count].first = cut;
        children[count].last = end;
        children[count].level = ++children[widest].level;
        children[count].bounds = range_bounds(build, cut, end);
        children[widest].last = cut;
        children[widest].bounds = range_bounds(build, begin, cut);
        count++;
    }
    uint32_t index = (uint32_t)build->tree->node_count++;
    for (int c = 0; c < GN_REF_TREE_WIDTH; c++) {
        const struct gn_ref_bounds *bounds = c < count ? &children[c].bounds : &nothing;
        uint32_t child = GN_REF_NONE;
        if (c < count && children[c].last - children[c].first <= GN_REF_TREE_WIDTH)
            child = leaf_make(build, children[c].first, children[c].last);
        else if (c < count)
            child = node_make(build, children[c].first, children[c].last, children[c].level);
        struct gn_ref_tree_node *node = &build->tree->nodes[index];
        node->child[c] = child;
        for (int i = 0; i < 3; i++) {
            node->lower[i][c] = bounds->lower[i];
            node->upper[i][c] = bounds->upper[i];
        }
    }
    return index;
}

/* Gives back what the worst case would have needed. */
static void *shrink(void *memory, size_t bytes)
{
    void *smaller = realloc(memory, bytes ? bytes : 1);
    return smaller ? smaller : memory;
}

/* NULL for an inactive instance. */
static const struct gn_ref_blas *blas_of(const struct gn_ref_scene *scene, uint32_t instance)
{
    uint32_t blas = scene->instances[instance].blas;
    return blas == GN_REF_NULL_BLAS ? NULL : &scene->blases[blas];
}

bool gn_ref_tree_build(struct gn_ref_tree *out, const struct gn_ref_scene *scene, enum gn_ref_geometry_type type)
{
    struct build build = {.tree = out};
    size_t most = 0, count = 0;
    bool done = false;
    *out = (struct gn_ref_tree){0};
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct gn_ref_blas *blas = blas_of(scene, i);
        for (uint32_t g = 0; blas && g < blas->geometry_count; g++)
            if (blas->geometries[g].type == type)
                most += blas->geometries[g].primitive_count;
    }
    if (most == 0)
        return true;
    build.items = malloc(most * sizeof *build.items);
    if (!build.items)
        goto out;
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct gn_ref_blas *blas = blas_of(scene, i);
        for (uint32_t g = 0; blas && g < blas->geometry_count; g++) {
            const struct gn_ref_geometry *geometry = &blas->geometries[g];
            for (uint32_t p = 0; geometry->type == type && p < geometry->primitive_count; p++) {
                build.items[count].primitive = (struct gn_ref_primitive){i, g, p};
                if (primitive_bounds(scene, &build.items[count].primitive, &build.items[count].bounds))
                    count++;
            }
        }
    }
    if (count == 0) {
        done = true;
        goto out;
    }
    /* A leaf holds at least one; a node that is not the root has at least two children. */
    out->leaves = malloc(count * sizeof *out->leaves);
    out->nodes = malloc((count + 1) * sizeof *out->nodes);
    if (!out->leaves || !out->nodes)
        goto out;
    node_make(&build, 0, count, 0);
    out->leaves = shrink(out->leaves, out->leaf_count * sizeof *out->leaves);
    out->nodes = shrink(out->nodes, out->node_count * sizeof *out->nodes);
    done = true;
out:
    free(build.items);
    if (!done)
        gn_ref_tree_finish(out);
    return done;
}

void gn_ref_tree_finish(struct gn_ref_tree *tree)
{
    free(tree->nodes);
    free(tree->leaves);
    *tree = (struct gn_ref_tree){0};
}

uint64_t gn_ref_tree_bytes(const struct gn_ref_tree *tree)
{
    return tree->node_count * sizeof *tree->nodes + tree->leaf_count * sizeof *tree->leaves;
}
