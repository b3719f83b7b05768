/* SPDX-License-Identifier: Apache-2.0 */
//! why: T of a triangle, and of what was generated
//! clauses: NG-025 NG-020
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    float sum = 0;
    while (rayQueryProceedEXT(q))
        if (CANDIDATE(q) == AT_TRIANGLE)
            sum += rayQueryGetIntersectionTEXT(q, false);
        else
            rayQueryGenerateIntersectionEXT(q, 2.5); //~ generate.range?
    if (TYPE(q) != NOTHING)
        sum += rayQueryGetIntersectionTEXT(q, true);
    SHOW(sum);
}
