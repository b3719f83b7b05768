/* SPDX-License-Identifier: Apache-2.0 */
/* One pass over the instances of a TLAS build, for all rules about their contents: a build may have a million of them, and reading
 * the records is most of the cost. */
#ifndef GN_CHECKS_RULES_SURVEY_H
#define GN_CHECKS_RULES_SURVEY_H

#include <stdbool.h>
#include <stdint.h>

#include "checks/rules/values.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The instances with one property: how many, and the first of them. */
struct gn_survey_class {
    uint32_t count, first;
};

/* Only active instances are counted: those whose reference is not 0. */
struct gn_survey {
    uint32_t active;
    struct gn_survey_class mask_zero;
    struct gn_survey_class mask_undeclared; /* empty if no masks are declared */
    struct gn_survey_class index_above;     /* custom index at or above the declared bound; empty without one */
    struct gn_survey_class offset_above;    /* the same of shader-binding-table offsets */
    struct gn_survey_class bad_flags;       /* bits outside of valid_flags */
    struct gn_survey_class bad_matrix;      /* the 3x3 part is not finite, or its determinant is exactly 0 */
    struct gn_survey_class bad_translation; /* the fourth column is not finite */
    struct gn_survey_class carry;           /* see gn_rule_custom_index_overflow; `first` is the instance after the carry */
    struct gn_survey_class offset_carry;    /* the same of the word of offset and flags */
    uint32_t highest_offset, highest_offset_at; /* of those whose mask is not 0, and the first instance that has it */
};

/* Adds the instances [first, first + count) of the build to a survey that was all zero at first, in rising order. */
void gn_survey_add(const struct gn_tlas_build *build, uint32_t first, uint32_t count, struct gn_survey *out);

/* The sign of the determinant of the 3x3 part of an object-to-world transform: -1, 0 or 1, exact for every finite input. */
int gn_transform_orientation_exact(const float object_to_world[12]);

#ifdef __cplusplus
}
#endif
#endif
