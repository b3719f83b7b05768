/* SPDX-License-Identifier: Apache-2.0 */
/* Rays, answers and ideal answers in words and rows, for the console and the report. */
#ifndef GNOMON_CTS_DESCRIBE_H
#define GNOMON_CTS_DESCRIBE_H

#include <stddef.h>

#include "cts/case.h"

/* "cull back facing, skip AABBs" or "none". Each gives `out`. */
const char *gn_describe_ray_flags(uint32_t flags, char *out, size_t size);
const char *gn_describe_answer(const struct gn_ref_answer *answer, char *out, size_t size);
/* What would have been right. */
const char *gn_describe_ideal(const struct gn_ref_verdict *verdict, char *out, size_t size);

/* The two answers side by side: a row per value. */
struct gn_answer_row {
    const char *label;
    char answer[48], ideal[48];
    bool differs; /* of what has no tolerance: kind and ids */
};
#define GN_ANSWER_ROWS 8
size_t gn_describe_rows(const struct gn_ref_verdict *verdict, const struct gn_ref_answer *answer,
                        struct gn_answer_row out[GN_ANSWER_ROWS]);

/* "1,234,567". `out` has 32 characters. */
const char *gn_format_grouped(uint64_t value, char out[32]);

#endif
