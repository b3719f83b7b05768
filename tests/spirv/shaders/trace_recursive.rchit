/* SPDX-License-Identifier: Apache-2.0 */
//! why: what runs at the hit, and traces again as often as it is told
//! options: recursion=2
//! twin: stage_raygen_trace.rgen
#version 460
#extension GL_GOOGLE_include_directive : require
#include "trace.glsl"
layout(location = 0) rayPayloadInEXT float arrived;
void main()
{
    arrived += 1;
    if (arrived < float(CHOSEN ? choice : 1))
        traceRayEXT(scene, 0, 0xFF, 0, 0, 0, ORIGIN, 0, DIRECTION, 100, 0); //~ trace.recursion?
}
