/* SPDX-License-Identifier: Apache-2.0 */
/* Chains of structures, see layer.h. */
#include "layer/layer.h"

#include <string.h>

static const struct {
    VkStructureType type;
    size_t size;
} sizes[] = {
#define GN_CHAIN(type, structure) {VK_STRUCTURE_TYPE_##type, sizeof(Vk##structure)},
#include "layer/chain.def"
};

static size_t size_of(VkStructureType type)
{
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++)
        if (sizes[i].type == type)
            return sizes[i].size;
    return 0;
}

const void *gn_chain_find(const void *chain, VkStructureType type)
{
    for (const VkBaseInStructure *in = chain; in; in = in->pNext)
        if (in->sType == type)
            return in;
    return NULL;
}

void *gn_chain_copy(const void **chain, VkStructureType type, struct gn_chain_copy *storage)
{
    const void *head = *chain;
    const void **link = &head;
    for (const VkBaseInStructure *in = *chain; in; in = in->pNext) {
        size_t size = size_of(in->sType);
        if (!size || storage->used + size > sizeof storage->bytes)
            return NULL;
        VkBaseInStructure *copy = (VkBaseInStructure *)(void *)((unsigned char *)storage->bytes + storage->used);
        memcpy(copy, in, size);
        *link = copy;
        link = (const void **)&copy->pNext;
        storage->used += (size + 7) & ~(size_t)7;
        if (in->sType == type) {
            *chain = head;
            return copy; /* the rest is the application's, unchanged */
        }
    }
    return NULL;
}
