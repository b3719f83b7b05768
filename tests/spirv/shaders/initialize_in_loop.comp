/* SPDX-License-Identifier: Apache-2.0 */
//! why: one of many rays is wrong
//! clauses: NG-053
//! run: value=0 -> initialize.zero_direction*8
//! run: value=nan -> initialize.nan*8
//! run: value=1 ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    uint n = 0;
    for (uint i = 0; i < 4; i++) {
        rayQueryInitializeEXT(q, scene, 0, 0xFF, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, i == 2 ? value : 1.0), 100.0); //~ initialize.nan? initialize.infinite? initialize.zero_direction?
        while (rayQueryProceedEXT(q)) {
        }
        n += TYPE(q);
    }
    SHOW(n);
}
