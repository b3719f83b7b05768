/* SPDX-License-Identifier: Apache-2.0 */
/* Two containers for object state: a hash map from a 64-bit key to a pointer, and a map of address ranges. Neither
 * locks: the owner does. Neither ends the process when memory runs out: insertion returns false. */
#ifndef GN_LAYER_MAP_H
#define GN_LAYER_MAP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct gn_map_slot {
    uint64_t key;
    void *value; /* NULL: the slot is free */
};

/* Zero-initialised is empty. Values must not be NULL. */
struct gn_map {
    struct gn_map_slot *slots;
    size_t capacity; /* 0 or a power of two */
    size_t count;
};

void gn_map_finish(struct gn_map *map);
void *gn_map_get(const struct gn_map *map, uint64_t key);
/* Replaces what the key held. */
bool gn_map_put(struct gn_map *map, uint64_t key, void *value);
/* Returns what the key held, NULL if nothing. */
void *gn_map_take(struct gn_map *map, uint64_t key);
/* Visits every entry in no particular order: start with *cursor = 0; NULL at the end. The map must not change in
 * between. */
void *gn_map_next(const struct gn_map *map, size_t *cursor);

/* A node of a range map, embedded in the object that owns the range [base, base + size). Ranges may overlap and
 * coincide. The tree is a treap whose nodes know the highest end below them, so that insertion, removal and a search cost
 * O(log n) with any number of ranges. */
struct gn_range {
    uint64_t base, size;
    uint64_t highest_end;
    uint32_t priority;
    struct gn_range *left, *right;
};

struct gn_ranges {
    struct gn_range *root;
    uint32_t seed;
};

/* size > 0, and base + size does not wrap. */
void gn_ranges_insert(struct gn_ranges *ranges, struct gn_range *node);
void gn_ranges_remove(struct gn_ranges *ranges, struct gn_range *node);
/* The highest end among the ranges that begin at or before `base`; 0 if there are none. Above `base`: that far some range around it
 * reaches. */
uint64_t gn_ranges_end(const struct gn_ranges *ranges, uint64_t base);
/* Whether some range around `address` is one that `match` accepts. */
bool gn_ranges_any(const struct gn_ranges *ranges, uint64_t address, bool (*match)(const struct gn_range *range, const void *context),
                   const void *context);
/* Visits every range that has a byte in common with [base, base + size); the ranges must not change in between. */
void gn_ranges_overlapping(const struct gn_ranges *ranges, uint64_t base, uint64_t size,
                           void (*visit)(struct gn_range *range, void *context), void *context);
/* A range that holds all of [base, base + size), NULL if there is none. */
struct gn_range *gn_ranges_holding(const struct gn_ranges *ranges, uint64_t base, uint64_t size);

#endif
