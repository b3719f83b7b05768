/* SPDX-License-Identifier: Apache-2.0 */
//! why: a result in a ternary
//! clauses: NG-062
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(TYPE(q) == TRIANGLE ? rayQueryGetIntersectionBarycentricsEXT(q, true).x : -1.0);
}
