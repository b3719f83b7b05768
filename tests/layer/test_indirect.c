/* SPDX-License-Identifier: Apache-2.0 */
/* Builds whose ranges lie in device memory, which no driver here has, above the fake one. */
#include "tests/layer/fake.h"

#include <stdlib.h>
#include <string.h>

#define USAGE                                                                                                          \
    (VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT | VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR |     \
     VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT)

/* What is in the one buffer. */
struct memory {
    VkAccelerationStructureBuildRangeInfoKHR ranges[2];
    _Alignas(16) VkAccelerationStructureInstanceKHR records[3];
    float boxes[4][6];
};

struct subject {
    struct fixture *fixture;
    struct memory *memory;
    VkAccelerationStructureKHR blas, tlas;
    bool is_blas, gone; /* gone: the buffer, before its build is judged */
    uint32_t maximum, stride;
    VkBuffer buffer;
};

static void subject_build(struct subject *subject)
{
    struct fixture *fixture = subject->fixture;
    uint64_t base = (uint64_t)(uintptr_t)subject->memory;
    VkAccelerationStructureGeometryKHR geometries[2];
    for (int g = 0; g < 2; g++) {
        geometries[g] = (VkAccelerationStructureGeometryKHR){
            .geometryType = subject->is_blas ? VK_GEOMETRY_TYPE_AABBS_KHR : VK_GEOMETRY_TYPE_INSTANCES_KHR};
        if (subject->is_blas)
            geometries[g].geometry.aabbs = (VkAccelerationStructureGeometryAabbsDataKHR){
                .data.deviceAddress = base + offsetof(struct memory, boxes), .stride = 24};
        else
            geometries[g].geometry.instances.data.deviceAddress = base + offsetof(struct memory, records);
    }
    const VkAccelerationStructureGeometryKHR *pointers[] = {&geometries[0], &geometries[1]};
    VkAccelerationStructureBuildGeometryInfoKHR info = {.type = subject->is_blas ? BOTTOM : TOP,
                                                        .dstAccelerationStructure = subject->is_blas ? subject->blas : subject->tlas,
                                                        .geometryCount = subject->is_blas ? 2 : 1,
                                                        .ppGeometries = pointers};
    const uint32_t maxima[] = {subject->maximum, 2}, *all = maxima;
    gn_entry_CmdBuildAccelerationStructuresIndirectKHR(fixture->commands[0], 1, &info, &base, &subject->stride, &all);
    fence_status = subject->gone ? VK_NOT_READY : VK_SUCCESS;
    submit_one(fixture, 0, 0);
    fence_status = VK_SUCCESS;
    if (subject->gone)
        gn_entry_DestroyBuffer(fixture->handle, subject->buffer, NULL);
    gn_device_collect(fixture->device);
}

static void built_blas(struct subject *subject)
{
    on_host(subject->fixture, subject->blas, BOTTOM);
}

#define ALTER(name, ...)                                                                                               \
    static void name(struct subject *subject)                                                                          \
    {                                                                                                                  \
        struct memory *memory = subject->memory;                                                                       \
        (void)memory;                                                                                                  \
        __VA_ARGS__;                                                                                                   \
    }

ALTER(unbuilt, (void)0)
ALTER(built, built_blas(subject))
ALTER(unbuilt_beyond, memory->ranges[0].primitiveCount = 1; memory->records[0].accelerationStructureReference = 0)
ALTER(offset_to_the_last, memory->ranges[0] = (VkAccelerationStructureBuildRangeInfoKHR){.primitiveCount = 1, .primitiveOffset = 128})
ALTER(none, memory->ranges[0].primitiveCount = 0)
ALTER(above_maximum, built_blas(subject); memory->ranges[0].primitiveCount = 4)
ALTER(misaligned, built_blas(subject);
      memory->ranges[0] = (VkAccelerationStructureBuildRangeInfoKHR){.primitiveCount = 1, .primitiveOffset = 8})
ALTER(boxes, subject->is_blas = true; memory->ranges[0].primitiveCount = 2)
ALTER(boxes_beyond, subject->is_blas = true; subject->maximum = 100; memory->ranges[0].primitiveCount = 5)
ALTER(boxes_beyond_what_is_gone, boxes_beyond(subject); subject->gone = true)
ALTER(second_above_maximum, boxes(subject); memory->ranges[1].primitiveCount = 3)

static const struct row {
    const char *name;
    void (*alter)(struct subject *subject);
    const char *rule; /* NULL: nothing is found */
} rows[] = {
    {"TLAS of an unbuilt BLAS", unbuilt, "build.order.blas_never_built"},
    {"TLAS of a built one", built, NULL},
    {"the record with the reference is not read", unbuilt_beyond, NULL},
    {"the offset selects the record", offset_to_the_last, "build.order.blas_never_built"},
    {"no instances", none, NULL},
    {"more than was announced", above_maximum, "inputs.limit"},
    {"misaligned offset", misaligned, "inputs.misaligned"},
    {"boxes", boxes, NULL},
    {"boxes behind the buffer", boxes_beyond, "inputs.beyond_buffer"},
    {"boxes behind a buffer that is gone", boxes_beyond_what_is_gone, NULL},
    {"more than announced in the second geometry", second_above_maximum, "inputs.limit"},
};

static void every_row(void **state)
{
    int failures = 0;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        for (int only = 0; only < 2; only++) { /* every rule, then the row's alone */
            assert_int_equal(set_up(state), 0);
            struct fixture *fixture = *state;
            struct subject subject = {.fixture = fixture, .maximum = 3, .stride = sizeof(VkAccelerationStructureBuildRangeInfoKHR)};
            for (size_t r = 0; only && r < gn_rules_count(); r++)
                gn_rule_set_put(&fixture->instance.settings.rules, r, rows[i].rule && gn_rule_matches(gn_rules_at(r), rows[i].rule));
            fixture->instance.settings.input_cap = 0;
            subject.memory = aligned_alloc(64, (sizeof *subject.memory + 63) / 64 * 64);
            memset(subject.memory, 0, sizeof *subject.memory);
            copy_source = subject.memory;
            VkBufferCreateInfo buffer = {
                .sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, .size = sizeof *subject.memory, .usage = USAGE};
            gn_entry_CreateBuffer(fixture->handle, &buffer, NULL, &subject.buffer);
            gn_entry_BindBufferMemory(fixture->handle, subject.buffer, VK_NULL_HANDLE, 0);
            subject.blas = make(fixture, BOTTOM);
            subject.tlas = make(fixture, TOP);
            subject.memory->ranges[0].primitiveCount = 3;
            for (int r = 0; r < 3; r++)
                subject.memory->records[r] = fixture->record;
            subject.memory->records[2].accelerationStructureReference = (uint64_t)subject.blas << 8;
            rows[i].alter(&subject);
            subject_build(&subject);
            unsigned long long expected = rows[i].rule != NULL, found = fixture->instance.findings;
            if (found != expected) {
                print_error("%s: expected %llu findings of %s, found %llu\n", rows[i].name, expected,
                            rows[i].rule ? rows[i].rule : "any rule", found);
                failures++;
            }
            if (!rows[i].rule)
                assert_int_equal(checked(fixture, GN_CHECKED_tlas_builds) + unjudged(fixture, GN_UNJUDGED_unreadable_geometry) / 2, 1);
            free(subject.memory);
            tear_down(state);
        }
    assert_int_equal(failures, 0);
}

/* An address that the layer knows nothing of is named. */
static void unknown_ranges_are_said(void **state)
{
    struct fixture *fixture = *state;
    static struct memory memory;
    struct subject subject = {.fixture = fixture,
                              .memory = &memory,
                              .tlas = make(fixture, TOP),
                              .maximum = 3,
                              .stride = sizeof(VkAccelerationStructureBuildRangeInfoKHR)};
    subject_build(&subject);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_indirect_builds), 1);
    assert_int_equal(fixture->instance.findings, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_row),
                                       cmocka_unit_test_setup_teardown(unknown_ranges_are_said, set_up, tear_down)};
    return cmocka_run_group_tests_name("indirect", tests, NULL, NULL);
}
