/* SPDX-License-Identifier: Apache-2.0 */
//! why: the ray comes from the host, a lane is a vertex
//! clauses: NG-053
//! run: choice=1 value=nan lane=4 -> initialize.nan*1
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#define LANE uint(gl_VertexIndex)
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, gl_RayFlagsOpaqueEXT, 0xFF, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, CHOSEN ? value : 1.0), 100.0); //~ initialize.nan? initialize.infinite? initialize.zero_direction?
    bool more = rayQueryProceedEXT(q);
    gl_Position = vec4(0, 0, 0, 1);
    gl_PointSize = 1;
    SHOW(more ? 1 : 0);
}
