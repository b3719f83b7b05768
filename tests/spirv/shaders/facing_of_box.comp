/* SPDX-License-Identifier: Apache-2.0 */
//! why: a box has no facing
//! clauses: NG-063
//! run: -> candidate.not_triangle*8
//! twin: facing_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    float sum = 0;
    while (rayQueryProceedEXT(q))
        if (CANDIDATE(q) != AT_TRIANGLE)
            sum += rayQueryGetIntersectionFrontFaceEXT(q, false) ? 1 : 2; //~ candidate.not_triangle!
    SHOW(sum);
}
