/* SPDX-License-Identifier: Apache-2.0 */
/* Rules about shader binding tables: where their regions lie, and what the records hold when a trace runs. Which record of a region a ray
 * reaches is mostly the shader's choice, so that a single odd record there proves nothing. */
#include <stdarg.h>
#include <stdio.h>

#include "checks/rules/rules.h"

extern const struct gn_rule gn_rule_sbt_misaligned, gn_rule_sbt_limit, gn_rule_sbt_buffer_usage, gn_rule_sbt_beyond_buffer,
    gn_rule_sbt_raygen_size, gn_rule_sbt_raygen_handle, gn_rule_sbt_region_unusable, gn_rule_sbt_null_group, gn_rule_sbt_hit_beyond_table,
    gn_rule_pipeline_recursion_depth;

static bool begin_demand(const struct gn_demand *demand, struct gn_report *report, enum gn_demand_kind kind, uint64_t *out_site)
{
    if (demand->kind != kind)
        return false;
    uint64_t what = 0;
    for (const char *c = demand->what; *c; c++)
        what = what * 31 + (unsigned char)*c;
    *out_site = gn_report_site(report, demand->target_id, what);
    return gn_report_is_new(report, *out_site);
}

/* Says it of the pipeline, and of the buffer if there is one. */
__attribute__((format(printf, 4, 5))) static void tell(const struct gn_demand *demand, struct gn_report *report, enum gn_demand_kind kind,
                                                       const char *format, ...)
{
    uint64_t site;
    char text[1024], pipeline[256];
    va_list values;
    if (!begin_demand(demand, report, kind, &site))
        return;
    struct gn_object objects[] = {demand->target, demand->buffer};
    va_start(values, format);
    vsnprintf(text, sizeof text, format, values);
    va_end(values);
    gn_report_add(report, site, objects, demand->buffer.kind == GN_OBJECT_NONE || kind != GN_DEMAND_SBT_USAGE ? 1 : 2,
                  "%s, in a trace with %s. Found in %s.", text, gn_object_describe(&demand->target, pipeline, sizeof pipeline),
                  demand->place ? demand->place : "a trace");
}

/* A warning, but an error by the clauses of Diligent. */
#define WARNING_BUT_IN_DILIGENT                                                                                        \
    {                                                                                                                  \
        [GN_PROFILE_VULKAN] = GN_SEVERITY_WARNING, [GN_PROFILE_WGPU] = GN_SEVERITY_WARNING,                            \
        [GN_PROFILE_WEBGPU_RT] = GN_SEVERITY_WARNING, [GN_PROFILE_DILIGENT] = GN_SEVERITY_ERROR,                       \
        [GN_PROFILE_HGI] = GN_SEVERITY_WARNING                                                                         \
    }

static void misaligned(const struct gn_demand *demand, struct gn_report *report)
{
    tell(demand, report, GN_DEMAND_SBT_ALIGNMENT, "%s is 0x%llx (%llu), which is no multiple of %s (%llu)", demand->what,
         (unsigned long long)demand->value, (unsigned long long)demand->value, demand->needs ? demand->needs : "the alignment",
         (unsigned long long)demand->bound);
}

const struct gn_rule gn_rule_sbt_misaligned = {
    .id = "sbt.misaligned",
    .title = "Misaligned shader binding table",
    .text = "Every region of a shader binding table begins at a multiple of shaderGroupBaseAlignment, and its stride is a multiple of "
            "shaderGroupHandleAlignment.",
    .remedy = "Round the start of each region up to shaderGroupBaseAlignment, and the size of a record to shaderGroupHandleAlignment.",
    .sources = {"VUID-vkCmdTraceRaysKHR-pRayGenShaderBindingTable-03682", "VUID-vkCmdTraceRaysKHR-pMissShaderBindingTable-03685",
                "VUID-vkCmdTraceRaysKHR-pHitShaderBindingTable-03689", "VUID-vkCmdTraceRaysKHR-pCallableShaderBindingTable-03693",
                "VUID-vkCmdTraceRaysKHR-stride-03686", "VUID-vkCmdTraceRaysKHR-stride-03690", "VUID-vkCmdTraceRaysKHR-stride-03694"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_DEMAND,
    .test.demand = misaligned,
};

static void limit(const struct gn_demand *demand, struct gn_report *report)
{
    tell(demand, report, GN_DEMAND_SBT_LIMIT, "%s is %llu, more than %s, which is %llu", demand->what, (unsigned long long)demand->value,
         demand->needs ? demand->needs : "the limit", (unsigned long long)demand->bound);
}

const struct gn_rule gn_rule_sbt_limit = {
    .id = "sbt.limit",
    .title = "Trace beyond a limit",
    .text = "The stride of a region is at most maxShaderGroupStride, and width * height * depth at most maxRayDispatchInvocationCount.",
    .remedy = "Keep what a record holds behind its handle small, and split a large trace.",
    .sources = {"VUID-vkCmdTraceRaysKHR-stride-04029", "VUID-vkCmdTraceRaysKHR-stride-04035", "VUID-vkCmdTraceRaysKHR-stride-04041",
                "VUID-vkCmdTraceRaysKHR-width-03641"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_DEMAND,
    .test.demand = limit,
};

static void buffer_usage(const struct gn_demand *demand, struct gn_report *report)
{
    char buffer[256];
    tell(demand, report, GN_DEMAND_SBT_USAGE, "%s, 0x%llx, lies in %s, which was created without %s", demand->what,
         (unsigned long long)demand->value, gn_object_describe(&demand->buffer, buffer, sizeof buffer),
         demand->needs ? demand->needs : "the usage");
}

const struct gn_rule gn_rule_sbt_buffer_usage = {
    .id = "sbt.buffer_usage",
    .title = "Shader binding table in a buffer without its usage",
    .text = "The buffers of a shader binding table have VK_BUFFER_USAGE_SHADER_BINDING_TABLE_BIT_KHR.",
    .remedy = "Create the buffer with that usage flag as well.",
    .sources = {"VUID-vkCmdTraceRaysKHR-pRayGenShaderBindingTable-03681", "VUID-vkCmdTraceRaysKHR-pMissShaderBindingTable-03684",
                "VUID-vkCmdTraceRaysKHR-pHitShaderBindingTable-03688", "VUID-vkCmdTraceRaysKHR-pCallableShaderBindingTable-03692", "HG-032", "HG-033"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_DEMAND,
    .test.demand = buffer_usage,
};

static void beyond_buffer(const struct gn_demand *demand, struct gn_report *report)
{
    tell(demand, report, GN_DEMAND_SBT_RANGE, "%s is %llu bytes, but only %llu follow its address in the buffer", demand->what,
         (unsigned long long)demand->bound, (unsigned long long)demand->value);
}

const struct gn_rule gn_rule_sbt_beyond_buffer = {
    .id = "sbt.beyond_buffer",
    .title = "Region that runs out of its buffer",
    .text = "Every region of a shader binding table, of the size that is given, lies within its buffer.",
    .remedy = "Check the size of the region and its place in the buffer.",
    .sources = {"VUID-VkStridedDeviceAddressRegionKHR-size-04631", "VUID-VkStridedDeviceAddressRegionKHR-size-04632", "DE-098"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_DEMAND,
    .test.demand = beyond_buffer,
};

static void raygen_size(const struct gn_demand *demand, struct gn_report *report)
{
    tell(demand, report, GN_DEMAND_SBT_RAYGEN, "%s is %llu, but the stride is %llu", demand->what, (unsigned long long)demand->value,
         (unsigned long long)demand->bound);
}

const struct gn_rule gn_rule_sbt_raygen_size = {
    .id = "sbt.raygen_size",
    .title = "Region of the ray-generation shader with more or less than one record",
    .text = "The region of the ray-generation shader is one record: its size is its stride.",
    .remedy = "Give the address of the record that is to run, and its stride for both numbers.",
    .sources = {"VUID-vkCmdTraceRaysKHR-size-04023"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_DEMAND,
    .test.demand = raygen_size,
};

static void recursion_depth(const struct gn_demand *demand, struct gn_report *report)
{
    uint64_t site;
    char pipeline[256];
    if (begin_demand(demand, report, GN_DEMAND_RECURSION, &site))
        gn_report_add(report, site, &demand->target, 1, "%s was created with %s %llu, but maxRayRecursionDepth is %llu. Found in %s.",
                      gn_object_describe(&demand->target, pipeline, sizeof pipeline), demand->what, (unsigned long long)demand->value,
                      (unsigned long long)demand->bound, demand->place ? demand->place : "its creation");
}

const struct gn_rule gn_rule_pipeline_recursion_depth = {
    .id = "pipeline.recursion_depth",
    .title = "Deeper recursion than the device has",
    .text = "maxPipelineRayRecursionDepth of a ray-tracing pipeline is at most maxRayRecursionDepth of the device, which may be 1.",
    .remedy = "Trace secondary rays in a loop of the ray-generation shader.",
    .sources = {"VUID-VkRayTracingPipelineCreateInfoKHR-maxPipelineRayRecursionDepth-03589", "DE-122"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_DEMAND,
    .test.demand = recursion_depth,
};

static const char *const part_names[] = {"ray-generation", "miss", "hit", "callable"};

static bool begin(const struct gn_sbt *sbt, struct gn_report *report, uint64_t part, uint64_t *out_site)
{
    *out_site = gn_report_site(report, sbt->pipeline_id, part);
    return gn_report_is_new(report, *out_site);
}

/* "is the handle of a miss group" and the like, for the first record of that kind. */
static const char *found(const struct gn_sbt *sbt, const struct gn_sbt_region *region, enum gn_sbt_handle handle, char *out, size_t size)
{
    char other[256];
    (void)sbt;
    switch (handle) {
    case GN_HANDLE_NULL: snprintf(out, size, "is all zero"); break;
    case GN_HANDLE_UNFIT: snprintf(out, size, "belongs to a group of %s", region->unfit ? region->unfit : "another type"); break;
    case GN_HANDLE_FOREIGN:
        snprintf(out, size, "belongs to %s%s", gn_object_describe(&region->foreign, other, sizeof other),
                 region->foreign_gone ? ", which was destroyed" : "");
        break;
    default: snprintf(out, size, "was given by no pipeline"); break;
    }
    return out;
}

static void raygen_handle(const struct gn_sbt *sbt, struct gn_report *report)
{
    const struct gn_sbt_region *region = &sbt->regions[GN_SBT_RAYGEN];
    uint64_t site;
    int kind = GN_HANDLE_NULL;
    if (!sbt->runs || !sbt->handles_known || !region->read || region->count[GN_HANDLE_FITS])
        return;
    while (kind < GN_HANDLE_KINDS && !region->count[kind])
        kind++;
    if (kind == GN_HANDLE_KINDS || !begin(sbt, report, 0, &site))
        return;
    char pipeline[256], text[512];
    struct gn_object objects[] = {sbt->pipeline, region->foreign};
    gn_report_add(report, site, objects, kind == GN_HANDLE_FOREIGN ? 2 : 1,
                  "%s is bound, but the handle in the ray-generation record at 0x%llx %s. Found in %s.",
                  gn_object_describe(&sbt->pipeline, pipeline, sizeof pipeline), (unsigned long long)region->address,
                  found(sbt, region, (enum gn_sbt_handle)kind, text, sizeof text), sbt->place ? sbt->place : "a trace");
}

const struct gn_rule gn_rule_sbt_raygen_handle = {
    .id = "sbt.raygen_handle",
    .title = "Ray-generation record without a ray-generation shader of the bound pipeline",
    .text = "The record that a trace starts with holds, when it runs, the handle of a ray-generation group of the pipeline that is bound.",
    .remedy = "Write what vkGetRayTracingShaderGroupHandlesKHR gives for this very pipeline, anew for every pipeline that is created, and order "
              "the write before the trace.",
    .sources = {"Vulkan: Shader Binding Table", "DE-080", "DE-081"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_SBT,
    .test.sbt = raygen_handle,
};

static void region_unusable(const struct gn_sbt *sbt, struct gn_report *report)
{
    if (!sbt->handles_known)
        return;
    for (int part = GN_SBT_MISS; part < GN_SBT_PARTS; part++) {
        const struct gn_sbt_region *region = &sbt->regions[part];
        uint64_t site;
        if (!region->read || region->read < region->records || region->count[GN_HANDLE_FITS] || region->count[GN_HANDLE_NULL] ||
            !begin(sbt, report, (uint64_t)part, &site))
            continue;
        int kind = region->count[GN_HANDLE_FOREIGN] ? GN_HANDLE_FOREIGN : region->count[GN_HANDLE_UNFIT] ? GN_HANDLE_UNFIT : GN_HANDLE_UNKNOWN;
        char pipeline[256], text[512];
        struct gn_object objects[] = {sbt->pipeline, region->foreign};
        gn_report_add(report, site, objects, kind == GN_HANDLE_FOREIGN ? 2 : 1,
                      "none of the %llu records of the %s region at 0x%llx (stride %llu) holds a handle of such a group of %s, which is bound: "
                      "that of record %llu %s. Found in %s.",
                      (unsigned long long)region->records, part_names[part], (unsigned long long)region->address,
                      (unsigned long long)region->stride, gn_object_describe(&sbt->pipeline, pipeline, sizeof pipeline),
                      (unsigned long long)region->first[kind], found(sbt, region, (enum gn_sbt_handle)kind, text, sizeof text),
                      sbt->place ? sbt->place : "a trace");
    }
}

const struct gn_rule gn_rule_sbt_region_unusable = {
    .id = "sbt.region_unusable",
    .title = "Region without any usable record",
    .text = "A region of the shader binding table holds handles of groups of its kind of the bound pipeline, or zeros for no shader. Where not a "
            "single record does, every ray that reaches the region goes astray.",
    .remedy = "Check the address and stride of the region (the record size rounded up to the alignment), the order of groups in the pipeline, "
              "and that the handles are of this pipeline and not of one before it.",
    .sources = {"Vulkan: Shader Binding Table", "VUID-vkCmdTraceRaysKHR-pHitShaderBindingTable-04735",
                "VUID-vkCmdTraceRaysKHR-pHitShaderBindingTable-04736", "DE-080"},
    .severity = WARNING_BUT_IN_DILIGENT,
    .on = GN_RULE_ON_SBT,
    .test.sbt = region_unusable,
};

static void null_group(const struct gn_sbt *sbt, struct gn_report *report)
{
    const struct gn_sbt_region *miss = &sbt->regions[GN_SBT_MISS], *hit = &sbt->regions[GN_SBT_HIT];
    uint64_t site;
    char pipeline[256];
    const char *place = sbt->place ? sbt->place : "a trace";
    gn_object_describe(&sbt->pipeline, pipeline, sizeof pipeline);
    if (sbt->no_null_miss && miss->read && miss->count[GN_HANDLE_NULL] && miss->first[GN_HANDLE_NULL] == 0 && begin(sbt, report, 0, &site))
        gn_report_add(report, site, &sbt->pipeline, 1,
                      "%s was created with NO_NULL_MISS_SHADERS, but the first miss record, at 0x%llx, is all zero. Found in %s.", pipeline,
                      (unsigned long long)miss->address, place);
    if (sbt->no_null_hit && !hit->address && begin(sbt, report, 1, &site))
        gn_report_add(report, site, &sbt->pipeline, 1,
                      "%s was created with NO_NULL_CLOSEST_HIT_SHADERS or NO_NULL_INTERSECTION_SHADERS, but there is no hit region. Found in %s.",
                      pipeline, place);
}

const struct gn_rule gn_rule_sbt_null_group = {
    .id = "sbt.null_group",
    .title = "Null shader where the pipeline excludes it",
    .text = "A pipeline created with one of the NO_NULL flags traces with a table that has shaders there.",
    .remedy = "Leave the flag out, or write a handle to the record.",
    .sources = {"VUID-vkCmdTraceRaysKHR-flags-03511", "VUID-vkCmdTraceRaysKHR-flags-03696", "VUID-vkCmdTraceRaysKHR-flags-03697"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_SBT,
    .test.sbt = null_group,
};

static void hit_beyond_table(const struct gn_sbt *sbt, struct gn_report *report)
{
    const struct gn_sbt_region *hit = &sbt->regions[GN_SBT_HIT];
    uint64_t site;
    if (sbt->tlas.kind == GN_OBJECT_NONE || !hit->records || !hit->stride || sbt->record < hit->records)
        return;
    site = gn_report_site(report, sbt->pipeline_id, sbt->tlas_id);
    if (!gn_report_is_new(report, site))
        return;
    char pipeline[256], tlas[256];
    struct gn_object objects[] = {sbt->pipeline, sbt->tlas};
    gn_report_add(report, site, objects, 2,
                  "instance %u of %s has the shader-binding-table offset %u, and rays of %s add at least %u, and %u for each geometry: "
                  "a hit on geometry %u reads record %llu, but the hit region of this trace has %llu. Found in %s.",
                  sbt->instance, gn_object_describe(&sbt->tlas, tlas, sizeof tlas), sbt->instance_offset,
                  gn_object_describe(&sbt->pipeline, pipeline, sizeof pipeline), sbt->ray_offset, sbt->ray_stride, sbt->geometry,
                  (unsigned long long)sbt->record, (unsigned long long)hit->records, sbt->place ? sbt->place : "a trace");
}

const struct gn_rule gn_rule_sbt_hit_beyond_table = {
    .id = "sbt.hit_beyond_table",
    .title = "Instance whose hit records lie behind the table",
    .text = "The hit record of a ray is instance offset + geometry index * ray stride + ray offset, and lies in the hit region.",
    .remedy = "Write one hit record per geometry and ray type, and instance offsets that count them; or give the hit region its full "
              "size.",
    .sources = {"Vulkan: Hit Shader Addressing", "DE-097", "DE-098", "DE-100"},
    .severity = WARNING_BUT_IN_DILIGENT,
    .on = GN_RULE_ON_SBT,
    .test.sbt = hit_beyond_table,
};
