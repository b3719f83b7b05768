/* SPDX-License-Identifier: Apache-2.0 */
//! why: a local and a global query through functions
//! run: choice=1 lane=3 -> proceed.after_false*1 use.uninitialized*1
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
rayQueryEXT global;
bool step(rayQueryEXT q) { return rayQueryProceedEXT(q); }
uint read(rayQueryEXT q) { return rayQueryGetRayFlagsEXT(q); } //~ use.uninitialized?
void main()
{
    rayQueryEXT local;
    if (!CHOSEN)
        START(local, gl_RayFlagsOpaqueEXT);
    START(global, gl_RayFlagsOpaqueEXT | gl_RayFlagsSkipAABBEXT);
    if (CHOSEN)
        rayQueryProceedEXT(global);
    rayQueryProceedEXT(global); //~ proceed.after_false?
    SHOW(read(local));
}
