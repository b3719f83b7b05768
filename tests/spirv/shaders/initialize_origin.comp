/* SPDX-License-Identifier: Apache-2.0 */
//! why: one component of the origin
//! clauses: NG-053
//! run: value=1e38 ->
//! run: value=-inf -> initialize.infinite*8
//! run: value=nan -> initialize.nan*8
//! run: value=-0.0 ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, 0u, 0xFFu, vec3(0.25, value, -1), 0.0, vec3(0, 0, 1), 100.0); //~ initialize.nan? initialize.infinite?
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(TYPE(q));
}
