/* SPDX-License-Identifier: Apache-2.0 */
/* Every rule over plain values: a row that fires beside a row that stays silent. A rule of the catalogue that lacks either
 * fails here. */
#include "checks/rules/instance.h"
#include "checks/rules/rules.h"
#include "checks/rules/survey.h"
#include "tests/rules/contents.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#define MAX_INSTANCES 4
#define MAX_STRUCTURES 3
#define NULL_REF GN_REFERENCE_NULL
#define UNKNOWN GN_REFERENCE_UNKNOWN

/* The build of a row: filled with what is valid, then altered by the row. */
struct subject {
    struct gn_tlas_build build;
    struct gn_structure structures[MAX_STRUCTURES];
    struct gn_instance_record records[MAX_INSTANCES];
};

struct row {
    const char *rule;
    const char *name;
    const char *why;
    uint32_t expected; /* findings */
    uint32_t instance_count;
    uint32_t refers_to[MAX_INSTANCES];
    uint32_t structure_count;
    enum gn_built built[MAX_STRUCTURES];
    const char *says; /* part of the first message */
    void (*alter)(struct subject *subject);
};

static void same_call(struct subject *subject)
{
    subject->structures[1].same_call = true;
}

static void destroyed(struct subject *subject)
{
    subject->structures[1].destroyed = subject->structures[1].same_call = true;
}

static void unsure(struct subject *subject)
{
    subject->build.references_sure = false;
}

static void odd_address(struct subject *subject)
{
    subject->records[0].reference = 0x1234;
}

static void is_top(struct subject *subject)
{
    subject->structures[1].is_top = true;
}

static void flag_0x10(struct subject *subject)
{
    subject->records[1].sbt_offset_and_flags = 0x12FFFFFF;
}

static void flag_0x10_defined(struct subject *subject)
{
    flag_0x10(subject);
    subject->build.valid_flags = 0x3F;
}

static void set_matrix(struct subject *subject, const float rows[9])
{
    for (int i = 0; i < 9; i++)
        subject->records[1].object_to_world[i / 3 * 4 + i % 3] = rows[i];
}

static void matrix_zero(struct subject *subject)
{
    set_matrix(subject, (const float[9]){0});
}

/* The third row is the sum of the others, with magnitudes that rounding would not survive. */
static void matrix_dependent(struct subject *subject)
{
    set_matrix(subject, (const float[9]){0x1p60f, 3, 0x1p-60f, 0x1.8p60f, 7, 0x1p-61f, 0x1.4p61f, 10, 0x1.8p-60f});
}

/* The same but for the last bit of one element. */
static void matrix_nearly_dependent(struct subject *subject)
{
    set_matrix(subject, (const float[9]){0x1p60f, 3, 0x1p-60f, 0x1.8p60f, 7, 0x1p-61f, 0x1.4p61f, 10, 0x1.800002p-60f});
}

static void matrix_denormal(struct subject *subject)
{
    set_matrix(subject, (const float[9]){0x1p-149f, 0, 0, 0, 0x1p-149f, 0, 0, 0, 0x1p-149f});
}

static void matrix_huge(struct subject *subject)
{
    set_matrix(subject, (const float[9]){0x1p127f, 0, 0, 0, 0x1p127f, 0, 0, 0, -0x1p127f});
}

static void matrix_nan(struct subject *subject)
{
    subject->records[1].object_to_world[6] = NAN;
}

static void translation_infinite(struct subject *subject)
{
    subject->records[1].object_to_world[7] = INFINITY;
}

static void mask_0(struct subject *subject)
{
    subject->records[1].custom_index_and_mask = 0x00000005;
}

static void masks_0(struct subject *subject)
{
    for (int i = 0; i < MAX_INSTANCES; i++)
        subject->records[i].custom_index_and_mask = 0x00000005;
}

static void masks_0_partial(struct subject *subject)
{
    masks_0(subject);
    subject->build.partial = true;
}

static const uint64_t mask_ff[4] = {0, 0, 0, UINT64_C(1) << 63};

static void masks_declared(struct subject *subject)
{
    subject->build.declared_masks = mask_ff;
}

static void overflow_declared(struct subject *subject)
{
    subject->build.declared_masks = mask_ff;
    subject->records[1].custom_index_and_mask = 0x01000005;
}

static void index_bound_6(struct subject *subject)
{
    masks_0(subject);
    subject->build.custom_index_bound = 6;
}

static void index_bound_5(struct subject *subject)
{
    masks_0(subject);
    subject->build.custom_index_bound = 5;
}

static void set_words(struct subject *subject, const uint32_t words[MAX_INSTANCES])
{
    for (int i = 0; i < MAX_INSTANCES; i++)
        subject->records[i].custom_index_and_mask = words[i];
}

static void words_run_over(struct subject *subject)
{
    set_words(subject, (const uint32_t[]){0x07FFFFFE, 0x07FFFFFF, 0x08000000, 0x08000001});
}

static void words_run_over_at_once(struct subject *subject)
{
    set_words(subject, (const uint32_t[]){0x07FFFFFF, 0x08000004, 0x08000009, 0x08000009});
}

static void words_wrap_within(struct subject *subject)
{
    set_words(subject, (const uint32_t[]){0x07FFFFFE, 0x07FFFFFF, 0x07000000, 0x07000001});
}

static void set_offset_words(struct subject *subject, const uint32_t words[MAX_INSTANCES])
{
    for (int i = 0; i < MAX_INSTANCES; i++)
        subject->records[i].sbt_offset_and_flags = words[i];
}

static void offsets_run_over(struct subject *subject)
{
    set_offset_words(subject, (const uint32_t[]){0x00FFFFFC, 0x00FFFFFE, 0x01000000, 0x01000002});
}

static void offsets_wrap_within(struct subject *subject)
{
    set_offset_words(subject, (const uint32_t[]){0x01FFFFFC, 0x01FFFFFE, 0x01000000, 0x01000002});
}

static void offset_bound_3(struct subject *subject)
{
    set_offset_words(subject, (const uint32_t[]){0, 0x03000003, 1, 2});
    subject->build.sbt_offset_bound = 3;
}

static void offset_bound_4(struct subject *subject)
{
    offset_bound_3(subject);
    subject->build.sbt_offset_bound = 4;
}

static void words_by_chance(struct subject *subject)
{
    set_words(subject, (const uint32_t[]){0x07FFFFF0, 0x07FFFFFF, 0x08000000, 0x08000005});
}

static void words_of_two_masks(struct subject *subject)
{
    set_words(subject, (const uint32_t[]){0x01000000, 0x02000001, 0x03000002, 0x04000003});
}

static void masked_out_and_inactive(struct subject *subject)
{
    mask_0(subject);
    matrix_zero(subject);
    flag_0x10(subject);
    translation_infinite(subject);
    subject->build.declared_masks = mask_ff;
    subject->build.custom_index_bound = 1;
    subject->records[0].custom_index_and_mask = 0xFF000000;
}

/* Two instances of two BLASes that are built; what is altered is the second. */
#define PAIR(rule, name, why, expected, says, alter)                                                                   \
    {rule, name, why, expected, 2, {0, 1}, 2, {GN_BUILT_BEFORE, GN_BUILT_BEFORE}, says, alter}
/* The second instance is inactive. */
#define INACTIVE(rule, alter)                                                                                          \
    {rule, "inactive", "an inactive instance is not judged", 0, 2, {0, NULL_REF}, 1, {GN_BUILT_BEFORE}, NULL, alter}
/* Four instances of one BLAS. */
#define FOUR(rule, name, why, expected, says, alter)                                                                   \
    {rule, name, why, expected, 4, {0, 0, 0, 0}, 1, {GN_BUILT_BEFORE}, says, alter}

static const struct row rows[] = {
    {"build.order.blas_never_built", "never built", "nothing ever built it", 1, 1, {0}, 1, {GN_BUILT_NEVER},
     "instance 0 of 1 of TLAS \"scene\" (0x7) refers to BLAS \"tree 0\" (0x100)", NULL},
    {"build.order.blas_never_built", "built before", "the usual order", 0, 1, {0}, 1, {GN_BUILT_BEFORE}, NULL, NULL},
    {"build.order.blas_never_built", "built later", "submission order decides, so a later build is too late", 1, 1, {0}, 1,
     {GN_BUILT_LATER}, "its first build was submitted only after this one", NULL},
    {"build.order.blas_never_built", "same call", "unordered within one call, which is another rule's matter", 0, 1, {0}, 1,
     {GN_BUILT_SAME_CALL}, NULL, NULL},
    {"build.order.blas_never_built", "other queue", "a build that nothing observed orders may have come first", 0, 1, {0}, 1,
     {GN_BUILT_UNORDERED}, NULL, NULL},
    {"build.order.blas_never_built", "null reference", "an inactive instance refers to nothing", 0, 2, {NULL_REF, 0}, 1,
     {GN_BUILT_BEFORE}, NULL, NULL},
    {"build.order.blas_never_built", "unknown reference", "what is not a known structure belongs to another rule", 0, 1,
     {UNKNOWN}, 0, {0}, NULL, NULL},
    {"build.order.blas_never_built", "second instance", "the index named is that of the offending instance", 1, 3, {1, 0, 1}, 2,
     {GN_BUILT_NEVER, GN_BUILT_BEFORE}, "instance 1 of 3", NULL},
    {"build.order.blas_never_built", "two of a kind", "instances of one BLAS are one finding with a count", 1, 3, {0, 0, 0}, 1,
     {GN_BUILT_NEVER}, "instance 0 of 3", NULL},
    {"build.order.blas_never_built", "two BLASes", "two BLASes are two findings", 2, 2, {0, 1}, 2,
     {GN_BUILT_NEVER, GN_BUILT_LATER}, NULL, NULL},
    {"build.order.blas_never_built", "no instances", "an empty TLAS refers to nothing", 0, 0, {0}, 0, {0}, NULL, NULL},

    PAIR("build.order.same_call", "built beside it", "nothing orders two builds of one command", 1, "instance 1 of 2", same_call),
    PAIR("build.order.same_call", "built before", "the usual order", 0, NULL, NULL),
    PAIR("build.order.same_call", "destroyed", "the reference is wrong in itself", 0, NULL, destroyed),

    {"instances.reference_unknown", "unknown", "no structure has that address", 1, 2, {0, UNKNOWN}, 1, {GN_BUILT_BEFORE},
     "instance 1 of 2", NULL},
    {"instances.reference_unknown", "odd", "no address is odd", 1, 1, {UNKNOWN}, 0, {0}, "a multiple of 256", odd_address},
    {"instances.reference_unknown", "not sure", "some structure's address is not known", 0, 1, {UNKNOWN}, 0, {0}, NULL, unsure},
    {"instances.reference_unknown", "inactive", "0 refers to nothing", 0, 1, {NULL_REF}, 0, {0}, NULL, NULL},
    {"instances.reference_unknown", "many", "one finding for a TLAS, however many", 1, 3, {UNKNOWN, UNKNOWN, UNKNOWN}, 0, {0},
     "(the first of 3 such)", NULL},
    PAIR("instances.reference_unknown", "destroyed", "it was destroyed before", 1, "BLAS \"tree 1\" (0x101), which was destroyed",
         destroyed),
    PAIR("instances.reference_unknown", "alive", "the usual", 0, NULL, NULL),

    PAIR("instances.reference_tlas", "TLAS", "no nesting", 1, "instance 1 of 2", is_top),
    PAIR("instances.reference_tlas", "BLAS", "the usual", 0, NULL, NULL),

    PAIR("instances.flags_reserved", "undefined", "0x10 belongs to an extension", 1, "flags 0x12, of which 0x10", flag_0x10),
    PAIR("instances.flags_reserved", "defined", "the extension is enabled", 0, NULL, flag_0x10_defined),
    INACTIVE("instances.flags_reserved", masked_out_and_inactive),

    PAIR("instances.matrix_singular", "zero", "scaled to a point", 1, "instance 1 of 2", matrix_zero),
    PAIR("instances.matrix_singular", "dependent", "exactly singular, at very different scales", 1, NULL, matrix_dependent),
    PAIR("instances.matrix_singular", "nearly dependent", "one last bit away from it", 0, NULL, matrix_nearly_dependent),
    PAIR("instances.matrix_singular", "denormal", "the smallest scale there is", 0, NULL, matrix_denormal),
    PAIR("instances.matrix_singular", "huge", "the largest scale there is", 0, NULL, matrix_huge),
    PAIR("instances.matrix_singular", "NaN", "not invertible", 1, NULL, matrix_nan),
    PAIR("instances.matrix_singular", "translation", "is another rule's matter", 0, NULL, translation_infinite),
    INACTIVE("instances.matrix_singular", masked_out_and_inactive),

    PAIR("instances.translation_not_finite", "infinite", "no ray gets there", 1, "moved by (0, inf, 0)", translation_infinite),
    PAIR("instances.translation_not_finite", "matrix", "is another rule's matter", 0, NULL, matrix_nan),
    INACTIVE("instances.translation_not_finite", masked_out_and_inactive),

    PAIR("instances.mask_zero", "all", "nothing is hit", 1, "each of the 2 active", masks_0),
    PAIR("instances.mask_zero", "all that were read", "there are more, which were not", 0, NULL, masks_0_partial),
    PAIR("instances.mask_zero", "one", "hidden on purpose", 0, NULL, mask_0),
    INACTIVE("instances.mask_zero", mask_0),
    {"instances.mask_zero", "empty", "no instance is active", 0, 1, {NULL_REF}, 0, {0}, NULL, masks_0},

    PAIR("instances.mask_undeclared", "overflow", "the index ran over into the mask", 1, "0x01000005", overflow_declared),
    PAIR("instances.mask_undeclared", "declared", "all masks are 0xFF", 0, NULL, masks_declared),
    PAIR("instances.mask_undeclared", "no declaration", "every mask is as good as another", 0, NULL, mask_0),
    INACTIVE("instances.mask_undeclared", masked_out_and_inactive),

    PAIR("instances.custom_index_bound", "at the bound", "the bound is exclusive", 1, "index 5", index_bound_5),
    PAIR("instances.custom_index_bound", "below", "the bound is exclusive", 0, NULL, index_bound_6),
    PAIR("instances.custom_index_bound", "no bound", "any index is fine", 0, NULL, masks_0),
    INACTIVE("instances.custom_index_bound", masked_out_and_inactive),

    FOUR("instances.custom_index_overflow", "runs over", "counts by one through 2^24", 1, "from instance 1 to 2", words_run_over),
    FOUR("instances.custom_index_overflow", "at once", "counts by five, in the first step", 1, "from instance 0 to 1",
         words_run_over_at_once),
    PAIR("instances.sbt_offset_bound", "at the bound", "the bound is exclusive", 1, "offset 3", offset_bound_3),
    PAIR("instances.sbt_offset_bound", "below", "the bound is exclusive", 0, NULL, offset_bound_4),
    FOUR("instances.sbt_offset_overflow", "counts through", "two to each", 1, "from 0x00fffffe to 0x01000000", offsets_run_over),
    FOUR("instances.sbt_offset_overflow", "wraps", "the offset starts again and the flags stay", 0, NULL, offsets_wrap_within),
    FOUR("instances.custom_index_overflow", "wraps", "the index starts again and the mask stays", 0, NULL, words_wrap_within),
    FOUR("instances.custom_index_overflow", "by chance", "the steps differ", 0, NULL, words_by_chance),
    FOUR("instances.custom_index_overflow", "mask beside index", "both count, each for itself", 0, NULL, words_of_two_masks),
};

/* The command of a row: filled with what is valid, then altered by the row. */
struct command_subject {
    struct gn_command command;
    struct gn_shape before, now;
    struct gn_geometry geometry_before[2], geometry_now[2];
};

struct command_row {
    const char *rule;
    enum gn_command_kind kind;
    enum gn_profile profile;
    const char *name;
    uint32_t expected;
    const char *says;
    void (*alter)(struct command_subject *subject);
};

#define ALTER(name, statement)                                                                                         \
    static void name(struct command_subject *subject)                                                                  \
    {                                                                                                                  \
        struct gn_contents *source = &subject->command.source, *target = &subject->command.target;                    \
        (void)source, (void)target;                                                                                    \
        statement;                                                                                                     \
    }

ALTER(source_never, source->structure.built = GN_BUILT_NEVER)
ALTER(source_unordered, source->structure.built = GN_BUILT_UNORDERED)
ALTER(source_missing, source->structure = (struct gn_structure){.built = GN_BUILT_NEVER})
ALTER(target_never, target->structure.built = GN_BUILT_NEVER)
ALTER(no_flags, subject->before.flags = subject->now.flags = 0)
ALTER(no_flags_unordered, no_flags(subject); source_unordered(subject))
ALTER(no_flags_unknown, no_flags(subject); source->shape = NULL)
ALTER(other_flags, subject->now.flags |= 4)
ALTER(other_flags_unknown, other_flags(subject); source->shape = NULL)
ALTER(other_type, subject->geometry_now[1].type = 1)
ALTER(other_opacity, subject->geometry_now[1].flags = 1)
ALTER(other_format, subject->geometry_now[1].vertex_format = 1)
ALTER(other_index_type, subject->geometry_now[1].index_type = 1)
ALTER(other_max_vertex, subject->geometry_now[1].max_vertex = 8)
ALTER(other_transform, subject->geometry_now[1].has_transform = true)
ALTER(other_level, subject->now.is_top = true)
ALTER(other_opacity_unknown, other_opacity(subject); source->shape = NULL)
ALTER(fewer_geometries, subject->now.geometry_count = 1)
ALTER(fewer_primitives, subject->geometry_now[1].primitive_count = 5)
ALTER(fewer_primitives_indirect, fewer_primitives(subject); subject->now.counts_known = false)
ALTER(size_reported, source->compacted_size = 600; source->compacted_size_of = 3; target->size = 599)
ALTER(size_suffices, size_reported(subject); target->size = 600)
ALTER(size_of_earlier, size_reported(subject); source->compacted_size_of = 2)
ALTER(size_asked_again, size_of_earlier(subject); source->size_asked_of = 3)
ALTER(size_of_earlier_plenty, size_of_earlier(subject); target->size = source->size)
ALTER(source_compacted, source->compacted = true)
ALTER(target_compacted, target->compacted = true)

#define COMMAND(rule, kind, name, expected, says, alter)                                                               \
    {rule, GN_COMMAND_##kind, GN_PROFILE_VULKAN, name, expected, says, alter}
#define COMMAND_IN(profile, rule, kind, name, expected, says, alter)                                                   \
    {rule, GN_COMMAND_##kind, GN_PROFILE_##profile, name, expected, says, alter}

static const struct command_row command_rows[] = {
    COMMAND("update.source_never_built", UPDATE, "never built", 1, "BLAS \"copy\" (0x21) is updated from BLAS \"tree\"", source_never),
    COMMAND("update.source_never_built", UPDATE, "built", 0, NULL, NULL),
    COMMAND("update.source_never_built", UPDATE, "not ordered", 0, NULL, source_unordered),
    COMMAND("update.source_never_built", UPDATE, "not known", 0, NULL, source_missing),
    COMMAND("update.not_allowed", UPDATE, "no flag", 1, "flags 0x0, without ALLOW_UPDATE", no_flags),
    COMMAND("update.not_allowed", UPDATE, "allowed", 0, NULL, NULL),
    COMMAND("update.not_allowed", UPDATE, "not ordered", 0, NULL, no_flags_unordered),
    COMMAND("update.not_allowed", UPDATE, "not known", 0, NULL, no_flags_unknown),
    COMMAND("update.not_allowed", UPDATE, "never built", 0, NULL, source_never),
    COMMAND("update.flags_changed", UPDATE, "another flag", 1, "flags 0x3 and is updated with flags 0x7", other_flags),
    COMMAND("update.flags_changed", UPDATE, "the same", 0, NULL, NULL),
    COMMAND("update.flags_changed", UPDATE, "not known", 0, NULL, other_flags_unknown),
    COMMAND("update.geometry_changed", UPDATE, "type", 1, "another geometryType of geometry 1 than it was built with: 1, was 0",
            other_type),
    COMMAND("update.geometry_changed", UPDATE, "opacity", 1, "another flags of geometry 1", other_opacity),
    COMMAND("update.geometry_changed", UPDATE, "format", 1, "vertexFormat", other_format),
    COMMAND("update.geometry_changed", UPDATE, "index type", 1, "indexType", other_index_type),
    COMMAND("update.geometry_changed", UPDATE, "maxVertex", 1, "8, was 7", other_max_vertex),
    COMMAND("update.geometry_changed", UPDATE, "transform", 1, "transformData", other_transform),
    COMMAND("update.geometry_changed", UPDATE, "level", 1, "another type", other_level),
    COMMAND("update.geometry_changed", UPDATE, "the same", 0, NULL, NULL),
    COMMAND("update.geometry_changed", UPDATE, "not known", 0, NULL, other_opacity_unknown),
    COMMAND("update.geometry_changed", UPDATE, "count", 0, NULL, fewer_primitives),
    COMMAND("update.count_changed", UPDATE, "geometries", 1, "1 geometries, and was built with 2", fewer_geometries),
    COMMAND("update.count_changed", UPDATE, "primitives", 1, "5 primitives in geometry 1, and was built with 6", fewer_primitives),
    COMMAND("update.count_changed", UPDATE, "indirect", 0, NULL, fewer_primitives_indirect),
    COMMAND("update.count_changed", UPDATE, "the same", 0, NULL, NULL),
    COMMAND("copy.source_never_built", CLONE, "never built", 1, "BLAS \"tree\" (0x20) is copied", source_never),
    COMMAND("copy.source_never_built", COMPACT, "never built", 1, NULL, source_never),
    COMMAND("copy.source_never_built", SERIALIZE, "never built", 1, NULL, source_never),
    COMMAND("copy.source_never_built", CLONE, "built", 0, NULL, NULL),
    COMMAND("copy.source_never_built", CLONE, "not ordered", 0, NULL, source_unordered),
    COMMAND("copy.source_never_built", UPDATE, "another command", 0, NULL, source_never),
    COMMAND_IN(WEBGPU_RT, "copy.target_never_built", CLONE, "never built", 1, NULL, target_never),
    COMMAND_IN(WEBGPU_RT, "copy.target_never_built", CLONE, "built", 0, NULL, NULL),
    COMMAND("copy.target_never_built", CLONE, "Vulkan does not mind", 0, NULL, target_never),
    COMMAND("query.never_built", ASK_COMPACTED_SIZE, "never built", 1, "size of BLAS \"tree\"", source_never),
    COMMAND("query.never_built", ASK_OTHER, "never built", 1, NULL, source_never),
    COMMAND("query.never_built", ASK_OTHER, "built", 0, NULL, NULL),
    COMMAND("compaction.query_not_allowed", ASK_COMPACTED_SIZE, "no flag", 1, "without ALLOW_COMPACTION", no_flags),
    COMMAND("compaction.query_not_allowed", ASK_OTHER, "another size", 0, NULL, no_flags),
    COMMAND("compaction.query_not_allowed", ASK_COMPACTED_SIZE, "allowed", 0, NULL, NULL),
    COMMAND("compaction.query_not_allowed", ASK_COMPACTED_SIZE, "not known", 0, NULL, no_flags_unknown),
    COMMAND("compaction.not_allowed", COMPACT, "no flag", 1, "without ALLOW_COMPACTION", no_flags),
    COMMAND("compaction.not_allowed", CLONE, "a clone", 0, NULL, no_flags),
    COMMAND("compaction.not_allowed", COMPACT, "allowed", 0, NULL, NULL),
    COMMAND("compaction.target_too_small", COMPACT, "one byte less", 1, "of 599 bytes, but its compacted size was reported as 600",
            size_reported),
    COMMAND("compaction.target_too_small", COMPACT, "just enough", 0, NULL, size_suffices),
    COMMAND("compaction.target_too_small", COMPACT, "never asked", 0, NULL, NULL),
    COMMAND("compaction.target_too_small", COMPACT, "of an earlier build", 0, NULL, size_of_earlier),
    COMMAND("compaction.target_too_small", CLONE, "a clone", 0, NULL, size_reported),
    COMMAND("compaction.size_outdated", COMPACT, "of an earlier build", 1, "built anew after its compacted size (600)", size_of_earlier),
    COMMAND("compaction.size_outdated", COMPACT, "asked again", 0, NULL, size_asked_again),
    COMMAND("compaction.size_outdated", COMPACT, "plenty", 0, NULL, size_of_earlier_plenty),
    COMMAND("compaction.size_outdated", COMPACT, "of this build", 0, NULL, size_reported),
    COMMAND_IN(WGPU, "compaction.repeated", COMPACT, "compacted", 1, NULL, source_compacted),
    COMMAND_IN(WGPU, "compaction.repeated", COMPACT, "not compacted", 0, NULL, NULL),
    COMMAND("compaction.repeated", COMPACT, "Vulkan does not mind", 0, NULL, source_compacted),
    COMMAND_IN(WGPU, "compaction.rebuilt", BUILD, "compacted", 1, "built again", target_compacted),
    COMMAND_IN(WGPU, "compaction.rebuilt", UPDATE, "compacted", 1, "updated", target_compacted),
    COMMAND_IN(WGPU, "compaction.rebuilt", BUILD, "not compacted", 0, NULL, NULL),
    COMMAND("compaction.rebuilt", BUILD, "Vulkan does not mind", 0, NULL, target_compacted),
};

#define COMMAND_ROW_COUNT (sizeof command_rows / sizeof command_rows[0])

struct input_row {
    const char *rule, *name;
    uint32_t expected;
    const char *says;
    uint64_t address, offset, count, stride, element_size, bound, buffer_address, buffer_size;
};

static const struct input_row input_rows[] = {
    {"inputs.beyond_buffer", "one byte short", 1, "end at 0x1040, but the buffer in which they begin ends at 0x103f", 0x1000, 0, 4, 16,
     16, 0, 0x1000, 63},
    {"inputs.beyond_buffer", "just fits", 0, NULL, 0x1000, 0, 4, 16, 16, 0, 0x1000, 64},
    {"inputs.beyond_buffer", "the last stride is not read", 0, NULL, 0x1000, 0, 4, 16, 12, 0, 0x1000, 60},
    {"inputs.beyond_buffer", "offset", 1, "from 0x1000 + 16", 0x1000, 16, 4, 16, 16, 0, 0x1000, 64},
    {"inputs.beyond_buffer", "nothing read", 0, NULL, 0x1000, 4096, 0, 16, 16, 0, 0x1000, 64},
    {"inputs.beyond_buffer", "unknown buffer", 0, NULL, 0x1000, 0, 4, 16, 16, 0, 0, 0},
    {"inputs.beyond_buffer", "product of 64 bits", 1, "beyond 2^64", 0x1000, 0, UINT64_C(1) << 60, 16, 16, 0, 0x1000, 64},
    {"inputs.beyond_buffer", "product of 32 bits", 1, "end at 0x100000ff0", 0x1000, 0, 0x10000000, 16, 0, 0, 0x1000, 64},
    {"inputs.beyond_buffer", "sum of 64 bits", 1, "beyond 2^64", UINT64_MAX - 64, 60, 1, 16, 16, 0, UINT64_MAX - 100, 80},
    {"inputs.beyond_max_vertex", "one more", 1, "reads 4 vertices, but maxVertex announces 3", 0x1000, 0, 4, 16, 16, 3, 0, 0},
    {"inputs.beyond_max_vertex", "as many", 0, NULL, 0x1000, 0, 3, 16, 16, 3, 0, 0},
    {"inputs.beyond_max_vertex", "no vertices", 0, NULL, 0x1000, 0, 3, 16, 16, 0, 0, 0},
};

#define INPUT_ROW_COUNT (sizeof input_rows / sizeof input_rows[0])

static const struct clash_row {
    const char *rule, *name;
    enum gn_clash_kind kind;
    uint32_t expected;
    const char *says;
} clash_rows[] = {
    {"build.same_target", "one target", GN_CLASH_TARGETS, 1, "pInfos[0] and pInfos[3] both write BLAS \"tree\""},
    {"build.same_target", "source of another", GN_CLASH_SOURCE, 1,
     "pInfos[3] updates BLAS \"bush\" (0x2) from BLAS \"tree\" (0x1), which pInfos[0] writes"},
    {"build.same_target", "scratch", GN_CLASH_SCRATCH, 0, NULL},
    {"build.same_scratch", "scratch", GN_CLASH_SCRATCH, 1, "the same scratch address 0x5500"},
    {"build.same_scratch", "one target", GN_CLASH_TARGETS, 0, NULL},
};

#define CLASH_ROW_COUNT (sizeof clash_rows / sizeof clash_rows[0])

static const struct use_row {
    const char *rule, *name;
    enum gn_trouble_kind kind;
    bool certain;
    uint32_t expected;
    const char *says;
} use_rows[] = {
    {"use.tlas_never_built", "certain", GN_TROUBLE_NEVER_BUILT, true, 1, "is traced through, but nothing submitted"},
    {"use.tlas_never_built", "bound", GN_TROUBLE_NEVER_BUILT, false, 0, NULL},
    {"use.tlas_never_built_bound", "bound", GN_TROUBLE_NEVER_BUILT, false, 1, "is bound for tracing"},
    {"use.tlas_never_built_bound", "certain", GN_TROUBLE_NEVER_BUILT, true, 0, NULL},
    {"use.blas_destroyed", "certain", GN_TROUBLE_DESTROYED, true, 1,
     "1 of the 3 BLASes that it was last built from were destroyed since, BLAS \"tree\" (0x2) first, which was copied before into "
     "BLAS \"small\""},
    {"use.blas_destroyed", "memory", GN_TROUBLE_STORAGE_GONE, true, 1, "have lost their buffer or memory"},
    {"use.blas_destroyed", "bound", GN_TROUBLE_DESTROYED, false, 0, NULL},
    {"use.blas_destroyed_bound", "bound", GN_TROUBLE_DESTROYED, false, 1, "were destroyed"},
    {"use.blas_destroyed_bound", "rebuilt", GN_TROUBLE_REBUILT, false, 0, NULL},
    {"use.blas_rebuilt", "rebuilt", GN_TROUBLE_REBUILT, false, 1, "was written since, BLAS \"tree\""},
    {"use.blas_rebuilt", "destroyed", GN_TROUBLE_DESTROYED, true, 0, NULL},
};

static const struct hazard_row {
    const char *rule, *name;
    enum gn_hazard_kind kind;
    enum gn_hazard_why why;
    bool uncertain;
    uint32_t expected;
    const char *says;
} hazard_rows[] = {
    {"sync.blas_to_tlas", "instance", GN_HAZARD_INSTANCE, GN_HAZARD_NOT_ORDERED, false, 1,
     "0x1000 to 0x1040: a command reads BLAS \"tree\" (0x2), and before that vkCmdFirst builds BLAS \"bush\" (0x1); nothing orders the two. "
     "Missing: srcStageMask S1, srcAccessMask A1, dstStageMask S2, dstAccessMask A2"},
    {"sync.blas_to_tlas", "trace", GN_HAZARD_TRACE, GN_HAZARD_NOT_ORDERED, false, 0, NULL},
    {"sync.tlas_to_trace", "trace", GN_HAZARD_TRACE, GN_HAZARD_NOT_AVAILABLE, false, 1, "do not make what the first writes available"},
    {"sync.tlas_to_trace", "bound", GN_HAZARD_TRACE, GN_HAZARD_NOT_ORDERED, true, 0, NULL},
    {"sync.tlas_to_trace_bound", "bound", GN_HAZARD_TRACE, GN_HAZARD_NOT_VISIBLE, true, 1, "visible to the second"},
    {"sync.tlas_to_trace_bound", "trace", GN_HAZARD_TRACE, GN_HAZARD_NOT_ORDERED, false, 0, NULL},
    {"sync.scratch", "scratch", GN_HAZARD_SCRATCH, GN_HAZARD_OTHER_QUEUE, false, 1, "they run on two queues"},
    {"sync.scratch", "input", GN_HAZARD_INPUT, GN_HAZARD_NOT_ORDERED, false, 0, NULL},
    {"sync.input", "input", GN_HAZARD_INPUT, GN_HAZARD_NOT_ORDERED, false, 1, NULL},
    {"sync.input", "scratch", GN_HAZARD_SCRATCH, GN_HAZARD_NOT_ORDERED, false, 0, NULL},
    {"sync.structure", "structure", GN_HAZARD_STRUCTURE, GN_HAZARD_NOT_ORDERED, false, 1, NULL},
    {"sync.structure", "uncertain", GN_HAZARD_STRUCTURE, GN_HAZARD_NOT_ORDERED, true, 0, NULL},
    {"build.overlap", "overlap", GN_HAZARD_OVERLAP, GN_HAZARD_NOT_ORDERED, false, 1,
     "0x1000 to 0x1040 are used twice in one command: it builds BLAS \"bush\" (0x1), and reads BLAS \"tree\" (0x2)"},
    {"build.overlap", "structure", GN_HAZARD_STRUCTURE, GN_HAZARD_NOT_ORDERED, false, 0, NULL},
    {"sync.binding_table", "table", GN_HAZARD_BINDING_TABLE, GN_HAZARD_NOT_ORDERED, false, 1, NULL},
    {"sync.binding_table", "input", GN_HAZARD_INPUT, GN_HAZARD_NOT_ORDERED, false, 0, NULL},
};

static const struct refit_row {
    const char *rule, *name;
    bool indices, activity;
    uint32_t expected;
    const char *says;
    double growth;
} refit_rows[] = {
    {"update.indices_changed", "other indices", true, false, 1, "with other indices in geometry 1", 0},
    {"update.indices_changed", "other activity", false, true, 0, NULL, 0},
    {"update.activity_changed", "other activity", false, true, 1, "3 of 10 are inactive, 2 were", 0},
    {"update.activity_changed", "the same", false, false, 0, NULL, 0},
    {"update.many", "twice the surface", false, false, 1, "was updated 8 times since it was built, and geometry 1", 2.0},
    {"update.many", "a little more", false, false, 0, NULL, 1.9},
    {"update.many", "not measured", true, true, 0, NULL, 0},
};

#define REFIT_ROW_COUNT (sizeof refit_rows / sizeof refit_rows[0])

#define HAZARD_ROW_COUNT (sizeof hazard_rows / sizeof hazard_rows[0])

#define USE_ROW_COUNT (sizeof use_rows / sizeof use_rows[0])

#define ROW_COUNT (sizeof rows / sizeof rows[0])

struct collected {
    uint64_t sites[16];
    uint32_t site_count, findings, repeats;
    char first[2048], rule[128];
};

static bool repeated(void *context, const struct gn_rule *rule, uint64_t site)
{
    struct collected *out = context;
    (void)rule;
    for (uint32_t i = 0; i < out->site_count; i++)
        if (out->sites[i] == site) {
            out->repeats++;
            return true;
        }
    out->sites[out->site_count++] = site;
    return false;
}

static void finding(void *context, uint64_t site, const struct gn_finding *found)
{
    struct collected *out = context;
    (void)site;
    if (!out->findings++) {
        snprintf(out->first, sizeof out->first, "%s", found->message);
        snprintf(out->rule, sizeof out->rule, "%s", found->rule->id);
    }
}

static struct gn_report report_into(struct collected *out)
{
    return (struct gn_report){.profile = GN_PROFILE_VULKAN,
                              .enabled = gn_rule_set_all(),
                              .context = out,
                              .repeated = repeated,
                              .finding = finding};
}

static void run_row(const struct row *row, struct gn_report *report)
{
    struct subject subject = {.build = {.tlas = {GN_OBJECT_TLAS, 7, "scene"},
                                        .tlas_id = 1,
                                        .place = "a test",
                                        .instance_count = row->instance_count,
                                        .refers_to = row->refers_to,
                                        .structure_count = row->structure_count,
                                        .references_sure = true,
                                        .valid_flags = 0x0F}};
    char names[MAX_STRUCTURES][16];
    for (uint32_t i = 0; i < row->structure_count; i++) {
        snprintf(names[i], sizeof names[i], "tree %u", i);
        subject.structures[i] = (struct gn_structure){
            .object = {GN_OBJECT_BLAS, 0x100 + i, names[i]}, .id = 10 + i, .address = 0x1000 * (i + 1), .built = row->built[i]};
    }
    for (uint32_t i = 0; i < MAX_INSTANCES; i++) {
        uint32_t index = i < row->instance_count ? row->refers_to[i] : NULL_REF;
        subject.records[i] = (struct gn_instance_record){
            .object_to_world = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
            .custom_index_and_mask = 0xFF000000,
            .reference = index == NULL_REF ? 0 : index == UNKNOWN ? 0x7700 : 0x1000 * (index + 1)};
    }
    if (row->alter)
        row->alter(&subject);
    subject.build.instances = subject.records;
    subject.build.structures = subject.structures;
    gn_rules_judge_tlas_build(&subject.build, report);
}

/* Only the rule of the row: that others have more to say is not the row's matter. */
static void enable_only(struct gn_report *report, const char *id)
{
    report->enabled = (struct gn_rule_set){{0}};
    for (size_t i = 0; i < gn_rules_count(); i++)
        if (strcmp(gn_rules_at(i)->id, id) == 0)
            gn_rule_set_put(&report->enabled, i, true);
}

static void every_row(void **state)
{
    (void)state;
    int failures = 0;
    for (size_t i = 0; i < ROW_COUNT; i++) {
        struct collected out = {.findings = 0};
        struct gn_report report = report_into(&out);
        enable_only(&report, rows[i].rule);
        run_row(&rows[i], &report);
        bool counted = out.findings == rows[i].expected;
        bool said = !rows[i].says || strstr(out.first, rows[i].says);
        bool named = !out.findings || strcmp(out.rule, rows[i].rule) == 0;
        if (!counted || !said || !named) {
            print_error("%s, row \"%s\" (%s): expected %u findings saying \"%s\", found %u of %s: \"%s\"\n", rows[i].rule,
                        rows[i].name, rows[i].why, rows[i].expected, rows[i].says ? rows[i].says : "", out.findings, out.rule,
                        out.first);
            failures++;
        }
    }
    assert_int_equal(failures, 0);
}

static void run_command_row(const struct command_row *row, struct gn_report *report)
{
    struct command_subject subject = {.command.kind = row->kind, .command.place = "a test"};
    struct gn_geometry geometry = {.max_vertex = 7, .primitive_count = 6};
    for (int i = 0; i < 2; i++)
        subject.geometry_before[i] = subject.geometry_now[i] = geometry;
    subject.before = subject.now = (struct gn_shape){.counts_known = true, .flags = 3, .geometry_count = 2};
    subject.before.geometries = subject.geometry_before;
    subject.now.geometries = subject.geometry_now;
    subject.command.shape = &subject.now;
    subject.command.source = (struct gn_contents){
        .structure = {.object = {GN_OBJECT_BLAS, 0x20, "tree"}, .id = 1, .built = GN_BUILT_BEFORE},
        .made = GN_MADE_BUILT,
        .shape = &subject.before,
        .generation = 3,
        .size = 1024};
    subject.command.target = subject.command.source;
    subject.command.target.structure.object.handle = 0x21;
    subject.command.target.structure.object.name = "copy";
    subject.command.target.structure.id = 2;
    if (row->alter)
        row->alter(&subject);
    gn_rules_judge_command(&subject.command, report);
}

static void every_command_row(void **state)
{
    (void)state;
    int failures = 0;
    for (size_t i = 0; i < COMMAND_ROW_COUNT; i++) {
        const struct command_row *row = &command_rows[i];
        struct collected out = {.findings = 0};
        struct gn_report report = report_into(&out);
        report.profile = row->profile;
        enable_only(&report, row->rule);
        run_command_row(row, &report);
        bool said = !row->says || strstr(out.first, row->says);
        bool told = !row->expected || gn_rules_about_command(row->kind, &report.enabled, row->profile);
        if (out.findings != row->expected || !said || !told) {
            print_error("%s, row \"%s\": expected %u findings saying \"%s\", found %u: \"%s\"\n", row->rule, row->name,
                        row->expected, row->says ? row->says : "", out.findings, out.first);
            failures++;
        }
    }
    assert_int_equal(failures, 0);
}

static int expect_row(const char *rule, const char *name, uint32_t expected, const char *says, const struct collected *out)
{
    if (out->findings == expected && (!says || strstr(out->first, says)))
        return 0;
    print_error("%s, row \"%s\": expected %u findings saying \"%s\", found %u: \"%s\"\n", rule, name, expected, says ? says : "",
                out->findings, out->first);
    return 1;
}

static void every_input_row(void **state)
{
    (void)state;
    int failures = 0;
    for (size_t i = 0; i < INPUT_ROW_COUNT; i++) {
        const struct input_row *row = &input_rows[i];
        struct collected out = {.findings = 0};
        struct gn_report report = report_into(&out);
        struct gn_input input = {.target = {GN_OBJECT_BLAS, 1, "tree"}, .target_id = 1, .what = "aabbs.data",
                                 .address = row->address, .offset = row->offset, .count = row->count, .stride = row->stride,
                                 .element_size = row->element_size, .bound = row->bound,
                                 .buffer_address = row->buffer_address, .buffer_size = row->buffer_size};
        enable_only(&report, row->rule);
        gn_rules_judge_input(&input, &report);
        failures += expect_row(row->rule, row->name, row->expected, row->says, &out);
    }
    for (size_t i = 0; i < CLASH_ROW_COUNT; i++) {
        const struct clash_row *row = &clash_rows[i];
        struct collected out = {.findings = 0};
        struct gn_report report = report_into(&out);
        struct gn_clash clash = {.kind = row->kind, .second = 3, .first_target = {GN_OBJECT_BLAS, 1, "tree"},
                                 .second_target = {GN_OBJECT_BLAS, 2, "bush"}, .first_id = 1, .second_id = 2,
                                 .address = 0x5500};
        enable_only(&report, row->rule);
        gn_rules_judge_clash(&clash, &report);
        failures += expect_row(row->rule, row->name, row->expected, row->says, &out);
    }
    for (size_t i = 0; i < USE_ROW_COUNT; i++) {
        const struct use_row *row = &use_rows[i];
        struct collected out = {.findings = 0};
        struct gn_report report = report_into(&out);
        struct gn_trouble use = {.kind = row->kind, .certain = row->certain, .tlas = {GN_OBJECT_TLAS, 1, "scene"},
                                 .blas = {GN_OBJECT_BLAS, 2, "tree"}, .tlas_id = 1, .blas_id = 2,
                                 .moved_to = "BLAS \"small\"", .count = 1, .total = 3};
        enable_only(&report, row->rule);
        gn_rules_judge_use(&use, &report);
        failures += expect_row(row->rule, row->name, row->expected, row->says, &out);
    }
    for (size_t i = 0; i < REFIT_ROW_COUNT; i++) {
        const struct refit_row *row = &refit_rows[i];
        struct collected out = {.findings = 0};
        struct gn_report report = report_into(&out);
        struct gn_refit refit = {.target = {GN_OBJECT_BLAS, 1, "tree"}, .target_id = 1, .geometry = 1,
                                 .indices_changed = row->indices, .activity_changed = row->activity,
                                 .inactive_before = 2, .inactive = 3, .total = 10, .updates = 8, .growth = row->growth};
        enable_only(&report, row->rule);
        gn_rules_judge_refit(&refit, &report);
        failures += expect_row(row->rule, row->name, row->expected, row->says, &out);
    }
    for (size_t i = 0; i < HAZARD_ROW_COUNT; i++) {
        const struct hazard_row *row = &hazard_rows[i];
        struct collected out = {.findings = 0};
        struct gn_report report = report_into(&out);
        struct gn_hazard hazard = {.kind = row->kind, .why = row->why, .certain = !row->uncertain, .first_place = "vkCmdFirst",
                                   .first = {{GN_OBJECT_BLAS, 1, "bush"}, 1, "builds", "S1", "A1"},
                                   .second = {{GN_OBJECT_BLAS, 2, "tree"}, 2, "reads", "S2", "A2"},
                                   .begin = 0x1000, .end = 0x1040};
        enable_only(&report, row->rule);
        gn_rules_judge_hazard(&hazard, &report);
        failures += expect_row(row->rule, row->name, row->expected, row->says, &out);
    }
    assert_int_equal(failures, 0);
}

static void every_rule_fires_and_stays_silent(void **state)
{
    (void)state;
    int failures = 0;
    assert_true(gn_rules_count() > 0);
    for (size_t r = 0; r < gn_rules_count(); r++) {
        int firing = 0, silent = 0;
        for (size_t i = 0; i < ROW_COUNT; i++)
            if (strcmp(rows[i].rule, gn_rules_at(r)->id) == 0)
                rows[i].expected ? firing++ : silent++;
        for (size_t i = 0; i < COMMAND_ROW_COUNT; i++)
            if (strcmp(command_rows[i].rule, gn_rules_at(r)->id) == 0)
                command_rows[i].expected ? firing++ : silent++;
        for (size_t i = 0; i < INPUT_ROW_COUNT; i++)
            if (strcmp(input_rows[i].rule, gn_rules_at(r)->id) == 0)
                input_rows[i].expected ? firing++ : silent++;
        for (size_t i = 0; i < CLASH_ROW_COUNT; i++)
            if (strcmp(clash_rows[i].rule, gn_rules_at(r)->id) == 0)
                clash_rows[i].expected ? firing++ : silent++;
        for (size_t i = 0; i < USE_ROW_COUNT; i++)
            if (strcmp(use_rows[i].rule, gn_rules_at(r)->id) == 0)
                use_rows[i].expected ? firing++ : silent++;
        for (size_t i = 0; i < REFIT_ROW_COUNT; i++)
            if (strcmp(refit_rows[i].rule, gn_rules_at(r)->id) == 0)
                refit_rows[i].expected ? firing++ : silent++;
        for (size_t i = 0; i < HAZARD_ROW_COUNT; i++)
            if (strcmp(hazard_rows[i].rule, gn_rules_at(r)->id) == 0)
                hazard_rows[i].expected ? firing++ : silent++;
        contents_rows_count(gn_rules_at(r)->id, &firing, &silent);
        if (!firing || !silent) {
            print_error("%s has %d firing and %d silent rows; it needs both\n", gn_rules_at(r)->id, firing, silent);
            failures++;
        }
    }
    for (size_t i = 0; i < ROW_COUNT; i++)
        if (!gn_rules_find(rows[i].rule)) {
            print_error("row \"%s\" names the unknown rule %s\n", rows[i].name, rows[i].rule);
            failures++;
        }
    assert_int_equal(failures, 0);
}

static bool is_id(const char *id)
{
    bool dotted = false;
    for (const char *c = id; *c; c++) {
        dotted |= *c == '.';
        if (!((*c >= 'a' && *c <= 'z') || (*c >= '0' && *c <= '9') || *c == '_' || *c == '.'))
            return false;
    }
    return dotted;
}

static void every_block_is_complete(void **state)
{
    (void)state;
    for (size_t r = 0; r < gn_rules_count(); r++) {
        const struct gn_rule *rule = gn_rules_at(r);
        bool anywhere = false;
        assert_true(is_id(rule->id));
        assert_ptr_equal(gn_rules_find(rule->id), rule);
        assert_true(rule->title[0] && rule->text[0] && rule->remedy[0]);
        assert_non_null(rule->sources[0]);
        for (int s = 0; rule->sources[s]; s++)
            assert_true(strncmp(rule->sources[s], "VUID-", 5) == 0 || strncmp(rule->sources[s], "Vulkan: ", 8) == 0 ||
                        (strlen(rule->sources[s]) == 6 && rule->sources[s][2] == '-'));
        for (int p = 0; p < GN_PROFILE_COUNT; p++) {
            assert_in_range(rule->severity[p], GN_SEVERITY_SILENT, GN_SEVERITY_ERROR);
            anywhere |= rule->severity[p] != GN_SEVERITY_SILENT;
        }
        assert_true(anywhere);
        assert_true(rule->on == GN_RULE_ON_COMMAND ? rule->test.command && rule->commands : rule->test.tlas_build && !rule->commands);
        for (size_t other = 0; other < r; other++)
            assert_string_not_equal(gn_rules_at(other)->id, rule->id);
    }
}

static void disabled_rules_do_not_run(void **state)
{
    (void)state;
    struct collected out = {.findings = 0};
    struct gn_report report = report_into(&out);
    report.enabled = (struct gn_rule_set){{0}};
    run_row(&rows[0], &report);
    assert_int_equal(out.findings, 0);
    assert_false(gn_rule_set_has(&report.evaluated, 0));

    report.enabled = gn_rule_set_all();
    run_row(&rows[0], &report);
    assert_int_equal(out.findings, 1);
    assert_true(gn_rule_set_has(&report.evaluated, 0));
}

static void repeats_are_counted_not_told(void **state)
{
    (void)state;
    struct collected out = {.findings = 0};
    struct gn_report report = report_into(&out);
    for (int i = 0; i < 5; i++)
        run_row(&rows[0], &report);
    assert_int_equal(out.findings, 1);
    assert_int_equal(out.repeats, 4);
}

/* Against exact arithmetic in integers, with matrices that are often singular or nearly so. */
__extension__ typedef __int128 wide;

static void orientation_agrees_with_integers(void **state)
{
    (void)state;
    uint64_t seed = 88172645463325252u;
    int signs[3] = {0};
    for (int round = 0; round < 300000; round++) {
        int64_t m[9];
        float object_to_world[12] = {0};
        for (int i = 0; i < 9; i++) {
            seed ^= seed << 13, seed ^= seed >> 7, seed ^= seed << 17;
            int bits = round % 3 == 0 ? 2 : 24;
            m[i] = (int64_t)(seed >> 20 & ((1u << bits) - 1)) - (1 << (bits - 1));
        }
        if (round % 3 == 1) /* the third row is nearly the sum of the others, halved so that it fits */
            for (int i = 0; i < 3; i++)
                m[6 + i] = (m[i] / 4 + m[3 + i] / 4);
        if (round % 3 == 1)
            for (int i = 0; i < 6; i++)
                m[i] = m[i] / 4 + (i == round % 7);
        if (round % 3 == 2) /* the largest values that are exact, with rows in proportion */
            for (int i = 0; i < 3; i++)
                m[3 + i] = -m[i];
        wide determinant = (wide)m[0] * (m[4] * m[8] - m[5] * m[7]) - (wide)m[1] * (m[3] * m[8] - m[5] * m[6]) +
                               (wide)m[2] * (m[3] * m[7] - m[4] * m[6]);
        int expected = (determinant > 0) - (determinant < 0);
        for (int i = 0; i < 9; i++) /* each row with a scale of its own */
            object_to_world[i / 3 * 4 + i % 3] = (float)m[i] * (i < 3 ? 0x1p100f : i < 6 ? 0x1p-120f : 1);
        int found = gn_transform_orientation_exact(object_to_world);
        if (found != expected)
            fail_msg("round %d: expected %d, found %d", round, expected, found);
        signs[expected + 1]++;
    }
    assert_true(signs[0] > 10000 && signs[1] > 10000 && signs[2] > 10000);
}

static void the_packer_refuses_what_does_not_fit(void **state)
{
    (void)state;
    static const struct {
        uint32_t index, mask, offset, flags, words[2];
        bool fits;
    } table[] = {{0, 0, 0, 0, {0, 0}, true},
                 {0xFFFFFF, 0xFF, 0xFFFFFF, 0xFF, {0xFFFFFFFF, 0xFFFFFFFF}, true},
                 {5, 1, 7, 2, {0x01000005, 0x02000007}, true},
                 {0x1000000, 0, 0, 0, {9, 9}, false},
                 {0, 0x100, 0, 0, {9, 9}, false},
                 {0, 0, 0x1000000, 0, {9, 9}, false},
                 {0, 0, 0, 0x100, {9, 9}, false}};
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        uint32_t words[2] = {9, 9};
        assert_int_equal(gn_instance_pack(table[i].index, table[i].mask, table[i].offset, table[i].flags, words), table[i].fits);
        assert_int_equal(words[0], table[i].words[0]);
        assert_int_equal(words[1], table[i].words[1]);
    }
}

static void patterns_select_by_id(void **state)
{
    static const struct {
        const char *pattern;
        bool matches;
    } table[] = {{"build.order.blas_never_built", true},
                 {"*", true},
                 {"build.*", true},
                 {"*never_built", true},
                 {"*.order.*", true},
                 {"*b*b*b*", true},
                 {"build", false},
                 {"", false},
                 {"build.order.blas_never_built.", false},
                 {"*.instances.*", false}};
    (void)state;
    const struct gn_rule *rule = gn_rules_find("build.order.blas_never_built");
    assert_non_null(rule);
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++)
        if (gn_rule_matches(rule, table[i].pattern) != table[i].matches)
            fail_msg("\"%s\" should %smatch %s", table[i].pattern, table[i].matches ? "" : "not ", rule->id);
}

static void names_go_both_ways(void **state)
{
    (void)state;
    for (int p = 0; p < GN_PROFILE_COUNT; p++) {
        enum gn_profile back = GN_PROFILE_COUNT;
        assert_true(gn_profile_parse(gn_profile_name((enum gn_profile)p), &back));
        assert_int_equal(back, p);
    }
    for (int s = GN_SEVERITY_NOTE; s < GN_SEVERITY_COUNT; s++) {
        enum gn_severity back = GN_SEVERITY_COUNT;
        assert_true(gn_severity_parse(gn_severity_name((enum gn_severity)s), &back));
        assert_int_equal(back, s);
    }
    enum gn_profile profile = GN_PROFILE_HGI;
    assert_false(gn_profile_parse("Vulkan", &profile));
    assert_int_equal(profile, GN_PROFILE_HGI);
    enum gn_severity severity = GN_SEVERITY_NOTE;
    assert_false(gn_severity_parse("silent", &severity));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_row),
        cmocka_unit_test(every_command_row),
        cmocka_unit_test(every_input_row),
        cmocka_unit_test(contents_rows_run),
        cmocka_unit_test(every_rule_fires_and_stays_silent),
        cmocka_unit_test(every_block_is_complete),
        cmocka_unit_test(disabled_rules_do_not_run),
        cmocka_unit_test(repeats_are_counted_not_told),
        cmocka_unit_test(orientation_agrees_with_integers),
        cmocka_unit_test(the_packer_refuses_what_does_not_fit),
        cmocka_unit_test(patterns_select_by_id),
        cmocka_unit_test(names_go_both_ways),
    };
    return cmocka_run_group_tests_name("rules", tests, NULL, NULL);
}
