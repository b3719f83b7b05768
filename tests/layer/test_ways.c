/* SPDX-License-Identifier: Apache-2.0 */
/* Ways of a shader to the driver on which the layer cannot follow it, above a fake next layer: what was asked for arrives as it is, and the
 * statement counts it. */
#include <stdlib.h>
#include <string.h>

#include "layer/shader.h"
#include "tests/layer/fake.h"

/* What the next layer was given. */
static const void *seen;

static VKAPI_ATTR VkResult VKAPI_CALL create_compute(VkDevice device, VkPipelineCache cache, uint32_t count,
                                                     const VkComputePipelineCreateInfo *infos, const VkAllocationCallbacks *allocator,
                                                     VkPipeline *out)
{
    (void)device, (void)cache, (void)allocator;
    seen = infos;
    memset(out, 0, count * sizeof *out);
    return VK_PIPELINE_COMPILE_REQUIRED;
}

static VKAPI_ATTR VkResult VKAPI_CALL create_rays(VkDevice device, VkDeferredOperationKHR deferred, VkPipelineCache cache, uint32_t count,
                                                  const VkRayTracingPipelineCreateInfoKHR *infos, const VkAllocationCallbacks *allocator,
                                                  VkPipeline *out)
{
    (void)device, (void)deferred, (void)cache, (void)count, (void)allocator, (void)out;
    seen = infos;
    return VK_OPERATION_DEFERRED_KHR;
}

static VKAPI_ATTR VkResult VKAPI_CALL create_objects(VkDevice device, uint32_t count, const VkShaderCreateInfoEXT *infos,
                                                     const VkAllocationCallbacks *allocator, VkShaderEXT *out)
{
    (void)device, (void)allocator;
    seen = infos->pCode;
    memset(out, 0, count * sizeof *out);
    return VK_SUCCESS;
}

static int begin(void **state)
{
    if (set_up(state) != 0)
        return -1;
    struct gn_device *device = ((struct fixture *)*state)->device;
    device->shaders = calloc(1, sizeof *device->shaders);
    device->next.CreateComputePipelines = create_compute;
    device->next.CreateShadersEXT = create_objects;
    device->next.CreateRayTracingPipelinesKHR = create_rays;
    seen = NULL;
    return device->shaders ? 0 : -1;
}

static int end(void **state)
{
    struct fixture *fixture = *state;
    free(fixture->device->shaders);
    fixture->device->shaders = NULL;
    return tear_down(state);
}

static void create(struct fixture *fixture, const void *of_stage, const void *of_pipeline)
{
    VkPipeline pipeline;
    const VkComputePipelineCreateInfo info = {.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
                                              .pNext = of_pipeline,
                                              .stage = {.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                        .pNext = of_stage,
                                                        .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                                                        .pName = "main"}};
    assert_int_equal(gn_entry_CreateComputePipelines(fixture->handle, VK_NULL_HANDLE, 1, &info, NULL, &pipeline), VK_PIPELINE_COMPILE_REQUIRED);
    assert_ptr_equal(seen, &info);
}

/* The application asks whether the driver has the shader in its cache. */
static void identifier(void **state)
{
    const uint8_t bytes[4] = {1, 2, 3, 4};
    const VkPipelineShaderStageModuleIdentifierCreateInfoEXT known = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_MODULE_IDENTIFIER_CREATE_INFO_EXT, .identifierSize = 4, .pIdentifier = bytes};
    create(*state, &known, NULL);
    assert_int_equal(unjudged(*state, GN_UNJUDGED_shader_identifiers), 1);
    assert_int_equal(unjudged(*state, GN_UNJUDGED_shader_binaries), 0);
}

static void pipeline_binary(void **state)
{
    VkPipelineBinaryKHR binary = VK_NULL_HANDLE;
    VkPipelineBinaryInfoKHR binaries = {.sType = VK_STRUCTURE_TYPE_PIPELINE_BINARY_INFO_KHR, .binaryCount = 1, .pPipelineBinaries = &binary};
    create(*state, NULL, &binaries);
    assert_int_equal(unjudged(*state, GN_UNJUDGED_shader_binaries), 1);
    binaries.binaryCount = 0; /* asks for none */
    create(*state, NULL, &binaries);
    assert_int_equal(unjudged(*state, GN_UNJUDGED_shader_binaries), 1);
}

static void shader_binary(void **state)
{
    struct fixture *fixture = *state;
    const uint32_t code[4] = {0};
    VkShaderEXT object;
    const VkShaderCreateInfoEXT info = {.sType = VK_STRUCTURE_TYPE_SHADER_CREATE_INFO_EXT,
                                        .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                                        .codeType = VK_SHADER_CODE_TYPE_BINARY_EXT,
                                        .codeSize = sizeof code,
                                        .pCode = code,
                                        .pName = "main"};
    assert_int_equal(gn_entry_CreateShadersEXT(fixture->handle, 1, &info, NULL, &object), VK_SUCCESS);
    assert_ptr_equal(seen, code);
    assert_int_equal(unjudged(fixture, GN_UNJUDGED_shader_binaries), 1);
}

/* Not even with the shader checks off may there be anything to keep for later. */
static void deferred(void **state)
{
    struct fixture *fixture = *state;
    struct gn_shaders *shaders = fixture->device->shaders;
    VkPipeline pipeline;
    const VkRayTracingPipelineCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_RAY_TRACING_PIPELINE_CREATE_INFO_KHR};
    fixture->device->shaders = NULL;
    assert_int_equal(gn_entry_CreateRayTracingPipelinesKHR(fixture->handle, VK_NULL_HANDLE, VK_NULL_HANDLE, 1, &info, NULL, &pipeline),
                     VK_OPERATION_DEFERRED_KHR);
    assert_ptr_equal(seen, &info);
    fixture->device->shaders = shaders;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(identifier, begin, end),
        cmocka_unit_test_setup_teardown(pipeline_binary, begin, end),
        cmocka_unit_test_setup_teardown(shader_binary, begin, end),
        cmocka_unit_test_setup_teardown(deferred, begin, end),
    };
    return cmocka_run_group_tests_name("layer.ways", tests, NULL, NULL);
}
