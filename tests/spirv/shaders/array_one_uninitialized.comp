#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q[2];
    START(q[0], gl_RayFlagsOpaqueEXT);
    while (rayQueryProceedEXT(q[0])) {
    }
    while (rayQueryProceedEXT(q[1])) {
    }
    SHOW(0);
}
