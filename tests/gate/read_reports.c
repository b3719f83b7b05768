/* SPDX-License-Identifier: Apache-2.0 */
/* Reads what a gate has written the way its readers do: read_reports FOLDER. Every line printed is something a reader would stumble over. */
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <libxml/HTMLparser.h>
#include <libxml/tree.h>
#include <libxml/xpath.h>
#include <yyjson.h>

static int problems;

#define CHECK(holds, ...)                                                                                    \
    do {                                                                                                     \
        if (!(holds)) {                                                                                      \
            problems++;                                                                                      \
            printf(__VA_ARGS__);                                                                             \
            putchar('\n');                                                                                   \
        }                                                                                                    \
    } while (0)

static yyjson_val *get(yyjson_val *object, const char *key, bool (*is)(yyjson_val *), const char *file)
{
    yyjson_val *value = yyjson_obj_get(object, key);
    CHECK(is(value), "%s: expected \"%s\"", file, key);
    return value;
}

static bool is_text(yyjson_val *value)
{
    return yyjson_is_str(value) && yyjson_get_len(value) > 0;
}

static bool is_object(yyjson_val *value)
{
    return yyjson_is_obj(value);
}

static bool is_list(yyjson_val *value)
{
    return yyjson_is_arr(value);
}

static bool is_number(yyjson_val *value)
{
    return yyjson_is_num(value);
}

/* What SARIF 2.1.0 requires of a log, its runs, rules and results. */
static size_t read_sarif(const char *path)
{
    static const char *const levels[] = {"none", "note", "warning", "error"};
    yyjson_doc *doc = yyjson_read_file(path, 0, NULL, NULL);
    yyjson_val *root = yyjson_doc_get_root(doc), *run, *result, *rule;
    size_t r, run_count, i, count, k, rule_count, results = 0;
    CHECK(yyjson_equals_str(yyjson_obj_get(root, "version"), "2.1.0"), "%s: expected version 2.1.0", path);
    get(root, "$schema", is_text, path);
    yyjson_arr_foreach(get(root, "runs", is_list, path), r, run_count, run)
    {
        yyjson_val *driver = get(get(run, "tool", is_object, path), "driver", is_object, path);
        yyjson_val *rules = get(driver, "rules", is_list, path);
        get(driver, "name", is_text, path);
        yyjson_arr_foreach(rules, k, rule_count, rule)
            get(get(rule, "shortDescription", is_object, path), "text", is_text, path);
        yyjson_arr_foreach(get(run, "results", is_list, path), i, count, result)
        {
            bool known = false, level_known = false;
            const char *level = yyjson_get_str(yyjson_obj_get(result, "level"));
            yyjson_val *id = get(result, "ruleId", is_text, path);
            yyjson_arr_foreach(rules, k, rule_count, rule) known |= yyjson_equals(yyjson_obj_get(rule, "id"), id);
            for (k = 0; k < 4; k++)
                level_known |= level && strcmp(level, levels[k]) == 0;
            CHECK(known, "%s: result %zu is of a rule that the tool does not list", path, i);
            CHECK(level_known, "%s: result %zu has no level", path, i);
            get(get(result, "message", is_object, path), "text", is_text, path);
            results++;
        }
    }
    yyjson_doc_free(doc);
    return results;
}

/* How many cases count. */
static size_t read_json(const char *path)
{
    static const char *const lists[] = {"cases", "times", "drift", "reruns", "stale_expectations", "not_run"};
    yyjson_doc *doc = yyjson_read_file(path, 0, NULL, NULL);
    yyjson_val *root = yyjson_doc_get_root(doc), *value;
    size_t i, most, counting = 0;
    get(root, "verdict", is_text, path);
    get(root, "exit_status", is_number, path);
    get(root, "seconds", is_number, path);
    for (i = 0; i < sizeof lists / sizeof lists[0]; i++)
        get(root, lists[i], is_list, path);
    yyjson_arr_foreach(yyjson_obj_get(root, "cases"), i, most, value)
        counting += yyjson_get_bool(yyjson_obj_get(value, "counts"));
    counting += yyjson_arr_size(yyjson_obj_get(root, "stale_expectations"));
    yyjson_arr_foreach(yyjson_obj_get(root, "times"), i, most, value)
        counting += yyjson_get_bool(yyjson_obj_get(value, "exceeds")) || yyjson_get_bool(yyjson_obj_get(value, "broken"));
    yyjson_doc_free(doc);
    return counting;
}

static long number_of(xmlXPathContextPtr context, const char *expression)
{
    xmlXPathObjectPtr found = xmlXPathEvalExpression((const xmlChar *)expression, context);
    long number = found ? (long)xmlXPathCastToNumber(found) : -1;
    xmlXPathFreeObject(found);
    return number;
}

static void read_junit(const char *path)
{
    static const char *const pairs[][2] = {{"sum(//testsuite/@tests)", "count(//testcase)"},
                                           {"sum(//testsuite/@failures)", "count(//testcase/failure)"},
                                           {"sum(//testsuite/@errors)", "count(//testcase/error)"},
                                           {"sum(//testsuite/@skipped)", "count(//testcase/skipped)"},
                                           {"number(/testsuites/@tests)", "count(//testcase)"},
                                           {"count(//testcase[@name and @classname and @time])", "count(//testcase)"},
                                           {"count(//testcase/failure[@message])", "count(//testcase/failure)"}};
    xmlDocPtr doc = xmlReadFile(path, NULL, XML_PARSE_NONET);
    xmlXPathContextPtr context = doc ? xmlXPathNewContext(doc) : NULL;
    CHECK(context, "%s is not XML", path);
    for (size_t i = 0; context && i < sizeof pairs / sizeof pairs[0]; i++) {
        long a = number_of(context, pairs[i][0]), b = number_of(context, pairs[i][1]);
        CHECK(a == b, "%s: %s is %ld, %s is %ld", path, pairs[i][0], a, pairs[i][1], b);
    }
    CHECK(!context || number_of(context, "count(//testcase)") > 0, "%s has no case", path);
    xmlXPathFreeContext(context);
    xmlFreeDoc(doc);
}

/* Every link within the page leads somewhere, and nothing is loaded from elsewhere. */
static void read_html(const char *path)
{
    htmlDocPtr doc =
        htmlReadFile(path, "UTF-8", HTML_PARSE_NOERROR | HTML_PARSE_NOWARNING | HTML_PARSE_NONET);
    xmlXPathContextPtr context = doc ? xmlXPathNewContext(doc) : NULL;
    CHECK(context, "%s is not HTML", path);
    xmlXPathObjectPtr links =
        context ? xmlXPathEvalExpression((const xmlChar *)"//a/@href[starts-with(., '#')]", context) : NULL;
    for (int i = 0; links && links->nodesetval && i < links->nodesetval->nodeNr; i++) {
        char expression[600];
        xmlChar *target = xmlNodeGetContent(links->nodesetval->nodeTab[i]);
        snprintf(expression, sizeof expression, "count(//*[@id=\"%s\"])", (const char *)target + 1);
        CHECK(number_of(context, expression) == 1, "%s: the link %s leads to %ld places", path, (const char *)target,
              number_of(context, expression));
        xmlFree(target);
    }
    xmlXPathFreeObject(links);
    CHECK(!context || number_of(context, "count(//script/@src | //link/@href | //iframe | //img/@src[not(starts-with(., 'data:'))])") == 0,
          "%s loads something", path);
    CHECK(!context || number_of(context, "string-length(normalize-space(//h1))") > 0, "%s has no heading", path);
    xmlXPathFreeContext(context);
    xmlFreeDoc(doc);
}

static size_t cells(const char *line)
{
    size_t count = 0;
    for (const char *at = line; *at; at++)
        count += *at == '|' && (at == line || at[-1] != '\\');
    return count;
}

/* Rows of a table have as many cells as its head. */
static void read_markdown(const char *path)
{
    char line[8192];
    size_t columns = 0, number = 0;
    FILE *file = fopen(path, "r");
    CHECK(file, "%s cannot be read", path);
    while (file && fgets(line, sizeof line, file)) {
        size_t found = line[0] == '|' ? cells(line) : 0;
        number++;
        CHECK(!columns || !found || found == columns, "%s:%zu has %zu cells, the head has %zu", path, number, found, columns);
        columns = found;
    }
    CHECK(number > 0, "%s is empty", path);
    if (file)
        fclose(file);
}

int main(int argc, char **argv)
{
    if (argc != 2) {
        fprintf(stderr, "usage: read_reports FOLDER\n");
        return 2;
    }
    static const struct {
        const char *name;
        void (*read)(const char *path);
    } files[] = {{"gate.md", read_markdown}, {"gate.html", read_html}, {"new/junit.xml", read_junit}, {"new/report.html", read_html}};
    char path[4096];
    snprintf(path, sizeof path, "%s/gate.json", argv[1]);
    size_t counting = read_json(path);
    snprintf(path, sizeof path, "%s/gate.sarif", argv[1]);
    size_t results = read_sarif(path);
    CHECK(counting == results, "gate.json has %zu reasons, gate.sarif %zu results", counting, results);
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
        snprintf(path, sizeof path, "%s/%s", argv[1], files[i].name);
        files[i].read(path);
    }
    xmlCleanupParser();
    return problems != 0;
}
