/* SPDX-License-Identifier: Apache-2.0 */
/* Replay: what a submission does to structures, event by event, in the order of execution; and what the rules are asked on the way. */
#include "layer/replay.h"
#include "layer/sbt.h"
#include "layer/shader.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_NESTING 16

static void judge_use(const void *value, struct gn_report *report)
{
    gn_rules_judge_use(value, report);
}

static const char *pending_place(void *context)
{
    return ((struct gn_pending_use *)context)->place;
}

/* By now it is known what the TLAS was built from, if it ever will be. */
void gn_pending_use_settle(struct gn_device *device, struct gn_pending_use *use, bool completed, struct gn_findings *findings)
{
    struct gn_trouble troubles[GN_TROUBLE_KINDS];
    int count = completed && !atomic_load_explicit(&device->incomplete, memory_order_relaxed)
                    ? gn_use_troubles(device, use->tlas, use->version, use->queue, use->position, &use->seen, use->certain, troubles)
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


struct gn_submission *gn_replay_submission(struct gn_replay *replay)
{
    struct gn_submission *submission = replay->submission;
    if (!submission && (submission = replay->submission = calloc(1, sizeof *submission))) {
        submission->host = replay->host;
        submission->number = replay->number;
        submission->first_position = replay->first_position;
        submission->last = &submission->judgements;
        submission->last_suspicion = &submission->suspicions;
        submission->last_use = &submission->uses;
    }
    return submission;
}

static void expect_judgement(struct gn_replay *replay, struct gn_recording *recording, uint32_t index, struct gn_capture *capture,
                             uint64_t position)
{
    const struct gn_event *event = &recording->events[index];
    struct gn_device *device = replay->device;
    struct gn_judgement *judgement = NULL;
    /* The target has been written by now. */
    struct gn_as *source = event->is_update ? event->source : NULL;
    uint64_t source_version = source ? source->writes - (source == event->target) : 0;
    if (source && !gn_as_sure(source, replay->queue->id, position, &replay->queue->clock))
        source = NULL;
    if (capture->pending)
        settle_early(device, recording, capture, replay->findings);
    if (!gn_replay_submission(replay))
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
                                       .version = event->target ? event->target->writes : 0,
                                       .host = replay->host,
                                       .seen = replay->queue->clock,
                                       .source = gn_as_keep(source),
                                       .source_version = source_version,
                                       .may_update = event->is_update || !event->shape ||
                                                     (event->shape->shape.flags & GN_BUILD_ALLOW_UPDATE)};
    if (event->target)
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

static struct gn_contents contents_of(const struct gn_as *as, const struct gn_queue *queue, uint64_t position)
{
    if (!as)
        return (struct gn_contents){.structure.object.kind = GN_OBJECT_NONE};
    return (struct gn_contents){.structure = {.object = {as->kind, (uint64_t)as->handle, as->name},
                                              .id = as->id,
                                              .address = as->address,
                                              .built = gn_as_built(as, queue->id, position, &queue->clock)},
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
    const struct gn_replay *replay;
    const struct gn_event *event;
    char text[768];
};

const char *gn_event_command(const struct gn_event *event)
{
    static const char *const names[] = {
        [GN_EVENT_BUILD] = "vkCmdBuildAccelerationStructuresKHR",
        [GN_EVENT_UPDATE] = "vkCmdBuildAccelerationStructuresKHR",
        [GN_EVENT_INDIRECT_BUILD] = "vkCmdBuildAccelerationStructuresIndirectKHR",
        [GN_EVENT_COPY] = "vkCmdCopyAccelerationStructureKHR",
        [GN_EVENT_COMPACT] = "vkCmdCopyAccelerationStructureKHR",
        [GN_EVENT_SERIALIZE] = "vkCmdCopyAccelerationStructureToMemoryKHR",
        [GN_EVENT_QUERY_COMPACTED] = "vkCmdWriteAccelerationStructuresPropertiesKHR",
        [GN_EVENT_QUERY] = "vkCmdWriteAccelerationStructuresPropertiesKHR",
        [GN_EVENT_TRACE] = "vkCmdTraceRaysKHR",
    };
    if (event->kind == GN_EVENT_TRACE && event->capture)
        return event->capture->sbt->command;
    return event->use ? event->use->command : event->accesses ? event->accesses->command : names[event->kind];
}

static const char *place_text(void *context)
{
    struct place *place = context;
    const struct gn_replay *replay = place->replay;
    const struct gn_command_buffer *commands = gn_command_buffer_get(replay->device, replay->command_buffer);
    char commands_text[256], queue_text[256];
    struct gn_object commands_object = {GN_OBJECT_COMMAND_BUFFER, (uint64_t)(uintptr_t)replay->command_buffer,
                                        commands ? commands->name : NULL};
    struct gn_object queue_object = {GN_OBJECT_QUEUE, (uint64_t)(uintptr_t)replay->queue->handle, replay->queue->name};
    if (replay->queue->id == GN_QUEUE_HOST) {
        snprintf(place->text, sizeof place->text, "%s on the host", gn_event_command(place->event));
        return place->text;
    }
    snprintf(place->text, sizeof place->text, "%s of %s in queue submission %llu (%s)", gn_event_command(place->event),
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
void gn_replay_suspect(struct gn_replay *replay, const struct gn_event *event, struct gn_suspect *suspect, bool by_state,
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
        struct gn_submission *submission = gn_replay_submission(replay);
        struct gn_suspicion *suspicion = submission ? calloc(1, sizeof *suspicion) : NULL;
        if (!suspicion) {
            free(finding);
            gn_tally_lost(device);
            continue;
        }
        *suspicion = (struct gn_suspicion){.finding = finding, .queue = replay->queue->id, .position = position,
                                           .seen = replay->queue->clock};
        if (by_state) {
            suspicion->structures[0] = gn_as_keep(event->source);
            suspicion->structures[1] = gn_as_keep(event->target);
        }
        *submission->last_suspicion = suspicion;
        submission->last_suspicion = &suspicion->next;
    }
}

static void expect_use(struct gn_replay *replay, const struct gn_event *event, const struct gn_use_entry *entry, struct gn_as *tlas,
                       uint64_t position)
{
    struct gn_submission *submission = gn_replay_submission(replay);
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
                                   .certain = entry->certain,
                                   .seen = replay->queue->clock};
    memcpy(use->place, text, strlen(text) + 1);
    *submission->last_use = use;
    submission->last_use = &use->next;
}

static void suspect_command(struct gn_replay *replay, const struct gn_event *event, enum gn_command_kind kind, uint64_t position)
{
    struct gn_command command = {.kind = kind,
                                 .shape = event->shape ? &event->shape->shape : NULL,
                                 .source = contents_of(event->source, replay->queue, position),
                                 .target = contents_of(event->target, replay->queue, position)};
    gn_replay_suspect(replay, event, &(struct gn_suspect){.judge = judge_command, .value = &command, .place = &command.place}, true,
            position);
    gn_tally_check(replay->device, GN_CHECKED_commands, 1);
}

/* A name may have been given, or changed, since the recording. Returns the place to fill in. */
static const char **fault_prepare(struct gn_device *device, struct gn_fault *fault)
{
    if (fault->kind == GN_FAULT_CLASH) {
        fault->of.clash.first_target.name = fault->structures[0]->name;
        fault->of.clash.second_target.name = fault->structures[1]->name;
        return &fault->of.clash.place;
    }
    if (fault->kind == GN_FAULT_INPUT) {
        fault->of.input.target.name = fault->structures[0]->name;
        return &fault->of.input.place;
    }
    char **pipeline = fault->structures[0] || !device->shaders
                          ? NULL
                          : gn_pipeline_name(device, VK_OBJECT_TYPE_PIPELINE, fault->of.demand.target.handle);
    fault->of.demand.target.name = fault->structures[0] ? fault->structures[0]->name : pipeline ? *pipeline : NULL;
    return &fault->of.demand.place;
}

static void suspect_faults(struct gn_replay *replay, const struct gn_event *event, uint64_t position)
{
    for (struct gn_fault *fault = event->faults; fault; fault = fault->next) {
        const char **place = fault_prepare(replay->device, fault);
        gn_replay_suspect(replay, event, &(struct gn_suspect){.judge = judge_fault, .value = fault, .place = place}, false, position);
    }
}

static const char *given_place(void *context)
{
    return context;
}

void gn_fault_report(struct gn_device *device, struct gn_fault *fault, const char *place, struct gn_findings *out)
{
    struct gn_findings found;
    struct gn_pending_finding *finding;
    gn_findings_init(&found);
    gn_report_suspect(device->instance,
                      &(struct gn_suspect){.judge = judge_fault,
                                           .value = fault,
                                           .place = fault_prepare(device, fault),
                                           .make_place = given_place,
                                           .context = (void *)(uintptr_t)place},
                      &found);
    while ((finding = gn_findings_take(&found)))
        gn_report_confirm(device->instance, finding, out);
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
static void fill(const struct gn_event *event, const struct gn_queue *queue, uint64_t position)
{
    struct gn_as *target = event->target, *source = event->source;
    if (source && source != target && !gn_as_sure(source, queue->id, position, &queue->clock))
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
static void replay_read(struct gn_replay *replay, const struct gn_event *event, const struct gn_use_entry *entry, uint64_t position)
{
    struct gn_device *device = replay->device;
    uint32_t queue = replay->queue->id;
    struct gn_as *tlas = entry->set->slots[entry->slot];
    struct gn_trouble troubles[GN_TROUBLE_KINDS];
    int count = 0;
    if (!tlas || tlas->destroyed_at || device->builds_unseen)
        return;
    if (tlas->used_in == replay->number && tlas->used_version == tlas->writes && (tlas->used_certainly || !entry->certain))
        return;
    tlas->used_in = replay->number;
    tlas->used_version = tlas->writes;
    tlas->used_certainly = entry->certain;
    gn_replay_trace(replay, event, tlas, entry->stages, entry->certain, position);
    enum gn_built built = gn_as_built(tlas, queue, position, &replay->queue->clock);
    if (built == GN_BUILT_NEVER) {
        troubles[count++] = (struct gn_trouble){.kind = GN_TROUBLE_NEVER_BUILT,
                                                .certain = entry->certain,
                                                .tlas = {tlas->kind, (uint64_t)tlas->handle, tlas->name},
                                                .tlas_id = tlas->id};
    } else if (tlas->judging) {
        expect_use(replay, event, entry, tlas, position);
        return;
    } else {
        count = gn_use_troubles(device, tlas, tlas->writes, queue, position, &replay->queue->clock, entry->certain, troubles);
    }
    if (count < 0)
        gn_tally_unjudged(device, GN_UNJUDGED_unknown_contents, 1);
    else
        gn_tally_check(device, GN_CHECKED_uses, 1);
    for (int i = 0; i < count; i++) {
        struct gn_event by = {.kind = GN_EVENT_USE, .use = event->use, .source = tlas};
        gn_replay_suspect(replay, &by, &(struct gn_suspect){.judge = judge_use, .value = &troubles[i], .place = &troubles[i].place},
                troubles[i].kind == GN_TROUBLE_NEVER_BUILT, position);
    }
}

static void replay_use(struct gn_replay *replay, const struct gn_event *event, uint64_t position)
{
    for (uint32_t i = 0; i < event->use->count; i++)
        replay_read(replay, event, &event->use->entries[i], position);
}

void gn_replay_execute(struct gn_replay *replay, struct gn_event *event, uint64_t position)
{
    struct gn_device *device = replay->device;
    struct gn_as *target = event->target;
    enum gn_command_kind kind = command_of(event);
    if (device->builds_unseen && kind != GN_COMMAND_KIND_COUNT)
        gn_tally_unjudged(device, GN_UNJUDGED_cluster_commands, 1);
    else if (device->instance->judged_commands >> kind & 1)
        suspect_command(replay, event, kind, position);
    suspect_faults(replay, event, position);
    if (event->kind == GN_EVENT_QUERY_COMPACTED && event->source)
        gn_query_asked(event->pool, event->query, event->source);
    if (!target)
        return;
    if (target->kind == GN_OBJECT_STRUCTURE)
        target->kind = event->is_tlas                                      ? GN_OBJECT_TLAS
                       : event->kind == GN_EVENT_COPY && event->source     ? event->source->kind
                       : event->kind == GN_EVENT_COMPACT && event->source  ? event->source->kind
                       : event->kind == GN_EVENT_DESERIALIZE               ? GN_OBJECT_STRUCTURE
                                                                           : GN_OBJECT_BLAS;
    gn_as_level(target, event_levels(event));
    target->last_writes[target->writes % 4] =
        (struct gn_write){.position = position,
                          .submission = replay->number,
                          .queue = replay->queue->id,
                          .role = kind == GN_COMMAND_CLONE || kind == GN_COMMAND_COMPACT || event->kind == GN_EVENT_DESERIALIZE
                                      ? GN_ROLE_COPY_TARGET
                                      : GN_ROLE_BUILD_TARGET,
                          .command = gn_event_command(event),
                          .command_buffer = replay->command_buffer};
    gn_as_written(device, target, replay->queue->id, position);
    fill(event, replay->queue, position);
    gn_positions_written(device, target);
    gn_tally_check(device, GN_CHECKED_builds, 1);
}

void gn_replay_recording(struct gn_replay *replay, struct gn_recording *recording, unsigned depth)
{
    struct gn_device *device = replay->device;
    uint32_t command = 0;
    uint64_t position = 0;
    if (recording->launches)
        gn_launch_executed(device, replay->queue->id);
    for (uint32_t i = 0; i < recording->count; i++) {
        struct gn_event *event = &recording->events[i];
        if (event->secondary) {
            if (depth < MAX_NESTING)
                gn_replay_recording(replay, event->secondary, depth + 1);
            continue;
        }
        if (event->command != command) {
            command = event->command;
            position = ++device->position;
        }
        if (event->accesses || event->barriers)
            gn_replay_order(replay, event, position);
        if (event->kind == GN_EVENT_BARRIER || event->kind == GN_EVENT_ACCESS)
            continue;
        replay->touched = true;
        if (event->use) {
            replay_use(replay, event, position);
            continue;
        }
        gn_replay_execute(replay, event, position);
        if (event->kind == GN_EVENT_TRACE && event->capture) {
            if (event->capture->pending)
                settle_early(device, recording, event->capture, replay->findings);
            gn_sbt_executed(device, event->capture->sbt);
            expect_judgement(replay, recording, i, event->capture, position);
        }
        if (!event->target)
            continue;
        if (!event->is_tlas) {
            for (struct gn_capture *capture = event->capture; capture; capture = capture->next)
                expect_judgement(replay, recording, i, capture, position);
            if (event->unjudged != GN_UNJUDGED_COUNT)
                gn_tally_unjudged(device, event->unjudged, 1);
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

