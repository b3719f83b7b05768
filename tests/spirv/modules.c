/* SPDX-License-Identifier: Apache-2.0 */
/* Loads the compiled test shaders, see modules.h. */
#include "tests/spirv/modules.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char *const form_names[FORM_COUNT] = {"line", "debug", "plain", "optimized"};

uint32_t *module_read(const char *path, size_t *out_count)
{
    FILE *file = fopen(path, "rb");
    if (!file)
        return NULL;
    fseek(file, 0, SEEK_END);
    long size = ftell(file);
    rewind(file);
    assert_true(size > 0 && size % 4 == 0);
    uint32_t *words = malloc((size_t)size);
    assert_non_null(words);
    assert_int_equal(fread(words, 1, (size_t)size, file), size);
    fclose(file);
    *out_count = (size_t)size / 4;
    return words;
}

uint32_t *module_load(const char *form, const char *name, size_t *out_count)
{
    char path[1024];
    snprintf(path, sizeof path, MODULES "/%s/%s.spv", form, name);
    uint32_t *words = module_read(path, out_count);
    if (!words)
        fail_msg("cannot open %s", path);
    return words;
}

static int compare(const void *a, const void *b)
{
    return strcmp(a, b);
}

uint32_t modules_list(char (*out)[64], uint32_t capacity)
{
    uint32_t count = 0;
    char line[64];
    FILE *list = fopen(MODULES "/list", "r");
    assert_non_null(list);
    while (fgets(line, sizeof line, list)) {
        assert_true(count < capacity);
        line[strcspn(line, "\n")] = '\0';
        memcpy(out[count++], line, sizeof line);
    }
    fclose(list);
    qsort(out, count, 64, compare);
    return count;
}

const char *rule_name(enum gn_spirv_rule_index rule)
{
    const char *id = gn_spirv_rule_at(rule)->id;
    return strncmp(id, "query.", 6) == 0 ? id + 6 : id;
}

void result_text(const struct gn_spirv_result *result, bool lines, char *out, size_t size)
{
    size_t used = 0;
    out[0] = '\0';
    for (uint32_t s = 0; s < result->site_count; s++)
        for (uint32_t rule = 0; rule < GN_SPIRV_RULE_COUNT; rule++) {
            const struct gn_spirv_site *site = &result->sites[s];
            if (!(site->checked >> rule & 1) || used >= size)
                continue;
            used += (size_t)snprintf(out + used, size - used, "%s%s%c", used ? " " : "",
                                     rule_name((enum gn_spirv_rule_index)rule),
                                     site->wrong >> rule & 1 ? '!' : '?');
            if (lines && used < size)
                used += (size_t)snprintf(out + used, size - used, "%u", site->place.line);
        }
}
