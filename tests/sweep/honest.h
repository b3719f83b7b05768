/* SPDX-License-Identifier: Apache-2.0 */
/* A plain implementation in f32, as the derivation of the bound has it: what a driver must at least manage. */
#ifndef GNOMON_TESTS_SWEEP_HONEST_H
#define GNOMON_TESTS_SWEEP_HONEST_H

#include "cts/sweep.h"

/* Answers all rays of a scene by trying every primitive, and has the answers judged. */
void honest_tracer(struct gn_case_run *run, const struct gn_sweep_scene *scene, void *user);

#endif
