#version 460
/* SPDX-License-Identifier: Apache-2.0 */
/* One fragment in each quad lives on; the others are helpers from there on, whose mistakes leave nothing. */
#extension GL_GOOGLE_include_directive : require
#include "asks.glsl"
layout(location = 0) out float t;
void main()
{
    uvec2 at = uvec2(gl_FragCoord.xy);
    if (wrong == 2 && ((at.x | at.y) & 1) != 0)
        discard;
    t = ask(wrong != 0);
}
