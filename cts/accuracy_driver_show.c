/* SPDX-License-Identifier: Apache-2.0 */
/* What the driver's settings cost: the console's table, the rows of accuracy.json, the section of the page. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <yyjson.h>

#include "cts/accuracy_driver.h"
#include "cts/describe.h"
#include "cts/report_html_parts.h"

static double per_million(uint64_t some, uint64_t all)
{
    return all ? 1e6 * (double)some / (double)all : 0;
}

/* Two decimals, or a dash for what there is not. */
static const char *factor(double value, char out[32])
{
    if (isnan(value))
        snprintf(out, 32, "-");
    else
        snprintf(out, 32, "%.2f", value);
    return out;
}

void gn_accuracy_driver_print(FILE *file, const struct gn_accuracy *accuracy)
{
    const struct gn_accuracy_driver *driver = accuracy->driver;
    fprintf(file, "\nThe driver %.80s, all scenes: times and sizes over those of fast_trace\n", driver->device);
    fprintf(file, "%-16s %6s %6s %7s %6s   %10s %8s %9s   %9s\n", "setting", "trace", "build", "update", "bytes",
            "wrong/mill.", "gross", "beyond", "t median");
    for (uint32_t s = 0; s < GN_ACCURACY_SETTING_COUNT; s++) {
        struct gn_accuracy_driver_point point;
        char number[8][32];
        if (!gn_accuracy_driver_sum(driver, GN_ACCURACY_ALL_SCENES, s, &point))
            continue;
        fprintf(file, "%-16s %6s %6s %7s %6s   %10s %8s %9s   %9s\n", gn_accuracy_settings[s].name,
                factor(point.time, number[0]), factor(point.build, number[1]), factor(point.update, number[2]),
                factor(point.size, number[3]), gn_accuracy_number(per_million(point.wrong, point.rays), number[4]),
                gn_accuracy_number(per_million(point.gross, point.rays), number[5]),
                gn_accuracy_number(per_million(point.left, point.rays), number[6]),
                gn_accuracy_number(point.t_error_median, number[7]));
    }
    fprintf(file, "update: over the time of rebuilt. wrong, gross, t (ulp): against the scene as it was meant; beyond: "
                  "leaks and\nwrong answers per million by the verdict on what the driver was given.\n");
    if (driver->left_out[0])
        fprintf(file, "Left out: %s.\n", driver->left_out);
}

static void put_number(yyjson_mut_doc *doc, yyjson_mut_val *object, const char *key, double value)
{
    if (isfinite(value))
        yyjson_mut_obj_add_real(doc, object, key, value);
    else
        yyjson_mut_obj_add_null(doc, object, key);
}

bool gn_accuracy_driver_json(const struct gn_accuracy *accuracy, yyjson_mut_doc *doc, yyjson_mut_val *list)
{
    const struct gn_accuracy_driver *driver = accuracy->driver;
    for (size_t i = 0; driver && i < driver->row_count; i++) {
        const struct gn_accuracy_driver_row *row = &driver->rows[i];
        const struct gn_accuracy_setting *setting = &gn_accuracy_settings[row->setting];
        yyjson_mut_val *object = yyjson_mut_arr_add_obj(doc, list);
        if (!object || !yyjson_mut_obj_add_str(doc, object, "scene", accuracy->scenes[row->scene].name))
            return false;
        yyjson_mut_obj_add_str(doc, object, "rays", gn_accuracy_aim_name(row->aim));
        yyjson_mut_obj_add_str(doc, object, "driver", driver->device);
        yyjson_mut_obj_add_str(doc, object, "group", setting->group);
        yyjson_mut_obj_add_str(doc, object, "setting", setting->name);
        put_number(doc, object, "mrays_per_s", row->mrays_per_s);
        put_number(doc, object, "ratio_to_fast_trace", row->ratio_to_plain);
        put_number(doc, object, "wrong_per_million",
                   per_million(row->lost + row->invented + row->neighbour + row->other, row->rays));
        put_number(doc, object, "beyond_bound_per_million",
                   per_million(row->class_counts[GN_REF_LEAK] + row->class_counts[GN_REF_DOUBLE_HIT] +
                                   row->class_counts[GN_REF_WRONG],
                               row->rays));
        put_number(doc, object, "t_error_ulp_median", row->t_error_median);
        put_number(doc, object, "t_error_ulp_max", row->t_error_max);
        put_number(doc, object, "build_seconds", row->build_seconds);
        put_number(doc, object, "build_ratio", row->build_ratio);
        put_number(doc, object, "update_seconds", row->update_seconds);
        if (!yyjson_mut_obj_add_uint(doc, object, "bytes", row->bytes) || yyjson_mut_obj_size(object) != 15)
            return false;
    }
    return true;
}

/* The plot: time per ray to the right, what is wrong upwards. */
enum { PANEL = 475, LEFT = 58, TOP = 26, BOTTOM = 44, PLOT_HEIGHT = 320 };

struct mark {
    double time, value, x, y;
    uint32_t setting;
    bool on_front;
};

static double place(double value, double low, double high, double from, double to)
{
    return from + (to - from) * (log10(value) - low) / (high - low);
}

/* A group has a shape: a setting is told by its name beside it. */
static void put_mark(FILE *file, const struct mark *mark, const char *unit)
{
    static const char *const colours[3] = {"t1", "t0", "t2"};
    const struct gn_accuracy_setting *setting = &gn_accuracy_settings[mark->setting];
    int group = setting->group[0] == 'f' ? setting->group[1] == 'o' : 2;
    char number[2][32];
    fprintf(file, "<g class=\"%s\"><circle cx=\"%.1f\" cy=\"%.1f\" r=\"6\"><title>%s: %s times fast_trace's time, %s %s"
                  "</title></circle></g>\n",
            colours[group], mark->x, mark->y, setting->name, factor(mark->time, number[0]),
            gn_accuracy_number(mark->value, number[1]), unit);
}

static int by_y(const void *a, const void *b)
{
    const struct mark *p = a, *q = b;
    return (p->y > q->y) - (p->y < q->y);
}

static int by_time(const void *a, const void *b)
{
    const struct mark *p = a, *q = b;
    return (p->time > q->time) - (p->time < q->time);
}

static void put_front(FILE *file, const struct mark *marks, size_t count, double top, double right)
{
    bool first = true;
    fputs("<path class=\"front\" d=\"", file);
    for (size_t i = 0; i < count; i++) {
        if (!marks[i].on_front)
            continue;
        if (first)
            fprintf(file, "M%.1f %.1fV%.1f", marks[i].x, top, marks[i].y);
        else
            fprintf(file, "H%.1fV%.1f", marks[i].x, marks[i].y);
        first = false;
    }
    fprintf(file, "H%.1f\"/>\n", right);
}

static void put_panel(FILE *file, const struct gn_accuracy *accuracy, uint32_t scene, bool t_error, double offset)
{
    struct mark marks[GN_ACCURACY_SETTING_COUNT];
    double times[GN_ACCURACY_SETTING_COUNT], values[GN_ACCURACY_SETTING_COUNT];
    bool front[GN_ACCURACY_SETTING_COUNT];
    size_t count = 0;
    const char *unit = t_error ? "ulp (median error of t)" : "wrong per million";
    double time_low = log10(0.8), time_high = log10(1.25), low = INFINITY, high = -INFINITY;
    for (uint32_t s = 0; s < GN_ACCURACY_SETTING_COUNT; s++) {
        struct gn_accuracy_driver_point point;
        if (!gn_accuracy_driver_sum(accuracy->driver, scene, s, &point))
            continue;
        double value = t_error ? point.t_error_median : per_million(point.wrong, point.rays);
        if (isnan(value))
            continue;
        times[count] = point.time;
        values[count] = value;
        marks[count++] = (struct mark){.time = point.time, .value = value, .setting = s};
        time_low = fmin(time_low, log10(point.time) - 0.03);
        time_high = fmax(time_high, log10(point.time) + 0.12);
        low = fmin(low, floor(log10(fmax(value, 0.01))));
        high = fmax(high, ceil(log10(fmax(value, 0.01))));
    }
    if (!count)
        return;
    high = fmax(high, low + 1);
    gn_accuracy_front(times, values, count, front);
    const double left = offset + LEFT, right = offset + PANEL, top = TOP, bottom = PLOT_HEIGHT - BOTTOM;
    fprintf(file, "<rect class=\"panel\" x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\"/>\n", left, top, right - left,
            bottom - top);
    for (double e = low; e <= high; e++) {
        double y = bottom - (bottom - top - 16) * (e - low) / (high - low);
        fprintf(file, "<line class=\"grid\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\"/><text class=\"soft\" "
                      "text-anchor=\"end\" x=\"%.1f\" y=\"%.1f\">%g</text>\n",
                left, right, y, y, left - 6, y + 4, pow(10, e));
    }
    static const double ticks[] = {0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 1, 1.1, 1.25, 1.5, 2, 3, 5, 10, 20, 50};
    double written = -100;
    for (size_t i = 0; i < sizeof ticks / sizeof ticks[0]; i++) {
        double x = place(ticks[i], time_low, time_high, left, right);
        if (x < left || x > right || x - written < 36)
            continue;
        written = x;
        fprintf(file, "<line class=\"grid\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\"/><text class=\"soft\" "
                      "text-anchor=\"middle\" x=\"%.1f\" y=\"%.1f\">%g&#215;</text>\n",
                x, x, top, bottom, x, bottom + 15, ticks[i]);
    }
    fprintf(file, "<text font-weight=\"650\" x=\"%.1f\" y=\"%d\">%s</text><text class=\"soft\" text-anchor=\"middle\" "
                  "x=\"%.1f\" y=\"%.1f\">time per ray, fast_trace = 1&#215;</text>\n",
            offset + 8, TOP - 10, t_error ? "median error of t, ulp (f32)" : "wrong decisions per million rays",
            (left + right) / 2, bottom + 34);
    for (size_t i = 0; i < count; i++) {
        marks[i].on_front = front[i];
        marks[i].x = place(marks[i].time, time_low, time_high, left, right);
        double clamped = log10(fmax(marks[i].value, pow(10, low)));
        marks[i].y = bottom - (bottom - top - 16) * (clamped - low) / (high - low);
    }
    qsort(marks, count, sizeof *marks, by_time);
    put_front(file, marks, count, top, right);
    for (size_t i = 0; i < count; i++)
        put_mark(file, &marks[i], unit);
    /* Names beside the marks, from the top down, pushed apart where they would lie on each other. */
    qsort(marks, count, sizeof *marks, by_y);
    double label = top;
    for (size_t i = 0; i < count; i++) {
        const char *name = gn_accuracy_settings[marks[i].setting].name;
        label = fmax(label + 13, marks[i].y + 4);
        label = fmin(label, bottom - 3 - 13 * (double)(count - 1 - i));
        double x = marks[i].x + 14;
        bool turned = x + 7.2 * (double)strlen(name) > right;
        x = turned ? marks[i].x - 14 : x;
        fprintf(file, "<path class=\"axis\" fill=\"none\" d=\"M%.1f %.1fL%.1f %.1f\"/><text class=\"halo\" text-anchor=\"%s\" "
                      "x=\"%.1f\" y=\"%.1f\">%s</text>\n",
                marks[i].x, marks[i].y, turned ? x + 2 : x - 2, label - 4, turned ? "end" : "start", x, label, name);
    }
}

static void put_plot(FILE *file, const struct gn_accuracy *accuracy, uint32_t scene)
{
    fprintf(file, "<div class=plot><svg class=\"gp\" xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 1000 %d\" "
                  "role=\"img\" aria-label=\"the driver: time per ray against wrong decisions and the error of t\" "
                  "style=\"width:100%%;height:auto\">\n",
            PLOT_HEIGHT);
    put_panel(file, accuracy, scene, false, 5);
    put_panel(file, accuracy, scene, true, 505);
    fputs("</svg></div>\n", file);
}

static void put_table(FILE *file, const struct gn_accuracy *accuracy, uint32_t scene)
{
    fputs("<div class=wide><table><thead><tr><th>Setting<th>What it is<th class=n>Time<br>per ray<th class=n>Time<br>to build"
          "<th class=n>Update<br>&times; rebuild<th class=n>Memory<th class=n>Wrong per million<br>against what was meant<th "
          "class=n>Of it<br>gross<th class=n>Beyond the bound<br>per million<th class=n>t error, ulp<br>median<th "
          "class=n><br>largest</tr></thead><tbody>\n",
          file);
    const char *group = "";
    for (uint32_t s = 0; s < GN_ACCURACY_SETTING_COUNT; s++) {
        const struct gn_accuracy_setting *setting = &gn_accuracy_settings[s];
        struct gn_accuracy_driver_point point;
        char number[9][32];
        if (!gn_accuracy_driver_sum(accuracy->driver, scene, s, &point))
            continue;
        fprintf(file,
                "<tr%s><td><b>%s</b><td>%s<td class=n>%s&times;<td class=n>%s&times;<td class=n>%s<td class=n>%s&times;"
                "<td class=\"n %s\">%s<td class=n>%s<td class=\"n %s\">%s<td class=n>%s<td class=n>%s</tr>\n",
                strcmp(group, setting->group) ? " class=first" : "", setting->name, setting->about,
                factor(point.time, number[0]), factor(point.build, number[1]), factor(point.update, number[2]),
                factor(point.size, number[3]), point.wrong ? "bad" : "zero",
                gn_accuracy_number(per_million(point.wrong, point.rays), number[4]),
                gn_accuracy_number(per_million(point.gross, point.rays), number[5]), point.left ? "bad" : "zero",
                gn_accuracy_number(per_million(point.left, point.rays), number[6]),
                gn_accuracy_number(point.t_error_median, number[7]), gn_accuracy_number(point.t_error_max, number[8]));
        group = setting->group;
    }
    fputs("</tbody></table></div>\n", file);
}

void gn_accuracy_driver_html(FILE *file, const struct gn_accuracy *accuracy)
{
    const struct gn_accuracy_driver *driver = accuracy->driver;
    char number[32];
    fputs("<h2>The driver: time against error</h2>\n<dl class=facts><dt>Device</dt><dd>", file);
    gn_html_text(file, driver->device);
    fputs("</dd><dt>Driver</dt><dd>", file);
    gn_html_text(file, driver->about);
    fprintf(file,
            "</dd></dl>\n<p>The same scenes and rays on the driver, built in different ways: each setting was traced in turns "
            "with <b>fast_trace</b>, and its times and memory are over those of it. <b>Wrong</b> is measured against the "
            "scene as it was meant, so that a coarser vertex format counts; <b>beyond the bound</b> is the verdict on what "
            "the driver was given: leaks and answers that no rounding explains. Left and down is better; of the settings on "
            "the line none is beaten in both. Times are from the call to the answers, building includes its submission; "
            "%s rays of each kind were timed, the first %s of them judged.</p>\n",
            gn_format_grouped(accuracy->options.rays, number),
            accuracy->options.rays < GN_ACCURACY_DRIVER_JUDGED ? number : "20,000");
    if (driver->left_out[0]) {
        fputs("<p class=soft>Left out: ", file);
        gn_html_text(file, driver->left_out);
        fputs(".</p>\n", file);
    }
    fputs("<p class=small><span class=key><i style=\"background:#0072b2\"></i>build flags</span> <span class=key><i "
          "style=\"background:#d07a00\"></i>vertex formats</span> <span class=key><i "
          "style=\"background:#8a5bb5\"></i>updates</span></p>\n",
          file);
    put_plot(file, accuracy, GN_ACCURACY_ALL_SCENES);
    put_table(file, accuracy, GN_ACCURACY_ALL_SCENES);
    for (uint32_t i = 0; i < accuracy->scene_count && accuracy->scene_count > 1; i++) {
        fputs("<details class=case><summary><h3>", file);
        gn_html_text(file, accuracy->scenes[i].name);
        fputs("</h3><span class=soft>on the driver</span></summary><div class=body>\n", file);
        put_plot(file, accuracy, i);
        put_table(file, accuracy, i);
        fputs("</div></details>\n", file);
    }
}
