/* SPDX-License-Identifier: Apache-2.0 */
/* Query pools for compacted sizes: which structure, and what it held, each answer belongs to. */
#include "layer/layer.h"

#include <stdlib.h>
#include <string.h>

struct gn_query_pool *gn_query_pool_get(struct gn_device *device, VkQueryPool handle)
{
    return gn_map_get(&device->query_pools, (uint64_t)handle);
}

struct gn_query_pool *gn_query_pool_keep(struct gn_query_pool *pool)
{
    if (pool)
        pool->references++;
    return pool;
}

void gn_query_pool_release(struct gn_query_pool *pool)
{
    if (!pool || --pool->references)
        return;
    for (uint32_t i = 0; i < pool->count; i++)
        gn_as_release(pool->slots[i].as);
    free(pool);
}

void gn_query_asked(struct gn_query_pool *pool, uint32_t index, struct gn_as *as)
{
    as->size_asked_of = as->generation;
    if (!pool || index >= pool->count)
        return;
    struct gn_query_slot *slot = &pool->slots[index];
    bool unread = slot->as != NULL;
    gn_as_release(slot->as);
    *slot = (struct gn_query_slot){.as = gn_as_keep(as), .generation = as->generation, .ambiguous = unread};
}

void gn_query_pools_finish(struct gn_device *device)
{
    size_t cursor = 0;
    struct gn_query_pool *pool;
    while ((pool = gn_map_next(&device->query_pools, &cursor)))
        gn_query_pool_release(pool);
    gn_map_finish(&device->query_pools);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateQueryPool(VkDevice handle, const VkQueryPoolCreateInfo *info,
                                                        const VkAllocationCallbacks *allocator, VkQueryPool *out)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.CreateQueryPool(handle, info, allocator, out);
    if (result != VK_SUCCESS || info->queryType != VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR)
        return result;
    struct gn_query_pool *pool = calloc(1, sizeof *pool + (size_t)info->queryCount * sizeof pool->slots[0]);
    gn_lock(device);
    if (pool)
        *pool = (struct gn_query_pool){.handle = *out, .references = 1, .count = info->queryCount};
    if (!pool || !gn_map_put(&device->query_pools, (uint64_t)*out, pool)) {
        free(pool);
        gn_tally_lost(device);
    }
    gn_unlock(device);
    return result;
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyQueryPool(VkDevice handle, VkQueryPool pool,
                                                     const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    if (pool) {
        gn_lock(device);
        gn_query_pool_release(gn_map_take(&device->query_pools, (uint64_t)pool));
        gn_unlock(device);
    }
    device->next.DestroyQueryPool(handle, pool, allocator);
}

static void learn_size(struct gn_query_slot *slot, const unsigned char *data, bool wide)
{
    uint64_t size = 0;
    uint32_t narrow = 0;
    if (wide)
        memcpy(&size, data, sizeof size);
    else
        memcpy(&narrow, data, sizeof narrow);
    if (slot->as && !slot->ambiguous) {
        slot->as->compacted_size = wide ? size : narrow;
        slot->as->compacted_size_of = slot->generation;
    }
    gn_as_release(slot->as);
    *slot = (struct gn_query_slot){0};
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_GetQueryPoolResults(VkDevice handle, VkQueryPool pool, uint32_t first, uint32_t count,
                                                            size_t data_size, void *data, VkDeviceSize stride,
                                                            VkQueryResultFlags flags)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.GetQueryPoolResults(handle, pool, first, count, data_size, data, stride, flags);
    /* Success without the partial bit: every answer is there. */
    if (result != VK_SUCCESS || (flags & VK_QUERY_RESULT_PARTIAL_BIT))
        return result;
    gn_host_saw_all(device);
    bool wide = (flags & VK_QUERY_RESULT_64_BIT) != 0;
    gn_lock(device);
    struct gn_query_pool *known = gn_query_pool_get(device, pool);
    for (uint32_t i = 0; known && i < count && first < known->count && i < known->count - first; i++)
        learn_size(&known->slots[first + i], (const unsigned char *)data + i * stride, wide);
    gn_unlock(device);
    return result;
}
