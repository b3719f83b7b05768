/* SPDX-License-Identifier: Apache-2.0 */
/* Digests of a driver's answers, which tell whether another driver, or another run, answered the same; and their files. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "cts/case.h"
#include "cts/results.h"

/* What is decided about a hit; the rest is numbers. */
static uint64_t decision_digest(const struct gn_ref_answer *answer, uint64_t seed)
{
    uint32_t words[7] = {(uint32_t)answer->kind};
    if (answer->kind != GN_REF_ANSWER_NONE) {
        words[1] = answer->instance;
        words[2] = answer->geometry;
        words[3] = answer->primitive;
        words[4] = answer->custom_index;
        words[5] = answer->sbt_offset;
        words[6] = answer->kind == GN_REF_ANSWER_TRIANGLE ? answer->front : 0;
    }
    return XXH64(words, sizeof words, seed);
}

static uint64_t number_digest(const struct gn_ref_answer *answer, uint64_t seed)
{
    float numbers[3] = {0, 0, 0};
    if (answer->kind != GN_REF_ANSWER_NONE)
        numbers[0] = answer->t;
    if (answer->kind == GN_REF_ANSWER_TRIANGLE)
        memcpy(&numbers[1], answer->barycentrics, sizeof answer->barycentrics);
    return XXH64(numbers, sizeof numbers, seed);
}

/* The scene as it is judged. */
static uint64_t scene_digest(const struct gn_ref_scene *scene, uint64_t digest)
{
    for (uint32_t i = 0; i < gn_ref_scene_instance_count(scene); i++) {
        const struct gn_ref_instance *instance = gn_ref_scene_instance(scene, i);
        const uint32_t words[5] = {instance->custom_index, instance->mask, instance->sbt_offset, instance->flags,
                                   instance->blas};
        digest = XXH64(words, sizeof words, digest);
        digest = XXH64(instance->transform, sizeof instance->transform, digest);
    }
    const struct gn_ref_geometry *geometry;
    for (uint32_t b = 0; gn_ref_scene_geometry(scene, b, 0); b++) {
        for (uint32_t g = 0; (geometry = gn_ref_scene_geometry(scene, b, g)) != NULL; g++) {
            const uint64_t words[6] = {b, g, (uint64_t)geometry->type, geometry->flags, geometry->primitive_count,
                                       geometry->transform != NULL};
            digest = XXH64(words, sizeof words, digest);
            if (geometry->transform)
                digest = XXH64(geometry->transform, 12 * sizeof *geometry->transform, digest);
            if (geometry->type == GN_REF_AABBS) {
                digest = XXH64(geometry->aabbs, geometry->primitive_count * sizeof *geometry->aabbs, digest);
                continue;
            }
            digest = XXH64(&geometry->divisor, sizeof geometry->divisor, digest);
            digest = XXH64(geometry->positions, geometry->position_count * sizeof *geometry->positions, digest);
            digest = XXH64(geometry->triangles, geometry->primitive_count * sizeof *geometry->triangles, digest);
        }
    }
    return digest;
}

/* All that is judged of one answer: its decisions, and its numbers seeded by them. */
static void answer_digests(const struct gn_cts_answers *answers, uint32_t i, uint64_t *out_decisions, uint64_t *out_numbers)
{
    const struct gn_ref_answer *answer = &answers->committed[i];
    uint64_t decision = decision_digest(answer, 0), number = number_digest(answer, 0);
    if (answers->candidates) {
        const struct gn_cts_candidates *candidates = &answers->candidates[i];
        uint32_t count = candidates->count < GN_CTS_MAX_CANDIDATES ? candidates->count : GN_CTS_MAX_CANDIDATES;
        uint64_t decisions = candidates->count, numbers = 0;
        /* In whatever order they came: sums. */
        for (uint32_t c = 0; c < count; c++) {
            decisions += decision_digest(&candidates->list[c], 1);
            numbers += number_digest(&candidates->list[c], decision_digest(&candidates->list[c], 1));
        }
        decision = XXH64(&decisions, sizeof decisions, decision);
        number = XXH64(&numbers, sizeof numbers, number);
    }
    if (answers->details && answer->kind != GN_REF_ANSWER_NONE) {
        number = XXH64(&answers->details[i], sizeof answers->details[i], number);
    } else if (answers->details) {
        /* On a miss only the ray's own values mean something. */
        struct gn_cts_detail own = {.tmin = answers->details[i].tmin, .flags = answers->details[i].flags};
        memcpy(own.world_origin, answers->details[i].world_origin, sizeof own.world_origin);
        memcpy(own.world_direction, answers->details[i].world_direction, sizeof own.world_direction);
        number = XXH64(&own, sizeof own, number);
    }
    if (answer->kind == GN_REF_ANSWER_TRIANGLE && answers->positions)
        number = XXH64(answers->positions[i], sizeof answers->positions[i], number);
    *out_decisions = decision;
    *out_numbers = number;
}

static void *grow(void *array, size_t size)
{
    void *grown = realloc(array, size);
    if (!grown) {
        fprintf(stderr, "gnomon: out of memory for the digests of answers\n");
        exit(3);
    }
    return grown;
}

void gn_case_digest(struct gn_case_run *run, const struct gn_ref_scene *reference, enum gn_cts_program program,
                    const struct gn_cts_ray *rays, const struct gn_cts_answers *answers, uint32_t ray_count)
{
    struct gn_case_result *result = &run->result;
    struct gn_case_kept *kept = &result->kept;
    const uint64_t scene = scene_digest(reference, (uint64_t)program);
    kept->digests = grow(kept->digests, (kept->count + ray_count) * sizeof *kept->digests);
    kept->verdicts = grow(kept->verdicts, (kept->count + ray_count) * sizeof *kept->verdicts);
    for (uint32_t i = 0; i < ray_count; i++) {
        uint64_t decision, number;
        answer_digests(answers, i, &decision, &number);
        const uint64_t answer[3] = {result->answers, decision, number};
        result->answers = XXH64(answer, sizeof answer, 0);
        const uint64_t decided = XXH64(&rays[i], sizeof rays[i], scene ^ decision);
        kept->digests[kept->count] = (decided & ~(UINT64_MAX >> 16)) | XXH64(&number, sizeof number, decided) >> 16;
        kept->verdicts[kept->count++] = GN_CASE_KEPT_OTHER;
    }
}

float gn_case_known_verdict(const struct gn_case_run *run, size_t ray)
{
    return ray < run->known.count && run->known.digests[ray] == run->result.kept.digests[ray] ? run->known.verdicts[ray]
                                                                                               : GN_CASE_KEPT_OTHER;
}

#define KEPT "%s/%s.kept"
#define CHANGED "%s/%s.changed"

void gn_case_known_read(struct gn_case_run *run, const char *name)
{
    const char *folder = getenv("GNOMON_ANSWERS_KNOWN");
    char path[4096], error[512], *data = NULL;
    size_t length = 0, each = sizeof *run->known.digests + sizeof *run->known.verdicts;
    if (!folder || !*folder)
        return;
    snprintf(path, sizeof path, KEPT, folder, name);
    if (!gn_file_read(path, (size_t)1 << 32, &data, &length, error, sizeof error))
        return;
    run->known.count = length / each;
    run->known.digests = grow(NULL, run->known.count * sizeof *run->known.digests + 1);
    run->known.verdicts = grow(NULL, run->known.count * sizeof *run->known.verdicts + 1);
    memcpy(run->known.digests, data, run->known.count * sizeof *run->known.digests);
    memcpy(run->known.verdicts, data + run->known.count * sizeof *run->known.digests,
           run->known.count * sizeof *run->known.verdicts);
    free(data);
    remove(path);
}

static void changed_write(const struct gn_case_run *run, const char *path)
{
    const struct gn_case_kept *now = &run->result.kept, *before = &run->known;
    uint64_t decisions = 0, numbers = 0;
    char text[64], error[512];
    if (!before->count || before->count != now->count)
        return;
    for (size_t i = 0; i < now->count; i++) {
        if (now->digests[i] >> 48 != before->digests[i] >> 48)
            decisions++;
        else if (now->digests[i] != before->digests[i])
            numbers++;
    }
    int length = snprintf(text, sizeof text, "%" PRIu64 " %" PRIu64, decisions, numbers);
    (void)gn_file_write(path, text, (size_t)length, error, sizeof error);
}

void gn_case_kept_write(const struct gn_case_run *run, const char *name)
{
    const char *kept_folder = getenv("GNOMON_ANSWERS_KEPT"), *known_folder = getenv("GNOMON_ANSWERS_KNOWN");
    const struct gn_case_kept *kept = &run->result.kept;
    char path[4096], error[512];
    if (known_folder && *known_folder) {
        snprintf(path, sizeof path, CHANGED, known_folder, name);
        changed_write(run, path);
        return;
    }
    if (!kept_folder || !*kept_folder || !kept->count)
        return;
    size_t digests = kept->count * sizeof *kept->digests, verdicts = kept->count * sizeof *kept->verdicts;
    char *data = grow(NULL, digests + verdicts);
    memcpy(data, kept->digests, digests);
    memcpy(data + digests, kept->verdicts, verdicts);
    snprintf(path, sizeof path, KEPT, kept_folder, name);
    (void)gn_file_write(path, data, digests + verdicts, error, sizeof error);
    free(data);
}

bool gn_case_changed_read(const char *folder, const char *name, uint64_t *out_decisions, uint64_t *out_numbers)
{
    char path[4096], error[512], *data = NULL;
    size_t length = 0;
    snprintf(path, sizeof path, CHANGED, folder, name);
    if (!gn_file_read(path, 64, &data, &length, error, sizeof error))
        return false;
    bool ok = sscanf(data, "%" SCNu64 " %" SCNu64, out_decisions, out_numbers) == 2;
    free(data);
    return ok;
}

void gn_case_kept_finish(struct gn_case_kept *kept)
{
    free(kept->digests);
    free(kept->verdicts);
    *kept = (struct gn_case_kept){0};
}
