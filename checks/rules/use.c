/* SPDX-License-Identifier: Apache-2.0 */
/* Rules about the TLAS that a trace, dispatch or draw reads. What a shader may read is not what it has read: an error needs a command
 * of which some invocation certainly traces through the TLAS. */
#include "checks/rules/rules.h"

#include <stdio.h>

extern const struct gn_rule gn_rule_use_never_built, gn_rule_use_never_built_bound, gn_rule_use_blas_destroyed,
    gn_rule_use_blas_destroyed_bound, gn_rule_use_blas_rebuilt;

/* A note, but an error by the clauses of wgpu. */
#define NOTE_BUT_IN_WGPU                                                                                               \
    {                                                                                                                  \
        [GN_PROFILE_VULKAN] = GN_SEVERITY_NOTE, [GN_PROFILE_WGPU] = GN_SEVERITY_ERROR,                                 \
        [GN_PROFILE_WEBGPU_RT] = GN_SEVERITY_NOTE, [GN_PROFILE_DILIGENT] = GN_SEVERITY_NOTE,                           \
        [GN_PROFILE_HGI] = GN_SEVERITY_NOTE                                                                            \
    }

static void add(const struct gn_trouble *use, struct gn_report *report, const char *what)
{
    uint64_t site = gn_report_site(report, use->tlas_id, use->blas_id);
    if (!gn_report_is_new(report, site))
        return;
    char tlas[256];
    struct gn_object objects[] = {use->tlas, use->blas};
    gn_report_add(report, site, objects, use->blas.kind == GN_OBJECT_NONE ? 1 : 2, "%s %s %s. Found in %s.",
                  gn_object_describe(&use->tlas, tlas, sizeof tlas), use->certain ? "is traced through, but" : "is bound for tracing, but",
                  what, use->place ? use->place : "a command");
}

static void judge_never_built(const struct gn_trouble *use, struct gn_report *report, bool certain)
{
    if (use->kind == GN_TROUBLE_NEVER_BUILT && use->certain == certain)
        add(use, report, "nothing submitted before has built it");
}

static void never_built(const struct gn_trouble *use, struct gn_report *report)
{
    judge_never_built(use, report, true);
}

static void never_built_bound(const struct gn_trouble *use, struct gn_report *report)
{
    judge_never_built(use, report, false);
}

const struct gn_rule gn_rule_use_never_built = {
    .id = "use.tlas_never_built",
    .title = "Rays traced through a TLAS that was never built",
    .text = "A TLAS that a shader traces rays through was built before, in the order of execution. This rule speaks where some invocation "
            "of the command certainly traces through it.",
    .remedy = "Submit the TLAS build before the trace, with a barrier between them.",
    .sources = {"VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06352", "VUID-RuntimeSpirv-OpTraceRayKHR-06359", "WG-017", "DE-038", "HG-014"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_USE,
    .test.use = never_built,
};

const struct gn_rule gn_rule_use_never_built_bound = {
    .id = "use.tlas_never_built_bound",
    .title = "A TLAS that was never built is bound to a shader that may trace through it",
    .text = "The same as use.tlas_never_built where the shader names the TLAS, but may not trace through it in this command.",
    .remedy = "Build the TLAS first, or make sure that the shader does not reach the trace.",
    .sources = {"VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06352", "VUID-RuntimeSpirv-OpTraceRayKHR-06359", "WG-017"},
    .severity = NOTE_BUT_IN_WGPU,
    .on = GN_RULE_ON_USE,
    .test.use = never_built_bound,
};

static void judge_destroyed(const struct gn_trouble *use, struct gn_report *report, bool certain)
{
    char what[1024], blas[256];
    if ((use->kind != GN_TROUBLE_DESTROYED && use->kind != GN_TROUBLE_STORAGE_GONE) || use->certain != certain)
        return;
    snprintf(what, sizeof what, "%llu of the %llu BLASes that it was last built from %s since, %s first%s%s",
             (unsigned long long)use->count, (unsigned long long)use->total,
             use->kind == GN_TROUBLE_DESTROYED ? "were destroyed" : "have lost their buffer or memory",
             gn_object_describe(&use->blas, blas, sizeof blas), use->moved_to ? ", which was copied before into " : "",
             use->moved_to ? use->moved_to : "");
    add(use, report, what);
}

static void blas_destroyed(const struct gn_trouble *use, struct gn_report *report)
{
    judge_destroyed(use, report, true);
}

static void blas_destroyed_bound(const struct gn_trouble *use, struct gn_report *report)
{
    judge_destroyed(use, report, false);
}

const struct gn_rule gn_rule_use_blas_destroyed = {
    .id = "use.blas_destroyed",
    .title = "Rays traced through a TLAS whose BLAS is gone",
    .text = "A BLAS, its buffer and its memory stay as long as rays are traced through a TLAS that was last built from it. This rule "
            "speaks where some invocation of the command certainly traces through the TLAS.",
    .remedy = "Build the TLAS again without the BLAS, or with the address of the copy that replaces it (after compaction), before the old one "
              "is destroyed; keep the old one until the last trace through the old TLAS has completed.",
    .sources = {"Vulkan: Top Level Acceleration Structures", "WG-018", "WG-020", "WG-040"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_USE,
    .test.use = blas_destroyed,
};

const struct gn_rule gn_rule_use_blas_destroyed_bound = {
    .id = "use.blas_destroyed_bound",
    .title = "A TLAS whose BLAS is gone is bound to a shader that may trace through it",
    .text = "The same as use.blas_destroyed where the shader names the TLAS, but may not trace through it in this command.",
    .remedy = "Build the TLAS again without the BLAS that is gone, or make sure that the shader does not reach the trace.",
    .sources = {"Vulkan: Top Level Acceleration Structures", "WG-018", "WG-020"},
    .severity = NOTE_BUT_IN_WGPU,
    .on = GN_RULE_ON_USE,
    .test.use = blas_destroyed_bound,
};

static void blas_rebuilt(const struct gn_trouble *use, struct gn_report *report)
{
    char what[1024], blas[256];
    if (use->kind != GN_TROUBLE_REBUILT)
        return;
    snprintf(what, sizeof what, "%llu times one of the %llu BLASes that it was last built from was written since, %s first",
             (unsigned long long)use->count, (unsigned long long)use->total,
             gn_object_describe(&use->blas, blas, sizeof blas));
    add(use, report, what);
}

const struct gn_rule gn_rule_use_blas_rebuilt = {
    .id = "use.blas_rebuilt",
    .title = "A TLAS is older than one of its BLASes",
    .text = "A TLAS is built again after a BLAS in it was built or updated. In wgpu that is required before its next use. In Vulkan the new "
            "bounds of the BLAS are unknown to the old TLAS, and rays may miss what has moved.",
    .remedy = "Build or update the TLAS after its BLASes, with a barrier between them.",
    .sources = {"WG-018", "WG-019"},
    .severity = NOTE_BUT_IN_WGPU,
    .on = GN_RULE_ON_USE,
    .test.use = blas_rebuilt,
};
