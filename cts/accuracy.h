/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `gnomon accuracy`: every tier of the reference on the same rays, what each costs in time and how often and
 * how far each is wrong. Scenes (accuracy_scenes.c) are measured (accuracy_measure.c) into rows, rows are
 * summed up into points (accuracy_points.c), and both are shown as table, JSON, plot and page.
 */
#ifndef GNOMON_CTS_ACCURACY_H
#define GNOMON_CTS_ACCURACY_H

#include <stdio.h>

#include "cts/accuracy_model.h"
#include "reference/tracer.h"

#define GN_AIM_COUNT 4

enum gn_accuracy_mode { GN_ACCURACY_SINGLE, GN_ACCURACY_BATCH, GN_ACCURACY_MODE_COUNT };

/* "single", "batch". */
const char *gn_accuracy_mode_name(enum gn_accuracy_mode mode);
/* "interior", "edge", "vertex", "random". */
const char *gn_accuracy_aim_name(enum gn_aim aim);

struct gn_accuracy_driver;
struct gn_accuracy_layer;

struct gn_accuracy_scene {
    const char *name;  /* as --scene takes it; of a file, the name of the file */
    const char *about; /* a sentence for people */
    struct gn_model model;
    double distance;                /* of the rays' origins from what they are aimed at, about */
    uint64_t triangles;             /* over all instances */
    uint64_t *triangles_up_to;      /* those of an instance and the ones before it */
    struct gn_ref_scene *reference; /* committed */
};

/* The built-in scenes, by number: false when there is no such. */
bool gn_accuracy_scene_describe(size_t number, const char **out_name, const char **out_about);

/*
 * Makes a scene: a built-in one by its name, or a model file. `quick`: small. False with a message, and an
 * exit status: 2 for an unknown name or a file that cannot be used, 3 when memory is short. Model files are
 * read in a child process, so no thread may have been started.
 */
bool gn_accuracy_scene_load(struct gn_accuracy_scene *scene, const char *name, bool quick, uint64_t seed,
                            struct gn_arena *arena, int *out_exit_status, char *out_error, size_t error_size);
/* Builds scene->reference. */
bool gn_accuracy_scene_commit(struct gn_accuracy_scene *scene, char *out_error, size_t error_size);
/* Releases scene->reference; the rest is the arena's. */
void gn_accuracy_scene_finish(struct gn_accuracy_scene *scene);

void gn_accuracy_rays(const struct gn_accuracy_scene *scene, enum gn_aim aim, uint64_t seed,
                      struct gn_ref_ray *rays, uint32_t count);

/* Whether two triangles share a vertex: positions that are bit for bit the same. False for ids that there are not. */
bool gn_accuracy_neighbours(const struct gn_model *model, uint32_t instance_a, uint32_t primitive_a,
                            uint32_t instance_b, uint32_t primitive_b);

/* What one tier did with one kind of rays on one scene in one mode. */
struct gn_accuracy_row {
    uint32_t scene; /* its number among those measured */
    enum gn_aim aim;
    enum gn_accuracy_mode mode;
    enum gn_ref_tier tier;
    double mrays_per_s;      /* the median run */
    double ratio_to_robust;  /* the median over the runs of speed / robust's speed in the same run */
    uint64_t rays;           /* judged; fewer for the exact tier */
    uint64_t lost, invented; /* wrong: a hit missed, a hit where there is none */
    uint64_t neighbour,
        other;     /* wrong: another triangle, which shares a vertex with a nearest one, or does not */
    uint64_t hits; /* right hits, which the errors of t are over */
    double t_error_median, t_error_max; /* in ulp of f32; NaN without a right hit */
    double build_seconds;
    uint64_t bytes;
};

static inline uint64_t gn_accuracy_row_wrong(const struct gn_accuracy_row *row)
{
    return row->lost + row->invented + row->neighbour + row->other;
}

/* Wrong ones that do not even name a neighbour of the right triangle: what shows in a picture. */
static inline uint64_t gn_accuracy_row_gross(const struct gn_accuracy_row *row)
{
    return row->lost + row->invented + row->other;
}

struct gn_accuracy_options {
    uint32_t rays;       /* of each kind */
    uint32_t exact_rays; /* most that the exact tier traces of each kind */
    uint32_t runs;       /* timed, odd */
    uint32_t threads;    /* that trace while time is taken */
    uint32_t jobs;       /* that judge */
    uint64_t seed;
    bool quick;
    double budget;
};

/* What was measured: rows in the order scene, aim, mode, tier. */
struct gn_accuracy {
    struct gn_accuracy_options options;
    struct gn_accuracy_scene *scenes;
    uint32_t scene_count;
    struct gn_accuracy_row *rows;
    size_t row_count;
    uint64_t judged_exactly; /* answers of rays for which the exact tier was asked */
    uint64_t judged;         /* rays */
    const struct gn_accuracy_driver *driver; /* NULL without --driver (accuracy_driver.h) */
    const struct gn_accuracy_layer *layer;   /* NULL without --layer (accuracy_layer.h) */
    const char *started;
    const char *machine; /* the processor, for the page */
    double seconds;
};

/* Rows that each scene adds. */
#define GN_ACCURACY_ROWS_PER_SCENE ((size_t)GN_AIM_COUNT * GN_ACCURACY_MODE_COUNT * GN_REF_TIER_COUNT)

/* Called now and then with what is being done and how much of the scene is done, 0 to 1. */
typedef void gn_accuracy_tick(void *user, const char *doing, double share);

/* Measures a committed scene and adds its rows. False with a message when memory is short. */
bool gn_accuracy_measure(struct gn_accuracy *accuracy, uint32_t scene, gn_accuracy_tick *tick, void *user,
                         char *out_error, size_t error_size);

/* A tier over all kinds of rays of one scene, or over all scenes. */
struct gn_accuracy_point {
    enum gn_ref_tier tier;
    double time;                 /* relative to robust: the geometric mean over the kinds (and scenes) */
    double mrays_per_s;          /* likewise */
    uint64_t rays, wrong, gross; /* gross ones are wrong, too */
    double wrong_per_million;
    double t_error_median; /* the median of the rows' medians; NaN when nothing was hit */
    double t_error_max;
};

#define GN_ACCURACY_ALL_SCENES UINT32_MAX

/* Points of every tier in tiers' order. */
void gn_accuracy_points(const struct gn_accuracy *accuracy, uint32_t scene, enum gn_accuracy_mode mode,
                        struct gn_accuracy_point out[GN_REF_TIER_COUNT]);

/* Errors of t up to this many ulp are what the measurement itself may be wrong by, and count as none. */
#define GN_ACCURACY_T_FLOOR 0x1p-14

/* The most accurate point whose time is at most `budget` (that is: budget times robust's); of equally
 * accurate ones the last, whose promise is the strongest. -1: none is fast enough. */
int gn_accuracy_choose(const struct gn_accuracy_point *points, size_t count, double budget);

/* Marks the points that no other one beats in time without being less accurate in `value`. */
void gn_accuracy_front(const double *times, const double *values, size_t count, bool *out_on_front);

/* "1.2x" or "1.2". False when it is not a positive number of at most 1e6. */
bool gn_accuracy_budget_parse(const char *text, double *out_budget);

/* Where none of n was wrong, how many per million may be at a confidence of 95 %: about 3/n. */
double gn_accuracy_unseen_per_million(uint64_t n);

/* The choice in words: "certified: 1.05x the time, 0 wrong per million (< 0.4 at 95 %), t within 1e-06 ulp".
 */
void gn_accuracy_choice_text(const struct gn_accuracy_point *points, int choice, double budget, char *out,
                             size_t size);

/* The tier within the budget that has fewer gross decisions per million than the choice, the fewest of all;
 * -1: none. */
int gn_accuracy_choose_gross(const struct gn_accuracy_point *points, size_t count, double budget, int choice);

/* A number with about three digits that says 0 only for 0: "0", "0.0012", "3,210". `out` has 32 characters.
 */
const char *gn_accuracy_number(double value, char out[32]);

/* The console's table, at most 100 columns wide. */
void gn_accuracy_print_scene(FILE *file, const struct gn_accuracy *accuracy, uint32_t scene);
void gn_accuracy_print_choice(FILE *file, const struct gn_accuracy *accuracy);

/* accuracy.json's text, malloc'ed; NULL when memory is short. */
char *gn_accuracy_json(const struct gn_accuracy *accuracy, size_t *out_length);

/* The plot as an SVG element: of all scenes or of one. `alone`: a file of its own, with its style. */
void gn_accuracy_plot(FILE *file, const struct gn_accuracy *accuracy, uint32_t scene, bool alone);
extern const char gn_accuracy_plot_style[];

/* The page. */
bool gn_accuracy_html_write(const struct gn_accuracy *accuracy, const char *path, char *out_error,
                            size_t error_size);

#endif
