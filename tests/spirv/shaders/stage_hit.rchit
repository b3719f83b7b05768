/* SPDX-License-Identifier: Apache-2.0 */
//! why: what runs at the hit of the trace of that name
//! clauses: NG-037
//! twin: stage_raygen_trace.rgen
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_tracing : require
#define LANE gl_LaunchIDEXT.x
#include "query.glsl"
layout(location = 0) rayPayloadInEXT float arrived;
void main()
{
    rayQueryEXT q;
    if (!CHOSEN)
        START(q, gl_RayFlagsOpaqueEXT);
    arrived = rayQueryProceedEXT(q) ? 1 : 2; //~ use.uninitialized?
}
