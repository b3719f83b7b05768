/* SPDX-License-Identifier: Apache-2.0 */
//! why: the second is closer than the first
//! clauses: NG-039
//! run: value=2.25 ->
//! run: value=2.75 -> generate.range*8
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsSkipTrianglesEXT);
    while (rayQueryProceedEXT(q)) {
        rayQueryGenerateIntersectionEXT(q, 2.5); //~ generate.range?
        rayQueryGenerateIntersectionEXT(q, value); //~ generate.range?
    }
    SHOW(TYPE(q));
}
