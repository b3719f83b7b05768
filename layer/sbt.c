/* SPDX-License-Identifier: Apache-2.0 */
/* Shader binding tables: the regions of a trace are checked when it is recorded, their records are copied before it runs, and each handle
 * is looked up among those of the bound pipeline once it has completed. */
#include "layer/sbt.h"
#include "layer/shader.h"

#include <stdlib.h>
#include <string.h>

void gn_sbt_capture_free(struct gn_sbt_capture *sbt)
{
    if (!sbt)
        return;
    for (uint32_t i = 0; i < sbt->tlas_count; i++)
        gn_as_release(sbt->tlas[i]);
    gn_rays_release(sbt->rays);
    gn_use_free(sbt->use);
    free(sbt);
}

static const char *const address_names[] = {"pRaygenShaderBindingTable->deviceAddress", "pMissShaderBindingTable->deviceAddress",
                                            "pHitShaderBindingTable->deviceAddress", "pCallableShaderBindingTable->deviceAddress"};
static const char *const stride_names[] = {"pRaygenShaderBindingTable->stride", "pMissShaderBindingTable->stride",
                                           "pHitShaderBindingTable->stride", "pCallableShaderBindingTable->stride"};
static const char *const size_names[] = {"pRaygenShaderBindingTable->size", "pMissShaderBindingTable->size", "pHitShaderBindingTable->size",
                                         "pCallableShaderBindingTable->size"};

/* What is being checked. */
struct subject {
    struct gn_device *device;
    const struct gn_rays *rays;
    bool buffers_gone; /* what is known of buffers may not be what was then */
    struct gn_fault *faults;
};

static void demand(struct subject *subject, enum gn_demand_kind kind, const char *what, uint64_t value, uint64_t bound, const char *needs,
                   const struct gn_buffer *buffer)
{
    struct gn_fault *fault = calloc(1, sizeof *fault);
    if (!fault) {
        gn_tally_lost(subject->device);
        return;
    }
    *fault = (struct gn_fault){.kind = GN_FAULT_DEMAND,
                               .of.demand = {.kind = kind,
                                             .target = {GN_OBJECT_PIPELINE, (uint64_t)subject->rays->handle, NULL},
                                             .target_id = subject->rays->id,
                                             .info = GN_NO_INDEX,
                                             .geometry = GN_NO_INDEX,
                                             .what = what,
                                             .value = value,
                                             .bound = bound,
                                             .needs = needs},
                               .next = subject->faults};
    if (buffer)
        fault->of.demand.buffer = (struct gn_object){GN_OBJECT_BUFFER, (uint64_t)buffer->handle, NULL};
    subject->faults = fault;
}

static void check_part(struct subject *subject, enum gn_sbt_part part, const VkStridedDeviceAddressRegionKHR *region)
{
    const VkPhysicalDeviceRayTracingPipelinePropertiesKHR *limits = &subject->device->ray_limits;
    struct gn_buffer *around;
    if (!region->deviceAddress || (!region->size && part != GN_SBT_RAYGEN))
        return;
    if (limits->shaderGroupBaseAlignment && region->deviceAddress % limits->shaderGroupBaseAlignment)
        demand(subject, GN_DEMAND_SBT_ALIGNMENT, address_names[part], region->deviceAddress, limits->shaderGroupBaseAlignment,
               "shaderGroupBaseAlignment", NULL);
    if (part == GN_SBT_RAYGEN) {
        if (region->size != region->stride)
            demand(subject, GN_DEMAND_SBT_RAYGEN, size_names[part], region->size, region->stride, NULL, NULL);
    } else {
        if (limits->shaderGroupHandleAlignment && region->stride % limits->shaderGroupHandleAlignment)
            demand(subject, GN_DEMAND_SBT_ALIGNMENT, stride_names[part], region->stride, limits->shaderGroupHandleAlignment,
                   "shaderGroupHandleAlignment", NULL);
        if (limits->maxShaderGroupStride && region->stride > limits->maxShaderGroupStride)
            demand(subject, GN_DEMAND_SBT_LIMIT, stride_names[part], region->stride, limits->maxShaderGroupStride, "maxShaderGroupStride",
                   NULL);
    }
    if (subject->buffers_gone)
        return;
    if (!gn_buffer_has_usage(subject->device, region->deviceAddress, VK_BUFFER_USAGE_SHADER_BINDING_TABLE_BIT_KHR, &around) && around)
        demand(subject, GN_DEMAND_SBT_USAGE, address_names[part], region->deviceAddress, 0, "VK_BUFFER_USAGE_SHADER_BINDING_TABLE_BIT_KHR",
               around);
    uint64_t end = gn_buffers_end(subject->device, region->deviceAddress);
    if (end > region->deviceAddress && end - region->deviceAddress < region->size)
        demand(subject, GN_DEMAND_SBT_RANGE, size_names[part], end - region->deviceAddress, region->size, NULL, NULL);
}

struct gn_sbt_region gn_sbt_region_of(enum gn_sbt_part part, const VkStridedDeviceAddressRegionKHR *in, uint32_t handle_size)
{
    struct gn_sbt_region region = {.address = in->deviceAddress, .stride = in->stride};
    if (!in->deviceAddress || in->size < handle_size)
        return region;
    region.records = part == GN_SBT_RAYGEN || !in->stride ? 1 : (in->size - handle_size) / in->stride + 1;
    return region;
}

/* Prepares to read the records. NULL when there are none, or it cannot be done, which is counted. */
static struct gn_capture *prepare(struct gn_device *device, const struct gn_command_buffer *commands, struct gn_sbt_capture *sbt,
                                  struct gn_copies *copies)
{
    VkDeviceSize size = 0, budget = device->instance->settings.sbt_cap, sizes[GN_SBT_PARTS] = {0};
    struct gn_buffer *buffers[GN_SBT_PARTS] = {NULL};
    struct gn_capture *capture = NULL;
    uint32_t handle_size = sbt->rays->handle_size, before = copies->count;
    if (!budget)
        return NULL;
    if (!device->copies || commands->pool->is_protected)
        goto unread;
    for (int part = 0; part < GN_SBT_PARTS; part++) {
        struct gn_sbt_region *region = &sbt->regions[part];
        if (!region->records)
            continue;
        uint64_t fit = budget < handle_size ? 0 : !region->stride ? region->records : (budget - handle_size) / region->stride + 1;
        region->read = region->records < fit ? region->records : fit;
        gn_tally_unjudged(device, GN_UNJUDGED_above_sbt_cap, region->records - region->read);
        if (!region->read)
            continue;
        sizes[part] = (region->read - 1) * region->stride + handle_size;
        struct gn_buffer *buffer = gn_buffer_holding(device, region->address, sizes[part]);
        if (!buffer)
            buffer = gn_buffer_other(device, region->address, sizes[part]);
        if (!buffer || !buffer->can_copy) {
            region->read = sizes[part] = 0;
            gn_tally_unjudged(device, GN_UNJUDGED_unreadable_sbt, 1);
            continue;
        }
        buffers[part] = buffer;
        budget -= sizes[part];
        sbt->offsets[part] = size;
        size += (sizes[part] + 15) & ~(VkDeviceSize)15;
    }
    if (!size)
        return NULL;
    if (!(capture = calloc(1, sizeof *capture)) || !gn_staging_take(device, size, capture))
        goto fail;
    for (int part = 0; part < GN_SBT_PARTS; part++) {
        VkBufferCopy region = {buffers[part] ? sbt->regions[part].address - buffers[part]->range.base : 0,
                               capture->offset + sbt->offsets[part], sizes[part]};
        if (buffers[part] && !gn_copies_add(copies, buffers[part]->handle, gn_staging_buffer(capture), &region)) {
            gn_staging_give(device, capture);
            goto fail;
        }
    }
    capture->sbt = sbt;
    return capture;
fail:
    copies->count = before;
    free(capture);
unread:
    gn_tally_unjudged(device, GN_UNJUDGED_unreadable_sbt, 1);
    return NULL;
}

void gn_sbt_trace(struct gn_device *device, VkCommandBuffer handle, const VkStridedDeviceAddressRegionKHR *const parts[GN_SBT_PARTS],
                  const char *command, uint64_t invocations)
{
    struct gn_copies copies;
    bool simultaneous = false;
    if (!atomic_load_explicit(&device->ray_pipelines, memory_order_acquire) || !invocations)
        return;
    gn_copies_init(&copies);
    gn_lock(device);
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    struct gn_rays *rays = commands ? commands->rays : NULL;
    struct gn_sbt_capture *sbt = NULL;
    if (!rays) {
        gn_tally_unjudged(device, GN_UNJUDGED_unknown_rays, 1);
        goto done;
    }
    struct subject subject = {.device = device, .rays = rays};
    uint64_t most = device->ray_limits.maxRayDispatchInvocationCount;
    if (most && invocations != UINT64_MAX && invocations > most)
        demand(&subject, GN_DEMAND_SBT_LIMIT, "width * height * depth", invocations, most, "maxRayDispatchInvocationCount", NULL);
    for (int part = 0; part < GN_SBT_PARTS; part++)
        check_part(&subject, (enum gn_sbt_part)part, parts[part]);
    struct gn_event event = {.kind = GN_EVENT_TRACE,
                             .command = gn_command_buffer_next(commands),
                             .faults = subject.faults,
                             .unjudged = GN_UNJUDGED_COUNT};
    if ((sbt = calloc(1, sizeof *sbt))) {
        *sbt = (struct gn_sbt_capture){.command = command, .rays = rays, .runs = invocations != UINT64_MAX};
        rays->references++;
        for (int part = 0; part < GN_SBT_PARTS; part++)
            sbt->regions[part] = gn_sbt_region_of((enum gn_sbt_part)part, parts[part], rays->handle_size);
        sbt->use = gn_use_make(device, commands, GN_BIND_RAYS, command, sbt->runs);
        event.capture = prepare(device, commands, sbt, &copies);
        if (event.capture)
            sbt = NULL; /* it is the capture's */
    } else {
        gn_tally_unjudged(device, GN_UNJUDGED_out_of_host_memory, 1);
    }
    simultaneous = commands->simultaneous;
    if (!event.capture && !event.faults)
        goto done;
    if (!gn_command_buffer_add(device, commands, &event)) {
        copies.count = 0;
        gn_faults_free(event.faults);
        gn_captures_free(device, event.capture);
    }
done:
    gn_sbt_capture_free(sbt);
    gn_unlock(device);
    if (copies.count)
        gn_copies_record(device, handle, &copies, VK_PIPELINE_STAGE_RAY_TRACING_SHADER_BIT_KHR, simultaneous);
    gn_copies_finish(&copies);
}

void gn_sbt_trace_indirect(struct gn_device *device, VkCommandBuffer handle, VkDeviceAddress address)
{
    const VkDeviceSize size = sizeof(VkTraceRaysIndirectCommand2KHR);
    struct gn_copies copies;
    bool simultaneous = false;
    if (!atomic_load_explicit(&device->ray_pipelines, memory_order_acquire))
        return;
    gn_copies_init(&copies);
    gn_lock(device);
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    const struct gn_buffer *buffer = gn_buffer_other(device, address, size);
    if (!buffer)
        buffer = gn_buffer_holding(device, address, size);
    struct gn_capture *capture = NULL;
    struct gn_sbt_capture *sbt = NULL;
    if (!commands || !commands->rays) {
        gn_tally_unjudged(device, GN_UNJUDGED_unknown_rays, 1);
        goto done;
    }
    if (!device->copies || commands->pool->is_protected || !buffer || !buffer->can_copy || !device->instance->settings.sbt_cap)
        goto unread;
    capture = calloc(1, sizeof *capture);
    sbt = calloc(1, sizeof *sbt);
    if (!capture || !sbt || !gn_staging_take(device, size, capture)) {
        free(capture);
        free(sbt);
        goto unread;
    }
    *sbt = (struct gn_sbt_capture){.command = "vkCmdTraceRaysIndirect2KHR", .rays = commands->rays, .indirect = true};
    sbt->rays->references++;
    sbt->use = gn_use_make(device, commands, GN_BIND_RAYS, sbt->command, false);
    capture->sbt = sbt;
    VkBufferCopy region = {address - buffer->range.base, capture->offset, size};
    struct gn_event event = {.kind = GN_EVENT_TRACE,
                             .command = gn_command_buffer_next(commands),
                             .capture = capture,
                             .unjudged = GN_UNJUDGED_COUNT};
    simultaneous = commands->simultaneous;
    if (!gn_copies_add(&copies, buffer->handle, gn_staging_buffer(capture), &region) ||
        !gn_command_buffer_add(device, commands, &event)) {
        copies.count = 0;
        gn_captures_free(device, capture);
    }
    goto done;
unread:
    gn_tally_unjudged(device, GN_UNJUDGED_unreadable_sbt, 1);
done:
    gn_unlock(device);
    if (copies.count)
        gn_copies_record(device, handle, &copies, VK_PIPELINE_STAGE_DRAW_INDIRECT_BIT, simultaneous);
    gn_copies_finish(&copies);
}

void gn_sbt_executed(struct gn_device *device, struct gn_sbt_capture *sbt)
{
    sbt->buffers_gone = device->buffers_gone;
    for (uint32_t i = 0; i < sbt->tlas_count; i++)
        gn_as_release(sbt->tlas[i]);
    sbt->tlas_count = 0;
    for (uint32_t i = 0; sbt->use && i < sbt->use->count && sbt->tlas_count < GN_SBT_MAX_TLAS; i++) {
        const struct gn_use_entry *entry = &sbt->use->entries[i];
        struct gn_as *tlas = entry->set->slots[entry->slot];
        uint32_t at = 0;
        if (!tlas || tlas->destroyed_at || !entry->rays)
            continue;
        while (at < sbt->tlas_count && sbt->tlas[at] != tlas)
            at++;
        bool known = at < sbt->tlas_count;
        sbt->ray_offsets[at] = known && sbt->ray_offsets[at] < entry->ray_offset ? sbt->ray_offsets[at] : entry->ray_offset;
        sbt->ray_strides[at] = known && sbt->ray_strides[at] < entry->ray_stride ? sbt->ray_strides[at] : entry->ray_stride;
        if (known)
            continue;
        sbt->versions[at] = tlas->writes;
        sbt->tlas[sbt->tlas_count++] = gn_as_keep(tlas);
    }
}

/* The group of the pipeline with this handle that fits best into the part; UINT32_MAX if there is none. */
static uint32_t find_group(const struct gn_rays *rays, const unsigned char *handle, uint64_t hash, bool (*fits)(unsigned kind, int part), int part)
{
    uintptr_t known = (uintptr_t)gn_map_get(&rays->groups, hash);
    uint32_t best = UINT32_MAX;
    for (uint32_t g = known ? (uint32_t)known - 1 : rays->group_count; g < rays->group_count; g++) {
        if (memcmp(rays->handles + (size_t)g * rays->handle_size, handle, rays->handle_size) != 0)
            continue;
        if (fits(rays->kinds[g], part))
            return g;
        if (best == UINT32_MAX)
            best = g;
    }
    return best;
}

static bool fits(unsigned kind, int part)
{
    switch (kind) {
    case GN_GROUP_RAYGEN: return part == GN_SBT_RAYGEN;
    case GN_GROUP_MISS: return part == GN_SBT_MISS;
    case GN_GROUP_TRIANGLES:
    case GN_GROUP_PROCEDURAL: return part == GN_SBT_HIT;
    case GN_GROUP_CALLABLE: return part == GN_SBT_CALLABLE;
    default: return true;
    }
}

static const char *const kind_names[] = {"a ray-generation shader", "a miss shader", "triangle hits", "procedural hits", "a callable shader", "?"};

static enum gn_sbt_handle classify(const struct gn_device *device, const struct gn_rays *rays, const unsigned char *handle, int part,
                                   struct gn_sbt_region *region)
{
    bool zero = true;
    for (uint32_t i = 0; i < rays->handle_size; i++)
        zero &= !handle[i];
    if (zero)
        return GN_HANDLE_NULL;
    uint64_t hash = gn_handle_hash(handle, rays->handle_size);
    uint32_t group = find_group(rays, handle, hash, fits, part);
    if (group != UINT32_MAX) {
        if (fits(rays->kinds[group], part))
            return GN_HANDLE_FITS;
        if (!region->unfit)
            region->unfit = kind_names[rays->kinds[group]];
        return GN_HANDLE_UNFIT;
    }
    const struct gn_rays *other = device->first_rays;
    while (other && (other == rays || find_group(other, handle, hash, fits, part) == UINT32_MAX))
        other = other->next;
    for (size_t i = 0; !other && i < sizeof device->former_rays / sizeof device->former_rays[0]; i++)
        if (device->former_rays[i] && device->former_rays[i] != rays &&
            find_group(device->former_rays[i], handle, hash, fits, part) != UINT32_MAX)
            other = device->former_rays[i];
    if (!other)
        return GN_HANDLE_UNKNOWN;
    if (region->foreign.kind == GN_OBJECT_NONE) {
        region->foreign = (struct gn_object){GN_OBJECT_PIPELINE, (uint64_t)other->handle, NULL};
        region->foreign_gone = other->destroyed;
    }
    return GN_HANDLE_FOREIGN;
}

static const char *name_of(struct gn_device *device, const struct gn_rays *rays)
{
    char **name = rays->destroyed || !device->shaders ? NULL : gn_pipeline_name(device, VK_OBJECT_TYPE_PIPELINE, (uint64_t)rays->handle);
    return name ? *name : NULL;
}

static void reach(const struct gn_sbt_capture *captured, uint32_t at, const struct gn_reach *reached, struct gn_sbt *sbt)
{
    const struct gn_as *tlas = captured->tlas[at];
    uint64_t record = (uint64_t)reached->offset + (uint64_t)reached->geometry * captured->ray_strides[at] + captured->ray_offsets[at];
    if (sbt->tlas.kind != GN_OBJECT_NONE && record <= sbt->record)
        return;
    sbt->tlas = (struct gn_object){GN_OBJECT_TLAS, (uint64_t)tlas->handle, tlas->name};
    sbt->tlas_id = tlas->id;
    sbt->record = record;
    sbt->instance = reached->instance;
    sbt->instance_offset = reached->offset;
    sbt->geometry = reached->geometry;
    sbt->ray_stride = captured->ray_strides[at];
    sbt->ray_offset = captured->ray_offsets[at];
}

/* The highest record that the instances of a TLAS need. */
static void reach_all(const struct gn_sbt_capture *captured, uint32_t at, struct gn_sbt *sbt)
{
    const struct gn_as *tlas = captured->tlas[at];
    const struct gn_reach plain = {0, tlas->highest_offset, tlas->highest_offset_at};
    reach(captured, at, &plain, sbt);
    for (uint32_t i = 0; tlas->reaches && i < tlas->reaches->count; i++)
        reach(captured, at, &tlas->reaches->list[i], sbt);
}

/* The regions as the trace found them in memory. False if it traced nothing. */
static bool read_regions(struct gn_device *device, const struct gn_capture *capture, const char *place, struct gn_sbt *sbt,
                         struct gn_findings *out)
{
    const struct gn_sbt_capture *captured = capture->sbt;
    struct subject subject = {
        .device = device, .rays = captured->rays, .buffers_gone = captured->buffers_gone != device->buffers_gone};
    VkTraceRaysIndirectCommand2KHR command;
    uint64_t invocations, most = device->ray_limits.maxRayDispatchInvocationCount;
    memcpy(&command, capture->bytes, sizeof command);
    if (__builtin_mul_overflow((uint64_t)command.width * command.height, command.depth, &invocations))
        invocations = UINT64_MAX;
    if (!invocations)
        return false;
    if (most && invocations > most)
        demand(&subject, GN_DEMAND_SBT_LIMIT, "width * height * depth", invocations, most, "maxRayDispatchInvocationCount", NULL);
    const VkStridedDeviceAddressRegionKHR regions[GN_SBT_PARTS] = {
        {command.raygenShaderRecordAddress, command.raygenShaderRecordSize, command.raygenShaderRecordSize},
        {command.missShaderBindingTableAddress, command.missShaderBindingTableStride, command.missShaderBindingTableSize},
        {command.hitShaderBindingTableAddress, command.hitShaderBindingTableStride, command.hitShaderBindingTableSize},
        {command.callableShaderBindingTableAddress, command.callableShaderBindingTableStride, command.callableShaderBindingTableSize}};
    for (int part = 0; part < GN_SBT_PARTS; part++) {
        check_part(&subject, (enum gn_sbt_part)part, &regions[part]);
        sbt->regions[part] = gn_sbt_region_of((enum gn_sbt_part)part, &regions[part], captured->rays->handle_size);
    }
    for (struct gn_fault *fault = subject.faults; fault; fault = fault->next)
        gn_fault_report(device, fault, place, out);
    gn_faults_free(subject.faults);
    gn_tally_unjudged(device, GN_UNJUDGED_unreadable_sbt, 1);
    return true;
}

void gn_sbt_judge(struct gn_device *device, const struct gn_capture *capture, const char *place, struct gn_findings *out)
{
    const struct gn_sbt_capture *captured = capture->sbt;
    const struct gn_rays *rays = captured->rays;
    struct gn_sbt sbt = {.place = place,
                         .pipeline = {GN_OBJECT_PIPELINE, (uint64_t)rays->handle, name_of(device, rays)},
                         .pipeline_id = rays->id,
                         .runs = captured->runs,
                         .handles_known = rays->handles_known,
                         .no_null_miss = (rays->flags & VK_PIPELINE_CREATE_2_RAY_TRACING_NO_NULL_MISS_SHADERS_BIT_KHR) != 0,
                         .no_null_hit = (rays->flags & (VK_PIPELINE_CREATE_2_RAY_TRACING_NO_NULL_CLOSEST_HIT_SHADERS_BIT_KHR |
                                                        VK_PIPELINE_CREATE_2_RAY_TRACING_NO_NULL_INTERSECTION_SHADERS_BIT_KHR)) != 0};
    memcpy(sbt.regions, captured->regions, sizeof sbt.regions);
    if (captured->indirect && !read_regions(device, capture, place, &sbt, out))
        return;
    for (int part = 0; part < GN_SBT_PARTS; part++) {
        struct gn_sbt_region *region = &sbt.regions[part];
        for (uint64_t i = 0; i < region->read; i++) {
            enum gn_sbt_handle kind =
                classify(device, rays, capture->bytes + captured->offsets[part] + i * region->stride, part, region);
            if (!region->count[kind]++)
                region->first[kind] = i;
            gn_tally_check(device, GN_CHECKED_sbt_records, 1);
        }
    }
    for (uint32_t i = 0; i < captured->tlas_count; i++)
        if (captured->tlas[i]->highest_offset_of == captured->versions[i])
            reach_all(captured, i, &sbt);
    gn_report_sbt(device->instance, &sbt, out);
    gn_tally_check(device, GN_CHECKED_traces, 1);
}
