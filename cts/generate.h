/* SPDX-License-Identifier: Apache-2.0 */
/* Meshes, transforms and rays that the cases are made of. All memory is the arena's. */
#ifndef GNOMON_CTS_GENERATE_H
#define GNOMON_CTS_GENERATE_H

#include "cts/arena.h"
#include "cts/random.h"
#include "cts/scene.h"

struct gn_mesh {
    double (*positions)[3]; /* each coordinate is an f32 value; NaN for an inactive vertex */
    uint32_t position_count;
    uint32_t (*triangles)[3];
    uint32_t triangle_count;
};

/* A height field over [-1,1]^2 in x and y of n x n cells (2 n^2 triangles, (n+1)^2 shared vertices), heights
 * random in +-amplitude, diagonals either way at random, counter-clockwise seen from +z. */
struct gn_mesh gn_mesh_height_field(struct gn_arena *arena, struct gn_random *random, uint32_t n, double amplitude);
/* The same on a lattice: x and y multiples of 2/n (n a power of two up to 1024), heights multiples of
 * amplitude/256 (amplitude a power of two). Rays from gn_rays_lattice() meet its points exactly. */
struct gn_mesh gn_mesh_lattice(struct gn_arena *arena, struct gn_random *random, uint32_t n, double amplitude);
/* A closed, star-shaped mesh around the origin: 2 poles and `rings` >= 2 rings of `sectors` >= 3 vertices,
 * 2 * rings * sectors triangles, radius 1 +- bumps (below 1), wound to face outwards. */
struct gn_mesh gn_mesh_blob(struct gn_arena *arena, struct gn_random *random, uint32_t rings, uint32_t sectors,
                            double bumps);
/* A closed torus around the z axis: major radius 1, minor radius below 1, wound to face outwards. */
struct gn_mesh gn_mesh_torus(struct gn_arena *arena, uint32_t rings, uint32_t sectors, double minor);
/* The cube [-1,1]^3, closed, each face of n x n cells (n a power of two): a lattice mesh, 12 n^2 triangles. */
struct gn_mesh gn_mesh_box(struct gn_arena *arena, uint32_t n);
/* The octahedron |x|+|y|+|z| = 1, closed, each face cut into n^2 triangles (n a power of two): a lattice mesh
 * whose faces are tilted, 8 n^2 triangles. */
struct gn_mesh gn_mesh_octahedron(struct gn_arena *arena, uint32_t n);
/* A closed fan of `spokes` >= 3 triangles around the hub (0, 0, height); the rim is at z = 0, with radii random
 * in [0.5, 1] and coordinates that are multiples of 2^-10. Faces +z. A height far above 1 makes a spike. The
 * hub is vertex 0. */
struct gn_mesh gn_mesh_fan(struct gn_arena *arena, struct gn_random *random, uint32_t spokes, double height);
/* Two height fields that meet along y = 0, the one of n cells a side, the other of 2n (n even): every second
 * vertex of the finer one lies on the middle of an edge of the coarser one, but for rounding where `bent`.
 * Rays through that seam may be lost. Faces +z, heights random in +-amplitude. */
struct gn_mesh gn_mesh_t_junctions(struct gn_arena *arena, struct gn_random *random, uint32_t n, double amplitude,
                                   bool bent);
/* Triangles that share nothing, of the given size, with centres in [-1,1]^3. */
struct gn_mesh gn_mesh_soup(struct gn_arena *arena, struct gn_random *random, uint32_t count, double size);
/* One quad in the z = 0 plane over [-1,1]^2, facing +z. */
struct gn_mesh gn_mesh_quad(struct gn_arena *arena);
/* One triangle: (-1,-1,0), (1,-1,0), (0,1,0), facing +z. */
struct gn_mesh gn_mesh_triangle(struct gn_arena *arena);

/* A copy whose positions are mapped by the 3 rows of 4 of `affine` and rounded to f32. A mirroring map turns
 * the facing over, as it does for the API's geometry transforms. */
struct gn_mesh gn_mesh_map(struct gn_arena *arena, const struct gn_mesh *mesh, const double affine[12]);
/* A copy scaled along the axes, then moved. */
struct gn_mesh gn_mesh_scaled(struct gn_arena *arena, const struct gn_mesh *mesh, double x, double y, double z,
                              double move_x, double move_y, double move_z);
/* Both, the second's triangles after the first's. */
struct gn_mesh gn_mesh_joined(struct gn_arena *arena, const struct gn_mesh *a, const struct gn_mesh *b);
/* A copy in which every triangle has three vertices of its own. */
struct gn_mesh gn_mesh_unshared(struct gn_arena *arena, const struct gn_mesh *mesh);
/* Makes about `share` of the triangles of an unshared mesh inactive: all three components of one or more of
 * its vertices become NaN. At least one triangle stays active. */
void gn_mesh_deactivate(struct gn_random *random, struct gn_mesh *mesh, double share);

/* A mesh as data, for tables of cases: the generator and its arguments. */
enum gn_mesh_kind {
    GN_MESH_HEIGHT_FIELD, /* n, size: the amplitude */
    GN_MESH_LATTICE, /* n, size: the amplitude */
    GN_MESH_BLOB, /* n rings, m sectors, size: the bumps */
    GN_MESH_TORUS, /* n rings, m sectors, size: the minor radius */
    GN_MESH_BOX, /* n */
    GN_MESH_OCTAHEDRON, /* n */
    GN_MESH_FAN, /* n spokes, size: the height */
    GN_MESH_T_JUNCTIONS, /* n, size: the amplitude, m: not 0 for bent */
    GN_MESH_SOUP, /* n, size */
    GN_MESH_QUAD,
    GN_MESH_TRIANGLE,
};
struct gn_mesh_spec {
    enum gn_mesh_kind kind;
    uint32_t n, m;
    double size;
};
struct gn_mesh gn_mesh_of(struct gn_arena *arena, struct gn_random *random, const struct gn_mesh_spec *spec);

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
 * transform (and the geometry transform, either may be NULL) places it. The facing is the API's: a mirrored
 * instance transform does not turn it over. tmin 0, tmax 10 x distance but at least 10 (the target is at t = 1),
 * mask 0xFF, flags 0, policy: confirm everything. The direction is target - origin rounded to f32, so the ray
 * meets the target only nearly. Inactive triangles are not aimed at.
 */
void gn_rays_aimed(struct gn_random *random, const struct gn_mesh *mesh, const float *geometry_transform,
                   const float *instance_transform, enum gn_aim aim, double distance, bool both_sides,
                   struct gn_cts_ray *rays, uint32_t count);

/* The same with more to choose; zero always means the plain choice. */
struct gn_aim_options {
    const float *geometry_transform; /* NULL: none */
    const float *instance_transform;
    enum gn_aim aim;
    double distance; /* 0: 4 */
    bool both_sides;
    /* The cosine between the way back to the origin and the triangle's normal, in world space: between these.
     * Zero: 0.15 and 1. Small values graze. */
    double min_cosine, max_cosine;
    double direction_scale; /* the direction is multiplied by it and t divided; 0: 1. tmax follows */
    uint32_t first_triangle, triangle_count; /* aim at these only; a count of 0: all */
};
void gn_rays_aimed_with(struct gn_random *random, const struct gn_mesh *mesh, const struct gn_aim_options *options,
                        struct gn_cts_ray *rays, uint32_t count);

/*
 * Exact hits on lattice meshes, from the side the triangle faces: the target is a vertex, a dyadic point of an
 * edge or of a triangle's inside; the direction 2^-k times a lattice vector; origin = target - direction * m
 * with whole m, all exact in f32, so that the ray meets the target without any rounding, at t = m. With
 * GN_AIM_RANDOM one of the other three at random. The second one aims from either side.
 */
void gn_rays_lattice(struct gn_random *random, const struct gn_mesh *mesh, enum gn_aim aim,
                     struct gn_cts_ray *rays, uint32_t count);
void gn_rays_lattice_both_sides(struct gn_random *random, const struct gn_mesh *mesh, enum gn_aim aim,
                                struct gn_cts_ray *rays, uint32_t count);
/* One that is aimed at this vertex, which triangles use. */
void gn_ray_lattice_at(struct gn_random *random, const struct gn_mesh *mesh, uint32_t vertex, struct gn_cts_ray *ray);

/*
 * Moves rays by the transform, if origins and directions come out as exact f32 values (a signed permutation
 * times powers of two, and a dyadic translation): true. Otherwise false, and the rays are as they were.
 */
bool gn_rays_move_exactly(struct gn_cts_ray *rays, uint32_t count, const float transform[12]);
/* Reorders the rays at random. */
void gn_rays_shuffle(struct gn_random *random, struct gn_cts_ray *rays, uint32_t count);
/* A ray with tmin 0, the given tmax, mask 0xFF, flags 0, policy: confirm everything. */
struct gn_cts_ray gn_ray_make(const double origin[3], const double direction[3], double tmax);

struct gn_cts_geometry gn_geometry_of_mesh(const struct gn_mesh *mesh);
/* A scene of one BLAS of one geometry, and one instance with the identity transform, mask 0xFF. */
struct gn_cts_scene gn_scene_of_geometry(struct gn_arena *arena, const struct gn_cts_geometry *geometry);
/* The same with instances of one's own; they and the geometries are copied. */
struct gn_cts_scene gn_scene_of_geometries(struct gn_arena *arena, const struct gn_cts_geometry *geometries,
                                           uint32_t geometry_count, const struct gn_cts_instance *instances,
                                           uint32_t instance_count);
/* An instance of a BLAS, mask 0xFF, everything else 0; `transform` NULL: the identity. */
struct gn_cts_instance gn_instance_of(uint32_t blas, const float *transform);

extern const float gn_identity[12];
/* Rotation by an angle about a random axis, times a scale along each axis, plus a translation. Scales are
 * log-uniform in [min_scale, max_scale], translations uniform in +-translation along each axis. */
void gn_transform_random(struct gn_random *random, double min_scale, double max_scale, double translation,
                         bool mirrored, float out[12]);
/* Rotation, scale along the axes, another rotation, and a shear along x by up to `shear` per unit of y and z:
 * the directions of greatest stretch are not the axes. */
void gn_transform_general(struct gn_random *random, double min_scale, double max_scale, double shear,
                          double translation, bool mirrored, float out[12]);
/* A signed permutation times a power of two in [2^-3, 2^3] plus a translation by multiples of 1/8: exact. */
void gn_transform_dyadic(struct gn_random *random, bool mirrored, float out[12]);
/* A transform as data; zero is none. */
enum gn_transform_kind { GN_TRANSFORM_NONE, GN_TRANSFORM_RANDOM, GN_TRANSFORM_GENERAL, GN_TRANSFORM_DYADIC };
struct gn_transform_spec {
    enum gn_transform_kind kind;
    double min_scale, max_scale; /* both 0: 1 */
    double shear, translation;
    bool mirrored;
};
/* Gives `out`, or NULL for none. */
const float *gn_transform_of(struct gn_random *random, const struct gn_transform_spec *spec, float out[12]);
/* The image of a point. */
void gn_transform_point(const float *transform, const double point[3], double out[3]);
/* The inverse of the linear part, or its transpose, applied to a vector. */
void gn_transform_inverse_apply(const float transform[12], const double v[3], bool transposed, double out[3]);

#endif
