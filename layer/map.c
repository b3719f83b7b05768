/* SPDX-License-Identifier: Apache-2.0 */
/* Hash map with linear probing and backward-shift deletion; address ranges as a treap. */
#include "layer/map.h"

#include <stdlib.h>

static size_t slot_of(const struct gn_map *map, uint64_t key)
{
    key ^= key >> 32;
    key *= UINT64_C(0x9E3779B97F4A7C15);
    return (size_t)(key >> 20) & (map->capacity - 1);
}

void gn_map_finish(struct gn_map *map)
{
    free(map->slots);
    *map = (struct gn_map){0};
}

void *gn_map_get(const struct gn_map *map, uint64_t key)
{
    if (!map->count)
        return NULL;
    for (size_t i = slot_of(map, key); map->slots[i].value; i = (i + 1) & (map->capacity - 1))
        if (map->slots[i].key == key)
            return map->slots[i].value;
    return NULL;
}

static void place(struct gn_map *map, uint64_t key, void *value)
{
    size_t i = slot_of(map, key);
    while (map->slots[i].value && map->slots[i].key != key)
        i = (i + 1) & (map->capacity - 1);
    map->count += !map->slots[i].value;
    map->slots[i] = (struct gn_map_slot){key, value};
}

bool gn_map_put(struct gn_map *map, uint64_t key, void *value)
{
    if (map->count * 4 >= map->capacity * 3) {
        struct gn_map bigger = {.capacity = map->capacity ? map->capacity * 2 : 16};
        bigger.slots = calloc(bigger.capacity, sizeof *bigger.slots);
        if (!bigger.slots)
            return false;
        for (size_t i = 0; i < map->capacity; i++)
            if (map->slots[i].value)
                place(&bigger, map->slots[i].key, map->slots[i].value);
        free(map->slots);
        *map = bigger;
    }
    place(map, key, value);
    return true;
}

void *gn_map_take(struct gn_map *map, uint64_t key)
{
    if (!map->count)
        return NULL;
    size_t mask = map->capacity - 1, hole = slot_of(map, key);
    while (map->slots[hole].value && map->slots[hole].key != key)
        hole = (hole + 1) & mask;
    void *value = map->slots[hole].value;
    if (!value)
        return NULL;
    for (size_t i = (hole + 1) & mask; map->slots[i].value; i = (i + 1) & mask) {
        /* An entry may move into the hole unless its own slot lies behind the hole. */
        size_t distance = (i - slot_of(map, map->slots[i].key)) & mask;
        if (distance >= ((i - hole) & mask)) {
            map->slots[hole] = map->slots[i];
            hole = i;
        }
    }
    map->slots[hole].value = NULL;
    map->count--;
    return value;
}

void *gn_map_next(const struct gn_map *map, size_t *cursor)
{
    while (*cursor < map->capacity) {
        void *value = map->slots[(*cursor)++].value;
        if (value)
            return value;
    }
    return NULL;
}

static uint64_t end_of(const struct gn_range *node)
{
    return node->base + node->size;
}

static void refresh(struct gn_range *node)
{
    node->highest_end = end_of(node);
    if (node->left && node->left->highest_end > node->highest_end)
        node->highest_end = node->left->highest_end;
    if (node->right && node->right->highest_end > node->highest_end)
        node->highest_end = node->right->highest_end;
}

/* A total order even among equal ranges, so that removal finds its node. */
static bool comes_before(const struct gn_range *a, const struct gn_range *b)
{
    return a->base != b->base ? a->base < b->base : (uintptr_t)a < (uintptr_t)b;
}

static void split(struct gn_range *tree, const struct gn_range *at, struct gn_range **low, struct gn_range **high)
{
    if (!tree) {
        *low = *high = NULL;
    } else if (comes_before(tree, at)) {
        split(tree->right, at, &tree->right, high);
        refresh(tree);
        *low = tree;
    } else {
        split(tree->left, at, low, &tree->left);
        refresh(tree);
        *high = tree;
    }
}

static struct gn_range *merge(struct gn_range *low, struct gn_range *high)
{
    if (!low || !high)
        return low ? low : high;
    if (low->priority > high->priority) {
        low->right = merge(low->right, high);
        refresh(low);
        return low;
    }
    high->left = merge(low, high->left);
    refresh(high);
    return high;
}

void gn_ranges_insert(struct gn_ranges *ranges, struct gn_range *node)
{
    /* xorshift: the priorities only have to be independent of the addresses. */
    uint32_t seed = ranges->seed ? ranges->seed : UINT32_C(2463534242);
    seed ^= seed << 13;
    seed ^= seed >> 17;
    seed ^= seed << 5;
    node->priority = ranges->seed = seed;
    node->left = node->right = NULL;
    refresh(node);

    struct gn_range *low, *high;
    split(ranges->root, node, &low, &high);
    ranges->root = merge(merge(low, node), high);
}

static struct gn_range *without(struct gn_range *tree, const struct gn_range *node)
{
    if (!tree)
        return NULL;
    if (tree == node)
        return merge(tree->left, tree->right);
    if (comes_before(node, tree))
        tree->left = without(tree->left, node);
    else
        tree->right = without(tree->right, node);
    refresh(tree);
    return tree;
}

void gn_ranges_remove(struct gn_ranges *ranges, struct gn_range *node)
{
    ranges->root = without(ranges->root, node);
}

/* Whatever ends too low is cut off by highest_end; whatever starts too high lies to the right. */
static struct gn_range *holding(struct gn_range *tree, uint64_t base, uint64_t end)
{
    if (!tree || tree->highest_end < end)
        return NULL;
    if (tree->base > base)
        return holding(tree->left, base, end);
    if (end_of(tree) >= end)
        return tree;
    struct gn_range *found = holding(tree->right, base, end);
    return found ? found : holding(tree->left, base, end);
}

struct gn_range *gn_ranges_holding(const struct gn_ranges *ranges, uint64_t base, uint64_t size)
{
    return base + size < base ? NULL : holding(ranges->root, base, base + size);
}

uint64_t gn_ranges_end(const struct gn_ranges *ranges, uint64_t base)
{
    uint64_t end = 0;
    for (const struct gn_range *node = ranges->root; node;) {
        if (node->base > base) {
            node = node->left;
            continue;
        }
        if (end_of(node) > end)
            end = end_of(node);
        if (node->left && node->left->highest_end > end)
            end = node->left->highest_end;
        node = node->right;
    }
    return end;
}

static bool any(const struct gn_range *tree, uint64_t address, bool (*match)(const struct gn_range *range, const void *context),
                const void *context)
{
    if (!tree || tree->highest_end <= address)
        return false;
    if (tree->base <= address && ((end_of(tree) > address && match(tree, context)) || any(tree->right, address, match, context)))
        return true;
    return any(tree->left, address, match, context);
}

bool gn_ranges_any(const struct gn_ranges *ranges, uint64_t address, bool (*match)(const struct gn_range *range, const void *context),
                   const void *context)
{
    return any(ranges->root, address, match, context);
}

static void overlapping(struct gn_range *tree, uint64_t base, uint64_t end, void (*visit)(struct gn_range *range, void *context),
                        void *context)
{
    if (!tree || tree->highest_end <= base)
        return;
    overlapping(tree->left, base, end, visit, context);
    if (tree->base >= end)
        return;
    if (end_of(tree) > base)
        visit(tree, context);
    overlapping(tree->right, base, end, visit, context);
}

void gn_ranges_overlapping(const struct gn_ranges *ranges, uint64_t base, uint64_t size,
                           void (*visit)(struct gn_range *range, void *context), void *context)
{
    if (base + size > base)
        overlapping(ranges->root, base, base + size, visit, context);
}
