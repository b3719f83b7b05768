/* SPDX-License-Identifier: Apache-2.0 */
//! why: tmax is kept per element
//! clauses: NG-039
//! run: choice=1 value=20 lane=3 -> generate.range*1
//! run: value=20 ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q[2];
    for (uint i = 0; i < 2; i++)
        rayQueryInitializeEXT(q[i], scene, gl_RayFlagsSkipTrianglesEXT, 0xFF, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, 1), i == 0 ? 5.0 : 50.0); //~ initialize.nan? initialize.negative_t? initialize.t_order?
    uint which = CHOSEN ? 0 : 1;
    while (rayQueryProceedEXT(q[which])) //~ use.uninitialized? proceed.after_false?
        rayQueryGenerateIntersectionEXT(q[which], value); //~ use.uninitialized? generate.no_candidate? generate.not_aabb? generate.range?
    SHOW(TYPE(q[which])); //~ use.uninitialized?
}
