/* SPDX-License-Identifier: Apache-2.0 */
/* Submission: recordings are replayed in the order of submission, TLAS builds wait for the completion of what they are
 * part of, and are then judged. Completion is seen through the application's fence, or one of the layer's where it gave
 * none; nothing is submitted in addition. */
#include "layer/replay.h"
#include "layer/shader.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* A lost device answers waits at once; a device that hangs at its end is not waited for any longer. */
#define LAST_WAIT_NANOSECONDS UINT64_C(1000000000)

struct gn_queue *gn_queue_get(struct gn_device *device, VkQueue handle)
{
    struct gn_queue *queue = gn_map_get(&device->queues, (uint64_t)(uintptr_t)handle);
    if (queue || !(queue = calloc(1, sizeof *queue)))
        return queue;
    queue->handle = handle;
    queue->id = GN_QUEUE_HOST + 1 + device->queue_count;
    queue->newest = &queue->oldest;
    queue->last_held = &queue->held;
    if (!gn_map_put(&device->queues, (uint64_t)(uintptr_t)handle, queue)) {
        free(queue);
        return NULL;
    }
    device->queue_count++;
    queue->next = device->first_queue;
    device->first_queue = queue;
    return queue;
}

static VkFence take_fence(struct gn_device *device)
{
    VkFence fence = VK_NULL_HANDLE;
    for (uint32_t i = 0; i < device->fence_count; i++)
        if (device->next.GetFenceStatus(device->handle, device->fences[i]) == VK_SUCCESS) {
            fence = device->fences[i];
            device->fences[i] = device->fences[--device->fence_count];
            if (device->next.ResetFences(device->handle, 1, &fence) == VK_SUCCESS)
                return fence;
            device->next.DestroyFence(device->handle, fence, NULL);
            break;
        }
    VkFenceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    return device->next.CreateFence(device->handle, &info, NULL, &fence) == VK_SUCCESS ? fence : VK_NULL_HANDLE;
}

/* The fence may still be about to signal: it is used again only once it has. */
static void give_fence(struct gn_device *device, VkFence fence)
{
    if (device->fence_count == device->fence_capacity) {
        uint32_t capacity = device->fence_capacity ? device->fence_capacity * 2 : 8;
        VkFence *grown = realloc(device->fences, capacity * sizeof *grown);
        if (!grown)
            return; /* it lives as long as the device */
        device->fences = grown;
        device->fence_capacity = capacity;
    }
    device->fences[device->fence_count++] = fence;
}

static void judgement_free(struct gn_device *device, struct gn_judgement *judgement)
{
    if (judgement->capture)
        atomic_fetch_sub(&device->instance->open_judgements, 1);
    if (judgement->capture && judgement->capture->pending == judgement)
        judgement->capture->pending = NULL;
    gn_recording_release(device, judgement->recording);
    if (judgement->tlas)
        judgement->tlas->judging--;
    gn_as_release(judgement->tlas);
    gn_as_release(judgement->source);
    free(judgement);
}

static void suspicion_settle(struct gn_device *device, struct gn_suspicion *suspicion, bool completed,
                             struct gn_findings *findings)
{
    bool sure = completed && !atomic_load_explicit(&device->incomplete, memory_order_relaxed);
    for (int i = 0; i < 2; i++) {
        struct gn_as *as = suspicion->structures[i];
        sure &= !as || gn_as_sure(as, suspicion->queue, suspicion->position, &suspicion->seen);
        gn_as_release(as);
    }
    if (sure) {
        gn_report_confirm(device->instance, suspicion->finding, findings);
    } else {
        gn_tally_unjudged(device, GN_UNJUDGED_unproven, 1);
        free(suspicion->finding);
    }
    free(suspicion);
}

/* `readable`: the copies of this submission are complete. */
static void settle(struct gn_device *device, struct gn_submission *submission, bool readable, struct gn_findings *findings)
{
    struct gn_pending_use *use = submission->uses;
    for (struct gn_judgement *judgement = submission->judgements, *next; judgement; judgement = next) {
        next = judgement->next;
        for (struct gn_pending_use *after; use && use->position < judgement->position; use = after) {
            after = use->next;
            gn_pending_use_settle(device, use, readable, findings);
        }
        if (judgement->capture && readable)
            gn_judge_capture(device, judgement, findings);
        else if (judgement->capture)
            gn_tally_unjudged(device, GN_UNJUDGED_not_completed, 1);
        judgement_free(device, judgement);
    }
    for (struct gn_pending_use *after; use; use = after) {
        after = use->next;
        gn_pending_use_settle(device, use, readable, findings);
    }
    for (struct gn_suspicion *suspicion = submission->suspicions, *next; suspicion; suspicion = next) {
        next = suspicion->next;
        suspicion_settle(device, suspicion, readable, findings);
    }
    if (submission->owned && submission->fence)
        give_fence(device, submission->fence);
    free(submission);
    atomic_fetch_sub(&device->pending, 1);
}

void gn_replay_confirm(struct gn_replay *replay)
{
    struct gn_submission *submission = replay->submission;
    for (struct gn_suspicion *suspicion = submission ? submission->suspicions : NULL, *next; suspicion; suspicion = next) {
        next = suspicion->next;
        suspicion_settle(replay->device, suspicion, true, replay->findings);
    }
    free(submission);
    replay->submission = NULL;
}

/* A semaphore with what is waited for or signalled. */
struct meeting {
    VkSemaphore semaphore;
    uint64_t value;
    VkPipelineStageFlags2 stages;
};

/* One VkSubmitInfo, in its turn to be replayed: what it waits for may be signalled by something submitted later. */
struct gn_batch {
    struct gn_batch *next;
    struct gn_queue *queue;
    struct gn_submission *submission; /* once the batch is held back */
    uint64_t number, first_position;
    struct gn_clock host;
    VkFence fence; /* of the submission's last batch */
    uint32_t wait_count, signal_count, command_count;
    struct meeting *waits, *signals;
    struct batch_commands {
        VkCommandBuffer handle;
        struct gn_recording *recording;
    } *commands;
};

static struct gn_batch *batch_create(struct gn_device *device, uint32_t waits, uint32_t signals, uint32_t commands)
{
    size_t size = sizeof(struct gn_batch) + ((size_t)waits + signals) * sizeof(struct meeting) +
                  commands * sizeof(struct batch_commands);
    struct gn_batch *batch = malloc(size);
    if (!batch) {
        gn_tally_lost(device);
        return NULL;
    }
    *batch = (struct gn_batch){.waits = (struct meeting *)(batch + 1)};
    batch->signals = batch->waits + waits;
    batch->commands = (struct batch_commands *)(batch->signals + signals);
    return batch;
}

static void batch_add_commands(struct gn_device *device, struct gn_batch *batch, VkCommandBuffer handle)
{
    struct gn_command_buffer *commands = gn_command_buffer_get(device, handle);
    if (commands && commands->recording)
        batch->commands[batch->command_count++] =
            (struct batch_commands){handle, gn_recording_keep(commands->recording)};
}

static void batch_free(struct gn_device *device, struct gn_batch *batch)
{
    for (uint32_t i = 0; i < batch->command_count; i++)
        gn_recording_release(device, batch->commands[i].recording);
    free(batch);
}

static bool batch_ready(const struct gn_device *device, const struct gn_batch *batch)
{
    for (uint32_t i = 0; i < batch->wait_count; i++)
        if (!gn_semaphore_ready(device, batch->waits[i].semaphore, batch->waits[i].value))
            return false;
    return true;
}

/* Waits, commands, signals. The batch is given up. */
static void batch_run(struct gn_replay *replay, struct gn_batch *batch)
{
    struct gn_device *device = replay->device;
    struct gn_queue *queue = replay->queue;
    gn_clock_join(&queue->clock, &batch->host);
    for (uint32_t i = 0; i < batch->wait_count; i++) {
        struct gn_clock seen = gn_semaphore_wait(device, batch->waits[i].semaphore, batch->waits[i].value);
        gn_clock_join(&queue->clock, &seen);
        gn_sync_wait(device, queue->id, ++device->position, &seen, batch->waits[i].stages);
    }
    replay->host = batch->host;
    for (uint32_t i = 0; i < batch->command_count; i++) {
        replay->command_buffer = batch->commands[i].handle;
        gn_replay_recording(replay, batch->commands[i].recording, 0);
    }
    if (queue->id < GN_MAX_CLOCKS)
        queue->clock.at[queue->id] = device->position;
    for (uint32_t i = 0; i < batch->signal_count; i++)
        gn_semaphore_signal(device, batch->signals[i].semaphore, batch->signals[i].value, &queue->clock);
    if (batch->fence)
        gn_fence_submitted(device, batch->fence, &queue->clock);
    batch_free(device, batch);
}

/* Runs what has been held back, as far as it can go by now; with `all`, whatever it waits for, up to the submission given. */
static void resume(struct gn_device *device, struct gn_queue *queue, const struct gn_submission *all,
                   struct gn_findings *findings)
{
    while (queue->held && (all || batch_ready(device, queue->held))) {
        struct gn_batch *batch = queue->held;
        struct gn_submission *submission = batch->submission;
        if (!(queue->held = batch->next))
            queue->last_held = &queue->held;
        struct gn_replay replay = {.device = device,
                                   .queue = queue,
                                   .submission = submission,
                                   .number = batch->number,
                                   .first_position = batch->first_position,
                                   .findings = findings};
        batch_run(&replay, batch);
        if (--submission->held == 0 && submission == all)
            all = NULL;
    }
}

/* Until nothing moves any more: what one queue signals may be what another waits for. */
static void resume_all(struct gn_device *device, struct gn_findings *findings)
{
    bool any;
    do {
        any = false;
        for (struct gn_queue *queue = device->first_queue; queue; queue = queue->next) {
            struct gn_batch *before = queue->held;
            resume(device, queue, NULL, findings);
            any |= queue->held != before;
        }
    } while (any);
}

void gn_queues_resume(struct gn_device *device)
{
    struct gn_findings findings;
    gn_findings_init(&findings);
    gn_lock(device);
    resume_all(device, &findings);
    gn_unlock(device);
    gn_report_flush(device->instance, &findings);
}

static void replay_begin(struct gn_replay *replay, struct gn_device *device, VkQueue handle, struct gn_findings *findings)
{
    *replay = (struct gn_replay){.device = device,
                                 .queue = gn_queue_get(device, handle),
                                 .number = ++device->submission_count,
                                 .first_position = device->position + 1,
                                 .host = device->host,
                                 .findings = findings};
}

static void replay_batch(struct gn_replay *replay, struct gn_batch *batch)
{
    struct gn_device *device = replay->device;
    struct gn_queue *queue = replay->queue;
    batch->queue = queue;
    batch->number = replay->number;
    batch->first_position = replay->first_position;
    batch->host = device->host;
    if (!queue->held && batch_ready(device, batch)) {
        batch_run(replay, batch);
        return;
    }
    struct gn_submission *submission = gn_replay_submission(replay);
    if (!submission) {
        gn_tally_lost(device);
        batch_free(device, batch);
        return;
    }
    batch->submission = submission;
    submission->held++;
    *queue->last_held = batch;
    queue->last_held = &batch->next;
}

/* A submission that the next layer refuses will not run. */
static void drop_held(struct gn_device *device, struct gn_queue *queue, const struct gn_submission *submission)
{
    for (struct gn_batch **link = &queue->held; *link;) {
        struct gn_batch *batch = *link;
        if (batch->submission != submission) {
            link = &batch->next;
            continue;
        }
        *link = batch->next;
        batch_free(device, batch);
    }
    queue->last_held = &queue->held;
    while (*queue->last_held)
        queue->last_held = &(*queue->last_held)->next;
}

/* The submission is listed before the next layer sees it: from then on another thread may find its fence signalled. Returns the
 * fence to submit with. */
static VkFence replay_end(struct gn_replay *replay, VkFence fence)
{
    struct gn_device *device = replay->device;
    struct gn_submission *submission = replay->submission;
    if (replay->touched)
        gn_tally_check(device, GN_CHECKED_submissions, 1);
    if (!submission)
        return fence;
    submission->owned = fence == VK_NULL_HANDLE;
    submission->fence = submission->owned ? take_fence(device) : fence;
    *replay->queue->newest = submission;
    replay->queue->newest = &submission->next;
    atomic_fetch_add(&device->pending, 1);
    return submission->fence;
}

/* What rests on the commands alone is told as soon as they are submitted: if the device hangs or is lost, it may be why. */
static void tell_at_once(struct gn_device *device, struct gn_submission *submission, struct gn_findings *findings)
{
    if (atomic_load_explicit(&device->incomplete, memory_order_relaxed))
        return;
    submission->last_suspicion = &submission->suspicions;
    for (struct gn_suspicion *suspicion = submission->suspicions, *next; suspicion; suspicion = next) {
        next = suspicion->next;
        if (suspicion->structures[0] || suspicion->structures[1]) {
            *submission->last_suspicion = suspicion;
            submission->last_suspicion = &suspicion->next;
            continue;
        }
        gn_report_confirm(device->instance, suspicion->finding, findings);
        free(suspicion);
    }
    *submission->last_suspicion = NULL;
}

static void replay_settle(struct gn_replay *replay, VkResult result)
{
    struct gn_submission *submission = replay->submission;
    if (!submission)
        return;
    gn_lock(replay->device);
    submission->accepted = true;
    if (result == VK_SUCCESS)
        tell_at_once(replay->device, submission, replay->findings);
    if (result != VK_SUCCESS) {
        struct gn_submission **link = &replay->queue->oldest;
        while (*link != submission)
            link = &(*link)->next;
        *link = submission->next;
        if (replay->queue->newest == &submission->next)
            replay->queue->newest = link;
        if (submission->owned && submission->fence)
            replay->device->next.DestroyFence(replay->device->handle, submission->fence, NULL);
        submission->fence = VK_NULL_HANDLE;
        drop_held(replay->device, replay->queue, submission);
        settle(replay->device, submission, false, replay->findings);
    }
    gn_unlock(replay->device);
}

static struct gn_batch *batch_of(struct gn_device *device, const VkSubmitInfo *info)
{
    const VkTimelineSemaphoreSubmitInfo *values =
        gn_chain_find(info->pNext, VK_STRUCTURE_TYPE_TIMELINE_SEMAPHORE_SUBMIT_INFO);
    struct gn_batch *batch =
        batch_create(device, info->waitSemaphoreCount, info->signalSemaphoreCount, info->commandBufferCount);
    for (uint32_t i = 0; batch && i < info->waitSemaphoreCount; i++)
        batch->waits[batch->wait_count++] =
            (struct meeting){info->pWaitSemaphores[i],
                             values && i < values->waitSemaphoreValueCount ? values->pWaitSemaphoreValues[i] : 0,
                             info->pWaitDstStageMask[i]};
    for (uint32_t i = 0; batch && i < info->signalSemaphoreCount; i++)
        batch->signals[batch->signal_count++] =
            (struct meeting){info->pSignalSemaphores[i],
                             values && i < values->signalSemaphoreValueCount ? values->pSignalSemaphoreValues[i] : 0, 0};
    for (uint32_t i = 0; batch && i < info->commandBufferCount; i++)
        batch_add_commands(device, batch, info->pCommandBuffers[i]);
    return batch;
}

static struct gn_batch *batch_of_2(struct gn_device *device, const VkSubmitInfo2 *info)
{
    struct gn_batch *batch =
        batch_create(device, info->waitSemaphoreInfoCount, info->signalSemaphoreInfoCount, info->commandBufferInfoCount);
    for (uint32_t i = 0; batch && i < info->waitSemaphoreInfoCount; i++)
        batch->waits[batch->wait_count++] =
            (struct meeting){info->pWaitSemaphoreInfos[i].semaphore, info->pWaitSemaphoreInfos[i].value,
                             info->pWaitSemaphoreInfos[i].stageMask};
    for (uint32_t i = 0; batch && i < info->signalSemaphoreInfoCount; i++)
        batch->signals[batch->signal_count++] =
            (struct meeting){info->pSignalSemaphoreInfos[i].semaphore, info->pSignalSemaphoreInfos[i].value, 0};
    for (uint32_t i = 0; batch && i < info->commandBufferInfoCount; i++)
        batch_add_commands(device, batch, info->pCommandBufferInfos[i].commandBuffer);
    return batch;
}

/* vkQueueBindSparse waits and signals like a submission without commands. */
static struct gn_batch *batch_of_sparse(struct gn_device *device, const VkBindSparseInfo *info)
{
    const VkTimelineSemaphoreSubmitInfo *values =
        gn_chain_find(info->pNext, VK_STRUCTURE_TYPE_TIMELINE_SEMAPHORE_SUBMIT_INFO);
    struct gn_batch *batch = batch_create(device, info->waitSemaphoreCount, info->signalSemaphoreCount, 0);
    for (uint32_t i = 0; batch && i < info->waitSemaphoreCount; i++)
        batch->waits[batch->wait_count++] =
            (struct meeting){info->pWaitSemaphores[i],
                             values && i < values->waitSemaphoreValueCount ? values->pWaitSemaphoreValues[i] : 0,
                             VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT};
    for (uint32_t i = 0; batch && i < info->signalSemaphoreCount; i++)
        batch->signals[batch->signal_count++] =
            (struct meeting){info->pSignalSemaphores[i],
                             values && i < values->signalSemaphoreValueCount ? values->pSignalSemaphoreValues[i] : 0, 0};
    return batch;
}

/* What shaders left on a device that is lost is not certain any more, and nothing comes after it. */
static void hear(struct gn_device *device, VkResult result)
{
    if (result == VK_ERROR_DEVICE_LOST)
        gn_shaders_read(device, true, false);
}

/* A submission of any kind: `info` is one of the three, the others are NULL. */
struct submission_info {
    const VkSubmitInfo *first;
    const VkSubmitInfo2 *second;
    const VkBindSparseInfo *sparse;
};

static VkResult submit(VkQueue handle, uint32_t count, struct submission_info info, VkFence fence)
{
    struct gn_device *device = gn_device_of(handle);
    struct gn_findings findings;
    struct gn_replay replay;
    VkFence app_fence = fence;
    gn_findings_init(&findings);
    gn_device_collect(device);
    gn_lock(device);
    replay_begin(&replay, device, handle, &findings);
    for (uint32_t i = 0; replay.queue && i < count; i++) {
        struct gn_batch *batch = info.first    ? batch_of(device, &info.first[i])
                                 : info.second ? batch_of_2(device, &info.second[i])
                                               : batch_of_sparse(device, &info.sparse[i]);
        if (!batch)
            continue;
        if (i == count - 1)
            batch->fence = app_fence;
        replay_batch(&replay, batch);
    }
    if (!count && app_fence && replay.queue) {
        struct gn_batch *batch = batch_create(device, 0, 0, 0);
        if (batch) {
            batch->fence = app_fence;
            replay_batch(&replay, batch);
        }
    }
    /* Sparse binding has a fence of its own only if the application gives one. */
    if (!info.sparse || app_fence || replay.submission)
        fence = replay_end(&replay, fence);
    resume_all(device, &findings);
    gn_unlock(device);
    VkResult result = info.first    ? device->next.QueueSubmit(handle, count, info.first, fence)
                      : info.second ? device->next.QueueSubmit2(handle, count, info.second, fence)
                                    : device->next.QueueBindSparse(handle, count, info.sparse, fence);
    replay_settle(&replay, result);
    hear(device, result);
    gn_report_flush(device->instance, &findings);
    return result;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_QueueSubmit(VkQueue queue, uint32_t count, const VkSubmitInfo *submits, VkFence fence)
{
    static const VkSubmitInfo none;
    return submit(queue, count, (struct submission_info){.first = submits ? submits : &none}, fence);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_QueueSubmit2(VkQueue queue, uint32_t count, const VkSubmitInfo2 *submits, VkFence fence)
{
    static const VkSubmitInfo2 none;
    return submit(queue, count, (struct submission_info){.second = submits ? submits : &none}, fence);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_QueueBindSparse(VkQueue queue, uint32_t count, const VkBindSparseInfo *infos, VkFence fence)
{
    static const VkBindSparseInfo none;
    return submit(queue, count, (struct submission_info){.sparse = infos ? infos : &none}, fence);
}

/* A fence signals after everything submitted to its queue before it: one signalled fence completes all older submissions.
 * Returns whether anything came to its end. */
static bool advance(struct gn_device *device, struct gn_queue *queue, struct gn_findings *findings)
{
    struct gn_submission *last_done = NULL;
    bool lost = false;
    for (struct gn_submission *submission = queue->oldest; submission && submission->accepted;
         submission = submission->next) {
        if (!submission->done && submission->fence) {
            VkResult status = device->next.GetFenceStatus(device->handle, submission->fence);
            submission->done = status == VK_SUCCESS;
            lost |= status == VK_ERROR_DEVICE_LOST;
        }
        if (submission->done)
            last_done = submission;
    }
    /* It has run, so that what it waited for has come about in a way that was not seen. */
    for (struct gn_submission *submission = queue->oldest; submission && last_done; submission = submission->next) {
        if (submission->held) {
            device->order_unknown = true;
            gn_tally_unjudged(device, GN_UNJUDGED_unknown_semaphores, 1);
            resume(device, queue, submission, findings);
        }
        if (submission == last_done)
            break;
    }
    bool any = last_done != NULL || lost;
    while (last_done || (lost && queue->oldest && queue->oldest->accepted)) {
        struct gn_submission *submission = queue->oldest;
        queue->oldest = submission->next;
        if (!queue->oldest)
            queue->newest = &queue->oldest;
        bool readable = last_done != NULL;
        if (submission == last_done)
            last_done = NULL;
        settle(device, submission, readable, findings);
    }
    return any;
}

void gn_device_collect(struct gn_device *device)
{
    struct gn_findings findings;
    gn_shaders_read(device, false, false);
    if (!atomic_load_explicit(&device->pending, memory_order_acquire))
        return;
    gn_findings_init(&findings);
    bool any = false;
    gn_lock(device);
    for (struct gn_queue *queue = device->first_queue; queue; queue = queue->next)
        any |= advance(device, queue, &findings);
    if (any)
        gn_as_purge(device);
    gn_unlock(device);
    gn_report_flush(device->instance, &findings);
}

static void mark_done(struct gn_queue *queue)
{
    for (struct gn_submission *submission = queue->oldest; submission; submission = submission->next)
        submission->done = true;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_QueueWaitIdle(VkQueue handle)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.QueueWaitIdle(handle);
    hear(device, result);
    if (result == VK_SUCCESS) {
        gn_lock(device);
        struct gn_queue *queue = gn_map_get(&device->queues, (uint64_t)(uintptr_t)handle);
        if (queue) {
            mark_done(queue);
            gn_clock_join(&device->host, &queue->clock);
        }
        gn_unlock(device);
    }
    gn_device_collect(device);
    return result;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_DeviceWaitIdle(VkDevice handle)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.DeviceWaitIdle(handle);
    hear(device, result);
    if (result == VK_SUCCESS) {
        gn_lock(device);
        for (struct gn_queue *queue = device->first_queue; queue; queue = queue->next)
            mark_done(queue);
        device->host = gn_clock_all(device);
        gn_unlock(device);
    }
    gn_device_collect(device);
    return result;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_WaitForFences(VkDevice handle, uint32_t count, const VkFence *fences,
                                                      VkBool32 all, uint64_t timeout)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.WaitForFences(handle, count, fences, all, timeout);
    hear(device, result);
    if (result == VK_SUCCESS) {
        gn_lock(device);
        for (uint32_t i = 0; i < count; i++)
            gn_fence_seen(device, fences[i]);
        gn_unlock(device);
    }
    gn_device_collect(device);
    return result;
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_GetFenceStatus(VkDevice handle, VkFence fence)
{
    struct gn_device *device = gn_device_of(handle);
    VkResult result = device->next.GetFenceStatus(handle, fence);
    hear(device, result);
    if (result == VK_SUCCESS) {
        gn_lock(device);
        gn_fence_seen(device, fence);
        gn_unlock(device);
    }
    gn_device_collect(device);
    return result;
}

/* A fence that the application resets or destroys is not in use: its submission has completed, and the layer does not touch the
 * fence any more. */
static void fences_leave(struct gn_device *device, uint32_t count, const VkFence *fences)
{
    if (!atomic_load(&device->pending))
        return;
    gn_device_collect(device);
    gn_lock(device);
    for (struct gn_queue *queue = device->first_queue; queue; queue = queue->next)
        for (struct gn_submission *submission = queue->oldest; submission; submission = submission->next)
            for (uint32_t i = 0; i < count; i++)
                if (!submission->owned && submission->fence == fences[i]) {
                    submission->fence = VK_NULL_HANDLE;
                    submission->done = true;
                }
    gn_unlock(device);
    gn_device_collect(device);
}

VKAPI_ATTR VkResult VKAPI_CALL gn_entry_ResetFences(VkDevice handle, uint32_t count, const VkFence *fences)
{
    struct gn_device *device = gn_device_of(handle);
    fences_leave(device, count, fences);
    return device->next.ResetFences(handle, count, fences);
}

VKAPI_ATTR void VKAPI_CALL gn_entry_DestroyFence(VkDevice handle, VkFence fence, const VkAllocationCallbacks *allocator)
{
    struct gn_device *device = gn_device_of(handle);
    if (fence) {
        fences_leave(device, 1, &fence);
        gn_lock(device);
        free(gn_map_take(&device->fence_clocks, (uint64_t)fence));
        gn_unlock(device);
    }
    device->next.DestroyFence(handle, fence, allocator);
}

void gn_queues_finish(struct gn_device *device)
{
    struct gn_findings findings;
    gn_findings_init(&findings);
    gn_lock(device);
    for (struct gn_queue *queue = device->first_queue, *next; queue; queue = next) {
        next = queue->next;
        struct gn_submission *newest = NULL;
        for (struct gn_submission *submission = queue->oldest; submission; submission = submission->next)
            newest = submission;
        if (newest && newest->fence)
            device->next.WaitForFences(device->handle, 1, &newest->fence, VK_TRUE, LAST_WAIT_NANOSECONDS);
        advance(device, queue, &findings);
        while (queue->held) {
            struct gn_batch *batch = queue->held;
            queue->held = batch->next;
            batch_free(device, batch);
        }
        while (queue->oldest) {
            struct gn_submission *submission = queue->oldest;
            queue->oldest = submission->next;
            settle(device, submission, false, &findings);
        }
        free(queue->name);
        free(queue);
    }
    device->first_queue = NULL;
    gn_map_finish(&device->queues);
    for (uint32_t i = 0; i < device->fence_count; i++)
        device->next.DestroyFence(device->handle, device->fences[i], NULL);
    free(device->fences);
    device->fences = NULL;
    device->fence_count = device->fence_capacity = 0;
    gn_unlock(device);
    gn_report_flush(device->instance, &findings);
}
