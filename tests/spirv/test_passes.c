/* SPDX-License-Identifier: Apache-2.0 */
/* What compilers may make of a shader: after each pass of SPIRV-Tools, and after all of -O and -Os, a module is instrumented and valid,
 * what is proved of it is never wrong where nothing was wrong before, and it computes what it did.
 * With the name of a folder: the same of the modules there (closest_good.comp.spv), which another compiler made (crossed.sh). */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "checks/spirv/records.h"
#include "tests/spirv/corpus.h"
#include "tests/spirv/modules.h"

/* It defines a variable, as it does in the library. */
#define kDefaultMaxIdBound max_id_bound_of_test
#include <spirv-tools/libspirv.h>

/* As spirv-opt names them. -O0 is what glslang writes. */
static const char *const passes[] = {
    "-O0", "-O", "-Os", "--inline-entry-points-exhaustive", "--eliminate-local-single-block", "--eliminate-local-single-store",
    "--eliminate-local-multi-store", "--ssa-rewrite", "--eliminate-dead-branches", "--eliminate-dead-code-aggressive",
    "--eliminate-dead-functions", "--merge-blocks", "--merge-return", "--if-conversion", "--simplify-instructions", "--ccp",
    "--cfg-cleanup", "--scalar-replacement=100", "--private-to-local", "--local-redundancy-elimination",
    "--redundancy-elimination", "--loop-unroll", "--loop-invariant-code-motion", "--loop-peeling", "--loop-unswitch", "--copy-propagate-arrays",
    "--vector-dce", "--reduce-load-size", "--convert-local-access-chains", "--wrap-opkill", "--unify-const",
    "--eliminate-dead-const", "--flatten-decorations", "--compact-ids", "--strip-debug", "--eliminate-dead-inserts", "--workaround-1209",
    "--replace-invalid-opcode", "--combine-access-chains", "--code-sink", "--trim-capabilities"};
#define PASS_COUNT (sizeof passes / sizeof passes[0])

/* A pass that has something to say ends the program where nobody listens. */
static void heard(spv_message_level_t level, const char *source, const spv_position_t *position, const char *message)
{
    (void)source, (void)position;
    if (level <= SPV_MSG_ERROR)
        print_message("SPIRV-Tools: %s\n", message);
}

/* The module after a pass, malloc'ed; NULL where the pass does not apply. */
static uint32_t *pass_run(const char *pass, const uint32_t *words, size_t count, size_t *out_count)
{
    spv_optimizer_t *optimizer = spvOptimizerCreate(SPV_ENV_VULKAN_1_2);
    spv_optimizer_options options = spvOptimizerOptionsCreate();
    spv_binary binary = NULL;
    uint32_t *out = NULL;
    assert_non_null(optimizer);
    spvOptimizerSetMessageConsumer(optimizer, heard);
    if (strcmp(pass, "-O") == 0)
        spvOptimizerRegisterPerformancePasses(optimizer);
    else if (strcmp(pass, "-Os") == 0)
        spvOptimizerRegisterSizePasses(optimizer);
    else if (strcmp(pass, "-O0") != 0 && !spvOptimizerRegisterPassFromFlag(optimizer, pass))
        fail_msg("SPIRV-Tools has no pass %s", pass);
    if (spvOptimizerRun(optimizer, words, count, &binary, options) == SPV_SUCCESS) {
        out = malloc(binary->wordCount * sizeof *out);
        assert_non_null(out);
        memcpy(out, binary->code, binary->wordCount * sizeof *out);
        *out_count = binary->wordCount;
    }
    spvBinaryDestroy(binary);
    spvOptimizerOptionsDestroy(options);
    spvOptimizerDestroy(optimizer);
    return out;
}

static const char *folder; /* of modules that another compiler made, or NULL */

static uint32_t *module_from(const struct shader *shader, size_t pass, size_t *out_count)
{
    char path[1024];
    size_t size;
    uint32_t *original, *words;
    if (folder) {
        snprintf(path, sizeof path, "%s/%s.spv", folder, shader->file);
        return module_read(path, out_count);
    }
    original = module_load("plain", shader->file, &size);
    words = pass_run(passes[pass], original, size, out_count);
    free(original);
    return words;
}

static void passes_change_nothing(void **state)
{
    uint32_t count, failures = 0, modules = 0, untouched = 0, runs = 0;
    struct shader *shaders = corpus_read(&count);
    struct tracer *tracer = tracer_create();
    (void)state;
    for (uint32_t n = 0; n < count; n++) {
        const struct shader *shader = &shaders[n];
        bool silent = corpus_silent(shader) && !corpus_fires(shader);
        for (size_t p = folder ? 0 : n % 8; p < (folder ? 1 : PASS_COUNT); p += 8) { /* each shader meets some passes, each pass many shaders */
            struct gn_spirv_options options = shader->options;
            struct gn_spirv_result result;
            char message[512] = "";
            size_t changed;
            uint32_t *words = module_from(shader, p, &changed);
            if (!words)
                continue;
            options.set = RECORD_SET;
            gn_spirv_instrument(words, changed, &options, &result);
            modules++;
            untouched += result.status == GN_SPIRV_UNTOUCHED;
            bool good = result.status == GN_SPIRV_UNTOUCHED || result.status == GN_SPIRV_INSTRUMENTED;
            bool valid = !result.words || gn_spirv_validate(result.words, result.word_count, 0, message, sizeof message);
            if (!good || !valid || (silent && result.finding_count)) {
                print_error("%s after %s: %s %s%s%s\n", shader->file, folder ? folder : passes[p], gn_spirv_status_name(result.status),
                            result.message, message, result.finding_count ? ", and something is proved wrong" : "");
                failures++;
            } else if (silent && shader->stage == VK_SHADER_STAGE_COMPUTE_BIT && shader->run_count && result.words) {
                float plain[LANES], checked[LANES];
                size_t record_words = gn_records_word_count(result.check_count);
                uint32_t *records = calloc(record_words, sizeof *records);
                assert_non_null(records);
                gn_records_reset(records, result.check_count);
                struct program programs[2] = {{.stages = {{.stage = shader->stage, .words = words, .word_count = changed}},
                                               .stage_count = 1},
                                              {.stages = {{.stage = shader->stage,
                                                           .words = result.words,
                                                           .word_count = result.word_count,
                                                           .records = records,
                                                           .record_words = record_words}},
                                               .stage_count = 1}};
                tracer_run(tracer, &programs[0], &shader->runs[0].choices, plain);
                tracer_run(tracer, &programs[1], &shader->runs[0].choices, checked);
                for (uint32_t check = 0; check < result.check_count; check++) {
                    struct gn_records_check found;
                    failures += !gn_records_read(records, record_words, check, &found) || found.count;
                }
                failures += memcmp(plain, checked, sizeof plain) != 0;
                runs++;
                for (int i = 0; i < 2; i++)
                    tracer_forget(tracer, &programs[i]);
                free(records);
            }
            gn_spirv_result_finish(&result);
            free(words);
        }
    }
    print_message("%u modules, %u of them without anything to check, %u run\n", modules, untouched, runs);
    tracer_destroy(tracer);
    free(shaders);
    assert_true(folder ? runs > 0 : modules > 500);
    assert_int_equal(failures, 0);
}

int main(int argc, char **argv)
{
    folder = argc > 1 ? argv[1] : NULL;
    const struct CMUnitTest tests[] = {cmocka_unit_test(passes_change_nothing)};
    return cmocka_run_group_tests_name("spirv.passes", tests, NULL, NULL);
}
