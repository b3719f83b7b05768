/* SPDX-License-Identifier: Apache-2.0 */
//! why: tmin comes from the host
//! clauses: NG-053
//! run: value=-1 -> initialize.negative_t*8
//! run: value=-0.0 ->
//! run: value=nan -> initialize.nan*8
//! run: value=100 ->
//! run: value=100.1 -> initialize.t_order*8
//! run: value=inf -> initialize.t_order*8
//! run: value=-inf -> initialize.negative_t*8
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, 0u, 0xFFu, vec3(0.25, 0.25, -1), value, vec3(0, 0, 1), 100.0); //~ initialize.nan? initialize.negative_t? initialize.t_order?
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(TYPE(q));
}
