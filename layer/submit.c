/* SPDX-License-Identifier: Apache-2.0 */
/* Submission: recordings are replayed in the order of submission, TLAS builds wait for the completion of what they are
 * part of, and are then judged. Completion is seen through the application's fence, or one of the layer's where it gave
 * none; nothing is submitted in addition. */
#include "layer/shader.h"
#include "layer/use.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_NESTING 16

/* A lost device answers waits at once; a device that hangs at its end is not waited for any longer. */
#define LAST_WAIT_NANOSECONDS UINT64_C(1000000000)

struct gn_queue *gn_queue_get(struct gn_device *device, VkQueue handle)
{
    struct gn_queue *queue = gn_map_get(&device->queues, (uint64_t)(uintptr_t)handle);
    if (queue || !(queue = calloc(1, sizeof *queue)))
        return queue;
    queue->handle = handle;
    queue->id = GN_QUEUE_HOST + 1 + device->queue_count;
    queue->newest = &queue->oldest;
    if (!gn_map_put(&device->queues, (uint64_t)(uintptr_t)handle, queue)) {
        free(queue);
        return NULL;
    }
    device->queue_count++;
    queue->next = device->first_queue;
    device->first_queue = queue;
    return queue;
}

static VkFence take_fence(struct gn_device *device)
{
    VkFence fence = VK_NULL_HANDLE;
    for (uint32_t i = 0; i < device->fence_count; i++)
        if (device->next.GetFenceStatus(device->handle, device->fences[i]) == VK_SUCCESS) {
            fence = device->fences[i];
            device->fences[i] = device->fences[--device->fence_count];
            if (device->next.ResetFences(device->handle, 1, &fence) == VK_SUCCESS)
                return fence;
            device->next.DestroyFence(device->handle, fence, NULL);
            break;
        }
    VkFenceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    return device->next.CreateFence(device->handle, &info, NULL, &fence) == VK_SUCCESS ? fence : VK_NULL_HANDLE;
}

/* The fence may still be about to signal: it is used again only once it has. */
static void give_fence(struct gn_device *device, VkFence fence)
{
    if (device->fence_count == device->fence_capacity) {
        uint32_t capacity = device->fence_capacity ? device->fence_capacity * 2 : 8;
        VkFence *grown = realloc(device->fences, capacity * sizeof *grown);
        if (!grown)
            return; /* it lives as long as the device */
        device->fences = grown;
        device->fence_capacity = capacity;
    }
    device->fences[device->fence_count++] = fence;
}

static void judgement_free(struct gn_device *device, struct gn_judgement *judgement)
{
    if (judgement->capture)
        atomic_fetch_sub(&device->instance->open_judgements, 1);
    if (judgement->capture && judgement->capture->pending == judgement)
        judgement->capture->pending = NULL;
    gn_recording_release(device, judgement->recording);
    judgement->tlas->judging--;
    gn_as_release(judgement->tlas);
    free(judgement);
}

static void judge_use(const void *value, struct gn_report *report)
{
    gn_rules_judge_use(value, report);
}

static const char *pending_place(void *context)
{
    return ((struct gn_pending_use *)context)->place;
}

/* By now it is known what the TLAS was built from, if it ever will be. */
static void use_settle(struct gn_device *device, struct gn_pending_use *use, bool completed, struct gn_findings *findings)
{
    struct gn_trouble troubles[GN_TROUBLE_KINDS];
    int count = completed && !atomic_load_explicit(&device->incomplete, memory_order_relaxed)
                    ? gn_use_troubles(device, use->tlas, use->version, use->queue, use->position, use->certain, troubles)
                    : -1;
    if (count < 0)
        gn_tally_unjudged(device, GN_UNJUDGED_unknown_contents, 1);
    else
        gn_tally_check(device, GN_CHECKED_uses, 1);
    for (int i = 0; i < count; i++) {
        struct gn_findings found;
        struct gn_pending_finding *finding;
        gn_findings_init(&found);
        gn_report_suspect(device->instance,
                          &(struct gn_suspect){.judge = judge_use,
                                               .value = &troubles[i],
                                               .place = &troubles[i].place,
                                               .make_place = pending_place,
                                               .context = use},
                          &found);
        while ((finding = gn_findings_take(&found)))
            gn_report_confirm(device->instance, finding, findings);
    }
    gn_as_release(use->tlas);
    free(use);
}

static void suspicion_settle(struct gn_device *device, struct gn_suspicion *suspicion, bool completed,
                             struct gn_findings *findings)
{
    bool sure = completed && !atomic_load_explicit(&device->incomplete, memory_order_relaxed);
    for (int i = 0; i < 2; i++) {
        struct gn_as *as = suspicion->structures[i];
        sure &= !as || gn_as_sure(as, suspicion->queue, suspicion->position);
        gn_as_release(as);
    }
    if (sure) {
        gn_report_confirm(device->instance, suspicion->finding, findings);
    } else {
        gn_tally_unjudged(device, GN_UNJUDGED_unproven, 1);
        free(suspicion->finding);
    }
    free(suspicion);
}

/* `readable`: the copies of this submission are complete. */
static void settle(struct gn_device *device, struct gn_submission *submission, bool readable, struct gn_findings *findings)
{
    struct gn_pending_use *use = submission->uses;
    for (struct gn_judgement *judgement = submission->judgements, *next; judgement; judgement = next) {
        next = judgement->next;
        for (struct gn_pending_use *after; use && use->position < judgement->position; use = after) {
            after = use->next;
            use_settle(device, use, readable, findings);
        }
        if (judgement->capture && readable)
            gn_judge_capture(device, judgement, findings);
        else if (judgement->capture)
            gn_tally_unjudged(device, GN_UNJUDGED_not_completed, 1);
        judgement_free(device, judgement);
    }
    for (struct gn_pending_use *after; use; use = after) {
        after = use->next;
        use_settle(device, use, readable, findings);
    }
    for (struct gn_suspicion *suspicion = submission->suspicions, *next; suspicion; suspicion = next) {
        next = suspicion->next;
        suspicion_settle(device, suspicion, readable, findings);
    }
    if (submission->owned && submission->fence)
        give_fence(device, submission->fence);
    free(submission);
    atomic_fetch_sub(&device->pending, 1);
}

/* An execution that is about to be repeated while its judgement is still open: if the commands may not be in use twice at once, the
 * first execution is over; if they may, its copy can be overwritten at any time. */
static void settle_early(struct gn_device *device, const struct gn_recording *recording, struct gn_capture *capture,
                         struct gn_findings *findings)
{
    struct gn_judgement *judgement = capture->pending;
    if (!recording->simultaneous)
        gn_judge_capture(device, judgement, findings);
    else
        gn_tally_unjudged(device, GN_UNJUDGED_overwritten, 1);
    judgement->capture = NULL;
    capture->pending = NULL;
    atomic_fetch_sub(&device->instance->open_judgements, 1);
}

struct replay {
    struct gn_device *device;
    struct gn_queue *queue;
    struct gn_submission *submission; /* made when the first judgement needs it */
    uint64_t number, first_position;
    VkCommandBuffer command_buffer;
    struct gn_findings *findings;
    bool touched;
};

static struct gn_submission *submission_of(struct replay *replay)
{
    struct gn_submission *submission = replay->submission;
    if (!submission && (submission = replay->submission = calloc(1, sizeof *submission))) {
        submission->number = replay->number;
        submission->first_position = replay->first_position;
        submission->last = &submission->judgements;
        submission->last_suspicion = &submission->suspicions;
        submission->last_use = &submission->uses;
    }
    return submission;
}

static void expect_judgement(struct replay *replay, struct gn_recording *recording, uint32_t index, struct gn_capture *capture,
                             uint64_t position)
{
    const struct gn_event *event = &recording->events[index];
    struct gn_device *device = replay->device;
    struct gn_judgement *judgement = NULL;
    if (capture->pending)
        settle_early(device, recording, capture, replay->findings);
    if (!submission_of(replay))
        goto fail;
    judgement = calloc(1, sizeof *judgement);
    if (!judgement)
        goto fail;
    *judgement = (struct gn_judgement){.recording = gn_recording_keep(recording),
                                       .capture = capture,
                                       .tlas = gn_as_keep(event->target),
                                       .event = index,
                                       .command_buffer = replay->command_buffer,
                                       .queue = replay->queue->id,
                                       .position = position,
                                       .submission = replay->number,
                                       .version = event->target->writes};
    event->target->judging++;
    capture->pending = judgement;
    atomic_fetch_add(&device->instance->open_judgements, 1);
    *replay->submission->last = judgement;
    replay->submission->last = &judgement->next;
    return;
fail:
    gn_tally_lost(device);
}

/* A copy has the level of its source, and of serialized data the layer does not know it. */
static unsigned event_levels(const struct gn_event *event)
{
    switch (event->kind) {
    case GN_EVENT_COPY:
    case GN_EVENT_COMPACT:
        return event->source && event->source->levels ? event->source->levels : GN_LEVEL_BOTTOM | GN_LEVEL_TOP;
    case GN_EVENT_DESERIALIZE:
        return GN_LEVEL_BOTTOM | GN_LEVEL_TOP;
    default:
        return event->is_tlas ? GN_LEVEL_TOP : GN_LEVEL_BOTTOM;
    }
}

static enum gn_command_kind command_of(const struct gn_event *event)
{
    switch (event->kind) {
    case GN_EVENT_BUILD:
    case GN_EVENT_UPDATE:
    case GN_EVENT_INDIRECT_BUILD:
        return event->is_update ? GN_COMMAND_UPDATE : GN_COMMAND_BUILD;
    case GN_EVENT_COPY:
        return GN_COMMAND_CLONE;
    case GN_EVENT_COMPACT:
        return GN_COMMAND_COMPACT;
    case GN_EVENT_SERIALIZE:
        return GN_COMMAND_SERIALIZE;
    case GN_EVENT_QUERY_COMPACTED:
        return GN_COMMAND_ASK_COMPACTED_SIZE;
    case GN_EVENT_QUERY:
        return GN_COMMAND_ASK_OTHER;
    default:
        return GN_COMMAND_KIND_COUNT;
    }
}

static struct gn_contents contents_of(const struct gn_as *as, uint32_t queue, uint64_t position)
{
    if (!as)
        return (struct gn_contents){.structure.object.kind = GN_OBJECT_NONE};
    return (struct gn_contents){.structure = {.object = {as->kind, (uint64_t)as->handle, as->name},
                                              .id = as->id,
                                              .address = as->address,
                                              .built = gn_as_built(as, queue, position)},
                                .made = as->made,
                                .compacted = as->compacted,
                                .shape = as->shape ? &as->shape->shape : NULL,
                                .generation = as->generation,
                                .size = as->size,
                                .compacted_size = as->compacted_size,
                                .compacted_size_of = as->compacted_size_of,
                                .size_asked_of = as->size_asked_of};
}

/* Where the event that is being replayed stands. */
struct place {
    const struct replay *replay;
    const struct gn_event *event;
    char text[768];
};

static const char *place_text(void *context)
{
    struct place *place = context;
    static const char *const names[] = {
        [GN_EVENT_BUILD] = "vkCmdBuildAccelerationStructuresKHR",
        [GN_EVENT_UPDATE] = "vkCmdBuildAccelerationStructuresKHR",
        [GN_EVENT_INDIRECT_BUILD] = "vkCmdBuildAccelerationStructuresIndirectKHR",
        [GN_EVENT_COPY] = "vkCmdCopyAccelerationStructureKHR",
        [GN_EVENT_COMPACT] = "vkCmdCopyAccelerationStructureKHR",
        [GN_EVENT_SERIALIZE] = "vkCmdCopyAccelerationStructureToMemoryKHR",
        [GN_EVENT_QUERY_COMPACTED] = "vkCmdWriteAccelerationStructuresPropertiesKHR",
        [GN_EVENT_QUERY] = "vkCmdWriteAccelerationStructuresPropertiesKHR",
    };
    const struct replay *replay = place->replay;
    const struct gn_command_buffer *commands = gn_command_buffer_get(replay->device, replay->command_buffer);
    char commands_text[256], queue_text[256];
    struct gn_object commands_object = {GN_OBJECT_COMMAND_BUFFER, (uint64_t)(uintptr_t)replay->command_buffer,
                                        commands ? commands->name : NULL};
    struct gn_object queue_object = {GN_OBJECT_QUEUE, (uint64_t)(uintptr_t)replay->queue->handle, replay->queue->name};
    snprintf(place->text, sizeof place->text, "%s of %s in queue submission %llu (%s)",
             place->event->use ? place->event->use->command : names[place->event->kind],
             gn_object_describe(&commands_object, commands_text, sizeof commands_text),
             (unsigned long long)replay->number, gn_object_describe(&queue_object, queue_text, sizeof queue_text));
    return place->text;
}

static void judge_command(const void *value, struct gn_report *report)
{
    gn_rules_judge_command(value, report);
}

static void judge_fault(const void *value, struct gn_report *report)
{
    const struct gn_fault *fault = value;
    if (fault->kind == GN_FAULT_CLASH)
        gn_rules_judge_clash(&fault->of.clash, report);
    else if (fault->kind == GN_FAULT_DEMAND)
        gn_rules_judge_demand(&fault->of.demand, report);
    else
        gn_rules_judge_input(&fault->of.input, report);
}

/* Judges, and keeps what is found until the submission has completed. */
static void suspect(struct replay *replay, const struct gn_event *event, struct gn_suspect *suspect, bool by_state,
                    uint64_t position)
{
    struct gn_device *device = replay->device;
    struct place place = {.replay = replay, .event = event};
    struct gn_findings suspicions;
    struct gn_pending_finding *finding;
    suspect->make_place = place_text;
    suspect->context = &place;
    gn_findings_init(&suspicions);
    gn_report_suspect(device->instance, suspect, &suspicions);
    while ((finding = gn_findings_take(&suspicions))) {
        struct gn_submission *submission = submission_of(replay);
        struct gn_suspicion *suspicion = submission ? calloc(1, sizeof *suspicion) : NULL;
        if (!suspicion) {
            free(finding);
            gn_tally_lost(device);
            continue;
        }
        *suspicion = (struct gn_suspicion){.finding = finding, .queue = replay->queue->id, .position = position};
        if (by_state) {
            suspicion->structures[0] = gn_as_keep(event->source);
            suspicion->structures[1] = gn_as_keep(event->target);
        }
        *submission->last_suspicion = suspicion;
        submission->last_suspicion = &suspicion->next;
    }
}

static void expect_use(struct replay *replay, const struct gn_event *event, const struct gn_use_entry *entry, struct gn_as *tlas,
                       uint64_t position)
{
    struct gn_submission *submission = submission_of(replay);
    struct place place = {.replay = replay, .event = event};
    const char *text = place_text(&place);
    struct gn_pending_use *use = submission ? malloc(sizeof *use + strlen(text) + 1) : NULL;
    if (!use) {
        gn_tally_lost(replay->device);
        return;
    }
    *use = (struct gn_pending_use){.tlas = gn_as_keep(tlas),
                                   .version = tlas->writes,
                                   .position = position,
                                   .queue = replay->queue->id,
                                   .certain = entry->certain};
    memcpy(use->place, text, strlen(text) + 1);
    *submission->last_use = use;
    submission->last_use = &use->next;
}

static void suspect_command(struct replay *replay, const struct gn_event *event, enum gn_command_kind kind, uint64_t position)
{
    uint32_t queue = replay->queue->id;
    struct gn_command command = {.kind = kind,
                                 .shape = event->shape ? &event->shape->shape : NULL,
                                 .source = contents_of(event->source, queue, position),
                                 .target = contents_of(event->target, queue, position)};
    suspect(replay, event, &(struct gn_suspect){.judge = judge_command, .value = &command, .place = &command.place}, true,
            position);
    gn_tally_check(replay->device, GN_CHECKED_commands, 1);
}

static void suspect_faults(struct replay *replay, const struct gn_event *event, uint64_t position)
{
    for (struct gn_fault *fault = event->faults; fault; fault = fault->next) {
        const char **place = fault->kind == GN_FAULT_CLASH    ? &fault->of.clash.place
                             : fault->kind == GN_FAULT_DEMAND ? &fault->of.demand.place
                                                              : &fault->of.input.place;
        /* A name may have been given, or changed, since the recording. */
        if (fault->kind == GN_FAULT_CLASH) {
            fault->of.clash.first_target.name = fault->structures[0]->name;
            fault->of.clash.second_target.name = fault->structures[1]->name;
        } else if (fault->kind == GN_FAULT_DEMAND) {
            fault->of.demand.target.name = fault->structures[0] ? fault->structures[0]->name : NULL;
        } else {
            fault->of.input.target.name = fault->structures[0]->name;
        }
        suspect(replay, event, &(struct gn_suspect){.judge = judge_fault, .value = fault, .place = place}, false, position);
    }
}

/* So that a finding about the source can say where its contents went. */
static void moved(struct gn_as *source, const struct gn_as *target)
{
    char text[256];
    if (!source || source == target)
        return;
    struct gn_object object = {target->kind, (uint64_t)target->handle, target->name};
    free(source->moved_to);
    source->moved_to = strdup(gn_object_describe(&object, text, sizeof text));
}

/* What the target holds once the event has been executed. A source that another queue may have changed says nothing. */
static void fill(const struct gn_event *event, uint32_t queue, uint64_t position)
{
    struct gn_as *target = event->target, *source = event->source;
    if (source && source != target && !gn_as_sure(source, queue, position))
        source = NULL;
    switch (event->kind) {
    case GN_EVENT_BUILD:
    case GN_EVENT_UPDATE:
    case GN_EVENT_INDIRECT_BUILD:
        if (!event->is_update)
            gn_as_holds(target, GN_MADE_BUILT, false, event->shape);
        else if (target == source)
            target->made = GN_MADE_UPDATED;
        else /* what an update must not change is that of the build which the source comes from */
            gn_as_holds(target, GN_MADE_UPDATED, source && source->compacted,
                        source && source->shape ? source->shape : event->shape);
        break;
    case GN_EVENT_COPY:
        moved(source, target);
        gn_as_holds(target, GN_MADE_CLONED, source && source->compacted, source ? source->shape : NULL);
        break;
    case GN_EVENT_COMPACT:
        moved(source, target);
        gn_as_holds(target, GN_MADE_COMPACTED, true, source ? source->shape : NULL);
        break;
    case GN_EVENT_DESERIALIZE:
        gn_as_holds(target, GN_MADE_DESERIALIZED, false, NULL);
        break;
    default:
        break;
    }
}

/* The TLAS is read as the last write before left it. What it was built from may not be known before the submission has completed. */
static void replay_read(struct replay *replay, const struct gn_event *event, const struct gn_use_entry *entry, uint64_t position)
{
    struct gn_device *device = replay->device;
    uint32_t queue = replay->queue->id;
    struct gn_as *tlas = entry->set->slots[entry->slot];
    struct gn_trouble troubles[GN_TROUBLE_KINDS];
    int count = 0;
    if (!tlas || tlas->destroyed_at)
        return;
    if (tlas->used_in == replay->number && tlas->used_version == tlas->writes && (tlas->used_certainly || !entry->certain))
        return;
    tlas->used_in = replay->number;
    tlas->used_version = tlas->writes;
    tlas->used_certainly = entry->certain;
    enum gn_built built = gn_as_built(tlas, queue, position);
    if (built == GN_BUILT_NEVER) {
        troubles[count++] = (struct gn_trouble){.kind = GN_TROUBLE_NEVER_BUILT,
                                                .certain = entry->certain,
                                                .tlas = {tlas->kind, (uint64_t)tlas->handle, tlas->name},
                                                .tlas_id = tlas->id};
    } else if (tlas->judging) {
        expect_use(replay, event, entry, tlas, position);
        return;
    } else {
        count = gn_use_troubles(device, tlas, tlas->writes, queue, position, entry->certain, troubles);
    }
    if (count < 0)
        gn_tally_unjudged(device, GN_UNJUDGED_unknown_contents, 1);
    else
        gn_tally_check(device, GN_CHECKED_uses, 1);
    for (int i = 0; i < count; i++) {
        struct gn_event by = {.kind = GN_EVENT_USE, .use = event->use, .source = tlas};
        suspect(replay, &by, &(struct gn_suspect){.judge = judge_use, .value = &troubles[i], .place = &troubles[i].place},
                troubles[i].kind == GN_TROUBLE_NEVER_BUILT, position);
    }
}

static void replay_use(struct replay *replay, const struct gn_event *event, uint64_t position)
{
    for (uint32_t i = 0; i < event->use->count; i++)
        replay_read(replay, event, &event->use->entries[i], position);
}

static void replay_recording(struct replay *replay, struct gn_recording *recording, unsigned depth)
{
    struct gn_device *device = replay->device;
    uint32_t command = 0;
    uint64_t position = 0;
    for (uint32_t i = 0; i < recording->count; i++) {
        struct gn_event *event = &recording->events[i];
        if (event->secondary) {
            if (depth < MAX_NESTING)
                replay_recording(replay, event->secondary, depth + 1);
            continue;
        }
        if (event->command != command) {
            command = event->command;
            position = ++device->position;
        }
        replay->touched = true;
        if (event->use) {
            replay_use(replay, event, position);
            continue;
        }
        enum gn_command_kind kind = command_of(event);
        if (device->builds_unseen && kind != GN_COMMAND_KIND_COUNT)
            gn_tally_unjudged(device, GN_UNJUDGED_cluster_commands, 1);
        else if (device->instance->judged_commands >> kind & 1)
            suspect_command(replay, event, kind, position);
        suspect_faults(replay, event, position);
        if (event->kind == GN_EVENT_QUERY_COMPACTED && event->source)
            gn_query_asked(event->pool, event->query, event->source);
        if (!event->target)
            continue;
        if (event->target->kind == GN_OBJECT_STRUCTURE)
            event->target->kind = event->is_tlas                                            ? GN_OBJECT_TLAS
                                  : event->kind == GN_EVENT_COPY && event->source           ? event->source->kind
                                  : event->kind == GN_EVENT_COMPACT && event->source        ? event->source->kind
                                  : event->kind == GN_EVENT_DESERIALIZE                     ? GN_OBJECT_STRUCTURE
                                                                                            : GN_OBJECT_BLAS;
        gn_as_level(event->target, event_levels(event));
        gn_as_written(device, event->target, replay->queue->id, position);
        fill(event, replay->queue->id, position);
        gn_tally_check(device, GN_CHECKED_builds, 1);
        if (!event->is_tlas) {
            for (struct gn_capture *capture = event->capture; capture; capture = capture->next)
                expect_judgement(replay, recording, i, capture, position);
            continue;
        }
        if (event->unjudged != GN_UNJUDGED_COUNT)
            gn_tally_unjudged(device, event->unjudged, 1);
        else if (event->capture)
            expect_judgement(replay, recording, i, event->capture, position);
        else
            gn_tally_check(device, GN_CHECKED_tlas_builds, 1);
    }
}

static void replay_begin(struct replay *replay, struct gn_device *device, VkQueue handle, struct gn_findings *findings)
{
    *replay = (struct replay){.device = device,
                              .queue = gn_queue_get(device, handle),
                              .number = ++device->submission_count,
                              .first_position = device->position + 1,
                              .findings = findings};
}

static void replay_commands(struct replay *replay, VkCommandBuffer handle)
{
    struct gn_command_buffer *commands = gn_command_buffer_get(replay->device, handle);
    if (!commands || !commands->recording || !replay->queue)
        return;
    replay->command_buffer = handle;
    replay_recording(replay, commands->recording, 0);
}

/* The submission is listed before the next layer sees it: from then on another thread may find its fence signalled. Returns the
 * fence to submit with. */
static VkFence replay_end(struct replay *replay, VkFence fence)
{
    struct gn_device *device = replay->device;
    struct gn_submission *submission = replay->submission;
    if (replay->touched)
        gn_tally_check(device, GN_CHECKED_submissions, 1);
    if (!submission)
        return fence;
    submission->owned = fence == VK_NULL_HANDLE;
    submission->fence = submission->owned ? take_fence(device) : fence;
    *replay->queue->newest = submission;
    replay->queue->newest = &submission->next;
    atomic_fetch_add(&device->pending, 1);
    return submission->fence;
}

static void replay_settle(struct replay *replay, VkResult result)
{
    struct gn_submission *submission = replay->submission;
    if (!submission)
        return;
    gn_lock(replay->device);
    submission->accepted = true;
    if (result != VK_SUCCESS) {
        struct gn_submission **link = &replay->queue->oldest;
        while (*link != submission)
            link = &(*link)->next;
        *link = submission->next;
        if (replay->queue->newest == &submission->next)
            replay->queue->newest = link;
        if (submission->owned && submission->fence)
            replay->device->next.DestroyFence(replay->device->handle, submission->fence, NULL);
        submission->fence = VK_NULL_HANDLE;
        settle(replay->device, submission, false, replay->findings);
    }
    gn_unlock(replay->device);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_QueueSubmit(VkQueue queue, uint32_t count, const VkSubmitInfo *submits,
                                                    VkFence fence)
{
    struct gn_device *device = gn_device_of(queue);
    struct gn_findings findings;
    struct replay replay;
    gn_findings_init(&findings);
    gn_device_collect(device);
    gn_lock(device);
    replay_begin(&replay, device, queue, &findings);
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t k = 0; k < submits[i].commandBufferCount; k++)
            replay_commands(&replay, submits[i].pCommandBuffers[k]);
    fence = replay_end(&replay, fence);
    gn_unlock(device);
    VkResult result = device->next.QueueSubmit(queue, count, submits, fence);
    replay_settle(&replay, result);
    gn_report_flush(device->instance, &findings);
    return result;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_QueueSubmit2(VkQueue queue, uint32_t count, const VkSubmitInfo2 *submits,
                                                     VkFence fence)
{
    struct gn_device *device = gn_device_of(queue);
    struct gn_findings findings;
    struct replay replay;
    gn_findings_init(&findings);
    gn_device_collect(device);
    gn_lock(device);
    replay_begin(&replay, device, queue, &findings);
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t k = 0; k < submits[i].commandBufferInfoCount; k++)
            replay_commands(&replay, submits[i].pCommandBufferInfos[k].commandBuffer);
    fence = replay_end(&replay, fence);
    gn_unlock(device);
    VkResult result = device->next.QueueSubmit2(queue, count, submits, fence);
    replay_settle(&replay, result);
    gn_report_flush(device->instance, &findings);
    return result;
}

/* A fence signals after everything submitted to its queue before it: one signalled fence completes all older submissions.
 * Returns whether anything came to its end. */
static bool advance(struct gn_device *device, struct gn_queue *queue, struct gn_findings *findings)
{
    struct gn_submission *last_done = NULL;
    bool lost = false;
    for (struct gn_submission *submission = queue->oldest; submission && submission->accepted;
         submission = submission->next) {
        if (!submission->done && submission->fence) {
            VkResult status = device->next.GetFenceStatus(device->handle, submission->fence);
            submission->done = status == VK_SUCCESS;
            lost |= status == VK_ERROR_DEVICE_LOST;
        }
        if (submission->done)
            last_done = submission;
    }
    bool any = last_done != NULL || lost;
    while (last_done || (lost && queue->oldest && queue->oldest->accepted)) {
        struct gn_submission *submission = queue->oldest;
        queue->oldest = submission->next;
        if (!queue->oldest)
            queue->newest = &queue->oldest;
        bool readable = last_done != NULL;
        if (submission == last_done)
            last_done = NULL;
        settle(device, submission, readable, findings);
    }
    return any;
}

void gn_device_collect(struct gn_device *device)
{
    struct gn_findings findings;
    gn_shaders_read(device, false, false);
    if (!atomic_load_explicit(&device->pending, memory_order_acquire))
        return;
    gn_findings_init(&findings);
    bool any = false;
    gn_lock(device);
    for (struct gn_queue *queue = device->first_queue; queue; queue = queue->next)
        any |= advance(device, queue, &findings);
    if (any)
        gn_as_purge(device);
    gn_unlock(device);
    gn_report_flush(device->instance, &findings);
}

static void mark_done(struct gn_queue *queue)
{
    for (struct gn_submission *submission = queue->oldest; submission; submission = submission->next)
        submission->done = true;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_QueueWaitIdle(VkQueue handle)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.QueueWaitIdle(handle);
    if (result == VK_SUCCESS && atomic_load(&device->pending)) {
        gn_lock(device);
        struct gn_queue *queue = gn_map_get(&device->queues, (uint64_t)(uintptr_t)handle);
        if (queue)
            mark_done(queue);
        gn_unlock(device);
    }
    gn_device_collect(device);
    return result;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_DeviceWaitIdle(VkDevice handle)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.DeviceWaitIdle(handle);
    if (result == VK_SUCCESS && atomic_load(&device->pending)) {
        gn_lock(device);
        for (struct gn_queue *queue = device->first_queue; queue; queue = queue->next)
            mark_done(queue);
        gn_unlock(device);
    }
    gn_device_collect(device);
    return result;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_WaitForFences(VkDevice handle, uint32_t count, const VkFence *fences,
                                                      VkBool32 all, uint64_t timeout)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.WaitForFences(handle, count, fences, all, timeout);
    gn_device_collect(device);
    return result;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_GetFenceStatus(VkDevice handle, VkFence fence)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.GetFenceStatus(handle, fence);
    gn_device_collect(device);
    return result;
}

/* A fence that the application resets or destroys is not in use: its submission has completed, and the layer does not touch the
 * fence any more. */
static void fences_leave(struct gn_device *device, uint32_t count, const VkFence *fences)
{
    if (!atomic_load(&device->pending))
        return;
    gn_device_collect(device);
    gn_lock(device);
    for (struct gn_queue *queue = device->first_queue; queue; queue = queue->next)
        for (struct gn_submission *submission = queue->oldest; submission; submission = submission->next)
            for (uint32_t i = 0; i < count; i++)
                if (!submission->owned && submission->fence == fences[i]) {
                    submission->fence = VK_NULL_HANDLE;
                    submission->done = true;
                }
    gn_unlock(device);
    gn_device_collect(device);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_ResetFences(VkDevice handle, uint32_t count, const VkFence *fences)
{
    struct gn_device *device = gn_device_of(handle);
    fences_leave(device, count, fences);
    return device->next.ResetFences(handle, count, fences);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyFence(VkDevice handle, VkFence fence, const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    if (fence)
        fences_leave(device, 1, &fence);
    device->next.DestroyFence(handle, fence, allocator);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_WaitSemaphores(VkDevice handle, const VkSemaphoreWaitInfo *info,
                                                       uint64_t timeout)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.WaitSemaphores(handle, info, timeout);
    gn_device_collect(device);
    return result;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_GetSemaphoreCounterValue(VkDevice handle, VkSemaphore semaphore, uint64_t *value)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.GetSemaphoreCounterValue(handle, semaphore, value);
    gn_device_collect(device);
    return result;
}

void gn_queues_finish(struct gn_device *device)
{
    struct gn_findings findings;
    gn_findings_init(&findings);
    gn_lock(device);
    for (struct gn_queue *queue = device->first_queue, *next; queue; queue = next) {
        next = queue->next;
        struct gn_submission *newest = NULL;
        for (struct gn_submission *submission = queue->oldest; submission; submission = submission->next)
            newest = submission;
        if (newest && newest->fence)
            device->next.WaitForFences(device->handle, 1, &newest->fence, VK_TRUE, LAST_WAIT_NANOSECONDS);
        advance(device, queue, &findings);
        while (queue->oldest) {
            struct gn_submission *submission = queue->oldest;
            queue->oldest = submission->next;
            settle(device, submission, false, &findings);
        }
        free(queue->name);
        free(queue);
    }
    device->first_queue = NULL;
    gn_map_finish(&device->queues);
    for (uint32_t i = 0; i < device->fence_count; i++)
        device->next.DestroyFence(device->handle, device->fences[i], NULL);
    free(device->fences);
    device->fences = NULL;
    device->fence_count = device->fence_capacity = 0;
    gn_unlock(device);
    gn_report_flush(device->instance, &findings);
}
