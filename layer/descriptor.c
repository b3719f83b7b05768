/* SPDX-License-Identifier: Apache-2.0 */
/* Descriptor sets that can hold acceleration structures: layouts, sets, every way to write them, and what a command buffer has bound. A
 * binding of one element is followed, an array is not: which element a shader reads is not known. */
#include "layer/use.h"

#include <stdlib.h>
#include <string.h>

#define STRUCTURE VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR

/* What a pipeline layout or an update template says about acceleration structures. */
struct gn_pipeline_layout {
    uint32_t count;
    struct gn_set_layout *sets[];
};

struct template_entry {
    uint32_t binding, element, count;
    bool other; /* not structures, into a binding that may hold some */
    size_t offset, stride;
};
struct gn_update_template {
    bool push;
    VkPipelineBindPoint point;
    struct gn_set_layout *layout; /* of a push template */
    uint32_t set;
    uint32_t count;
    struct template_entry entries[];
};

static struct gn_set_layout *layout_keep(struct gn_set_layout *layout)
{
    if (layout)
        layout->references++;
    return layout;
}

static void layout_release(struct gn_set_layout *layout)
{
    if (layout && --layout->references == 0)
        free(layout);
}

static struct gn_set *set_create(struct gn_set_layout *layout)
{
    struct gn_set *set = calloc(1, sizeof *set + layout->count * sizeof set->slots[0]);
    if (set) {
        set->references = 1;
        set->layout = layout_keep(layout);
    }
    return set;
}

static struct gn_set *set_keep(struct gn_set *set)
{
    if (set)
        set->references++;
    return set;
}

void gn_set_release(struct gn_set *set)
{
    if (!set || --set->references)
        return;
    for (uint32_t i = 0; i < set->layout->count; i++)
        gn_as_release(set->slots[i]);
    layout_release(set->layout);
    free(set);
}

unsigned gn_bind_point(VkPipelineBindPoint point)
{
    return point == VK_PIPELINE_BIND_POINT_GRAPHICS          ? GN_BIND_GRAPHICS
           : point == VK_PIPELINE_BIND_POINT_COMPUTE         ? GN_BIND_COMPUTE
           : point == VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR ? GN_BIND_RAYS
                                                             : GN_BIND_COUNT;
}

struct gn_bound *gn_bound_of(struct gn_device *device, struct gn_command_buffer *commands)
{
    if (!commands->bound && !(commands->bound = calloc(1, sizeof *commands->bound)))
        gn_tally_lost(device);
    return commands->bound;
}

void gn_bound_free(struct gn_bound *bound)
{
    for (unsigned point = 0; bound && point < GN_BIND_COUNT; point++) {
        gn_static_uses_release(bound->uses[point]);
        for (uint32_t i = 0; i < GN_MAX_SETS; i++)
            gn_set_release(bound->sets[point][i]);
    }
    free(bound);
}

bool gn_binding_holds(const VkDescriptorSetLayoutCreateInfo *info, uint32_t index)
{
    VkDescriptorType type = info->pBindings[index].descriptorType;
    const VkMutableDescriptorTypeCreateInfoEXT *lists =
        type == VK_DESCRIPTOR_TYPE_MUTABLE_EXT
            ? gn_chain_find(info->pNext, VK_STRUCTURE_TYPE_MUTABLE_DESCRIPTOR_TYPE_CREATE_INFO_EXT)
            : NULL;
    bool holds = type == STRUCTURE;
    if (lists && index < lists->mutableDescriptorTypeListCount)
        for (uint32_t i = 0; i < lists->pMutableDescriptorTypeLists[index].descriptorTypeCount; i++)
            holds |= lists->pMutableDescriptorTypeLists[index].pDescriptorTypes[i] == STRUCTURE;
    return holds;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateDescriptorSetLayout(VkDevice handle,
                                                                  const VkDescriptorSetLayoutCreateInfo *info,
                                                                  const VkAllocationCallbacks *allocator,
                                                                  VkDescriptorSetLayout *out)
{
    struct gn_device *device = gn_device_of(handle);
    struct gn_mirror_plan plan;
    bool mirrored = gn_mirror_plan_make(device, info, &plan);
    VkResult result = device->next.CreateDescriptorSetLayout(handle, mirrored ? &plan.info : info, allocator, out);
    gn_mirror_plan_finish(&plan);
    uint32_t count = 0;
    for (uint32_t i = 0; i < info->bindingCount; i++)
        count += gn_binding_holds(info, i);
    if (result != VK_SUCCESS || !count)
        return result;
    const VkDescriptorSetLayoutBindingFlagsCreateInfo *flags =
        gn_chain_find(info->pNext, VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_BINDING_FLAGS_CREATE_INFO);
    struct gn_set_layout *layout = malloc(sizeof *layout + count * sizeof layout->bindings[0]);
    gn_lock(device);
    if (layout) {
        *layout = (struct gn_set_layout){.references = 1, .mirrored = mirrored};
        for (uint32_t i = 0; i < info->bindingCount; i++)
            if (gn_binding_holds(info, i))
                layout->bindings[layout->count++] = (struct gn_as_binding){
                    .binding = info->pBindings[i].binding,
                    .elements = info->pBindings[i].descriptorCount,
                    .other = info->pBindings[i].descriptorType != STRUCTURE,
                    .partial = flags && i < flags->bindingCount &&
                               (flags->pBindingFlags[i] & VK_DESCRIPTOR_BINDING_PARTIALLY_BOUND_BIT)};
    }
    for (uint32_t i = 0; layout && i < layout->count; i++)
        if (layout->bindings[i].other)
            atomic_store_explicit(&device->mutable_descriptors, true, memory_order_release);
    if (!layout || !gn_map_put(&device->set_layouts, (uint64_t)*out, layout)) {
        free(layout);
        gn_tally_lost(device);
    }
    gn_unlock(device);
    return result;
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyDescriptorSetLayout(VkDevice handle, VkDescriptorSetLayout layout,
                                                               const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    layout_release(gn_map_take(&device->set_layouts, (uint64_t)layout));
    gn_unlock(device);
    device->next.DestroyDescriptorSetLayout(handle, layout, allocator);
}

static void pipeline_layout_free(struct gn_pipeline_layout *layout)
{
    for (uint32_t i = 0; layout && i < layout->count; i++)
        layout_release(layout->sets[i]);
    free(layout);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreatePipelineLayout(VkDevice handle, const VkPipelineLayoutCreateInfo *info,
                                                             const VkAllocationCallbacks *allocator, VkPipelineLayout *out)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.CreatePipelineLayout(handle, info, allocator, out);
    if (result != VK_SUCCESS)
        return result;
    gn_lock(device);
    uint32_t held = 0;
    for (uint32_t i = 0; i < info->setLayoutCount; i++)
        held += gn_map_get(&device->set_layouts, (uint64_t)info->pSetLayouts[i]) != NULL;
    struct gn_pipeline_layout *layout =
        held ? calloc(1, sizeof *layout + info->setLayoutCount * sizeof layout->sets[0]) : NULL;
    for (uint32_t i = 0; layout && i < info->setLayoutCount; i++)
        layout->sets[layout->count++] = layout_keep(gn_map_get(&device->set_layouts, (uint64_t)info->pSetLayouts[i]));
    if (held && (!layout || !gn_map_put(&device->pipeline_layouts, (uint64_t)*out, layout))) {
        pipeline_layout_free(layout);
        gn_tally_lost(device);
    }
    gn_unlock(device);
    return result;
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyPipelineLayout(VkDevice handle, VkPipelineLayout layout,
                                                          const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    pipeline_layout_free(gn_map_take(&device->pipeline_layouts, (uint64_t)layout));
    gn_unlock(device);
    device->next.DestroyPipelineLayout(handle, layout, allocator);
}

bool gn_layout_mirrored(struct gn_device *device, VkPipelineLayout handle)
{
    bool any = false, all = true;
    gn_lock(device);
    const struct gn_pipeline_layout *layout = gn_map_get(&device->pipeline_layouts, (uint64_t)handle);
    for (uint32_t i = 0; layout && i < layout->count; i++)
        if (layout->sets[i]) {
            any = true;
            all &= layout->sets[i]->mirrored;
        }
    gn_unlock(device);
    return any && all;
}

bool gn_set_layouts_mirrored(struct gn_device *device, uint32_t count, const VkDescriptorSetLayout *layouts)
{
    bool any = false, all = true;
    gn_lock(device);
    for (uint32_t i = 0; i < count; i++) {
        const struct gn_set_layout *layout = gn_map_get(&device->set_layouts, (uint64_t)layouts[i]);
        any |= layout != NULL;
        all &= !layout || layout->mirrored;
    }
    gn_unlock(device);
    return any && all;
}

/* The mirror of a set takes a storage buffer. */
VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateDescriptorPool(VkDevice handle, const VkDescriptorPoolCreateInfo *info,
                                                             const VkAllocationCallbacks *allocator, VkDescriptorPool *out)
{
    struct gn_device *device = gn_device_of(handle);
    VkDescriptorPoolCreateInfo changed = *info;
    VkDescriptorPoolSize *sizes = NULL;
    bool holds = false;
    for (uint32_t i = 0; i < info->poolSizeCount; i++)
        holds |= info->pPoolSizes[i].type == STRUCTURE || info->pPoolSizes[i].type == VK_DESCRIPTOR_TYPE_MUTABLE_EXT;
    if (holds && device->shaders && (sizes = malloc((info->poolSizeCount + (size_t)1) * sizeof *sizes))) {
        memcpy(sizes, info->pPoolSizes, info->poolSizeCount * sizeof *sizes);
        sizes[info->poolSizeCount] = (VkDescriptorPoolSize){VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, info->maxSets};
        changed.pPoolSizes = sizes;
        changed.poolSizeCount = info->poolSizeCount + 1;
    }
    VkResult result = device->next.CreateDescriptorPool(handle, &changed, allocator, out);
    free(sizes);
    return result;
}

/* Sets of a pool are in a list that hangs off the pool's handle. */
static void pool_add(struct gn_device *device, struct gn_set *set)
{
    set->next = gn_map_get(&device->set_pools, (uint64_t)set->pool);
    if (!gn_map_put(&device->set_pools, (uint64_t)set->pool, set))
        set->next = NULL;
}

static void pool_clear(struct gn_device *device, VkDescriptorPool pool)
{
    struct gn_set *set = gn_map_take(&device->set_pools, (uint64_t)pool);
    for (struct gn_set *next; set; set = next) {
        next = set->next;
        gn_map_take(&device->sets, (uint64_t)set->handle);
        gn_mirror_detach(device, set);
        gn_set_release(set);
    }
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_AllocateDescriptorSets(VkDevice handle, const VkDescriptorSetAllocateInfo *info,
                                                               VkDescriptorSet *out)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.AllocateDescriptorSets(handle, info, out);
    if (result != VK_SUCCESS)
        return result;
    gn_lock(device);
    for (uint32_t i = 0; i < info->descriptorSetCount; i++) {
        struct gn_set_layout *layout = gn_map_get(&device->set_layouts, (uint64_t)info->pSetLayouts[i]);
        struct gn_set *set = layout ? set_create(layout) : NULL;
        if (set) {
            set->handle = out[i];
            set->pool = info->descriptorPool;
        }
        if (layout && (!set || !gn_map_put(&device->sets, (uint64_t)out[i], set))) {
            gn_set_release(set);
            gn_tally_lost(device);
        } else if (set) {
            gn_mirror_attach(device, set);
            pool_add(device, set);
        }
    }
    gn_unlock(device);
    return result;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_FreeDescriptorSets(VkDevice handle, VkDescriptorPool pool, uint32_t count,
                                                           const VkDescriptorSet *sets)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    for (uint32_t i = 0; i < count; i++) {
        struct gn_set *set = sets[i] ? gn_map_take(&device->sets, (uint64_t)sets[i]) : NULL;
        if (!set)
            continue;
        struct gn_set *head = gn_map_get(&device->set_pools, (uint64_t)pool);
        if (head == set && set->next)
            gn_map_put(&device->set_pools, (uint64_t)pool, set->next);
        else if (head == set)
            gn_map_take(&device->set_pools, (uint64_t)pool);
        else
            for (; head; head = head->next)
                if (head->next == set)
                    head->next = set->next;
        gn_mirror_detach(device, set);
        gn_set_release(set);
    }
    gn_unlock(device);
    return device->next.FreeDescriptorSets(handle, pool, count, sets);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_ResetDescriptorPool(VkDevice handle, VkDescriptorPool pool,
                                                            VkDescriptorPoolResetFlags flags)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    pool_clear(device, pool);
    gn_unlock(device);
    return device->next.ResetDescriptorPool(handle, pool, flags);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyDescriptorPool(VkDevice handle, VkDescriptorPool pool,
                                                          const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    pool_clear(device, pool);
    gn_unlock(device);
    device->next.DestroyDescriptorPool(handle, pool, allocator);
}

static void set_slot(struct gn_set *set, uint32_t binding, struct gn_as *as)
{
    for (uint32_t i = 0; i < set->layout->count; i++)
        if (set->layout->bindings[i].binding == binding && set->layout->bindings[i].elements == 1) {
            gn_as_keep(as);
            gn_as_release(set->slots[i]);
            set->slots[i] = as;
        }
}

static bool is_mutable(const struct gn_set_layout *layout, uint32_t binding)
{
    for (uint32_t i = 0; i < layout->count; i++)
        if (layout->bindings[i].binding == binding)
            return layout->bindings[i].other;
    return false;
}

/* The structures written, starting with the binding's first element; what goes beyond its end fills the bindings after it. Without data,
 * something else was written. */
static void write_slots(struct gn_device *device, struct gn_set *set, uint32_t binding, uint32_t element, uint32_t count,
                        const char *data, size_t stride)
{
    for (uint32_t i = 0; i < count; i++, element++) {
        uint32_t elements = 0;
        for (uint32_t b = 0; b < set->layout->count; b++)
            if (set->layout->bindings[b].binding == binding)
                elements = set->layout->bindings[b].elements;
        if (element && element >= elements) {
            binding++;
            element = 0;
        }
        VkAccelerationStructureKHR structure = VK_NULL_HANDLE;
        if (data)
            memcpy(&structure, data + i * stride, sizeof structure);
        if (data)
            gn_mirror_write(set, binding, element, structure, gn_as_get(device, structure));
        else
            gn_mirror_clear(set, binding, element);
        if (element == 0)
            set_slot(set, binding, gn_as_get(device, structure));
    }
}

static void apply_write(struct gn_device *device, struct gn_set *set, const VkWriteDescriptorSet *write)
{
    const VkWriteDescriptorSetAccelerationStructureKHR *structures =
        gn_chain_find(write->pNext, VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET_ACCELERATION_STRUCTURE_KHR);
    if (set && structures && write->descriptorType == STRUCTURE)
        write_slots(device, set, write->dstBinding, write->dstArrayElement, structures->accelerationStructureCount,
                    (const char *)structures->pAccelerationStructures, sizeof(VkAccelerationStructureKHR));
    else if (set && write->descriptorType != STRUCTURE && is_mutable(set->layout, write->dstBinding))
        write_slots(device, set, write->dstBinding, write->dstArrayElement, write->descriptorCount, NULL, 0);
}

static struct gn_as *slot_of(const struct gn_set *set, uint32_t binding)
{
    for (uint32_t i = 0; set && i < set->layout->count; i++)
        if (set->layout->bindings[i].binding == binding)
            return set->slots[i];
    return NULL;
}

VKAPI_ATTR void VKAPI_CALL gn_entry_UpdateDescriptorSets(VkDevice handle, uint32_t write_count,
                                                         const VkWriteDescriptorSet *writes, uint32_t copy_count,
                                                         const VkCopyDescriptorSet *copies)
{
    struct gn_device *device = gn_device_of(handle);
    bool all = atomic_load_explicit(&device->mutable_descriptors, memory_order_acquire), any = all || copy_count != 0;
    for (uint32_t i = 0; i < write_count; i++)
        any |= writes[i].descriptorType == STRUCTURE;
    device->next.UpdateDescriptorSets(handle, write_count, writes, copy_count, copies);
    if (!any)
        return;
    gn_lock(device);
    for (uint32_t i = 0; i < write_count; i++)
        if (all || writes[i].descriptorType == STRUCTURE)
            apply_write(device, gn_map_get(&device->sets, (uint64_t)writes[i].dstSet), &writes[i]);
    for (uint32_t i = 0; i < copy_count; i++) {
        const VkCopyDescriptorSet *copy = &copies[i];
        struct gn_set *from = gn_map_get(&device->sets, (uint64_t)copy->srcSet);
        struct gn_set *to = gn_map_get(&device->sets, (uint64_t)copy->dstSet);
        gn_mirror_copy(from, to, copy);
        if (to && copy->descriptorCount && !copy->dstArrayElement)
            set_slot(to, copy->dstBinding, copy->srcArrayElement ? NULL : slot_of(from, copy->srcBinding));
    }
    gn_unlock(device);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateDescriptorUpdateTemplate(VkDevice handle,
                                                                       const VkDescriptorUpdateTemplateCreateInfo *info,
                                                                       const VkAllocationCallbacks *allocator,
                                                                       VkDescriptorUpdateTemplate *out)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.CreateDescriptorUpdateTemplate(handle, info, allocator, out);
    uint32_t count = 0;
    bool all = atomic_load_explicit(&device->mutable_descriptors, memory_order_acquire);
    for (uint32_t i = 0; i < info->descriptorUpdateEntryCount; i++)
        count += all || info->pDescriptorUpdateEntries[i].descriptorType == STRUCTURE;
    if (result != VK_SUCCESS || !count)
        return result;
    struct gn_update_template *made = calloc(1, sizeof *made + count * sizeof made->entries[0]);
    gn_lock(device);
    const struct gn_set_layout *of = gn_map_get(&device->set_layouts, (uint64_t)info->descriptorSetLayout);
    if (made) {
        made->push = info->templateType == VK_DESCRIPTOR_UPDATE_TEMPLATE_TYPE_PUSH_DESCRIPTORS;
        made->point = info->pipelineBindPoint;
        made->set = info->set;
        const struct gn_pipeline_layout *layout =
            made->push ? gn_map_get(&device->pipeline_layouts, (uint64_t)info->pipelineLayout) : NULL;
        made->layout = layout && info->set < layout->count ? layout_keep(layout->sets[info->set]) : NULL;
        for (uint32_t i = 0; i < info->descriptorUpdateEntryCount; i++) {
            const VkDescriptorUpdateTemplateEntry *entry = &info->pDescriptorUpdateEntries[i];
            bool other = entry->descriptorType != STRUCTURE;
            if (!other || (!made->push && of && is_mutable(of, entry->dstBinding)))
                made->entries[made->count++] =
                    (struct template_entry){entry->dstBinding, entry->dstArrayElement, entry->descriptorCount, other, entry->offset,
                                            entry->stride ? entry->stride : sizeof(VkAccelerationStructureKHR)};
        }
    }
    if (!made || !gn_map_put(&device->update_templates, (uint64_t)*out, made)) {
        if (made)
            layout_release(made->layout);
        free(made);
        gn_tally_lost(device);
    }
    gn_unlock(device);
    return result;
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyDescriptorUpdateTemplate(VkDevice handle, VkDescriptorUpdateTemplate handle_of,
                                                                    const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    struct gn_update_template *known = gn_map_take(&device->update_templates, (uint64_t)handle_of);
    if (known)
        layout_release(known->layout);
    free(known);
    gn_unlock(device);
    device->next.DestroyDescriptorUpdateTemplate(handle, handle_of, allocator);
}

static void apply_template(struct gn_device *device, struct gn_set *set, const struct gn_update_template *known,
                           const void *data)
{
    for (uint32_t i = 0; set && i < known->count; i++)
        write_slots(device, set, known->entries[i].binding, known->entries[i].element, known->entries[i].count,
                    known->entries[i].other ? NULL : (const char *)data + known->entries[i].offset, known->entries[i].stride);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_UpdateDescriptorSetWithTemplate(VkDevice handle, VkDescriptorSet set,
                                                                    VkDescriptorUpdateTemplate update, const void *data)
{
    struct gn_device *device = gn_device_of(handle);
    device->next.UpdateDescriptorSetWithTemplate(handle, set, update, data);
    gn_lock(device);
    const struct gn_update_template *known = gn_map_get(&device->update_templates, (uint64_t)update);
    if (known)
        apply_template(device, gn_map_get(&device->sets, (uint64_t)set), known, data);
    gn_unlock(device);
}

static void bind(struct gn_device *device, VkCommandBuffer handle, unsigned point, uint32_t first, uint32_t count,
                 const VkDescriptorSet *sets)
{
    gn_lock(device);
    struct gn_command_buffer *commands = device->set_layouts.count ? gn_command_buffer_get(device, handle) : NULL;
    bool held = commands && commands->bound;
    for (uint32_t i = 0; commands && !held && i < count; i++)
        held = sets && gn_map_get(&device->sets, (uint64_t)sets[i]) != NULL;
    struct gn_bound *bound = held && point < GN_BIND_COUNT ? gn_bound_of(device, commands) : NULL;
    for (uint32_t i = 0; bound && i < count && first < GN_MAX_SETS && i < GN_MAX_SETS - first; i++) {
        struct gn_set *set = sets ? gn_map_get(&device->sets, (uint64_t)sets[i]) : NULL;
        gn_set_release(bound->sets[point][first + i]);
        bound->sets[point][first + i] = set_keep(set);
        bound->in_buffers[point] &= ~(UINT32_C(1) << (first + i));
        bound->changed[point] = true;
    }
    gn_unlock(device);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdBindDescriptorSets(VkCommandBuffer handle, VkPipelineBindPoint point,
                                                          VkPipelineLayout layout, uint32_t first, uint32_t count,
                                                          const VkDescriptorSet *sets, uint32_t dynamic_count,
                                                          const uint32_t *dynamics)
{
    struct gn_device *device = gn_device_of(handle);
    bind(device, handle, gn_bind_point(point), first, count, sets);
    device->next.CmdBindDescriptorSets(handle, point, layout, first, count, sets, dynamic_count, dynamics);
}

/* The points of a set of stages. */
static bool has_point(VkShaderStageFlags stages, unsigned point)
{
    const VkShaderStageFlags rays = VK_SHADER_STAGE_RAYGEN_BIT_KHR | VK_SHADER_STAGE_ANY_HIT_BIT_KHR |
                                    VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR | VK_SHADER_STAGE_MISS_BIT_KHR |
                                    VK_SHADER_STAGE_INTERSECTION_BIT_KHR | VK_SHADER_STAGE_CALLABLE_BIT_KHR;
    const VkShaderStageFlags graphics =
        VK_SHADER_STAGE_ALL_GRAPHICS | VK_SHADER_STAGE_TASK_BIT_EXT | VK_SHADER_STAGE_MESH_BIT_EXT;
    return stages & (point == GN_BIND_RAYS      ? rays
                     : point == GN_BIND_COMPUTE ? (VkShaderStageFlags)VK_SHADER_STAGE_COMPUTE_BIT
                                                : graphics);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdBindDescriptorSets2(VkCommandBuffer handle, const VkBindDescriptorSetsInfo *info)
{
    struct gn_device *device = gn_device_of(handle);
    for (unsigned point = 0; point < GN_BIND_COUNT; point++)
        if (has_point(info->stageFlags, point))
            bind(device, handle, point, info->firstSet, info->descriptorSetCount, info->pDescriptorSets);
    device->next.CmdBindDescriptorSets2(handle, info);
}

static void take_from_buffers(struct gn_device *device, VkCommandBuffer handle, unsigned point, uint32_t first, uint32_t count)
{
    gn_lock(device);
    struct gn_command_buffer *commands = device->set_layouts.count ? gn_command_buffer_get(device, handle) : NULL;
    struct gn_bound *bound = commands && point < GN_BIND_COUNT ? gn_bound_of(device, commands) : NULL;
    for (uint32_t i = 0; bound && i < count && first < GN_MAX_SETS && i < GN_MAX_SETS - first; i++) {
        gn_set_release(bound->sets[point][first + i]);
        bound->sets[point][first + i] = NULL;
        bound->in_buffers[point] |= UINT32_C(1) << (first + i);
        bound->changed[point] = true;
    }
    gn_unlock(device);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdSetDescriptorBufferOffsetsEXT(VkCommandBuffer handle, VkPipelineBindPoint point,
                                                                     VkPipelineLayout layout, uint32_t first, uint32_t count,
                                                                     const uint32_t *buffers, const VkDeviceSize *offsets)
{
    struct gn_device *device = gn_device_of(handle);
    take_from_buffers(device, handle, gn_bind_point(point), first, count);
    device->next.CmdSetDescriptorBufferOffsetsEXT(handle, point, layout, first, count, buffers, offsets);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdSetDescriptorBufferOffsets2EXT(VkCommandBuffer handle,
                                                                      const VkSetDescriptorBufferOffsetsInfoEXT *info)
{
    struct gn_device *device = gn_device_of(handle);
    for (unsigned point = 0; point < GN_BIND_COUNT; point++)
        if (has_point(info->stageFlags, point))
            take_from_buffers(device, handle, point, info->firstSet, info->setCount);
    device->next.CmdSetDescriptorBufferOffsets2EXT(handle, info);
}

/* The set that is pushed into. Each push makes a copy: what was recorded before keeps what it had. */
static struct gn_set *pushed_set(struct gn_device *device, VkCommandBuffer handle, unsigned point,
                                 struct gn_set_layout *layout, uint32_t index)
{
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    struct gn_bound *bound =
        commands && layout && point < GN_BIND_COUNT && index < GN_MAX_SETS ? gn_bound_of(device, commands) : NULL;
    struct gn_set *set = bound ? set_create(layout) : NULL;
    if (!set)
        return NULL;
    struct gn_set *old = bound->sets[point][index];
    for (uint32_t i = 0; old && old->layout == layout && i < layout->count; i++)
        set->slots[i] = gn_as_keep(old->slots[i]);
    gn_set_release(old);
    bound->sets[point][index] = set;
    bound->in_buffers[point] &= ~(UINT32_C(1) << index);
    bound->changed[point] = true;
    return set;
}

static void push(struct gn_device *device, VkCommandBuffer handle, unsigned point, VkPipelineLayout layout, uint32_t index,
                 uint32_t count, const VkWriteDescriptorSet *writes)
{
    gn_lock(device);
    const struct gn_pipeline_layout *known = gn_map_get(&device->pipeline_layouts, (uint64_t)layout);
    struct gn_set *set =
        known && index < known->count ? pushed_set(device, handle, point, known->sets[index], index) : NULL;
    for (uint32_t i = 0; i < count; i++)
        apply_write(device, set, &writes[i]);
    gn_unlock(device);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdPushDescriptorSet(VkCommandBuffer handle, VkPipelineBindPoint point,
                                                         VkPipelineLayout layout, uint32_t set, uint32_t count,
                                                         const VkWriteDescriptorSet *writes)
{
    struct gn_device *device = gn_device_of(handle);
    push(device, handle, gn_bind_point(point), layout, set, count, writes);
    device->next.CmdPushDescriptorSet(handle, point, layout, set, count, writes);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdPushDescriptorSet2(VkCommandBuffer handle, const VkPushDescriptorSetInfo *info)
{
    struct gn_device *device = gn_device_of(handle);
    for (unsigned point = 0; point < GN_BIND_COUNT; point++)
        if (has_point(info->stageFlags, point))
            push(device, handle, point, info->layout, info->set, info->descriptorWriteCount, info->pDescriptorWrites);
    device->next.CmdPushDescriptorSet2(handle, info);
}

static void push_template(struct gn_device *device, VkCommandBuffer handle, VkDescriptorUpdateTemplate update, uint32_t index,
                          const void *data)
{
    gn_lock(device);
    const struct gn_update_template *known = gn_map_get(&device->update_templates, (uint64_t)update);
    struct gn_set *set =
        known && known->push ? pushed_set(device, handle, gn_bind_point(known->point), known->layout, index) : NULL;
    if (set)
        apply_template(device, set, known, data);
    gn_unlock(device);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdPushDescriptorSetWithTemplate(VkCommandBuffer handle, VkDescriptorUpdateTemplate update,
                                                                     VkPipelineLayout layout, uint32_t set, const void *data)
{
    struct gn_device *device = gn_device_of(handle);
    push_template(device, handle, update, set, data);
    device->next.CmdPushDescriptorSetWithTemplate(handle, update, layout, set, data);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdPushDescriptorSetWithTemplate2(VkCommandBuffer handle,
                                                                      const VkPushDescriptorSetWithTemplateInfo *info)
{
    struct gn_device *device = gn_device_of(handle);
    push_template(device, handle, info->descriptorUpdateTemplate, info->set, info->pData);
    device->next.CmdPushDescriptorSetWithTemplate2(handle, info);
}

void gn_descriptors_finish(struct gn_device *device)
{
    size_t cursor = 0;
    struct gn_set *set;
    struct gn_set_layout *layout;
    struct gn_pipeline_layout *pipeline_layout;
    struct gn_update_template *update;
    while ((set = gn_map_next(&device->sets, &cursor)))
        gn_set_release(set);
    for (cursor = 0; (layout = gn_map_next(&device->set_layouts, &cursor));)
        layout_release(layout);
    for (cursor = 0; (pipeline_layout = gn_map_next(&device->pipeline_layouts, &cursor));)
        pipeline_layout_free(pipeline_layout);
    for (cursor = 0; (update = gn_map_next(&device->update_templates, &cursor));) {
        layout_release(update->layout);
        free(update);
    }
    gn_map_finish(&device->sets);
    gn_map_finish(&device->set_pools);
    gn_map_finish(&device->set_layouts);
    gn_map_finish(&device->pipeline_layouts);
    gn_map_finish(&device->update_templates);
}
