/* SPDX-License-Identifier: Apache-2.0 */
/* gate.html: the page for people. */
#ifndef GNOMON_CTS_GATE_HTML_H
#define GNOMON_CTS_GATE_HTML_H

#include <stdio.h>

#include "cts/gate.h"

void gn_gate_html(FILE *file, const struct gn_gate *gate);

#endif
