/* SPDX-License-Identifier: Apache-2.0 */
/* The rewriting of a module that has been analysed. Internal to checks/spirv. */
#ifndef GN_CHECKS_SPIRV_INSTRUMENT_H
#define GN_CHECKS_SPIRV_INSTRUMENT_H

#include "checks/spirv/analysis.h"

/* Fills out->words and out->word_count; DECLINED with a message when some shape cannot be rewritten. */
enum gn_spirv_status rewrite_module(struct analysis *analysis, struct gn_spirv_result *out);

#endif
