/* SPDX-License-Identifier: Apache-2.0 */
/* The library's entry: parses, analyses, rewrites, and describes what was found. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "checks/spirv/analysis.h"
#include "checks/spirv/instrument.h"

static const char *text_format(struct arena *arena, const char *format, ...) __attribute__((format(printf, 2, 3)));

static const char *text_format(struct arena *arena, const char *format, ...)
{
    char buffer[1024];
    va_list arguments;
    va_start(arguments, format);
    int length = vsnprintf(buffer, sizeof buffer, format, arguments);
    va_end(arguments);
    if (length < 0)
        length = 0;
    if ((size_t)length >= sizeof buffer)
        length = sizeof buffer - 1;
    return arena_text(arena, buffer, (size_t)length);
}

const char *gn_spirv_status_name(enum gn_spirv_status status)
{
    static const char *const names[] = {"instrumented", "untouched", "declined", "invalid", "out of memory"};
    return (unsigned)status < sizeof names / sizeof names[0] ? names[status] : "?";
}

static bool describe_sites(struct analysis *analysis, struct gn_spirv_result *out)
{
    struct module *module = analysis->module;
    uint32_t findings = 0;
    out->sites = arena_alloc(module->arena, analysis->site_count + 1u, sizeof *out->sites);
    if (!out->sites)
        return false;
    for (uint32_t s = 0; s < analysis->site_count; s++) {
        const struct site *site = &analysis->sites[s];
        struct gn_spirv_site *to = &out->sites[s];
        uint32_t id = site->root == NONE ? 0 : analysis->roots[site->root].id;
        *to = (struct gn_spirv_site){.operation = site->operation->name,
                                     .query_id = id,
                                     .judged = site->judged,
                                     .checked = site->checked,
                                     .wrong = site->wrong,
                                     .first_check = site->first_check};
        const char *name = id ? name_of(module, id) : NULL;
        if (name && !(to->query = arena_text(module->arena, name, strlen(name))))
            return false;
        if (!place_find(module, site->inst, &module->blocks[site->block], &to->place))
            return false;
        findings += (uint32_t)__builtin_popcountll(site->wrong);
    }
    out->site_count = analysis->site_count;
    out->findings = arena_alloc(module->arena, findings + 1u, sizeof *out->findings);
    if (!out->findings)
        return false;
    for (uint32_t s = 0; s < out->site_count; s++)
        for (uint32_t rule = 0; rule < GN_SPIRV_RULE_COUNT; rule++) {
            const struct gn_spirv_site *site = &out->sites[s];
            if (!(site->wrong >> rule & 1))
                continue;
            struct gn_spirv_finding *finding = &out->findings[out->finding_count];
            char query[96] = "";
            if (site->query && *site->query)
                snprintf(query, sizeof query, " on %s", site->query);
            else if (site->query_id)
                snprintf(query, sizeof query, " on %%%u", site->query_id);
            *finding = (struct gn_spirv_finding){
                .rule = rule, .severity = gn_spirv_rule_at(rule)->severity[analysis->options->profile], .site = s};
            finding->message = text_format(module->arena, "%s%s, whenever it is reached: %s", site->operation, query,
                                           gn_spirv_rule_at(rule)->title);
            if (!finding->message)
                return false;
            out->finding_count++;
        }
    return true;
}

bool gn_spirv_check_find(const struct gn_spirv_result *result, uint32_t check, uint32_t *out_site,
                         enum gn_spirv_rule_index *out_rule)
{
    for (uint32_t s = 0; s < result->site_count; s++) {
        const struct gn_spirv_site *site = &result->sites[s];
        if (check < site->first_check || check - site->first_check >= (uint32_t)__builtin_popcountll(site->checked))
            continue;
        uint32_t left = check - site->first_check;
        for (uint32_t rule = 0; rule < GN_SPIRV_RULE_COUNT; rule++)
            if (site->checked >> rule & 1 && left-- == 0) {
                *out_site = s;
                *out_rule = (enum gn_spirv_rule_index)rule;
                return true;
            }
    }
    return false;
}

void gn_spirv_instrument(const uint32_t *words, size_t word_count, const struct gn_spirv_options *options,
                         struct gn_spirv_result *out)
{
    static const struct gn_spirv_options defaults;
    struct module module;
    struct arena arena = {NULL};
    memset(out, 0, sizeof *out);
    struct analysis analysis = {.module = &module, .options = options ? options : &defaults};
    out->status = module_parse(&module, &arena, words, word_count, out->message, sizeof out->message);
    if (out->status != GN_SPIRV_UNTOUCHED)
        goto done;
    bool concerned = false;
    for (uint32_t i = 0; i < module.inst_count && !concerned; i++)
        concerned = operation_at(&module, &module.insts[i]) != NULL;
    if (!concerned) {
        say(&module, "the module has no operation on ray queries and no trace");
        goto done;
    }
    if (!analysis.options->without_validation && (out->status = module_validate(&module)) != GN_SPIRV_UNTOUCHED)
        goto done;
    if ((out->status = objects_find(&analysis)) != GN_SPIRV_UNTOUCHED ||
        (out->status = flow_run(&analysis)) != GN_SPIRV_UNTOUCHED)
        goto done;
    verdicts_make(&analysis);
    if (!describe_sites(&analysis, out)) {
        out->status = GN_SPIRV_OUT_OF_MEMORY;
        goto done;
    }
    out->check_count = analysis.check_count;
    if (analysis.options->static_only)
        say(&module, "only the static judgement was asked for");
    else if (analysis.check_count == 0)
        say(&module, "every operation is proved right");
    else
        out->status = rewrite_module(&analysis, out);
done:
    if (out->status == GN_SPIRV_OUT_OF_MEMORY)
        say(&module, "out of memory");
    if (out->status != GN_SPIRV_INSTRUMENTED && out->status != GN_SPIRV_UNTOUCHED && out->status != GN_SPIRV_DECLINED) {
        /* What was gathered before is not to be relied upon. */
        out->sites = NULL;
        out->findings = NULL;
        out->site_count = out->finding_count = out->check_count = 0;
    }
    if (out->status == GN_SPIRV_DECLINED)
        out->check_count = 0;
    out->storage = arena.blocks;
}

void gn_spirv_result_finish(struct gn_spirv_result *result)
{
    struct arena arena = {result->storage};
    arena_finish(&arena);
    free(result->words);
    memset(result, 0, sizeof *result);
}
