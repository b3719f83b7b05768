/* SPDX-License-Identifier: Apache-2.0 */
/* Rules about the order in which acceleration structures are built and used. */
#include "checks/rules/rules.h"

extern const struct gn_rule gn_rule_tlas_blas_never_built, gn_rule_tlas_blas_same_call;

static bool lacks_build(const struct gn_structure *blas)
{
    if (blas->destroyed || blas->is_top)
        return false; /* the references themselves are wrong, which other rules say */
    return blas->built == GN_BUILT_NEVER || blas->built == GN_BUILT_LATER;
}

static void tlas_blas_never_built(const struct gn_tlas_build *build, struct gn_report *report)
{
    /* A TLAS has many instances of few BLASes, and nearly always all of them are built. */
    uint32_t first = 0;
    while (first < build->structure_count && !lacks_build(&build->structures[first]))
        first++;
    if (first == build->structure_count)
        return;
    for (uint32_t i = 0; i < build->instance_count; i++) {
        uint32_t index = build->refers_to[i];
        if (index >= build->structure_count)
            continue;
        const struct gn_structure *blas = &build->structures[index];
        if (!lacks_build(blas))
            continue;
        uint64_t site = gn_report_site(report, build->tlas_id, blas->id);
        if (!gn_report_is_new(report, site))
            continue;
        char tlas_text[256], blas_text[256];
        struct gn_object objects[] = {build->tlas, blas->object};
        gn_report_add(report, site, objects, 2,
                      "instance %u of %u of %s refers to %s at address 0x%llx, which was created but not built %s. "
                      "Found in %s.",
                      i, build->instance_count, gn_object_describe(&build->tlas, tlas_text, sizeof tlas_text),
                      gn_object_describe(&blas->object, blas_text, sizeof blas_text),
                      (unsigned long long)blas->address,
                      blas->built == GN_BUILT_LATER ? "by then: its first build was submitted only after this one"
                                                    : "by anything submitted so far",
                      build->place ? build->place : "a build of the TLAS");
    }
}

const struct gn_rule gn_rule_tlas_blas_never_built = {
    .id = "build.order.blas_never_built",
    .title = "TLAS built from a BLAS that was never built",
    .text = "When a TLAS is built, every BLAS that its instances refer to has been built by then, in the order of "
            "execution: by a build, a copy or compaction into it, a deserialization, an indirect or a host build. A reference of "
            "0 is an inactive instance.",
    .remedy = "Build the BLAS (or copy a built one into it) in an earlier command, with a barrier from its build to the "
              "TLAS build, or set the instance's accelerationStructureReference to 0 until it is built.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-06707",
                "VUID-vkBuildAccelerationStructuresKHR-pInfos-03779", "WG-015", "WG-021", "WR-025", "DE-024", "HG-017", "HG-020"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_TLAS_BUILD,
    .test.tlas_build = tlas_blas_never_built,
};

static void tlas_blas_same_call(const struct gn_tlas_build *build, struct gn_report *report)
{
    for (uint32_t s = 0; s < build->structure_count; s++) {
        const struct gn_structure *blas = &build->structures[s];
        if (!blas->same_call || blas->destroyed)
            continue;
        uint64_t site = gn_report_site(report, build->tlas_id, blas->id);
        if (!gn_report_is_new(report, site))
            continue;
        uint32_t i = 0;
        while (i < build->instance_count && build->refers_to[i] != s)
            i++;
        char tlas_text[256], blas_text[256];
        struct gn_object objects[] = {build->tlas, blas->object};
        gn_report_add(report, site, objects, 2,
                      "instance %u of %u of %s refers to %s, which is built by another element of the same pInfos: nothing orders "
                      "the two builds. Found in %s.",
                      i, build->instance_count, gn_object_describe(&build->tlas, tlas_text, sizeof tlas_text),
                      gn_object_describe(&blas->object, blas_text, sizeof blas_text),
                      build->place ? build->place : "a build of the TLAS");
    }
}

const struct gn_rule gn_rule_tlas_blas_same_call = {
    .id = "build.order.same_call",
    .title = "TLAS built in one command with a BLAS that it refers to",
    .text = "The builds of one command run in any order, also at once. A BLAS that a TLAS refers to is therefore built in a command "
            "before that of the TLAS. (wgpu takes both in one call and puts them in order itself.)",
    .remedy = "Build the BLASes in a command of their own, then a barrier from ACCELERATION_STRUCTURE_WRITE to "
              "ACCELERATION_STRUCTURE_READ in the ACCELERATION_STRUCTURE_BUILD stage, then the TLAS.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-None-03407", "WG-015", "WG-016", "WR-025"},
    .severity = {[GN_PROFILE_VULKAN] = GN_SEVERITY_ERROR,
                 [GN_PROFILE_WGPU] = GN_SEVERITY_SILENT,
                 [GN_PROFILE_WEBGPU_RT] = GN_SEVERITY_ERROR,
                 [GN_PROFILE_DILIGENT] = GN_SEVERITY_ERROR,
                 [GN_PROFILE_HGI] = GN_SEVERITY_ERROR},
    .on = GN_RULE_ON_TLAS_BUILD,
    .test.tlas_build = tlas_blas_same_call,
};
