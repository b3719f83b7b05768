/* SPDX-License-Identifier: Apache-2.0 */
/* Findings as SARIF 2.1.0, for code scanning. The file is one whole document after every finding. */
#ifndef GN_LAYER_SARIF_H
#define GN_LAYER_SARIF_H

#include <stddef.h>
#include <stdint.h>

#include "checks/rules/rules.h"

struct gn_sarif;

/* Opens the file anew, or joins it when this process writes it already: several instances share one run. NULL with a sentence in `problem` when it cannot be written. */
struct gn_sarif *gn_sarif_open(const char *path, enum gn_profile profile, char *problem, size_t problem_size);
/* One result. Returns where its count lies, for gn_sarif_recount; -1 if it was not written. */
int64_t gn_sarif_finding(struct gn_sarif *sarif, const struct gn_finding *finding, uint64_t site, uint64_t count);
void gn_sarif_recount(struct gn_sarif *sarif, int64_t place, uint64_t count);
/* Adds the closing statement of an instance, which is JSON. */
void gn_sarif_statement(struct gn_sarif *sarif, const char *statement);
/* NULL is accepted. */
void gn_sarif_close(struct gn_sarif *sarif);

#endif
