/* SPDX-License-Identifier: Apache-2.0 */
/* How far a run is, on stderr: one line that is updated on a terminal, a line every few seconds elsewhere. */
#ifndef GNOMON_CTS_PROGRESS_H
#define GNOMON_CTS_PROGRESS_H

#include "cts/results.h"

struct gn_progress {
    bool terminal, colour;
    size_t total, done, failed, leaked, other;
    double weight_total, weight_done; /* what the cases are expected to take, in any unit */
    uint64_t rays;
    double started, shown, rate_time;
    uint64_t rate_rays;
    double rate; /* rays per second, lately */
    const char *last;
};

/* Seconds of a clock that only goes forward. */
double gn_clock(void);
/* Whether text for this descriptor may be coloured: a terminal, no NO_COLOR, TERM not dumb. */
bool gn_terminal_colour(int fd);
/* Columns of the terminal, 80 when it does not say. */
int gn_terminal_width(int fd);

/* "1.43 M" and the like; "0.3 s", "1:05". `out` has 32 characters. */
const char *gn_format_count(double value, char out[32]);
const char *gn_format_duration(double seconds, char out[32]);

void gn_progress_init(struct gn_progress *progress, size_t total, double weight_total);
void gn_progress_case(struct gn_progress *progress, const struct gn_results_case *cs, double weight);
/* Shows where the run is if it is time; call it often. */
void gn_progress_tick(struct gn_progress *progress);
/* Prints a line of its own. */
void gn_progress_message(struct gn_progress *progress, const char *format, ...)
    __attribute__((format(printf, 2, 3)));
/* Clears the updating line. */
void gn_progress_finish(struct gn_progress *progress);

/* The end of a run, on stdout: verdict, numbers, failures with their replay commands, slowest cases,
 * report. */
void gn_summary_print(const struct gn_results *results, const char *out);

/* A path as a shell takes it, quoted where needed; malloc'ed. */
char *gn_shell_quote(const char *text);

#endif
