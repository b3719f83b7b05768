/* SPDX-License-Identifier: Apache-2.0 */
/* The test shaders as modules, in every form that they are compiled to. */
#ifndef GN_TESTS_SPIRV_MODULES_H
#define GN_TESTS_SPIRV_MODULES_H

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "checks/spirv/spirv.h"

#define FORM_COUNT 4
extern const char *const form_names[FORM_COUNT]; /* "line", "debug", "plain", "optimized" */

/* A module, malloc'ed; NULL when there is no such file. */
uint32_t *module_read(const char *path, size_t *out_count);
/* A shader, named by its file ("closest_good.comp"), as words, malloc'ed. Fails the test when it is not there. */
uint32_t *module_load(const char *form, const char *name, size_t *out_count);
/* The files of all shaders, sorted; at most `capacity`. */
uint32_t modules_list(char (*out)[64], uint32_t capacity);

/* The id of a rule, without "query." */
const char *rule_name(enum gn_spirv_rule_index rule);
/* What was found, as text: "rule!line" proved wrong, "rule?line" left to the device, in the order of the operations and
 * separated by spaces. Without lines when `lines` is false. */
void result_text(const struct gn_spirv_result *result, bool lines, char *out, size_t size);

#endif
