/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What only ray tracing pipelines have: shader binding tables and their records, null records, recursion, callable
 * shaders, hit attributes, libraries, indirect traces, sizes of launches.
 */
#include <string.h>

#include "cts/sample.h"

#define SPEC_RECORD                                                                                          \
    "the record of a hit is the instance's offset + the geometry index times the trace's stride + the trace's offset " \
    "(Vulkan: Shader Binding Table, Hit Shader Binding Table)"
#define SPEC_STRIDE                                                                                          \
    "records lie a stride apart that is a multiple of shaderGroupHandleAlignment, up to maxShaderGroupStride (Vulkan: " \
    "VkStridedDeviceAddressRegionKHR; vkCmdTraceRaysKHR)"
#define SPEC_MISS "the miss record is the one whose number the trace gives (Vulkan: Miss Shader Binding Table)"
#define SPEC_NULL                                                                                            \
    "a record of zeros runs no shader, and the payload stays as it was (Vulkan: Shader Binding Table; "      \
    "vkGetRayTracingShaderGroupHandlesKHR)"
#define SPEC_DEPTH                                                                                           \
    "hit and miss shaders trace rays up to maxRayRecursionDepth levels deep, each level with its payload (Vulkan: " \
    "VkRayTracingPipelineCreateInfoKHR::maxPipelineRayRecursionDepth)"
#define SPEC_CALL "OpExecuteCallableKHR runs the record of that number with the caller's data (Vulkan: Callable Shader " \
                  "Binding Table)"
#define SPEC_ATTRIBUTE                                                                                       \
    "a closest-hit shader sees the attributes of the hit that is closest, not those that an intersection shader wrote " \
    "for a report that came to nothing (Vulkan: Ray Tracing Pipeline Interface; SPIR-V: OpReportIntersectionKHR)"
#define SPEC_ANY_HIT                                                                                         \
    "an any-hit shader is run for each reported hit of what is not opaque, of boxes as of triangles; it may ignore it or " \
    "end the ray with it, after which none is run (SPIR-V: OpIgnoreIntersectionKHR, OpTerminateRayKHR; Vulkan: Any-Hit " \
    "Shaders)"
#define SPEC_LIBRARY "a pipeline linked from libraries runs the same shaders (Vulkan: Pipeline Libraries)"
#define SPEC_DEFERRED                                                                                        \
    "a pipeline that a deferred operation creates is as any other (Vulkan: vkCreateRayTracingPipelinesKHR; Deferred " \
    "Host Operations)"
#define SPEC_INDIRECT                                                                                        \
    "an indirect trace reads its size, or its size and tables, from memory (Vulkan: vkCmdTraceRaysIndirectKHR, " \
    "vkCmdTraceRaysIndirect2KHR)"
#define SPEC_SIZE "LaunchId and LaunchSize are those of the trace, in all three dimensions (Vulkan: vkCmdTraceRaysKHR; " \
                  "built-ins LaunchIdKHR, LaunchSizeKHR)"
#define SPEC_WIDE                                                                                            \
    "of the SBT offset and stride only the 4 lowest bits count, of the miss index the 16 lowest (SPV_KHR_ray_tracing: " \
    "OpTraceRayKHR)"
#define SPEC_REPORT                                                                                          \
    "of several reports the nearest counts, and each says whether it was accepted (SPV_KHR_ray_tracing: " \
    "OpReportIntersectionKHR)"
#define SPEC_SKIP "with SkipClosestHitShader a hit runs no closest-hit shader, and a miss its miss shader (SPIR-V: Ray Flags)"

#define ALL_DEPTH UINT32_MAX /* as deep as the device goes */
#define ALL_STRIDE UINT32_MAX /* as far apart as the device takes */

struct params {
    struct gn_cts_route route;
    enum gn_sample_content content;
    enum gn_cts_program program;
    uint32_t rays; /* 0: the sample's; exact, however the run is scaled, with `exact` */
    bool exact;
    uint32_t extra_flags; /* on every ray */
    bool varied; /* masks of rays and instances, and tmin, differ */
};

static void route_of_device(struct gn_case_run *run, const struct params *params)
{
    const VkPhysicalDeviceRayTracingPipelinePropertiesKHR *limits = &gn_device_info(run->device)->pipeline_limits;
    run->route = params->route;
    run->route.entry = GN_CTS_PIPELINE;
    if (run->route.depth == ALL_DEPTH)
        run->route.depth = limits->maxRayRecursionDepth;
    if (run->route.record_padding == ALL_STRIDE && limits->shaderGroupHandleAlignment) {
        const uint32_t least = limits->shaderGroupHandleSize + limits->shaderGroupHandleAlignment;
        run->route.record_padding = (limits->maxShaderGroupStride - least) / limits->shaderGroupHandleAlignment;
    }
}

static void vary(struct gn_case_run *run, struct gn_sample *sample)
{
    struct gn_cts_instance *instances = GN_NEW(&run->arena, struct gn_cts_instance, sample->scene.instance_count);
    for (uint32_t i = 0; i < sample->scene.instance_count; i++) {
        instances[i] = sample->scene.instances[i];
        instances[i].mask = 1u << i % 8;
    }
    sample->scene.instances = instances;
    for (uint32_t i = 0; i < sample->ray_count; i++) {
        sample->rays[i].ray.cull_mask = gn_random_below(&run->random, 256);
        sample->rays[i].ray.tmin = (float)gn_random_range(&run->random, 0, 1.25);
    }
}

static void table(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    struct gn_sample sample;
    route_of_device(run, params);
    gn_sample_make(run, &(struct gn_sample_options){.content = params->content, .rays = params->rays}, &sample);
    if (params->exact) {
        while (sample.ray_count < params->rays) { /* of a run on a smaller scale: the same ones again */
            struct gn_cts_ray *more = GN_NEW(&run->arena, struct gn_cts_ray, params->rays);
            for (uint32_t i = 0; i < params->rays; i++)
                more[i] = sample.rays[i % sample.ray_count];
            sample.rays = more;
            sample.ray_count = params->rays;
        }
        sample.ray_count = params->rays;
    }
    for (uint32_t i = 0; i < sample.ray_count; i++)
        sample.rays[i].ray.flags |= params->extra_flags;
    if (params->varied)
        vary(run, &sample);
    gn_case_trace(run, &sample.scene, params->program, sample.rays, sample.ray_count, 0);
}

/*
 * Null records: where the record that a hit takes is zeros, no closest-hit shader answers; all other rays answer as
 * they do with the full table. Rays are opaque and pass boxes, so that nothing else would have to run.
 */
static void null_records(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    struct gn_sample sample;
    struct gn_cts_answers full, some;
    struct gn_arena arena = {0};
    route_of_device(run, params);
    gn_sample_make(run, &(struct gn_sample_options){.content = params->content, .rays = params->rays}, &sample);
    for (uint32_t i = 0; i < sample.ray_count; i++)
        sample.rays[i].ray.flags = GN_REF_RAY_OPAQUE | GN_REF_RAY_SKIP_AABBS;
    const uint32_t every = run->route.null_every;
    run->route.null_every = 0;
    if (!gn_case_answers(run, &sample.scene, GN_CTS_COMMITTED, sample.rays, sample.ray_count, &arena, &full))
        goto done;
    run->route.null_every = every;
    if (!gn_case_answers(run, &sample.scene, GN_CTS_COMMITTED, sample.rays, sample.ray_count, &arena, &some))
        goto done;
    run->route.null_every = 0;
    uint32_t empty_hits = 0;
    for (uint32_t i = 0; i < sample.ray_count; i++) {
        const struct gn_ref_answer *a = &full.committed[i], *b = &some.committed[i];
        const uint32_t record =
            a->sbt_offset + a->geometry * run->route.record_stride + run->route.record_offset;
        const bool empty = a->kind == GN_REF_ANSWER_TRIANGLE && record % every == 0;
        empty_hits += empty;
        if (empty)
            gn_case_check(run, gn_answer_fault((uint32_t)b->kind) != NULL && (uint32_t)b->kind == 4,
                          "ray %u: record %u is zeros, but a shader has answered kind %u", i, record, (uint32_t)b->kind);
        else
            gn_case_check(run, memcmp(a, b, sizeof *a) == 0,
                          "ray %u: answered differently (kind %u, t %.9g) beside null records than without (kind %u, t %.9g)",
                          i, (uint32_t)b->kind, (double)b->t, (uint32_t)a->kind, (double)a->t);
    }
    gn_case_check(run, empty_hits > 0, "no ray has met a null record");
    gn_case_judge(run, &sample.scene, GN_CTS_COMMITTED, sample.rays, sample.ray_count, 0, &full);
done:
    gn_arena_finish(&arena);
}

static void deferral(struct gn_case_run *run, const struct gn_case *self)
{
    table(run, self);
    gn_case_check(run, !gn_device_info(run->device)->unsaid_deferral,
                  "vkCreateRayTracingPipelinesKHR was asked to be deferred and gave VK_SUCCESS, which says neither that it "
                  "was nor that it was not");
}

#define CASE(label, spec, ...)                                                                               \
    {                                                                                                        \
        "tables." label, spec, table, &(const struct params){__VA_ARGS__}, 0                                 \
    }
#define RECORDS(label, stride, offset)                                                                       \
    CASE("records." label, SPEC_RECORD, .route = {.record_stride = stride, .record_offset = offset},         \
         .content = GN_SAMPLE_MESHES),                                                                       \
        CASE("records." label "_mixed", SPEC_RECORD, .route = {.record_stride = stride, .record_offset = offset}, \
             .content = GN_SAMPLE_MIXED)
#define PADDED(label, padding)                                                                               \
    CASE("stride." label, SPEC_STRIDE, .route = {.record_stride = 1, .record_padding = padding},             \
         .content = GN_SAMPLE_MIXED)
#define MISS(label, index)                                                                                   \
    CASE("miss." label, SPEC_MISS, .route = {.record_stride = 1, .miss_index = index}, .content = GN_SAMPLE_MIXED)
#define NULLS(label, every, offset)                                                                          \
    {                                                                                                        \
        "tables.null." label, SPEC_NULL, null_records,                                                       \
            &(const struct params){.route = {.record_stride = 1, .record_offset = offset, .null_every = every}, \
                                   .content = GN_SAMPLE_MESHES}, 0                                           \
    }
#define DEPTH(label, levels)                                                                                 \
    CASE("recursion." label "_meshes", SPEC_DEPTH, .route = {.record_stride = 1, .depth = levels},           \
         .content = GN_SAMPLE_NOT_OPAQUE),                                                                   \
        CASE("recursion." label "_mixed", SPEC_DEPTH, .route = {.record_stride = 2, .depth = levels},        \
             .content = GN_SAMPLE_MIXED),                                                                    \
        CASE("recursion." label "_detail", SPEC_DEPTH, .route = {.record_stride = 1, .depth = levels},   \
             .content = GN_SAMPLE_NOT_OPAQUE, .program = GN_CTS_DETAIL)
#define SIZE(count)                                                                                          \
    CASE("size." #count, SPEC_SIZE, .route = {.record_stride = 1}, .content = GN_SAMPLE_MESHES, .rays = count, \
         .exact = true)
#define LAUNCH(label, way)                                                                                   \
    CASE("launch." label "_meshes", SPEC_INDIRECT, .route = {.record_stride = 1, .launch = way},             \
         .content = GN_SAMPLE_MESHES),                                                                       \
        CASE("launch." label "_mixed", SPEC_INDIRECT, .route = {.record_stride = 3, .record_offset = 2, .launch = way}, \
             .content = GN_SAMPLE_MIXED),                                                                    \
        CASE("launch." label "_recursion", SPEC_INDIRECT, .route = {.record_stride = 1, .depth = 2, .launch = way}, \
             .content = GN_SAMPLE_MIXED),                                                                    \
        CASE("launch." label "_callable", SPEC_INDIRECT, .route = {.record_stride = 1, .callable = true, .launch = way}, \
             .content = GN_SAMPLE_MIXED)
#define LINKED(label, way)                                                                                   \
    CASE("linked." label "_meshes", SPEC_LIBRARY, .route = {.record_stride = 1, .linking = way},             \
         .content = GN_SAMPLE_MESHES),                                                                       \
        CASE("linked." label "_boxes", SPEC_LIBRARY, .route = {.record_stride = 1, .linking = way},          \
             .content = GN_SAMPLE_BOXES),                                                                    \
        CASE("linked." label "_mixed", SPEC_LIBRARY, .route = {.record_stride = 2, .record_offset = 3, .linking = way}, \
             .content = GN_SAMPLE_MIXED),                                                                    \
        CASE("linked." label "_candidates", SPEC_LIBRARY, .route = {.record_stride = 1, .linking = way},     \
             .content = GN_SAMPLE_NOT_OPAQUE, .program = GN_CTS_CANDIDATES)

static const struct gn_case cases[] = {
    RECORDS("stride_0", 0, 0),
    RECORDS("stride_0_offset", 0, 15),
    RECORDS("stride_1", 1, 0),
    RECORDS("stride_1_offset", 1, 15),
    RECORDS("stride_2", 2, 1),
    RECORDS("stride_7", 7, 8),
    RECORDS("stride_15", 15, 0),
    RECORDS("stride_15_offset", 15, 15),
    PADDED("tight", 0),
    PADDED("one_more", 1),
    PADDED("odd", 5),
    PADDED("wide", 61),
    PADDED("widest", ALL_STRIDE),
    CASE("records.wide_operands", SPEC_WIDE, .route = {.record_stride = 3, .record_offset = 2, .miss_index = 5, .wide = true},
         .content = GN_SAMPLE_MIXED),
    CASE("reports.boxes", SPEC_REPORT, .route = {.record_stride = 1, .reports = true}, .content = GN_SAMPLE_BOXES),
    CASE("reports.mixed", SPEC_REPORT, .route = {.record_stride = 1, .reports = true}, .content = GN_SAMPLE_MIXED),
    MISS("0", 0),
    MISS("1", 1),
    MISS("7", 7),
    MISS("15", 15),
    NULLS("every_2", 2, 0),
    NULLS("every_2_offset", 2, 1),
    NULLS("every_3", 3, 0),
    NULLS("every_5", 5, 2),
    NULLS("all", 1, 0),
    DEPTH("2", 2),
    DEPTH("3", 3),
    DEPTH("deepest", ALL_DEPTH),
    CASE("recursion.operands", SPEC_DEPTH,
         .route = {.record_stride = 3, .record_offset = 15, .miss_index = 7, .depth = 2}, .content = GN_SAMPLE_MIXED,
         .rays = 2048, .varied = true),
    CASE("recursion.operands_meshes", SPEC_DEPTH,
         .route = {.record_stride = 1, .record_offset = 15, .miss_index = 7, .depth = 2}, .content = GN_SAMPLE_MESHES,
         .rays = 2048, .varied = true),
    CASE("callable.meshes", SPEC_CALL, .route = {.record_stride = 1, .callable = true}, .content = GN_SAMPLE_MESHES),
    CASE("callable.mixed", SPEC_CALL, .route = {.record_stride = 2, .callable = true}, .content = GN_SAMPLE_MIXED),
    CASE("callable.wide_records", SPEC_CALL, .route = {.record_stride = 1, .record_padding = 9, .callable = true},
         .content = GN_SAMPLE_MIXED),
    CASE("attributes.boxes", SPEC_ATTRIBUTE, .route = {.record_stride = 1}, .content = GN_SAMPLE_BOXES),
    CASE("attributes.boxes_rejected", SPEC_ATTRIBUTE, .route = {.record_stride = 1, .traps = true},
         .content = GN_SAMPLE_BOXES),
    CASE("attributes.mixed_rejected", SPEC_ATTRIBUTE, .route = {.record_stride = 1, .traps = true},
         .content = GN_SAMPLE_MIXED),
    CASE("any_hit.refuses_boxes", SPEC_ANY_HIT, .route = {.record_stride = 1, .any_hit_refuses = true},
         .content = GN_SAMPLE_BOXES, .extra_flags = GN_REF_RAY_NO_OPAQUE),
    CASE("any_hit.ends", SPEC_ANY_HIT, .route = {.record_stride = 1, .any_hit_ends = true},
         .content = GN_SAMPLE_NOT_OPAQUE, .extra_flags = GN_REF_RAY_NO_OPAQUE | GN_REF_RAY_TERMINATE_ON_FIRST_HIT),
    CASE("any_hit.ends_on_boxes", SPEC_ANY_HIT, .route = {.record_stride = 1, .any_hit_ends = true},
         .content = GN_SAMPLE_BOXES, .extra_flags = GN_REF_RAY_NO_OPAQUE | GN_REF_RAY_TERMINATE_ON_FIRST_HIT),
    LINKED("hits", GN_CTS_LINK_HITS),
    LINKED("all", GN_CTS_LINK_ALL),
    CASE("deferred.meshes", SPEC_DEFERRED, .route = {.record_stride = 1, .deferred = true}, .content = GN_SAMPLE_MESHES),
    {"tables.deferred.result",
     "a command that is not deferred, though asked to be, gives VK_OPERATION_NOT_DEFERRED_KHR (Vulkan: Deferred Host "
     "Operations, Requesting Deferral)",
     deferral, &(const struct params){.route = {.record_stride = 1, .deferred = true}, .content = GN_SAMPLE_MESHES}, 0},
    CASE("deferred.mixed", SPEC_DEFERRED, .route = {.record_stride = 2, .record_offset = 1, .deferred = true},
         .content = GN_SAMPLE_MIXED),
    LAUNCH("indirect", GN_CTS_LAUNCH_INDIRECT),
    LAUNCH("indirect2", GN_CTS_LAUNCH_INDIRECT2),
    SIZE(1),
    SIZE(2),
    SIZE(31),
    SIZE(63),
    SIZE(64),
    SIZE(65),
    SIZE(4097),
    SIZE(12289),
    CASE("skip_closest_hit.meshes", SPEC_SKIP, .route = {.record_stride = 1}, .content = GN_SAMPLE_MESHES,
         .extra_flags = GN_REF_RAY_SKIP_CLOSEST_HIT_SHADER),
    CASE("skip_closest_hit.mixed", SPEC_SKIP, .route = {.record_stride = 1}, .content = GN_SAMPLE_MIXED,
         .extra_flags = GN_REF_RAY_SKIP_CLOSEST_HIT_SHADER),
    CASE("skip_closest_hit.first_hit", SPEC_SKIP, .route = {.record_stride = 1}, .content = GN_SAMPLE_NOT_OPAQUE,
         .extra_flags = GN_REF_RAY_SKIP_CLOSEST_HIT_SHADER | GN_REF_RAY_TERMINATE_ON_FIRST_HIT),
};
const struct gn_case_family gn_family_tables = {"tables", cases, sizeof cases / sizeof cases[0]};
