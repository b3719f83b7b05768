/* SPDX-License-Identifier: Apache-2.0 */
/* The picture of a case: one pixel per ray, coloured by its verdict, as a PNG. */
#include "cts/results.h"

#include <png.h>
#include <setjmp.h>
#include <stdlib.h>
#include <string.h>

/* Pictures wider or higher than this are reduced; a pixel then shows the worst of its rays. */
#define MAX_SIDE 768

/* A picture's last row may have fewer rays than it is wide; the rest is this, and transparent. */
#define NO_RAY 0xFF

/* The worse, the darker, so that hue is not needed to tell them apart and a single bad ray shows among good
 * ones; of each pair the darker is where the ray ideally misses. */
uint32_t gn_picture_colour(uint8_t value)
{
    static const uint32_t hit[GN_REF_VERDICT_CLASS_COUNT] = {
        [GN_REF_EXACT] = 0xDDE2E7, [GN_REF_ADMISSIBLE] = 0x7CC4EE, [GN_REF_GAP] = 0xF0E442,
        [GN_REF_LEAK] = 0xE66100,  [GN_REF_DOUBLE_HIT] = 0xB04FB0, [GN_REF_WRONG] = 0x9E0000};
    static const uint32_t miss[GN_REF_VERDICT_CLASS_COUNT] = {
        [GN_REF_EXACT] = 0xAEB8C1, [GN_REF_ADMISSIBLE] = 0x3A97CC, [GN_REF_GAP] = 0xC9BC1E,
        [GN_REF_LEAK] = 0xB34700,  [GN_REF_DOUBLE_HIT] = 0x7E2F80, [GN_REF_WRONG] = 0x4A0000};
    uint8_t cls = value & 0x7F;
    if (cls >= GN_REF_VERDICT_CLASS_COUNT)
        return 0xFF00FF;
    return value & 0x80 ? miss[cls] : hit[cls];
}

struct bytes {
    uint8_t *data;
    size_t length, capacity;
};

static void put_bytes(png_structp png, png_bytep data, size_t length)
{
    struct bytes *out = png_get_io_ptr(png);
    if (length > out->capacity - out->length) {
        size_t capacity = (out->capacity + length) * 2;
        uint8_t *grown = realloc(out->data, capacity);
        if (!grown)
            png_error(png, "out of memory");
        out->data = grown;
        out->capacity = capacity;
    }
    memcpy(out->data + out->length, data, length);
    out->length += length;
}

static void put_nothing(png_structp png)
{
    (void)png;
}

static void ignore_warning(png_structp png, png_const_charp text)
{
    (void)png;
    (void)text;
}

static void give_up(png_structp png, png_const_charp text)
{
    (void)text;
    png_longjmp(png, 1);
}

/* The worst byte of a block; where classes are equal, a hit before a miss. */
static uint8_t worst(const uint8_t *image, uint32_t width, uint32_t height, uint32_t x, uint32_t y,
                     uint32_t step)
{
    uint8_t found = NO_RAY;
    for (uint32_t j = y * step; j < height && j < (y + 1) * step; j++) {
        for (uint32_t i = x * step; i < width && i < (x + 1) * step; i++) {
            uint8_t value = image[(size_t)j * width + i];
            if (value == NO_RAY)
                continue;
            bool worse =
                (value & 0x7F) > (found & 0x7F) || ((value & 0x7F) == (found & 0x7F) && value < found);
            if (found == NO_RAY || worse)
                found = value;
        }
    }
    return found;
}

/* Apart from its caller, whose variables a jump out of libpng must not touch. */
static bool write_png(png_structp png, png_infop info, struct bytes *out, const uint8_t *image,
                      uint32_t width, uint32_t height, uint32_t step, uint8_t *row)
{
    enum { COLOURS = 2 * GN_REF_VERDICT_CLASS_COUNT };
    png_color palette[COLOURS + 1];
    png_byte opacity[COLOURS + 1];
    uint32_t columns = (width + step - 1) / step, rows = (height + step - 1) / step;
    if (setjmp(png_jmpbuf(png)))
        return false;
    png_set_write_fn(png, out, put_bytes, put_nothing);
    png_set_IHDR(png, info, columns, rows, 8, PNG_COLOR_TYPE_PALETTE, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    for (int i = 0; i < COLOURS; i++) {
        int value = i < GN_REF_VERDICT_CLASS_COUNT ? i : 0x80 | (i - GN_REF_VERDICT_CLASS_COUNT);
        uint32_t rgb = gn_picture_colour((uint8_t)value);
        palette[i] = (png_color){(png_byte)(rgb >> 16), (png_byte)(rgb >> 8), (png_byte)rgb};
    }
    palette[COLOURS] = (png_color){0, 0, 0};
    memset(opacity, 0xFF, sizeof opacity);
    opacity[COLOURS] = 0;
    png_set_PLTE(png, info, palette, COLOURS + 1);
    png_set_tRNS(png, info, opacity, COLOURS + 1, NULL);
    png_write_info(png, info);
    for (uint32_t y = 0; y < rows; y++) {
        for (uint32_t x = 0; x < columns; x++) {
            uint8_t value = worst(image, width, height, x, y, step), cls = value & 0x7F;
            if (cls >= GN_REF_VERDICT_CLASS_COUNT)
                cls = GN_REF_WRONG;
            if (value == NO_RAY)
                row[x] = COLOURS;
            else
                row[x] = value & 0x80 ? (uint8_t)(cls + GN_REF_VERDICT_CLASS_COUNT) : cls;
        }
        png_write_row(png, row);
    }
    png_write_end(png, info);
    return true;
}

uint8_t *gn_picture_png(const uint8_t *image, uint32_t width, uint32_t height, size_t *out_length)
{
    struct bytes out = {0};
    uint32_t longest = width > height ? width : height;
    uint32_t step = longest ? (longest + MAX_SIDE - 1) / MAX_SIDE : 1;
    uint8_t *row = malloc((size_t)width / step + 1);
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, give_up, ignore_warning);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    bool ok = row && info && write_png(png, info, &out, image, width, height, step, row);
    if (png)
        png_destroy_write_struct(&png, &info);
    free(row);
    if (!ok) {
        free(out.data);
        return NULL;
    }
    *out_length = out.length;
    return out.data;
}
