/* SPDX-License-Identifier: Apache-2.0 */
/* What a TLAS was built from, and what became of it since: the BLASes of the last build that was judged, and a log of what happens to
 * BLASes, so that a look at a TLAS costs as much as has changed, not as much as it holds. */
#include "layer/layer.h"

#include <stdlib.h>
#include <string.h>

#define MOST_CHANGES 65536u

void gn_members_free(struct gn_members *members)
{
    if (!members)
        return;
    for (uint32_t i = 0; i < members->count; i++)
        gn_as_release(members->structures[i]);
    gn_map_finish(&members->index);
    free(members->structures);
    free(members);
}

/* The first change after `position`; changes are in the order of positions. */
static uint64_t first_after(const struct gn_changes *changes, uint64_t position)
{
    uint32_t low = 0, high = changes->count;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (changes->list[middle].position > position)
            high = middle;
        else
            low = middle + 1;
    }
    return changes->dropped + low;
}

void gn_members_set(struct gn_device *device, struct gn_as *tlas, uint64_t version, uint32_t queue, uint64_t position,
                    const struct gn_as *const *structures, uint32_t count)
{
    if (tlas->members && tlas->members->version > version)
        return;
    struct gn_members *members = calloc(1, sizeof *members);
    if (!members)
        goto fail;
    *members = (struct gn_members){.version = version, .queue = queue, .position = position};
    members->structures = malloc((count ? count : 1) * sizeof *members->structures);
    if (!members->structures)
        goto fail;
    for (uint32_t i = 0; i < count; i++) {
        struct gn_as *as = (struct gn_as *)(uintptr_t)structures[i];
        members->structures[members->count++] = gn_as_keep(as);
        if (!gn_map_put(&members->index, as->id, (void *)(uintptr_t)(i + 1)))
            goto fail;
    }
    members->next_change = first_after(&device->changes, position);
    members->complete = !device->changes.dropped || position >= device->changes.dropped_position;
    gn_members_free(tlas->members);
    tlas->members = members;
    return;
fail:
    gn_members_free(members);
    gn_tally_lost(device);
}

void gn_change_add(struct gn_device *device, const struct gn_as *as, enum gn_change_kind kind, uint32_t queue,
                   uint64_t position)
{
    struct gn_changes *changes = &device->changes;
    if (changes->count == MOST_CHANGES) {
        uint32_t half = MOST_CHANGES / 2;
        changes->dropped += half;
        changes->dropped_position = changes->list[half - 1].position;
        memmove(changes->list, changes->list + half, (MOST_CHANGES - half) * sizeof *changes->list);
        changes->count -= half;
    }
    if (changes->count == changes->capacity) {
        uint32_t capacity = changes->capacity ? changes->capacity * 2 : 64;
        struct gn_change *grown = realloc(changes->list, capacity * sizeof *grown);
        if (!grown) {
            gn_tally_lost(device);
            return;
        }
        changes->list = grown;
        changes->capacity = capacity;
    }
    changes->list[changes->count++] =
        (struct gn_change){.id = as->id, .position = position, .queue = queue, .kind = kind};
}

/* The structure was created again in its place: the memory may well hold what it held. */
static bool lives_again(struct gn_device *device, const struct gn_as *as)
{
    for (const struct gn_as *other = as->address ? gn_map_get(&device->addresses, as->address) : NULL; other;
         other = other->same_address)
        if (!other->destroyed_at)
            return !as->storage_gone;
    return false;
}

bool gn_members_look(struct gn_device *device, struct gn_members *members, uint32_t queue, uint64_t position,
                     const struct gn_clock *seen)
{
    const struct gn_changes *changes = &device->changes;
    if (!members->complete || members->next_change < changes->dropped)
        return false;
    while (members->next_change - changes->dropped < changes->count) {
        const struct gn_change *change = &changes->list[members->next_change - changes->dropped];
        if (change->position >= position)
            break;
        members->next_change++;
        uintptr_t known = (uintptr_t)gn_map_get(&members->index, change->id);
        if (!known)
            continue;
        struct gn_as *as = members->structures[known - 1];
        if (change->kind == GN_CHANGE_WRITTEN &&
            (change->queue != queue || members->queue != queue || !gn_as_sure(as, queue, position, seen)))
            continue;
        if (change->kind == GN_CHANGE_DESTROYED && lives_again(device, as))
            continue;
        if (!members->changed[change->kind]++)
            members->first[change->kind] = as;
    }
    return true;
}

void gn_changes_finish(struct gn_device *device)
{
    free(device->changes.list);
    device->changes = (struct gn_changes){0};
}
