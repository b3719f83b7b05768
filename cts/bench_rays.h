/* SPDX-License-Identifier: Apache-2.0 */
/* The ray tracing pipeline that measurements trace through, and its shader binding table. */
#ifndef GNOMON_CTS_BENCH_RAYS_H
#define GNOMON_CTS_BENCH_RAYS_H

#include "cts/device_internal.h"

struct gn_bench_rays {
    VkPipeline handle;
    VkPipeline libraries[2]; /* ray generation and miss, hits; or none */
    struct gn_pool pool;
    VkStridedDeviceAddressRegionKHR raygen, miss, hit;
};

/* Zeroed before; to be destroyed in any case. `linked`: from two libraries. UNSUPPORTED where the device has none of it. */
enum gn_device_status gn_bench_rays_create(struct gn_device *device, VkPipelineLayout layout, bool linked,
                                           struct gn_bench_rays *out);
/* Makes the table, once. */
enum gn_device_status gn_bench_rays_prepare(struct gn_device *device, struct gn_bench_rays *rays);
/* Records the pipeline and the launch, in rows of 256; `count` is one row or whole rows. */
void gn_bench_rays_record(struct gn_device *device, const struct gn_bench_rays *rays, uint32_t count);
void gn_bench_rays_destroy(struct gn_device *device, struct gn_bench_rays *rays);

#endif
