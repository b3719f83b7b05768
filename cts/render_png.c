/* SPDX-License-Identifier: Apache-2.0 */
/* Rendered pictures, and heat maps of how far two are apart, as PNGs that a page can hold. */
#include <math.h>
#include <stdlib.h>

#include <png.h>

#include "cts/render.h"
#include "cts/report_html_parts.h"

static uint8_t byte_of(double value)
{
    return value <= 0 ? 0 : value >= 1 ? 255 : (uint8_t)lround(255 * value);
}

/* sRGB's curve, after what is brighter than the screen has been bent down. */
static uint8_t shown(double light)
{
    const double bent = light < 0 ? 0 : light / (1 + 0.25 * light);
    return byte_of(bent <= 0.0031308 ? 12.92 * bent : 1.055 * pow(bent, 1 / 2.4) - 0.055);
}

/* Black, red, yellow, white. */
static void heat(double share, uint8_t out[3])
{
    out[0] = byte_of(3 * share);
    out[1] = byte_of(3 * share - 1);
    out[2] = byte_of(3 * share - 2);
}

const char *gn_render_png(struct gn_arena *arena, const struct gn_render_result *of, const struct gn_render_result *other,
                          uint32_t width, uint32_t height)
{
    const uint32_t count = width * height;
    png_image image = {.version = PNG_IMAGE_VERSION, .width = width, .height = height, .format = PNG_FORMAT_RGB};
    uint8_t *bytes = malloc(3 * (size_t)count), *png = NULL;
    png_alloc_size_t size = 0;
    char *text = NULL;
    if (!bytes)
        return NULL;
    for (uint32_t i = 0; i < count; i++) {
        double most = 0;
        for (int c = 0; c < 3; c++) {
            bytes[3 * i + c] = shown((double)of->pixels[i][c]);
            if (other)
                most = fmax(most, fabs((double)of->pixels[i][c] - (double)other->pixels[i][c]));
        }
        if (other)
            heat(most / GN_RENDER_HEAT_FULL, &bytes[3 * i]);
    }
    if (png_image_write_to_memory(&image, NULL, &size, 0, bytes, 0, NULL) && (png = malloc(size)) != NULL &&
        png_image_write_to_memory(&image, png, &size, 0, bytes, 0, NULL)) {
        text = gn_arena_alloc(arena, gn_base64_length(size) + 1, 1);
        gn_base64(png, size, text);
    }
    free(png);
    free(bytes);
    return text;
}
