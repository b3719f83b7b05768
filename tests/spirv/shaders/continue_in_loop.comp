/* SPDX-License-Identifier: Apache-2.0 */
//! why: a continue passes over boxes
//! clauses: NG-041
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    uint n = 0;
    while (rayQueryProceedEXT(q)) {
        if (CANDIDATE(q) != AT_TRIANGLE)
            continue;
        n += rayQueryGetIntersectionFrontFaceEXT(q, false) ? 1 : 2;
        rayQueryConfirmIntersectionEXT(q);
    }
    SHOW(n);
}
