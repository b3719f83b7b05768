/* SPDX-License-Identifier: Apache-2.0 */
/* Sweeps: makes the scene of every value and hands it to whoever answers. */
#include "cts/sweep.h"

#include <string.h>

static bool judges(const struct gn_sweep *sweep, double value)
{
    bool grows = sweep->values[sweep->value_count - 1] >= sweep->values[0];
    return grows ? value <= sweep->judged_to : value >= sweep->judged_to;
}

void gn_sweep_make(const struct gn_sweep *sweep, uint32_t index, uint64_t seed, uint32_t ray_count,
                   struct gn_arena *arena, struct gn_sweep_scene *out)
{
    /* A value's rays stay the same when values are added before it. */
    struct gn_random random = {seed};
    const double value = sweep->values[index];
    uint64_t bits = 0;
    memcpy(&bits, &value, sizeof bits);
    random.state = gn_random_u64(&random) ^ bits;
    const struct gn_sweep_request request = {arena, &random, value, ray_count ? ray_count : 1, sweep->params};
    *out = (struct gn_sweep_scene){.program = GN_CTS_COMMITTED};
    sweep->make(&request, out);
}

/* As with gn_ray_count(): enough that the judged values of all sweeps come to a million rays in a run of scale 1. */
#define BASE_FACTOR 1.25

void gn_sweep_trace(struct gn_case_run *run, const struct gn_sweep *sweep, gn_sweep_tracer *tracer, void *user)
{
    const uint64_t seed = gn_random_u64(&run->random);
    double count = (double)sweep->ray_count * BASE_FACTOR * run->scale;
    gn_case_curve_begin(run, sweep->parameter, sweep->unit, sweep->why, sweep->value_count);
    for (uint32_t i = 0; i < sweep->value_count; i++) {
        struct gn_arena arena = {0};
        struct gn_sweep_scene scene;
        gn_sweep_make(sweep, i, seed, count > 1e7 ? 10000000u : (uint32_t)count, &arena, &scene);
        gn_case_point_begin(run, sweep->values[i], judges(sweep, sweep->values[i]));
        tracer(run, &scene, user);
        gn_case_point_end(run);
        gn_arena_finish(&arena);
    }
}

static void trace_on_driver(struct gn_case_run *run, const struct gn_sweep_scene *scene, void *user)
{
    (void)user;
    gn_case_trace(run, &scene->scene, scene->program, scene->rays, scene->ray_count, 0);
}

void gn_sweep_run(struct gn_case_run *run, const struct gn_case *self)
{
    /* Once is enough: the rays are the same by every route. */
    run->with_tiers = run->route.entry == GN_CTS_QUERY;
    gn_sweep_trace(run, self->params, trace_on_driver, NULL);
}
