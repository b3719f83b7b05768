/* SPDX-License-Identifier: Apache-2.0 */
//! why: the result of Proceed is not tested
//! clauses: NG-030
//! run: choice=1 lane=1 -> candidate.none*1
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, CHOSEN ? gl_RayFlagsOpaqueEXT | gl_RayFlagsSkipAABBEXT : gl_RayFlagsNoOpaqueEXT);
    rayQueryProceedEXT(q);
    SHOW(rayQueryGetIntersectionPrimitiveIndexEXT(q, false)); //~ candidate.none?
}
