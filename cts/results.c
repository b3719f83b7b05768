/* SPDX-License-Identifier: Apache-2.0 */
/* The model of a run: adding cases, totals, the verdict in words, the exit status. */
#include "cts/results.h"

#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

const char *gn_version(void)
{
    return GNOMON_VERSION;
}

void gn_results_init(struct gn_results *results)
{
    memset(results, 0, sizeof *results);
    results->stopped = "";
    results->run.version = GNOMON_VERSION;
    results->run.started = results->run.driver = results->run.backend = "";
    results->run.command = results->run.options = results->run.environment = "";
    results->run.shard = results->run.shard_count = 1;
}

void gn_results_finish(struct gn_results *results)
{
    free(results->cases);
    free(results->notes);
    free(results->stale);
    gn_arena_finish(&results->arena);
    memset(results, 0, sizeof *results);
}

const char *gn_results_run_difference(const struct gn_results_run *a, const struct gn_results_run *b)
{
    if (strcmp(a->version, b->version) != 0)
        return "version of gnomon";
    if (a->suite != b->suite)
        return "suite of cases";
    if (a->selection != b->selection)
        return "choice of cases";
    if (strcmp(a->backend, b->backend) != 0)
        return "backend";
    if (a->seed != b->seed)
        return "seed";
    if (a->scale < b->scale || a->scale > b->scale)
        return "scale";
    if (strcmp(a->device.name, b->device.name) != 0 || a->device.driver_version != b->device.driver_version ||
        strcmp(a->device.driver_info, b->device.driver_info) != 0 ||
        memcmp(a->device.driver_uuid, b->device.driver_uuid, VK_UUID_SIZE) != 0)
        return "device or driver version";
    return NULL;
}

static void *grow(void *array, size_t count, size_t size)
{
    void *grown = realloc(array, count * size);
    if (!grown) {
        fprintf(stderr, "gnomon: out of memory for %zu results\n", count);
        exit(3);
    }
    return grown;
}

static const char *keep(struct gn_results *results, const char *text)
{
    return text && *text ? gn_arena_printf(&results->arena, "%s", text) : "";
}

struct gn_results_case *gn_results_add(struct gn_results *results, const struct gn_results_case *source)
{
    if (results->count == results->capacity) {
        results->capacity = results->capacity ? results->capacity * 2 : 256;
        results->cases = grow(results->cases, results->capacity, sizeof *results->cases);
    }
    struct gn_results_case *cs = &results->cases[results->count++];
    *cs = *source;
    cs->name = keep(results, source->name);
    cs->family = keep(results, source->family);
    cs->spec = keep(results, source->spec);
    cs->message = keep(results, source->message);
    cs->output = keep(results, source->output);
    cs->picture = keep(results, source->picture);
    cs->replay = keep(results, source->replay);
    for (int i = 0; i < GN_CASE_RENDERED; i++)
        cs->rendered[i] = keep(results, source->rendered[i]);
    cs->expected = keep(results, source->expected);
    cs->expected_reason = keep(results, source->expected_reason);
    cs->expected_place = keep(results, source->expected_place);
    cs->curve.parameter = keep(results, source->curve.parameter);
    cs->curve.unit = keep(results, source->curve.unit);
    cs->curve.why = keep(results, source->curve.why);
    if (source->curve.count) {
        cs->curve.points = GN_NEW(&results->arena, struct gn_case_point, source->curve.count);
        memcpy(cs->curve.points, source->curve.points, source->curve.count * sizeof *cs->curve.points);
    }
    cs->image = NULL;
    return cs;
}

void gn_results_note(struct gn_results *results, const char *format, ...)
{
    char text[2048];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    gn_text_clean(text);
    results->notes = grow(results->notes, results->note_count + 1, sizeof *results->notes);
    results->notes[results->note_count++] = keep(results, text);
}

void gn_results_add_stale(struct gn_results *results, const char *text)
{
    results->stale = grow(results->stale, results->stale_count + 1, sizeof *results->stale);
    results->stale[results->stale_count++] = keep(results, text);
}

struct gn_results_totals gn_results_totals(const struct gn_results *results)
{
    struct gn_results_totals totals = {0};
    for (size_t i = 0; i < results->count; i++) {
        const struct gn_results_case *cs = &results->cases[i];
        totals.by_status[cs->status]++;
        totals.counting += cs->outcome == GN_OUTCOME_UNEXPECTED || cs->outcome == GN_OUTCOME_UNEXPECTED_PASS;
        totals.unexpected_passes += cs->outcome == GN_OUTCOME_UNEXPECTED_PASS;
        totals.expected_failures += cs->outcome == GN_OUTCOME_EXPECTED_FAILURE;
        totals.rays += cs->rays;
        totals.ideal_hits += cs->ideal_hits;
        totals.case_seconds += cs->seconds;
        for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++)
            totals.class_counts[c] += cs->class_counts[c];
        if (cs->hit_error_max > totals.hit_error_max)
            totals.hit_error_max = cs->hit_error_max;
    }
    return totals;
}

bool gn_case_status_is_failure(enum gn_case_status status)
{
    return status != GN_CASE_PASS && status != GN_CASE_SKIP;
}

enum gn_case_status gn_case_status_of_name(const char *name)
{
    for (int s = 0; s < GN_CASE_STATUS_COUNT; s++)
        if (strcmp(name, gn_case_status_name((enum gn_case_status)s)) == 0)
            return (enum gn_case_status)s;
    return GN_CASE_STATUS_COUNT;
}

const char *gn_case_status_deqp(enum gn_case_status status)
{
    switch (status) {
    case GN_CASE_PASS:
        return "Pass";
    case GN_CASE_SKIP:
        return "Skip";
    case GN_CASE_CRASH:
        return "Crash";
    case GN_CASE_TIMEOUT:
        return "Timeout";
    case GN_CASE_FAIL:
    case GN_CASE_LEAK:
    case GN_CASE_ERROR:
    case GN_CASE_STATUS_COUNT:
        break;
    }
    return "Fail";
}

const char *gn_results_class_key(enum gn_ref_verdict_class cls)
{
    static const char *const keys[GN_REF_VERDICT_CLASS_COUNT] = {
        [GN_REF_EXACT] = "exact", [GN_REF_ADMISSIBLE] = "admissible", [GN_REF_GAP] = "gap",
        [GN_REF_LEAK] = "leak",   [GN_REF_DOUBLE_HIT] = "double_hit", [GN_REF_WRONG] = "wrong"};
    return keys[cls];
}

/* Appends to a text of bounded size; what does not fit is cut off. */
static void append(char *out, size_t size, const char *format, ...) __attribute__((format(printf, 3, 4)));
static void append(char *out, size_t size, const char *format, ...)
{
    size_t used = strlen(out);
    va_list arguments;
    va_start(arguments, format);
    if (used < size)
        vsnprintf(out + used, size - used, format, arguments);
    va_end(arguments);
}

void gn_results_verdict(const struct gn_results *results, char *out, size_t size)
{
    static const struct {
        enum gn_case_status status;
        const char *words;
    } bad[] = {{GN_CASE_FAIL, "failed"},
               {GN_CASE_LEAK, "leaked"},
               {GN_CASE_CRASH, "crashed"},
               {GN_CASE_TIMEOUT, "timed out"},
               {GN_CASE_ERROR, "could not be judged"},
               {GN_CASE_SKIP, "skipped against expectation"}};
    struct gn_results_totals totals = gn_results_totals(results);
    uint64_t counting[GN_CASE_STATUS_COUNT] = {0};
    for (size_t i = 0; i < results->count; i++)
        if (results->cases[i].outcome == GN_OUTCOME_UNEXPECTED)
            counting[results->cases[i].status]++;

    out[0] = 0;
    if (results->stopped[0])
        append(out, size, "Stopped after %zu of %llu cases (%s): ", results->count,
               (unsigned long long)results->run.selected, results->stopped);
    bool any = false;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        unsigned long long n = counting[bad[i].status];
        if (!n)
            continue;
        if (any)
            append(out, size, ", %llu %s", n, bad[i].words);
        else
            append(out, size, "%llu of %zu %s %s", n, results->count, results->count == 1 ? "case" : "cases",
                   bad[i].words);
        any = true;
    }
    if (totals.unexpected_passes) {
        append(out, size, "%s%llu %s passed against expectation", any ? ", " : "",
               (unsigned long long)totals.unexpected_passes, totals.unexpected_passes == 1 ? "case" : "cases");
        any = true;
    }
    if (results->stale_count) {
        append(out, size, "%s%zu expectation%s stale", any ? ", " : "", results->stale_count,
               results->stale_count == 1 ? " is" : "s are");
        any = true;
    }
    unsigned long long passed = totals.by_status[GN_CASE_PASS] - totals.unexpected_passes;
    unsigned long long skipped = totals.by_status[GN_CASE_SKIP] - counting[GN_CASE_SKIP];
    unsigned long long expected = totals.expected_failures;
    if (!results->count)
        append(out, size, "%sno case ran", any ? "; " : "");
    else if (any)
        append(out, size, "; %llu passed", passed);
    else if (passed == results->count)
        append(out, size, results->count == 1 ? "the case passed" : "all %llu cases passed", passed);
    else if (passed || expected)
        append(out, size, "nothing unexpected in %zu cases: %llu passed", results->count, passed);
    if (expected)
        append(out, size, ", %llu failed as expected", expected);
    if (skipped && (any || passed || expected))
        append(out, size, ", %llu %s skipped", skipped, skipped == 1 ? "was" : "were");
    else if (skipped)
        append(out, size, "nothing was judged: %s",
               skipped == 1 ? "the only case was skipped" : "all cases were skipped");
    append(out, size, ".");
    if (out[0] >= 'a' && out[0] <= 'z')
        out[0] = (char)(out[0] - 'a' + 'A');
}

int gn_results_exit_status(const struct gn_results *results)
{
    struct gn_results_totals totals = gn_results_totals(results);
    if (results->stopped[0] && !results->stopped_at_limit)
        return 3;
    if (totals.counting || results->stale_count)
        return 1;
    return totals.by_status[GN_CASE_SKIP] == results->count ? 4 : 0;
}

static int compare_names(const void *a, const void *b)
{
    return strcmp(((const struct gn_results_case *)a)->name, ((const struct gn_results_case *)b)->name);
}

void gn_results_sort(struct gn_results *results)
{
    if (results->count)
        qsort(results->cases, results->count, sizeof *results->cases, compare_names);
}

/* The length of the valid UTF-8 sequence at `s`, 0 when there is none. */
static size_t utf8_length(const unsigned char *s)
{
    static const struct {
        unsigned char mask, lead;
        uint32_t least;
    } kinds[] = {{0x80, 0x00, 0}, {0xE0, 0xC0, 0x80}, {0xF0, 0xE0, 0x800}, {0xF8, 0xF0, 0x10000}};
    for (size_t n = 0; n < 4; n++) {
        if ((s[0] & kinds[n].mask) != kinds[n].lead)
            continue;
        uint32_t code = s[0] & (unsigned char)~kinds[n].mask;
        for (size_t i = 1; i <= n; i++) {
            if ((s[i] & 0xC0) != 0x80)
                return 0;
            code = code << 6 | (s[i] & 0x3Fu);
        }
        bool bad = code < kinds[n].least || code > 0x10FFFF || (code >= 0xD800 && code <= 0xDFFF) ||
                   (code >= 0x80 && code < 0xA0) || code == 0xFFFE || code == 0xFFFF;
        return bad ? 0 : n + 1;
    }
    return 0;
}

void gn_text_clean(char *text)
{
    unsigned char *s = (unsigned char *)text;
    while (*s) {
        size_t n = utf8_length(s);
        if (n == 0 || (*s < 0x20 && *s != '\n' && *s != '\t') || *s == 0x7F) {
            *s++ = '?';
            continue;
        }
        s += n;
    }
}
