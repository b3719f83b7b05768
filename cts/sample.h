/* SPDX-License-Identifier: Apache-2.0 */
/* Scenes for cases that are about something else than the scene: how it is built, copied, or traced. */
#ifndef GNOMON_CTS_SAMPLE_H
#define GNOMON_CTS_SAMPLE_H

#include "cts/compose.h"

enum gn_sample_content {
    GN_SAMPLE_MESHES, /* opaque meshes of one to thousands of triangles, in several geometries */
    GN_SAMPLE_NOT_OPAQUE, /* the same, confirmed as each ray says */
    GN_SAMPLE_BOXES, /* boxes that generate hits */
    GN_SAMPLE_MIXED, /* all of it, with flags on instances and rays */
};

struct gn_sample_options {
    enum gn_sample_content content;
    VkBuildAccelerationStructureFlagsKHR flags; /* of all structures, the top level among them */
    uint8_t steps[GN_CTS_MAX_STEPS]; /* likewise; where two builds count, everything was elsewhere in the first */
    bool blases_only; /* flags and steps are not for the top level */
    uint32_t rays; /* to be multiplied by the run's scale; 0: 4096 */
};

struct gn_sample {
    struct gn_cts_scene scene;
    struct gn_cts_ray *rays;
    uint32_t ray_count;
};

void gn_sample_make(struct gn_case_run *run, const struct gn_sample_options *options, struct gn_sample *out);

/* Makes and traces it for the committed hit. */
void gn_sample_trace(struct gn_case_run *run, const struct gn_sample_options *options);

#endif
