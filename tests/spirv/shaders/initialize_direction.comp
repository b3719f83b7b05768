/* SPDX-License-Identifier: Apache-2.0 */
//! why: every component of the direction
//! clauses: NG-052 NG-053
//! run: value=0 -> initialize.zero_direction*8
//! run: value=-0.0 -> initialize.zero_direction*8
//! run: value=1e-30 ->
//! run: value=inf -> initialize.infinite*8
//! run: value=nan -> initialize.nan*8
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, 0u, 0xFFu, vec3(0.25, 0.25, -1), 0.0, vec3(value), 100.0); //~ initialize.nan? initialize.infinite? initialize.zero_direction?
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(TYPE(q));
}
