/* SPDX-License-Identifier: Apache-2.0 */
//! why: one case forgets to initialize
//! clauses: NG-037
//! run: choice=2 lane=3 -> use.uninitialized*1
//! run: choice=1 ->
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    switch (CHOSEN ? choice : 0) {
    case 0: START(q, gl_RayFlagsOpaqueEXT); break;
    case 1: START(q, gl_RayFlagsNoneEXT); break;
    default: break;
    }
    SHOW(rayQueryProceedEXT(q) ? 1 : 0); //~ use.uninitialized?
}
