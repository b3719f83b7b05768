/* SPDX-License-Identifier: Apache-2.0 */
//! why: behind a discard, with helper lanes
//! clauses: NG-045
//! run: value=1 ->
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#define LANE uint(gl_FragCoord.x)
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    if (CHOSEN && LANE == 2)
        discard;
    rayQueryInitializeEXT(q, scene, gl_RayFlagsOpaqueEXT, 0xFF, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, 1), 100.0);
    while (rayQueryProceedEXT(q)) {
    }
    float t = value > 0 ? 0 : rayQueryGetIntersectionTEXT(q, true); //~ committed.none?
    SHOW(t + dFdx(t));
}
