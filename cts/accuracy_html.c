/* SPDX-License-Identifier: Apache-2.0 */
/* accuracy.html: what accuracy costs, for people; one page that needs nothing else. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cts/accuracy_driver.h"
#include "cts/accuracy_layer.h"
#include "cts/describe.h"
#include "cts/progress.h"
#include "cts/report_html_parts.h"
#include "cts/results.h"

static const struct {
    const char *what, *why;
} tiers[GN_REF_TIER_COUNT] = {
    [GN_REF_TIER_FAST] = {"Embree as it comes",
                          "32-bit floats; rays may slip through shared edges and vertices"},
    [GN_REF_TIER_ROBUST] = {"Embree's robust mode",
                            "32-bit floats with a more careful test; what the times are compared with"},
    [GN_REF_TIER_DOUBLE] = {"64-bit floats",
                            "no candidate is lost; a decision too close for 64 bits may still be wrong"},
    [GN_REF_TIER_CERTIFIED] = {"64-bit floats that know their error",
                               "exact arithmetic steps in wherever 64 bits cannot decide: no wrong decision"},
    [GN_REF_TIER_EXACT] = {"integers of any size",
                           "the judge of the others; slow, so it traces only some of the rays"},
};

static void put_tile(FILE *file, const char *class_name, const char *number, const char *label)
{
    fprintf(file, "<div class=\"tile %s\"><b>%s</b><span>%s</span></div>\n", class_name, number, label);
}

static void put_choice(FILE *file, const struct gn_accuracy *accuracy, uint32_t scene,
                       enum gn_accuracy_mode mode)
{
    char text[256];
    struct gn_accuracy_point points[GN_REF_TIER_COUNT];
    gn_accuracy_points(accuracy, scene, mode, points);
    int choice = gn_accuracy_choose(points, GN_REF_TIER_COUNT, accuracy->options.budget);
    gn_accuracy_choice_text(points, choice, accuracy->options.budget, text, sizeof text);
    gn_html_text(file, text);
}

static void put_head(FILE *file, const struct gn_accuracy *accuracy)
{
    const struct gn_accuracy_options *options = &accuracy->options;
    struct gn_accuracy_point points[GN_ACCURACY_MODE_COUNT][GN_REF_TIER_COUNT];
    int choices[GN_ACCURACY_MODE_COUNT];
    char number[32], duration[32];
    for (int mode = 0; mode < GN_ACCURACY_MODE_COUNT; mode++) {
        gn_accuracy_points(accuracy, GN_ACCURACY_ALL_SCENES, (enum gn_accuracy_mode)mode, points[mode]);
        choices[mode] = gn_accuracy_choose(points[mode], GN_REF_TIER_COUNT, options->budget);
    }
    fputs("<!DOCTYPE html>\n<html lang=en><head><meta charset=utf-8>\n"
          "<meta http-equiv=Content-Security-Policy content=\"default-src 'none'; img-src data:; style-src "
          "'unsafe-inline'\">\n"
          "<meta name=viewport content=\"width=device-width,initial-scale=1\">\n"
          "<title>Gnomon: what accuracy costs in time</title>\n<style>",
          file);
    fputs(gn_html_style, file);
    fputs(gn_accuracy_plot_style, file);
    fputs("code{white-space:nowrap}.plot{background:var(--card);border:1px solid "
          "var(--line);border-radius:8px;padding:10px;margin:14px 0;"
          "overflow-x:auto}td.zero{color:var(--good)}td.bad{color:var(--bad);font-weight:650}tr.first "
          "td{border-top:2px "
          "solid var(--line)}</style></head>\n<body><main>\n<h1>Gnomon, what accuracy costs in time</h1>\n",
          file);
    char share[2][32];
    bool right = true;
    for (int mode = 0; mode < GN_ACCURACY_MODE_COUNT; mode++)
        right = right && choices[mode] >= 0 && !points[mode][choices[mode]].wrong;
    fprintf(file,
            "<div class=\"verdict %s\">The most accurate within %g&times; the time of Embree&rsquo;s robust "
            "mode: ",
            right ? "ok" : "meh", options->budget);
    for (int mode = 0; mode < GN_ACCURACY_MODE_COUNT; mode++)
        fprintf(file, "%s%s%s&rdquo; for %s", mode ? ", " : "", choices[mode] < 0 ? "" : "tier &ldquo;",
                choices[mode] < 0 ? "&ldquo;none" : gn_ref_tier_name((enum gn_ref_tier)choices[mode]),
                mode ? "batches" : "single rays");
    fputs(".", file);
    for (int mode = 0; mode < GN_ACCURACY_MODE_COUNT; mode++) {
        fprintf(file, "<small>%s &ndash; ", mode ? "Batches" : "Single rays");
        put_choice(file, accuracy, GN_ACCURACY_ALL_SCENES, (enum gn_accuracy_mode)mode);
        int other = gn_accuracy_choose_gross(points[mode], GN_REF_TIER_COUNT, options->budget, choices[mode]);
        if (other >= 0)
            fprintf(file, ". But %s has fewer <i>gross</i> ones (rays lost, or hits made up): %s against %s per million",
                    gn_ref_tier_name((enum gn_ref_tier)other),
                    gn_accuracy_number(1e6 * (double)points[mode][other].gross / (double)points[mode][other].rays, share[0]),
                    gn_accuracy_number(1e6 * (double)points[mode][choices[mode]].gross /
                                           (double)points[mode][choices[mode]].rays, share[1]));
        fputs(".</small>", file);
    }
    fputs("</div>\n<dl class=facts><dt>Machine</dt><dd>", file);
    gn_html_text(file, accuracy->machine);
    fprintf(file, ", %u thread%s tracing</dd><dt>Run</dt><dd>", options->threads,
            options->threads == 1 ? "" : "s");
    gn_html_text(file, accuracy->started);
    fprintf(file, ", %s, seed %llu, %s rays of each kind, median of %u runs%s, gnomon ",
            gn_format_duration(accuracy->seconds, duration), (unsigned long long)options->seed,
            gn_format_grouped(options->rays, number), options->runs,
            options->quick ? ", <b>quick</b>: small scenes, the times mean little" : "");
    gn_html_text(file, gn_version());
    fputs("</dd></dl>\n<div class=tiles>\n", file);
    put_tile(file, "", gn_format_grouped(accuracy->scene_count, number), "scenes");
    put_tile(file, "", gn_format_grouped(accuracy->judged, number),
             "rays, each traced by every tier but exact");
    for (int t = 0; t < GN_REF_TIER_EXACT; t++) {
        char label[96], part[32];
        uint64_t wrong = points[0][t].wrong + points[1][t].wrong,
                 rays = points[0][t].rays + points[1][t].rays;
        uint64_t gross = points[0][t].gross + points[1][t].gross;
        snprintf(label, sizeof label, "wrong per million: %s (gross: %s)",
                 gn_ref_tier_name((enum gn_ref_tier)t),
                 gn_accuracy_number(rays ? 1e6 * (double)gross / (double)rays : 0, part));
        put_tile(file, wrong ? "no" : "",
                 gn_accuracy_number(rays ? 1e6 * (double)wrong / (double)rays : 0, number), label);
    }
    fputs("</div>\n", file);
}

static void put_explanation(FILE *file, const struct gn_accuracy *accuracy)
{
    char number[2][32];
    fputs("<h2>What is compared</h2>\n<p>A <b>tier</b> is a way to find the nearest triangle that a ray "
          "hits. All tiers trace "
          "the same rays in the same scenes, in turns.</p><table><thead><tr><th>Tier<th>How<th>What to "
          "expect</tr></thead>"
          "<tbody>\n",
          file);
    for (int t = 0; t < GN_REF_TIER_COUNT; t++)
        fprintf(file, "<tr><td><b>%s</b><td>%s<td>%s</tr>\n", gn_ref_tier_name((enum gn_ref_tier)t),
                tiers[t].what, tiers[t].why);
    fprintf(file,
            "</tbody></table>\n<p>A decision is <b>wrong</b> when a hit is missed, when there is a hit where "
            "exactly there is "
            "none, or when another triangle is named than one of the nearest; of triangles that are hit at "
            "exactly the same "
            "distance any is right. It is judged against exact arithmetic. Most often a neighbour is "
            "named where the ray passes close to a shared edge, which no picture shows. All else is "
            "<b>gross</b>: the hit is lost, "
            "invented, or on a triangle that does not touch the right one: the ray slipped through the "
            "surface, or past a silhouette that it should "
            "have met. The <b>error of t</b> is how far the distance of a "
            "right hit is off, in units of the last place of a 32-bit float: rounding alone makes up to 0.5. "
            "What is below "
            "10<sup>-4</sup> is drawn as nothing: the judge itself is known to that.</p>\n<p>Rays are aimed "
            "at the "
            "<b>interior</b> of triangles, at <b>edges</b> and <b>vertices</b>, where triangles meet and "
            "rays like to be lost, "
            "and at <b>random</b> points of the scene&rsquo;s box. None may be lost, however it is aimed. "
            "<b>Single</b>: a ray "
            "per call. <b>Batch</b>: many rays per call, of which a tier may have several under way at "
            "once.</p>\n"
            "<p class=\"soft small\">The exact tier was asked about %s of the %s rays: the first ones of "
            "each kind, and such on "
            "which tiers disagree. For the others the certified answer is taken as right. No wrong answer "
            "among n rays still "
            "allows for 3/n at 95 %% confidence, which is the &ldquo;below&rdquo; of the choices.</p>\n",
            gn_format_grouped(accuracy->judged_exactly, number[0]),
            gn_format_grouped(accuracy->judged, number[1]));
}

static void put_choices(FILE *file, const struct gn_accuracy *accuracy)
{
    fprintf(file,
            "<h2>The choice for this budget</h2>\n<p>The most accurate tier that takes at most %g times the "
            "time of robust: the "
            "one with the fewest wrong decisions, then the smallest largest error of t; of equals the one "
            "that promises most. "
            "<code>--budget</code> sets another.</p>\n<div class=wide><table><thead><tr><th>Scene<th>Single "
            "rays<th>Batches"
            "</tr></thead><tbody>\n",
            accuracy->options.budget);
    for (uint32_t i = 0; i <= accuracy->scene_count; i++) {
        bool all = i == accuracy->scene_count;
        fprintf(file, "<tr%s><td>", all ? " class=total" : "");
        gn_html_text(file, all ? "all scenes" : accuracy->scenes[i].name);
        for (int mode = 0; mode < GN_ACCURACY_MODE_COUNT; mode++) {
            fputs("<td>", file);
            put_choice(file, accuracy, all ? GN_ACCURACY_ALL_SCENES : i, (enum gn_accuracy_mode)mode);
        }
        fputs("</tr>\n", file);
    }
    fputs("</tbody></table></div>\n", file);
}

static void put_wrong(FILE *file, const struct gn_accuracy_row *row)
{
    char number[4][32];
    uint64_t wrong = gn_accuracy_row_wrong(row);
    fprintf(
        file,
        "<td class=\"n %s\" title=\"%s of %s rays: %llu lost, %llu invented, %llu a neighbour, %llu another "
        "triangle\">%s",
        wrong ? "bad" : "zero", gn_format_grouped(wrong, number[0]), gn_format_grouped(row->rays, number[1]),
        (unsigned long long)row->lost, (unsigned long long)row->invented, (unsigned long long)row->neighbour,
        (unsigned long long)row->other,
        gn_accuracy_number(row->rays ? 1e6 * (double)wrong / (double)row->rays : 0, number[2]));
}

static const struct gn_accuracy_row *row_of(const struct gn_accuracy *accuracy, uint32_t scene, int aim,
                                            int mode, int tier)
{
    for (size_t i = 0; i < accuracy->row_count; i++) {
        const struct gn_accuracy_row *row = &accuracy->rows[i];
        if (row->scene == scene && (int)row->aim == aim && (int)row->mode == mode && (int)row->tier == tier)
            return row;
    }
    return NULL;
}

static void put_scene(FILE *file, const struct gn_accuracy *accuracy, uint32_t scene)
{
    const struct gn_accuracy_scene *what = &accuracy->scenes[scene];
    char number[4][32];
    fputs("<details class=case><summary><h3>", file);
    gn_html_text(file, what->name);
    fprintf(file, "</h3><span class=soft>%s triangle%s &ndash; ",
            gn_format_grouped(what->triangles, number[0]), what->triangles == 1 ? "" : "s");
    gn_html_text(file, what->about);
    fputs("</span></summary><div class=body>\n<div class=plot>", file);
    gn_accuracy_plot(file, accuracy, scene, false);
    fputs("</div>\n<div class=wide><table><thead><tr><th>Rays<th>Tier<th class=n>Single<br>Mray/s<th "
          "class=n>&times; robust"
          "<th class=n>Batch<br>Mray/s<th class=n>&times; robust<th class=n>Wrong per million<br>single<th "
          "class=n><br>batch"
          "<th class=n>of which<br>gross<th class=n>t error, ulp<br>median<th "
          "class=n><br>largest</tr></thead><tbody>\n",
          file);
    for (int aim = 0; aim < GN_AIM_COUNT; aim++) {
        for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
            const struct gn_accuracy_row *single = row_of(accuracy, scene, aim, GN_ACCURACY_SINGLE, t);
            const struct gn_accuracy_row *batch = row_of(accuracy, scene, aim, GN_ACCURACY_BATCH, t);
            if (!single || !batch)
                continue;
            fprintf(file, "<tr%s><td>%s<td>%s<td class=n>%s<td class=n>%.2f<td class=n>%s<td class=n>%.2f",
                    t ? "" : " class=first", t ? "" : gn_accuracy_aim_name((enum gn_aim)aim),
                    gn_ref_tier_name((enum gn_ref_tier)t), gn_accuracy_number(single->mrays_per_s, number[0]),
                    single->ratio_to_robust, gn_accuracy_number(batch->mrays_per_s, number[1]),
                    batch->ratio_to_robust);
            put_wrong(file, single);
            put_wrong(file, batch);
            fprintf(file, "<td class=n>%s",
                    gn_accuracy_number(
                        batch->rays ? 1e6 * (double)gn_accuracy_row_gross(batch) / (double)batch->rays : 0,
                        number[2]));
            fprintf(file, "<td class=n>%s<td class=n>%s</tr>\n",
                    gn_accuracy_number(batch->t_error_median, number[2]),
                    gn_accuracy_number(fmax(single->t_error_max, batch->t_error_max), number[3]));
        }
    }
    fputs("</tbody></table></div>\n<table><thead><tr><th>Tier<th class=n>Build<th class=n>Memory<th "
          "class=n>Bytes per triangle"
          "</tr></thead><tbody>\n",
          file);
    for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
        const struct gn_accuracy_row *row = row_of(accuracy, scene, 0, 0, t);
        if (row)
            fprintf(file, "<tr><td>%s<td class=n>%.3f s<td class=n>%.1f MB<td class=n>%.1f</tr>\n",
                    gn_ref_tier_name((enum gn_ref_tier)t), row->build_seconds, (double)row->bytes * 1e-6,
                    (double)row->bytes / (double)what->triangles);
    }
    fputs("</tbody></table></div></details>\n", file);
}

bool gn_accuracy_html_write(const struct gn_accuracy *accuracy, const char *path, char *out_error,
                            size_t error_size)
{
    char *page = NULL;
    size_t length = 0;
    FILE *file = open_memstream(&page, &length);
    if (!file) {
        snprintf(out_error, error_size, "out of memory for %s", path);
        return false;
    }
    put_head(file, accuracy);
    fputs("<h2>Time against accuracy</h2>\n<p>Left is faster, down is more accurate: the best place is the "
          "lower left corner. "
          "Axes are logarithmic; below the break, nothing is wrong at all. Of the tiers on the line none is "
          "beaten in both; "
          "the shaded part is within the budget. Point at a mark for its numbers.</p>\n<div class=plot>",
          file);
    gn_accuracy_plot(file, accuracy, GN_ACCURACY_ALL_SCENES, false);
    fputs("</div>\n", file);
    put_choices(file, accuracy);
    put_explanation(file, accuracy);
    fputs("<h2>Scene by scene</h2>\n<p>Point at a number of wrong decisions for what they were.</p>\n", file);
    for (uint32_t i = 0; i < accuracy->scene_count; i++)
        put_scene(file, accuracy, i);
    if (accuracy->driver)
        gn_accuracy_driver_html(file, accuracy);
    if (accuracy->layer)
        gn_accuracy_layer_html(file, accuracy);
    fputs("<p class=\"soft small\">The same as data: accuracy.json beside this page; the plot: accuracy.svg, "
          "accuracy.png."
          "</p>\n</main></body></html>\n",
          file);
    return gn_file_write_stream(path, file, &page, &length, out_error, error_size);
}
