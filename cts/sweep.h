/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Sweeps: one parameter grown until the answers leave the bound. Each of its values makes a scene and rays of its
 * own, and one point of the case's curve. How far the values are judged is stated with the sweep, from the
 * derivation of the bound (docs/numerics.md); the points beyond inform only.
 *
 * Nothing here needs a device: gn_sweep_make() gives any value's scene to whoever wants to trace it.
 */
#ifndef GNOMON_CTS_SWEEP_H
#define GNOMON_CTS_SWEEP_H

#include "cts/case.h"

/* What a value has to be turned into. */
struct gn_sweep_request {
    struct gn_arena *arena;
    struct gn_random *random;
    double value;
    uint32_t ray_count; /* how many rays are wanted; at least 1 */
    const void *params; /* the sweep's own */
};

struct gn_sweep_scene {
    struct gn_cts_scene scene;
    enum gn_cts_program program;
    struct gn_cts_ray *rays;
    uint32_t ray_count;
};

struct gn_sweep {
    const char *parameter; /* "aspect ratio of the triangles" */
    const char *unit; /* "degrees", or "" */
    const double *values; /* positive, from the easiest to the hardest: either all grow or all shrink */
    uint32_t value_count;
    double judged_to; /* the hardest value that is judged; the ones up to it are */
    const char *why; /* why it is that one */
    uint32_t ray_count; /* for each value, at scale 1 */
    /* Makes scene and rays in the request's arena; the same request gives the same. */
    void (*make)(const struct gn_sweep_request *request, struct gn_sweep_scene *out);
    const void *params;
};

/* The scene and rays of values[index]. `seed` decides all randomness; `ray_count` may differ from the sweep's. */
void gn_sweep_make(const struct gn_sweep *sweep, uint32_t index, uint64_t seed, uint32_t ray_count,
                   struct gn_arena *arena, struct gn_sweep_scene *out);

/* Who answers: traces and judges one scene within a run; gn_case_trace() by way of the driver. */
typedef void gn_sweep_tracer(struct gn_case_run *run, const struct gn_sweep_scene *scene, void *user);

/* Runs all values; each is one trace of the case. */
void gn_sweep_trace(struct gn_case_run *run, const struct gn_sweep *sweep, gn_sweep_tracer *tracer, void *user);

/* The same on the driver, to be named in a table of cases, with `params` a struct gn_sweep. */
void gn_sweep_run(struct gn_case_run *run, const struct gn_case *self);

#endif
