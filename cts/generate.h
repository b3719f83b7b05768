/* SPDX-License-Identifier: Apache-2.0 */
/* Meshes, transforms and rays that the cases are made of. All memory is the arena's. */
#ifndef GNOMON_CTS_GENERATE_H
#define GNOMON_CTS_GENERATE_H

#include "cts/arena.h"
#include "cts/random.h"
#include "cts/scene.h"

struct gn_mesh {
    double (*positions)[3]; /* each coordinate is an f32 value */
    uint32_t position_count;
    uint32_t (*triangles)[3];
    uint32_t triangle_count;
};

/* A height field over [-1,1]^2 in x and y of n x n cells (2 n^2 triangles, (n+1)^2 shared vertices), heights
 * random in +-amplitude, counter-clockwise seen from +z. */
struct gn_mesh gn_mesh_height_field(struct gn_arena *arena, struct gn_random *random, uint32_t n, double amplitude);
/* The same on a lattice: x and y multiples of 2/n (n a power of two), heights multiples of amplitude/256. */
struct gn_mesh gn_mesh_lattice(struct gn_arena *arena, struct gn_random *random, uint32_t n, double amplitude);
/* A closed, star-shaped mesh around the origin: rings x sectors, radius 1 +- bumps, wound to face outwards. */
struct gn_mesh gn_mesh_blob(struct gn_arena *arena, struct gn_random *random, uint32_t rings, uint32_t sectors,
                            double bumps);
/* Triangles that share nothing, of the given size, with centres in [-1,1]^3. */
struct gn_mesh gn_mesh_soup(struct gn_arena *arena, struct gn_random *random, uint32_t count, double size);
/* One quad in the z = 0 plane over [-1,1]^2. */
struct gn_mesh gn_mesh_quad(struct gn_arena *arena);

/* Where a ray is aimed at. */
enum gn_aim {
    GN_AIM_INTERIOR, /* a random point inside a random triangle */
    GN_AIM_EDGE, /* a random point of a random edge */
    GN_AIM_VERTEX, /* a random vertex */
    GN_AIM_RANDOM, /* a random point of the mesh's bounding box, grown by a quarter */
};

/*
 * Fills rays[count] with rays from random origins at about `distance` from the target on the side the hit
 * triangle faces (or either side with `both_sides`), through a target of that kind on the mesh as the instance
 * transform (and the geometry transform, either may be NULL) places it. tmin 0, tmax 10 x distance, mask 0xFF,
 * flags 0, policy: confirm everything. The direction is target - origin rounded to f32, so the ray meets the
 * target only nearly; with lattice meshes and `lattice_origins` it meets it exactly.
 */
void gn_rays_aimed(struct gn_random *random, const struct gn_mesh *mesh, const float *geometry_transform,
                   const float *instance_transform, enum gn_aim aim, double distance, bool both_sides,
                   struct gn_cts_ray *rays, uint32_t count);
/* Exact hits on lattice meshes: direction 2^-k times a lattice vector; origin = target - direction * m, exact. */
void gn_rays_lattice(struct gn_random *random, const struct gn_mesh *mesh, enum gn_aim aim,
                     struct gn_cts_ray *rays, uint32_t count);

struct gn_cts_geometry gn_geometry_of_mesh(const struct gn_mesh *mesh);
/* A scene of one BLAS of one geometry, and one instance with the identity transform, mask 0xFF. */
struct gn_cts_scene gn_scene_of_geometry(struct gn_arena *arena, const struct gn_cts_geometry *geometry);

extern const float gn_identity[12];
/* Rotation by an angle about a random axis, times a scale along each axis, plus a translation. */
void gn_transform_random(struct gn_random *random, double min_scale, double max_scale, double translation,
                         bool mirrored, float out[12]);

#endif
