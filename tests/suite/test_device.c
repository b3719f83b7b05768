/* SPDX-License-Identifier: Apache-2.0 */
/* Opening a device, and what is said when there is none to open. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "cts/device_internal.h"

static const char *icd(void)
{
    const char *path = getenv("GNOMON_TEST_ICD");
    return path && *path ? path : NULL;
}

struct refusal {
    const char *name;
    const char *text; /* of the ICD file; NULL: there is none */
    const char *expected; /* part of the message */
};

static const struct refusal refusals[] = {
    {"no file", NULL, "no such ICD file: "},
    {"not JSON", "{\"ICD\": ", "is not readable JSON: "},
    {"empty", "", "is not readable JSON: "},
    {"binary", "\x7f" "ELF\1\1", "is not readable JSON: "},
    {"another object", "{\"layer\": {\"library_path\": \"x\"}}", "expected a string at ICD.library_path"},
    {"a number for a path", "{\"ICD\": {\"library_path\": 1}}", "expected a string at ICD.library_path"},
    {"a library beside it that is not there", "{\"ICD\": {\"library_path\": \"./none.so\", \"api_version\": \"1.3.0\"}}",
     "names a driver library that is not there: "},
    {"a library elsewhere that is not there", "{\"ICD\": {\"library_path\": \"/none/none.so\"}}",
     "names a driver library that is not there: /none/none.so"},
    {"a library that no linker finds",
     "{\"file_format_version\": \"1.0.0\", \"ICD\": {\"library_path\": \"libgnomon_none.so\", \"api_version\": \"1.3.0\"}}",
     "cannot use the driver of "},
    {"a library that is no driver",
     "{\"file_format_version\": \"1.0.0\", \"ICD\": {\"library_path\": \"libm.so.6\", \"api_version\": \"1.3.0\"}}",
     "cannot use the driver of "},
};

static void bad_icd_files_are_refused_in_words(void **state)
{
    (void)state;
    char folder[] = "/tmp/gnomon-icd-XXXXXX";
    assert_non_null(mkdtemp(folder));
    char path[256];
    snprintf(path, sizeof path, "%s/driver.json", folder);
    for (size_t i = 0; i < sizeof refusals / sizeof refusals[0]; i++) {
        const struct refusal *refusal = &refusals[i];
        if (refusal->text) {
            FILE *file = fopen(path, "w");
            assert_non_null(file);
            fputs(refusal->text, file);
            assert_int_equal(fclose(file), 0);
        }
        const struct gn_device_options options = {.icd = path, .index = -1};
        char error[1024] = "";
        struct gn_device *device = gn_device_create(&options, error, sizeof error);
        if (device || !strstr(error, refusal->expected)) {
            print_error("%s: expected \"%s\", found \"%s\"\n", refusal->name, refusal->expected, error);
        }
        assert_null(device);
        assert_non_null(strstr(error, refusal->expected));
        if (refusal->text) {
            assert_non_null(strstr(error, path)); /* which file it was */
        }
        unlink(path);
    }
    rmdir(folder);
}

static void a_device_says_what_it_is(void **state)
{
    (void)state;
    const struct gn_device_options options = {.icd = icd(), .index = -1};
    char error[1024] = "x";
    struct gn_device *device = gn_device_create(&options, error, sizeof error);
    if (!device) {
        print_error("%s\n", error);
    }
    assert_non_null(device);
    assert_string_equal(error, "");
    const struct gn_device_info *info = gn_device_info(device);
    assert_true(strlen(info->name) > 0);
    assert_true(strlen(info->driver_name) > 0);
    assert_true(info->api_version >= VK_API_VERSION_1_2);
    assert_true(info->ray_query);
    assert_true(info->limits.maxPrimitiveCount >= (1u << 24) - 1); /* the limit that every driver has to reach */
    assert_null(info->limits.pNext);
    /* The formats that every implementation takes; the last is one that none does. */
    static const VkFormat required[] = {
        VK_FORMAT_UNDEFINED,          VK_FORMAT_R32G32_SFLOAT,       VK_FORMAT_R32G32B32_SFLOAT, VK_FORMAT_R16G16_SFLOAT,
        VK_FORMAT_R16G16B16A16_SFLOAT, VK_FORMAT_R16G16_SNORM,       VK_FORMAT_R16G16B16A16_SNORM,
    };
    for (size_t i = 0; i < sizeof required / sizeof required[0]; i++) {
        assert_true(gn_device_has_vertex_format(device, required[i]));
    }
    assert_false(gn_device_has_vertex_format(device, VK_FORMAT_D32_SFLOAT));
    gn_device_destroy(device);
    gn_device_destroy(NULL);
}

static void the_number_of_a_device_counts(void **state)
{
    (void)state;
    char error[1024];
    struct gn_device_options options = {.icd = icd(), .index = 0};
    struct gn_device *device = gn_device_create(&options, error, sizeof error);
    assert_non_null(device);
    char name[256];
    snprintf(name, sizeof name, "%s", gn_device_info(device)->name);
    gn_device_destroy(device);
    options.index = 40;
    assert_null(gn_device_create(&options, error, sizeof error));
    assert_non_null(strstr(error, "no device number 40"));
    assert_non_null(strstr(error, name)); /* those there are get named */
}

/* The loader's variable is borrowed, not changed. */
static void the_environment_stays_as_it_was(void **state)
{
    (void)state;
    const struct gn_device_options options = {.icd = icd(), .index = -1};
    char error[1024];
    if (!options.icd) {
        print_message("skipped: GNOMON_TEST_ICD names no ICD file\n");
        skip();
    }
    setenv("VK_DRIVER_FILES", "/none/such.json", 1);
    struct gn_device *device = gn_device_create(&options, error, sizeof error);
    assert_non_null(device);
    assert_string_equal(getenv("VK_DRIVER_FILES"), "/none/such.json");
    gn_device_destroy(device);
    const struct gn_device_options none = {.icd = NULL, .index = -1};
    assert_null(gn_device_create(&none, error, sizeof error)); /* the variable is the user's word then */
    assert_non_null(strstr(error, "found no driver that it can use"));
    unsetenv("VK_DRIVER_FILES");
    device = gn_device_create(&options, error, sizeof error);
    assert_non_null(device);
    assert_null(getenv("VK_DRIVER_FILES"));
    gn_device_destroy(device);
}

static void pools_keep_pieces_apart(void **state)
{
    (void)state;
    const struct gn_device_options options = {.icd = icd(), .index = -1};
    char error[1024];
    struct gn_device *device = gn_device_create(&options, error, sizeof error);
    assert_non_null(device);
    struct gn_pool pool = {.kind = GN_MEMORY_HOST};
    static const VkDeviceSize sizes[] = {0, 1, 16, 1000, 3, 1 << 20, 5, 7u << 20, 9, 256, 100000};
    enum { COUNT = sizeof sizes / sizeof sizes[0] };
    struct gn_memory pieces[COUNT * 3];
    for (size_t i = 0; i < COUNT * 3; i++) {
        const VkDeviceSize alignment = (VkDeviceSize)1 << (i % 9);
        assert_int_equal(gn_pool_take(device, &pool, sizes[i % COUNT], alignment, &pieces[i]), GN_DEVICE_OK);
        assert_true(pieces[i].size >= sizes[i % COUNT] && pieces[i].size > 0 && pieces[i].size % 4 == 0);
        assert_true(pieces[i].address % alignment == 0);
        assert_non_null(pieces[i].mapped);
        memset(pieces[i].mapped, (int)i + 1, pieces[i].size);
    }
    for (size_t i = 0; i < COUNT * 3; i++) {
        for (VkDeviceSize k = 0; k < pieces[i].size; k++) {
            assert_int_equal(pieces[i].mapped[k], (int)i + 1);
        }
    }
    gn_pool_poison(&pool);
    assert_int_equal(pieces[0].mapped[0], 0xFF);
    struct gn_memory piece;
    assert_int_equal(gn_pool_take(device, &pool, UINT64_MAX - 4, 16, &piece), GN_DEVICE_UNSUPPORTED);
    assert_int_equal(gn_pool_take(device, &pool, (VkDeviceSize)1 << 60, 16, &piece), GN_DEVICE_UNSUPPORTED);
    assert_true(strlen(gn_device_message(device)) > 0);
    gn_pool_finish(device, &pool);
    gn_device_destroy(device);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bad_icd_files_are_refused_in_words),
        cmocka_unit_test(a_device_says_what_it_is),
        cmocka_unit_test(the_number_of_a_device_counts),
        cmocka_unit_test(the_environment_stays_as_it_was),
        cmocka_unit_test(pools_keep_pieces_apart),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
