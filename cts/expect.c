/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Expectation files: deqp-runner's formats, with reason, bug and expiry in comments, which it does not read. It has
 * no word for a leak and calls it Fail, so Fail expects either; Leak is our own word, and expects a leak only.
 */
#include "cts/expect.h"

#include <ctype.h>
#include <regex.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <time.h>

static const char *const words[] = {"Pass", "Fail", "Leak", "Skip", "Crash", "Timeout"};

/* What comments say of entries. Never NULL. */
struct said {
    const char *reason, *bug, *expires;
};

/* What a file's reading is at. */
struct reader {
    struct gn_expectations *expectations;
    struct gn_arena *arena;
    const char *path;
    enum gn_expectation_kind kind;
    size_t number; /* of the line */
    struct said above; /* in comment lines; it holds for every entry until the next comment or empty line */
    bool used;
    char *error;
    size_t error_size;
};

static char *trim(char *text)
{
    while (isspace((unsigned char)*text))
        text++;
    size_t length = strlen(text);
    while (length && isspace((unsigned char)text[length - 1]))
        text[--length] = 0;
    return text;
}

static bool fail(struct reader *reader, const char *format, ...) __attribute__((format(printf, 2, 3)));
static bool fail(struct reader *reader, const char *format, ...)
{
    va_list arguments;
    int used = snprintf(reader->error, reader->error_size, "%s:%zu: ", reader->path, reader->number);
    va_start(arguments, format);
    if (used > 0 && (size_t)used < reader->error_size)
        vsnprintf(reader->error + used, reader->error_size - (size_t)used, format, arguments);
    va_end(arguments);
    return false;
}

static bool is_date(const char *text)
{
    static const char shape[] = "0000-00-00";
    if (strlen(text) != sizeof shape - 1)
        return false;
    for (size_t i = 0; shape[i]; i++)
        if (shape[i] == '0' ? !isdigit((unsigned char)text[i]) : text[i] != shape[i])
            return false;
    static const int days[] = {31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31};
    int year = atoi(text), month = atoi(text + 5), day = atoi(text + 8);
    bool leap = month == 2 && year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    return month >= 1 && month <= 12 && day >= 1 && day <= days[month - 1] + leap;
}

/* The text behind "KEY:", in capitals or not, or NULL. */
static const char *value_of(const char *comment, const char *key)
{
    comment += strspn(comment, " \t");
    if (strncasecmp(comment, key, strlen(key)) != 0)
        return NULL;
    comment += strlen(key);
    comment += strspn(comment, " \t");
    return *comment == ':' ? comment + 1 + strspn(comment + 1, " \t") : NULL;
}

bool gn_expectations_is_device(const char *comment)
{
    return value_of(comment, "device") != NULL;
}

static bool read_device(struct reader *reader, const char *value)
{
    struct gn_expectations *expectations = reader->expectations;
    if (expectations->device && strcmp(expectations->device, value) != 0)
        return fail(reader, "this file is of the device '%s', but %s is of '%s'", value, expectations->device_place,
                    expectations->device);
    expectations->device = gn_arena_printf(reader->arena, "%s", value);
    expectations->device_place = gn_arena_printf(reader->arena, "%s:%zu", reader->path, reader->number);
    return true;
}

/* One comment, which adds to what is said of the entries below it or, where there is an entry before it, of that one. */
static bool read_comment(struct reader *reader, const char *text, bool behind, struct said *said)
{
    const char *value;
    if ((value = value_of(text, "device"))) {
        if (behind)
            return fail(reader, "expected `device:` in a line of its own, since it holds for the whole file");
        said->reason = "";
        return read_device(reader, value);
    }
    if ((value = value_of(text, "bug"))) {
        said->bug = gn_arena_printf(reader->arena, "%s", value);
    } else if ((value = value_of(text, "expires"))) {
        if (!is_date(value))
            return fail(reader, "expected a date such as 2027-03-31 behind `expires:`, found '%.100s'", value);
        said->expires = gn_arena_printf(reader->arena, "%s", value);
    } else if (strncasecmp(text, "expires", 7) == 0 && is_date(text + 7 + strspn(text + 7, " \t"))) {
        return fail(reader, "expected `expires:` before a date, found '%.100s'", text);
    } else if (*text) {
        said->reason = *said->reason ? gn_arena_printf(reader->arena, "%s %s", said->reason, text)
                                     : gn_arena_printf(reader->arena, "%s", text);
    }
    return true;
}

static const char *status_word(const char *text)
{
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++)
        if (strcmp(text, words[i]) == 0)
            return words[i];
    return NULL;
}

static bool split_status(struct reader *reader, char *text, const char **out_status)
{
    char *comma = strrchr(text, ',');
    if (!comma)
        return fail(reader, "expected `name,Status`, found '%.200s'", text);
    *comma = 0;
    const char *name = trim(text), *status = trim(comma + 1), *word = status_word(status);
    if (!word || !*name)
        return fail(reader,
                    "expected a name and one of Pass, Fail, Leak, Skip, Crash, Timeout, found '%.200s' and '%.100s'",
                    name, status);
    *out_status = word;
    return true;
}

/* A dot alone is what names are made of: a name is taken as it stands unless it has more than that. */
static bool is_regex(const char *name)
{
    return strpbrk(name, "*+?[](){}|^$\\") != NULL;
}

/* As deqp-runner, which has none either: they can take longer than anyone waits. */
static bool has_back_reference(const char *name)
{
    for (; *name; name++)
        if (*name == '\\' && *++name >= '1' && *name <= '9')
            return true;
        else if (!*name)
            break;
    return false;
}

static bool compile(struct reader *reader, const char *name, void **out_regex)
{
    char message[200];
    *out_regex = NULL;
    if (reader->kind == GN_EXPECT_STATUS || !is_regex(name))
        return true;
    if (has_back_reference(name))
        return fail(reader, "'%.200s' is no regular expression that is taken here: it has a back-reference", name);
    regex_t *regex = calloc(1, sizeof *regex);
    if (!regex)
        return fail(reader, "out of memory");
    int code = regcomp(regex, name, REG_EXTENDED | REG_NOSUB);
    if (code != 0) {
        regerror(code, regex, message, sizeof message);
        free(regex);
        return fail(reader, "'%.200s' is no regular expression: %s", name, message);
    }
    *out_regex = regex;
    return true;
}

static bool read_entry(struct reader *reader, char *text, const struct said *said)
{
    struct gn_expectations *expectations = reader->expectations;
    const char *status = "";
    void *regex;
    if (reader->kind == GN_EXPECT_STATUS) {
        if (!split_status(reader, text, &status))
            return false;
    } else if (strchr(text, ',') && (!is_regex(text) || status_word(trim(strrchr(text, ',') + 1)))) {
        return fail(reader, "expected a name alone in a file of %s, found '%.200s'",
                    reader->kind == GN_EXPECT_FLAKE ? "flakes" : "skips", text);
    }
    const char *name = trim(text);
    if (!compile(reader, name, &regex))
        return false;
    struct gn_expectation *grown = realloc(expectations->list, (expectations->count + 1) * sizeof *expectations->list);
    if (!grown) {
        if (regex)
            regfree(regex);
        free(regex);
        return fail(reader, "out of memory");
    }
    expectations->list = grown;
    grown[expectations->count++] = (struct gn_expectation){
        .kind = reader->kind,
        .name = gn_arena_printf(reader->arena, "%s", name),
        .status = status,
        .reason = said->reason,
        .bug = said->bug,
        .expires = said->expires,
        .place = gn_arena_printf(reader->arena, "%s:%zu", reader->path, reader->number),
        .expired = *said->expires && strcmp(expectations->today, said->expires) > 0,
        .regex = regex,
    };
    reader->used = true;
    return true;
}

/* One line without its newline. */
static bool read_line(struct reader *reader, char *line)
{
    static const struct said nothing = {"", "", ""};
    char *comment = strchr(line, '#');
    if (comment) {
        *comment = 0;
        comment = trim(comment + 1);
    }
    char *text = trim(line);
    if (*text) {
        struct said said = reader->above;
        said.reason = "";
        if (comment && !read_comment(reader, comment, true, &said))
            return false;
        if (!*said.reason)
            said.reason = reader->above.reason;
        return read_entry(reader, text, &said);
    }
    if (!comment || reader->used) {
        reader->above = nothing;
        reader->used = false;
    }
    return !comment || read_comment(reader, comment, false, &reader->above);
}

/* By kind and name; of equal ones in the order in which they were read. */
static int compare_entries(const void *a, const void *b)
{
    const struct gn_expectation *x = *(const struct gn_expectation *const *)a, *y = *(const struct gn_expectation *const *)b;
    int order = strcmp(x->name, y->name);
    return x->kind != y->kind ? (x->kind > y->kind) - (x->kind < y->kind) : order ? order : (x > y) - (x < y);
}

/* Whether no entry stands twice in one file, those from `first` on, and none says otherwise than one of an earlier file. */
static bool is_consistent(const struct gn_expectations *expectations, size_t first, char *out_error, size_t error_size)
{
    const struct gn_expectation **sorted = calloc(expectations->count + 1, sizeof(struct gn_expectation *));
    bool ok = sorted != NULL;
    if (!sorted)
        snprintf(out_error, error_size, "out of memory for %zu expectations", expectations->count);
    for (size_t i = 0; ok && i < expectations->count; i++)
        sorted[i] = &expectations->list[i];
    if (ok)
        qsort(sorted, expectations->count, sizeof(struct gn_expectation *), compare_entries);
    for (size_t i = 1; ok && i < expectations->count; i++) {
        const struct gn_expectation *a = sorted[i - 1], *b = sorted[i];
        if (a->kind != b->kind || strcmp(a->name, b->name) != 0)
            continue;
        ok = a < expectations->list + first && strcmp(a->status, b->status) == 0;
        if (!ok)
            snprintf(out_error, error_size, "%s: '%.200s' stands at %s already%s%s", b->place, b->name, a->place,
                     *a->status ? ", as " : "", a->status);
    }
    free(sorted);
    return ok;
}

char *gn_expectations_text(char *data)
{
    return strncmp(data, "\xEF\xBB\xBF", 3) == 0 ? data + 3 : data;
}

static bool ends_with(const char *text, const char *end)
{
    size_t length = strlen(text), end_length = strlen(end);
    return length >= end_length && strcmp(text + length - end_length, end) == 0;
}

bool gn_expectations_read(struct gn_expectations *expectations, const char *path, struct gn_arena *arena,
                          char *out_error, size_t error_size)
{
    char *data = NULL;
    size_t length = 0, first = expectations->count;
    if (!gn_file_read(path, 64 << 20, &data, &length, out_error, error_size))
        return false;
    if (!expectations->today[0]) {
        time_t now = time(NULL);
        struct tm parts;
        gmtime_r(&now, &parts);
        strftime(expectations->today, sizeof expectations->today, "%Y-%m-%d", &parts);
    }
    struct reader reader = {.expectations = expectations,
                            .arena = arena,
                            .path = path,
                            .kind = ends_with(path, "-flakes.txt")  ? GN_EXPECT_FLAKE
                                    : ends_with(path, "-skips.txt") ? GN_EXPECT_SKIP
                                                                    : GN_EXPECT_STATUS,
                            .number = 1,
                            .above = {"", "", ""},
                            .error = out_error,
                            .error_size = error_size};
    bool ok = true;
    if (memchr(data, 0, length)) {
        snprintf(out_error, error_size, "%s: expected text, found a zero byte", path);
        ok = false;
    }
    for (char *at = data; (at = strstr(at, "\r\n"));)
        *at = ' ';
    gn_text_clean(data);
    for (char *at = gn_expectations_text(data); ok && *at; reader.number++) {
        char *end = strchr(at, '\n');
        if (end)
            *end = 0;
        char *next = end ? end + 1 : at + strlen(at);
        ok = read_line(&reader, at);
        at = next;
    }
    free(data);
    return ok && is_consistent(expectations, first, out_error, error_size);
}

void gn_expectations_finish(struct gn_expectations *expectations)
{
    for (size_t i = 0; i < expectations->count; i++) {
        if (expectations->list[i].regex)
            regfree(expectations->list[i].regex);
        free(expectations->list[i].regex);
    }
    free(expectations->list);
    *expectations = (struct gn_expectations){0};
}

static bool names(const struct gn_expectation *entry, const char *name)
{
    return entry->regex ? regexec(entry->regex, name, 0, NULL, 0) == 0 : strcmp(entry->name, name) == 0;
}

const struct gn_expectation *gn_expectations_find(const struct gn_expectations *expectations,
                                                  enum gn_expectation_kind kind, const char *name)
{
    for (size_t i = expectations->count; i-- > 0;) {
        const struct gn_expectation *entry = &expectations->list[i];
        if (entry->kind == kind && !entry->expired && names(entry, name))
            return entry;
    }
    return NULL;
}

void gn_expectations_apply(const struct gn_expectations *expectations, struct gn_results_case *cs)
{
    const struct gn_expectation *entry = gn_expectations_find(expectations, GN_EXPECT_STATUS, cs->name);
    const struct gn_expectation *flake = gn_expectations_find(expectations, GN_EXPECT_FLAKE, cs->name);
    bool failed = gn_case_status_is_failure(cs->status);
    bool as_said = !entry || strcmp(entry->status, gn_case_status_deqp(cs->status)) == 0;
    cs->outcome = failed ? GN_OUTCOME_UNEXPECTED : GN_OUTCOME_AS_EXPECTED;
    if (failed && entry &&
        (strcmp(entry->status, gn_case_status_deqp(cs->status)) == 0 ||
         (cs->status == GN_CASE_LEAK && strcmp(entry->status, "Leak") == 0))) {
        cs->outcome = GN_OUTCOME_EXPECTED_FAILURE;
    } else if (flake) {
        if (failed)
            cs->outcome = GN_OUTCOME_EXPECTED_FAILURE;
        entry = flake;
    } else if (cs->status == GN_CASE_PASS && !as_said) {
        cs->outcome = GN_OUTCOME_UNEXPECTED_PASS;
    } else if (cs->status == GN_CASE_SKIP && !as_said &&
               !gn_expectations_find(expectations, GN_EXPECT_SKIP, cs->name)) {
        cs->outcome = GN_OUTCOME_UNEXPECTED;
    }
    cs->expected = !entry ? "" : entry == flake ? "Flake" : entry->status;
    cs->expected_reason = entry ? entry->reason : "";
    cs->expected_place = entry ? entry->place : "";
}

void gn_expectations_check(const struct gn_expectations *expectations, const struct gn_selected *catalogue,
                           size_t count, struct gn_results *results)
{
    for (size_t i = 0; i < expectations->count; i++) {
        const struct gn_expectation *entry = &expectations->list[i];
        bool found = false;
        for (size_t c = 0; c < count && !found; c++)
            found = names(entry, catalogue[c].name);
        if (!found)
            gn_results_add_stale(results, gn_arena_printf(&results->arena, "%s: no case is named %s", entry->place,
                                                          entry->name));
        else if (entry->expired)
            gn_results_add_stale(results, gn_arena_printf(&results->arena, "%s: the entry of %s expired after %s",
                                                          entry->place, entry->name, entry->expires));
    }
}

const char *gn_expectations_device(const struct gn_device_info *info, struct gn_arena *arena)
{
    return gn_arena_printf(arena, "0x%04x:0x%04x %s", info->vendor_id, info->device_id, info->driver_name);
}

bool gn_expectations_fit(const struct gn_expectations *expectations, const struct gn_device_info *info, char *out_error,
                         size_t error_size)
{
    struct gn_arena arena = {0};
    const char *device = gn_expectations_device(info, &arena);
    bool ok = !expectations->device || strcmp(expectations->device, device) == 0;
    if (!ok)
        snprintf(out_error, error_size, "%s: these expectations are of the device '%s', the driver has '%s'",
                 expectations->device_place, expectations->device, device);
    gn_arena_finish(&arena);
    return ok;
}
