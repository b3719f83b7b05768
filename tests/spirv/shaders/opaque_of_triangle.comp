/* SPDX-License-Identifier: Apache-2.0 */
//! why: the flags skip boxes
//! clauses: NG-025
//! run: -> candidate.not_aabb*8
//! twin: opaque_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoOpaqueEXT | gl_RayFlagsSkipAABBEXT);
    bool x = false;
    while (rayQueryProceedEXT(q))
        x = rayQueryGetIntersectionCandidateAABBOpaqueEXT(q); //~ candidate.not_aabb!
    SHOW(x ? 1 : 0);
}
