/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The verdict on an implementation's answer: by how far would the problem have to be moved for the answer to
 * be right? docs/numerics.md has the model and the derivation of the bound.
 */
#ifndef GNOMON_REFERENCE_VERDICT_H
#define GNOMON_REFERENCE_VERDICT_H

#include "reference/trace.h"

#ifdef __cplusplus
extern "C" {
#endif
#ifdef __GNUC__
#pragma GCC visibility push(default) /* what the shared library exports */
#endif

enum gn_ref_verdict_class {
    GN_REF_EXACT, /* every decision is the ideal one, and the numbers are within the bound */
    GN_REF_ADMISSIBLE, /* a decision differs from the ideal one, but its margin is within the bound */
    GN_REF_GAP, /* a hit lost at a border, a T-junction, a silhouette, with its margin within the bound */
    GN_REF_LEAK, /* a hit lost at a shared edge or vertex whose triangles cover the neighbourhood */
    GN_REF_DOUBLE_HIT, /* one crossing of a shared edge or vertex presented twice */
    GN_REF_WRONG, /* anything else */
    GN_REF_VERDICT_CLASS_COUNT
};
/* "exact", "admissible", "gap", "leak", "double hit", "wrong". */
const char *gn_ref_verdict_class_name(enum gn_ref_verdict_class cls);

/* What an implementation answered for one ray. The ids count only when kind is not NONE. */
enum gn_ref_answer_kind { GN_REF_ANSWER_NONE = 0, GN_REF_ANSWER_TRIANGLE = 1, GN_REF_ANSWER_GENERATED = 2 };
struct gn_ref_answer {
    enum gn_ref_answer_kind kind;
    uint32_t instance;
    uint32_t geometry;
    uint32_t primitive;
    uint32_t custom_index;
    uint32_t sbt_offset;
    uint32_t front; /* 0 or 1; triangles only */
    float t;
    float barycentrics[2]; /* triangles only */
};

/* What the shader does with candidates that are not opaque. Bit (primitive & 31) of the mask decides. */
struct gn_ref_policy {
    uint32_t confirm_mask; /* non-opaque triangles: confirmed when the bit is set */
    uint32_t generate_mask; /* AABBs: a hit is generated when the bit is set ... */
    float generate_t0; /* ... at t0 + step * primitive, if that lies in [tmin, current closest t] */
    float generate_step; /* chosen so that the sum is exact in f32 */
};

struct gn_ref_verdict {
    enum gn_ref_verdict_class cls;
    bool ideal_hit; /* whether the ideal answer is a hit */
    struct gn_ref_hit ideal; /* the nearest ideal hit, when ideal_hit; of an AABB, t is the generated one */
    double hit_error; /* of the reported hit, in units of 2^-24; 0 on a miss */
    double hit_bound; /* what hit_error is held against: the bound times the conditioning of the hit */
    double margin; /* the largest margin of a decision that differs from the ideal one; 0 when none does */
    char reason[320]; /* why, for people: which primitive, which decision, what was expected; "" when exact */
};

/* The bound k, in units of 2^-24, for margins and for hit errors of well-conditioned hits. */
double gn_ref_verdict_bound(void);

/* A judge of answers on one committed scene, which has to outlive it. Any number of threads may judge. */
struct gn_ref_judge;
struct gn_ref_judge *gn_ref_judge_create(const struct gn_ref_scene *scene); /* NULL when memory is short */
void gn_ref_judge_destroy(struct gn_ref_judge *judge);

/*
 * Judges a committed (closest) hit; with TERMINATE_ON_FIRST_HIT in the ray's flags any hit will do. False
 * when memory is short or the ray is not valid.
 */
bool gn_ref_judge_committed(struct gn_ref_judge *judge, const struct gn_ref_ray *ray,
                            const struct gn_ref_policy *policy, const struct gn_ref_answer *answer,
                            struct gn_ref_verdict *out);

/*
 * Judges the list of candidates that an implementation presented for a ray none of which was confirmed:
 * every ideal one has to be there, none that is certainly missed, opaque triangles not at all (they are
 * committed), a triangle of a NO_DUPLICATE geometry at most once, and one crossing of a shared edge or vertex
 * at most once. The order does not matter. `committed` is the committed (opaque) hit of the same query, to be
 * judged on its own: candidates beyond it may be absent. False as above.
 */
bool gn_ref_judge_candidates(struct gn_ref_judge *judge, const struct gn_ref_ray *ray,
                             const struct gn_ref_answer *candidates, size_t candidate_count,
                             const struct gn_ref_answer *committed, struct gn_ref_verdict *out);

/*
 * The ray in the object space of an instance, and the sizes that its errors are measured by: an implementation's
 * object_origin[i] is right within bound * 2^-24 * size_origin[i], and so on. Matrices are 3 rows of 4.
 */
struct gn_ref_object_ray {
    double object_from_world[12], size_object_from_world[12];
    double origin[3], size_origin[3];
    double direction[3], size_direction[3];
};
bool gn_ref_judge_object_ray(const struct gn_ref_judge *judge, const struct gn_ref_ray *ray, uint32_t instance,
                             struct gn_ref_object_ray *out);

/*
 * The vertices of a triangle in object space (after the geometry transform), and their sizes. False when there
 * is no such triangle. `out_exact` tells that the vertices are the application's f32 values, without rounding.
 */
bool gn_ref_judge_vertices(const struct gn_ref_judge *judge, uint32_t instance, uint32_t geometry,
                           uint32_t primitive, double out_vertices[3][3], double out_sizes[3][3],
                           bool *out_exact);

#ifdef __GNUC__
#pragma GCC visibility pop
#endif
#ifdef __cplusplus
}
#endif
#endif
