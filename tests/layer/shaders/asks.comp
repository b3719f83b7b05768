#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_GOOGLE_include_directive : require
#include "asks.glsl"
layout(local_size_x = 8) in;
layout(constant_id = 0) const uint rays_flags = 0;
layout(set = 0, binding = 1, std430) buffer Output { float output_[]; };
void main()
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, rays_flags, 0xFF, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, 1), 100.0);
    rayQueryProceedEXT(q);
    output_[gl_GlobalInvocationID.x] = ask(wrong != 0 && gl_GlobalInvocationID.x == 5);
}
