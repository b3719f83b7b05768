/* SPDX-License-Identifier: Apache-2.0 */
/* The page of a rendered scene: pictures side by side, effects, curves of time against error. */
#include "cts/render_page.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cts/describe.h"
#include "cts/progress.h"
#include "cts/report_html_parts.h"

enum { CHART_WIDTH = 380, CHART_HEIGHT = 220, CHART_LEFT = 60, CHART_BOTTOM = 40 };

int gn_render_page_fault(const struct gn_render_page *page, char *out_error, size_t error_size)
{
    for (int e = 0; e < GN_RENDER_EFFECT_COUNT; e++) {
        if (page->plan.called >> e & 1)
            continue;
        if (page->reference.rays[e]) {
            snprintf(out_error, error_size, "%llu %s, although %s", (unsigned long long)page->reference.rays[e],
                     gn_render_effect_counted((enum gn_render_effect)e), page->plan.why[e]);
            return 1;
        }
        if (!page->forced[e].same) {
            snprintf(out_error, error_size, "forcing %s changed the picture", gn_render_effect_name((enum gn_render_effect)e));
            return 1;
        }
    }
    if (page->judged && page->judged->status != GN_CASE_PASS) {
        snprintf(out_error, error_size, "%s: %s", gn_case_status_name(page->judged->status), page->judged->message);
        return 1;
    }
    return 0;
}

void gn_render_page_print(const struct gn_render_page *page)
{
    char took[32], count[32];
    printf("%s: %s; %u x %u, depth %u, %u samples\n", page->scene->name, page->scene->text, page->options.width,
           page->options.height, page->options.depth, page->options.samples);
    printf("%s rays, %s", gn_format_grouped(page->reference.traced, count),
           gn_format_duration(page->reference.seconds, took));
    printf("; %s not traced for depth\n\n", gn_format_grouped(page->reference.pink, count));
    printf("%-13s %-7s %12s  %-26s %s\n", "effect", "called", "counted", "if forced: time, picture", "why");
    for (int e = 0; e < GN_RENDER_EFFECT_COUNT; e++) {
        const bool called = page->plan.called >> e & 1;
        char forced[64] = "";
        if (!called && page->forced[e].rays)
            snprintf(forced, sizeof forced, "%+.0f %%, %s", 100 * (page->forced[e].seconds / page->reference.seconds - 1),
                     page->forced[e].same ? "the same" : "ANOTHER");
        else if (!called)
            snprintf(forced, sizeof forced, "nothing to run, %s", page->forced[e].same ? "the same" : "ANOTHER");
        printf("%-13s %-7s %12s  %-26s %s\n", gn_render_effect_name((enum gn_render_effect)e), called ? "yes" : "no",
               gn_format_grouped(page->reference.rays[e], count), forced, page->plan.why[e]);
    }
    if (page->judged) {
        printf("\n%s: %s rays judged", page->driver_name, gn_format_grouped(page->judged->rays, count));
        for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++)
            if (page->judged->class_counts[c])
                printf(", %s %s", gn_format_grouped(page->judged->class_counts[c], count),
                       gn_ref_verdict_class_name((enum gn_ref_verdict_class)c));
        printf("\nhit errors up to %.3g units of 2^-24; the picture differs by %.3g (root of the mean square)\n",
               page->judged->hit_error_max, page->picture_error);
    }
}

/* A picture, or with `other` how far it is from that. False when it cannot be encoded. */
static bool put_picture(FILE *file, const struct gn_render_page *page, const struct gn_render_result *of,
                        const struct gn_render_result *other, const char *caption)
{
    struct gn_arena arena = {0};
    const char *png = gn_render_png(&arena, of, other, page->options.width, page->options.height);
    if (png)
        fprintf(file,
                "<figure><img alt=\"\" width=\"%u\" height=\"%u\" src=\"data:image/png;base64,%s\"><figcaption>%s</figcaption>"
                "</figure>\n",
                page->options.width, page->options.height, png, caption);
    gn_arena_finish(&arena);
    return png != NULL;
}

static void put_effects(FILE *file, const struct gn_render_page *page)
{
    char count[32];
    fprintf(file, "<h2>Effects</h2>\n<div class=wide><table><tr><th>effect<th>called for<th>counted<th>if forced<th>picture<th>why</tr>\n");
    for (int e = 0; e < GN_RENDER_EFFECT_COUNT; e++) {
        const bool called = page->plan.called >> e & 1;
        fprintf(file, "<tr><td>%s<td>%s<td>%s %s", gn_render_effect_name((enum gn_render_effect)e), called ? "yes" : "no",
                gn_format_grouped(page->reference.rays[e], count), gn_render_effect_counted((enum gn_render_effect)e));
        if (called)
            fprintf(file, "<td><td>");
        else if (!page->forced[e].rays)
            fprintf(file, "<td>nothing to run<td>%s", page->forced[e].same ? "the same" : "another");
        else
            fprintf(file, "<td>%+.0f&nbsp;%% time, %s more<td>%s",
                    100 * (page->forced[e].seconds / page->reference.seconds - 1),
                    gn_format_grouped(page->forced[e].rays, count), page->forced[e].same ? "the same" : "another");
        fprintf(file, "<td>");
        gn_html_text(file, page->plan.why[e]);
        fprintf(file, "</tr>\n");
    }
    fprintf(file, "</table></div>\n");
}

/* Error over time, both logarithmic, a labelled dot for each value. */
static void put_curve(FILE *file, const struct gn_render_curve *curve, const char *title, const char *text)
{
    double low[2] = {HUGE_VAL, HUGE_VAL}, high[2] = {0, 0};
    if (!curve->count)
        return;
    for (uint32_t i = 0; i < curve->count; i++) {
        const double at[2] = {curve->points[i].seconds, fmax(curve->points[i].error, 1e-6)};
        for (int a = 0; a < 2; a++) {
            low[a] = fmin(low[a], at[a]);
            high[a] = fmax(high[a], at[a]);
        }
    }
    fprintf(file, "<figure><svg style=\"max-width:100%%;height:auto\" viewBox=\"0 0 %d %d\" width=\"%d\" height=\"%d\" role=\"img\" font-size=\"11\">\n<title>%s</title>\n",
            CHART_WIDTH, CHART_HEIGHT, CHART_WIDTH, CHART_HEIGHT, title);
    fprintf(file, "<path d=\"M%d 10V%dH%d\" fill=\"none\" stroke=\"currentColor\"/>\n", CHART_LEFT,
            CHART_HEIGHT - CHART_BOTTOM, CHART_WIDTH - 10);
    for (int pass = 0; pass < 2; pass++) {
        if (pass == 0)
            fprintf(file, "<polyline fill=\"none\" stroke=\"#3a97cc\" stroke-width=\"2\" points=\"");
        for (uint32_t i = 0; i < curve->count; i++) {
            const double at[2] = {curve->points[i].seconds, fmax(curve->points[i].error, 1e-6)};
            double share[2];
            for (int a = 0; a < 2; a++)
                share[a] = high[a] > low[a] ? log(at[a] / low[a]) / log(high[a] / low[a]) : 0.5;
            const double x = CHART_LEFT + 15 + share[0] * (CHART_WIDTH - CHART_LEFT - 45);
            const double y = CHART_HEIGHT - CHART_BOTTOM - 15 - share[1] * (CHART_HEIGHT - CHART_BOTTOM - 40);
            if (pass == 0)
                fprintf(file, "%.1f,%.1f ", x, y);
            else
                fprintf(file, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"3\" fill=\"#3a97cc\"/><text x=\"%.1f\" y=\"%.1f\">%u</text>\n",
                        x, y, x + 5, y - 5, curve->points[i].value);
        }
        if (pass == 0)
            fprintf(file, "\"/>\n");
    }
    fprintf(file,
            "<text x=\"%d\" y=\"%d\" text-anchor=\"end\">%.2g</text><text x=\"%d\" y=\"20\" text-anchor=\"end\">%.2g</text>\n"
            "<text x=\"%d\" y=\"%d\">%.2g s</text><text x=\"%d\" y=\"%d\" text-anchor=\"end\">%.2g s</text>\n"
            "<text x=\"%d\" y=\"%d\" text-anchor=\"middle\">time</text>"
            "<text x=\"12\" y=\"%d\" transform=\"rotate(-90 12 %d)\" text-anchor=\"middle\">picture error</text></svg>\n"
            "<figcaption>%s</figcaption></figure>\n",
            CHART_LEFT - 5, CHART_HEIGHT - CHART_BOTTOM - 10, low[1], CHART_LEFT - 5, high[1], CHART_LEFT + 5,
            CHART_HEIGHT - CHART_BOTTOM + 15, low[0], CHART_WIDTH - 15, CHART_HEIGHT - CHART_BOTTOM + 15, high[0],
            CHART_WIDTH / 2, CHART_HEIGHT - 8, CHART_HEIGHT / 2, CHART_HEIGHT / 2, text);
}

static bool put_body(FILE *file, const struct gn_render_page *page)
{
    char count[32], took[32];
    bool ok = true;
    fprintf(file, "<h1>");
    gn_html_text(file, page->scene->name);
    fprintf(file, "</h1>\n<p>");
    gn_html_text(file, page->scene->text);
    fprintf(file, ": %u &times; %u pixels, %u levels of recursion (deeper rays are pink), %u samples to each light with extent; %s rays",
            page->options.width, page->options.height, page->options.depth, page->options.samples,
            gn_format_grouped(page->reference.traced, count));
    fprintf(file, " in %s.</p>\n<div class=\"pictures\">\n", gn_format_duration(page->reference.seconds, took));
    if (page->judged) {
        char caption[160];
        ok = put_picture(file, page, &page->driver, NULL, "The driver&rsquo;s rays");
        ok = put_picture(file, page, &page->reference, NULL, "The exact rays") && ok;
        snprintf(caption, sizeof caption, "The difference: white is %g or more; %.3g in the root of the mean square", GN_RENDER_HEAT_FULL,
                 page->picture_error);
        ok = put_picture(file, page, &page->driver, &page->reference, caption) && ok;
        fprintf(file, "</div>\n<h2>The driver&rsquo;s rays, one by one</h2>\n<p>");
        gn_html_text(file, page->driver_name);
        fprintf(file, ": %s rays judged, of every wave. Hit errors: median %.3g, 99.9&nbsp;%% below %.3g, up to %.3g units of 2<sup>-24</sup>; %g are allowed.</p>\n",
                gn_format_grouped(page->judged->rays, count), page->judged->hit_error_median,
                page->judged->hit_error_p999, page->judged->hit_error_max, gn_ref_verdict_bound());
        gn_html_class_bar(file, page->judged->class_counts);
        fprintf(file, "<p>");
        for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++) {
            gn_html_class_key(file, (enum gn_ref_verdict_class)c);
            fprintf(file, " %s &ensp; ", gn_format_grouped(page->judged->class_counts[c], count));
        }
        fprintf(file, "</p>\n");
    } else {
        ok = put_picture(file, page, &page->reference, NULL, "The exact rays");
        fprintf(file, "</div>\n");
    }
    put_effects(file, page);
    if (page->samples.count || page->depths.count)
        fprintf(file, "<h2>Time against error</h2>\n<div class=\"pictures\">\n");
    put_curve(file, &page->samples, "time against error over samples",
              "Samples to each light, against 256");
    put_curve(file, &page->depths, "time against error over depth", "Levels of recursion, against 12");
    if (page->samples.count || page->depths.count)
        fprintf(file, "</div>\n");
    return ok;
}

bool gn_render_page_write(const struct gn_render_page *page, const char *folder, char *out_error, size_t error_size)
{
    struct gn_arena arena = {0};
    bool ok = gn_folder_create(folder, out_error, error_size);
    const char *path = gn_arena_printf(&arena, "%s/effects.html", folder);
    FILE *file = ok ? fopen(path, "w") : NULL;
    if (file) {
        fprintf(file,
                "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" "
                "content=\"width=device-width\"><title>Gnomon: light transport</title>\n<style>%s\n.pictures{display:flex;"
                "flex-wrap:wrap;gap:1em}figure{margin:0}figure img{max-width:100%%;height:auto}figcaption{font-size:.9em}"
                "</style>\n<main>\n",
                gn_html_style);
        ok = put_body(file, page);
        fprintf(file, "</main></html>\n");
        ok = !ferror(file) && ok;
        ok = fclose(file) == 0 && ok;
        if (!ok)
            snprintf(out_error, error_size, "%s: cannot be written", path);
    } else if (ok) {
        snprintf(out_error, error_size, "%s: %s", path, strerror(errno));
        ok = false;
    }
    gn_arena_finish(&arena);
    return ok;
}
