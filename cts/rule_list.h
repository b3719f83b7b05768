/* SPDX-License-Identifier: Apache-2.0 */
/* All rules as one list: those that the layer judges calls and contents by, then those about shaders. */
#ifndef GNOMON_CTS_RULE_LIST_H
#define GNOMON_CTS_RULE_LIST_H

#include <stddef.h>

#include "checks/rules/rules.h"

/* What the catalogue says of a rule; the strings live as long as the program. */
struct gn_rule_entry {
    const char *id, *title, *text, *remedy;
    const char *const *sources; /* ends with NULL */
    const enum gn_severity *severity; /* by enum gn_profile */
};

size_t gn_rule_list_count(void);
/* `index` below the count. */
struct gn_rule_entry gn_rule_list_at(size_t index);

#endif
