/* SPDX-License-Identifier: Apache-2.0 */
/* The order of measured values, and the one in their middle. */
#ifndef GNOMON_CTS_STATISTICS_H
#define GNOMON_CTS_STATISTICS_H

#include <stdint.h>

/* For qsort() of doubles, none of which is NaN. */
int gn_doubles_compare(const void *a, const void *b);
/* Sorts the values, of which there is one at least; of an even number of them the upper of the two in the middle. */
double gn_median(double *values, uint32_t count);

#endif
