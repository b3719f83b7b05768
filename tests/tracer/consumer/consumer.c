/* SPDX-License-Identifier: Apache-2.0 */
/* One triangle, one ray, every tier, and a verdict: as somebody who has only the installed headers would write it. */
#include <math.h>
#include <stdio.h>

#include <reference/tracer.h>
#include <reference/verdict.h>

int main(void)
{
    const double positions[3][3] = {{0, 0, 0}, {4, 0, 0}, {0, 4, 0}};
    const uint32_t triangles[1][3] = {{0, 1, 2}};
    const struct gn_ref_geometry geometry = {.primitive_count = 1, .positions = positions, .position_count = 3,
                                             .divisor = 1, .triangles = triangles};
    struct gn_ref_instance instance = {.transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, .mask = 0xFF};
    const struct gn_ref_ray ray = {.origin = {1, 1, 5}, .direction = {0, 0, -1}, .tmax = INFINITY, .cull_mask = 0xFF};
    struct gn_ref_scene *scene = gn_ref_scene_create();
    int right = 0;
    if (!scene || !gn_ref_scene_add_blas(scene, &geometry, 1, &instance.blas) ||
        !gn_ref_scene_add_instance(scene, &instance) || !gn_ref_scene_commit(scene))
        return 1;
    for (int i = 0; i < GN_REF_TIER_COUNT; i++) {
        char error[320];
        struct gn_ref_record record;
        struct gn_ref_tracer *tracer = gn_ref_tracer_create(scene, (enum gn_ref_tier)i, error, sizeof error);
        if (!tracer) {
            fprintf(stderr, "%s\n", error);
            return 1;
        }
        if (gn_ref_tracer_closest(tracer, &ray, &record) == GN_REF_HIT && record.hit.t == 5)
            right++;
        gn_ref_tracer_destroy(tracer);
    }
    struct gn_ref_judge *judge = gn_ref_judge_create(scene);
    const struct gn_ref_answer answer = {.kind = GN_REF_ANSWER_TRIANGLE, .t = 5, .barycentrics = {0.25f, 0.25f},
                                         .front = 1};
    const struct gn_ref_policy policy = {.confirm_mask = 0xFFFFFFFF};
    struct gn_ref_verdict verdict;
    if (judge && gn_ref_judge_committed(judge, &ray, &policy, &answer, &verdict))
        printf("%d tiers are right; the verdict is %s\n", right, gn_ref_verdict_class_name(verdict.cls));
    gn_ref_judge_destroy(judge);
    gn_ref_scene_destroy(scene);
    return right == GN_REF_TIER_COUNT && verdict.cls == GN_REF_EXACT ? 0 : 1;
}
