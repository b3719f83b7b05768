/* SPDX-License-Identifier: Apache-2.0 */
/* What shaders trace rays through: a look over SPIR-V for the descriptors that OpTraceRay and OpRayQueryInitialize read, and whether
 * they do so whatever happens. What is not recognised is not used, as far as this file can tell. */
#include "checks/spirv/spirv.h"
#include "layer/sbt.h"

#include <stdlib.h>
#include <string.h>

#define MAGIC 0x07230203u
#define MAX_USES 32u
#define NOWHERE UINT32_MAX

enum {
    OP_ENTRY_POINT = 15,
    OP_CONSTANT = 43,
    OP_FUNCTION = 54,
    OP_FUNCTION_END = 56,
    OP_VARIABLE = 59,
    OP_FUNCTION_CALL = 57,
    OP_LOAD = 61,
    OP_DECORATE = 71,
    OP_LABEL = 248,
    OP_BRANCH = 249,
    OP_TRACE_RAY = 4445,
    OP_RAY_QUERY_INITIALIZE = 4473,
    DECORATION_BINDING = 33,
    DECORATION_DESCRIPTOR_SET = 34
};

static struct gn_static_uses *static_uses_keep(struct gn_static_uses *uses)
{
    if (uses)
        uses->references++;
    return uses;
}

void gn_static_uses_release(struct gn_static_uses *uses)
{
    if (uses && --uses->references == 0)
        free(uses);
}

static VkShaderStageFlags stage_of(uint32_t model)
{
    static const VkShaderStageFlags graphics[] = {
        VK_SHADER_STAGE_VERTEX_BIT,   VK_SHADER_STAGE_TESSELLATION_CONTROL_BIT, VK_SHADER_STAGE_TESSELLATION_EVALUATION_BIT,
        VK_SHADER_STAGE_GEOMETRY_BIT, VK_SHADER_STAGE_FRAGMENT_BIT,             VK_SHADER_STAGE_COMPUTE_BIT};
    static const VkShaderStageFlags rays[] = {VK_SHADER_STAGE_RAYGEN_BIT_KHR,      VK_SHADER_STAGE_INTERSECTION_BIT_KHR,
                                              VK_SHADER_STAGE_ANY_HIT_BIT_KHR,     VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR,
                                              VK_SHADER_STAGE_MISS_BIT_KHR,        VK_SHADER_STAGE_CALLABLE_BIT_KHR};
    if (model < sizeof graphics / sizeof graphics[0])
        return graphics[model];
    if (model >= 5313 && model - 5313 < sizeof rays / sizeof rays[0])
        return rays[model - 5313];
    return model == 5364 ? VK_SHADER_STAGE_TASK_BIT_EXT : model == 5365 ? VK_SHADER_STAGE_MESH_BIT_EXT : 0;
}

/* Of each id what matters: where a variable is bound, and which variable was loaded into it. */
struct id {
    uint32_t set, binding, loaded_from, block;
    uint32_t value; /* of a constant that nothing specializes; else 0 */
    bool is_variable;
};

struct scan {
    const uint32_t *words;
    size_t count;
    struct id *ids;
    uint32_t bound;
    uint32_t entry, entry_count;
    VkShaderStageFlags stage;
};

static uint32_t opcode(const struct scan *scan, size_t at)
{
    return scan->words[at] & 0xFFFF;
}

/* The length of the instruction, 0 where the module ends or is broken. */
static size_t length(const struct scan *scan, size_t at)
{
    if (at >= scan->count)
        return 0;
    size_t size = scan->words[at] >> 16;
    return size <= scan->count - at ? size : 0;
}

static struct id *id_at(const struct scan *scan, uint32_t id)
{
    return id < scan->bound ? &scan->ids[id] : NULL;
}

static void declare(struct scan *scan, size_t at, size_t size)
{
    const uint32_t *words = scan->words + at;
    struct id *id;
    switch (opcode(scan, at)) {
    case OP_ENTRY_POINT:
        if (size >= 3) {
            scan->entry_count++;
            scan->stage = stage_of(words[1]);
            scan->entry = words[2];
        }
        break;
    case OP_DECORATE:
        if (size >= 4 && (id = id_at(scan, words[1]))) {
            if (words[2] == DECORATION_BINDING)
                id->binding = words[3];
            else if (words[2] == DECORATION_DESCRIPTOR_SET)
                id->set = words[3];
        }
        break;
    case OP_VARIABLE:
        if (size >= 4 && (id = id_at(scan, words[2])))
            id->is_variable = true;
        break;
    case OP_CONSTANT:
        if (size >= 4 && (id = id_at(scan, words[2])))
            id->value = words[3];
        break;
    case OP_LOAD:
        if (size >= 4 && (id = id_at(scan, words[2])))
            id->loaded_from = words[3];
        break;
    case OP_LABEL:
        if (size >= 2 && (id = id_at(scan, words[1])))
            id->block = (uint32_t)at;
        break;
    default:
        break;
    }
}

/* The variable that a trace reads its structure from; NULL if it takes another way. */
static const struct id *traced(const struct scan *scan, size_t at, size_t size)
{
    uint32_t word = opcode(scan, at) == OP_TRACE_RAY ? 1 : opcode(scan, at) == OP_RAY_QUERY_INITIALIZE ? 2 : 0;
    const struct id *value = word && word < size ? id_at(scan, scan->words[at + word]) : NULL;
    const struct id *variable = value && value->loaded_from != NOWHERE ? id_at(scan, value->loaded_from) : NULL;
    return variable && variable->is_variable && variable->set != NOWHERE && variable->binding != NOWHERE ? variable : NULL;
}

/* The four bits that an operand of OpTraceRay counts with; 0 unless it is a constant. */
static uint32_t operand(const struct scan *scan, size_t at, size_t size, uint32_t word)
{
    const struct id *id = word < size ? id_at(scan, scan->words[at + word]) : NULL;
    return id ? id->value & 0xF : 0;
}

static void add(struct gn_static_uses *uses, const struct scan *scan, size_t at, size_t size, const struct id *variable, bool always)
{
    struct gn_static_use *use = NULL;
    for (uint32_t i = 0; i < uses->count && !use; i++)
        if (uses->uses[i].set == variable->set && uses->uses[i].binding == variable->binding)
            use = &uses->uses[i];
    if (!use && uses->count == MAX_USES)
        return;
    if (!use) {
        use = &uses->uses[uses->count++];
        *use = (struct gn_static_use){.set = variable->set, .binding = variable->binding, .stages = scan->stage};
    }
    use->always |= always;
    if (opcode(scan, at) != OP_TRACE_RAY)
        return;
    uint32_t offset = operand(scan, at, size, 4), stride = operand(scan, at, size, 5);
    use->ray_offset = use->rays && use->ray_offset < offset ? use->ray_offset : offset;
    use->ray_stride = use->rays && use->ray_stride < stride ? use->ray_stride : stride;
    use->rays = true;
}

/* From the start of the entry point along plain branches: what stands there is executed by every invocation. */
static void follow(const struct scan *scan, struct gn_static_uses *uses)
{
    size_t at = 5, size;
    while ((size = length(scan, at)) &&
           !(opcode(scan, at) == OP_FUNCTION && size >= 3 && scan->words[at + 2] == scan->entry))
        at += size;
    for (uint32_t blocks = 0; blocks < 64 && (size = length(scan, at));) {
        const struct id *variable = traced(scan, at, size);
        uint32_t operation = opcode(scan, at);
        if (variable)
            add(uses, scan, at, size, variable, true);
        if (operation == OP_BRANCH && size >= 2) {
            const struct id *target = id_at(scan, scan->words[at + 1]);
            if (!target || target->block == NOWHERE)
                return;
            at = target->block;
            blocks++;
        } else if ((operation >= 250 && operation <= 255) || operation == OP_FUNCTION_END ||
                   operation == OP_FUNCTION_CALL /* which may end the invocation */ || (operation >= 4416 && operation <= 4449 && !variable)) {
            return;
        } else {
            at += size;
        }
    }
}

/* What the module with exactly one entry point traces through; NULL when nothing is known. */
static struct gn_static_uses *static_uses_scan(const uint32_t *words, size_t count)
{
    struct scan scan = {.words = words, .count = count};
    struct gn_static_uses *uses = NULL;
    size_t size;
    if (count < 5 || words[0] != MAGIC || words[3] > count * 4 || count > UINT32_MAX)
        return NULL;
    scan.bound = words[3];
    scan.ids = malloc(((size_t)scan.bound + 1) * sizeof *scan.ids);
    if (!scan.ids)
        return NULL;
    for (uint32_t i = 0; i < scan.bound; i++)
        scan.ids[i] = (struct id){NOWHERE, NOWHERE, NOWHERE, NOWHERE, 0, false};
    for (size_t at = 5; (size = length(&scan, at)); at += size)
        declare(&scan, at, size);
    if (scan.entry_count == 1 && scan.stage)
        uses = calloc(1, sizeof *uses + MAX_USES * sizeof uses->uses[0]);
    if (uses) {
        uses->references = 1;
        for (size_t at = 5; (size = length(&scan, at)); at += size) {
            const struct id *variable = traced(&scan, at, size);
            if (variable)
                add(uses, &scan, at, size, variable, false);
        }
        follow(&scan, uses);
    }
    free(scan.ids);
    return uses;
}

void gn_uses_module_created(struct gn_device *device, VkShaderModule module, const VkShaderModuleCreateInfo *info)
{
    struct gn_static_uses *uses = static_uses_scan(info->pCode, info->codeSize / 4);
    if (!uses && gn_spirv_has_queries(info->pCode, info->codeSize / 4))
        gn_tally_unjudged(device, GN_UNJUDGED_unfollowed_modules, 1);
    if (!uses)
        return;
    gn_lock(device);
    if (!uses->count || !gn_map_put(&device->modules, (uint64_t)module, uses))
        gn_static_uses_release(uses);
    gn_unlock(device);
}

void gn_uses_module_destroyed(struct gn_device *device, VkShaderModule module)
{
    gn_lock(device);
    gn_static_uses_release(gn_map_take(&device->modules, (uint64_t)module));
    gn_unlock(device);
}

/* Adds what a stage or a library traces through to what the pipeline does; the old list is given up. */
static struct gn_static_uses *joined(struct gn_static_uses *uses, const struct gn_static_uses *more)
{
    uint32_t count = uses ? uses->count : 0;
    if (!more || !more->count)
        return uses;
    struct gn_static_uses *grown =
        realloc(uses, sizeof *grown + ((size_t)count + more->count) * sizeof grown->uses[0]);
    if (!grown)
        return uses;
    memcpy(grown->uses + count, more->uses, more->count * sizeof more->uses[0]);
    grown->references = 1;
    grown->count = count + more->count;
    grown->one_raygen = false;
    return grown;
}

static struct gn_static_uses *joined_stage(struct gn_device *device, struct gn_static_uses *uses,
                                           const VkPipelineShaderStageCreateInfo *stage)
{
    const VkShaderModuleCreateInfo *code = gn_chain_find(stage->pNext, VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO);
    if (stage->module)
        return joined(uses, gn_map_get(&device->modules, (uint64_t)stage->module));
    struct gn_static_uses *scanned = code ? static_uses_scan(code->pCode, code->codeSize / 4) : NULL;
    uses = joined(uses, scanned);
    gn_static_uses_release(scanned);
    return uses;
}

static struct gn_static_uses *joined_libraries(struct gn_device *device, struct gn_static_uses *uses,
                                               const VkPipelineLibraryCreateInfoKHR *libraries)
{
    for (uint32_t i = 0; libraries && i < libraries->libraryCount; i++)
        uses = joined(uses, gn_map_get(&device->pipelines, (uint64_t)libraries->pLibraries[i]));
    return uses;
}

static void remember(struct gn_device *device, VkPipeline pipeline, struct gn_static_uses *uses)
{
    if (!uses)
        return;
    if (!pipeline || !gn_map_put(&device->pipelines, (uint64_t)pipeline, uses)) {
        gn_static_uses_release(uses);
        return;
    }
    atomic_store_explicit(&device->traces, true, memory_order_release);
}

void gn_uses_compute_created(struct gn_device *device, uint32_t count, const VkComputePipelineCreateInfo *infos,
                             const VkPipeline *pipelines)
{
    gn_lock(device);
    for (uint32_t i = 0; i < count; i++)
        remember(device, pipelines[i], joined_stage(device, NULL, &infos[i].stage));
    gn_unlock(device);
}

void gn_uses_graphics_created(struct gn_device *device, uint32_t count, const VkGraphicsPipelineCreateInfo *infos,
                              const VkPipeline *pipelines)
{
    gn_lock(device);
    for (uint32_t i = 0; i < count; i++) {
        struct gn_static_uses *uses = NULL;
        for (uint32_t s = 0; s < infos[i].stageCount; s++)
            uses = joined_stage(device, uses, &infos[i].pStages[s]);
        remember(device, pipelines[i],
                 joined_libraries(device, uses, gn_chain_find(infos[i].pNext, VK_STRUCTURE_TYPE_PIPELINE_LIBRARY_CREATE_INFO_KHR)));
    }
    gn_unlock(device);
}

void gn_uses_rays_created(struct gn_device *device, uint32_t count, const VkRayTracingPipelineCreateInfoKHR *infos,
                          const VkPipeline *pipelines)
{
    gn_lock(device);
    for (uint32_t i = 0; i < count; i++) {
        struct gn_static_uses *uses = NULL;
        uint32_t raygens = 0;
        for (uint32_t s = 0; s < infos[i].stageCount; s++) {
            uses = joined_stage(device, uses, &infos[i].pStages[s]);
            raygens += infos[i].pStages[s].stage == VK_SHADER_STAGE_RAYGEN_BIT_KHR;
        }
        uses = joined_libraries(device, uses, infos[i].pLibraryInfo);
        if (uses)
            uses->one_raygen = raygens == 1 && (!infos[i].pLibraryInfo || !infos[i].pLibraryInfo->libraryCount);
        remember(device, pipelines[i], uses);
    }
    gn_unlock(device);
}

void gn_uses_pipeline_destroyed(struct gn_device *device, VkPipeline pipeline)
{
    gn_lock(device);
    gn_static_uses_release(gn_map_take(&device->pipelines, (uint64_t)pipeline));
    gn_unlock(device);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_CmdBindPipeline(VkCommandBuffer handle, VkPipelineBindPoint point, VkPipeline pipeline)
{
    struct gn_device *device = gn_device_of(handle);
    unsigned at = gn_bind_point(point);
    if (atomic_load_explicit(&device->traces, memory_order_acquire) && at < GN_BIND_COUNT) {
        gn_lock(device);
        struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
        struct gn_static_uses *uses = gn_map_get(&device->pipelines, (uint64_t)pipeline);
        struct gn_bound *bound = commands && (uses || commands->bound) ? gn_bound_of(device, commands) : NULL;
        if (bound && bound->uses[at] != uses) {
            gn_static_uses_release(bound->uses[at]);
            bound->uses[at] = static_uses_keep(uses);
            bound->changed[at] = true;
        }
        gn_unlock(device);
    }
    gn_rays_bound(device, handle, point, pipeline);
    device->next.CmdBindPipeline(handle, point, pipeline);
}

void gn_modules_finish(struct gn_device *device)
{
    size_t cursor = 0;
    struct gn_static_uses *uses;
    while ((uses = gn_map_next(&device->modules, &cursor)))
        gn_static_uses_release(uses);
    for (cursor = 0; (uses = gn_map_next(&device->pipelines, &cursor));)
        gn_static_uses_release(uses);
    gn_map_finish(&device->modules);
    gn_map_finish(&device->pipelines);
}
