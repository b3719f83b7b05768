/* SPDX-License-Identifier: Apache-2.0 */
/* Any words are input: mutated modules never crash the library, what it writes of those that are still valid is valid too, and its
 * model loses nothing of a valid one. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "checks/spirv/records.h"
#include "tests/spirv/modules.h"

#define MUTATIONS 1000

static uint64_t random_state = 0x123456789ABCDEFull;

static uint32_t random_below(uint32_t limit)
{
    random_state ^= random_state << 13;
    random_state ^= random_state >> 7;
    random_state ^= random_state << 17;
    return (uint32_t)((random_state >> 16) % limit);
}

static size_t random_instruction(const uint32_t *words, size_t count)
{
    size_t starts[4096], found = 0;
    for (size_t at = 5; at < count && found < 4096 && words[at] >> 16; at += words[at] >> 16)
        starts[found++] = at;
    return found ? starts[random_below((uint32_t)found)] : 5;
}

/* One change; returns the new count. `words` has room for twice the count. */
static size_t mutate(uint32_t *words, size_t count)
{
    if (count < 8)
        return count;
    size_t at = random_instruction(words, count), length = words[at] >> 16;
    if (at >= count || length == 0 || length > count - at)
        return count;
    switch (random_below(8)) {
    case 0: words[random_below((uint32_t)count)] ^= 1u << random_below(32); return count;
    case 1: words[random_below((uint32_t)count)] = random_below(2) ? random_below(200) : UINT32_MAX - random_below(3); return count;
    case 2: return random_below((uint32_t)count) + 1;
    case 3: /* an operand becomes another id */
        if (length > 1)
            words[at + 1 + random_below((uint32_t)length - 1)] = random_below(words[3] ? words[3] : 1);
        return count;
    case 4: /* an instruction goes */
        memmove(words + at, words + at + length, (count - at - length) * 4);
        return count - length;
    case 5: /* an instruction comes twice */
        memmove(words + at + length, words + at, (count - at) * 4);
        return count + length;
    case 6: /* an instruction changes its opcode, to one of the queries' mostly */
        words[at] = (words[at] & 0xFFFF0000u) | (random_below(2) ? 4472 + random_below(8) : 6016 + random_below(17));
        return count;
    default: /* an instruction moves */
        if (length < 64) {
            uint32_t moved[64];
            memcpy(moved, words + at, length * 4);
            memmove(words + at, words + at + length, (count - at - length) * 4);
            size_t to = random_instruction(words, count - length);
            memmove(words + to + length, words + to, (count - length - to) * 4);
            memcpy(words + to, moved, length * 4);
        }
        return count;
    }
}

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + (double)now.tv_nsec * 1e-9;
}

static void mutations_never_crash(void **state)
{
    char names[256][64], message[512];
    uint32_t statuses[5] = {0}, failures = 0;
    double slowest = 0;
    (void)state;
    uint32_t name_count = modules_list(names, 256);
    for (uint32_t m = 0; m < MUTATIONS; m++) {
        size_t count;
        uint32_t *original = module_load(form_names[m % FORM_COUNT], names[random_below(name_count)], &count);
        uint32_t *words = malloc(count * 32 * 4);
        assert_non_null(words);
        memcpy(words, original, count * 4);
        for (uint32_t changes = 1 + random_below(3); changes-- > 0;)
            count = mutate(words, count);
        struct gn_spirv_options options = {.profile = (enum gn_profile)random_below(GN_PROFILE_COUNT),
                                           .set = 7,
                                           .without_proofs = random_below(2),
                                           /* Half of them reach the analysis although they are not valid. */
                                           .without_validation = m & 1};
        struct gn_spirv_result result;
        double start = seconds();
        gn_spirv_instrument(words, count, &options, &result);
        double took = seconds() - start;
        slowest = took > slowest ? took : slowest;
        statuses[result.status]++;
        if (result.status != GN_SPIRV_INSTRUMENTED && result.message[0] == '\0') {
            print_error("mutation %u: %s without a reason\n", m, gn_spirv_status_name(result.status));
            failures++;
        }
        if (result.status == GN_SPIRV_INSTRUMENTED && !options.without_validation &&
            !gn_spirv_validate(result.words, result.word_count, 0, message, sizeof message)) {
            print_error("mutation %u of a valid module is not valid: %s\n", m, message);
            failures++;
        }
        gn_spirv_has_queries(words, count);
        gn_spirv_result_finish(&result);
        free(words);
        free(original);
    }
    print_message("of %d: %u instrumented, %u untouched, %u declined, %u invalid; the slowest took %.3f s\n", MUTATIONS,
                  statuses[0], statuses[1], statuses[2], statuses[3], slowest);
    assert_int_equal(failures, 0);
    assert_true(statuses[GN_SPIRV_INSTRUMENTED] > 50 && statuses[GN_SPIRV_INVALID] > 50);
    assert_true(slowest < 1);
}

static void the_model_loses_nothing(void **state)
{
    char names[256][64], message[512];
    (void)state;
    uint32_t name_count = modules_list(names, 256);
    for (uint32_t n = 0; n < name_count; n++)
        for (int form = 0; form < FORM_COUNT; form++) {
            size_t count, back = 0;
            uint32_t *words = module_load(form_names[form], names[n], &count);
            uint32_t *copy = gn_spirv_round_trip(words, count, &back, message, sizeof message);
            if (!copy || back != count || memcmp(words, copy, count * 4) != 0)
                fail_msg("%s (%s) changes: %s", names[n], form_names[form], copy ? "words differ" : message);
            free(copy);
            free(words);
        }
}

static void hostile_headers_are_refused(void **state)
{
    static const struct {
        const char *name;
        size_t count;
        uint32_t words[8];
        const char *says;
    } table[] = {
        {"empty", 0, {0}, "5 to"},
        {"four words", 4, {0x07230203, 0x10500, 0, 10}, "5 to"},
        {"magic", 5, {1, 2, 3, 4, 5}, "magic"},
        {"swapped", 5, {0x03022307, 0, 0, 0, 0}, "byte order"},
        {"no bound", 5, {0x07230203, 0x10500, 0, 0, 0}, "bound"},
        {"huge bound", 5, {0x07230203, 0x10500, 0, UINT32_MAX, 0}, "bound"},
        {"no instruction", 5, {0x07230203, 0x10500, 0, 10, 0}, "add up"},
        {"length 0", 6, {0x07230203, 0x10500, 0, 10, 0, 17}, "add up"},
        {"too long", 6, {0x07230203, 0x10500, 0, 10, 0, 0x20011}, "add up"},
        {"id beyond the bound", 7, {0x07230203, 0x10500, 0, 10, 0, 0x20013, 99}, "bound"},
        {"label outside", 7, {0x07230203, 0x10500, 0, 10, 0, 0x200F8, 5}, "label inside"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++) {
        struct gn_spirv_result result;
        gn_spirv_instrument(table[i].count ? table[i].words : NULL, table[i].count, NULL, &result);
        if (result.status != GN_SPIRV_INVALID && result.status != GN_SPIRV_DECLINED)
            fail_msg("%s: status %s", table[i].name, gn_spirv_status_name(result.status));
        if (!strstr(result.message, table[i].says))
            fail_msg("%s: expected a message with \"%s\", found \"%s\"", table[i].name, table[i].says, result.message);
        gn_spirv_result_finish(&result);
    }
}

static void records_are_not_trusted(void **state)
{
    uint32_t words[GN_RECORDS_HEADER + GN_RECORDS_CHECK];
    struct gn_records_check check;
    (void)state;
    assert_int_equal(gn_records_word_count(1), sizeof words / 4);
    assert_int_equal(gn_records_word_count(UINT32_MAX), 0);
    memset(words, 0xFF, sizeof words);
    gn_records_reset(words, 1);
    assert_true(gn_records_read(words, sizeof words / 4, 0, &check));
    assert_true(check.count == 0 && check.record_count == 0);
    assert_false(gn_records_read(words, sizeof words / 4, 1, &check));
    assert_false(gn_records_read(words, 3, 0, &check));
    uint32_t *record = words + GN_RECORDS_HEADER + 2;
    words[GN_RECORDS_HEADER] = 5;
    words[GN_RECORDS_HEADER + 1] = 1;
    for (uint32_t i = 0; i < GN_RECORD_CHECKSUM; i++)
        record[i] = i * 3;
    record[GN_RECORD_CHECKSUM] = gn_record_checksum(record);
    record[GN_RECORD_WRITTEN] = 1;
    assert_true(gn_records_read(words, sizeof words / 4, 0, &check));
    assert_true(check.count == 0x100000005ull && check.record_count == GN_RECORDS_KEPT);
    assert_true(check.records[0].intact && !check.records[1].intact);
    assert_int_equal(check.records[0].operands[0], GN_RECORD_OPERAND * 3);
    record[GN_RECORD_OPERAND] ^= 1;
    assert_true(gn_records_read(words, sizeof words / 4, 0, &check));
    assert_false(check.records[0].intact);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_model_loses_nothing),
        cmocka_unit_test(hostile_headers_are_refused),
        cmocka_unit_test(records_are_not_trusted),
        cmocka_unit_test(mutations_never_crash),
    };
    return cmocka_run_group_tests_name("spirv.robustness", tests, NULL, NULL);
}
