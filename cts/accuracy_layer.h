/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `gnomon accuracy --layer`: what the layer's levels cost an application. The application is this program's own timing
 * of a driver's operations (bench.h), in a worker process for each level; all are measured in turns.
 */
#ifndef GNOMON_CTS_ACCURACY_LAYER_H
#define GNOMON_CTS_ACCURACY_LAYER_H

#include "cts/accuracy.h"

enum gn_accuracy_level {
    GN_LEVEL_OFF,
    GN_LEVEL_STATE, /* the layer, which leaves shaders alone */
    GN_LEVEL_SHADERS, /* the layer as it comes: state, and shaders checked while they run */
    GN_LEVEL_KHRONOS, /* Khronos' validation layer as the distribution packages it, for comparison */
    GN_LEVEL_COUNT
};

struct gn_accuracy_layer_row {
    const char *workload, *about;
    enum gn_accuracy_level level;
    double seconds;      /* the median */
    double ratio_to_off; /* the median over the rounds of seconds / those without a layer in the same round */
};

struct gn_accuracy_layer {
    struct gn_accuracy_layer_row *rows; /* by workload, then level */
    size_t row_count;
    char left_out[1024]; /* levels and workloads that could not be measured, and why; for people */
};

/*
 * Measures on a driver (an ICD file). Rows are the arena's. False with a message when not even the level OFF can be
 * measured, or the layer is not there.
 */
bool gn_accuracy_layer_measure(const struct gn_accuracy *accuracy, const char *icd, struct gn_arena *arena,
                               struct gn_accuracy_layer *out, char *out_error, size_t error_size);

struct yyjson_mut_doc;
struct yyjson_mut_val;
bool gn_accuracy_layer_json(const struct gn_accuracy *accuracy, struct yyjson_mut_doc *doc, struct yyjson_mut_val *list);
void gn_accuracy_layer_print(FILE *file, const struct gn_accuracy *accuracy);
void gn_accuracy_layer_html(FILE *file, const struct gn_accuracy *accuracy);

#endif
