/* SPDX-License-Identifier: Apache-2.0 */
/* Findings on their way out: told apart by site and counted, then given to the application's messengers, to stderr and to
 * the log. And the closing statement: what was checked, what was not, and why. */
#include "layer/layer.h"
#include "layer/log.h"
#include "layer/sarif.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* A finding at one site, however often it recurs. */
struct gn_site {
    uint64_t count;
    int64_t place, sarif_place; /* of the count in the files, -1 before it is there */
};

struct gn_pending_finding {
    struct gn_finding finding;
    uint64_t site;
    struct gn_pending_finding *next;
    /* the message and the names of the objects follow */
};

struct collector {
    struct gn_instance *instance;
    struct gn_findings *findings;
};

void gn_findings_init(struct gn_findings *findings)
{
    findings->first = NULL;
    findings->last = &findings->first;
}

/* The first of each power of two of a count goes to the log at once, so that a killed process leaves nearly the right
 * number; the closing of the log writes the last one. */
static void recount(struct gn_instance *instance, const struct gn_site *site)
{
    if (instance->log)
        gn_log_recount(instance->log, site->place, site->count);
    if (instance->sarif)
        gn_sarif_recount(instance->sarif, site->sarif_place, site->count);
}

static bool count_site(struct gn_instance *instance, uint64_t key, uint64_t times)
{
    bool known = true;
    pthread_mutex_lock(&instance->lock);
    struct gn_site *site = gn_map_get(&instance->sites, key);
    instance->findings += times;
    if (site) {
        uint64_t before = site->count;
        site->count += times;
        if ((before ^ site->count) > before) /* a higher bit */
            recount(instance, site);
    } else {
        known = false;
        site = malloc(sizeof *site);
        if (site) {
            *site = (struct gn_site){.count = times, .place = -1, .sarif_place = -1};
            if (!gn_map_put(&instance->sites, key, site))
                free(site);
        }
    }
    pthread_mutex_unlock(&instance->lock);
    return known;
}

static bool repeated(void *context, const struct gn_rule *rule, uint64_t key)
{
    (void)rule;
    return count_site(((struct collector *)context)->instance, key, 1);
}

static void collect(void *context, uint64_t site, const struct gn_finding *finding)
{
    struct gn_findings *out = ((struct collector *)context)->findings;
    size_t size = sizeof(struct gn_pending_finding) + strlen(finding->message) + 1;
    for (uint32_t i = 0; i < finding->object_count; i++)
        size += finding->objects[i].name ? strlen(finding->objects[i].name) + 1 : 0;
    struct gn_pending_finding *pending = malloc(size);
    if (!pending)
        return;
    *pending = (struct gn_pending_finding){.finding = *finding, .site = site};
    char *text = (char *)(pending + 1);
    pending->finding.message = strcpy(text, finding->message);
    text += strlen(text) + 1;
    for (uint32_t i = 0; i < finding->object_count; i++)
        if (finding->objects[i].name) {
            pending->finding.objects[i].name = strcpy(text, finding->objects[i].name);
            text += strlen(text) + 1;
        }
    *out->last = pending;
    out->last = &pending->next;
}

static struct gn_report report_into(struct collector *collector)
{
    const struct gn_settings *settings = &collector->instance->settings;
    return (struct gn_report){.profile = settings->profile,
                              .enabled = settings->rules,
                              .context = collector,
                              .repeated = repeated,
                              .finding = collect};
}

static void count_evaluated(struct gn_instance *instance, const struct gn_report *report)
{
    pthread_mutex_lock(&instance->lock);
    for (size_t i = 0; i < gn_rules_count(); i++)
        instance->evaluated[i] += gn_rule_set_has(&report->evaluated, i);
    pthread_mutex_unlock(&instance->lock);
}

void gn_report_judge(struct gn_instance *instance, const struct gn_tlas_build *build, struct gn_findings *out)
{
    struct collector collector = {instance, out};
    struct gn_report report = report_into(&collector);
    gn_rules_judge_tlas_build(build, &report);
    count_evaluated(instance, &report);
}

void gn_report_sbt(struct gn_instance *instance, const struct gn_sbt *sbt, struct gn_findings *out)
{
    struct collector collector = {instance, out};
    struct gn_report report = report_into(&collector);
    gn_rules_judge_sbt(sbt, &report);
    count_evaluated(instance, &report);
}

void gn_report_demand(struct gn_instance *instance, const struct gn_demand *demand, struct gn_findings *out)
{
    struct collector collector = {instance, out};
    struct gn_report report = report_into(&collector);
    gn_rules_judge_demand(demand, &report);
    count_evaluated(instance, &report);
}

void gn_report_geometry(struct gn_instance *instance, const struct gn_geometry_contents *contents, struct gn_findings *out)
{
    struct collector collector = {instance, out};
    struct gn_report report = report_into(&collector);
    gn_rules_judge_geometry(contents, &report);
    count_evaluated(instance, &report);
}

void gn_report_found(struct gn_instance *instance, const struct gn_finding *finding, uint64_t site, uint64_t times,
                     struct gn_findings *out)
{
    struct collector collector = {instance, out};
    if (!count_site(instance, site, times))
        collect(&collector, site, finding);
}

struct gn_pending_finding *gn_findings_take(struct gn_findings *findings)
{
    struct gn_pending_finding *first = findings->first;
    if (first && !(findings->first = first->next))
        findings->last = &findings->first;
    return first;
}

/* The first run only asks whether there is anything to find. */
static bool suspected(void *context, const struct gn_rule *rule, uint64_t site)
{
    (void)rule, (void)site;
    return *(bool *)context = true;
}

void gn_report_suspect(struct gn_instance *instance, const struct gn_suspect *suspect, struct gn_findings *out)
{
    bool any = false;
    struct gn_report report = {.profile = instance->settings.profile,
                               .enabled = instance->settings.rules,
                               .context = &any,
                               .repeated = suspected};
    suspect->judge(suspect->value, &report);
    if (any) {
        struct collector collector = {instance, out};
        *suspect->place = suspect->make_place(suspect->context);
        report.context = &collector;
        report.repeated = NULL;
        report.finding = collect;
        suspect->judge(suspect->value, &report);
        *suspect->place = NULL;
    }
    count_evaluated(instance, &report);
}

void gn_report_confirm(struct gn_instance *instance, struct gn_pending_finding *finding, struct gn_findings *out)
{
    struct collector collector = {instance, out};
    if (repeated(&collector, finding->finding.rule, finding->site)) {
        free(finding);
        return;
    }
    finding->next = NULL;
    *out->last = finding;
    out->last = &finding->next;
}

static VkDebugUtilsMessageSeverityFlagBitsEXT severity_bit(enum gn_severity severity)
{
    return severity == GN_SEVERITY_ERROR     ? VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT
           : severity == GN_SEVERITY_WARNING ? VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT
                                             : VK_DEBUG_UTILS_MESSAGE_SEVERITY_INFO_BIT_EXT;
}

static VkObjectType object_type(enum gn_object_kind kind)
{
    switch (kind) {
    case GN_OBJECT_BLAS:
    case GN_OBJECT_TLAS:
    case GN_OBJECT_STRUCTURE:
        return VK_OBJECT_TYPE_ACCELERATION_STRUCTURE_KHR;
    case GN_OBJECT_BUFFER:
        return VK_OBJECT_TYPE_BUFFER;
    case GN_OBJECT_COMMAND_BUFFER:
        return VK_OBJECT_TYPE_COMMAND_BUFFER;
    case GN_OBJECT_QUEUE:
        return VK_OBJECT_TYPE_QUEUE;
    case GN_OBJECT_DEVICE:
        return VK_OBJECT_TYPE_DEVICE;
    case GN_OBJECT_PIPELINE:
        return VK_OBJECT_TYPE_PIPELINE;
    case GN_OBJECT_SHADER_MODULE:
        return VK_OBJECT_TYPE_SHADER_MODULE;
    case GN_OBJECT_SHADER:
        return VK_OBJECT_TYPE_SHADER_EXT;
    default:
        return VK_OBJECT_TYPE_UNKNOWN;
    }
}

/* The messengers of instance creation speak only while an instance is created or destroyed. Vulkan forbids destroying a
 * messenger while another thread is in a command of the instance, so a copy of the list is safe. */
static void send(struct gn_instance *instance, bool creation_messengers, VkDebugUtilsMessageTypeFlagsEXT type,
                 enum gn_severity severity, const char *id, const char *text, const struct gn_object *objects,
                 uint32_t object_count)
{
    VkDebugUtilsObjectNameInfoEXT names[GN_FINDING_MAX_OBJECTS];
    for (uint32_t i = 0; i < object_count; i++)
        names[i] = (VkDebugUtilsObjectNameInfoEXT){.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_OBJECT_NAME_INFO_EXT,
                                                   .objectType = object_type(objects[i].kind),
                                                   .objectHandle = objects[i].handle,
                                                   .pObjectName = objects[i].name};
    int32_t number = 0;
    for (const char *c = id; *c; c++)
        number = (int32_t)((uint32_t)number * 31u + (unsigned char)*c);
    VkDebugUtilsMessengerCallbackDataEXT data = {
        .sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CALLBACK_DATA_EXT,
        .pMessageIdName = id,
        .messageIdNumber = number,
        .pMessage = text,
        .objectCount = object_count,
        .pObjects = object_count ? names : NULL,
    };

    pthread_mutex_lock(&instance->lock);
    uint32_t count = instance->messenger_count;
    struct gn_messenger *messengers = count ? malloc(count * sizeof *messengers) : NULL;
    if (messengers)
        memcpy(messengers, instance->messengers, count * sizeof *messengers);
    pthread_mutex_unlock(&instance->lock);
    for (uint32_t i = 0; messengers && i < count; i++)
        if ((messengers[i].handle != VK_NULL_HANDLE || creation_messengers) &&
            (messengers[i].severities & severity_bit(severity)) && (messengers[i].types & type))
            messengers[i].callback(severity_bit(severity), type, &data, messengers[i].user_data);
    free(messengers);
}

void gn_report_flush(struct gn_instance *instance, struct gn_findings *findings)
{
    for (struct gn_pending_finding *pending = findings->first, *next; pending; pending = next) {
        next = pending->next;
        const struct gn_finding *finding = &pending->finding;
        if (finding->severity >= instance->settings.severity_floor) {
            pthread_mutex_lock(&instance->lock);
            struct gn_site *site = gn_map_get(&instance->sites, pending->site), none = {.count = 1};
            if (!site)
                site = &none;
            if (instance->log)
                site->place = gn_log_finding(instance->log, finding, site->count);
            if (instance->sarif)
                site->sarif_place = gn_sarif_finding(instance->sarif, finding, pending->site, site->count);
            unsigned long long told = instance->sites_reported++, cap = instance->settings.report_cap;
            pthread_mutex_unlock(&instance->lock);
            if (cap && told >= cap) {
                free(pending);
                if (told == cap)
                    gn_report_say(instance, GN_SEVERITY_NOTE, "report_cap",
                                  "as many findings were told as the setting report_cap allows. The rest is counted, and goes to the "
                                  "files.");
                continue;
            }

            struct gn_text text = {0};
            gn_text_add(&text, "%s\nRemedy: %s\nSource:", finding->message, finding->rule->remedy);
            for (uint32_t i = 0; finding->rule->sources[i]; i++)
                gn_text_add(&text, " %s", finding->rule->sources[i]);
            const char *message = text.failed ? finding->message : text.data;
            if (instance->settings.report_stderr)
                fprintf(stderr, "gnomon: %s: %s: %s\n", gn_severity_name(finding->severity), finding->rule->id, message);
            send(instance, false, VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT, finding->severity, finding->rule->id,
                 message, finding->objects, finding->object_count);
            gn_text_finish(&text);
        }
        free(pending);
    }
    gn_findings_init(findings);
}

void gn_report_say(struct gn_instance *instance, enum gn_severity severity, const char *id, const char *text)
{
    if (severity < instance->settings.severity_floor)
        return;
    if (instance->settings.report_stderr)
        fprintf(stderr, "gnomon: %s: %s: %s\n", gn_severity_name(severity), id, text);
    send(instance, true, VK_DEBUG_UTILS_MESSAGE_TYPE_GENERAL_BIT_EXT, severity, id, text, NULL, 0);
    /* A warning goes into the log too, with the keys of a finding: who reads only that has to know of it. */
    if (!instance->log || severity < GN_SEVERITY_WARNING)
        return;
    struct gn_text line = {0};
    gn_text_add(&line, "{\"rule\":");
    gn_text_add_string(&line, id);
    gn_text_add(&line, ",\"severity\":\"%s\",\"count\":1,\"message\":", gn_severity_name(severity));
    gn_text_add_string(&line, text);
    gn_text_add(&line, ",\"remedy\":\"\",\"objects\":[],\"source\":[]}");
    if (!line.failed)
        gn_log_line(instance->log, line.data, line.size);
    gn_text_finish(&line);
}

static const char *const checked_names[] = {
#define GN_CHECKED(name, what) what,
#include "layer/tally.def"
};

static const struct {
    const char *what, *why;
} unjudged_names[] = {
#define GN_UNJUDGED(name, what, why) {what, why},
#include "layer/tally.def"
};

static void add_statement(struct gn_instance *instance, struct gn_text *text, const char *ending)
{
    gn_text_add(text, "{\"statement\":{\"profile\":\"%s\",\"ending\":", gn_profile_name(instance->settings.profile));
    gn_text_add_string(text, ending);
    gn_text_add(text,
                ",\"findings\":%llu,\"sites\":%zu,\"devices\":{\"judged\":%u,\"passed_through\":%u},\"checked\":[",
                instance->findings, instance->sites.count, atomic_load(&instance->tracked_devices),
                atomic_load(&instance->passed_devices));
    for (int i = 0; i < GN_CHECKED_COUNT; i++)
        gn_text_add(text, "%s{\"what\":\"%s\",\"count\":%llu}", i ? "," : "", checked_names[i],
                    atomic_load(&instance->tally.checked[i]));
    gn_text_add(text, "],\"not_checked\":[");
    const char *comma = "";
    for (int i = 0; i < GN_UNJUDGED_COUNT; i++) {
        unsigned long long count = atomic_load(&instance->tally.unjudged[i]);
        if (count) {
            gn_text_add(text, "%s{\"what\":\"%s\",\"count\":%llu,\"why\":\"%s\"}", comma, unjudged_names[i].what, count,
                        unjudged_names[i].why);
            comma = ",";
        }
    }
    for (uint32_t i = 0; i < instance->unjudged_extension_count; i++) {
        gn_text_add(text, "%s{\"what\":\"%s\",\"why\":\"the extension is recognised but its commands are not judged\"}", comma,
                    instance->unjudged_extensions[i]);
        comma = ",";
    }
    gn_text_add(text, "],\"rules\":[");
    for (size_t i = 0; i < gn_rules_count(); i++)
        gn_text_add(text, "%s{\"rule\":\"%s\",\"evaluated\":%llu}", i ? "," : "", gn_rules_at(i)->id,
                    instance->evaluated[i]);
    gn_text_add(text, "],\"shaders\":[");
    for (uint32_t i = 0; i < instance->stated_count; i++)
        gn_text_add(text, "%s%s", i ? "," : "", instance->stated[i]);
    gn_text_add(text, "]}}");
}

/* The statement in one paragraph for people. */
static void add_summary(struct gn_instance *instance, struct gn_text *text)
{
    gn_text_add(text, "%llu finding%s at %zu site%s. Checked:", instance->findings, instance->findings == 1 ? "" : "s",
                instance->sites.count, instance->sites.count == 1 ? "" : "s");
    for (int i = 0; i < GN_CHECKED_COUNT; i++)
        gn_text_add(text, "%s %llu %s", i ? "," : "", atomic_load(&instance->tally.checked[i]), checked_names[i]);
    gn_text_add(text, ". Not checked:");
    const char *comma = "";
    for (int i = 0; i < GN_UNJUDGED_COUNT; i++) {
        unsigned long long count = atomic_load(&instance->tally.unjudged[i]);
        if (count) {
            gn_text_add(text, "%s %llu %s (%s)", comma, count, unjudged_names[i].what, unjudged_names[i].why);
            comma = ",";
        }
    }
    for (uint32_t i = 0; i < instance->unjudged_extension_count; i++) {
        gn_text_add(text, "%s %s", comma, instance->unjudged_extensions[i]);
        comma = ",";
    }
    size_t idle = 0;
    for (size_t i = 0; i < gn_rules_count(); i++)
        idle += !instance->evaluated[i];
    gn_text_add(text, "%s.", *comma ? "" : " nothing was left out");
    if (idle)
        gn_text_add(text, " %zu of %zu rules had nothing to judge, or are switched off (the log names them).", idle,
                    gn_rules_count());
}

/* The statement to the files; its summary for people is left to the caller. */
static void state(struct gn_instance *instance, const char *ending, bool last, struct gn_text *out_summary)
{
    struct gn_text statement = {0};
    pthread_mutex_lock(&instance->lock);
    if (instance->closed)
        goto done;
    instance->closed = last;
    add_statement(instance, &statement, ending);
    /* An application that never touched an acceleration structure hears nothing. */
    if (atomic_load(&instance->tracked_devices))
        add_summary(instance, out_summary);
    size_t cursor = 0;
    const struct gn_site *site;
    while ((site = gn_map_next(&instance->sites, &cursor)))
        recount(instance, site);
    if (instance->log && !statement.failed)
        gn_log_line(instance->log, statement.data, statement.size);
    if (instance->sarif && !statement.failed && last)
        gn_sarif_statement(instance->sarif, statement.data);
done:
    pthread_mutex_unlock(&instance->lock);
    gn_text_finish(&statement);
}

void gn_report_close(struct gn_instance *instance, const char *ending)
{
    struct gn_text summary = {0};
    state(instance, ending, true, &summary);
    if (summary.data && !summary.failed)
        gn_report_say(instance, GN_SEVERITY_NOTE, "statement", summary.data);
    gn_text_finish(&summary);
}

void gn_report_state(struct gn_instance *instance, const char *ending)
{
    struct gn_text summary = {0};
    state(instance, ending, false, &summary);
    if (summary.data && !summary.failed && instance->settings.report_stderr)
        fprintf(stderr, "gnomon: note: statement: %s: %s\n", ending, summary.data);
    gn_text_finish(&summary);
}

void gn_messenger_add(struct gn_instance *instance, VkDebugUtilsMessengerEXT handle,
                      const VkDebugUtilsMessengerCreateInfoEXT *info)
{
    pthread_mutex_lock(&instance->lock);
    struct gn_messenger *grown =
        realloc(instance->messengers, (instance->messenger_count + 1) * sizeof *instance->messengers);
    if (grown) {
        instance->messengers = grown;
        grown[instance->messenger_count++] = (struct gn_messenger){.handle = handle,
                                                                   .severities = info->messageSeverity,
                                                                   .types = info->messageType,
                                                                   .callback = info->pfnUserCallback,
                                                                   .user_data = info->pUserData};
    }
    pthread_mutex_unlock(&instance->lock);
}

void gn_messenger_remove(struct gn_instance *instance, VkDebugUtilsMessengerEXT handle)
{
    pthread_mutex_lock(&instance->lock);
    for (uint32_t i = 0; i < instance->messenger_count; i++)
        if (instance->messengers[i].handle == handle) {
            instance->messengers[i] = instance->messengers[--instance->messenger_count];
            break;
        }
    pthread_mutex_unlock(&instance->lock);
}
