/* SPDX-License-Identifier: Apache-2.0 */
//! why: a switch on the type is a guard as well
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) {
        switch (rayQueryGetIntersectionTypeEXT(q, false)) {
        case gl_RayQueryCandidateIntersectionTriangleEXT: rayQueryConfirmIntersectionEXT(q); break;
        default: break;
        }
    }
    float t = 0;
    switch (rayQueryGetIntersectionTypeEXT(q, true)) {
    case gl_RayQueryCommittedIntersectionTriangleEXT: t = rayQueryGetIntersectionFrontFaceEXT(q, true) ? 1 : 2; break;
    case gl_RayQueryCommittedIntersectionGeneratedEXT: t = rayQueryGetIntersectionTEXT(q, true); break;
    }
    SHOW(t);
}
