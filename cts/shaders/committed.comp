/* SPDX-License-Identifier: Apache-2.0 */
/* The committed hit. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"

layout(local_size_x = 64) in;

void main()
{
    const uint index = gl_GlobalInvocationID.x;
    if (index >= ray_count) {
        return;
    }
    committed[index] = query_answer(rays[index]);
}
