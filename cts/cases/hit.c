/* SPDX-License-Identifier: Apache-2.0 */
/* Hit or miss, and the nearest of several: meshes of many kinds, one or more instances, rays from every side. */
#include <math.h>
#include <string.h>

#include "cts/compose.h"
#include "cts/mesh_case.h"

#define OPAQUE VK_GEOMETRY_OPAQUE_BIT_KHR

static const struct gn_mesh_case one_triangle = {
    .mesh = {.kind = GN_MESH_TRIANGLE}, .geometry_flags = OPAQUE, .interior = 6000, .random = 2000, .both_sides = true};
static const struct gn_mesh_case quad = {
    .mesh = {.kind = GN_MESH_QUAD}, .geometry_flags = OPAQUE, .interior = 6000, .random = 2000, .both_sides = true};
static const struct gn_mesh_case height_field_8 = {.mesh = {.kind = GN_MESH_HEIGHT_FIELD, .n = 2, .size = 0.2},
    .geometry_flags = OPAQUE, .interior = 10000, .random = 4000, .both_sides = true};
static const struct gn_mesh_case height_field_2048 = {.mesh = {.kind = GN_MESH_HEIGHT_FIELD, .n = 32, .size = 0.1},
    .geometry_flags = OPAQUE, .interior = 20000, .random = 6000, .both_sides = true};
static const struct gn_mesh_case height_field_32768 = {.mesh = {.kind = GN_MESH_HEIGHT_FIELD, .n = 128, .size = 0.05},
    .geometry_flags = OPAQUE, .interior = 40000, .random = 10000, .both_sides = true};
static const struct gn_mesh_case mountains = {.mesh = {.kind = GN_MESH_HEIGHT_FIELD, .n = 16, .size = 1},
    .geometry_flags = OPAQUE, .interior = 16000, .random = 4000, .both_sides = true};
static const struct gn_mesh_case blob = {.mesh = {.kind = GN_MESH_BLOB, .n = 20, .m = 30, .size = 0.2},
    .geometry_flags = OPAQUE, .interior = 16000, .random = 8000};
static const struct gn_mesh_case spiky_blob = {.mesh = {.kind = GN_MESH_BLOB, .n = 20, .m = 30, .size = 0.7},
    .geometry_flags = OPAQUE, .interior = 16000, .random = 8000, .both_sides = true};
static const struct gn_mesh_case torus = {.mesh = {.kind = GN_MESH_TORUS, .n = 40, .m = 20, .size = 0.4},
    .geometry_flags = OPAQUE, .interior = 12000, .random = 8000};
static const struct gn_mesh_case box = {.mesh = {.kind = GN_MESH_BOX, .n = 1},
    .geometry_flags = OPAQUE, .interior = 8000, .random = 4000};
static const struct gn_mesh_case octahedron = {.mesh = {.kind = GN_MESH_OCTAHEDRON, .n = 8},
    .geometry_flags = OPAQUE, .interior = 8000, .random = 4000};
static const struct gn_mesh_case soup_16 = {.mesh = {.kind = GN_MESH_SOUP, .n = 16, .size = 0.5},
    .geometry_flags = OPAQUE, .interior = 8000, .random = 4000, .both_sides = true};
static const struct gn_mesh_case soup_4096 = {.mesh = {.kind = GN_MESH_SOUP, .n = 4096, .size = 0.2},
    .geometry_flags = OPAQUE, .interior = 12000, .random = 8000, .both_sides = true};
static const struct gn_mesh_case soup_big = {.mesh = {.kind = GN_MESH_SOUP, .n = 200, .size = 3},
    .geometry_flags = OPAQUE, .interior = 10000, .random = 6000, .both_sides = true};
static const struct gn_mesh_case inactive = {.mesh = {.kind = GN_MESH_SOUP, .n = 1000, .size = 0.3}, .inactive = 0.5,
    .geometry_flags = OPAQUE, .interior = 8000, .random = 4000, .both_sides = true};
static const struct gn_mesh_case confirmed = {.mesh = {.kind = GN_MESH_SOUP, .n = 1000, .size = 0.4},
    .interior = 10000, .random = 4000, .both_sides = true};

/* How the same mesh is built must not change what rays hit. */
#define BUILD(bits)                                                                                                  \
    {.mesh = {.kind = GN_MESH_BLOB, .n = 16, .m = 16, .size = 0.3}, .geometry_flags = OPAQUE, .build_flags = (bits), \
     .interior = 6000, .random = 2000}
static const struct gn_mesh_case fast_trace = BUILD(VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR);
static const struct gn_mesh_case fast_build = BUILD(VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_BUILD_BIT_KHR);
static const struct gn_mesh_case low_memory = BUILD(VK_BUILD_ACCELERATION_STRUCTURE_LOW_MEMORY_BIT_KHR);
static const struct gn_mesh_case allow_all =
    BUILD(VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR | VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR);

/* Rays that start inside a closed mesh, in any direction: every one of them hits. */
static void inside(struct gn_case_run *run, const struct gn_case *self)
{
    const struct gn_mesh_spec *spec = self->params;
    struct gn_mesh mesh = gn_mesh_of(&run->arena, &run->random, spec);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = OPAQUE;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    uint32_t count = gn_ray_count(run, (uint32_t)self->value);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    for (uint32_t i = 0; i < count; i++) {
        double origin[3], direction[3];
        for (int c = 0; c < 3; c++) {
            origin[c] = gn_random_range(&run->random, -0.2, 0.2);
            direction[c] = gn_random_range(&run->random, -1, 1);
        }
        direction[i % 3] += direction[i % 3] < 0 ? -0.1 : 0.1;
        rays[i] = gn_ray_make(origin, direction, 1000);
    }
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

static const struct gn_mesh_spec inside_blob = {.kind = GN_MESH_BLOB, .n = 12, .m = 16, .size = 0.3};
static const struct gn_mesh_spec inside_box = {.kind = GN_MESH_BOX, .n = 2};

/* Rays that cannot hit: they start outside and go away, pass by, or start beyond what they are aimed at. */
static void miss(struct gn_case_run *run, const struct gn_case *self)
{
    struct gn_mesh mesh = gn_mesh_blob(&run->arena, &run->random, 12, 16, 0.3);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = OPAQUE;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    uint32_t count = gn_ray_count(run, 4000);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_rays_aimed(&run->random, &mesh, NULL, NULL, GN_AIM_INTERIOR, 4, false, rays, count);
    for (uint32_t i = 0; i < count; i++) {
        struct gn_ref_ray *ray = &rays[i].ray;
        for (int c = 0; c < 3; c++) {
            if (self->value == 0)
                ray->direction[c] = -ray->direction[c];
            else if (self->value == 1)
                ray->origin[c] += 3 * ray->direction[c];
        }
        if (self->value == 2) {
            /* Sideways: along the axis that the direction has least of. */
            int axis = fabsf(ray->direction[1]) < fabsf(ray->direction[0]);
            axis = fabsf(ray->direction[2]) < fabsf(ray->direction[axis]) ? 2 : axis;
            ray->origin[axis] += ray->origin[axis] < 0 ? -20.0f : 20.0f;
        }
    }
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* Scenes in which there is nothing to hit, though something is there to be aimed at. */
enum nothing { NO_INSTANCES, NULL_INSTANCES, NO_GEOMETRIES, NO_TRIANGLES, ALL_INACTIVE, ALL_DEGENERATE };

static void nothing_there(struct gn_case_run *run, const struct gn_case *self)
{
    struct gn_mesh mesh = gn_mesh_soup(&run->arena, &run->random, 16, 1);
    uint32_t count = gn_ray_count(run, 500);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_rays_aimed(&run->random, &mesh, NULL, NULL, GN_AIM_INTERIOR, 4, true, rays, count);
    if (self->value == ALL_INACTIVE)
        for (uint32_t v = 0; v < mesh.position_count; v++)
            mesh.positions[v][0] = mesh.positions[v][1] = mesh.positions[v][2] = NAN;
    if (self->value == ALL_DEGENERATE)
        for (uint32_t t = 0; t < mesh.triangle_count; t++)
            mesh.triangles[t][t % 3] = mesh.triangles[t][(t + 1) % 3];
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = OPAQUE;
    if (self->value == NO_TRIANGLES)
        geometry.triangle_count = 0;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    struct gn_cts_blas blas = scene.blases[0];
    if (self->value == NO_GEOMETRIES)
        blas.geometry_count = 0;
    scene.blases = &blas;
    struct gn_cts_instance instances[3];
    for (int i = 0; i < 3; i++)
        instances[i] = gn_instance_of(GN_CTS_NO_BLAS, NULL);
    if (self->value == NULL_INSTANCES) {
        scene.instances = instances;
        scene.instance_count = 3;
    }
    if (self->value == NO_INSTANCES)
        scene.instance_count = 0;
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* Every second triangle inactive through one of its corners alone: `value` says which. */
static void inactive_corner(struct gn_case_run *run, const struct gn_case *self)
{
    struct gn_mesh mesh = gn_mesh_soup(&run->arena, &run->random, 600, 0.4);
    for (uint32_t t = 0; t < mesh.triangle_count; t += 2)
        for (int c = 0; c < 3; c++)
            mesh.positions[mesh.triangles[t][self->value]][c] = NAN;
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = OPAQUE;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    uint32_t count = gn_ray_count(run, 6000);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_rays_aimed(&run->random, &mesh, NULL, NULL, GN_AIM_INTERIOR, 4, true, rays, count);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* Degenerate triangles (a repeated corner, three corners on a line) among good ones: never hit, never in the way. */
static void degenerate(struct gn_case_run *run, const struct gn_case *self)
{
    (void)self;
    struct gn_mesh mesh = gn_mesh_soup(&run->arena, &run->random, 600, 0.5);
    for (uint32_t t = 0; t < mesh.triangle_count; t += 2) {
        uint32_t *corner = mesh.triangles[t];
        if (t % 4 == 0) {
            corner[2] = corner[t % 8 == 0];
        } else {
            /* On a grid of 2^-12, so that the middle is exact. */
            for (int c = 0; c < 3; c++) {
                double a = round(4096 * mesh.positions[corner[0]][c]) / 4096;
                double b = round(4096 * mesh.positions[corner[1]][c]) / 4096;
                mesh.positions[corner[0]][c] = a;
                mesh.positions[corner[1]][c] = b;
                mesh.positions[corner[2]][c] = (a + b) / 2;
            }
        }
    }
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = OPAQUE;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    uint32_t count = gn_ray_count(run, 8000);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_rays_aimed(&run->random, &mesh, NULL, NULL, GN_AIM_INTERIOR, 4, true, rays, count);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* Many sheets one behind another: the nearest is the hit, however the structure is traversed. `value` is how
 * many; they are 2^-10 apart. */
static void layers(struct gn_case_run *run, const struct gn_case *self)
{
    struct gn_mesh sheet = gn_mesh_height_field(&run->arena, &run->random, 4, 0), mesh = sheet;
    for (uint32_t i = 1; i < self->value; i++) {
        /* Not in the order of their height. */
        double height = 0x1p-10 * (double)(i * 7 % self->value);
        struct gn_mesh next = gn_mesh_scaled(&run->arena, &sheet, 1, 1, 1, 0, 0, height);
        mesh = gn_mesh_joined(&run->arena, &mesh, &next);
    }
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = OPAQUE;
    struct gn_cts_scene scene = gn_scene_of_geometry(&run->arena, &geometry);
    uint32_t count = gn_ray_count(run, 10000);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_rays_aimed(&run->random, &mesh, NULL, NULL, GN_AIM_INTERIOR, 2, true, rays, count);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

/* The same mesh twice, in one structure or as two instances: either copy is right, at the same t. */
static void coincident(struct gn_case_run *run, const struct gn_case *self)
{
    struct gn_mesh mesh = gn_mesh_height_field(&run->arena, &run->random, 12, 0.1);
    uint32_t count = gn_ray_count(run, 8000);
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, count);
    gn_rays_aimed(&run->random, &mesh, NULL, NULL, GN_AIM_INTERIOR, 4, true, rays, count);
    if (self->value == 0)
        mesh = gn_mesh_joined(&run->arena, &mesh, &mesh);
    struct gn_cts_geometry geometry = gn_geometry_of_mesh(&mesh);
    geometry.flags = OPAQUE;
    struct gn_cts_instance instances[2] = {gn_instance_of(0, NULL), gn_instance_of(0, NULL)};
    struct gn_cts_scene scene =
        gn_scene_of_geometries(&run->arena, &geometry, 1, instances, self->value == 1 ? 2 : 1);
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, count, 0);
}

struct instances {
    struct gn_mesh_spec meshes[3]; /* instances take them in turn; ended by one with n = 0 */
    uint32_t count;
    double min_scale, max_scale, spread;
    bool nested; /* one inside the other, around the origin */
    uint32_t interior, random; /* rays in all */
};

static void instances(struct gn_case_run *run, const struct gn_case *self)
{
    const struct instances *what = self->params;
    struct gn_mesh meshes[3];
    struct gn_cts_geometry geometries[3];
    struct gn_cts_blas blases[3] = {0};
    uint32_t blas_count = 0;
    for (; blas_count < 3 && what->meshes[blas_count].n; blas_count++) {
        meshes[blas_count] = gn_mesh_of(&run->arena, &run->random, &what->meshes[blas_count]);
        geometries[blas_count] = gn_geometry_of_mesh(&meshes[blas_count]);
        geometries[blas_count].flags = OPAQUE;
        blases[blas_count].geometries = &geometries[blas_count];
        blases[blas_count].geometry_count = 1;
    }
    struct gn_cts_instance *list = GN_NEW(&run->arena, struct gn_cts_instance, what->count);
    uint32_t interior = gn_ray_count(run, what->interior), random = what->random ? gn_ray_count(run, what->random) : 0;
    struct gn_cts_ray *rays = GN_NEW(&run->arena, struct gn_cts_ray, interior + random);
    for (uint32_t i = 0; i < what->count; i++) {
        float transform[12];
        if (what->nested) {
            double scale = (i + 1.0) / what->count;
            gn_transform_random(&run->random, scale, scale, 0, false, transform);
        } else {
            gn_transform_random(&run->random, what->min_scale, what->max_scale, what->spread, false, transform);
        }
        list[i] = gn_instance_of(i % blas_count, transform);
    }
    for (uint32_t r = 0; r < interior + random; r++) {
        uint32_t i = r % what->count;
        gn_rays_aimed(&run->random, &meshes[list[i].blas], NULL, list[i].transform,
                      r < interior ? GN_AIM_INTERIOR : GN_AIM_RANDOM, what->nested ? 0.25 : 4, what->nested, &rays[r], 1);
    }
    struct gn_cts_scene scene = {0};
    scene.blases = blases;
    scene.blas_count = blas_count;
    scene.instances = list;
    scene.instance_count = what->count;
    gn_case_trace(run, &scene, GN_CTS_COMMITTED, rays, interior + random, 0);
}

static const struct instances instances_8 = {.meshes = {{GN_MESH_BLOB, 8, 8, 0.2}}, .count = 8, .min_scale = 0.5,
    .max_scale = 1, .spread = 4, .interior = 16000, .random = 4000};
static const struct instances instances_1000 = {.meshes = {{GN_MESH_OCTAHEDRON, 4, 0, 0}}, .count = 1000,
    .min_scale = 0.5, .max_scale = 1, .spread = 12, .interior = 16000, .random = 4000};
static const struct instances overlapping = {
    .meshes = {{GN_MESH_BLOB, 8, 8, 0.2}, {GN_MESH_TORUS, 16, 10, 0.4}, {GN_MESH_SOUP, 100, 0, 0.5}}, .count = 30,
    .min_scale = 0.5, .max_scale = 2, .spread = 0.5, .interior = 16000, .random = 4000};
static const struct instances nested = {.meshes = {{GN_MESH_BLOB, 10, 12, 0.01}}, .count = 40, .nested = true,
    .interior = 16000};
static const struct instances different = {
    .meshes = {{GN_MESH_BLOB, 8, 8, 0.2}, {GN_MESH_HEIGHT_FIELD, 8, 0, 0.3}, {GN_MESH_BOX, 2, 0, 0}}, .count = 48,
    .min_scale = 0.3, .max_scale = 1, .spread = 6, .interior = 16000, .random = 4000};

#define CLOSEST "the committed hit is the nearest one in the ray's range (ray traversal: ray closest hit determination)"

#define INACTIVE "a triangle is invisible when the x of any of its vertices is NaN (acceleration structures: inactive primitives)"

static const struct gn_case cases[] = {
    {"hit.one_triangle", "a ray meets one triangle from either side or misses it (ray traversal: ray-triangle intersection)",
     gn_mesh_case_run, &one_triangle, 0},
    {"hit.quad", "two triangles make a quad that is hit from either side (ray traversal)", gn_mesh_case_run, &quad, 0},
    {"hit.height_field.8", CLOSEST, gn_mesh_case_run, &height_field_8, 0},
    {"hit.height_field.2048", CLOSEST, gn_mesh_case_run, &height_field_2048, 0},
    {"hit.height_field.32768", CLOSEST, gn_mesh_case_run, &height_field_32768, 0},
    {"hit.height_field.steep", CLOSEST, gn_mesh_case_run, &mountains, 0},
    {"hit.closed.blob", CLOSEST, gn_mesh_case_run, &blob, 0},
    {"hit.closed.spiky", CLOSEST, gn_mesh_case_run, &spiky_blob, 0},
    {"hit.closed.torus", CLOSEST, gn_mesh_case_run, &torus, 0},
    {"hit.closed.box", CLOSEST, gn_mesh_case_run, &box, 0},
    {"hit.closed.octahedron", CLOSEST, gn_mesh_case_run, &octahedron, 0},
    {"hit.soup.16", CLOSEST, gn_mesh_case_run, &soup_16, 0},
    {"hit.soup.4096", CLOSEST, gn_mesh_case_run, &soup_4096, 0},
    {"hit.soup.big", CLOSEST, gn_mesh_case_run, &soup_big, 0},
    {"hit.soup.confirmed", "candidates that the shader confirms compete for the nearest (ray query: candidates)",
     gn_mesh_case_run, &confirmed, 0},
    {"hit.inactive_triangles.any_corners", INACTIVE, gn_mesh_case_run, &inactive, 0},
    {"hit.inactive_triangles.corner_0", INACTIVE, inactive_corner, NULL, 0},
    {"hit.inactive_triangles.corner_1", INACTIVE, inactive_corner, NULL, 1},
    {"hit.inactive_triangles.corner_2", INACTIVE, inactive_corner, NULL, 2},
    {"hit.degenerate_triangles", "degenerate triangles give no intersections (acceleration structures)", degenerate, NULL, 0},
    {"hit.inside.blob", "a ray that starts inside a closed mesh cannot leave it unseen (ray traversal)", inside, &inside_blob,
     16000},
    {"hit.inside.box", "a ray that starts inside a closed mesh cannot leave it unseen (ray traversal)", inside, &inside_box,
     10000},
    {"hit.miss.away", "nothing behind the origin is hit: t is above tmin (ray traversal)", miss, NULL, 0},
    {"hit.miss.beyond", "nothing behind the origin is hit: t is above tmin (ray traversal)", miss, NULL, 1},
    {"hit.miss.beside", "a ray that passes by misses (ray traversal)", miss, NULL, 2},
    {"hit.nothing.no_instances", "a structure of no instances is valid and never hit (acceleration structures: build)",
     nothing_there, NULL, NO_INSTANCES},
    {"hit.nothing.null_instances", "an instance with a null reference is inactive (acceleration structures)", nothing_there,
     NULL, NULL_INSTANCES},
    {"hit.nothing.no_geometries", "a structure of no geometries is valid and never hit (acceleration structures: build)",
     nothing_there, NULL, NO_GEOMETRIES},
    {"hit.nothing.no_triangles", "a geometry of no primitives is valid and never hit (acceleration structures: build)",
     nothing_there, NULL, NO_TRIANGLES},
    {"hit.nothing.all_inactive", "inactive primitives are never hit (acceleration structures)", nothing_there, NULL,
     ALL_INACTIVE},
    {"hit.nothing.all_degenerate", "degenerate triangles give no intersections (acceleration structures)", nothing_there,
     NULL, ALL_DEGENERATE},
    {"hit.layers.8", CLOSEST, layers, NULL, 8},
    {"hit.layers.100", CLOSEST, layers, NULL, 100},
    {"hit.coincident.triangles", "of two equal hits either may be committed, never none (ray traversal)", coincident, NULL, 0},
    {"hit.coincident.instances", "of two equal hits either may be committed, never none (ray traversal)", coincident, NULL, 1},
    {"hit.build.prefer_fast_trace", "a build flag asks for speed or size and never changes hits (acceleration structures)",
     gn_mesh_case_run, &fast_trace, 0},
    {"hit.build.prefer_fast_build", "a build flag asks for speed or size and never changes hits (acceleration structures)",
     gn_mesh_case_run, &fast_build, 0},
    {"hit.build.low_memory", "a build flag asks for speed or size and never changes hits (acceleration structures)",
     gn_mesh_case_run, &low_memory, 0},
    {"hit.build.allow_update_and_compaction", "what a structure allows later never changes hits (acceleration structures)",
     gn_mesh_case_run, &allow_all, 0},
    {"hit.instances.8", CLOSEST, instances, &instances_8, 0},
    {"hit.instances.1000", CLOSEST, instances, &instances_1000, 0},
    {"hit.instances.overlapping", "the nearest hit counts over all instances (ray traversal)", instances, &overlapping, 0},
    {"hit.instances.nested", "the nearest hit counts over all instances (ray traversal)", instances, &nested, 0},
    {"hit.instances.different", "each instance has the geometry of its own reference (acceleration structures)", instances,
     &different, 0},
};
const struct gn_case_family gn_family_hit = {"hit", cases, sizeof cases / sizeof cases[0]};
