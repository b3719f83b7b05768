/* SPDX-License-Identifier: Apache-2.0 */
/* The committed hit of a ray query in a fragment shader: a fragment for each ray. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"

void main()
{
    const uvec2 at = uvec2(gl_FragCoord.xy);
    const uint index = at.y * width + at.x;
    if (at.x < width && index < ray_count) {
        committed[index] = query_answer(rays[index]);
    }
}
