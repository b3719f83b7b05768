/* SPDX-License-Identifier: Apache-2.0 */
//! why: NG-041, by exclusion of the triangle
//! clauses: NG-041
//! run: -> confirm.not_triangle*8
//! twin: confirm_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) {
        if (rayQueryGetIntersectionTypeEXT(q, false) != gl_RayQueryCandidateIntersectionTriangleEXT)
            rayQueryConfirmIntersectionEXT(q); //~ confirm.not_triangle!
    }
    SHOW(0);
}
