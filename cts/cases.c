/* SPDX-License-Identifier: Apache-2.0 */
/* The list of case families, from cts/cases/families.def. */
#include "cts/case.h"

#define BOTH (1u << GN_CASE_QUERY | 1u << GN_CASE_PIPELINE)

#define GN_FAMILY(name, reason) extern const struct gn_case_family gn_family_##name;
#define GN_FAMILY_OF(name, backend, reason) GN_FAMILY(name, reason)
#include "cts/cases/families.def"
#undef GN_FAMILY
#undef GN_FAMILY_OF

const struct gn_case_family *const gn_case_families[] = {
#define GN_FAMILY(name, reason) &gn_family_##name,
#define GN_FAMILY_OF(name, backend, reason) &gn_family_##name,
#include "cts/cases/families.def"
#undef GN_FAMILY
#undef GN_FAMILY_OF
};
const uint32_t gn_case_family_backends[] = {
#define GN_FAMILY(name, reason) BOTH,
#define GN_FAMILY_OF(name, backend, reason) 1u << (backend),
#include "cts/cases/families.def"
#undef GN_FAMILY
#undef GN_FAMILY_OF
};
const char *const gn_case_family_reasons[] = {
#define GN_FAMILY(name, reason) reason,
#define GN_FAMILY_OF(name, backend, reason) reason,
#include "cts/cases/families.def"
#undef GN_FAMILY
#undef GN_FAMILY_OF
};
const size_t gn_case_family_count = sizeof gn_case_families / sizeof gn_case_families[0];
