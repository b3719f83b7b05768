/* SPDX-License-Identifier: Apache-2.0 */
/* Runs a test shader on a real driver, on a scene of one triangle (t = 1 on the test's ray) and one box (t from 2 to 3), with
 * a record buffer in set 1. Every function that cannot do its work fails the test. */
#ifndef GN_TESTS_SPIRV_DEVICE_H
#define GN_TESTS_SPIRV_DEVICE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define LANES 8 /* invocations of one run */
#define RECORD_SET 1

struct tracer;

/* What the shader is told, see shaders/query.glsl. */
struct choices {
    uint32_t choice;
    float value;
    uint32_t lane;
};

struct tracer *tracer_create(void);
void tracer_destroy(struct tracer *tracer);
/* One workgroup. `records` may be NULL for a module that writes none; else it is given to the shader and read back. */
void tracer_run(struct tracer *tracer, const uint32_t *words, size_t word_count, const struct choices *choices,
                float out[LANES], uint32_t *records, size_t record_words);

#endif
