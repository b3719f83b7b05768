#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    const float zero = 0.0;
    rayQueryInitializeEXT(q, scene, 0x300, 0x1FF, vec3(0), -1.0, vec3(0), 10.0);
    rayQueryInitializeEXT(q, scene, 0x110, 0xFF, vec3(0), 2.0, vec3(0, 0, 1), 1.0);
    rayQueryInitializeEXT(q, scene, 0x3, 0xFF, vec3(uintBitsToFloat(0x7FC00000u)), 0.0, vec3(0, 0, 1), 1.0);
    rayQueryInitializeEXT(q, scene, 0x800, 0xFFFFFFFF, vec3(uintBitsToFloat(0x7F800000u)), 0.0, vec3(0, 0, 1), 1.0);
    rayQueryTerminateEXT(q);
    SHOW(0);
}
