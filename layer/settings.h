/* SPDX-License-Identifier: Apache-2.0 */
/* The layer's settings: read once when an instance is created, from VK_EXT_layer_settings, the environment and
 * vk_layer_settings.txt (in this order of precedence). */
#ifndef GN_LAYER_SETTINGS_H
#define GN_LAYER_SETTINGS_H

#include <stdbool.h>
#include <stdint.h>
#include <vulkan/vulkan.h>

#include "checks/rules/rules.h"

#define GN_LAYER_NAME "VK_LAYER_GNOMON_ray_tracing"
#define GN_SETTINGS_FILE_PREFIX "gnomon_ray_tracing."
#define GN_SETTINGS_ENV_PREFIX "VK_GNOMON_RAY_TRACING_"

enum gn_shader_checks { GN_SHADERS_OFF, GN_SHADERS_STATIC, GN_SHADERS_ON, GN_SHADERS_UNPROVED };

struct gn_settings {
    char *log_file; /* NULL: no log; %p already replaced */
    char *sarif_file; /* the same */
    bool report_stderr;
    uint32_t report_cap; /* 0: no bound */
    int statement_signal; /* 0: none */
    bool crash_statement;
    enum gn_severity severity_floor;
    enum gn_profile profile;
    struct gn_rule_set rules;
    enum gn_shader_checks shader_checks;
    char *shader_cache; /* NULL: none */
    char *records_folder; /* NULL: none */
    bool safe_mode;
    uint32_t proceed_limit; /* 0: none */
    uint64_t shader_rules_off; /* a bit per rule about shaders */
    uint32_t instance_cap;
    uint32_t input_cap, sbt_cap;
    bool masks_declared;
    uint64_t declared_masks[4]; /* one bit per mask */
    uint32_t custom_index_bound, sbt_offset_bound; /* 0: not declared */
    /* What was wrong with the settings, one sentence each; every fault leaves its setting at the default. */
    char **warnings;
    uint32_t warning_count;
};

/* Never fails: what cannot be read stays at its default and gives a warning. */
void gn_settings_read(const VkInstanceCreateInfo *info, struct gn_settings *out);
void gn_settings_finish(struct gn_settings *settings);

#endif
