/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `gnomon accuracy --driver`: the driver's time against its error over the ways to build a scene. Every setting is
 * measured beside the first one, which is built to be traced fast from f32 vertices, in turns on the same rays.
 *
 * Two errors are kept apart. The verdict (docs/numerics.md) is on what the driver was given, vertices as their format
 * encodes them: whether it traced rightly. The wrong decisions and the error of t are against the scene as it was
 * meant, in exact arithmetic: what an application gets.
 */
#ifndef GNOMON_CTS_ACCURACY_DRIVER_H
#define GNOMON_CTS_ACCURACY_DRIVER_H

#include "cts/accuracy.h"
#include "cts/device.h"

struct yyjson_mut_doc;
struct yyjson_mut_val;

struct gn_accuracy_setting {
    const char *name;  /* as in accuracy.json: "fast_build" */
    const char *group; /* "flags", "format", "update" */
    const char *about; /* for people */
    VkBuildAccelerationStructureFlagsKHR flags;
    VkFormat format; /* VK_FORMAT_UNDEFINED: f32 as it is; otherwise scaled to fill the format's range */
    uint8_t step; /* enum gn_cts_step after the first build */
    double motion; /* of the vertices from the first build to the step; a share of the scene's size */
};
extern const struct gn_accuracy_setting gn_accuracy_settings[];
#define GN_ACCURACY_SETTING_COUNT 11
/* The settings that all others, and that other updates, are compared with. */
#define GN_ACCURACY_SETTING_PLAIN 0
#define GN_ACCURACY_SETTING_REBUILT 8

/* Of how many rays of each kind the answers are judged, at most. */
#define GN_ACCURACY_DRIVER_JUDGED 20000

struct gn_accuracy_driver_row {
    uint32_t scene, setting;
    enum gn_aim aim;
    double mrays_per_s;    /* the median run */
    double ratio_to_plain; /* the median over the runs of speed / plain's speed in the same run */
    uint64_t rays;         /* judged */
    uint64_t class_counts[GN_REF_VERDICT_CLASS_COUNT]; /* on what the driver was given */
    uint64_t lost, invented, neighbour, other; /* as of gn_accuracy_row, against what was meant */
    uint64_t hits;
    double t_error_median, t_error_max; /* over the right hits, in ulp of f32; NaN without one */
    double build_seconds;  /* the median, all steps included */
    double build_ratio;    /* the median of its ratio to plain's, built right after */
    double update_seconds; /* of the step: less what the first build alone takes; NaN where there is none */
    uint64_t bytes; /* of the structures */
};

struct gn_accuracy_driver {
    const char *icd;
    char device[256], about[512]; /* its name; driver and version */
    struct gn_accuracy_driver_row *rows; /* in the order scene, setting, kind of rays */
    size_t row_count;
    char left_out[1024]; /* settings that the driver does not support, for people */
};

/*
 * Measures all scenes in a child process, because a driver may crash or hang. Call it before threads are started, the
 * scenes loaded and not committed. False with a message and an exit status: 2 for a driver that cannot be used, 3 when
 * it fails. Rows are the arena's.
 */
bool gn_accuracy_driver_measure(const struct gn_accuracy *accuracy, const char *icd, struct gn_arena *arena,
                                struct gn_accuracy_driver *out, int *out_exit_status, char *out_error, size_t error_size);

/* A setting over all kinds of rays of one scene, or of all. */
struct gn_accuracy_driver_point {
    double time;  /* relative to plain: the geometric mean */
    double build; /* likewise, of the time to build */
    double size;  /* likewise, of the bytes */
    double update; /* the step's time over that of the rebuild; NaN where there is no step */
    uint64_t rays, wrong, gross, left; /* left: the verdict leaves the bound */
    double t_error_median, t_error_max;
};
/* False when the setting was not measured. */
bool gn_accuracy_driver_sum(const struct gn_accuracy_driver *driver, uint32_t scene, uint32_t setting,
                            struct gn_accuracy_driver_point *out);

/* Adds the rows to the list of accuracy.json, keys as docs/accuracy.md has them. */
bool gn_accuracy_driver_json(const struct gn_accuracy *accuracy, struct yyjson_mut_doc *doc,
                             struct yyjson_mut_val *list);
void gn_accuracy_driver_print(FILE *file, const struct gn_accuracy *accuracy);
/* The section of the page. */
void gn_accuracy_driver_html(FILE *file, const struct gn_accuracy *accuracy);

#endif
