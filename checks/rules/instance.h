/* SPDX-License-Identifier: Apache-2.0 */
/* For engines: packs the small fields of an instance record (VkAccelerationStructureInstanceKHR and its like), and refuses what
 * does not fit. An index of more than 24 bits would otherwise change the mask, or lose its upper bits in silence. This
 * header stands alone, in C17 and C++. */
#ifndef GN_CHECKS_RULES_INSTANCE_H
#define GN_CHECKS_RULES_INSTANCE_H

#include <stdbool.h>
#include <stdint.h>

/* Writes the two words at byte 48 of the record: out_words[0] holds the custom index below the mask, out_words[1] the
 * shader-binding-table offset below the flags. custom_index and sbt_offset have at most 24 bits, mask and flags at most 8.
 * Returns false, and writes nothing, if one of them has more. */
static inline bool gn_instance_pack(uint32_t custom_index, uint32_t mask, uint32_t sbt_offset, uint32_t flags,
                                    uint32_t out_words[2])
{
    if (custom_index > 0xFFFFFFu || mask > 0xFFu || sbt_offset > 0xFFFFFFu || flags > 0xFFu)
        return false;
    out_words[0] = custom_index | mask << 24;
    out_words[1] = sbt_offset | flags << 24;
    return true;
}

#endif
