/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Every hard case as a sweep: its parameter grows until the answers leave the bound, and the curve is in the report.
 * The status comes from the values that are judged; cts/cases/stability.h says how far that is, and why.
 */
#include "cts/cases/stability.h"

#include <string.h>

void gn_stability_scene(const struct gn_sweep_request *request, const struct gn_mesh *mesh,
                        const float *geometry_transform, const float *instance_transform,
                        struct gn_sweep_scene *out)
{
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(mesh);
    geometry.flags = GN_REF_GEOMETRY_OPAQUE;
    if (geometry_transform) {
        float *copy = GN_NEW(request->arena, float, 12);
        memcpy(copy, geometry_transform, 12 * sizeof *copy);
        geometry.transform = copy;
    }
    struct gn_cts_instance instance = gn_instance_of(0, instance_transform);
    out->scene = gn_scene_of_geometries(request->arena, &geometry, 1, &instance, 1);
    out->ray_count = request->ray_count;
    out->rays = GN_NEW(request->arena, struct gn_cts_ray, request->ray_count);
}

void gn_stability_aim(const struct gn_sweep_request *request, const struct gn_mesh *mesh,
                      const struct gn_aim_options *options, struct gn_cts_ray *ray)
{
    float *direction = ray->ray.direction;
    gn_rays_aimed_with(request->random, mesh, options, ray, 1);
    if (direction[0] == 0 && direction[1] == 0 && direction[2] == 0)
        direction[2] = gn_random_below(request->random, 2) ? 4 : -4;
}

void gn_stability_mesh(const struct gn_sweep_request *request, const struct gn_mesh *mesh,
                       const struct gn_aim_options *options, struct gn_stability_aims aims,
                       struct gn_sweep_scene *out)
{
    const uint32_t shares[4] = {aims.interior, aims.edge, aims.vertex, aims.random};
    struct gn_aim_options aimed = *options;
    uint32_t total = 0;
    gn_stability_scene(request, mesh, options->geometry_transform, options->instance_transform, out);
    for (int k = 0; k < 4; k++)
        total += shares[k];
    /* By turns, so that any first part of the rays has all kinds. */
    for (uint32_t i = 0; i < out->ray_count; i++) {
        uint32_t turn = i % total, kind = 0;
        while (turn >= shares[kind])
            turn -= shares[kind++];
        aimed.aim = (enum gn_aim)kind;
        gn_stability_aim(request, mesh, &aimed, &out->rays[i]);
    }
}

struct gn_mesh gn_stability_triangles(struct gn_arena *arena, uint32_t count)
{
    struct gn_mesh mesh = {gn_arena_alloc(arena, 3 * (size_t)count, sizeof *mesh.positions), 3 * count,
                           gn_arena_alloc(arena, count, sizeof *mesh.triangles), count};
    for (uint32_t i = 0; i < 3 * count; i++)
        mesh.triangles[i / 3][i % 3] = i;
    return mesh;
}

#define FAR "intersections are found where coordinates are large against the triangles (ray traversal)"
#define SCALES "the scene's scale does not change what is hit (ray traversal)"
#define DIRECTIONS "t is measured in lengths of the direction, which is not normalised (ray traversal)"
#define ZEROS "components of the direction may be zero of either sign, or of any size (ray traversal)"
#define SHARED                                                                                               \
    "a ray through the shared edges and vertices of a closed fan should not miss it (ray intersection "      \
    "candidate determination: watertightness)"
#define SINGLE                                                                                               \
    "where edges are not shared a ray may pass between triangles, but meets their insides (ray intersection " \
    "candidate determination: watertightness)"
#define MANY "each primitive and instance is intersected however many there are (ray traversal)"
#define CLOSEST "the closest hit is committed; of equally near ones any (ray closest hit determination)"
#define THIN "a thin triangle is hit like any other (ray traversal: ray-triangle intersection)"
#define GRAZES "a ray at a small angle to a triangle's plane still hits it (ray traversal: ray-triangle intersection)"
#define EDGE_ON "degenerate and edge-on triangles are not hit (ray traversal: ray-triangle intersection)"
#define PASSES                                                                                               \
    "a ray that passes beside an edge misses, one that passes inside of it hits, where the surface turns away too "  \
    "(ray traversal: ray-triangle intersection)"
#define PLACED "the ray is moved to the space of the instance by its transform (ray traversal; instances)"
#define FACING "facing is that of object space, which a mirrored instance does not turn over (ray intersection culling)"
#define TWICE "vertices are moved by the geometry's transform, then by the instance's (geometry; instances)"
#define READ "a query gives both matrices of the instance, and the ray in its space (ray query; ray traversal)"
#define POSITIONS "a query gives the vertices of the hit, after the geometry's transform (position fetch)"
#define RANGE "triangles are met where tmin < t < tmax, the ends excluded (ray intersection candidate determination)"
#define SURFACE "a hit at t = tmin is none (ray intersection candidate determination)"
#define BOX                                                                                                  \
    "a box is a candidate where the ray's closed range meets it, and may be enlarged but not lost (ray "     \
    "intersection candidate determination)"

#define ACTIVE                                                                                               \
    "only a NaN makes a triangle inactive; one with a corner far away, or infinite, leaves the others as they are " \
    "(acceleration structures: inactive primitives)"

#define SWEEP(name, spec, sweep)                                                                             \
    {                                                                                                        \
        "stability." name, spec, gn_sweep_run, &gn_stability_##sweep, 0                                      \
    }

static const struct gn_case cases[] = {
    SWEEP("far.vertices", FAR, far_vertices),
    SWEEP("far.instance", FAR, instance_far),
    SWEEP("far.viewer", FAR, far_viewer),
    SWEEP("far.edge_rays", SHARED, far_edge_rays),
    SWEEP("far.vertex_rays", SHARED, far_vertex_rays),
    SWEEP("scale.large", SCALES, scale_large),
    SWEEP("scale.small", SCALES, scale_small),
    SWEEP("scale.mixed", SCALES, mixed_scales),
    SWEEP("fan.spokes", SHARED, fan_spokes),
    SWEEP("fan.spike", THIN, fan_spike),
    SWEEP("count.triangles", MANY, cells),
    SWEEP("count.instances", MANY, instances),
    SWEEP("count.boxes", MANY, box_many),
    SWEEP("t_junctions", SINGLE, t_junctions),
    SWEEP("equal.coincident", CLOSEST, coincident),
    SWEEP("equal.coplanar", CLOSEST, coplanar),
    SWEEP("equal.layers", CLOSEST, layers),
    SWEEP("degenerate", EDGE_ON, degenerate),
    SWEEP("sliver.across", THIN, sliver),
    SWEEP("sliver.level", THIN, sliver_level),
    SWEEP("needle.across", THIN, needle),
    SWEEP("needle.level", THIN, needle_level),
    SWEEP("grazing.level", GRAZES, grazing_level),
    SWEEP("grazing.tilted", GRAZES, grazing_tilted),
    SWEEP("in_plane", EDGE_ON, in_plane),
    SWEEP("silhouette", PASSES, silhouette),
    SWEEP("instance.rotation", PLACED, rotation),
    SWEEP("instance.shear", PLACED, shear),
    SWEEP("instance.stretch", PLACED, stretch),
    SWEEP("instance.stretch_turned", PLACED, stretch_turned),
    SWEEP("instance.mirrored", FACING, mirrored),
    SWEEP("instance.nearly_singular", PLACED, singular),
    SWEEP("instance.large", PLACED, instance_large),
    SWEEP("instance.small", PLACED, instance_small),
    SWEEP("instance.and_geometry", TWICE, two_transforms),
    SWEEP("instance.read_back", READ, read_back),
    SWEEP("geometry.read_back", POSITIONS, positions),
    SWEEP("direction.long", DIRECTIONS, direction_long),
    SWEEP("direction.short", DIRECTIONS, direction_short),
    SWEEP("direction.tiny_component", ZEROS, component_tiny),
    SWEEP("direction.huge_component", ZEROS, component_huge),
    SWEEP("direction.zero_component", ZEROS, component_zero),
    SWEEP("range.near", RANGE, end_near),
    SWEEP("range.tilted", RANGE, end_tilted),
    SWEEP("range.empty", RANGE, end_empty),
    SWEEP("range.infinite", RANGE, end_infinite),
    SWEEP("origin.face", SURFACE, origin_face),
    SWEEP("origin.edge", SURFACE, origin_edge),
    SWEEP("origin.vertex", SURFACE, origin_vertex),
    SWEEP("box.flat", BOX, box_flat),
    SWEEP("box.face", BOX, box_face),
    SWEEP("box.corner", BOX, box_corner),
    SWEEP("box.inside", BOX, box_inside),
    SWEEP("box.far", BOX, box_far),
    SWEEP("infinite.beside", ACTIVE, infinite_beside),
    SWEEP("infinite.met", THIN, infinite_met),
    SWEEP("infinite.box", BOX, infinite_box),
};
const struct gn_case_family gn_family_stability = {"stability", cases, sizeof cases / sizeof cases[0]};
