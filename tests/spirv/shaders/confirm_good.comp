/* SPDX-License-Identifier: Apache-2.0 */
//! why: the candidate's type is tested before
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoOpaqueEXT);
    float t = -1;
    while (rayQueryProceedEXT(q)) {
        if (rayQueryGetIntersectionTypeEXT(q, false) == gl_RayQueryCandidateIntersectionTriangleEXT) {
            t = rayQueryGetIntersectionTEXT(q, false);
            rayQueryConfirmIntersectionEXT(q);
        }
    }
    if (rayQueryGetIntersectionTypeEXT(q, true) != gl_RayQueryCommittedIntersectionNoneEXT)
        t += rayQueryGetIntersectionBarycentricsEXT(q, true).x * 0.0;
    SHOW(t);
}
