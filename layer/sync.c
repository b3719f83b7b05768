/* SPDX-License-Identifier: Apache-2.0 */
/* The order of accesses: clocks, chains of barriers, and the tree of what may still be under way. */
#include "layer/sync.h"

#include <stdlib.h>
#include <string.h>

/* Beyond so many the oldest are forgotten, and what came before them counts as ordered. */
#define MOST_DEPENDENCIES 16384u
#define MOST_TOUCHES 262144u

static const struct role {
    bool writes;
    VkPipelineStageFlags2 stages;
    VkAccessFlags2 accesses;
} roles[] = {
#define GN_ROLE(name, what, writes, stages, accesses, stage_text, access_text) {writes, stages, accesses},
#include "layer/sync.def"
};

bool gn_role_writes(enum gn_role role)
{
    return roles[role].writes;
}

#define GRAPHICS                                                                                                       \
    (VK_PIPELINE_STAGE_2_ALL_GRAPHICS_BIT | VK_PIPELINE_STAGE_2_DRAW_INDIRECT_BIT | VK_PIPELINE_STAGE_2_VERTEX_INPUT_BIT |   \
     VK_PIPELINE_STAGE_2_VERTEX_SHADER_BIT | VK_PIPELINE_STAGE_2_TESSELLATION_CONTROL_SHADER_BIT |                         \
     VK_PIPELINE_STAGE_2_TESSELLATION_EVALUATION_SHADER_BIT | VK_PIPELINE_STAGE_2_GEOMETRY_SHADER_BIT |                    \
     VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT | VK_PIPELINE_STAGE_2_EARLY_FRAGMENT_TESTS_BIT |                              \
     VK_PIPELINE_STAGE_2_LATE_FRAGMENT_TESTS_BIT | VK_PIPELINE_STAGE_2_COLOR_ATTACHMENT_OUTPUT_BIT |                       \
     VK_PIPELINE_STAGE_2_INDEX_INPUT_BIT | VK_PIPELINE_STAGE_2_VERTEX_ATTRIBUTE_INPUT_BIT |                                \
     VK_PIPELINE_STAGE_2_PRE_RASTERIZATION_SHADERS_BIT | VK_PIPELINE_STAGE_2_TASK_SHADER_BIT_EXT |                         \
     VK_PIPELINE_STAGE_2_MESH_SHADER_BIT_EXT)
#define TRANSFERS                                                                                                      \
    (VK_PIPELINE_STAGE_2_COPY_BIT | VK_PIPELINE_STAGE_2_BLIT_BIT | VK_PIPELINE_STAGE_2_RESOLVE_BIT |                       \
     VK_PIPELINE_STAGE_2_CLEAR_BIT | VK_PIPELINE_STAGE_2_ACCELERATION_STRUCTURE_COPY_BIT_KHR)

/* The stages of the graphics pipeline are taken together: one of them orders all. */
static VkPipelineStageFlags2 widened(VkPipelineStageFlags2 stages)
{
    if (stages & VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT)
        return ~VK_PIPELINE_STAGE_2_HOST_BIT | (stages & VK_PIPELINE_STAGE_2_HOST_BIT);
    if (stages & GRAPHICS)
        stages |= GRAPHICS;
    if (stages & VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT)
        stages |= TRANSFERS;
    return stages;
}

VkPipelineStageFlags2 gn_stages_from(VkPipelineStageFlags2 stages)
{
    return stages & VK_PIPELINE_STAGE_2_BOTTOM_OF_PIPE_BIT ? ~UINT64_C(0) : widened(stages);
}

VkPipelineStageFlags2 gn_stages_to(VkPipelineStageFlags2 stages)
{
    return stages & VK_PIPELINE_STAGE_2_TOP_OF_PIPE_BIT ? ~UINT64_C(0) : widened(stages);
}

VkAccessFlags2 gn_accesses_all(VkAccessFlags2 accesses)
{
    if (accesses & VK_ACCESS_2_MEMORY_READ_BIT)
        accesses |= VK_ACCESS_2_SHADER_READ_BIT | VK_ACCESS_2_ACCELERATION_STRUCTURE_READ_BIT_KHR | VK_ACCESS_2_TRANSFER_READ_BIT;
    if (accesses & VK_ACCESS_2_MEMORY_WRITE_BIT)
        accesses |= VK_ACCESS_2_SHADER_WRITE_BIT | VK_ACCESS_2_ACCELERATION_STRUCTURE_WRITE_BIT_KHR | VK_ACCESS_2_TRANSFER_WRITE_BIT;
    return accesses;
}

struct gn_clock gn_clock_all(const struct gn_device *device)
{
    struct gn_clock clock;
    for (uint32_t i = 0; i < GN_MAX_CLOCKS; i++)
        clock.at[i] = device->position;
    return clock;
}

void gn_clock_join(struct gn_clock *clock, const struct gn_clock *other)
{
    for (uint32_t i = 0; i < GN_MAX_CLOCKS; i++)
        if (clock->at[i] < other->at[i])
            clock->at[i] = other->at[i];
}

/* A barrier or a wait, as executed. */
struct gn_dependency {
    uint64_t position;
    struct gn_barrier barrier;
    struct gn_clock *clock; /* of a wait: what it has waited for */
};

static struct gn_dependencies *dependencies_of(struct gn_device *device, uint32_t queue)
{
    return queue < GN_MAX_CLOCKS ? &device->dependencies[queue] : NULL;
}

/* What an access has reached: the stages that come after it, and where what it wrote can be seen. */
struct reach {
    bool started;   /* the chain has left the queue of the access, or never was elsewhere */
    bool available;
    VkPipelineStageFlags2 from, after, seen_by;
    bool seen;
};

static void pass(struct reach *reach, const struct gn_barrier *barrier, const struct role *role, const struct role *by,
                 bool foreign, const struct gn_range *range)
{
    if (!reach->started || !(barrier->from & reach->from))
        return;
    bool concerned = barrier->base < range->base + range->size && range->base < barrier->end;
    if (!foreign && concerned && (barrier->from & role->stages) && (barrier->made_available & role->accesses))
        reach->available = true;
    reach->from |= barrier->to;
    reach->after |= barrier->to;
    if (reach->available && concerned && (barrier->to & by->stages) && (barrier->made_visible & by->accesses))
        reach->seen = true;
}

enum gn_order gn_sync_order(const struct gn_device *device, const struct gn_touch *one, const struct gn_touch *other,
                            const struct gn_clock *host)
{
    const struct role *first = &roles[one->role], *second = &roles[other->role];
    const uint32_t queue = one->queue, by_queue = other->queue;
    const uint64_t position = one->position, by_position = other->position;
    if (queue >= GN_MAX_CLOCKS || by_queue >= GN_MAX_CLOCKS || queue == GN_QUEUE_HOST || host->at[queue] >= position ||
        (queue != by_queue && device->order_unknown))
        return GN_ORDERED;
    const struct gn_dependencies *log = &device->dependencies[by_queue];
    if (position <= log->forgotten)
        return GN_ORDERED;
    bool foreign = queue != by_queue;
    struct reach reach = {.started = !foreign, .from = foreign ? 0 : first->stages};
    uint32_t low = 0, high = log->count;
    while (low < high) { /* to the first dependency after the access; in another queue, all may matter */
        uint32_t middle = low + (high - low) / 2;
        if (log->list[middle].position > position)
            high = middle;
        else
            low = middle + 1;
    }
    for (uint32_t i = low; i < log->count && log->list[i].position < by_position; i++) {
        const struct gn_dependency *dependency = &log->list[i];
        if (!dependency->clock) {
            const struct gn_barrier *barrier = &dependency->barrier;
            pass(&reach, barrier, first, second, foreign, &one->range);
        } else if (dependency->clock->at[queue] >= position) {
            reach.started = reach.available = true;
            reach.from |= dependency->barrier.to;
            reach.after |= dependency->barrier.to;
            reach.seen |= (dependency->barrier.to & second->stages) != 0;
        }
    }
    if (!reach.started)
        return GN_OTHER_QUEUE;
    if (!(reach.after & second->stages))
        return GN_NOT_ORDERED;
    if (!first->writes)
        return GN_ORDERED;
    if (!reach.available)
        return GN_NOT_AVAILABLE;
    return second->writes || reach.seen ? GN_ORDERED : GN_NOT_VISIBLE;
}

static bool over(const struct gn_touch *touch, const struct gn_clock *host)
{
    return touch->queue >= GN_MAX_CLOCKS || host->at[touch->queue] >= touch->position;
}

static void forget(struct gn_device *device, struct gn_touch *touch)
{
    gn_ranges_remove(&device->touches, &touch->range);
    device->touch_count--;
    gn_as_release(touch->as);
    free(touch);
}

/* Collects what the tree holds, in no order. */
static void list_tree(struct gn_range *node, struct gn_touch **list, uint32_t *count)
{
    for (; node; node = node->right) {
        list_tree(node->left, list, count);
        list[(*count)++] = (struct gn_touch *)(void *)node;
    }
}

static void drop_dependencies(struct gn_dependencies *log, uint32_t count)
{
    if (!count)
        return;
    for (uint32_t i = 0; i < count; i++)
        free(log->list[i].clock);
    log->count -= count;
    memmove(log->list, log->list + count, log->count * sizeof *log->list);
}

/* What is over by all that the host knows leaves, and so do the dependencies that no access is left for. */
static void sweep(struct gn_device *device)
{
    uint32_t count = 0;
    struct gn_touch **list = malloc((device->touch_count ? device->touch_count : 1) * sizeof *list);
    if (!list)
        return;
    list_tree(device->touches.root, list, &count);
    uint64_t oldest = device->position;
    for (struct gn_queue *queue = device->first_queue; queue; queue = queue->next)
        if (queue->oldest && queue->oldest->first_position < oldest)
            oldest = queue->oldest->first_position;
    bool all = count > MOST_TOUCHES;
    for (uint32_t i = 0; i < count; i++) {
        if (all || over(list[i], &device->host))
            forget(device, list[i]);
        else if (list[i]->position < oldest)
            oldest = list[i]->position;
    }
    free(list);
    device->swept = device->touch_count;
    for (uint32_t q = 0; q < GN_MAX_CLOCKS; q++) {
        struct gn_dependencies *log = &device->dependencies[q];
        uint32_t useless = 0;
        while (useless < log->count && log->list[useless].position < oldest)
            useless++;
        if (log->count - useless > MOST_DEPENDENCIES)
            useless = log->count - MOST_DEPENDENCIES / 2;
        if (useless && log->list[useless - 1].position >= oldest)
            log->forgotten = log->list[useless - 1].position;
        drop_dependencies(log, useless);
        log->swept = log->count;
    }
}

struct visit {
    struct gn_device *device;
    const struct gn_touch *touch;
    const struct gn_clock *host;
    void (*conflict)(void *context, const struct gn_conflict *conflict);
    void *context;
    struct gn_touch *covered[64];
    uint32_t covered_count;
};

static bool covers(const struct gn_range *outer, const struct gn_range *inner)
{
    return outer->base <= inner->base && inner->base + inner->size <= outer->base + outer->size;
}

static void meet(struct gn_range *range, void *context)
{
    struct visit *visit = context;
    const struct gn_touch *touch = visit->touch;
    struct gn_touch *other = (struct gn_touch *)(void *)range;
    bool writes = gn_role_writes(touch->role);
    bool same_kind = other->queue == touch->queue && other->role == touch->role;
    /* What transfers do to each other is not ours to say. */
    bool transfers = other->role == GN_ROLE_TRANSFER && touch->role == GN_ROLE_TRANSFER;
    if (other->position != touch->position && (writes || gn_role_writes(other->role)) && !transfers) {
        enum gn_order order = gn_sync_order(visit->device, other, touch, visit->host);
        if (order != GN_ORDERED)
            visit->conflict(visit->context, &(struct gn_conflict){.first = other, .second = touch, .why = order});
    }
    /* Two uses of one structure, or of one scratch address, are told of by rules that look at the call alone. */
    bool same_thing = (other->as == touch->as && other->role != GN_ROLE_SCRATCH && touch->role != GN_ROLE_SCRATCH &&
                       other->role != GN_ROLE_INPUT && touch->role != GN_ROLE_INPUT) ||
                      (other->role == GN_ROLE_SCRATCH && same_kind && range->base == touch->range.base);
    if (other->position == touch->position && other->queue == touch->queue && (writes || gn_role_writes(other->role)) && !same_thing && !transfers)
        visit->conflict(visit->context, &(struct gn_conflict){.first = other, .second = touch, .why = GN_SAME_COMMAND});
    /* A later access of the same bytes says all that this one could say. */
    bool over_now = other->position != touch->position && over(other, visit->host);
    if ((over_now || ((writes || same_kind) && !touch->passing && covers(&touch->range, range))) &&
        visit->covered_count < sizeof visit->covered / sizeof visit->covered[0])
        visit->covered[visit->covered_count++] = other;
}

void gn_sync_touch(struct gn_device *device, const struct gn_touch *touch, const struct gn_clock *host,
                   void (*conflict)(void *context, const struct gn_conflict *conflict), void *context)
{
    struct visit visit = {.device = device, .touch = touch, .host = host, .conflict = conflict, .context = context};
    if (!touch->range.size || touch->range.base + touch->range.size < touch->range.base || touch->queue >= GN_MAX_CLOCKS)
        return;
    if (device->touch_count > 2 * device->swept + 1024)
        sweep(device);
    gn_ranges_overlapping(&device->touches, touch->range.base, touch->range.size, meet, &visit);
    for (uint32_t i = 0; i < visit.covered_count; i++)
        forget(device, visit.covered[i]);
    if (touch->passing)
        return;
    struct gn_touch *kept = malloc(sizeof *kept);
    if (!kept) {
        gn_tally_lost(device);
        return;
    }
    *kept = *touch;
    gn_as_keep(kept->as);
    gn_ranges_insert(&device->touches, &kept->range);
    device->touch_count++;
}

static void add(struct gn_device *device, uint32_t queue, const struct gn_dependency *dependency)
{
    struct gn_dependencies *log = dependencies_of(device, queue);
    if (!log) {
        free(dependency->clock);
        return;
    }
    if (log->count > 2 * log->swept + 256)
        sweep(device);
    if (log->count == log->capacity) {
        uint32_t capacity = log->capacity ? log->capacity * 2 : 64;
        struct gn_dependency *grown = realloc(log->list, capacity * sizeof *grown);
        if (!grown) {
            free(dependency->clock);
            gn_tally_lost(device);
            return;
        }
        log->list = grown;
        log->capacity = capacity;
    }
    log->list[log->count++] = *dependency;
}

void gn_sync_barrier(struct gn_device *device, uint32_t queue, uint64_t position, const struct gn_barrier *barrier)
{
    if (device->touch_count)
        add(device, queue, &(struct gn_dependency){.position = position, .barrier = *barrier});
}

void gn_sync_wait(struct gn_device *device, uint32_t queue, uint64_t position, const struct gn_clock *clock,
                  VkPipelineStageFlags2 stages)
{
    struct gn_clock *kept = device->touch_count ? malloc(sizeof *kept) : NULL;
    if (!device->touch_count)
        return;
    if (!kept) {
        gn_tally_lost(device);
        return;
    }
    *kept = *clock;
    add(device, queue,
        &(struct gn_dependency){.position = position, .barrier.to = gn_stages_to(stages), .clock = kept});
}

void gn_sync_finish(struct gn_device *device)
{
    while (device->touches.root)
        forget(device, (struct gn_touch *)(void *)device->touches.root);
    for (uint32_t q = 0; q < GN_MAX_CLOCKS; q++) {
        drop_dependencies(&device->dependencies[q], device->dependencies[q].count);
        free(device->dependencies[q].list);
    }
}
