/* SPDX-License-Identifier: Apache-2.0 */
/* Every test shader: what is proved of it in every form it is compiled to, and what its checks find when it runs. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "checks/spirv/records.h"
#include "tests/spirv/corpus.h"
#include "tests/spirv/modules.h"

struct suite {
    struct shader *shaders;
    uint32_t count;
    struct tracer *tracer;
    uint32_t fired[GN_SPIRV_RULE_COUNT], silent[GN_SPIRV_RULE_COUNT]; /* runs in which a rule did, and was checked or proved but did not */
};

static bool site_marked(const struct shader *shader, uint32_t line, uint32_t rule, bool wrong, bool lines, bool *used)
{
    for (uint32_t m = 0; m < shader->mark_count; m++)
        if (!used[m] && (!lines || shader->marks[m].line == line) && (uint32_t)shader->marks[m].rule == rule &&
            shader->marks[m].wrong == wrong)
            return used[m] = true;
    return false;
}

/* Whether exactly what is marked is found; says on stderr what is not. */
static bool marks_hold(const struct shader *shader, const char *form, const struct gn_spirv_result *result)
{
    bool used[MAX_MARKS] = {false}, good = true, lines = shader->assembly || strcmp(form, "plain") != 0;
    uint32_t *at = calloc(result->site_count + 1u, sizeof *at);
    assert_non_null(at);
    corpus_lines(shader, result, at);
    for (uint32_t s = 0; s < result->site_count; s++)
        for (uint32_t rule = 0; rule < GN_SPIRV_RULE_COUNT; rule++) {
            const struct gn_spirv_site *site = &result->sites[s];
            bool wrong = site->wrong >> rule & 1;
            if ((site->checked >> rule & 1) && !site_marked(shader, at[s], rule, wrong, lines, used)) {
                print_error("%s:%u (%s; %s): found %s%c, which is not marked\n", shader->file, at[s], form, shader->why,
                            rule_name((enum gn_spirv_rule_index)rule), wrong ? '!' : '?');
                good = false;
            }
        }
    for (uint32_t m = 0; m < shader->mark_count; m++)
        if (!used[m]) {
            print_error("%s:%u (%s; %s): %s%c is marked, but not found\n", shader->file, shader->marks[m].line, form, shader->why,
                        rule_name(shader->marks[m].rule), shader->marks[m].wrong ? '!' : '?');
            good = false;
        }
    free(at);
    return good;
}

static void marks_are_found(void **state)
{
    struct suite *suite = *state;
    int failures = 0;
    for (uint32_t n = 0; n < suite->count; n++)
        for (int form = 0; form < 3; form++) {
            const struct shader *shader = &suite->shaders[n];
            struct gn_spirv_options options = shader->options;
            struct gn_spirv_result result;
            size_t count;
            uint32_t *words = module_load(form_names[form], shader->file, &count);
            options.set = 7;
            options.root = shader->asks_structures ? tracer_root(suite->tracer) : 0;
            options.structures = shader->asks_structures ? tracer_structures(suite->tracer) : 0;
            gn_spirv_instrument(words, count, &options, &result);
            if (result.status != (shader->mark_count ? GN_SPIRV_INSTRUMENTED : GN_SPIRV_UNTOUCHED)) {
                print_error("%s (%s): %s: %s\n", shader->file, form_names[form], gn_spirv_status_name(result.status),
                            result.message);
                failures++;
            }
            failures += !marks_hold(shader, form_names[form], &result);
            /* What cannot run has to be proved one way or the other. */
            for (uint32_t site = 0; shader->never_run && site < result.site_count; site++)
                for (uint32_t rule = 0; rule < GN_SPIRV_RULE_COUNT; rule++) {
                    suite->fired[rule] += result.sites[site].wrong >> rule & 1;
                    suite->silent[rule] += (result.sites[site].judged & ~result.sites[site].checked) >> rule & 1;
                }
            gn_spirv_result_finish(&result);
            free(words);
        }
    assert_int_equal(failures, 0);
}

/* What can be told without a device: every shader says why, every mistake has a silent twin. */
static void mistakes_have_twins(void **state)
{
    struct suite *suite = *state;
    int failures = 0;
    for (uint32_t n = 0; n < suite->count; n++) {
        const struct shader *shader = &suite->shaders[n], *twin = corpus_find(suite->shaders, suite->count, shader->twin);
        if (!shader->why[0]) {
            print_error("%s does not say why\n", shader->file);
            failures++;
        }
        if (shader->twin[0] && (!twin || !corpus_silent(twin) || corpus_fires(twin))) {
            print_error("%s names the twin %s, which %s\n", shader->file, shader->twin, twin ? "is not silent" : "is not there");
            failures++;
        }
        if (corpus_fires(shader) && !corpus_silent(shader) && !shader->twin[0]) {
            print_error("%s fires, but has neither a silent run nor a twin\n", shader->file);
            failures++;
        }
    }
    print_message("%u shaders\n", suite->count);
    assert_int_equal(failures, 0);
}

static void undefined_behaviour_of_wgsl_is_covered(void **state)
{
    /* The clauses for WGSL's list of undefined behaviour; the end points of 44 are allowed. */
    static const int bullets[] = {29, 30, 31, 32, 33, 34, 35, 36, 37, 38, 39, 40, 41, 42};
    struct suite *suite = *state;
    int failures = 0;
    for (size_t b = 0; b < sizeof bullets / sizeof bullets[0]; b++) {
        char clause[16];
        bool fires = false, silent = false;
        snprintf(clause, sizeof clause, "NG-%03d", bullets[b]);
        for (uint32_t n = 0; n < suite->count; n++) {
            const struct shader *shader = &suite->shaders[n];
            if (!strstr(shader->clauses, clause))
                continue;
            fires |= corpus_fires(shader);
            silent |= corpus_silent(shader) || shader->twin[0];
        }
        if (!fires || !silent) {
            print_error("%s has no shader that %s\n", clause, fires ? "stays silent" : "fires");
            failures++;
        }
    }
    assert_int_equal(failures, 0);
}

/* On the device */

/* The shaders that make one pipeline: those of the same name. False where this one is not the first, or the driver cannot. */
static bool program_find(const struct suite *suite, uint32_t n, const struct shader *out[MAX_STAGES], uint32_t *out_count)
{
    const struct shader *shader = &suite->shaders[n];
    size_t length = (size_t)(strchr(shader->file, '.') - shader->file) + 1;
    *out_count = 0;
    if (shader->run_count == 0)
        return false;
    out[(*out_count)++] = shader;
    for (uint32_t i = 0; i < suite->count; i++)
        if (i != n && strncmp(suite->shaders[i].file, shader->file, length) == 0 && *out_count < MAX_STAGES)
            out[(*out_count)++] = &suite->shaders[i];
    for (uint32_t i = 0; i < *out_count; i++)
        if (!tracer_supports(suite->tracer, out[i]->stage))
            return false;
    return true;
}

struct loaded {
    uint32_t *words;
    struct gn_spirv_result result;
};

/* The program as it is and as it is instrumented; a fragment shader alone gets a vertex shader that covers all pixels. */
static void programs_load(const struct suite *suite, const char *form, const struct shader *const *shaders, uint32_t count,
                          const struct gn_spirv_options *options, bool by_table, struct program programs[2],
                          struct loaded loaded[MAX_STAGES + 1])
{
    bool pixels = count == 1 && shaders[0]->stage == VK_SHADER_STAGE_FRAGMENT_BIT;
    memset(programs, 0, 2 * sizeof *programs);
    for (uint32_t i = 0; i < count + pixels; i++) {
        struct gn_spirv_options own = *options;
        size_t words;
        own.set = RECORD_SET;
        own.binding = i;
        own.structures = shaders[0]->asks_structures ? tracer_structures(suite->tracer) : 0;
        by_table |= shaders[0]->asks_structures;
        own.root = by_table ? tracer_root(suite->tracer) : 0;
        own.key = by_table ? 100 + i : 0;
        loaded[i].words = module_load(form, i < count ? shaders[i]->file : "helper_fullscreen.vert", &words);
        gn_spirv_instrument(loaded[i].words, words, &own, &loaded[i].result);
        const struct gn_spirv_result *result = &loaded[i].result;
        struct stage plain = {
            .stage = i < count ? shaders[i]->stage : VK_SHADER_STAGE_VERTEX_BIT, .words = loaded[i].words, .word_count = words};
        struct stage checked = plain;
        if (result->status == GN_SPIRV_INSTRUMENTED) {
            checked.words = result->words;
            checked.word_count = result->word_count;
            checked.record_words = gn_records_word_count(result->check_count);
            checked.records = calloc(checked.record_words, sizeof(uint32_t));
            checked.key = own.key;
            assert_non_null(checked.records);
        }
        programs[0].stages[i] = plain;
        programs[1].stages[i] = checked;
    }
    for (int p = 0; p < 2; p++) {
        programs[p].stage_count = count + pixels;
        programs[p].callables = shaders[0]->callables;
        programs[p].structures = shaders[0]->structures;
        programs[p].recursion = options->recursion_known ? options->max_recursion + 2 : 1;
    }
}

static void programs_forget(const struct suite *suite, struct program programs[2], struct loaded *loaded)
{
    for (int p = 0; p < 2; p++)
        tracer_forget(suite->tracer, &programs[p]);
    for (uint32_t i = 0; i < programs[1].stage_count; i++) {
        free(programs[1].stages[i].records);
        gn_spirv_result_finish(&loaded[i].result);
        free(loaded[i].words);
    }
}

static uint32_t lane_of(VkShaderStageFlagBits stage, const uint32_t invocation[3])
{
    float x;
    memcpy(&x, invocation, sizeof x);
    return stage == VK_SHADER_STAGE_FRAGMENT_BIT ? (uint32_t)x : invocation[0];
}

/* Whether the run's records are those expected, each intact and of an invocation that was meant. */
static bool firings_hold(struct suite *suite, const struct run *run, const struct shader *const *shaders,
                         const struct program *program, const struct loaded *loaded, char *out_text, size_t size)
{
    uint32_t counts[GN_SPIRV_RULE_COUNT] = {0};
    bool good = true;
    size_t used = 0;
    out_text[0] = '\0';
    for (uint32_t i = 0; i < program->stage_count; i++) {
        const struct gn_spirv_result *result = &loaded[i].result;
        const struct stage *stage = &program->stages[i];
        for (uint32_t s = 0; s < result->site_count; s++)
            for (uint32_t rule = 0; rule < GN_SPIRV_RULE_COUNT; rule++)
                suite->silent[rule] += run->firing_count == 0 && result->sites[s].judged >> rule & 1;
        for (uint32_t check = 0; stage->records && check < result->check_count; check++) {
            struct gn_records_check found;
            uint32_t site;
            enum gn_spirv_rule_index rule;
            assert_true(gn_records_read(stage->records, stage->record_words, check, &found));
            assert_true(gn_spirv_check_find(result, check, &site, &rule));
            counts[rule] += (uint32_t)found.count;
            suite->fired[rule] += found.count > 0;
            for (uint32_t r = 0; r < found.record_count; r++)
                good &= found.records[r].intact && lane_of(stage->stage, found.records[r].invocation) < LANES &&
                        (run->choices.lane == UINT32_MAX ||
                         lane_of(stage->stage, found.records[r].invocation) == run->choices.lane);
        }
        good &= !stage->records || stage->records[1] == 0; /* nothing was lost */
    }
    (void)shaders;
    for (uint32_t rule = 0; rule < GN_SPIRV_RULE_COUNT; rule++) {
        uint32_t expected = 0;
        for (uint32_t f = 0; f < run->firing_count; f++)
            expected += run->firings[f].rule == (enum gn_spirv_rule_index)rule ? run->firings[f].count : 0;
        good &= counts[rule] == expected;
        if (counts[rule] && used < size)
            used += (size_t)snprintf(out_text + used, size - used, " %s*%u", rule_name((enum gn_spirv_rule_index)rule), counts[rule]);
    }
    return good;
}

static int run_shader(struct suite *suite, uint32_t n, const char *form, bool without_proofs, bool by_table)
{
    const struct shader *shader = &suite->shaders[n], *shaders[MAX_STAGES];
    struct loaded loaded[MAX_STAGES + 1];
    struct program programs[2];
    uint32_t count, done = 0;
    int failures = 0;
    if (!program_find(suite, n, shaders, &count))
        return 0;
    struct gn_spirv_options options = shader->options;
    options.without_proofs = without_proofs;
    programs_load(suite, form, shaders, count, &options, by_table, programs, loaded);
    for (uint32_t r = 0; r < shader->run_count; r++) {
        const struct run *run = &shader->runs[r];
        float plain[LANES], checked[LANES];
        char text[1024];
        /* An original that is wrong may do anything: only what is checked is run then. */
        bool compare = run->firing_count == 0;
        /* One run is enough to see checks stay silent that are proved to. */
        if (without_proofs && (!compare || done++))
            continue;
        if (compare)
            tracer_run(suite->tracer, &programs[0], &run->choices, plain);
        for (uint32_t i = 0; i < programs[1].stage_count; i++)
            if (programs[1].stages[i].records)
                gn_records_reset(programs[1].stages[i].records, loaded[i].result.check_count);
        tracer_run(suite->tracer, &programs[1], &run->choices, checked);
        bool good = firings_hold(suite, run, shaders, &programs[1], loaded, text, sizeof text);
        bool same = !compare || memcmp(plain, checked, sizeof plain) == 0;
        if (!good || !same) {
            print_error("%s (%s%s%s), run %u:%s%s\n", shader->file, form, without_proofs ? ", without proofs" : "",
                        by_table ? ", by a table" : "", r + 1, *text ? text : " silent", same ? "" : ", and other results");
            failures++;
        }
    }
    programs_forget(suite, programs, loaded);
    return failures;
}

static void runs_find_what_is_expected(void **state)
{
    struct suite *suite = *state;
    int failures = 0;
    uint32_t runs = 0;
    for (uint32_t n = 0; n < suite->count; n++) {
        failures += run_shader(suite, n, "line", false, false);
        runs += suite->shaders[n].run_count;
    }
    print_message("%u runs\n", runs);
    assert_int_equal(failures, 0);
}

static void optimized_shaders_find_the_same(void **state)
{
    struct suite *suite = *state;
    int failures = 0;
    for (uint32_t n = 0; n < suite->count; n++)
        failures += run_shader(suite, n, "optimized", false, true);
    assert_int_equal(failures, 0);
}

static void silent_without_proofs(void **state)
{
    struct suite *suite = *state;
    int failures = 0;
    for (uint32_t n = 0; n < suite->count; n++)
        if (corpus_silent(&suite->shaders[n]))
            failures += run_shader(suite, n, "optimized", true, true);
    assert_int_equal(failures, 0);
}

/* After the runs: each rule has fired, and has stayed silent where it was judged. */
static void every_rule_fires_and_stays_silent(void **state)
{
    struct suite *suite = *state;
    int failures = 0;
    for (uint32_t rule = 0; rule < GN_SPIRV_RULE_COUNT; rule++) {
        const uint32_t fired = suite->fired[rule], silent = suite->silent[rule];
        if (!fired || !silent) {
            print_error("%s fires %u times and is silent %u times\n", gn_spirv_rule_at((enum gn_spirv_rule_index)rule)->id, fired, silent);
            failures++;
        }
    }
    assert_int_equal(failures, 0);
}

static int setup(void **state)
{
    struct suite *suite = calloc(1, sizeof *suite);
    assert_non_null(suite);
    suite->shaders = corpus_read(&suite->count);
    suite->tracer = tracer_create();
    *state = suite;
    return 0;
}

static int teardown(void **state)
{
    struct suite *suite = *state;
    if (!suite)
        return 0;
    tracer_destroy(suite->tracer);
    free(suite->shaders);
    free(suite);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(mistakes_have_twins),
        cmocka_unit_test(undefined_behaviour_of_wgsl_is_covered),
        cmocka_unit_test(marks_are_found),
        cmocka_unit_test(runs_find_what_is_expected),
        cmocka_unit_test(optimized_shaders_find_the_same),
        cmocka_unit_test(silent_without_proofs),
        cmocka_unit_test(every_rule_fires_and_stays_silent),
    };
    return cmocka_run_group_tests_name("spirv.corpus", tests, setup, teardown);
}
