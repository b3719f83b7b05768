/* SPDX-License-Identifier: Apache-2.0 */
//! why: the BLAS that does not let its vertices be read is not the one that is hit
//! clauses: VUID-RuntimeSpirv-flags-08761 NG-035 NG-036
//! options: structures=0x100021
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_tracing_position_fetch : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    vec3 corners[3];
    float sum = 0;
    START(q, gl_RayFlagsNoneEXT); //~ structure.none? structure.never_built? structure.destroyed? structure.bottom_level?
    while (rayQueryProceedEXT(q))
        if (CANDIDATE(q) == AT_TRIANGLE) {
            rayQueryGetIntersectionTriangleVertexPositionsEXT(q, false, corners); //~ structure.no_positions?
            sum += corners[1].x;
            rayQueryConfirmIntersectionEXT(q);
        }
    if (TYPE(q) == TRIANGLE) {
        rayQueryGetIntersectionTriangleVertexPositionsEXT(q, true, corners); //~ structure.no_positions?
        sum += corners[2].y;
    }
    SHOW(sum);
}
