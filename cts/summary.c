/* SPDX-License-Identifier: Apache-2.0 */
/* What a run prints at its end: the verdict first. */
#include "cts/describe.h"
#include "cts/progress.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define MOST_FAILURES 20
#define MOST_SLOWEST 5

char *gn_shell_quote(const char *text)
{
    static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./+=:@%,";
    size_t length = strlen(text), used = 0;
    char *out = malloc(length * 4 + 3);
    if (!out)
        return NULL;
    if (length && strspn(text, plain) == length)
        return strcpy(out, text);
    out[used++] = '\'';
    for (size_t i = 0; i < length; i++) {
        if (text[i] == '\'') {
            memcpy(out + used, "'\\''", 4);
            used += 4;
        } else {
            out[used++] = text[i];
        }
    }
    out[used++] = '\'';
    out[used] = 0;
    return out;
}

static bool counts(const struct gn_results_case *cs)
{
    return cs->outcome == GN_OUTCOME_UNEXPECTED || cs->outcome == GN_OUTCOME_UNEXPECTED_PASS;
}

static void print_failures(const struct gn_results *results, const char *out, const char *red,
                           const char *plain)
{
    size_t shown = 0, total = 0;
    for (size_t i = 0; i < results->count; i++) {
        const struct gn_results_case *cs = &results->cases[i];
        if (!counts(cs) || total++ >= MOST_FAILURES)
            continue;
        shown++;
        bool pass = cs->outcome == GN_OUTCOME_UNEXPECTED_PASS;
        printf("\n  %s%s%s %s\n", red, pass ? "unexpected pass" : gn_case_status_name(cs->status), plain,
               cs->name);
        if (pass)
            printf("    %s expects %s%s%s\n", cs->expected_place, cs->expected, cs->expected_reason[0] ? ": " : "",
                   cs->expected_reason);
        else
            printf("    %.*s\n", (int)strcspn(cs->message, "\n"), cs->message);
        if (cs->replay[0]) {
            char path[4096];
            snprintf(path, sizeof path, "%s/%s", out, cs->replay);
            char *quoted = gn_shell_quote(path);
            printf("    replay: %s replay %s\n", results->run.command, quoted ? quoted : path);
            free(quoted);
        }
    }
    if (total > shown)
        printf("\n  and %zu more, in the report\n", total - shown);
}

static void print_slowest(const struct gn_results *results)
{
    const struct gn_results_case *slowest[MOST_SLOWEST];
    size_t count = 0;
    for (size_t i = 0; i < results->count; i++) {
        const struct gn_results_case *cs = &results->cases[i];
        size_t at = count;
        while (at > 0 && slowest[at - 1]->seconds < cs->seconds)
            at--;
        if (at == MOST_SLOWEST)
            continue;
        count += count < MOST_SLOWEST;
        for (size_t j = count - 1; j > at; j--)
            slowest[j] = slowest[j - 1];
        slowest[at] = cs;
    }
    if (count < 2)
        return;
    printf("\nslowest:\n");
    for (size_t i = 0; i < count; i++) {
        char duration[32];
        printf("  %10s  %s\n", gn_format_duration(slowest[i]->seconds, duration), slowest[i]->name);
    }
}

void gn_summary_print(const struct gn_results *results, const char *out)
{
    bool colour = gn_terminal_colour(STDOUT_FILENO);
    const char *red = colour ? "\033[31m" : "", *green = colour ? "\033[32m" : "",
               *plain = colour ? "\033[0m" : "";
    struct gn_results_totals totals = gn_results_totals(results);
    char verdict[1024], rays[32], hits[32], duration[32];
    gn_results_verdict(results, verdict, sizeof verdict);
    printf("%s%s%s\n", gn_results_exit_status(results) == 0 ? green : red, verdict, plain);

    const struct gn_device_info *device = &results->run.device;
    printf("%s, %s %s; seed %llu, %s\n", device->name, device->driver_name, device->driver_info,
           (unsigned long long)results->run.seed, gn_format_duration(results->seconds, duration));
    if (totals.rays) {
        printf("%s rays, %s ideal hits (%.0f %%):", gn_format_grouped(totals.rays, rays),
               gn_format_grouped(totals.ideal_hits, hits),
               100 * (double)totals.ideal_hits / (double)totals.rays);
        const char *separator = " ";
        for (int c = 0; c < GN_REF_VERDICT_CLASS_COUNT; c++) {
            if (totals.class_counts[c])
                printf("%s%s %s", separator, gn_format_grouped(totals.class_counts[c], hits),
                       gn_ref_verdict_class_name((enum gn_ref_verdict_class)c));
            separator = totals.class_counts[c] ? ", " : separator;
        }
        printf("\nhit errors up to %.3g units of 2^-24 (%.3g are allowed a well-conditioned hit)\n",
               totals.hit_error_max, gn_ref_verdict_bound());
    }
    print_failures(results, out, red, plain);
    for (size_t i = 0; i < results->stale_count; i++)
        printf("\n  %sstale expectation%s %s\n", red, plain, results->stale[i]);
    for (size_t i = 0; i < results->note_count; i++)
        printf("\nnote: %s\n", results->notes[i]);
    print_slowest(results);
    fflush(stdout);
}
