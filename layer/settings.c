/* SPDX-License-Identifier: Apache-2.0 */
/* Settings, through the layer-settings library that Khronos' layers use. Every value is asked for as text and parsed here, so
 * that one message fits all sources; what the library does not check (unknown keys in the file and in the environment)
 * is checked here too. */
#include "layer/settings.h"

#include "checks/spirv/spirv.h"

#include <errno.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>
#include <vulkan/layer/vk_layer_settings.h>

extern char **environ;

struct setting {
    const char *key, *env;
};

static const struct setting settings_known[] = {
#define GN_SETTING(field, ENV, TYPE, value, label, description) {#field, GN_SETTINGS_ENV_PREFIX #ENV},
#include "layer/settings.def"
#undef GN_SETTING
};

#define KNOWN_COUNT (sizeof settings_known / sizeof settings_known[0])

__attribute__((format(printf, 2, 3))) static void warn(struct gn_settings *settings, const char *format, ...)
{
    char *text = NULL;
    va_list arguments;
    va_start(arguments, format);
    int size = vasprintf(&text, format, arguments);
    va_end(arguments);
    if (size < 0)
        return;
    char **grown = realloc(settings->warnings, (settings->warning_count + 1) * sizeof *grown);
    if (!grown) {
        free(text);
        return;
    }
    settings->warnings = grown;
    grown[settings->warning_count++] = text;
}

static bool parse_bool(const char *text, bool *out)
{
    static const char *const yes[] = {"true", "1", "on", "yes"}, *const no[] = {"false", "0", "off", "no"};
    for (size_t i = 0; i < 4; i++) {
        if (strcasecmp(text, yes[i]) == 0)
            return *out = true;
        if (strcasecmp(text, no[i]) == 0) {
            *out = false;
            return true;
        }
    }
    return false;
}

static bool parse_count(const char *text, uint32_t *out)
{
    char *end;
    errno = 0;
    long long value = strtoll(text, &end, 10);
    if (errno || end == text || *end || value < 0 || value > UINT32_MAX)
        return false;
    *out = (uint32_t)value;
    return true;
}

static bool parse_signal(const char *text, int *out)
{
    static const struct {
        const char *name;
        int number;
    } signals[] = {{"none", 0}, {"USR1", SIGUSR1}, {"USR2", SIGUSR2}};
    for (size_t i = 0; i < sizeof signals / sizeof signals[0]; i++)
        if (strcmp(signals[i].name, text) == 0) {
            *out = signals[i].number;
            return true;
        }
    return false;
}

static void put_masks(struct gn_settings *out, const char *const *values, uint32_t count)
{
    bool declared = false;
    uint64_t masks[4] = {0};
    for (uint32_t i = 0; i < count; i++) {
        const char *text = values[i];
        char *end;
        if (!*text)
            continue;
        unsigned long mask = strtoul(text, &end, 0);
        if (*text < '0' || *text > '9' || *end || mask > 0xFF) {
            warn(out, "declared_masks: expected numbers from 0 to 255 or 0xFF, found \"%s\". No mask is declared.", text);
            return;
        }
        masks[mask / 64] |= UINT64_C(1) << (mask % 64);
        declared = true;
    }
    memcpy(out->declared_masks, masks, sizeof masks);
    out->masks_declared = declared;
}

static char *parse_path(const char *text)
{
    const char *mark = strstr(text, "%p");
    char *path = NULL;
    if (!mark)
        return strdup(text);
    return asprintf(&path, "%.*s%ld%s", (int)(mark - text), text, (long)getpid(), mark + 2) < 0 ? NULL : path;
}

/* All matching rules on or off; a pattern that matches none is a mistake worth saying. */
static void put_rules(struct gn_settings *out, const char *key, const char *const *patterns, uint32_t count, bool on)
{
    for (uint32_t p = 0; p < count; p++) {
        bool matched = false;
        if (!*patterns[p])
            continue;
        for (size_t i = 0; i < gn_rules_count(); i++)
            if (gn_rule_matches(gn_rules_at(i), patterns[p])) {
                gn_rule_set_put(&out->rules, i, on);
                matched = true;
            }
        for (int i = 0; i < GN_SPIRV_RULE_COUNT; i++)
            if (gn_rule_matches(&(struct gn_rule){.id = gn_spirv_rule_at((enum gn_spirv_rule_index)i)->id}, patterns[p])) {
                out->shader_rules_off = on ? out->shader_rules_off & ~(UINT64_C(1) << i) : out->shader_rules_off | UINT64_C(1) << i;
                matched = true;
            }
        if (!matched)
            warn(out, "%s: \"%s\" matches no rule. `gnomon rules` lists their ids.", key, patterns[p]);
    }
}

static void apply(struct gn_settings *out, const char *key, const char *const *values, uint32_t count)
{
    const char *value = count ? values[0] : "";
    if (strcmp(key, "enable_rules") == 0) {
        bool any = false;
        for (uint32_t i = 0; i < count; i++)
            any |= *values[i] != '\0';
        if (any) {
            out->rules = (struct gn_rule_set){{0}};
            out->shader_rules_off = ~UINT64_C(0);
        }
        put_rules(out, key, values, count, true);
        return;
    }
    if (strcmp(key, "disable_rules") == 0) {
        put_rules(out, key, values, count, false);
        return;
    }
    if (strcmp(key, "declared_masks") == 0) {
        put_masks(out, values, count);
        return;
    }
    if (count != 1) {
        warn(out, "%s: expected one value, found %u (a comma or a colon separates values). The default is used.", key, count);
        return;
    }
    if (strcmp(key, "log_file") == 0) {
        if (*value)
            out->log_file = parse_path(value);
    } else if (strcmp(key, "sarif_file") == 0) {
        if (*value)
            out->sarif_file = parse_path(value);
    } else if (strcmp(key, "report_cap") == 0) {
        if (!parse_count(value, &out->report_cap))
            warn(out, "report_cap: expected a whole number from 0 to 4294967295, found \"%s\". The default is used.", value);
    } else if (strcmp(key, "statement_signal") == 0) {
        if (!parse_signal(value, &out->statement_signal))
            warn(out, "statement_signal: expected none, USR1 or USR2, found \"%s\". The default is used.", value);
    } else if (strcmp(key, "crash_statement") == 0) {
        if (!parse_bool(value, &out->crash_statement))
            warn(out, "crash_statement: expected true or false, found \"%s\". The default is used.", value);
    } else if (strcmp(key, "report_stderr") == 0) {
        if (!parse_bool(value, &out->report_stderr))
            warn(out, "report_stderr: expected true or false, found \"%s\". The default is used.", value);
    } else if (strcmp(key, "severity_floor") == 0) {
        if (!gn_severity_parse(value, &out->severity_floor))
            warn(out, "severity_floor: expected note, warning or error, found \"%s\". The default is used.", value);
    } else if (strcmp(key, "profile") == 0) {
        if (!gn_profile_parse(value, &out->profile))
            warn(out, "profile: expected vulkan, wgpu, webgpu-rt, diligent or hgi, found \"%s\". The default is used.", value);
    } else if (strcmp(key, "shader_checks") == 0) {
        static const char *const names[] = {"off", "static", "on", "unproved"};
        for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
            if (strcmp(value, names[i]) == 0) {
                out->shader_checks = (enum gn_shader_checks)i;
                return;
            }
        warn(out, "shader_checks: expected off, static, on or unproved, found \"%s\". The default is used.", value);
    } else if (strcmp(key, "shader_cache") == 0) {
        free(out->shader_cache);
        out->shader_cache = *value ? strdup(value) : NULL;
    } else if (strcmp(key, "records_folder") == 0) {
        free(out->records_folder);
        out->records_folder = *value ? strdup(value) : NULL;
    } else if (strcmp(key, "safe_mode") == 0) {
        if (!parse_bool(value, &out->safe_mode))
            warn(out, "safe_mode: expected true or false, found \"%s\". The default is used.", value);
    } else if (strcmp(key, "proceed_limit") == 0) {
        if (!parse_count(value, &out->proceed_limit))
            warn(out, "proceed_limit: expected a whole number from 0 to 4294967295, found \"%s\". The default is used.", value);
    } else if (strcmp(key, "instance_cap") == 0) {
        if (!parse_count(value, &out->instance_cap))
            warn(out, "instance_cap: expected a whole number from 0 to 4294967295, found \"%s\". The default is used.", value);
    } else if (strcmp(key, "input_cap") == 0) {
        if (!parse_count(value, &out->input_cap))
            warn(out, "input_cap: expected a whole number from 0 to 4294967295, found \"%s\". The default is used.", value);
    } else if (strcmp(key, "sbt_offset_bound") == 0) {
        if (!parse_count(value, &out->sbt_offset_bound))
            warn(out, "sbt_offset_bound: expected a whole number from 0 to 4294967295, found \"%s\". The default is used.", value);
    } else if (strcmp(key, "sbt_cap") == 0) {
        if (!parse_count(value, &out->sbt_cap))
            warn(out, "sbt_cap: expected a whole number from 0 to 4294967295, found \"%s\". The default is used.", value);
    } else if (strcmp(key, "custom_index_bound") == 0) {
        if (!parse_count(value, &out->custom_index_bound))
            warn(out, "custom_index_bound: expected a whole number from 0 to 4294967295, found \"%s\". The default is used.", value);
    }
}

static void read_one(VkuLayerSettingSet set, const char *key, struct gn_settings *out)
{
    uint32_t count = 0;
    const char **values = NULL;
    if (!vkuHasLayerSetting(set, key))
        return;
    if (vkuGetLayerSettingValues(set, key, VKU_LAYER_SETTING_TYPE_STRING, &count, NULL) != VK_SUCCESS) {
        warn(out, "%s: the value cannot be read as text. The default is used.", key);
        return;
    }
    if (count) {
        values = calloc(count, sizeof *values);
        if (!values || vkuGetLayerSettingValues(set, key, VKU_LAYER_SETTING_TYPE_STRING, &count, values) != VK_SUCCESS) {
            warn(out, "%s: the value cannot be read as text. The default is used.", key);
            goto done;
        }
    }
    apply(out, key, values, count);
done:
    free(values);
}

static bool is_known(const char *key, size_t size)
{
    for (size_t i = 0; i < KNOWN_COUNT; i++)
        if (strlen(settings_known[i].key) == size && strncmp(settings_known[i].key, key, size) == 0)
            return true;
    return false;
}

static void check_file_keys(struct gn_settings *out)
{
    char path[4096], *line = NULL;
    size_t capacity = 0;
    const char *where = getenv("VK_LAYER_SETTINGS_PATH");
    FILE *file = NULL;
    if (where && *where) {
        file = fopen(where, "re"); /* a folder opens, and gives no line */
        if (file && fgetc(file) == EOF) {
            fclose(file);
            file = NULL;
        }
        if (file)
            rewind(file);
        else if (snprintf(path, sizeof path, "%s/vk_layer_settings.txt", where) < (int)sizeof path)
            file = fopen(path, "re");
    }
    if (!file)
        file = fopen("vk_layer_settings.txt", "re");
    if (!file)
        return;
    while (getline(&line, &capacity, file) > 0) {
        char *key = line + strspn(line, " \t");
        if (strncmp(key, GN_SETTINGS_FILE_PREFIX, strlen(GN_SETTINGS_FILE_PREFIX)) != 0)
            continue;
        key += strlen(GN_SETTINGS_FILE_PREFIX);
        size_t size = strcspn(key, " \t=\r\n");
        if (!is_known(key, size))
            warn(out, "\"" GN_SETTINGS_FILE_PREFIX "%.*s\" in vk_layer_settings.txt is not a setting of this layer.",
                 (int)size, key);
    }
    free(line);
    fclose(file);
}

static void check_environment_keys(struct gn_settings *out)
{
    for (char **entry = environ; entry && *entry; entry++) {
        size_t size = strcspn(*entry, "=");
        bool known = strncmp(*entry, GN_SETTINGS_ENV_PREFIX, strlen(GN_SETTINGS_ENV_PREFIX)) != 0;
        for (size_t i = 0; i < KNOWN_COUNT && !known; i++)
            known = strlen(settings_known[i].env) == size && strncmp(settings_known[i].env, *entry, size) == 0;
        if (!known)
            warn(out, "\"%.*s\" in the environment is not a setting of this layer.", (int)size, *entry);
    }
}

static void check_passed_keys(const VkInstanceCreateInfo *info, struct gn_settings *out)
{
    const VkLayerSettingsCreateInfoEXT *passed = vkuFindLayerSettingsCreateInfo(info);
    for (; passed; passed = vkuNextLayerSettingsCreateInfo(passed))
        for (uint32_t i = 0; i < passed->settingCount; i++) {
            const VkLayerSettingEXT *setting = &passed->pSettings[i];
            if (strcmp(setting->pLayerName, GN_LAYER_NAME) == 0 &&
                !is_known(setting->pSettingName, strlen(setting->pSettingName)))
                warn(out, "\"%s\" passed by VK_EXT_layer_settings is not a setting of this layer.", setting->pSettingName);
        }
}

/* The library would print its own complaints; ours say the same with the expected values. */
static void quiet(const char *key, const char *message)
{
    (void)key;
    (void)message;
}

void gn_settings_read(const VkInstanceCreateInfo *info, struct gn_settings *out)
{
    *out = (struct gn_settings){.rules = gn_rule_set_all()};
    VkuLayerSettingSet set = VK_NULL_HANDLE;
#define GN_SETTING(field, ENV, TYPE, value, label, description) apply(out, #field, (const char *const[]){value}, 1);
#include "layer/settings.def"
#undef GN_SETTING

    if (vkuCreateLayerSettingSet(GN_LAYER_NAME, vkuFindLayerSettingsCreateInfo(info), NULL, quiet, &set) != VK_SUCCESS) {
        warn(out, "the settings cannot be read. Defaults are used.");
        return;
    }
    for (size_t i = 0; i < KNOWN_COUNT; i++)
        read_one(set, settings_known[i].key, out);
    vkuDestroyLayerSettingSet(set, NULL);
    check_file_keys(out);
    check_environment_keys(out);
    check_passed_keys(info, out);
}

void gn_settings_finish(struct gn_settings *settings)
{
    for (uint32_t i = 0; i < settings->warning_count; i++)
        free(settings->warnings[i]);
    free(settings->warnings);
    free(settings->log_file);
    free(settings->shader_cache);
    free(settings->records_folder);
    free(settings->sarif_file);
    *settings = (struct gn_settings){0};
}
