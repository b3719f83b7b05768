/* SPDX-License-Identifier: Apache-2.0 */
//! why: a candidate of one says nothing of the other
//! clauses: NG-030 NG-045
//! run: -> candidate.none*8
//! twin: two_queries_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q, other;
    START(q, gl_RayFlagsNoneEXT);
    START(other, gl_RayFlagsNoneEXT);
    float sum = 0;
    while (rayQueryProceedEXT(q)) {
        if (CANDIDATE(q) == AT_TRIANGLE)
            sum += rayQueryGetIntersectionPrimitiveIndexEXT(other, false); //~ candidate.none!
    }
    SHOW(sum);
}
