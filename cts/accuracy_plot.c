/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The plot, as SVG: time to the right, what is wrong upwards, for single rays and batches side by side. A
 * small mark is a tier on one kind of rays of one scene, a large one the tier on all of them. Both axes are
 * logarithmic; what is 0 has no place there and gets a row of its own below a break, and what is far slower
 * than the rest a column right of one.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cts/accuracy.h"
#include "cts/report_html_parts.h"

#define WIDTH 1000
#define PANEL_WIDTH 475
#define PANEL_HEIGHT 300
#define HEAD 104
#define PLOT_LEFT 62 /* within a panel: the axis's numbers */
#define PLOT_TOP 44
#define PLOT_BOTTOM 46
#define ZERO_ROW 34
#define SLOW_COLUMN 62
#define BREAK 10

const char gn_accuracy_plot_style[] =
    ".gp{font-family:system-ui,'DejaVu Sans',sans-serif;font-size:12px}.gp text{fill:#1c2126}.gp "
    ".soft{fill:#5b6670}"
    ".gp .bg{fill:#ffffff}.gp .panel{fill:#f6f7f8}.gp .grid{stroke:#dfe3e7;stroke-width:1}.gp "
    ".axis{stroke:#8a949d}"
    ".gp .front{fill:none;stroke:#1c2126;stroke-width:1.6;stroke-opacity:.75}"
    ".gp .budget{stroke:#1c2126;stroke-dasharray:4 4;stroke-opacity:.6}.gp "
    ".within{fill:#2e8b57;fill-opacity:.09}"
    ".gp .halo{stroke:#ffffff;stroke-width:3;stroke-linejoin:round;paint-order:stroke}"
    ".gp .t0{fill:#d07a00;stroke:#d07a00}.gp .t1{fill:#0072b2;stroke:#0072b2}.gp "
    ".t2{fill:#8a5bb5;stroke:#8a5bb5}"
    ".gp .t3{fill:#00895e;stroke:#00895e}.gp .t4{fill:#5b6670;stroke:#5b6670}"
    ".gp .dot{fill-opacity:.42;stroke-opacity:.75;stroke-width:.8}.gp "
    ".whisker{stroke-width:1.2;stroke-opacity:.45}"
    ".gp .ring{fill:none;stroke:#1c2126;stroke-width:1.6}"
    "@media(prefers-color-scheme:dark){.gp text{fill:#e5e8eb}.gp .soft{fill:#9aa5af}.gp .bg{fill:#1d2125}"
    ".gp .panel{fill:#23282d}.gp .grid{stroke:#353b41}.gp .axis{stroke:#7c8790}.gp .front{stroke:#e5e8eb}"
    ".gp .budget,.gp .ring{stroke:#e5e8eb}.gp .halo{stroke:#1d2125}"
    ".gp .t0{fill:#f0a840;stroke:#f0a840}.gp .t1{fill:#56a8e0;stroke:#56a8e0}.gp "
    ".t2{fill:#bf9be6;stroke:#bf9be6}"
    ".gp .t3{fill:#45c795;stroke:#45c795}.gp .t4{fill:#9aa5af;stroke:#9aa5af}}";

/* A mark of a panel: a row, or a point where `large`. */
struct mark {
    enum gn_ref_tier tier;
    double time, value, median; /* NaN: not there */
    const struct gn_accuracy_row *row;
    bool large, on_front, chosen;
    double x, y;
};

struct box {
    double x, y, width, height;
};

struct panel {
    const struct gn_accuracy *accuracy;
    uint32_t scene;
    enum gn_accuracy_mode mode;
    bool t_error;
    double left, top;                                  /* of the plotting area */
    double right, bottom;                              /* of the part with logarithmic axes */
    double time_low, time_high, value_low, value_high; /* logarithms to base 10 */
    bool slow_column;
    struct mark *marks;
    size_t mark_count;
    struct box taken[3 * GN_REF_TIER_COUNT];
    size_t taken_count;
};

static double x_of(const struct panel *panel, double time)
{
    double at = log10(time);
    if (at > panel->time_high + 1e-9)
        return panel->right + BREAK + SLOW_COLUMN / 2.0;
    return panel->left +
           (at - panel->time_low) / (panel->time_high - panel->time_low) * (panel->right - panel->left);
}

static double y_of(const struct panel *panel, double value)
{
    if (value <= 0)
        return panel->bottom + BREAK + ZERO_ROW / 2.0;
    double at = (log10(value) - panel->value_low) / (panel->value_high - panel->value_low);
    return panel->bottom - at * (panel->bottom - panel->top);
}

static double clean_error(double error)
{
    return error <= GN_ACCURACY_T_FLOOR ? 0 : error;
}

static size_t collect(struct panel *panel, size_t capacity)
{
    const struct gn_accuracy *accuracy = panel->accuracy;
    struct gn_accuracy_point points[GN_REF_TIER_COUNT];
    size_t count = 0;
    for (size_t i = 0; i < accuracy->row_count && count + GN_REF_TIER_COUNT < capacity; i++) {
        const struct gn_accuracy_row *row = &accuracy->rows[i];
        if (row->mode != panel->mode ||
            (panel->scene != GN_ACCURACY_ALL_SCENES && row->scene != panel->scene))
            continue;
        panel->marks[count++] =
            (struct mark){.tier = row->tier,
                          .time = 1 / row->ratio_to_robust,
                          .value = panel->t_error ? clean_error(row->t_error_max)
                                                  : 1e6 * (double)gn_accuracy_row_wrong(row) /
                                                        (double)(row->rays ? row->rays : 1),
                          .median = (double)NAN,
                          .row = row};
    }
    gn_accuracy_points(accuracy, panel->scene, panel->mode, points);
    int choice = gn_accuracy_choose(points, GN_REF_TIER_COUNT, accuracy->options.budget);
    double times[GN_REF_TIER_COUNT], values[GN_REF_TIER_COUNT];
    bool front[GN_REF_TIER_COUNT];
    for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
        times[t] = points[t].time;
        values[t] = !points[t].rays  ? (double)NAN
                    : panel->t_error ? clean_error(points[t].t_error_max)
                                     : points[t].wrong_per_million;
    }
    gn_accuracy_front(times, values, GN_REF_TIER_COUNT, front);
    for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
        if (!points[t].rays)
            continue;
        panel->marks[count++] =
            (struct mark){.tier = (enum gn_ref_tier)t,
                          .time = times[t],
                          .value = values[t],
                          .median = panel->t_error ? clean_error(points[t].t_error_median) : (double)NAN,
                          .large = true,
                          .on_front = front[t],
                          .chosen = t == choice};
    }
    return count;
}

/* The axes hold all marks; the exact tier's time only if it is near the others'. */
static void scale(struct panel *panel)
{
    double time[2] = {INFINITY, 0}, value[2] = {INFINITY, 0}, slowest = 0;
    for (size_t i = 0; i < panel->mark_count; i++) {
        const struct mark *mark = &panel->marks[i];
        if (mark->tier == GN_REF_TIER_EXACT)
            slowest = fmax(slowest, mark->time);
        else
            time[1] = fmax(time[1], mark->time);
        if (mark->tier != GN_REF_TIER_EXACT)
            time[0] = fmin(time[0], mark->time);
        double values[2] = {mark->value, mark->median};
        for (int k = 0; k < 2; k++) {
            if (!isnan(values[k]) && values[k] > 0) {
                value[0] = fmin(value[0], values[k]);
                value[1] = fmax(value[1], values[k]);
            }
        }
    }
    time[0] = fmin(time[0], 0.5);
    time[1] = fmax(fmax(time[1], 2), panel->accuracy->options.budget * 1.1);
    panel->slow_column = slowest > time[1];
    panel->time_low = log10(time[0]) - 0.05;
    panel->time_high = log10(time[1]) + 0.05;
    panel->value_low = floor(isfinite(value[0]) ? log10(value[0]) - 0.1 : 0);
    panel->value_high = ceil(value[1] > 0 ? log10(value[1]) + 0.25 : 3);
    /* Of a million no more than all. */
    if (!panel->t_error)
        panel->value_high = fmin(panel->value_high, 6);
    if (panel->value_high - panel->value_low < 2)
        panel->value_high = panel->value_low + 2;
}

static void put_power(FILE *file, double exponent)
{
    if (exponent >= -1 && exponent <= 3)
        fprintf(file, "%g", pow(10, exponent));
    else
        fprintf(file, "10<tspan dy=\"-4\" font-size=\"9\">%g</tspan>", exponent);
}

static void put_axes(FILE *file, const struct panel *panel)
{
    static const double ticks[] = {0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000};
    double right = panel->right + (panel->slow_column ? BREAK + SLOW_COLUMN : 0);
    double low = panel->bottom + BREAK, bottom = low + ZERO_ROW, width = panel->right - panel->left;
    double height = panel->bottom - panel->top;
    fprintf(file,
            "<rect class=\"panel\" x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\"/>"
            "<rect class=\"panel\" x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%d\"/>\n",
            panel->left, panel->top, width, height, panel->left, low, width, ZERO_ROW);
    if (panel->slow_column)
        fprintf(file,
                "<rect class=\"panel\" x=\"%.1f\" y=\"%.1f\" width=\"%d\" height=\"%.1f\"/>"
                "<rect class=\"panel\" x=\"%.1f\" y=\"%.1f\" width=\"%d\" height=\"%d\"/>\n",
                panel->right + BREAK, panel->top, SLOW_COLUMN, height, panel->right + BREAK, low, SLOW_COLUMN,
                ZERO_ROW);
    double budget = x_of(panel, panel->accuracy->options.budget);
    if (budget > panel->left && budget <= panel->right) {
        fprintf(file,
                "<rect class=\"within\" x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\"/>"
                "<line class=\"budget\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\"/>"
                "<text class=\"soft\" text-anchor=\"end\" font-size=\"10.5\" x=\"%.1f\" y=\"%.1f\">budget %g&#215;</text>\n",
                panel->left, panel->top, budget - panel->left, bottom - panel->top, budget, budget,
                panel->top, bottom, budget - 4, panel->bottom - 5, panel->accuracy->options.budget);
    }
    double step = panel->value_high - panel->value_low > 7 ? 2 : 1;
    for (double e = panel->value_low; e <= panel->value_high + 1e-9; e += step) {
        double y = y_of(panel, pow(10, e));
        fprintf(file,
                "<line class=\"grid\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\"/>"
                "<text class=\"soft\" text-anchor=\"end\" x=\"%.1f\" y=\"%.1f\">",
                panel->left, right, y, y, panel->left - 6, y + 4);
        put_power(file, e);
        fputs("</text>\n", file);
    }
    double zero = y_of(panel, 0);
    fprintf(file,
            "<line class=\"grid\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\"/>"
            "<text text-anchor=\"end\" font-weight=\"650\" x=\"%.1f\" y=\"%.1f\">%s</text>\n",
            panel->left, right, zero, zero, panel->left - 6, zero + 4,
            panel->t_error ? "&lt;10&#8315;&#8308;" : "0");
    for (size_t i = 0; i < sizeof ticks / sizeof ticks[0]; i++) {
        if (log10(ticks[i]) < panel->time_low || log10(ticks[i]) > panel->time_high)
            continue;
        double x = x_of(panel, ticks[i]);
        fprintf(file,
                "<line class=\"grid\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\"/>"
                "<text class=\"soft\" text-anchor=\"middle\" x=\"%.1f\" y=\"%.1f\">%g&#215;</text>\n",
                x, x, panel->top, bottom, x, bottom + 15, ticks[i]);
    }
    /* The breaks, as two short strokes across the axes. */
    fprintf(file,
            "<path class=\"axis\" fill=\"none\" d=\"M%.1f %.1fV%.1fM%.1f %.1fV%.1fM%.1f %.1fH%.1f"
            "M%.1f %.1fl10 -5M%.1f %.1fl10 -5",
            panel->left, panel->top, panel->bottom, panel->left, low, bottom, panel->left, bottom,
            panel->right, panel->left - 5, panel->bottom + 2.5, panel->left - 5, low + 2.5);
    if (panel->slow_column)
        fprintf(file, "M%.1f %.1fH%.1fM%.1f %.1fl5 -10M%.1f %.1fl5 -10", panel->right + BREAK, bottom, right,
                panel->right - 2.5, bottom + 5, panel->right + BREAK - 2.5, bottom + 5);
    fputs("\"/>\n", file);
    fprintf(file,
            "<text x=\"%.1f\" y=\"%.1f\" font-weight=\"650\" font-size=\"13.5\">%s</text>"
            "<text class=\"soft\" x=\"%.1f\" y=\"%.1f\">%s</text>"
            "<text class=\"soft\" text-anchor=\"middle\" x=\"%.1f\" y=\"%.1f\">time per ray, robust = "
            "1&#215;</text>\n",
            panel->left - PLOT_LEFT + 8, panel->top - 26,
            panel->mode == GN_ACCURACY_BATCH ? "Batches of rays" : "Single rays", panel->left - PLOT_LEFT + 8,
            panel->top - 10,
            panel->t_error ? "largest error of t, ulp (f32)" : "wrong decisions per million rays",
            (panel->left + panel->right) / 2, bottom + 32);
}

static void put_shape(FILE *file, enum gn_ref_tier tier, double x, double y, double r)
{
    switch (tier) {
    case GN_REF_TIER_FAST:
        fprintf(file, "<path d=\"M%.1f %.1fl%.1f %.1fh%.1fz\"", x, y - 1.15 * r, r, 2 * r, -2 * r);
        break;
    case GN_REF_TIER_ROBUST:
        fprintf(file, "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\"", x - 0.85 * r,
                y - 0.85 * r, 1.7 * r, 1.7 * r);
        break;
    case GN_REF_TIER_DOUBLE:
        fprintf(file, "<path d=\"M%.1f %.1fl%.1f %.1fl%.1f %.1fl%.1f %.1fz\"", x, y - 1.2 * r, 1.2 * r,
                1.2 * r, -1.2 * r, 1.2 * r, -1.2 * r, -1.2 * r);
        break;
    case GN_REF_TIER_CERTIFIED:
        fprintf(file, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\"", x, y, r);
        break;
    default: {
        double a = 0.38 * r, b = 1.1 * r;
        fprintf(file, "<path d=\"M%.1f %.1fh%.1fv%.1fh%.1fv%.1fh%.1fv%.1fh%.1fv%.1fh%.1fv%.1fh%.1fz\"", x - a,
                y - b, 2 * a, b - a, b - a, 2 * a, a - b, b - a, -2 * a, a - b, a - b, -2 * a, b - a);
    }
    }
}

static void put_tip(FILE *file, const struct panel *panel, const struct mark *mark)
{
    char number[3][32];
    fputs("<title>", file);
    fputs(gn_ref_tier_name(mark->tier), file);
    if (mark->row) {
        fputs(", ", file);
        gn_html_text(file, panel->accuracy->scenes[mark->row->scene].name);
        fprintf(file, ", %s rays", gn_accuracy_aim_name(mark->row->aim));
    } else {
        fputs(", all of these rays", file);
    }
    fprintf(file, ": %s times robust's time, %s%s", gn_accuracy_number(mark->time, number[0]),
            gn_accuracy_number(mark->value, number[1]), panel->t_error ? " ulp" : " wrong per million");
    if (mark->row && !panel->t_error && mark->value > 0)
        fprintf(file, ", %s of them gross",
                gn_accuracy_number(1e6 * (double)gn_accuracy_row_gross(mark->row) / (double)mark->row->rays,
                                   number[2]));
    fputs("</title>", file);
}

static bool free_for(struct panel *panel, struct box box, double right)
{
    if (box.x < panel->left + 1 || box.x + box.width > right - 1 || box.y < panel->top ||
        box.y + box.height > panel->bottom + BREAK + ZERO_ROW + 2)
        return false;
    for (size_t i = 0; i < panel->taken_count; i++) {
        const struct box *other = &panel->taken[i];
        if (box.x < other->x + other->width && other->x < box.x + box.width &&
            box.y < other->y + other->height && other->y < box.y + box.height)
            return false;
    }
    return true;
}

/* The tier's name beside its large mark, where no other one is. */
static void put_label(FILE *file, struct panel *panel, const struct mark *mark)
{
    static const double places[][2] = {{1, 0},     {-1, 0},  {0, -1},   {0, 1},    {1, -1},
                                       {-1, -1},   {1, 1},   {-1, 1},   {0, -1.9}, {1, -1.9},
                                       {-1, -1.9}, {0, 1.9}, {0, -2.8}, {0, -3.7}};
    char name[48], number[32];
    bool slow = mark->x > panel->right;
    snprintf(name, sizeof name, "%s", gn_ref_tier_name(mark->tier));
    double width = 7.0 * (double)strlen(name) + 2, height = 13;
    double right = panel->right + (panel->slow_column ? BREAK + SLOW_COLUMN : 0);
    struct box box = {0, 0, width, height};
    /* In the row of zeros the small marks lie beside it. */
    size_t first = mark->value > 0 ? 0 : 2;
    for (size_t i = first; i < sizeof places / sizeof places[0]; i++) {
        double h = places[i][0], v = places[i][1];
        box.x = h > 0 ? mark->x + 11 : h < 0 ? mark->x - 11 - width : mark->x - width / 2;
        box.y = mark->y + v * 16 - height / 2;
        if (free_for(panel, box, right))
            break;
    }
    if (panel->taken_count < sizeof panel->taken / sizeof panel->taken[0])
        panel->taken[panel->taken_count++] = box;
    fprintf(file, "<text class=\"halo\" font-weight=\"650\" x=\"%.1f\" y=\"%.1f\">%s</text>\n", box.x + 1,
            box.y + 10.5, name);
    if (slow)
        fprintf(file, "<text class=\"soft\" text-anchor=\"middle\" x=\"%.1f\" y=\"%.1f\">%s&#215;</text>\n",
                mark->x, panel->bottom + BREAK + ZERO_ROW + 15,
                gn_accuracy_number(round(mark->time), number));
}

static int compare_marks(const void *a, const void *b)
{
    const struct mark *x = *(struct mark *const *)a, *y = *(struct mark *const *)b;
    return (x->time > y->time) - (x->time < y->time);
}

/* A staircase: to be more accurate than a point, the time of the next one has to be paid. */
static void put_front(FILE *file, const struct panel *panel)
{
    struct mark *front[GN_REF_TIER_COUNT];
    size_t count = 0;
    for (size_t i = 0; i < panel->mark_count; i++)
        if (panel->marks[i].large && panel->marks[i].on_front)
            front[count++] = &panel->marks[i];
    qsort(front, count, sizeof *front, compare_marks);
    double right = panel->right + (panel->slow_column ? BREAK + SLOW_COLUMN : 0);
    if (!count)
        return;
    fputs("<path class=\"front\" data-tiers=\"", file);
    for (size_t i = 0; i < count; i++)
        fprintf(file, "%s%s", i ? " " : "", gn_ref_tier_name(front[i]->tier));
    fprintf(file, "\" d=\"M%.1f %.1fV%.1f", front[0]->x, panel->top, front[0]->y);
    for (size_t i = 1; i < count; i++)
        fprintf(file, "H%.1fV%.1f", front[i]->x, front[i]->y);
    fprintf(file, "H%.1f\"/>\n", right);
}

static void put_panel(FILE *file, const struct gn_accuracy *accuracy, uint32_t scene,
                      enum gn_accuracy_mode mode, bool t_error, double x, double y)
{
    struct panel panel = {.accuracy = accuracy, .scene = scene, .mode = mode, .t_error = t_error};
    size_t capacity = accuracy->row_count + GN_REF_TIER_COUNT + 1;
    panel.marks = calloc(capacity, sizeof *panel.marks);
    if (!panel.marks)
        return;
    panel.mark_count = collect(&panel, capacity);
    scale(&panel);
    panel.left = x + PLOT_LEFT;
    panel.top = y + PLOT_TOP;
    panel.right = x + PANEL_WIDTH - (panel.slow_column ? BREAK + SLOW_COLUMN : 0);
    panel.bottom = y + PANEL_HEIGHT - PLOT_BOTTOM - ZERO_ROW - BREAK;
    put_axes(file, &panel);
    for (size_t i = 0; i < panel.mark_count; i++) {
        struct mark *mark = &panel.marks[i];
        mark->x = x_of(&panel, mark->time);
        mark->y = isnan(mark->value) ? (double)NAN : y_of(&panel, mark->value);
        if (mark->large || isnan(mark->value))
            continue;
        fprintf(file, "<g class=\"dot t%d\">", (int)mark->tier);
        put_shape(file, mark->tier, mark->x, mark->y, 3.4);
        fputc('>', file);
        put_tip(file, &panel, mark);
        fprintf(file, "</%s></g>\n",
                mark->tier == GN_REF_TIER_CERTIFIED ? "circle"
                : mark->tier == GN_REF_TIER_ROBUST  ? "rect"
                                                    : "path");
    }
    put_front(file, &panel);
    for (size_t i = 0; i < panel.mark_count; i++) {
        const struct mark *mark = &panel.marks[i];
        if (!mark->large || isnan(mark->value))
            continue;
        if (!isnan(mark->median) && mark->median < mark->value)
            fprintf(file, "<path class=\"whisker t%d\" d=\"M%.1f %.1fV%.1fm-4 0h8\"/>\n", (int)mark->tier,
                    mark->x, mark->y, y_of(&panel, mark->median));
        fprintf(file, "<g class=\"t%d\">", (int)mark->tier);
        put_shape(file, mark->tier, mark->x, mark->y, 7);
        fputc('>', file);
        put_tip(file, &panel, mark);
        fprintf(file, "</%s></g>\n",
                mark->tier == GN_REF_TIER_CERTIFIED ? "circle"
                : mark->tier == GN_REF_TIER_ROBUST  ? "rect"
                                                    : "path");
        if (mark->chosen)
            fprintf(file, "<circle class=\"ring\" cx=\"%.1f\" cy=\"%.1f\" r=\"11\"/>\n", mark->x, mark->y);
        panel.taken[panel.taken_count++] = (struct box){mark->x - 9, mark->y - 9, 18, 18};
    }
    for (size_t i = 0; i < panel.mark_count; i++)
        if (panel.marks[i].large && !isnan(panel.marks[i].value))
            put_label(file, &panel, &panel.marks[i]);
    free(panel.marks);
}

void gn_accuracy_plot(FILE *file, const struct gn_accuracy *accuracy, uint32_t scene, bool alone)
{
    bool all = scene == GN_ACCURACY_ALL_SCENES;
    double head = alone ? HEAD : 52, height = head + 2 * PANEL_HEIGHT + 6;
    fprintf(
        file,
        "<svg class=\"gp\" xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%.0f\" viewBox=\"0 0 "
        "%d %.0f\" "
        "role=\"img\" aria-label=\"time per ray against wrong decisions and against the error of t\"%s>\n",
        WIDTH, height, WIDTH, height, alone ? "" : " style=\"width:100%;height:auto\"");
    if (alone)
        fprintf(file, "<style>%s</style><rect class=\"bg\" width=\"%d\" height=\"%.0f\"/>\n",
                gn_accuracy_plot_style, WIDTH, height);
    if (alone) {
        fputs("<text x=\"14\" y=\"26\" font-size=\"17\" font-weight=\"650\">What accuracy costs in time: ",
              file);
        if (all)
            fprintf(file, "%u scene%s", accuracy->scene_count, accuracy->scene_count == 1 ? "" : "s");
        else
            gn_html_text(file, accuracy->scenes[scene].name);
        fputs("</text><text class=\"soft\" x=\"14\" y=\"46\">", file);
        gn_html_text(file, accuracy->machine);
        fputs("</text>\n", file);
    }
    double y = head - 40, x = 14;
    for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
        fprintf(file, "<g class=\"t%d\">", t);
        put_shape(file, (enum gn_ref_tier)t, x + 6, y, 6);
        fprintf(file, "/></g><text x=\"%.1f\" y=\"%.1f\">%s</text>\n", x + 17, y + 4,
                gn_ref_tier_name((enum gn_ref_tier)t));
        x += 32 + 7.0 * (double)strlen(gn_ref_tier_name((enum gn_ref_tier)t));
    }
    fprintf(file,
            "<text class=\"soft\" x=\"14\" y=\"%.1f\">small mark: one kind of rays%s; large: all of them; "
            "ring: the choice for the "
            "budget; line: not beaten in both (Pareto front); thin line: down to the median</text>\n",
            y + 24, all ? " on one scene" : "");
    for (int quantity = 0; quantity < 2; quantity++)
        for (int mode = 0; mode < GN_ACCURACY_MODE_COUNT; mode++)
            put_panel(file, accuracy, scene, (enum gn_accuracy_mode)mode, quantity == 1,
                      10 + mode * (WIDTH - PANEL_WIDTH - 20), head + quantity * PANEL_HEIGHT);
    fputs("</svg>\n", file);
}
