/* SPDX-License-Identifier: Apache-2.0 */
/* Which record of the hit table a geometry of an instance takes. */
#include "cts/table.h"

#include <stdlib.h>
#include <string.h>

uint64_t gn_table_record(const struct gn_cts_route *route, const struct gn_cts_instance *instance, uint32_t geometry)
{
    return (uint64_t)instance->sbt_offset + (uint64_t)geometry * route->record_stride + route->record_offset;
}

uint64_t gn_table_record_count(const struct gn_cts_scene *scene, const struct gn_cts_route *route)
{
    uint64_t count = 1;
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct gn_cts_instance *instance = &scene->instances[i];
        const uint32_t geometries = instance->blas == GN_CTS_NO_BLAS ? 0 : scene->blases[instance->blas].geometry_count;
        const uint64_t end = geometries ? gn_table_record(route, instance, geometries - 1) + 1 : 0;
        count = end > count ? end : count;
    }
    return count;
}

static int key_compare(const void *left, const void *right)
{
    const uint64_t a = *(const uint64_t *)left, b = *(const uint64_t *)right;
    return a < b ? -1 : a > b;
}

/* Whether a record is for triangles as well as for boxes. */
static bool records_clash(struct gn_arena *arena, const struct gn_cts_scene *scene, const struct gn_cts_route *route)
{
    size_t capacity = 0, count = 0;
    bool both[2] = {false, false};
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const uint32_t blas = scene->instances[i].blas;
        capacity += blas == GN_CTS_NO_BLAS ? 0 : scene->blases[blas].geometry_count;
    }
    for (uint32_t b = 0; b < scene->blas_count; b++) {
        for (uint32_t g = 0; g < scene->blases[b].geometry_count; g++) {
            both[scene->blases[b].geometries[g].type == GN_REF_AABBS] = true;
        }
    }
    if (!both[0] || !both[1]) {
        return false;
    }
    uint64_t *keys = GN_NEW(arena, uint64_t, capacity + 1);
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct gn_cts_instance *instance = &scene->instances[i];
        if (instance->blas == GN_CTS_NO_BLAS) {
            continue;
        }
        const struct gn_cts_blas *blas = &scene->blases[instance->blas];
        for (uint32_t g = 0; g < blas->geometry_count; g++) {
            const bool boxes = blas->geometries[g].type == GN_REF_AABBS;
            keys[count++] = gn_table_record(route, instance, g) * 2 + boxes;
        }
    }
    qsort(keys, count, sizeof *keys, key_compare);
    for (size_t i = 1; i < count; i++) {
        if (keys[i] / 2 == keys[i - 1] / 2 && keys[i] != keys[i - 1]) {
            return true;
        }
    }
    return false;
}

const struct gn_cts_scene *gn_table_scene(struct gn_arena *arena, const struct gn_cts_scene *scene,
                                          const struct gn_cts_route *route)
{
    if (!records_clash(arena, scene, route)) {
        return scene;
    }
    uint64_t next = 0;
    uint32_t *first = GN_NEW(arena, uint32_t, scene->blas_count + 1);
    for (uint32_t b = 0; b < scene->blas_count; b++) {
        first[b] = (uint32_t)next;
        next += (uint64_t)scene->blases[b].geometry_count * route->record_stride;
        if (next > 0xFFFFFF || route->record_stride == 0) {
            return NULL;
        }
    }
    struct gn_cts_instance *instances = GN_NEW(arena, struct gn_cts_instance, scene->instance_count);
    memcpy(instances, scene->instances, scene->instance_count * sizeof *instances);
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        if (instances[i].blas != GN_CTS_NO_BLAS) {
            instances[i].sbt_offset = first[instances[i].blas];
        }
    }
    struct gn_cts_scene *copy = GN_NEW(arena, struct gn_cts_scene, 1);
    *copy = *scene;
    copy->instances = instances;
    return copy;
}
