/* SPDX-License-Identifier: Apache-2.0 */
//! why: the usual loop, guarded by the committed type
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsOpaqueEXT);
    while (rayQueryProceedEXT(q)) {
    }
    float t = -1;
    if (rayQueryGetIntersectionTypeEXT(q, true) == TRIANGLE)
        t = rayQueryGetIntersectionTEXT(q, true);
    SHOW(t);
}
