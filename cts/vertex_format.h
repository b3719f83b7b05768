/* SPDX-License-Identifier: Apache-2.0 */
/* Vertex formats: what a position becomes in a vertex buffer, and what exactly that means. */
#ifndef GNOMON_CTS_VERTEX_FORMAT_H
#define GNOMON_CTS_VERTEX_FORMAT_H

#include <stddef.h>
#include <stdint.h>
#include <vulkan/vulkan_core.h>

enum gn_vertex_kind {
    GN_VERTEX_FLOAT,
    GN_VERTEX_SNORM,
    GN_VERTEX_UNORM,
};

struct gn_vertex_format {
    VkFormat format;
    const char *name; /* "R32G32B32_SFLOAT" */
    enum gn_vertex_kind kind;
    uint32_t components; /* 2 to 4; the fourth is not used, a missing third is 0 */
    uint32_t component_bits;
    uint32_t size; /* bytes of one vertex */
    uint32_t alignment; /* bytes: of addresses, offsets and strides */
    double divisor; /* a decoded number over this is the coordinate */
};

extern const struct gn_vertex_format gn_vertex_formats[];
extern const size_t gn_vertex_format_count;

/* VK_FORMAT_UNDEFINED stands for R32G32B32_SFLOAT. NULL when the format is not known here. */
const struct gn_vertex_format *gn_vertex_format_find(VkFormat format);

/*
 * Writes one vertex of format->size bytes. Rounds to nearest, ties to even. A NaN stays one where the format
 * has it and becomes 0 elsewhere. Normalised formats clamp; SNORM reaches down to the most negative integer
 * (a wish of -32768/32767 or less gives -32768), which means -1 just as the next one does. A fourth component
 * is 1.
 */
void gn_vertex_encode(const struct gn_vertex_format *format, const double position[3], uint8_t *out_bytes);

/* Exactly what the bytes mean, times format->divisor. */
void gn_vertex_decode(const struct gn_vertex_format *format, const uint8_t *bytes, double out_position[3]);

/* IEEE binary16. From: rounded to nearest even, overflow to infinity. */
uint16_t gn_f16_from_f64(double value);
double gn_f64_from_f16(uint16_t bits);

#endif
