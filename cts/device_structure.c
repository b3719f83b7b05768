/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Builds acceleration structures and takes them through their steps: refit, rebuild, compaction, clone,
 * serialization. All structures of a call go through a step together, in three phases, because sizes have to
 * be read back between a query and a copy.
 */
#include <stdlib.h>
#include <string.h>

#include "cts/device_internal.h"

/* VkAccelerationStructureCreateInfoKHR::offset must be a multiple of it; so must addresses of serialized data. */
#define STRUCTURE_ALIGNMENT 256

/* The head of serialized data, as the specification lays it out; then come `handle_count` addresses of BLASes. */
struct serialized_head {
    uint8_t driver_uuid[VK_UUID_SIZE];
    uint8_t compatibility_uuid[VK_UUID_SIZE];
    uint64_t serialized_size;
    uint64_t deserialized_size;
    uint64_t handle_count;
};

struct steps_run {
    struct gn_device *device;
    const struct gn_structure_pools *pools;
    struct gn_structure *structures;
    uint32_t count;
    const VkDeviceAddress *blas_addresses;
    uint32_t blas_count;
    uint32_t step; /* the round */
};

bool gn_steps_take_final(const uint8_t *steps)
{
    for (uint32_t i = 0; i < GN_CTS_MAX_STEPS && steps[i] != GN_CTS_STEP_END; i++) {
        if (steps[i] == GN_CTS_STEP_REFIT || steps[i] == GN_CTS_STEP_REFIT_COPY || steps[i] == GN_CTS_STEP_REBUILD) {
            return true;
        }
    }
    return false;
}

/* The step that a structure takes in this round; END from its last one on. */
static enum gn_cts_step step_of(const struct gn_structure *structure, uint32_t round)
{
    for (uint32_t i = 0; i <= round; i++) {
        if (i == GN_CTS_MAX_STEPS || structure->steps[i] == GN_CTS_STEP_END) {
            return GN_CTS_STEP_END;
        }
    }
    return structure->steps[round];
}

static void poison(struct gn_device *device, const struct gn_memory *memory)
{
    vkCmdFillBuffer(device->commands, memory->buffer, memory->offset, memory->size, GN_POISON_WORD);
}

static enum gn_device_status handle_create(const struct steps_run *run, struct gn_structure *structure,
                                           VkDeviceSize size)
{
    struct gn_device *device = run->device;
    enum gn_device_status status =
        gn_pool_take(device, run->pools->structures, size, STRUCTURE_ALIGNMENT, &structure->memory);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    const VkAccelerationStructureCreateInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
        .buffer = structure->memory.buffer,
        .offset = structure->memory.offset,
        .size = size,
        .type = structure->generic ? VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR : structure->type,
    };
    const VkResult result =
        device->CreateAccelerationStructureKHR(device->handle, &info, NULL, &structure->handle);
    if ((status = gn_device_check(device, result, "vkCreateAccelerationStructureKHR")) != GN_DEVICE_OK) {
        structure->handle = VK_NULL_HANDLE;
        return status;
    }
    const VkAccelerationStructureDeviceAddressInfoKHR address_info = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_DEVICE_ADDRESS_INFO_KHR,
        .accelerationStructure = structure->handle,
    };
    structure->size = size;
    structure->address = device->GetAccelerationStructureDeviceAddressKHR(device->handle, &address_info);
    return GN_DEVICE_OK;
}

/* The structure becomes the source of a copy or update into a new one of `size` bytes. */
static enum gn_device_status handle_replace(const struct steps_run *run, struct gn_structure *structure,
                                            VkDeviceSize size)
{
    structure->source = structure->handle;
    structure->source_memory = structure->memory;
    structure->handle = VK_NULL_HANDLE;
    return handle_create(run, structure, size);
}

static void source_destroy(struct gn_device *device, struct gn_structure *structure)
{
    if (structure->source && !device->lost) {
        device->DestroyAccelerationStructureKHR(device->handle, structure->source, NULL);
    }
    structure->source = VK_NULL_HANDLE;
}

static VkAccelerationStructureBuildGeometryInfoKHR build_info(const struct gn_structure *structure,
                                                              const struct gn_build_input *input)
{
    return (VkAccelerationStructureBuildGeometryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = structure->type,
        .flags = structure->flags,
        .mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
        .dstAccelerationStructure = structure->handle,
        .geometryCount = structure->geometry_count,
        .pGeometries = input->geometries,
        .scratchData.deviceAddress = structure->scratch.address,
    };
}

static enum gn_device_status sizes_query(struct gn_device *device, struct gn_structure *structure)
{
    /* Initial and final input differ in their data only, and sizes do not depend on data. */
    const VkAccelerationStructureBuildGeometryInfoKHR info = build_info(structure, &structure->final);
    structure->sizes = (VkAccelerationStructureBuildSizesInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR,
    };
    device->GetAccelerationStructureBuildSizesKHR(device->handle, VK_ACCELERATION_STRUCTURE_BUILD_TYPE_DEVICE_KHR,
                                                  &info, structure->primitive_counts, &structure->sizes);
    if (structure->sizes.accelerationStructureSize == 0) {
        return gn_device_fail(device, GN_DEVICE_FAILED,
                              "vkGetAccelerationStructureBuildSizesKHR gave a size of 0 bytes");
    }
    return GN_DEVICE_OK;
}

static enum gn_device_status first_build(struct steps_run *run, bool separate)
{
    struct gn_device *device = run->device;
    const VkDeviceSize scratch_alignment = device->info.limits.minAccelerationStructureScratchOffsetAlignment;
    enum gn_device_status status = GN_DEVICE_OK;
    VkAccelerationStructureBuildGeometryInfoKHR *infos = calloc(run->count, sizeof *infos);
    const VkAccelerationStructureBuildRangeInfoKHR **ranges = calloc(run->count, sizeof *ranges);
    if (!infos || !ranges) {
        status = gn_device_fail(device, GN_DEVICE_FAILED, "no host memory for %u builds", run->count);
        goto done;
    }
    for (uint32_t i = 0; i < run->count; i++) {
        struct gn_structure *structure = &run->structures[i];
        if ((status = sizes_query(device, structure)) != GN_DEVICE_OK ||
            (status = handle_create(run, structure, structure->sizes.accelerationStructureSize)) != GN_DEVICE_OK) {
            goto done;
        }
        const VkDeviceSize scratch = structure->sizes.buildScratchSize > structure->sizes.updateScratchSize
                                         ? structure->sizes.buildScratchSize
                                         : structure->sizes.updateScratchSize;
        status = gn_pool_take(device, run->pools->scratch, scratch, scratch_alignment ? scratch_alignment : 1,
                              &structure->scratch);
        if (status != GN_DEVICE_OK) {
            goto done;
        }
        structure->size_before_compaction = structure->size;
        const struct gn_build_input *input =
            gn_steps_take_final(structure->steps) ? &structure->initial : &structure->final;
        infos[i] = build_info(structure, input);
        ranges[i] = input->ranges;
    }
    if ((status = gn_device_begin(device)) != GN_DEVICE_OK) {
        goto done;
    }
    for (uint32_t i = 0; i < run->count; i++) {
        poison(device, &run->structures[i].memory);
        poison(device, &run->structures[i].scratch);
    }
    gn_device_barrier(device);
    if (separate) {
        for (uint32_t i = 0; i < run->count; i++) {
            device->CmdBuildAccelerationStructuresKHR(device->commands, 1, &infos[i], &ranges[i]);
        }
    } else {
        device->CmdBuildAccelerationStructuresKHR(device->commands, run->count, infos, ranges);
    }
    status = gn_device_submit(device);
done:
    free(infos);
    free(ranges);
    return status;
}

/* Phase 1 of a round: builds and clones. */
static enum gn_device_status phase_build(struct steps_run *run)
{
    struct gn_device *device = run->device;
    enum gn_device_status status = gn_device_begin(device);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    for (uint32_t i = 0; i < run->count; i++) {
        struct gn_structure *structure = &run->structures[i];
        switch (step_of(structure, run->step)) {
        case GN_CTS_STEP_REFIT_COPY:
            status = handle_replace(run, structure, structure->sizes.accelerationStructureSize);
            if (status != GN_DEVICE_OK) {
                return status;
            }
            structure->compacted = false;
            poison(device, &structure->memory);
            poison(device, &structure->scratch);
            break;
        case GN_CTS_STEP_CLONE:
            if ((status = handle_replace(run, structure, structure->size)) != GN_DEVICE_OK) {
                return status;
            }
            poison(device, &structure->memory);
            break;
        case GN_CTS_STEP_REBUILD:
            if (structure->compacted) {
                return gn_device_fail(device, GN_DEVICE_FAILED,
                                      "a rebuild does not fit into a compacted structure: the scene is not valid");
            }
            poison(device, &structure->scratch);
            break;
        case GN_CTS_STEP_REFIT:
        case GN_CTS_STEP_REFIT_BACK:
            poison(device, &structure->scratch);
            break;
        default:
            break;
        }
    }
    gn_device_barrier(device);
    for (uint32_t i = 0; i < run->count; i++) {
        struct gn_structure *structure = &run->structures[i];
        const enum gn_cts_step step = step_of(structure, run->step);
        switch (step) {
        case GN_CTS_STEP_REFIT:
        case GN_CTS_STEP_REFIT_BACK:
        case GN_CTS_STEP_REFIT_COPY:
        case GN_CTS_STEP_REBUILD: {
            const struct gn_build_input *input =
                step == GN_CTS_STEP_REFIT_BACK ? &structure->initial : &structure->final;
            VkAccelerationStructureBuildGeometryInfoKHR info = build_info(structure, input);
            const VkAccelerationStructureBuildRangeInfoKHR *ranges = input->ranges;
            if (step != GN_CTS_STEP_REBUILD) {
                info.mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
                info.srcAccelerationStructure =
                    step == GN_CTS_STEP_REFIT_COPY ? structure->source : structure->handle;
            }
            device->CmdBuildAccelerationStructuresKHR(device->commands, 1, &info, &ranges);
            break;
        }
        case GN_CTS_STEP_CLONE: {
            const VkCopyAccelerationStructureInfoKHR info = {
                .sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                .src = structure->source,
                .dst = structure->handle,
                .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR,
            };
            device->CmdCopyAccelerationStructureKHR(device->commands, &info);
            break;
        }
        default:
            break;
        }
    }
    return gn_device_submit(device);
}

static enum gn_device_status sizes_ask(struct steps_run *run, enum gn_cts_step step, VkQueryType type)
{
    struct gn_device *device = run->device;
    enum gn_device_status status = GN_DEVICE_OK;
    bool any = false;
    for (uint32_t i = 0; i < run->count; i++) {
        any = any || step_of(&run->structures[i], run->step) == step;
    }
    if (!any) {
        return GN_DEVICE_OK;
    }
    VkQueryPool queries = VK_NULL_HANDLE;
    const VkQueryPoolCreateInfo pool_info = {
        .sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO,
        .queryType = type,
        .queryCount = run->count,
    };
    VkResult result = vkCreateQueryPool(device->handle, &pool_info, NULL, &queries);
    if ((status = gn_device_check(device, result, "vkCreateQueryPool")) != GN_DEVICE_OK) {
        return status;
    }
    if ((status = gn_device_begin(device)) != GN_DEVICE_OK) {
        goto done;
    }
    vkCmdResetQueryPool(device->commands, queries, 0, run->count);
    gn_device_barrier(device);
    for (uint32_t i = 0; i < run->count; i++) {
        if (step_of(&run->structures[i], run->step) == step) {
            device->CmdWriteAccelerationStructuresPropertiesKHR(device->commands, 1, &run->structures[i].handle,
                                                                type, queries, i);
        }
    }
    if ((status = gn_device_submit(device)) != GN_DEVICE_OK) {
        goto done;
    }
    for (uint32_t i = 0; i < run->count; i++) {
        struct gn_structure *structure = &run->structures[i];
        if (step_of(structure, run->step) != step) {
            continue;
        }
        uint64_t size = 0;
        result = vkGetQueryPoolResults(device->handle, queries, i, 1, sizeof size, &size, sizeof size,
                                       VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT);
        if ((status = gn_device_check(device, result, "vkGetQueryPoolResults")) != GN_DEVICE_OK) {
            goto done;
        }
        structure->queried_size = size;
    }
done:
    if (!device->lost) {
        vkDestroyQueryPool(device->handle, queries, NULL);
    }
    return status;
}

/* Phase 2: what waited for a size is copied. */
static enum gn_device_status phase_copy(struct steps_run *run)
{
    struct gn_device *device = run->device;
    enum gn_device_status status = gn_device_begin(device);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    for (uint32_t i = 0; i < run->count; i++) {
        struct gn_structure *structure = &run->structures[i];
        const enum gn_cts_step step = step_of(structure, run->step);
        if (step == GN_CTS_STEP_COMPACT) {
            if (structure->queried_size == 0 || structure->queried_size > structure->size) {
                return gn_device_fail(device, GN_DEVICE_FAILED,
                                      "a structure of %llu bytes has a compacted size of %llu bytes",
                                      (unsigned long long)structure->size,
                                      (unsigned long long)structure->queried_size);
            }
            if ((status = handle_replace(run, structure, structure->queried_size)) != GN_DEVICE_OK) {
                return status;
            }
            structure->compacted = true;
            poison(device, &structure->memory);
        } else if (step == GN_CTS_STEP_SERIALIZE) {
            if (structure->queried_size < sizeof(struct serialized_head)) {
                return gn_device_fail(device, GN_DEVICE_FAILED,
                                      "a serialized structure has %llu bytes, its head alone takes %zu",
                                      (unsigned long long)structure->queried_size, sizeof(struct serialized_head));
            }
            status = gn_pool_take(device, run->pools->serialized, structure->queried_size, STRUCTURE_ALIGNMENT,
                                  &structure->serialized);
            if (status != GN_DEVICE_OK) {
                return status;
            }
            poison(device, &structure->serialized);
        }
    }
    gn_device_barrier(device);
    for (uint32_t i = 0; i < run->count; i++) {
        struct gn_structure *structure = &run->structures[i];
        const enum gn_cts_step step = step_of(structure, run->step);
        if (step == GN_CTS_STEP_COMPACT) {
            const VkCopyAccelerationStructureInfoKHR info = {
                .sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                .src = structure->source,
                .dst = structure->handle,
                .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR,
            };
            device->CmdCopyAccelerationStructureKHR(device->commands, &info);
        } else if (step == GN_CTS_STEP_SERIALIZE) {
            const VkCopyAccelerationStructureToMemoryInfoKHR info = {
                .sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_TO_MEMORY_INFO_KHR,
                .src = structure->handle,
                .dst.deviceAddress = structure->serialized.address,
                .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_SERIALIZE_KHR,
            };
            device->CmdCopyAccelerationStructureToMemoryKHR(device->commands, &info);
        }
    }
    return gn_device_submit(device);
}

/* Whether the head of serialized data says what the specification wants it to say. */
static enum gn_device_status serialized_check(const struct steps_run *run, const struct gn_structure *structure,
                                              struct serialized_head *out_head)
{
    struct gn_device *device = run->device;
    const uint8_t *bytes = structure->serialized.mapped;
    const VkAccelerationStructureVersionInfoKHR version = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_VERSION_INFO_KHR,
        .pVersionData = bytes,
    };
    VkAccelerationStructureCompatibilityKHR compatibility = VK_ACCELERATION_STRUCTURE_COMPATIBILITY_INCOMPATIBLE_KHR;
    device->GetDeviceAccelerationStructureCompatibilityKHR(device->handle, &version, &compatibility);
    if (compatibility != VK_ACCELERATION_STRUCTURE_COMPATIBILITY_COMPATIBLE_KHR) {
        return gn_device_fail(device, GN_DEVICE_FAILED,
                              "the device says that a structure it has just serialized is not compatible with it");
    }
    memcpy(out_head, bytes, sizeof *out_head);
    const uint64_t room = (structure->queried_size - sizeof *out_head) / sizeof(uint64_t);
    const bool bottom = structure->type == VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR;
    if (out_head->serialized_size != structure->queried_size || out_head->deserialized_size == 0 ||
        out_head->handle_count > (bottom ? 0 : room)) {
        return gn_device_fail(device, GN_DEVICE_FAILED,
                              "the head of a serialized structure says %llu bytes, %llu deserialized, %llu handles; "
                              "the query said %llu bytes",
                              (unsigned long long)out_head->serialized_size,
                              (unsigned long long)out_head->deserialized_size,
                              (unsigned long long)out_head->handle_count,
                              (unsigned long long)structure->queried_size);
    }
    for (uint64_t i = 0; i < out_head->handle_count; i++) {
        uint64_t handle = 0;
        memcpy(&handle, bytes + sizeof *out_head + i * sizeof handle, sizeof handle);
        bool known = handle == 0;
        for (uint32_t b = 0; b < run->blas_count && !known; b++) {
            known = handle == run->blas_addresses[b];
        }
        if (!known) {
            return gn_device_fail(device, GN_DEVICE_FAILED,
                                  "handle %llu of a serialized top level structure is 0x%llx, which is the address "
                                  "of none of its bottom level structures",
                                  (unsigned long long)i, (unsigned long long)handle);
        }
    }
    return GN_DEVICE_OK;
}

/* Phase 3: sources are destroyed and their memory poisoned; what was serialized is made anew. */
static enum gn_device_status phase_finish(struct steps_run *run)
{
    struct gn_device *device = run->device;
    enum gn_device_status status = gn_device_begin(device);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    for (uint32_t i = 0; i < run->count; i++) {
        struct gn_structure *structure = &run->structures[i];
        if (step_of(structure, run->step) == GN_CTS_STEP_SERIALIZE) {
            struct serialized_head head;
            if ((status = serialized_check(run, structure, &head)) != GN_DEVICE_OK ||
                (status = handle_replace(run, structure, head.deserialized_size)) != GN_DEVICE_OK) {
                return status;
            }
            poison(device, &structure->memory);
        }
        if (structure->source) {
            source_destroy(device, structure);
            poison(device, &structure->source_memory);
        }
    }
    gn_device_barrier(device);
    for (uint32_t i = 0; i < run->count; i++) {
        const struct gn_structure *structure = &run->structures[i];
        if (step_of(structure, run->step) == GN_CTS_STEP_SERIALIZE) {
            const VkCopyMemoryToAccelerationStructureInfoKHR info = {
                .sType = VK_STRUCTURE_TYPE_COPY_MEMORY_TO_ACCELERATION_STRUCTURE_INFO_KHR,
                .src.deviceAddress = structure->serialized.address,
                .dst = structure->handle,
                .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_DESERIALIZE_KHR,
            };
            device->CmdCopyMemoryToAccelerationStructureKHR(device->commands, &info);
        }
    }
    if ((status = gn_device_submit(device)) != GN_DEVICE_OK) {
        return status;
    }
    for (uint32_t i = 0; i < run->count; i++) {
        struct gn_structure *structure = &run->structures[i];
        if (step_of(structure, run->step) == GN_CTS_STEP_SERIALIZE) {
            memset(structure->serialized.mapped, 0xFF, structure->serialized.size);
        }
    }
    return GN_DEVICE_OK;
}

enum gn_device_status gn_structures_build(struct gn_device *device, const struct gn_structure_pools *pools,
                                          struct gn_structure *structures, uint32_t count, bool separate_builds,
                                          const VkDeviceAddress *blas_addresses, uint32_t blas_count)
{
    struct steps_run run = {
        .device = device,
        .pools = pools,
        .structures = structures,
        .count = count,
        .blas_addresses = blas_addresses,
        .blas_count = blas_count,
    };
    if (count == 0) {
        return GN_DEVICE_OK;
    }
    enum gn_device_status status = first_build(&run, separate_builds);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    bool again = false; /* whether the initial data will be read once more */
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t s = 0; s < GN_CTS_MAX_STEPS && structures[i].steps[s] != GN_CTS_STEP_END; s++)
            again = again || structures[i].steps[s] == GN_CTS_STEP_REFIT_BACK;
    if (!again)
        gn_pool_poison(pools->initial);
    for (run.step = 0; run.step < GN_CTS_MAX_STEPS; run.step++) {
        bool any = false;
        for (uint32_t i = 0; i < count; i++) {
            any = any || step_of(&structures[i], run.step) != GN_CTS_STEP_END;
        }
        if (!any) {
            break;
        }
        if ((status = phase_build(&run)) != GN_DEVICE_OK ||
            (status = sizes_ask(&run, GN_CTS_STEP_COMPACT,
                                VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR)) != GN_DEVICE_OK ||
            (status = sizes_ask(&run, GN_CTS_STEP_SERIALIZE,
                                VK_QUERY_TYPE_ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR)) != GN_DEVICE_OK ||
            (status = phase_copy(&run)) != GN_DEVICE_OK || (status = phase_finish(&run)) != GN_DEVICE_OK) {
            return status;
        }
    }
    return GN_DEVICE_OK;
}

void gn_structures_finish(struct gn_device *device, struct gn_structure *structures, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        source_destroy(device, &structures[i]);
        if (structures[i].handle && !device->lost) {
            device->DestroyAccelerationStructureKHR(device->handle, structures[i].handle, NULL);
        }
        structures[i].handle = VK_NULL_HANDLE;
    }
}
