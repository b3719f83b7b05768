/* SPDX-License-Identifier: Apache-2.0 */
/* Rewriting an expectation file to what came out, with what people wrote into it kept. */
#include "cts/expect.h"

#include <ctype.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* How much of a case's message becomes its first comment. */
#define REASON_MOST 160

struct update {
    const struct gn_results *results;
    const struct gn_selected *catalogue;
    size_t catalogue_count;
    struct gn_expectations_changes changes;
    FILE *out;
    char *comments; /* of the entries being read, not yet written: they go if all of these do */
    size_t comments_length;
    bool any_entry, any_kept;
    bool blank; /* the last line written was empty, or nothing was */
};

static const struct gn_results_case *find(const struct gn_results *results, const char *name)
{
    for (size_t i = 0; i < results->count; i++)
        if (strcmp(results->cases[i].name, name) == 0)
            return &results->cases[i];
    return NULL;
}

static const char *word(const struct gn_results_case *cs)
{
    return cs->status == GN_CASE_LEAK ? "Leak" : gn_case_status_deqp(cs->status);
}

static void put(struct update *update, const char *line, size_t length)
{
    bool blank = length == 0;
    if (blank && update->blank)
        return;
    fwrite(line, 1, length, update->out);
    fputc('\n', update->out);
    update->blank = blank;
}

static void put_comments(struct update *update)
{
    for (char *at = update->comments; at && *at;) {
        size_t length = strcspn(at, "\n");
        put(update, at, length);
        at += length + (at[length] == '\n');
    }
    free(update->comments);
    update->comments = NULL;
    update->comments_length = 0;
}

/* The entries that the comments belong to are over. */
static void end_group(struct update *update)
{
    if (update->any_kept || !update->any_entry)
        put_comments(update);
    free(update->comments);
    update->comments = NULL;
    update->comments_length = 0;
    update->any_entry = update->any_kept = false;
}

static bool hold_comment(struct update *update, const char *line, size_t length)
{
    char *grown = realloc(update->comments, update->comments_length + length + 2);
    if (!grown)
        return false;
    memcpy(grown + update->comments_length, line, length);
    update->comments = grown;
    update->comments_length += length + 1;
    grown[update->comments_length - 1] = '\n';
    grown[update->comments_length] = 0;
    return true;
}

/* What becomes of an entry: true to keep it, with the status it then has. */
static bool judge_entry(struct update *update, const char *name, const char *status, const char **out_status)
{
    const struct gn_results_case *cs = find(update->results, name);
    *out_status = status;
    if (!cs)
        return gn_catalogue_find(update->catalogue, update->catalogue_count, name) != NULL;
    if (cs->status == GN_CASE_PASS)
        return strcmp(status, "Pass") == 0;
    if (cs->outcome == GN_OUTCOME_AS_EXPECTED)
        return true;
    bool fits = strcmp(status, gn_case_status_deqp(cs->status)) == 0 || strcmp(status, word(cs)) == 0;
    if (!fits) {
        *out_status = word(cs);
        update->changes.changed++;
    }
    return true;
}

static void update_entry(struct update *update, const char *line, size_t length)
{
    char name[512];
    const char *comma = memchr(line, ',', length), *status;
    char found[32] = "";
    size_t name_length = comma ? (size_t)(comma - line) : 0;
    while (name_length && isspace((unsigned char)line[name_length - 1]))
        name_length--;
    size_t lead = strspn(line, " \t");
    if (!comma || name_length <= lead || name_length - lead >= sizeof name) {
        put(update, line, length);
        return;
    }
    memcpy(name, line + lead, name_length - lead);
    name[name_length - lead] = 0;
    const char *behind = comma + 1 + strspn(comma + 1, " \t");
    size_t status_length = 0;
    while (behind + status_length < line + length && isalpha((unsigned char)behind[status_length]))
        status_length++;
    if (status_length < sizeof found)
        memcpy(found, behind, status_length);
    update->any_entry = true;
    if (!judge_entry(update, name, found, &status)) {
        update->changes.removed++;
        return;
    }
    put_comments(update);
    update->any_kept = true;
    if (status == found) {
        put(update, line, length);
    } else {
        fprintf(update->out, "%s,%s%.*s\n", name, status, (int)(line + length - behind - (ptrdiff_t)status_length),
                behind + status_length);
        update->blank = false;
    }
}

static bool update_line(struct update *update, const char *line, size_t length)
{
    while (length && isspace((unsigned char)line[length - 1]))
        length--;
    size_t lead = 0;
    while (lead < length && isspace((unsigned char)line[lead]))
        lead++;
    if (length && line[lead] == '#') {
        if (update->any_entry)
            end_group(update);
        if (!hold_comment(update, line, length))
            return false;
        /* What stands above the line of the device is said of the file, not of the entries below. */
        if (gn_expectations_is_device(line + lead + 1))
            put_comments(update);
        return true;
    }
    if (length) {
        update_entry(update, line, length);
        return true;
    }
    end_group(update);
    put(update, "", 0);
    return true;
}

/* An entry that has expired is one too: whether it holds any longer is for a person to say. */
static bool has_entry(const struct gn_expectations *expectations, const char *name)
{
    for (size_t i = 0; i < expectations->count; i++)
        if (expectations->list[i].kind == GN_EXPECT_STATUS && strcmp(expectations->list[i].name, name) == 0)
            return true;
    return false;
}

static void add_failures(struct update *update, const struct gn_expectations *expectations)
{
    for (size_t i = 0; i < update->results->count; i++) {
        const struct gn_results_case *cs = &update->results->cases[i];
        if (cs->outcome != GN_OUTCOME_UNEXPECTED || has_entry(expectations, cs->name))
            continue;
        put(update, "", 0);
        char reason[REASON_MOST + 1];
        snprintf(reason, sizeof reason, "%.*s", (int)strcspn(cs->message, "\n"), cs->message);
        for (char *at = reason; *at; at++)
            if (*at == '#')
                *at = ' ';
        gn_text_clean(reason);
        fprintf(update->out, "# New, not looked into: %s\n%s,%s\n", reason, cs->name, word(cs));
        update->blank = false;
        update->changes.added++;
    }
}

bool gn_expectations_update(const char *path, const struct gn_expectations *expectations,
                            const struct gn_results *results, const struct gn_selected *catalogue,
                            size_t catalogue_count, struct gn_expectations_changes *out_changes, char *out_error,
                            size_t error_size)
{
    struct update update = {
        .results = results, .catalogue = catalogue, .catalogue_count = catalogue_count, .blank = true};
    struct gn_arena arena = {0};
    char *data = NULL, *text = NULL, *target = NULL;
    size_t length = 0, text_length = 0;
    bool ok = false, exists = access(path, F_OK) == 0;
    if (exists && !gn_file_read(path, 64 << 20, &data, &length, out_error, error_size))
        goto done;
    snprintf(out_error, error_size, "out of memory for %s", path);
    update.out = open_memstream(&text, &text_length);
    if (!update.out)
        goto done;
    if (!exists)
        fprintf(update.out, "# Expected failures on %s, %s.\n", results->run.device.name,
                results->run.device.driver_info);
    if (!expectations->device) {
        fprintf(update.out, "# device: %s\n\n", gn_expectations_device(&results->run.device, &arena));
        update.blank = true;
    }
    for (char *at = data ? gn_expectations_text(data) : NULL; at && *at;) {
        size_t line = strcspn(at, "\n");
        if (!update_line(&update, at, line))
            goto done;
        at += line + (at[line] == '\n');
    }
    end_group(&update);
    add_failures(&update, expectations);
    if (fclose(update.out) != 0) {
        update.out = NULL;
        goto done;
    }
    update.out = NULL;
    /* What went left an empty line behind. */
    while (text_length > 1 && text[text_length - 1] == '\n' && text[text_length - 2] == '\n')
        text_length--;
    /* Where the path is a link, what it leads to is written. */
    target = realpath(path, NULL);
    ok = gn_file_write(target ? target : path, text, text_length, out_error, error_size);
    *out_changes = update.changes;
done:
    if (update.out)
        fclose(update.out);
    free(update.comments);
    free(target);
    free(text);
    free(data);
    gn_arena_finish(&arena);
    return ok;
}
