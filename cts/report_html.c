/* SPDX-License-Identifier: Apache-2.0 */
/* report.html: one page that needs nothing else, for people. The verdict first, then where it comes from. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cts/describe.h"
#include "cts/progress.h"
#include "cts/report_html_curves.h"
#include "cts/report_html_parts.h"
#include "cts/results.h"

/* Failures beyond these are folded. */
#define MOST_OPEN 6
#define MOST_SLOWEST 10

static void text(FILE *file, const char *string)
{
    gn_html_text(file, string);
}

static const char *grouped(uint64_t value)
{
    static char buffers[4][32];
    static unsigned next;
    return gn_format_grouped(value, buffers[next++ % 4]);
}

/* "99.98 %" without ever rounding to a full hundred or nothing. */
static const char *share(uint64_t part, uint64_t whole)
{
    static char buffers[4][32];
    static unsigned next;
    char *out = buffers[next++ % 4];
    double percent = whole ? 100 * (double)part / (double)whole : 0;
    if (whole == 0)
        snprintf(out, 32, "-");
    else if (part == 0)
        snprintf(out, 32, "0 %%");
    else if (part == whole)
        snprintf(out, 32, "100 %%");
    else if (percent > 99.99)
        snprintf(out, 32, "&gt; 99.99 %%");
    else if (percent < 0.01)
        snprintf(out, 32, "&lt; 0.01 %%");
    else
        snprintf(out, 32, "%.2f %%", percent);
    return out;
}

static const char *status_class(enum gn_case_status status)
{
    return status == GN_CASE_PASS ? "ok" : status == GN_CASE_SKIP ? "meh" : "no";
}

static void put_badge(FILE *file, const struct gn_results_case *cs)
{
    if (cs->outcome == GN_OUTCOME_UNEXPECTED_PASS)
        fputs("<span class=\"badge no\">unexpected pass</span>", file);
    else if (cs->outcome == GN_OUTCOME_EXPECTED_FAILURE)
        fprintf(file, "<span class=\"badge meh\">expected %s</span>", gn_case_status_name(cs->status));
    else
        fprintf(file, "<span class=\"badge %s\">%s</span>", status_class(cs->status),
                gn_case_status_name(cs->status));
}

static void put_tile(FILE *file, const char *class_name, const char *number, const char *label)
{
    fprintf(file, "<div class=\"tile %s\"><b>%s</b><span>%s</span></div>\n", class_name, number, label);
}

static void put_head(FILE *file, const struct gn_results *results)
{
    const struct gn_results_run *run = &results->run;
    struct gn_results_totals totals = gn_results_totals(results);
    int exit_status = gn_results_exit_status(results);
    char verdict[1024], duration[32];
    gn_results_verdict(results, verdict, sizeof verdict);
    fputs("<!DOCTYPE html>\n<html lang=en><head><meta charset=utf-8>\n"
          "<meta http-equiv=Content-Security-Policy content=\"default-src 'none'; img-src data:; style-src "
          "'unsafe-inline'; script-src 'unsafe-inline'\">\n"
          "<meta name=viewport content=\"width=device-width,initial-scale=1\">\n<title>Gnomon: ",
          file);
    text(file, verdict);
    fputs("</title>\n<style>", file);
    fputs(gn_html_style, file);
    fputs("</style></head>\n<body><main>\n<h1>Gnomon, ray tracing conformance</h1>\n", file);

    /* Green is for a driver that is right, not for one whose faults are known. */
    const bool known = exit_status == 0 && totals.expected_failures > 0;
    fprintf(file, "<div class=\"verdict %s\">", exit_status == 1 ? "no" : exit_status == 0 && !known ? "ok" : "meh");
    text(file, verdict);
    if (known) {
        uint64_t wrong = 0;
        for (size_t i = 0; i < results->count; i++)
            wrong += results->cases[i].outcome == GN_OUTCOME_EXPECTED_FAILURE
                         ? results->cases[i].class_counts[GN_REF_WRONG] + results->cases[i].class_counts[GN_REF_LEAK] +
                               results->cases[i].class_counts[GN_REF_DOUBLE_HIT]
                         : 0;
        fprintf(file, "<small><b>As expected, but not right:</b> %s case%s of this driver %s known to go wrong, with %s ray%s; "
                      "nothing else did. <a href=\"#expected\">Which, and why</a></small>",
                grouped(totals.expected_failures), totals.expected_failures == 1 ? "" : "s",
                totals.expected_failures == 1 ? "is" : "are", grouped(wrong), wrong == 1 ? "" : "s");
    }
    fputs("<small>", file);
    text(file, run->device.name);
    fprintf(file, " answered %s rays: %s exactly right, %s allowed by the rounding of floating point, ",
            grouped(totals.rays), share(totals.class_counts[GN_REF_EXACT], totals.rays),
            share(totals.class_counts[GN_REF_ADMISSIBLE] + totals.class_counts[GN_REF_GAP], totals.rays));
    fprintf(file, "%s wrong, %s leaked through shared edges or vertices.</small></div>\n",
            grouped(totals.class_counts[GN_REF_WRONG]),
            grouped(totals.class_counts[GN_REF_LEAK] + totals.class_counts[GN_REF_DOUBLE_HIT]));

    fputs("<dl class=facts><dt>Device</dt><dd>", file);
    text(file, run->device.name);
    fputs("</dd><dt>Driver</dt><dd>", file);
    text(file, run->device.driver_name);
    fputs(" ", file);
    text(file, run->device.driver_info);
    fputs("</dd><dt>Run</dt><dd>", file);
    text(file, run->started);
    fprintf(file, ", %s, seed %llu, %u worker%s, gnomon ", gn_format_duration(results->seconds, duration),
            (unsigned long long)run->seed, run->jobs, run->jobs == 1 ? "" : "s");
    text(file, run->version);
    fputs("</dd></dl>\n<div class=tiles>\n", file);

    uint64_t counting[GN_CASE_STATUS_COUNT] = {0};
    for (size_t i = 0; i < results->count; i++)
        counting[results->cases[i].status] += results->cases[i].outcome == GN_OUTCOME_UNEXPECTED;
    uint64_t crashed = counting[GN_CASE_CRASH] + counting[GN_CASE_TIMEOUT] + counting[GN_CASE_ERROR];
    put_tile(file, "", grouped(totals.by_status[GN_CASE_PASS]), "cases passed");
    put_tile(file, counting[GN_CASE_FAIL] ? "no" : "", grouped(counting[GN_CASE_FAIL]), "failed");
    put_tile(file, counting[GN_CASE_LEAK] ? "no" : "", grouped(counting[GN_CASE_LEAK]), "leaked");
    put_tile(file, crashed ? "no" : "", grouped(crashed), "crashed, stuck or in error");
    if (totals.unexpected_passes)
        put_tile(file, "no", grouped(totals.unexpected_passes), "passed unexpectedly");
    put_tile(file, "", grouped(totals.by_status[GN_CASE_SKIP]), "skipped");
    if (totals.expected_failures)
        put_tile(file, "meh", grouped(totals.expected_failures), "failed as expected");
    put_tile(file, "", grouped(totals.rays), "rays judged");
    put_tile(file, "", share(totals.ideal_hits, totals.rays), "of them ideally hit something");
    fputs("</div>\n", file);
    for (size_t i = 0; i < results->note_count; i++) {
        fputs("<p><b>Note:</b> ", file);
        text(file, results->notes[i]);
        fputs("</p>\n", file);
    }
}

static void put_meaning(FILE *file)
{
    static const char *const meanings[GN_REF_VERDICT_CLASS_COUNT] = {
        [GN_REF_EXACT] = "the answer of exact arithmetic; its numbers are within the bound",
        [GN_REF_ADMISSIBLE] =
            "not the exact one, at a decision so close that rounding may take it either way",
        [GN_REF_GAP] = "a hit lost at a border or a silhouette, that close: allowed, and counted",
        [GN_REF_LEAK] =
            "a hit lost between triangles that share an edge or a vertex and leave no way through",
        [GN_REF_DOUBLE_HIT] = "one crossing of a shared edge or vertex presented twice",
        [GN_REF_WRONG] = "no rounding explains it",
    };
    fputs("<h2>How answers are judged</h2>\n<p>Each ray is also traced in exact arithmetic. An answer is "
          "right when it "
          "is the exact one, or when moving the numbers of the problem by a few units of 2<sup>-24</sup> of "
          "their size, as "
          "the rounding of 32-bit floats does, would make it so. The bound is derived from the arithmetic, "
          "not tuned.</p>\n"
          "<div class=meaning>",
          file);
    for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++) {
        gn_html_class_key(file, (enum gn_ref_verdict_class)c);
        fprintf(file, "<span>%s</span>\n", meanings[c]);
    }
    fputs("</div>\n", file);
}

struct family_median {
    double value;
    uint64_t rays;
};

struct family {
    const char *name;
    const char *backend; /* of its cases' names, which begin with it; NULL: none */
    uint64_t cases, by_status[GN_CASE_STATUS_COUNT], rays, ideal_hits, classes[GN_REF_VERDICT_CLASS_COUNT];
    double p999, max;
    struct family_median *medians; /* of its cases */
    size_t median_count;
};

static int family_median_compare(const void *left, const void *right)
{
    const struct family_median *a = left, *b = right;
    return a->value < b->value ? -1 : a->value > b->value;
}

/* Of the cases' medians, each with the weight of its rays: one case that went wrong does not move it. */
static double family_median(const struct family *family)
{
    uint64_t all = 0, until = 0;
    if (!family->median_count)
        return 0;
    qsort(family->medians, family->median_count, sizeof *family->medians, family_median_compare);
    for (size_t i = 0; i < family->median_count; i++)
        all += family->medians[i].rays;
    size_t at = 0;
    while ((until += family->medians[at].rays) < (all + 1) / 2)
        at++;
    return family->medians[at].value;
}

static void family_add(struct family *family, const struct gn_results_case *cs)
{
    family->cases++;
    family->by_status[cs->status]++;
    family->rays += cs->rays;
    family->ideal_hits += cs->ideal_hits;
    for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++)
        family->classes[c] += cs->class_counts[c];
    struct family_median *grown =
        cs->hit_error_max > 0 ? realloc(family->medians, (family->median_count + 1) * sizeof *grown) : NULL;
    if (grown) {
        family->medians = grown;
        grown[family->median_count++] = (struct family_median){cs->hit_error_median, cs->rays};
    }
    family->p999 = fmax(family->p999, cs->hit_error_p999);
    family->max = fmax(family->max, cs->hit_error_max);
}

static void put_family(FILE *file, const struct family *f, uint64_t all_rays, bool total)
{
    static const char *const words[GN_CASE_STATUS_COUNT] = {
        [GN_CASE_PASS] = "passed",  [GN_CASE_FAIL] = "failed",   [GN_CASE_LEAK] = "leaked",
        [GN_CASE_SKIP] = "skipped", [GN_CASE_CRASH] = "crashed", [GN_CASE_TIMEOUT] = "timed out",
        [GN_CASE_ERROR] = "error"};
    double median = family_median(f);
    fprintf(file, "<tr%s><td>", total ? " class=total" : "");
    text(file, f->name);
    if (f->backend)
        fprintf(file, " <span class=\"soft small\">%.*s</span>", (int)strcspn(f->backend, "."), f->backend);
    fprintf(file, "</td><td class=n>%s</td><td>", grouped(f->cases));
    const char *separator = "";
    for (int s = 0; s < GN_CASE_STATUS_COUNT; s++) {
        if (!f->by_status[s])
            continue;
        bool bad = gn_case_status_is_failure((enum gn_case_status)s);
        fprintf(file, "%s%s%s %s%s", separator, bad ? "<b style=\"color:var(--bad)\">" : "",
                grouped(f->by_status[s]), words[s], bad ? "</b>" : "");
        separator = ", ";
    }
    fprintf(file, "</td><td class=n>%s<br><span class=\"soft small\">%s</span></td><td class=n>%s</td><td>",
            grouped(f->rays), share(f->rays, all_rays), share(f->ideal_hits, f->rays));
    gn_html_class_bar(file, f->classes);
    fputs("</td><td>", file);
    gn_html_error_bar(file, median, f->p999, f->max, gn_ref_verdict_bound(), f->classes[GN_REF_WRONG] > 0);
    if (f->max > 0)
        fprintf(file, "<span class=\"soft small\">%.3g &middot; %.3g &middot; %.3g</span>", median, f->p999,
                f->max);
    fputs("</td></tr>\n", file);
}

static void put_families(FILE *file, const struct gn_results *results)
{
    struct family all = {.name = "all"};
    for (size_t i = 0; i < results->count; i++)
        family_add(&all, &results->cases[i]);
    fprintf(file,
            "<h2>Families</h2>\n<p>A class that is there at all is drawn as at least a sliver. The last "
            "column is the "
            "distribution of hit errors in units of 2<sup>-24</sup>, on a logarithmic scale: from the median "
            "to the "
            "99.9th percentile, the maximum as a dot, the bound (%.4g) as an upright line; the numbers are "
            "the three "
            "of them. An ill-conditioned hit (a grazing ray, a sliver) has a larger bound of its own, so a "
            "blue dot "
            "beyond the line is no failure; a red one goes with wrong answers.</p>\n<div "
            "class=wide><table><thead><tr>"
            "<th>Family<th class=n>Cases<th>Result<th class=n>Rays<th class=n>Ideal hits<th>Verdicts<th>Hit "
            "error: "
            "median &middot; 99.9 %% &middot; max</tr></thead><tbody>\n",
            gn_ref_verdict_bound());
    /* The cases are sorted by name, so a family's follow one another. */
    for (size_t i = 0; i < results->count;) {
        const struct gn_results_case *first = &results->cases[i];
        const bool prefixed = strncmp(first->name, first->family, strlen(first->family)) != 0;
        struct family family = {.name = first->family, .backend = prefixed ? first->name : NULL};
        size_t j = i;
        for (; j < results->count && strcmp(results->cases[j].family, family.name) == 0; j++)
            family_add(&family, &results->cases[j]);
        put_family(file, &family, all.rays, false);
        free(family.medians);
        i = j;
    }
    put_family(file, &all, all.rays, true);
    free(all.medians);
    fputs("</tbody></table></div>\n", file);
}

/* The pictures of the cases that render, beside the exact ones. */
static void put_rendered(FILE *file, const struct gn_results *results)
{
    static const char *const captions[GN_CASE_RENDERED] = {"The driver&rsquo;s rays", "The exact rays",
                                                          "The difference: black is none, white is a tenth or more"};
    bool any = false;
    for (size_t i = 0; i < results->count; i++) {
        const struct gn_results_case *cs = &results->cases[i];
        if (!cs->rendered[0][0])
            continue;
        if (!any)
            fputs("<h2>Rendered scenes</h2>\n<p>Whole pictures, wave by wave of rays: each of the driver&rsquo;s answers is "
                  "judged, and shaded like the exact ones.</p>\n",
                  file);
        any = true;
        fputs("<p>", file);
        put_badge(file, cs);
        fputs(" <b>", file);
        text(file, cs->name);
        fprintf(file, "</b> <span class=\"soft small\">%s rays, %s of them exact</span></p>\n<div class=rendered>",
                grouped(cs->rays), share(cs->class_counts[GN_REF_EXACT], cs->rays));
        for (int p = 0; p < GN_CASE_RENDERED; p++) {
            fprintf(file, "<figure><img alt=\"%s\" src=\"data:image/png;base64,", captions[p]);
            text(file, cs->rendered[p]);
            fprintf(file, "\"><figcaption>%s</figcaption></figure>", captions[p]);
        }
        fputs("</div>\n", file);
    }
}

static void put_answers(FILE *file, const struct gn_case_offender *offender)
{
    struct gn_answer_row rows[GN_ANSWER_ROWS];
    size_t count = gn_describe_rows(&offender->verdict, &offender->answer, rows);
    fputs("<table><thead><tr><th><th>The driver's answer<th>The right answer</tr></thead><tbody>\n", file);
    for (size_t i = 0; i < count; i++) {
        const char *mark = rows[i].differs ? " class=\"mono diff\"" : " class=mono";
        fprintf(file, "<tr><td>%s</td><td%s>", rows[i].label, mark);
        text(file, rows[i].answer);
        fputs("</td><td class=mono>", file);
        text(file, rows[i].ideal);
        fputs("</td></tr>\n", file);
    }
    fputs("</tbody></table>\n", file);
}

static void put_offender(FILE *file, const struct gn_case_offender *offender, const char *message)
{
    const struct gn_ref_ray *ray = &offender->ray.ray;
    const struct gn_ref_verdict *verdict = &offender->verdict;
    char flags[256];
    fprintf(file, "<p><b>The worst ray</b>, number %u of trace %u: %s", offender->ray_index, offender->trace,
            gn_ref_verdict_class_name(verdict->cls));
    /* Mostly the message has it already. */
    if (verdict->reason[0] && !strstr(message, verdict->reason)) {
        fputs(", ", file);
        text(file, verdict->reason);
    }
    fputs("</p>\n", file);
    put_answers(file, offender);
    fprintf(file,
            "<details><summary class=small>The ray's numbers</summary><pre>origin    %.9g, %.9g, %.9g\n      "
            "    %a, %a, "
            "%a\ndirection %.9g, %.9g, %.9g\n          %a, %a, %a\nt range   %.9g to %.9g\nflags     0x%X "
            "(%s), mask "
            "0x%02X</pre></details>\n",
            (double)ray->origin[0], (double)ray->origin[1], (double)ray->origin[2], (double)ray->origin[0],
            (double)ray->origin[1], (double)ray->origin[2], (double)ray->direction[0],
            (double)ray->direction[1], (double)ray->direction[2], (double)ray->direction[0],
            (double)ray->direction[1], (double)ray->direction[2], (double)ray->tmin, (double)ray->tmax,
            ray->flags, gn_describe_ray_flags(ray->flags, flags, sizeof flags), ray->cull_mask & 0xFF);
    if (verdict->hit_error > 0 || verdict->margin > 0) {
        fputs("<p class=small>", file);
        if (verdict->hit_error > 0)
            fprintf(file, "Hit error %.4g, %.4g allowed. ", verdict->hit_error,
                    verdict->hit_bound > 0 ? verdict->hit_bound : gn_ref_verdict_bound());
        if (verdict->margin > 0)
            fprintf(file, "Margin of the decision %.4g; up to %.4g it may go either way. ", verdict->margin,
                    gn_ref_verdict_bound());
        fputs("Both in units of 2<sup>-24</sup>.</p>\n", file);
    }
}

static void put_picture(FILE *file, const struct gn_results_case *cs, const char *folder)
{
    fputs("<figure>", file);
    if (gn_html_picture(file, folder, cs)) {
        fprintf(file,
                "<figcaption>%u &times; %u rays of the trace, a pixel each, in order. Light where the ray "
                "ideally hits, dark where it misses.<br>",
                cs->picture_width, cs->picture_height);
        for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++)
            if (cs->class_counts[c])
                gn_html_class_key(file, (enum gn_ref_verdict_class)c);
        fputs("</figcaption>", file);
    } else {
        fputs("<figcaption>the picture could not be read</figcaption>", file);
    }
    fputs("</figure>\n", file);
}

/* The first clause of a message: what a folded case shows. */
static void put_beginning(FILE *file, const char *message)
{
    char beginning[160];
    size_t length = strcspn(message, ";\n");
    if (length >= sizeof beginning)
        length = 140;
    /* Not in the middle of a character. */
    while (length && ((unsigned char)message[length] & 0xC0) == 0x80)
        length--;
    snprintf(beginning, sizeof beginning, "%.*s", (int)length, message);
    text(file, beginning);
}

static void put_case(FILE *file, const struct gn_results *results, const struct gn_results_case *cs,
                     const char *folder, bool open)
{
    bool picture = cs->picture[0] != 0;
    char path[4096];
    fprintf(file, "<details class=case%s id=\"", open ? " open" : "");
    text(file, cs->name);
    fputs("\"><summary>", file);
    put_badge(file, cs);
    fputs("<h3>", file);
    text(file, cs->name);
    fputs("</h3><span class=\"soft small\">", file);
    put_beginning(file, cs->message);
    fprintf(file, "</span></summary>\n<div class=\"body%s\">\n", picture ? " pic" : "");
    if (picture)
        put_picture(file, cs, folder);
    fputs("<div>", file);
    if (cs->outcome != GN_OUTCOME_UNEXPECTED && cs->expected[0]) {
        fputs("<p><b>Expected ", file);
        text(file, cs->expected);
        fputs("</b>: ", file);
        text(file, cs->expected_reason[0] ? cs->expected_reason : "no reason given");
        fputs("</p>\n", file);
    } else if (cs->expected[0]) {
        fputs("<p><b>Expected ", file);
        text(file, cs->expected);
        fputs(", which is not what happened.</b></p>\n", file);
    }
    fputs("<p>", file);
    text(file, cs->message);
    fputs("</p>\n<p class=small><b>What the case is evidence for:</b> ", file);
    text(file, cs->spec);
    fputs("</p>\n", file);
    if (cs->rays) {
        fprintf(file, "<p class=small>%s rays, %s of them ideal hits: ", grouped(cs->rays),
                share(cs->ideal_hits, cs->rays));
        const char *separator = "";
        for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++) {
            if (!cs->class_counts[c])
                continue;
            fprintf(file, "%s%s %s", separator, grouped(cs->class_counts[c]),
                    gn_ref_verdict_class_name((enum gn_ref_verdict_class)c));
            separator = ", ";
        }
        fputs(".</p>\n", file);
    }
    gn_html_curve(file, &cs->curve);
    if (cs->has_offender)
        put_offender(file, &cs->offender, cs->message);
    if (cs->output[0]) {
        fputs("<details><summary class=small>What the driver printed, its end</summary><pre>", file);
        text(file, cs->output);
        fputs("</pre></details>\n", file);
    }
    if (cs->replay[0]) {
        snprintf(path, sizeof path, "%s/%s", folder, cs->replay);
        char *quoted = gn_shell_quote(path);
        fputs("<p class=small><b>Again, step by step:</b></p><div class=copy>", file);
        text(file, results->run.command);
        fputs(" replay ", file);
        text(file, quoted ? quoted : path);
        fputs("</div>\n", file);
        free(quoted);
    }
    fputs("</div></div></details>\n", file);
}

static void put_cases_of(FILE *file, const struct gn_results *results, const char *folder, const char *title,
                         const char *introduction, enum gn_results_outcome outcome, size_t most_open)
{
    /* What is worst first. */
    static const enum gn_case_status order[] = {GN_CASE_CRASH, GN_CASE_TIMEOUT, GN_CASE_ERROR, GN_CASE_FAIL,
                                                GN_CASE_LEAK,  GN_CASE_PASS,    GN_CASE_SKIP};
    size_t total = 0, n = 0;
    for (size_t i = 0; i < results->count; i++)
        total += results->cases[i].outcome == outcome;
    if (!total)
        return;
    fprintf(file, "<h2%s>%s (%zu)</h2>\n<p>%s</p>\n", outcome == GN_OUTCOME_EXPECTED_FAILURE ? " id=expected" : "", title,
            total, introduction);
    for (size_t s = 0; s < sizeof order / sizeof order[0]; s++)
        for (size_t i = 0; i < results->count; i++)
            if (results->cases[i].outcome == outcome && results->cases[i].status == order[s])
                put_case(file, results, &results->cases[i], folder, n++ < most_open);
}

static void put_failures(FILE *file, const struct gn_results *results, const char *folder)
{
    put_cases_of(file, results, folder, "Failures",
                 "What is worst first, each with the worst of its rays. The picture shows which rays of the "
                 "case went wrong.",
                 GN_OUTCOME_UNEXPECTED, MOST_OPEN);
    put_cases_of(file, results, folder, "Unexpected passes",
                 "An expectation file says that these do not pass. They passed: take them out of the file.",
                 GN_OUTCOME_UNEXPECTED_PASS, 0);
    if (results->stale_count) {
        fputs("<h2>Stale expectations</h2>\n<ul>", file);
        for (size_t i = 0; i < results->stale_count; i++) {
            fputs("<li class=mono>", file);
            text(file, results->stale[i]);
        }
        fputs("</ul>\n", file);
    }
    put_cases_of(file, results, folder, "Expected failures",
                 "Known to fail, with the reason from the expectation file. They do not count.",
                 GN_OUTCOME_EXPECTED_FAILURE, 0);
}

static void put_skips(FILE *file, const struct gn_results *results)
{
    bool any = false;
    for (size_t i = 0; i < results->count && !any; i++)
        any = results->cases[i].status == GN_CASE_SKIP;
    if (!any)
        return;
    fputs("<h2>Skipped</h2>\n<p>Not judged, and why.</p>\n<div "
          "class=wide><table><thead><tr><th>Case<th>Reason</tr>"
          "</thead><tbody>\n",
          file);
    for (size_t i = 0; i < results->count; i++) {
        if (results->cases[i].status != GN_CASE_SKIP)
            continue;
        fputs("<tr><td class=mono>", file);
        text(file, results->cases[i].name);
        fputs("</td><td>", file);
        text(file, results->cases[i].message);
        fputs("</td></tr>\n", file);
    }
    fputs("</tbody></table></div>\n", file);
}

static int slower(const void *a, const void *b)
{
    double left = (*(const struct gn_results_case *const *)a)->seconds;
    double right = (*(const struct gn_results_case *const *)b)->seconds;
    return left < right ? 1 : left > right ? -1 : 0;
}

static void put_slowest(FILE *file, const struct gn_results *results)
{
    const struct gn_results_case **sorted = calloc(results->count ? results->count : 1, sizeof *sorted);
    if (!sorted || results->count < 2) {
        free(sorted);
        return;
    }
    for (size_t i = 0; i < results->count; i++)
        sorted[i] = &results->cases[i];
    qsort(sorted, results->count, sizeof *sorted, slower);
    double most = sorted[0]->seconds > 0 ? sorted[0]->seconds : 1;
    fputs("<h2>Slowest</h2>\n<div class=wide><table><thead><tr><th>Case<th class=n>Time<th>&nbsp;<th "
          "class=n>Rays per "
          "second</tr></thead><tbody>\n",
          file);
    for (size_t i = 0; i < results->count && i < MOST_SLOWEST; i++) {
        const struct gn_results_case *cs = sorted[i];
        char duration[32];
        fputs("<tr><td class=mono>", file);
        text(file, cs->name);
        fprintf(file,
                "</td><td class=n>%s</td><td><svg width=220 height=12><rect width=%.1f height=12 "
                "fill=\"#0072B2\" "
                "fill-opacity=.55 /></svg></td><td class=n>%s</td></tr>\n",
                gn_format_duration(cs->seconds, duration), 220 * cs->seconds / most,
                cs->seconds > 0 ? grouped((uint64_t)((double)cs->rays / cs->seconds)) : "-");
    }
    fputs("</tbody></table></div>\n", file);
    free(sorted);
}

static void put_all(FILE *file, const struct gn_results *results)
{
    fprintf(file,
            "<h2>All cases</h2>\n<label class=small for=filter>Show those whose row contains every "
            "word:</label><br>"
            "<input id=filter type=search placeholder=\"flags fail\" autocomplete=off> <span id=shown "
            "class=\"soft "
            "small\">%zu shown</span>\n<div class=wide><table id=cases><thead><tr><th>Case<th>Result<th "
            "class=n>Time<th "
            "class=n>Rays<th class=n>Ideal hits<th class=n>Exact<th class=n>Admissible<th class=n>Gap<th "
            "class=n>Leak<th "
            "class=n>Double<th class=n>Wrong<th class=n>Hit error, max<th class=n>Margin, "
            "max</tr></thead><tbody>\n",
            results->count);
    for (size_t i = 0; i < results->count; i++) {
        const struct gn_results_case *cs = &results->cases[i];
        char duration[32];
        bool linked = cs->outcome != GN_OUTCOME_AS_EXPECTED;
        fputs("<tr><td class=mono>", file);
        if (linked) {
            fputs("<a href=\"#", file);
            text(file, cs->name);
            fputs("\" style=\"color:inherit\">", file);
        }
        text(file, cs->name);
        fputs(linked ? "</a></td><td>" : "</td><td>", file);
        put_badge(file, cs);
        fprintf(file, "</td><td class=n>%s</td><td class=n>%s</td><td class=n>%s</td>",
                gn_format_duration(cs->seconds, duration), grouped(cs->rays),
                share(cs->ideal_hits, cs->rays));
        for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++)
            fprintf(file, "<td class=n>%s</td>", grouped(cs->class_counts[c]));
        fprintf(file, "<td class=n>%.3g</td><td class=n>%.3g</td></tr>\n", cs->hit_error_max, cs->margin_max);
    }
    fputs("</tbody></table></div>\n", file);
}

static void put_fact(FILE *file, const char *label, const char *value)
{
    if (!*value)
        return;
    fprintf(file, "<dt>%s</dt><dd class=mono>", label);
    text(file, value);
    fputs("</dd>", file);
}

static void put_details(FILE *file, const struct gn_results *results)
{
    const struct gn_results_run *run = &results->run;
    const struct gn_device_info *device = &run->device;
    char value[256];
    fputs("<h2>The run</h2>\n<dl class=facts>", file);
    put_fact(file, "Driver file", run->driver[0] ? run->driver : "the loader's choice");
    put_fact(file, "Options", run->options);
    put_fact(file, "Environment", run->environment);
    snprintf(value, sizeof value, "%u.%u.%u", VK_API_VERSION_MAJOR(device->api_version),
             VK_API_VERSION_MINOR(device->api_version), VK_API_VERSION_PATCH(device->api_version));
    put_fact(file, "Vulkan", value);
    snprintf(value, sizeof value, "vendor 0x%04X, device 0x%04X, driver version 0x%08X", device->vendor_id,
             device->device_id, device->driver_version);
    put_fact(file, "Numbers", value);
    snprintf(value, sizeof value, "ray query %s, ray tracing pipeline %s, position fetch %s, host builds %s",
             device->ray_query ? "yes" : "no", device->ray_tracing_pipeline ? "yes" : "no",
             device->position_fetch ? "yes" : "no", device->host_builds ? "yes" : "no");
    put_fact(file, "Features", value);
    snprintf(value, sizeof value, "%llu geometries, %llu instances, %llu primitives",
             (unsigned long long)device->limits.maxGeometryCount,
             (unsigned long long)device->limits.maxInstanceCount,
             (unsigned long long)device->limits.maxPrimitiveCount);
    put_fact(file, "Most of", value);
    snprintf(value, sizeof value, "shard %u of %u, scale %g, %g s per case", run->shard, run->shard_count,
             run->scale, run->timeout);
    put_fact(file, "Limits", value);
    fputs("</dl>\n<p class=\"soft small\">The same as data: results.jsonl, results.csv, junit.xml beside "
          "this page.</p>\n",
          file);
}

bool gn_results_html_write(const struct gn_results *results, const char *out, const char *path,
                           char *out_error, size_t error_size)
{
    char *page = NULL;
    size_t length = 0;
    FILE *file = open_memstream(&page, &length);
    if (!file) {
        snprintf(out_error, error_size, "out of memory for %s", path);
        return false;
    }
    put_head(file, results);
    put_families(file, results);
    put_rendered(file, results);
    put_meaning(file);
    put_failures(file, results, out);
    gn_html_curves(file, results);
    put_skips(file, results);
    put_slowest(file, results);
    put_all(file, results);
    put_details(file, results);
    fprintf(file, "</main><script>%s</script></body></html>\n", gn_html_script);
    return gn_file_write_stream(path, file, &page, &length, out_error, error_size);
}
