/* SPDX-License-Identifier: Apache-2.0 */
//! why: NG-038: the flags skip boxes
//! clauses: NG-038
//! run: -> generate.not_aabb*8
//! twin: generate_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoOpaqueEXT | gl_RayFlagsSkipAABBEXT);
    while (rayQueryProceedEXT(q))
        rayQueryGenerateIntersectionEXT(q, 1.0); //~ generate.not_aabb!
    SHOW(0);
}
