/* SPDX-License-Identifier: Apache-2.0 */
/* Traces, dispatches and draws: which TLASes they read through their descriptors is recorded, and judged where they are executed
 * against what the TLAS holds and what has become of that. */
#include "layer/sbt.h"
#include "layer/shader.h"
#include "layer/sync.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void gn_use_free(struct gn_use *use)
{
    for (uint32_t i = 0; use && i < use->count; i++)
        gn_set_release(use->entries[i].set);
    free(use);
}

/* The followed slot of a binding; false if the binding is an array, or the shader may find nothing there. */
static bool find_slot(const struct gn_set *set, const struct gn_static_use *wanted, uint32_t *out)
{
    for (uint32_t i = 0; i < set->layout->count; i++) {
        const struct gn_as_binding *binding = &set->layout->bindings[i];
        if (binding->binding != wanted->binding)
            continue;
        *out = i;
        return binding->elements == 1 && (!binding->partial || wanted->always);
    }
    return false;
}

/* Of a command that runs, some invocation of these stages certainly does. */
static VkShaderStageFlags first_stages(unsigned point, const struct gn_static_uses *uses)
{
    return point == GN_BIND_COMPUTE    ? VK_SHADER_STAGE_COMPUTE_BIT
           : point == GN_BIND_GRAPHICS ? VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_TASK_BIT_EXT
           : uses->one_raygen          ? VK_SHADER_STAGE_RAYGEN_BIT_KHR
                                       : 0;
}

struct gn_use *gn_use_make(struct gn_device *device, const struct gn_command_buffer *commands, unsigned point, const char *command,
                           bool runs)
{
    const struct gn_bound *bound = commands->bound;
    const struct gn_static_uses *uses = bound ? bound->uses[point] : NULL;
    if (!uses)
        return NULL;
    struct gn_use *use = calloc(1, sizeof *use + uses->count * sizeof use->entries[0]);
    if (!use) {
        gn_tally_lost(device);
        return NULL;
    }
    use->command = command;
    for (uint32_t i = 0; i < uses->count; i++) {
        const struct gn_static_use *wanted = &uses->uses[i];
        struct gn_set *set = wanted->set < GN_MAX_SETS ? bound->sets[point][wanted->set] : NULL;
        uint32_t slot = 0;
        if (!set) {
            use->in_buffers |= wanted->set < GN_MAX_SETS && (bound->in_buffers[point] >> wanted->set & 1);
            continue;
        }
        if (!find_slot(set, wanted, &slot)) {
            use->left_out++;
            continue;
        }
        set->references++;
        use->entries[use->count++] = (struct gn_use_entry){
            .set = set,
            .slot = slot,
            .stages = wanted->stages,
            .rays = wanted->rays,
            .ray_offset = wanted->ray_offset,
            .ray_stride = wanted->ray_stride,
            .certain = runs && wanted->always && (wanted->stages & first_stages(point, uses))};
    }
    return use;
}

static void record(struct gn_device *device, VkCommandBuffer handle, unsigned point, const char *command, bool runs)
{
    gn_lock(device);
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    struct gn_bound *bound = commands ? commands->bound : NULL;
    struct gn_use *use = NULL;
    if (!bound || !bound->uses[point])
        goto done;
    const struct gn_event *last = commands->recording && commands->recording->count
                                      ? &commands->recording->events[commands->recording->count - 1]
                                      : NULL;
    if (!bound->changed[point] && last && last->kind == GN_EVENT_USE)
        goto done;
    bound->changed[point] = false;
    if (!(use = gn_use_make(device, commands, point, command, runs)))
        goto done;
    gn_tally_unjudged(device, GN_UNJUDGED_descriptor_arrays, use->left_out);
    gn_tally_unjudged(device, GN_UNJUDGED_descriptor_buffers, use->in_buffers);
    struct gn_event event = {.kind = GN_EVENT_USE, .unjudged = GN_UNJUDGED_COUNT, .use = use};
    if (use->count)
        event.command = gn_command_buffer_next(commands);
    if (use->count && gn_command_buffer_add(device, commands, &event))
        use = NULL;
done:
    gn_use_free(use);
    gn_unlock(device);
}

static void watch(struct gn_device *device, VkCommandBuffer handle, unsigned point, const char *command, bool runs)
{
    if (atomic_load_explicit(&device->traces, memory_order_acquire))
        record(device, handle, point, command, runs);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdDispatch(VkCommandBuffer handle, uint32_t x, uint32_t y, uint32_t z)
{
    struct gn_device *device = gn_device_of(handle);
    watch(device, handle, GN_BIND_COMPUTE, "vkCmdDispatch", x && y && z);
    device->next.CmdDispatch(handle, x, y, z);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdDispatchBase(VkCommandBuffer handle, uint32_t base_x, uint32_t base_y, uint32_t base_z,
                                                    uint32_t x, uint32_t y, uint32_t z)
{
    struct gn_device *device = gn_device_of(handle);
    watch(device, handle, GN_BIND_COMPUTE, "vkCmdDispatchBase", x && y && z);
    device->next.CmdDispatchBase(handle, base_x, base_y, base_z, x, y, z);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdDispatchIndirect(VkCommandBuffer handle, VkBuffer buffer, VkDeviceSize offset)
{
    struct gn_device *device = gn_device_of(handle);
    watch(device, handle, GN_BIND_COMPUTE, "vkCmdDispatchIndirect", false);
    device->next.CmdDispatchIndirect(handle, buffer, offset);
}

/* The shader binding table that a trace reads; not again where nothing but traces has come since. */
static void record_table(struct gn_device *device, VkCommandBuffer handle, const char *command,
                         const VkStridedDeviceAddressRegionKHR *const regions[4])
{
    struct gn_access list[4];
    uint32_t count = 0;
    for (int i = 0; i < 4; i++)
        if (regions[i] && regions[i]->deviceAddress && regions[i]->size &&
            regions[i]->deviceAddress + regions[i]->size > regions[i]->deviceAddress)
            list[count++] = (struct gn_access){
                .role = GN_ROLE_BINDING_TABLE, .base = regions[i]->deviceAddress, .size = regions[i]->size};
    if (!count)
        return;
    gn_lock(device);
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    const struct gn_recording *recording = commands ? commands->recording : NULL;
    uint32_t last = recording ? recording->count : 0;
    while (last && (recording->events[last - 1].kind == GN_EVENT_USE || recording->events[last - 1].kind == GN_EVENT_TRACE))
        last--;
    const struct gn_event *event = last ? &recording->events[last - 1] : NULL;
    bool same = event && event->kind == GN_EVENT_ACCESS && event->accesses->count == count;
    for (uint32_t i = 0; same && i < count; i++)
        same = event->accesses->list[i].role == GN_ROLE_BINDING_TABLE && event->accesses->list[i].base == list[i].base &&
               event->accesses->list[i].size == list[i].size;
    if (commands && !same)
        gn_command_buffer_access(device, commands, command, list, count);
    gn_unlock(device);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdTraceRaysKHR(VkCommandBuffer handle, const VkStridedDeviceAddressRegionKHR *raygen,
                                                    const VkStridedDeviceAddressRegionKHR *miss,
                                                    const VkStridedDeviceAddressRegionKHR *hit,
                                                    const VkStridedDeviceAddressRegionKHR *callable, uint32_t width,
                                                    uint32_t height, uint32_t depth)
{
    struct gn_device *device = gn_device_of(handle);
    if (width && height && depth)
        record_table(device, handle, "vkCmdTraceRaysKHR",
                     (const VkStridedDeviceAddressRegionKHR *const[4]){raygen, miss, hit, callable});
    const VkStridedDeviceAddressRegionKHR *const parts[] = {raygen, miss, hit, callable};
    uint64_t invocations;
    if (__builtin_mul_overflow((uint64_t)width * height, depth, &invocations) || invocations == UINT64_MAX)
        invocations = UINT64_MAX - 1;
    watch(device, handle, GN_BIND_RAYS, "vkCmdTraceRaysKHR", invocations);
    gn_sbt_trace(device, handle, parts, "vkCmdTraceRaysKHR", invocations);
    gn_launch_tell(device, handle, callable);
    device->next.CmdTraceRaysKHR(handle, raygen, miss, hit, callable, width, height, depth);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdTraceRaysIndirectKHR(VkCommandBuffer handle,
                                                            const VkStridedDeviceAddressRegionKHR *raygen,
                                                            const VkStridedDeviceAddressRegionKHR *miss,
                                                            const VkStridedDeviceAddressRegionKHR *hit,
                                                            const VkStridedDeviceAddressRegionKHR *callable,
                                                            VkDeviceAddress address)
{
    struct gn_device *device = gn_device_of(handle);
    const VkStridedDeviceAddressRegionKHR *const parts[] = {raygen, miss, hit, callable};
    watch(device, handle, GN_BIND_RAYS, "vkCmdTraceRaysIndirectKHR", false);
    gn_sbt_trace(device, handle, parts, "vkCmdTraceRaysIndirectKHR", UINT64_MAX);
    gn_launch_tell(device, handle, callable);
    device->next.CmdTraceRaysIndirectKHR(handle, raygen, miss, hit, callable, address);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdTraceRaysIndirect2KHR(VkCommandBuffer handle, VkDeviceAddress address)
{
    struct gn_device *device = gn_device_of(handle);
    watch(device, handle, GN_BIND_RAYS, "vkCmdTraceRaysIndirect2KHR", false);
    gn_sbt_trace_indirect(device, handle, address);
    gn_launch_tell(device, handle, NULL);
    device->next.CmdTraceRaysIndirect2KHR(handle, address);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdDraw(VkCommandBuffer handle, uint32_t vertices, uint32_t instances, uint32_t first,
                                            uint32_t first_instance)
{
    struct gn_device *device = gn_device_of(handle);
    watch(device, handle, GN_BIND_GRAPHICS, "vkCmdDraw", vertices && instances);
    device->next.CmdDraw(handle, vertices, instances, first, first_instance);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdDrawIndexed(VkCommandBuffer handle, uint32_t indices, uint32_t instances, uint32_t first,
                                                   int32_t offset, uint32_t first_instance)
{
    struct gn_device *device = gn_device_of(handle);
    watch(device, handle, GN_BIND_GRAPHICS, "vkCmdDrawIndexed", indices && instances);
    device->next.CmdDrawIndexed(handle, indices, instances, first, offset, first_instance);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdDrawIndirect(VkCommandBuffer handle, VkBuffer buffer, VkDeviceSize offset, uint32_t count,
                                                    uint32_t stride)
{
    struct gn_device *device = gn_device_of(handle);
    watch(device, handle, GN_BIND_GRAPHICS, "vkCmdDrawIndirect", false);
    device->next.CmdDrawIndirect(handle, buffer, offset, count, stride);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdDrawIndexedIndirect(VkCommandBuffer handle, VkBuffer buffer, VkDeviceSize offset,
                                                           uint32_t count, uint32_t stride)
{
    struct gn_device *device = gn_device_of(handle);
    watch(device, handle, GN_BIND_GRAPHICS, "vkCmdDrawIndexedIndirect", false);
    device->next.CmdDrawIndexedIndirect(handle, buffer, offset, count, stride);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdDrawMeshTasksEXT(VkCommandBuffer handle, uint32_t x, uint32_t y, uint32_t z)
{
    struct gn_device *device = gn_device_of(handle);
    watch(device, handle, GN_BIND_GRAPHICS, "vkCmdDrawMeshTasksEXT", x && y && z);
    device->next.CmdDrawMeshTasksEXT(handle, x, y, z);
}

/* One value for the rules per thing that is wrong with the TLAS as the command finds it. Returns how many there are; -1: what the
 * TLAS holds is not known. */
int gn_use_troubles(struct gn_device *device, struct gn_as *tlas, uint64_t version, uint32_t queue, uint64_t position,
                    const struct gn_clock *seen, bool certain, struct gn_trouble out[GN_TROUBLE_KINDS])
{
    int count = 0;
    struct gn_members *members = tlas->members;
    /* What is built under another name is not known. */
    if (tlas->shared || !members || members->version != version ||
        (members->queue != queue && (members->queue >= GN_MAX_CLOCKS || seen->at[members->queue] < members->position)) ||
        !gn_members_look(device, members, queue, position, seen))
        return -1;
    static const enum gn_trouble_kind kinds[GN_CHANGE_COUNT] = {[GN_CHANGE_WRITTEN] = GN_TROUBLE_REBUILT,
                                                                [GN_CHANGE_DESTROYED] = GN_TROUBLE_DESTROYED,
                                                                [GN_CHANGE_STORAGE_GONE] = GN_TROUBLE_STORAGE_GONE};
    for (int kind = 0; kind < GN_CHANGE_COUNT; kind++) {
        const struct gn_as *blas = members->first[kind];
        if (!members->changed[kind])
            continue;
        if (kind == GN_CHANGE_STORAGE_GONE && blas->destroyed_at)
            continue;
        out[count++] = (struct gn_trouble){.kind = kinds[kind],
                                           .certain = certain,
                                           .tlas = {tlas->kind, (uint64_t)tlas->handle, tlas->name},
                                           .tlas_id = tlas->id,
                                           .blas = {blas->kind, (uint64_t)blas->handle, blas->name},
                                           .blas_id = blas->id,
                                           .moved_to = blas->moved_to,
                                           .count = members->changed[kind],
                                           .total = members->count};
    }
    return count;
}
