/* SPDX-License-Identifier: Apache-2.0 */
//! why: what the table says of the structure behind the descriptor
//! options: structures=3
//! run: -> structure.bottom_level*8
//! twin: structure_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsOpaqueEXT); //~ structure.none? structure.never_built? structure.destroyed? structure.bottom_level?
    rayQueryProceedEXT(q);
    SHOW(TYPE(q));
}
