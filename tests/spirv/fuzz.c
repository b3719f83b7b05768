/* SPDX-License-Identifier: Apache-2.0 */
/* spirv_fuzz COUNT [SEED [FIRST]]: instruments COUNT changed modules of the corpus, as the numbers FIRST, FIRST + 1, ... of a seed. It
 * ends with status 1 when one took longer than a second, had no reason for what it became, or was valid before and not
 * afterwards. A crash is told by the last number printed; built with --preset asan, so is a leak. A number stands for the same
 * module only as long as the corpus has the same shaders. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "tests/spirv/modules.h"
#include "tests/spirv/mutate.h"
#include "tests/spirv/trial.h"

int main(int argc, char **argv)
{
    if (argc < 2) {
        fprintf(stderr, "usage: %s COUNT [SEED [FIRST]]\n", argv[0]);
        return 2;
    }
    unsigned long long count = strtoull(argv[1], NULL, 10), seed = argc > 2 ? strtoull(argv[2], NULL, 10) : 1;
    unsigned long long first = argc > 3 ? strtoull(argv[3], NULL, 10) : 0;
    struct trials *trials = trials_create();
    struct timespec start, now;
    clock_gettime(CLOCK_MONOTONIC, &start);
    for (unsigned long long n = first; n < first + count; n++) {
        if (n % 1000 == 0) {
            clock_gettime(CLOCK_MONOTONIC, &now);
            printf("%llu after %ld s\n", n, (long)(now.tv_sec - start.tv_sec));
            fflush(stdout);
        }
        trials_run(trials, seed, n);
    }
    trials_print(trials);
    unsigned failures = trials_destroy(trials);
    printf("%llu modules, %u failures\n", count, failures);
    return failures ? 1 : 0;
}
