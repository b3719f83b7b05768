/* SPDX-License-Identifier: Apache-2.0 */
/* What a shader can know of acceleration structures: beside each descriptor set that holds any, a buffer that says which (its mirror, at a
 * binding that the layer adds to the layout), and a table that says what has become of each structure (checks/spirv/records.h). Both
 * are written by the host when the application writes a descriptor, submits a build or destroys a structure. All but the first two
 * functions with the device locked. */
#include "layer/shader.h"
#include "layer/use.h"

#include <stdlib.h>
#include <string.h>

#define ALIGNMENT_WORDS 64u /* no device asks for more than 256 bytes */

struct gn_mirror {
    uint32_t *words;
    VkBuffer buffer;
    VkDeviceSize offset;
    uint32_t word_count;
    struct gn_mirror *next; /* while it is not in use */
};

bool gn_mirror_plan_make(struct gn_device *device, const VkDescriptorSetLayoutCreateInfo *info, struct gn_mirror_plan *plan)
{
    const VkDescriptorSetLayoutBindingFlagsCreateInfo *flags =
        gn_chain_find(info->pNext, VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_BINDING_FLAGS_CREATE_INFO);
    const VkDescriptorSetLayoutCreateFlags unfit =
        VK_DESCRIPTOR_SET_LAYOUT_CREATE_PUSH_DESCRIPTOR_BIT_KHR | VK_DESCRIPTOR_SET_LAYOUT_CREATE_DESCRIPTOR_BUFFER_BIT_EXT |
        VK_DESCRIPTOR_SET_LAYOUT_CREATE_EMBEDDED_IMMUTABLE_SAMPLERS_BIT_EXT;
    VkShaderStageFlags stages = 0;
    *plan = (struct gn_mirror_plan){.info = *info};
    for (uint32_t i = 0; i < info->bindingCount; i++)
        if (gn_binding_holds(info, i))
            stages |= info->pBindings[i].stageFlags;
    if (!stages || !device->shaders || device->shaders->options.static_only)
        return false;
    bool fits = !(info->flags & unfit) && device->shaders->spare_buffers;
    for (uint32_t i = 0; i < info->bindingCount; i++) {
        fits &= info->pBindings[i].binding < GN_MIRROR_BINDING;
        fits &= !flags || i >= flags->bindingCount ||
                !(flags->pBindingFlags[i] & VK_DESCRIPTOR_BINDING_VARIABLE_DESCRIPTOR_COUNT_BIT);
    }
    gn_lock(device);
    fits = fits && gn_record_memory_begin(device);
    gn_unlock(device);
    const void *chain = info->pNext;
    plan->bindings = fits ? malloc((info->bindingCount + (size_t)1) * sizeof *plan->bindings) : NULL;
    if (plan->bindings && flags && flags->bindingCount) {
        plan->flags = malloc((info->bindingCount + (size_t)1) * sizeof *plan->flags);
        plan->chain = malloc(sizeof *plan->chain);
        VkDescriptorSetLayoutBindingFlagsCreateInfo *copy = NULL;
        if (plan->chain) {
            plan->chain->used = 0;
            copy = gn_chain_copy(&chain, VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_BINDING_FLAGS_CREATE_INFO, plan->chain);
        }
        if (plan->flags && copy) {
            memcpy(plan->flags, flags->pBindingFlags, info->bindingCount * sizeof *plan->flags);
            plan->flags[info->bindingCount] = 0;
            copy->pBindingFlags = plan->flags;
            copy->bindingCount = info->bindingCount + 1;
        } else {
            fits = false;
        }
    }
    if (!fits || !plan->bindings) {
        gn_tally_unjudged(device, GN_UNJUDGED_mirrors, 1);
        return false;
    }
    memcpy(plan->bindings, info->pBindings, info->bindingCount * sizeof *plan->bindings);
    plan->bindings[info->bindingCount] = (VkDescriptorSetLayoutBinding){
        .binding = GN_MIRROR_BINDING, .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, .descriptorCount = 1, .stageFlags = stages};
    plan->info.pNext = chain;
    plan->info.pBindings = plan->bindings;
    plan->info.bindingCount = info->bindingCount + 1;
    return true;
}

void gn_mirror_plan_finish(struct gn_mirror_plan *plan)
{
    free(plan->bindings);
    free(plan->flags);
    free(plan->chain);
}

/* The directory has two words for each binding up to the last that holds structures. */
static uint32_t directory_words(const struct gn_set_layout *layout)
{
    uint32_t last = 0;
    for (uint32_t i = 0; i < layout->count; i++)
        if (layout->bindings[i].binding > last)
            last = layout->bindings[i].binding;
    return 2 * (last + 1);
}

static struct gn_mirror *mirror_take(struct gn_device *device, uint32_t words)
{
    struct gn_shaders *shaders = device->shaders;
    for (struct gn_mirror **link = &shaders->idle_mirrors; *link; link = &(*link)->next)
        if ((*link)->word_count == words) {
            struct gn_mirror *found = *link;
            *link = found->next;
            return found;
        }
    struct gn_mirror *mirror = calloc(1, sizeof *mirror);
    struct gn_record_memory *memory = mirror ? gn_record_memory_words(device, words, ALIGNMENT_WORDS, &mirror->words) : NULL;
    if (!memory) {
        free(mirror);
        return NULL;
    }
    mirror->word_count = words;
    mirror->buffer = memory->buffer;
    mirror->offset = (VkDeviceSize)(mirror->words - memory->words) * 4;
    return mirror;
}

void gn_mirror_attach(struct gn_device *device, struct gn_set *set)
{
    const struct gn_set_layout *layout = set->layout;
    if (!layout->mirrored)
        return;
    uint64_t words = directory_words(layout);
    for (uint32_t i = 0; i < layout->count; i++)
        words += layout->bindings[i].elements;
    words = (words + ALIGNMENT_WORDS - 1) & ~(uint64_t)(ALIGNMENT_WORDS - 1);
    /* A set without its mirror would have its shaders read what nobody wrote. */
    set->mirror = words < UINT32_MAX / 8 ? mirror_take(device, (uint32_t)words) : NULL;
    struct gn_mirror *mirror = set->mirror ? set->mirror : device->shaders->no_mirror;
    VkDescriptorBufferInfo buffer = {mirror->buffer, mirror->offset, (VkDeviceSize)mirror->word_count * 4};
    VkWriteDescriptorSet write = {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                  .dstSet = set->handle,
                                  .dstBinding = GN_MIRROR_BINDING,
                                  .descriptorCount = 1,
                                  .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                  .pBufferInfo = &buffer};
    if (set->mirror) {
        uint32_t at = directory_words(layout);
        memset(mirror->words, 0, mirror->word_count * 4);
        for (uint32_t i = 0; i < layout->count; i++) {
            const struct gn_as_binding *binding = &layout->bindings[i];
            mirror->words[2 * binding->binding] = at;
            mirror->words[2 * binding->binding + 1] = binding->elements;
            for (uint32_t e = 0; e < binding->elements; e++)
                mirror->words[at++] = GN_STRUCTURE_ID_UNWRITTEN;
        }
    }
    device->next.UpdateDescriptorSets(device->handle, 1, &write, 0, NULL);
}

void gn_mirror_detach(struct gn_device *device, struct gn_set *set)
{
    if (!set->mirror)
        return;
    set->mirror->next = device->shaders->idle_mirrors;
    device->shaders->idle_mirrors = set->mirror;
    set->mirror = NULL;
}

/* The entry of an element, NULL if there is none. */
static uint32_t *entry_of(const struct gn_set *set, uint32_t binding, uint32_t element)
{
    if (!set->mirror || 2 * (uint64_t)binding + 1 >= directory_words(set->layout))
        return NULL;
    uint32_t *words = set->mirror->words;
    return element < words[2 * binding + 1] ? &words[words[2 * binding] + element] : NULL;
}

void gn_mirror_write(struct gn_set *set, uint32_t binding, uint32_t element, VkAccelerationStructureKHR handle, const struct gn_as *as)
{
    uint32_t *entry = entry_of(set, binding, element);
    if (entry)
        __atomic_store_n(entry, !handle ? GN_STRUCTURE_ID_NULL : as ? as->table_id : GN_STRUCTURE_ID_UNKNOWN, __ATOMIC_RELAXED);
}

void gn_mirror_clear(struct gn_set *set, uint32_t binding, uint32_t element)
{
    uint32_t *entry = entry_of(set, binding, element);
    if (entry)
        __atomic_store_n(entry, (uint32_t)GN_STRUCTURE_ID_UNWRITTEN, __ATOMIC_RELAXED);
}

void gn_mirror_copy(const struct gn_set *from, struct gn_set *to, const VkCopyDescriptorSet *copy)
{
    for (uint32_t i = 0; to && i < copy->descriptorCount; i++) {
        uint32_t *target = entry_of(to, copy->dstBinding, copy->dstArrayElement + i);
        const uint32_t *source = from ? entry_of(from, copy->srcBinding, copy->srcArrayElement + i) : NULL;
        if (target)
            __atomic_store_n(target, source ? *source : (uint32_t)GN_STRUCTURE_ID_UNKNOWN, __ATOMIC_RELAXED);
    }
}

/* The table of structures */

void gn_structure_enter(struct gn_device *device, struct gn_as *as)
{
    struct gn_shaders *shaders = device->shaders;
    as->table_id = GN_STRUCTURE_ID_UNKNOWN;
    if (!shaders)
        return;
    if (shaders->next_structure < GN_STRUCTURES)
        as->table_id = shaders->next_structure++;
    else
        gn_tally_unjudged(device, GN_UNJUDGED_structures_beyond, 1);
    gn_structure_tell(device, as);
}

void gn_structure_tell(struct gn_device *device, const struct gn_as *as)
{
    uint32_t *table = device->shaders ? device->shaders->structures : NULL;
    if (!table || as->table_id < GN_STRUCTURE_ID_FIRST)
        return;
    bool unsure = as->shared || device->builds_unseen || atomic_load_explicit(&device->incomplete, memory_order_relaxed);
    uint32_t state = as->destroyed_at                                ? GN_STRUCTURE_DESTROYED
                     : unsure                                        ? GN_STRUCTURE_FINE
                     : !as->built_count                              ? GN_STRUCTURE_NEVER_BUILT
                     : as->kind == GN_OBJECT_BLAS && !as->generic    ? GN_STRUCTURE_BOTTOM_LEVEL
                                                                     : GN_STRUCTURE_FINE | (as->shared ? 0 : as->positions);
    __atomic_store_n(&table[as->table_id], state, __ATOMIC_RELEASE);
}

void gn_mirrors_begin(struct gn_device *device)
{
    struct gn_shaders *shaders = device->shaders;
    struct gn_as *as;
    struct gn_mirror *none = NULL;
    uint32_t *table = NULL;
    struct gn_record_memory *memory =
        gn_record_memory_words(device, GN_STRUCTURES + gn_positions_room(device), ALIGNMENT_WORDS, &table);
    if (!memory)
        return;
    /* What stands for a mirror that could not be had: every entry is at its first word, and unknown. */
    none = mirror_take(device, 2 * GN_MIRROR_BINDINGS + ALIGNMENT_WORDS);
    if (!none)
        return;
    for (uint32_t i = 0; i < GN_MIRROR_BINDINGS; i++) {
        none->words[2 * i] = 2 * GN_MIRROR_BINDINGS;
        none->words[2 * i + 1] = 1;
    }
    none->words[2 * GN_MIRROR_BINDINGS] = GN_STRUCTURE_ID_UNKNOWN;
    shaders->no_mirror = none;
    memset(table, 0, GN_STRUCTURES * sizeof *table);
    table[GN_STRUCTURE_ID_NULL] = shaders->null_descriptors ? GN_STRUCTURE_FINE : GN_STRUCTURE_NONE;
    table[GN_STRUCTURE_ID_UNKNOWN] = GN_STRUCTURE_FINE;
    table[GN_STRUCTURE_ID_UNWRITTEN] = GN_STRUCTURE_NONE;
    shaders->structures = table;
    shaders->structures_address = memory->address + (uint64_t)(table - memory->words) * 4;
    gn_positions_tell_all(device);
    for (size_t cursor = 0; (as = gn_map_next(&device->structures, &cursor));)
        gn_structure_tell(device, as);
}

void gn_mirrors_finish(struct gn_device *device)
{
    struct gn_shaders *shaders = device->shaders;
    for (struct gn_mirror *mirror = shaders->idle_mirrors, *next; mirror; mirror = next) {
        next = mirror->next;
        free(mirror);
    }
    free(shaders->no_mirror);
    shaders->idle_mirrors = shaders->no_mirror = NULL;
    shaders->structures = NULL;
}

const struct gn_as *gn_structure_by_id(struct gn_device *device, uint32_t id)
{
    const struct gn_as *as;
    for (size_t cursor = 0; (as = gn_map_next(&device->structures, &cursor));)
        if (as->table_id == id)
            return as;
    for (size_t i = 0; i < sizeof device->graves / sizeof device->graves[0]; i++)
        if (device->graves[i] && device->graves[i]->table_id == id)
            return device->graves[i];
    return NULL;
}
