/* SPDX-License-Identifier: Apache-2.0 */
/* Rules about two accesses of the same memory that nothing orders: one rule per purpose of the later one. */
#include "checks/rules/rules.h"

#include <stdio.h>

extern const struct gn_rule gn_rule_sync_instance, gn_rule_sync_trace, gn_rule_sync_trace_bound, gn_rule_sync_scratch,
    gn_rule_sync_input, gn_rule_sync_structure, gn_rule_sync_binding_table, gn_rule_build_overlap;

static const char *reason(const struct gn_hazard *hazard)
{
    switch (hazard->why) {
    case GN_HAZARD_NOT_AVAILABLE:
        return "the barriers between order the two, but do not make what the first writes available";
    case GN_HAZARD_NOT_VISIBLE:
        return "the barriers between order the two, but do not make what the first writes visible to the second";
    case GN_HAZARD_OTHER_QUEUE:
        return "they run on two queues, and no semaphore or wait of the host orders them";
    default:
        return "nothing orders the two";
    }
}

static void describe(const struct gn_hazard_access *access, char *out, size_t size)
{
    char text[256];
    if (access->object.kind == GN_OBJECT_NONE)
        snprintf(out, size, "%s them", access->what);
    else
        snprintf(out, size, "%s %s", access->what, gn_object_describe(&access->object, text, sizeof text));
}

static void judge(const struct gn_hazard *hazard, struct gn_report *report, enum gn_hazard_kind kind, bool certain)
{
    if (hazard->kind != kind || hazard->certain != certain)
        return;
    uint64_t site = gn_report_site(report, hazard->second.id ? hazard->second.id : hazard->begin,
                                   hazard->first.id ? hazard->first.id : hazard->begin);
    if (!gn_report_is_new(report, site))
        return;
    char first[320], second[320];
    struct gn_object objects[2];
    uint32_t count = 0;
    if (hazard->second.object.kind != GN_OBJECT_NONE)
        objects[count++] = hazard->second.object;
    if (hazard->first.object.kind != GN_OBJECT_NONE && hazard->first.id != hazard->second.id)
        objects[count++] = hazard->first.object;
    describe(&hazard->first, first, sizeof first);
    describe(&hazard->second, second, sizeof second);
    gn_report_add(report, site, objects, count,
                  "the addresses 0x%llx to 0x%llx: a command %s%s, and before that %s %s; %s. Missing: srcStageMask %s, srcAccessMask "
                  "%s, dstStageMask %s, dstAccessMask %s. Found in %s.",
                  (unsigned long long)hazard->begin, (unsigned long long)hazard->end, hazard->certain ? "" : "possibly ", second,
                  hazard->first_place, first, reason(hazard), hazard->first.stages, hazard->first.accesses, hazard->second.stages,
                  hazard->second.accesses, hazard->place ? hazard->place : "a command");
}

#define REMEDY                                                                                                         \
    "Record a barrier between the two with the masks above (or wider ones); between queues, wait for a semaphore that the first "    \
    "submission signals."

/* A rule about one kind of hazard; what follows the severity is the rest of its block. */
#define RULE(name, kind_of_hazard, is_certain, level, ...)                                                             \
    static void name(const struct gn_hazard *hazard, struct gn_report *report)                                         \
    {                                                                                                                  \
        judge(hazard, report, kind_of_hazard, is_certain);                                                             \
    }                                                                                                                  \
    const struct gn_rule gn_rule_sync_##name = {                                                                       \
        .severity = GN_EVERYWHERE(level), .on = GN_RULE_ON_HAZARD, .test.hazard = name, __VA_ARGS__};

RULE(instance, GN_HAZARD_INSTANCE, true, GN_SEVERITY_ERROR,
     .id = "sync.blas_to_tlas",
     .title = "No barrier between the build of a BLAS and of a TLAS with it",
     .text = "A TLAS build reads the BLASes that its instances refer to. What wrote them comes before it, and is visible to it.",
     .remedy = REMEDY,
     .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-06707", "WG-015", "WG-016", "WR-025"})

RULE(trace, GN_HAZARD_TRACE, true, GN_SEVERITY_ERROR,
     .id = "sync.tlas_to_trace",
     .title = "No barrier between the build of a TLAS and a trace through it",
     .text = "What wrote a TLAS comes before the trace through it, and is visible to it. This rule speaks where some invocation of the command "
             "certainly traces through the TLAS.",
     .remedy = REMEDY,
     .sources = {"VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06352", "VUID-RuntimeSpirv-OpTraceRayKHR-06359", "WG-017", "DE-108"})

RULE(trace_bound, GN_HAZARD_TRACE, false, GN_SEVERITY_NOTE,
     .id = "sync.tlas_to_trace_bound",
     .title = "No barrier between the build of a TLAS and a shader that may trace through it",
     .text = "The same as sync.tlas_to_trace where the shader names the TLAS, but may not trace through it in this command.",
     .remedy = REMEDY,
     .sources = {"VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06352", "VUID-RuntimeSpirv-OpTraceRayKHR-06359", "WG-017", "DE-108"})

RULE(scratch, GN_HAZARD_SCRATCH, true, GN_SEVERITY_ERROR,
     .id = "sync.scratch",
     .title = "Scratch memory used again without a barrier",
     .text = "Builds that share scratch memory, or scratch memory with anything else, come after each other.",
     .remedy = REMEDY " Or give each build scratch memory of its own.",
     .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-scratchData-03704", "VUID-vkCmdBuildAccelerationStructuresKHR-scratchData-03705"})

RULE(input, GN_HAZARD_INPUT, true, GN_SEVERITY_ERROR,
     .id = "sync.input",
     .title = "No barrier between a write and a build that reads it",
     .text = "What a build reads (vertices, indices, boxes, transforms, instances) was written before, visibly, and is not overwritten before the "
             "build is over.",
     .remedy = REMEDY,
     .sources = {"WG-016", "HG-022"})

RULE(structure, GN_HAZARD_STRUCTURE, true, GN_SEVERITY_ERROR,
     .id = "sync.structure",
     .title = "No barrier between two commands on one structure",
     .text = "A build, update, copy, compaction or question about size comes after what wrote the structure, and a write comes after what reads "
             "it. The compacted size that is asked before the build is over may be anything.",
     .remedy = REMEDY,
     .sources = {"VUID-vkCmdWriteAccelerationStructuresPropertiesKHR-pAccelerationStructures-04964",
                 "VUID-vkCmdCopyAccelerationStructureKHR-src-11633", "WG-027", "WR-025"})

RULE(binding_table, GN_HAZARD_BINDING_TABLE, true, GN_SEVERITY_ERROR,
     .id = "sync.binding_table",
     .title = "No barrier between a write of the shader binding table and a trace",
     .text = "A trace comes after what wrote its shader binding table, visibly, and before what overwrites it.",
     .remedy = REMEDY,
     .sources = {"DE-094", "DE-112"})

static void build_overlap(const struct gn_hazard *hazard, struct gn_report *report)
{
    if (hazard->kind != GN_HAZARD_OVERLAP)
        return;
    uint64_t site = gn_report_site(report, hazard->second.id ? hazard->second.id : hazard->begin,
                                   hazard->first.id ? hazard->first.id : hazard->begin);
    if (!gn_report_is_new(report, site))
        return;
    char first[320], second[320];
    struct gn_object objects[] = {hazard->first.object, hazard->second.object};
    describe(&hazard->first, first, sizeof first);
    describe(&hazard->second, second, sizeof second);
    gn_report_add(report, site, objects, hazard->first.id == hazard->second.id ? 1 : 2,
                  "the addresses 0x%llx to 0x%llx are used twice in one command: it %s, and %s. Found in %s.",
                  (unsigned long long)hazard->begin, (unsigned long long)hazard->end, first, second,
                  hazard->place ? hazard->place : "a command");
}

const struct gn_rule gn_rule_build_overlap = {
    .id = "build.overlap",
    .title = "One command uses the same memory twice",
    .text = "Within one command no memory that is written (a structure that is built or copied into, scratch memory) is used for anything "
            "else: its elements run in any order.",
    .remedy = "Give each element memory of its own (mind the size of scratch memory), or put them into two commands with a barrier between.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-dstAccelerationStructure-03702",
                "VUID-vkCmdBuildAccelerationStructuresKHR-dstAccelerationStructure-03703",
                "VUID-vkCmdBuildAccelerationStructuresKHR-scratchData-03704",
                "VUID-vkCmdBuildAccelerationStructuresKHR-scratchData-03705", "VUID-VkCopyAccelerationStructureInfoKHR-dst-07791"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_HAZARD,
    .test.hazard = build_overlap,
};
