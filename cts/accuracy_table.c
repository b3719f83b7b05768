/* SPDX-License-Identifier: Apache-2.0 */
/* The console's table and accuracy.json. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <yyjson.h>

#include "cts/accuracy_driver.h"
#include "cts/accuracy_layer.h"
#include "cts/describe.h"
#include "cts/progress.h"

/* "0", "<0.1", "0.4", "123", "210.5k": six columns. */
static const char *short_number(double value, char out[32])
{
    if (isnan(value))
        snprintf(out, 32, "-");
    else if (value == 0)
        snprintf(out, 32, "0");
    else if (value < 0.001)
        snprintf(out, 32, "<0.001");
    else if (value < 1)
        snprintf(out, 32, "%.3f", value);
    else if (value < 100)
        snprintf(out, 32, "%.1f", value);
    else if (value < 99999.5)
        snprintf(out, 32, "%.0f", value);
    else if (value < 1e6)
        snprintf(out, 32, "%.0fk", value * 1e-3);
    else
        snprintf(out, 32, "%.1e", value);
    return out;
}

/* Of one tier, both modes, and one kind or (GN_AIM_COUNT) all. */
static double per_million(const struct gn_accuracy *accuracy, uint32_t scene, int tier, int aim, bool gross)
{
    uint64_t rays = 0, wrong = 0;
    for (size_t i = 0; i < accuracy->row_count; i++) {
        const struct gn_accuracy_row *row = &accuracy->rows[i];
        if (row->scene == scene && (int)row->tier == tier && ((int)row->aim == aim || aim == GN_AIM_COUNT)) {
            rays += row->rays;
            wrong += gross ? gn_accuracy_row_gross(row) : gn_accuracy_row_wrong(row);
        }
    }
    return rays ? 1e6 * (double)wrong / (double)rays : 0;
}

void gn_accuracy_print_scene(FILE *file, const struct gn_accuracy *accuracy, uint32_t scene)
{
    const struct gn_accuracy_scene *what = &accuracy->scenes[scene];
    struct gn_accuracy_point points[GN_ACCURACY_MODE_COUNT][GN_REF_TIER_COUNT];
    char number[8][32];
    for (int mode = 0; mode < GN_ACCURACY_MODE_COUNT; mode++)
        gn_accuracy_points(accuracy, scene, (enum gn_accuracy_mode)mode, points[mode]);
    fprintf(file, "\n%.40s: %s; %s triangle%s\n", what->name, what->about,
            gn_format_grouped(what->triangles, number[0]), what->triangles == 1 ? "" : "s");
    fprintf(file, "%-9s %13s %13s   %-34s  %6s  %7s %6s\n", "", "single rays", "batches",
            "wrong per million, aimed at", "t max", "build", "bytes/");
    fprintf(file, "%-9s %6s %6s %6s %6s   %6s %6s %6s %6s %6s  %6s  %7s %6s\n", "tier", "Mray/s", "x rob.",
            "Mray/s", "x rob.", "inside", "edge", "vertex", "random", "gross", "ulp", "seconds", "tri.");
    for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
        const struct gn_accuracy_row *row = NULL;
        for (size_t i = 0; i < accuracy->row_count && !row; i++)
            if (accuracy->rows[i].scene == scene && (int)accuracy->rows[i].tier == t)
                row = &accuracy->rows[i];
        if (!row)
            continue;
        fprintf(file, "%-9s", gn_ref_tier_name((enum gn_ref_tier)t));
        for (int mode = 0; mode < GN_ACCURACY_MODE_COUNT; mode++)
            fprintf(file, " %6s %6s", short_number(points[mode][t].mrays_per_s, number[0]),
                    short_number(1 / points[mode][t].time, number[1]));
        fputs("  ", file);
        for (int aim = 0; aim < GN_AIM_COUNT; aim++)
            fprintf(file, " %6s", short_number(per_million(accuracy, scene, t, aim, false), number[0]));
        fprintf(file, " %6s  %6s  %7.2f %6s\n",
                short_number(per_million(accuracy, scene, t, GN_AIM_COUNT, true), number[0]),
                short_number(fmax(points[0][t].t_error_max, points[1][t].t_error_max), number[1]),
                row->build_seconds, short_number((double)row->bytes / (double)what->triangles, number[2]));
    }
}

void gn_accuracy_print_choice(FILE *file, const struct gn_accuracy *accuracy)
{
    char text[256], gross[2][32];
    fprintf(file, "\nA wrong decision is gross unless it names a triangle that touches the right one.\n");
    fprintf(file, "\nThe most accurate tier within %g times the time of robust:\n", accuracy->options.budget);
    for (uint32_t i = 0; i <= accuracy->scene_count; i++) {
        bool all = i == accuracy->scene_count;
        if (all && accuracy->scene_count == 1)
            break;
        for (int mode = 0; mode < GN_ACCURACY_MODE_COUNT; mode++) {
            struct gn_accuracy_point points[GN_REF_TIER_COUNT];
            gn_accuracy_points(accuracy, all ? GN_ACCURACY_ALL_SCENES : i, (enum gn_accuracy_mode)mode,
                               points);
            int choice = gn_accuracy_choose(points, GN_REF_TIER_COUNT, accuracy->options.budget);
            gn_accuracy_choice_text(points, choice, accuracy->options.budget, text, sizeof text);
            fprintf(file, "  %-11.24s %-6s  %s\n",
                    mode  ? ""
                    : all ? "ALL SCENES"
                          : accuracy->scenes[i].name,
                    gn_accuracy_mode_name((enum gn_accuracy_mode)mode), text);
            int other = gn_accuracy_choose_gross(points, GN_REF_TIER_COUNT, accuracy->options.budget, choice);
            if (other >= 0 && (all || accuracy->scene_count == 1))
                fprintf(file, "  %-11s %-6s  but %s has fewer gross ones: %s against %s per million\n",
                        "", "", gn_ref_tier_name((enum gn_ref_tier)other),
                        gn_accuracy_number(1e6 * (double)points[other].gross / (double)points[other].rays, gross[0]),
                        gn_accuracy_number(1e6 * (double)points[choice].gross / (double)points[choice].rays, gross[1]));
        }
    }
}

static void put_number(yyjson_mut_doc *doc, yyjson_mut_val *object, const char *key, double value)
{
    /* JSON has no number for what was not measured. */
    if (isfinite(value))
        yyjson_mut_obj_add_real(doc, object, key, value);
    else
        yyjson_mut_obj_add_null(doc, object, key);
}

char *gn_accuracy_json(const struct gn_accuracy *accuracy, size_t *out_length)
{
    char *text = NULL;
    yyjson_mut_doc *doc = yyjson_mut_doc_new(NULL);
    yyjson_mut_val *list = doc ? yyjson_mut_arr(doc) : NULL;
    if (!list)
        goto done;
    yyjson_mut_doc_set_root(doc, list);
    for (size_t i = 0; i < accuracy->row_count; i++) {
        const struct gn_accuracy_row *row = &accuracy->rows[i];
        yyjson_mut_val *object = yyjson_mut_arr_add_obj(doc, list);
        if (!object || !yyjson_mut_obj_add_str(doc, object, "scene", accuracy->scenes[row->scene].name))
            goto done;
        yyjson_mut_obj_add_str(doc, object, "rays", gn_accuracy_aim_name(row->aim));
        yyjson_mut_obj_add_str(doc, object, "mode", gn_accuracy_mode_name(row->mode));
        yyjson_mut_obj_add_str(doc, object, "tier", gn_ref_tier_name(row->tier));
        put_number(doc, object, "mrays_per_s", row->mrays_per_s);
        put_number(doc, object, "ratio_to_robust", row->ratio_to_robust);
        put_number(doc, object, "wrong_per_million",
                   row->rays ? 1e6 * (double)gn_accuracy_row_wrong(row) / (double)row->rays : (double)NAN);
        put_number(doc, object, "gross_per_million",
                   row->rays ? 1e6 * (double)gn_accuracy_row_gross(row) / (double)row->rays : (double)NAN);
        put_number(doc, object, "t_error_ulp_median", row->t_error_median);
        put_number(doc, object, "t_error_ulp_max", row->t_error_max);
        put_number(doc, object, "build_seconds", row->build_seconds);
        if (!yyjson_mut_obj_add_uint(doc, object, "bytes", row->bytes) || yyjson_mut_obj_size(object) != 12)
            goto done;
    }
    if (!gn_accuracy_driver_json(accuracy, doc, list) || !gn_accuracy_layer_json(accuracy, doc, list))
        goto done;
    text = yyjson_mut_write(doc, YYJSON_WRITE_PRETTY_TWO_SPACES | YYJSON_WRITE_NEWLINE_AT_END, out_length);
done:
    yyjson_mut_doc_free(doc);
    return text;
}
