/* SPDX-License-Identifier: Apache-2.0 */
/* What a run has come to: the model that every report is written from, and its JSON. docs/results.md has the
 * format. */
#ifndef GNOMON_CTS_RESULTS_H
#define GNOMON_CTS_RESULTS_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "cts/arena.h"
#include "cts/case.h"

/* How a case's status compares with the expectation files. */
enum gn_results_outcome {
    GN_OUTCOME_AS_EXPECTED,      /* passed or skipped, with nothing else expected */
    GN_OUTCOME_EXPECTED_FAILURE, /* not passed, as an expectation file says: does not count */
    GN_OUTCOME_UNEXPECTED_PASS,  /* passed although an expectation file says otherwise: counts */
    GN_OUTCOME_UNEXPECTED,       /* anything else: counts */
};

/* One case. Strings are never NULL once gn_results_add() or the decoder gave them; they belong to the
 * arena. */
struct gn_results_case {
    const char *name; /* with the backend: "query.flags.cull_back" */
    const char *family;
    const char *spec;
    enum gn_case_status status;
    double seconds;
    uint64_t rays, ideal_hits;
    uint64_t class_counts[GN_REF_VERDICT_CLASS_COUNT];
    double hit_error_median, hit_error_p999, hit_error_max;
    uint64_t hit_error_bins[GN_CASE_ERROR_BINS]; /* as in gn_case_result */
    double margin_max;
    uint64_t answers; /* a digest of what the driver answered; 0 where it answered nothing */
    struct gn_case_curve curve; /* no points but for a sweep */
    const char *message;
    const char *output; /* the end of what the driver printed, for a case that did not pass */
    bool has_offender;
    struct gn_case_offender offender;
    const char *picture;                    /* below the output folder: "images/NAME.png", or "" */
    uint32_t picture_width, picture_height; /* rays */
    const char *rendered[GN_CASE_RENDERED]; /* as in gn_case_result; "" where there are none */
    const char *replay;                     /* below the output folder: "replay/NAME.json", or "" */
    uint32_t worker, position; /* the number of the process that ran it, from 1 (0: none did), and how many it had run before */
    enum gn_results_outcome outcome;
    const char *expected; /* the expectation file's status word, or "" */
    const char *expected_reason;
    const char *expected_place; /* "FILE:LINE" of the expectation, or "" */
    /* Only between a worker and its parent: one byte per ray, as in gn_case_result. */
    uint8_t *image;
};

/* What the run is, apart from its cases. Strings belong to the arena. */
struct gn_results_run {
    const char *version;
    const char *started; /* UTC, ISO 8601 */
    const char *driver;  /* the ICD file, or "" where the loader chose */
    const char *backend;
    const char *command;     /* what to type for this program: "./gnomon" */
    const char *options;     /* the options and filters as typed */
    const char *environment; /* variables that steer loader and driver, "NAME=value ..." */
    uint64_t seed;
    double scale;
    double timeout;
    uint32_t jobs;
    uint32_t shard, shard_count; /* 1-based; 1 of 1 without --shard */
    uint64_t selected;           /* cases that were to run */
    uint64_t suite;              /* gn_catalogue_digest() */
    uint64_t selection;          /* gn_catalogue_digest() of the cases that all shards have together */
    uint64_t durations;          /* a digest of the file that the shards were balanced by; 0 without */
    struct gn_device_info device;
};

struct gn_results {
    struct gn_arena arena;
    struct gn_results_run run;
    struct gn_results_case *cases; /* malloc'ed */
    size_t count, capacity;
    double seconds;
    const char *stopped;   /* why the run ended early, or "" */
    bool stopped_at_limit; /* it ended early because of --max-fails: failures, not the harness */
    const char **notes;    /* things worth saying that belong to no case; malloc'ed array of arena strings */
    size_t note_count;
    const char **stale; /* expectations that no longer hold, "FILE:LINE: why"; malloc'ed array */
    size_t stale_count;
};

void gn_results_init(struct gn_results *results);
void gn_results_finish(struct gn_results *results);

/* Adds a case, copying its strings into the arena (NULL becomes ""); `image` is not kept. Gives the copy,
 * which moves when the next one is added. */
struct gn_results_case *gn_results_add(struct gn_results *results, const struct gn_results_case *source);
void gn_results_note(struct gn_results *results, const char *format, ...)
    __attribute__((format(printf, 2, 3)));
void gn_results_add_stale(struct gn_results *results, const char *text);

struct gn_results_totals {
    uint64_t by_status[GN_CASE_STATUS_COUNT];
    uint64_t counting; /* cases that count as failures, unexpected passes included */
    uint64_t expected_failures;
    uint64_t unexpected_passes;
    uint64_t rays, ideal_hits;
    uint64_t class_counts[GN_REF_VERDICT_CLASS_COUNT];
    double hit_error_max;
    double case_seconds; /* the sum over the cases; more than the run's own with several workers */
};
struct gn_results_totals gn_results_totals(const struct gn_results *results);

/* Whether the status is one that counts without an expectation. */
bool gn_case_status_is_failure(enum gn_case_status status);
/* GN_CASE_STATUS_COUNT when the name is none. */
enum gn_case_status gn_case_status_of_name(const char *name);
/* deqp-runner's word for it: Pass, Fail, Skip, Crash, Timeout. */
const char *gn_case_status_deqp(enum gn_case_status status);
/* The name of a class as JSON has it: "double_hit". */
const char *gn_results_class_key(enum gn_ref_verdict_class cls);

/* The run in one sentence: "3 of 214 cases failed, 1 leaked; 208 passed, 2 were skipped." */
void gn_results_verdict(const struct gn_results *results, char *out, size_t size);
/* 0: as expected, 1: something counts, 4: nothing was judged, 3: it was stopped (but 1 at --max-fails). */
int gn_results_exit_status(const struct gn_results *results);

/* Sorted by name, for the reports; results.jsonl is in the order of completion. */
void gn_results_sort(struct gn_results *results);

/* Replaces what no report may hold (control characters, invalid UTF-8) by '?', in place. */
void gn_text_clean(char *text);

/*
 * JSON. An encoder gives one line without its newline, malloc'ed, or NULL when memory is short. A decoder
 * takes untrusted text: false with a message when it is not what the encoder writes.
 */
char *gn_results_case_encode(const struct gn_results_case *cs, size_t *out_length);
bool gn_results_case_decode(const char *text, size_t length, struct gn_arena *arena,
                            struct gn_results_case *out, char *out_error, size_t error_size);
/* In what two runs differ that must not if they are parts of one: "seed", or NULL. The driver's file is not looked at. */
const char *gn_results_run_difference(const struct gn_results_run *a, const struct gn_results_run *b);
char *gn_results_run_encode(const struct gn_results_run *run, size_t *out_length);
bool gn_results_run_decode(const char *text, size_t length, struct gn_arena *arena,
                           struct gn_results_run *out, char *out_error, size_t error_size);
char *gn_results_device_encode(const struct gn_device_info *info, size_t *out_length);
bool gn_results_device_decode(const char *text, size_t length, struct gn_device_info *out, char *out_error,
                              size_t error_size);
char *gn_results_summary_encode(const struct gn_results *results, size_t *out_length);

/* The replay file of a case, as JSON text. `index` is the offender's trace and ray, taken from the case. */
struct gn_replay {
    const char *name;
    const char *driver;
    const char *device;
    uint64_t seed;
    double scale;
    int64_t trace, ray; /* -1: the whole case */
    const char *status;
    const char *message;
};
char *gn_replay_encode(const struct gn_replay *replay, size_t *out_length);
bool gn_replay_decode(const char *text, size_t length, struct gn_arena *arena, struct gn_replay *out,
                      char *out_error, size_t error_size);

/*
 * Files. All give false with a message that names the file and the system's reason.
 */

/* Makes the folder and the ones above it. */
bool gn_folder_create(const char *path, char *out_error, size_t error_size);
/* Writes all of it to a temporary name beside it, then renames: the file is the old or the new one, whole, with the old one's mode. */
bool gn_file_write(const char *path, const void *data, size_t length, char *out_error, size_t error_size);
/* The same of what an open_memstream() of `text` and `length` holds; closes the stream and frees the text. */
bool gn_file_write_stream(const char *path, FILE *stream, char **text, const size_t *length, char *out_error, size_t error_size);
/* malloc'ed and zero-terminated. Files above `limit` bytes are refused. */
bool gn_file_read(const char *path, size_t limit, char **out_data, size_t *out_length, char *out_error,
                  size_t error_size);

/* results.csv: deqp-runner's name,status,duration. */
bool gn_results_csv_write(const struct gn_results *results, const char *path, char *out_error,
                          size_t error_size);
/* junit.xml. */
bool gn_results_junit_write(const struct gn_results *results, const char *path, char *out_error,
                            size_t error_size);
/* report.html; pictures are taken from the folder `out`. */
bool gn_results_html_write(const struct gn_results *results, const char *out, const char *path,
                           char *out_error, size_t error_size);

/*
 * Reads the case lines of a results.jsonl, complete or torn off (a last line without its newline is dropped,
 * and so is the summary). A file that does not exist gives no case.
 */
bool gn_results_jsonl_read(struct gn_results *results, const char *path, char *out_error, size_t error_size);

/* The picture of a case as a PNG, malloc'ed; NULL when memory is short. Colours: gn_picture_colour(). */
uint8_t *gn_picture_png(const uint8_t *image, uint32_t width, uint32_t height, size_t *out_length);
/* 0xRRGGBB of a byte of the image. */
uint32_t gn_picture_colour(uint8_t value);

const char *gn_version(void);

#endif
