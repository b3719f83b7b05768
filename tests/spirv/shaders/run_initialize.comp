/* SPDX-License-Identifier: Apache-2.0 */
//! why: one component of the origin comes from the host
//! clauses: NG-053 NG-045
//! run: choice=1 value=nan -> initialize.nan*8
//! run: choice=1 value=nan lane=5 -> initialize.nan*1
//! run: choice=1 value=inf lane=2 -> initialize.infinite*1
//! run: value=nan ->
//! run: choice=1 value=0.5 ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    float bad = CHOSEN ? value : 0.0;
    rayQueryInitializeEXT(q, scene, gl_RayFlagsOpaqueEXT, 0xFF, vec3(0.25, 0.25, -1 + bad), 0.0, vec3(0, 0, 1), 100.0); //~ initialize.nan? initialize.infinite?
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(rayQueryGetIntersectionTypeEXT(q, true));
}
