/* SPDX-License-Identifier: Apache-2.0 */
//! why: NG-044: tmin and tmax themselves are allowed
//! clauses: NG-039 NG-044
//! run: value=0.5 ->
//! run: value=8 ->
//! run: value=0.49999997 -> generate.range*8
//! run: value=8.000001 -> generate.range*8
//! run: value=inf -> generate.range*8
//! run: value=-inf -> generate.range*8
//! run: value=nan -> generate.range*8
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, gl_RayFlagsSkipTrianglesEXT, 0xFF, vec3(0.25, 0.25, -1), 0.5, vec3(0, 0, 1), 8.0);
    while (rayQueryProceedEXT(q))
        rayQueryGenerateIntersectionEXT(q, value); //~ generate.range?
    SHOW(TYPE(q) == NOTHING ? 0 : rayQueryGetIntersectionTEXT(q, true));
}
