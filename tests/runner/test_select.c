/* SPDX-License-Identifier: Apache-2.0 */
/* Filters, shards, drivers by name, expectation files. */
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

#include "cts/driver.h"
#include "cts/select.h"

static void patterns(void **state)
{
    static const struct {
        const char *pattern, *name;
        bool matches;
    } rows[] = {
        {"query.flags.cull_back", "query.flags.cull_back", true},
        {"query.flags.cull_back", "query.flags.cull_back_2", false}, /* a name is not a beginning */
        {"query.flags", "query.flags.cull_back", false},
        {"query.flags.*", "query.flags.cull_back", true},
        {"query.flags.*", "query.flagship.x", false}, /* the dot is a dot */
        {"*", "query.x", true},
        {"*", "", true},
        {"", "", true},
        {"", "x", false},
        {"*back*", "query.flags.cull_back", true},
        {"*a*a*a", "banana", true},
        {"*a*a*a*a", "banana", false},
        {"query.*.two", "query.one.one.two", true}, /* a star crosses dots */
        {"a**b", "ab", true},
        {"?", "x", false}, /* only the star is special */
    };
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        if (gn_pattern_matches(rows[i].pattern, rows[i].name) != rows[i].matches)
            fail_msg("'%s' against '%s': expected %d", rows[i].pattern, rows[i].name, rows[i].matches);
    }
}

static void selection(void **state)
{
    struct gn_arena arena = {0};
    char error[600];
    size_t count = 0;
    (void)state;
    struct gn_selected *all = gn_catalogue(&arena, &count), *some = gn_catalogue(&arena, &count);
    assert_true(count >= 1);
    assert_non_null(gn_catalogue_find(all, count, "query.smoke.quad"));
    assert_null(gn_catalogue_find(all, count, "smoke.quad"));

    const char *twice[] = {"query.smoke.*", "*.quad"};
    size_t kept = gn_select(some, count, twice, 2, error, sizeof error);
    assert_true(kept >= 1 && kept < count);
    assert_string_equal(some[0].self->name + 0, strchr(some[0].name, '.') + 1);
    free(some);

    /* Each case is in one shard, whatever the number of shards. */
    for (uint32_t shards = 2; shards <= 5; shards++) {
        size_t total = 0;
        for (uint32_t shard = 1; shard <= shards; shard++) {
            some = gn_catalogue(&arena, &count);
            total += gn_shard(some, count, shard, shards, NULL);
            free(some);
        }
        assert_int_equal(total, count);
    }

    static const struct {
        const char *filter, *said;
    } typos[] = {{"smoke.quad", "did you mean 'query.smoke.quad'"},
                 {"query.smoke", "did you mean 'query.smoke.*'"},
                 {"query.smoke.quat", "did you mean 'query.smoke.quad'"},
                 {"zzzzzzzzzzzzzzzzzzzzzzzzzzzzz", "--list"}};
    for (size_t i = 0; i < sizeof typos / sizeof typos[0]; i++) {
        some = gn_catalogue(&arena, &count);
        assert_true(gn_select(some, count, &typos[i].filter, 1, error, sizeof error) == SIZE_MAX);
        if (!strstr(error, typos[i].said))
            fail_msg("'%s': expected '%s', found '%s'", typos[i].filter, typos[i].said, error);
        free(some);
    }
    free(all);
    gn_arena_finish(&arena);
}

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

/* By durations the shards take about equally long, each case is in one, and the order of the file does not matter. */
static void balanced_shards(void **state)
{
    enum { COUNT = 100, SHARDS = 4 };
    struct gn_arena arena = {0};
    struct gn_selected cases[COUNT], some[COUNT];
    struct gn_results durations[2];
    double total = 0;
    (void)state;
    gn_results_init(&durations[0]);
    gn_results_init(&durations[1]);
    for (int i = 0; i < COUNT; i++) {
        cases[i] = (struct gn_selected){.name = gn_arena_printf(&arena, "query.case.%d", i)};
        total += i % 10 == 9 ? 3 : 0.01 * i;
    }
    for (int i = 0; i < COUNT; i++) {
        for (int k = 0; k < 2; k++) {
            int j = k ? COUNT - 1 - i : i;
            struct gn_results_case cs = {.name = cases[j].name, .seconds = j % 10 == 9 ? 3 : 0.01 * j};
            gn_results_add(&durations[k], &cs);
        }
    }
    size_t seen = 0;
    for (uint32_t shard = 1; shard <= SHARDS; shard++) {
        double seconds = 0;
        memcpy(some, cases, sizeof cases);
        size_t kept = gn_shard(some, COUNT, shard, SHARDS, &durations[0]);
        struct gn_selected again[COUNT];
        memcpy(again, cases, sizeof cases);
        assert_int_equal(gn_shard(again, COUNT, shard, SHARDS, &durations[1]), kept);
        for (size_t i = 0; i < kept; i++) {
            int number = atoi(strrchr(some[i].name, '.') + 1);
            assert_ptr_equal(some[i].name, again[i].name);
            seconds += number % 10 == 9 ? 3 : 0.01 * number;
        }
        seen += kept;
        if (seconds < 0.9 * total / SHARDS || seconds > 1.1 * total / SHARDS)
            fail_msg("shard %u takes %g s of %g", shard, seconds, total);
    }
    assert_int_equal(seen, COUNT);
    /* Of cases nothing is known: shards of about equal numbers. */
    struct gn_results none;
    gn_results_init(&none);
    memcpy(some, cases, sizeof cases);
    assert_int_equal(gn_shard(some, COUNT, 1, SHARDS, &none), COUNT / SHARDS);
    gn_results_finish(&durations[0]);
    gn_results_finish(&durations[1]);
    gn_arena_finish(&arena);
}

static void drivers(void **state)
{
    struct gn_arena arena = {0};
    char error[600];
    (void)state;
    assert_null(gn_driver_resolve("nvidia", &arena, error, sizeof error));
    assert_non_null(strstr(error, "no driver is named 'nvidia'"));
    assert_null(gn_driver_resolve("/nowhere/icd.json", &arena, error, sizeof error));
    assert_non_null(strstr(error, "/nowhere/icd.json: No such file"));
    assert_null(gn_driver_resolve("/tmp/", &arena, error, sizeof error));        /* a folder */
    const char *path = write_temporary("{\"ICD\": {\"api_version\": \"1.3\"}}"); /* no library */
    assert_null(gn_driver_resolve(path, &arena, error, sizeof error));
    assert_non_null(strstr(error, "is not a Vulkan driver's ICD file"));
    unlink(path);
    path = write_temporary("{\"ICD\": {\"library_path\": \"libx.so\"}}");
    const char *resolved = gn_driver_resolve(path, &arena, error, sizeof error);
    assert_non_null(resolved);
    assert_int_equal(resolved[0], '/');
    unlink(path);
    setenv("GNOMON_LAVAPIPE_ICD", "/nowhere/lvp.json", 1);
    assert_null(gn_driver_resolve("lavapipe", &arena, error, sizeof error));
    assert_non_null(strstr(error, "/nowhere/lvp.json"));
    unsetenv("GNOMON_LAVAPIPE_ICD");
    setenv("VK_DRIVER_FILES", "/some/icd.json", 1);
    assert_string_equal(gn_driver_resolve(NULL, &arena, error, sizeof error), "");
    unsetenv("VK_DRIVER_FILES");
    gn_arena_finish(&arena);
}

/* A driver in a folder of its own is found by name, and started with the dynamic loader that lies there. */
static void drivers_in_roots(void **state)
{
    static const char *const folders[] = {"", "/sid", "/sid/icd.d", "/sid/root", "/sid/root/usr", "/sid/root/usr/lib",
                                          "/sid/root/usr/lib/x86_64-linux-gnu"};
    static const struct {
        const char *path, *text;
    } files[] = {{"/sid/icd.d/lvp_icd.x86_64.json", "{\"ICD\": {\"library_path\": \"/x/libvulkan_lvp.so\"}}"},
                 {"/sid/root/usr/lib/x86_64-linux-gnu/ld-linux-x86-64.so.2", "no loader"}};
    struct gn_arena arena = {0};
    char base[] = "/tmp/gnomon-test-XXXXXX", error[600], path[256];
    (void)state;
    assert_non_null(mkdtemp(base));
    for (size_t i = 1; i < sizeof folders / sizeof folders[0]; i++) {
        snprintf(path, sizeof path, "%s%s", base, folders[i]);
        assert_int_equal(mkdir(path, 0777), 0);
    }
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
        snprintf(path, sizeof path, "%s%s", base, files[i].path);
        assert_true(gn_file_write(path, files[i].text, strlen(files[i].text), error, sizeof error));
    }
    setenv("GNOMON_DRIVERS", base, 1);
    assert_null(gn_driver_resolve("nosuch", &arena, error, sizeof error));
    assert_null(gn_driver_resolve("..", &arena, error, sizeof error));
    const char *icd = gn_driver_resolve("sid", &arena, error, sizeof error);
    assert_non_null(icd);
    struct gn_driver_loader loader = gn_driver_loader(icd, &arena);
    snprintf(path, sizeof path, "%s%s", base, files[1].path);
    assert_string_equal(loader.loader, path);
    assert_memory_equal(loader.libraries, path, strlen(base) + strlen(folders[6]));
    assert_null(gn_driver_loader("/usr/share/vulkan/icd.d/lvp_icd.json", &arena).loader);
    unsetenv("GNOMON_DRIVERS");
    assert_null(gn_driver_loader(icd, &arena).loader);
    for (size_t i = sizeof files / sizeof files[0]; i-- > 0;) {
        snprintf(path, sizeof path, "%s%s", base, files[i].path);
        unlink(path);
    }
    for (size_t i = sizeof folders / sizeof folders[0]; i-- > 0;) {
        snprintf(path, sizeof path, "%s%s", base, folders[i]);
        assert_int_equal(rmdir(path), 0);
    }
    gn_arena_finish(&arena);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(patterns),
        cmocka_unit_test(selection),
        cmocka_unit_test(balanced_shards),
        cmocka_unit_test(drivers),
        cmocka_unit_test(drivers_in_roots),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
