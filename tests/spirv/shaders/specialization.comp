/* SPDX-License-Identifier: Apache-2.0 */
//! why: a specialization constant may still change the flags
//! clauses: NG-079
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
layout(constant_id = 0) const uint flags = 1;
void main()
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, flags, 0xFF, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, 1), 100.0); //~ initialize.skip_both? initialize.cull_pair? initialize.opacity_pair? initialize.unknown_flags?
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(TYPE(q));
}
