/* SPDX-License-Identifier: Apache-2.0 */
/* The buffer that instrumented shaders write to: a storage buffer of 32-bit words, the same layout on the device and on
 * the host.
 *
 *   header   GN_RECORDS_HEADER words: the number of checks that there is room for (written by the host before use;
 *            the device writes nothing beyond it), then reports that found no room, then what the host says of the
 *            launch (enum gn_launch_word), then zeros
 *   checks   per check GN_RECORDS_CHECK words: how often it fired (low word, high word), then the first
 *            GN_RECORDS_KEPT records of it
 *   record   GN_RECORD_WORDS words, see enum gn_record_word; all zero until written
 *
 * Where many modules leave records, each has a buffer of that layout, and a table says where it is. The modules hold nothing but
 * the table's address and a key made of their content, so that they are the same in every run. The table:
 *
 *   header   GN_ROOT_HEADER words, see enum gn_root_word
 *   entries  GN_ROOT_ENTRY words each: key (low, high) and device address (low, high); the key 0 is free. An entry is
 *            looked for from key & (capacity - 1) upwards, around the end, until it or a free one is found
 */
#ifndef GN_CHECKS_SPIRV_RECORDS_H
#define GN_CHECKS_SPIRV_RECORDS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define GN_RECORDS_HEADER 8
#define GN_RECORDS_KEPT 2
#define GN_RECORD_OPERANDS 10
#define GN_RECORD_WORDS 16
#define GN_RECORDS_CHECK (2 + GN_RECORDS_KEPT * GN_RECORD_WORDS)

enum gn_record_word {
    GN_RECORD_STATE,        /* GN_RECORD_STATE_* */
    GN_RECORD_INVOCATION,   /* three words: global invocation, launch id, bits of the fragment's coordinates, or vertex and
                               instance index; zeros where the stage has none */
    GN_RECORD_OPERAND = 4,  /* Initialize and rules of a traced ray: flags, mask, origin, tmin, direction, tmax.
                               Generate: t, tmin, current t. Other rules of a trace: SBT offset, SBT stride, miss index,
                               time, depth, greatest depth; and from the seventh on, as of an Initialize from the first on, where rules of structures are
                               among them: set, binding, index, id. Report: t, hit kind. Call: index, number of callables.
                               Positions: from the seventh on instance, 0, 0, id; ~0 for an instance that was not asked for */
    GN_RECORD_CHECKSUM = 14,/* of the words before it, see gn_record_checksum() */
    GN_RECORD_WRITTEN = 15, /* 1, written last */
};

/* What the host may say of a launch of a ray-tracing pipeline, in the header of the buffer that the modules know (of the table,
 * where there is one). Zeros where it says nothing: then nothing is concluded.
 * Depths have a word per launch index, x + width * (y + height * z), which is zero before the launch; two launches that
 * may run at once must not share them. */
enum gn_launch_word {
    GN_LAUNCH_CALLABLES = 2, /* records of the callable shader binding table, and 1 */
    GN_LAUNCH_DEPTHS,        /* word of this buffer at which the depths start */
    GN_LAUNCH_DEPTH_COUNT,   /* launch indices that have a depth */
    GN_LAUNCH_SCRATCH,       /* written by the device, means nothing */
};

enum gn_root_word {
    GN_ROOT_CAPACITY, /* entries, a power of two; written by the host before use */
    GN_ROOT_FIRED,    /* how often anything was reported, modulo 2^32 */
    GN_ROOT_UNSURE = 6,/* for the host alone: not 0 when what it said of one launch may have reached another */
    GN_ROOT_EMPTY = 8,/* the header of a buffer without room, for modules without an entry; its second word counts them */
};
#define GN_ROOT_HEADER 16
#define GN_ROOT_ENTRY 4

/* What acceleration structures are. A shader cannot look at one, so each descriptor set that holds any has a mirror, a storage buffer at
 * binding GN_MIRROR_BINDING, written by whoever writes the descriptors: for each binding below GN_MIRROR_BINDINGS the word at
 * which its entries start and how many there are, and in the entries the ids of structures. A table at an address of its own has a word
 * for each of GN_STRUCTURES ids, 0 while nobody knows anything of it:
 *
 *   bits 0 to 2   its state (enum gn_structure_state)
 *   bit 3         GN_STRUCTURE_NO_POSITIONS: no BLAS in it lets shaders read vertex positions, all were built without
 *                 ALLOW_DATA_ACCESS. In the word of GN_STRUCTURE_ID_UNKNOWN: no BLAS on the device does. That word is asked where a
 *                 shader cannot tell the structure, as in hit shaders
 *   the others    the word of the table, counted from its start, at which the structure's list of instances begins; 0 for none. The list
 *                 lies behind the table's GN_STRUCTURES words: how many instances there are, then a bit for each (instance i is bit i % 32 of word
 *                 i / 32), set where its BLAS was built without ALLOW_DATA_ACCESS
 *
 * Both of these are only set where they are known for the structure as the shader will find it; while they are not, they stay 0 and nothing is
 * concluded. The list is written before the word that leads to it, and its memory has no other use as long as work may run
 * that read the word. */
#define GN_MIRROR_BINDING 128
#define GN_MIRROR_BINDINGS 128
#define GN_STRUCTURES 65536u /* a power of two */
enum gn_structure_id { GN_STRUCTURE_ID_NULL, GN_STRUCTURE_ID_UNKNOWN, GN_STRUCTURE_ID_UNWRITTEN, GN_STRUCTURE_ID_FIRST };
enum gn_structure_state {
    GN_STRUCTURE_NEVER_BUILT,
    GN_STRUCTURE_FINE, /* or not known */
    GN_STRUCTURE_DESTROYED,
    GN_STRUCTURE_BOTTOM_LEVEL,
    GN_STRUCTURE_NONE,
};
#define GN_STRUCTURE_STATE_BITS 7u
#define GN_STRUCTURE_NO_POSITIONS 8u
#define GN_STRUCTURE_LIST_SHIFT 4

/* What the shadow state of a query says before the operation. 0 where the check needs no state. */
#define GN_RECORD_STATE_INITIALIZED 1u
#define GN_RECORD_STATE_CANDIDATE 2u
#define GN_RECORD_STATE_FINISHED 4u
/* Times the number of Proceeds since the initialization, where a limit is set. */
#define GN_RECORD_STATE_PROCEEDS 8u

/* One check as the buffer has it. A record that is not intact was still being written, or its memory was lost. */
struct gn_records_check {
    uint64_t count;
    uint32_t record_count;
    struct {
        bool intact;
        uint32_t state, invocation[3], operands[GN_RECORD_OPERANDS];
    } records[GN_RECORDS_KEPT];
};

/* Words that a buffer for `check_count` checks has; 0 if that overflows 32 bits. */
uint32_t gn_records_word_count(uint32_t check_count);
/* Makes a buffer of that many words ready for use. */
void gn_records_reset(uint32_t *words, uint32_t check_count);
/* Reads one check; false when the buffer has no room for it. */
bool gn_records_read(const uint32_t *words, size_t word_count, uint32_t check, struct gn_records_check *out);
/* Makes a table of that many entries, a power of two, ready for use. */
void gn_root_reset(uint32_t *words, uint32_t capacity);
#define GN_ROOT_WORDS(capacity) (GN_ROOT_HEADER + (size_t)GN_ROOT_ENTRY * (capacity))
/* Enters where the buffer of `key` (not 0) is. False when the table is three quarters full. A device may read meanwhile. */
bool gn_root_enter(uint32_t *words, uint64_t key, uint64_t address);
uint32_t gn_record_checksum(const uint32_t record[GN_RECORD_WORDS]);

#ifdef __cplusplus
}
#endif
#endif
