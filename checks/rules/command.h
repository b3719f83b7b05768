/* SPDX-License-Identifier: Apache-2.0 */
/* What the rules about commands share. For files of checks/rules only. */
#ifndef GN_CHECKS_RULES_COMMAND_H
#define GN_CHECKS_RULES_COMMAND_H

#include "checks/rules/rules.h"

#define GN_ABOUT(kind) (UINT32_C(1) << GN_COMMAND_##kind)

/* Whether the structure is known and lacks contents for certain. */
static inline bool gn_never_built(const struct gn_contents *contents)
{
    return contents->structure.object.kind != GN_OBJECT_NONE &&
           (contents->structure.built == GN_BUILT_NEVER || contents->structure.built == GN_BUILT_LATER);
}

/* Whether the structure is known, has contents, and what built them is known. */
static inline bool gn_shape_known(const struct gn_contents *contents)
{
    return contents->structure.object.kind != GN_OBJECT_NONE && contents->structure.built == GN_BUILT_BEFORE &&
           contents->shape;
}

static inline const char *gn_place(const struct gn_command *command)
{
    return command->place ? command->place : "a command";
}

/* One site per rule and pair of structures. */
static inline bool gn_command_site(const struct gn_command *command, struct gn_report *report, uint64_t *out_site)
{
    *out_site = gn_report_site(report, command->target.structure.id, command->source.structure.id);
    return gn_report_is_new(report, *out_site);
}

#endif
