/* SPDX-License-Identifier: Apache-2.0 */
/* The scene model of the reference: BLASes of triangles or AABBs, instances of them, in exact terms. */
#ifndef GNOMON_REFERENCE_SCENE_H
#define GNOMON_REFERENCE_SCENE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif
#ifdef __GNUC__
#pragma GCC visibility push(default) /* what the shared library exports */
#endif

struct gn_ref_scene;

enum gn_ref_geometry_type {
    GN_REF_TRIANGLES = 0,
    GN_REF_AABBS = 1,
};

/* The values are those of VkGeometryFlagBitsKHR. */
enum {
    GN_REF_GEOMETRY_OPAQUE = 0x1,
    GN_REF_GEOMETRY_NO_DUPLICATE = 0x2,
};

/* The values are those of VkGeometryInstanceFlagBitsKHR. */
enum {
    GN_REF_INSTANCE_FACING_CULL_DISABLE = 0x1,
    GN_REF_INSTANCE_FLIP_FACING = 0x2,
    GN_REF_INSTANCE_FORCE_OPAQUE = 0x4,
    GN_REF_INSTANCE_FORCE_NO_OPAQUE = 0x8,
};

/* An instance whose reference is null: inactive, but it still counts in the instance ids. */
#define GN_REF_NULL_BLAS UINT32_MAX

/*
 * One geometry of a BLAS. Everything pointed to is copied by gn_ref_scene_add_blas().
 *
 * Triangles: the exact vertex is positions[i] / divisor. `divisor` is 1 for the floating point formats and
 * 32767 (or 127, ...) for the signed normalised ones, whose positions are then the integers themselves: so
 * every encodable vertex is represented without rounding. It has to be positive and finite. A triangle one
 * of whose vertices has a NaN in x is inactive: it is never hit and still counts in the primitive ids. The
 * vertices of active triangles have to be finite (the API leaves a NaN in y or z alone undefined); those that
 * no active triangle uses are not looked at.
 *
 * `transform` is the geometry transform (VkTransformMatrixKHR: 3 rows of 4), or NULL for none. A singular one
 * makes every triangle degenerate.
 *
 * AABBs: min x, y, z, then max x, y, z. A NaN in min x makes the box inactive; an active one has to be finite.
 * A box with min > max along an axis is empty and never hit.
 *
 * Arrays may be NULL where primitive_count is 0. What belongs to the other type is ignored.
 */
struct gn_ref_geometry {
    enum gn_ref_geometry_type type;
    uint32_t flags;
    uint32_t primitive_count;
    const double (*positions)[3];
    uint32_t position_count;
    double divisor;
    const uint32_t (*triangles)[3]; /* primitive_count of them, indices into positions */
    const float *transform;
    const float (*aabbs)[6]; /* primitive_count of them */
};

struct gn_ref_instance {
    float transform[12]; /* world from object, 3 rows of 4 */
    uint32_t custom_index; /* 24 bits */
    uint32_t mask; /* 8 bits */
    uint32_t sbt_offset; /* 24 bits */
    uint32_t flags; /* GN_REF_INSTANCE_* */
    uint32_t blas; /* what gn_ref_scene_add_blas() gave, or GN_REF_NULL_BLAS: then the transform is not looked at */
};

/* NULL when memory is short. */
struct gn_ref_scene *gn_ref_scene_create(void);
void gn_ref_scene_destroy(struct gn_ref_scene *scene);

/*
 * Adds a BLAS and gives its index in *out_blas. False, with a message to be had from gn_ref_scene_error(),
 * on an array that is missing, an index beyond position_count, an unknown type or flag, a divisor, transform,
 * vertex or box that is not as struct gn_ref_geometry asks, or lack of memory. The scene then is as before.
 */
bool gn_ref_scene_add_blas(struct gn_ref_scene *scene, const struct gn_ref_geometry *geometries,
                           uint32_t geometry_count, uint32_t *out_blas);

/*
 * Adds an instance; its id is the number of instances added before it. False, with a message, on an unknown
 * BLAS, a transform that is not finite, a value that exceeds its bits, unknown flags, FORCE_OPAQUE together with
 * FORCE_NO_OPAQUE, or lack of memory.
 */
bool gn_ref_scene_add_instance(struct gn_ref_scene *scene, const struct gn_ref_instance *instance);

/*
 * Prepares the scene for tracing. Afterwards nothing may be added, and any number of threads may trace.
 * A singular instance transform is an error (the API forbids it; the determinant's sign is decided exactly), and so
 * is lack of memory. Instances share the triangles of their BLAS, 60 to 150 bytes each; boxes are placed in the world once per
 * instance. There may be fewer than 2^30 primitives in all instances together. After a failure the scene can only be asked for its error and destroyed.
 */
bool gn_ref_scene_commit(struct gn_ref_scene *scene);

/* The last error of a call on this scene, or "". Owned by the scene. */
const char *gn_ref_scene_error(const struct gn_ref_scene *scene);

/* What was added, read back (valid after the add; owned by the scene). NULL when out of range. */
uint32_t gn_ref_scene_instance_count(const struct gn_ref_scene *scene);
const struct gn_ref_instance *gn_ref_scene_instance(const struct gn_ref_scene *scene, uint32_t instance);
uint32_t gn_ref_scene_geometry_count(const struct gn_ref_scene *scene, uint32_t blas);
const struct gn_ref_geometry *gn_ref_scene_geometry(const struct gn_ref_scene *scene, uint32_t blas,
                                                    uint32_t geometry);

#ifdef __GNUC__
#pragma GCC visibility pop
#endif
#ifdef __cplusplus
}
#endif
#endif
