#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, CHOSEN ? gl_RayFlagsOpaqueEXT | gl_RayFlagsSkipAABBEXT : gl_RayFlagsNoOpaqueEXT);
    rayQueryProceedEXT(q);
    SHOW(rayQueryGetIntersectionPrimitiveIndexEXT(q, false));
}
