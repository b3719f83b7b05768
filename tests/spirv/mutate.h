/* SPDX-License-Identifier: Apache-2.0 */
/* Changes modules at random: words, operands, instructions, and such changes that mostly leave a valid module valid. */
#ifndef GN_TESTS_SPIRV_MUTATE_H
#define GN_TESTS_SPIRV_MUTATE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* The same state gives the same numbers everywhere; any value but 0. */
struct chance {
    uint64_t state;
};
uint32_t chance_below(struct chance *chance, uint32_t limit);

/* Room that one change may need beyond the words there are. */
#define MUTATE_ROOM 64
/* One change; returns the new count. `words` has room for count + MUTATE_ROOM. A gentle one often leaves a valid module valid. */
size_t mutate(uint32_t *words, size_t count, bool gentle, struct chance *chance);

#endif
