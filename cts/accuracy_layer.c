/* SPDX-License-Identifier: Apache-2.0 */
/* Measures the layer's levels, and shows them: see accuracy_layer.h. */
#include "cts/accuracy_layer.h"

#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <yyjson.h>

#include "cts/bench.h"
#include "cts/commands.h"
#include "cts/gate.h"
#include "cts/report_html_parts.h"
#include "cts/statistics.h"
#include "cts/worker.h"

#define GNOMON_LAYER "VK_LAYER_GNOMON_ray_tracing"
#define MOST_ROUNDS 15

static const struct {
    const char *name, *about, *layers, *shader_checks;
    const char *colour;
} levels[GN_LEVEL_COUNT] = {
    {"off", "no layer", "", "", "#808080"},
    {"state", "Gnomon's layer, state checks only", GNOMON_LAYER, "off", "#56b4e9"},
    {"state+shaders", "Gnomon's layer as it comes: state, and shaders checked while they run", GNOMON_LAYER, "on", "#0072b2"},
    {"khronos", "VK_LAYER_KHRONOS_validation as packaged, for comparison", "VK_LAYER_KHRONOS_validation", "", "#d07a00"},
};

/* Variables that a level sets for the process that is started next; what was there comes back. */
enum { VARIABLES = 6 };
struct environment {
    char *kept[VARIABLES];
};
static const char *const variables[VARIABLES] = {"VK_ADD_LAYER_PATH", "VK_INSTANCE_LAYERS",
                                                 "VK_GNOMON_RAY_TRACING_SHADER_CHECKS", "VK_LOADER_LAYERS_ENABLE",
                                                 "MESA_SHADER_CACHE_DISABLE", "__GL_SHADER_DISK_CACHE"};

static void environment_set(struct environment *environment, const char *const values[VARIABLES])
{
    for (int i = 0; i < VARIABLES; i++) {
        const char *before = getenv(variables[i]);
        environment->kept[i] = before ? strdup(before) : NULL;
        if (values[i][0])
            setenv(variables[i], values[i], 1);
        else
            unsetenv(variables[i]);
    }
}

static void environment_restore(struct environment *environment)
{
    for (int i = 0; i < VARIABLES; i++) {
        if (environment->kept[i])
            setenv(variables[i], environment->kept[i], 1);
        else
            unsetenv(variables[i]);
        free(environment->kept[i]);
    }
}

__attribute__((format(printf, 2, 3))) static void leave_out(struct gn_accuracy_layer *out, const char *format, ...)
{
    size_t used = strlen(out->left_out);
    va_list arguments;
    if (used && used + 2 < sizeof out->left_out) {
        memcpy(out->left_out + used, "; ", 3);
        used += 2;
    }
    va_start(arguments, format);
    vsnprintf(out->left_out + used, sizeof out->left_out - used, format, arguments);
    va_end(arguments);
}

/* One workload on all levels that are there, in turns. A level that does not come through is not asked any more. */
static void measure_item(const struct gn_accuracy *accuracy, const struct gn_bench_item *item,
                         struct gn_process processes[GN_LEVEL_COUNT], bool usable[GN_LEVEL_COUNT], struct gn_arena *arena,
                         struct gn_accuracy_layer *out)
{
    static double seconds[GN_LEVEL_COUNT][MOST_ROUNDS], ratios[MOST_ROUNDS];
    const char *missing[GN_LEVEL_COUNT] = {"", "", "", ""};
    const uint32_t rounds = accuracy->options.runs;
    /* The first round prepares what the item works on, and does not count. */
    for (uint32_t round = 0; round <= rounds; round++)
        for (uint32_t k = 0; k < GN_LEVEL_COUNT; k++) {
            uint32_t level = (k + round) % GN_LEVEL_COUNT;
            double *value = &seconds[level][round ? round - 1 : 0];
            if (usable[level] && !*missing[level])
                usable[level] = gn_gate_item_measure(&processes[level], item, value, arena, &missing[level]);
        }
    for (int level = 0; level < GN_LEVEL_COUNT; level++) {
        if (*missing[level])
            leave_out(out, "%s at %s: %.200s", item->name, levels[level].name, missing[level]);
        if (*missing[level] || *missing[GN_LEVEL_OFF] || !usable[level])
            continue;
        for (uint32_t round = 0; round < rounds; round++)
            ratios[round] = seconds[level][round] / seconds[GN_LEVEL_OFF][round];
        out->rows[out->row_count++] = (struct gn_accuracy_layer_row){item->name, item->about, (enum gn_accuracy_level)level, 0,
                                                                     gn_median(ratios, rounds)};
    }
    /* After the ratios: sorting mixes the rounds. */
    for (size_t i = 0; i < out->row_count; i++)
        if (out->rows[i].workload == item->name)
            out->rows[i].seconds = gn_median(seconds[out->rows[i].level], rounds);
}

bool gn_accuracy_layer_measure(const struct gn_accuracy *accuracy, const char *icd, struct gn_arena *arena,
                               struct gn_accuracy_layer *out, char *out_error, size_t error_size)
{
    struct gn_process processes[GN_LEVEL_COUNT];
    bool usable[GN_LEVEL_COUNT] = {false};
    char folder[4400], why[512];
    *out = (struct gn_accuracy_layer){.rows = GN_NEW(arena, struct gn_accuracy_layer_row, gn_bench_count() * GN_LEVEL_COUNT)};
    for (int level = 0; level < GN_LEVEL_COUNT; level++)
        processes[level] = (struct gn_process){0, -1, -1, -1, NULL, 0, 0};
    gn_layer_find(folder, sizeof folder);
    if (!folder[0]) {
        snprintf(out_error, error_size, "the layer is not there");
        return false;
    }
    for (int level = 0; level < GN_LEVEL_COUNT; level++) {
        const char *const values[VARIABLES] = {level == GN_LEVEL_STATE || level == GN_LEVEL_SHADERS ? folder : "",
                                               levels[level].layers, levels[level].shader_checks, "", "true", "0"};
        struct environment environment;
        environment_set(&environment, values);
        usable[level] = gn_gate_open(&processes[level], icd, why, sizeof why);
        environment_restore(&environment);
        if (!usable[level] && level != GN_LEVEL_OFF)
            leave_out(out, "level %s: %.200s", levels[level].name, why);
    }
    bool ok = usable[GN_LEVEL_OFF];
    if (!ok)
        snprintf(out_error, error_size, "%s", why);
    for (size_t i = 0; ok && i < gn_bench_count(); i++) {
        const struct gn_bench_item *item = gn_bench_item(i);
        if (item->bytes)
            continue;
        fprintf(stderr, "the layer's levels on %s\n", item->name);
        measure_item(accuracy, item, processes, usable, arena, out);
    }
    for (int level = 0; level < GN_LEVEL_COUNT; level++)
        gn_process_end(&processes[level], true);
    return ok;
}

/* The geometric mean of a level's ratios; NaN without any. */
static double mean_of(const struct gn_accuracy_layer *layer, enum gn_accuracy_level level)
{
    double sum = 0;
    uint32_t count = 0;
    for (size_t i = 0; i < layer->row_count; i++)
        if (layer->rows[i].level == level) {
            sum += log(layer->rows[i].ratio_to_off);
            count++;
        }
    return count ? exp(sum / count) : (double)NAN;
}

bool gn_accuracy_layer_json(const struct gn_accuracy *accuracy, yyjson_mut_doc *doc, yyjson_mut_val *list)
{
    const struct gn_accuracy_layer *layer = accuracy->layer;
    for (size_t i = 0; layer && i < layer->row_count; i++) {
        const struct gn_accuracy_layer_row *row = &layer->rows[i];
        yyjson_mut_val *object = yyjson_mut_arr_add_obj(doc, list);
        if (!object || !yyjson_mut_obj_add_str(doc, object, "workload", row->workload) ||
            !yyjson_mut_obj_add_str(doc, object, "level", levels[row->level].name) ||
            !yyjson_mut_obj_add_real(doc, object, "seconds", row->seconds) ||
            !yyjson_mut_obj_add_real(doc, object, "ratio_to_off", row->ratio_to_off))
            return false;
    }
    return true;
}

static const struct gn_accuracy_layer_row *row_of(const struct gn_accuracy_layer *layer, const char *workload, int level)
{
    for (size_t i = 0; i < layer->row_count; i++)
        if (layer->rows[i].workload == workload && (int)layer->rows[i].level == level)
            return &layer->rows[i];
    return NULL;
}

void gn_accuracy_layer_print(FILE *file, const struct gn_accuracy *accuracy)
{
    const struct gn_accuracy_layer *layer = accuracy->layer;
    fprintf(file, "\nThe layer's levels: milliseconds without, and times over that\n%-28s %10s", "workload", "off, ms");
    for (int level = 1; level < GN_LEVEL_COUNT; level++)
        fprintf(file, " %14s", levels[level].name);
    for (size_t i = 0; i < layer->row_count; i++) {
        if (layer->rows[i].level != GN_LEVEL_OFF)
            continue;
        fprintf(file, "\n%-28s %10.3f", layer->rows[i].workload, 1e3 * layer->rows[i].seconds);
        for (int level = 1; level < GN_LEVEL_COUNT; level++) {
            const struct gn_accuracy_layer_row *row = row_of(layer, layer->rows[i].workload, level);
            if (row)
                fprintf(file, " %14.2f", row->ratio_to_off);
            else
                fprintf(file, " %14s", "-");
        }
    }
    fprintf(file, "\n%-28s %10s", "geometric mean", "");
    for (int level = 1; level < GN_LEVEL_COUNT; level++)
        fprintf(file, " %14.2f", mean_of(layer, (enum gn_accuracy_level)level));
    fputs("\n", file);
    if (layer->left_out[0])
        fprintf(file, "Left out: %s.\n", layer->left_out);
}

/* Bars to the right of 1x; what is faster ends left of it. */
static void put_plot(FILE *file, const struct gn_accuracy_layer *layer)
{
    enum { LEFT = 210, RIGHT = 940, BAR = 9, GAP = 10, TOP = 24 };
    double most = 2, least = 0.8;
    uint32_t groups = 0;
    for (size_t i = 0; i < layer->row_count; i++) {
        most = fmax(most, layer->rows[i].ratio_to_off * 1.15);
        least = fmin(least, layer->rows[i].ratio_to_off);
        groups += layer->rows[i].level == GN_LEVEL_OFF;
    }
    const double scale = (RIGHT - LEFT) / log(most / least), one = LEFT + scale * log(1 / least);
    const int group = (GN_LEVEL_COUNT - 1) * BAR + GAP, height = TOP + (int)groups * group + 6;
    static const double ticks[] = {0.5, 0.8, 1, 1.2, 1.5, 2, 3, 5, 10, 20, 50, 100, 200, 500, 1000};
    fprintf(file, "<div class=plot><svg class=\"gp\" xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 1000 %d\" role=\"img\" "
                  "aria-label=\"time of each workload at each level of the layer\" style=\"width:100%%;height:auto\">\n",
            height);
    double written = -100;
    for (size_t i = 0; i < sizeof ticks / sizeof ticks[0]; i++) {
        double x = LEFT + scale * log(ticks[i] / least);
        if (x < LEFT - 1 || x > RIGHT || x - written < 34)
            continue;
        written = x;
        fprintf(file, "<line class=\"%s\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%d\" y2=\"%d\"/><text class=\"soft\" "
                      "text-anchor=\"middle\" x=\"%.1f\" y=\"14\">%g&#215;</text>\n",
                ticks[i] > 0.99 && ticks[i] < 1.01 ? "axis" : "grid", x, x, TOP - 4, height - 4, x, ticks[i]);
    }
    double y = TOP;
    for (size_t i = 0; i < layer->row_count; i++) {
        if (layer->rows[i].level != GN_LEVEL_OFF)
            continue;
        fprintf(file, "<text text-anchor=\"end\" x=\"%d\" y=\"%.1f\">%s</text>\n", LEFT - 8, y + 1.5 * BAR + 4,
                layer->rows[i].workload);
        for (int level = 1; level < GN_LEVEL_COUNT; level++, y += BAR) {
            const struct gn_accuracy_layer_row *row = row_of(layer, layer->rows[i].workload, level);
            if (!row)
                continue;
            double x = LEFT + scale * log(row->ratio_to_off / least);
            fprintf(file, "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%d\" fill=\"%s\"><title>%s, %s: %.2f times the "
                          "time</title></rect><text class=\"soft\" font-size=\"9.5\" x=\"%.1f\" y=\"%.1f\">%.2f</text>\n",
                    fmin(x, one), y, fmax(1, fabs(x - one)), BAR - 1, levels[level].colour, row->workload, levels[level].name,
                    row->ratio_to_off, fmax(x, one) + 4, y + BAR - 1, row->ratio_to_off);
        }
        y += GAP;
    }
    fputs("</svg></div>\n", file);
}

void gn_accuracy_layer_html(FILE *file, const struct gn_accuracy *accuracy)
{
    const struct gn_accuracy_layer *layer = accuracy->layer;
    fputs("<h2>The layer: what its levels cost</h2>\n<p>An application that does one thing over and over, in a process for each "
          "level, all measured in turns: its time over that without a layer. Left is better.</p><p class=small>",
          file);
    for (int level = 1; level < GN_LEVEL_COUNT; level++)
        fprintf(file, "<span class=key><i style=\"background:%s\"></i>%s</span> ", levels[level].colour, levels[level].about);
    fputs("</p>\n", file);
    if (layer->left_out[0]) {
        fputs("<p class=soft>Left out: ", file);
        gn_html_text(file, layer->left_out);
        fputs(".</p>\n", file);
    }
    put_plot(file, layer);
    fputs("<div class=wide><table><thead><tr><th>Workload<th>What it does<th class=n>Off, ms", file);
    for (int level = 1; level < GN_LEVEL_COUNT; level++)
        fprintf(file, "<th class=n>%s", levels[level].name);
    fputs("</tr></thead><tbody>\n", file);
    for (size_t i = 0; i < layer->row_count; i++) {
        if (layer->rows[i].level != GN_LEVEL_OFF)
            continue;
        fprintf(file, "<tr><td><b>%s</b><td>%s<td class=n>%.3f", layer->rows[i].workload, layer->rows[i].about,
                1e3 * layer->rows[i].seconds);
        for (int level = 1; level < GN_LEVEL_COUNT; level++) {
            const struct gn_accuracy_layer_row *row = row_of(layer, layer->rows[i].workload, level);
            if (row)
                fprintf(file, "<td class=n>%.2f&times;", row->ratio_to_off);
            else
                fputs("<td class=n>-", file);
        }
        fputs("</tr>\n", file);
    }
    fputs("<tr class=total><td>geometric mean<td><td>", file);
    for (int level = 1; level < GN_LEVEL_COUNT; level++) {
        double mean = mean_of(layer, (enum gn_accuracy_level)level);
        if (isnan(mean))
            fputs("<td class=n>-", file);
        else
            fprintf(file, "<td class=n>%.2f&times;", mean);
    }
    fputs("</tr></tbody></table></div>\n", file);
}
