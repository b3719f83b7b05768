/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The curves of sweeps: over the values of the parameter, how near the answers come to the bound (above) and what
 * they are (below). All curves share one vertical scale, so that they can be compared.
 */
#include "cts/report_html_curves.h"

#include <math.h>
#include <string.h>

#include "cts/describe.h"
#include "cts/report_html_parts.h"

enum { WIDTH = 540, LEFT = 56, RIGHT = 526, TOP = 10, BOTTOM = 160, BAR_TOP = 184, BAR_BOTTOM = 204 };
enum { ROW_TOP = BAR_BOTTOM + 3, ROW = 11, HEIGHT = ROW_TOP + GN_REF_TIER_COUNT * ROW };

/* The vertical scale, in units of 2^-24. */
static const double least = 0.01, most = 1000;

static double at_y(double units)
{
    double clamped = units > least ? (units < most ? units : most) : least;
    return BOTTOM - (BOTTOM - TOP) * log(clamped / least) / log(most / least);
}

/* Logarithmic where the values allow it, else one after the other. They run from the easiest to the hardest. */
static double at_x(const struct gn_case_curve *curve, uint32_t i)
{
    double first = curve->points[0].value, last = curve->points[curve->count - 1].value, part;
    double whole = first > 0 && last > 0 ? log(last / first) : NAN;
    part = curve->points[i].value > 0 ? log(curve->points[i].value / first) / whole : NAN;
    if (!(part >= 0 && part <= 1))
        part = curve->count > 1 ? (double)i / (curve->count - 1) : 0.5;
    return LEFT + 12 + (RIGHT - LEFT - 24) * part;
}

/* Large and small powers of two are written as such. */
static const char *value_text(double value, char *buffer, size_t size)
{
    int exponent;
    if (isfinite(value) && frexp(value, &exponent) == 0.5 && (exponent > 11 || exponent < -5))
        snprintf(buffer, size, "2^%d", exponent - 1);
    else
        snprintf(buffer, size, "%.4g", value);
    return buffer;
}

/* How many points are judged; they come first. */
static uint32_t judged_count(const struct gn_case_curve *curve)
{
    uint32_t count = 0;
    while (count < curve->count && curve->points[count].judged)
        count++;
    return count;
}

static void put_axes(FILE *file, const struct gn_case_curve *curve)
{
    double bound = gn_ref_verdict_bound();
    uint32_t judged = judged_count(curve);
    if (judged) {
        double end = judged == curve->count ? RIGHT : (at_x(curve, judged - 1) + at_x(curve, judged)) / 2;
        fprintf(file, "<rect x=%d y=%d width=%.1f height=%d fill=\"#009E73\" fill-opacity=.13 />", LEFT, TOP, end - LEFT,
                HEIGHT - TOP);
    }
    for (double units = least; units <= most * 1.001; units *= 10)
        fprintf(file,
                "<line x1=%d x2=%d y1=%.1f y2=%.1f stroke=\"#808080\" stroke-opacity=.25 /><text x=%d y=%.1f "
                "text-anchor=end>%g</text>",
                LEFT, RIGHT, at_y(units), at_y(units), LEFT - 4, at_y(units) + 4, units);
    fprintf(file, "<line x1=%d x2=%d y1=%.1f y2=%.1f stroke=\"#D55E00\" stroke-width=2><title>the bound, %g</title></line>",
            LEFT, RIGHT, at_y(bound), at_y(bound), bound);
    double written = -1000;
    for (uint32_t i = 0; i < curve->count; i++) {
        char text[32];
        double x = at_x(curve, i);
        fprintf(file, "<line x1=%.1f x2=%.1f y1=%d y2=%d stroke=\"#808080\" />", x, x, BOTTOM, BOTTOM + 4);
        if (x - written < 44)
            continue;
        written = x;
        fprintf(file, "<text x=%.1f y=%d text-anchor=middle>", x, BOTTOM + 16);
        gn_html_text(file, value_text(curve->points[i].value, text, sizeof text));
        fputs("</text>", file);
    }
}

/* Who answers: the driver, or a tier (their number). */
enum { DRIVER = -1 };

static const char *const tier_colours[GN_REF_TIER_COUNT] = {"#d07a00", "#0072b2", "#8a5bb5", "#00895e", "#5b6670"};

static bool tier_asked(const struct gn_case_curve *curve, int tier)
{
    return curve->points[0].tiers[tier].rays > 0;
}

/* How near the answers come to the bound: the largest of hit errors and margins. */
static double worst_of(const struct gn_case_point *point, int who)
{
    return who == DRIVER ? fmax(point->held_error_max, point->margin_max)
                         : fmax(point->tiers[who].held_error_max, point->tiers[who].margin_max);
}

static double median_of(const struct gn_case_point *point, int who)
{
    (void)who;
    return point->hit_error_median;
}

static void put_line(FILE *file, const struct gn_case_curve *curve, double (*quantity)(const struct gn_case_point *, int),
                     int who, const char *colour, double width)
{
    bool any = false;
    for (uint32_t i = 0; i < curve->count; i++)
        any = any || quantity(&curve->points[i], who) > least;
    if (!any)
        return;
    fprintf(file, "<polyline fill=none stroke=\"%s\" stroke-width=%.1f points=\"", colour, width);
    for (uint32_t i = 0; i < curve->count; i++)
        fprintf(file, "%.1f,%.1f ", at_x(curve, i), at_y(quantity(&curve->points[i], who)));
    fputs("\"/>", file);
    for (uint32_t i = 0; i < curve->count; i++) {
        char text[32];
        double units = quantity(&curve->points[i], who);
        if (!(units > least))
            continue;
        fprintf(file, "<circle cx=%.1f cy=%.1f r=%.1f fill=\"%s\"><title>%s, ", at_x(curve, i), at_y(units), width + .6,
                colour, who == DRIVER ? "driver" : gn_ref_tier_name((enum gn_ref_tier)who));
        gn_html_text(file, value_text(curve->points[i].value, text, sizeof text));
        fprintf(file, ": %.3g</title></circle>", units);
    }
}

/* A row of cells per tier, below the driver's bars: the worst of its answers at each value. */
static void put_tier_rows(FILE *file, const struct gn_case_curve *curve, double width)
{
    int row = 0;
    for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
        if (!tier_asked(curve, t))
            continue;
        const char *name = gn_ref_tier_name((enum gn_ref_tier)t);
        double y = ROW_TOP + ROW * row++;
        fprintf(file, "<text x=%d y=%.1f text-anchor=end font-size=10 fill=\"%s\">%s</text>", LEFT - 4, y + ROW - 3,
                tier_colours[t], name);
        for (uint32_t i = 0; i < curve->count; i++) {
            const struct gn_case_tier *tier = &curve->points[i].tiers[t];
            char text[32];
            int worst = GN_REF_VERDICT_CLASS_COUNT - 1;
            while (worst > 0 && !tier->class_counts[worst])
                worst--;
            if (!tier->rays)
                continue;
            fprintf(file, "<rect x=%.1f y=%.1f width=%.1f height=%d fill=\"#%06X\"><title>%s, ", at_x(curve, i) - width / 2,
                    y, width, ROW - 2, gn_picture_colour((uint8_t)worst), name);
            gn_html_text(file, value_text(curve->points[i].value, text, sizeof text));
            for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++)
                if (tier->class_counts[c])
                    fprintf(file, "; %llu of %llu rays %s", (unsigned long long)tier->class_counts[c],
                            (unsigned long long)tier->rays, gn_ref_verdict_class_name((enum gn_ref_verdict_class)c));
            fputs("</title></rect>", file);
        }
    }
}

/* One stacked bar for each value. What is there at all is at least a sliver. */
static void put_bars(FILE *file, const struct gn_case_curve *curve, double width)
{
    fprintf(file, "<text x=%d y=%d text-anchor=end font-size=10>driver</text>", LEFT - 4, BAR_BOTTOM - 6);
    for (uint32_t i = 0; i < curve->count; i++) {
        const struct gn_case_point *point = &curve->points[i];
        double y = BAR_BOTTOM, height = BAR_BOTTOM - BAR_TOP, slivers = 0, large = 0, sizes[GN_REF_VERDICT_CLASS_COUNT];
        char text[32];
        if (!point->rays)
            continue;
        for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++) {
            double part = (double)point->class_counts[c] / (double)point->rays * height;
            sizes[c] = point->class_counts[c] && part < 3 ? 3 : 0;
            slivers += sizes[c];
            large += sizes[c] > 0 ? 0 : part;
        }
        for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++) {
            if (!point->class_counts[c])
                continue;
            double part = (double)point->class_counts[c] / (double)point->rays * height;
            double h = sizes[c] > 0 ? sizes[c] : part / large * fmax(0, height - slivers);
            y -= h;
            fprintf(file, "<rect x=%.1f y=%.1f width=%.1f height=%.1f fill=\"#%06X\"><title>", at_x(curve, i) - width / 2,
                    y, width, h, gn_picture_colour((uint8_t)c));
            gn_html_text(file, value_text(point->value, text, sizeof text));
            fprintf(file, ": %llu of %llu rays %s</title></rect>", (unsigned long long)point->class_counts[c],
                    (unsigned long long)point->rays, gn_ref_verdict_class_name((enum gn_ref_verdict_class)c));
        }
    }
}

static void put_value(FILE *file, const struct gn_case_curve *curve, double value)
{
    char text[32];
    gn_html_text(file, value_text(value, text, sizeof text));
    if (curve->unit[0]) {
        fputs(" ", file);
        gn_html_text(file, curve->unit);
    }
}

/* "Tiers of the reference: fast leaves it from 10, robust from 1e+04; double, certified, exact do not." */
static void put_tiers_in_words(FILE *file, const struct gn_case_curve *curve)
{
    static const char *const openings[2] = {"leaves it from ", "from "};
    uint32_t leaving = 0, staying = 0;
    for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
        const struct gn_case_point *left = gn_case_curve_tier_left(curve, (enum gn_ref_tier)t);
        if (!left)
            continue;
        fprintf(file, "%s%s %s", leaving ? ", " : "Tiers of the reference: ", gn_ref_tier_name((enum gn_ref_tier)t),
                openings[leaving > 0]);
        put_value(file, curve, left->value);
        leaving++;
    }
    for (int t = 0; t < GN_REF_TIER_COUNT && leaving; t++)
        if (tier_asked(curve, t) && !gn_case_curve_tier_left(curve, (enum gn_ref_tier)t))
            fprintf(file, "%s%s", staying++ ? ", " : "; ", gn_ref_tier_name((enum gn_ref_tier)t));
    if (leaving)
        fputs(staying ? " nowhere. " : ". ", file);
    else if (tier_asked(curve, 0))
        fputs("No tier of the reference leaves it. ", file);
}

/* In words, for those who do not read curves. */
static void put_caption(FILE *file, const struct gn_case_curve *curve)
{
    const struct gn_case_point *left = gn_case_curve_left(curve);
    uint32_t judged = judged_count(curve);
    char number[2][32];
    fputs("<figcaption style=\"max-width:540px\">", file);
    gn_html_text(file, curve->parameter);
    if (left) {
        uint64_t wrong = left->class_counts[GN_REF_WRONG];
        uint64_t leaks = left->class_counts[GN_REF_LEAK] + left->class_counts[GN_REF_DOUBLE_HIT];
        fprintf(file, ": <b%s>answers leave the bound first at ", left->judged ? " style=\"color:var(--bad)\"" : "");
        put_value(file, curve, left->value);
        fputs("</b>, ", file);
        if (wrong)
            fprintf(file, "%s of %s rays wrong", gn_format_grouped(wrong, number[0]),
                    gn_format_grouped(left->rays, number[1]));
        if (leaks)
            fprintf(file, "%s%s of %s rays leaked", wrong ? " and " : "", gn_format_grouped(leaks, number[0]),
                    gn_format_grouped(left->rays, number[1]));
        fputs(left->judged ? "." : ", beyond what is judged.", file);
    } else {
        fputs(": no answer leaves the bound up to ", file);
        put_value(file, curve, curve->points[curve->count - 1].value);
        fputs(".", file);
    }
    fputs("<br><span class=soft>", file);
    put_tiers_in_words(file, curve);
    if (!judged) {
        fputs("Nothing is judged: ", file);
    } else {
        fputs("Judged from ", file);
        put_value(file, curve, curve->points[0].value);
        fputs(" to ", file);
        put_value(file, curve, curve->points[judged - 1].value);
        fputs(": ", file);
    }
    gn_html_text(file, curve->why);
    fputs(".</span></figcaption>", file);
}

void gn_html_curve(FILE *file, const struct gn_case_curve *curve)
{
    if (!curve->count)
        return;
    const struct gn_case_point *left = gn_case_curve_left(curve);
    fprintf(file,
            "<figure><svg viewBox=\"0 0 %d %d\" width=%d height=%d style=\"max-width:100%%;height:auto\" role=img "
            "font-size=11 fill=\"currentColor\" aria-label=\"",
            WIDTH, HEIGHT, WIDTH, HEIGHT);
    gn_html_text(file, curve->parameter);
    fputs("\">", file);
    put_axes(file, curve);
    if (left) {
        double x = at_x(curve, (uint32_t)(left - curve->points));
        fprintf(file, "<line x1=%.1f x2=%.1f y1=%d y2=%d stroke=\"#D00000\" stroke-width=1.5 stroke-dasharray=\"2 3\"/>", x,
                x, TOP, BAR_BOTTOM);
        fprintf(file, "<text x=%.1f y=%d fill=\"#D00000\" text-anchor=%s>the driver leaves it</text>", x + (x > WIDTH / 2 ? -4 : 4), TOP + 9,
                x > WIDTH / 2 ? "end" : "start");
    }
    double width = 22;
    for (uint32_t i = 1; i < curve->count; i++)
        width = fmin(width, fmax(3, 0.85 * (at_x(curve, i) - at_x(curve, i - 1))));
    for (int t = GN_REF_TIER_COUNT - 1; t >= 0; t--)
        if (tier_asked(curve, t))
            put_line(file, curve, worst_of, t, tier_colours[t], 1.2);
    put_line(file, curve, median_of, DRIVER, "#a0a0a0", 1.2);
    put_line(file, curve, worst_of, DRIVER, "currentColor", 2.4);
    put_bars(file, curve, width);
    put_tier_rows(file, curve, width);
    fputs("</svg>", file);
    put_caption(file, curve);
    fputs("</figure>\n", file);
}

void gn_html_curves(FILE *file, const struct gn_results *results)
{
    size_t total = 0;
    for (size_t i = 0; i < results->count; i++)
        total += results->cases[i].curve.count > 0;
    if (!total)
        return;
    fprintf(file,
            "<h2>Stability (%zu)</h2>\n<p>Sweeps: a parameter grows from left to right, on a logarithmic scale, until "
            "answers leave the bound. The thick line is the driver: the largest hit error or margin of its answers, in units "
            "of 2<sup>-24</sup>, cut off at %g and %g; below the orange line (%g) an answer is within the bound. The thin "
            "lines are the tiers of the reference on the first fifth of the same rays (the exact one on fewer), by the same "
            "verdict. Below are the verdicts: the driver's as bars, of each tier the worst. The status of the case is the "
            "driver's over the shaded range, which was stated beforehand; all else informs only.</p>\n<p class=small>",
            total, least, most, gn_ref_verdict_bound());
    static const struct {
        const char *colour, *words;
    } keys[] = {{"currentColor", "driver, largest"},
                {"#a0a0a0", "driver, median"},
                {"#D55E00", "the bound"},
                {"#D00000", "first value at which the driver leaves it"}};
    for (size_t k = 0; k < sizeof keys / sizeof keys[0]; k++)
        fprintf(file, "<span class=key><i style=\"background:%s\"></i>%s</span> ", keys[k].colour, keys[k].words);
    for (int t = 0; t < GN_REF_TIER_COUNT; t++)
        fprintf(file, "<span class=key><i style=\"background:%s\"></i>%s</span> ", tier_colours[t],
                gn_ref_tier_name((enum gn_ref_tier)t));
    fputs("<br>", file);
    for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++)
        fprintf(file, "<span class=key><i style=\"background:#%06X\"></i>%s</span> ", gn_picture_colour((uint8_t)c),
                gn_ref_verdict_class_name((enum gn_ref_verdict_class)c));
    fputs("</p>\n<div style=\"display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,440px),1fr));"
          "gap:14px 26px\">\n",
          file);
    for (size_t i = 0; i < results->count; i++) {
        const struct gn_results_case *cs = &results->cases[i];
        if (!cs->curve.count)
            continue;
        fprintf(file, "<div><h3 style=\"font-size:14px\">");
        gn_html_text(file, cs->name);
        fprintf(file, " <span class=\"badge %s\">%s</span></h3>",
                cs->status == GN_CASE_PASS ? "ok" : cs->status == GN_CASE_SKIP ? "meh" : "no",
                gn_case_status_name(cs->status));
        gn_html_curve(file, &cs->curve);
        fputs("</div>\n", file);
    }
    fputs("</div>\n", file);
}
