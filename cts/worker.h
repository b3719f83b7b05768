/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Workers: processes of this program that open the driver and run cases one by one, so that whatever the
 * driver does to its process ends no run.
 *
 * The parent writes names of cases, a line each, to the worker's descriptor 3. The worker answers on
 * descriptor 4 with lines that begin with a letter and a blank: `R` and the device as JSON once it is open,
 * `U` and a message when it cannot be opened (and ends), `C` and a case's result as JSON, `B` and a measurement
 * (of GN_WORKER_BENCH and an item's name in the place of a case's) in C's %a, or `-` and what the device lacks for it, or
 * `!` and how the driver failed. What the driver
 * prints goes to a file in memory. A worker ends when descriptor 3 does, when its parent ends, and after a
 * case with the status error, whose device nobody should go on with.
 */
#ifndef GNOMON_CTS_WORKER_H
#define GNOMON_CTS_WORKER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#include "cts/case.h"
#include "cts/results.h"

#define GN_WORKER_BENCH "measure "

/* The command `worker`: ICD ("" for the loader's choice), seed, scale. Gives the exit status. */
int gn_worker_main(int argc, char **argv);

/*
 * GNOMON_TEST_FAULT makes a worker misbehave when it comes to a case, so that the tests of isolation meet the
 * real thing: "crash:NAME", "hang:NAME", "flood:NAME", "exit:NAME" or "lost:NAME", several parted by commas; "crash:NAME<OTHER"
 * only once OTHER has been run. The name "open" stands for the opening of the device. True for "lost".
 */
bool gn_worker_test_fault(const char *name);

/* The family's part of a case's own name, in the arena. */
const char *gn_case_family_name(const char *case_name, struct gn_arena *arena);

struct gn_process {
    pid_t pid;           /* 0: none */
    int to, from, noise; /* -1: none */
    char *buffer;
    size_t used, capacity;
};

/* Starts a worker in a process group of its own. False with a message when the system refuses. */
bool gn_process_start(struct gn_process *process, const char *icd, uint64_t seed, double scale,
                      char *out_error, size_t error_size);
/* Reads what is there. 1: something came, 0: the end, -1: nothing now. */
int gn_process_read(struct gn_process *process);
/* The next complete line, zero-terminated, without its newline; NULL when there is none. It stays until the
 * next call. */
char *gn_process_line(struct gn_process *process, size_t *inout_position, size_t *out_length);
/* Drops the lines taken so far. */
void gn_process_consume(struct gn_process *process, size_t position);
bool gn_process_send(struct gn_process *process, const char *name);
/* Forgets what was printed so far. */
void gn_process_noise_reset(struct gn_process *process);
/* Empties the file of what was printed when it has grown beyond reason: it lies in memory. */
void gn_process_noise_limit(struct gn_process *process);
/* The end of what was printed, cleaned, malloc'ed; "" when nothing was. NULL when memory is short. */
char *gn_process_noise(struct gn_process *process);
/* Lets the worker know that no case is left for it. */
void gn_process_end_input(struct gn_process *process);
/* Waits for its end (kills it where it does not come within two seconds) and gives the wait status; what it
 * printed can still be read. */
int gn_process_reap(struct gn_process *process);
/* Kills the group if asked, waits, closes everything. */
void gn_process_end(struct gn_process *process, bool kill_it);

#endif
