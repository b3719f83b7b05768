/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Sweeps over AABBs: flat ones, rays along faces and through corners, origins inside, far away, many. A box may be
 * enlarged, so one that is presented in vain is no error; a lost one is.
 */
#include <math.h>

#include "cts/cases/stability.h"

enum { BOXES = 8 };

static float (*boxes_make(const struct gn_sweep_request *request, uint32_t count, struct gn_sweep_scene *out))[6]
{
    float(*boxes)[6] = gn_arena_alloc(request->arena, count, sizeof *boxes);
    struct gn_cts_geometry geometry = {
        .type = GN_REF_AABBS, .aabbs = (const float(*)[6])boxes, .aabb_count = count};
    out->scene = gn_scene_of_geometry(request->arena, &geometry);
    out->program = GN_CTS_CANDIDATES;
    out->ray_count = request->ray_count;
    out->rays = GN_NEW(request->arena, struct gn_cts_ray, request->ray_count);
    return boxes;
}

static void box_set(float box[6], const double centre[3], const double half[3])
{
    for (int a = 0; a < 3; a++) {
        box[a] = (float)(centre[a] - half[a]);
        box[a + 3] = (float)(centre[a] + half[a]);
    }
}

/* Boxes of half widths 1/4 to 1 around random centres, a row of them along x. */
static float (*row_make(const struct gn_sweep_request *request, double far, struct gn_sweep_scene *out))[6]
{
    float(*boxes)[6] = boxes_make(request, BOXES, out);
    for (int i = 0; i < BOXES; i++) {
        double centre[3], half[3];
        for (int a = 0; a < 3; a++) {
            centre[a] = gn_random_range(request->random, -1, 1) + (a == 0 ? 4 * i : 0) + (a == 1 ? -far : far);
            half[a] = gn_random_range(request->random, 0.25, 1);
        }
        box_set(boxes[i], centre, half);
    }
    return boxes;
}

/* Through a point, in a direction none of whose components is small, from 1 to 4 away. */
static struct gn_cts_ray through(struct gn_random *random, const double point[3])
{
    double direction[3], origin[3], back = gn_random_range(random, 1, 4);
    for (int a = 0; a < 3; a++) {
        direction[a] = gn_random_range(random, 0.3, 1) * (gn_random_below(random, 2) ? 1 : -1);
        origin[a] = point[a] - back * direction[a];
    }
    return gn_ray_make(origin, direction, 1e6);
}

static void inside(struct gn_random *random, const float box[6], double out[3])
{
    for (int a = 0; a < 3; a++)
        out[a] = box[a] + ((double)box[a + 3] - (double)box[a]) * gn_random_range(random, 0.1, 0.9);
}

static void flat(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    float(*boxes)[6] = row_make(request, 0, out);
    for (uint32_t i = 0; i < BOXES; i++) {
        uint32_t axis = i % 3;
        boxes[i][axis + 3] = (float)((double)boxes[i][axis] + request->value);
    }
    for (uint32_t i = 0; i < out->ray_count; i++) {
        double point[3];
        inside(request->random, boxes[gn_random_below(request->random, BOXES)], point);
        out->rays[i] = through(request->random, point);
    }
}
const struct gn_sweep gn_stability_box_flat = {
    "thickness of the boxes", "",
    GN_SWEEP_VALUES(1, 0x1p-4, 0x1p-8, 0x1p-12, 0x1p-16, 0x1p-18, 0x1p-20, 0x1p-22, 0x1p-24, 0x1p-28), 0x1p-28,
    "entry and exit are told apart by their margin, however near", 1000, flat, NULL};

/* Along a face, inside of the box by the value, with a direction that has a zero across it. */
static void face(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    float(*boxes)[6] = row_make(request, 0, out);
    for (uint32_t i = 0; i < out->ray_count; i++) {
        uint32_t b = gn_random_below(request->random, BOXES), axis = gn_random_below(request->random, 3);
        double point[3];
        inside(request->random, boxes[b], point);
        point[axis] = gn_random_below(request->random, 2) ? (double)boxes[b][axis] + request->value
                                                          : (double)boxes[b][axis + 3] - request->value;
        out->rays[i] = through(request->random, point);
        out->rays[i].ray.origin[axis] = (float)point[axis];
        out->rays[i].ray.direction[axis] = gn_random_below(request->random, 2) ? 0.0f : -0.0f;
    }
}
const struct gn_sweep gn_stability_box_face = {
    "distance of the ray from the face it follows", "",
    GN_SWEEP_VALUES(0.25, 0x1p-4, 0x1p-8, 0x1p-12, 0x1p-16, 0x1p-18, 0x1p-20, 0x1p-22, 0x1p-24, 0x1p-28), 0x1p-28,
    "whether the ray is inside is decided by its margin, however near the face", 1000, face, NULL};

static void corner(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    float(*boxes)[6] = row_make(request, 0, out);
    for (uint32_t i = 0; i < out->ray_count; i++) {
        const float *box = boxes[gn_random_below(request->random, BOXES)];
        double point[3];
        for (int a = 0; a < 3; a++)
            point[a] = gn_random_below(request->random, 2) ? (double)box[a] + request->value
                                                           : (double)box[a + 3] - request->value;
        out->rays[i] = through(request->random, point);
    }
}
const struct gn_sweep gn_stability_box_corner = {
    "distance of the ray from the corner it cuts", "",
    GN_SWEEP_VALUES(0.2, 0x1p-4, 0x1p-8, 0x1p-12, 0x1p-16, 0x1p-18, 0x1p-20, 0x1p-22, 0x1p-24, 0x1p-28), 0x1p-28,
    "entry and exit are told apart by their margin, however near", 1000, corner, NULL};

/* From inside, near a wall, outwards; every second range ends before the wall. */
static void from_inside(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    float(*boxes)[6] = row_make(request, 0, out);
    for (uint32_t i = 0; i < out->ray_count; i++) {
        uint32_t b = gn_random_below(request->random, BOXES), axis = gn_random_below(request->random, 3);
        bool low = gn_random_below(request->random, 2);
        double point[3];
        inside(request->random, boxes[b], point);
        point[axis] = low ? (double)boxes[b][axis] + request->value : (double)boxes[b][axis + 3] - request->value;
        out->rays[i] = through(request->random, point);
        struct gn_ref_ray *ray = &out->rays[i].ray;
        for (uint32_t a = 0; a < 3; a++)
            ray->origin[a] = (float)point[a];
        ray->direction[axis] = low ? -fabsf(ray->direction[axis]) : fabsf(ray->direction[axis]);
        if (i % 2)
            ray->tmax = (float)(request->value / 2);
    }
}
const struct gn_sweep gn_stability_box_inside = {
    "distance of the ray's origin from the wall, inside", "",
    GN_SWEEP_VALUES(0.2, 0x1p-4, 0x1p-8, 0x1p-12, 0x1p-16, 0x1p-18, 0x1p-20, 0x1p-22, 0x1p-24, 0x1p-28), 0x1p-28,
    "whether the origin is inside is decided by its margin, however near the wall", 1000, from_inside, NULL};

static void far_boxes(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    float(*boxes)[6] = row_make(request, request->value, out);
    for (uint32_t i = 0; i < out->ray_count; i++) {
        double point[3];
        inside(request->random, boxes[gn_random_below(request->random, BOXES)], point);
        out->rays[i] = through(request->random, point);
    }
}
const struct gn_sweep gn_stability_box_far = {
    "distance of the boxes from the origin", "", GN_SWEEP_DECADES, 1e6,
    "beyond, the rounding of the planes exceeds the boxes, and nothing is left to decide", 1000, far_boxes, NULL};

static void many_boxes(const struct gn_sweep_request *request, struct gn_sweep_scene *out)
{
    struct gn_random *random = request->random;
    uint32_t count = (uint32_t)request->value;
    float(*boxes)[6] = boxes_make(request, count, out);
    /* As large as leaves about one in a ray's way. */
    double size = fmin(0.5, 1 / sqrt(request->value));
    for (uint32_t i = 0; i < count; i++) {
        double centre[3], half[3];
        for (int a = 0; a < 3; a++) {
            centre[a] = gn_random_range(random, -1, 1);
            half[a] = size * gn_random_range(random, 0.5, 1);
        }
        box_set(boxes[i], centre, half);
    }
    for (uint32_t i = 0; i < out->ray_count; i++) {
        double point[3];
        inside(random, boxes[gn_random_below(random, count)], point);
        out->rays[i] = through(random, point);
    }
}
const struct gn_sweep gn_stability_box_many = {
    "boxes", "", GN_SWEEP_VALUES(1, 2, 8, 32, 128, 512, 2048, 8192, 32768), 32768,
    "the number of boxes has no part in the derivation", 500, many_boxes, NULL};
