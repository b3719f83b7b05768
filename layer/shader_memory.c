/* SPDX-License-Identifier: Apache-2.0 */
/* The memory that shaders leave records in: a table whose address is part of every instrumented module, and a record buffer per shader,
 * both host-visible and coherent, so that what a lost device left can still be read.
 *
 * The memory is a file where it is to outlive the process (left.c), else memory of the host, so that it can be read after the driver is gone, else the
 * driver's. A module is the same in every run only if the table's address is. Where the device can import memory of the host and sees it at the
 * host's own address, the layer takes a fixed one; elsewhere the address is whatever the driver says, drivers cache such modules in vain, and the
 * closing statement says so. */
#include "layer/shader.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define TABLE_CAPACITY 16384u
#define PIECE_BYTES ((size_t)8 << 20)
#define DEPTHS ((size_t)4 << 20) /* launch indices whose depth of recursion is counted */
#define STRIDE ((uintptr_t)64 << 20)
#define PLACES 1024

/* Addresses that programs hardly use: below the 512 GiB that ThreadSanitizer leaves to a program, and, as AddressSanitizer keeps
 * that place for itself, another one. */
static const uintptr_t bases[] = {UINT64_C(0x4700000000), UINT64_C(0x2A0000000000)};

#ifndef MAP_FIXED_NOREPLACE
#define MAP_FIXED_NOREPLACE 0x100000
#endif

/* Of the file, or of none if it is negative. NULL when there is no room. */
static void *map_somewhere_fixed(size_t size, int file)
{
    const int flags = file < 0 ? MAP_PRIVATE | MAP_ANONYMOUS : MAP_SHARED;
    for (size_t b = 0; b < sizeof bases / sizeof bases[0]; b++)
        for (uintptr_t i = 0; i < PLACES; i++) {
            void *wanted = (void *)(bases[b] + i * STRIDE); // NOLINT: an address of our choice
            void *got = mmap(wanted, size, PROT_READ | PROT_WRITE, flags | MAP_FIXED_NOREPLACE, file, 0);
            if (got == wanted)
                return got;
            if (got != MAP_FAILED)
                munmap(got, size);
        }
    void *anywhere = mmap(NULL, size, PROT_READ | PROT_WRITE, flags, file, 0);
    return anywhere != MAP_FAILED ? anywhere : NULL;
}

static uint32_t memory_type(const struct gn_device *device, uint32_t allowed)
{
    const VkMemoryPropertyFlags coherent = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    for (uint32_t i = 0; i < device->memory.memoryTypeCount; i++)
        if ((allowed >> i & 1) && (device->memory.memoryTypes[i].propertyFlags & coherent) == coherent)
            return i;
    return UINT32_MAX;
}

static void memory_free(struct gn_device *device, struct gn_record_memory *memory)
{
    if (!memory)
        return;
    if (memory->buffer)
        device->next.DestroyBuffer(device->handle, memory->buffer, NULL);
    if (memory->memory)
        device->next.FreeMemory(device->handle, memory->memory, NULL);
    if (memory->mapping)
        munmap(memory->mapping, memory->word_count * 4);
    free(memory);
}

/* Where a piece of memory is from. */
enum origin { FROM_FILE, FROM_HOST, FROM_DRIVER };

static bool map_own(struct gn_device *device, struct gn_record_memory *memory, size_t bytes, enum origin origin)
{
    int file = origin == FROM_FILE ? gn_left_piece(device->shaders->left, bytes, &memory->piece) : -1;
    if (origin == FROM_FILE && file < 0)
        return false;
    memory->outlives = origin == FROM_FILE;
    memory->mapping = map_somewhere_fixed(bytes, file);
    if (file >= 0)
        close(file);
    return memory->mapping != NULL;
}

static struct gn_record_memory *memory_create(struct gn_device *device, size_t bytes, enum origin origin)
{
    const bool import = origin != FROM_DRIVER;
    const VkExternalMemoryHandleTypeFlagBits of_host = VK_EXTERNAL_MEMORY_HANDLE_TYPE_HOST_ALLOCATION_BIT_EXT;
    struct gn_record_memory *memory = calloc(1, sizeof *memory);
    void *mapped = NULL;
    if (!memory)
        return NULL;
    memory->word_count = bytes / 4;
    if (import && !map_own(device, memory, bytes, origin))
        goto fail;
    VkExternalMemoryBufferCreateInfo external = {.sType = VK_STRUCTURE_TYPE_EXTERNAL_MEMORY_BUFFER_CREATE_INFO,
                                                 .handleTypes = of_host};
    VkBufferCreateInfo buffer = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                                 .pNext = import ? &external : NULL,
                                 .size = bytes,
                                 .usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT |
                                          VK_BUFFER_USAGE_TRANSFER_DST_BIT,
                                 .sharingMode = device->family_count > 1 ? VK_SHARING_MODE_CONCURRENT
                                                                         : VK_SHARING_MODE_EXCLUSIVE,
                                 .queueFamilyIndexCount = device->family_count,
                                 .pQueueFamilyIndices = device->families};
    if (device->next.CreateBuffer(device->handle, &buffer, NULL, &memory->buffer) != VK_SUCCESS)
        goto fail;
    VkMemoryRequirements needs;
    device->next.GetBufferMemoryRequirements(device->handle, memory->buffer, &needs);
    VkMemoryHostPointerPropertiesEXT pointer = {.sType = VK_STRUCTURE_TYPE_MEMORY_HOST_POINTER_PROPERTIES_EXT};
    if (import && (needs.size > bytes || !device->next.GetMemoryHostPointerPropertiesEXT ||
                   device->next.GetMemoryHostPointerPropertiesEXT(device->handle, of_host, memory->mapping, &pointer) != VK_SUCCESS))
        goto fail;
    VkImportMemoryHostPointerInfoEXT imported = {.sType = VK_STRUCTURE_TYPE_IMPORT_MEMORY_HOST_POINTER_INFO_EXT,
                                                 .handleType = of_host,
                                                 .pHostPointer = memory->mapping};
    VkMemoryAllocateFlagsInfo flags = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO,
                                       .pNext = import ? &imported : NULL,
                                       .flags = VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT};
    VkMemoryAllocateInfo allocation = {
        .sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
        .pNext = &flags,
        .allocationSize = import ? bytes : needs.size,
        .memoryTypeIndex = memory_type(device, needs.memoryTypeBits & (import ? pointer.memoryTypeBits : ~0u))};
    if (allocation.memoryTypeIndex == UINT32_MAX ||
        device->next.AllocateMemory(device->handle, &allocation, NULL, &memory->memory) != VK_SUCCESS ||
        device->next.BindBufferMemory(device->handle, memory->buffer, memory->memory, 0) != VK_SUCCESS)
        goto fail;
    if (!import && device->next.MapMemory(device->handle, memory->memory, 0, VK_WHOLE_SIZE, 0, &mapped) != VK_SUCCESS)
        goto fail;
    memory->words = import ? memory->mapping : mapped;
    VkBufferDeviceAddressInfo address = {.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO, .buffer = memory->buffer};
    memory->address = device->next.GetBufferDeviceAddress(device->handle, &address);
    if (memory->address)
        return memory;
fail:
    memory_free(device, memory);
    return NULL;
}

/* The newest piece is the one that is filled. */
static bool memory_add(struct gn_device *device, size_t bytes)
{
    struct gn_shaders *shaders = device->shaders;
    struct gn_record_memory *memory = shaders->left && shaders->host_memory ? memory_create(device, bytes, FROM_FILE) : NULL;
    if (!memory && shaders->host_memory)
        memory = memory_create(device, bytes, FROM_HOST);
    if (!memory && !(memory = memory_create(device, bytes, FROM_DRIVER)))
        return false;
    if (!shaders->memory)
        shaders->stable = memory->mapping && memory->address == (uint64_t)(uintptr_t)memory->mapping;
    memory->next = shaders->memory;
    shaders->memory = memory;
    return true;
}

bool gn_record_memory_begin(struct gn_device *device)
{
    struct gn_shaders *shaders = device->shaders;
    if (atomic_load(&shaders->root))
        return true;
    if (shaders->no_records)
        return false;
    shaders->left = gn_left_begin(device->instance);
    /* At a depth of 1 there is nothing to count. */
    size_t depths = device->ray_limits.maxRayRecursionDepth > 1 ? DEPTHS : 0;
    if (!device->next.GetBufferDeviceAddress || !memory_add(device, PIECE_BYTES + depths * 4)) {
        shaders->no_records = "no host-visible memory with a device address was left for records";
        return false;
    }
    shaders->root_buffer = shaders->memory->buffer;
    shaders->depths = GN_ROOT_WORDS(TABLE_CAPACITY);
    shaders->depth_count = (uint32_t)depths;
    shaders->memory->used = shaders->depths + depths;
    gn_root_reset(shaders->memory->words, TABLE_CAPACITY);
    if (!shaders->memory->mapping) /* what is mapped afresh holds zeros */
        memset(shaders->memory->words + shaders->depths, 0, depths * 4);
    atomic_store(&shaders->root, shaders->memory->words);
    shaders->options.root = shaders->memory->address;
    gn_mirrors_begin(device);
    return true;
}

struct gn_record_memory *gn_record_memory_words(struct gn_device *device, size_t words, size_t alignment, uint32_t **out)
{
    struct gn_record_memory *memory = device->shaders->memory;
    size_t start = memory ? (memory->used + alignment - 1) / alignment * alignment : 0;
    if (!memory || start > memory->word_count || memory->word_count - start < words) {
        size_t bytes = words * 4 > PIECE_BYTES ? (words * 4 + 4095) & ~(size_t)4095 : PIECE_BYTES;
        if (!memory_add(device, bytes))
            return NULL;
        memory = device->shaders->memory;
        start = 0;
    }
    memory->used = start + words;
    *out = memory->words + start;
    return memory;
}

static size_t told_at(uint32_t checks)
{
    return ((size_t)gn_records_word_count(checks) + 1) & ~(size_t)1;
}

size_t gn_record_words(uint32_t checks)
{
    return gn_records_word_count(checks) ? told_at(checks) + 2 * (size_t)checks : 0;
}

void gn_record_memory_lay(struct gn_shader *shader, uint32_t *words)
{
    shader->records = words;
    shader->record_words = gn_records_word_count(shader->result.check_count);
    shader->told = (uint64_t *)(void *)(words + told_at(shader->result.check_count));
}

bool gn_record_memory_take(struct gn_device *device, struct gn_shader *shader)
{
    struct gn_shaders *shaders = device->shaders;
    uint32_t *records, checks = shader->result.check_count;
    size_t words = gn_record_words(checks);
    struct gn_record_memory *memory = words ? gn_record_memory_words(device, words, 4, &records) : NULL;
    if (!memory)
        return false;
    memset(records, 0, words * 4);
    gn_records_reset(records, checks);
    if (!gn_root_enter(atomic_load(&shaders->root), shader->key, memory->address + (uint64_t)(records - memory->words) * 4))
        return false;
    gn_record_memory_lay(shader, records);
    if (memory->outlives && shaders->left)
        gn_left_shader(shaders->left, shader, memory->piece, (size_t)(records - memory->words));
    return true;
}

void gn_record_memory_finish(struct gn_device *device)
{
    for (struct gn_record_memory *memory = device->shaders->memory, *next; memory; memory = next) {
        next = memory->next;
        memory_free(device, memory);
    }
    device->shaders->memory = NULL;
    gn_left_end(device->shaders->left);
    device->shaders->left = NULL;
}
