/* SPDX-License-Identifier: Apache-2.0 */
//! why: what runs at a hit
#version 460
#extension GL_GOOGLE_include_directive : require
#include "trace.glsl"
layout(location = 0) rayPayloadInEXT float arrived;
void main()
{
    arrived = gl_HitTEXT;
}
