/* SPDX-License-Identifier: Apache-2.0 */
//! why: operands that are parameters
//! clauses: NG-053
//! run: value=nan -> initialize.nan*8
//! run: value=1 ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void begin(rayQueryEXT q, vec3 origin, vec3 direction)
{
    rayQueryInitializeEXT(q, scene, gl_RayFlagsOpaqueEXT, 0xFF, origin, 0.0, direction, 100.0); //~ initialize.nan? initialize.infinite? initialize.zero_direction?
}
void main()
{
    rayQueryEXT q;
    begin(q, vec3(0.25, 0.25, -1), vec3(0, 0, value));
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(TYPE(q));
}
