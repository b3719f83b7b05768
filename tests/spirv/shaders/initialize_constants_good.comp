/* SPDX-License-Identifier: Apache-2.0 */
//! why: constants prove it right
//! clauses: NG-053 NG-079
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, gl_RayFlagsOpaqueEXT | gl_RayFlagsTerminateOnFirstHitEXT | gl_RayFlagsSkipAABBEXT, 0xFF, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, 1), INFINITY);
    rayQueryProceedEXT(q);
    SHOW(TYPE(q));
}
