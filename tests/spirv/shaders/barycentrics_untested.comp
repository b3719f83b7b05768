/* SPDX-License-Identifier: Apache-2.0 */
//! why: the candidate may be a box
//! clauses: NG-062
//! run: choice=1 lane=2 -> candidate.not_triangle*1
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    float sum = 0;
    START(q, CHOSEN ? gl_RayFlagsNoneEXT : gl_RayFlagsSkipAABBEXT);
    while (rayQueryProceedEXT(q))
        sum += rayQueryGetIntersectionBarycentricsEXT(q, false).x; //~ candidate.not_triangle?
    SHOW(sum);
}
