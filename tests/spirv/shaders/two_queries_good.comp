/* SPDX-License-Identifier: Apache-2.0 */
//! why: each query has its own state
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q, shadow;
    START(q, gl_RayFlagsOpaqueEXT);
    while (rayQueryProceedEXT(q)) {
    }
    float result = 0;
    if (TYPE(q) == TRIANGLE) {
        float t = rayQueryGetIntersectionTEXT(q, true);
        rayQueryInitializeEXT(shadow, scene, gl_RayFlagsTerminateOnFirstHitEXT | gl_RayFlagsOpaqueEXT, 0xFF, vec3(0.25, 0.25, 0.5), 0.0, vec3(0, 0, 1), 10.0);
        while (rayQueryProceedEXT(shadow)) {
        }
        result = t + (TYPE(shadow) == NOTHING ? 1.0 : 0.0);
    }
    SHOW(result);
}
