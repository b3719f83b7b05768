/* SPDX-License-Identifier: Apache-2.0 */
/* The committed hit in the structure at an address. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define SCENE accelerationStructureEXT(scene_address)
#include "query.glsl"

layout(local_size_x = 64) in;

void main()
{
    const uint index = gl_GlobalInvocationID.x;
    if (index < ray_count) {
        committed[index] = query_answer(rays[index]);
    }
}
