/* SPDX-License-Identifier: Apache-2.0 */
/* The list of case families, from cts/cases/families.def. */
#include "cts/case.h"

#define GN_FAMILY(name) extern const struct gn_case_family gn_family_##name;
#include "cts/cases/families.def"
#undef GN_FAMILY

const struct gn_case_family *const gn_case_families[] = {
#define GN_FAMILY(name) &gn_family_##name,
#include "cts/cases/families.def"
#undef GN_FAMILY
};
const size_t gn_case_family_count = sizeof gn_case_families / sizeof gn_case_families[0];
