/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Metamorphic relations: one scene told in two ways. Moved, scaled by powers of two, with its axes renamed or mirrored,
 * its triangles in another order, its corners turned, split into geometries and instances: each ray, moved alike, meets
 * the same triangle from the same side. The rays are exact and aimed at insides, so no rounding stands between.
 */
#include <math.h>
#include <string.h>

#include "cts/compose.h"

#define SPEC                                                                                                 \
    "a hit depends on the geometry that the ray meets, not on where it lies in the inputs (Vulkan: Ray Traversal; " \
    "acceleration structures are opaque)"

enum change {
    NONE, /* the same again */
    TRANSLATE,
    SCALE,
    RENAME_AXES,
    MIRROR, /* the vertices: facing turns over */
    REVERSE, /* the order of the triangles */
    SHUFFLE,
    TURN_CORNERS,
    REVERSE_WINDING, /* facing turns over */
    SPLIT_GEOMETRIES,
    SPLIT_INSTANCES,
    REPEAT_INSTANCES, /* every triangle of one BLAS in an instance by masks: only one is seen */
    INSTANCE_TRANSFORM,
    GEOMETRY_TRANSFORM,
    MIRROR_INSTANCE, /* facing stays */
    MIRROR_GEOMETRY, /* facing turns over */
    REVERSE_INSTANCES,
    NULL_INSTANCES, /* between the others */
};

struct params {
    enum change change;
    double amount; /* of a translation or a scale */
    uint32_t parts; /* of a split */
};

enum { N = 8, MOST_PARTS = 64 };

static double moved_one(const struct params *params, int axis, double value)
{
    switch (params->change) {
    case TRANSLATE:
        return value + params->amount * (axis + 1);
    case SCALE:
        return value * params->amount;
    case MIRROR:
    case MIRROR_INSTANCE:
    case MIRROR_GEOMETRY:
        return axis == 0 ? -value : value;
    case INSTANCE_TRANSFORM:
    case GEOMETRY_TRANSFORM:
        return 2 * value + (axis == 1 ? 3 : 0);
    default:
        return value;
    }
}

/* A point of the scene as it is, and as it is told; a direction where `direction` is set. */
static void moved(const struct params *params, const double in[3], bool direction, double out[3])
{
    for (int a = 0; a < 3; a++) {
        int from = params->change == RENAME_AXES ? (a + 1) % 3 : a;
        out[a] = moved_one(params, a, in[from]) - (direction ? moved_one(params, a, 0) : 0);
    }
}

/* What is told: the triangles in their order, and the transforms that the change leaves to the structures. */
struct telling {
    struct gn_cts_scene scene;
    const uint32_t *order; /* triangle i of the telling is order[i] of the scene */
    uint32_t first[MOST_PARTS]; /* of each part; a part is a geometry or an instance */
    bool by_instance;
    bool facing_turns;
};

static void telling_make(struct gn_case_run *run, const struct params *params, const struct gn_mesh *mesh,
                         struct telling *out)
{
    static const float scaled[12] = {2, 0, 0, 0, 0, 2, 0, 3, 0, 0, 2, 0};
    static const float mirrored[12] = {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    struct gn_arena *arena = &run->arena;
    const enum change change = params->change;
    const uint32_t count = mesh->triangle_count;
    const uint32_t parts = params->parts ? params->parts : 1;
    const bool structural = change == INSTANCE_TRANSFORM || change == GEOMETRY_TRANSFORM || change == MIRROR_INSTANCE ||
                            change == MIRROR_GEOMETRY;
    uint32_t *order = GN_NEW(arena, uint32_t, count);
    for (uint32_t i = 0; i < count; i++)
        order[i] = change == REVERSE ? count - 1 - i : i;
    for (uint32_t i = count; change == SHUFFLE && i > 1; i--) {
        const uint32_t j = gn_random_below(&run->random, i), kept = order[i - 1];
        order[i - 1] = order[j];
        order[j] = kept;
    }
    double(*positions)[3] = gn_arena_alloc(arena, mesh->position_count, sizeof *positions);
    for (uint32_t i = 0; i < mesh->position_count; i++) {
        if (structural)
            memcpy(positions[i], mesh->positions[i], sizeof positions[i]);
        else
            moved(params, mesh->positions[i], false, positions[i]);
    }
    uint32_t(*triangles)[3] = gn_arena_alloc(arena, count, sizeof *triangles);
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t c = 0; c < 3; c++) {
            const uint32_t from = change == TURN_CORNERS ? (c + 1 + i % 2) % 3 : change == REVERSE_WINDING ? 2 - c : c;
            triangles[i][c] = mesh->triangles[order[i]][from];
        }
    struct gn_cts_geometry *geometries = GN_NEW(arena, struct gn_cts_geometry, parts);
    out->by_instance = change == SPLIT_INSTANCES || change == REVERSE_INSTANCES || change == NULL_INSTANCES ||
                       change == REPEAT_INSTANCES;
    const uint32_t step = change == NULL_INSTANCES ? 2 : 1;
    const uint32_t blas_count = out->by_instance ? parts : 1, instance_count = out->by_instance ? parts * step : 1;
    struct gn_cts_blas *blases = GN_NEW(arena, struct gn_cts_blas, blas_count);
    struct gn_cts_instance *instances = GN_NEW(arena, struct gn_cts_instance, instance_count);
    for (uint32_t p = 0; p < parts; p++) {
        const uint32_t begin = (uint32_t)((uint64_t)count * p / parts), end = (uint32_t)((uint64_t)count * (p + 1) / parts);
        const bool whole = change == REPEAT_INSTANCES;
        geometries[p] = (struct gn_cts_geometry){
            .flags = VK_GEOMETRY_OPAQUE_BIT_KHR,
            .positions = (const double(*)[3])positions,
            .position_count = mesh->position_count,
            .triangles = (const uint32_t(*)[3])(triangles + (whole ? 0 : begin)),
            .triangle_count = whole ? count : end - begin,
            .transform = change == GEOMETRY_TRANSFORM ? scaled : change == MIRROR_GEOMETRY ? mirrored : NULL,
        };
        const uint32_t place = change == REVERSE_INSTANCES ? parts - 1 - p : p;
        out->first[place] = whole ? 0 : begin;
        if (out->by_instance) {
            blases[p] = (struct gn_cts_blas){.geometries = &geometries[p], .geometry_count = 1};
            instances[place * step] = gn_instance_of(p, NULL);
            if (change == REPEAT_INSTANCES)
                instances[place].mask = p + 1 == parts ? 0xFF : 0;
            if (change == NULL_INSTANCES)
                instances[place * step + 1] = gn_instance_of(GN_CTS_NO_BLAS, NULL);
        }
    }
    if (!out->by_instance) {
        blases[0] = (struct gn_cts_blas){.geometries = geometries, .geometry_count = parts};
        instances[0] = gn_instance_of(0, change == INSTANCE_TRANSFORM ? scaled
                                         : change == MIRROR_INSTANCE  ? mirrored
                                                                      : NULL);
    }
    out->scene = gn_scene_make(blases, blas_count, instances, instance_count);
    out->order = order;
    out->facing_turns = change == MIRROR || change == REVERSE_WINDING || change == MIRROR_GEOMETRY;
}

/* The triangle of the scene that an answer about the telling means. */
static uint32_t meant(const struct params *params, const struct telling *telling, const struct gn_ref_answer *answer)
{
    uint32_t part = telling->by_instance ? answer->instance : answer->geometry;
    if (params->change == NULL_INSTANCES)
        part /= 2;
    return telling->order[telling->first[part % MOST_PARTS] + answer->primitive];
}

/* On an edge there is more than one right answer. */
static bool inside(const struct gn_ref_answer *answer)
{
    const float least = 0x1p-6f;
    const float *b = answer->barycentrics;
    return b[0] > least && b[1] > least && b[0] + b[1] < 1 - least;
}

static void relation(struct gn_case_run *run, const struct gn_case *self)
{
    const struct params *params = self->params;
    struct gn_arena *arena = &run->arena;
    struct gn_mesh mesh = gn_mesh_lattice(arena, &run->random, N, 0.5);
    struct telling plain, told;
    telling_make(run, &(const struct params){0}, &mesh, &plain);
    telling_make(run, params, &mesh, &told);
    const uint32_t count = gn_ray_count(run, 8192);
    struct gn_cts_ray *rays = GN_NEW(arena, struct gn_cts_ray, count), *moved_rays = GN_NEW(arena, struct gn_cts_ray, count);
    gn_rays_lattice_both_sides(&run->random, &mesh, GN_AIM_INTERIOR, rays, count);
    for (uint32_t i = 0; i < count; i++) {
        double in[3], out[3];
        moved_rays[i] = rays[i];
        for (int part = 0; part < 2; part++) {
            float *values = part ? moved_rays[i].ray.direction : moved_rays[i].ray.origin;
            for (int a = 0; a < 3; a++)
                in[a] = (double)values[a];
            moved(params, in, part, out);
            for (int a = 0; a < 3; a++)
                values[a] = (float)out[a];
        }
    }
    struct gn_cts_answers before, after;
    if (!gn_case_answers(run, &plain.scene, GN_CTS_COMMITTED, rays, count, arena, &before) ||
        !gn_case_answers(run, &told.scene, GN_CTS_COMMITTED, moved_rays, count, arena, &after))
        return;
    for (uint32_t i = 0; i < count; i++) {
        const struct gn_ref_answer *a = &before.committed[i], *b = &after.committed[i];
        if (!gn_case_check(run, a->kind == b->kind, "ray %u: kind of hit %d, told otherwise %d", i, (int)a->kind,
                           (int)b->kind) ||
            a->kind != GN_REF_ANSWER_TRIANGLE || !inside(a))
            continue;
        const uint32_t one = plain.order[a->primitive], other = meant(params, &told, b);
        gn_case_check(run, one == other, "ray %u: triangle %u, told otherwise %u", i, one, other);
        gn_case_check(run, (a->front != b->front) == told.facing_turns, "ray %u: front %u, told otherwise %u", i,
                      a->front, b->front);
    }
    gn_case_judge(run, &told.scene, GN_CTS_COMMITTED, moved_rays, count, 0, &after);
}

#define CASE(label, ...)                                                                                     \
    {                                                                                                        \
        "relations." label, SPEC, relation, &(const struct params){.change = __VA_ARGS__}, 0                 \
    }
static const struct gn_case cases[] = {
    CASE("again", NONE),
    CASE("translated.1", TRANSLATE, .amount = 1),
    CASE("translated.32", TRANSLATE, .amount = 32),
    CASE("translated.minus_256", TRANSLATE, .amount = -256),
    CASE("scaled.2", SCALE, .amount = 2),
    CASE("scaled.1024", SCALE, .amount = 1024),
    CASE("scaled.2_minus_10", SCALE, .amount = 0x1p-10),
    CASE("scaled.2_minus_20", SCALE, .amount = 0x1p-20),
    CASE("axes_renamed", RENAME_AXES),
    CASE("mirrored", MIRROR),
    CASE("order.reversed", REVERSE),
    CASE("order.shuffled", SHUFFLE),
    CASE("corners.turned", TURN_CORNERS),
    CASE("corners.reversed", REVERSE_WINDING),
    CASE("geometries.2", SPLIT_GEOMETRIES, .parts = 2),
    CASE("geometries.7", SPLIT_GEOMETRIES, .parts = 7),
    CASE("geometries.64", SPLIT_GEOMETRIES, .parts = 64),
    CASE("instances.2", SPLIT_INSTANCES, .parts = 2),
    CASE("instances.7", SPLIT_INSTANCES, .parts = 7),
    CASE("instances.64", SPLIT_INSTANCES, .parts = 64),
    CASE("instances.reversed", REVERSE_INSTANCES, .parts = 31),
    CASE("instances.null_between", NULL_INSTANCES, .parts = 31),
    CASE("instances.masked_copies", REPEAT_INSTANCES, .parts = 9),
    CASE("transform.instance", INSTANCE_TRANSFORM),
    CASE("transform.geometry", GEOMETRY_TRANSFORM),
    CASE("transform.mirrored_instance", MIRROR_INSTANCE),
    CASE("transform.mirrored_geometry", MIRROR_GEOMETRY),
};
const struct gn_case_family gn_family_relations = {"relations", cases, sizeof cases / sizeof cases[0]};
