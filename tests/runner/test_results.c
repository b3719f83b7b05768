/* SPDX-License-Identifier: Apache-2.0 */
/* The model of results and the files written from it. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <libxml/parser.h>
#include <math.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cts/describe.h"
#include "cts/results.h"

static char folder[] = "/tmp/gnomon-results-XXXXXX";

static const char *in_folder(const char *name)
{
    static char path[256];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

static char *read_all(const char *path)
{
    char *data = NULL, error[256];
    size_t length = 0;
    if (!gn_file_read(path, 1 << 24, &data, &length, error, sizeof error))
        fail_msg("%s", error);
    return data;
}

static void texts(void **state)
{
    static const struct {
        const char *in, *out;
    } rows[] = {
        {"plain", "plain"},
        {"tab\tand\nline", "tab\tand\nline"},
        {"bell\a, escape\033[31m", "bell?, escape?[31m"},
        {"caf\xC3\xA9", "caf\xC3\xA9"},
        {"torn \xC3", "torn ?"},
        {"overlong \xC0\xAF", "overlong ??"},
        {"surrogate \xED\xA0\x80", "surrogate ???"},
        {"beyond \xF4\x90\x80\x80", "beyond ????"},
        {"no character \xEF\xBF\xBF", "no character ???"}, /* XML forbids U+FFFF */
        {"emoji \xF0\x9F\x94\xA5", "emoji \xF0\x9F\x94\xA5"},
        {"\x7F\x80", "??"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        char text[64];
        strcpy(text, rows[i].in);
        gn_text_clean(text);
        assert_string_equal(text, rows[i].out);
    }
}

static struct gn_results_case sample_case(void)
{
    struct gn_results_case cs = {
        .name = "query.edges.fan",
        .family = "edges",
        .spec = "a ray \"should\" not miss <spec>",
        .status = GN_CASE_LEAK,
        .seconds = 0.125,
        .rays = 1000,
        .ideal_hits = 900,
        .hit_error_median = 0.3,
        .hit_error_p999 = 1.7,
        .hit_error_max = (double)INFINITY,
        .margin_max = 3.5,
        .message = "3 of 1000 rays leak & <more>; details]]>",
        .output = "driver said: \"x\"",
        .replay = "replay/query.edges.fan.json",
        .has_offender = true,
    };
    cs.class_counts[GN_REF_EXACT] = 990;
    cs.class_counts[GN_REF_ADMISSIBLE] = 7;
    cs.class_counts[GN_REF_LEAK] = 3;
    cs.offender = (struct gn_case_offender){
        .trace = 2,
        .ray_index = 77,
        .ray = {.ray = {.origin = {0.1f, -0.0f, 0x1p-149f},
                        .tmin = 0,
                        .direction = {1e-30f, 3.4028235e38f, -1},
                        .tmax = INFINITY,
                        .flags = 0x11,
                        .cull_mask = 0xA5},
                .policy = {.confirm_mask = 0xFFFFFFFF,
                           .generate_mask = 0x10,
                           .generate_t0 = 0.5f,
                           .generate_step = 1}},
        .answer = {.kind = GN_REF_ANSWER_TRIANGLE,
                   .instance = 1,
                   .geometry = 2,
                   .primitive = 0xFFFFFFFF,
                   .custom_index = 0xFFFFFF,
                   .sbt_offset = 5,
                   .front = 1,
                   .t = NAN,
                   .barycentrics = {0.3f, -INFINITY}},
        .verdict = {.cls = GN_REF_LEAK,
                    .ideal_hit = true,
                    .ideal = {.type = GN_REF_TRIANGLES,
                              .instance = 3,
                              .primitive = 9,
                              .t = 1.0 / 3,
                              .beta = 0.1,
                              .front = true},
                    .hit_error = 0.7,
                    .hit_bound = 24,
                    .margin = (double)INFINITY,
                    .reason = "lost triangle 9"},
    };
    return cs;
}

static void round_trip(void **state)
{
    struct gn_arena arena = {0};
    struct gn_results_case cs = sample_case(), back;
    uint8_t image[12];
    char error[256];
    size_t length = 0;
    (void)state;
    for (int i = 0; i < 12; i++)
        image[i] = i < 5 ? 0 : i < 11 ? 0x83 : 0xFF;
    cs.image = image;
    cs.picture_width = 4;
    cs.picture_height = 3;
    char *text = gn_results_case_encode(&cs, &length);
    assert_non_null(text);
    assert_null(memchr(text, '\n', length));
    if (!gn_results_case_decode(text, length, &arena, &back, error, sizeof error))
        fail_msg("%s in %s", error, text);
    assert_string_equal(back.name, cs.name);
    assert_string_equal(back.family, cs.family);
    assert_string_equal(back.spec, cs.spec);
    assert_string_equal(back.message, cs.message);
    assert_string_equal(back.output, cs.output);
    assert_string_equal(back.replay, cs.replay);
    assert_int_equal(back.status, cs.status);
    assert_memory_equal(back.class_counts, cs.class_counts, sizeof cs.class_counts);
    assert_true(isinf(back.hit_error_max));
    assert_memory_equal(&back.offender.ray, &cs.offender.ray,
                        sizeof cs.offender.ray); /* bit for bit, -0 too */
    assert_int_equal(back.offender.answer.primitive, 0xFFFFFFFF);
    assert_true(isnan(back.offender.answer.t));
    assert_true(isinf(back.offender.answer.barycentrics[1]) && back.offender.answer.barycentrics[1] < 0);
    assert_true(back.offender.verdict.ideal_hit);
    assert_memory_equal(&back.offender.verdict.ideal.t, &cs.offender.verdict.ideal.t, sizeof(double));
    assert_int_equal(back.offender.verdict.cls, GN_REF_LEAK);
    assert_string_equal(back.offender.verdict.reason, "lost triangle 9");
    assert_non_null(back.image);
    assert_memory_equal(back.image, image, sizeof image);

    /* What a worker's broken memory may send is refused, not believed. */
    static const char *const bad[] = {
        "",
        "{",
        "[]",
        "null",
        "{}",
        "{\"name\":\"x\"}",
        "{\"name\":\"\",\"status\":\"pass\"}",
        "{\"name\":\"x\",\"status\":\"fine\"}",
        "{\"name\":7,\"status\":\"pass\"}",
        "{\"name\":\"x\",\"status\":\"leak\",\"picture_width\":4,\"picture_height\":3,\"image\":\"0:5,\"}",
        "{\"name\":\"x\",\"status\":\"leak\",\"picture_width\":4,\"picture_height\":3,\"image\":\"0:d,\"}",
        "{\"name\":\"x\",\"status\":\"leak\",\"picture_width\":4,\"picture_height\":3,\"image\":\"100:c,\"}",
        "{\"name\":\"x\",\"status\":\"leak\",\"picture_width\":4,\"picture_height\":3,\"image\":\"zz\"}",
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        if (gn_results_case_decode(bad[i], strlen(bad[i]), &arena, &back, error, sizeof error) || !error[0])
            fail_msg("taken for a case: %s", bad[i]);
    /* Every cut of a good line is refused or a case, and never more. */
    for (size_t cut = 0; cut < length; cut++)
        assert_false(gn_results_case_decode(text, cut, &arena, &back, error, sizeof error));
    free(text);
    gn_arena_finish(&arena);
}

static void replay_round_trip(void **state)
{
    struct gn_arena arena = {0};
    struct gn_replay replay = {"query.a.b", "/x/icd.json", "dev", UINT64_MAX, 0.1, 3, 70000, "leak", "m"},
                     back;
    char error[256];
    size_t length = 0;
    (void)state;
    char *text = gn_replay_encode(&replay, &length);
    assert_true(gn_replay_decode(text, length, &arena, &back, error, sizeof error));
    free(text);
    assert_string_equal(back.name, "query.a.b");
    assert_true(back.seed == UINT64_MAX);
    assert_memory_equal(&back.scale, &replay.scale, sizeof(double));
    assert_int_equal(back.trace, 3);
    assert_int_equal(back.ray, 70000);
    replay.trace = replay.ray = -1; /* the whole case */
    text = gn_replay_encode(&replay, &length);
    assert_true(gn_replay_decode(text, length, &arena, &back, error, sizeof error));
    free(text);
    assert_int_equal(back.trace, -1);
    static const char *const bad[] = {"x",
                                      "{}",
                                      "{\"replay\":\"a\",\"seed\":1}",
                                      "{\"replay\":\"a\",\"seed\":-1,\"scale\":1}",
                                      "{\"replay\":\"a\",\"seed\":1,\"scale\":\"nan\"}",
                                      "{\"replay\":\"\",\"seed\":1,\"scale\":1}"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        if (gn_replay_decode(bad[i], strlen(bad[i]), &arena, &back, error, sizeof error))
            fail_msg("taken for a replay file: %s", bad[i]);
    gn_arena_finish(&arena);
}

static void add(struct gn_results *results, const char *name, enum gn_case_status status,
                enum gn_results_outcome outcome)
{
    struct gn_results_case cs = {.name = name,
                                 .family = "f",
                                 .spec = "s",
                                 .status = status,
                                 .outcome = outcome,
                                 .rays = 10,
                                 .message = "m <b>&\"'"};
    gn_results_add(results, &cs);
}

static void verdicts(void **state)
{
    enum {
        U = GN_OUTCOME_UNEXPECTED,
        E = GN_OUTCOME_AS_EXPECTED,
        X = GN_OUTCOME_EXPECTED_FAILURE,
        P = GN_OUTCOME_UNEXPECTED_PASS
    };
    static const struct {
        struct {
            enum gn_case_status status;
            int outcome;
        } cases[4];
        size_t count;
        const char *stopped;
        bool at_limit, unmatched;
        const char *verdict;
        int exit_status;
    } rows[] = {
        {{{GN_CASE_PASS, E}, {GN_CASE_PASS, E}}, 2, "", false, false, "All 2 cases passed.", 0},
        {{{GN_CASE_PASS, E}}, 1, "", false, false, "The case passed.", 0},
        {{{GN_CASE_PASS, E}, {GN_CASE_SKIP, E}},
         2,
         "",
         false,
         false,
         "Nothing unexpected in 2 cases: 1 passed, 1 was skipped.",
         0},
        {{{GN_CASE_FAIL, U}, {GN_CASE_LEAK, U}, {GN_CASE_PASS, E}, {GN_CASE_SKIP, E}},
         4,
         "",
         false,
         false,
         "1 of 4 cases failed, 1 leaked; 1 passed, 1 was skipped.",
         1},
        {{{GN_CASE_CRASH, U}, {GN_CASE_TIMEOUT, U}, {GN_CASE_ERROR, U}},
         3,
         "",
         false,
         false,
         "1 of 3 cases crashed, 1 timed out, 1 could not be judged; 0 passed.",
         1},
        {{{GN_CASE_LEAK, X}, {GN_CASE_PASS, E}},
         2,
         "",
         false,
         false,
         "Nothing unexpected in 2 cases: 1 passed, 1 failed as expected.",
         0},
        {{{GN_CASE_PASS, P}, {GN_CASE_PASS, E}},
         2,
         "",
         false,
         false,
         "1 case passed against expectation; 1 passed.",
         1},
        {{{GN_CASE_PASS, E}}, 1, "", false, true, "1 expectation is stale; 1 passed.", 1},
        {{{GN_CASE_SKIP, E}, {GN_CASE_SKIP, E}},
         2,
         "",
         false,
         false,
         "Nothing was judged: all cases were skipped.",
         4},
        {{{GN_CASE_PASS, E}},
         1,
         "interrupted by Ctrl-C",
         false,
         false,
         "Stopped after 1 of 9 cases (interrupted by Ctrl-C): the case passed.",
         3},
        {{{GN_CASE_FAIL, U}},
         1,
         "1 failed",
         true,
         false,
         "Stopped after 1 of 9 cases (1 failed): 1 of 1 case failed; 0 passed.",
         1},
        {{{GN_CASE_PASS, E}},
         0,
         "interrupted by SIGTERM",
         false,
         false,
         "Stopped after 0 of 9 cases (interrupted by SIGTERM): no case ran.",
         3},
    };
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_results results;
        char verdict[1024];
        gn_results_init(&results);
        for (size_t c = 0; c < rows[i].count; c++)
            add(&results, "query.f.c", rows[i].cases[c].status,
                (enum gn_results_outcome)rows[i].cases[c].outcome);
        results.stopped = rows[i].stopped;
        results.stopped_at_limit = rows[i].at_limit;
        results.run.selected = 9;
        if (rows[i].unmatched)
            gn_results_add_stale(&results, "file:3: query.no.such");
        gn_results_verdict(&results, verdict, sizeof verdict);
        if (strcmp(verdict, rows[i].verdict) != 0 || gn_results_exit_status(&results) != rows[i].exit_status)
            fail_msg("row %zu: expected '%s' and %d, found '%s' and %d", i, rows[i].verdict,
                     rows[i].exit_status, verdict, gn_results_exit_status(&results));
        gn_results_finish(&results);
    }
}

static void fill(struct gn_results *results)
{
    gn_results_init(results);
    results->run.selected = 5;
    results->run.backend = "query";
    results->run.started = "2026-01-02T03:04:05Z";
    snprintf(results->run.device.name, sizeof results->run.device.name, "<Device> & \"Co\"");
    struct gn_results_case leak = sample_case();
    leak.outcome = GN_OUTCOME_UNEXPECTED;
    gn_results_add(results, &leak);
    add(results, "query.f.a", GN_CASE_PASS, GN_OUTCOME_AS_EXPECTED);
    add(results, "query.f.b", GN_CASE_SKIP, GN_OUTCOME_AS_EXPECTED);
    add(results, "query.f.c", GN_CASE_CRASH, GN_OUTCOME_UNEXPECTED);
    add(results, "query.f.d", GN_CASE_LEAK, GN_OUTCOME_EXPECTED_FAILURE);
    add(results, "query.f.e", GN_CASE_PASS, GN_OUTCOME_UNEXPECTED_PASS);
    gn_results_sort(results);
}

static void csv(void **state)
{
    struct gn_results results;
    char error[256];
    (void)state;
    fill(&results);
    assert_true(gn_results_csv_write(&results, in_folder("results.csv"), error, sizeof error));
    char *text = read_all(in_folder("results.csv"));
    assert_string_equal(text, "query.edges.fan,Fail,0.125000\n"
                              "query.f.a,Pass,0.000000\n"
                              "query.f.b,Skip,0.000000\n"
                              "query.f.c,Crash,0.000000\n"
                              "query.f.d,ExpectedFail,0.000000\n"
                              "query.f.e,UnexpectedImprovement(Pass),0.000000\n");
    free(text);
    assert_false(gn_results_csv_write(&results, "/dev/null/x", error, sizeof error));
    assert_non_null(strstr(error, "/dev/null/x"));
    gn_results_finish(&results);
}

static int count_elements(xmlNodePtr node, const char *name)
{
    int n = 0;
    for (; node; node = node->next) {
        n += node->type == XML_ELEMENT_NODE && strcmp((const char *)node->name, name) == 0;
        n += count_elements(node->children, name);
    }
    return n;
}

static void expect_attribute(xmlNodePtr node, const char *name, const char *value)
{
    xmlChar *found = xmlGetProp(node, (const xmlChar *)name);
    assert_non_null(found);
    assert_string_equal((const char *)found, value);
    xmlFree(found);
}

static void junit(void **state)
{
    struct gn_results results;
    char error[256];
    (void)state;
    fill(&results);
    assert_true(gn_results_junit_write(&results, in_folder("junit.xml"), error, sizeof error));
    xmlDocPtr doc = xmlReadFile(in_folder("junit.xml"), NULL, XML_PARSE_NONET);
    assert_non_null(doc); /* well-formed, messages with <, & and ]]> and all */
    xmlNodePtr root = xmlDocGetRootElement(doc);
    assert_string_equal((const char *)root->name, "testsuites");
    expect_attribute(root, "tests", "6");
    expect_attribute(root, "failures", "2");
    expect_attribute(root, "errors", "1");
    expect_attribute(root, "skipped", "2");
    assert_int_equal(count_elements(root, "testsuite"), 2);
    assert_int_equal(count_elements(root, "testcase"), 6);
    assert_int_equal(count_elements(root, "failure"), 2);
    assert_int_equal(count_elements(root, "error"), 1);
    assert_int_equal(count_elements(root, "skipped"), 2);
    xmlFreeDoc(doc);
    gn_results_finish(&results);
}

static void html(void **state)
{
    struct gn_results results;
    char error[256];
    (void)state;
    fill(&results);
    assert_true(gn_results_html_write(&results, folder, in_folder("report.html"), error, sizeof error));
    char *page = read_all(in_folder("report.html"));
    const char *verdict = strstr(page, "<div class=\"verdict no\">1 of 6 cases leaked, 1 crashed"),
               *families = strstr(page, "<h2>Families"), *failures = strstr(page, "<h2>Failures");
    assert_true(verdict && families && failures);
    assert_true(verdict < families && families < failures);
    assert_null(strstr(page, "<b>&\"'")); /* what messages hold is text */
    assert_non_null(strstr(page, "m &lt;b&gt;&amp;&quot;&#39;"));
    assert_non_null(strstr(page, "&lt;Device&gt; &amp; &quot;Co&quot;"));
    assert_null(strstr(page, "http://"));
    assert_null(strstr(page, "https://"));
    assert_non_null(strstr(page, "replay/query.edges.fan.json"));
    free(page);
    gn_results_finish(&results);
}

static void jsonl(void **state)
{
    struct gn_results results;
    char error[256];
    (void)state;
    static const char content[] = "{\"name\":\"query.a.b\",\"status\":\"pass\",\"seconds\":1}\n"
                                  "{\"name\":\"query.a.c\",\"status\":\"leak\"}\n"
                                  "{\"name\":\"summary\",\"status\":\"fail\"}\n"
                                  "{\"name\":\"query.a.d\",\"sta"; /* torn off by a kill */
    assert_true(gn_file_write(in_folder("r.jsonl"), content, strlen(content), error, sizeof error));
    gn_results_init(&results);
    assert_true(gn_results_jsonl_read(&results, in_folder("r.jsonl"), error, sizeof error));
    assert_int_equal(results.count, 2);
    assert_string_equal(results.cases[1].name, "query.a.c");
    assert_int_equal(results.cases[1].outcome, GN_OUTCOME_UNEXPECTED);
    assert_true(gn_results_jsonl_read(&results, in_folder("none.jsonl"), error, sizeof error));
    assert_int_equal(results.count, 2);
    assert_true(gn_file_write(in_folder("bad.jsonl"), "{}\n", 3, error, sizeof error));
    assert_false(gn_results_jsonl_read(&results, in_folder("bad.jsonl"), error, sizeof error));
    assert_non_null(strstr(error, "bad.jsonl:1:"));
    gn_results_finish(&results);
}

struct reader {
    const uint8_t *data;
    size_t length, at;
};

static void read_bytes(png_structp png, png_bytep out, size_t length)
{
    struct reader *reader = png_get_io_ptr(png);
    if (length > reader->length - reader->at)
        png_error(png, "short");
    memcpy(out, reader->data + reader->at, length);
    reader->at += length;
}

/* Decodes to RGBA; gives the picture's width. */
static uint32_t decode_png(const uint8_t *data, size_t length, uint8_t *out, size_t size)
{
    struct reader reader = {data, length, 0};
    png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    png_set_read_fn(png, &reader, read_bytes);
    png_read_info(png, info);
    png_set_palette_to_rgb(png);
    png_set_tRNS_to_alpha(png);
    png_read_update_info(png, info);
    uint32_t width = png_get_image_width(png, info), height = png_get_image_height(png, info);
    assert_true((size_t)width * height * 4 <= size);
    for (uint32_t y = 0; y < height; y++)
        png_read_row(png, out + (size_t)y * width * 4, NULL);
    png_destroy_read_struct(&png, &info, NULL);
    return width;
}

static void pictures(void **state)
{
    const uint8_t image[6] = {GN_REF_EXACT, GN_REF_WRONG, 0x80, 0x80 | GN_REF_WRONG, GN_REF_LEAK, 0xFF};
    static uint8_t large[2000 * 3], pixels[2000 * 3 * 4];
    size_t length = 0;
    (void)state;
    uint8_t *png = gn_picture_png(image, 3, 2, &length);
    assert_non_null(png);
    assert_int_equal(decode_png(png, length, pixels, sizeof pixels), 3);
    for (int i = 0; i < 5; i++) {
        uint32_t rgb = (uint32_t)pixels[4 * i] << 16 | (uint32_t)pixels[4 * i + 1] << 8 | pixels[4 * i + 2];
        assert_int_equal(rgb, gn_picture_colour(image[i]));
        assert_int_equal(pixels[4 * i + 3], 255);
    }
    assert_int_equal(pixels[4 * 5 + 3], 0); /* no ray there */
    free(png);

    /* A picture that is reduced keeps its only bad ray. */
    large[1234] = GN_REF_LEAK;
    png = gn_picture_png(large, 2000, 3, &length);
    assert_non_null(png);
    uint32_t width = decode_png(png, length, pixels, sizeof pixels);
    assert_true(width < 2000);
    uint32_t leaks = 0;
    for (uint32_t i = 0; i < width; i++)
        leaks += ((uint32_t)pixels[4 * i] << 16 | (uint32_t)pixels[4 * i + 1] << 8 | pixels[4 * i + 2]) ==
                 gn_picture_colour(GN_REF_LEAK);
    assert_int_equal(leaks, 1);
    free(png);
}

static void numbers(void **state)
{
    char text[32];
    (void)state;
    assert_string_equal(gn_format_grouped(0, text), "0");
    assert_string_equal(gn_format_grouped(999, text), "999");
    assert_string_equal(gn_format_grouped(1000, text), "1,000");
    assert_string_equal(gn_format_grouped(1234567, text), "1,234,567");
    assert_string_equal(gn_format_grouped(UINT64_MAX, text), "18,446,744,073,709,551,615");
}

static void whole_files(void **state)
{
    char error[256];
    struct stat info;
    (void)state;
    assert_true(gn_file_write(in_folder("old"), "old", 3, error, sizeof error));
    /* A folder in the temporary's place: the write fails and the old file stays. */
    assert_int_equal(mkdir(in_folder("old.part"), 0777), 0);
    assert_false(gn_file_write(in_folder("old"), "new", 3, error, sizeof error));
    char *text = read_all(in_folder("old"));
    assert_string_equal(text, "old");
    free(text);
    rmdir(in_folder("old.part"));
    assert_true(gn_folder_create(in_folder("a/b//c/"), error, sizeof error));
    assert_int_equal(stat(in_folder("a/b/c"), &info), 0);
    assert_false(gn_folder_create(in_folder("old"), error, sizeof error));
    assert_non_null(strstr(error, "is not a folder"));
    assert_false(gn_folder_create("/dev/null/x", error, sizeof error));
}

static int make_folder(void **state)
{
    (void)state;
    return mkdtemp(folder) ? 0 : -1;
}

static int remove_folder(void **state)
{
    char command[128];
    (void)state;
    snprintf(command, sizeof command, "rm -r '%s'", folder);
    return system(command);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(texts),    cmocka_unit_test(round_trip),  cmocka_unit_test(replay_round_trip),
        cmocka_unit_test(verdicts), cmocka_unit_test(csv),         cmocka_unit_test(junit),
        cmocka_unit_test(html),     cmocka_unit_test(jsonl),       cmocka_unit_test(pictures),
        cmocka_unit_test(numbers),  cmocka_unit_test(whole_files),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
