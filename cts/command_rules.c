/* SPDX-License-Identifier: Apache-2.0 */
/* `gnomon rules`: the catalogue of rules, from the blocks that hold them. */
#include <argp.h>
#include <stdio.h>

#include "cts/commands.h"
#include "cts/rule_list.h"

static const struct argp_option options[] = {
    {"markdown", 'm', NULL, 0, "Write a Markdown document", 0},
    {0}};

static error_t parse(int key, char *value, struct argp_state *state)
{
    bool *markdown = state->input;
    switch (key) {
    case 'm': *markdown = true; break;
    case ARGP_KEY_ARG: argp_error(state, "rules takes no arguments; found '%s'", value); break;
    default: return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

static void print_sources(const struct gn_rule_entry *rule)
{
    for (size_t s = 0; rule->sources[s]; s++)
        printf("%s%s", s ? ", " : "", rule->sources[s]);
    putchar('\n');
}

/* "error (vulkan, wgpu), note (hgi)": every severity that some profile has, with the profiles. */
static void print_severities(const struct gn_rule_entry *rule)
{
    const char *between = "";
    for (int severity = GN_SEVERITY_COUNT - 1; severity >= GN_SEVERITY_SILENT; severity--) {
        const char *separator = "";
        for (int profile = 0; profile < GN_PROFILE_COUNT; profile++) {
            if ((int)rule->severity[profile] != severity)
                continue;
            if (!*separator)
                printf("%s%s (", between, gn_severity_name((enum gn_severity)severity));
            printf("%s%s", separator, gn_profile_name((enum gn_profile)profile));
            separator = ", ";
        }
        if (*separator) {
            putchar(')');
            between = "; ";
        }
    }
    putchar('\n');
}

int gn_command_rules(int argc, char **argv)
{
    static const struct argp parser = {options, parse, "", "Lists the rules that the layer judges an application and its shaders by.",
                                       NULL, NULL, NULL};
    bool markdown = false;
    if (argp_parse(&parser, argc, argv, 0, NULL, &markdown) != 0)
        return 2;
    if (markdown)
        printf("# The layer's rules\n");
    for (size_t i = 0; i < gn_rule_list_count(); i++) {
        const struct gn_rule_entry entry = gn_rule_list_at(i), *rule = &entry;
        const char *item = markdown ? "- **" : "  ", *end = markdown ? "**: " : ": ";
        printf(markdown ? "\n## `%s`\n\n%s. %s\n\n" : "\n%s\n  %s. %s\n", rule->id, rule->title, rule->text);
        printf("%sseverity%s", item, end);
        print_severities(rule);
        printf("%sremedy%s%s\n", item, end, rule->remedy);
        printf("%ssources%s", item, end);
        print_sources(rule);
    }
    return fflush(stdout) == 0 && !ferror(stdout) ? 0 : 3;
}
