/* SPDX-License-Identifier: Apache-2.0 */
/* The simplest scene there is: if this fails, look here first. */
#include "cts/case.h"
#include "cts/generate.h"

static void quad(struct gn_case_run *run, const struct gn_case *self)
{
    (void)self;
    struct gn_mesh mesh = gn_mesh_quad(&run->arena);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = VK_GEOMETRY_OPAQUE_BIT_KHR;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, 4096);
    gn_rays_aimed(&run->random, &mesh, NULL, NULL, GN_AIM_RANDOM, 4.0, true, rays, 4096);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, 4096, 64);
}

static const struct gn_case cases[] = {
    {"smoke.quad", "a ray meets an opaque quad or misses it (ray traversal)", quad, NULL, 0},
};
const struct gn_case_family gn_family_smoke = {"smoke", cases, sizeof cases / sizeof cases[0]};
