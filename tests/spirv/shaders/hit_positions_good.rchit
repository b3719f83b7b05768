/* SPDX-License-Identifier: Apache-2.0 */
//! why: see hit_positions_good.rgen
//! options: structures=1
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_tracing_position_fetch : require
#include "trace.glsl"
layout(location = 0) rayPayloadInEXT float payload;
void main()
{
    payload = gl_HitTriangleVertexPositionsEXT[1].x; //~ hit.positions_of_aabb? structure.no_positions?
}
