/* SPDX-License-Identifier: Apache-2.0 */
/* The files that findings are written to. The JSON Lines log: One line per finding as soon as it is found, one line with the statement at the end. The count of a
 * finding is rewritten in place when it rises: its field is padded, which JSON allows. */
#ifndef GN_LAYER_LOG_H
#define GN_LAYER_LOG_H

#include <stddef.h>
#include <stdint.h>

#include "checks/rules/rules.h"

struct gn_log;

/* Opens the file anew, or joins it when this process writes it already (several instances). NULL with a sentence in
 * `problem` that names the setting when it cannot be written. */
struct gn_log *gn_log_open(const char *path, const char *setting, char *problem, size_t problem_size);
/* NULL is accepted. */
void gn_log_close(struct gn_log *log);
/* Returns where the count lies, for gn_log_recount; -1 if it cannot be rewritten (a pipe). */
int64_t gn_log_finding(struct gn_log *log, const struct gn_finding *finding, uint64_t count);
void gn_log_recount(struct gn_log *log, int64_t place, uint64_t count);
/* Writes one whole line; `text` is JSON without the newline. */
void gn_log_line(struct gn_log *log, const char *text, size_t size);

/* Writes `text` at the end, and `tail` after it: what is added later takes the place of the tail. Returns where the text lies; -1
 * if the file is no regular one. */
int64_t gn_log_insert(struct gn_log *log, const char *text, size_t size, const char *tail, size_t tail_size);

/* A growing text for JSON. Running out of memory is remembered, and the text is then not to be used. */
struct gn_text {
    char *data;
    size_t size, capacity;
    int failed;
};
void gn_text_finish(struct gn_text *text);
void gn_text_add(struct gn_text *text, const char *format, ...) __attribute__((format(printf, 2, 3)));
void gn_text_add_all(struct gn_text *text, const char *data, size_t size);
/* A quoted JSON string; bytes that are not UTF-8 become U+FFFD. */
void gn_text_add_string(struct gn_text *text, const char *string);

#endif
