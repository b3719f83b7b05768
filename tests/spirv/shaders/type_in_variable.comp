/* SPDX-License-Identifier: Apache-2.0 */
//! why: the type is kept in a variable and tested twice
//! clauses: NG-025
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    float sum = 0;
    while (rayQueryProceedEXT(q)) {
        uint kind = CANDIDATE(q);
        if (kind == AT_TRIANGLE)
            sum += rayQueryGetIntersectionTEXT(q, false);
        sum += 1;
        if (kind == AT_BOX)
            sum += rayQueryGetIntersectionCandidateAABBOpaqueEXT(q) ? 1 : 2;
    }
    SHOW(sum);
}
