/* SPDX-License-Identifier: Apache-2.0 */
//! why: the branch says that the candidate is a triangle
//! clauses: NG-062
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    float sum = 0;
    while (rayQueryProceedEXT(q))
        if (CANDIDATE(q) == AT_TRIANGLE)
            sum += rayQueryGetIntersectionBarycentricsEXT(q, false).x;
    SHOW(sum);
}
