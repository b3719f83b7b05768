/* SPDX-License-Identifier: Apache-2.0 */
/* Finds misuse of ray queries and of traces in SPIR-V: what is wrong on every path is reported from the module alone, what may be
 * wrong gets a check that runs on the device and writes a record at the operation (records.h).
 *
 * No Vulkan call, no I/O, no state between calls: every function may be called from any thread. Any sequence of words is
 * valid input; what is not a module, or not one that can be rewritten, comes back unchanged with the reason. */
#ifndef GN_CHECKS_SPIRV_SPIRV_H
#define GN_CHECKS_SPIRV_SPIRV_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "checks/rules/rules.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Changes whenever the words written for the same input and options change: part of the key of any cache. */
#define GN_SPIRV_VERSION 8

enum gn_spirv_rule_index {
#define GN_SPIRV_RULE(name) GN_SPIRV_RULE_##name,
#include "checks/spirv/rules.def"
#undef GN_SPIRV_RULE
    GN_SPIRV_RULE_COUNT
};

/* One rule about shaders; the fields are those of struct gn_rule. */
struct gn_spirv_rule {
    const char *id;
    const char *title;
    const char *text;
    const char *remedy;
    const char *sources[GN_RULE_MAX_SOURCES + 1];
    enum gn_severity severity[GN_PROFILE_COUNT];
};

/* NULL when out of range. */
const struct gn_spirv_rule *gn_spirv_rule_at(enum gn_spirv_rule_index index);

struct gn_spirv_options {
    enum gn_profile profile; /* rules that are silent in it are not evaluated */
    bool static_only;        /* judge, but write no instrumented module */
    bool without_proofs;     /* check at run time even what the flow analysis proves right; to measure what proofs save */
    bool safe;               /* skip an operation that would be undefined: its result is 0, a ray becomes one that hits nothing */
    bool without_validation; /* trust the module to be valid SPIR-V, which spares SPIRV-Tools' validation */
    uint64_t disabled;       /* a bit per rule that is not to be evaluated */
    uint32_t set, binding;   /* of the storage buffer that records go to, unless `root` says otherwise */
    uint64_t root, key;      /* the device address of a table of buffers, 0 for none, and the module's key in it (records.h) */
    uint64_t structures;     /* the device address of the table of structures, 0 for none: their rules, and whether vertex positions may be read,
                                are not judged then. What its words say stands in records.h; bits that nobody sets accuse nobody */
    uint32_t proceed_limit;  /* report a query that calls Proceed more often since its initialization; 0: never */

    /* Of the ray-tracing pipeline that the module is for. What is not known is not judged. */
    bool recursion_known;
    uint32_t max_recursion;       /* maxPipelineRayRecursionDepth */
    uint32_t max_payload;         /* maxPipelineRayPayloadSize in bytes; 0 for unknown */
    uint32_t max_attribute;       /* maxPipelineRayHitAttributeSize in bytes; 0 for unknown */
    uint32_t forbidden_ray_flags; /* SkipTriangles for a pipeline that skips AABBs, SkipAABBs for one that skips triangles */
};

enum gn_spirv_status {
    GN_SPIRV_INSTRUMENTED,  /* result.words is a new module */
    GN_SPIRV_UNTOUCHED,     /* nothing needs a check at run time, or only a static judgement was asked for */
    GN_SPIRV_DECLINED,      /* valid as far as is known, but of a shape that cannot be instrumented */
    GN_SPIRV_INVALID,       /* not valid SPIR-V */
    GN_SPIRV_OUT_OF_MEMORY,
};

/* "instrumented", "untouched", "declined", "invalid", "out of memory" */
const char *gn_spirv_status_name(enum gn_spirv_status status);

/* Where an instruction is. Offsets are in words from the start of the original module. Strings belong to the result;
 * `file` and `source` (the line's text) are NULL where the module does not say. `line` is 0 then. */
struct gn_spirv_place {
    const char *function;
    uint32_t function_id, block_id, offset;
    const char *file, *source;
    uint32_t line, column;
};

/* Misuse that the module alone proves: the operation is wrong whenever it is reached. */
struct gn_spirv_finding {
    enum gn_spirv_rule_index rule;
    enum gn_severity severity;
    uint32_t site;
    const char *message;
};

/* One operation on a ray query, or a trace, report or call of a ray-tracing pipeline. `checked` and `wrong` have a bit per rule: those with a check at run time and those proved
 * to be broken (which are checked as well, to learn whether they run). What `judged` has beyond these is proved right. */
struct gn_spirv_site {
    struct gn_spirv_place place;
    const char *operation;   /* "OpRayQueryProceedKHR" */
    const char *query;       /* the query's debug name, or NULL */
    uint32_t query_id;       /* the variable or parameter that holds it; 0 for an operation without a query */
    uint64_t judged, checked, wrong;
    uint32_t first_check;    /* index of the first check, in the order of the bits of `checked` */
};

struct gn_spirv_result {
    enum gn_spirv_status status;
    char message[512];       /* why, unless INSTRUMENTED */
    uint32_t *words;         /* only if INSTRUMENTED */
    size_t word_count;
    struct gn_spirv_site *sites;
    uint32_t site_count;
    struct gn_spirv_finding *findings;
    uint32_t finding_count;
    uint32_t check_count;    /* checks at run time: slots of the record buffer */
    void *storage;           /* what the strings live in */
};

/*
 * Analyses and, unless told otherwise, instruments. `words` may be anything; word_count counts words. NULL options are all
 * defaults. The result is always filled and has to be given to gn_spirv_result_finish().
 * The same input, options and version give the same words.
 */
void gn_spirv_instrument(const uint32_t *words, size_t word_count, const struct gn_spirv_options *options,
                         struct gn_spirv_result *out);
void gn_spirv_result_finish(struct gn_spirv_result *result);

/* A result as bytes (malloc'ed; NULL without memory), and back: false for bytes that another version, or nobody, wrote. The bytes of a
 * result of the same words, options and version can stand for it. */
unsigned char *gn_spirv_result_write(const struct gn_spirv_result *result, size_t *out_size);
bool gn_spirv_result_read(const unsigned char *data, size_t size, struct gn_spirv_result *out);

/* Whether SPIRV-Tools finds a module valid under Vulkan 1.2 (vulkan_minor 2), 1.3 (3), or as SPIR-V alone (0); the reason if
 * not. */
bool gn_spirv_validate(const uint32_t *words, size_t word_count, uint32_t vulkan_minor, char *out_message,
                       size_t message_size);

/* Whether a module has anything to judge, ray queries or traces: one pass over the words, no allocation. False for what is no
 * module. */
bool gn_spirv_has_queries(const uint32_t *words, size_t word_count);

/* The site and rule of a check (its index in the record buffer); false when out of range. */
bool gn_spirv_check_find(const struct gn_spirv_result *result, uint32_t check, uint32_t *out_site,
                         enum gn_spirv_rule_index *out_rule);

/* Reads and writes the module through the model of this library: for tests that the model loses nothing. The words are
 * malloc'ed; NULL with a message when the input is no module. */
uint32_t *gn_spirv_round_trip(const uint32_t *words, size_t word_count, size_t *out_count, char *out_message,
                              size_t message_size);

#ifdef __cplusplus
}
#endif
#endif
