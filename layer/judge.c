/* SPDX-License-Identifier: Apache-2.0 */
/* From instance records to values: every reference is looked up among the structures that lived when the build ran, and the
 * rules see the result. */
#include "checks/rules/survey.h"
#include "layer/sbt.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The distinct structures that one build refers to. */
struct roll {
    struct gn_device *device;
    uint32_t queue;
    uint64_t position;
    const struct gn_as *tlas;
    bool partial;
    bool by_handle; /* references are handles, as in builds on the host */
    struct gn_structure *structures;
    const struct gn_as **owners; /* the same structures */
    uint32_t *uses;
    uint64_t version; /* of the TLAS */
    const struct gn_judgement *judgement; /* NULL: on the host */
    uint32_t count, capacity;
    struct gn_map index; /* reference -> index + 1 */
};

static bool grow(struct roll *roll)
{
    uint32_t capacity = roll->capacity ? roll->capacity * 2 : 16;
    struct gn_structure *structures = realloc(roll->structures, capacity * sizeof *structures);
    if (structures)
        roll->structures = structures;
    uint32_t *uses = realloc(roll->uses, capacity * sizeof *uses);
    if (uses)
        roll->uses = uses;
    const struct gn_as **owners = realloc(roll->owners, capacity * sizeof *owners);
    if (owners)
        roll->owners = owners;
    if (!structures || !uses || !owners)
        return false;
    roll->capacity = capacity;
    return true;
}

/* So many records are read for all purposes while they are in the processor's cache. */
#define CHUNK 256u

/* UINT32_MAX - 2 stands for "no memory": the caller gives up. */
#define NO_MEMORY 0xFFFFFFFDu

static const struct gn_clock *seen_by(const struct roll *roll)
{
    return roll->judgement ? &roll->judgement->seen : NULL;
}

static uint32_t look_up(struct roll *roll, uint64_t reference)
{
    if (!reference)
        return GN_REFERENCE_NULL;
    uintptr_t known = (uintptr_t)gn_map_get(&roll->index, reference);
    if (known) {
        roll->uses[known - 1]++;
        return (uint32_t)(known - 1);
    }
    struct gn_device *device = roll->device;
    const struct gn_as *as = roll->by_handle ? gn_map_get(&device->structures, reference)
                                             : gn_as_at(device, reference, roll->queue, roll->position, seen_by(roll));
    bool destroyed = !as && !roll->by_handle && (as = gn_as_formerly_at(device, reference));
    if (!as)
        return GN_REFERENCE_UNKNOWN;
    if ((roll->count == roll->capacity && !grow(roll)) ||
        !gn_map_put(&roll->index, reference, (void *)(uintptr_t)(roll->count + 1)))
        return NO_MEMORY;
    roll->structures[roll->count] = (struct gn_structure){.object = {as->kind, (uint64_t)as->handle, as->name},
                                                          .id = as->id,
                                                          .address = as->address,
                                                          .built = gn_as_built(as, roll->queue, roll->position, seen_by(roll)),
                                                          .same_call = as->mark == roll->position && as != roll->tlas,
                                                          .is_top = as->levels == GN_LEVEL_TOP,
                                                          .destroyed = destroyed};
    roll->owners[roll->count] = as;
    roll->uses[roll->count] = 1;
    return roll->count++;
}

/* The last geometry of a BLAS; 0 where that is not known for sure. */
static uint32_t last_geometry(const struct roll *roll, const struct gn_as *as)
{
    const struct gn_write *last = as->writes ? &as->last_writes[(as->writes - 1) % 4] : NULL;
    bool sure = last && last->position && last->position < roll->position && as->shape && !as->shape->shape.is_top &&
                gn_as_sure(as, roll->queue, roll->position, seen_by(roll));
    return sure && as->shape->shape.geometry_count ? as->shape->shape.geometry_count - 1 : 0;
}

static void reach(struct gn_reaches *reaches, uint32_t geometry, uint32_t offset, uint32_t instance)
{
    struct gn_reach *found = NULL;
    for (uint32_t i = 0; i < reaches->count && !found; i++)
        if (reaches->list[i].geometry == geometry)
            found = &reaches->list[i];
    if (!found && reaches->count < sizeof reaches->list / sizeof reaches->list[0]) {
        found = &reaches->list[reaches->count++];
        *found = (struct gn_reach){geometry, offset, instance};
    } else if (found && offset > found->offset) {
        *found = (struct gn_reach){geometry, offset, instance};
    }
}

/* What hits on further geometries reach. Without memory less is found. */
static void set_reaches(const struct roll *roll, struct gn_as *tlas, const struct gn_instance_record *records, const uint32_t *refers_to,
                        uint32_t count)
{
    struct gn_reaches reaches = {.count = 0};
    bool several = false;
    free(tlas->reaches);
    tlas->reaches = NULL;
    for (uint32_t s = 0; s < roll->count && !several; s++)
        several = last_geometry(roll, roll->owners[s]) > 0;
    for (uint32_t i = 0; several && i < count; i++) {
        uint32_t geometry = refers_to[i] < roll->count ? last_geometry(roll, roll->owners[refers_to[i]]) : 0;
        if (geometry && records[i].custom_index_and_mask >> 24)
            reach(&reaches, geometry, records[i].sbt_offset_and_flags & 0xFFFFFF, i);
    }
    if (reaches.count && (tlas->reaches = malloc(sizeof reaches)))
        *tlas->reaches = reaches;
}

static void judge(struct roll *roll, struct gn_as *tlas, const struct gn_instance_record *records, uint32_t count,
                  const char *place, struct gn_findings *out)
{
    struct gn_device *device = roll->device;
    if (atomic_load_explicit(&device->incomplete, memory_order_relaxed)) {
        gn_tally_lost(device);
        return;
    }
    uint32_t *refers_to = malloc((count ? count : 1) * sizeof *refers_to);
    uint64_t unknown = 0, unordered = 0, last_reference = 0;
    uint32_t last = GN_REFERENCE_NULL;
    const struct gn_settings *settings = &device->instance->settings;
    struct gn_survey survey = {.active = 0};
    struct gn_tlas_build build = {.tlas = {GN_OBJECT_TLAS, (uint64_t)tlas->handle, tlas->name},
                                  .tlas_id = tlas->id,
                                  .place = place,
                                  .instance_count = count,
                                  .partial = roll->partial,
                                  .instances = records,
                                  .refers_to = refers_to,
                                  .valid_flags = device->valid_instance_flags,
                                  .declared_masks = settings->masks_declared ? settings->declared_masks : NULL,
                                  .custom_index_bound = settings->custom_index_bound,
                                  .sbt_offset_bound = settings->sbt_offset_bound,
                                  .survey = &survey};
    if (tlas->tag) {
        const uint64_t *masks = tlas->tag->masks;
        build.declared_masks = masks[0] | masks[1] | masks[2] | masks[3] ? masks : NULL;
        build.custom_index_bound = tlas->tag->custom_index_bound;
        build.sbt_offset_bound = tlas->tag->sbt_offset_bound;
    }
    if (!refers_to)
        goto fail;
    for (uint32_t start = 0; start < count; start += CHUNK) {
        uint32_t end = count - start < CHUNK ? count : start + CHUNK;
        for (uint32_t i = start; i < end; i++) {
            uint64_t reference = records[i].reference;
            if (i == 0 || reference != last_reference || last == GN_REFERENCE_UNKNOWN) {
                last = look_up(roll, reference);
                last_reference = reference;
            } else if (last < roll->count) {
                roll->uses[last]++;
            }
            if (last == NO_MEMORY)
                goto fail;
            unknown += last == GN_REFERENCE_UNKNOWN;
            refers_to[i] = last;
        }
        gn_survey_add(&build, start, end - start, &survey);
    }
    for (uint32_t i = 0; i < roll->count; i++)
        if (roll->structures[i].built == GN_BUILT_UNORDERED && !roll->structures[i].destroyed)
            unordered += roll->uses[i];
    build.structure_count = roll->count;
    build.structures = roll->structures;
    build.references_sure = unknown && (roll->by_handle || !device->addressless);
    if (build.references_sure)
        unknown = 0;
    gn_report_judge(device->instance, &build, out);
    if (roll->judgement)
        gn_order_instances(device, roll->owners, roll->count, roll->judgement, place, out);
    tlas->highest_offset = survey.highest_offset;
    tlas->highest_offset_at = survey.highest_offset_at;
    tlas->highest_offset_of = roll->version;
    if (atomic_load_explicit(&device->ray_pipelines, memory_order_relaxed))
        set_reaches(roll, tlas, records, refers_to, count);
    if (!roll->partial && !unordered)
        gn_members_set(device, tlas, roll->version, roll->queue, roll->position, roll->owners, roll->count);
    if (!roll->partial && !unordered && tlas->writes == roll->version)
        gn_positions_judged(device, tlas, roll->position, roll->owners, roll->count, refers_to, count);
    gn_tally_check(device, GN_CHECKED_tlas_builds, 1);
    gn_tally_check(device, GN_CHECKED_instances, count - unknown - unordered);
    gn_tally_unjudged(device, GN_UNJUDGED_unknown_reference, unknown);
    gn_tally_unjudged(device, GN_UNJUDGED_other_order, unordered);
    goto done;
fail:
    gn_tally_lost(device);
done:
    free(refers_to);
    free(roll->structures);
    free(roll->owners);
    free(roll->uses);
    gn_map_finish(&roll->index);
}

void gn_judge_capture(struct gn_device *device, const struct gn_judgement *judgement, struct gn_findings *out)
{
    const struct gn_capture *capture = judgement->capture;
    const struct gn_command_buffer *commands = gn_command_buffer_get(device, judgement->command_buffer);
    const struct gn_queue *queue = device->first_queue;
    while (queue && queue->id != judgement->queue)
        queue = queue->next;

    char commands_text[256], queue_text[256], place[768];
    struct gn_object commands_object = {GN_OBJECT_COMMAND_BUFFER, (uint64_t)(uintptr_t)judgement->command_buffer,
                                        commands ? commands->name : NULL};
    struct gn_object queue_object = {GN_OBJECT_QUEUE, queue ? (uint64_t)(uintptr_t)queue->handle : 0,
                                     queue ? queue->name : NULL};
    char build[80] = "";
    if (!capture->sbt)
        snprintf(build, sizeof build, "vkCmdBuildAccelerationStructures%sKHR, pInfos[%u],", capture->indirect ? "Indirect" : "",
                 capture->info);
    snprintf(place, sizeof place, "%s of %s in queue submission %llu (%s)", capture->sbt ? capture->sbt->command : build,
             gn_object_describe(&commands_object, commands_text, sizeof commands_text),
             (unsigned long long)judgement->submission,
             gn_object_describe(&queue_object, queue_text, sizeof queue_text));
    if (capture->sbt) {
        gn_sbt_judge(device, capture, place, out);
        return;
    }
    if (capture->contents) {
        struct gn_geometry_contents contents = *capture->contents;
        contents.place = place;
        contents.target = (struct gn_object){GN_OBJECT_BLAS, (uint64_t)judgement->tlas->handle, judgement->tlas->name};
        contents.target_id = judgement->tlas->id;
        contents.info = capture->info;
        contents.geometry = capture->geometry;
        gn_report_geometry(device->instance, &contents, out);
        gn_refit_geometry(device, judgement, &contents, place, out);
        gn_tally_check(device, GN_CHECKED_geometries, 1);
        return;
    }
    const struct gn_instance_record *records = capture->records;
    uint32_t count = capture->record_count;
    bool partial = capture->partial;
    if (capture->indirect && !(records = gn_indirect_judge(device, judgement, place, &count, &partial, out)))
        return;
    const struct gn_recording *recording = judgement->recording;
    uint32_t first = judgement->event, command = recording->events[first].command;
    while (first && recording->events[first - 1].command == command)
        first--;
    for (uint32_t i = first; i < recording->count && recording->events[i].command == command; i++)
        if (recording->events[i].target)
            recording->events[i].target->mark = judgement->position;
    struct roll roll = {
        .device = device, .queue = judgement->queue, .position = judgement->position, .tlas = judgement->tlas,
        .version = judgement->version, .judgement = judgement, .partial = partial};
    judge(&roll, judgement->tlas, records, count, place, out);
}

_Static_assert(sizeof(VkAccelerationStructureInstanceKHR) == sizeof(struct gn_instance_record),
               "the rules read instance records as they lie in memory");

void gn_judge_host(struct gn_device *device, struct gn_as *tlas, const struct gn_instance_record *records, uint32_t count,
                   bool partial, uint64_t position, uint32_t info, struct gn_findings *out)
{
    char place[128];
    snprintf(place, sizeof place, "vkBuildAccelerationStructuresKHR, pInfos[%u], on the host", info);
    struct roll roll = {.device = device, .queue = GN_QUEUE_HOST, .position = position, .tlas = tlas,
                        .version = tlas->writes, .partial = partial, .by_handle = true};
    judge(&roll, tlas, records, count, place, out);
}
