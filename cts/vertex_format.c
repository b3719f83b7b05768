/* SPDX-License-Identifier: Apache-2.0 */
/* Encodes positions for the device and tells the reference exactly what was encoded. */
#include "cts/vertex_format.h"

#include <math.h>
#include <string.h>

#include "cts/device.h"

#define FLOATS(name, components, bits) \
    {VK_FORMAT_##name, #name, GN_VERTEX_FLOAT, components, bits, components * bits / 8, bits / 8, 1.0}
#define SNORM(name, components, bits) \
    {VK_FORMAT_##name, #name, GN_VERTEX_SNORM, components, bits, components * bits / 8, bits / 8, \
     (double)((1 << (bits - 1)) - 1)}
#define UNORM(name, components, bits) \
    {VK_FORMAT_##name, #name, GN_VERTEX_UNORM, components, bits, components * bits / 8, bits / 8, \
     (double)((1 << bits) - 1)}

/* The six that every implementation has to take come first. */
const struct gn_vertex_format gn_vertex_formats[] = {
    FLOATS(R32G32B32_SFLOAT, 3, 32),
    FLOATS(R32G32_SFLOAT, 2, 32),
    FLOATS(R16G16B16A16_SFLOAT, 4, 16),
    FLOATS(R16G16_SFLOAT, 2, 16),
    SNORM(R16G16B16A16_SNORM, 4, 16),
    SNORM(R16G16_SNORM, 2, 16),
    FLOATS(R32G32B32A32_SFLOAT, 4, 32),
    FLOATS(R16G16B16_SFLOAT, 3, 16),
    FLOATS(R64G64_SFLOAT, 2, 64),
    FLOATS(R64G64B64_SFLOAT, 3, 64),
    FLOATS(R64G64B64A64_SFLOAT, 4, 64),
    SNORM(R16G16B16_SNORM, 3, 16),
    SNORM(R8G8_SNORM, 2, 8),
    SNORM(R8G8B8_SNORM, 3, 8),
    SNORM(R8G8B8A8_SNORM, 4, 8),
    UNORM(R16G16_UNORM, 2, 16),
    UNORM(R16G16B16_UNORM, 3, 16),
    UNORM(R16G16B16A16_UNORM, 4, 16),
    UNORM(R8G8_UNORM, 2, 8),
    UNORM(R8G8B8_UNORM, 3, 8),
    UNORM(R8G8B8A8_UNORM, 4, 8),
    {VK_FORMAT_A2B10G10R10_SNORM_PACK32, "A2B10G10R10_SNORM_PACK32", GN_VERTEX_SNORM, 4, 10, 4, 4, 511.0},
    {VK_FORMAT_A2B10G10R10_UNORM_PACK32, "A2B10G10R10_UNORM_PACK32", GN_VERTEX_UNORM, 4, 10, 4, 4, 1023.0},
};
const size_t gn_vertex_format_count = sizeof gn_vertex_formats / sizeof gn_vertex_formats[0];

const struct gn_vertex_format *gn_vertex_format_find(VkFormat format)
{
    if (format == VK_FORMAT_UNDEFINED) {
        return &gn_vertex_formats[0];
    }
    for (size_t i = 0; i < gn_vertex_format_count; i++) {
        if (gn_vertex_formats[i].format == format) {
            return &gn_vertex_formats[i];
        }
    }
    return NULL;
}

uint16_t gn_f16_from_f64(double value)
{
    const uint16_t sign = signbit(value) ? 0x8000 : 0;
    if (isnan(value)) {
        return sign | 0x7E00;
    }
    const double magnitude = fabs(value);
    if (magnitude == 0.0) {
        return sign;
    }
    if (magnitude >= 65520.0) { /* half way between the largest finite number and the next power of two */
        return sign | 0x7C00;
    }
    int exponent = 0;
    frexp(magnitude, &exponent);
    /* The spacing of f16 there: 2^(exponent - 11), but never below 2^-24. The division is exact. */
    const int spacing = exponent - 11 < -24 ? -24 : exponent - 11;
    const uint16_t steps = (uint16_t)nearbyint(ldexp(magnitude, -spacing));
    /* steps is at most 2048: a carry out of the fraction moves the exponent field on by itself. */
    return (uint16_t)(sign | (((spacing + 24) << 10) + steps));
}

double gn_f64_from_f16(uint16_t bits)
{
    const int exponent = (bits >> 10) & 31;
    const int fraction = bits & 1023;
    double magnitude = 0.0;
    if (exponent == 31) {
        magnitude = fraction ? (double)NAN : (double)INFINITY;
    } else if (exponent == 0) {
        magnitude = ldexp(fraction, -24);
    } else {
        magnitude = ldexp(1024 + fraction, exponent - 25);
    }
    return bits & 0x8000 ? -magnitude : magnitude;
}

/* value * scale rounded to the nearest integer, ties to even, as if the product were not rounded before. */
static double scale_to_integer(double value, double scale)
{
    const double product = value * scale;
    const double rest = fma(value, scale, -product);
    const double rounded = nearbyint(product);
    if (fabs(product - rounded) == 0.5 && rest != 0.0) {
        /* A tie only because the product was rounded: the rest says on which side it lies. */
        return rest > 0.0 ? ceil(product) : floor(product);
    }
    return rounded;
}

static int32_t normalised_from(const struct gn_vertex_format *format, double value)
{
    if (isnan(value)) {
        return 0;
    }
    const double highest = format->divisor;
    const double lowest = format->kind == GN_VERTEX_SNORM ? -highest - 1.0 : 0.0;
    /* Clamped before the product, too: it would overflow. */
    const double near = value > 2.0 ? 2.0 : value < -2.0 ? -2.0 : value;
    const double integer = scale_to_integer(near, highest);
    return (int32_t)(integer > highest ? highest : integer < lowest ? lowest : integer);
}

static bool is_packed(const struct gn_vertex_format *format)
{
    return format->component_bits == 10;
}

void gn_vertex_encode(const struct gn_vertex_format *format, const double position[3], uint8_t *out_bytes)
{
    if (is_packed(format)) {
        uint32_t word = (format->kind == GN_VERTEX_SNORM ? 1u : 3u) << 30; /* 1, as below */
        for (uint32_t i = 0; i < 3; i++) {
            word |= ((uint32_t)normalised_from(format, position[i]) & 1023u) << (10 * i);
        }
        memcpy(out_bytes, &word, sizeof word);
        return;
    }
    const uint32_t bytes = format->component_bits / 8;
    for (uint32_t i = 0; i < format->components; i++) {
        uint8_t *out = out_bytes + i * bytes;
        /*
         * A fourth component is 1. A NaN in any component but the first is undefined behaviour, and the API does
         * not say in words that a fourth one has no influence: 1 means the same to whoever multiplies by it.
         */
        const double value = i < 3 ? position[i] : 1.0;
        if (format->kind != GN_VERTEX_FLOAT) {
            const uint32_t integer = (uint32_t)normalised_from(format, value);
            out[0] = (uint8_t)integer;
            if (bytes == 2) {
                out[1] = (uint8_t)(integer >> 8);
            }
        } else if (bytes == 8) {
            memcpy(out, &value, 8);
        } else if (bytes == 4) {
            const float single = (float)value;
            memcpy(out, &single, 4);
        } else {
            const uint16_t half = gn_f16_from_f64(value);
            memcpy(out, &half, 2);
        }
    }
}

/* An integer of `bits` bits, sign-extended for SNORM, whose lowest value means the same as the next one. */
static double integer_decode(const struct gn_vertex_format *format, uint32_t raw)
{
    if (format->kind == GN_VERTEX_UNORM) {
        return raw;
    }
    const uint32_t sign = 1u << (format->component_bits - 1);
    const double value = (double)(int32_t)(raw & (sign - 1)) - (double)(raw & sign);
    return value < -format->divisor ? -format->divisor : value;
}

void gn_vertex_decode(const struct gn_vertex_format *format, const uint8_t *bytes, double out_position[3])
{
    out_position[0] = out_position[1] = out_position[2] = 0.0;
    if (is_packed(format)) {
        uint32_t word = 0;
        memcpy(&word, bytes, sizeof word);
        for (uint32_t i = 0; i < 3; i++) {
            out_position[i] = integer_decode(format, (word >> (10 * i)) & 1023u);
        }
        return;
    }
    const uint32_t step = format->component_bits / 8;
    for (uint32_t i = 0; i < format->components && i < 3; i++) {
        const uint8_t *in = bytes + i * step;
        if (format->kind != GN_VERTEX_FLOAT) {
            out_position[i] = integer_decode(format, step == 2 ? in[0] | (uint32_t)in[1] << 8 : in[0]);
        } else if (step == 8) {
            memcpy(&out_position[i], in, 8);
        } else if (step == 4) {
            float value = 0.0f;
            memcpy(&value, in, 4);
            out_position[i] = value;
        } else {
            uint16_t half = 0;
            memcpy(&half, in, 2);
            out_position[i] = gn_f64_from_f16(half);
        }
    }
}

bool gn_geometry_decoded_positions(const struct gn_cts_geometry *geometry, struct gn_arena *arena,
                                   const double (**out_positions)[3], double *out_divisor)
{
    const struct gn_vertex_format *format = gn_vertex_format_find(geometry->vertex_format);
    if (!format) {
        return false;
    }
    double(*positions)[3] = gn_arena_alloc(arena, geometry->position_count, sizeof *positions);
    for (uint32_t i = 0; i < geometry->position_count; i++) {
        uint8_t bytes[32];
        gn_vertex_encode(format, geometry->positions[i], bytes);
        gn_vertex_decode(format, bytes, positions[i]);
        if (isinf(positions[i][0]) || isinf(positions[i][1]) || isinf(positions[i][2]))
            positions[i][0] = (double)NAN;
    }
    *out_positions = (const double(*)[3])positions;
    *out_divisor = format->divisor;
    return true;
}
