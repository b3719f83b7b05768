/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a scene and a ray call for: trace.h and the tier CERTIFIED run the code of an effect only where it can make a
 * difference. This says which effects are called for and why, counts how often the code of each ran, and forces
 * effects on that are not called for, which changes no answer and shows what they cost.
 *
 *     struct gn_ref_effect_watch watch = {.counting = true};
 *     struct gn_ref_effect_watch *before = gn_ref_effects_watch(&watch);
 *     ... commit and trace on this thread ...
 *     gn_ref_effects_watch(before);
 *     watch.counts.ran[GN_REF_EFFECT_MASK] is 0 where every mask lets the rays pass
 */
#ifndef GNOMON_REFERENCE_EFFECTS_H
#define GNOMON_REFERENCE_EFFECTS_H

#include "reference/trace.h"

#ifdef __cplusplus
extern "C" {
#endif
#ifdef __GNUC__
#pragma GCC visibility push(default) /* what the shared library exports */
#endif

/* What is counted of each is said by gn_ref_effect_counted(). */
enum gn_ref_effect {
    GN_REF_EFFECT_MASK, /* comparing a candidate's instance mask with the ray's cull mask */
    GN_REF_EFFECT_ANY_HIT, /* finding out whether a candidate is opaque, and culling by that */
    GN_REF_EFFECT_FACE_CULLING, /* culling by the side that is seen */
    GN_REF_EFFECT_MIRRORING, /* turning the facing round for instances that are mirrored or flip it */
    GN_REF_EFFECT_INSTANCE_TRANSFORMS, /* taking rays into an instance's space, placing vertices and boxes by its transform */
    GN_REF_EFFECT_GEOMETRY_TRANSFORMS, /* placing vertices by the geometry's transform */
    GN_REF_EFFECT_AABBS, /* searching the boxes beside the triangles */
    GN_REF_EFFECT_COUNT
};

/* "mask", "any-hit", "face-culling", "mirroring", "instance-transforms", "geometry-transforms", "aabbs". */
const char *gn_ref_effect_name(enum gn_ref_effect effect);
/* What one of gn_ref_effect_counts.ran[effect] is: "mask tests of candidates" and so on. */
const char *gn_ref_effect_counted(enum gn_ref_effect effect);

struct gn_ref_effects {
    uint32_t called; /* bit 1 << effect */
    char why[GN_REF_EFFECT_COUNT][128]; /* why it is called for, or why it is not */
};

/*
 * What rays with these flags and this mask call for in a committed scene: `flags` and `cull_mask` as in struct
 * gn_ref_ray. Transforms count for the whole scene, though the code looks at each instance and geometry. False, and
 * all zero, when the scene is not committed.
 */
bool gn_ref_effects_of(const struct gn_ref_scene *scene, uint32_t flags, uint32_t cull_mask,
                       struct gn_ref_effects *out);

struct gn_ref_effect_counts {
    uint64_t ran[GN_REF_EFFECT_COUNT];
    uint64_t rays;
    uint64_t nodes; /* of the tree over triangles; each tests up to eight children */
    uint64_t leaves;
    uint64_t triangles; /* tested */
    uint64_t rejected_f32; /* of these: certainly missed, by f32 */
    uint64_t decided_f64; /* by f64 with its error bound */
    uint64_t decided_sharp; /* by f64 with its errors compensated */
    uint64_t decided_wide; /* by integers of 128 and 256 bits; ties that needed them count too */
    uint64_t decided_exact; /* by integers of any size, boxes and ties included */
};

/* All zero at first. `forced` may be changed at any time, the counts be read and set to zero. */
struct gn_ref_effect_watch {
    bool counting; /* false: nothing is counted and everything runs at its usual speed */
    uint32_t forced; /* bit 1 << effect */
    struct gn_ref_effect_counts counts;
};

/*
 * From now on what this thread commits and traces (trace.h, and tracer.h's CERTIFIED; EXACT counts transforms only)
 * runs what `watch` forces and counts into it; NULL ends that. Gives the watch that was there before. Effects forced
 * on make the numbers of a hit come out by other steps, within the bounds of trace.h, and change no decision.
 *
 * With `counting`, batches are traced ray by ray, and calls are slower by some per cent.
 */
struct gn_ref_effect_watch *gn_ref_effects_watch(struct gn_ref_effect_watch *watch);

#ifdef __GNUC__
#pragma GCC visibility pop
#endif
#ifdef __cplusplus
}
#endif
#endif
