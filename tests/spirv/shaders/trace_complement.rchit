/* SPDX-License-Identifier: Apache-2.0 */
//! why: what runs at the hit of the trace of that name
#version 460
#extension GL_GOOGLE_include_directive : require
#include "trace.glsl"
layout(location = 0) rayPayloadInEXT float arrived;
void main()
{
    arrived += 1;
}
