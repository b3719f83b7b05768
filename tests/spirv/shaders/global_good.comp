/* SPDX-License-Identifier: Apache-2.0 */
//! why: a global query through a function without parameters
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
rayQueryEXT q;
void finish() { while (rayQueryProceedEXT(q)) { } }
void main()
{
    START(q, gl_RayFlagsOpaqueEXT);
    finish();
    SHOW(rayQueryGetIntersectionTypeEXT(q, true));
}
