/* SPDX-License-Identifier: Apache-2.0 */
/* Rules about numbers that the API bounds, and about what builds read from memory. */
#include "tests/rules/contents.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "checks/rules/geometry.h"
#include "checks/rules/rules.h"

struct heard {
    unsigned findings;
    char first[2048];
};

static void hear(void *context, uint64_t site, const struct gn_finding *finding)
{
    struct heard *heard = context;
    (void)site;
    if (!heard->findings++)
        snprintf(heard->first, sizeof heard->first, "%s", finding->message);
}

static struct gn_report report_of(const char *rule, struct heard *heard)
{
    struct gn_report report = {.profile = GN_PROFILE_VULKAN, .context = heard, .finding = hear};
    for (size_t i = 0; i < gn_rules_count(); i++)
        if (strcmp(gn_rules_at(i)->id, rule) == 0)
            gn_rule_set_put(&report.enabled, i, true);
    return report;
}

static int expect(const char *rule, const char *name, unsigned expected, const char *says, const struct heard *heard)
{
    if (heard->findings == expected && (!says || strstr(heard->first, says)))
        return 0;
    print_error("%s, row \"%s\": expected %u findings saying \"%s\", found %u: \"%s\"\n", rule, name, expected, says ? says : "",
                heard->findings, heard->first);
    return 1;
}

struct demand_row {
    const char *rule;
    const char *name;
    enum gn_demand_kind kind;
    unsigned expected;
    const char *says;
};

static const struct demand_row demand_rows[] = {
    {"inputs.misaligned", "an alignment", GN_DEMAND_ALIGNMENT, 1, "a member of pInfos[1].pGeometries[2], for BLAS \"tree\" (0x1), is 0x11 (17), which is no multiple of 16"},
    {"inputs.misaligned", "a limit", GN_DEMAND_LIMIT, 0, NULL},
    {"inputs.limit", "a limit", GN_DEMAND_LIMIT, 1, "is 17, more than a name, which is 16"},
    {"inputs.limit", "an alignment", GN_DEMAND_ALIGNMENT, 0, NULL},
    {"inputs.buffer_usage", "a usage", GN_DEMAND_USAGE, 1, "at address 0x11 lies in buffer 0x7, which was created without a name"},
    {"inputs.buffer_usage", "a limit", GN_DEMAND_LIMIT, 0, NULL},
    {"build.structure_too_small", "a size", GN_DEMAND_STORAGE, 1, "created with 17 bytes, but"},
    {"build.structure_too_small", "scratch", GN_DEMAND_SCRATCH, 0, NULL},
    {"build.scratch_too_small", "scratch", GN_DEMAND_SCRATCH, 1, "leaves 17 bytes to the end of its buffer, but a name for this build is 16"},
    {"build.scratch_too_small", "a size", GN_DEMAND_STORAGE, 0, NULL},
    {"sbt.misaligned", "an alignment", GN_DEMAND_SBT_ALIGNMENT, 1, "a member is 0x11 (17), which is no multiple of a name (16)"},
    {"sbt.misaligned", "of a build", GN_DEMAND_ALIGNMENT, 0, NULL},
    {"sbt.limit", "a limit", GN_DEMAND_SBT_LIMIT, 1, "a member is 17, more than a name, which is 16"},
    {"sbt.limit", "of a build", GN_DEMAND_LIMIT, 0, NULL},
    {"sbt.buffer_usage", "a usage", GN_DEMAND_SBT_USAGE, 1, "a member, 0x11, lies in buffer 0x7, which was created without a name"},
    {"sbt.buffer_usage", "of a build", GN_DEMAND_USAGE, 0, NULL},
    {"sbt.beyond_buffer", "a range", GN_DEMAND_SBT_RANGE, 1, "a member is 16 bytes, but only 17 follow"},
    {"sbt.beyond_buffer", "a limit", GN_DEMAND_SBT_LIMIT, 0, NULL},
    {"sbt.raygen_size", "two records", GN_DEMAND_SBT_RAYGEN, 1, "a member is 17, but the stride is 16"},
    {"sbt.raygen_size", "a range", GN_DEMAND_SBT_RANGE, 0, NULL},
    {"pipeline.recursion_depth", "17 of 16", GN_DEMAND_RECURSION, 1, "was created with a member 17, but maxRayRecursionDepth is 16"},
    {"pipeline.recursion_depth", "a limit", GN_DEMAND_SBT_LIMIT, 0, NULL},
};
#define DEMAND_COUNT (sizeof demand_rows / sizeof demand_rows[0])

/* The geometry of a row: two triangles over four vertices, a transform, and two boxes, then altered. */
struct subject {
    struct gn_geometry_contents contents;
    uint32_t indices[6];
    float vertices[12], transform[12], boxes[12];
};

struct geometry_row {
    const char *rule;
    const char *name;
    unsigned expected;
    const char *says;
    void (*alter)(struct subject *subject);
};

#define ALTER(name, ...)                                                                                               \
    static void name(struct subject *subject)                                                                          \
    {                                                                                                                  \
        struct gn_geometry_contents *contents = &subject->contents;                                                    \
        (void)contents;                                                                                                \
        __VA_ARGS__;                                                                                                   \
    }

static const unsigned char *bytes(const void *data)
{
    return data;
}

ALTER(with_boxes, contents->boxes = bytes(subject->boxes); contents->box_stride = 24; contents->box_count = 2)
ALTER(highest_index, subject->indices[4] = 3)
ALTER(index_4, subject->indices[4] = 4)
ALTER(index_restart, subject->indices[4] = 0xFFFFFFFF)
ALTER(index_4_announced, index_4(subject); contents->max_vertex = 4)
ALTER(no_indices, contents->indices = NULL; contents->max_vertex = 0)
ALTER(index_outside, index_4_announced(subject); contents->vertices_in_buffer = 4)
ALTER(index_at_end, index_4_announced(subject); contents->vertices_in_buffer = 5)
ALTER(short_indices, static const uint16_t few[] = {0, 1, 2, 2, 1, 9}; contents->indices = bytes(few); contents->index_size = 2)
ALTER(byte_indices, static const uint8_t few[] = {0, 1, 2, 2, 1, 3}; contents->indices = bytes(few); contents->index_size = 1)
ALTER(nan_y, subject->vertices[4] = NAN)
ALTER(nan_z_of_last, subject->vertices[11] = NAN)
ALTER(nan_z_unused, subject->vertices[11] = NAN; subject->indices[5] = 0)
ALTER(nan_x, subject->vertices[3] = NAN; subject->vertices[4] = NAN)
ALTER(nan_beyond_the_copy, subject->vertices[11] = NAN; contents->vertex_count = 3)
ALTER(nan_in_padding, subject->vertices[11] = NAN; contents->component_count = 2)
ALTER(nan_in_integers, subject->vertices[4] = NAN; contents->component_count = 0)
ALTER(nan_half, static const uint16_t few[] = {0, 0, 0, 0x3C00, 0x7E00, 0, 0, 0x3C00, 0, 0x3C00, 0x3C00, 0};
      contents->vertices = bytes(few); contents->vertex_stride = 6; contents->component_size = 2)
ALTER(infinite_half, static const uint16_t few[] = {0, 0, 0, 0x3C00, 0x7C00, 0, 0, 0x3C00, 0, 0x3C00, 0x3C00, 0};
      contents->vertices = bytes(few); contents->vertex_stride = 6; contents->component_size = 2)
ALTER(nan_double, static const double few[] = {0, 0, 0, 1, NAN, 0, 0, 1, 0, 1, 1, 0};
      contents->vertices = bytes(few); contents->vertex_stride = 24; contents->component_size = 8)
ALTER(infinite_x, subject->vertices[3] = -INFINITY)
ALTER(infinite_and_inactive, subject->vertices[4] = INFINITY; subject->vertices[0] = subject->vertices[9] = NAN)
ALTER(largest, subject->vertices[3] = 3.402823466e38f)
ALTER(box_flat, with_boxes(subject); subject->boxes[9] = subject->boxes[6])
ALTER(box_inverted, with_boxes(subject); subject->boxes[10] = -1)
ALTER(box_inactive, box_inverted(subject); subject->boxes[6] = NAN)
ALTER(box_max_nan, with_boxes(subject); subject->boxes[11] = NAN)
ALTER(transform_flat, contents->transform = bytes(subject->transform); subject->transform[5] = 0)
ALTER(transform_nan, contents->transform = bytes(subject->transform); subject->transform[6] = NAN)
ALTER(transform_mirror, contents->transform = bytes(subject->transform); subject->transform[0] = -1e-12f)
ALTER(transform_far, contents->transform = bytes(subject->transform); subject->transform[3] = INFINITY)

#define ABOVE "inputs.index_beyond_max_vertex"
#define OUTSIDE "inputs.index_beyond_buffer"

static const struct geometry_row geometry_rows[] = {
    {ABOVE, "as announced", 0, NULL, highest_index},
    {ABOVE, "one above", 1, "index 4 (of triangle 1) of pInfos[1].pGeometries[2], for BLAS \"tree\" (0x1), is 4, but maxVertex is 3; 1 of 6", index_4},
    {ABOVE, "all ones", 1, "is 4294967295, but", index_restart},
    {ABOVE, "announced", 0, NULL, index_4_announced},
    {ABOVE, "16 bits", 1, "index 5 (of triangle 1)", short_indices},
    {ABOVE, "8 bits", 0, NULL, byte_indices},
    {ABOVE, "without indices", 0, NULL, no_indices},
    {OUTSIDE, "behind the buffer", 1, "is 4, but the buffer of vertexData ends after 4 vertices", index_outside},
    {OUTSIDE, "the last one", 0, NULL, index_at_end},
    {OUTSIDE, "not announced either", 0, NULL, index_4},
    {"inputs.nan", "in y", 1, "primitive 0 of", nan_y},
    {"inputs.nan", "in z of the last vertex", 1, "primitive 1 of", nan_z_of_last},
    {"inputs.nan", "of a vertex that nothing uses", 0, NULL, nan_z_unused},
    {"inputs.nan", "inactive", 0, NULL, nan_x},
    {"inputs.nan", "of a vertex that was not read", 0, NULL, nan_beyond_the_copy},
    {"inputs.nan", "what follows two coordinates", 0, NULL, nan_in_padding},
    {"inputs.nan", "integers", 0, NULL, nan_in_integers},
    {"inputs.nan", "16 bits", 1, NULL, nan_half},
    {"inputs.nan", "64 bits", 1, NULL, nan_double},
    {"inputs.nan", "infinite only", 0, NULL, infinite_half},
    {"inputs.nan", "max of a box", 1, "primitive 1 of", box_max_nan},
    {"inputs.nan", "box that is inactive", 0, NULL, box_inactive},
    {"inputs.infinite", "in x", 1, "triangle 0 of", infinite_x},
    {"inputs.infinite", "16 bits", 1, NULL, infinite_half},
    {"inputs.infinite", "of inactive triangles", 0, NULL, infinite_and_inactive},
    {"inputs.infinite", "the largest number", 0, NULL, largest},
    {"inputs.aabb_inverted", "flat", 0, NULL, box_flat},
    {"inputs.aabb_inverted", "inverted", 1, "box 1 of pInfos[1].pGeometries[2], for BLAS \"tree\" (0x1), has min (0 0 0) and max (1 -1 1)", box_inverted},
    {"inputs.aabb_inverted", "inactive", 0, NULL, box_inactive},
    {"inputs.aabb_inverted", "NaN", 0, NULL, box_max_nan},
    {"inputs.transform_singular", "flat", 1, "(1 0 0; 0 0 0; 0 0 1)", transform_flat},
    {"inputs.transform_singular", "not a number", 1, NULL, transform_nan},
    {"inputs.transform_singular", "tiny and mirrored", 0, NULL, transform_mirror},
    {"inputs.transform_singular", "infinitely far away", 0, NULL, transform_far},
};
#define GEOMETRY_COUNT (sizeof geometry_rows / sizeof geometry_rows[0])

static void subject_init(struct subject *subject)
{
    *subject = (struct subject){.indices = {0, 1, 2, 2, 1, 3},
                                .vertices = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0},
                                .transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                                .boxes = {0, 0, 0, 1, 1, 1, 0, 0, 0, 1, 1, 1}};
    subject->contents = (struct gn_geometry_contents){.target = {GN_OBJECT_BLAS, 1, "tree"},
                                                      .target_id = 1,
                                                      .info = 1,
                                                      .geometry = 2,
                                                      .indices = bytes(subject->indices),
                                                      .index_size = 4,
                                                      .index_count = 6,
                                                      .max_vertex = 3,
                                                      .vertices = bytes(subject->vertices),
                                                      .vertex_stride = 12,
                                                      .vertex_count = 4,
                                                      .vertices_in_buffer = UINT64_MAX,
                                                      .component_size = 4,
                                                      .component_count = 3};
}

/* The table of a row: one record of each part that fits, and a TLAS whose offsets do. */
struct sbt_row {
    const char *rule;
    const char *name;
    unsigned expected;
    const char *says;
    void (*alter)(struct gn_sbt *sbt);
};

#define ALTER_SBT(name, ...)                                                                                           \
    static void name(struct gn_sbt *sbt)                                                                               \
    {                                                                                                                  \
        struct gn_sbt_region *raygen = &sbt->regions[GN_SBT_RAYGEN], *hit = &sbt->regions[GN_SBT_HIT];                 \
        (void)raygen, (void)hit;                                                                                       \
        __VA_ARGS__;                                                                                                   \
    }

static void put(struct gn_sbt_region *region, enum gn_sbt_handle handle)
{
    region->count[GN_HANDLE_FITS]--;
    region->count[handle]++;
}

static void two_records(struct gn_sbt_region *region)
{
    region->records = region->read = 2;
    region->count[GN_HANDLE_FITS]++;
}

ALTER_SBT(table_right, (void)sbt)
ALTER_SBT(raygen_zero, put(raygen, GN_HANDLE_NULL))
ALTER_SBT(raygen_unfit, put(raygen, GN_HANDLE_UNFIT); raygen->unfit = "a miss shader")
ALTER_SBT(raygen_foreign, put(raygen, GN_HANDLE_FOREIGN); raygen->foreign = (struct gn_object){GN_OBJECT_PIPELINE, 9, "old"};
          raygen->foreign_gone = true)
ALTER_SBT(raygen_unknown, put(raygen, GN_HANDLE_UNKNOWN))
ALTER_SBT(raygen_unknown_of_none, raygen_unknown(sbt); sbt->runs = false)
ALTER_SBT(raygen_unknown_to_us, raygen_unknown(sbt); sbt->handles_known = false)
ALTER_SBT(raygen_not_read, *raygen = (struct gn_sbt_region){.records = 1})
ALTER_SBT(hit_unfit, put(hit, GN_HANDLE_UNFIT); hit->unfit = "a miss shader")
ALTER_SBT(hit_unknown, put(hit, GN_HANDLE_UNKNOWN))
ALTER_SBT(hit_unknown_beside, two_records(hit); put(hit, GN_HANDLE_UNKNOWN))
ALTER_SBT(hit_unknown_beside_null, two_records(hit); put(hit, GN_HANDLE_UNKNOWN); put(hit, GN_HANDLE_NULL))
ALTER_SBT(hit_read_in_part, hit_unknown(sbt); hit->records = 2)
ALTER_SBT(miss_null, put(&sbt->regions[GN_SBT_MISS], GN_HANDLE_NULL))
ALTER_SBT(miss_null_excluded, miss_null(sbt); sbt->no_null_miss = true)
ALTER_SBT(no_hit_region, *hit = (struct gn_sbt_region){0})
ALTER_SBT(no_hit_region_excluded, no_hit_region(sbt); sbt->no_null_hit = true)
ALTER_SBT(offset_at_end, sbt->record = sbt->instance_offset = 1)
ALTER_SBT(geometry_at_end, sbt->geometry = sbt->ray_stride = 1; sbt->record = 1)
ALTER_SBT(offset_within, two_records(hit); sbt->record = 1)
ALTER_SBT(offset_of_nothing, sbt->record = 1; sbt->tlas.kind = GN_OBJECT_NONE)
ALTER_SBT(offset_at_stride_0, sbt->record = 1; hit->stride = 0)

static const struct sbt_row sbt_rows[] = {
    {"sbt.raygen_handle", "right", 0, NULL, table_right},
    {"sbt.raygen_handle", "zero", 1, "pipeline \"rays\" (0x5) is bound, but the handle in the ray-generation record at 0x1000 is all zero", raygen_zero},
    {"sbt.raygen_handle", "unfit", 1, "belongs to a group of a miss shader", raygen_unfit},
    {"sbt.raygen_handle", "foreign", 1, "belongs to pipeline \"old\" (0x9), which was destroyed", raygen_foreign},
    {"sbt.raygen_handle", "unknown", 1, "was given by no pipeline", raygen_unknown},
    {"sbt.raygen_handle", "of a trace that may not run", 0, NULL, raygen_unknown_of_none},
    {"sbt.raygen_handle", "of a pipeline whose handles are not known", 0, NULL, raygen_unknown_to_us},
    {"sbt.raygen_handle", "not read", 0, NULL, raygen_not_read},
    {"sbt.region_unusable", "right", 0, NULL, table_right},
    {"sbt.region_unusable", "unfit", 1, "none of the 1 records of the hit region at 0x3000 (stride 64)", hit_unfit},
    {"sbt.region_unusable", "unknown", 1, "that of record 0 was given by no pipeline", hit_unknown},
    {"sbt.region_unusable", "beside one that fits", 0, NULL, hit_unknown_beside},
    {"sbt.region_unusable", "beside one without a shader", 0, NULL, hit_unknown_beside_null},
    {"sbt.region_unusable", "read in part", 0, NULL, hit_read_in_part},
    {"sbt.null_group", "no flag", 0, NULL, miss_null},
    {"sbt.null_group", "miss", 1, "NO_NULL_MISS_SHADERS, but the first miss record, at 0x2000, is all zero", miss_null_excluded},
    {"sbt.null_group", "no region, no flag", 0, NULL, no_hit_region},
    {"sbt.null_group", "no region", 1, "but there is no hit region", no_hit_region_excluded},
    {"sbt.hit_beyond_table", "offset 0 of 1", 0, NULL, table_right},
    {"sbt.hit_beyond_table", "offset 1 of 1", 1, "instance 3 of TLAS \"scene\" (0x6) has the shader-binding-table offset 1, and rays", offset_at_end},
    {"sbt.hit_beyond_table", "geometry 1 of 1 record", 1, "a hit on geometry 1 reads record 1, but the hit region of this trace has 1.", geometry_at_end},
    {"sbt.hit_beyond_table", "offset 1 of 2", 0, NULL, offset_within},
    {"sbt.hit_beyond_table", "no TLAS known", 0, NULL, offset_of_nothing},
    {"sbt.hit_beyond_table", "a stride of 0", 0, NULL, offset_at_stride_0},
};
#define SBT_COUNT (sizeof sbt_rows / sizeof sbt_rows[0])

static struct gn_sbt sbt_right(void)
{
    struct gn_sbt sbt = {.place = "a test",
                         .pipeline = {GN_OBJECT_PIPELINE, 5, "rays"},
                         .pipeline_id = 5,
                         .runs = true,
                         .handles_known = true,
                         .tlas = {GN_OBJECT_TLAS, 6, "scene"},
                         .tlas_id = 6,
                         .instance = 3};
    for (int part = GN_SBT_RAYGEN; part <= GN_SBT_HIT; part++)
        sbt.regions[part] = (struct gn_sbt_region){
            .address = 0x1000u * (unsigned)(part + 1), .stride = 64, .records = 1, .read = 1, .count = {[GN_HANDLE_FITS] = 1}};
    return sbt;
}

void contents_rows_run(void **state)
{
    int failures = 0;
    (void)state;
    for (size_t i = 0; i < DEMAND_COUNT; i++) {
        const struct demand_row *row = &demand_rows[i];
        struct heard heard = {.findings = 0};
        struct gn_report report = report_of(row->rule, &heard);
        struct gn_demand demand = {.kind = row->kind, .target = {GN_OBJECT_BLAS, 1, "tree"}, .target_id = 1, .info = 1, .geometry = 2,
                                   .what = "a member", .value = 17, .bound = 16, .buffer = {GN_OBJECT_BUFFER, 7, NULL},
                                   .needs = row->kind == GN_DEMAND_ALIGNMENT ? NULL : "a name"};
        gn_rules_judge_demand(&demand, &report);
        failures += expect(row->rule, row->name, row->expected, row->says, &heard);
    }
    for (size_t i = 0; i < GEOMETRY_COUNT; i++) {
        const struct geometry_row *row = &geometry_rows[i];
        struct heard heard = {.findings = 0};
        struct gn_report report = report_of(row->rule, &heard);
        struct subject subject;
        subject_init(&subject);
        row->alter(&subject);
        gn_rules_judge_geometry(&subject.contents, &report);
        failures += expect(row->rule, row->name, row->expected, row->says, &heard);
    }
    for (size_t i = 0; i < SBT_COUNT; i++) {
        const struct sbt_row *row = &sbt_rows[i];
        struct heard heard = {.findings = 0};
        struct gn_report report = report_of(row->rule, &heard);
        struct gn_sbt sbt = sbt_right();
        row->alter(&sbt);
        gn_rules_judge_sbt(&sbt, &report);
        failures += expect(row->rule, row->name, row->expected, row->says, &heard);
    }
    assert_int_equal(failures, 0);
}

void contents_rows_count(const char *rule, int *firing, int *silent)
{
    for (size_t i = 0; i < DEMAND_COUNT; i++)
        if (strcmp(demand_rows[i].rule, rule) == 0)
            demand_rows[i].expected ? ++*firing : ++*silent;
    for (size_t i = 0; i < GEOMETRY_COUNT; i++)
        if (strcmp(geometry_rows[i].rule, rule) == 0)
            geometry_rows[i].expected ? ++*firing : ++*silent;
    for (size_t i = 0; i < SBT_COUNT; i++)
        if (strcmp(sbt_rows[i].rule, rule) == 0)
            sbt_rows[i].expected ? ++*firing : ++*silent;
}
