/* SPDX-License-Identifier: Apache-2.0 */
/* The any-hit shader: writes candidates down, or confirms them as the ray's policy says. */
#include "candidate.glsl"
#include "detail_hit.glsl"
#ifdef FETCH_POSITIONS
#include "positions.glsl"
#endif

layout(location = 0) rayPayloadInEXT Payload payload;
hitAttributeEXT vec2 left_behind;

void main()
{
    /* It stays, whatever becomes of the candidate. */
    payload.any_hits++;
    if (program == CANDIDATES) {
        Answer answer = answer_here();
        answer.kind = TRIANGLE;
        answer.front = gl_HitKindEXT == gl_HitKindFrontFacingTriangleEXT ? 1 : 0;
        answer.t = gl_HitTEXT;
        answer.beta = left_behind.x;
        answer.gamma = left_behind.y;
        present(answer);
        ignoreIntersectionEXT;
    }
    const uint index = ray_index();
    const Ray ray = rays[index];
    const bool triangle = gl_HitKindEXT >= gl_HitKindFrontFacingTriangleEXT;
    const uint wanted = triangle               ? ray.confirm_mask
                        : way(OPAQUE_BOXES)    ? 0u /* it is not run for what is opaque */
                        : way(ANY_HIT_REFUSES) ? ray.generate_mask
                                               : ~0u;
    if ((wanted >> (gl_PrimitiveID & 31) & 1) == 0) {
        ignoreIntersectionEXT;
    }
    /* Rays of such traces end at their first hit, so that only one shader writes. */
    if (way(FROM_CANDIDATE) && triangle) {
        if (program == DETAIL) {
            detail_hit(index);
        }
#ifdef FETCH_POSITIONS
        positions_write(index, true);
#endif
    }
    if (way(TERMINATE | ANY_HIT_ENDS)) {
        payload.ended++;
        terminateRayEXT;
    }
}
