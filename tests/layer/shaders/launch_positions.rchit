/* SPDX-License-Identifier: Apache-2.0 */
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_tracing_position_fetch : require
#include "launch.glsl"
layout(location = 0) rayPayloadInEXT vec4 payload[2];
void main()
{
    payload[0].x += gl_HitTriangleVertexPositionsEXT[1].x;
}
