/* SPDX-License-Identifier: Apache-2.0 */
//! why: one element by a constant, another by an index that may be the same
//! run: choice=0 -> proceed.after_false*8
//! run: choice=1 ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q[2];
    uint which = choice & 1;
    START(q[0], gl_RayFlagsOpaqueEXT);
    START(q[1], gl_RayFlagsOpaqueEXT);
    rayQueryProceedEXT(q[0]); //~ use.uninitialized?
    SHOW(rayQueryProceedEXT(q[which]) ? 1 : 0); //~ use.uninitialized? proceed.after_false?
}
