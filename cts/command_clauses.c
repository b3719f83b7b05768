/* SPDX-License-Identifier: Apache-2.0 */
/* `gnomon clauses`: which statement of the API documents is held by which cases and rules (docs/clauses.tsv). */
#include <argp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clauses.tsv.h"
#include "cts/commands.h"
#include "cts/rule_list.h"
#include "cts/select.h"

enum { COLUMN_ID, COLUMN_KIND, COLUMN_EVIDENCE, COLUMN_STATEMENT, COLUMN_COUNT };

/* What has become of a clause, from what wants work to what is done. */
enum state { MISSING, NOT_ASKED, EXPLAINED, HELD, STATE_COUNT };

static const struct argp_option options[] = {
    {"missing", 'm', NULL, 0, "Only the clauses that neither a case nor a rule holds, and that do not say why", 0},
    {0}};

static error_t parse(int key, char *value, struct argp_state *state)
{
    bool *missing = state->input;
    switch (key) {
    case 'm': *missing = true; break;
    case ARGP_KEY_ARG: argp_error(state, "clauses takes no arguments; found '%s'", value); break;
    default: return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

static bool cites(const struct gn_rule_entry *rule, const char *id)
{
    for (size_t s = 0; rule->sources[s]; s++)
        if (strcmp(rule->sources[s], id) == 0)
            return true;
    return false;
}

static size_t list_rules(FILE *out, const char *id)
{
    size_t count = 0;
    for (size_t i = 0; i < gn_rule_list_count(); i++) {
        const struct gn_rule_entry rule = gn_rule_list_at(i);
        if (cites(&rule, id))
            fprintf(out, "%s%s", count++ ? ", " : "  rules: ", rule.id);
    }
    if (count)
        fputc('\n', out);
    return count;
}

/* Whether every clause that a rule cites is in the list. */
static bool known_citations(void)
{
    for (size_t i = 0; i < gn_rule_list_count(); i++) {
        const struct gn_rule_entry rule = gn_rule_list_at(i);
        for (size_t s = 0; rule.sources[s]; s++) {
            char line[16];
            const char *source = rule.sources[s];
            if (strlen(source) != 6 || source[2] != '-' || strspn(source + 3, "0123456789") != 3)
                continue;
            snprintf(line, sizeof line, "\n%s\t", source);
            if (!strstr(gn_clauses, line)) {
                fprintf(stderr, "%s: the rule %s cites %s, which is no clause\n", gn_command_name, rule.id, source);
                return false;
            }
        }
    }
    return true;
}

/* SIZE_MAX: a pattern matches no case. */
static size_t list_cases(FILE *out, char *patterns, const struct gn_selected *catalogue, size_t catalogue_count, const char *id)
{
    size_t all = 0;
    char *rest;
    for (char *pattern = strtok_r(patterns, " ", &rest); pattern; pattern = strtok_r(NULL, " ", &rest)) {
        size_t count = 0;
        for (size_t i = 0; i < catalogue_count; i++)
            count += gn_pattern_matches(pattern, catalogue[i].self->name);
        if (count == 0) {
            fprintf(stderr, "%s: %s names the cases '%s', but there is none\n", gn_command_name, id, pattern);
            return SIZE_MAX;
        }
        fprintf(out, "%s%s (%zu)", all ? ", " : "  cases: ", pattern, count);
        all += count;
    }
    if (all)
        fputc('\n', out);
    return all;
}

/* Features and advice say what an API offers and what is quick: nothing that an application or a driver could get wrong. */
static bool asked(const char *kind)
{
    return strcmp(kind, "feature") != 0 && strcmp(kind, "advice") != 0;
}

/* Writes the clause into `out`; STATE_COUNT: the list is wrong, which has been said. */
static enum state judge(FILE *out, char *columns[COLUMN_COUNT], const struct gn_selected *catalogue, size_t catalogue_count)
{
    const char *id = columns[COLUMN_ID];
    char *evidence = columns[COLUMN_EVIDENCE];
    fprintf(out, "%s, %s: %s\n", id, columns[COLUMN_KIND], columns[COLUMN_STATEMENT]);
    const bool reason = evidence[0] == '-';
    const size_t rules = list_rules(out, id);
    const size_t cases = reason ? 0 : list_cases(out, evidence, catalogue, catalogue_count, id);
    if (cases == SIZE_MAX)
        return STATE_COUNT;
    if (reason && rules) {
        fprintf(stderr, "%s: %s is held by a rule, and still says why by none\n", gn_command_name, id);
        return STATE_COUNT;
    }
    if (rules || cases)
        return HELD;
    if (reason) {
        fprintf(out, "  by none: it%s\n", evidence + 1);
        return EXPLAINED;
    }
    if (!asked(columns[COLUMN_KIND])) {
        fprintf(out, "  nothing to hold\n");
        return NOT_ASKED;
    }
    fprintf(out, "  missing\n");
    return MISSING;
}

int gn_command_clauses(int argc, char **argv)
{
    static const struct argp parser = {
        options, parse, "",
        "Lists the statements of the API documents that Gnomon was made from, and by which cases and rules each is held. "
        "Exits with 1 when --missing finds one.",
        NULL, NULL, NULL};
    bool missing_only = false;
    size_t counts[STATE_COUNT] = {0}, catalogue_count, text_size = 0;
    struct gn_arena arena = {0};
    struct gn_selected *catalogue = NULL;
    char *text = NULL, *list = NULL;
    FILE *out = NULL;
    int status = 3;
    if (argp_parse(&parser, argc, argv, 0, NULL, &missing_only) != 0)
        return 2;
    catalogue = gn_catalogue(&arena, &catalogue_count);
    list = strdup(gn_clauses);
    if (!list || !known_citations())
        goto done;
    char *rest_lines;
    strtok_r(list, "\n", &rest_lines); /* the heading */
    for (char *line = strtok_r(NULL, "\n", &rest_lines); line; line = strtok_r(NULL, "\n", &rest_lines)) {
        char *columns[COLUMN_COUNT];
        for (int c = 0; c < COLUMN_COUNT; c++)
            if (!(columns[c] = strsep(&line, "\t"))) {
                fprintf(stderr, "%s: a line of the list of clauses has %d columns\n", gn_command_name, c);
                goto done;
            }
        if (!(out = open_memstream(&text, &text_size)))
            goto done;
        const enum state state = judge(out, columns, catalogue, catalogue_count);
        if (fclose(out) != 0 || state == STATE_COUNT)
            goto done;
        counts[state]++;
        if (!missing_only || state == MISSING)
            fwrite(text, 1, text_size, stdout);
        free(text);
        text = NULL;
    }
    printf("%zu held by cases or rules, %zu by none with a reason, %zu features and advice with nothing to hold, %zu missing\n",
           counts[HELD], counts[EXPLAINED], counts[NOT_ASKED], counts[MISSING]);
    status = fflush(stdout) != 0 || ferror(stdout) ? 3 : missing_only && counts[MISSING] ? 1 : 0;
done:
    free(text);
    free(list);
    free(catalogue);
    gn_arena_finish(&arena);
    return status;
}
