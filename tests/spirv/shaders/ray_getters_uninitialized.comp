/* SPDX-License-Identifier: Apache-2.0 */
//! why: what was given to Initialize cannot be read before it
//! clauses: NG-031
//! run: -> use.uninitialized*32
//! twin: ray_getters_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    SHOW(rayQueryGetRayTMinEXT(q)); //~ use.uninitialized!
    SHOW(rayQueryGetRayFlagsEXT(q)); //~ use.uninitialized!
    SHOW(rayQueryGetWorldRayOriginEXT(q).x); //~ use.uninitialized!
    SHOW(rayQueryGetWorldRayDirectionEXT(q).x); //~ use.uninitialized!
}
