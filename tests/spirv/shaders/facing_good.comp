/* SPDX-License-Identifier: Apache-2.0 */
//! why: facing of triangles only
//! clauses: NG-063
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    float sum = 0;
    while (rayQueryProceedEXT(q)) {
        if (CANDIDATE(q) == AT_TRIANGLE) {
            sum += rayQueryGetIntersectionFrontFaceEXT(q, false) ? 1 : 2;
            rayQueryConfirmIntersectionEXT(q);
        } else {
            rayQueryGenerateIntersectionEXT(q, 2.0); //~ generate.range?
        }
    }
    if (TYPE(q) == TRIANGLE)
        sum += rayQueryGetIntersectionFrontFaceEXT(q, true) ? 4 : 8;
    SHOW(sum);
}
