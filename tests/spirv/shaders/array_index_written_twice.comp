/* SPDX-License-Identifier: Apache-2.0 */
//! why: the variable that holds the index is written again between two uses
//! run: choice=1 -> use.uninitialized*8
//! run: choice=0 ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q[2];
    uint which = 0;
    START(q[which], gl_RayFlagsOpaqueEXT);
    which = choice & 1;
    SHOW(rayQueryProceedEXT(q[which]) ? 1 : 0); //~ use.uninitialized?
}
