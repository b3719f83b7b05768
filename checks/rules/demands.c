/* SPDX-License-Identifier: Apache-2.0 */
/* Rules about numbers that the API bounds: alignment, limits, usage of buffers, and the sizes that a build needs. */
#include <stdio.h>

#include "checks/rules/rules.h"

extern const struct gn_rule gn_rule_input_misaligned, gn_rule_input_limit, gn_rule_input_buffer_usage,
    gn_rule_build_structure_too_small, gn_rule_build_scratch_too_small;

/* Starts a finding if the demand is of that kind: one site per rule, target, element and member. */
static bool begin(const struct gn_demand *demand, struct gn_report *report, enum gn_demand_kind kind, uint64_t *out_site)
{
    if (demand->kind != kind)
        return false;
    uint64_t place = (uint64_t)demand->info << 32 | demand->geometry;
    for (const char *c = demand->what; *c; c++)
        place = place * 31 + (unsigned char)*c;
    *out_site = gn_report_site(report, demand->target_id, place);
    return gn_report_is_new(report, *out_site);
}

/* `instances.data of pInfos[0].pGeometries[1], for TLAS "scene" (0x12)` */
static const char *subject(const struct gn_demand *demand, char *out, size_t size)
{
    char target[256], element[64] = "";
    if (demand->info != GN_NO_INDEX && demand->geometry != GN_NO_INDEX)
        snprintf(element, sizeof element, " of pInfos[%u].pGeometries[%u]", demand->info, demand->geometry);
    else if (demand->info != GN_NO_INDEX)
        snprintf(element, sizeof element, " of pInfos[%u]", demand->info);
    snprintf(out, size, "%s%s, for %s,", demand->what, element, gn_object_describe(&demand->target, target, sizeof target));
    return out;
}

static const char *place_of(const struct gn_demand *demand)
{
    return demand->place ? demand->place : "a command";
}

static void misaligned(const struct gn_demand *demand, struct gn_report *report)
{
    uint64_t site;
    char text[512];
    if (begin(demand, report, GN_DEMAND_ALIGNMENT, &site))
        gn_report_add(report, site, &demand->target, 1, "%s is 0x%llx (%llu), which is no multiple of %llu%s%s. Found in %s.",
                      subject(demand, text, sizeof text), (unsigned long long)demand->value, (unsigned long long)demand->value,
                      (unsigned long long)demand->bound, demand->needs ? ", " : "", demand->needs ? demand->needs : "",
                      place_of(demand));
}

const struct gn_rule gn_rule_input_misaligned = {
    .id = "inputs.misaligned",
    .title = "Misaligned address, offset or stride of a build",
    .text = "Indices are aligned to their size, vertices and their stride to a component of the format, transforms and instances to 16 "
            "bytes, boxes, their stride and pointers to instances to 8, and scratch memory to minAccelerationStructureScratchOffsetAlignment; "
            "primitiveOffset and transformOffset keep these alignments.",
    .remedy = "Allocate with the alignment that is named, and round offsets up to it.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03710", "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03711",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03712", "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03714",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03715", "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03716",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03810",
                "VUID-VkAccelerationStructureGeometryTrianglesDataKHR-vertexStride-03735",
                "VUID-VkAccelerationStructureGeometryAabbsDataKHR-stride-03545",
                "VUID-VkAccelerationStructureBuildRangeInfoKHR-primitiveOffset-03656",
                "VUID-VkAccelerationStructureBuildRangeInfoKHR-primitiveOffset-03657",
                "VUID-VkAccelerationStructureBuildRangeInfoKHR-transformOffset-03658",
                "VUID-VkAccelerationStructureBuildRangeInfoKHR-primitiveOffset-03659",
                "VUID-VkAccelerationStructureBuildRangeInfoKHR-primitiveOffset-03660", "WR-064", "WR-071"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_DEMAND,
    .test.demand = misaligned,
};

static void limit(const struct gn_demand *demand, struct gn_report *report)
{
    uint64_t site;
    char text[512];
    if (begin(demand, report, GN_DEMAND_LIMIT, &site))
        gn_report_add(report, site, &demand->target, 1, "%s is %llu, more than %s, which is %llu. Found in %s.",
                      subject(demand, text, sizeof text), (unsigned long long)demand->value, demand->needs ? demand->needs : "the limit",
                      (unsigned long long)demand->bound, place_of(demand));
}

const struct gn_rule gn_rule_input_limit = {
    .id = "inputs.limit",
    .title = "Build beyond a limit",
    .text = "A BLAS has at most maxGeometryCount geometries and maxPrimitiveCount triangles or boxes in all, a TLAS at most maxInstanceCount "
            "instances, and strides are below 2^32.",
    .remedy = "Split the structure, or check the count that is named against the limits of the device.",
    .sources = {"VUID-VkAccelerationStructureBuildGeometryInfoKHR-type-03793",
                "VUID-VkAccelerationStructureBuildGeometryInfoKHR-type-03794",
                "VUID-VkAccelerationStructureBuildGeometryInfoKHR-type-03795",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03801",
                "VUID-VkAccelerationStructureGeometryTrianglesDataKHR-vertexStride-03819",
                "VUID-VkAccelerationStructureGeometryAabbsDataKHR-stride-03820"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_DEMAND,
    .test.demand = limit,
};

static void buffer_usage(const struct gn_demand *demand, struct gn_report *report)
{
    uint64_t site;
    char text[512], buffer[256];
    if (!begin(demand, report, GN_DEMAND_USAGE, &site))
        return;
    struct gn_object objects[] = {demand->target, demand->buffer};
    gn_report_add(report, site, objects, 2, "%s at address 0x%llx lies in %s, which was created without %s. Found in %s.",
                  subject(demand, text, sizeof text), (unsigned long long)demand->value,
                  gn_object_describe(&demand->buffer, buffer, sizeof buffer), demand->needs ? demand->needs : "the usage",
                  place_of(demand));
}

const struct gn_rule gn_rule_input_buffer_usage = {
    .id = "inputs.buffer_usage",
    .title = "Buffer without the usage that a build needs",
    .text = "What a build reads lies in buffers with build-input usage, and its scratch memory in a buffer with storage usage.",
    .remedy = "Create the buffer with the usage flag that is named as well.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-geometry-03673", "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03674", "DE-025", "DE-026", "HG-016", "HG-030", "HG-033"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_DEMAND,
    .test.demand = buffer_usage,
};

static void structure_too_small(const struct gn_demand *demand, struct gn_report *report)
{
    uint64_t site;
    char target[256];
    if (begin(demand, report, GN_DEMAND_STORAGE, &site))
        gn_report_add(report, site, &demand->target, 1,
                      "pInfos[%u] builds %s, which was created with %llu bytes, but for these geometries and counts "
                      "vkGetAccelerationStructureBuildSizesKHR asks for %llu. Found in %s.",
                      demand->info, gn_object_describe(&demand->target, target, sizeof target), (unsigned long long)demand->value,
                      (unsigned long long)demand->bound, place_of(demand));
}

const struct gn_rule gn_rule_build_structure_too_small = {
    .id = "build.structure_too_small",
    .title = "Structure smaller than its build needs",
    .text = "A structure is created with at least the size that vkGetAccelerationStructureBuildSizesKHR gives for what is built into it.",
    .remedy = "Ask for the sizes with the flags, geometries and counts of the build itself (formats, maxVertex and transforms included), or "
              "with counts that no build exceeds.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-10126", "DE-020", "DE-029", "HG-031"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_DEMAND,
    .test.demand = structure_too_small,
};

static void scratch_too_small(const struct gn_demand *demand, struct gn_report *report)
{
    uint64_t site;
    char target[256];
    if (begin(demand, report, GN_DEMAND_SCRATCH, &site))
        gn_report_add(report, site, &demand->target, 1,
                      "the scratch address of pInfos[%u], for %s, leaves %llu bytes to the end of its buffer, but %s for this build is %llu. "
                      "Found in %s.",
                      demand->info, gn_object_describe(&demand->target, target, sizeof target), (unsigned long long)demand->value,
                      demand->needs ? demand->needs : "what is needed", (unsigned long long)demand->bound, place_of(demand));
}

const struct gn_rule gn_rule_build_scratch_too_small = {
    .id = "build.scratch_too_small",
    .title = "Scratch memory that runs out of its buffer",
    .text = "From the scratch address on, the buffer has as many bytes as vkGetAccelerationStructureBuildSizesKHR gives for the build: "
            "buildScratchSize, or updateScratchSize for an update.",
    .remedy = "Allocate the scratch buffer for the sum of the builds that share it, plus what aligning each address costs.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03671", "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03672", "DE-027", "DE-055"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_DEMAND,
    .test.demand = scratch_too_small,
};
