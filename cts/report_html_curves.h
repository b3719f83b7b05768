/* SPDX-License-Identifier: Apache-2.0 */
/* The curves of sweeps in report.html. */
#ifndef GNOMON_CTS_REPORT_HTML_CURVES_H
#define GNOMON_CTS_REPORT_HTML_CURVES_H

#include <stdio.h>

#include "cts/results.h"

/* One sweep's curve as a figure, inline SVG, with a caption that says where the answers leave the bound. Nothing
 * for a case that is no sweep. */
void gn_html_curve(FILE *file, const struct gn_case_curve *curve);

/* A section with the curves of all sweeps, or nothing where there is none. */
void gn_html_curves(FILE *file, const struct gn_results *results);

#endif
