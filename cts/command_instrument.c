/* SPDX-License-Identifier: Apache-2.0 */
/* `gnomon instrument`: judges one shader offline and writes it with its checks at run time. */
#include <argp.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <yyjson.h>

#include "checks/spirv/records.h"
#include "checks/spirv/spirv.h"
#include "cts/commands.h"

enum { KEY_STATIC = 256, KEY_JSON, KEY_PROFILE, KEY_SET, KEY_BINDING, KEY_WITHOUT_PROOFS, KEY_LIMIT, KEY_RECURSION, KEY_PAYLOAD, KEY_ATTRIBUTE };

static const struct argp_option options[] = {
    {"output", 'o', "OUT.spv", 0, "Where the module goes; a module without anything to check is copied", 0},
    {"static-only", KEY_STATIC, NULL, 0, "Only judge, write nothing", 0},
    {"json", KEY_JSON, NULL, 0, "Print one JSON object instead of text", 0},
    {"profile", KEY_PROFILE, "NAME", 0, "API whose rules apply: vulkan (default), wgpu, webgpu-rt, diligent, hgi", 0},
    {"set", KEY_SET, "N", 0, "Descriptor set of the record buffer (default 7)", 0},
    {"binding", KEY_BINDING, "N", 0, "Binding of the record buffer (default 0)", 0},
    {"proceed-limit", KEY_LIMIT, "N", 0, "Report a query that calls Proceed more often since its initialization", 0},
    {"max-recursion", KEY_RECURSION, "N", 0, "The pipeline's maxPipelineRayRecursionDepth", 0},
    {"max-payload", KEY_PAYLOAD, "BYTES", 0, "The pipeline's maxPipelineRayPayloadSize", 0},
    {"max-attribute", KEY_ATTRIBUTE, "BYTES", 0, "The pipeline's maxPipelineRayHitAttributeSize", 0},
    {"without-proofs", KEY_WITHOUT_PROOFS, NULL, 0, "Check at run time also what is proved right, to measure what that costs", 0},
    {0}};

struct arguments {
    const char *input, *output;
    struct gn_spirv_options spirv;
    bool json;
};

static uint32_t parse_number(struct argp_state *state, const char *text)
{
    char *end = NULL;
    errno = 0;
    unsigned long value = strtoul(text, &end, 10);
    if (errno || !*text || *end || text[0] == '-' || value > 0xFFFFFF)
        argp_error(state, "expected a number from 0 to %u, found '%s'", 0xFFFFFF, text);
    return (uint32_t)value;
}

static error_t parse(int key, char *value, struct argp_state *state)
{
    struct arguments *arguments = state->input;
    switch (key) {
    case 'o': arguments->output = value; break;
    case KEY_STATIC: arguments->spirv.static_only = true; break;
    case KEY_JSON: arguments->json = true; break;
    case KEY_PROFILE:
        if (!gn_profile_parse(value, &arguments->spirv.profile))
            argp_error(state, "there is no profile '%s'", value);
        break;
    case KEY_LIMIT: arguments->spirv.proceed_limit = parse_number(state, value); break;
    case KEY_PAYLOAD: arguments->spirv.max_payload = parse_number(state, value); break;
    case KEY_ATTRIBUTE: arguments->spirv.max_attribute = parse_number(state, value); break;
    case KEY_RECURSION:
        arguments->spirv.recursion_known = true;
        arguments->spirv.max_recursion = parse_number(state, value);
        break;
    case KEY_SET: arguments->spirv.set = parse_number(state, value); break;
    case KEY_BINDING: arguments->spirv.binding = parse_number(state, value); break;
    case KEY_WITHOUT_PROOFS: arguments->spirv.without_proofs = true; break;
    case ARGP_KEY_ARG:
        if (arguments->input)
            argp_error(state, "expected one module, found '%s' after '%s'", value, arguments->input);
        arguments->input = value;
        break;
    case ARGP_KEY_END:
        if (!arguments->input)
            argp_error(state, "expected a SPIR-V module");
        if (!arguments->output && !arguments->spirv.static_only)
            argp_error(state, "expected -o OUT.spv, or --static-only");
        break;
    default: return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

/* The whole file as words; NULL with a message on stderr. */
static uint32_t *read_words(const char *path, size_t *out_count)
{
    const size_t limit = (size_t)256 << 20;
    FILE *file = fopen(path, "rb");
    unsigned char *data = NULL;
    size_t size = 0, capacity = 0;
    if (!file) {
        fprintf(stderr, "gnomon: %s: %s\n", path, strerror(errno));
        return NULL;
    }
    for (;;) {
        if (size == capacity) {
            capacity = capacity ? capacity * 2 : 1 << 16;
            unsigned char *grown = capacity > limit ? NULL : realloc(data, capacity);
            if (!grown) {
                fprintf(stderr, "gnomon: %s: expected a module of at most %zu bytes\n", path, limit);
                goto fail;
            }
            data = grown;
        }
        size_t got = fread(data + size, 1, capacity - size, file);
        if (got == 0)
            break;
        size += got;
    }
    if (ferror(file)) {
        fprintf(stderr, "gnomon: %s: %s\n", path, strerror(errno));
        goto fail;
    }
    if (size % 4 != 0) {
        fprintf(stderr, "gnomon: %s: expected words of 4 bytes, found %zu bytes\n", path, size);
        goto fail;
    }
    fclose(file);
    *out_count = size / 4;
    return (uint32_t *)(void *)data;
fail:
    fclose(file);
    free(data);
    return NULL;
}

static bool write_words(const char *path, const uint32_t *words, size_t count)
{
    FILE *file = fopen(path, "wb");
    bool good = file && fwrite(words, 4, count, file) == count;
    if (file && fclose(file) != 0)
        good = false;
    if (!good)
        fprintf(stderr, "gnomon: %s: %s\n", path, strerror(errno));
    return good;
}

static const char *place_text(const struct gn_spirv_place *place, char *out, size_t size)
{
    if (place->file && place->line)
        snprintf(out, size, "%s:%u", place->file, place->line);
    else if (place->function)
        snprintf(out, size, "function %s, block %%%u, word %u", place->function, place->block_id, place->offset);
    else
        snprintf(out, size, "function %%%u, block %%%u, word %u", place->function_id, place->block_id, place->offset);
    return out;
}

static void count_checks(const struct gn_spirv_result *result, uint32_t out[3])
{
    memset(out, 0, 3 * sizeof *out);
    for (uint32_t s = 0; s < result->site_count; s++) {
        out[0] += (uint32_t)__builtin_popcountll(result->sites[s].judged & ~result->sites[s].checked);
        out[1] += (uint32_t)__builtin_popcountll(result->sites[s].checked);
        out[2] += result->sites[s].checked != 0;
    }
}

static void print_text(const struct arguments *arguments, const struct gn_spirv_result *result, size_t words_before)
{
    char place[1024];
    uint32_t counts[3];
    for (uint32_t f = 0; f < result->finding_count; f++) {
        const struct gn_spirv_finding *finding = &result->findings[f];
        const struct gn_spirv_site *site = &result->sites[finding->site];
        const struct gn_spirv_rule *rule = gn_spirv_rule_at(finding->rule);
        printf("%s: %s: %s [%s", place_text(&site->place, place, sizeof place), gn_severity_name(finding->severity),
               finding->message, rule->id);
        for (int i = 0; rule->sources[i]; i++)
            printf(", %s", rule->sources[i]);
        printf("]\n");
        if (site->place.source)
            printf("    %s\n", site->place.source);
        printf("    %s\n", rule->remedy);
    }
    count_checks(result, counts);
    printf("%s: %s", arguments->input, gn_spirv_status_name(result->status));
    if (result->message[0])
        printf(": %s", result->message);
    printf("\n%u operations on ray queries, %u rules proved right, %u checked at run time at %u operations, %u wrong\n",
           result->site_count, counts[0], counts[1], counts[2], result->finding_count);
    if (result->status == GN_SPIRV_INSTRUMENTED)
        printf("%zu bytes became %zu; records go to set %u, binding %u, %u bytes\n", words_before * 4,
               result->word_count * 4, arguments->spirv.set, arguments->spirv.binding,
               gn_records_word_count(result->check_count) * 4);
}

static void add_rules(yyjson_mut_doc *doc, yyjson_mut_val *object, const char *key, uint64_t rules)
{
    yyjson_mut_val *list = yyjson_mut_arr(doc);
    for (uint32_t rule = 0; rule < GN_SPIRV_RULE_COUNT; rule++)
        if (rules >> rule & 1)
            yyjson_mut_arr_add_str(doc, list, gn_spirv_rule_at(rule)->id);
    yyjson_mut_obj_add_val(doc, object, key, list);
}

static void add_place(yyjson_mut_doc *doc, yyjson_mut_val *object, const struct gn_spirv_place *place)
{
    if (place->function)
        yyjson_mut_obj_add_str(doc, object, "function", place->function);
    yyjson_mut_obj_add_uint(doc, object, "function_id", place->function_id);
    yyjson_mut_obj_add_uint(doc, object, "block_id", place->block_id);
    yyjson_mut_obj_add_uint(doc, object, "word", place->offset);
    if (place->file && place->line) {
        yyjson_mut_obj_add_str(doc, object, "file", place->file);
        yyjson_mut_obj_add_uint(doc, object, "line", place->line);
        yyjson_mut_obj_add_uint(doc, object, "column", place->column);
    }
    if (place->source)
        yyjson_mut_obj_add_str(doc, object, "source_line", place->source);
}

static bool print_json(const struct arguments *arguments, const struct gn_spirv_result *result, size_t words_before)
{
    yyjson_mut_doc *doc = yyjson_mut_doc_new(NULL);
    if (!doc)
        return false;
    yyjson_mut_val *root = yyjson_mut_obj(doc), *findings = yyjson_mut_arr(doc), *sites = yyjson_mut_arr(doc);
    yyjson_mut_doc_set_root(doc, root);
    yyjson_mut_obj_add_str(doc, root, "module", arguments->input);
    yyjson_mut_obj_add_str(doc, root, "status", gn_spirv_status_name(result->status));
    yyjson_mut_obj_add_str(doc, root, "message", result->message);
    yyjson_mut_obj_add_uint(doc, root, "version", GN_SPIRV_VERSION);
    yyjson_mut_obj_add_uint(doc, root, "bytes", words_before * 4);
    yyjson_mut_obj_add_uint(doc, root, "bytes_instrumented", result->word_count * 4);
    yyjson_mut_obj_add_uint(doc, root, "checks", result->check_count);
    yyjson_mut_obj_add_uint(doc, root, "record_bytes", (uint64_t)gn_records_word_count(result->check_count) * 4);
    for (uint32_t f = 0; f < result->finding_count; f++) {
        const struct gn_spirv_finding *finding = &result->findings[f];
        const struct gn_spirv_rule *rule = gn_spirv_rule_at(finding->rule);
        yyjson_mut_val *object = yyjson_mut_arr_add_obj(doc, findings), *sources = yyjson_mut_arr(doc);
        yyjson_mut_obj_add_str(doc, object, "rule", rule->id);
        yyjson_mut_obj_add_str(doc, object, "severity", gn_severity_name(finding->severity));
        yyjson_mut_obj_add_str(doc, object, "message", finding->message);
        for (int i = 0; rule->sources[i]; i++)
            yyjson_mut_arr_add_str(doc, sources, rule->sources[i]);
        yyjson_mut_obj_add_val(doc, object, "sources", sources);
        yyjson_mut_obj_add_uint(doc, object, "site", finding->site);
        add_place(doc, object, &result->sites[finding->site].place);
    }
    for (uint32_t s = 0; s < result->site_count; s++) {
        const struct gn_spirv_site *site = &result->sites[s];
        yyjson_mut_val *object = yyjson_mut_arr_add_obj(doc, sites);
        yyjson_mut_obj_add_str(doc, object, "operation", site->operation);
        yyjson_mut_obj_add_uint(doc, object, "query_id", site->query_id);
        if (site->query)
            yyjson_mut_obj_add_str(doc, object, "query", site->query);
        add_place(doc, object, &site->place);
        add_rules(doc, object, "proved", site->judged & ~site->checked);
        add_rules(doc, object, "checked", site->checked);
        add_rules(doc, object, "wrong", site->wrong);
        if (site->checked)
            yyjson_mut_obj_add_uint(doc, object, "first_check", site->first_check);
    }
    yyjson_mut_obj_add_val(doc, root, "findings", findings);
    yyjson_mut_obj_add_val(doc, root, "sites", sites);
    bool good = yyjson_mut_write_fp(stdout, doc, YYJSON_WRITE_PRETTY, NULL, NULL) && putchar('\n') != EOF;
    yyjson_mut_doc_free(doc);
    return good;
}

int gn_command_instrument(int argc, char **argv)
{
    static const struct argp argp = {
        options,
        parse,
        "IN.spv",
        "Finds misuse of ray queries in a shader and writes the shader with checks for what only shows at run time.\v"
        "Exit status: 0 nothing found, 1 misuse found, 2 wrong usage or no valid module, 3 a failure of its own.",
        NULL,
        NULL,
        NULL};
    struct arguments arguments = {.spirv = {.profile = GN_PROFILE_VULKAN, .set = 7}};
    struct gn_spirv_result result;
    size_t count = 0;
    int exit_status = 3;
    if (argp_parse(&argp, argc, argv, 0, NULL, &arguments) != 0)
        return 2;
    uint32_t *words = read_words(arguments.input, &count);
    if (!words)
        return 2;
    gn_spirv_instrument(words, count, &arguments.spirv, &result);
    if (result.status == GN_SPIRV_INVALID || result.status == GN_SPIRV_OUT_OF_MEMORY) {
        fprintf(stderr, "gnomon: %s: %s\n", arguments.input, result.message);
        exit_status = result.status == GN_SPIRV_INVALID ? 2 : 3;
    }
    bool instrumented = result.status == GN_SPIRV_INSTRUMENTED;
    if (arguments.output && !arguments.spirv.static_only && result.status != GN_SPIRV_OUT_OF_MEMORY &&
        !write_words(arguments.output, instrumented ? result.words : words, instrumented ? result.word_count : count)) {
        exit_status = 2;
        goto done;
    }
    if (result.status == GN_SPIRV_INVALID || result.status == GN_SPIRV_OUT_OF_MEMORY)
        goto done;
    if (!arguments.json)
        print_text(&arguments, &result, count);
    else if (!print_json(&arguments, &result, count))
        goto done;
    exit_status = fflush(stdout) != 0 ? 3 : result.finding_count ? 1 : 0;
done:
    gn_spirv_result_finish(&result);
    free(words);
    return exit_status;
}
