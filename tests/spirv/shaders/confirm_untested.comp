/* SPDX-License-Identifier: Apache-2.0 */
//! why: the candidate may be a box
//! clauses: NG-041
//! run: choice=1 lane=3 -> confirm.not_triangle*1
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, CHOSEN ? gl_RayFlagsSkipTrianglesEXT : gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q))
        if (CHOSEN || CANDIDATE(q) == AT_TRIANGLE)
            rayQueryConfirmIntersectionEXT(q); //~ confirm.not_triangle?
    SHOW(TYPE(q));
}
