/* SPDX-License-Identifier: Apache-2.0 */
/* Pieces of report.html: escaped text, bars, the page's style and script. */
#ifndef GNOMON_CTS_REPORT_HTML_PARTS_H
#define GNOMON_CTS_REPORT_HTML_PARTS_H

#include <stdio.h>

#include "cts/results.h"

extern const char gn_html_style[];
extern const char gn_html_script[];

/* Text as an element's or attribute's content. Every string that is not of this program's own goes through
 * here. */
void gn_html_text(FILE *file, const char *text);

/* Base64 of bytes, as data URLs have it: the characters that it takes, and the text with its zero. */
size_t gn_base64_length(size_t length);
void gn_base64(const uint8_t *data, size_t length, char *out);

/* The classes of rays as a stacked bar, inline SVG. A class that is there at all is at least a sliver. */
void gn_html_class_bar(FILE *file, const uint64_t counts[GN_REF_VERDICT_CLASS_COUNT]);
/* A swatch and the class's name. */
void gn_html_class_key(FILE *file, enum gn_ref_verdict_class cls);

/* Median, 99.9th percentile and maximum of hit errors on a logarithmic scale, with the bound as a line.
 * `wrong`: there are wrong answers among them; without, a maximum beyond the bound is that of an
 * ill-conditioned hit. */
void gn_html_error_bar(FILE *file, double median, double p999, double max, double bound, bool wrong);

/* <img> of a PNG file, inlined, enlarged by a whole factor. False when the file cannot be read. */
bool gn_html_picture(FILE *file, const char *folder, const struct gn_results_case *cs);

#endif
