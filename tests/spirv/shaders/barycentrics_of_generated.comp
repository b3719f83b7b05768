/* SPDX-License-Identifier: Apache-2.0 */
//! why: what was generated has no barycentrics
//! clauses: NG-062
//! run: choice=1 lane=1 -> committed.not_triangle*1
//! run: ->
//! twin: facing_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsSkipTrianglesEXT);
    while (rayQueryProceedEXT(q))
        rayQueryGenerateIntersectionEXT(q, 2.5); //~ generate.range?
    float sum = 0;
    if (TYPE(q) != NOTHING && CHOSEN)
        sum = rayQueryGetIntersectionBarycentricsEXT(q, true).x; //~ committed.not_triangle!
    SHOW(sum);
}
