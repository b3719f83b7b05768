/* SPDX-License-Identifier: Apache-2.0 */
//! why: the branch says that the candidate is a box
//! clauses: NG-062
//! run: -> candidate.not_triangle*8
//! twin: barycentrics_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    float x = 0;
    while (rayQueryProceedEXT(q)) {
        if (rayQueryGetIntersectionTypeEXT(q, false) == gl_RayQueryCandidateIntersectionAABBEXT)
            x += rayQueryGetIntersectionBarycentricsEXT(q, false).x; //~ candidate.not_triangle!
    }
    SHOW(x);
}
