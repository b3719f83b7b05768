/* SPDX-License-Identifier: Apache-2.0 */
/* junit.xml: a suite per family, as CI systems read it. Expected failures are skipped tests with their
 * reason. */
#include "cts/results.h"

#include <libxml/xmlwriter.h>
#include <string.h>

#define UTF8(text) ((const xmlChar *)(text))

static bool counts(const struct gn_results_case *cs)
{
    return cs->outcome == GN_OUTCOME_UNEXPECTED || cs->outcome == GN_OUTCOME_UNEXPECTED_PASS;
}

/* Crashes and the like are errors in JUnit's sense, wrong answers are failures. */
static bool is_error(const struct gn_results_case *cs)
{
    return cs->status == GN_CASE_CRASH || cs->status == GN_CASE_TIMEOUT || cs->status == GN_CASE_ERROR;
}

struct counts {
    size_t tests, failures, errors, skipped;
    double seconds;
};

static void count(struct counts *counted, const struct gn_results_case *cs)
{
    counted->tests++;
    counted->seconds += cs->seconds;
    if (counts(cs) && is_error(cs))
        counted->errors++;
    else if (counts(cs))
        counted->failures++;
    else if (cs->status == GN_CASE_SKIP || cs->outcome == GN_OUTCOME_EXPECTED_FAILURE)
        counted->skipped++;
}

static void attribute(xmlTextWriterPtr writer, const char *name, const char *value)
{
    xmlTextWriterWriteAttribute(writer, UTF8(name), UTF8(value));
}

static void put_counts(xmlTextWriterPtr writer, const struct counts *counted)
{
    xmlTextWriterWriteFormatAttribute(writer, UTF8("tests"), "%zu", counted->tests);
    xmlTextWriterWriteFormatAttribute(writer, UTF8("failures"), "%zu", counted->failures);
    xmlTextWriterWriteFormatAttribute(writer, UTF8("errors"), "%zu", counted->errors);
    xmlTextWriterWriteFormatAttribute(writer, UTF8("skipped"), "%zu", counted->skipped);
    xmlTextWriterWriteFormatAttribute(writer, UTF8("time"), "%.6f", counted->seconds);
}

static void put_property(xmlTextWriterPtr writer, const char *name, const char *value)
{
    xmlTextWriterStartElement(writer, UTF8("property"));
    attribute(writer, "name", name);
    attribute(writer, "value", value);
    xmlTextWriterEndElement(writer);
}

/* "query.flags.cull_back" is the test "cull_back" of the class "query.flags": the length of that. */
static size_t class_length(const struct gn_results_case *cs)
{
    size_t family = strlen(cs->family), backend = strcspn(cs->name, ".");
    bool bare = strncmp(cs->name, cs->family, family) == 0 && (cs->name[family] == '.' || !cs->name[family]);
    size_t length = bare || !cs->name[backend] ? family : backend + 1 + family;
    return length < strlen(cs->name) ? length : strlen(cs->name);
}

static bool same_class(const struct gn_results_case *a, const struct gn_results_case *b)
{
    size_t length = class_length(a);
    return length == class_length(b) && strncmp(a->name, b->name, length) == 0;
}

static void put_case(xmlTextWriterPtr writer, const struct gn_results_case *cs)
{
    size_t head = class_length(cs);
    bool split = strlen(cs->name) > head + 1 && cs->name[head] == '.';
    xmlTextWriterStartElement(writer, UTF8("testcase"));
    xmlTextWriterWriteFormatAttribute(writer, UTF8("classname"), "%.*s", split ? (int)head : 0, cs->name);
    attribute(writer, "name", split ? cs->name + head + 1 : cs->name);
    xmlTextWriterWriteFormatAttribute(writer, UTF8("time"), "%.6f", cs->seconds);
    if (counts(cs)) {
        bool pass = cs->outcome == GN_OUTCOME_UNEXPECTED_PASS;
        xmlTextWriterStartElement(writer, UTF8(is_error(cs) ? "error" : "failure"));
        attribute(writer, "type", pass ? "unexpected pass" : gn_case_status_name(cs->status));
        attribute(writer, "message", pass ? "passed against expectation" : cs->message);
        if (cs->spec[0])
            xmlTextWriterWriteFormatString(writer, "evidence for: %s\n", cs->spec);
        if (cs->replay[0])
            xmlTextWriterWriteFormatString(writer, "replay file: %s\n", cs->replay);
        xmlTextWriterEndElement(writer);
    } else if (cs->outcome == GN_OUTCOME_EXPECTED_FAILURE) {
        xmlTextWriterStartElement(writer, UTF8("skipped"));
        xmlTextWriterWriteFormatAttribute(writer, UTF8("message"), "expected %s: %s", cs->expected,
                                          cs->expected_reason[0] ? cs->expected_reason : "no reason given");
        xmlTextWriterWriteString(writer, UTF8(cs->message));
        xmlTextWriterEndElement(writer);
    } else if (cs->status == GN_CASE_SKIP) {
        xmlTextWriterStartElement(writer, UTF8("skipped"));
        attribute(writer, "message", cs->message);
        xmlTextWriterEndElement(writer);
    }
    if (cs->output[0] && cs->status != GN_CASE_PASS)
        xmlTextWriterWriteElement(writer, UTF8("system-out"), UTF8(cs->output));
    xmlTextWriterEndElement(writer);
}

/* The suite of a case's class. */
static void put_suite(xmlTextWriterPtr writer, const struct gn_results *results, const struct gn_results_case *one)
{
    struct counts counted = {0};
    for (size_t i = 0; i < results->count; i++)
        if (same_class(&results->cases[i], one))
            count(&counted, &results->cases[i]);
    xmlTextWriterStartElement(writer, UTF8("testsuite"));
    xmlTextWriterWriteFormatAttribute(writer, UTF8("name"), "%.*s", (int)class_length(one), one->name);
    put_counts(writer, &counted);
    attribute(writer, "timestamp", results->run.started);
    xmlTextWriterStartElement(writer, UTF8("properties"));
    put_property(writer, "device", results->run.device.name);
    put_property(writer, "driver", results->run.device.driver_name);
    put_property(writer, "driver_info", results->run.device.driver_info);
    char seed[32];
    snprintf(seed, sizeof seed, "%llu", (unsigned long long)results->run.seed);
    put_property(writer, "seed", seed);
    xmlTextWriterEndElement(writer);
    for (size_t i = 0; i < results->count; i++)
        if (same_class(&results->cases[i], one))
            put_case(writer, &results->cases[i]);
    xmlTextWriterEndElement(writer);
}

bool gn_results_junit_write(const struct gn_results *results, const char *path, char *out_error,
                            size_t error_size)
{
    bool ok = false;
    struct counts counted = {0};
    xmlBufferPtr buffer = xmlBufferCreate();
    xmlTextWriterPtr writer = buffer ? xmlNewTextWriterMemory(buffer, 0) : NULL;
    if (!writer) {
        snprintf(out_error, error_size, "out of memory for %s", path);
        goto done;
    }
    for (size_t i = 0; i < results->count; i++)
        count(&counted, &results->cases[i]);
    xmlTextWriterSetIndent(writer, 1);
    xmlTextWriterStartDocument(writer, NULL, "UTF-8", NULL);
    xmlTextWriterStartElement(writer, UTF8("testsuites"));
    attribute(writer, "name", "gnomon");
    put_counts(writer, &counted);
    for (size_t i = 0; i < results->count; i++) {
        bool first = true;
        for (size_t j = 0; j < i && first; j++)
            first = !same_class(&results->cases[j], &results->cases[i]);
        if (first)
            put_suite(writer, results, &results->cases[i]);
    }
    xmlTextWriterEndElement(writer);
    if (xmlTextWriterEndDocument(writer) < 0) {
        snprintf(out_error, error_size, "out of memory for %s", path);
        goto done;
    }
    xmlTextWriterFlush(writer);
    ok =
        gn_file_write(path, xmlBufferContent(buffer), (size_t)xmlBufferLength(buffer), out_error, error_size);
done:
    if (writer)
        xmlFreeTextWriter(writer);
    if (buffer)
        xmlBufferFree(buffer);
    return ok;
}
