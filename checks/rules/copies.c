/* SPDX-License-Identifier: Apache-2.0 */
/* Rules about copies, compaction and questions about size. */
#include "checks/rules/command.h"

#include <stdio.h>

extern const struct gn_rule gn_rule_copy_source_never_built, gn_rule_copy_target_never_built, gn_rule_query_never_built,
    gn_rule_compaction_query_not_allowed, gn_rule_compaction_not_allowed, gn_rule_compaction_target_too_small,
    gn_rule_compaction_size_outdated, gn_rule_compaction_repeated, gn_rule_compaction_rebuilt;

/* The objects of a finding, the source first; a command that only reads has no target. */
static uint32_t objects_of(const struct gn_command *command, struct gn_object out[2])
{
    out[0] = command->source.structure.object;
    out[1] = command->target.structure.object;
    return out[1].kind == GN_OBJECT_NONE ? 1 : 2;
}

static void copy_source_never_built(const struct gn_command *command, struct gn_report *report)
{
    uint64_t site;
    if (!gn_never_built(&command->source) || !gn_command_site(command, report, &site))
        return;
    char source[256];
    struct gn_object objects[2];
    uint32_t count = objects_of(command, objects);
    gn_report_add(report, site, objects, count, "%s is copied, but nothing submitted before has built it. Found in %s.",
                  gn_object_describe(&objects[0], source, sizeof source), gn_place(command));
}

const struct gn_rule gn_rule_copy_source_never_built = {
    .id = "copy.source_never_built",
    .title = "Copy of something that was never built",
    .text = "What is cloned, compacted or serialized was built before, in the order of execution.",
    .remedy = "Submit the build before the copy, with a barrier between them.",
    .sources = {"VUID-VkCopyAccelerationStructureInfoKHR-src-04963", "VUID-vkCmdCopyAccelerationStructureKHR-src-11633", "WG-023",
                "WR-027"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_COMMAND,
    .commands = GN_ABOUT(CLONE) | GN_ABOUT(COMPACT) | GN_ABOUT(SERIALIZE),
    .test.command = copy_source_never_built,
};

static void copy_target_never_built(const struct gn_command *command, struct gn_report *report)
{
    uint64_t site;
    if (!gn_never_built(&command->target) || !gn_command_site(command, report, &site))
        return;
    char target[256];
    struct gn_object objects[2];
    uint32_t count = objects_of(command, objects);
    gn_report_add(report, site, objects, count, "%s is copied into, but was never built itself. Found in %s.",
                  gn_object_describe(&objects[1], target, sizeof target), gn_place(command));
}

const struct gn_rule gn_rule_copy_target_never_built = {
    .id = "copy.target_never_built",
    .title = "Copy into something that was never built",
    .text = "The WebGPU proposal lets a container be copied only into one that was built as well. Vulkan needs memory there, no more.",
    .remedy = "Build the target container once before copying into it.",
    .sources = {"WR-028"},
    .severity = {[GN_PROFILE_WEBGPU_RT] = GN_SEVERITY_ERROR},
    .on = GN_RULE_ON_COMMAND,
    .commands = GN_ABOUT(CLONE),
    .test.command = copy_target_never_built,
};

static void query_never_built(const struct gn_command *command, struct gn_report *report)
{
    uint64_t site;
    if (!gn_never_built(&command->source) || !gn_command_site(command, report, &site))
        return;
    char source[256];
    gn_report_add(report, site, &command->source.structure.object, 1,
                  "the size of %s is asked, but nothing submitted before has built it. Found in %s.",
                  gn_object_describe(&command->source.structure.object, source, sizeof source), gn_place(command));
}

const struct gn_rule gn_rule_query_never_built = {
    .id = "query.never_built",
    .title = "Size asked of something that was never built",
    .text = "vkCmdWriteAccelerationStructuresPropertiesKHR asks structures that were built before, in the order of execution.",
    .remedy = "Submit the build before the question, with a barrier between them.",
    .sources = {"VUID-vkCmdWriteAccelerationStructuresPropertiesKHR-pAccelerationStructures-04964", "WG-027"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_COMMAND,
    .commands = GN_ABOUT(ASK_COMPACTED_SIZE) | GN_ABOUT(ASK_OTHER),
    .test.command = query_never_built,
};

static bool compaction_forbidden(const struct gn_contents *contents)
{
    return gn_shape_known(contents) && !(contents->shape->flags & GN_BUILD_ALLOW_COMPACTION);
}

static void compaction_query_not_allowed(const struct gn_command *command, struct gn_report *report)
{
    uint64_t site;
    if (!compaction_forbidden(&command->source) || !gn_command_site(command, report, &site))
        return;
    char source[256];
    gn_report_add(report, site, &command->source.structure.object, 1,
                  "the compacted size of %s is asked, but it was built with flags 0x%x, without ALLOW_COMPACTION. Found in %s.",
                  gn_object_describe(&command->source.structure.object, source, sizeof source), command->source.shape->flags,
                  gn_place(command));
}

const struct gn_rule gn_rule_compaction_query_not_allowed = {
    .id = "compaction.query_not_allowed",
    .title = "Compacted size asked without ALLOW_COMPACTION",
    .text = "The compacted size is asked only of a structure that was built with ALLOW_COMPACTION.",
    .remedy = "Add VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR to the flags of the build.",
    .sources = {"VUID-vkCmdWriteAccelerationStructuresPropertiesKHR-accelerationStructures-03431", "WG-023"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_COMMAND,
    .commands = GN_ABOUT(ASK_COMPACTED_SIZE),
    .test.command = compaction_query_not_allowed,
};

static void compaction_not_allowed(const struct gn_command *command, struct gn_report *report)
{
    uint64_t site;
    if (!compaction_forbidden(&command->source) || !gn_command_site(command, report, &site))
        return;
    char source[256];
    struct gn_object objects[2];
    uint32_t count = objects_of(command, objects);
    gn_report_add(report, site, objects, count,
                  "%s is compacted, but was built with flags 0x%x, without ALLOW_COMPACTION. Found in %s.",
                  gn_object_describe(&objects[0], source, sizeof source), command->source.shape->flags, gn_place(command));
}

const struct gn_rule gn_rule_compaction_not_allowed = {
    .id = "compaction.not_allowed",
    .title = "Compaction without ALLOW_COMPACTION",
    .text = "Only a structure that was built with ALLOW_COMPACTION is compacted.",
    .remedy = "Add VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR to the flags of the build, or clone instead.",
    .sources = {"VUID-VkCopyAccelerationStructureInfoKHR-src-03411", "WG-023"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_COMMAND,
    .commands = GN_ABOUT(COMPACT),
    .test.command = compaction_not_allowed,
};

static void compaction_target_too_small(const struct gn_command *command, struct gn_report *report)
{
    const struct gn_contents *source = &command->source, *target = &command->target;
    uint64_t site;
    if (source->structure.object.kind == GN_OBJECT_NONE || target->structure.object.kind == GN_OBJECT_NONE ||
        !source->compacted_size || source->compacted_size_of != source->generation ||
        target->size >= source->compacted_size || !gn_command_site(command, report, &site))
        return;
    char source_text[256], target_text[256];
    struct gn_object objects[2];
    uint32_t count = objects_of(command, objects);
    gn_report_add(report, site, objects, count,
                  "%s is compacted into %s of %llu bytes, but its compacted size was reported as %llu. Found in %s.",
                  gn_object_describe(&objects[0], source_text, sizeof source_text),
                  gn_object_describe(&objects[1], target_text, sizeof target_text), (unsigned long long)target->size,
                  (unsigned long long)source->compacted_size, gn_place(command));
}

const struct gn_rule gn_rule_compaction_target_too_small = {
    .id = "compaction.target_too_small",
    .title = "Compaction into too small a structure",
    .text = "The target of a compaction has at least the size that the query of the compacted size gave for what the source holds now.",
    .remedy = "Create the target with the size that was reported for this very structure (mind the order of several queries in a pool).",
    .sources = {"VUID-VkCopyAccelerationStructureInfoKHR-mode-12419", "WG-023", "WG-024"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_COMMAND,
    .commands = GN_ABOUT(COMPACT),
    .test.command = compaction_target_too_small,
};

static void compaction_size_outdated(const struct gn_command *command, struct gn_report *report)
{
    const struct gn_contents *source = &command->source, *target = &command->target;
    uint64_t site;
    if (source->structure.object.kind == GN_OBJECT_NONE || target->structure.object.kind == GN_OBJECT_NONE ||
        !source->compacted_size || source->compacted_size_of == source->generation ||
        source->size_asked_of == source->generation || target->size >= source->size ||
        !gn_command_site(command, report, &site))
        return;
    char source_text[256], target_text[256];
    struct gn_object objects[2];
    uint32_t count = objects_of(command, objects);
    gn_report_add(report, site, objects, count,
                  "%s is compacted into %s of %llu bytes, but it was built anew after its compacted size (%llu) was asked, and not "
                  "asked again. Found in %s.",
                  gn_object_describe(&objects[0], source_text, sizeof source_text),
                  gn_object_describe(&objects[1], target_text, sizeof target_text), (unsigned long long)target->size,
                  (unsigned long long)source->compacted_size, gn_place(command));
}

const struct gn_rule gn_rule_compaction_size_outdated = {
    .id = "compaction.size_outdated",
    .title = "Compaction with the size of an earlier build",
    .text = "A reported compacted size belongs to what the structure held when it was asked. After another build the structure may need "
            "more, and must be asked again; an update in place does not change the size.",
    .remedy = "Ask the compacted size again after the build, or do not build between the question and the compaction.",
    .sources = {"VUID-VkCopyAccelerationStructureInfoKHR-mode-12419", "WG-031", "WG-032", "WG-033"},
    .severity = {[GN_PROFILE_VULKAN] = GN_SEVERITY_WARNING,
                 [GN_PROFILE_WGPU] = GN_SEVERITY_ERROR,
                 [GN_PROFILE_WEBGPU_RT] = GN_SEVERITY_WARNING,
                 [GN_PROFILE_DILIGENT] = GN_SEVERITY_WARNING,
                 [GN_PROFILE_HGI] = GN_SEVERITY_WARNING},
    .on = GN_RULE_ON_COMMAND,
    .commands = GN_ABOUT(COMPACT),
    .test.command = compaction_size_outdated,
};

static void compaction_repeated(const struct gn_command *command, struct gn_report *report)
{
    const struct gn_contents *source = &command->source;
    uint64_t site;
    if (source->structure.object.kind == GN_OBJECT_NONE || source->structure.built != GN_BUILT_BEFORE || !source->compacted ||
        !gn_command_site(command, report, &site))
        return;
    char text[256];
    struct gn_object objects[2];
    uint32_t count = objects_of(command, objects);
    gn_report_add(report, site, objects, count, "%s is compacted, but is the result of a compaction itself. Found in %s.",
                  gn_object_describe(&objects[0], text, sizeof text), gn_place(command));
}

const struct gn_rule gn_rule_compaction_repeated = {
    .id = "compaction.repeated",
    .title = "Compaction of a compacted structure",
    .text = "wgpu compacts a structure once only. Vulkan allows it again, for no gain.",
    .remedy = "Keep the compacted structure as it is.",
    .sources = {"WG-039"},
    .severity = {[GN_PROFILE_WGPU] = GN_SEVERITY_ERROR},
    .on = GN_RULE_ON_COMMAND,
    .commands = GN_ABOUT(COMPACT),
    .test.command = compaction_repeated,
};

static void compaction_rebuilt(const struct gn_command *command, struct gn_report *report)
{
    const struct gn_contents *target = &command->target;
    uint64_t site;
    if (target->structure.object.kind == GN_OBJECT_NONE || target->structure.built != GN_BUILT_BEFORE || !target->compacted ||
        !gn_command_site(command, report, &site))
        return;
    char text[256];
    gn_report_add(report, site, &target->structure.object, 1, "%s is %s, but is the result of a compaction. Found in %s.",
                  gn_object_describe(&target->structure.object, text, sizeof text),
                  command->kind == GN_COMMAND_UPDATE ? "updated" : "built again", gn_place(command));
}

const struct gn_rule gn_rule_compaction_rebuilt = {
    .id = "compaction.rebuilt",
    .title = "Build into a compacted structure",
    .text = "In wgpu the result of a compaction is final: it is neither built again nor updated. Vulkan allows both where the size "
            "suffices.",
    .remedy = "Build into the original structure, which stays usable, and compact again.",
    .sources = {"WG-038"},
    .severity = {[GN_PROFILE_WGPU] = GN_SEVERITY_ERROR},
    .on = GN_RULE_ON_COMMAND,
    .commands = GN_ABOUT(BUILD) | GN_ABOUT(UPDATE),
    .test.command = compaction_rebuilt,
};
