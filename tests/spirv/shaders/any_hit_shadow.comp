/* SPDX-License-Identifier: Apache-2.0 */
//! why: a shadow ray: one Proceed is enough
//! clauses: NG-071
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsOpaqueEXT | gl_RayFlagsTerminateOnFirstHitEXT | gl_RayFlagsSkipAABBEXT);
    rayQueryProceedEXT(q);
    SHOW(TYPE(q) == TRIANGLE ? 0.0 : 1.0);
}
