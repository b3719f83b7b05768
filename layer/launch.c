/* SPDX-License-Identifier: Apache-2.0 */
/* What a shader cannot see of the trace that it runs in (enum gn_launch_word) is written into the header of the table before each trace
 * whose shaders ask for it. Barriers keep the traces of one queue apart there; where several queues have such traces, what they counted
 * is not told. */
#include "layer/sbt.h"
#include "layer/shader.h"

/* With the device locked. A pipeline that is not known may hold any shader. */
static bool asks(const struct gn_device *device, const struct gn_command_buffer *commands)
{
    const struct gn_shaders *shaders = device->shaders;
    if (!commands || !shaders->asks_launch || !shaders->root_buffer)
        return false;
    if (!commands->rays)
        return true;
    const struct gn_pipeline *pipeline = gn_map_get(&shaders->pipelines, (uint64_t)commands->rays->handle);
    return pipeline && pipeline->asks_launch;
}

void gn_launch_tell(struct gn_device *device, VkCommandBuffer handle, const VkStridedDeviceAddressRegionKHR *callable)
{
    const VkPipelineStageFlags traces = VK_PIPELINE_STAGE_RAY_TRACING_SHADER_BIT_KHR, transfer = VK_PIPELINE_STAGE_TRANSFER_BIT;
    const VkAccessFlags shader = VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT;
    const VkMemoryBarrier before = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                    .srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT,
                                    .dstAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT | shader},
                          after = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                   .srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT,
                                   .dstAccessMask = shader};
    struct gn_shaders *shaders = device->shaders;
    if (!shaders)
        return;
    gn_lock(device);
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    bool wanted = asks(device, commands) && gn_command_buffer_next(commands);
    VkBuffer buffer = shaders->root_buffer;
    uint32_t words[] = {0, shaders->depths, shaders->depth_count};
    if (wanted)
        commands->recording->launches = true;
    gn_unlock(device);
    if (!wanted)
        return;
    if (callable && callable->stride) {
        uint64_t records = gn_sbt_region_of(GN_SBT_CALLABLE, callable, device->ray_limits.shaderGroupHandleSize).records;
        words[0] = records < UINT32_MAX ? (uint32_t)records + 1 : 0;
    } else if (callable && !callable->size) {
        words[0] = 1;
    } else {
        gn_tally_unjudged(device, GN_UNJUDGED_callables, 1);
    }
    _Static_assert(GN_LAUNCH_DEPTHS == GN_LAUNCH_CALLABLES + 1 && GN_LAUNCH_DEPTH_COUNT == GN_LAUNCH_DEPTHS + 1, "one after the other");
    device->next.CmdPipelineBarrier(handle, traces | transfer, traces | transfer, 0, 1, &before, 0, NULL, 0, NULL);
    device->next.CmdUpdateBuffer(handle, buffer, GN_LAUNCH_CALLABLES * 4, sizeof words, words);
    device->next.CmdPipelineBarrier(handle, transfer, traces, 0, 1, &after, 0, NULL, 0, NULL);
}

void gn_launch_executed(struct gn_device *device, uint32_t queue)
{
    struct gn_shaders *shaders = device->shaders;
    if (shaders->launched && shaders->launch_queue != queue && !shaders->launch_unsure) {
        shaders->launch_unsure = true;
        uint32_t *root = atomic_load(&shaders->root);
        if (root)
            __atomic_store_n(&root[GN_ROOT_UNSURE], 1, __ATOMIC_RELAXED);
    }
    shaders->launched = true;
    shaders->launch_queue = queue;
}

bool gn_launch_matters(const struct gn_spirv_site *site, enum gn_spirv_rule_index rule)
{
    return (rule == GN_SPIRV_RULE_CALL_RANGE || rule == GN_SPIRV_RULE_TRACE_RECURSION) && !(site->wrong >> rule & 1);
}
