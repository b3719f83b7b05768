/* SPDX-License-Identifier: Apache-2.0 */
/* The pass over what a BLAS build reads, and the rules about it. */
#include "checks/rules/geometry.h"

#include <string.h>

#include "checks/rules/rules.h"

extern const struct gn_rule gn_rule_geometry_index_above, gn_rule_geometry_index_outside, gn_rule_geometry_nan,
    gn_rule_geometry_infinite, gn_rule_geometry_box_inverted, gn_rule_geometry_transform_singular;

/* How a vertex is: the worst of its coordinates, unless the first is NaN. */
enum state { FINITE, INFINITE, NOT_A_NUMBER, INACTIVE };

static enum state component_state(const unsigned char *at, uint32_t size)
{
    uint64_t bits = 0, exponent, mantissa;
    if (size == 4) {
        uint32_t word;
        memcpy(&word, at, sizeof word);
        bits = word;
        exponent = 0x7F800000u;
        mantissa = 0x007FFFFFu;
    } else if (size == 8) {
        memcpy(&bits, at, sizeof bits);
        exponent = UINT64_C(0x7FF) << 52;
        mantissa = (UINT64_C(1) << 52) - 1;
    } else {
        uint16_t half;
        memcpy(&half, at, sizeof half);
        bits = half;
        exponent = 0x7C00;
        mantissa = 0x03FF;
    }
    return (bits & exponent) != exponent ? FINITE : bits & mantissa ? NOT_A_NUMBER : INFINITE;
}

static enum state state_of(const unsigned char *at, uint32_t size, uint32_t count)
{
    enum state worst = component_state(at, size);
    if (worst == NOT_A_NUMBER)
        return INACTIVE;
    for (uint32_t i = 1; i < count; i++) {
        enum state state = component_state(at + (uint64_t)i * size, size);
        worst = state > worst ? state : worst;
    }
    return worst;
}

static uint32_t index_at(const struct gn_geometry_contents *contents, uint64_t i)
{
    const unsigned char *at = contents->indices + i * contents->index_size;
    uint32_t word;
    uint16_t half;
    switch (contents->index_size) {
    case 1: return *at;
    case 2: memcpy(&half, at, sizeof half); return half;
    default: memcpy(&word, at, sizeof word); return word;
    }
}

static void note(struct gn_survey_class *out, uint64_t index)
{
    if (!out->count++)
        out->first = (uint32_t)index;
}

static bool any_unusual(const struct gn_geometry_contents *contents)
{
    for (uint64_t v = 0; v < contents->vertex_count; v++)
        if (state_of(contents->vertices + v * contents->vertex_stride, contents->component_size, contents->component_count) != FINITE)
            return true;
    return false;
}

static void survey_indices(const struct gn_geometry_contents *contents, struct gn_geometry_survey *out)
{
    uint32_t highest = 0;
    for (uint64_t i = 0; i < contents->index_count; i++) {
        uint32_t index = index_at(contents, i);
        highest = index > highest ? index : highest;
    }
    /* Nearly always there is nothing to find. */
    if (highest <= contents->max_vertex && highest < contents->vertices_in_buffer)
        return;
    for (uint64_t i = 0; i < contents->index_count; i++) {
        uint32_t index = index_at(contents, i);
        if (index > contents->max_vertex) {
            note(&out->index_above, i);
            if (out->index_above.count == 1)
                out->index_above_value = index;
        } else if (index >= contents->vertices_in_buffer) {
            note(&out->index_outside, i);
            if (out->index_outside.count == 1)
                out->index_outside_value = index;
        }
    }
}

static void survey_triangles(const struct gn_geometry_contents *contents, struct gn_geometry_survey *out)
{
    if (contents->indices)
        survey_indices(contents, out);
    if (!contents->vertices || !contents->component_count || !any_unusual(contents))
        return;
    for (uint64_t triangle = 0; triangle < contents->index_count / 3; triangle++) {
        enum state worst = FINITE;
        for (uint64_t i = triangle * 3; i < triangle * 3 + 3; i++) {
            uint64_t index = contents->indices ? index_at(contents, i) : i;
            enum state state = index >= contents->vertex_count
                                   ? FINITE
                                   : state_of(contents->vertices + index * contents->vertex_stride, contents->component_size,
                                              contents->component_count);
            worst = state > worst ? state : worst;
        }
        if (worst == NOT_A_NUMBER)
            note(&out->nan, triangle);
        else if (worst == INFINITE)
            note(&out->infinite, triangle);
    }
}

static void survey_boxes(const struct gn_geometry_contents *contents, struct gn_geometry_survey *out)
{
    for (uint64_t b = 0; b < contents->box_count; b++) {
        const unsigned char *at = contents->boxes + b * contents->box_stride;
        float box[6];
        memcpy(box, at, sizeof box);
        if (box[0] <= box[3] && box[1] <= box[4] && box[2] <= box[5])
            continue;
        enum state state = state_of(at, 4, 6);
        if (state == NOT_A_NUMBER)
            note(&out->nan, b);
        else if (state != INACTIVE)
            note(&out->inverted, b);
    }
}

void gn_geometry_survey(const struct gn_geometry_contents *contents, struct gn_geometry_survey *out)
{
    *out = (struct gn_geometry_survey){.bad_transform = false};
    if (contents->boxes)
        survey_boxes(contents, out);
    else
        survey_triangles(contents, out);
    if (contents->transform) {
        float matrix[12];
        bool finite = true;
        memcpy(matrix, contents->transform, sizeof matrix);
        for (uint32_t i = 0; i < 12; i++)
            finite &= i % 4 == 3 || component_state(contents->transform + (uint64_t)i * 4, 4) == FINITE;
        out->bad_transform = !finite || gn_transform_orientation_exact(matrix) == 0;
    }
}

static bool begin(const struct gn_geometry_contents *contents, struct gn_report *report, bool found, uint64_t *out_site)
{
    if (!found)
        return false;
    *out_site = gn_report_site(report, contents->target_id, (uint64_t)contents->info << 32 | contents->geometry);
    return gn_report_is_new(report, *out_site);
}

static const char *place_of(const struct gn_geometry_contents *contents)
{
    return contents->place ? contents->place : "a build";
}

static void index_above(const struct gn_geometry_contents *contents, struct gn_report *report)
{
    const struct gn_geometry_survey *survey = report->geometry;
    uint64_t site;
    char target[256];
    if (!begin(contents, report, survey->index_above.count, &site))
        return;
    gn_report_add(report, site, &contents->target, 1,
                  "index %u (of triangle %u) of pInfos[%u].pGeometries[%u], for %s, is %u, but maxVertex is %u; %u of %llu indices read "
                  "are above it. Found in %s.",
                  survey->index_above.first, survey->index_above.first / 3, contents->info, contents->geometry,
                  gn_object_describe(&contents->target, target, sizeof target), survey->index_above_value, contents->max_vertex,
                  survey->index_above.count, (unsigned long long)contents->index_count, place_of(contents));
}

const struct gn_rule gn_rule_geometry_index_above = {
    .id = "inputs.index_beyond_max_vertex",
    .title = "Vertex index above maxVertex",
    .text = "Every index of a geometry, as it lies in memory when the build runs, is at most maxVertex.",
    .remedy = "Write indices that stand for vertices that exist, or raise maxVertex for the size query and the build alike: it is the "
              "highest index, not the number of vertices.",
    .sources = {"VUID-VkAccelerationStructureBuildRangeInfoKHR-vertexData-10418", "WR-066", "WR-069"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_GEOMETRY,
    .test.geometry = index_above,
};

static void index_outside(const struct gn_geometry_contents *contents, struct gn_report *report)
{
    const struct gn_geometry_survey *survey = report->geometry;
    uint64_t site;
    char target[256];
    if (!begin(contents, report, survey->index_outside.count, &site))
        return;
    gn_report_add(report, site, &contents->target, 1,
                  "index %u (of triangle %u) of pInfos[%u].pGeometries[%u], for %s, is %u, but the buffer of vertexData ends after %llu "
                  "vertices; so do %u of %llu indices read. Found in %s.",
                  survey->index_outside.first, survey->index_outside.first / 3, contents->info, contents->geometry,
                  gn_object_describe(&contents->target, target, sizeof target), survey->index_outside_value,
                  (unsigned long long)contents->vertices_in_buffer, survey->index_outside.count,
                  (unsigned long long)contents->index_count, place_of(contents));
}

const struct gn_rule gn_rule_geometry_index_outside = {
    .id = "inputs.index_beyond_buffer",
    .title = "Vertex index beyond the vertex buffer",
    .text = "Every vertex that an index stands for lies in the buffer in which vertexData begins, firstVertex and vertexStride counted.",
    .remedy = "Check the indices, firstVertex and vertexStride against the size of the vertex buffer.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03804", "WR-063", "WR-069"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_GEOMETRY,
    .test.geometry = index_outside,
};

static void nan_found(const struct gn_geometry_contents *contents, struct gn_report *report)
{
    const struct gn_survey_class *found = &report->geometry->nan;
    uint64_t site;
    char target[256];
    if (!begin(contents, report, found->count, &site))
        return;
    gn_report_add(report, site, &contents->target, 1,
                  "primitive %u of pInfos[%u].pGeometries[%u], for %s, has a coordinate that is NaN while its first one is not (%u such "
                  "primitives). Found in %s.",
                  found->first, contents->info, contents->geometry, gn_object_describe(&contents->target, target, sizeof target),
                  found->count, place_of(contents));
}

const struct gn_rule gn_rule_geometry_nan = {
    .id = "inputs.nan",
    .title = "Coordinate that is not a number",
    .text = "A primitive is inactive if the first coordinate of a vertex (of a box: minX) is NaN. If any other coordinate of an active "
            "primitive is NaN, what the build does is undefined.",
    .remedy = "Find what computed the coordinate; to make a primitive inactive, write NaN to the first coordinate.",
    .sources = {"Vulkan: Inactive Primitives and Instances"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_GEOMETRY,
    .test.geometry = nan_found,
};

static void infinite_found(const struct gn_geometry_contents *contents, struct gn_report *report)
{
    const struct gn_survey_class *found = &report->geometry->infinite;
    uint64_t site;
    char target[256];
    if (!begin(contents, report, found->count, &site))
        return;
    gn_report_add(report, site, &contents->target, 1,
                  "triangle %u of pInfos[%u].pGeometries[%u], for %s, has an infinite coordinate (%u such triangles). Found in %s.",
                  found->first, contents->info, contents->geometry, gn_object_describe(&contents->target, target, sizeof target),
                  found->count, place_of(contents));
}

const struct gn_rule gn_rule_geometry_infinite = {
    .id = "inputs.infinite",
    .title = "Infinite coordinate of a triangle",
    .text = "The specification does not say what an infinite coordinate of a triangle means: drivers differ in what rays hit, and the bounds of "
            "the triangle slow every ray down.",
    .remedy = "Clamp the coordinate; to make a triangle inactive, write NaN to the first coordinate of a vertex.",
    .sources = {"Vulkan: Inactive Primitives and Instances"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_NOTE),
    .on = GN_RULE_ON_GEOMETRY,
    .test.geometry = infinite_found,
};

static void box_inverted(const struct gn_geometry_contents *contents, struct gn_report *report)
{
    const struct gn_survey_class *found = &report->geometry->inverted;
    uint64_t site;
    char target[256];
    float box[6];
    if (!begin(contents, report, found->count, &site))
        return;
    memcpy(box, contents->boxes + found->first * contents->box_stride, sizeof box);
    gn_report_add(report, site, &contents->target, 1,
                  "box %u of pInfos[%u].pGeometries[%u], for %s, has min (%g %g %g) and max (%g %g %g); %u boxes have a min above their max. "
                  "Found in %s.",
                  found->first, contents->info, contents->geometry, gn_object_describe(&contents->target, target, sizeof target),
                  (double)box[0], (double)box[1], (double)box[2], (double)box[3], (double)box[4], (double)box[5], found->count,
                  place_of(contents));
}

const struct gn_rule gn_rule_geometry_box_inverted = {
    .id = "inputs.aabb_inverted",
    .title = "Box whose min is above its max",
    .text = "In every active box, minX <= maxX, minY <= maxY and minZ <= maxZ.",
    .remedy = "Swap the bounds; to make a box inactive, write NaN to minX.",
    .sources = {"VUID-VkAabbPositionsKHR-minX-03546", "VUID-VkAabbPositionsKHR-minY-03547", "VUID-VkAabbPositionsKHR-minZ-03548",
                "WR-070"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_GEOMETRY,
    .test.geometry = box_inverted,
};

static void transform_singular(const struct gn_geometry_contents *contents, struct gn_report *report)
{
    uint64_t site;
    char target[256];
    float m[12];
    if (!begin(contents, report, report->geometry->bad_transform, &site))
        return;
    memcpy(m, contents->transform, sizeof m);
    gn_report_add(report, site, &contents->target, 1,
                  "the transform of pInfos[%u].pGeometries[%u], for %s, has no inverse: the 3x3 matrix (%g %g %g; %g %g %g; %g %g %g) is not "
                  "finite or has the determinant 0, exactly. Found in %s.",
                  contents->info, contents->geometry, gn_object_describe(&contents->target, target, sizeof target), (double)m[0],
                  (double)m[1], (double)m[2], (double)m[4], (double)m[5], (double)m[6], (double)m[8], (double)m[9], (double)m[10],
                  place_of(contents));
}

const struct gn_rule gn_rule_geometry_transform_singular = {
    .id = "inputs.transform_singular",
    .title = "Geometry transform without inverse",
    .text = "The first three columns of a geometry's transform define an invertible 3x3 matrix. The determinant is computed exactly.",
    .remedy = "Give the geometry an invertible transform, or leave it out of the build.",
    .sources = {"VUID-VkTransformMatrixKHR-matrix-03799"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_GEOMETRY,
    .test.geometry = transform_singular,
};
