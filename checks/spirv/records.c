/* SPDX-License-Identifier: Apache-2.0 */
/* The host's side of the record buffer. Its content comes from a device that may have been lost: nothing is trusted. */
#include "checks/spirv/records.h"

#include <string.h>

uint32_t gn_records_word_count(uint32_t check_count)
{
    uint32_t words;
    if (__builtin_mul_overflow(check_count, (uint32_t)GN_RECORDS_CHECK, &words) || words > UINT32_MAX - GN_RECORDS_HEADER)
        return 0;
    return words + GN_RECORDS_HEADER;
}

void gn_records_reset(uint32_t *words, uint32_t check_count)
{
    memset(words, 0, (size_t)gn_records_word_count(check_count) * sizeof *words);
    words[0] = check_count;
}

uint32_t gn_record_checksum(const uint32_t record[GN_RECORD_WORDS])
{
    uint32_t sum = 0x9E3779B9u;
    for (int i = 0; i < GN_RECORD_CHECKSUM; i++)
        sum = (sum ^ record[i]) * 0x01000193u;
    return sum;
}

bool gn_records_read(const uint32_t *words, size_t word_count, uint32_t check, struct gn_records_check *out)
{
    memset(out, 0, sizeof *out);
    if (word_count < GN_RECORDS_HEADER || check >= (word_count - GN_RECORDS_HEADER) / GN_RECORDS_CHECK)
        return false;
    const uint32_t *at = words + GN_RECORDS_HEADER + (size_t)check * GN_RECORDS_CHECK;
    out->count = at[0] | (uint64_t)at[1] << 32;
    out->record_count = out->count < GN_RECORDS_KEPT ? (uint32_t)out->count : GN_RECORDS_KEPT;
    for (uint32_t i = 0; i < out->record_count; i++) {
        const uint32_t *record = at + 2 + i * GN_RECORD_WORDS;
        out->records[i].intact =
            record[GN_RECORD_WRITTEN] == 1 && record[GN_RECORD_CHECKSUM] == gn_record_checksum(record);
        out->records[i].state = record[GN_RECORD_STATE];
        memcpy(out->records[i].invocation, record + GN_RECORD_INVOCATION, sizeof out->records[i].invocation);
        memcpy(out->records[i].operands, record + GN_RECORD_OPERAND, sizeof out->records[i].operands);
    }
    return true;
}

void gn_root_reset(uint32_t *words, uint32_t capacity)
{
    memset(words, 0, GN_ROOT_WORDS(capacity) * sizeof *words);
    words[GN_ROOT_CAPACITY] = capacity;
}

bool gn_root_enter(uint32_t *words, uint64_t key, uint64_t address)
{
    uint32_t capacity = words[GN_ROOT_CAPACITY], used = 0;
    uint32_t *entry = NULL;
    for (uint32_t i = 0; i < capacity; i++) {
        const uint32_t *at = words + GN_ROOT_HEADER + (size_t)i * GN_ROOT_ENTRY;
        used += (at[0] | at[1]) != 0;
    }
    if (used >= capacity - capacity / 4)
        return false;
    for (uint32_t i = (uint32_t)key;; i++) {
        entry = words + GN_ROOT_HEADER + (size_t)(i & (capacity - 1)) * GN_ROOT_ENTRY;
        if ((entry[0] | entry[1]) == 0 || (entry[0] == (uint32_t)key && entry[1] == (uint32_t)(key >> 32)))
            break;
    }
    /* The address first: whoever finds the key finds it. */
    entry[2] = (uint32_t)address;
    entry[3] = (uint32_t)(address >> 32);
    __atomic_thread_fence(__ATOMIC_RELEASE);
    __atomic_store_n(&entry[1], (uint32_t)(key >> 32), __ATOMIC_RELAXED);
    __atomic_store_n(&entry[0], (uint32_t)key, __ATOMIC_RELEASE);
    return true;
}
