/* SPDX-License-Identifier: Apache-2.0 */
//! why: NG-039: tmin is never below zero
//! clauses: NG-039
//! run: -> generate.range*8
//! twin: generate_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) {
        if (rayQueryGetIntersectionTypeEXT(q, false) == gl_RayQueryCandidateIntersectionAABBEXT)
            rayQueryGenerateIntersectionEXT(q, -1.0); //~ generate.range!
    }
    SHOW(0);
}
