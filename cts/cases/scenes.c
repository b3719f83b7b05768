/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Whole scenes: pictures in which every ray that the driver traced is judged, whose effects run only where something
 * calls for them, and which stay what they are, bit for bit, when every effect is forced.
 */
#include <string.h>

#include "cts/compose.h"
#include "cts/render.h"

static void picture(struct gn_case_run *run, const struct gn_case *self)
{
    const char *name = self->params;
    struct gn_render_scene scene;
    struct gn_render_plan plan;
    struct gn_render_result planned, forced, exact;
    const uint32_t width = 96, height = gn_ray_count(run, 64) < 64 ? 16 : 64;
    struct gn_render_options options = {width, height, 4, 4, 0};
    gn_render_make(&run->arena, name, &scene);
    gn_render_plan(&scene, &plan);
    if (!gn_render_driver(run, &scene, &options, true, &planned))
        return;
    for (int e = 0; e < GN_RENDER_EFFECT_COUNT; e++)
        gn_case_check(run, (plan.called >> e & 1) || planned.rays[e] == 0, "%llu %s, although %s",
                      (unsigned long long)planned.rays[e], gn_render_effect_counted((enum gn_render_effect)e), plan.why[e]);
    if (gn_render_reference(&run->arena, &scene, &options, &exact)) {
        const char **rendered = run->result.rendered;
        rendered[0] = gn_render_png(&run->arena, &planned, NULL, width, height);
        rendered[1] = gn_render_png(&run->arena, &exact, NULL, width, height);
        rendered[2] = gn_render_png(&run->arena, &planned, &exact, width, height);
    }
    /* What runs although nothing calls for it changes nothing. */
    options.forced = (1u << GN_RENDER_EFFECT_COUNT) - 1;
    if (!gn_render_driver(run, &scene, &options, false, &forced))
        return;
    gn_case_check(run, memcmp(planned.pixels, forced.pixels, (size_t)width * height * sizeof *planned.pixels) == 0,
                  "the picture changes when effects are forced that it does not call for: by %g",
                  gn_render_difference(&planned, &forced, width * height));
}

#define SPEC "a ray meets the nearest of what it meets, from wherever it starts (Vulkan: Ray Traversal)"
#define SCENE(label) {.name = "scenes." label, .spec = SPEC, .run = picture, .params = label}

static const struct gn_case cases[] = {SCENE("cubes"), SCENE("landscape"), SCENE("forest")};
const struct gn_case_family gn_family_scenes = {"scenes", cases, sizeof cases / sizeof cases[0]};
