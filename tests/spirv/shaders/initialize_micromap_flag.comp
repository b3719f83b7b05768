/* SPDX-License-Identifier: Apache-2.0 */
//! why: the micromap flag means nothing without its capability
//! clauses: NG-080
//! run: -> initialize.unknown_flags*8
//! twin: initialize_constants_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, 0x400u, 0xFFu, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, 1), 100.0); //~ initialize.unknown_flags!
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(TYPE(q));
}
