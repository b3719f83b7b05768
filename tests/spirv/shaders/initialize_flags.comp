/* SPDX-License-Identifier: Apache-2.0 */
//! why: every flag alone is right, and pairs are not
//! clauses: NG-079 NG-080
//! run: choice=0x301 -> initialize.skip_both*8
//! run: choice=0x30 -> initialize.cull_pair*8
//! run: choice=0x110 -> initialize.cull_pair*8
//! run: choice=0x120 -> initialize.cull_pair*8
//! run: choice=0x3 -> initialize.opacity_pair*8
//! run: choice=0xC0 -> initialize.opacity_pair*8
//! run: choice=0x25D -> initialize.opacity_pair*8
//! run: choice=0x21D ->
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
