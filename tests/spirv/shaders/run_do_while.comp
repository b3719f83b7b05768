#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    if (!CHOSEN)
        START(q, gl_RayFlagsOpaqueEXT);
    uint n = 0;
    do {
        n++;
    } while (rayQueryProceedEXT(q) && n < 3);
    SHOW(n);
}
