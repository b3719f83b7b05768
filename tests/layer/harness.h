/* SPDX-License-Identifier: Apache-2.0 */
/* A small Vulkan program under the real loader, the real layer and a real driver, for the layer's tests. Every
 * function that cannot do its work fails the test. */
#ifndef GN_TESTS_LAYER_HARNESS_H
#define GN_TESTS_LAYER_HARNESS_H

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <vulkan/vulkan.h>

#include "tests/vulkan/buffer.h"

#define NEVER_BUILT "build.order.blas_never_built"

/* The commands of VK_KHR_acceleration_structure and VK_EXT_debug_utils that the tests use. */
#define WORLD_COMMANDS(X)                                                                                              \
    X(CreateAccelerationStructureKHR)                                                                                  \
    X(DestroyAccelerationStructureKHR)                                                                                 \
    X(GetAccelerationStructureBuildSizesKHR)                                                                           \
    X(GetAccelerationStructureDeviceAddressKHR)                                                                        \
    X(CmdBuildAccelerationStructuresKHR)                                                                               \
    X(CmdCopyAccelerationStructureKHR)                                                                                 \
    X(CmdCopyAccelerationStructureToMemoryKHR)                                                                         \
    X(CmdCopyMemoryToAccelerationStructureKHR)                                                                         \
    X(CmdWriteAccelerationStructuresPropertiesKHR)                                                                     \
    X(SetDebugUtilsObjectNameEXT)                                                                                      \
    X(SetDebugUtilsObjectTagEXT)

/* What the application's messenger received. */
struct message {
    char id[128];
    char text[4096];
    VkDebugUtilsMessageSeverityFlagBitsEXT severity;
    uint32_t object_count;
    uint64_t objects[4];
    char names[4][64];
};

struct messages {
    struct message list[64];
    uint32_t count; /* all, also those that found no room */
};

struct world_options {
    bool without_layer;
    bool without_structures; /* a device without ray tracing */
    bool without_messenger;
    bool creation_messenger; /* the messenger in the pNext chain of instance creation */
    const VkLayerSettingEXT *settings;
    uint32_t setting_count;
    /* More that the device has: at most 8 extensions, and a chain of features. */
    const char *const *extensions;
    uint32_t extension_count;
    void *features;
};

/* An acceleration structure with its memory and what builds it: one triangle, or instances. */
struct structure {
    VkAccelerationStructureKHR handle;
    VkAccelerationStructureTypeKHR type; /* as it is built */
    VkDeviceAddress address;
    VkDeviceSize size;
    struct buffer storage, scratch, input;
    uint32_t count;
    VkBuildAccelerationStructureFlagsKHR flags;
    VkGeometryFlagsKHR geometry_flags;
    uint32_t max_vertex;      /* of a BLAS; 2 at first */
    uint32_t offset;          /* primitiveOffset */
    bool twice;               /* with two geometries, which are equal */
    bool owns_storage;
};

struct world {
    VkInstance instance;
    VkPhysicalDevice physical;
    VkDevice device;
    VkQueue queue;
    VkCommandPool pool;
    VkDebugUtilsMessengerEXT messenger;
    struct messages messages;
    const char *rule; /* the rule whose findings are expected; NEVER_BUILT at first */
    bool above_khronos;
#define X(name) PFN_vk##name name;
    WORLD_COMMANDS(X)
#undef X
};

/* With options NULL: the layer, a messenger, and acceleration structures. The environment variable GNOMON_TEST_BENEATH names a
 * layer to put between ours and the driver. */
void world_init(struct world *world, const struct world_options *options);
void world_finish(struct world *world);

struct buffer buffer_create(struct world *world, VkDeviceSize size, VkBufferUsageFlags usage);
void buffer_destroy(struct world *world, struct buffer *buffer);

/* A BLAS of one triangle, not built yet. `type` may be GENERIC. */
struct structure blas_create(struct world *world, VkAccelerationStructureTypeKHR type,
                             VkBuildAccelerationStructureFlagsKHR flags);
/* The same of two equal geometries. */
struct structure blas_create_twice(struct world *world);
/* A structure of `size` bytes without input, as the target of a copy. */
struct structure target_create(struct world *world, VkAccelerationStructureTypeKHR type, VkDeviceSize size);
/* A TLAS of `count` instances, all references 0. */
struct structure tlas_create(struct world *world, uint32_t count);
/* Only the handle, so that its memory and address can be used again. */
void structure_destroy_handle(struct world *world, struct structure *structure);
void structure_create_handle(struct world *world, struct structure *structure, VkAccelerationStructureTypeKHR type);
void structure_destroy(struct world *world, struct structure *structure);
void structure_name(struct world *world, const struct structure *structure, const char *name);
/* The record of instance `index`, in memory that the host writes. */
VkAccelerationStructureInstanceKHR *tlas_instance(struct structure *tlas, uint32_t index);
/* Writes the record of instance `index` from the host: the identity, mask 0xFF, and this reference. */
void tlas_refer(struct structure *tlas, uint32_t index, VkDeviceAddress reference);

VkCommandBuffer commands_begin(struct world *world, VkCommandBufferUsageFlags flags);
VkCommandBuffer secondary_begin(struct world *world, VkCommandBufferUsageFlags flags);
void commands_end(VkCommandBuffer commands);
void commands_build(struct world *world, VkCommandBuffer commands, struct structure *const *structures, uint32_t count);
void commands_build_one(struct world *world, VkCommandBuffer commands, struct structure *structure);
void commands_update(struct world *world, VkCommandBuffer commands, struct structure *structure);
/* Whatever was written by builds, copies and transfers becomes visible to all that follows, the host included. */
void commands_barrier(VkCommandBuffer commands);
void submit(struct world *world, VkCommandBuffer commands, VkFence fence);
void submit_and_wait(struct world *world, VkCommandBuffer commands);
VkFence fence_create(struct world *world);

/* Messages whose id is `id`. */
uint32_t messages_count(const struct world *world, const char *id);
const struct message *messages_find(const struct world *world, const char *id);
/* Fails the test unless there are `expected` findings of world->rule and none of any other rule, printing every message
 * received. */
void expect_findings(struct world *world, uint32_t expected);

/* The whole file with a terminating zero; the caller frees it. NULL if it is not there. */
char *file_read(const char *path);

#endif
