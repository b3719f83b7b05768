/* SPDX-License-Identifier: Apache-2.0 */
/* What shaders have recorded becomes findings; and what of which pipeline was checked goes into the closing statement. */
#include "layer/log.h"
#include "layer/shader.h"

#include <stdlib.h>
#include <string.h>

#include <spirv/unified1/spirv.h>

/* Entries of the closing statement; an application may create any number of pipelines. */
#define MAX_STATED 4096u

#define OF_STRUCTURES (~UINT64_C(0) << GN_SPIRV_RULE_STRUCTURE_NONE)

static struct gn_rule rules[GN_SPIRV_RULE_COUNT];
static pthread_once_t rules_once = PTHREAD_ONCE_INIT;

static void rules_make(void)
{
    for (int i = 0; i < GN_SPIRV_RULE_COUNT; i++) {
        const struct gn_spirv_rule *from = gn_spirv_rule_at((enum gn_spirv_rule_index)i);
        rules[i] = (struct gn_rule){.id = from->id, .title = from->title, .text = from->text, .remedy = from->remedy};
        memcpy(rules[i].sources, from->sources, sizeof rules[i].sources);
        memcpy(rules[i].severity, from->severity, sizeof rules[i].severity);
    }
}

const struct gn_rule *gn_shader_rule(enum gn_spirv_rule_index index)
{
    pthread_once(&rules_once, rules_make);
    return &rules[index];
}

/* The pipelines of a shader, and its modules; with the device locked, none if it is gone. */
static uint32_t find_objects(struct gn_device *device, const struct gn_shader *shader, struct gn_object *out, uint32_t room)
{
    uint32_t count = 0;
    const struct gn_pipeline *pipeline;
    const struct gn_module *module;
    if (!device)
        return 0;
    for (size_t cursor = 0; count + 1 < room && (pipeline = gn_map_next(&device->shaders->pipelines, &cursor));)
        for (uint32_t i = 0; i < pipeline->stage_count; i++)
            if (pipeline->stages[i].shader == shader) {
                out[count++] = (struct gn_object){pipeline->is_object ? GN_OBJECT_SHADER : GN_OBJECT_PIPELINE, pipeline->handle,
                                                  pipeline->name};
                break;
            }
    for (size_t cursor = 0; count < room && (module = gn_map_next(&device->shaders->modules, &cursor));)
        if (module->shader == shader || module->shader == shader->judged)
            out[count++] = (struct gn_object){GN_OBJECT_SHADER_MODULE, (uint64_t)module->handle, module->name};
    return count;
}

static void add_place(struct gn_text *text, const struct gn_spirv_place *place)
{
    if (place->file && place->line)
        gn_text_add(text, "%s:%u", place->file, place->line);
    else if (place->function)
        gn_text_add(text, "function %s, block %%%u, word %u", place->function, place->block_id, place->offset);
    else
        gn_text_add(text, "function %%%u, block %%%u, word %u", place->function_id, place->block_id, place->offset);
}

static void add_subject(struct gn_text *text, const struct gn_spirv_site *site)
{
    gn_text_add(text, "%s", site->operation);
    if (site->query && *site->query)
        gn_text_add(text, " on %s", site->query);
}

static void add_objects(struct gn_text *text, const struct gn_object *objects, uint32_t count)
{
    char name[256];
    for (uint32_t i = 0; i < count; i++)
        gn_text_add(text, "%s%s", i ? ", " : ", in ", gn_object_describe(&objects[i], name, sizeof name));
}

static float as_float(uint32_t bits)
{
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void add_invocation(struct gn_text *text, uint32_t model, const uint32_t words[3])
{
    switch (model) {
    case SpvExecutionModelVertex: gn_text_add(text, "vertex %u of instance %u", words[0], words[1]); break;
    case SpvExecutionModelFragment:
        gn_text_add(text, "the fragment at (%g, %g)", (double)as_float(words[0]), (double)as_float(words[1]));
        break;
    case SpvExecutionModelTessellationControl:
    case SpvExecutionModelTessellationEvaluation:
    case SpvExecutionModelGeometry: gn_text_add(text, "an invocation that cannot be told"); break;
    default: gn_text_add(text, "invocation (%u, %u, %u)", words[0], words[1], words[2]); break;
    }
}

static void add_vector(struct gn_text *text, const char *what, const uint32_t words[3])
{
    gn_text_add(text, ", %s (%.9g, %.9g, %.9g)", what, (double)as_float(words[0]), (double)as_float(words[1]),
                (double)as_float(words[2]));
}

static void add_operands(struct gn_text *text, const char *operation, enum gn_spirv_rule_index rule,
                         const uint32_t words[GN_RECORD_OPERANDS])
{
    if (strstr(operation, "Initialize") || (rule >= GN_SPIRV_RULE_TRACE_NAN && rule <= GN_SPIRV_RULE_TRACE_MASK_BITS)) {
        gn_text_add(text, ", with flags 0x%x, mask 0x%x", words[0], words[1]);
        add_vector(text, "origin", words + 2);
        gn_text_add(text, ", tmin %.9g", (double)as_float(words[5]));
        add_vector(text, "direction", words + 6);
        gn_text_add(text, ", tmax %.9g", (double)as_float(words[9]));
    } else if (strstr(operation, "GenerateIntersection") && (words[0] | words[1] | words[2])) {
        gn_text_add(text, ", with t %.9g, tmin %.9g, nearest t so far %.9g", (double)as_float(words[0]),
                    (double)as_float(words[1]), (double)as_float(words[2]));
    } else if (rule == GN_SPIRV_RULE_TRACE_RECURSION && words[5]) {
        gn_text_add(text, ", from depth %u where %u is the most", words[4], words[5]);
    } else if (rule == GN_SPIRV_RULE_CALL_RANGE) {
        gn_text_add(text, ", with index %u where the table has %u record%s", words[0], words[1], words[1] == 1 ? "" : "s");
    } else if (rule == GN_SPIRV_RULE_REPORT_HIT_KIND || rule == GN_SPIRV_RULE_REPORT_NAN) {
        gn_text_add(text, ", with t %.9g, hit kind %u", (double)as_float(words[0]), words[1]);
    }
}

static uint64_t site_key(const struct gn_shader *shader, uint32_t site, uint32_t rule, bool ran)
{
    uint64_t key = shader->key;
    const uint64_t parts[] = {site, rule, ran};
    for (int i = 0; i < 3; i++) {
        key = (key ^ parts[i]) * UINT64_C(0x9E3779B97F4A7C15);
        key ^= key >> 32;
    }
    return key;
}

static void tell(const struct gn_records_teller *teller, const struct gn_shader *shader, uint32_t site, uint32_t rule, bool ran,
                 enum gn_severity severity, uint64_t times, const struct gn_text *text, struct gn_findings *out)
{
    struct gn_finding finding = {.rule = gn_shader_rule((enum gn_spirv_rule_index)rule), .severity = severity};
    finding.message = text->failed ? finding.rule->title : text->data;
    finding.object_count = find_objects(teller->device, shader, finding.objects, GN_FINDING_MAX_OBJECTS);
    gn_report_found(teller->instance, &finding, site_key(shader, site, rule, ran), times, out);
}

/* The structure that a record speaks of; with the device locked. */
static void add_structure(struct gn_device *device, struct gn_text *text, uint32_t rule, const uint32_t operands[4])
{
    const struct gn_as *as = device ? gn_structure_by_id(device, operands[3]) : NULL;
    char name[256];
    struct gn_object object = {as ? as->kind : GN_OBJECT_NONE, as ? (uint64_t)as->handle : 0, as ? as->name : NULL};
    if (rule != GN_SPIRV_RULE_STRUCTURE_NO_POSITIONS)
        gn_text_add(text, ", set %u, binding %u, element %u", operands[0], operands[1], operands[2]);
    else if (operands[0] != UINT32_MAX)
        gn_text_add(text, ", instance %u", operands[0]);
    if (as)
        gn_text_add(text, ": %s", gn_object_describe(&object, name, sizeof name));
}

static void tell_check(const struct gn_records_teller *teller, struct gn_shader *shader, uint32_t check,
                       const struct gn_records_check *found, struct gn_findings *out)
{
    uint32_t site_index;
    enum gn_spirv_rule_index rule;
    struct gn_text text = {0};
    struct gn_object objects[GN_FINDING_MAX_OBJECTS];
    if (!gn_spirv_check_find(&shader->result, check, &site_index, &rule))
        return;
    const struct gn_spirv_site *site = &shader->result.sites[site_index];
    if (teller->launch_unsure && gn_launch_matters(site, rule)) {
        atomic_fetch_add(&teller->instance->tally.unjudged[GN_UNJUDGED_launches], found->count - shader->told[check]);
        shader->told[check] = found->count;
        return;
    }
    /* Something may have been built that the table does not know of. */
    if ((UINT64_C(1) << rule & OF_STRUCTURES) && teller->device && atomic_load_explicit(&teller->device->incomplete, memory_order_relaxed)) {
        gn_tally_unjudged(teller->device, GN_UNJUDGED_unproven, found->count - shader->told[check]);
        shader->told[check] = found->count;
        return;
    }
    add_subject(&text, site);
    gn_text_add(&text, ": %s, at ", gn_shader_rule(rule)->title);
    add_place(&text, &site->place);
    add_objects(&text, objects, find_objects(teller->device, shader, objects, GN_FINDING_MAX_OBJECTS));
    gn_text_add(&text, ".");
    if (site->place.source)
        gn_text_add(&text, " The line: %s", site->place.source);
    for (uint32_t r = 0; r < found->record_count; r++) {
        if (!found->records[r].intact)
            continue;
        gn_text_add(&text, "%sFirst in ", site->place.source ? "\n" : " ");
        add_invocation(&text, shader->model, found->records[r].invocation);
        if (UINT64_C(1) << rule & OF_STRUCTURES)
            add_structure(teller->device, &text, rule, found->records[r].operands + (strstr(site->operation, "Initialize") ? 0 : 6));
        else
            add_operands(&text, site->operation, rule, found->records[r].operands);
        gn_text_add(&text, ".");
        break;
    }
    if (teller->remark)
        gn_text_add(&text, " %s", teller->remark);
    enum gn_severity severity = gn_shader_rule(rule)->severity[teller->instance->settings.profile];
    tell(teller, shader, site_index, rule, true, severity, found->count - shader->told[check], &text, out);
    shader->told[check] = found->count;
    gn_text_finish(&text);
}

bool gn_shader_collect(const struct gn_records_teller *teller, struct gn_shader *shader, struct gn_findings *out)
{
    bool all = true;
    for (uint32_t check = 0; shader->records && check < shader->result.check_count; check++) {
        struct gn_records_check found;
        if (!gn_records_read(shader->records, shader->record_words, check, &found) || found.count <= shader->told[check])
            continue;
        /* The first record may still be on its way. */
        if (!teller->last && !shader->told[check] && !found.records[0].intact) {
            all = false;
            continue;
        }
        tell_check(teller, shader, check, &found, out);
    }
    return all;
}

void gn_shaders_read(struct gn_device *device, bool lost, bool last)
{
    struct gn_shaders *shaders = device->shaders;
    struct gn_findings findings;
    struct gn_shader *shader;
    const uint32_t *root = shaders ? atomic_load_explicit(&shaders->root, memory_order_acquire) : NULL;
    if (!root)
        return;
    /* One word tells that there is nothing new. What it counts may come to the host in another order, hence the second look. */
    uint32_t fired = __atomic_load_n(&root[GN_ROOT_FIRED], __ATOMIC_ACQUIRE);
    if (fired == atomic_load_explicit(&shaders->fired, memory_order_relaxed) &&
        !atomic_load_explicit(&shaders->again, memory_order_relaxed) && !lost && !last)
        return;
    gn_findings_init(&findings);
    gn_lock(device);
    bool all = true;
    const struct gn_records_teller teller = {
        .instance = device->instance,
        .device = device,
        .remark = lost ? "Unverified: the device was lost, and this is what its memory held then." : NULL,
        .last = lost || last,
        .launch_unsure = shaders->launch_unsure};
    for (size_t cursor = 0; (shader = gn_map_next(&shaders->shaders, &cursor));)
        all &= gn_shader_collect(&teller, shader, &findings);
    atomic_store_explicit(&shaders->again, !all || fired != atomic_load(&shaders->fired), memory_order_relaxed);
    atomic_store_explicit(&shaders->fired, fired, memory_order_relaxed);
    if (last) {
        gn_tally_unjudged(device, GN_UNJUDGED_shader_records_lost, root[GN_ROOT_EMPTY + 1]);
    }
    gn_unlock(device);
    gn_report_flush(device->instance, &findings);
}

void gn_shaders_read_left(struct gn_device *device)
{
    bool own = device->shaders != NULL;
    for (const struct gn_record_memory *memory = own ? device->shaders->memory : NULL; memory; memory = memory->next)
        own &= memory->mapping != NULL;
    /* Whoever has the lock will not give it back. */
    if (!own || pthread_mutex_trylock(&device->lock) != 0)
        return;
    const struct gn_pipeline *pipeline;
    for (size_t cursor = 0; (pipeline = gn_map_next(&device->shaders->pipelines, &cursor));)
        gn_shader_state(device, pipeline);
    pthread_mutex_unlock(&device->lock);
    gn_shaders_read(device, false, true);
    gn_left_end(device->shaders->left);
    device->shaders->left = NULL;
}

static bool found_before(const struct gn_shader *judged, const struct gn_spirv_finding *finding)
{
    for (uint32_t f = 0; judged && f < judged->result.finding_count; f++)
        if (judged->result.findings[f].site == finding->site && judged->result.findings[f].rule == finding->rule)
            return true;
    return false;
}

/* It has not happened yet, so it is no error yet. */
void gn_shader_tell_static(struct gn_device *device, const struct gn_shader *shader)
{
    struct gn_findings findings;
    if (!shader->result.finding_count)
        return;
    const struct gn_records_teller teller = {.instance = device->instance, .device = device};
    gn_findings_init(&findings);
    gn_lock(device);
    for (uint32_t f = 0; f < shader->result.finding_count; f++) {
        const struct gn_spirv_finding *finding = &shader->result.findings[f];
        /* How deep an untaken branch would go is no matter: the check tells when it is taken. */
        if (found_before(shader->judged, finding) || finding->rule == GN_SPIRV_RULE_TRACE_RECURSION)
            continue;
        const struct gn_spirv_site *site = &shader->result.sites[finding->site];
        enum gn_severity severity = finding->severity > GN_SEVERITY_WARNING ? GN_SEVERITY_WARNING : finding->severity;
        struct gn_text text = {0};
        gn_text_add(&text, "%s, at ", finding->message);
        add_place(&text, &site->place);
        gn_text_add(&text, ". Found in the shader before it ran.");
        if (site->place.source)
            gn_text_add(&text, " The line: %s", site->place.source);
        tell(&teller, shader, finding->site, finding->rule, false, severity, 1, &text, &findings);
        gn_text_finish(&text);
    }
    gn_unlock(device);
    gn_report_flush(device->instance, &findings);
}

/* The closing statement */

static const char *stage_name(VkShaderStageFlagBits stage)
{
    switch (stage) {
    case VK_SHADER_STAGE_VERTEX_BIT: return "vertex";
    case VK_SHADER_STAGE_TESSELLATION_CONTROL_BIT: return "tessellation control";
    case VK_SHADER_STAGE_TESSELLATION_EVALUATION_BIT: return "tessellation evaluation";
    case VK_SHADER_STAGE_GEOMETRY_BIT: return "geometry";
    case VK_SHADER_STAGE_FRAGMENT_BIT: return "fragment";
    case VK_SHADER_STAGE_COMPUTE_BIT: return "compute";
    case VK_SHADER_STAGE_TASK_BIT_EXT: return "task";
    case VK_SHADER_STAGE_MESH_BIT_EXT: return "mesh";
    case VK_SHADER_STAGE_RAYGEN_BIT_KHR: return "ray generation";
    case VK_SHADER_STAGE_ANY_HIT_BIT_KHR: return "any hit";
    case VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR: return "closest hit";
    case VK_SHADER_STAGE_MISS_BIT_KHR: return "miss";
    case VK_SHADER_STAGE_INTERSECTION_BIT_KHR: return "intersection";
    case VK_SHADER_STAGE_CALLABLE_BIT_KHR: return "callable";
    default: return "another";
    }
}

static void add_name(struct gn_text *text, const char *name)
{
    if (name)
        gn_text_add_string(text, name);
    else
        gn_text_add(text, "null");
}

static void state_stage(struct gn_instance *instance, const struct gn_pipeline *pipeline, const struct gn_stage *stage)
{
    const struct gn_shader *shader = stage->shader;
    uint32_t checked = 0, proved = 0;
    struct gn_text text = {0};
    for (uint32_t s = 0; s < shader->result.site_count; s++) {
        checked += shader->result.words && shader->result.sites[s].checked;
        proved += shader->result.sites[s].judged && !shader->result.sites[s].checked;
    }
    gn_text_add(&text, "{\"pipeline\":");
    if (pipeline)
        gn_text_add(&text, "\"0x%llx\"", (unsigned long long)pipeline->handle);
    else
        gn_text_add(&text, "null");
    gn_text_add(&text, ",\"name\":");
    add_name(&text, pipeline ? pipeline->name : NULL);
    gn_text_add(&text, ",\"stage\":\"%s\",\"module\":", stage_name(stage->stage));
    add_name(&text, stage->module_name);
    gn_text_add(&text, ",\"status\":\"%s\",\"operations\":%u,\"checked\":%u,\"proved\":%u,\"skipped\":%u,\"why\":",
                shader->passed_because ? "passed" : gn_spirv_status_name(shader->result.status), shader->result.site_count,
                checked, proved, shader->result.site_count - checked - proved);
    gn_text_add_string(&text, shader->passed_because ? shader->passed_because : shader->result.message);
    gn_text_add(&text, "}");
    if (text.failed) {
        gn_text_finish(&text);
        return;
    }
    pthread_mutex_lock(&instance->lock);
    if (instance->stated_count < MAX_STATED && (instance->stated_count & (instance->stated_count - 1)) == 0) {
        char **grown = realloc(instance->stated, (instance->stated_count ? 2 * instance->stated_count : 1) * sizeof *grown);
        if (grown)
            instance->stated = grown;
        else
            instance->stated_left_out = true;
    }
    if (instance->stated_count < MAX_STATED && !instance->stated_left_out) {
        instance->stated[instance->stated_count++] = text.data;
        text = (struct gn_text){0};
    } else {
        instance->stated_left_out = true;
    }
    pthread_mutex_unlock(&instance->lock);
    gn_text_finish(&text);
}

void gn_shader_state(struct gn_device *device, const struct gn_pipeline *pipeline)
{
    for (uint32_t i = 0; i < pipeline->stage_count; i++) {
        state_stage(device->instance, pipeline, &pipeline->stages[i]);
        pipeline->stages[i].shader->stated = true;
    }
}

void gn_shaders_state_rest(struct gn_device *device)
{
    struct gn_shader *shader;
    for (size_t cursor = 0; (shader = gn_map_next(&device->shaders->shaders, &cursor));)
        if (!shader->stated)
            state_stage(device->instance, NULL, &(struct gn_stage){.shader = shader});
}
