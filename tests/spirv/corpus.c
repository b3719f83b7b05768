/* SPDX-License-Identifier: Apache-2.0 */
/* Reads what the test shaders say of themselves, see corpus.h. */
#include "tests/spirv/corpus.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/spirv/modules.h"

static const struct {
    const char *extension;
    VkShaderStageFlagBits stage;
} stages[] = {{".comp", VK_SHADER_STAGE_COMPUTE_BIT},         {".spvasm", VK_SHADER_STAGE_COMPUTE_BIT},
              {".rgen", VK_SHADER_STAGE_RAYGEN_BIT_KHR},      {".rchit", VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR},
              {".rahit", VK_SHADER_STAGE_ANY_HIT_BIT_KHR},    {".rint", VK_SHADER_STAGE_INTERSECTION_BIT_KHR},
              {".rmiss", VK_SHADER_STAGE_MISS_BIT_KHR},       {".rcall", VK_SHADER_STAGE_CALLABLE_BIT_KHR},
              {".frag", VK_SHADER_STAGE_FRAGMENT_BIT},        {".vert", VK_SHADER_STAGE_VERTEX_BIT},
              {".mesh", VK_SHADER_STAGE_MESH_BIT_EXT},        {".task", VK_SHADER_STAGE_TASK_BIT_EXT}};

static void rule_parse(const struct shader *shader, const char *name, size_t length, enum gn_spirv_rule_index *out)
{
    for (uint32_t rule = 0; rule < GN_SPIRV_RULE_COUNT; rule++) {
        const char *known = rule_name((enum gn_spirv_rule_index)rule);
        if (strlen(known) == length && memcmp(known, name, length) == 0) {
            *out = (enum gn_spirv_rule_index)rule;
            return;
        }
    }
    fail_msg("%s: there is no rule '%.*s'", shader->file, (int)length, name);
}

static void options_parse(struct shader *shader, char *text)
{
    for (char *word = strtok(text, " "); word; word = strtok(NULL, " ")) {
        char *value = strchr(word, '=');
        if (!value)
            fail_msg("%s: expected name=value, found '%s'", shader->file, word);
        *value++ = '\0';
        uint32_t number = (uint32_t)strtoul(value, NULL, 0);
        if (strcmp(word, "profile") == 0)
            assert_true(gn_profile_parse(value, &shader->options.profile));
        else if (strcmp(word, "limit") == 0)
            shader->options.proceed_limit = number;
        else if (strcmp(word, "recursion") == 0) {
            shader->options.recursion_known = true;
            shader->options.max_recursion = number;
        } else if (strcmp(word, "payload") == 0)
            shader->options.max_payload = number;
        else if (strcmp(word, "attribute") == 0)
            shader->options.max_attribute = number;
        else if (strcmp(word, "forbidden") == 0)
            shader->options.forbidden_ray_flags = number;
        else if (strcmp(word, "callables") == 0)
            shader->callables = number;
        else if (strcmp(word, "structures") == 0) {
            shader->asks_structures = true;
            shader->structures = number;
        } else
            fail_msg("%s: there is no option '%s'", shader->file, word);
    }
}

static void run_parse(struct shader *shader, char *text)
{
    if (strncmp(text, "not", 3) == 0) {
        shader->never_run = true;
        return;
    }
    char *arrow = strstr(text, "->");
    if (!arrow || shader->run_count == MAX_RUNS)
        fail_msg("%s: expected a run with '->', at most %d, found '%s'", shader->file, MAX_RUNS, text);
    struct run *run = &shader->runs[shader->run_count++];
    run->choices.lane = UINT32_MAX;
    *arrow = '\0';
    for (char *word = strtok(text, " "); word; word = strtok(NULL, " ")) {
        if (strncmp(word, "choice=", 7) == 0)
            run->choices.choice = (uint32_t)strtoul(word + 7, NULL, 0);
        else if (strncmp(word, "value=", 6) == 0)
            run->choices.value = strtof(word + 6, NULL);
        else if (strncmp(word, "lane=", 5) == 0)
            run->choices.lane = (uint32_t)strtoul(word + 5, NULL, 0);
        else
            fail_msg("%s: a run has choice, value and lane, not '%s'", shader->file, word);
    }
    for (char *word = strtok(arrow + 2, " "); word; word = strtok(NULL, " ")) {
        char *star = strchr(word, '*');
        if (!star || run->firing_count == MAX_FIRINGS)
            fail_msg("%s: expected rule*count, found '%s'", shader->file, word);
        struct firing *firing = &run->firings[run->firing_count++];
        rule_parse(shader, word, (size_t)(star - word), &firing->rule);
        firing->count = (uint32_t)strtoul(star + 1, NULL, 0);
    }
}

static void marks_parse(struct shader *shader, uint32_t line, char *text)
{
    for (char *word = strtok(text, " "); word; word = strtok(NULL, " ")) {
        size_t length = strlen(word);
        if (shader->mark_count == MAX_MARKS || (word[length - 1] != '!' && word[length - 1] != '?'))
            fail_msg("%s:%u: expected rule! or rule?, found '%s'", shader->file, line, word);
        struct mark *mark = &shader->marks[shader->mark_count++];
        mark->line = line;
        mark->wrong = word[length - 1] == '!';
        rule_parse(shader, word, length - 1, &mark->rule);
    }
}

static void line_parse(struct shader *shader, uint32_t line, char *text)
{
    const char *comment = shader->assembly ? ";" : "//";
    char sign[8];
    snprintf(sign, sizeof sign, "%s~", comment);
    char *found = strstr(text, sign);
    if (found)
        marks_parse(shader, line, found + strlen(sign));
    snprintf(sign, sizeof sign, "%s! ", comment);
    if (strncmp(text, sign, strlen(sign)) != 0)
        return;
    char *key = text + strlen(sign), *value = strchr(key, ':');
    if (!value)
        fail_msg("%s:%u: expected 'key:'", shader->file, line);
    *value++ = '\0';
    value += strspn(value, " ");
    if (strcmp(key, "why") == 0)
        snprintf(shader->why, sizeof shader->why, "%s", value);
    else if (strcmp(key, "clauses") == 0)
        snprintf(shader->clauses, sizeof shader->clauses, "%s", value);
    else if (strcmp(key, "twin") == 0)
        snprintf(shader->twin, sizeof shader->twin, "%.*s", (int)strcspn(value, " "), value);
    else if (strcmp(key, "options") == 0)
        options_parse(shader, value);
    else if (strcmp(key, "run") == 0)
        run_parse(shader, value);
    else
        fail_msg("%s:%u: there is no key '%s'", shader->file, line, key);
}

static FILE *shader_open(const struct shader *shader)
{
    char path[1024];
    snprintf(path, sizeof path, SHADERS "/%s", shader->file);
    FILE *file = fopen(path, "r");
    if (!file)
        fail_msg("cannot open %s", path);
    return file;
}

struct shader *corpus_read(uint32_t *out_count)
{
    static char names[MAX_SHADERS][64];
    uint32_t count = modules_list(names, MAX_SHADERS);
    struct shader *shaders = calloc(count + 1, sizeof *shaders);
    assert_non_null(shaders);
    for (uint32_t n = 0; n < count; n++) {
        struct shader *shader = &shaders[n];
        char text[1024];
        memcpy(shader->file, names[n], sizeof shader->file);
        for (size_t i = 0; i < sizeof stages / sizeof stages[0]; i++) {
            const char *end = strchr(shader->file, '.');
            if (end && strncmp(end, stages[i].extension, strlen(stages[i].extension)) == 0)
                shader->stage = stages[i].stage;
        }
        assert_int_not_equal(shader->stage, 0);
        shader->assembly = strstr(shader->file, ".spvasm") != NULL;
        shader->options.profile = GN_PROFILE_VULKAN;
        FILE *file = shader_open(shader);
        for (uint32_t line = 1; fgets(text, sizeof text, file); line++) {
            text[strcspn(text, "\r\n")] = '\0';
            line_parse(shader, line, text);
        }
        fclose(file);
    }
    *out_count = count;
    return shaders;
}

const struct shader *corpus_find(const struct shader *shaders, uint32_t count, const char *file)
{
    for (uint32_t i = 0; i < count; i++)
        if (strcmp(shaders[i].file, file) == 0)
            return &shaders[i];
    return NULL;
}

bool corpus_fires(const struct shader *shader)
{
    bool fires = false;
    for (uint32_t i = 0; i < shader->mark_count; i++)
        fires |= shader->marks[i].wrong;
    for (uint32_t i = 0; i < shader->run_count; i++)
        fires |= shader->runs[i].firing_count > 0;
    return fires;
}

bool corpus_silent(const struct shader *shader)
{
    bool silent = shader->never_run;
    for (uint32_t i = 0; i < shader->run_count; i++)
        silent |= shader->runs[i].firing_count == 0;
    for (uint32_t i = 0; i < shader->mark_count; i++)
        silent &= !shader->marks[i].wrong;
    return silent;
}

void corpus_lines(const struct shader *shader, const struct gn_spirv_result *result, uint32_t *out_lines)
{
    for (uint32_t s = 0; s < result->site_count; s++)
        out_lines[s] = result->sites[s].place.line;
    if (!shader->assembly)
        return;
    FILE *file = shader_open(shader);
    char text[1024];
    uint32_t site = 0;
    for (uint32_t line = 1; fgets(text, sizeof text, file) && site < result->site_count; line++) {
        text[strcspn(text, ";")] = '\0';
        const char *found = strstr(text, result->sites[site].operation);
        if (found && found[strspn(found, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz")] <= ' ')
            out_lines[site++] = line;
    }
    fclose(file);
}
