/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Expectation files: deqp-runner's `name,Status` lines, with the reasons in comments. deqp-runner has no word for a leak and
 * calls it Fail, so Fail expects either; Leak is our own word, and expects a leak only.
 */
#include "cts/select.h"

#include <ctype.h>
#include <stdlib.h>
#include <string.h>

static const char *const words[] = {"Pass", "Fail", "Leak", "Skip", "Crash", "Timeout"};

static char *trim(char *text)
{
    while (isspace((unsigned char)*text))
        text++;
    size_t length = strlen(text);
    while (length && isspace((unsigned char)text[length - 1]))
        text[--length] = 0;
    return text;
}

/* One line without its newline. A comment above an entry is its reason; an empty line ends a comment's
 * reach. */
static bool read_line(struct gn_expectations *expectations, char *line, const char *path, size_t number,
                      const char **reason, bool *reason_used, struct gn_arena *arena, char *out_error,
                      size_t error_size)
{
    const char *behind = "";
    char *comment = strchr(line, '#');
    if (comment) {
        *comment = 0;
        behind = gn_arena_printf(arena, "%s", trim(comment + 1));
    }
    char *text = trim(line);
    if (!*text) {
        if (!comment)
            *reason = "";
        else if (*reason_used || !**reason)
            *reason = behind;
        else
            *reason = gn_arena_printf(arena, "%s %s", *reason, behind);
        *reason_used = false;
        return true;
    }
    char *comma = strrchr(text, ',');
    if (!comma) {
        snprintf(out_error, error_size, "%s:%zu: expected `name,Status`, found '%.200s'", path, number, text);
        return false;
    }
    *comma = 0;
    const char *name = trim(text), *status = trim(comma + 1), *word = NULL;
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++)
        if (strcmp(status, words[i]) == 0)
            word = words[i];
    if (!word || !*name) {
        snprintf(out_error, error_size,
                 "%s:%zu: expected a name and one of Pass, Fail, Leak, Skip, Crash, Timeout, found '%.200s' and "
                 "'%.100s'",
                 path, number, name, status);
        return false;
    }
    struct gn_expectation *grown =
        realloc(expectations->list, (expectations->count + 1) * sizeof *expectations->list);
    if (!grown) {
        snprintf(out_error, error_size, "%s: out of memory", path);
        return false;
    }
    expectations->list = grown;
    grown[expectations->count++] =
        (struct gn_expectation){gn_arena_printf(arena, "%s", name), word, *behind ? behind : *reason,
                                gn_arena_printf(arena, "%s:%zu", path, number)};
    *reason_used = true;
    return true;
}

bool gn_expectations_read(struct gn_expectations *expectations, const char *path, struct gn_arena *arena,
                          char *out_error, size_t error_size)
{
    char *data = NULL;
    size_t length = 0, number = 1;
    if (!gn_file_read(path, 64 << 20, &data, &length, out_error, error_size))
        return false;
    bool ok = true, reason_used = false;
    const char *reason = "";
    if (memchr(data, 0, length)) {
        snprintf(out_error, error_size, "%s: expected text, found a zero byte", path);
        ok = false;
    }
    for (char *at = data; (at = strstr(at, "\r\n"));)
        *at = ' ';
    gn_text_clean(data);
    for (char *at = data; ok && *at; number++) {
        char *end = strchr(at, '\n');
        if (end)
            *end = 0;
        char *next = end ? end + 1 : at + strlen(at);
        ok = read_line(expectations, at, path, number, &reason, &reason_used, arena, out_error, error_size);
        at = next;
    }
    free(data);
    return ok;
}

void gn_expectations_finish(struct gn_expectations *expectations)
{
    free(expectations->list);
    *expectations = (struct gn_expectations){0};
}

void gn_expectations_apply(const struct gn_expectations *expectations, struct gn_results_case *cs)
{
    const struct gn_expectation *found = NULL;
    for (size_t i = 0; i < expectations->count; i++)
        if (strcmp(expectations->list[i].name, cs->name) == 0)
            found = &expectations->list[i];
    bool failed = gn_case_status_is_failure(cs->status);
    cs->outcome = failed ? GN_OUTCOME_UNEXPECTED : GN_OUTCOME_AS_EXPECTED;
    cs->expected = found ? found->status : "";
    cs->expected_reason = found ? found->reason : "";
    if (!found)
        return;
    bool expects_failure = strcmp(found->status, "Pass") != 0 && strcmp(found->status, "Skip") != 0;
    if (failed && (strcmp(found->status, gn_case_status_deqp(cs->status)) == 0 ||
                   (cs->status == GN_CASE_LEAK && strcmp(found->status, "Leak") == 0)))
        cs->outcome = GN_OUTCOME_EXPECTED_FAILURE;
    else if (cs->status == GN_CASE_PASS && expects_failure)
        cs->outcome = GN_OUTCOME_UNEXPECTED_PASS;
}

void gn_expectations_check(const struct gn_expectations *expectations, const struct gn_selected *catalogue,
                           size_t count, struct gn_results *results)
{
    for (size_t i = 0; i < expectations->count; i++) {
        const struct gn_expectation *e = &expectations->list[i];
        if (!gn_catalogue_find(catalogue, count, e->name))
            gn_results_add_unmatched(results, gn_arena_printf(&results->arena, "%s: %s", e->place, e->name));
    }
}
