/* SPDX-License-Identifier: Apache-2.0 */
/* Digests of a driver's answers, which tell whether another driver, or another run, answered the same. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "cts/case.h"

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

void gn_case_digest(struct gn_case_run *run, const struct gn_cts_answers *answers, uint32_t ray_count)
{
    struct gn_case_result *result = &run->result;
    uint32_t *rays = realloc(result->digests, (result->digest_count + ray_count) * sizeof *rays);
    if (!rays) {
        fprintf(stderr, "gnomon: out of memory for %u answers\n", ray_count);
        exit(3);
    }
    result->digests = rays;
    rays += result->digest_count;
    result->digest_count += ray_count;
    for (uint32_t i = 0; i < ray_count; i++) {
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
        if (answer->kind != GN_REF_ANSWER_NONE && answers->details)
            number = XXH64(&answers->details[i], sizeof answers->details[i], number);
        if (answer->kind == GN_REF_ANSWER_TRIANGLE && answers->positions)
            number = XXH64(answers->positions[i], sizeof answers->positions[i], number);
        uint64_t both[3] = {result->answers, decision, number};
        result->answers = XXH64(both, sizeof both, 0);
        rays[i] = (uint32_t)(decision & 0xFFFF) << 16 | (uint32_t)(number & 0xFFFF);
    }
}
