/* SPDX-License-Identifier: Apache-2.0 */
/* gate.json for scripts, gate.md for a merge request, gate.sarif for code scanning. docs/gating.md has the formats. */
#include <stdlib.h>
#include <string.h>
#include <yyjson.h>

#include "cts/gate.h"
#include "cts/gate_html.h"

/* A comment on a merge request is read, not searched. */
#define MOST_ROWS 50

static void put_text(yyjson_mut_doc *doc, yyjson_mut_val *object, const char *key, const char *text)
{
    char *clean = strdup(text ? text : "");
    if (clean)
        gn_text_clean(clean);
    yyjson_mut_obj_add_strcpy(doc, object, key, clean ? clean : "");
    free(clean);
}

static void put_device(yyjson_mut_doc *doc, yyjson_mut_val *root, const char *key, const struct gn_results *results)
{
    struct gn_arena arena = {0};
    yyjson_mut_val *object = yyjson_mut_obj_add_obj(doc, root, key);
    const struct gn_device_info *device = &results->run.device;
    put_text(doc, object, "icd", results->run.driver);
    put_text(doc, object, "device", device->name);
    put_text(doc, object, "driver", device->driver_name);
    put_text(doc, object, "driver_info", device->driver_info);
    put_text(doc, object, "identity", gn_expectations_device(device, &arena));
    gn_arena_finish(&arena);
}

static void put_cases(yyjson_mut_doc *doc, yyjson_mut_val *root, const struct gn_gate *gate)
{
    yyjson_mut_val *list = yyjson_mut_obj_add_arr(doc, root, "cases");
    for (size_t i = 0; i < gate->case_count; i++) {
        const struct gn_gate_case *pair = &gate->cases[i];
        bool counts = gn_gate_case_counts(gate, i);
        if (!counts && pair->change == GN_GATE_SAME)
            continue;
        yyjson_mut_val *object = yyjson_mut_arr_add_obj(doc, list);
        put_text(doc, object, "name", pair->now->name);
        put_text(doc, object, "change", gn_gate_change_name(pair->change));
        yyjson_mut_obj_add_bool(doc, object, "counts", counts);
        put_text(doc, object, "new", gn_case_status_name(pair->now->status));
        put_text(doc, object, "old", pair->before ? gn_case_status_name(pair->before->status) : "");
        yyjson_mut_obj_add_uint(doc, object, "rays", pair->now->rays);
        if (pair->ray_by_ray) {
            yyjson_mut_obj_add_uint(doc, object, "decisions_changed", pair->decisions_changed);
            yyjson_mut_obj_add_uint(doc, object, "numbers_changed", pair->numbers_changed);
        }
        put_text(doc, object, "message", pair->now->message);
        put_text(doc, object, "replay", pair->now->replay);
    }
}

static void put_times(yyjson_mut_doc *doc, yyjson_mut_val *root, const struct gn_gate *gate)
{
    yyjson_mut_val *list = yyjson_mut_obj_add_arr(doc, root, "times");
    for (size_t i = 0; i < gate->time_count; i++) {
        const struct gn_gate_time *time = &gate->times[i];
        yyjson_mut_val *object = yyjson_mut_arr_add_obj(doc, list);
        put_text(doc, object, "name", time->item->name);
        put_text(doc, object, "about", time->item->about);
        put_text(doc, object, "unit", time->item->bytes ? "bytes" : "seconds");
        put_text(doc, object, "missing", time->missing);
        yyjson_mut_obj_add_bool(doc, object, "broken", time->broken);
        if (!time->rounds)
            continue;
        yyjson_mut_obj_add_uint(doc, object, "rounds", time->rounds);
        yyjson_mut_obj_add_real(doc, object, "old", time->before_median);
        yyjson_mut_obj_add_real(doc, object, "new", time->now_median);
        yyjson_mut_obj_add_real(doc, object, "ratio", time->ratio);
        yyjson_mut_obj_add_real(doc, object, "low", time->low);
        yyjson_mut_obj_add_real(doc, object, "high", time->high);
        yyjson_mut_obj_add_bool(doc, object, "exceeds", time->exceeds);
        yyjson_mut_obj_add_bool(doc, object, "undecided", time->undecided);
        yyjson_mut_obj_add_bool(doc, object, "unconfirmed", time->unconfirmed);
    }
}

static void put_drifts(yyjson_mut_doc *doc, yyjson_mut_val *root, const struct gn_gate *gate)
{
    yyjson_mut_val *list = yyjson_mut_obj_add_arr(doc, root, "drift");
    for (size_t i = 0; i < gate->drift_count; i++) {
        const struct gn_gate_drift *drift = &gate->drifts[i];
        yyjson_mut_val *object = yyjson_mut_arr_add_obj(doc, list);
        put_text(doc, object, "family", drift->family);
        yyjson_mut_obj_add_uint(doc, object, "hits", drift->now_count);
        const struct {
            const char *key;
            double value;
        } numbers[] = {{"old_median", drift->before_median}, {"new_median", drift->now_median},
                       {"old_p999", drift->before_p999},     {"new_p999", drift->now_p999},
                       {"old_max", drift->before_max},       {"new_max", drift->now_max},
                       {"distance", drift->distance},        {"p", drift->p}};
        for (size_t n = 0; n < sizeof numbers / sizeof numbers[0]; n++)
            yyjson_mut_obj_add_real(doc, object, numbers[n].key, numbers[n].value);
        yyjson_mut_obj_add_bool(doc, object, "drifted", drift->drifted);
    }
}

static void put_reruns(yyjson_mut_doc *doc, yyjson_mut_val *root, const struct gn_gate *gate)
{
    yyjson_mut_val *list = yyjson_mut_obj_add_arr(doc, root, "reruns");
    for (size_t i = 0; i < gate->rerun_count; i++) {
        const struct gn_gate_rerun *rerun = &gate->reruns[i];
        yyjson_mut_val *object = yyjson_mut_arr_add_obj(doc, list);
        put_text(doc, object, "name", rerun->name);
        yyjson_mut_obj_add_uint(doc, object, "alone", rerun->alone);
        yyjson_mut_obj_add_uint(doc, object, "alone_passed", rerun->alone_passed);
        yyjson_mut_obj_add_uint(doc, object, "context", rerun->context);
        yyjson_mut_obj_add_uint(doc, object, "context_passed", rerun->context_passed);
        put_text(doc, object, "fails_behind", rerun->after);
    }
}

static char *encode_json(const struct gn_gate *gate, size_t *out_length)
{
    char verdict[1024];
    yyjson_mut_doc *doc = yyjson_mut_doc_new(NULL);
    yyjson_mut_val *root = yyjson_mut_obj(doc);
    yyjson_mut_doc_set_root(doc, root);
    gn_gate_verdict(gate, verdict, sizeof verdict);
    put_text(doc, root, "verdict", verdict);
    yyjson_mut_obj_add_int(doc, root, "exit_status", gn_gate_exit_status(gate));
    yyjson_mut_obj_add_real(doc, root, "seconds", gate->seconds);
    yyjson_mut_obj_add_real(doc, root, "new_seconds", gate->now->seconds);
    if (gate->before)
        yyjson_mut_obj_add_real(doc, root, "old_seconds", gate->before->seconds);
    yyjson_mut_obj_add_real(doc, root, "rerun_seconds", gate->rerun_seconds);
    yyjson_mut_obj_add_real(doc, root, "time_budget", gate->budget);
    put_text(doc, root, "gnomon", gn_version());
    put_device(doc, root, "new", gate->now);
    if (gate->before)
        put_device(doc, root, "old", gate->before);
    put_cases(doc, root, gate);
    put_times(doc, root, gate);
    put_drifts(doc, root, gate);
    put_reruns(doc, root, gate);
    yyjson_mut_val *stale = yyjson_mut_obj_add_arr(doc, root, "stale_expectations");
    for (size_t i = 0; i < gate->now->stale_count; i++)
        yyjson_mut_arr_add_strcpy(doc, stale, gate->now->stale[i]);
    yyjson_mut_val *lost = yyjson_mut_obj_add_arr(doc, root, "not_run");
    for (size_t i = 0; i < gate->lost_count; i++)
        yyjson_mut_arr_add_strcpy(doc, lost, gate->lost[i]);
    char *text = yyjson_mut_write(doc, YYJSON_WRITE_PRETTY, out_length);
    yyjson_mut_doc_free(doc);
    return text;
}

/* SARIF 2.1.0: a result per case that counts, a result per measurement beyond the budget. */
static void put_result(yyjson_mut_doc *doc, yyjson_mut_val *results, const char *rule, const char *name,
                       const char *message)
{
    yyjson_mut_val *object = yyjson_mut_arr_add_obj(doc, results);
    put_text(doc, object, "ruleId", rule);
    put_text(doc, object, "level", "error");
    put_text(doc, yyjson_mut_obj_add_obj(doc, object, "message"), "text", message);
    yyjson_mut_val *location = yyjson_mut_arr_add_obj(doc, yyjson_mut_obj_add_arr(doc, object, "locations"));
    yyjson_mut_val *logical = yyjson_mut_arr_add_obj(doc, yyjson_mut_obj_add_arr(doc, location, "logicalLocations"));
    put_text(doc, logical, "fullyQualifiedName", name);
    put_text(doc, yyjson_mut_obj_add_obj(doc, object, "partialFingerprints"), "gnomonCase/v1", name);
}

static char *encode_sarif(const struct gn_gate *gate, size_t *out_length)
{
    static const char *const rules[][2] = {{"newly-wrong", "A case is worse than with the old driver"},
                                           {"unexpected", "A case came out otherwise than an expectation file says"},
                                           {"stale-expectation", "An expectation does not hold any more"},
                                           {"budget", "An operation is slower, or a structure larger, than the budget"},
                                           {"broken", "The driver does not come through an operation that is measured"}};
    yyjson_mut_doc *doc = yyjson_mut_doc_new(NULL);
    yyjson_mut_val *root = yyjson_mut_obj(doc);
    yyjson_mut_doc_set_root(doc, root);
    put_text(doc, root, "$schema", "https://json.schemastore.org/sarif-2.1.0.json");
    put_text(doc, root, "version", "2.1.0");
    yyjson_mut_val *run = yyjson_mut_arr_add_obj(doc, yyjson_mut_obj_add_arr(doc, root, "runs"));
    yyjson_mut_val *driver = yyjson_mut_obj_add_obj(doc, yyjson_mut_obj_add_obj(doc, run, "tool"), "driver");
    put_text(doc, driver, "name", "gnomon gate");
    put_text(doc, driver, "version", gn_version());
    yyjson_mut_val *list = yyjson_mut_obj_add_arr(doc, driver, "rules");
    for (size_t i = 0; i < sizeof rules / sizeof rules[0]; i++) {
        yyjson_mut_val *rule = yyjson_mut_arr_add_obj(doc, list);
        put_text(doc, rule, "id", rules[i][0]);
        put_text(doc, yyjson_mut_obj_add_obj(doc, rule, "shortDescription"), "text", rules[i][1]);
    }
    yyjson_mut_val *results = yyjson_mut_obj_add_arr(doc, run, "results");
    for (size_t i = 0; i < gate->case_count; i++) {
        const struct gn_gate_case *pair = &gate->cases[i];
        char message[1400];
        if (!gn_gate_case_counts(gate, i))
            continue;
        snprintf(message, sizeof message, "%s%s%s. %s", gn_case_status_name(pair->now->status),
                 pair->before ? ", was " : "", pair->before ? gn_case_status_name(pair->before->status) : "",
                 pair->now->message);
        put_result(doc, results, pair->change == GN_GATE_WRONG ? "newly-wrong" : "unexpected", pair->now->name, message);
    }
    for (size_t i = 0; i < gate->now->stale_count; i++)
        put_result(doc, results, "stale-expectation", "expectations", gate->now->stale[i]);
    for (size_t i = 0; i < gate->time_count; i++) {
        const struct gn_gate_time *time = &gate->times[i];
        char message[1400];
        if (time->broken) {
            snprintf(message, sizeof message, "%s: %s", time->item->about, time->missing);
            put_result(doc, results, "broken", time->item->name, message);
        }
        if (!time->exceeds)
            continue;
        snprintf(message, sizeof message, "%s: %.3g times the old driver's, the budget is %.3g", time->item->about,
                 time->ratio, gate->budget);
        put_result(doc, results, "budget", time->item->name, message);
    }
    char *text = yyjson_mut_write(doc, YYJSON_WRITE_PRETTY, out_length);
    yyjson_mut_doc_free(doc);
    return text;
}

/* Text in a table of Markdown. */
static void put_cell(FILE *file, const char *text)
{
    for (const char *at = text; *at && *at != '\n'; at++) {
        if (strchr("|`*_<>[]&\\", *at))
            fputc('\\', file);
        fputc(*at, file);
    }
}

/* As code, in which nothing is markup, and no name of a person either. */
static void put_driver(FILE *file, const char *which, const struct gn_results *results)
{
    char device[GN_GATE_DEVICE_SIZE];
    gn_gate_device(results, device);
    for (char *at = device; (at = strchr(at, '`')) != NULL;)
        *at = '\'';
    fprintf(file, "- %s: `%s`\n", which, device);
}

static void put_markdown(FILE *file, const struct gn_gate *gate)
{
    char verdict[1024];
    size_t rows = 0, total = 0;
    gn_gate_verdict(gate, verdict, sizeof verdict);
    fprintf(file, "### Gnomon: %s\n\n", verdict);
    put_driver(file, "New", gate->now);
    if (gate->before)
        put_driver(file, "Old", gate->before);
    for (size_t i = 0; i < gate->case_count; i++) {
        const struct gn_gate_case *pair = &gate->cases[i];
        if (!gn_gate_case_counts(gate, i) || total++ >= MOST_ROWS)
            continue;
        if (!rows++)
            fputs("\n| case | was | is | why |\n|---|---|---|---|\n", file);
        fprintf(file, "| `%s` | %s | %s | ", pair->now->name,
                pair->before ? gn_case_status_name(pair->before->status) : pair->now->expected,
                gn_case_status_name(pair->now->status));
        put_cell(file, pair->now->message);
        fputs(" |\n", file);
    }
    if (total > rows)
        fprintf(file, "\n%zu more in the report.\n", total - rows);
    for (size_t i = 0; i < gate->now->stale_count; i++)
        fprintf(file, "%s- stale: `%s`\n", i ? "" : "\n", gate->now->stale[i]);
    rows = 0;
    for (size_t i = 0; i < gate->time_count; i++) {
        const struct gn_gate_time *time = &gate->times[i];
        if (!time->exceeds)
            continue;
        if (!rows++)
            fprintf(file, "\n| slower or larger than %.3gx | ratio | 99 %% interval |\n|---|---|---|\n", gate->budget);
        fprintf(file, "| `%s`: %s | %.2f | %.2f to %.2f |\n", time->item->name, time->item->about, time->ratio, time->low,
                time->high);
    }
    rows = 0;
    for (size_t i = 0; i < gate->time_count; i++) {
        const struct gn_gate_time *time = &gate->times[i];
        if (!*time->missing)
            continue;
        fprintf(file, "%s- %s: `%s`: ", rows++ ? "" : "\n", time->broken ? "fails newly" : "not measured", time->item->name);
        put_cell(file, time->missing);
        fputc('\n', file);
    }
    rows = 0;
    for (size_t i = 0; i < gate->case_count; i++)
        if (gate->cases[i].change == GN_GATE_RIGHT && rows++ < MOST_ROWS)
            fprintf(file, "%s%s`%s`", rows == 1 ? "\nNewly right: " : "", rows == 1 ? "" : ", ", gate->cases[i].now->name);
    fputs(rows ? ".\n" : "", file);
}

static bool write_text(const char *out, const char *name, char *text, size_t length, char *out_error, size_t error_size)
{
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", out, name);
    if (text)
        return gn_file_write(path, text, length, out_error, error_size);
    snprintf(out_error, error_size, "out of memory for %s", path);
    return false;
}

/* What `put` writes, as a file. */
static bool write_stream(const struct gn_gate *gate, void (*put)(FILE *file, const struct gn_gate *gate), const char *out,
                         const char *name, char *out_error, size_t error_size)
{
    char *text = NULL;
    size_t length = 0;
    FILE *file = open_memstream(&text, &length);
    bool ok = file != NULL;
    if (file) {
        put(file, gate);
        ok = !ferror(file);
        ok = fclose(file) == 0 && ok;
    }
    ok = write_text(out, name, ok ? text : NULL, length, out_error, error_size);
    free(text);
    return ok;
}

bool gn_gate_write(const struct gn_gate *gate, const char *out, char *out_error, size_t error_size)
{
    size_t json_length = 0, sarif_length = 0;
    char *json = encode_json(gate, &json_length), *sarif = encode_sarif(gate, &sarif_length);
    bool ok = write_text(out, "gate.json", json, json_length, out_error, error_size);
    ok = write_text(out, "gate.sarif", sarif, sarif_length, out_error, error_size) && ok;
    ok = write_stream(gate, put_markdown, out, "gate.md", out_error, error_size) && ok;
    ok = write_stream(gate, gn_gate_html, out, "gate.html", out_error, error_size) && ok;
    free(json);
    free(sarif);
    return ok;
}
