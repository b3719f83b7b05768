/* SPDX-License-Identifier: Apache-2.0 */
/* Applications without ray tracing: the layer is there, and nothing of it is in their way. */
#include "tests/layer/harness.h"

#include <link.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <vulkan/utility/vk_dispatch_table.h>

/* Commands that may differ on a device without acceleration structures, as docs/layer.md lists them. The loader answers the
 * first with a function of its own, so that an application sees no difference there either. */
#define ALLOWED_DIFFERENCES 2

static void fill(struct world *world)
{
    struct buffer buffer = buffer_create(world, 256, VK_BUFFER_USAGE_TRANSFER_DST_BIT);
    VkCommandBuffer commands = commands_begin(world, 0);
    vkCmdFillBuffer(commands, buffer.handle, 0, 256, 0x12345678);
    commands_barrier(commands);
    commands_end(commands);
    submit_and_wait(world, commands);
    for (int i = 0; i < 64; i++)
        assert_int_equal(((uint32_t *)buffer.mapped)[i], 0x12345678);
    buffer_destroy(world, &buffer);
}

static void device_without_structures(void **state)
{
    (void)state;
    struct world *world = calloc(1, sizeof *world);
    struct world_options options = {.without_structures = true, .creation_messenger = true};
    world_init(world, &options);
    fill(world);
    world_finish(world);
    assert_int_equal(messages_count(world, NEVER_BUILT), 0);
    assert_int_equal(messages_count(world, "statement"), 0);
    assert_int_equal(messages_count(world, "settings"), 0);
    free(world);
}

static void commands_of(const struct world_options *options, VkuDeviceDispatchTable *table)
{
    struct world *world = calloc(1, sizeof *world);
    world_init(world, options);
    memset(table, 0, sizeof *table);
    vkuInitDeviceDispatchTable(world->device, table, vkGetDeviceProcAddr);
    world_finish(world);
    free(world);
}

static size_t differences(const VkuDeviceDispatchTable *a, const VkuDeviceDispatchTable *b)
{
    size_t count = 0;
    for (size_t at = 0; at + sizeof(void *) <= sizeof *a; at += sizeof(void *))
        count += memcmp((const char *)a + at, (const char *)b + at, sizeof(void *)) != 0;
    return count;
}

/* The driver stays loaded, so that its functions have the same addresses in both worlds. */
static void pointers_are_the_next_layers_own(void **state)
{
    (void)state;
    static VkuDeviceDispatchTable with, without, tracked;
    struct world *keeper = calloc(1, sizeof *keeper);
    struct world_options plain = {.without_layer = true, .without_structures = true, .without_messenger = true};
    struct world_options layered = {.without_structures = true, .without_messenger = true};
    struct world_options watched = {.without_messenger = true};
    world_init(keeper, &plain);
    commands_of(&plain, &without);
    commands_of(&layered, &with);
    assert_non_null(without.CmdDispatch);
    assert_in_range(differences(&with, &without), 0, ALLOWED_DIFFERENCES);

    /* The comparison can fail: with acceleration structures it does. */
    commands_of(&watched, &tracked);
    assert_true(differences(&tracked, &without) > 30);
    assert_ptr_equal(tracked.CmdSetViewport, without.CmdSetViewport);
    assert_ptr_not_equal(tracked.QueueSubmit, without.QueueSubmit);
    world_finish(keeper);
    free(keeper);
}

/* Allocations that come from within the layer, told by who calls. */
#ifndef SANITIZED
static _Atomic bool counting;
static _Atomic unsigned counted;
static uintptr_t layer_begin, layer_end;

extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *memory, size_t size);

static void count(void *caller)
{
    if (counting && (uintptr_t)caller >= layer_begin && (uintptr_t)caller < layer_end)
        counted++;
}

__attribute__((visibility("default"))) void *malloc(size_t size)
{
    count(__builtin_return_address(0));
    return __libc_malloc(size);
}

__attribute__((visibility("default"))) void *calloc(size_t number, size_t size)
{
    count(__builtin_return_address(0));
    return __libc_calloc(number, size);
}

__attribute__((visibility("default"))) void *realloc(void *memory, size_t size)
{
    count(__builtin_return_address(0));
    return __libc_realloc(memory, size);
}

static int find_layer(struct dl_phdr_info *info, size_t size, void *unused)
{
    (void)size, (void)unused;
    if (!strstr(info->dlpi_name, "libVkLayer_gnomon_ray_tracing.so"))
        return 0;
    layer_begin = UINTPTR_MAX;
    for (int i = 0; i < info->dlpi_phnum; i++)
        if (info->dlpi_phdr[i].p_type == PT_LOAD) {
            uintptr_t begin = info->dlpi_addr + info->dlpi_phdr[i].p_vaddr, end = begin + info->dlpi_phdr[i].p_memsz;
            layer_begin = begin < layer_begin ? begin : layer_begin;
            layer_end = end > layer_end ? end : layer_end;
        }
    return 1;
}
#endif

static unsigned allocations_of(const struct world_options *options, int frames)
{
#ifdef SANITIZED
    (void)options, (void)frames;
    return 0;
#else
    struct world *world = calloc(1, sizeof *world);
    counted = 0;
    counting = frames < 0; /* the making of a world instead of its frames */
    world_init(world, options);
    counting = false;
    assert_true(dl_iterate_phdr(find_layer, NULL) == 1);
    struct buffer buffer = buffer_create(world, 256, VK_BUFFER_USAGE_TRANSFER_DST_BIT);
    VkFence fence = fence_create(world);
    VkCommandBuffer commands = commands_begin(world, 0);
    commands_end(commands);
    for (int frame = 0; frame < frames; frame++) {
        counting = frame >= 2; /* after the first ones, which may keep what they make */
        vkResetCommandBuffer(commands, 0);
        VkCommandBufferBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
        assert_int_equal(vkBeginCommandBuffer(commands, &begin), VK_SUCCESS);
        vkCmdFillBuffer(commands, buffer.handle, 0, 256, (uint32_t)frame);
        commands_end(commands);
        submit(world, commands, fence);
        assert_int_equal(vkWaitForFences(world->device, 1, &fence, VK_TRUE, UINT64_MAX), VK_SUCCESS);
        assert_int_equal(vkResetFences(world->device, 1, &fence), VK_SUCCESS);
    }
    counting = false;
    vkDestroyFence(world->device, fence, NULL);
    buffer_destroy(world, &buffer);
    world_finish(world);
    free(world);
    return counted;
#endif
}

static void nothing_is_allocated_per_frame(void **state)
{
    (void)state;
    struct world_options plain = {.without_structures = true};
#ifdef SANITIZED
    print_message("a sanitizer has the allocator for itself\n");
    skip();
#endif
    assert_int_equal(allocations_of(&plain, 50), 0);
    assert_true(allocations_of(&plain, -1) > 0); /* the count can rise */
}

static void an_extension_that_is_off_stays_off(void **state)
{
    (void)state;
    struct world *world = calloc(1, sizeof *world);
    struct world_options options = {.without_structures = true};
    world_init(world, &options);
    assert_null(vkGetDeviceProcAddr(world->device, "vkCmdBuildAccelerationStructuresKHR"));
    assert_null(vkGetDeviceProcAddr(world->device, "vkCmdNothingAtAll"));
    assert_null(vkGetInstanceProcAddr(world->instance, "vkNothingAtAll"));
    world_finish(world);
    free(world);
}

static void vulkaninfo(void **state)
{
    (void)state;
#ifdef SANITIZED
    print_message("a sanitized layer cannot be loaded by a program that is not\n");
    skip();
#endif
    char log[] = "/tmp/gnomon-info-XXXXXX", line[512];
    int file = mkstemp(log);
    assert_true(file >= 0);
    close(file);
    setenv("VK_INSTANCE_LAYERS", "VK_LAYER_GNOMON_ray_tracing", 1);
    setenv("VK_GNOMON_RAY_TRACING_LOG_FILE", log, 1);
    FILE *pipe = popen("vulkaninfo --summary 2>&1", "r");
    assert_non_null(pipe);
    bool device = false, chatter = false;
    while (fgets(line, sizeof line, pipe)) {
        device |= strstr(line, "deviceName") != NULL;
        chatter |= strncmp(line, "gnomon:", 7) == 0;
    }
    int status = pclose(pipe);
    unsetenv("VK_INSTANCE_LAYERS");
    unsetenv("VK_GNOMON_RAY_TRACING_LOG_FILE");
    char *text = file_read(log);
    unlink(log);
    assert_int_equal(status, 0);
    assert_true(device);
    assert_false(chatter);
    assert_non_null(text);
    assert_non_null(strstr(text, "\"statement\"")); /* so the layer was really there */
    free(text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(device_without_structures),
        cmocka_unit_test(pointers_are_the_next_layers_own),
        cmocka_unit_test(nothing_is_allocated_per_frame),
        cmocka_unit_test(an_extension_that_is_off_stays_off),
        cmocka_unit_test(vulkaninfo),
    };
    return cmocka_run_group_tests_name("passthrough", tests, NULL, NULL);
}
