/* SPDX-License-Identifier: Apache-2.0 */
//! why: the ray comes from the trace before
#version 460
#extension GL_GOOGLE_include_directive : require
#include "trace.glsl"
layout(location = 0) rayPayloadInEXT float arrived;
void main()
{
    traceRayEXT(scene, 0, 0xFF, 0, 0, 0, gl_WorldRayOriginEXT, 0, gl_WorldRayDirectionEXT, 100, 0); //~ trace.nan? trace.infinite? trace.zero_direction?
    arrived += 1;
}
