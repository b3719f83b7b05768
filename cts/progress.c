/* SPDX-License-Identifier: Apache-2.0 */
/* The progress line. */
#include "cts/progress.h"

#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

double gn_clock(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + (double)now.tv_nsec * 1e-9;
}

static bool smart_terminal(int fd)
{
    const char *term = getenv("TERM");
    return isatty(fd) && term && *term && strcmp(term, "dumb") != 0;
}

bool gn_terminal_colour(int fd)
{
    const char *no = getenv("NO_COLOR");
    return smart_terminal(fd) && !(no && *no);
}

int gn_terminal_width(int fd)
{
    struct winsize size;
    if (ioctl(fd, TIOCGWINSZ, &size) == 0 && size.ws_col > 0)
        return size.ws_col;
    return 80;
}

const char *gn_format_count(double value, char out[32])
{
    if (value >= 1e9)
        snprintf(out, 32, "%.2f G", value * 1e-9);
    else if (value >= 1e6)
        snprintf(out, 32, "%.2f M", value * 1e-6);
    else if (value >= 1e4)
        snprintf(out, 32, "%.1f k", value * 1e-3);
    else
        snprintf(out, 32, "%.0f ", value);
    return out;
}

const char *gn_format_duration(double seconds, char out[32])
{
    if (seconds < 0)
        seconds = 0;
    if (seconds < 10)
        snprintf(out, 32, "%.*f s", seconds < 0.1 ? 3 : 1, seconds);
    else if (seconds < 60)
        snprintf(out, 32, "%.0f s", seconds);
    else if (seconds < 3600)
        snprintf(out, 32, "%d:%02d min", (int)seconds / 60, (int)seconds % 60);
    else
        snprintf(out, 32, "%.0f:%02d h", (double)((long long)seconds / 3600),
                 (int)((long long)seconds / 60 % 60));
    return out;
}

void gn_progress_init(struct gn_progress *progress, size_t total, double weight_total)
{
    *progress = (struct gn_progress){.terminal = smart_terminal(STDERR_FILENO),
                                     .colour = gn_terminal_colour(STDERR_FILENO),
                                     .total = total,
                                     .weight_total = weight_total,
                                     .last = ""};
    progress->started = progress->shown = progress->rate_time = gn_clock();
}

/* The rate of the last seconds rather than of the whole run: it shows when a driver slows down. */
static void update_rate(struct gn_progress *progress, double now)
{
    double passed = now - progress->rate_time;
    if (passed < 1)
        return;
    double rate = (double)(progress->rays - progress->rate_rays) / passed;
    progress->rate = progress->rate > 0 ? 0.6 * progress->rate + 0.4 * rate : rate;
    progress->rate_rays = progress->rays;
    progress->rate_time = now;
}

static void describe(const struct gn_progress *progress, double now, char *out, size_t size)
{
    char rays[32], rate[32], eta[32], duration[32];
    double share = progress->weight_total > 0 ? progress->weight_done / progress->weight_total : 0;
    if (share > 1)
        share = 1;
    double elapsed = now - progress->started;
    if (progress->done && share > 0)
        snprintf(eta, sizeof eta, "ETA %.20s", gn_format_duration(elapsed * (1 - share) / share, duration));
    else
        snprintf(eta, sizeof eta, "starting");
    int digits = snprintf(NULL, 0, "%zu", progress->total);
    int used = snprintf(out, size, "[%*zu/%zu] %3.0f %%  %sray  %sray/s  %s", digits, progress->done,
                        progress->total, 100 * share, gn_format_count((double)progress->rays, rays),
                        gn_format_count(progress->rate > 0 || elapsed <= 0 ? progress->rate
                                                                           : (double)progress->rays / elapsed,
                                        rate),
                        eta);
    const struct {
        size_t count;
        const char *word;
    } kinds[] = {
        {progress->failed, "failed"}, {progress->leaked, "leaked"}, {progress->other, "crashed or stuck"}};
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++)
        if (kinds[i].count && used > 0 && (size_t)used < size)
            used += snprintf(out + used, size - (size_t)used, "  %zu %s", kinds[i].count, kinds[i].word);
}

static void clear_line(const struct gn_progress *progress)
{
    if (progress->terminal)
        fputs("\r\033[K", stderr);
}

static void show_on_terminal(struct gn_progress *progress, double now)
{
    char text[512];
    describe(progress, now, text, sizeof text);
    int width = gn_terminal_width(STDERR_FILENO) - 1;
    int length = (int)strlen(text);
    if (length > width)
        length = width > 0 ? width : 0;
    bool bad = progress->failed || progress->leaked || progress->other;
    fprintf(stderr, "\r%s%.*s%s", bad && progress->colour ? "\033[33m" : "", length, text,
            bad && progress->colour ? "\033[0m" : "");
    int room = width - length - 2;
    if (room >= 8 && progress->last[0]) {
        int name = (int)strlen(progress->last);
        /* The end of a name says more than its beginning. */
        if (name <= room)
            fprintf(stderr, "  %s", progress->last);
        else
            fprintf(stderr, "  ...%s", progress->last + (name - room + 3));
    }
    fputs("\033[K", stderr);
    fflush(stderr);
}

void gn_progress_tick(struct gn_progress *progress)
{
    double now = gn_clock();
    update_rate(progress, now);
    if (now - progress->shown < (progress->terminal ? 0.1 : 5))
        return;
    progress->shown = now;
    if (progress->terminal) {
        show_on_terminal(progress, now);
    } else {
        char text[512];
        describe(progress, now, text, sizeof text);
        fprintf(stderr, "%s\n", text);
    }
}

void gn_progress_case(struct gn_progress *progress, const struct gn_results_case *cs, double weight)
{
    progress->done++;
    progress->weight_done += weight;
    progress->rays += cs->rays;
    progress->last = cs->name;
    if (cs->outcome != GN_OUTCOME_UNEXPECTED && cs->outcome != GN_OUTCOME_UNEXPECTED_PASS)
        return;
    if (cs->status == GN_CASE_LEAK)
        progress->leaked++;
    else if (cs->status == GN_CASE_FAIL || cs->status == GN_CASE_PASS)
        progress->failed++;
    else
        progress->other++;
    /* On a terminal the list at the end is enough; a log wants to be read while it grows. */
    if (!progress->terminal)
        fprintf(stderr, "%s %s: %s\n",
                cs->outcome == GN_OUTCOME_UNEXPECTED_PASS ? "unexpected pass"
                                                          : gn_case_status_name(cs->status),
                cs->name, cs->message);
}

void gn_progress_message(struct gn_progress *progress, const char *format, ...)
{
    va_list arguments;
    clear_line(progress);
    fputs("gnomon: ", stderr);
    va_start(arguments, format);
    vfprintf(stderr, format, arguments);
    va_end(arguments);
    fputc('\n', stderr);
}

void gn_progress_finish(struct gn_progress *progress)
{
    clear_line(progress);
    fflush(stderr);
}
