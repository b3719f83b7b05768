/* SPDX-License-Identifier: Apache-2.0 */
/* What builds read, on a driver: contents as the device finds them, alignment, usage of buffers, and sizes. */
#include "tests/layer/harness.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define INPUT VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR
#define STORAGE VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR
#define SCRATCH VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
/* The parts of the one buffer that holds everything; behind its end the memory goes on, so that the driver survives. */
#define VERTICES_AT 0
#define INDICES_AT 256
#define TRANSFORM_AT 512
#define BOXES_AT 768

/* A BLAS of two triangles or two boxes, as a row wants it built. */
struct subject {
    struct world *world;
    struct buffer input, storage, scratch;
    VkAccelerationStructureGeometryKHR geometry;
    VkAccelerationStructureBuildRangeInfoKHR range;
    VkDeviceAddress scratch_address;
    VkDeviceSize storage_less; /* so much smaller than needed */
    uint32_t *indices;
    float *vertices, *transform, *boxes;
    void (*late)(struct subject *subject); /* between recording and submission */
};

static void subject_init(struct subject *subject, struct world *world)
{
    static const uint32_t indices[] = {0, 1, 2, 2, 1, 3};
    static const float vertices[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0}, transform[] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                       boxes[] = {0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3};
    *subject = (struct subject){.world = world};
    subject->input = buffer_create(world, 1024, INPUT);
    subject->storage = buffer_create(world, 65536, STORAGE);
    subject->scratch = buffer_create(world, 65536, SCRATCH);
    subject->scratch_address = subject->scratch.address;
    char *mapped = subject->input.mapped;
    subject->vertices = memcpy(mapped + VERTICES_AT, vertices, sizeof vertices);
    subject->indices = memcpy(mapped + INDICES_AT, indices, sizeof indices);
    subject->transform = memcpy(mapped + TRANSFORM_AT, transform, sizeof transform);
    subject->boxes = memcpy(mapped + BOXES_AT, boxes, sizeof boxes);
    subject->geometry = (VkAccelerationStructureGeometryKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR,
        .geometry.triangles = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
                               .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
                               .vertexData.deviceAddress = subject->input.address + VERTICES_AT,
                               .vertexStride = 12,
                               .maxVertex = 3,
                               .indexType = VK_INDEX_TYPE_UINT32,
                               .indexData.deviceAddress = subject->input.address + INDICES_AT,
                               .transformData.deviceAddress = subject->input.address + TRANSFORM_AT}};
    subject->range.primitiveCount = 2;
}

static void use_boxes(struct subject *subject)
{
    subject->geometry.geometryType = VK_GEOMETRY_TYPE_AABBS_KHR;
    subject->geometry.geometry.aabbs = (VkAccelerationStructureGeometryAabbsDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR,
        .data.deviceAddress = subject->input.address + BOXES_AT,
        .stride = 24};
}

static void subject_build(struct subject *subject)
{
    struct world *world = subject->world;
    VkAccelerationStructureBuildGeometryInfoKHR build = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
                                                         .type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
                                                         .geometryCount = 1,
                                                         .pGeometries = &subject->geometry};
    VkAccelerationStructureBuildSizesInfoKHR sizes = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR};
    world->GetAccelerationStructureBuildSizesKHR(world->device, VK_ACCELERATION_STRUCTURE_BUILD_TYPE_DEVICE_KHR, &build,
                                                 &subject->range.primitiveCount, &sizes);
    VkAccelerationStructureCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
                                                 .buffer = subject->storage.handle,
                                                 .size = sizes.accelerationStructureSize - subject->storage_less,
                                                 .type = build.type};
    assert_true(sizes.accelerationStructureSize < subject->storage.size);
    assert_int_equal(world->CreateAccelerationStructureKHR(world->device, &info, NULL, &build.dstAccelerationStructure), VK_SUCCESS);
    build.scratchData.deviceAddress = subject->scratch_address;
    const VkAccelerationStructureBuildRangeInfoKHR *ranges = &subject->range;
    VkCommandBuffer commands = commands_begin(world, 0);
    world->CmdBuildAccelerationStructuresKHR(commands, 1, &build, &ranges);
    commands_end(commands);
    if (subject->late)
        subject->late(subject);
    submit_and_wait(world, commands);
    world->DestroyAccelerationStructureKHR(world->device, build.dstAccelerationStructure, NULL);
}

/* The memory stays as it was. */
static void shorten_scratch(struct subject *subject)
{
    struct world *world = subject->world;
    vkDestroyBuffer(world->device, subject->scratch.handle, NULL);
    VkBufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                               .size = 32768,
                               .usage = SCRATCH | VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT};
    assert_int_equal(vkCreateBuffer(world->device, &info, NULL, &subject->scratch.handle), VK_SUCCESS);
    assert_int_equal(vkBindBufferMemory(world->device, subject->scratch.handle, subject->scratch.memory, 0), VK_SUCCESS);
    VkBufferDeviceAddressInfo query = {.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO, .buffer = subject->scratch.handle};
    subject->scratch_address = vkGetBufferDeviceAddress(world->device, &query);
}

#define ALTER(name, ...)                                                                                               \
    static void name(struct subject *subject)                                                                          \
    {                                                                                                                  \
        VkAccelerationStructureGeometryTrianglesDataKHR *triangles = &subject->geometry.geometry.triangles;            \
        (void)triangles;                                                                                               \
        __VA_ARGS__;                                                                                                   \
    }

ALTER(nothing, (void)subject)
ALTER(index_above, subject->indices[4] = 9)
ALTER(index_above_late, subject->late = index_above)
ALTER(index_right_late, subject->indices[4] = 9; subject->late = nothing; triangles->maxVertex = 9)
ALTER(index_of_16_bits, triangles->indexType = VK_INDEX_TYPE_UINT16; uint16_t *few = (uint16_t *)(void *)subject->indices;
      for (int i = 0; i < 6; i++) few[i] = (uint16_t)(i == 5 ? 4 : i / 2))
ALTER(other_offset, subject->indices[0] = 100; subject->range.primitiveOffset = 12; subject->range.primitiveCount = 1)
ALTER(nan_y, subject->vertices[4] = NAN)
ALTER(nan_x, subject->vertices[3] = NAN)
ALTER(nan_unused, subject->vertices[13] = NAN; triangles->maxVertex = 4)
ALTER(nan_of_first_vertex, subject->vertices[1] = NAN; subject->range.firstVertex = 1)
ALTER(infinite, subject->vertices[4] = INFINITY)
ALTER(nan_without_indices, triangles->indexType = VK_INDEX_TYPE_NONE_KHR; triangles->maxVertex = 5; subject->vertices[16] = NAN)
ALTER(flat_transform, subject->transform[0] = 0)
ALTER(no_transform, flat_transform(subject); triangles->transformData.deviceAddress = 0)
ALTER(boxes, use_boxes(subject))
ALTER(boxes_inverted, use_boxes(subject); subject->boxes[10] = -1)
ALTER(boxes_inactive, boxes_inverted(subject); subject->boxes[6] = NAN)
ALTER(boxes_nan, use_boxes(subject); subject->boxes[7] = NAN)
/* What lies at a misaligned address is valid in itself. */
ALTER(boxes_misaligned, use_boxes(subject); memset(subject->boxes, 0, 64); subject->geometry.geometry.aabbs.data.deviceAddress += 4)
ALTER(boxes_stride, use_boxes(subject); memset(subject->boxes, 0, 64); subject->geometry.geometry.aabbs.stride = 28)
ALTER(boxes_offset, use_boxes(subject); subject->range = (VkAccelerationStructureBuildRangeInfoKHR){1, 20, 0, 0})
ALTER(indices_misaligned, memset(subject->indices, 0, 32); triangles->indexData.deviceAddress += 2)
ALTER(vertices_misaligned, triangles->vertexData.deviceAddress += 2)
ALTER(stride_misaligned, triangles->vertexStride = 14)
ALTER(transform_misaligned, memmove(subject->transform + 2, subject->transform, 48); triangles->transformData.deviceAddress += 8)
ALTER(transform_offset, memmove(subject->transform + 2, subject->transform, 48); subject->range.transformOffset = 8)
ALTER(scratch_misaligned, subject->scratch_address += 1)
ALTER(other_usage, buffer_destroy(subject->world, &subject->input);
      subject->input = buffer_create(subject->world, 1024, SCRATCH); triangles->transformData.deviceAddress = 0;
      triangles->indexType = VK_INDEX_TYPE_NONE_KHR; triangles->maxVertex = 5;
      triangles->vertexData.deviceAddress = subject->input.address)
ALTER(scratch_usage, buffer_destroy(subject->world, &subject->scratch);
      subject->scratch = buffer_create(subject->world, 65536, INPUT); subject->scratch_address = subject->scratch.address)
ALTER(scratch_at_end, shorten_scratch(subject); subject->scratch_address += 32768 - 8)
ALTER(structure_small, subject->storage_less = 1)
ALTER(stride_large, subject->range.primitiveCount = 1; triangles->indexType = VK_INDEX_TYPE_NONE_KHR;
      use_boxes(subject); subject->geometry.geometry.aabbs.stride = UINT64_C(1) << 33)

static const struct row {
    const char *name, *why;
    const char *rule; /* NULL: nothing is found */
    void (*alter)(struct subject *subject);
} rows[] = {
    {"valid", "two triangles, with indices and a transform", NULL, nothing},
    {"index above maxVertex", "9 of 3", "inputs.index_beyond_max_vertex", index_above},
    {"index written later", "contents are those of the execution", "inputs.index_beyond_max_vertex", index_above_late},
    {"index announced", "9 of 9", NULL, index_right_late},
    {"indices of 16 bits", "4 of 3", "inputs.index_beyond_max_vertex", index_of_16_bits},
    {"offset of indices", "the offset selects the indices", NULL, other_offset},
    {"NaN", "in y", "inputs.nan", nan_y},
    {"inactive triangle", "NaN in x", NULL, nan_x},
    {"NaN in a vertex that nothing uses", "announced, and never named", NULL, nan_unused},
    {"NaN before firstVertex", "firstVertex selects the vertices", NULL, nan_of_first_vertex},
    {"infinite", "in y", "inputs.infinite", infinite},
    {"NaN without indices", "of the sixth vertex", "inputs.nan", nan_without_indices},
    {"flat transform", "scaled by 0", "inputs.transform_singular", flat_transform},
    {"no transform", "there is none to judge", NULL, no_transform},
    {"boxes", "valid", NULL, boxes},
    {"inverted box", "maxY < minY", "inputs.aabb_inverted", boxes_inverted},
    {"inactive box", "minX is NaN", NULL, boxes_inactive},
    {"NaN in a box", "minY", "inputs.nan", boxes_nan},
    {"misaligned boxes", "8 are asked for", "inputs.misaligned", boxes_misaligned},
    {"misaligned stride of boxes", "8 are asked for", "inputs.misaligned", boxes_stride},
    {"misaligned offset of boxes", "8 are asked for", "inputs.misaligned", boxes_offset},
    {"misaligned indices", "by half an index", "inputs.misaligned", indices_misaligned},
    {"misaligned vertices", "by half a component", "inputs.misaligned", vertices_misaligned},
    {"misaligned stride", "by half a component", "inputs.misaligned", stride_misaligned},
    {"misaligned transform", "16 are asked for", "inputs.misaligned", transform_misaligned},
    {"misaligned offset of a transform", "16 are asked for", "inputs.misaligned", transform_offset},
    {"misaligned scratch memory", "the limit of the device", "inputs.misaligned", scratch_misaligned},
    {"usage of the input", "a storage buffer", "inputs.buffer_usage", other_usage},
    {"usage of the scratch memory", "a buffer for input", "inputs.buffer_usage", scratch_usage},
    {"little scratch memory", "8 bytes to the end", "build.scratch_too_small", scratch_at_end},
    {"small structure", "a byte is missing", "build.structure_too_small", structure_small},
    {"large stride", "2^33", "inputs.limit", stride_large},
};
#define ROW_COUNT (sizeof rows / sizeof rows[0])

static void run_row(void **state)
{
    const struct row *row = *state;
    struct world *world = calloc(1, sizeof *world);
    struct subject subject;
    assert_non_null(world);
    world_init(world, NULL);
    world->rule = row->rule ? row->rule : NEVER_BUILT;
    subject_init(&subject, world);
    row->alter(&subject);
    subject_build(&subject);
    expect_findings(world, row->rule != NULL);
    buffer_destroy(world, &subject.input);
    buffer_destroy(world, &subject.storage);
    buffer_destroy(world, &subject.scratch);
    world_finish(world);
    free(world);
}

/* What is left out is said. */
static void the_cap_bounds_what_is_read(void **state)
{
    (void)state;
    static const struct {
        const char *cap;
        uint32_t findings;
    } table[] = {{"24", 1}, {"23", 0}, {"0", 0}};
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        struct world *world = calloc(1, sizeof *world);
        struct subject subject;
        assert_non_null(world);
        setenv("VK_GNOMON_RAY_TRACING_INPUT_CAP", table[i].cap, 1);
        struct world_options options = {.creation_messenger = true};
        world_init(world, &options);
        world->rule = "inputs.index_beyond_max_vertex";
        subject_init(&subject, world);
        index_above(&subject);
        subject_build(&subject);
        expect_findings(world, table[i].findings);
        buffer_destroy(world, &subject.input);
        buffer_destroy(world, &subject.storage);
        buffer_destroy(world, &subject.scratch);
        world_finish(world);
        const struct message *statement = messages_find(world, "statement");
        assert_non_null(statement);
        if (i < 2)
            assert_non_null(strstr(statement->text, "indices, vertices and boxes beyond input_cap"));
        free(world);
    }
    unsetenv("VK_GNOMON_RAY_TRACING_INPUT_CAP");
}

int main(void)
{
    struct CMUnitTest tests[ROW_COUNT + 1];
    size_t count = 0;
    for (; count < ROW_COUNT; count++)
        tests[count] = (struct CMUnitTest){
            .name = rows[count].name, .test_func = run_row, .initial_state = (void *)(uintptr_t)&rows[count]};
    tests[count++] = (struct CMUnitTest)cmocka_unit_test(the_cap_bounds_what_is_read);
    return _cmocka_run_group_tests("inputs", tests, count, NULL, NULL);
}
