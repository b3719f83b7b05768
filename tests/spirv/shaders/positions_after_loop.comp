/* SPDX-License-Identifier: Apache-2.0 */
//! why: the candidate is gone
//! clauses: NG-035
//! run: -> candidate.none*8
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
    rayQueryGetIntersectionTriangleVertexPositionsEXT(q, false, corners); //~ candidate.none!
    SHOW(corners[1].x);
}
