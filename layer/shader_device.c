/* SPDX-License-Identifier: Apache-2.0 */
/* What instrumented shaders need of a device: addresses of buffers, stores from graphics stages, and, for records that outlive the process,
 * memory of the host. Enabled in a copy of what the application asks for. */
#include "layer/shader.h"

#include <stdlib.h>
#include <string.h>

static bool listed(const char *const *names, uint32_t count, const char *name)
{
    for (uint32_t i = 0; i < count; i++)
        if (strcmp(names[i], name) == 0)
            return true;
    return false;
}

static bool offered(struct gn_instance *instance, VkPhysicalDevice physical, const char *name)
{
    uint32_t count = 0;
    VkExtensionProperties *list = NULL;
    bool found = false;
    if (instance->next.EnumerateDeviceExtensionProperties(physical, NULL, &count, NULL) != VK_SUCCESS ||
        !(list = malloc((count ? count : 1) * sizeof *list)))
        return false;
    VkResult result = instance->next.EnumerateDeviceExtensionProperties(physical, NULL, &count, list);
    for (uint32_t i = 0; (result == VK_SUCCESS || result == VK_INCOMPLETE) && i < count && !found; i++)
        found = strcmp(list[i].extensionName, name) == 0;
    free(list);
    return found;
}

static void wish_for_host_memory(struct gn_device_wish *wish, struct gn_instance *instance, VkPhysicalDevice physical)
{
    const char *name = VK_EXT_EXTERNAL_MEMORY_HOST_EXTENSION_NAME;
    uint32_t count = wish->info.enabledExtensionCount;
    if (listed(wish->info.ppEnabledExtensionNames, count, name)) {
        wish->host_memory = true;
        return;
    }
    if (!offered(instance, physical, name) || !(wish->extensions = malloc((count + 1) * sizeof *wish->extensions)))
        return;
    if (count)
        memcpy(wish->extensions, wish->info.ppEnabledExtensionNames, count * sizeof *wish->extensions);
    wish->extensions[count] = name;
    wish->info.ppEnabledExtensionNames = wish->extensions;
    wish->info.enabledExtensionCount = count + 1;
    wish->host_memory = true;
}

/* The structure of that type, changeable; NULL when it is not in the chain or cannot be reached. */
static void *changeable(struct gn_device_wish *wish, VkStructureType type)
{
    return gn_chain_copy(&wish->info.pNext, type, &wish->chain);
}

static void wish_for_addresses(struct gn_device_wish *wish, bool supported)
{
    const VkPhysicalDeviceVulkan12Features *v12 =
        gn_chain_find(wish->info.pNext, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES);
    const VkPhysicalDeviceBufferDeviceAddressFeatures *own =
        gn_chain_find(wish->info.pNext, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_BUFFER_DEVICE_ADDRESS_FEATURES);
    wish->addresses = (v12 && v12->bufferDeviceAddress) || (own && own->bufferDeviceAddress);
    if (wish->addresses || !supported)
        return;
    if (!v12 && !own) {
        wish->address_features = (VkPhysicalDeviceBufferDeviceAddressFeatures){
            .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_BUFFER_DEVICE_ADDRESS_FEATURES,
            .pNext = (void *)(uintptr_t)wish->info.pNext,
            .bufferDeviceAddress = VK_TRUE};
        wish->info.pNext = &wish->address_features;
        wish->addresses = true;
        return;
    }
    VkPhysicalDeviceVulkan12Features *v12_copy = NULL;
    VkPhysicalDeviceBufferDeviceAddressFeatures *own_copy = NULL;
    if (v12 && (v12_copy = changeable(wish, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES)))
        v12_copy->bufferDeviceAddress = VK_TRUE;
    else if (!v12 && (own_copy = changeable(wish, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_BUFFER_DEVICE_ADDRESS_FEATURES)))
        own_copy->bufferDeviceAddress = VK_TRUE;
    wish->addresses = v12_copy || own_copy;
}

static void wish_for_stores(struct gn_device_wish *wish, const VkPhysicalDeviceFeatures *supported)
{
    const VkPhysicalDeviceFeatures2 *chained =
        gn_chain_find(wish->info.pNext, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2);
    const VkPhysicalDeviceFeatures *now = chained ? &chained->features : wish->info.pEnabledFeatures;
    VkPhysicalDeviceFeatures *to = NULL;
    wish->vertex_stores = now && now->vertexPipelineStoresAndAtomics;
    wish->fragment_stores = now && now->fragmentStoresAndAtomics;
    if ((wish->vertex_stores || !supported->vertexPipelineStoresAndAtomics) &&
        (wish->fragment_stores || !supported->fragmentStoresAndAtomics))
        return;
    if (chained) {
        VkPhysicalDeviceFeatures2 *copy = changeable(wish, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2);
        to = copy ? &copy->features : NULL;
    } else {
        if (now)
            wish->features = *now;
        to = &wish->features;
        wish->info.pEnabledFeatures = to;
    }
    if (!to)
        return;
    to->vertexPipelineStoresAndAtomics |= supported->vertexPipelineStoresAndAtomics;
    to->fragmentStoresAndAtomics |= supported->fragmentStoresAndAtomics;
    wish->vertex_stores = to->vertexPipelineStoresAndAtomics;
    wish->fragment_stores = to->fragmentStoresAndAtomics;
}

void gn_device_wish_init(struct gn_device_wish *wish, struct gn_instance *instance, VkPhysicalDevice physical,
                         const VkDeviceCreateInfo *info)
{
    memset(wish, 0, offsetof(struct gn_device_wish, chain));
    wish->chain.used = 0;
    wish->info = *info;
    VkPhysicalDeviceBufferDeviceAddressFeatures addresses = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_BUFFER_DEVICE_ADDRESS_FEATURES};
    VkPhysicalDeviceFeatures2 supported = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, .pNext = &addresses};
    const VkPhysicalDeviceRobustness2FeaturesEXT *robustness =
        gn_chain_find(info->pNext, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ROBUSTNESS_2_FEATURES_EXT);
    wish->null_descriptors = robustness && robustness->nullDescriptor;
    const VkPhysicalDeviceRayTracingPositionFetchFeaturesKHR *fetch =
        gn_chain_find(info->pNext, VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_POSITION_FETCH_FEATURES_KHR);
    wish->positions = fetch && fetch->rayTracingPositionFetch;
    if (!instance->next.GetPhysicalDeviceFeatures2)
        return;
    instance->next.GetPhysicalDeviceFeatures2(physical, &supported);
    wish_for_addresses(wish, addresses.bufferDeviceAddress);
    wish_for_stores(wish, &supported.features);
    wish_for_host_memory(wish, instance, physical);
}

void gn_device_wish_finish(struct gn_device_wish *wish)
{
    free(wish->extensions);
}
