/* SPDX-License-Identifier: Apache-2.0 */
//! why: what is committed may be a triangle or generated
//! clauses: NG-062
//! run: choice=1 -> committed.not_triangle*8
//! twin: facing_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, CHOSEN ? gl_RayFlagsSkipTrianglesEXT : gl_RayFlagsOpaqueEXT);
    while (rayQueryProceedEXT(q))
        if (CANDIDATE(q) == AT_BOX)
            rayQueryGenerateIntersectionEXT(q, rayQueryGetRayTMinEXT(q) + (CHOSEN ? 2.5 : 0.5)); //~ generate.range?
    float sum = 0;
    if (TYPE(q) != NOTHING)
        sum = rayQueryGetIntersectionBarycentricsEXT(q, true).x; //~ committed.not_triangle?
    SHOW(sum);
}
