/* SPDX-License-Identifier: Apache-2.0 */
/* Whether the suite notices faults: it is run on a driver that a layer (tests/faulty) makes wrong in one way at a time. */
#ifndef GNOMON_CTS_SELFTEST_H
#define GNOMON_CTS_SELFTEST_H

#include "cts/run_options.h"

/*
 * Runs the plan once without a fault, then with each whose name matches the pattern a sample of it (some cases of each
 * family) and, where that notices nothing, the whole; with a fiftieth of the rays. What is worse with the fault than without
 * has caught it. Prints each fault with the families that caught it, then
 * each family with what it alone caught, then `N passed, M failed`. Every run leaves its reports in OUT/FAULT.
 * Exit status 0 when every fault was caught, 1 when one was not, 2 when no fault matches or the layer is not there.
 */
int gn_selftest_run(const struct gn_run_options *options, const struct gn_run_plan *plan, const char *driver,
                    const char *pattern);

#endif
