#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
rayQueryEXT global;
/* One query under two names: nothing may be proved of it. */
bool step(rayQueryEXT q)
{
    bool more = rayQueryProceedEXT(q);
    if (CHOSEN)
        START(global, gl_RayFlagsOpaqueEXT);
    return more && rayQueryProceedEXT(q);
}
void main()
{
    START(global, gl_RayFlagsOpaqueEXT);
    SHOW(step(global) ? 1 : 0);
}
