/* SPDX-License-Identifier: Apache-2.0 */
/* Measures a driver's operations: builds of several sizes and kinds, updates, compaction, traces, pipelines, memory. */
#include "cts/bench.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cts/bench_rays.h"
#include "cts/device_internal.h"

#include "bench_comp.spv.h"

/* One measurement repeats what it measures until it has lasted this long, but at most so often; what lasts longer than ENOUGH
 * by itself is measured once. */
#define LEAST_SECONDS 0.02
#define ENOUGH_SECONDS 0.04
#define MOST_REPEATS 20

#define RAY_COUNT (1u << 16)

#define FAST_TRACE VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR
#define FAST_BUILD VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_BUILD_BIT_KHR
#define ALLOW_UPDATE VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR
#define ALLOW_COMPACTION VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR

/* The structures that items work on. */
enum subject {
    TRIANGLES_1K,
    TRIANGLES_16K,
    TRIANGLES_16K_FAST_BUILD,
    TRIANGLES_128K,
    TRIANGLES_128K_PLAIN, /* neither updated nor compacted: for traces and sizes */
    TRIANGLES_16K_MASKED, /* not opaque */
    BOXES_16K,
    INSTANCES_16K,
    TLAS_OF_128K,
    TLAS_OF_MASKED,
    SUBJECT_COUNT
};

struct subject_traits {
    VkGeometryTypeKHR kind;
    uint32_t count; /* triangles: 2 count^2 of them; else primitives */
    VkBuildAccelerationStructureFlagsKHR flags;
    bool masked;
    enum subject of; /* what instances refer to */
};

static const struct subject_traits traits[SUBJECT_COUNT] = {
    [TRIANGLES_1K] = {VK_GEOMETRY_TYPE_TRIANGLES_KHR, 23, FAST_TRACE, false, 0},
    [TRIANGLES_16K] = {VK_GEOMETRY_TYPE_TRIANGLES_KHR, 91, FAST_TRACE | ALLOW_UPDATE | ALLOW_COMPACTION, false, 0},
    [TRIANGLES_16K_FAST_BUILD] = {VK_GEOMETRY_TYPE_TRIANGLES_KHR, 91, FAST_BUILD, false, 0},
    [TRIANGLES_128K] = {VK_GEOMETRY_TYPE_TRIANGLES_KHR, 256, FAST_TRACE | ALLOW_UPDATE | ALLOW_COMPACTION, false, 0},
    [TRIANGLES_128K_PLAIN] = {VK_GEOMETRY_TYPE_TRIANGLES_KHR, 256, FAST_TRACE, false, 0},
    [TRIANGLES_16K_MASKED] = {VK_GEOMETRY_TYPE_TRIANGLES_KHR, 91, FAST_TRACE, true, 0},
    [BOXES_16K] = {VK_GEOMETRY_TYPE_AABBS_KHR, 16384, FAST_TRACE, false, 0},
    [INSTANCES_16K] = {VK_GEOMETRY_TYPE_INSTANCES_KHR, 16384, FAST_TRACE, false, TRIANGLES_1K},
    [TLAS_OF_128K] = {VK_GEOMETRY_TYPE_INSTANCES_KHR, 1, FAST_TRACE, false, TRIANGLES_128K_PLAIN},
    [TLAS_OF_MASKED] = {VK_GEOMETRY_TYPE_INSTANCES_KHR, 1, FAST_TRACE, false, TRIANGLES_16K_MASKED},
};

/* The ones of rays go through a ray tracing pipeline, the others by ray queries. */
enum action {
    BUILD,
    UPDATE,
    COMPACT,
    TRACE,
    PIPELINE,
    FIRST_USE,
    RAYS_TRACE,
    RAYS_PIPELINE,
    RAYS_LINKED,
    RAYS_FIRST_USE,
    STRUCTURE_BYTES,
    SCRATCH_BYTES,
    COMPACTED_BYTES
};

static const struct item {
    struct gn_bench_item shown;
    enum action action;
    enum subject subject;
    uint32_t incoherent, ray_flags;
} items[] = {
    {{"build.triangles.1k", "building 1,058 triangles, fast trace", false}, BUILD, TRIANGLES_1K, 0, 0},
    {{"build.triangles.16k", "building 16,562 triangles, fast trace, updatable", false}, BUILD, TRIANGLES_16K, 0, 0},
    {{"build.triangles.16k_fast_build", "building 16,562 triangles, fast build", false}, BUILD, TRIANGLES_16K_FAST_BUILD, 0, 0},
    {{"build.triangles.128k", "building 131,072 triangles, fast trace, updatable", false}, BUILD, TRIANGLES_128K, 0, 0},
    {{"build.aabbs.16k", "building 16,384 boxes", false}, BUILD, BOXES_16K, 0, 0},
    {{"build.instances.16k", "building a TLAS of 16,384 instances", false}, BUILD, INSTANCES_16K, 0, 0},
    {{"update.triangles.16k", "updating 16,562 triangles in place", false}, UPDATE, TRIANGLES_16K, 0, 0},
    {{"update.triangles.128k", "updating 131,072 triangles in place", false}, UPDATE, TRIANGLES_128K, 0, 0},
    {{"compaction.16k", "compacting 16,562 triangles", false}, COMPACT, TRIANGLES_16K, 0, 0},
    {{"trace.coherent", "65,536 rays of a camera, 131,072 triangles", false}, TRACE, TLAS_OF_128K, 0, 0},
    {{"trace.incoherent", "65,536 random rays, 131,072 triangles", false}, TRACE, TLAS_OF_128K, 1, 0},
    {{"trace.first_hit", "the same, ending at the first hit", false}, TRACE, TLAS_OF_128K, 1, 4 /* TerminateOnFirstHit */},
    {{"trace.any_hit", "65,536 random rays that confirm every candidate, 16,562 triangles", false}, TRACE, TLAS_OF_MASKED, 1, 0},
    {{"pipeline.create", "making a compute pipeline with a ray query, caches off", false}, PIPELINE, TLAS_OF_MASKED, 0, 0},
    {{"pipeline.first_use", "making it and tracing one ray", false}, FIRST_USE, TLAS_OF_MASKED, 0, 0},
    {{"trace.pipeline.coherent", "trace.coherent through a ray tracing pipeline", false}, RAYS_TRACE, TLAS_OF_128K, 0, 0},
    {{"trace.pipeline.incoherent", "trace.incoherent through it", false}, RAYS_TRACE, TLAS_OF_128K, 1, 0},
    {{"trace.pipeline.first_hit", "trace.first_hit through it", false}, RAYS_TRACE, TLAS_OF_128K, 1, 4 /* TerminateOnFirstHit */},
    {{"trace.pipeline.any_hit", "trace.any_hit through it and its any-hit shader", false}, RAYS_TRACE, TLAS_OF_MASKED, 1, 0},
    {{"pipeline.rays.create", "making a ray tracing pipeline of four shaders, caches off", false}, RAYS_PIPELINE, TLAS_OF_MASKED, 0, 0},
    {{"pipeline.rays.libraries", "making it from two libraries, these included", false}, RAYS_LINKED, TLAS_OF_MASKED, 0, 0},
    {{"pipeline.rays.first_use", "making it and its table and tracing one ray", false}, RAYS_FIRST_USE, TLAS_OF_MASKED, 0, 0},
    {{"memory.triangles.128k", "a structure of 131,072 triangles", true}, STRUCTURE_BYTES, TRIANGLES_128K_PLAIN, 0, 0},
    {{"memory.scratch.128k", "scratch for building it", true}, SCRATCH_BYTES, TRIANGLES_128K_PLAIN, 0, 0},
    {{"memory.compacted.128k", "the same, updatable, compacted", true}, COMPACTED_BYTES, TRIANGLES_128K, 0, 0},
    {{"memory.instances.16k", "a TLAS of 16,384 instances", true}, STRUCTURE_BYTES, INSTANCES_16K, 0, 0},
};
#define ITEM_COUNT (sizeof items / sizeof items[0])

size_t gn_bench_count(void)
{
    return ITEM_COUNT;
}

const struct gn_bench_item *gn_bench_item(size_t item)
{
    return &items[item].shown;
}

struct prepared {
    bool ready;
    uint32_t primitives;
    VkAccelerationStructureGeometryKHR geometry;
    VkAccelerationStructureBuildSizesInfoKHR sizes;
    VkAccelerationStructureKHR handle, compacted;
    VkDeviceSize compacted_size;
    VkDeviceAddress address;
    struct gn_memory scratch;
};

struct gn_bench {
    struct gn_device *device;
    struct gn_pool inputs, structures, scratch, host;
    struct prepared subjects[SUBJECT_COUNT];
    VkDescriptorSetLayout set_layout;
    VkDescriptorPool descriptor_pool;
    VkDescriptorSet descriptors;
    VkPipelineLayout layout;
    VkPipeline pipeline; /* for traces */
    struct gn_bench_rays rays; /* likewise */
    struct gn_memory sums;
};

size_t gn_bench_find(const char *name)
{
    size_t i = 0;
    while (i < ITEM_COUNT && strcmp(items[i].shown.name, name) != 0)
        i++;
    return i;
}

struct gn_bench *gn_bench_create(struct gn_device *device)
{
    struct gn_bench *bench = calloc(1, sizeof *bench);
    if (!bench)
        return NULL;
    bench->device = device;
    bench->inputs.kind = GN_MEMORY_INPUT;
    bench->structures.kind = GN_MEMORY_STRUCTURE;
    bench->scratch.kind = GN_MEMORY_SCRATCH;
    bench->host.kind = GN_MEMORY_HOST;
    return bench;
}

void gn_bench_destroy(struct gn_bench *bench)
{
    if (!bench)
        return;
    struct gn_device *device = bench->device;
    if (!device->lost) {
        for (size_t i = 0; i < SUBJECT_COUNT; i++) {
            device->DestroyAccelerationStructureKHR(device->handle, bench->subjects[i].handle, NULL);
            device->DestroyAccelerationStructureKHR(device->handle, bench->subjects[i].compacted, NULL);
        }
        vkDestroyPipeline(device->handle, bench->pipeline, NULL);
        vkDestroyPipelineLayout(device->handle, bench->layout, NULL);
        vkDestroyDescriptorPool(device->handle, bench->descriptor_pool, NULL);
        vkDestroyDescriptorSetLayout(device->handle, bench->set_layout, NULL);
    }
    gn_bench_rays_destroy(device, &bench->rays);
    gn_pool_finish(device, &bench->inputs);
    gn_pool_finish(device, &bench->structures);
    gn_pool_finish(device, &bench->scratch);
    gn_pool_finish(device, &bench->host);
    free(bench);
}

/* What a build reads. */

static float height(uint32_t x, uint32_t y)
{
    uint32_t h = (x * 0x9E3779B1u) ^ (y * 0x85EBCA77u);
    h = (h ^ h >> 15) * 0x2C1B3C6Du;
    return 0.1f + 0.05f * sinf(0.11f * (float)x) * cosf(0.07f * (float)y) + 0.01f * (float)(h >> 16) / 65536;
}

static enum gn_device_status take_input(struct gn_bench *bench, VkDeviceSize size, struct gn_memory *out)
{
    return gn_pool_take(bench->device, &bench->inputs, size, 64, out);
}

/* A height field over the square from 0 to 1, with shared vertices. */
static enum gn_device_status make_triangles(struct gn_bench *bench, uint32_t side, bool masked, struct prepared *out)
{
    struct gn_memory vertices, indices;
    uint32_t row = side + 1;
    enum gn_device_status status = take_input(bench, (VkDeviceSize)row * row * 12, &vertices);
    if (status == GN_DEVICE_OK)
        status = take_input(bench, (VkDeviceSize)side * side * 24, &indices);
    if (status != GN_DEVICE_OK)
        return status;
    float *position = (float *)(void *)vertices.mapped;
    uint32_t *index = (uint32_t *)(void *)indices.mapped;
    for (uint32_t y = 0; y < row; y++) {
        for (uint32_t x = 0; x < row; x++) {
            *position++ = (float)x / (float)side;
            *position++ = (float)y / (float)side;
            *position++ = height(x, y);
        }
    }
    for (uint32_t y = 0; y < side; y++) {
        for (uint32_t x = 0; x < side; x++) {
            const uint32_t a = y * row + x, corners[6] = {a, a + 1, a + row, a + 1, a + row + 1, a + row};
            memcpy(index, corners, sizeof corners);
            index += 6;
        }
    }
    out->primitives = 2 * side * side;
    out->geometry.flags = masked ? 0 : VK_GEOMETRY_OPAQUE_BIT_KHR;
    out->geometry.geometry.triangles = (VkAccelerationStructureGeometryTrianglesDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
        .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
        .vertexData.deviceAddress = vertices.address,
        .vertexStride = 12,
        .maxVertex = row * row - 1,
        .indexType = VK_INDEX_TYPE_UINT32,
        .indexData.deviceAddress = indices.address,
    };
    return GN_DEVICE_OK;
}

static enum gn_device_status make_boxes(struct gn_bench *bench, uint32_t count, struct prepared *out)
{
    struct gn_memory boxes;
    enum gn_device_status status = take_input(bench, (VkDeviceSize)count * sizeof(VkAabbPositionsKHR), &boxes);
    if (status != GN_DEVICE_OK)
        return status;
    VkAabbPositionsKHR *box = (VkAabbPositionsKHR *)(void *)boxes.mapped;
    for (uint32_t i = 0; i < count; i++) {
        float x = (float)(i % 128) / 128, y = (float)(i / 128 % 128) / 128, z = height(i, 7);
        box[i] = (VkAabbPositionsKHR){x, y, z, x + 0.01f, y + 0.01f, z + 0.01f};
    }
    out->primitives = count;
    out->geometry.geometry.aabbs = (VkAccelerationStructureGeometryAabbsDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR,
        .data.deviceAddress = boxes.address,
        .stride = sizeof(VkAabbPositionsKHR),
    };
    return GN_DEVICE_OK;
}

static enum gn_device_status prepare(struct gn_bench *bench, enum subject subject);

static enum gn_device_status make_instances(struct gn_bench *bench, uint32_t count, enum subject of,
                                            struct prepared *out)
{
    struct gn_memory records;
    enum gn_device_status status = prepare(bench, of);
    if (status == GN_DEVICE_OK)
        status = take_input(bench, (VkDeviceSize)count * sizeof(VkAccelerationStructureInstanceKHR), &records);
    if (status != GN_DEVICE_OK)
        return status;
    VkAccelerationStructureInstanceKHR *record = (VkAccelerationStructureInstanceKHR *)(void *)records.mapped;
    for (uint32_t i = 0; i < count; i++) {
        float scale = count > 1 ? 0.01f : 1;
        record[i] = (VkAccelerationStructureInstanceKHR){
            .transform = {{{scale, 0, 0, count > 1 ? (float)(i % 128) / 128 : 0},
                           {0, scale, 0, count > 1 ? (float)(i / 128) / 128 : 0},
                           {0, 0, scale, count > 1 ? height(i, 3) : 0}}},
            .instanceCustomIndex = i,
            .mask = 0xFF,
            .accelerationStructureReference = bench->subjects[of].address,
        };
    }
    out->primitives = count;
    out->geometry.geometry.instances = (VkAccelerationStructureGeometryInstancesDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
        .data.deviceAddress = records.address,
    };
    return GN_DEVICE_OK;
}

static VkAccelerationStructureTypeKHR type_of(enum subject subject)
{
    return traits[subject].kind == VK_GEOMETRY_TYPE_INSTANCES_KHR ? VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR
                                                                  : VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR;
}

static VkAccelerationStructureBuildGeometryInfoKHR build_info(struct gn_bench *bench, enum subject subject, bool update)
{
    struct prepared *p = &bench->subjects[subject];
    return (VkAccelerationStructureBuildGeometryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = type_of(subject),
        .flags = traits[subject].flags,
        .mode = update ? VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR
                       : VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
        .srcAccelerationStructure = update ? p->handle : VK_NULL_HANDLE,
        .dstAccelerationStructure = p->handle,
        .geometryCount = 1,
        .pGeometries = &p->geometry,
        .scratchData.deviceAddress = p->scratch.address,
    };
}

static enum gn_device_status create(struct gn_bench *bench, enum subject subject, VkDeviceSize size,
                                    VkAccelerationStructureKHR *out)
{
    struct gn_memory memory;
    enum gn_device_status status = gn_pool_take(bench->device, &bench->structures, size, 256, &memory);
    if (status != GN_DEVICE_OK)
        return status;
    const VkAccelerationStructureCreateInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
        .buffer = memory.buffer,
        .offset = memory.offset,
        .size = size,
        .type = type_of(subject),
    };
    return gn_device_check(bench->device,
                           bench->device->CreateAccelerationStructureKHR(bench->device->handle, &info, NULL, out),
                           "vkCreateAccelerationStructureKHR");
}

/* Seconds from the submission to its end. */
static enum gn_device_status submit(struct gn_bench *bench, double *out_seconds)
{
    double begin = gn_seconds_now();
    enum gn_device_status status = gn_device_submit(bench->device);
    *out_seconds = gn_seconds_now() - begin;
    return status;
}

static enum gn_device_status build(struct gn_bench *bench, enum subject subject, bool update, double *out_seconds)
{
    struct gn_device *device = bench->device;
    const VkAccelerationStructureBuildGeometryInfoKHR info = build_info(bench, subject, update);
    const VkAccelerationStructureBuildRangeInfoKHR range = {.primitiveCount = bench->subjects[subject].primitives};
    const VkAccelerationStructureBuildRangeInfoKHR *ranges = &range;
    enum gn_device_status status = gn_device_begin(device);
    if (status != GN_DEVICE_OK)
        return status;
    device->CmdBuildAccelerationStructuresKHR(device->commands, 1, &info, &ranges);
    return submit(bench, out_seconds);
}

/* Makes and builds what items work on, once. */
static enum gn_device_status prepare(struct gn_bench *bench, enum subject subject)
{
    struct gn_device *device = bench->device;
    struct prepared *p = &bench->subjects[subject];
    const struct subject_traits *t = &traits[subject];
    double seconds;
    if (p->ready)
        return GN_DEVICE_OK;
    p->geometry = (VkAccelerationStructureGeometryKHR){.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
                                                       .geometryType = t->kind,
                                                       .flags = VK_GEOMETRY_OPAQUE_BIT_KHR};
    enum gn_device_status status = t->kind == VK_GEOMETRY_TYPE_TRIANGLES_KHR ? make_triangles(bench, t->count, t->masked, p)
                                   : t->kind == VK_GEOMETRY_TYPE_AABBS_KHR   ? make_boxes(bench, t->count, p)
                                                                             : make_instances(bench, t->count, t->of, p);
    if (status != GN_DEVICE_OK)
        return status;
    VkAccelerationStructureBuildGeometryInfoKHR info = build_info(bench, subject, false);
    p->sizes = (VkAccelerationStructureBuildSizesInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR};
    device->GetAccelerationStructureBuildSizesKHR(device->handle, VK_ACCELERATION_STRUCTURE_BUILD_TYPE_DEVICE_KHR, &info,
                                                  &p->primitives, &p->sizes);
    VkDeviceSize scratch = p->sizes.buildScratchSize > p->sizes.updateScratchSize ? p->sizes.buildScratchSize
                                                                                  : p->sizes.updateScratchSize;
    uint32_t alignment = device->info.limits.minAccelerationStructureScratchOffsetAlignment;
    status = gn_pool_take(device, &bench->scratch, scratch ? scratch : 4, alignment ? alignment : 1, &p->scratch);
    if (status == GN_DEVICE_OK)
        status = create(bench, subject, p->sizes.accelerationStructureSize, &p->handle);
    if (status == GN_DEVICE_OK)
        status = build(bench, subject, false, &seconds);
    if (status != GN_DEVICE_OK)
        return status;
    const VkAccelerationStructureDeviceAddressInfoKHR address = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_DEVICE_ADDRESS_INFO_KHR, .accelerationStructure = p->handle};
    p->address = device->GetAccelerationStructureDeviceAddressKHR(device->handle, &address);
    p->ready = true;
    return GN_DEVICE_OK;
}

/* Asks for the size that a compacted copy has, and makes room for it, once. */
static enum gn_device_status prepare_compaction(struct gn_bench *bench, enum subject subject)
{
    struct gn_device *device = bench->device;
    struct prepared *p = &bench->subjects[subject];
    VkQueryPool queries = VK_NULL_HANDLE;
    double seconds;
    if (p->compacted)
        return GN_DEVICE_OK;
    const VkQueryPoolCreateInfo info = {.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO,
                                        .queryType = VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR,
                                        .queryCount = 1};
    enum gn_device_status status =
        gn_device_check(device, vkCreateQueryPool(device->handle, &info, NULL, &queries), "vkCreateQueryPool");
    if (status == GN_DEVICE_OK)
        status = gn_device_begin(device);
    if (status != GN_DEVICE_OK)
        goto done;
    vkCmdResetQueryPool(device->commands, queries, 0, 1);
    gn_device_barrier(device);
    device->CmdWriteAccelerationStructuresPropertiesKHR(device->commands, 1, &p->handle, info.queryType, queries, 0);
    if ((status = submit(bench, &seconds)) != GN_DEVICE_OK)
        goto done;
    VkResult result = vkGetQueryPoolResults(device->handle, queries, 0, 1, sizeof p->compacted_size, &p->compacted_size,
                                            sizeof p->compacted_size, VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT);
    status = gn_device_check(device, result, "vkGetQueryPoolResults");
    if (status == GN_DEVICE_OK)
        status = create(bench, subject, p->compacted_size, &p->compacted);
done:
    vkDestroyQueryPool(device->handle, queries, NULL);
    return status;
}

static enum gn_device_status compact(struct gn_bench *bench, enum subject subject, double *out_seconds)
{
    struct gn_device *device = bench->device;
    const VkCopyAccelerationStructureInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
        .src = bench->subjects[subject].handle,
        .dst = bench->subjects[subject].compacted,
        .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR,
    };
    enum gn_device_status status = gn_device_begin(device);
    if (status != GN_DEVICE_OK)
        return status;
    device->CmdCopyAccelerationStructureKHR(device->commands, &info);
    return submit(bench, out_seconds);
}

/* Traces */

/* That make rays. */
static VkShaderStageFlags stages_of(const struct gn_bench *bench)
{
    return VK_SHADER_STAGE_COMPUTE_BIT | (bench->device->info.ray_tracing_pipeline ? VK_SHADER_STAGE_RAYGEN_BIT_KHR : 0);
}

static enum gn_device_status prepare_layout(struct gn_bench *bench)
{
    VkDevice device = bench->device->handle;
    if (bench->layout)
        return GN_DEVICE_OK;
    const VkDescriptorSetLayoutBinding bindings[] = {
        {0, VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, 1, stages_of(bench), NULL},
        {1, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, stages_of(bench), NULL}};
    const VkDescriptorSetLayoutCreateInfo set_info = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO, .bindingCount = 2, .pBindings = bindings};
    const VkDescriptorPoolSize sizes[] = {{VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR, 1},
                                          {VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1}};
    const VkDescriptorPoolCreateInfo pool_info = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO, .maxSets = 1, .poolSizeCount = 2, .pPoolSizes = sizes};
    const VkPushConstantRange range = {stages_of(bench), 0, 12};
    VkResult result = vkCreateDescriptorSetLayout(device, &set_info, NULL, &bench->set_layout);
    if (result == VK_SUCCESS)
        result = vkCreateDescriptorPool(device, &pool_info, NULL, &bench->descriptor_pool);
    if (result == VK_SUCCESS) {
        const VkDescriptorSetAllocateInfo allocate = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                                      .descriptorPool = bench->descriptor_pool,
                                                      .descriptorSetCount = 1,
                                                      .pSetLayouts = &bench->set_layout};
        result = vkAllocateDescriptorSets(device, &allocate, &bench->descriptors);
    }
    if (result == VK_SUCCESS) {
        const VkPipelineLayoutCreateInfo info = {.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                                 .setLayoutCount = 1,
                                                 .pSetLayouts = &bench->set_layout,
                                                 .pushConstantRangeCount = 1,
                                                 .pPushConstantRanges = &range};
        result = vkCreatePipelineLayout(device, &info, NULL, &bench->layout);
    }
    if (result != VK_SUCCESS)
        return gn_device_check(bench->device, result, "making descriptors and layouts");
    return gn_pool_take(bench->device, &bench->host, RAY_COUNT * sizeof(float), 256, &bench->sums);
}

static enum gn_device_status create_pipeline(struct gn_bench *bench, VkPipeline *out)
{
    VkDevice device = bench->device->handle;
    const VkShaderModuleCreateInfo module_info = {
        .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, .codeSize = sizeof bench_comp_spv, .pCode = bench_comp_spv};
    VkShaderModule module = VK_NULL_HANDLE;
    VkResult result = vkCreateShaderModule(device, &module_info, NULL, &module);
    if (result == VK_SUCCESS) {
        const VkComputePipelineCreateInfo info = {.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
                                                  .stage = {.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                            .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                                                            .module = module,
                                                            .pName = "main"},
                                                  .layout = bench->layout};
        result = vkCreateComputePipelines(device, VK_NULL_HANDLE, 1, &info, NULL, out);
    }
    vkDestroyShaderModule(device, module, NULL);
    return gn_device_check(bench->device, result, "vkCreateComputePipelines");
}

/* By ray queries where `rays` is NULL. */
static enum gn_device_status trace(struct gn_bench *bench, const struct item *item, VkPipeline pipeline,
                                   const struct gn_bench_rays *rays, uint32_t count, double *out_seconds)
{
    struct gn_device *device = bench->device;
    const VkPipelineBindPoint point = rays ? VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR : VK_PIPELINE_BIND_POINT_COMPUTE;
    const uint32_t push[3] = {count, item->incoherent, item->ray_flags};
    enum gn_device_status status = gn_device_begin(device);
    if (status != GN_DEVICE_OK)
        return status;
    vkCmdBindDescriptorSets(device->commands, point, bench->layout, 0, 1, &bench->descriptors, 0, NULL);
    vkCmdPushConstants(device->commands, bench->layout, stages_of(bench), 0, sizeof push, push);
    if (rays) {
        gn_bench_rays_record(device, rays, count);
    } else {
        vkCmdBindPipeline(device->commands, point, pipeline);
        vkCmdDispatch(device->commands, (count + 63) / 64, 1, 1);
    }
    return submit(bench, out_seconds);
}

static enum gn_device_status prepare_trace(struct gn_bench *bench, enum subject subject, bool rays)
{
    if (!rays && !bench->device->info.ray_query)
        return gn_device_fail(bench->device, GN_DEVICE_UNSUPPORTED, "the device has no ray queries");
    enum gn_device_status status = prepare_layout(bench);
    if (status != GN_DEVICE_OK)
        return status;
    const VkWriteDescriptorSetAccelerationStructureKHR structures = {
        .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET_ACCELERATION_STRUCTURE_KHR,
        .accelerationStructureCount = 1,
        .pAccelerationStructures = &bench->subjects[subject].handle};
    const VkDescriptorBufferInfo sums = {bench->sums.buffer, bench->sums.offset, bench->sums.size};
    const VkWriteDescriptorSet writes[] = {{.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                            .pNext = &structures,
                                            .dstSet = bench->descriptors,
                                            .descriptorCount = 1,
                                            .descriptorType = VK_DESCRIPTOR_TYPE_ACCELERATION_STRUCTURE_KHR},
                                           {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                            .dstSet = bench->descriptors,
                                            .dstBinding = 1,
                                            .descriptorCount = 1,
                                            .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                            .pBufferInfo = &sums}};
    vkUpdateDescriptorSets(bench->device->handle, 2, writes, 0, NULL);
    if (!rays)
        return bench->pipeline ? GN_DEVICE_OK : create_pipeline(bench, &bench->pipeline);
    if (!bench->rays.handle)
        status = gn_bench_rays_create(bench->device, bench->layout, false, &bench->rays);
    return status == GN_DEVICE_OK ? gn_bench_rays_prepare(bench->device, &bench->rays) : status;
}

static enum gn_device_status make_pipeline(struct gn_bench *bench, const struct item *item, double *out_seconds)
{
    VkPipeline pipeline = VK_NULL_HANDLE;
    double begin = gn_seconds_now(), ignored;
    enum gn_device_status status = create_pipeline(bench, &pipeline);
    if (status == GN_DEVICE_OK && item->action == FIRST_USE)
        status = trace(bench, item, pipeline, NULL, 1, &ignored);
    *out_seconds = gn_seconds_now() - begin;
    vkDestroyPipeline(bench->device->handle, pipeline, NULL);
    return status;
}

static enum gn_device_status make_rays(struct gn_bench *bench, const struct item *item, double *out_seconds)
{
    struct gn_device *device = bench->device;
    struct gn_bench_rays rays = {0};
    double begin = gn_seconds_now(), ignored;
    enum gn_device_status status = gn_bench_rays_create(device, bench->layout, item->action == RAYS_LINKED, &rays);
    if (status == GN_DEVICE_OK && item->action == RAYS_FIRST_USE)
        status = gn_bench_rays_prepare(device, &rays);
    if (status == GN_DEVICE_OK && item->action == RAYS_FIRST_USE)
        status = trace(bench, item, VK_NULL_HANDLE, &rays, 1, &ignored);
    *out_seconds = gn_seconds_now() - begin;
    gn_bench_rays_destroy(device, &rays);
    return status;
}

static enum gn_device_status once(struct gn_bench *bench, const struct item *item, double *out_seconds)
{
    switch (item->action) {
    case BUILD:
    case UPDATE:
        return build(bench, item->subject, item->action == UPDATE, out_seconds);
    case COMPACT:
        return compact(bench, item->subject, out_seconds);
    case TRACE:
        return trace(bench, item, bench->pipeline, NULL, RAY_COUNT, out_seconds);
    case RAYS_TRACE:
        return trace(bench, item, VK_NULL_HANDLE, &bench->rays, RAY_COUNT, out_seconds);
    case PIPELINE:
    case FIRST_USE:
        return make_pipeline(bench, item, out_seconds);
    default:
        return make_rays(bench, item, out_seconds);
    }
}

enum gn_device_status gn_bench_measure(struct gn_bench *bench, size_t number, double *out_value)
{
    const struct item *item = &items[number];
    const struct prepared *p = &bench->subjects[item->subject];
    enum gn_device_status status = prepare(bench, item->subject);
    if (status == GN_DEVICE_OK && (item->action == COMPACT || item->action == COMPACTED_BYTES))
        status = prepare_compaction(bench, item->subject);
    if (status == GN_DEVICE_OK && item->action >= TRACE && item->action <= RAYS_FIRST_USE)
        status = prepare_trace(bench, item->subject, item->action >= RAYS_TRACE);
    if (status != GN_DEVICE_OK)
        return status;
    switch (item->action) {
    case STRUCTURE_BYTES:
        *out_value = (double)p->sizes.accelerationStructureSize;
        return GN_DEVICE_OK;
    case SCRATCH_BYTES:
        *out_value = (double)p->sizes.buildScratchSize;
        return GN_DEVICE_OK;
    case COMPACTED_BYTES:
        *out_value = (double)p->compacted_size;
        return GN_DEVICE_OK;
    default:
        break;
    }
    double best = INFINITY, total = 0, seconds = 0;
    for (int i = 0; i < MOST_REPEATS && total < (i < 2 ? ENOUGH_SECONDS : LEAST_SECONDS); i++) {
        if ((status = once(bench, item, &seconds)) != GN_DEVICE_OK)
            return status;
        total += seconds;
        best = fmin(best, seconds);
    }
    *out_value = best;
    return GN_DEVICE_OK;
}
