/* SPDX-License-Identifier: Apache-2.0 */
/* Accesses of recorded commands: which ranges they touch, and what the rules are told when two of them conflict. */
#include "layer/replay.h"

#include <stdio.h>
#include <stdlib.h>

static const struct {
    const char *what, *stages, *accesses;
} texts[] = {
#define GN_ROLE(name, what, writes, stages, accesses, stage_text, access_text) {what, stage_text, access_text},
#include "layer/sync.def"
};

static enum gn_hazard_kind kind_of(enum gn_role first, enum gn_role second)
{
    if (second == GN_ROLE_INSTANCE)
        return GN_HAZARD_INSTANCE;
    if (first == GN_ROLE_BINDING_TABLE || second == GN_ROLE_BINDING_TABLE)
        return GN_HAZARD_BINDING_TABLE;
    if (second == GN_ROLE_TRACE_RAYS || second == GN_ROLE_TRACE_COMPUTE || second == GN_ROLE_TRACE_GRAPHICS)
        return GN_HAZARD_TRACE;
    if (first == GN_ROLE_SCRATCH || second == GN_ROLE_SCRATCH)
        return GN_HAZARD_SCRATCH;
    if (first == GN_ROLE_INPUT || second == GN_ROLE_INPUT || first == GN_ROLE_TRANSFER || second == GN_ROLE_TRANSFER)
        return GN_HAZARD_INPUT;
    return GN_HAZARD_STRUCTURE;
}

static struct gn_object object_of(const struct gn_as *as)
{
    return as ? (struct gn_object){as->kind, (uint64_t)as->handle, as->name} : (struct gn_object){.kind = GN_OBJECT_NONE};
}

static const char *name_of(const struct gn_device *device, VkCommandBuffer handle)
{
    const struct gn_command_buffer *commands = gn_map_get(&device->command_buffers, (uint64_t)(uintptr_t)handle);
    return commands ? commands->name : NULL;
}

/* For the rules. The place of the earlier command is written to `place`, which the value refers to. */
static struct gn_hazard hazard_of(const struct gn_device *device, const struct gn_conflict *conflict, char *place, size_t size)
{
    const struct gn_touch *first = conflict->first, *second = conflict->second;
    struct gn_object commands = {GN_OBJECT_COMMAND_BUFFER, (uint64_t)(uintptr_t)first->command_buffer,
                                 name_of(device, first->command_buffer)};
    uint64_t begin = first->range.base > second->range.base ? first->range.base : second->range.base;
    uint64_t first_end = first->range.base + first->range.size, second_end = second->range.base + second->range.size;
    char text[256];
    snprintf(place, size, "%s of %s in queue submission %llu", first->command,
             gn_object_describe(&commands, text, sizeof text), (unsigned long long)first->submission);
    static const enum gn_hazard_why why[] = {[GN_NOT_ORDERED] = GN_HAZARD_NOT_ORDERED,
                                             [GN_SAME_COMMAND] = GN_HAZARD_NOT_ORDERED,
                                             [GN_NOT_AVAILABLE] = GN_HAZARD_NOT_AVAILABLE,
                                             [GN_NOT_VISIBLE] = GN_HAZARD_NOT_VISIBLE,
                                             [GN_OTHER_QUEUE] = GN_HAZARD_OTHER_QUEUE};
    return (struct gn_hazard){.kind = conflict->why == GN_SAME_COMMAND ? GN_HAZARD_OVERLAP : kind_of(first->role, second->role),
                              .why = why[conflict->why],
                              .certain = !second->passing,
                              .first_place = place,
                              .first = {object_of(first->as), first->as ? first->as->id : 0, texts[first->role].what,
                                        texts[first->role].stages,
                                        gn_role_writes(first->role) ? texts[first->role].accesses : "0"},
                              .second = {object_of(second->as), second->as ? second->as->id : 0, texts[second->role].what,
                                         texts[second->role].stages, texts[second->role].accesses},
                              .begin = begin,
                              .end = first_end < second_end ? first_end : second_end};
}

static void judge_hazard(const void *value, struct gn_report *report)
{
    gn_rules_judge_hazard(value, report);
}

struct context {
    struct gn_replay *replay;
    const struct gn_event *event;
    uint64_t position;
    bool told;
};

/* The first conflict of an access stands for all. */
static void tell(void *opaque, const struct gn_conflict *conflict)
{
    struct context *context = opaque;
    char place[512];
    if (context->told)
        return;
    context->told = true;
    struct gn_hazard hazard = hazard_of(context->replay->device, conflict, place, sizeof place);
    gn_replay_suspect(context->replay, context->event,
                      &(struct gn_suspect){.judge = judge_hazard, .value = &hazard, .place = &hazard.place}, false,
                      context->position);
}

static void touch(struct gn_replay *replay, const struct gn_event *event, const struct gn_touch *touched)
{
    struct context context = {replay, event, touched->position, false};
    gn_sync_touch(replay->device, touched, &replay->host, tell, &context);
    gn_tally_check(replay->device, GN_CHECKED_accesses, 1);
}

void gn_replay_order(struct gn_replay *replay, const struct gn_event *event, uint64_t position)
{
    struct gn_device *device = replay->device;
    if (device->builds_unseen)
        return;
    for (uint32_t i = 0; event->barriers && i < event->barriers->count; i++)
        gn_sync_barrier(device, replay->queue->id, position, &event->barriers->list[i]);
    for (uint32_t i = 0; event->accesses && i < event->accesses->count; i++) {
        const struct gn_access *access = &event->accesses->list[i];
        touch(replay, event,
              &(struct gn_touch){.range = {.base = access->base, .size = access->size},
                                 .role = access->role,
                                 .as = access->as,
                                 .queue = replay->queue->id,
                                 .position = position,
                                 .submission = replay->number,
                                 .command = event->accesses->command,
                                 .command_buffer = replay->command_buffer});
    }
}

void gn_replay_trace(struct gn_replay *replay, const struct gn_event *event, struct gn_as *tlas, VkShaderStageFlags stages,
                     bool certain, uint64_t position)
{
    if (replay->device->builds_unseen)
        return;
    enum gn_role role = stages & VK_SHADER_STAGE_COMPUTE_BIT        ? GN_ROLE_TRACE_COMPUTE
                        : stages & VK_SHADER_STAGE_ALL_GRAPHICS     ? GN_ROLE_TRACE_GRAPHICS
                                                                    : GN_ROLE_TRACE_RAYS;
    struct gn_event by = {.kind = event->kind, .use = event->use, .source = tlas};
    touch(replay, &by,
          &(struct gn_touch){.range = {.base = tlas->base, .size = tlas->size},
                             .role = role,
                             .passing = !certain,
                             .as = tlas,
                             .queue = replay->queue->id,
                             .position = position,
                             .submission = replay->number,
                             .command = gn_event_command(event),
                             .command_buffer = replay->command_buffer});
}

/* The write that a reader at `position` finds; false if none is remembered. */
static bool write_before(const struct gn_as *as, uint64_t position, struct gn_touch *out)
{
    const struct gn_write *found = NULL;
    for (uint32_t i = 0; i < sizeof as->last_writes / sizeof as->last_writes[0]; i++) {
        const struct gn_write *write = &as->last_writes[i];
        if (write->position && write->position < position && (!found || write->position > found->position))
            found = write;
    }
    if (!found)
        return false;
    *out = (struct gn_touch){.range = {.base = as->base, .size = as->size},
                             .role = (enum gn_role)found->role,
                             .as = (struct gn_as *)(uintptr_t)as,
                             .queue = found->queue,
                             .position = found->position,
                             .submission = found->submission,
                             .command = found->command,
                             .command_buffer = found->command_buffer};
    return true;
}

static const char *given_place(void *context)
{
    return context;
}

static bool tell_instance(struct gn_device *device, const struct gn_touch *first, const struct gn_touch *second,
                          const struct gn_clock *host, const char *place, struct gn_findings *out)
{
    struct gn_findings found;
    struct gn_pending_finding *finding;
    char first_place[512];
    struct gn_conflict conflict = {first, second, gn_sync_order(device, first, second, host)};
    if (conflict.why == GN_ORDERED)
        return false;
    struct gn_hazard hazard = hazard_of(device, &conflict, first_place, sizeof first_place);
    gn_findings_init(&found);
    gn_report_suspect(device->instance,
                      &(struct gn_suspect){.judge = judge_hazard,
                                           .value = &hazard,
                                           .place = &hazard.place,
                                           .make_place = given_place,
                                           .context = (void *)(uintptr_t)place},
                      &found);
    while ((finding = gn_findings_take(&found)))
        gn_report_confirm(device->instance, finding, out);
    return true;
}

#define MOST_TOLD 16u

/* What comes before the latest write of a queue is ordered whenever that is: nearly always a few looks are enough. */
void gn_order_instances(struct gn_device *device, const struct gn_as *const *structures, uint32_t count,
                        const struct gn_judgement *judgement, const char *place, struct gn_findings *out)
{
    struct gn_touch second = {.role = GN_ROLE_INSTANCE, .queue = judgement->queue, .position = judgement->position};
    struct gn_touch latest[GN_MAX_CLOCKS][2] = {{{.position = 0}}}, first;
    uint32_t told = 0;
    bool suspicious = false;
    for (uint32_t i = 0; i < count; i++) {
        if (!write_before(structures[i], judgement->position, &first) || first.queue >= GN_MAX_CLOCKS)
            continue;
        struct gn_touch *last = &latest[first.queue][first.role == GN_ROLE_COPY_TARGET];
        if (first.position > last->position)
            *last = first;
    }
    gn_tally_check(device, GN_CHECKED_accesses, count);
    for (uint32_t q = 0; q < GN_MAX_CLOCKS; q++)
        for (int kind = 0; kind < 2; kind++)
            suspicious |= latest[q][kind].position &&
                          gn_sync_order(device, &latest[q][kind], &second, &judgement->host) != GN_ORDERED;
    for (uint32_t i = 0; suspicious && i < count && told < MOST_TOLD; i++) {
        if (!write_before(structures[i], judgement->position, &first))
            continue;
        second.range = first.range;
        second.as = first.as;
        told += first.position != second.position && tell_instance(device, &first, &second, &judgement->host, place, out);
    }
}

static struct gn_accesses *accesses_create(struct gn_device *device, const char *command, uint32_t count)
{
    struct gn_accesses *accesses = malloc(sizeof *accesses + count * sizeof accesses->list[0]);
    if (!accesses) {
        gn_tally_lost(device);
        return NULL;
    }
    accesses->command = command;
    accesses->count = 0;
    return accesses;
}

void gn_command_buffer_access(struct gn_device *device, struct gn_command_buffer *commands, const char *command,
                              const struct gn_access *list, uint32_t count)
{
    struct gn_event event = {.kind = GN_EVENT_ACCESS,
                             .command = gn_command_buffer_next(commands),
                             .unjudged = GN_UNJUDGED_COUNT,
                             .accesses = accesses_create(device, command, count)};
    if (!event.accesses)
        return;
    for (uint32_t i = 0; i < count; i++)
        event.accesses->list[event.accesses->count++] = list[i];
    if (!gn_command_buffer_add(device, commands, &event))
        free(event.accesses);
}

static void add(struct gn_accesses *accesses, enum gn_role role, uint64_t base, uint64_t size, struct gn_as *as)
{
    if (size && base && base + size > base)
        accesses->list[accesses->count++] = (struct gn_access){role, base, size, as};
}

/* Of one structure, whole. */
struct gn_accesses *gn_accesses_of(struct gn_device *device, const char *command, struct gn_as *read, enum gn_role read_role,
                                   struct gn_as *written, enum gn_role written_role)
{
    struct gn_accesses *accesses = accesses_create(device, command, 2);
    if (accesses && read && read != written)
        add(accesses, read_role, read->base, read->size, read);
    if (accesses && written)
        add(accesses, written_role, written->base, written->size, written);
    return accesses;
}

/* Geometries beyond these are not followed. */
#define MOST_GEOMETRIES 32u

/* Vertices behind indices are left out: which of them are read is not known. */
static void add_geometry(struct gn_accesses *accesses, const VkAccelerationStructureGeometryKHR *geometry,
                         const VkAccelerationStructureBuildRangeInfoKHR *range, struct gn_as *target)
{
    uint64_t count = range->primitiveCount, stride;
    if (!count)
        return;
    if (geometry->geometryType == VK_GEOMETRY_TYPE_INSTANCES_KHR) {
        stride = geometry->geometry.instances.arrayOfPointers ? 8 : sizeof(VkAccelerationStructureInstanceKHR);
        add(accesses, GN_ROLE_INPUT, geometry->geometry.instances.data.deviceAddress + range->primitiveOffset, count * stride,
            target);
    } else if (geometry->geometryType == VK_GEOMETRY_TYPE_AABBS_KHR) {
        stride = geometry->geometry.aabbs.stride;
        if (stride <= 4096)
            add(accesses, GN_ROLE_INPUT, geometry->geometry.aabbs.data.deviceAddress + range->primitiveOffset,
                (count - 1) * stride + sizeof(VkAabbPositionsKHR), target);
    } else if (geometry->geometryType == VK_GEOMETRY_TYPE_TRIANGLES_KHR) {
        const VkAccelerationStructureGeometryTrianglesDataKHR *triangles = &geometry->geometry.triangles;
        if (triangles->indexType == VK_INDEX_TYPE_NONE_KHR) {
            stride = triangles->vertexStride;
            if (stride <= 4096)
                add(accesses, GN_ROLE_INPUT,
                    triangles->vertexData.deviceAddress + range->primitiveOffset + range->firstVertex * stride,
                    (count * 3 - 1) * stride + 1, target);
        } else {
            stride = triangles->indexType == VK_INDEX_TYPE_UINT32 ? 4 : triangles->indexType == VK_INDEX_TYPE_UINT16 ? 2 : 1;
            add(accesses, GN_ROLE_INPUT, triangles->indexData.deviceAddress + range->primitiveOffset, count * 3 * stride, target);
        }
        if (triangles->transformData.deviceAddress)
            add(accesses, GN_ROLE_INPUT, triangles->transformData.deviceAddress + range->transformOffset,
                sizeof(VkTransformMatrixKHR), target);
    }
}

struct gn_accesses *gn_accesses_of_build(struct gn_device *device, const char *command,
                                         const VkAccelerationStructureBuildGeometryInfoKHR *info,
                                         const VkAccelerationStructureBuildRangeInfoKHR *ranges, struct gn_as *target,
                                         struct gn_as *source)
{
    uint32_t geometries = info->geometryCount < MOST_GEOMETRIES ? info->geometryCount : MOST_GEOMETRIES;
    struct gn_accesses *accesses = accesses_create(device, command, 3 + 2 * geometries);
    if (!accesses)
        return NULL;
    if (source && source != target)
        add(accesses, GN_ROLE_UPDATE_SOURCE, source->base, source->size, source);
    if (target)
        add(accesses, GN_ROLE_BUILD_TARGET, target->base, target->size, target);
    if (ranges && !(info->flags & VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV)) {
        add(accesses, GN_ROLE_SCRATCH, info->scratchData.deviceAddress, gn_inputs_scratch_size(device, info, ranges), target);
        for (uint32_t g = 0; g < geometries; g++)
            add_geometry(accesses, info->pGeometries ? &info->pGeometries[g] : info->ppGeometries[g], &ranges[g], target);
    }
    return accesses;
}
