/* SPDX-License-Identifier: Apache-2.0 */
/* The scenes and rays of the proof: families of what is hard, from a seed. */
#ifndef GNOMON_TESTS_REFERENCE_FAMILIES_H
#define GNOMON_TESTS_REFERENCE_FAMILIES_H

#include "oracle.h"

struct rng {
    uint64_t state;
};
uint64_t rng_bits(struct rng *rng);
double rng_unit(struct rng *rng); /* [0, 1) */
uint32_t rng_below(struct rng *rng, uint32_t n);

/* A scene with the memory it owns. */
struct made_scene {
    struct oracle_scene scene;
    void *owned[64];
    int owned_count;
    double extent; /* about how large it is in the world */
    double grid; /* not 0: world vertices are small multiples of it */
};
void made_scene_free(struct made_scene *made);

enum aim { AIM_INTERIOR, AIM_EDGE, AIM_VERTEX, AIM_RANDOM, AIM_COUNT };
extern const char *const aim_names[AIM_COUNT];

struct family {
    const char *name;
    /* About `triangles` of them in all. */
    void (*make)(struct made_scene *made, struct rng *rng, uint32_t triangles);
    uint32_t most_triangles;
    unsigned options;
};
enum {
    RAYS_EXACT = 1, /* half of the rays meet their target exactly (scenes on a grid) */
    RAYS_FLAGS = 2, /* random flags and masks */
    RAYS_RANGE = 4, /* tmin and tmax at hits, or near */
    RAYS_SCALED = 8, /* directions of any length, denormal ones too */
    RAYS_ON_SURFACE = 16, /* origins on vertices, edges and faces */
    RAYS_AXIS = 32, /* along axes and faces of boxes */
    RAYS_FAR = 64, /* from far away */
    RAYS_NUDGED = 128, /* a zero of the direction replaced by about 2^-40 */
};
extern const struct family families[];
extern const uint32_t family_count;

/* One ray; made for tracing it with the oracle when the family asks for ranges at hits. */
struct gn_ref_ray made_ray(const struct made_scene *made, const struct family *family, enum aim aim, struct rng *rng,
                           struct oracle *oracle);

/* A height field of 2 n^2 triangles, for the large case. */
void make_height_field(struct made_scene *made, struct rng *rng, uint32_t n, bool lattice);

#endif
