/* SPDX-License-Identifier: Apache-2.0 */
/* gate.html: the answer, what counts, time and memory as intervals, drift as distributions, every change. */
#include "cts/gate_html.h"

#include <math.h>
#include <string.h>

#include "cts/describe.h"
#include "cts/progress.h"
#include "cts/report_html_parts.h"

#define text gn_html_text

static void put_head(FILE *file, const struct gn_gate *gate)
{
    char verdict[1024], duration[32];
    const struct gn_results *runs[2] = {gate->now, gate->before};
    gn_gate_verdict(gate, verdict, sizeof verdict);
    fputs("<!doctype html>\n<html lang=en><head><meta charset=utf-8><meta name=viewport "
          "content=\"width=device-width,initial-scale=1\"><title>",
          file);
    text(file, verdict);
    fprintf(file, "</title>\n<style>%s</style></head>\n<body><main>\n<h1>Gnomon, gate</h1>\n", gn_html_style);
    fprintf(file, "<div class=\"verdict %s\">", gn_gate_exit_status(gate) == 0 ? "ok" : "no");
    text(file, verdict);
    fprintf(file, "<small>%s; a slowdown beyond %.3g times counts</small></div>\n<dl class=facts>",
            gn_format_duration(gate->seconds, duration), gate->budget);
    for (int i = 0; i < 2 && runs[i]; i++) {
        const struct gn_device_info *device = &runs[i]->run.device;
        fprintf(file, "<dt>%s driver</dt><dd>", i ? "Old" : "New");
        text(file, device->name);
        fputs(", ", file);
        text(file, device->driver_name);
        fputs(" ", file);
        text(file, device->driver_info);
        fprintf(file, " (<a href=\"%s/report.html\">its own report</a>)</dd>", i ? "old" : "new");
    }
    fputs("</dl>\n", file);
}

static void put_tile(FILE *file, const char *kind, size_t count, const char *what)
{
    char digits[32];
    fprintf(file, "<div class=\"tile %s\"><b>%s</b><span>%s</span></div>", count ? kind : "",
            gn_format_grouped(count, digits), what);
}

static void put_tiles(FILE *file, const struct gn_gate *gate)
{
    size_t changes[GN_GATE_CHANGE_COUNT] = {0}, counting = 0, slower = 0;
    for (size_t i = 0; i < gate->case_count; i++) {
        changes[gate->cases[i].change]++;
        counting += gn_gate_case_counts(gate, i);
    }
    for (size_t i = 0; i < gate->time_count; i++)
        slower += gate->times[i].exceeds || gate->times[i].broken;
    fputs("<div class=tiles>", file);
    put_tile(file, "no", counting, "cases that count");
    put_tile(file, "no", slower, "measured slower or larger than the budget, or failing");
    if (gate->before) {
        put_tile(file, "", changes[GN_GATE_RIGHT], "newly right");
        put_tile(file, "", changes[GN_GATE_ANSWERS], "with other answers, as good as before");
        put_tile(file, "", changes[GN_GATE_VARIES], "with answers that vary from run to run");
        put_tile(file, "", changes[GN_GATE_SAME], "the same, bit for bit");
    }
    fputs("</div>\n", file);
}

static void put_rerun(FILE *file, const struct gn_gate *gate, const char *name)
{
    for (size_t i = 0; i < gate->rerun_count; i++) {
        const struct gn_gate_rerun *rerun = &gate->reruns[i];
        if (strcmp(rerun->name, name) != 0 || !rerun->alone)
            continue;
        fprintf(file, "<div class=\"soft small\">Run again: passed %u of %u alone", rerun->alone_passed, rerun->alone);
        if (rerun->context)
            fprintf(file, ", %u of %u behind the cases before it", rerun->context_passed, rerun->context);
        if (*rerun->after) {
            fputs("; it fails behind <code>", file);
            text(file, rerun->after);
            fputs("</code>", file);
        }
        fputs("</div>", file);
    }
}

static void put_counting(FILE *file, const struct gn_gate *gate)
{
    bool any = false;
    for (size_t i = 0; i < gate->case_count; i++) {
        const struct gn_gate_case *pair = &gate->cases[i];
        if (!gn_gate_case_counts(gate, i))
            continue;
        if (!any)
            fputs("<h2>What counts</h2>\n<div class=wide><table><thead><tr><th>Case<th>Was<th>Is<th>Why</tr></thead><tbody>\n",
                  file);
        any = true;
        fputs("<tr><td class=mono>", file);
        text(file, pair->now->name);
        fputs("</td><td>", file);
        text(file, pair->before ? gn_case_status_name(pair->before->status) : pair->now->expected);
        fprintf(file, "</td><td><span class=\"badge no\">%s</span></td><td class=small>",
                gn_case_status_name(pair->now->status));
        text(file, pair->now->message);
        if (pair->now->outcome == GN_OUTCOME_UNEXPECTED_PASS) {
            text(file, pair->now->expected_place);
            fputs(" says otherwise", file);
        }
        put_rerun(file, gate, pair->now->name);
        if (*pair->now->replay) {
            fputs("<div class=mono>", file);
            text(file, gate->now->run.command);
            fputs(" replay new/", file);
            text(file, pair->now->replay);
            fputs("</div>", file);
        }
        fputs("</td></tr>\n", file);
    }
    if (any)
        fputs("</tbody></table></div>\n", file);
    if (gate->now->stale_count)
        fputs("<h2>Stale expectations</h2>\n<ul>", file);
    for (size_t i = 0; i < gate->now->stale_count; i++) {
        fputs("<li class=mono>", file);
        text(file, gate->now->stale[i]);
    }
    fputs(gate->now->stale_count ? "</ul>\n" : "", file);
}

/* An interval of ratios on a logarithmic axis from 1/4 to 16, with lines at 1 and at the budget. */
static double ratio_x(double ratio)
{
    return 300 * (log2(fmin(fmax(ratio, 0.25), 16)) + 2) / 6;
}

static void put_interval(FILE *file, const struct gn_gate_time *time, double budget)
{
    const char *colour = time->exceeds ? "var(--bad)" : time->undecided ? "var(--warn)" : "var(--good)";
    fprintf(file,
            "<svg width=300 height=18 viewBox=\"0 0 300 18\" role=img aria-label=\"%.2f\">"
            "<line x1=%.1f x2=%.1f y1=0 y2=18 stroke=\"currentColor\" opacity=.35 />"
            "<line x1=%.1f x2=%.1f y1=0 y2=18 stroke=\"var(--bad)\" stroke-dasharray=\"2 2\" />"
            "<line x1=%.1f x2=%.1f y1=9 y2=9 stroke=\"%s\" stroke-width=3 /><circle cx=%.1f cy=9 r=4.5 fill=\"%s\" /></svg>",
            time->ratio, ratio_x(1), ratio_x(1), ratio_x(budget), ratio_x(budget), ratio_x(time->low), ratio_x(time->high),
            colour, ratio_x(time->ratio), colour);
}

static void put_times(FILE *file, const struct gn_gate *gate)
{
    if (!gate->time_count)
        return;
    fprintf(file,
            "<h2>Time and memory</h2>\n<p>Both drivers in turns. The bar is where the ratio of new to old lies at 99 %%; the "
            "solid line is 1, the dashed one the budget of %.3g. A bar wholly beyond it counts.</p>\n"
            "<div class=wide><table><thead><tr><th>Operation<th class=n>Old<th class=n>New<th class=n>Ratio<th>1/4 to 16 "
            "times<th>What</tr></thead><tbody>\n",
            gate->budget);
    for (size_t i = 0; i < gate->time_count; i++) {
        const struct gn_gate_time *time = &gate->times[i];
        char amount[32];
        fprintf(file, "<tr><td class=mono>%s</td>", time->item->name);
        if (!time->rounds) {
            fprintf(file, "<td class=soft colspan=4>%snot measured: ", time->broken ? "<span class=\"badge no\">fails</span> " : "");
            text(file, time->missing);
            fprintf(file, "</td><td class=small>%s</td></tr>\n", time->item->about);
            continue;
        }
        fprintf(file, "<td class=n>%s</td>", gn_gate_amount(time->item, time->before_median, amount));
        fprintf(file, "<td class=n>%s</td>", gn_gate_amount(time->item, time->now_median, amount));
        fprintf(file, "<td class=n>%s%.2f%s</td><td>", time->exceeds ? "<span class=\"badge no\">" : "", time->ratio,
                time->exceeds ? "</span>" : "");
        put_interval(file, time, gate->budget);
        fprintf(file, "</td><td class=small>%s%s</td></tr>\n", time->item->about,
                time->undecided     ? "; too noisy to tell"
                : time->unconfirmed ? "; over the budget at first, not when measured again"
                                    : "");
    }
    fputs("</tbody></table></div>\n", file);
}

/* The families' errors on both drivers: median, 99.9 % and maximum on one axis each. */
static void put_drifts(FILE *file, const struct gn_gate *gate)
{
    if (!gate->drift_count)
        return;
    fputs("<h2>Backward error</h2>\n<p>How far the numbers of right answers are from exact, in units of 2^-24: median, 99.9 % and "
          "largest, old above new. The distance is the largest difference of the two distribution functions.</p>\n"
          "<div class=wide><table><thead><tr><th>Family<th class=n>Hits<th>Old and new<th class=n>Median<th class=n>99.9 "
          "%<th class=n>Largest<th class=n>Distance<th></tr></thead><tbody>\n",
          file);
    for (size_t i = 0; i < gate->drift_count; i++) {
        const struct gn_gate_drift *drift = &gate->drifts[i];
        char digits[32];
        fputs("<tr><td>", file);
        text(file, drift->family);
        fprintf(file, "</td><td class=n>%s</td><td>", gn_format_grouped(drift->now_count, digits));
        gn_html_error_bar(file, drift->before_median, drift->before_p999, drift->before_max, gn_ref_verdict_bound(), false);
        gn_html_error_bar(file, drift->now_median, drift->now_p999, drift->now_max, gn_ref_verdict_bound(), false);
        fprintf(file,
                "</td><td class=n>%.2g<br>%.2g</td><td class=n>%.2g<br>%.2g</td><td class=n>%.3g<br>%.3g</td><td class=n>%.1f "
                "%%</td><td>%s</td></tr>\n",
                drift->before_median, drift->now_median, drift->before_p999, drift->now_p999, drift->before_max,
                drift->now_max, 100 * drift->distance,
                drift->drifted ? "<span class=\"badge meh\">moved</span>" : "");
    }
    fputs("</tbody></table></div>\n", file);
}

static void put_changes(FILE *file, const struct gn_gate *gate)
{
    if (!gate->before)
        return;
    fputs("<h2>Every change</h2>\n<p>Cases that do not answer bit for bit as before. A decision is what was hit; a number is t or "
          "a barycentric of the same hit.</p>\n<p><input id=filter type=search placeholder=\"filter by name or status\" "
          "aria-label=\"filter\"> <span id=shown class=\"soft small\"></span></p>\n<div class=wide><table id=cases><thead><tr>"
          "<th>Case<th>Change<th>Was<th>Is<th class=n>Rays<th class=n>Other decisions<th class=n>Other numbers</tr></thead>"
          "<tbody>\n",
          file);
    for (size_t i = 0; i < gate->case_count; i++) {
        const struct gn_gate_case *pair = &gate->cases[i];
        char digits[32];
        if (pair->change == GN_GATE_SAME)
            continue;
        fputs("<tr><td class=mono>", file);
        text(file, pair->now->name);
        fprintf(file, "</td><td>%s%s%s</td><td>%s</td><td>%s</td><td class=n>%s</td>",
                pair->change == GN_GATE_WRONG ? "<span class=\"badge no\">" : "", gn_gate_change_name(pair->change),
                pair->change == GN_GATE_WRONG ? "</span>" : "",
                pair->before ? gn_case_status_name(pair->before->status) : "", gn_case_status_name(pair->now->status),
                gn_format_grouped(pair->now->rays, digits));
        if (pair->ray_by_ray) {
            fprintf(file, "<td class=n>%s</td>", gn_format_grouped(pair->decisions_changed, digits));
            fprintf(file, "<td class=n>%s</td></tr>\n", gn_format_grouped(pair->numbers_changed, digits));
        } else {
            fputs("<td></td><td></td></tr>\n", file);
        }
    }
    fputs("</tbody></table></div>\n", file);
}

void gn_gate_html(FILE *file, const struct gn_gate *gate)
{
    put_head(file, gate);
    put_tiles(file, gate);
    put_counting(file, gate);
    put_times(file, gate);
    put_drifts(file, gate);
    put_changes(file, gate);
    /* The script is the filter box's. */
    fprintf(file, "</main><script>%s</script></body></html>\n", gate->before ? gn_html_script : "");
}
