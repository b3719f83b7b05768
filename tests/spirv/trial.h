/* SPDX-License-Identifier: Apache-2.0 */
/* One changed module through the library, and what has to hold of the outcome. */
#ifndef GN_TESTS_SPIRV_TRIAL_H
#define GN_TESTS_SPIRV_TRIAL_H

#include <stdint.h>

struct trials;

struct trials *trials_create(void);
/* The outcome depends on the seed and the number alone. Says on stderr what went wrong. */
void trials_run(struct trials *trials, uint64_t seed, uint64_t number);
/* How many became what, and the slowest. */
void trials_print(const struct trials *trials);
/* How many of the trials so far wrote a module, or refused one as invalid. */
uint32_t trials_instrumented(const struct trials *trials);
uint32_t trials_invalid(const struct trials *trials);
/* Returns the number of failures. */
uint32_t trials_destroy(struct trials *trials);

#endif
