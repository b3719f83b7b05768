/* SPDX-License-Identifier: Apache-2.0 */
/* Modules on their way to the driver: each distinct one is looked at once, and what comes out is kept as long as the device. */
#include "layer/shader.h"

#include <stdlib.h>
#include <string.h>

#include <spirv/unified1/spirv.h>
#define XXH_INLINE_ALL
#include <xxhash.h>

/* A device with fewer has none to spare. */
#define PLENTY_OF_BUFFERS 4096u

bool gn_shaders_init(struct gn_device *device, const struct gn_device_wish *wish)
{
    const struct gn_settings *settings = &device->instance->settings;
    if (settings->shader_checks == GN_SHADERS_OFF)
        return true;
    struct gn_shaders *shaders = calloc(1, sizeof *shaders);
    if (!shaders)
        return false;
    shaders->options = (struct gn_spirv_options){.profile = settings->profile,
                                                 .static_only = settings->shader_checks == GN_SHADERS_STATIC,
                                                 .without_proofs = settings->shader_checks == GN_SHADERS_UNPROVED,
                                                 .disabled = settings->shader_rules_off,
                                                 .safe = settings->safe_mode,
                                                 .proceed_limit = settings->proceed_limit};
    const uint64_t told[] = {GN_SPIRV_VERSION,           settings->profile,   settings->shader_checks,
                             settings->shader_rules_off, settings->safe_mode, settings->proceed_limit};
    shaders->seed = XXH3_64bits(told, sizeof told);
    shaders->vertex_stores = wish->vertex_stores;
    shaders->fragment_stores = wish->fragment_stores;
    shaders->host_memory = wish->host_memory;
    shaders->null_descriptors = wish->null_descriptors;
    shaders->positions = wish->positions && !shaders->options.static_only;
    VkPhysicalDeviceProperties properties;
    device->instance->next.GetPhysicalDeviceProperties(device->physical, &properties);
    shaders->spare_buffers = properties.limits.maxPerStageDescriptorStorageBuffers >= PLENTY_OF_BUFFERS &&
                             properties.limits.maxDescriptorSetStorageBuffers >= PLENTY_OF_BUFFERS;
    shaders->next_structure = GN_STRUCTURE_ID_FIRST;
    shaders->no_records = !wish->addresses ? "the device has no buffer device addresses, or was created without them in a way "
                                             "that the layer cannot change"
                          : !device->copies && device->no_copies_because == GN_UNJUDGED_device_groups
                              ? "records are kept on one physical device with at most 16 queue families only"
                              : NULL;
    device->shaders = shaders;
    return true;
}

static void shader_free(struct gn_shader *shader)
{
    if (!shader)
        return;
    gn_spirv_result_finish(&shader->result);
    free(shader);
}

void gn_shaders_finish(struct gn_device *device)
{
    struct gn_shaders *shaders = device->shaders;
    struct gn_shader *shader;
    if (!shaders)
        return;
    gn_shaders_read(device, false, true);
    gn_lock(device);
    gn_pipelines_finish(device);
    gn_shaders_state_rest(device);
    for (size_t cursor = 0; (shader = gn_map_next(&shaders->shaders, &cursor));)
        shader_free(shader);
    gn_map_finish(&shaders->shaders);
    gn_mirrors_finish(device);
    gn_record_memory_finish(device);
    device->shaders = NULL;
    gn_unlock(device);
    free(shaders);
}

/* Why instrumented words would not be valid on this device. A module may have several entry points. */
static const char *stage_problem(const struct gn_shaders *shaders, const uint32_t *words, size_t count, uint32_t *out_model)
{
    const char *problem = NULL;
    bool first = true;
    for (size_t at = 5; at < count && words[at] >> 16; at += words[at] >> 16) {
        if ((words[at] & 0xFFFF) == SpvOpFunction)
            break;
        if ((words[at] & 0xFFFF) != SpvOpEntryPoint || count - at < 2)
            continue;
        uint32_t model = words[at + 1];
        if (first)
            *out_model = model;
        first = false;
        if (model <= SpvExecutionModelGeometry && !shaders->vertex_stores)
            problem = "the device was created without vertexPipelineStoresAndAtomics";
        else if (model == SpvExecutionModelFragment && !shaders->fragment_stores)
            problem = "the device was created without fragmentStoresAndAtomics";
        else if (model == SpvExecutionModelKernel)
            problem = "it has an entry point that is not for graphics, compute or rays";
    }
    return problem;
}

/* What a trace has to be told about is only asked where the module does not decide it. */
static bool asks_launch(const struct gn_spirv_result *result)
{
    const uint64_t asking = UINT64_C(1) << GN_SPIRV_RULE_CALL_RANGE | UINT64_C(1) << GN_SPIRV_RULE_TRACE_RECURSION;
    for (uint32_t s = 0; result->words && s < result->site_count; s++)
        if (result->sites[s].checked & ~result->sites[s].wrong & asking)
            return true;
    return false;
}

static struct gn_shader *shader_make(struct gn_device *device, uint64_t key, const uint32_t *words, size_t count,
                                     enum gn_shader_way way, const struct gn_ray_facts *facts, const struct gn_shader *judged)
{
    struct gn_shader *shader = calloc(1, sizeof *shader);
    if (!shader)
        return NULL;
    gn_lock(device);
    if (!device->shaders->options.static_only)
        gn_record_memory_begin(device);
    struct gn_spirv_options options = device->shaders->options;
    options.structures = way == GN_SHADER_MIRRORED ? device->shaders->structures_address : 0;
    shader->passed_because = device->shaders->no_records;
    gn_unlock(device);
    const char *problem = stage_problem(device->shaders, words, count, &shader->model);
    if (problem)
        shader->passed_because = problem;
    options.static_only |= shader->passed_because != NULL || way == GN_SHADER_JUDGED;
    options.recursion_known = facts->known;
    options.max_recursion = facts->recursion;
    options.max_payload = facts->payload;
    options.max_attribute = facts->attribute;
    options.forbidden_ray_flags = facts->forbidden;
    options.without_validation = judged && judged->result.status != GN_SPIRV_INVALID;
    shader->judged = judged;
    options.key = shader->key = key;
    const char *folder = device->shaders->stable && way != GN_SHADER_JUDGED ? device->instance->settings.shader_cache : NULL;
    uint64_t entry = XXH3_64bits_withSeed(words, count * 4, device->shaders->seed ^ options.root ^ options.structures ^
                                                                options.static_only ^ XXH3_64bits(facts, sizeof *facts));
    if (folder && gn_shader_cache_load(folder, entry, &shader->result)) {
        gn_tally_check(device, GN_CHECKED_shader_cache, 1);
    } else {
        gn_spirv_instrument(words, count, &options, &shader->result);
        if (folder && shader->result.status <= GN_SPIRV_DECLINED)
            gn_shader_cache_store(folder, entry, &shader->result);
    }
    shader->asks_launch = asks_launch(&shader->result);
    return shader;
}

static void tally(struct gn_device *device, const struct gn_shader *shader)
{
    uint64_t checked = 0, proved = 0;
    if (shader->result.status == GN_SPIRV_DECLINED || shader->result.status == GN_SPIRV_INVALID ||
        shader->result.status == GN_SPIRV_OUT_OF_MEMORY || shader->passed_because) {
        gn_tally_unjudged(device, GN_UNJUDGED_shaders_passed, 1);
        return;
    }
    for (uint32_t s = 0; s < shader->result.site_count; s++) {
        checked += shader->result.sites[s].checked != 0;
        proved += !shader->result.sites[s].checked && shader->result.sites[s].judged;
    }
    gn_tally_check(device, GN_CHECKED_shaders, 1);
    gn_tally_check(device, GN_CHECKED_shader_checks, checked);
    gn_tally_check(device, GN_CHECKED_shader_proofs, proved);
}

struct gn_shader *gn_shader_of(struct gn_device *device, const uint32_t *words, size_t bytes, enum gn_shader_way way,
                               const struct gn_ray_facts *facts, struct gn_shader *judged)
{
    static const struct gn_ray_facts none;
    facts = facts ? facts : &none;
    struct gn_shaders *shaders = device->shaders;
    if (!shaders || !words || bytes % 4 || !gn_spirv_has_queries(words, bytes / 4))
        return NULL;
    uint64_t key = XXH3_64bits_withSeed(words, bytes, XXH3_64bits_withSeed(facts, sizeof *facts, shaders->seed + way));
    key += !key;
    gn_lock(device);
    struct gn_shader *shader = gn_map_get(&shaders->shaders, key);
    gn_unlock(device);
    if (shader)
        return shader;
    struct gn_shader *made = shader_make(device, key, words, bytes / 4, way, facts, judged);
    if (!made) {
        gn_tally_unjudged(device, GN_UNJUDGED_shaders_passed, 1);
        return NULL;
    }
    gn_lock(device);
    shader = gn_map_get(&shaders->shaders, key);
    if (shader) {
        gn_unlock(device);
        shader_free(made);
        return shader;
    }
    if (made->result.words && !gn_record_memory_take(device, made)) {
        made->passed_because = "no memory was left for its records";
        free(made->result.words);
        made->result.words = NULL;
    }
    if (!gn_map_put(&shaders->shaders, key, made)) {
        shader_free(made);
        made = NULL;
    }
    shaders->asks_launch |= made && made->asks_launch;
    gn_unlock(device);
    if (!made) {
        gn_tally_unjudged(device, GN_UNJUDGED_shaders_passed, 1);
        return NULL;
    }
    if (!judged)
        tally(device, made);
    gn_shader_tell_static(device, made);
    return made;
}
