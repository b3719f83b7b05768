/* SPDX-License-Identifier: Apache-2.0 */
/* Fuzzing's trials, see trial.h. */
#include "tests/spirv/trial.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "tests/spirv/modules.h"
#include "tests/spirv/mutate.h"

struct trials {
    char names[512][64];
    uint32_t name_count, statuses[5], failures, still_valid;
    double slowest;
    struct original {
        uint32_t *words;
        size_t count;
    } *originals; /* per name and form, read when first needed */
};

struct trials *trials_create(void)
{
    struct trials *trials = calloc(1, sizeof *trials);
    if (!trials)
        abort();
    trials->name_count = modules_list(trials->names, 512);
    trials->originals = calloc((size_t)trials->name_count * FORM_COUNT, sizeof *trials->originals);
    if (!trials->originals || !trials->name_count)
        abort();
    return trials;
}

/* Of this thread: others may be at work beside it. */
static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec + (double)now.tv_nsec * 1e-9;
}

static void wrong(struct trials *trials, uint64_t seed, uint64_t number, const char *name, const char *what, const char *why)
{
    fprintf(stderr, "seed %llu, number %llu (%s): %s%s\n", (unsigned long long)seed, (unsigned long long)number, name, what, why);
    trials->failures++;
}

void trials_run(struct trials *trials, uint64_t seed, uint64_t number)
{
    struct chance chance = {(seed * 0x9E3779B97F4A7C15ull + number * 0xD1B54A32D192ED03ull) | 1};
    for (int i = 0; i < 4; i++)
        chance_below(&chance, 2);
    uint32_t name = chance_below(&chance, trials->name_count), form = chance_below(&chance, FORM_COUNT);
    struct original *original = &trials->originals[name * FORM_COUNT + form];
    if (!original->words)
        original->words = module_load(form_names[form], trials->names[name], &original->count);
    const uint32_t changes = 1 + chance_below(&chance, 4);
    size_t count = original->count;
    uint32_t *words = malloc((count + changes * MUTATE_ROOM) * sizeof *words);
    char message[512];
    if (!words)
        abort();
    memcpy(words, original->words, count * sizeof *words);
    const bool gentle = chance_below(&chance, 2);
    for (uint32_t i = 0; i < changes; i++)
        count = mutate(words, count, gentle, &chance);

    const struct gn_spirv_options options = {.profile = (enum gn_profile)chance_below(&chance, GN_PROFILE_COUNT),
                                             .set = 7,
                                             .root = chance_below(&chance, 2) ? 0x100000 : 0,
                                             .key = 42,
                                             .proceed_limit = chance_below(&chance, 3) * 100,
                                             .recursion_known = chance_below(&chance, 2),
                                             .max_recursion = chance_below(&chance, 4),
                                             .max_payload = chance_below(&chance, 3) * 8,
                                             .max_attribute = chance_below(&chance, 3) * 8,
                                             .forbidden_ray_flags = chance_below(&chance, 4) << 8,
                                             .without_proofs = chance_below(&chance, 2),
                                             /* Some reach the analysis although they are not valid. */
                                             .without_validation = chance_below(&chance, 3) == 0};
    struct gn_spirv_result result;
    const double start = seconds();
    gn_spirv_instrument(words, count, &options, &result);
    const double took = seconds() - start;
    trials->slowest = took > trials->slowest ? took : trials->slowest;
    trials->statuses[result.status]++;
    if (took > 1)
        wrong(trials, seed, number, trials->names[name], "took longer than a second", "");
    if (result.status != GN_SPIRV_INSTRUMENTED && result.message[0] == '\0')
        wrong(trials, seed, number, trials->names[name], gn_spirv_status_name(result.status), " without a reason");
    if (result.status == GN_SPIRV_INSTRUMENTED && !options.without_validation) {
        trials->still_valid++;
        if (!gn_spirv_validate(result.words, result.word_count, 0, message, sizeof message))
            wrong(trials, seed, number, trials->names[name], "no longer valid: ", message);
    }
    gn_spirv_has_queries(words, count);
    gn_spirv_result_finish(&result);
    free(words);
}

void trials_print(const struct trials *trials)
{
    for (int status = 0; status < 5; status++)
        printf("%u %s, ", trials->statuses[status], gn_spirv_status_name((enum gn_spirv_status)status));
    printf("%u valid before and checked afterwards; the slowest took %.3f s\n", trials->still_valid, trials->slowest);
}

uint32_t trials_instrumented(const struct trials *trials)
{
    return trials->statuses[GN_SPIRV_INSTRUMENTED];
}

uint32_t trials_invalid(const struct trials *trials)
{
    return trials->statuses[GN_SPIRV_INVALID];
}

uint32_t trials_destroy(struct trials *trials)
{
    uint32_t failures = trials->failures;
    for (uint32_t i = 0; i < trials->name_count * FORM_COUNT; i++)
        free(trials->originals[i].words);
    free(trials->originals);
    free(trials);
    return failures;
}
