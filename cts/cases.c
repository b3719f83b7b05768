/* SPDX-License-Identifier: Apache-2.0 */
/* The list of case families, from cts/cases/families.def. */
#include "cts/case.h"

#define BOTH (1u << GN_CASE_QUERY | 1u << GN_CASE_PIPELINE)

#define GN_FAMILY(name) extern const struct gn_case_family gn_family_##name;
#define GN_FAMILY_OF(name, backend) GN_FAMILY(name)
#include "cts/cases/families.def"
#undef GN_FAMILY
#undef GN_FAMILY_OF

const struct gn_case_family *const gn_case_families[] = {
#define GN_FAMILY(name) &gn_family_##name,
#define GN_FAMILY_OF(name, backend) &gn_family_##name,
#include "cts/cases/families.def"
#undef GN_FAMILY
#undef GN_FAMILY_OF
};
const uint32_t gn_case_family_backends[] = {
#define GN_FAMILY(name) BOTH,
#define GN_FAMILY_OF(name, backend) 1u << (backend),
#include "cts/cases/families.def"
#undef GN_FAMILY
#undef GN_FAMILY_OF
};
const size_t gn_case_family_count = sizeof gn_case_families / sizeof gn_case_families[0];
