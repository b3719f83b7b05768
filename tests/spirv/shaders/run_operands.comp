/* SPDX-License-Identifier: Apache-2.0 */
//! why: every operand comes from the host
//! clauses: NG-053 NG-048 NG-079 NG-080
//! run: choice=1 value=1 -> initialize.skip_both*8
//! run: choice=2 value=1 lane=0 -> initialize.cull_pair*1
//! run: choice=3 value=1 lane=7 -> initialize.opacity_pair*1
//! run: choice=4 value=1 lane=3 -> initialize.unknown_flags*1
//! run: choice=5 value=1 lane=3 -> initialize.mask_bits*1
//! run: choice=6 value=1 lane=3 -> initialize.negative_t*1
//! run: choice=6 lane=3 ->
//! run: choice=6 value=nan lane=3 -> initialize.nan*1
//! run: choice=7 value=1 lane=3 -> initialize.t_order*1
//! run: choice=8 value=1 -> initialize.zero_direction*8
//! run: value=1 ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    bool bad = CHOSEN;
    uint c = bad ? choice : 0u;
    uint flags = c == 1 ? 0x300u : c == 2 ? 0x110u : c == 3 ? 0x41u : c == 4 ? 0x1000u : 1u;
    uint mask = c == 5 ? 0x1FFu : 0xFFu;
    float tmin = c == 6 ? -value : c == 7 ? 200.0 : 0.0;
    vec3 direction = c == 8 ? vec3(0) : vec3(0, 0, 1);
    rayQueryInitializeEXT(q, scene, flags, mask, vec3(0.25, 0.25, -1), tmin, direction, 100.0); //~ initialize.nan? initialize.infinite? initialize.negative_t? initialize.t_order? initialize.zero_direction? initialize.skip_both? initialize.cull_pair? initialize.opacity_pair? initialize.unknown_flags? initialize.mask_bits?
    SHOW(rayQueryGetRayTMinEXT(q));
}
