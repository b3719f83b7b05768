/* SPDX-License-Identifier: Apache-2.0 */
/* Updates that read something else than the build did, on a driver. */
#include "tests/layer/harness.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BLAS VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR
#define ALLOW_UPDATE VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR
#define INPUT VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR
#define INDICES_AT 64
#define BOXES_AT 128
#define MANY 128

/* Two triangles with indices, or two boxes, in one buffer. */
struct subject {
    struct world *world;
    struct structure blas; /* whose own input is not used */
    struct buffer input;
    float *vertices, *boxes;
    uint32_t *indices;
    bool with_boxes;
    uint32_t count;
};

static void build(struct subject *subject, bool update)
{
    struct world *world = subject->world;
    VkAccelerationStructureGeometryKHR geometry = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR};
    if (subject->with_boxes) {
        geometry.geometryType = VK_GEOMETRY_TYPE_AABBS_KHR;
        geometry.geometry.aabbs = (VkAccelerationStructureGeometryAabbsDataKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR,
            .data.deviceAddress = subject->input.address + BOXES_AT,
            .stride = 24};
    } else {
        geometry.geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR;
        geometry.geometry.triangles = (VkAccelerationStructureGeometryTrianglesDataKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
            .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
            .vertexData.deviceAddress = subject->input.address,
            .vertexStride = 12,
            .maxVertex = 3,
            .indexType = VK_INDEX_TYPE_UINT32,
            .indexData.deviceAddress = subject->input.address + INDICES_AT};
    }
    VkAccelerationStructureBuildGeometryInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = BLAS,
        .flags = ALLOW_UPDATE,
        .mode = update ? VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR : VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
        .srcAccelerationStructure = update ? subject->blas.handle : VK_NULL_HANDLE,
        .dstAccelerationStructure = subject->blas.handle,
        .geometryCount = 1,
        .pGeometries = &geometry,
        .scratchData.deviceAddress = subject->blas.scratch.address};
    VkAccelerationStructureBuildRangeInfoKHR range = {.primitiveCount = subject->count};
    const VkAccelerationStructureBuildRangeInfoKHR *ranges = &range;
    VkCommandBuffer commands = commands_begin(world, 0);
    world->CmdBuildAccelerationStructuresKHR(commands, 1, &info, &ranges);
    commands_barrier(commands);
    commands_end(commands);
    submit_and_wait(world, commands);
}

static void nothing(struct subject *subject)
{
    (void)subject;
}

static void moved(struct subject *subject)
{
    subject->vertices[0] = 5;
    subject->boxes[0] = -5;
}

static void other_indices(struct subject *subject)
{
    subject->indices[3] = 0;
}

static void triangle_gone(struct subject *subject)
{
    for (int v = 0; v < 4; v++)
        subject->vertices[v * 3] = NAN;
}

static void half_a_triangle(struct subject *subject)
{
    subject->vertices[0] = NAN;
}

static void box_gone(struct subject *subject)
{
    subject->boxes[6] = NAN;
}

static const struct {
    const char *name, *rule;
    uint32_t findings;
    bool with_boxes, gone_at_first, build_anew;
    void (*change)(struct subject *subject);
} rows[] = {
    {"nothing changes", "update.indices_changed", 0, false, false, false, nothing},
    {"vertices move", "update.indices_changed", 0, false, false, false, moved},
    {"other indices", "update.indices_changed", 1, false, false, false, other_indices},
    {"other indices, built anew", "update.indices_changed", 0, false, false, true, other_indices},
    {"triangles become inactive", "update.activity_changed", 1, false, false, false, triangle_gone},
    {"triangles stay inactive", "update.activity_changed", 0, false, true, false, triangle_gone},
    {"triangles become inactive in a build", "update.activity_changed", 0, false, false, true, triangle_gone},
    {"boxes move", "update.activity_changed", 0, true, false, false, moved},
    {"a box becomes inactive", "update.activity_changed", 1, true, false, false, box_gone},
    {"a box stays inactive", "update.activity_changed", 0, true, true, false, box_gone},
    /* Readings of the specification differ: nothing is said. */
    {"one corner is NaN", "update.activity_changed", 0, false, false, false, half_a_triangle},
};

/* The scratch memory and the structure are large enough for every geometry here. */
static void subject_init(struct subject *subject, struct world *world, bool with_boxes, uint32_t count)
{
    static const float vertices[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0}, boxes[] = {0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3};
    static const uint32_t indices[] = {0, 1, 2, 2, 1, 3};
    *subject = (struct subject){.world = world, .with_boxes = with_boxes, .count = count};
    subject->blas = blas_create(world, BLAS, ALLOW_UPDATE);
    buffer_destroy(world, &subject->blas.storage);
    structure_destroy_handle(world, &subject->blas);
    subject->blas.size = 65536;
    subject->blas.storage = buffer_create(world, 65536, VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR);
    structure_create_handle(world, &subject->blas, BLAS);
    buffer_destroy(world, &subject->blas.scratch);
    subject->blas.scratch = buffer_create(world, 65536, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT);
    subject->input = buffer_create(world, BOXES_AT + count * 24, INPUT);
    subject->vertices = memcpy(subject->input.mapped, vertices, sizeof vertices);
    subject->indices = memcpy((char *)subject->input.mapped + INDICES_AT, indices, sizeof indices);
    subject->boxes = memcpy((char *)subject->input.mapped + BOXES_AT, boxes, sizeof boxes);
}

static void subject_finish(struct subject *subject)
{
    buffer_destroy(subject->world, &subject->input);
    structure_destroy(subject->world, &subject->blas);
}

static void every_row(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct world *world = calloc(1, sizeof *world);
        struct subject subject;
        print_message("    %s\n", rows[i].name);
        world_init(world, NULL);
        world->rule = rows[i].rule;
        subject_init(&subject, world, rows[i].with_boxes, 2);
        if (rows[i].gone_at_first)
            rows[i].change(&subject);
        build(&subject, false);
        rows[i].change(&subject);
        build(&subject, !rows[i].build_anew);
        build(&subject, true); /* the same again is no news */
        expect_findings(world, rows[i].findings);
        subject_finish(&subject);
        world_finish(world);
        free(world);
    }
}

/* A row of boxes of which each is `step` places after the one before: 1 leaves neighbours together, 37 scatters them. */
static void place(struct subject *subject, uint32_t step)
{
    for (uint32_t i = 0; i < MANY; i++)
        for (int side = 0; side < 2; side++)
            for (int axis = 0; axis < 3; axis++)
                subject->boxes[i * 6 + (uint32_t)(side * 3 + axis)] = (float)(axis ? side : (int)(i * step % MANY) + side);
}

static const struct {
    const char *name;
    uint32_t step, updates, built_at; /* the update before which it is built anew; 0: never */
    uint32_t findings;
} many_rows[] = {
    {"neighbours stay together", 1, 16, 0, 0},
    {"scattered, looked at with the eighth", 37, 8, 0, 1},
    {"scattered, not looked at yet", 37, 7, 0, 0},
    {"scattered, and told once", 37, 16, 0, 1},
    {"scattered, and built anew in between", 37, 12, 7, 0},
};

static void many_updates(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof many_rows / sizeof many_rows[0]; i++) {
        struct world *world = calloc(1, sizeof *world);
        struct subject subject;
        print_message("    %s\n", many_rows[i].name);
        world_init(world, NULL);
        world->rule = "update.many";
        subject_init(&subject, world, true, MANY);
        place(&subject, 1);
        build(&subject, false);
        for (uint32_t u = 1; u <= many_rows[i].updates; u++) {
            if (u == many_rows[i].built_at)
                build(&subject, false);
            build(&subject, true);
            if (u == 1)
                place(&subject, many_rows[i].step);
        }
        expect_findings(world, many_rows[i].findings);
        subject_finish(&subject);
        world_finish(world);
        free(world);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_row), cmocka_unit_test(many_updates)};
    return cmocka_run_group_tests_name("refit", tests, NULL, NULL);
}
