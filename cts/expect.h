/* SPDX-License-Identifier: Apache-2.0 */
/* Expectation files: what is known of a driver, in the formats of deqp-runner. docs/gating.md describes them. */
#ifndef GNOMON_CTS_EXPECT_H
#define GNOMON_CTS_EXPECT_H

#include "cts/results.h"
#include "cts/select.h"

enum gn_expectation_kind {
    GN_EXPECT_STATUS, /* fails in this way */
    GN_EXPECT_FLAKE,  /* may fail; runs, and never decides */
    GN_EXPECT_SKIP,   /* is not run */
};

/* One line of a file. Strings belong to the arena and are never NULL. */
struct gn_expectation {
    enum gn_expectation_kind kind;
    const char *name;   /* of a case; of flakes and skips also an extended regular expression */
    const char *status; /* deqp-runner's word, of GN_EXPECT_STATUS only */
    const char *reason; /* the comments above it or behind it */
    const char *bug;    /* from a comment `bug: URL`, or "" */
    const char *expires; /* YYYY-MM-DD from a comment `expires:`, or "": the last day on which it holds */
    const char *place;  /* "FILE:LINE" */
    bool expired;
    void *regex; /* regex_t, where the name is a regular expression; owned */
};

struct gn_expectations {
    struct gn_expectation *list; /* malloc'ed */
    size_t count;
    char today[11];     /* YYYY-MM-DD; filled by the first file read if it is empty */
    const char *device; /* gn_expectations_device() of the device that the files are of, or NULL */
    const char *device_place;
};

/*
 * Adds a file's lines. A file whose name ends in -flakes.txt or -skips.txt has a name per line, any other one
 * `name,Status`. False with a message that names the line on anything else but comments, on a name that the file has
 * twice or that an earlier one has with another status, and on a file of another device than an earlier one.
 */
bool gn_expectations_read(struct gn_expectations *expectations, const char *path, struct gn_arena *arena,
                          char *out_error, size_t error_size);
void gn_expectations_finish(struct gn_expectations *expectations);

/* The entry of that kind that the case falls under and that has not expired; the last one decides. */
const struct gn_expectation *gn_expectations_find(const struct gn_expectations *expectations,
                                                  enum gn_expectation_kind kind, const char *name);

/* Sets outcome, expected, expected_reason and expected_place. */
void gn_expectations_apply(const struct gn_expectations *expectations, struct gn_results_case *cs);

/* Records what is stale: entries that name no case of the catalogue, and those that have expired. */
void gn_expectations_check(const struct gn_expectations *expectations, const struct gn_selected *catalogue,
                           size_t count, struct gn_results *results);

/*
 * How a file names a device, in the arena: vendor and device id and the driver's name, "0x10005:0x0000 llvmpipe", which
 * stay the same from one version of a driver to the next.
 */
const char *gn_expectations_device(const struct gn_device_info *info, struct gn_arena *arena);
/* Whether the files are of that device, or of none in particular; false with a message. */
bool gn_expectations_fit(const struct gn_expectations *expectations, const struct gn_device_info *info, char *out_error,
                         size_t error_size);

/* Where the text of a file begins: behind the mark of UTF-8 that some editors put first. */
char *gn_expectations_text(char *data);

/* Whether a comment, given from behind its #, says which device the file is of. */
bool gn_expectations_is_device(const char *comment);

/*
 * Rewrites a file of GN_EXPECT_STATUS, or makes one, so that it says what came out: entries of cases that pass or do not exist go, with
 * the comments that served only them; statuses become the ones found; new failures are added at the end with
 * the first sentence of their message. Entries of cases that did not run stay, and so does everything else a person wrote, what stands above
 * the line of the device and dates of expiry included.
 * Counts of entries added, changed and removed are given.
 */
struct gn_expectations_changes {
    size_t added, changed, removed;
};
bool gn_expectations_update(const char *path, const struct gn_expectations *expectations,
                            const struct gn_results *results, const struct gn_selected *catalogue,
                            size_t catalogue_count, struct gn_expectations_changes *out_changes, char *out_error,
                            size_t error_size);

#endif
