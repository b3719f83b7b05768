/* SPDX-License-Identifier: Apache-2.0 */
/* The Vulkan side of the suite: a device, scenes built on it, rays traced through it. No judgement here. */
#ifndef GNOMON_CTS_DEVICE_H
#define GNOMON_CTS_DEVICE_H

#include "cts/arena.h"
#include "cts/scene.h"

struct gn_device;

struct gn_device_options {
    const char *icd; /* a driver's ICD file, or NULL for what the loader finds */
    int index; /* which of the loader's devices that have ray tracing; -1: the first */
};

/* What the reports say of the device, and what decides whether a case applies. */
struct gn_device_info {
    char name[256];
    char driver_name[256];
    char driver_info[256];
    uint32_t vendor_id, device_id, driver_version, api_version;
    uint8_t device_uuid[VK_UUID_SIZE], driver_uuid[VK_UUID_SIZE];
    bool ray_query;
    bool ray_tracing_pipeline;
    bool primitive_culling; /* of pipelines; ray queries always have it */
    bool trace_indirect, trace_indirect2;
    bool pipeline_library;
    bool maintenance1;
    bool position_fetch;
    bool host_builds;
    bool indirect_builds;
    bool index_uint8;
    /* Set once a command that was asked to be deferred has said neither that it was nor that it was not. */
    bool unsaid_deferral;
    bool graphics, vertex_stores, fragment_stores; /* for ray queries where something is drawn */
    VkPhysicalDeviceAccelerationStructurePropertiesKHR limits; /* pNext is NULL */
    VkPhysicalDeviceRayTracingPipelinePropertiesKHR pipeline_limits; /* likewise; zero without pipelines */
};

/*
 * Opens the first device that has acceleration structures and ray queries or pipelines (Vulkan 1.2 or newer). NULL on
 * failure, with what was expected and found in out_error[error_size]: no loader, no such ICD file, no device,
 * no device with ray tracing (it names the devices it saw).
 */
struct gn_device *gn_device_create(const struct gn_device_options *options, char *out_error, size_t error_size);
void gn_device_destroy(struct gn_device *device);
const struct gn_device_info *gn_device_info(const struct gn_device *device);

/* Whether the driver takes this format as a vertex format of acceleration structures. */
bool gn_device_has_vertex_format(struct gn_device *device, VkFormat format);

enum gn_device_status {
    GN_DEVICE_OK,
    /* The device lacks something, memory for this scene included; a case that meets it is skipped with this reason. */
    GN_DEVICE_UNSUPPORTED,
    /* A Vulkan call failed, a layer had something to say, or the scene is not valid; the case is an error. */
    GN_DEVICE_FAILED,
    GN_DEVICE_LOST,
};

/* The message of the last status that was not OK; owned by the device. */
const char *gn_device_message(const struct gn_device *device);

struct gn_built_scene;

/*
 * Uploads and builds everything, with every step, waits, and gives the structures ready to trace. The scene
 * must stay until gn_built_scene_destroy().
 *
 * What happens in memory is hostile on purpose: structures and scratch are filled with a pattern before a
 * build, build inputs are overwritten with NaN patterns after it (an implementation that still reads them is
 * wrong), and sources of copies are destroyed.
 */
enum gn_device_status gn_scene_build(struct gn_device *device, const struct gn_cts_scene *scene,
                                     struct gn_built_scene **out_built);
void gn_built_scene_destroy(struct gn_built_scene *built);

/* Sizes and times, for reports and for cases about compaction. */
struct gn_built_info {
    uint64_t blas_bytes, blas_bytes_before_compaction;
    uint64_t tlas_bytes;
    uint64_t scratch_bytes;
    double build_seconds;
    uint32_t foreign_heads; /* structures whose serialized data did not begin with the driver's UUID */
};
struct gn_built_info gn_built_scene_info(const struct gn_built_scene *built);

/*
 * Traces the rays by that route, in chunks where there are many, and gives the answers in memory of the arena.
 * Opaque candidates are committed by the driver; the others are treated as each ray's policy says
 * (GN_CTS_CANDIDATES: never confirmed). UNSUPPORTED where the device lacks what the route needs.
 */
enum gn_device_status gn_scene_trace(struct gn_built_scene *built, const struct gn_cts_route *route,
                                     enum gn_cts_program program, const struct gn_cts_ray *rays,
                                     uint32_t ray_count, struct gn_arena *arena, struct gn_cts_answers *out_answers);

/*
 * What a shader answers instead of a kind of hit when something other than the traversal went wrong: the text of
 * it for people, or NULL for a kind of hit.
 */
const char *gn_answer_fault(uint32_t kind);

/*
 * The exact values that the device was given for a geometry: positions as the format encodes them, with the
 * divisor to be applied to them (cts/vertex_format.c). Positions come in memory of the arena. Those with an infinity have no
 * meaning in the specification; their x becomes NaN, so that the reference has no triangle there (cts/cases/stability_infinite.c).
 */
bool gn_geometry_decoded_positions(const struct gn_cts_geometry *geometry, struct gn_arena *arena,
                                   const double (**out_positions)[3], double *out_divisor);

#endif
