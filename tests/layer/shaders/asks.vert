#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_GOOGLE_include_directive : require
#include "asks.glsl"
void main()
{
    float t = ask(wrong != 0);
    gl_Position = vec4(gl_VertexIndex == 1 ? 3 : -1, gl_VertexIndex == 2 ? 3 : -1, t < 0 ? 2 : 0, 1);
}
