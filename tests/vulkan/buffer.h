/* SPDX-License-Identifier: Apache-2.0 */
/* Buffers that the host and shaders see, for tests. What cannot be done fails the test. */
#ifndef GN_TESTS_VULKAN_BUFFER_H
#define GN_TESTS_VULKAN_BUFFER_H

#include <vulkan/vulkan.h>

struct buffer {
    VkBuffer handle;
    VkDeviceMemory memory;
    VkDeviceSize size;
    VkDeviceAddress address;
    void *mapped;
};

/* Filled with zeros, mapped, with an address of its own; `usage` is what it needs beside that. */
struct buffer gn_test_buffer_create(VkPhysicalDevice physical, VkDevice device, VkDeviceSize size, VkBufferUsageFlags usage);
void gn_test_buffer_destroy(VkDevice device, struct buffer *buffer);

#endif
