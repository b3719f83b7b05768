/* SPDX-License-Identifier: Apache-2.0 */
/* What semaphores, fences and waits on the host say about time. A signal carries what had happened in its queue; a wait passes that on.
 * A wait for a value that nothing has signalled yet holds its submission back from the replay (submit.c). */
#include "layer/sync.h"

#include <stdlib.h>
#include <string.h>

#define MOST_SIGNALS 64u

struct gn_semaphore {
    bool timeline, external, signalled;
    struct gn_clock clock; /* of a binary one; of a timeline: of all signals up to `floor` */
    uint64_t floor;
    uint32_t count;
    struct {
        uint64_t value;
        struct gn_clock clock;
    } signals[]; /* in rising order; room for MOST_SIGNALS in a timeline */
};

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_CreateSemaphore(VkDevice handle, const VkSemaphoreCreateInfo *info,
                                                        const VkAllocationCallbacks *allocator, VkSemaphore *out)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.CreateSemaphore(handle, info, allocator, out);
    if (result != VK_SUCCESS)
        return result;
    const VkSemaphoreTypeCreateInfo *type = gn_chain_find(info->pNext, VK_STRUCTURE_TYPE_SEMAPHORE_TYPE_CREATE_INFO);
    const VkExportSemaphoreCreateInfo *external = gn_chain_find(info->pNext, VK_STRUCTURE_TYPE_EXPORT_SEMAPHORE_CREATE_INFO);
    bool timeline = type && type->semaphoreType == VK_SEMAPHORE_TYPE_TIMELINE;
    struct gn_semaphore *semaphore =
        calloc(1, sizeof *semaphore + (timeline ? MOST_SIGNALS : 0) * sizeof semaphore->signals[0]);
    gn_lock(device);
    if (semaphore) {
        semaphore->timeline = timeline;
        semaphore->external = external && external->handleTypes;
        semaphore->floor = timeline ? type->initialValue : 0;
    }
    if (!semaphore || !gn_map_put(&device->semaphores, (uint64_t)*out, semaphore)) {
        free(semaphore);
        gn_tally_lost(device);
    }
    gn_unlock(device);
    return result;
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroySemaphore(VkDevice handle, VkSemaphore semaphore,
                                                     const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    free(gn_map_take(&device->semaphores, (uint64_t)semaphore));
    gn_unlock(device);
    device->next.DestroySemaphore(handle, semaphore, allocator);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_ImportSemaphoreFdKHR(VkDevice handle, const VkImportSemaphoreFdInfoKHR *info)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    struct gn_semaphore *semaphore = gn_map_get(&device->semaphores, (uint64_t)info->semaphore);
    if (semaphore)
        semaphore->external = true;
    gn_unlock(device);
    return device->next.ImportSemaphoreFdKHR(handle, info);
}

bool gn_semaphore_ready(const struct gn_device *device, VkSemaphore handle, uint64_t value)
{
    const struct gn_semaphore *semaphore = gn_map_get(&device->semaphores, (uint64_t)handle);
    if (!semaphore || !semaphore->timeline || semaphore->external || value <= semaphore->floor)
        return true;
    return semaphore->count && semaphore->signals[semaphore->count - 1].value >= value;
}

/* What a wait for the value has seen; false if that is not known. */
static bool seen_by(const struct gn_semaphore *semaphore, uint64_t value, struct gn_clock *out)
{
    if (!semaphore || semaphore->external)
        return false;
    if (!semaphore->timeline) {
        *out = semaphore->clock;
        return semaphore->signalled;
    }
    *out = semaphore->clock;
    if (value <= semaphore->floor)
        return true;
    for (uint32_t i = 0; i < semaphore->count; i++)
        if (semaphore->signals[i].value >= value) {
            *out = semaphore->signals[i].clock;
            return true;
        }
    return false;
}

struct gn_clock gn_semaphore_wait(struct gn_device *device, VkSemaphore handle, uint64_t value)
{
    struct gn_semaphore *semaphore = gn_map_get(&device->semaphores, (uint64_t)handle);
    struct gn_clock clock;
    if (!seen_by(semaphore, value, &clock)) {
        clock = gn_clock_all(device);
        if (!semaphore || semaphore->external || semaphore->timeline) {
            gn_tally_unjudged(device, GN_UNJUDGED_unknown_semaphores, 1);
            device->order_unknown = true;
        }
    }
    if (semaphore && !semaphore->timeline)
        semaphore->signalled = false;
    return clock;
}

void gn_semaphore_signal(struct gn_device *device, VkSemaphore handle, uint64_t value, const struct gn_clock *clock)
{
    struct gn_semaphore *semaphore = gn_map_get(&device->semaphores, (uint64_t)handle);
    if (!semaphore)
        return;
    if (!semaphore->timeline) {
        semaphore->signalled = true;
        semaphore->clock = *clock;
        return;
    }
    if (value <= semaphore->floor)
        return;
    if (semaphore->count == MOST_SIGNALS) {
        uint32_t half = MOST_SIGNALS / 2;
        for (uint32_t i = 0; i < half; i++)
            gn_clock_join(&semaphore->clock, &semaphore->signals[i].clock);
        semaphore->floor = semaphore->signals[half - 1].value;
        semaphore->count -= half;
        memmove(semaphore->signals, semaphore->signals + half, semaphore->count * sizeof semaphore->signals[0]);
    }
    uint32_t at = semaphore->count;
    while (at && semaphore->signals[at - 1].value >= value)
        at--;
    memmove(semaphore->signals + at + 1, semaphore->signals + at, (semaphore->count - at) * sizeof semaphore->signals[0]);
    semaphore->signals[at].value = value;
    semaphore->signals[at].clock = *clock;
    semaphore->count++;
}

/* The host has seen the counter at the value. */
static void host_saw(struct gn_device *device, VkSemaphore handle, uint64_t value)
{
    const struct gn_semaphore *semaphore = gn_map_get(&device->semaphores, (uint64_t)handle);
    if (!semaphore || semaphore->external) {
        device->host = gn_clock_all(device);
        return;
    }
    gn_clock_join(&device->host, &semaphore->clock);
    for (uint32_t i = 0; i < semaphore->count && semaphore->signals[i].value <= value; i++)
        gn_clock_join(&device->host, &semaphore->signals[i].clock);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_WaitSemaphores(VkDevice handle, const VkSemaphoreWaitInfo *info, uint64_t timeout)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.WaitSemaphores(handle, info, timeout);
    if (result == VK_SUCCESS) {
        gn_lock(device);
        for (uint32_t i = 0; i < info->semaphoreCount; i++)
            host_saw(device, info->pSemaphores[i], info->pValues[i]);
        gn_unlock(device);
    }
    gn_device_collect(device);
    return result;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_GetSemaphoreCounterValue(VkDevice handle, VkSemaphore semaphore, uint64_t *value)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.GetSemaphoreCounterValue(handle, semaphore, value);
    if (result == VK_SUCCESS) {
        gn_lock(device);
        host_saw(device, semaphore, *value);
        gn_unlock(device);
    }
    gn_device_collect(device);
    return result;
}

/* Entered before the next layer sees it: what waits for the value may run at once, and be waited for. */
VKAPI_ATTR VkResult VKAPI_CALL gn_entry_SignalSemaphore(VkDevice handle, const VkSemaphoreSignalInfo *info)
{
    struct gn_device *device = gn_device_of(handle);
    gn_lock(device);
    gn_semaphore_signal(device, info->semaphore, info->value, &device->host);
    gn_unlock(device);
    gn_queues_resume(device);
    return device->next.SignalSemaphore(handle, info);
}

/* Presenting waits for semaphores: their next signal may be one that is not seen. */
VKAPI_ATTR VkResult VKAPI_CALL gn_entry_QueuePresentKHR(VkQueue queue, const VkPresentInfoKHR *info)
{
    struct gn_device *device = gn_device_of(queue);
    gn_lock(device);
    for (uint32_t i = 0; i < info->waitSemaphoreCount; i++) {
        struct gn_semaphore *semaphore = gn_map_get(&device->semaphores, (uint64_t)info->pWaitSemaphores[i]);
        if (semaphore)
            semaphore->signalled = false;
    }
    gn_unlock(device);
    return device->next.QueuePresentKHR(queue, info);
}

/* The host has learnt something in a way that is not looked into. */
void gn_host_saw_all(struct gn_device *device)
{
    gn_lock(device);
    device->host = gn_clock_all(device);
    gn_unlock(device);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_GetEventStatus(VkDevice handle, VkEvent event)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.GetEventStatus(handle, event);
    if (result == VK_EVENT_SET)
        gn_host_saw_all(device);
    return result;
}

void gn_fence_submitted(struct gn_device *device, VkFence fence, const struct gn_clock *clock)
{
    struct gn_clock *known = gn_map_get(&device->fence_clocks, (uint64_t)fence);
    if (!known) {
        known = malloc(sizeof *known);
        if (!known || !gn_map_put(&device->fence_clocks, (uint64_t)fence, known)) {
            free(known);
            gn_tally_lost(device);
            return;
        }
    }
    *known = *clock;
}

void gn_fence_seen(struct gn_device *device, VkFence fence)
{
    const struct gn_clock *known = gn_map_get(&device->fence_clocks, (uint64_t)fence);
    if (known)
        gn_clock_join(&device->host, known);
    else
        device->host = gn_clock_all(device);
}

void gn_semaphores_finish(struct gn_device *device)
{
    size_t cursor = 0;
    void *value;
    while ((value = gn_map_next(&device->semaphores, &cursor)))
        free(value);
    for (cursor = 0; (value = gn_map_next(&device->fence_clocks, &cursor));)
        free(value);
    gn_map_finish(&device->semaphores);
    gn_map_finish(&device->fence_clocks);
}
