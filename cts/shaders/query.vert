/* SPDX-License-Identifier: Apache-2.0 */
/* The committed hit of a ray query in a vertex shader: a vertex for each ray. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"

void main()
{
    if (gl_VertexIndex < ray_count) {
        committed[gl_VertexIndex] = query_answer(rays[gl_VertexIndex]);
    }
    gl_Position = vec4(0.0, 0.0, 0.0, 1.0);
    gl_PointSize = 1.0;
}
