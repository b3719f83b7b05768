/* SPDX-License-Identifier: Apache-2.0 */
/* Rules about what an update reads. */
#include "checks/rules/rules.h"

extern const struct gn_rule gn_rule_update_indices_changed, gn_rule_update_activity_changed, gn_rule_update_many;

static void indices_changed(const struct gn_refit *refit, struct gn_report *report)
{
    char target[256];
    if (!refit->indices_changed)
        return;
    uint64_t site = gn_report_site(report, refit->target_id, refit->geometry);
    if (!gn_report_is_new(report, site))
        return;
    gn_report_add(report, site, &refit->target, 1, "%s is updated with other indices in geometry %u than it was built with. Found in %s.",
                  gn_object_describe(&refit->target, target, sizeof target), refit->geometry,
                  refit->place ? refit->place : "an update");
}

const struct gn_rule gn_rule_update_indices_changed = {
    .id = "update.indices_changed",
    .title = "Update with other indices",
    .text = "The index data of an update are those of the build that it starts from: an update moves vertices, it does not connect them "
            "anew.",
    .remedy = "Build anew when the topology changes.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03768", "WR-031"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_REFIT,
    .test.refit = indices_changed,
};

static void activity_changed(const struct gn_refit *refit, struct gn_report *report)
{
    char target[256];
    if (!refit->activity_changed)
        return;
    uint64_t site = gn_report_site(report, refit->target_id, refit->geometry);
    if (!gn_report_is_new(report, site))
        return;
    gn_report_add(report, site, &refit->target, 1,
                  "%s is updated with other active and inactive primitives in geometry %u than it was built with: %llu of "
                  "%llu are inactive, %llu were. Found in %s.",
                  gn_object_describe(&refit->target, target, sizeof target), refit->geometry, (unsigned long long)refit->inactive,
                  (unsigned long long)refit->total, (unsigned long long)refit->inactive_before,
                  refit->place ? refit->place : "an update");
}

const struct gn_rule gn_rule_update_activity_changed = {
    .id = "update.activity_changed",
    .title = "Update that makes something active or inactive",
    .text = "Primitives that are inactive in the build (the first coordinates are NaN) are inactive in each update, and active ones stay "
            "active.",
    .remedy = "Build anew when primitives come or go, or hide them by moving them away.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03663", "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03664"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_REFIT,
    .test.refit = activity_changed,
};

/* Below this, nobody would feel it. */
#define GROWTH_THAT_MATTERS 2.0

static void many(const struct gn_refit *refit, struct gn_report *report)
{
    char target[256];
    if (refit->growth < GROWTH_THAT_MATTERS)
        return;
    uint64_t site = gn_report_site(report, refit->target_id, refit->geometry);
    if (!gn_report_is_new(report, site))
        return;
    gn_report_add(report, site, &refit->target, 1,
                  "%s was updated %u times since it was built, and geometry %u has changed its form: groups of 16 neighbours of the first "
                  "update now have %.1f times the surface of groups that are made anew, so that rays enter them about that much more "
                  "often. Found in %s.",
                  gn_object_describe(&refit->target, target, sizeof target), refit->updates, refit->geometry, refit->growth,
                  refit->place ? refit->place : "an update");
}

const struct gn_rule gn_rule_update_many = {
    .id = "update.many",
    .title = "Structure that has outgrown its build",
    .text = "An update keeps the tree of the build and only fits its boxes to where the primitives are now. The further they move against each "
            "other, the more the boxes overlap, and the slower it is to trace.",
    .remedy = "Build anew now and then (every so many frames, in turns), or when the form has changed much.",
    .sources = {"Vulkan: Acceleration Structure Update Rules"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_NOTE),
    .on = GN_RULE_ON_REFIT,
    .test.refit = many,
};
