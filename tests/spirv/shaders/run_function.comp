#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
rayQueryEXT global;
bool step(rayQueryEXT q) { return rayQueryProceedEXT(q); }
uint read(rayQueryEXT q) { return rayQueryGetRayFlagsEXT(q); }
void main()
{
    rayQueryEXT local;
    if (!CHOSEN)
        START(local, gl_RayFlagsOpaqueEXT);
    START(global, gl_RayFlagsOpaqueEXT | gl_RayFlagsSkipAABBEXT);
    if (CHOSEN)
        rayQueryProceedEXT(global);
    rayQueryProceedEXT(global);
    SHOW(read(local));
}
