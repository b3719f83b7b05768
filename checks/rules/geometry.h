/* SPDX-License-Identifier: Apache-2.0 */
/* What a BLAS build reads from memory, and one pass over it for all rules about its contents. */
#ifndef GN_CHECKS_RULES_GEOMETRY_H
#define GN_CHECKS_RULES_GEOMETRY_H

#include <stdbool.h>
#include <stdint.h>

#include "checks/rules/survey.h"
#include "checks/rules/values.h"

#ifdef __cplusplus
extern "C" {
#endif

/* One geometry as the build found it: triangles, or boxes. Arrays need no alignment. */
struct gn_geometry_contents {
    const char *place;
    struct gn_object target;
    uint64_t target_id;
    uint32_t info, geometry;
    bool partial; /* the build reads more than is here */

    const unsigned char *indices; /* NULL: without indices, vertices are taken in order */
    uint32_t index_size;          /* 1, 2 or 4 */
    uint64_t index_count;         /* without indices: how many vertices are taken */
    uint32_t max_vertex;
    /* Vertex 0 is the one that index 0 stands for. */
    const unsigned char *vertices; /* NULL: not here */
    uint64_t vertex_stride, vertex_count;
    uint64_t vertices_in_buffer;   /* so many lie in the buffer as a whole; UINT64_MAX: not known */
    uint32_t component_size;       /* of a floating-point component: 2, 4 or 8 */
    uint32_t component_count;      /* coordinates of a vertex; 0: integers, which are always finite */
    const unsigned char *transform; /* 12 floats, NULL: none */

    const unsigned char *boxes; /* six floats each: min, max */
    uint64_t box_stride, box_count;
};

/* Primitives are counted by the first of them. Those that are inactive (the first coordinate of a vertex, or the box's minX, is NaN) are
 * counted nowhere but in index_beyond. */
struct gn_geometry_survey {
    struct gn_survey_class index_above;   /* the index is above max_vertex; `first` counts indices, as in the next one */
    struct gn_survey_class index_outside; /* the vertex does not lie in the buffer */
    uint32_t index_above_value, index_outside_value;
    struct gn_survey_class nan;      /* a coordinate is NaN */
    struct gn_survey_class infinite; /* a coordinate of a triangle is infinite */
    struct gn_survey_class inverted; /* min > max */
    bool bad_transform;              /* the 3x3 part is not finite, or its determinant is exactly 0 */
};

void gn_geometry_survey(const struct gn_geometry_contents *contents, struct gn_geometry_survey *out);

#ifdef __cplusplus
}
#endif
#endif
