/* SPDX-License-Identifier: Apache-2.0 */
/* Rays and answers in words. */
#include "cts/describe.h"

#include <stdio.h>
#include <string.h>

const char *gn_describe_ray_flags(uint32_t flags, char *out, size_t size)
{
    static const struct {
        uint32_t bit;
        const char *words;
    } names[] = {{GN_REF_RAY_OPAQUE, "opaque"},
                 {GN_REF_RAY_NO_OPAQUE, "no opaque"},
                 {GN_REF_RAY_TERMINATE_ON_FIRST_HIT, "terminate on first hit"},
                 {GN_REF_RAY_SKIP_CLOSEST_HIT_SHADER, "skip closest hit shader"},
                 {GN_REF_RAY_CULL_BACK_FACING, "cull back facing"},
                 {GN_REF_RAY_CULL_FRONT_FACING, "cull front facing"},
                 {GN_REF_RAY_CULL_OPAQUE, "cull opaque"},
                 {GN_REF_RAY_CULL_NO_OPAQUE, "cull no opaque"},
                 {GN_REF_RAY_SKIP_TRIANGLES, "skip triangles"},
                 {GN_REF_RAY_SKIP_AABBS, "skip AABBs"}};
    size_t used = 0;
    snprintf(out, size, "none");
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (flags & names[i].bit && used < size)
            used += (size_t)snprintf(out + used, size - used, "%s%s", used ? ", " : "", names[i].words);
    return out;
}

const char *gn_describe_answer(const struct gn_ref_answer *answer, char *out, size_t size)
{
    if (answer->kind == GN_REF_ANSWER_NONE)
        snprintf(out, size, "a miss");
    else if (answer->kind == GN_REF_ANSWER_TRIANGLE)
        snprintf(out, size,
                 "triangle %u of geometry %u, instance %u (custom index 0x%X, SBT offset 0x%X), %s, t = %.9g "
                 "(%a), "
                 "barycentrics %.9g, %.9g",
                 answer->primitive, answer->geometry, answer->instance, answer->custom_index,
                 answer->sbt_offset, answer->front ? "front" : "back", (double)answer->t, (double)answer->t,
                 (double)answer->barycentrics[0], (double)answer->barycentrics[1]);
    else
        snprintf(
            out, size,
            "a hit generated for AABB %u of geometry %u, instance %u (custom index 0x%X, SBT offset 0x%X), "
            "t = %.9g (%a)",
            answer->primitive, answer->geometry, answer->instance, answer->custom_index, answer->sbt_offset,
            (double)answer->t, (double)answer->t);
    return out;
}

const char *gn_describe_ideal(const struct gn_ref_verdict *verdict, char *out, size_t size)
{
    const struct gn_ref_hit *ideal = &verdict->ideal;
    if (!verdict->ideal_hit)
        snprintf(out, size, "a miss");
    else if (ideal->type == GN_REF_TRIANGLES)
        snprintf(out, size,
                 "triangle %u of geometry %u, instance %u, %s, t = %.17g, barycentrics %.12g, %.12g",
                 ideal->primitive, ideal->geometry, ideal->instance, ideal->front ? "front" : "back",
                 ideal->t, ideal->beta, ideal->gamma);
    else
        snprintf(out, size, "AABB %u of geometry %u, instance %u, t = %.17g", ideal->primitive,
                 ideal->geometry, ideal->instance, ideal->t);
    return out;
}

static void row_text(struct gn_answer_row *row, bool hit, const char *answer, bool ideal_hit,
                     const char *ideal)
{
    snprintf(row->answer, sizeof row->answer, "%s", hit ? answer : "-");
    snprintf(row->ideal, sizeof row->ideal, "%s", ideal_hit ? ideal : "-");
}

static void row_number(struct gn_answer_row *row, bool hit, uint32_t answer, bool ideal_hit, uint32_t ideal)
{
    char a[16], b[16];
    snprintf(a, sizeof a, "%u", answer);
    snprintf(b, sizeof b, "%u", ideal);
    row_text(row, hit, a, ideal_hit, b);
    row->differs = hit && ideal_hit && answer != ideal;
}

size_t gn_describe_rows(const struct gn_ref_verdict *verdict, const struct gn_ref_answer *answer,
                        struct gn_answer_row out[GN_ANSWER_ROWS])
{
    const struct gn_ref_hit *ideal = &verdict->ideal;
    bool hit = answer->kind != GN_REF_ANSWER_NONE, ideal_hit = verdict->ideal_hit;
    bool triangle = answer->kind == GN_REF_ANSWER_TRIANGLE, ideal_triangle = ideal->type == GN_REF_TRIANGLES;
    char a[48], b[48];
    memset(out, 0, GN_ANSWER_ROWS * sizeof *out);
    out[0].label = "result";
    row_text(&out[0], true,
             !hit       ? "miss"
             : triangle ? "hit on a triangle"
                        : "hit generated for an AABB",
             true,
             !ideal_hit       ? "miss"
             : ideal_triangle ? "hit on a triangle"
                              : "hit in an AABB");
    out[0].differs = hit != ideal_hit || (hit && triangle != ideal_triangle);
    if (!hit && !ideal_hit)
        return 1;
    out[1].label = "instance";
    row_number(&out[1], hit, answer->instance, ideal_hit, ideal->instance);
    out[2].label = "geometry";
    row_number(&out[2], hit, answer->geometry, ideal_hit, ideal->geometry);
    out[3].label = "primitive";
    row_number(&out[3], hit, answer->primitive, ideal_hit, ideal->primitive);
    out[4].label = "t";
    snprintf(a, sizeof a, "%.9g", (double)answer->t);
    snprintf(b, sizeof b, "%.12g", ideal->t);
    row_text(&out[4], hit, a, ideal_hit, b);
    if (!(hit && triangle) && !(ideal_hit && ideal_triangle))
        return 5;
    out[5].label = "facing";
    row_text(&out[5], hit && triangle, answer->front ? "front" : "back", ideal_hit && ideal_triangle,
             ideal->front ? "front" : "back");
    out[5].differs = hit && ideal_hit && triangle && ideal_triangle && (answer->front != 0) != ideal->front;
    out[6].label = "barycentric of vertex 1";
    snprintf(a, sizeof a, "%.9g", (double)answer->barycentrics[0]);
    snprintf(b, sizeof b, "%.12g", ideal->beta);
    row_text(&out[6], hit && triangle, a, ideal_hit && ideal_triangle, b);
    out[7].label = "barycentric of vertex 2";
    snprintf(a, sizeof a, "%.9g", (double)answer->barycentrics[1]);
    snprintf(b, sizeof b, "%.12g", ideal->gamma);
    row_text(&out[7], hit && triangle, a, ideal_hit && ideal_triangle, b);
    return 8;
}

const char *gn_format_grouped(uint64_t value, char out[32])
{
    char digits[24];
    int length = snprintf(digits, sizeof digits, "%llu", (unsigned long long)value), used = 0;
    for (int i = 0; i < length; i++) {
        if (i && (length - i) % 3 == 0)
            out[used++] = ',';
        out[used++] = digits[i];
    }
    out[used] = 0;
    return out;
}
