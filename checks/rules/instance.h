/* SPDX-License-Identifier: Apache-2.0 */
/* For engines: packs the small fields of an instance record (VkAccelerationStructureInstanceKHR and its like), refusing what does not
 * fit, and declares to Gnomon's Vulkan layer what the instances of a TLAS are meant to hold. An index of more than 24 bits would
 * otherwise change the mask, or lose its upper bits in silence, and memory does not show which was meant. This header stands alone, in C17
 * and C++. */
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

/* What the instances of one TLAS are meant to hold: the tag of the acceleration structure, set by vkSetDebugUtilsObjectTagEXT with this
 * tagName, the structure as pTag and its size as tagSize. It takes the place of the layer's settings of the same names for this TLAS. A
 * tag of another size is ignored, with a warning. */
#define GN_INSTANCE_TAG UINT64_C(0x676E6F6D6F6E3101) /* "gnomon1", then the version */
struct gn_instance_tag {
    uint64_t masks[4];           /* bit m % 64 of masks[m / 64]: mask m is in use; all 0: not declared */
    uint32_t custom_index_bound; /* every custom index is below; 0: not declared */
    uint32_t sbt_offset_bound;   /* the same of shader-binding-table offsets */
};

#endif
