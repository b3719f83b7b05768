/* SPDX-License-Identifier: Apache-2.0 */
/* What `gnomon effects` says of light transport, as text and as a page of its own. */
#ifndef GNOMON_CTS_RENDER_PAGE_H
#define GNOMON_CTS_RENDER_PAGE_H

#include "cts/render.h"

#define GN_RENDER_CURVE_POINTS 8

struct gn_render_curve {
    struct {
        uint32_t value;
        double seconds, error; /* the root of the mean square against the best picture */
        uint64_t rays, pink;
    } points[GN_RENDER_CURVE_POINTS];
    uint32_t count; /* 0: not measured */
};

struct gn_render_page {
    const struct gn_render_scene *scene;
    struct gn_render_options options;
    struct gn_render_plan plan;
    struct gn_render_result reference, driver;
    struct {
        double seconds;
        uint64_t rays;
        bool same;
    } forced[GN_RENDER_EFFECT_COUNT]; /* of those that are not called for */
    struct gn_render_curve samples, depths;
    const char *driver_name; /* NULL: no driver */
    const struct gn_case_result *judged;
    double picture_error; /* between the driver's picture and the exact one */
};

void gn_render_page_print(const struct gn_render_page *page);
/* Writes FOLDER/effects.html, which needs nothing else. False with a message. */
bool gn_render_page_write(const struct gn_render_page *page, const char *folder, char *out_error, size_t error_size);
/* 0, or 1 with what is not as it should be. */
int gn_render_page_fault(const struct gn_render_page *page, char *out_error, size_t error_size);

#endif
