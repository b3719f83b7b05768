/* SPDX-License-Identifier: Apache-2.0 */
/* The order of measured values, and the one in their middle. */
#include "cts/statistics.h"

#include <stdlib.h>

int gn_doubles_compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

double gn_median(double *values, uint32_t count)
{
    qsort(values, count, sizeof *values, gn_doubles_compare);
    return values[count / 2];
}
