/* SPDX-License-Identifier: Apache-2.0 */
//! why: tmax comes from the host; infinity is allowed
//! clauses: NG-050 NG-053
//! run: value=inf ->
//! run: value=-2 -> initialize.negative_t*8 initialize.t_order*8
//! run: value=nan -> initialize.nan*8
//! run: value=0.5 ->
//! run: value=0.25 -> initialize.t_order*8
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, 0u, 0xFFu, vec3(0.25, 0.25, -1), 0.5, vec3(0, 0, 1), value); //~ initialize.nan? initialize.negative_t? initialize.t_order?
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(TYPE(q));
}
