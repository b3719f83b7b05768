/* SPDX-License-Identifier: Apache-2.0 */
/* The output folder of a run: run.json, results.jsonl line by line, pictures, replay files, and the reports
 * at the end. */
#ifndef GNOMON_CTS_OUTPUT_H
#define GNOMON_CTS_OUTPUT_H

#include "cts/results.h"

struct gn_output {
    const char *folder;
    int fd;         /* results.jsonl; 0: none */
    int lock;       /* the folder, locked as long as it is open; 0: none */
    int64_t length; /* of its whole lines */
};

/* Locks a folder until the descriptor is closed (0: it cannot be locked, and is not). False with a message: another has it. */
bool gn_folder_lock(const char *folder, int *out_lock, char *out_error, size_t error_size);

/*
 * Makes the folder and opens results.jsonl in it, whose cases (of an earlier run) are given; nothing is
 * erased yet. False with a message and an exit status: 2 for a folder that cannot be written or is in use, 3
 * else.
 */
bool gn_output_open(struct gn_output *output, const char *folder, struct gn_results *out_earlier,
                    int *out_exit_status, char *out_error, size_t error_size);

/*
 * Begins the results. With `resume` the earlier cases are added to `results`, if the earlier run was the same
 * in what matters (program, device, driver, backend, seed, scale): otherwise false with exit status 2.
 * Without it, the reports of the earlier run are removed.
 */
bool gn_output_begin(struct gn_output *output, struct gn_results *results, bool resume, int *out_exit_status,
                     char *out_error, size_t error_size);

/* Writes a case's line, and its picture and replay file when it did not pass; sets cs->picture and cs->replay
 * to text in memory that stays until the next call. A line is written whole or not at all. */
bool gn_output_case(struct gn_output *output, const struct gn_results_run *run, struct gn_results_case *cs,
                    char *out_error, size_t error_size);

/* Takes a case over from another run's folder: its line, its picture and replay file. */
bool gn_output_take(struct gn_output *output, const char *from, const struct gn_results_case *cs, char *out_error,
                    size_t error_size);

/* The summary line and the other reports. As many as possible are written; false when one could not be. */
bool gn_output_end(struct gn_output *output, const struct gn_results *results, char *out_error,
                   size_t error_size);
void gn_output_close(struct gn_output *output);

#endif
