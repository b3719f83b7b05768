/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a scene and a ray call for: stated rightly, run zero times where it is not called for and at least once where
 * it is, and without influence on the answers when everything is forced on.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "reference/effects.h"
#include "reference/tracer.h"
#include "families.h"

#define BIT(effect) (1u << GN_REF_EFFECT_##effect)
#define ALL ((1u << GN_REF_EFFECT_COUNT) - 1)

static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
static const float moved[12] = {1, 0, 0, 0.5f, 0, 1, 0, 0, 0, 0, 1, 0};
static const float mirrored[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0};

/* A triangle and perhaps a box that the ray of ray_of() meets, in one instance. */
struct setting {
    const char *name;
    uint32_t geometry_flags, instance_flags, mask;
    const float *geometry_transform, *instance_transform;
    bool box;
    uint32_t ray_flags, ray_mask;
    uint32_t called;
};

static struct gn_ref_scene *scene_of(const struct setting *setting)
{
    static const double positions[3][3] = {{0, 0, 0}, {4, 0, 0}, {0, 4, 0}};
    static const uint32_t triangles[1][3] = {{0, 1, 2}};
    static const float boxes[1][6] = {{0, 0, -8, 4, 4, -4}};
    struct gn_ref_geometry geometries[2] = {
        {.type = GN_REF_TRIANGLES, .flags = setting->geometry_flags, .primitive_count = 1, .positions = positions,
         .position_count = 3, .divisor = 1, .triangles = triangles, .transform = setting->geometry_transform},
        {.type = GN_REF_AABBS, .flags = setting->geometry_flags, .primitive_count = 1, .aabbs = boxes},
    };
    struct gn_ref_instance instance = {.mask = setting->mask, .flags = setting->instance_flags};
    memcpy(instance.transform, setting->instance_transform ? setting->instance_transform : identity, sizeof identity);
    struct gn_ref_scene *scene = gn_ref_scene_create();
    assert_true(gn_ref_scene_add_blas(scene, geometries, setting->box ? 2 : 1, &instance.blas));
    assert_true(gn_ref_scene_add_instance(scene, &instance));
    assert_true(gn_ref_scene_commit(scene));
    return scene;
}

static struct gn_ref_ray ray_of(const struct setting *setting)
{
    return (struct gn_ref_ray){.origin = {1, 1, 5}, .direction = {0, 0, -1}, .tmax = INFINITY,
                               .flags = setting->ray_flags, .cull_mask = setting->ray_mask};
}

static const struct setting settings[] = {
    {"nothing", GN_REF_GEOMETRY_OPAQUE, 0, 0xFF, NULL, NULL, false, 0, 0xFF, 0},
    {"an identity is no transform", GN_REF_GEOMETRY_OPAQUE, 0, 0xFF, identity, identity, false, 0, 0xFF, 0},
    {"a mask that lets the ray pass", GN_REF_GEOMETRY_OPAQUE, 0, 0x0F, NULL, NULL, false, 0, 0x01, 0},
    {"a mask that does not", GN_REF_GEOMETRY_OPAQUE, 0, 0x0F, NULL, NULL, false, 0, 0x10, BIT(MASK)},
    {"a ray that sees nothing", GN_REF_GEOMETRY_OPAQUE, 0, 0xFF, NULL, NULL, false, 0, 0xF00, BIT(MASK)},
    {"not opaque", 0, 0, 0xFF, NULL, NULL, false, 0, 0xFF, BIT(ANY_HIT)},
    {"forced opaque by the instance", 0, GN_REF_INSTANCE_FORCE_OPAQUE, 0xFF, NULL, NULL, false, 0, 0xFF, 0},
    {"forced opaque by the ray", 0, 0, 0xFF, NULL, NULL, false, GN_REF_RAY_OPAQUE, 0xFF, 0},
    {"forced not opaque by the ray", GN_REF_GEOMETRY_OPAQUE, 0, 0xFF, NULL, NULL, false, GN_REF_RAY_NO_OPAQUE, 0xFF,
     BIT(ANY_HIT)},
    {"opaque is culled", GN_REF_GEOMETRY_OPAQUE, 0, 0xFF, NULL, NULL, false, GN_REF_RAY_CULL_OPAQUE, 0xFF, BIT(ANY_HIT)},
    {"not opaque is culled, but all is", GN_REF_GEOMETRY_OPAQUE, 0, 0xFF, NULL, NULL, false,
     GN_REF_RAY_CULL_NO_OPAQUE, 0xFF, 0},
    {"faces are culled", GN_REF_GEOMETRY_OPAQUE, 0, 0xFF, NULL, NULL, false, GN_REF_RAY_CULL_BACK_FACING, 0xFF,
     BIT(FACE_CULLING)},
    {"faces are culled, but not here", GN_REF_GEOMETRY_OPAQUE, GN_REF_INSTANCE_FACING_CULL_DISABLE, 0xFF, NULL, NULL,
     false, GN_REF_RAY_CULL_BACK_FACING, 0xFF, 0},
    {"flipped", GN_REF_GEOMETRY_OPAQUE, GN_REF_INSTANCE_FLIP_FACING, 0xFF, NULL, NULL, false, 0, 0xFF, BIT(MIRRORING)},
    {"an instance moved", GN_REF_GEOMETRY_OPAQUE, 0, 0xFF, NULL, moved, false, 0, 0xFF, BIT(INSTANCE_TRANSFORMS)},
    {"an instance mirrored", GN_REF_GEOMETRY_OPAQUE, 0, 0xFF, NULL, mirrored, false, 0, 0xFF,
     BIT(INSTANCE_TRANSFORMS) | BIT(MIRRORING)},
    {"a geometry moved", GN_REF_GEOMETRY_OPAQUE, 0, 0xFF, moved, NULL, false, 0, 0xFF, BIT(GEOMETRY_TRANSFORMS)},
    {"a box", GN_REF_GEOMETRY_OPAQUE, 0, 0xFF, NULL, NULL, true, 0, 0xFF, BIT(AABBS)},
    {"a box that is skipped", GN_REF_GEOMETRY_OPAQUE, 0, 0xFF, NULL, NULL, true, GN_REF_RAY_SKIP_AABBS, 0xFF, 0},
    {"all", 0, GN_REF_INSTANCE_FLIP_FACING, 0x0F, moved, mirrored, true, GN_REF_RAY_CULL_FRONT_FACING, 0xF0, ALL},
};

/* The closest hit, whether there is one, and the list. */
struct answers {
    struct gn_ref_record closest, batch, all[8];
    enum gn_ref_outcome occluded;
    int64_t count;
};

static void ask(struct answers *out, const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray)
{
    memset(out, 0, sizeof *out);
    gn_ref_tracer_closest(tracer, ray, &out->closest);
    gn_ref_tracer_closest_batch(tracer, ray, 1, &out->batch);
    out->occluded = gn_ref_tracer_occluded(tracer, ray);
    out->count = gn_ref_tracer_all(tracer, ray, out->all, 8);
}

static void an_effect_runs_when_it_is_called_for(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof settings / sizeof settings[0]; i++) {
        const struct setting *setting = &settings[i];
        struct gn_ref_effect_watch watch = {.counting = true};
        assert_null(gn_ref_effects_watch(&watch));
        struct gn_ref_scene *scene = scene_of(setting);
        struct gn_ref_tracer *tracer = gn_ref_tracer_create(scene, GN_REF_TIER_CERTIFIED, NULL, 0);
        struct gn_ref_ray ray = ray_of(setting);
        struct gn_ref_effects effects;
        struct answers answers;
        assert_true(gn_ref_effects_of(scene, ray.flags, ray.cull_mask, &effects));
        if (effects.called != setting->called)
            fail_msg("%s: called for is 0x%x, expected 0x%x", setting->name, effects.called, setting->called);
        ask(&answers, tracer, &ray);
        assert_true(gn_ref_effects_watch(NULL) == &watch);
        for (int e = 0; e < GN_REF_EFFECT_COUNT; e++) {
            assert_true(effects.why[e][0] != '\0');
            bool called = setting->called >> e & 1, ran = watch.counts.ran[e] > 0;
            /* Where the mask hides everything nothing else is looked at but what commit did. */
            bool hidden = (setting->called & BIT(MASK)) && called;
            if ((ran && !called) || (called && !ran && !hidden))
                fail_msg("%s: %s ran %llu times (%s)", setting->name, gn_ref_effect_name((enum gn_ref_effect)e),
                         (unsigned long long)watch.counts.ran[e], effects.why[e]);
        }
        assert_int_equal(watch.counts.rays, 4);
        assert_true(watch.counts.nodes >= 4 && watch.counts.triangles >= 4);
        assert_true(!(setting->called & BIT(MASK)) || watch.counts.ran[GN_REF_EFFECT_MASK] > 0);
        gn_ref_tracer_destroy(tracer);
        gn_ref_scene_destroy(scene);
    }
}

static struct gn_ref_scene *scene_commit(const struct oracle_scene *of)
{
    struct gn_ref_scene *scene = gn_ref_scene_create();
    for (uint32_t b = 0; b < of->blas_count; b++) {
        uint32_t blas;
        assert_true(gn_ref_scene_add_blas(scene, &of->geometries[of->blas_first[b]],
                                          of->blas_first[b + 1] - of->blas_first[b], &blas));
    }
    for (uint32_t i = 0; i < of->instance_count; i++)
        assert_true(gn_ref_scene_add_instance(scene, &of->instances[i]));
    assert_true(gn_ref_scene_commit(scene));
    return scene;
}

static bool same(const struct gn_ref_record *a, const struct gn_ref_record *b)
{
    const struct gn_ref_hit *p = &a->hit, *q = &b->hit;
    return a->outcome == b->outcome && p->type == q->type && p->instance == q->instance && p->geometry == q->geometry &&
           p->primitive == q->primitive && p->front == q->front && p->opaque == q->opaque &&
           (p->t == q->t || fabs(p->t - q->t) <= a->hit.t_error + b->hit.t_error) &&
           fabs(p->beta - q->beta) <= a->hit.barycentric_error + b->hit.barycentric_error &&
           fabs(p->gamma - q->gamma) <= a->hit.barycentric_error + b->hit.barycentric_error;
}

static void forcing_effects_on_changes_no_answer(void **state)
{
    (void)state;
    uint64_t ran[GN_REF_EFFECT_COUNT] = {0}, forced_ran[GN_REF_EFFECT_COUNT] = {0};
    for (uint32_t f = 0; f < family_count; f++) {
        struct rng rng = {f + 77};
        struct made_scene made = {0};
        families[f].make(&made, &rng, 200);
        struct gn_ref_effect_watch usual = {.counting = true}, forced = {.counting = true, .forced = ALL};
        gn_ref_effects_watch(&usual);
        struct gn_ref_scene *scene = scene_commit(&made.scene);
        gn_ref_effects_watch(&forced);
        struct gn_ref_scene *other = scene_commit(&made.scene);
        gn_ref_effects_watch(NULL);
        struct gn_ref_tracer *tracers[2] = {gn_ref_tracer_create(scene, GN_REF_TIER_CERTIFIED, NULL, 0),
                                            gn_ref_tracer_create(other, GN_REF_TIER_CERTIFIED, NULL, 0)};
        struct oracle *oracle = oracle_create(&made.scene);
        for (int i = 0; i < 400; i++) {
            struct gn_ref_ray ray = made_ray(&made, &families[f], (enum aim)(i % AIM_COUNT), &rng, oracle);
            struct answers plain, a, b;
            ask(&plain, tracers[0], &ray); /* by the kernels that do not count */
            gn_ref_effects_watch(&usual);
            ask(&a, tracers[0], &ray);
            gn_ref_effects_watch(&forced);
            ask(&b, tracers[1], &ray);
            gn_ref_effects_watch(NULL);
            bool agree = same(&a.closest, &b.closest) && same(&a.batch, &b.batch) && a.occluded == b.occluded &&
                         a.count == b.count && same(&a.closest, &plain.closest) && same(&a.batch, &plain.batch) &&
                         a.occluded == plain.occluded && a.count == plain.count;
            for (int64_t h = 0; agree && h < a.count && h < 8; h++)
                agree = same(&a.all[h], &b.all[h]);
            if (!agree)
                fail_msg("%s, ray %d: with everything forced on the answer is another one", families[f].name, i);
        }
        for (int e = 0; e < GN_REF_EFFECT_COUNT; e++) {
            ran[e] += usual.counts.ran[e];
            forced_ran[e] += forced.counts.ran[e];
        }
        gn_ref_tracer_destroy(tracers[0]);
        gn_ref_tracer_destroy(tracers[1]);
        oracle_destroy(oracle);
        gn_ref_scene_destroy(scene);
        gn_ref_scene_destroy(other);
        made_scene_free(&made);
    }
    for (int e = 0; e < GN_REF_EFFECT_COUNT; e++)
        if (forced_ran[e] <= ran[e] && e != GN_REF_EFFECT_AABBS)
            fail_msg("%s: forced on it ran %llu times, expected more than %llu", gn_ref_effect_name((enum gn_ref_effect)e),
                     (unsigned long long)forced_ran[e], (unsigned long long)ran[e]);
}

static void what_cannot_be_told(void **state)
{
    (void)state;
    struct gn_ref_scene *scene = gn_ref_scene_create();
    struct gn_ref_effects effects;
    assert_false(gn_ref_effects_of(NULL, 0, 0xFF, &effects));
    assert_false(gn_ref_effects_of(scene, 0, 0xFF, &effects));
    assert_true(gn_ref_scene_commit(scene));
    assert_true(gn_ref_effects_of(scene, 0, 0xFF, &effects));
    assert_null(gn_ref_effect_name(GN_REF_EFFECT_COUNT));
    assert_null(gn_ref_effect_counted(GN_REF_EFFECT_COUNT));
    gn_ref_scene_destroy(scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_effect_runs_when_it_is_called_for),
        cmocka_unit_test(forcing_effects_on_changes_no_answer),
        cmocka_unit_test(what_cannot_be_told),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
