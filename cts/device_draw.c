/* SPDX-License-Identifier: Apache-2.0 */
/* Ray queries in vertex and fragment shaders: a ray for each vertex, a ray for each fragment, nothing is drawn to. */
#include <stdlib.h>

#include "cts/device_internal.h"

#include "all_vert.spv.h"
#include "query_frag.spv.h"
#include "query_vert.spv.h"

/* Every device can draw this large. */
#define SIDE 512

struct gn_drawing {
    VkRenderPass pass;
    VkFramebuffer framebuffer;
    VkPipeline vertex, fragment;
};

static enum gn_device_status target_create(struct gn_device *device)
{
    struct gn_drawing *drawing = device->drawing;
    const VkSubpassDescription subpass = {.pipelineBindPoint = VK_PIPELINE_BIND_POINT_GRAPHICS};
    const VkRenderPassCreateInfo pass_info = {
        .sType = VK_STRUCTURE_TYPE_RENDER_PASS_CREATE_INFO,
        .subpassCount = 1,
        .pSubpasses = &subpass,
    };
    enum gn_device_status status = gn_device_check(
        device, vkCreateRenderPass(device->handle, &pass_info, NULL, &drawing->pass), "vkCreateRenderPass");
    if (status != GN_DEVICE_OK) {
        return status;
    }
    const VkFramebufferCreateInfo framebuffer_info = {
        .sType = VK_STRUCTURE_TYPE_FRAMEBUFFER_CREATE_INFO,
        .renderPass = drawing->pass,
        .width = SIDE,
        .height = SIDE,
        .layers = 1,
    };
    return gn_device_check(device,
                           vkCreateFramebuffer(device->handle, &framebuffer_info, NULL, &drawing->framebuffer),
                           "vkCreateFramebuffer");
}

static enum gn_device_status pipeline_create(struct gn_device *device, const uint32_t *vertex, size_t vertex_bytes,
                                             const uint32_t *fragment, size_t fragment_bytes, VkPipeline *out)
{
    const struct {
        const uint32_t *words;
        size_t bytes;
        VkShaderStageFlagBits stage;
    } codes[2] = {{vertex, vertex_bytes, VK_SHADER_STAGE_VERTEX_BIT},
                  {fragment, fragment_bytes, VK_SHADER_STAGE_FRAGMENT_BIT}};
    VkPipelineShaderStageCreateInfo stages[2] = {{0}};
    uint32_t stage_count = 0;
    enum gn_device_status status = GN_DEVICE_OK;
    for (size_t i = 0; i < 2 && codes[i].words; i++) {
        const VkShaderModuleCreateInfo module_info = {
            .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO,
            .codeSize = codes[i].bytes,
            .pCode = codes[i].words,
        };
        stages[i] = (VkPipelineShaderStageCreateInfo){
            .sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
            .stage = codes[i].stage,
            .pName = "main",
        };
        status = gn_device_check(device, vkCreateShaderModule(device->handle, &module_info, NULL, &stages[i].module),
                                 "vkCreateShaderModule");
        if (status != GN_DEVICE_OK) {
            goto done;
        }
        stage_count++;
    }
    const VkPipelineVertexInputStateCreateInfo input = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO,
    };
    const VkPipelineInputAssemblyStateCreateInfo assembly = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_INPUT_ASSEMBLY_STATE_CREATE_INFO,
        .topology = fragment ? VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST : VK_PRIMITIVE_TOPOLOGY_POINT_LIST,
    };
    const VkViewport viewport = {0, 0, SIDE, SIDE, 0, 1};
    const VkRect2D scissor = {{0, 0}, {SIDE, SIDE}};
    const VkPipelineViewportStateCreateInfo view = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_VIEWPORT_STATE_CREATE_INFO,
        .viewportCount = 1,
        .pViewports = &viewport,
        .scissorCount = 1,
        .pScissors = &scissor,
    };
    const VkPipelineRasterizationStateCreateInfo rasterization = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_RASTERIZATION_STATE_CREATE_INFO,
        .rasterizerDiscardEnable = fragment == NULL,
        .polygonMode = VK_POLYGON_MODE_FILL,
        .lineWidth = 1,
    };
    const VkPipelineMultisampleStateCreateInfo samples = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_MULTISAMPLE_STATE_CREATE_INFO,
        .rasterizationSamples = VK_SAMPLE_COUNT_1_BIT,
    };
    const VkPipelineColorBlendStateCreateInfo blend = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_COLOR_BLEND_STATE_CREATE_INFO,
    };
    const VkGraphicsPipelineCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_GRAPHICS_PIPELINE_CREATE_INFO,
        .stageCount = stage_count,
        .pStages = stages,
        .pVertexInputState = &input,
        .pInputAssemblyState = &assembly,
        .pViewportState = &view,
        .pRasterizationState = &rasterization,
        .pMultisampleState = &samples,
        .pColorBlendState = &blend,
        .layout = device->pipeline_layout,
        .renderPass = device->drawing->pass,
    };
    status = gn_device_check(device, vkCreateGraphicsPipelines(device->handle, VK_NULL_HANDLE, 1, &info, NULL, out),
                             "vkCreateGraphicsPipelines");
done:
    for (size_t i = 0; i < 2; i++) {
        vkDestroyShaderModule(device->handle, stages[i].module, NULL);
    }
    return status;
}

enum gn_device_status gn_drawing_prepare(struct gn_device *device, enum gn_cts_entry entry)
{
    const bool in_vertex = entry == GN_CTS_QUERY_IN_VERTEX;
    if (!device->info.graphics || !(in_vertex ? device->info.vertex_stores : device->info.fragment_stores)) {
        return gn_device_fail(device, GN_DEVICE_UNSUPPORTED, "the device cannot draw, or lacks %s",
                              in_vertex ? "vertexPipelineStoresAndAtomics" : "fragmentStoresAndAtomics");
    }
    if (!device->drawing) {
        device->drawing = calloc(1, sizeof *device->drawing);
        if (!device->drawing) {
            return gn_device_fail(device, GN_DEVICE_FAILED, "no host memory for a drawing");
        }
        const enum gn_device_status status = target_create(device);
        if (status != GN_DEVICE_OK) {
            return status;
        }
    }
    VkPipeline *pipeline = in_vertex ? &device->drawing->vertex : &device->drawing->fragment;
    if (*pipeline) {
        return GN_DEVICE_OK;
    }
    return in_vertex ? pipeline_create(device, query_vert_spv, sizeof query_vert_spv, NULL, 0, pipeline)
                     : pipeline_create(device, all_vert_spv, sizeof all_vert_spv, query_frag_spv, sizeof query_frag_spv,
                                       pipeline);
}

enum gn_device_status gn_drawing_chunk(struct gn_device *device, enum gn_cts_entry entry,
                                       const struct gn_trace_constants *constants)
{
    const struct gn_drawing *drawing = device->drawing;
    const bool in_vertex = entry == GN_CTS_QUERY_IN_VERTEX;
    struct gn_trace_constants own = *constants;
    own.width = SIDE;
    own.height = SIDE;
    if (own.ray_count > SIDE * SIDE) {
        return gn_device_fail(device, GN_DEVICE_FAILED, "a chunk of %u rays has no room in %d x %d fragments",
                              own.ray_count, SIDE, SIDE);
    }
    enum gn_device_status status = gn_device_begin(device);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    const VkRenderPassBeginInfo begin = {
        .sType = VK_STRUCTURE_TYPE_RENDER_PASS_BEGIN_INFO,
        .renderPass = drawing->pass,
        .framebuffer = drawing->framebuffer,
        .renderArea = {{0, 0}, {SIDE, SIDE}},
    };
    vkCmdBeginRenderPass(device->commands, &begin, VK_SUBPASS_CONTENTS_INLINE);
    gn_trace_bind(device, VK_PIPELINE_BIND_POINT_GRAPHICS, in_vertex ? drawing->vertex : drawing->fragment, &own);
    vkCmdDraw(device->commands, in_vertex ? own.ray_count : 3, 1, 0, 0);
    vkCmdEndRenderPass(device->commands);
    return gn_device_submit(device);
}

void gn_drawing_finish(struct gn_device *device)
{
    struct gn_drawing *drawing = device->drawing;
    if (!drawing) {
        return;
    }
    vkDestroyPipeline(device->handle, drawing->vertex, NULL);
    vkDestroyPipeline(device->handle, drawing->fragment, NULL);
    vkDestroyFramebuffer(device->handle, drawing->framebuffer, NULL);
    vkDestroyRenderPass(device->handle, drawing->pass, NULL);
    free(drawing);
    device->drawing = NULL;
}
