/* SPDX-License-Identifier: Apache-2.0 */
/* Device memory in pools: few allocations, however many structures a scene has. */
#include "cts/device_internal.h"

#include <stdlib.h>
#include <string.h>

#define CHUNK_BYTES ((VkDeviceSize)1 << 20)

struct gn_memory_chunk {
    struct gn_memory_chunk *previous;
    VkBuffer buffer;
    VkDeviceMemory memory;
    VkDeviceAddress address;
    uint8_t *mapped;
    VkDeviceSize size, used;
};

struct kind_traits {
    VkBufferUsageFlags usage;
    VkMemoryPropertyFlags required, preferred;
};

static const struct kind_traits traits[GN_MEMORY_KIND_COUNT] = {
    [GN_MEMORY_INPUT] = {VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR,
                         VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT,
                         VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT},
    [GN_MEMORY_STRUCTURE] = {VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR |
                                 VK_BUFFER_USAGE_TRANSFER_DST_BIT,
                             0, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT},
    [GN_MEMORY_HOST_STRUCTURE] = {VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR |
                                      VK_BUFFER_USAGE_TRANSFER_DST_BIT,
                                  VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT,
                                  VK_MEMORY_PROPERTY_HOST_CACHED_BIT},
    [GN_MEMORY_SCRATCH] = {VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT, 0,
                           VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT},
    [GN_MEMORY_HOST] = {VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_SRC_BIT |
                            VK_BUFFER_USAGE_TRANSFER_DST_BIT,
                        VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT,
                        VK_MEMORY_PROPERTY_HOST_CACHED_BIT},
    [GN_MEMORY_TABLE] = {VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT,
                         VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT,
                         VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT},
};

/* The first memory type that has everything preferred, else the first that has what is required. */
static bool memory_type_find(const struct gn_device *device, uint32_t allowed, const struct kind_traits *kind,
                             uint32_t *out_index)
{
    const VkMemoryPropertyFlags wishes[] = {kind->required | kind->preferred, kind->required};
    for (size_t w = 0; w < 2; w++) {
        for (uint32_t i = 0; i < device->memory.memoryTypeCount; i++) {
            if ((allowed >> i & 1u) && (device->memory.memoryTypes[i].propertyFlags & wishes[w]) == wishes[w]) {
                *out_index = i;
                return true;
            }
        }
    }
    return false;
}

static void chunk_destroy(struct gn_device *device, struct gn_memory_chunk *chunk)
{
    if (!chunk) {
        return;
    }
    /* A device that still runs may touch its memory: then it is left to the end of the process. */
    if (!device->lost) {
        vkDestroyBuffer(device->handle, chunk->buffer, NULL);
        vkFreeMemory(device->handle, chunk->memory, NULL);
    }
    free(chunk);
}

static enum gn_device_status chunk_create(struct gn_device *device, enum gn_memory_kind kind, VkDeviceSize size,
                                          struct gn_memory_chunk **out_chunk)
{
    enum gn_device_status status = GN_DEVICE_OK;
    struct gn_memory_chunk *chunk = calloc(1, sizeof *chunk);
    if (!chunk) {
        return gn_device_fail(device, GN_DEVICE_FAILED, "no host memory for a chunk of device memory");
    }
    chunk->size = size;

    const VkBufferCreateInfo buffer_info = {
        .sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
        .size = size,
        .usage = traits[kind].usage | VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT |
                 (kind == GN_MEMORY_TABLE && device->info.ray_tracing_pipeline
                      ? VK_BUFFER_USAGE_SHADER_BINDING_TABLE_BIT_KHR
                      : 0),
        .sharingMode = VK_SHARING_MODE_EXCLUSIVE,
    };
    VkResult result = vkCreateBuffer(device->handle, &buffer_info, NULL, &chunk->buffer);
    if ((status = gn_device_check(device, result, "vkCreateBuffer")) != GN_DEVICE_OK) {
        goto fail;
    }
    VkMemoryRequirements needs;
    vkGetBufferMemoryRequirements(device->handle, chunk->buffer, &needs);
    if (needs.size > device->max_allocation) {
        status = gn_device_fail(device, GN_DEVICE_UNSUPPORTED,
                                "the scene needs %llu bytes in one piece, the device allocates at most %llu",
                                (unsigned long long)needs.size, (unsigned long long)device->max_allocation);
        goto fail;
    }
    uint32_t type = 0;
    if (!memory_type_find(device, needs.memoryTypeBits, &traits[kind], &type)) {
        status = gn_device_fail(device, GN_DEVICE_FAILED, "no memory type fits buffers with usage 0x%x",
                                (unsigned)buffer_info.usage);
        goto fail;
    }
    const VkMemoryAllocateFlagsInfo flags_info = {
        .sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO,
        .flags = VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT,
    };
    const VkMemoryAllocateInfo allocate_info = {
        .sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
        .pNext = &flags_info,
        .allocationSize = needs.size,
        .memoryTypeIndex = type,
    };
    result = vkAllocateMemory(device->handle, &allocate_info, NULL, &chunk->memory);
    if ((status = gn_device_check(device, result, "vkAllocateMemory")) != GN_DEVICE_OK) {
        goto fail;
    }
    result = vkBindBufferMemory(device->handle, chunk->buffer, chunk->memory, 0);
    if ((status = gn_device_check(device, result, "vkBindBufferMemory")) != GN_DEVICE_OK) {
        goto fail;
    }
    if (traits[kind].required & VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT) {
        void *mapped = NULL;
        result = vkMapMemory(device->handle, chunk->memory, 0, VK_WHOLE_SIZE, 0, &mapped);
        if ((status = gn_device_check(device, result, "vkMapMemory")) != GN_DEVICE_OK) {
            goto fail;
        }
        chunk->mapped = mapped;
    }
    const VkBufferDeviceAddressInfo address_info = {
        .sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO,
        .buffer = chunk->buffer,
    };
    chunk->address = vkGetBufferDeviceAddress(device->handle, &address_info);
    *out_chunk = chunk;
    return GN_DEVICE_OK;

fail:
    chunk_destroy(device, chunk);
    return status;
}

/* Where in the chunk a piece would begin; false when it does not fit. */
static bool chunk_place(const struct gn_memory_chunk *chunk, enum gn_memory_kind kind, VkDeviceSize size,
                        VkDeviceSize alignment, VkDeviceSize *out_offset)
{
    /* Structures are placed by their offset in the buffer, everything else by its device address. */
    const bool structure = kind == GN_MEMORY_STRUCTURE || kind == GN_MEMORY_HOST_STRUCTURE;
    const VkDeviceSize base = structure ? 0 : chunk->address;
    const VkDeviceSize offset = ((base + chunk->used + alignment - 1) & ~(alignment - 1)) - base;
    if (offset > chunk->size || size > chunk->size - offset) {
        return false;
    }
    *out_offset = offset;
    return true;
}

enum gn_device_status gn_pool_take(struct gn_device *device, struct gn_pool *pool, VkDeviceSize size,
                                   VkDeviceSize alignment, struct gn_memory *out_memory)
{
    VkDeviceSize offset = 0;
    VkDeviceSize wanted = 0;
    /* Whole words, because fills count in them; and room for the alignment in a chunk of its own. */
    if (__builtin_add_overflow(size, (VkDeviceSize)15 + alignment, &wanted)) {
        return gn_device_fail(device, GN_DEVICE_UNSUPPORTED, "a piece of %llu bytes is too large",
                              (unsigned long long)size);
    }
    wanted = size == 0 ? 16 : (size + 15) & ~(VkDeviceSize)15;
    if (!pool->last || !chunk_place(pool->last, pool->kind, wanted, alignment, &offset)) {
        VkDeviceSize chunk_size = CHUNK_BYTES;
        if (pool->last && chunk_size < pool->last->size && pool->last->size <= CHUNK_BYTES * 64) {
            chunk_size = pool->last->size * 2;
        }
        if (chunk_size < wanted + alignment) {
            chunk_size = wanted + alignment;
        }
        struct gn_memory_chunk *chunk = NULL;
        const enum gn_device_status status = chunk_create(device, pool->kind, chunk_size, &chunk);
        if (status != GN_DEVICE_OK) {
            return status;
        }
        chunk->previous = pool->last;
        pool->last = chunk;
        chunk_place(chunk, pool->kind, wanted, alignment, &offset);
    }
    struct gn_memory_chunk *chunk = pool->last;
    chunk->used = offset + wanted;
    pool->bytes += wanted;
    *out_memory = (struct gn_memory){
        .buffer = chunk->buffer,
        .offset = offset,
        .size = wanted,
        .address = chunk->address + offset,
        .mapped = chunk->mapped ? chunk->mapped + offset : NULL,
    };
    return GN_DEVICE_OK;
}

void gn_pool_poison(struct gn_pool *pool)
{
    for (struct gn_memory_chunk *chunk = pool->last; chunk; chunk = chunk->previous) {
        memset(chunk->mapped, 0xFF, chunk->used);
    }
}

void gn_pool_finish(struct gn_device *device, struct gn_pool *pool)
{
    while (pool->last) {
        struct gn_memory_chunk *previous = pool->last->previous;
        chunk_destroy(device, pool->last);
        pool->last = previous;
    }
    pool->bytes = 0;
}
