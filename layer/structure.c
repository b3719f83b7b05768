/* SPDX-License-Identifier: Apache-2.0 */
/* Acceleration structures: their life, their addresses, when they were built. */
#include "layer/shader.h"

#include <stdlib.h>
#include <string.h>

struct gn_as *gn_as_get(struct gn_device *device, VkAccelerationStructureKHR handle)
{
    return handle ? gn_map_get(&device->structures, (uint64_t)handle) : NULL;
}

struct gn_as *gn_as_keep(struct gn_as *as)
{
    if (as)
        as->references++;
    return as;
}

void gn_as_release(struct gn_as *as)
{
    if (!as || --as->references)
        return;
    gn_shape_release(as->shape);
    gn_members_free(as->members);
    free(as->moved_to);
    free(as->reaches);
    gn_digests_free(as);
    free(as->built);
    free(as->name);
    free(as->tag);
    free(as);
}

void gn_as_written(struct gn_device *device, struct gn_as *as, uint32_t queue, uint64_t position)
{
    if (as->writes++ && as->levels != GN_LEVEL_TOP)
        gn_change_add(device, as, GN_CHANGE_WRITTEN, queue, position);
    for (uint32_t i = 0; i < as->built_count; i++)
        if (as->built[i].queue == queue) {
            as->built[i].last = position; /* positions only rise */
            return;
        }
    struct gn_built_on *grown = realloc(as->built, (as->built_count + 1) * sizeof *grown);
    if (!grown) {
        gn_tally_lost(device);
        return;
    }
    as->built = grown;
    grown[as->built_count++] = (struct gn_built_on){queue, position, position};
    gn_structure_tell(device, as);
}

void gn_as_holds(struct gn_as *as, enum gn_made made, bool compacted, struct gn_build_shape *shape)
{
    gn_shape_keep(shape);
    gn_shape_release(as->shape);
    as->shape = shape;
    as->made = made;
    as->compacted = compacted;
    as->generation++;
}

/* What the host wrote before the submission happened before it. */
static bool has_seen(const struct gn_clock *seen, uint32_t queue, uint64_t position)
{
    return seen && queue < GN_MAX_CLOCKS && seen->at[queue] >= position;
}

bool gn_as_sure(const struct gn_as *as, uint32_t queue, uint64_t position, const struct gn_clock *seen)
{
    bool sure = !as->shared;
    for (uint32_t i = 0; i < as->built_count; i++)
        sure &= as->built[i].queue == queue || (as->built[i].queue == GN_QUEUE_HOST && as->built[i].last < position) ||
                has_seen(seen, as->built[i].queue, as->built[i].last);
    return sure;
}

static struct gn_geometry geometry_of(const VkAccelerationStructureGeometryKHR *in)
{
    struct gn_geometry out = {.type = (uint32_t)in->geometryType, .flags = in->flags};
    if (in->geometryType == VK_GEOMETRY_TYPE_TRIANGLES_KHR) {
        out.vertex_format = (uint32_t)in->geometry.triangles.vertexFormat;
        out.index_type = (uint32_t)in->geometry.triangles.indexType;
        out.max_vertex = in->geometry.triangles.maxVertex;
        out.has_transform = in->geometry.triangles.transformData.deviceAddress != 0;
    }
    return out;
}

struct gn_build_shape *gn_shape_create(const VkAccelerationStructureBuildGeometryInfoKHR *info,
                                       const VkAccelerationStructureBuildRangeInfoKHR *ranges)
{
    struct gn_build_shape *shape = malloc(sizeof *shape + (size_t)info->geometryCount * sizeof shape->geometries[0]);
    if (!shape)
        return NULL;
    shape->references = 1;
    shape->shape = (struct gn_shape){.is_top = info->type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR,
                                     .counts_known = ranges != NULL,
                                     .flags = info->flags,
                                     .geometry_count = info->geometryCount,
                                     .geometries = shape->geometries};
    for (uint32_t g = 0; g < info->geometryCount; g++) {
        shape->geometries[g] = geometry_of(info->pGeometries ? &info->pGeometries[g] : info->ppGeometries[g]);
        shape->geometries[g].primitive_count = ranges ? ranges[g].primitiveCount : 0;
    }
    return shape;
}

struct gn_build_shape *gn_shape_keep(struct gn_build_shape *shape)
{
    if (shape)
        shape->references++;
    return shape;
}

void gn_shape_release(struct gn_build_shape *shape)
{
    if (shape && --shape->references == 0)
        free(shape);
}

/* What the host builds before the submission of a command happens before it. Any other pair of queues is ordered by
 * semaphores, in ways that submission order does not show. */
enum gn_built gn_as_built(const struct gn_as *as, uint32_t queue, uint64_t position, const struct gn_clock *seen_by)
{
    enum gn_built best = GN_BUILT_NEVER;
    for (uint32_t i = 0; i < as->built_count; i++) {
        const struct gn_built_on *built = &as->built[i];
        enum gn_built seen;
        if (built->queue == queue)
            seen = built->position < position    ? GN_BUILT_BEFORE
                   : built->position == position ? GN_BUILT_SAME_CALL
                                                 : GN_BUILT_LATER;
        else if ((built->queue == GN_QUEUE_HOST && built->position < position) ||
                 has_seen(seen_by, built->queue, built->position))
            seen = GN_BUILT_BEFORE;
        else
            seen = GN_BUILT_UNORDERED;
        if (seen == GN_BUILT_BEFORE || best == GN_BUILT_NEVER || (best == GN_BUILT_LATER && seen != GN_BUILT_LATER) ||
            (best == GN_BUILT_UNORDERED && seen == GN_BUILT_SAME_CALL))
            best = seen;
    }
    if (as->shared && (best == GN_BUILT_NEVER || best == GN_BUILT_LATER))
        best = GN_BUILT_UNORDERED;
    return best;
}

/* How well `as` fits as what an instance refers to: best is what was built before, and what may be of the bottom level beats what
 * cannot be whatever is known of their builds, as long as both were built. */
static unsigned fitness(const struct gn_as *as, enum gn_built built)
{
    unsigned order = built == GN_BUILT_BEFORE      ? 3
                     : built == GN_BUILT_UNORDERED ? 2
                     : built == GN_BUILT_SAME_CALL ? 1
                                                   : 0;
    return order ? order + (as->levels == GN_LEVEL_TOP ? 0 : 3) : 0;
}

/* Several structures may share an address: one that was destroyed since, one that was created since, or two that alias the same
 * memory. The reader is given the benefit of the doubt. */
struct gn_as *gn_as_at(struct gn_device *device, uint64_t address, uint32_t queue, uint64_t position, const struct gn_clock *seen)
{
    struct gn_as *found = NULL;
    unsigned best = 0;
    for (struct gn_as *as = gn_map_get(&device->addresses, address); as && best < 6; as = as->same_address) {
        if (as->destroyed_at && as->destroyed_at < position)
            continue;
        unsigned fits = fitness(as, gn_as_built(as, queue, position, seen));
        if (!found || fits > best) {
            found = as;
            best = fits;
        }
    }
    return found;
}

static void learn_address(struct gn_device *device, struct gn_as *as, uint64_t address)
{
    if (as->address || !address)
        return;
    /* Two structures alive in one place: what builds one may serve the other. */
    as->same_address = gn_map_get(&device->addresses, address);
    for (struct gn_as *other = as->same_address; other; other = other->same_address)
        if (!other->destroyed_at)
            as->shared = other->shared = true;
    for (struct gn_as *other = as; other; other = other->same_address)
        gn_structure_tell(device, other);
    if (gn_map_put(&device->addresses, address, as)) {
        as->address = address;
        device->addressless--;
    } else {
        as->same_address = NULL;
    }
}

const struct gn_as *gn_as_formerly_at(const struct gn_device *device, uint64_t address)
{
    const uint32_t room = sizeof device->graves / sizeof device->graves[0];
    for (uint32_t i = 0; i < room && i < device->grave_count; i++) {
        const struct gn_as *as = device->graves[(device->grave_count - 1 - i) % room];
        if (as->address == address)
            return as;
    }
    return NULL;
}

static void forget_address(struct gn_device *device, struct gn_as *as)
{
    if (!as->address)
        return;
    struct gn_as *head = gn_map_get(&device->addresses, as->address);
    if (head == as) {
        if (as->same_address)
            gn_map_put(&device->addresses, as->address, as->same_address);
        else
            gn_map_take(&device->addresses, as->address);
    } else {
        while (head && head->same_address != as)
            head = head->same_address;
        if (head)
            head->same_address = as->same_address;
    }
    as->same_address = NULL;
}

void gn_as_purge(struct gn_device *device)
{
    uint64_t oldest = UINT64_MAX;
    for (struct gn_queue *queue = device->first_queue; queue; queue = queue->next)
        if (queue->oldest && queue->oldest->first_position < oldest)
            oldest = queue->oldest->first_position;
    for (struct gn_as **link = &device->destroyed; *link;) {
        struct gn_as *as = *link;
        if (as->destroyed_at >= oldest) {
            link = &as->next_destroyed;
            continue;
        }
        *link = as->next_destroyed;
        forget_address(device, as);
        gn_as_release(as);
    }
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateAccelerationStructureKHR(VkDevice handle,
                                                                       const VkAccelerationStructureCreateInfoKHR *info,
                                                                       const VkAllocationCallbacks *allocator,
                                                                       VkAccelerationStructureKHR *out)
{
    struct gn_device *device = gn_device_of(handle);
    static atomic_ullong last_id;
    VkResult result = device->next.CreateAccelerationStructureKHR(handle, info, allocator, out);
    if (result != VK_SUCCESS)
        return result;
    struct gn_as *as = calloc(1, sizeof *as);
    if (!as) {
        gn_tally_lost(device);
        return result;
    }
    as->handle = *out;
    as->id = atomic_fetch_add(&last_id, 1) + 1;
    as->references = 1;
    as->size = info->size;
    as->levels = info->type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR      ? GN_LEVEL_TOP
                 : info->type == VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR ? GN_LEVEL_BOTTOM
                                                                                 : 0;
    as->generic = !as->levels;
    as->kind = info->type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR      ? GN_OBJECT_TLAS
               : info->type == VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR ? GN_OBJECT_BLAS
                                                                               : GN_OBJECT_STRUCTURE;
    gn_tally_check(device, GN_CHECKED_structures, 1);
    gn_lock(device);
    as->created_at = ++device->position;
    if (!gn_map_put(&device->structures, (uint64_t)*out, as)) {
        gn_as_release(as);
        as = NULL;
        gn_tally_lost(device);
    }
    device->addressless += as != NULL;
    if (as)
        gn_structure_enter(device, as);
    /* The address is asked at once where that is allowed: an application may have kept it from an earlier structure
     * in the same place and never ask. */
    struct gn_buffer *buffer = gn_map_get(&device->buffers, (uint64_t)info->buffer);
    if (as)
        as->base = buffer && buffer->address ? buffer->address + info->offset : UINT64_C(1) << 63 | as->id << 36;
    if (as && buffer) {
        as->shared = buffer->external;
        gn_buffer_holds(buffer, as);
    }
    if (as && buffer && buffer->bound && buffer->has_address) {
        VkAccelerationStructureDeviceAddressInfoKHR query = {
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_DEVICE_ADDRESS_INFO_KHR, .accelerationStructure = *out};
        learn_address(device, as, device->next.GetAccelerationStructureDeviceAddressKHR(handle, &query));
    }
    gn_unlock(device);
    return result;
}

VKAPI_ATTR VkDeviceAddress VKAPI_CALL gn_entry_GetAccelerationStructureDeviceAddressKHR(
    VkDevice handle, const VkAccelerationStructureDeviceAddressInfoKHR *info)
{
    struct gn_device *device = gn_device_of(handle);
    VkDeviceAddress address = device->next.GetAccelerationStructureDeviceAddressKHR(handle, info);
    gn_lock(device);
    struct gn_as *as = gn_as_get(device, info->accelerationStructure);
    if (as)
        learn_address(device, as, address);
    gn_unlock(device);
    return address;
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyAccelerationStructureKHR(VkDevice handle, VkAccelerationStructureKHR structure,
                                                                    const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    if (structure) {
        gn_device_collect(device);
        gn_lock(device);
        struct gn_as *as = gn_map_take(&device->structures, (uint64_t)structure);
        if (as) {
            const uint32_t room = sizeof device->graves / sizeof device->graves[0];
            struct gn_as **grave = &device->graves[device->grave_count++ % room];
            gn_as_release(*grave);
            *grave = gn_as_keep(as);
            device->addressless -= !as->address;
            as->destroyed_at = ++device->position;
            gn_structure_tell(device, as);
            gn_buffer_lets_go(as);
            if (as->writes && as->levels != GN_LEVEL_TOP)
                gn_change_add(device, as, GN_CHANGE_DESTROYED, GN_QUEUE_HOST, as->destroyed_at);
            as->next_destroyed = device->destroyed;
            device->destroyed = as;
            if (!atomic_load(&device->pending))
                gn_as_purge(device);
        }
        gn_unlock(device);
    }
    device->next.DestroyAccelerationStructureKHR(handle, structure, allocator);
}

void gn_as_finish(struct gn_device *device)
{
    size_t cursor = 0;
    struct gn_as *as;
    gn_as_purge(device);
    for (size_t i = 0; i < sizeof device->graves / sizeof device->graves[0]; i++)
        gn_as_release(device->graves[i]);
    while ((as = gn_map_next(&device->structures, &cursor)))
        gn_as_release(as);
    gn_map_finish(&device->structures);
    gn_map_finish(&device->addresses);
}
