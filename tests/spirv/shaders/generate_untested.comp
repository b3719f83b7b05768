/* SPDX-License-Identifier: Apache-2.0 */
//! why: the candidate may be a triangle
//! clauses: NG-038
//! run: choice=1 lane=6 -> generate.not_aabb*1
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, CHOSEN ? gl_RayFlagsNoneEXT : gl_RayFlagsOpaqueEXT);
    while (rayQueryProceedEXT(q))
        rayQueryGenerateIntersectionEXT(q, 0.5); //~ generate.not_aabb? generate.range?
    SHOW(TYPE(q));
}
