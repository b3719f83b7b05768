/* SPDX-License-Identifier: Apache-2.0 */
/* Ray queries in other stages than compute, or otherwise: what they answer does not depend on where they are asked. */
#include "cts/sample.h"

#define SPEC                                                                                                 \
    "ray queries give the same in every stage (SPIR-V: RayQueryKHR capability; Vulkan: Ray Query)"

#define SPEC_PAIRS                                                                                           \
    "each ray query object has a traversal of its own, however calls on several alternate (SPV_KHR_ray_query: " \
    "OpTypeRayQueryKHR)"
#define SPEC_ADDRESS                                                                                         \
    "an acceleration structure can be named by its device address (SPV_KHR_ray_query: " \
    "OpConvertUToAccelerationStructureKHR)"

struct params {
    enum gn_cts_entry entry;
    struct gn_sample_options sample;
};

static void stage(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    run->route = (struct gn_cts_route){.entry = params->entry, .record_stride = 1};
    gn_sample_trace(run, &params->sample);
}

#define STAGE(name, entry)                                                                                   \
    {"stages." name ".meshes", SPEC, stage, &(const struct params){entry, {.content = GN_SAMPLE_MESHES}}, 0}, \
        {"stages." name ".not_opaque", SPEC, stage,                                                          \
         &(const struct params){entry, {.content = GN_SAMPLE_NOT_OPAQUE}}, 0},                               \
        {"stages." name ".boxes", SPEC, stage, &(const struct params){entry, {.content = GN_SAMPLE_BOXES}}, 0}, \
        {"stages." name ".mixed", SPEC, stage, &(const struct params){entry, {.content = GN_SAMPLE_MIXED}}, 0}, \
        {"stages." name ".many", SPEC, stage,                                                                \
         &(const struct params){entry, {.content = GN_SAMPLE_MIXED, .rays = 32768}}, 0},                     \
    {                                                                                                        \
        "stages." name ".copied", SPEC, stage,                                                               \
            &(const struct params){entry,                                                                    \
                                   {.content = GN_SAMPLE_MIXED, .steps = {GN_CTS_STEP_CLONE, GN_CTS_STEP_SERIALIZE}}}, \
            0                                                                                                \
    }

#define OTHERWISE(name, spec, entry)                                                                         \
    {"stages." name ".meshes", spec, stage, &(const struct params){entry, {.content = GN_SAMPLE_MESHES}}, 0}, \
        {"stages." name ".not_opaque", spec, stage,                                                          \
         &(const struct params){entry, {.content = GN_SAMPLE_NOT_OPAQUE}}, 0},                               \
    {                                                                                                        \
        "stages." name ".mixed", spec, stage, &(const struct params){entry, {.content = GN_SAMPLE_MIXED}}, 0  \
    }

static const struct gn_case cases[] = {
    STAGE("vertex", GN_CTS_QUERY_IN_VERTEX),
    STAGE("fragment", GN_CTS_QUERY_IN_FRAGMENT),
    STAGE("raygen", GN_CTS_QUERY_IN_RAYGEN),
    STAGE("closest_hit", GN_CTS_QUERY_IN_HIT),
    OTHERWISE("pairs", SPEC_PAIRS, GN_CTS_QUERY_IN_PAIRS),
    OTHERWISE("by_address", SPEC_ADDRESS, GN_CTS_QUERY_BY_ADDRESS),
};
const struct gn_case_family gn_family_stages = {"stages", cases, sizeof cases / sizeof cases[0]};
