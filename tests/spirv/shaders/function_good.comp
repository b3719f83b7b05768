/* SPDX-License-Identifier: Apache-2.0 */
//! why: states are followed through calls
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void begin(rayQueryEXT q) { START(q, gl_RayFlagsOpaqueEXT); }
void finish(rayQueryEXT q) { while (rayQueryProceedEXT(q)) { } }
void main()
{
    rayQueryEXT a, b;
    begin(a);
    finish(a);
    begin(b);
    finish(b);
    SHOW(rayQueryGetIntersectionTypeEXT(a, true) + rayQueryGetIntersectionTypeEXT(b, true));
}
