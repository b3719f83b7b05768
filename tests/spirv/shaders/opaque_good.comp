/* SPDX-License-Identifier: Apache-2.0 */
//! why: opacity of an AABB, behind the test of its type
//! clauses: NG-025
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    uint n = 0;
    while (rayQueryProceedEXT(q))
        if (CANDIDATE(q) == AT_BOX)
            n += rayQueryGetIntersectionCandidateAABBOpaqueEXT(q) ? 1 : 2;
    SHOW(n);
}
