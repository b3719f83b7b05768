/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Builds acceleration structures and takes them through their steps: refit, rebuild, compaction, clone,
 * serialization. All structures of a call go through a step together, in three phases, because sizes have to
 * be read back between a query and a copy.
 *
 * A phase records what the device does, submits it, and then does what the host does: memory is overwritten with
 * garbage by the device in either case.
 */
#include <stdlib.h>
#include <string.h>

#include "cts/device_internal.h"

/* VkAccelerationStructureCreateInfoKHR::offset must be a multiple of it; so must addresses of serialized data. */
#define STRUCTURE_ALIGNMENT 256

/* Queries are not the first of their pool. */
#define FIRST_QUERY 3

/* Bytes behind serialized data that nothing may touch. */
#define GUARD_BYTES 256

/* Ranges of indirect builds lie further apart than they are long, and their counts are given larger by so many. */
#define RANGE_STRIDE (sizeof(VkAccelerationStructureBuildRangeInfoKHR) + 12)

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
    const struct gn_structures_plan *plan;
    struct gn_structure *structures;
    uint32_t count;
    uint32_t step; /* the round */
};

/* Whether a step takes the final data, so that the first build takes the initial data. */
static bool steps_take_final(const uint8_t *steps)
{
    for (uint32_t i = 0; i < GN_CTS_MAX_STEPS && steps[i] != GN_CTS_STEP_END; i++) {
        if (steps[i] == GN_CTS_STEP_REFIT || steps[i] == GN_CTS_STEP_REFIT_COPY || steps[i] == GN_CTS_STEP_REBUILD) {
            return true;
        }
    }
    return false;
}

static bool step_serializes(enum gn_cts_step step)
{
    return step == GN_CTS_STEP_SERIALIZE || step == GN_CTS_STEP_SERIALIZE_OVER || step == GN_CTS_STEP_RELOCATE;
}

static bool step_builds(enum gn_cts_step step)
{
    return step == GN_CTS_STEP_REFIT || step == GN_CTS_STEP_REFIT_COPY || step == GN_CTS_STEP_REFIT_BACK ||
           step == GN_CTS_STEP_REBUILD;
}

bool gn_steps_take_both(const uint8_t *steps)
{
    bool over = false;
    for (uint32_t i = 0; i < GN_CTS_MAX_STEPS && steps[i] != GN_CTS_STEP_END; i++) {
        over = over || steps[i] == GN_CTS_STEP_CLONE_OVER || steps[i] == GN_CTS_STEP_SERIALIZE_OVER;
    }
    return over || steps_take_final(steps);
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

static void address_find(struct gn_device *device, struct gn_structure *structure)
{
    const VkAccelerationStructureDeviceAddressInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_DEVICE_ADDRESS_INFO_KHR,
        .accelerationStructure = structure->handle,
    };
    structure->address = device->GetAccelerationStructureDeviceAddressKHR(device->handle, &info);
}

static enum gn_device_status handle_create(const struct steps_run *run, struct gn_structure *structure,
                                           VkDeviceSize size)
{
    struct gn_device *device = run->device;
    enum gn_device_status status =
        gn_pool_take(device, run->plan->structures, size, STRUCTURE_ALIGNMENT, &structure->memory);
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
    structure->size = size;
    address_find(device, structure);
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

/* The source goes on in place of its copy, which takes the source's. */
static void source_keep(struct gn_device *device, struct gn_structure *structure)
{
    const VkAccelerationStructureKHR copied = structure->handle;
    const struct gn_memory memory = structure->memory;
    structure->handle = structure->source;
    structure->memory = structure->source_memory;
    structure->source = copied;
    structure->source_memory = memory;
    structure->size = structure->size_before_compaction;
    structure->compacted = false;
    address_find(device, structure);
}

static void source_destroy(struct gn_device *device, struct gn_structure *structure)
{
    if (structure->source && !device->lost) {
        device->DestroyAccelerationStructureKHR(device->handle, structure->source, NULL);
    }
    structure->source = VK_NULL_HANDLE;
}

static VkAccelerationStructureBuildGeometryInfoKHR build_info(const struct steps_run *run,
                                                              const struct gn_structure *structure,
                                                              const struct gn_build_input *input)
{
    VkDeviceOrHostAddressKHR scratch = {.deviceAddress = structure->scratch.address};
    if (gn_commands_host(run->plan->builds)) {
        scratch.hostAddress = structure->scratch.mapped;
    }
    return (VkAccelerationStructureBuildGeometryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = structure->type,
        .flags = structure->flags,
        .mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
        .dstAccelerationStructure = structure->handle,
        .geometryCount = structure->geometry_count,
        .pGeometries = input->pointers ? NULL : input->geometries,
        .ppGeometries = input->pointers,
        .scratchData = scratch,
    };
}

static enum gn_device_status sizes_query(const struct steps_run *run, struct gn_structure *structure)
{
    struct gn_device *device = run->device;
    /* Initial and final input differ in their data only, and sizes do not depend on data. */
    const VkAccelerationStructureBuildGeometryInfoKHR info = build_info(run, structure, &structure->final);
    structure->sizes = (VkAccelerationStructureBuildSizesInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR,
    };
    device->GetAccelerationStructureBuildSizesKHR(device->handle,
                                                  gn_commands_host(run->plan->builds)
                                                      ? VK_ACCELERATION_STRUCTURE_BUILD_TYPE_HOST_KHR
                                                      : VK_ACCELERATION_STRUCTURE_BUILD_TYPE_DEVICE_KHR,
                                                  &info, structure->primitive_counts, &structure->sizes);
    if (structure->sizes.accelerationStructureSize == 0) {
        return gn_device_fail(device, GN_DEVICE_FAILED,
                              "vkGetAccelerationStructureBuildSizesKHR gave a size of 0 bytes");
    }
    return GN_DEVICE_OK;
}

/* Memory with the ranges of an indirect build. */
static enum gn_device_status ranges_write(const struct steps_run *run, const struct gn_structure *structure,
                                          const VkAccelerationStructureBuildRangeInfoKHR *ranges,
                                          VkDeviceAddress *out_address)
{
    struct gn_memory memory;
    const enum gn_device_status status =
        gn_pool_take(run->device, run->plan->ranges, structure->geometry_count * RANGE_STRIDE, 4, &memory);
    if (status == GN_DEVICE_OK) {
        memset(memory.mapped, 0xFF, memory.size);
        for (uint32_t g = 0; g < structure->geometry_count; g++) {
            memcpy(memory.mapped + g * RANGE_STRIDE, &ranges[g], sizeof ranges[g]);
        }
        *out_address = memory.address;
    }
    return status;
}

/* Builds by the plan's commands, recorded or done; `structures` are those that the infos are of. */
static enum gn_device_status build(const struct steps_run *run, uint32_t count,
                                   const struct gn_structure *const *structures,
                                   const VkAccelerationStructureBuildGeometryInfoKHR *infos,
                                   const VkAccelerationStructureBuildRangeInfoKHR *const *ranges)
{
    struct gn_device *device = run->device;
    if (gn_commands_host(run->plan->builds)) {
        return gn_host_build(device, run->plan->builds == GN_CTS_DEFERRED,
                             &(struct gn_host_build){count, infos, ranges});
    }
    if (run->plan->builds == GN_CTS_ON_DEVICE) {
        device->CmdBuildAccelerationStructuresKHR(device->commands, count, infos, ranges);
        return GN_DEVICE_OK;
    }
    enum gn_device_status status = GN_DEVICE_OK;
    VkDeviceAddress *addresses = calloc(count, sizeof *addresses);
    uint32_t *strides = calloc(count, sizeof *strides);
    const uint32_t **most = calloc(count, sizeof *most);
    if (!addresses || !strides || !most) {
        status = gn_device_fail(device, GN_DEVICE_FAILED, "no host memory for %u indirect builds", count);
    }
    for (uint32_t i = 0; i < count && status == GN_DEVICE_OK; i++) {
        strides[i] = RANGE_STRIDE;
        most[i] = structures[i]->primitive_counts;
        status = ranges_write(run, structures[i], ranges[i], &addresses[i]);
    }
    if (status == GN_DEVICE_OK) {
        device->CmdBuildAccelerationStructuresIndirectKHR(device->commands, count, infos, addresses, strides, most);
    }
    free(addresses);
    free(strides);
    free(most);
    return status;
}

static enum gn_device_status first_build(struct steps_run *run)
{
    struct gn_device *device = run->device;
    const VkDeviceSize scratch_alignment = device->info.limits.minAccelerationStructureScratchOffsetAlignment;
    enum gn_device_status status = GN_DEVICE_OK;
    VkAccelerationStructureBuildGeometryInfoKHR *infos = calloc(run->count, sizeof *infos);
    const VkAccelerationStructureBuildRangeInfoKHR **ranges = calloc(run->count, sizeof *ranges);
    const struct gn_structure **built = calloc(run->count, sizeof *built);
    if (!infos || !ranges || !built) {
        status = gn_device_fail(device, GN_DEVICE_FAILED, "no host memory for %u builds", run->count);
        goto done;
    }
    for (uint32_t i = 0; i < run->count; i++) {
        struct gn_structure *structure = &run->structures[i];
        if ((status = sizes_query(run, structure)) != GN_DEVICE_OK ||
            (status = handle_create(run, structure, structure->sizes.accelerationStructureSize)) != GN_DEVICE_OK) {
            goto done;
        }
        const VkDeviceSize scratch = structure->sizes.buildScratchSize > structure->sizes.updateScratchSize
                                         ? structure->sizes.buildScratchSize
                                         : structure->sizes.updateScratchSize;
        status = gn_pool_take(device, run->plan->scratch, scratch, scratch_alignment ? scratch_alignment : 1,
                              &structure->scratch);
        if (status != GN_DEVICE_OK) {
            goto done;
        }
        structure->size_before_compaction = structure->size;
        const struct gn_build_input *input =
            steps_take_final(structure->steps) ? &structure->initial : &structure->final;
        infos[i] = build_info(run, structure, input);
        ranges[i] = input->ranges;
        built[i] = structure;
    }
    if ((status = gn_device_begin(device)) != GN_DEVICE_OK) {
        goto done;
    }
    for (uint32_t i = 0; i < run->count; i++) {
        poison(device, &run->structures[i].memory);
        poison(device, &run->structures[i].scratch);
    }
    gn_device_barrier(device);
    const bool host = gn_commands_host(run->plan->builds);
    if (host && (status = gn_device_submit(device)) != GN_DEVICE_OK) {
        goto done;
    }
    const uint32_t each = run->plan->separate_builds ? 1 : run->count;
    for (uint32_t i = 0; i < run->count && status == GN_DEVICE_OK; i += each) {
        status = build(run, each, built + i, infos + i, ranges + i);
    }
    if (!host && status == GN_DEVICE_OK) {
        status = gn_device_submit(device);
    }
done:
    free(infos);
    free(ranges);
    free(built);
    return status;
}

/* What one structure does in a phase; recorded, or done on the host. */
typedef enum gn_device_status apply_one(const struct steps_run *run, struct gn_structure *structure,
                                        enum gn_cts_step step);

static enum gn_device_status apply_those(const struct steps_run *run, apply_one *one, bool host)
{
    enum gn_device_status status = GN_DEVICE_OK;
    for (uint32_t i = 0; i < run->count && status == GN_DEVICE_OK; i++) {
        struct gn_structure *structure = &run->structures[i];
        const enum gn_cts_step step = step_of(structure, run->step);
        if (gn_commands_host(step_builds(step) ? run->plan->builds : run->plan->copies) == host) {
            status = one(run, structure, step);
        }
    }
    return status;
}

/* To what has been recorded in this phase. */
static enum gn_device_status apply(const struct steps_run *run, apply_one *one)
{
    gn_device_barrier(run->device);
    enum gn_device_status status = apply_those(run, one, false);
    if (status == GN_DEVICE_OK && (status = gn_device_submit(run->device)) == GN_DEVICE_OK) {
        status = apply_those(run, one, true);
    }
    return status;
}

static enum gn_device_status copy(const struct steps_run *run, const struct gn_structure *structure,
                                  VkCopyAccelerationStructureModeKHR mode)
{
    struct gn_device *device = run->device;
    const VkCopyAccelerationStructureInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
        .src = structure->source,
        .dst = structure->handle,
        .mode = mode,
    };
    if (gn_commands_host(run->plan->copies)) {
        return gn_host_copy(device, run->plan->copies == GN_CTS_DEFERRED, &info);
    }
    device->CmdCopyAccelerationStructureKHR(device->commands, &info);
    return GN_DEVICE_OK;
}

/* Builds the initial data. */
static enum gn_device_status fill_one(const struct steps_run *run, const struct gn_structure *structure)
{
    const struct gn_structure *const built = structure;
    const VkAccelerationStructureBuildGeometryInfoKHR info = build_info(run, structure, &structure->initial);
    const VkAccelerationStructureBuildRangeInfoKHR *const ranges = structure->initial.ranges;
    return build(run, 1, &built, &info, &ranges);
}

/* Another build into the new structures of those that take this step, to be written over. */
static enum gn_device_status fill(const struct steps_run *run, enum gn_cts_step step)
{
    struct gn_device *device = run->device;
    const bool host = gn_commands_host(run->plan->builds);
    enum gn_device_status status = host ? GN_DEVICE_OK : gn_device_begin(device);
    for (uint32_t i = 0; i < run->count && status == GN_DEVICE_OK; i++) {
        if (step_of(&run->structures[i], run->step) == step) {
            status = fill_one(run, &run->structures[i]);
        }
    }
    return status == GN_DEVICE_OK && !host ? gn_device_submit(device) : status;
}

static enum gn_device_status build_one(const struct steps_run *run, struct gn_structure *structure,
                                       enum gn_cts_step step)
{
    if (step == GN_CTS_STEP_CLONE || step == GN_CTS_STEP_CLONE_OVER) {
        return copy(run, structure, VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR);
    }
    if (!step_builds(step)) {
        return GN_DEVICE_OK;
    }
    const struct gn_build_input *input = step == GN_CTS_STEP_REFIT_BACK ? &structure->initial : &structure->final;
    VkAccelerationStructureBuildGeometryInfoKHR info = build_info(run, structure, input);
    const VkAccelerationStructureBuildRangeInfoKHR *const ranges = input->ranges;
    const struct gn_structure *const built = structure;
    /* A full build ignores its source. */
    info.srcAccelerationStructure = step == GN_CTS_STEP_REFIT_COPY ? structure->source : structure->handle;
    if (step != GN_CTS_STEP_REBUILD) {
        info.mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
    }
    return build(run, 1, &built, &info, &ranges);
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
        case GN_CTS_STEP_CLONE_OVER:
            if (structure->compacted && step_of(structure, run->step) == GN_CTS_STEP_CLONE_OVER) {
                return gn_device_fail(device, GN_DEVICE_FAILED,
                                      "a build does not fit where a compacted structure does: the scene is not valid");
            }
            if ((status = handle_replace(run, structure, structure->size)) != GN_DEVICE_OK) {
                return status;
            }
            poison(device, &structure->memory);
            poison(device, &structure->scratch);
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
    if ((status = gn_device_submit(device)) != GN_DEVICE_OK ||
        (status = fill(run, GN_CTS_STEP_CLONE_OVER)) != GN_DEVICE_OK ||
        (status = gn_device_begin(device)) != GN_DEVICE_OK) {
        return status;
    }
    return apply(run, build_one);
}

/* Asks for a number of every structure for which `wanted` holds. */
static enum gn_device_status numbers_ask(const struct steps_run *run, bool (*wanted)(enum gn_cts_step step),
                                         VkQueryType type, uint64_t *out_numbers)
{
    struct gn_device *device = run->device;
    enum gn_device_status status = GN_DEVICE_OK;
    VkQueryPool queries = VK_NULL_HANDLE;
    const bool host = gn_commands_host(run->plan->copies);
    const VkQueryPoolCreateInfo pool_info = {
        .sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO,
        .queryType = type,
        .queryCount = FIRST_QUERY + run->count,
    };
    VkAccelerationStructureKHR *handles = calloc(run->count, sizeof *handles);
    if (!handles) {
        return gn_device_fail(device, GN_DEVICE_FAILED, "no host memory for %u handles", run->count);
    }
    uint32_t count = 0;
    for (uint32_t i = 0; i < run->count; i++) {
        if (wanted(step_of(&run->structures[i], run->step))) {
            handles[count++] = run->structures[i].handle;
        }
    }
    VkResult result = host ? VK_SUCCESS : vkCreateQueryPool(device->handle, &pool_info, NULL, &queries);
    if ((status = gn_device_check(device, result, "vkCreateQueryPool")) != GN_DEVICE_OK) {
        goto done;
    }
    if (!host) {
        if ((status = gn_device_begin(device)) != GN_DEVICE_OK) {
            goto done;
        }
        vkCmdResetQueryPool(device->commands, queries, 0, FIRST_QUERY + run->count);
        gn_device_barrier(device);
        device->CmdWriteAccelerationStructuresPropertiesKHR(device->commands, count, handles, type, queries,
                                                            FIRST_QUERY);
        if ((status = gn_device_submit(device)) != GN_DEVICE_OK) {
            goto done;
        }
    }
    /* All at once; then each goes to its structure, from the last on, because there are no more than structures. */
    const VkDeviceSize bytes = count * sizeof *out_numbers;
    if (host) {
        result = device->WriteAccelerationStructuresPropertiesKHR(device->handle, count, handles, type, bytes,
                                                                  out_numbers, sizeof *out_numbers);
        status = gn_device_check(device, result, "vkWriteAccelerationStructuresPropertiesKHR");
    } else {
        result = vkGetQueryPoolResults(device->handle, queries, FIRST_QUERY, count, bytes, out_numbers,
                                       sizeof *out_numbers, VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT);
        status = gn_device_check(device, result, "vkGetQueryPoolResults");
    }
    for (uint32_t i = run->count; status == GN_DEVICE_OK && i-- > 0;) {
        if (wanted(step_of(&run->structures[i], run->step))) {
            out_numbers[i] = out_numbers[--count];
        }
    }
done:
    free(handles);
    if (!device->lost) {
        vkDestroyQueryPool(device->handle, queries, NULL);
    }
    return status;
}

static bool step_compacts(enum gn_cts_step step)
{
    return step == GN_CTS_STEP_COMPACT;
}

/* What copies have to know: the sizes of the results, and how many handles serialized data will have. */
static enum gn_device_status sizes_ask(struct steps_run *run)
{
    struct gn_device *device = run->device;
    const struct {
        bool (*wanted)(enum gn_cts_step step);
        VkQueryType type;
        bool handles;
    } questions[] = {
        {step_compacts, VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR, false},
        {step_serializes, VK_QUERY_TYPE_ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR, false},
        {step_serializes, VK_QUERY_TYPE_ACCELERATION_STRUCTURE_SERIALIZATION_BOTTOM_LEVEL_POINTERS_KHR, true},
    };
    enum gn_device_status status = GN_DEVICE_OK;
    uint64_t *numbers = calloc(run->count, sizeof *numbers);
    if (!numbers) {
        return gn_device_fail(device, GN_DEVICE_FAILED, "no host memory for %u sizes", run->count);
    }
    for (size_t q = 0; q < sizeof questions / sizeof questions[0] && status == GN_DEVICE_OK; q++) {
        bool any = false;
        for (uint32_t i = 0; i < run->count; i++) {
            any = any || questions[q].wanted(step_of(&run->structures[i], run->step));
        }
        if (!any || (questions[q].handles && !device->info.maintenance1)) {
            continue;
        }
        status = numbers_ask(run, questions[q].wanted, questions[q].type, numbers);
        for (uint32_t i = 0; i < run->count && status == GN_DEVICE_OK; i++) {
            struct gn_structure *structure = &run->structures[i];
            if (questions[q].wanted(step_of(structure, run->step))) {
                *(questions[q].handles ? &structure->queried_handles : &structure->queried_size) = numbers[i];
            }
        }
    }
    free(numbers);
    return status;
}

static enum gn_device_status copy_one(const struct steps_run *run, struct gn_structure *structure,
                                      enum gn_cts_step step)
{
    struct gn_device *device = run->device;
    if (step_compacts(step)) {
        return copy(run, structure, VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR);
    }
    if (!step_serializes(step)) {
        return GN_DEVICE_OK;
    }
    VkCopyAccelerationStructureToMemoryInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_TO_MEMORY_INFO_KHR,
        .src = structure->handle,
        .dst.deviceAddress = structure->serialized.address,
        .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_SERIALIZE_KHR,
    };
    if (gn_commands_host(run->plan->copies)) {
        info.dst.hostAddress = structure->serialized.mapped;
        return gn_host_serialize(device, run->plan->copies == GN_CTS_DEFERRED, &info);
    }
    device->CmdCopyAccelerationStructureToMemoryKHR(device->commands, &info);
    return GN_DEVICE_OK;
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
        if (step_compacts(step)) {
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
        } else if (step_serializes(step)) {
            if (structure->queried_size < sizeof(struct serialized_head)) {
                return gn_device_fail(device, GN_DEVICE_FAILED,
                                      "a serialized structure has %llu bytes, its head alone takes %zu",
                                      (unsigned long long)structure->queried_size, sizeof(struct serialized_head));
            }
            status = gn_pool_take(device, run->plan->serialized, structure->queried_size + GUARD_BYTES,
                                  STRUCTURE_ALIGNMENT, &structure->serialized);
            if (status != GN_DEVICE_OK) {
                return status;
            }
            poison(device, &structure->serialized);
        }
    }
    return apply(run, copy_one);
}

/* Nothing behind the size that was asked for has been written. */
static bool guard_intact(const struct gn_structure *structure)
{
    const uint32_t word = GN_POISON_WORD;
    uint8_t pattern[sizeof word];
    memcpy(pattern, &word, sizeof word);
    for (uint64_t i = structure->queried_size; i < structure->queried_size + GUARD_BYTES; i++) {
        if (structure->serialized.mapped[i] != pattern[i % sizeof word]) {
            return false;
        }
    }
    return true;
}

static uint64_t handle_at(const struct gn_structure *structure, uint64_t number)
{
    uint64_t handle = 0;
    memcpy(&handle, structure->serialized.mapped + sizeof(struct serialized_head) + number * sizeof handle,
           sizeof handle);
    return handle;
}

/* Data that name neither this driver nor this version are not taken for its own. */
static enum gn_device_status strangers_check(struct gn_device *device, const uint8_t *bytes)
{
    uint8_t other[2 * VK_UUID_SIZE];
    for (size_t i = 0; i < sizeof other; i++) {
        other[i] = bytes[i] ^ 0xA5;
    }
    const VkAccelerationStructureVersionInfoKHR version = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_VERSION_INFO_KHR,
        .pVersionData = other,
    };
    VkAccelerationStructureCompatibilityKHR compatibility = VK_ACCELERATION_STRUCTURE_COMPATIBILITY_COMPATIBLE_KHR;
    device->GetDeviceAccelerationStructureCompatibilityKHR(device->handle, &version, &compatibility);
    if (compatibility != VK_ACCELERATION_STRUCTURE_COMPATIBILITY_INCOMPATIBLE_KHR) {
        return gn_device_fail(device, GN_DEVICE_FAILED,
                              "the device says that serialized data of an unknown driver are compatible with it");
    }
    return GN_DEVICE_OK;
}

/* Whether the head of serialized data says what the specification wants it to say. */
static enum gn_device_status serialized_check(const struct steps_run *run, struct gn_structure *structure,
                                              struct serialized_head *out_head)
{
    struct gn_device *device = run->device;
    enum gn_device_status status = GN_DEVICE_OK;
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
    structure->foreign_head = memcmp(out_head->driver_uuid, device->info.driver_uuid, VK_UUID_SIZE) != 0;
    if ((status = strangers_check(device, bytes)) != GN_DEVICE_OK) {
        return status;
    }
    const uint64_t room = (structure->queried_size - sizeof *out_head) / sizeof(uint64_t);
    const bool bottom = structure->type == VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR;
    /* Below, the word may be two: all ones say that the other counts blocks that follow, of which none are handles. */
    const bool blocks = bottom && out_head->handle_count >> 32 == UINT32_MAX;
    if (out_head->serialized_size != structure->queried_size || out_head->deserialized_size == 0 ||
        (bottom ? out_head->handle_count != 0 && !blocks : out_head->handle_count > room)) {
        return gn_device_fail(device, GN_DEVICE_FAILED,
                              "the head of a serialized structure says %llu bytes, %llu deserialized, %llu handles; "
                              "the query said %llu bytes",
                              (unsigned long long)out_head->serialized_size,
                              (unsigned long long)out_head->deserialized_size,
                              (unsigned long long)out_head->handle_count,
                              (unsigned long long)structure->queried_size);
    }
    if (bottom) {
        out_head->handle_count = 0;
    } else if (device->info.maintenance1 && structure->queried_handles != out_head->handle_count) {
        return gn_device_fail(device, GN_DEVICE_FAILED,
                              "the head of a serialized structure says %llu handles, the query of its bottom level "
                              "pointers said %llu",
                              (unsigned long long)out_head->handle_count,
                              (unsigned long long)structure->queried_handles);
    }
    if (!guard_intact(structure)) {
        return gn_device_fail(device, GN_DEVICE_FAILED,
                              "a serialized structure reaches beyond the %llu bytes that the query said",
                              (unsigned long long)structure->queried_size);
    }
    for (uint64_t i = 0; i < out_head->handle_count; i++) {
        const uint64_t handle = handle_at(structure, i);
        bool known = handle == 0;
        for (uint32_t b = 0; b < run->plan->blas_count && !known; b++) {
            known = handle == run->plan->blases[b].address;
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

/* Clones the BLASes of a serialized TLAS, destroys those that it knew, and writes the clones' handles into its data. */
static enum gn_device_status relocate(const struct steps_run *run, struct gn_structure *tlas, uint64_t handle_count)
{
    struct gn_device *device = run->device;
    struct gn_structure *blases = run->plan->blases;
    enum gn_device_status status = GN_DEVICE_OK;
    VkDeviceAddress *before = calloc(run->plan->blas_count + 1, sizeof *before);
    if (!before) {
        return gn_device_fail(device, GN_DEVICE_FAILED, "no host memory for addresses");
    }
    if ((status = gn_device_begin(device)) != GN_DEVICE_OK) {
        goto done;
    }
    for (uint32_t b = 0; b < run->plan->blas_count; b++) {
        before[b] = blases[b].address;
        if ((status = handle_replace(run, &blases[b], blases[b].size)) != GN_DEVICE_OK) {
            goto done;
        }
        const VkCopyAccelerationStructureInfoKHR info = {
            .sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
            .src = blases[b].source,
            .dst = blases[b].handle,
            .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR,
        };
        device->CmdCopyAccelerationStructureKHR(device->commands, &info);
    }
    gn_device_barrier(device);
    for (uint32_t b = 0; b < run->plan->blas_count; b++) {
        poison(device, &blases[b].source_memory);
    }
    if ((status = gn_device_submit(device)) != GN_DEVICE_OK) {
        goto done;
    }
    for (uint32_t b = 0; b < run->plan->blas_count; b++) {
        source_destroy(device, &blases[b]);
    }
    for (uint64_t i = 0; i < handle_count; i++) {
        const uint64_t handle = handle_at(tlas, i);
        for (uint32_t b = 0; b < run->plan->blas_count; b++) {
            if (handle == before[b]) {
                memcpy(tlas->serialized.mapped + sizeof(struct serialized_head) + i * sizeof handle,
                       &blases[b].address, sizeof handle);
            }
        }
    }
done:
    free(before);
    return status;
}

static enum gn_device_status restore_one(const struct steps_run *run, struct gn_structure *structure,
                                         enum gn_cts_step step)
{
    struct gn_device *device = run->device;
    if (!step_serializes(step) || run->plan->keep_sources) {
        return GN_DEVICE_OK;
    }
    VkCopyMemoryToAccelerationStructureInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_COPY_MEMORY_TO_ACCELERATION_STRUCTURE_INFO_KHR,
        .src.deviceAddress = structure->serialized.address,
        .dst = structure->handle,
        .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_DESERIALIZE_KHR,
    };
    if (gn_commands_host(run->plan->copies)) {
        info.src.hostAddress = structure->serialized.mapped;
        return gn_host_deserialize(device, run->plan->copies == GN_CTS_DEFERRED, &info);
    }
    device->CmdCopyMemoryToAccelerationStructureKHR(device->commands, &info);
    return GN_DEVICE_OK;
}

/* Phase 3: sources (or copies, where sources are kept) are destroyed and their memory poisoned; what was serialized is made anew. */
static enum gn_device_status phase_finish(struct steps_run *run)
{
    struct gn_device *device = run->device;
    enum gn_device_status status = GN_DEVICE_OK;
    for (uint32_t i = 0; i < run->count; i++) {
        struct gn_structure *structure = &run->structures[i];
        const enum gn_cts_step step = step_of(structure, run->step);
        if (!step_serializes(step)) {
            continue;
        }
        struct serialized_head head;
        if ((status = serialized_check(run, structure, &head)) != GN_DEVICE_OK) {
            return status;
        }
        if (run->plan->keep_sources) {
            continue;
        }
        VkDeviceSize size = head.deserialized_size;
        if (step == GN_CTS_STEP_SERIALIZE_OVER && size < structure->sizes.accelerationStructureSize) {
            size = structure->sizes.accelerationStructureSize;
        }
        if ((status = handle_replace(run, structure, size)) != GN_DEVICE_OK ||
            (step == GN_CTS_STEP_RELOCATE &&
             (status = relocate(run, structure, head.handle_count)) != GN_DEVICE_OK)) {
            return status;
        }
    }
    if ((status = gn_device_begin(device)) != GN_DEVICE_OK) {
        return status;
    }
    for (uint32_t i = 0; i < run->count; i++) {
        struct gn_structure *structure = &run->structures[i];
        if (step_serializes(step_of(structure, run->step)) && !run->plan->keep_sources) {
            poison(device, &structure->memory);
            poison(device, &structure->scratch);
        }
        if (structure->source) {
            if (run->plan->keep_sources) {
                source_keep(device, structure);
            }
            source_destroy(device, structure);
            poison(device, &structure->source_memory);
        }
    }
    if ((status = gn_device_submit(device)) != GN_DEVICE_OK ||
        (status = fill(run, GN_CTS_STEP_SERIALIZE_OVER)) != GN_DEVICE_OK ||
        (status = gn_device_begin(device)) != GN_DEVICE_OK || (status = apply(run, restore_one)) != GN_DEVICE_OK) {
        return status;
    }
    for (uint32_t i = 0; i < run->count; i++) {
        struct gn_structure *structure = &run->structures[i];
        if (step_serializes(step_of(structure, run->step))) {
            memset(structure->serialized.mapped, 0xFF, structure->serialized.size);
        }
    }
    return GN_DEVICE_OK;
}

enum gn_device_status gn_structures_build(struct gn_device *device, const struct gn_structures_plan *plan,
                                          struct gn_structure *structures, uint32_t count)
{
    struct steps_run run = {.device = device, .plan = plan, .structures = structures, .count = count};
    if (count == 0) {
        return GN_DEVICE_OK;
    }
    enum gn_device_status status = plan->only_steps ? GN_DEVICE_OK : first_build(&run);
    if (status != GN_DEVICE_OK || plan->only_first) {
        return status;
    }
    bool again = false; /* whether the initial data will be read once more */
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t s = 0; s < GN_CTS_MAX_STEPS && structures[i].steps[s] != GN_CTS_STEP_END; s++)
            again = again || structures[i].steps[s] == GN_CTS_STEP_REFIT_BACK ||
                    structures[i].steps[s] == GN_CTS_STEP_CLONE_OVER ||
                    structures[i].steps[s] == GN_CTS_STEP_SERIALIZE_OVER;
    if (!again)
        gn_pool_poison(plan->initial);
    for (run.step = 0; run.step < GN_CTS_MAX_STEPS; run.step++) {
        bool any = false;
        for (uint32_t i = 0; i < count; i++) {
            any = any || step_of(&structures[i], run.step) != GN_CTS_STEP_END;
        }
        if (!any) {
            break;
        }
        if ((status = phase_build(&run)) != GN_DEVICE_OK || (status = sizes_ask(&run)) != GN_DEVICE_OK ||
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
