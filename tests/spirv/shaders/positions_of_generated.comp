/* SPDX-License-Identifier: Apache-2.0 */
//! why: what was generated has no vertices
//! clauses: NG-036
//! run: -> committed.not_triangle*8
//! twin: positions_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_tracing_position_fetch : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsSkipTrianglesEXT);
    while (rayQueryProceedEXT(q))
        rayQueryGenerateIntersectionEXT(q, 2.0); //~ generate.range?
    vec3 corners[3];
    if (TYPE(q) == GENERATED)
        rayQueryGetIntersectionTriangleVertexPositionsEXT(q, true, corners); //~ committed.not_triangle!
    SHOW(corners[0].x);
}
