/* SPDX-License-Identifier: Apache-2.0 */
//! why: elements named by constants are followed one by one
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q[2];
    START(q[0], gl_RayFlagsOpaqueEXT);
    START(q[1], gl_RayFlagsOpaqueEXT);
    while (rayQueryProceedEXT(q[1])) {
    }
    SHOW(rayQueryGetRayTMinEXT(q[0]) + float(rayQueryGetIntersectionTypeEXT(q[1], true)));
}
