/* SPDX-License-Identifier: Apache-2.0 */
/* Recording: command pools and buffers, and the commands on acceleration structures as events. A TLAS build is preceded by a copy
 * of the instance records that it is about to read. */
#include "layer/sbt.h"
#include "layer/sync.h"

#include <stdlib.h>
#include <string.h>

struct gn_command_buffer *gn_command_buffer_get(struct gn_device *device, VkCommandBuffer handle)
{
    return gn_map_get(&device->command_buffers, (uint64_t)(uintptr_t)handle);
}

struct gn_recording *gn_recording_keep(struct gn_recording *recording)
{
    if (recording)
        recording->references++;
    return recording;
}

void gn_recording_release(struct gn_device *device, struct gn_recording *recording)
{
    if (!recording || --recording->references)
        return;
    for (uint32_t i = 0; i < recording->count; i++) {
        struct gn_event *event = &recording->events[i];
        gn_as_release(event->target);
        gn_as_release(event->source);
        gn_shape_release(event->shape);
        gn_query_pool_release(event->pool);
        gn_faults_free(event->faults);
        gn_captures_free(device, event->capture);
        gn_use_free(event->use);
        free(event->accesses);
        free(event->barriers);
        gn_recording_release(device, event->secondary);
    }
    free(recording->events);
    free(recording);
}

static struct gn_recording *recording_of(struct gn_command_buffer *commands)
{
    if (!commands->recording && (commands->recording = calloc(1, sizeof *commands->recording))) {
        commands->recording->references = 1;
        commands->recording->simultaneous = commands->simultaneous;
    }
    return commands->recording;
}

struct gn_event *gn_command_buffer_add(struct gn_device *device, struct gn_command_buffer *commands,
                                       const struct gn_event *event)
{
    struct gn_recording *recording = recording_of(commands);
    if (!recording)
        goto fail;
    if (recording->count == recording->capacity) {
        uint32_t capacity = recording->capacity ? recording->capacity * 2 : 4;
        struct gn_event *grown = realloc(recording->events, capacity * sizeof *grown);
        if (!grown)
            goto fail;
        recording->events = grown;
        recording->capacity = capacity;
    }
    struct gn_event *added = &recording->events[recording->count++];
    *added = *event;
    gn_as_keep(added->target);
    gn_as_keep(added->source);
    gn_shape_keep(added->shape);
    gn_query_pool_keep(added->pool);
    gn_recording_keep(added->secondary);
    return added;
fail:
    gn_tally_lost(device);
    return NULL;
}

uint32_t gn_command_buffer_next(struct gn_command_buffer *commands)
{
    struct gn_recording *recording = recording_of(commands);
    return recording ? ++recording->command_count : 0;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateCommandPool(VkDevice handle, const VkCommandPoolCreateInfo *info,
                                                          const VkAllocationCallbacks *allocator, VkCommandPool *out)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.CreateCommandPool(handle, info, allocator, out);
    if (result != VK_SUCCESS)
        return result;
    struct gn_command_pool *pool = calloc(1, sizeof *pool);
    gn_lock(device);
    if (pool) {
        pool->handle = *out;
        pool->is_protected = (info->flags & VK_COMMAND_POOL_CREATE_PROTECTED_BIT) != 0;
    }
    if (!pool || !gn_map_put(&device->pools, (uint64_t)*out, pool)) {
        free(pool);
        gn_tally_lost(device);
    }
    gn_unlock(device);
    return result;
}

static void forget_recording(struct gn_device *device, struct gn_command_buffer *commands)
{
    gn_recording_release(device, commands->recording);
    commands->recording = NULL;
    gn_rays_release(commands->rays);
    commands->rays = NULL;
    gn_bound_free(commands->bound);
    commands->bound = NULL;
}

static void command_buffer_free(struct gn_device *device, struct gn_command_buffer *commands)
{
    gn_map_take(&device->command_buffers, (uint64_t)(uintptr_t)commands->handle);
    forget_recording(device, commands);
    if (commands->previous)
        commands->previous->next = commands->next;
    else
        commands->pool->first = commands->next;
    if (commands->next)
        commands->next->previous = commands->previous;
    free(commands->name);
    free(commands);
}

static void pool_free(struct gn_device *device, struct gn_command_pool *pool)
{
    while (pool && pool->first)
        command_buffer_free(device, pool->first);
    free(pool);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyCommandPool(VkDevice handle, VkCommandPool pool,
                                                       const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    if (pool) {
        gn_lock(device);
        pool_free(device, gn_map_take(&device->pools, (uint64_t)pool));
        gn_unlock(device);
    }
    device->next.DestroyCommandPool(handle, pool, allocator);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_ResetCommandPool(VkDevice handle, VkCommandPool pool,
                                                         VkCommandPoolResetFlags flags)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    struct gn_command_pool *known = gn_map_get(&device->pools, (uint64_t)pool);
    for (struct gn_command_buffer *commands = known ? known->first : NULL; commands; commands = commands->next)
        forget_recording(device, commands);
    gn_unlock(device);
    return device->next.ResetCommandPool(handle, pool, flags);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_AllocateCommandBuffers(VkDevice handle, const VkCommandBufferAllocateInfo *info,
                                                               VkCommandBuffer *out)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.AllocateCommandBuffers(handle, info, out);
    if (result != VK_SUCCESS)
        return result;
    gn_lock(device);
    struct gn_command_pool *pool = gn_map_get(&device->pools, (uint64_t)info->commandPool);
    for (uint32_t i = 0; pool && i < info->commandBufferCount; i++) {
        struct gn_command_buffer *commands = calloc(1, sizeof *commands);
        if (!commands || !gn_map_put(&device->command_buffers, (uint64_t)(uintptr_t)out[i], commands)) {
            free(commands);
            gn_tally_lost(device);
            continue;
        }
        *commands = (struct gn_command_buffer){.handle = out[i], .pool = pool, .next = pool->first};
        if (pool->first)
            pool->first->previous = commands;
        pool->first = commands;
    }
    gn_unlock(device);
    return result;
}

VKAPI_ATTR void VKAPI_CALL gn_entry_FreeCommandBuffers(VkDevice handle, VkCommandPool pool, uint32_t count,
                                                       const VkCommandBuffer *buffers)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    for (uint32_t i = 0; i < count; i++) {
        struct gn_command_buffer *commands = buffers[i] ? gn_command_buffer_get(device, buffers[i]) : NULL;
        if (commands)
            command_buffer_free(device, commands);
    }
    gn_unlock(device);
    device->next.FreeCommandBuffers(handle, pool, count, buffers);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_BeginCommandBuffer(VkCommandBuffer handle, const VkCommandBufferBeginInfo *info)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    if (commands) {
        forget_recording(device, commands);
        commands->simultaneous = (info->flags & VK_COMMAND_BUFFER_USAGE_SIMULTANEOUS_USE_BIT) != 0;
    }
    gn_unlock(device);
    return device->next.BeginCommandBuffer(handle, info);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_ResetCommandBuffer(VkCommandBuffer handle, VkCommandBufferResetFlags flags)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    if (commands)
        forget_recording(device, commands);
    gn_unlock(device);
    return device->next.ResetCommandBuffer(handle, flags);
}

void gn_command_buffers_finish(struct gn_device *device)
{
    size_t cursor = 0;
    struct gn_command_pool *pool;
    while ((pool = gn_map_next(&device->pools, &cursor)))
        pool_free(device, pool);
    gn_map_finish(&device->pools);
    gn_map_finish(&device->command_buffers);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdExecuteCommands(VkCommandBuffer handle, uint32_t count,
                                                       const VkCommandBuffer *secondaries)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    for (uint32_t i = 0; commands && i < count; i++) {
        struct gn_command_buffer *secondary = gn_command_buffer_get(device, secondaries[i]);
        if (!secondary || !secondary->recording)
            continue;
        struct gn_event event = {.kind = GN_EVENT_EXECUTE,
                                 .command = gn_command_buffer_next(commands),
                                 .secondary = secondary->recording,
                                 .unjudged = GN_UNJUDGED_COUNT};
        gn_command_buffer_add(device, commands, &event);
    }
    gn_unlock(device);
    device->next.CmdExecuteCommands(handle, count, secondaries);
}

/* One event about one or two structures. */
static void record(VkCommandBuffer handle, struct gn_device *device, const char *command, enum gn_event_kind kind,
                   VkAccelerationStructureKHR target, VkAccelerationStructureKHR source)
{
    gn_lock(device);
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    if (commands) {
        struct gn_event event = {.kind = kind,
                                 .command = gn_command_buffer_next(commands),
                                 .target = gn_as_get(device, target),
                                 .source = gn_as_get(device, source),
                                 .unjudged = GN_UNJUDGED_COUNT};
        event.accesses =
            gn_accesses_of(device, command, event.source, GN_ROLE_COPY_SOURCE, event.target, GN_ROLE_COPY_TARGET);
        if (!gn_command_buffer_add(device, commands, &event))
            free(event.accesses);
    }
    gn_unlock(device);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdCopyAccelerationStructureKHR(VkCommandBuffer handle,
                                                                    const VkCopyAccelerationStructureInfoKHR *info)
{
    struct gn_device *device = gn_device_of(handle);
    record(handle, device, "vkCmdCopyAccelerationStructureKHR",
           info->mode == VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR ? GN_EVENT_COMPACT : GN_EVENT_COPY, info->dst,
           info->src);
    device->next.CmdCopyAccelerationStructureKHR(handle, info);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdCopyAccelerationStructureToMemoryKHR(
    VkCommandBuffer handle, const VkCopyAccelerationStructureToMemoryInfoKHR *info)
{
    struct gn_device *device = gn_device_of(handle);
    record(handle, device, "vkCmdCopyAccelerationStructureToMemoryKHR", GN_EVENT_SERIALIZE, VK_NULL_HANDLE, info->src);
    device->next.CmdCopyAccelerationStructureToMemoryKHR(handle, info);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdCopyMemoryToAccelerationStructureKHR(
    VkCommandBuffer handle, const VkCopyMemoryToAccelerationStructureInfoKHR *info)
{
    struct gn_device *device = gn_device_of(handle);
    record(handle, device, "vkCmdCopyMemoryToAccelerationStructureKHR", GN_EVENT_DESERIALIZE, info->dst, VK_NULL_HANDLE);
    device->next.CmdCopyMemoryToAccelerationStructureKHR(handle, info);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdWriteAccelerationStructuresPropertiesKHR(
    VkCommandBuffer handle, uint32_t count, const VkAccelerationStructureKHR *structures, VkQueryType type, VkQueryPool pool,
    uint32_t first)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    uint32_t command = commands ? gn_command_buffer_next(commands) : 0;
    for (uint32_t i = 0; commands && i < count; i++) {
        bool compacted_size = type == VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR;
        struct gn_event event = {.kind = compacted_size ? GN_EVENT_QUERY_COMPACTED : GN_EVENT_QUERY,
                                 .command = command,
                                 .source = gn_as_get(device, structures[i]),
                                 .pool = compacted_size ? gn_query_pool_get(device, pool) : NULL,
                                 .query = first + i,
                                 .unjudged = GN_UNJUDGED_COUNT};
        event.accesses = gn_accesses_of(device, "vkCmdWriteAccelerationStructuresPropertiesKHR", event.source,
                                        GN_ROLE_QUESTION, NULL, GN_ROLE_COPY_TARGET);
        if (!gn_command_buffer_add(device, commands, &event))
            free(event.accesses);
    }
    gn_unlock(device);
    device->next.CmdWriteAccelerationStructuresPropertiesKHR(handle, count, structures, type, pool, first);
}

/* Prepares the copy of the instances that the build reads. Gives the reason when that cannot be done, GN_UNJUDGED_COUNT
 * otherwise; *out_capture stays NULL when there is nothing to read. */
static enum gn_unjudged prepare_capture(struct gn_device *device, const struct gn_command_buffer *commands,
                                        const VkAccelerationStructureBuildGeometryInfoKHR *info, uint32_t index,
                                        const VkAccelerationStructureBuildRangeInfoKHR *ranges,
                                        struct gn_capture **out_capture, struct gn_copies *copies)
{
    if (!info->geometryCount)
        return GN_UNJUDGED_COUNT;
    const VkAccelerationStructureGeometryKHR *geometry = info->pGeometries ? info->pGeometries : info->ppGeometries[0];
    if (geometry->geometryType != VK_GEOMETRY_TYPE_INSTANCES_KHR || !ranges->primitiveCount)
        return GN_UNJUDGED_COUNT;
    if (!device->copies)
        return device->no_copies_because;
    if (commands->pool->is_protected)
        return GN_UNJUDGED_protected_content;
    if (info->flags & VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV)
        return GN_UNJUDGED_motion;
    if (geometry->geometry.instances.arrayOfPointers)
        return GN_UNJUDGED_array_of_pointers;

    uint32_t count = ranges->primitiveCount, cap = device->instance->settings.instance_cap;
    if (count > cap) {
        gn_tally_unjudged(device, GN_UNJUDGED_above_cap, count - cap);
        count = cap;
        if (!count)
            return GN_UNJUDGED_COUNT;
    }
    uint64_t address = geometry->geometry.instances.data.deviceAddress + ranges->primitiveOffset;
    VkDeviceSize size = (VkDeviceSize)count * sizeof(struct gn_instance_record);
    struct gn_buffer *source = gn_buffer_holding(device, address, size);
    if (!source)
        return GN_UNJUDGED_unknown_source;
    if (!source->can_copy)
        return GN_UNJUDGED_unreadable_source;
    struct gn_capture *capture = calloc(1, sizeof *capture);
    if (!capture)
        return GN_UNJUDGED_out_of_host_memory;
    if (!gn_staging_take(device, size, capture)) {
        free(capture);
        return GN_UNJUDGED_no_copy_memory;
    }
    VkBufferCopy region = {address - source->range.base, capture->offset, size};
    if (!gn_copies_add(copies, source->handle, gn_staging_buffer(capture), &region)) {
        gn_captures_free(device, capture);
        return GN_UNJUDGED_out_of_host_memory;
    }
    capture->record_count = count;
    capture->partial = count < ranges->primitiveCount;
    capture->info = index;
    *out_capture = capture;
    return GN_UNJUDGED_COUNT;
}

/* The copies, ordered by the application's own barriers: whatever made the memory visible to the reader makes it visible to a
 * transfer that is chained to the reader's stage, and whatever the application orders after the reader comes after the copies,
 * for they come before it. A missing barrier of the application stays missing. */
void gn_copies_record(struct gn_device *device, VkCommandBuffer handle, const struct gn_copies *copies, VkPipelineStageFlags reader,
                      bool simultaneous)
{
    const VkPipelineStageFlags transfer = VK_PIPELINE_STAGE_TRANSFER_BIT;
    /* Another execution of the same commands may still be writing the same copy. */
    VkMemoryBarrier before = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                              .srcAccessMask = simultaneous ? VK_ACCESS_TRANSFER_WRITE_BIT : 0,
                              .dstAccessMask =
                                  VK_ACCESS_TRANSFER_READ_BIT | (simultaneous ? VK_ACCESS_TRANSFER_WRITE_BIT : 0)};
    VkMemoryBarrier after = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                             .srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT,
                             .dstAccessMask = VK_ACCESS_HOST_READ_BIT};
    device->next.CmdPipelineBarrier(handle, reader | (simultaneous ? transfer : 0), transfer, 0, 1, &before, 0, NULL, 0, NULL);
    for (uint32_t i = 0; i < copies->count; i++)
        device->next.CmdCopyBuffer(handle, copies->list[i].from, copies->list[i].to, 1, &copies->list[i].region);
    device->next.CmdPipelineBarrier(handle, transfer, VK_PIPELINE_STAGE_HOST_BIT | reader, 0, 1, &after, 0, NULL, 0, NULL);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdBuildAccelerationStructuresKHR(
    VkCommandBuffer handle, uint32_t count, const VkAccelerationStructureBuildGeometryInfoKHR *infos,
    const VkAccelerationStructureBuildRangeInfoKHR *const *ranges)
{
    struct gn_device *device = gn_device_of(handle);
    struct gn_copies copies;
    bool simultaneous = false;

    gn_copies_init(&copies);
    struct gn_fault *few_faults[8] = {NULL}, **faults = few_faults;
    if (count > sizeof few_faults / sizeof few_faults[0])
        faults = calloc(count, sizeof *faults);

    gn_lock(device);
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    uint32_t command = commands ? gn_command_buffer_next(commands) : 0;
    if (commands && faults && count > 1)
        gn_inputs_check_together(device, infos, ranges, count, faults);
    for (uint32_t i = 0; commands && i < count; i++) {
        const VkAccelerationStructureBuildGeometryInfoKHR *info = &infos[i];
        if (faults)
            gn_inputs_check(device, info, i, ranges[i], &faults[i]);
        bool update = info->mode == VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
        struct gn_event event = {.kind = update ? GN_EVENT_UPDATE : GN_EVENT_BUILD,
                                 .command = command,
                                 .target = gn_as_get(device, info->dstAccelerationStructure),
                                 .source = update ? gn_as_get(device, info->srcAccelerationStructure) : NULL,
                                 .is_tlas = info->type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR,
                                 .is_update = update,
                                 .shape = gn_shape_create(info, ranges[i]),
                                 .faults = faults ? faults[i] : NULL,
                                 .unjudged = GN_UNJUDGED_COUNT};
        uint32_t copy_count = copies.count;
        if (event.is_tlas)
            event.unjudged = prepare_capture(device, commands, info, i, ranges[i], &event.capture, &copies);
        else
            gn_geometry_capture(device, commands, info, i, ranges[i], &event.capture, &copies);
        event.accesses = gn_accesses_of_build(device, "vkCmdBuildAccelerationStructuresKHR", info, ranges[i], event.target,
                                              event.source);
        if (!gn_command_buffer_add(device, commands, &event)) {
            copies.count = copy_count;
            gn_faults_free(event.faults);
            free(event.accesses);
            gn_captures_free(device, event.capture);
        }
        gn_shape_release(event.shape);
        simultaneous = commands->simultaneous;
    }
    gn_unlock(device);

    if (copies.count)
        gn_copies_record(device, handle, &copies, VK_PIPELINE_STAGE_ACCELERATION_STRUCTURE_BUILD_BIT_KHR, simultaneous);
    gn_copies_finish(&copies);
    if (faults != few_faults)
        free(faults);
    device->next.CmdBuildAccelerationStructuresKHR(handle, count, infos, ranges);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdBuildAccelerationStructuresIndirectKHR(
    VkCommandBuffer handle, uint32_t count, const VkAccelerationStructureBuildGeometryInfoKHR *infos,
    const VkDeviceAddress *addresses, const uint32_t *strides, const uint32_t *const *maxima)
{
    struct gn_device *device = gn_device_of(handle);
    struct gn_copies copies;
    bool simultaneous = false;
    gn_copies_init(&copies);
    gn_lock(device);
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    uint32_t command = commands ? gn_command_buffer_next(commands) : 0;
    for (uint32_t i = 0; commands && i < count; i++) {
        uint32_t copy_count = copies.count;
        struct gn_event event = {.kind = GN_EVENT_INDIRECT_BUILD,
                                 .command = command,
                                 .target = gn_as_get(device, infos[i].dstAccelerationStructure),
                                 .source = gn_as_get(device, infos[i].srcAccelerationStructure),
                                 .is_tlas = infos[i].type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR,
                                 .is_update = infos[i].mode == VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR,
                                 .shape = gn_shape_create(&infos[i], NULL)};
        event.unjudged = gn_indirect_capture(device, commands, &infos[i], i, addresses[i], strides[i], maxima[i], &event.capture, &copies);
        event.accesses = gn_accesses_of_build(device, "vkCmdBuildAccelerationStructuresIndirectKHR", &infos[i], NULL, event.target,
                                              event.is_update ? event.source : NULL);
        if (!gn_command_buffer_add(device, commands, &event)) {
            copies.count = copy_count;
            free(event.accesses);
            gn_captures_free(device, event.capture);
        }
        gn_shape_release(event.shape);
        simultaneous = commands->simultaneous;
    }
    gn_unlock(device);
    if (copies.count)
        gn_copies_record(device, handle, &copies, VK_PIPELINE_STAGE_ACCELERATION_STRUCTURE_BUILD_BIT_KHR, simultaneous);
    gn_copies_finish(&copies);
    device->next.CmdBuildAccelerationStructuresIndirectKHR(handle, count, infos, addresses, strides, maxima);
}
