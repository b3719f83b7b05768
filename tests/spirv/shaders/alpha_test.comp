/* SPDX-License-Identifier: Apache-2.0 */
//! why: the usual test of transparency
//! clauses: NG-015
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) {
        if (CANDIDATE(q) == AT_TRIANGLE) {
            vec2 at = rayQueryGetIntersectionBarycentricsEXT(q, false);
            if (fract(at.x * 8.0) < 0.5)
                rayQueryConfirmIntersectionEXT(q);
        }
    }
    float t = -1;
    if (TYPE(q) == TRIANGLE)
        t = rayQueryGetIntersectionTEXT(q, true);
    SHOW(t);
}
