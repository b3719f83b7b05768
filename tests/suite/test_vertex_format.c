/* SPDX-License-Identifier: Apache-2.0 */
/* Vertex formats against exact values that are found another way. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "cts/device.h"
#include "cts/random.h"
#include "cts/vertex_format.h"

/* The compiler's own conversions, which are IEEE's. */
__extension__ typedef _Float16 half;

static uint16_t half_bits(half value)
{
    uint16_t bits = 0;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

static double half_value(uint16_t bits)
{
    half value = 0;
    memcpy(&value, &bits, sizeof bits);
    return (double)value;
}

static void every_half_decodes_and_comes_back(void **state)
{
    (void)state;
    for (uint32_t bits = 0; bits < 65536; bits++) {
        const double value = gn_f64_from_f16((uint16_t)bits);
        const double expected = half_value((uint16_t)bits);
        if (isnan(expected)) {
            assert_true(isnan(value));
            assert_true(isnan(half_value(gn_f16_from_f64(value))));
            continue;
        }
        assert_true(value == expected && signbit(value) == signbit(expected));
        assert_int_equal(gn_f16_from_f64(value), bits);
    }
}

/* Half way between two neighbours the even one wins; one f64 step to either side decides otherwise. */
static void halves_round_to_nearest_even(void **state)
{
    (void)state;
    for (uint32_t bits = 0; bits < 0x7C00; bits++) {
        const double low = half_value((uint16_t)bits);
        const double high = bits == 0x7BFF ? 65536.0 : half_value((uint16_t)(bits + 1));
        const double middle = (low + high) / 2;
        const uint16_t even = (uint16_t)(bits & 1 ? bits + 1 : bits);
        assert_int_equal(gn_f16_from_f64(middle), even);
        assert_int_equal(gn_f16_from_f64(nextafter(middle, 0.0)), bits);
        assert_int_equal(gn_f16_from_f64(nextafter(middle, INFINITY)), bits + 1);
        assert_int_equal(gn_f16_from_f64(-middle), even | 0x8000);
    }
    struct gn_random random = {7};
    for (uint32_t i = 0; i < 200000; i++) {
        const double value = ldexp(gn_random_range(&random, -2.0, 2.0), (int)gn_random_below(&random, 48) - 30);
        assert_int_equal(gn_f16_from_f64(value), half_bits((half)value));
    }
}

/* All integers of a normalised format, in the place of each component. */
static void every_normalised_integer_comes_back(void **state)
{
    (void)state;
    for (size_t f = 0; f < gn_vertex_format_count; f++) {
        const struct gn_vertex_format *format = &gn_vertex_formats[f];
        if (format->kind == GN_VERTEX_FLOAT) {
            continue;
        }
        const bool is_signed = format->kind == GN_VERTEX_SNORM;
        const int64_t span = (int64_t)1 << format->component_bits;
        const int64_t lowest = is_signed ? -span / 2 : 0;
        const int64_t highest = is_signed ? span / 2 - 1 : span - 1;
        assert_true(format->divisor == (double)highest);
        for (int64_t integer = lowest; integer <= highest; integer++) {
            const double wish = (double)integer / (double)highest;
            const double position[3] = {wish, -wish, wish};
            uint8_t bytes[32];
            double decoded[3];
            gn_vertex_encode(format, position, bytes);
            gn_vertex_decode(format, bytes, decoded);
            /* The lowest two integers of SNORM mean the same. */
            const double meant = is_signed && integer == lowest ? (double)(lowest + 1) : (double)integer;
            assert_true(decoded[0] == meant);
            if (format->component_bits == 16) {
                uint16_t raw = 0;
                memcpy(&raw, bytes, 2);
                assert_int_equal(raw, (uint16_t)integer); /* the lowest one is really written */
            }
            if (is_signed && integer != lowest) {
                assert_true(decoded[1] == (double)-integer);
            }
            if (!is_signed) {
                assert_true(decoded[1] == 0.0);
            }
            assert_true(decoded[2] == (format->components < 3 ? 0.0 : meant));
        }
    }
}

struct exact {
    VkFormat format;
    double position[3];
    uint8_t bytes[32];
    double decoded[3];
    const char *why;
};

/* Bytes worked out by hand. */
static const struct exact exacts[] = {
    {VK_FORMAT_R32G32B32_SFLOAT, {1, -2, 0.1}, {0, 0, 0x80, 0x3F, 0, 0, 0, 0xC0, 0xCD, 0xCC, 0xCC, 0x3D},
     {1, -2, 0x1.99999Ap-4}, "0.1 is rounded up to f32"},
    {VK_FORMAT_UNDEFINED, {1, -2, 0}, {0, 0, 0x80, 0x3F, 0, 0, 0, 0xC0}, {1, -2, 0}, "the plain choice"},
    {VK_FORMAT_R32G32_SFLOAT, {1, -2, 5}, {0, 0, 0x80, 0x3F, 0, 0, 0, 0xC0}, {1, -2, 0}, "no z"},
    {VK_FORMAT_R16G16B16A16_SFLOAT, {1, -2, 0x1p-24}, {0, 0x3C, 0, 0xC0, 1, 0, 0, 0x3C}, {1, -2, 0x1p-24},
     "the smallest subnormal; the fourth is 1"},
    {VK_FORMAT_R16G16_SFLOAT, {65520, -0.0, 9}, {0, 0x7C, 0, 0x80}, {INFINITY, -0.0, 0}, "overflow; minus zero"},
    {VK_FORMAT_R16G16B16A16_SNORM, {-1, 1, 0.5}, {0x01, 0x80, 0xFF, 0x7F, 0x00, 0x40, 0xFF, 0x7F}, {-32767, 32767, 16384},
     "16383.5 is a tie: even"},
    {VK_FORMAT_R16G16_SNORM, {-7, 7, 1}, {0x00, 0x80, 0xFF, 0x7F}, {-32767, 32767, 0}, "clamped; -32768 means -1"},
    {VK_FORMAT_R8G8B8A8_SNORM, {-1, -128.0 / 127, 0.1}, {0x81, 0x80, 0x0D, 0x7F}, {-127, -127, 13}, "12.7 is 13"},
    {VK_FORMAT_R16G16B16A16_UNORM, {1, -1, 0.5}, {0xFF, 0xFF, 0, 0, 0x00, 0x80, 0xFF, 0xFF}, {65535, 0, 32768},
     "32767.5 is a tie: even"},
    {VK_FORMAT_A2B10G10R10_SNORM_PACK32, {1, -1, 0}, {0xFF, 0x05, 0x08, 0x40}, {511, -511, 0}, "ten bits each"},
    {VK_FORMAT_R64G64B64_SFLOAT, {0.1, 0, 1},
     {0x9A, 0x99, 0x99, 0x99, 0x99, 0x99, 0xB9, 0x3F, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xF0, 0x3F}, {0.1, 0, 1},
     "kept as it is"},
};

static void bytes_are_those_worked_out_by_hand(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof exacts / sizeof exacts[0]; i++) {
        const struct exact *exact = &exacts[i];
        const struct gn_vertex_format *format = gn_vertex_format_find(exact->format);
        uint8_t bytes[32] = {0};
        double decoded[3];
        assert_non_null(format);
        gn_vertex_encode(format, exact->position, bytes);
        gn_vertex_decode(format, bytes, decoded);
        if (memcmp(bytes, exact->bytes, format->size) != 0 || memcmp(decoded, exact->decoded, sizeof decoded) != 0) {
            print_error("%s: %s\n", format->name, exact->why);
            assert_memory_equal(bytes, exact->bytes, format->size);
            assert_memory_equal(decoded, exact->decoded, sizeof decoded);
        }
    }
}

static void a_nan_stays_one_where_the_format_has_it(void **state)
{
    (void)state;
    const double position[3] = {NAN, 0.5, 0.25};
    for (size_t f = 0; f < gn_vertex_format_count; f++) {
        const struct gn_vertex_format *format = &gn_vertex_formats[f];
        uint8_t bytes[32];
        double decoded[3];
        gn_vertex_encode(format, position, bytes);
        gn_vertex_decode(format, bytes, decoded);
        if (format->kind == GN_VERTEX_FLOAT) {
            assert_true(isnan(decoded[0]));
            assert_true(decoded[1] == 0.5);
        } else {
            assert_true(decoded[0] == 0.0);
        }
    }
}

/* A product that rounds to a tie in f64 although it is none: the side it lies on decides. */
static void near_ties_are_decided_exactly(void **state)
{
    (void)state;
    const struct gn_vertex_format *format = gn_vertex_format_find(VK_FORMAT_R16G16_SNORM);
    uint32_t seen = 0;
    for (int32_t integer = 0; integer < 32767; integer++) {
        /* The f64 neighbours of (integer + 1/2) / 32767; which side each is on follows from their residue. */
        const double near = ((double)integer + 0.5) / 32767.0;
        const double rest = fma(near, 32767.0, -((double)integer + 0.5));
        const double position[3] = {near, 0, 0};
        uint8_t bytes[4];
        double decoded[3];
        gn_vertex_encode(format, position, bytes);
        gn_vertex_decode(format, bytes, decoded);
        const double expected = rest > 0 ? integer + 1 : rest < 0 ? integer : integer & 1 ? integer + 1 : integer;
        assert_true(decoded[0] == expected);
        seen += rest != 0;
    }
    assert_true(seen > 30000);
}

static void a_geometry_tells_what_the_device_gets(void **state)
{
    (void)state;
    const double positions[2][3] = {{1, -1, 0.1}, {NAN, 0, -0.5}};
    struct gn_cts_geometry geometry = {.positions = positions, .position_count = 2};
    struct gn_arena arena = {0};
    const double(*decoded)[3] = NULL;
    double divisor = 0;
    assert_true(gn_geometry_decoded_positions(&geometry, &arena, &decoded, &divisor));
    assert_true(divisor == 1.0 && decoded[0][2] == (double)0.1f && isnan(decoded[1][0]));
    geometry.vertex_format = VK_FORMAT_R16G16B16A16_SNORM;
    assert_true(gn_geometry_decoded_positions(&geometry, &arena, &decoded, &divisor));
    assert_true(divisor == 32767.0 && decoded[0][1] == -32767.0 && decoded[0][2] == 3277.0 && decoded[1][0] == 0.0);
    geometry.vertex_format = VK_FORMAT_R8G8B8A8_SRGB;
    assert_false(gn_geometry_decoded_positions(&geometry, &arena, &decoded, &divisor));
    gn_arena_finish(&arena);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_half_decodes_and_comes_back),
        cmocka_unit_test(halves_round_to_nearest_even),
        cmocka_unit_test(every_normalised_integer_comes_back),
        cmocka_unit_test(bytes_are_those_worked_out_by_hand),
        cmocka_unit_test(a_nan_stays_one_where_the_format_has_it),
        cmocka_unit_test(near_ties_are_decided_exactly),
        cmocka_unit_test(a_geometry_tells_what_the_device_gets),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
