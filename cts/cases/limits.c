/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a device says of itself: required minima and maxima, features that others entail, sizes of structures. What it
 * then does at these limits is for other families (tables.recursion, tables.stride, stability.count).
 */
#include <stddef.h>
#include <stdio.h>

#include "cts/case.h"
#include "cts/device_limits.h"

#define SPEC_LIMIT "the required limit (Vulkan: Limit Requirements, table of required limits)"
#define SPEC_POWER "the limit is a power of two (Vulkan: VkPhysicalDeviceAccelerationStructurePropertiesKHR, " \
                   "VkPhysicalDeviceRayTracingPipelinePropertiesKHR)"
#define SPEC_AFTER_BIND "the limit for update-after-bind is at least the one without (Vulkan: " \
                        "VkPhysicalDeviceAccelerationStructurePropertiesKHR)"
#define SPEC_32_BITS "counts are given in 32 bits, so their limits fit (Vulkan: " \
                     "VkPhysicalDeviceAccelerationStructurePropertiesKHR)"
#define SPEC_FEATURE "a device with the extension has the feature (Vulkan: Feature Requirements)"
#define SPEC_EXTENSION "a device with the extension has those that it depends on (Vulkan: Layers and Extensions, extension dependencies)"
#define SPEC_MIXED "a feature that extends another comes with it (VUID-VkPhysicalDeviceRayTracingPipelineFeaturesKHR-" \
                   "rayTracingPipelineShaderGroupHandleCaptureReplayMixed-03575)"
#define SPEC_FORMAT "the format can be that of vertices (Vulkan: Required Format Support)"
#define SPEC_GROWTH                                                                                          \
    "a structure of the size for more primitives takes fewer, and what a build needs is at most that size, so sizes do " \
    "not shrink as counts grow (Vulkan: vkGetAccelerationStructureBuildSizesKHR)"
#define SPEC_IGNORED                                                                                         \
    "addresses, mode, source and destination make no difference to sizes (Vulkan: "                          \
    "vkGetAccelerationStructureBuildSizesKHR)"

static bool facts_of(struct gn_case_run *run, struct gn_device_facts *out)
{
    return gn_case_check(run, gn_device_facts_query(run->device, out) == GN_DEVICE_OK, "%s",
                         gn_device_message(run->device));
}

enum relation { AT_LEAST, AT_MOST, EXACTLY, POWER_OF_TWO };

struct limit {
    enum relation relation;
    size_t offset; /* in the facts */
    size_t bytes; /* 4 or 8 */
    uint64_t value;
    size_t needs; /* offset of a bool, or VkBool32, that has to be set for it to be asked */
    size_t needs_bytes;
};

static uint64_t number_at(const struct gn_device_facts *facts, size_t offset, size_t bytes)
{
    const char *at = (const char *)facts + offset;
    return bytes == 8 ? *(const uint64_t *)at : bytes == 4 ? *(const uint32_t *)at : *(const bool *)at;
}

static void limit(struct gn_case_run *run, const struct gn_case *self)
{
    static const char *const words[] = {"at least", "at most", "exactly", "a power of two, such as"};
    const struct limit *limit = self->params;
    struct gn_device_facts facts;
    if (!facts_of(run, &facts))
        return;
    if (!number_at(&facts, limit->needs, limit->needs_bytes)) {
        gn_case_skip(run, "the device does not have what the limit is of");
        return;
    }
    const uint64_t found = number_at(&facts, limit->offset, limit->bytes);
    bool good = limit->relation == AT_LEAST  ? found >= limit->value
                : limit->relation == AT_MOST ? found <= limit->value
                : limit->relation == EXACTLY ? found == limit->value
                                             : found && !(found & (found - 1));
    gn_case_check(run, good, "the device says %llu, required is %s %llu", (unsigned long long)found,
                  words[limit->relation], (unsigned long long)limit->value);
}

/* The first number is at least the second. */
struct pair {
    size_t more, less;
};
static void pair(struct gn_case_run *run, const struct gn_case *self)
{
    const struct pair *params = self->params;
    struct gn_device_facts facts;
    if (!facts_of(run, &facts))
        return;
    const uint64_t more = number_at(&facts, params->more, 4), less = number_at(&facts, params->less, 4);
    if (!facts.structure.descriptorBindingAccelerationStructureUpdateAfterBind)
        gn_case_skip(run, "the device lacks descriptorBindingAccelerationStructureUpdateAfterBind");
    else
        gn_case_check(run, more >= less, "the device says %llu with and %llu without", (unsigned long long)more,
                      (unsigned long long)less);
}

/* If the first two hold, so does the third. */
struct implication {
    size_t if_offset, if_bytes, and_offset, and_bytes, then_offset, then_bytes;
};
static void implication(struct gn_case_run *run, const struct gn_case *self)
{
    const struct implication *params = self->params;
    struct gn_device_facts facts;
    if (!facts_of(run, &facts))
        return;
    if (!number_at(&facts, params->if_offset, params->if_bytes) ||
        !number_at(&facts, params->and_offset, params->and_bytes))
        gn_case_skip(run, "the device does not have what would require it");
    else
        gn_case_check(run, number_at(&facts, params->then_offset, params->then_bytes) != 0,
                      "the device has what requires it, but not the feature or extension itself");
}

static void format(struct gn_case_run *run, const struct gn_case *self)
{
    gn_case_check(run, gn_device_has_vertex_format(run->device, (VkFormat)self->value),
                  "VK_FORMAT_FEATURE_ACCELERATION_STRUCTURE_VERTEX_BUFFER_BIT_KHR is not among the bufferFeatures of "
                  "VkFormat %d",
                  (int)self->value);
}

struct growth {
    VkGeometryTypeKHR type;
    VkIndexType index_type;
    bool geometries; /* their number grows */
};

static const VkBuildAccelerationStructureFlagsKHR preferences[] = {
    0,
    VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR,
    VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_BUILD_BIT_KHR,
    VK_BUILD_ACCELERATION_STRUCTURE_LOW_MEMORY_BIT_KHR,
    VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR | VK_BUILD_ACCELERATION_STRUCTURE_LOW_MEMORY_BIT_KHR,
    VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_BUILD_BIT_KHR | VK_BUILD_ACCELERATION_STRUCTURE_LOW_MEMORY_BIT_KHR,
};
enum { PREFERENCES = sizeof preferences / sizeof preferences[0] };

/* `value` is what is allowed (update, compaction); each of the preferences is tried with it. */
static void growth(struct gn_case_run *run, const struct gn_case *self)
{
    const struct growth *params = self->params;
    const VkPhysicalDeviceAccelerationStructurePropertiesKHR *limits = &gn_device_info(run->device)->limits;
    const uint64_t most = params->type == VK_GEOMETRY_TYPE_INSTANCES_KHR ? limits->maxInstanceCount
                                                                         : limits->maxPrimitiveCount;
    for (uint32_t p = 0; p < PREFERENCES; p++) {
        VkAccelerationStructureBuildSizesInfoKHR before = {0};
        /* Without any geometry there is nothing that a larger build would have to hold as well. */
        for (uint64_t n = params->geometries; n <= (params->geometries ? 64 : 1u << 22) && n <= most; n = n < 4 ? n + 1 : n + n / 3) {
            const struct gn_size_request request = {
                .type = params->type,
                .index_type = params->index_type,
                .flags = preferences[p] | (VkBuildAccelerationStructureFlagsKHR)self->value,
                .geometry_count = params->geometries ? (uint32_t)n : 1,
                .count = params->geometries ? 100 : (uint32_t)n,
            };
            const VkAccelerationStructureBuildSizesInfoKHR sizes = gn_device_sizes(run->device, &request);
            gn_case_check(run, sizes.accelerationStructureSize > 0, "flags 0x%x: %llu of them take 0 bytes",
                          request.flags, (unsigned long long)n);
            gn_case_check(run, sizes.accelerationStructureSize >= before.accelerationStructureSize,
                          "flags 0x%x: a structure of %llu takes %llu bytes, one of fewer %llu", request.flags,
                          (unsigned long long)n, (unsigned long long)sizes.accelerationStructureSize,
                          (unsigned long long)before.accelerationStructureSize);
            gn_case_check(run, sizes.buildScratchSize >= before.buildScratchSize,
                          "flags 0x%x: the build scratch for %llu is %llu bytes, for fewer %llu", request.flags,
                          (unsigned long long)n, (unsigned long long)sizes.buildScratchSize,
                          (unsigned long long)before.buildScratchSize);
            gn_case_check(run, sizes.updateScratchSize >= before.updateScratchSize,
                          "flags 0x%x: the update scratch for %llu is %llu bytes, for fewer %llu", request.flags,
                          (unsigned long long)n, (unsigned long long)sizes.updateScratchSize,
                          (unsigned long long)before.updateScratchSize);
            before = sizes;
        }
    }
}

static void ignored(struct gn_case_run *run, const struct gn_case *self)
{
    const struct growth *params = self->params;
    for (uint32_t p = 0; p < PREFERENCES; p++) {
        for (uint32_t n = 0; n < 5000; n = 3 * n + 1) {
            struct gn_size_request request = {
                .type = params->type,
                .index_type = params->index_type,
                .flags = preferences[p] | (VkBuildAccelerationStructureFlagsKHR)self->value,
                .geometry_count = 1,
                .count = n,
            };
            const VkAccelerationStructureBuildSizesInfoKHR a = gn_device_sizes(run->device, &request);
            request.garbage = true;
            const VkAccelerationStructureBuildSizesInfoKHR b = gn_device_sizes(run->device, &request);
            gn_case_check(run,
                          a.accelerationStructureSize == b.accelerationStructureSize &&
                              a.buildScratchSize == b.buildScratchSize && a.updateScratchSize == b.updateScratchSize,
                          "flags 0x%x, %u of them: sizes %llu, %llu, %llu, with other addresses and mode %llu, %llu, %llu",
                          request.flags, n, (unsigned long long)a.accelerationStructureSize,
                          (unsigned long long)a.buildScratchSize, (unsigned long long)a.updateScratchSize,
                          (unsigned long long)b.accelerationStructureSize, (unsigned long long)b.buildScratchSize,
                          (unsigned long long)b.updateScratchSize);
        }
    }
}

#define AT(member) offsetof(struct gn_device_facts, member)
#define SIZE(member) sizeof(((struct gn_device_facts *)0)->member)
#define LIMIT(label, spec, structure, member, relation, number, needed)                                      \
    {                                                                                                        \
        "limits." label, spec, limit,                                                                        \
            &(const struct limit){relation, AT(structure.member), SIZE(structure.member), number, AT(needed), \
                                  SIZE(needed)},                                                             \
            0                                                                                                \
    }
#define STRUCTURE(member, relation, number)                                                                  \
    LIMIT("structure." #member, SPEC_LIMIT, structure_limits, member, relation, number, acceleration_structure)
#define AFTER_BIND(member)                                                                                   \
    LIMIT("structure." #member, SPEC_LIMIT, structure_limits, member, AT_LEAST, 500000,                      \
          structure.descriptorBindingAccelerationStructureUpdateAfterBind)
#define PIPELINE(member, relation, number)                                                                   \
    LIMIT("pipeline." #member, SPEC_LIMIT, pipeline_limits, member, relation, number, ray_tracing_pipeline)
#define IMPLIED(label, spec, first, second, third)                                                           \
    {                                                                                                        \
        "limits." label, spec, implication,                                                                  \
            &(const struct implication){AT(first), SIZE(first), AT(second), SIZE(second), AT(third), SIZE(third)}, 0 \
    }
#define FEATURE(label, extension, feature) IMPLIED("features." label, SPEC_FEATURE, extension, extension, feature)
#define EXTENSION(label, extension, needed) IMPLIED("extensions." label, SPEC_EXTENSION, extension, extension, needed)
#define FORMAT(label, name) {"limits.formats." label, SPEC_FORMAT, format, NULL, name}
#define SIZES(label, bits)                                                                                   \
    {"limits.sizes.triangles" label, SPEC_GROWTH, growth,                                                    \
     &(const struct growth){VK_GEOMETRY_TYPE_TRIANGLES_KHR, VK_INDEX_TYPE_NONE_KHR, false}, bits},           \
        {"limits.sizes.triangles_uint16" label, SPEC_GROWTH, growth,                                         \
         &(const struct growth){VK_GEOMETRY_TYPE_TRIANGLES_KHR, VK_INDEX_TYPE_UINT16, false}, bits},         \
        {"limits.sizes.triangles_uint32" label, SPEC_GROWTH, growth,                                         \
         &(const struct growth){VK_GEOMETRY_TYPE_TRIANGLES_KHR, VK_INDEX_TYPE_UINT32, false}, bits},         \
        {"limits.sizes.boxes" label, SPEC_GROWTH, growth,                                                    \
         &(const struct growth){VK_GEOMETRY_TYPE_AABBS_KHR, VK_INDEX_TYPE_NONE_KHR, false}, bits},           \
        {"limits.sizes.instances" label, SPEC_GROWTH, growth,                                                \
         &(const struct growth){VK_GEOMETRY_TYPE_INSTANCES_KHR, VK_INDEX_TYPE_NONE_KHR, false}, bits},       \
        {"limits.sizes.geometries_of_triangles" label, SPEC_GROWTH, growth,                                  \
         &(const struct growth){VK_GEOMETRY_TYPE_TRIANGLES_KHR, VK_INDEX_TYPE_UINT32, true}, bits},          \
        {"limits.sizes.geometries_of_boxes" label, SPEC_GROWTH, growth,                                      \
         &(const struct growth){VK_GEOMETRY_TYPE_AABBS_KHR, VK_INDEX_TYPE_NONE_KHR, true}, bits},            \
        {"limits.ignored.triangles" label, SPEC_IGNORED, ignored,                                            \
         &(const struct growth){VK_GEOMETRY_TYPE_TRIANGLES_KHR, VK_INDEX_TYPE_UINT32, false}, bits},         \
        {"limits.ignored.boxes" label, SPEC_IGNORED, ignored,                                                \
         &(const struct growth){VK_GEOMETRY_TYPE_AABBS_KHR, VK_INDEX_TYPE_NONE_KHR, false}, bits},           \
    {                                                                                                        \
        "limits.ignored.instances" label, SPEC_IGNORED, ignored,                                             \
            &(const struct growth){VK_GEOMETRY_TYPE_INSTANCES_KHR, VK_INDEX_TYPE_NONE_KHR, false}, bits      \
    }

static const struct gn_case cases[] = {
    STRUCTURE(maxGeometryCount, AT_LEAST, (1u << 24) - 1),
    STRUCTURE(maxInstanceCount, AT_LEAST, (1u << 24) - 1),
    STRUCTURE(maxPrimitiveCount, AT_LEAST, (1u << 29) - 1),
    LIMIT("structure.maxGeometryCount_32_bits", SPEC_32_BITS, structure_limits, maxGeometryCount, AT_MOST, UINT32_MAX,
          acceleration_structure),
    LIMIT("structure.maxInstanceCount_32_bits", SPEC_32_BITS, structure_limits, maxInstanceCount, AT_MOST, UINT32_MAX,
          acceleration_structure),
    LIMIT("structure.maxPrimitiveCount_32_bits", SPEC_32_BITS, structure_limits, maxPrimitiveCount, AT_MOST, UINT32_MAX,
          acceleration_structure),
    STRUCTURE(maxPerStageDescriptorAccelerationStructures, AT_LEAST, 16),
    STRUCTURE(maxDescriptorSetAccelerationStructures, AT_LEAST, 16),
    AFTER_BIND(maxPerStageDescriptorUpdateAfterBindAccelerationStructures),
    AFTER_BIND(maxDescriptorSetUpdateAfterBindAccelerationStructures),
    {"limits.structure.per_stage_after_bind", SPEC_AFTER_BIND, pair,
     &(const struct pair){AT(structure_limits.maxPerStageDescriptorUpdateAfterBindAccelerationStructures),
                          AT(structure_limits.maxPerStageDescriptorAccelerationStructures)},
     0},
    {"limits.structure.per_set_after_bind", SPEC_AFTER_BIND, pair,
     &(const struct pair){AT(structure_limits.maxDescriptorSetUpdateAfterBindAccelerationStructures),
                          AT(structure_limits.maxDescriptorSetAccelerationStructures)},
     0},
    STRUCTURE(minAccelerationStructureScratchOffsetAlignment, AT_MOST, 256),
    LIMIT("structure.minAccelerationStructureScratchOffsetAlignment_power", SPEC_POWER, structure_limits,
          minAccelerationStructureScratchOffsetAlignment, POWER_OF_TWO, 256, acceleration_structure),
    PIPELINE(shaderGroupHandleSize, EXACTLY, 32),
    PIPELINE(maxRayRecursionDepth, AT_LEAST, 1),
    PIPELINE(maxShaderGroupStride, AT_LEAST, 4096),
    PIPELINE(shaderGroupBaseAlignment, AT_MOST, 64),
    PIPELINE(shaderGroupHandleCaptureReplaySize, AT_MOST, 64),
    PIPELINE(maxRayDispatchInvocationCount, AT_LEAST, 1u << 30),
    PIPELINE(shaderGroupHandleAlignment, AT_MOST, 32),
    LIMIT("pipeline.shaderGroupHandleAlignment_power", SPEC_POWER, pipeline_limits, shaderGroupHandleAlignment,
          POWER_OF_TWO, 32, ray_tracing_pipeline),
    PIPELINE(maxRayHitAttributeSize, AT_LEAST, 32),
    FEATURE("accelerationStructure", acceleration_structure, structure.accelerationStructure),
    FEATURE("bufferDeviceAddress", acceleration_structure, address.bufferDeviceAddress),
    IMPLIED("features.descriptorBindingAccelerationStructureUpdateAfterBind", SPEC_FEATURE, acceleration_structure,
            descriptor_indexing, structure.descriptorBindingAccelerationStructureUpdateAfterBind),
    FEATURE("rayQuery", ray_query, query.rayQuery),
    FEATURE("rayTracingPipeline", ray_tracing_pipeline, pipeline.rayTracingPipeline),
    FEATURE("rayTracingPipelineTraceRaysIndirect", ray_tracing_pipeline, pipeline.rayTracingPipelineTraceRaysIndirect),
    IMPLIED("features.rayTraversalPrimitiveCulling", SPEC_FEATURE, ray_tracing_pipeline, ray_query,
            pipeline.rayTraversalPrimitiveCulling),
    IMPLIED("features.capture_replay_mixed", SPEC_MIXED,
            pipeline.rayTracingPipelineShaderGroupHandleCaptureReplayMixed,
            pipeline.rayTracingPipelineShaderGroupHandleCaptureReplayMixed,
            pipeline.rayTracingPipelineShaderGroupHandleCaptureReplay),
    FEATURE("rayTracingMaintenance1", maintenance1, maintenance1_features.rayTracingMaintenance1),
    FEATURE("rayTracingPositionFetch", position_fetch, position_fetch_features.rayTracingPositionFetch),
    EXTENSION("acceleration_structure", acceleration_structure, deferred_host_operations),
    EXTENSION("ray_query", ray_query, acceleration_structure),
    EXTENSION("ray_query_spirv", ray_query, spirv_1_4),
    EXTENSION("ray_tracing_pipeline", ray_tracing_pipeline, acceleration_structure),
    EXTENSION("ray_tracing_pipeline_spirv", ray_tracing_pipeline, spirv_1_4),
    EXTENSION("maintenance1", maintenance1, acceleration_structure),
    EXTENSION("position_fetch", position_fetch, acceleration_structure),
    FORMAT("r32g32_sfloat", VK_FORMAT_R32G32_SFLOAT),
    FORMAT("r32g32b32_sfloat", VK_FORMAT_R32G32B32_SFLOAT),
    FORMAT("r16g16_sfloat", VK_FORMAT_R16G16_SFLOAT),
    FORMAT("r16g16b16a16_sfloat", VK_FORMAT_R16G16B16A16_SFLOAT),
    FORMAT("r16g16_snorm", VK_FORMAT_R16G16_SNORM),
    FORMAT("r16g16b16a16_snorm", VK_FORMAT_R16G16B16A16_SNORM),
    SIZES("", 0),
    SIZES(".update", VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR),
    SIZES(".compaction", VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR),
    SIZES(".update_compaction", VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR |
                                    VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR),
};
const struct gn_case_family gn_family_limits = {"limits", cases, sizeof cases / sizeof cases[0]};
