/* SPDX-License-Identifier: Apache-2.0 */
//! why: bits that mean nothing
//! clauses: NG-080
//! run: choice=0x400 -> initialize.unknown_flags*8
//! run: choice=0x80000000 -> initialize.unknown_flags*8
//! run: choice=0x88 ->
//! run: choice=0x304 -> initialize.skip_both*8
//! run: choice=0x41 -> initialize.opacity_pair*8
//! run: choice=0x82 -> initialize.opacity_pair*8
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, choice, 0xFFu, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, 1), 100.0); //~ initialize.skip_both? initialize.cull_pair? initialize.opacity_pair? initialize.unknown_flags?
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(TYPE(q));
}
