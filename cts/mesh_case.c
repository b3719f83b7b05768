/* SPDX-License-Identifier: Apache-2.0 */
/* The commonest case: one mesh, one instance, rays of several aims. */
#include "cts/mesh_case.h"

#include "cts/compose.h"

static void aim(struct gn_case_run *run, const struct gn_mesh_case *what, const struct gn_mesh *mesh,
                const float *geometry_transform, const float *instance_transform, enum gn_aim kind,
                struct gn_cts_ray *rays, uint32_t count)
{
    if (!what->exact) {
        struct gn_aim_options options = {0};
        options.geometry_transform = geometry_transform;
        options.instance_transform = instance_transform;
        options.aim = kind;
        options.distance = what->distance;
        options.both_sides = what->both_sides;
        options.min_cosine = what->min_cosine;
        options.max_cosine = what->max_cosine;
        options.direction_scale = what->direction_scale;
        gn_rays_aimed_with(&run->random, mesh, &options, rays, count);
        return;
    }
    if (what->both_sides)
        gn_rays_lattice_both_sides(&run->random, mesh, kind, rays, count);
    else
        gn_rays_lattice(&run->random, mesh, kind, rays, count);
    if ((geometry_transform && !gn_rays_move_exactly(rays, count, geometry_transform)) ||
        (instance_transform && !gn_rays_move_exactly(rays, count, instance_transform)))
        gn_case_fail(run, "the case itself is wrong: expected transforms that move its rays without rounding");
}

/* Those of the case, at the mesh where the transforms place it. */
static struct gn_cts_ray *case_rays(struct gn_case_run *run, const struct gn_mesh_case *what,
                                    const struct gn_mesh *mesh, const float *geometry_transform,
                                    const float *instance_transform, uint32_t *out_count)
{
    const uint32_t wanted[4] = {what->interior, what->edge, what->vertex, what->random};
    uint32_t counts[4], total = 0;
    for (int k = 0; k < 4; k++) {
        counts[k] = wanted[k] ? gn_ray_count(run, wanted[k]) : 0;
        total += counts[k];
    }
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, total);
    for (uint32_t k = 0, done = 0; k < 4; done += counts[k], k++)
        aim(run, what, mesh, geometry_transform, instance_transform, (enum gn_aim)k, rays + done, counts[k]);
    *out_count = total;
    return rays;
}

void gn_mesh_case_run(struct gn_case_run *run, const struct gn_case *self)
{
    const struct gn_mesh_case *what = self->params;
    struct gn_mesh mesh = gn_mesh_of(&run->arena, &run->random, &what->mesh);
    double stretch[3];
    for (int c = 0; c < 3; c++)
        stretch[c] = what->stretch[c] ? what->stretch[c] : 1;
    mesh = gn_mesh_scaled(&run->arena, &mesh, stretch[0], stretch[1], stretch[2], what->move[0], what->move[1],
                          what->move[2]);
    if (what->unshared || what->inactive > 0)
        mesh = gn_mesh_unshared(&run->arena, &mesh);
    if (what->inactive > 0)
        gn_mesh_deactivate(&run->random, &mesh, what->inactive);

    float geometry_matrix[12], instance_matrix[12];
    const float *geometry_transform = gn_transform_of(&run->random, &what->geometry, geometry_matrix);
    const float *instance_transform = gn_transform_of(&run->random, &what->instance, instance_matrix);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = what->geometry_flags;
    geometry.transform = geometry_transform;
    struct gn_cts_blas blas = {0};
    blas.geometries = &geometry;
    blas.geometry_count = 1;
    blas.build_flags = what->build_flags;
    struct gn_cts_instance instance = gn_instance_of(0, instance_transform);
    struct gn_cts_scene scene = {0};
    scene.blases = &blas;
    scene.blas_count = 1;
    scene.instances = &instance;
    scene.instance_count = 1;

    uint32_t count;
    struct gn_cts_ray *rays = case_rays(run, what, &mesh, geometry_transform, instance_transform, &count);
    gn_case_trace(run, &scene, what->program, rays, count, 0);
}
