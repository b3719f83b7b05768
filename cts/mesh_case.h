/* SPDX-License-Identifier: Apache-2.0 */
/* The commonest case as data: one mesh, one instance, rays of several aims. */
#ifndef GNOMON_CTS_MESH_CASE_H
#define GNOMON_CTS_MESH_CASE_H

#include "cts/case.h"
#include "cts/generate.h"

/* Zero always means the plain choice. */
struct gn_mesh_case {
    struct gn_mesh_spec mesh;
    double stretch[3]; /* the vertices are scaled by it, then moved, and rounded to f32; 0: 1 */
    double move[3];
    bool unshared; /* every triangle has three vertices of its own */
    double inactive; /* the share of inactive triangles; implies unshared */
    struct gn_transform_spec geometry, instance;
    VkGeometryFlagsKHR geometry_flags;
    VkBuildAccelerationStructureFlagsKHR build_flags;
    enum gn_cts_program program;
    /* How many rays of which aim; multiplied by the run's scale. */
    uint32_t interior, edge, vertex, random;
    bool exact; /* rays of gn_rays_lattice(): the mesh has to be a lattice, the transforms none or dyadic */
    bool both_sides;
    double distance, min_cosine, max_cosine, direction_scale; /* as in struct gn_aim_options */
};

/* Makes and traces it; to be named in a table of cases, with `params` a struct gn_mesh_case. */
void gn_mesh_case_run(struct gn_case_run *run, const struct gn_case *self);

#endif
