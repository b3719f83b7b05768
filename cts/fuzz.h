/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Random differential testing: scenes that mix everything, made from a number; a failing one reduced to what makes it
 * fail; and files that hold such a scene whole, for `gnomon replay`.
 */
#ifndef GNOMON_CTS_FUZZ_H
#define GNOMON_CTS_FUZZ_H

#include "cts/case.h"

/* A scene and its rays, in memory of an arena; what lies behind pointers is never written to. */
struct gn_fuzz_trial {
    struct gn_cts_scene scene;
    struct gn_cts_ray *rays;
    uint32_t ray_count;
    enum gn_cts_program program;
    enum gn_case_backend backend;
    uint32_t focus; /* the instance that the failure is about, as far as known */
};

/* The same trial for the same numbers on every machine; `info` says what the device takes. */
void gn_fuzz_make(struct gn_arena *arena, uint64_t seed, uint64_t number, const struct gn_device_info *info,
                  struct gn_fuzz_trial *out);

/* Builds, traces and judges it; to be ended with gn_case_run_finish(). */
void gn_fuzz_execute(const struct gn_fuzz_trial *trial, struct gn_device *device, struct gn_case_run *out_run);

/* What may make a scene fail. Each can be taken out of it. */
enum gn_fuzz_ingredient {
    GN_FUZZ_INACTIVE,
    GN_FUZZ_FIRST_VERTEX,
    GN_FUZZ_OFFSETS, /* and strides */
    GN_FUZZ_FORMATS,
    GN_FUZZ_INDICES, /* other than 32-bit ones */
    GN_FUZZ_UPDATES, /* and rebuilds */
    GN_FUZZ_COPIES,
    GN_FUZZ_BUILD_FLAGS,
    GN_FUZZ_INSTANCE_ARRAY, /* pointers, offset, generic structures, builds of their own */
    GN_FUZZ_GEOMETRY_TRANSFORMS,
    GN_FUZZ_INSTANCE_TRANSFORMS,
    GN_FUZZ_MASKS,
    GN_FUZZ_INSTANCE_FLAGS,
    GN_FUZZ_INSTANCE_DATA, /* custom indices and SBT offsets */
    GN_FUZZ_OPACITY, /* geometries that are not opaque */
    GN_FUZZ_RAY_FLAGS,
    GN_FUZZ_RANGE,
    GN_FUZZ_POLICY, /* candidates that the shader refuses */
    GN_FUZZ_READ_BACK, /* programs that ask for more than the committed hit */
    GN_FUZZ_PIPELINE,
    GN_FUZZ_INGREDIENT_COUNT
};
const char *gn_fuzz_ingredient_name(enum gn_fuzz_ingredient ingredient);
/*
 * A copy without the ingredient, in memory of the arena. False when the trial has none of it. Transforms go without
 * moving what is met: those of geometries into the vertices, that of the instance in focus (which stays alone) into
 * the rays.
 */
bool gn_fuzz_without(struct gn_arena *arena, const struct gn_fuzz_trial *trial, enum gn_fuzz_ingredient ingredient,
                     struct gn_fuzz_trial *out);

/* Whether a trial still fails in the way that is looked for. */
typedef bool gn_fuzz_fails(void *context, const struct gn_fuzz_trial *trial);

/*
 * Which ingredients a failure needs: bit 1 << ingredient. inout_trial comes back without the others, and with the one
 * ray `ray` where that fails alone (ray_count 1 tells).
 */
uint32_t gn_fuzz_classify(struct gn_arena *arena, struct gn_fuzz_trial *inout_trial, uint32_t ray, gn_fuzz_fails *fails,
                          void *context);
/*
 * Reduces instances, geometries, primitives, vertices, rays and numbers as far as the failure stays, in no more than
 * that many attempts. Gives the attempts made.
 */
uint32_t gn_fuzz_shrink(struct gn_arena *arena, struct gn_fuzz_trial *inout_trial, uint32_t most_attempts,
                        gn_fuzz_fails *fails, void *context);

/* Files. The text is malloc'ed, NULL when memory is short. */
struct gn_fuzz_file {
    struct gn_fuzz_trial trial;
    const char *kind, *message, *driver, *device;
    uint64_t seed, number; /* which trial it came from */
};
char *gn_fuzz_encode(const struct gn_fuzz_file *file, size_t *out_length);
/* Untrusted text: false with a message when it is not a scene file or not a valid one. */
bool gn_fuzz_decode(const char *text, size_t length, struct gn_arena *arena, struct gn_fuzz_file *out, char *out_error,
                    size_t error_size);

/* Prints scene, ray, answers, each primitive's decisions and the verdict; gives the exit status of `gnomon replay`. */
int gn_fuzz_explain(const struct gn_fuzz_file *file, struct gn_device *device);

/* `gnomon run fuzz`. */
int gn_command_fuzz(int argc, char **argv);

#endif
