/* SPDX-License-Identifier: Apache-2.0 */
//! why: initialized in one element, used in another
//! clauses: NG-037
//! run: choice=1 lane=4 -> use.uninitialized*1
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q[4];
    START(q[1], gl_RayFlagsOpaqueEXT);
    START(q[2], gl_RayFlagsOpaqueEXT);
    SHOW(rayQueryProceedEXT(q[CHOSEN ? 3 : 2]) ? 1 : 0); //~ use.uninitialized?
}
