/* SPDX-License-Identifier: Apache-2.0 */
/* What identifies a hit: primitive, geometry, instance, custom index, SBT offset. All are copied, none rounded. */
#include <math.h>
#include <string.h>

#include "cts/compose.h"
#include "cts/mesh_case.h"

#define OPAQUE VK_GEOMETRY_OPAQUE_BIT_KHR
#define ALL_24 0xFFFFFFu

static const struct gn_mesh_case primitive_1 = {
    .mesh = {.kind = GN_MESH_SOUP, .n = 1, .size = 2}, .geometry_flags = OPAQUE, .interior = 2000, .both_sides = true};
static const struct gn_mesh_case primitive_255 = {.mesh = {.kind = GN_MESH_SOUP, .n = 255, .size = 0.3},
    .geometry_flags = OPAQUE, .interior = 10000, .both_sides = true};
static const struct gn_mesh_case primitive_257 = {
    .mesh = {.kind = GN_MESH_SOUP, .n = 257, .size = 0.3}, .interior = 10000, .both_sides = true};
static const struct gn_mesh_case primitive_72200 = {.mesh = {.kind = GN_MESH_HEIGHT_FIELD, .n = 190, .size = 0.1},
    .unshared = true, .geometry_flags = OPAQUE, .interior = 30000, .both_sides = true};
static const struct gn_mesh_case primitive_131072 = {.mesh = {.kind = GN_MESH_HEIGHT_FIELD, .n = 256, .size = 0.02},
    .geometry_flags = OPAQUE, .interior = 40000, .both_sides = true};
static const struct gn_mesh_case primitive_inactive = {.mesh = {.kind = GN_MESH_SOUP, .n = 2000, .size = 0.2},
    .inactive = 0.5, .geometry_flags = OPAQUE, .interior = 12000, .both_sides = true};
static const struct gn_mesh_case primitive_last = {.mesh = {.kind = GN_MESH_SOUP, .n = 500, .size = 0.5}, .inactive = 1,
    .geometry_flags = OPAQUE, .interior = 2000, .both_sides = true};

struct geometries {
    uint32_t count;
    uint32_t empty_every; /* every so manieth has no primitives; 0: none */
    bool opaque;
    uint32_t rays;
};

/* A place on a grid for the i-th of `count`, 3 apart. */
static void grid_place(uint32_t i, uint32_t count, double out[3])
{
    uint32_t side = (uint32_t)ceil(sqrt(count));
    out[0] = 3 * ((double)(i % side) - side / 2.0);
    out[1] = 3 * ((double)(i / side) - side / 2.0);
    out[2] = 0.25 * (i % 5);
}

/* Geometries of 1 to 5 triangles each, at places of their own. */
static void geometries(struct gn_case_run *run, const struct gn_case *self)
{
    const struct geometries *what = self->params;
    struct gn_cts_geometry *list = GN_NEW(&run->arena, struct gn_cts_geometry, what->count);
    struct gn_mesh *meshes = GN_NEW(&run->arena, struct gn_mesh, what->count);
    for (uint32_t i = 0; i < what->count; i++) {
        double place[3];
        grid_place(i, what->count, place);
        struct gn_mesh soup = gn_mesh_soup(&run->arena, &run->random, 1 + i % 5, 1);
        meshes[i] = gn_mesh_scaled(&run->arena, &soup, 1, 1, 1, place[0], place[1], place[2]);
        list[i] = gn_geometry_of_mesh(&meshes[i]);
        list[i].flags = what->opaque ? OPAQUE : 0;
        if (what->empty_every && i % what->empty_every == what->empty_every - 1)
            list[i].triangle_count = 0;
    }
    struct gn_cts_instance instance = gn_instance_of(0, NULL);
    struct gn_cts_scene scene = gn_scene_of_geometries(&run->arena, list, what->count, &instance, 1);
    uint32_t count = gn_ray_count(run, what->rays);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    for (uint32_t r = 0; r < count; r++) {
        uint32_t i = gn_random_below(&run->random, what->count);
        gn_rays_aimed(&run->random, &meshes[i], NULL, NULL, GN_AIM_INTERIOR, 4, true, &rays[r], 1);
    }
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

static const struct geometries geometry_2 = {.count = 2, .opaque = true, .rays = 4000};
static const struct geometries geometry_16 = {.count = 16, .rays = 8000};
static const struct geometries geometry_300 = {.count = 300, .opaque = true, .rays = 16000};
static const struct geometries geometry_empty = {.count = 64, .empty_every = 3, .opaque = true, .rays = 12000};

enum values { ZERO, ORDINAL, EDGES, BITS, ALL_BUT_BITS, RANDOM_BITS };

static uint32_t value_of(struct gn_random *random, enum values values, uint32_t i)
{
    static const uint32_t edges[] = {0, 1, 0x7F, 0x80, 0xFF, 0x100, 0x7FFF, 0x8000, 0xFFFF, 0x10000,
                                     0x7FFFFF, 0x800000, 0xFFFFFE, ALL_24};
    switch (values) {
    case ZERO:
        break;
    case ORDINAL:
        return i;
    case EDGES:
        return edges[i % (sizeof edges / sizeof edges[0])];
    case BITS:
        return 1u << i % 24;
    case ALL_BUT_BITS:
        return ALL_24 & ~(1u << i % 24);
    case RANDOM_BITS:
        return (uint32_t)gn_random_u64(random) & ALL_24;
    }
    return 0;
}

struct instances {
    uint32_t count;
    enum values custom_index, sbt_offset;
    uint32_t null_every; /* every so manieth has a null reference; 0: none */
    bool other_bits; /* masks and flags vary too: they share words with the ids */
    uint32_t rays;
};

/* Instances of three small meshes in turn, at places of their own. */
static void instances(struct gn_case_run *run, const struct gn_case *self)
{
    const struct instances *what = self->params;
    struct gn_mesh meshes[3] = {gn_mesh_triangle(&run->arena), gn_mesh_octahedron(&run->arena, 1),
                                gn_mesh_quad(&run->arena)};
    struct gn_cts_geometry shapes[3];
    struct gn_cts_blas blases[3] = {0};
    for (int i = 0; i < 3; i++) {
        shapes[i] = gn_geometry_of_mesh(&meshes[i]);
        shapes[i].flags = OPAQUE;
        blases[i].geometries = &shapes[i];
        blases[i].geometry_count = 1;
    }
    struct gn_cts_instance *list = GN_NEW(&run->arena, struct gn_cts_instance, what->count);
    for (uint32_t i = 0; i < what->count; i++) {
        double place[3];
        grid_place(i, what->count, place);
        list[i] = gn_instance_of(i % 3, NULL);
        for (int c = 0; c < 3; c++)
            list[i].transform[4 * c + 3] = (float)place[c];
        list[i].custom_index = value_of(&run->random, what->custom_index, i);
        list[i].sbt_offset = value_of(&run->random, what->sbt_offset, i);
        if (what->other_bits) {
            /* The ray's mask is 0xFF: any bit will do. */
            list[i].mask = 1u << i % 8;
            list[i].flags = i / 8 % 2 ? VK_GEOMETRY_INSTANCE_TRIANGLE_FACING_CULL_DISABLE_BIT_KHR : 0;
            list[i].flags |= i / 16 % 2 ? VK_GEOMETRY_INSTANCE_TRIANGLE_FLIP_FACING_BIT_KHR : 0;
            list[i].flags |= i / 32 % 3 == 1   ? VK_GEOMETRY_INSTANCE_FORCE_OPAQUE_BIT_KHR
                             : i / 32 % 3 == 2 ? VK_GEOMETRY_INSTANCE_FORCE_NO_OPAQUE_BIT_KHR
                                               : 0;
        }
        if (what->null_every && i % what->null_every == what->null_every - 1)
            list[i].blas = GN_CTS_NO_BLAS;
    }
    struct gn_cts_scene scene = {0};
    scene.blases = blases;
    scene.blas_count = 3;
    scene.instances = list;
    scene.instance_count = what->count;
    uint32_t count = gn_ray_count(run, what->rays);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    for (uint32_t r = 0; r < count; r++) {
        /* The last ones in any case: what is cut off shows there. */
        uint32_t i = r % 16 == 0 ? what->count - 1 : gn_random_below(&run->random, what->count);
        gn_rays_aimed(&run->random, &meshes[i % 3], NULL, list[i].transform, GN_AIM_INTERIOR, 3, true, &rays[r], 1);
    }
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

static const struct instances instance_1 = {.count = 1, .rays = 2000};
static const struct instances instance_16 = {.count = 16, .rays = 6000};
static const struct instances instance_257 = {.count = 257, .rays = 10000};
static const struct instances instance_4096 = {.count = 4096, .custom_index = ORDINAL, .rays = 16000};
static const struct instances instance_66000 = {.count = 66000, .custom_index = ORDINAL, .sbt_offset = ORDINAL,
    .rays = 24000};
static const struct instances instance_null = {.count = 300, .custom_index = ORDINAL, .null_every = 3, .rays = 12000};
static const struct instances custom_edges = {.count = 28, .custom_index = EDGES, .rays = 6000};
static const struct instances custom_bits = {.count = 24, .custom_index = BITS, .rays = 6000};
static const struct instances custom_but_bits = {.count = 24, .custom_index = ALL_BUT_BITS, .rays = 6000};
static const struct instances custom_random = {.count = 500, .custom_index = RANDOM_BITS, .rays = 10000};
static const struct instances sbt_edges = {.count = 28, .sbt_offset = EDGES, .rays = 6000};
static const struct instances sbt_bits = {.count = 24, .sbt_offset = BITS, .rays = 6000};
static const struct instances sbt_but_bits = {.count = 24, .sbt_offset = ALL_BUT_BITS, .rays = 6000};
static const struct instances sbt_random = {.count = 500, .sbt_offset = RANDOM_BITS, .rays = 10000};
static const struct instances all_words = {.count = 192, .custom_index = EDGES, .sbt_offset = ALL_BUT_BITS,
    .other_bits = true, .rays = 10000};
static const struct instances all_random = {.count = 960, .custom_index = RANDOM_BITS, .sbt_offset = RANDOM_BITS,
    .other_bits = true, .null_every = 7, .rays = 16000};

/* Everything at once: several structures of several geometries, instanced several times, in one scene. */
static void everything(struct gn_case_run *run, const struct gn_case *self)
{
    (void)self;
    enum { BLASES = 4, GEOMETRIES = 5, INSTANCES = 40 };
    struct gn_mesh meshes[BLASES][GEOMETRIES];
    struct gn_cts_geometry shapes[BLASES][GEOMETRIES];
    struct gn_cts_blas blases[BLASES] = {0};
    for (uint32_t b = 0; b < BLASES; b++) {
        for (uint32_t g = 0; g < GEOMETRIES; g++) {
            meshes[b][g] = gn_mesh_soup(&run->arena, &run->random, 1 + 7 * b + 3 * g, 0.7);
            shapes[b][g] = gn_geometry_of_mesh(&meshes[b][g]);
            shapes[b][g].flags = (b + g) % 3 ? OPAQUE : 0;
        }
        blases[b].geometries = shapes[b];
        blases[b].geometry_count = 1 + b + b / 3;
    }
    struct gn_cts_instance list[INSTANCES];
    uint32_t count = gn_ray_count(run, 20000);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    for (uint32_t i = 0; i < INSTANCES; i++) {
        float transform[12];
        gn_transform_random(&run->random, 0.5, 1, 4, i & 1, transform);
        list[i] = gn_instance_of(gn_random_below(&run->random, BLASES), transform);
        list[i].custom_index = (uint32_t)gn_random_u64(&run->random) & ALL_24;
        list[i].sbt_offset = (uint32_t)gn_random_u64(&run->random) & ALL_24;
    }
    for (uint32_t r = 0; r < count; r++) {
        const struct gn_cts_instance *at = &list[gn_random_below(&run->random, INSTANCES)];
        uint32_t g = gn_random_below(&run->random, blases[at->blas].geometry_count);
        gn_rays_aimed(&run->random, &meshes[at->blas][g], NULL, at->transform, GN_AIM_INTERIOR, 4, true, &rays[r], 1);
    }
    struct gn_cts_scene scene = {0};
    scene.blases = blases;
    scene.blas_count = BLASES;
    scene.instances = list;
    scene.instance_count = INSTANCES;
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

#define PRIMITIVE "the primitive index is the triangle's ordinal in its geometry (ray traversal; built-in PrimitiveId)"
#define INACTIVE "inactive primitives keep their place in the primitive index (acceleration structures: inactive primitives)"
#define GEOMETRY "the geometry index is the geometry's ordinal in its structure (ray traversal; RayGeometryIndex)"
#define INSTANCE "the instance id is the instance's ordinal in the top level (ray traversal; built-in InstanceId)"
#define CUSTOM "all 24 bits of the custom index come back (VkAccelerationStructureInstanceKHR; InstanceCustomIndex)"
#define SBT "all 24 bits of the record offset come back (VkAccelerationStructureInstanceKHR; ray query: record offset)"

static const struct gn_case cases[] = {
    {"ids.primitive.1", PRIMITIVE, gn_mesh_case_run, &primitive_1, 0},
    {"ids.primitive.255", PRIMITIVE, gn_mesh_case_run, &primitive_255, 0},
    {"ids.primitive.257", PRIMITIVE, gn_mesh_case_run, &primitive_257, 0},
    {"ids.primitive.72200", PRIMITIVE, gn_mesh_case_run, &primitive_72200, 0},
    {"ids.primitive.131072", PRIMITIVE, gn_mesh_case_run, &primitive_131072, 0},
    {"ids.primitive.half_inactive", INACTIVE, gn_mesh_case_run, &primitive_inactive, 0},
    {"ids.primitive.one_active", INACTIVE, gn_mesh_case_run, &primitive_last, 0},
    {"ids.geometry.2", GEOMETRY, geometries, &geometry_2, 0},
    {"ids.geometry.16", GEOMETRY, geometries, &geometry_16, 0},
    {"ids.geometry.300", GEOMETRY, geometries, &geometry_300, 0},
    {"ids.geometry.some_empty", GEOMETRY, geometries, &geometry_empty, 0},
    {"ids.instance.1", INSTANCE, instances, &instance_1, 0},
    {"ids.instance.16", INSTANCE, instances, &instance_16, 0},
    {"ids.instance.257", INSTANCE, instances, &instance_257, 0},
    {"ids.instance.4096", INSTANCE, instances, &instance_4096, 0},
    {"ids.instance.66000", INSTANCE, instances, &instance_66000, 0},
    {"ids.instance.some_null", "an inactive instance keeps its place in the instance id (acceleration structures)",
     instances, &instance_null, 0},
    {"ids.custom_index.edges", CUSTOM, instances, &custom_edges, 0},
    {"ids.custom_index.single_bits", CUSTOM, instances, &custom_bits, 0},
    {"ids.custom_index.all_but_one_bit", CUSTOM, instances, &custom_but_bits, 0},
    {"ids.custom_index.random", CUSTOM, instances, &custom_random, 0},
    {"ids.sbt_offset.edges", SBT, instances, &sbt_edges, 0},
    {"ids.sbt_offset.single_bits", SBT, instances, &sbt_bits, 0},
    {"ids.sbt_offset.all_but_one_bit", SBT, instances, &sbt_but_bits, 0},
    {"ids.sbt_offset.random", SBT, instances, &sbt_random, 0},
    {"ids.all.neighbouring_bits", "the instance's bit fields do not bleed into each other (VkAccelerationStructureInstanceKHR)",
     instances, &all_words, 0},
    {"ids.all.random", "the instance's bit fields do not bleed into each other (VkAccelerationStructureInstanceKHR)",
     instances, &all_random, 0},
    {"ids.all.everything", "all ids of a hit belong to one another (ray traversal; ray query getters)", everything, NULL, 0},
};
const struct gn_case_family gn_family_ids = {"ids", cases, sizeof cases / sizeof cases[0]};
