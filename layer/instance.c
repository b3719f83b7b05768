/* SPDX-License-Identifier: Apache-2.0 */
/* Instances, their messengers, and what is left to say when a process ends without destroying them. */
#include "layer/shader.h"
#include "layer/log.h"
#include "layer/sarif.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* For the end of the process only. */
static pthread_mutex_t living_lock = PTHREAD_MUTEX_INITIALIZER;
static struct gn_map living;

static VkLayerInstanceCreateInfo *link_of(const VkInstanceCreateInfo *info)
{
    for (const VkBaseInStructure *in = info->pNext; in; in = in->pNext) {
        VkLayerInstanceCreateInfo *link = (VkLayerInstanceCreateInfo *)(uintptr_t)in;
        if (in->sType == VK_STRUCTURE_TYPE_LOADER_INSTANCE_CREATE_INFO && link->function == VK_LAYER_LINK_INFO)
            return link;
    }
    return NULL;
}

static void instance_free(struct gn_instance *instance)
{
    if (!instance)
        return;
    size_t cursor = 0;
    void *site;
    while ((site = gn_map_next(&instance->sites, &cursor)))
        free(site);
    gn_map_finish(&instance->sites);
    gn_log_close(instance->log);
    gn_sarif_close(instance->sarif);
    gn_settings_finish(&instance->settings);
    for (uint32_t i = 0; i < instance->stated_count; i++)
        free(instance->stated[i]);
    free(instance->stated);
    free(instance->messengers);
    pthread_mutex_destroy(&instance->lock);
    free(instance);
}

static void adopt_messengers(struct gn_instance *instance, const void *chain)
{
    for (const VkBaseInStructure *in = chain; in; in = in->pNext)
        if (in->sType == VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT)
            gn_messenger_add(instance, VK_NULL_HANDLE, (const VkDebugUtilsMessengerCreateInfoEXT *)in);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateInstance(const VkInstanceCreateInfo *info,
                                                       const VkAllocationCallbacks *allocator, VkInstance *out)
{
    VkLayerInstanceCreateInfo *link = link_of(info);
    if (!link || !link->u.pLayerInfo)
        return VK_ERROR_INITIALIZATION_FAILED;
    PFN_vkGetInstanceProcAddr next_lookup = link->u.pLayerInfo->pfnNextGetInstanceProcAddr;
    PFN_vkCreateInstance create = (PFN_vkCreateInstance)next_lookup(VK_NULL_HANDLE, "vkCreateInstance");
    if (!create)
        return VK_ERROR_INITIALIZATION_FAILED;
    struct gn_instance *instance = calloc(1, sizeof *instance);
    if (!instance)
        return VK_ERROR_OUT_OF_HOST_MEMORY;
    pthread_mutex_init(&instance->lock, NULL);

    link->u.pLayerInfo = link->u.pLayerInfo->pNext;
    VkResult result = create(info, allocator, out);
    if (result != VK_SUCCESS)
        goto fail;

    instance->handle = *out;
    instance->process = getpid();
    instance->next.GetInstanceProcAddr = next_lookup;
#define GN_INSTANCE_COMMAND(name) instance->next.name = (PFN_vk##name)next_lookup(*out, "vk" #name);
#define GN_INSTANCE_USED(name) instance->next.name = (PFN_vk##name)next_lookup(*out, "vk" #name);
#include "layer/commands.def"
    if (!gn_instance_register(instance)) {
        instance->next.DestroyInstance(*out, allocator);
        result = VK_ERROR_OUT_OF_HOST_MEMORY;
        goto fail;
    }
    for (uint32_t i = 0; i < info->enabledExtensionCount; i++)
        instance->debug_utils |= strcmp(info->ppEnabledExtensionNames[i], VK_EXT_DEBUG_UTILS_EXTENSION_NAME) == 0;
    adopt_messengers(instance, info->pNext);
    gn_settings_read(info, &instance->settings);
    for (int kind = 0; kind < GN_COMMAND_KIND_COUNT; kind++)
        if (gn_rules_about_command((enum gn_command_kind)kind, &instance->settings.rules, instance->settings.profile))
            instance->judged_commands |= UINT32_C(1) << kind;
    char problem[512];
    if (instance->settings.log_file) {
        instance->log = gn_log_open(instance->settings.log_file, "log_file", problem, sizeof problem);
        if (!instance->log)
            gn_report_say(instance, GN_SEVERITY_WARNING, "settings", problem);
    }
    if (instance->settings.sarif_file) {
        instance->sarif = gn_sarif_open(instance->settings.sarif_file, instance->settings.profile, problem, sizeof problem);
        if (!instance->sarif)
            gn_report_say(instance, GN_SEVERITY_WARNING, "settings", problem);
    }
    if (instance->settings.shader_cache && instance->settings.shader_checks != GN_SHADERS_OFF &&
        !gn_shader_cache_usable(instance->settings.shader_cache, problem, sizeof problem))
        gn_report_say(instance, GN_SEVERITY_WARNING, "settings", problem);
    if (!gn_signals_watch(&instance->settings))
        gn_report_say(instance, GN_SEVERITY_WARNING, "settings",
                      "statement_signal: the application handles that signal itself. The layer leaves it alone.");
    for (uint32_t i = 0; i < instance->settings.warning_count; i++)
        gn_report_say(instance, GN_SEVERITY_WARNING, "settings", instance->settings.warnings[i]);
    gn_left_tell(instance);
    pthread_mutex_lock(&living_lock);
    gn_map_put(&living, (uint64_t)(uintptr_t)instance, instance);
    pthread_mutex_unlock(&living_lock);
    return VK_SUCCESS;

fail:
    instance_free(instance);
    return result;
}

static bool leave_living(struct gn_instance *instance)
{
    pthread_mutex_lock(&living_lock);
    bool was = gn_map_take(&living, (uint64_t)(uintptr_t)instance) != NULL;
    if (!living.count)
        gn_map_finish(&living);
    pthread_mutex_unlock(&living_lock);
    return was;
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyInstance(VkInstance handle, const VkAllocationCallbacks *allocator)
{
    struct gn_instance *instance = handle ? gn_instance_of(handle) : NULL;
    if (!instance)
        return;
    leave_living(instance);
    if (instance->process == getpid())
        gn_report_close(instance, "the instance was destroyed");
    gn_instance_forget(instance);
    instance->next.DestroyInstance(handle, allocator);
    instance_free(instance);
}

/* Nothing of Vulkan may be called any more, and the application's messengers may be gone. */
void gn_instances_close(const char *ending)
{
    pthread_mutex_lock(&living_lock);
    size_t cursor = 0;
    struct gn_instance *instance;
    while ((instance = gn_map_next(&living, &cursor))) {
        if (instance->process != getpid())
            continue;
        pthread_mutex_lock(&instance->lock);
        instance->messenger_count = 0;
        pthread_mutex_unlock(&instance->lock);
        gn_devices_each(instance, gn_shaders_read_left);
        atomic_fetch_add(&instance->tally.unjudged[GN_UNJUDGED_not_completed], atomic_exchange(&instance->open_judgements, 0));
        gn_report_close(instance, ending);
    }
    pthread_mutex_unlock(&living_lock);
}

void gn_instances_state(const char *ending)
{
    pthread_mutex_lock(&living_lock);
    size_t cursor = 0;
    struct gn_instance *instance;
    while ((instance = gn_map_next(&living, &cursor)))
        gn_report_state(instance, ending);
    pthread_mutex_unlock(&living_lock);
}

/* Many applications end without destroying anything. */
__attribute__((destructor)) static void close_the_living(void)
{
    gn_instances_close("the process ended without destroying the instance");
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateDebugUtilsMessengerEXT(VkInstance handle,
                                                                     const VkDebugUtilsMessengerCreateInfoEXT *info,
                                                                     const VkAllocationCallbacks *allocator,
                                                                     VkDebugUtilsMessengerEXT *out)
{
    struct gn_instance *instance = gn_instance_of(handle);
    VkResult result = instance->next.CreateDebugUtilsMessengerEXT(handle, info, allocator, out);
    if (result == VK_SUCCESS)
        gn_messenger_add(instance, *out, info);
    return result;
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyDebugUtilsMessengerEXT(VkInstance handle, VkDebugUtilsMessengerEXT messenger,
                                                                  const VkAllocationCallbacks *allocator)
{
    struct gn_instance *instance = gn_instance_of(handle);
    if (messenger)
        gn_messenger_remove(instance, messenger);
    instance->next.DestroyDebugUtilsMessengerEXT(handle, messenger, allocator);
}
