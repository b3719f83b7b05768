/* SPDX-License-Identifier: Apache-2.0 */
//! why: a T of -0 is no less than a tmin of 0
//! clauses: NG-044
//! run: value=-0.0 ->
//! run: value=-1e-30 -> generate.range*8
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsSkipTrianglesEXT);
    while (rayQueryProceedEXT(q))
        rayQueryGenerateIntersectionEXT(q, value); //~ generate.range?
    SHOW(TYPE(q));
}
