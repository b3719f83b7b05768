/* SPDX-License-Identifier: Apache-2.0 */
/* Writes a scene's data as the build commands read them, and builds its structures. */
#include <stdlib.h>
#include <string.h>

#include "cts/device_internal.h"
#include "cts/vertex_format.h"

#define INPUT_ALIGNMENT 16
#define TRANSFORM_BYTES 48
#define AABB_BYTES 24
#define SPARE_PRIMITIVES 5

/* Space between instances that are reached through pointers: more than they take. */
#define POINTED_INSTANCE_BYTES 80

/* Whether the structures stay where they are in all their steps. */
static bool steps_stay(const uint8_t *steps)
{
    for (uint32_t i = 0; i < GN_CTS_MAX_STEPS && steps[i] != GN_CTS_STEP_END; i++) {
        if (steps[i] != GN_CTS_STEP_REFIT && steps[i] != GN_CTS_STEP_REFIT_BACK && steps[i] != GN_CTS_STEP_REBUILD) {
            return false;
        }
    }
    return true;
}

static enum gn_device_status invalid(struct gn_built_scene *built, const char *what, uint32_t blas, uint32_t geometry,
                                     uint64_t value)
{
    return gn_device_fail(built->device, GN_DEVICE_FAILED,
                          "the scene is not valid: BLAS %u, geometry %u: %s, not %llu", blas, geometry, what,
                          (unsigned long long)value);
}

/* Input memory of `head + count * stride + tail` bytes, filled with NaNs. */
static enum gn_device_status input_take(struct gn_built_scene *built, struct gn_pool *pool, uint64_t head,
                                        uint64_t count, uint64_t stride, uint64_t tail, struct gn_memory *out_memory)
{
    uint64_t size = 0;
    if (__builtin_mul_overflow(count, stride, &size) || __builtin_add_overflow(size, head, &size) ||
        __builtin_add_overflow(size, tail, &size) || size > SIZE_MAX / 2) {
        return gn_device_fail(built->device, GN_DEVICE_UNSUPPORTED,
                              "build data of %llu things of %llu bytes are too large", (unsigned long long)count,
                              (unsigned long long)stride);
    }
    const enum gn_device_status status = gn_pool_take(built->device, pool, size, INPUT_ALIGNMENT, out_memory);
    if (status == GN_DEVICE_OK) {
        memset(out_memory->mapped, 0xFF, out_memory->size);
    }
    return status;
}

/*
 * Where a build finds it: a pointer, if the commands run on the host. Both share the storage of a union, so that the
 * device's member holds either.
 */
static VkDeviceAddress address_of(const struct gn_memory *memory, enum gn_cts_commands builds)
{
    _Static_assert(sizeof(void *) <= sizeof(VkDeviceAddress), "a pointer has to fit in a device address");
    return gn_commands_host(builds) ? (VkDeviceAddress)(uintptr_t)memory->mapped : memory->address;
}

/* How a triangle geometry's data lie in memory. */
struct layout {
    const struct gn_vertex_format *format;
    uint32_t stride;
    uint64_t head; /* bytes before the first vertex that counts */
    uint64_t vertex_count; /* that count */
    uint32_t index_bytes;
    VkIndexType index_type;
};

static enum gn_device_status layout_find(struct gn_built_scene *built, const struct gn_cts_geometry *geometry,
                                         uint32_t blas, uint32_t number, struct layout *out)
{
    const struct gn_vertex_format *format = gn_vertex_format_find(geometry->vertex_format);
    if (!format || !gn_device_has_vertex_format(built->device, format->format)) {
        return gn_device_fail(built->device, GN_DEVICE_UNSUPPORTED,
                              "the vertex format %s%.0d is not one that acceleration structures take",
                              format ? format->name : "number ", format ? 0 : (int)geometry->vertex_format);
    }
    /* The fourth component is not read, so the next vertex may lie on it. */
    const uint32_t needed =
        format->components < 4 || format->component_bits == 10 ? format->size : format->size / 4 * 3;
    out->format = format;
    out->stride = geometry->vertex_stride ? geometry->vertex_stride : format->size;
    if (out->stride % format->alignment || out->stride < needed) {
        return invalid(built, "the vertex stride has to hold a vertex and be a multiple of its component", blas, number,
                       out->stride);
    }
    if (geometry->vertex_offset % format->alignment) {
        return invalid(built, "the vertex offset has to be a multiple of the component", blas, number,
                       geometry->vertex_offset);
    }
    out->head = geometry->vertex_offset + (uint64_t)geometry->first_vertex * out->stride;
    out->vertex_count = geometry->position_count;
    if (geometry->index_none) {
        out->index_type = VK_INDEX_TYPE_NONE_KHR;
        out->index_bytes = 0;
        out->head += geometry->primitive_offset;
        out->vertex_count = (uint64_t)geometry->triangle_count * 3;
        if (geometry->primitive_offset % format->alignment) {
            return invalid(built, "the primitive offset has to be a multiple of the vertex component", blas, number,
                           geometry->primitive_offset);
        }
    } else if (geometry->index_type != VK_INDEX_TYPE_UINT16 && geometry->index_type != VK_INDEX_TYPE_UINT32) {
        return gn_device_fail(built->device, GN_DEVICE_UNSUPPORTED,
                              "index type %d is not one that acceleration structures take "
                              "(VUID-VkAccelerationStructureGeometryTrianglesDataKHR-indexType-03798)",
                              (int)geometry->index_type);
    } else {
        const bool wide = geometry->index_uint32 || geometry->index_type == VK_INDEX_TYPE_UINT32 ||
                          geometry->position_count > 65536;
        out->index_type = wide ? VK_INDEX_TYPE_UINT32 : VK_INDEX_TYPE_UINT16;
        out->index_bytes = wide ? 4 : 2;
        if (geometry->primitive_offset % out->index_bytes) {
            return invalid(built, "the primitive offset has to be a multiple of the index", blas, number,
                           geometry->primitive_offset);
        }
        if (geometry->data_offset % out->index_bytes) {
            return invalid(built, "the data offset has to be a multiple of the index", blas, number,
                           geometry->data_offset);
        }
    }
    const uint64_t last = geometry->first_vertex + out->vertex_count;
    if (last > UINT32_MAX || out->head > UINT32_MAX) {
        return invalid(built, "the vertices have to be countable in 32 bits", blas, number, last);
    }
    for (uint32_t i = 0; i < geometry->triangle_count; i++) {
        for (uint32_t k = 0; k < 3; k++) {
            if (geometry->triangles[i][k] >= geometry->position_count) {
                return invalid(built, "an index has to be below the number of positions", blas, number,
                               geometry->triangles[i][k]);
            }
        }
    }
    return GN_DEVICE_OK;
}

static enum gn_device_status vertices_write(struct gn_built_scene *built, struct gn_pool *pool,
                                            const struct gn_cts_geometry *geometry, const struct layout *layout,
                                            const double (*positions)[3], VkDeviceAddress *out_address)
{
    struct gn_memory memory;
    const enum gn_device_status status = input_take(built, pool, layout->head, layout->vertex_count, layout->stride,
                                                    layout->format->size, &memory);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    uint8_t *out = memory.mapped + layout->head;
    for (uint64_t i = 0; i < layout->vertex_count; i++) {
        const uint64_t vertex = geometry->index_none ? geometry->triangles[i / 3][i % 3] : i;
        gn_vertex_encode(layout->format, positions[vertex], out + i * layout->stride);
    }
    *out_address = address_of(&memory, built->scene->blas_builds) + geometry->vertex_offset;
    return GN_DEVICE_OK;
}

static enum gn_device_status indices_write(struct gn_built_scene *built, const struct gn_cts_geometry *geometry,
                                           const struct layout *layout, VkDeviceAddress *out_address)
{
    struct gn_memory memory;
    const uint64_t count = (uint64_t)geometry->triangle_count * 3;
    const enum gn_device_status status =
        input_take(built, &built->inputs, (uint64_t)geometry->data_offset + geometry->primitive_offset, count,
                   layout->index_bytes, 0, &memory);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    /* Degenerate triangles come first: an offset that is not minded gives wrong hits rather than wild reads. */
    memset(memory.mapped, 0, geometry->data_offset + geometry->primitive_offset);
    uint8_t *out = memory.mapped + geometry->data_offset + geometry->primitive_offset;
    if (layout->index_bytes == 4) {
        memcpy(out, geometry->triangles, count * 4);
    } else {
        for (uint64_t i = 0; i < count; i++) {
            const uint16_t index = (uint16_t)geometry->triangles[i / 3][i % 3];
            memcpy(out + i * 2, &index, 2);
        }
    }
    *out_address = address_of(&memory, built->scene->blas_builds) + geometry->data_offset;
    return GN_DEVICE_OK;
}

static enum gn_device_status transform_write(struct gn_built_scene *built, struct gn_pool *pool,
                                             const struct gn_cts_geometry *geometry, const float *transform,
                                             VkDeviceAddress *out_address)
{
    struct gn_memory memory;
    const enum gn_device_status status =
        input_take(built, pool, geometry->transform_offset, 1, TRANSFORM_BYTES, 0, &memory);
    if (status == GN_DEVICE_OK) {
        memcpy(memory.mapped + geometry->transform_offset, transform, TRANSFORM_BYTES);
        *out_address = address_of(&memory, built->scene->blas_builds);
    }
    return status;
}

static enum gn_device_status triangles_write(struct gn_built_scene *built, const struct gn_cts_geometry *geometry,
                                             uint32_t blas, uint32_t number, bool two_inputs,
                                             struct gn_build_input *initial, struct gn_build_input *final)
{
    struct layout layout = {0};
    enum gn_device_status status = layout_find(built, geometry, blas, number, &layout);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    VkAccelerationStructureGeometryTrianglesDataKHR triangles = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
        .vertexFormat = layout.format->format,
        .vertexStride = layout.stride,
        .indexType = layout.index_type,
    };
    /* The last vertex that may be addressed, counted from vertexData. */
    uint64_t vertices = geometry->first_vertex + layout.vertex_count;
    if (geometry->index_none) {
        vertices += (geometry->primitive_offset + layout.stride - 1) / layout.stride;
    }
    triangles.maxVertex = (uint32_t)(vertices ? vertices - 1 : 0);
    if (!geometry->index_none) {
        status = indices_write(built, geometry, &layout, &triangles.indexData.deviceAddress);
        if (status != GN_DEVICE_OK) {
            return status;
        }
    }
    status = vertices_write(built, &built->inputs, geometry, &layout, geometry->positions,
                            &triangles.vertexData.deviceAddress);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    if (geometry->transform) {
        status = transform_write(built, &built->inputs, geometry, geometry->transform,
                                 &triangles.transformData.deviceAddress);
        if (status != GN_DEVICE_OK) {
            return status;
        }
    }
    const VkAccelerationStructureBuildRangeInfoKHR range = {
        .primitiveCount = geometry->triangle_count,
        .primitiveOffset = geometry->primitive_offset,
        .firstVertex = geometry->first_vertex,
        .transformOffset = geometry->transform ? geometry->transform_offset : 0,
    };
    final->geometries[number].geometry.triangles = triangles;
    final->ranges[number] = range;
    if (!two_inputs) {
        return GN_DEVICE_OK;
    }
    if (geometry->initial_positions) {
        status = vertices_write(built, &built->initial, geometry, &layout, geometry->initial_positions,
                                &triangles.vertexData.deviceAddress);
        if (status != GN_DEVICE_OK) {
            return status;
        }
    }
    if (geometry->initial_transform) {
        if (!geometry->transform) {
            return invalid(built, "an initial transform needs a final one; transforms given", blas, number, 1);
        }
        status = transform_write(built, &built->initial, geometry, geometry->initial_transform,
                                 &triangles.transformData.deviceAddress);
        if (status != GN_DEVICE_OK) {
            return status;
        }
    }
    initial->geometries[number].geometry.triangles = triangles;
    initial->ranges[number] = range;
    return GN_DEVICE_OK;
}

static enum gn_device_status aabb_data_write(struct gn_built_scene *built, struct gn_pool *pool,
                                             const struct gn_cts_geometry *geometry, const float (*aabbs)[6],
                                             uint32_t stride, VkDeviceAddress *out_address)
{
    struct gn_memory memory;
    const enum gn_device_status status =
        input_take(built, pool, (uint64_t)geometry->data_offset + geometry->primitive_offset, geometry->aabb_count,
                   stride, AABB_BYTES, &memory);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    uint8_t *out = memory.mapped + geometry->data_offset + geometry->primitive_offset;
    for (uint32_t i = 0; i < geometry->aabb_count; i++) {
        memcpy(out + (size_t)i * stride, aabbs[i], AABB_BYTES);
    }
    *out_address = address_of(&memory, built->scene->blas_builds) + geometry->data_offset;
    return GN_DEVICE_OK;
}

static enum gn_device_status aabbs_write(struct gn_built_scene *built, const struct gn_cts_geometry *geometry,
                                         uint32_t blas, uint32_t number, bool two_inputs,
                                         struct gn_build_input *initial, struct gn_build_input *final)
{
    const uint32_t stride = geometry->aabb_stride ? geometry->aabb_stride : AABB_BYTES;
    if (stride % 8 || stride < AABB_BYTES) {
        return invalid(built, "the AABB stride has to be a multiple of 8 of at least 24", blas, number, stride);
    }
    if (geometry->primitive_offset % 8) {
        return invalid(built, "the primitive offset of AABBs has to be a multiple of 8", blas, number,
                       geometry->primitive_offset);
    }
    if (geometry->data_offset % 8) {
        return invalid(built, "the data offset of AABBs has to be a multiple of 8", blas, number, geometry->data_offset);
    }
    VkAccelerationStructureGeometryAabbsDataKHR aabbs = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR,
        .stride = stride,
    };
    const VkAccelerationStructureBuildRangeInfoKHR range = {
        .primitiveCount = geometry->aabb_count,
        .primitiveOffset = geometry->primitive_offset,
    };
    enum gn_device_status status =
        aabb_data_write(built, &built->inputs, geometry, geometry->aabbs, stride, &aabbs.data.deviceAddress);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    final->geometries[number].geometry.aabbs = aabbs;
    final->ranges[number] = range;
    if (!two_inputs) {
        return GN_DEVICE_OK;
    }
    if (geometry->initial_aabbs) {
        status = aabb_data_write(built, &built->initial, geometry, geometry->initial_aabbs, stride,
                                 &aabbs.data.deviceAddress);
        if (status != GN_DEVICE_OK) {
            return status;
        }
    }
    initial->geometries[number].geometry.aabbs = aabbs;
    initial->ranges[number] = range;
    return GN_DEVICE_OK;
}

static enum gn_device_status steps_check(struct gn_built_scene *built, const uint8_t *steps,
                                         VkBuildAccelerationStructureFlagsKHR flags, bool bottom)
{
    for (uint32_t i = 0; i < GN_CTS_MAX_STEPS && steps[i] != GN_CTS_STEP_END; i++) {
        const bool updates = steps[i] == GN_CTS_STEP_REFIT || steps[i] == GN_CTS_STEP_REFIT_COPY ||
                             steps[i] == GN_CTS_STEP_REFIT_BACK;
        if (updates && !(flags & VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR)) {
            return gn_device_fail(built->device, GN_DEVICE_FAILED,
                                  "the scene is not valid: a refit needs ALLOW_UPDATE, the build flags are 0x%x", flags);
        }
        if (steps[i] == GN_CTS_STEP_COMPACT && !(flags & VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR)) {
            return gn_device_fail(built->device, GN_DEVICE_FAILED,
                                  "the scene is not valid: compaction needs ALLOW_COMPACTION, the build flags are 0x%x",
                                  flags);
        }
        if (steps[i] >= GN_CTS_STEP_COUNT || (steps[i] == GN_CTS_STEP_RELOCATE && bottom)) {
            return gn_device_fail(built->device, GN_DEVICE_FAILED, "the scene is not valid: there is no step %u of a structure of this level",
                                  steps[i]);
        }
    }
    if (flags & VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_DATA_ACCESS_KHR && !built->device->info.position_fetch) {
        return gn_device_fail(built->device, GN_DEVICE_UNSUPPORTED,
                              "the device has no VK_KHR_ray_tracing_position_fetch");
    }
    return GN_DEVICE_OK;
}

/* The count that sizes are asked for: indirect builds get theirs from memory, and it may be smaller. */
static uint32_t count_most(uint32_t count, enum gn_cts_commands builds)
{
    return builds == GN_CTS_INDIRECT ? count + SPARE_PRIMITIVES : count;
}

/* They lie the other way round than they are pointed at, so that none follows the one before it. */
static const VkAccelerationStructureGeometryKHR **pointers_make(struct gn_arena *arena,
                                                                const VkAccelerationStructureGeometryKHR *geometries,
                                                                uint32_t count)
{
    const VkAccelerationStructureGeometryKHR **pointers =
        GN_NEW(arena, const VkAccelerationStructureGeometryKHR *, count);
    VkAccelerationStructureGeometryKHR *turned = GN_NEW(arena, VkAccelerationStructureGeometryKHR, count);
    for (uint32_t g = 0; g < count; g++) {
        turned[count - 1 - g] = geometries[g];
        pointers[g] = &turned[count - 1 - g];
    }
    return pointers;
}

static enum gn_device_status blas_write(struct gn_built_scene *built, uint32_t number)
{
    struct gn_device *device = built->device;
    const struct gn_cts_blas *blas = &built->scene->blases[number];
    struct gn_structure *structure = &built->blases[number];
    enum gn_device_status status = steps_check(built, blas->steps, blas->build_flags, true);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    const uint32_t count = blas->geometry_count;
    if (built->scene->late_steps && !steps_stay(blas->steps)) {
        return gn_device_fail(device, GN_DEVICE_FAILED,
                              "the scene is not valid: BLAS %u moves after the TLAS was built", number);
    }
    const bool two_inputs = gn_steps_take_both(blas->steps);
    uint32_t *primitive_counts = GN_NEW(&built->arena, uint32_t, count);
    structure->type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR;
    structure->generic = blas->generic;
    structure->flags = blas->build_flags;
    structure->steps = blas->steps;
    structure->geometry_count = count;
    structure->primitive_counts = primitive_counts;
    struct gn_build_input *inputs[] = {&structure->initial, &structure->final};
    for (size_t i = 0; i < 2; i++) {
        inputs[i]->geometries = GN_NEW(&built->arena, VkAccelerationStructureGeometryKHR, count);
        inputs[i]->ranges = GN_NEW(&built->arena, VkAccelerationStructureBuildRangeInfoKHR, count);
    }
    uint64_t primitives = 0;
    for (uint32_t g = 0; g < count; g++) {
        const struct gn_cts_geometry *geometry = &blas->geometries[g];
        const bool triangles = geometry->type == GN_REF_TRIANGLES;
        for (size_t i = 0; i < 2; i++) {
            inputs[i]->geometries[g] = (VkAccelerationStructureGeometryKHR){
                .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
                .geometryType = triangles ? VK_GEOMETRY_TYPE_TRIANGLES_KHR : VK_GEOMETRY_TYPE_AABBS_KHR,
                .flags = geometry->flags,
            };
        }
        status = triangles ? triangles_write(built, geometry, number, g, two_inputs, inputs[0], inputs[1])
                           : aabbs_write(built, geometry, number, g, two_inputs, inputs[0], inputs[1]);
        if (status != GN_DEVICE_OK) {
            return status;
        }
        primitive_counts[g] =
            count_most(triangles ? geometry->triangle_count : geometry->aabb_count, built->scene->blas_builds);
        primitives += primitive_counts[g];
    }
    for (size_t i = 0; i < 2 && built->scene->geometry_pointers; i++) {
        inputs[i]->pointers = pointers_make(&built->arena, inputs[i]->geometries, count);
    }
    const VkPhysicalDeviceAccelerationStructurePropertiesKHR *limits = &device->info.limits;
    if (primitives > limits->maxPrimitiveCount || count > limits->maxGeometryCount) {
        return gn_device_fail(device, GN_DEVICE_UNSUPPORTED,
                              "BLAS %u has %llu primitives in %u geometries, the device takes %llu in %llu", number,
                              (unsigned long long)primitives, count, (unsigned long long)limits->maxPrimitiveCount,
                              (unsigned long long)limits->maxGeometryCount);
    }
    return GN_DEVICE_OK;
}

static VkAccelerationStructureInstanceKHR instance_of(const struct gn_built_scene *built,
                                                      const struct gn_cts_instance *instance)
{
    const bool host = gn_commands_host(built->scene->tlas_builds);
    const struct gn_structure *blas = instance->blas == GN_CTS_NO_BLAS ? NULL : &built->blases[instance->blas];
    VkAccelerationStructureInstanceKHR out = {
        .instanceCustomIndex = instance->custom_index & 0xFFFFFFu,
        .mask = instance->mask & 0xFFu,
        .instanceShaderBindingTableRecordOffset = instance->sbt_offset & 0xFFFFFFu,
        .flags = instance->flags & 0xFFu,
        .accelerationStructureReference = !blas  ? 0
                                          : host ? (uint64_t)(uintptr_t)blas->handle
                                                 : blas->address,
    };
    memcpy(&out.transform, instance->transform, sizeof out.transform);
    return out;
}

static enum gn_device_status instances_write(struct gn_built_scene *built, struct gn_pool *pool,
                                             const struct gn_cts_instance *instances, VkDeviceAddress *out_address)
{
    const struct gn_cts_scene *scene = built->scene;
    const uint32_t count = scene->instance_count;
    const uint32_t head = scene->instance_offset;
    const size_t instance_bytes = sizeof(VkAccelerationStructureInstanceKHR);
    struct gn_memory memory;
    enum gn_device_status status = GN_DEVICE_OK;
    if (!scene->array_of_pointers) {
        if ((status = input_take(built, pool, head, count, instance_bytes, 0, &memory)) != GN_DEVICE_OK) {
            return status;
        }
        memset(memory.mapped, 0, head); /* null references: an offset that is not minded loses instances */
        for (uint32_t i = 0; i < count; i++) {
            const VkAccelerationStructureInstanceKHR instance = instance_of(built, &instances[i]);
            memcpy(memory.mapped + head + i * instance_bytes, &instance, instance_bytes);
        }
        *out_address = address_of(&memory, scene->tlas_builds);
        return GN_DEVICE_OK;
    }
    /* The first of those pointed to is a null reference, for the pointers before the offset. */
    struct gn_memory pointers;
    if ((status = input_take(built, pool, 0, (uint64_t)count + 1, POINTED_INSTANCE_BYTES, 0, &memory)) !=
            GN_DEVICE_OK ||
        (status = input_take(built, pool, head, count, sizeof(uint64_t), 0, &pointers)) != GN_DEVICE_OK) {
        return status;
    }
    memset(memory.mapped, 0, instance_bytes);
    const VkDeviceAddress first = address_of(&memory, scene->tlas_builds);
    for (uint32_t i = 0; i < head / sizeof(uint64_t); i++) {
        memcpy(pointers.mapped + i * sizeof first, &first, sizeof first);
    }
    for (uint32_t i = 0; i < count; i++) {
        const VkAccelerationStructureInstanceKHR instance = instance_of(built, &instances[i]);
        /* Last to first, so that their order in memory is not the order of the pointers. */
        const uint64_t offset = (uint64_t)(count - i) * POINTED_INSTANCE_BYTES;
        const VkDeviceAddress address = first + offset;
        memcpy(memory.mapped + offset, &instance, instance_bytes);
        memcpy(pointers.mapped + head + i * sizeof address, &address, sizeof address);
    }
    *out_address = address_of(&pointers, scene->tlas_builds);
    return GN_DEVICE_OK;
}

static enum gn_device_status tlas_write(struct gn_built_scene *built)
{
    struct gn_device *device = built->device;
    const struct gn_cts_scene *scene = built->scene;
    struct gn_structure *structure = &built->tlas;
    enum gn_device_status status = steps_check(built, scene->tlas_steps, scene->tlas_build_flags, false);
    if (status != GN_DEVICE_OK) {
        return status;
    }
    if (scene->instance_count > device->info.limits.maxInstanceCount) {
        return gn_device_fail(device, GN_DEVICE_UNSUPPORTED, "the scene has %u instances, the device takes %llu",
                              scene->instance_count, (unsigned long long)device->info.limits.maxInstanceCount);
    }
    if (scene->instance_offset % 16) {
        return gn_device_fail(device, GN_DEVICE_FAILED,
                              "the scene is not valid: the instance offset has to be a multiple of 16, not %u",
                              scene->instance_offset);
    }
    const bool two_inputs = gn_steps_take_both(scene->tlas_steps) && scene->initial_instances;
    const struct gn_cts_instance *lists[] = {scene->instances, two_inputs ? scene->initial_instances : NULL};
    for (size_t list = 0; list < 2 && lists[list]; list++) {
        for (uint32_t i = 0; i < scene->instance_count; i++) {
            if (lists[list][i].blas >= scene->blas_count && lists[list][i].blas != GN_CTS_NO_BLAS) {
                return gn_device_fail(device, GN_DEVICE_FAILED,
                                      "the scene is not valid: instance %u refers to BLAS %u of %u", i,
                                      lists[list][i].blas, scene->blas_count);
            }
        }
    }
    uint32_t *primitive_count = GN_NEW(&built->arena, uint32_t, 1);
    *primitive_count = count_most(scene->instance_count, scene->tlas_builds);
    structure->type = VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR;
    structure->generic = scene->tlas_generic;
    structure->flags = scene->tlas_build_flags;
    structure->steps = scene->tlas_steps;
    structure->geometry_count = 1;
    structure->primitive_counts = primitive_count;
    struct gn_build_input *inputs[] = {&structure->initial, &structure->final};
    for (size_t i = 0; i < 2; i++) {
        VkAccelerationStructureGeometryKHR *geometry = GN_NEW(&built->arena, VkAccelerationStructureGeometryKHR, 1);
        *geometry = (VkAccelerationStructureGeometryKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
            .geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR,
            .geometry.instances = {
                .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
                .arrayOfPointers = scene->array_of_pointers,
            },
        };
        inputs[i]->geometries = geometry;
        inputs[i]->ranges = GN_NEW(&built->arena, VkAccelerationStructureBuildRangeInfoKHR, 1);
        *inputs[i]->ranges = (VkAccelerationStructureBuildRangeInfoKHR){
            .primitiveCount = scene->instance_count,
            .primitiveOffset = scene->instance_offset,
        };
    }
    VkDeviceAddress *initial = &structure->initial.geometries->geometry.instances.data.deviceAddress;
    VkDeviceAddress *final = &structure->final.geometries->geometry.instances.data.deviceAddress;
    if ((status = instances_write(built, &built->inputs, scene->instances, final)) != GN_DEVICE_OK) {
        return status;
    }
    *initial = *final;
    return two_inputs ? instances_write(built, &built->initial, scene->initial_instances, initial) : GN_DEVICE_OK;
}

/* Whether the device has the commands that the scene asks for. */
static enum gn_device_status commands_check(struct gn_device *device, const struct gn_cts_scene *scene)
{
    const enum gn_cts_commands list[] = {scene->blas_builds, scene->tlas_builds, scene->copies};
    for (size_t i = 0; i < sizeof list / sizeof list[0]; i++) {
        if (list[i] == GN_CTS_INDIRECT && !device->info.indirect_builds) {
            return gn_device_fail(device, GN_DEVICE_UNSUPPORTED,
                                  "the device lacks the feature accelerationStructureIndirectBuild");
        }
        if (gn_commands_host(list[i]) && !device->info.host_builds) {
            return gn_device_fail(device, GN_DEVICE_UNSUPPORTED,
                                  "the device lacks the feature accelerationStructureHostCommands");
        }
    }
    return scene->copies != GN_CTS_INDIRECT
               ? GN_DEVICE_OK
               : gn_device_fail(device, GN_DEVICE_FAILED, "the scene is not valid: there are no indirect copies");
}

enum gn_device_status gn_scene_build(struct gn_device *device, const struct gn_cts_scene *scene,
                                     struct gn_built_scene **out_built)
{
    enum gn_device_status status = GN_DEVICE_OK;
    *out_built = NULL;
    struct gn_built_scene *built = calloc(1, sizeof *built);
    if (!built) {
        return gn_device_fail(device, GN_DEVICE_FAILED, "no host memory for a scene");
    }
    built->device = device;
    built->scene = scene;
    built->blas_count = scene->blas_count;
    built->blases = GN_NEW(&built->arena, struct gn_structure, scene->blas_count);
    built->initial.kind = GN_MEMORY_INPUT;
    built->inputs.kind = GN_MEMORY_INPUT;
    built->storage.kind = GN_MEMORY_STRUCTURE;
    built->scratch.kind = GN_MEMORY_SCRATCH;
    built->serialized.kind = GN_MEMORY_HOST;
    built->ranges.kind = GN_MEMORY_TABLE;
    if ((status = commands_check(device, scene)) != GN_DEVICE_OK) {
        goto fail;
    }
    if (gn_commands_host(scene->blas_builds) || gn_commands_host(scene->tlas_builds) ||
        gn_commands_host(scene->copies)) {
        built->storage.kind = GN_MEMORY_HOST_STRUCTURE;
        built->scratch.kind = GN_MEMORY_HOST;
    }
    struct gn_structures_plan plan = {
        .structures = &built->storage,
        .scratch = &built->scratch,
        .serialized = &built->serialized,
        .initial = &built->initial,
        .ranges = &built->ranges,
        .builds = scene->blas_builds,
        .copies = scene->copies,
        .separate_builds = scene->separate_builds,
        .keep_sources = scene->keep_sources,
        .only_first = scene->late_steps,
    };

    for (uint32_t i = 0; i < scene->blas_count; i++) {
        if ((status = blas_write(built, i)) != GN_DEVICE_OK) {
            goto fail;
        }
    }
    const double begin = gn_seconds_now();
    status = gn_structures_build(device, &plan, built->blases, built->blas_count);
    if (status != GN_DEVICE_OK) {
        goto fail;
    }
    if ((status = tlas_write(built)) != GN_DEVICE_OK) {
        goto fail;
    }
    struct gn_structures_plan tlas_plan = plan;
    tlas_plan.builds = scene->tlas_builds;
    tlas_plan.separate_builds = true;
    tlas_plan.blases = built->blases;
    tlas_plan.blas_count = built->blas_count;
    status = gn_structures_build(device, &tlas_plan, &built->tlas, 1);
    if (status != GN_DEVICE_OK) {
        goto fail;
    }
    if (scene->late_steps) {
        plan.only_first = tlas_plan.only_first = false;
        plan.only_steps = tlas_plan.only_steps = true;
        status = gn_structures_build(device, &plan, built->blases, built->blas_count);
        if (status == GN_DEVICE_OK) {
            status = gn_structures_build(device, &tlas_plan, &built->tlas, 1);
        }
        if (status != GN_DEVICE_OK) {
            goto fail;
        }
    }
    for (uint32_t i = 0; i < built->blas_count; i++) {
        built->info.blas_bytes += built->blases[i].size;
        built->info.foreign_heads += built->blases[i].foreign_head;
        built->info.blas_bytes_before_compaction += built->blases[i].size_before_compaction;
    }
    built->info.tlas_bytes = built->tlas.size;
    built->info.foreign_heads += built->tlas.foreign_head;
    built->info.scratch_bytes = built->scratch.bytes;
    built->info.build_seconds = gn_seconds_now() - begin;
    gn_pool_poison(&built->initial);
    gn_pool_poison(&built->inputs);
    gn_pool_finish(device, &built->scratch);
    gn_pool_finish(device, &built->serialized);
    gn_pool_finish(device, &built->ranges);
    if ((status = gn_device_layers_check(device)) != GN_DEVICE_OK) {
        goto fail;
    }
    *out_built = built;
    return GN_DEVICE_OK;

fail:
    gn_built_scene_destroy(built);
    return status;
}

void gn_built_scene_destroy(struct gn_built_scene *built)
{
    if (!built) {
        return;
    }
    struct gn_device *device = built->device;
    gn_structures_finish(device, &built->tlas, 1);
    gn_structures_finish(device, built->blases, built->blas_count);
    gn_pool_finish(device, &built->initial);
    gn_pool_finish(device, &built->inputs);
    gn_pool_finish(device, &built->storage);
    gn_pool_finish(device, &built->scratch);
    gn_pool_finish(device, &built->serialized);
    gn_pool_finish(device, &built->ranges);
    gn_arena_finish(&built->arena);
    free(built);
}

struct gn_built_info gn_built_scene_info(const struct gn_built_scene *built)
{
    return built->info;
}
