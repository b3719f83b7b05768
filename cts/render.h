/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Light transport over scenes of the suite: rays are traced in batches by the driver or by the reference, and what
 * they meet is shaded here, the same way for both. Each effect traces rays only where materials, lights and flags
 * call for it.
 */
#ifndef GNOMON_CTS_RENDER_H
#define GNOMON_CTS_RENDER_H

#include "cts/case.h"

enum gn_render_effect {
    GN_RENDER_HARD_SHADOWS, /* one ray to each light without extent that the surface faces */
    GN_RENDER_SOFT_SHADOWS, /* several to each light with extent */
    GN_RENDER_REFLECTION, /* from mirrors, and from glass as far as it reflects */
    GN_RENDER_REFRACTION, /* through glass */
    GN_RENDER_DISPERSION, /* three rays through glass whose index depends on the colour, in the place of one */
    GN_RENDER_TRANSPARENCY, /* surfaces with holes: a shader is asked about each candidate */
    GN_RENDER_PROCEDURAL, /* spheres in boxes: the shader says where they are met */
    GN_RENDER_EFFECT_COUNT
};
/* "hard-shadows" and so on; and what is counted of it: "shadow rays" and so on. */
const char *gn_render_effect_name(enum gn_render_effect effect);
const char *gn_render_effect_counted(enum gn_render_effect effect);

/* What an instance is made of: materials[custom index]. */
struct gn_render_material {
    float colour[3];
    float mirror; /* 0 to 1: the share that is reflected */
    bool glass; /* refracts; colour is the tint */
    float index; /* of refraction, in the middle of the spectrum */
    float spread; /* index of blue less index of red */
    bool holes; /* a pattern of holes over each triangle; its geometries are not opaque */
    bool checkered; /* cubes of two shades in world space */
};

struct gn_render_light {
    double position[3];
    double radius; /* 0: a point */
    float colour[3];
};

struct gn_render_scene {
    const char *name, *text;
    struct gn_cts_scene scene; /* boxes hold the sphere that fits into them */
    const struct gn_render_material *materials;
    uint32_t material_count;
    const struct gn_render_light *lights;
    uint32_t light_count;
    float ambient[3], sky_low[3], sky_high[3];
    double eye[3], at[3], field; /* vertical, in degrees */
};

/* The scenes there are: "cubes", "landscape", "forest". Made in memory of the arena; false when there is none of that name. */
extern const char *const gn_render_names[];
extern const size_t gn_render_count;
bool gn_render_make(struct gn_arena *arena, const char *name, struct gn_render_scene *out);
/* One from the meshes of a model file, on a mirrored ground. False with a message as of gn_model_read(). */
bool gn_render_make_model(struct gn_arena *arena, const char *path, struct gn_render_scene *out, char *out_error,
                          size_t error_size);

struct gn_render_plan {
    uint32_t called; /* bit 1 << effect */
    char why[GN_RENDER_EFFECT_COUNT][96]; /* why it is called for, or why it is not */
};
void gn_render_plan(const struct gn_render_scene *scene, struct gn_render_plan *out);

struct gn_render_options {
    uint32_t width, height;
    uint32_t depth; /* of recursion: a ray that would go deeper is pink instead. 0: everything is */
    uint32_t samples; /* to each light with extent, a power of two */
    uint32_t forced; /* effects that run although nothing calls for them, as bits */
};

struct gn_render_result {
    float (*pixels)[3]; /* width * height, in the arena; linear */
    uint64_t primary, pink; /* rays from the eye; those that were not traced for depth */
    uint64_t rays[GN_RENDER_EFFECT_COUNT];
    uint64_t traced;
    double seconds; /* of the thread's own time by the reference, of the clock by a driver */
};

/* By the reference. False when memory is short or the scene not valid. */
bool gn_render_reference(struct gn_arena *arena, const struct gn_render_scene *scene,
                         const struct gn_render_options *options, struct gn_render_result *out);
/*
 * By run->device and run->route; every ray is judged and counted in the run, unless `judged` is false. False when the
 * run was skipped or met an error.
 */
bool gn_render_driver(struct gn_case_run *run, const struct gn_render_scene *scene,
                      const struct gn_render_options *options, bool judged, struct gn_render_result *out);

/* The root of the mean square over all pixels and channels. */
double gn_render_difference(const struct gn_render_result *a, const struct gn_render_result *b, uint32_t pixel_count);

/* Heat maps are black at no difference and white at this one. */
#define GN_RENDER_HEAT_FULL 0.1
/*
 * A picture as a PNG in base64, in memory of the arena; with `other`, a heat map of how far it is from that. NULL when
 * memory is short.
 */
const char *gn_render_png(struct gn_arena *arena, const struct gn_render_result *of, const struct gn_render_result *other,
                          uint32_t width, uint32_t height);

/* `gnomon effects` for these scenes. Whether the arguments name one of them. */
bool gn_command_render_wanted(int argc, char **argv);
int gn_command_render(int argc, char **argv);

#endif
