/* SPDX-License-Identifier: Apache-2.0 */
/* The list of all rules. */
#include "cts/rule_list.h"

#include "checks/spirv/spirv.h"

size_t gn_rule_list_count(void)
{
    return gn_rules_count() + GN_SPIRV_RULE_COUNT;
}

#define ENTRY(rule) (struct gn_rule_entry){(rule)->id, (rule)->title, (rule)->text, (rule)->remedy, (rule)->sources, (rule)->severity}

struct gn_rule_entry gn_rule_list_at(size_t index)
{
    const size_t others = gn_rules_count();
    return index < others ? ENTRY(gn_rules_at(index)) : ENTRY(gn_spirv_rule_at((enum gn_spirv_rule_index)(index - others)));
}
