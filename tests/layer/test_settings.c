/* SPDX-License-Identifier: Apache-2.0 */
/* Settings: kept once, found in all three sources, each with an effect, and a clear word about what is wrong. */
#include "tests/layer/harness.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <yyjson.h>

#define PREFIX "VK_GNOMON_RAY_TRACING_"

static const struct definition {
    const char *key, *env, *type, *value, *label, *description;
} definitions[] = {
#define GN_SETTING(field, ENV, TYPE, value, label, description) {#field, PREFIX #ENV, #TYPE, value, label, description},
#include "layer/settings.def"
#undef GN_SETTING
};

#define DEFINITION_COUNT (sizeof definitions / sizeof definitions[0])

static char folder[64];

static const char *in_folder(const char *name)
{
    static char path[256];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

static void write_settings(const char *text)
{
    FILE *file = fopen(in_folder("vk_layer_settings.txt"), "w");
    assert_non_null(file);
    fputs(text, file);
    fclose(file);
    setenv("VK_LAYER_SETTINGS_PATH", folder, 1);
}

/* Every test starts without any setting. The working folder is searched for the file as well. */
static int clean(void **state)
{
    (void)state;
    unsetenv("VK_LAYER_SETTINGS_PATH");
    unlink("vk_layer_settings.txt");
    for (size_t i = 0; i < DEFINITION_COUNT; i++)
        unsetenv(definitions[i].env);
    unsetenv(PREFIX "COLOUR");
    setenv(PREFIX "REPORT_STDERR", "false", 1);
    return 0;
}

/* A world in which a TLAS refers to a BLAS that was never built, twice. Returns how many findings were reported; the
 * messages stay in `world`. */
static uint32_t misbehave(struct world *world, const VkLayerSettingEXT *settings, uint32_t count)
{
    struct world_options options = {.creation_messenger = true, .settings = settings, .setting_count = count};
    world_init(world, &options);
    struct structure blas = blas_create(world, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, 0);
    struct structure tlas = tlas_create(world, 2);
    tlas_refer(&tlas, 1, blas.address);
    tlas_instance(&tlas, 1)->instanceCustomIndex = 7;
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_build_one(world, commands, &tlas);
    commands_end(commands);
    submit_and_wait(world, commands);
    structure_destroy(world, &tlas);
    structure_destroy(world, &blas);
    world_finish(world);
    return messages_count(world, NEVER_BUILT);
}

static bool warned(const struct world *world, const char *text)
{
    for (uint32_t i = 0; i < world->messages.count && i < 64; i++)
        if (strcmp(world->messages.list[i].id, "settings") == 0 && strstr(world->messages.list[i].text, text))
            return true;
    return false;
}

static bool default_agrees(const struct definition *definition, yyjson_val *value)
{
    char text[64];
    if (yyjson_is_bool(value))
        return strcmp(definition->value, yyjson_get_bool(value) ? "true" : "false") == 0;
    if (yyjson_is_arr(value))
        return !*definition->value && yyjson_arr_size(value) == 0;
    if (yyjson_is_int(value)) {
        snprintf(text, sizeof text, "%lld", (long long)yyjson_get_sint(value));
        return strcmp(definition->value, text) == 0;
    }
    return yyjson_equals_str(value, definition->value);
}

static bool field_is(yyjson_val *setting, const char *field, const char *expected)
{
    const char *found = yyjson_get_str(yyjson_obj_get(setting, field));
    if (found && strcmp(found, expected) == 0)
        return true;
    print_error("manifest.json, %s: expected \"%s\", found \"%s\"\n", field, expected, found ? found : "(nothing)");
    return false;
}

static void manifest_repeats_the_definitions(void **state)
{
    (void)state;
    char *text = file_read(MANIFEST);
    assert_non_null(text);
    yyjson_doc *document = yyjson_read(text, strlen(text), 0);
    assert_non_null(document);
    yyjson_val *layer = yyjson_obj_get(yyjson_doc_get_root(document), "layer");
    yyjson_val *settings = yyjson_obj_get(yyjson_obj_get(layer, "features"), "settings");
    int failures = !field_is(layer, "name", "VK_LAYER_GNOMON_ray_tracing");
    assert_int_equal(yyjson_arr_size(settings), DEFINITION_COUNT);
    for (size_t i = 0; i < DEFINITION_COUNT; i++) {
        const struct definition *definition = &definitions[i];
        yyjson_val *setting = yyjson_arr_get(settings, i);
        failures += !field_is(setting, "key", definition->key);
        failures += !field_is(setting, "env", definition->env);
        failures += !field_is(setting, "type", definition->type);
        failures += !field_is(setting, "label", definition->label);
        failures += !field_is(setting, "description", definition->description);
        if (!default_agrees(definition, yyjson_obj_get(setting, "default"))) {
            print_error("manifest.json, %s: the default is not \"%s\"\n", definition->key, definition->value);
            failures++;
        }
    }
    yyjson_doc_free(document);
    free(text);
    assert_int_equal(failures, 0);
}

static void the_built_manifest_is_the_source_with_a_path(void **state)
{
    (void)state;
    char *texts[2] = {file_read(MANIFEST), file_read(BUILT_MANIFEST)};
    yyjson_mut_doc *documents[2];
    for (int i = 0; i < 2; i++) {
        assert_non_null(texts[i]);
        yyjson_doc *document = yyjson_read(texts[i], strlen(texts[i]), 0);
        assert_non_null(document);
        documents[i] = yyjson_doc_mut_copy(document, NULL);
        yyjson_doc_free(document);
        yyjson_mut_val *layer = yyjson_mut_obj_get(yyjson_mut_doc_get_root(documents[i]), "layer");
        yyjson_mut_val *path = yyjson_mut_obj_remove_key(layer, "library_path");
        assert_non_null(strstr(yyjson_mut_get_str(path), "libVkLayer_gnomon_ray_tracing.so"));
        free(texts[i]);
    }
    assert_true(yyjson_mut_equals(yyjson_mut_doc_get_root(documents[0]), yyjson_mut_doc_get_root(documents[1])));
    yyjson_mut_doc_free(documents[0]);
    yyjson_mut_doc_free(documents[1]);
}

static void the_manual_names_every_setting(void **state)
{
    (void)state;
    char *manual = file_read(MANUAL);
    assert_non_null(manual);
    for (size_t i = 0; i < DEFINITION_COUNT; i++) {
        const struct definition *definition = &definitions[i];
        char row[512];
        snprintf(row, sizeof row, "| `%s` | `%s` | `%s` | %s |", definition->key, definition->env,
                 *definition->value ? definition->value : " ", definition->description);
        if (!strstr(manual, row))
            fail_msg("docs/layer.md lacks the row: %s", row);
    }
    free(manual);
}

static void defaults(void **state)
{
    (void)state;
    struct world *world = calloc(1, sizeof *world);
    assert_int_equal(misbehave(world, NULL, 0), 1);
    assert_int_equal(messages_count(world, "settings"), 0);
    assert_int_equal(messages_count(world, "statement"), 1);
    free(world);
}

static void each_source_is_read(void **state)
{
    (void)state;
    struct world *world = calloc(1, sizeof *world);
    write_settings("gnomon_ray_tracing.disable_rules = build.*\n");
    assert_int_equal(misbehave(world, NULL, 0), 0);
    clean(NULL);
    setenv(PREFIX "DISABLE_RULES", "build.*", 1);
    assert_int_equal(misbehave(world, NULL, 0), 0);
    clean(NULL);
    const char *pattern = "build.*";
    VkLayerSettingEXT passed = {"VK_LAYER_GNOMON_ray_tracing", "disable_rules", VK_LAYER_SETTING_TYPE_STRING_EXT, 1, &pattern};
    assert_int_equal(misbehave(world, &passed, 1), 0);
    /* A setting of another layer is not ours. */
    passed.pLayerName = "VK_LAYER_OTHER";
    assert_int_equal(misbehave(world, &passed, 1), 1);
    free(world);
}

/* As docs/layer.md says: the environment, then the file, then what the application passes. */
static void precedence(void **state)
{
    (void)state;
    struct world *world = calloc(1, sizeof *world);
    const char *none = "nothing.*";
    VkLayerSettingEXT passed = {"VK_LAYER_GNOMON_ray_tracing", "disable_rules", VK_LAYER_SETTING_TYPE_STRING_EXT, 1, &none};
    write_settings("gnomon_ray_tracing.disable_rules = build.*\n");
    assert_int_equal(misbehave(world, &passed, 1), 0);
    setenv(PREFIX "DISABLE_RULES", "nothing.*", 1);
    assert_int_equal(misbehave(world, NULL, 0), 1);
    free(world);
}

static void enabled_rules(void **state)
{
    static const struct {
        const char *enable, *disable;
        uint32_t findings;
    } table[] = {
        {"build.order.blas_never_built", "", 1},
        {"*", "", 1},
        {"*", "*never_built", 0},
        {"build.*,other.*", "", 1},
        {"other.*", "", 0},
    };
    (void)state;
    struct world *world = calloc(1, sizeof *world);
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        clean(NULL);
        setenv(PREFIX "ENABLE_RULES", table[i].enable, 1);
        if (*table[i].disable)
            setenv(PREFIX "DISABLE_RULES", table[i].disable, 1);
        uint32_t findings = misbehave(world, NULL, 0);
        if (findings != table[i].findings)
            fail_msg("enabled \"%s\", disabled \"%s\": expected %u findings, found %u", table[i].enable, table[i].disable,
                     table[i].findings, findings);
    }
    assert_true(warned(world, "enable_rules: \"other.*\" matches no rule"));
    free(world);
}

/* The active instance has mask 0xFF and custom index 7. */
static void declarations(void **state)
{
    static const struct {
        const char *key, *value, *rule;
        uint32_t findings;
        const char *warning;
    } table[] = {
        {"DECLARED_MASKS", "1,0x02", "instances.mask_undeclared", 1, NULL},
        {"DECLARED_MASKS", "1,0xFF", "instances.mask_undeclared", 0, NULL},
        {"DECLARED_MASKS", "", "instances.mask_undeclared", 0, NULL},
        {"DECLARED_MASKS", "1,256", "instances.mask_undeclared", 0, "expected numbers from 0 to 255 or 0xFF, found \"256\""},
        {"DECLARED_MASKS", "one", "instances.mask_undeclared", 0, "found \"one\""},
        {"CUSTOM_INDEX_BOUND", "7", "instances.custom_index_bound", 1, NULL},
        {"CUSTOM_INDEX_BOUND", "8", "instances.custom_index_bound", 0, NULL},
        {"CUSTOM_INDEX_BOUND", "0", "instances.custom_index_bound", 0, NULL},
        {"CUSTOM_INDEX_BOUND", "many", "instances.custom_index_bound", 0, "found \"many\""},
    };
    (void)state;
    struct world *world = calloc(1, sizeof *world);
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        char name[128];
        clean(NULL);
        snprintf(name, sizeof name, PREFIX "%s", table[i].key);
        setenv(name, table[i].value, 1);
        misbehave(world, NULL, 0);
        uint32_t findings = messages_count(world, table[i].rule);
        bool said = table[i].warning ? warned(world, table[i].warning) : messages_count(world, "settings") == 0;
        unsetenv(name);
        if (findings != table[i].findings || !said)
            fail_msg("%s=%s: expected %u findings and \"%s\", found %u", table[i].key, table[i].value, table[i].findings,
                     table[i].warning ? table[i].warning : "", findings);
    }
    free(world);
}

static void every_profile_is_known(void **state)
{
    (void)state;
    static const char *const profiles[] = {"vulkan", "wgpu", "webgpu-rt", "diligent", "hgi"};
    struct world *world = calloc(1, sizeof *world);
    for (size_t i = 0; i < sizeof profiles / sizeof profiles[0]; i++) {
        char expected[64];
        setenv(PREFIX "PROFILE", profiles[i], 1);
        setenv(PREFIX "LOG_FILE", in_folder("profile.jsonl"), 1);
        assert_int_equal(misbehave(world, NULL, 0), 1);
        assert_int_equal(messages_count(world, "settings"), 0);
        char *log = file_read(in_folder("profile.jsonl"));
        assert_non_null(log);
        snprintf(expected, sizeof expected, "{\"statement\":{\"profile\":\"%s\"", profiles[i]);
        assert_non_null(strstr(log, expected));
        free(log);
    }
    free(world);
}

static void severity_floor(void **state)
{
    (void)state;
    struct world *world = calloc(1, sizeof *world);
    setenv(PREFIX "SEVERITY_FLOOR", "error", 1);
    assert_int_equal(misbehave(world, NULL, 0), 1);
    assert_int_equal(messages_count(world, "statement"), 0);
    setenv(PREFIX "SEVERITY_FLOOR", "note", 1);
    assert_int_equal(misbehave(world, NULL, 0), 1);
    assert_int_equal(messages_count(world, "statement"), 1);
    free(world);
}

static void instance_cap(void **state)
{
    (void)state;
    struct world *world = calloc(1, sizeof *world);
    int32_t cap = 1;
    VkLayerSettingEXT passed = {"VK_LAYER_GNOMON_ray_tracing", "instance_cap", VK_LAYER_SETTING_TYPE_INT32_EXT, 1, &cap};
    assert_int_equal(misbehave(world, &passed, 1), 0);
    const struct message *statement = messages_find(world, "statement");
    assert_non_null(statement);
    assert_non_null(strstr(statement->text, "1 instances beyond instance_cap"));
    cap = 2;
    assert_int_equal(misbehave(world, &passed, 1), 1);
    free(world);
}

static void stderr_on_and_off(void **state)
{
    (void)state;
    struct world *world = calloc(1, sizeof *world);
    for (int on = 0; on < 2; on++) {
        VkBool32 value = on ? VK_TRUE : VK_FALSE;
        VkLayerSettingEXT passed = {"VK_LAYER_GNOMON_ray_tracing", "report_stderr", VK_LAYER_SETTING_TYPE_BOOL32_EXT, 1, &value};
        unsetenv(PREFIX "REPORT_STDERR");
        fflush(stderr);
        int saved = dup(2);
        assert_non_null(freopen(in_folder("stderr.txt"), "w", stderr));
        uint32_t findings = misbehave(world, &passed, 1);
        fflush(stderr);
        dup2(saved, 2);
        close(saved);
        char *said = file_read(in_folder("stderr.txt"));
        assert_non_null(said);
        bool error = strstr(said, "gnomon: error: build.order.blas_never_built: instance 1 of 2") != NULL;
        bool statement = strstr(said, "gnomon: note: statement: ") != NULL;
        free(said);
        assert_int_equal(findings, 1);
        assert_int_equal(error, on);
        assert_int_equal(statement, on);
    }
    free(world);
}

static void bad_values_are_named(void **state)
{
    static const struct {
        const char *env, *value, *warning;
    } table[] = {
        {PREFIX "PROFILE", "metal", "profile: expected vulkan, wgpu, webgpu-rt, diligent or hgi, found \"metal\""},
        {PREFIX "SEVERITY_FLOOR", "fatal", "severity_floor: expected note, warning or error, found \"fatal\""},
        {PREFIX "INSTANCE_CAP", "-1", "instance_cap: expected a whole number"},
        {PREFIX "INSTANCE_CAP", "4294967296", "instance_cap: expected a whole number"},
        {PREFIX "INSTANCE_CAP", "12k", "instance_cap: expected a whole number"},
        {PREFIX "REPORT_STDERR", "maybe", "report_stderr: expected true or false, found \"maybe\""},
        {PREFIX "PROFILE", "vulkan,wgpu", "profile: expected one value, found 2"},
        {PREFIX "LOG_FILE", "/dev/null/log.jsonl", "log_file: cannot write \"/dev/null/log.jsonl\""},
        {PREFIX "SHADER_CACHE", "/dev/null/cache", "shader_cache: cannot keep files in \"/dev/null/cache\": Not a directory"},
        {PREFIX "COLOUR", "blue", "\"" PREFIX "COLOUR\" in the environment is not a setting"},
    };
    (void)state;
    struct world *world = calloc(1, sizeof *world);
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        clean(NULL);
        setenv(table[i].env, table[i].value, 1);
        uint32_t findings = misbehave(world, NULL, 0);
        if (findings != 1 || !warned(world, table[i].warning) || messages_count(world, "settings") != 1)
            fail_msg("%s=%s: expected the defaults and one warning \"%s\"; found %u findings, %u warnings, the first \"%s\"",
                     table[i].env, table[i].value, table[i].warning, findings, messages_count(world, "settings"),
                     messages_find(world, "settings") ? messages_find(world, "settings")->text : "");
    }
    free(world);
}

static void unknown_keys_are_named(void **state)
{
    (void)state;
    struct world *world = calloc(1, sizeof *world);
    int32_t one = 1;
    VkLayerSettingEXT passed = {"VK_LAYER_GNOMON_ray_tracing", "volume", VK_LAYER_SETTING_TYPE_INT32_EXT, 1, &one};
    write_settings("# a comment\ngnomon_ray_tracing.profil = wgpu\nkhronos_validation.other = 1\n");
    setenv(PREFIX "LOG_FILE", in_folder("unknown.jsonl"), 1);
    misbehave(world, &passed, 1);
    char *log = file_read(in_folder("unknown.jsonl"));
    assert_non_null(log);
    assert_non_null(strstr(log, "\"rule\":\"settings\",\"severity\":\"warning\",\"count\":1,\"message\":\"\\\"gnomon_ray_tracing.profil"));
    free(log);
    assert_true(warned(world, "\"gnomon_ray_tracing.profil\" in vk_layer_settings.txt is not a setting"));
    assert_true(warned(world, "\"volume\" passed by VK_EXT_layer_settings is not a setting"));
    assert_int_equal(messages_count(world, "settings"), 2);
    free(world);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(manifest_repeats_the_definitions),
        cmocka_unit_test(the_built_manifest_is_the_source_with_a_path),
        cmocka_unit_test(the_manual_names_every_setting),
        cmocka_unit_test_setup(defaults, clean),
        cmocka_unit_test_setup(each_source_is_read, clean),
        cmocka_unit_test_setup(precedence, clean),
        cmocka_unit_test_setup(enabled_rules, clean),
        cmocka_unit_test_setup(declarations, clean),
        cmocka_unit_test_setup(every_profile_is_known, clean),
        cmocka_unit_test_setup(severity_floor, clean),
        cmocka_unit_test_setup(instance_cap, clean),
        cmocka_unit_test_setup(stderr_on_and_off, clean),
        cmocka_unit_test_setup(bad_values_are_named, clean),
        cmocka_unit_test_setup(unknown_keys_are_named, clean),
    };
    strcpy(folder, "/tmp/gnomon-settings-XXXXXX");
    if (!mkdtemp(folder) || chdir(folder) != 0)
        return 3;
    int failed = cmocka_run_group_tests_name("settings", tests, NULL, NULL);
    unlink(in_folder("vk_layer_settings.txt"));
    unlink(in_folder("profile.jsonl"));
    unlink(in_folder("stderr.txt"));
    rmdir(folder);
    return failed;
}
