/* SPDX-License-Identifier: Apache-2.0 */
/* The ways of a shader to the driver: modules, modules inside of a pipeline's stages, libraries, and shader objects. What is made of
 * shaders that the layer looks at is remembered, with its names, for findings and for the closing statement. */
#include "layer/sbt.h"
#include "layer/shader.h"

#include <stdlib.h>
#include <string.h>

#include <spirv/unified1/spirv.h>

/* Memory that a call to the next layer reads; of a deferred operation, it has to stay. */
struct gn_deferred {
    struct gn_deferred *next;
    uint64_t bytes[];
};

struct change {
    struct gn_device *device;
    struct gn_deferred *memory;
    struct temporary *modules; /* that live as long as the memory */
};

struct temporary {
    VkShaderModule module;
    struct temporary *next;
};

static void *change_alloc(struct change *change, size_t count, size_t size)
{
    struct gn_deferred *memory = size && count > (SIZE_MAX - sizeof *memory) / size ? NULL : calloc(1, sizeof *memory + count * size);
    if (!memory)
        return NULL;
    memory->next = change->memory;
    change->memory = memory;
    return memory->bytes;
}

static void deferred_free(struct gn_deferred *memory)
{
    for (struct gn_deferred *next; memory; memory = next) {
        next = memory->next;
        free(memory);
    }
}

static void temporaries_destroy(struct gn_device *device, struct temporary *temporary)
{
    for (; temporary; temporary = temporary->next)
        device->next.DestroyShaderModule(device->handle, temporary->module, NULL);
}

static void change_finish(struct change *change, bool deferred)
{
    struct gn_device *device = change->device;
    if (!deferred || !change->memory) {
        temporaries_destroy(device, change->modules);
        deferred_free(change->memory);
        return;
    }
    gn_lock(device);
    struct gn_deferred **end = &device->shaders->deferred;
    struct temporary **last = &device->shaders->deferred_modules;
    while (*end)
        end = &(*end)->next;
    while (*last)
        last = &(*last)->next;
    *end = change->memory;
    *last = change->modules;
    gn_unlock(device);
}

/* Shader objects and pipelines share a map. */
static uint64_t map_key(uint64_t handle, bool is_object)
{
    return is_object ? ~handle : handle;
}

/* Modules */

static void module_free(struct gn_module *module)
{
    if (!module)
        return;
    free(module->name);
    free(module->words);
    free(module);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateShaderModule(VkDevice handle, const VkShaderModuleCreateInfo *info,
                                                           const VkAllocationCallbacks *allocator, VkShaderModule *out)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.CreateShaderModule(handle, info, allocator, out);
    struct gn_shader *shader = result == VK_SUCCESS ? gn_shader_of(device, info->pCode, info->codeSize, GN_SHADER_JUDGED, NULL, NULL) : NULL;
    if (result == VK_SUCCESS)
        gn_uses_module_created(device, *out, info);
    struct gn_module *module = result == VK_SUCCESS && shader ? calloc(1, sizeof *module) : NULL;
    if (!module)
        return result;
    *module = (struct gn_module){.handle = *out, .shader = shader, .words = malloc(info->codeSize), .bytes = info->codeSize};
    if (module->words)
        memcpy(module->words, info->pCode, info->codeSize);
    gn_lock(device);
    if (!gn_map_put(&device->shaders->modules, (uint64_t)*out, module))
        module_free(module);
    gn_unlock(device);
    return result;
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyShaderModule(VkDevice handle, VkShaderModule module,
                                                        const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    if (module)
        gn_uses_module_destroyed(device, module);
    if (module && device->shaders) {
        gn_lock(device);
        module_free(gn_map_take(&device->shaders->modules, (uint64_t)module));
        gn_unlock(device);
    }
    device->next.DestroyShaderModule(handle, module, allocator);
}

/* Stages */

static enum gn_shader_way way_of(bool mirrored)
{
    return mirrored ? GN_SHADER_MIRRORED : GN_SHADER_INSTRUMENTED;
}

/* What is known of a pipeline before its stages are looked at. */
struct around {
    bool mirrored;
    struct gn_ray_facts facts;
};

/* Another module in the place of the application's, which was made before anything was known of the pipeline. */
static void stage_replace(struct change *change, const struct gn_module *module, const struct around *around,
                          VkPipelineShaderStageCreateInfo *stage, struct gn_stage *out, bool *out_changed)
{
    struct gn_device *device = change->device;
    struct gn_shader *shader =
        gn_shader_of(device, module->words, module->bytes, way_of(around->mirrored), &around->facts, module->shader);
    if (!shader || !shader->result.words)
        return;
    VkShaderModuleCreateInfo info = {.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO,
                                     .codeSize = shader->result.word_count * 4,
                                     .pCode = shader->result.words};
    struct temporary *temporary = change_alloc(change, 1, sizeof *temporary);
    if (!temporary || device->next.CreateShaderModule(device->handle, &info, NULL, &temporary->module) != VK_SUCCESS)
        return;
    temporary->next = change->modules;
    change->modules = temporary;
    stage->module = temporary->module;
    gn_lock(device);
    out->shader->stated = true; /* the other one is, in its place */
    gn_unlock(device);
    out->shader = shader;
    *out_changed = true;
}

/* What the stage runs. Where the stage has a module of its own that has to be another one, `stage` is changed. */
static struct gn_stage stage_look(struct change *change, VkPipelineShaderStageCreateInfo *stage, const struct around *around,
                                  bool *out_changed)
{
    struct gn_device *device = change->device;
    struct gn_stage out = {.stage = stage->stage};
    if (stage->module) {
        gn_lock(device);
        struct gn_module *module = gn_map_get(&device->shaders->modules, (uint64_t)stage->module);
        if (module) {
            out.shader = module->shader;
            out.module_name = module->name ? strdup(module->name) : NULL;
        }
        gn_unlock(device);
        if (module && module->words && (around->facts.known || !device->shaders->options.static_only))
            stage_replace(change, module, around, stage, &out, out_changed);
        return out;
    }
    const VkShaderModuleCreateInfo *own = gn_chain_find(stage->pNext, VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO);
    if (!own) {
        gn_tally_unjudged(device, GN_UNJUDGED_shader_identifiers, 1);
        return out;
    }
    out.shader = gn_shader_of(device, own->pCode, own->codeSize, way_of(around->mirrored), &around->facts, NULL);
    if (!out.shader || !out.shader->result.words)
        return out;
    struct gn_chain_copy *storage = change_alloc(change, 1, sizeof *storage);
    VkShaderModuleCreateInfo *copy =
        storage ? gn_chain_copy(&stage->pNext, VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, storage) : NULL;
    if (!copy) {
        gn_tally_unjudged(device, GN_UNJUDGED_shader_chains, 1);
        out.shader = NULL;
        return out;
    }
    copy->pCode = out.shader->result.words;
    copy->codeSize = out.shader->result.word_count * 4;
    *out_changed = true;
    return out;
}

/* One pipeline to be: what its stages run, and the stages to create it from. */
struct plan {
    uint32_t count;
    struct gn_stage *stages;
    const VkPipelineShaderStageCreateInfo *create;
    const VkPipelineLibraryCreateInfoKHR *libraries;
};

static void look_for_binaries(struct gn_device *device, const void *chain)
{
    const VkPipelineBinaryInfoKHR *binaries = gn_chain_find(chain, VK_STRUCTURE_TYPE_PIPELINE_BINARY_INFO_KHR);
    if (binaries && binaries->binaryCount)
        gn_tally_unjudged(device, GN_UNJUDGED_shader_binaries, 1);
}

/* Whether the stages to create it from are others. `chain` is that of the pipeline; without stages (NULL) there is nothing to plan. */
static bool plan_make(struct change *change, struct plan *plan, const void *chain, VkPipelineLayout layout, struct gn_ray_facts facts,
                      uint32_t count, const VkPipelineShaderStageCreateInfo *stages)
{
    look_for_binaries(change->device, chain);
    if (!stages)
        return false;
    const struct around around = {gn_layout_mirrored(change->device, layout), facts};
    bool any = false;
    plan->create = stages;
    VkPipelineShaderStageCreateInfo *copies = change_alloc(change, count, sizeof *copies);
    plan->stages = change_alloc(change, count, sizeof *plan->stages);
    if (!copies || !plan->stages)
        return false;
    plan->count = count;
    for (uint32_t i = 0; i < count; i++) {
        copies[i] = stages[i];
        plan->stages[i] = stage_look(change, &copies[i], &around, &any);
    }
    if (any)
        plan->create = copies;
    return any;
}

static void pipeline_free(struct gn_pipeline *pipeline)
{
    for (uint32_t i = 0; i < pipeline->stage_count; i++)
        free(pipeline->stages[i].module_name);
    free(pipeline->name);
    free(pipeline);
}

/* With the device locked: the stages of the libraries that a pipeline links. */
static uint32_t library_stages(struct gn_device *device, const VkPipelineLibraryCreateInfoKHR *libraries, struct gn_stage *out)
{
    uint32_t count = 0;
    for (uint32_t l = 0; libraries && l < libraries->libraryCount; l++) {
        const struct gn_pipeline *library = gn_map_get(&device->shaders->pipelines, (uint64_t)libraries->pLibraries[l]);
        for (uint32_t i = 0; library && i < library->stage_count; i++, count++)
            if (out) {
                out[count] = library->stages[i];
                out[count].module_name = out[count].module_name ? strdup(out[count].module_name) : NULL;
            }
    }
    return count;
}

/* Takes over the names of the plan's stages. */
static void plan_done(struct gn_device *device, struct plan *plan, uint64_t handle, bool is_object)
{
    uint32_t own = 0;
    for (uint32_t i = 0; i < plan->count; i++)
        own += plan->stages[i].shader != NULL;
    gn_lock(device);
    uint32_t linked = handle ? library_stages(device, plan->libraries, NULL) : 0;
    struct gn_pipeline *pipeline =
        handle && own + linked ? calloc(1, sizeof *pipeline + (own + linked) * sizeof pipeline->stages[0]) : NULL;
    if (pipeline) {
        *pipeline = (struct gn_pipeline){.handle = handle, .is_object = is_object};
        for (uint32_t i = 0; i < plan->count; i++)
            if (plan->stages[i].shader) {
                pipeline->stages[pipeline->stage_count++] = plan->stages[i];
                plan->stages[i].module_name = NULL;
            }
        pipeline->stage_count += library_stages(device, plan->libraries, pipeline->stages + pipeline->stage_count);
        for (uint32_t i = 0; i < pipeline->stage_count; i++)
            pipeline->asks_launch |= pipeline->stages[i].shader->asks_launch;
        struct gn_pipeline *old = gn_map_take(&device->shaders->pipelines, map_key(handle, is_object));
        if (old)
            pipeline_free(old);
        if (!gn_map_put(&device->shaders->pipelines, map_key(handle, is_object), pipeline))
            pipeline_free(pipeline);
    }
    gn_unlock(device);
    for (uint32_t i = 0; i < plan->count; i++)
        free(plan->stages[i].module_name);
}

/* Plans for so many pipelines, and room for what they are created from; NULL where shaders are left alone. */
static void *plans_begin(struct change *change, uint32_t count, size_t size, struct plan **out_plans)
{
    *out_plans = change->device->shaders ? change_alloc(change, count, sizeof **out_plans) : NULL;
    return *out_plans ? change_alloc(change, count, size) : NULL;
}

/* A pipeline that was not made has no handle. */
static VkResult plans_done(struct change *change, struct plan *plans, uint32_t count, VkResult result, const VkPipeline *pipelines)
{
    const bool deferred = result == VK_OPERATION_DEFERRED_KHR;
    for (uint32_t i = 0; plans && i < count; i++)
        plan_done(change->device, &plans[i], result >= 0 && !deferred ? (uint64_t)pipelines[i] : 0, false);
    change_finish(change, deferred);
    return result;
}

static const struct gn_ray_facts no_rays;

/* A library says the same as the pipelines that link it. */
static struct gn_ray_facts facts_of(const VkRayTracingPipelineCreateInfoKHR *info)
{
    const VkPipelineCreateFlags2 flags = gn_rays_flags(info);
    struct gn_ray_facts facts = {.known = 1, .recursion = info->maxPipelineRayRecursionDepth};
    if (info->pLibraryInterface) {
        facts.payload = info->pLibraryInterface->maxPipelineRayPayloadSize;
        facts.attribute = info->pLibraryInterface->maxPipelineRayHitAttributeSize;
    }
    if (flags & VK_PIPELINE_CREATE_2_RAY_TRACING_SKIP_AABBS_BIT_KHR)
        facts.forbidden |= SpvRayFlagsSkipTrianglesKHRMask;
    if (flags & VK_PIPELINE_CREATE_2_RAY_TRACING_SKIP_TRIANGLES_BIT_KHR)
        facts.forbidden |= SpvRayFlagsSkipAABBsKHRMask;
    return facts;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateComputePipelines(VkDevice handle, VkPipelineCache cache, uint32_t count,
                                                               const VkComputePipelineCreateInfo *infos,
                                                               const VkAllocationCallbacks *allocator, VkPipeline *out)
{
    struct gn_device *device = gn_device_of(handle);
    struct change change = {.device = device};
    struct plan *plans;
    VkComputePipelineCreateInfo *copies = plans_begin(&change, count, sizeof *copies, &plans);
    bool any = false;
    for (uint32_t i = 0; copies && i < count; i++) {
        copies[i] = infos[i];
        if (plan_make(&change, &plans[i], infos[i].pNext, infos[i].layout, no_rays, 1, &infos[i].stage)) {
            copies[i].stage = *plans[i].create;
            any = true;
        }
    }
    VkResult result = device->next.CreateComputePipelines(handle, cache, count, any ? copies : infos, allocator, out);
    if (result >= 0)
        gn_uses_compute_created(device, count, infos, out);
    return plans_done(&change, copies ? plans : NULL, count, result, out);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateGraphicsPipelines(VkDevice handle, VkPipelineCache cache, uint32_t count,
                                                                const VkGraphicsPipelineCreateInfo *infos,
                                                                const VkAllocationCallbacks *allocator, VkPipeline *out)
{
    struct gn_device *device = gn_device_of(handle);
    struct change change = {.device = device};
    struct plan *plans;
    VkGraphicsPipelineCreateInfo *copies = plans_begin(&change, count, sizeof *copies, &plans);
    bool any = false;
    for (uint32_t i = 0; copies && i < count; i++) {
        /* The stages of a library without shader state are not to be looked at. */
        const VkGraphicsPipelineLibraryCreateInfoEXT *library =
            gn_chain_find(infos[i].pNext, VK_STRUCTURE_TYPE_GRAPHICS_PIPELINE_LIBRARY_CREATE_INFO_EXT);
        bool has_stages = !library || (library->flags & (VK_GRAPHICS_PIPELINE_LIBRARY_PRE_RASTERIZATION_SHADERS_BIT_EXT |
                                                         VK_GRAPHICS_PIPELINE_LIBRARY_FRAGMENT_SHADER_BIT_EXT));
        copies[i] = infos[i];
        plans[i].libraries = gn_chain_find(infos[i].pNext, VK_STRUCTURE_TYPE_PIPELINE_LIBRARY_CREATE_INFO_KHR);
        if (plan_make(&change, &plans[i], infos[i].pNext, infos[i].layout, no_rays, infos[i].stageCount,
                      has_stages ? infos[i].pStages : NULL)) {
            copies[i].pStages = plans[i].create;
            any = true;
        }
    }
    VkResult result = device->next.CreateGraphicsPipelines(handle, cache, count, any ? copies : infos, allocator, out);
    if (result >= 0)
        gn_uses_graphics_created(device, count, infos, out);
    return plans_done(&change, copies ? plans : NULL, count, result, out);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateRayTracingPipelinesKHR(VkDevice handle, VkDeferredOperationKHR deferred,
                                                                     VkPipelineCache cache, uint32_t count,
                                                                     const VkRayTracingPipelineCreateInfoKHR *infos,
                                                                     const VkAllocationCallbacks *allocator, VkPipeline *out)
{
    struct gn_device *device = gn_device_of(handle);
    struct change change = {.device = device};
    struct plan *plans;
    VkRayTracingPipelineCreateInfoKHR *copies = plans_begin(&change, count, sizeof *copies, &plans);
    bool any = false;
    for (uint32_t i = 0; copies && i < count; i++) {
        copies[i] = infos[i];
        plans[i].libraries = infos[i].pLibraryInfo;
        if (plan_make(&change, &plans[i], infos[i].pNext, infos[i].layout, facts_of(&infos[i]), infos[i].stageCount, infos[i].pStages)) {
            copies[i].pStages = plans[i].create;
            any = true;
        }
    }
    VkResult result =
        device->next.CreateRayTracingPipelinesKHR(handle, deferred, cache, count, any ? copies : infos, allocator, out);
    if (result >= 0 && result != VK_OPERATION_DEFERRED_KHR) {
        gn_uses_rays_created(device, count, infos, out);
        gn_rays_created(device, count, infos, out);
    }
    return plans_done(&change, copies ? plans : NULL, count, result, out);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyPipeline(VkDevice handle, VkPipeline pipeline, const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    if (pipeline)
        gn_uses_pipeline_destroyed(device, pipeline);
    if (pipeline)
        gn_rays_destroyed(device, pipeline);
    if (pipeline && device->shaders) {
        gn_shaders_read(device, false, false);
        gn_lock(device);
        struct gn_pipeline *known = gn_map_take(&device->shaders->pipelines, (uint64_t)pipeline);
        if (known) {
            gn_shader_state(device, known);
            pipeline_free(known);
        }
        gn_unlock(device);
    }
    device->next.DestroyPipeline(handle, pipeline, allocator);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateShadersEXT(VkDevice handle, uint32_t count, const VkShaderCreateInfoEXT *infos,
                                                         const VkAllocationCallbacks *allocator, VkShaderEXT *out)
{
    struct gn_device *device = gn_device_of(handle);
    if (!device->shaders)
        return device->next.CreateShadersEXT(handle, count, infos, allocator, out);
    struct change change = {.device = device};
    VkShaderCreateInfoEXT *copies = change_alloc(&change, count, sizeof *copies);
    struct gn_stage *stages = change_alloc(&change, count, sizeof *stages);
    for (uint32_t i = 0; copies && stages && i < count; i++) {
        copies[i] = infos[i];
        stages[i].stage = infos[i].stage;
        if (infos[i].codeType != VK_SHADER_CODE_TYPE_SPIRV_EXT) {
            gn_tally_unjudged(device, GN_UNJUDGED_shader_binaries, 1);
            continue;
        }
        stages[i].shader = gn_shader_of(device, infos[i].pCode, infos[i].codeSize,
                                        way_of(gn_set_layouts_mirrored(device, infos[i].setLayoutCount, infos[i].pSetLayouts)), NULL,
                                        NULL);
        if (stages[i].shader && stages[i].shader->result.words) {
            copies[i].pCode = stages[i].shader->result.words;
            copies[i].codeSize = stages[i].shader->result.word_count * 4;
        }
    }
    VkResult result = device->next.CreateShadersEXT(handle, count, copies && stages ? copies : infos, allocator, out);
    for (uint32_t i = 0; copies && stages && i < count; i++) {
        struct plan plan = {.count = 1, .stages = &stages[i]};
        plan_done(device, &plan, result >= 0 ? (uint64_t)out[i] : 0, true);
    }
    change_finish(&change, false);
    return result;
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyShaderEXT(VkDevice handle, VkShaderEXT object, const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    if (object && device->shaders) {
        gn_shaders_read(device, false, false);
        gn_lock(device);
        struct gn_pipeline *known = gn_map_take(&device->shaders->pipelines, map_key((uint64_t)object, true));
        if (known) {
            gn_shader_state(device, known);
            pipeline_free(known);
        }
        gn_unlock(device);
    }
    device->next.DestroyShaderEXT(handle, object, allocator);
}

char **gn_pipeline_name(struct gn_device *device, VkObjectType type, uint64_t handle)
{
    if (!device->shaders)
        return NULL;
    if (type == VK_OBJECT_TYPE_SHADER_MODULE) {
        struct gn_module *module = gn_map_get(&device->shaders->modules, handle);
        return module ? &module->name : NULL;
    }
    struct gn_pipeline *pipeline = gn_map_get(&device->shaders->pipelines, map_key(handle, type == VK_OBJECT_TYPE_SHADER_EXT));
    return pipeline ? &pipeline->name : NULL;
}

void gn_pipelines_finish(struct gn_device *device)
{
    struct gn_shaders *shaders = device->shaders;
    struct gn_pipeline *pipeline;
    struct gn_module *module;
    for (size_t cursor = 0; (pipeline = gn_map_next(&shaders->pipelines, &cursor));) {
        gn_shader_state(device, pipeline);
        pipeline_free(pipeline);
    }
    for (size_t cursor = 0; (module = gn_map_next(&shaders->modules, &cursor));)
        module_free(module);
    gn_map_finish(&shaders->pipelines);
    gn_map_finish(&shaders->modules);
    temporaries_destroy(device, shaders->deferred_modules);
    deferred_free(shaders->deferred);
    shaders->deferred = NULL;
    shaders->deferred_modules = NULL;
}
