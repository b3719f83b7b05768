/* SPDX-License-Identifier: Apache-2.0 */
//! why: vertex positions of a triangle candidate and of a committed triangle
//! clauses: NG-034 NG-035 NG-036
//! run: ->
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
        if (CANDIDATE(q) == AT_TRIANGLE) {
            rayQueryGetIntersectionTriangleVertexPositionsEXT(q, false, corners);
            sum += corners[1].x;
            rayQueryConfirmIntersectionEXT(q);
        }
    if (TYPE(q) == TRIANGLE) {
        rayQueryGetIntersectionTriangleVertexPositionsEXT(q, true, corners);
        sum += corners[2].y;
    }
    SHOW(sum);
}
