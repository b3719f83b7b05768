/* SPDX-License-Identifier: Apache-2.0 */
/* What happens before what. Every access to a range of addresses that the layer knows of (structures, scratch, build input, shader
 * binding tables) is kept while it may still be under way; a later access of the same bytes is a hazard unless the application ordered
 * the two: by a chain of barriers in one queue, by semaphores between queues, or by waiting on the host.
 *
 * What is not observed orders everything: an unknown semaphore, a fence that nothing was submitted with. Signals count for all stages, and
 * an event's wait for all that came before the wait: the layer may miss a hazard, and reports none that is not there. */
#ifndef GN_LAYER_SYNC_H
#define GN_LAYER_SYNC_H

#include "layer/layer.h"

/* What a command does with a range. The text is that of sync.def. */
enum gn_role {
#define GN_ROLE(name, what, writes, stages, accesses, stage_text, access_text) GN_ROLE_##name,
#include "layer/sync.def"
    GN_ROLE_COUNT
};

struct gn_access {
    enum gn_role role;
    uint64_t base, size;
    struct gn_as *as; /* whose memory it is; NULL: a buffer's. Kept by the event */
};

/* A dependency, as recorded. */
struct gn_barrier {
    VkPipelineStageFlags2 from, to;
    VkAccessFlags2 made_available, made_visible;
    uint64_t base, end; /* of the memory that it is about; its execution part is about everything */
};

/* The accesses and barriers of one event. */
struct gn_accesses {
    const char *command;
    uint32_t count;
    struct gn_access list[];
};
struct gn_barriers {
    uint32_t count, capacity;
    struct gn_barrier list[];
};

/* One execution of an access: a node of the device's tree. */
struct gn_touch {
    struct gn_range range; /* first */
    enum gn_role role;
    bool passing; /* it may not have taken place: it is held against what came before, but not remembered */
    struct gn_as *as; /* that it is about; NULL: none. Kept by the tree */
    uint32_t queue;
    uint64_t position, submission;
    const char *command;
    VkCommandBuffer command_buffer;
};

enum gn_order { GN_ORDERED, GN_NOT_ORDERED, GN_NOT_AVAILABLE, GN_NOT_VISIBLE, GN_OTHER_QUEUE, GN_SAME_COMMAND };

/* A pair of accesses that nothing orders. */
struct gn_conflict {
    const struct gn_touch *first, *second;
    enum gn_order why;
};

/* sync.c; with the device locked. */
bool gn_role_writes(enum gn_role role);
/* How an access is ordered against a later one, given what the host knew when that was submitted. */
enum gn_order gn_sync_order(const struct gn_device *device, const struct gn_touch *first, const struct gn_touch *second,
                            const struct gn_clock *host);
/* Enters an access, telling of every earlier one that it conflicts with. */
void gn_sync_touch(struct gn_device *device, const struct gn_touch *touch, const struct gn_clock *host,
                   void (*conflict)(void *context, const struct gn_conflict *conflict), void *context);
/* A barrier that `queue` executes at `position`. */
void gn_sync_barrier(struct gn_device *device, uint32_t queue, uint64_t position, const struct gn_barrier *barrier);
/* From `position` on, `stages` of `queue` wait for what the clock has seen. */
void gn_sync_wait(struct gn_device *device, uint32_t queue, uint64_t position, const struct gn_clock *clock,
                  VkPipelineStageFlags2 stages);
void gn_sync_finish(struct gn_device *device);
/* Everything that was submitted so far. */
struct gn_clock gn_clock_all(const struct gn_device *device);
void gn_clock_join(struct gn_clock *clock, const struct gn_clock *other);

/* order.c; with the device locked. */
struct gn_accesses *gn_accesses_of(struct gn_device *device, const char *command, struct gn_as *read, enum gn_role read_role,
                                   struct gn_as *written, enum gn_role written_role);
struct gn_accesses *gn_accesses_of_build(struct gn_device *device, const char *command,
                                         const VkAccelerationStructureBuildGeometryInfoKHR *info,
                                         const VkAccelerationStructureBuildRangeInfoKHR *ranges, struct gn_as *target,
                                         struct gn_as *source);
/* Records accesses that belong to no structure. */
void gn_command_buffer_access(struct gn_device *device, struct gn_command_buffer *commands, const char *command,
                              const struct gn_access *list, uint32_t count);
const char *gn_event_command(const struct gn_event *event);

/* The stages and accesses that flags of either generation stand for, in a source or a destination scope. */
VkPipelineStageFlags2 gn_stages_from(VkPipelineStageFlags2 stages);
VkPipelineStageFlags2 gn_stages_to(VkPipelineStageFlags2 stages);
VkAccessFlags2 gn_accesses_all(VkAccessFlags2 accesses);

#endif
