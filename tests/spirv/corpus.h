/* SPDX-License-Identifier: Apache-2.0 */
/* A test shader and what its own comments say is to be found in it: adding a shader to shaders/ is all that a new test needs.
 *
 *   //! why: one sentence                  what the shader is about
 *   //! clauses: NG-031 VUID-...           what it is evidence for
 *   //! options: profile=wgpu limit=4      see options_parse(); the default is none. With structures=9 the rules about structures are judged,
 *                                          and that is what the table says of the scene (tracer_structures())
 *   //! run: choice=1 value=nan lane=5 -> initialize.nan*1 proceed.limit*8
 *                                          one run on the device: what the shader is told, and which rules fire how often over
 *                                          all invocations. Nothing behind the arrow: it stays silent, and computes what
 *                                          the original does
 *   //! run: not                           the test's driver cannot; compiled, judged and validated only
 *   //! twin: file                         the same without the mistake, silent in all of its runs. A shader that fires and
 *                                          has no silent run of its own names one
 *   //~ rule! rule?                        at the end of a line: found in its operation, proved wrong or left to the device
 *
 * In assembly the comments start with ";". Rules are named without "query.". Shaders of a ray-tracing or graphics pipeline share a name
 * (reflect.rgen, reflect.rchit); the one that comes first in the order of stage_of() has the runs. */
#ifndef GN_TESTS_SPIRV_CORPUS_H
#define GN_TESTS_SPIRV_CORPUS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "checks/spirv/spirv.h"
#include "tests/spirv/device.h"

#define MAX_SHADERS 512
#define MAX_MARKS 48
#define MAX_RUNS 12
#define MAX_FIRINGS 12

struct mark {
    uint32_t line;
    enum gn_spirv_rule_index rule;
    bool wrong; /* proved, else left to the device */
};

struct firing {
    enum gn_spirv_rule_index rule;
    uint32_t count;
};

struct run {
    struct choices choices;
    struct firing firings[MAX_FIRINGS];
    uint32_t firing_count;
};

struct shader {
    char file[64];
    VkShaderStageFlagBits stage;
    bool assembly;
    char why[200], clauses[200], twin[64];
    struct gn_spirv_options options;
    uint32_t callables, structures;
    bool asks_structures;
    struct mark marks[MAX_MARKS];
    struct run runs[MAX_RUNS];
    uint32_t mark_count, run_count;
    bool never_run;
};

/* Reads every shader, sorted by file. A comment that cannot be read fails the test. */
struct shader *corpus_read(uint32_t *out_count);
const struct shader *corpus_find(const struct shader *shaders, uint32_t count, const char *file);
/* Whether it is wrong in some run or on every path; and whether some run stays silent. */
bool corpus_fires(const struct shader *shader);
bool corpus_silent(const struct shader *shader);
/* The line that each site of a judged module is on: from the module, or for assembly by the order of the operations in the file. */
void corpus_lines(const struct shader *shader, const struct gn_spirv_result *result, uint32_t *out_lines);

#endif
