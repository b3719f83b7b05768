/* SPDX-License-Identifier: Apache-2.0 */
/* The closest-hit shader: says what was hit and, as the program asks, more. */
#include "candidate.glsl"
#include "detail_hit.glsl"
#include "recursion.glsl"

hitAttributeEXT vec2 left_behind;

#ifdef FETCH_POSITIONS
#include "positions.glsl"
#endif

void main()
{
    const uint index = ray_index();
    if (recursive && recurse(index)) {
        return;
    }
    Answer answer = answer_here();
    answer.t = gl_HitTEXT;
    const bool triangle = gl_HitKindEXT >= gl_HitKindFrontFacingTriangleEXT;
    if (triangle) {
        answer.kind = TRIANGLE;
        answer.front = gl_HitKindEXT == gl_HitKindFrontFacingTriangleEXT ? 1 : 0;
        answer.beta = left_behind.x;
        answer.gamma = left_behind.y;
    } else {
        /* What the intersection shader left with the hit that it reported, not with one that it reported later. */
        answer.kind = gl_HitKindEXT != (gl_PrimitiveID & 127)                                ? HIT_KIND
                      : left_behind.x != float(gl_PrimitiveID) || left_behind.y != gl_HitTEXT ? ATTRIBUTE
                                                                                             : GENERATED;
    }
    payload.answer = answer;
    /* An any-hit or intersection shader may have done it already. */
    if (program == DETAIL && !way(FROM_CANDIDATE)) {
        detail_hit(index);
    }
#ifdef FETCH_POSITIONS
    if (!way(FROM_CANDIDATE)) {
        positions_write(index, triangle);
    }
#endif
}
