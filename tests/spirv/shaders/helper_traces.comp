/* SPDX-License-Identifier: Apache-2.0 */
//! why: a helper with a query of its own
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
float nearest(vec3 origin)
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, gl_RayFlagsOpaqueEXT, 0xFF, origin, 0.0, vec3(0, 0, 1), 100.0); //~ initialize.nan? initialize.infinite?
    while (rayQueryProceedEXT(q)) {
    }
    if (TYPE(q) == NOTHING)
        return -1.0;
    return rayQueryGetIntersectionTEXT(q, true);
}
void main()
{
    SHOW(nearest(vec3(0.25, 0.25, -1)) + nearest(vec3(9, 9, 9)));
}
