/* SPDX-License-Identifier: Apache-2.0 */
/* Commands that the host executes. What they read is looked at during the call, for until it returns nobody may change it; under a deferred
 * operation, what they do to structures counts from the moment at which the application learns that the operation is over. */
#include "layer/replay.h"

#include <stdlib.h>
#include <string.h>

/* What one element of a command does, and the instances that it reads. */
struct part {
    struct gn_event event;
    struct gn_instance_record *records; /* NULL: none, or not to be judged */
    uint32_t record_count;
    bool partial;
};

struct gn_host_command {
    struct gn_host_command *next; /* of the device, while it is deferred */
    VkDeferredOperationKHR operation;
    struct gn_accesses *name; /* without accesses: hazards against the device are not looked for */
    uint32_t count;
    struct part parts[];
};

static void command_free(struct gn_host_command *command)
{
    for (uint32_t i = 0; i < command->count; i++) {
        gn_as_release(command->parts[i].event.target);
        gn_as_release(command->parts[i].event.source);
        gn_shape_release(command->parts[i].event.shape);
        free(command->parts[i].records);
    }
    free(command->name);
    free(command);
}

/* With the device locked; NULL without memory. */
static struct gn_host_command *command_create(struct gn_device *device, const char *name, uint32_t count)
{
    struct gn_host_command *command = calloc(1, sizeof *command + count * sizeof command->parts[0]);
    if (command && (command->name = calloc(1, sizeof *command->name))) {
        command->name->command = name;
        return command;
    }
    free(command);
    gn_tally_lost(device);
    return NULL;
}

static struct part *add(struct gn_device *device, struct gn_host_command *command, enum gn_event_kind kind,
                        VkAccelerationStructureKHR target, VkAccelerationStructureKHR source)
{
    struct part *part = &command->parts[command->count++];
    part->event = (struct gn_event){.kind = kind,
                                    .target = gn_as_keep(gn_as_get(device, target)),
                                    .source = gn_as_keep(gn_as_get(device, source)),
                                    .unjudged = GN_UNJUDGED_COUNT,
                                    .accesses = command->name};
    return part;
}

static void execute(struct gn_device *device, struct gn_host_command *command, struct gn_findings *findings)
{
    struct gn_queue host = {.id = GN_QUEUE_HOST, .clock = device->host};
    struct gn_replay replay = {.device = device, .queue = &host, .host = device->host, .findings = findings};
    uint64_t position = ++device->position;
    for (uint32_t i = 0; i < command->count; i++) {
        struct gn_event *event = &command->parts[i].event;
        gn_replay_execute(&replay, event, position);
        if (event->target)
            event->target->mark = position;
    }
    gn_replay_confirm(&replay);
    for (uint32_t i = 0; i < command->count; i++) {
        const struct part *part = &command->parts[i];
        if (part->event.unjudged != GN_UNJUDGED_COUNT)
            gn_tally_unjudged(device, part->event.unjudged, 1);
        else if (part->records && part->event.target)
            gn_judge_host(device, part->event.target, part->records, part->record_count, part->partial, position, i, findings);
    }
}

/* Whether the command is, or will be, executed. */
static bool accepted(VkResult result)
{
    return result == VK_SUCCESS || result == VK_OPERATION_DEFERRED_KHR || result == VK_OPERATION_NOT_DEFERRED_KHR;
}

/* Executes the command, or keeps it until its operation is over. */
static void run(struct gn_device *device, struct gn_host_command *command, VkDeferredOperationKHR operation, VkResult result,
                struct gn_findings *findings)
{
    if (!command)
        return;
    if (result == VK_OPERATION_DEFERRED_KHR) {
        command->operation = operation;
        command->next = device->host_commands;
        device->host_commands = command;
        return;
    }
    if (accepted(result))
        execute(device, command, findings);
    command_free(command);
}

/* Instances of one build, as they are now. */
static void read_instances(struct gn_device *device, const VkAccelerationStructureBuildGeometryInfoKHR *info,
                           const VkAccelerationStructureBuildRangeInfoKHR *range, struct part *part)
{
    const VkAccelerationStructureGeometryKHR *geometry = info->pGeometries ? info->pGeometries : info->ppGeometries[0];
    uint32_t count = range->primitiveCount, cap = device->instance->settings.instance_cap;
    part->event.unjudged = info->flags & VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV ? GN_UNJUDGED_motion
                           : device->builds_unseen                                     ? GN_UNJUDGED_cluster_builds
                                                                                       : GN_UNJUDGED_COUNT;
    if (geometry->geometryType != VK_GEOMETRY_TYPE_INSTANCES_KHR || part->event.unjudged != GN_UNJUDGED_COUNT)
        return;
    if (count > cap) {
        gn_tally_unjudged(device, GN_UNJUDGED_above_cap, count - cap);
        part->partial = true;
        count = cap;
    }
    part->records = malloc((count ? count : 1) * sizeof *part->records);
    if (!part->records) {
        gn_tally_lost(device);
        return;
    }
    part->record_count = count;
    const char *data = (const char *)geometry->geometry.instances.data.hostAddress + range->primitiveOffset;
    for (uint32_t i = 0; i < count; i++) {
        const void *record = data + i * sizeof part->records[0];
        if (geometry->geometry.instances.arrayOfPointers)
            memcpy(&record, data + i * sizeof record, sizeof record);
        memcpy(&part->records[i], record, sizeof part->records[0]);
    }
}

static void judge_geometry(struct gn_device *device, const struct gn_as *target, const VkAccelerationStructureGeometryKHR *geometry,
                           const VkAccelerationStructureBuildRangeInfoKHR *range, uint32_t info, uint32_t index,
                           struct gn_findings *findings)
{
    struct gn_geometry_contents contents = {.place = "vkBuildAccelerationStructuresKHR on the host",
                                            .target = {target->kind, (uint64_t)target->handle, target->name},
                                            .target_id = target->id,
                                            .info = info,
                                            .geometry = index};
    if (geometry->geometryType == VK_GEOMETRY_TYPE_AABBS_KHR) {
        contents.boxes = (const unsigned char *)geometry->geometry.aabbs.data.hostAddress + range->primitiveOffset;
        contents.box_stride = geometry->geometry.aabbs.stride;
        contents.box_count = range->primitiveCount;
    } else if (geometry->geometryType == VK_GEOMETRY_TYPE_TRIANGLES_KHR) {
        const VkAccelerationStructureGeometryTrianglesDataKHR *triangles = &geometry->geometry.triangles;
        struct gn_vertex_layout layout = gn_vertex_layout_of(triangles->vertexFormat);
        uint32_t index_size = gn_index_size(triangles->indexType);
        uint64_t first = (uint64_t)range->firstVertex * triangles->vertexStride;
        if (index_size)
            contents.indices = (const unsigned char *)triangles->indexData.hostAddress + range->primitiveOffset;
        else
            first += range->primitiveOffset;
        contents.index_size = index_size;
        contents.index_count = (uint64_t)range->primitiveCount * 3;
        contents.max_vertex = triangles->maxVertex;
        contents.vertices = layout.floating ? (const unsigned char *)triangles->vertexData.hostAddress + first : NULL;
        contents.vertex_stride = triangles->vertexStride;
        contents.vertex_count = index_size ? (uint64_t)triangles->maxVertex + 1 : contents.index_count;
        contents.vertices_in_buffer = UINT64_MAX;
        contents.component_size = layout.component_size;
        contents.component_count = layout.floating ? layout.coordinates : 0;
        if (triangles->transformData.hostAddress)
            contents.transform = (const unsigned char *)triangles->transformData.hostAddress + range->transformOffset;
    } else {
        return;
    }
    gn_report_geometry(device->instance, &contents, findings);
    gn_tally_check(device, GN_CHECKED_geometries, 1);
}

static void judge_geometries(struct gn_device *device, const VkAccelerationStructureBuildGeometryInfoKHR *info, uint32_t index,
                             const VkAccelerationStructureBuildRangeInfoKHR *ranges, struct gn_findings *findings)
{
    const struct gn_as *target = gn_as_get(device, info->dstAccelerationStructure);
    if (!target || !device->instance->settings.input_cap || (info->flags & VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV))
        return;
    for (uint32_t g = 0; g < info->geometryCount; g++)
        if (ranges[g].primitiveCount)
            judge_geometry(device, target, info->pGeometries ? &info->pGeometries[g] : info->ppGeometries[g], &ranges[g], index, g,
                           findings);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_BuildAccelerationStructuresKHR(
    VkDevice handle, VkDeferredOperationKHR deferred, uint32_t count, const VkAccelerationStructureBuildGeometryInfoKHR *infos,
    const VkAccelerationStructureBuildRangeInfoKHR *const *ranges)
{
    struct gn_device *device = gn_device_of(handle);
    struct gn_findings findings;
    gn_findings_init(&findings);
    VkResult result = device->next.BuildAccelerationStructuresKHR(handle, deferred, count, infos, ranges);
    if (!accepted(result))
        return result;
    gn_lock(device);
    struct gn_host_command *command = command_create(device, "vkBuildAccelerationStructuresKHR", count);
    for (uint32_t i = 0; command && i < count; i++) {
        const VkAccelerationStructureBuildGeometryInfoKHR *info = &infos[i];
        bool update = info->mode == VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
        struct part *part = add(device, command, update ? GN_EVENT_UPDATE : GN_EVENT_BUILD, info->dstAccelerationStructure,
                                update ? info->srcAccelerationStructure : VK_NULL_HANDLE);
        part->event.is_update = update;
        part->event.is_tlas = info->type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR;
        part->event.shape = gn_shape_create(info, ranges[i]);
        if (part->event.is_tlas && info->geometryCount)
            read_instances(device, info, ranges[i], part);
        else
            judge_geometries(device, info, i, ranges[i], &findings);
    }
    run(device, command, deferred, result, &findings);
    gn_unlock(device);
    gn_report_flush(device->instance, &findings);
    return result;
}

/* A command on one or two structures, once the next layer has taken it. */
static VkResult on_structures(struct gn_device *device, const char *name, VkResult result, VkDeferredOperationKHR deferred,
                              enum gn_event_kind kind, VkAccelerationStructureKHR target, VkAccelerationStructureKHR source)
{
    struct gn_findings findings;
    if (!accepted(result))
        return result;
    gn_findings_init(&findings);
    gn_lock(device);
    struct gn_host_command *command = command_create(device, name, 1);
    if (command)
        add(device, command, kind, target, source);
    run(device, command, deferred, result, &findings);
    gn_unlock(device);
    gn_report_flush(device->instance, &findings);
    return result;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CopyAccelerationStructureKHR(VkDevice handle, VkDeferredOperationKHR deferred,
                                                                     const VkCopyAccelerationStructureInfoKHR *info)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.CopyAccelerationStructureKHR(handle, deferred, info);
    bool compacts = info->mode == VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR;
    return on_structures(device, "vkCopyAccelerationStructureKHR", result, deferred, compacts ? GN_EVENT_COMPACT : GN_EVENT_COPY,
                         info->dst, info->src);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CopyAccelerationStructureToMemoryKHR(VkDevice handle, VkDeferredOperationKHR deferred,
                                                                             const VkCopyAccelerationStructureToMemoryInfoKHR *info)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.CopyAccelerationStructureToMemoryKHR(handle, deferred, info);
    return on_structures(device, "vkCopyAccelerationStructureToMemoryKHR", result, deferred, GN_EVENT_SERIALIZE, VK_NULL_HANDLE,
                         info->src);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CopyMemoryToAccelerationStructureKHR(
    VkDevice handle, VkDeferredOperationKHR deferred, const VkCopyMemoryToAccelerationStructureInfoKHR *info)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.CopyMemoryToAccelerationStructureKHR(handle, deferred, info);
    return on_structures(device, "vkCopyMemoryToAccelerationStructureKHR", result, deferred, GN_EVENT_DESERIALIZE, info->dst,
                         VK_NULL_HANDLE);
}

/* The answer is there at once. */
VKAPI_ATTR VkResult VKAPI_CALL gn_entry_WriteAccelerationStructuresPropertiesKHR(
    VkDevice handle, uint32_t count, const VkAccelerationStructureKHR *structures, VkQueryType type, size_t size, void *data,
    size_t stride)
{
    struct gn_device *device = gn_device_of(handle);
    struct gn_findings findings;
    VkResult result = device->next.WriteAccelerationStructuresPropertiesKHR(handle, count, structures, type, size, data, stride);
    if (result != VK_SUCCESS)
        return result;
    bool compacted = type == VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR;
    gn_findings_init(&findings);
    gn_lock(device);
    struct gn_host_command *command = command_create(device, "vkWriteAccelerationStructuresPropertiesKHR", count);
    for (uint32_t i = 0; command && i < count; i++)
        add(device, command, compacted ? GN_EVENT_QUERY_COMPACTED : GN_EVENT_QUERY, VK_NULL_HANDLE, structures[i]);
    run(device, command, VK_NULL_HANDLE, result, &findings);
    for (uint32_t i = 0; compacted && i < count; i++) {
        struct gn_as *as = gn_as_get(device, structures[i]);
        VkDeviceSize answer;
        if (!as)
            continue;
        memcpy(&answer, (const char *)data + i * stride, sizeof answer);
        as->compacted_size = answer;
        as->compacted_size_of = as->generation;
    }
    gn_unlock(device);
    gn_report_flush(device->instance, &findings);
    return result;
}

/* Deferred operations */

/* The operation is over, and the application is about to learn of it. */
static void complete(struct gn_device *device, VkDeferredOperationKHR operation, VkResult result)
{
    struct gn_findings findings;
    gn_findings_init(&findings);
    gn_lock(device);
    for (struct gn_host_command **link = &device->host_commands, *command; (command = *link);) {
        if (command->operation != operation) {
            link = &command->next;
            continue;
        }
        *link = command->next;
        if (result == VK_SUCCESS)
            execute(device, command, &findings);
        command_free(command);
    }
    gn_unlock(device);
    gn_report_flush(device->instance, &findings);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_DeferredOperationJoinKHR(VkDevice handle, VkDeferredOperationKHR operation)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.DeferredOperationJoinKHR(handle, operation);
    if (result == VK_SUCCESS)
        complete(device, operation, device->next.GetDeferredOperationResultKHR(handle, operation));
    return result;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_GetDeferredOperationResultKHR(VkDevice handle, VkDeferredOperationKHR operation)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.GetDeferredOperationResultKHR(handle, operation);
    if (result != VK_NOT_READY)
        complete(device, operation, result);
    return result;
}

/* It is over then, however the application learnt of that. */
VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyDeferredOperationKHR(VkDevice handle, VkDeferredOperationKHR operation,
                                                                const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    if (operation)
        complete(device, operation, device->next.GetDeferredOperationResultKHR(handle, operation));
    device->next.DestroyDeferredOperationKHR(handle, operation, allocator);
}

void gn_host_commands_finish(struct gn_device *device)
{
    for (struct gn_host_command *command = device->host_commands, *next; command; command = next) {
        next = command->next;
        gn_tally_unjudged(device, GN_UNJUDGED_deferred, 1);
        command_free(command);
    }
    device->host_commands = NULL;
}
