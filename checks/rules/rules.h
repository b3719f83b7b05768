/* SPDX-License-Identifier: Apache-2.0 */
/* The catalogue of rules and the way to run them over values (values.h). No Vulkan call and no I/O happens
 * here: values go in, findings come out through a callback. Everything is immutable and thread-safe. */
#ifndef GN_CHECKS_RULES_RULES_H
#define GN_CHECKS_RULES_RULES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "checks/rules/values.h"

#ifdef __cplusplus
extern "C" {
#endif

enum gn_profile {
#define GN_PROFILE(enumerator, name, label) GN_PROFILE_##enumerator,
#include "checks/rules/profiles.def"
#undef GN_PROFILE
    GN_PROFILE_COUNT
};

/* In rising order. SILENT: the rule does not apply in that profile and is not evaluated. */
enum gn_severity { GN_SEVERITY_SILENT, GN_SEVERITY_NOTE, GN_SEVERITY_WARNING, GN_SEVERITY_ERROR, GN_SEVERITY_COUNT };

/* Names as settings and logs write them ("wgpu", "error", "BLAS"). A value out of range gives "?". */
const char *gn_profile_name(enum gn_profile profile);
const char *gn_severity_name(enum gn_severity severity);
const char *gn_object_kind_name(enum gn_object_kind kind);

/* The opposite direction; false when the name is not known, and then *out stays as it was. */
bool gn_profile_parse(const char *name, enum gn_profile *out);
bool gn_severity_parse(const char *name, enum gn_severity *out);

struct gn_rule;
struct gn_report;
struct gn_geometry_contents;
struct gn_geometry_survey;

/* What a rule is about: which values its test takes. */
enum gn_rule_event {
    GN_RULE_ON_TLAS_BUILD,
    GN_RULE_ON_COMMAND,
    GN_RULE_ON_INPUT,
    GN_RULE_ON_CLASH,
    GN_RULE_ON_USE,
    GN_RULE_ON_HAZARD,
    GN_RULE_ON_REFIT,
    GN_RULE_ON_DEMAND,
    GN_RULE_ON_GEOMETRY,
    GN_RULE_ON_SBT
};

#define GN_RULE_MAX_SOURCES 16

/* One rule. `id` is dotted and stable: settings, logs and expectation files use it. `text` states what is
 * required, `remedy` is one sentence that says what to change. `sources` ends at the first NULL: valid-usage ids of
 * Vulkan, titles of its sections ("Vulkan: Shader Binding Table"), and clause ids. */
struct gn_rule {
    const char *id;
    const char *title;
    const char *text;
    const char *remedy;
    const char *sources[GN_RULE_MAX_SOURCES + 1];
    enum gn_severity severity[GN_PROFILE_COUNT];
    enum gn_rule_event on;
    bool surveys; /* of a TLAS build: the test reads the survey of its instances */
    uint32_t commands; /* of a command: one bit per kind that the rule is about */
    union {
        void (*command)(const struct gn_command *command, struct gn_report *report);
        void (*input)(const struct gn_input *input, struct gn_report *report);
        void (*clash)(const struct gn_clash *clash, struct gn_report *report);
        void (*refit)(const struct gn_refit *refit, struct gn_report *report);
        void (*hazard)(const struct gn_hazard *hazard, struct gn_report *report);
        void (*use)(const struct gn_trouble *use, struct gn_report *report);
        void (*demand)(const struct gn_demand *demand, struct gn_report *report);
        void (*sbt)(const struct gn_sbt *sbt, struct gn_report *report);
        void (*geometry)(const struct gn_geometry_contents *contents, struct gn_report *report);
        void (*tlas_build)(const struct gn_tlas_build *build, struct gn_report *report);
    } test;
};

/* All rules, in the order of catalogue.def. */
size_t gn_rules_count(void);
const struct gn_rule *gn_rules_at(size_t index);
/* By id; NULL when unknown. */
const struct gn_rule *gn_rules_find(const char *id);
/* Whether `pattern` names the rule: its id, or a pattern in which '*' stands for any run of characters. */
bool gn_rule_matches(const struct gn_rule *rule, const char *pattern);

/* A set of rules to evaluate, one bit per index of the catalogue. */
struct gn_rule_set {
    uint64_t bits[4];
};
struct gn_rule_set gn_rule_set_all(void);
bool gn_rule_set_has(const struct gn_rule_set *set, size_t index);
void gn_rule_set_put(struct gn_rule_set *set, size_t index, bool on);

#define GN_FINDING_MAX_OBJECTS 4

/* One finding. All strings live only until the callback returns. `message` says what was expected and what was
 * found, with values; it does not repeat the remedy. */
struct gn_finding {
    const struct gn_rule *rule;
    enum gn_severity severity;
    const char *message;
    uint32_t object_count;
    struct gn_object objects[GN_FINDING_MAX_OBJECTS];
};

/* Where findings go. `site` is a hash of what makes two findings the same to a reader (the rule and the ids of the
 * objects, say); `repeated` is asked first and returns true when that site is already known, having counted it: the rule
 * then spares itself the message. */
struct gn_report {
    enum gn_profile profile;
    struct gn_rule_set enabled;
    void *context;
    bool (*repeated)(void *context, const struct gn_rule *rule, uint64_t site);
    void (*finding)(void *context, uint64_t site, const struct gn_finding *finding);
    const struct gn_rule *rule;   /* the rule now running; the library sets it */
    const struct gn_survey *survey; /* of the TLAS build that is judged (survey.h); the library sets it */
    const struct gn_geometry_survey *geometry; /* of the geometry that is judged (geometry.h); the library sets it */
    struct gn_rule_set evaluated; /* the library adds every rule that it ran */
};

/* Runs every enabled rule about TLAS builds that applies in the report's profile. */
void gn_rules_judge_tlas_build(const struct gn_tlas_build *build, struct gn_report *report);

/* The same for rules about commands. gn_rules_about_command says beforehand whether there are any. */
void gn_rules_judge_command(const struct gn_command *command, struct gn_report *report);
void gn_rules_judge_input(const struct gn_input *input, struct gn_report *report);
void gn_rules_judge_clash(const struct gn_clash *clash, struct gn_report *report);
void gn_rules_judge_refit(const struct gn_refit *refit, struct gn_report *report);
void gn_rules_judge_hazard(const struct gn_hazard *hazard, struct gn_report *report);
void gn_rules_judge_use(const struct gn_trouble *use, struct gn_report *report);
void gn_rules_judge_demand(const struct gn_demand *demand, struct gn_report *report);
void gn_rules_judge_sbt(const struct gn_sbt *sbt, struct gn_report *report);
void gn_rules_judge_geometry(const struct gn_geometry_contents *contents, struct gn_report *report);
bool gn_rules_about_command(enum gn_command_kind kind, const struct gn_rule_set *enabled, enum gn_profile profile);

/* For rules: the same severity in every profile. */
#define GN_EVERYWHERE(level)                                                                                           \
    {                                                                                                                  \
        [GN_PROFILE_VULKAN] = level, [GN_PROFILE_WGPU] = level, [GN_PROFILE_WEBGPU_RT] = level,                        \
        [GN_PROFILE_DILIGENT] = level, [GN_PROFILE_HGI] = level                                                        \
    }

/* For rules: asks whether the site made of `rule` and two ids is new, and reports a finding there.
 * The message is formatted like printf. */
uint64_t gn_report_site(const struct gn_report *report, uint64_t a, uint64_t b);
bool gn_report_is_new(struct gn_report *report, uint64_t site);
void gn_report_add(struct gn_report *report, uint64_t site, const struct gn_object *objects, uint32_t object_count,
                   const char *format, ...) __attribute__((format(printf, 5, 6)));

/* Writes an object as messages show it: `BLAS "tree" (0x1234)`, without the name when it has none. Always
 * terminates; returns `out`. */
const char *gn_object_describe(const struct gn_object *object, char *out, size_t size);

#ifdef __cplusplus
}
#endif
#endif
