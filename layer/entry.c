/* SPDX-License-Identifier: Apache-2.0 */
/* How the loader finds the layer: negotiation, the lookup of commands by name, and the way from a dispatchable handle
 * to the layer's state. */
#include "layer/layer.h"

#include <string.h>

/* Instances and devices are few and long-lived, commands are many: readers do not exclude each other. */
static pthread_rwlock_t registry_lock = PTHREAD_RWLOCK_INITIALIZER;
static struct gn_map instances, devices;

/* The loader puts a pointer to its dispatch table first in every dispatchable object; physical devices share their
 * instance's, queues and command buffers their device's. */
static uint64_t key_of(const void *dispatchable)
{
    return (uint64_t)(uintptr_t)*(void *const *)dispatchable;
}

static void *find(const struct gn_map *map, const void *dispatchable)
{
    if (!dispatchable)
        return NULL;
    pthread_rwlock_rdlock(&registry_lock);
    void *found = gn_map_get(map, key_of(dispatchable));
    pthread_rwlock_unlock(&registry_lock);
    return found;
}

static bool enter(struct gn_map *map, uint64_t key, void *value)
{
    pthread_rwlock_wrlock(&registry_lock);
    bool entered = gn_map_put(map, key, value);
    pthread_rwlock_unlock(&registry_lock);
    return entered;
}

static void leave(struct gn_map *map, uint64_t key)
{
    pthread_rwlock_wrlock(&registry_lock);
    gn_map_take(map, key);
    if (!map->count)
        gn_map_finish(map);
    pthread_rwlock_unlock(&registry_lock);
}

struct gn_instance *gn_instance_of(const void *dispatchable)
{
    return find(&instances, dispatchable);
}

struct gn_device *gn_device_of(const void *dispatchable)
{
    return find(&devices, dispatchable);
}

bool gn_instance_register(struct gn_instance *instance)
{
    instance->key = *(void **)instance->handle;
    return enter(&instances, key_of(instance->handle), instance);
}

void gn_instance_forget(struct gn_instance *instance)
{
    leave(&instances, (uint64_t)(uintptr_t)instance->key);
}

void gn_devices_each(const struct gn_instance *instance, void (*visit)(struct gn_device *device))
{
    struct gn_device *device;
    pthread_rwlock_rdlock(&registry_lock);
    for (size_t cursor = 0; (device = gn_map_next(&devices, &cursor));)
        if (device->instance == instance)
            visit(device);
    pthread_rwlock_unlock(&registry_lock);
}

bool gn_device_register(struct gn_device *device)
{
    device->key = *(void **)device->handle;
    return enter(&devices, key_of(device->handle), device);
}

void gn_device_forget(struct gn_device *device)
{
    leave(&devices, (uint64_t)(uintptr_t)device->key);
}

struct named_entry {
    const char *name;
    PFN_vkVoidFunction entry;
};

/* Known before there is an instance. */
static const struct named_entry global_entries[] = {
    {"vkGetInstanceProcAddr", (PFN_vkVoidFunction)gn_entry_GetInstanceProcAddr},
    {"vkCreateInstance", (PFN_vkVoidFunction)gn_entry_CreateInstance},
};

static const struct named_entry instance_entries[] = {
#define GN_INSTANCE_COMMAND(name) {"vk" #name, (PFN_vkVoidFunction)gn_entry_##name},
#include "layer/commands.def"
};

/* On every device, whatever it can do. */
static const struct named_entry every_device_entries[] = {
    {"vkGetDeviceProcAddr", (PFN_vkVoidFunction)gn_entry_GetDeviceProcAddr},
    {"vkDestroyDevice", (PFN_vkVoidFunction)gn_entry_DestroyDevice},
};

static const struct named_entry tracked_device_entries[] = {
#define GN_DEVICE_COMMAND(name) {"vk" #name, (PFN_vkVoidFunction)gn_entry_##name},
#define GN_DEVICE_ALIAS(alias, name) {"vk" #alias, (PFN_vkVoidFunction)gn_entry_##name},
#include "layer/commands.def"
};

/* The driver need not know VK_EXT_debug_utils for the application to name objects: the layer wants the names. */
static const struct named_entry own_device_entries[] = {
#define GN_DEVICE_OWN(name) {"vk" #name, (PFN_vkVoidFunction)gn_entry_##name},
#include "layer/commands.def"
};

#define COUNT(table) (sizeof table / sizeof table[0])

static PFN_vkVoidFunction look_up(const struct named_entry *table, size_t count, const char *name)
{
    for (size_t i = 0; i < count; i++)
        if (strcmp(table[i].name, name) == 0)
            return table[i].entry;
    return NULL;
}

/* A command that the next layer does not know stays unknown: its extension was not enabled. */
VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL gn_entry_GetDeviceProcAddr(VkDevice handle, const char *name)
{
    struct gn_device *device = gn_device_of(handle);
    if (!device)
        return NULL;
    PFN_vkVoidFunction entry = look_up(every_device_entries, COUNT(every_device_entries), name);
    if (entry)
        return entry;
    PFN_vkVoidFunction next = device->next.GetDeviceProcAddr(handle, name);
    if (device->instance->debug_utils)
        entry = look_up(own_device_entries, COUNT(own_device_entries), name);
    if (!entry && next && device->tracked)
        entry = look_up(tracked_device_entries, COUNT(tracked_device_entries), name);
    return entry ? entry : next;
}

/* Device commands asked for through the instance are the loader's business (it dispatches by device); what the next layer
 * answers is right for them, except for those that the layer has on every device. */
VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL gn_entry_GetInstanceProcAddr(VkInstance handle, const char *name)
{
    PFN_vkVoidFunction entry = look_up(global_entries, COUNT(global_entries), name);
    if (entry)
        return entry;
    struct gn_instance *instance = gn_instance_of(handle);
    if (!instance)
        return NULL;
    entry = look_up(every_device_entries, COUNT(every_device_entries), name);
    if (entry)
        return entry;
    if (instance->debug_utils && (entry = look_up(own_device_entries, COUNT(own_device_entries), name)))
        return entry;
    PFN_vkVoidFunction next = instance->next.GetInstanceProcAddr(handle, name);
    if (next)
        entry = look_up(instance_entries, COUNT(instance_entries), name);
    return entry ? entry : next;
}

__attribute__((visibility("default"))) VKAPI_ATTR VkResult VKAPI_CALL
vkNegotiateLoaderLayerInterfaceVersion(VkNegotiateLayerInterface *negotiation)
{
    if (!negotiation || negotiation->sType != LAYER_NEGOTIATE_INTERFACE_STRUCT ||
        negotiation->loaderLayerInterfaceVersion < 2)
        return VK_ERROR_INITIALIZATION_FAILED;
    negotiation->loaderLayerInterfaceVersion = 2;
    negotiation->pfnGetInstanceProcAddr = gn_entry_GetInstanceProcAddr;
    negotiation->pfnGetDeviceProcAddr = gn_entry_GetDeviceProcAddr;
    negotiation->pfnGetPhysicalDeviceProcAddr = NULL;
    return VK_SUCCESS;
}
