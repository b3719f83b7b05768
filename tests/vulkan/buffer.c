/* SPDX-License-Identifier: Apache-2.0 */
/* See buffer.h. */
#include "tests/vulkan/buffer.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#define REQUIRE(call) assert_int_equal(call, VK_SUCCESS)

struct buffer gn_test_buffer_create(VkPhysicalDevice physical, VkDevice device, VkDeviceSize size, VkBufferUsageFlags usage)
{
    struct buffer buffer = {.size = size};
    VkBufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                               .size = size,
                               .usage = usage | VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT};
    REQUIRE(vkCreateBuffer(device, &info, NULL, &buffer.handle));
    VkMemoryRequirements needs;
    vkGetBufferMemoryRequirements(device, buffer.handle, &needs);
    VkPhysicalDeviceMemoryProperties memory;
    vkGetPhysicalDeviceMemoryProperties(physical, &memory);
    const VkMemoryPropertyFlags wanted = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    uint32_t type = 0;
    while (type < memory.memoryTypeCount &&
           !((needs.memoryTypeBits >> type & 1) && (memory.memoryTypes[type].propertyFlags & wanted) == wanted))
        type++;
    assert_true(type < memory.memoryTypeCount);
    VkMemoryAllocateFlagsInfo flags = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO,
                                       .flags = VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT};
    VkMemoryAllocateInfo allocation = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
                                       .pNext = &flags,
                                       .allocationSize = needs.size,
                                       .memoryTypeIndex = type};
    REQUIRE(vkAllocateMemory(device, &allocation, NULL, &buffer.memory));
    REQUIRE(vkBindBufferMemory(device, buffer.handle, buffer.memory, 0));
    REQUIRE(vkMapMemory(device, buffer.memory, 0, VK_WHOLE_SIZE, 0, &buffer.mapped));
    memset(buffer.mapped, 0, size);
    VkBufferDeviceAddressInfo address = {.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO, .buffer = buffer.handle};
    buffer.address = vkGetBufferDeviceAddress(device, &address);
    return buffer;
}

void gn_test_buffer_destroy(VkDevice device, struct buffer *buffer)
{
    vkDestroyBuffer(device, buffer->handle, NULL);
    vkFreeMemory(device, buffer->memory, NULL);
    *buffer = (struct buffer){0};
}
