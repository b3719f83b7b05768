/* SPDX-License-Identifier: Apache-2.0 */
/* The catalogue, names, and how rules are run and report. */
#include "checks/rules/geometry.h"
#include "checks/rules/rules.h"
#include "checks/rules/survey.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define GN_RULE(name) extern const struct gn_rule gn_rule_##name;
#include "checks/rules/catalogue.def"
#undef GN_RULE

static const struct gn_rule *const catalogue[] = {
#define GN_RULE(name) &gn_rule_##name,
#include "checks/rules/catalogue.def"
#undef GN_RULE
};

#define CATALOGUE_COUNT (sizeof catalogue / sizeof catalogue[0])

_Static_assert(CATALOGUE_COUNT <= 256, "struct gn_rule_set holds 256 rules");

static const char *const profile_names[] = {
#define GN_PROFILE(enumerator, name, label) name,
#include "checks/rules/profiles.def"
#undef GN_PROFILE
};

static const char *const severity_names[] = {"silent", "note", "warning", "error"};

static const char *const object_kind_names[] = {"object",         "BLAS",  "TLAS",  "acceleration structure", "buffer",
                                                "command buffer", "queue", "device",
                                                "pipeline",       "shader module", "shader object"};

_Static_assert(sizeof severity_names / sizeof severity_names[0] == GN_SEVERITY_COUNT, "one name per severity");
_Static_assert(sizeof object_kind_names / sizeof object_kind_names[0] == GN_OBJECT_KIND_COUNT, "one name per kind");

const char *gn_profile_name(enum gn_profile profile)
{
    return (unsigned)profile < GN_PROFILE_COUNT ? profile_names[profile] : "?";
}

const char *gn_severity_name(enum gn_severity severity)
{
    return (unsigned)severity < GN_SEVERITY_COUNT ? severity_names[severity] : "?";
}

const char *gn_object_kind_name(enum gn_object_kind kind)
{
    return (unsigned)kind < GN_OBJECT_KIND_COUNT ? object_kind_names[kind] : "?";
}

static bool find_name(const char *const *names, size_t first, size_t count, const char *name, size_t *out)
{
    for (size_t i = first; i < count; i++)
        if (strcmp(names[i], name) == 0) {
            *out = i;
            return true;
        }
    return false;
}

bool gn_profile_parse(const char *name, enum gn_profile *out)
{
    size_t i;
    if (!find_name(profile_names, 0, GN_PROFILE_COUNT, name, &i))
        return false;
    *out = (enum gn_profile)i;
    return true;
}

bool gn_severity_parse(const char *name, enum gn_severity *out)
{
    size_t i;
    if (!find_name(severity_names, GN_SEVERITY_NOTE, GN_SEVERITY_COUNT, name, &i))
        return false;
    *out = (enum gn_severity)i;
    return true;
}

size_t gn_rules_count(void)
{
    return CATALOGUE_COUNT;
}

const struct gn_rule *gn_rules_at(size_t index)
{
    return index < CATALOGUE_COUNT ? catalogue[index] : NULL;
}

const struct gn_rule *gn_rules_find(const char *id)
{
    for (size_t i = 0; i < CATALOGUE_COUNT; i++)
        if (strcmp(catalogue[i]->id, id) == 0)
            return catalogue[i];
    return NULL;
}

/* Linear: on a mismatch only the last '*' can take one character more. */
static bool pattern_matches(const char *pattern, const char *text)
{
    const char *star = NULL, *resume = text;
    while (*text) {
        if (*pattern == '*') {
            star = pattern++;
            resume = text;
        } else if (*pattern == *text) {
            pattern++;
            text++;
        } else if (star) {
            pattern = star + 1;
            text = ++resume;
        } else {
            return false;
        }
    }
    while (*pattern == '*')
        pattern++;
    return *pattern == '\0';
}

bool gn_rule_matches(const struct gn_rule *rule, const char *pattern)
{
    return pattern_matches(pattern, rule->id);
}

struct gn_rule_set gn_rule_set_all(void)
{
    struct gn_rule_set set = {{0}};
    for (size_t i = 0; i < CATALOGUE_COUNT; i++)
        gn_rule_set_put(&set, i, true);
    return set;
}

bool gn_rule_set_has(const struct gn_rule_set *set, size_t index)
{
    return index < CATALOGUE_COUNT && (set->bits[index / 64] >> (index % 64) & 1);
}

void gn_rule_set_put(struct gn_rule_set *set, size_t index, bool on)
{
    if (index >= CATALOGUE_COUNT)
        return;
    uint64_t bit = UINT64_C(1) << (index % 64);
    if (on)
        set->bits[index / 64] |= bit;
    else
        set->bits[index / 64] &= ~bit;
}

static bool applies(size_t index, enum gn_rule_event on, const struct gn_report *report)
{
    return catalogue[index]->on == on && gn_rule_set_has(&report->enabled, index) &&
           catalogue[index]->severity[report->profile] != GN_SEVERITY_SILENT;
}

void gn_rules_judge_tlas_build(const struct gn_tlas_build *build, struct gn_report *report)
{
    struct gn_survey survey = {.active = 0};
    report->survey = build->survey;
    for (size_t i = 0; i < CATALOGUE_COUNT; i++) {
        if (!applies(i, GN_RULE_ON_TLAS_BUILD, report))
            continue;
        if (catalogue[i]->surveys && !report->survey) {
            gn_survey_add(build, 0, build->instance_count, &survey);
            report->survey = &survey;
        }
        report->rule = catalogue[i];
        catalogue[i]->test.tlas_build(build, report);
        gn_rule_set_put(&report->evaluated, i, true);
    }
    report->rule = NULL;
    report->survey = NULL;
}

static bool is_about(size_t index, enum gn_command_kind kind)
{
    return catalogue[index]->on == GN_RULE_ON_COMMAND && (catalogue[index]->commands >> kind & 1);
}

bool gn_rules_about_command(enum gn_command_kind kind, const struct gn_rule_set *enabled, enum gn_profile profile)
{
    for (size_t i = 0; i < CATALOGUE_COUNT; i++)
        if (is_about(i, kind) && gn_rule_set_has(enabled, i) && catalogue[i]->severity[profile] != GN_SEVERITY_SILENT)
            return true;
    return false;
}

void gn_rules_judge_command(const struct gn_command *command, struct gn_report *report)
{
    for (size_t i = 0; i < CATALOGUE_COUNT; i++) {
        if (!is_about(i, command->kind) || !applies(i, GN_RULE_ON_COMMAND, report))
            continue;
        report->rule = catalogue[i];
        catalogue[i]->test.command(command, report);
        gn_rule_set_put(&report->evaluated, i, true);
    }
    report->rule = NULL;
}

void gn_rules_judge_input(const struct gn_input *input, struct gn_report *report)
{
    for (size_t i = 0; i < CATALOGUE_COUNT; i++) {
        if (!applies(i, GN_RULE_ON_INPUT, report))
            continue;
        report->rule = catalogue[i];
        catalogue[i]->test.input(input, report);
        gn_rule_set_put(&report->evaluated, i, true);
    }
    report->rule = NULL;
}

void gn_rules_judge_clash(const struct gn_clash *clash, struct gn_report *report)
{
    for (size_t i = 0; i < CATALOGUE_COUNT; i++) {
        if (!applies(i, GN_RULE_ON_CLASH, report))
            continue;
        report->rule = catalogue[i];
        catalogue[i]->test.clash(clash, report);
        gn_rule_set_put(&report->evaluated, i, true);
    }
    report->rule = NULL;
}

void gn_rules_judge_use(const struct gn_trouble *use, struct gn_report *report)
{
    for (size_t i = 0; i < CATALOGUE_COUNT; i++) {
        if (!applies(i, GN_RULE_ON_USE, report))
            continue;
        report->rule = catalogue[i];
        catalogue[i]->test.use(use, report);
        gn_rule_set_put(&report->evaluated, i, true);
    }
    report->rule = NULL;
}

void gn_rules_judge_refit(const struct gn_refit *refit, struct gn_report *report)
{
    for (size_t i = 0; i < CATALOGUE_COUNT; i++) {
        if (!applies(i, GN_RULE_ON_REFIT, report))
            continue;
        report->rule = catalogue[i];
        catalogue[i]->test.refit(refit, report);
        gn_rule_set_put(&report->evaluated, i, true);
    }
    report->rule = NULL;
}

void gn_rules_judge_hazard(const struct gn_hazard *hazard, struct gn_report *report)
{
    for (size_t i = 0; i < CATALOGUE_COUNT; i++) {
        if (!applies(i, GN_RULE_ON_HAZARD, report))
            continue;
        report->rule = catalogue[i];
        catalogue[i]->test.hazard(hazard, report);
        gn_rule_set_put(&report->evaluated, i, true);
    }
    report->rule = NULL;
}

void gn_rules_judge_demand(const struct gn_demand *demand, struct gn_report *report)
{
    for (size_t i = 0; i < CATALOGUE_COUNT; i++) {
        if (!applies(i, GN_RULE_ON_DEMAND, report))
            continue;
        report->rule = catalogue[i];
        catalogue[i]->test.demand(demand, report);
        gn_rule_set_put(&report->evaluated, i, true);
    }
    report->rule = NULL;
}

void gn_rules_judge_sbt(const struct gn_sbt *sbt, struct gn_report *report)
{
    for (size_t i = 0; i < CATALOGUE_COUNT; i++) {
        if (!applies(i, GN_RULE_ON_SBT, report))
            continue;
        report->rule = catalogue[i];
        catalogue[i]->test.sbt(sbt, report);
        gn_rule_set_put(&report->evaluated, i, true);
    }
    report->rule = NULL;
}

void gn_rules_judge_geometry(const struct gn_geometry_contents *contents, struct gn_report *report)
{
    struct gn_geometry_survey survey;
    bool surveyed = false;
    for (size_t i = 0; i < CATALOGUE_COUNT; i++) {
        if (!applies(i, GN_RULE_ON_GEOMETRY, report))
            continue;
        if (!surveyed)
            gn_geometry_survey(contents, &survey);
        surveyed = true;
        report->geometry = &survey;
        report->rule = catalogue[i];
        catalogue[i]->test.geometry(contents, report);
        gn_rule_set_put(&report->evaluated, i, true);
    }
    report->rule = NULL;
    report->geometry = NULL;
}

static uint64_t mix(uint64_t hash, uint64_t value)
{
    hash ^= value + UINT64_C(0x9E3779B97F4A7C15) + (hash << 6) + (hash >> 2);
    hash *= UINT64_C(0xFF51AFD7ED558CCD);
    return hash ^ hash >> 33;
}

uint64_t gn_report_site(const struct gn_report *report, uint64_t a, uint64_t b)
{
    uint64_t hash = 0;
    for (const char *c = report->rule->id; *c; c++)
        hash = mix(hash, (unsigned char)*c);
    return mix(mix(hash, a), b);
}

bool gn_report_is_new(struct gn_report *report, uint64_t site)
{
    return !report->repeated || !report->repeated(report->context, report->rule, site);
}

void gn_report_add(struct gn_report *report, uint64_t site, const struct gn_object *objects, uint32_t object_count,
                   const char *format, ...)
{
    char message[2048];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);

    struct gn_finding finding = {
        .rule = report->rule, .severity = report->rule->severity[report->profile], .message = message};
    finding.object_count = object_count < GN_FINDING_MAX_OBJECTS ? object_count : GN_FINDING_MAX_OBJECTS;
    memcpy(finding.objects, objects, finding.object_count * sizeof *objects);
    report->finding(report->context, site, &finding);
}

const char *gn_object_describe(const struct gn_object *object, char *out, size_t size)
{
    if (object->name && object->name[0])
        snprintf(out, size, "%s \"%s\" (0x%llx)", gn_object_kind_name(object->kind), object->name,
                 (unsigned long long)object->handle);
    else
        snprintf(out, size, "%s 0x%llx", gn_object_kind_name(object->kind), (unsigned long long)object->handle);
    return out;
}
