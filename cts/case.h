/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Cases, and what they may use.
 *
 * A family is one file in cts/cases/ that ends in a table of cases; cts/cases/families.def names the files. A
 * case makes scenes and rays and hands them to gn_case_trace(), which builds, traces, judges and counts. Most
 * cases share one function and differ in `params`.
 */
#ifndef GNOMON_CTS_CASE_H
#define GNOMON_CTS_CASE_H

#include "cts/arena.h"
#include "cts/device.h"
#include "cts/random.h"
#include "cts/scene.h"
#include "reference/tracer.h"

enum gn_case_status {
    GN_CASE_PASS,
    GN_CASE_FAIL,
    GN_CASE_LEAK,
    GN_CASE_SKIP,
    GN_CASE_CRASH,
    GN_CASE_TIMEOUT,
    GN_CASE_ERROR,
    GN_CASE_STATUS_COUNT
};
/* "pass", "fail", "leak", "skip", "crash", "timeout", "error". */
const char *gn_case_status_name(enum gn_case_status status);

struct gn_case_run;

struct gn_case {
    const char *name; /* without the backend: "flags.cull_back"; the part before the first dot is the family */
    const char *spec; /* what it is evidence for: a sentence of our own and where the specification says it */
    void (*run)(struct gn_case_run *run, const struct gn_case *self);
    const void *params;
    uint64_t value; /* for families that need one number rather than params */
};

struct gn_case_family {
    const char *name;
    const struct gn_case *cases;
    size_t case_count;
};

/* What a case is run through. Every case of a family exists once for each of the family's. */
enum gn_case_backend {
    GN_CASE_QUERY, /* ray queries */
    GN_CASE_PIPELINE, /* ray tracing pipelines */
    GN_CASE_NEITHER, /* nothing is traced, or the case chooses: its name has no prefix */
    GN_CASE_BACKEND_COUNT
};
/* "query", "pipeline", "". */
const char *gn_case_backend_name(enum gn_case_backend backend);

/* All families, in the order of families.def, and their backends as sums of 1 << enum gn_case_backend. */
extern const struct gn_case_family *const gn_case_families[];
extern const uint32_t gn_case_family_backends[];
/* Why a family is there if nothing is known that it alone notices; "" where there is such a fault in tests/faulty. */
extern const char *const gn_case_family_reasons[];
extern const size_t gn_case_family_count;

/* The first ray that was judged worst, and what is needed to show it. */
struct gn_case_offender {
    uint32_t trace; /* which gn_case_trace() of the case */
    uint32_t ray_index;
    struct gn_cts_ray ray;
    struct gn_ref_answer answer;
    struct gn_ref_verdict verdict;
};

/* What became of a sweep's rays at one value when a tier of the reference traced them. */
struct gn_case_tier {
    uint64_t rays; /* fewer of the exact tier; 0: it was not asked */
    uint64_t class_counts[GN_REF_VERDICT_CLASS_COUNT];
    double held_error_max, margin_max; /* as those of the driver */
};

/* One value of a sweep's parameter, and what became of its rays. */
struct gn_case_point {
    double value;
    bool judged; /* decides the status; otherwise it only informs */
    uint64_t rays, ideal_hits;
    uint64_t class_counts[GN_REF_VERDICT_CLASS_COUNT];
    double hit_error_median, hit_error_p999, hit_error_max; /* as those of the case */
    /* The largest hit error in parts of what it is held against, times the bound: above the bound is wrong. */
    double held_error_max;
    double margin_max; /* of every decision that differs from the ideal one, also where that is wrong */
    struct gn_case_tier tiers[GN_REF_TIER_COUNT]; /* on the same rays; they inform only */
};

/* A sweep: a parameter grown until the answers leave the bound. Strings are never NULL once `count` is above 0. */
struct gn_case_curve {
    const char *parameter; /* "aspect ratio of the triangles" */
    const char *unit; /* "degrees", or "" */
    const char *why; /* why the values are judged as far as they are */
    struct gn_case_point *points; /* from the easiest value to the hardest: either all grow or all shrink */
    uint32_t count;
};
/* The first point with an answer that left the bound (a leak, a double hit or a wrong one): the driver's answers, or a tier's. NULL: there is none. */
const struct gn_case_point *gn_case_curve_left(const struct gn_case_curve *curve);
const struct gn_case_point *gn_case_curve_tier_left(const struct gn_case_curve *curve, enum gn_ref_tier tier);

#define GN_CASE_ERROR_BINS 66
#define GN_CASE_RENDERED 3

/*
 * What is kept of rays for the other run of a gate, whose driver gets the same ones: where it answers the same, the verdict is
 * the same. Arrays are malloc'ed.
 */
struct gn_case_kept {
    /* Of the ray, its scene and the answer; the upper 16 bits tell ray and decisions alone. */
    uint64_t *digests;
    /* The hit error of an exact answer, or one of the following. */
    float *verdicts;
    size_t count;
};
#define GN_CASE_KEPT_MISS -1.0f /* exact: there is nothing to hit */
#define GN_CASE_KEPT_HIT -2.0f /* exact: a hit without an error to speak of */
#define GN_CASE_KEPT_OTHER -3.0f /* anything else, which has to be judged to say why */

/* What a case has come to; filled by the functions below, read by the runner and the reports. */
struct gn_case_result {
    enum gn_case_status status;
    char message[1024]; /* why not pass: the first offending ray, the driver's answer, the right one */
    double seconds;
    uint64_t rays;
    uint64_t checks; /* of gn_case_check() */
    uint64_t ideal_hits;
    uint64_t class_counts[GN_REF_VERDICT_CLASS_COUNT];
    double hit_error_median, hit_error_p999, hit_error_max; /* units of 2^-24, over hits */
    /* How many of these fall where: bin 0 has errors of 0, bin 1 those below 2^-8, and every further one reaches 2^(1/4) times as far. */
    uint64_t hit_error_bins[GN_CASE_ERROR_BINS];
    double margin_max;
    uint64_t answers; /* a digest of all that the driver answered, in order */
    struct gn_case_kept kept; /* of all rays, in order */
    struct gn_case_curve curve; /* of a sweep, whose sums above are those of the judged values alone */
    bool has_offender;
    struct gn_case_offender offender;
    /* One byte per ray of the trace with the offender (or of the first): enum gn_ref_verdict_class, plus 0x80
     * where the ideal answer is a miss. image_width x image_height, in ray order. */
    uint8_t *image;
    uint32_t image_width, image_height;
    /* Of a case that renders: PNGs in base64, in the run's arena; the driver's, the exact one, a heat map of their
     * difference. NULL: none. */
    const char *rendered[GN_CASE_RENDERED];
    /* Replay of one ray: the nearest primitives that it ideally meets, and how many there are in all. */
    struct gn_ref_hit nearest[8];
    int64_t nearest_count;
};

struct gn_case_run;
/* Takes a trace in the driver's place: what a case would trace, for those who only look. */
typedef void gn_case_witness(struct gn_case_run *run, const struct gn_cts_scene *scene, const struct gn_cts_ray *rays,
                             uint32_t ray_count, void *user);

struct gn_case_run {
    struct gn_device *device; /* NULL where there is a witness */
    gn_case_witness *witness;
    void *witness_user;
    struct gn_arena arena; /* finished when the case is over */
    struct gn_random random; /* seeded by the run's seed and the case's name */
    double scale; /* multiplies ray counts; 1 unless asked for by --scale */
    struct gn_cts_route route; /* of the traces to come; the backend's, until the case changes it */
    struct gn_case_result result;
    /* Replay: only this ray of this trace is explained; -1 otherwise. */
    int64_t only_trace;
    int64_t only_ray;
    uint32_t trace_count;
    struct gn_case_samples *samples; /* of hit errors; owned by judge.c */
    struct gn_case_point *point; /* what is traced belongs to it; NULL outside of sweeps */
    bool with_tiers; /* the rays of points are traced by the tiers, too */
    struct gn_case_samples *point_samples; /* likewise owned by judge.c */
    struct gn_case_kept known; /* what an earlier run kept of this case, or nothing */
};

/*
 * Builds the scene, traces the rays, judges every answer and adds to the result. `width` is how many rays make
 * a row of the picture (0: a square).
 */
void gn_case_trace(struct gn_case_run *run, const struct gn_cts_scene *scene, enum gn_cts_program program,
                   const struct gn_cts_ray *rays, uint32_t ray_count, uint32_t width);

/* The same, but the answers are judged as if these other rays had been traced: as many, each for its own. */
void gn_case_trace_as(struct gn_case_run *run, const struct gn_cts_scene *scene, enum gn_cts_program program,
                      const struct gn_cts_ray *rays, const struct gn_cts_ray *judged, uint32_t ray_count,
                      uint32_t width);

/*
 * The first half of gn_case_trace(): the answers alone, in memory of the arena. False when there are none: the run
 * then knows why, or only another trace of it is asked for.
 */
bool gn_case_answers(struct gn_case_run *run, const struct gn_cts_scene *scene, enum gn_cts_program program,
                     const struct gn_cts_ray *rays, uint32_t ray_count, struct gn_arena *arena,
                     struct gn_cts_answers *out_answers);

/*
 * The second half of gn_case_trace(): judges answers that came from elsewhere than run->device, one for each ray.
 */
void gn_case_judge(struct gn_case_run *run, const struct gn_cts_scene *scene, enum gn_cts_program program,
                   const struct gn_cts_ray *rays, uint32_t ray_count, uint32_t width,
                   const struct gn_cts_answers *answers);

/* The scene as the reference has it, committed; NULL, and the run in error, when it cannot take it. */
struct gn_ref_scene *gn_case_reference(struct gn_case_run *run, const struct gn_cts_scene *scene);

/* Adds the answers of a trace to what is kept, with verdicts yet to come; gn_case_trace() and gn_case_judge() do. */
void gn_case_digest(struct gn_case_run *run, const struct gn_ref_scene *reference, enum gn_cts_program program,
                    const struct gn_cts_ray *rays, const struct gn_cts_answers *answers, uint32_t ray_count);
/* The verdict that is known of a ray that has been added; GN_CASE_KEPT_OTHER where it has to be judged. */
float gn_case_known_verdict(const struct gn_case_run *run, size_t ray);
/*
 * The gate's two runs name a folder: GNOMON_ANSWERS_KEPT, where the first leaves what it keeps, and GNOMON_ANSWERS_KNOWN, where
 * the second finds it and leaves how many rays it answered otherwise. Reading and writing fail
 * silently: then all is judged.
 */
void gn_case_known_read(struct gn_case_run *run, const char *name);
void gn_case_kept_write(const struct gn_case_run *run, const char *name);
/* How many rays the second run decided otherwise, or (deciding the same) computed otherwise. False where that is not known. */
bool gn_case_changed_read(const char *folder, const char *name, uint64_t *out_decisions, uint64_t *out_numbers);
void gn_case_kept_finish(struct gn_case_kept *kept);

/*
 * Sweeps: names the curve, whose texts have to outlive the run, and makes room for `count` points; then everything
 * traced between the begin and the end of a point belongs to it.
 */
void gn_case_curve_begin(struct gn_case_run *run, const char *parameter, const char *unit, const char *why,
                         uint32_t count);
void gn_case_point_begin(struct gn_case_run *run, double value, bool judged);
void gn_case_point_end(struct gn_case_run *run);

/* Ends the case as skipped, with the reason; the first reason counts. The caller returns after it. */
void gn_case_skip(struct gn_case_run *run, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* What is not about a ray: counts a check, and fails the case when it does not hold. Gives `holds` back. */
bool gn_case_check(struct gn_case_run *run, bool holds, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Fails the case with a message that states both values; the first message is kept. */
void gn_case_fail(struct gn_case_run *run, const char *format, ...) __attribute__((format(printf, 2, 3)));

/*
 * The two halves of gn_case_execute(), for answers that come from elsewhere: a run from zeroed result, and its final
 * status. The run has to be finished in any case.
 */
void gn_case_run_begin(const struct gn_case *self, struct gn_device *device, uint64_t seed, double scale,
                       struct gn_case_run *out_run);
void gn_case_run_end(struct gn_case_run *run);

/* Runs one case in this process, from zeroed result to final status. `name` is the one with the backend. */
void gn_case_execute(const struct gn_case *self, const char *name, enum gn_case_backend backend, struct gn_device *device,
                     uint64_t seed, double scale,
                     int64_t only_trace, int64_t only_ray, struct gn_case_run *out_run);
void gn_case_run_finish(struct gn_case_run *run);

#endif
