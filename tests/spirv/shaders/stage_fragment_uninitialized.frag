/* SPDX-License-Identifier: Apache-2.0 */
//! why: one lane misbehaves, its helpers are not counted
//! clauses: NG-037 NG-045
//! run: choice=1 lane=3 -> use.uninitialized*1
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#define LANE uint(gl_FragCoord.x)
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    if (!CHOSEN)
        START(q, gl_RayFlagsOpaqueEXT);
    float n = rayQueryProceedEXT(q) ? 1 : 0; //~ use.uninitialized?
    SHOW(n + dFdx(n));
}
