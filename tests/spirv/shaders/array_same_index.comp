/* SPDX-License-Identifier: Apache-2.0 */
//! why: an index that is no constant, but always the same: what is wrong is proved, and left unchecked is what is right
//! run: -> proceed.after_false*8
//! twin: array_by_lane.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q[4];
    uint which = (choice + LANE * 3) & 3;
    START(q[which], gl_RayFlagsOpaqueEXT);
    while (rayQueryProceedEXT(q[which]))
        ;
    SHOW(rayQueryProceedEXT(q[which]) ? 1 : 0); //~ proceed.after_false!
}
