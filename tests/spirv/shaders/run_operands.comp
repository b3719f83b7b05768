#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    bool bad = CHOSEN;
    uint c = bad ? choice : 0u;
    uint flags = c == 1 ? 0x300u : c == 2 ? 0x110u : c == 3 ? 0x41u : c == 4 ? 0x1000u : 1u;
    uint mask = c == 5 ? 0x1FFu : 0xFFu;
    float tmin = c == 6 ? -value : c == 7 ? 200.0 : 0.0;
    vec3 direction = c == 8 ? vec3(0) : vec3(0, 0, 1);
    rayQueryInitializeEXT(q, scene, flags, mask, vec3(0.25, 0.25, -1), tmin, direction, 100.0);
    SHOW(rayQueryGetRayTMinEXT(q));
}
