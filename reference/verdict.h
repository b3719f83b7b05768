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
    struct gn_ref_hit ideal; /* the nearest ideal hit, when ideal_hit */
    double hit_error; /* units of 2^-24; 0 on a miss */
    double margin; /* the largest margin of a decision that differs from the ideal one; 0 when none does */
    char reason[320]; /* why, for people: which primitive, which decision, what was expected; "" when exact */
};

/* The bound, in units of 2^-24, for hit errors and margins. Derived in docs/numerics.md. */
double gn_ref_verdict_bound(void);

/*
 * Judges a committed (closest) hit; with TERMINATE_ON_FIRST_HIT in the ray's flags any hit will do. False
 * when memory is short or the ray is not valid. Thread-safe on a committed scene.
 */
bool gn_ref_verdict_committed(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray,
                              const struct gn_ref_policy *policy, const struct gn_ref_answer *answer,
                              struct gn_ref_verdict *out);

/*
 * Judges the list of candidates that an implementation presented for a ray none of which was confirmed:
 * every ideal one has to be there, none that is certainly missed, opaque triangles not at all (they are
 * committed), and a primitive of a NO_DUPLICATE geometry at most once. The order does not matter. `committed`
 * is the committed (opaque) hit of the same query: candidates beyond it may be absent.
 */
bool gn_ref_verdict_candidates(const struct gn_ref_scene *scene, const struct gn_ref_ray *ray,
                               const struct gn_ref_answer *candidates, size_t candidate_count,
                               const struct gn_ref_answer *committed, struct gn_ref_verdict *out);

#ifdef __cplusplus
}
#endif
#endif
