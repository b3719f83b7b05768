#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    float bad = CHOSEN ? value : 0.0;
    rayQueryInitializeEXT(q, scene, gl_RayFlagsOpaqueEXT, 0xFF, vec3(0.25, 0.25, -1 + bad), 0.0, vec3(0, 0, 1), 100.0);
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(rayQueryGetIntersectionTypeEXT(q, true));
}
