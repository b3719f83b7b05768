/* SPDX-License-Identifier: Apache-2.0 */
//! why: a miss has no vertices
//! clauses: NG-036
//! run: not (the driver reads vertices at no address)
//! twin: positions_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_tracing_position_fetch : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) {
    }
    vec3 corners[3];
    if (TYPE(q) == NOTHING)
        rayQueryGetIntersectionTriangleVertexPositionsEXT(q, true, corners); //~ committed.none!
    SHOW(corners[0].x);
}
