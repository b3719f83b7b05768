/* SPDX-License-Identifier: Apache-2.0 */
/* What a scene and a ray call for, in bits for the traces and in words for people. */
#include "reference/effects.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "reference/scene_internal.h"

static const struct {
    const char *name, *counted;
} effects[GN_REF_EFFECT_COUNT] = {
    [GN_REF_EFFECT_MASK] = {"mask", "mask tests of candidates"},
    [GN_REF_EFFECT_ANY_HIT] = {"any-hit", "look-ups of a candidate's opacity"},
    [GN_REF_EFFECT_FACE_CULLING] = {"face-culling", "culling tests of a candidate's facing"},
    [GN_REF_EFFECT_MIRRORING] = {"mirroring", "look-ups of how an instance turns the facing"},
    [GN_REF_EFFECT_INSTANCE_TRANSFORMS] = {"instance-transforms", "rays, vertices and boxes placed by an instance"},
    [GN_REF_EFFECT_GEOMETRY_TRANSFORMS] = {"geometry-transforms", "vertices placed by a geometry"},
    [GN_REF_EFFECT_AABBS] = {"aabbs", "nodes and boxes tested"},
};

static _Thread_local struct gn_ref_effect_watch *watching;

struct gn_ref_effect_watch *gn_ref_effects_watch(struct gn_ref_effect_watch *watch)
{
    struct gn_ref_effect_watch *before = watching;
    watching = watch;
    return before;
}

uint32_t gn_ref_effects_forced(void)
{
    return watching ? watching->forced : 0;
}

struct gn_ref_effect_counts *gn_ref_effects_counting(void)
{
    return watching && watching->counting ? &watching->counts : NULL;
}

void gn_ref_effect_ran(enum gn_ref_effect effect, uint64_t times)
{
    if (watching && watching->counting)
        watching->counts.ran[effect] += times;
}

bool gn_ref_effect_applies(enum gn_ref_effect effect, bool called, uint64_t times)
{
    if (!called && !(gn_ref_effects_forced() >> effect & 1))
        return false;
    gn_ref_effect_ran(effect, times);
    return true;
}

const char *gn_ref_effect_name(enum gn_ref_effect effect)
{
    return (unsigned)effect < GN_REF_EFFECT_COUNT ? effects[effect].name : NULL;
}

const char *gn_ref_effect_counted(enum gn_ref_effect effect)
{
    return (unsigned)effect < GN_REF_EFFECT_COUNT ? effects[effect].counted : NULL;
}

static void __attribute__((format(printf, 3, 4))) say(struct gn_ref_effects *out, enum gn_ref_effect effect,
                                                      const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(out->why[effect], sizeof out->why[effect], format, arguments);
    va_end(arguments);
}

static void say_opacity(struct gn_ref_effects *out, const struct gn_ref_scene *scene, uint32_t flags)
{
    bool called = out->called >> GN_REF_EFFECT_ANY_HIT & 1;
    const char *all = flags & GN_REF_RAY_OPAQUE ? "the ray makes everything opaque"
                      : flags & GN_REF_RAY_NO_OPAQUE ? "the ray makes nothing opaque"
                      : scene->opacity == 1 ? "everything is opaque"
                      : scene->opacity == 0 ? "nothing is opaque"
                                            : "opaque and other geometries are mixed";
    say(out, GN_REF_EFFECT_ANY_HIT, "%s%s", all,
        called && (flags & GN_REF_RAY_CULL_OPAQUE) ? ", and the ray culls what is opaque" : "");
}

bool gn_ref_effects_of(const struct gn_ref_scene *scene, uint32_t flags, uint32_t cull_mask,
                       struct gn_ref_effects *out)
{
    *out = (struct gn_ref_effects){0};
    if (!scene || !scene->committed)
        return false;
    out->called = gn_ref_effects_called(scene, flags, cull_mask);
    uint32_t called = out->called, boxes = scene->box_count;
    cull_mask &= 0xFF;
    if (called >> GN_REF_EFFECT_MASK & 1)
        say(out, GN_REF_EFFECT_MASK, "the masks of all instances have 0x%02x in common, the ray's is 0x%02x",
            scene->common_mask, cull_mask);
    else
        say(out, GN_REF_EFFECT_MASK, "every instance's mask has a bit of the ray's 0x%02x", cull_mask);
    say_opacity(out, scene, flags);
    bool culls = flags & (GN_REF_RAY_CULL_BACK_FACING | GN_REF_RAY_CULL_FRONT_FACING);
    say(out, GN_REF_EFFECT_FACE_CULLING, "%s%s", culls ? "the ray culls faces" : "the ray culls no faces",
        culls && !scene->culls ? ", but no instance lets it" : "");
    say(out, GN_REF_EFFECT_MIRRORING, scene->turned ? "an instance is mirrored or flips its facing"
                                                    : "no instance is mirrored or flips its facing");
    say(out, GN_REF_EFFECT_INSTANCE_TRANSFORMS, "%u of %u instances are transformed", scene->moved_instances,
        scene->instance_count);
    say(out, GN_REF_EFFECT_GEOMETRY_TRANSFORMS, "%u geometries of the instances are transformed",
        scene->moved_geometries);
    say(out, GN_REF_EFFECT_AABBS, boxes ? "the scene has %u boxes%s" : "the scene has no boxes", boxes,
        flags & GN_REF_RAY_SKIP_AABBS ? ", but the ray skips them" : "");
    return true;
}
