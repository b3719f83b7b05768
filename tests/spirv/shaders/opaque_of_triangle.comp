#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoOpaqueEXT | gl_RayFlagsSkipAABBEXT);
    bool x = false;
    while (rayQueryProceedEXT(q))
        x = rayQueryGetIntersectionCandidateAABBOpaqueEXT(q);
    SHOW(x ? 1 : 0);
}
