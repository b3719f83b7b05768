/* SPDX-License-Identifier: Apache-2.0 */
//! why: the committed type is not tested
//! clauses: NG-054
//! run: choice=1 lane=6 -> committed.none*1
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, gl_RayFlagsOpaqueEXT, 0xFF, vec3(CHOSEN ? 50.0 : 0.25, 0.25, -1), 0.0, vec3(0, 0, 1), 100.0); //~ initialize.nan? initialize.infinite?
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(rayQueryGetIntersectionTEXT(q, true)); //~ committed.none?
}
