/* SPDX-License-Identifier: Apache-2.0 */
//! why: a function that generates
//! clauses: NG-039
//! run: value=3 ->
//! run: value=300 -> generate.range*8
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void put(rayQueryEXT q, float t)
{
    rayQueryGenerateIntersectionEXT(q, t); //~ generate.not_aabb? generate.range?
}
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsSkipTrianglesEXT);
    while (rayQueryProceedEXT(q))
        put(q, value);
    SHOW(TYPE(q) == NOTHING ? 0 : rayQueryGetIntersectionTEXT(q, true));
}
