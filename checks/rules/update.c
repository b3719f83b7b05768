/* SPDX-License-Identifier: Apache-2.0 */
/* Rules about updates (refits): what an update may change is little, and what it starts from has to be there. */
#include "checks/rules/command.h"

#include <stdio.h>

extern const struct gn_rule gn_rule_update_source_never_built, gn_rule_update_not_allowed, gn_rule_update_flags_changed,
    gn_rule_update_geometry_changed, gn_rule_update_count_changed;

static void update_source_never_built(const struct gn_command *command, struct gn_report *report)
{
    uint64_t site;
    if (!gn_never_built(&command->source) || !gn_command_site(command, report, &site))
        return;
    char source[256], target[256];
    struct gn_object objects[] = {command->target.structure.object, command->source.structure.object};
    gn_report_add(report, site, objects, 2, "%s is updated from %s, which nothing submitted before has built. Found in %s.",
                  gn_object_describe(&objects[0], target, sizeof target), gn_object_describe(&objects[1], source, sizeof source),
                  gn_place(command));
}

const struct gn_rule gn_rule_update_source_never_built = {
    .id = "update.source_never_built",
    .title = "Update of something that was never built",
    .text = "An update starts from a structure that was built before, in the order of execution.",
    .remedy = "Build the structure first (mode BUILD), with ALLOW_UPDATE among its flags.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03667",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-04630", "WR-030"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_COMMAND,
    .commands = GN_ABOUT(UPDATE),
    .test.command = update_source_never_built,
};

static void update_not_allowed(const struct gn_command *command, struct gn_report *report)
{
    const struct gn_shape *before = command->source.shape;
    uint64_t site;
    if (!gn_shape_known(&command->source) || (before->flags & GN_BUILD_ALLOW_UPDATE) ||
        !gn_command_site(command, report, &site))
        return;
    char source[256];
    struct gn_object objects[] = {command->source.structure.object, command->target.structure.object};
    gn_report_add(report, site, objects, 2, "%s is updated, but was built with flags 0x%x, without ALLOW_UPDATE. Found in %s.",
                  gn_object_describe(&objects[0], source, sizeof source), before->flags, gn_place(command));
}

const struct gn_rule gn_rule_update_not_allowed = {
    .id = "update.not_allowed",
    .title = "Update without ALLOW_UPDATE",
    .text = "Only a structure that was built with ALLOW_UPDATE is updated; copies of it may be updated as well.",
    .remedy = "Add VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR to the flags of the build, or build anew.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03667", "WR-031", "WR-041", "WR-042", "DE-036"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_COMMAND,
    .commands = GN_ABOUT(UPDATE),
    .test.command = update_not_allowed,
};

static void update_flags_changed(const struct gn_command *command, struct gn_report *report)
{
    const struct gn_shape *before = command->source.shape, *now = command->shape;
    uint64_t site;
    if (!gn_shape_known(&command->source) || !now || before->flags == now->flags || !gn_command_site(command, report, &site))
        return;
    char source[256];
    struct gn_object objects[] = {command->source.structure.object, command->target.structure.object};
    gn_report_add(report, site, objects, 2, "%s was built with flags 0x%x and is updated with flags 0x%x. Found in %s.",
                  gn_object_describe(&objects[0], source, sizeof source), before->flags, now->flags, gn_place(command));
}

const struct gn_rule gn_rule_update_flags_changed = {
    .id = "update.flags_changed",
    .title = "Update with other build flags",
    .text = "An update has the build flags that the structure was built with.",
    .remedy = "Give the update the flags of the build, all of them.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03759", "WR-031"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_COMMAND,
    .commands = GN_ABOUT(UPDATE),
    .test.command = update_flags_changed,
};

/* What differs first between two geometries, other than the number of primitives; NULL: nothing. */
static const char *first_difference(const struct gn_geometry *a, const struct gn_geometry *b, uint32_t *out_a, uint32_t *out_b)
{
#define COMPARE(field, name)                                                                                           \
    if (a->field != b->field) {                                                                                        \
        *out_a = a->field;                                                                                             \
        *out_b = b->field;                                                                                             \
        return name;                                                                                                   \
    }
    COMPARE(type, "geometryType")
    COMPARE(flags, "flags")
    COMPARE(vertex_format, "vertexFormat")
    COMPARE(index_type, "indexType")
    COMPARE(max_vertex, "maxVertex")
    COMPARE(has_transform, "transformData (1: given, 0: NULL)")
#undef COMPARE
    return NULL;
}

static void update_geometry_changed(const struct gn_command *command, struct gn_report *report)
{
    const struct gn_shape *before = command->source.shape, *now = command->shape;
    uint64_t site;
    if (!gn_shape_known(&command->source) || !now)
        return;
    const char *what = NULL;
    uint32_t value = 0, other = 0, g = 0;
    if (before->is_top != now->is_top) {
        what = "type";
        value = before->is_top;
        other = now->is_top;
    }
    for (; !what && g < before->geometry_count && g < now->geometry_count; g++)
        what = first_difference(&before->geometries[g], &now->geometries[g], &value, &other);
    if (!what || !gn_command_site(command, report, &site))
        return;
    char source[256];
    struct gn_object objects[] = {command->source.structure.object, command->target.structure.object};
    gn_report_add(report, site, objects, 2, "%s is updated with another %s of geometry %u than it was built with: %u, was %u. Found in %s.",
                  gn_object_describe(&objects[0], source, sizeof source), what, g ? g - 1 : 0, other, value, gn_place(command));
}

const struct gn_rule gn_rule_update_geometry_changed = {
    .id = "update.geometry_changed",
    .title = "Update with geometry of another kind",
    .text = "An update keeps the type of the structure and, of each geometry, the type, the flags (opacity among them), the vertex "
            "format, the index type, maxVertex, and whether there is a transform.",
    .remedy = "Change only positions, transforms and addresses in an update; build anew for anything else.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03760",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03761",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03762",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03763",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03764",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03765",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03766",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03767", "WR-031"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_COMMAND,
    .commands = GN_ABOUT(UPDATE),
    .test.command = update_geometry_changed,
};

static void update_count_changed(const struct gn_command *command, struct gn_report *report)
{
    const struct gn_shape *before = command->source.shape, *now = command->shape;
    uint64_t site;
    char what[128];
    if (!gn_shape_known(&command->source) || !now)
        return;
    uint32_t g = 0;
    if (before->geometry_count != now->geometry_count) {
        snprintf(what, sizeof what, "%u geometries, and was built with %u", now->geometry_count, before->geometry_count);
    } else {
        if (!before->counts_known || !now->counts_known)
            return;
        while (g < now->geometry_count && before->geometries[g].primitive_count == now->geometries[g].primitive_count)
            g++;
        if (g == now->geometry_count)
            return;
        snprintf(what, sizeof what, "%u primitives in geometry %u, and was built with %u", now->geometries[g].primitive_count, g,
                 before->geometries[g].primitive_count);
    }
    if (!gn_command_site(command, report, &site))
        return;
    char source[256];
    struct gn_object objects[] = {command->source.structure.object, command->target.structure.object};
    gn_report_add(report, site, objects, 2, "%s is updated with %s. Found in %s.",
                  gn_object_describe(&objects[0], source, sizeof source), what, gn_place(command));
}

const struct gn_rule gn_rule_update_count_changed = {
    .id = "update.count_changed",
    .title = "Update with another number of geometries or primitives",
    .text = "An update has as many geometries as the build, and as many primitives in each.",
    .remedy = "Build anew when something is added or removed. Primitives that come and go can be inactive instead, if they are so in "
              "the build and in every update.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03758",
                "VUID-vkCmdBuildAccelerationStructuresKHR-primitiveCount-03769", "WR-031"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_COMMAND,
    .commands = GN_ABOUT(UPDATE),
    .test.command = update_count_changed,
};
