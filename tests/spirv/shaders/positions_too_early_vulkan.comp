/* SPDX-License-Identifier: Apache-2.0 */
//! why: Vulkan lets what is committed so far be read
//! clauses: NG-034
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
            rayQueryConfirmIntersectionEXT(q);
            rayQueryGetIntersectionTriangleVertexPositionsEXT(q, true, corners);
            sum += corners[1].x;
        }
    SHOW(sum);
}
