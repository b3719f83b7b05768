/* SPDX-License-Identifier: Apache-2.0 */
//! why: one ray of eight has no direction
//! clauses: NG-045 NG-053
//! run: choice=1 lane=5 -> initialize.zero_direction*1
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, 0u, 0xFFu, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, CHOSEN ? 0 : 1), 100.0); //~ initialize.nan? initialize.infinite? initialize.zero_direction?
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(TYPE(q));
}
