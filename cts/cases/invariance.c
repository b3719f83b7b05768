/* SPDX-License-Identifier: Apache-2.0 */
/*
 * How a structure was built, updated or copied changes no answer: every valid set of build flags (fast trace excludes
 * fast build), each with everything that may be done to a structure of that set.
 */
#include "cts/sample.h"

#define SPEC                                                                                                 \
    "build flags trade build time, trace time and memory; they change no result, nor do updates and copies (Vulkan: " \
    "VkBuildAccelerationStructureFlagBitsKHR; Copying Acceleration Structures)"

#define UPDATE VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR
#define COMPACTION VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR
#define TRACE VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR
#define BUILD VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_BUILD_BIT_KHR
#define MEMORY VK_BUILD_ACCELERATION_STRUCTURE_LOW_MEMORY_BIT_KHR
#define REFIT GN_CTS_STEP_REFIT
#define REFIT_COPY GN_CTS_STEP_REFIT_COPY
#define REBUILD GN_CTS_STEP_REBUILD
#define COMPACT GN_CTS_STEP_COMPACT
#define CLONE GN_CTS_STEP_CLONE
#define SERIALIZE GN_CTS_STEP_SERIALIZE

static void invariance(struct gn_case_run *run, const struct gn_case *self)
{
    gn_sample_trace(run, self->params);
}

#define CASE(set, label, bits, ...)                                                                          \
    {                                                                                                        \
        "invariance." set "." label, SPEC, invariance,                                                       \
            &(const struct gn_sample_options){.content = GN_SAMPLE_MIXED, .flags = bits, .steps = {__VA_ARGS__}}, 0 \
    }
#define ANY(set, bits)                                                                                       \
    CASE(set, "built", bits, 0), CASE(set, "rebuilt", bits, REBUILD), CASE(set, "cloned", bits, CLONE),       \
        CASE(set, "serialized", bits, SERIALIZE)
#define UPDATED(set, bits)                                                                                   \
    CASE(set, "refit", bits, REFIT), CASE(set, "refit_copy", bits, REFIT_COPY),                               \
        CASE(set, "refit_chain", bits, REFIT, REFIT_COPY, REFIT, REFIT),                                      \
        CASE(set, "refit_cloned", bits, REFIT, CLONE), CASE(set, "cloned_refit", bits, CLONE, REFIT)
#define COMPACTED(set, bits)                                                                                 \
    CASE(set, "compacted", bits, COMPACT), CASE(set, "compacted_cloned", bits, COMPACT, CLONE)
/* The four sets that differ in what is allowed. */
#define SETS(name, bits)                                                                                     \
    ANY(name, bits), ANY(name "_update", (bits) | UPDATE), UPDATED(name "_update", (bits) | UPDATE),          \
        ANY(name "_compaction", (bits) | COMPACTION), COMPACTED(name "_compaction", (bits) | COMPACTION),     \
        ANY(name "_update_compaction", (bits) | UPDATE | COMPACTION),                                         \
        UPDATED(name "_update_compaction", (bits) | UPDATE | COMPACTION),                                     \
        COMPACTED(name "_update_compaction", (bits) | UPDATE | COMPACTION),                                   \
        CASE(name "_update_compaction", "refit_compacted", (bits) | UPDATE | COMPACTION, REFIT, COMPACT),     \
        CASE(name "_update_compaction", "compacted_refit", (bits) | UPDATE | COMPACTION, COMPACT, REFIT)

static const struct gn_case cases[] = {
    SETS("plain", 0),
    SETS("fast_trace", TRACE),
    SETS("fast_build", BUILD),
    SETS("low_memory", MEMORY),
    SETS("fast_trace_low_memory", TRACE | MEMORY),
    SETS("fast_build_low_memory", BUILD | MEMORY),
};
const struct gn_case_family gn_family_invariance = {"invariance", cases, sizeof cases / sizeof cases[0]};
