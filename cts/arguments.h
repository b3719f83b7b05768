/* SPDX-License-Identifier: Apache-2.0 */
/* Values of options that several commands take. */
#ifndef GNOMON_CTS_ARGUMENTS_H
#define GNOMON_CTS_ARGUMENTS_H

#include <argp.h>
#include <stdint.h>

/* The whole number in `text`, decimal, octal or hexadecimal as C writes them. Outside of [least, most], or anything
 * else, ends the program by argp_error() with a message that names the option. */
uint64_t gn_argument_number(struct argp_state *state, const char *option, const char *text, uint64_t least,
                            uint64_t most);

#endif
