/* SPDX-License-Identifier: Apache-2.0 */
/* Expectation files: reading, what they make of a status, and rewriting them. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cts/expect.h"



static const char *write_temporary(const char *content)
{
    static char path[64];
    strcpy(path, "/tmp/gnomon-expect-XXXXXX");
    int fd = mkstemp(path);
    assert_true(fd >= 0);
    assert_int_equal(write(fd, content, strlen(content)), (ssize_t)strlen(content));
    close(fd);
    return path;
}

static void expectation_files(void **state)
{
    static const struct {
        const char *content;
        const char *error; /* NULL: it is read */
        size_t count;
        const char *reason; /* of the last entry */
    } rows[] = {
        {"", NULL, 0, NULL},
        {"\n\n# only words\n", NULL, 0, NULL},
        {"query.a.b,Fail\n", NULL, 1, ""},
        {"query.a.b,Fail", NULL, 1, ""}, /* no newline at the end */
        {"  query.a.b , Crash \r\n", NULL, 1, ""},
        {"# wrong at edges\n# of slivers\nquery.a.b,Fail\n", NULL, 1, "wrong at edges of slivers"},
        {"# stale\n\nquery.a.b,Fail\n", NULL, 1, ""}, /* an empty line parts a comment from what follows */
        {"# both\nquery.a.b,Fail\nquery.a.c,Timeout\n", NULL, 2, "both"},
        {"# one\nquery.a.b,Fail\n# two\nquery.a.c,Fail\n", NULL, 2, "two"},
        {"query.a.b,Fail # behind\n", NULL, 1, "behind"},
        {"# above\nquery.a.b,Fail # bug: https://bugs.example/1\n", NULL, 1, "above"},
        {"# my file\n# device: one\n# why\nquery.a.b,Fail\n", NULL, 1, "why"}, /* what is said of the file is no reason */
        {"\xEF\xBB\xBF# mark\nquery.a.b,Fail\n", NULL, 1, "mark"},
        {"query.a.b\n", ":1: expected `name,Status`", 0, NULL},
        {"query.a.b,Pass\nquery.a.c,Leak\n", NULL, 2, ""},
        {"query.a.b,Pass\nquery.a.c,Flake\n", ":2: expected a name and one of", 0, NULL},
        {"query.a.b,fail\n", "found 'query.a.b' and 'fail'", 0, NULL},
        {",Fail\n", ":1: expected a name", 0, NULL},
    };
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_arena arena = {0};
        struct gn_expectations expectations = {0};
        char error[600] = "";
        const char *path = write_temporary(rows[i].content);
        bool ok = gn_expectations_read(&expectations, path, &arena, error, sizeof error);
        unlink(path);
        if (rows[i].error) {
            if (ok || !strstr(error, rows[i].error))
                fail_msg("row %zu: expected '%s', found '%s'", i, rows[i].error, error);
        } else {
            if (!ok || expectations.count != rows[i].count)
                fail_msg("row %zu: expected %zu entries, found %zu, '%s'", i, rows[i].count,
                         expectations.count, error);
            if (rows[i].count && strcmp(expectations.list[rows[i].count - 1].reason, rows[i].reason) != 0)
                fail_msg("row %zu: expected the reason '%s', found '%s'", i, rows[i].reason,
                         expectations.list[rows[i].count - 1].reason);
        }
        gn_expectations_finish(&expectations);
        gn_arena_finish(&arena);
    }
    struct gn_arena arena = {0};
    struct gn_expectations expectations = {0};
    char error[600];
    assert_false(gn_expectations_read(&expectations, "/nowhere/at/all", &arena, error, sizeof error));
    assert_non_null(strstr(error, "/nowhere/at/all"));
    gn_arena_finish(&arena);
}

static void outcomes(void **state)
{
    static const struct {
        const char *expected; /* NULL: no entry */
        enum gn_case_status status;
        enum gn_results_outcome outcome;
    } rows[] = {
        {NULL, GN_CASE_PASS, GN_OUTCOME_AS_EXPECTED},
        {NULL, GN_CASE_SKIP, GN_OUTCOME_AS_EXPECTED},
        {NULL, GN_CASE_FAIL, GN_OUTCOME_UNEXPECTED},
        {NULL, GN_CASE_LEAK, GN_OUTCOME_UNEXPECTED},
        {NULL, GN_CASE_ERROR, GN_OUTCOME_UNEXPECTED},
        {"Fail", GN_CASE_FAIL, GN_OUTCOME_EXPECTED_FAILURE},
        {"Fail", GN_CASE_LEAK, GN_OUTCOME_EXPECTED_FAILURE},
        {"Leak", GN_CASE_LEAK, GN_OUTCOME_EXPECTED_FAILURE},
        {"Leak", GN_CASE_FAIL, GN_OUTCOME_UNEXPECTED}, /* answers that are wrong are more than a leak */
        {"Leak", GN_CASE_PASS, GN_OUTCOME_UNEXPECTED_PASS},
        {"Fail", GN_CASE_CRASH, GN_OUTCOME_UNEXPECTED}, /* worse than expected */
        {"Fail", GN_CASE_TIMEOUT, GN_OUTCOME_UNEXPECTED},
        {"Fail", GN_CASE_PASS, GN_OUTCOME_UNEXPECTED_PASS},
        {"Fail", GN_CASE_SKIP, GN_OUTCOME_UNEXPECTED}, /* the file no longer says what comes out */
        {"Pass", GN_CASE_SKIP, GN_OUTCOME_UNEXPECTED},
        {"Skip", GN_CASE_SKIP, GN_OUTCOME_AS_EXPECTED},
        {"Skip", GN_CASE_PASS, GN_OUTCOME_UNEXPECTED_PASS},
        {"Skip", GN_CASE_FAIL, GN_OUTCOME_UNEXPECTED},
        {"Crash", GN_CASE_CRASH, GN_OUTCOME_EXPECTED_FAILURE},
        {"Crash", GN_CASE_FAIL, GN_OUTCOME_UNEXPECTED},
        {"Timeout", GN_CASE_TIMEOUT, GN_OUTCOME_EXPECTED_FAILURE},
        {"Pass", GN_CASE_PASS, GN_OUTCOME_AS_EXPECTED},
        {"Pass", GN_CASE_FAIL, GN_OUTCOME_UNEXPECTED},
    };
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_expectation entry = {.name = "query.a.b", .status = rows[i].expected, .reason = "why", .place = "f:1"};
        struct gn_expectations expectations = {.list = &entry, .count = rows[i].expected ? 1 : 0};
        struct gn_results_case cs = {.name = "query.a.b", .status = rows[i].status};
        gn_expectations_apply(&expectations, &cs);
        if (cs.outcome != rows[i].outcome)
            fail_msg("expected %s, status %s: outcome %d, should be %d",
                     rows[i].expected ? rows[i].expected : "nothing", gn_case_status_name(rows[i].status),
                     cs.outcome, rows[i].outcome);
    }
}

/* A folder with one file in it; the path of the file. */
static const char *write_named(const char *name, const char *content)
{
    static char path[160];
    char folder[] = "/tmp/gnomon-expect-XXXXXX", error[300];
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/%s", folder, name);
    assert_true(gn_file_write(path, content, strlen(content), error, sizeof error));
    return path;
}

static void remove_named(const char *path)
{
    char folder[160];
    unlink(path);
    snprintf(folder, sizeof folder, "%.*s", (int)(strrchr(path, '/') - path), path);
    rmdir(folder);
}

static void kinds_and_keys(void **state)
{
    static const struct {
        const char *file, *content;
        const char *error; /* NULL: it is read */
        enum gn_expectation_kind kind;
        const char *name; /* of a case that the last entry is asked about */
        bool found;
    } rows[] = {
        {"lvp-flakes.txt", "query.a.b\n", NULL, GN_EXPECT_FLAKE, "query.a.b", true},
        {"lvp-flakes.txt", "query.a.b\n", NULL, GN_EXPECT_FLAKE, "query.a.bc", false}, /* a name is the whole name */
        {"lvp-flakes.txt", "query.a.b\n", NULL, GN_EXPECT_FLAKE, "queryxa.b", false},
        {"lvp-flakes.txt", "query\\.a\\..*\n", NULL, GN_EXPECT_FLAKE, "query.a.bc", true},
        {"lvp-skips.txt", "a.b|c.d\n", NULL, GN_EXPECT_SKIP, "query.c.d.e", true}, /* as deqp-runner: anywhere */
        {"lvp-skips.txt", "query.a.[b\n", "is no regular expression", GN_EXPECT_SKIP, NULL, false},
        {"lvp-skips.txt", "query.a.b,Fail\n", "expected a name alone in a file of skips", GN_EXPECT_SKIP, NULL, false},
        {"lvp-skips.txt", "query.a.b{1,2}c\n", NULL, GN_EXPECT_SKIP, "query.a.bbc", true},
        {"lvp-skips.txt", "query.a.*,Fail\n", "expected a name alone", GN_EXPECT_SKIP, NULL, false},
        {"lvp-skips.txt", "query.a.b,c\n", "expected a name alone", GN_EXPECT_SKIP, NULL, false},
        {"lvp-skips.txt", "(a|b)*\\1\n", "back-reference", GN_EXPECT_SKIP, NULL, false},
        {"lvp-skips.txt", "query\\.\\\\?a\\.b\n", NULL, GN_EXPECT_SKIP, "query.a.b", true},
        {"lvp-skips.txt", "query.a.b\\\n", "is no regular expression", GN_EXPECT_SKIP, NULL, false},
        {"lvp-flakes.txt", "query.a.b\nquery.a.c\nquery.a.b\n", ":3: 'query.a.b' stands at", GN_EXPECT_FLAKE, NULL, false},
        {"x-fails.txt", "query.a.b,Fail\nquery.a.b,Crash\n", "stands at", GN_EXPECT_STATUS, NULL, false},
        {"x-fails.txt", "# expires: 2027-01-31\nquery.a.b,Fail\n", NULL, GN_EXPECT_STATUS, "query.a.b", true},
        {"x-fails.txt", "# expires: 2026-01-31\nquery.a.b,Fail\n", NULL, GN_EXPECT_STATUS, "query.a.b", false},
        {"x-fails.txt", "# expires: 2026-06-15\nquery.a.b,Fail\n", NULL, GN_EXPECT_STATUS, "query.a.b", true}, /* today */
        {"x-fails.txt", "query.a.b,Fail # expires: 2026-01-31\n", NULL, GN_EXPECT_STATUS, "query.a.b", false},
        {"x-fails.txt", "query.a.c,Fail # expires: 2026-01-31\nquery.a.b,Fail\n", NULL, GN_EXPECT_STATUS, "query.a.b", true},
        {"x-fails.txt", "# Expires : 2026-01-31\nquery.a.b,Fail\n", NULL, GN_EXPECT_STATUS, "query.a.b", false},
        {"x-fails.txt", "\xEF\xBB\xBFquery.a.b,Fail\n", NULL, GN_EXPECT_STATUS, "query.a.b", true},
        {"x-fails.txt", "# expires 2026-01-31\nquery.a.b,Fail\n", "expected `expires:`", GN_EXPECT_STATUS, NULL, false},
        {"x-fails.txt", "# expires with the next release\nquery.a.b,Fail\n", NULL, GN_EXPECT_STATUS, "query.a.b", true},
        {"x-fails.txt", "query.a.b,Fail # device: one\n", "in a line of its own", GN_EXPECT_STATUS, NULL, false},
        {"x-fails.txt", "# expires: 2026-02-29\n", "expected a date", GN_EXPECT_STATUS, NULL, false},
        {"x-fails.txt", "# expires: 2028-02-29\nquery.a.b,Fail\n", NULL, GN_EXPECT_STATUS, "query.a.b", true},
        {"x-fails.txt", "# expires: soon\nquery.a.b,Fail\n", "expected a date", GN_EXPECT_STATUS, NULL, false},
        {"x-fails.txt", "# expires: 2026-13-01\n", "expected a date", GN_EXPECT_STATUS, NULL, false},
        {"x-fails.txt", "# device: one\n\n# device: two\n", "is of 'one'", GN_EXPECT_STATUS, NULL, false},
    };
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_arena arena = {0};
        struct gn_expectations expectations = {.today = "2026-06-15"};
        char error[600] = "";
        const char *path = write_named(rows[i].file, rows[i].content);
        bool ok = gn_expectations_read(&expectations, path, &arena, error, sizeof error);
        remove_named(path);
        if (rows[i].error ? ok || !strstr(error, rows[i].error) : !ok)
            fail_msg("row %zu: expected %s, found %s '%s'", i, rows[i].error ? rows[i].error : "no error",
                     ok ? "no error" : "", error);
        if (ok && (gn_expectations_find(&expectations, rows[i].kind, rows[i].name) != NULL) != rows[i].found)
            fail_msg("row %zu: %s should%s be found", i, rows[i].name, rows[i].found ? "" : " not");
        gn_expectations_finish(&expectations);
        gn_arena_finish(&arena);
    }
    struct gn_arena arena = {0};
    struct gn_expectations expectations = {.today = "2026-06-15"};
    char error[600];
    const char *path = write_named("x-fails.txt", "# wrong there\n# bug: https://bugs.example/1\nquery.a.b,Fail\n\nquery.a.c,Fail\n");
    assert_true(gn_expectations_read(&expectations, path, &arena, error, sizeof error));
    remove_named(path);
    assert_string_equal(expectations.list[0].reason, "wrong there");
    assert_string_equal(expectations.list[0].bug, "https://bugs.example/1");
    assert_string_equal(expectations.list[1].bug, "");
    gn_expectations_finish(&expectations);
    gn_arena_finish(&arena);
}

static void flakes(void **state)
{
    static const struct {
        const char *status; /* of the entry that expects one, or NULL */
        enum gn_case_status found;
        enum gn_results_outcome outcome;
        const char *expected;
    } rows[] = {
        {NULL, GN_CASE_PASS, GN_OUTCOME_AS_EXPECTED, "Flake"},
        {NULL, GN_CASE_FAIL, GN_OUTCOME_EXPECTED_FAILURE, "Flake"},
        {NULL, GN_CASE_CRASH, GN_OUTCOME_EXPECTED_FAILURE, "Flake"},
        {"Fail", GN_CASE_FAIL, GN_OUTCOME_EXPECTED_FAILURE, "Fail"},
        {"Fail", GN_CASE_PASS, GN_OUTCOME_AS_EXPECTED, "Flake"}, /* now and then it passes, as flakes do */
    };
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_expectation entries[] = {
            {.kind = GN_EXPECT_FLAKE, .name = "query.a.b", .status = "", .reason = "", .place = ""},
            {.kind = GN_EXPECT_STATUS, .name = "query.a.b", .status = rows[i].status, .reason = "", .place = ""},
        };
        struct gn_expectations expectations = {.list = entries, .count = rows[i].status ? 2 : 1};
        struct gn_results_case cs = {.name = "query.a.b", .status = rows[i].found};
        gn_expectations_apply(&expectations, &cs);
        if (cs.outcome != rows[i].outcome || strcmp(cs.expected, rows[i].expected) != 0)
            fail_msg("row %zu: outcome %d '%s', should be %d '%s'", i, cs.outcome, cs.expected, rows[i].outcome,
                     rows[i].expected);
    }
}

static void several_files(void **state)
{
    static const struct {
        const char *second_file, *second;
        const char *error; /* NULL: it is read */
    } rows[] = {
        {"y-fails.txt", "query.a.b,Fail\n", NULL},
        {"y-fails.txt", "query.a.b,Crash\n", "stands at"},
        {"y-fails.txt", "query.a.c,Crash\n", NULL},
        {"y-flakes.txt", "query.a.b\n", NULL}, /* fails mostly */
    };
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_arena arena = {0};
        struct gn_expectations expectations = {0};
        char error[600] = "";
        const char *path = write_named("x-fails.txt", "query.a.b,Fail\n");
        assert_true(gn_expectations_read(&expectations, path, &arena, error, sizeof error));
        remove_named(path);
        path = write_named(rows[i].second_file, rows[i].second);
        bool ok = gn_expectations_read(&expectations, path, &arena, error, sizeof error);
        remove_named(path);
        if (rows[i].error ? ok || !strstr(error, rows[i].error) : !ok)
            fail_msg("row %zu: expected '%s', found '%s'", i, rows[i].error ? rows[i].error : "no error", error);
        gn_expectations_finish(&expectations);
        gn_arena_finish(&arena);
    }
}

/* What a file of skips keeps from running says nothing against an entry of the same case. */
static void skipped_by_file(void **state)
{
    struct gn_expectation entries[] = {
        {.kind = GN_EXPECT_SKIP, .name = "query.a.b", .status = "", .reason = "", .place = ""},
        {.kind = GN_EXPECT_STATUS, .name = "query.a.b", .status = "Fail", .reason = "", .place = ""},
    };
    struct gn_expectations expectations = {.list = entries, .count = 2};
    struct gn_results_case cs = {.name = "query.a.b", .status = GN_CASE_SKIP};
    (void)state;
    gn_expectations_apply(&expectations, &cs);
    assert_int_equal(cs.outcome, GN_OUTCOME_AS_EXPECTED);
}

/* What the catalogue of the rewriting test has, and what came of it. */
static const struct {
    const char *name;
    enum gn_case_status status;
} came_out[] = {
    {"query.a.fails", GN_CASE_FAIL},   {"query.a.leaks", GN_CASE_LEAK}, {"query.a.passes", GN_CASE_PASS},
    {"query.a.skipped", GN_CASE_SKIP}, {"query.a.crashes", GN_CASE_CRASH}, {"query.a.passes_too", GN_CASE_PASS},
};

static void update(void **state)
{
    static const char device[] = "# device: 0x0001:0x0002 test\n";
    static const struct {
        const char *before, *after; /* without the line of the device, which is added where there is none */
        size_t added, changed, removed;
    } rows[] = {
        /* What holds stays as it is, a comment behind an entry and a Fail for a leak included. */
        {"# known\nquery.a.fails,Fail  # yes\nquery.a.leaks,Fail\nquery.a.crashes,Crash\n",
         "# known\nquery.a.fails,Fail  # yes\nquery.a.leaks,Fail\nquery.a.crashes,Crash\n", 0, 0, 0},
        /* What passes goes, with the comment that was its alone; others keep theirs. */
        {"# mended\nquery.a.passes,Fail\n\n# both\nquery.a.fails,Fail\nquery.a.passes_too,Leak\n\n# all\nquery.a.leaks,Leak\nquery.a.crashes,Crash\n",
         "# both\nquery.a.fails,Fail\n\n# all\nquery.a.leaks,Leak\nquery.a.crashes,Crash\n", 0, 0, 2},
        /* A case that was not run stays, one that does not exist goes; one that is skipped is said to be. */
        {"query.a.not_run,Fail\nquery.no.such,Fail\nquery.a.skipped,Fail\nquery.a.fails,Fail\nquery.a.leaks,Leak\nquery.a.crashes,Crash\n",
         "query.a.not_run,Fail\nquery.a.skipped,Skip\nquery.a.fails,Fail\nquery.a.leaks,Leak\nquery.a.crashes,Crash\n", 0, 1, 1},
        /* Another status is written over, what stands behind it stays. */
        {"query.a.fails,Crash # was worse\nquery.a.leaks,Leak\nquery.a.crashes,Fail\n",
         "query.a.fails,Fail # was worse\nquery.a.leaks,Leak\nquery.a.crashes,Crash\n", 0, 2, 0},
        {"query.a.fails,Fail\nquery.a.leaks,Leak\n",
         "query.a.fails,Fail\nquery.a.leaks,Leak\n\n# New, not looked into: why   1\nquery.a.crashes,Crash\n", 1, 0, 0},
        /* The head of the file stays when the entries right below it go. */
        {"# my file\n# Device : 0x0001:0x0002 test\n# mended\nquery.a.passes,Fail\n# known\nquery.a.fails,Fail\nquery.a.leaks,Leak\nquery.a.crashes,Crash\n",
         "# my file\n# Device : 0x0001:0x0002 test\n# known\nquery.a.fails,Fail\nquery.a.leaks,Leak\nquery.a.crashes,Crash\n", 0, 0, 1},
    };
    (void)state;
    enum { CAME_OUT = sizeof came_out / sizeof came_out[0] };
    struct gn_selected catalogue[CAME_OUT + 1];
    for (size_t i = 0; i < CAME_OUT; i++)
        catalogue[i] = (struct gn_selected){.name = came_out[i].name};
    catalogue[CAME_OUT] = (struct gn_selected){.name = "query.a.not_run"};
    for (size_t row = 0; row < sizeof rows / sizeof rows[0]; row++) {
        struct gn_expectations expectations = {0};
        struct gn_expectations_changes changes = {0};
        struct gn_results results;
        char error[600], *after = NULL, wanted[1024];
        size_t length = 0;
        gn_results_init(&results);
        results.run.device = (struct gn_device_info){.vendor_id = 1, .device_id = 2, .driver_name = "test"};
        const char *path = write_named("x-fails.txt", rows[row].before);
        if (!gn_expectations_read(&expectations, path, &results.arena, error, sizeof error))
            fail_msg("row %zu: %s", row, error);
        for (size_t i = 0; i < CAME_OUT; i++) {
            struct gn_results_case cs = {.name = came_out[i].name, .status = came_out[i].status, .message = "why # 1\nmore"};
            gn_expectations_apply(&expectations, &cs);
            gn_results_add(&results, &cs);
        }
        assert_true(gn_expectations_update(path, &expectations, &results, catalogue, CAME_OUT + 1, &changes, error,
                                           sizeof error));
        assert_true(gn_file_read(path, 4096, &after, &length, error, sizeof error));
        bool has_device = strstr(rows[row].after, "Device") != NULL;
        snprintf(wanted, sizeof wanted, "%s%s%s", has_device ? "" : device, has_device ? "" : "\n", rows[row].after);
        assert_string_equal(after, wanted);
        if (changes.added != rows[row].added || changes.changed != rows[row].changed ||
            changes.removed != rows[row].removed)
            fail_msg("row %zu: %zu added, %zu changed, %zu removed", row, changes.added, changes.changed,
                     changes.removed);
        /* Once more: nothing is left to do, and every failure is expected. */
        free(after);
        gn_expectations_finish(&expectations);
        if (!gn_expectations_read(&expectations, path, &results.arena, error, sizeof error))
            fail_msg("row %zu: %s", row, error);
        for (size_t i = 0; i < results.count; i++) {
            gn_expectations_apply(&expectations, &results.cases[i]);
            assert_true(results.cases[i].outcome == GN_OUTCOME_AS_EXPECTED ||
                        results.cases[i].outcome == GN_OUTCOME_EXPECTED_FAILURE);
        }
        assert_true(gn_expectations_update(path, &expectations, &results, catalogue, CAME_OUT + 1, &changes, error,
                                           sizeof error));
        assert_true(gn_file_read(path, 4096, &after, &length, error, sizeof error));
        assert_string_equal(after, wanted);
        remove_named(path);
        free(after);
        gn_expectations_finish(&expectations);
        gn_results_finish(&results);
    }
}

/* A link stays a link, and the file that it leads to keeps its mode. */
static void update_through_link(void **state)
{
    char link[200];
    struct gn_expectations expectations = {.device = "0x0001:0x0002 test"};
    struct gn_expectations_changes changes = {0};
    struct gn_results results;
    struct stat info;
    char error[600];
    (void)state;
    gn_results_init(&results);
    const char *path = write_named("x-fails.txt", "query.no.such,Fail\n");
    assert_int_equal(chmod(path, 0640), 0);
    snprintf(link, sizeof link, "%s-link-fails.txt", path);
    assert_int_equal(symlink(path, link), 0);
    assert_true(gn_expectations_update(link, &expectations, &results, NULL, 0, &changes, error, sizeof error));
    assert_int_equal(changes.removed, 1);
    assert_true(lstat(link, &info) == 0 && S_ISLNK(info.st_mode));
    assert_true(stat(path, &info) == 0 && info.st_size == 0 && (info.st_mode & 0777) == 0640);
    unlink(link);
    remove_named(path);
    gn_results_finish(&results);
}

/* What has expired is neither written twice nor made to hold again: it stays, and stays stale. */
static void update_expired(void **state)
{
    static const char content[] = "# device: 0x0001:0x0002 test\n\n# expires: 2020-01-01\nquery.a.crashes,Crash\n";
    struct gn_selected catalogue[] = {{.name = "query.a.crashes"}};
    struct gn_results_case cs = {.name = "query.a.crashes", .status = GN_CASE_CRASH, .message = "why"};
    struct gn_expectations expectations = {.today = "2026-06-15"};
    struct gn_expectations_changes changes = {0};
    struct gn_results results;
    char error[600], *after = NULL;
    size_t length = 0;
    (void)state;
    gn_results_init(&results);
    const char *path = write_named("x-fails.txt", content);
    assert_true(gn_expectations_read(&expectations, path, &results.arena, error, sizeof error));
    gn_expectations_apply(&expectations, &cs);
    assert_int_equal(cs.outcome, GN_OUTCOME_UNEXPECTED);
    gn_results_add(&results, &cs);
    assert_true(gn_expectations_update(path, &expectations, &results, catalogue, 1, &changes, error, sizeof error));
    assert_true(gn_file_read(path, 4096, &after, &length, error, sizeof error));
    assert_string_equal(after, content);
    gn_expectations_check(&expectations, catalogue, 1, &results);
    assert_int_equal(results.stale_count, 1);
    remove_named(path);
    free(after);
    gn_expectations_finish(&expectations);
    gn_results_finish(&results);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(expectation_files), cmocka_unit_test(outcomes), cmocka_unit_test(kinds_and_keys),
        cmocka_unit_test(flakes),            cmocka_unit_test(update),
        cmocka_unit_test(update_expired), cmocka_unit_test(update_through_link), cmocka_unit_test(skipped_by_file), cmocka_unit_test(several_files),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
