/* SPDX-License-Identifier: Apache-2.0 */
/* Recording of what orders commands (barriers, events, dependencies of render passes), and of transfers into memory that builds and
 * traces read. */
#include "layer/sync.h"

#include <stdlib.h>
#include <string.h>

/* Barriers that follow each other are one event. */
static void record_barriers(struct gn_device *device, VkCommandBuffer handle, const struct gn_barrier *barriers, uint32_t count)
{
    if (!count)
        return;
    gn_lock(device);
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    if (!commands)
        goto done;
    struct gn_recording *recording = commands->recording;
    struct gn_event *last = recording && recording->count ? &recording->events[recording->count - 1] : NULL;
    if (!last || !last->barriers) {
        struct gn_event event = {.kind = GN_EVENT_BARRIER,
                                 .command = gn_command_buffer_next(commands),
                                 .unjudged = GN_UNJUDGED_COUNT,
                                 .barriers = calloc(1, sizeof *event.barriers)};
        if (!event.barriers || !(last = gn_command_buffer_add(device, commands, &event))) {
            free(event.barriers);
            gn_tally_lost(device);
            goto done;
        }
    }
    for (uint32_t i = 0; i < count; i++) {
        struct gn_barriers *list = last->barriers;
        if (list->count && memcmp(&list->list[list->count - 1], &barriers[i], sizeof *barriers) == 0)
            continue;
        if (list->count == list->capacity) {
            uint32_t capacity = list->capacity ? list->capacity * 2 : 2;
            struct gn_barriers *grown = realloc(list, sizeof *list + capacity * sizeof list->list[0]);
            if (!grown) {
                gn_tally_lost(device);
                goto done;
            }
            last->barriers = list = grown;
            list->capacity = capacity;
        }
        list->list[list->count++] = barriers[i];
    }
done:
    gn_unlock(device);
}

/* Many barriers of one command without a range are one: as each of them has the same stages, that may order too much, not too little. */
struct collection {
    struct gn_barrier few[8], *list;
    uint32_t count, capacity;
    struct gn_device *device;
};

static void collect(struct collection *out, const struct gn_barrier *barrier)
{
    for (uint32_t i = 0; i < out->count; i++) {
        struct gn_barrier *known = &out->list[i];
        if (known->from == barrier->from && known->to == barrier->to && known->base == barrier->base &&
            known->end == barrier->end) {
            known->made_available |= barrier->made_available;
            known->made_visible |= barrier->made_visible;
            return;
        }
    }
    if (out->count == out->capacity) {
        struct gn_barrier *grown = malloc(out->capacity * 2 * sizeof *grown);
        if (!grown) {
            gn_tally_lost(out->device);
            return;
        }
        memcpy(grown, out->list, out->count * sizeof *grown);
        if (out->list != out->few)
            free(out->list);
        out->list = grown;
        out->capacity *= 2;
    }
    out->list[out->count++] = *barrier;
}

static void collection_init(struct collection *out, struct gn_device *device)
{
    out->list = out->few;
    out->count = 0;
    out->capacity = sizeof out->few / sizeof out->few[0];
    out->device = device;
}

static void collection_record(struct collection *out, VkCommandBuffer handle)
{
    record_barriers(out->device, handle, out->list, out->count);
    if (out->list != out->few)
        free(out->list);
}

static struct gn_barrier barrier_of(VkPipelineStageFlags2 from, VkAccessFlags2 available, VkPipelineStageFlags2 to,
                                    VkAccessFlags2 visible)
{
    return (struct gn_barrier){.from = gn_stages_from(from),
                               .to = gn_stages_to(to),
                               .made_available = gn_accesses_all(available),
                               .made_visible = gn_accesses_all(visible),
                               .end = UINT64_MAX};
}

/* A buffer whose address is not known stands for everything. */
static void narrow(struct gn_device *device, struct gn_barrier *barrier, VkBuffer handle, VkDeviceSize offset, VkDeviceSize size)
{
    gn_lock(device);
    const struct gn_buffer *buffer = gn_map_get(&device->buffers, (uint64_t)handle);
    if (buffer && buffer->address && offset <= buffer->size) {
        barrier->base = buffer->address + offset;
        barrier->end = size > buffer->size - offset ? buffer->address + buffer->size : barrier->base + size;
    }
    gn_unlock(device);
}

static void collect_memory(struct collection *out, VkPipelineStageFlags from, VkPipelineStageFlags to, uint32_t memory_count,
                           const VkMemoryBarrier *memory, uint32_t buffer_count, const VkBufferMemoryBarrier *buffers)
{
    struct gn_barrier barrier = barrier_of(from, 0, to, 0);
    for (uint32_t i = 0; i < memory_count; i++) {
        barrier.made_available |= gn_accesses_all(memory[i].srcAccessMask);
        barrier.made_visible |= gn_accesses_all(memory[i].dstAccessMask);
    }
    collect(out, &barrier);
    for (uint32_t i = 0; i < buffer_count; i++) {
        barrier = barrier_of(from, buffers[i].srcAccessMask, to, buffers[i].dstAccessMask);
        narrow(out->device, &barrier, buffers[i].buffer, buffers[i].offset, buffers[i].size);
        collect(out, &barrier);
    }
}

static void collect_dependency(struct collection *out, const VkDependencyInfo *info)
{
    for (uint32_t i = 0; i < info->memoryBarrierCount; i++) {
        const VkMemoryBarrier2 *in = &info->pMemoryBarriers[i];
        struct gn_barrier barrier = barrier_of(in->srcStageMask, in->srcAccessMask, in->dstStageMask, in->dstAccessMask);
        collect(out, &barrier);
    }
    for (uint32_t i = 0; i < info->bufferMemoryBarrierCount; i++) {
        const VkBufferMemoryBarrier2 *in = &info->pBufferMemoryBarriers[i];
        struct gn_barrier barrier = barrier_of(in->srcStageMask, in->srcAccessMask, in->dstStageMask, in->dstAccessMask);
        narrow(out->device, &barrier, in->buffer, in->offset, in->size);
        collect(out, &barrier);
    }
    for (uint32_t i = 0; i < info->imageMemoryBarrierCount; i++) {
        const VkImageMemoryBarrier2 *in = &info->pImageMemoryBarriers[i];
        struct gn_barrier barrier = barrier_of(in->srcStageMask, 0, in->dstStageMask, 0);
        collect(out, &barrier);
    }
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdPipelineBarrier(VkCommandBuffer handle, VkPipelineStageFlags from,
                                                       VkPipelineStageFlags to, VkDependencyFlags flags, uint32_t memory_count,
                                                       const VkMemoryBarrier *memory, uint32_t buffer_count,
                                                       const VkBufferMemoryBarrier *buffers, uint32_t image_count,
                                                       const VkImageMemoryBarrier *images)
{
    struct gn_device *device = gn_device_of(handle);
    struct collection barriers;
    collection_init(&barriers, device);
    collect_memory(&barriers, from, to, memory_count, memory, buffer_count, buffers);
    collection_record(&barriers, handle);
    device->next.CmdPipelineBarrier(handle, from, to, flags, memory_count, memory, buffer_count, buffers, image_count, images);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdPipelineBarrier2(VkCommandBuffer handle, const VkDependencyInfo *info)
{
    struct gn_device *device = gn_device_of(handle);
    struct collection barriers;
    collection_init(&barriers, device);
    collect_dependency(&barriers, info);
    collection_record(&barriers, handle);
    device->next.CmdPipelineBarrier2(handle, info);
}

/* A wait for events counts as a barrier where it stands. */
VKAPI_ATTR void VKAPI_CALL gn_entry_CmdWaitEvents(VkCommandBuffer handle, uint32_t count, const VkEvent *events,
                                                  VkPipelineStageFlags from, VkPipelineStageFlags to, uint32_t memory_count,
                                                  const VkMemoryBarrier *memory, uint32_t buffer_count,
                                                  const VkBufferMemoryBarrier *buffers, uint32_t image_count,
                                                  const VkImageMemoryBarrier *images)
{
    struct gn_device *device = gn_device_of(handle);
    struct collection barriers;
    collection_init(&barriers, device);
    collect_memory(&barriers, from, to, memory_count, memory, buffer_count, buffers);
    collection_record(&barriers, handle);
    device->next.CmdWaitEvents(handle, count, events, from, to, memory_count, memory, buffer_count, buffers, image_count,
                               images);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdWaitEvents2(VkCommandBuffer handle, uint32_t count, const VkEvent *events,
                                                   const VkDependencyInfo *infos)
{
    struct gn_device *device = gn_device_of(handle);
    struct collection barriers;
    collection_init(&barriers, device);
    for (uint32_t i = 0; i < count; i++)
        collect_dependency(&barriers, &infos[i]);
    collection_record(&barriers, handle);
    device->next.CmdWaitEvents2(handle, count, events, infos);
}

/* The dependencies of a render pass. */
struct gn_render_pass {
    uint32_t count;
    struct gn_barrier list[];
};

static void render_pass_put(struct gn_device *device, VkRenderPass handle, struct gn_render_pass *pass)
{
    gn_lock(device);
    if (!pass || !gn_map_put(&device->render_passes, (uint64_t)handle, pass)) {
        free(pass);
        gn_tally_lost(device);
    }
    gn_unlock(device);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateRenderPass(VkDevice handle, const VkRenderPassCreateInfo *info,
                                                         const VkAllocationCallbacks *allocator, VkRenderPass *out)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.CreateRenderPass(handle, info, allocator, out);
    if (result != VK_SUCCESS || !info->dependencyCount)
        return result;
    struct gn_render_pass *pass = malloc(sizeof *pass + info->dependencyCount * sizeof pass->list[0]);
    if (pass)
        pass->count = 0;
    for (uint32_t i = 0; pass && i < info->dependencyCount; i++) {
        const VkSubpassDependency *in = &info->pDependencies[i];
        pass->list[pass->count++] = barrier_of(in->srcStageMask, in->srcAccessMask, in->dstStageMask, in->dstAccessMask);
    }
    render_pass_put(device, *out, pass);
    return result;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateRenderPass2(VkDevice handle, const VkRenderPassCreateInfo2 *info,
                                                          const VkAllocationCallbacks *allocator, VkRenderPass *out)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.CreateRenderPass2(handle, info, allocator, out);
    if (result != VK_SUCCESS || !info->dependencyCount)
        return result;
    struct gn_render_pass *pass = malloc(sizeof *pass + info->dependencyCount * sizeof pass->list[0]);
    if (pass)
        pass->count = 0;
    for (uint32_t i = 0; pass && i < info->dependencyCount; i++) {
        const VkSubpassDependency2 *in = &info->pDependencies[i];
        const VkMemoryBarrier2 *wide = gn_chain_find(in->pNext, VK_STRUCTURE_TYPE_MEMORY_BARRIER_2);
        pass->list[pass->count++] =
            wide ? barrier_of(wide->srcStageMask, wide->srcAccessMask, wide->dstStageMask, wide->dstAccessMask)
                 : barrier_of(in->srcStageMask, in->srcAccessMask, in->dstStageMask, in->dstAccessMask);
    }
    render_pass_put(device, *out, pass);
    return result;
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyRenderPass(VkDevice handle, VkRenderPass pass, const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    free(gn_map_take(&device->render_passes, (uint64_t)pass));
    gn_unlock(device);
    device->next.DestroyRenderPass(handle, pass, allocator);
}

/* All dependencies count where the render pass begins, for what is drawn in it, and again where it ends: that orders what comes
 * after it. */
static void begin_render_pass(struct gn_device *device, VkCommandBuffer handle, VkRenderPass render_pass)
{
    struct gn_barrier *copy = NULL;
    uint32_t count = 0;
    gn_lock(device);
    const struct gn_render_pass *pass = gn_map_get(&device->render_passes, (uint64_t)render_pass);
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    if (commands)
        commands->render_pass = render_pass;
    if (pass && pass->count && (copy = malloc(pass->count * sizeof *copy))) {
        count = pass->count;
        memcpy(copy, pass->list, count * sizeof *copy);
    }
    gn_unlock(device);
    record_barriers(device, handle, copy, count);
    free(copy);
}

static void continue_render_pass(struct gn_device *device, VkCommandBuffer handle)
{
    gn_lock(device);
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    VkRenderPass pass = commands ? commands->render_pass : VK_NULL_HANDLE;
    gn_unlock(device);
    if (pass)
        begin_render_pass(device, handle, pass);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdBeginRenderPass(VkCommandBuffer handle, const VkRenderPassBeginInfo *info,
                                                       VkSubpassContents contents)
{
    struct gn_device *device = gn_device_of(handle);
    begin_render_pass(device, handle, info->renderPass);
    device->next.CmdBeginRenderPass(handle, info, contents);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdBeginRenderPass2(VkCommandBuffer handle, const VkRenderPassBeginInfo *info,
                                                        const VkSubpassBeginInfo *contents)
{
    struct gn_device *device = gn_device_of(handle);
    begin_render_pass(device, handle, info->renderPass);
    device->next.CmdBeginRenderPass2(handle, info, contents);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdNextSubpass(VkCommandBuffer handle, VkSubpassContents contents)
{
    struct gn_device *device = gn_device_of(handle);
    continue_render_pass(device, handle);
    device->next.CmdNextSubpass(handle, contents);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdNextSubpass2(VkCommandBuffer handle, const VkSubpassBeginInfo *begin,
                                                    const VkSubpassEndInfo *end)
{
    struct gn_device *device = gn_device_of(handle);
    continue_render_pass(device, handle);
    device->next.CmdNextSubpass2(handle, begin, end);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdEndRenderPass(VkCommandBuffer handle)
{
    struct gn_device *device = gn_device_of(handle);
    continue_render_pass(device, handle);
    device->next.CmdEndRenderPass(handle);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdEndRenderPass2(VkCommandBuffer handle, const VkSubpassEndInfo *end)
{
    struct gn_device *device = gn_device_of(handle);
    continue_render_pass(device, handle);
    device->next.CmdEndRenderPass2(handle, end);
}

void gn_render_passes_finish(struct gn_device *device)
{
    size_t cursor = 0;
    struct gn_render_pass *pass;
    while ((pass = gn_map_next(&device->render_passes, &cursor)))
        free(pass);
    gn_map_finish(&device->render_passes);
}

#define RELEVANT                                                                                                       \
    (VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR |                                                \
     VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR | VK_BUFFER_USAGE_SHADER_BINDING_TABLE_BIT_KHR)

/* A write into a buffer that builds or traces may read. */
static void transfer(struct gn_device *device, VkCommandBuffer handle, const char *command, VkBuffer to, VkDeviceSize offset,
                     VkDeviceSize size)
{
    gn_lock(device);
    const struct gn_buffer *buffer = gn_map_get(&device->buffers, (uint64_t)to);
    struct gn_command_buffer *commands =
        buffer && (buffer->usage & RELEVANT) && buffer->address && offset < buffer->size ? gn_command_buffer_get(device, handle) : NULL;
    if (commands) {
        if (size > buffer->size - offset)
            size = buffer->size - offset;
        struct gn_access access = {.role = GN_ROLE_TRANSFER, .base = buffer->address + offset, .size = size};
        gn_command_buffer_access(device, commands, command, &access, 1);
    }
    gn_unlock(device);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdCopyBuffer(VkCommandBuffer handle, VkBuffer from, VkBuffer to, uint32_t count,
                                                  const VkBufferCopy *regions)
{
    struct gn_device *device = gn_device_of(handle);
    for (uint32_t i = 0; i < count; i++)
        transfer(device, handle, "vkCmdCopyBuffer", to, regions[i].dstOffset, regions[i].size);
    device->next.CmdCopyBuffer(handle, from, to, count, regions);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdCopyBuffer2(VkCommandBuffer handle, const VkCopyBufferInfo2 *info)
{
    struct gn_device *device = gn_device_of(handle);
    for (uint32_t i = 0; i < info->regionCount; i++)
        transfer(device, handle, "vkCmdCopyBuffer2", info->dstBuffer, info->pRegions[i].dstOffset, info->pRegions[i].size);
    device->next.CmdCopyBuffer2(handle, info);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdUpdateBuffer(VkCommandBuffer handle, VkBuffer to, VkDeviceSize offset, VkDeviceSize size,
                                                    const void *data)
{
    struct gn_device *device = gn_device_of(handle);
    transfer(device, handle, "vkCmdUpdateBuffer", to, offset, size);
    device->next.CmdUpdateBuffer(handle, to, offset, size, data);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdFillBuffer(VkCommandBuffer handle, VkBuffer to, VkDeviceSize offset, VkDeviceSize size,
                                                  uint32_t data)
{
    struct gn_device *device = gn_device_of(handle);
    transfer(device, handle, "vkCmdFillBuffer", to, offset, size);
    device->next.CmdFillBuffer(handle, to, offset, size, data);
}
