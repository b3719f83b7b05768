/* SPDX-License-Identifier: Apache-2.0 */
//! why: t comes from the host
//! clauses: NG-039 NG-044
//! run: choice=1 value=0.25 lane=2 -> generate.range*1
//! run: choice=1 value=0.5 ->
//! run: choice=1 value=100 ->
//! run: choice=1 value=101 -> generate.range*8
//! run: choice=1 value=nan lane=0 -> generate.range*1
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, gl_RayFlagsNoneEXT, 0xFF, vec3(0.25, 0.25, -1), 0.5, vec3(0, 0, 1), 100.0);
    while (rayQueryProceedEXT(q)) {
        if (rayQueryGetIntersectionTypeEXT(q, false) == gl_RayQueryCandidateIntersectionAABBEXT)
            rayQueryGenerateIntersectionEXT(q, CHOSEN ? value : 1.0); //~ generate.range?
    }
    SHOW(rayQueryGetIntersectionTypeEXT(q, true));
}
