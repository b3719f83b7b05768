/* SPDX-License-Identifier: Apache-2.0 */
/* Rules about the instances that a TLAS is built from. An instance whose reference is 0 is inactive and is not judged. */
#include "checks/rules/rules.h"
#include "checks/rules/survey.h"

#include <stdio.h>
#include <string.h>

extern const struct gn_rule gn_rule_instance_reference_unknown, gn_rule_instance_reference_tlas, gn_rule_instance_flags_reserved,
    gn_rule_instance_matrix_singular, gn_rule_instance_translation_not_finite, gn_rule_instance_mask_zero,
    gn_rule_instance_mask_undeclared, gn_rule_custom_index_bound, gn_rule_custom_index_overflow, gn_rule_sbt_offset_bound,
    gn_rule_sbt_offset_overflow;

static const char *place_of(const struct gn_tlas_build *build)
{
    return build->place ? build->place : "a build of the TLAS";
}

/* "instance 3 of 10 (the first of 4)" */
static const char *which(const struct gn_tlas_build *build, const struct gn_survey_class *found, char *out, size_t size)
{
    if (found->count > 1)
        snprintf(out, size, "instance %u of %u (the first of %u such)", found->first, build->instance_count, found->count);
    else
        snprintf(out, size, "instance %u of %u", found->first, build->instance_count);
    return out;
}

/* Starts a finding about the TLAS as a whole: false when there is none, or when it is already known. */
static bool begin(const struct gn_tlas_build *build, struct gn_report *report, const struct gn_survey_class *found,
                  uint64_t *out_site)
{
    if (!found->count)
        return false;
    *out_site = gn_report_site(report, build->tlas_id, 0);
    return gn_report_is_new(report, *out_site);
}

static void reference_unknown(const struct gn_tlas_build *build, struct gn_report *report)
{
    struct gn_survey_class unknown = {0, 0};
    const struct gn_structure *former = NULL;
    bool any_destroyed = false;
    for (uint32_t s = 0; s < build->structure_count; s++)
        any_destroyed |= build->structures[s].destroyed;
    if (!any_destroyed && !build->references_sure)
        return;
    for (uint32_t i = 0; i < build->instance_count; i++) {
        uint32_t index = build->refers_to[i];
        bool dead = index < build->structure_count && build->structures[index].destroyed;
        if (!dead && !(index == GN_REFERENCE_UNKNOWN && build->references_sure))
            continue;
        if (!unknown.count++) {
            unknown.first = i;
            former = dead ? &build->structures[index] : NULL;
        }
    }
    uint64_t site;
    if (!begin(build, report, &unknown, &site))
        return;
    char tlas_text[256], former_text[256], instance_text[96];
    struct gn_object objects[2] = {build->tlas};
    unsigned long long reference = build->instances[unknown.first].reference;
    which(build, &unknown, instance_text, sizeof instance_text);
    gn_object_describe(&build->tlas, tlas_text, sizeof tlas_text);
    if (former) {
        objects[1] = former->object;
        gn_report_add(report, site, objects, 2,
                      "%s of %s refers to 0x%llx, the address of %s, which was destroyed before this build was submitted. "
                      "Found in %s.",
                      instance_text, tlas_text, reference,
                      gn_object_describe(&former->object, former_text, sizeof former_text), place_of(build));
    } else {
        gn_report_add(report, site, objects, 1,
                      "%s of %s refers to 0x%llx, which is the address of no acceleration structure alive%s. Found in %s.",
                      instance_text, tlas_text, reference,
                      reference % 256 ? " (every such address is a multiple of 256)" : "", place_of(build));
    }
}

const struct gn_rule gn_rule_instance_reference_unknown = {
    .id = "instances.reference_unknown",
    .title = "Instance refers to no acceleration structure",
    .text = "An instance's accelerationStructureReference is 0 or the address of an acceleration structure that is alive when the "
            "build is submitted (its handle, in a build on the host).",
    .remedy = "Write the value that vkGetAccelerationStructureDeviceAddressKHR gave for a BLAS that still exists, or 0, and keep "
              "a BLAS alive as long as instances refer to it.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-06707",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-12281",
                "VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-03709",
                "VUID-vkBuildAccelerationStructuresKHR-pInfos-03779", "WG-010", "WR-083"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_TLAS_BUILD,
    .test.tlas_build = reference_unknown,
};

static void reference_tlas(const struct gn_tlas_build *build, struct gn_report *report)
{
    for (uint32_t s = 0; s < build->structure_count; s++) {
        const struct gn_structure *structure = &build->structures[s];
        if (!structure->is_top || structure->destroyed)
            continue;
        uint64_t site = gn_report_site(report, build->tlas_id, structure->id);
        if (!gn_report_is_new(report, site))
            continue;
        uint32_t i = 0;
        while (i < build->instance_count && build->refers_to[i] != s)
            i++;
        char tlas_text[256], other_text[256];
        struct gn_object objects[] = {build->tlas, structure->object};
        gn_report_add(report, site, objects, 2, "instance %u of %u of %s refers to %s, which is not a BLAS. Found in %s.", i,
                      build->instance_count, gn_object_describe(&build->tlas, tlas_text, sizeof tlas_text),
                      gn_object_describe(&structure->object, other_text, sizeof other_text), place_of(build));
    }
}

const struct gn_rule gn_rule_instance_reference_tlas = {
    .id = "instances.reference_tlas",
    .title = "Instance refers to a TLAS",
    .text = "Instances refer to bottom-level structures: created as such, or of generic type and built as such.",
    .remedy = "Refer to a BLAS; a TLAS cannot be nested in another one.",
    .sources = {"VUID-vkCmdBuildAccelerationStructuresKHR-pInfos-12281", "WG-010", "WR-083"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_TLAS_BUILD,
    .test.tlas_build = reference_tlas,
};

static void flags_reserved(const struct gn_tlas_build *build, struct gn_report *report)
{
    const struct gn_survey_class *found = &report->survey->bad_flags;
    uint64_t site;
    if (!begin(build, report, found, &site))
        return;
    char tlas_text[256], instance_text[96];
    gn_report_add(report, site, &build->tlas, 1,
                  "%s of %s has flags 0x%02x, of which 0x%02x are not defined on this device (0x%02x are). Found in %s.",
                  which(build, found, instance_text, sizeof instance_text),
                  gn_object_describe(&build->tlas, tlas_text, sizeof tlas_text),
                  build->instances[found->first].sbt_offset_and_flags >> 24,
                  build->instances[found->first].sbt_offset_and_flags >> 24 & ~build->valid_flags, build->valid_flags,
                  place_of(build));
}

const struct gn_rule gn_rule_instance_flags_reserved = {
    .id = "instances.flags_reserved",
    .title = "Undefined instance flags",
    .text = "The 8 flag bits of an instance hold flags that Vulkan or an enabled extension defines. A shader-binding-table offset of "
            "more than 24 bits runs over into them.",
    .remedy = "Pack the offset with & 0xFFFFFF, and set defined flags only (gn_instance_pack in checks/rules/instance.h does both).",
    .sources = {"VUID-VkAccelerationStructureInstanceKHR-flags-parameter", "WR-035", "WR-079"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_TLAS_BUILD,
    .surveys = true,
    .test.tlas_build = flags_reserved,
};

static void matrix_singular(const struct gn_tlas_build *build, struct gn_report *report)
{
    const struct gn_survey_class *found = &report->survey->bad_matrix;
    uint64_t site;
    if (!begin(build, report, found, &site))
        return;
    char tlas_text[256], instance_text[96];
    const float *m = build->instances[found->first].object_to_world;
    gn_report_add(report, site, &build->tlas, 1,
                  "%s of %s has a transform without inverse: the 3x3 matrix (%g %g %g; %g %g %g; %g %g %g) is not finite or has "
                  "the determinant 0, exactly. Found in %s.",
                  which(build, found, instance_text, sizeof instance_text),
                  gn_object_describe(&build->tlas, tlas_text, sizeof tlas_text), (double)m[0], (double)m[1], (double)m[2],
                  (double)m[4], (double)m[5], (double)m[6], (double)m[8], (double)m[9], (double)m[10], place_of(build));
}

const struct gn_rule gn_rule_instance_matrix_singular = {
    .id = "instances.matrix_singular",
    .title = "Instance transform without inverse",
    .text = "The first three columns of an active instance's transform define an invertible 3x3 matrix. The determinant is "
            "computed exactly: a scale of 1e-12 is fine, a scale of 0 is not.",
    .remedy = "Give the instance an invertible transform; to hide it, set its mask or its accelerationStructureReference to 0.",
    .sources = {"VUID-VkTransformMatrixKHR-matrix-03799", "WG-011", "WR-081"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_TLAS_BUILD,
    .surveys = true,
    .test.tlas_build = matrix_singular,
};

static void translation_not_finite(const struct gn_tlas_build *build, struct gn_report *report)
{
    const struct gn_survey_class *found = &report->survey->bad_translation;
    uint64_t site;
    if (!begin(build, report, found, &site))
        return;
    char tlas_text[256], instance_text[96];
    const float *m = build->instances[found->first].object_to_world;
    gn_report_add(report, site, &build->tlas, 1, "%s of %s is moved by (%g, %g, %g), which is not finite. Found in %s.",
                  which(build, found, instance_text, sizeof instance_text),
                  gn_object_describe(&build->tlas, tlas_text, sizeof tlas_text), (double)m[3], (double)m[7], (double)m[11],
                  place_of(build));
}

const struct gn_rule gn_rule_instance_translation_not_finite = {
    .id = "instances.translation_not_finite",
    .title = "Instance moved to infinity or NaN",
    .text = "The translation of an active instance is finite. Vulkan has no word against it, but no ray hits such an instance, and a "
            "TLAS whose bounds are infinite is slow to trace.",
    .remedy = "Give the instance a finite translation; to hide it, set its mask or its accelerationStructureReference to 0.",
    .sources = {"WG-011", "WR-081"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_WARNING),
    .on = GN_RULE_ON_TLAS_BUILD,
    .surveys = true,
    .test.tlas_build = translation_not_finite,
};

static void mask_zero(const struct gn_tlas_build *build, struct gn_report *report)
{
    const struct gn_survey_class *found = &report->survey->mask_zero;
    uint64_t site;
    if (build->partial || found->count < report->survey->active || !begin(build, report, found, &site))
        return;
    char tlas_text[256];
    gn_report_add(report, site, &build->tlas, 1, "the mask of each of the %u active instances of %s is 0: no ray can hit any of them. Found in %s.",
                  found->count, gn_object_describe(&build->tlas, tlas_text, sizeof tlas_text), place_of(build));
}

const struct gn_rule gn_rule_instance_mask_zero = {
    .id = "instances.mask_zero",
    .title = "TLAS in which no ray hits anything",
    .text = "An instance of mask 0 is hit by no ray: a usual way to hide one, and as often a mask that was forgotten. A TLAS is worth a "
            "note when it has active instances and all of their masks are 0.",
    .remedy = "Set the mask (0xFF lets every ray hit that has a cull mask).",
    .sources = {"WG-014", "WR-077"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_NOTE),
    .on = GN_RULE_ON_TLAS_BUILD,
    .surveys = true,
    .test.tlas_build = mask_zero,
};

static void mask_undeclared(const struct gn_tlas_build *build, struct gn_report *report)
{
    const struct gn_survey_class *found = &report->survey->mask_undeclared;
    uint64_t site;
    if (!begin(build, report, found, &site))
        return;
    char tlas_text[256], instance_text[96];
    uint32_t word = build->instances[found->first].custom_index_and_mask;
    gn_report_add(report, site, &build->tlas, 1,
                  "%s of %s has mask 0x%02x, which is not among the declared masks; its 32-bit word is 0x%08x, custom index 0x%06x. "
                  "Found in %s.",
                  which(build, found, instance_text, sizeof instance_text),
                  gn_object_describe(&build->tlas, tlas_text, sizeof tlas_text), word >> 24, word, word & 0xFFFFFFu,
                  place_of(build));
}

const struct gn_rule gn_rule_instance_mask_undeclared = {
    .id = "instances.mask_undeclared",
    .title = "Instance mask that was not declared",
    .text = "Where the application declares the masks that it uses, every active instance has one of them. A custom index of more than "
            "24 bits runs over into the mask.",
    .remedy = "Keep custom indices below 2^24 (gn_instance_pack in checks/rules/instance.h checks that), or declare the mask too.",
    .sources = {"WG-013", "WG-014", "WR-078"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_TLAS_BUILD,
    .surveys = true,
    .test.tlas_build = mask_undeclared,
};

static void custom_index_bound(const struct gn_tlas_build *build, struct gn_report *report)
{
    const struct gn_survey_class *found = &report->survey->index_above;
    uint64_t site;
    if (!begin(build, report, found, &site))
        return;
    char tlas_text[256], instance_text[96];
    gn_report_add(report, site, &build->tlas, 1,
                  "%s of %s has custom index %u, but all of them were declared to be below %u. Found in %s.",
                  which(build, found, instance_text, sizeof instance_text),
                  gn_object_describe(&build->tlas, tlas_text, sizeof tlas_text),
                  build->instances[found->first].custom_index_and_mask & 0xFFFFFFu, build->custom_index_bound, place_of(build));
}

const struct gn_rule gn_rule_custom_index_bound = {
    .id = "instances.custom_index_bound",
    .title = "Custom index at or above the declared bound",
    .text = "Where the application declares a bound, the custom index of every active instance is below it.",
    .remedy = "Write an index that exists (gn_instance_pack in checks/rules/instance.h refuses one of more than 24 bits), or declare a "
              "higher bound.",
    .sources = {"WG-012", "WG-013", "WR-078"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_TLAS_BUILD,
    .surveys = true,
    .test.tlas_build = custom_index_bound,
};

static void custom_index_overflow(const struct gn_tlas_build *build, struct gn_report *report)
{
    const struct gn_survey_class *found = &report->survey->carry;
    uint64_t site;
    if (!begin(build, report, found, &site))
        return;
    char tlas_text[256];
    uint32_t before = build->instances[found->first - 1].custom_index_and_mask;
    uint32_t word = build->instances[found->first].custom_index_and_mask;
    gn_report_add(report, site, &build->tlas, 1,
                  "from instance %u to %u of %s, the word of custom index and mask rises from 0x%08x to 0x%08x in the step of its "
                  "neighbours: the index may have passed 2^24, and the mask was 0x%02x and is 0x%02x. Found in %s.",
                  found->first - 1, found->first, gn_object_describe(&build->tlas, tlas_text, sizeof tlas_text), before, word,
                  before >> 24, word >> 24, place_of(build));
}

const struct gn_rule gn_rule_custom_index_overflow = {
    .id = "instances.custom_index_overflow",
    .title = "Custom index that seems to run over into the mask",
    .text = "The custom index has 24 bits and lies below the mask in one word. Words that rise in equal steps through a multiple of 2^24 "
            "look like an index that grew out of its field. This is a guess from the values: memory does not tell what was meant.",
    .remedy = "Keep custom indices below 2^24 (gn_instance_pack in checks/rules/instance.h checks that). If the values are meant, disable "
              "this rule, or declare the masks in use to have them checked instead.",
    .sources = {"WG-013", "WR-078"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_NOTE),
    .on = GN_RULE_ON_TLAS_BUILD,
    .surveys = true,
    .test.tlas_build = custom_index_overflow,
};

static void sbt_offset_bound(const struct gn_tlas_build *build, struct gn_report *report)
{
    const struct gn_survey_class *found = &report->survey->offset_above;
    uint64_t site;
    if (!begin(build, report, found, &site))
        return;
    char tlas_text[256], instance_text[96];
    gn_report_add(report, site, &build->tlas, 1,
                  "%s of %s has the shader-binding-table offset %u, which is not below the declared bound %u. Found in %s.",
                  which(build, found, instance_text, sizeof instance_text),
                  gn_object_describe(&build->tlas, tlas_text, sizeof tlas_text),
                  build->instances[found->first].sbt_offset_and_flags & 0xFFFFFFu, build->sbt_offset_bound, place_of(build));
}

const struct gn_rule gn_rule_sbt_offset_bound = {
    .id = "instances.sbt_offset_bound",
    .title = "Shader-binding-table offset at or above the declared bound",
    .text = "Where the application declares a bound, the instanceShaderBindingTableRecordOffset of every active instance is below it.",
    .remedy = "Write an offset that lies in the table (gn_instance_pack in checks/rules/instance.h refuses one of more than 24 bits), or "
              "declare a higher bound.",
    .sources = {"WR-079", "DE-098"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_ERROR),
    .on = GN_RULE_ON_TLAS_BUILD,
    .surveys = true,
    .test.tlas_build = sbt_offset_bound,
};

static void sbt_offset_overflow(const struct gn_tlas_build *build, struct gn_report *report)
{
    const struct gn_survey_class *found = &report->survey->offset_carry;
    uint64_t site;
    if (!begin(build, report, found, &site))
        return;
    char tlas_text[256];
    uint32_t before = build->instances[found->first - 1].sbt_offset_and_flags;
    uint32_t word = build->instances[found->first].sbt_offset_and_flags;
    gn_report_add(report, site, &build->tlas, 1,
                  "from instance %u to %u of %s, the word of shader-binding-table offset and flags rises from 0x%08x to 0x%08x in the step "
                  "of its neighbours: the offset may have passed 2^24, and the flags were 0x%02x and are 0x%02x. Found in %s.",
                  found->first - 1, found->first, gn_object_describe(&build->tlas, tlas_text, sizeof tlas_text), before, word,
                  before >> 24, word >> 24, place_of(build));
}

const struct gn_rule gn_rule_sbt_offset_overflow = {
    .id = "instances.sbt_offset_overflow",
    .title = "Shader-binding-table offset that seems to run over into the flags",
    .text = "The offset has 24 bits and lies below the flags in one word. Words that rise in equal steps through a multiple of 2^24 look "
            "like an offset that grew out of its field. This is a guess from the values: memory does not tell what was meant.",
    .remedy = "Keep offsets below 2^24 (gn_instance_pack in checks/rules/instance.h checks that). If the values are meant, disable this rule.",
    .sources = {"WR-079", "DE-098"},
    .severity = GN_EVERYWHERE(GN_SEVERITY_NOTE),
    .on = GN_RULE_ON_TLAS_BUILD,
    .surveys = true,
    .test.tlas_build = sbt_offset_overflow,
};
