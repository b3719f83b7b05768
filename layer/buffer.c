/* SPDX-License-Identifier: Apache-2.0 */
/* Buffers that can hold the input of a build. They get transfer usage, so that the records in them can be copied when the
 * GPU reads them; every question about the memory of such a buffer is asked with the same usage. */
#include "layer/layer.h"

#include <stdlib.h>

#define BUILD_INPUT VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR
#define STORAGE VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR
#define ADDRESS VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT
#define TABLE VK_BUFFER_USAGE_SHADER_BINDING_TABLE_BIT_KHR
#define INDIRECT VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT
#define COPY_FROM VK_BUFFER_USAGE_TRANSFER_SRC_BIT

/* A creation info with transfer usage added, in storage of its own. */
struct patched {
    VkBufferCreateInfo info;
    VkBufferUsageFlags2 usage; /* as asked by the application */
    bool changed;
    bool can_copy;
    bool external;
    struct gn_chain_copy chain;
};

static bool copy_chain(struct patched *out)
{
    out->chain.used = 0;
    VkBufferUsageFlags2CreateInfo *usage =
        gn_chain_copy(&out->info.pNext, VK_STRUCTURE_TYPE_BUFFER_USAGE_FLAGS_2_CREATE_INFO, &out->chain);
    if (usage)
        usage->usage |= COPY_FROM;
    return usage != NULL;
}

/* Memory shared with another API or process must be described the same on both sides: such a buffer stays as it is. */
static void patch(const VkBufferCreateInfo *info, struct patched *out)
{
    const VkBufferUsageFlags2CreateInfo *wide =
        gn_chain_find(info->pNext, VK_STRUCTURE_TYPE_BUFFER_USAGE_FLAGS_2_CREATE_INFO);
    const VkExternalMemoryBufferCreateInfo *external =
        gn_chain_find(info->pNext, VK_STRUCTURE_TYPE_EXTERNAL_MEMORY_BUFFER_CREATE_INFO);
    out->info = *info;
    out->usage = wide ? wide->usage : info->usage;
    out->changed = false;
    out->can_copy = (out->usage & COPY_FROM) != 0;
    out->external = external && external->handleTypes;
    bool read = (out->usage & (BUILD_INPUT | TABLE)) || ((out->usage & INDIRECT) && (out->usage & ADDRESS));
    if (out->can_copy || !read || out->external ||
        (info->flags & VK_BUFFER_CREATE_PROTECTED_BIT))
        return;
    if (wide && !copy_chain(out))
        return;
    if (!wide)
        out->info.usage |= COPY_FROM;
    out->changed = out->can_copy = true;
}

/* With the device locked. An address can be asked once memory is bound; a sparse buffer has one from the start. */
static void buffer_gains_address(struct gn_device *device, struct gn_buffer *buffer)
{
    if (buffer->bound)
        return;
    buffer->bound = true;
    if (!buffer->has_address || !device->next.GetBufferDeviceAddress)
        return;
    VkBufferDeviceAddressInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO, .buffer = buffer->handle};
    buffer->address = device->next.GetBufferDeviceAddress(device->handle, &info);
    if (buffer->address + buffer->size < buffer->address)
        buffer->address = 0;
    buffer->range.base = buffer->address;
    buffer->range.size = buffer->size;
    if (buffer->range.base && buffer->range.base + buffer->range.size > buffer->range.base)
        gn_ranges_insert(buffer->build_input ? &device->inputs : &device->others, &buffer->range);
    else
        buffer->range.size = 0;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateBuffer(VkDevice handle, const VkBufferCreateInfo *info,
                                                     const VkAllocationCallbacks *allocator, VkBuffer *out)
{
    struct gn_device *device = gn_device_of(handle);
    struct patched patched;
    patch(info, &patched);
    VkResult result =
        device->next.CreateBuffer(handle, patched.changed ? &patched.info : info, allocator, out);
    if (result != VK_SUCCESS || !(patched.usage & (BUILD_INPUT | STORAGE | ADDRESS)))
        return result;

    struct gn_buffer *buffer = calloc(1, sizeof *buffer);
    if (!buffer) {
        gn_tally_lost(device);
        return result;
    }
    *buffer = (struct gn_buffer){.handle = *out,
                                 .size = info->size,
                                 .usage = patched.usage,
                                 .has_address = (patched.usage & ADDRESS) != 0,
                                 .build_input = (patched.usage & BUILD_INPUT) != 0,
                                 .storage = (patched.usage & STORAGE) != 0,
                                 .can_copy = patched.can_copy,
                                 .external = patched.external};
    gn_lock(device);
    if (!gn_map_put(&device->buffers, (uint64_t)*out, buffer)) {
        free(buffer);
        gn_tally_lost(device);
    } else if (info->flags & VK_BUFFER_CREATE_SPARSE_BINDING_BIT) {
        buffer_gains_address(device, buffer);
    }
    gn_unlock(device);
    return result;
}

void gn_buffer_holds(struct gn_buffer *buffer, struct gn_as *as)
{
    as->buffer = buffer;
    as->buffer_next = buffer->first_structure;
    as->buffer_previous = NULL;
    if (as->buffer_next)
        as->buffer_next->buffer_previous = as;
    buffer->first_structure = as;
}

void gn_buffer_lets_go(struct gn_as *as)
{
    if (!as->buffer)
        return;
    if (as->buffer_previous)
        as->buffer_previous->buffer_next = as->buffer_next;
    else
        as->buffer->first_structure = as->buffer_next;
    if (as->buffer_next)
        as->buffer_next->buffer_previous = as->buffer_previous;
    as->buffer = NULL;
}

/* The structures in the buffer have no memory any more. */
static void structures_lose(struct gn_device *device, struct gn_buffer *buffer)
{
    uint64_t position = buffer->first_structure ? ++device->position : 0;
    for (struct gn_as *as = buffer->first_structure; as; as = as->buffer_next) {
        if (!as->storage_gone && as->writes && as->levels != GN_LEVEL_TOP)
            gn_change_add(device, as, GN_CHANGE_STORAGE_GONE, GN_QUEUE_HOST, position);
        as->storage_gone = true;
    }
}

static void memory_leave(struct gn_device *device, struct gn_buffer *buffer)
{
    if (!buffer->memory)
        return;
    if (buffer->memory_previous)
        buffer->memory_previous->memory_next = buffer->memory_next;
    else if (buffer->memory_next)
        gn_map_put(&device->memories, (uint64_t)buffer->memory, buffer->memory_next);
    else
        gn_map_take(&device->memories, (uint64_t)buffer->memory);
    if (buffer->memory_next)
        buffer->memory_next->memory_previous = buffer->memory_previous;
    buffer->memory = VK_NULL_HANDLE;
}

static void memory_enter(struct gn_device *device, struct gn_buffer *buffer, VkDeviceMemory memory)
{
    if (buffer->memory || !buffer->storage || !memory)
        return;
    struct gn_buffer *head = gn_map_get(&device->memories, (uint64_t)memory);
    if (!gn_map_put(&device->memories, (uint64_t)memory, buffer))
        return; /* a memory that is freed too early goes unnoticed */
    buffer->memory = memory;
    buffer->memory_next = head;
    buffer->memory_previous = NULL;
    if (head)
        head->memory_previous = buffer;
}

VKAPI_ATTR void VKAPI_CALL gn_entry_FreeMemory(VkDevice handle, VkDeviceMemory memory, const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    struct gn_buffer *buffer = memory ? gn_map_take(&device->memories, (uint64_t)memory) : NULL;
    for (struct gn_buffer *next; buffer; buffer = next) {
        next = buffer->memory_next;
        buffer->memory = VK_NULL_HANDLE;
        structures_lose(device, buffer);
    }
    gn_unlock(device);
    device->next.FreeMemory(handle, memory, allocator);
}

static void buffer_free(struct gn_device *device, struct gn_buffer *buffer)
{
    if (!buffer)
        return;
    memory_leave(device, buffer);
    structures_lose(device, buffer);
    while (buffer->first_structure)
        gn_buffer_lets_go(buffer->first_structure);
    if (buffer->range.size)
        gn_ranges_remove(buffer->build_input ? &device->inputs : &device->others, &buffer->range);
    free(buffer->name);
    free(buffer);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyBuffer(VkDevice handle, VkBuffer buffer,
                                                  const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    if (buffer) {
        gn_lock(device);
        struct gn_buffer *known = gn_map_take(&device->buffers, (uint64_t)buffer);
        device->buffers_gone += known != NULL;
        buffer_free(device, known);
        gn_unlock(device);
    }
    device->next.DestroyBuffer(handle, buffer, allocator);
}

static void buffer_bound(struct gn_device *device, VkBuffer handle, VkDeviceMemory memory)
{
    gn_lock(device);
    struct gn_buffer *buffer = gn_map_get(&device->buffers, (uint64_t)handle);
    if (buffer) {
        memory_enter(device, buffer, memory);
        buffer_gains_address(device, buffer);
    }
    gn_unlock(device);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_BindBufferMemory(VkDevice handle, VkBuffer buffer, VkDeviceMemory memory,
                                                         VkDeviceSize offset)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.BindBufferMemory(handle, buffer, memory, offset);
    if (result == VK_SUCCESS)
        buffer_bound(device, buffer, memory);
    return result;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_BindBufferMemory2(VkDevice handle, uint32_t count,
                                                          const VkBindBufferMemoryInfo *infos)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.BindBufferMemory2(handle, count, infos);
    if (result == VK_SUCCESS)
        for (uint32_t i = 0; i < count; i++)
            buffer_bound(device, infos[i].buffer, infos[i].memory);
    return result;
}

VKAPI_ATTR void VKAPI_CALL gn_entry_GetDeviceBufferMemoryRequirements(VkDevice handle,
                                                                      const VkDeviceBufferMemoryRequirements *info,
                                                                      VkMemoryRequirements2 *out)
{
    struct gn_device *device = gn_device_of(handle);
    struct patched patched;
    patch(info->pCreateInfo, &patched);
    VkDeviceBufferMemoryRequirements asked = *info;
    asked.pCreateInfo = patched.changed ? &patched.info : info->pCreateInfo;
    device->next.GetDeviceBufferMemoryRequirements(handle, &asked, out);
}

static struct gn_buffer *holding(const struct gn_ranges *ranges, uint64_t address, uint64_t size)
{
    struct gn_range *range = gn_ranges_holding(ranges, address, size);
    return range ? (struct gn_buffer *)(void *)((char *)range - offsetof(struct gn_buffer, range)) : NULL;
}

struct gn_buffer *gn_buffer_holding(struct gn_device *device, uint64_t address, uint64_t size)
{
    return holding(&device->inputs, address, size);
}

static bool has_usage(const struct gn_range *range, const void *usage)
{
    const struct gn_buffer *buffer = (const struct gn_buffer *)(const void *)((const char *)range - offsetof(struct gn_buffer, range));
    return (buffer->usage & *(const VkBufferUsageFlags2 *)usage) != 0;
}

bool gn_buffer_has_usage(struct gn_device *device, uint64_t address, VkBufferUsageFlags2 usage, struct gn_buffer **out_known)
{
    *out_known = gn_buffer_holding(device, address, 1);
    if (!*out_known)
        *out_known = gn_buffer_other(device, address, 1);
    return gn_ranges_any(&device->inputs, address, has_usage, &usage) || gn_ranges_any(&device->others, address, has_usage, &usage);
}

uint64_t gn_buffers_end(const struct gn_device *device, uint64_t address)
{
    uint64_t end = gn_ranges_end(&device->inputs, address), other = gn_ranges_end(&device->others, address);
    return end > other ? end : other;
}

struct gn_buffer *gn_buffer_other(struct gn_device *device, uint64_t address, uint64_t size)
{
    return holding(&device->others, address, size);
}

void gn_buffers_finish(struct gn_device *device)
{
    size_t cursor = 0;
    struct gn_buffer *buffer;
    while ((buffer = gn_map_next(&device->buffers, &cursor))) {
        free(buffer->name);
        free(buffer);
    }
    gn_map_finish(&device->buffers);
    gn_map_finish(&device->memories);
    device->inputs.root = device->others.root = NULL;
}
