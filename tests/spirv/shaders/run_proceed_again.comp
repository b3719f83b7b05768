#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsOpaqueEXT);
    bool more = rayQueryProceedEXT(q);
    if (CHOSEN)
        more = rayQueryProceedEXT(q);
    uint extra = CHOSEN ? 2u : 0u;
    for (uint i = 0; i < extra; i++)
        more = rayQueryProceedEXT(q);
    SHOW(more ? 1 : 0);
}
