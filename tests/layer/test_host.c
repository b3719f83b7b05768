/* SPDX-License-Identifier: Apache-2.0 */
/* Commands on the host, which no driver here has, above the fake one: each misuse beside what is right. */
#include "tests/layer/fake.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define OPERATION ((VkDeferredOperationKHR)(uintptr_t)0xDEF)
#define UPDATABLE VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR
#define COMPACTABLE VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR

static VkAccelerationStructureKHR make_of_size(struct fixture *fixture, VkDeviceSize size)
{
    VkAccelerationStructureCreateInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR, .size = size, .type = BOTTOM};
    VkAccelerationStructureKHR handle;
    assert_int_equal(gn_entry_CreateAccelerationStructureKHR(fixture->handle, &info, NULL, &handle), VK_SUCCESS);
    return handle;
}

static void build_with(struct fixture *fixture, VkAccelerationStructureKHR target, VkBuildAccelerationStructureFlagsKHR flags,
                       bool update)
{
    struct job job;
    job_fill(&job, fixture, target, BOTTOM);
    job.info.flags = flags;
    job.info.mode = update ? VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR : VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR;
    job.info.srcAccelerationStructure = target;
    gn_entry_BuildAccelerationStructuresKHR(fixture->handle, OPERATION, 1, &job.info, &job.ranges);
}

static void copy(struct fixture *fixture, VkAccelerationStructureKHR from, VkAccelerationStructureKHR to,
                 VkCopyAccelerationStructureModeKHR mode)
{
    VkCopyAccelerationStructureInfoKHR info = {.src = from, .dst = to, .mode = mode};
    gn_entry_CopyAccelerationStructureKHR(fixture->handle, OPERATION, &info);
}

static void ask(struct fixture *fixture, VkAccelerationStructureKHR structure)
{
    uint64_t size = 0;
    gn_entry_WriteAccelerationStructuresPropertiesKHR(fixture->handle, 1, &structure,
                                                      VK_QUERY_TYPE_ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR, sizeof size, &size,
                                                      sizeof size);
    assert_int_equal(size, compacted_size);
}

static void tlas_of_an_unbuilt_blas(struct fixture *fixture)
{
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    fixture->record.accelerationStructureReference = (uint64_t)blas;
    on_host(fixture, tlas, TOP);
    on_host(fixture, blas, BOTTOM);
    on_host(fixture, tlas, TOP);
}

static void array_of_pointers(struct fixture *fixture)
{
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    static const VkAccelerationStructureInstanceKHR inactive;
    const VkAccelerationStructureInstanceKHR *pointers[] = {&inactive, &fixture->record};
    struct job job;
    fixture->record.accelerationStructureReference = (uint64_t)blas;
    job_fill(&job, fixture, tlas, TOP);
    job.geometry.geometry.instances.arrayOfPointers = VK_TRUE;
    job.geometry.geometry.instances.data.hostAddress = pointers;
    job.range.primitiveCount = 2;
    gn_entry_BuildAccelerationStructuresKHR(fixture->handle, VK_NULL_HANDLE, 1, &job.info, &job.ranges);
    assert_int_equal(checked(fixture, GN_CHECKED_instances), 2);
}

static void failed_build(struct fixture *fixture)
{
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    fixture->record.accelerationStructureReference = (uint64_t)blas;
    build_result = VK_ERROR_OUT_OF_HOST_MEMORY;
    on_host(fixture, blas, BOTTOM);
    build_result = VK_SUCCESS;
    on_host(fixture, tlas, TOP);
}

static void copy_of_an_unbuilt(struct fixture *fixture)
{
    VkAccelerationStructureKHR source = make(fixture, BOTTOM), target = make(fixture, BOTTOM);
    copy(fixture, source, target, VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR);
    on_host(fixture, source, BOTTOM);
    copy(fixture, source, target, VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR);
}

static void serialization_of_an_unbuilt(struct fixture *fixture)
{
    VkAccelerationStructureKHR source = make(fixture, BOTTOM), target = make(fixture, BOTTOM);
    VkCopyAccelerationStructureToMemoryInfoKHR out = {.src = source};
    VkCopyMemoryToAccelerationStructureInfoKHR in = {.dst = target};
    gn_entry_CopyAccelerationStructureToMemoryKHR(fixture->handle, VK_NULL_HANDLE, &out);
    gn_entry_CopyMemoryToAccelerationStructureKHR(fixture->handle, VK_NULL_HANDLE, &in);
    out.src = target;
    gn_entry_CopyAccelerationStructureToMemoryKHR(fixture->handle, VK_NULL_HANDLE, &out);
}

static void update_of_an_unbuilt(struct fixture *fixture)
{
    build_with(fixture, make(fixture, BOTTOM), UPDATABLE, true);
}

static void update_not_allowed(struct fixture *fixture)
{
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM);
    build_with(fixture, blas, 0, false);
    build_with(fixture, blas, 0, true);
}

static void update_allowed(struct fixture *fixture)
{
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM);
    build_with(fixture, blas, UPDATABLE, false);
    build_with(fixture, blas, UPDATABLE, true);
}

/* What the host has built is known on the device. */
static void update_on_the_device(struct fixture *fixture)
{
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM);
    on_host(fixture, blas, BOTTOM);
    update_on_queue(fixture, 0, 0, blas);
    gn_device_collect(fixture->device);
}

/* And the other way around, once the host knows that the device has finished. */
static void update_of_a_device_build(struct fixture *fixture)
{
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM);
    VkFence fence = (VkFence)(uintptr_t)0xFE;
    on_queue(fixture, 0, 0, blas, BOTTOM, fence);
    build_with(fixture, blas, 0, true);
    assert_int_equal(fixture->instance.findings, 0);
    gn_entry_WaitForFences(fixture->handle, 1, &fence, VK_TRUE, UINT64_MAX);
    build_with(fixture, blas, 0, true);
}

static void question_about_an_unbuilt(struct fixture *fixture)
{
    ask(fixture, make(fixture, BOTTOM));
}

static void question_not_allowed(struct fixture *fixture)
{
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM);
    build_with(fixture, blas, 0, false);
    ask(fixture, blas);
}

static void compact_into(struct fixture *fixture, VkDeviceSize size)
{
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM);
    build_with(fixture, blas, COMPACTABLE, false);
    ask(fixture, blas);
    copy(fixture, blas, make_of_size(fixture, size), VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR);
}

static void compaction_too_small(struct fixture *fixture)
{
    compact_into(fixture, 599);
}

static void compaction_fits(struct fixture *fixture)
{
    compact_into(fixture, 600);
}

static void host_then_device(struct fixture *fixture)
{
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    fixture->record.accelerationStructureReference = (uint64_t)blas << 8;
    on_host(fixture, blas, BOTTOM);
    on_queue(fixture, 0, 0, tlas, TOP, VK_NULL_HANDLE);
    gn_device_collect(fixture->device);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_other_order), 0);
}

static VkResult defer(struct fixture *fixture, VkAccelerationStructureKHR target, VkAccelerationStructureTypeKHR type)
{
    struct job job;
    job_fill(&job, fixture, target, type);
    build_result = VK_OPERATION_DEFERRED_KHR;
    return gn_entry_BuildAccelerationStructuresKHR(fixture->handle, OPERATION, 1, &job.info, &job.ranges);
}

/* What is read belongs to the call: the application has its memory back when the operation is over. */
static void deferred(struct fixture *fixture)
{
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), tlas = make(fixture, TOP);
    fixture->record.accelerationStructureReference = (uint64_t)blas;
    assert_int_equal(defer(fixture, tlas, TOP), VK_OPERATION_DEFERRED_KHR);
    memset(&fixture->record, 0, sizeof fixture->record);
    assert_int_equal(gn_entry_DeferredOperationJoinKHR(fixture->handle, OPERATION), VK_THREAD_IDLE_KHR);
    assert_int_equal(gn_entry_GetDeferredOperationResultKHR(fixture->handle, OPERATION), VK_NOT_READY);
    assert_int_equal(fixture->instance.findings, 0);
    build_result = VK_SUCCESS;
    assert_int_equal(gn_entry_DeferredOperationJoinKHR(fixture->handle, OPERATION), VK_SUCCESS);
    assert_int_equal(fixture->instance.findings, 1);
    gn_entry_GetDeferredOperationResultKHR(fixture->handle, OPERATION);
    gn_entry_DestroyDeferredOperationKHR(fixture->handle, OPERATION, NULL);
    assert_int_equal(checked(fixture, GN_CHECKED_tlas_builds), 1);
}

/* Each one is over before the next begins. */
static void deferred_in_order(struct fixture *fixture)
{
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), tlas = make(fixture, TOP), clone = make(fixture, BOTTOM);
    fixture->record.accelerationStructureReference = (uint64_t)clone;
    defer(fixture, blas, BOTTOM);
    build_result = VK_SUCCESS;
    gn_entry_GetDeferredOperationResultKHR(fixture->handle, OPERATION);
    build_result = VK_OPERATION_DEFERRED_KHR;
    copy(fixture, blas, clone, VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR);
    build_result = VK_SUCCESS;
    gn_entry_DestroyDeferredOperationKHR(fixture->handle, OPERATION, NULL);
    on_host(fixture, tlas, TOP);
    assert_int_equal(checked(fixture, GN_CHECKED_tlas_builds), 1);
}

/* The copy is asked for before the build that it needs is over. */
static void deferred_too_early(struct fixture *fixture)
{
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), clone = make(fixture, BOTTOM);
    defer(fixture, blas, BOTTOM);
    build_result = VK_SUCCESS;
    copy(fixture, blas, clone, VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR);
    gn_entry_DeferredOperationJoinKHR(fixture->handle, OPERATION);
}

static void deferred_and_failed(struct fixture *fixture)
{
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM), clone = make(fixture, BOTTOM);
    defer(fixture, blas, BOTTOM);
    build_result = VK_ERROR_OUT_OF_HOST_MEMORY;
    gn_entry_DeferredOperationJoinKHR(fixture->handle, OPERATION);
    build_result = VK_SUCCESS;
    copy(fixture, blas, clone, VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR);
}

static void deferred_and_left(struct fixture *fixture)
{
    defer(fixture, make(fixture, BOTTOM), BOTTOM);
    build_result = VK_SUCCESS;
}

/* Two triangles, or two boxes, given by pointers to geometries. */
struct data {
    uint16_t indices[6];
    float vertices[16], transform[12], boxes[12];
};

static void build_data(struct fixture *fixture, const struct data *data, bool boxes)
{
    VkAccelerationStructureKHR blas = make(fixture, BOTTOM);
    struct job job;
    const VkAccelerationStructureGeometryKHR *pointer = &job.geometry;
    fixture->instance.settings.input_cap = 1 << 20;
    job_fill(&job, fixture, blas, BOTTOM);
    job.info.pGeometries = NULL;
    job.info.ppGeometries = &pointer;
    job.range.primitiveCount = 2;
    if (boxes) {
        job.geometry.geometry.aabbs.data.hostAddress = data->boxes;
        job.geometry.geometry.aabbs.stride = 24;
    } else {
        job.geometry.geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR;
        job.geometry.geometry.triangles = (VkAccelerationStructureGeometryTrianglesDataKHR){
            .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
            .vertexData.hostAddress = data->vertices,
            .vertexStride = 12,
            .maxVertex = 3,
            .indexType = VK_INDEX_TYPE_UINT16,
            .indexData.hostAddress = data->indices,
            .transformData.hostAddress = data->transform};
        job.range.firstVertex = 1;
    }
    gn_entry_BuildAccelerationStructuresKHR(fixture->handle, VK_NULL_HANDLE, 1, &job.info, &job.ranges);
    assert_int_equal(checked(fixture, GN_CHECKED_geometries), 1);
}

static const struct data right = {{0, 1, 2, 2, 1, 3},
                                  {NAN, NAN, NAN, 0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0},
                                  {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                                  {0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3}};

#define WITH(name, boxes, ...)                                                                                         \
    static void name(struct fixture *fixture)                                                                          \
    {                                                                                                                  \
        struct data data = right;                                                                                      \
        __VA_ARGS__;                                                                                                   \
        build_data(fixture, &data, boxes);                                                                             \
    }

WITH(triangles, false, (void)0)
WITH(index_above, false, data.indices[4] = 4)
WITH(vertex_nan, false, data.vertices[7] = NAN)
WITH(transform_singular, false, data.transform[0] = 0)
WITH(boxes, true, (void)0)
WITH(box_inverted, true, data.boxes[10] = -1)

static const struct row {
    const char *name;
    void (*run)(struct fixture *fixture);
    const char *rule; /* NULL: nothing is found */
} rows[] = {
    {"TLAS of a BLAS, before and after it is built", tlas_of_an_unbuilt_blas, "build.order.blas_never_built"},
    {"the same by an array of pointers", array_of_pointers, "build.order.blas_never_built"},
    {"TLAS of a BLAS whose build failed", failed_build, "build.order.blas_never_built"},
    {"built on the host, used on the device", host_then_device, NULL},
    {"copy of a structure, before and after it is built", copy_of_an_unbuilt, "copy.source_never_built"},
    {"serialization of something unbuilt, and of what was deserialized", serialization_of_an_unbuilt, "copy.source_never_built"},
    {"update of something unbuilt", update_of_an_unbuilt, "update.source_never_built"},
    {"update without ALLOW_UPDATE", update_not_allowed, "update.not_allowed"},
    {"update", update_allowed, NULL},
    {"update on the device of what the host built", update_on_the_device, "update.not_allowed"},
    {"update on the host of what the device built", update_of_a_device_build, "update.not_allowed"},
    {"question about something unbuilt", question_about_an_unbuilt, "query.never_built"},
    {"question without ALLOW_COMPACTION", question_not_allowed, "compaction.query_not_allowed"},
    {"compaction into a byte too little", compaction_too_small, "compaction.target_too_small"},
    {"compaction", compaction_fits, NULL},
    {"deferred", deferred, "build.order.blas_never_built"},
    {"deferred, one after the other", deferred_in_order, NULL},
    {"read before the operation is over", deferred_too_early, "copy.source_never_built"},
    {"deferred, and failed", deferred_and_failed, "copy.source_never_built"},
    {"deferred, and left", deferred_and_left, NULL},
    {"triangles", triangles, NULL},
    {"index above maxVertex", index_above, "inputs.index_beyond_max_vertex"},
    {"NaN in a vertex", vertex_nan, "inputs.nan"},
    {"singular transform", transform_singular, "inputs.transform_singular"},
    {"boxes", boxes, NULL},
    {"inverted box", box_inverted, "inputs.aabb_inverted"},
};

/* Exactly one finding, of the row's rule. */
static void every_row(void **state)
{
    int failures = 0;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        unsigned long long all = 0, expected = 0;
        for (int only = 0; only < 2; only++) { /* every rule, then the row's alone */
            assert_int_equal(set_up(state), 0);
            struct fixture *fixture = *state;
            for (size_t r = 0; only && r < gn_rules_count(); r++)
                gn_rule_set_put(&fixture->instance.settings.rules, r, rows[i].rule && gn_rule_matches(gn_rules_at(r), rows[i].rule));
            if (only && !rows[i].rule) {
                tear_down(state);
                continue;
            }
            rows[i].run(fixture);
            *(only ? &expected : &all) = fixture->instance.findings;
            tear_down(state);
        }
        if (all != (rows[i].rule != NULL) || expected != all) {
            print_error("%s: expected %d finding of %s, found %llu, and %llu in all\n", rows[i].name, rows[i].rule != NULL,
                        rows[i].rule ? rows[i].rule : "any rule", expected, all);
            failures++;
        }
    }
    assert_int_equal(failures, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_row)};
    return cmocka_run_group_tests_name("host", tests, NULL, NULL);
}
