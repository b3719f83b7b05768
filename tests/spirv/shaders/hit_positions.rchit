/* SPDX-License-Identifier: Apache-2.0 */
//! why: see hit_positions.rgen
//! options: structures=1
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_tracing_position_fetch : require
#include "trace.glsl"
layout(location = 0) rayPayloadInEXT float payload;
void main()
{
    uint corner = choice + 1;
    payload = gl_HitTriangleVertexPositionsEXT[corner].x; //~ hit.positions_of_aabb? structure.no_positions?
}
