/* SPDX-License-Identifier: Apache-2.0 */
/* Values of options that several commands take. */
#include "cts/arguments.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

uint64_t gn_argument_number(struct argp_state *state, const char *option, const char *text, uint64_t least,
                            uint64_t most)
{
    char *end;
    errno = 0;
    unsigned long long value = strtoull(text, &end, 0);
    if (end == text || *end || errno || strchr(text, '-') || value < least || value > most)
        argp_error(state, "%s: expected a whole number from %llu to %llu, found '%s'", option,
                   (unsigned long long)least, (unsigned long long)most, text);
    return value;
}
