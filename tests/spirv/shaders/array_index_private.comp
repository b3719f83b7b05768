/* SPDX-License-Identifier: Apache-2.0 */
//! why: a global array is not indexed by what one function computes, but by what the host says it is
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
rayQueryEXT q[2], other[2];
void trace(uint which)
{
    START(q[choice & 1], gl_RayFlagsOpaqueEXT);
    START(other[which], gl_RayFlagsOpaqueEXT);
}
void main()
{
    trace(1);
    rayQueryProceedEXT(q[choice & 1]);
    rayQueryProceedEXT(other[lane & 1]); //~ use.uninitialized?
    SHOW(TYPE(q[choice & 1]));
}
