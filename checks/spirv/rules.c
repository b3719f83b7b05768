/* SPDX-License-Identifier: Apache-2.0 */
/* The blocks of the rules about shaders. What each tests over values is in flow.c (protocol of queries) and operands.c
 * (operands); what runs on the device is in checks.c. */
#include "checks/spirv/spirv.h"

#include <string.h>

#define EXTENSION "SPV_KHR_ray_query"

/* Vulkan leaves it undefined, so it is wrong under every API that runs on Vulkan. */
#define UNDEFINED                                                                                                      \
    {[GN_PROFILE_VULKAN] = GN_SEVERITY_ERROR,                                                                          \
     [GN_PROFILE_WGPU] = GN_SEVERITY_ERROR,                                                                            \
     [GN_PROFILE_WEBGPU_RT] = GN_SEVERITY_ERROR,                                                                       \
     [GN_PROFILE_DILIGENT] = GN_SEVERITY_ERROR,                                                                        \
     [GN_PROFILE_HGI] = GN_SEVERITY_ERROR}

#define ADVICE(severity_)                                                                                              \
    {[GN_PROFILE_VULKAN] = severity_,                                                                                  \
     [GN_PROFILE_WGPU] = severity_,                                                                                    \
     [GN_PROFILE_WEBGPU_RT] = severity_,                                                                               \
     [GN_PROFILE_DILIGENT] = severity_,                                                                                \
     [GN_PROFILE_HGI] = severity_}

static const struct gn_spirv_rule rules[] = {
    [GN_SPIRV_RULE_UNINITIALIZED] =
        {.id = "query.use.uninitialized",
         .title = "ray query used before it was initialized",
         .text = "Every operation on a ray query but its initialization needs an earlier OpRayQueryInitializeKHR on the "
                 "same object.",
         .remedy = "Initialize the query on every path that leads here.",
         .sources = {EXTENSION, "NG-031", "NG-037"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_PROCEED_AFTER_FALSE] =
        {.id = "query.proceed.after_false",
         .title = "OpRayQueryProceedKHR after it returned false",
         .text = "Once OpRayQueryProceedKHR has returned false the traversal is over; it may be called again only after a "
                 "new initialization.",
         .remedy = "Leave the loop when the result is false, or initialize the query again.",
         .sources = {EXTENSION, "NG-018"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_PROCEED_LIMIT] =
        {.id = "query.proceed.limit",
         .title = "ray query that proceeds more often than the limit that was set",
         .text = "A loop over candidates ends. Every OpRayQueryProceedKHR beyond the limit counts.",
         .remedy = "Look for a candidate that is never passed, or raise the limit.",
         .sources = {"NG-007", "NG-009"},
         .severity = ADVICE(GN_SEVERITY_WARNING)},
    [GN_SPIRV_RULE_TERMINATE_AFTER_FALSE] =
        {.id = "query.terminate.after_false",
         .title = "OpRayQueryTerminateKHR after the traversal ended",
         .text = "Every OpRayQueryProceedKHR since the initialization has returned true when OpRayQueryTerminateKHR is "
                 "called.",
         .remedy = "Call it only inside of the loop over candidates.",
         .sources = {EXTENSION, "NG-023"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_CANDIDATE_NONE] =
        {.id = "query.candidate.none",
         .title = "candidate read where there is none",
         .text = "A getter of the candidate intersection needs an OpRayQueryProceedKHR on the query, and the last one "
                 "must have returned true.",
         .remedy = "Read the candidate inside of the loop, or read the committed intersection instead.",
         .sources = {EXTENSION, "NG-030", "NG-033", "NG-035"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_CANDIDATE_NOT_TRIANGLE] =
        {.id = "query.candidate.not_triangle",
         .title = "triangle data of a candidate that is an AABB",
         .text = "T, barycentrics, facing and vertex positions of a candidate exist only when its type is triangle.",
         .remedy = "Test rayQueryGetIntersectionTypeEXT(query, false) first.",
         .sources = {EXTENSION, "NG-025", "NG-036", "NG-062"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_CANDIDATE_NOT_AABB] =
        {.id = "query.candidate.not_aabb",
         .title = "opacity of an AABB read where the candidate is a triangle",
         .text = "OpRayQueryGetIntersectionCandidateAABBOpaqueKHR needs a candidate of type AABB.",
         .remedy = "Test rayQueryGetIntersectionTypeEXT(query, false) first.",
         .sources = {EXTENSION, "NG-025"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_COMMITTED_NONE] =
        {.id = "query.committed.none",
         .title = "committed intersection read where there is none",
         .text = "A getter of the committed intersection, other than that of its type, needs one to exist.",
         .remedy = "Test that rayQueryGetIntersectionTypeEXT(query, true) is not none.",
         .sources = {EXTENSION, "NG-029", "NG-054"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_COMMITTED_NOT_TRIANGLE] =
        {.id = "query.committed.not_triangle",
         .title = "triangle data of a committed intersection that was generated",
         .text = "Barycentrics, facing and vertex positions exist only when the committed intersection is a triangle.",
         .remedy = "Test that rayQueryGetIntersectionTypeEXT(query, true) is triangle.",
         .sources = {EXTENSION, "NG-036", "NG-062", "NG-063"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_COMMITTED_TOO_EARLY] =
        {.id = "query.committed.too_early",
         .title = "committed intersection read before the traversal ended",
         .text = "WGSL leaves the committed intersection undefined until rayQueryProceed has returned false. Vulkan "
                 "allows reading what is committed so far.",
         .remedy = "Read it after the loop.",
         .sources = {"NG-029", "NG-032", "NG-034"},
         .severity = {[GN_PROFILE_WGPU] = GN_SEVERITY_ERROR}},
    [GN_SPIRV_RULE_CONFIRM_NO_CANDIDATE] =
        {.id = "query.confirm.no_candidate",
         .title = "OpRayQueryConfirmIntersectionKHR without a candidate",
         .text = "Confirming needs an OpRayQueryProceedKHR on the query, and the last one must have returned true.",
         .remedy = "Confirm inside of the loop over candidates.",
         .sources = {EXTENSION, "NG-042"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_CONFIRM_NOT_TRIANGLE] =
        {.id = "query.confirm.not_triangle",
         .title = "OpRayQueryConfirmIntersectionKHR on an AABB",
         .text = "Only a triangle candidate can be confirmed; an AABB candidate needs a generated intersection.",
         .remedy = "Test the candidate's type first.",
         .sources = {EXTENSION, "NG-041"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_GENERATE_NO_CANDIDATE] =
        {.id = "query.generate.no_candidate",
         .title = "OpRayQueryGenerateIntersectionKHR without a candidate",
         .text = "Generating needs an OpRayQueryProceedKHR on the query, and the last one must have returned true.",
         .remedy = "Generate inside of the loop over candidates.",
         .sources = {EXTENSION, "NG-040"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_GENERATE_NOT_AABB] =
        {.id = "query.generate.not_aabb",
         .title = "OpRayQueryGenerateIntersectionKHR on a triangle",
         .text = "An intersection can be generated only for a candidate of type AABB.",
         .remedy = "Test the candidate's type first.",
         .sources = {EXTENSION, "NG-038"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_GENERATE_RANGE] =
        {.id = "query.generate.range",
         .title = "generated intersection outside of the ray's range",
         .text = "The hit T of OpRayQueryGenerateIntersectionKHR is at least the ray's tmin and at most the T committed so "
                 "far (tmax where nothing is committed), and not NaN.",
         .remedy = "Generate only where tmin <= t and t <= the committed T.",
         .sources = {"VUID-RuntimeSpirv-OpRayQueryGenerateIntersectionKHR-06353", "NG-039", "NG-044"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_INITIALIZE_NAN] =
        {.id = "query.initialize.nan",
         .title = "ray with a NaN",
         .text = "Origin, direction, tmin and tmax of a ray are not NaN.",
         .remedy = "Look for a division by zero or a normalized zero vector where the ray is made.",
         .sources = {"VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06351", "NG-053"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_INITIALIZE_INFINITE] =
        {.id = "query.initialize.infinite",
         .title = "ray with an infinite origin or direction",
         .text = "Origin and direction of a ray are finite.",
         .remedy = "Look for a division by zero or an overflow where the ray is made.",
         .sources = {"VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06348", "NG-053"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_INITIALIZE_NEGATIVE_T] =
        {.id = "query.initialize.negative_t",
         .title = "ray with a negative tmin or tmax",
         .text = "tmin and tmax of a ray are not negative.",
         .remedy = "Start the ray further back instead of using a negative tmin.",
         .sources = {"VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06349", "NG-053"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_INITIALIZE_T_ORDER] =
        {.id = "query.initialize.t_order",
         .title = "ray whose tmin exceeds its tmax",
         .text = "tmin of a ray is at most its tmax.",
         .remedy = "Skip the query where the range is empty.",
         .sources = {"VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06350", "NG-053"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_INITIALIZE_ZERO_DIRECTION] =
        {.id = "query.initialize.zero_direction",
         .title = "ray without a direction",
         .text = "No valid-usage rule forbids a direction of zero, but nothing says what it hits.",
         .remedy = "Skip the query where the direction is zero.",
         .sources = {"NG-053"},
         .severity = ADVICE(GN_SEVERITY_WARNING)},
    [GN_SPIRV_RULE_INITIALIZE_SKIP_BOTH] =
        {.id = "query.initialize.skip_both",
         .title = "ray that skips triangles and AABBs",
         .text = "The ray flags SkipTriangles and SkipAABBs exclude each other.",
         .remedy = "Drop one of the flags.",
         .sources = {"VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06889", "NG-079"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_INITIALIZE_CULL_PAIR] =
        {.id = "query.initialize.cull_pair",
         .title = "ray flags of culling that exclude each other",
         .text = "At most one of SkipTriangles, CullBackFacingTriangles and CullFrontFacingTriangles is set.",
         .remedy = "Keep one of the flags.",
         .sources = {"VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06890", "NG-079"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_INITIALIZE_OPACITY_PAIR] =
        {.id = "query.initialize.opacity_pair",
         .title = "ray flags of opacity that exclude each other",
         .text = "At most one of Opaque, NoOpaque, CullOpaque and CullNoOpaque is set.",
         .remedy = "Keep one of the flags.",
         .sources = {"VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06891", "NG-079"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_INITIALIZE_UNKNOWN_FLAGS] =
        {.id = "query.initialize.unknown_flags",
         .title = "unknown ray flags",
         .text = "Only the ray flags that SPIR-V lists, with the module's capabilities, have a meaning.",
         .remedy = "Clear the other bits.",
         .sources = {EXTENSION, "NG-080"},
         .severity = ADVICE(GN_SEVERITY_WARNING)},
    [GN_SPIRV_RULE_INITIALIZE_MASK_BITS] =
        {.id = "query.initialize.mask_bits",
         .title = "cull mask wider than eight bits",
         .text = "Only the low eight bits of the cull mask count, the device ignores the others. Where all others are set, as "
                 "in ~1, they are taken for meant.",
         .remedy = "Keep the mask within 0xFF.",
         .sources = {EXTENSION, "NG-048"},
         .severity = ADVICE(GN_SEVERITY_NOTE)},
    [GN_SPIRV_RULE_TRACE_NAN] =
        {.id = "trace.nan",
         .title = "traced ray with a NaN",
         .text = "Origin, direction, tmin and tmax of a traced ray are not NaN.",
         .remedy = "Look for a division by zero or a normalized zero vector where the ray is made.",
         .sources = {"VUID-RuntimeSpirv-OpTraceRayKHR-06358", "VUID-RuntimeSpirv-OpTraceRayMotionNV-06364", "VUID-RuntimeSpirv-OpHitObjectTraceRayNV-07708"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_TRACE_INFINITE] =
        {.id = "trace.infinite",
         .title = "traced ray with an infinite origin or direction",
         .text = "Origin and direction of a traced ray are finite.",
         .remedy = "Look for a division by zero or an overflow where the ray is made.",
         .sources = {"VUID-RuntimeSpirv-OpTraceRayKHR-06355", "VUID-RuntimeSpirv-OpTraceRayMotionNV-06361", "VUID-RuntimeSpirv-OpHitObjectTraceRayNV-07705"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_TRACE_NEGATIVE_T] =
        {.id = "trace.negative_t",
         .title = "traced ray with a negative tmin or tmax",
         .text = "tmin and tmax of a traced ray are not negative.",
         .remedy = "Start the ray further back instead of using a negative tmin.",
         .sources = {"VUID-RuntimeSpirv-OpTraceRayKHR-06356", "VUID-RuntimeSpirv-OpTraceRayMotionNV-06362", "VUID-RuntimeSpirv-OpHitObjectTraceRayNV-07706"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_TRACE_T_ORDER] =
        {.id = "trace.t_order",
         .title = "traced ray whose tmin exceeds its tmax",
         .text = "tmin of a traced ray is at most its tmax.",
         .remedy = "Skip the trace where the range is empty.",
         .sources = {"VUID-RuntimeSpirv-OpTraceRayKHR-06357", "VUID-RuntimeSpirv-OpTraceRayMotionNV-06363", "VUID-RuntimeSpirv-OpHitObjectTraceRayNV-07707"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_TRACE_ZERO_DIRECTION] =
        {.id = "trace.zero_direction",
         .title = "traced ray without a direction",
         .text = "No valid-usage rule forbids a direction of zero, but nothing says what it hits.",
         .remedy = "Skip the trace where the direction is zero.",
         .sources = {"SPV_KHR_ray_tracing"},
         .severity = ADVICE(GN_SEVERITY_WARNING)},
    [GN_SPIRV_RULE_TRACE_SKIP_BOTH] =
        {.id = "trace.skip_both",
         .title = "traced ray that skips triangles and AABBs",
         .text = "The ray flags SkipTriangles and SkipAABBs exclude each other.",
         .remedy = "Drop one of the flags.",
         .sources = {"VUID-RuntimeSpirv-OpTraceRayKHR-06552", "VUID-RuntimeSpirv-OpHitObjectTraceRayNV-07712"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_TRACE_CULL_PAIR] =
        {.id = "trace.cull_pair",
         .title = "ray flags of culling that exclude each other",
         .text = "At most one of SkipTriangles, CullBackFacingTriangles and CullFrontFacingTriangles is set.",
         .remedy = "Keep one of the flags.",
         .sources = {"VUID-RuntimeSpirv-OpTraceRayKHR-06892", "VUID-RuntimeSpirv-OpHitObjectTraceRayNV-07713"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_TRACE_OPACITY_PAIR] =
        {.id = "trace.opacity_pair",
         .title = "ray flags of opacity that exclude each other",
         .text = "At most one of Opaque, NoOpaque, CullOpaque and CullNoOpaque is set.",
         .remedy = "Keep one of the flags.",
         .sources = {"VUID-RuntimeSpirv-OpTraceRayKHR-06893", "VUID-RuntimeSpirv-OpHitObjectTraceRayNV-07714"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_TRACE_UNKNOWN_FLAGS] =
        {.id = "trace.unknown_flags",
         .title = "unknown ray flags",
         .text = "Only the ray flags that SPIR-V lists, with the module's capabilities, have a meaning.",
         .remedy = "Clear the other bits.",
         .sources = {"SPV_KHR_ray_tracing"},
         .severity = ADVICE(GN_SEVERITY_WARNING)},
    [GN_SPIRV_RULE_TRACE_MASK_BITS] =
        {.id = "trace.mask_bits",
         .title = "cull mask wider than eight bits",
         .text = "Only the low eight bits of the cull mask count, the device ignores the others. Where all others are set, as in ~1, "
                 "they are taken for meant.",
         .remedy = "Keep the mask within 0xFF.",
         .sources = {"SPV_KHR_ray_tracing"},
         .severity = ADVICE(GN_SEVERITY_NOTE)},
    [GN_SPIRV_RULE_TRACE_SBT_OFFSET_BITS] =
        {.id = "trace.sbt_offset_bits",
         .title = "SBT offset wider than four bits",
         .text = "Only the low four bits of a trace's SBT offset count, the device ignores the others, which are taken for meant where all are set.",
         .remedy = "Keep the offset within 15; larger ones belong into the instances.",
         .sources = {"SPV_KHR_ray_tracing"},
         .severity = ADVICE(GN_SEVERITY_WARNING)},
    [GN_SPIRV_RULE_TRACE_SBT_STRIDE_BITS] =
        {.id = "trace.sbt_stride_bits",
         .title = "SBT stride wider than four bits",
         .text = "Only the low four bits of a trace's SBT stride count, the device ignores the others, which are taken for meant where all are set.",
         .remedy = "Keep the stride within 15.",
         .sources = {"SPV_KHR_ray_tracing"},
         .severity = ADVICE(GN_SEVERITY_WARNING)},
    [GN_SPIRV_RULE_TRACE_MISS_BITS] =
        {.id = "trace.miss_bits",
         .title = "miss index wider than sixteen bits",
         .text = "Only the low sixteen bits of a trace's miss index count, the device ignores the others, which are taken for meant where all are set.",
         .remedy = "Keep the index within 65535.",
         .sources = {"SPV_KHR_ray_tracing"},
         .severity = ADVICE(GN_SEVERITY_WARNING)},
    [GN_SPIRV_RULE_TRACE_TIME] =
        {.id = "trace.time",
         .title = "time of a trace outside of 0 to 1",
         .text = "The time at which a ray with motion is traced is from 0 to 1.",
         .remedy = "Map the shutter interval to 0 to 1.",
         .sources = {"VUID-RuntimeSpirv-OpTraceRayMotionNV-06366", "VUID-RuntimeSpirv-OpHitObjectTraceRayNV-07710"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_TRACE_SKIPPED_BY_PIPELINE] =
        {.id = "trace.skipped_by_pipeline",
         .title = "ray flag that leaves nothing where the pipeline skips the rest",
         .text = "A ray does not skip triangles in a pipeline that skips AABBs, nor AABBs in one that skips triangles.",
         .remedy = "Drop the ray flag, or create the pipeline without its flag.",
         .sources = {"VUID-RuntimeSpirv-OpTraceRayKHR-06553", "VUID-RuntimeSpirv-OpTraceRayKHR-06554", "VUID-RuntimeSpirv-OpHitObjectTraceRayNV-07715", "VUID-RuntimeSpirv-OpHitObjectTraceRayNV-07716"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_TRACE_RECURSION] =
        {.id = "trace.recursion",
         .title = "trace deeper than the pipeline allows",
         .text = "A trace invokes shaders one deeper than its own; the pipeline says how deep they may be.",
         .remedy = "Raise maxPipelineRayRecursionDepth, or bound the recursion in the payload.",
         .sources = {"VUID-vkCmdTraceRaysKHR-maxPipelineRayRecursionDepth-03679", "DE-072", "DE-121"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_TRACE_PAYLOAD_SIZE] =
        {.id = "trace.payload_size",
         .title = "payload larger than the pipeline declares",
         .text = "The payload of a trace fits into the size that the pipeline's interface declares.",
         .remedy = "Raise maxPipelineRayPayloadSize, or make the payload smaller.",
         .sources = {"VkRayTracingPipelineInterfaceCreateInfoKHR", "SPV_KHR_ray_tracing", "DE-078"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_REPORT_HIT_KIND] =
        {.id = "report.hit_kind",
         .title = "hit kind above 127",
         .text = "The hit kind that an intersection shader reports is from 0 to 127.",
         .remedy = "Keep hit kinds within 127.",
         .sources = {"VUID-RuntimeSpirv-OpReportIntersectionKHR-06998"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_REPORT_NAN] =
        {.id = "report.nan",
         .title = "intersection reported at NaN",
         .text = "Nothing says whether an intersection at NaN lies within the ray's interval. A number outside of it is rejected, which is no mistake.",
         .remedy = "Do not report where the intersection is not a number.",
         .sources = {"SPV_KHR_ray_tracing"},
         .severity = ADVICE(GN_SEVERITY_WARNING)},
    [GN_SPIRV_RULE_REPORT_ATTRIBUTE_SIZE] =
        {.id = "report.attribute_size",
         .title = "hit attribute larger than the pipeline declares",
         .text = "Hit attributes fit into the size that the pipeline's interface declares.",
         .remedy = "Raise maxPipelineRayHitAttributeSize, or make the attributes smaller.",
         .sources = {"VUID-VkRayTracingPipelineInterfaceCreateInfoKHR-maxPipelineRayHitAttributeSize-03605", "DE-078"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_CALL_RANGE] =
        {.id = "call.range",
         .title = "callable beyond the shader binding table",
         .text = "The index of a callable is below the number of records in the callable shader binding table.",
         .remedy = "Bind a larger table, or bound the index.",
         .sources = {"VkStridedDeviceAddressRegionKHR", "SPV_KHR_ray_tracing"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_HIT_POSITIONS_OF_AABB] =
        {.id = "hit.positions_of_aabb",
         .title = "vertex positions read in a hit shader where no triangle was hit",
         .text = "HitTriangleVertexPositionsKHR has a value only where HitKindKHR is that of a triangle.",
         .remedy = "Test gl_HitKindEXT first, or keep the shader to hit groups of triangles.",
         .sources = {"VUID-HitTriangleVertexPositionsKHR-HitTriangleVertexPositionsKHR-08750"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_STRUCTURE_NONE] =
        {.id = "structure.none",
         .title = "ray traced where the descriptor holds no acceleration structure",
         .text = "A descriptor that is read has been written, and not with VK_NULL_HANDLE unless nullDescriptor is enabled; an index is "
                 "within the binding.",
         .remedy = "Write the descriptor before the work that reads it, or bound the index.",
         .sources = {"VUID-vkCmdDispatch-None-08114", "VUID-VkWriteDescriptorSetAccelerationStructureKHR-pAccelerationStructures-03580"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_STRUCTURE_NEVER_BUILT] =
        {.id = "structure.never_built",
         .title = "ray traced through an acceleration structure that nothing has built",
         .text = "A ray is traced through what was built as a top-level acceleration structure.",
         .remedy = "Submit the build, with a barrier after it, before the work that traces.",
         .sources = {"VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06352", "VUID-RuntimeSpirv-OpTraceRayKHR-06359", "HG-014"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_STRUCTURE_DESTROYED] =
        {.id = "structure.destroyed",
         .title = "ray traced through an acceleration structure that was destroyed",
         .text = "What a descriptor refers to lives as long as the work that reads the descriptor.",
         .remedy = "Keep the structure until the work is over, and write another one into the descriptor.",
         .sources = {"VUID-vkCmdDispatch-None-08114", "VUID-vkDestroyAccelerationStructureKHR-accelerationStructure-02442"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_STRUCTURE_BOTTOM_LEVEL] =
        {.id = "structure.bottom_level",
         .title = "ray traced through a bottom-level acceleration structure",
         .text = "A ray is traced through what was built as a top-level acceleration structure.",
         .remedy = "Write a TLAS that holds the BLAS into the descriptor.",
         .sources = {"VUID-RuntimeSpirv-OpRayQueryInitializeKHR-06352", "VUID-RuntimeSpirv-OpTraceRayKHR-06359"},
         .severity = UNDEFINED},
    [GN_SPIRV_RULE_STRUCTURE_NO_POSITIONS] =
        {.id = "structure.no_positions",
         .title = "vertex positions read of a BLAS that was built without ALLOW_DATA_ACCESS",
         .text = "Vertex positions can be read of triangles whose BLAS was built with "
                 "VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_DATA_ACCESS_BIT_KHR.",
         .remedy = "Build the BLAS with the flag, or read the vertices from a buffer.",
         .sources = {"VUID-RuntimeSpirv-flags-08761", "VUID-HitTriangleVertexPositionsKHR-None-08751"},
         .severity = UNDEFINED},
};

_Static_assert(sizeof rules / sizeof rules[0] == GN_SPIRV_RULE_COUNT, "a block for every rule");

const struct gn_spirv_rule *gn_spirv_rule_at(enum gn_spirv_rule_index index)
{
    return (unsigned)index < GN_SPIRV_RULE_COUNT ? &rules[index] : NULL;
}

const struct gn_spirv_rule *gn_spirv_rule_find(const char *id)
{
    for (int i = 0; i < GN_SPIRV_RULE_COUNT; i++)
        if (strcmp(rules[i].id, id) == 0)
            return &rules[i];
    return NULL;
}
