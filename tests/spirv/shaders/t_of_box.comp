/* SPDX-License-Identifier: Apache-2.0 */
//! why: a box has no T before one is generated
//! clauses: NG-025
//! run: -> candidate.not_triangle*8
//! twin: t_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    float sum = 0;
    while (rayQueryProceedEXT(q))
        if (CANDIDATE(q) == AT_BOX)
            sum += rayQueryGetIntersectionTEXT(q, false); //~ candidate.not_triangle!
    SHOW(sum);
}
