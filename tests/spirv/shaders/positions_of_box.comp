/* SPDX-License-Identifier: Apache-2.0 */
//! why: a box has no vertices
//! clauses: NG-036
//! run: -> candidate.not_triangle*8
//! twin: positions_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_tracing_position_fetch : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    vec3 corners[3];
    float sum = 0;
    while (rayQueryProceedEXT(q))
        if (CANDIDATE(q) == AT_BOX) {
            rayQueryGetIntersectionTriangleVertexPositionsEXT(q, false, corners); //~ candidate.not_triangle!
            sum += corners[0].x;
        }
    SHOW(sum);
}
