/* SPDX-License-Identifier: Apache-2.0 */
/* One submission while it is replayed (replay.c), by submit.c. With the device locked. */
#ifndef GN_LAYER_REPLAY_H
#define GN_LAYER_REPLAY_H

#include "layer/sync.h"

struct gn_replay {
    struct gn_device *device;
    struct gn_queue *queue;
    struct gn_submission *submission; /* made when something first needs it */
    uint64_t number, first_position;
    struct gn_clock host; /* what the host knew to be over when it submitted */
    VkCommandBuffer command_buffer;
    struct gn_findings *findings;
    bool touched;
};

/* NULL without memory. */
struct gn_submission *gn_replay_submission(struct gn_replay *replay);
void gn_replay_recording(struct gn_replay *replay, struct gn_recording *recording, unsigned depth);
/* Judges a command on structures and what was wrong with it as it was recorded, and lets it have its effect. */
void gn_replay_execute(struct gn_replay *replay, struct gn_event *event, uint64_t position);
/* submit.c: reports what the host has executed, for that is over. */
void gn_replay_confirm(struct gn_replay *replay);
/* Judges a command, and keeps what is found until the submission has completed. With `by_state`, the finding is about the state of the
 * event's structures, and dropped if that turns out not to be known. */
void gn_replay_suspect(struct gn_replay *replay, const struct gn_event *event, struct gn_suspect *suspect, bool by_state,
                       uint64_t position);
void gn_pending_use_settle(struct gn_device *device, struct gn_pending_use *use, bool completed, struct gn_findings *findings);

/* order.c: enters the accesses and barriers of an event. */
void gn_replay_order(struct gn_replay *replay, const struct gn_event *event, uint64_t position);
/* A trace through a TLAS. */
void gn_replay_trace(struct gn_replay *replay, const struct gn_event *event, struct gn_as *tlas, VkShaderStageFlags stages,
                     bool certain, uint64_t position);

#endif
