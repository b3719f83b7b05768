/* SPDX-License-Identifier: Apache-2.0 */
//! why: the flags leave no candidate, so one Proceed ends the traversal
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    /* Opaque triangles and no boxes: there is never a candidate, so one Proceed ends it. */
    START(q, gl_RayFlagsOpaqueEXT | gl_RayFlagsSkipAABBEXT);
    rayQueryProceedEXT(q);
    SHOW(rayQueryGetIntersectionTypeEXT(q, true));
}
