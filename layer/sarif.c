/* SPDX-License-Identifier: Apache-2.0 */
/* The SARIF document: one run, whose rules are those of the layer and of shaders. Results are put before the closing brackets, so that the file is whole
 * after each of them, and stays so when the process is killed. */
#include "layer/sarif.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

#include "layer/log.h"
#include "layer/shader.h"

#define COUNT_DIGITS 20

struct gn_sarif {
    struct gn_log *log;
    uint32_t references;
    uint64_t results;
    struct gn_text invocations;
    struct gn_sarif *next;
};

/* Documents of this process. One that was closed stays known, so that a later instance adds to it. */
static pthread_mutex_t documents_lock = PTHREAD_MUTEX_INITIALIZER;
static struct gn_sarif *documents;

/* Both catalogues, one after the other; NULL behind the last. */
static const struct gn_rule *rule_at(size_t index)
{
    size_t shaders = gn_rules_count();
    return index < shaders                         ? gn_rules_at(index)
           : index - shaders < GN_SPIRV_RULE_COUNT ? gn_shader_rule((enum gn_spirv_rule_index)(index - shaders))
                                                   : NULL;
}

static void add_rule(struct gn_text *text, const struct gn_rule *rule, enum gn_profile profile)
{
    enum gn_severity severity = rule->severity[profile];
    gn_text_add(text, "{\"id\":\"%s\",\"shortDescription\":{\"text\":", rule->id);
    gn_text_add_string(text, rule->title);
    gn_text_add(text, "},\"fullDescription\":{\"text\":");
    gn_text_add_string(text, rule->text);
    gn_text_add(text, "},\"help\":{\"text\":");
    gn_text_add_string(text, rule->remedy);
    gn_text_add(text, "},\"defaultConfiguration\":{\"enabled\":%s,\"level\":\"%s\"},\"properties\":{\"sources\":[",
                severity == GN_SEVERITY_SILENT ? "false" : "true",
                severity == GN_SEVERITY_SILENT ? "none" : gn_severity_name(severity));
    for (uint32_t i = 0; rule->sources[i]; i++)
        gn_text_add(text, "%s\"%s\"", i ? "," : "", rule->sources[i]);
    gn_text_add(text, "]}}");
}

static void add_head(struct gn_text *text, enum gn_profile profile)
{
    gn_text_add(text, "{\"$schema\":\"https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json\","
                      "\"version\":\"2.1.0\",\"runs\":[{\"tool\":{\"driver\":{\"name\":\"Gnomon\",\"fullName\":\"Gnomon, Vulkan layer, "
                      "profile %s\",\"rules\":[\n",
                gn_profile_name(profile));
    for (size_t i = 0; rule_at(i); i++) {
        gn_text_add(text, "%s", i ? ",\n" : "");
        add_rule(text, rule_at(i), profile);
    }
    gn_text_add(text, "]}},\"results\":[");
}

/* What closes the document after the last result. */
static void add_tail(struct gn_text *text, const struct gn_sarif *sarif)
{
    gn_text_add(text, "\n]");
    if (sarif->invocations.size) {
        gn_text_add(text, ",\"invocations\":[");
        gn_text_add_all(text, sarif->invocations.data, sarif->invocations.size);
        gn_text_add(text, "]");
    }
    gn_text_add(text, "}]}\n");
}

/* With the documents locked. */
static int64_t insert(struct gn_sarif *sarif, const struct gn_text *text)
{
    int64_t place = -1;
    struct gn_text tail = {0};
    add_tail(&tail, sarif);
    if (!text->failed && !tail.failed)
        place = gn_log_insert(sarif->log, text->data ? text->data : "", text->size, tail.data, tail.size);
    gn_text_finish(&tail);
    return place;
}

struct gn_sarif *gn_sarif_open(const char *path, enum gn_profile profile, char *problem, size_t problem_size)
{
    struct gn_text head = {0};
    struct gn_sarif *sarif = NULL;
    struct gn_log *log = gn_log_open(path, "sarif_file", problem, problem_size);
    if (!log)
        return NULL;
    pthread_mutex_lock(&documents_lock);
    for (sarif = documents; sarif && sarif->log != log;)
        sarif = sarif->next;
    if (!sarif && (sarif = calloc(1, sizeof *sarif))) {
        sarif->log = log;
        add_head(&head, profile);
        if (insert(sarif, &head) < 0) {
            snprintf(problem, problem_size, "sarif_file: expected a regular file, found \"%s\". The file is left out.", path);
            free(sarif);
            sarif = NULL;
            goto fail;
        }
        sarif->next = documents;
        documents = sarif;
    }
    if (!sarif) {
        snprintf(problem, problem_size, "sarif_file: out of memory. The file is left out.");
        goto fail;
    }
    sarif->references++;
    log = NULL;
fail:
    pthread_mutex_unlock(&documents_lock);
    gn_log_close(log);
    gn_text_finish(&head);
    return sarif;
}

static size_t index_of(const struct gn_rule *rule)
{
    size_t i = 0;
    while (rule_at(i) && rule_at(i) != rule)
        i++;
    return i;
}

int64_t gn_sarif_finding(struct gn_sarif *sarif, const struct gn_finding *finding, uint64_t site, uint64_t count)
{
    struct gn_text text = {0};
    pthread_mutex_lock(&documents_lock);
    gn_text_add(&text, "%s{\"ruleId\":\"%s\",\"ruleIndex\":%zu,\"level\":\"%s\",\"occurrenceCount\":", sarif->results ? ",\n" : "\n",
                finding->rule->id, index_of(finding->rule), gn_severity_name(finding->severity));
    size_t count_at = text.size;
    gn_text_add(&text, "%-*llu,\"message\":{\"text\":", COUNT_DIGITS, (unsigned long long)count);
    gn_text_add_string(&text, finding->message);
    gn_text_add(&text, "},\"locations\":[{\"logicalLocations\":[");
    for (uint32_t i = 0; i < finding->object_count; i++) {
        const struct gn_object *object = &finding->objects[i];
        char name[256];
        gn_text_add(&text, "%s{\"name\":", i ? "," : "");
        gn_text_add_string(&text, gn_object_describe(object, name, sizeof name));
        gn_text_add(&text, ",\"kind\":\"%s\"}", gn_object_kind_name(object->kind));
    }
    gn_text_add(&text, "]}],\"partialFingerprints\":{\"gnomonSite/v1\":\"%016llx\"}}", (unsigned long long)site);
    int64_t place = insert(sarif, &text);
    sarif->results += place >= 0;
    pthread_mutex_unlock(&documents_lock);
    gn_text_finish(&text);
    return place < 0 ? -1 : place + (int64_t)count_at;
}

void gn_sarif_recount(struct gn_sarif *sarif, int64_t place, uint64_t count)
{
    gn_log_recount(sarif->log, place, count);
}

void gn_sarif_statement(struct gn_sarif *sarif, const char *statement)
{
    struct gn_text nothing = {0};
    pthread_mutex_lock(&documents_lock);
    gn_text_add(&sarif->invocations, "%s{\"executionSuccessful\":true,\"properties\":%s}", sarif->invocations.size ? "," : "",
                statement);
    insert(sarif, &nothing);
    pthread_mutex_unlock(&documents_lock);
}

void gn_sarif_close(struct gn_sarif *sarif)
{
    if (!sarif)
        return;
    pthread_mutex_lock(&documents_lock);
    sarif->references--;
    gn_log_close(sarif->log);
    pthread_mutex_unlock(&documents_lock);
}

__attribute__((destructor)) static void forget_documents(void)
{
    for (struct gn_sarif *sarif = documents, *next; sarif; sarif = next) {
        next = sarif->next;
        if (sarif->references == 0) {
            gn_text_finish(&sarif->invocations);
            free(sarif);
        }
    }
    documents = NULL;
}
