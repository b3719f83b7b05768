/* SPDX-License-Identifier: Apache-2.0 */
/* Rules about what a build reads, and about builds of one command that get in each other's way. */
#include "checks/rules/rules.h"

extern const struct gn_rule gn_rule_input_beyond_buffer, gn_rule_input_beyond_max_vertex, gn_rule_build_same_target,
    gn_rule_build_same_scratch;

static bool multiply(uint64_t a, uint64_t b, uint64_t *out)
{
    *out = a * b;
    return !a || *out / a == b;
}

static bool add(uint64_t a, uint64_t b, uint64_t *out)
{
    *out = a + b;
    return *out >= a;
}

/* The first address after the array; false if it does not fit into 64 bits. */
static bool end_of(const struct gn_input *input, uint64_t *out)
{
    uint64_t begin, span;
    return multiply(input->count - 1, input->stride, &span) && add(span, input->element_size, &span) &&
           add(input->address, input->offset, &begin) && add(begin, span, out);
}

static uint64_t place_of(const struct gn_input *input)
{
    uint64_t hash = (uint64_t)input->info << 32 | input->geometry;
    for (const char *c = input->what; *c; c++)
        hash = hash * 31 + (unsigned char)*c;
    return hash;
}

static void input_beyond_buffer(const struct gn_input *input, struct gn_report *report)
{
    uint64_t end = 0;
    if (!input->count || !input->buffer_size)
        return;
    bool fits = end_of(input, &end);
    uint64_t buffer_end = input->buffer_address + input->buffer_size;
    if (fits && end <= buffer_end)
        return;
    uint64_t site = gn_report_site(report, input->target_id, place_of(input));
    if (!gn_report_is_new(report, site))
        return;
    char target[256];
    gn_report_add(report, site, &input->target, 1,
                  "%s of pInfos[%u].pGeometries[%u], for %s, holds %llu elements of %llu bytes, %llu apart, from 0x%llx + %llu: they "
                  "end %s 0x%llx, but the buffer in which they begin ends at 0x%llx. Found in %s.",
                  input->what, input->info, input->geometry, gn_object_describe(&input->target, target, sizeof target),
                  (unsigned long long)input->count, (unsigned long long)input->element_size, (unsigned long long)input->stride,
                  (unsigned long long)input->address, (unsigned long long)input->offset, fits ? "at" : "beyond 2^64, at",
                  (unsigned long long)end, (unsigned long long)buffer_end, input->place ? input->place : "a build");
}

const struct gn_rule gn_rule_input_beyond_buffer = {
    .id = "inputs.beyond_buffer",
    .title = "Build input that runs out of its buffer",
    .text = "What a build reads, by the counts, offsets and strides that it is given, lies within the buffer in which it begins: "
            "indices, vertices without indices, boxes, instances and transforms. Vertices behind indices are not counted.",
    .remedy = "Check primitiveCount, primitiveOffset (in bytes), firstVertex and the stride against the size of the buffer.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03804",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03806",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03808",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03811",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03813", "WR-073", "DE-054"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_INPUT,
    .test.input = input_beyond_buffer,
};

static void input_beyond_max_vertex(const struct gn_input *input, struct gn_report *report)
{
    if (!input->bound || input->count <= input->bound)
        return;
    uint64_t site = gn_report_site(report, input->target_id, place_of(input));
    if (!gn_report_is_new(report, site))
        return;
    char target[256];
    gn_report_add(report, site, &input->target, 1,
                  "pInfos[%u].pGeometries[%u], for %s, reads %llu vertices, but maxVertex announces %llu. Found in %s.", input->info,
                  input->geometry, gn_object_describe(&input->target, target, sizeof target), (unsigned long long)input->count,
                  (unsigned long long)input->bound, input->place ? input->place : "a build");
}

const struct gn_rule gn_rule_input_beyond_max_vertex = {
    .id = "inputs.beyond_max_vertex",
    .title = "More vertices read than announced",
    .text = "Triangles without indices read three vertices each, and no more in all than maxVertex + 1.",
    .remedy = "maxVertex is the highest vertex index, for the size query and the build alike: 3 * primitiveCount - 1 or more.",
    .sources = {"VUID-VkAccelerationStructureBuildRangeInfoKHR-vertexData-10418"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_INPUT,
    .test.input = input_beyond_max_vertex,
};

static void build_same_target(const struct gn_clash *clash, struct gn_report *report)
{
    if (clash->kind == GN_CLASH_SCRATCH)
        return;
    uint64_t site = gn_report_site(report, clash->first_id, clash->second_id);
    if (!gn_report_is_new(report, site))
        return;
    char first[256], second[256];
    struct gn_object objects[] = {clash->first_target, clash->second_target};
    const char *place = clash->place ? clash->place : "a build";
    gn_object_describe(&objects[0], first, sizeof first);
    gn_object_describe(&objects[1], second, sizeof second);
    if (clash->kind == GN_CLASH_TARGETS)
        gn_report_add(report, site, objects, 1, "pInfos[%u] and pInfos[%u] both write %s: nothing orders them. Found in %s.",
                      clash->first, clash->second, first, place);
    else
        gn_report_add(report, site, objects, 2,
                      "pInfos[%u] updates %s from %s, which pInfos[%u] writes: nothing orders them. Found in %s.", clash->second,
                      second, first, clash->first, place);
}

const struct gn_rule gn_rule_build_same_target = {
    .id = "build.same_target",
    .title = "Two builds of one command on one structure",
    .text = "The builds of one command run in any order, also at once. A structure is written by one of them, and then it is not what "
            "another one of them updates from.",
    .remedy = "Put the builds into two commands with a barrier between them.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-dstAccelerationStructure-03698",
                "VUID-vkCmdBuildAccelerationStructuresKHR-dstAccelerationStructure-03702",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03403"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_CLASH,
    .test.clash = build_same_target,
};

static void build_same_scratch(const struct gn_clash *clash, struct gn_report *report)
{
    if (clash->kind != GN_CLASH_SCRATCH)
        return;
    uint64_t site = gn_report_site(report, clash->first_id, clash->second_id);
    if (!gn_report_is_new(report, site))
        return;
    char first[256], second[256];
    struct gn_object objects[] = {clash->first_target, clash->second_target};
    gn_report_add(report, site, objects, 2,
                  "pInfos[%u] (%s) and pInfos[%u] (%s) have the same scratch address 0x%llx, and both need scratch memory. Found in "
                  "%s.",
                  clash->first, gn_object_describe(&objects[0], first, sizeof first), clash->second,
                  gn_object_describe(&objects[1], second, sizeof second), (unsigned long long)clash->address,
                  clash->place ? clash->place : "a build");
}

const struct gn_rule gn_rule_build_same_scratch = {
    .id = "build.same_scratch",
    .title = "Two builds of one command with the same scratch memory",
    .text = "The builds of one command run at once, so each has scratch memory of its own.",
    .remedy = "Give each build its own part of the scratch buffer, or put the builds into two commands with a barrier between them.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-scratchData-03704"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_CLASH,
    .test.clash = build_same_scratch,
};
