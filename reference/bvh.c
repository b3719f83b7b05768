/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The trees over triangles, boxes and instances. Embree's builder only proposes which primitives belong together; the nodes,
 * their bounds (computed here, from the primitives up) and the check that every primitive is in exactly one leaf are
 * ours, so nothing that Embree rounds, clamps or drops can lose a hit.
 */
#include <embree4/rtcore.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "reference/scene_internal.h"

/* Least costs of a subtree, see proposal_price(). */
struct price {
    float whole; /* as one child */
    float parts[GN_REF_NODE_WIDTH + 1]; /* [n]: as at most n children, n >= 2 */
    uint8_t left[GN_REF_NODE_WIDTH + 1]; /* how many of these the first half gets */
    bool is_leaf; /* as one child it is a leaf */
};

/* A binary tree, built by Embree's callbacks in the memory of the RTCBVH: a node of two, or a leaf. */
struct proposal {
    struct proposal *child[2]; /* NULL: a leaf */
    uint32_t primitive_count; /* of all below */
    uint32_t ids[GN_REF_NODE_WIDTH]; /* of a leaf */
    struct price *price; /* of a node, else NULL */
    float areas[2]; /* of a node's children, as Embree sees them: for prices alone */
};
static void *node_create(RTCThreadLocalAllocator allocator, unsigned child_count, void *user)
{
    (void)user;
    if (child_count != 2)
        return NULL;
    struct proposal *node = rtcThreadLocalAlloc(allocator, sizeof *node, 16);
    struct price *price = rtcThreadLocalAlloc(allocator, sizeof *price, 16);
    if (!node || !price)
        return NULL;
    *node = (struct proposal){.price = price};
    return node;
}

static void node_set_children(void *pointer, void **children, unsigned child_count, void *user)
{
    (void)user;
    struct proposal *node = pointer;
    for (unsigned i = 0; node && i < child_count; i++)
        node->child[i] = children[i];
}

/* Half the surface of a box. */
static double area_of(const float lower[3], const float upper[3])
{
    double size[3];
    for (int axis = 0; axis < 3; axis++)
        size[axis] = fmin(fmax((double)upper[axis] - lower[axis], 0), 0x1p100);
    return size[0] * size[1] + size[1] * size[2] + size[2] * size[0];
}

static void node_set_bounds(void *pointer, const struct RTCBounds **bounds, unsigned child_count, void *user)
{
    (void)user;
    struct proposal *node = pointer;
    for (unsigned i = 0; node && i < child_count; i++) {
        const struct RTCBounds *of = bounds[i];
        const float lower[3] = {of->lower_x, of->lower_y, of->lower_z}, upper[3] = {of->upper_x, of->upper_y, of->upper_z};
        node->areas[i] = (float)area_of(lower, upper);
    }
}

static void *leaf_create(RTCThreadLocalAllocator allocator, const struct RTCBuildPrimitive *primitives, size_t count,
                         void *user)
{
    (void)user;
    struct proposal *leaf = count > GN_REF_NODE_WIDTH ? NULL : rtcThreadLocalAlloc(allocator, sizeof *leaf, 16);
    if (leaf) {
        *leaf = (struct proposal){.primitive_count = (uint32_t)count};
        for (size_t i = 0; i < count; i++)
            leaf->ids[i] = primitives[i].primID;
    }
    return leaf;
}

struct builder {
    struct gn_ref_bvh *bvh;
    const struct gn_ref_bvh_input *input;
    double quantum[3]; /* what every stored bound is a multiple of */
    double size; /* of the whole box */
    bool centred; /* bounds are relative to a centre */
    bool *seen;
    char *error;
    size_t error_size;
};

static bool __attribute__((format(printf, 2, 3))) fail(struct builder *builder, const char *format, ...)
{
    if (builder->error[0] == '\0') {
        va_list arguments;
        va_start(arguments, format);
        vsnprintf(builder->error, builder->error_size, format, arguments);
        va_end(arguments);
    }
    return false;
}

static void bounds_extend(struct gn_ref_bounds *bounds, const struct gn_ref_bounds *other)
{
    for (int axis = 0; axis < 3; axis++) {
        if (other->lower[axis] < bounds->lower[axis])
            bounds->lower[axis] = other->lower[axis];
        if (other->upper[axis] > bounds->upper[axis])
            bounds->upper[axis] = other->upper[axis];
    }
}

static const struct gn_ref_bounds nothing = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

/*
 * The largest f32 that is a multiple of the quantum and not above value - error - centre. The difference is widened
 * by an ulp unless TwoSum says that it is exact. Rounding down to a multiple is exact: it only clears low bits.
 */
static float relative_down(double value, double error, double centre, double quantum)
{
    double x = value - centre, other = x - value;
    bool exact = (value - (x - other)) - (centre + other) == 0;
    if (error > 0 || !exact)
        x = nextafter(x - fabs(x) * 0x1p-52 - error, -INFINITY);
    float rounded = (float)x;
    if ((double)rounded > x)
        rounded = nextafterf(rounded, -INFINITY);
    if (quantum > 0 && fabsf(rounded) < quantum * 0x1p24)
        rounded = (float)(floor((double)rounded / quantum) * quantum);
    return rounded;
}

static void vertex_extend(const struct builder *builder, struct gn_ref_bounds *bounds, const struct gn_ref_vertex *v)
{
    for (int axis = 0; axis < 3; axis++) {
        double centre = builder->bvh->centre[axis], quantum = builder->quantum[axis];
        float lower = relative_down(v->w[axis], v->error, centre, quantum);
        float upper = -relative_down(-v->w[axis], v->error, -centre, quantum);
        if (!(lower >= bounds->lower[axis]))
            bounds->lower[axis] = lower;
        if (!(upper <= bounds->upper[axis]))
            bounds->upper[axis] = upper;
    }
}

static const struct gn_ref_vertex *corner_of(const struct builder *builder, uint32_t index, int corner)
{
    return &builder->input->vertices[builder->input->corners[index][corner]];
}

/* Bounds of a primitive as nodes store them. */
static struct gn_ref_bounds primitive_bounds(const struct builder *builder, uint32_t index)
{
    struct gn_ref_bounds bounds = nothing;
    if (!builder->input->vertices) {
        bounds = builder->input->bounds[index];
        for (int axis = 0; builder->centred && axis < 3; axis++) {
            double centre = builder->bvh->centre[axis], quantum = builder->quantum[axis];
            bounds.lower[axis] = relative_down(bounds.lower[axis], 0, centre, quantum);
            bounds.upper[axis] = -relative_down(-bounds.upper[axis], 0, -centre, quantum);
        }
        return bounds;
    }
    for (int v = 0; v < 3; v++)
        vertex_extend(builder, &bounds, corner_of(builder, index, v));
    return bounds;
}

/* What a visit costs, about, in units of a node's. */
#define LEAF_COST 1.0f

/*
 * Checks the proposal (complete, nothing twice, not too deep: a wrong one is an error of the machine or of Embree, but
 * it must not become a wrong answer) and finds how it is best taken apart into nodes of up to eight children and leaves
 * of up to eight primitives: c(n) = the cost of a subtree as at most n children of a node above it, by dynamic
 * programming from the leaves up. Eight boxes or triangles cost as much as one, so full ones are cheap.
 */
static bool proposal_price(struct builder *builder, struct proposal *p, uint32_t depth, float area, float *out_leaf_cost)
{
    uint32_t count = builder->input->count;
    if (!p)
        return fail(builder, "out of memory while building the tree over %u primitives", count);
    if (depth > GN_REF_MAX_DEPTH)
        return fail(builder, "the tree over %u primitives is deeper than %d levels", count, GN_REF_MAX_DEPTH);
    if (!p->price) {
        for (uint32_t i = 0; i < p->primitive_count; i++) {
            if (p->ids[i] >= count || builder->seen[p->ids[i]])
                return fail(builder, "primitive %u is in the tree twice or unknown", p->ids[i]);
            builder->seen[p->ids[i]] = true;
        }
        *out_leaf_cost = LEAF_COST * area;
        return true;
    }
    struct price *price = p->price;
    const struct price *below[2];
    float leaf_cost[2];
    for (int i = 0; i < 2; i++) {
        if (!proposal_price(builder, p->child[i], depth + 1, p->areas[i], &leaf_cost[i]))
            return false;
        below[i] = p->child[i]->price;
        p->primitive_count += p->child[i]->primitive_count;
    }
    for (unsigned n = 2; n <= GN_REF_NODE_WIDTH; n++) {
        price->parts[n] = INFINITY;
        price->left[n] = 1;
        for (unsigned k = 1; k < n; k++) {
            float cost = 0;
            for (int i = 0; i < 2; i++) {
                unsigned share = i == 0 ? k : n - k;
                float least = below[i] ? below[i]->whole : leaf_cost[i];
                if (below[i] && share > 1 && below[i]->parts[share] < least)
                    least = below[i]->parts[share];
                cost += least;
            }
            if (cost < price->parts[n]) {
                price->parts[n] = cost;
                price->left[n] = (uint8_t)k;
            }
        }
    }
    price->whole = area + price->parts[GN_REF_NODE_WIDTH];
    price->is_leaf = p->primitive_count <= GN_REF_NODE_WIDTH && LEAF_COST * area <= price->whole && !builder->input->instances;
    if (price->is_leaf)
        price->whole = LEAF_COST * area;
    *out_leaf_cost = price->whole;
    return true;
}

static bool proposal_is_leaf(const struct proposal *p)
{
    return !p->price || p->price->is_leaf;
}

/* The children of a node above that p becomes, at most n. */
static uint32_t proposal_part(const struct proposal *p, unsigned n, const struct proposal **out)
{
    if (n == 1 || !p->price || p->price->whole <= p->price->parts[n]) {
        *out = p;
        return 1;
    }
    uint32_t count = proposal_part(p->child[0], p->price->left[n], out);
    return count + proposal_part(p->child[1], n - p->price->left[n], out + count);
}

static uint32_t proposal_children(const struct proposal *p, const struct proposal *out[GN_REF_NODE_WIDTH])
{
    unsigned left = p->price->left[GN_REF_NODE_WIDTH];
    uint32_t count = proposal_part(p->child[0], left, out);
    return count + proposal_part(p->child[1], GN_REF_NODE_WIDTH - left, out + count);
}

static uint32_t proposal_ids(const struct proposal *p, uint32_t *out)
{
    if (!p->price) {
        memcpy(out, p->ids, p->primitive_count * sizeof *out);
        return p->primitive_count;
    }
    uint32_t count = proposal_ids(p->child[0], out);
    return count + proposal_ids(p->child[1], out + count);
}

/* Nodes, then leaves. */
static void proposal_count(const struct proposal *p, uint64_t counts[2])
{
    counts[proposal_is_leaf(p)]++;
    if (proposal_is_leaf(p))
        return;
    const struct proposal *children[GN_REF_NODE_WIDTH];
    uint32_t count = proposal_children(p, children);
    for (uint32_t i = 0; i < count; i++)
        proposal_count(children[i], counts);
}

static bool is_multiple(double value, double quantum)
{
    return rint(value / quantum) * quantum == value;
}

/*
 * 2^-46 of the extent, so that differences of multiples of it that are up to 64 times the extent are exact in f64:
 * certified.h says what for. Only coordinates that are nearly 0 are finer.
 */
static bool triangle_is_fine(const struct builder *builder, uint32_t index)
{
    double quantum = builder->bvh->quantum;
    for (int v = 0; v < 3 && quantum > 0; v++)
        for (int axis = 0; axis < 3; axis++)
            if (!is_multiple(corner_of(builder, index, v)->w[axis], quantum))
                return true;
    return false;
}

/* The least power of two q with |value| <= 32767 q; 0 for 0. */
static double grid_step(double value)
{
    int exponent;
    if (!(value > 0) || !(value < 0x1p120))
        return 0;
    frexp(value / 32767, &exponent);
    return ldexp(1, exponent);
}

/* The f32 that is not below and has only zeros in the lower half of its bits, of 0 .. 1: the upper half. */
static uint16_t extent_up(double value)
{
    float rounded = (float)value;
    if ((double)rounded < value)
        rounded = nextafterf(rounded, INFINITY);
    uint32_t bits;
    memcpy(&bits, &rounded, sizeof bits);
    return (uint16_t)((bits + 0xFFFF) >> 16);
}

static void leaf_range(const struct builder *builder, const uint32_t *ids, uint32_t count, int axis, double *lower,
                       double *upper)
{
    *lower = INFINITY;
    *upper = -INFINITY;
    for (uint32_t i = 0; i < count; i++)
        for (int v = 0; v < 3; v++) {
            double w = corner_of(builder, ids[i], v)->w[axis];
            *lower = fmin(*lower, w);
            *upper = fmax(*upper, w);
        }
}

static void leaf_f32_set(struct builder *builder, struct gn_ref_leaf_f32 *leaf, const uint32_t *ids, uint32_t count)
{
    double half[3], most = 0;
    *leaf = (struct gn_ref_leaf_f32){.count = (uint8_t)count};
    for (int axis = 0; axis < 3; axis++) {
        double lower, upper;
        leaf_range(builder, ids, count, axis, &lower, &upper);
        leaf->origin[axis] = (float)(lower + (upper - lower) / 2);
        half[axis] = nextafter(fmax(upper - leaf->origin[axis], leaf->origin[axis] - lower), INFINITY);
        most = fmax(most, half[axis]);
        for (uint32_t l = 0; l < GN_REF_NODE_WIDTH; l++)
            for (int v = 0; v < 3; v++)
                leaf->w[v][axis][l] = (float)corner_of(builder, ids[l < count ? l : 0], v)->w[axis];
    }
    /* Its power of two and the inverse have to be f32; beyond 2^91 nobody asks. */
    int exponent;
    frexp(most, &exponent);
    exponent = exponent < -100 ? -100 : exponent > 100 ? 100 : exponent;
    leaf->exponent = (int16_t)exponent;
    for (int axis = 0; axis < 3; axis++)
        leaf->extent[axis] = extent_up(ldexp(half[axis], -exponent));
    for (uint32_t l = 0; l < count; l++) {
        leaf->fine |= triangle_is_fine(builder, ids[l]);
        leaf->geometry[l] = builder->input->primitives[ids[l]].geometry;
        leaf->primitive[l] = builder->input->primitives[ids[l]].primitive;
    }
    builder->bvh->triangle_count += count;
}

/*
 * The grid is along each axis as coarse as 16 bits ask for, but no finer than 2^-40 of the scene or of the leaf's
 * coarsest axis, so that nothing leaves f32's range. Steps that the vertices turn out not to keep to become infinite.
 */
static void leaf_i16_set(struct builder *builder, struct gn_ref_leaf_i16 *leaf, const uint32_t *ids, uint32_t count)
{
    const double *origin = builder->bvh->centre;
    double middle[3], step[3], size = grid_step(builder->size * 0x1p-25);
    *leaf = (struct gn_ref_leaf_i16){.first = builder->bvh->triangle_count, .count = (uint8_t)count};
    for (int axis = 0; axis < 3; axis++) {
        double lower, upper;
        leaf_range(builder, ids, count, axis, &lower, &upper);
        leaf->centre[axis] = (float)(lower + (upper - lower) / 2 - origin[axis]);
        middle[axis] = leaf->centre[axis];
        step[axis] = grid_step(fmax(upper - origin[axis] - middle[axis], middle[axis] - (lower - origin[axis])));
        size = fmax(size, step[axis]);
    }
    bool usable = size >= 0x1p-125 && size <= 0x1p100;
    leaf->inverse_size = usable ? (float)(1 / size) : 1;
    for (int axis = 0; axis < 3; axis++) {
        step[axis] = fmax(step[axis], size * 0x1p-40);
        bool kept = usable;
        for (uint32_t l = 0; usable && l < count; l++)
            for (int v = 0; v < 3; v++) {
                const struct gn_ref_vertex *vertex = corner_of(builder, ids[l], v);
                double w = vertex->w[axis] - origin[axis], d = w - middle[axis], k = rint(d / step[axis]);
                /* Both differences are rounded. */
                double off = fabs(d - k * step[axis]) + 0x1p-51 * (fabs(w) + fabs(middle[axis])) + vertex->error;
                kept &= fabs(k) <= 32767 && off <= 0.5625 * step[axis];
                leaf->k[v][axis][l] = (int16_t)(fabs(k) <= 32767 ? k : 0);
            }
        leaf->step[axis] = kept ? (float)(step[axis] / size) : INFINITY;
    }
    for (uint32_t l = 0; l < count; l++) {
        struct gn_ref_triangle_f64 *record = &builder->bvh->triangles[builder->bvh->triangle_count++];
        record->geometry = builder->input->primitives[ids[l]].geometry;
        record->primitive = builder->input->primitives[ids[l]].primitive;
        record->error = 0;
        for (int v = 0; v < 3; v++) {
            const struct gn_ref_vertex *vertex = corner_of(builder, ids[l], v);
            record->error = fmax(record->error, vertex->error);
            memcpy(record->w[v], vertex->w, sizeof record->w[v]);
        }
    }
}

static uint32_t leaf_emit(struct builder *builder, const struct proposal *p, struct gn_ref_bounds *out_bounds)
{
    struct gn_ref_bvh *bvh = builder->bvh;
    uint32_t index = bvh->leaf_count++, ids[GN_REF_NODE_WIDTH], count = proposal_ids(p, ids);
    *out_bounds = nothing;
    for (uint32_t i = 0; i < count; i++) {
        struct gn_ref_bounds bounds = primitive_bounds(builder, ids[i]);
        bounds_extend(out_bounds, &bounds);
    }
    for (uint32_t l = 0; bvh->boxes && l < GN_REF_NODE_WIDTH; l++)
        bvh->boxes[index][l] = l < count ? ids[l] : GN_REF_NONE;
    if (bvh->leaves_f32)
        leaf_f32_set(builder, &bvh->leaves_f32[index], ids, count);
    else if (bvh->leaves_i16)
        leaf_i16_set(builder, &bvh->leaves_i16[index], ids, count);
    return (builder->input->instances ? builder->input->instances[ids[0]] : index) | GN_REF_LEAF_BIT;
}

static uint32_t node_emit(struct builder *builder, const struct proposal *p, struct gn_ref_bounds *out_bounds);

/* A node above `count` children. */
static uint32_t children_emit(struct builder *builder, const struct proposal *const *children, uint32_t count,
                              struct gn_ref_bounds *out_bounds)
{
    uint32_t index = builder->bvh->node_count++;
    struct gn_ref_node *node = &builder->bvh->nodes[index];
    *out_bounds = nothing;
    for (uint32_t i = 0; i < GN_REF_NODE_WIDTH; i++) {
        struct gn_ref_bounds bounds = nothing;
        node->child[i] = i < count ? node_emit(builder, children[i], &bounds) : GN_REF_NONE;
        for (int axis = 0; axis < 3; axis++) {
            node->lower[axis][i] = bounds.lower[axis];
            node->upper[axis][i] = bounds.upper[axis];
        }
        node->unused[i] = 0;
        bounds_extend(out_bounds, &bounds);
    }
    return index;
}

static uint32_t node_emit(struct builder *builder, const struct proposal *p, struct gn_ref_bounds *out_bounds)
{
    const struct proposal *children[GN_REF_NODE_WIDTH];
    if (proposal_is_leaf(p))
        return leaf_emit(builder, p, out_bounds);
    return children_emit(builder, children, proposal_children(p, children), out_bounds);
}

/*
 * The centre, a multiple of 2^-20 of the extent so that centre + bound fits f64 when bounds are multiples of the
 * quantum: with 2^e above centre and extent both are multiples of 2^(e - 50) and their sum is below 2^(e + 1).
 * Scenes beyond the range of the f32 traversal (see certified.h) have no need of one.
 */
static void centre_choose(struct builder *builder)
{
    struct gn_ref_bvh *bvh = builder->bvh;
    struct gn_ref_bounds all = nothing;
    for (uint32_t i = 0; i < (builder->input->vertices ? 1 : builder->input->count); i++)
        bounds_extend(&all, &builder->input->bounds[i]);
    double size = 0;
    for (int axis = 0; axis < 3; axis++)
        size = fmax(size, (double)all.upper[axis] - all.lower[axis]);
    builder->size = size;
    for (int axis = 0; axis < 3; axis++) {
        double lower = all.lower[axis], upper = all.upper[axis];
        int size_exponent, exponent;
        bvh->centre[axis] = builder->quantum[axis] = 0;
        if (!(fabs(lower) <= 0x1p90) || !(fabs(upper) <= 0x1p90) || !(size >= 0x1p-80) ||
            !(size <= 0x1p91))
            continue;
        builder->centred = true;
        frexp(size, &size_exponent);
        double step = ldexp(1, size_exponent - 20);
        double centre = (float)(rint((lower + (upper - lower) / 2) / step) * step);
        frexp(centre, &exponent);
        bvh->centre[axis] = centre;
        bvh->quantum = ldexp(1, size_exponent - 46);
        bvh->inverse_quantum = ldexp(1, 46 - size_exponent);
        builder->quantum[axis] = ldexp(1, (centre != 0 && exponent > size_exponent ? exponent : size_exponent) - 50);
    }
}

/* Whether f32 holds all vertices without loss. */
static bool all_f32(const struct builder *builder)
{
    for (uint32_t i = 0; i < builder->input->count; i++)
        for (int v = 0; v < 3; v++) {
            const struct gn_ref_vertex *vertex = corner_of(builder, i, v);
            for (int axis = 0; axis < 3; axis++)
                if (vertex->error != 0 || !(fabs(vertex->w[axis]) <= 0x1.fffffep127) ||
                    (double)(float)vertex->w[axis] != vertex->w[axis])
                    return false;
        }
    return true;
}

/*
 * Bounds for Embree's surface area heuristic alone: finite and of moderate size, in the same order as the real ones.
 * Beyond 2^60 all looks alike to it, which costs time in scenes of that size and nothing else.
 */
static float moderate(float value)
{
    return value > 0x1p60f ? 0x1p60f : value < -0x1p60f ? -0x1p60f : value;
}

#define HUGE_PAGE ((size_t)1 << 21)

/* A leaf's number and a lane make an id, and box ids come after all of them. */
#define MOST_LEAVES (UINT32_C(1) << 28)

/* All of a tree in one piece: nodes, then leaves, then triangles. */
static bool tree_allocate(struct builder *builder, uint64_t node_count, uint64_t leaf_count, bool f32)
{
    struct gn_ref_bvh *bvh = builder->bvh;
    bool triangles = builder->input->vertices;
    size_t leaf = builder->input->instances ? 0
                  : !triangles              ? sizeof *bvh->boxes
                  : f32                     ? sizeof *bvh->leaves_f32
                                            : sizeof *bvh->leaves_i16;
    size_t nodes = (size_t)node_count * sizeof *bvh->nodes, leaves = (size_t)leaf_count * leaf;
    size_t bytes = nodes + leaves + (triangles && !f32 ? builder->input->count * sizeof *bvh->triangles : 0);
    /* Fewer look-ups of addresses; whether the system grants it makes no difference otherwise. */
    bool huge = bytes >= HUGE_PAGE / 2;
    if (huge)
        bytes = (bytes + HUGE_PAGE - 1) / HUGE_PAGE * HUGE_PAGE;
    void *memory = NULL;
    if (posix_memalign(&memory, huge ? HUGE_PAGE : 64, bytes) != 0)
        return fail(builder, "out of memory: %zu bytes for the tree", bytes);
    if (huge)
        madvise(memory, bytes, MADV_HUGEPAGE);
    bvh->bytes = bytes;
    bvh->nodes = memory;
    char *after = (char *)memory + nodes;
    if (leaf && !triangles)
        bvh->boxes = (uint32_t(*)[GN_REF_NODE_WIDTH])(void *)after;
    else if (leaf && f32)
        bvh->leaves_f32 = (struct gn_ref_leaf_f32 *)(void *)after;
    else if (leaf)
        bvh->leaves_i16 = (struct gn_ref_leaf_i16 *)(void *)after;
    if (triangles && !f32)
        bvh->triangles = (struct gn_ref_triangle_f64 *)(void *)(after + leaves);
    return true;
}

void gn_ref_bvh_device_refused(char *error, size_t error_size)
{
    const enum RTCError code = rtcGetDeviceError(NULL);
    if (code == RTC_ERROR_OUT_OF_MEMORY)
        snprintf(error, error_size, "out of memory: Embree gives no device");
    else
        snprintf(error, error_size, "Embree gives no device (error %d)", (int)code);
}

struct RTCDeviceTy *gn_ref_bvh_device_create(char *error, size_t error_size)
{
    /* One thread: the tree is the same everywhere, and nothing runs on when a process forks. */
    RTCDevice device = rtcNewDevice("threads=1,verbose=0");
    if (!device)
        gn_ref_bvh_device_refused(error, error_size);
    return device;
}

void gn_ref_bvh_device_release(struct RTCDeviceTy *device)
{
    if (device)
        rtcReleaseDevice(device);
}

bool gn_ref_bvh_build(struct gn_ref_bvh *out, const struct gn_ref_bvh_input *input, struct RTCDeviceTy *device, char *error,
                      size_t error_size)
{
    *out = (struct gn_ref_bvh){0};
    struct builder builder = {.bvh = out, .input = input, .error = error, .error_size = error_size};
    uint32_t count = input->count;
    RTCBVH memory = NULL;
    struct RTCBuildPrimitive *primitives = NULL;
    bool done = false;
    error[0] = '\0';
    if (count == 0)
        return true;
    centre_choose(&builder);

    struct proposal few = {.primitive_count = count}, *root = &few;
    memory = rtcNewBVH(device);
    if (posix_memalign((void **)&primitives, 64, (size_t)count * sizeof *primitives) != 0)
        primitives = NULL;
    builder.seen = calloc(count, sizeof *builder.seen);
    if (!memory || !primitives || !builder.seen) {
        fail(&builder, "out of memory before the tree over %u primitives is built", count);
        goto out;
    }
    const uint32_t most_in_leaf = input->instances ? 1 : GN_REF_NODE_WIDTH;
    for (uint32_t i = 0; i < count && count <= most_in_leaf; i++)
        few.ids[i] = i;
    for (uint32_t i = 0; i < count && count > most_in_leaf; i++) {
        struct gn_ref_bounds b = primitive_bounds(&builder, i);
        primitives[i] = (struct RTCBuildPrimitive){
            .lower_x = moderate(b.lower[0]), .lower_y = moderate(b.lower[1]), .lower_z = moderate(b.lower[2]),
            .geomID = 0,
            .upper_x = moderate(b.upper[0]), .upper_y = moderate(b.upper[1]), .upper_z = moderate(b.upper[2]),
            .primID = i,
        };
    }
    struct RTCBuildArguments arguments = rtcDefaultBuildArguments();
    arguments.maxBranchingFactor = 2;
    arguments.maxDepth = GN_REF_MAX_DEPTH - 34; /* the builder halves what is left then, up to 2^30 of it */
    arguments.sahBlockSize = 1;
    arguments.minLeafSize = arguments.maxLeafSize = most_in_leaf;
    arguments.bvh = memory;
    arguments.primitives = primitives;
    arguments.primitiveCount = count;
    arguments.primitiveArrayCapacity = count;
    arguments.createNode = node_create;
    arguments.setNodeChildren = node_set_children;
    arguments.setNodeBounds = node_set_bounds;
    arguments.createLeaf = leaf_create;
    if (count > most_in_leaf)
        root = rtcBuildBVH(&arguments);
    enum RTCError code = rtcGetDeviceError(device);
    if (!root || code != RTC_ERROR_NONE) {
        fail(&builder, "Embree's builder failed with error %d over %u primitives", (int)code, count);
        goto out;
    }

    /* The root is no child: its area makes no difference. */
    float cost;
    if (!proposal_price(&builder, root, 1, 0, &cost))
        goto out;
    for (uint32_t i = 0; i < count; i++)
        if (!builder.seen[i]) {
            fail(&builder, "primitive %u of %u is missing in the tree", i, count);
            goto out;
        }
    uint64_t counts[2] = {0};
    proposal_count(root, counts);
    if (counts[1] >= MOST_LEAVES) {
        fail(&builder, "the tree has %llu leaves, expected fewer than %u", (unsigned long long)counts[1], MOST_LEAVES);
        goto out;
    }
    bool f32 = input->vertices && all_f32(&builder);
    if (!f32)
        out->quantum = 0;
    /* The traversal starts at a node: a tree that is one leaf gets one above it. */
    bool lone_leaf = proposal_is_leaf(root);
    if (!tree_allocate(&builder, counts[0] + lone_leaf, counts[1], f32))
        goto out;
    struct gn_ref_bounds root_bounds;
    if (lone_leaf)
        children_emit(&builder, (const struct proposal *[]){root}, 1, &root_bounds);
    else
        node_emit(&builder, root, &root_bounds);
    for (int axis = 0; axis < 3; axis++)
        out->half[axis] = fmax(fabs(root_bounds.lower[axis]), fabs(root_bounds.upper[axis]));
    done = true;
out:
    free(primitives);
    free(builder.seen);
    if (memory)
        rtcReleaseBVH(memory);
    if (!done)
        gn_ref_bvh_finish(out);
    return done;
}

void gn_ref_bvh_finish(struct gn_ref_bvh *bvh)
{
    free(bvh->nodes);
    *bvh = (struct gn_ref_bvh){0};
}
