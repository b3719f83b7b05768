/* SPDX-License-Identifier: Apache-2.0 */
//! why: the candidate may be a triangle
//! clauses: NG-025
//! run: choice=1 lane=0 -> candidate.not_aabb*1
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    uint n = 0;
    START(q, CHOSEN ? gl_RayFlagsNoneEXT : gl_RayFlagsOpaqueEXT);
    while (rayQueryProceedEXT(q))
        n += rayQueryGetIntersectionCandidateAABBOpaqueEXT(q) ? 1 : 2; //~ candidate.not_aabb?
    SHOW(n);
}
