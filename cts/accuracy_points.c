/* SPDX-License-Identifier: Apache-2.0 */
/* Rows summed up into a point per tier; which one to choose for a budget; which ones no other beats. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cts/accuracy.h"
#include "cts/describe.h"
#include "cts/statistics.h"

void gn_accuracy_points(const struct gn_accuracy *accuracy, uint32_t scene, enum gn_accuracy_mode mode,
                        struct gn_accuracy_point out[GN_REF_TIER_COUNT])
{
    double *medians = calloc(accuracy->row_count + 1, sizeof *medians);
    for (int t = 0; t < GN_REF_TIER_COUNT; t++) {
        struct gn_accuracy_point *point = &out[t];
        double log_ratio = 0, log_speed = 0;
        size_t rows = 0, hit = 0;
        *point = (struct gn_accuracy_point){.tier = (enum gn_ref_tier)t};
        point->t_error_median = point->t_error_max = (double)NAN;
        for (size_t i = 0; i < accuracy->row_count; i++) {
            const struct gn_accuracy_row *row = &accuracy->rows[i];
            if ((int)row->tier != t || row->mode != mode ||
                (scene != GN_ACCURACY_ALL_SCENES && row->scene != scene))
                continue;
            rows++;
            log_ratio += log(row->ratio_to_robust);
            log_speed += log(row->mrays_per_s);
            point->rays += row->rays;
            point->wrong += gn_accuracy_row_wrong(row);
            point->gross += gn_accuracy_row_gross(row);
            if (row->hits) {
                point->t_error_max = fmax(point->t_error_max, row->t_error_max);
                if (medians)
                    medians[hit++] = row->t_error_median;
            }
        }
        point->time = rows ? exp(-log_ratio / (double)rows) : 0;
        point->mrays_per_s = rows ? exp(log_speed / (double)rows) : 0;
        point->wrong_per_million = point->rays ? 1e6 * (double)point->wrong / (double)point->rays : 0;
        if (hit) {
            qsort(medians, hit, sizeof *medians, gn_doubles_compare);
            point->t_error_median = medians[hit / 2];
        }
    }
    free(medians);
}

static double t_error_of(const struct gn_accuracy_point *point)
{
    return isnan(point->t_error_max) || point->t_error_max <= GN_ACCURACY_T_FLOOR ? 0 : point->t_error_max;
}

/* Whether a is more accurate than b as measured: fewer wrong decisions per million; of equally many, the
 * smaller largest error of t. */
static bool is_better(const struct gn_accuracy_point *a, const struct gn_accuracy_point *b)
{
    if (a->wrong_per_million != b->wrong_per_million)
        return a->wrong_per_million < b->wrong_per_million;
    return t_error_of(a) < t_error_of(b);
}

int gn_accuracy_choose(const struct gn_accuracy_point *points, size_t count, double budget)
{
    int choice = -1;
    for (size_t i = 0; i < count; i++)
        if (points[i].time <= budget && (choice < 0 || !is_better(&points[choice], &points[i])))
            choice = (int)i;
    return choice;
}

static double gross_share(const struct gn_accuracy_point *point)
{
    return point->rays ? (double)point->gross / (double)point->rays : 0;
}

int gn_accuracy_choose_gross(const struct gn_accuracy_point *points, size_t count, double budget, int choice)
{
    int best = choice;
    for (size_t i = 0; i < count && choice >= 0; i++)
        if (points[i].time <= budget && gross_share(&points[i]) < gross_share(&points[best]))
            best = (int)i;
    return best == choice ? -1 : best;
}

void gn_accuracy_front(const double *times, const double *values, size_t count, bool *out_on_front)
{
    for (size_t i = 0; i < count; i++) {
        out_on_front[i] = !isnan(values[i]);
        for (size_t j = 0; j < count && out_on_front[i]; j++)
            if (j != i && times[j] <= times[i] && values[j] <= values[i] &&
                (times[j] < times[i] || values[j] < values[i]))
                out_on_front[i] = false;
    }
}

bool gn_accuracy_budget_parse(const char *text, double *out_budget)
{
    char *end;
    if (!(*text >= '0' && *text <= '9') && *text != '.')
        return false;
    errno = 0;
    double value = strtod(text, &end);
    if (end == text || errno || !(value > 0 && value <= 1e6))
        return false;
    if (*end == 'x' || *end == 'X')
        end++;
    if (*end)
        return false;
    *out_budget = value;
    return true;
}

double gn_accuracy_unseen_per_million(uint64_t n)
{
    return n ? -1e6 * expm1(log(0.05) / (double)n) : 1e6;
}

const char *gn_accuracy_number(double value, char out[32])
{
    if (isnan(value))
        snprintf(out, 32, "-");
    else if (value == 0)
        snprintf(out, 32, "0");
    else if (fabs(value) >= 1e7 || fabs(value) < 1e-3)
        snprintf(out, 32, "%.1e", value);
    else if (fabs(value) >= 1000)
        gn_format_grouped((uint64_t)(value + 0.5), out);
    else if (fabs(value) >= 100)
        snprintf(out, 32, "%.0f", value);
    else
        snprintf(out, 32, "%.3g", value);
    return out;
}

void gn_accuracy_choice_text(const struct gn_accuracy_point *points, int choice, double budget, char *out,
                             size_t size)
{
    char wrong[32], error[32], number[32], unseen[64] = "";
    if (choice < 0) {
        snprintf(out, size, "no tier takes at most %g times robust's time", budget);
        return;
    }
    const struct gn_accuracy_point *point = &points[choice];
    if (!point->wrong)
        snprintf(unseen, sizeof unseen, " (<%.16s at 95%%)",
                 gn_accuracy_number(gn_accuracy_unseen_per_million(point->rays), number));
    snprintf(out, size, "%s: %.*fx time, %s wrong/million%s, t to %s ulp",
             gn_ref_tier_name(point->tier), point->time < 10 ? 2 : 0, point->time,
             gn_accuracy_number(point->wrong_per_million, wrong), unseen,
             gn_accuracy_number(point->t_error_max, error));
}
