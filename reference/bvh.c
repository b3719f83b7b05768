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

#define MAX_LEAF_SIZE 8

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
    uint32_t triangle_count;
    const struct gn_ref_bounds *bounds;
    uint32_t primitive_count;
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
static bool proposal_count(struct builder *builder, const struct proposal *p, uint32_t depth, uint64_t counts[4])
{
    if (!p)
        return fail(builder, "out of memory while building the tree over %u primitives", builder->primitive_count);
    if (depth > GN_REF_MAX_DEPTH)
        return fail(builder, "the tree over %u primitives is deeper than %d levels", builder->primitive_count,
                    GN_REF_MAX_DEPTH);
    if (p->child_count > 0) {
        if (p->child_count > GN_REF_NODE_WIDTH)
            return fail(builder, "a node of the tree has %u children, expected at most %d", p->child_count,
                        GN_REF_NODE_WIDTH);
        counts[0]++;
        for (uint32_t i = 0; i < p->child_count; i++)
            if (!proposal_count(builder, p->below[i], depth + 1, counts))
                return false;
        return true;
    }
    uint32_t triangles = 0;
    const uint32_t *ids = (const uint32_t *)p->below;
    for (uint32_t i = 0; i < p->primitive_count; i++) {
        if (ids[i] >= builder->primitive_count || builder->seen[ids[i]])
            return fail(builder, "primitive %u is in the tree twice or unknown", ids[i]);
        builder->seen[ids[i]] = true;
        triangles += ids[i] < builder->triangle_count;
    }
    counts[1]++;
    counts[2] += (triangles + GN_REF_BLOCK_WIDTH - 1) / GN_REF_BLOCK_WIDTH;
    counts[3] += p->primitive_count - triangles;
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

static uint32_t leaf_emit(struct builder *builder, const struct proposal *p, struct gn_ref_bounds *out_bounds)
{
    struct gn_ref_bvh *bvh = builder->bvh;
    uint32_t index = bvh->leaf_count++;
    struct gn_ref_leaf *leaf = &bvh->leaves[index];
    *leaf = (struct gn_ref_leaf){.first_block = bvh->block_count, .first_box = bvh->box_count};
    *out_bounds = nothing;
    const uint32_t *ids = (const uint32_t *)p->below;
    int lane = GN_REF_BLOCK_WIDTH;
    struct gn_ref_block *block = NULL;
    for (uint32_t i = 0; i < p->primitive_count; i++) {
        uint32_t id = ids[i];
        bounds_extend(out_bounds, &builder->bounds[id]);
        if (id >= builder->triangle_count) {
            bvh->boxes[bvh->box_count++] = id;
            leaf->box_count++;
            continue;
        }
        if (lane == GN_REF_BLOCK_WIDTH) {
            block = &bvh->blocks[bvh->block_count++];
            leaf->block_count++;
            lane = 0;
        }
        /* The lanes not used yet repeat this one, so that nothing is computed from garbage. */
        for (int l = lane; l < GN_REF_BLOCK_WIDTH; l++) {
            double error = 0;
            for (int v = 0; v < 3; v++) {
                const struct gn_ref_vertex *vertex = &builder->triangles[id][v];
                for (int axis = 0; axis < 3; axis++)
                    block->w[v][axis][l] = vertex->w[axis];
                error = fmax(error, vertex->error);
            }
            block->error[l] = error;
            block->id[l] = l == lane ? id : GN_REF_NONE;
        }
        lane++;
    }
    return index | GN_REF_LEAF_BIT;
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
 * Bounds for Embree's surface area heuristic alone: finite and of moderate size, in the same order as the real ones.
 * Beyond 2^60 all looks alike to it, which costs time in scenes of that size and nothing else.
 */
static float moderate(float value)
{
    return value > 0x1p60f ? 0x1p60f : value < -0x1p60f ? -0x1p60f : value;
}

static void *allocate(struct builder *builder, uint64_t count, size_t size)
{
    if (count >= GN_REF_LEAF_BIT) {
        fail(builder, "the tree needs %llu entries, the limit is %u", (unsigned long long)count, GN_REF_LEAF_BIT - 1);
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

bool gn_ref_bvh_build(struct gn_ref_bvh *out, const struct gn_ref_vertex (*triangles)[3], uint32_t triangle_count,
                      const struct gn_ref_bounds *bounds, uint32_t primitive_count, char *error, size_t error_size)
{
    *out = (struct gn_ref_bvh){0};
    struct builder builder = {out, triangles, triangle_count, bounds, primitive_count, NULL, error, error_size};
    RTCDevice device = NULL;
    RTCBVH memory = NULL;
    struct RTCBuildPrimitive *primitives = NULL;
    bool done = false;
    error[0] = '\0';
    if (primitive_count == 0)
        return true;

    /* One thread: the tree is the same everywhere, and nothing runs on when a process forks. */
    device = rtcNewDevice("threads=1,verbose=0");
    if (!device) {
        fail(&builder, "Embree gives no device (error %d)", (int)rtcGetDeviceError(NULL));
        goto out;
    }
    memory = rtcNewBVH(device);
    primitives = allocate(&builder, primitive_count, sizeof *primitives);
    builder.seen = calloc(primitive_count, sizeof *builder.seen);
    if (!memory || !primitives || !builder.seen) {
        fail(&builder, "out of memory before the tree over %u primitives is built", primitive_count);
        goto out;
    }
    for (uint32_t i = 0; i < primitive_count; i++)
        primitives[i] = (struct RTCBuildPrimitive){
            .lower_x = moderate(bounds[i].lower[0]), .lower_y = moderate(bounds[i].lower[1]),
            .lower_z = moderate(bounds[i].lower[2]), .geomID = 0,
            .upper_x = moderate(bounds[i].upper[0]), .upper_y = moderate(bounds[i].upper[1]),
            .upper_z = moderate(bounds[i].upper[2]), .primID = i,
        };
    struct RTCBuildArguments arguments = rtcDefaultBuildArguments();
    arguments.maxBranchingFactor = GN_REF_NODE_WIDTH;
    arguments.maxDepth = GN_REF_MAX_DEPTH - 8; /* the builder may go a few levels beyond */
    arguments.sahBlockSize = GN_REF_BLOCK_WIDTH;
    arguments.maxLeafSize = MAX_LEAF_SIZE;
    arguments.bvh = memory;
    arguments.primitives = primitives;
    arguments.primitiveCount = primitive_count;
    arguments.primitiveArrayCapacity = primitive_count;
    arguments.createNode = node_create;
    arguments.setNodeChildren = node_set_children;
    arguments.setNodeBounds = node_set_bounds;
    arguments.createLeaf = leaf_create;
    const struct proposal *root = rtcBuildBVH(&arguments);
    enum RTCError code = rtcGetDeviceError(device);
    if (!root || code != RTC_ERROR_NONE) {
        fail(&builder, "Embree's builder failed with error %d over %u primitives", (int)code, primitive_count);
        goto out;
    }

    uint64_t counts[4] = {0};
    if (!proposal_count(&builder, root, 1, counts))
        goto out;
    for (uint32_t i = 0; i < primitive_count; i++)
        if (!builder.seen[i]) {
            fail(&builder, "primitive %u of %u is missing in the tree", i, primitive_count);
            goto out;
        }
    /* The traversal starts at a node: a tree that is one leaf gets one above it. */
    bool lone_leaf = root->child_count == 0;
    out->nodes = allocate(&builder, counts[0] + lone_leaf, sizeof *out->nodes);
    out->leaves = allocate(&builder, counts[1], sizeof *out->leaves);
    out->blocks = allocate(&builder, counts[2], sizeof *out->blocks);
    out->boxes = allocate(&builder, counts[3], sizeof *out->boxes);
    if (!out->nodes || !out->leaves || !out->blocks || !out->boxes)
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
    free(bvh->leaves);
    free(bvh->blocks);
    free(bvh->boxes);
    *bvh = (struct gn_ref_bvh){0};
}
