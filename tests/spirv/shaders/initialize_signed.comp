/* SPDX-License-Identifier: Apache-2.0 */
//! why: operands of a signed type
//! clauses: NG-079
//! run: choice=0x300 -> initialize.skip_both*8
//! run: choice=1 ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    int flags = int(choice), mask = 0xFF;
    rayQueryInitializeEXT(q, scene, flags, mask, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, 1), 100.0); //~ initialize.skip_both? initialize.cull_pair? initialize.opacity_pair? initialize.unknown_flags?
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(TYPE(q));
}
