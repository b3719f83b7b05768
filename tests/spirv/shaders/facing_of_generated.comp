/* SPDX-License-Identifier: Apache-2.0 */
//! why: NG-063: what was generated has no facing
//! clauses: NG-063
//! run: -> committed.not_triangle*8
//! twin: facing_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) {
        if (rayQueryGetIntersectionTypeEXT(q, false) == gl_RayQueryCandidateIntersectionAABBEXT)
            rayQueryGenerateIntersectionEXT(q, 1.0); //~ generate.range?
    }
    bool x = false;
    if (rayQueryGetIntersectionTypeEXT(q, true) == gl_RayQueryCommittedIntersectionGeneratedEXT)
        x = rayQueryGetIntersectionFrontFaceEXT(q, true); //~ committed.not_triangle!
    SHOW(x ? 1 : 0);
}
