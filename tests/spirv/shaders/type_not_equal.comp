/* SPDX-License-Identifier: Apache-2.0 */
//! why: the test is for the opposite
//! clauses: NG-038 NG-041
//! run: choice=0 ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    float sum = 0;
    while (rayQueryProceedEXT(q)) {
        if (CANDIDATE(q) != AT_TRIANGLE)
            rayQueryGenerateIntersectionEXT(q, 2.5); //~ generate.range?
        else
            rayQueryConfirmIntersectionEXT(q);
    }
    if (!(TYPE(q) == NOTHING))
        sum = rayQueryGetIntersectionTEXT(q, true);
    SHOW(sum);
}
