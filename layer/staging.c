/* SPDX-License-Identifier: Apache-2.0 */
/* Host-visible memory for what the GPU copies for the layer. Small pieces share blocks, in which space is only handed
 * out upwards; a block starts afresh when its last piece came back. */
#include "layer/layer.h"

#include <stdlib.h>

#define BLOCK_SIZE ((VkDeviceSize)1 << 20)
#define PIECE_ALIGNMENT ((VkDeviceSize)64)
/* Blocks without a piece are kept up to this sum: a frame loop that records its TLAS build anew allocates nothing. */
#define IDLE_LIMIT ((VkDeviceSize)256 << 20)

struct gn_staging_block {
    VkBuffer buffer;
    VkDeviceMemory memory;
    unsigned char *mapped;
    VkDeviceSize size, used;
    uint32_t live;
    struct gn_staging_block *next;
};

static void block_free(struct gn_device *device, struct gn_staging_block *block)
{
    if (block->buffer)
        device->next.DestroyBuffer(device->handle, block->buffer, NULL);
    if (block->memory)
        device->next.FreeMemory(device->handle, block->memory, NULL);
    free(block);
}

/* Coherent memory always exists; cached memory is read many times faster where there is some. */
static uint32_t memory_type(const struct gn_device *device, uint32_t allowed)
{
    const VkMemoryPropertyFlags coherent = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    const VkMemoryPropertyFlags tries[] = {coherent | VK_MEMORY_PROPERTY_HOST_CACHED_BIT, coherent};
    for (int t = 0; t < 2; t++)
        for (uint32_t i = 0; i < device->memory.memoryTypeCount; i++)
            if ((allowed >> i & 1) && (device->memory.memoryTypes[i].propertyFlags & tries[t]) == tries[t])
                return i;
    return UINT32_MAX;
}

static struct gn_staging_block *block_create(struct gn_device *device, VkDeviceSize size)
{
    struct gn_staging_block *block = calloc(1, sizeof *block);
    if (!block)
        return NULL;
    block->size = size;
    VkBufferCreateInfo buffer = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                                 .size = size,
                                 .usage = VK_BUFFER_USAGE_TRANSFER_DST_BIT,
                                 .sharingMode = device->family_count > 1 ? VK_SHARING_MODE_CONCURRENT
                                                                         : VK_SHARING_MODE_EXCLUSIVE,
                                 .queueFamilyIndexCount = device->family_count,
                                 .pQueueFamilyIndices = device->families};
    if (device->next.CreateBuffer(device->handle, &buffer, NULL, &block->buffer) != VK_SUCCESS)
        goto fail;
    VkMemoryRequirements needs;
    device->next.GetBufferMemoryRequirements(device->handle, block->buffer, &needs);
    VkMemoryAllocateInfo memory = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
                                   .allocationSize = needs.size,
                                   .memoryTypeIndex = memory_type(device, needs.memoryTypeBits)};
    void *mapped = NULL;
    if (memory.memoryTypeIndex == UINT32_MAX ||
        device->next.AllocateMemory(device->handle, &memory, NULL, &block->memory) != VK_SUCCESS ||
        device->next.BindBufferMemory(device->handle, block->buffer, block->memory, 0) != VK_SUCCESS ||
        device->next.MapMemory(device->handle, block->memory, 0, VK_WHOLE_SIZE, 0, &mapped) != VK_SUCCESS)
        goto fail;
    block->mapped = mapped;
    return block;
fail:
    block_free(device, block);
    return NULL;
}

bool gn_staging_take(struct gn_device *device, VkDeviceSize size, struct gn_capture *out)
{
    struct gn_staging_block *block = device->blocks;
    size = (size + PIECE_ALIGNMENT - 1) & ~(PIECE_ALIGNMENT - 1);
    while (block && block->size - block->used < size)
        block = block->next;
    if (!block) {
        block = block_create(device, size > BLOCK_SIZE ? size : BLOCK_SIZE);
        if (!block)
            return false;
        block->next = device->blocks;
        device->blocks = block;
        device->idle_staging += block->size;
    }
    if (block->live++ == 0)
        device->idle_staging -= block->size;
    out->block = block;
    out->offset = block->used;
    out->records = (const struct gn_instance_record *)(const void *)(block->mapped + block->used);
    block->used += size;
    return true;
}

VkBuffer gn_staging_buffer(const struct gn_capture *capture)
{
    return capture->block->buffer;
}

void gn_staging_give(struct gn_device *device, const struct gn_capture *capture)
{
    struct gn_staging_block *block = capture->block;
    if (--block->live)
        return;
    block->used = 0;
    device->idle_staging += block->size;
    if (device->idle_staging <= IDLE_LIMIT)
        return;
    for (struct gn_staging_block **link = &device->blocks; *link; link = &(*link)->next)
        if (*link == block) {
            *link = block->next;
            break;
        }
    device->idle_staging -= block->size;
    block_free(device, block);
}

void gn_staging_finish(struct gn_device *device)
{
    for (struct gn_staging_block *block = device->blocks, *next; block; block = next) {
        next = block->next;
        block_free(device, block);
    }
    device->blocks = NULL;
}
