#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoOpaqueEXT | gl_RayFlagsSkipAABBEXT);
    while (rayQueryProceedEXT(q))
        rayQueryGenerateIntersectionEXT(q, 1.0);
    SHOW(0);
}
