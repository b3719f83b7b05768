/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The tree over the flattened scene. Embree's builder only proposes which primitives belong together; the nodes,
 * their bounds (computed here, from the primitives up) and the check that every primitive is in exactly one leaf are
 * ours, so nothing that Embree rounds, clamps or drops can lose a hit.
 */
#include <embree4/rtcore.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "reference/scene_internal.h"

/* What Embree's callbacks build, in the memory of the RTCBVH. */
struct proposal {
    uint32_t child_count; /* 0: a leaf */
    uint32_t primitive_count;
    void *below[]; /* the children, or the ids, packed */
};

static void *node_create(RTCThreadLocalAllocator allocator, unsigned child_count, void *user)
{
    (void)user;
    struct proposal *node = rtcThreadLocalAlloc(allocator, sizeof *node + child_count * sizeof(void *), 16);
    if (node) {
        node->child_count = child_count;
        node->primitive_count = 0;
    }
    return node;
}

static void node_set_children(void *pointer, void **children, unsigned child_count, void *user)
{
    (void)user;
    struct proposal *node = pointer;
    if (node)
        memcpy(node->below, children, child_count * sizeof(void *));
}

static void node_set_bounds(void *pointer, const struct RTCBounds **bounds, unsigned child_count, void *user)
{
    (void)pointer, (void)bounds, (void)child_count, (void)user;
}

static void *leaf_create(RTCThreadLocalAllocator allocator, const struct RTCBuildPrimitive *primitives, size_t count,
                         void *user)
{
    (void)user;
    struct proposal *leaf = rtcThreadLocalAlloc(allocator, sizeof *leaf + count * sizeof(uint32_t), 16);
    if (leaf) {
        leaf->child_count = 0;
        leaf->primitive_count = (uint32_t)count;
        for (size_t i = 0; i < count; i++)
            ((uint32_t *)leaf->below)[i] = primitives[i].primID;
    }
    return leaf;
}

struct builder {
    struct gn_ref_bvh *bvh;
    const struct gn_ref_vertex (*triangles)[3];
    const struct gn_ref_bounds *bounds;
    uint32_t first_id;
    uint32_t count;
    double quantum[3]; /* what every stored bound is a multiple of */
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

/*
 * Counts what the tree needs, and checks it: complete, nothing twice, not too deep. A wrong proposal is an error of
 * the machine or of Embree, but it must not become a wrong answer.
 */
static bool proposal_count(struct builder *builder, const struct proposal *p, uint32_t depth, uint64_t counts[2])
{
    if (!p)
        return fail(builder, "out of memory while building the tree over %u primitives", builder->count);
    if (depth > GN_REF_MAX_DEPTH)
        return fail(builder, "the tree over %u primitives is deeper than %d levels", builder->count,
                    GN_REF_MAX_DEPTH);
    if (p->child_count > GN_REF_NODE_WIDTH || p->primitive_count > GN_REF_NODE_WIDTH)
        return fail(builder, "a node of the tree has %u children and %u primitives, expected at most %d",
                    p->child_count, p->primitive_count, GN_REF_NODE_WIDTH);
    counts[p->child_count == 0]++;
    for (uint32_t i = 0; i < p->child_count; i++)
        if (!proposal_count(builder, p->below[i], depth + 1, counts))
            return false;
    const uint32_t *ids = (const uint32_t *)p->below;
    for (uint32_t i = 0; i < p->primitive_count; i++) {
        if (ids[i] >= builder->count || builder->seen[ids[i]])
            return fail(builder, "primitive %u is in the tree twice or unknown", ids[i]);
        builder->seen[ids[i]] = true;
    }
    return true;
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

/* Bounds of a primitive as nodes store them. */
static struct gn_ref_bounds primitive_bounds(const struct builder *builder, uint32_t index)
{
    if (!builder->triangles)
        return builder->bounds[index];
    struct gn_ref_bounds bounds = nothing;
    for (int v = 0; v < 3; v++)
        vertex_extend(builder, &bounds, &builder->triangles[index][v]);
    return bounds;
}

/* Lane l, and all beyond it so that nothing is computed from garbage: they are overwritten or not used. */
static void block_set(struct builder *builder, uint32_t leaf, uint32_t lane, uint32_t index)
{
    struct gn_ref_bvh *bvh = builder->bvh;
    for (uint32_t l = lane; l < GN_REF_NODE_WIDTH; l++) {
        uint32_t id = l == lane ? builder->first_id + index : GN_REF_NONE;
        if (!builder->triangles) {
            bvh->boxes[leaf][l] = id;
            continue;
        }
        double error = 0;
        for (int v = 0; v < 3; v++) {
            const struct gn_ref_vertex *vertex = &builder->triangles[index][v];
            error = fmax(error, vertex->error);
            for (int axis = 0; axis < 3; axis++)
                if (bvh->blocks_f32)
                    bvh->blocks_f32[leaf].w[v][axis][l] = (float)vertex->w[axis];
                else
                    bvh->blocks_f64[leaf].w[v][axis][l] = vertex->w[axis];
        }
        if (bvh->blocks_f32) {
            bvh->blocks_f32[leaf].id[l] = id;
        } else {
            bvh->blocks_f64[leaf].id[l] = id;
            bvh->blocks_f64[leaf].error[l] = error;
        }
    }
}

static bool is_multiple(double value, double quantum)
{
    return rint(value / quantum) * quantum == value;
}

/*
 * 2^-46 of the extent, so that differences of multiples of it that are up to 64 times the extent are exact in f64:
 * certified.h says what for. Only coordinates that are nearly 0 are finer.
 */
static bool leaf_is_fine(const struct builder *builder, const struct proposal *p)
{
    const uint32_t *ids = (const uint32_t *)p->below;
    double quantum = builder->bvh->quantum;
    for (uint32_t i = 0; quantum > 0 && i < p->primitive_count; i++)
        for (int v = 0; v < 3; v++)
            for (int axis = 0; axis < 3; axis++)
                if (!is_multiple(builder->triangles[ids[i]][v].w[axis], quantum))
                    return true;
    return false;
}

static uint32_t leaf_emit(struct builder *builder, const struct proposal *p, struct gn_ref_bounds *out_bounds)
{
    uint32_t index = builder->bvh->leaf_count++;
    *out_bounds = nothing;
    const uint32_t *ids = (const uint32_t *)p->below;
    for (uint32_t i = 0; i < p->primitive_count; i++) {
        struct gn_ref_bounds bounds = primitive_bounds(builder, ids[i]);
        bounds_extend(out_bounds, &bounds);
        block_set(builder, index, i, ids[i]);
    }
    return index | GN_REF_LEAF_BIT | (leaf_is_fine(builder, p) ? GN_REF_FINE_BIT : 0);
}

static uint32_t node_emit(struct builder *builder, const struct proposal *p, struct gn_ref_bounds *out_bounds)
{
    if (p->child_count == 0)
        return leaf_emit(builder, p, out_bounds);
    uint32_t index = builder->bvh->node_count++;
    struct gn_ref_node *node = &builder->bvh->nodes[index];
    *out_bounds = nothing;
    for (uint32_t i = 0; i < GN_REF_NODE_WIDTH; i++) {
        struct gn_ref_bounds bounds = nothing;
        node->child[i] = i < p->child_count ? node_emit(builder, p->below[i], &bounds) : GN_REF_NONE;
        for (int axis = 0; axis < 3; axis++) {
            node->lower[axis][i] = bounds.lower[axis];
            node->upper[axis][i] = bounds.upper[axis];
        }
        bounds_extend(out_bounds, &bounds);
    }
    return index;
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
    for (uint32_t i = 0; i < builder->count; i++)
        bounds_extend(&all, &builder->bounds[i]);
    double size = 0;
    for (int axis = 0; axis < 3; axis++)
        size = fmax(size, (double)all.upper[axis] - all.lower[axis]);
    for (int axis = 0; axis < 3; axis++) {
        double lower = all.lower[axis], upper = all.upper[axis];
        int size_exponent, exponent;
        bvh->centre[axis] = builder->quantum[axis] = 0;
        if (!builder->triangles || !(fabs(lower) <= 0x1p90) || !(fabs(upper) <= 0x1p90) || !(size >= 0x1p-80) ||
            !(size <= 0x1p91))
            continue;
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
    for (uint32_t i = 0; i < builder->count; i++)
        for (int v = 0; v < 3; v++) {
            const struct gn_ref_vertex *vertex = &builder->triangles[i][v];
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

static void *allocate(struct builder *builder, uint64_t count, size_t size)
{
    if (count >= GN_REF_FINE_BIT) {
        fail(builder, "the tree needs %llu entries, the limit is %u", (unsigned long long)count, GN_REF_FINE_BIT - 1);
        return NULL;
    }
    void *memory = NULL;
    size_t bytes = (size_t)(count ? count : 1) * size;
    if (posix_memalign(&memory, 64, bytes) != 0) {
        fail(builder, "out of memory: %zu bytes for the tree", bytes);
        return NULL;
    }
    return memory;
}

bool gn_ref_bvh_build(struct gn_ref_bvh *out, const struct gn_ref_vertex (*triangles)[3],
                      const struct gn_ref_bounds *bounds, uint32_t first_id, uint32_t count, char *error,
                      size_t error_size)
{
    *out = (struct gn_ref_bvh){0};
    struct builder builder = {.bvh = out, .triangles = triangles, .bounds = bounds, .first_id = first_id,
                              .count = count, .error = error, .error_size = error_size};
    RTCDevice device = NULL;
    RTCBVH memory = NULL;
    struct RTCBuildPrimitive *primitives = NULL;
    bool done = false;
    error[0] = '\0';
    if (count == 0)
        return true;
    centre_choose(&builder);

    /* One thread: the tree is the same everywhere, and nothing runs on when a process forks. */
    device = rtcNewDevice("threads=1,verbose=0");
    if (!device) {
        fail(&builder, "Embree gives no device (error %d)", (int)rtcGetDeviceError(NULL));
        goto out;
    }
    memory = rtcNewBVH(device);
    primitives = allocate(&builder, count, sizeof *primitives);
    builder.seen = calloc(count, sizeof *builder.seen);
    if (!memory || !primitives || !builder.seen) {
        fail(&builder, "out of memory before the tree over %u primitives is built", count);
        goto out;
    }
    for (uint32_t i = 0; i < count; i++) {
        struct gn_ref_bounds b = primitive_bounds(&builder, i);
        primitives[i] = (struct RTCBuildPrimitive){
            .lower_x = moderate(b.lower[0]), .lower_y = moderate(b.lower[1]), .lower_z = moderate(b.lower[2]),
            .geomID = 0,
            .upper_x = moderate(b.upper[0]), .upper_y = moderate(b.upper[1]), .upper_z = moderate(b.upper[2]),
            .primID = i,
        };
    }
    struct RTCBuildArguments arguments = rtcDefaultBuildArguments();
    arguments.maxBranchingFactor = GN_REF_NODE_WIDTH;
    arguments.maxDepth = GN_REF_MAX_DEPTH - 8; /* the builder may go a few levels beyond */
    arguments.sahBlockSize = GN_REF_NODE_WIDTH;
    arguments.minLeafSize = GN_REF_NODE_WIDTH / 2;
    arguments.maxLeafSize = GN_REF_NODE_WIDTH;
    arguments.bvh = memory;
    arguments.primitives = primitives;
    arguments.primitiveCount = count;
    arguments.primitiveArrayCapacity = count;
    arguments.createNode = node_create;
    arguments.setNodeChildren = node_set_children;
    arguments.setNodeBounds = node_set_bounds;
    arguments.createLeaf = leaf_create;
    const struct proposal *root = rtcBuildBVH(&arguments);
    enum RTCError code = rtcGetDeviceError(device);
    if (!root || code != RTC_ERROR_NONE) {
        fail(&builder, "Embree's builder failed with error %d over %u primitives", (int)code, count);
        goto out;
    }

    uint64_t counts[2] = {0};
    if (!proposal_count(&builder, root, 1, counts))
        goto out;
    for (uint32_t i = 0; i < count; i++)
        if (!builder.seen[i]) {
            fail(&builder, "primitive %u of %u is missing in the tree", i, count);
            goto out;
        }
    /* The traversal starts at a node: a tree that is one leaf gets one above it. */
    bool lone_leaf = root->child_count == 0;
    out->nodes = allocate(&builder, counts[0] + lone_leaf, sizeof *out->nodes);
    if (!triangles)
        out->boxes = allocate(&builder, counts[1], sizeof *out->boxes);
    else if (all_f32(&builder))
        out->blocks_f32 = allocate(&builder, counts[1], sizeof *out->blocks_f32);
    else
        out->blocks_f64 = allocate(&builder, counts[1], sizeof *out->blocks_f64);
    if (!out->blocks_f32)
        out->quantum = 0;
    if (!out->nodes || (!out->boxes && !out->blocks_f32 && !out->blocks_f64))
        goto out;
    struct gn_ref_bounds root_bounds;
    if (lone_leaf) {
        struct proposal *above = malloc(sizeof *above + sizeof(void *));
        if (!above) {
            fail(&builder, "out of memory for the root of the tree");
            goto out;
        }
        above->child_count = 1;
        above->primitive_count = 0;
        memcpy(above->below, &root, sizeof root);
        node_emit(&builder, above, &root_bounds);
        free(above);
    } else {
        node_emit(&builder, root, &root_bounds);
    }
    for (int axis = 0; axis < 3; axis++)
        out->half[axis] = fmax(fabs(root_bounds.lower[axis]), fabs(root_bounds.upper[axis]));
    done = true;
out:
    free(primitives);
    free(builder.seen);
    if (memory)
        rtcReleaseBVH(memory);
    if (device)
        rtcReleaseDevice(device);
    if (!done)
        gn_ref_bvh_finish(out);
    return done;
}

void gn_ref_bvh_finish(struct gn_ref_bvh *bvh)
{
    free(bvh->nodes);
    free(bvh->blocks_f32);
    free(bvh->blocks_f64);
    free(bvh->boxes);
    *bvh = (struct gn_ref_bvh){0};
}

uint64_t gn_ref_bvh_bytes(const struct gn_ref_bvh *bvh)
{
    size_t leaf = bvh->blocks_f32 ? sizeof *bvh->blocks_f32 : bvh->blocks_f64 ? sizeof *bvh->blocks_f64 : sizeof *bvh->boxes;
    return (uint64_t)bvh->node_count * sizeof *bvh->nodes + (uint64_t)bvh->leaf_count * leaf;
}
