/* SPDX-License-Identifier: Apache-2.0 */
/* The surfaces of groups of neighbouring primitives, in the order of the build and in that of a new one. A tree that is only updated keeps
 * its groups, and a ray enters a group about as often as its surface is large. */
#include "layer/spread.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define GROUP 16u

struct box {
    float min[3], max[3];
};

static void include(struct box *box, const float point[3])
{
    for (int axis = 0; axis < 3; axis++) {
        box->min[axis] = fminf(box->min[axis], point[axis]);
        box->max[axis] = fmaxf(box->max[axis], point[axis]);
    }
}

static const struct box nothing = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static uint64_t primitives(const struct gn_geometry_contents *contents)
{
    return contents->boxes ? contents->box_count : contents->index_count / 3;
}

/* False if it is not known, inactive, or not finite. */
static bool box_of(const struct gn_geometry_contents *contents, uint32_t primitive, struct box *out)
{
    float values[6] = {0};
    *out = nothing;
    if (contents->boxes) {
        memcpy(values, contents->boxes + primitive * contents->box_stride, sizeof values);
        include(out, values);
        include(out, values + 3);
    }
    for (uint64_t corner = (uint64_t)primitive * 3; !contents->boxes && corner < (uint64_t)primitive * 3 + 3; corner++) {
        uint32_t index = (uint32_t)corner;
        if (contents->indices) {
            index = 0;
            memcpy(&index, contents->indices + corner * contents->index_size, contents->index_size);
        }
        if (index >= contents->vertex_count)
            return false;
        memcpy(values, contents->vertices + index * contents->vertex_stride, contents->component_count * sizeof values[0]);
        include(out, values);
    }
    bool finite = true;
    for (int axis = 0; axis < 3; axis++)
        finite &= isfinite(out->min[axis]) && isfinite(out->max[axis]);
    return finite;
}

static uint32_t spread_bits(uint32_t value)
{
    uint32_t out = 0;
    for (int bit = 0; bit < 10; bit++)
        out |= (value >> bit & 1) << 3 * bit;
    return out;
}

static int compare(const void *a, const void *b)
{
    const uint64_t *one = a, *other = b;
    return (*one > *other) - (*one < *other);
}

uint32_t *gn_spread_order(const struct gn_geometry_contents *contents, uint32_t *out_count)
{
    uint64_t count = primitives(contents);
    struct box around = nothing, box;
    uint64_t *keys = NULL;
    uint32_t *order = NULL;
    if (count < GN_SPREAD_LEAST || count > GN_SPREAD_MOST ||
        (!contents->boxes && (!contents->vertices || contents->component_size != 4 || contents->component_count < 2)))
        return NULL;
    keys = malloc(count * sizeof *keys);
    order = malloc(count * sizeof *order);
    if (!keys || !order)
        goto fail;
    for (uint32_t i = 0; i < count; i++) {
        if (!box_of(contents, i, &box))
            goto fail;
        include(&around, box.min);
        include(&around, box.max);
    }
    for (uint32_t i = 0; i < count; i++) {
        uint32_t code = 0;
        box_of(contents, i, &box);
        for (int axis = 0; axis < 3; axis++) {
            float extent = around.max[axis] - around.min[axis], middle = box.min[axis] / 2 + box.max[axis] / 2 - around.min[axis];
            float cell = extent > 0 ? middle / extent * 1023 : 0;
            code |= spread_bits(cell > 0 && cell < 1024 ? (uint32_t)cell : 0) << axis;
        }
        keys[i] = (uint64_t)code << 32 | i;
    }
    qsort(keys, count, sizeof *keys, compare);
    for (uint32_t i = 0; i < count; i++)
        order[i] = (uint32_t)keys[i];
    free(keys);
    *out_count = (uint32_t)count;
    return order;
fail:
    free(keys);
    free(order);
    return NULL;
}

static double surface(const struct gn_geometry_contents *contents, const uint32_t *order, uint32_t count)
{
    double sum = 0;
    for (uint32_t start = 0; start < count; start += GROUP) {
        struct box around = nothing, box;
        for (uint32_t i = start; i < count && i < start + GROUP; i++)
            if (box_of(contents, order[i], &box)) {
                include(&around, box.min);
                include(&around, box.max);
            }
        double sides[3];
        for (int axis = 0; axis < 3; axis++)
            sides[axis] = around.max[axis] > around.min[axis] ? (double)around.max[axis] - (double)around.min[axis] : 0;
        sum += sides[0] * sides[1] + sides[1] * sides[2] + sides[2] * sides[0];
    }
    return sum;
}

double gn_spread_growth(const struct gn_geometry_contents *contents, const uint32_t *order, uint32_t count)
{
    uint32_t now_count = 0;
    uint32_t *now = primitives(contents) == count ? gn_spread_order(contents, &now_count) : NULL;
    double best = now ? surface(contents, now, count) : 0;
    double growth = best > 0 ? surface(contents, order, count) / best : 0;
    free(now);
    return growth;
}
